//! `bulbfold test`: runs the tests that formula files hold, as `cargo test` does for code.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::{Failure, Outcome, Session, message};

/// Arguments of `test`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold test flower.ron
  bulbfold test formulas/fractals my_steps")]
pub struct Arguments {
    /// Formula files, step files and folders of them
    #[arg(required = true)]
    paths: Vec<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    let report = bulbfold::check::run_paths(&mut session.library, &arguments.paths, out)?;
    match report.failed {
        0 => Ok(()),
        count => Err(Failure::Work(message(&format!("{count} tests failed"), ""))),
    }
}
