//! The march of rays inside a set, to where they leave it: through glass.
//!
//! Of points inside nobody knows how far the surface is. So the march takes even steps, and bisects where it came out. What is thinner
//! than a step along the ray may be passed.

use super::{MarchSettings, Moment, compose_march, narrow_gap};
use crate::expr::Arena;
use crate::kernel::records::{Answer, MarchState, is_known, is_unknown};
use crate::kernel::{Estimator, March, Status};

/// Steps of a ray at most.
const STEPS: f64 = 256.0;
/// Hit thresholds that a step is long at least.
const LEAST: f64 = 4.0;
/// Hit thresholds beyond the surface at which a ray ends: there the surface can be looked at from outside.
const BEYOND: f64 = 2.0;

/// The march of rays that begin inside. A hit is where they are outside again; one that begins outside hits at once.
pub fn compose_inner_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    let mut march = compose_march(arena, estimator, settings);
    let (now, Answer { de, inside }, mut function) = Moment::advance(arena);
    let Moment { ray, state } = &now;
    let hit_eps = now.hit_eps(settings);
    let t_inside = inside.select(state.t, state.t_inside);
    let t_outside = inside.select(state.t_outside, state.t);
    let is_out = is_known(t_outside);
    let width = t_outside - t_inside;
    let hit = is_out.and(width.le(narrow_gap(&now, settings)).or(is_unknown(t_inside)));
    let step = ((ray.t_far - ray.t_near) * (1.0 / STEPS)).max(hit_eps * LEAST);
    let miss = ray.t_far.le(state.t).and(!is_out);
    let onwards = is_out.select(t_inside + width * 0.5, (state.t + step).min(ray.t_far));
    let t = hit.select(t_outside + hit_eps * BEYOND, onwards);
    let code = |status: Status| arena.f(status.code());
    let status = hit.select(code(Status::Hit), miss.select(code(Status::Miss), arena.f(Status::RUNNING)));
    MarchState { t, t_front: t, t_outside, t_inside, last_de: de, status }.write(&mut function);
    march.advance = function;
    march
}
