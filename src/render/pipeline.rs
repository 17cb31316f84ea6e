//! The passes of a picture, composed from a fractal, its view and its plan.

use super::beams::{BeamTiles, compose_beams};
use super::checked::box_holds;
use super::data::compose_data;
use super::framing::camera_of;
use super::further::Further;
use super::passes::{Passes, Role, Slot};
use super::plane::compose_plane;
use super::{BeamUse, RenderSettings};
use crate::compose::{Bounds, Composer, Plan, Purpose, choose, compose_estimator};
use crate::diag::Diagnostic;
use crate::expr::Arena;
use crate::film::{Develop, Layer, compose_develop};
use crate::graph::{Camera, Look, Plane};
use crate::kernel::{Kernel, March};
use crate::march::{MarchSettings, Threshold, compose_march, tells_nearness};
use crate::shade::{self, Lighting, Mirrors};

/// Samples of a picture that a search for a box pays for.
const LEAST_BOXED: u64 = 1 << 20;

/// A picture's passes, and what they were composed from.
pub struct Pipeline {
    /// How distances are estimated, and the extent.
    pub plan: Plan,
    /// The view.
    pub camera: Camera,
    /// What rays are cut to.
    pub bounds: Bounds,
    /// The plane that is seen, by one estimate at each point; absent where rays are marched.
    pub plane: Option<Plane>,
    /// Radius of a pixel along a ray, or in the plane.
    pub pixel: Threshold,
    /// The tiles of beams, which find out for many pixels at once how far nothing is; absent where every ray is marched by
    /// itself.
    pub tiles: Option<BeamTiles>,
    /// Points of the picture to colours, and what lies between.
    pub passes: Passes<Kernel>,
}

impl Pipeline {
    /// All kernels, with names, in the order in which they run.
    pub fn kernels(&self) -> Vec<(&'static str, &Kernel)> {
        self.passes.iter().map(|pass| (pass.role.name(), &pass.kernel)).collect()
    }

    /// The kernel of a role that every picture has.
    pub fn kernel(&self, role: Role) -> &Kernel {
        self.passes.get(role).expect("every picture has this role")
    }

    /// The march of the picture's rays.
    pub fn march(&self) -> &March {
        match self.kernel(Role::March) {
            Kernel::March(march) => march,
            _ => unreachable!("a picture's march is a march"),
        }
    }

    /// Leaves the beams out: every ray is marched by itself.
    pub fn drop_beams(&mut self) {
        self.tiles = None;
        let of_beams = [Role::Beam, Role::BeamMarch, Role::Begin, Role::Background];
        self.passes.retain(|role| !of_beams.contains(&role));
    }

    /// What else a renderer has to know.
    pub fn shape(&self) -> Shape {
        Shape { is_certified: self.plan.is_certified(), tiles: self.tiles.clone(), passes: self.passes.plan() }
    }
}

/// What a renderer has to know besides its kernels.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Whether marches are proofs.
    pub is_certified: bool,
    /// The tiles of beams, where there are beams.
    pub tiles: Option<BeamTiles>,
    /// What reads what.
    pub passes: Passes<()>,
}

/// Composes the passes of a fractal's picture.
pub fn compose_pipeline(composer: &Composer, settings: &RenderSettings) -> Result<Pipeline, Diagnostic> {
    compose_planned(composer, settings, choose(composer, &settings.estimate)?)
}

/// Composes the passes of a fractal's picture with the estimates of a plan; `settings.estimate` is not asked.
pub fn compose_planned(composer: &Composer, settings: &RenderSettings, mut plan: Plan) -> Result<Pipeline, Diagnostic> {
    plan = plan.in_precision(settings.precision);
    if !settings.early_ends {
        plan = plan.with_late_ends();
    }
    if let Some(plane) = &composer.graph.scene.plane {
        return compose_plane(composer, plane, settings, &plan);
    }
    let camera = camera_of(composer, &plan);
    let develop = Develop::of(&composer.graph.scene.film, Develop::SOLID);
    // Files state what the background looks like, and light is mixed with light.
    let scene = &composer.graph.scene;
    let lighting = Lighting::new(scene, &camera, plan.bounding_radius, |shown| develop.radiance_of(shown));
    let mut lighting = lighting.map_err(|error| Diagnostic::error(error.to_string()))?;
    if settings.path.is_none() && !tells_nearness(&plan) {
        lighting = lighting.in_points();
    }
    if settings.path.is_some() {
        lighting = lighting.for_paths();
    }
    let look = &scene.look;
    let arena = composer.arena;
    let pixel = shade::threshold(&camera, settings.size);
    let mut march = MarchSettings::of_plan(&plan, pixel.times(settings.detail), settings.precision);
    if settings.plain {
        march.relaxation = 1.0;
    }
    let purpose = if settings.plain { Purpose::Estimate } else { Purpose::March };
    let estimator = compose_estimator(composer, &plan.choices, purpose)?;
    let marched = Kernel::March(compose_march(arena, estimator, &march));
    let bounds = bounds_of(composer, &plan, &camera, settings, &marched)?;

    // Points of the picture to ends of rays.
    let mut passes = Passes::default();
    let camera_kernel = shade::compose_camera(arena, &camera, settings.size, &bounds);
    passes.push(Role::Camera, [Slot::Points], Slot::Rays, Kernel::Map(camera_kernel));
    // What beams find empty is seen through clear air, from one point.
    let aperture = camera.aperture.filter(|_| settings.path.is_some());
    let is_hazy = lighting.atmosphere.glow.is_some() || lighting.atmosphere.fog_colour.is_some() || aperture.is_some();
    let tiles = match settings.plain || is_hazy || settings.beams == BeamUse::Off {
        true => None,
        false => compose_beams(&mut passes, composer, &plan, (&camera, &lighting), (settings, &bounds), &march)?,
    };
    passes.push(Role::March, [Slot::Rays], Slot::Ends, marched);

    // What is asked of surfaces, a hit threshold in front of them.
    let point = shade::compose_surface_point(arena, march.threshold(), settings.precision);
    passes.push(Role::SurfacePoint, [Slot::Rays, Slot::Ends], Slot::Queries, Kernel::Map(point));
    let surface = compose_estimator(composer, &plan.choices, Purpose::Surface)?;
    passes.push(Role::Surface, [Slot::Queries], Slot::Surfaces, Kernel::Estimate(surface));

    let further = Further { composer, plan: &plan, settings, camera: &camera, bounds: &bounds, march: &march };
    if settings.path.is_some() {
        further.path(&mut passes, &lighting)?;
        if let Some(aperture) = &aperture {
            let blur = Kernel::Map(shade::compose_blur(arena, &camera, aperture, &bounds));
            passes.push(Role::Blur, [Slot::Rays, Slot::LensPoints], Slot::BlurredRays, blur);
        }
    } else {
        let mut seen = vec![Slot::Rays, Slot::Ends, Slot::Surfaces];
        seen.extend(further.compose(&mut passes, &lighting)?);
        // Everything to colours, and to what is kept besides.
        let is_known = |slot: &Slot| !matches!(slot, Slot::Shadows(_) | Slot::Passing);
        let known: Vec<Slot> = seen.iter().copied().filter(is_known).collect();
        let colour = shade::compose_colour(arena, look, &lighting);
        passes.push(Role::Colour, seen.clone(), Slot::Colours, Kernel::Map(colour));
        if settings.mirrors > 0 && Mirrors::are_in(look) {
            further.mirrors(&mut passes, &lighting, &seen);
        }
        push_data(&mut passes, arena, look, (settings, known));
    }
    passes.push(Role::Encode, [Slot::Colours], Slot::Bytes, Kernel::Map(compose_develop(arena, develop)));
    Ok(Pipeline { camera, bounds, plane: None, pixel, tiles, passes, plan })
}

/// Adds the pass of the layers that are asked for, where there are any. It reads what is seen, and its colours.
pub(super) fn push_data(
    passes: &mut Passes<Kernel>,
    arena: &Arena,
    look: &Look,
    (settings, mut seen): (&RenderSettings, Vec<Slot>),
) {
    let layers = settings.layers.data();
    if layers.is_empty() {
        return;
    }
    let has_corners = layers.has(Layer::Occlusion) && seen.contains(&Slot::Corners);
    seen.retain(|slot| *slot != Slot::Corners);
    seen.push(Slot::Colours);
    seen.extend(has_corners.then_some(Slot::Corners));
    passes.push(Role::Data, seen, Slot::Data, Kernel::Map(compose_data(arena, look, layers, has_corners)));
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
