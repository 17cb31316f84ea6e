//! The passes of a picture of a plane: those of any picture, with one estimate instead of the march.

use super::passes::{Passes, Role, Slot};
use super::pipeline::push_data;
use super::{Pipeline, RenderSettings};
use crate::compose::{Bounds, Composer, Plan, Purpose, compose_estimator};
use crate::diag::Diagnostic;
use crate::film::{Develop, compose_develop};
use crate::graph::Plane;
use crate::kernel::Kernel;
use crate::march::{MarchSettings, Threshold, compose_still, still_plan};
use crate::shade;

/// Composes the passes of a fractal's picture in a plane with the estimates of a plan.
pub(super) fn compose_plane(
    composer: &Composer,
    plane: &Plane,
    settings: &RenderSettings,
    plan: &Plan,
) -> Result<Pipeline, Diagnostic> {
    let arena = composer.arena;
    let develop = Develop::of(&composer.graph.scene.film, Develop::PLANE);
    let plan = still_plan(plan);
    let pixel_radius = shade::pixel_size(plane, settings.size) / 2.0;
    let march = MarchSettings {
        hit_eps: pixel_radius,
        precision: settings.precision,
        difference_step: plan.difference_step,
        ..MarchSettings::default()
    };
    let estimator = compose_estimator(composer, &plan.choices, Purpose::Estimate)?;
    let mut passes = Passes::default();
    let camera = Kernel::Map(shade::compose_plane_camera(arena, plane, settings.size));
    passes.push(Role::Camera, [Slot::Points], Slot::Rays, camera);
    let march = Kernel::March(compose_still(arena, estimator, &march));
    passes.push(Role::March, [Slot::Rays], Slot::Ends, march);
    let point = Kernel::Map(shade::compose_plane_point(arena, pixel_radius, settings.precision));
    passes.push(Role::SurfacePoint, [Slot::Rays, Slot::Ends], Slot::Queries, point);
    let surface = Kernel::Estimate(compose_estimator(composer, &plan.choices, Purpose::Surface)?);
    passes.push(Role::Surface, [Slot::Queries], Slot::Surfaces, surface);
    let scene = &composer.graph.scene;
    let colour = Kernel::Map(shade::compose_plane_colour(arena, scene, plane, settings.size));
    let seen = [Slot::Rays, Slot::Ends, Slot::Surfaces];
    passes.push(Role::Colour, seen, Slot::Colours, colour);
    push_data(&mut passes, arena, &scene.look, (settings, seen.to_vec()));
    passes.push(Role::Encode, [Slot::Colours], Slot::Bytes, Kernel::Map(compose_develop(arena, develop)));
    Ok(Pipeline {
        camera: shade::facing(plane),
        bounds: Bounds::ball(plan.bounding_radius),
        plane: Some(*plane),
        pixel: Threshold { pixel_radius: 0.0, fixed: pixel_radius },
        tiles: None,
        passes,
        plan,
    })
}
