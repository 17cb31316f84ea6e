//! Presets: read, checked, applied, listed and tested.

use std::path::PathBuf;
use std::process::Output;

use bulbfold::check::{Formula, Options, run_paths};
use bulbfold::formula::embedded::FRACTALS;
use bulbfold::formula::library::Library;

use crate::support::{self, folder, folder_with, stderr, stdout};

/// A bulb with two presets.
const BULB: &str = r#"(
    params: { "power": (default: 8.0, min: 2.0, max: 16.0) },
    nodes: { "bulb": bulb_power(power: "power") },
    output: "bulb",
    presets: {
        "four": (help: "Power 4", set: { "power": 4.0, "max_iterations": 5 }, camera: (position: (0.0, -4.0, 0.0))),
        "grey": (look: (fog: 0.5)),
    },
)"#;

fn bulbfold(arguments: &[&str], file: &str) -> Output {
    support::bulbfold(folder_with(&[("bulb.ron", file)]).path(), arguments)
}

fn changed(text: &str, set: &[(&str, &str)]) -> Result<Formula, String> {
    let folder = folder();
    let path: PathBuf = folder.path().join("bulb.ron");
    std::fs::write(&path, text).expect("the file is written");
    Formula::with(&path.display().to_string(), set).map_err(|error| error.to_string())
}

#[test]
fn a_preset_is_its_values_and_single_values_win() {
    let plain = changed(BULB, &[]).unwrap();
    assert_eq!((plain.graph().params[0].value, plain.graph().orbit.max_iterations), (8.0, 20));
    assert!(plain.graph().scene.camera.is_none());
    let four = changed(BULB, &[("preset", "four")]).unwrap();
    assert_eq!((four.graph().params[0].value, four.graph().orbit.max_iterations), (4.0, 5));
    assert_eq!(four.graph().scene.camera.unwrap().position, [0.0, -4.0, 0.0]);
    // The order of the command line does not matter.
    let three = changed(BULB, &[("power", "3"), ("preset", "\"four\"")]).unwrap();
    assert_eq!((three.graph().params[0].value, three.graph().orbit.max_iterations), (3.0, 5));
    assert_eq!(changed(BULB, &[("preset", "grey")]).unwrap().graph().scene.look.fog, 0.5);
    // 2 to the power 4 and 2 again is 18.
    assert_eq!(four.orbit([0.0, 0.0, 2.0], 1)[2], 18.0);
}

#[test]
fn presets_are_checked_with_the_file() {
    let cases = [
        ("\"power\": 4.0", "\"power\": 40.0", "`power` must be from 2 to 16, but is 40", "bulb.ron:6:"),
        ("\"power\": 4.0", "\"powre\": 4.0", "did you mean `power`?", "bulb.ron:6:"),
        ("\"power\": 4.0", "\"bulb.pover\": 4.0", "did you mean `power`?", "bulb.ron:6:"),
        ("\"power\": 4.0", "\"balb.power\": 4.0", "did you mean `bulb`?", "bulb.ron:6:"),
        ("\"max_iterations\": 5", "\"max_iterations\": -5", "must be from 0 to 10000", "bulb.ron:6:"),
        ("position: (0.0, -4.0, 0.0)", "postion: (0.0, -4.0, 0.0)", "did you mean `position`?", "bulb.ron:6:"),
        ("(look: (fog: 0.5))", "(lok: (fog: 0.5))", "did you mean `look`?", "bulb.ron:7:"),
        ("(look: (fog: 0.5))", "(help: \"nothing\")", "the preset `grey` changes nothing", "bulb.ron:7:"),
        ("\"grey\"", "\"light grey\"", "use letters, digits, _ and -", "bulb.ron:7:"),
    ];
    for (good, wrong, message, place) in cases {
        assert!(BULB.contains(good), "{good}");
        let error = changed(&BULB.replace(good, wrong), &[]).err().unwrap_or_else(|| panic!("{wrong} was accepted"));
        assert!(error.contains(message) && error.contains(place), "{wrong}: {error}");
    }
}

#[test]
fn an_unknown_preset_is_told_with_the_closest_name() {
    let output = bulbfold(&["compile", "bulb.ron", "--emit", "graph", "--preset", "fuor"], BULB);
    assert_eq!(output.status.code(), Some(2));
    let text = stderr(&output);
    assert!(text.contains("there is no preset `fuor`") && text.contains("did you mean `four`?"), "{text}");
    let output = bulbfold(&["compile", "bulb.ron", "--emit", "graph", "--preset", "x\"y"], BULB);
    let text = stderr(&output);
    assert!(output.status.code() == Some(2) && text.contains("the presets are: four, grey"), "{text}");
    let output = bulbfold(&["compile", "menger", "--emit", "graph", "--preset", "four"], BULB);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn presets_are_taken_by_commands() {
    let output = bulbfold(&["compile", "bulb.ron", "--emit", "graph", "--preset", "four"], BULB);
    let text = stdout(&output);
    assert!(text.contains("param power = 4 "), "{text}");
    let output = bulbfold(&["explain", "bulb.ron"], BULB);
    let text = stdout(&output);
    assert!(text.contains("power: 4, max_iterations: 5, camera") && text.contains("Power 4"), "{text}");
    let output = bulbfold(&["test", "bulb.ron", "--no-gpu"], BULB);
    let text = stdout(&output);
    assert!(text.contains("preset four") && text.contains("preset grey"), "{text}");
}

#[test]
fn scripts_have_presets_too() {
    let script = "let power = param(\"power\", 8.0, #{ min: 2.0, max: 16.0 });\n\
                  #{ nodes: #{ bulb: bulb_power(#{ power: power }) }, output: \"bulb\",\n\
                  presets: #{ four: #{ set: #{ power: 4.0 } } } }\n";
    let folder = folder();
    let path = folder.path().join("bulb.rhai");
    std::fs::write(&path, script).expect("the file is written");
    let four = Formula::with(&path.display().to_string(), &[("preset", "four")]).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(four.orbit([0.0, 0.0, 2.0], 1)[2], 18.0);
}

#[test]
fn presets_of_the_built_in_fractals_load_and_compose() {
    let mut count = 0;
    for (name, _) in FRACTALS {
        let presets = Formula::builtin(name).unwrap().graph().presets.clone();
        for preset in presets {
            assert!(preset.help.len() > 5, "{name}: the preset {} needs a help text", preset.name);
            let set = format!("\"{}\"", preset.name);
            if let Err(error) = Formula::with(name, &[("preset", set.as_str())]) {
                panic!("{name}, preset {}: {error}", preset.name);
            }
            count += 1;
        }
    }
    assert!(count >= 2, "{count}");
}

/// The runner names a preset that does not load: a step whose script fails for its values.
#[test]
fn the_test_runner_composes_presets() {
    let folder = folder();
    let step = "fn step(z, c, p) { if p.mode == 2.0 { throw \"not two\" } z * p.mode }\n\
                #{ group: \"scale\", summary: \"Scales.\", source: \"none\", params: [\
                #{ name: \"mode\", type: \"float\", \"default\": 1.5, min: 0.0, max: 3.0, help: \"Factor\" }],\n\
                examples: [#{ z: [1.0, 0.0, 0.0], expect: [1.5, 0.0, 0.0] }] }\n";
    std::fs::write(folder.path().join("fussy.rhai"), step).unwrap();
    let graph = "(nodes: { \"a\": fussy() }, presets: { \"two\": (set: { \"a.mode\": 2.0 }) })";
    std::fs::write(folder.path().join("graph.ron"), graph).unwrap();
    let options = Options { gpu: false, ..Options::default() };
    let report = run_paths(&mut Library::builtin(), &[folder.path().join("graph.ron")], &options);
    let text = report.to_string();
    assert!(!report.is_ok() && text.contains("preset `two`") && text.contains("not two"), "{text}");
}
