//! Iterations follow the footprint: an orbit ends where its detail is below the hit threshold.
//!
//! Around the start point lies a ball as large as the hit threshold. While the orbit stays within the set's extent, the ball's
//! image grows with the running derivative; once it is as wide as the whole set, some of the set lies within the
//! threshold, whatever the later iterations do. So `max_iterations` is a ceiling, and what it adds below a pixel's
//! size costs nothing and turns no surface into dust.

use super::orbit::{Carried, OrbitBuilder, State};
use super::{Choice, Purpose};
use crate::expr::Expr;

/// The estimate of a march at points that count as inside; elsewhere it is never below 0.
const RESOLVED: f64 = -1.0;

/// Radius, in extents, that the threshold's image must have. With 2, which covers the set from any point of it, surfaces are
/// as thick as the threshold and crevices close: depths of the built-in bulbs and boxes were 4 footprints off and 90 % of
/// the stops early. With 16 early stops were up to 30 %, with 128 up to 4 %, with 256 up to 6 % of a bulb that jumps. A
/// factor of 8 is one iteration more of the power-8 bulb, three of a Mandelbox.
const COVERS: f64 = 1024.0;

/// How far the point beside is for [`Purpose::Truth`], in hit thresholds: where its orbit is as far away as the set is wide, the
/// threshold's image is [`COVERS`] times as wide.
pub(super) const SHARE_OF_TRUTH: f64 = 1.0 / COVERS;

/// True if orbits can end at the footprint: in marches of a set of known extent.
pub(super) fn can_follow_footprint(choice: &Choice, purpose: Purpose) -> bool {
    matches!(purpose, Purpose::March | Purpose::Truth)
        && choice.ends
        && choice.extent > 0.0
        && choice.by_length
        && !choice.form.is_shape()
}

/// Whether the scalar rules say how large the image of a small ball is. Where they only bound it, points well in front of the set
/// would count as resolved: of quaternion-like squares and the Collatz map 11 to 26 % of the stops were early.
pub(super) fn trusts_rules(choice: &Choice) -> bool {
    choice.tight || !choice.differentiable
}

/// True where orbits end at the footprint.
pub(super) fn follows_footprint(choice: &Choice, purpose: Purpose) -> bool {
    let carried = Carried::of(choice, purpose);
    let tells = carried.scalar || carried.jacobian || carried.along || purpose == Purpose::Truth;
    tells && can_follow_footprint(choice, purpose)
}

impl<'a> OrbitBuilder<'a> {
    pub(super) fn follows_footprint(&self) -> bool {
        follows_footprint(self.choice, self.purpose)
    }

    /// Whether the orbit ends with this state: it escaped, or its detail is below the hit threshold. NaN compares false, so
    /// it counts as escaped.
    pub(super) fn has_ended(&self, state: &State<'a>, hit_eps: Expr<'a>) -> Expr<'a> {
        let escaped = !self.stays(state);
        if self.follows_footprint() { escaped.or(self.is_resolved(state, hit_eps)) } else { escaped }
    }

    /// Whether the image of a ball of radius `hit_eps` around the start point is as wide as the set. What a Jacobian says is
    /// how fast r grows: beside an axis where azimuths are torn apart its norm says nothing about how much of the set
    /// the image covers.
    fn is_resolved(&self, state: &State<'a>, hit_eps: Expr<'a>) -> Expr<'a> {
        if let (Purpose::Truth, Some(beside)) = (self.purpose, state.shifted.first()) {
            let extent_sq = self.composer.arena.f(self.choice.extent * self.choice.extent);
            let away = *beside - state.z;
            return extent_sq.lt(away.dot(away));
        }
        let reach = COVERS * self.choice.extent;
        if let Some(dr) = state.dr.filter(|_| trusts_rules(self.choice)) {
            return self.composer.arena.f(reach).lt(dr * hit_eps);
        }
        let r_sq = state.z.dot(state.z);
        // r times its gradient, or r times its change along the ray.
        let rows = state.z.components().into_iter().zip(&state.rows).map(|(z, row)| *row * z);
        let change = rows.reduce(|a, b| a + b).or(state.along.map(|along| state.z.dot(along)));
        let change = change.unwrap_or_else(|| hit_eps.lift(0.0));
        (r_sq * (reach * reach)).lt(change.dot(change) * (hit_eps * hit_eps))
    }

    /// The estimate of a march with the mark of what is resolved.
    pub(super) fn mark_resolved(&self, state: &State<'a>, hit_eps: Expr<'a>, de: Expr<'a>) -> Expr<'a> {
        self.stays(state).and(self.is_resolved(state, hit_eps)).select(de.lift(RESOLVED), de)
    }
}

/// Whether an orbit's estimate marks a point as resolved.
pub(super) fn is_marked<'g>(de: Expr<'g>) -> Expr<'g> {
    de.lt(de.lift(0.0))
}
