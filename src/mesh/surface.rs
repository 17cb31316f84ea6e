//! From the signs of points to vertices and triangles, layer by layer of blocks, so that no mesh is ever held as a whole.
//!
//! A vertex lies on each pair of neighbouring points that differ. Vertices are numbered by their blocks in order, within a block by axis
//! and point, so a number follows from signs alone: nothing is looked up by place.

use rayon::prelude::*;

use super::bits::ones;
use super::blocks::Blocks;
use super::cells::{CellEdge, TRIANGLES};
use super::field::Field;
use super::grid::{EDGE, word};
use super::{Point, Progress, Trouble};
use crate::colour::srgb;
use crate::film::srgb_byte;

/// Halvings of an edge until its vertex is taken from the middle of what is left: within a 64th of a cell, and never at an end.
const HALVINGS: u32 = 5;
/// Half of what is left of an edge then.
const HALF_WIDTH: f64 = 0.5 / (1 << HALVINGS) as f64;
/// Vertices that are moved onto the surface at once.
const AT_ONCE: usize = 1 << 17;

/// A vertex of a mesh, in the units of its file.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Vertex {
    /// Where it is.
    pub position: [f32; 3],
    /// Out of the body, of length 1; 0 where nobody asked.
    pub normal: [f32; 3],
    /// sRGB; 0 where nobody asked.
    pub colour: [u8; 3],
}

/// Corners of a triangle, against the clock as seen from outside of the body.
pub type Triangle = [u32; 3];

/// What becomes of places in the world in a file: they are taken from `middle` and scaled.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Placing {
    /// What becomes 0.
    pub middle: Point,
    /// Units of the file in a unit of the world.
    pub scale: f64,
}

impl Placing {
    fn place(&self, p: &Point) -> [f32; 3] {
        [0, 1, 2].map(|k| ((p[k] - self.middle[k]) * self.scale) as f32)
    }
}

/// The surface of a body on a grid.
pub(super) struct Shell {
    pub blocks: Blocks,
    /// The number of the first vertex of each open block, and of all.
    first: Vec<u32>,
    /// Blocks whose cells have triangles, in order, and the number of their triangles.
    cells: Vec<(u32, u32)>,
    /// All triangles.
    pub triangles: u64,
}

/// The bits of the points of a block whose upper neighbour along each axis differs.
type Crossed = [u64; 3];

impl Shell {
    /// Counts the vertices and triangles of a body whose blocks are known.
    ///
    /// Errors: more vertices than files can number.
    pub fn new(blocks: Blocks) -> Result<Shell, Trouble> {
        let counts: Vec<u32> = (0..blocks.signs.len())
            .into_par_iter()
            .map(|place| crossed(&blocks, place).map(u64::count_ones).iter().sum())
            .collect();
        let mut first = Vec::with_capacity(counts.len() + 1);
        let mut next = 0u32;
        first.push(0);
        for count in counts {
            next = next.checked_add(count).ok_or_else(too_many)?;
            first.push(next);
        }
        let mut shell = Shell { blocks, first, cells: Vec::new(), triangles: 0 };
        let layers = shell.blocks.grid.blocks[2];
        let cells = |z: u32| {
            let keys = shell.beside_open(z);
            let counted = keys
                .into_iter()
                .map(|key| (key, shell.cell_cases(key).map(|(_, case)| TRIANGLES[case].len() as u32).sum()));
            counted.filter(|(_, count)| *count > 0).collect::<Vec<(u32, u32)>>()
        };
        shell.cells = (0..layers).into_par_iter().flat_map_iter(cells).collect();
        shell.triangles = shell.cells.iter().map(|(_, count)| u64::from(*count)).sum();
        Ok(shell)
    }

    /// All vertices.
    pub fn vertices(&self) -> u64 {
        self.first.last().map_or(0, |count| u64::from(*count))
    }

    /// Layers of blocks.
    pub fn layers(&self) -> u32 {
        self.blocks.grid.blocks[2]
    }

    /// The number of the first vertex of a layer.
    pub fn first_vertex(&self, z: u32) -> u32 {
        self.first[self.blocks.layer(z).start]
    }

    /// Least and largest coordinates of the surface.
    ///
    /// Errors: the back end's.
    pub fn extent(&self, field: &dyn Field) -> Result<[Point; 2], Trouble> {
        let mut ends = [[0.0; 3]; 2];
        for axis in 0..3 {
            for up in [false, true] {
                // What is inside reaches no farther than these points, and the surface lies between them and the next ones.
                let last = self.last(axis, up);
                let is_last = |crossing: &Crossing| {
                    let inner = crossing.point[axis] + if crossing.is_inside { 0.0 } else { 1.0 };
                    crossing.axis == axis && crossing.is_inside == up && inner == f64::from(last)
                };
                let places = 0..self.blocks.signs.len();
                let crossings: Vec<Crossing> =
                    places.into_par_iter().flat_map_iter(|place| self.crossings(place).filter(is_last)).collect();
                let on = self.found(&crossings, field)?.into_iter().map(|(on, _)| on[axis]);
                let end = if up { on.reduce(f64::max) } else { on.reduce(f64::min) };
                ends[usize::from(up)][axis] = end.unwrap_or(0.0);
            }
        }
        Ok(ends)
    }

    /// The last point along an axis that is inside.
    fn last(&self, axis: usize, up: bool) -> u32 {
        let of = |(key, word): &(u32, u64)| {
            let first = self.blocks.grid.corner(*key, 0)[axis];
            let mut slices = (0..EDGE).filter(|at| word & (word::face(axis, false) << (at << (2 * axis))) != 0);
            let at = if up { slices.next_back() } else { slices.next() };
            at.map(|at| first + at)
        };
        let all = self.blocks.signs.iter().filter_map(of);
        if up { all.max().unwrap_or(0) } else { all.min().unwrap_or(0) }
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> u64 {
        self.blocks.bytes() + self.first.len() as u64 * 4 + self.cells.len() as u64 * 8
    }

    /// The blocks of a layer that are open or have an open one among those above.
    fn beside_open(&self, z: u32) -> Vec<u32> {
        let grid = &self.blocks.grid;
        let layers = [self.blocks.layer(z), self.blocks.layer(z + 1)];
        let below = |key: u32| {
            let [x, y, _] = grid.block(key);
            let down = |at: u32| at.saturating_sub(1)..=at;
            down(y).flat_map(move |y| down(x).map(move |x| grid.key([x, y, z])))
        };
        let open = layers.into_iter().flat_map(|places| self.blocks.signs[places].iter().map(|(key, _)| *key));
        let mut keys: Vec<u32> = open.flat_map(below).collect();
        keys.sort_unstable();
        keys.dedup();
        keys
    }

    /// The cells of a block in which the surface is: the lower point's bit, and the case.
    fn cell_cases(&self, key: u32) -> impl Iterator<Item = (u32, usize)> {
        let at = self.blocks.grid.block(key);
        let words: [u64; 8] = std::array::from_fn(|i| self.blocks.word([0, 1, 2].map(|k| at[k] + (i as u32 >> k & 1))));
        // Each word as the points of one corner of the 64 cells see it.
        let corners: [u64; 8] = std::array::from_fn(|corner| seen_from(&words, corner));
        let (any, all) = corners.iter().fold((0, u64::MAX), |(any, all), word| (any | word, all & word));
        ones(any & !all)
            .map(move |bit| (bit, (0..8).map(|corner| (corners[corner] >> bit & 1) as usize * (1 << corner)).sum()))
    }

    /// What numbers the vertices of a block and of its seven neighbours above.
    fn numbering(&self, key: u32) -> [(u32, Crossed); 8] {
        let at = self.blocks.grid.block(key);
        std::array::from_fn(|i| {
            let block = [0, 1, 2].map(|k| at[k] + (i as u32 >> k & 1));
            let is_in = (0..3).all(|k| block[k] < self.blocks.grid.blocks[k]);
            let place = is_in.then(|| self.blocks.place(self.blocks.grid.key(block))).flatten();
            // Points that differ are in blocks that are open.
            place.map_or((0, [0; 3]), |place| (self.first[place], crossed(&self.blocks, place)))
        })
    }

    /// The triangles of a layer's cells, whose vertices are in this layer and the next one.
    pub fn layer_triangles(&self, z: u32) -> Vec<Triangle> {
        let each = u64::from(self.blocks.grid.blocks[0]) * u64::from(self.blocks.grid.blocks[1]);
        let from = |z: u32| self.cells.partition_point(|(key, _)| u64::from(*key) < u64::from(z) * each);
        let of_block = |(key, _): &(u32, u32)| {
            let numbering = self.numbering(*key);
            let triangles = move |(bit, case): (u32, usize)| {
                TRIANGLES[case].iter().map(move |edges| edges.map(|edge| vertex(&numbering, bit, edge)))
            };
            self.cell_cases(*key).flat_map(triangles)
        };
        self.cells[from(z)..from(z + 1)].par_iter().flat_map_iter(of_block).collect()
    }

    /// The vertices of a layer, moved onto the surface, with normals and colours where they are asked for.
    pub fn layer_vertices(
        &self,
        z: u32,
        field: &dyn Field,
        (placing, with_looks): (&Placing, bool),
        progress: &mut Progress,
    ) -> Result<Vec<Vertex>, Trouble> {
        let edges: Vec<Crossing> = self.blocks.layer(z).flat_map(|place| self.crossings(place)).collect();
        let mut vertices = Vec::with_capacity(edges.len());
        for some in edges.chunks(AT_ONCE) {
            progress.advance(some.len() * (HALVINGS as usize + usize::from(with_looks)))?;
            let ends = self.found(some, field)?;
            let looks = if with_looks {
                field.looks(&ends.iter().map(|(_, outside)| *outside).collect::<Vec<_>>())?
            } else {
                Vec::new()
            };
            for (i, ((on, _), crossing)) in ends.iter().zip(some).enumerate() {
                let look = looks.get(i);
                vertices.push(Vertex {
                    position: placing.place(on),
                    normal: look.map_or([0.0; 3], |look| unit(look.normal, crossing)),
                    colour: look.map_or([0; 3], |look| look.albedo.map(|light| srgb_byte(srgb(light)))),
                });
            }
        }
        Ok(vertices)
    }

    /// Tells the points of a layer that differ from a neighbour, and how far the surface is along the edge, in cells; and their
    /// neighbours, which may be of the next layer.
    pub fn layer_ends(
        &self,
        z: u32,
        field: &dyn Field,
        progress: &mut Progress,
        mut tell: impl FnMut([u32; 3], f64),
    ) -> Result<(), Trouble> {
        let edges: Vec<Crossing> = self.blocks.layer(z).flat_map(|place| self.crossings(place)).collect();
        for some in edges.chunks(AT_ONCE) {
            progress.advance(some.len() * HALVINGS as usize)?;
            for (share, crossing) in self.shares(some, field)?.into_iter().zip(some) {
                let mut point = crossing.point.map(|at| at as u32);
                tell(point, share + HALF_WIDTH);
                point[crossing.axis] += 1;
                tell(point, 1.0 - share - HALF_WIDTH);
            }
        }
        Ok(())
    }

    /// The pairs of points of a block that differ, in the order of their vertices.
    fn crossings(&self, place: usize) -> impl Iterator<Item = Crossing> {
        let (key, word) = self.blocks.signs[place];
        let crossed = crossed(&self.blocks, place);
        (0..3).flat_map(move |axis| {
            ones(crossed[axis]).map(move |bit| Crossing {
                point: self.blocks.grid.corner(key, bit).map(f64::from),
                axis,
                is_inside: word >> bit & 1 == 1,
            })
        })
    }

    /// Points on the surface, and beside them points that are outside.
    fn found(&self, crossings: &[Crossing], field: &dyn Field) -> Result<Vec<(Point, Point)>, Trouble> {
        let low = self.shares(crossings, field)?;
        let ends = crossings.par_iter().zip(low).map(|(crossing, low)| {
            let outside = if crossing.is_inside { low + 2.0 * HALF_WIDTH } else { low };
            (self.at(crossing, low + HALF_WIDTH), self.at(crossing, outside))
        });
        Ok(ends.collect())
    }

    /// A place on an edge.
    fn at(&self, crossing: &Crossing, share: f64) -> Point {
        let mut point = crossing.point;
        point[crossing.axis] += share;
        self.blocks.grid.at(point)
    }

    /// The lower ends of what is left of edges around the surface, by halving.
    fn shares(&self, crossings: &[Crossing], field: &dyn Field) -> Result<Vec<f64>, Trouble> {
        let mut low = vec![0.0f64; crossings.len()];
        let mut width = 1.0;
        for _ in 0..HALVINGS {
            width /= 2.0;
            let middles: Vec<Point> =
                crossings.par_iter().zip(&low).map(|(crossing, low)| self.at(crossing, low + width)).collect();
            let inside = field.inside(&middles)?;
            for ((low, inside), crossing) in low.iter_mut().zip(inside).zip(crossings) {
                *low += if inside == crossing.is_inside { width } else { 0.0 };
            }
        }
        Ok(low)
    }
}

/// Two neighbouring points that differ.
struct Crossing {
    /// The lower one, in points of the grid.
    point: [f64; 3],
    axis: usize,
    /// Whether the lower one is inside.
    is_inside: bool,
}

/// The words of a block's points as seen from one corner of the cells: moved down where the corner is up.
fn seen_from(words: &[u64; 8], corner: usize) -> u64 {
    let mut seen = *words;
    for axis in (0..3).filter(|axis| corner >> axis & 1 == 1) {
        for i in (0..8).filter(|i| i >> axis & 1 == 0) {
            seen[i] = word::moved(seen[i], seen[i | 1 << axis], axis);
        }
    }
    seen[0]
}

fn crossed(blocks: &Blocks, place: usize) -> Crossed {
    let (key, word) = blocks.signs[place];
    let at = blocks.grid.block(key);
    [0, 1, 2].map(|axis| {
        let mut next = at;
        next[axis] += 1;
        // Beyond the grid nothing is inside.
        word ^ word::moved(word, blocks.word(next), axis)
    })
}

/// The number of the vertex on an edge of the cell of a bit.
fn vertex(numbering: &[(u32, Crossed); 8], bit: u32, edge: CellEdge) -> u32 {
    let point = [0, 1, 2].map(|k| (bit >> (2 * k) & 3) + u32::from(edge.corner >> k & 1));
    let block: u32 = (0..3).map(|k| (point[k as usize] / EDGE) << k).sum();
    let bit: u32 = (0..3).map(|k| (point[k as usize] % EDGE) << (2 * k)).sum();
    let (first, crossed) = &numbering[block as usize];
    let axis = usize::from(edge.axis);
    let before: u32 = crossed[..axis].iter().map(|word| word.count_ones()).sum();
    first + before + (crossed[axis] & ((1 << bit) - 1)).count_ones()
}

/// A gradient as a unit vector; where it is none, the way out along the crossing.
fn unit(gradient: [f64; 3], crossing: &Crossing) -> [f32; 3] {
    let gradient = glam::DVec3::from(gradient);
    let length = gradient.length();
    if (1e-6..1e3).contains(&length) {
        return (gradient / length).to_array().map(|x| x as f32);
    }
    let mut normal = [0.0; 3];
    normal[crossing.axis] = if crossing.is_inside { 1.0 } else { -1.0 };
    normal
}

/// The refusal of a mesh of too many vertices.
pub(super) fn too_many() -> Trouble {
    Trouble::Refused {
        text: "the mesh has more than 4294967295 vertices, which no file can number".into(),
        help: "take a smaller --resolution or --region".into(),
    }
}
