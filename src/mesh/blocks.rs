//! Which blocks of a grid the surface passes, and the signs of their points.
//!
//! First cubes of blocks are taken apart as an octree, from all of the grid down to single blocks: what a ball around a cube is proven or
//! estimated to be empty of is not opened. Then blocks are opened from outside inwards: those beside empty ones, and from each
//! opened block those beside its points that are outside. So the inside of a body is never opened, and what a body encloses without
//! a way out that the grid shows stays closed. Last, empty blocks beside points that are inside are opened after all: there the
//! estimate was wrong, or the surface lies just between. After that all pairs of neighbours that differ are known, so the surface has no gap.

use rayon::prelude::*;

use super::bits::{Bits, Ranked};
use super::field::{Ball, Field};
use super::grid::{EDGE, Grid, word};
use super::{Point, Progress, Trouble};

/// Blocks that are asked at once.
const AT_ONCE: usize = 1 << 13;
/// Blocks along the edge of the largest cubes, and how many of them are taken apart at once.
const WIDEST: u32 = 32;
const LARGEST_AT_ONCE: usize = 32;
/// Blocks along the edge of cubes that are taken apart even if their middle is inside.
const COARSE: u32 = 8;

/// How blocks were found empty.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Shares {
    /// Blocks that are proven empty.
    pub proven: u64,
    /// Blocks that are empty by the estimate with a margin.
    pub estimated: u64,
    /// Empty blocks that were opened after all, since points beside them are inside.
    pub reopened: u64,
    /// Blocks that were opened.
    pub opened: u64,
}

/// The blocks of a grid.
pub(super) struct Blocks {
    pub grid: Grid,
    pub shares: Shares,
    /// Blocks in which nothing is.
    empty: Bits,
    /// Blocks whose points are known.
    open: Ranked,
    /// Numbers and signs of these, in order: a bit is set where a point is inside.
    pub signs: Vec<(u32, u64)>,
}

/// A cube of blocks, and how many there are along its edge.
type Cube = ([u32; 3], u32);

impl Blocks {
    /// Finds the blocks of a body.
    ///
    /// Errors: the back end's; the progress ends it.
    pub fn new(grid: Grid, field: &dyn Field, progress: &mut Progress) -> Result<Blocks, Trouble> {
        let count = grid.block_count();
        let mut search = Search {
            grid,
            field,
            empty: Bits::new(count),
            queued: Bits::new(count),
            shares: Shares::default(),
            found: Vec::new(),
        };
        search.octree(progress)?;
        let mut candidates = search.beside_empty();
        candidates.iter().for_each(|key| search.queued.add(*key));
        let mut are_tried = false;
        let mut open = Bits::new(count);
        loop {
            search.flood(&mut open, candidates, are_tried, progress)?;
            search.found.par_sort_unstable_by_key(|(key, _)| *key);
            let ranked = Ranked::new(open);
            candidates = search.wrongly_empty(&ranked);
            if candidates.is_empty() {
                let Search { empty, mut shares, found, .. } = search;
                shares.opened = found.len() as u64;
                return Ok(Blocks { grid, shares, empty, open: ranked, signs: found });
            }
            open = ranked.into_bits();
            search.shares.reopened += candidates.len() as u64;
            candidates.iter().for_each(|key| search.empty.remove(*key));
            are_tried = true;
        }
    }

    /// The place of an open block among the open ones.
    pub fn place(&self, key: u32) -> Option<usize> {
        self.open.place(key)
    }

    /// The signs of a block, opened or not; beyond the grid nothing is inside.
    pub fn word(&self, block: [u32; 3]) -> u64 {
        if (0..3).any(|k| block[k] >= self.grid.blocks[k]) {
            return 0;
        }
        let key = self.grid.key(block);
        match self.open.place(key) {
            Some(place) => self.signs[place].1,
            None if self.empty.has(key) => 0,
            None => u64::MAX,
        }
    }

    /// Whether a point of the grid is inside.
    pub fn is_inside(&self, point: [u32; 3]) -> bool {
        let bit: u32 = (0..3).map(|k| (point[k as usize] % EDGE) << (2 * k)).sum();
        self.word(point.map(|at| at / EDGE)) >> bit & 1 == 1
    }

    /// The places of the open blocks of a layer: those with this z.
    pub fn layer(&self, z: u32) -> std::ops::Range<usize> {
        let each = self.grid.blocks[0] * self.grid.blocks[1];
        let from = |z: u32| self.signs.partition_point(|(key, _)| u64::from(*key) < u64::from(z) * u64::from(each));
        from(z)..from(z + 1)
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> u64 {
        self.signs.len() as u64 * 16 + self.grid.block_count() / 8 * 5 / 2
    }
}

struct Search<'a> {
    grid: Grid,
    field: &'a dyn Field,
    empty: Bits,
    /// Blocks that are or were candidates.
    queued: Bits,
    shares: Shares,
    /// Numbers and signs of the blocks that are open.
    found: Vec<(u32, u64)>,
}

impl Search<'_> {
    /// Finds the empty cubes: some of the largest at a time, level by level, so that few cubes are held at once.
    fn octree(&mut self, progress: &mut Progress) -> Result<(), Trouble> {
        let [x, y, z] = self.grid.blocks.map(|count| count.div_ceil(WIDEST));
        let largest = (0..x * y * z).map(|i| ([i % x, i / x % y, i / x / y].map(|at| at * WIDEST), WIDEST));
        let largest: Vec<Cube> = largest.collect();
        for some in largest.chunks(LARGEST_AT_ONCE) {
            let (mut cubes, mut edge) = (some.to_vec(), WIDEST);
            while !cubes.is_empty() {
                cubes = self.level(&cubes, edge, progress)?;
                edge /= 2;
            }
        }
        Ok(())
    }

    /// Notes which cubes of one size are empty, and gives the parts of the others.
    fn level(&mut self, cubes: &[Cube], edge: u32, progress: &mut Progress) -> Result<Vec<Cube>, Trouble> {
        let mut next = Vec::new();
        for some in cubes.chunks(AT_ONCE * 16) {
            progress.advance(some.len())?;
            for (cube, ball) in some.iter().zip(self.ask(some)?) {
                match ball {
                    Ball::Proven | Ball::Estimated => self.clear(*cube, ball),
                    Ball::Inside if edge <= COARSE => {}
                    Ball::Inside | Ball::Open => next.extend(self.parts(*cube)),
                }
            }
        }
        Ok(next)
    }

    /// What is known of cubes of one size, by balls around them.
    fn ask(&self, cubes: &[Cube]) -> Result<Vec<Ball>, Trouble> {
        let edge = f64::from(cubes.first().map_or(1, |cube| cube.1) * EDGE);
        let middle = |cube: &Cube| self.grid.at(cube.0.map(|at| f64::from(at * EDGE) + edge / 2.0));
        let middles: Vec<Point> = cubes.iter().map(middle).collect();
        Ok(self.field.balls(&middles, edge / 2.0 * 3f64.sqrt() * self.grid.cell)?)
    }

    /// The eight parts of a cube that are in the grid.
    fn parts(&self, (at, edge): Cube) -> impl Iterator<Item = Cube> {
        let (half, blocks) = (edge / 2, self.grid.blocks);
        let part = move |i: u32| ([0, 1, 2].map(|k| at[k as usize] + half * (i >> k & 1)), half);
        let is_in = move |cube: &Cube| (0..3).all(|k| cube.0[k] < blocks[k]);
        (0..if half > 0 { 8 } else { 0 }).map(part).filter(is_in)
    }

    /// Notes that a cube is empty.
    fn clear(&mut self, (at, edge): Cube, ball: Ball) {
        let end = [0, 1, 2].map(|k| (at[k] + edge).min(self.grid.blocks[k]));
        let mut count = 0;
        for z in at[2]..end[2] {
            for y in at[1]..end[1] {
                (at[0]..end[0]).for_each(|x| self.empty.add(self.grid.key([x, y, z])));
                count += u64::from(end[0].saturating_sub(at[0]));
            }
        }
        match ball {
            Ball::Proven => self.shares.proven += count,
            _ => self.shares.estimated += count,
        }
    }

    /// The blocks that are not empty beside those that are, or beside the end of the grid.
    fn beside_empty(&self) -> Vec<u32> {
        let [x, y, z] = self.grid.blocks;
        let is_beside = |key: &u32| {
            let neighbours = (0..6).map(|side| self.grid.neighbour(*key, side / 2, side % 2 == 1));
            !self.empty.has(*key) && neighbours.into_iter().any(|other| other.is_none_or(|other| self.empty.has(other)))
        };
        (0..z).into_par_iter().flat_map_iter(|z| (z * x * y..(z + 1) * x * y).filter(is_beside)).collect()
    }

    /// Opens candidates, and from them on all that is beside points that are outside. Candidates that `are_tried` are not asked whether
    /// they are empty.
    fn flood(
        &mut self,
        open: &mut Bits,
        mut candidates: Vec<u32>,
        mut are_tried: bool,
        progress: &mut Progress,
    ) -> Result<(), Trouble> {
        while !candidates.is_empty() {
            let mut next = Vec::new();
            for some in candidates.chunks(AT_ONCE) {
                progress.advance(some.len())?;
                let (opened, cleared) = if are_tried { (some.to_vec(), Vec::new()) } else { self.tried(some)? };
                for key in cleared {
                    self.empty.add(key);
                    (0..6).for_each(|side| self.queue(key, side, &mut next));
                }
                progress.advance(opened.len() * 64)?;
                for (key, word) in self.sample(&opened)? {
                    open.add(key);
                    self.found.push((key, word));
                    let outside = (0..6).filter(|side| !word & word::face(side / 2, side % 2 == 1) != 0);
                    outside.for_each(|side| self.queue(key, side, &mut next));
                }
            }
            next.par_sort_unstable();
            (candidates, are_tried) = (next, false);
        }
        Ok(())
    }

    /// Makes the neighbour at a side of a block a candidate, unless it is empty or has been one.
    fn queue(&mut self, key: u32, side: usize, next: &mut Vec<u32>) {
        let other = self.grid.neighbour(key, side / 2, side % 2 == 1);
        if let Some(other) = other.filter(|other| !self.empty.has(*other) && !self.queued.has(*other)) {
            self.queued.add(other);
            next.push(other);
        }
    }

    /// Blocks that have to be opened, and those that are empty.
    fn tried(&mut self, keys: &[u32]) -> Result<(Vec<u32>, Vec<u32>), Trouble> {
        let cubes: Vec<Cube> = keys.iter().map(|key| (self.grid.block(*key), 1)).collect();
        let balls = self.ask(&cubes)?;
        let is_open = |ball: &Ball| matches!(ball, Ball::Open | Ball::Inside);
        self.shares.proven += balls.iter().filter(|ball| **ball == Ball::Proven).count() as u64;
        self.shares.estimated += balls.iter().filter(|ball| **ball == Ball::Estimated).count() as u64;
        let (open, empty): (Vec<_>, Vec<_>) = keys.iter().zip(balls).partition(|(_, ball)| is_open(ball));
        let keys = |some: Vec<(&u32, Ball)>| some.into_iter().map(|(key, _)| *key).collect();
        Ok((keys(open), keys(empty)))
    }

    /// The signs of blocks.
    fn sample(&self, keys: &[u32]) -> Result<Vec<(u32, u64)>, Trouble> {
        let point = |key: u32, bit: u32| self.grid.at(self.grid.corner(key, bit).map(f64::from));
        let points: Vec<Point> = keys.iter().flat_map(|key| (0..64).map(|bit| point(*key, bit))).collect();
        let inside = self.field.inside(&points)?;
        let word = |inside: &[bool]| inside.iter().rev().fold(0, |word, inside| word << 1 | u64::from(*inside));
        Ok(keys.iter().copied().zip(inside.chunks(64).map(word)).collect())
    }

    /// Empty blocks beside points of open ones that are inside.
    fn wrongly_empty(&self, open: &Ranked) -> Vec<u32> {
        let wrong = |(key, word): &(u32, u64)| {
            let (key, word) = (*key, *word);
            let sides = (0..6).filter(move |side| word & word::face(side / 2, side % 2 == 1) != 0);
            let others = sides.filter_map(move |side| self.grid.neighbour(key, side / 2, side % 2 == 1));
            others.filter(|other| self.empty.has(*other) && open.place(*other).is_none())
        };
        let mut all: Vec<u32> = self.found.par_iter().flat_map_iter(wrong).collect();
        all.par_sort_unstable();
        all.dedup();
        all
    }
}
