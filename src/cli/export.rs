//! `bulbfold export`: a formula's distance estimate for other programs.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use bulbfold::compose::{Composer, choose};
use bulbfold::exchange::export::{ExportError, Exported, Target, export};
use bulbfold::expr::Arena;
use bulbfold::graph::ValidGraph;
use bulbfold::render::camera_of;
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};

use super::arguments::{EstimateArgs, FormulaArgs};
use super::output::{Content, check_output, write_or_print};
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `export`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold export mandelbulb --to shadertoy -o bulb.glsl
  bulbfold export mandelbox --set scale=-1.5 --to hlsl
  bulbfold export menger --to spirv -o menger.spv")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// Language or program
    #[arg(long, value_enum, value_name = "TARGET")]
    to: TargetArg,
    /// Write to this file instead of stdout, which is also `-`
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    #[command(flatten)]
    estimate: EstimateArgs,
}

/// A target as a flag's value.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct TargetArg(Target);

impl ValueEnum for TargetArg {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: [TargetArg; Target::ALL.len()] = {
            let mut all = [TargetArg(Target::Wgsl); Target::ALL.len()];
            let mut i = 0;
            while i < all.len() {
                all[i] = TargetArg(Target::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()))
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let content = match (arguments.to.0, &arguments.output) {
        (Target::Spirv, None) => {
            let help = "write `-o NAME.spv`, or `-o -` for a program that reads it";
            return Err(usage("SPIR-V is no text, so it needs a file", help));
        }
        (Target::Spirv, _) => Content::Bytes,
        _ => Content::Text,
    };
    let output = arguments.output.as_ref().map(|path| check_output(path, None, content)).transpose()?;
    let mut graph = session.load(&arguments.formula.file, &arguments.formula.changes())?.graph;
    output.iter().try_for_each(|output| session.spare_inputs(output))?;
    let arena = Arc::new(Arena::default());
    let wanted = arguments.estimate.settings();
    let chosen = |graph: &ValidGraph| choose(&Composer { arena: &arena, library: &session.library, graph }, &wanted);
    let mut plan = chosen(&graph).map_err(|d| session.failure(d))?;
    if wanted.method.is_none() && plan.is_certified() {
        // A calibrated proof is for the file's own rays; points go by the rules.
        graph = graph.without_calibration();
        plan = chosen(&graph).map_err(|d| session.failure(d))?;
    }
    let composer = Composer { arena: &arena, library: &session.library, graph: &graph };
    plan.warnings.iter().for_each(|warning| session.warn(warning));
    let camera = camera_of(&composer, &plan);
    let exported = export(&composer, &plan, &camera, arguments.to.0).map_err(|error| failure(error, session))?;
    let bytes = match exported {
        Exported::Text(text) => text.into_bytes(),
        Exported::Words(words) => words.into_iter().flat_map(u32::to_le_bytes).collect(),
    };
    write_or_print(output.as_ref(), &bytes, out)
}

fn failure(error: ExportError, session: &Session) -> Failure {
    match error {
        ExportError::Formula(diagnostic) => session.failure(diagnostic),
        ExportError::NeedsRay(method) => usage(
            format!("the estimate `{}` needs the ray, and a distance function has only a point", method.name()),
            "choose one that needs no ray, such as `--de scalar`, `--de gradient` or `--de combined`",
        ),
        ExportError::Writer(text) => Failure::Work(message(
            &format!("the exported shader was refused, which is a bug in bulbfold:\n{text}"),
            "please report the formula file and this message",
        )),
    }
}
