//! A pipeline made ready on a back end, and what becomes of rays on it.

use std::time::{Duration, Instant};

use super::beams::{Beams, NOTHING, Starts};
use super::stats::{STATUS, column, counted};
use super::{Pipeline, RenderSettings, Sampling, Shape, Stats};
use crate::film::srgb_byte;
use crate::kernel::{Backend, BackendError, Batch, Status};
use crate::shade::Size;

/// How a picture is cut. Nothing of it shows in the picture.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Cut {
    /// Rows that are rendered, and then handed on, together.
    pub band: u32,
    /// Edge of the tiles that they are cut into.
    pub tile: u32,
    /// Rays that are taken together where pixels get all their samples.
    pub rays: usize,
}

/// Most pixels of a band: with what the two passes keep of each, some 20 MB.
const BAND: u32 = 1 << 20;

impl Cut {
    /// The cut that suits a back end.
    pub fn new(size: Size, batch: Batch) -> Cut {
        // Whole blocks of 8 rows, which are marched together.
        let band = (BAND / size.width.max(1) / 8 * 8).max(8);
        Cut { band, tile: batch.elements.isqrt() as u32, rays: batch.elements }
    }
}

/// A pipeline made ready on a back end.
pub struct Renderer<'b, B: Backend> {
    backend: &'b B,
    pub(super) size: Size,
    /// Where the samples of a pixel lie in it.
    pub(super) samples: Vec<[f64; 2]>,
    pub(super) sampling: Sampling,
    /// Most parts of the picture that are worked on at the same time.
    pub(super) at_once: usize,
    /// Pixel coordinates, and starts where there are beams, to rays.
    camera: B::Prepared,
    beams: Option<Beams<B>>,
    march: B::Prepared,
    surface_point: B::Prepared,
    surface: B::Prepared,
    /// To shadow rays, and their march.
    shadow: Option<[B::Prepared; 2]>,
    colour: B::Prepared,
    encode: B::Prepared,
    /// How the picture is cut.
    pub cut: Cut,
    /// What has been counted so far.
    pub stats: Stats,
}

/// The first sample of a pixel.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub(super) struct Sample {
    /// Its colour, linear.
    pub linear: [f32; 3],
    /// Its colour in sRGB.
    pub srgb: [u8; 3],
    /// Whether its ray hit.
    pub hit: bool,
    /// How far nothing is for any ray through the pixel.
    pub start: f64,
}

/// Colours of some of the points that were asked for.
struct Part<C> {
    /// Which of the points; `None` where it is all of them.
    numbers: Option<Vec<u32>>,
    /// Their linear colours.
    colours: C,
    /// How their marches ended; `None` where beams found nothing.
    status: Option<Vec<f64>>,
}

impl<C> Part<C> {
    /// Gives each value of these points with the number of its point.
    fn each<T>(&self, values: impl IntoIterator<Item = T>, mut take: impl FnMut(usize, T)) {
        match &self.numbers {
            Some(numbers) => numbers.iter().zip(values).for_each(|(&i, value)| take(i as usize, value)),
            None => values.into_iter().enumerate().for_each(|(i, value)| take(i, value)),
        }
    }
}

/// Adds the time of some work.
fn timed<T>(sum: &mut Duration, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    *sum += start.elapsed();
    result
}

impl<'b, B: Backend> Renderer<'b, B> {
    /// Compiles the pipeline's kernels.
    pub fn new(
        backend: &'b B,
        arena: &crate::expr::Arena,
        pipeline: &Pipeline,
        settings: &RenderSettings,
    ) -> Result<Self, BackendError> {
        let kernels = pipeline.kernels();
        let prepare = |name: &str| {
            let kernel = kernels.iter().find(|(known, _)| *known == name);
            kernel.map(|(_, kernel)| backend.prepare(arena, kernel)).transpose()
        };
        Renderer::with_kernels(backend, settings, &pipeline.shape(), prepare)
    }

    /// A renderer of kernels that `prepare` gives by the names of [`Pipeline::kernels`]; `None` where there is none.
    pub fn with_kernels(
        backend: &'b B,
        settings: &RenderSettings,
        shape: &Shape,
        mut prepare: impl FnMut(&str) -> Result<Option<B::Prepared>, BackendError>,
    ) -> Result<Self, BackendError> {
        let start = Instant::now();
        let shadow = match (prepare("shadow_ray")?, prepare("shadow_march")?) {
            (Some(ray), Some(march)) => Some([ray, march]),
            _ => None,
        };
        let mut needed = |name: &str| Ok(prepare(name)?.expect("every picture has this kernel"));
        let batch = backend.batch();
        let mut renderer = Renderer {
            backend,
            size: settings.size,
            samples: sample_offsets(settings.samples.max(1)),
            sampling: settings.sampling,
            at_once: batch.at_once,
            camera: needed(if shape.tiles.is_some() { "begin" } else { "camera" })?,
            beams: shape.tiles.as_ref().map(|tiles| Beams::new(tiles, &mut needed)).transpose()?,
            march: needed("march")?,
            surface_point: needed("surface_point")?,
            surface: needed("surface")?,
            shadow,
            colour: needed("colour")?,
            encode: needed("encode")?,
            cut: Cut::new(settings.size, batch),
            stats: Stats::default(),
        };
        renderer.stats.undecided = shape.is_certified.then_some(0);
        // After what other threads compile.
        renderer.stats.compiling = backend.compiling();
        renderer.stats.compile = start.elapsed();
        Ok(renderer)
    }

    /// Marches the centres of pixels and gives, for each, its depth `t` where it hits.
    pub fn depths(&mut self, pixels: &[(u32, u32)]) -> Result<Vec<Option<f64>>, BackendError> {
        let starts = self.starts(pixels, &mut Stats::default())?;
        let rays = self.rays(Points { pixels, offsets: &[[0.5; 2]] }.all_columns(), starts)?;
        let hits = self.backend.run(&self.march, &[&rays])?;
        let columns = self.backend.download_only(&hits, &["t", "status"].map(column))?;
        let depth = |(&t, &status): (&f64, &f64)| (Status::from_code(status) == Status::Hit).then_some(t);
        Ok(columns[0].iter().zip(&columns[1]).map(depth).collect())
    }

    /// Takes the first sample of each pixel, for sums with others.
    pub(super) fn first_samples(&self, pixels: &[(u32, u32)], stats: &mut Stats) -> Result<Vec<Sample>, BackendError> {
        let starts = self.starts(pixels, stats)?;
        let mut samples = vec![Sample::default(); pixels.len()];
        if self.beams.is_some() {
            samples.iter_mut().zip(&starts).for_each(|(sample, &start)| sample.start = start);
        }
        for part in self.sample(Points { pixels, offsets: &self.samples[..1] }, starts, stats)? {
            timed(&mut stats.shade, || {
                let srgb = self.encode(&part.colours)?;
                part.each(srgb, |i, srgb| samples[i].srgb = srgb);
                part.each(part.status.iter().flatten(), |i, &code| {
                    samples[i].hit = Status::from_code(code) == Status::Hit
                });
                for (k, values) in self.backend.download(&part.colours)?.iter().enumerate() {
                    part.each(values, |i, &value| samples[i].linear[k] = value as f32);
                }
                Ok(())
            })?;
        }
        Ok(samples)
    }

    /// The colours in sRGB of pixels that have one sample.
    pub(super) fn first_colours(&self, pixels: &[(u32, u32)], stats: &mut Stats) -> Result<Vec<[u8; 3]>, BackendError> {
        let starts = self.starts(pixels, stats)?;
        let mut all = vec![[0; 3]; pixels.len()];
        for part in self.sample(Points { pixels, offsets: &self.samples[..1] }, starts, stats)? {
            let colours = timed(&mut stats.shade, || self.encode(&part.colours))?;
            part.each(colours, |i, srgb| all[i] = srgb);
        }
        Ok(all)
    }

    /// Takes all but the first sample of each pixel and gives the average of all in sRGB.
    pub(super) fn other_samples(
        &self,
        pixels: &[(u32, u32)],
        firsts: &[Sample],
        stats: &mut Stats,
    ) -> Result<Vec<[u8; 3]>, BackendError> {
        let others = &self.samples[1..];
        let starts = firsts.iter().filter(|_| self.beams.is_some());
        let starts: Vec<f64> = starts.flat_map(|first| std::iter::repeat_n(first.start, others.len())).collect();
        let points = Points { pixels, offsets: others };
        let mut colours = vec![vec![0.0; points.count()]; 3];
        for part in self.sample(points, starts, stats)? {
            let found = timed(&mut stats.shade, || self.backend.download(&part.colours))?;
            for (all, found) in colours.iter_mut().zip(&found) {
                part.each(found, |i, &value| all[i] = value);
            }
        }
        stats.refined += pixels.len() as u64;
        timed(&mut stats.shade, || {
            let scale = 1.0 / self.samples.len() as f64;
            let average = |k: usize| {
                let sums = colours[k].chunks_exact(others.len()).map(|samples| samples.iter().sum::<f64>());
                sums.zip(firsts).map(|(sum, first)| (f64::from(first.linear[k]) + sum) * scale).collect()
            };
            self.encode(&self.backend.upload(&[average(0), average(1), average(2)])?)
        })
    }

    /// For each pixel how far nothing is for any ray through it; nothing without beams.
    fn starts(&self, pixels: &[(u32, u32)], stats: &mut Stats) -> Result<Vec<f64>, BackendError> {
        let Some(beams) = &self.beams else { return Ok(Vec::new()) };
        let begun = Instant::now();
        let Starts { depths, beams, estimates } = beams.starts(self.backend, pixels)?;
        stats.beams += beams;
        stats.beam_estimates += estimates;
        stats.march += begun.elapsed();
        Ok(depths)
    }

    /// Rays through points of the picture (columns of x and y), from `starts` on where there are beams.
    fn rays(&self, [x, y]: [Vec<f64>; 2], starts: Vec<f64>) -> Result<B::Columns, BackendError> {
        let columns = if self.beams.is_some() { vec![x, y, starts] } else { vec![x, y] };
        self.backend.run(&self.camera, &[&self.backend.upload(&columns)?])
    }

    /// Linear colours at points of the picture: of those where beams found nothing, and of the others.
    fn sample(
        &self,
        points: Points,
        starts: Vec<f64>,
        stats: &mut Stats,
    ) -> Result<Vec<Part<B::Columns>>, BackendError> {
        let Some(beams) = &self.beams else {
            return Ok(vec![self.marched(points.all_columns(), starts, None, stats)?]);
        };
        let numbers = 0..starts.len() as u32;
        let (empty, others): (Vec<u32>, Vec<u32>) = numbers.partition(|&i| starts[i as usize] >= NOTHING);
        if empty.is_empty() {
            return Ok(vec![self.marched(points.all_columns(), starts, None, stats)?]);
        }
        let mut parts = Vec::new();
        stats.rays += empty.len() as u64;
        timed(&mut stats.shade, || {
            let points = self.backend.upload(&points.columns(empty.iter().copied()))?;
            let colours = self.backend.run(&beams.background, &[&points])?;
            parts.push(Part { numbers: Some(empty), colours, status: None });
            Ok(())
        })?;
        if !others.is_empty() {
            let starts = others.iter().map(|&i| starts[i as usize]).collect();
            parts.push(self.marched(points.columns(others.iter().copied()), starts, Some(others), stats)?);
        }
        Ok(parts)
    }

    /// Linear colours at points of the picture by marches.
    fn marched(
        &self,
        points: [Vec<f64>; 2],
        starts: Vec<f64>,
        numbers: Option<Vec<u32>>,
        stats: &mut Stats,
    ) -> Result<Part<B::Columns>, BackendError> {
        let backend = self.backend;
        let rays = timed(&mut stats.shade, || self.rays(points, starts))?;
        let hits = timed(&mut stats.march, || backend.run(&self.march, &[&rays]))?;
        let (surface, mut marched) = timed(&mut stats.shade, || {
            let points = backend.run(&self.surface_point, &[&rays, &hits])?;
            Ok((backend.run(&self.surface, &[&points])?, backend.download_only(&hits, &counted())?))
        })?;
        stats.count(&marched);
        let status = Some(marched.swap_remove(STATUS));
        let Some([shadow_ray, shadow_march]) = &self.shadow else {
            let colours = timed(&mut stats.shade, || backend.run(&self.colour, &[&rays, &hits, &surface]))?;
            return Ok(Part { numbers, colours, status });
        };
        let shadow_rays = timed(&mut stats.shade, || backend.run(shadow_ray, &[&rays, &hits, &surface]))?;
        let (shadows, ends) = timed(&mut stats.shadow, || {
            let shadows = backend.run(shadow_march, &[&shadow_rays])?;
            let ends = backend.download_only(&shadows, &[column("steps")])?;
            Ok((shadows, ends))
        })?;
        stats.shadow_estimates += ends[0].iter().sum::<f64>() as u64;
        let inputs = [&rays, &hits, &surface, &shadows];
        let colours = timed(&mut stats.shade, || backend.run(&self.colour, &inputs))?;
        Ok(Part { numbers, colours, status })
    }

    /// Linear colours as bytes of sRGB; NaN is black.
    fn encode(&self, linear: &B::Columns) -> Result<Vec<[u8; 3]>, BackendError> {
        let columns = self.backend.download(&self.backend.run(&self.encode, &[linear])?)?;
        let bytes = [0, 1, 2].map(|k| columns[k].iter().map(|&value| srgb_byte(value)).collect::<Vec<u8>>());
        let [red, green, blue] = &bytes;
        Ok(red.iter().zip(green).zip(blue).map(|((&red, &green), &blue)| [red, green, blue]).collect())
    }
}

/// Points of the picture at offsets in each pixel; those of a pixel are neighbours, so they are marched together.
#[derive(Clone, Copy)]
struct Points<'a> {
    pixels: &'a [(u32, u32)],
    offsets: &'a [[f64; 2]],
}

impl Points<'_> {
    fn count(&self) -> usize {
        self.pixels.len() * self.offsets.len()
    }

    /// Columns of x and y of the points with these numbers.
    fn columns(&self, numbers: impl Iterator<Item = u32> + Clone) -> [Vec<f64>; 2] {
        let each = self.offsets.len() as u32;
        let column = |of: fn(&(u32, u32)) -> u32, k: usize| {
            let at = |i: u32| f64::from(of(&self.pixels[(i / each) as usize])) + self.offsets[(i % each) as usize][k];
            numbers.clone().map(at).collect()
        };
        [column(|p| p.0, 0), column(|p| p.1, 1)]
    }

    fn all_columns(&self) -> [Vec<f64>; 2] {
        self.columns(0..self.count() as u32)
    }
}

/// Where the samples of a pixel lie in it: on a grid with this many on an edge, the one nearest to the centre first.
fn sample_offsets(edge: u32) -> Vec<[f64; 2]> {
    let at = |k: u32| (f64::from(k) + 0.5) / f64::from(edge);
    let mut offsets: Vec<[f64; 2]> = (0..edge * edge).map(|i| [at(i / edge), at(i % edge)]).collect();
    let middle = ((edge - 1) / 2 * (edge + 1)) as usize;
    offsets[..=middle].rotate_right(1);
    offsets
}
