//! `bulbfold calibrate --write`: measured estimates put into formula files.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use bulbfold::calibrate::written::{with_outcome, without_outcome};
use bulbfold::calibrate::{Budget, Calibration, Options, calibrate};
use bulbfold::check::{Subject, check_calibration};
use bulbfold::compose::field_orbits;
use bulbfold::diag::{Diagnostics, SourceId};
use bulbfold::engine::Settling;
use bulbfold::expr::Arena;
use bulbfold::graph::ValidGraph;
use bulbfold::load::{Loaded, load, load_text};

use super::calibrate::Arguments;
use super::output::cannot_write;
use super::progress::{Progress, short};
use super::{Failure, Outcome, Session, message, usage};

/// Shares of the budget that are tried: a choice that keeps all of it on the rays that it was measured on may still break it
/// on others.
const STRICTER: [f64; 3] = [1.0, 0.5, 0.1];

/// What became of a file.
enum Written {
    /// It carries this choice now.
    Changed(Box<Calibration>),
    /// It carried this choice already.
    Same(Box<Calibration>),
    /// There is nothing to choose: the field has no orbits.
    NoOrbit,
    /// It stays as it was.
    Failed(String),
}

/// Runs the command: a line for each file, then how many there were of each kind.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    for file in &arguments.files {
        if !file.is_file() || file.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ron")) {
            let help =
                "give the paths of formula files (.ron); without --write, built-in names and scripts are fine too";
            return Err(usage(format!("{} is no formula file that could be written", file.display()), help));
        }
    }
    let width = arguments.files.iter().map(|file| file.display().to_string().chars().count()).max().unwrap_or(0).max(7);
    writeln!(
        out,
        "{:<width$}  {:<24}{:>6}{:>9}{:>8}{:>9}{:>9}{:>8}{:>9}  written",
        "formula", "estimate", "fudge", "shortest", "hits", "missed", "early", "error", "time"
    )?;
    let (mut changed, mut failures) = (0, Vec::new());
    for file in &arguments.files {
        let start = Instant::now();
        let written = write_one(arguments, session, file)?;
        let time = short(start.elapsed());
        let file = file.display().to_string();
        match &written {
            Written::Changed(calibration) | Written::Same(calibration) => {
                let is_new = matches!(written, Written::Changed(_));
                changed += usize::from(is_new);
                let line = line(calibration, &time);
                writeln!(out, "{file:<width$}  {line}  {}", if is_new { "yes" } else { "as it was" })?;
            }
            Written::NoOrbit => writeln!(out, "{file:<width$}  no orbit: distances are the primitives' own")?,
            Written::Failed(why) => {
                writeln!(out, "{file:<width$}  not written: {}", why.lines().next().unwrap_or(""))?;
                failures.push(format!("{file}: {why}"));
            }
        }
        out.flush()?;
    }
    let files = arguments.files.len();
    writeln!(out, "{changed} of {files} files changed, {} failed", failures.len())?;
    match failures.is_empty() {
        true => Ok(()),
        false => Err(Failure::Work(message(&failures.join("\n"), "the files above are as they were"))),
    }
}

fn line(calibration: &Calibration, time: &str) -> String {
    let row = calibration.evidence.iter().find(|row| row.is_chosen());
    let Some(row) = row else { return "nothing was left to choose".into() };
    format!(
        "{:<24}{:>6}{:>9}{:>8}{:>7.2} %{:>7.2} %{:>8.3}{time:>9}",
        row.candidate.name(),
        row.candidate.fudge,
        format!("{:.4}", row.candidate.least_step),
        calibration.rays[1],
        100.0 * row.missed.share(),
        100.0 * row.early.share(),
        row.error
    )
}

/// A text as a graph; its messages where it is broken.
fn read(session: &mut Session, name: &str, text: &str) -> Result<Loaded, String> {
    let mut d = Diagnostics::default();
    let loaded = load_text(&mut session.library, name, text, &[], &mut d);
    loaded.ok_or_else(|| d.render(&session.library.sources, false))
}

fn write_one(arguments: &Arguments, session: &mut Session, path: &Path) -> Result<Written, Failure> {
    let mut d = Diagnostics::default();
    let file = &path.display().to_string();
    let Some(loaded) = load(&mut session.library, path, &[], &mut d) else {
        return Ok(Written::Failed(d.render(&session.library.sources, false)));
    };
    let original = session.library.sources.text(loaded.text).to_string();
    match settle(arguments, session, file, loaded) {
        Ok(None) => Ok(Written::NoOrbit),
        Ok(Some((_, calibration))) if calibration.evidence.is_empty() => {
            Ok(Written::Failed("the file fixes method, fudge and least_step, so there is nothing to measure".into()))
        }
        Ok(Some((text, calibration))) if text == original => Ok(Written::Same(Box::new(calibration))),
        Ok(Some((text, calibration))) => {
            bulbfold::files::write(path, text.as_bytes()).map_err(|error| cannot_write(path, &error))?;
            Ok(Written::Changed(Box::new(calibration)))
        }
        Err(why) => Ok(Written::Failed(why)),
    }
}

/// The new text of a file and the calibration behind it: the first, by growing strictness, that passes the check of
/// `bulbfold test`. `None` if the formula has no orbits.
fn settle(
    arguments: &Arguments,
    session: &mut Session,
    file: &str,
    loaded: Loaded,
) -> Result<Option<(String, Calibration)>, String> {
    let bare = with_subject(session, &loaded.graph, |subject| without_outcome(subject, loaded.text))?;
    let loaded = match bare {
        Some(text) => read(session, file, &text)?,
        None => loaded,
    };
    let mut why = String::new();
    for share in STRICTER {
        let budget = &arguments.estimate.error_budget;
        let budget = Budget { missed: budget.missed * share, early: budget.early * share, ..*budget };
        let Some((text, calibration)) = measure(arguments, session, &loaded.graph, loaded.text, budget)? else {
            return Ok(None);
        };
        let proposed = read(session, file, &text)?;
        if calibration.evidence.is_empty() {
            return Ok(Some((text, calibration)));
        }
        match with_subject(session, &proposed.graph, check_calibration)? {
            Ok(()) => return Ok(Some((text, calibration))),
            Err(error) => why = error,
        }
    }
    Err(why)
}

/// Does something with a graph's subject; the message of a step's script that fails, else.
fn with_subject<T>(session: &Session, graph: &ValidGraph, work: impl FnOnce(&Subject) -> T) -> Result<T, String> {
    let arena = Arc::new(Arena::default());
    let subject = Subject::new(&session.library, graph, &arena).map_err(|error| told(session.failure(error)))?;
    Ok(work(&subject))
}

fn told(failure: Failure) -> String {
    match failure {
        Failure::Usage(text) | Failure::Work(text) => text,
        Failure::ClosedPipe => String::new(),
    }
}

/// Calibrates a formula within a budget, and puts the outcome into its text.
fn measure(
    arguments: &Arguments,
    session: &Session,
    graph: &ValidGraph,
    text: SourceId,
    budget: Budget,
) -> Result<Option<(String, Calibration)>, String> {
    with_subject(session, graph, |subject| {
        if field_orbits(&subject.composer()).is_empty() {
            return Ok(None);
        }
        let request = arguments.request();
        let settling = Settling { library: subject.library, arena: subject.arena, request: &request };
        let plan = settling.plan(subject.graph).map_err(|error| told(session.failed(error)))?;
        let subject = Subject { plan, ..*subject };
        let options = Options { budget, cache: None, ..settling.options(&subject, arguments.precision) };
        let mut progress = Progress::new(false);
        let calibration = calibrate(&subject, &options, &mut |share| {
            progress.update(share);
            true
        });
        progress.finish();
        let calibration = calibration.map_err(|error| told(session.failure(error)))?;
        let text = with_outcome(&subject, text, &calibration);
        Ok(text.map(|text| (text, calibration)))
    })?
}
