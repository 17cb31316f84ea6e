//! `bulbfold check`: what is wrong in a formula or step, and what to do about it.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use bulbfold::check::Subject;
use bulbfold::check::health::{Finding, Health, Severity, check_formula, check_step};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::Arena;
use bulbfold::files::{Chosen, MAX_TEXT, read_text};
use bulbfold::formula::step::Step;
use bulbfold::shade::Size;
use clap::Args;
use serde_json::json;

use super::arguments::FormulaArgs;
use super::progress::Progress;
use super::sizes::parse_size;
use super::{Failure, Outcome, Session, message, usage};

/// Version of what `--json` writes.
const JSON_VERSION: u32 = 1;

/// Arguments of `check`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold check my_hybrid.ron
  bulbfold check my_steps/fold_twice.rhai
  bulbfold check mandelbulb --set power=2 --size 1920x1080 --json

Samples for jumps, scalar rules below the true stretch, forms and radii that do not fit, and iterations
that no pixel shows. The exit code is 1 if something makes estimates or pictures wrong.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Size of the picture for which the iteration limit is judged
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    size: Size,
    /// Write JSON lines, one for each measure and finding and one for the summary
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let health = match step_of(&arguments.formula, session)? {
        Some(step) => check_step(&session.library, &step).map_err(|error| session.failure(error))?,
        None => formula_health(arguments, session)?,
    };
    match arguments.json {
        true => print_json(&health, session, out)?,
        false => print_text(&health, session, out)?,
    }
    match health.wrong().count() {
        0 => Ok(()),
        1 => Err(Failure::Work(message("one thing is wrong", ""))),
        count => Err(Failure::Work(message(&format!("{count} things are wrong"), ""))),
    }
}

/// The step of that file or name, where it is one; nothing if it is a formula.
fn step_of(formula: &FormulaArgs, session: &mut Session) -> Result<Option<Arc<Step>>, Failure> {
    let path = formula.file.as_path();
    let text = match path.extension().is_some_and(|e| e == "rhai") && path.is_file() {
        true => read_text(path, MAX_TEXT, Chosen::Found).unwrap_or_default(),
        false => String::new(),
    };
    let name = if bulbfold::formula::shape::is_step_text(&text) {
        let mut d = Diagnostics::default();
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        session.library.add_step_file(path, &mut d);
        session.library.add_beside(folder, &mut d);
        session.report(d)?;
        path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    } else if path.exists() {
        return Ok(None);
    } else {
        formula.file.to_string_lossy().into_owned()
    };
    let step = session.library.step(&name).cloned();
    match step {
        Some(_) if !formula.changes().is_empty() => {
            Err(usage("--set and --preset change fractals, not steps", "check a formula file that uses the step"))
        }
        Some(step) if !text.is_empty() && session.library.sources.text(step.text) != text => {
            let help = "rename the file: steps of one name hide each other";
            Err(usage(format!("{} is hidden by another step `{name}`", path.display()), help))
        }
        step => Ok(step),
    }
}

fn formula_health(arguments: &Arguments, session: &mut Session) -> Result<Health, Failure> {
    let graph = session.load(&arguments.formula.file, &arguments.formula.changes())?.graph;
    let arena = Arc::new(Arena::default());
    let subject = Subject::new(&session.library, &graph, &arena).map_err(|error| session.failure(error))?;
    let mut progress = Progress::new(false);
    let health = check_formula(&subject, arguments.size, &mut |share| progress.update(share));
    progress.finish();
    health.map_err(|error| session.failure(error))
}

fn print_text(health: &Health, session: &Session, out: &mut dyn Write) -> Outcome {
    let width = |of: fn(&bulbfold::check::health::Measure) -> usize| health.measures.iter().map(of).max().unwrap_or(0);
    let (subjects, whats) = (width(|m| m.subject.len()), width(|m| m.what.len()));
    let mut last = "";
    for measure in &health.measures {
        let subject = if measure.subject == last { "" } else { &measure.subject };
        last = &measure.subject;
        writeln!(out, "{subject:subjects$}  {:whats$}  {}", measure.what, measure.value)?;
    }
    let mut d = Diagnostics::default();
    let (notes, findings): (Vec<&Finding>, Vec<&Finding>) =
        health.findings.iter().partition(|finding| finding.severity == Severity::Note);
    d.extend(findings.iter().map(|finding| finding.diagnostic()));
    if !d.is_empty() {
        write!(out, "\n{}", d.render(&session.library.sources, false))?;
    }
    for note in notes {
        writeln!(out, "\nnote: {}\n  {}", note.message, note.help)?;
    }
    let count = |severity: Severity| health.findings.iter().filter(|f| f.severity == severity).count();
    let (wrong, warnings) = (count(Severity::Wrong), count(Severity::Warning));
    writeln!(out, "\nresult: {wrong} wrong, {warnings} warnings, {} notes", count(Severity::Note))?;
    Ok(())
}

fn print_json(health: &Health, session: &Session, out: &mut dyn Write) -> Outcome {
    for m in &health.measures {
        writeln!(out, "{}", json!({ "measure": { "subject": m.subject, "what": m.what, "value": m.value } }))?;
    }
    for f in &health.findings {
        let line = json!({ "finding": {
            "severity": f.severity.name(), "kind": f.kind.name(), "subject": f.subject, "message": f.message,
            "help": f.help, "place": f.place(&session.library.sources), "point": f.point,
        } });
        writeln!(out, "{line}")?;
    }
    let wrong = health.wrong().count();
    let line = json!({ "summary": { "version": JSON_VERSION, "wrong": wrong, "findings": health.findings.len() } });
    writeln!(out, "{line}")?;
    Ok(())
}
