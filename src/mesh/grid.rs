//! The lattice of points that a body is sampled on, in blocks of 4 x 4 x 4.

use crate::compose::Sides;

/// A point of the world.
pub type Point = [f64; 3];

/// Fewest and most cells along the longest edge of a region.
pub const CELLS: std::ops::RangeInclusive<u32> = 4..=4096;
/// Points along an edge of a block.
pub const EDGE: u32 = 4;
/// Cells around the region: what is outside of it is never in the body, so that meshes are closed.
const BORDER: u32 = 1;

/// How far points are moved from where the grid would be even, in cells: off the planes of symmetry that thin parts of sets like to lie in.
const SHIFT: [f64; 3] = [0.137, 0.211, 0.173];

/// A lattice of points over a region, and one cell more on each side. A point belongs to one block of 4 x 4 x 4 points.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Grid {
    /// What is sampled: the body ends where it does.
    pub region: Sides,
    /// The point with the least coordinates.
    pub origin: Point,
    /// Distance of neighbouring points, in world units.
    pub cell: f64,
    /// Points along each axis.
    pub points: [u32; 3],
    /// Blocks along each axis.
    pub blocks: [u32; 3],
}

impl Grid {
    /// The lattice with so many cells along the region's longest edge. `resolution` is one of [`CELLS`], edges are above 0.
    pub fn new(region: Sides, resolution: u32) -> Grid {
        let edges = [0, 1, 2].map(|k| region.high[k] - region.low[k]);
        let cell = edges.into_iter().fold(0.0, f64::max) / f64::from(resolution);
        // Edges that are whole numbers of cells but for rounding stay so.
        let points = edges.map(|edge| (edge / cell - 1e-6).ceil().max(1.0) as u32 + 1 + 2 * BORDER);
        let first =
            |k: usize| (region.low[k] + region.high[k]) / 2.0 + cell * (SHIFT[k] - f64::from(points[k] - 1) / 2.0);
        Grid { region, origin: [0, 1, 2].map(first), cell, points, blocks: points.map(|count| count.div_ceil(EDGE)) }
    }

    /// The same region with other cells.
    #[must_use]
    pub fn with_resolution(&self, resolution: u32) -> Grid {
        Grid::new(self.region, resolution)
    }

    /// A point of the lattice; places between points are between them.
    pub fn at(&self, place: [f64; 3]) -> Point {
        [0, 1, 2].map(|k| self.origin[k] + self.cell * place[k])
    }

    /// All blocks.
    pub fn block_count(&self) -> u64 {
        self.blocks.iter().map(|count| u64::from(*count)).product()
    }

    /// The number of a block.
    pub fn key(&self, block: [u32; 3]) -> u32 {
        (block[2] * self.blocks[1] + block[1]) * self.blocks[0] + block[0]
    }

    /// The block of a number.
    pub fn block(&self, key: u32) -> [u32; 3] {
        let [x, y, _] = self.blocks;
        [key % x, key / x % y, key / x / y]
    }

    /// The number of the neighbour of a block along an axis; `None` beyond the lattice.
    pub fn neighbour(&self, key: u32, axis: usize, up: bool) -> Option<u32> {
        let mut block = self.block(key);
        block[axis] = if up { block[axis] + 1 } else { block[axis].checked_sub(1)? };
        (block[axis] < self.blocks[axis]).then(|| self.key(block))
    }

    /// The point of a bit of a block's word: x in the lowest two bits, then y, then z.
    pub fn corner(&self, key: u32, bit: u32) -> [u32; 3] {
        let block = self.block(key);
        [0, 1, 2].map(|k| block[k] * EDGE + (bit >> (2 * k) & 3))
    }
}

/// The words of a block and its neighbours, a bit a point.
pub mod word {
    /// The words' bits moved down along an axis by a point; the last ones are those of the `next` block.
    pub const fn moved(word: u64, next: u64, axis: usize) -> u64 {
        match axis {
            0 => (word >> 1 & 0x7777_7777_7777_7777) | (next & 0x1111_1111_1111_1111) << 3,
            1 => (word >> 4 & 0x0fff_0fff_0fff_0fff) | (next & 0x000f_000f_000f_000f) << 12,
            _ => word >> 16 | next << 48,
        }
    }

    /// The bits of the points of a face.
    pub const fn face(axis: usize, up: bool) -> u64 {
        let lowest: u64 = match axis {
            0 => 0x1111_1111_1111_1111,
            1 => 0x000f_000f_000f_000f,
            _ => 0xffff,
        };
        if up { lowest << (3 << (2 * axis)) } else { lowest }
    }
}

#[cfg(test)]
mod tests {
    use super::{Grid, word};
    use crate::compose::Sides;

    #[test]
    fn grids_have_a_border() {
        let region = Sides { low: [-1.0, 0.0, 2.0], high: [1.0, 1.0, 2.1] };
        let grid = Grid::new(region, 20);
        assert_eq!((grid.points, grid.blocks), ([23, 13, 4], [6, 4, 1]));
        assert!((grid.cell - 0.1).abs() < 1e-12);
        assert!((grid.at([11.0, 6.0, 1.5])[2] - 2.05 - 0.1 * super::SHIFT[2]).abs() < 1e-12);
        let key = grid.key([5, 3, 0]);
        assert_eq!((grid.block(key), grid.neighbour(key, 0, true)), ([5, 3, 0], None));
        assert_eq!(grid.neighbour(key, 1, false), Some(grid.key([5, 2, 0])));
        assert_eq!(grid.corner(key, 0b100111), [23, 13, 2]);
    }

    #[test]
    fn words_move_into_their_neighbours() {
        for axis in 0..3 {
            let (low, high) = (word::face(axis, false), word::face(axis, true));
            assert_eq!((low.count_ones(), high.count_ones(), low & high), (16, 16, 0));
            assert_eq!(word::moved(0, low, axis), high);
            assert_eq!(word::moved(low, 0, axis), 0);
            assert_eq!(word::moved(u64::MAX, u64::MAX, axis), u64::MAX);
        }
    }
}
