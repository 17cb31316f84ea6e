//! The brute-force march.
//!
//! A ray is divided so that each step is a quarter of a pixel's footprint where it is; halving the step keeps all points
//! of the coarser division, so only those between are tried.

use super::membership::Members;
use super::{Ray, Scale, Truth, point};
use crate::check::subject::sphere_range;
use crate::march::Threshold;
use crate::math::random::Random;

/// Samples of a ray that are tried at once, and rays that are walked at once.
const CHUNK: usize = 64;
const BATCH: usize = 128;
/// Times that the step is halved at most: down to 1/128 of a footprint.
const LEVELS: u32 = 5;
/// First step in pixel radii: a quarter of a footprint.
const STEP: f64 = 0.5;
/// Halvings of the step around a crossing: down to 1/4096 of a footprint.
const BISECTIONS: usize = 10;

/// Points within a hit threshold of a hit, and how many of them must belong to the set at the footprint. Of 12 hits with no member
/// of a power-2 bulb that jumps on its axis 10 had fewer, two to eight; of the sponge none, of the Mandelbox with 250
/// iterations, where no hit has a member, a fifth.
const AROUND: usize = 256;
const LEAST_AROUND: usize = 9;

/// A brute-force march.
pub(super) struct Walker<'a> {
    pub(super) members: &'a Members,
    pub(super) scale: Scale,
}

/// One ray while it is walked.
struct Path {
    ray: Ray,
    /// Range of the ray's division, in steps of one pixel radius; empty if it misses the bounding sphere.
    from: f64,
    to: f64,
    /// First known sample inside, and its depth after bisection.
    first: Option<(f64, f64)>,
    /// Next sample of the level.
    next: usize,
    /// Halvings in a row that did not change the answer.
    agreed: u32,
    /// Whether finer steps are still needed.
    open: bool,
}

impl Walker<'_> {
    /// Depths of all rays, or of the first ones where `progress` said to stop.
    pub(super) fn settle(&self, rays: &[Ray], progress: &mut dyn FnMut(f64) -> bool) -> Vec<Truth> {
        let mut truths = Vec::with_capacity(rays.len());
        for batch in rays.chunks(BATCH) {
            let base = truths.len() as f64;
            let mut share = |part: f64| progress((base + part * batch.len() as f64) / rays.len() as f64);
            let Some(part) = self.settle_batch(batch, &mut share) else { break };
            truths.extend(part);
        }
        truths
    }

    fn settle_batch(&self, rays: &[Ray], progress: &mut dyn FnMut(f64) -> bool) -> Option<Vec<Truth>> {
        let mut paths: Vec<Path> = rays.iter().map(|ray| self.path(*ray)).collect();
        let mut truths = vec![Truth::Ambiguous; rays.len()];
        // Each level costs as much as all before it; most rays are settled when the answer has stood still often enough.
        let usual = f64::from(self.scale.agreements).exp2();
        self.walk(&mut paths, 0, &mut |part| progress(part / usual))?;
        for level in 1..=LEVELS {
            let before: Vec<Option<f64>> = paths.iter().map(|path| path.first.map(|(_, t)| t)).collect();
            let done = f64::from(level - 1).exp2() / usual;
            self.walk(&mut paths, level, &mut |part| progress((done * (1.0 + part)).min(1.0)))?;
            for ((path, truth), before) in paths.iter_mut().zip(&mut truths).zip(before).filter(|((p, _), _)| p.open) {
                let answer = match (before, path.first) {
                    (None, None) => Truth::Miss,
                    (Some(a), Some((_, b))) if (a - b).abs() <= self.scale.pixel.radius(b) => Truth::Hit(b),
                    _ => {
                        path.agreed = 0;
                        continue;
                    }
                };
                path.agreed += 1;
                if path.agreed >= self.scale.agreements {
                    *truth = answer;
                    path.open = false;
                }
            }
        }
        Some(truths)
    }

    fn path(&self, ray: Ray) -> Path {
        let (near, far) = sphere_range(ray.0, ray.1, self.scale.bounding_radius);
        let open = near < far;
        let (from, to) = if open { (self.division(near), self.division(far)) } else { (0.0, -1.0) };
        Path { ray, from, to, first: None, next: 0, agreed: 0, open: true }
    }

    /// The place of a depth in a ray's division, in which a pixel radius has length 1: linear up to `nearest`, then
    /// logarithmic. All of it is linear where pixels do not grow.
    fn division(&self, t: f64) -> f64 {
        let Scale { pixel: Threshold { pixel_radius, fixed }, nearest, .. } = self.scale;
        if fixed > 0.0 {
            return t / fixed;
        }
        if t < nearest { t / (nearest * pixel_radius) } else { (1.0 + (t / nearest).ln()) / pixel_radius }
    }

    /// The depth of a place in a ray's division.
    fn depth(&self, u: f64) -> f64 {
        let Scale { pixel: Threshold { pixel_radius, fixed }, nearest, .. } = self.scale;
        if fixed > 0.0 {
            return u * fixed;
        }
        let u = u * pixel_radius;
        if u < 1.0 { u * nearest } else { (u - 1.0).exp() * nearest }
    }

    fn inside(&self, places: &[(Ray, f64)]) -> Vec<bool> {
        let depths: Vec<f64> = places.iter().map(|(_, u)| self.depth(*u)).collect();
        let points: Vec<[f64; 3]> = places.iter().zip(&depths).map(|((ray, _), t)| point(*ray, *t)).collect();
        let eps: Vec<f64> = depths.iter().map(|t| self.scale.pixel.radius(*t)).collect();
        self.members.inside(&points, &eps)
    }

    /// Finds the first sample inside of every open path at a level; from the second level on only the new samples are
    /// tried. Gives nothing where `progress` said to stop.
    fn walk(&self, paths: &mut [Path], level: u32, progress: &mut dyn FnMut(f64) -> bool) -> Option<()> {
        let step = STEP * 0.5f64.powi(level as i32);
        // Sample k of a level: every one of the first, the odd ones of the others.
        let place = |path: &Path, k: usize| {
            let number = if level == 0 { k } else { 2 * k + 1 };
            path.from + step * number as f64
        };
        for path in paths.iter_mut() {
            path.next = 0;
        }
        let mut live: Vec<usize> = (0..paths.len()).filter(|&i| paths[i].open).collect();
        let mut found = vec![false; paths.len()];
        loop {
            live.retain(|&i| {
                let path = &paths[i];
                !found[i] && place(path, path.next) < path.first.map_or(path.to, |(u, _)| u)
            });
            if live.is_empty() {
                break;
            }
            let places: Vec<(Ray, f64)> = live
                .iter()
                .flat_map(|&i| (0..CHUNK).map(move |k| (i, k)))
                .map(|(i, k)| (paths[i].ray, place(&paths[i], paths[i].next + k)))
                .collect();
            let inside = self.inside(&places);
            for (j, &i) in live.iter().enumerate() {
                let path = &mut paths[i];
                let limit = path.first.map_or(path.to, |(u, _)| u);
                let own = j * CHUNK..(j + 1) * CHUNK;
                let first = own.clone().find(|&k| inside[k] && places[k].1 < limit);
                if let Some(k) = first {
                    found[i] = true;
                    path.first = Some((places[k].1, f64::NAN));
                }
                path.next += CHUNK;
            }
            let walked = |path: &Path| ((place(path, path.next) - path.from) / (path.to - path.from)).min(1.0);
            let part: f64 = live.iter().map(|&i| walked(&paths[i])).sum::<f64>() / live.len() as f64;
            let share = (paths.len() - live.len()) as f64 / paths.len() as f64;
            if !progress(share + (1.0 - share) * part) {
                return None;
            }
        }
        self.bisect(paths, &found, step);
        Some(())
    }

    /// Narrows the crossings that a level found; the sample before each is known to be outside.
    fn bisect(&self, paths: &mut [Path], found: &[bool], step: f64) {
        let hits: Vec<usize> = (0..paths.len()).filter(|&i| found[i]).collect();
        let mut brackets: Vec<(f64, f64)> = hits
            .iter()
            .map(|&i| paths[i].first.map_or((0.0, 0.0), |(u, _)| ((u - step).max(paths[i].from), u)))
            .collect();
        for _ in 0..BISECTIONS {
            let places: Vec<(Ray, f64)> =
                hits.iter().zip(&brackets).map(|(&i, (a, b))| (paths[i].ray, 0.5 * (a + b))).collect();
            for ((bracket, (_, middle)), inside) in brackets.iter_mut().zip(&places).zip(self.inside(&places)) {
                *(if inside { &mut bracket.1 } else { &mut bracket.0 }) = *middle;
            }
        }
        for (&i, (_, b)) in hits.iter().zip(brackets) {
            // The sample stays the limit of later levels: between it and the crossing all of this level's are known.
            let depth = self.depth(b);
            paths[i].first = paths[i].first.map(|(u, _)| (u, depth));
        }
    }

    /// Makes hits ambiguous that are on no member and have few points of the set at the footprint around them.
    pub(super) fn leave_hairs(&self, rays: &[Ray], truths: &mut [Truth]) {
        let hits: Vec<(usize, f64)> = (0..rays.len()).filter_map(|i| Some((i, truths[i].depth()?))).collect();
        let points: Vec<[f64; 3]> = hits.iter().map(|(i, t)| point(rays[*i], *t)).collect();
        let exact = self.members.inside(&points, &vec![0.0; points.len()]);
        let mut random = Random::new(1);
        for ((&(i, t), at), _) in hits.iter().zip(points).zip(exact).filter(|(_, exact)| !*exact) {
            let eps = self.scale.pixel.radius(t);
            let mut near = || {
                let offset = random.in_ball(eps);
                [0, 1, 2].map(|axis| at[axis] + offset[axis])
            };
            let around: Vec<[f64; 3]> = (0..AROUND).map(|_| near()).collect();
            let inside = self.members.inside(&around, &[eps; AROUND]);
            if inside.into_iter().filter(|inside| *inside).count() < LEAST_AROUND {
                truths[i] = Truth::Ambiguous;
            }
        }
    }

    /// Whether each ray stays inside for a hit threshold behind its hit.
    pub(super) fn thick(&self, rays: &[Ray], truths: &[Truth]) -> Vec<bool> {
        const SAMPLES: usize = 8;
        let mut places = Vec::new();
        for (ray, truth) in rays.iter().zip(truths) {
            let u = truth.depth().map_or(0.0, |t| self.division(t));
            places.extend((1..=SAMPLES).map(|k| (*ray, u + k as f64 / SAMPLES as f64)));
        }
        self.inside(&places).chunks(SAMPLES).map(|inside| inside.iter().all(|&x| x)).collect()
    }
}
