//! What is known of a mesh: its size, its area and volume, and whether it can be printed.

use serde::Serialize;

use super::blocks::Shares;
use super::field::Field;
use super::surface::{Placing, Triangle, Vertex};
use super::{Grid, Point, Trouble};

/// Walls that are measured at most.
const WALLS: u64 = 4096;
/// How far a wall is looked through, in cells, and the length of a step.
const THICKEST: f64 = 64.0;
const STEP: f64 = 0.25;
/// Faces that lean out more than this many degrees from upright hang over.
const OVERHANG_DEG: f64 = 45.0;

/// What is known of a mesh. Lengths are in units of its file.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Report {
    /// Version of this form.
    pub version: u32,
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Edge of a cell.
    pub cell: f64,
    /// Least coordinates.
    pub low: [f64; 3],
    /// Largest coordinates.
    pub high: [f64; 3],
    /// Area of all triangles.
    pub area: f64,
    /// Volume that they enclose.
    pub volume: f64,
    /// Distance of the fractal's members up to which points belong to the body, in cells: 0 of a solid.
    pub thickness: f64,
    /// Shares of the grid's volume that are proven empty, and estimated to be.
    pub proven_empty: f64,
    /// See `proven_empty`.
    pub estimated_empty: f64,
    /// Share that was sampled.
    pub opened: f64,
    /// Blocks that the estimate took for empty, and points beside them did not.
    pub reopened: u64,
    /// What printers ask, where it was looked for.
    pub printability: Option<Printability>,
}

/// What printers ask.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Printability {
    /// Parts of the surface that hang together: islands, and hollows within them.
    pub islands: u64,
    /// Vertices of the largest one.
    pub largest_island: u64,
    /// The thinnest of the walls that were measured by rays inwards, and the one that a hundredth of them is thinner than; `None` where
    /// none is thinner than 64 cells.
    pub thinnest_wall: Option<f64>,
    /// See `thinnest_wall`.
    pub thin_wall: Option<f64>,
    /// Walls that were measured.
    pub walls: u64,
    /// Share of the area that leans out by more than 45 degrees, z being up.
    pub overhang: f64,
}

/// Sums over the triangles of a mesh as they come.
pub(super) struct Tally {
    /// Sets of vertices that hang together, where islands are counted.
    parents: Vec<u32>,
    is_full: bool,
    stride: u64,
    /// Places of walls in the world, and directions inwards.
    walls: Vec<(Point, Point)>,
    low: [f64; 3],
    high: [f64; 3],
    area: f64,
    volume: f64,
    overhang: f64,
}

impl Tally {
    /// Nothing yet. `is_full` also looks for what printers ask.
    pub fn new(vertices: u64, is_full: bool) -> Tally {
        let parents = if is_full { (0..vertices as u32).collect() } else { Vec::new() };
        Tally {
            parents,
            is_full,
            stride: vertices.div_ceil(WALLS).max(1),
            walls: Vec::new(),
            low: [f64::INFINITY; 3],
            high: [f64::NEG_INFINITY; 3],
            area: 0.0,
            volume: 0.0,
            overhang: 0.0,
        }
    }

    /// Takes vertices in, the first of which has this number.
    pub fn vertices(&mut self, first: u32, vertices: &[Vertex], placing: &Placing) {
        for (i, vertex) in vertices.iter().enumerate() {
            for k in 0..3 {
                self.low[k] = self.low[k].min(f64::from(vertex.position[k]));
                self.high[k] = self.high[k].max(f64::from(vertex.position[k]));
            }
            if self.is_full && (u64::from(first) + i as u64).is_multiple_of(self.stride) {
                let at = |k: usize| f64::from(vertex.position[k]) / placing.scale + placing.middle[k];
                self.walls.push(([0, 1, 2].map(at), vertex.normal.map(|x| -f64::from(x))));
            }
        }
    }

    /// Takes triangles in, with the places of their corners.
    pub fn triangles(&mut self, triangles: &[Triangle], corners: impl Fn(u32) -> [f32; 3]) {
        let leaning = -OVERHANG_DEG.to_radians().sin();
        for triangle in triangles {
            let [a, b, c] = triangle.map(|corner| glam::DVec3::from(corners(corner).map(f64::from)));
            let across = (b - a).cross(c - a);
            let area = across.length() / 2.0;
            self.area += area;
            self.volume += a.dot(b.cross(c)) / 6.0;
            if across.z < leaning * 2.0 * area {
                self.overhang += area;
            }
            if self.is_full {
                self.join(triangle[0], triangle[1]);
                self.join(triangle[0], triangle[2]);
            }
        }
    }

    /// The least vertex that one hangs together with.
    fn root(&mut self, mut vertex: u32) -> u32 {
        while self.parents[vertex as usize] != vertex {
            let next = self.parents[self.parents[vertex as usize] as usize];
            self.parents[vertex as usize] = next;
            vertex = next;
        }
        vertex
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }

    /// Islands and the vertices of the largest one.
    fn islands(&mut self) -> (u64, u64) {
        let mut sizes = std::collections::HashMap::<u32, u64>::new();
        for vertex in 0..self.parents.len() as u32 {
            *sizes.entry(self.root(vertex)).or_default() += 1;
        }
        (sizes.len() as u64, sizes.values().copied().max().unwrap_or(0))
    }

    /// Lengths of rays inwards until they are outside again, in units of the world, in order; those of more than 64 cells are left out.
    fn walls(&self, field: &dyn Field, cell: f64) -> Result<Vec<f64>, Trouble> {
        let mut open: Vec<usize> = (0..self.walls.len()).collect();
        let mut lengths = Vec::new();
        let mut t = 0.5;
        while t <= THICKEST && !open.is_empty() {
            let at = |&i: &usize| {
                let (from, inwards) = &self.walls[i];
                [0, 1, 2].map(|k| from[k] + inwards[k] * t * cell)
            };
            let inside = field.inside(&open.iter().map(at).collect::<Vec<_>>())?;
            let mut still = Vec::new();
            for (i, inside) in open.into_iter().zip(inside) {
                if inside {
                    still.push(i)
                } else if t > 0.5 {
                    lengths.push(t * cell)
                }
            }
            open = still;
            t += STEP;
        }
        Ok(lengths)
    }

    /// All that was found.
    pub fn finish(
        mut self,
        field: &dyn Field,
        (grid, placing): (&Grid, &Placing),
        (vertices, triangles): (u64, u64),
        (thickness, shares): (f64, &Shares),
    ) -> Result<Report, Trouble> {
        let blocks = grid.block_count() as f64;
        let printability = match self.is_full {
            false => None,
            true => {
                let (islands, vertices) = self.islands();
                let walls = self.walls(field, grid.cell)?;
                let wall = |share: f64| {
                    walls.get((share * self.walls.len() as f64) as usize).map(|length| length * placing.scale)
                };
                Some(Printability {
                    islands,
                    largest_island: vertices,
                    thinnest_wall: wall(0.0),
                    thin_wall: wall(0.01),
                    walls: self.walls.len() as u64,
                    overhang: self.overhang / self.area.max(f64::MIN_POSITIVE),
                })
            }
        };
        Ok(Report {
            version: 1,
            vertices,
            triangles,
            cell: grid.cell * placing.scale,
            low: self.low,
            high: self.high,
            area: self.area,
            volume: self.volume,
            thickness,
            proven_empty: shares.proven as f64 / blocks,
            estimated_empty: shares.estimated as f64 / blocks,
            opened: shares.opened as f64 / blocks,
            reopened: shares.reopened,
            printability,
        })
    }
}
