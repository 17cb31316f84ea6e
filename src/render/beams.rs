//! The pre-pass: beams that each hold the rays of a tile of pixels find how far nothing is, so that the rays start there.
//!
//! In comes a rectangle of pixels; out comes for each of them a depth that its rays, wherever in the pixel they go through,
//! are known or estimated to be empty up to ([`NOTHING`] where they all leave the bounding sphere). Tiles of [`EDGES`] go from large to small: a
//! beam starts where the one around it ended. The smallest hold as many rays as pay for their beam.

use super::RenderSettings;
use super::passes::{Chain, Pass, Passes, Role, Slot};
use crate::compose::{Bounds, ComposeResult, Composer, Plan, Purpose, compose_estimator};
use crate::film::Tile;
use crate::graph::Camera;
use crate::kernel::records::Marched;
use crate::kernel::{Backend, BackendError, Kernel, Status};
use crate::march::{MarchSettings, beam_plan, compose_beam_march};
use crate::shade::{self, Lighting, beam_radius};

/// Edges of tiles in pixels: powers of two, falling.
const EDGES: [u32; 5] = [32, 8, 4, 2, 1];
/// Rays along the edge of a tile that pay for its beam.
const ENOUGH: u32 = 4;
/// The depth of pixels without anything: beyond every bounding sphere.
pub const NOTHING: f64 = 1e30;
/// Share by which beams are wider than their tiles, for rounding.
const WIDER: f64 = 1e-3;

/// Tiles of a picture.
#[derive(Clone, Debug)]
pub struct BeamTiles {
    /// What directions differ by at most per half a pixel (see [`beam_radius`]).
    pixel_radius: f64,
    /// Edges of tiles in pixels, falling.
    edges: Vec<u32>,
}

/// Adds the passes of beams for a plan's rays within bounds, marched as `march` says, and gives their tiles; `None` where
/// estimates hold along their ray alone, or no cone holds the lens's rays.
pub(super) fn compose_beams(
    passes: &mut Passes<Kernel>,
    composer: &Composer,
    plan: &Plan,
    (camera, lighting): (&Camera, &Lighting),
    (settings, bounds): (&RenderSettings, &Bounds),
    march: &MarchSettings,
) -> ComposeResult<Option<BeamTiles>> {
    let Some(plan) = beam_plan(plan) else { return Ok(None) };
    let Some(pixel_radius) = beam_radius(camera, settings.size) else { return Ok(None) };
    let (arena, size) = (composer.arena, settings.size);
    let estimator = compose_estimator(composer, &plan.choices, Purpose::March)?;
    let beam = Kernel::Map(shade::compose_beam(arena, camera, size, bounds));
    passes.push(Role::Beam, [Slot::Tiles], Slot::Beams, beam);
    let march = Kernel::March(compose_beam_march(arena, estimator, march));
    passes.push(Role::BeamMarch, [Slot::Beams], Slot::BeamEnds, march);
    let begin = Kernel::Map(shade::compose_begin(arena, camera, size, bounds));
    passes.push(Role::Begin, [Slot::Begins], Slot::Rays, begin);
    let background = Kernel::Map(shade::compose_background(arena, lighting, camera, size));
    passes.push(Role::Background, [Slot::Points], Slot::Backgrounds, background);
    Ok(Some(BeamTiles {
        pixel_radius,
        edges: EDGES.into_iter().filter(|edge| edge * settings.samples.max(1) >= ENOUGH).collect(),
    }))
}

/// Beams made ready on a back end.
pub struct Beams<B: Backend> {
    /// From tiles to the ends of their beams.
    chain: Chain<B>,
    tiles: BeamTiles,
}

/// How far nothing is, by tiles of one size.
pub struct Starts {
    /// Binary logarithm of the tiles' edge.
    shift: u32,
    /// The rectangle of tiles, counted in tiles.
    tiles: Tile,
    /// Their depths, row by row.
    depths: Vec<f64>,
    /// Beams marched, of all sizes.
    pub beams: u64,
    /// Their estimates.
    pub estimates: u64,
}

impl Starts {
    /// How far nothing is for all rays through a pixel of the rectangle.
    #[inline]
    pub fn at(&self, (x, y): (u32, u32)) -> f64 {
        self.depths[self.index((x >> self.shift, y >> self.shift))]
    }

    /// Depths of pixels of a row, from the first of them on.
    #[inline]
    pub fn row(&self, (first, y): (u32, u32)) -> impl Iterator<Item = f64> + '_ {
        let row = &self.depths[self.index((first >> self.shift, y >> self.shift))..];
        (first..).map(move |x| row[((x >> self.shift) - (first >> self.shift)) as usize])
    }

    /// Whether no ray through some pixels meets anything, or any may; `None` where some do not and others may.
    pub fn are_nothing(&self, pixels: Tile) -> Option<bool> {
        let tiles = pixels.grouped(self.shift);
        let rows = (tiles.y..tiles.y + tiles.height).map(|y| self.index((tiles.x, y)));
        let empty = rows.flat_map(|at| &self.depths[at..at + tiles.width as usize]).filter(|&&depth| depth >= NOTHING);
        let empty = empty.count();
        (empty == 0 || empty == tiles.count()).then_some(empty > 0)
    }

    #[inline]
    fn index(&self, (x, y): (u32, u32)) -> usize {
        ((y - self.tiles.y) * self.tiles.width + x - self.tiles.x) as usize
    }
}

impl<B: Backend> Beams<B> {
    /// Beams for tiles from passes whose kernels `prepare` makes ready.
    pub fn new<K>(
        tiles: &BeamTiles,
        passes: &Passes<K>,
        prepare: impl FnMut(&Pass<K>) -> Result<B::Prepared, BackendError>,
    ) -> Result<Beams<B>, BackendError> {
        let chain = Chain::new(passes, &[Slot::Tiles], &[Slot::BeamEnds], prepare)?;
        Ok(Beams { chain, tiles: tiles.clone() })
    }

    /// How far nothing is for all rays through each pixel of a rectangle.
    pub fn starts(&self, backend: &B, pixels: Tile) -> Result<Starts, BackendError> {
        // Before the largest tiles, one that is everything.
        let tiles = Tile { x: 0, y: 0, width: 1, height: 1 };
        let start = Starts { shift: u32::BITS - 1, tiles, depths: vec![0.0], beams: 0, estimates: 0 };
        self.tiles.edges.iter().try_fold(start, |around, &edge| self.march(backend, edge, pixels, &around))
    }

    /// How far nothing is for all rays through each of some pixels: the same as [`Beams::starts`] has for them.
    pub fn starts_of(&self, backend: &B, pixels: &[(u32, u32)]) -> Result<Vec<f64>, BackendError> {
        self.tiles.edges.iter().try_fold(vec![0.0; pixels.len()], |begin, &edge| {
            let shift = edge.trailing_zeros();
            let places: Vec<(u32, u32)> = pixels.iter().map(|&(x, y)| (x >> shift, y >> shift)).collect();
            Ok(self.ends(backend, edge, &places, begin)?.0)
        })
    }

    /// Marches the beams of all tiles of an edge that have some of the pixels, from where those around them ended.
    fn march(&self, backend: &B, edge: u32, pixels: Tile, around: &Starts) -> Result<Starts, BackendError> {
        let shift = edge.trailing_zeros();
        let tiles = pixels.grouped(shift);
        let places = tiles.pixels();
        let begin = places.iter().map(|&(x, y)| around.at((x << shift, y << shift))).collect();
        let (ends, estimates) = self.ends(backend, edge, &places, begin)?;
        let mut starts = Starts {
            shift,
            tiles,
            depths: vec![0.0; places.len()],
            beams: around.beams + places.len() as u64,
            estimates: around.estimates + estimates,
        };
        for (&place, end) in places.iter().zip(ends) {
            let index = starts.index(place);
            starts.depths[index] = end;
        }
        Ok(starts)
    }

    /// Where the beams of tiles of an edge end that begin at these depths, and their estimates.
    fn ends(
        &self,
        backend: &B,
        edge: u32,
        places: &[(u32, u32)],
        begin: Vec<f64>,
    ) -> Result<(Vec<f64>, u64), BackendError> {
        let shift = edge.trailing_zeros();
        let half = f64::from(edge) / 2.0;
        let centre = |of: fn(&(u32, u32)) -> u32| places.iter().map(|p| f64::from(of(p) << shift) + half).collect();
        // Half the diagonal of the tile in the plane at distance 1; on the unit sphere it is no longer.
        let spread = f64::from(edge) * self.tiles.pixel_radius * std::f64::consts::SQRT_2 * (1.0 + WIDER);
        let columns = [centre(|p| p.0), centre(|p| p.1), vec![spread; places.len()], begin];
        let ends = self.chain.write(backend, Slot::Tiles, &columns, Slot::BeamEnds)?;
        let ends =
            backend.download_only(&ends, &[Marched::COLUMNS.t, Marched::COLUMNS.status, Marched::COLUMNS.steps])?;
        let [t, status, steps] = [0, 1, 2].map(|i| &ends[i]);
        let end = |status: f64, w: f64| match Status::from_code(status) {
            Status::Miss => NOTHING,
            // A hit threshold in front, so that rounding puts no ray behind the end.
            _ => w / spread * (1.0 - self.tiles.pixel_radius),
        };
        let ends = status.iter().zip(t).map(|(&status, &w)| end(status, w)).collect();
        Ok((ends, steps.iter().sum::<f64>() as u64))
    }
}
