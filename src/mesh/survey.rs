//! What a mesh will be like, by meshes of fewer cells: whether the set is solid, how large the file becomes, and how long it takes.

use std::time::{Duration, Instant};

use super::blocks::Blocks;
use super::build::{Nowhere, Part, nothing, write};
use super::field::{Body, Field, Kernels};
use super::format::Format;
use super::report::Tally;
use super::simplify::BYTES;
use super::surface::{Placing, Shell};
use super::{Grid, Progress, Trouble};
use crate::kernel::Backend;

/// Cells of the finer of two meshes that are looked at.
const CELLS: std::ops::RangeInclusive<u32> = 16..=96;
/// Distance up to which thin sets are made bodies, in cells.
const SHEET: f64 = 0.5;
/// A set whose members make less than this share of the surface that is half a cell around it is thin.
const THIN: f64 = 0.2;
/// Bytes of what works besides: kernels, buffers, points that are asked at once.
const BASE: u64 = 120 << 20;
/// Bytes of a vertex in the window of layers, with its points and columns.
const WINDOW: u64 = 400;

/// What a mesh will be like, roughly.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Forecast {
    /// Vertices.
    pub vertices: f64,
    /// Triangles.
    pub triangles: f64,
    /// Bytes of the file.
    pub file: f64,
    /// Bytes of memory, from above.
    pub memory: f64,
    /// Points that are asked.
    pub points: f64,
    /// Time on this machine.
    pub time: Duration,
}

/// What a look at a body says.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Survey {
    /// Distance of members up to which points belong to the body, in cells.
    pub thickness: f64,
    /// Whether that was chosen here, since the set is thin.
    pub is_thin: bool,
    /// What the mesh will be like.
    pub forecast: Forecast,
}

/// One mesh of few cells.
struct Look {
    vertices: f64,
    triangles: f64,
    open: f64,
    points: f64,
    time: Duration,
}

/// Looks at a body with few cells. `thickness` is what is asked for, in cells; `None` lets the set decide.
///
/// Errors: the back end's; a body of which nothing is in the region.
pub fn survey<B: Backend>(
    grid: &Grid,
    thickness: Option<f64>,
    (kernels, backend): (&Kernels, &B),
    (format, printability, share): (Format, bool, f64),
    progress: &mut Progress,
) -> Result<Survey, Trouble> {
    let edge = (0..3).map(|k| grid.region.high[k] - grid.region.low[k]).fold(0.0, f64::max);
    let resolution = (edge / grid.cell).round().max(1.0);
    let fine = ((resolution / 4.0) as u32).clamp(*CELLS.start(), *CELLS.end());
    let mut body = Body::new(kernels, backend, grid.region, (0.0, grid.cell))?;
    let with_looks = format.has_looks() || printability;
    let mut look = |cells: u32, thickness: f64| {
        let coarse = grid.with_resolution(cells);
        body.set_cells(thickness * coarse.cell, coarse.cell);
        look_at(coarse, &body, with_looks, progress)
    };
    let (thickness, is_thin, found) = match thickness {
        Some(thickness) => (thickness, false, look(fine, thickness)?),
        None => {
            let [solid, sheet] = [look(fine, 0.0)?, look(fine, SHEET)?];
            if sheet.vertices == 0.0 {
                return Err(nothing());
            }
            if solid.vertices < THIN * sheet.vertices { (SHEET, true, sheet) } else { (0.0, false, solid) }
        }
    };
    let coarse = look(fine / 2, thickness)?;
    // By which power of the cells the surface grows.
    let power = (found.vertices.max(1.0) / coarse.vertices.max(1.0)).log2().clamp(1.5, 3.0);
    let times = (resolution / f64::from(fine)).powf(power);
    let forecast = forecast(grid, &found, times, (format, printability, share));
    Ok(Survey { thickness, is_thin, forecast })
}

/// Makes a mesh of few cells and forgets it.
fn look_at(grid: Grid, field: &dyn Field, with_looks: bool, progress: &mut Progress) -> Result<Look, Trouble> {
    let (start, asked) = (Instant::now(), progress.asked());
    let shell = Shell::new(Blocks::new(grid, field, progress)?)?;
    let placing = Placing { middle: [0.0; 3], scale: 1.0 };
    let mut tally = Tally::new(shell.vertices(), false);
    let part = Part { shell: &shell, field, first: 0, is_inner: false };
    write(&[part], (&placing, with_looks), (&mut Nowhere, &mut tally), progress)?;
    Ok(Look {
        vertices: shell.vertices() as f64,
        triangles: shell.triangles as f64,
        open: shell.blocks.signs.len() as f64,
        points: progress.asked() - asked,
        time: start.elapsed(),
    })
}

/// What a mesh of so many times as many vertices will be like.
fn forecast(grid: &Grid, found: &Look, times: f64, (format, printability, share): (Format, bool, f64)) -> Forecast {
    let (vertices, triangles, open) = (found.vertices * times, found.triangles * times, found.open * times);
    let layers = f64::from(grid.blocks[2]);
    // Words, numbers of vertices and cells; sets of all blocks; a window of layers.
    let held = open * 32.0 + grid.block_count() as f64 * 0.4 + 4.0 * vertices / layers * WINDOW as f64;
    let each = format.memory() + if printability { 4 } else { 0 };
    let whole = if share < 1.0 { vertices * BYTES as f64 } else { 0.0 };
    Forecast {
        vertices: vertices * share,
        triangles: triangles * share,
        file: format.bytes((vertices * share) as u64, (triangles * share) as u64) as f64,
        memory: held + BASE as f64 + vertices * each as f64 + whole,
        points: found.points * times,
        time: found.time.mul_f64(times.min(1e9)),
    }
}
