//! Proofs under attack: points that are known to be in the set against balls and segments that are said to be empty.

use bulbfold::check::{Backends, Formula, Random, Target, truth};
use bulbfold::graph::{EstimateSettings, Method};
use bulbfold::kernel::Estimator;
use bulbfold::render::RenderSettings;
use bulbfold::shade::Size;

type P = [f64; 3];

/// Fractals of the repository and families beside them; every kind of node and of growth rule takes part.
const SYSTEMS: &[(&str, &str)] = &[
    ("mandelbulb", ""),
    ("mandelbulb_julia", ""),
    ("mandelbulb_power2", ""),
    ("mandelbox", ""),
    ("mandelbox_negative", ""),
    ("juliabox", ""),
    ("menger", ""),
    ("sierpinski_tetrahedron", ""),
    ("icosahedron_kifs", ""),
    ("quaternion_julia", ""),
    ("box_bulb", ""),
    ("menger_bulb", ""),
    (
        "power 3, asin",
        r#"(nodes: {"a": bulb_power(power: 3, convention: "asin")}, escape_radius: 10, max_iterations: 7)"#,
    ),
    ("power 2.5", r#"(nodes: {"a": bulb_power(power: 2.5)}, escape_radius: 10, max_iterations: 6)"#),
    (
        "power -3",
        r#"(nodes: {"a": Sequence([bulb_power(power: -3), scale(scale: 0.5)])}, constant: Julia((0.6, 0.2, 0.1)), escape_radius: 4, max_iterations: 4)"#,
    ),
    ("bicomplex", r#"(nodes: {"a": bicomplex_square()}, escape_radius: 10, max_iterations: 8, slice: 0.1)"#),
    ("table", r#"(nodes: {"a": table_square()}, escape_radius: 10, max_iterations: 8)"#),
    (
        "squeezed box",
        r#"(nodes: {"a": Sequence([box_fold(), sphere_fold(), linear(matrix: ((2, 0.2, 0), (0, 1.6, 0.3), (0.1, 0, 1.8)))])}, escape_radius: 60, max_iterations: 7)"#,
    ),
    (
        "choice",
        r#"(nodes: {"b": bulb_power(power: 2), "m": quaternion_square(), "a": Choose(when: Negative("x"), then: "b", otherwise: "m")}, escape_radius: 10, max_iterations: 6)"#,
    ),
    (
        "blend",
        r#"(nodes: {"b": bulb_power(power: 3), "m": quaternion_square(), "a": Blend(a: "b", b: "m", weight: 0.4)}, escape_radius: 10, max_iterations: 6)"#,
    ),
    (
        "pre and inversion",
        r#"(nodes: {"i": inversion(centre: (0, 0, 3)), "a": bulb_power(power: 4)}, output: "a", pre: ["i"], escape_radius: 10, max_iterations: 5)"#,
    ),
    (
        "radiolari",
        r#"(nodes: {"a": Sequence([bulb_power(power: 4), radiolari()])}, escape_radius: 10, max_iterations: 5)"#,
    ),
];

fn formula((name, text): (&str, &str)) -> Formula {
    let loaded = if text.is_empty() { Formula::builtin(name) } else { Formula::from_ron(text) };
    loaded.unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn at(p: P, d: P, t: f64) -> P {
    [0, 1, 2].map(|i| p[i] + d[i] * t)
}

/// Points of the set next to its surface: where rays end, which is never outside.
fn members(formula: &Formula, random: &mut Random, count: usize) -> Vec<P> {
    let subject = formula.subject();
    let radius = subject.plan.bounding_radius;
    let rays: Vec<(P, P)> = (0..count)
        .map(|_| {
            let from = random.direction().map(|x| x * radius * 0.999);
            let to = random.direction().map(|x| x * radius * 0.5 * random.unit());
            let d = glam::DVec3::from(at(to, from, -1.0)).normalize().to_array();
            (from, d)
        })
        .collect();
    let depths = subject.depths(&Backends::cpu_only(), Target::CpuF64, &rays, 1e-6 * radius);
    let depths = depths.unwrap().unwrap_or_else(|e| panic!("{}", e.message));
    let hits: Vec<P> = rays.iter().zip(depths).filter_map(|(ray, t)| Some(at(ray.0, ray.1, t?))).collect();
    // What a tie of rounding would decide is not known to be in the set.
    hits.into_iter().filter(|p| formula.inside(*p)).collect()
}

/// Attacks `tries` proofs of a method and gives how many proved anything. Panics where a proof holds a member.
fn attack(name: &str, formula: &Formula, method: Method, target: Target, tries: usize) -> usize {
    let subject = formula.subject();
    let mut random = Random::new(tries as u64);
    let members = members(formula, &mut random, 400);
    assert!(members.len() > 20, "{name}: only {} members were found", members.len());
    let radius = subject.plan.bounding_radius;
    let choices = subject.choices(Some(method)).expect("proofs apply everywhere");
    let kernel = subject.estimator(&choices).unwrap_or_else(|e| panic!("{name}: {}", e.message));
    let (mut points, mut directions, mut h, mut victims) = (vec![], vec![], vec![], vec![]);
    for _ in 0..tries {
        let member = members[random.below(members.len())];
        let away = random.direction();
        let distance = radius * 10f64.powf(random.range(-4.0, -0.3));
        points.push(at(member, away, distance));
        directions.push(away.map(|x| -x));
        h.push(distance * 10f64.powf(random.range(-0.1, 1.0)));
        victims.push((member, distance));
    }
    let columns = Estimator::columns(&points, &directions, &h, 1e-9);
    let out = Backends::cpu_only().run(target, subject.arena, &kernel, &columns).unwrap();
    let mut proven = 0;
    for (i, (member, distance)) in victims.iter().enumerate() {
        let (de, inside) = (out[0][i], out[1][i] > 0.5);
        proven += usize::from(!inside && de > 0.0);
        // The point itself is rounded to single precision before anything is proven about it.
        let rounding = if target == Target::CpuF64 { 1e-12 } else { 3e-7 } * radius;
        assert!(
            inside || de <= distance * (1.0 + 1e-9) + rounding,
            "{name}, {} on {}: {de} around {:?} is said to be empty (start {}), but {member:?} at {distance} is in the set",
            method.name(),
            target.name(),
            points[i],
            h[i]
        );
    }
    proven
}

fn attack_all(tries: usize) {
    for system in SYSTEMS {
        let formula = formula(*system);
        for method in [Method::CertifiedBall, Method::Certified] {
            for target in [Target::CpuF64, Target::CpuF32] {
                let proven = attack(system.0, &formula, method, target, tries);
                println!(
                    "{:<24} {:<15} {}: {proven} of {tries} proved something",
                    system.0,
                    method.name(),
                    target.name()
                );
                assert!(proven * 50 > tries, "{}: {} proves almost nothing ({proven})", system.0, method.name());
            }
        }
    }
}

#[test]
fn no_member_is_in_a_proof() {
    attack_all(3_000);
}

#[test]
#[ignore = "a million tries a system: minutes"]
fn no_member_is_in_a_million_proofs() {
    attack_all(250_000);
}

#[test]
fn certified_marches_miss_nothing() {
    for system in &SYSTEMS[..12] {
        let formula = formula(*system);
        for method in [Method::CertifiedBall, Method::Certified] {
            let settings = RenderSettings {
                size: Size { width: 160, height: 90 },
                estimate: EstimateSettings { method: Some(method), ..EstimateSettings::default() },
                ..RenderSettings::default()
            };
            let judged = truth::judge(&formula.subject(), 150, &settings).unwrap();
            assert_eq!(judged.missed, 0.0, "{} with {}: {judged:?}", system.0, method.name());
        }
    }
}
