//! `bulbfold bench`: its tables, JSON and CSV, counts against known ones, and messages. Times are never asserted.

use std::path::Path;
use std::process::Output;

use serde_json::Value;

use crate::support::{bulbfold, folder, stderr, stdout};

fn bench(arguments: &[&str]) -> Output {
    let common = ["bench", "--size", "32x24", "--time", "0.05", "--calibrate", "off", "-q"];
    bulbfold(Path::new("."), common.iter().chain(arguments))
}

fn text(output: &Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    stdout(output)
}

fn json(arguments: &[&str]) -> Value {
    let all = [arguments, &["--json"]].concat();
    serde_json::from_str(&text(&bench(&all))).expect("one JSON object")
}

fn rows(result: &Value) -> Vec<Value> {
    result["fractals"][0]["rows"].as_array().expect("a list").clone()
}

#[test]
fn every_back_end_does_the_same_work() {
    let result = json(&["mandelbulb", "--de", "scalar"]);
    let rows = rows(&result);
    let engines: Vec<(&str, &str)> =
        rows.iter().map(|row| (row["engine"].as_str().unwrap(), row["precision"].as_str().unwrap())).collect();
    assert_eq!(engines[0], ("cpu", "f32"), "what renders take comes first");
    assert_eq!(engines[engines.len() - 1], ("tape", "f64"), "the baseline comes last");
    if std::env::var_os("BULBFOLD_REQUIRE_GPU").is_some() {
        assert!(engines.contains(&("gpu", "f32")), "{engines:?}");
    }
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key} in {row}"));
    let base = &rows[rows.len() - 1];
    for row in &rows {
        for key in ["ns_per_pixel", "median_ns_per_pixel", "estimates_per_pixel", "iterations_per_estimate"] {
            assert!(number(row, key) > 0.0, "{key} in {row}");
        }
        assert!(number(row, "runs") >= 3.0);
        assert!(number(row, "ns_per_pixel") <= number(row, "median_ns_per_pixel"));
        // Rounding moves hits and steps a little; all pixels of this small picture are marched by each.
        assert_eq!(row["pixels"], base["pixels"]);
        let apart = number(row, "estimates_per_pixel") / number(base, "estimates_per_pixel") - 1.0;
        assert!(apart.abs() < 0.1, "{row} against {base}");
        assert_eq!(row["operations_per_iteration"], base["operations_per_iteration"]);
        if row["engine"] != "gpu" {
            let share = number(row, "of_peak");
            assert!(share > 0.0 && share < 1.0, "no core does more than its peak: {row}");
        }
    }
    assert_eq!(number(base, "times_tape_f64"), 1.0);
    assert!(!result["fractals"][0]["threads"].as_array().unwrap().is_empty());
}

#[test]
fn counts_are_known_ones() {
    // One scaling by 2 with c: z 2 z + c is three products with sums, r² three more, a comparison and its opposite; the
    // derivative 2 dr + 1 is one. The set is a point, around which no orbit ends early, so nothing is compared with a threshold.
    let folder = folder();
    let file = folder.path().join("grow.ron");
    std::fs::write(&file, "(nodes: {\"grow\": scale(scale: 2.0)}, output: \"grow\")").expect("it can be written");
    let result = json(&[file.to_str().unwrap(), "--de", "scalar", "--backend", "cpu"]);
    for row in rows(&result) {
        assert_eq!(row["operations_per_iteration"], 3.0 + 3.0 + 2.0 + 1.0, "{row}");
    }
}

#[test]
fn methods_are_compared() {
    let result = json(&["mandelbulb", "--methods", "--backend", "cpu", "--precision", "f32"]);
    let rows = rows(&result);
    let of = |method: &str| {
        let found = rows.iter().find(|row| row["method"] == method && row["engine"] == "cpu");
        found.unwrap_or_else(|| panic!("{method} is missing"))["operations_per_iteration"].as_f64().unwrap()
    };
    assert!(of("scalar") < of("gradient"), "nine derivatives cost more than one");
    assert!(of("scalar") < of("combined"));
    assert!(rows.iter().any(|row| row["method"] == "delta"));
}

#[test]
fn tables_and_csv_hold_the_same_rows() {
    let table = text(&bench(&["mandelbox", "menger", "--backend", "cpu", "--precision", "f32"]));
    for part in ["mandelbox:", "menger:", "ns/pixel", "cpu: threads 1:", "cpu: picture", "a core:"] {
        assert!(table.contains(part), "{part} is missing:\n{table}");
    }
    let csv = text(&bench(&["mandelbox", "menger", "--backend", "cpu", "--precision", "f32", "--csv"]));
    let lines: Vec<&str> = csv.lines().collect();
    let columns = lines[0].split(',').count();
    assert!(lines.iter().all(|line| line.split(',').count() == columns), "{csv}");
    assert!(lines.iter().filter(|line| line.starts_with("menger,32,24,cpu,f32,")).count() == 1, "{csv}");
    assert!(lines.iter().filter(|line| line.contains(",tape,f64,")).count() == 2, "{csv}");
}

#[test]
fn wrong_usage_is_told() {
    let cases: [(&[&str], &str); 6] = [
        (&["nothing_like_it"], "nothing_like_it"),
        (&["mandelbulb", "--methods", "--de", "scalar"], "cannot be used with"),
        (&["mandelbulb", "--json", "--csv"], "cannot be used with"),
        (&["mandelbulb", "--time", "0"], "above 0"),
        (&["mandelbulb", "--size", "0x4"], "columns and rows"),
        (&["mandelbulb", "--backend", "gpu", "--precision", "f64"], "exclude each other"),
    ];
    for (arguments, expected) in cases {
        let output = bulbfold(Path::new("."), [&["bench"], arguments].concat());
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
}

#[test]
fn timing_scenes_are_what_the_other_programs_render() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/scenes");
    for (name, iterations) in [("a_bulb8", 20), ("b_box2", 20), ("c_menger", 12), ("d_boxm15_bulb8", 20)] {
        let file = format!("{folder}/{name}.ron");
        let compile = |arguments: &[&str]| text(&bulbfold(Path::new("."), [&["compile", &file], arguments].concat()));
        let cost = compile(&["--emit", "cost"]);
        assert!(cost.contains(&format!("at most {iterations} iterations")), "{name}:\n{cost}");
        // No shadow, occlusion, fog or trap: nothing but rays, a march, a normal and a light.
        let shaders = compile(&["--emit", "wgsl", "--all"]);
        assert!(!shaders.contains("shadow") && !shaders.contains("kernel shadow_ray"), "{name}");
        let colour = shaders.split("// kernel colour").nth(1).expect("the kernel of colours");
        assert!(!colour.contains("exp("), "{name}: traps, fog or occlusion are on");
    }
}
