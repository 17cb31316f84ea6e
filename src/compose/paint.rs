//! Traps of orbits, and the colours that they blend.
//!
//! A trap is a number that an orbit carries for the picture's surface: 0 if it is caught best, which shows its colour in full.

use super::ComposeResult;
use super::field::shape_at;
use super::orbit::OrbitBuilder;
use super::solid::signed_distance;
use crate::expr::{Arena, Expr, Function, Type};
use crate::graph::{DeForm, Escape, Look, Marks, NO_ESCAPE, Palette, Primitive, TRAPS, Trap};

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
        Trap::Plane { .. } | Trap::Sphere { .. } | Trap::Box { .. } | Trap::Field(_) => (caught * BY_DISTANCE).exp(),
        Trap::Iterations | Trap::LastFold(_) => -caught.min(caught.lift(1.0)) + 1.0,
    }
}

/// Traps as distances; those that are none as they are.
pub(super) fn distances<'g>(look: &Look, trap: Expr<'g>) -> Expr<'g> {
    let part = |i: u8| match look.traps[usize::from(i)] {
        Some(Trap::Point(_) | Trap::Line { .. } | Trap::Circle { .. }) => {
            trap.component(i).max(trap.arena.f(0.0)).sqrt()
        }
        _ => trap.component(i),
    };
    trap.arena.compose(&[part(0), part(1), part(2), part(3)])
}

/// Where on a trap a point is: the share of a turn around it, from 0 to 1, or the place along a line.
fn place_on<'g>(kind: Trap, z: Expr<'g>) -> Expr<'g> {
    let arena = z.arena;
    let turn = |centre: [f64; 3], axis: [f64; 3]| {
        let axis = glam::DVec3::from(axis);
        let (right, up) = axis.any_orthonormal_pair();
        let off = z - arena.v3(centre);
        let angle = off.dot(arena.v3(up.into())).atan2(off.dot(arena.v3(right.into())));
        angle * (0.5 / std::f64::consts::PI) + 0.5
    };
    let upwards = [0.0, 0.0, 1.0];
    match kind {
        Trap::Line { at, along } => (z - arena.v3(at)).dot(arena.v3(along)),
        Trap::Point(centre) | Trap::Sphere { centre, .. } | Trap::Box { centre, .. } => turn(centre, upwards),
        Trap::Circle { centre, normal, .. } => turn(centre, normal),
        Trap::Plane { normal, offset } => turn(normal.map(|part| part * offset), normal),
        Trap::Field(_) => turn([0.0; 3], upwards),
        Trap::Iterations | Trap::LastFold(_) => arena.f(0.0),
    }
}

/// Square of the distance, or the distance from what has an inside or two sides.
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
        Trap::Sphere { centre, radius } => (seen_from(centre).length() - radius).abs(),
        Trap::Box { centre, half_size } => {
            let shape = Primitive::Box { centre, half_size };
            signed_distance(&shape, z).abs()
        }
        Trap::Field(_) | Trap::Iterations | Trap::LastFold(_) => return None,
    })
}

impl<'a> OrbitBuilder<'a> {
    /// The traps after an iteration that ended in z; `n` is its number from 0, and `sides` are those of the folds that are followed.
    pub(super) fn trapped(
        &self,
        trap: Expr<'a>,
        z: Expr<'a>,
        n: Expr<'a>,
        sides: &[(u8, Expr<'a>)],
    ) -> ComposeResult<Expr<'a>> {
        let arena = self.composer.arena;
        let traps = &self.composer.graph.scene.look.traps;
        let (whole, z) = (z, z.xyz());
        if *traps == TRAPS {
            let sizes = z.abs().components();
            return Ok(trap.min(arena.compose(&[z.dot(z), sizes[0], sizes[1], sizes[2]])));
        }
        let mut folds = sides.iter();
        let parts = (0..4u8).map(|i| {
            let before = trap.component(i);
            Ok(match traps[usize::from(i)] {
                None => arena.f(NOTHING),
                Some(Trap::Iterations) => (n + 1.0) * (-1.0 / f64::from(self.settings.max_iterations.max(1))) + 1.0,
                Some(Trap::LastFold(_)) => folds.next().map_or(before, |(_, side)| *side),
                Some(Trap::Field(field)) => before.min(shape_at(self.composer, field, whole, n)?.abs()),
                Some(kind) => distance(kind, z).map_or(before, |d| before.min(d)),
            })
        });
        Ok(arena.compose(&parts.collect::<ComposeResult<Vec<_>>>()?))
    }

    /// What the orbit begins to note.
    pub(super) fn first_notes(&self, z: Expr<'a>) -> Notes<'a> {
        let (arena, marks) = (self.composer.arena, self.carried.marks);
        let none = |asked: [bool; 4]| asked.contains(&true).then(|| arena.constant(Type::V4, [0.0; 4]));
        Notes { caught: none(marks.caught), places: none(marks.places), before: marks.smooth.then(|| z.length()) }
    }

    /// What is noted after an iteration from `before` to `z`, whose traps were `trap` and became `now`.
    pub(super) fn noted(
        &self,
        notes: &Notes<'a>,
        [before, z]: [Expr<'a>; 2],
        traps: [Expr<'a>; 2],
        n: Expr<'a>,
    ) -> Notes<'a> {
        let arena = self.composer.arena;
        let is_nearer = || traps[1].lt(traps[0]);
        let place = |i: usize| {
            let kind = self.composer.graph.scene.look.traps[i].filter(|_| self.carried.marks.places[i]);
            kind.map_or(arena.f(0.0), |kind| place_on(kind, z.xyz()))
        };
        Notes {
            caught: notes.caught.map(|caught| is_nearer().select((n + 1.0).widen(4), caught)),
            places: notes
                .places
                .map(|places| is_nearer().select(arena.compose(&[place(0), place(1), place(2), place(3)]), places)),
            before: notes.before.map(|_| before.length()),
        }
    }

    /// What goes out of an orbit's end for [`Marks`], in the order of [`Marked::read`].
    pub(super) fn finish_notes(&self, function: &mut Function, notes: &Notes<'a>, z: Expr<'a>, n: Expr<'a>) {
        let marks = self.carried.marks;
        if let Some(before) = notes.before {
            function.output("smooth", self.smooth_count(before, z.length(), n));
        }
        if marks.radius {
            function.output("radius", z.length());
        }
        for (name, value) in [("caught", notes.caught), ("places", notes.places)] {
            if let Some(value) = value {
                function.output(name, value);
            }
        }
    }

    /// Iterations, the last of which counts as far as the escape radius lies between the lengths before and after it: by their
    /// logarithms, or by those of these where lengths grow by a power. It goes on without a step where one more iteration is needed.
    fn smooth_count(&self, before: Expr<'a>, after: Expr<'a>, n: Expr<'a>) -> Expr<'a> {
        let arena = self.composer.arena;
        let limit = self.settings.escape_radius;
        if self.settings.escape != Escape::Length || limit >= NO_ESCAPE {
            return n;
        }
        let scale = |r: Expr<'a>| match self.choice.form {
            DeForm::Logarithmic => (r.clamp(arena.f(1.0), arena.f(LONGEST)).ln() + 0.05).ln(),
            _ => r.clamp(arena.f(1e-6), arena.f(LONGEST)).ln(),
        };
        let (from, to, edge) = (scale(before), scale(after), scale(arena.f(limit)));
        let share = ((edge - from) / (to - from).max(arena.f(1e-6))).clamp(arena.f(0.0), arena.f(1.0));
        arena.f(limit).lt(after).select(n - 1.0 + share, n)
    }
}

/// Lengths beyond are as good as infinite.
const LONGEST: f64 = 1e18;

/// What an orbit notes on its way for colours and matter.
#[derive(Clone, Copy)]
pub(super) struct Notes<'g> {
    /// The iteration that came nearest to each trap, and where on it that was.
    caught: Option<Expr<'g>>,
    places: Option<Expr<'g>>,
    /// Length of the point before the last iteration.
    before: Option<Expr<'g>>,
}

impl<'g> Notes<'g> {
    /// Names and values.
    pub(super) fn parts(&self) -> impl Iterator<Item = (&'static str, Expr<'g>)> {
        let all = [("caught", self.caught), ("places", self.places), ("r_before", self.before)];
        all.into_iter().filter_map(|(name, value)| Some((name, value?)))
    }

    /// The same, each value made another.
    pub(super) fn map(&self, mut other: impl FnMut(Expr<'g>) -> Expr<'g>) -> Notes<'g> {
        Notes {
            caught: self.caught.map(&mut other),
            places: self.places.map(&mut other),
            before: self.before.map(&mut other),
        }
    }
}

/// What came out of an orbit's end for colours and matter: 0 where nothing asks.
pub(super) struct Marked<'g> {
    pub(super) smooth: Expr<'g>,
    pub(super) radius: Expr<'g>,
    pub(super) caught: Expr<'g>,
    pub(super) places: Expr<'g>,
}

impl<'g> Marked<'g> {
    /// From the further outputs of an orbit's end, in the order in which it gives them.
    pub(super) fn read(arena: &'g Arena, marks: Marks, outputs: &[Expr<'g>]) -> Marked<'g> {
        let mut outputs = outputs.iter();
        let mut next = |is_there: bool, ty: Type| {
            let nothing = arena.constant(ty, [0.0; 4]);
            if is_there { outputs.next().copied().unwrap_or(nothing) } else { nothing }
        };
        Marked {
            smooth: next(marks.smooth, Type::F),
            radius: next(marks.radius, Type::F),
            caught: next(marks.caught.contains(&true), Type::V4),
            places: next(marks.places.contains(&true), Type::V4),
        }
    }
}
