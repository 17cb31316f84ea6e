//! Sums of two vectors times numbers, taken together with the numbers first.
//!
//! Derivatives of chains of complex products (powers by squaring) multiply several vectors by one complex number after
//! another. Since `(v s) t = v (s t)`, the complex numbers can meet before they meet the vectors: a product of numbers
//! instead of one of vectors for each link of the chain.

use super::ops::Operator;
use super::simplify::scalar_factor;
use super::{Expr, Op};

/// A vector times a number, subtracted if `minus`.
#[derive(Clone, Copy)]
struct Term<'g> {
    vector: Expr<'g>,
    number: Expr<'g>,
    minus: bool,
}

/// The sum or difference of `a` and `b` over the vectors that they are made of, if both are numbers times sums of the
/// same two vectors times numbers.
pub(super) fn joined<'g>(operator: Operator, a: Expr<'g>, b: Expr<'g>) -> Option<Expr<'g>> {
    let (a, b) = (scaled_terms(a)?, scaled_terms(b)?);
    let subtracts = operator == Operator::Sub;
    let twin = |term: Term<'g>| b.into_iter().find(|other| other.vector.id == term.vector.id);
    let mut terms = Vec::new();
    for term in a {
        let other = twin(term)?;
        let (number, minus) = sum((term.number, term.minus), (other.number, other.minus != subtracts));
        terms.push((term.vector * number.widen(term.vector.ty().width), minus));
    }
    let (value, minus) = sum(terms[0], terms[1]);
    Some(if minus { -value } else { value })
}

/// The terms of a number times a sum of two different vectors times numbers.
fn scaled_terms(product: Expr<'_>) -> Option<[Term<'_>; 2]> {
    let (vector, factor) = scalar_factor(product)?;
    let terms = terms(vector)?;
    Some(terms.map(|term| Term { number: term.number * factor, ..term }))
}

fn terms(sum: Expr<'_>) -> Option<[Term<'_>; 2]> {
    let node = sum.node();
    let Op::Apply(operator @ (Operator::Add | Operator::Sub)) = node.op else { return None };
    let term = |i: usize, minus: bool| {
        let (vector, number) = scalar_factor(sum.arena.expr(node.args()[i]))?;
        Some(Term { vector, number, minus })
    };
    let terms = [term(0, false)?, term(1, operator == Operator::Sub)?];
    (terms[0].vector.id != terms[1].vector.id).then_some(terms)
}

/// The sum of two values with signs, and whether it is subtracted.
fn sum<'g>((a, minus_a): (Expr<'g>, bool), (b, minus_b): (Expr<'g>, bool)) -> (Expr<'g>, bool) {
    match (minus_a, minus_b) {
        (false, false) => (a + b, false),
        (false, true) => (a - b, false),
        (true, false) => (b - a, false),
        (true, true) => (a + b, true),
    }
}
