//! Beams: cones around a central ray that hold the rays of many pixels, marched once for all of them.
//!
//! A beam's rays start in one point. Its central ray runs by a parameter `w` that is the beam's radius: its direction is as
//! long as the beam is narrow, so that the point of every ray at the same distance from the origin lies within `w` of the
//! central one. With spread k (the most that a ray's unit direction differs from the central one, in length) that distance is
//! t = w / k. An estimate D at `w` proves, or makes likely, that all of the beam up to t + s is empty, where
//! s^2 + s w k + w^2 = D^2. Where s is a small share of w the beam ends; its rays start there. Rays of a beam that left
//! the bounding sphere have missed without an estimate of their own.

use super::{Inputs, MarchSettings, ports};
use crate::compose::Plan;
use crate::expr::{Arena, Expr, Function, Port, Type};
use crate::graph::Method;
use crate::kernel::{Estimator, March, Status, march_state_ports};

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
fn spread<'g>(ray: &Inputs<'g>) -> Expr<'g> {
    1.0 / ray.direction.length()
}

/// The hit threshold of the rays at the beam's end.
fn hit_eps<'g>(ray: &Inputs<'g>, settings: &MarchSettings) -> Expr<'g> {
    ray.t / spread(ray) * settings.pixel_radius + settings.hit_eps
}

fn compose_locate(arena: &Arena, settings: &MarchSettings) -> Function {
    let mut function = Function::new("locate", ports());
    let ray = Inputs::new(arena);
    let p = ray.origin + ray.direction * ray.t;
    let spread = spread(&ray);
    let h = match settings.certified {
        true => proposal(&ray),
        false => ray.difference(settings, p),
    };
    function.output("p", p);
    function.output("d", ray.direction * spread);
    function.output("h", h);
    function.output("hit_eps", hit_eps(&ray, settings));
    function
}

/// How far the next proof is to reach.
fn proposal<'g>(ray: &Inputs<'g>) -> Expr<'g> {
    let is_first = ray.last_de.lt(ray.t.lift(0.0));
    let first = (ray.t_far - ray.t_near) / spread(ray) * FIRST;
    is_first.select(first, ray.last_de * PROPOSAL).max(ray.t * PROPOSAL)
}

fn compose_advance(arena: &Arena, settings: &MarchSettings) -> Function {
    let mut inputs = ports();
    let first = inputs.len() as u16;
    inputs.push(Port::new("de", Type::F));
    inputs.push(Port::new("inside", Type::B));
    let mut function = Function::new("advance", inputs);
    let ray = Inputs::new(arena);
    let (de, inside) = (arena.input(first, Type::F), arena.input(first + 1, Type::B));
    let zero = arena.f(0.0);
    let usable = inside.select(zero, zero.le(de).select(de, zero));
    let certain = if settings.certified { 1.0 } else { settings.fudge * CAUTION };
    let (w, spread) = (ray.t, spread(&ray));
    // Rays that stop at a threshold stop in front of what is empty.
    let free = match settings.stops_at_threshold {
        true => (usable - hit_eps(&ray, settings)).max(zero),
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
        let tried = proposal(&ray);
        useless = useless.and(tried.le(w * LEAST_TRIED));
        last_de = last_de.max(tried * LESS);
    }
    let code = |status: Status| arena.f(status.code());
    let status = miss.select(code(Status::Miss), useless.select(code(Status::Hit), ray.status));
    // Where estimates are too long a beam may end up inside the set; its rays start where it was outside, so that they
    // come to the surface from there.
    let t = inside.select(ray.t_front, forward);
    let next = [t, w, w, arena.f(-1.0), last_de, inside.select(code(Status::Hit), status)];
    for (port, value) in march_state_ports().into_iter().zip(next) {
        function.output(port.name, value);
    }
    function
}
