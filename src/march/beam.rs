//! Beams: cones around a central ray that hold the rays of many pixels, marched once for all of them.
//!
//! A beam's rays start in one point. Its central ray runs by a parameter `w` that is the beam's radius: its direction is as
//! long as the beam is narrow, so that the point of every ray at the same distance from the origin lies within `w` of the
//! central one. With spread k (the most that a ray's unit direction differs from the central one, in length) that distance is
//! t = w / k. An estimate D at `w` proves, or makes likely, that all of the beam up to t + s is empty, where
//! s^2 + s w k + w^2 = D^2. Where s is a small share of w the beam ends; its rays start there. Rays of a beam that left
//! the bounding sphere have missed without an estimate of their own.

use super::{MarchSettings, Moment};
use crate::compose::Plan;
use crate::expr::{Arena, Expr, Function};
use crate::graph::Method;
use crate::kernel::records::{Answer, MarchState, Query, UNKNOWN, is_unknown};
use crate::kernel::{Estimator, March, Status};

/// Share of a beam's radius that an advance is worth an estimate for.
const USEFUL: f64 = 0.1;
/// Share of an estimate that a beam takes, besides the march's own step multiplier.
const CAUTION: f64 = 0.9;
/// The next proof is to reach this much further than the last one did, and beyond its radius at least.
const PROPOSAL: f64 = 1.5;
/// What the next proof is to reach at least, as a share of what the last one was to, before [`PROPOSAL`].
const LESS: f64 = 0.2;
/// A beam ends where not even a proof that was to reach this many of its radii gets it on.
const LEAST_TRIED: f64 = 2.0;
/// Share of the beam's range that the first proof is to reach.
const FIRST: f64 = 0.25;

/// The plan of the beams of a plan's rays: the same, with balls where proofs are of segments. `None` where estimates hold
/// along their ray alone, or where no step may be as long as they are.
pub fn beam_plan(plan: &Plan) -> Option<Plan> {
    if plan.most_step.is_finite() {
        return None;
    }
    let mut plan = plan.clone();
    for choice in &mut plan.choices {
        choice.method = match choice.method {
            Method::Directional | Method::DeltaRay => return None,
            Method::Certified => Method::CertifiedBall,
            method => method,
        };
    }
    Some(plan)
}

/// The march of beams. Its rays are [`compose_beam`](crate::shade::compose_beam)'s; it gives `t` (as `w`): all of the beam is empty
/// up to there, and the status says whether it left the bounding sphere.
pub fn compose_beam_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    March {
        estimator,
        locate: compose_locate(arena, settings),
        advance: compose_advance(arena, settings),
        max_march_steps: settings.max_march_steps,
    }
}

/// The spread of a beam: one through the length of its direction.
fn spread<'g>(now: &Moment<'g>) -> Expr<'g> {
    1.0 / now.ray.direction.length()
}

/// The hit threshold of the rays at the beam's end.
fn hit_eps<'g>(now: &Moment<'g>, settings: &MarchSettings) -> Expr<'g> {
    now.state.t / spread(now) * settings.pixel_radius + settings.hit_eps
}

fn compose_locate(arena: &Arena, settings: &MarchSettings) -> Function {
    let (now, mut function) = Moment::locate(arena);
    let p = now.point(now.state.t);
    let spread = spread(&now);
    let h = match settings.certified {
        true => proposal(&now),
        false => now.difference(settings, p),
    };
    Query { p, d: now.ray.direction * spread, h, hit_eps: hit_eps(&now, settings) }.write(&mut function);
    function
}

/// How far the next proof is to reach.
fn proposal<'g>(now: &Moment<'g>) -> Expr<'g> {
    let Moment { ray, state } = now;
    let is_first = is_unknown(state.last_de);
    let first = (ray.t_far - ray.t_near) / spread(now) * FIRST;
    is_first.select(first, state.last_de * PROPOSAL).max(state.t * PROPOSAL)
}

fn compose_advance(arena: &Arena, settings: &MarchSettings) -> Function {
    let (now, Answer { de, inside }, mut function) = Moment::advance(arena);
    let Moment { ray, state } = &now;
    let zero = arena.f(0.0);
    let usable = inside.select(zero, zero.le(de).select(de, zero));
    let certain = if settings.certified { 1.0 } else { settings.fudge * CAUTION };
    let (w, spread) = (state.t, spread(&now));
    // Rays that stop at a threshold stop in front of what is empty.
    let free = match settings.stops_at_threshold {
        true => (usable - hit_eps(&now, settings)).max(zero),
        false => usable,
    };
    let ball = free * certain;
    let half = w * spread * 0.5;
    let room = (ball * ball - w * w + half * half).max(zero).sqrt() - half;
    // Nothing at all is gained where the ball does not even hold the disc.
    let gained = w.lt(ball).select(room.max(zero), zero) * spread;
    let forward = w + gained;
    let miss = ray.t_far.le(forward);
    let mut useless = gained.le(w * spread * USEFUL).or(forward.le(w));
    let mut last_de = usable;
    if settings.certified {
        // A proof that was to reach too far may prove little: it is tried again for less before the beam ends.
        let tried = proposal(&now);
        useless = useless.and(tried.le(w * LEAST_TRIED));
        last_de = last_de.max(tried * LESS);
    }
    let code = |status: Status| arena.f(status.code());
    let status = miss.select(code(Status::Miss), useless.select(code(Status::Hit), state.status));
    // Where estimates are too long a beam may end up inside the set; its rays start where it was outside, so that they
    // come to the surface from there.
    let next = MarchState {
        t: inside.select(state.t_front, forward),
        t_front: w,
        t_outside: w,
        t_inside: arena.f(UNKNOWN),
        last_de,
        status: inside.select(code(Status::Hit), status),
    };
    next.write(&mut function);
    function
}
