//! A picture in bands: the first pass over each, what has to be refined, and the second pass.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;

use super::meter::{Meter, Progress};
use super::refine::Seen;
use super::renderer::Sample;
use super::{Renderer, Sampling, Stats};
use crate::film::{Image, Tile};
use crate::kernel::{Backend, BackendError};

/// Why a render ended early.
enum Halt {
    Stopped,
    Failed(BackendError),
}

/// Puts pixels' colours into a band that is as wide as the picture.
fn set_pixels(rgb: &mut [u8], band: Tile, pixels: &[(u32, u32)], colours: impl IntoIterator<Item = [u8; 3]>) {
    for (&(x, y), srgb) in pixels.iter().zip(colours) {
        let at = ((y - band.y) as usize * band.width as usize + x as usize) * 3;
        rgb[at..at + 3].copy_from_slice(&srgb);
    }
}

impl<B: Backend> Renderer<'_, B> {
    /// Renders the whole picture into memory. `progress` is told the share that is done and returns false to stop.
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
        let start = Instant::now();
        let mut stats = self.stats.clone();
        let done = self.bands(sink, progress, &mut stats);
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
        sink: &mut dyn FnMut(Vec<u8>) -> bool,
        progress: &mut Progress,
        stats: &mut Stats,
    ) -> Result<(), Halt> {
        let (width, height) = (self.size.width, self.size.height);
        let meter = Meter::new(progress, f64::from(width) * f64::from(height), self.samples.len());
        let mut seen = Seen::new(width);
        for y in (0..height).step_by(self.cut.band as usize) {
            let band = Tile { x: 0, y, width, height: self.cut.band.min(height - y) };
            let rgb = match self.samples.len() {
                1 => self.only_pass(band, &meter, stats)?,
                _ => self.both_passes(band, &mut seen, &meter, stats)?,
            };
            if !sink(rgb) {
                return Err(Halt::Stopped);
            }
        }
        meter.finish();
        Ok(())
    }

    /// The colours of a band's pixels with one sample each.
    fn only_pass(&self, band: Tile, meter: &Meter, stats: &mut Stats) -> Result<Vec<u8>, Halt> {
        let tiles = band.cut(self.cut.tile);
        let results = self.in_parts(&tiles, meter, stats, |tile, part| {
            let pixels = tile.pixels();
            let colours = self.first_colours(&pixels, part)?;
            meter.advance(pixels.len());
            Ok((pixels, colours))
        })?;
        let mut rgb = vec![0; band.width as usize * band.height as usize * 3];
        results.into_iter().for_each(|(pixels, colours)| set_pixels(&mut rgb, band, &pixels, colours));
        Ok(rgb)
    }

    /// The colours of a band's pixels with more samples where they are needed.
    fn both_passes(&self, band: Tile, seen: &mut Seen, meter: &Meter, stats: &mut Stats) -> Result<Vec<u8>, Halt> {
        let end = band.y + band.height;
        // Whether a pixel of the last row is refined hangs on the row below it.
        let ahead = (end + 1).min(self.size.height);
        let rows = Tile { x: 0, y: seen.end(), width: band.width, height: ahead - seen.end() };
        self.first_pass(rows, seen, meter, stats)?;
        let mut rgb = seen.bytes(band.y, end);
        self.second_pass(band, seen, &mut rgb, meter, stats)?;
        seen.forget_before(end - 1);
        Ok(rgb)
    }

    /// Takes the first sample of every pixel of the next rows.
    fn first_pass(&self, rows: Tile, seen: &mut Seen, meter: &Meter, stats: &mut Stats) -> Result<(), Halt> {
        let tiles = rows.cut(self.cut.tile);
        let results = self.in_parts(&tiles, meter, stats, |tile, part| {
            let pixels = tile.pixels();
            let samples = self.first_samples(&pixels, part)?;
            meter.advance(pixels.len());
            let mut rows = vec![Sample::default(); pixels.len()];
            for (&(x, y), sample) in pixels.iter().zip(samples) {
                rows[((y - tile.y) * tile.width + x - tile.x) as usize] = sample;
            }
            Ok(rows)
        })?;
        seen.extend(rows.height);
        tiles.iter().zip(results).for_each(|(tile, rows)| seen.set(*tile, &rows));
        Ok(())
    }

    /// Takes the other samples of the pixels that need them, and puts their colours in the place of the first ones.
    fn second_pass(
        &self,
        band: Tile,
        seen: &Seen,
        rgb: &mut [u8],
        meter: &Meter,
        stats: &mut Stats,
    ) -> Result<(), Halt> {
        let all = self.sampling == Sampling::Full;
        let wanted = |tile: Tile| tile.pixels().into_iter().filter(|&pixel| all || seen.is_uneven(pixel));
        let tiles = band.cut(self.cut.tile);
        let pixels: Vec<(u32, u32)> = tiles.into_par_iter().flat_map_iter(wanted).collect();
        meter.decide(band.width as usize * band.height as usize, pixels.len());
        // Pixels of many tiles together, so that no run is short.
        let parts: Vec<&[(u32, u32)]> = pixels.chunks((self.cut.rays / self.samples.len()).max(1)).collect();
        let results = self.in_parts(&parts, meter, stats, |pixels, part| {
            let firsts: Vec<Sample> = pixels.iter().map(|&pixel| seen.at(pixel)).collect();
            let colours = self.other_samples(pixels, &firsts, part)?;
            meter.advance(pixels.len() * (self.samples.len() - 1));
            Ok(colours)
        })?;
        set_pixels(rgb, band, &pixels, results.into_iter().flatten());
        Ok(())
    }

    /// Does parts of the work, as many at the same time as the back end gains from, and adds up what they count.
    fn in_parts<T: Sync, R: Send>(
        &self,
        parts: &[T],
        meter: &Meter,
        stats: &mut Stats,
        work: impl Fn(&T, &mut Stats) -> Result<R, BackendError> + Sync,
    ) -> Result<Vec<R>, Halt> {
        let run = |part: &T| {
            if meter.is_stopped() {
                return Err(Halt::Stopped);
            }
            let mut counted = Stats { undecided: self.stats.undecided.map(|_| 0), ..Stats::default() };
            let result = work(part, &mut counted).map_err(Halt::Failed)?;
            Ok((result, counted))
        };
        // Each lane takes the next part that none has taken, until one of them ends early.
        let next = AtomicUsize::new(0);
        let lane = |_| {
            let mut done = Vec::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(part) = parts.get(i) else { return Ok(done) };
                let result = run(part).inspect_err(|_| next.store(parts.len(), Ordering::Relaxed))?;
                done.push((i, result));
            }
        };
        let lanes = self.at_once.min(rayon::current_num_threads()).min(parts.len());
        let lanes: Result<Vec<Vec<_>>, Halt> = (0..lanes).into_par_iter().with_max_len(1).map(lane).collect();
        let mut results: Vec<(usize, (R, Stats))> = lanes?.into_iter().flatten().collect();
        results.sort_by_key(|(i, _)| *i);
        let add = |(_, (result, counted)): (usize, (R, Stats))| {
            stats.add(&counted);
            result
        };
        Ok(results.into_iter().map(add).collect())
    }
}
