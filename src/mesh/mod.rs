//! Meshes and volumes of bodies, for programs that take no formulas and for printers.
//!
//! In come the kernels of a fractal ([`Kernels`]), a back end and a [`Grid`] of points. A body is the fractal's members, or all that is
//! within a distance of them ([`Body`]). The grid's blocks are taken apart as an octree and opened only where the surface may be
//! (`blocks`); signs of points become vertices and triangles, layer by layer (`surface`), which a file takes as they come
//! (`format`). What always holds: every edge of a mesh is in exactly two triangles that go along it in opposite directions, every
//! vertex lies between two neighbouring points of which one is in the body, and the bytes are a function of grid and kernels.
//!
//! ```
//! use bulbfold::mesh::Grid;
//! use bulbfold::compose::Sides;
//!
//! let grid = Grid::new(Sides { low: [-1.0; 3], high: [1.0; 3] }, 20);
//! assert_eq!((grid.points, grid.cell), ([23; 3], 0.1));
//! ```

mod bits;
mod blocks;
mod build;
mod cells;
mod distance;
mod field;
pub mod format;
mod grid;
mod hollow;
mod report;
mod simplify;
mod surface;
mod survey;
pub mod volume;

pub use blocks::Shares;
pub use build::{Made, Order, make};
pub use field::{Ball, Body, Field, Kernels, Look};
pub use grid::{CELLS, Grid, Point};
pub use report::{Printability, Report};
pub use surface::{Placing, Triangle, Vertex};
pub use survey::{Forecast, Survey, survey};

use crate::engine::{Observer, Stage};
use crate::kernel::BackendError;

/// Why there is no mesh.
#[derive(Debug)]
pub enum Trouble {
    /// The back end failed.
    Backend(BackendError),
    /// The file cannot be written.
    Write(std::io::Error),
    /// What was asked for cannot be made.
    Refused {
        /// What is wrong.
        text: String,
        /// What to do.
        help: String,
    },
    /// The observer ended it.
    Cancelled,
}

impl From<BackendError> for Trouble {
    fn from(error: BackendError) -> Trouble {
        Trouble::Backend(error)
    }
}

impl From<std::io::Error> for Trouble {
    fn from(error: std::io::Error) -> Trouble {
        Trouble::Write(error)
    }
}

/// How much of some work is done, in points that were asked.
pub struct Progress<'a> {
    observer: &'a mut dyn Observer,
    asked: f64,
    expected: f64,
}

impl<'a> Progress<'a> {
    /// Nothing is done yet; so many points are expected.
    pub fn new(observer: &'a mut dyn Observer, expected: f64) -> Progress<'a> {
        Progress { observer, asked: 0.0, expected: expected.max(1.0) }
    }

    /// Notes that points will have been asked.
    ///
    /// Errors: [`Trouble::Cancelled`] where the observer ends it.
    pub fn advance(&mut self, points: usize) -> Result<(), Trouble> {
        self.asked += points as f64;
        // Less than 1 until all is written: expectations are estimates.
        self.observer.progress(Stage::Meshing, (self.asked / self.expected).min(0.999));
        if self.observer.is_cancelled() { Err(Trouble::Cancelled) } else { Ok(()) }
    }

    /// Points that were asked so far.
    pub fn asked(&self) -> f64 {
        self.asked
    }
}
