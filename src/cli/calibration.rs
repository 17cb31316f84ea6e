//! What commands that say `auto` share: the calibration of a formula for a view, and its evidence as a table.

use std::fmt::Write as _;
use std::rc::Rc;

use bulbfold::calibrate::written::calibrated;
use bulbfold::calibrate::{Calibration, Options, Origin, Row, Verdict, cache, calibrate, camera_of};
use bulbfold::check::{Subject, Target};
use bulbfold::compose::{Composer, choose};
use bulbfold::expr::Arena;
use bulbfold::graph::{Camera, Method, ValidGraph};
use bulbfold::shade::Size;
use serde_json::{Value, json};

use super::arguments::{AutoArgs, PrecisionArg};
use super::progress::{Progress, short};
use super::{Failure, Session};

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
    /// Primary rays of the render, or 0.
    pub primary_rays: u64,
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
    let plan =
        choose(&composer, &wish.estimate.estimate.settings()).map_err(|diagnostic| session.failure(diagnostic))?;
    settle_estimate(session, Subject { library: &session.library, graph, arena, plan }, wish)
}

/// The same for a subject with the plan that the rules make of what is wished.
pub fn settle_estimate(session: &Session, subject: Subject, wish: &Wish) -> Result<Calibration, Failure> {
    subject.plan.warnings.iter().for_each(|warning| session.warn(warning));
    // Points of a plane need no step multiplier, and no ray misses them.
    if subject.graph.plane.is_some() || !wish.estimate.calibrate.0 {
        return Ok(Calibration::by_rule(&subject));
    }
    let options = options(&subject, wish);
    let mut progress = Progress::new(wish.quiet);
    let calibration = calibrate(&subject, &options, &mut |share| progress.update(share));
    progress.finish();
    let calibration = calibration.map_err(|diagnostic| session.failure(diagnostic))?;
    calibration.warnings.iter().for_each(|warning| session.warn(warning));
    Ok(calibration)
}

/// What a calibration goes by where the user's cache is read and written.
pub fn options(subject: &Subject, wish: &Wish) -> Options {
    Options {
        budget: wish.estimate.error_budget,
        wanted: wish.estimate.estimate.settings(),
        camera: wish.camera.unwrap_or_else(|| camera_of(subject)),
        size: wish.size,
        primary_rays: wish.primary_rays,
        target: if wish.precision == PrecisionArg::F64 { Target::CpuF64 } else { Target::CpuF32 },
        cache: cache::folder(),
        ..Options::of_view(subject)
    }
}

/// The evidence as lines of a table, with a line before it that says where the choice comes from.
pub fn table(calibration: &Calibration) -> String {
    let mut text = String::new();
    let [rays, hits] = calibration.rays;
    let time = short(calibration.time);
    let _ = match calibration.origin {
        Origin::Rules => writeln!(text, "calibration          none, or switched off; the estimate is chosen by rules"),
        Origin::File => writeln!(text, "calibration          none: the file says that its estimate is calibrated"),
        Origin::Fixed => writeln!(text, "calibration          none: there is nothing left to choose"),
        Origin::Cached => writeln!(text, "calibration          {rays} rays, {hits} hits, kept from an earlier run"),
        Origin::Measured => writeln!(text, "calibration          {rays} rays, {hits} hits, {time}"),
    };
    if calibration.evidence.is_empty() {
        return text;
    }
    let cheapest = calibration.evidence.iter().find(|row| row.is_chosen()).map_or(1.0, |row| row.cost.max(1e-9));
    let _ = writeln!(
        text,
        "  {:<24}{:>6}{:>9}{:>9}{:>9}{:>9}{:>11}{:>7}",
        "candidate", "fudge", "shortest", "missed", "early", "error", "estimates", "cost"
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
            "  {:<24}{:>6}{:>9}{:>7.2} %{:>7.2} %{:>9.3}{:>11.1}{:>7.2}  {verdict}",
            candidate.name(),
            candidate.fudge,
            shown_share(candidate.least_step),
            100.0 * missed,
            100.0 * early,
            error,
            estimates,
            cost / cheapest
        );
    }
    text
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
    (!parts.is_empty())
        .then(|| format!("estimate: ({}, calibrated: {}),", parts.join(", "), calibrated(calibration.rows)))
}
