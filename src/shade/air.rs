//! What is between the camera and what it sees: fog and glow.

use super::{Lighting, Seen};
use crate::expr::{Arena, Expr};
use crate::graph::Glow;
use crate::kernel::records::Marched;
use crate::march::closest;

/// Length of the fog that is seen where nothing is, in bounding radii.
const BEYOND: f64 = 4.0;

/// The air along a ray.
pub(super) struct Air<'a, 'g> {
    pub arena: &'g Arena,
    pub lighting: &'a Lighting,
    pub seen: &'a Seen<'g>,
    /// The march that found how closely the ray passes the surface, where there is a glow.
    pub passing: Option<Marched<Expr<'g>>>,
}

impl<'g> Air<'_, 'g> {
    /// Whether there is nothing but light.
    pub fn is_clear(&self) -> bool {
        self.lighting.atmosphere.fog == 0.0 && self.passing.is_none()
    }

    /// The share of the surface's light that is not lost on its way.
    pub fn share_kept(&self) -> Expr<'g> {
        match self.lighting.atmosphere.fog > 0.0 {
            true => self.kept(self.seen.march.t),
            false => self.arena.f(1.0),
        }
    }

    /// What is seen through the air: the surface where the ray hits, else the background.
    pub fn seen_through(&self, surface: Expr<'g>, background: Expr<'g>) -> Expr<'g> {
        let (arena, atmosphere) = (self.arena, &self.lighting.atmosphere);
        let is_hit = self.seen.is_hit();
        let mut shown = match (atmosphere.fog > 0.0, atmosphere.fog_colour) {
            (false, _) => is_hit.select(surface, background),
            // Fog of the background's own colour does not show before it.
            (true, None) => is_hit.select(background.mix(surface, self.kept(self.seen.march.t)), background),
            (true, Some(colour)) => {
                // Where nothing is, fog goes on as far as for any ray: the ball that holds everything must not show.
                let far = arena.f(BEYOND * self.lighting.bounding_radius);
                let length = is_hit.select(self.seen.march.t, far);
                arena.v3(colour).mix(is_hit.select(surface, background), self.kept(length))
            }
        };
        if let (Some(Glow { colour, width }), Some(passing)) = (atmosphere.glow, self.passing) {
            let near = (closest(passing) * (-1.0 / width)).exp();
            shown = shown + arena.v3(colour) * is_hit.select(arena.f(0.0), near);
        }
        shown
    }

    /// The share of light that is not lost from the parameter `from` of the ray to its end, where there is fog.
    pub fn kept_since(&self, from: Expr<'g>) -> Option<Expr<'g>> {
        let one = self.arena.f(1.0);
        let share = || self.kept(self.seen.march.t) / self.kept(from).max(self.arena.f(1e-12));
        (self.lighting.atmosphere.fog > 0.0).then(|| share().min(one))
    }

    /// The light of fog along the ray.
    pub fn fog(&self) -> Expr<'g> {
        let own = self.lighting.atmosphere.fog_colour.map(|colour| self.arena.v3(colour));
        own.unwrap_or_else(|| self.lighting.radiance(self.arena, self.seen.ray.direction))
    }

    /// The share of light that is not lost over a length of the ray.
    fn kept(&self, length: Expr<'g>) -> Expr<'g> {
        let (arena, atmosphere) = (self.arena, &self.lighting.atmosphere);
        let density = atmosphere.fog / self.lighting.bounding_radius;
        let Some([base, falloff]) = atmosphere.ground else { return (length * -density).exp() };
        // The integral of a density that falls exponentially with height, along a ray whose height changes by `rise`.
        let (from, direction) = (self.seen.ray.origin.component(2), self.seen.ray.direction.component(2));
        let start = ((from - base) * (-1.0 / falloff)).min(arena.f(60.0)).exp();
        let rise = direction * length * (1.0 / falloff);
        let is_level = rise.abs().lt(arena.f(1e-3));
        let safe = is_level.select(arena.f(1.0), rise);
        let mean = is_level.select(1.0 - rise * 0.5, (1.0 - (-rise).min(arena.f(60.0)).exp()) / safe);
        (start * mean * length * -density).exp()
    }
}
