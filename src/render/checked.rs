//! Whether a picture's beams and its box can be trusted: some of its rays are marched with and without them.
//!
//! An estimate that overshoots does little harm to a ray, which goes back to where it came from once it is inside. A beam has no
//! ray of its own inside, so what its estimates pass is lost, tile by tile; and where rays step over thin things,
//! what they meet depends on where they start. Neither can be read off a formula. So the beams of a picture are tried on
//! rays spread over it. Proofs need no trial. The answer is a function of the pipeline and the settings
//! alone: always the CPU's, whatever the picture is rendered on.

use super::beams::{Beams, NOTHING};
use super::{BeamUse, Pipeline, RenderSettings};
use crate::compose::Bounds;
use crate::expr::Arena;
use crate::graph::Camera;
use crate::kernel::cpu::Cpu;
use crate::kernel::records::Marched;
use crate::kernel::{Backend, BackendError, Kernel, Status};
use crate::shade::{compose_camera, pixel_radius};

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
    let Some(beams) = &pipeline.beams else { return Ok(true) };
    if settings.beams == BeamUse::Untried || pipeline.plan.is_certified() {
        return Ok(true);
    }
    let Some(places) = sampled(settings) else { return Ok(false) };
    let cpu = cpu_of(settings);
    let kernels = beams.named();
    let named = |name: &str| {
        let kernel = kernels.iter().find(|(known, _)| *known == name).expect("beams have this kernel");
        cpu.prepare(arena, kernel.1)
    };
    let trial = Trial {
        beams: Beams::new(&beams.tiles, named)?,
        begin: named("begin")?,
        march: cpu.prepare(arena, &pipeline.march)?,
        footprint: 2.0 * pipeline.pixel_radius,
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
    let march = cpu.prepare(arena, march)?;
    let columns = cpu.upload(&centres(&places))?;
    let depths = |bounds: &Bounds| {
        let camera = cpu.prepare(arena, &Kernel::Map(compose_camera(arena, camera, settings.size, bounds)))?;
        let hits = cpu.run(&march, &[&cpu.run(&camera, &[&columns])?])?;
        let hits = cpu.download_only(&hits, &[Marched::COLUMNS.t, Marched::COLUMNS.status])?;
        let depth = |i: usize| (Status::from_code(hits[1][i]) == Status::Hit).then_some(hits[0][i]);
        Ok((0..places.len()).map(depth).collect::<Vec<_>>())
    };
    let footprint = 2.0 * pixel_radius(camera, settings.size);
    let elsewhere = differing(&depths(&Bounds::ball(bounds.radius))?, &depths(bounds)?, footprint);
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

/// Columns of the centres of pixels.
fn centres(pixels: &[(u32, u32)]) -> [Vec<f64>; 2] {
    let of = |of: fn(&(u32, u32)) -> u32| pixels.iter().map(|p| f64::from(of(p)) + 0.5).collect();
    [of(|p| p.0), of(|p| p.1)]
}

/// Rays of which one alone hits, or whose hits are apart.
fn differing(a: &[Option<f64>], b: &[Option<f64>], footprint: f64) -> usize {
    let differs = |(a, b): &(&Option<f64>, &Option<f64>)| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() > ELSEWHERE * footprint * a,
        (a, b) => a.is_some() != b.is_some(),
    };
    a.iter().zip(b).filter(differs).count()
}

/// Kernels of rays with and without beams.
struct Trial<'a> {
    cpu: &'a Cpu,
    beams: Beams<Cpu>,
    begin: <Cpu as Backend>::Prepared,
    march: <Cpu as Backend>::Prepared,
    /// Diameter of a pixel at distance 1.
    footprint: f64,
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
        Ok(differing(&alone, &with, self.footprint))
    }

    /// Depths of rays that begin at these depths.
    fn depths(&self, pixels: &[(u32, u32)], starts: Vec<f64>) -> Result<Vec<Option<f64>>, BackendError> {
        let are_nothing: Vec<bool> = starts.iter().map(|start| *start >= NOTHING).collect();
        let [x, y] = centres(pixels);
        let columns = self.cpu.upload(&[x, y, starts])?;
        let rays = self.cpu.run(&self.begin, &[&columns])?;
        let hits = self.cpu.run(&self.march, &[&rays])?;
        let hits = self.cpu.download_only(&hits, &[Marched::COLUMNS.t, Marched::COLUMNS.status])?;
        let depth = |i: usize| {
            let is_hit = !are_nothing[i] && Status::from_code(hits[1][i]) == Status::Hit;
            is_hit.then_some(hits[0][i])
        };
        Ok((0..pixels.len()).map(depth).collect())
    }
}
