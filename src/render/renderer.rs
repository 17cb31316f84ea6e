//! A pipeline made ready on a back end, and what becomes of rays on it.

use std::time::{Duration, Instant};

use super::beams::{Beams, NOTHING, Starts};
use super::stats::column;
use super::{Pipeline, RenderSettings, Sampling, Shape, Stats};
use crate::film::{Tile, Window};
use crate::kernel::{Backend, BackendError, Batch, Status, Wanted};
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
    /// Its colour, linear; of pictures with one sample it is not kept.
    pub linear: [f32; 3],
    /// Its colour in sRGB.
    pub srgb: [u8; 3],
    /// Whether its ray hit.
    pub hit: bool,
    /// How far nothing is for any ray through the pixel.
    pub start: f64,
}

/// Pixels, and how far nothing is for any ray through each; those without anything have none of that.
struct Pixels {
    places: Vec<(u32, u32)>,
    starts: Vec<f64>,
}

impl Pixels {
    fn with_capacity(most: usize) -> Pixels {
        Pixels { places: Vec::with_capacity(most), starts: Vec::with_capacity(most) }
    }

    /// Takes a pixel, where something may be into the first of two and without anything into the second.
    #[inline]
    fn sort_into(cut: &mut [Pixels; 2], place: (u32, u32), start: f64) {
        let [some, empty] = cut;
        match start >= NOTHING {
            true => empty.places.push(place),
            false => {
                some.places.push(place);
                some.starts.push(start);
            }
        }
    }

    /// The pixels of a tile, cut into those where something may be and those without anything.
    fn of_tile(tile: Tile, starts: &Option<Starts>) -> [Pixels; 2] {
        let mut cut = [0, 1].map(|_| Pixels::with_capacity(tile.count()));
        for block in tile.cut(8) {
            let [some, empty] = &mut cut;
            let Some(starts) = starts else {
                block.rows().for_each(|(row, _)| some.places.extend(row));
                continue;
            };
            // Most blocks are all of one kind.
            match starts.are_nothing(block) {
                Some(true) => block.rows().for_each(|(row, _)| empty.places.extend(row)),
                Some(false) => block.rows().for_each(|(row, first)| {
                    some.starts.extend(starts.row(first).take(row.len()));
                    some.places.extend(row);
                }),
                None => {
                    let pixels = block.rows().flat_map(|(row, first)| row.zip(starts.row(first)));
                    pixels.for_each(|(place, start)| Pixels::sort_into(&mut cut, place, start));
                }
            }
        }
        // What has none yet.
        let [some, _] = &mut cut;
        some.starts.resize(some.places.len(), 0.0);
        cut
    }

    /// Columns of x, y and starts of points at offsets in each pixel; those of a pixel are neighbours, so they are marched
    /// together.
    fn columns(&self, offsets: &[[f64; 2]]) -> [Vec<f64>; 3] {
        let points = self.places.len() * offsets.len();
        let [mut x, mut y] = [0, 1].map(|_| Vec::with_capacity(points));
        if let [only] = offsets {
            x.extend(self.places.iter().map(|place| f64::from(place.0) + only[0]));
            y.extend(self.places.iter().map(|place| f64::from(place.1) + only[1]));
            return [x, y, self.starts.clone()];
        }
        for place in &self.places {
            x.extend(offsets.iter().map(|offset| f64::from(place.0) + offset[0]));
            y.extend(offsets.iter().map(|offset| f64::from(place.1) + offset[1]));
        }
        [x, y, self.starts.iter().flat_map(|&start| std::iter::repeat_n(start, offsets.len())).collect()]
    }
}

/// Columns of colours, linear or encoded.
type Colours = Vec<Vec<f64>>;
/// The columns of linear colours: red, green and blue.
const LINEAR: &[usize] = &[0, 1, 2];
/// The column of encoded colours.
const ENCODED: &[usize] = &[0];

/// What was computed of some pixels, still where the back end has it.
struct Part<C> {
    pixels: Pixels,
    /// Linear colours.
    colours: C,
    /// Their marches, and those towards the sun; none where beams found nothing.
    marches: Option<(C, Option<C>)>,
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
        let ends = |of: fn(&(u32, u32)) -> u32| Some((pixels.iter().map(of).min()?, pixels.iter().map(of).max()?));
        let (Some((left, right)), Some((top, bottom))) = (ends(|p| p.0), ends(|p| p.1)) else { return Ok(Vec::new()) };
        let around = Tile { x: left, y: top, width: right + 1 - left, height: bottom + 1 - top };
        let starts = self.starts(around, &mut Stats::default())?;
        let start = |place: &(u32, u32)| starts.as_ref().map_or(0.0, |starts| starts.at(*place));
        let pixels = Pixels { starts: pixels.iter().map(start).collect(), places: pixels.to_vec() };
        let rays = self.rays(&pixels, &[[0.5; 2]])?;
        let hits = self.backend.run(&self.march, &[&rays])?;
        let columns = self.backend.download_only(&hits, &["t", "status"].map(column))?;
        let depth = |(&t, &status): (&f64, &f64)| (Status::from_code(status) == Status::Hit).then_some(t);
        Ok(columns[0].iter().zip(&columns[1]).map(depth).collect())
    }

    /// Takes the first sample of each pixel of a window, and sets what `of` makes of it.
    pub(super) fn first_samples<T>(
        &self,
        window: &mut Window<T>,
        stats: &mut Stats,
        of: impl Fn(Sample) -> T,
    ) -> Result<(), BackendError> {
        let tile = window.tile;
        let starts = self.starts(tile, stats)?;
        let parts = self.sample(Pixels::of_tile(tile, &starts), &self.samples[..1], stats)?;
        let encode = |part: &Part<_>| self.backend.run(&self.encode, &[&part.colours]);
        let encoded: Vec<_> = timed(&mut stats.shade, || parts.iter().map(encode).collect::<Result<_, _>>())?;
        // Linear colours are only for sums with others.
        let linear = parts.iter().filter(|_| self.samples.len() > 1).map(|part| &part.colours);
        let wanted = encoded.iter().map(|srgb| (srgb, ENCODED)).chain(linear.map(|linear| (linear, LINEAR)));
        let (status, colours) = self.results(&parts, wanted.collect(), stats)?;
        let (srgb, linear) = colours.split_at(parts.len());
        for (k, part) in parts.iter().enumerate() {
            let (status, linear, pixels) = (&status[k], linear.get(k), &part.pixels);
            let samples = bytes(&srgb[k]).enumerate().map(|(i, srgb)| {
                let start = pixels.starts.get(i).copied().unwrap_or(NOTHING);
                let linear = linear.map_or([0.0; 3], |linear| [0, 1, 2].map(|k| linear[k][i] as f32));
                let hit = status.get(i).is_some_and(|&code| Status::from_code(code) == Status::Hit);
                of(Sample { linear, srgb, hit, start })
            });
            window.set_all(&pixels.places, samples);
        }
        Ok(())
    }

    /// Takes all but the first sample of each pixel and gives the average of all in sRGB; `first` has the first ones.
    pub(super) fn other_samples(
        &self,
        pixels: &[(u32, u32)],
        first: impl Fn((u32, u32)) -> Sample,
        stats: &mut Stats,
        mut take: impl FnMut((u32, u32), [u8; 3]),
    ) -> Result<(), BackendError> {
        let others = &self.samples[1..];
        let mut cut = [0, 1].map(|_| Pixels::with_capacity(pixels.len()));
        pixels.iter().for_each(|&place| Pixels::sort_into(&mut cut, place, first(place).start));
        let parts = self.sample(cut, others, stats)?;
        let wanted = parts.iter().map(|part| (&part.colours, LINEAR)).collect();
        let (_, colours) = self.results(&parts, wanted, stats)?;
        let places: Vec<(u32, u32)> = parts.iter().flat_map(|part| &part.pixels.places).copied().collect();
        let scale = 1.0 / self.samples.len() as f64;
        let average = |k: usize| {
            let sums = colours.iter().flat_map(|colours| colours[k].chunks_exact(others.len()));
            let mean = |(samples, &place): (&[f64], &(u32, u32))| {
                (f64::from(first(place).linear[k]) + samples.iter().sum::<f64>()) * scale
            };
            sums.zip(&places).map(mean).collect()
        };
        let encoded = timed(&mut stats.shade, || {
            let linear = self.backend.upload(&[average(0), average(1), average(2)])?;
            self.backend.run(&self.encode, &[&linear])
        })?;
        let srgb = timed(&mut stats.results, || self.backend.download(&encoded))?;
        stats.refined += pixels.len() as u64;
        places.iter().zip(bytes(&srgb)).for_each(|(&place, srgb)| take(place, srgb));
        Ok(())
    }

    /// How far nothing is for any ray through each pixel of a tile; `None` without beams.
    fn starts(&self, tile: Tile, stats: &mut Stats) -> Result<Option<Starts>, BackendError> {
        let Some(beams) = &self.beams else { return Ok(None) };
        let starts = timed(&mut stats.march, || beams.starts(self.backend, tile))?;
        stats.beams += starts.beams;
        stats.beam_estimates += starts.estimates;
        Ok(Some(starts))
    }

    /// Rays through points of pixels, from the pixels' starts on where there are beams.
    fn rays(&self, pixels: &Pixels, offsets: &[[f64; 2]]) -> Result<B::Columns, BackendError> {
        let inputs = if self.beams.is_some() { 3 } else { 2 };
        self.backend.run(&self.camera, &[&self.backend.upload(&pixels.columns(offsets)[..inputs])?])
    }

    /// Has points of pixels computed: of those where something may be, and of those where beams found nothing.
    fn sample(
        &self,
        [some, empty]: [Pixels; 2],
        offsets: &[[f64; 2]],
        stats: &mut Stats,
    ) -> Result<Vec<Part<B::Columns>>, BackendError> {
        let mut parts = Vec::new();
        if let Some(beams) = self.beams.as_ref().filter(|_| !empty.places.is_empty()) {
            stats.rays += (empty.places.len() * offsets.len()) as u64;
            let colours = timed(&mut stats.shade, || {
                let points = self.backend.upload(&empty.columns(offsets)[..2])?;
                self.backend.run(&beams.background, &[&points])
            })?;
            parts.push(Part { pixels: empty, colours, marches: None });
        }
        if !some.places.is_empty() {
            parts.push(self.marched(some, offsets, stats)?);
        }
        Ok(parts)
    }

    /// Has points of pixels computed by marches.
    fn marched(
        &self,
        pixels: Pixels,
        offsets: &[[f64; 2]],
        stats: &mut Stats,
    ) -> Result<Part<B::Columns>, BackendError> {
        let backend = self.backend;
        let rays = timed(&mut stats.shade, || self.rays(&pixels, offsets))?;
        let hits = timed(&mut stats.march, || backend.run(&self.march, &[&rays]))?;
        let surface = timed(&mut stats.shade, || {
            backend.run(&self.surface, &[&backend.run(&self.surface_point, &[&rays, &hits])?])
        })?;
        let mut inputs = vec![&rays, &hits, &surface];
        let mut shadows = None;
        if let Some([shadow_ray, shadow_march]) = &self.shadow {
            let shadow_rays = timed(&mut stats.shade, || backend.run(shadow_ray, &inputs))?;
            inputs.push(shadows.insert(timed(&mut stats.shadow, || backend.run(shadow_march, &[&shadow_rays]))?));
        }
        let colours = timed(&mut stats.shade, || backend.run(&self.colour, &inputs))?;
        Ok(Part { pixels, colours, marches: Some((hits, shadows)) })
    }

    /// Waits for what was computed: how the marches of each part ended (nothing for a part without), and the colours that are
    /// `wanted`. Counts the marches.
    fn results(
        &self,
        parts: &[Part<B::Columns>],
        wanted: Vec<Wanted<B::Columns>>,
        stats: &mut Stats,
    ) -> Result<(Vec<Vec<f64>>, Vec<Colours>), BackendError> {
        let (counted, steps, colours) = (stats.counted(), [column("steps")], wanted.len());
        let mut wanted = wanted;
        for (hits, shadows) in parts.iter().filter_map(|part| part.marches.as_ref()) {
            wanted.push((hits, &counted));
            wanted.extend(shadows.iter().map(|shadows| (shadows, &steps[..])));
        }
        let mut results = timed(&mut stats.results, || self.backend.download_together(&wanted))?;
        let mut counts = results.split_off(colours).into_iter();
        let mut count = |part: &Part<B::Columns>| {
            let (_, shadows) = part.marches.as_ref()?;
            let mut hits = counts.next()?;
            stats.count(&hits);
            if shadows.is_some() {
                stats.shadow_estimates += counts.next()?[0].iter().sum::<f64>() as u64;
            }
            Some(hits.swap_remove(0))
        };
        Ok((parts.iter().map(|part| count(part).unwrap_or_default()).collect(), results))
    }
}

/// The bytes of colours as [`compose_encode`](crate::shade::compose_encode) gives them.
fn bytes(srgb: &[Vec<f64>]) -> impl Iterator<Item = [u8; 3]> + '_ {
    // Numbers from here on are whole: the last bits of a sum are those of the whole number that was added.
    const WHOLE: f64 = (1_u64 << 52) as f64;
    srgb[0].iter().map(|&all| {
        let [blue, green, red, ..] = (all + WHOLE).to_bits().to_le_bytes();
        [red, green, blue]
    })
}

/// Where the samples of a pixel lie in it: on a grid with this many on an edge, the one nearest to the centre first.
fn sample_offsets(edge: u32) -> Vec<[f64; 2]> {
    let at = |k: u32| (f64::from(k) + 0.5) / f64::from(edge);
    let mut offsets: Vec<[f64; 2]> = (0..edge * edge).map(|i| [at(i / edge), at(i % edge)]).collect();
    let middle = ((edge - 1) / 2 * (edge + 1)) as usize;
    offsets[..=middle].rotate_right(1);
    offsets
}
