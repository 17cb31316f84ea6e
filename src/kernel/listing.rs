//! The CPU's instructions for a kernel, as text.

use std::fmt::Write as _;

use super::tape::lower_group;
use super::{Estimator, Kernel, Orbit};
use crate::expr::{Arena, Function, Op, Port};

impl Kernel {
    /// All functions of the kernel, in the order in which they first run.
    pub fn functions(&self) -> Vec<&Function> {
        match self {
            Kernel::Map(function) => vec![function],
            Kernel::Estimate(estimator) => estimator.functions(),
            Kernel::March(march) => {
                let mut functions = vec![&march.locate];
                functions.extend(march.estimator.functions());
                functions.push(&march.advance);
                functions
            }
        }
    }

    /// Length of the list of uniforms that the kernel reads; 0 if all of its numbers are constants.
    pub fn uniforms(&self, arena: &Arena) -> usize {
        let number = |id| match arena.node(id).op {
            Op::Uniform(number) => Some(usize::from(number) + 1),
            _ => None,
        };
        self.functions().into_iter().flat_map(|f| f.nodes(arena)).filter_map(number).max().unwrap_or(0)
    }
}

impl Kernel {
    /// The arena's tables that the kernel looks up, by number.
    pub fn tables(&self, arena: &Arena) -> Vec<u16> {
        let number = |id| if let Op::Lookup(number) = arena.node(id).op { Some(number) } else { None };
        let numbers = self.functions().into_iter().flat_map(|f| f.nodes(arena)).filter_map(number);
        numbers.collect::<std::collections::BTreeSet<u16>>().into_iter().collect()
    }
}

impl Estimator {
    /// All functions of the estimator, in the order in which they first run.
    pub fn functions(&self) -> Vec<&Function> {
        self.orbits.iter().flat_map(Orbit::functions).chain([&self.combine]).collect()
    }
}

impl Orbit {
    /// All functions of the orbit, in the order in which they first run.
    pub fn functions(&self) -> Vec<&Function> {
        std::iter::once(&self.init).chain(&self.items).chain([&self.finish]).collect()
    }
}

/// The tapes of a kernel, function by function. Registers are numbered for each function by itself; the back end lets
/// the functions of an orbit share their constants.
pub fn listing(arena: &Arena, kernel: &Kernel) -> String {
    let mut text = String::new();
    let orbits: &[Orbit] = match kernel {
        Kernel::Map(_) => &[],
        Kernel::Estimate(estimator) => &estimator.orbits,
        Kernel::March(march) => &march.estimator.orbits,
    };
    for orbit in orbits {
        let schedule = &orbit.schedule;
        let _ = writeln!(
            text,
            "{}: at most {} iterations, items {:?} then {:?} over and over",
            orbit.name, orbit.max_iterations, schedule.prefix, schedule.cycle
        );
    }
    for function in kernel.functions() {
        let (tapes, constants) = lower_group(arena, &[(function, 0)], Port::scalars(&function.inputs) as u16);
        for tape in tapes {
            text.push_str(&tape.listing(&constants));
        }
    }
    text
}
