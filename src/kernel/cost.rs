//! What a function costs: its operations on scalars by kind, counted and not timed.
//!
//! In comes a function; out comes a [`Cost`]: as the CPU's tape computes it ([`Cost::of`]), or node by node
//! ([`Cost::of_nodes`]). Counts are the same on every machine and every run. [`MarchCost`] adds those of a march up.

use std::ops::{Add, Sub};

use super::tape::{Code, Instruction, Products, lower_group};
use super::{Estimator, Function, March};
use crate::expr::ops::{Operator, OperatorKind};
use crate::expr::{Arena, NodeId, Op, Port};
use crate::graph::Schedule;

/// Operations on scalars, by kind.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Cost {
    /// Sums, differences and negatives.
    pub add: f64,
    /// Products.
    pub mul: f64,
    /// A product and a sum in one.
    pub mul_add: f64,
    /// Quotients.
    pub div: f64,
    /// Square roots.
    pub sqrt: f64,
    /// Trigonometric functions and their inverses.
    pub trig: f64,
    /// Exponentials, logarithms and powers.
    pub exp: f64,
    /// Comparisons, choices, least and largest, and logic.
    pub compare: f64,
    /// Absolute values, signs, roundings, remainders and copies.
    pub other: f64,
    /// Everything in the time of a product, roughly: expensive operators count several times
    /// ([`Operator::weight`]), two products that are computed together count once.
    pub products: f64,
}

impl Cost {
    /// Names of the kinds, in the order of [`Cost::counts`].
    pub const KINDS: [&'static str; 9] = ["add", "mul", "mul_add", "div", "sqrt", "trig", "exp", "compare", "other"];

    /// The count of each kind.
    pub fn counts(&self) -> [f64; 9] {
        [self.add, self.mul, self.mul_add, self.div, self.sqrt, self.trig, self.exp, self.compare, self.other]
    }

    /// All operations; a product and a sum in one are one.
    pub fn operations(&self) -> f64 {
        self.counts().iter().sum()
    }

    /// What the CPU computes for a function, shared and fused; the GPU's compiler gets the same expressions.
    pub fn of(arena: &Arena, function: &Function) -> Cost {
        let (tapes, _) = lower_group(arena, &[(function, 0)], Port::scalars(&function.inputs) as u16);
        tapes.iter().flat_map(|tape| &tape.instructions).map(of_instruction).fold(Cost::default(), Cost::add)
    }

    /// The operations of a function's nodes, each once, in all components and without fused forms: in an arena
    /// [as written](Arena::as_written) what its text asks for.
    pub fn of_nodes(arena: &Arena, function: &Function) -> Cost {
        let of_node = |id: NodeId| {
            let node = arena.node(id);
            match node.op {
                Op::Apply(operator) => of_operator(operator, f64::from(node.ty.width)),
                Op::Dot => {
                    let terms = f64::from(arena.node(node.args()[0]).ty.width);
                    of_operator(Operator::Mul, terms) + of_operator(Operator::Add, terms - 1.0)
                }
                Op::Lookup(_) => looked_up(),
                _ => Cost::default(),
            }
        };
        function.nodes(arena).into_iter().map(of_node).fold(Cost::default(), Cost::add)
    }

    /// So many times as much.
    pub fn times(self, factor: f64) -> Cost {
        self.join(Cost::default(), |a, _| a * factor)
    }

    fn join(self, other: Cost, f: impl Fn(f64, f64) -> f64) -> Cost {
        Cost {
            add: f(self.add, other.add),
            mul: f(self.mul, other.mul),
            mul_add: f(self.mul_add, other.mul_add),
            div: f(self.div, other.div),
            sqrt: f(self.sqrt, other.sqrt),
            trig: f(self.trig, other.trig),
            exp: f(self.exp, other.exp),
            compare: f(self.compare, other.compare),
            other: f(self.other, other.other),
            products: f(self.products, other.products),
        }
    }
}

impl Add for Cost {
    type Output = Cost;
    fn add(self, other: Cost) -> Cost {
        self.join(other, |a, b| a + b)
    }
}

impl Sub for Cost {
    type Output = Cost;
    fn sub(self, other: Cost) -> Cost {
        self.join(other, |a, b| a - b)
    }
}

fn of_operator(operator: Operator, count: f64) -> Cost {
    let none = Cost { products: count * operator.weight(), ..Cost::default() };
    match operator.kind() {
        OperatorKind::Add => Cost { add: count, ..none },
        OperatorKind::Mul => Cost { mul: count, ..none },
        OperatorKind::Div => Cost { div: count, ..none },
        OperatorKind::Sqrt => Cost { sqrt: count, ..none },
        OperatorKind::Trig => Cost { trig: count, ..none },
        OperatorKind::Exp => Cost { exp: count, ..none },
        OperatorKind::Compare => Cost { compare: count, ..none },
        OperatorKind::Other => Cost { other: count, ..none },
    }
}

/// A number from somewhere in memory.
fn looked_up() -> Cost {
    Cost { other: 1.0, products: 4.0, ..Cost::default() }
}

fn of_instruction(instruction: &Instruction) -> Cost {
    let width = f64::from(instruction.operands.width.max(1));
    let products = Cost { products: width, ..Cost::default() };
    match instruction.code {
        Code::Apply(operator) => of_operator(operator, width),
        // Found together: less than twice one of them.
        Code::SinCos => Cost { trig: 2.0, products: 16.0, ..products },
        Code::ComplexProduct => Cost { mul: 2.0 * width, mul_add: 2.0 * width, products: 2.0 * width, ..products },
        Code::Dot => Cost { mul: 1.0, mul_add: width - 1.0, ..products },
        Code::Copy => Cost { other: width, ..products },
        Code::Lookup(_) => looked_up(),
        Code::Products(Products::Sum | Products::Difference) => Cost { mul: width, mul_add: width, ..products },
        Code::Products(_) => Cost { mul_add: width, ..products },
    }
}

/// Costs of a march's parts.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct MarchCost {
    /// Where to estimate, and what to make of the estimate: once a march step.
    pub step: Cost,
    /// What an estimate takes besides its iterations: start values, end, and joining of orbits.
    pub estimate: Cost,
    /// One iteration, on the average of a cycle; of several orbits on their average.
    pub iteration: Cost,
}

impl MarchCost {
    /// Counts a march.
    pub fn of(arena: &Arena, march: &March) -> MarchCost {
        let step = Cost::of(arena, &march.locate) + Cost::of(arena, &march.advance);
        MarchCost { step, ..MarchCost::of_estimator(arena, &march.estimator) }
    }

    /// Counts an estimator.
    pub fn of_estimator(arena: &Arena, estimator: &Estimator) -> MarchCost {
        let mut cost = MarchCost { estimate: Cost::of(arena, &estimator.combine), ..MarchCost::default() };
        let share = 1.0 / estimator.orbits.len().max(1) as f64;
        for orbit in &estimator.orbits {
            cost.estimate = cost.estimate + Cost::of(arena, &orbit.init) + Cost::of(arena, &orbit.finish);
            let items: Vec<Cost> = orbit.items.iter().map(|item| Cost::of(arena, item)).collect();
            cost.iteration = cost.iteration + in_cycle(&orbit.schedule, &items).times(share);
        }
        cost
    }

    /// Operations of so many estimates, each a march step, and iterations.
    pub fn operations(&self, estimates: f64, iterations: f64) -> f64 {
        (self.step + self.estimate).operations() * estimates + self.iteration.operations() * iterations
    }
}

/// The average of a schedule's cycle, from the cost of each item.
pub fn in_cycle(schedule: &Schedule, items: &[Cost]) -> Cost {
    let all = schedule.cycle.iter().map(|&item| items[item]).fold(Cost::default(), Cost::add);
    all.times(1.0 / schedule.cycle.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::Cost;
    use crate::expr::{Arena, Expr, Function, Port, Type};

    fn costs(arena: &Arena, value: impl for<'g> Fn(Expr<'g>, Expr<'g>) -> Expr<'g>) -> (Cost, Cost) {
        let mut function = Function::new("f", vec![Port::new("x", Type::V3), Port::new("y", Type::V3)]);
        function.output("v", value(arena.input(0, Type::V3), arena.input(1, Type::V3)));
        (Cost::of(arena, &function), Cost::of_nodes(arena, &function))
    }

    #[test]
    fn products_and_sums_are_counted_by_component() {
        let arena = Arena::default();
        let (fused, nodes) = costs(&arena, |x, y| x * y + x);
        assert_eq!((fused.mul_add, fused.operations()), (3.0, 3.0));
        assert_eq!((nodes.mul, nodes.add, nodes.operations()), (3.0, 3.0, 6.0));
    }

    #[test]
    fn what_is_used_twice_is_computed_once() {
        fn length<'g>(x: Expr<'g>, y: Expr<'g>) -> Expr<'g> {
            (x - y).dot(x - y).sqrt() * ((x - y).dot(x - y).sqrt() - 1.0)
        }
        let (simplified, written) = (Arena::default(), Arena::as_written());
        // Three differences, a product and two fused ones, a root, a difference, a product.
        let (shared, nodes) = costs(&simplified, length);
        assert_eq!((shared.sqrt, shared.operations()), (1.0, 9.0));
        assert_eq!(nodes.operations(), 11.0);
        let (_, asked) = costs(&written, length);
        assert_eq!((asked.sqrt, asked.operations()), (2.0, 2.0 * (6.0 + 5.0 + 1.0) + 2.0));
    }

    #[test]
    fn what_is_known_is_left_out() {
        let (simplified, written) = (Arena::default(), Arena::as_written());
        fn known<'g>(x: Expr<'g>, y: Expr<'g>) -> Expr<'g> {
            x * 1.0 + y * 0.0 + x.arena.f(2.0) * 3.0
        }
        assert_eq!(costs(&simplified, known).0.operations(), 3.0);
        assert_eq!(costs(&written, known).1.operations(), 12.0);
    }

    #[test]
    fn components_that_nothing_reads_cost_nothing() {
        let arena = Arena::default();
        let (read, _) = costs(&arena, |x, y| (x * y).component(1) * 2.0);
        assert_eq!(read.operations(), 2.0);
    }
}
