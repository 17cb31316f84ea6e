//! Light and colour of a pixel.

use super::{CameraFrame, Seen, is_hit, read_surface};
use crate::compose::paint::{paint, usable_trap};
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::Look;
use crate::kernel::records::{Colour, Marched, Painted};

/// Steps of a march of proofs that count in full for occlusion; of more, only the logarithm does.
const PLAIN_STEPS: f64 = 12.0;

/// Ray, march, surface and (where shadows are on) shadow march to radiance: linear and without an upper end. The look's
/// background is radiance here. Marches of proofs walk on in small steps where nothing is proven, and `by_proof` keeps those
/// from darkening the picture.
pub fn compose_colour(
    arena: &Arena,
    look: &Look,
    frame: &CameraFrame,
    bounding_radius: f64,
    by_proof: bool,
) -> Function {
    let mut inputs = Inputs::new(arena);
    let mut seen = Seen::read(&mut inputs);
    let (surface, painted) = read_surface(&mut inputs, look);
    let shadow = look.shadows.then(|| Marched::read_as("shadow_", &mut inputs));
    let mut function = inputs.function("colour");
    if by_proof {
        seen.march.steps = (seen.march.steps * (1.0 / PLAIN_STEPS) + 1.0).ln() * PLAIN_STEPS;
    }
    let trap = usable_trap(surface.trap);
    let normal = facing_normal(surface.gradient, seen.ray.direction);
    let lit = shadow.map(|shadow| is_hit(shadow).select(arena.f(0.0), arena.f(1.0)));
    let albedo = match painted {
        None => paint(look, &look.palette, trap, None),
        Some(Painted { albedo }) => albedo,
    };
    let light = lighting(arena, look, frame, &seen, normal, trap, lit);
    let background = background(arena, look, frame, seen.ray.direction);
    let mut surface = albedo * light;
    if look.fog > 0.0 {
        let kept = (seen.march.t * (-look.fog / bounding_radius)).exp();
        surface = background.mix(surface, kept);
    }
    Colour { colour: seen.is_hit().select(surface, background) }.write(&mut function);
    function
}

/// The gradient, turned towards the viewer; one that is 0, not a number or infinite becomes the view direction.
fn facing_normal<'g>(gradient: Expr<'g>, direction: Expr<'g>) -> Expr<'g> {
    let arena = gradient.arena;
    // Of length 1 where it is anything; beyond, derivatives have overflowed.
    let size_sq = gradient.dot(gradient);
    let usable = arena.f(1e-12).lt(size_sq).and(size_sq.lt(arena.f(4.0)));
    let normal = usable.select(gradient, -direction);
    let away = normal.dot(direction);
    let turned = normal - direction * (away.max(arena.f(0.0)) * 1.2);
    turned.normalize()
}

/// Light that reaches the surface: sun, sky and a little bounced from below.
fn lighting<'g>(
    arena: &'g Arena,
    look: &Look,
    frame: &CameraFrame,
    seen: &Seen<'g>,
    normal: Expr<'g>,
    trap: Expr<'g>,
    lit: Option<Expr<'g>>,
) -> Expr<'g> {
    let zero = arena.f(0.0);
    let sun_direction = arena.v3(sun_direction(look, frame));
    let facing = normal.dot(sun_direction).max(zero);
    let half = (sun_direction - seen.ray.direction).normalize();
    let gloss = normal.dot(half).max(zero).powi(16) * 0.25;
    let direct = lit.map_or(facing, |lit| facing * lit);
    let sun = arena.v3(look.sun) * (direct * (gloss + 1.0));
    let occlusion = occlusion(arena, look, seen.march.steps, trap);
    let up = normal.dot(arena.v3(frame.up)) * 0.5 + 0.5;
    let sky = arena.v3(look.sky) * ((up * 0.8 + 0.2) * occlusion);
    let bounce = arena.v3(look.sun) * ((1.0 - up) * occlusion * 0.06);
    sun * (occlusion * 0.5 + 0.5) + sky + bounce
}

/// How much of the sky a point sees, from what the march already knows: many steps mean narrow places, and an orbit
/// that came near the origin means a deep one.
fn occlusion<'g>(arena: &'g Arena, look: &Look, steps: Expr<'g>, trap: Expr<'g>) -> Expr<'g> {
    if look.occlusion == 0.0 {
        return arena.f(1.0);
    }
    let by_steps = 1.0 / (steps * steps * (1.0 / 2400.0) + 1.0);
    let seen = match look.darkens_by_trap() {
        true => by_steps * (1.0 - (trap.component(0) * -6.0).exp() * 0.6),
        false => by_steps,
    };
    arena.f(1.0).mix(seen, arena.f(look.occlusion))
}

/// Direction towards the sun in world coordinates.
pub(crate) fn sun_direction(look: &Look, frame: &CameraFrame) -> [f64; 3] {
    let [right, up, back] = look.sun_direction;
    let v = [0, 1, 2].map(|i| frame.right[i] * right + frame.up[i] * up - frame.forward[i] * back);
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

/// What is seen in a direction where nothing is: radiance.
pub(super) fn background<'g>(arena: &'g Arena, look: &Look, frame: &CameraFrame, direction: Expr<'g>) -> Expr<'g> {
    let height = (direction.dot(arena.v3(frame.up)) * 1.6 + 0.5).clamp(arena.f(0.0), arena.f(1.0));
    arena.v3(look.background[0]).mix(arena.v3(look.background[1]), height)
}
