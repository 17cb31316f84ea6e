//! The kernels of a picture of a plane: those of any picture, with one estimate in the place of the march.

use super::{Pipeline, RenderSettings};
use crate::compose::{Bounds, Composer, Plan, Purpose, compose_estimator};
use crate::diag::Diagnostic;
use crate::graph::Plane;
use crate::kernel::Kernel;
use crate::march::{MarchSettings, compose_still, still_plan};
use crate::shade;

/// Composes the kernels of a fractal's picture in a plane with the estimates of a plan.
pub(super) fn compose_plane(
    composer: &Composer,
    plane: &Plane,
    settings: &RenderSettings,
    plan: &Plan,
) -> Result<Pipeline, Diagnostic> {
    let (arena, look) = (composer.arena, &composer.graph.look);
    let plan = still_plan(plan);
    let pixel_radius = shade::pixel_size(plane, settings.size) / 2.0;
    let march = MarchSettings {
        hit_eps: pixel_radius,
        precision: settings.precision,
        difference_step: plan.difference_step,
        ..MarchSettings::default()
    };
    let estimator = compose_estimator(composer, &plan.choices, Purpose::Estimate)?;
    Ok(Pipeline {
        camera: shade::facing(plane),
        bounds: Bounds::ball(plan.bounding_radius),
        plane: Some(*plane),
        pixel_radius,
        camera_kernel: Kernel::Map(shade::compose_plane_camera(arena, plane, settings.size)),
        beams: None,
        march: Kernel::March(compose_still(arena, estimator, &march)),
        surface_point: Kernel::Map(shade::compose_plane_point(arena, pixel_radius, settings.precision)),
        surface: Kernel::Estimate(compose_estimator(composer, &plan.choices, Purpose::Surface)?),
        shadow_ray: None,
        shadow_march: None,
        colour: Kernel::Map(shade::compose_plane_colour(arena, look, plane, settings.size)),
        encode: Kernel::Map(shade::compose_encode(arena)),
        plan,
    })
}
