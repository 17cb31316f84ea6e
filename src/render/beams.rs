//! The pre-pass: beams that each hold the rays of a tile of pixels find how far nothing is, so that the rays start there.
//!
//! In come pixels; out comes for each of them a depth that its rays, wherever in the pixel they go through, are known or
//! estimated to be empty up to ([`NOTHING`] where they all leave the bounding sphere). Tiles of [`EDGES`] go from large to small: a
//! beam starts where the one around it ended. The smallest hold as many rays as pay for their beam.

use std::collections::HashMap;

use super::RenderSettings;
use crate::compose::{ComposeResult, Composer, Plan, Purpose, compose_estimator};
use crate::graph::Camera;
use crate::kernel::{Backend, BackendError, Kernel, Status, march_output_ports};
use crate::march::{MarchSettings, beam_plan, compose_beam_march};
use crate::shade::{self, pixel_radius};

/// Edges of tiles in pixels; each is a multiple of the next.
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
    /// Rays and starts to rays.
    pub begin: Kernel,
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
    /// The kernels for a plan's rays, marched as `march` says; `None` where estimates hold along their ray alone.
    pub fn new(
        composer: &Composer,
        plan: &Plan,
        camera: &Camera,
        settings: &RenderSettings,
        march: &MarchSettings,
    ) -> ComposeResult<Option<BeamKernels>> {
        let Some(plan) = beam_plan(plan) else { return Ok(None) };
        let arena = composer.arena;
        let estimator = compose_estimator(composer, &plan.choices, Purpose::March)?;
        Ok(Some(BeamKernels {
            camera: Kernel::Map(shade::compose_beam(arena, camera, settings.size, plan.bounding_radius)),
            march: Kernel::March(compose_beam_march(arena, estimator, march)),
            begin: Kernel::Map(shade::compose_begin(arena)),
            tiles: BeamTiles {
                pixel_radius: pixel_radius(camera, settings.size),
                edges: EDGES.into_iter().filter(|edge| edge * settings.samples.max(1) >= ENOUGH).collect(),
            },
        }))
    }

    /// The kernels with names.
    pub fn named(&self) -> [(&'static str, &Kernel); 3] {
        [("beam", &self.camera), ("beam_march", &self.march), ("begin", &self.begin)]
    }
}

/// Beams made ready on a back end.
pub struct Beams<B: Backend> {
    camera: B::Prepared,
    march: B::Prepared,
    begin: B::Prepared,
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
    of: Vec<usize>,
}

impl Tiles {
    fn around(items: &[(u32, u32)], edge: u32) -> Tiles {
        let mut numbers = HashMap::new();
        let mut corners = Vec::new();
        let mut last = ((u32::MAX, 0), 0);
        let mut number = |(x, y): &(u32, u32)| {
            let corner = (x - x % edge, y - y % edge);
            if last.0 != corner {
                let new = numbers.len();
                let number = *numbers.entry(corner).or_insert(new);
                if number == new {
                    corners.push(corner);
                }
                last = (corner, number);
            }
            last.1
        };
        let of = items.iter().map(&mut number).collect();
        Tiles { corners, of }
    }
}

impl<B: Backend> Beams<B> {
    /// Beams for tiles from kernels that `needed` gives by the names of [`BeamKernels::named`].
    pub fn new(
        tiles: &BeamTiles,
        mut needed: impl FnMut(&str) -> Result<B::Prepared, BackendError>,
    ) -> Result<Beams<B>, BackendError> {
        let (camera, march, begin) = (needed("beam")?, needed("beam_march")?, needed("begin")?);
        Ok(Beams { camera, march, begin, tiles: tiles.clone() })
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
            depths = Some(tiles.of.iter().map(|&tile| ends[tile]).collect());
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
        let out = backend.download(&backend.run(&self.march, &[&rays])?)?;
        let column = |name: &str| {
            let at = march_output_ports().iter().position(|port| port.name == name);
            &out[at.expect("the name is one of the march's ports")]
        };
        counts.beams += corners.len() as u64;
        counts.estimates += column("steps").iter().sum::<f64>() as u64;
        let end = |(&status, &w): (&f64, &f64)| match Status::from_code(status) {
            Status::Miss => NOTHING,
            // A hit threshold in front, so that rounding puts no ray behind the end.
            _ => w / spread * (1.0 - self.tiles.pixel_radius),
        };
        Ok(column("status").iter().zip(column("t")).map(end).collect())
    }

    /// The rays, each from where nothing is up to.
    pub fn begin(&self, backend: &B, rays: &B::Columns, starts: &B::Columns) -> Result<B::Columns, BackendError> {
        backend.run(&self.begin, &[rays, starts])
    }
}
