//! Which precision a view needs: how many units of the last place lie between two pixels.
//!
//! In comes a [`Pipeline`]; a few of its rays are marched in f64, and out comes the [`Resolution`] of the view: its
//! footprints against the spacing of numbers where the rays hit. A footprint is a pixel's diameter at the hit.

use crate::expr::Arena;
use crate::kernel::BackendError;
use crate::kernel::cpu::Cpu;
use crate::math::Precision;
use crate::render::{Marches, Pipeline, passes};
use crate::shade::{self, Size};

/// Columns and rows of the rays that are marched.
const GRID: Size = Size { width: 24, height: 14 };
/// The hit that decides is the nearest but this share: single pixels may stay coarse.
const SHARE: f64 = 0.1;

/// Least footprint in units of the last place of the larger of the hit's coordinates and depth. Measured
/// (docs/precision.md): with u units nine of ten depths are within 1/u footprints of the right ones. A march walks in steps
/// of an eighth of a footprint, which must be a unit at least.
pub const LEAST_ULPS: f64 = 8.0;

/// How fine a view is.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Resolution {
    /// Footprint of the near hits, in world units.
    pub footprint: f64,
    /// Size of the numbers there: the larger of coordinates and depth.
    pub size: f64,
}

impl Resolution {
    /// The footprint in units of the last place.
    pub fn ulps(&self, precision: Precision) -> f64 {
        self.footprint / precision.ulp(self.size)
    }

    /// Whether a precision can tell the view's pixels apart.
    pub fn fits(&self, precision: Precision) -> bool {
        self.ulps(precision) >= LEAST_ULPS
    }

    /// How many times closer a precision can go at this place.
    pub fn room(&self, precision: Precision) -> f64 {
        self.ulps(precision) / LEAST_ULPS
    }
}

/// Measures a view by a few hundred rays, marched in f64. Where none of them hits, the camera's target stands in.
///
/// In a plane orbits soon come to numbers of size 1 and more, wherever the picture is, and round there.
pub fn resolution(arena: &Arena, pipeline: &Pipeline, size: Size) -> Resolution {
    if let Some(plane) = &pipeline.plane {
        let farthest = plane.center.iter().fold(1.0, |most: f64, x| most.max(x.abs() + plane.height / 2.0));
        return Resolution { footprint: shade::pixel_size(plane, size), size: farthest };
    }
    let hits = march(arena, pipeline, size).expect("the CPU runs every kernel");
    let at = |t: f64, p: [f64; 3]| Resolution {
        footprint: pipeline.pixel.footprint(t),
        size: p.iter().fold(t, |most, x| most.max(x.abs())),
    };
    let mut all: Vec<Resolution> = hits.into_iter().map(|(t, p)| at(t, p)).collect();
    all.sort_by(|a, b| a.ulps(Precision::F64).total_cmp(&b.ulps(Precision::F64)));
    let target = pipeline.camera.target;
    let distance = (glam::DVec3::from(target) - glam::DVec3::from(pipeline.camera.position)).length();
    all.get((all.len() as f64 * SHARE) as usize).copied().unwrap_or_else(|| at(distance, target))
}

/// Depths and points of the hits of an even grid of pixels; a camera in the set hits nothing.
fn march(arena: &Arena, pipeline: &Pipeline, size: Size) -> Result<Vec<(f64, [f64; 3])>, BackendError> {
    let grid = Size { width: GRID.width.min(size.width), height: GRID.height.min(size.height) };
    let cpu = Cpu::new(Precision::F64);
    let ends = Marches::new(&cpu, arena, &pipeline.passes)?.run(&cpu, &passes::grid(grid, size))?;
    let hits = ends.hits().zip(ends.marched().rays());
    Ok(hits.filter(|(_, end)| !end.begins_inside()).filter_map(|(hit, _)| hit).collect())
}
