//! How far points are from the surface, by the estimate of a plan: for cameras that keep their distance.

use rayon::prelude::*;

use crate::compose::{ComposeResult, Composer, Plan, Purpose, compose_estimator};
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::records::Answer;
use crate::kernel::{Backend, Estimator, Kernel, inwards};
use crate::math::Precision;

/// Estimates distances of points, in f64.
pub struct Clearance {
    cpu: Cpu,
    kernel: CpuKernel,
    fudge: f64,
    /// Whether distances are proven, and not estimated.
    proves: bool,
    bounding_radius: f64,
}

/// Step of estimates by differences, in world units.
const STEP: f64 = 1e-9;
/// Balls that are tried around a point whose distance is to be proven, each half as large as the one before.
const BALLS: usize = 44;

impl Clearance {
    /// The estimate of a plan.
    ///
    /// Errors: a step's script fails.
    pub fn new(composer: &Composer, plan: &Plan) -> ComposeResult<Clearance> {
        let plan = plan.clone().in_precision(Precision::F64);
        let estimator = compose_estimator(composer, &plan.choices, Purpose::Estimate)?;
        let cpu = Cpu::new(Precision::F64).narrow();
        let kernel = cpu.prepare(composer.arena, &Kernel::Estimate(estimator)).expect("the CPU takes every kernel");
        let proves = plan.choices.iter().any(|choice| choice.method.is_certified());
        let (fudge, bounding_radius) = (plan.fudge, plan.bounding_radius);
        Ok(Clearance { cpu, kernel, fudge, proves, bounding_radius })
    }

    /// Radius of the ball in which the set lies, in world units.
    pub fn bounding_radius(&self) -> f64 {
        self.bounding_radius
    }

    /// The distance of each point from the surface, in world units: 0 in the set, and where nothing is known.
    pub fn of(&self, points: &[[f64; 3]]) -> Vec<f64> {
        points.par_chunks(1024).flat_map_iter(|points| self.of_some(points)).collect()
    }

    fn of_some(&self, points: &[[f64; 3]]) -> Vec<f64> {
        let outside = |p: &[f64; 3]| p.iter().map(|x| x * x).sum::<f64>().sqrt() - self.bounding_radius;
        let known = if self.proves { self.proven(points) } else { self.asked(points, STEP) };
        let estimated = known.into_iter().map(|known| known * if self.proves { 1.0 } else { self.fudge });
        points.iter().zip(estimated).map(|(p, estimate)| estimate.max(outside(p)).max(0.0)).collect()
    }

    /// The largest radii that proofs find: a larger ball has worse bounds, so each size is tried until a smaller one could prove no more.
    fn proven(&self, points: &[[f64; 3]]) -> Vec<f64> {
        let mut best = vec![0.0f64; points.len()];
        let mut open: Vec<usize> = (0..points.len()).collect();
        let mut reach = 2.0 * self.bounding_radius;
        for _ in 0..BALLS {
            let asked: Vec<[f64; 3]> = open.iter().map(|&i| points[i]).collect();
            for (&i, found) in open.iter().zip(self.asked(&asked, reach)) {
                best[i] = best[i].max(found.min(reach));
            }
            reach /= 2.0;
            open.retain(|&i| best[i] < reach);
            if open.is_empty() {
                break;
            }
        }
        best
    }

    /// What the estimate answers: 0 in the set and where nothing is known.
    fn asked(&self, points: &[[f64; 3]], h: f64) -> Vec<f64> {
        let columns = Estimator::columns(points, &points.iter().map(inwards).collect::<Vec<_>>(), &[h], 0.0);
        let columns = self.cpu.upload(&columns).expect("the CPU holds every column");
        let answers = self.cpu.run(&self.kernel, &[&columns]).expect("the CPU runs every kernel");
        let answers = self.cpu.download(&answers).expect("the CPU holds every column");
        let (de, inside) = (&answers[Answer::COLUMNS.de], &answers[Answer::COLUMNS.inside]);
        let distance = |(de, inside): (&f64, &f64)| if *inside > 0.5 || !de.is_finite() { 0.0 } else { de.max(0.0) };
        de.iter().zip(inside).map(distance).collect()
    }
}
