//! What commands that say `auto` share: the calibration of a formula for a view, and its evidence as a table.

use std::fmt::Write as _;
use std::rc::Rc;

use bulbfold::calibrate::written::calibrated;
use bulbfold::calibrate::{Budget, Calibration, Options, Origin, Row, Verdict, cache, calibrate, camera_of};
use bulbfold::check::{Subject, Target};
use bulbfold::compose::{Composer, choose};
use bulbfold::expr::Arena;
use bulbfold::graph::{Camera, Method, ValidGraph};
use bulbfold::shade::Size;
use serde_json::{Value, json};

use super::arguments::{AutoArgs, PrecisionArg};
use super::progress::{Progress, short};
use super::seen::warns_of_inside;
use super::session::talk;
use super::{Failure, Session, usage};

/// What a calibration needs to know of a command.
pub struct Wish<'a> {
    /// What is asked of the estimate.
    pub estimate: &'a AutoArgs,
    /// The picture whose footprints count.
    pub size: Size,
    /// The view; the file's where absent.
    pub camera: Option<Camera>,
    /// Precision of the march.
    pub precision: PrecisionArg,
    /// How much may be computed, as a multiple of what is usual.
    pub effort: f64,
    /// Whether double precision may be taken instead.
    pub may_double: bool,
    /// No progress.
    pub quiet: bool,
}

/// Chooses the estimate of a graph: measured, or by the rules where that is switched off. Warnings are told.
pub fn choose_estimate(
    session: &Session,
    graph: &ValidGraph,
    arena: &Rc<Arena>,
    wish: &Wish,
) -> Result<Calibration, Failure> {
    let composer = Composer { arena, library: &session.library, graph };
    let plan = choose(&composer, &wish.estimate.settings()).map_err(|diagnostic| session.failure(diagnostic))?;
    settle_estimate(session, Subject { library: &session.library, graph, arena, plan }, wish)
}

/// The same for a subject with the plan that the rules make of what is wished. Nothing is told of a choice that wants double
/// precision, where that may be taken.
pub fn settle_estimate(session: &Session, subject: Subject, wish: &Wish) -> Result<Calibration, Failure> {
    subject.plan.warnings.iter().for_each(|warning| session.warn(warning));
    let is_inside = subject.graph.plane.is_none() && {
        let camera = wish.camera.unwrap_or_else(|| camera_of(&subject));
        warns_of_inside(session, &subject, &camera)?
    };
    // Points of a plane need no step multiplier, and no ray misses them; from inside of the set none goes anywhere.
    if subject.graph.plane.is_some() || is_inside || !wish.estimate.calibrate.0 {
        if wish.estimate.quality.is_some() && subject.graph.plane.is_none() && !is_inside {
            let help = "drop one of them, or name a proof: `--de certified-ball`";
            return Err(usage("`--quality` is for the measured choice, which `--calibrate off` switches off", help));
        }
        return Ok(Calibration::by_rule(&subject));
    }
    let options = options(&subject, wish);
    let mut progress = Progress::new(wish.quiet);
    let calibration = calibrate(&subject, &options, &mut |share| progress.update(share));
    progress.finish();
    let calibration = calibration.map_err(|diagnostic| session.failure(diagnostic))?;
    if calibration.wants_double && wish.may_double {
        return Ok(calibration);
    }
    calibration.warnings.iter().for_each(|warning| session.warn(warning));
    if let (Some(line), false) = (calibration.warns_of_price(), wish.quiet) {
        talk(&format!("note: {line}"));
    }
    Ok(calibration)
}

/// What a calibration goes by where the user's cache is read and written.
pub fn options(subject: &Subject, wish: &Wish) -> Options {
    Options {
        budget: wish.estimate.error_budget,
        wanted: wish.estimate.settings(),
        camera: wish.camera.unwrap_or_else(|| camera_of(subject)),
        size: wish.size,
        target: if wish.precision == PrecisionArg::F64 { Target::CpuF64 } else { Target::CpuF32 },
        effort: wish.effort,
        cache: cache::folder(),
        ..Options::of_view(subject)
    }
}

/// The evidence as lines of a table, with a line before it that says where the choice comes from.
pub fn table(calibration: &Calibration) -> String {
    let mut text = String::new();
    let [rays, hits] = calibration.rays;
    let walked = format!("{rays} rays walked by brute force, {hits} hits");
    let time = short(calibration.time);
    let _ = match calibration.origin {
        Origin::Rules => writeln!(text, "calibration          none, or switched off; the estimate is chosen by rules"),
        Origin::File => writeln!(text, "calibration          none: the file says that its estimate is calibrated"),
        Origin::Fixed => writeln!(text, "calibration          none: there is nothing left to choose"),
        Origin::Cached => writeln!(text, "calibration          {walked}, kept from an earlier run"),
        Origin::Measured => writeln!(text, "calibration          {walked}, {time}"),
    };
    if calibration.evidence.is_empty() {
        return text;
    }
    text.push_str(&limits(&calibration.budget));
    let cheapest = calibration.evidence.iter().find(|row| row.is_chosen()).map_or(1.0, |row| row.cost.max(1e-9));
    let _ = writeln!(
        text,
        "  {:<24}{:>6}{:>9}{:>8}  {:>22}{:>9}{:>9}{:>9}{:>9}{:>11}{:>7}",
        "candidate",
        "fudge",
        "shortest",
        "longest",
        "missed",
        "at most",
        "early",
        "at most",
        "error",
        "estimates",
        "cost"
    );
    for row in &calibration.evidence {
        let verdict = match &row.verdict {
            Verdict::Chosen if calibration.is_within => "chosen",
            Verdict::Chosen => "chosen: the least bad",
            Verdict::Fails(why) => why,
        };
        let Row { candidate, missed, early, error, estimates, cost, .. } = row;
        let _ = writeln!(
            text,
            "  {:<24}{:>6}{:>9}{:>8}  {:>22}{:>7.2} %{:>7.2} %{:>7.2} %{:>9.3}{:>11.1}{:>7.2}  {verdict}",
            candidate.name(),
            candidate.fudge,
            shown_share(candidate.least_step),
            candidate.most_step.map_or("-".into(), |longest| longest.to_string()),
            format!("{} of {} = {:.2} %", missed.seen, missed.of, 100.0 * missed.share()),
            100.0 * missed.bound(),
            100.0 * early.share(),
            100.0 * early.bound(),
            error,
            estimates,
            cost / cheapest
        );
    }
    calibration.notes.iter().for_each(|note| text.push_str(&format!("  {note}\n")));
    text
}

/// The limits that are applied, in a line.
fn limits(budget: &Budget) -> String {
    format!(
        "  to keep the budget, missed hits at most {:.2} % and early stops at most {:.2} %, with 95 % confidence; median error {}\n",
        100.0 * budget.missed,
        100.0 * budget.early,
        budget.error
    )
}

fn shown_share(share: f64) -> String {
    let inverse = 1.0 / share;
    if (inverse - inverse.round()).abs() < 1e-9 { format!("1/{}", inverse.round()) } else { format!("{share:.4}") }
}

/// The evidence as JSON.
pub fn json(calibration: &Calibration) -> Value {
    let origin = match calibration.origin {
        Origin::Rules => "rules",
        Origin::File => "file",
        Origin::Fixed => "fixed",
        Origin::Cached => "cache",
        Origin::Measured => "measured",
    };
    json!({
        "origin": origin,
        "within_budget": calibration.is_within,
        "rays": calibration.rays[0],
        "hits": calibration.rays[1],
        "seconds": calibration.time.as_secs_f64(),
        "chosen": pasted(calibration),
        "notes": calibration.notes,
        "candidates": calibration.evidence.iter().map(cache::row_json).collect::<Vec<_>>(),
    })
}

/// The field that carries the choice in a formula file, where anything was chosen.
pub fn pasted(calibration: &Calibration) -> Option<String> {
    let chosen = &calibration.chosen;
    let mut parts = Vec::new();
    parts.extend(chosen.method.map(|method| format!("method: \"{}\"", Method::name(method))));
    parts.extend(chosen.form.map(|form| format!("form: \"{}\"", form.name())));
    parts.extend(chosen.fudge.map(|fudge| format!("fudge: {fudge}")));
    parts.extend(chosen.least_step.map(|share| format!("least_step: {share}")));
    parts.extend(chosen.late_ends.map(|late| format!("late_ends: {late}")));
    parts.extend(chosen.most_step.map(|longest| format!("most_step: {longest}")));
    (!parts.is_empty())
        .then(|| format!("estimate: ({}, calibrated: {}),", parts.join(", "), calibrated(calibration.rows)))
}
