//! Whether points belong to a set: the estimator of a field with everything cut away that does not decide `inside`.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::compose::{Choice, ComposeResult, Composer, Purpose, compose_estimator};
use crate::expr::{Arena, Function, NodeId, Port, Type};
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::records::{Answer, Query};
use crate::kernel::work::Work;
use crate::kernel::{Backend, Estimator, Kernel, Orbit};
use crate::math::Precision;

/// The estimator of the whole field with `inside` and the number of iterations `n` as its only outputs: no derivative is carried. It is that of
/// [`Purpose::Estimate`] or of [`Purpose::Truth`].
pub fn compose_membership(composer: &Composer, choices: &[Choice], purpose: Purpose) -> ComposeResult<Kernel> {
    let mut estimator = compose_estimator(composer, choices, purpose)?.only(Answer::COLUMNS.inside);
    let arena = composer.arena;
    let combine = &mut estimator.combine;
    let mut next = Estimator::inputs().len();
    let mut iterations = arena.f(0.0);
    for orbit in &mut estimator.orbits {
        for (i, output) in orbit.finish.outputs.iter_mut().enumerate() {
            if !combine.reads(arena, next + i) {
                output.1 = zero(arena, &output.0);
            }
        }
        // After the outputs of `finish` come `inside` and `n`.
        next += orbit.finish.outputs.len() + 2;
        iterations = iterations + arena.input(next as u16 - 1, Type::F);
        cut(arena, orbit);
    }
    estimator.combine.output("n", iterations);
    Ok(Kernel::Estimate(estimator))
}

fn zero(arena: &Arena, port: &Port) -> NodeId {
    arena.constant(port.ty, [0.0; 4]).id
}

/// Numbers of the inputs that an output needs.
fn inputs_of(arena: &Arena, function: &Function, root: NodeId) -> Vec<bool> {
    let one = Function {
        name: String::new(),
        inputs: function.inputs.clone(),
        outputs: vec![(Port::new("root", arena.expr(root).ty()), root)],
    };
    (0..function.inputs.len()).map(|number| one.reads(arena, number)).collect()
}

/// Keeps of an orbit's state what `escaped` and the remaining outputs of `finish` need, directly or through later
/// iterations; the rest is passed on unchanged, which costs nothing.
fn cut(arena: &Arena, orbit: &mut Orbit) {
    let states = orbit.state.len();
    let mut needed = vec![false; states + orbit.frozen.len() + 1];
    let mut open: Vec<(&Function, NodeId)> = orbit.finish.outputs.iter().map(|(_, id)| (&orbit.finish, *id)).collect();
    open.extend(orbit.items.iter().map(|item| (item, item.outputs[states].1)));
    while let Some((function, root)) = open.pop() {
        for (number, reads) in inputs_of(arena, function, root).into_iter().enumerate() {
            if reads && !std::mem::replace(&mut needed[number], true) && number < states {
                open.extend(orbit.items.iter().map(|item| (item, item.outputs[number].1)));
            }
        }
    }
    needed.truncate(states + orbit.frozen.len());
    for (number, _) in needed.iter().enumerate().filter(|(_, needed)| !**needed) {
        let start = &mut orbit.init.outputs[number];
        start.1 = zero(arena, &start.0);
        for item in orbit.items.iter_mut().filter(|_| number < states) {
            let output = &mut item.outputs[number];
            output.1 = arena.input(number as u16, output.0.ty).id;
        }
    }
}

/// A unit vector that is no map's own.
const BESIDE: [f64; 3] = [0.48, 0.6, 0.64];

/// A formula's membership, ready to run in f64.
pub struct Members {
    cpu: Cpu,
    kernel: CpuKernel,
    work: Work,
    /// Points that were asked, and iterations of all of them.
    asked: AtomicU64,
    iterated: AtomicU64,
}

impl Members {
    /// Compiles the membership of a field: what `max_iterations` says exactly.
    pub fn new(composer: &Composer, choices: &[Choice]) -> ComposeResult<Members> {
        Members::of(composer, choices, Purpose::Estimate)
    }

    /// The same at the resolution of the hit thresholds: a point also belongs to the set where the orbit of a point beside it,
    /// a 1024th of the threshold away, comes as far from its own as the set is wide before that has escaped. With a threshold
    /// of 0 it is exact.
    pub fn at_footprint(composer: &Composer, choices: &[Choice]) -> ComposeResult<Members> {
        Members::of(composer, choices, Purpose::Truth)
    }

    fn of(composer: &Composer, choices: &[Choice], purpose: Purpose) -> ComposeResult<Members> {
        let cpu = Cpu::new(Precision::F64);
        let kernel = compose_membership(composer, choices, purpose)?;
        let work = Work::of(composer.arena, &kernel);
        let kernel = cpu.prepare(composer.arena, &kernel).expect("the CPU takes every kernel");
        Ok(Members { cpu, kernel, work, asked: AtomicU64::new(0), iterated: AtomicU64::new(0) })
    }

    /// Operations of all points that were asked so far, in products of two numbers: the same on every machine.
    pub fn operations(&self) -> f64 {
        let [asked, iterated] = [&self.asked, &self.iterated].map(|count| count.load(Ordering::Relaxed) as f64);
        self.work.total(asked, iterated)
    }

    /// For each point of the world whether its orbit stays in. `eps` are hit thresholds, which say how thick shells are.
    pub fn inside(&self, points: &[[f64; 3]], eps: &[f64]) -> Vec<bool> {
        // Where the point beside is: along no axis, since maps may leave a direction as it is.
        let mut columns = Estimator::columns(points, &[BESIDE], &[1e-6], 0.0);
        columns[Query::COLUMNS.hit_eps] = eps.to_vec();
        let columns = self.cpu.upload(&columns).expect("the CPU holds every column");
        let result = self.cpu.run(&self.kernel, &[&columns]).expect("the CPU runs every kernel");
        let result = self.cpu.download(&result).expect("the CPU holds every column");
        self.asked.fetch_add(points.len() as u64, Ordering::Relaxed);
        self.iterated.fetch_add(result[1].iter().sum::<f64>() as u64, Ordering::Relaxed);
        result[0].iter().map(|&inside| inside > 0.5).collect()
    }
}
