//! Bulb powers: the origin, the poles, seams, and the range of numbers.

use super::suite::{P, answers, length, sound_answers};
use bulbfold::check::Target;

use crate::support::formula;

const CONVENTIONS: [&str; 3] = ["acos", "asin", "y"];

fn bulb(power: f64, convention: &str, rest: &str) -> String {
    format!(
        r#"(nodes: {{ "bulb": bulb_power(power: {power:?}, convention: {convention}) }}, bounding_radius: 2,
            estimate: (form: logarithmic), {rest})"#
    )
}

/// The pole of a convention at a height.
fn pole(convention: &str, height: f64) -> P {
    if convention == "y" { [0.0, height, 0.0] } else { [0.0, 0.0, height] }
}

pub fn origin_of_bulbs() {
    for convention in CONVENTIONS {
        for power in [2.0, 3.0, 4.0, 8.0, 2.5, 7.3] {
            let text = bulb(power, convention, "escape_radius: 10, max_iterations: 12");
            for answer in sound_answers(&text, &[[0.0; 3], [-0.0; 3], [0.0, -0.0, 0.0]]) {
                assert!(answer.inside && answer.de == 0.0, "{convention} {power}: {answer:?}");
            }
        }
    }
}

pub fn start_of_julia_sets() {
    let c = [0.9, -1.1, 1.3];
    for convention in CONVENTIONS {
        for power in [2.0, 3.0, 8.0, 2.5] {
            let julia = "constant: Julia((0.9, -1.1, 1.3)), escape_radius: 10, max_iterations: 12";
            let formula = formula(&bulb(power, convention, julia));
            assert_eq!(formula.orbit([0.0; 3], 1), c, "{convention} {power}");
            for answer in answers(&formula, &[[0.0; 3]]) {
                assert!(!answer.inside, "{convention} {power}: {answer:?}");
                // Where the slope is 0 nothing is near, as the quotient's limit says. Differences reach beyond the flat
                // place, and see any slope or none; proofs look at all of it.
                let looks_around = answer.method.is_difference() || answer.method.is_certified();
                assert!(answer.de >= 1e30 || looks_around, "{convention} {power}: {answer:?}");
            }
        }
    }
}

/// Where the orbit of a real number a under a^n + a ends: r, dr and the iterations.
fn real_orbit(a: f64, n: i32, escape_radius: f64, max_iterations: u32) -> Option<(f64, f64)> {
    let (mut z, mut dr) = (a, 1.0);
    for _ in 0..max_iterations {
        (z, dr) = (z.powi(n) + a, f64::from(n) * z.powi(n - 1) * dr + 1.0);
        if z.abs() > escape_radius {
            return Some((z.abs(), dr.abs()));
        }
    }
    None
}

pub fn poles_of_bulbs() {
    for convention in ["acos", "y"] {
        for n in [2, 3, 4, 8] {
            let text = bulb(f64::from(n), convention, "escape_radius: 10, max_iterations: 12");
            for height in [0.95, 1.1, 1.3, 1.9] {
                let (r, dr) = real_orbit(height, n, 10.0, 12).expect("it escapes");
                for answer in sound_answers(&text, &[pole(convention, height)]) {
                    assert!(!answer.inside);
                    answer.is(r * r.ln() / (2.0 * dr));
                }
            }
            // The south pole goes north first where the power is even.
            for answer in sound_answers(&text, &[pole(convention, -1.1), pole(convention, -1.9)]) {
                assert!(answer.de <= length(answer.p), "farther than the origin, which is inside: {answer:?}");
            }
        }
    }
    for n in [2, 3, 4, 8] {
        let text = bulb(f64::from(n), "asin", "escape_radius: 10, max_iterations: 12");
        let formula = formula(&text);
        for height in [1.1f64, -1.1, 1.9, -1.9] {
            // The tilt is a quarter turn n-fold; the azimuth counts as 0.
            let tilt = f64::from(n) * std::f64::consts::FRAC_PI_2 * height.signum();
            let r = height.abs().powi(n);
            let wanted = [r * tilt.cos(), 0.0, r * tilt.sin() + height];
            let found = formula.orbit([0.0, 0.0, height], 1);
            assert!((0..3).all(|i| (found[i] - wanted[i]).abs() < 1e-9), "{n} at {height}: {found:?}");
            for answer in answers(&formula, &[[0.0, 0.0, height]]) {
                assert!(answer.sound().de <= height.abs(), "farther than the origin, which is inside: {answer:?}");
            }
        }
    }
}

/// Points of a sphere: the poles of all conventions, the seam of azimuth 180 degrees, and beside them.
fn seams(r: f64) -> Vec<P> {
    let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]];
    let mut points = Vec::new();
    for u in unit {
        points.extend([u.map(|x: f64| x * r), u.map(|x| -x * r), [u[0] * -r, u[1] * r, u[2] * r]]);
        points.push([u[0] * -r, u[1] * r, u[2] * r + 1e-7]);
    }
    points
}

pub fn fractional_powers() {
    for convention in CONVENTIONS {
        for power in [2.5, 3.7, 1.5] {
            let text = bulb(power, convention, "constant: Julia((0, 0, 0)), escape_radius: 10, max_iterations: 40");
            for answer in sound_answers(&text, &[seams(1.2), seams(2.5)].concat()) {
                let r = length(answer.p);
                assert!(!answer.inside);
                answer.is(r * r.ln() / 2.0);
            }
            assert!(sound_answers(&text, &seams(0.98)).iter().all(|answer| answer.inside && answer.de == 0.0));
        }
    }
}

pub fn powers_below_one() {
    for power in [0.5, -0.5, 0.25, -0.9] {
        let text = bulb(power, "acos", "constant: Julia((0, 0, 0)), escape_radius: 10, max_iterations: 30");
        for answer in sound_answers(&text, &[seams(0.5), seams(1.0), seams(3.0)].concat()) {
            assert!(answer.inside && answer.de == 0.0, "{power}: {answer:?}");
        }
    }
}

pub fn negative_powers() {
    for convention in CONVENTIONS {
        for power in [-2.0, -3.0, -8.0, -2.5] {
            let text = bulb(power, convention, "constant: Julia((0, 0, 0)), escape_radius: 10, max_iterations: 30");
            let points = [seams(0.5), seams(0.9), seams(1.2), seams(3.0)].concat();
            for answer in answers(&formula(&text), &points) {
                assert!(!answer.inside, "{convention} {power}: {answer:?}");
                // From 0.001 the power -8 leads to 1e24, from there to nowhere in single precision.
                assert!(answer.de >= 0.0 || (answer.de.is_nan() && answer.target != Target::CPU_F64), "{answer:?}");
            }
            // The pole: thrown out at once, as far as numbers reach.
            for answer in answers(&formula(&text), &[[0.0; 3]]) {
                assert!(!answer.inside, "{convention} {power}: {answer:?}");
                assert!(answer.de.is_nan() || answer.sound().de >= 0.0, "{convention} {power}: {answer:?}");
            }
        }
    }
}

pub fn power_overflow() {
    for (power, escape_radius) in [(8.0, 255.0), (8.0, 1e3), (8.0, 1e4), (3.0, 1e6), (2.0, 1e6)] {
        let rest = format!("constant: Julia((0, 0, 0)), escape_radius: {escape_radius:?}, max_iterations: 40");
        // The last but one state is just below the bailout: the last is as large as it gets.
        let start = f64::powf(0.9 * escape_radius, f64::powi(power, -2));
        for convention in CONVENTIONS {
            for answer in sound_answers(&bulb(power, convention, &rest), &[seams(1.2), seams(start)].concat()) {
                let r = length(answer.p);
                answer.is(r * r.ln() / 2.0);
            }
        }
    }
}

pub fn hopeless_overflow() {
    let rest = "constant: Julia((0, 0, 0)), escape_radius: 1e6, max_iterations: 40";
    let formula = formula(&bulb(8.0, "acos", rest));
    for answer in answers(&formula, &[seams(1.2), seams(1.5), seams(1.9), seams(1e6f64.powf(1.0 / 65.0))].concat()) {
        let r = length(answer.p);
        assert!(!answer.inside, "{answer:?}");
        if answer.target == Target::CPU_F64 || !answer.de.is_nan() {
            answer.is(r * r.ln() / 2.0);
        }
    }
}

pub fn max_iterations_0_and_1() {
    let none = bulb(8.0, "acos", "escape_radius: 10, max_iterations: 0");
    for answer in sound_answers(&none, &[[0.0; 3], [0.5, 0.0, 0.0], [1.9, 0.0, 0.0], [100.0, 0.0, 0.0]]) {
        assert!(answer.inside && answer.de == 0.0, "{answer:?}");
    }
    let one = bulb(8.0, "acos", "escape_radius: 10, max_iterations: 1");
    for answer in sound_answers(&one, &[[0.0, 0.0, 1.0], [0.0, 0.0, 1.3], [0.0, 0.0, 1.35], [0.0, 0.0, 1.9]]) {
        let a = answer.p[2];
        match real_orbit(a, 8, 10.0, 1) {
            None => assert!(answer.inside && answer.de == 0.0, "{answer:?}"),
            Some((r, dr)) => {
                assert!(!answer.inside);
                answer.is(r * r.ln() / (2.0 * dr));
            }
        }
    }
}
