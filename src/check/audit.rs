//! A picture marched again with proofs: what of it is certain, and where its estimate was wrong.
//!
//! Sampled pixels are marched twice in f64, with the estimate in question and with `certified`. A proof says that a
//! stretch of the ray holds no point of the set; a hit of either march ends on a point that is in it. So a surface in front
//! of, or beside, what is proven empty is a false one, and a point of the set in front of the estimate's answer was
//! missed: both are certain, whatever else is undecided.

use crate::compose::Composer;
use crate::diag::Diagnostic;
use crate::graph::{EstimateSettings, Method};
use crate::kernel::BackendError;
use crate::kernel::cpu::Cpu;
use crate::kernel::records::Marched;
use crate::march::{Threshold, is_undecided};
use crate::math::Precision;
use crate::math::random::Random;
use crate::render::passes::centres;
use crate::render::{Marches, Pipeline, RenderSettings, compose_pipeline};

/// Rays that are marched at once, between two reports of progress.
const BATCH: usize = 512;
/// Footprints (pixel diameters at the hit) that two depths of one surface may differ by.
const SLACK: f64 = 2.0;

/// What an audit found. Counts are of rays.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Audit {
    /// Rays, one through the middle of each sampled pixel.
    pub rays: usize,
    /// Proven to meet nothing inside the bounding sphere.
    pub empty: usize,
    /// Proven empty up to within a few thresholds of a point of the set.
    pub hit: usize,
    /// Neither.
    pub undecided: usize,
    /// Rays on which the estimate was wrong.
    pub wrong: Vec<Wrong>,
    /// Estimates and orbits a ray: of the method in question and of `certified`.
    pub steps: [f64; 2],
    /// Name of the method in question.
    pub method: &'static str,
}

/// A ray on which the estimate was wrong.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Wrong {
    /// Column and row of the pixel.
    pub pixel: (u32, u32),
    /// How.
    pub kind: Mistake,
    /// Depth of the estimate's hit.
    pub estimated: Option<f64>,
    /// Depth of the point of the set that the certified march met.
    pub certified: Option<f64>,
}

/// How an estimate was wrong.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mistake {
    /// It shows a surface where the ray is proven empty.
    False,
    /// It stopped more than two footprints in front, on a stretch that is proven empty.
    Early,
    /// It went more than two footprints behind a point of the set, or met nothing at all.
    Missed,
}

impl Mistake {
    /// The name in listings.
    pub fn name(self) -> &'static str {
        match self {
            Mistake::False => "false surface",
            Mistake::Early => "early stop",
            Mistake::Missed => "missed hit",
        }
    }
}

impl Audit {
    /// How many rays have this mistake.
    pub fn count(&self, kind: Mistake) -> usize {
        self.wrong.iter().filter(|wrong| wrong.kind == kind).count()
    }
}

/// Audits `rays` sampled pixels of a picture. `progress` receives the share that is done.
pub fn audit(
    composer: &Composer,
    settings: &RenderSettings,
    rays: usize,
    progress: &mut dyn FnMut(f64),
) -> Result<Audit, Diagnostic> {
    let settings = RenderSettings { precision: Precision::F64, ..settings.clone() };
    let proofs = RenderSettings {
        estimate: EstimateSettings { method: Some(Method::Certified), fudge: Some(1.0), ..settings.estimate },
        ..settings.clone()
    };
    let pipelines = [compose_pipeline(composer, &settings)?, compose_pipeline(composer, &proofs)?];
    let mut audit =
        Audit { method: pipelines[0].plan.choices.first().map_or("own", |c| c.method.name()), ..Audit::default() };
    let mut random = Random::new(7);
    let pixels: Vec<(u32, u32)> = (0..rays)
        .map(|_| {
            (random.below(settings.size.width as usize) as u32, random.below(settings.size.height as usize) as u32)
        })
        .collect();
    let work = |pixels: &[(u32, u32)]| -> Result<[Vec<Vec<f64>>; 2], BackendError> {
        let march = |pipeline: &Pipeline| march_pixels(composer, pipeline, pixels);
        Ok([march(&pipelines[0])?, march(&pipelines[1])?])
    };
    for (i, batch) in pixels.chunks(BATCH).enumerate() {
        let [estimated, certified] = work(batch).map_err(|error| Diagnostic::error(error.to_string()))?;
        audit.add(batch, &estimated, &certified, pipelines[0].pixel);
        progress(((i + 1) * BATCH).min(rays) as f64 / rays as f64);
    }
    for steps in &mut audit.steps {
        *steps /= rays.max(1) as f64;
    }
    Ok(audit)
}

/// The march's columns for the middles of pixels.
fn march_pixels(
    composer: &Composer,
    pipeline: &Pipeline,
    pixels: &[(u32, u32)],
) -> Result<Vec<Vec<f64>>, BackendError> {
    let cpu = Cpu::new(Precision::F64);
    Ok(Marches::new(&cpu, composer.arena, &pipeline.passes)?.run(&cpu, &centres(pixels))?.ends)
}

impl Audit {
    fn add(&mut self, pixels: &[(u32, u32)], estimated: &[Vec<f64>], certified: &[Vec<f64>], pixel: Threshold) {
        let ends = Marched::of(estimated).rays().zip(Marched::of(certified).rays());
        for (place, (estimated, certified)) in pixels.iter().zip(ends) {
            self.rays += 1;
            self.steps[0] += estimated.steps;
            self.steps[1] += certified.steps;
            let open = is_undecided(certified.last_de, certified.steps, certified.end());
            let (found, proven) = (estimated.depth(), certified.depth());
            match (open, proven) {
                (true, _) => self.undecided += 1,
                (false, Some(_)) => self.hit += 1,
                (false, None) => self.empty += 1,
            }
            let footprints = |a: f64, b: f64| (a - b) / pixel.footprint(b);
            let kind = match (found, proven) {
                (Some(_), None) if !open => Mistake::False,
                (Some(a), Some(b)) if !open && footprints(a, b) < -SLACK => Mistake::Early,
                (Some(a), Some(b)) if footprints(a, b) > SLACK => Mistake::Missed,
                (None, Some(_)) => Mistake::Missed,
                _ => continue,
            };
            self.wrong.push(Wrong { pixel: *place, kind, estimated: found, certified: proven });
        }
    }
}
