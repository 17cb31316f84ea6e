//! The march of rays towards lights, which only need to know whether they hit, or how much of the light they miss.
//!
//! It does not bisect, its walk is as coarse as the default even where primary rays need a finer one, its threshold is twice
//! theirs, and it ends where the set is near enough to hide a good part of the sun's disc, which a point at
//! distance s from the ray's start is where it is nearer to the ray than the disc's radius there.

use super::{MarchSettings, Moment, compose_march, set_status, state_of, stop_at_crossing};
use crate::compose::Plan;
use crate::expr::{Arena, Expr};
use crate::graph::{LEAST_STEP, Light, LightKind, Method};
use crate::kernel::records::{Answer, MarchState, Marched, is_known};
use crate::kernel::{Estimator, March, Status};

/// Shortest step of a walk where estimates are proofs.
const LEAST_STEP_OF_PROOFS: f64 = 1.0 / 16.0;
/// What the shadows of a picture of proofs are estimated by: the first that applies.
const INSTEAD_OF_PROOFS: [Method; 3] = [Method::Combined, Method::Gradient, Method::Scalar];
/// Step multiplier of those estimates.
const FUDGE_INSTEAD_OF_PROOFS: f64 = 0.35;
/// Step multiplier below which an estimate says where to look next, and not how far the surface is.
const LEAST_TRUSTED: f64 = 0.2;
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

/// Whether the march of a plan's shadow rays can tell how near they come to what hides a light: estimates that have to be multiplied by less
/// than 0.2 do not fall to 0 at the surface, and proofs tell nothing but empty stretches.
pub fn tells_nearness(plan: &Plan) -> bool {
    let plan = shadow_plan(plan);
    plan.fudge >= LEAST_TRUSTED && !plan.choices.iter().any(|choice| choice.method.is_certified())
}

/// The march of shadow rays. The status says whether they hit; of the other columns only the counts and, of lights with soft edges,
/// what [`share_lit`] reads mean anything.
pub fn compose_shadow_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings, disc: Disc) -> March {
    let relaxation = if settings.relaxation > 1.0 { MOST } else { 1.0 };
    let shortest = if settings.certified { LEAST_STEP_OF_PROOFS } else { LEAST_STEP };
    let least_step = settings.least_step.max(shortest);
    let pixel_radius = settings.pixel_radius * COARSER;
    let hit_eps = settings.hit_eps * COARSER;
    let most_step = settings.most_step * LONGER;
    let coarse = MarchSettings { least_step, most_step, pixel_radius, hit_eps, relaxation, ..*settings };
    if disc.is_soft() {
        return compose_soft_march(arena, estimator, &coarse, disc);
    }
    let mut march = stop_at_crossing(arena, &compose_march(arena, estimator, &coarse));
    // Where proofs are short, nothing needs be near.
    let Disc::Sharp(radius) = disc else { return march };
    if settings.certified || radius == 0.0 {
        return march;
    }
    let (Moment { ray, state }, Answer { de, .. }, _) = Moment::advance(arena);
    let hidden = arena.f(0.0).le(de).and((de * settings.fudge).lt((state.t - ray.t_near) * radius));
    let other = state_of(arena, &march.advance).status;
    set_status(&mut march.advance, hidden.select(arena.f(Status::Hit.code()), other));
    march
}

/// How wide a light is as seen from a shadow ray.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Disc {
    /// It has sharp shadows: what hides a good part of a disc of this radius at distance 1 hides all of it.
    Sharp(f64),
    /// Its shadows have soft edges: the radius of its disc at distance 1.
    Angle(f64),
    /// The same of a ball of this radius at the end of the ray.
    Ball(f64),
}

/// Radius at distance 1 below which a light has sharp shadows.
const SHARP: f64 = 0.006;

impl Disc {
    /// The disc of a light.
    pub fn of(light: &Light) -> Disc {
        match light.kind {
            LightKind::Sun { angle, .. } if (angle / 2.0).tan() <= SHARP => Disc::Sharp((angle / 2.0).tan()),
            LightKind::Sun { angle, .. } => Disc::Angle((angle / 2.0).tan()),
            LightKind::Lamp { radius: 0.0, .. } => Disc::Sharp(0.0),
            LightKind::Lamp { radius, .. } => Disc::Ball(radius),
        }
    }

    /// Whether a march gives shares instead of hits.
    pub fn is_soft(self) -> bool {
        !matches!(self, Disc::Sharp(_))
    }
}

/// Whether a march hit.
pub fn is_hit_of(march: Marched<Expr<'_>>) -> Expr<'_> {
    march.status.equals(march.status.lift(Status::Hit.code()))
}

/// Share of a light that a shadow ray's start sees, from 0 to 1.
pub fn share_lit<'g>(shadow: Marched<Expr<'g>>, light: &Light) -> Expr<'g> {
    let (zero, one) = (shadow.t.lift(0.0), shadow.t.lift(1.0));
    let is_hit = is_hit_of(shadow);
    if !Disc::of(light).is_soft() {
        return is_hit.select(zero, one);
    }
    let nearest = is_known(shadow.t_outside).select(shadow.t_outside, one);
    is_hit.select(zero, nearest.smoothstep(zero, one))
}

/// The march of shadow rays towards lights with soft edges: `t_outside` keeps how near the set came to the ray, as a share of the light's
/// disc there (Quilez, 2010). It is over where the share is next to nothing.
fn compose_soft_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings, disc: Disc) -> March {
    let mut march = compose_march(arena, estimator, settings);
    let (now, Answer { de, inside }, mut function) = Moment::advance(arena);
    let Moment { ray, state } = &now;
    let (zero, one) = (arena.f(0.0), arena.f(1.0));
    let usable = zero.le(de).select(de, zero);
    let walk = now.hit_eps(settings) * settings.least_step;
    let step = (usable * settings.fudge).max(walk);
    let far = (state.t - ray.t_near) + walk;
    let width = match disc {
        Disc::Angle(radius) | Disc::Sharp(radius) => far * radius,
        Disc::Ball(radius) => far * radius / (ray.t_far - ray.t_near).max(walk),
    };
    // How near it is, whatever steps are multiplied by.
    let share = (usable / width.max(walk * 0.25)).min(one);
    let least = is_known(state.t_outside).select(state.t_outside.min(share), share);
    let hidden = inside.or(least.lt(arena.f(HIDDEN)));
    let next = state.t + now.longest_step(settings).map_or(step, |longest| step.min(longest));
    let forward = next.le(state.t).select(state.t + super::least_gap(&now, settings), next);
    let over = ray.t_far.le(forward);
    let code = |status: Status| arena.f(status.code());
    let status = hidden.select(code(Status::Hit), over.select(code(Status::Miss), arena.f(Status::RUNNING)));
    let after = MarchState { t: forward.min(ray.t_far), t_outside: least, last_de: usable, status, ..*state };
    after.write(&mut function);
    march.advance = function;
    march
}

/// Share of a light's disc that is nothing.
const HIDDEN: f64 = 0.02;
