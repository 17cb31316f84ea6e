//! Depth errors against zoom: the camera moves towards a point of the surface until the precision has no digits left.
//!
//! At zoom Z the camera is at the Zth part of its first distance from a surface point of the view, found by bisecting
//! membership to the last digit of f64, and looks at it. The truth is found by brute force anew at each zoom.

use super::{Backends, Candidate, Measured, Subject, Target, View, find_truths, march_kernel};
use crate::check::truth::{Ray, Scale, Truths, ends, point, ray_columns};
use crate::graph::Camera;
use crate::shade::{CameraFrame, Size};

/// Rays at each zoom.
const RAYS: usize = 48;
/// The picture whose pixels they go through.
const SIZE: Size = Size { width: 160, height: 90 };
/// Part of the distance to the surface point below which the steps of brute force no longer shrink.
const NEAREST: f64 = 0.01;
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
    /// The largest zoom up to which a target's median error stays within [`GOOD`] footprints; nothing if the first one
    /// exceeds it already.
    pub fn end_of(&self, target: Target) -> Option<f64> {
        let good = |errors: &&DepthErrors| {
            errors.measured.iter().any(|(t, measured)| *t == target && measured.median_error <= GOOD)
        };
        let judged = self.zooms.iter().filter(|errors| errors.settled >= SETTLED);
        judged.take_while(good).last().map(|errors| errors.zoom)
    }
}

/// Marches towards a surface point of the view at zooms from 1 to 10^`decades`. Errors where nothing is hit, and those of
/// back ends. `progress` receives the share that is done.
pub fn measure(
    subject: &Subject,
    (view, truths): (&View, &Truths),
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
        least_step: None,
        target: Target::CPU_F64,
    };
    let (ray, distance) = surface_point(subject, view, truths)?;
    let mut zooms = Vec::new();
    for decade in 0..=decades {
        let zoom = 10f64.powi(decade as i32);
        let near = zoomed(view, ray, distance, zoom);
        let share = |part: f64| (f64::from(decade) + part) / f64::from(decades + 1);
        let truths = find_truths(subject, &near, &mut |part| progress(share(0.9 * part)))?;
        let columns = ray_columns(&near.rays, near.scale.bounding_radius);
        let mut measured = Vec::new();
        for &target in targets {
            let march = march_kernel(subject, plan, &Candidate { target, ..candidate }, near.scale.pixel)?;
            let out = backends.run(target, subject.arena, &march, &columns).map_err(|error| error.to_string())?;
            measured.push((target, Measured::new(&truths.judge(&ends(&out, near.rays.len())), 0.0)));
        }
        let settled = truths.counts()[0] as f64 / near.rays.len() as f64;
        zooms.push(DepthErrors { zoom, settled, measured });
        progress(share(1.0));
    }
    Ok(Depths { rays: RAYS, candidate, zooms })
}

/// The view from the `zoom`th part of the distance, straight in front of the ray's hit.
fn zoomed(view: &View, (origin, direction): Ray, distance: f64, zoom: f64) -> View {
    let position = point((origin, direction), distance * (1.0 - 1.0 / zoom));
    let up = CameraFrame::new(&view.camera).up;
    // The frame is made about the origin, where no digit of the direction is lost.
    let frame = Camera { position: [0.0; 3], target: direction, up, ..view.camera };
    let mut near = View::of_camera(frame, SIZE, view.scale.bounding_radius, RAYS);
    near.camera.position = position;
    near.rays.iter_mut().for_each(|ray| ray.0 = position);
    near.scale = Scale { nearest: NEAREST * distance / zoom, agreements: 1, ..near.scale };
    near
}

/// The hit nearest to the middle of the view: its ray, and its depth to the last digit.
fn surface_point(subject: &Subject, view: &View, truths: &Truths) -> Result<(Ray, f64), String> {
    let forward = CameraFrame::new(&view.camera).forward;
    let centred = |ray: &Ray| (0..3).map(|i| ray.1[i] * forward[i]).sum::<f64>();
    let hits = truths.rays.iter().zip(&truths.depths).filter_map(|(ray, truth)| Some((*ray, truth.depth()?)));
    let nearest = hits.max_by(|a, b| centred(&a.0).total_cmp(&centred(&b.0)));
    let (ray, t) =
        nearest.ok_or_else(|| format!("no sampled ray of {} hits anything to move towards", subject.graph.name))?;
    // The truth is inside by less than a footprint.
    let (mut outside, mut inside) = (t - truths.scale.footprint(t), t);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (outside + inside);
        match truths.members().inside(&[point(ray, middle)], &[0.0])[0] {
            true => inside = middle,
            false => outside = middle,
        }
    }
    Ok((ray, outside))
}

#[cfg(test)]
mod tests {
    use super::{Candidate, DepthErrors, Depths, Measured, Target};

    #[test]
    fn a_precision_ends_where_its_error_first_grows() {
        let at = |zoom: f64, median_error: f64| DepthErrors {
            zoom,
            settled: 1.0,
            measured: vec![(Target::CPU_F32, Measured { median_error, ..Measured::default() })],
        };
        let candidate = Candidate { method: None, form: None, fudge: 1.0, least_step: None, target: Target::CPU_F64 };
        let depths =
            Depths { rays: 1, candidate, zooms: vec![at(1.0, 0.1), at(10.0, 0.4), at(100.0, 2.0), at(1e3, 0.1)] };
        assert_eq!(depths.end_of(Target::CPU_F32), Some(10.0));
        assert_eq!(depths.end_of(Target::CPU_F64), None);
    }
}
