//! `bulbfold compile`: each stage of the way from a formula to a kernel, in text.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use bulbfold::compose::Composer;
use bulbfold::diag::Sources;
use bulbfold::expr::{Arena, print};
use bulbfold::graph::{ValidGraph, print as graph_print};
use bulbfold::kernel::{Kernel, listing, wgsl};
use bulbfold::render::{RenderSettings, compose_pipeline};
use clap::{Args, ValueEnum};

use super::arguments::{EstimateArgs, FormulaArgs};
use super::output::{Content, check_output, write_or_print};
use super::{Failure, Outcome, Session, cost, message};

/// Arguments of `compile`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold compile mandelbulb --emit wgsl
  bulbfold compile mandelbox --emit expr --de gradient
  bulbfold compile box_bulb --emit cost
  bulbfold compile hybrid.ron --emit dot | dot -Tsvg > hybrid.svg")]
pub struct Arguments {
    #[command(flatten)]
    formula: FormulaArgs,
    /// The stage to print
    #[arg(long, value_enum)]
    emit: Stage,
    /// Write to this file instead of stdout, which is also `-`
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// All kernels of a picture instead of only the march
    #[arg(long)]
    all: bool,
    #[command(flatten)]
    estimate: EstimateArgs,
}

/// A stage of the compiler.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum Stage {
    /// The nodes of the graph.
    Graph,
    /// The expressions of each function.
    Expr,
    /// The shader, validated.
    Wgsl,
    /// The instructions of the CPU.
    Tape,
    /// The graph in the DOT language of Graphviz.
    Dot,
    /// What every step costs: operations by kind, for value and derivative.
    Cost,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let target = arguments.output.as_ref().map(|path| check_output(path, None, Content::Text)).transpose()?;
    let graph = session.load(&arguments.formula.file, &arguments.formula.changes())?.graph;
    target.iter().try_for_each(|target| session.spare_inputs(target))?;
    let text = match arguments.emit {
        Stage::Graph => graph_print::listing_with_look(&graph),
        Stage::Dot => graph_print::dot(&graph),
        _ => kernels(arguments, session, &graph)?,
    };
    write_or_print(target.as_ref(), text.as_bytes(), out)
}

fn kernels(arguments: &Arguments, session: &Session, graph: &ValidGraph) -> Result<String, Failure> {
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &session.library, graph };
    let settings = RenderSettings { estimate: arguments.estimate.settings(), ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).map_err(|diagnostic| session.failure(diagnostic))?;
    for warning in &pipeline.plan.warnings {
        session.warn(warning);
    }
    if arguments.emit == Stage::Cost {
        return cost::table(&composer, &pipeline).map_err(|diagnostic| session.failure(diagnostic));
    }
    let mut text = String::new();
    for (name, kernel) in pipeline.kernels().into_iter().filter(|(name, _)| arguments.all || *name == "march") {
        if arguments.all {
            text.push_str(&format!("// kernel {name}\n"));
        }
        text.push_str(&print_kernel(arguments.emit, &arena, &session.library.sources, kernel)?);
    }
    Ok(text)
}

fn print_kernel(stage: Stage, arena: &Arena, sources: &Sources, kernel: &Kernel) -> Result<String, Failure> {
    Ok(match stage {
        Stage::Wgsl => {
            let text = wgsl::write(arena, kernel);
            wgsl::validate(&text).map_err(|error| Failure::Work(message(&error.to_string(), "")))?;
            text
        }
        Stage::Tape => listing::listing(arena, kernel),
        _ => kernel.functions().into_iter().map(|function| print::listing(arena, function, sources) + "\n").collect(),
    })
}
