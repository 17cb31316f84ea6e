//! `bulbfold calibrate`: which estimate `auto` takes for a formula's own view, and why.

use std::io::Write;
use std::rc::Rc;

use bulbfold::expr::Arena;
use bulbfold::shade::Size;
use clap::Args;

use super::arguments::{AutoArgs, FormulaArgs, PrecisionArg, parse_size};
use super::calibration::{Wish, choose_estimate, json, pasted, table};
use super::{Outcome, Session};

/// Arguments of `calibrate`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold calibrate mandelbulb
  bulbfold calibrate my_hybrid.ron --size 1920x1080 --error-budget 0.1%,1%,0.2

The last line can be pasted into the formula file: its renders then spend no time on calibration, and
`bulbfold test` checks that the choice still keeps the budget.")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Size of the picture, which says how fine a pixel is
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    size: Size,
    /// Precision that candidates march in
    #[arg(long, value_enum, default_value_t = PrecisionArg::F32)]
    precision: PrecisionArg,
    #[command(flatten)]
    estimate: AutoArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let graph = session.load(&arguments.formula.file, &arguments.formula.changes())?.graph;
    let wish = Wish {
        estimate: &arguments.estimate,
        size: arguments.size,
        camera: None,
        precision: arguments.precision,
        primary_rays: 0,
        quiet: false,
    };
    let calibration = choose_estimate(session, &graph, &Rc::new(Arena::default()), &wish)?;
    if arguments.json {
        writeln!(out, "{}", json(&calibration))?;
        return Ok(());
    }
    write!(out, "{}", table(&calibration))?;
    if let Some(field) = pasted(&calibration) {
        writeln!(out, "{field}")?;
    }
    Ok(())
}
