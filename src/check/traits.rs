//! What steps are, measured.

use std::sync::Arc;

use super::backends::{Backends, Target};
use super::steps::{StepCase, widths};
use crate::expr::Arena;
use crate::formula::library::Library;
use crate::formula::step::{StateWidth, Step};
use crate::kernel::Kernel;
use crate::math::random::Random;

/// Generic points at which the Jacobian is looked at, and half the side of the box that they lie in.
const POINTS: usize = 40;
const REACH: f64 = 1.5;
/// Relative difference up to which the Jacobian's stretches count as equal: rounding, with room for trigonometry.
const EQUAL: f64 = 1e-6;

/// Whether a step, with its default parameters, keeps angles: at sampled points its Jacobian J is a multiple of an
/// orthogonal matrix, so that JᵀJ is a multiple of the unit matrix. Points where J is not finite are left out.
///
/// A four-component step is measured in four dimensions, one for any number in three. Steps that cannot be differentiated
/// or traced are not conformal.
pub fn is_conformal(library: &Library, step: &Step) -> bool {
    if !step.differentiable || step.state == StateWidth::Embeds {
        return false;
    }
    let backends = Backends::cpu_only();
    let case = StepCase { library, step, backends: &backends };
    let width = widths(step)[0];
    let arena = Arc::new(Arena::default());
    let Ok(function) = case.jacobian_function(&arena, width, &[], false) else { return false };
    let n = usize::from(width);
    let mut random = Random::new(11);
    let points: Vec<Vec<f64>> = (0..POINTS).map(|_| (0..n).map(|_| random.range(-REACH, REACH)).collect()).collect();
    let columns = StepCase::columns(width, &points);
    let Ok(out) = backends.run(Target::CPU_F64, &arena, &Kernel::Map(function), &columns) else { return false };
    if out.len() < n * (1 + n) {
        return false; // a shape: it has a distance and no image
    }
    let mut measured = 0;
    let of_point = |i: usize| out.iter().map(|column| column[i]).collect::<Vec<f64>>();
    for values in (0..POINTS).map(of_point) {
        let row = |a: usize| &values[n * (1 + a)..n * (2 + a)];
        let product = |a: usize, b: usize| -> f64 { row(a).iter().zip(row(b)).map(|(x, y)| x * y).sum() };
        let mean = (0..n).map(|a| product(a, a)).sum::<f64>() / n as f64;
        if !mean.is_finite() {
            continue;
        }
        measured += 1;
        let is_equal = |(a, b): (usize, usize)| {
            let wanted = if a == b { mean } else { 0.0 };
            (product(a, b) - wanted).abs() <= EQUAL * mean
        };
        if !(0..n * n).map(|k| (k / n, k % n)).all(is_equal) {
            return false;
        }
    }
    measured > POINTS / 2
}
