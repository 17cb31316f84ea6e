//! Exact distances to limit sets that are known in closed form: what truth and estimates are checked with.
//!
//! In comes a point or a ray; out comes the distance to the *limit* set (what is left after infinitely many iterations),
//! by branch and bound over the parts of the set's convex hull. Nothing here reads a formula's maps or derivatives.
//!
//! A march sees the points whose orbits stay in for `max_iterations`, which is a little more than the limit set: for a
//! similarity of scale s, escape radius B and a set in the ball of radius R, at most `(B + R) / s^n` more.
//!
//! ```
//! use bulbfold::check::exact::Limit;
//!
//! // The nearest point of the Menger sponge to (2, 2, 2) is its corner (1, 1, 1).
//! assert!((Limit::menger().distance([2.0, 2.0, 2.0]) - 3f64.sqrt()).abs() < 1e-9);
//! // The middle of a face is a hole: the nearest wall is a third away.
//! assert!((Limit::menger().distance([1.0, 0.0, 0.0]) - 1.0 / 3.0).abs() < 1e-9);
//! ```

use std::sync::Arc;

use glam::DVec3;

use super::truth::{Ray, point};
use crate::formula::step::ParamValue;
use crate::graph::{Constant, Graph, NodeKind, NodeRef, ParamInput, resolve_schedule};

/// Error of a distance, in units of the hull.
const TOLERANCE: f64 = 1e-10;
/// Parts of parts that are looked into.
const DEPTH: u32 = 60;

/// The convex hull of a set.
#[derive(Clone, PartialEq, Debug)]
enum Hull {
    /// The cube of this centre and half its edge.
    Cube(DVec3, f64),
    /// A polytope of this centre, and how many times as large it is.
    Polytope(Arc<Polytope>, DVec3, f64),
}

/// A convex polytope around the origin.
#[derive(Clone, PartialEq, Debug)]
struct Polytope {
    corners: Vec<DVec3>,
    /// Corners of triangles that cover its faces, counterclockwise as seen from outside.
    faces: Vec<[usize; 3]>,
}

/// A set made of smaller copies of itself, each its hull shrunk about a fixed point.
#[derive(Clone, PartialEq, Debug)]
pub struct Limit {
    name: &'static str,
    hull: Hull,
    scale: f64,
    fixed_points: Vec<DVec3>,
}

/// Golden ratio.
const PHI: f64 = 1.618_033_988_749_895;
/// Share of a length by which a corner or a plane may be off.
const ALIKE: f64 = 1e-9;

/// All corners that these have as mirror images by signs and as turns of the axes.
fn all_signs_and_turns(seeds: &[[f64; 3]]) -> Vec<DVec3> {
    let mut all: Vec<DVec3> = Vec::new();
    for seed in seeds {
        for i in 0..24 {
            let turned = [0, 1, 2].map(|k| seed[(k + i / 8) % 3]);
            let corner = DVec3::from([0, 1, 2].map(|k| if i >> k & 1 == 0 { turned[k] } else { -turned[k] }));
            if all.iter().all(|other| (*other - corner).length() > ALIKE) {
                all.push(corner);
            }
        }
    }
    all
}

impl Limit {
    /// The Menger sponge in the cube from -1 to 1: 20 copies, a third as large.
    pub fn menger() -> Limit {
        let mut fixed_points = Vec::new();
        for i in 0..27 {
            let v = [i % 3, i / 3 % 3, i / 9].map(|k| f64::from(k) - 1.0);
            // Of the 27 parts of a cube the middles of the faces and of the cube are missing.
            if v.iter().filter(|x| **x == 0.0).count() < 2 {
                fixed_points.push(DVec3::from(v));
            }
        }
        Limit { name: "the Menger sponge", hull: Hull::Cube(DVec3::ZERO, 1.0), scale: 3.0, fixed_points }
    }

    /// The Sierpinski tetrahedron with corners (1, 1, 1), (-1, -1, 1), (1, -1, -1) and (-1, 1, -1): four copies of 1 / scale,
    /// for a scale of 2 or more.
    pub fn sierpinski_tetrahedron(scale: f64) -> Limit {
        let corners = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]].map(DVec3::from);
        Limit::about_corners("the Sierpinski tetrahedron", corners.to_vec(), scale)
    }

    /// The octahedron flake with corners at distance 1 on the axes: six copies of 1 / scale, for a scale of 2 or more.
    pub fn octahedron(scale: f64) -> Limit {
        Limit::about_corners("the octahedron flake", all_signs_and_turns(&[[1.0, 0.0, 0.0]]), scale)
    }

    /// The icosahedron flake with corners at distance 1, one of them along (phi, 1, 0): twelve copies of 1 / scale, for
    /// a scale of 1 + phi or more.
    pub fn icosahedron(scale: f64) -> Limit {
        let unit = 1.0 / (1.0 + PHI * PHI).sqrt();
        Limit::about_corners("the icosahedron flake", all_signs_and_turns(&[[PHI * unit, unit, 0.0]]), scale)
    }

    /// The dodecahedron flake with corners at distance 1, one of them along (1, 1, 1): twenty copies of 1 / scale, for a
    /// scale of 2 + phi or more.
    pub fn dodecahedron(scale: f64) -> Limit {
        let unit = 1.0 / 3f64.sqrt();
        let corners = all_signs_and_turns(&[[unit; 3], [unit * PHI, 0.0, unit / PHI]]);
        Limit::about_corners("the dodecahedron flake", corners, scale)
    }

    /// Copies shrunk about each corner of a polytope around the origin.
    fn about_corners(name: &'static str, corners: Vec<DVec3>, scale: f64) -> Limit {
        let polytope = Polytope::of(corners.clone());
        Limit { name, hull: Hull::Polytope(Arc::new(polytope), DVec3::ZERO, 1.0), scale, fixed_points: corners }
    }

    /// The limit set of a formula, where it is one of those that are known: a fold onto a corner of a sponge or a
    /// polytope, scaled about that corner, with no constant and nothing around.
    pub fn of(graph: &Graph) -> Option<Limit> {
        let NodeKind::Orbit { of, settings } = &graph.node(graph.output).kind else { return None };
        if settings.constant != Constant::Off || !settings.pre.is_empty() || !settings.post.is_empty() {
            return None;
        }
        let (maps, _) = resolve_schedule(graph, *of, settings.constant, settings.max_iterations);
        let crate::graph::MapTree::Sequence(parts) = &maps[0].map else { return None };
        let [crate::graph::MapTree::Step(fold), crate::graph::MapTree::Step(grow)] = parts[..] else { return None };
        if maps.len() != 1 || step_name(graph, grow) != "scale" {
            return None;
        }
        let scale = number(graph, grow, "scale")?;
        let centre = vector(graph, grow, "centre")?;
        // The corner that the fold leaves where it is, and the set.
        let (corner, limit) = match step_name(graph, fold) {
            "menger_fold" if scale == 3.0 && number(graph, fold, "offset") == Some(1.0 / 3.0) => {
                ([1.0; 3], Limit::menger())
            }
            "tetra_fold" => ([1.0; 3], Limit::sierpinski_tetrahedron(scale)),
            "octa_fold" => ([1.0, 0.0, 0.0], Limit::octahedron(scale)),
            "icosa_fold" => ([PHI, 1.0, 0.0].map(|x| x / (1.0 + PHI * PHI).sqrt()), Limit::icosahedron(scale)),
            "dodeca_fold" => ([1.0 / 3f64.sqrt(); 3], Limit::dodecahedron(scale)),
            _ => return None,
        };
        let is_corner = (DVec3::from(centre) - DVec3::from(corner)).length() < ALIKE;
        (is_corner && limit.parts_stay_apart()).then_some(limit)
    }

    /// Whether every part lies on its own side of the planes half way to the other parts' fixed points. Then a fold that
    /// brings the nearest of those to one corner finds the part that a point is in; else folds cut parts off.
    fn parts_stay_apart(&self) -> bool {
        let Hull::Polytope(polytope, ..) = &self.hull else { return true };
        let first = self.fixed_points[0];
        self.fixed_points[1..].iter().all(|other| {
            let lowest = polytope.corners.iter().map(|x| (first + (*x - first) / self.scale).dot(first - *other));
            lowest.fold(f64::INFINITY, f64::min) >= -ALIKE
        })
    }

    /// The set's name, with its article.
    pub fn name(&self) -> &str {
        self.name
    }

    /// Distance from a point to the set: 0 inside. Error below 1e-9.
    pub fn distance(&self, p: [f64; 3]) -> f64 {
        let p = DVec3::from(p);
        let mut best = self.hull.corner_distance(p);
        self.search(p, &self.hull, DEPTH, &mut best);
        best
    }

    /// Looks for something nearer than `best` in a copy of the set; the corners of each hull belong to the set, and
    /// nothing of a copy is nearer than its hull.
    fn search(&self, p: DVec3, hull: &Hull, depth: u32, best: &mut f64) {
        if depth == 0 || hull.size() < TOLERANCE {
            return;
        }
        // Of the hull's own map the fixed points move along with it.
        let mut parts: Vec<(f64, Hull)> = (0..self.fixed_points.len())
            .map(|i| {
                let part = hull.part(self.fixed_points[i], self.scale);
                *best = best.min(part.corner_distance(p));
                (part.distance(p), part)
            })
            .collect();
        parts.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (bound, part) in parts {
            if bound >= *best - TOLERANCE {
                break;
            }
            self.search(p, &part, depth - 1, best);
        }
    }

    /// The depth at which a ray comes within `eps` of the set, found by steps of the exact distance, so that nothing is
    /// passed; `None` if it goes beyond `far`.
    pub fn depth(&self, ray: Ray, far: f64, eps: f64) -> Option<f64> {
        let mut t = 0.0;
        while t < far {
            let distance = self.distance(point(ray, t));
            if distance < eps {
                return Some(t);
            }
            t += distance;
        }
        None
    }
}

impl Hull {
    /// The copy of a hull whose own fixed point is that of the whole set's map.
    fn part(&self, fixed: DVec3, scale: f64) -> Hull {
        let moved = |centre: DVec3, size: f64| centre + fixed * size * (1.0 - 1.0 / scale);
        match self {
            Hull::Cube(centre, half) => Hull::Cube(moved(*centre, *half), half / scale),
            Hull::Polytope(of, centre, size) => Hull::Polytope(of.clone(), moved(*centre, *size), size / scale),
        }
    }

    /// Half its extent.
    fn size(&self) -> f64 {
        match self {
            Hull::Cube(_, size) | Hull::Polytope(_, _, size) => *size,
        }
    }

    /// Distance to the solid hull.
    fn distance(&self, p: DVec3) -> f64 {
        match self {
            Hull::Cube(centre, half) => ((p - *centre).abs() - *half).max(DVec3::ZERO).length(),
            Hull::Polytope(of, centre, size) => size * of.distance((p - *centre) / *size),
        }
    }

    /// Distance to the nearest corner.
    fn corner_distance(&self, p: DVec3) -> f64 {
        match self {
            // The nearest corner lies on the point's side of the middle.
            Hull::Cube(centre, half) => ((p - *centre).abs() - *half).length(),
            Hull::Polytope(of, centre, size) => {
                of.corners.iter().map(|c| (p - *centre - *c * *size).length()).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

impl Polytope {
    /// The convex hull of corners around the origin, each of which is one of the hull's.
    fn of(corners: Vec<DVec3>) -> Polytope {
        let mut faces = Vec::new();
        let count = corners.len();
        for (a, b, c) in (0..count).flat_map(|a| (0..count).flat_map(move |b| (0..count).map(move |c| (a, b, c)))) {
            // Each triangle once, from its first corner on, and only if nothing is on its outside. Of a face with more
            // corners all triangles are taken: they overlap, and cover it.
            let normal = (corners[b] - corners[a]).cross(corners[c] - corners[a]);
            let is_face = || corners.iter().all(|x| normal.dot(*x - corners[a]) <= ALIKE);
            if a < b && a < c && normal.length() > ALIKE && is_face() {
                faces.push([a, b, c]);
            }
        }
        Polytope { corners, faces }
    }

    /// Distance to the solid.
    fn distance(&self, p: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        for [a, b, c] in self.faces.iter().map(|face| face.map(|i| self.corners[i])) {
            if (b - a).cross(c - a).dot(p - a) > 0.0 {
                nearest = nearest.min(triangle_distance(p, a, b, c));
            }
        }
        if nearest.is_finite() { nearest } else { 0.0 }
    }
}

/// Distance to a triangle: to its plane where the foot is inside, else to the nearest edge.
fn triangle_distance(p: DVec3, a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let normal = (b - a).cross(c - a);
    let is_above = [(a, b), (b, c), (c, a)].iter().all(|(from, to)| normal.cross(*to - *from).dot(p - *from) >= 0.0);
    if is_above {
        return (normal.dot(p - a) / normal.length()).abs();
    }
    let edge = |from: DVec3, to: DVec3| {
        let along = to - from;
        let share = ((p - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        (p - from - along * share).length()
    };
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

fn step_name(graph: &Graph, node: NodeRef) -> &str {
    graph.node(node).kind.keyword()
}

fn value<'g>(graph: &'g Graph, node: NodeRef, name: &str) -> Option<&'g ParamValue> {
    let NodeKind::Step { step, params } = &graph.node(node).kind else { return None };
    match &params[step.params.iter().position(|p| p.name == name)?] {
        ParamInput::Known(value) => Some(value),
        ParamInput::OfIteration(_) => None,
    }
}

fn number(graph: &Graph, node: NodeRef, name: &str) -> Option<f64> {
    match value(graph, node, name)? {
        ParamValue::Number(x) => Some(*x),
        _ => None,
    }
}

fn vector(graph: &Graph, node: NodeRef, name: &str) -> Option<[f64; 3]> {
    match value(graph, node, name)? {
        ParamValue::Vector(v) => Some(*v),
        _ => None,
    }
}

/// Depth at which a ray enters the convex polytope of all points with `normal . p <= offset` for each pair, by clipping.
/// 0 if it starts inside; `None` if it misses.
pub fn polytope_depth((origin, direction): Ray, faces: &[([f64; 3], f64)]) -> Option<f64> {
    let (mut near, mut far) = (0.0, f64::INFINITY);
    for (normal, offset) in faces {
        let height = DVec3::from(*normal).dot(DVec3::from(origin)) - offset;
        let speed = DVec3::from(*normal).dot(DVec3::from(direction));
        match speed {
            s if s < 0.0 => near = f64::max(near, -height / s),
            s if s > 0.0 => far = f64::min(far, -height / s),
            _ if height > 0.0 => return None,
            _ => {}
        }
    }
    (near <= far).then_some(near)
}

/// Depth at which a ray meets the ball of this centre and radius. 0 if it starts inside; `None` if it misses.
pub fn ball_depth((origin, direction): Ray, centre: [f64; 3], radius: f64) -> Option<f64> {
    let to_centre = DVec3::from(centre) - DVec3::from(origin);
    let middle = to_centre.dot(DVec3::from(direction));
    let half_sq = radius * radius - (to_centre.length_squared() - middle * middle);
    let half = (half_sq >= 0.0).then(|| half_sq.sqrt())?;
    (middle + half >= 0.0).then(|| (middle - half).max(0.0))
}
