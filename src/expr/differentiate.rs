//! Forward differentiation of expressions, from expressions to expressions.
//!
//! The derivative of a scalar is a *tangent*: one number for a derivative along one direction, a 3-vector for a gradient.
//! A vector has a tangent for each component. Gradients as vectors are what makes exact derivatives cheap: one
//! instruction for three partial derivatives.

use rustc_hash::FxHashMap;

use super::ops::Operator;
use super::{Arena, Expr, NodeId, Op, Type};

/// Differentiates nodes of one arena, given the tangents of some nodes (usually inputs).
///
/// Inputs without a given tangent count as constant. Results are shared: asking for several outputs costs their common
/// parts once.
pub struct Differentiator<'g> {
    arena: &'g Arena,
    zero: Expr<'g>,
    known: FxHashMap<NodeId, Vec<Expr<'g>>>,
}

impl<'g> Differentiator<'g> {
    /// Derivatives along one direction; each seed is a node and its derivative, of the node's type.
    pub fn new(arena: &'g Arena, seeds: &[(Expr<'g>, Expr<'g>)]) -> Self {
        let known = seeds.iter().map(|(x, dx)| (x.id, dx.components())).collect();
        Differentiator { arena, zero: arena.f(0.0), known }
    }

    /// Gradients; each seed is a node and the gradients (3-vectors) of its components.
    pub fn of_gradients(arena: &'g Arena, seeds: &[(Expr<'g>, Vec<Expr<'g>>)]) -> Self {
        let known = seeds.iter().map(|(x, rows)| (x.id, rows.clone())).collect();
        Differentiator { arena, zero: arena.v3([0.0; 3]), known }
    }

    /// Gradients by the 3-vector `p`.
    pub fn by(arena: &'g Arena, p: Expr<'g>) -> Self {
        Self::of_gradients(arena, &[(p, unit_rows(arena, 3))])
    }

    /// The derivative of `root` along the direction; same type as `root`.
    pub fn derivative(&mut self, root: Expr<'g>) -> Expr<'g> {
        let tangents = self.tangents(root);
        if tangents.len() == 1 { tangents[0] } else { self.arena.compose(&tangents) }
    }

    /// The tangents of all components of `root`.
    pub fn tangents(&mut self, root: Expr<'g>) -> Vec<Expr<'g>> {
        // Ascending ids are an evaluation order, so no recursion is needed, however deep the expression.
        for id in reachable(self.arena, &[root.id]) {
            if !self.known.contains_key(&id) {
                let tangents = self.step(self.arena.expr(id));
                self.known.insert(id, tangents);
            }
        }
        self.known[&root.id].clone()
    }

    fn step(&self, y: Expr<'g>) -> Vec<Expr<'g>> {
        let node = y.node();
        let width = node.ty.width as usize;
        if node.ty.is_bool {
            return vec![self.zero; width];
        }
        let x: Vec<Expr<'g>> = node.args().iter().map(|&a| self.arena.expr(a)).collect();
        let d: Vec<&Vec<Expr<'g>>> = node.args().iter().map(|a| &self.known[a]).collect();
        match node.op {
            Op::Const(_) | Op::Input(_) | Op::Uniform(_) | Op::Lookup(_) => vec![self.zero; width],
            Op::Compose => d.iter().map(|d| d[0]).collect(),
            Op::Splat => vec![d[0][0]; width],
            Op::Extract(i) => vec![d[0][i as usize]],
            Op::Dot => vec![self.dot(&x, &d)],
            Op::Apply(Operator::Mul) if self.scaled_factor(&x).is_some() => self.scaled_product(&x),
            Op::Apply(Operator::Div) if x[0].as_constant().is_some_and(|c| c[..width].iter().all(|&c| c == 1.0)) => {
                self.inverse(x[1], y)
            }
            Op::Apply(operator) => (0..width)
                .map(|i| {
                    let x: Vec<_> = x.iter().map(|x| x.component(i as u8)).collect();
                    let d: Vec<_> = d.iter().map(|d| d[i]).collect();
                    if d.iter().all(|d| d.id == self.zero.id) {
                        return self.zero;
                    }
                    operator.derivative(&x, y.component(i as u8), &d).widen(self.zero.ty().width)
                })
                .collect(),
        }
    }

    /// A factor that is itself a constant times something: `(k a) b`. Gives k, a and b.
    fn scaled_factor(&self, x: &[Expr<'g>]) -> Option<(Expr<'g>, Expr<'g>, Expr<'g>)> {
        [(x[0], x[1]), (x[1], x[0])].into_iter().find_map(|(scaled, b)| {
            let node = scaled.node();
            if node.op != Op::Apply(Operator::Mul) {
                return None;
            }
            let (p, q) = (self.arena.expr(node.args()[0]), self.arena.expr(node.args()[1]));
            let (k, a) = if p.as_constant().is_some() { (p, q) } else { (q, p) };
            (k.as_constant().is_some() && a.as_constant().is_none()).then_some((k, a, b))
        })
    }

    /// The tangents of `(k a) b` as `(k a) db + (k b) da`: the factors are scalars that the value has or shares, so no
    /// tangent is multiplied by k.
    fn scaled_product(&self, x: &[Expr<'g>]) -> Vec<Expr<'g>> {
        let Some((k, a, b)) = self.scaled_factor(x) else { return Vec::new() };
        let scaled = [k * a, k * b];
        let component = |i: usize| {
            let (da, db) = (self.known[&a.id][i], self.known[&b.id][i]);
            if a.id == b.id {
                return da * ((scaled[0] + scaled[0]).component(i as u8));
            }
            db * scaled[0].component(i as u8) + da * scaled[1].component(i as u8)
        };
        (0..x[0].ty().width as usize).map(component).collect()
    }

    /// The tangents of `y = 1 / x` by products of y alone, also where x is a square root: divisions are expensive.
    fn inverse(&self, x: Expr<'g>, y: Expr<'g>) -> Vec<Expr<'g>> {
        let node = x.node();
        let of_root = node.op == Op::Apply(Operator::Sqrt);
        let inner = if of_root { self.arena.expr(node.args()[0]) } else { x };
        let component = |i: usize| {
            let (d, y) = (self.known[&inner.id][i], y.component(i as u8));
            if of_root { d * y * y * (y * -0.5) } else { d * y * -y }
        };
        (0..x.ty().width as usize).map(component).collect()
    }

    /// The tangent of a scalar product.
    fn dot(&self, x: &[Expr<'g>], d: &[&Vec<Expr<'g>>]) -> Expr<'g> {
        let terms = |x: Expr<'g>, d: &[Expr<'g>]| {
            let products = x.components().into_iter().zip(d).map(|(x, d)| *d * x);
            products.reduce(|a, b| a + b).unwrap_or(self.zero)
        };
        if x[0].id == x[1].id {
            return terms(x[0] + x[0], d[0]);
        }
        terms(x[1], d[0]) + terms(x[0], d[1])
    }
}

/// The gradients of a vector's own components: the first three rows of the unit matrix, then 0.
pub fn unit_rows(arena: &Arena, width: u8) -> Vec<Expr<'_>> {
    (0..width as usize)
        .map(|i| {
            let mut row = [0.0; 4];
            row[i] = 1.0;
            arena.constant(Type::V3, row)
        })
        .collect()
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
