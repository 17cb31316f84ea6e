//! Local identities, applied whenever a node is made: folding, neutral elements, components of known vectors.
//!
//! Values never change but by rounding, with one exception that derivatives rely on: 0 times anything is 0.

use super::linear::joined;
use super::ops::Operator;
use super::{Arena, Expr, Op, Type};

/// Makes a vector from components, or finds the vector that they were taken from.
pub(super) fn compose<'g>(arena: &'g Arena, parts: &[Expr<'g>], ty: Type) -> Expr<'g> {
    if let Some(values) = parts.iter().map(|p| p.as_constant().map(|c| c[0])).collect::<Option<Vec<f64>>>() {
        let mut components = [0.0; 4];
        components[..values.len()].copy_from_slice(&values);
        return arena.constant(ty, components);
    }
    if parts.iter().all(|p| p.id == parts[0].id) {
        return splat(parts[0], ty);
    }
    let origin = |i: usize| match parts[i].node() {
        node if node.op == Op::Extract(i as u8) => Some(node.args()[0]),
        _ => None,
    };
    if let Some(first) = origin(0)
        && arena.node(first).ty == ty
        && (1..parts.len()).all(|i| origin(i) == Some(first))
    {
        return arena.expr(first);
    }
    let ids: Vec<_> = parts.iter().map(|p| p.id).collect();
    arena.intern(Op::Compose, &ids, ty)
}

/// Makes a vector of equal components.
pub(super) fn splat(x: Expr<'_>, ty: Type) -> Expr<'_> {
    match x.as_constant() {
        Some(c) => x.arena.constant(ty, [c[0]; 4]),
        None => x.arena.intern(Op::Splat, &[x.id], ty),
    }
}

/// Takes a component, looking through compositions and constants.
pub(super) fn extract(v: Expr<'_>, i: u8) -> Expr<'_> {
    let node = v.node();
    if node.ty.width == 1 {
        return v;
    }
    let ty = node.ty.with_width(1);
    match node.op {
        Op::Const(bits) => v.arena.constant(ty, [f64::from_bits(bits[i as usize]), 0.0, 0.0, 0.0]),
        Op::Compose => v.arena.expr(node.args()[i as usize]),
        Op::Splat => v.arena.expr(node.args()[0]),
        _ => v.arena.intern(Op::Extract(i), &[v.id], ty),
    }
}

/// The scalar product.
pub(super) fn dot<'g>(a: Expr<'g>, b: Expr<'g>) -> Expr<'g> {
    assert_eq!(a.ty(), b.ty(), "dot needs vectors of one width");
    if a.ty().width == 1 {
        return a * b;
    }
    match (a.as_constant(), b.as_constant()) {
        (Some(x), Some(y)) => a.arena.f(x.iter().zip(y).map(|(x, y)| x * y).sum()),
        (Some(x), _) => sparse_dot(x, b).unwrap_or_else(|| make_dot(a, b)),
        (_, Some(y)) => sparse_dot(y, a).unwrap_or_else(|| make_dot(a, b)),
        _ => make_dot(a, b),
    }
}

fn make_dot<'g>(a: Expr<'g>, b: Expr<'g>) -> Expr<'g> {
    let (a, b) = if a.id <= b.id { (a, b) } else { (b, a) };
    a.arena.intern(Op::Dot, &[a.id, b.id], Type::F)
}

/// A product with a constant vector that has at most one component other than 0.
fn sparse_dot(constant: [f64; 4], v: Expr<'_>) -> Option<Expr<'_>> {
    let mut used = (0..4).filter(|&i| constant[i] != 0.0);
    let first = used.next();
    if used.next().is_some() {
        return None;
    }
    Some(match first {
        None => v.arena.f(0.0),
        Some(i) => v.component(i as u8) * constant[i],
    })
}

/// Makes an operator's node from arguments of one width, unless an identity gives something simpler.
pub(super) fn apply<'g>(operator: Operator, args: &[Expr<'g>], ty: Type) -> Expr<'g> {
    let arena = args[0].arena;
    let constants: Vec<Option<[f64; 4]>> = args.iter().map(|a| a.as_constant()).collect();
    if let Some(folded) = fold(operator, &constants, ty) {
        return arena.constant(ty, folded);
    }
    if !arena.is_as_written() {
        if let Some(simpler) = identity(operator, args, &constants) {
            return simpler;
        }
        if let Some(x) = common_splat(args) {
            return splat(apply(operator, &x, ty.with_width(1)), ty);
        }
    }
    let mut ids: Vec<_> = args.iter().map(|a| a.id).collect();
    if matches!(operator, Operator::Add | Operator::Mul) && ids[0] > ids[1] {
        ids.swap(0, 1);
    }
    arena.intern(Op::Apply(operator), &ids, ty)
}

fn fold(operator: Operator, constants: &[Option<[f64; 4]>], ty: Type) -> Option<[f64; 4]> {
    let values: Vec<[f64; 4]> = constants.iter().copied().collect::<Option<_>>()?;
    let mut result = [0.0; 4];
    for (i, out) in result.iter_mut().enumerate().take(ty.width as usize) {
        let value = |k: usize| values.get(k).map_or(0.0, |v| v[i]);
        *out = operator.evaluate_f64(value(0), value(1), value(2));
    }
    Some(result)
}

/// Arguments that are all one number in every component (constants included, not only constants).
fn common_splat<'g>(args: &[Expr<'g>]) -> Option<Vec<Expr<'g>>> {
    let scalar = |a: &Expr<'g>| {
        let node = a.node();
        match node.op {
            Op::Splat => Some(a.arena.expr(node.args()[0])),
            Op::Const(bits) if node.ty.width > 1 && (1..node.ty.width).all(|i| bits[i as usize] == bits[0]) => {
                Some(a.component(0))
            }
            _ => None,
        }
    };
    args.iter().map(scalar).collect()
}

fn identity<'g>(operator: Operator, args: &[Expr<'g>], constants: &[Option<[f64; 4]>]) -> Option<Expr<'g>> {
    let width = args[0].ty().width as usize;
    let is = |k: usize, x: f64| constants[k].is_some_and(|c| c[..width].iter().all(|&v| v == x));
    let (a, b) = (args[0], *args.get(1).unwrap_or(&args[0]));
    let negated = |e: Expr<'g>| {
        let node = e.node();
        (node.op == Op::Apply(Operator::Neg)).then(|| e.arena.expr(node.args()[0]))
    };
    match operator {
        Operator::Neg | Operator::Not if a.node().op == Op::Apply(operator) => Some(a.arena.expr(a.node().args()[0])),
        Operator::Add if is(0, 0.0) => Some(b),
        Operator::Add if is(1, 0.0) => Some(a),
        Operator::Add if a.id == b.id => Some(a * 2.0),
        Operator::Add | Operator::Sub if width > 1 && a.id != b.id && joined(operator, a, b).is_some() => {
            joined(operator, a, b)
        }
        Operator::Add => match (negated(a), negated(b)) {
            (_, Some(y)) => Some(a - y),
            (Some(x), None) => Some(b - x),
            _ => None,
        },
        Operator::Sub if is(0, 0.0) => Some(-b),
        Operator::Sub if is(1, 0.0) => Some(a),
        Operator::Sub if a.id == b.id => Some(a.lift(0.0)),
        Operator::Sub => negated(b).map(|y| a + y),
        Operator::Mul if is(0, 0.0) || is(1, 0.0) => Some(a.lift(0.0)),
        Operator::Mul if is(0, 1.0) => Some(b),
        Operator::Mul if is(1, 1.0) => Some(a),
        Operator::Mul if is(0, -1.0) => Some(-b),
        Operator::Mul if is(1, -1.0) => Some(-a),
        // Scalar factors of a vector meet before they meet the vector: one multiplication of the vector instead of two.
        Operator::Mul if width > 1 && join_scalars(a, b).is_some() => join_scalars(a, b),
        Operator::Neg if width > 1 && scalar_factor(a).is_some() => {
            scalar_factor(a).map(|(v, s)| v * (-s).widen(width as u8))
        }
        // A constant goes to one factor of a product, where derivatives share it.
        Operator::Mul if constants[0].is_some() => into_factor(a, b),
        Operator::Mul if constants[1].is_some() => into_factor(b, a),
        Operator::Div if is(0, 0.0) => Some(a),
        Operator::Div if is(1, 1.0) => Some(a),
        // A vector divided by one number: one division instead of three.
        Operator::Div if width > 1 => common_splat(&[b]).map(|s| a * (1.0 / s[0]).widen(width as u8)),
        Operator::Pow => whole_power(a, constants[1]),
        Operator::Min | Operator::Max if a.id == b.id => Some(a),
        Operator::And if is(0, 1.0) || a.id == b.id => Some(b),
        Operator::And if is(1, 1.0) => Some(a),
        Operator::And if is(0, 0.0) => Some(a),
        Operator::And if is(1, 0.0) => Some(b),
        Operator::Or if is(0, 0.0) || a.id == b.id => Some(b),
        Operator::Or if is(1, 0.0) => Some(a),
        Operator::Or if is(0, 1.0) => Some(a),
        Operator::Or if is(1, 1.0) => Some(b),
        Operator::Select if is(0, 1.0) || args[1].id == args[2].id => Some(args[1]),
        Operator::Select if is(0, 0.0) => Some(args[2]),
        _ => None,
    }
}

/// A vector that is a vector times one number: both of them.
pub(super) fn scalar_factor(product: Expr<'_>) -> Option<(Expr<'_>, Expr<'_>)> {
    let node = product.node();
    if node.op != Op::Apply(Operator::Mul) {
        return None;
    }
    let (a, b) = (product.arena.expr(node.args()[0]), product.arena.expr(node.args()[1]));
    match (common_splat(&[a]), common_splat(&[b])) {
        (_, Some(s)) => Some((a, s[0])),
        (Some(s), _) => Some((b, s[0])),
        _ => None,
    }
}

/// `(v s) t` with numbers s and t as `v (s t)`.
fn join_scalars<'g>(a: Expr<'g>, b: Expr<'g>) -> Option<Expr<'g>> {
    let ((v, s), t) = match (scalar_factor(a), common_splat(&[b]), scalar_factor(b), common_splat(&[a])) {
        (Some(product), Some(t), _, _) => (product, t[0]),
        (_, _, Some(product), Some(t)) => (product, t[0]),
        _ => return None,
    };
    Some(v * (s * t).widen(v.ty().width))
}

/// Constant and rest of a product with a constant.
fn scaled(product: Expr<'_>) -> Option<(Expr<'_>, Expr<'_>)> {
    let node = product.node();
    if node.op != Op::Apply(Operator::Mul) {
        return None;
    }
    let (a, b) = (product.arena.expr(node.args()[0]), product.arena.expr(node.args()[1]));
    match (a.as_constant(), b.as_constant()) {
        (Some(_), _) => Some((a, b)),
        (_, Some(_)) => Some((b, a)),
        _ => None,
    }
}

/// `k (a b)` as `(k a) b`.
fn into_factor<'g>(constant: Expr<'g>, product: Expr<'g>) -> Option<Expr<'g>> {
    let node = product.node();
    if node.op != Op::Apply(Operator::Mul) {
        return None;
    }
    let (a, b) = (product.arena.expr(node.args()[0]), product.arena.expr(node.args()[1]));
    match (a.as_constant(), b.as_constant()) {
        (Some(_), _) => Some((constant * a) * b),
        (_, Some(_)) => Some((constant * b) * a),
        // A product that is scaled already is shared as it is: one more factor costs one multiplication.
        _ if scaled(a).is_some() || scaled(b).is_some() => None,
        _ => Some((constant * a) * b),
    }
}

/// Powers of a known whole exponent become products, of a half square roots.
fn whole_power<'g>(base: Expr<'g>, exponent: Option<[f64; 4]>) -> Option<Expr<'g>> {
    let width = base.ty().width as usize;
    let exponent = exponent?;
    let n = exponent[0];
    if exponent[..width].iter().any(|&x| x != n) {
        return None;
    }
    if n == 0.5 {
        return Some(base.sqrt());
    }
    (n.fract() == 0.0 && n.abs() <= 16.0).then(|| base.powi(n as i32))
}
