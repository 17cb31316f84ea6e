//! Finding views: free points from which much is to be seen, near the set or in its cavities.
//!
//! In come a graph and its plan by rules. Points are tried around the surface, or inside of it; a few rays all around say
//! how open each is and which way is worth a look; a coarse grid of rays scores what a picture would show. Everything is computed in f64,
//! and follows from graph, plan, picture size and seed.

use glam::DVec3;
use rayon::prelude::*;

use super::passes::{self, Chain, Passes, Role, Slot};
use crate::compose::{ComposeResult, Composer, Plan, Purpose, Reach, compose_estimator};
use crate::graph::Camera;
use crate::kernel::cpu::Cpu;
use crate::kernel::records::{Marched, Ray};
use crate::kernel::{Backend, Kernel};
use crate::march::{MarchSettings, compose_march};
use crate::math::Precision;
use crate::math::random::Random;
use crate::shade::{CameraFrame, Size};

/// What views are looked for.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Search {
    /// In cavities, rather than in front of the set.
    pub interior: bool,
    /// How many are wanted, at most.
    pub count: usize,
    /// Other seeds find other views.
    pub seed: u64,
    /// Columns and rows of the pictures.
    pub size: Size,
    /// Roughly upwards.
    pub up: [f64; 3],
}

/// A view that was found.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct FoundView {
    /// Where it is seen from. The target is where its middle distance is.
    pub camera: Camera,
    /// What the view is worth beside others, from 0 to 1.
    pub score: f64,
    /// Share of the picture where something is.
    pub hits: f64,
}

/// Points that are tried.
const POINTS: usize = 320;
/// Rays all around a point.
const AROUND: usize = 64;
/// Views of a point that are scored.
const BEST: usize = 2;
/// Columns of the grid of rays that scores a view.
const COLUMNS: u32 = 20;
/// Angles of view, in radians: in front of the set, and inside.
const FOV: [f64; 2] = [0.87, 1.22];
/// Radius of a pixel of the scouting rays at distance 1.
const PIXEL_RADIUS: f64 = 0.002;
/// Share of the rays around a point that hit: from there on it is inside.
const ENCLOSED: f64 = 0.75;
/// Distances of points from the surface, as shares of the set's radius.
const DISTANCES: [f64; 2] = [0.03, 0.7];
/// The most that a view looks along the up direction, as a cosine.
const STEEPEST: f64 = 0.8;
/// Cosine of the angle around a direction within which its rays are looked at.
const BESIDE: f64 = 0.8;
/// Radius of what is searched of sets that go on without end.
const OF_ENDLESS: f64 = 4.0;

/// Finds views.
pub fn find_views(composer: &Composer, plan: &Plan, search: &Search) -> ComposeResult<Vec<FoundView>> {
    let mut scout = Scout::new(composer, plan)?;
    let mut random = Random::new(search.seed.wrapping_add(1));
    scout.look_from_outside(&mut random);
    let points = scout.points(search, &mut random);
    let sights = scout.sights(&points, search);
    let mut views = scout.scored(&sights, search);
    // What is equal in all is in the order of the points.
    views.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(varied(views, scout.radius, search.count))
}

/// Depth of a ray, where it hits.
type Depth = Option<f64>;

/// Marches rays.
struct Scout {
    cpu: Cpu,
    march: Chain<Cpu>,
    bounding_radius: f64,
    /// Radius of what is there.
    radius: f64,
    /// Rays from outside that hit: origin, direction and depth.
    seen: Vec<(DVec3, DVec3, f64)>,
}

impl Scout {
    fn new(composer: &Composer, plan: &Plan) -> ComposeResult<Scout> {
        let plan = plan.clone().in_precision(Precision::F64);
        let settings = MarchSettings::of_plan(&plan, PIXEL_RADIUS, Precision::F64);
        let estimator = compose_estimator(composer, &plan.choices, Purpose::March)?;
        let cpu = Cpu::new(Precision::F64).narrow();
        let mut passes = Passes::default();
        let march = Kernel::March(compose_march(composer.arena, estimator, &settings));
        passes.push(Role::March, [Slot::Rays], Slot::Ends, march);
        let march = Chain::compile(&cpu, composer.arena, &passes, &[Slot::Rays], &[Slot::Ends]);
        let march = march.expect("the CPU takes every kernel");
        let known = if plan.members > 0.0 { plan.members } else { plan.bounding_radius };
        let radius = if plan.reach == Reach::Endless { known.min(OF_ENDLESS) } else { known };
        Ok(Scout { cpu, march, bounding_radius: plan.bounding_radius, radius, seen: Vec::new() })
    }

    /// Depths of rays; a ray that begins in the set has depth 0.
    fn depths(&self, rays: &[(DVec3, DVec3)]) -> Vec<Depth> {
        let run = |rays: &[(DVec3, DVec3)]| -> Vec<Depth> {
            let columns = Ray::columns(rays.iter().map(|(origin, direction)| {
                let middle = -origin.dot(*direction);
                let half =
                    self.bounding_radius * self.bounding_radius - (*origin + *direction * middle).length_squared();
                let far = if half > 0.0 { middle + half.sqrt() } else { Ray::NOWHERE };
                (origin.to_array(), direction.to_array(), [(middle - half.max(0.0).sqrt()).max(0.0), far])
            }));
            let rays = self.cpu.upload(&columns).expect("the CPU holds every column");
            let ends = passes::march(&self.cpu, &self.march, &rays).expect("the CPU runs every kernel");
            let ends = self.cpu.download(&ends).expect("the CPU holds every column");
            Marched::of(&ends).rays().map(|end| end.depth()).collect()
        };
        rays.par_chunks(2048).flat_map_iter(run).collect()
    }

    /// Learns where the set is.
    fn look_from_outside(&mut self, random: &mut Random) {
        let mut rays = Vec::new();
        for direction in spread(4 * POINTS) {
            let from = direction * self.bounding_radius * 1.01;
            let to = DVec3::from(random.in_ball(self.radius));
            rays.push((from, (to - from).normalize_or(-direction)));
        }
        let depths = self.depths(&rays);
        self.seen =
            rays.into_iter().zip(depths).filter_map(|((o, d), t)| Some((o, d, t.filter(|t| *t > 0.0)?))).collect();
        let mut sizes: Vec<f64> = self.seen.iter().map(|(o, d, t)| (*o + *d * *t).length()).collect();
        sizes.sort_by(f64::total_cmp);
        if let Some(size) = sizes.get(sizes.len() * 19 / 20) {
            self.radius = self.radius.min(*size);
        }
    }

    /// Free points: in front of the surface, or between walls.
    fn points(&self, search: &Search, random: &mut Random) -> Vec<DVec3> {
        let [least, most] = DISTANCES.map(f64::ln);
        let mut points = Vec::new();
        for (origin, direction, depth) in self.seen.iter().cycle().take(POINTS.min(4 * self.seen.len())) {
            let away = self.radius * (least + (most - least) * random.unit()).exp();
            points.push(*origin + *direction * (depth - away.min(depth * 0.9)));
        }
        if !search.interior {
            return points;
        }
        // From points anywhere, and from those in front of the surface, into the depth: half of the way to the next wall.
        points.extend((0..3 * POINTS).map(|_| DVec3::from(random.in_ball(self.radius))));
        for _ in 0..3 {
            let rays: Vec<(DVec3, DVec3)> =
                points.iter().map(|p| (*p, DVec3::from(random.in_ball(1.0)).normalize_or(DVec3::X))).collect();
            let ways = rays.iter().zip(self.depths(&rays));
            points = ways
                .filter_map(|((p, d), t)| {
                    let far = t.unwrap_or(self.radius).min(self.radius);
                    (far > 1e-3 * self.radius).then(|| *p + *d * (far * (0.3 + 0.4 * random.unit())))
                })
                .filter(|p| p.length() < self.radius)
                .collect();
        }
        points.truncate(2 * POINTS);
        points
    }

    /// Points with the directions that look most worth it.
    fn sights(&self, points: &[DVec3], search: &Search) -> Vec<(DVec3, DVec3)> {
        let directions: Vec<DVec3> = spread(AROUND).collect();
        let rays: Vec<(DVec3, DVec3)> = points.iter().flat_map(|p| directions.iter().map(|d| (*p, *d))).collect();
        let depths = self.depths(&rays);
        let mut sights = Vec::new();
        for (point, depths) in points.iter().zip(depths.chunks(AROUND)) {
            let hits = depths.iter().flatten();
            let share = hits.clone().count() as f64 / AROUND as f64;
            let nearest = hits.fold(f64::INFINITY, |least, t| least.min(*t));
            if nearest < 2e-3 * self.radius || (share >= ENCLOSED) != search.interior {
                continue;
            }
            let mut worth: Vec<(f64, DVec3)> = directions
                .iter()
                .filter(|direction| direction.dot(DVec3::from(search.up).normalize_or(DVec3::Z)).abs() < STEEPEST)
                .map(|direction| {
                    let beside = directions.iter().zip(depths).filter(|(other, _)| other.dot(*direction) > BESIDE);
                    let logs: Vec<f64> = beside.clone().filter_map(|(_, t)| t.map(f64::ln)).collect();
                    let share = logs.len() as f64 / beside.count().max(1) as f64;
                    (share * deviation(&logs), *direction)
                })
                .collect();
            worth.sort_by(|a, b| b.0.total_cmp(&a.0));
            sights.extend(worth.iter().take(BEST).filter(|(worth, _)| *worth > 0.0).map(|(_, d)| (*point, *d)));
        }
        sights
    }

    /// The views of sights that show enough.
    fn scored(&self, sights: &[(DVec3, DVec3)], search: &Search) -> Vec<FoundView> {
        let fov = FOV[usize::from(search.interior)];
        let Size { width, height } = search.size;
        let rows = (COLUMNS * height).div_ceil(width.max(1)).clamp(4, 4 * COLUMNS);
        let pixel = 2.0 * (fov / 2.0).tan() / f64::from(rows);
        let rays: Vec<(DVec3, DVec3)> = sights
            .iter()
            .flat_map(|(point, direction)| {
                let camera = Camera::new([0.0; 3], direction.to_array(), search.up, fov);
                let frame = CameraFrame::new(&camera);
                let [right, up, forward] = [frame.right, frame.up, frame.forward].map(DVec3::from);
                let ray = move |(i, j): (u32, u32)| {
                    let x = (f64::from(i) + 0.5 - f64::from(COLUMNS) / 2.0) * pixel;
                    let y = (f64::from(rows) / 2.0 - f64::from(j) - 0.5) * pixel;
                    (*point, (right * x + up * y + forward).normalize())
                };
                (0..rows).flat_map(move |j| (0..COLUMNS).map(move |i| (i, j))).map(ray)
            })
            .collect();
        let count = (COLUMNS * rows) as usize;
        let along = |i: usize| rays[i].1.dot(sights[i / count].1);
        let depths: Vec<Depth> =
            self.depths(&rays).into_iter().enumerate().map(|(i, t)| t.map(|t| t * along(i))).collect();
        let pictures = depths.chunks(count);
        let view = |((point, direction), depths): (&(DVec3, DVec3), &[Depth])| {
            let (score, hits, middle) = score(depths, COLUMNS as usize)?;
            let target = *point + *direction * middle.min(2.0 * self.radius);
            let camera = Camera::new(point.to_array(), target.to_array(), search.up, fov);
            Some(FoundView { camera, score, hits })
        };
        sights.iter().zip(pictures).filter_map(view).collect()
    }
}

/// Directions spread evenly over the sphere.
fn spread(count: usize) -> impl Iterator<Item = DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (angle, side) = (golden * i as f64, (1.0 - z * z).sqrt());
        DVec3::new(angle.cos() * side, angle.sin() * side, z)
    })
}

/// Standard deviation.
fn deviation(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// Shares of hits between which a picture has something to show and somewhere to breathe.
const HITS: [f64; 2] = [0.3, 0.97];
/// Share of hits that is best.
const BEST_HITS: f64 = 0.8;
/// Deviation of the logarithms of depths from which more adds nothing.
const DEEP: f64 = 0.6;
/// Change of the logarithm of the depth that is an edge, and shares of edges: enough of them, too many, dust.
const EDGE: f64 = 0.2;
const EDGES: [f64; 3] = [0.14, 0.3, 0.7];
/// Bend of the surface, from neighbour to neighbour, from which it has detail, and the share of it that is enough.
const BEND: f64 = 0.015;
const BENT: f64 = 0.6;
/// Columns and rows of parts of the picture that are asked for detail each, so that one wall does not fill the half of it.
const PARTS: [usize; 2] = [4, 3];
/// Depth of what is near as a share of the middle depth, from which nothing stands in the way.
const OPEN: f64 = 0.4;

/// What a picture of these depths along the view direction is worth, its share of hits and its middle depth; nothing where it is empty
/// or full.
fn score(depths: &[Depth], columns: usize) -> Option<(f64, f64, f64)> {
    let mut sorted: Vec<f64> = depths.iter().flatten().copied().collect();
    let hits = sorted.len() as f64 / depths.len() as f64;
    if !(HITS[0]..=HITS[1]).contains(&hits) {
        return None;
    }
    sorted.sort_by(f64::total_cmp);
    let (near, middle) = (sorted[sorted.len() / 20], sorted[sorted.len() / 2]);
    let logs: Vec<f64> = sorted.iter().map(|t| t.max(1e-12).ln()).collect();
    let variety = (deviation(&logs) / DEEP).min(1.0);
    let edges = edges(depths, columns);
    let outlined = match edges {
        edges if edges <= EDGES[1] => (edges / EDGES[0]).min(1.0),
        edges => ((EDGES[2] - edges) / (EDGES[2] - EDGES[1])).max(0.0),
    };
    let detail = detail(depths, columns);
    let open = (near / middle / OPEN).min(1.0);
    let filled = 1.0 - ((hits - BEST_HITS) / 0.6).powi(2);
    let score = filled * (0.2 + 0.8 * variety) * (0.2 + 0.8 * outlined) * (0.1 + 0.9 * detail) * (0.2 + 0.8 * open);
    Some((score, hits, middle))
}

/// Share of neighbours in rows between which an edge is.
fn edges(depths: &[Depth], columns: usize) -> f64 {
    let pairs = depths.chunks(columns).flat_map(|row| row.windows(2));
    let changes: Vec<f64> = pairs.filter_map(|pair| Some((pair[0]? / pair[1]?).ln().abs())).collect();
    changes.iter().filter(|change| **change > EDGE).count() as f64 / changes.len().max(1) as f64
}

/// How much of the parts of a picture has detail, from 0 to 1. Planes have none, however oblique they are: along a row of pixels their inverse depth is a
/// straight line.
fn detail(depths: &[Depth], columns: usize) -> f64 {
    let rows = depths.len() / columns;
    let part = |x: usize, y: usize| (y * PARTS[1] / rows) * PARTS[0] + x * PARTS[0] / columns;
    let mut seen = [[0.0f64; 2]; PARTS[0] * PARTS[1]];
    for (y, row) in depths.chunks(columns).enumerate() {
        for (x, triple) in row.windows(3).enumerate() {
            let [Some(a), Some(b), Some(c)] = triple else { continue };
            let bend = (b / a + b / c - 2.0).abs();
            let [all, bent] = &mut seen[part(x + 1, y)];
            *all += 1.0;
            *bent += f64::from(u8::from(bend > BEND));
        }
    }
    let parts = || seen.iter().filter(|[all, _]| *all > 0.0);
    parts().map(|[all, bent]| (bent / all / BENT).min(1.0)).sum::<f64>() / parts().count().max(1) as f64
}

/// How much a view that is like another one loses, and how far apart views are unlike, as a share of the set's radius.
const LIKE: f64 = 0.85;
const APART: f64 = 0.3;

/// The best views, each unlike those before it. Places that the set's mirror planes make alike count as one.
fn varied(mut views: Vec<FoundView>, radius: f64, count: usize) -> Vec<FoundView> {
    let place = |view: &FoundView| {
        let mut of = [view.camera.position, view.camera.target].map(|p| p.map(f64::abs));
        of.iter_mut().for_each(|p| p.sort_by(f64::total_cmp));
        of.map(DVec3::from)
    };
    let like = |a: &FoundView, b: &FoundView| {
        let ([p, t], [q, u]) = (place(a), place(b));
        let scale = |view: &FoundView| view.camera.distance();
        let size = (scale(a) / scale(b)).ln() * 0.5;
        let apart = (p.distance_squared(q) + t.distance_squared(u)) / (radius * radius * APART * APART) + size * size;
        (-apart).exp()
    };
    let mut chosen: Vec<FoundView> = Vec::new();
    while chosen.len() < count && !views.is_empty() {
        let worth = |view: &FoundView| {
            let most = chosen.iter().map(|other| like(view, other)).fold(0.0, f64::max);
            view.score * (1.0 - LIKE * most)
        };
        let all: Vec<f64> = views.par_iter().map(worth).collect();
        let best = (0..all.len()).max_by(|&a, &b| all[a].total_cmp(&all[b]).then(b.cmp(&a))).unwrap_or(0);
        chosen.push(views.swap_remove(best));
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::{detail, score};

    #[test]
    fn what_is_empty_full_flat_or_blocked_is_worth_little() {
        let picture = |of: fn(usize, usize) -> Option<f64>| -> Vec<Option<f64>> {
            (0..200).map(|i| of(i % 20, i / 20)).collect()
        };
        let worth = |of| score(&picture(of), 20).map_or(0.0, |(score, ..)| score);
        let columns: fn(usize, usize) -> Option<f64> =
            |x, y| (y > 1).then(|| if (x / 3) % 2 == 0 { 1.0 + 0.05 * ((x * 7 + y * 3) % 5) as f64 } else { 4.0 });
        assert_eq!(detail(&picture(|x, _| Some(1.0 / (1.0 + 0.05 * x as f64))), 20), 0.0, "an oblique plane");
        let good = worth(columns);
        assert!(good > 0.4, "{good}");
        assert_eq!(worth(|_, _| None), 0.0);
        assert_eq!(worth(|_, _| Some(1.0)), 0.0);
        assert!(worth(|_, y| (y > 1).then_some(1.0)) < 0.1);
        assert!(worth(|x, y| (y > 1).then(|| if (x + y) % 2 == 0 { 0.1 } else { 5.0 })) < 0.2 * good, "dust");
        assert!(
            worth(|x, y| (y > 1).then(|| if x < 3 { 0.01 } else { 1.0 + 0.2 * ((x * 5 + y) % 4) as f64 })) < 0.8 * good
        );
    }
}
