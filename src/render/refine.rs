//! Which pixels need more than their first sample.

use rayon::prelude::*;

use super::data::Numbers;
use super::renderer::Sample;
use crate::film::Tile;

/// Most difference between the first samples of a pixel and its neighbours where one sample is enough, in 255ths of sRGB.
///
/// Over all built-in fractals it leaves at most 0.3 % of pixels off by more than 2 from all samples; 12 leaves twice as
/// many for 1 % less work (see docs/lab/performance-pictures.md).
const MOST_DIFFERENCE: u8 = 8;

/// The first samples of some rows.
pub(super) struct Seen {
    width: u32,
    top: u32,
    /// Rows that are there.
    rows: u32,
    /// Memory for the most rows: those that are there, then any numbers.
    pixels: Vec<Sample>,
    /// What is kept of each of them besides: so many numbers a pixel.
    numbers: Vec<f32>,
    each: usize,
}

impl Seen {
    /// No rows, before row `top`, and memory for so many, with `each` numbers a pixel.
    pub(super) fn new(width: u32, top: u32, most: u32, each: usize) -> Seen {
        // New memory is made ready by all threads.
        let pixels = (0..width as usize * most as usize).into_par_iter().map(|_| Sample::default()).collect();
        let numbers = vec![0.0; width as usize * most as usize * each];
        Seen { width, top, rows: 0, pixels, numbers, each }
    }

    /// The row after the last.
    pub(super) fn end(&self) -> u32 {
        self.top + self.rows
    }

    /// Takes rows up to this one, which are to be written.
    pub(super) fn extend(&mut self, end: u32) -> (Tile, &mut [Sample]) {
        let rows = Tile { x: 0, y: self.end(), width: self.width, height: end - self.end() };
        let from = self.index((0, rows.y));
        self.rows += rows.height;
        (rows, &mut self.pixels[from..][..rows.count()])
    }

    /// Drops rows above this one.
    pub(super) fn forget_before(&mut self, y: u32) {
        let y = y.max(self.top);
        let kept = self.index((0, y))..self.index((0, self.end()));
        self.numbers.copy_within(kept.start * self.each..kept.end * self.each, 0);
        self.pixels.copy_within(kept, 0);
        self.rows = self.end() - y;
        self.top = y;
    }

    #[inline]
    fn index(&self, (x, y): (u32, u32)) -> usize {
        (y - self.top) as usize * self.width as usize + x as usize
    }

    /// The first sample of a pixel of these rows.
    #[inline]
    pub(super) fn at(&self, pixel: (u32, u32)) -> Sample {
        self.pixels[self.index(pixel)]
    }

    /// Sets the numbers of pixels.
    pub(super) fn set_numbers(&mut self, numbers: &Numbers) {
        for (row, numbers) in numbers {
            let at = self.index((row.x, row.y)) * self.each;
            self.numbers[at..at + numbers.len()].copy_from_slice(numbers);
        }
    }

    /// The numbers of a pixel of these rows.
    pub(super) fn numbers_at(&self, pixel: (u32, u32)) -> &[f32] {
        &self.numbers[self.index(pixel) * self.each..][..self.each]
    }

    /// The numbers of a band's pixels.
    pub(super) fn numbers(&self, band: Tile) -> Vec<f32> {
        self.numbers[self.index((0, band.y)) * self.each..][..band.count() * self.each].to_vec()
    }

    /// The light of a band's first samples.
    pub(super) fn light(&self, band: Tile) -> Vec<[f32; 3]> {
        self.pixels[self.index((0, band.y))..][..band.count()].iter().map(|sample| sample.linear).collect()
    }

    /// Whether a pixel and those around it differ so much that one sample does not stand for it.
    pub(super) fn is_uneven(&self, pixel: (u32, u32)) -> bool {
        let around = |at: u32, end: u32| at.saturating_sub(1)..(at + 2).min(end);
        let (mut least, mut most) = ([u8::MAX; 3], [0; 3]);
        let (columns, hit) = (around(pixel.0, self.width), self.at(pixel).hit);
        for y in around(pixel.1, self.end()) {
            for sample in &self.pixels[self.index((columns.start, y))..][..columns.len()] {
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
