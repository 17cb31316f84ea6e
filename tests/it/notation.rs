//! Formulas in mathematical notation: known texts, and well-formed LaTeX for every step and fractal.

use std::path::Path;
use std::sync::Arc;

use bulbfold::check::is_conformal;
use bulbfold::expr::{Arena, notation};
use bulbfold::formula::embedded::FRACTALS;
use bulbfold::formula::library::Library;
use bulbfold::formula::written::written;

use crate::support::{bulbfold, stderr, stdout};

fn explain(arguments: &[&str]) -> String {
    let output = bulbfold(Path::new("."), [&["explain"], arguments].concat());
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    stdout(&output)
}

/// Every bracket is closed by its own kind, and as many `\left` as `\right`, environments by pairs.
fn assert_balanced(latex: &str, what: &str) {
    let mut open = Vec::new();
    for (i, c) in latex.char_indices().filter(|(i, _)| *i == 0 || !latex[..*i].ends_with('\\')) {
        match c {
            '{' => open.push(i),
            '}' => assert!(open.pop().is_some(), "{what}: a brace too many at {i}: {latex}"),
            _ => {}
        }
    }
    assert!(open.is_empty(), "{what}: a brace is open: {latex}");
    assert_eq!(latex.matches("\\left").count(), latex.matches("\\right").count(), "{what}");
    for environment in ["aligned", "cases", "pmatrix"] {
        let count = |word: &str| latex.matches(&format!("\\{word}{{{environment}}}")).count();
        assert_eq!(count("begin"), count("end"), "{what}: {environment}");
    }
    assert!(latex.is_ascii(), "{what}: LaTeX is ASCII: {latex}");
}

#[test]
fn well_known_steps_read_as_in_textbooks() {
    let library = Library::builtin();
    let text = |name: &str| {
        let arena = Arc::new(Arena::default());
        let step = library.step(name).expect("it is built in");
        let written = written(&library, step, &arena, &[]).unwrap_or_else(|error| panic!("{}", error.message));
        let rule = written.rule.map(|rule| notation::plain(&arena, &rule)).unwrap_or_default();
        (notation::plain(&arena, &written.value), rule, notation::latex(&arena, &written.value))
    };
    let (value, rule, latex) = text("box_fold");
    assert_eq!((value.as_str(), rule.as_str()), ("z' = 2 clamp(z, -limit, limit) - z\n", "dr' = dr\n"));
    assert!(latex.contains("\\mathbf{z}' &= 2\\,\\operatorname{clamp}\\left(\\mathbf{z}, -\\mathrm{limit}, \\mathrm{limit}\\right) - \\mathbf{z}"), "{latex}");
    let (value, rule, _) = text("scale");
    assert_eq!((value.as_str(), rule.as_str()), ("z' = scale z + (1 - scale) centre\n", "dr' = dr |scale|\n"));
    let (value, ..) = text("sphere_fold");
    assert!(value.contains("‖z‖²") && value.contains("min_radius") && value.contains("fixed_radius"), "{value}");
}

#[test]
fn latex_of_all_steps_and_fractals_is_balanced() {
    let library = Library::builtin();
    for step in library.steps() {
        let arena = Arc::new(Arena::default());
        let written =
            written(&library, step, &arena, &[]).unwrap_or_else(|error| panic!("{}: {}", step.name, error.message));
        for function in [Some(&written.value), written.rule.as_ref(), Some(&written.tangent)].into_iter().flatten() {
            assert_balanced(&notation::latex(&arena, function), &step.name);
            assert!(notation::plain(&arena, function).contains(" = "), "{}", step.name);
        }
    }
    for (name, _) in FRACTALS.iter().take(3) {
        let page = explain(&[name, "--latex"]);
        assert!(page.contains("\\begin{aligned}") && page.contains(&format!("docs/thumbnails/{name}.jpg")), "{page}");
    }
}

#[test]
fn hybrids_tell_their_schedule_and_every_iteration() {
    let page = explain(&["box_bulb"]);
    for part in
        ["Iteration A", "Iteration B", "alternating A, then B", "clamp(z, -limit, limit)", "z' = z + c", "escape test"]
    {
        assert!(page.contains(part), "{part} is missing: {page}");
    }
}

#[test]
fn what_keeps_angles_is_measured() {
    let library = Library::builtin();
    let is = |name: &str| is_conformal(&library, library.step(name).expect("it is built in"));
    for name in ["box_fold", "sphere_fold", "scale", "rotate", "menger_fold", "inversion"] {
        assert!(is(name), "{name} is conformal away from its creases");
    }
    for name in ["bulb_power", "quaternion_square"] {
        assert!(!is(name), "{name} is not conformal");
    }
}
