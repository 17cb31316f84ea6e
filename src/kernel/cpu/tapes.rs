//! Kernels lowered to tapes that share register files.

use crate::expr::ops::Register;
use crate::expr::{Arena, Function, Port};
use crate::graph::Schedule;
use crate::kernel::constants::Constants;
use crate::kernel::tape::{Tape, lower_group};
use crate::kernel::{Estimator, Kernel, March, Orbit};
use crate::math::Real;

#[derive(Clone)]
pub(super) enum Program {
    Map(TapeSet),
    Estimate(EstimatorTapes),
    March(MarchTapes),
}

impl Program {
    pub(super) fn new(arena: &Arena, kernel: &Kernel) -> Program {
        match kernel {
            Kernel::Map(function) => Program::Map(TapeSet::new(arena, &[(function, 0)], 0)),
            Kernel::Estimate(estimator) => Program::Estimate(EstimatorTapes::new(arena, estimator)),
            Kernel::March(march) => Program::March(MarchTapes::new(arena, march)),
        }
    }

    /// The same tapes with these values of their uniforms.
    pub(super) fn bind(&self, uniforms: &[f64]) -> Program {
        let mut bound = self.clone();
        let bind = |set: &mut TapeSet| set.constants.bind(uniforms);
        match &mut bound {
            Program::Map(set) => bind(set),
            Program::Estimate(tapes) => tapes.for_each_set(bind),
            Program::March(tapes) => {
                bind(&mut tapes.locate);
                bind(&mut tapes.advance);
                tapes.estimator.for_each_set(bind);
            }
        }
        bound
    }
}

/// Tapes that share a register file, and its constants.
#[derive(Clone)]
pub(super) struct TapeSet {
    pub(super) tapes: Vec<Tape>,
    pub(super) constants: Constants,
    pub(super) registers: usize,
}

#[derive(Clone)]
pub(super) struct OrbitTapes {
    pub(super) set: TapeSet,
    pub(super) state: usize,
    pub(super) frozen: usize,
    pub(super) items: usize,
    pub(super) schedule: Schedule,
    pub(super) max_iterations: u32,
}

#[derive(Clone)]
pub(super) struct EstimatorTapes {
    pub(super) orbits: Vec<OrbitTapes>,
    pub(super) combine: TapeSet,
}

#[derive(Clone)]
pub(super) struct MarchTapes {
    pub(super) estimator: EstimatorTapes,
    pub(super) locate: TapeSet,
    pub(super) advance: TapeSet,
    pub(super) max_march_steps: u32,
}

impl TapeSet {
    pub(super) fn new(arena: &Arena, functions: &[(&Function, u16)], free_from: u16) -> TapeSet {
        let end = functions.iter().map(|(f, at)| at + Port::scalars(&f.inputs) as u16).max().unwrap_or(0);
        let (tapes, constants) = lower_group(arena, functions, end.max(free_from));
        let registers = tapes.iter().map(|t| t.register_count).max().unwrap_or(0);
        TapeSet { tapes, constants, registers }
    }

    pub(super) fn register_file<R: Real, const K: usize>(&self, token: R::Token) -> Vec<Register<R, K>> {
        let mut registers = vec![[R::splat(token, 0.0); K]; self.registers];
        for (register, value) in self.constants.iter() {
            registers[register as usize] = [R::splat(token, value); K];
        }
        registers
    }
}

impl OrbitTapes {
    pub(super) fn new(arena: &Arena, orbit: &Orbit) -> OrbitTapes {
        let state = Port::scalars(&orbit.state);
        let frozen = Port::scalars(&orbit.frozen);
        let init_at = (state + frozen + 1) as u16;
        let mut functions = vec![(&orbit.init, init_at), (&orbit.finish, 0)];
        functions.extend(orbit.items.iter().map(|item| (item, 0)));
        OrbitTapes {
            set: TapeSet::new(arena, &functions, init_at),
            state,
            frozen,
            items: 2,
            schedule: orbit.schedule.clone(),
            max_iterations: orbit.max_iterations,
        }
    }

    /// Whether the end of the orbit reads the number of its iterations.
    pub(super) fn reads_n(&self) -> bool {
        self.set.tapes[1].read.contains(&((self.state + self.frozen) as u16))
    }
}

impl EstimatorTapes {
    pub(super) fn new(arena: &Arena, estimator: &Estimator) -> EstimatorTapes {
        EstimatorTapes {
            orbits: estimator.orbits.iter().map(|orbit| OrbitTapes::new(arena, orbit)).collect(),
            combine: TapeSet::new(arena, &[(&estimator.combine, 0)], 0),
        }
    }

    fn for_each_set(&mut self, change: impl Fn(&mut TapeSet)) {
        self.orbits.iter_mut().for_each(|orbit| change(&mut orbit.set));
        change(&mut self.combine);
    }
}

impl MarchTapes {
    pub(super) fn new(arena: &Arena, march: &March) -> MarchTapes {
        MarchTapes {
            estimator: EstimatorTapes::new(arena, &march.estimator),
            locate: TapeSet::new(arena, &[(&march.locate, 0)], 0),
            advance: TapeSet::new(arena, &[(&march.advance, 0)], 0),
            max_march_steps: march.max_march_steps,
        }
    }
}
