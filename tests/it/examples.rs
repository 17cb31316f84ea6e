//! The examples, run as they stand.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs an example in a folder; `cargo test` has built it.
fn example(name: &str, arguments: &[&str], folder: &Path) -> Output {
    let built = Path::new(env!("CARGO_BIN_EXE_bulbfold")).parent().unwrap().join("examples").join(name);
    assert!(built.exists(), "{} is missing: cargo build --release --examples", built.display());
    let output = Command::new(built).args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn a_picture_is_that_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    example("render", &["mandelbulb", "example.png"], folder.path());
    let mut command = Command::new(env!("CARGO_BIN_EXE_bulbfold"));
    command.args(["render", "mandelbulb", "-q", "-o", "command.png"]).current_dir(folder.path());
    assert!(command.status().unwrap().success());
    let read = |name: &str| crate::support::pixels(&folder.path().join(name));
    assert!(read("example.png") == read("command.png"));
    // What the reader counts: from a name to a picture in at most 12 lines.
    let source = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/render.rs")).unwrap();
    let lines = source.lines().filter(|line| !line.trim().is_empty() && !line.starts_with("//")).count();
    assert!(lines <= 12, "{lines} lines");
}

#[test]
fn an_animation_compiles_twice_at_most() {
    let folder = tempfile::tempdir().unwrap();
    let output = example("turntable", &["menger", "3"], folder.path());
    let frames: Vec<PathBuf> = (0..3).map(|i| folder.path().join(format!("turn_000{i}.png"))).collect();
    let bytes: Vec<Vec<u8>> = frames.iter().map(|path| std::fs::read(path).unwrap()).collect();
    assert!(bytes[0] != bytes[1] && bytes[1] != bytes[2]);
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("3 frames"));
}

#[test]
fn a_step_of_your_own_renders() {
    let folder = tempfile::tempdir().unwrap();
    example("own_step", &[], folder.path());
    assert!(std::fs::metadata(folder.path().join("leaning.png")).unwrap().len() > 10_000);
}

#[test]
fn distances_are_those_of_the_formula() {
    let output = example("distances", &["mandelbulb", "4"], &std::env::temp_dir());
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().count(), 4 * 4 * 4 + 1);
    let formula = bulbfold::check::Formula::builtin("mandelbulb").unwrap();
    for line in text.lines().skip(1).step_by(7) {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        assert_eq!(numbers[3], formula.chosen_estimate([numbers[0], numbers[1], numbers[2]]), "{line}");
    }
}
