//! Signed distances of a grid's points from the surface between them.
//!
//! Points beside the surface know their distance along an edge. That of all others follows from the points that are within half a cell of
//! the surface, on either side of it (the transform of P. Felzenszwalb and D. Huttenlocher, *Distance Transforms of Sampled
//! Functions*, 2012): so it is right within a cell, and on average right.

use rayon::prelude::*;

use super::field::Field;
use super::surface::Shell;
use super::{Grid, Progress, Trouble};

/// What is farther than any square of a distance in a grid.
const FAR: f32 = 1e12;
/// Rows that are taken out of the array at once.
const ROWS: usize = 16;

/// Distances of all points of a grid, in cells: negative inside. The x of a point changes fastest, then its y.
pub(super) struct Distances {
    pub values: Vec<f32>,
}

impl Distances {
    /// Bytes of the distances of a grid while they are found: of a rough surface many points are beside it.
    pub fn bytes(grid: &Grid) -> u64 {
        8 * points(grid) as u64
    }

    /// Finds the distances.
    ///
    /// Errors: the back end's; the progress ends it.
    pub fn new(shell: &Shell, field: &dyn Field, progress: &mut Progress) -> Result<Distances, Trouble> {
        let grid = shell.blocks.grid;
        let [x, y, z] = grid.points.map(|count| count as usize);
        let mut values = vec![FAR; points(&grid)];
        let mut beside: Vec<(u32, f32)> = Vec::new();
        for layer in 0..shell.layers() {
            shell.layer_ends(layer, field, progress, |point, distance| {
                let [a, b, c] = point.map(|at| at as usize);
                let place = (c * y + b) * x + a;
                beside.push((place as u32, distance as f32));
                if distance <= 0.5 {
                    values[place] = values[place].min((distance * distance) as f32);
                }
            })?;
        }
        values.par_chunks_mut(x).for_each(|row| transform(row, &mut Envelope::default()));
        values.par_chunks_mut(x * y).for_each(|plane| columns(plane, x));
        for first in (0..y).step_by(ROWS) {
            let rows = first..(first + ROWS).min(y);
            let row = |plane: usize, at: usize| (plane * y + at) * x..(plane * y + at + 1) * x;
            let taken =
                |at: usize| -> Vec<f32> { (0..z).flat_map(|plane| values[row(plane, at)].iter().copied()).collect() };
            let done: Vec<Vec<f32>> = rows
                .clone()
                .into_par_iter()
                .map(|at| {
                    let mut side = taken(at);
                    columns(&mut side, x);
                    side
                })
                .collect();
            for (at, side) in rows.zip(done) {
                side.chunks(x).enumerate().for_each(|(plane, from)| values[row(plane, at)].copy_from_slice(from));
            }
        }
        // The nearest last, so that it stays.
        beside.par_sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        beside.into_iter().for_each(|(place, distance)| values[place as usize] = distance * distance);
        values.par_chunks_mut(x).enumerate().for_each(|(line, row)| {
            for (a, value) in row.iter_mut().enumerate() {
                let is_inside = shell.blocks.is_inside([a, line % y, line / y].map(|at| at as u32));
                *value = value.sqrt() * if is_inside { -1.0 } else { 1.0 };
            }
        });
        Ok(Distances { values })
    }
}

fn points(grid: &Grid) -> usize {
    grid.points.iter().map(|count| *count as usize).product()
}

/// Transforms the columns of rows that lie one after another.
fn columns(rows: &mut [f32], width: usize) {
    let mut envelope = Envelope::default();
    let mut column = vec![0.0; rows.len() / width];
    for a in 0..width {
        column.iter_mut().zip(rows[a..].iter().step_by(width)).for_each(|(to, from)| *to = *from);
        transform(&mut column, &mut envelope);
        column.iter().zip(rows[a..].iter_mut().step_by(width)).for_each(|(from, to)| *to = *from);
    }
}

/// Parabolas that are the lowest somewhere: where their feet are, and from where on they are.
#[derive(Default)]
struct Envelope {
    feet: Vec<usize>,
    from: Vec<f32>,
}

/// Replaces each square of a distance by the least sum of one and the square of the way to it.
fn transform(line: &mut [f32], envelope: &mut Envelope) {
    let Envelope { feet, from } = envelope;
    feet.clear();
    from.clear();
    let meets = |a: usize, b: usize| {
        let (height_a, height_b) = (line[a] + (a * a) as f32, line[b] + (b * b) as f32);
        (height_b - height_a) / (2.0 * (b as f32 - a as f32))
    };
    for foot in (0..line.len()).filter(|&foot| line[foot] < FAR) {
        while let Some(&last) = feet.last()
            && from.last().is_some_and(|start| meets(last, foot) <= *start)
        {
            feet.pop();
            from.pop();
        }
        from.push(feet.last().map_or(f32::NEG_INFINITY, |&last| meets(last, foot)));
        feet.push(foot);
    }
    if feet.is_empty() {
        return;
    }
    let heights: Vec<f32> = feet.iter().map(|&foot| line[foot]).collect();
    let mut k = 0;
    for (at, value) in line.iter_mut().enumerate() {
        while k + 1 < feet.len() && from[k + 1] < at as f32 {
            k += 1;
        }
        let way = at as f32 - feet[k] as f32;
        *value = heights[k] + way * way;
    }
}

#[cfg(test)]
mod tests {
    use super::{Envelope, FAR, transform};

    #[test]
    fn a_line_has_the_nearest_of_all() {
        let before = [FAR, 4.0, FAR, FAR, 0.25, FAR, FAR, 9.0, FAR, FAR, 0.0];
        let mut line = before;
        transform(&mut line, &mut Envelope::default());
        for (at, value) in line.iter().enumerate() {
            let sums = before.iter().enumerate().map(|(foot, height)| height + (at as f32 - foot as f32).powi(2));
            assert_eq!(*value, sums.fold(FAR, f32::min), "{at}");
        }
        let mut empty = [FAR; 4];
        transform(&mut empty, &mut Envelope::default());
        assert_eq!(empty, [FAR; 4]);
    }
}
