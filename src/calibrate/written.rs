//! The outcome of a calibration in a formula file's text.
//!
//! A file that carries its estimate with `calibrated: true` is rendered without measuring anything. The estimate stands in
//! the file's own `estimate`, or in that of each `Orbit` which the file writes out. Everything else in the text stays.

use super::Calibration;
use crate::check::Subject;
use crate::compose::field_orbits;
use crate::diag::{Diagnostics, SourceId};
use crate::formula::edit::{Edits, find};
use crate::formula::ron::{Limits, read_ron};
use crate::formula::value::Value;
use crate::graph::{CALIBRATED_ROWS, Method, NodeRef};

/// Fields that a calibration decides anew. A form stays what it is: it may be part of the set's definition.
const OUTCOME: [&str; 6] = ["method", "fudge", "least_step", "most_step", "late_ends", "calibrated"];
/// Fields that the estimate is written behind.
const BEFORE: [&str; 11] = [
    "of",
    "output",
    "constant",
    "start",
    "pre",
    "post",
    "escape",
    "escape_radius",
    "max_iterations",
    "slice",
    "bounding_radius",
];

/// The text of a subject's file without the outcome of an earlier calibration, for another one. `None` if it has none.
pub fn without_outcome(subject: &Subject, text: SourceId) -> Option<String> {
    let is_calibrated =
        field_orbits(&subject.composer()).iter().any(|orbit| orbit.settings.estimate.calibrated.is_some());
    is_calibrated.then(|| changed(subject, text, Vec::new)).flatten()
}

/// The text of a subject's file with the outcome of a calibration. `None` if the file has no orbit.
pub fn with_outcome(subject: &Subject, text: SourceId, calibration: &Calibration) -> Option<String> {
    let mut choices = calibration.plan.choices.iter();
    changed(subject, text, || {
        let mut entries = Vec::new();
        let choice = choices.next();
        if let Some(method) = choice.map(|choice| choice.method).filter(|method| *method != Method::Own) {
            entries.push(("method", format!("\"{}\"", method.name())));
        }
        if let Some(form) = calibration.chosen.form {
            entries.push(("form", form.name().to_string()));
        }
        entries.push(("fudge", calibration.plan.fudge.to_string()));
        entries.push(("least_step", calibration.plan.least_step.to_string()));
        entries.extend(calibration.chosen.most_step.map(|longest| ("most_step", longest.to_string())));
        entries.extend(calibration.chosen.late_ends.map(|late| ("late_ends", late.to_string())));
        entries.push(("calibrated", calibrated(calibration.rows)));
        entries
    })
}

/// The value of `calibrated` that stands for a picture of so many rows.
pub fn calibrated(rows: u32) -> String {
    if rows == CALIBRATED_ROWS { "true".into() } else { rows.to_string() }
}

/// Sets the fields that `change` gives for each orbit in turn, and removes others of an earlier outcome.
fn changed(
    subject: &Subject,
    text: SourceId,
    mut change: impl FnMut() -> Vec<(&'static str, String)>,
) -> Option<String> {
    let sources = &subject.library.sources;
    let value = read_ron(sources, text, &Limits::default(), &mut Diagnostics::default())?;
    let text = sources.text(text);
    let mut edits = Edits::default();
    let mut done: Vec<crate::diag::Span> = Vec::new();
    for orbit in field_orbits(&subject.composer()) {
        let entries = change();
        let host = host(&value, subject, orbit.node);
        // A field may stand in several places, and maps without an `Orbit` of their own share the file's settings.
        if done.contains(&host.span) {
            continue;
        }
        done.push(host.span);
        edits.set_struct(text, host, "estimate", &entries, &OUTCOME, &BEFORE);
    }
    (!edits.is_empty()).then(|| edits.apply(text))
}

/// Where an orbit's settings stand: in the `Orbit` that the file writes out, else at the top.
fn host<'v>(value: &'v Value, subject: &Subject, node: NodeRef) -> &'v Value {
    let found = find(value, subject.graph.node(node).span);
    found.filter(|found| found.name().is_some_and(|name| name.text == "Orbit")).unwrap_or(value)
}
