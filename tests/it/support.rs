//! What many modules of tests need: the program in a folder, what it said, formulas, pictures.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use bulbfold::check::Formula;

/// The program in a folder, with no cache, no settings, no colour and no input.
pub fn program(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bulbfold"));
    // Without this Mesa's layer that chooses devices asks a display that is not there.
    command.current_dir(folder).env("NODEVICE_SELECT", "1");
    command.env("NO_COLOR", "1").env("BULBFOLD_CACHE", "").env("BULBFOLD_CONFIG", "").stdin(Stdio::null());
    command
}

/// What a run of [`program`] left.
pub fn bulbfold(folder: &Path, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Output {
    program(folder).args(arguments).output().expect("the program starts")
}

/// What was written to stdout, as text.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// What was written to stderr, as text.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Stdout of a run that must succeed.
pub fn success(output: &Output) -> String {
    assert!(output.status.success(), "{}{}", stdout(output), stderr(output));
    stdout(output)
}

/// A fresh folder, which goes with the value.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder can be made")
}

/// A fresh folder with these files: names and texts.
pub fn folder_with(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = folder();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
    folder
}

/// The formula of a graph file's text.
pub fn formula(text: &str) -> Formula {
    Formula::from_ron(text).unwrap_or_else(|error| panic!("{text}\n{error}"))
}

/// The bytes of a PNG's pixels, row by row.
pub fn pixels(path: &Path) -> Vec<u8> {
    let file = std::fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("it fits")];
    reader.next_frame(&mut bytes).expect("a whole PNG");
    bytes
}
