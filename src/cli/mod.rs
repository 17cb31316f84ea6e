//! The command line: one file a command.
//!
//! In come arguments; out goes a picture, a text or JSON on stdout, and talk on stderr. Every command is a function
//! from its arguments to a [`Outcome`]; [`main`] alone turns that into an exit code: 0 done, 1 the work failed, 2 bad
//! usage or input. A reader of stdout that goes away ends a command quietly.

mod again;
mod animate;
mod arguments;
mod audit;
mod backend;
mod bench;
#[cfg(feature = "chart")]
mod breed;
mod calibrate;
mod calibrate_write;
mod calibration;
mod camera;
#[cfg(feature = "chart")]
mod chart;
mod check;
mod clean;
mod compile;
mod config;
#[cfg(feature = "chart")]
mod contact;
mod cost;
mod docs;
mod doctor;
#[cfg(feature = "gpu")]
mod driver;
mod encode;
mod explain;
mod export;
mod farm;
mod film;
mod flicker;
mod fly;
mod frames;
#[cfg(feature = "chart")]
mod gallery;
#[cfg(feature = "chart")]
mod gallery_page;
mod import;
mod job;
mod join;
mod kept;
mod list;
#[cfg(feature = "chart")]
mod look;
mod manifest;
mod matter;
mod matter_pages;
mod mesh;
mod moments;
mod new;
mod notation;
mod observer;
mod output;
mod page;
#[cfg(feature = "chart")]
mod path;
mod picture_args;
mod picture_key;
mod pictures;
mod points;
mod preview;
mod probe;
mod progress;
mod range;
mod render;
mod session;
#[cfg(feature = "chart")]
mod sheet;
mod shell;
mod show;
mod sizes;
mod slices;
mod solid;
mod stats;
mod sweep;
mod taken;
mod test;
mod truth;
mod truth_table;
#[cfg(feature = "chart")]
mod vary;
mod vdb;
mod version;
#[cfg(feature = "chart")]
mod view;
mod watch;

use std::io::{self, BufWriter, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

pub use session::Session;

/// Composes hybrid 3D fractals from small formula steps and renders them.
#[derive(Parser, Debug)]
#[command(name = "bulbfold", version, long_version = &version::LONG[..], max_term_width = 100, after_help = EXAMPLES)]
struct Cli {
    /// Also read the steps (*.rhai) of this folder; may be given several times.
    #[arg(long = "steps", value_name = "DIR", global = true, env = "BULBFOLD_STEPS", value_delimiter = DELIMITER)]
    step_folders: Vec<PathBuf>,
    /// Also read steps beside a formula that belong to another user; they are scripts.
    #[arg(long, global = true)]
    trust: bool,
    /// Print no progress and no message on success.
    #[arg(short, long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

/// What stands between the folders of a list of them.
const DELIMITER: char = if cfg!(windows) { ';' } else { ':' };

const EXAMPLES: &str = "\
Examples:
  bulbfold list                                what there is
  bulbfold render mandelbulb -o bulb.png       a built-in fractal
  bulbfold new flower && bulbfold render flower.ron

Settings for all commands stand in config.ron: docs/settings.md.
Exit codes: 0 done, 1 the work failed, 2 bad usage or input.";

#[derive(Subcommand, Debug)]
enum Command {
    /// Render a picture.
    Render(Box<render::Arguments>),
    /// Render a film: numbered pictures, or one file.
    Animate(Box<animate::Arguments>),
    /// Write a picture or a film as a job for many machines.
    Job(Box<job::Arguments>),
    /// Join the parts of a job into its picture or film.
    Join(join::Arguments),
    /// Print a stage of the compiler: graph, expressions, WGSL or CPU tape.
    Compile(compile::Arguments),
    /// Run the tests in formula and step files, on every back end.
    Test(test::Arguments),
    /// Search a formula or step for faults.
    Check(check::Arguments),
    /// Measure which estimate is the cheapest that keeps an error budget, and say why.
    Calibrate(calibrate::Arguments),
    /// Measure how fast a formula is here: by back end, precision, method and number of threads.
    Bench(bench::Arguments),
    /// March rays by brute force and compare the estimate with that.
    Truth(truth::Arguments),
    /// Print what the formula says at points or along rays, as text or JSON lines.
    Probe(probe::Arguments),
    /// Draw what every distance estimate costs and how right it is.
    #[cfg(feature = "chart")]
    Chart(chart::Arguments),
    /// Render a formula whenever its file is saved, in the terminal and on a page of this machine.
    Watch(Box<watch::Arguments>),
    /// Find a flight through a formula, and write it as a file.
    Fly(Box<fly::Arguments>),
    /// Draw the way of a film's camera, and write it for other programs: glTF, USD, JSON.
    #[cfg(feature = "chart")]
    Path(Box<path::Arguments>),
    /// Find views that are worth it, and show them on a contact sheet.
    #[cfg(feature = "chart")]
    Look(look::Arguments),
    /// Show formulas, presets and values of parameters side by side on a contact sheet.
    #[cfg(feature = "chart")]
    Sheet(sheet::Arguments),
    /// Make variations of a formula, and show those that are worth it.
    #[cfg(feature = "chart")]
    Vary(vary::Arguments),
    /// Make formulas of two others, and show those that are worth it.
    #[cfg(feature = "chart")]
    Breed(breed::Arguments),
    /// List steps, fractals, scenes, scripts, palettes and materials.
    List(list::Arguments),
    /// Explain a step, a fractal, a palette or a material.
    Explain(explain::Arguments),
    /// Print how a picture was made.
    Show(show::Arguments),
    /// Write a commented formula file to start from.
    New(new::Arguments),
    /// Write a formula's distance estimate for other programs: WGSL, GLSL, Shadertoy, Fragmentarium, HLSL, MSL, SPIR-V.
    Export(export::Arguments),
    /// Write a fractal's surface as triangles: PLY, OBJ, STL, glTF or 3MF.
    Mesh(Box<mesh::Arguments>),
    /// Write a fractal's body as a volume: pictures of slices, numbers, OpenVDB.
    Slices(Box<slices::Arguments>),
    /// Make a graph file from settings of Mandelbulber, Mandelbulb3D or Fragmentarium.
    Import(import::Arguments),
    /// March sampled rays of a view with proofs, and report where its estimate was wrong.
    Audit(audit::Arguments),
    /// Render all fractals to an HTML page with search, or to thumbnails.
    #[cfg(feature = "chart")]
    Gallery(gallery::Arguments),
    /// Print a shell's script for completions: bash, zsh or fish.
    Completions(shell::CompletionArgs),
    /// Write manual pages.
    Man(shell::ManArgs),
    /// Check this machine's back ends against each other.
    Doctor(doctor::Arguments),
    /// Write the reference of steps, fractals, materials, palettes and operators.
    Docs(docs::Arguments),
    /// Open a GPU and let it compute, in a process that may crash.
    #[cfg(feature = "gpu")]
    #[command(name = driver::COMMAND, hide = true)]
    TryDriver(driver::Arguments),
}

/// Why a command did not do its work. The texts end without a newline unless they are rendered diagnostics.
#[derive(Debug)]
pub enum Failure {
    /// Bad usage or input: exit code 2.
    Usage(String),
    /// The work failed: exit code 1.
    Work(String),
    /// Whoever read stdout has gone; not an error.
    ClosedPipe,
}

impl Failure {
    /// What is told; nothing of a reader that has gone.
    pub fn text(&self) -> &str {
        match self {
            Failure::Usage(text) | Failure::Work(text) => text,
            Failure::ClosedPipe => "",
        }
    }
}

/// What a command returns.
pub type Outcome = Result<(), Failure>;

impl From<io::Error> for Failure {
    /// An error of stdout.
    fn from(error: io::Error) -> Failure {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Failure::ClosedPipe,
            _ => Failure::Work(message(&format!("cannot write to stdout: {error}"), "")),
        }
    }
}

/// An error message in the form of diagnostics, with help where there is any.
pub fn message(text: &str, help: &str) -> String {
    let text = bulbfold::diag::printable(text);
    match help {
        "" => format!("error: {text}"),
        help => format!("error: {text}\nhelp: {}", bulbfold::diag::printable(help)),
    }
}

/// A [`Failure::Usage`] with help where there is any.
pub fn usage(text: impl AsRef<str>, help: &str) -> Failure {
    Failure::Usage(message(text.as_ref(), help))
}

/// Runs the program.
pub fn main() -> ExitCode {
    clap_complete::CompleteEnv::with_factory(Cli::command).var(shell::ASKS).complete();
    let program = match config::Config::read() {
        Ok(config) => config.apply(Cli::command()),
        Err(failure) => {
            let _ = writeln!(io::stderr(), "{}", failure.text().trim_end());
            return ExitCode::from(2);
        }
    };
    let matches = program.get_matches();
    let mut cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    if let (Command::Render(arguments), Some((_, given))) = (&mut cli.command, matches.subcommand()) {
        arguments.note_given(given);
    }
    bulbfold::files::clean_up_on_signals();
    let mut out = clean::Clean::new(BufWriter::new(io::stdout().lock()));
    let outcome = run(&mut cli, &mut out).and_then(|()| out.flush().map_err(Failure::from));
    let (text, code) = match outcome {
        Ok(()) | Err(Failure::ClosedPipe) => return ExitCode::SUCCESS,
        Err(Failure::Usage(text)) => (text, 2),
        Err(Failure::Work(text)) => {
            // What was found before the work failed is still worth reading.
            let _ = out.flush();
            (text, 1)
        }
    };
    let _ = writeln!(io::stderr(), "{}", text.trim_end());
    ExitCode::from(code)
}

fn run(cli: &mut Cli, out: &mut dyn Write) -> Outcome {
    let session = || Session::new(&cli.step_folders, cli.trust, cli.quiet);
    match &mut cli.command {
        Command::Render(arguments) => render::run(arguments, &mut session()?, out),
        Command::Animate(arguments) => animate::run(arguments, &mut session()?, out),
        Command::Watch(arguments) => watch::run(arguments, session()?, out),
        Command::Job(arguments) => job::run(arguments, &mut session()?),
        Command::Join(arguments) => join::run(arguments, &mut session()?),
        Command::Compile(arguments) => compile::run(arguments, &mut session()?, out),
        Command::Test(arguments) => test::run(arguments, &mut session()?, out),
        Command::Check(arguments) => check::run(arguments, &mut session()?, out),
        Command::Calibrate(arguments) => calibrate::run(arguments, &mut session()?, out),
        Command::Bench(arguments) => bench::run(arguments, &mut session()?, out),
        Command::Truth(arguments) => truth::run(arguments, &mut session()?, out),
        Command::Probe(arguments) => probe::run(arguments, &mut session()?, out),
        #[cfg(feature = "chart")]
        Command::Chart(arguments) => chart::run(arguments, &mut session()?),
        Command::Fly(arguments) => fly::run(arguments, &mut session()?),
        #[cfg(feature = "chart")]
        Command::Path(arguments) => path::run(arguments, &mut session()?, out),
        #[cfg(feature = "chart")]
        Command::Look(arguments) => look::run(arguments, &mut session()?, out),
        #[cfg(feature = "chart")]
        Command::Sheet(arguments) => sheet::run(arguments, &mut session()?, out),
        #[cfg(feature = "chart")]
        Command::Vary(arguments) => vary::run(arguments, &mut session()?, out),
        #[cfg(feature = "chart")]
        Command::Breed(arguments) => breed::run(arguments, &mut session()?, out),
        Command::List(arguments) => list::run(arguments, &mut session()?, out),
        Command::Explain(arguments) => explain::run(arguments, &mut session()?, out),
        Command::Show(arguments) => show::run(arguments, out),
        Command::New(arguments) => new::run(arguments),
        Command::Export(arguments) => export::run(arguments, &mut session()?, out),
        Command::Mesh(arguments) => mesh::run(arguments, &mut session()?, out),
        Command::Slices(arguments) => slices::run(arguments, &mut session()?, out),
        Command::Import(arguments) => import::run(arguments, &mut session()?),
        Command::Audit(arguments) => audit::run(arguments, &mut session()?, out),
        #[cfg(feature = "chart")]
        Command::Gallery(arguments) => gallery::run(arguments, &mut session()?, out),
        Command::Completions(arguments) => shell::completions(arguments, out),
        Command::Man(arguments) => shell::man(arguments, Cli::command()),
        Command::Doctor(arguments) => doctor::run(arguments, &mut session()?, out),
        Command::Docs(arguments) => docs::run(arguments, &mut session()?, out),
        #[cfg(feature = "gpu")]
        Command::TryDriver(arguments) => driver::run(arguments, out),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::Cli;

    #[test]
    fn arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_has_help_and_examples() {
        for command in Cli::command().get_subcommands() {
            assert!(command.get_about().is_some(), "{} has no help", command.get_name());
            let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(examples.matches("bulbfold").count() >= 2, "{} needs two examples", command.get_name());
            for argument in command.get_arguments().filter(|a| a.get_id() != "help") {
                assert!(argument.get_help().is_some(), "{} {} has no help", command.get_name(), argument.get_id());
            }
        }
    }
}
