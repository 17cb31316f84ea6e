//! What a mesher asks a body: which points are inside, how far around a point nothing is, and what its surface looks like.

use std::sync::Arc;

use rayon::prelude::*;

use super::Point;
use crate::check::truth::compose_membership;
use crate::compose::{ComposeResult, Composer, Plan, Purpose, Sides, compose_estimator, empty_balls};
use crate::expr::Arena;
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::records::{Answer, Surface};
use crate::kernel::{Backend, BackendError, Estimator, Kernel, inwards};
use crate::math::Precision;
use crate::shade::compose_albedo;

/// Share of a calibrated estimate that is taken for the radius of an empty ball.
const TRUSTED: f64 = 0.5;
/// A proof is tried where the estimate is at least this share of the radius.
const PROMISING: f64 = 0.25;
/// A proof is asked for a little more than it has to reach, since it gives a little less.
const ASKED: f64 = 1.01;
/// Step of estimates by differences, in cells.
const STEP: f64 = 1e-3;

/// What is known of a ball.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Ball {
    /// Nothing of the body is in it: proven.
    Proven,
    /// Nothing of it is in it, by the estimate with a margin.
    Estimated,
    /// Its middle is inside.
    Inside,
    /// Nothing is known.
    Open,
}

/// How a surface looks at a point.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Look {
    /// The gradient, out of the body: of length 1 where it is anything.
    pub normal: [f64; 3],
    /// Albedo: linear, from 0 to 1.
    pub albedo: [f64; 3],
}

/// A body that can be asked.
pub trait Field: Sync {
    /// Whether points are inside.
    fn inside(&self, points: &[Point]) -> Result<Vec<bool>, BackendError>;
    /// What is known of balls of a radius around points.
    fn balls(&self, points: &[Point], radius: f64) -> Result<Vec<Ball>, BackendError>;
    /// How the surface looks near points.
    fn looks(&self, points: &[Point]) -> Result<Vec<Look>, BackendError>;
}

/// The kernels of a fractal's body.
pub struct Kernels {
    arena: Arc<Arena>,
    member: Kernel,
    estimate: Kernel,
    proof: Option<CpuKernel>,
    surface: Kernel,
    albedo: Kernel,
    /// Step multiplier of the estimate.
    fudge: f64,
    /// Radius of the ball beyond which nothing is, in world units.
    radius: f64,
    /// Least step of finite differences.
    least_step: f64,
}

impl Kernels {
    /// Composes them for a precision. `plan` is not certified; `radius` is that of the ball beyond which nothing is, in world units,
    /// or infinity.
    ///
    /// Errors: a step's script fails.
    pub fn new(composer: &Composer, plan: &Plan, radius: f64, precision: Precision) -> ComposeResult<Kernels> {
        let plan = plan.clone().in_precision(precision);
        let choices = &plan.choices;
        let proof = empty_balls(composer, choices)?;
        let cpu = Cpu::new(Precision::F64);
        let prepared = |kernel: Kernel| cpu.prepare(composer.arena, &kernel).expect("the CPU takes every kernel");
        Ok(Kernels {
            arena: composer.arena.clone(),
            member: compose_membership(composer, choices, Purpose::Estimate)?,
            estimate: Kernel::Estimate(compose_estimator(composer, choices, Purpose::Estimate)?),
            proof: proof.map(prepared),
            surface: Kernel::Estimate(compose_estimator(composer, choices, Purpose::Surface)?),
            albedo: Kernel::Map(compose_albedo(composer.arena, &composer.graph.scene.look)),
            fudge: plan.fudge,
            radius,
            least_step: precision.min_difference(),
        })
    }

    /// Whether balls can be proven empty.
    pub fn prove(&self) -> bool {
        self.proof.is_some()
    }
}

/// A fractal's body on a back end: its members within a region, or all that is within a distance of them.
pub struct Body<'a, B: Backend> {
    kernels: &'a Kernels,
    backend: &'a B,
    member: B::Prepared,
    estimate: B::Prepared,
    surface: B::Prepared,
    albedo: B::Prepared,
    region: Sides,
    /// The distance, in world units.
    thickness: f64,
    /// Edge of a cell, in world units.
    cell: f64,
}

impl<'a, B: Backend> Body<'a, B> {
    /// Compiles the kernels. `thickness` and `cell` are in world units.
    pub fn new(
        kernels: &'a Kernels,
        backend: &'a B,
        region: Sides,
        (thickness, cell): (f64, f64),
    ) -> Result<Body<'a, B>, BackendError> {
        let prepared = |kernel: &Kernel| backend.prepare(&kernels.arena, kernel);
        Ok(Body {
            member: prepared(&kernels.member)?,
            estimate: prepared(&kernels.estimate)?,
            surface: prepared(&kernels.surface)?,
            albedo: prepared(&kernels.albedo)?,
            kernels,
            backend,
            region,
            thickness,
            cell,
        })
    }

    /// Takes other cells, and all that is within another distance of the members, in world units.
    pub fn set_cells(&mut self, thickness: f64, cell: f64) {
        (self.thickness, self.cell) = (thickness, cell);
    }

    /// Runs a function on parts of the points as large as the back end likes them, several at a time where it gains from that.
    fn in_parts<T: Send>(
        &self,
        points: &[Point],
        run: impl Fn(&[Point]) -> Result<Vec<T>, BackendError> + Sync,
    ) -> Result<Vec<T>, BackendError> {
        let batch = self.backend.batch();
        let size = batch.elements.max(1);
        let parts: Result<Vec<Vec<T>>, BackendError> = match batch.at_once {
            0 | 1 => points.chunks(size).map(&run).collect(),
            _ => points.par_chunks(size).map(&run).collect(),
        };
        Ok(parts?.into_iter().flatten().collect())
    }

    fn columns(&self, points: &[Point], hit_eps: f64) -> Vec<Vec<f64>> {
        let directions: Vec<Point> = points.iter().map(inwards).collect();
        Estimator::columns(points, &directions, &[(self.cell * STEP).max(self.kernels.least_step)], hit_eps)
    }

    /// Estimates with their step multiplier; 0 inside and where nothing is known.
    fn estimates(&self, points: &[Point]) -> Result<Vec<f64>, BackendError> {
        let columns = self.backend.upload(&self.columns(points, 0.0))?;
        let answers = self.backend.run(&self.estimate, &[&columns])?;
        let answers = self.backend.download_only(&answers, &[Answer::COLUMNS.de, Answer::COLUMNS.inside])?;
        let beyond = |p: &Point| p.iter().map(|x| x * x).sum::<f64>().sqrt() - self.kernels.radius;
        let known = |(p, (de, inside)): (&Point, (&f64, &f64))| match *inside > 0.5 {
            true => 0.0,
            false if de.is_nan() => beyond(p).max(0.0),
            false => (de * self.kernels.fudge).max(beyond(p)).max(0.0),
        };
        Ok(points.iter().zip(answers[0].iter().zip(&answers[1])).map(known).collect())
    }

    fn members(&self, points: &[Point]) -> Result<Vec<bool>, BackendError> {
        let columns = self.backend.upload(&self.columns(points, 0.0))?;
        let answers = self.backend.run(&self.member, &[&columns])?;
        let answers = self.backend.download_only(&answers, &[0])?;
        Ok(answers[0].iter().map(|inside| *inside > 0.5).collect())
    }

    /// Whether a point is where the body may be.
    fn is_within(&self, p: &Point) -> bool {
        let reach = self.kernels.radius + self.thickness;
        self.region.holds(p) && p.iter().map(|x| x * x).sum::<f64>() <= reach * reach
    }

    fn proven(&self, points: &[Point], radius: f64) -> Result<Vec<bool>, BackendError> {
        let Some(kernel) = self.kernels.proof.as_ref().filter(|_| !points.is_empty()) else {
            return Ok(vec![false; points.len()]);
        };
        let cpu = Cpu::new(Precision::F64);
        let columns = Estimator::columns(points, &[[1.0, 0.0, 0.0]], &[radius * ASKED], 0.0);
        let answers = cpu.download(&cpu.run(kernel, &[&cpu.upload(&columns)?])?)?;
        Ok(answers[0].iter().map(|proven| *proven >= radius).collect())
    }

    fn some_balls(&self, points: &[Point], radius: f64) -> Result<Vec<Ball>, BackendError> {
        let radius = radius + self.thickness;
        let estimates = self.estimates(points)?;
        let promising: Vec<usize> = (0..points.len()).filter(|&i| estimates[i] >= radius * PROMISING).collect();
        let asked: Vec<Point> = promising.iter().map(|&i| points[i]).collect();
        let proofs = self.proven(&asked, radius)?;
        let known = |(p, estimate): (&Point, &f64)| match *estimate {
            _ if !self.is_within(p) && self.is_apart(p, radius) => Ball::Proven,
            estimate if estimate * TRUSTED >= radius => Ball::Estimated,
            estimate if estimate > self.thickness => Ball::Open,
            _ if self.is_within(p) => Ball::Inside,
            _ => Ball::Open,
        };
        let mut balls: Vec<Ball> = points.iter().zip(&estimates).map(known).collect();
        for (i, _) in promising.iter().zip(proofs).filter(|(_, is_proven)| *is_proven) {
            balls[*i] = Ball::Proven;
        }
        Ok(balls)
    }

    /// Whether a ball does not touch the region.
    fn is_apart(&self, p: &Point, radius: f64) -> bool {
        let outside = |k: usize| (self.region.low[k] - p[k]).max(p[k] - self.region.high[k]).max(0.0);
        let [x, y, z] = [0, 1, 2].map(outside);
        let from_ball = p.iter().map(|x| x * x).sum::<f64>().sqrt() - self.kernels.radius;
        (x * x + y * y + z * z).sqrt().max(from_ball) > radius
    }

    fn some_looks(&self, points: &[Point]) -> Result<Vec<Look>, BackendError> {
        let columns = self.backend.upload(&self.columns(points, self.cell / 2.0))?;
        let surfaces = self.backend.run(&self.surface, &[&columns])?;
        let colours = self.backend.run(&self.albedo, &[&surfaces])?;
        let gradient = Surface::COLUMNS.gradient;
        let gradients = self.backend.download_only(&surfaces, &[gradient, gradient + 1, gradient + 2])?;
        let colours = self.backend.download_only(&colours, &[0, 1, 2])?;
        let look = |i: usize| Look {
            normal: [0, 1, 2].map(|k| gradients[k][i]),
            albedo: [0, 1, 2].map(|k| if colours[k][i].is_finite() { colours[k][i].clamp(0.0, 1.0) } else { 0.5 }),
        };
        Ok((0..points.len()).map(look).collect())
    }
}

impl<B: Backend> Field for Body<'_, B> {
    fn inside(&self, points: &[Point]) -> Result<Vec<bool>, BackendError> {
        self.in_parts(points, |points| {
            let inside = match self.thickness > 0.0 {
                true => self.estimates(points)?.into_iter().map(|estimate| estimate < self.thickness).collect(),
                false => self.members(points)?,
            };
            Ok(points.iter().zip(inside).map(|(p, inside)| inside && self.is_within(p)).collect())
        })
    }

    fn balls(&self, points: &[Point], radius: f64) -> Result<Vec<Ball>, BackendError> {
        self.in_parts(points, |points| self.some_balls(points, radius))
    }

    fn looks(&self, points: &[Point]) -> Result<Vec<Look>, BackendError> {
        self.in_parts(points, |points| self.some_looks(points))
    }
}
