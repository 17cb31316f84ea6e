//! What is left out of a body that is made hollow: all that is deeper inside than its wall is thick.

use super::blocks::Blocks;
use super::distance::Distances;
use super::field::{Ball, Field, Look};
use super::surface::Shell;
use super::{Grid, Point, Progress, Trouble};
use crate::kernel::BackendError;

/// Cells across a wall, and most cells along the longest edge: an inner surface is smooth, so that few do.
const ACROSS: f64 = 6.0;
const MOST: f64 = 320.0;
/// By how many cells distances may be wrong.
const WRONG: f64 = 1.0;

/// The inside of a hollow body.
pub(super) struct Cavity {
    grid: Grid,
    distances: Distances,
    /// Thickness of the wall, in world units.
    wall: f64,
}

impl Cavity {
    /// Finds how deep points of a body are, on a grid of its own. `wall` is in world units.
    ///
    /// Errors: the back end's; a wall that is thinner than two of the grid's cells.
    pub fn new(grid: &Grid, body: &dyn Field, wall: f64, progress: &mut Progress) -> Result<Cavity, Trouble> {
        let edge = (0..3).map(|k| grid.region.high[k] - grid.region.low[k]).fold(0.0, f64::max);
        let cells = (edge / wall * ACROSS).clamp(4.0, MOST);
        if wall < 2.0 * edge / cells {
            return Err(Trouble::Refused {
                text: format!("a wall of {wall:.3e} is too thin for cells of {:.3e}", edge / cells),
                help: "take a thicker wall: --hollow LENGTH".into(),
            });
        }
        let grid = grid.with_resolution(cells.ceil() as u32);
        let shell = Shell::new(Blocks::new(grid, body, progress)?)?;
        Ok(Cavity { grid, distances: Distances::new(&shell, body, progress)?, wall })
    }

    /// The surface of the cavity; `None` where the body is nowhere thick enough.
    pub fn shell(&self, progress: &mut Progress) -> Result<Option<Shell>, Trouble> {
        let shell = Shell::new(Blocks::new(self.grid, self, progress)?)?;
        Ok(Some(shell).filter(|shell| shell.triangles > 0))
    }

    /// How much deeper than the wall a point is, below 0; straight between the points of the grid.
    fn value(&self, p: &Point) -> f64 {
        let grid = &self.grid;
        let place = [0, 1, 2].map(|k| ((p[k] - grid.origin[k]) / grid.cell).clamp(0.0, f64::from(grid.points[k] - 1)));
        let low = place.map(|at| at.floor() as usize);
        let [x, y, _] = grid.points.map(|count| count as usize);
        let corner = |i: usize| {
            let at = |k: usize| (low[k] + (i >> k & 1)).min(grid.points[k] as usize - 1);
            let share = |k: usize| {
                let up = place[k] - low[k] as f64;
                if i >> k & 1 == 1 { up } else { 1.0 - up }
            };
            share(0) * share(1) * share(2) * f64::from(self.distances.values[(at(2) * y + at(1)) * x + at(0)])
        };
        (0..8).map(corner).sum::<f64>() * grid.cell + self.wall
    }

    fn look(&self, p: &Point) -> Look {
        let step = self.grid.cell / 2.0;
        let along = |k: usize| {
            let moved = |by: f64| {
                let mut moved = *p;
                moved[k] += by;
                self.value(&moved)
            };
            moved(step) - moved(-step)
        };
        // Out of the body is into the cavity.
        let normal = -glam::DVec3::from([0, 1, 2].map(along)).normalize_or_zero();
        Look { normal: normal.to_array(), albedo: [0.5; 3] }
    }
}

impl Field for Cavity {
    fn inside(&self, points: &[Point]) -> Result<Vec<bool>, BackendError> {
        Ok(points.iter().map(|p| self.value(p) < 0.0).collect())
    }

    fn balls(&self, points: &[Point], radius: f64) -> Result<Vec<Ball>, BackendError> {
        let ball = |p: &Point| match self.value(p) {
            value if value > radius + WRONG * self.grid.cell => Ball::Estimated,
            value if value < 0.0 => Ball::Inside,
            _ => Ball::Open,
        };
        Ok(points.iter().map(ball).collect())
    }

    fn looks(&self, points: &[Point]) -> Result<Vec<Look>, BackendError> {
        Ok(points.iter().map(|p| self.look(p)).collect())
    }
}
