//! What formula files say beside steps and wires: values of four components, start points, escape tests, and colours. Known
//! answers are plain arithmetic.

use bulbfold::check::{Formula, Options, run_graph};
use bulbfold::diag::Diagnostics;
use bulbfold::formula::library::Library;
use bulbfold::graph::{Escape, Method};
use bulbfold::load::load_text;

use crate::support::formula;

fn message(text: &str) -> String {
    Formula::from_ron(text).err().unwrap_or_else(|| panic!("it is taken: {text}")).to_string()
}

fn near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{found:?}, expected {expected:?}");
    let close = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-9 * b.abs().max(1.0));
    assert!(close, "{found:?}, expected {expected:?}");
}

/// A quaternion's orbit of z^2 + c, by its components.
fn quaternion_orbit(mut z: [f64; 4], c: [f64; 4], count: u32) -> [f64; 4] {
    for _ in 0..count {
        let [x, y, k, w] = z;
        z = [x * x - y * y - k * k - w * w + c[0], 2.0 * x * y + c[1], 2.0 * x * k + c[2], 2.0 * x * w + c[3]];
    }
    z
}

const C: [f64; 4] = [-0.2, 0.4, -0.4, -0.3];
const P: [f64; 3] = [0.11, -0.23, 0.31];

fn quaternion(fields: &str) -> String {
    format!(
        r#"(nodes: {{ "square": quaternion_square() }}, output: "square", escape_radius: 10.0, max_iterations: 12, {fields})"#
    )
}

#[test]
fn a_julia_constant_may_have_four_components() {
    for form in ["Julia((-0.2, 0.4, -0.4, -0.3))", "Julia([-0.2, 0.4, -0.4, -0.3])", "Julia(-0.2, 0.4, -0.4, -0.3)"] {
        for (slice, w) in [("", 0.0), ("slice: 0.25,", 0.25)] {
            let found = formula(&quaternion(&format!("constant: {form}, {slice}"))).orbit(P, 3);
            near(&found, &quaternion_orbit([P[0], P[1], P[2], w], C, 3));
        }
    }
}

#[test]
fn a_mixed_constant_may_have_four_components() {
    let found = formula(&quaternion("constant: Mix(julia: (-0.2, 0.4, -0.4, -0.3), amount: 0.75),")).orbit(P, 3);
    let c = [0, 1, 2].map(|i| 0.25 * P[i] + 0.75 * C[i]);
    near(&found, &quaternion_orbit([P[0], P[1], P[2], 0.0], [c[0], c[1], c[2], 0.75 * C[3]], 3));
}

#[test]
fn an_item_a_preset_and_an_override_may_set_four_components() {
    let item = r#"(nodes: { "square": quaternion_square(), "one": Item(of: "square", constant: Julia((-0.2, 0.4, -0.4, -0.3))) },
        output: "one", slice: 0.5, max_iterations: 9)"#;
    let expected = quaternion_orbit([P[0], P[1], P[2], 0.5], C, 2);
    near(&formula(item).orbit(P, 2), &expected);
    let preset = quaternion(r#"slice: 0.5, presets: { "a": (set: { "constant": Julia((-0.2, 0.4, -0.4, -0.3)) }) }"#);
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    let set = |path: &str, value: &str| vec![(path.to_string(), value.to_string())];
    for changes in [set("preset", "a"), set("constant", "Julia((-0.2, 0.4, -0.4, -0.3))")] {
        let loaded = load_text(&mut library, "four.ron", &preset, &changes, &mut d);
        let graph = loaded.unwrap_or_else(|| panic!("{}", d.render(&library.sources, false))).graph;
        assert_eq!(graph.orbit.constant, bulbfold::graph::Constant::Julia(C));
    }
}

#[test]
fn a_script_may_give_four_components() {
    let script = r#"#{ nodes: #{ square: quaternion_square() }, output: "square", max_iterations: 8, escape: Sum(10.0),
        constant: Julia([-0.2, 0.4, -0.4, -0.3]),
        tests: [Inside([0.0, 0.0, 0.0, 0.1]), Outside([2.0, 0.0, 0.0, 0.1])] }"#;
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    let graph = load_text(&mut library, "four.rhai", script, &[], &mut d).map(|loaded| loaded.graph);
    let graph = graph.unwrap_or_else(|| panic!("{}\n{script}", d.render(&library.sources, false)));
    assert_eq!(graph.orbit.constant, bulbfold::graph::Constant::Julia(C));
    let report = run_graph(&library, &graph, "four", &Options::default());
    assert!(report.is_ok(), "{report}");
}

#[test]
fn tests_look_at_points_of_four_components() {
    let after = quaternion_orbit([0.11, -0.23, 0.31, 0.2], [0.11, -0.23, 0.31, 0.2], 2);
    let tests = format!(
        "tests: [Inside((0, 0, 0, 0.1)), Outside((0, 0, 0, 2.5)), Outside((0.3, 0.0, 0.0, 0.8)), Inside((0.3, 0.0, 0.0, 0.0)),
            Orbit(point: (0.11, -0.23, 0.31, 0.2), iterations: 2, expect: ({}, {}, {}, {})),
            Ray(origin: (0, 0, 5, 9), direction: (0, 0, -1), misses: true)]",
        after[0], after[1], after[2], after[3]
    );
    formula(&quaternion(&tests)).assert_tests();
}

#[test]
fn a_placement_and_a_translation_move_the_fourth_component() {
    let placed = r#"(nodes: { "square": quaternion_square(), "moved": Transform(of: "square", translate: (1, 0, 0, -0.5), scale: 2.0) },
        output: "moved", escape_radius: 10.0, max_iterations: 12)"#;
    let sliced = quaternion("slice: 0.25,");
    let (placed, sliced) = (formula(placed), formula(&sliced));
    for p in [[0.7, 0.6, 0.1], [-0.4, 0.9, 0.8], [1.5, 0.2, -0.3]] {
        let (found, expected) = (
            placed.estimate([1.0 + 2.0 * p[0], 2.0 * p[1], 2.0 * p[2]], Method::Scalar),
            sliced.estimate(p, Method::Scalar),
        );
        assert!((found - 2.0 * expected).abs() < 1e-9, "{found}, expected twice {expected}");
    }
    let stepped = formula(
        r#"(nodes: { "a": Sequence([quaternion_square(), translate(offset: (0.1, 0.2, 0.3, 0.4))]) }, output: "a", constant: Off, max_iterations: 4)"#,
    );
    near(&stepped.orbit(P, 2), &quaternion_orbit([P[0], P[1], P[2], 0.0], [0.1, 0.2, 0.3, 0.4], 2));
}

#[test]
fn three_components_refuse_four() {
    let bulb = |fields: &str| format!(r#"(nodes: {{ "bulb": bulb_power() }}, output: "bulb", {fields})"#);
    for fields in [
        "constant: Julia((0.1, 0.2, 0.3, 0.4))",
        "constant: Mix(julia: (0.1, 0.2, 0.3, 0.0), amount: 0.5)",
        "start: (0.1, 0.2, 0.3, 0.4)",
        "escape: Above(\"w\", 4.0)",
        "tests: [Inside((0, 0, 0, 0.1))]",
    ] {
        let text = message(&bulb(fields));
        assert!(text.contains("three components") || text.contains("no orbit"), "{fields}: {text}");
        assert!(text.contains("formula.ron:1:"), "{fields}: {text}");
    }
    let moved =
        r#"(nodes: { "bulb": bulb_power(), "b": Transform(of: "bulb", translate: (0, 0, 0, 1)) }, output: "b")"#;
    assert!(message(moved).contains("three components"));
    let stepped = r#"(nodes: { "a": Sequence([translate(offset: (0, 0, 0, 1)), bulb_power()]) }, output: "a")"#;
    assert!(message(stepped).contains("three components"));
}

/// From 0 the first iteration of a map that leaves 0 where it is gives c: one iteration more than from the point itself.
#[test]
fn an_orbit_from_zero_is_that_of_the_point_one_iteration_later() {
    for (node, radius) in
        [("quaternion_square()", 10.0), ("bulb_power(power: 8.0)", 10.0), ("quaternion_power(power: 3)", 10.0)]
    {
        let made = |fields: &str| {
            formula(&format!(r#"(nodes: {{ "a": {node} }}, output: "a", escape_radius: {radius:?}, {fields})"#))
        };
        let (from_zero, from_point) = (made("start: (0, 0, 0), max_iterations: 9"), made("max_iterations: 8"));
        near(&from_zero.orbit(P, 4), &from_point.orbit(P, 3));
        let applicable = |formula: &Formula| formula.plan().choices[0].applicable.clone();
        assert_eq!(applicable(&from_zero), applicable(&from_point), "{node}");
        for method in applicable(&from_point) {
            for p in [[0.9, 0.6, 0.4], [1.1, -0.3, 0.5], [-0.9, 0.9, 0.2], [0.2, 1.0, -0.7]] {
                let (found, expected) = (from_zero.estimate(p, method), from_point.estimate(p, method));
                assert!(expected > 0.0, "{node} {method:?} at {p:?}: {expected}");
                assert!(
                    (found - expected).abs() <= 1e-6 * expected,
                    "{node} {method:?} at {p:?}: {found}, not {expected}"
                );
                assert_eq!(from_zero.inside(p), from_point.inside(p));
            }
        }
    }
}

#[test]
fn a_start_of_four_components_is_followed() {
    let found = formula(&quaternion("start: (0.1, 0.2, -0.1, 0.3), slice: 0.2,")).orbit(P, 3);
    near(&found, &quaternion_orbit([0.1, 0.2, -0.1, 0.3], [P[0], P[1], P[2], 0.2], 3));
}

#[test]
fn starts_agree_on_all_back_ends() {
    let tests = "tests: [AgreesOnBackends, NeverAbove(factor: 0.1)]";
    formula(&quaternion(&format!("start: (0.05, 0.1, 0.0), {tests}"))).assert_tests();
}

#[test]
fn a_start_needs_a_constant_that_moves() {
    for constant in ["Off", "Julia((0.1, 0.2, 0.3))", "Mix(julia: (0, 0, 0), amount: 1.0)"] {
        let text = message(&quaternion(&format!("start: (0, 0, 0), constant: {constant},")));
        assert!(text.contains("the same for every point"), "{text}");
    }
    // One iteration that adds the point is enough.
    let text = r#"(nodes: { "a": quaternion_square(), "b": Item(of: "a", constant: Mandelbrot), "c": Alternate(["b", "a"]) },
        output: "c", start: (0, 0, 0), constant: Off, max_iterations: 6)"#;
    near(&formula(text).orbit(P, 1), &P);
}

/// A scaling by 2 in five iterations, with an escape test: the set is what the test leaves, a 32nd as large.
fn scaling(escape: &str, estimate: &str) -> Formula {
    formula(&format!(
        r#"(nodes: {{ "grow": scale(scale: 2.0) }}, output: "grow", constant: Off, max_iterations: 5, bounding_radius: 3.0,
            escape: {escape}, estimate: ({estimate}), tests: [AgreesOnBackends, NeverAbove(factor: 0.001)])"#
    ))
}

/// How far the first point is from each set that escape tests leave; 0 inside.
type Away = fn([f64; 3]) -> f64;

const TESTS: [(&str, &str, f64, Away); 6] = [
    ("Length(4.0)", "radius: 4.0", 1.0, |p| p.iter().map(|x| x * x).sum::<f64>().sqrt() - 0.125),
    ("Largest(4.0)", "radius: 4.0", 1.0, |p| p.iter().fold(0.0, |a: f64, x| a.max(x.abs())) - 0.125),
    ("Sum(4.0)", "radius: 2.3094010767585034", 3.0, |p| p.iter().map(|x| x.abs()).sum::<f64>() - 0.125),
    ("Above(\"x\", 4.0)", "radius: 4.0", 1.0, |p| p[0] - 0.125),
    ("Below(\"y\", -2.0)", "radius: 2.0", 1.0, |p| -p[1] - 0.0625),
    ("Plane(normal: (3, 0, 4), offset: 4.0)", "radius: 4.0", 1.0, |p| 0.6 * p[0] + 0.8 * p[2] - 0.125),
];

const POINTS: [[f64; 3]; 5] =
    [[0.5, -0.3, 0.2], [0.13, -0.07, 0.11], [0.12, 0.05, -0.04], [1.9, -1.1, 0.7], [0.2, -0.19, 0.21]];

/// Where an orbit escapes, the test's size is above its bound by as much as the point is beyond the set, times the stretch.
#[test]
fn escape_tests_leave_boxes_and_half_spaces() {
    for (escape, radius, of_sum, away) in TESTS {
        let formula = scaling(escape, &format!("form: linear, {radius}"));
        for p in POINTS {
            let away = away(p);
            assert_eq!(formula.inside(p), away <= 0.0, "{escape} at {p:?}");
            if away <= 0.0 {
                continue;
            }
            // The sum of sizes changes by the root of 3 times as much as z.
            let truth = away / f64::sqrt(of_sum);
            for method in formula.plan().choices[0].applicable.clone() {
                let found = formula.estimate(p, method);
                let is_loose = method.is_certified() || method == Method::Frobenius;
                assert!(found <= truth * 1.0001, "{escape} {method:?} at {p:?}: {found} is above {truth}");
                assert!(found > 0.0, "{escape} {method:?} at {p:?}");
                // In the last iteration all of the set is as large as the bound: then distances are exact.
                let last = away <= 0.125 && !is_loose && method != Method::Directional && method != Method::DeltaRay;
                let allowed = if method.is_difference() { 1e-3 } else { 1e-9 };
                assert!(
                    !last || (found - truth).abs() <= allowed * truth,
                    "{escape} {method:?} at {p:?}: {found}, {truth}"
                );
            }
        }
    }
}

#[test]
fn escape_tests_agree_on_all_back_ends_and_never_overestimate() {
    for (escape, radius, ..) in TESTS {
        scaling(escape, &format!("form: linear, {radius}")).assert_tests();
    }
    scaling("Beyond(\"x\", 4.0)", "form: linear, radius: 4.0").assert_tests();
}

/// A scaling by a half in three iterations, which ends where z is below a tenth or moves by less: outside is a ball of 0.8.
#[test]
fn convergence_leaves_what_does_not_come_near() {
    for (escape, ratio) in [("Near((0.0, 0.0, 0.0), 0.1)", 1.0), ("Still(0.1)", 1.0)] {
        let formula = formula(&format!(
            r#"(nodes: {{ "shrink": scale(scale: 0.5) }}, output: "shrink", constant: Off, max_iterations: 3, bounding_radius: 2.0,
                escape: {escape}, tests: [AgreesOnBackends, NeverAbove(factor: 0.001)])"#
        ));
        for r in [0.75, 0.6, 0.45] {
            let p = [0.6 * r, 0.0, -0.8 * r];
            assert!(!formula.inside(p));
            for method in formula.plan().choices[0].applicable.clone() {
                let found = formula.estimate(p, method);
                assert!(found > 0.0 && found <= (0.8 - r) * ratio * 1.0001, "{escape} {method:?} at {r}: {found}");
                if matches!(method, Method::Gradient | Method::Jacobian) {
                    assert!((found - (0.8 - r)).abs() < 1e-9, "{escape} {method:?} at {r}: {found}");
                }
            }
        }
        assert!(formula.inside([0.9, 0.0, 0.0]) && !formula.inside([0.0, 0.0, 0.0]));
        let proves = formula.plan().choices[0].applicable.contains(&Method::Certified);
        assert_eq!(proves, escape.starts_with("Near"), "how far an orbit moves is followed by no proof");
        formula.assert_tests();
    }
}

/// Of a quaternion square orbits are outside by their x where they are by their length, an iteration or two later.
#[test]
fn a_coordinate_ends_orbits_of_a_power() {
    let by = |escape: &str| formula(&quaternion(&format!("{escape},")).replace("escape_radius: 10.0,", ""));
    let (x, y) = (by("constant: Off, escape: Above(\"x\", 4.0)"), by("constant: Off, escape: Above(\"y\", 4.0)"));
    // (2.5, 0.1, 0) squared is (6.24, 0.5, 0).
    let p = [2.5, 0.1, 0.0];
    assert!(!x.inside(p) && !y.inside(p));
    let rate = |formula: &Formula| formula.estimate(p, Method::Gradient);
    assert!(rate(&x) > 0.0 && rate(&y) > 0.0);
    let formula = by("escape: Largest(10.0), tests: [AgreesOnBackends, NeverAbove(factor: 0.1)]");
    formula.assert_tests();
    let by_length = by("escape_radius: 10.0");
    for p in [[0.9, 0.6, 0.4], [1.1, -0.3, 0.5], [-0.9, 0.9, 0.2]] {
        let (found, expected) = (formula.estimate(p, Method::Gradient), by_length.estimate(p, Method::Gradient));
        assert!((found - expected).abs() < 0.05 * expected, "{found}, {expected}");
    }
}

/// Bounds are no smaller than sets whose orbits end otherwise: half spaces go on, and an orbit from elsewhere may come back.
#[test]
fn bounds_hold_members_of_other_tests_and_starts() {
    let beyond = formula(
        r#"(nodes: { "a": quaternion_square() }, output: "a", constant: Off, escape: Above("x", 4.0), max_iterations: 1)"#,
    );
    let p = [0.0, 40.0, 0.0];
    assert!(beyond.inside(p) && beyond.plan().bounding_radius > 40.0, "{}", beyond.plan().bounding_radius);
    // From (4, 0, 0) the first iteration gives 16 + c: members lie around (-16, 0, 0).
    let started = formula(
        r#"(nodes: { "a": quaternion_square() }, output: "a", start: (4, 0, 0), escape_radius: 20.0, max_iterations: 2)"#,
    );
    let member = [-16.0, 0.0, 0.0];
    assert!(started.inside(member) && started.plan().bounding_radius >= 16.0, "{}", started.plan().bounding_radius);
}

#[test]
fn escape_tests_that_cannot_be_are_refused() {
    for (fields, expected) in [
        ("escape: Above(\"q\", 4.0)", "not a coordinate"),
        ("escape: Above(4.0)", "expected an escape test"),
        ("escape: Plane(normal: (0, 0, 0), offset: 1.0)", "a direction cannot be"),
        ("escape: Largest(-1.0)", "the value"),
        ("escape: Still(0.1), post: [scale()]", "convergence"),
        ("escape: Largest(4.0), max_iterations: 3, end: Box()", ""),
    ] {
        let text = quaternion(fields).replace("escape_radius: 10.0, max_iterations: 12,", "");
        match expected {
            "" => assert!(Formula::from_ron(&text).is_ok(), "{fields}"),
            expected => assert!(message(&text).contains(expected), "{fields}: {}", message(&text)),
        }
    }
    assert!(message(&quaternion("escape: Largest(4.0)")).contains("these are two"));
}

/// An override of one spelling leaves out the other.
#[test]
fn an_override_sets_the_escape_test_alone() {
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    for (path, value, expected) in
        [("escape", "Largest(4.0)", (Escape::Largest, 4.0)), ("escape_radius", "5.0", (Escape::Length, 5.0))]
    {
        let text = if path == "escape" {
            quaternion("")
        } else {
            quaternion("").replace("escape_radius: 10.0", "escape: Sum(9.0)")
        };
        let loaded = load_text(&mut library, "set.ron", &text, &[(path.to_string(), value.to_string())], &mut d);
        let orbit = loaded.unwrap_or_else(|| panic!("{}", d.render(&library.sources, false))).graph.orbit.clone();
        assert_eq!((orbit.escape, orbit.escape_radius), expected);
    }
}
