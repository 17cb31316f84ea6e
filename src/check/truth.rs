//! Depths found without any estimate: fixed small steps and membership alone, in f64.
//!
//! A ray is walked at a quarter of a pixel's footprint, then bisected; then again at half the step, until the depth stands
//! still to half a footprint. Rays that never settle graze the set or meet dust, and judge no estimate: they are
//! [`Truth::Ambiguous`].

use super::backends::{Backends, Target};
use super::formula::rendered;
use super::random::Random;
use super::subject::{Subject, estimator_columns, sphere_range};
use crate::kernel::{BackendError, Kernel};
use crate::render::{RenderSettings, compose_pipeline};
use crate::shade::{CameraFrame, pixel_radius};

/// Samples of a ray that are evaluated at once.
const CHUNK: usize = 64;
/// Times that the step is halved.
const LEVELS: u32 = 3;
/// Halvings of the interval around a crossing.
const BISECTIONS: usize = 10;

/// A ray's first crossing into the set.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Truth {
    /// At this depth.
    Hit(f64),
    /// Nowhere in the bounding sphere.
    Miss,
    /// Finer steps kept changing the answer.
    Ambiguous,
}

/// How the estimates of a formula do against the truth of one view.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Judgement {
    /// Rays with a settled hit.
    pub hits: usize,
    /// Rays left out.
    pub ambiguous: usize,
    /// Hits on something thinner than a hit threshold (half a footprint) along the ray: less than a pixel can show.
    pub thin: usize,
    /// Share of the hits, without the thin ones, that the march passed or met more than two footprints behind.
    pub missed: f64,
    /// The same share of the thin hits.
    pub missed_thin: f64,
    /// Share of the hits that the march met more than two footprints in front.
    pub early: f64,
    /// Median of the depth error of the hits, in footprints (a footprint is a pixel's diameter at the hit).
    pub median_error: f64,
}

/// A ray: origin and unit direction.
pub type Ray = ([f64; 3], [f64; 3]);

/// First crossings of rays. `radius` is the radius of a pixel at distance 1.
pub fn depths(subject: &Subject, rays: &[Ray], radius: f64) -> Result<Vec<Truth>, String> {
    let kernel = subject.estimator(&subject.plan.choices).map_err(|error| rendered(error, subject.library))?;
    let walker = Walker { subject, kernel, backends: Backends::cpu_only(), radius };
    walker.settle(rays).map_err(|error| error.to_string())
}

struct Walker<'a> {
    subject: &'a Subject<'a>,
    kernel: Kernel,
    backends: Backends,
    radius: f64,
}

impl Walker<'_> {
    fn settle(&self, rays: &[Ray]) -> Result<Vec<Truth>, BackendError> {
        let mut truths = vec![Truth::Ambiguous; rays.len()];
        let mut open: Vec<usize> = (0..rays.len()).collect();
        let mut last = self.walk(rays, &open, 1.0)?;
        for level in 1..=LEVELS {
            let next = self.walk(rays, &open, 0.5f64.powi(level as i32))?;
            let mut still = Vec::new();
            let mut kept = Vec::new();
            for (k, &i) in open.iter().enumerate() {
                match (last[k], next[k]) {
                    (None, None) => truths[i] = Truth::Miss,
                    (Some(a), Some(b)) if (a - b).abs() <= self.radius * b => truths[i] = Truth::Hit(b),
                    _ => {
                        still.push(i);
                        kept.push(next[k]);
                    }
                }
            }
            (open, last) = (still, kept);
        }
        Ok(truths)
    }

    fn inside(&self, points: &[[f64; 3]]) -> Result<Vec<bool>, BackendError> {
        let columns = estimator_columns(points, &vec![1e-6; points.len()], 1e-9);
        let out = self.backends.run(Target::CpuF64, self.subject.arena, &self.kernel, &columns)?;
        Ok(out[1].iter().map(|&inside| inside > 0.5).collect())
    }

    /// Whether the ray stays inside for a hit threshold behind each hit.
    fn thick(&self, rays: &[Ray], truths: &[Truth]) -> Result<Vec<bool>, BackendError> {
        const SAMPLES: usize = 8;
        let mut points = Vec::new();
        for (ray, truth) in rays.iter().zip(truths) {
            let t = if let Truth::Hit(t) = truth { *t } else { 0.0 };
            points.extend((1..=SAMPLES).map(|k| point(*ray, t * (1.0 + self.radius * k as f64 / SAMPLES as f64))));
        }
        Ok(self.inside(&points)?.chunks(SAMPLES).map(|inside| inside.iter().all(|&x| x)).collect())
    }

    /// First crossings at a share of the usual step.
    fn walk(&self, rays: &[Ray], which: &[usize], share: f64) -> Result<Vec<Option<f64>>, BackendError> {
        let ranges: Vec<(f64, f64)> =
            which.iter().map(|&i| sphere_range(rays[i].0, rays[i].1, self.subject.plan.bounding_radius)).collect();
        let mut t: Vec<f64> = ranges.iter().map(|r| r.0).collect();
        let mut found: Vec<Option<(f64, f64)>> = vec![None; which.len()];
        let mut open: Vec<usize> = (0..which.len()).filter(|&k| ranges[k].0 < ranges[k].1).collect();
        while !open.is_empty() {
            let step = |k: usize| (self.radius * t[k]).max(1e-7) * 0.5 * share;
            let points: Vec<[f64; 3]> = open
                .iter()
                .flat_map(|&k| (0..CHUNK).map(move |s| (k, s)))
                .map(|(k, s)| point(rays[which[k]], t[k] + step(k) * s as f64))
                .collect();
            let inside = self.inside(&points)?;
            for (j, &k) in open.iter().enumerate() {
                let at = |s: usize| t[k] + step(k) * s as f64;
                if let Some(s) = inside[j * CHUNK..(j + 1) * CHUNK].iter().position(|&x| x) {
                    found[k] = Some((if s == 0 { at(0) - step(k) } else { at(s - 1) }, at(s)));
                }
            }
            for &k in &open {
                let whole = (self.radius * t[k]).max(1e-7) * 0.5 * share * CHUNK as f64;
                t[k] += whole;
            }
            open.retain(|&k| found[k].is_none() && t[k] < ranges[k].1);
        }
        self.bisect(rays, which, found)
    }

    fn bisect(
        &self,
        rays: &[Ray],
        which: &[usize],
        mut found: Vec<Option<(f64, f64)>>,
    ) -> Result<Vec<Option<f64>>, BackendError> {
        let hits: Vec<usize> = (0..found.len()).filter(|&k| found[k].is_some()).collect();
        for _ in 0..BISECTIONS {
            let middles: Vec<f64> = hits.iter().map(|&k| found[k].map_or(0.0, |(a, b)| 0.5 * (a + b))).collect();
            let points: Vec<[f64; 3]> = hits.iter().zip(&middles).map(|(&k, &m)| point(rays[which[k]], m)).collect();
            let inside = self.inside(&points)?;
            for ((&k, &m), inside) in hits.iter().zip(&middles).zip(inside) {
                found[k] = found[k].map(|(a, b)| if inside { (a, m) } else { (m, b) });
            }
        }
        Ok(found.into_iter().map(|f| f.map(|(_, b)| b)).collect())
    }
}

fn point((origin, direction): Ray, t: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| origin[i] + direction[i] * t)
}

/// Marches random rays of the formula's own view with the chosen method in f64 and compares them with the truth.
pub fn judge(subject: &Subject, rays: usize, settings: &RenderSettings) -> Result<Judgement, String> {
    let size = settings.size;
    let pipeline = compose_pipeline(&subject.composer(), settings).map_err(|e| rendered(e, subject.library))?;
    let camera = pipeline.camera;
    let frame = CameraFrame::new(&camera);
    let radius = pixel_radius(&camera, size);
    let mut random = Random::new(4);
    let mut ray = || {
        let right = radius * 2.0 * (random.unit() - 0.5) * f64::from(size.width);
        let up = radius * 2.0 * (random.unit() - 0.5) * f64::from(size.height);
        let d = [0, 1, 2].map(|i| frame.right[i] * right + frame.up[i] * up + frame.forward[i]);
        (camera.position, glam::DVec3::from(d).normalize().to_array())
    };
    let rays: Vec<Ray> = (0..rays).map(|_| ray()).collect();
    let truths = depths(subject, &rays, radius)?;
    let mut columns = vec![Vec::new(); 8];
    for (origin, direction) in &rays {
        let (near, far) = sphere_range(*origin, *direction, subject.plan.bounding_radius);
        let values = origin.iter().chain(direction).copied().chain([near, far]);
        columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
    }
    let backends = Backends::cpu_only();
    let out = backends.run(Target::CpuF64, subject.arena, &pipeline.march, &columns).map_err(|e| e.to_string())?;
    let kernel = subject.estimator(&subject.plan.choices).map_err(|error| rendered(error, subject.library))?;
    let thick = Walker { subject, kernel, backends, radius }.thick(&rays, &truths).map_err(|e| e.to_string())?;
    Ok(compare(&truths, &thick, &out, radius))
}

fn compare(truths: &[Truth], thick: &[bool], out: &[Vec<f64>], radius: f64) -> Judgement {
    let mut judgement = Judgement::default();
    let mut errors = Vec::new();
    for (i, truth) in truths.iter().enumerate() {
        judgement.ambiguous += usize::from(*truth == Truth::Ambiguous);
        let Truth::Hit(truth) = *truth else { continue };
        judgement.hits += 1;
        let is_hit = out[5][i] == crate::kernel::Status::Hit.code();
        let footprint = 2.0 * radius * truth;
        let error = (out[0][i] - truth) / footprint;
        let missed = f64::from(u8::from(!is_hit || error > 2.0));
        match thick[i] {
            true => judgement.missed += missed,
            false => judgement.missed_thin += missed,
        }
        judgement.thin += usize::from(!thick[i]);
        judgement.early += f64::from(u8::from(is_hit && error < -2.0));
        errors.push(if is_hit { error.abs() } else { f64::INFINITY });
    }
    errors.sort_by(f64::total_cmp);
    judgement.missed /= (judgement.hits - judgement.thin).max(1) as f64;
    judgement.missed_thin /= judgement.thin.max(1) as f64;
    judgement.early /= judgement.hits.max(1) as f64;
    judgement.median_error = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
    judgement
}
