//! How much a kernel computes, counted and not timed: the same on every machine and every run.

use super::cost::Cost;
use super::{Kernel, Orbit};
use crate::expr::{Arena, Function};

/// Operations of a kernel's parts, in products of two numbers.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Work {
    /// What every estimate takes, whatever its iterations.
    pub estimate: f64,
    /// One iteration, on the average of a cycle.
    pub iteration: f64,
}

impl Work {
    /// Counts a kernel. Several orbits count as one that is as expensive as their average, since iterations are counted for all
    /// of them together.
    pub fn of(arena: &Arena, kernel: &Kernel) -> Work {
        let all: f64 = kernel.functions().into_iter().map(|function| operations(arena, function)).sum();
        let orbits: &[Orbit] = match kernel {
            Kernel::Map(_) => &[],
            Kernel::Estimate(estimator) => &estimator.orbits,
            Kernel::March(march) => &march.estimator.orbits,
        };
        let of_items = |orbit: &Orbit| orbit.items.iter().map(|item| operations(arena, item)).sum::<f64>();
        let in_cycle = |orbit: &Orbit| of_items(orbit) / orbit.items.len().max(1) as f64;
        let iterated: f64 = orbits.iter().map(of_items).sum();
        let iteration = orbits.iter().map(in_cycle).sum::<f64>() / orbits.len().max(1) as f64;
        Work { estimate: all - iterated, iteration }
    }

    /// Operations of so many estimates and iterations.
    pub fn total(&self, estimates: f64, iterations: f64) -> f64 {
        self.estimate * estimates + self.iteration * iterations
    }
}

fn operations(arena: &Arena, function: &Function) -> f64 {
    Cost::of(arena, function).products
}

#[cfg(test)]
mod tests {
    use super::Work;
    use crate::expr::{Arena, Function, Port, Type};
    use crate::kernel::Kernel;

    #[test]
    fn dear_operators_weigh_more() {
        let arena = Arena::default();
        let (x, y) = (arena.input(0, Type::F), arena.input(1, Type::F));
        let work = |value| {
            let mut function = Function::new("f", vec![Port::new("x", Type::F), Port::new("y", Type::F)]);
            function.output("v", value);
            Work::of(&arena, &Kernel::Map(function)).total(1.0, 1.0)
        };
        assert_eq!(work(x * y), 1.0);
        assert!(work(x.pow(y)) > 8.0 * work(x * y));
        assert_eq!(work(x * y + x), 1.0, "a product and a sum are one instruction");
    }
}
