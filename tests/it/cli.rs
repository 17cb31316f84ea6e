//! The program as users run it: the built binary in a fresh folder.

use std::path::Path;
use std::process::{Output, Stdio};

use serde_json::Value;

use crate::support::{bulbfold, folder, program, stderr, stdout, success};

fn code(output: &Output) -> i32 {
    output.status.code().expect("the program was not killed")
}

fn json_lines(output: &Output) -> Vec<Value> {
    stdout(output).lines().map(|line| serde_json::from_str(line).expect("each line is JSON")).collect()
}

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the folder is there").flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn a_render_writes_one_picture_and_keeps_stdout_clean() {
    let folder = folder();
    let output = bulbfold(folder.path(), ["render", "mandelbulb", "--size", "64x48", "--backend", "cpu"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(output.stdout.is_empty());
    assert!(stderr(&output).contains("mandelbulb.png"));
    assert_eq!(files(folder.path()), ["mandelbulb.png"]);
    let picture = std::fs::read(folder.path().join("mandelbulb.png")).expect("the picture is there");
    assert!(picture.starts_with(b"\x89PNG"));
}

#[test]
fn statistics_are_one_json_object() {
    let folder = folder();
    let arguments = [
        "render",
        "mandelbox",
        "--size",
        "64x48",
        "--samples",
        "1",
        "--backend",
        "cpu",
        "--json",
        "-q",
        "-o",
        "box.png",
    ];
    let output = bulbfold(folder.path(), arguments);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(output.stderr.is_empty(), "{}", stderr(&output));
    let report: Value = serde_json::from_str(&stdout(&output)).expect("stdout is one JSON object");
    assert_eq!(report["version"], 1);
    assert_eq!(report["rays"], 64 * 48);
    assert!(report["hits"].as_u64().is_some_and(|hits| hits > 100));
}

#[test]
fn bad_input_exits_with_2_and_writes_nothing() {
    let folder = folder();
    let write = |name: &str, text: &[u8]| std::fs::write(folder.path().join(name), text).expect("the file is written");
    write("binary.ron", &[0xff, 0xfe, 0, 1]);
    write("empty.ron", b"");
    write("field.ron", b"(nodes: { \"a\": box_fold(limti: 1.0) })");
    write("cycle.ron", b"(nodes: { \"a\": Sequence([\"b\"]), \"b\": Sequence([\"a\"]) }, output: \"a\")");
    write("nan.ron", b"(nodes: { \"a\": box_fold(limit: NaN) })");
    write("step.ron", b"(nodes: { \"a\": boxfold() })");
    write("step.rhai", b"fn step(z, c, p) { z }\n#{ group: \"fold\", summary: \"-\", source: \"-\" }\n");
    std::fs::create_dir(folder.path().join("dir.ron")).expect("the folder is made");
    let before = files(folder.path());
    let cases: &[(&[&str], &str)] = &[
        (&["render", "missing.ron"], "no file"),
        (&["render", "mandelbulp"], "did you mean `mandelbulb`"),
        (&["render", "dir.ron"], "folder"),
        (&["render", "binary.ron"], "UTF-8"),
        (&["render", "empty.ron"], "empty.ron"),
        (&["render", "field.ron"], "field.ron:1:25"),
        (&["render", "cycle.ron"], "cycle"),
        (&["render", "nan.ron"], "nan.ron:1"),
        (&["render", "step.ron"], "did you mean `box_fold`"),
        (&["render", "step.rhai"], "not a graph script"),
        (&["render", "mandelbulb", "--set", "powr=4"], "did you mean `power`"),
        (&["render", "mandelbulb", "--set", "power=99"], "--set power"),
        (&["render", "mandelbulb", "--set", "power=abc"], "--set power"),
        (&["render", "mandelbulb", "--set", "power"], "--set"),
        (&["render", "mandelbulb", "--set", "ball.power=4"], "no node `ball`"),
        (&["render", "mandelbulb", "-o", "no_folder/a.png"], "no_folder"),
        (&["render", "mandelbulb", "-o", "a.bmp"], ".png"),
        (&["render", "mandelbulb", "--size", "0x5"], "16384"),
        (&["render", "mandelbulb", "--fudge", "1.5"], "fudge"),
        (&["render", "mandelbulb", "--camera", "0,0,0"], "camera"),
        (&["render", "mandelbulb", "--backend", "gpu", "--precision", "f64"], "exclude"),
        (&["render", "mandelbulb", "--steps", "nowhere"], "nowhere"),
        (&["audit", "mandelbulp"], "did you mean `mandelbulb`"),
        (&["audit", "mandelbulb", "--rays", "0"], "--rays"),
        (&["audit", "mandelbulb", "--de", "guess"], "--de"),
        (&["audit", "field.ron"], "field.ron:1:25"),
        (&["probe", "mandelbulb"], "--point"),
        (&["probe", "mandelbulb", "--points", "missing.csv"], "missing.csv"),
        (&["explain", "box_fould"], "box_fold"),
        (&["new", "1st"], "digit"),
        (&["frobnicate"], "frobnicate"),
    ];
    for (arguments, expected) in cases {
        let output = bulbfold(folder.path(), *arguments);
        let text = stderr(&output);
        assert_eq!(code(&output), 2, "{arguments:?}: {text}");
        assert!(text.contains(expected), "{arguments:?} should say {expected}: {text}");
        assert!(output.stdout.is_empty(), "{arguments:?} wrote to stdout");
        assert!(!text.contains('\u{1b}') && !text.contains("panicked"), "{text}");
    }
    assert_eq!(files(folder.path()), before);
}

#[test]
fn a_probe_of_points_gives_a_line_each_in_order() {
    let folder = folder();
    std::fs::write(folder.path().join("points.csv"), "x,y,z\r\n\r\n 1.3, 0, 0\r\n0,0,0\n")
        .expect("the file is written");
    let arguments = ["probe", "mandelbulb", "--json", "--points", "points.csv"];
    let output = bulbfold(folder.path(), arguments);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let lines = json_lines(&output);
    assert_eq!(lines.len(), 2);
    assert_eq!((&lines[0]["p"], &lines[0]["escaped"]), (&serde_json::json!([1.3, 0.0, 0.0]), &Value::Bool(true)));
    assert_eq!(lines[1]["escaped"], false);
    for method in ["scalar", "gradient", "combined", "delta"] {
        assert!(lines[0]["de"][method].as_f64().is_some_and(|de| de > 0.1 && de < 0.3), "{}", lines[0]);
    }
    let output =
        bulbfold(folder.path(), ["probe", "mandelbulb", "--json", "--point", "-1.3,0,-2", "--precision", "f32"]);
    assert_eq!(json_lines(&output)[0]["p"], serde_json::json!([-1.3, 0.0, -2.0]));
    let output = bulbfold(folder.path(), ["probe", "mandelbulb", "--point", "1.3,0,0"]);
    let text = stdout(&output);
    assert!(text.contains("escaped true") && text.contains("p (1.300000, 0.000000, 0.000000)"), "{text}");
}

#[test]
fn a_bad_line_of_points_is_named() {
    let folder = folder();
    std::fs::write(folder.path().join("points.csv"), "1,2,3\n\n1,2\n").expect("the file is written");
    let output = bulbfold(folder.path(), ["probe", "mandelbulb", "--json", "--points", "points.csv"]);
    assert_eq!(code(&output), 2);
    assert!(stderr(&output).contains("points.csv:3"), "{}", stderr(&output));
}

#[test]
fn a_probe_of_rays_hits_or_misses() {
    let folder = folder();
    std::fs::write(folder.path().join("rays.csv"), "0,-3,0,0,2,0\n0,-3,0,1,0,0\n0,0,0,0,0,1\n").expect("written");
    let output = bulbfold(folder.path(), ["probe", "mandelbulb", "--json", "--rays", "rays.csv", "--hit-eps", "0.001"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let lines = json_lines(&output);
    let depth = lines[0]["t"].as_f64().expect("the first ray hits");
    assert!((1.9..2.3).contains(&depth), "{depth}");
    assert_eq!((&lines[1]["hit"], &lines[1]["t"]), (&Value::Bool(false), &Value::Null));
    assert_eq!(lines[2]["hit"], true);
}

#[test]
fn new_files_work_as_written_and_are_never_overwritten() {
    let folder = folder();
    assert_eq!(code(&bulbfold(folder.path(), ["new", "flower"])), 0);
    assert_eq!(code(&bulbfold(folder.path(), ["new", "my_pull", "--step"])), 0);
    let formula = std::fs::read_to_string(folder.path().join("flower.ron")).expect("the file is there");
    let output = bulbfold(folder.path(), ["new", "flower"]);
    assert_eq!(code(&output), 2);
    assert_eq!(std::fs::read_to_string(folder.path().join("flower.ron")).expect("still there"), formula);
    let output = bulbfold(folder.path(), ["render", "flower.ron", "--size", "64x48", "--backend", "cpu", "--json"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let report: Value = serde_json::from_str(&stdout(&output)).expect("JSON");
    assert!(report["hits"].as_u64().is_some_and(|hits| hits > 200), "{report}");
    // The new step lies beside the formula, so it can be used and explained.
    let hybrid =
        "(nodes: { \"a\": my_pull(amount: 1.0), \"b\": bulb_power(), \"c\": Sequence([\"a\", \"b\"]) }, output: \"c\")";
    std::fs::write(folder.path().join("hybrid.ron"), hybrid).expect("the file is written");
    let output = bulbfold(folder.path(), ["render", "hybrid.ron", "--size", "16x16", "--backend", "cpu"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert_eq!(code(&bulbfold(folder.path(), ["explain", "my_pull", "--steps", "."])), 0);
}

#[test]
fn every_stage_is_printed_the_same_each_time() {
    let folder = folder();
    for stage in ["graph", "expr", "wgsl", "tape", "dot"] {
        let arguments = ["compile", "mandelbox", "--emit", stage];
        let output = bulbfold(folder.path(), arguments);
        assert_eq!(code(&output), 0, "{stage}: {}", stderr(&output));
        assert!(!output.stdout.is_empty());
        assert_eq!(output.stdout, bulbfold(folder.path(), arguments).stdout, "{stage}");
    }
    let output = bulbfold(folder.path(), ["compile", "mandelbox", "--emit", "expr"]);
    assert!(stdout(&output).contains("formulas/steps/box_fold.rhai:"), "{}", stdout(&output));
}

#[test]
fn scripts_take_parameters() {
    let folder = folder();
    let graph = |set: &[&str]| {
        let mut arguments = vec!["compile", "power_sweep", "--emit", "graph"];
        set.iter().for_each(|pair| arguments.extend(["--set", pair]));
        bulbfold(folder.path(), &arguments)
    };
    assert_eq!(stdout(&graph(&["count=3"])).matches("bulb_power(").count(), 3);
    assert_eq!(code(&graph(&["count=99"])), 2);
    assert_eq!(code(&graph(&["count=1.5"])), 2);
    assert_eq!(code(&graph(&["cuont=3"])), 2);
    let hybrid =
        |seed: &str| stdout(&bulbfold(folder.path(), ["compile", "random_hybrid", "--emit", "graph", "--set", seed]));
    assert_eq!(hybrid("seed=3"), hybrid("seed=3"));
    assert_ne!(hybrid("seed=3"), hybrid("seed=4"));
}

#[test]
fn lists_explanations_and_references_are_written() {
    let folder = folder();
    let list: Value = serde_json::from_str(&stdout(&bulbfold(folder.path(), ["list", "--json"]))).expect("JSON");
    for step in list["steps"].as_array().expect("a list of steps") {
        let name = step["name"].as_str().expect("a name");
        let output = bulbfold(folder.path(), ["explain", name]);
        assert_eq!(code(&output), 0, "{name}: {}", stderr(&output));
    }
    let output = bulbfold(folder.path(), ["docs", "-o", "."]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert_eq!(files(folder.path()), ["fractals.md", "materials.md", "operators.md", "palettes.md", "steps.md"]);
}

#[test]
fn a_closed_pipe_is_not_an_error() {
    let folder = folder();
    let mut command = program(folder.path());
    command.args(["explain", "bulb_power"]).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("the program ends");
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(output.stderr.is_empty(), "{}", stderr(&output));
}

#[test]
fn the_doctor_finds_the_cpu_back_ends_in_agreement() {
    let folder = folder();
    let output = bulbfold(folder.path(), ["doctor"]);
    let text = stdout(&output);
    assert!(text.contains("PASS     mandelbulb on cpu, f32"), "{text}");
    assert_eq!(code(&output) == 0, !text.contains("FAIL"), "{text}");
}

#[test]
fn an_audit_says_what_is_proven_and_what_was_missed() {
    let folder = folder();
    // Where r - R is said to be r, a gradient overestimates: some of a Mandelbox of scale -1.5 is missed.
    let arguments =
        ["audit", "mandelbox_negative", "--de", "gradient", "--rays", "300", "--size", "64x48", "--json", "--quiet"];
    let output = bulbfold(folder.path(), arguments);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(stderr(&output).is_empty(), "quiet means quiet");
    let audit: Value = serde_json::from_str(&stdout(&output)).expect("JSON");
    let count = |name: &str| audit[name].as_u64().expect("a count");
    assert_eq!(count("proven_empty") + count("hit") + count("undecided"), 300);
    assert!(count("proven_empty") > 60 && audit["method"] == "gradient", "{audit}");
    let wrong = audit["wrong"].as_array().expect("a list");
    assert!(wrong.iter().any(|w| w["kind"] == "missed hit" && w["certified"].is_f64()), "{audit}");

    let output = bulbfold(folder.path(), ["audit", "menger", "--rays", "100", "--size", "32x24"]);
    let text = stdout(&output);
    let row = |name: &str| text.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name}: {text}"));
    assert!(row("rays").ends_with("100") && row("missed hits").contains("0 (0.00 %)"), "{text}");
    assert!(!stderr(&output).contains('\u{1b}'), "no colours where there is no terminal");
}

#[test]
fn calibrations_are_shown_kept_and_switched_off() {
    let folder = folder();
    let run = |arguments: &[&str]| {
        let mut command = program(folder.path());
        command.args(arguments).env("BULBFOLD_CACHE", folder.path().join("cache")).output().expect("the program starts")
    };
    // The built-in file carries its estimate.
    let builtin = std::fs::read_to_string("formulas/fractals/menger.ron").expect("the repository's file");
    let lines: Vec<&str> = builtin.lines().filter(|line| !line.contains("calibrated: true")).collect();
    std::fs::write(folder.path().join("menger.ron"), lines.join("\n")).expect("a folder of our own");
    let render = ["render", "menger.ron", "--size", "64x48", "--backend", "cpu", "--stats", "-q"];
    let first = run(&render);
    assert_eq!(code(&first), 0, "{}", stderr(&first));
    assert!(stderr(&first).contains("candidate") && stderr(&first).contains("chosen"), "{}", stderr(&first));
    assert!(stderr(&run(&render)).contains("kept from an earlier run"));
    let off = run(&[&render[..], &["--calibrate", "off"]].concat());
    assert!(stderr(&off).contains("switched off") && !stderr(&off).contains("candidate"), "{}", stderr(&off));
    let fixed = ["--de", "scalar", "--form", "linear", "--fudge", "0.8", "--least-step", "0.25"];
    assert!(stderr(&run(&[&render[..], &fixed].concat())).contains("nothing left to choose"));

    let shown = run(&["calibrate", "menger", "--size", "64x48", "--json"]);
    let value = &json_lines(&shown)[0];
    assert!(value["within_budget"].as_bool().unwrap() && value["rays"].as_u64().unwrap() > 0, "{value}");
    let chosen = value["candidates"].as_array().unwrap().iter().filter(|row| row["why_not"].is_null());
    assert_eq!(chosen.count(), 1);

    // What the file carries holds for its own picture alone.
    let carried = |arguments: &[&str]| {
        let common = ["render", "menger", "--size", "64x48", "--samples", "1", "--backend", "cpu", "--stats", "-q"];
        stderr(&run(&[&common[..], arguments].concat())).contains("the file says that its estimate is calibrated")
    };
    assert!(carried(&[]) && carried(&["--set", "look=(fog: 0.1)"]));
    for other in [["--set", "grow.scale=2.9"], ["--set", "max_iterations=3"], ["--fov", "30"]] {
        assert!(!carried(&other), "{other:?}");
    }

    for budget in ["0.5", "0%", "200%", "1%,2%,3,4", "1%,2%,-1"] {
        let refused = run(&["render", "menger", "--error-budget", budget]);
        assert_eq!(code(&refused), 2, "{budget}: {}", stderr(&refused));
    }
}

/// A folder is no formula: the built-in one of its name is meant, and other names are told.
#[test]
fn folders_are_not_read_as_formulas() {
    let folder = folder();
    for name in ["menger", "mine"] {
        std::fs::create_dir(folder.path().join(name)).expect("it can be made");
    }
    success(&bulbfold(folder.path(), ["render", "menger", "--size", "16x12", "--calibrate", "off", "-q"]));
    let output = bulbfold(folder.path(), ["render", "mine"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("`mine` is a folder"), "{}", stderr(&output));
}
