//! Forward differentiation of expressions, from expressions to expressions.

use std::collections::HashMap;

use super::{Arena, Expr, NodeId, Op};

/// Differentiates nodes of one arena along one direction, given the derivatives of some nodes (usually inputs).
///
/// Inputs without a given derivative count as constant. Results are shared: asking for several outputs costs their
/// common parts once.
pub struct Differentiator<'g> {
    arena: &'g Arena,
    known: HashMap<NodeId, Expr<'g>>,
}

impl<'g> Differentiator<'g> {
    /// Starts with the derivatives of the given nodes.
    pub fn new(arena: &'g Arena, seeds: &[(Expr<'g>, Expr<'g>)]) -> Self {
        let known = seeds.iter().map(|(x, dx)| (x.id, *dx)).collect();
        Differentiator { arena, known }
    }

    /// The derivative of `root`; same type as `root`.
    pub fn derivative(&mut self, root: Expr<'g>) -> Expr<'g> {
        // Ascending ids are an evaluation order, so no recursion is needed, however deep the expression.
        for id in reachable(self.arena, &[root.id]) {
            if !self.known.contains_key(&id) {
                let d = self.step(self.arena.expr(id));
                self.known.insert(id, d);
            }
        }
        self.known[&root.id]
    }

    fn step(&self, y: Expr<'g>) -> Expr<'g> {
        let node = y.node();
        let x: Vec<Expr<'g>> = node.args().iter().map(|&a| self.arena.expr(a)).collect();
        let d: Vec<Expr<'g>> = node.args().iter().map(|a| self.known[a]).collect();
        if node.ty.is_bool {
            return y;
        }
        match node.op {
            Op::Const(_) | Op::Input(_) => y.lift(0.0),
            Op::Compose => self.arena.compose(&d),
            Op::Splat => d[0].widen(node.ty.width),
            Op::Extract(i) => d[0].component(i),
            Op::Dot if x[0].id == x[1].id => x[0].dot(d[0]) * 2.0,
            Op::Dot => d[0].dot(x[1]) + x[0].dot(d[1]),
            Op::Apply(operator) => operator.derivative(&x, y, &d),
        }
    }
}

/// Every node that the roots need, in evaluation order.
pub fn reachable(arena: &Arena, roots: &[NodeId]) -> Vec<NodeId> {
    let mut seen = vec![false; arena.len()];
    let mut stack = roots.to_vec();
    while let Some(id) = stack.pop() {
        if !std::mem::replace(&mut seen[id.index()], true) {
            stack.extend_from_slice(arena.node(id).args());
        }
    }
    (0..seen.len()).filter(|&i| seen[i]).map(|i| NodeId(i as u32)).collect()
}
