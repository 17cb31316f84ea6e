//! Pixels that are rendered together.

use std::borrow::Cow;

use super::beams::{NOTHING, Starts};
use crate::film::{Row, Tile};

/// Pixels, and how far nothing is for any ray through each; those without anything have none of that.
pub(super) struct Pixels {
    /// The pixels, in the order of their samples.
    pub rows: Vec<Row>,
    /// How many they are.
    pub count: usize,
    starts: Vec<f64>,
}

impl Pixels {
    fn with_capacity(most: usize) -> Pixels {
        // Most rows are those of a block.
        Pixels { rows: Vec::with_capacity(most / 8), count: 0, starts: Vec::with_capacity(most) }
    }

    /// Pixels of these places that start where `start` says.
    pub fn starting(places: impl ExactSizeIterator<Item = (u32, u32)>, start: impl Fn((u32, u32)) -> f64) -> Pixels {
        let mut pixels = Pixels::with_capacity(places.len());
        places.for_each(|place| pixels.push(place, start(place)));
        pixels
    }

    /// Pixels, cut into those where something may be and those without anything.
    pub fn sorted(places: &[(u32, u32)], start: impl Fn((u32, u32)) -> f64) -> [Pixels; 2] {
        let mut cut = [0, 1].map(|_| Pixels::with_capacity(places.len()));
        places.iter().for_each(|&place| Pixels::sort_into(&mut cut, place, start(place)));
        cut
    }

    /// The pixels of a tile, cut into those where something may be and those without anything.
    pub fn of_tile(tile: Tile, starts: &Option<Starts>) -> [Pixels; 2] {
        let mut cut = [0, 1].map(|_| Pixels::with_capacity(tile.count()));
        for block in tile.cut(8) {
            let [some, empty] = &mut cut;
            let Some(starts) = starts else {
                some.push_block(block);
                continue;
            };
            // Most blocks are all of one kind.
            match starts.are_nothing(block) {
                Some(true) => empty.push_block(block),
                Some(false) => {
                    some.push_block(block);
                    block.rows().for_each(|row| some.starts.extend(starts.row((row.x, row.y)).take(row.len as usize)));
                }
                None => {
                    let pixels = block.rows().flat_map(|row| row.places().zip(starts.row((row.x, row.y))));
                    pixels.for_each(|(place, start)| Pixels::sort_into(&mut cut, place, start));
                }
            }
        }
        // What has none yet.
        let [some, _] = &mut cut;
        some.starts.resize(some.count, 0.0);
        cut
    }

    fn push_block(&mut self, block: Tile) {
        self.rows.extend(block.rows());
        self.count += block.count();
    }

    /// Takes a pixel, where something may be into the first of two and without anything into the second.
    #[inline]
    fn sort_into([some, empty]: &mut [Pixels; 2], place: (u32, u32), start: f64) {
        match start >= NOTHING {
            true => empty.push_place(place),
            false => some.push(place, start),
        }
    }

    #[inline]
    fn push(&mut self, place: (u32, u32), start: f64) {
        self.push_place(place);
        self.starts.push(start);
    }

    #[inline]
    fn push_place(&mut self, place: (u32, u32)) {
        self.count += 1;
        if !self.rows.last_mut().is_some_and(|row| row.take(place)) {
            self.rows.push(Row { x: place.0, y: place.1, len: 1 });
        }
    }

    /// The pixels' places.
    pub fn places(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.rows.iter().flat_map(Row::places)
    }

    /// How far nothing is for any ray through a pixel.
    #[inline]
    pub fn start(&self, number: usize) -> f64 {
        self.starts.get(number).copied().unwrap_or(NOTHING)
    }

    /// How far nothing is for rays through so many points of each pixel.
    pub fn starts(&self, points: usize) -> Cow<'_, [f64]> {
        match points {
            1 => Cow::Borrowed(&self.starts),
            _ => self.starts.iter().flat_map(|&start| std::iter::repeat_n(start, points)).collect(),
        }
    }

    /// Columns of x and y of points at offsets in each pixel; those of a pixel are neighbours, so they are marched together.
    pub fn points(&self, offsets: &[[f64; 2]]) -> [Vec<f64>; 2] {
        let [mut x, mut y] = [0, 1].map(|_| Vec::with_capacity(self.count * offsets.len()));
        if let [only] = offsets {
            for row in &self.rows {
                x.extend((row.x..row.x + row.len).map(|x| f64::from(x) + only[0]));
                y.extend(std::iter::repeat_n(f64::from(row.y) + only[1], row.len as usize));
            }
            return [x, y];
        }
        for place in self.places() {
            x.extend(offsets.iter().map(|offset| f64::from(place.0) + offset[0]));
            y.extend(offsets.iter().map(|offset| f64::from(place.1) + offset[1]));
        }
        [x, y]
    }
}

/// The bytes of a colour as [`compose_develop`](crate::film::compose_develop) gives it.
#[inline]
pub(super) fn bytes(srgb: f64) -> [u8; 3] {
    // Numbers from here on are whole: the last bits of a sum are those of the whole number that was added.
    const WHOLE: f64 = (1_u64 << 52) as f64;
    let [blue, green, red, ..] = (srgb + WHOLE).to_bits().to_le_bytes();
    [red, green, blue]
}

/// Where the samples of a pixel lie in it: on a grid with this many on an edge, the one nearest to the centre first.
pub(super) fn sample_offsets(edge: u32) -> Vec<[f64; 2]> {
    let at = |k: u32| (f64::from(k) + 0.5) / f64::from(edge);
    let mut offsets: Vec<[f64; 2]> = (0..edge * edge).map(|i| [at(i / edge), at(i % edge)]).collect();
    let middle = ((edge - 1) / 2 * (edge + 1)) as usize;
    offsets[..=middle].rotate_right(1);
    offsets
}
