//! A step of a user's own is one file: it loads beside a formula, runs everywhere and needs no rebuild.

use std::path::Path;

use bulbfold::check::{Backends, Formula, Options, Target, run_paths};
use bulbfold::formula::library::Library;
use bulbfold::graph::Method;

use crate::support::folder_with;

/// The "box bulb" of nobody: a squaring of x + iy with z folded at a height. Not among the built-in steps.
const STEP: &str = r#"
// Squares x + i y and mirrors z down at a height.
fn step(z, c, p) {
    let height = select(z.z > p.height, 2.0 * p.height - z.z, z.z);
    vec3(z.x * z.x - z.y * z.y, 2.0 * z.x * z.y, height * p.stretch)
}

#{
    group: "power",
    summary: "Squares the plane and mirrors the height.",
    source: "A test",
    growth: "power",
    params: [
        #{ name: "height", type: "float", "default": 0.5, min: 0.0, max: 4.0, unit: "formula units", help: "Where z is mirrored." },
        #{ name: "stretch", type: "float", "default": 1.5, min: 0.0, max: 4.0, help: "Factor of z." },
    ],
    examples: [
        #{ z: [2.0, 1.0, 0.25], expect: [3.0, 4.0, 0.375] },
        #{ z: [0.0, 1.0, 1.0], params: #{ stretch: 2.0 }, expect: [-1.0, 0.0, 0.0] },
    ],
}
"#;

const GRAPH: &str = r#"(
    params: { "lift": (default: 0.5, min: 0, max: 1, help: "Mirror height") },
    nodes: { "mine": plane_square(height: "lift") },
    output: "mine", escape_radius: 20, max_iterations: 8,
    tests: [
        Inside((0, 0, 0)), Outside((3, 0, 0)), AgreesOnBackends, Symmetric(Mirror("y")),
        Orbit(point: (2, 1, 0.25), iterations: 1, expect: [5, 5, 0.625]),
    ],
)"#;

fn folder() -> tempfile::TempDir {
    folder_with(&[("plane_square.rhai", STEP), ("mine.ron", GRAPH)])
}

fn open(folder: &Path) -> Formula {
    Formula::open(folder.join("mine.ron")).unwrap()
}

#[test]
fn loads_and_describes_itself() {
    let folder = folder();
    let formula = open(folder.path());
    let step = formula.library().step("plane_square").expect("found beside the formula");
    assert_eq!(step.summary, "Squares the plane and mirrors the height.");
    assert_eq!(step.params[0].unit, "formula units");
    assert!(step.params.iter().all(|p| !p.help.is_empty()));
}

#[test]
fn runs_on_every_back_end_and_has_a_gradient() {
    let folder = folder();
    let formula = open(folder.path());
    formula.wgsl();
    assert_eq!(formula.plan().choices[0].method, Method::Gradient, "{:?}", formula.plan().choices[0].reason);
    // Away from the crease the estimate is r ln r / 2 |grad r|; finite differences must see the same slope.
    let point = [1.7, 0.3, 0.1];
    let (exact, delta) = (formula.estimate(point, Method::Gradient), formula.estimate(point, Method::Delta));
    assert!(exact > 0.0 && (exact - delta).abs() < 0.05 * exact, "{exact} {delta}");
    let subject = formula.subject();
    let kernel = subject.estimator(&subject.plan.choices).unwrap_or_else(|e| panic!("{}", e.message));
    let backends = Backends::cpu_only();
    let [wide, single] = [Target::CPU_F64, Target::CPU_F32]
        .map(|target| subject.estimates(&backends, target, &kernel, &[point]).unwrap()[0].0);
    assert!((wide - single).abs() < 1e-4 * wide, "{wide} {single}");
}

#[test]
fn its_tests_and_examples_run() {
    let folder = folder();
    let report = run_paths(&mut Library::builtin(), &[folder.path().to_path_buf()], &Options::default());
    assert!(report.is_ok(), "\n{report}");
    let names: Vec<&str> = report.outcomes.iter().map(|o| o.name.as_str()).collect();
    assert!(names.contains(&"mine.ron::inside(0, 0, 0)::cpu_f32"), "{names:?}");
    assert!(names.contains(&"plane_square.rhai::example 2::cpu_f64"), "{names:?}");
    assert!(names.contains(&"plane_square.rhai::derivative::cpu_f64"), "{names:?}");
    open(folder.path()).assert_tests();
}

#[test]
fn failures_show_both_values_and_the_line() {
    let folder = folder();
    let wrong_step = STEP.replace("expect: [3.0, 4.0, 0.375]", "expect: [3.0, 4.5, 0.375]");
    std::fs::write(folder.path().join("plane_square.rhai"), wrong_step).unwrap();
    std::fs::write(folder.path().join("mine.ron"), GRAPH.replace("Outside((3, 0, 0))", "Inside((3, 0, 0))")).unwrap();
    std::fs::write(folder.path().join("broken.ron"), "(nodes: { \"a\": no_such_step() })").unwrap();
    let report = run_paths(&mut Library::builtin(), &[folder.path().to_path_buf()], &Options::default());
    let text = report.to_string();
    assert!(text.contains("[3.0, 4.5, 0.375]") && text.contains("[3.0, 4.0, 0.375]"), "{text}");
    assert!(text.contains("plane_square.rhai:18"), "{text}");
    assert!(text.contains("mine.ron::inside(3, 0, 0)::cpu_f64 ... FAILED") && text.contains("mine.ron:6"), "{text}");
    assert!(text.contains("unknown step or node kind `no_such_step`"), "{text}");
    assert!(text.contains("test result: FAILED."), "{text}");
}

#[test]
fn filter_keeps_what_it_names() {
    let folder = folder();
    let options = Options { filter: Some("orbit(".into()), gpu: false };
    let report = run_paths(&mut Library::builtin(), &[folder.path().to_path_buf()], &options);
    assert_eq!(report.outcomes.len(), 2, "{report}");
}

#[test]
fn undifferentiable_step_falls_back_to_differences() {
    let folder = folder();
    let text = STEP.replace("growth: \"power\",", "growth: \"power\", differentiable: false,");
    std::fs::write(folder.path().join("plane_square.rhai"), text).unwrap();
    let formula = open(folder.path());
    let choice = &formula.plan().choices[0];
    assert_eq!(choice.method, Method::Delta);
    assert!(choice.reason.contains("`plane_square` cannot be differentiated"), "{}", choice.reason);
    assert!(formula.chosen_estimate([2.0, 0.0, 0.0]) > 0.0);
    let report = run_paths(&mut Library::builtin(), &[folder.path().to_path_buf()], &Options::default());
    assert!(report.is_ok(), "\n{report}");
}
