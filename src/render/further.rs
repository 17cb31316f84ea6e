//! The passes of further rays than the picture's own: towards lights, along normals, and once more past what they miss.

use super::RenderSettings;
use super::passes::{Passes, Role, Slot};
use crate::compose::matter::may_transmit;
use crate::compose::{Bounds, Composer, Plan, Purpose, compose_estimator};
use crate::diag::Diagnostic;
use crate::graph::{Camera, Light};
use crate::kernel::Kernel;
use crate::march::{self, Disc, MarchSettings, SKIPPED, compose_march};
use crate::shade::{self, Lighting, Mirrors, Paths};

/// What further rays are composed from.
pub(super) struct Further<'a> {
    pub composer: &'a Composer<'a>,
    pub plan: &'a Plan,
    pub settings: &'a RenderSettings,
    pub camera: &'a Camera,
    pub bounds: &'a Bounds,
    /// How the picture's own rays are marched.
    pub march: &'a MarchSettings,
}

/// What seen surfaces are read from.
const SEEN: [Slot; 3] = [Slot::Rays, Slot::Ends, Slot::Surfaces];

impl Further<'_> {
    /// Adds the passes that a picture's light needs. Gives their slots, in the order in which colours read them.
    pub fn compose(&self, passes: &mut Passes<Kernel>, lighting: &Lighting) -> Result<Vec<Slot>, Diagnostic> {
        let mut slots = Vec::new();
        for (number, light) in lighting.shadowing() {
            self.shadow(passes, number, light)?;
            slots.push(Slot::Shadows(number));
        }
        if lighting.occlusion > 0.0 {
            self.corners(passes, lighting)?;
            slots.push(Slot::Corners);
        }
        if lighting.atmosphere.glow.is_some() {
            self.passing(passes)?;
            slots.push(Slot::Passing);
        }
        Ok(slots)
    }

    /// Adds the passes of mirrored rays; `seen` is what colours of surfaces are read from.
    pub fn mirrors(&self, passes: &mut Passes<Kernel>, lighting: &Lighting, seen: &[Slot]) {
        let (arena, look) = (self.composer.arena, &self.composer.graph.scene.look);
        let mirrors = Mirrors { look, lighting, threshold: self.march.threshold(), bounds: self.bounds };
        // Where a step has no state to go on from, it is the first.
        let mut met: Vec<Slot> = seen.iter().copied().filter(|slot| *slot != Slot::Passing).collect();
        let corners = met.iter().copied().filter(|slot| *slot == Slot::Corners);
        let first = SEEN.into_iter().chain(corners).chain([Slot::Colours]).collect::<Vec<_>>();
        met.push(Slot::Mirrors);
        passes.push(Role::MirrorStep, met, Slot::MirrorsAfter, Kernel::Map(mirrors.compose_step(arena)));
        passes.push(Role::MirrorStart, first, Slot::MirrorsAfter, Kernel::Map(mirrors.compose_start(arena)));
        let ray = SEEN.into_iter().chain([Slot::MirrorsAfter]).collect::<Vec<_>>();
        passes.push(Role::MirrorRay, ray, Slot::NextRays, Kernel::Map(mirrors.compose_ray(arena, SKIPPED)));
        passes.push(Role::MirrorEnd, [Slot::MirrorsAfter], Slot::Colours, Kernel::Map(mirrors.compose_end(arena)));
    }

    /// Adds the passes of a path's point: light that is picked there, the ray on which it goes on, its next state.
    pub fn path(&self, passes: &mut Passes<Kernel>, lighting: &Lighting) -> Result<(), Diagnostic> {
        let composer = self.composer;
        let (arena, look) = (composer.arena, &composer.graph.scene.look);
        let paths = Paths { look, lighting, threshold: self.march.threshold(), bounds: self.bounds, sure_bounces: 3 };
        let point = [Slot::Rays, Slot::Ends, Slot::Surfaces, Slot::Paths, Slot::Randoms];
        if may_transmit(look) {
            let ray = Kernel::Map(shade::compose_inner_ray(arena));
            passes.push(Role::InnerRay, [Slot::Rays, Slot::Paths], Slot::InnerRays, ray);
            let plan = march::shadow_plan(self.plan);
            let estimator = compose_estimator(composer, &plan.choices, Purpose::Estimate)?;
            let inner = march::compose_inner_march(arena, estimator, &self.march_of(&plan));
            passes.push(Role::InnerMarch, [Slot::InnerRays], Slot::InnerEnds, Kernel::March(inner));
            let ends = [Slot::Ends, Slot::InnerEnds, Slot::Paths];
            passes.push(Role::JoinEnds, ends, Slot::JoinedEnds, Kernel::Map(shade::compose_join_ends(arena)));
        }
        let mut seen = point.to_vec();
        if lighting.picked() > 0 {
            let ray = paths.compose_light_ray(arena, SKIPPED);
            passes.push(Role::LightRay, point, Slot::LightRays, Kernel::Map(ray));
            let plan = march::shadow_plan(self.plan);
            let march = self.march_of(&plan);
            let estimator = compose_estimator(composer, &plan.choices, Purpose::March)?;
            let march = march::compose_shadow_march(arena, estimator, &march, Disc::Sharp(0.0));
            passes.push(Role::LightMarch, [Slot::LightRays], Slot::Lit, Kernel::March(march));
            seen.push(Slot::Lit);
        }
        if lighting.atmosphere.glow.is_some() {
            self.passing(passes)?;
            seen.push(Slot::Passing);
        }
        passes.push(Role::BounceRay, point, Slot::NextRays, Kernel::Map(paths.compose_bounce_ray(arena, SKIPPED)));
        passes.push(Role::PathStep, seen, Slot::NextPaths, Kernel::Map(paths.compose_path(arena)));
        Ok(())
    }

    /// A march of the picture's rays that looks how closely they pass.
    fn passing(&self, passes: &mut Passes<Kernel>) -> Result<(), Diagnostic> {
        // Proofs do not say how far the set is.
        let plan = march::shadow_plan(self.plan);
        let estimator = compose_estimator(self.composer, &plan.choices, Purpose::March)?;
        let passing = march::compose_passing_march(self.composer.arena, estimator, &self.march_of(&plan));
        passes.push(Role::PassingMarch, [Slot::Rays], Slot::Passing, Kernel::March(passing));
        Ok(())
    }

    /// The march of a plan's estimates with the picture's pixels.
    fn march_of(&self, plan: &Plan) -> MarchSettings {
        let pixel = shade::threshold(self.camera, self.settings.size).times(self.settings.detail);
        MarchSettings::of_plan(plan, pixel, self.settings.precision)
    }

    /// Rays towards a light from what is seen, and their march.
    fn shadow(&self, passes: &mut Passes<Kernel>, number: u8, light: &Light) -> Result<(), Diagnostic> {
        let (composer, settings) = (self.composer, self.settings);
        let (arena, look) = (composer.arena, &composer.graph.scene.look);
        let skipped = if settings.plain { 0.0 } else { SKIPPED };
        let ray = shade::compose_shadow_ray(arena, (light, look), self.march.threshold(), self.bounds, skipped);
        passes.push(Role::ShadowRay(number), SEEN, Slot::ShadowRays(number), Kernel::Map(ray));
        let disc = Disc::of(light);
        let shadow = match settings.plain && matches!(disc, Disc::Sharp(_)) {
            true => {
                compose_march(arena, compose_estimator(composer, &self.plan.choices, Purpose::Estimate)?, self.march)
            }
            false => {
                let plan = march::shadow_plan(self.plan);
                let march = self.march_of(&plan);
                let estimator = compose_estimator(composer, &plan.choices, Purpose::March)?;
                march::compose_shadow_march(arena, estimator, &march, disc)
            }
        };
        passes.push(
            Role::ShadowMarch(number),
            [Slot::ShadowRays(number)],
            Slot::Shadows(number),
            Kernel::March(shadow),
        );
        Ok(())
    }

    /// Rays along normals, and what they find near.
    fn corners(&self, passes: &mut Passes<Kernel>, lighting: &Lighting) -> Result<(), Diagnostic> {
        let composer = self.composer;
        let (arena, look) = (composer.arena, &composer.graph.scene.look);
        let plan = march::corner_plan(self.plan);
        let reach = (look.occlusion_radius, march::LEAST_HEIGHT);
        let ray = shade::compose_corner_ray(arena, look, self.march.threshold(), lighting.bounding_radius, reach);
        passes.push(Role::CornerRay, SEEN, Slot::CornerRays, Kernel::Map(ray));
        let march = self.march_of(&plan);
        let estimator = compose_estimator(composer, &plan.choices, Purpose::Estimate)?;
        let corner = march::compose_corner_march(arena, estimator, &march);
        passes.push(Role::CornerMarch, [Slot::CornerRays], Slot::Corners, Kernel::March(corner));
        Ok(())
    }
}
