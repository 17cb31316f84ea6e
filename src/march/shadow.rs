//! The march of rays towards the sun, which only need to know whether they hit.
//!
//! It does not bisect, its walk is as coarse as the default even where primary rays need a finer one, its threshold is twice
//! theirs, and it ends where the set is near enough to hide a good part of the sun's disc, which a point at
//! distance s from the ray's start is where it is nearer to the ray than the disc's radius there.

use super::{MarchSettings, Moment, compose_march, set_status, state_of, stop_at_crossing};
use crate::compose::Plan;
use crate::expr::Arena;
use crate::graph::{LEAST_STEP, Method};
use crate::kernel::records::Answer;
use crate::kernel::{Estimator, March, Status};

/// Radius of the sun's disc at distance 1.
const SUN_RADIUS: f64 = 0.0047;

/// Shortest step of a walk where estimates are proofs.
const LEAST_STEP_OF_PROOFS: f64 = 1.0 / 16.0;
/// What the shadows of a picture of proofs are estimated by: the first that applies.
const INSTEAD_OF_PROOFS: [Method; 3] = [Method::Combined, Method::Gradient, Method::Scalar];
/// Step multiplier of those estimates.
const FUDGE_INSTEAD_OF_PROOFS: f64 = 0.35;
/// Balls that a step is long at most: these rays leave a surface, and estimates grow along them.
const MOST: f64 = 3.0;
/// Hit thresholds of primary rays that one of theirs is as large as: half a pixel of shadow is not seen.
const COARSER: f64 = 2.0;
/// Times the longest step of primary rays that theirs may be.
const LONGER: f64 = 4.0;
/// Hit thresholds in front of its start that such a ray has no need to look at.
pub const SKIPPED: f64 = 4.0;

/// The plan of the shadow rays of a plan's rays: what is seen is proven, what shades it is estimated, because a missing hair
/// does not show at a shadow's edge. Proofs along shadow rays took up to a third of a picture's time.
pub fn shadow_plan(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    if !plan.is_certified() {
        return plan;
    }
    for choice in &mut plan.choices {
        let instead = INSTEAD_OF_PROOFS.into_iter().find(|method| choice.applicable.contains(method));
        choice.method = instead.unwrap_or(choice.method);
    }
    if !plan.choices.iter().any(|choice| choice.method.is_certified()) {
        (plan.fudge, plan.least_step) = (FUDGE_INSTEAD_OF_PROOFS, LEAST_STEP);
    }
    plan
}

/// The march of shadow rays. The status says whether they hit; of the other columns only the counts mean anything.
pub fn compose_shadow_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    let relaxation = if settings.relaxation > 1.0 { MOST } else { 1.0 };
    let shortest = if settings.certified { LEAST_STEP_OF_PROOFS } else { LEAST_STEP };
    let least_step = settings.least_step.max(shortest);
    let pixel_radius = settings.pixel_radius * COARSER;
    let hit_eps = settings.hit_eps * COARSER;
    let most_step = settings.most_step * LONGER;
    let coarse = MarchSettings { least_step, most_step, pixel_radius, hit_eps, relaxation, ..*settings };
    let mut march = stop_at_crossing(arena, &compose_march(arena, estimator, &coarse));
    // Where proofs are short, nothing needs be near.
    if settings.certified {
        return march;
    }
    let (Moment { ray, state }, Answer { de, .. }, _) = Moment::advance(arena);
    let hidden = arena.f(0.0).le(de).and((de * settings.fudge).lt((state.t - ray.t_near) * SUN_RADIUS));
    let other = state_of(arena, &march.advance).status;
    set_status(&mut march.advance, hidden.select(arena.f(Status::Hit.code()), other));
    march
}
