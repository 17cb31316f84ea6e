//! Where commands write, looked at before any work is done.

use std::ffi::OsStr;
use std::io::{IsTerminal, Write};
use std::path::Path;

use bulbfold::files::Target;

use super::{Failure, Outcome, Session, message, usage};

/// What an output holds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Content {
    /// Text, which a terminal may show.
    Text,
    /// Bytes that would upset a terminal.
    Bytes,
}

/// Refuses an output that could not be written in the end, before any work is done. A file's name must have the ending; names of
/// pipes and devices say nothing.
pub fn check_output(path: &Path, extension: Option<&str>, content: Content) -> Result<Target, Failure> {
    let shown = path.display();
    if path.is_dir() {
        return Err(usage(format!("cannot write {shown}: it is a folder"), "give the name of a file: -o FILE"));
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(usage(format!("cannot write {shown}: there is no folder {}", folder.display()), "create it first"));
    }
    let target = Target::of(path)
        .map_err(|error| usage(format!("cannot write {shown}: {error}"), "choose another name with -o"))?;
    if let Some(wanted) = extension
        && !target.is_stream()
        && !path.extension().is_some_and(|found| found.eq_ignore_ascii_case(wanted))
    {
        return Err(usage(format!("the output {shown} must end in .{wanted}"), &format!("write `-o NAME.{wanted}`")));
    }
    if content == Content::Bytes && target.is_stdout() && std::io::stdout().is_terminal() {
        return Err(usage(
            "a terminal cannot show this output",
            "name a file with -o, or pass it to a program: `| PROGRAM`",
        ));
    }
    target.try_folder().map_err(|error| {
        usage(format!("cannot write into {}: {error}", folder.display()), "choose another folder with -o")
    })?;
    Ok(target)
}

/// Shows a picture or a page with the program that this machine has for it.
///
/// Errors: the message says that there is none.
pub fn opened(what: &OsStr) -> Result<(), String> {
    open::that_detached(what).map_err(|error| format!("cannot open {}: {error}", what.display()))
}

impl Session {
    /// Refuses a target that is one of the files that were read.
    pub fn spare_inputs(&self, target: &Target) -> Outcome {
        if self.library.inputs().iter().any(|input| target.is_file(input)) {
            return Err(spared(target));
        }
        Ok(())
    }

    /// Writes a file whole or not at all, but none of those that were read.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Outcome {
        let target = Target::of(path).map_err(|error| cannot_write(path, &error))?;
        self.spare_inputs(&target)?;
        write(&target, bytes)
    }
}

/// The failure of a target that is an input.
pub fn spared(target: &Target) -> Failure {
    let text = format!("{} is an input of this command and is not overwritten", target.path().display());
    usage(text, "choose another name with -o")
}

/// Refuses to write two things to stdout.
pub fn refuse_both(target: &Target, flag: &str) -> Outcome {
    match target.is_stdout() {
        true => Err(usage(format!("the output and `{flag}` would both go to stdout"), "name a file with -o")),
        false => Ok(()),
    }
}

/// Writes a target whole or not at all.
pub fn write(target: &Target, bytes: &[u8]) -> Outcome {
    target.write(bytes).map_err(|error| not_written(target, &error))
}

/// Writes a text to its target, or to stdout where there is none.
pub fn write_or_print(target: Option<&Target>, bytes: &[u8], out: &mut dyn Write) -> Outcome {
    match target {
        Some(target) => write(target, bytes),
        None => Ok(out.write_all(bytes)?),
    }
}

/// The failure of a target that could not be written. A closed stdout is no failure.
pub fn not_written(target: &Target, error: &std::io::Error) -> Failure {
    match target.is_stdout() && error.kind() == std::io::ErrorKind::BrokenPipe {
        true => Failure::ClosedPipe,
        false => cannot_write(target.path(), error),
    }
}

/// The failure of a file that could not be written.
pub fn cannot_write(path: &Path, error: &std::io::Error) -> Failure {
    Failure::Work(message(&format!("cannot write {}: {error}", path.display()), ""))
}
