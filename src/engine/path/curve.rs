//! The curve of a path: through its views, away from the surface, with its length in units of the distance to the surface.

use glam::DVec3;

use crate::graph::motion::centripetal;

/// A point of a segment.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Its place in the segment, from 0 to 1.
    at: f64,
    position: DVec3,
    /// Distance to the surface.
    clearance: f64,
    /// Length of the segment up to here, as multiples of the clearance.
    length: f64,
}

/// A curve through points.
pub struct Curve {
    /// Its points: those that were asked for, and those that lead around the set.
    points: Vec<DVec3>,
    /// For each segment between points that were asked for, the first of `points`.
    asked: Vec<usize>,
    repeats: bool,
    /// Samples of the segments between all points.
    segments: Vec<Vec<Sample>>,
}

/// Samples that a segment begins with.
const FIRST: usize = 16;
/// The way between two samples is at most this share of their clearance.
const NEAR: f64 = 0.4;
/// How often samples are put between, and most samples of a segment.
const MOST_ROUNDS: usize = 48;
const MOST_SAMPLES: usize = 20_000;
/// Points that are added to lead around the set.
const MOST_ADDED: usize = 40;
/// The clearance counts as no less than this share of the least: what touches the set has an end.
const FLOOR: f64 = 0.1;

type Distances<'a> = &'a dyn Fn(&[[f64; 3]]) -> Vec<f64>;

impl Curve {
    /// The curve through points that keeps this clearance where it can.
    pub fn through(points: &[DVec3], repeats: bool, clearance: f64, distances: Distances) -> Curve {
        let mut curve =
            Curve { points: points.to_vec(), asked: (0..points.len()).collect(), repeats, segments: Vec::new() };
        curve.sample(clearance, distances);
        for _ in 0..MOST_ADDED {
            let Some((segment, worst)) = curve.worst(clearance) else { break };
            let Some(way) = curve.around(segment, worst, clearance, distances) else { break };
            curve.points.insert(segment + 1, way);
            curve.asked.iter_mut().filter(|first| **first > segment).for_each(|first| *first += 1);
            curve.sample(clearance, distances);
        }
        curve
    }

    /// The point at a place of a segment between points.
    fn point(&self, segment: usize, at: f64) -> DVec3 {
        let last = self.points.len() - 1;
        let neighbour = |i: isize| -> DVec3 {
            match i {
                0.. if i as usize <= last => self.points[i as usize],
                _ if self.repeats && i < 0 => self.points[last - 1],
                _ if self.repeats => self.points[1],
                ..0 => 2.0 * self.points[0] - self.points[1],
                _ => 2.0 * self.points[last] - self.points[last - 1],
            }
        };
        let around = [-1, 0, 1, 2].map(|i| neighbour(segment as isize + i).to_array());
        let found = centripetal([&around[0], &around[1], &around[2], &around[3]], at);
        if at == 1.0 { self.points[segment + 1] } else { DVec3::new(found[0], found[1], found[2]) }
    }

    /// Samples all segments so finely that the clearance is known all along.
    fn sample(&mut self, clearance: f64, distances: Distances) {
        let floor = FLOOR * clearance;
        self.segments = (0..self.points.len() - 1)
            .map(|segment| {
                let measured = |places: Vec<f64>| -> Vec<Sample> {
                    let positions: Vec<DVec3> = places.iter().map(|at| self.point(segment, *at)).collect();
                    let found = distances(&positions.iter().map(DVec3::to_array).collect::<Vec<_>>());
                    let sample = |((at, position), clearance)| Sample { at, position, clearance, length: 0.0 };
                    places.into_iter().zip(positions).zip(found).map(sample).collect()
                };
                let mut samples = measured((0..=FIRST).map(|i| i as f64 / FIRST as f64).collect());
                for _ in 0..MOST_ROUNDS {
                    let is_far = |pair: &[Sample]| {
                        let apart = pair[0].position.distance(pair[1].position);
                        apart > NEAR * pair[0].clearance.min(pair[1].clearance).max(floor)
                    };
                    let between: Vec<f64> = samples
                        .windows(2)
                        .filter(|pair| is_far(pair))
                        .map(|pair| f64::midpoint(pair[0].at, pair[1].at))
                        .collect();
                    if between.is_empty() || samples.len() + between.len() > MOST_SAMPLES {
                        break;
                    }
                    samples.extend(measured(between));
                    samples.sort_by(|a, b| a.at.total_cmp(&b.at));
                }
                for i in 1..samples.len() {
                    let (a, b) = (samples[i - 1], samples[i]);
                    let mean = f64::midpoint(a.clearance, b.clearance).max(floor);
                    samples[i].length = a.length + a.position.distance(b.position) / mean;
                }
                samples
            })
            .collect();
    }

    /// The place that comes the closest, where it is too close: its segment and its point.
    fn worst(&self, clearance: f64) -> Option<(usize, Sample)> {
        let all = self.segments.iter().enumerate().flat_map(|(i, samples)| samples.iter().map(move |s| (i, *s)));
        let worst = all.min_by(|a, b| a.1.clearance.total_cmp(&b.1.clearance));
        worst.filter(|(_, sample)| sample.clearance < clearance)
    }

    /// A free point beside a place that is too close: the nearest that has more room, across the way.
    fn around(&self, segment: usize, worst: Sample, clearance: f64, distances: Distances) -> Option<DVec3> {
        let [from, to] = [self.points[segment], self.points[segment + 1]];
        let along = (to - from).normalize_or(DVec3::X);
        let (side, other) = along.any_orthonormal_pair();
        let reach = from.distance(to).max(clearance);
        let mut tried = Vec::new();
        for ring in 0..40 {
            let radius = clearance * 1.25f64.powi(ring);
            if radius > 4.0 * reach {
                break;
            }
            for i in 0..16 {
                let angle = std::f64::consts::TAU * (f64::from(i) + f64::from(ring % 2) / 2.0) / 16.0;
                tried.push(worst.position + (side * angle.cos() + other * angle.sin()) * radius);
            }
        }
        let found = distances(&tried.iter().map(DVec3::to_array).collect::<Vec<_>>());
        tried.into_iter().zip(found).find(|(_, free)| *free >= 1.3 * clearance).map(|(point, _)| point)
    }

    /// Length of a segment that was asked for.
    pub fn length(&self, segment: usize) -> f64 {
        self.parts(segment).map(|part| self.part_length(part)).sum()
    }

    fn parts(&self, segment: usize) -> std::ops::Range<usize> {
        self.asked[segment]..self.asked[segment + 1]
    }

    fn part_length(&self, part: usize) -> f64 {
        self.segments[part].last().map_or(0.0, |sample| sample.length)
    }

    /// The point after a share of a segment's length, and its clearance.
    pub fn at(&self, segment: usize, share: f64) -> (DVec3, f64) {
        let mut left = self.length(segment) * share;
        let mut part = self.asked[segment];
        let last = self.asked[segment + 1] - 1;
        while part < last && left > self.part_length(part) {
            left -= self.part_length(part);
            part += 1;
        }
        let samples = &self.segments[part];
        let after = samples.partition_point(|sample| sample.length < left).clamp(1, samples.len() - 1);
        let (a, b) = (samples[after - 1], samples[after]);
        let between =
            if b.length > a.length { ((left - a.length) / (b.length - a.length)).clamp(0.0, 1.0) } else { share };
        let clearance = a.clearance + (b.clearance - a.clearance) * between;
        (self.point(part, a.at + (b.at - a.at) * between), clearance)
    }

    /// The least clearance of all.
    pub fn least_clearance(&self) -> f64 {
        self.segments.iter().flatten().map(|sample| sample.clearance).fold(f64::INFINITY, f64::min)
    }
}
