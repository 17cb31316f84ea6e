//! What estimates cost and how far they are off, measured on the view itself: the evidence of charts and of choices.
//!
//! In come a [`Subject`], a [`View`] of it with its [`Truths`] and [`Candidate`]s; out
//! comes a [`Measured`] each. All candidates march the same rays and are compared with the same truth, so that their
//! numbers can be compared with each other. [`step_size`] and [`depth`] vary the step of finite differences and the zoom.

pub mod depth;
pub mod peak;
pub mod speed;
pub mod step_size;

use super::backends::{Backends, Target};
use super::subject::Subject;
use super::truth::{Judgement, Ray, Scale, Truths, candidate as candidate_march, ends, ray_columns};
use crate::compose::{Plan, choose};
use crate::graph::{Camera, DeForm, EstimateSettings, Method};
use crate::kernel::Kernel;
use crate::march::{MarchSettings, Threshold};
use crate::shade::{Size, rays};

/// Copies of the rays that a GPU is timed with: a few hundred rays do not fill one.
const GPU_COPIES: usize = 32;

/// The rays of a picture that measurements look at.
#[derive(Clone, Debug)]
pub struct View {
    /// Where they come from.
    pub camera: Camera,
    /// Columns and rows of the picture that they are taken from.
    pub size: Size,
    /// What rays are measured with.
    pub scale: Scale,
    /// Centres of pixels on an even grid over the picture, row by row.
    pub rays: Vec<Ray>,
}

impl View {
    /// About `count` rays of the formula's own view, at a picture size that says how large footprints are.
    pub fn sample(subject: &Subject, size: Size, count: usize) -> View {
        let bounding_radius = subject.plan.bounding_radius;
        let camera = crate::render::camera_of(&subject.composer(), &subject.plan);
        View::of_camera(camera, size, bounding_radius, count)
    }

    /// About `count` rays of a camera.
    pub fn of_camera(camera: Camera, size: Size, bounding_radius: f64, count: usize) -> View {
        let scale = Scale::of_view(&camera, size, bounding_radius);
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let columns = ((count as f64 * width / height).sqrt().round() as u32).clamp(1, size.width);
        let rows = ((count as f64 / f64::from(columns)).round() as u32).clamp(1, size.height);
        let pixel = |i: u32, of: u32, edge: f64| ((f64::from(i) + 0.5) / f64::from(of) * edge).floor() + 0.5;
        let places: Vec<[f64; 2]> = (0..rows)
            .flat_map(|j| (0..columns).map(move |i| (i, j)))
            .map(|(i, j)| [pixel(i, columns, width), pixel(j, rows, height)])
            .collect();
        let rays = rays(&camera, size, &places);
        View { camera, size, scale, rays }
    }
}

/// Finds the truth of a view's rays by brute force, in f64. `progress` receives the share that is done.
pub fn find_truths(subject: &Subject, view: &View, progress: &mut dyn FnMut(f64)) -> Result<Truths, String> {
    let mut told = |share: f64| {
        progress(share);
        true
    };
    let truths = Truths::find(&subject.composer(), &subject.plan.choices, &view.rays, view.scale, &mut told);
    truths.map_err(|error| error.rendered(&subject.library.sources))
}

/// One way of estimating distances.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Candidate {
    /// Method of every orbit that it applies to; `None` if there is none to choose, as for primitives.
    pub method: Option<Method>,
    /// Form of the estimate; `None` takes what the orbit's growth calls for.
    pub form: Option<DeForm>,
    /// Step multiplier in (0, 1].
    pub fudge: f64,
    /// Shortest step as a share of the hit threshold; `None` is the usual one of the method.
    pub least_step: Option<f64>,
    /// Back end and precision.
    pub target: Target,
}

impl Candidate {
    /// The settings for the composer.
    pub fn settings(&self) -> EstimateSettings {
        EstimateSettings {
            method: self.method,
            form: self.form,
            fudge: Some(self.fudge),
            least_step: self.least_step,
            ..EstimateSettings::default()
        }
    }
}

/// How a candidate did, as [`Judgement`] defines it.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Measured {
    /// Share of the hits that the march passed or met more than two footprints behind.
    pub missed: f64,
    /// Share of the stops that are in front of the truth by more than 0.5 % of the bounding radius.
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
    /// From a judgement and the time that a pixel took.
    fn new(judged: &Judgement, ns_per_pixel: f64) -> Measured {
        Measured {
            missed: judged.missed,
            early: judged.early,
            median_error: judged.median_error,
            ns_per_pixel,
            estimates_per_pixel: judged.estimates,
            unfinished: judged.unfinished,
            nan: judged.nan,
        }
    }

    /// The share that is wrong either way.
    pub fn wrong(&self) -> f64 {
        self.missed + self.early
    }
}

/// Candidates that share method and form differ in the march alone: their plan is made once.
pub struct Measurer<'a> {
    subject: &'a Subject<'a>,
    truths: &'a Truths,
    backends: &'a Backends,
    columns: Vec<Vec<f64>>,
    plans: Vec<(Option<Method>, Option<DeForm>, Plan)>,
}

impl<'a> Measurer<'a> {
    /// Measures candidates of one formula on the rays of one view.
    pub fn new(subject: &'a Subject<'a>, truths: &'a Truths, backends: &'a Backends) -> Measurer<'a> {
        let columns = ray_columns(&truths.rays, truths.scale.bounding_radius);
        Measurer { subject, truths, backends, columns, plans: Vec::new() }
    }

    fn plan(&mut self, candidate: &Candidate) -> Result<Plan, String> {
        let (method, form) = (candidate.method, candidate.form);
        if let Some((.., plan)) = self.plans.iter().find(|(m, f, _)| (*m, *f) == (method, form)) {
            return Ok(plan.clone());
        }
        let plan = choose(&self.subject.composer(), &candidate.settings());
        let plan = plan.map_err(|error| error.rendered(&self.subject.library.sources))?;
        self.plans.push((method, form, plan.clone()));
        Ok(plan)
    }

    /// Marches the view's rays and compares them with the truth. Errors are a step's or a back end's.
    pub fn measure(&mut self, candidate: &Candidate) -> Result<Measured, String> {
        let plan = self.plan(candidate)?;
        let kernel = march_kernel(self.subject, &plan, candidate, self.truths.scale.pixel)?;
        let (arena, target) = (self.subject.arena, candidate.target);
        let copies = if target == Target::Gpu { GPU_COPIES } else { 1 };
        let columns: Vec<Vec<f64>> = self.columns.iter().map(|c| c.repeat(copies)).collect();
        let (out, time) =
            self.backends.run_timed(target, arena, &kernel, &columns).map_err(|error| error.to_string())?;
        let rays = self.truths.rays.len();
        let judged = self.truths.judge(&ends(&out, rays));
        Ok(Measured::new(&judged, time.as_nanos() as f64 / (rays * copies).max(1) as f64))
    }
}

/// The march of a plan with a candidate's multiplier and precision.
fn march_kernel(subject: &Subject, plan: &Plan, candidate: &Candidate, pixel: Threshold) -> Result<Kernel, String> {
    let settings = MarchSettings {
        fudge: candidate.fudge,
        least_step: candidate.least_step.unwrap_or(plan.least_step),
        ..MarchSettings::of_plan(plan, pixel, candidate.target.precision())
    };
    candidate_march(&subject.composer(), &plan.choices, &settings)
        .map_err(|error| error.rendered(&subject.library.sources))
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
