//! What people expect of a program in a terminal: many files at once, pipes, settings, help in groups.

use std::io::Write;
use std::path::Path;
use std::process::Stdio;

use crate::support::{bulbfold, folder, folder_with, program, stderr, success};

const SPHERE: &str = "(nodes: { \"square\": quaternion_square() }, output: \"square\", max_iterations: 4)";
const SMALL: [&str; 7] = ["--size", "16x12", "--samples", "1", "--calibrate", "off", "--quiet"];

fn render(folder: &Path, arguments: &[&str]) -> std::process::Output {
    bulbfold(folder, [&["render"], arguments, &SMALL[..]].concat())
}

/// Columns and rows of a PNG.
fn size(path: &Path) -> [u32; 2] {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    [16, 20].map(|at| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()))
}

#[test]
fn many_formulas_have_a_picture_each() {
    let folder =
        folder_with(&[("a1.ron", SPHERE), ("a2.ron", SPHERE), ("b.ron", SPHERE), ("broken.ron", "(nodes: 1)")]);
    let there = |names: &[&str]| names.iter().all(|name| folder.path().join(name).is_file());
    success(&render(folder.path(), &["a1.ron", "mandelbulb", "-o", "out/"]));
    assert!(there(&["out/a1.png", "out/mandelbulb.png"]));
    // No shell has expanded the pattern.
    success(&render(folder.path(), &["a*.ron", "-o", "matched/"]));
    assert!(there(&["matched/a1.png", "matched/a2.png"]) && !there(&["matched/b.png"]));
    let output = render(folder.path(), &["b.ron", "broken.ron", "a1.ron", "-o", "some/"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("broken.ron:1:") && stderr(&output).contains("1 of 3 pictures failed"),
        "{}",
        stderr(&output)
    );
    assert!(there(&["some/a1.png", "some/b.png"]), "a broken one stops no other");
    for (arguments, expected) in [
        (vec!["a1.ron", "a2.ron", "-o", "one.png"], "is one file, and there are several pictures"),
        (vec!["a1.ron", "a2.ron", "--sweep", "max_iterations=1..4", "--frames", "2"], "a sweep has one formula"),
        (vec!["x*.ron"], "no file matches x*.ron"),
        (vec!["[.ron", "a1.ron"], "pattern"),
    ] {
        let output = render(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
    }
}

#[test]
fn a_formula_may_come_through_a_pipe() {
    let folder = folder_with(&[("a.ron", SPHERE)]);
    let piped = |text: &str, arguments: &[&str]| {
        let mut command = program(folder.path());
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        child.wait_with_output().unwrap()
    };
    let render = [&["render", "-", "-o", "-"], &SMALL[..]].concat();
    let output = piped(&format!("// A sphere.\n/* really */ {SPHERE}"), &render);
    assert!(output.status.success(), "{}", stderr(&output));
    success(&self::render(folder.path(), &["a.ron", "-o", "a.png"]));
    let pixels = |bytes: &[u8]| {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes.to_vec())).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    };
    assert_eq!(pixels(&output.stdout), pixels(&std::fs::read(folder.path().join("a.png")).unwrap()));
    let script = "#{ nodes: #{ bulb: bulb_power(#{ power: 4.0 }) }, output: \"bulb\" }";
    assert!(success(&piped(script, &["compile", "-", "--emit", "graph"])).contains("bulb_power"), "scripts may, too");
    let output = piped("(nodes: 1)", &["check", "-"]);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("stdin.ron:1:"), "{}", stderr(&output));
    let output = piped(SPHERE, &["animate", "-", "--way", "turntable", "-o", "x.gif"]);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("name a file"), "{}", stderr(&output));
}

#[test]
fn sizes_are_scaled() {
    let folder = folder_with(&[("a.ron", SPHERE)]);
    let render = |arguments: &[&str]| {
        let quick = ["render", "a.ron", "--samples", "1", "--calibrate", "off", "--quiet", "--force"];
        bulbfold(folder.path(), [&quick[..], arguments].concat())
    };
    success(&render(&["--scale", "0.05", "-o", "small.png"]));
    assert_eq!(size(&folder.path().join("small.png")), [64, 36]);
    success(&render(&["--size", "20x10", "--scale", "2", "-o", "twice.png"]));
    assert_eq!(size(&folder.path().join("twice.png")), [40, 20]);
    success(&bulbfold(folder.path(), ["render", "twice.png", "--scale", "0.5", "-o", "again.png", "--quiet"]));
    assert_eq!(size(&folder.path().join("again.png")), [20, 10], "of the picture that is rendered again");
    let output = render(&["--scale", "50"]);
    assert!(
        output.status.code() == Some(2) && stderr(&output).contains("64000x36000 is too large"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn settings_stand_where_nothing_else_is_said() {
    let folder = folder_with(&[
        ("a.ron", SPHERE),
        ("own.ron", "(size: \"24x18\", backend: \"cpu\", palette: \"lagoon\")"),
        ("wrong.ron", "(\n  size: \"huge\",\n)"),
    ]);
    let run = |settings: &str, arguments: &[&str]| {
        let mut command = program(folder.path());
        command.env("BULBFOLD_CONFIG", settings).args([
            "render",
            "a.ron",
            "--samples",
            "1",
            "--calibrate",
            "off",
            "--quiet",
        ]);
        command.args(arguments).output().unwrap()
    };
    success(&run("own.ron", &["-o", "own.png"]));
    assert_eq!(size(&folder.path().join("own.png")), [24, 18]);
    success(&run("own.ron", &["-o", "given.png", "--size", "16x12"]));
    assert_eq!(size(&folder.path().join("given.png")), [16, 12], "the command line comes first");
    let shown = success(&bulbfold(folder.path(), ["show", "own.png"]));
    assert!(shown.contains("lagoon"), "{shown}");
    let output = run("wrong.ron", &["-o", "never.png"]);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("wrong.ron:2:"), "{}", stderr(&output));
    let output = run("nothing.ron", &[]);
    assert!(
        output.status.code() == Some(2) && stderr(&output).contains("cannot read the settings"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn help_is_in_groups_and_the_version_says_all() {
    let folder = folder();
    let help = success(&bulbfold(folder.path(), ["render", "--help"]));
    let places: Vec<usize> = ["Picture:", "Camera:", "Light:", "Film:", "Estimate:"]
        .map(|group| help.find(&format!("\n{group}\n")).unwrap_or_else(|| panic!("no {group}\n{help}")))
        .to_vec();
    assert!(places.is_sorted(), "{places:?}");
    let version = success(&bulbfold(folder.path(), ["--version"]));
    assert!(
        version.starts_with("bulbfold 0.") && version.contains("commit ") && version.contains("features  cli"),
        "{version}"
    );
    assert_eq!(success(&bulbfold(folder.path(), ["-V"])).lines().count(), 1);
    for command in ["list", "explain menger", "doctor --help"] {
        let words: Vec<&str> = command.split(' ').chain(["-q"]).collect();
        assert!(bulbfold(folder.path(), &words).status.success(), "{command} -q");
    }
}

/// A stand-in for the system's viewer keeps the name that it is given.
#[cfg(target_os = "linux")]
#[test]
fn a_picture_is_opened_where_that_is_asked_for() {
    use std::os::unix::fs::PermissionsExt;
    let script = "#!/bin/sh\necho \"$1\" > opened.tmp && mv opened.tmp opened.txt\n";
    let folder = folder_with(&[("a.ron", SPHERE), ("xdg-open", script)]);
    let tool = folder.path().join("xdg-open");
    std::fs::set_permissions(&tool, std::fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap_or_default());
    let mut command = program(folder.path());
    command.env("PATH", path).args(["render", "a.ron", "-o", "a.png", "--open"]).args(SMALL);
    success(&command.output().unwrap());
    let note = folder.path().join("opened.txt");
    for _ in 0..200 {
        if note.is_file() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert_eq!(std::fs::read_to_string(note).unwrap().trim(), "a.png");
}

#[test]
fn views_are_kept_as_presets_and_flights_of_changed_formulas_are_files() {
    let folder = folder();
    success(&bulbfold(folder.path(), ["new", "box", "--from", "mandelbox"]));
    let look = ["look", "box.ron", "--count", "2", "--size", "48x32", "--json", "--keep", "2=gate", "--quiet"];
    let told = success(&bulbfold(folder.path(), look));
    let view: serde_json::Value = serde_json::from_str(told.lines().nth(1).unwrap()).unwrap();
    assert!(view["worth"].as_f64().is_some() && view["arguments"].as_str().is_some(), "{view}");
    let text = std::fs::read_to_string(folder.path().join("box.ron")).unwrap();
    let [x, y, z] = [0, 1, 2].map(|i| view["camera"]["position"][i].as_f64().unwrap());
    assert!(text.contains("\"gate\": (help:") && text.contains(&format!("position: ({x}, {y}, {z})")), "{text}");
    success(&render(folder.path(), &["box.ron", "--preset", "gate", "-o", "gate.png"]));
    for (arguments, expected) in [
        (vec!["look", "mandelbox", "--keep", "1=a"], "is no formula file"),
        (vec!["look", "box.ron", "--keep", "0=a"], "the number of a view"),
        (vec!["look", "box.ron", "--keep", "1=a", "--set", "scale=3"], "a changed formula"),
    ] {
        let output = bulbfold(folder.path(), &arguments);
        assert!(
            output.status.code() == Some(2) && stderr(&output).contains(expected),
            "{arguments:?}: {}",
            stderr(&output)
        );
    }
    success(&bulbfold(
        folder.path(),
        ["fly", "mandelbox", "--set", "scale=2.5", "--seconds", "4", "-o", "flight.ron", "--quiet"],
    ));
    let flight = std::fs::read_to_string(folder.path().join("flight.ron")).unwrap();
    assert!(flight.contains("(default: 2.5, min: 1.5, max: 4.0, help: \"Scale factor\")"), "{flight}");
}
