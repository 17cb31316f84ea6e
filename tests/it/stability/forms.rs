//! Forms of the estimate, ranges of numbers, differences and rays.

use super::suite::{P, answers, depths, length, sound_answers};
use bulbfold::check::Target;

use crate::support::formula;

fn scaling(scale: f64, rest: &str) -> String {
    format!(
        r#"(nodes: {{ "grow": scale(scale: {scale:?}) }}, constant: Off, bounding_radius: 4,
            estimate: (form: linear, radius: 0), {rest})"#
    )
}

/// The unit ball as a bulb's Julia set; the estimate is r ln r / 2.
const BALL: &str = r#"(nodes: { "bulb": bulb_power(power: 8) }, constant: Julia((0, 0, 0)), escape_radius: 10,
    max_iterations: 30, bounding_radius: 2, estimate: (form: logarithmic))"#;

pub fn large_bailout() {
    let points: Vec<P> = [0.3, 1.0, 7.7].map(|x| [x, -0.4 * x, 0.2 * x]).to_vec();
    for answer in sound_answers(&scaling(100.0, "escape_radius: 1e6, max_iterations: 40"), &points) {
        answer.is(length(answer.p));
    }
}

pub fn jacobian_squares() {
    let points: Vec<P> = [1e-12, 1e-18].map(|x| [x, -0.4 * x, 0.2 * x]).to_vec();
    for answer in answers(&formula(&scaling(2.0, "escape_radius: 1e6, max_iterations: 100")), &points) {
        assert!(!answer.inside);
        // Differences over such lengths are below what a march takes.
        if !answer.method.is_difference() {
            answer.sound().is(length(answer.p));
        }
    }
}

pub fn running_derivative() {
    let sponge = r#"(nodes: { "fold": menger_fold(), "grow": scale(scale: 3, centre: (1, 1, 1)),
        "all": Sequence(["fold", "grow"]) }, output: "all", constant: Off, escape_radius: 8, max_iterations: 200,
        bounding_radius: 2, estimate: (form: linear, radius: 1.7320508))"#;
    for answer in sound_answers(sponge, &[[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]]) {
        assert!(answer.inside && answer.de == 0.0, "{answer:?}");
    }
    for answer in sound_answers(sponge, &[[2.0, 2.0, 2.0], [1.001, 1.001, 1.001]]) {
        let wanted = length(answer.p.map(|x| x - 1.0));
        let slack = if answer.target == Target::CPU_F64 { 1e-5 } else { 1e-3 };
        assert!(answer.de <= wanted * (1.0 + slack + answer.slack()), "{wanted}: {answer:?}");
        assert!(!answer.inside && answer.de > 0.0, "{answer:?}");
    }
}

pub fn underflow() {
    for answer in sound_answers(BALL, &[[1e-30, 0.0, 0.0], [0.0, 1e-20, 1e-20], [1e-5, -1e-5, 1e-5], [0.0, 0.0, 1e-38]])
    {
        assert!(answer.inside && answer.de == 0.0, "{answer:?}");
    }
}

pub fn small_bailout() {
    let text = r#"(nodes: { "fold": menger_fold(), "grow": scale(scale: 3, centre: (1, 1, 1)),
        "all": Sequence(["fold", "grow"]) }, output: "all", constant: Off, escape_radius: 1, max_iterations: 8,
        bounding_radius: 2, estimate: (form: linear, radius: 1.7320508))"#;
    // A corner is a member; its orbit stays at r = sqrt(3), which is beyond this bailout.
    let corner = [1.0, 1.0, 1.0];
    for answer in sound_answers(text, &[corner, [0.9, 0.95, 1.0], [1.5, 1.5, 1.5], [0.1, 0.1, 0.1]]) {
        // What is around it escapes too, which proofs know.
        let near = answer.de <= 1e-6 || answer.method.is_certified();
        assert!(answer.p != corner || (!answer.inside && near), "{answer:?}");
    }
}

pub fn iteration_shells() {
    // With scale 2 and a bailout of 8 the count changes where r is a power of 2.
    let mut points = Vec::new();
    for shell in [0.25, 0.5, 1.0, 2.0, 4.0] {
        points.extend(
            [1.0 - 1e-3, 1.0 - 1e-6, 1.0, 1.0 + 1e-6, 1.0 + 1e-3].map(|x| [0.0, shell * x * 0.6, shell * x * 0.8]),
        );
    }
    for answer in sound_answers(&scaling(2.0, "escape_radius: 8, max_iterations: 30"), &points) {
        answer.is(length(answer.p));
    }
    let mut points = Vec::new();
    for k in 0..4 {
        // And with power 8 and a bailout of 10 where r^(8^k) is 10.
        let shell = 10f64.powf(0.125f64.powi(k));
        points.extend([1.0 - 1e-5, 1.0, 1.0 + 1e-5].map(|x| [shell * x, 0.0, 0.0]));
    }
    for answer in sound_answers(BALL, &points) {
        let r = length(answer.p);
        answer.is(r * r.ln() / 2.0);
    }
}

pub fn tiny_differences() {
    let text = r#"(nodes: { "bulb": bulb_power(power: 8), "ball": Orbit(of: "bulb", constant: Julia((0, 0, 0)),
            escape_radius: 10, max_iterations: 30, estimate: (form: logarithmic)),
            "there": Transform(of: "ball", translate: (100, 0, 0)) }, output: "there", bounding_radius: 102)"#;
    let rays = [([103.0, 0.0, 0.0], [-1.0, 0.0, 0.0]), ([100.0, 0.0, -4.0], [0.0, 0.0, 1.0])];
    let wanted = [2.0, 3.0];
    depths(text, &rays, 1e-3, |target, method, i, depth| {
        let depth = depth.unwrap_or_else(|| panic!("{target:?} {method:?}: ray {i} misses"));
        assert!((depth - wanted[i]).abs() < 1e-2, "{target:?} {method:?}: {depth}, not {}", wanted[i]);
    });
}

pub fn far_field() {
    let rays: Vec<(P, P)> = vec![
        ([100.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ([0.0, -1e4, 0.0], [0.0, 1.0, 0.0]),
        ([60.0, 0.0, 80.0], [-0.6, 0.0, -0.8]),
    ];
    depths(BALL, &rays, 1e-4, |target, method, i, depth| {
        let wanted = length(rays[i].0) - 1.0;
        let depth = depth.unwrap_or_else(|| panic!("{target:?} {method:?}: ray {i} misses"));
        // Single precision has steps of 1e-3 at 1e4.
        let slack = if target == Target::CPU_F64 { 2e-4 } else { 2e-4 + wanted * 1e-6 };
        assert!((depth - wanted).abs() < slack, "{target:?} {method:?}: {depth}, not {wanted}");
    });
    for answer in sound_answers(BALL, &[[100.0, 0.0, 0.0]]) {
        answer.is(50.0 * 100f64.ln());
    }
}

pub fn grazing_rays() {
    let offsets = [0.9, 0.99, 0.999, 1.001, 1.01, 1.1];
    let rays = offsets.map(|y| ([-3.0, y, 0.0], [1.0, 0.0, 0.0]));
    depths(BALL, &rays, 1e-5, |target, method, i, depth| {
        let wanted = (offsets[i] < 1.0).then(|| 3.0 - (1.0 - offsets[i] * offsets[i]).sqrt());
        match (depth, wanted) {
            (None, None) => {}
            // The surface is reached at a flat angle: a threshold's height is many along the ray.
            (Some(depth), Some(wanted)) if (depth - wanted).abs() < 2e-3 => {}
            _ => panic!("{target:?} {method:?}: offset {}: {depth:?}, not {wanted:?}", offsets[i]),
        }
    });
}
