//! Checks once, when a formula is read, whether members of the set lie where a march finds them. The map itself decides.
//!
//! A derivative says how long the image of the threshold's ball is, and not how wide. Where a map stretches along one direction
//! alone the image is long and thin: it covers nothing, and every orbit within the threshold may escape. An
//! estimate that is a loose bound is below a threshold far from the set. So stops are looked for as rays from outside find them, and
//! around each of them, within the threshold, orbits that stay in. Where there are none, the claim is not to be trusted.

use super::footprint::is_marked;
use super::measure::{directions, run_prepared};
use super::orbit::{Carried, OrbitBuilder};
use super::placement::Frame;
use super::{Choice, ComposeResult, Composer, FieldOrbit, Purpose};
use crate::expr::{Expr, Function, Port, Type};
use crate::graph::Method;
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::records::Query;
use crate::kernel::{Backend, Estimator, Kernel};
use crate::math::Precision;
use crate::math::random::Random;

/// Thresholds that are tried, in extents of the set: half a pixel of a thumbnail, and of a view three hundred times as close.
const THRESHOLDS: [f64; 2] = [3e-3, 1e-5];
/// What is tried where no orbit ends at those: few iterations show no more.
const COARSE: f64 = 1e-2;
/// Stops that are asked, for each threshold, and how many of them may have no member around them.
const STOPS: usize = 24;
const MAY_FAIL: usize = STOPS / 8;
/// The share of stops that may have an image narrower than the set. Behind ripples all have one; of the bulbs kept up to half do,
/// beside their axis and in crevices, where one direction grows slowest.
const MAY_BE_NARROW: f64 = 0.375;
/// How far around a stop members are looked for, in thresholds: a stop by an estimate lies in front of the set.
const REACH_OF_ENDS: f64 = 0.25;
const REACH_OF_ESTIMATES: f64 = 4.0;
/// Stops by an estimate of which so many may have no member that near: the surface is elsewhere by a few thresholds then.
const MAY_FAIL_BY_ESTIMATE: usize = STOPS / 8;

/// Points of a level of the search for what rays may aim at, the best that the next level starts from, levels, and what a level is
/// smaller by.
const POINTS: usize = 256;
const PARENTS: usize = 32;
const LEVELS: usize = 8;
const SMALLER: f64 = 0.25;
/// The same of the search around a stop.
const POINTS_AROUND: usize = 24;
const PARENTS_AROUND: usize = 4;
const LEVELS_AROUND: usize = 26;
const SMALLER_AROUND: f64 = 0.5;
/// Iterations that an orbit must stay for longer than that of the stop, to be as good as a member's.
const LONGER: f64 = 4.0;
/// Rays that are marched at random besides those to where orbits stay long, and steps of each.
const RAYS: usize = 72;
const STEPS: usize = 256;
/// How far a ray goes at once: a share of the estimate, and of the threshold at least.
const OF_ESTIMATE: f64 = 0.5;
const LEAST_STEP: f64 = 0.5;
/// Points of a ray, each nearer to its aim than the last by [`NEARER`], and bisections between the first two that differ.
const ALONG: usize = 32;
const NEARER: f64 = 0.75;
const BISECTIONS: usize = 16;

/// What is claimed of a point: that members are within the threshold.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Claim {
    /// By an orbit that would end at the footprint.
    Ends,
    /// By an estimate below the threshold.
    Estimate,
}

/// Whether orbits may end at the footprint: members are within the threshold there, and its image is wide in every direction.
/// `choice` has the extent, and what can be differentiated. Where no orbit ends that early nothing is known, and nothing to be
/// gained.
pub(super) fn measure_ends(composer: &Composer, orbit: &FieldOrbit, choice: &Choice) -> ComposeResult<bool> {
    if !choice.differentiable {
        return Ok(false);
    }
    let mut search = Search::new(composer, orbit, choice, Claim::Ends)?;
    let mut all = 0;
    for eps in [THRESHOLDS[0], THRESHOLDS[1], COARSE].map(|share| share * choice.extent) {
        if eps == COARSE * choice.extent && all > 0 {
            break;
        }
        let (stops, widths) = search.ends(eps);
        let narrow = widths.iter().filter(|width| **width * eps < choice.extent).count();
        all += stops.len();
        let is_narrow = narrow as f64 > MAY_BE_NARROW * stops.len() as f64;
        if is_narrow || search.without_members(&stops, eps * REACH_OF_ENDS) > MAY_FAIL {
            return Ok(false);
        }
    }
    Ok(all > 0)
}

/// Whether rays may stop where the estimate is below a threshold, in units of the orbit's own frame; `None` if it is
/// as large as a pixel, whatever that is.
pub(super) fn measure_stops(
    composer: &Composer,
    orbit: &FieldOrbit,
    choice: &Choice,
    threshold: Option<f64>,
) -> ComposeResult<bool> {
    let eps = threshold.unwrap_or(THRESHOLDS[0] * choice.extent);
    let mut search = Search::new(composer, orbit, choice, Claim::Estimate)?;
    let stops = search.stops(eps);
    Ok(search.without_members(&stops, eps * REACH_OF_ESTIMATES) <= MAY_FAIL_BY_ESTIMATE)
}

/// How an orbit went on to its end.
#[derive(Clone, Copy)]
struct Went {
    is_member: bool,
    /// Iterations.
    n: f64,
    /// The more the longer it stayed, and the less far it came at last.
    score: f64,
}

/// A stop around which members are looked for.
struct Around {
    at: [f64; 3],
    n: f64,
    /// The best points so far, with their scores.
    best: Vec<([f64; 3], f64)>,
}

/// An orbit in its own frame, and what is claimed of its points.
struct Search {
    cpu: Cpu,
    /// Points to `inside, n, r`.
    orbits: CpuKernel,
    /// Points to whether it is claimed that members are near, what is stretched least, and an estimate.
    claims: CpuKernel,
    escape_radius: f64,
    extent: f64,
    random: Random,
}

impl Search {
    fn new(composer: &Composer, orbit: &FieldOrbit, choice: &Choice, claim: Claim) -> ComposeResult<Search> {
        let cpu = Cpu::new(Precision::F64);
        let kernel = |claim| -> ComposeResult<CpuKernel> {
            let kernel = compose(composer, orbit, choice, claim)?;
            Ok(cpu.prepare(composer.arena, &kernel).expect("the CPU takes every kernel"))
        };
        let (orbits, claims) = (kernel(None)?, kernel(Some(claim))?);
        let (escape_radius, extent) = (orbit.settings.escape_radius, choice.extent);
        Ok(Search { orbits, claims, cpu, escape_radius, extent, random: Random::new(1) })
    }

    fn went(&self, points: &[[f64; 3]]) -> Vec<Went> {
        let out = run_prepared(&self.cpu, &self.orbits, &Estimator::columns(points, &[AWAY], &[1e-6], 0.0));
        let of = |i: usize| {
            let (is_member, n) = (out[0][i] > 0.5, out[1][i]);
            let near = (self.escape_radius / out[2][i]).min(1.0);
            let score = n + if near > 0.0 { near } else { 0.0 };
            Went { is_member, n, score: if is_member { f64::MAX } else { score } }
        };
        (0..points.len()).map(of).collect()
    }

    /// Of which points it is claimed that members are within `eps`.
    fn claimed(&self, points: &[[f64; 3]], eps: f64) -> Vec<bool> {
        self.claims_of(points, eps)[0].iter().map(|x| *x > 0.5).collect()
    }

    /// The same, with how much a ball around each is stretched where it is stretched least, and an estimate.
    fn claims_of(&self, points: &[[f64; 3]], eps: f64) -> Vec<Vec<f64>> {
        run_prepared(&self.cpu, &self.claims, &Estimator::columns(points, &[AWAY], &[eps * 1e-2], eps))
    }

    /// Points that rays from outside may aim at: the search goes to where orbits stay long.
    fn aims(&mut self, eps: f64) -> Vec<[f64; 3]> {
        const SHELLS: usize = 8;
        let shell = |k: usize| {
            let radius = self.extent * k as f64 / SHELLS as f64;
            directions(POINTS / SHELLS, k as f64).into_iter().map(move |p| p.map(|x| x * radius))
        };
        let mut points: Vec<[f64; 3]> = (1..=SHELLS).flat_map(shell).collect();
        let (mut found, mut radius) = (Vec::new(), self.extent * SMALLER);
        for _ in 0..LEVELS {
            let (went, claimed) = (self.went(&points), self.claimed(&points, eps));
            let mut order: Vec<usize> = (0..points.len()).collect();
            order.sort_by(|&a, &b| went[b].score.total_cmp(&went[a].score));
            let here: Vec<usize> = order.iter().copied().filter(|&i| claimed[i] || went[i].is_member).collect();
            // Not all of one level: they are children of few.
            found.extend(spread(&here, STOPS).map(|&i| points[i]));
            let parents: Vec<usize> = order.into_iter().filter(|&i| !went[i].is_member).take(PARENTS).collect();
            if parents.is_empty() {
                break;
            }
            points = (0..POINTS).map(|k| self.near(points[parents[k % parents.len()]], radius)).collect();
            radius *= SMALLER;
        }
        spread(&found, STOPS).copied().collect()
    }

    /// Points where marched rays end by the claim, as many of all as are asked; and what is stretched least at them. Most rays
    /// go through the set at random: where orbits stay longest alone, ends are later than a picture's, and images narrower.
    fn ends(&mut self, eps: f64) -> (Vec<[f64; 3]>, Vec<f64>) {
        let mut aims: Vec<[f64; 3]> = (0..RAYS).map(|_| self.random.in_ball(self.extent)).collect();
        aims.extend(self.aims(eps));
        let from: Vec<[f64; 3]> = aims.iter().map(|_| self.random.direction()).collect();
        let far = 2.0 * self.extent;
        let mut open: Vec<(usize, f64)> = (0..aims.len()).map(|i| (i, far)).collect();
        let mut ends = Vec::new();
        for _ in 0..STEPS {
            let at = |&(i, way): &(usize, f64)| [0, 1, 2].map(|k| aims[i][k] + from[i][k] * way);
            let points: Vec<[f64; 3]> = open.iter().map(at).collect();
            if points.is_empty() {
                break;
            }
            let (went, claims) = (self.went(&points), self.claims_of(&points, eps));
            let mut on = Vec::new();
            for (j, (i, way)) in open.into_iter().enumerate().filter(|(j, _)| !went[*j].is_member) {
                let way_on = way - (OF_ESTIMATE * claims[2][j]).max(LEAST_STEP * eps).min(self.extent);
                match claims[0][j] > 0.5 {
                    true => ends.push((i, (points[j], claims[1][j]))),
                    false if way_on > -far => on.push((i, way_on)),
                    false => {}
                }
            }
            open = on;
        }
        ends.sort_by_key(|(i, _)| *i);
        spread(&ends, STOPS).map(|(_, end)| *end).unzip()
    }

    /// Points where rays from outside would stop by the claim, and that are no members.
    fn stops(&mut self, eps: f64) -> Vec<[f64; 3]> {
        let aims = self.aims(eps);
        let from: Vec<[f64; 3]> = aims.iter().map(|_| self.random.direction()).collect();
        // The aim's distances along its ray, from far to near.
        let far = 2.0 * self.extent;
        let at = |i: usize, way: f64| [0, 1, 2].map(|k| aims[i][k] + from[i][k] * way);
        let ways: Vec<f64> = (0..ALONG).map(|k| far * NEARER.powi(k as i32)).collect();
        let points: Vec<[f64; 3]> =
            (0..aims.len()).flat_map(|i| ways.iter().map(move |way| (i, *way))).map(|(i, way)| at(i, way)).collect();
        let stops = self.stop_at(&points, eps);
        let mut brackets: Vec<[f64; 2]> = (0..aims.len())
            .map(|i| match (0..ALONG).find(|k| stops[i * ALONG + k]) {
                Some(k) => [if k == 0 { ways[0] } else { ways[k - 1] }, ways[k]],
                None => [ways[ALONG - 1], 0.0],
            })
            .collect();
        for _ in 0..BISECTIONS {
            let middle: Vec<f64> = brackets.iter().map(|[a, b]| 0.5 * (a + b)).collect();
            let points: Vec<[f64; 3]> = middle.iter().enumerate().map(|(i, way)| at(i, *way)).collect();
            for ((bracket, way), stops) in brackets.iter_mut().zip(middle).zip(self.stop_at(&points, eps)) {
                bracket[usize::from(stops)] = way;
            }
        }
        let ends: Vec<[f64; 3]> = brackets.iter().enumerate().map(|(i, [_, b])| at(i, *b)).collect();
        let (went, claimed) = (self.went(&ends), self.claimed(&ends, eps));
        (0..ends.len()).filter(|&i| claimed[i] && !went[i].is_member).map(|i| ends[i]).collect()
    }

    /// Where rays stop: at members, or by the claim.
    fn stop_at(&self, points: &[[f64; 3]], eps: f64) -> Vec<bool> {
        let claimed = self.claimed(points, eps);
        self.went(points).iter().zip(claimed).map(|(went, claimed)| went.is_member || claimed).collect()
    }

    /// How many stops have no orbit within `reach` that stays in.
    fn without_members(&mut self, stops: &[[f64; 3]], reach: f64) -> usize {
        let went = self.went(stops);
        let around = |(at, went): (&[f64; 3], Went)| Around { at: *at, n: went.n, best: vec![(*at, went.score)] };
        let mut open: Vec<Around> = stops.iter().zip(went).map(around).collect();
        let mut radius = reach;
        for _ in 0..LEVELS_AROUND {
            let mut points = Vec::new();
            for around in &open {
                let parent = |k: usize| around.best[k % around.best.len()].0;
                points.extend((0..POINTS_AROUND).map(|k| within(around.at, self.near(parent(k), radius), reach)));
            }
            let went = self.went(&points);
            let mut number = 0;
            open.retain_mut(|around| {
                let own = number..number + POINTS_AROUND;
                number = own.end;
                around.best.extend(own.clone().map(|i| (points[i], went[i].score)));
                around.best.sort_by(|a, b| b.1.total_cmp(&a.1));
                around.best.truncate(PARENTS_AROUND);
                !own.into_iter().any(|i| went[i].is_member || went[i].n >= around.n + LONGER)
            });
            if open.is_empty() {
                break;
            }
            radius *= SMALLER_AROUND;
        }
        open.len()
    }

    fn near(&mut self, at: [f64; 3], radius: f64) -> [f64; 3] {
        let offset = self.random.in_ball(radius);
        [0, 1, 2].map(|k| at[k] + offset[k])
    }
}

/// About the smallest singular value of a Jacobian, at most 1.8 times as much: the root of the third symmetric function of the squares
/// over the second. Both are sums of minors (Cauchy and Binet).
fn least_stretch<'g>(rows: &[Expr<'g>]) -> Expr<'g> {
    let arena = rows[0].arena;
    let sum = |parts: Vec<Expr<'g>>| parts.into_iter().reduce(|a, b| a + b).unwrap_or_else(|| arena.f(0.0));
    let (mut pairs, mut triples) = (Vec::new(), Vec::new());
    for (i, a) in rows.iter().enumerate() {
        for (j, b) in rows.iter().enumerate().skip(i + 1) {
            let across = a.cross(*b);
            pairs.push(across.dot(across));
            triples.extend(rows.iter().skip(j + 1).map(|c| across.dot(*c) * across.dot(*c)));
        }
    }
    (sum(triples) / sum(pairs).max(arena.f(1e-300))).sqrt()
}

/// A direction that is no map's own.
const AWAY: [f64; 3] = [0.48, 0.6, 0.64];

/// The point of a ball around `at` that is nearest to a point.
fn within(at: [f64; 3], p: [f64; 3], radius: f64) -> [f64; 3] {
    let off = [0, 1, 2].map(|k| p[k] - at[k]);
    let length = off.iter().map(|x| x * x).sum::<f64>().sqrt();
    let share = (radius / length).min(1.0);
    [0, 1, 2].map(|k| at[k] + off[k] * share)
}

/// Some of a list, at equal distances in it.
fn spread<T>(list: &[T], count: usize) -> impl Iterator<Item = &T> {
    list.iter().step_by((list.len() / count).max(1)).take(count)
}

/// The orbit in its own frame: with a claim to whether that holds at a point, else to its end.
fn compose(composer: &Composer, orbit: &FieldOrbit, choice: &Choice, claim: Option<Claim>) -> ComposeResult<Kernel> {
    let width = composer.graph.state_width(orbit.root, &orbit.settings);
    let (choice, carried, purpose) = match claim {
        // r's gradient ends an orbit before any other derivative does.
        Some(Claim::Ends) => {
            let carried = Carried { jacobian: true, ..Carried::NOTHING };
            let choice = Choice { method: Method::Gradient, tight: false, ends: true, ..choice.clone() };
            (choice, carried, Purpose::March)
        }
        Some(Claim::Estimate) => {
            let choice = Choice { ends: false, ..choice.clone() };
            let carried = Carried::of(&choice, Purpose::Estimate);
            (choice, carried, Purpose::Estimate)
        }
        None => (Choice { method: Method::Scalar, ..choice.clone() }, Carried::NOTHING, Purpose::Probe),
    };
    let (root, settings, frame, choice) = (orbit.root, &orbit.settings, &Frame::default(), &choice);
    let builder = OrbitBuilder { composer, settings, root, frame, width, carried, choice, purpose };
    let mut orbit = builder.build("nearby".to_string())?;
    if claim == Some(Claim::Ends) {
        let (start, _) = builder.start()?;
        orbit.finish.output("least", least_stretch(&start.as_inputs(0).rows));
    }
    let mut inputs = Estimator::inputs();
    let first = inputs.len();
    inputs.extend(orbit.finish.output_ports());
    inputs.extend([Port::new("inside", Type::B), Port::new("n", Type::F)]);
    let input = |at: usize, ty: Type| composer.arena.input(at as u16, ty);
    let (inside, n) = (input(inputs.len() - 2, Type::B), input(inputs.len() - 1, Type::F));
    let de = input(first, Type::F);
    let mut combine = Function::new("combine", inputs);
    match claim {
        Some(Claim::Ends) => {
            combine.output("near", is_marked(de));
            combine.output("least", input(first + 1, Type::F));
            combine.output("estimate", de);
        }
        Some(Claim::Estimate) => {
            combine.output("near", (!inside).and(de.lt(Query::first(composer.arena).hit_eps)));
            combine.output("least", composer.arena.f(0.0));
        }
        None => {
            combine.output("inside", inside);
            combine.output("n", n);
            combine.output("r", input(first + 1, Type::F));
        }
    }
    Ok(Kernel::Estimate(Estimator { orbits: vec![orbit], combine }))
}
