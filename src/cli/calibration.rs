//! The evidence of a calibration, as a table for people and as JSON for programs.

use std::fmt::Write as _;

use bulbfold::calibrate::written::calibrated;
use bulbfold::calibrate::{Budget, Calibration, Origin, Row, Verdict, cache};
use bulbfold::graph::Method;
use serde_json::{Value, json};

use super::progress::short;

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
