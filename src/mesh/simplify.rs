//! Fewer triangles: edges are drawn together, those first that move the surface least (M. Garland and P. Heckbert, *Surface
//! Simplification Using Quadric Error Metrics*, 1997). An edge whose ends have other neighbours in common than the corners of its two
//! triangles stays (the link condition), so a closed mesh stays closed, and so does one whose triangles would turn over.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io;

use glam::{DMat3, DVec3};

use super::format::Encoder;
use super::surface::{Triangle, Vertex};

/// Bytes for each vertex of a mesh while it is simplified.
pub(super) const BYTES: u64 = 420;
/// A triangle may turn as far as to this cosine.
const TURN: f64 = 0.2;
/// Least share of a quadric's determinant, against the cube of its trace, at which its minimum is looked for.
const FLAT: f64 = 1e-10;

/// A mesh that is held as a whole.
#[derive(Default)]
pub(super) struct Mesh {
    pub vertices: Vec<Vertex>,
    pub triangles: Vec<Triangle>,
}

impl Encoder for Mesh {
    fn vertices(&mut self, vertices: &[Vertex]) -> io::Result<()> {
        self.vertices.extend(vertices);
        Ok(())
    }

    fn triangles(&mut self, triangles: &[Triangle]) -> io::Result<()> {
        self.triangles.extend(triangles);
        Ok(())
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(())
    }
}

impl Mesh {
    /// The mesh with a share of its triangles, or as few as it can have.
    pub fn simplified(self, share: f64) -> Mesh {
        let wanted = (self.triangles.len() as f64 * share) as usize;
        let mut work = Work::new(self);
        while work.left > wanted {
            let Some(Reverse(edge)) = work.queue.pop() else { break };
            if work.versions[edge.a as usize] + work.versions[edge.b as usize] == edge.version && work.may_join(&edge) {
                work.join(&edge);
            }
        }
        work.finish()
    }
}

/// Squares of distances from planes, weighted by area: `p A p - 2 b p + c`.
#[derive(Clone, Copy)]
struct Quadric {
    a: DMat3,
    b: DVec3,
    c: f64,
}

impl Quadric {
    const ZERO: Quadric = Quadric { a: DMat3::ZERO, b: DVec3::ZERO, c: 0.0 };

    fn of_triangle([p, q, r]: [DVec3; 3]) -> Quadric {
        let across = (q - p).cross(r - p);
        let (normal, area) = (across.normalize_or_zero(), across.length() / 2.0);
        let at = normal.dot(p);
        let a = DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
        Quadric { a: a * area, b: normal * at * area, c: at * at * area }
    }

    fn plus(self, other: Quadric) -> Quadric {
        Quadric { a: self.a + other.a, b: self.b + other.b, c: self.c + other.c }
    }

    fn of(&self, p: DVec3) -> f64 {
        (p.dot(self.a * p) - 2.0 * self.b.dot(p) + self.c).max(0.0)
    }

    /// The point where it is least, where there is one.
    fn least(&self) -> Option<DVec3> {
        let trace = self.a.x_axis.x + self.a.y_axis.y + self.a.z_axis.z;
        (self.a.determinant() > FLAT * trace.powi(3)).then(|| self.a.inverse() * self.b)
    }
}

/// An edge that may be drawn together, and to where. Edges are in the order of what they cost.
#[derive(Clone, Copy, PartialEq)]
struct Edge {
    cost: f64,
    a: u32,
    b: u32,
    /// Sum of the versions of its ends when it was measured.
    version: u32,
    to: DVec3,
}

impl Eq for Edge {}

impl PartialOrd for Edge {
    fn partial_cmp(&self, other: &Edge) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Edge {
    fn cmp(&self, other: &Edge) -> std::cmp::Ordering {
        let key = |edge: &Edge| (edge.a, edge.b, edge.version);
        self.cost.total_cmp(&other.cost).then_with(|| key(self).cmp(&key(other)))
    }
}

struct Work {
    mesh: Mesh,
    places: Vec<DVec3>,
    quadrics: Vec<Quadric>,
    /// Triangles of each vertex that are left.
    around: Vec<Vec<u32>>,
    versions: Vec<u32>,
    queue: BinaryHeap<Reverse<Edge>>,
    /// Triangles that are left.
    left: usize,
}

impl Work {
    fn new(mesh: Mesh) -> Work {
        let count = mesh.vertices.len();
        let places: Vec<DVec3> =
            mesh.vertices.iter().map(|vertex| DVec3::from(vertex.position.map(f64::from))).collect();
        let mut quadrics = vec![Quadric::ZERO; count];
        let mut around = vec![Vec::new(); count];
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            let quadric = Quadric::of_triangle(triangle.map(|corner| places[corner as usize]));
            for corner in triangle {
                quadrics[*corner as usize] = quadrics[*corner as usize].plus(quadric);
                around[*corner as usize].push(number as u32);
            }
        }
        let left = mesh.triangles.len();
        let mut work =
            Work { mesh, places, quadrics, around, versions: vec![0; count], queue: BinaryHeap::new(), left };
        let sides = |t: &Triangle| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
        let edges = work.mesh.triangles.iter().flat_map(sides).filter(|(a, b)| a < b);
        work.queue = edges.map(|(a, b)| Reverse(work.measured(a, b))).collect();
        work
    }

    /// What it costs to draw an edge together, and to where.
    fn measured(&self, a: u32, b: u32) -> Edge {
        let quadric = self.quadrics[a as usize].plus(self.quadrics[b as usize]);
        let (from, to) = (self.places[a as usize], self.places[b as usize]);
        let middle = (from + to) / 2.0;
        let least = quadric.least().filter(|p| p.distance(middle) < 2.0 * from.distance(to));
        let all = least.into_iter().chain([middle, from, to]).map(|p| (quadric.of(p), p));
        let (cost, to) = all.min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or((f64::INFINITY, middle));
        Edge { cost, a, b, version: self.versions[a as usize] + self.versions[b as usize], to }
    }

    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let corners = self.around[vertex as usize].iter().flat_map(|t| self.mesh.triangles[*t as usize]);
        let mut all: Vec<u32> = corners.filter(|corner| *corner != vertex).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Whether the mesh stays closed, and no triangle turns over.
    fn may_join(&self, edge: &Edge) -> bool {
        let (a, b) = (self.neighbours(edge.a), self.neighbours(edge.b));
        if a.binary_search(&edge.b).is_err() {
            return false;
        }
        let common: Vec<u32> = a.into_iter().filter(|corner| b.binary_search(corner).is_ok()).collect();
        let [c, d] = common[..] else { return false };
        let valence = |vertex: u32| self.around[vertex as usize].len();
        valence(c) > 3 && valence(d) > 3 && self.keeps_sides(edge.a, edge) && self.keeps_sides(edge.b, edge)
    }

    fn keeps_sides(&self, end: u32, edge: &Edge) -> bool {
        self.around[end as usize].iter().all(|number| {
            let triangle = self.mesh.triangles[*number as usize];
            if triangle.contains(&edge.a) && triangle.contains(&edge.b) {
                return true;
            }
            let across = |of: &dyn Fn(u32) -> DVec3| {
                let [p, q, r] = triangle.map(of);
                (q - p).cross(r - p)
            };
            let before = across(&|corner| self.places[corner as usize]);
            let after = across(&|corner| if corner == end { edge.to } else { self.places[corner as usize] });
            before.dot(after) > TURN * before.length() * after.length()
        })
    }

    /// Draws an edge together: its first end stays.
    fn join(&mut self, edge: &Edge) {
        let (a, b) = (edge.a as usize, edge.b as usize);
        self.places[a] = edge.to;
        self.quadrics[a] = self.quadrics[a].plus(self.quadrics[b]);
        self.mesh.vertices[a] = between(&self.mesh.vertices[a], &self.mesh.vertices[b], edge.to);
        for number in std::mem::take(&mut self.around[b]) {
            let triangle = &mut self.mesh.triangles[number as usize];
            if triangle.contains(&edge.a) {
                self.left -= 1;
                for corner in triangle.iter().filter(|corner| **corner != edge.b) {
                    self.around[*corner as usize].retain(|other| *other != number);
                }
                continue;
            }
            triangle.iter_mut().filter(|corner| **corner == edge.b).for_each(|corner| *corner = edge.a);
            self.around[a].push(number);
        }
        self.versions[a] += 1;
        for other in self.neighbours(edge.a) {
            let next = self.measured(edge.a.min(other), edge.a.max(other));
            self.queue.push(Reverse(next));
        }
    }

    /// The mesh without what is gone.
    fn finish(self) -> Mesh {
        let mut numbers = vec![u32::MAX; self.around.len()];
        let mut vertices = Vec::new();
        for (vertex, _) in self.around.iter().enumerate().filter(|(_, around)| !around.is_empty()) {
            numbers[vertex] = vertices.len() as u32;
            vertices.push(self.mesh.vertices[vertex]);
        }
        let is_left =
            |(number, triangle): &(usize, &Triangle)| self.around[triangle[0] as usize].contains(&(*number as u32));
        let left = self.mesh.triangles.iter().enumerate().filter(is_left);
        let triangles = left.map(|(_, triangle)| triangle.map(|corner| numbers[corner as usize])).collect();
        Mesh { vertices, triangles }
    }
}

/// What becomes of two vertices.
fn between(a: &Vertex, b: &Vertex, to: DVec3) -> Vertex {
    let normal = (glam::Vec3::from(a.normal) + glam::Vec3::from(b.normal)).normalize_or_zero();
    let colour = [0, 1, 2].map(|k| (u16::from(a.colour[k]) + u16::from(b.colour[k])).div_ceil(2) as u8);
    Vertex { position: to.to_array().map(|x| x as f32), normal: normal.to_array(), colour }
}
