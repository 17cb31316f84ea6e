//! Commands that write many files, ended at random moments: every file under a final name is whole, and the next run leaves nothing
//! else. `BULBFOLD_INTERRUPTS=100` tries so many moments of each.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use super::{names, png_size};

use crate::support::{bulbfold, folder, program, stderr};

/// A formula whose calibration is quick.
const FORMULA: &str = "(nodes: { \"a\": bulb_power(power: 5) }, escape_radius: 4.0, max_iterations: 4)\n";

/// Runs a command to its end, then ends it at moments of that time, by SIGKILL and by SIGTERM in turn.
fn interrupt(arguments: &[&str], is_whole: impl Fn(&Path, &str) -> bool) {
    let count = std::env::var("BULBFOLD_INTERRUPTS").ok().and_then(|n| n.parse().ok()).unwrap_or(6_u32);
    let folder = folder();
    let prepare = || std::fs::write(folder.path().join("a.ron"), FORMULA).unwrap();
    prepare();
    let start = Instant::now();
    let run = bulbfold(folder.path(), arguments);
    assert!(run.status.success(), "{arguments:?}: {}", stderr(&run));
    let whole = start.elapsed();
    let expected = names(folder.path());
    for i in 0..count {
        prepare();
        // Moments without order, spread evenly (golden ratio).
        let moment = whole.mul_f64((0.618_034 * f64::from(i + 1)).fract());
        // What a SIGKILL before has left stays until a run has come as far as to sweep it.
        let left = litter(folder.path());
        let mut child = program(folder.path()).args(arguments).stdout(std::process::Stdio::null()).spawn().unwrap();
        std::thread::sleep(moment.max(Duration::from_millis(1)));
        let signal = if i % 2 == 0 { "-KILL" } else { "-TERM" };
        let _ = Command::new("kill").args([signal, &child.id().to_string()]).status();
        child.wait().unwrap();
        let when = format!("{arguments:?}, {signal} after {moment:?}");
        check(folder.path(), &is_whole, &when);
        let new: Vec<String> = litter(folder.path()).into_iter().filter(|name| !left.contains(name)).collect();
        assert!(signal == "-KILL" || new.is_empty(), "{when}: {new:?} stay");
    }
    prepare();
    let run = bulbfold(folder.path(), arguments);
    assert!(run.status.success(), "{arguments:?}: {}", stderr(&run));
    check(folder.path(), &is_whole, "the next run");
    assert_eq!(litter(folder.path()), Vec::<String>::new());
    assert_eq!(names(folder.path()), expected);
}

/// Looks at all files of a folder and of those in it, but for temporary ones.
fn check(folder: &Path, is_whole: &impl Fn(&Path, &str) -> bool, when: &str) {
    for name in names(folder) {
        let path = folder.join(&name);
        match (path.is_dir(), name.starts_with(".bulbfold-")) {
            (true, _) => check(&path, is_whole, when),
            (_, true) => {}
            _ => assert!(is_whole(&path, &name), "{when}: {name} is not whole"),
        }
    }
}

/// Temporary files of a folder and of those in it.
fn litter(folder: &Path) -> Vec<String> {
    let of_name = |name: String| match folder.join(&name) {
        path if path.is_dir() => litter(&path),
        _ => Vec::from_iter(name.starts_with(".bulbfold-").then_some(name)),
    };
    names(folder).into_iter().flat_map(of_name).collect()
}

fn is_picture(path: &Path, name: &str) -> bool {
    let bytes = std::fs::read(path).unwrap();
    match name.rsplit('.').next() {
        Some("png") => png_size(&bytes).is_some(),
        Some("jpg") => bytes.starts_with(&[0xff, 0xd8]) && bytes.ends_with(&[0xff, 0xd9]),
        Some("html") => bytes.trim_ascii_end().ends_with(b"</html>"),
        _ => bytes == FORMULA.as_bytes(),
    }
}

#[test]
fn pictures() {
    interrupt(&["render", "a.ron", "--size", "800x600", "--calibrate", "off", "--backend", "cpu", "-q"], is_picture);
}

#[test]
fn animations() {
    let sweep = ["--sweep", "turn=0..90", "--frames", "12", "-o", "f_%02d.png", "-q"];
    let small = ["render", "a.ron", "--size", "96x64", "--calibrate", "off", "--backend", "cpu"];
    interrupt(&[&small[..], &sweep].concat(), is_picture);
}

#[cfg(feature = "chart")]
#[test]
fn galleries() {
    let files = ["gallery", "a.ron", "mandelbulb", "menger", "mandelbox", "-o", "pages", "--again", "-q"];
    let small = ["--size", "64x48", "--calibrate", "off", "--backend", "cpu"];
    interrupt(&[&files[..], &small].concat(), is_picture);
}

/// The formula is as it was, or it carries the whole outcome.
#[test]
fn calibrations() {
    interrupt(&["calibrate", "a.ron", "--write", "--size", "64x48"], |path, _| {
        let text = std::fs::read_to_string(path).unwrap();
        let loads =
            || program(path.parent().unwrap()).args(["compile", "a.ron", "--emit", "graph", "-o", "-"]).output();
        text == FORMULA || text.contains("estimate") && loads().unwrap().status.success()
    });
}
