//! Flights: a camera finds its way through open space by itself.
//!
//! In comes a place to begin at and a function that says how far points are from the surface. From place to place the flight goes
//! where there is room ahead and something to see around, without sharp turns, and not back to where it has been.

use glam::DVec3;

use super::View;
use crate::graph::Camera;
use crate::math::random::Random;

/// What a flight is to be like.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Flight {
    /// Other seeds fly other ways.
    pub seed: u64,
    /// Length in seconds.
    pub seconds: f64,
    /// How many times the distance to the surface is covered in a second.
    pub pace: f64,
    /// Roughly upwards.
    pub up: [f64; 3],
    /// Angle from the bottom to the top of the picture, in radians.
    pub fov: f64,
    /// Radius of what there is to see, in world units.
    pub radius: f64,
}

/// Directions that are tried at each place.
const DIRECTIONS: usize = 96;
/// The least cosine between one leg and the next.
const STRAIGHT: f64 = 0.72;
/// The most that a leg goes along the up direction, as a cosine.
const STEEPEST: f64 = 0.75;
/// Length of a leg in distances to the surface at its beginning, and as a share of the free way.
const LEG: f64 = 1.6;
const SHARE: f64 = 0.45;
/// A free way ends where the surface is nearer than this share of where it began.
const NARROW: f64 = 0.3;
/// Steps of a free way, and its length in distances to the surface where it is long enough.
const STEPS: usize = 24;
const LONG: f64 = 12.0;
/// The camera looks so many legs ahead.
const AHEAD: usize = 2;
/// Most legs.
const MOST_LEGS: usize = 2000;

/// The flight from a place in a direction, as views in the order of their times; two at least.
///
/// Errors: there is no way from here.
pub fn fly(
    flight: &Flight,
    (start, direction): ([f64; 3], [f64; 3]),
    distances: &dyn Fn(&[[f64; 3]]) -> Vec<f64>,
) -> Result<Vec<View>, String> {
    let mut pilot = Pilot {
        flight,
        distances,
        up: DVec3::from(flight.up).normalize_or(DVec3::Z),
        random: Random::new(flight.seed.wrapping_add(0x5eed)),
        places: vec![DVec3::from(start)],
        room: distances(&[start])[0],
    };
    let wanted = flight.seconds * flight.pace;
    let (mut heading, mut length) = (DVec3::from(direction).normalize_or(DVec3::X), 0.0);
    while length < wanted && pilot.places.len() < MOST_LEGS {
        let Some((next, way)) = pilot.next(heading) else { break };
        heading = (next - pilot.places[pilot.places.len() - 1]).normalize_or(heading);
        pilot.places.push(next);
        length += way;
    }
    if pilot.places.len() < 3 {
        return Err("there is no open way from here".into());
    }
    Ok(pilot.views())
}

struct Pilot<'a> {
    flight: &'a Flight,
    distances: &'a dyn Fn(&[[f64; 3]]) -> Vec<f64>,
    up: DVec3,
    random: Random,
    /// Where the flight has been.
    places: Vec<DVec3>,
    /// Distance to the surface where it began.
    room: f64,
}

impl Pilot<'_> {
    fn free(&self, points: &[DVec3]) -> Vec<f64> {
        (self.distances)(&points.iter().map(DVec3::to_array).collect::<Vec<_>>())
    }

    /// The free ways from a point, in its own distance to the surface.
    fn ways(&self, from: DVec3, room: f64, directions: &[DVec3]) -> Vec<f64> {
        let mut done = vec![0.0; directions.len()];
        let mut open: Vec<usize> = (0..directions.len()).collect();
        for _ in 0..STEPS {
            let points: Vec<DVec3> = open.iter().map(|&i| from + directions[i] * done[i]).collect();
            let free = self.free(&points);
            let mut left = Vec::new();
            for (&i, free) in open.iter().zip(free) {
                if free < NARROW * room && done[i] > 0.0 {
                    continue;
                }
                done[i] += 0.8 * free.min(3.0 * room);
                if done[i] < LONG * room {
                    left.push(i);
                }
            }
            open = left;
            if open.is_empty() {
                break;
            }
        }
        done.into_iter().map(|way| (way / room).min(LONG)).collect()
    }

    /// The next place, and the length of the leg in distances to the surface.
    fn next(&mut self, heading: DVec3) -> Option<(DVec3, f64)> {
        let from = self.places[self.places.len() - 1];
        let room = self.free(&[from])[0];
        if room <= 0.0 {
            return None;
        }
        let directions: Vec<DVec3> = (0..DIRECTIONS)
            .filter_map(|_| {
                let aside = DVec3::from(self.random.in_ball(1.0));
                let direction = (heading + aside).normalize_or(heading);
                let is_level = direction.dot(self.up).abs() < STEEPEST;
                (direction.dot(heading) > STRAIGHT && is_level).then_some(direction)
            })
            .chain([heading])
            .collect();
        let ways = self.ways(from, room, &directions);
        let to = |i: usize| from + directions[i] * ((ways[i] * SHARE).min(LEG) * room);
        let rooms = self.free(&(0..directions.len()).map(to).collect::<Vec<DVec3>>());
        let worth = |i: usize| -> f64 {
            let (direction, way) = (directions[i], ways[i]);
            // Walls at many depths around are what there is to see.
            let beside = directions.iter().zip(&ways).filter(|(other, _)| other.dot(direction) > 0.85);
            let logs: Vec<f64> = beside.map(|(_, way)| (way + 0.1).ln()).collect();
            let mean = logs.iter().sum::<f64>() / logs.len() as f64;
            let variety = (logs.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / logs.len() as f64).sqrt();
            let to = from + direction * (way * room * SHARE);
            let known = self.places.iter().rev().skip(2).map(|place| place.distance(to)).fold(f64::INFINITY, f64::min);
            let novelty = (known / (LEG * room)).min(1.0);
            let inside = (1.0 - (to.length() / self.flight.radius - 0.8).max(0.0) * 4.0).max(0.0);
            let opening = (way / LONG).sqrt() * if way >= LONG { 0.7 } else { 1.0 };
            let forward = 0.5 + 0.5 * direction.dot(heading);
            // Into ever narrower corners there is no way back.
            let roomy = (rooms[i] / self.room).powf(0.7).clamp(0.02, 1.3);
            opening * (0.3 + variety.min(0.7)) * (0.2 + 0.8 * novelty) * (0.05 + inside) * forward * roomy
        };
        let best = (0..directions.len()).max_by(|&a, &b| worth(a).total_cmp(&worth(b)))?;
        let leg = (ways[best] * SHARE).min(LEG);
        if leg < 0.2 {
            return None;
        }
        Some((from + directions[best] * (leg * room), leg))
    }

    /// Views at the places, which look ahead.
    fn views(&self) -> Vec<View> {
        let last = self.places.len() - 1;
        let far = |i: usize| self.places[(i + AHEAD).min(last)];
        let count = self.places.len() - 1;
        (0..count)
            .map(|i| {
                let place = self.places[i];
                let ahead = (far(i) - place).normalize_or(DVec3::X);
                let distance = place.distance(far(i)).max(1e-300);
                let target = place + ahead * distance;
                let camera = Camera::new(place.to_array(), target.to_array(), self.flight.up, self.flight.fov);
                View { time: self.flight.seconds * i as f64 / (count - 1).max(1) as f64, camera }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Flight, fly};

    /// Distances in a grid of columns along z, whose axes are 2 apart.
    fn columns(points: &[[f64; 3]]) -> Vec<f64> {
        let from_axis = |x: f64| x - 2.0 * (x / 2.0).round();
        points.iter().map(|p| (from_axis(p[0]).hypot(from_axis(p[1])) - 0.5).max(0.0)).collect()
    }

    fn flight(seed: u64) -> Flight {
        Flight { seed, seconds: 20.0, pace: 1.0, up: [0.0, 0.0, 1.0], fov: 1.0, radius: 50.0 }
    }

    #[test]
    fn flights_stay_in_the_open_and_go_on() {
        for seed in 0..8 {
            let views = fly(&flight(seed), ([1.0, 1.0, 0.0], [1.0, 0.0, 0.0]), &columns).expect("there is a way");
            let places: Vec<[f64; 3]> = views.iter().map(|view| view.camera.position).collect();
            assert!(columns(&places).iter().all(|free| *free > 0.1), "{seed}");
            assert!(places.len() > 8, "{seed}: {}", places.len());
            assert_eq!(views[views.len() - 1].time, 20.0);
        }
    }

    #[test]
    fn flights_follow_from_their_seeds() {
        let of = |seed| fly(&flight(seed), ([1.0, 1.0, 0.0], [1.0, 0.0, 0.0]), &columns).expect("there is a way");
        assert_eq!(of(3), of(3));
        assert_ne!(of(3), of(4));
    }

    #[test]
    fn there_is_no_way_out_of_a_wall() {
        assert!(fly(&flight(0), ([0.1, 0.0, 0.0], [1.0, 0.0, 0.0]), &columns).is_err());
    }
}
