//! The error of finite differences against their step, at points near the surface.
//!
//! The exact gradient's estimate in f64 is the reference: with a large step a difference misses the curvature of r, with a
//! small one it is rounding alone, and between them lies the window of usable steps.

use super::{Backends, Subject, Target};
use crate::check::subject::estimator_columns;
use crate::check::truth::{Truths, point};
use crate::graph::Method;
use crate::kernel::Kernel;

/// Points stand this many footprints in front of their hits.
pub const FOOTPRINTS: f64 = 10.0;
/// Median relative error up to which a step is usable.
pub const USABLE: f64 = 0.05;
/// Steps measured in each decade.
const PER_DECADE: i32 = 4;
/// The range of steps, as powers of ten.
const DECADES: (i32, i32) = (-15, 0);

/// Errors at one step.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct StepError {
    /// The step, in world units.
    pub h: f64,
    /// Median relative error of the estimate; infinite where most are not numbers.
    pub median: f64,
    /// The error that nine of ten points stay below.
    pub ninth: f64,
}

/// Errors over all steps on one back end and precision.
#[derive(Clone, PartialEq, Debug)]
pub struct StepCurve {
    /// Back end and precision.
    pub target: Target,
    /// From the smallest step to the largest.
    pub errors: Vec<StepError>,
}

impl StepCurve {
    /// The widest run of steps whose median error is at most [`USABLE`]; nothing if no step is.
    pub fn window(&self) -> Option<(f64, f64)> {
        let runs = self.errors.split(|e| e.median > USABLE).filter(|run| !run.is_empty());
        let longest = runs.max_by_key(|run| run.len())?;
        Some((longest[0].h, longest[longest.len() - 1].h))
    }
}

/// What was found for one formula.
#[derive(Clone, PartialEq, Debug)]
pub struct StepSizes {
    /// Points compared.
    pub points: usize,
    /// Median of the exact estimates, in world units.
    pub estimate: f64,
    /// One for each target.
    pub curves: Vec<StepCurve>,
}

/// Compares the estimate of `delta` with the exact gradient's. Errors where the formula has no exact gradient or no hits, and
/// those of back ends. `progress` receives the share that is done.
pub fn measure(
    subject: &Subject,
    truths: &Truths,
    backends: &Backends,
    targets: &[Target],
    progress: &mut dyn FnMut(f64),
) -> Result<StepSizes, String> {
    let kernel = |method: Method| -> Result<Kernel, String> {
        let choices = subject.choices(Some(method)).filter(|choices| !choices.is_empty());
        let choices = choices.ok_or_else(|| {
            format!(
                "the method `{}` does not apply to {}, so there is nothing to compare",
                method.name(),
                subject.graph.name
            )
        })?;
        subject.estimator(&choices).map_err(|error| error.rendered(&subject.library.sources))
    };
    let (exact, delta) = (kernel(Method::Gradient)?, kernel(Method::Delta)?);
    let points = near_points(truths);
    let run = |target: Target, kernel: &Kernel, points: &[[f64; 3]], h: f64| {
        let columns = estimator_columns(points, &vec![h; points.len()], 1e-9);
        backends.run(target, subject.arena, kernel, &columns).map_err(|error| error.to_string())
    };
    let out = run(Target::CPU_F64, &exact, &points, 1e-6)?;
    let usable = |i: usize| out[1][i] < 0.5 && out[0][i].is_finite() && out[0][i] > 0.0;
    let (points, wanted): (Vec<[f64; 3]>, Vec<f64>) =
        (0..points.len()).filter(|&i| usable(i)).map(|i| (points[i], out[0][i])).unzip();
    if points.is_empty() {
        return Err(format!("no sampled ray of {} has a hit", subject.graph.name));
    }
    let steps: Vec<f64> = (DECADES.0 * PER_DECADE..=DECADES.1 * PER_DECADE)
        .map(|k| 10f64.powf(f64::from(k) / f64::from(PER_DECADE)))
        .collect();
    let mut curves = Vec::new();
    for (i, &target) in targets.iter().enumerate() {
        let mut errors = Vec::new();
        for (j, &h) in steps.iter().enumerate() {
            errors.push(step_error(h, &run(target, &delta, &points, h)?[0], &wanted));
            progress((i * steps.len() + j + 1) as f64 / (targets.len() * steps.len()) as f64);
        }
        curves.push(StepCurve { target, errors });
    }
    let mut sorted = wanted;
    sorted.sort_by(f64::total_cmp);
    Ok(StepSizes { points: points.len(), estimate: sorted[sorted.len() / 2], curves })
}

fn near_points(truths: &Truths) -> Vec<[f64; 3]> {
    let hits = truths.rays.iter().zip(&truths.depths).filter_map(|(ray, truth)| Some((ray, truth.depth()?)));
    hits.map(|(ray, t)| point(*ray, t - FOOTPRINTS * truths.scale.footprint(t))).collect()
}

fn step_error(h: f64, found: &[f64], wanted: &[f64]) -> StepError {
    let relative = |(found, wanted): (&f64, &f64)| match (found / wanted - 1.0).abs() {
        error if error.is_nan() => f64::INFINITY,
        error => error,
    };
    let mut errors: Vec<f64> = found.iter().zip(wanted).map(relative).collect();
    errors.sort_by(f64::total_cmp);
    StepError { h, median: errors[errors.len() / 2], ninth: errors[errors.len() * 9 / 10] }
}

#[cfg(test)]
mod tests {
    use super::{StepCurve, StepError, Target, step_error};

    #[test]
    fn windows_are_the_widest_usable_run() {
        let at = |h: f64, median: f64| StepError { h, median, ninth: median };
        let errors = vec![at(1.0, 0.01), at(2.0, 0.5), at(3.0, 0.04), at(4.0, 0.05), at(5.0, f64::INFINITY)];
        assert_eq!(StepCurve { target: Target::CPU_F32, errors }.window(), Some((3.0, 4.0)));
        assert_eq!(StepCurve { target: Target::CPU_F32, errors: vec![at(1.0, 1.0)] }.window(), None);
    }

    #[test]
    fn errors_are_relative_and_nan_is_the_worst() {
        let error = step_error(0.1, &[2.2, f64::NAN, 2.0], &[2.0, 2.0, 2.0]);
        assert!((error.median - 0.1).abs() < 1e-12 && error.ninth == f64::INFINITY);
    }
}
