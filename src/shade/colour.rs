//! Light and colour of a pixel.

use super::finish::Finish;
use super::light::Incoming;
use super::{Air, Lighting, Seen, read_surface};
use crate::compose::paint::{paint, usable_trap};
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::Look;
use crate::kernel::records::{Colour, Marched, Matter};
use crate::march::{openness, share_lit};

/// A surface as it is looked at: where it faces, and what it is made of.
pub(super) struct Face<'g> {
    /// Gradient of the distance.
    pub gradient: Expr<'g>,
    /// What it is made of.
    pub matter: Matter<Expr<'g>>,
}

impl<'g> Face<'g> {
    /// Takes what is known of surfaces as the next inputs of a function.
    pub fn read(look: &Look, inputs: &mut Inputs<'g>) -> Face<'g> {
        let (surface, painted) = read_surface(inputs, look);
        let plain = || Matter::of_colour(paint(look, &look.paint.palette, usable_trap(surface.trap), None));
        Face { gradient: surface.gradient, matter: painted.unwrap_or_else(plain) }
    }

    /// The surface, ready to be lit, as a ray sees it.
    pub fn finish(&self, seen: &Seen<'g>) -> Finish<'g> {
        let direction = seen.ray.direction;
        // Without paths nobody knows the way inside: light takes on the colour at the surface.
        let matter = Matter { transmission_depth: direction.arena.f(0.0), ..self.matter };
        Finish::new(&matter, facing_normal(self.gradient, direction), -direction)
    }
}

/// What the colour of a pixel is made of besides its ray, its end and its surface: marches of other rays.
pub(super) struct Others<'g> {
    /// The march towards each light, where it casts shadows.
    shadows: Vec<Option<Marched<Expr<'g>>>>,
    /// How open the place is, where corners are darkened.
    pub(super) open: Option<Expr<'g>>,
}

impl<'g> Others<'g> {
    pub fn read(inputs: &mut Inputs<'g>, lighting: &Lighting) -> Others<'g> {
        let lights = (0..).zip(&lighting.lights);
        let shadows = lights.map(|(number, light): (u8, _)| {
            light.shadows.then(|| Marched::read_as(&format!("shadow_{number}_"), inputs))
        });
        let shadows = shadows.collect();
        Others { shadows, open: read_openness(inputs, lighting) }
    }
}

/// How open a place is to the surroundings, by the march along its normal, where corners are darkened.
pub(super) fn read_openness<'g>(inputs: &mut Inputs<'g>, lighting: &Lighting) -> Option<Expr<'g>> {
    let corner = (lighting.occlusion > 0.0).then(|| Marched::read_as("corner_", inputs))?;
    let arena = corner.t.arena;
    Some(arena.f(1.0).mix(openness(corner), arena.f(lighting.occlusion)))
}

/// Ray, march, surface and further marches to radiance: linear and without an upper end.
pub fn compose_colour(arena: &Arena, look: &Look, lighting: &Lighting) -> Function {
    let mut inputs = Inputs::new(arena);
    let seen = Seen::read(&mut inputs);
    let face = Face::read(look, &mut inputs);
    let others = Others::read(&mut inputs, lighting);
    let passing = lighting.atmosphere.glow.map(|_| Marched::read_as("glow_", &mut inputs));
    let mut function = inputs.function("colour");
    let shown = reflected(lighting, &seen, &face.finish(&seen), &others);
    let background = lighting.background(arena, seen.ray.direction);
    let air = Air { arena, lighting, seen: &seen, passing };
    Colour { colour: air.seen_through(shown, background) }.write(&mut function);
    function
}

/// The gradient, turned towards the viewer; one that is 0, not a number or infinite becomes the view direction.
pub(crate) fn facing_normal<'g>(gradient: Expr<'g>, direction: Expr<'g>) -> Expr<'g> {
    let arena = gradient.arena;
    // Of length 1 where it is anything; beyond, derivatives have overflowed.
    let size_sq = gradient.dot(gradient);
    let usable = arena.f(1e-12).lt(size_sq).and(size_sq.lt(arena.f(4.0)));
    let normal = usable.select(gradient, -direction);
    let away = normal.dot(direction);
    let turned = normal - direction * (away.max(arena.f(0.0)) * 1.2);
    turned.normalize()
}

/// Light that the surface sends to the viewer: of the lights, of the surroundings, and its own.
pub(super) fn reflected<'g>(
    lighting: &Lighting,
    seen: &Seen<'g>,
    finish: &Finish<'g>,
    others: &Others<'g>,
) -> Expr<'g> {
    let direction = seen.ray.direction;
    let arena = direction.arena;
    let point = seen.ray.origin + direction * seen.march.t;
    let mirrored = |towards, roughness| lighting.mirrored(arena, towards, roughness);
    let beyond = |towards| lighting.radiance(arena, towards);
    let surrounded = finish.surrounded(lighting.around(finish.normal), mirrored, beyond);
    let mut all = others.open.map_or(surrounded, |open| surrounded * open);
    for (light, shadow) in lighting.lights.iter().zip(&others.shadows) {
        let Incoming { direction, strength, .. } = Incoming::new(arena, light, point);
        let strength = shadow.map_or(strength, |shadow| strength * share_lit(shadow, light));
        all = all + finish.lit(direction) * strength;
    }
    finish.emission().map_or(all, |emission| all + emission)
}
