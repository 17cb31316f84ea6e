//! What ends an orbit, and what of its end state the linear form measures.
//!
//! Tests that look at something large compare a size of z, which changes no faster than z does, with a bound: what is beyond it is
//! as far from the set as that size is above the bound, divided by the derivative. Tests of convergence look at a vector that
//! becomes short: z seen from a point, or how far z moved. Everything that holds of the length of z holds of theirs.

use super::orbit::{OrbitBuilder, State};
use crate::expr::Expr;
use crate::graph::{Escape, OrbitSettings};

/// Whether an orbit goes on with a state: false for what is not a number. `before` is the state of the iteration before, which
/// [`Escape::Still`] asks for.
pub(super) fn stays<'g>(settings: &OrbitSettings, z: Expr<'g>, before: Option<Expr<'g>>) -> Expr<'g> {
    let arena = z.arena;
    let bound = settings.escape_radius;
    let limit = |x: f64| arena.f(x);
    match settings.escape {
        Escape::Length => z.dot(z).le(limit(bound * bound)),
        Escape::Largest | Escape::Sum | Escape::Above(_) | Escape::Beyond(_) => {
            let size = size(settings.escape, z).unwrap_or_else(|| limit(0.0));
            size.le(limit(bound * settings.escape.scale(z.ty().width)))
        }
        Escape::Near(point) => {
            let away = z - arena.constant(z.ty(), point);
            limit(bound * bound).le(away.dot(away))
        }
        Escape::Still => {
            let moved = z - before.unwrap_or_else(|| z.lift(0.0));
            (z.dot(z).max(limit(1.0)) * (bound * bound)).le(moved.dot(moved))
        }
    }
}

/// The size of z that a test compares, scaled so that it changes no faster than z does; `None` for the length and for what
/// converges.
pub(super) fn size<'g>(escape: Escape, z: Expr<'g>) -> Option<Expr<'g>> {
    let along = |normal: [f64; 4]| z.dot(z.arena.constant(z.ty(), normal));
    let sizes = || z.abs().components().into_iter();
    match escape {
        Escape::Length | Escape::Near(_) | Escape::Still => None,
        Escape::Largest => sizes().reduce(|a, b| a.max(b)),
        Escape::Sum => sizes().reduce(|a, b| a + b).map(|sum| sum * escape.scale(z.ty().width)),
        Escape::Above(normal) => Some(along(normal)),
        Escape::Beyond(normal) => Some(along(normal).abs()),
    }
}

impl<'a> OrbitBuilder<'a> {
    /// Whether the orbit goes on with a state.
    pub(super) fn stays(&self, state: &State<'a>) -> Expr<'a> {
        let before = state.before.last().filter(|_| self.settings.escape == Escape::Still);
        stays(self.settings, state.z, before.map(|before| before.z))
    }

    /// The state whose length the estimate is made of: that of the orbit, or what becomes short where it converges.
    pub(super) fn measured(&self, state: &State<'a>) -> State<'a> {
        let arena = self.composer.arena;
        let mut measured = state.clone();
        match (self.settings.escape, state.before.last()) {
            (Escape::Near(point), _) => {
                let point = arena.constant(state.z.ty(), point);
                measured.z = state.z - point;
                measured.shifted = state.shifted.iter().map(|z| *z - point).collect();
            }
            (Escape::Still, Some(before)) => {
                // A length above 1 changes by far less than the step that is compared with it.
                let scale = |z: &Expr<'a>| arena.f(1.0) / z.dot(*z).max(arena.f(1.0)).sqrt();
                let by = scale(&state.z);
                let less = |now: &Expr<'a>, then: &Expr<'a>, by: Expr<'a>| (*now - *then) * by;
                measured.z = less(&state.z, &before.z, by);
                measured.dr = state.dr.zip(before.dr).map(|(now, then)| (now + then) * by);
                measured.rows = state.rows.iter().zip(&before.rows).map(|(now, then)| less(now, then, by)).collect();
                measured.along = state.along.zip(before.along).map(|(now, then)| less(&now, &then, by));
                let shifted = state.shifted.iter().zip(&before.shifted);
                measured.shifted = shifted.map(|(now, then)| less(now, then, scale(now))).collect();
            }
            _ => {}
        }
        measured
    }
}
