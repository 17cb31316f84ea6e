//! Marches of plans over rays of the view, with what they cost.

use super::Options;
use crate::check::Subject;
use crate::check::truth::{End, Ray, Scale, candidate, ends, ray_columns};
use crate::compose::{ComposeResult, Plan};
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::work::Work;
use crate::kernel::{Backend, Kernel, Status};
use crate::march::MarchSettings;

/// Rays of a pilot, and estimates after which each of them is given up.
pub(super) const PILOT_RAYS: usize = 64;
const PILOT_STEPS: u32 = 400;
/// Times the steps of a pilot that a ray is expected to take which the pilot gave up.
const GIVEN_UP: f64 = 4.0;

/// What marches.
pub(super) struct Marching<'a> {
    subject: &'a Subject<'a>,
    options: &'a Options,
    scale: Scale,
    cpu: Cpu,
}

/// A march that is ready to run.
pub(super) struct Compiled {
    kernel: CpuKernel,
    /// What it computes.
    pub work: Work,
}

/// What a march of few rays, each given up after a few hundred estimates, says about the cost of a plan.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pilot {
    /// Operations a ray that a march of all steps is expected to take.
    pub price: f64,
    /// Estimates a ray, and iterations an estimate.
    pub estimates: f64,
    pub iterations: f64,
    /// Rays that entered the bounding sphere and ended, without crossing anything unproven.
    pub decided: usize,
}

impl<'a> Marching<'a> {
    pub fn new(subject: &'a Subject<'a>, options: &'a Options, scale: Scale) -> Marching<'a> {
        Marching { subject, options, scale, cpu: Cpu::new(options.precision) }
    }

    /// Composes the march of a plan, in the precision of the options.
    pub fn compose(&self, plan: &Plan) -> ComposeResult<Kernel> {
        let precision = self.options.precision;
        let plan = plan.clone().in_precision(precision);
        let settings = MarchSettings::of_plan(&plan, self.scale.pixel, precision);
        candidate(&self.subject.composer(), &plan.choices, &settings)
    }

    /// Counts what a march computes.
    pub fn work(&self, march: &Kernel) -> Work {
        Work::of(self.subject.arena, march)
    }

    /// Makes a march ready to run.
    pub fn compile(&self, march: &Kernel) -> Compiled {
        let kernel = self.cpu.prepare(self.subject.arena, march).expect("the CPU takes every kernel");
        Compiled { kernel, work: self.work(march) }
    }

    /// Marches rays.
    pub fn run(&self, march: &Compiled, rays: &[Ray]) -> Vec<End> {
        let columns = ray_columns(rays, self.scale.bounding_radius);
        let columns = self.cpu.upload(&columns).expect("the CPU holds every column");
        let out = self.cpu.run(&march.kernel, &[&columns]).expect("the CPU runs every kernel");
        ends(&self.cpu.download(&out).expect("the CPU holds every column"), rays.len())
    }

    /// Marches a few rays of a plan, none of them far.
    pub fn pilot(&self, plan: &Plan, rays: &[Ray]) -> ComposeResult<(Pilot, Work)> {
        let mut march = self.compose(plan)?;
        if let Kernel::March(march) = &mut march {
            march.max_march_steps = march.max_march_steps.min(PILOT_STEPS);
        }
        let march = self.compile(&march);
        let ends = self.run(&march, &rays[..rays.len().min(PILOT_RAYS)]);
        let [estimates, iterations] = totals(&ends);
        let count = ends.len().max(1) as f64;
        let given_up = |end: &&End| end.status == Status::Unfinished && end.estimates >= u64::from(PILOT_STEPS);
        let open = ends.iter().filter(given_up).count() as f64;
        let longer = 1.0 + GIVEN_UP * open * f64::from(PILOT_STEPS) / estimates.max(1.0);
        let decided = ends.iter().filter(|end| end.estimates > 0 && !end.undecided).count();
        let pilot = Pilot {
            price: longer * march.work.total(estimates, iterations) / count,
            estimates: estimates / count,
            iterations: iterations / estimates.max(1.0),
            decided,
        };
        Ok((pilot, march.work))
    }
}

/// Estimates and iterations of all ends.
pub(super) fn totals(ends: &[End]) -> [f64; 2] {
    let sum = |of: fn(&End) -> u64| ends.iter().map(|end| of(end) as f64).sum();
    [sum(|end| end.estimates), sum(|end| end.iterations)]
}
