//! Steps longer than the estimate, for as long as the balls of two estimates in a row touch.
//!
//! An estimate holds all around its point, so a stretch between two points is empty when their balls cover it: nobody has
//! to stop where the first ball ends. How far the next ball will reach is read off how the estimate changed since the last
//! point. Where the balls do not touch after all, or the new point is inside, the march goes back to where they would have
//! by what is known now, or to where the first ball ends. Steps of a constant multiple are due to Keinert and others
//! ("Enhanced Sphere Tracing", 2014), the slope to Ban and Valasek ("Automatic Step Size Relaxation in Sphere Tracing", 2023).

use super::{MarchSettings, Moment, least_gap};
use crate::compose::Plan;
use crate::expr::Expr;
use crate::graph::Method;
use crate::kernel::records::{is_known, is_unknown};

/// Balls that a step is long at most; longer ones go back more often than they gain.
const MOST: f64 = 2.0;
/// Share taken of the length at which balls touch if the estimate goes on as it did.
const CAUTION: f64 = 0.9;
/// Step multiplier up to which estimates are trusted on both sides of their point. Where it is 1 estimates reach a little
/// beyond the surface of what is drawn, which a march that comes near in front of it does not notice.
const TRUSTED: f64 = 0.8;
/// Share of a step that was too long that the next try may be as long as.
const SHORTER: f64 = 0.9;
/// Share of a step of the walk by which rounding may make a step longer than it was meant.
const SLACK: f64 = 1.0 / 16.0;

/// [`MarchSettings::relaxation`] of a plan: 1 where estimates hold along their ray alone, or are proofs.
pub(super) fn of_plan(plan: &Plan) -> f64 {
    let along_ray = |m: Method| matches!(m, Method::Directional | Method::DeltaRay) || m.is_certified();
    if plan.choices.iter().any(|choice| along_ray(choice.method)) { 1.0 } else { MOST }
}

/// The radius of the last ball where there was none: so large that no step from there was too long, and none is longer.
const UNKNOWN: f64 = 1e30;

/// Longer steps of a march: what the ways ahead and back have in common.
pub(super) struct Relaxed<'g> {
    /// The shortest step.
    walk: Expr<'g>,
    /// From the last point outside to this one, or a little more than nothing.
    gap: Expr<'g>,
    /// Radius of the ball in front of this point, and of the last one's.
    ball: Expr<'g>,
    last_ball: Expr<'g>,
    /// The length of a step whose balls touch, in balls of its start.
    touching: Expr<'g>,
    /// What part of the ball in front of a point is trusted behind it, too: all where the step multiplier is [`TRUSTED`] or less.
    behind: f64,
}

impl<'g> Relaxed<'g> {
    /// Nothing where steps may not be longer. `walk` is the shortest step, `de` the estimate here.
    pub(super) fn new(now: &Moment<'g>, settings: &MarchSettings, walk: Expr<'g>, de: Expr<'g>) -> Option<Relaxed<'g>> {
        if settings.relaxation <= 1.0 {
            return None;
        }
        let (zero, one) = (walk.lift(0.0), walk.lift(1.0));
        let last = is_known(now.state.last_de).select(now.state.last_de, zero.lift(UNKNOWN));
        let (ball, last_ball) = (de * settings.fudge, last * settings.fudge);
        let gap = (now.state.t - now.state.t_outside).max(walk * SLACK);
        // Balls touch here if their radius goes on to change by the slope (ball - last_ball) / gap.
        let behind = (TRUSTED / settings.fudge).min(1.0);
        let length = (1.0 + behind) * CAUTION;
        let falling = (gap - (ball - last_ball) * behind).max(gap * (length / settings.relaxation));
        let touching = (gap * length / falling).max(one);
        Some(Relaxed { walk, gap, ball, last_ball, touching, behind })
    }

    /// Where to go instead of `forward`, the end of the ball.
    pub(super) fn farther(&self, now: &Moment<'g>, forward: Expr<'g>) -> Expr<'g> {
        self.walk.lt(self.ball).select(now.state.t + self.ball * self.touching, forward)
    }

    /// Whether the step to here was too long, and where to go back to then.
    pub(super) fn back(&self, now: &Moment<'g>, settings: &MarchSettings, inside: Expr<'g>) -> (Expr<'g>, Expr<'g>) {
        // A step that the precision made longer, since a shorter one would stand still, is no step too long.
        let plain = self.last_ball.max(self.walk).max(least_gap(now, settings));
        let was_longer = is_unknown(now.state.t_inside).and((plain + self.walk * SLACK).lt(self.gap));
        let is_apart = inside.or((self.last_ball + self.ball * self.behind).lt(self.gap));
        let touch = self.last_ball * self.touching;
        let t = now.state.t_outside + inside.select(plain, touch.min(self.gap * SHORTER).max(plain));
        // Back means back, whatever is lost to rounding.
        (was_longer.and(is_apart).and(t.lt(now.state.t)), t)
    }
}
