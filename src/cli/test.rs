//! `bulbfold test`: runs the tests that formula files hold, as `cargo test` does for code.

use std::io::Write;
use std::path::PathBuf;

use bulbfold::check::{Options, REQUIRE_GPU, run_paths_with};
use clap::Args;

use super::backend::tried_adapters;
use super::{Failure, Outcome, Session, message, usage};

/// Arguments of `test`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold test flower.ron
  bulbfold test formulas/fractals my_steps
  bulbfold test formulas --filter agrees_on_backends --no-gpu")]
pub struct Arguments {
    /// Formula files, step files and folders of them
    #[arg(required = true)]
    paths: Vec<PathBuf>,
    /// Run only the tests whose names contain this
    #[arg(long, value_name = "TEXT")]
    filter: Option<String>,
    /// Leave out the GPU
    #[arg(long)]
    no_gpu: bool,
}

/// Runs the command. A line is written as each test ends.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    if let Some(missing) = arguments.paths.iter().find(|path| !path.exists()) {
        return Err(usage(format!("there is no file or folder {}", missing.display()), ""));
    }
    // Where a GPU is required a driver that fails is no reason to leave it out.
    let is_required = std::env::var_os(REQUIRE_GPU).is_some();
    let broken = if arguments.no_gpu || is_required { None } else { tried_adapters().1 };
    if let Some(error) = &broken {
        session.warn(&format!("{error}; the GPU is left out"));
    }
    let options = Options { filter: arguments.filter.clone(), gpu: !arguments.no_gpu && broken.is_none() };
    let mut written = Ok(());
    let report = run_paths_with(&mut session.library, &arguments.paths, &options, &mut |outcome| {
        if written.is_ok() {
            written = writeln!(out, "{outcome}").and_then(|()| out.flush());
        }
    });
    written?;
    report.print_end(out)?;
    match report.failed() {
        0 => Ok(()),
        1 => Err(Failure::Work(message("a test failed", ""))),
        count => Err(Failure::Work(message(&format!("{count} tests failed"), ""))),
    }
}
