//! What a view shows, found by a coarse march: the camera of a field that nobody framed, whether a camera is in the set, and the
//! iterations that a view needs.
//!
//! In come a graph and its plan by rules; a few thousand rays are marched in f64. All answers are functions of graph, view and size.

use glam::DVec3;

use serde::{Deserialize, Serialize};

use super::passes::{self, Marches, Passes, Role, Slot};
use crate::compose::{
    Bounds, ComposeResult, Composer, FieldOrbit, Plan, Purpose, Reach, compose_estimator, field_orbits,
};
use crate::expr::Arena;
use crate::graph::{Camera, IterationLimit, ValidGraph};
use crate::kernel::cpu::Cpu;
use crate::kernel::records::Answer;
use crate::kernel::{Backend, Estimator, Kernel, inwards};
use crate::march::{MarchSettings, compose_march};
use crate::math::Precision;
use crate::shade::{self, CameraFrame, Size, compose_camera, frame_automatically};

/// Rays that look for what is there.
const GRID: Size = Size { width: 64, height: 36 };
/// Hits that a frame goes by, and views that are tried to get them.
const HITS: usize = 100;
const TRIES: usize = 8;
/// How many times closer a view is where nothing was hit.
const CLOSER: f64 = 4.0;
/// Share of the hits on each side that a frame may leave out: dust.
const DUST: f64 = 0.005;
/// Share of the picture's height that the hits fill.
const FILLED: f64 = 0.86;
/// Radius that is framed of what goes on without end.
const OF_ENDLESS: f64 = 10.0;

/// The file's camera, or one that frames what is there.
pub fn camera_of(composer: &Composer, plan: &Plan) -> Camera {
    match composer.graph.scene.camera {
        Some(camera) => camera,
        // Whatever cannot be composed is told by whoever renders it.
        None => automatic_camera(composer, plan).unwrap_or_else(|_| frame_automatically(plan.bounding_radius)),
    }
}

/// A camera from the front right and above, so that what its rays hit fills the picture.
pub fn automatic_camera(composer: &Composer, plan: &Plan) -> ComposeResult<Camera> {
    if plan.reach == Reach::Endless {
        return Ok(frame_automatically(plan.bounding_radius.min(OF_ENDLESS)));
    }
    let known = if plan.members > 0.0 { plan.members } else { plan.bounding_radius };
    let first = frame_automatically(known);
    let (mut radius, mut camera, mut is_found) = (known, first, false);
    for _ in 0..TRIES {
        let hits = hits(composer, plan, &camera, GRID, GRID)?;
        let points: Vec<DVec3> = hits.into_iter().flatten().map(|(_, p)| p).collect();
        if points.is_empty() && !is_found {
            // What is much smaller than its ball falls between rays: look closer.
            radius /= CLOSER;
            camera = frame_automatically(radius);
            continue;
        }
        if points.is_empty() {
            break;
        }
        (camera, is_found) = (around(&camera, &points), true);
        if points.len() >= HITS {
            break;
        }
    }
    Ok(if is_found { camera } else { first })
}

/// The camera in the same direction that sees points as large as the picture.
fn around(camera: &Camera, points: &[DVec3]) -> Camera {
    let frame = CameraFrame::new(camera);
    let axes = [frame.right, frame.up, frame.forward].map(DVec3::from);
    let ranges = axes.map(|axis| {
        let mut all: Vec<f64> = points.iter().map(|p| p.dot(axis)).collect();
        all.sort_by(f64::total_cmp);
        let out = (all.len() as f64 * DUST) as usize;
        (all[out], all[all.len() - 1 - out])
    });
    let middle = ranges.map(|(low, high)| (low + high) / 2.0);
    let slope = (camera.fov / 2.0).tan() * FILLED;
    let is_within = |p: &&DVec3| (0..3).all(|k| (ranges[k].0..=ranges[k].1).contains(&p.dot(axes[k])));
    let needed = |p: &DVec3| {
        let [x, y, z] = [0, 1, 2].map(|k| p.dot(axes[k]) - middle[k]);
        x.abs().max(y.abs()) / slope - z
    };
    let size = (0..3).map(|k| ranges[k].1 - ranges[k].0).fold(1e-9, f64::max);
    let distance = points.iter().filter(is_within).map(needed).fold(size, f64::max);
    let target: DVec3 = (0..3).map(|k| axes[k] * middle[k]).sum();
    Camera { position: (target - axes[2] * distance).to_array(), target: target.to_array(), ..*camera }
}

/// Depth and point of a ray's hit.
pub(super) type Hit = Option<(f64, DVec3)>;

/// The hits of a coarse grid of a picture's pixels.
pub(super) fn coarse_hits(composer: &Composer, plan: &Plan, camera: &Camera, size: Size) -> ComposeResult<Vec<Hit>> {
    hits(composer, plan, camera, size, GRID)
}

/// The hits of an even grid of a picture's pixels.
fn hits(composer: &Composer, plan: &Plan, camera: &Camera, size: Size, grid: Size) -> ComposeResult<Vec<Hit>> {
    hits_at(composer, plan, (camera, size), &passes::grid(grid, size))
}

/// The surface that a picture shows at a place, in pixels; nothing where it shows none.
pub fn surface_at(
    composer: &Composer,
    plan: &Plan,
    camera: &Camera,
    size: Size,
    [x, y]: [f64; 2],
) -> ComposeResult<Option<[f64; 3]>> {
    let hits = hits_at(composer, plan, (camera, size), &[vec![x], vec![y]])?;
    Ok(hits[0].map(|(_, p)| p.to_array()))
}

/// The hits of places of a picture, in pixels.
fn hits_at(
    composer: &Composer,
    plan: &Plan,
    (camera, size): (&Camera, Size),
    places: &[Vec<f64>; 2],
) -> ComposeResult<Vec<Hit>> {
    let arena: &Arena = composer.arena;
    let cpu = Cpu::new(Precision::F64);
    let bounds = Bounds::ball(plan.bounding_radius);
    let settings = MarchSettings::of_plan(plan, shade::threshold(camera, size), Precision::F64);
    let plan = plan.clone().in_precision(Precision::F64);
    let estimator = compose_estimator(composer, &plan.choices, Purpose::March)?;
    let mut passes = Passes::default();
    let rays = Kernel::Map(compose_camera(arena, camera, size, &bounds));
    passes.push(Role::Camera, [Slot::Points], Slot::Rays, rays);
    let march = Kernel::March(compose_march(arena, estimator, &settings));
    passes.push(Role::March, [Slot::Rays], Slot::Ends, march);
    let marches = Marches::new(&cpu, arena, &passes).expect("the CPU takes every kernel");
    let ends = marches.run(&cpu, places).expect("the CPU runs every kernel");
    Ok(ends.hits().map(|hit| hit.map(|(t, p)| (t, DVec3::from(p)))).collect())
}

/// Directions that a way out of the set is looked for in, besides backwards.
const DIRECTIONS: usize = 64;
/// Distances that are tried in each, as shares of the bounding radius, and their ratio.
const SHORTEST: f64 = 1e-4;
const RATIO: f64 = 1.15;
/// The way backwards is taken up to this many times as long as the shortest: it keeps the view.
const KEEPS_THE_VIEW: f64 = 3.0;

/// Where a camera stands.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Standpoint {
    /// Outside of the set.
    Free,
    /// In the set; the nearest free point that was found, backwards from the target where that is not much farther than others.
    Inside(Option<[f64; 3]>),
}

/// Says where a camera stands.
pub fn standpoint(composer: &Composer, plan: &Plan, camera: &Camera) -> ComposeResult<Standpoint> {
    let estimator = compose_estimator(composer, &plan.choices, Purpose::Estimate)?.only(Answer::COLUMNS.inside);
    let cpu = Cpu::new(Precision::F64);
    let kernel = cpu.prepare(composer.arena, &Kernel::Estimate(estimator)).expect("the CPU takes every kernel");
    let inside = |points: &[[f64; 3]]| -> Vec<bool> {
        let columns = Estimator::columns(points, &points.iter().map(inwards).collect::<Vec<_>>(), &[1e-6], 0.0);
        let columns = cpu.upload(&columns).expect("the CPU holds every column");
        let result = cpu.run(&kernel, &[&columns]).expect("the CPU runs every kernel");
        let result = cpu.download(&result).expect("the CPU holds every column");
        result[0].iter().map(|&inside| inside > 0.5).collect()
    };
    // Parallel rays start in a plane: in the set it is a cut, and the picture shows it.
    if camera.is_parallel() || !inside(&[camera.position])[0] {
        return Ok(Standpoint::Free);
    }
    let position = DVec3::from(camera.position);
    let back = DVec3::from(CameraFrame::new(camera).forward) * -1.0;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let spread = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64;
        let angle = golden * i as f64;
        DVec3::new(angle.cos() * (1.0 - z * z).sqrt(), angle.sin() * (1.0 - z * z).sqrt(), z)
    };
    let farthest = 2.0 * (plan.bounding_radius + position.length());
    let shortest = SHORTEST * plan.bounding_radius;
    let count = ((farthest / shortest).ln() / RATIO.ln()).ceil() as i32;
    let lengths: Vec<f64> = (0..=count).map(|i| shortest * RATIO.powi(i)).collect();
    let way = |direction: DVec3| -> Option<(f64, [f64; 3])> {
        let points: Vec<[f64; 3]> = lengths.iter().map(|s| (position + direction * *s).to_array()).collect();
        let first = inside(&points).iter().position(|inside| !inside)?;
        Some((lengths[first], points[first]))
    };
    let others: Vec<(f64, [f64; 3])> = (0..DIRECTIONS).filter_map(|i| way(spread(i))).collect();
    let nearest = others.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let chosen = match (way(back), nearest) {
        (Some(back), Some(near)) if back.0 <= KEEPS_THE_VIEW * near.0 => Some(back),
        (back, near) => near.or(back),
    };
    Ok(Standpoint::Inside(chosen.map(|(_, p)| p)))
}

/// Rays that tell whether more iterations show.
const SAMPLE: Size = Size { width: 32, height: 18 };
/// Iterations to begin with where the file leaves them to the view, their growth from try to try, and the most there are.
const FIRST: u32 = 8;
const GROWTH: f64 = 1.5;
const MOST: u32 = 500;
/// More iterations do not show where they move fewer than this share of the hits by half a footprint.
const UNSEEN: f64 = 0.02;
/// Hits below which nothing is said.
const FEW: usize = 20;
/// Where too few rays hit: the limit of files that state none.
const UNTOLD: u32 = 20;

/// Iterations of a view, for the orbits whose limit follows it.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Iterations {
    /// Growths of the first limit.
    rounds: Option<u32>,
    /// Whether limits that are only stated of the file's own view may grow.
    grows: bool,
}

impl Iterations {
    /// Whether the limit of any orbit follows the view.
    pub fn follow(composer: &Composer, is_own: bool) -> bool {
        let follows = |orbit: &FieldOrbit| match orbit.settings.limit {
            IterationLimit::Stated => false,
            IterationLimit::OfOwnView => !is_own,
            IterationLimit::OfView => true,
        };
        let orbits = field_orbits(composer);
        composer.graph.scene.plane.is_none()
            && orbits.iter().any(|orbit| orbit.settings.shape.is_none() && follows(orbit))
    }

    /// The smallest limit at which a sample of the picture stands still. `is_own` says that the view is the file's: what its
    /// file states of it is kept.
    pub fn of_view(composer: &Composer, plan: &Plan, size: Size, is_own: bool) -> ComposeResult<Option<Iterations>> {
        if !Iterations::follow(composer, is_own) {
            return Ok(None);
        }
        let (graph, grows) = (composer.graph, !is_own);
        let camera = camera_of(composer, plan);
        let see = |rounds: u32| {
            let graph = Iterations { rounds: Some(rounds), grows }.apply(graph);
            hits(&Composer { graph: &graph, ..*composer }, plan, &camera, size, SAMPLE)
        };
        let pixel = shade::threshold(&camera, size);
        let mut rounds = 0;
        let mut before = see(0)?;
        loop {
            let after = see(rounds + 1)?;
            let both = || before.iter().zip(&after).filter(|(a, b)| a.is_some() || b.is_some());
            let differs = |(a, b): &(&Hit, &Hit)| match (a, b) {
                (Some((a, _)), Some((b, _))) => (a - b).abs() > pixel.radius(*a),
                _ => true,
            };
            let (all, changed) = (both().count(), both().filter(differs).count());
            if all < FEW {
                return Ok(Some(Iterations { rounds: None, grows }));
            }
            if (changed as f64) < UNSEEN * all as f64 || grown(FIRST, rounds + 1) >= MOST {
                return Ok(Some(Iterations { rounds: Some(rounds), grows }));
            }
            (before, rounds) = (after, rounds + 1);
        }
    }

    /// The graph with these limits.
    pub fn apply(self, graph: &ValidGraph) -> ValidGraph {
        graph.with_orbit_settings(|settings| {
            if settings.shape.is_some() {
                return;
            }
            settings.max_iterations = match (settings.limit, self.rounds) {
                (IterationLimit::OfView, Some(rounds)) => grown(FIRST, rounds),
                (IterationLimit::OfView, None) => UNTOLD,
                (IterationLimit::OfOwnView, Some(rounds)) if self.grows => grown(settings.max_iterations, rounds),
                _ => settings.max_iterations,
            };
        })
    }

    /// The larger of two.
    #[must_use]
    pub fn max(self, other: Iterations) -> Iterations {
        Iterations { rounds: self.rounds.max(other.rounds), ..self }
    }
}

/// A limit after some growths.
fn grown(first: u32, rounds: u32) -> u32 {
    let grown = (f64::from(first) * GROWTH.powi(rounds as i32)).round();
    (grown as u32).min(MOST.max(first))
}
