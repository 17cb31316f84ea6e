//! `stop_at`: a threshold of rays, never of the values of the fields that they meet.

use bulbfold::check::{Backends, Formula, Random, Target, truth};
use bulbfold::compose::{Choice, Purpose, compose_estimator};
use bulbfold::graph::StopAt;
use bulbfold::kernel::{Estimator, Kernel};
use bulbfold::march::MarchSettings;

use crate::support::formula;

const PIXEL_RADIUS: f64 = 1e-3;
/// The same where rays have a long way to walk.
const COARSE: f64 = 1e-2;

/// Where a ray of the formula's plan stops, on all back ends.
fn depths(formula: &Formula, pixel_radius: f64, origin: [f64; 3], direction: [f64; 3]) -> Vec<Option<f64>> {
    let (backends, subject, plan) = (Backends::new(), formula.subject(), formula.plan());
    let depth = |target: Target| {
        let settings = MarchSettings::of_plan(plan, pixel_radius, target.precision());
        let march = truth::candidate(&subject.composer(), &plan.choices, &settings).expect("it composes");
        let columns = truth::ray_columns(&[(origin, direction)], plan.bounding_radius);
        truth::ends(&backends.run(target, subject.arena, &march, &columns).expect("it runs"), 1)[0].depth()
    };
    backends.targets().into_iter().map(depth).collect()
}

/// A half space without a ball, and what is asked of its rays.
fn bowl(join: &str, stop: &str) -> String {
    format!(
        r#"(nodes: {{
            "bulb": bulb_power(power: 8),
            "ball": Orbit(of: "bulb", constant: Julia((0, 0, 0)), escape_radius: 10, max_iterations: 30, estimate: (method: "scalar")),
            "half": Box(centre: (0, 0, -5), half_size: (10, 10, 5)), "far": Sphere(centre: (7, 0, 0), radius: 0.5),
            "cut": Difference(a: "half", b: "ball"), {join}
        }}, output: "out", bounding_radius: 9, estimate: (method: "scalar"{stop}))"#
    )
}

#[test]
fn an_orbit_within_a_field_has_no_threshold_of_its_own() {
    let formula = formula(include_str!("stop_at/bite.ron"));
    assert_eq!(formula.plan().stop_at, None);
    for depth in depths(&formula, PIXEL_RADIUS, [-0.827, -0.333, 1.0], [0.0, 0.0, -1.0]) {
        assert!(depth.is_some_and(|t| (t - 1.3332).abs() < 0.02), "{depth:?}");
    }
}

/// From within the ball nobody knows how far its wall is: that is no distance below a threshold.
#[test]
fn what_is_cut_away_stops_no_ray() {
    let joins = [
        r#""out": Union(["cut", "far"])"#,
        r#""out": Intersection(["cut", "half"])"#,
        r#""out": SmoothUnion(of: ["cut", "far"], radius: 0.1)"#,
        r#""moved": Transform(of: "cut", scale: 1), "out": Union(["moved", "far"])"#,
        r#""tiled": Tile(of: "cut", period: (30, 30, 0)), "out": Union(["tiled", "far"])"#,
        r#""other": Difference(a: "cut", b: "far"), "out": Union(["other", "far"])"#,
    ];
    for join in joins {
        for stop in ["", ", stop_at: 1", r#", stop_at: "0.02u""#] {
            let formula = formula(&bowl(join, stop));
            assert_eq!(formula.plan().stop_at.is_some(), !stop.is_empty(), "{join} {stop}");
            for depth in depths(&formula, COARSE, [0.3, 0.2, 2.0], [0.0, 0.0, -1.0]) {
                let bottom = 2.0 + (1.0f64 - 0.13).sqrt();
                assert!(depth.is_some_and(|t| (t - bottom).abs() < 0.06), "{join} {stop}: {depth:?}");
            }
            // Beside the ball the face is still there.
            for depth in depths(&formula, COARSE, [3.0, 0.2, 2.0], [0.0, 0.0, -1.0]) {
                assert!(depth.is_some_and(|t| (t - 2.0).abs() < 0.06), "{join} {stop}: {depth:?}");
            }
        }
    }
}

/// Half of r ln r is the estimate of the unit ball: 0.01 at r = 1.0198, from wherever that is seen.
#[test]
fn a_threshold_may_be_a_length_in_the_world() {
    for stop in [r#""0.01u""#, "World(0.01)"] {
        let formula = formula(&format!(
            r#"(nodes: {{ "bulb": bulb_power(power: 8) }}, constant: Julia((0, 0, 0)), escape_radius: 10, max_iterations: 30,
            bounding_radius: 2, estimate: (method: "scalar", form: logarithmic, stop_at: {stop}))"#
        ));
        assert_eq!(formula.plan().stop_at, Some(StopAt::World(0.01)));
        for origin in [[0.0, -3.0, 0.0], [0.0, -300.0, 0.0]] {
            for depth in depths(&formula, PIXEL_RADIUS, origin, [0.0, 1.0, 0.0]) {
                let r = depth.map(|t| -origin[1] - t);
                assert!(r.is_some_and(|r| r > 1.0 && r < 1.0205), "{r:?}");
            }
        }
    }
    assert!(StopAt::parse("-1u").is_err() && StopAt::parse("1000").is_err() && StopAt::parse("u").is_err());
    assert_eq!(StopAt::parse(" 0.5"), Ok(StopAt::Pixels(0.5)));
}

/// Normals below the threshold have nothing to do with the face that rays see: in front of the sponge's they point anywhere.
#[test]
fn normals_are_those_of_the_threshold() {
    const EPS: f64 = 0.02;
    let formula = Formula::with("menger", &[("estimate", r#"(method: "scalar", stop_at: 1)"#)]).unwrap();
    let subject = formula.subject();
    assert!(formula.plan().choices[0].stops);
    // In front of a face, off its holes of the first two levels.
    let mut random = Random::new(1);
    let mut place = || [1.0 + EPS, random.range(0.36, 0.5), random.range(0.36, 0.5)];
    let points: Vec<[f64; 3]> = (0..400).map(|_| place()).collect();
    let towards_face = |stops: bool| {
        let choices: Vec<_> = formula.plan().choices.iter().map(|c| Choice { stops, ..c.clone() }).collect();
        let surface = compose_estimator(&subject.composer(), &choices, Purpose::Surface);
        let surface = Kernel::Estimate(surface.unwrap_or_else(|e| panic!("{}", e.message)));
        let columns = Estimator::columns(&points, &[[-1.0, 0.0, 0.0]], &[1e-4], EPS);
        let out = Backends::cpu_only().run(Target::CPU_F64, subject.arena, &surface, &columns).unwrap();
        out[0].iter().sum::<f64>() / points.len() as f64
    };
    let (over, below) = (towards_face(true), towards_face(false));
    println!("cosine between normals and the face's: {over:.3} over the threshold, {below:.3} below it");
    assert!(over > below + 0.02, "{over} and {below}");
}
