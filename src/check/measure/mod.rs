//! What estimates cost and how far they are off, measured on the view itself: the evidence of charts and of choices.
//!
//! In come a [`Subject`], a [`View`] of it with its [`Reference`] (the truth of the view's rays) and [`Candidate`]s; out
//! comes a [`Measured`] each. All candidates march the same rays and are compared with the same truth, so that their
//! numbers can be compared with each other. [`step_size`] and [`depth`] vary the step of finite differences and the zoom.

pub mod depth;
pub mod step_size;

use super::backends::{Backends, Target};
use super::formula::rendered;
use super::subject::{Subject, sphere_range};
use super::truth::{Ray, Truth, depths};
use crate::compose::{Plan, Purpose, choose, compose_estimator};
use crate::graph::{Camera, DeForm, EstimateSettings, Method};
use crate::kernel::{Kernel, Status, march_output_ports};
use crate::march::{MIN_DIFFERENCE_F32, MIN_DIFFERENCE_F64, MarchSettings, compose_march};
use crate::shade::{CameraFrame, Size, frame_automatically, pixel_radius};

/// Behind the truth by more than this many footprints, a hit counts as missed.
pub const MISSED_FOOTPRINTS: f64 = 2.0;
/// In front of the truth by more than this share of the bounding radius, a hit counts as early.
pub const EARLY_SHARE: f64 = 0.005;
/// Estimates after which a ray is unfinished.
const MAX_MARCH_STEPS: u32 = 1000;
/// Rays whose truths are found at once, between two calls of `progress`.
const BATCH: usize = 64;
/// Copies of the rays that a GPU is timed with: a few hundred rays do not fill one.
const GPU_COPIES: usize = 32;

/// The rays of a picture that measurements look at.
#[derive(Clone, Debug)]
pub struct View {
    /// Where they come from.
    pub camera: Camera,
    /// Columns and rows of the picture that they are taken from.
    pub size: Size,
    /// Radius of a pixel at distance 1.
    pub pixel_radius: f64,
    /// Radius of a ball around the origin that holds everything.
    pub bounding_radius: f64,
    /// Centres of pixels on an even grid over the picture, row by row.
    pub rays: Vec<Ray>,
}

impl View {
    /// About `count` rays of the formula's own view, at a picture size that says how large footprints are.
    pub fn sample(subject: &Subject, size: Size, count: usize) -> View {
        let bounding_radius = subject.plan.bounding_radius;
        let camera = subject.graph.camera.unwrap_or_else(|| frame_automatically(bounding_radius));
        View::of_camera(camera, size, bounding_radius, count)
    }

    /// About `count` rays of a camera.
    pub fn of_camera(camera: Camera, size: Size, bounding_radius: f64, count: usize) -> View {
        let pixel_radius = pixel_radius(&camera, size);
        let frame = CameraFrame::new(&camera);
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let columns = ((count as f64 * width / height).sqrt().round() as u32).clamp(1, size.width);
        let rows = ((count as f64 / f64::from(columns)).round() as u32).clamp(1, size.height);
        let pixel = |i: u32, of: u32, edge: f64| ((f64::from(i) + 0.5) / f64::from(of) * edge).floor() + 0.5;
        let ray = |x: f64, y: f64| {
            let right = (x - width / 2.0) * 2.0 * pixel_radius;
            let up = (height / 2.0 - y) * 2.0 * pixel_radius;
            let d = [0, 1, 2].map(|i| frame.right[i] * right + frame.up[i] * up + frame.forward[i]);
            (camera.position, glam::DVec3::from(d).normalize().to_array())
        };
        let rays = (0..rows)
            .flat_map(|j| (0..columns).map(move |i| (i, j)))
            .map(|(i, j)| ray(pixel(i, columns, width), pixel(j, rows, height)))
            .collect();
        View { camera, size, pixel_radius, bounding_radius, rays }
    }

    /// Columns of the march's inputs: each ray with its range in the bounding sphere.
    fn columns(&self) -> Vec<Vec<f64>> {
        let mut columns = vec![Vec::with_capacity(self.rays.len()); 8];
        for (origin, direction) in &self.rays {
            let (near, far) = sphere_range(*origin, *direction, self.bounding_radius);
            let values = origin.iter().chain(direction).copied().chain([near, far]);
            columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        }
        columns
    }
}

/// The truth of a view's rays.
#[derive(Clone, PartialEq, Debug)]
pub struct Reference {
    /// One for each ray.
    pub truths: Vec<Truth>,
}

impl Reference {
    /// Finds the truths by brute force, in f64. `progress` is told the share that is done.
    pub fn find(subject: &Subject, view: &View, progress: &mut dyn FnMut(f64)) -> Result<Reference, String> {
        let mut truths = Vec::with_capacity(view.rays.len());
        for batch in view.rays.chunks(BATCH) {
            truths.extend(depths(subject, batch, view.pixel_radius)?);
            progress(truths.len() as f64 / view.rays.len() as f64);
        }
        Ok(Reference { truths })
    }

    /// Rays with a settled hit.
    pub fn hits(&self) -> usize {
        self.truths.iter().filter(|t| matches!(t, Truth::Hit(_))).count()
    }

    /// Rays whose truth does not settle; they judge nothing.
    pub fn ambiguous(&self) -> usize {
        self.truths.iter().filter(|t| **t == Truth::Ambiguous).count()
    }
}

/// One way of estimating distances.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Candidate {
    /// Method of every orbit that it applies to; `None` where there is none to choose, as for primitives.
    pub method: Option<Method>,
    /// Form of the estimate; `None` takes what the orbit's growth calls for.
    pub form: Option<DeForm>,
    /// Step multiplier in (0, 1].
    pub fudge: f64,
    /// Back end and precision.
    pub target: Target,
}

impl Candidate {
    /// What is asked of the composer.
    pub fn settings(&self) -> EstimateSettings {
        EstimateSettings {
            method: self.method,
            form: self.form,
            fudge: Some(self.fudge),
            ..EstimateSettings::default()
        }
    }
}

/// How a candidate did. Shares are of the rays with a settled hit.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Measured {
    /// Share of the hits that the march passed or met more than [`MISSED_FOOTPRINTS`] behind.
    pub missed: f64,
    /// Share of the hits that it stopped in front of by more than [`EARLY_SHARE`] of the bounding radius.
    pub early: f64,
    /// Median of the depth error in footprints (a footprint is a pixel's diameter at the hit); infinite where most hits
    /// are lost.
    pub median_error: f64,
    /// Time of the fastest run, over all rays of the view, in nanoseconds; of one core on the CPU.
    pub ns_per_pixel: f64,
    /// Estimates made, over all rays of the view.
    pub estimates_per_pixel: f64,
    /// Rays that ran out of steps.
    pub unfinished: usize,
    /// Rays with an estimate that was not a number.
    pub nan: usize,
}

impl Measured {
    /// Share of the hits that are wrong either way.
    pub fn wrong(&self) -> f64 {
        self.missed + self.early
    }
}

/// Candidates that share method and form differ in the march alone: their plan is made once.
pub struct Measurer<'a> {
    subject: &'a Subject<'a>,
    view: &'a View,
    reference: &'a Reference,
    backends: &'a Backends,
    columns: Vec<Vec<f64>>,
    plans: Vec<(Option<Method>, Option<DeForm>, Plan)>,
}

impl<'a> Measurer<'a> {
    /// Measures candidates of one formula on one view.
    pub fn new(
        subject: &'a Subject<'a>,
        view: &'a View,
        reference: &'a Reference,
        backends: &'a Backends,
    ) -> Measurer<'a> {
        Measurer { subject, view, reference, backends, columns: view.columns(), plans: Vec::new() }
    }

    fn plan(&mut self, candidate: &Candidate) -> Result<Plan, String> {
        let (method, form) = (candidate.method, candidate.form);
        if let Some((.., plan)) = self.plans.iter().find(|(m, f, _)| (*m, *f) == (method, form)) {
            return Ok(plan.clone());
        }
        let plan = choose(&self.subject.composer(), &candidate.settings());
        let plan = plan.map_err(|error| rendered(error, self.subject.library))?;
        self.plans.push((method, form, plan.clone()));
        Ok(plan)
    }

    /// Marches the view's rays and compares them with the truth. Errors are a step's or a back end's.
    pub fn measure(&mut self, candidate: &Candidate) -> Result<Measured, String> {
        let plan = self.plan(candidate)?;
        let kernel = march_kernel(self.subject, &plan, candidate, self.view.pixel_radius)?;
        let (arena, target) = (self.subject.arena, candidate.target);
        let copies = if target == Target::Gpu { GPU_COPIES } else { 1 };
        let columns: Vec<Vec<f64>> = self.columns.iter().map(|c| c.repeat(copies)).collect();
        let (out, time) =
            self.backends.run_timed(target, arena, &kernel, &columns).map_err(|error| error.to_string())?;
        let rays = self.view.rays.len();
        let mut measured = compare(self.view, self.reference, &out);
        measured.ns_per_pixel = time.as_nanos() as f64 / (rays * copies).max(1) as f64;
        Ok(measured)
    }
}

/// The march of a plan with a candidate's multiplier and precision.
fn march_kernel(subject: &Subject, plan: &Plan, candidate: &Candidate, pixel_radius: f64) -> Result<Kernel, String> {
    let composed = compose_estimator(&subject.composer(), &plan.choices, Purpose::March);
    let estimator = composed.map_err(|error| rendered(error, subject.library))?;
    let settings = MarchSettings {
        fudge: candidate.fudge,
        pixel_radius,
        hit_eps: 0.0,
        max_march_steps: MAX_MARCH_STEPS,
        min_difference: if candidate.target == Target::CpuF64 { MIN_DIFFERENCE_F64 } else { MIN_DIFFERENCE_F32 },
    };
    Ok(Kernel::March(compose_march(subject.arena, estimator, &settings)))
}

/// Compares columns of a march with the truth; times are left at 0. There may be more columns than rays.
fn compare(view: &View, reference: &Reference, out: &[Vec<f64>]) -> Measured {
    let ports = march_output_ports();
    let column = |name: &str| &out[ports.iter().position(|p| p.name == name).expect("the march has this port")];
    let (t, status, rays) = (column("t"), column("status"), view.rays.len());
    let mut measured = Measured::default();
    let mut errors = Vec::new();
    for (i, truth) in reference.truths.iter().enumerate() {
        let status = Status::from_code(status[i]);
        measured.unfinished += usize::from(status == Status::Unfinished);
        let Truth::Hit(truth) = *truth else { continue };
        let footprint = 2.0 * view.pixel_radius * truth;
        let error = if status == Status::Hit { (t[i] - truth) / footprint } else { f64::INFINITY };
        measured.missed += f64::from(u8::from(error > MISSED_FOOTPRINTS));
        measured.early += f64::from(u8::from(truth - t[i] > EARLY_SHARE * view.bounding_radius && error < 0.0));
        errors.push(error.abs());
    }
    let hits = errors.len().max(1) as f64;
    errors.sort_by(f64::total_cmp);
    measured.missed /= hits;
    measured.early /= hits;
    measured.median_error = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
    measured.estimates_per_pixel = column("steps")[..rays].iter().sum::<f64>() / rays.max(1) as f64;
    measured.nan = column("nan")[..rays].iter().filter(|&&n| n > 0.0).count();
    measured
}

/// Indices of the points that no other is both cheaper and better than, from cheap to good; `cost` and `error` of each.
/// Points that are not finite are never among them.
pub fn pareto(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| points[i].0.is_finite() && points[i].1.is_finite()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < best;
        best = best.min(points[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::pareto;

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let points = [(3.0, 1.0), (1.0, 9.0), (2.0, 4.0), (2.5, 4.0), (4.0, 0.0), (5.0, 0.0), (0.5, f64::INFINITY)];
        assert_eq!(pareto(&points), [1, 2, 0, 4]);
        assert!(pareto(&[(f64::NAN, 0.0)]).is_empty());
    }
}
