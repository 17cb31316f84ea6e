//! Orbits that end in a shape: known distances by every method and back end, and membership by brute force.

use bulbfold::check::Formula;

/// A Menger sponge as the end of an orbit that only mirrors: the same sponge.
const SPONGE: &str = r#"(
    nodes: {
        "mirror": abs_fold(),
        "fold": menger_fold(),
        "grow": scale(scale: 3.0, centre: (1.0, 1.0, 1.0)),
        "loop": Sequence(["fold", "grow"]),
        "sponge": Orbit(of: "loop", constant: Off, escape_radius: 8.0, max_iterations: 5, estimate: (radius: 1.7320509)),
    },
    output: "mirror",
    constant: Off,
    max_iterations: 1,
    end: "sponge",
    bounding_radius: 1.75,
    tests: [
        Inside((1.0, 1.0, 1.0)),
        Outside((0.0, 0.0, 0.0)),
        Estimate(point: (2.0, -2.0, 2.0), method: "scalar", expect: 1.7320508, tolerance: 1e-5),
        Estimate(point: (2.0, -2.0, 2.0), method: "gradient", expect: 1.7320508, tolerance: 1e-5),
        Estimate(point: (2.0, -2.0, 2.0), method: "jacobian", expect: 1.7320508, tolerance: 1e-5),
        NeverAbove(factor: 0.001),
        AgreesOnBackends,
    ],
)"#;

#[test]
fn an_orbit_may_end_in_another_orbit() {
    Formula::from_ron(SPONGE).unwrap().assert_tests();
}

/// A box under a scaling: every method says the exact distance of the box half as large.
#[test]
fn every_method_says_the_distance_of_a_scaled_shape() {
    let text = r#"(
        nodes: { "grow": scale(scale: 2.0), "box": Box(half_size: (1.0, 1.0, 1.0)) },
        output: "grow", constant: Off, max_iterations: 3, end: "box",
    )"#;
    let formula = Formula::from_ron(text).unwrap();
    for choice in &formula.plan().choices {
        for method in choice.applicable.iter().filter(|method| !method.is_certified()) {
            let expected = (0.5f64 * 0.5 + 0.25 * 0.25).sqrt();
            let found = formula.estimate([0.625, -0.375, 0.0], *method);
            // Differences see a little beyond.
            let allowed = if method.is_difference() { 1e-3 } else { 1e-9 };
            // The Frobenius norm of a scaling is the root of 3 times its stretch.
            let factor = if method.name() == "frobenius" { 3f64.sqrt() } else { 1.0 };
            assert!((found * factor - expected).abs() < allowed, "{method:?}: {found}, expected {expected}");
        }
        assert!(choice.applicable.iter().any(|method| method.is_certified()));
    }
    for point in [[0.126, 0.0, 0.0], [0.124, 0.1, -0.12]] {
        let inside = point.iter().all(|x: &f64| x.abs() <= 0.125);
        assert_eq!(formula.inside(point), inside);
    }
}

/// Balls of every level of a scaling by 3 about a corner, joined in each way.
fn balls(join: &str, from: u32) -> Formula {
    let text = format!(
        "(nodes: {{ \"grow\": scale(scale: 3.0, centre: (1.0, 0.0, 0.0)), \"ball\": Sphere(radius: 0.5),
          \"balls\": Levels(of: \"grow\", shape: \"ball\", from: {from}, to: 3, join: {join}) }}, output: \"balls\")"
    );
    Formula::from_ron(&text).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn levels_are_joined_by_every_method() {
    // Level k is the ball of radius 0.5 / 3^k around (1 - 3^-k, 0, 0).
    let ball = |k: i32, p: [f64; 3]| {
        let size = 3f64.powi(-k);
        ((p[0] - 1.0 + size).powi(2) + p[1] * p[1] + p[2] * p[2]).sqrt() - 0.5 * size
    };
    for p in [[1.7, 0.3, -0.2], [-0.9, 0.1, 0.4], [0.8, 0.4, 0.0]] {
        let levels = [0, 1, 2].map(|k| ball(k, p));
        let cases = [
            (balls("Union", 0), levels[0].min(levels[1]).min(levels[2])),
            (balls("Union", 1), levels[1].min(levels[2])),
            (balls("Intersection", 0), levels[0].max(levels[1]).max(levels[2])),
            (balls("Difference", 0), levels[0].max(-levels[1]).max(-levels[2])),
        ];
        for (formula, expected) in &cases {
            for method in formula.plan().choices[0].applicable.iter().filter(|method| !method.is_certified()) {
                let found = formula.estimate(p, *method);
                let factor = if method.name() == "frobenius" { 3f64.sqrt() } else { 1.0 };
                let near = (found - expected).abs() < if method.is_difference() { 2e-2 } else { 1e-9 };
                // The Frobenius norm of level 0 is that of the identity as well.
                assert!(near || factor > 1.0, "{method:?} at {p:?}: {found}, expected {expected}");
            }
            assert!(*expected > 0.0 && !formula.inside(p));
        }
    }
    assert!(balls("Union", 0).inside([0.7, 0.0, 0.0]) && !balls("Difference", 0).inside([0.7, 0.0, 0.0]));
    assert!(balls("Difference", 0).inside([0.0, 0.0, 0.0]) && !balls("Union", 1).inside([0.0, 0.0, 0.0]));
    // Rounded seams only fill: never farther than the union.
    let smooth = balls("SmoothUnion(0.1)", 0);
    assert!(smooth.chosen_estimate([0.55, 0.3, 0.0]) < balls("Union", 0).chosen_estimate([0.55, 0.3, 0.0]));
}

/// An inverted ball is a ball: no estimate is above its distance, by any way into the warp, and at the surface all are 0.
#[test]
fn warped_fields_are_never_nearer_than_they_say() {
    let warped = |field: &str| {
        let text = format!(
            "(nodes: {{ \"invert\": inversion(), \"field\": {field}, \"seen\": Warp(of: \"field\", by: \"invert\") }},
              output: \"seen\", bounding_radius: 3.0)"
        );
        Formula::from_ron(&text).unwrap_or_else(|error| panic!("{error}"))
    };
    let ball = warped("Sphere(centre: (1.5, 0.0, 0.0), radius: 0.5)");
    let orbit = warped(
        "Orbit(of: translate(offset: (-1.5, 0.0, 0.0)), constant: Off, max_iterations: 1, end: Sphere(radius: 0.5))",
    );
    // From 1 to 2 on the axis, so from 1/2 to 1 inverted.
    for p in [[2.0, 0.0, 0.0], [0.75, 1.0, 0.0], [0.3, 0.0, 0.2], [-1.0, 0.5, 0.5], [0.75, 0.26, 0.0]] {
        let true_distance = ((p[0] - 0.75f64).powi(2) + p[1] * p[1] + p[2] * p[2]).sqrt() - 0.25;
        for formula in [&ball, &orbit] {
            let found = formula.chosen_estimate(p);
            assert!(found > 0.3 * true_distance && found <= true_distance + 1e-9, "{p:?}: {found} of {true_distance}");
        }
    }
    assert!(ball.inside([0.75, 0.2, 0.1]) && orbit.inside([0.75, 0.2, 0.1]) && !orbit.inside([0.75, 0.3, 0.0]));
}

#[test]
fn tiles_are_exact_over_the_walls() {
    let tiled = |mirror: bool| {
        let text = format!(
            "(nodes: {{ \"ball\": Sphere(centre: (0.3, 0.0, 0.0), radius: 0.4),
              \"tiled\": Tile(of: \"ball\", period: (2.0, 2.0, 0.0), mirror: {mirror}) }}, output: \"tiled\", bounding_radius: 20.0)"
        );
        Formula::from_ron(&text).unwrap_or_else(|error| panic!("{error}"))
    };
    // Balls around 0.3 + 2 k; mirrored around 0.3, 1.7, 4.3 ...
    let (plain, mirrored) = (tiled(false), tiled(true));
    for (p, expected) in
        [([1.2, 0.0, 0.0], 0.5), ([1.4, 0.0, 0.0], 0.5), ([4.3, 6.0, 1.0], 0.6), ([2.3, 1.0, 0.0], 0.6)]
    {
        assert!((plain.chosen_estimate(p) - expected).abs() < 1e-9, "{p:?}: {}", plain.chosen_estimate(p));
    }
    for (p, expected) in [([1.0, 0.0, 0.0], 0.3), ([1.7, 0.0, 1.0], 0.6), ([4.3, 0.0, 1.0], 0.6)] {
        assert!((mirrored.chosen_estimate(p) - expected).abs() < 1e-9, "{p:?}: {}", mirrored.chosen_estimate(p));
    }
}
