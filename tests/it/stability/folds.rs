//! Folds: their planes and radii, jumps, and scales that hardly grow.

use super::suite::{P, all_sound, answers, sound_answers};
use bulbfold::check::{Formula, Random, Target};

use crate::support::{folder, formula};

fn boxed(scale: f64, rest: &str) -> String {
    format!(
        r#"(nodes: {{ "fold": box_fold(), "ball": sphere_fold(), "grow": scale(scale: {scale:?}),
            "all": Sequence(["fold", "ball", "grow"]) }}, output: "all", {rest})"#
    )
}

/// Checks that the answers on a set of points are those of one side or between both.
fn between(text: &str, on: &[P], side: impl Fn(P, f64) -> P) {
    let formula = formula(text);
    let delta = 1e-7;
    let sides = [-delta, delta].map(|by| answers(&formula, &on.iter().map(|p| side(*p, by)).collect::<Vec<_>>()));
    for ((found, before), after) in answers(&formula, on).into_iter().zip(&sides[0]).zip(&sides[1]) {
        let answer = found.sound();
        // Sides of single precision may be the same point; its rounding is what the slack is for.
        let slack = 2e-5 + answer.slack();
        let (low, high) = (before.de.min(after.de), before.de.max(after.de));
        assert!(
            low * (1.0 - slack) <= answer.de && answer.de <= high * (1.0 + slack),
            "{before:?} {answer:?} {after:?}"
        );
    }
}

const BOX: &str =
    "escape_radius: 60, max_iterations: 10, bounding_radius: 12, estimate: (form: linear, radius: 10.3923048)";

pub fn fold_planes() {
    let mut random = Random::new(3);
    for axis in 0..3 {
        for plane in [1.0, -1.0] {
            let points: Vec<P> = (0..6)
                .map(|_| {
                    let mut p = [0; 3].map(|_| random.range(6.5, 9.0));
                    p[axis] = plane;
                    p
                })
                .collect();
            let side = |p: P, by: f64| {
                let mut p = p;
                p[axis] += by;
                p
            };
            between(&boxed(2.0, BOX), &points, side);
        }
    }
}

pub fn sphere_fold_radii() {
    // One step alone: the sphere fold's radii 1/2 and 1 are those of p itself. Scale 3 escapes from everywhere but 0.
    let text = r#"(nodes: { "ball": sphere_fold(min_radius: 0.5, fixed_radius: 1), "grow": scale(scale: 3),
        "all": Sequence(["ball", "grow"]) }, output: "all", constant: Off, escape_radius: 60, max_iterations: 20,
        bounding_radius: 4, estimate: (form: linear, radius: 0))"#;
    let directions = [[1.0, 0.0, 0.0], [0.0, -0.6, 0.8], [0.6, 0.0, -0.8], [0.48, 0.6, 0.64]];
    let points: Vec<P> = [0.5, 1.0].iter().flat_map(|r| directions.map(|d: P| d.map(|x| x * r))).collect();
    between(text, &points, |p, by| p.map(|x| x * (1.0 + by)));
    // Inside the inner radius the factor is 4 until r passes 1/2: from there on it is all scaling.
    for answer in sound_answers(text, &[[0.1, 0.0, 0.0], [0.0, 0.03, 0.0], [2.0, 0.0, 0.0]]) {
        assert!(!answer.inside && answer.de <= super::suite::length(answer.p) * (1.0 + answer.slack()), "{answer:?}");
    }
}

pub fn equal_coordinates() {
    let systems = [
        (r#""fold": menger_fold(), "grow": scale(scale: 3, centre: (1, 1, 1))"#, 3f64.sqrt()),
        (r#""fold": tetra_fold(), "grow": scale(scale: 2, centre: (1, 1, 1))"#, 3f64.sqrt()),
    ];
    for (nodes, radius) in systems {
        let text = format!(
            r#"(nodes: {{ {nodes}, "all": Sequence(["fold", "grow"]) }}, output: "all", constant: Off,
                escape_radius: 50, max_iterations: 12, bounding_radius: 4, estimate: (form: linear, radius: {radius}))"#
        );
        for answer in sound_answers(&text, &[[2.0; 3], [1.5; 3], [1.1; 3], [4.0; 3]]) {
            assert!(!answer.inside);
            answer.is((answer.p[0] - 1.0) * 3f64.sqrt());
        }
    }
}

/// A formula file with steps of its own beside it.
fn with_steps(steps: &[(&str, &str)], text: &str) -> (tempfile::TempDir, Formula) {
    let folder = folder();
    for (name, step) in steps {
        std::fs::write(folder.path().join(format!("{name}.rhai")), step).unwrap();
    }
    let path = folder.path().join("formula.ron");
    std::fs::write(&path, text).unwrap();
    let formula = Formula::open(&path).unwrap_or_else(|error| panic!("{text}\n{error}"));
    (folder, formula)
}

const JUMPING_FOLD: &str = r#"
fn step(z, c, p) {
    vec3(fold(z.x, p), fold(z.y, p), fold(z.z, p))
}
fn fold(x, p) {
    select(x > p.limit, p.value - x, select(x < -p.limit, -p.value - x, x))
}
fn derivative(z, dr, p) {
    dr
}
#{
    group: "fold",
    summary: "A box fold whose value is not twice its limit.",
    source: "Tom Lowe, 2010, with the value left free.",
    scalar_rule: "heuristic",
    params: [
        #{ name: "limit", type: "float", "default": 1.0, min: 0.0, max: 10.0, unit: "", help: "Where it folds." },
        #{ name: "value", type: "float", "default": 2.0, min: 0.0, max: 10.0, unit: "", help: "What it folds from." },
    ],
    examples: [ #{ z: [2.0, 0.0, 0.5], expect: [0.0, 0.0, 0.5] } ],
}
"#;

/// The Mandelbox's map in one coordinate: with the others at 0 and inside the sphere's radii it is this alone.
fn jumping_orbit(x: f64, value: f64) -> Vec<f64> {
    let folded = match x {
        x if x > 1.0 => value - x,
        x if x < -1.0 => -value - x,
        x => x,
    };
    let r_sq = folded * folded;
    vec![2.0 * folded / r_sq.clamp(0.25, 1.0) + x, 0.0, 0.0]
}

pub fn fold_value_not_twice_the_limit() {
    for value in [2.0, 1.5, 2.6] {
        let text = boxed(2.0, BOX).replace("box_fold()", &format!("jumping_fold(value: {value:?})"));
        let (_folder, formula) = with_steps(&[("jumping_fold", JUMPING_FOLD)], &text);
        for x in [1.0, -1.0, 1.0 + 1e-9, -1.0 - 1e-9, 0.99, 4.2] {
            let (found, wanted) = (formula.orbit([x, 0.0, 0.0], 1), jumping_orbit(x, value));
            assert!((0..3).all(|i| (found[i] - wanted[i]).abs() < 1e-12), "{value} at {x}: {found:?}, not {wanted:?}");
        }
        let points: Vec<P> = [1.0, 1.0 + 1e-7, -1.0, 5.9, 7.0].iter().map(|&x| [x, 6.5, -7.0]).collect();
        all_sound(&formula, &points);
    }
}

const CONDITIONAL_SPONGE: &str = r#"
fn step(z, c, p) {
    let a = abs(z);
    let upper = max(a.x, a.y);
    let lower = min(a.x, a.y);
    let rest = min(a.z, upper);
    let sorted = vec3(max(upper, a.z), max(lower, rest), min(lower, rest));
    let grown = sorted * 3.0 - vec3(2.0, 2.0, 2.0);
    vec3(grown.x, grown.y, grown.z + select(grown.z < -1.0, 2.0, 0.0))
}
fn derivative(z, dr, p) {
    dr * 3.0
}
#{
    group: "fold",
    summary: "The Menger sponge by a conditional translation.",
    source: "Knighty, 2010.",
    growth: "linear",
    scalar_rule: "heuristic",
    params: [],
    examples: [ #{ z: [1.0, 1.0, 1.0], expect: [1.0, 1.0, 1.0] } ],
}
"#;

pub fn conditional_translation() {
    let rest = "constant: Off, escape_radius: 8, max_iterations: 5, bounding_radius: 2,
        estimate: (form: linear, radius: 1.7320508)";
    let by_folds = formula(&format!(
        r#"(nodes: {{ "fold": menger_fold(), "grow": scale(scale: 3, centre: (1, 1, 1)),
            "all": Sequence(["fold", "grow"]) }}, output: "all", {rest})"#
    ));
    let steps = [("conditional_sponge", CONDITIONAL_SPONGE)];
    let (_folder, plain) = with_steps(&steps, &format!(r#"(nodes: {{ "all": conditional_sponge() }}, {rest})"#));
    let mut random = Random::new(8);
    let points: Vec<P> = (0..200).map(|_| [0; 3].map(|_| random.range(-1.05, 1.05))).collect();
    let inside = |formula: &Formula| -> Vec<bool> {
        answers(formula, &points).iter().filter(|a| a.target == Target::CPU_F64).map(|a| a.inside).collect()
    };
    let (a, b) = (inside(&plain), inside(&by_folds));
    assert_eq!(a, b);
    assert!(a.contains(&true) && a.contains(&false), "the points try one side only");
    let turned = format!(
        r#"(nodes: {{ "sponge": conditional_sponge(), "turn": rotate(axis: (0, 0, 1), angle: 5),
            "all": Sequence(["sponge", "turn"]) }}, output: "all", {rest})"#
    );
    let (_folder, turned) = with_steps(&steps, &turned);
    all_sound(&turned, &points);
}

pub fn mandelbox_scales_near_one() {
    let points: Vec<P> = vec![[0.0; 3], [0.3, -0.4, 0.5], [1.0, 1.0, 1.0], [2.9, 0.1, -0.3], [5.0, 5.0, 5.0]];
    for scale in [0.5, -0.5, 0.0, 0.2, -0.24] {
        // |z'| <= |scale| max(|folded|, 4 |folded| inside the radii, at most 2) + |p|: nothing leaves the bailout.
        let rest = "escape_radius: 60, max_iterations: 100, bounding_radius: 12, estimate: (form: linear)";
        for answer in sound_answers(&boxed(scale, rest), &points) {
            assert!(answer.inside && answer.de == 0.0, "scale {scale}: {answer:?}");
        }
    }
    for scale in [1.0, -1.0, 1.001, -1.001, 1.05, -1.05] {
        let formula = formula(&boxed(scale, "escape_radius: 60, max_iterations: 300"));
        let plan = formula.plan();
        assert!(plan.bounding_radius.is_finite() && plan.bounding_radius > 0.0, "scale {scale}: {plan:?}");
        assert!(plan.choices.iter().all(|c| c.radius.is_finite()), "scale {scale}: {plan:?}");
        all_sound(&formula, &points);
    }
}
