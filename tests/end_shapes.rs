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
