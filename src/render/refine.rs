//! Which pixels need more than their first sample.

use super::renderer::Sample;
use crate::film::Tile;

/// Most difference between the first samples of a pixel and its neighbours where one sample is enough, in 255ths of sRGB.
///
/// Over all built-in fractals it leaves at most 0.3 % of pixels off by more than 2 from all samples; 12 leaves twice as
/// many for 1 % less work (see docs/performance-pictures.md).
const MOST_DIFFERENCE: u8 = 8;

/// The first samples of some rows.
pub(super) struct Seen {
    width: u32,
    top: u32,
    pixels: Vec<Sample>,
}

impl Seen {
    /// No rows, before the first.
    pub(super) fn new(width: u32) -> Seen {
        Seen { width, top: 0, pixels: Vec::new() }
    }

    /// The row after the last.
    pub(super) fn end(&self) -> u32 {
        self.top + (self.pixels.len() / self.width as usize) as u32
    }

    /// Makes room for some more rows.
    pub(super) fn extend(&mut self, rows: u32) {
        self.pixels.resize(self.pixels.len() + rows as usize * self.width as usize, Sample::default());
    }

    /// Drops rows above this one.
    pub(super) fn forget_before(&mut self, y: u32) {
        let y = y.max(self.top);
        self.pixels.drain(..(y - self.top) as usize * self.width as usize);
        self.top = y;
    }

    fn index(&self, (x, y): (u32, u32)) -> usize {
        (y - self.top) as usize * self.width as usize + x as usize
    }

    /// Sets a tile's pixels, row by row.
    pub(super) fn set(&mut self, tile: Tile, rows: &[Sample]) {
        for (y, row) in (tile.y..).zip(rows.chunks_exact(tile.width as usize)) {
            let at = self.index((tile.x, y));
            self.pixels[at..at + row.len()].copy_from_slice(row);
        }
    }

    /// The first sample of a pixel of these rows.
    pub(super) fn at(&self, pixel: (u32, u32)) -> Sample {
        self.pixels[self.index(pixel)]
    }

    /// Colours of rows, three bytes a pixel.
    pub(super) fn bytes(&self, from: u32, to: u32) -> Vec<u8> {
        let samples = &self.pixels[self.index((0, from))..self.index((0, to))];
        let mut bytes = vec![0; samples.len() * 3];
        bytes.chunks_exact_mut(3).zip(samples).for_each(|(bytes, sample)| bytes.copy_from_slice(&sample.srgb));
        bytes
    }

    /// Whether a pixel and those around it differ so much that one sample does not stand for it.
    pub(super) fn is_uneven(&self, pixel: (u32, u32)) -> bool {
        let around = |at: u32, end: u32| at.saturating_sub(1)..(at + 2).min(end);
        let (mut least, mut most) = ([u8::MAX; 3], [0; 3]);
        let hit = self.at(pixel).hit;
        for y in around(pixel.1, self.end()) {
            for sample in around(pixel.0, self.width).map(|x| self.at((x, y))) {
                if sample.hit != hit {
                    return true;
                }
                for k in 0..3 {
                    least[k] = least[k].min(sample.srgb[k]);
                    most[k] = most[k].max(sample.srgb[k]);
                }
            }
        }
        (0..3).any(|k| most[k] - least[k] > MOST_DIFFERENCE)
    }
}
