//! Rays that leave surfaces: towards lights, and along the normal.

use super::colour::facing_normal;
use super::{Incoming, Seen, Threshold, range_within, read_surface};
use crate::compose::Bounds;
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::{Light, Look};
use crate::kernel::records::{Ray, Surface};

/// Rays towards a light, from hits as a look shows them. Their parameter starts at the hit's own, so that thresholds stay those of the pixel, and `skipped` hit
/// thresholds further on: what is nearer than a footprint or two is part of the surface that the pixel shows. They end at the light, or
/// where they leave the bounds.
pub fn compose_shadow_ray(
    arena: &Arena,
    (light, look): (&Light, &Look),
    threshold: Threshold,
    bounds: &Bounds,
    skipped: f64,
) -> Function {
    let mut inputs = Inputs::new(arena);
    let seen = Seen::read(&mut inputs);
    let (Surface { gradient: normal, .. }, _) = read_surface(&mut inputs, look);
    let mut function = inputs.function("shadow_ray");
    let (ray, t) = (seen.ray, seen.march.t);
    let hit_eps = threshold.at(t);
    let start = ray.origin + ray.direction * seen.front(hit_eps) + normal * (hit_eps * 2.0);
    let Incoming { direction, distance, .. } = Incoming::new(arena, light, start);
    let (_, far) = range_within(bounds, start, direction, arena.f(0.0));
    let far = distance.map_or(far, |distance| far.min(distance));
    let lit = arena.f(0.0).lt(normal.dot(direction));
    let wanted = seen.is_hit().and(lit).and(arena.f(0.0).lt(far));
    let shadow = Ray {
        origin: start - direction * t,
        direction,
        t_near: t + hit_eps * skipped,
        t_far: wanted.select(t + far, arena.f(Ray::NOWHERE)),
    };
    shadow.write(&mut function);
    function
}

/// Rays from hits along the normal, whose parameter is the height above the surface: from `least` of `reach` on.
///
/// `reach` is the greatest height in world units; where it is not given it is a share of the hit's depth, and no more than a share of
/// the bounding radius, so that corners are as dark in a close-up as from afar.
pub fn compose_corner_ray(
    arena: &Arena,
    look: &Look,
    threshold: Threshold,
    bounding_radius: f64,
    (reach, least): (Option<f64>, f64),
) -> Function {
    let mut inputs = Inputs::new(arena);
    let seen = Seen::read(&mut inputs);
    let (Surface { gradient: normal, .. }, _) = read_surface(&mut inputs, look);
    let mut function = inputs.function("corner_ray");
    let (ray, t) = (seen.ray, seen.march.t);
    let hit_eps = threshold.at(t);
    // In front of the hit by as much whatever the ray was marched by.
    let origin = ray.origin + ray.direction * (t - hit_eps * BEFORE);
    let height: Expr = match reach {
        Some(reach) => arena.f(reach),
        None => (t * SHARE_OF_DEPTH).min(arena.f(bounding_radius * SHARE_OF_BOUNDS)),
    };
    let direction = facing_normal(normal, ray.direction);
    let t_far = seen.is_hit().select(height, arena.f(Ray::NOWHERE));
    Ray { origin, direction, t_near: (height * least).max(hit_eps * 2.0), t_far }.write(&mut function);
    function
}

/// Hit thresholds in front of a hit from which heights are measured.
const BEFORE: f64 = 1.5;
/// The greatest height above a surface at which corners are looked for: shares of the depth and of the bounding radius.
const SHARE_OF_DEPTH: f64 = 0.12;
const SHARE_OF_BOUNDS: f64 = 0.25;
