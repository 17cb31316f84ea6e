//! `bulbfold audit`: what of a picture is certain.

use std::io::Write;
use std::sync::Arc;

use bulbfold::check::audit::{Audit, Mistake, audit};
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::render::RenderSettings;
use bulbfold::shade::Size;
use clap::Args;
use serde_json::json;

use super::arguments::{EstimateArgs, FormulaArgs};
use super::sizes::parse_size;
use super::{Outcome, Session};

/// Wrong rays that are listed one by one.
const LISTED: usize = 10;

/// Arguments of `audit`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold audit mandelbulb
  bulbfold audit my_hybrid.ron --de gradient --rays 5000 --json")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Number of sampled pixels
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    rays: u32,
    /// Columns and rows of the audited picture
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = parse_size)]
    size: Size,
    #[command(flatten)]
    estimate: EstimateArgs,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let graph = session.load_solid(&arguments.formula.file, &arguments.formula.changes(), "`audit`")?;
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &session.library, graph: &graph };
    let estimate = arguments.estimate.settings();
    let settings = RenderSettings { size: arguments.size, estimate, ..RenderSettings::default() };
    let mut progress = session.progress();
    let result = audit(&composer, &settings, arguments.rays as usize, &mut |share| progress.update(share));
    progress.finish();
    let result = result.map_err(|diagnostic| session.failure(diagnostic))?;
    match arguments.json {
        true => writeln!(out, "{}", as_json(&graph.name, &result))?,
        false => write!(out, "{}", as_text(&result))?,
    }
    Ok(())
}

fn as_json(name: &str, audit: &Audit) -> serde_json::Value {
    let wrong: Vec<_> = audit
        .wrong
        .iter()
        .map(|w| {
            json!({
                "pixel": [w.pixel.0, w.pixel.1], "kind": w.kind.name(), "estimated": w.estimated, "certified": w.certified,
            })
        })
        .collect();
    json!({
        "fractal": name, "method": audit.method, "rays": audit.rays, "proven_empty": audit.empty, "hit": audit.hit,
        "undecided": audit.undecided, "steps": {"estimate": audit.steps[0], "certified": audit.steps[1]}, "wrong": wrong,
    })
}

fn as_text(audit: &Audit) -> String {
    let share = |count: usize| format!("{count} ({:.2} %)", 100.0 * count as f64 / audit.rays.max(1) as f64);
    let mut text = String::new();
    let mut row = |name: &str, value: String| text.push_str(&format!("{name:<20} {value}\n"));
    row("method", audit.method.to_string());
    row("rays", audit.rays.to_string());
    row("proven empty", share(audit.empty));
    row("hit", share(audit.hit));
    row("undecided", share(audit.undecided));
    for kind in [Mistake::False, Mistake::Early, Mistake::Missed] {
        row(&format!("{}s", kind.name()), share(audit.count(kind)));
    }
    row("estimates a ray", format!("{:.1}, certified {:.1}", audit.steps[0], audit.steps[1]));
    let depth = |t: Option<f64>| t.map_or("nothing".to_string(), |t| format!("{t:.6}"));
    for w in audit.wrong.iter().take(LISTED) {
        let (x, y) = w.pixel;
        row(
            &format!("pixel {x},{y}"),
            format!("{}: estimate {}, certified {}", w.kind.name(), depth(w.estimated), depth(w.certified)),
        );
    }
    if audit.wrong.len() > LISTED {
        row("", format!("and {} more; --json lists all", audit.wrong.len() - LISTED));
    }
    text
}
