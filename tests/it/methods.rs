//! Every estimate method and form against answers known from theory, on every back end.

use bulbfold::check::{Backends, Formula, Random, Subject, Target};
use bulbfold::compose::norm::{frobenius_norm, largest_singular_value, long_length};
use bulbfold::compose::{Choice, Purpose, compose_estimator};
use bulbfold::expr::{Arena, Function, Port, Type};
use bulbfold::graph::{DeForm, Difference, Method};
use bulbfold::kernel::{Estimator, Kernel};

use crate::support::formula;

type P = [f64; 3];

thread_local! {
    /// Opened once a test, and never closed: drivers cannot be while a thread ends.
    static BACKENDS: &'static Backends = Box::leak(Box::new(Backends::new()));
}

fn backends() -> &'static Backends {
    BACKENDS.with(|backends| *backends)
}

/// Relative error (absolute below 1) by target. f32: 24 bits through some twenty operations.
fn slack(target: Target) -> f64 {
    if target == Target::CPU_F64 { 1e-9 } else { 1e-4 }
}

fn length(p: P) -> f64 {
    p.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn largest(p: P) -> f64 {
    p.iter().fold(0.0, |a: f64, b| a.max(b.abs()))
}

fn sphere_points(count: usize, from: f64, to: f64) -> Vec<P> {
    let mut random = Random::new(5);
    let point = |random: &mut Random| {
        let r = random.range(from, to);
        random.direction().map(|x| x * r)
    };
    (0..count).map(|_| point(&mut random)).collect()
}

fn directions(count: usize) -> Vec<P> {
    let mut random = Random::new(9);
    (0..count).map(|_| random.direction()).collect()
}

/// Where estimates are asked for: points, the rays' directions, and the step of differences.
struct Query<'a> {
    points: &'a [P],
    directions: &'a [P],
    h: f64,
}

/// Columns `de, inside, n, r, z` on a target, with the plan's choices changed by `change`.
fn probe(subject: &Subject, target: Target, query: &Query, change: impl Fn(&mut Choice)) -> Vec<Vec<f64>> {
    let mut choices = subject.plan.choices.clone();
    choices.iter_mut().for_each(change);
    let estimator = compose_estimator(&subject.composer(), &choices, Purpose::Probe);
    let kernel = Kernel::Estimate(estimator.unwrap_or_else(|e| panic!("{}", e.message)));
    let columns = Estimator::columns(query.points, query.directions, &[query.h], 1e-9);
    backends().run(target, subject.arena, &kernel, &columns).unwrap()
}

/// Checks a method's estimates on every target against a function of point and direction.
fn expect(text: &str, query: &Query, extra: f64, change: impl Fn(&mut Choice) + Copy, expected: impl Fn(P, P) -> f64) {
    let formula = formula(text);
    let subject = formula.subject();
    for target in backends().targets() {
        let found = probe(&subject, target, query, change);
        for (i, p) in query.points.iter().enumerate() {
            let d = query.directions[i % query.directions.len()];
            let (wanted, de) = (expected(*p, d), found[0][i]);
            let near = (de - wanted).abs() <= (slack(target) + extra) * wanted.abs().max(1.0);
            assert!(near, "{target:?} at {p:?} along {d:?}: expected {wanted}, found {de}\n{text}");
        }
    }
}

fn with(method: Method) -> impl Fn(&mut Choice) + Copy {
    move |choice| choice.method = method
}

const EXACT: [Method; 6] =
    [Method::Scalar, Method::Gradient, Method::Jacobian, Method::Combined, Method::Directional, Method::Frobenius];

/// Factor 2 a step about the origin: z = 2^n p at the first n where that is above 1000.
const GROWING: &str = r#"(nodes: { "grow": scale(scale: 2.0) }, constant: Off, escape_radius: 1000, max_iterations: 60,
    bounding_radius: 4, estimate: (form: linear, radius: 12))"#;

fn growing_iterations(p: P) -> f64 {
    (1000.0 / length(p)).log2().ceil().max(1.0)
}

/// sqrt(3) for the norm that counts all three directions.
fn norm_of_unit(method: Method) -> f64 {
    if method == Method::Frobenius { 3f64.sqrt() } else { 1.0 }
}

#[test]
fn uniform_scaling_has_one_answer_for_every_method_and_form() {
    let points = sphere_points(60, 0.05, 3.0);
    let query = Query { points: &points, directions: &directions(60), h: 1e-4 };
    let axis = [0.6, 0.0, 0.8];
    for form in [DeForm::Linear, DeForm::Box, DeForm::Plane] {
        let size = |p: P| match form {
            DeForm::Box => largest(p),
            DeForm::Plane => (0.6 * p[0] + 0.8 * p[2]).abs(),
            _ => length(p),
        };
        for method in EXACT {
            // The gradient of a box's or slab's size is 1 long as well: along one axis.
            let of_size = method == Method::Gradient;
            let stretch = if of_size { 1.0 } else { norm_of_unit(method) };
            let change = move |choice: &mut Choice| {
                *choice = Choice { method, form, axis, ..choice.clone() };
            };
            let radius = 12.0;
            let expected = |p: P, _: P| ((size(p) - radius / 2f64.powf(growing_iterations(p))) / stretch).max(0.0);
            let change = move |choice: &mut Choice| {
                change(choice);
                choice.radius = radius;
            };
            expect(GROWING, &query, 0.0, change, expected);
        }
    }
}

/// Forward differences of |p| itself, whose answer for any step is elementary.
#[test]
fn finite_differences_are_those_of_r_of_its_logarithm_and_of_z() {
    let points = sphere_points(60, 0.3, 3.0);
    let rays = directions(60);
    for h in [0.3, 0.01] {
        let query = Query { points: &points, directions: &rays, h };
        let plus = |p: P, d: P| [0, 1, 2].map(|i| p[i] + h * d[i]);
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for difference in Difference::ALL {
            let slope = move |p: P, d: P| match difference {
                Difference::R => (length(plus(p, d)) - length(p)) / h,
                Difference::LnR => (length(plus(p, d)) / length(p)).ln() * length(p) / h,
                Difference::Z => 1.0,
            };
            let change = |method: Method| {
                move |choice: &mut Choice| {
                    *choice = Choice { method, difference: Some(difference), radius: 0.0, ..choice.clone() };
                }
            };
            let delta = |p: P, _: P| match difference {
                Difference::Z => length(p),
                _ => length(p) / length(axes.map(|axis| slope(p, axis))),
            };
            let extra = if h < 0.1 { 2e-4 } else { 0.0 }; // f32: digits that the difference loses
            expect(GROWING, &query, extra, change(Method::Delta), delta);
            // Along rays that nearly keep r, a difference of r says anything.
            let steep: Vec<(P, P)> =
                points.iter().copied().zip(rays.iter().copied()).filter(|(p, d)| slope(*p, *d).abs() > 0.2).collect();
            let (steep_points, steep_rays): (Vec<P>, Vec<P>) = steep.into_iter().unzip();
            let query = Query { points: &steep_points, directions: &steep_rays, h };
            expect(GROWING, &query, 2e-3, change(Method::DeltaRay), |p, d| length(p) / slope(p, d).abs());
        }
    }
}

/// One iteration of a linear map that is neither symmetric nor a similarity.
#[test]
fn linear_maps_have_the_norms_of_their_matrix() {
    let matrix = [[1.5, 0.4, -0.2], [0.0, 0.7, 0.9], [0.25, -0.1, 2.5]];
    let text = format!(
        r#"(nodes: {{ "map": linear(matrix: [{}]) }}, constant: Off, escape_radius: 0.001, max_iterations: 1,
            bounding_radius: 4, estimate: (form: linear, radius: 0.25))"#,
        matrix.map(|r| format!("({}, {}, {})", r[0], r[1], r[2])).join(", ")
    );
    let times = |v: P| matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
    let points = sphere_points(60, 0.5, 3.0);
    let rays = directions(60);
    let query = Query { points: &points, directions: &rays, h: 0.05 };
    let expect = |method: Method, slope: &dyn Fn(P, P) -> f64| {
        let change = move |choice: &mut Choice| {
            (choice.method, choice.difference) = (method, Some(Difference::Z));
        };
        expect(&text, &query, 1e-4 * f64::from(u8::from(method.is_difference())), change, |p, d| {
            (length(times(p)) - 0.25) / slope(p, d)
        });
    };
    let largest = singular_value(&matrix.map(|r| r.to_vec()));
    let transposed = |v: P| [0, 1, 2].map(|j| (0..3).map(|i| matrix[i][j] * v[i]).sum::<f64>());
    let gradient = |p: P| length(transposed(times(p))) / length(times(p));
    let all = matrix.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
    expect(Method::Jacobian, &|_, _| largest);
    expect(Method::Scalar, &|_, _| largest);
    expect(Method::Frobenius, &|_, _| all);
    expect(Method::Directional, &|_, d| length(times(d)));
    expect(Method::Gradient, &|p, _| gradient(p));
    expect(Method::Combined, &|p, _| gradient(p).max(largest));
    expect(Method::DeltaRay, &|_, d| length(times(d)));
    expect(Method::Delta, &|_, _| largest);
}

/// z^2 of quaternions with c = 0: |z| = |p|^(2^n), every direction in the plane of p and the real axis is stretched by
/// 2^n |p|^(2^n - 1) and no other by more.
#[test]
fn powers_have_the_potential_ln_r() {
    let square = r#"(nodes: { "square": quaternion_square() }, constant: Julia((0, 0, 0)), escape_radius: 10,
        max_iterations: 30, bounding_radius: 2)"#;
    let bulb = r#"(nodes: { "bulb": bulb_power(power: 8) }, constant: Julia((0, 0, 0)), escape_radius: 10,
        max_iterations: 30, bounding_radius: 2)"#;
    let points = sphere_points(60, 1.05, 3.0);
    let radial: Vec<P> = points.iter().map(|p| p.map(|x| -x / length(*p))).collect();
    let query = Query { points: &points, directions: &radial, h: 1e-4 };
    let logarithmic = |p: P, _: P| length(p) * length(p).ln() / 2.0;
    for (text, methods) in [
        (square, [Method::Scalar, Method::Gradient, Method::Potential, Method::Directional, Method::Jacobian]),
        (bulb, [Method::Scalar, Method::Gradient, Method::Potential, Method::Directional, Method::Combined]),
    ] {
        for method in methods {
            expect(text, &query, 0.0, with(method), logarithmic);
        }
        for method in [Method::Delta, Method::DeltaRay] {
            expect(text, &query, 2e-2, with(method), logarithmic);
        }
        // e^-G sinh G / 2 |grad G| with G = ln r is (r - 1/r) / 4: never above half the distance r - 1 times (1 + 1/r).
        expect(text, &query, 0.0, with(Method::Sinh), |p, _| (length(p) - 1.0 / length(p)) / 4.0);
    }
}

/// Potential and sinh on whole formulas, where iterations differ from point to point.
#[test]
fn potential_and_sinh_follow_from_the_gradient() {
    for (name, text) in [
        ("bulb", r#"(nodes: { "bulb": bulb_power(power: 8) }, escape_radius: 4, bounding_radius: 2)"#),
        (
            "mixed",
            r#"(nodes: { "bulb": bulb_power(power: 4), "fold": box_fold(),
            "y": Alternate(["bulb", "fold"]) }, output: "y", escape_radius: 10, bounding_radius: 2)"#,
        ),
    ] {
        let formula = formula(text);
        let subject = formula.subject();
        let points = sphere_points(80, 1.3, 3.0);
        let query = Query { points: &points, directions: &directions(1), h: 1e-4 };
        // A fold keeps the power, so a cycle of two grows by 4.
        let per_iteration = if name == "bulb" { 8.0 } else { 2.0 };
        for target in backends().targets() {
            let at = |method| {
                probe(&subject, target, &query, move |choice| {
                    (choice.method, choice.form) = (method, DeForm::Logarithmic);
                })
            };
            let (gradient, potential, sinh) = (at(Method::Gradient), at(Method::Potential), at(Method::Sinh));
            for i in (0..points.len()).filter(|&i| gradient[1][i] < 0.5) {
                assert_eq!(gradient[0][i], potential[0][i], "{name} {target:?} at {:?}", points[i]);
                let g = gradient[3][i].ln() / f64::powf(per_iteration, gradient[2][i]);
                let wanted = gradient[0][i] * -f64::exp_m1(-2.0 * g) / (2.0 * g);
                let tolerance = if target == Target::CPU_F64 { 1e-6 } else { 1e-3 };
                assert!(
                    (sinh[0][i] - wanted).abs() <= tolerance * wanted,
                    "{name} {target:?} at {:?}: expected {wanted}, found {}",
                    points[i],
                    sinh[0][i]
                );
            }
        }
    }
}

/// The sponge fills its cube's faces, so from outside the box form is the distance to the cube in the largest component.
#[test]
fn box_form_of_the_menger_sponge_is_its_cube() {
    let text = r#"(nodes: { "fold": menger_fold(), "grow": scale(scale: 3, centre: (1, 1, 1)),
        "level": Sequence(["fold", "grow"]) }, output: "level", constant: Off, escape_radius: 100, max_iterations: 6,
        bounding_radius: 2, estimate: (method: scalar, form: box, radius: 1))"#;
    let points = sphere_points(100, 1.75, 2.0);
    let query = Query { points: &points, directions: &directions(1), h: 1e-4 };
    expect(text, &query, 0.0, |_| {}, |p, _| largest(p) - 1.0);
    // Six levels are a set of small cubes: those with at most one 1 among the three ternary digits of each level.
    let is_in = |p: P| {
        let mut u = p.map(|x| (x + 1.0) / 2.0);
        (0..6).all(|_| {
            let digits = u.map(|x| (x * 3.0).floor());
            u = [0, 1, 2].map(|i| u[i] * 3.0 - digits[i]);
            digits.iter().filter(|d| **d == 1.0).count() < 2
        })
    };
    let formula = formula(text);
    let subject = formula.subject();
    let mut random = Random::new(4);
    let points: Vec<P> = (0..2000).map(|_| [(); 3].map(|()| random.range(-0.9999, 0.9999))).collect();
    let query = Query { points: &points, directions: &directions(1), h: 1e-4 };
    let found = probe(&subject, Target::CPU_F64, &query, |_| {});
    assert!(points.iter().filter(|p| is_in(**p)).count() > 200);
    for (i, p) in points.iter().enumerate() {
        assert_eq!(found[1][i] > 0.5, is_in(*p), "{p:?}");
    }
    // From the middle of the largest tunnel it is a third to its walls.
    assert!((formula.chosen_estimate([0.0, 0.0, 0.0]) - 1.0 / 3.0).abs() < 1e-12);
}

/// An orbit that never escapes has a slab around it: the plane form's own membership.
#[test]
fn plane_form_draws_orbits_that_do_not_escape() {
    let text = r#"(nodes: { "turn": rotate(axis: (1, 0, 0), angle: 90) }, constant: Off, escape_radius: 100,
        max_iterations: 3, bounding_radius: 4, estimate: (method: scalar, form: plane, axis: (0, 0, 2), radius: 0.25))"#;
    let points = sphere_points(100, 0.0, 3.0);
    let query = Query { points: &points, directions: &directions(1), h: 1e-4 };
    // Three quarter turns about x bring y to z.
    expect(text, &query, 0.0, |_| {}, |p, _| (p[1].abs() - 0.25).max(0.0));
    let formula = formula(text);
    assert!(formula.inside([2.0, 0.2, 1.0]) && !formula.inside([2.0, 0.3, 0.0]));
    let depth = formula.ray([0.5, 4.0, 0.5], [0.0, -1.0, 0.0]).expect("the slab is met");
    assert!((depth - 3.75).abs() < 1e-5, "{depth}");
}

/// Shifted points keep their own constants, however the field is turned.
#[test]
fn finite_differences_agree_with_derivatives_in_turned_frames() {
    let text = r#"(nodes: { "square": quaternion_square(), "turned": Transform(of: "square", translate: (0.2, 0.1, 0),
        axis: (1, 1, 0), angle: 50, scale: 1.5) }, output: "turned", escape_radius: 50, bounding_radius: 3)"#;
    let formula = formula(text);
    let subject = formula.subject();
    let points = sphere_points(60, 3.0, 4.0);
    let query = Query { points: &points, directions: &directions(60), h: 1e-6 };
    for (exact, differences) in [
        (Method::Gradient, (Method::Delta, Difference::LnR)),
        (Method::Jacobian, (Method::Delta, Difference::Z)),
        (Method::Directional, (Method::DeltaRay, Difference::Z)),
    ] {
        let wanted = probe(&subject, Target::CPU_F64, &query, with(exact));
        let found = probe(&subject, Target::CPU_F64, &query, |choice| {
            (choice.method, choice.difference) = (differences.0, Some(differences.1));
        });
        for (a, b) in wanted[0].iter().zip(&found[0]) {
            assert!((a - b).abs() < 1e-4 * a, "{exact:?}: {a} {b}");
        }
    }
}

/// The root of the largest eigenvalue of M^T M, by many steps of squaring: independent of the closed form.
fn singular_value(rows: &[Vec<f64>]) -> f64 {
    let mut gram = [[0.0; 3]; 3];
    for row in rows {
        for i in 0..3 {
            for j in 0..3 {
                gram[i][j] += row[i] * row[j];
            }
        }
    }
    let trace = |m: &[[f64; 3]; 3]| m[0][0] + m[1][1] + m[2][2];
    // tr(G^(2^k))^(1 / 2^k) tends to the largest eigenvalue; each square is scaled to trace 1.
    let (mut value, mut share) = (trace(&gram).ln(), 1.0);
    if trace(&gram) == 0.0 {
        return 0.0;
    }
    gram = gram.map(|row| row.map(|x| x / value.exp()));
    for _ in 0..60 {
        let mut square = [[0.0; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                square[i][j] = (0..3).map(|k| gram[i][k] * gram[k][j]).sum();
            }
        }
        share /= 2.0;
        let size = trace(&square);
        value += size.ln() * share;
        gram = square.map(|row| row.map(|x| x / size));
    }
    (value / 2.0).exp()
}

fn matrices() -> Vec<Vec<f64>> {
    let mut random = Random::new(3);
    let mut all: Vec<Vec<f64>> = [
        [3.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0],
        [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0],
        [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0],
        [0.0, -2.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.5],
        [1.0, 2.0, 3.0, 2.0, 4.0, 6.0, -1.0, -2.0, -3.0],
        [0.0; 9],
        [1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        [2.0, 1e-7, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0],
    ]
    .map(|m| m.to_vec())
    .to_vec();
    for i in 0..200 {
        let scale = 10f64.powf(random.range(-8.0, 15.0));
        let mut m: Vec<f64> = (0..9).map(|_| random.range(-1.0, 1.0) * scale).collect();
        if i % 2 == 0 {
            // Two singular values of a random size along random axes, the third one smaller.
            let (n, low) = (random.direction(), random.range(0.0, 1.0));
            m = (0..9).map(|k| (f64::from(u8::from(k % 4 == 0)) - (1.0 - low) * n[k / 3] * n[k % 3]) * scale).collect();
        }
        all.push(m);
    }
    all
}

/// From the least length on, and as far beyond where squares overflow as it promises.
#[test]
fn long_lengths_are_exact_to_rounding() {
    let arena = Arena::default();
    for least in [2.0, 10.0, 1e4] {
        let mut function = Function::new("length", vec![Port::new("v", Type::V3)]);
        function.output("length", long_length(function.input_exprs(&arena)[0], least));
        let lengths: Vec<f64> = (0..33)
            .map(|i| least * 10f64.powi(i))
            .filter(|length| *length < (least * 114f64.exp2()).min(1e37))
            .collect();
        let unit = [-2.0 / 7.0, 6.0 / 7.0, 3.0 / 7.0];
        let columns: Vec<Vec<f64>> = unit.iter().map(|x| lengths.iter().map(|length| x * length).collect()).collect();
        let kernel = Kernel::Map(function);
        for target in backends().targets() {
            let found = backends().run(target, &arena, &kernel, &columns).unwrap();
            let tolerance = if target == Target::CPU_F64 { 1e-15 } else { 2e-6 };
            for (found, wanted) in found[0].iter().zip(&lengths) {
                assert!((found - wanted).abs() <= tolerance * wanted, "{target:?}: {found} for {wanted}");
            }
        }
    }
}

#[test]
fn largest_singular_values_are_exact_to_rounding() {
    let arena = Arena::default();
    let mut function = Function::new("norms", ["a", "b", "c"].map(|name| Port::new(name, Type::V3)).to_vec());
    let rows = function.input_exprs(&arena);
    function.output("largest", largest_singular_value(&rows));
    function.output("all", frobenius_norm(&rows));
    let twice: Vec<_> = rows.iter().chain(&rows[..1]).copied().collect();
    function.output("of_four", largest_singular_value(&twice));
    let kernel = Kernel::Map(function);
    let all = matrices();
    let columns: Vec<Vec<f64>> = (0..9).map(|k| all.iter().map(|m| m[k]).collect()).collect();
    for target in backends().targets() {
        let found = backends().run(target, &arena, &kernel, &columns).unwrap();
        let tolerance = if target == Target::CPU_F64 { 1e-13 } else { 2e-6 };
        for (i, m) in all.iter().enumerate() {
            let rows: Vec<Vec<f64>> = m.chunks(3).map(<[f64]>::to_vec).collect();
            let four: Vec<Vec<f64>> = rows.iter().chain(&rows[..1]).cloned().collect();
            let all = m.iter().map(|x| x * x).sum::<f64>().sqrt();
            for (column, wanted) in [(0, singular_value(&rows)), (1, all), (2, singular_value(&four))] {
                let near = (found[column][i] - wanted).abs() <= tolerance * wanted + 1e-29;
                assert!(near, "{target:?} {column} {m:?}: expected {wanted}, found {}", found[column][i]);
            }
        }
    }
}

/// Proofs need a march of their own: one orbit that they do not apply to takes them from all, and else one takes all.
#[test]
fn none_is_certified_where_one_orbit_cannot_be() {
    let field = |other: &str| {
        let text = format!(
            r#"(nodes: {{
                "box": Sequence([box_fold(), sphere_fold(), scale(scale: 2.0)]),
                "other": {other},
                "a": Orbit(of: "box", escape_radius: 100.0, max_iterations: 8, estimate: (method: "certified")),
                "b": Orbit(of: "other", constant: Julia((-0.2, 0.6, 0.2)), escape_radius: 10.0, max_iterations: 8),
                "both": Union(["a", "b"]),
            }}, output: "both", bounding_radius: 14.0)"#
        );
        Formula::from_ron(&text).unwrap()
    };
    let remembers = field("manowar()");
    assert_eq!(remembers.plan().choices.len(), 2);
    assert!(remembers.plan().choices.iter().all(|choice| !choice.method.is_certified()));
    let warning = "no orbit is certified: the method does not apply to `other`";
    assert!(remembers.plan().warnings.iter().any(|found| found == warning), "{:?}", remembers.plan().warnings);
    let plain = field("quaternion_square()");
    assert!(plain.plan().choices.iter().all(|choice| choice.method == Method::Certified));
    assert!(plain.plan().warnings.is_empty(), "{:?}", plain.plan().warnings);
}

#[test]
fn steps_that_read_a_constant_which_is_off_are_told() {
    let warnings = |nodes: &str, constant: &str| {
        let text =
            format!("(nodes: {{\n \"map\": {nodes} }},\n output: \"map\", constant: {constant}, max_iterations: 4)");
        let warnings = Formula::from_ron(&text).unwrap().plan().warnings.clone();
        // Sets that are all of space are told of, too.
        warnings.into_iter().filter(|warning| warning.contains("constant")).collect::<Vec<_>>()
    };
    let found = warnings("barnsley()", "Off");
    assert_eq!(found.len(), 1);
    assert!(found[0].starts_with("formula.ron:2:9: the node `map` reads the constant `c`"), "{found:?}");
    assert!(found[0].contains("write `constant: Mandelbrot`"), "{found:?}");
    // In two places, and once with parameters that make nothing of it.
    assert_eq!(warnings(r#"Sequence([barnsley(), Repeat(of: bicomplex_map(map: magnet), times: 2)])"#, "Off").len(), 2);
    assert!(warnings("bicomplex_map(map: newton)", "Off").is_empty());
    assert!(warnings("barnsley()", "Mandelbrot").is_empty() && warnings("barnsley()", "Julia((0.5, 0, 1))").is_empty());
    // An item has a constant of its own.
    assert_eq!(
        warnings(r#"Alternate([(Item(of: barnsley(), constant: Off), 1), (quaternion_square(), 1)])"#, "Mandelbrot")
            .len(),
        1
    );
}
