//! Finding formulas by group, text and property, and starting from one of them.

use std::path::Path;

use serde_json::Value;

use crate::support::{bulbfold, folder, stderr, stdout};

fn listed(arguments: &[&str], kind: &str) -> Vec<String> {
    let output = bulbfold(Path::new("."), [&["list", "--json"], arguments].concat());
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    let list: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let names = list[kind].as_array().expect("a list").iter();
    names.map(|entry| entry["name"].as_str().expect("a name").to_string()).collect()
}

fn has(names: &[String], name: &str) -> bool {
    names.iter().any(|known| known == name)
}

#[test]
fn properties_select_what_has_them() {
    let conformal = listed(&["--conformal"], "fractals");
    assert!(
        has(&conformal, "mandelbox") && has(&conformal, "menger") && !has(&conformal, "mandelbulb"),
        "{conformal:?}"
    );
    let four = listed(&["--dimension", "4"], "fractals");
    assert!(has(&four, "mandelbox_4d") && !has(&four, "mandelbulb"), "{four:?}");
    let exact = listed(&["--exact"], "steps");
    assert!(has(&exact, "box_fold") && !has(&exact, "bulb_power"), "{exact:?}");
    let chosen = listed(&["--chosen", "scalar"], "fractals");
    assert!(has(&chosen, "mandelbulb") && !has(&chosen, "mandelbox"), "{chosen:?}");
    let own = listed(&["--estimate", "gradient"], "fractals");
    assert!(has(&own, "mandelbulb"), "{own:?}");
}

#[test]
fn conditions_are_combined() {
    let bulbs = listed(&["--group", "Bulbs", "--years", "2009..2009", "--inventor", "white"], "fractals");
    assert!(has(&bulbs, "mandelbulb"), "{bulbs:?}");
    assert!(!has(&listed(&["--group", "bulbs", "--years", "2010"], "fractals"), "mandelbulb"));
    assert!(listed(&["--group", "bulbs", "--conformal"], "fractals").iter().all(|name| name != "mandelbulb"));
    assert!(listed(&["--only", "steps"], "fractals").is_empty());
}

#[test]
fn mistakes_are_told_with_the_closest_name() {
    for (arguments, message) in [
        (vec!["list", "--group", "blubs"], "did you mean `bulbs`?"),
        (vec!["list", "--years", "2012..2009"], "2012 comes after 2009"),
        (vec!["list", "--dimension", "5"], "5"),
        (vec!["list", "nothing_has_this_name", "--exact"], "nothing matches"),
    ] {
        let output = bulbfold(Path::new("."), &arguments);
        let text = stderr(&output);
        assert!(output.status.code() == Some(2) && text.contains(message), "{arguments:?}: {text}");
    }
}

#[test]
fn new_files_start_from_any_step_or_fractal() {
    let folder = folder();
    for (name, from, file) in [("my_box", "mandelbox", "my_box.ron"), ("my_fold", "box_fold", "my_fold.rhai")] {
        let output = bulbfold(folder.path(), ["new", name, "--from", from]);
        assert!(output.status.success(), "{}", stderr(&output));
        let text = std::fs::read_to_string(folder.path().join(file)).expect("the file was written");
        assert!(text.lines().next().is_some_and(|line| line.contains(&format!("`{from}`"))), "{text}");
        // It is not overwritten.
        let output = bulbfold(folder.path(), ["new", name, "--from", from]);
        assert_eq!(output.status.code(), Some(2));
        assert_eq!(std::fs::read_to_string(folder.path().join(file)).expect("it is there"), text);
        let output = bulbfold(folder.path(), ["test", file, "--no-gpu"]);
        assert!(output.status.success(), "{}", stdout(&output));
    }
    let output = bulbfold(folder.path(), ["new", "a", "--from", "mandelbx"]);
    assert!(stderr(&output).contains("did you mean `mandelbox`?"));
}
