//! Where f32 ends and where f64 does: depths at zooms towards a surface point, and known answers far in.

use std::rc::Rc;

use bulbfold::check::Formula;
use bulbfold::check::truth::{Members, point};
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::graph::{Camera, ValidGraph};
use bulbfold::kernel::cpu::{Cpu, Precision};
use bulbfold::march::{MIN_DIFFERENCE_F32, MIN_DIFFERENCE_F64};
use bulbfold::precision::{Resolution, resolution};
use bulbfold::render::{RenderSettings, Renderer, compose_pipeline};
use bulbfold::shade::{CameraFrame, Size};

const SIZE: Size = Size { width: 160, height: 90 };

/// A fractal's own camera and a surface point that it sees.
struct Place {
    formula: Formula,
    camera: Camera,
    direction: [f64; 3],
    distance: f64,
}

/// How a view is brought closer.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Zoom {
    /// The camera moves.
    Dolly,
    /// The angle shrinks.
    Lens,
}

impl Place {
    /// The point that the middle of the file's view shows, to the last digit.
    fn of(name: &str) -> Place {
        let formula = Formula::builtin(name).unwrap();
        let camera = formula.graph().camera.expect("the file frames its fractal");
        let frame = CameraFrame::new(&camera);
        let offsets = (0..40).map(|k| f64::from(k) * 0.01);
        let aimed = offsets.map(|s| [0, 1, 2].map(|i| frame.forward[i] + frame.right[i] * s));
        let (direction, t) = aimed
            .map(|d| glam::DVec3::from(d).normalize().to_array())
            .find_map(|d| Some((d, formula.ray(camera.position, d)?)))
            .expect("the view shows something");
        let subject = formula.subject();
        let members = Members::new(&subject.composer(), &subject.plan.choices).unwrap();
        let (mut outside, mut inside) = (t - 1e-4, t + 1e-6);
        for _ in 0..60 {
            let middle = 0.5 * (outside + inside);
            match members.inside(&[point((camera.position, direction), middle)], &[0.0])[0] {
                true => inside = middle,
                false => outside = middle,
            }
        }
        Place { camera, direction, distance: outside, formula }
    }

    fn camera(&self, zoom: f64, kind: Zoom) -> Camera {
        let target = point((self.camera.position, self.direction), self.distance);
        match kind {
            Zoom::Dolly => {
                let position = point((target, self.direction), -self.distance / zoom);
                Camera { position, target, ..self.camera }
            }
            Zoom::Lens => {
                let fov = 2.0 * ((self.camera.fov / 2.0).tan() / zoom).atan();
                Camera { target, fov, ..self.camera }
            }
        }
    }

    fn graph(&self, zoom: f64, kind: Zoom) -> ValidGraph {
        self.formula.graph().clone().with_camera(self.camera(zoom, kind))
    }
}

/// Depths of every seventh pixel, and how fine the view is.
fn depths(place: &Place, graph: &ValidGraph, precision: Precision) -> (Vec<Option<f64>>, Resolution, f64) {
    let arena = Rc::new(Arena::default());
    let composer = Composer { arena: &arena, library: place.formula.library(), graph };
    let min_difference = if precision == Precision::F32 { MIN_DIFFERENCE_F32 } else { MIN_DIFFERENCE_F64 };
    let settings = RenderSettings { size: SIZE, min_difference, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap();
    let cpu = Cpu::new(precision);
    let mut renderer = Renderer::new(&cpu, &arena, &pipeline, &settings).unwrap();
    let pixels: Vec<(u32, u32)> = (0..SIZE.width * SIZE.height).step_by(7).map(|i| (i % SIZE.width, i / SIZE.width)).collect();
    let found = renderer.depths(&pixels).unwrap();
    (found, resolution(&composer, &pipeline, SIZE), pipeline.pixel_radius)
}

/// Median difference of f32's depths from f64's in footprints, and the share of pixels where only one of them hits.
struct Difference {
    ulps: f64,
    median: f64,
    most: f64,
    flipped: f64,
}

fn difference(place: &Place, zoom: f64, kind: Zoom) -> Difference {
    let graph = place.graph(zoom, kind);
    let (single, _, _) = depths(place, &graph, Precision::F32);
    let (double, resolution, pixel_radius) = depths(place, &graph, Precision::F64);
    let mut errors = Vec::new();
    let mut flipped = 0;
    for (a, b) in single.iter().zip(&double) {
        match (a, b) {
            (Some(a), Some(b)) => errors.push((a - b).abs() / (2.0 * pixel_radius * b)),
            (None, None) => {}
            _ => flipped += 1,
        }
    }
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors.get((errors.len() as f64 * share) as usize).copied().unwrap_or(f64::INFINITY);
    Difference {
        ulps: resolution.ulps(Precision::F32),
        median: at(0.5),
        most: at(0.9),
        flipped: f64::from(flipped) / single.len() as f64,
    }
}

/// Prints the table of docs/precision.md: `cargo test --release --test precision table -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table for the documentation"]
fn table() {
    for name in ["mandelbulb", "mandelbox", "box_bulb", "menger"] {
        let place = Place::of(name);
        for kind in [Zoom::Dolly, Zoom::Lens] {
            for half in 0..=12 {
                let zoom = 10f64.powf(f64::from(half) / 2.0);
                let Difference { ulps, median, most, flipped } = difference(&place, zoom, kind);
                println!("| {name} | {kind:?} | {zoom:.0} | {ulps:.1} | {median:.3} | {most:.3} | {:.2} % |", 100.0 * flipped);
            }
        }
    }
}
