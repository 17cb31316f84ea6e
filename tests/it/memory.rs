//! Steps that remember, wherever they stand: Fibonacci's numbers by hand, on every back end and by every method.

use std::path::Path;

use bulbfold::check::{Formula, Target};
use bulbfold::graph::Method;

use crate::support::folder;

/// Adds what it had before, so that a point goes to 1, 2, 3, 5, 8 ... times itself.
const STEP: &str = r#"
// Adds what the state was the last time.
fn step(z, c, p, before) {
    z + before
}

fn derivative(z, dr, p, before, before_dr) {
    dr + before_dr
}

#{
    group: "transform",
    summary: "Adds what the state was before.",
    source: "A test",
    growth: "linear",
    scalar_rule: "exact",
    params: [],
    examples: [#{ z: [1.0, 2.0, 3.0], before: [1.0, 1.0, 1.0], expect: [2.0, 3.0, 4.0] }],
}
"#;

/// A graph of these nodes beside the step.
fn open(folder: &Path, graph: &str) -> Formula {
    std::fs::write(folder.join("fibonacci.rhai"), STEP).unwrap();
    std::fs::write(folder.join("mine.ron"), graph).unwrap();
    Formula::open(folder.join("mine.ron")).unwrap()
}

/// The nodes, and the factors by which a point on the x axis at 1 grows after each iteration.
fn cases() -> Vec<(&'static str, Vec<f64>)> {
    vec![
        // Two steps an iteration: every second number.
        (r#""map": Repeat(of: "add", times: 2)"#, vec![2.0, 5.0, 13.0, 34.0]),
        // 2; doubled; then 4 + 1 (what went in the last time) and 5 + 4; doubled; 18 + 5 and 23 + 18.
        (
            r#""twice": Repeat(of: "add", times: 2), "map": Alternate([("twice", 1), ("double", 1)])"#,
            vec![2.0, 4.0, 9.0, 18.0, 41.0],
        ),
        // The same node in two places remembers once: 1 and 2, doubled, 4 + 1.
        (r#""map": Sequence(["add", "add", "double", "add"])"#, vec![5.0]),
        // Up to radius 3 it adds; what is halved leaves the memory as it is: 1, 2, 3, 1.5, 1.5 + 2, 1.75, 1.75 + 1.5.
        (
            r#""map": Choose(when: RadiusBelow(2.999), then: "add", otherwise: "half")"#,
            vec![1.0, 2.0, 3.0, 1.5, 3.5, 1.75, 3.25],
        ),
        // It adds in both branches: 1, 2, 3, (3 + 2) / 4, 1.25 + 3, (4.25 + 1.25) / 4.
        (
            r#""less": Sequence(["add", "half", "half"]), "map": Choose(when: RadiusBelow(2.999), then: "add", otherwise: "less")"#,
            vec![1.0, 2.0, 3.0, 1.25, 4.25, 1.375],
        ),
        // The first two iterations double: 2, 4, then 4 + 0, 4 + 4, 8 + 4.
        (r#""map": Between(of: "double", from: 0, to: 2, otherwise: "add")"#, vec![2.0, 4.0, 4.0, 8.0, 12.0]),
    ]
}

const NODES: &str = r#""add": fibonacci(), "double": scale(scale: 2.0), "half": scale(scale: 0.5)"#;

#[test]
fn orbits_are_those_worked_out_by_hand() {
    let folder = folder();
    for (nodes, factors) in cases() {
        let tests: Vec<String> = (1..)
            .zip(&factors)
            .map(|(n, factor)| {
                format!("Orbit(point: (1.0, 0.0, 0.0), iterations: {n}, expect: [{factor:?}, 0.0, 0.0])")
            })
            .collect();
        let graph = format!(
            "(nodes: {{ {NODES}, {nodes} }}, output: \"map\", constant: Off, max_iterations: {}, tests: [{}])",
            factors.len(),
            tests.join(", ")
        );
        let report = open(folder.path(), &graph).run_tests();
        assert!(report.is_ok(), "{nodes}\n{report}");
        let ran = |target: Target| report.outcomes.iter().any(|outcome| outcome.name.ends_with(target.name()));
        assert!(ran(Target::CPU_F64) && ran(Target::CPU_F32), "{nodes}");
    }
}

/// The point, the factor of the first iteration beyond the escape radius, and that radius: the estimate is the way to the ball
/// of radius 1 over the factor.
fn escapes() -> Vec<(&'static str, f64, f64)> {
    let of = |case: usize| cases()[case].0;
    vec![(of(0), 13.0, 6.0), (of(1), 9.0, 4.5), (of(3), 3.5, 3.4), (of(4), 4.25, 3.4), (of(5), 8.0, 5.0)]
}

#[test]
fn every_method_and_back_end_has_the_exact_distance() {
    let folder = folder();
    let point = [1.02f64, 0.0, 0.0];
    for (nodes, factor, escape_radius) in escapes() {
        let expected = point[0] - 1.0 / factor;
        let methods = ["scalar", "gradient", "jacobian", "combined", "directional", "delta"];
        let test = |method: &str| {
            format!("Estimate(point: (1.02, 0.0, 0.0), method: \"{method}\", expect: {expected}, tolerance: 1e-3)")
        };
        let tests = methods.map(test).join(", ");
        let orbit = format!(
            "constant: Off, max_iterations: 12, escape_radius: {escape_radius:?}, estimate: (form: linear, radius: 1.0)"
        );
        let graph =
            format!("(nodes: {{ {NODES}, {nodes} }}, output: \"map\", {orbit}, tests: [{tests}, AgreesOnBackends])");
        let formula = open(folder.path(), &graph);
        let report = formula.run_tests();
        assert!(report.is_ok(), "{nodes}\n{report}");
        for method in [Method::Scalar, Method::Gradient] {
            assert!((formula.estimate(point, method) - expected).abs() < 1e-9, "{nodes} {method:?}");
        }
        // The same orbit as the end of one that changes nothing, where its iterations are unrolled.
        let graph = format!(
            "(nodes: {{ {NODES}, {nodes}, \"mirror\": abs_fold(), \"end\": Orbit(of: \"map\", {orbit}) }}, output: \"mirror\", \
             constant: Off, max_iterations: 1, end: \"end\", bounding_radius: 2.0, tests: [{}, {}])",
            test("scalar"),
            test("gradient")
        );
        let report = open(folder.path(), &graph).run_tests();
        assert!(report.is_ok(), "unrolled {nodes}\n{report}");
    }
}
