//! Traps of orbits, and the colours that they blend.
//!
//! A trap is a number that an orbit carries for the picture's surface: 0 if it is caught best, which shows its colour in full.

use super::orbit::OrbitBuilder;
use crate::expr::{Arena, Expr, Type};
use crate::graph::{Look, Palette, TRAPS, Trap};

/// What traps are before an orbit: nothing has been caught.
const NOTHING: f64 = 1e6;
/// How fast colours fade with the square of a distance, and with a distance.
const BY_SQUARE: f64 = -2.5;
const BY_DISTANCE: f64 = -4.0;

/// Traps of what has no orbit.
pub(super) fn untouched(arena: &Arena) -> Expr<'_> {
    arena.constant(Type::V4, [NOTHING; 4])
}

/// The traps, as far as traps start where an orbit that became NaN left one that is none.
pub(crate) fn usable_trap(trap: Expr<'_>) -> Expr<'_> {
    trap.le(trap.arena.f(NOTHING)).select(trap, untouched(trap.arena))
}

/// The palette's first colour with the others blended in as far as their traps caught the orbit (after Quilez). In the picture of
/// a plane with a normal `across` a trap that lies along it has no effect.
pub(crate) fn paint<'g>(look: &Look, palette: &Palette, trap: Expr<'g>, across: Option<[f64; 3]>) -> Expr<'g> {
    let arena = trap.arena;
    let colours = palette.map(|c| arena.v3(c));
    // The first trap lies over the others.
    [1, 2, 3, 0].into_iter().fold(colours[0], |colour, i: usize| {
        let Some(kind) = look.traps[i].filter(|kind| !lies_along(kind, across)) else { return colour };
        colour.mix(colours[i + 1], nearness(kind, trap.component(i as u8)))
    })
}

fn lies_along(trap: &Trap, across: Option<[f64; 3]>) -> bool {
    match (trap, across) {
        (Trap::Plane { normal, .. }, Some(across)) => {
            let along: f64 = normal.iter().zip(across).map(|(a, b)| a * b).sum();
            along.abs() > 1.0 - 1e-9
        }
        _ => false,
    }
}

/// How much of a trap's colour shows.
fn nearness<'g>(kind: Trap, caught: Expr<'g>) -> Expr<'g> {
    match kind {
        Trap::Point(_) | Trap::Line { .. } | Trap::Circle { .. } => (caught * BY_SQUARE).exp(),
        Trap::Plane { .. } => (caught * BY_DISTANCE).exp(),
        Trap::Iterations | Trap::LastFold(_) => -caught.min(caught.lift(1.0)) + 1.0,
    }
}

/// Square of the distance, or the distance from a plane.
fn distance<'g>(kind: Trap, z: Expr<'g>) -> Option<Expr<'g>> {
    let arena = z.arena;
    let seen_from = |at: [f64; 3]| if at == [0.0; 3] { z } else { z - arena.v3(at) };
    Some(match kind {
        Trap::Point(at) => seen_from(at).dot(seen_from(at)),
        Trap::Line { at, along } => {
            let off = seen_from(at);
            let ahead = off.dot(arena.v3(along));
            (off.dot(off) - ahead * ahead).max(arena.f(0.0))
        }
        Trap::Circle { centre, normal, radius } => {
            let off = seen_from(centre);
            let up = off.dot(arena.v3(normal));
            let out = (off.dot(off) - up * up).max(arena.f(0.0)).sqrt() - radius;
            out * out + up * up
        }
        Trap::Plane { normal, offset } => (z.dot(arena.v3(normal)) - offset).abs(),
        Trap::Iterations | Trap::LastFold(_) => return None,
    })
}

impl<'a> OrbitBuilder<'a> {
    /// The traps after an iteration that ended in z; `n` is its number from 0, and `sides` are those of the folds that are followed.
    pub(super) fn trapped(&self, trap: Expr<'a>, z: Expr<'a>, n: Expr<'a>, sides: &[(u8, Expr<'a>)]) -> Expr<'a> {
        let arena = self.composer.arena;
        let traps = &self.composer.graph.scene.look.traps;
        let z = z.xyz();
        if *traps == TRAPS {
            let sizes = z.abs().components();
            return trap.min(arena.compose(&[z.dot(z), sizes[0], sizes[1], sizes[2]]));
        }
        let mut folds = sides.iter();
        let parts = (0..4u8).map(|i| {
            let before = trap.component(i);
            match traps[usize::from(i)] {
                None => arena.f(NOTHING),
                Some(Trap::Iterations) => (n + 1.0) * (-1.0 / f64::from(self.settings.max_iterations.max(1))) + 1.0,
                Some(Trap::LastFold(_)) => folds.next().map_or(before, |(_, side)| *side),
                Some(kind) => distance(kind, z).map_or(before, |d| before.min(d)),
            }
        });
        arena.compose(&parts.collect::<Vec<_>>())
    }
}
