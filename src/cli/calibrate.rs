//! `bulbfold calibrate`: which estimate `auto` takes for a formula's own view, and why.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use bulbfold::engine::{Request, Settling};
use bulbfold::expr::Arena;
use bulbfold::math::Precision;
use bulbfold::shade::Size;
use clap::Args;

use super::arguments::{AutoArgs, ChangeArgs, parse_positive, precision_parser};
use super::calibrate_write;
use super::calibration::{json, pasted, table};
use super::sizes::parse_size;
use super::{Outcome, Session, usage};

/// The effort for a choice that many pictures will use.
const EFFORT_OF_WRITING: f64 = 20.0;

fn parse_effort(text: &str) -> Result<f64, String> {
    match parse_positive(text)? {
        effort if effort <= 1000.0 => Ok(effort),
        _ => Err("it must be at most 1000".into()),
    }
}

/// Arguments of `calibrate`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold calibrate mandelbulb
  bulbfold calibrate my_hybrid.ron --size 1920x1080 --error-budget 0.1%,1%,0.2
  bulbfold calibrate formulas/fractals/*.ron --write

Paste the last line for a formula into its file, or let --write do it. Its renders then need no calibration, and
`bulbfold test` checks that the choice still keeps the budget. --write measures calibrated files again, keeps
everything else in the text, and changes a file only if the choice passes that check.")]
pub struct Arguments {
    /// Formula files (.ron), graph scripts (.rhai) or names of built-in fractals
    #[arg(required = true, value_name = "FILE")]
    pub(super) files: Vec<PathBuf>,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Write the choice into the formula files, and print a line for each
    #[arg(long, conflicts_with_all = ["json", "set", "preset"])]
    write: bool,
    /// How much may be computed, as a multiple of what a render would: more rays are walked by brute force, up to 500 hits
    /// [default: 1, with --write 20]
    #[arg(long, value_name = "TIMES", value_parser = parse_effort)]
    effort: Option<f64>,
    /// Size of the picture, which sets how fine a pixel is
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    pub(super) size: Size,
    /// Precision that candidates march in
    #[arg(long, value_parser = precision_parser(), default_value_t = Precision::F32)]
    pub(super) precision: Precision,
    #[command(flatten)]
    pub(super) estimate: AutoArgs,
    /// Print one JSON object for each formula, a line each, instead of tables
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// How much may be computed.
    pub(super) fn effort(&self) -> f64 {
        self.effort.unwrap_or(if self.write { EFFORT_OF_WRITING } else { 1.0 })
    }

    /// The picture that estimates are chosen for.
    pub(super) fn request(&self) -> Request {
        Request { effort: self.effort(), ..self.estimate.request(self.size) }
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    if arguments.write {
        if !arguments.estimate.calibrate.0 {
            return Err(usage("with `--calibrate off` there is nothing to write", "drop one of them"));
        }
        return calibrate_write::run(arguments, session, out);
    }
    for (i, file) in arguments.files.iter().enumerate() {
        // What the file carries is measured anew, as `--write` does.
        let graph = session.load_solid(file, &arguments.changes.changes(), "`calibrate`")?.without_calibration();
        let arena = Arc::new(Arena::default());
        let request = arguments.request();
        let settling = Settling { library: &session.library, arena: &arena, request: &request };
        let calibration = settling
            .seen(graph)
            .and_then(|graph| {
                let plan = settling.plan(&graph)?;
                settling.estimate(&graph, plan, arguments.precision, &mut session.watch())
            })
            .map_err(|error| session.failed(error))?;
        if arguments.json {
            writeln!(out, "{}", json(&calibration))?;
            continue;
        }
        if arguments.files.len() > 1 {
            writeln!(out, "{}{}", if i > 0 { "\n" } else { "" }, file.display())?;
        }
        write!(out, "{}", table(&calibration))?;
        if let Some(field) = pasted(&calibration) {
            writeln!(out, "{field}")?;
        }
    }
    Ok(())
}
