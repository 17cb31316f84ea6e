//! Pictures of paths of light: sample after sample of a tile's pixels, each followed from surface to surface.

use std::ops::Range;

use super::developed::Developed;
use super::meter::Meter;
use super::passes::{Chain, Pass, Passes, Role, Slot};
use super::picture::Halt;
use super::pixels::Pixels;
use super::renderer::timed;
use super::{PathTracing, Renderer, Stats};
use crate::film::{LightSum, Rows, Tile, windows};
use crate::kernel::records::{Marched, Path, Random};
use crate::kernel::{Backend, BackendError};
use crate::shade::first_path;

/// Passes of a path's point, made ready on a back end.
pub(super) struct Tracer<B: Backend> {
    point: Chain<B>,
    /// Rays and ends to the ends of those inside what light goes through, where light does.
    inner: Option<Chain<B>>,
    /// Rays to those through the opening of the lens, where it is open.
    blur: Option<Chain<B>>,
    settings: PathTracing,
    /// The samples that are taken, where not all are.
    part: Option<Range<u32>>,
    /// Makes bytes of the light.
    developed: Developed,
    /// Whether lights are marched to.
    has_lights: bool,
}

/// Samples after which noise is looked at first, and then again after as many more.
const LEAST_SAMPLES: u32 = 16;

/// The sums of a pixel's samples.
#[derive(Clone, Copy, Default)]
struct Sum {
    light: LightSum,
    /// Sum of the squares of the samples' brightness, as the film shows it.
    squares: f64,
    shown: f64,
}

/// A pixel's place, and its light: the mean of its samples and, where a part of them is taken, their sum.
type Lit = ((u32, u32), ([f32; 3], LightSum));

/// How bright a sample looks: compressed, so that a bright spot counts as what it shows.
fn brightness(radiance: [f64; 3]) -> f64 {
    let mean = (radiance[0] + radiance[1] + radiance[2]) / 3.0;
    mean / (1.0 + mean)
}

impl Sum {
    fn add(&mut self, radiance: [f64; 3]) {
        self.light.add(radiance);
        let shown = brightness(radiance);
        self.shown += shown;
        self.squares += shown * shown;
    }

    /// Variance of the mean of `count` samples.
    fn variance(&self, count: f64) -> f64 {
        let mean = self.shown / count;
        (self.squares / count - mean * mean).max(0.0) / count
    }
}

/// A number that differs from pixel to pixel (the finaliser of Murmur3).
fn mixed(x: u32, y: u32, seed: u32) -> u32 {
    let mut h = x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    for factor in [0x85EB_CA6B_u32, 0xC2B2_AE35] {
        h = (h ^ (h >> 16)).wrapping_mul(factor);
    }
    h ^ (h >> 16)
}

impl<B: Backend> Tracer<B> {
    /// Makes the passes of a path's point ready.
    pub fn new(
        passes: &Passes<()>,
        settings: PathTracing,
        developed: Developed,
        prepare: &mut impl FnMut(&Pass<()>) -> Result<B::Prepared, BackendError>,
    ) -> Result<Tracer<B>, BackendError> {
        let given = [Slot::Rays, Slot::Ends, Slot::Paths, Slot::Randoms];
        let has_lights = passes.get(Role::LightMarch).is_some();
        let wanted = [Slot::NextRays, Slot::NextPaths, Slot::Lit];
        let point = Chain::new(passes, &given, &wanted[..if has_lights { 3 } else { 2 }], &mut *prepare)?;
        let has_inner = passes.get(Role::InnerMarch).is_some();
        let ends = [Slot::Rays, Slot::Ends, Slot::Paths];
        let inner = has_inner.then(|| Chain::new(passes, &ends, &[Slot::JoinedEnds], &mut *prepare)).transpose()?;
        let has_blur = passes.get(Role::Blur).is_some();
        let blur = has_blur.then(|| Chain::new(passes, &[Slot::Rays, Slot::LensPoints], &[Slot::BlurredRays], prepare));
        Ok(Tracer { point, inner, blur: blur.transpose()?, settings, part: None, developed, has_lights })
    }

    /// The samples that are taken at most.
    fn samples(&self) -> Range<u32> {
        self.part.clone().unwrap_or(0..self.settings.samples.max(1))
    }

    /// How many they are.
    pub fn count(&self) -> u32 {
        self.samples().len() as u32
    }
}

/// Random numbers of a sample's points: Sobol's sequence, scrambled as Owen does, with dimensions of its own for each point.
fn randoms(pixels: &[(u32, u32)], sample: u32, bounce: u32, seed: u32) -> Vec<Vec<f64>> {
    let mut columns: Vec<Vec<f64>> = (0..Random::<usize>::WIDTH).map(|_| Vec::with_capacity(pixels.len())).collect();
    for &(x, y) in pixels {
        let seed = mixed(x, y, seed);
        let first = sobol_burley::sample_4d(sample, 1 + 2 * bounce, seed);
        let second = sobol_burley::sample_4d(sample, 2 + 2 * bounce, seed);
        let values = first.into_iter().chain(second);
        columns.iter_mut().zip(values).for_each(|(column, value)| column.push(f64::from(value)));
    }
    columns
}

impl<B: Backend> Renderer<'_, B> {
    /// Follows these paths of each pixel alone, of all that the settings ask for, and gives their sums.
    pub fn take_samples(&mut self, part: Range<u32>) {
        if let Some(tracer) = &mut self.tracer {
            tracer.part = Some(part);
        }
    }

    /// The rows of a band whose pixels are seen along paths of light.
    pub(super) fn traced(&self, band: Tile, meter: &Meter, stats: &mut Stats) -> Result<Rows, Halt> {
        let Some(tracer) = &self.tracer else { return Ok(Rows::default()) };
        let mut light = vec![<([f32; 3], LightSum)>::default(); band.count()];
        let tiles = windows(band, &mut light, self.cut.tile);
        let is_stopped = || meter.is_stopped();
        self.in_parts(tiles, meter, stats, |mut window, part| {
            let [some, empty] = {
                let starts = self.starts(window.tile, part)?;
                Pixels::of_tile(window.tile, &starts)
            };
            meter.advance(empty.count * tracer.count() as usize);
            for (place, lit) in self.empty_light(&empty, tracer.count(), part)? {
                window.set(place, lit);
            }
            let mut told = |count: usize| {
                meter.advance(count);
                !is_stopped()
            };
            for (place, lit) in self.traced_light(&some, tracer, &mut told, part)? {
                window.set(place, lit);
            }
            Ok(())
        })?;
        // Samples that were left out when the render was stopped are no picture.
        if meter.is_stopped() {
            return Err(Halt::Stopped);
        }
        let (light, sums): (Vec<[f32; 3]>, Vec<LightSum>) = light.into_iter().unzip();
        let srgb = tracer.developed.bytes(&light).map_err(Halt::Failed)?;
        let radiance = if self.keeps_radiance { light.into_flattened() } else { Vec::new() };
        let sums = if tracer.part.is_some() { sums } else { Vec::new() };
        Ok(Rows { srgb, radiance, sums, ..Rows::default() })
    }

    /// The light of pixels where beams found nothing: all of `count` samples see the same.
    fn empty_light(&self, pixels: &Pixels, count: u32, stats: &mut Stats) -> Result<Vec<Lit>, BackendError> {
        let Some(background) = self.background().filter(|_| pixels.count > 0) else { return Ok(Vec::new()) };
        stats.rays += pixels.count as u64;
        let points = pixels.points(&[[0.5; 2]]);
        let colours = background.write(self.backend, Slot::Points, &points, Slot::Backgrounds)?;
        let found = self.backend.download(&colours)?;
        let light = |i: usize| {
            let sum = LightSum::of_equal([0, 1, 2].map(|k| found[k][i]), count);
            (sum.mean(count), sum)
        };
        Ok(pixels.places().enumerate().map(|(i, place)| (place, light(i))).collect())
    }

    /// The light of pixels along paths, as the mean of as many samples as it takes.
    fn traced_light(
        &self,
        pixels: &Pixels,
        tracer: &Tracer<B>,
        told: &mut dyn FnMut(usize) -> bool,
        stats: &mut Stats,
    ) -> Result<Vec<Lit>, BackendError> {
        let places: Vec<(u32, u32)> = pixels.places().collect();
        let mut sums = vec![Sum::default(); places.len()];
        let (first, most, noise) = (tracer.samples().start, tracer.count(), tracer.settings.noise);
        let mut count = 0;
        while count < most && !places.is_empty() {
            let found = self.sample_paths(pixels, &places, (tracer, first + count), stats)?;
            let radiance = Path::COLUMNS.radiance;
            for (i, sum) in sums.iter_mut().enumerate() {
                sum.add([0, 1, 2].map(|k| found[radiance + k][i]));
            }
            count += 1;
            let is_told = told(places.len());
            let is_looked_at = noise > 0.0 && count % LEAST_SAMPLES == 0;
            if !is_told || (is_looked_at && is_smooth(&sums, count, noise)) {
                break;
            }
        }
        told(places.len() * (most - count) as usize);
        let lit = |sum: Sum| (sum.light.mean(count), sum.light);
        Ok(places.into_iter().zip(sums).map(|(place, sum)| (place, lit(sum))).collect())
    }

    /// Follows one path through each pixel. Gives columns of [`Path`].
    fn sample_paths(
        &self,
        pixels: &Pixels,
        places: &[(u32, u32)],
        (tracer, sample): (&Tracer<B>, u32),
        stats: &mut Stats,
    ) -> Result<Vec<Vec<f64>>, BackendError> {
        let seed = tracer.settings.seed;
        let offsets = |k: usize| {
            let one = |&(x, y): &(u32, u32)| sobol_burley::sample_4d(sample, 0, mixed(x, y, seed))[k];
            places.iter().map(one).map(f64::from).collect::<Vec<f64>>()
        };
        let at = |k: usize, of: fn(&(u32, u32)) -> u32| -> Vec<f64> {
            places.iter().zip(offsets(k)).map(|(place, offset)| f64::from(of(place)) + offset).collect()
        };
        let (x, y) = (at(0, |place| place.0), at(1, |place| place.1));
        let mut rays = timed(&mut stats.shade, || self.rays_through(pixels, &x, &y))?;
        if let Some(blur) = &tracer.blur {
            let points = self.backend.upload(&[offsets(2), offsets(3)])?;
            let mut written = blur.run(self.backend, &[(Slot::Rays, &rays), (Slot::LensPoints, &points)], |_, _| {})?;
            rays = written.take(Slot::BlurredRays).expect("the lens gives rays");
        }
        let first: Vec<Vec<f64>> = first_path().into_iter().map(|value| vec![value; places.len()]).collect();
        let mut paths = self.backend.upload(&first)?;
        for bounce in 0..tracer.settings.bounces.max(1) {
            let mut ends = timed(&mut stats.march, || self.ends(&rays))?;
            if let Some(inner) = tracer.inner.as_ref().filter(|_| bounce > 0) {
                let given = [(Slot::Rays, &rays), (Slot::Ends, &ends), (Slot::Paths, &paths)];
                let mut joined = timed(&mut stats.march, || inner.run(self.backend, &given, |_, _| {}))?;
                ends = joined.take(Slot::JoinedEnds).expect("both ends are joined");
            }
            let random = self.backend.upload(&randoms(places, sample, bounce, seed))?;
            let given = [(Slot::Rays, &rays), (Slot::Ends, &ends), (Slot::Paths, &paths), (Slot::Randoms, &random)];
            let mut written = tracer.point.run(self.backend, &given, |role, time| match role {
                Role::LightMarch => stats.shadow += time,
                _ => stats.shade += time,
            })?;
            let counted = self.backend.download_only(&ends, &stats.counted())?;
            let columns: Vec<&[f64]> = counted.iter().map(Vec::as_slice).collect();
            match bounce {
                0 => stats.count(&columns),
                _ => stats.shadow_estimates += columns[1].iter().sum::<f64>() as u64,
            }
            if let Some(lit) = written.take(Slot::Lit).filter(|_| tracer.has_lights) {
                let steps = self.backend.download_only(&lit, &[Marched::COLUMNS.steps])?;
                stats.shadow_estimates += steps[0].iter().sum::<f64>() as u64;
            }
            rays = written.take(Slot::NextRays).expect("a point gives the next ray");
            paths = written.take(Slot::NextPaths).expect("a point gives the path's next state");
            let alive = self.backend.download_only(&paths, &[Path::COLUMNS.density])?;
            if alive[0].iter().all(|density| *density == 0.0) {
                break;
            }
        }
        self.backend.download(&paths)
    }
}

/// Whether the mean of pixels is as smooth as wanted: their standard deviations, over their mean brightness.
fn is_smooth(sums: &[Sum], count: u32, noise: f64) -> bool {
    let count = f64::from(count);
    let variance = sums.iter().map(|sum| sum.variance(count)).sum::<f64>() / sums.len() as f64;
    let mean = sums.iter().map(|sum| sum.shown / count).sum::<f64>() / sums.len() as f64;
    variance.sqrt() <= noise * mean
}
