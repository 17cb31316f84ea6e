//! AgX (T. Sobotka, 2022): bright light goes to white by way of paler colours of its hue.
//!
//! The base look, as B. Wrensch fitted it ("Minimal AgX Implementation", 2023): colours are moved towards each other by a matrix,
//! their logarithms take an S-shaped curve, here a polynomial, and another matrix moves them apart.

use glam::{DMat3, DVec3};

use super::develop::times;
use crate::expr::Expr;

/// Linear sRGB to the space of the curve, by rows.
const INSET: [[f64; 3]; 3] = [
    [0.842_479_062_253_094, 0.078_433_599_999_999_2, 0.079_223_745_147_764_3],
    [0.042_328_242_261_012_3, 0.878_468_636_469_772, 0.079_166_127_460_543_1],
    [0.042_375_654_905_705_1, 0.078_433_6, 0.879_142_973_793_104],
];
/// What comes out of the curve to sRGB with an exponent of 2.2, by rows.
const OUTSET: [[f64; 3]; 3] = [
    [1.196_879_005_120_17, -0.098_020_881_140_136_8, -0.099_029_744_079_720_5],
    [-0.052_896_851_757_456_2, 1.151_903_129_904_17, -0.098_961_176_844_843_3],
    [-0.052_971_635_514_443_8, -0.098_043_450_117_124_1, 1.151_073_672_641_16],
];
/// The least and the greatest exponent of 2 that the curve tells apart.
const RANGE: [f64; 2] = [-12.473_93, 4.026_069];
/// The curve, from the constant on.
const CURVE: [f64; 7] = [-0.002_32, 0.1191, 0.4298, -6.868, 31.96, -40.14, 15.5];
/// The exponent of what comes out.
const GAMMA: f64 = 2.2;

/// Radiance, at least 0, as it is shown: linear sRGB, a little outside of 0 to 1 at most.
pub(super) fn shown(radiance: Expr<'_>) -> Expr<'_> {
    let arena = radiance.arena;
    let [low, high] = RANGE;
    let inset = times(INSET, radiance).max(arena.f(low.exp2()));
    let log = (inset.ln() * std::f64::consts::LOG2_E).min(arena.f(high));
    let x = (log - low) * (1.0 / (high - low));
    let [rest @ .., highest] = CURVE;
    let curve = rest.iter().rev().fold(x * 0.0 + highest, |sum, &coefficient| sum * x + coefficient);
    // The logarithm of 0 has no place in the power.
    let out = times(OUTSET, curve).max(arena.f(1e-6));
    (out.ln() * GAMMA).exp()
}

/// The radiance that is shown as this linear colour from 0 to 1, or as near to it as there is.
pub(super) fn radiance_of(shown: [f64; 3]) -> [f64; 3] {
    let inverse = |rows: [[f64; 3]; 3]| DMat3::from_cols_array_2d(&rows).transpose().inverse();
    let curved = inverse(OUTSET) * DVec3::from(shown.map(|y| y.max(1e-9).powf(1.0 / GAMMA)));
    let inset = curved.to_array().map(|y| {
        let [low, high] = RANGE;
        (low + before_curve(y) * (high - low)).exp2()
    });
    (inverse(INSET) * DVec3::from(inset)).max(DVec3::ZERO).to_array()
}

/// What the curve makes this of: it rises from 0 to 1.
fn before_curve(y: f64) -> f64 {
    let curve = |x: f64| CURVE.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient);
    let [mut low, mut high] = [0.0, 1.0];
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match curve(middle) < y {
            true => low = middle,
            false => high = middle,
        }
    }
    0.5 * (low + high)
}
