//! Files as users see them: what is written is whole or absent, what is read is bounded, and nothing else is harmed. The built
//! program runs in a fresh folder.

mod input;
mod interrupted;
mod refused;
mod resume;
mod signals;
mod stdout;
mod target;

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output};

use crate::support::program;

/// Arguments of a small picture of a built-in fractal.
const SMALL: [&str; 8] = ["--size", "32x18", "--samples", "1", "--calibrate", "off", "--backend", "cpu"];

/// Renders a small picture of a formula into a file.
fn render(folder: &Path, formula: impl AsRef<OsStr>, output: impl AsRef<OsStr>) -> Output {
    program(folder)
        .arg("render")
        .arg(formula)
        .args(SMALL)
        .args(["-q", "--force", "-o"])
        .arg(output)
        .output()
        .expect("it starts")
}

/// Everything in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Width and height of a whole PNG; `None` where it is none.
fn png_size(bytes: &[u8]) -> Option<(u32, u32)> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().ok()?;
    let mut pixels = vec![0; reader.output_buffer_size()?];
    let info = reader.next_frame(&mut pixels).ok()?;
    reader.finish().ok()?;
    Some((info.width, info.height))
}

fn make_pipe(path: &Path) {
    let made = Command::new("mkfifo").arg(path).status().expect("mkfifo is there");
    assert!(made.success());
}
