//! Calibrations that are kept from run to run: one small JSON file each, named by a hash of formula, view, budget and
//! program version.
//!
//! Whatever is wrong with a file or the folder, the calibration is made anew; a file is written beside its place and then
//! renamed, so that no reader ever sees half of one.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use super::{Calibration, Candidate, Count, Options, Origin, Row, Space, Verdict};
use crate::check::Subject;
use crate::check::truth::compose_membership;
use crate::compose::{Purpose, field_orbits};
use crate::diag::Diagnostic;
use crate::files::{Chosen, MAX_TEXT, read_text};
use crate::graph::print::listing;
use crate::graph::{DeForm, Method, NodeKind};
use crate::kernel::listing::listing as instructions;

/// Counts changes of the calibration itself: what older programs kept is not read any more.
const VERSION: u32 = 14;

/// The user's folder for calibrations: `$BULBFOLD_CACHE`, else `bulbfold` in the system's folder for caches. `None` where
/// there is none, or the variable is empty.
pub fn folder() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let given = |name: &str| set(name).filter(|path| !path.as_os_str().is_empty());
    if let Some(path) = set("BULBFOLD_CACHE") {
        return (!path.as_os_str().is_empty()).then_some(path);
    }
    let base = if cfg!(windows) {
        given("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        given("HOME").map(|home| home.join("Library").join("Caches"))
    } else {
        // A relative path there is to be ignored, says the XDG specification.
        let xdg = given("XDG_CACHE_HOME").filter(|path| path.is_absolute());
        xdg.or_else(|| given("HOME").map(|home| home.join(".cache")))
    };
    base.map(|base| base.join("bulbfold"))
}

/// The name of a calibration's file.
pub fn key(subject: &Subject, options: &Options) -> Result<String, Diagnostic> {
    let composer = subject.composer();
    let mut text = format!("bulbfold {} {VERSION}\n{}\n", env!("CARGO_PKG_VERSION"), listing(subject.graph));
    for orbit in field_orbits(&composer) {
        let _ = writeln!(text, "{:?}", orbit.settings);
    }
    // What the maps compute, and the steps' texts, which hold the scalar rules too.
    text.push_str(&instructions(subject.arena, &compose_membership(&composer, &subject.plan.choices, Purpose::Truth)?));
    for node in &subject.graph.nodes {
        if let NodeKind::Step { step, .. } | NodeKind::Shape { step, .. } = &node.kind {
            text.push_str(subject.library.sources.text(step.text));
        }
    }
    let Options { budget, wanted, camera, size, precision, effort, seed, cache: _ } = options;
    let _ = write!(
        text,
        "{budget:?} {wanted:?} {camera:?} {size:?} {precision:?} {effort} {seed} {}",
        subject.plan.bounding_radius
    );
    Ok(format!("{:032x}.json", hash(text.as_bytes())))
}

/// The 128-bit hash FNV-1a (Fowler, Noll and Vo).
pub fn hash(bytes: &[u8]) -> u128 {
    const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
    const START: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
    bytes.iter().fold(START, |hash, byte| (hash ^ u128::from(*byte)).wrapping_mul(PRIME))
}

/// What a file holds.
#[derive(Clone, PartialEq, Debug)]
pub struct Entry {
    chosen: Candidate,
    is_within: bool,
    wants_double: bool,
    evidence: Vec<Row>,
    rays: [usize; 2],
    reason: String,
    warnings: Vec<String>,
    notes: Vec<String>,
}

impl Entry {
    pub(super) fn into_calibration(self, space: &Space, options: &Options, start: Instant) -> Calibration {
        let mut plan = space.plan(&self.chosen);
        plan.choices.iter_mut().for_each(|choice| choice.reason.clone_from(&self.reason));
        Calibration {
            chosen: self.chosen.settings(),
            plan,
            origin: Origin::Cached,
            budget: options.budget,
            is_within: self.is_within,
            wants_double: self.wants_double,
            rows: options.size.height,
            evidence: self.evidence,
            rays: self.rays,
            warnings: self.warnings,
            notes: self.notes,
            time: start.elapsed(),
        }
    }
}

/// Writes a calibration to its file, and makes the folder where there is none.
pub fn write(path: &Path, calibration: &Calibration) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let chosen = calibration.evidence.iter().find(|row| row.is_chosen()).map(|row| row.candidate);
    let Some(chosen) = chosen else { return Ok(()) };
    let text = json!({
        "chosen": candidate_json(&chosen),
        "is_within": calibration.is_within,
        "wants_double": calibration.wants_double,
        "rays": calibration.rays,
        "reason": calibration.plan.choices.first().map_or("", |c| c.reason.as_str()),
        "warnings": calibration.warnings,
        "notes": calibration.notes,
        "evidence": calibration.evidence.iter().map(row_json).collect::<Vec<_>>(),
    });
    crate::files::write(path, format!("{text:#}\n").as_bytes())
}

/// Reads a file; nothing if it is missing or is not what [`write()`] writes.
pub fn read(path: &Path) -> Option<Entry> {
    parse(&read_text(path, MAX_TEXT, Chosen::Found).ok()?)
}

/// Reads the text of a file; nothing where it is not what [`write()`] writes.
pub fn parse(text: &str) -> Option<Entry> {
    let value: Value = serde_json::from_str(text).ok()?;
    let texts = |name: &str| -> Option<Vec<String>> {
        value[name].as_array()?.iter().map(|v| v.as_str().map(String::from)).collect()
    };
    let rays = value["rays"].as_array()?;
    let count = |i: usize| rays.get(i).and_then(Value::as_u64).map(|n| n as usize);
    Some(Entry {
        chosen: candidate(&value["chosen"])?,
        is_within: value["is_within"].as_bool()?,
        wants_double: value["wants_double"].as_bool()?,
        evidence: value["evidence"].as_array()?.iter().map(row).collect::<Option<_>>()?,
        rays: [count(0)?, count(1)?],
        reason: value["reason"].as_str()?.to_string(),
        warnings: texts("warnings")?,
        notes: texts("notes")?,
    })
}

fn candidate_json(candidate: &Candidate) -> Value {
    json!({
        "method": candidate.method.map(Method::name), "form": candidate.form.map(DeForm::name),
        "fudge": candidate.fudge, "least_step": candidate.least_step,
        "most_step": candidate.most_step, "late_ends": candidate.late_ends,
    })
}

/// A row as JSON: the candidate's fields, `missed` and `early` (shares), what they were counted of (`hits`, `stops`) and their
/// bounds with 95 % confidence (`missed_bound`, `early_bound`), `error`, `estimates`, `cost` and `why_not` (null if it is
/// chosen). Numbers that are not finite are null.
pub fn row_json(row: &Row) -> Value {
    let mut value = candidate_json(&row.candidate);
    for (name, of, count) in [("missed", "hits", row.missed), ("early", "stops", row.early)] {
        value[name] = count.share().into();
        value[format!("{name}_seen")] = count.seen.into();
        value[of] = count.of.into();
        value[format!("{name}_bound")] = count.bound().into();
    }
    value["error"] = row.error.into();
    value["estimates"] = row.estimates.into();
    value["cost"] = row.cost.into();
    value["why_not"] = match &row.verdict {
        Verdict::Chosen => Value::Null,
        Verdict::Fails(why) => why.as_str().into(),
    };
    value
}

fn candidate(value: &Value) -> Option<Candidate> {
    let word = |name: &str| value.get(name)?.as_str();
    let share = |name: &str| value[name].as_f64().filter(|x| *x > 0.0 && *x <= 1.0);
    let method = word("method").map(|name| Method::ALL.into_iter().find(|m| m.name() == name));
    let form = word("form").map(|name| DeForm::ALL.into_iter().find(|f| f.name() == name));
    // A name that nobody knows spoils the entry; no name is a choice of its own.
    let (method, form) = (method.map_or(Some(None), |m| m.map(Some))?, form.map_or(Some(None), |f| f.map(Some))?);
    let most_step = match &value["most_step"] {
        Value::Null => None,
        longest => Some(longest.as_f64().filter(|x| *x > 0.0)?),
    };
    let late_ends = value["late_ends"].as_bool()?;
    Some(Candidate { method, form, fudge: share("fudge")?, least_step: share("least_step")?, most_step, late_ends })
}

fn row(value: &Value) -> Option<Row> {
    let number = |name: &str| value[name].as_f64();
    let count = |seen: &str, of: &str| {
        let whole = |name: &str| value[name].as_u64().map(|n| n as usize);
        Some(Count { seen: whole(seen)?, of: whole(of)? })
    };
    Some(Row {
        candidate: candidate(value)?,
        missed: count("missed_seen", "hits")?,
        early: count("early_seen", "stops")?,
        error: number("error").unwrap_or(f64::INFINITY),
        estimates: number("estimates")?,
        cost: number("cost")?,
        verdict: match value.get("why_not")? {
            Value::Null => Verdict::Chosen,
            why => Verdict::Fails(why.as_str()?.to_string()),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::hash;

    /// From the authors' own list of test vectors.
    #[test]
    fn the_hash_is_fnv_1a() {
        assert_eq!(hash(b""), 0x6c62272e07bb014262b821756295c58d);
        assert_eq!(hash(b"a"), 0xd228cb696f1a8caf78912b704e4a8964);
    }
}
