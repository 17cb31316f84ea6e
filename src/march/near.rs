//! Marches that only look around: along the normal for how open a place is, and along a ray for how closely it passes.

use super::{MarchSettings, Moment, compose_march};
use crate::compose::Plan;
use crate::expr::{Arena, Expr};
use crate::graph::{LEAST_STEP, Method};
use crate::kernel::records::{Answer, MarchState, Marched, is_known};
use crate::kernel::{Estimator, March, Status};

/// Heights at which a corner is looked at: each is twice the one before, and the last is the greatest.
const HEIGHTS: i32 = 6;
/// The least height as a share of the greatest.
pub const LEAST_HEIGHT: f64 = 1.0 / (1 << (HEIGHTS - 1)) as f64;
/// The estimate over a plain, as a share of the height: estimates of sets that are no solids stay below the distance.
const PLAIN: f64 = 0.6;
/// What corners are looked at by: the first that applies, whatever the picture's rays are marched by, so that a picture is as bright with
/// every estimate.
const METHODS: [Method; 6] =
    [Method::Scalar, Method::Directional, Method::Gradient, Method::Delta, Method::Own, Method::Potential];

/// The plan of what looks at corners.
pub fn corner_plan(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    for choice in &mut plan.choices {
        let own = METHODS.into_iter().find(|method| choice.applicable.contains(method));
        choice.method = own.unwrap_or(choice.method);
    }
    (plan.fudge, plan.least_step) = (1.0, LEAST_STEP);
    plan
}

/// The march along a normal: at heights that double, how far the set is, as a share of the height. `t_outside` has the sum of the
/// shares (after the five heights of Quilez, 2008), `steps` their number.
pub fn compose_corner_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    let mut march = compose_march(arena, estimator, settings);
    let (Moment { ray, state }, Answer { de, inside }, mut function) = Moment::advance(arena);
    let (zero, one) = (arena.f(0.0), arena.f(1.0));
    let share = (de / (state.t * PLAIN)).min(one);
    let share = inside.or(!zero.le(share)).select(zero, share);
    let sum = is_known(state.t_outside).select(state.t_outside + share, share);
    let t = state.t * 2.0;
    let is_last = (ray.t_far * 1.01).lt(t);
    let status = is_last.select(arena.f(Status::Miss.code()), arena.f(Status::RUNNING));
    MarchState { t, t_outside: sum, last_de: de, status, ..state }.write(&mut function);
    march.advance = function;
    march.max_march_steps = HEIGHTS as u32 + 1;
    march
}

/// How open a place is, from 0 to 1.
pub fn openness(corner: Marched<Expr<'_>>) -> Expr<'_> {
    let one = corner.t.lift(1.0);
    let mean = corner.t_outside / corner.steps.max(one);
    is_known(corner.t_outside).select(mean, one)
}

/// The march of a picture's rays once more, for how closely they pass: `t_outside` has the least estimate as a share of the depth.
pub fn compose_passing_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    let mut march = compose_march(arena, estimator, settings);
    let (now, Answer { de, inside }, mut function) = Moment::advance(arena);
    let Moment { ray, state } = &now;
    let zero = arena.f(0.0);
    let usable = zero.le(de).select(de, zero);
    let share = usable / state.t.max(arena.f(1e-30));
    let least = is_known(state.t_outside).select(state.t_outside.min(share), share);
    let step = (usable * settings.fudge).max(now.hit_eps(settings) * settings.least_step);
    let forward = state.t + step.max(super::least_gap(&now, settings));
    let status = inside.select(arena.f(Status::Hit.code()), arena.f(Status::RUNNING));
    let status = ray.t_far.le(forward).select(arena.f(Status::Miss.code()), status);
    MarchState { t: forward, t_outside: least, last_de: usable, status, ..*state }.write(&mut function);
    march.advance = function;
    march
}

/// How closely a ray passes what it does not meet, as a share of the depth; far where it was not marched.
pub fn closest(passing: Marched<Expr<'_>>) -> Expr<'_> {
    is_known(passing.t_outside).select(passing.t_outside, passing.t.lift(1e6))
}
