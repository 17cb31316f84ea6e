//! A picture in bands: the first pass over each, what has to be refined, and the second pass.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use rayon::prelude::*;

use super::data::Kept;
use super::meter::{Meter, Progress};
use super::refine::Seen;
use super::{Renderer, Sampling, Stats};
use crate::film::{Image, Layer, Layers, Rows, Tile, Window, windows};
use crate::kernel::{Backend, BackendError};

/// Why a render ended early.
pub(super) enum Halt {
    Stopped,
    Failed(BackendError),
}

impl<B: Backend> Renderer<'_, B> {
    /// Renders the whole picture into memory. `progress` receives the share that is done and returns false to stop.
    pub fn render(&mut self, progress: &mut Progress) -> Result<Option<Image>, BackendError> {
        let mut image = Image { size: self.size, rgb: Vec::new() };
        let mut sink = |mut rows: Vec<u8>| {
            image.rgb.append(&mut rows);
            true
        };
        let done = self.render_rows(&mut sink, progress)?;
        Ok(done.then_some(image))
    }

    /// Renders the picture from the top and hands its rows on as they are done, three bytes of sRGB a pixel; memory holds
    /// one band of them. Both `sink` and `progress` return false to stop, and then the result is false.
    pub fn render_rows(
        &mut self,
        sink: &mut dyn FnMut(Vec<u8>) -> bool,
        progress: &mut Progress,
    ) -> Result<bool, BackendError> {
        self.render_rows_from(0, sink, progress)
    }

    /// [`Renderer::render_rows`] from row `first` on: the rows are the same as those of the whole picture. So a picture goes on
    /// at its finished rows where a device failed. From the picture's height on there is nothing to do.
    pub fn render_rows_from(
        &mut self,
        first: u32,
        sink: &mut dyn FnMut(Vec<u8>) -> bool,
        progress: &mut Progress,
    ) -> Result<bool, BackendError> {
        self.render_rows_of(first..self.size.height, sink, progress)
    }

    /// [`Renderer::render_rows`] of these rows alone, which are the same as those of the whole picture.
    pub fn render_rows_of(
        &mut self,
        rows: Range<u32>,
        sink: &mut dyn FnMut(Vec<u8>) -> bool,
        progress: &mut Progress,
    ) -> Result<bool, BackendError> {
        self.render_layers(rows, Layers::SRGB, &mut |rows| sink(rows.srgb), progress)
    }

    /// [`Renderer::render_rows_of`] with the layers that are wanted.
    pub fn render_layers(
        &mut self,
        rows: Range<u32>,
        layers: Layers,
        sink: &mut dyn FnMut(Rows) -> bool,
        progress: &mut Progress,
    ) -> Result<bool, BackendError> {
        self.keeps_radiance = layers.has(Layer::Radiance);
        self.keep_data(!layers.data().is_empty());
        let start = Instant::now();
        let mut stats = self.stats.clone();
        let done = self.bands(rows, sink, progress, &mut stats);
        stats.render = start.elapsed();
        self.stats = stats;
        match done {
            Ok(()) => Ok(true),
            Err(Halt::Stopped) => Ok(false),
            Err(Halt::Failed(error)) => Err(error),
        }
    }

    fn bands(
        &self,
        rows: Range<u32>,
        sink: &mut dyn FnMut(Rows) -> bool,
        progress: &mut Progress,
        stats: &mut Stats,
    ) -> Result<(), Halt> {
        let (width, height) = (self.size.width, self.size.height);
        let (first, end) = (rows.start, rows.end.min(height));
        let left = f64::from(end.saturating_sub(first));
        let pixels = f64::from(width) * left;
        let meter = match &self.tracer {
            Some(tracer) => Meter::new(progress, pixels * f64::from(tracer.count()), 1),
            None => Meter::new(progress, pixels, self.samples.len()),
        };
        // Rows of a band, and those above and below it.
        let most =
            if self.keeps_light() && self.tracer.is_none() { height.min(self.cut.band.saturating_add(2)) } else { 0 };
        let each = self.data.as_ref().map_or(0, Kept::width);
        let mut seen = Seen::new(width, first.saturating_sub(1), most, each);
        for y in (first..end).step_by(self.cut.band as usize) {
            let band = Tile { x: 0, y, width, height: self.cut.band.min(end - y) };
            let rows = match self.keeps_light() {
                _ if self.tracer.is_some() => self.traced(band, &meter, stats)?,
                false => Rows { srgb: self.only_pass(band, &meter, stats)?, ..Rows::default() },
                true => self.both_passes(band, &mut seen, &meter, stats)?,
            };
            if !sink(rows) {
                return Err(Halt::Stopped);
            }
        }
        meter.finish();
        Ok(())
    }

    /// The colours of a band's pixels with one sample each.
    fn only_pass(&self, band: Tile, meter: &Meter, stats: &mut Stats) -> Result<Vec<u8>, Halt> {
        let mut rgb = vec![[0; 3]; band.count()];
        let tiles = windows(band, &mut rgb, self.cut.tile);
        self.in_parts(tiles, meter, stats, |mut pixels, part| {
            self.first_samples(&mut pixels, part, |sample| sample.srgb)?;
            meter.advance(pixels.tile.count());
            Ok(())
        })?;
        Ok(rgb.into_flattened())
    }

    /// The colours of a band's pixels with more samples where they are needed.
    fn both_passes(&self, band: Tile, seen: &mut Seen, meter: &Meter, stats: &mut Stats) -> Result<Rows, Halt> {
        let end = band.y + band.height;
        // Whether a pixel of the last row is refined depends on the row below it.
        let (rows, samples) = seen.extend((end + 1).min(self.size.height));
        let numbers = self.in_parts(windows(rows, samples, self.cut.tile), meter, stats, |mut pixels, part| {
            let numbers = self.first_samples(&mut pixels, part, |sample| sample)?;
            meter.advance(pixels.tile.count());
            Ok(numbers)
        })?;
        numbers.iter().for_each(|numbers| seen.set_numbers(numbers));
        let mut rgb = vec![[0; 3]; band.count()];
        let refined = self.uneven(band, seen, &mut rgb);
        let mut light = if self.keeps_radiance { seen.light(band) } else { Vec::new() };
        let mut data = if self.data.is_some() { seen.numbers(band) } else { Vec::new() };
        meter.decide(band.count(), refined.len());
        self.second_pass(band, (seen, &refined), (&mut rgb, &mut light, &mut data), meter, stats)?;
        seen.forget_before(end - 1);
        let layers = self.data.as_ref().map_or(Layers::NONE, |kept| kept.layers);
        Ok(Rows { srgb: rgb.into_flattened(), radiance: light.into_flattened(), layers, data, ..Rows::default() })
    }

    /// Gives the pixels of a band the colours of their first samples, and says which need the others, tile by tile.
    fn uneven(&self, band: Tile, seen: &Seen, rgb: &mut [[u8; 3]]) -> Vec<(u32, u32)> {
        let all = self.sampling == Sampling::Full;
        let has_others = self.samples.len() > 1;
        let of_tile = |mut pixels: Window<[u8; 3]>| {
            let mut places = pixels.tile.pixels();
            places.iter().for_each(|&place| pixels.set(place, seen.at(place).srgb));
            places.retain(|&place| has_others && (all || seen.is_uneven(place)));
            places
        };
        windows(band, rgb, self.cut.tile).into_par_iter().flat_map_iter(of_tile).collect()
    }

    /// Takes the other samples of the pixels that need them, and replaces the first colours by theirs.
    fn second_pass(
        &self,
        band: Tile,
        (seen, refined): (&Seen, &[(u32, u32)]),
        (rgb, light, data): (&mut [[u8; 3]], &mut [[f32; 3]], &mut [f32]),
        meter: &Meter,
        stats: &mut Stats,
    ) -> Result<(), Halt> {
        // Pixels of many tiles together, so that no run is short.
        let parts = refined.chunks((self.cut.rays / self.samples.len()).max(1)).collect();
        let results = self.in_parts(parts, meter, stats, |pixels, part| {
            let mut colours = Vec::with_capacity(pixels.len());
            self.other_samples(
                pixels,
                |place| (seen.at(place), seen.numbers_at(place)),
                part,
                |place, srgb, light, numbers| {
                    colours.push((place, srgb, light, numbers.to_vec()));
                },
            )?;
            meter.advance(pixels.len() * (self.samples.len() - 1));
            Ok(colours)
        })?;
        for ((x, y), srgb, radiance, numbers) in results.into_iter().flatten() {
            let at = (y - band.y) as usize * band.width as usize + x as usize;
            rgb[at] = srgb;
            if let Some(light) = light.get_mut(at) {
                *light = radiance;
            }
            data[at * numbers.len()..][..numbers.len()].copy_from_slice(&numbers);
        }
        Ok(())
    }

    /// Does parts of the work, as many at the same time as the back end gains from, and adds up what they count. Results come
    /// in any order.
    pub(super) fn in_parts<T: Send, R: Send>(
        &self,
        parts: Vec<T>,
        meter: &Meter,
        stats: &mut Stats,
        work: impl Fn(T, &mut Stats) -> Result<R, BackendError> + Sync,
    ) -> Result<Vec<R>, Halt> {
        let lanes = self.at_once.min(rayon::current_num_threads()).min(parts.len());
        let queue = Mutex::new(parts.into_iter());
        let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
        // Each lane takes the next part that none has taken, until one of them ends early.
        let is_ended = AtomicBool::new(false);
        let lane = |_| {
            let mut counted = Stats { undecided: self.stats.undecided.map(|_| 0), ..Stats::default() };
            let mut done = Vec::new();
            while let Some(part) = next().filter(|_| !is_ended.load(Ordering::Relaxed)) {
                if meter.is_stopped() {
                    return Err(Halt::Stopped);
                }
                let result = work(part, &mut counted).inspect_err(|_| is_ended.store(true, Ordering::Relaxed));
                done.push(result.map_err(Halt::Failed)?);
            }
            Ok((done, counted))
        };
        let lanes: Result<Vec<_>, Halt> = (0..lanes).into_par_iter().with_max_len(1).map(lane).collect();
        let (done, counted): (Vec<Vec<R>>, Vec<Stats>) = lanes?.into_iter().unzip();
        counted.iter().for_each(|counted| stats.add(counted));
        Ok(done.into_iter().flatten().collect())
    }
}
