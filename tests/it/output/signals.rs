//! Whatever ends the program, files under their final names are whole, and nothing else stays for long.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::{names, render};

use crate::support::{folder, program, stderr};

/// A picture that takes much longer than it takes to end it.
const LARGE: [&str; 14] = [
    "render",
    "--force",
    "mandelbox",
    "--size",
    "2000x1400",
    "--samples",
    "2",
    "--sampling",
    "full",
    "--precision",
    "f64",
    "--backend",
    "cpu",
    "-q",
];

/// Starts a large picture over an old one, and sends a signal once something new is in the folder.
fn interrupt(folder: &Path, signal: &str) {
    std::fs::write(folder.join("big.png"), "old").unwrap();
    let mut child = program(folder).args(LARGE).args(["--calibrate", "off", "-o", "big.png"]).spawn().unwrap();
    // The first file is the trial, which goes at once; the second is there until the end.
    let mut seen = 0;
    while seen < 20 {
        std::thread::sleep(Duration::from_millis(10));
        seen = if names(folder).len() > 1 { seen + 1 } else { 0 };
        assert!(child.try_wait().unwrap().is_none(), "the picture is too small to be interrupted");
    }
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    let status = child.wait().unwrap();
    assert_eq!(status.code(), None, "the signal itself ends the program, so that callers see it");
}

#[test]
fn signals_leave_the_old_picture_alone() {
    for signal in ["-INT", "-TERM", "-HUP", "-QUIT"] {
        let folder = folder();
        interrupt(folder.path(), signal);
        assert_eq!(names(folder.path()), ["big.png"], "{signal}");
        assert_eq!(std::fs::read(folder.path().join("big.png")).unwrap(), b"old");
    }
}

#[test]
fn the_next_run_sweeps_what_a_killed_one_left() {
    let folder = folder();
    interrupt(folder.path(), "-KILL");
    assert_eq!(names(folder.path()).len(), 2);
    assert_eq!(std::fs::read(folder.path().join("big.png")).unwrap(), b"old");
    assert!(render(folder.path(), "mandelbulb", "other.png").status.success());
    assert_eq!(names(folder.path()), ["big.png", "other.png"]);
}

#[test]
fn files_that_grow_too_large_are_an_error() {
    let folder = folder();
    std::fs::write(folder.path().join("a.png"), "old").unwrap();
    let script = "ulimit -f 8; exec \"$0\" \"$@\"";
    let mut command = Command::new("sh");
    command.current_dir(folder.path()).arg("-c").arg(script).arg(env!("CARGO_BIN_EXE_bulbfold"));
    let picture =
        ["render", "mandelbulb", "--size", "640x480", "--samples", "1", "--calibrate", "off", "--force", "-o", "a.png"];
    let output = command.args(picture).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("cannot write a.png"), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["a.png"]);
    assert_eq!(std::fs::read(folder.path().join("a.png")).unwrap(), b"old");
}

/// An ignored signal, as `nohup` leaves it, stays ignored.
#[test]
fn who_ignores_hangups_goes_on_ignoring_them() {
    let folder = folder();
    let script = "trap '' HUP; \"$0\" \"$@\" & sleep 0.3; kill -HUP $!; wait $!";
    let mut command = Command::new("sh");
    command.current_dir(folder.path()).arg("-c").arg(script).arg(env!("CARGO_BIN_EXE_bulbfold"));
    let picture = ["render", "mandelbulb", "--size", "1600x1200", "--samples", "2", "--backend", "cpu", "-o", "a.png"];
    let output = command.args(picture).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["a.png"]);
}
