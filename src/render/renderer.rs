//! A pipeline made ready on a back end, and what becomes of rays on it.

use std::time::{Duration, Instant};

use super::beams::{Beams, Starts};
use super::checked::beams_hold;
use super::data::{Kept, Numbers};
use super::mirrored::Mirror;
use super::passes::{self, Chain, Pass, Role, Slot};
use super::pixels::{Pixels, bytes, sample_offsets};
use super::traced::Tracer;
use super::{Developed, Pipeline, RenderSettings, Sampling, Shape, Stats};
use crate::film::{Tile, Window};
use crate::kernel::records::Marched;
use crate::kernel::{Backend, BackendError, Batch, Kernel, Results, Status, Wanted};
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
    pub(super) backend: &'b B,
    pub(super) size: Size,
    /// Where the samples of a pixel lie in it.
    pub(super) samples: Vec<[f64; 2]>,
    pub(super) sampling: Sampling,
    /// Most parts of the picture that are worked on at the same time.
    pub(super) at_once: usize,
    /// Beams, and points where they found nothing to colours.
    beams: Option<(Beams<B>, Chain<B>)>,
    /// Points, with their starts where there are beams, to rays.
    camera: Chain<B>,
    /// Rays to their ends.
    march: Chain<B>,
    /// Rays and ends to colours, by way of shadows.
    shade: Chain<B>,
    /// Colours to those with mirrors, where surfaces mirror.
    pub(super) mirror: Option<Mirror<B>>,
    /// Colours to bytes.
    encode: Chain<B>,
    /// Points of paths to the next ones, where light is followed along paths.
    pub(super) tracer: Option<Tracer<B>>,
    /// Whether the pixels' light is kept beside their bytes.
    pub(super) keeps_radiance: bool,
    /// What the passes tell of pixels besides.
    known: Option<Kept>,
    /// That, where somebody wants it.
    pub(super) data: Option<Kept>,
    /// How the picture is cut.
    pub cut: Cut,
    /// What has been counted so far.
    pub stats: Stats,
}

/// The first sample of a pixel.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub(super) struct Sample {
    /// Its light; of pictures with one sample it is kept where it is wanted.
    pub linear: [f32; 3],
    /// Its colour in sRGB.
    pub srgb: [u8; 3],
    /// Whether its ray hit.
    pub hit: bool,
    /// How far nothing is for any ray through the pixel.
    pub start: f64,
}

/// The columns of linear colours: red, green and blue.
const LINEAR: &[usize] = &[0, 1, 2];
/// The column of encoded colours.
const ENCODED: &[usize] = &[0];

/// What was computed of some pixels, still where the back end has it.
struct Part<C> {
    pixels: Pixels,
    /// Linear colours.
    colours: C,
    /// Their marches, and the further ones; none where beams found nothing.
    marches: Option<(C, Vec<C>)>,
    /// What is kept besides.
    data: Option<C>,
}

/// Columns of some results, of the numbers that a back end computes with.
type Read<'r, 'a, N> = &'r [Vec<&'a [N]>];

/// The results of each part, where it has some.
type OfParts<'r, 'a, N> = Vec<Option<&'r [&'a [N]]>>;

/// Adds the time of some work.
pub(super) fn timed<T>(sum: &mut Duration, work: impl FnOnce() -> T) -> T {
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
        Renderer::with(backend, arena, pipeline, settings, |_, kernel| backend.prepare(arena, kernel))
    }

    /// The same with kernels that `prepare` makes ready.
    pub fn with(
        backend: &'b B,
        arena: &crate::expr::Arena,
        pipeline: &Pipeline,
        settings: &RenderSettings,
        mut prepare: impl FnMut(&'static str, &Kernel) -> Result<B::Prepared, BackendError>,
    ) -> Result<Self, BackendError> {
        let mut shape = pipeline.shape();
        let start = Instant::now();
        let hold = beams_hold(arena, pipeline, settings)?;
        let trial = start.elapsed();
        shape.tiles = shape.tiles.filter(|_| hold);
        let prepare = |role: Role| prepare(role.name(), pipeline.kernel(role));
        let developed = || Developed::new(arena, pipeline.kernel(Role::Encode), settings.precision);
        let developed = settings.path.map(|_| developed()).transpose()?;
        let mut renderer = Renderer::with_kernels(backend, settings, (&shape, developed), prepare)?;
        renderer.stats.are_beams_wrong = !hold;
        renderer.stats.compile += trial;
        Ok(renderer)
    }

    /// A renderer of passes whose kernels `prepare` makes ready by their roles; `developed` makes bytes of light along paths.
    fn with_kernels(
        backend: &'b B,
        settings: &RenderSettings,
        (shape, developed): (&Shape, Option<Developed>),
        mut prepare: impl FnMut(Role) -> Result<B::Prepared, BackendError>,
    ) -> Result<Self, BackendError> {
        let start = Instant::now();
        let mut prepare = |pass: &Pass<()>| prepare(pass.role);
        let mut chain = |given: &[Slot], wanted: &[Slot]| Chain::new(&shape.passes, given, wanted, &mut prepare);
        let points = if shape.tiles.is_some() { Slot::Begins } else { Slot::Points };
        let marches = shape.passes.iter().map(|pass| pass.writes).filter(|slot| slot.is_further_march());
        let known = Kept::new(settings.layers.data());
        let kept = known.as_ref().map(|_| Slot::Data);
        let has_mirrors = shape.passes.get(Role::MirrorStep).is_some();
        let of_first: &[Slot] = if has_mirrors { &[Slot::MirrorsAfter, Slot::NextRays] } else { &[] };
        let kept = kept.filter(|_| !has_mirrors);
        let shaded = std::iter::once(Slot::Colours).chain(kept).chain(of_first.iter().copied()).chain(marches);
        let shaded: Vec<Slot> = shaded.collect();
        let camera = chain(&[points], &[Slot::Rays])?;
        let march = chain(&[Slot::Rays], &[Slot::Ends])?;
        let shade = chain(&[Slot::Rays, Slot::Ends], if settings.path.is_some() { &[] } else { &shaded })?;
        let encode = chain(&[Slot::Colours], &[Slot::Bytes])?;
        let mirror = has_mirrors.then(|| Mirror::new(&shape.passes, settings.mirrors, known.is_some(), &mut chain));
        let mirror = mirror.transpose()?;
        let beams = match &shape.tiles {
            None => None,
            Some(tiles) => {
                let background = chain(&[Slot::Points], &[Slot::Backgrounds])?;
                Some((Beams::new(tiles, &shape.passes, &mut prepare)?, background))
            }
        };
        let tracer = settings.path.zip(developed);
        let tracer =
            tracer.map(|(path, developed)| Tracer::new(&shape.passes, path, developed, &mut prepare)).transpose()?;
        let batch = backend.batch();
        let mut renderer = Renderer {
            backend,
            size: settings.size,
            samples: sample_offsets(settings.samples.max(1)),
            sampling: settings.sampling,
            at_once: batch.at_once,
            beams,
            camera,
            march,
            shade,
            mirror,
            encode,
            tracer,
            keeps_radiance: false,
            known,
            data: None,
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
        let start = |place| starts.as_ref().map_or(0.0, |starts| starts.at(place));
        let pixels = Pixels::starting(pixels.iter().copied(), start);
        let rays = self.rays(&pixels, &[[0.5; 2]])?;
        passes::depths(self.backend, &passes::march(self.backend, &self.march, &rays)?)
    }

    /// Columns and rows of the picture.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Whether first samples keep their light.
    pub(super) fn keeps_light(&self) -> bool {
        self.samples.len() > 1 || self.keeps_radiance || self.data.is_some()
    }

    /// Keeps what the passes tell of pixels besides their colours, or not.
    pub(super) fn keep_data(&mut self, is_wanted: bool) {
        self.data = self.known.clone().filter(|_| is_wanted);
    }

    /// Takes the first sample of each pixel of a window, and sets what `of` makes of it. Gives the numbers that are kept besides.
    pub(super) fn first_samples<T>(
        &self,
        window: &mut Window<T>,
        stats: &mut Stats,
        of: impl Fn(Sample) -> T,
    ) -> Result<Numbers, BackendError> {
        let tile = window.tile;
        let starts = self.starts(tile, stats)?;
        let parts = self.sample(Pixels::of_tile(tile, &starts), &self.samples[..1], stats)?;
        let encode = |part: &Part<_>| self.encoded(&part.colours);
        let encoded: Vec<_> = timed(&mut stats.shade, || parts.iter().map(encode).collect::<Result<_, _>>())?;
        // Light is only for sums with that of others, and for who wants it.
        let keeps = self.keeps_light();
        let linear = parts.iter().filter(|_| keeps).map(|part| &part.colours);
        let wanted = encoded.iter().map(|srgb| (srgb, ENCODED)).chain(linear.map(|linear| (linear, LINEAR)));
        self.read(&parts, wanted.chain(self.data_of(&parts)).collect(), stats, |results, stats| match results {
            Results::F32(results) => self.set_samples(&parts, &results, window, stats, of),
            Results::F64(results) => self.set_samples(&parts, &results, window, stats, of),
        })
    }

    /// The columns that are kept besides colours, of the parts that have some.
    fn data_of<'p>(&'p self, parts: &'p [Part<B::Columns>]) -> impl Iterator<Item = Wanted<'p, B::Columns>> {
        let kept = self.data.as_ref().map_or(&[][..], |kept| &kept.columns[..]);
        parts.iter().filter(|_| !kept.is_empty()).filter_map(move |part| Some((part.data.as_ref()?, kept)))
    }

    /// Cuts results into those of the columns that are kept besides colours, one for each part, and the rest.
    fn split_data<'r, 'a, N>(
        &self,
        parts: &[Part<B::Columns>],
        results: Read<'r, 'a, N>,
    ) -> (OfParts<'r, 'a, N>, Read<'r, 'a, N>) {
        let mut rest = results;
        let mut next = |part: &Part<B::Columns>| {
            part.data.as_ref().filter(|_| self.data.is_some())?;
            let (first, others) = rest.split_first()?;
            rest = others;
            Some(&first[..])
        };
        let data = parts.iter().map(&mut next).collect();
        (data, rest)
    }

    /// Sets what `of` makes of first samples.
    fn set_samples<N: Copy + Into<f64>, T>(
        &self,
        parts: &[Part<B::Columns>],
        results: Read<'_, '_, N>,
        window: &mut Window<T>,
        stats: &mut Stats,
        of: impl Fn(Sample) -> T,
    ) -> Numbers {
        let (srgb, others) = results.split_at(parts.len());
        let (linear, others) = others.split_at(if self.keeps_light() { parts.len() } else { 0 });
        let (data, marches) = self.split_data(parts, others);
        let mut numbers = Numbers::new();
        let status = count_marches(parts, marches, stats);
        for (k, Part { pixels, .. }) in parts.iter().enumerate() {
            let (status, linear) = (status[k], linear.get(k));
            let mut first = 0;
            for &row in &pixels.rows {
                let srgb = &srgb[k][0][first..][..row.len as usize];
                let samples = (first..).zip(srgb).map(|(i, &srgb)| {
                    let linear = linear.map_or([0.0; 3], |linear| [0, 1, 2].map(|k| linear[k][i].into() as f32));
                    let hit = status.get(i).is_some_and(|&code| Status::from_code(code.into()) == Status::Hit);
                    of(Sample { linear, srgb: bytes(srgb.into()), hit, start: pixels.start(i) })
                });
                window.set_row(row, samples);
                first += row.len as usize;
            }
            if let Some(kept) = &self.data {
                kept.gather(pixels, data[k], &mut numbers);
            }
        }
        numbers
    }

    /// Takes all but the first sample of each pixel and gives the average of all in sRGB; `first` has the first ones.
    pub(super) fn other_samples<'s>(
        &self,
        pixels: &[(u32, u32)],
        first: impl Fn((u32, u32)) -> (Sample, &'s [f32]),
        stats: &mut Stats,
        mut take: impl FnMut((u32, u32), [u8; 3], [f32; 3], &[f32]),
    ) -> Result<(), BackendError> {
        let parts = self.sample(Pixels::sorted(pixels, |place| first(place).0.start), &self.samples[1..], stats)?;
        let wanted = parts.iter().map(|part| (&part.colours, LINEAR)).chain(self.data_of(&parts)).collect();
        let (averages, numbers) = self.read(&parts, wanted, stats, |results, stats| match results {
            Results::F32(results) => self.averages(&parts, &results, stats, first),
            Results::F64(results) => self.averages(&parts, &results, stats, first),
        })?;
        let encoded = timed(&mut stats.shade, || self.encoded(&self.backend.upload(&averages)?))?;
        let srgb = timed(&mut stats.results, || self.backend.download(&encoded))?;
        stats.refined += pixels.len() as u64;
        let places = parts.iter().flat_map(|part| part.pixels.places());
        for (i, (place, &srgb)) in places.zip(&srgb[0]).enumerate() {
            let width = self.data.as_ref().map_or(0, Kept::width);
            take(place, bytes(srgb), [0, 1, 2].map(|k| averages[k][i] as f32), &numbers[i * width..][..width]);
        }
        Ok(())
    }

    /// The averages of all samples of each pixel, linear, and the numbers that are kept besides.
    fn averages<'s, N: Copy + Into<f64>>(
        &self,
        parts: &[Part<B::Columns>],
        results: Read<'_, '_, N>,
        stats: &mut Stats,
        first: impl Fn((u32, u32)) -> (Sample, &'s [f32]),
    ) -> ([Vec<f64>; 3], Vec<f32>) {
        let (colours, others) = results.split_at(parts.len());
        let (data, marches) = self.split_data(parts, others);
        count_marches(parts, marches, stats);
        let mut numbers = Vec::new();
        for (part, columns) in parts.iter().zip(data).filter(|_| self.data.is_some()) {
            let count = self.samples.len() - 1;
            for (i, place) in part.pixels.places().enumerate() {
                let kept = self.data.iter();
                numbers.extend(kept.flat_map(|kept| kept.joined(first(place).1, columns, (i * count, count))));
            }
        }
        let scale = 1.0 / self.samples.len() as f64;
        let averages = [0, 1, 2].map(|k| {
            let sums = colours.iter().flat_map(|colours| colours[k].chunks_exact(self.samples.len() - 1));
            let places = parts.iter().flat_map(|part| part.pixels.places());
            let mean = |(samples, place): (&[N], (u32, u32))| {
                (f64::from(first(place).0.linear[k]) + samples.iter().map(|&x| x.into()).sum::<f64>()) * scale
            };
            sums.zip(places).map(mean).collect()
        });
        (averages, numbers)
    }

    /// How far nothing is for any ray through each pixel of a tile; `None` without beams.
    pub(super) fn starts(&self, tile: Tile, stats: &mut Stats) -> Result<Option<Starts>, BackendError> {
        let Some((beams, _)) = &self.beams else { return Ok(None) };
        let starts = timed(&mut stats.march, || beams.starts(self.backend, tile))?;
        stats.beams += starts.beams;
        stats.beam_estimates += starts.estimates;
        Ok(Some(starts))
    }

    /// Rays through points of pixels, from the pixels' starts on where there are beams.
    fn rays(&self, pixels: &Pixels, offsets: &[[f64; 2]]) -> Result<B::Columns, BackendError> {
        let ([x, y], starts) = (pixels.points(offsets), pixels.starts(offsets.len()));
        let (slot, inputs) = if self.beams.is_some() { (Slot::Begins, 3) } else { (Slot::Points, 2) };
        self.camera.write(self.backend, slot, &[&x, &y, &starts[..]][..inputs], Slot::Rays)
    }

    /// Rays through points of pixels, one of each.
    pub(super) fn rays_through(&self, pixels: &Pixels, x: &[f64], y: &[f64]) -> Result<B::Columns, BackendError> {
        let starts = pixels.starts(1);
        let (slot, inputs) = if self.beams.is_some() { (Slot::Begins, 3) } else { (Slot::Points, 2) };
        self.camera.write(self.backend, slot, &[x, y, &starts[..]][..inputs], Slot::Rays)
    }

    /// The ends of rays.
    pub(super) fn ends(&self, rays: &B::Columns) -> Result<B::Columns, BackendError> {
        passes::march(self.backend, &self.march, rays)
    }

    /// What leads from points where beams found nothing to colours.
    pub(super) fn background(&self) -> Option<&Chain<B>> {
        self.beams.as_ref().map(|(_, background)| background)
    }

    /// The bytes of colours.
    pub(super) fn encoded(&self, colours: &B::Columns) -> Result<B::Columns, BackendError> {
        let mut written = self.encode.run(self.backend, &[(Slot::Colours, colours)], |_, _| {})?;
        Ok(written.take(Slot::Bytes).expect("colours are encoded"))
    }

    /// Has points of pixels computed: of those where something may be, and of those where beams found nothing.
    fn sample(
        &self,
        [some, empty]: [Pixels; 2],
        offsets: &[[f64; 2]],
        stats: &mut Stats,
    ) -> Result<Vec<Part<B::Columns>>, BackendError> {
        let mut parts = Vec::new();
        if let Some((_, background)) = self.beams.as_ref().filter(|_| empty.count > 0) {
            stats.rays += (empty.count * offsets.len()) as u64;
            let points = empty.points(offsets);
            let colours =
                timed(&mut stats.shade, || background.write(self.backend, Slot::Points, &points, Slot::Backgrounds))?;
            parts.push(Part { pixels: empty, colours, marches: None, data: None });
        }
        if some.count > 0 {
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
        let rays = timed(&mut stats.shade, || self.rays(&pixels, offsets))?;
        let ends = timed(&mut stats.march, || passes::march(self.backend, &self.march, &rays))?;
        let given = [(Slot::Rays, &rays), (Slot::Ends, &ends)];
        let mut written = self.shade.run(self.backend, &given, |role, time| match role {
            Role::ShadowMarch(_) | Role::CornerMarch | Role::PassingMarch => stats.shadow += time,
            _ => stats.shade += time,
        })?;
        let mut colours = written.take(Slot::Colours).expect("every picture has colours");
        let mut data = written.take(Slot::Data);
        let mut further = Vec::new();
        if let Some(mirror) = &self.mirror {
            (colours, further) = self.mirrored(mirror, &mut written, stats)?;
            data = mirror.data(self.backend, (&rays, &ends, &colours))?;
        }
        further.extend(written.rest());
        Ok(Part { pixels, colours, marches: Some((ends, further)), data })
    }

    /// Waits for what was computed and has it read: the columns that are `wanted`, and then those of the parts' marches.
    fn read<R>(
        &self,
        parts: &[Part<B::Columns>],
        wanted: Vec<Wanted<B::Columns>>,
        stats: &mut Stats,
        take: impl FnOnce(Results, &mut Stats) -> R,
    ) -> Result<R, BackendError> {
        let (start, counted, steps) = (Instant::now(), stats.counted(), [Marched::COLUMNS.steps]);
        let mut wanted = wanted;
        for (hits, shadows) in parts.iter().filter_map(|part| part.marches.as_ref()) {
            wanted.push((hits, &counted));
            wanted.extend(shadows.iter().map(|shadows| (shadows, &steps[..])));
        }
        let result = self.backend.read(&wanted, |results| take(results, stats))?;
        stats.results += start.elapsed();
        Ok(result)
    }
}

/// Counts the marches of parts. Gives how those of each part ended; nothing of a part without.
fn count_marches<'a, C, N: Copy + Into<f64>>(
    parts: &[Part<C>],
    marches: Read<'_, 'a, N>,
    stats: &mut Stats,
) -> Vec<&'a [N]> {
    let mut marches = marches.iter();
    let mut next = || marches.next().expect("every march is read");
    let mut count = |part: &Part<C>| {
        let Some((_, shadows)) = &part.marches else { return &[][..] };
        let hits = next();
        stats.count(hits);
        for _ in shadows {
            stats.shadow_estimates += next()[0].iter().map(|&steps| steps.into()).sum::<f64>() as u64;
        }
        hits[0]
    };
    parts.iter().map(&mut count).collect()
}
