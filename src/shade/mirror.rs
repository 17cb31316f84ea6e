//! What smooth surfaces mirror, without chance: the rays that they mirror, and what is seen along them.
//!
//! A picture without mirrors shows the surroundings in smooth surfaces. Where a mirrored ray meets a surface, the light of that surface
//! takes the place of the surroundings behind it; where it meets none, nothing changes.

use super::colour::{Face, Others, read_openness, reflected};
use super::finish::{BLURRED, Finish};
use super::path::brightest;
use super::{Air, Lighting, Seen, Threshold, range_within};
use crate::compose::Bounds;
use crate::compose::matter::may_mirror;
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::Look;
use crate::kernel::records::{Colour, Mirrored, Ray};

/// What mirrored rays are composed from.
pub struct Mirrors<'a> {
    /// The look of surfaces.
    pub look: &'a Look,
    /// The light.
    pub lighting: &'a Lighting,
    /// Hit thresholds of the picture's rays.
    pub threshold: Threshold,
    /// What rays are cut to.
    pub bounds: &'a Bounds,
}

/// Share of a mirrored surface's light that is not worth a ray.
const LEAST_SHARE: f64 = 0.01;

impl Mirrors<'_> {
    /// Whether a look has surfaces that mirror.
    pub fn are_in(look: &Look) -> bool {
        may_mirror(look, BLURRED)
    }

    /// What is seen directly, corners where they are darkened, and colours to what is shown before the first mirrored ray.
    pub fn compose_start(&self, arena: &Arena) -> Function {
        let mut inputs = Inputs::new(arena);
        let seen = Seen::read(&mut inputs);
        let face = Face::read(self.look, &mut inputs);
        let open = read_openness(&mut inputs, self.lighting);
        let Colour { colour } = Colour::read_as("shown_", &mut inputs);
        let mut function = inputs.function("mirror_start");
        let air = Air { arena, lighting: self.lighting, seen: &seen, passing: None };
        let before = arena.v3([1.0; 3]) * air.share_kept();
        self.onwards(&seen, &face.finish(&seen), open, (before, colour)).write(&mut function);
        function
    }

    /// What is seen, and what is shown so far, to the rays that are mirrored; empty ones where none is worth it.
    pub fn compose_ray(&self, arena: &Arena, skipped: f64) -> Function {
        let mut inputs = Inputs::new(arena);
        let seen = Seen::read(&mut inputs);
        let face = Face::read(self.look, &mut inputs);
        let shown = Mirrored::read_as("shown_", &mut inputs);
        let mut function = inputs.function("mirror_ray");
        let finish = face.finish(&seen);
        let (direction, t) = (finish.reflected().normalize(), seen.march.t);
        let hit_eps = self.threshold.at(t);
        let start = seen.ray.origin + seen.ray.direction * seen.front(hit_eps) + finish.normal * (hit_eps * 2.0);
        let (_, far) = range_within(self.bounds, start, direction, arena.f(0.0));
        let wanted = arena.f(0.0).lt(brightest(shown.throughput)).and(arena.f(0.0).lt(far));
        let ray = Ray {
            origin: start - direction * t,
            direction,
            t_near: t + hit_eps * skipped,
            t_far: wanted.select(t + far, arena.f(Ray::NOWHERE)),
        };
        ray.write(&mut function);
        function
    }

    /// What a mirrored ray meets, its shadows and corners, and what is shown before to what is shown with it.
    pub fn compose_step(&self, arena: &Arena) -> Function {
        let mut inputs = Inputs::new(arena);
        let seen = Seen::read(&mut inputs);
        let face = Face::read(self.look, &mut inputs);
        let others = Others::read(&mut inputs, self.lighting);
        let before = Mirrored::read_as("before_", &mut inputs);
        let mut function = inputs.function("mirror_step");
        let (finish, from) = (face.finish(&seen), seen.ray.t_near);
        let air = Air { arena, lighting: self.lighting, seen: &seen, passing: None };
        let surface = reflected(self.lighting, &seen, &finish, &others);
        let kept = air.kept_since(from);
        let met = kept.map_or(surface, |kept| air.fog().mix(surface, kept));
        let nothing = arena.v3([0.0; 3]);
        let change = before.throughput * met - before.counted;
        // What is not a number is nothing.
        let change = change.abs().le(arena.f(1e30)).select(change, nothing);
        let radiance = before.radiance + seen.is_hit().select(change, nothing);
        let through = kept.map_or(before.throughput, |kept| before.throughput * kept);
        let shown = (through, radiance.max(arena.f(0.0)));
        self.onwards(&seen, &finish, others.open, shown).write(&mut function);
        function
    }

    /// What is shown to colours.
    pub fn compose_end(&self, arena: &Arena) -> Function {
        let mut inputs = Inputs::new(arena);
        let shown = Mirrored::read(&mut inputs);
        let mut function = inputs.function("mirror_end");
        Colour { colour: shown.radiance }.write(&mut function);
        function
    }

    /// What is shown, and what the next mirrored ray counts, after a surface of which `before` reaches the camera.
    fn onwards<'g>(
        &self,
        seen: &Seen<'g>,
        finish: &Finish<'g>,
        open: Option<Expr<'g>>,
        (before, radiance): (Expr<'g>, Expr<'g>),
    ) -> Mirrored<Expr<'g>> {
        let arena = before.arena;
        let (weight, counted) = finish.mirror(|towards, roughness| self.lighting.mirrored(arena, towards, roughness));
        let before = open.map_or(before, |open| before * open);
        let throughput = before * weight;
        let goes_on = seen.is_hit().and(arena.f(LEAST_SHARE).lt(brightest(throughput)));
        let nothing = arena.v3([0.0; 3]);
        Mirrored {
            throughput: goes_on.select(throughput, nothing),
            counted: goes_on.select(before * counted, nothing),
            radiance,
        }
    }
}
