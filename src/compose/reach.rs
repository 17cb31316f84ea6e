//! How far from the world's origin a field reaches: the radius of the ball that rays are cut to.
//!
//! In come a graph and its choices; out comes [`Found`]. Space is taken apart into cubes from [`FAR`] inwards, octave by octave, or from
//! where the steps' norm bounds say that all orbits escape. Points spread over each say how far members reach. A cube is empty where
//! a ball around it is proven to be (`certified-ball`, in f64; of a shape's own distance its bounds over the ball, so that no slope
//! is trusted); the cubes that hold the radius out are split. Two ends are possible:
//!
//! - What is left unproven reaches little further than members do: the radius is that of what is left, and it is **proven**.
//! - Proofs do not apply, or get stuck: the radius is that of the farthest member seen, with a [`MARGIN`]. A sampled extreme is a
//!   guess, and is reported as one ([`Reach::Sampled`]).
//!
//! Members in the outermost octave mean that the set goes on beyond what is searched ([`Reach::Endless`]).
//!
//! All points are those of fixed sequences: the answer is a function of the graph.

use serde::{Deserialize, Serialize};

use super::measure::run_prepared;
use super::placement::Frame;
use super::{Choice, ComposeResult, Composer, Purpose, compose_estimator, field_orbits};
use crate::graph::{DeForm, Method, NodeKind, Primitive};
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::records::Answer;
use crate::kernel::work::Work;
use crate::kernel::{Backend, Estimator, Kernel, inwards};
use crate::math::Precision;

/// How a bounding radius is known.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum Reach {
    /// The file states it.
    Stated,
    /// It follows from the sizes of primitives.
    Exact,
    /// Nothing is beyond: proven.
    Proven,
    /// No member was seen beyond, and there is a margin: a guess.
    Sampled,
    /// Members are as far away as anything was looked for: what is beyond is cut off.
    Endless,
}

impl Reach {
    /// In words, for reports.
    pub fn name(self) -> &'static str {
        match self {
            Reach::Stated => "declared",
            Reach::Exact => "exact",
            Reach::Proven => "proven",
            Reach::Sampled => "sampled",
            Reach::Endless => "endless",
        }
    }
}

/// What a search found.
pub(super) struct Found {
    /// The radius that rays are cut to.
    pub(super) radius: f64,
    /// How it is known.
    pub(super) reach: Reach,
    /// How far out the farthest member was seen; 0 if none was.
    pub(super) members: f64,
}

/// Operations of a point's orbits from which on fewer points are asked, so that long formulas do not wait for their bounds.
const PLAIN: f64 = 16_000.0;
/// Half the edge of the outermost cube that is searched.
pub(super) const FAR: f64 = 1024.0;
/// Half the edge of the innermost one.
const NEAR: f64 = 1.0 / 64.0;
/// Radius of a field that no member was seen of and nothing is proven about.
const UNKNOWN: f64 = 2.0;
/// Points asked in each unproven cube of an octave, and in each part that one is split in.
const PER_CUBE: usize = 8;
const PER_PART: usize = 4;
/// Cubes that are split at once, and all proofs of a search.
const AT_ONCE: usize = 256;
const PROOFS: usize = 10_000;
/// Cubes that tell whether it is worth to prove anything, and how far out they lie, in radii of the members.
const TRIALS: usize = 64;
const TRIED: f64 = 8.0;
/// Cubes whose edge is below this share of their distance are not split.
const FINEST: f64 = 1.0 / 32.0;
/// It is enough where what is left unproven reaches this many times as far as members.
const ENOUGH: f64 = 1.03;
/// A proven radius up to this many times as large is taken; a larger one is due to weak proofs.
const GENEROUS: f64 = 1.7;
/// Points asked in what no proof cleared, all in all.
const SAMPLES: usize = 8192;
/// Points asked beyond a radius that is stated.
const AROUND: usize = 4096;
/// What is left for members that no sample met.
const MARGIN: f64 = 1.3;
/// A radius up to this many times as large as that of members is not looked at further.
const GOOD: f64 = 1.25;
/// Members that tell how far a set reaches. Sets of which fewer are seen are too thin to be sampled: with fewer iterations they
/// are thicker, and never smaller.
const MANY: usize = 48;
/// The same where it is known where to look.
const FEW: usize = 12;
/// A proof is asked for a little more than it has to reach, since it gives a little less.
const ASKED: f64 = 1.01;

/// Searches a field, which has no endless primitives.
pub(super) fn search(composer: &Composer, choices: &[Choice]) -> ComposeResult<Found> {
    let mut search = Search::new(composer, choices)?;
    let found = search.run(composer, choices)?;
    if found.reach != Reach::Sampled || search.seen >= MANY {
        return Ok(found);
    }
    // Too few members for a guess: sets of fewer iterations hold the set and are easier to meet. They say where to look.
    for share in [0.75, 0.5, 0.25] {
        let limit = |n: u32| ((f64::from(n) * share) as u32).max(1);
        let graph =
            composer.graph.with_orbit_settings(|settings| settings.max_iterations = limit(settings.max_iterations));
        let composer = Composer { graph: &graph, ..*composer };
        let mut thicker = Search::new(&composer, choices)?;
        thicker.is_quick = true;
        let around = thicker.run(&composer, choices)?;
        if thicker.seen >= MANY || around.reach == Reach::Proven {
            search.sample(&[Cube { middle: [0.0; 3], half: around.radius }], SAMPLES);
            let radius = match search.seen >= FEW {
                true => (search.farthest * MARGIN).min(around.radius),
                false => around.radius,
            };
            return Ok(Found { radius: radius.max(found.members), reach: around.reach, members: search.farthest });
        }
    }
    let radius = if found.members > 0.0 { found.radius } else { UNKNOWN };
    Ok(Found { radius, ..found })
}

/// A radius from which on up to [`FAR`] nothing of the field is, by norms alone; `None` if that is not known.
fn lost_from(composer: &Composer) -> ComposeResult<Option<f64>> {
    let mut reach: f64 = 0.0;
    for orbit in field_orbits(composer) {
        let lost = super::certified::lost_from(composer, &orbit, 4.0 * FAR / orbit.frame.scale())?;
        let Some(radius) = lost.and_then(|radius| orbit.frame.reach(radius)) else { return Ok(None) };
        reach = reach.max(radius);
    }
    let mut open = vec![(composer.graph.output, Frame::default())];
    while let Some((node, frame)) = open.pop() {
        match &composer.graph.node(node).kind {
            NodeKind::Primitive(primitive) => {
                let radius = primitive_reach(primitive).and_then(|radius| frame.reach(radius));
                let Some(radius) = radius else { return Ok(None) };
                reach = reach.max(radius);
            }
            NodeKind::Transform { of, placement } => open.push((*of, frame.inside(*placement))),
            NodeKind::Orbit { .. } => {}
            NodeKind::Union(of) | NodeKind::Intersection(of) => open.extend(of.iter().map(|of| (*of, frame.clone()))),
            NodeKind::Difference { a, b: _ } => open.push((*a, frame)),
            _ => return Ok(None),
        }
    }
    Ok((0.0 < reach && reach < FAR).then_some(reach))
}

/// Farthest point of a primitive from its frame's origin; `None` if there is none.
pub(super) fn primitive_reach(primitive: &Primitive) -> Option<f64> {
    match *primitive {
        Primitive::Sphere { centre, radius, .. } => Some(length(&centre) + radius),
        Primitive::Box { centre, half_size } => Some(length(&centre) + length(&half_size)),
        Primitive::Torus { centre, major, minor } => Some(length(&centre) + major + minor),
        Primitive::Cylinder { centre, radius, half_height } => Some(length(&centre) + radius.hypot(half_height)),
        Primitive::Plane { .. } => None,
    }
}

/// The farthest of many points between `radius` and twice that which belongs to the field; `None` if none does, or the
/// field goes on without end.
pub(super) fn member_beyond(composer: &Composer, choices: &[Choice], radius: f64) -> ComposeResult<Option<[f64; 3]>> {
    let mut search = Search::new(composer, choices)?;
    let around = Cube { middle: [0.0; 3], half: radius * 2.0 };
    let is_beyond = |p: &[f64; 3]| length(p) > radius * (1.0 + 1e-9) && length(p) < 2.0 * radius;
    let points: Vec<[f64; 3]> = search.spread(&around, AROUND).into_iter().filter(is_beyond).collect();
    let members = search.members(points);
    let farthest = members.into_iter().max_by(|a, b| length(a).total_cmp(&length(b)));
    if farthest.is_none() {
        return Ok(None);
    }
    // Of what goes on without end any ball shows a part.
    let far = Cube::octave(FAR).iter().flat_map(|cube| search.spread(cube, PER_CUBE)).collect();
    Ok(farthest.filter(|_| search.members(far).is_empty()))
}

/// Whether a primitive of the field has no end.
pub(super) fn has_endless_primitives(composer: &Composer) -> bool {
    let mut open = vec![composer.graph.output];
    while let Some(node) = open.pop() {
        match &composer.graph.node(node).kind {
            NodeKind::Primitive(Primitive::Plane { .. }) => return true,
            NodeKind::Orbit { .. } => {}
            kind => open.extend(kind.wires()),
        }
    }
    false
}

/// True where fields of the output are joined with rounded seams.
pub(super) fn has_rounded_seams(composer: &Composer) -> bool {
    let mut open = vec![composer.graph.output];
    while let Some(node) = open.pop() {
        match &composer.graph.node(node).kind {
            NodeKind::SmoothUnion { .. } => return true,
            NodeKind::Orbit { .. } => {}
            kind => open.extend(kind.wires()),
        }
    }
    false
}

/// A kernel that gives radii of balls that are proven empty, as far as a query's `h` says; `None` where some part has no proofs.
pub(crate) fn empty_balls(composer: &Composer, choices: &[Choice]) -> ComposeResult<Option<Kernel>> {
    proofs(composer, choices, None)
}

/// A kernel that gives radii of balls that are proven empty, where every part of the field has proofs. `extent` is that of the
/// orbits, in world units; without it each keeps its own.
pub(super) fn proofs(composer: &Composer, choices: &[Choice], extent: Option<f64>) -> ComposeResult<Option<Kernel>> {
    let proves = |choice: &Choice| choice.applicable.contains(&Method::CertifiedBall);
    if !choices.iter().all(proves) || has_rounded_seams(composer) {
        return Ok(None);
    }
    // Of the forms that look at where an orbit ends only what escapes is proven, which is less than is empty.
    let form = |form: DeForm| if matches!(form, DeForm::Box | DeForm::Plane) { DeForm::Linear } else { form };
    let orbits = field_orbits(composer);
    let with = |(choice, orbit): (&Choice, &super::FieldOrbit)| Choice {
        method: Method::CertifiedBall,
        form: form(choice.form),
        precision: Precision::F64,
        extent: extent.map_or(choice.extent, |extent| extent / orbit.frame.scale()),
        ..choice.clone()
    };
    let choices: Vec<Choice> = choices.iter().zip(&orbits).map(with).collect();
    let estimator = compose_estimator(composer, &choices, Purpose::Proof)?.only(Answer::COLUMNS.de);
    Ok(Some(Kernel::Estimate(estimator)))
}

fn length(p: &[f64; 3]) -> f64 {
    p.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A cube of space.
#[derive(Clone, Copy)]
struct Cube {
    middle: [f64; 3],
    half: f64,
}

impl Cube {
    /// Distance of its farthest corner from the origin.
    fn outer(&self) -> f64 {
        length(&self.middle.map(|x| x.abs() + self.half))
    }

    /// Distance of its nearest point from the origin.
    fn inner(&self) -> f64 {
        length(&self.middle.map(|x| (x.abs() - self.half).max(0.0)))
    }

    /// Radius of the ball around it.
    fn around(&self) -> f64 {
        self.half * 3f64.sqrt()
    }

    fn parts(self) -> impl Iterator<Item = Cube> {
        let half = self.half / 2.0;
        let at = move |i: usize, axis: usize| self.middle[axis] + if i >> axis & 1 == 0 { -half } else { half };
        (0..8).map(move |i| Cube { middle: [0, 1, 2].map(|axis| at(i, axis)), half })
    }

    /// The cubes between the cube of half-edge `r` around the origin and that of half of it.
    fn octave(r: f64) -> Vec<Cube> {
        let at = |i: usize| r * (0.5 * i as f64 - 0.75);
        let cube = |i: usize| Cube { middle: [at(i % 4), at(i / 4 % 4), at(i / 16)], half: r / 4.0 };
        let is_within = |cube: &Cube| cube.middle.iter().all(|x| x.abs() < r / 2.0);
        (0..64).map(cube).filter(|cube| !is_within(cube)).collect()
    }
}

struct Search {
    cpu: Cpu,
    membership: CpuKernel,
    proofs: Option<CpuKernel>,
    /// Distance of the farthest member seen, and how many were.
    farthest: f64,
    seen: usize,
    /// Without proofs of balls.
    is_quick: bool,
    /// How many times fewer points than usual are asked; at least 1.
    thrift: usize,
    /// From which radius on norms say that all is lost.
    lost: Option<f64>,
    /// Points and proofs so far.
    points: usize,
    proven: usize,
    /// What is neither proven empty nor known to hold nothing that counts.
    open: Vec<Cube>,
}

impl Search {
    fn new(composer: &Composer, choices: &[Choice]) -> ComposeResult<Search> {
        // What is inside does not depend on the method, except where seams are rounded.
        let plain = |choice: &Choice| match choice.applicable.contains(&Method::Scalar) {
            true => Choice { method: Method::Scalar, ..choice.clone() },
            false => choice.clone(),
        };
        let plain: Vec<Choice> = match has_rounded_seams(composer) {
            true => choices.to_vec(),
            false => choices.iter().map(plain).collect(),
        };
        let estimator = compose_estimator(composer, &plain, Purpose::Estimate)?.only(Answer::COLUMNS.inside);
        let cpu = Cpu::new(Precision::F64);
        let iterations: u32 = estimator.orbits.iter().map(|orbit| orbit.max_iterations).sum();
        let kernel = Kernel::Estimate(estimator);
        let work = Work::of(composer.arena, &kernel).total(1.0, f64::from(iterations));
        let thrift = (work / PLAIN).ceil().max(1.0) as usize;
        let membership = prepare(&cpu, composer, kernel);
        let (farthest, seen, points, proven) = (0.0, 0, 0, 0);
        Ok(Search {
            cpu,
            membership,
            proofs: None,
            is_quick: false,
            thrift,
            lost: None,
            farthest,
            seen,
            points,
            proven,
            open: Vec::new(),
        })
    }

    fn run(&mut self, composer: &Composer, choices: &[Choice]) -> ComposeResult<Found> {
        self.lost = lost_from(composer)?;
        if self.octaves() {
            return Ok(Found { radius: FAR, reach: Reach::Endless, members: self.farthest });
        }
        if self.left() > GOOD * self.farthest && !self.is_quick {
            let kernel = proofs(composer, choices, Some(2.0 * self.lost.unwrap_or(2.0 * FAR)))?;
            self.proofs = kernel.map(|kernel| prepare(&self.cpu, composer, kernel));
            if self.proofs.is_some() && self.proofs_get_somewhere() {
                let open = std::mem::take(&mut self.open);
                self.open = self.unproven(open);
                self.refine();
            }
        }
        let (left, members) = (self.left(), self.farthest);
        if (self.proofs.is_some() || self.lost.is_some()) && left <= GENEROUS * members {
            return Ok(Found { radius: left.max(members), reach: Reach::Proven, members });
        }
        self.sample_what_is_left();
        let radius = (self.farthest * MARGIN).min(left.max(self.farthest));
        Ok(Found { radius, reach: Reach::Sampled, members: self.farthest })
    }

    /// How far out anything may be.
    fn left(&self) -> f64 {
        let open = self.open.iter().map(Cube::outer).fold(0.0, f64::max);
        self.lost.map_or(open, |lost| lost.min(open))
    }

    /// Takes the octaves from outside inwards until members say that all further in is nearer than they; true if the
    /// outermost one has members and no norm tells where the set ends.
    fn octaves(&mut self) -> bool {
        let mut r = self.lost.unwrap_or(FAR);
        let outermost = self.lost.is_none();
        while r > NEAR && self.farthest < r * 3f64.sqrt() {
            let mut cubes = Cube::octave(r);
            if self.thrift < PER_CUBE {
                cubes = cubes.into_iter().flat_map(Cube::parts).collect();
            }
            self.sample(&cubes, PER_CUBE);
            self.open.extend(cubes);
            if outermost && r == FAR && self.farthest > 0.0 {
                return true;
            }
            r /= 2.0;
        }
        self.open.push(Cube { middle: [0.0; 3], half: r });
        false
    }

    /// Whether proofs clear much empty space: tried on a few small cubes, because a search takes thousands.
    fn proofs_get_somewhere(&mut self) -> bool {
        let far = self.left().min(TRIED * self.farthest.max(NEAR));
        let is_tried = |cube: &&Cube| cube.inner() > GOOD * self.farthest && cube.outer() <= far;
        let small = |cube: &Cube| Cube { middle: cube.middle, half: cube.outer() * FINEST / 2.0 };
        let all: Vec<Cube> = self.open.iter().filter(is_tried).map(small).collect();
        let step = all.len().div_ceil(TRIALS).max(1);
        let tried: Vec<Cube> = all.into_iter().step_by(step).collect();
        let count = tried.len();
        2 * self.unproven(tried).len() < count.max(1)
    }

    /// Splits the cubes that reach farthest until they reach no farther than members do.
    fn refine(&mut self) {
        let mut stuck = Vec::new();
        while self.proven < PROOFS {
            self.open.sort_by(|a, b| a.outer().total_cmp(&b.outer()));
            let bar = ENOUGH * self.farthest;
            let lost = self.lost.unwrap_or(f64::MAX);
            self.open.retain(|cube| cube.inner() < lost);
            let first = self.open.len().saturating_sub(AT_ONCE);
            let mut split: Vec<Cube> = self.open.drain(first..).collect();
            let (near, far): (Vec<Cube>, Vec<Cube>) = split.drain(..).partition(|cube| cube.outer() <= bar);
            self.open.extend(near);
            let (fine, coarse): (Vec<Cube>, Vec<Cube>) =
                far.into_iter().partition(|cube| 2.0 * cube.half < FINEST * cube.outer());
            stuck.extend(fine);
            if coarse.is_empty() && self.open.last().is_none_or(|cube| cube.outer() <= bar) {
                break;
            }
            let parts = self.unproven(coarse.into_iter().flat_map(Cube::parts).collect());
            self.sample(&parts, PER_PART);
            self.open.extend(parts);
        }
        self.open.append(&mut stuck);
    }

    /// Asks for members wherever a member would be farther out than those seen.
    fn sample_what_is_left(&mut self) {
        for _ in 0..2 {
            let farther = |cube: &&Cube| cube.outer() > self.farthest;
            let left: Vec<Cube> = self.open.iter().filter(farther).copied().collect();
            let before = self.farthest;
            self.sample(&left, (SAMPLES / left.len().max(1)).clamp(PER_CUBE, 4096));
            if self.farthest <= before {
                break;
            }
        }
    }

    /// The cubes that are not proven empty.
    fn unproven(&mut self, cubes: Vec<Cube>) -> Vec<Cube> {
        let Some(kernel) = self.proofs.as_ref().filter(|_| !cubes.is_empty()) else { return cubes };
        self.proven += cubes.len();
        let points: Vec<[f64; 3]> = cubes.iter().map(|cube| cube.middle).collect();
        let reaches: Vec<f64> = cubes.iter().map(|cube| cube.around() * ASKED).collect();
        let columns = Estimator::columns(&points, &[[1.0, 0.0, 0.0]], &reaches, 0.0);
        let proven = run_prepared(&self.cpu, kernel, &columns).swap_remove(0);
        // What is not a number is no proof.
        let is_open = |(cube, proven): (Cube, f64)| (proven.is_nan() || proven < cube.around()).then_some(cube);
        cubes.into_iter().zip(proven).filter_map(is_open).collect()
    }

    /// Asks points of cubes whether they are members.
    fn sample(&mut self, cubes: &[Cube], each: usize) {
        let mut points = Vec::with_capacity(cubes.len() * each);
        cubes.iter().for_each(|cube| points.append(&mut self.spread(cube, each)));
        let members = self.members(points);
        self.seen += members.len();
        self.farthest = members.iter().map(length).fold(self.farthest, f64::max);
    }

    /// Points spread over a cube, by the sequence of R. Roberts; one in four close to an axis or plane where the cube touches one,
    /// since formulas have their seams there.
    /// Of points that cost much there are fewer.
    fn spread(&mut self, cube: &Cube, count: usize) -> Vec<[f64; 3]> {
        let count = (count / self.thrift).max(1);
        let step = [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9];
        let point = |i: usize| {
            let mut p =
                [0, 1, 2].map(|k| cube.middle[k] + cube.half * (2.0 * (0.5 + step[k] * i as f64).fract() - 1.0));
            if i.is_multiple_of(4) {
                let kept = i / 4 % 4;
                for (k, x) in p.iter_mut().enumerate() {
                    let touches = cube.middle[k].abs() <= cube.half * (1.0 + 1e-9);
                    *x = if k != kept && touches { *x * 0.05 } else { *x };
                }
            }
            p
        };
        let first = self.points;
        self.points += count;
        (first..first + count).map(point).collect()
    }

    /// The points that belong to the field.
    fn members(&self, points: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        if points.is_empty() {
            return points;
        }
        let columns = Estimator::columns(&points, &points.iter().map(inwards).collect::<Vec<_>>(), &[1e-4], 0.0);
        let inside = run_prepared(&self.cpu, &self.membership, &columns).swap_remove(0);
        points.into_iter().zip(inside).filter(|(_, inside)| *inside > 0.5).map(|(p, _)| p).collect()
    }
}

fn prepare(cpu: &Cpu, composer: &Composer, kernel: Kernel) -> CpuKernel {
    cpu.prepare(composer.arena, &kernel).expect("the CPU takes every kernel")
}
