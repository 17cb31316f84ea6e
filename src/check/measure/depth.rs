//! Depth errors against zoom: the camera moves towards a point of the surface until the precision has no digits left.
//!
//! At zoom Z the camera is at the Zth part of its first distance from a surface point of the view, found by bisecting
//! membership to the last digit of f64, and looks at it. The truth is found by brute force between a hundredth of that
//! distance and three times it; rays that leave this range are left out.

use super::{Backends, Candidate, Measured, Reference, Subject, Target, View, compare, march_kernel};
use crate::check::formula::rendered;
use crate::check::subject::estimator_columns;
use crate::check::truth::{Ray, Truth};
use crate::compose::choose;
use crate::graph::Camera;
use crate::kernel::Kernel;
use crate::shade::CameraFrame;

/// The part of the distance to the surface point at which the truth begins, and the multiple at which it ends.
const RANGE: (f64, f64) = (0.01, 3.0);
/// Rays at each zoom.
const RAYS: usize = 60;
/// Samples of a ray that are evaluated at once.
const CHUNK: usize = 256;
/// Halvings that find a crossing to the last digit.
const BISECTIONS: usize = 60;
/// Median error in footprints up to which a precision is good enough.
pub const GOOD: f64 = 0.5;
/// Share of rays that must have a settled truth for a zoom to be judged.
pub const SETTLED: f64 = 0.25;

/// Errors at one zoom.
#[derive(Clone, PartialEq, Debug)]
pub struct DepthErrors {
    /// How many times nearer the camera is than in the file's view.
    pub zoom: f64,
    /// Share of rays with a settled hit.
    pub settled: f64,
    /// One for each target; times are not measured.
    pub measured: Vec<(Target, Measured)>,
}

/// What was found for one formula.
#[derive(Clone, PartialEq, Debug)]
pub struct Depths {
    /// Rays at each zoom.
    pub rays: usize,
    /// How the estimate was made.
    pub candidate: Candidate,
    /// From zoom 1 up, a decade each.
    pub zooms: Vec<DepthErrors>,
}

impl Depths {
    /// The largest zoom up to which a target's median error stays within [`GOOD`] footprints; nothing where the first one
    /// exceeds it already.
    pub fn end_of(&self, target: Target) -> Option<f64> {
        let good = |errors: &&DepthErrors| {
            errors.settled >= SETTLED
                && errors.measured.iter().any(|(t, measured)| *t == target && measured.median_error <= GOOD)
        };
        self.zooms.iter().take_while(good).last().map(|errors| errors.zoom)
    }
}

/// Marches towards a surface point of the view at zooms from 1 to 10^`decades`. Errors where nothing is hit, and those of
/// back ends. `progress` is told the share that is done.
pub fn measure(
    subject: &Subject,
    (view, reference): (&View, &Reference),
    backends: &Backends,
    targets: &[Target],
    decades: u32,
    progress: &mut dyn FnMut(f64),
) -> Result<Depths, String> {
    let plan = &subject.plan;
    let candidate = Candidate {
        method: plan.choices.first().map(|c| c.method),
        form: plan.choices.first().map(|c| c.form),
        fudge: plan.fudge,
        target: Target::CpuF64,
    };
    let kernel = subject.estimator(&plan.choices).map_err(|error| rendered(error, subject.library))?;
    let prober = Prober { subject, backends, kernel };
    let (ray, distance) = prober.surface_point(view, reference)?;
    let chosen =
        choose(&subject.composer(), &candidate.settings()).map_err(|error| rendered(error, subject.library))?;
    let mut zooms = Vec::new();
    for decade in 0..=decades {
        let zoom = 10f64.powi(decade as i32);
        let near = zoomed(view, ray, distance, zoom);
        let reference = prober.settle(&near, distance / zoom)?;
        let columns = near.columns();
        let mut measured = Vec::new();
        for &target in targets {
            let march = march_kernel(subject, &chosen, &Candidate { target, ..candidate }, view.pixel_radius)?;
            let out = backends.run(target, subject.arena, &march, &columns).map_err(|error| error.to_string())?;
            measured.push((target, compare(&near, &reference, &out)));
        }
        let settled = reference.hits() as f64 / near.rays.len() as f64;
        zooms.push(DepthErrors { zoom, settled, measured });
        progress(f64::from(decade + 1) / f64::from(decades + 1));
    }
    Ok(Depths { rays: RAYS, candidate, zooms })
}

/// The view from the `zoom`th part of the distance, straight in front of the ray's hit.
fn zoomed(view: &View, (origin, direction): Ray, distance: f64, zoom: f64) -> View {
    let along = distance * (1.0 - 1.0 / zoom);
    let position = [0, 1, 2].map(|i| origin[i] + direction[i] * along);
    let up = CameraFrame::new(&view.camera).up;
    // The frame is made about the origin, where no digit of the direction is lost.
    let frame = Camera { position: [0.0; 3], target: direction, up, ..view.camera };
    let mut near = View::of_camera(frame, view.size, view.bounding_radius, RAYS);
    near.camera.position = position;
    near.rays.iter_mut().for_each(|ray| ray.0 = position);
    near
}

struct Prober<'a> {
    subject: &'a Subject<'a>,
    backends: &'a Backends,
    kernel: Kernel,
}

impl Prober<'_> {
    fn inside(&self, points: &[[f64; 3]]) -> Result<Vec<bool>, String> {
        let columns = estimator_columns(points, &vec![1e-8; points.len()], 0.0);
        let out = self.backends.run(Target::CpuF64, self.subject.arena, &self.kernel, &columns);
        Ok(out.map_err(|error| error.to_string())?[1].iter().map(|&inside| inside > 0.5).collect())
    }

    /// The hit nearest to the middle of the view: its ray, and its depth to the last digit.
    fn surface_point(&self, view: &View, reference: &Reference) -> Result<(Ray, f64), String> {
        let forward = CameraFrame::new(&view.camera).forward;
        let centred = |ray: &Ray| (0..3).map(|i| ray.1[i] * forward[i]).sum::<f64>();
        let hits = view.rays.iter().zip(&reference.truths).filter_map(|(ray, truth)| match truth {
            Truth::Hit(t) => Some((*ray, *t)),
            _ => None,
        });
        let nearest = hits.max_by(|a, b| centred(&a.0).total_cmp(&centred(&b.0)));
        let (ray, t) = nearest
            .ok_or_else(|| format!("no sampled ray of {} hits anything to move towards", self.subject.graph.name))?;
        // The truth is inside by less than a footprint.
        let (mut outside, mut inside) = (t * (1.0 - 2.0 * view.pixel_radius), t);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (outside + inside);
            match self.inside(&[point(ray, middle)])?[0] {
                true => inside = middle,
                false => outside = middle,
            }
        }
        Ok((ray, outside))
    }

    /// Truths by fixed steps of a quarter and an eighth of a footprint, where both agree.
    fn settle(&self, view: &View, distance: f64) -> Result<Reference, String> {
        let (coarse, fine) = (self.walk(view, distance, 0.5)?, self.walk(view, distance, 0.25)?);
        let truth = |(a, b): (&Option<f64>, &Option<f64>)| match (a, b) {
            (Some(a), Some(b)) if (a - b).abs() <= view.pixel_radius * b => Truth::Hit(*b),
            // Beyond the range nothing is known.
            _ => Truth::Ambiguous,
        };
        Ok(Reference { truths: coarse.iter().zip(&fine).map(truth).collect() })
    }

    /// First crossings at a step of `share` pixel radii times the depth.
    fn walk(&self, view: &View, distance: f64, share: f64) -> Result<Vec<Option<f64>>, String> {
        let ratio = 1.0 + view.pixel_radius * share;
        let mut found: Vec<Option<f64>> = vec![None; view.rays.len()];
        let mut open: Vec<usize> = (0..view.rays.len()).collect();
        let mut t = distance * RANGE.0;
        while t < distance * RANGE.1 && !open.is_empty() {
            let depths: Vec<f64> = (0..CHUNK).map(|k| t * ratio.powi(k as i32)).collect();
            let points: Vec<[f64; 3]> =
                open.iter().flat_map(|&i| depths.iter().map(move |&t| point(view.rays[i], t))).collect();
            let inside = self.inside(&points)?;
            for (j, &i) in open.iter().enumerate() {
                found[i] = inside[j * CHUNK..(j + 1) * CHUNK].iter().position(|&x| x).map(|k| depths[k]);
            }
            open.retain(|&i| found[i].is_none());
            t *= ratio.powi(CHUNK as i32);
        }
        Ok(found)
    }
}

fn point((origin, direction): Ray, t: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| origin[i] + direction[i] * t)
}

#[cfg(test)]
mod tests {
    use super::{Candidate, DepthErrors, Depths, Measured, Target};

    #[test]
    fn a_precision_ends_where_its_error_first_grows() {
        let at = |zoom: f64, median_error: f64| DepthErrors {
            zoom,
            settled: 1.0,
            measured: vec![(Target::CpuF32, Measured { median_error, ..Measured::default() })],
        };
        let candidate = Candidate { method: None, form: None, fudge: 1.0, target: Target::CpuF64 };
        let depths =
            Depths { rays: 1, candidate, zooms: vec![at(1.0, 0.1), at(10.0, 0.4), at(100.0, 2.0), at(1e3, 0.1)] };
        assert_eq!(depths.end_of(Target::CpuF32), Some(10.0));
        assert_eq!(depths.end_of(Target::CpuF64), None);
    }
}
