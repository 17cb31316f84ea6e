//! The path of a camera through views: smooth, free of the set, at a speed that fits the distance to the surface.
//!
//! In come views with their times and a function that says how far points are from the surface. The path is a curve through
//! the views; its length is measured in units of that distance (the length of a curve in the metric ds / d), so that a dive over ten decades takes
//! every decade at the same pace. Nothing depends on the frame rate.

mod curve;
mod fly;
mod turn;

use glam::{DQuat, DVec3};

use self::curve::Curve;
pub use self::fly::{Flight, fly};
use self::turn::Turns;
use crate::graph::motion::{Key, Keys, Moving, Repeat, Way};
use crate::graph::{Camera, Lens};

/// A view at a time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct View {
    /// Seconds from the film's start.
    pub time: f64,
    /// The view.
    pub camera: Camera,
}

/// How a path is to be.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct PathSettings {
    /// One pace from the first view to the last, whatever the times of the others.
    pub even: bool,
    /// Whether it goes back to the first view without a halt: that is the last view, too.
    pub repeat: bool,
    /// The least distance to the surface, in world units; half of the least of the views without it.
    pub clearance: Option<f64>,
}

/// The path of a camera.
pub struct CameraPath {
    curve: Curve,
    turns: Turns,
    cameras: Vec<Camera>,
    /// The way that is done at a time, in lengths of segments.
    progress: Progress,
    /// Length of the path up to each view.
    lengths: Vec<f64>,
    clearance: f64,
}

/// A place of the path.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Place {
    /// Seconds from the film's start.
    pub time: f64,
    /// The view.
    pub camera: Camera,
    /// Distance to the surface, in world units.
    pub clearance: f64,
}

/// Share of a path with an even pace in which it starts, and in which it ends.
const RAMP: f64 = 0.08;

/// How a path passes its length.
enum Progress {
    /// By the times of the views.
    Keys(Keys),
    /// Evenly between two times, with slow ends; a path that repeats has none.
    Even { from: f64, to: f64, ramp: f64 },
}

impl CameraPath {
    /// The path through views in the order of their times, of which there are at least two. `distances` says how far points are from
    /// the surface: 0 in the set.
    ///
    /// Errors: why there is none: a view is in the set.
    pub fn new(
        views: &[View],
        settings: PathSettings,
        distances: &dyn Fn(&[[f64; 3]]) -> Vec<f64>,
    ) -> Result<CameraPath, String> {
        let positions: Vec<DVec3> = views.iter().map(|view| DVec3::from(view.camera.position)).collect();
        let near = distances(&views.iter().map(|view| view.camera.position).collect::<Vec<_>>());
        if let Some(at) = near.iter().position(|distance| *distance <= 0.0) {
            return Err(format!("the view at {} s stands in the set", views[at].time));
        }
        let least = near.iter().copied().fold(f64::INFINITY, f64::min) / 2.0;
        let clearance = settings.clearance.unwrap_or(least);
        let curve = Curve::through(&positions, settings.repeat, clearance, distances);
        let turns = Turns::through(views.iter().map(|view| orientation(&view.camera)), settings.repeat);
        let mut lengths = vec![0.0];
        for i in 0..views.len() - 1 {
            // A turn on the spot takes its time, too.
            let length = curve.length(i) + turns.angle(i);
            lengths.push(lengths[i] + length.max(1e-9));
        }
        let (from, to) = (views[0].time, views[views.len() - 1].time);
        let progress = match settings.even {
            true => Progress::Even { from, to, ramp: if settings.repeat { 0.0 } else { RAMP } },
            false => Progress::Keys(progress_of(views, &lengths, settings.repeat)?),
        };
        let cameras = views.iter().map(|view| view.camera).collect();
        Ok(CameraPath { curve, turns, cameras, progress, lengths, clearance })
    }

    /// The least distance to the surface that the path keeps where it can.
    pub fn least_clearance(&self) -> f64 {
        self.clearance
    }

    /// Where the path comes closer to the surface than it should: the worst place, as a share of the least distance.
    pub fn tightest(&self) -> Option<f64> {
        let least = self.curve.least_clearance() / self.clearance;
        (least < 1.0 - 1e-6).then_some(least)
    }

    /// The view at a time.
    pub fn at(&self, time: f64) -> Place {
        let length = match &self.progress {
            Progress::Keys(keys) => match keys.at(time) {
                Moving::Numbers(numbers) => numbers.first().copied().unwrap_or(0.0),
                _ => 0.0,
            },
            Progress::Even { from, to, ramp } => {
                self.lengths[self.lengths.len() - 1] * trapezoid((time - from) / (to - from), *ramp)
            }
        };
        let segment = self.lengths.partition_point(|done| *done <= length).clamp(1, self.lengths.len() - 1) - 1;
        let [begun, done] = [self.lengths[segment], self.lengths[segment + 1]];
        let share = ((length - begun) / (done - begun)).clamp(0.0, 1.0);
        let (position, clearance) = self.curve.at(segment, share);
        let camera = between(&self.cameras[segment], &self.cameras[segment + 1], share);
        let turn = self.turns.at(segment, share);
        let (forward, up) = (turn * DVec3::NEG_Z, turn * DVec3::Y);
        let target = position + forward * camera.distance();
        let camera = Camera { position: position.to_array(), target: target.to_array(), up: up.to_array(), ..camera };
        // Views themselves are exact.
        let exact = match share {
            0.0 => Some(self.cameras[segment]),
            1.0 => Some(self.cameras[segment + 1]),
            _ => None,
        };
        Place { time, camera: exact.unwrap_or(camera), clearance }
    }
}

/// The length of a path that is done at a time.
fn progress_of(views: &[View], lengths: &[f64], repeat: bool) -> Result<Keys, String> {
    let key = |(view, length): (&View, &f64)| Key { time: view.time, value: Moving::Numbers(vec![*length]), way: None };
    let mut keys: Vec<Key> = views.iter().zip(lengths).map(key).collect();
    if !repeat {
        // A halt before and after lets it start and end slowly.
        let (first, last) = (keys[0].clone(), keys[keys.len() - 1].clone());
        keys.insert(0, Key { time: first.time - 1.0, ..first });
        keys.push(Key { time: last.time + 1.0, ..last });
    }
    Keys::new(keys, Way::Monotone, Repeat::Hold, None)
}

/// The share of a way at a share of the time, whose speed rises and falls evenly in the ramps and is even between.
fn trapezoid(time: f64, ramp: f64) -> f64 {
    let time = time.clamp(0.0, 1.0);
    if ramp <= 0.0 {
        return time;
    }
    let speed = 1.0 / (1.0 - ramp);
    match time {
        time if time < ramp => speed * time * time / (2.0 * ramp),
        time if time > 1.0 - ramp => 1.0 - speed * (1.0 - time) * (1.0 - time) / (2.0 * ramp),
        time => speed * (time - ramp / 2.0),
    }
}

/// The turn that a camera looks by: unturned it looks along -z with y upwards, as in glTF.
pub fn orientation(camera: &Camera) -> DQuat {
    let frame = crate::shade::CameraFrame::new(camera);
    let [right, up, forward] = [frame.right, frame.up, frame.forward].map(DVec3::from);
    DQuat::from_mat3(&glam::DMat3::from_cols(right, up, -forward)).normalize()
}

/// Lens, angle and distance to the target between two cameras; lengths by their logarithms.
fn between(from: &Camera, to: &Camera, share: f64) -> Camera {
    let even = |a: f64, b: f64| a + (b - a) * share;
    let scaled = |a: f64, b: f64| if a > 0.0 && b > 0.0 { even(a.ln(), b.ln()).exp() } else { even(a, b) };
    let size = |fov: f64| (fov / 4.0).tan();
    let lens = match (from.lens, to.lens) {
        (Lens::Orthographic { height: a }, Lens::Orthographic { height: b }) => {
            Lens::Orthographic { height: scaled(a, b) }
        }
        (Lens::Perspective { shift: a }, Lens::Perspective { shift: b }) => {
            Lens::Perspective { shift: [even(a[0], b[0]), even(a[1], b[1])] }
        }
        (lens, _) => lens,
    };
    let distance = scaled(from.distance(), to.distance());
    Camera {
        position: [0.0; 3],
        target: [0.0, 0.0, -distance],
        fov: 4.0 * scaled(size(from.fov), size(to.fov)).atan(),
        lens,
        near: scaled(from.near, to.near),
        far: from.far.zip(to.far).map(|(a, b)| scaled(a, b)),
        ..*from
    }
}

#[cfg(test)]
mod tests {
    use super::{CameraPath, PathSettings, View, trapezoid};
    use crate::graph::Camera;

    /// Distances to a unit ball around the origin.
    fn ball(points: &[[f64; 3]]) -> Vec<f64> {
        points.iter().map(|p| (p.iter().map(|x| x * x).sum::<f64>().sqrt() - 1.0).max(0.0)).collect()
    }

    fn view(time: f64, position: [f64; 3]) -> View {
        View { time, camera: Camera::new(position, [0.0; 3], [0.0, 0.0, 1.0], 0.8) }
    }

    fn height(path: &CameraPath, time: f64) -> f64 {
        ball(&[path.at(time).camera.position])[0]
    }

    #[test]
    fn a_dive_takes_every_decade_at_one_pace() {
        let views = [view(0.0, [11.0, 0.0, 0.0]), view(11.0, [1.0 + 1e-10, 0.0, 0.0])];
        let settings = PathSettings { even: true, ..PathSettings::default() };
        let path = CameraPath::new(&views, settings, &ball).expect("it is free");
        // Eleven decades; between the ramps equal times divide the height equally.
        let ratios: Vec<f64> =
            (2..9).map(|second| height(&path, f64::from(second)) / height(&path, f64::from(second) + 1.0)).collect();
        let mean = ratios.iter().map(|ratio| ratio.log10()).sum::<f64>() / ratios.len() as f64;
        assert!((1.0..1.2).contains(&mean), "{ratios:?}");
        assert!(ratios.iter().all(|ratio| (ratio.log10() / mean - 1.0).abs() < 0.05), "{ratios:?}");
        assert_eq!(path.at(0.0).camera, views[0].camera);
        assert_eq!(path.at(11.0).camera, views[1].camera);
    }

    #[test]
    fn a_path_goes_around_what_is_in_its_way() {
        let views = [view(0.0, [-3.0, 0.0, 0.1]), view(4.0, [3.0, 0.0, 0.1])];
        for clearance in [None, Some(0.4)] {
            let settings = PathSettings { clearance, ..PathSettings::default() };
            let path = CameraPath::new(&views, settings, &ball).expect("it is free");
            let least = (0..=400).map(|i| height(&path, f64::from(i) * 0.01)).fold(f64::INFINITY, f64::min);
            assert!(least > 0.9 * clearance.unwrap_or(0.3), "{clearance:?}: {least}");
            assert_eq!(path.tightest(), None);
        }
        let inside = [view(0.0, [0.5, 0.0, 0.0]), view(4.0, [3.0, 0.0, 0.1])];
        assert!(CameraPath::new(&inside, PathSettings::default(), &ball).is_err());
    }

    #[test]
    fn speeds_do_not_jump_at_views() {
        let views = [
            view(0.0, [4.0, 0.0, 0.0]),
            view(2.0, [0.0, 3.0, 1.0]),
            view(3.0, [-2.0, 0.0, 0.5]),
            view(5.0, [0.0, -2.0, 0.0]),
        ];
        let path = CameraPath::new(&views, PathSettings::default(), &ball).expect("it is free");
        let position = |time: f64| glam::DVec3::from(path.at(time).camera.position);
        let speed = |time: f64| (position(time + 1e-3) - position(time)).length() / 1e-3;
        for time in [2.0, 3.0] {
            let (before, after) = (speed(time - 2e-3), speed(time + 1e-3));
            assert!((before / after).ln().abs() < 0.2, "{time}: {before} and {after}");
        }
        assert!(speed(0.0) < 0.1 && speed(4.998) < 0.1, "it starts and ends slowly");
        let up = path.at(2.5).camera.up;
        assert!(up[2] > 0.5, "it stays upright: {up:?}");
    }

    #[test]
    fn even_ways_begin_and_end_slowly() {
        assert_eq!((trapezoid(0.0, 0.1), trapezoid(1.0, 0.1), trapezoid(0.5, 0.1)), (0.0, 1.0, 0.5));
        assert!((trapezoid(0.1, 0.1) - 0.1 / 1.8).abs() < 1e-12);
        assert_eq!(trapezoid(0.3, 0.0), 0.3);
    }
}
