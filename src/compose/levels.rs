//! Shapes looked up at every level of an orbit: the state carries what the levels so far were joined to.

use super::orbit::{Constants, OrbitBuilder, State};
use super::value::FieldValue;
use super::{ComposeResult, Purpose};
use crate::expr::Expr;
use crate::graph::{Join, Levels};

/// Distance that stands for nothing joined yet.
const NOTHING: f64 = 1e9;

/// What is carried of the levels.
#[derive(Clone)]
pub(super) struct Joined<'g> {
    /// Signed distance of the join.
    pub(super) d: Expr<'g>,
    /// For surfaces: its unit gradient.
    pub(super) gradient: Option<Expr<'g>>,
}

impl<'g> Joined<'g> {
    /// Before the first level.
    pub(super) fn nothing(join: Join, like: Expr<'g>, surface: bool) -> Joined<'g> {
        let far = if join == Join::Intersection { -NOTHING } else { NOTHING };
        let arena = like.arena;
        Joined { d: arena.f(far), gradient: surface.then(|| arena.v3([0.0, 0.0, 1.0])) }
    }

    /// One level more; `level` is its number.
    pub(super) fn with(&self, levels: Levels, level: Expr<'g>, next: Joined<'g>) -> Joined<'g> {
        let value = |joined: &Joined<'g>| {
            let plain = FieldValue::plain(joined.d, joined.d.lt(joined.d.lift(0.0)));
            FieldValue { gradient: joined.gradient, ..plain }
        };
        let (before, next) = (value(self), value(&next));
        let joined = match levels.join {
            Join::Union => before.nearer(next),
            Join::Intersection => before.farther(next),
            Join::Difference => before.farther(next.turned()),
            Join::SmoothUnion(radius) => before.smooth(next, radius),
        };
        let from = level.lift(f64::from(levels.from));
        let pick = |first: Expr<'g>, joined: Expr<'g>, before: Expr<'g>| {
            // The first level is what the others are taken away from.
            let counted = if levels.join == Join::Difference { level.le(from).select(first, joined) } else { joined };
            level.lt(from).select(before, counted)
        };
        let gradient = joined.gradient.zip(self.gradient).zip(next.gradient);
        Joined {
            d: pick(next.d, joined.d, self.d),
            gradient: gradient.map(|((joined, before), first)| pick(first, joined, before)),
        }
    }
}

impl<'a> OrbitBuilder<'a> {
    /// The levels of the orbit's shape, where it has any.
    pub(super) fn levels(&self) -> Option<Levels> {
        self.settings.shape.and_then(|shape| shape.levels)
    }

    /// The state joined with the level that it is, after `n` iterations.
    pub(super) fn with_level(
        &self,
        mut state: State<'a>,
        before: Option<&Joined<'a>>,
        constants: &Constants<'a>,
        n: Expr<'a>,
    ) -> ComposeResult<State<'a>> {
        let Some(levels) = self.levels() else { return Ok(state) };
        let surface = self.purpose == Purpose::Surface;
        let nothing = Joined::nothing(levels.join, n, surface);
        let (d, gradient) = self.looked_up(&state, constants, n)?;
        let gradient = surface.then(|| gradient.unwrap_or_else(|| n.arena.v3([0.0, 0.0, 1.0])));
        state.joined = Some(before.unwrap_or(&nothing).with(levels, n, Joined { d, gradient }));
        Ok(state)
    }
}
