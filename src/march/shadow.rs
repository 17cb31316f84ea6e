//! The march of rays towards the sun, of which nobody asks but whether they hit.
//!
//! It does not bisect, and it ends where the set is near enough to hide a good part of the sun's disc, which a point at
//! distance s from the ray's start is where it is nearer to the ray than the disc's radius there.

use super::{Inputs, MarchSettings, compose_march, ports, stop_at_crossing};
use crate::expr::{Arena, Type};
use crate::kernel::{Estimator, March, Status};

/// Radius of the sun's disc at distance 1.
const SUN_RADIUS: f64 = 0.0047;

/// The march of shadow rays. The status says whether they hit; of the other columns only the counts mean anything.
pub fn compose_shadow_march(arena: &Arena, estimator: Estimator, settings: &MarchSettings) -> March {
    let mut march = stop_at_crossing(arena, &compose_march(arena, estimator, settings));
    // Where proofs are short, nothing needs be near.
    if settings.certified {
        return march;
    }
    let ray = Inputs::new(arena);
    let de = arena.input(ports().len() as u16, Type::F);
    let sun: f64 = std::env::var("SUN").ok().and_then(|s| s.parse().ok()).unwrap_or(SUN_RADIUS);
    let hidden = arena.f(0.0).le(de).and((de * settings.fudge).lt((ray.t - ray.t_near) * sun));
    let status = march.advance.outputs.iter().position(|(port, _)| port.name == "status").expect("a march has a status");
    let other = arena.expr(march.advance.outputs[status].1);
    march.advance.outputs[status].1 = hidden.select(arena.f(Status::Hit.code()), other).id;
    march
}
