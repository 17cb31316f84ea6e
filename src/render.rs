//! Joins the stages: kernels for a fractal and a view, run tile by tile on a back end, into a picture and its statistics.

use std::time::{Duration, Instant};

use crate::compose::choose::{UNIT_F32, UNIT_F64};
use crate::compose::{Choice, Composer, Plan, Purpose, choose, compose_estimator};
use crate::diag::Diagnostic;
use crate::film::{Image, tiles};
use crate::graph::{Camera, EstimateSettings, Look};
use crate::kernel::{Backend, BackendError, Compiling, Kernel, Status, march_output_ports};
use crate::march::{MIN_DIFFERENCE_F32, MIN_DIFFERENCE_F64, MarchSettings, compose_march, is_undecided};
use crate::shade::{self, CameraFrame, Size};

/// What a picture needs besides its fractal.
#[derive(Clone, PartialEq, Debug)]
pub struct RenderSettings {
    /// Columns and rows.
    pub size: Size,
    /// What is asked of the estimate; the rest is chosen.
    pub estimate: EstimateSettings,
    /// Samples along each edge of a pixel.
    pub samples: u32,
    /// Hit threshold in pixel radii.
    pub detail: f64,
    /// Estimates after which a ray is unfinished.
    pub max_march_steps: u32,
    /// Least relative step of finite differences, by the precision of the back end (see [`MarchSettings`]).
    pub min_difference: f64,
}

impl Default for RenderSettings {
    fn default() -> Self {
        RenderSettings {
            size: Size { width: 1280, height: 720 },
            estimate: EstimateSettings::default(),
            samples: 1,
            detail: 1.0,
            max_march_steps: 1000,
            min_difference: MIN_DIFFERENCE_F32,
        }
    }
}

/// The kernels of a picture.
pub struct Pipeline {
    /// How distances are estimated, and the extent.
    pub plan: Plan,
    /// The view.
    pub camera: Camera,
    /// Radius of a pixel at distance 1.
    pub pixel_radius: f64,
    /// Pixels to rays.
    pub camera_kernel: Kernel,
    /// Rays to hits; primary and shadow rays alike.
    pub march: Kernel,
    /// Hits to the points where surfaces are looked at.
    pub surface_point: Kernel,
    /// Points to gradients and traps.
    pub surface: Kernel,
    /// Hits to rays towards the sun; absent without shadows.
    pub shadow_ray: Option<Kernel>,
    /// Everything to linear colours.
    pub colour: Kernel,
    /// Linear colours to sRGB.
    pub encode: Kernel,
}

impl Pipeline {
    /// All kernels, with names, in the order in which they run.
    pub fn kernels(&self) -> Vec<(&'static str, &Kernel)> {
        let mut kernels = vec![
            ("camera", &self.camera_kernel),
            ("march", &self.march),
            ("surface_point", &self.surface_point),
            ("surface", &self.surface),
        ];
        kernels.extend(self.shadow_ray.as_ref().map(|k| ("shadow_ray", k)));
        kernels.extend([("colour", &self.colour), ("encode", &self.encode)]);
        kernels
    }
}

/// Composes the kernels of a fractal's picture.
pub fn compose_pipeline(composer: &Composer, settings: &RenderSettings) -> Result<Pipeline, Diagnostic> {
    compose_planned(composer, settings, choose(composer, &settings.estimate)?)
}

/// Composes the kernels of a fractal's picture with the estimates of a plan; `settings.estimate` is not asked.
pub fn compose_planned(composer: &Composer, settings: &RenderSettings, mut plan: Plan) -> Result<Pipeline, Diagnostic> {
    plan = in_precision(plan, settings.min_difference);
    let camera = composer.graph.camera.unwrap_or_else(|| shade::frame_automatically(plan.bounding_radius));
    let look: &Look = &composer.graph.look;
    let arena = composer.arena;
    let frame = CameraFrame::new(&camera);
    let pixel_radius = shade::pixel_radius(&camera, settings.size);
    let march = MarchSettings {
        max_march_steps: settings.max_march_steps,
        ..MarchSettings::of_plan(&plan, pixel_radius * settings.detail, settings.min_difference)
    };
    let choices: &[Choice] = &plan.choices;
    let estimator = compose_estimator(composer, choices, Purpose::March)?;
    let radius = plan.bounding_radius;
    let sun = shade::sun_direction(look, &frame);
    Ok(Pipeline {
        camera,
        pixel_radius,
        camera_kernel: Kernel::Map(shade::compose_camera(arena, &camera, settings.size, radius)),
        march: Kernel::March(compose_march(arena, estimator, &march)),
        surface_point: Kernel::Map(shade::compose_surface_point(arena, march.pixel_radius, settings.min_difference)),
        surface: Kernel::Estimate(compose_estimator(composer, choices, Purpose::Surface)?),
        shadow_ray: look
            .shadows
            .then(|| Kernel::Map(shade::compose_shadow_ray(arena, sun, march.pixel_radius, radius))),
        colour: Kernel::Map(shade::compose_colour(arena, look, &frame, radius)),
        encode: Kernel::Map(shade::compose_encode(arena)),
        plan,
    })
}

/// The plan as it is run in the precision that a least step of finite differences belongs to.
pub fn in_precision(mut plan: Plan, min_difference: f64) -> Plan {
    plan.choices.iter_mut().for_each(|choice| choice.unit = unit_of(min_difference));
    plan
}

/// The relative error of one operation in the precision that a least step of finite differences belongs to.
fn unit_of(min_difference: f64) -> f64 {
    if min_difference <= MIN_DIFFERENCE_F64 { UNIT_F64 } else { UNIT_F32 }
}

/// What a render counted. Rays are the primary ones.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Stats {
    /// Primary rays.
    pub rays: u64,
    /// Rays that hit.
    pub hits: u64,
    /// Rays that ran out of steps.
    pub unfinished: u64,
    /// Rays with an estimate that was not a number.
    pub nan: u64,
    /// With a certified method, rays that crossed something unproven: neither proven empty nor a hit within a few
    /// thresholds. `None` with estimates, which prove nothing.
    pub undecided: Option<u64>,
    /// Estimates of primary rays.
    pub estimates: u64,
    /// Most march steps of a ray.
    pub max_steps: u64,
    /// Iterations of all estimates of primary rays.
    pub iterations: u64,
    /// Estimates of shadow rays.
    pub shadow_estimates: u64,
    /// Time to compile kernels.
    pub compile: Duration,
    /// What the back end has compiled by then, where it keeps account.
    pub compiling: Option<Compiling>,
    /// Time to render, without compiling.
    pub render: Duration,
}

/// A pipeline made ready on a back end.
pub struct Renderer<'b, B: Backend> {
    backend: &'b B,
    size: Size,
    samples: u32,
    camera: B::Prepared,
    march: B::Prepared,
    surface_point: B::Prepared,
    surface: B::Prepared,
    shadow_ray: Option<B::Prepared>,
    colour: B::Prepared,
    encode: B::Prepared,
    /// What has been counted so far.
    pub stats: Stats,
}

impl<'b, B: Backend> Renderer<'b, B> {
    /// Compiles the pipeline's kernels.
    pub fn new(
        backend: &'b B,
        arena: &crate::expr::Arena,
        pipeline: &Pipeline,
        settings: &RenderSettings,
    ) -> Result<Self, BackendError> {
        let kernels = pipeline.kernels();
        let prepare = |name: &str| {
            let kernel = kernels.iter().find(|(known, _)| *known == name);
            kernel.map(|(_, kernel)| backend.prepare(arena, kernel)).transpose()
        };
        Renderer::with_kernels(backend, settings, pipeline.plan.is_certified(), prepare)
    }

    /// A renderer of kernels that `prepare` gives by the names of [`Pipeline::kernels`]; `None` where there is none.
    pub fn with_kernels(
        backend: &'b B,
        settings: &RenderSettings,
        is_certified: bool,
        mut prepare: impl FnMut(&str) -> Result<Option<B::Prepared>, BackendError>,
    ) -> Result<Self, BackendError> {
        let start = Instant::now();
        let mut needed = |name: &str| Ok(prepare(name)?.expect("every picture has this kernel"));
        let mut renderer = Renderer {
            backend,
            size: settings.size,
            samples: settings.samples.max(1),
            camera: needed("camera")?,
            march: needed("march")?,
            surface_point: needed("surface_point")?,
            surface: needed("surface")?,
            colour: needed("colour")?,
            encode: needed("encode")?,
            shadow_ray: prepare("shadow_ray")?,
            stats: Stats::default(),
        };
        renderer.stats.undecided = is_certified.then_some(0);
        renderer.stats.compile = start.elapsed();
        renderer.stats.compiling = backend.compiling();
        Ok(renderer)
    }

    /// Renders the whole picture. `progress` is told the share that is done and returns false to stop.
    pub fn render(&mut self, progress: &mut dyn FnMut(f64) -> bool) -> Result<Option<Image>, BackendError> {
        let start = Instant::now();
        let mut image = Image::new(self.size);
        let tiles = tiles(self.size);
        for (i, tile) in tiles.iter().enumerate() {
            let pixels = tile.pixels();
            let colours = self.shade_pixels(&pixels)?;
            for (pixel, colour) in pixels.iter().zip(colours) {
                image.set(*pixel, colour);
            }
            if !progress((i + 1) as f64 / tiles.len() as f64) {
                return Ok(None);
            }
        }
        self.stats.render = start.elapsed();
        Ok(Some(image))
    }

    /// Marches the centres of pixels and gives, for each, its depth `t` where it hits.
    pub fn depths(&mut self, pixels: &[(u32, u32)]) -> Result<Vec<Option<f64>>, BackendError> {
        let rays = self.rays(pixels, [0.5, 0.5])?;
        let hits = self.backend.run(&self.march, &[&rays])?;
        let columns = self.backend.download(&hits)?;
        let status = column("status");
        Ok((0..pixels.len())
            .map(|i| (Status::from_code(columns[status][i]) == Status::Hit).then(|| columns[0][i]))
            .collect())
    }

    fn rays(&self, pixels: &[(u32, u32)], offset: [f64; 2]) -> Result<B::Columns, BackendError> {
        let x = pixels.iter().map(|p| f64::from(p.0) + offset[0]).collect();
        let y = pixels.iter().map(|p| f64::from(p.1) + offset[1]).collect();
        let pixels = self.backend.upload(&[x, y])?;
        self.backend.run(&self.camera, &[&pixels])
    }

    /// Colours of pixels in sRGB, the average of their samples.
    fn shade_pixels(&mut self, pixels: &[(u32, u32)]) -> Result<Vec<[f64; 3]>, BackendError> {
        let mut sum: Vec<Vec<f64>> = vec![vec![0.0; pixels.len()]; 3];
        for i in 0..self.samples {
            for j in 0..self.samples {
                let offset = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(self.samples));
                let colours = self.sample(pixels, offset)?;
                for (sum, colour) in sum.iter_mut().zip(self.backend.download(&colours)?) {
                    for (a, b) in sum.iter_mut().zip(colour) {
                        *a += b;
                    }
                }
            }
        }
        let scale = 1.0 / f64::from(self.samples * self.samples);
        sum.iter_mut().flatten().for_each(|x| *x *= scale);
        let linear = self.backend.upload(&sum)?;
        let encoded = self.backend.download(&self.backend.run(&self.encode, &[&linear])?)?;
        Ok((0..pixels.len()).map(|i| [encoded[0][i], encoded[1][i], encoded[2][i]]).collect())
    }

    fn sample(&mut self, pixels: &[(u32, u32)], offset: [f64; 2]) -> Result<B::Columns, BackendError> {
        let backend = self.backend;
        let rays = self.rays(pixels, offset)?;
        let hits = backend.run(&self.march, &[&rays])?;
        self.count(&backend.download(&hits)?);
        let points = backend.run(&self.surface_point, &[&rays, &hits])?;
        let surface = backend.run(&self.surface, &[&points])?;
        let Some(shadow_ray) = &self.shadow_ray else {
            return backend.run(&self.colour, &[&rays, &hits, &surface]);
        };
        let shadow_rays = backend.run(shadow_ray, &[&rays, &hits, &surface])?;
        let shadows = backend.run(&self.march, &[&shadow_rays])?;
        let steps = &backend.download(&shadows)?[column("steps")];
        self.stats.shadow_estimates += steps.iter().sum::<f64>() as u64;
        backend.run(&self.colour, &[&rays, &hits, &surface, &shadows])
    }

    fn count(&mut self, hits: &[Vec<f64>]) {
        let stats = &mut self.stats;
        let sum = |name: &str| hits[column(name)].iter().sum::<f64>() as u64;
        let with =
            |status: Status| hits[column("status")].iter().filter(|&&s| Status::from_code(s) == status).count() as u64;
        stats.rays += hits[0].len() as u64;
        stats.hits += with(Status::Hit);
        stats.unfinished += with(Status::Unfinished);
        stats.nan += hits[column("nan")].iter().filter(|&&n| n > 0.0).count() as u64;
        if let Some(undecided) = &mut stats.undecided {
            let [last, steps, status] = ["last_de", "steps", "status"].map(|name| &hits[column(name)]);
            let open = |i: &usize| is_undecided(last[*i], steps[*i], Status::from_code(status[*i]));
            *undecided += (0..last.len()).filter(open).count() as u64;
        }
        stats.estimates += sum("steps");
        stats.iterations += sum("iterations");
        let most = hits[column("steps")].iter().copied().fold(0.0, f64::max);
        stats.max_steps = stats.max_steps.max(most as u64);
    }
}

/// Column of a march's output.
fn column(name: &str) -> usize {
    march_output_ports().iter().position(|p| p.name == name).expect("the name is one of the march's ports")
}
