//! Whether a picture's beams and its box can be trusted: some of its rays are marched with and without them.
//!
//! An estimate that overshoots does little harm to a ray, which goes back to where it came from once it is inside. A beam has no
//! ray of its own inside, so what its estimates pass is lost, tile by tile; and where rays step over thin things,
//! what they meet depends on where they start. Neither can be read off a formula. So the beams of a picture are tried on
//! rays spread over it. Proofs need no trial. The answer is a function of the pipeline and the settings
//! alone: always the CPU's, whatever the picture is rendered on.

use super::beams::{Beams, NOTHING};
use super::passes::{self, Chain, Passes, Role, Slot, centres};
use super::{BeamUse, Pipeline, RenderSettings};
use crate::compose::Bounds;
use crate::expr::Arena;
use crate::graph::Camera;
use crate::kernel::cpu::Cpu;
use crate::kernel::{Backend, BackendError, Kernel};
use crate::march::Threshold;
use crate::shade::{compose_camera, threshold};

/// Rays that are marched with and without at most, and which share of a picture's.
const MOST_RAYS: u64 = 4096;
const ONE_OF: u64 = 16;
/// A picture whose share is less than this has no beams: they save less there than a trial costs.
const LEAST_RAYS: u64 = 256;
/// Rays that one may end elsewhere of: half of the 0.1 % that a picture may be off by. Single rays that graze end
/// elsewhere in every fourth picture, so that fewer would tell of chance.
const ONE_ELSEWHERE: usize = 2048;
/// Rays that are marched first: where many end elsewhere these tell.
const FIRST: usize = 256;
/// Footprints by which a hit may lie elsewhere.
const ELSEWHERE: f64 = 2.0;
/// A stride through a picture's pixels that meets every row and column.
const STRIDE: u64 = 7919;

/// Whether rays that begin where a picture's beams end come to what they come to alone.
pub fn beams_hold(arena: &Arena, pipeline: &Pipeline, settings: &RenderSettings) -> Result<bool, BackendError> {
    let Some(tiles) = &pipeline.tiles else { return Ok(true) };
    if settings.beams == BeamUse::Untried || pipeline.plan.is_certified() {
        return Ok(true);
    }
    let Some(places) = sampled(settings) else { return Ok(false) };
    let cpu = cpu_of(settings);
    let passes = &pipeline.passes;
    let trial = Trial {
        beams: Beams::new(tiles, passes, |pass| cpu.prepare(arena, &pass.kernel))?,
        begin: Chain::compile(&cpu, arena, passes, &[Slot::Begins], &[Slot::Rays])?,
        march: Chain::compile(&cpu, arena, passes, &[Slot::Rays], &[Slot::Ends])?,
        pixel: pipeline.pixel,
        cpu: &cpu,
    };
    let may = places.len() / ONE_ELSEWHERE;
    let (first, others) = places.split_at(FIRST.min(places.len()));
    let mut elsewhere = trial.elsewhere(first)?;
    if elsewhere <= may {
        elsewhere += trial.elsewhere(others)?;
    }
    Ok(elsewhere <= may)
}

/// Whether rays that begin at a box come to what they come to from the sphere around it. `march` is that of the picture.
pub(super) fn box_holds(
    arena: &Arena,
    camera: &Camera,
    settings: &RenderSettings,
    bounds: &Bounds,
    march: &Kernel,
) -> Result<bool, BackendError> {
    let Some(places) = sampled(settings) else { return Ok(false) };
    let cpu = cpu_of(settings);
    let mut passes = Passes::default();
    passes.push(Role::March, [Slot::Rays], Slot::Ends, march.clone());
    let march = Chain::compile(&cpu, arena, &passes, &[Slot::Rays], &[Slot::Ends])?;
    let points = centres(&places);
    let depths = |bounds: &Bounds| {
        let camera = cpu.prepare(arena, &Kernel::Map(compose_camera(arena, camera, settings.size, bounds)))?;
        let rays = cpu.run(&camera, &[&cpu.upload(&points)?])?;
        passes::depths(&cpu, &passes::march(&cpu, &march, &rays)?)
    };
    let pixel = threshold(camera, settings.size);
    let elsewhere = differing(&depths(&Bounds::ball(bounds.radius))?, &depths(bounds)?, pixel);
    Ok(elsewhere <= places.len() / ONE_ELSEWHERE)
}

/// Pixels spread over a picture; `None` where it has too few samples for a trial.
fn sampled(settings: &RenderSettings) -> Option<Vec<(u32, u32)>> {
    let [width, height, samples] = [settings.size.width, settings.size.height, settings.samples.max(1)].map(u64::from);
    let pixels = width * height;
    let count = (pixels * samples * samples / ONE_OF).min(MOST_RAYS).min(pixels);
    let stride = if pixels.is_multiple_of(STRIDE) { STRIDE + 2 } else { STRIDE };
    let place = |k: u64| (((k * stride % pixels) % width) as u32, ((k * stride % pixels) / width) as u32);
    (count >= LEAST_RAYS).then(|| (0..count).map(place).collect())
}

/// The same machine code everywhere: sines of longer vectors differ in their last bits.
fn cpu_of(settings: &RenderSettings) -> Cpu {
    Cpu::new(settings.precision).narrow()
}

/// Rays of which one alone hits, or whose hits are apart.
fn differing(a: &[Option<f64>], b: &[Option<f64>], pixel: Threshold) -> usize {
    let differs = |(a, b): &(&Option<f64>, &Option<f64>)| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() > ELSEWHERE * pixel.footprint(*a),
        (a, b) => a.is_some() != b.is_some(),
    };
    a.iter().zip(b).filter(differs).count()
}

/// Kernels of rays with and without beams.
struct Trial<'a> {
    cpu: &'a Cpu,
    beams: Beams<Cpu>,
    begin: Chain<Cpu>,
    march: Chain<Cpu>,
    /// Radius of a pixel.
    pixel: Threshold,
}

impl Trial<'_> {
    /// Rays through the centres of pixels that end elsewhere where they begin at the ends of beams.
    fn elsewhere(&self, pixels: &[(u32, u32)]) -> Result<usize, BackendError> {
        if pixels.is_empty() {
            return Ok(0);
        }
        let starts = self.beams.starts_of(self.cpu, pixels)?;
        let alone = self.depths(pixels, vec![0.0; pixels.len()])?;
        let with = self.depths(pixels, starts)?;
        Ok(differing(&alone, &with, self.pixel))
    }

    /// Depths of rays that begin at these depths.
    fn depths(&self, pixels: &[(u32, u32)], starts: Vec<f64>) -> Result<Vec<Option<f64>>, BackendError> {
        let are_nothing: Vec<bool> = starts.iter().map(|start| *start >= NOTHING).collect();
        let [x, y] = centres(pixels);
        let rays = self.begin.write(self.cpu, Slot::Begins, &[x, y, starts], Slot::Rays)?;
        let depths = passes::depths(self.cpu, &passes::march(self.cpu, &self.march, &rays)?)?;
        let depth = |(depth, is_nothing): (Option<f64>, bool)| depth.filter(|_| !is_nothing);
        Ok(depths.into_iter().zip(are_nothing).map(depth).collect())
    }
}
