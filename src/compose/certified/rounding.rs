//! How much rounding there may be in a step's image, counted.

use rustc_hash::FxHashMap;

use crate::expr::differentiate::reachable;
use crate::expr::ops::OperatorKind;
use crate::expr::{Arena, Expr, NodeId, Op};

/// What is allowed for a function that processors approximate, and for how much it passes on of its arguments' errors.
const APPROXIMATED: f64 = 16.0;
const PASSED_ON: f64 = 4.0;

/// The most by which the value of `root` can be off, in units of its size times the error of one rounding: errors of factors
/// add up, those of terms are weighed by the terms' sizes, and a root halves them. It is the worst case, in which all
/// errors have one direction, where no sum is much shorter than its terms.
pub(super) fn roundings(root: Expr) -> f64 {
    let arena = root.arena;
    let mut known: FxHashMap<NodeId, f64> = FxHashMap::default();
    for id in reachable(arena, &[root.id]) {
        let count = of_node(arena, id, &known);
        known.insert(id, count);
    }
    known[&root.id]
}

fn of_node(arena: &Arena, id: NodeId, known: &FxHashMap<NodeId, f64>) -> f64 {
    let node = arena.node(id);
    let arguments = || node.args().iter().map(|a| known[a]);
    let (most, sum) = (arguments().fold(0.0, f64::max), arguments().sum::<f64>());
    match node.op {
        Op::Input(_) => 0.0,
        Op::Const(bits) => {
            let is_exact = |bits: &u64| f64::from(f64::from_bits(*bits) as f32) == f64::from_bits(*bits);
            if bits.iter().all(is_exact) { 0.0 } else { 1.0 }
        }
        Op::Uniform(_) | Op::Lookup(_) => 1.0,
        Op::Compose | Op::Splat | Op::Extract(_) => most,
        Op::Dot => sum + f64::from(arena.node(node.args()[0]).ty.width),
        Op::Apply(operator) => match operator.kind() {
            OperatorKind::Add => most + 1.0,
            OperatorKind::Mul | OperatorKind::Div => sum + 1.0,
            OperatorKind::Sqrt => most / 2.0 + 1.0,
            OperatorKind::Trig | OperatorKind::Exp => sum * PASSED_ON + APPROXIMATED,
            OperatorKind::Compare | OperatorKind::Other => most,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::Type;

    #[test]
    fn errors_of_factors_add_up_and_those_of_terms_do_not() {
        let arena = Arena::default();
        let (x, y) = (arena.input(0, Type::F), arena.input(1, Type::F));
        assert_eq!(roundings(x), 0.0);
        assert_eq!(roundings(x * y), 1.0);
        // x^4 by squares: twice the error of x^2, and one.
        let square = x * x;
        assert_eq!(roundings(square * square), 3.0);
        assert_eq!(roundings(square + y), 2.0);
        assert_eq!(roundings((x * y).sqrt()), 1.5);
        assert_eq!(roundings(x.max(square)), 1.0);
        // A tenth is no sum of few powers of two, a half is one.
        assert_eq!(roundings(x * 0.5), 1.0);
        assert_eq!(roundings(x * 0.1), 2.0);
        let v = arena.input(2, Type::V3);
        assert_eq!(roundings(v.dot(v)), 3.0);
    }
}
