//! Steps longer than the estimate, for as long as the balls of two estimates in a row touch.
//!
//! An estimate holds all around its point, so a stretch between two points is empty when their balls cover it: nobody has
//! to stop at the end of the first ball. How far the next ball will reach is read off how the estimate changed since the last
//! point: where it goes on like that, the balls just touch. Where they do not after all, or the new point is inside, the
//! march goes back to where the first ball ends, as it would have gone without. (Keinert et al., "Enhanced Sphere Tracing",
//! 2014, step longer by a constant; the slope is after Ban and Valasek, "Automatic Step Size Relaxation in Sphere Tracing", 2023.)

use super::{Inputs, MarchSettings};
use crate::compose::Plan;
use crate::expr::Expr;
use crate::graph::Method;

/// Most times the estimate that a step is long.
const MOST: f64 = 4.0;
/// Share of the length at which balls touch if the estimate goes on as it did.
const CAUTION: f64 = 0.95;
/// Hit thresholds that an estimate must reach for a longer step.
const NEAREST: f64 = 1.0;
/// Share of the hit threshold by which rounding may make a step longer than it was meant.
const SLACK: f64 = 1.0 / 16.0;

/// [`MarchSettings::relaxation`] of a plan: nothing where estimates hold along their ray alone, or step by proofs.
pub(super) fn of_plan(plan: &Plan) -> f64 {
    let along_ray = |m: Method| matches!(m, Method::Directional | Method::DeltaRay) || m.is_certified();
    if plan.choices.iter().any(|choice| along_ray(choice.method)) { 1.0 } else { most() }
}

fn most() -> f64 {
    std::env::var("RELAX").ok().and_then(|s| s.parse().ok()).unwrap_or(MOST)
}
fn caution() -> f64 {
    std::env::var("CAUTION").ok().and_then(|s| s.parse().ok()).unwrap_or(CAUTION)
}
fn nearest() -> f64 {
    std::env::var("NEAREST").ok().and_then(|s| s.parse().ok()).unwrap_or(NEAREST)
}

/// Where to go instead of `forward`, the end of the ball of an estimate `de`.
pub(super) fn farther<'g>(
    ray: &Inputs<'g>,
    settings: &MarchSettings,
    hit_eps: Expr<'g>,
    de: Expr<'g>,
    forward: Expr<'g>,
) -> Expr<'g> {
    if settings.relaxation <= 1.0 {
        return forward;
    }
    let arena = ray.t.arena;
    let (zero, one) = (arena.f(0.0), arena.f(1.0));
    let ball = de * settings.fudge;
    let gap = (ray.t - ray.t_outside).max(hit_eps * SLACK);
    // Without an estimate before it the slope is that of the way straight to a wall.
    let is_known = zero.le(ray.t_outside).and(zero.lt(ray.last_de));
    let slope = is_known.select((de - ray.last_de) * settings.fudge / gap, -one);
    let times = touching(settings, slope);
    let wanted = ray.t + ball * times;
    (hit_eps * nearest()).lt(ball).select(wanted.max(forward), forward)
}

fn keep() -> f64 {
    std::env::var("KEEP").ok().and_then(|s| s.parse().ok()).unwrap_or(0.75)
}

/// The length of a step whose balls touch where their radius changes by this slope, in balls.
fn touching<'g>(settings: &MarchSettings, slope: Expr<'g>) -> Expr<'g> {
    let least = slope.lift(2.0 / settings.relaxation);
    (slope.lift(2.0 * caution()) / (1.0 - slope).max(least)).max(slope.lift(1.0))
}

/// The state `next`, or the way back where the step to here was too long: `t, t_front, t_outside, t_inside, last_de, status`.
pub(super) fn or_back<'g>(
    ray: &Inputs<'g>,
    settings: &MarchSettings,
    hit_eps: Expr<'g>,
    de: Expr<'g>,
    inside: Expr<'g>,
    next: [Expr<'g>; 6],
) -> [Expr<'g>; 6] {
    if settings.relaxation <= 1.0 {
        return next;
    }
    let zero = ray.t.lift(0.0);
    let last_ball = ray.last_de * settings.fudge;
    let last_step = last_ball.max(hit_eps * settings.least_step);
    let gap = ray.t - ray.t_outside;
    let is_march = zero.le(ray.t_outside).and(ray.t_inside.lt(zero));
    let was_longer = is_march.and((last_step + hit_eps * SLACK).lt(gap));
    let is_apart = inside.or((last_ball + de * settings.fudge).lt(gap));
    let back = was_longer.and(is_apart);
    let times = touching(settings, (de - ray.last_de) * settings.fudge / gap);
    // Whatever it is, it must come nearer every time.
    let touch = inside.select(last_step, (last_ball * times).min(gap * keep()).max(last_step));
    let here = [ray.t_outside + touch, ray.t_front, ray.t_outside, ray.t_inside, ray.last_de, ray.status];
    let mut state = next;
    state.iter_mut().zip(here).for_each(|(next, here)| *next = back.select(here, *next));
    state
}
