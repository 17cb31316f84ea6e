//! Bounding radii that nobody stated: no member is beyond, proofs are made where they can be, and balls are no larger than needed.
//!
//! The long run takes all built-in fractals and the graphs of a folder, and a million members:
//!
//! ```sh
//! python3 scripts/random_graphs.py 1..300 -d graphs
//! BULBFOLD_GRAPHS=graphs cargo test --release --test it reach:: -- --ignored --nocapture
//! ```

use std::time::Instant;

use bulbfold::check::Formula;
use bulbfold::check::random::Random;
use bulbfold::check::truth::Members;
use bulbfold::compose::Reach;
use bulbfold::formula::embedded::FRACTALS;
use bulbfold::graph::DeForm;

/// What random points say of a formula.
struct Seen {
    members: usize,
    beyond: usize,
    farthest: f64,
}

/// Asks random points whether they belong to a formula: in balls of several sizes, and with radii of all sizes.
fn members(formula: &Formula, tries: usize, seed: u64) -> Seen {
    let radius = formula.plan().bounding_radius;
    let members = Members::new(&formula.subject().composer(), &formula.plan().choices).unwrap();
    let mut random = Random::new(seed);
    let mut seen = Seen { members: 0, beyond: 0, farthest: 0.0 };
    for (share, size) in [(0.3, 0.7), (0.2, 1.0), (0.2, 1.5), (0.1, 4.0), (0.2, 0.0)] {
        let mut point = || match size > 0.0 {
            true => random.in_ball(size * radius),
            false => {
                let r = radius * 10f64.powf(random.range(-2.0, 2.5));
                random.direction().map(|x| x * r)
            }
        };
        let points: Vec<[f64; 3]> = (0..(tries as f64 * share) as usize).map(|_| point()).collect();
        let inside = members.inside(&points, &vec![1e-9; points.len()]);
        for (p, _) in points.iter().zip(inside).filter(|(_, inside)| *inside) {
            let r = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            seen.members += 1;
            seen.beyond += usize::from(r > radius * (1.0 + 1e-9));
            seen.farthest = seen.farthest.max(r);
        }
    }
    seen
}

/// Whether a ball is meant to cut: the file says so, or the set has no end, as planes, tiles and gyroids have none.
fn is_cut(formula: &Formula) -> bool {
    let members = Members::new(&formula.subject().composer(), &formula.plan().choices).unwrap();
    let mut random = Random::new(11);
    let far: Vec<[f64; 3]> = (0..2000).map(|_| random.direction().map(|x| x * 900.0)).collect();
    let is_endless = members.inside(&far, &vec![1e-9; far.len()]).contains(&true);
    formula.graph().cuts || formula.plan().reach == Reach::Endless || is_endless
}

#[test]
fn columns_beyond_the_first_samples_are_kept() {
    let formula = Formula::open("tests/it/reach/column.ron").unwrap();
    let seen = members(&formula, 200_000, 1);
    let radius = formula.plan().bounding_radius;
    assert!((1.1..12.0).contains(&radius), "{radius}, {:?}", formula.plan().reach);
    assert!(seen.members > 0 && seen.beyond == 0, "{} of {} beyond {radius}", seen.beyond, seen.members);
}

#[test]
fn sizes_that_are_known_are_proven() {
    let quaternion = "(nodes: { \"a\": quaternion_square() }, output: \"a\", escape_radius: 4, max_iterations: 60)";
    let union = "(nodes: { \"a\": bulb_power(power: 8), \"o\": Orbit(of: \"a\", escape_radius: 4, max_iterations: 6), \
                 \"b\": Transform(of: \"o\", translate: (3, 0, 0)), \"c\": Difference(a: \"b\", b: Sphere(radius: 1)) }, output: \"c\")";
    let ball = "(nodes: { \"a\": Intersection([Box(half_size: (1, 1, 30)), Sphere(radius: 2)]) }, output: \"a\")";
    // The set of z^2 + c holds -2; the bulb ends at 1.2 from its middle.
    for (text, least, most) in [(quaternion, 2.0, 2.3), (union, 4.0, 4.8), (ball, 1.9, 2.2)] {
        let plan = Formula::from_ron(text).unwrap().plan().clone();
        assert_eq!(plan.reach, Reach::Proven, "{text}");
        assert!((least..most).contains(&plan.bounding_radius), "{} for {text}", plan.bounding_radius);
    }
}

#[test]
fn steep_shapes_are_bounded_whatever_they_state() {
    let formula = Formula::open("tests/it/reach/bumpy_ball.ron").unwrap();
    let seen = members(&formula, 200_000, 1);
    assert!(seen.members > 1000 && seen.beyond == 0);
    let plan = formula.plan();
    assert!(
        plan.reach == Reach::Proven && (1.1..1.6).contains(&plan.bounding_radius),
        "{:?} {}",
        plan.reach,
        plan.bounding_radius
    );
}

#[test]
fn endless_sets_are_told() {
    let text = "(nodes: { \"a\": Tile(of: Sphere(radius: 0.5), period: (2, 2, 2)) }, output: \"a\")";
    let plan = Formula::from_ron(text).unwrap().plan().clone();
    assert_eq!(plan.reach, Reach::Endless);
    assert!(plan.warnings.iter().any(|w| w.contains("reaches beyond")), "{:?}", plan.warnings);
}

#[test]
fn radii_that_cut_the_set_are_told() {
    let formula = |radius: &str| Formula::with("mandelbulb", &[("bounding_radius", radius)]).unwrap();
    assert!(formula("0.8").plan().warnings.iter().any(|w| w.contains("cuts the set")));
    assert_eq!(formula("1.5").plan().warnings, Vec::<String>::new());
}

#[test]
fn rays_from_the_surface_of_a_large_ball_do_not_leap_over_the_set() {
    let formula = Formula::open("tests/it/reach/far_parts.ron").unwrap();
    let plan = formula.plan();
    let (radius, method) = (plan.bounding_radius, plan.choices[0].method);
    assert!(radius > 5.0 && plan.choices[0].form == DeForm::Logarithmic, "{radius}");
    for direction in [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [-0.36, 0.48, -0.8]] {
        let estimate = formula.estimate(direction.map(|x| x * radius), method);
        assert!(estimate <= 0.5 * radius, "{estimate} at {radius}");
    }
}

#[test]
fn no_member_is_beyond() {
    for name in crate::sampled::sampled(20) {
        let formula = Formula::builtin(name).unwrap();
        let seen = members(&formula, 20_000, 3);
        assert!(is_cut(&formula) || seen.beyond == 0, "{name}: members reach {}", seen.farthest);
    }
}

/// A line for each formula, and the number of members beyond their bounds.
fn report(name: &str, formula: impl Fn() -> Formula, tries: usize) -> Seen {
    let start = Instant::now();
    let formula = formula();
    let time = start.elapsed();
    let seen = members(&formula, tries, 5);
    let plan = formula.plan();
    let ratio = plan.bounding_radius / seen.farthest;
    let (reach, radius) = (plan.reach.name(), plan.bounding_radius);
    let mark = if seen.beyond > 0 && !is_cut(&formula) { "BEYOND" } else { "" };
    println!("{name:28} {radius:9.4} {reach:9} {ratio:7.3} {:7} members {:5.0?} {mark}", seen.members, time);
    if is_cut(&formula) { Seen { beyond: 0, ..seen } } else { seen }
}

#[test]
#[ignore = "takes minutes: a million members of all built-in fractals and of graphs from a folder"]
fn a_million_members_are_within() {
    let mut all = Vec::new();
    let tries: usize = std::env::var("BULBFOLD_TRIES").ok().and_then(|n| n.parse().ok()).unwrap_or(40_000);
    if std::env::var_os("BULBFOLD_GRAPHS_ALONE").is_none() {
        all.extend(FRACTALS.iter().map(|(name, _)| report(name, || Formula::builtin(name).unwrap(), tries)));
    }
    if let Ok(folder) = std::env::var("BULBFOLD_GRAPHS") {
        let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().flatten().map(|entry| entry.path()).collect();
        paths.retain(|path| path.extension().is_some_and(|e| e == "ron"));
        paths.sort();
        let name = |path: &std::path::Path| path.file_stem().unwrap().to_string_lossy().into_owned();
        all.extend(paths.iter().map(|path| report(&name(path), || Formula::open(path).unwrap(), tries)));
    }
    let sum = |of: fn(&Seen) -> usize| all.iter().map(of).sum::<usize>();
    println!("{} members of {} formulas, {} beyond", sum(|s| s.members), all.len(), sum(|s| s.beyond));
    assert_eq!(sum(|s| s.beyond), 0);
}

#[test]
fn norms_say_nothing_where_orbits_end_by_another_test() {
    // No point with x below 0 ever gets above 4: half of space belongs to the set.
    let text = "(nodes: { \"a\": scale(scale: 3) }, output: \"a\", constant: Off, escape: Above(\"x\", 4.0), max_iterations: 8)";
    let plan = Formula::from_ron(text).unwrap().plan().clone();
    assert_eq!(plan.reach, Reach::Endless, "{}", plan.bounding_radius);
}
