//! One suite for every back end: answers known from theory, and graphs that must equal each other.
//!
//! Each case is a formula in RON and runs on the f64 interpreter, the wide f32 interpreter and, where there is an adapter,
//! the GPU. Tolerances: one for each target, see [`slack`].

use bulbfold::check::{Backends, Random, Subject, Target};
use bulbfold::graph::Method;

use crate::support::formula;

type P = [f64; 3];

thread_local! {
    /// Opened once a test, since opening a GPU takes longer than a case, and never closed: drivers cannot be while a
    /// thread ends.
    static BACKENDS: &'static Backends = Box::leak(Box::new(Backends::new()));
}

fn backends() -> &'static Backends {
    BACKENDS.with(|backends| *backends)
}

/// Relative error (absolute below 1) that known answers are checked to. f32: 24 bits through some ten operations and a
/// logarithm or root; finite differences are given their own.
fn slack(target: Target, method: Method) -> f64 {
    match (target, method) {
        (Target::CPU_F64, Method::Delta) => 2e-2, // forward differences over a hundredth of the estimate
        (Target::CPU_F64, _) => 1e-9,
        (_, Method::Delta) => 3e-2,
        (_, _) => 2e-5,
    }
}

fn points(count: usize, from: f64, to: f64) -> Vec<P> {
    let mut random = Random::new(11);
    (0..count)
        .map(|_| {
            let r = random.range(from, to);
            random.direction().map(|x| x * r)
        })
        .collect()
}

fn length(p: P) -> f64 {
    p.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn estimates(
    backends: &Backends,
    target: Target,
    subject: &Subject,
    method: Option<Method>,
    points: &[P],
) -> Vec<(f64, bool)> {
    let choices = subject.choices(method).expect("the method applies");
    let kernel = subject.estimator(&choices).unwrap_or_else(|e| panic!("{}", e.message));
    subject.estimates(backends, target, &kernel, points).unwrap()
}

/// Checks the estimates of one formula against a function, on every back end and with the given methods.
fn expect_estimates(text: &str, methods: &[Option<Method>], points: &[P], expected: impl Fn(P) -> f64) {
    let formula = formula(text);
    let subject = formula.subject();
    let backends = backends();
    for target in backends.targets() {
        for method in methods {
            let tolerance = slack(target, method.or(subject.method()).unwrap_or(Method::Scalar));
            for (p, (found, _)) in points.iter().zip(estimates(backends, target, &subject, *method, points)) {
                let wanted = expected(*p);
                let near = (found - wanted).abs() <= tolerance * wanted.abs().max(1.0);
                assert!(near, "{target:?} {method:?} at {p:?}: expected {wanted}, found {found}\n{text}");
            }
        }
    }
}

/// Checks that two formulas have the same estimates and membership.
fn expect_equal(a: &str, b: &str, points: &[P]) {
    let other = formula(b);
    let backends = backends();
    let reference = estimates(backends, Target::CPU_F64, &other.subject(), None, points);
    let formula = formula(a);
    let subject = formula.subject();
    for target in backends.targets() {
        // Orbits of several iterations: rounding grows with each.
        let tolerance = if target == Target::CPU_F64 { 1e-9 } else { 2e-3 };
        let found = estimates(backends, target, &subject, None, points);
        for ((p, a), b) in points.iter().zip(found).zip(&reference) {
            let near = (a.0 - b.0).abs() <= tolerance * b.0.abs().max(0.1);
            assert!(
                near && a.1 == b.1,
                "{target:?} at {p:?}: {a:?} against {b:?}\n{a:?}\n{text}",
                text = subject.graph.name
            );
        }
    }
}

const AUTO: &[Option<Method>] = &[None];

#[test]
fn sphere_has_exact_distance() {
    let text = r#"(nodes: { "ball": Sphere(centre: (0.5, 0, 0), radius: 0.75) })"#;
    expect_estimates(text, AUTO, &points(100, 1.3, 4.0), |p| length([p[0] - 0.5, p[1], p[2]]) - 0.75);
}

#[test]
fn sphere_has_exact_depth_on_every_back_end() {
    let formula = formula(r#"(nodes: { "ball": Sphere(radius: 0.75) })"#);
    let subject = formula.subject();
    let backends = backends();
    let rays: Vec<(P, P)> = points(50, 3.0, 3.0)
        .into_iter()
        .zip(points(100, 0.0, 0.7).into_iter().skip(50))
        .map(|(from, to)| {
            let d = [0, 1, 2].map(|i| to[i] - from[i]);
            (from, d.map(|x| x / length(d)))
        })
        .collect();
    for target in backends.targets() {
        let eps = if target == Target::CPU_F64 { 1e-8 } else { 1e-4 };
        let depths = subject.depths(backends, target, &rays, eps).unwrap().unwrap_or_else(|e| panic!("{}", e.message));
        for ((o, d), found) in rays.iter().zip(depths) {
            let b: f64 = (0..3).map(|i| o[i] * d[i]).sum();
            let exact = -b - (b * b - (length(*o).powi(2) - 0.75 * 0.75)).sqrt();
            let found = found.expect("the ray meets the sphere");
            assert!((found - exact).abs() <= eps, "{target:?}: expected {exact}, found {found}");
        }
    }
}

/// Each ray meets the sphere at a height, and so a depth, of its own. Back ends march rays in an order of their own, by hundreds at
/// a time: the numbers here lie beside and between such borders.
#[test]
fn every_ray_of_any_number_is_marched() {
    let formula = formula(r#"(nodes: { "ball": Sphere(radius: 0.75) })"#);
    let subject = formula.subject();
    let backends = backends();
    for count in [1, 511, 513, 14_848, 20_001] {
        let height = |k: usize| 0.7 * k as f64 / count as f64;
        let rays: Vec<(P, P)> = (0..count).map(|k| ([-3.0, height(k), 0.0], [1.0, 0.0, 0.0])).collect();
        for target in backends.targets() {
            let depths =
                subject.depths(backends, target, &rays, 1e-4).unwrap().unwrap_or_else(|e| panic!("{}", e.message));
            for (k, found) in depths.into_iter().enumerate() {
                let exact = 3.0 - (0.75 * 0.75 - height(k) * height(k)).sqrt();
                let found = found.unwrap_or_else(|| panic!("{target:?}: ray {k} of {count} meets the sphere"));
                assert!(
                    (found - exact).abs() <= 3e-4,
                    "{target:?}: ray {k} of {count}: expected {exact}, found {found}"
                );
            }
        }
    }
}

#[test]
fn sphere_has_exact_normals() {
    use bulbfold::compose::{Purpose, compose_estimator};
    use bulbfold::kernel::{Estimator, Kernel};
    let formula = formula(r#"(nodes: { "ball": Sphere(radius: 0.75) })"#);
    let subject = formula.subject();
    let estimator = compose_estimator(&subject.composer(), &subject.plan.choices, Purpose::Surface);
    let kernel = Kernel::Estimate(estimator.unwrap_or_else(|e| panic!("{}", e.message)));
    let backends = backends();
    let points = points(50, 0.7, 0.8);
    let columns = Estimator::columns(&points, &[[1.0, 0.0, 0.0]], &[1e-4], 1e-4);
    for target in backends.targets() {
        let out = backends.run(target, subject.arena, &kernel, &columns).unwrap();
        for (k, p) in points.iter().enumerate() {
            for i in 0..3 {
                let wanted = p[i] / length(*p);
                assert!(
                    (out[i][k] - wanted).abs() < slack(target, Method::Gradient),
                    "{target:?}: {wanted} {}",
                    out[i][k]
                );
            }
        }
    }
}

/// The power-p bulb with c = 0: the set is the unit ball, and the logarithmic estimate is r ln r / 2 for any power and any
/// number of iterations.
#[test]
fn julia_bulb_of_zero_is_the_unit_ball() {
    for power in [2, 3, 4, 8] {
        let text = format!(
            r#"(nodes: {{ "bulb": bulb_power(power: {power}) }}, constant: Julia((0, 0, 0)), escape_radius: 10,
                max_iterations: 30, bounding_radius: 2)"#
        );
        let methods = [Some(Method::Scalar), Some(Method::Gradient), Some(Method::Combined), Some(Method::Delta)];
        let expected = |p| length(p) * length(p).ln() / 2.0;
        expect_estimates(&text, &methods, &points(60, 1.1, 3.0), expected);
        let formula = formula(&text);
        assert!(points(60, 0.0, 0.999).into_iter().all(|p| formula.inside(p)));
        assert!(points(60, 1.001, 4.0).into_iter().all(|p| !formula.inside(p)));
    }
}

#[test]
fn pure_scaling_gives_the_distance_to_the_origin() {
    let text = r#"(nodes: { "grow": scale(scale: 2.0) }, constant: Off, escape_radius: 1000, max_iterations: 40,
        bounding_radius: 4, estimate: (form: linear, radius: 0))"#;
    let methods = [Some(Method::Scalar), Some(Method::Gradient), Some(Method::Combined), Some(Method::Delta)];
    expect_estimates(text, &methods, &points(100, 0.01, 3.0), length);
}

const BOX: &str = r#""fold": box_fold(), "ball": sphere_fold(), "grow": scale(scale: 2.0),
    "box": Sequence(["fold", "ball", "grow"]), "bulb": bulb_power(power: 8)"#;

fn boxed(nodes: &str, output: &str) -> String {
    format!(
        r#"(nodes: {{ {BOX}, {nodes} }}, output: "{output}", escape_radius: 100, max_iterations: 6, bounding_radius: 6,
            estimate: (method: scalar, form: linear, radius: 4))"#
    )
}

#[test]
fn scaling_the_scene_scales_the_estimate() {
    for scale in [0.5, 3.0] {
        let placed = boxed(&format!(r#""placed": Transform(of: "box", scale: {scale})"#), "placed");
        let plain = formula(&boxed(r#""same": Transform(of: "box")"#, "same"));
        let kernel_points = points(100, 0.5, 6.0);
        let scaled: Vec<P> = kernel_points.iter().map(|p| p.map(|x| x * scale)).collect();
        let backends = backends();
        let reference = estimates(backends, Target::CPU_F64, &plain.subject(), None, &kernel_points);
        let formula = formula(&placed);
        for target in backends.targets() {
            let tolerance = if target == Target::CPU_F64 { 1e-9 } else { 1e-4 };
            for (a, b) in estimates(backends, target, &formula.subject(), None, &scaled).iter().zip(&reference) {
                assert!((a.0 - scale * b.0).abs() <= tolerance * (scale * b.0).max(1.0), "{target:?}: {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn turning_and_moving_the_scene_moves_the_estimate() {
    let placed = r#"(nodes: { "box": Box(half_size: (1, 0.5, 0.25)),
        "placed": Transform(of: "box", translate: (1, 2, 3), axis: (0, 0, 1), angle: 90) }, output: "placed")"#;
    // A quarter turn about z swaps the sides along x and y.
    let expected = |p: P| {
        let q = [(p[0] - 1.0).abs() - 0.5, (p[1] - 2.0).abs() - 1.0, (p[2] - 3.0).abs() - 0.25];
        length(q.map(|x| x.max(0.0)))
    };
    expect_estimates(placed, AUTO, &points(100, 6.0, 9.0), expected);
}

#[test]
fn alternation_of_one_map_is_that_map() {
    let all = points(100, 0.2, 5.0);
    let base = boxed(r#""x": Repeat(of: "box", times: 1)"#, "x");
    for nodes in [
        r#""y": Alternate(["box", "box"])"#,
        r#""y": Alternate([("box", 3), "box"])"#,
        r#""y": Between(of: "box", from: 0, to: 3, otherwise: "box")"#,
        r#""y": Between(of: "bulb", from: 100, to: 200, otherwise: "box")"#,
        r#""y": Choose(when: RadiusBelow(1.0), then: "box", otherwise: "box")"#,
        r#""y": Choose(when: IterationBelow(0), then: "bulb", otherwise: "box")"#,
        r#""y": Choose(when: IterationEvery(1), then: "box", otherwise: "bulb")"#,
        r#""y": Choose(when: RadiusAbove(1e6), then: "bulb", otherwise: "box")"#,
        r#""y": Sequence(["box"])"#,
        r#""y": Blend(a: "box", b: "bulb", weight: 0)"#,
        r#""y": Blend(a: "bulb", b: "box", weight: 1)"#,
        r#""y": Blend(a: "box", b: "box", weight: 0.3)"#,
        r#""y": Item(of: "box", constant: Mandelbrot)"#,
        r#""y": Sequence([Repeat(of: "bulb", times: 0), "box"])"#,
    ] {
        expect_equal(&boxed(nodes, "y"), &base, &all);
    }
}

#[test]
fn repeat_is_the_map_written_twice() {
    let twice = boxed(r#""y": Repeat(of: "box", times: 2)"#, "y");
    let written = boxed(r#""y": Sequence(["fold", "ball", "grow", "fold", "ball", "grow"])"#, "y");
    expect_equal(&twice, &written, &points(100, 0.2, 5.0));
}

#[test]
fn alternation_counts_iterations() {
    let nodes = r#""y": Alternate([("box", 2), ("fold", 1)])"#;
    let other = r#""y": Choose(when: IterationEvery(3), then: "box", otherwise: Choose(when: IterationBelow(2), then: "box",
        otherwise: Between(of: "box", from: 4, to: 5, otherwise: "fold")))"#;
    // box box fold box box fold, written a second time by conditions on n = 0, 1, 2, 3, 4, 5.
    expect_equal(&boxed(nodes, "y"), &boxed(other, "y"), &points(100, 0.2, 5.0));
}

#[test]
fn choose_picks_by_radius_and_sign() {
    let text = r#"(nodes: { "y": Choose(when: WHEN, then: scale(scale: 3.0), otherwise: scale(scale: 2.0)) },
        constant: Off, max_iterations: 1, escape_radius: 1e6)"#;
    type Holds = fn(P) -> bool;
    let cases: [(&str, Holds); 4] = [
        ("RadiusBelow(1.0)", |p| length(p) < 1.0),
        ("RadiusAbove(1.0)", |p| length(p) > 1.0),
        ("Negative(\"x\")", |p| p[0] < 0.0),
        ("Positive(\"z\")", |p| p[2] > 0.0),
    ];
    for (when, holds) in cases {
        let formula = formula(&text.replace("WHEN", when));
        for p in points(40, 0.1, 2.0) {
            let factor = if holds(p) { 3.0 } else { 2.0 };
            let found = formula.orbit(p, 1);
            assert!((0..3).all(|i| (found[i] - factor * p[i]).abs() < 1e-12), "{when} at {p:?}: {found:?}");
        }
    }
}

#[test]
fn pre_and_post_transforms_run_once() {
    let text = r#"(nodes: { "grow": scale(scale: 2.0), "half": scale(scale: 0.5) }, output: "grow", pre: ["half"],
        POST constant: Off, escape_radius: 1000, max_iterations: 40, bounding_radius: 4, estimate: (form: linear, radius: 0))"#;
    let methods = [Some(Method::Scalar), Some(Method::Gradient), Some(Method::Combined)];
    for post in ["", r#"post: ["half"],"#] {
        expect_estimates(&text.replace("POST", post), &methods, &points(50, 0.1, 3.0), length);
    }
    let formula = formula(&text.replace("POST", ""));
    assert_eq!(formula.orbit([1.0, 0.0, 0.0], 3)[0], 4.0);
}

#[test]
fn fields_combine_as_their_closed_forms() {
    let ball = |p: P| length(p) - 1.0;
    let cube = |p: P| {
        let q = [(p[0] - 1.0).abs() - 0.5, p[1].abs() - 0.6, p[2].abs() - 0.7];
        length(q.map(|x| x.max(0.0))) + q[0].max(q[1]).max(q[2]).min(0.0)
    };
    let smooth = |a: f64, b: f64, k: f64| {
        let h = (k - (a - b).abs()).max(0.0) / k;
        a.min(b) - h * h * k * 0.25
    };
    let nodes = r#""ball": Sphere(radius: 1), "cube": Box(centre: (1, 0, 0), half_size: (0.5, 0.6, 0.7))"#;
    let all = points(200, 0.0, 3.0);
    let text = |output: &str| format!(r#"(nodes: {{ {nodes}, "out": {output} }}, output: "out")"#);
    expect_estimates(&text(r#"Union(["ball", "cube"])"#), AUTO, &all, |p| ball(p).min(cube(p)));
    expect_estimates(&text(r#"Intersection(["ball", "cube"])"#), AUTO, &all, |p| ball(p).max(cube(p)));
    expect_estimates(&text(r#"Difference(a: "ball", b: "cube")"#), AUTO, &all, |p| ball(p).max(-cube(p)));
    let joined = text(r#"SmoothUnion(of: ["ball", "cube"], radius: 0.4)"#);
    expect_estimates(&joined, AUTO, &all, |p| smooth(ball(p), cube(p), 0.4));
}

#[test]
fn membership_of_combinations_is_that_of_sets() {
    let nodes = r#""ball": Sphere(radius: 1), "cube": Box(centre: (1, 0, 0), half_size: (0.5, 0.6, 0.7))"#;
    let ball = |p: P| length(p) <= 1.0;
    let cube = |p: P| (p[0] - 1.0).abs() <= 0.5 && p[1].abs() <= 0.6 && p[2].abs() <= 0.7;
    type Join = fn(bool, bool) -> bool;
    let cases: [(&str, Join); 3] = [
        (r#"Union(["ball", "cube"])"#, |a, b| a || b),
        (r#"Intersection(["ball", "cube"])"#, |a, b| a && b),
        (r#"Difference(a: "ball", b: "cube")"#, |a, b| a && !b),
    ];
    for (output, join) in cases {
        let formula = formula(&format!(r#"(nodes: {{ {nodes}, "out": {output} }}, output: "out")"#));
        for p in points(200, 0.0, 2.0) {
            assert_eq!(formula.inside(p), join(ball(p), cube(p)), "{output} at {p:?}");
        }
    }
}

#[test]
fn other_primitives_have_exact_distances() {
    let all = points(200, 0.0, 3.0);
    let planar = |p: P| p[0].hypot(p[1]);
    let of = |node: &str| format!(r#"(nodes: {{ "it": {node} }}, bounding_radius: 3)"#);
    expect_estimates(&of("Torus(major: 1, minor: 0.25)"), AUTO, &all, |p| (planar(p) - 1.0).hypot(p[2]) - 0.25);
    expect_estimates(&of("Plane(normal: (0, 3, 4), offset: 0.5)"), AUTO, &all, |p| 0.6 * p[1] + 0.8 * p[2] - 0.5);
    expect_estimates(&of("Cylinder(radius: 0.5, half_height: 1)"), AUTO, &all, |p| {
        let (side, cap) = (planar(p) - 0.5, p[2].abs() - 1.0);
        side.max(0.0).hypot(cap.max(0.0)) + side.max(cap).min(0.0)
    });
    expect_estimates(&of("Sphere(radius: 1, form: shell)"), AUTO, &all, |p| (length(p) - 1.0).abs());
    expect_estimates(&of("Sphere(radius: 1, form: solid)"), AUTO, &all, |p| (length(p) - 1.0).max(0.0));
}

#[test]
fn field_of_orbit_and_primitive_is_the_nearer_one() {
    let nodes = r#""floor": Plane(offset: -3), "both": Union(["box", "floor"]), "alone": Transform(of: "box")"#;
    let (both, alone) = (formula(&boxed(nodes, "both")), formula(&boxed(nodes, "alone")));
    for p in points(100, 0.5, 5.0) {
        let wanted = alone.chosen_estimate(p).min(p[2] + 3.0);
        assert!((both.chosen_estimate(p) - wanted).abs() < 1e-9, "at {p:?}");
    }
}
