//! What rays are cut to: the bounding ball, and a box in it that is proven to hold all of the set that the ball holds.
//!
//! In come a graph and its plan; out comes [`Bounds`]. Behind each of the six faces of the box lies a cap of the ball, which is
//! cut into columns across the face. A column is marched inwards by proofs of balls (`certified-ball`, in f64): a ball that is
//! proven empty and wider than the column clears a stretch of it. Where a column stops, and it is the one that holds the face
//! out, it is split in four, which go on from there. So a face lies where proofs come to and no closer: needles between
//! samples, which measured boxes lose, stop a column like anything else. No more than [`ORBITS`] are spent on it.
//!
//! ```text
//!         ball   ,-'''''-.        a column of the cap on the right goes from the ball's
//!              ,'|       |'.      surface to the left, by balls around points 1/√2 of its
//!             /  |  set  |==\     edge ahead of its end
//!             |  |       |==|
//! ```
//!
//! Columns whose image under a mirror or an exchange of axes is another one are left out: a field of a single orbit counts as
//! symmetric where its proofs at [`COMPARED`] points are.
//!
//! It is done where every orbit has proofs and no seam is rounded: what rounding adds is not in any of the sets. A box that leaves
//! most of the ball is not worth its tests and is dropped.

use super::measure::run_prepared;
use super::reach::proofs;
use super::{ComposeResult, Composer, Plan};
use crate::graph::NodeKind;
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::{Backend, Estimator};
use crate::math::Precision;

/// What rays are cut to: a ball around the world's origin, and perhaps a box.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Bounds {
    /// Radius of the ball.
    pub radius: f64,
    /// The box.
    pub sides: Option<Sides>,
}

/// Least and largest coordinates of a box.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sides {
    /// The least ones.
    pub low: [f64; 3],
    /// The largest ones.
    pub high: [f64; 3],
}

/// Share of the ball's volume that a box may leave and be worth its tests.
const WORTH: f64 = 0.9;
/// Orbits that a search takes at most, give or take those of its last step: a few milliseconds.
const ORBITS: usize = 30_000;
/// Columns along the edge of the square around a cap, at first.
const FIRST: usize = 8;
/// Edge of the thinnest columns, in radii.
const FINEST: f64 = 1.0 / 256.0;
/// Columns that end no more than this share of the farthest one's edge below its end are split with it.
const BAND: f64 = 0.5;
/// Orbits that a column is taken to need when it is asked whether there are enough of them left.
const EXPECTED: usize = 3;
/// Share of a column's edge that a ball has to clear for it to go on.
const USEFUL: f64 = 0.25;
/// The next proof is to reach this much further than the last one did.
const LONGER: f64 = 1.5;
/// What a proof is to reach at least, in edges: from 1 on it clears anything at all.
const LEAST: f64 = 1.25;
/// A proof that was to reach this many times as far is tried again for [`LEAST`] where the first one clears nothing.
const FAR: f64 = 1.5;
/// Points that are compared with their images to find out whether a set is symmetric.
const COMPARED: usize = 512;
/// Faces lie on multiples of this share of the radius, so that the last bits of proofs do not show in pictures.
const GRAIN: f64 = 1.0 / 2048.0;

impl Bounds {
    /// The ball alone.
    pub fn ball(radius: f64) -> Bounds {
        Bounds { radius, sides: None }
    }

    /// The ball of a plan, and the box where it can be proven and is worth it.
    pub fn prove(composer: &Composer, plan: &Plan) -> ComposeResult<Bounds> {
        let ball = Bounds::ball(plan.bounding_radius);
        if plan.choices.is_empty() {
            return Ok(ball);
        }
        let Some(kernel) = proofs(composer, &plan.choices, None)? else { return Ok(ball) };
        let cpu = Cpu::new(Precision::F64);
        let kernel = cpu.prepare(composer.arena, &kernel).expect("the CPU takes every kernel");
        let sides = Search::new(cpu, kernel, ball.radius, is_alone(composer)).run();
        Ok(Bounds { sides: Some(sides).filter(|sides| is_worth(sides, ball.radius)), ..ball })
    }
}

impl Sides {
    /// Whether a point is in the box.
    pub fn holds(&self, p: &[f64; 3]) -> bool {
        (0..3).all(|k| self.low[k] <= p[k] && p[k] <= self.high[k])
    }
}

/// Whether the field is one orbit, which is symmetric everywhere where it is symmetric at many points; small parts are not.
fn is_alone(composer: &Composer) -> bool {
    match &composer.graph.node(composer.graph.output).kind {
        NodeKind::Orbit { settings, .. } => settings.shape.is_none(),
        _ => false,
    }
}

/// Whether a box leaves little enough of a ball.
fn is_worth(sides: &Sides, radius: f64) -> bool {
    const EDGE: usize = 24;
    let at = |i: usize| radius * (2.0 * (i as f64 + 0.5) / EDGE as f64 - 1.0);
    let (mut all, mut left) = (0, 0);
    for i in 0..EDGE * EDGE * EDGE {
        let p = [at(i % EDGE), at(i / EDGE % EDGE), at(i / EDGE / EDGE)];
        if p.iter().map(|x| x * x).sum::<f64>() < radius * radius {
            all += 1;
            left += usize::from(sides.holds(&p));
        }
    }
    f64::from(left as u32) < WORTH * f64::from(all)
}

/// A square across an axis, and how far towards the middle nothing is behind it.
#[derive(Clone, Copy)]
struct Column {
    /// Which face it is for: twice the axis, and 1 more at its positive end.
    face: usize,
    /// Middle of the square: the coordinates of the two axes after the face's.
    middle: [f64; 2],
    /// Edge of the square.
    edge: f64,
    /// The distance along the axis from which on the column is proven empty, up to the ball's surface.
    end: f64,
    /// How far the next proof is to reach.
    reach: f64,
    /// Whether it goes on.
    is_live: bool,
    /// Whether no ball of its own has cleared anything yet.
    is_fresh: bool,
}

impl Column {
    /// A column from the ball's surface, or from where it is known to be empty; `None` if it misses the ball.
    fn new(face: usize, middle: [f64; 2], edge: f64, radius: f64, (end, reach): (f64, f64)) -> Option<Column> {
        let nearest = middle.map(|x| (x.abs() - edge / 2.0).max(0.0));
        let height_sq = radius * radius - nearest.iter().map(|x| x * x).sum::<f64>();
        let end = end.min(height_sq.max(0.0).sqrt());
        (height_sq > 0.0).then_some(Column { face, middle, edge, end, reach, is_live: end > 0.0, is_fresh: true })
    }

    /// The four that it is split in.
    fn quarters(self, radius: f64) -> impl Iterator<Item = Column> {
        let at = move |i: usize| {
            let side = |bit: usize| if i & bit == 0 { -0.25 } else { 0.25 };
            [self.middle[0] + side(1) * self.edge, self.middle[1] + side(2) * self.edge]
        };
        (0..4).filter_map(move |i| Column::new(self.face, at(i), self.edge / 2.0, radius, (self.end, self.reach)))
    }

    /// How far ahead of the end proofs are made: a ball as wide as the edge just reaches back from there to the square at the
    /// end, and both ahead and behind most is cleared for what is proven.
    fn ahead(&self) -> f64 {
        self.edge * std::f64::consts::FRAC_1_SQRT_2
    }

    /// Where the next proof is made.
    fn point(&self) -> [f64; 3] {
        let (axis, sign) = (self.face / 2, if self.face.is_multiple_of(2) { -1.0 } else { 1.0 });
        let mut p = [0.0; 3];
        p[axis] = sign * (self.end + self.ahead());
        p[(axis + 1) % 3] = self.middle[0];
        p[(axis + 2) % 3] = self.middle[1];
        p
    }

    /// Goes on by a ball that was proven empty.
    fn advance(&mut self, proven: f64) {
        // What is not a number is no proof.
        let proven = if proven > 0.0 { proven } else { 0.0 };
        let half_diagonal_sq = self.edge * self.edge / 2.0;
        let cleared = (proven * proven - half_diagonal_sq).max(0.0).sqrt() - self.ahead();
        self.end = (self.end - cleared.max(0.0)).max(0.0);
        if cleared > USEFUL * self.edge {
            self.reach = (proven * LONGER).max(self.edge * LEAST);
            self.is_live = self.end > 0.0;
            self.is_fresh = false;
        } else {
            // A ball that is too large may prove less than a smaller one.
            self.is_live = self.is_fresh && cleared <= 0.0 && self.reach > FAR * LEAST * self.edge;
            self.reach = self.edge * LEAST;
        }
    }
}

/// Under what a set stays the same.
#[derive(Clone, Copy, Default, Debug)]
struct Symmetry {
    /// Mirrors across the axes.
    mirrors: [bool; 3],
    /// Exchanges of the two axes that are not this one.
    swaps: [bool; 3],
}

impl Symmetry {
    /// The first axis that may stand for one.
    fn stand_in(&self, axis: usize) -> usize {
        (0..axis).find(|other| self.swaps[3 - other - axis]).unwrap_or(axis)
    }

    /// The face that stands for one.
    fn face(&self, face: usize) -> usize {
        let axis = self.stand_in(face / 2);
        2 * axis + if self.mirrors[axis] { 1 } else { face % 2 }
    }

    /// Whether no other column stands for this one.
    fn needs(&self, column: &Column) -> bool {
        let (axis, [a, b]) = (column.face / 2, column.middle);
        let is_mirrored = |by: usize, x: f64| self.mirrors[(axis + by) % 3] && x < 0.0;
        let is_swapped = self.swaps[axis] && a < b;
        self.face(column.face) == column.face && !is_mirrored(1, a) && !is_mirrored(2, b) && !is_swapped
    }
}

/// A search for the faces.
struct Search {
    cpu: Cpu,
    kernel: CpuKernel,
    radius: f64,
    symmetry: Symmetry,
    columns: Vec<Column>,
    orbits: usize,
}

impl Search {
    fn new(cpu: Cpu, kernel: CpuKernel, radius: f64, is_alone: bool) -> Search {
        let mut search = Search { cpu, kernel, radius, symmetry: Symmetry::default(), columns: Vec::new(), orbits: 0 };
        if is_alone {
            search.symmetry = search.symmetry();
        }
        search
    }

    /// The symmetry that proofs at many points show.
    fn symmetry(&mut self) -> Symmetry {
        // Spread evenly over a cube by the sequence of R. Roberts.
        let point = |i: usize| {
            [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9]
                .map(|step: f64| self.radius * (2.0 * (0.5 + step * i as f64).fract() - 1.0))
        };
        let points: Vec<[f64; 3]> = (1..=COMPARED).map(point).collect();
        let reaches = vec![self.radius * FINEST.sqrt(); COMPARED];
        let proven = self.prove(&points, &reaches);
        let mut is_kept = |image: &dyn Fn([f64; 3]) -> [f64; 3]| {
            let images: Vec<[f64; 3]> = points.iter().map(|p| image(*p)).collect();
            let others = self.prove(&images, &reaches);
            proven.iter().zip(others).all(|(a, b)| (a - b).abs() <= 1e-6 * a.abs().max(1e-3 * reaches[0]))
        };
        let mirrors = [0, 1, 2].map(|axis| {
            is_kept(&|mut p| {
                p[axis] = -p[axis];
                p
            })
        });
        let swaps = [0, 1, 2].map(|axis| {
            is_kept(&|mut p| {
                p.swap((axis + 1) % 3, (axis + 2) % 3);
                p
            })
        });
        Symmetry { mirrors, swaps }
    }

    /// Radii of balls around points that are proven empty, no larger than `reaches`.
    fn prove(&mut self, points: &[[f64; 3]], reaches: &[f64]) -> Vec<f64> {
        self.orbits += points.len();
        let columns = Estimator::columns(points, &[[1.0, 0.0, 0.0]], reaches, 0.0);
        run_prepared(&self.cpu, &self.kernel, &columns).swap_remove(0)
    }

    fn run(mut self) -> Sides {
        let (radius, edge) = (self.radius, 2.0 * self.radius / FIRST as f64);
        let at = |i: usize| (i as f64 + 0.5) * edge - radius;
        for i in 0..6 * FIRST * FIRST {
            let middle = [at(i % FIRST), at(i / FIRST % FIRST)];
            let column = Column::new(i / FIRST / FIRST, middle, edge, radius, (radius, radius));
            self.columns.extend(column.filter(|column| self.symmetry.needs(column)));
        }
        self.march();
        while self.split() {
            self.march();
        }
        let grain = radius * GRAIN;
        let faces = self.farthest().map(|(end, _)| ((end / grain).ceil() * grain).min(radius));
        let of = |face: usize| faces[self.symmetry.face(face)];
        Sides { low: [0, 2, 4].map(|face| -of(face)), high: [1, 3, 5].map(of) }
    }

    /// End and edge of the column of each face that ends farthest out.
    fn farthest(&self) -> [(f64, f64); 6] {
        let mut farthest = [(0.0, 0.0); 6];
        for column in &self.columns {
            let known = &mut farthest[column.face];
            if column.end > known.0 {
                *known = (column.end, column.edge);
            }
        }
        farthest
    }

    /// Splits the columns that hold the faces out; false if there is none to split, or too many for the orbits left.
    fn split(&mut self) -> bool {
        let finest = self.radius * FINEST * 1.5;
        let farthest = self.farthest();
        let is_split = |column: &Column| {
            let (end, edge) = farthest[column.face];
            edge.min(column.edge) > finest && column.end > end - BAND * edge
        };
        let (split, mut kept): (Vec<Column>, Vec<Column>) = self.columns.iter().partition(|column| is_split(column));
        if split.is_empty() || self.orbits + split.len() * 4 * EXPECTED > ORBITS {
            return false;
        }
        let quarters = split.into_iter().flat_map(|column| column.quarters(self.radius));
        kept.extend(quarters.filter(|column| self.symmetry.needs(column)));
        self.columns = kept;
        true
    }

    /// Takes all columns as far as proofs get them.
    fn march(&mut self) {
        loop {
            let live: Vec<usize> = (0..self.columns.len()).filter(|&i| self.columns[i].is_live).collect();
            if live.is_empty() || self.orbits > ORBITS {
                break;
            }
            let points: Vec<[f64; 3]> = live.iter().map(|&i| self.columns[i].point()).collect();
            let reaches: Vec<f64> = live.iter().map(|&i| self.columns[i].reach).collect();
            let proven = self.prove(&points, &reaches);
            live.into_iter().zip(proven).for_each(|(i, proven)| self.columns[i].advance(proven));
        }
    }
}
