//! The kernels of a picture, composed from a fractal, its view and its plan.

use super::beams::{BeamKernels, BeamTiles};
use super::checked::box_holds;
use super::framing::camera_of;
use super::plane::compose_plane;
use super::{BeamUse, RenderSettings};
use crate::compose::{Bounds, Composer, Plan, Purpose, choose, compose_estimator};
use crate::diag::Diagnostic;
use crate::graph::{Camera, Look, Plane};
use crate::kernel::Kernel;
use crate::march::{MarchSettings, SKIPPED, compose_march, compose_shadow_march, shadow_plan};
use crate::shade::{self, CameraFrame};

/// Samples of a picture that a search for a box pays for.
const LEAST_BOXED: u64 = 1 << 20;

/// The kernels of a picture.
pub struct Pipeline {
    /// How distances are estimated, and the extent.
    pub plan: Plan,
    /// The view.
    pub camera: Camera,
    /// What rays are cut to.
    pub bounds: Bounds,
    /// The plane that is seen, by one estimate at each point; absent where rays are marched.
    pub plane: Option<Plane>,
    /// Radius of a pixel at distance 1, or in the plane.
    pub pixel_radius: f64,
    /// Pixels to rays.
    pub camera_kernel: Kernel,
    /// What finds out for many pixels at once how far nothing is; absent where every ray is marched by itself.
    pub beams: Option<BeamKernels>,
    /// Rays to hits.
    pub march: Kernel,
    /// Hits to the points where surfaces are looked at.
    pub surface_point: Kernel,
    /// Points to gradients and traps.
    pub surface: Kernel,
    /// Hits to rays towards the sun; absent without shadows.
    pub shadow_ray: Option<Kernel>,
    /// Rays towards the sun to whether they hit; absent without shadows.
    pub shadow_march: Option<Kernel>,
    /// Everything to linear colours.
    pub colour: Kernel,
    /// Linear colours to sRGB.
    pub encode: Kernel,
}

impl Pipeline {
    /// All kernels, with names, in the order in which they run.
    pub fn kernels(&self) -> Vec<(&'static str, &Kernel)> {
        let mut kernels = vec![("camera", &self.camera_kernel)];
        kernels.extend(self.beams.iter().flat_map(BeamKernels::named));
        kernels.extend([("march", &self.march), ("surface_point", &self.surface_point), ("surface", &self.surface)]);
        kernels.extend(self.shadow_ray.as_ref().map(|k| ("shadow_ray", k)));
        kernels.extend(self.shadow_march.as_ref().map(|k| ("shadow_march", k)));
        kernels.extend([("colour", &self.colour), ("encode", &self.encode)]);
        kernels
    }

    /// What else a renderer has to know.
    pub fn shape(&self) -> Shape {
        Shape { is_certified: self.plan.is_certified(), tiles: self.beams.as_ref().map(|beams| beams.tiles.clone()) }
    }
}

/// What a renderer has to know besides its kernels.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Whether marches are proofs.
    pub is_certified: bool,
    /// The tiles of beams, where there are beams.
    pub tiles: Option<BeamTiles>,
}

/// Composes the kernels of a fractal's picture.
pub fn compose_pipeline(composer: &Composer, settings: &RenderSettings) -> Result<Pipeline, Diagnostic> {
    compose_planned(composer, settings, choose(composer, &settings.estimate)?)
}

/// Composes the kernels of a fractal's picture with the estimates of a plan; `settings.estimate` is not asked.
pub fn compose_planned(composer: &Composer, settings: &RenderSettings, mut plan: Plan) -> Result<Pipeline, Diagnostic> {
    plan = plan.in_precision(settings.precision);
    if !settings.early_ends {
        plan = plan.with_late_ends();
    }
    if let Some(plane) = &composer.graph.plane {
        return compose_plane(composer, plane, settings, &plan);
    }
    let camera = camera_of(composer, &plan);
    let look: &Look = &composer.graph.look;
    let arena = composer.arena;
    let frame = CameraFrame::new(&camera);
    let pixel_radius = shade::pixel_radius(&camera, settings.size);
    let mut march = MarchSettings::of_plan(&plan, pixel_radius * settings.detail, settings.precision);
    if settings.plain {
        march.relaxation = 1.0;
    }
    let purpose = if settings.plain { Purpose::Estimate } else { Purpose::March };
    let estimator = compose_estimator(composer, &plan.choices, purpose)?;
    let marched = Kernel::March(compose_march(arena, estimator.clone(), &march));
    let bounds = bounds_of(composer, &plan, &camera, settings, &marched)?;
    let beams = match settings.plain || settings.beams == BeamUse::Off {
        true => None,
        false => BeamKernels::new(composer, &plan, &camera, (settings, &bounds), &march)?,
    };
    let sun = shade::sun_direction(look, &frame);
    let shadow_march = look.shadows.then(|| match settings.plain {
        true => Ok(compose_march(arena, estimator, &march)),
        false => {
            let plan = shadow_plan(&plan);
            let march = MarchSettings::of_plan(&plan, pixel_radius * settings.detail, settings.precision);
            Ok(compose_shadow_march(arena, compose_estimator(composer, &plan.choices, purpose)?, &march))
        }
    });
    let shadow_march = shadow_march.transpose()?.map(Kernel::March);
    let threshold = shade::Threshold { pixel_radius: march.pixel_radius, fixed: march.hit_eps };
    let skipped = if settings.plain { 0.0 } else { SKIPPED };
    let shadow_ray =
        look.shadows.then(|| Kernel::Map(shade::compose_shadow_ray(arena, (sun, look), threshold, &bounds, skipped)));
    Ok(Pipeline {
        camera,
        bounds,
        plane: None,
        pixel_radius,
        camera_kernel: Kernel::Map(shade::compose_camera(arena, &camera, settings.size, &bounds)),
        beams,
        march: marched,
        surface_point: Kernel::Map(shade::compose_surface_point(arena, threshold, settings.precision)),
        surface: Kernel::Estimate(compose_estimator(composer, &plan.choices, Purpose::Surface)?),
        shadow_ray,
        shadow_march,
        colour: Kernel::Map(shade::compose_colour(arena, look, &frame, plan.bounding_radius, plan.is_certified())),
        encode: Kernel::Map(shade::compose_encode(arena)),
        plan,
    })
}

/// What a picture's rays are cut to: a box where one is wanted, proven and worth it, and rays end with it where they end without.
fn bounds_of(
    composer: &Composer,
    plan: &Plan,
    camera: &Camera,
    settings: &RenderSettings,
    march: &Kernel,
) -> Result<Bounds, Diagnostic> {
    let samples = [settings.size.width, settings.size.height, settings.samples, settings.samples].map(u64::from);
    let ball = Bounds::ball(plan.bounding_radius);
    if !settings.boxed || settings.plain || samples.iter().product::<u64>() < LEAST_BOXED {
        return Ok(ball);
    }
    let bounds = Bounds::prove(composer, plan)?;
    let is_tried = bounds.sides.is_some() && !plan.is_certified();
    // The CPU runs every kernel.
    let holds = !is_tried || box_holds(composer.arena, camera, settings, &bounds, march).unwrap_or(false);
    Ok(if holds { bounds } else { ball })
}
