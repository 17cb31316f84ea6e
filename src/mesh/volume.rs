//! Volumes: whether each point of a grid is inside, or how far it is from the surface, as numbers side by side.

use std::io::Write;
use std::path::Path;

use super::blocks::Blocks;
use super::distance::Distances;
use super::field::{Body, Kernels};
use super::surface::Shell;
use super::{Grid, Progress, Trouble};
use crate::files::{Output, Target, write};
use crate::kernel::Backend;

/// What is said of a point.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Values {
    /// A byte: 255 inside, 0 outside.
    Inside,
    /// A number of single precision: the signed distance from the surface, in units of the world, negative inside. It is right within a cell.
    Distance,
}

/// Where a volume goes.
pub enum Place<'a> {
    /// Pictures of slices across z, the lowest first: `slice_0000.png` and so on in this folder, white inside.
    Slices(&'a Path),
    /// Numbers alone: x changes fastest, then y.
    Raw(&'a Target),
    /// An array of numpy of shape (z, y, x).
    Npy(&'a Target),
    /// Numbers alone, into whatever takes them.
    Into(&'a mut dyn Write),
}

/// Bytes of memory that a volume takes, from above.
pub fn memory(grid: &Grid, values: Values) -> u64 {
    let held = (100 << 20) + grid.block_count();
    held + if values == Values::Distance {
        Distances::bytes(grid) + 24 * grid.block_count()
    } else {
        16 * grid.block_count() / 2
    }
}

/// Makes a volume of a body and writes it. `thickness` is in cells.
///
/// Errors: the back end's, the file's; a body of which no surface is in the grid.
pub fn volume<B: Backend>(
    grid: &Grid,
    thickness: f64,
    (kernels, backend): (&Kernels, &B),
    (values, place): (Values, Place),
    progress: &mut Progress,
) -> Result<(), Trouble> {
    let body = Body::new(kernels, backend, grid.region, (thickness * grid.cell, grid.cell))?;
    let blocks = Blocks::new(*grid, &body, progress)?;
    if blocks.signs.iter().all(|(_, word)| *word == 0) {
        return Err(super::build::nothing());
    }
    match values {
        Values::Inside => pass_on(grid, values, place, |z| blocks_plane(&blocks, z)),
        Values::Distance => {
            let distances = Distances::new(&Shell::new(blocks)?, &body, progress)?;
            let each = (grid.points[0] * grid.points[1]) as usize;
            let number = |value: &f32| (f64::from(*value) * grid.cell) as f32;
            let plane = |z: u32| &distances.values[z as usize * each..(z as usize + 1) * each];
            pass_on(grid, values, place, |z| plane(z).iter().flat_map(|value| number(value).to_le_bytes()).collect())
        }
    }
}

/// Whether the points of a plane are inside, a byte each.
fn blocks_plane(blocks: &Blocks, z: u32) -> Vec<u8> {
    let [x, y, _] = blocks.grid.points;
    (0..y).flat_map(|y| (0..x).map(move |x| if blocks.is_inside([x, y, z]) { 255 } else { 0 })).collect()
}

/// Writes a volume plane by plane.
fn pass_on(grid: &Grid, values: Values, place: Place, plane: impl Fn(u32) -> Vec<u8>) -> Result<(), Trouble> {
    let planes = || (0..grid.points[2]).map(&plane);
    let target = match place {
        Place::Slices(folder) => {
            for (z, plane) in planes().enumerate() {
                write(&folder.join(format!("slice_{z:04}.png")), &png(grid, &plane)?)?;
            }
            return Ok(());
        }
        Place::Into(to) => return Ok(planes().try_for_each(|plane| to.write_all(&plane))?),
        Place::Raw(target) => (target, Vec::new()),
        Place::Npy(target) => (target, npy_head(grid, values)),
    };
    let mut file = std::io::BufWriter::with_capacity(1 << 20, Output::new(target.0)?);
    file.write_all(&target.1)?;
    planes().try_for_each(|plane| file.write_all(&plane))?;
    Ok(file.into_inner().map_err(std::io::IntoInnerError::into_error)?.commit()?)
}

/// A picture of a slice, its y going up.
fn png(grid: &Grid, plane: &[u8]) -> std::io::Result<Vec<u8>> {
    let [x, y, _] = grid.points;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, x, y);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(std::io::Error::other)?;
    let turned: Vec<u8> = plane.chunks(x as usize).rev().flatten().copied().collect();
    writer.write_image_data(&turned).map_err(std::io::Error::other)?;
    writer.finish().map_err(std::io::Error::other)?;
    Ok(bytes)
}

/// The head of an array of numpy, version 1.0 of the format.
fn npy_head(grid: &Grid, values: Values) -> Vec<u8> {
    let [x, y, z] = grid.points;
    let kind = if values == Values::Distance { "<f4" } else { "|u1" };
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({z}, {y}, {x}), }}");
    // Data begins at a multiple of 64 bytes; the last byte before it ends a line.
    while (10 + text.len() + 1) % 64 != 0 {
        text.push(' ');
    }
    text.push('\n');
    let length = (text.len() as u16).to_le_bytes();
    [&b"\x93NUMPY\x01\x00"[..], &length, text.as_bytes()].concat()
}
