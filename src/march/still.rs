//! Rays that stand still: one estimate at the origin of each, for pictures of a plane.
//!
//! A march of one step has the inputs, outputs and counts of any other, so that renderers, back ends and statistics need
//! not know. Status is `Hit` where the point is inside, or cannot be told from one that is, else `Miss`; `last_de` is the estimate.

use super::{MarchSettings, Moment};
use crate::compose::Plan;
use crate::expr::{Arena, Function};
use crate::graph::Method;
use crate::kernel::records::{Answer, MarchState, Query, UNKNOWN};
use crate::kernel::{Estimator, March, Status};

/// The plan for points that no ray goes through: where a method holds along a ray alone, or is a proof, its like in all
/// directions takes its place.
pub fn still_plan(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    for choice in &mut plan.choices {
        let first = match choice.method {
            Method::Directional => Method::Jacobian,
            Method::DeltaRay => Method::Delta,
            method if method.is_certified() => Method::Gradient,
            _ => continue,
        };
        let likes = [first, Method::Gradient, Method::Delta, Method::Scalar];
        let like = likes.into_iter().find(|like| choice.applicable.contains(like)).unwrap_or(first);
        choice.reason = format!("for `{}`, which is of rays, in a plane", choice.method.name());
        choice.method = like;
    }
    plan
}

/// An estimator at the origins of rays.
pub fn compose_still(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    let (now, mut locate) = Moment::locate(arena);
    let (p, d) = (now.ray.origin, now.ray.direction);
    Query { p, d, h: now.difference(settings, p), hit_eps: arena.f(settings.hit_eps) }.write(&mut locate);
    March { estimator, locate, advance: compose_advance(arena, settings), max_march_steps: 1 }
}

/// Share of the hit threshold below which a point counts as one of the set: where orbits are chaotic, only rounding decides
/// which of such points leave. An estimate that is not a number is below it too: derivatives overflow nowhere else.
const INDISTINCT: f64 = 1e-3;

/// The end of a ray, from its only estimate.
fn compose_advance(arena: &Arena, settings: &MarchSettings) -> Function {
    let (now, Answer { de, inside }, mut function) = Moment::advance(arena);
    let is_in = inside.or(!arena.f(settings.hit_eps * INDISTINCT).le(de));
    let (unknown, zero, t) = (arena.f(UNKNOWN), arena.f(0.0), now.state.t);
    let next = MarchState {
        t,
        t_front: t,
        t_outside: is_in.select(unknown, zero),
        t_inside: is_in.select(zero, unknown),
        last_de: de,
        status: is_in.select(arena.f(Status::Hit.code()), arena.f(Status::Miss.code())),
    };
    next.write(&mut function);
    function
}
