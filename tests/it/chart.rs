//! The command `chart`: what it writes, and what it says about bad input.

use std::path::Path;
use std::process::Output;

use crate::support::{bulbfold, folder, stderr};

fn chart(folder: &Path, arguments: &[&str]) -> Output {
    bulbfold(folder, [&["chart"], arguments, &["--backend", "cpu"]].concat())
}

fn written(arguments: &[&str], name: &str) -> Vec<u8> {
    let folder = folder();
    let output = chart(folder.path(), &[arguments, &["-q", "-o", name]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(output.stdout.is_empty() && output.stderr.is_empty());
    let files = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(files, 1, "nothing but the chart is left");
    std::fs::read(folder.path().join(name)).unwrap()
}

/// Lines of a CSV, each a field by its heading.
fn rows(csv: &[u8]) -> Vec<std::collections::HashMap<String, String>> {
    let text = String::from_utf8(csv.to_vec()).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        assert_eq!(fields.len(), names.len(), "{line}");
        names.iter().zip(fields).map(|(n, f)| (n.to_string(), f.to_string())).collect()
    };
    lines.map(row).collect()
}

const SMALL: [&str; 6] = ["--rays", "200", "--size", "160x90", "--fudge", "0.5,1"];

#[test]
fn numbers_of_a_sponge_are_those_of_its_exact_rule() {
    let rows = rows(&written(&[&["menger"], &SMALL[..]].concat(), "menger.csv"));
    let number = |row: &std::collections::HashMap<String, String>, name: &str| row[name].parse::<f64>().unwrap();
    assert_eq!(rows.iter().filter(|r| r["auto"] == "1").count(), 1);
    for precision in ["f32", "f64"] {
        let of = |fudge: &str| {
            rows.iter()
                .find(|r| r["method"] == "scalar" && r["precision"] == precision && r["fudge"] == fudge)
                .expect("the rule is measured")
        };
        let (half, whole) = (of("0.5"), of("1"));
        // The rule of a similarity system is the distance itself: it misses nothing, and half steps only cost more.
        assert!(number(whole, "missed") < 0.01 && number(whole, "median_error_footprints") < 0.5, "{whole:?}");
        assert!(number(half, "estimates_per_pixel") > 1.2 * number(whole, "estimates_per_pixel"));
        assert!(number(whole, "ns_per_pixel") > 0.0);
    }
    // Nothing on the front is beaten in both.
    let wrong = |r| number(r, "missed") + number(r, "early");
    for front in rows.iter().filter(|r| r["pareto"] == "1") {
        let beats = |r| number(r, "ns_per_pixel") < number(front, "ns_per_pixel") && wrong(r) < wrong(front);
        assert!(!rows.iter().any(beats));
    }
}

#[test]
fn svg_and_png_show_the_same_chart() {
    let svg = String::from_utf8(written(&[&["mandelbulb"], &SMALL[..]].concat(), "a.svg")).unwrap();
    for words in ["aria-label=\"mandelbulb\"", "aria-label=\"auto\"", "aria-label=\"delta\"", "data:image/jpeg;base64,"]
    {
        assert!(svg.contains(words), "{words}");
    }
    let bad =
        |line: &&str| line.contains("<text") || line.contains("NaN") || line.contains("\"inf") || line.contains(" inf");
    assert_eq!(svg.lines().filter(|line| !line.starts_with("<image")).find(bad), None);
    let png = written(&[&["mandelbulb", "--scale", "1"], &SMALL[..]].concat(), "a.png");
    assert!(png.starts_with(b"\x89PNG"));
    assert_eq!(u32::from_be_bytes(png[16..20].try_into().unwrap()), 960);
}

#[test]
fn finite_differences_have_a_window_that_precision_widens() {
    let rows = rows(&written(&["mandelbulb", "--kind", "step-size", "--rays", "200", "--size", "160x90"], "s.csv"));
    let usable = |precision: &str| rows.iter().filter(|r| r["precision"] == precision && r["usable"] == "1").count();
    assert!(usable("f32") > 3 && usable("f64") > usable("f32") + 8, "{} {}", usable("f32"), usable("f64"));
}

#[test]
fn single_precision_ends_before_double() {
    let rows = rows(&written(&["mandelbulb", "--kind", "depth", "--decades", "8", "--rays", "200"], "d.csv"));
    let error = |precision: &str, zoom: f64| {
        let row = rows.iter().find(|r| r["precision"] == precision && r["zoom"].parse::<f64>().unwrap() == zoom);
        row.expect("the zoom is there")["median_error_footprints"].parse::<f64>().unwrap()
    };
    assert!(error("f32", 1e8) > 1.0 && error("f64", 1e8) < 0.5);
}

#[test]
fn bad_input_is_told_and_writes_nothing() {
    let cases: [(&[&str], &str); 6] = [
        (&["mandelbulb", "-o", "x.gif"], "must end in .svg, .png or .csv"),
        (&["mandelbulb", "-o", "none/x.svg"], "there is no folder none"),
        (&["mandelbulp"], "mandelbulb"),
        (&["mandelbulb", "--fudge", "0,1"], "above 0 and at most 1"),
        (&["mandelbulb", "--rays", "3"], "16"),
        (&["mandelbulb", "--fudge", "x"], "not a number"),
    ];
    for (arguments, expected) in cases {
        let folder = folder();
        let output = chart(folder.path(), arguments);
        let stderr = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(expected), "{stderr}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
