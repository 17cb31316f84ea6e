//! What shells want: completions that know fractals, presets and parameters, and manual pages.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::PathBuf;

use bulbfold::diag::Diagnostics;
use bulbfold::formula::embedded;
use bulbfold::formula::library::Library;
use bulbfold::graph::ValidGraph;
use bulbfold::load::load;
use clap::{Args, Command, ValueEnum};
use clap_complete::engine::CompletionCandidate;
use clap_complete::env::{Bash, EnvCompleter, Fish, Zsh};

use super::output::cannot_write;
use super::{Failure, Outcome};

/// Arguments of `completions`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  echo 'source <(bulbfold completions bash)' >> ~/.bashrc
  bulbfold completions fish > ~/.config/fish/completions/bulbfold.fish

They ask the program: names of fractals, presets and parameters are those that it has.")]
pub struct CompletionArgs {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// A shell.
#[derive(ValueEnum, Clone, Copy, Debug)]
enum Shell {
    /// Bash
    Bash,
    /// Zsh
    Zsh,
    /// Fish
    Fish,
}

/// The variable by which a shell asks for completions.
pub const ASKS: &str = "BULBFOLD_COMPLETE";

/// Prints a shell's script.
pub fn completions(arguments: &CompletionArgs, out: &mut dyn Write) -> Outcome {
    let shell: &dyn EnvCompleter = match arguments.shell {
        Shell::Bash => &Bash,
        Shell::Zsh => &Zsh,
        Shell::Fish => &Fish,
    };
    let mut script = Vec::new();
    shell.write_registration(ASKS, "bulbfold", "bulbfold", "bulbfold", &mut script)?;
    Ok(out.write_all(&script)?)
}

/// Arguments of `man`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold man -o man && man man/bulbfold-render.1
  bulbfold man -o ~/.local/share/man/man1")]
pub struct ManArgs {
    /// The folder to write into
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Writes a manual page of the program and of each command.
pub fn man(arguments: &ManArgs, program: Command) -> Outcome {
    let folder = &arguments.output;
    fs::create_dir_all(folder).map_err(|error| cannot_write(folder, &error))?;
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let mut pages = vec![("bulbfold".to_string(), program.clone())];
    for command in program.get_subcommands().filter(|command| !command.is_hide_set()) {
        pages.push((format!("bulbfold-{}", command.get_name()), command.clone()));
    }
    for (name, command) in pages {
        let mut page = Vec::new();
        clap_mangen::Man::new(command).render(&mut page)?;
        let path = folder.join(format!("{name}.1"));
        bulbfold::files::write(&path, &page).map_err(|error| cannot_write(&path, &error))?;
    }
    super::session::talk(&format!("wrote the manual pages into {}", folder.display()));
    Ok(())
}

/// Built-in formulas that begin like this, and files.
pub fn formulas(current: &OsStr) -> Vec<CompletionCandidate> {
    let begun = current.to_string_lossy();
    let names = [embedded::FRACTALS, embedded::SCENES, embedded::SCRIPTS].into_iter().flatten().map(|(name, _)| *name);
    let mut found: Vec<CompletionCandidate> =
        names.filter(|name| name.starts_with(&*begun)).map(CompletionCandidate::new).collect();
    let files = clap_complete::engine::PathCompleter::any();
    found.extend(clap_complete::engine::ValueCompleter::complete(&files, current));
    found
}

/// Presets of the formula on the command line.
pub fn presets(current: &OsStr) -> Vec<CompletionCandidate> {
    let begun = current.to_string_lossy();
    let graph = graph();
    let presets = graph.iter().flat_map(|graph| &graph.presets).filter(|preset| preset.name.starts_with(&*begun));
    presets.map(|preset| CompletionCandidate::new(&preset.name).help(Some(preset.help.clone().into()))).collect()
}

/// Parameters of the formula on the command line, each with `=`.
pub fn parameters(current: &OsStr) -> Vec<CompletionCandidate> {
    let begun = current.to_string_lossy();
    let graph = graph();
    let params = graph.iter().flat_map(|graph| &graph.params).filter(|param| param.name.starts_with(&*begun));
    params.map(|param| CompletionCandidate::new(format!("{}=", param.name))).collect()
}

/// The formula on the command line that is being completed.
fn graph() -> Option<ValidGraph> {
    let words: Vec<String> = std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    // Behind `--` are the words so far: the program, the command, and then the formula somewhere.
    let begun = words.iter().position(|word| word == "--")? + 3;
    let mut library = Library::builtin();
    words.iter().skip(begun).filter(|word| !word.starts_with('-') && !word.is_empty()).find_map(|word| {
        let mut messages = Diagnostics::default();
        load(&mut library, word, &[], &mut messages).map(|loaded| loaded.graph)
    })
}

impl From<clap::Error> for Failure {
    fn from(error: clap::Error) -> Failure {
        Failure::Usage(error.to_string())
    }
}
