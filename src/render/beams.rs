//! The pre-pass: beams that each hold the rays of a tile of pixels find how far nothing is, so that the rays start there.
//!
//! In come pixels; out comes for each of them a depth that its rays, wherever in the pixel they go through, are known or
//! estimated to be empty up to ([`NOTHING`] where they all leave the bounding sphere). Tiles of [`EDGES`] go from large to small: a
//! beam starts where the one around it ended. The smallest hold as many rays as pay for their beam.

use super::RenderSettings;
use super::stats::column;
use crate::compose::{Bounds, ComposeResult, Composer, Plan, Purpose, compose_estimator};
use crate::graph::Camera;
use crate::kernel::{Backend, BackendError, Kernel, Status};
use crate::march::{MarchSettings, beam_plan, compose_beam_march};
use crate::shade::{self, pixel_radius};

/// Edges of tiles in pixels: powers of two, falling.
const EDGES: [u32; 5] = [32, 8, 4, 2, 1];
/// Rays along the edge of a tile that pay for its beam.
const ENOUGH: u32 = 4;
/// The depth of pixels without anything: beyond every bounding sphere.
pub const NOTHING: f64 = 1e30;
/// Share by which beams are wider than their tiles, for rounding.
const WIDER: f64 = 1e-3;

/// The kernels of beams.
pub struct BeamKernels {
    /// Tiles to beams.
    pub camera: Kernel,
    /// Beams to their ends.
    pub march: Kernel,
    /// Pixel coordinates and starts to rays.
    pub begin: Kernel,
    /// Pixel coordinates to the linear colours of pixels where nothing is.
    pub background: Kernel,
    /// The tiles that beams are for.
    pub tiles: BeamTiles,
}

/// Tiles of a picture.
#[derive(Clone, Debug)]
pub struct BeamTiles {
    /// Radius of a pixel at distance 1.
    pixel_radius: f64,
    /// Edges of tiles in pixels, falling.
    edges: Vec<u32>,
}

impl BeamKernels {
    /// The kernels for a plan's rays within bounds, marched as `march` says; `None` where estimates hold along their ray alone.
    pub fn new(
        composer: &Composer,
        plan: &Plan,
        camera: &Camera,
        (settings, bounds): (&RenderSettings, &Bounds),
        march: &MarchSettings,
    ) -> ComposeResult<Option<BeamKernels>> {
        let Some(plan) = beam_plan(plan) else { return Ok(None) };
        let arena = composer.arena;
        let estimator = compose_estimator(composer, &plan.choices, Purpose::March)?;
        Ok(Some(BeamKernels {
            camera: Kernel::Map(shade::compose_beam(arena, camera, settings.size, bounds)),
            march: Kernel::March(compose_beam_march(arena, estimator, march)),
            begin: Kernel::Map(shade::compose_begin(arena, camera, settings.size, bounds)),
            background: Kernel::Map(shade::compose_background(arena, &composer.graph.look, camera, settings.size)),
            tiles: BeamTiles {
                pixel_radius: pixel_radius(camera, settings.size),
                edges: EDGES.into_iter().filter(|edge| edge * settings.samples.max(1) >= ENOUGH).collect(),
            },
        }))
    }

    /// The kernels with names.
    pub fn named(&self) -> [(&'static str, &Kernel); 4] {
        let [camera, march, begin] = [("beam", &self.camera), ("beam_march", &self.march), ("begin", &self.begin)];
        [camera, march, begin, ("background", &self.background)]
    }
}

/// Beams made ready on a back end.
pub struct Beams<B: Backend> {
    camera: B::Prepared,
    march: B::Prepared,
    /// The colour of pixels where nothing is.
    pub background: B::Prepared,
    tiles: BeamTiles,
}

/// What beams found.
pub struct Starts {
    /// For each pixel, how far nothing is.
    pub depths: Vec<f64>,
    /// Beams marched.
    pub beams: u64,
    /// Their estimates.
    pub estimates: u64,
}

/// Places in the picture and their lists' numbers: tiles, each once, and which of them each item is in.
struct Tiles {
    corners: Vec<(u32, u32)>,
    of: Vec<u32>,
}

impl Tiles {
    fn around(items: &[(u32, u32)], edge: u32) -> Tiles {
        // A grid over the part of the picture that has items holds one more than each tile's number.
        let shift = edge.trailing_zeros();
        let tile = |&(x, y): &(u32, u32)| (x >> shift, y >> shift);
        let (mut low, mut high) = ((u32::MAX, u32::MAX), (0, 0));
        for (x, y) in items.iter().map(tile) {
            low = (low.0.min(x), low.1.min(y));
            high = (high.0.max(x), high.1.max(y));
        }
        let width = (high.0 + 1).saturating_sub(low.0) as usize;
        let mut numbers = vec![0_u32; width * (high.1 + 1).saturating_sub(low.1) as usize];
        let mut corners = Vec::new();
        let mut number = |(column, row): (u32, u32)| {
            let number = &mut numbers[(row - low.1) as usize * width + (column - low.0) as usize];
            if *number == 0 {
                corners.push((column << shift, row << shift));
                *number = corners.len() as u32;
            }
            *number - 1
        };
        let of = items.iter().map(|item| number(tile(item))).collect();
        Tiles { corners, of }
    }
}

impl<B: Backend> Beams<B> {
    /// Beams for tiles from kernels that `needed` gives by the names of [`BeamKernels::named`].
    pub fn new(
        tiles: &BeamTiles,
        mut needed: impl FnMut(&str) -> Result<B::Prepared, BackendError>,
    ) -> Result<Beams<B>, BackendError> {
        let (camera, march, background) = (needed("beam")?, needed("beam_march")?, needed("background")?);
        Ok(Beams { camera, march, background, tiles: tiles.clone() })
    }

    /// How far nothing is for all rays through each of the pixels.
    pub fn starts(&self, backend: &B, pixels: &[(u32, u32)]) -> Result<Starts, BackendError> {
        // From pixels to larger and larger tiles, then back with depths.
        let mut levels_of: Vec<(u32, Tiles)> = Vec::new();
        for &edge in self.tiles.edges.iter().rev() {
            let items = levels_of.last().map_or(pixels, |(_, tiles)| &tiles.corners);
            let tiles = Tiles::around(items, edge);
            levels_of.push((edge, tiles));
        }
        let mut starts = Starts { depths: Vec::new(), beams: 0, estimates: 0 };
        let mut depths: Option<Vec<f64>> = None;
        for (edge, tiles) in levels_of.iter().rev() {
            let begin = depths.unwrap_or_else(|| vec![0.0; tiles.corners.len()]);
            let ends = self.march(backend, *edge, &tiles.corners, begin, &mut starts)?;
            depths = Some(tiles.of.iter().map(|&tile| ends[tile as usize]).collect());
        }
        starts.depths = depths.unwrap_or_else(|| vec![0.0; pixels.len()]);
        Ok(starts)
    }

    /// Marches the beams of tiles from where they begin to where they end.
    fn march(
        &self,
        backend: &B,
        edge: u32,
        corners: &[(u32, u32)],
        begin: Vec<f64>,
        counts: &mut Starts,
    ) -> Result<Vec<f64>, BackendError> {
        let half = f64::from(edge) / 2.0;
        let centre = |of: fn(&(u32, u32)) -> u32| corners.iter().map(|c| f64::from(of(c)) + half).collect();
        // Half the diagonal of the tile in the plane at distance 1; on the unit sphere it is no longer.
        let spread = f64::from(edge) * self.tiles.pixel_radius * std::f64::consts::SQRT_2 * (1.0 + WIDER);
        let columns = [centre(|c| c.0), centre(|c| c.1), vec![spread; corners.len()], begin];
        let rays = backend.run(&self.camera, &[&backend.upload(&columns)?])?;
        let ends = backend.run(&self.march, &[&rays])?;
        let ends = backend.download_only(&ends, &["t", "status", "steps"].map(column))?;
        let [t, status, steps] = [0, 1, 2].map(|i| &ends[i]);
        counts.beams += corners.len() as u64;
        counts.estimates += steps.iter().sum::<f64>() as u64;
        let end = |(&status, &w): (&f64, &f64)| match Status::from_code(status) {
            Status::Miss => NOTHING,
            // A hit threshold in front, so that rounding puts no ray behind the end.
            _ => w / spread * (1.0 - self.tiles.pixel_radius),
        };
        Ok(status.iter().zip(t).map(end).collect())
    }
}
