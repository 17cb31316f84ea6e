//! Calibrations written into formula files, and tables of truths.

use std::path::Path;
use std::process::Output;

use bulbfold::check::Formula;
use bulbfold::graph::NodeKind;

use crate::support::{bulbfold, folder, stderr, stdout};

fn texts(output: &Output) -> String {
    format!("{}{}", stdout(output), stderr(output))
}

const MENGER: &str = "// kept\n(\n    nodes: { \"a\": Sequence([menger_fold(), scale(scale: 3.0, centre: (1, 1, 1))]) },\n    constant: Off, // here too\n    escape_radius: 8.0,\n    max_iterations: 4,\n    bounding_radius: 1.75,\n    camera: (position: (2.2, -3.2, 1.9), target: (0, 0, 0), fov: 40),\n)\n";
const SCENE: &str = "(nodes: { \"map\": bulb_power(power: 8), \"bulb\": Orbit(of: \"map\", escape_radius: 10.0, max_iterations: 5), \"ball\": Sphere(centre: (2, 0, 0)), \"all\": Union([\"bulb\", \"ball\"]) }, output: \"all\", bounding_radius: 3.2)";

#[test]
fn the_choice_is_written_and_nothing_else_changes() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("sponge.ron"), MENGER).unwrap();
    std::fs::write(path("scene.ron"), SCENE).unwrap();
    std::fs::write(path("ball.ron"), "(nodes: { \"ball\": Sphere(radius: 1) })").unwrap();
    std::fs::write(path("broken.ron"), "(nodes: { \"a\": nothing() })").unwrap();
    let files = ["sponge.ron", "scene.ron", "ball.ron", "broken.ron"];
    let arguments = |files: &[&'static str]| [&["calibrate"], files, &["--write", "--size", "320x240"]].concat();
    let output = bulbfold(folder.path(), arguments(&files));
    assert_eq!(output.status.code(), Some(1), "{}", texts(&output));
    for text in ["2 of 4 files changed, 1 failed", "no orbit", "unknown step or node kind `nothing`"] {
        assert!(texts(&output).contains(text), "{text}\n{}", texts(&output));
    }
    // Without the new line the file is what it was.
    let sponge = std::fs::read_to_string(path("sponge.ron")).unwrap();
    let (added, rest): (Vec<&str>, Vec<&str>) = sponge.lines().partition(|line| line.contains("estimate:"));
    assert_eq!(rest.join("\n") + "\n", MENGER);
    assert!(added[0].starts_with("    estimate: (method: \"") && added[0].ends_with("calibrated: 240),"), "{added:?}");
    // In a scene the orbit carries it.
    let scene = Formula::open(path("scene.ron")).unwrap();
    let orbit = scene.graph().nodes.iter().find_map(|node| match &node.kind {
        NodeKind::Orbit { settings, .. } => Some(settings.estimate),
        _ => None,
    });
    assert!(
        orbit.is_some_and(|e| e.calibrated.is_some()
            && e.method.is_some()
            && e.fudge.is_some()
            && e.least_step.is_some())
    );
    for name in ["sponge.ron", "scene.ron"] {
        Formula::open(path(name)).unwrap().assert_tests();
    }
    // What is calibrated is measured anew, with the same outcome.
    let output = bulbfold(folder.path(), arguments(&files[..2]));
    assert!(output.status.success() && texts(&output).contains("0 of 2 files changed"), "{}", texts(&output));
    assert_eq!(std::fs::read_to_string(path("sponge.ron")).unwrap(), sponge);
}

#[test]
fn only_formula_files_are_written() {
    let folder = folder();
    for arguments in [vec!["calibrate", "menger", "--write"], vec!["calibrate", "a.rhai", "--write"]] {
        let output = bulbfold(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(2), "{}", texts(&output));
        assert!(texts(&output).contains("is no formula file"), "{}", texts(&output));
    }
}

#[test]
fn tables_of_truths_say_who_breaks_the_budget() {
    let folder = folder();
    let quick = ["--rays", "150", "--size", "160x120", "--de", "scalar", "--calibrate", "off", "--markdown"];
    let table = |files: &[&'static str], fudge: &'static str| {
        bulbfold(folder.path(), [&["truth"], files, &quick, &["--fudge", fudge]].concat())
    };
    // The sponge's scalar rule is a bound, so nothing is missed.
    let output = table(&["menger"], "1");
    assert!(output.status.success(), "{}", texts(&output));
    let lines: Vec<String> = stdout(&output).lines().map(str::to_string).collect();
    assert_eq!(lines.len(), 3, "{lines:?}");
    assert!(lines[0].starts_with("| Fractal | Estimate |") && lines[1].starts_with("|---|"), "{lines:?}");
    assert!(
        lines[2].starts_with("| menger | scalar linear | 1 | 150 |") && lines[2].ends_with("| kept |"),
        "{lines:?}"
    );
    // A budget that nothing keeps, and a file that is not there: both are told, and the rest is measured.
    let arguments = [&["truth", "menger", "nowhere.ron"][..], &quick, &["--error-budget", "0.5%,5%,0.000001"]].concat();
    let output = bulbfold(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(1));
    for text in ["| broken |", "median depth error", "nowhere.ron"] {
        assert!(texts(&output).contains(text), "{text}\n{}", texts(&output));
    }
}

/// What has no orbit to calibrate: fields of primitives.
const WITHOUT_ORBIT: [&str; 4] = ["cabinet_of_shapes", "chain_and_heart", "torus_knots", "twisted_tori"];

#[test]
fn built_in_fractals_carry_their_estimate_and_have_a_row_of_truth() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/lab/defaults.md")).expect("scripts/defaults.sh wrote it");
    let mut seen = 0;
    for entry in std::fs::read_dir(root.join("formulas/fractals")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().to_string();
        let text = std::fs::read_to_string(&path).unwrap();
        // Pictures of a plane march no rays.
        if text.contains("\n    plane: ") {
            continue;
        }
        seen += 1;
        let is_let_off = WITHOUT_ORBIT.contains(&&*name);
        assert_eq!(text.contains("calibrated: true"), !is_let_off, "{name}: bulbfold calibrate {name}.ron --write");
        let row = page.lines().find(|line| line.starts_with(&format!("| {name} |")));
        let row = row.unwrap_or_else(|| panic!("{name} has no row: sh scripts/defaults.sh"));
        assert!(row.ends_with("| kept |"), "{row}");
    }
    assert!(seen >= 120, "{seen}");
}
