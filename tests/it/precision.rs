//! Where f32 ends and where f64 does: depths at zooms towards a surface point, and known answers far in.

use std::sync::Arc;

use bulbfold::check::truth::{self, Members, point};
use bulbfold::check::{Formula, Subject};
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::graph::{Camera, ValidGraph};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Backend, Estimator};
use bulbfold::math::Precision;
use bulbfold::precision::{LEAST_ULPS, Resolution, resolution};
use bulbfold::render::{RenderSettings, Renderer, compose_pipeline};
use bulbfold::shade::{CameraFrame, Size};

use crate::support::{bulbfold, folder, stderr};

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
        let camera = formula.graph().scene.camera.expect("the file frames its fractal");
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
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: place.formula.library(), graph };
    let settings = RenderSettings { size: SIZE, precision, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap();
    let cpu = Cpu::new(precision);
    let mut renderer = Renderer::new(&cpu, &arena, &pipeline, &settings).unwrap();
    let pixels: Vec<(u32, u32)> =
        (0..SIZE.width * SIZE.height).step_by(7).map(|i| (i % SIZE.width, i / SIZE.width)).collect();
    let found = renderer.depths(&pixels).unwrap();
    (found, resolution(&arena, &pipeline, SIZE), pipeline.pixel.pixel_radius)
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

/// Prints the table of docs/precision.md: `cargo test --release --test it precision::table -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table for the documentation"]
fn table() {
    for name in ["mandelbulb", "mandelbox", "box_bulb", "menger"] {
        let place = Place::of(name);
        for kind in [Zoom::Dolly, Zoom::Lens] {
            for half in 0..=12 {
                let zoom = 10f64.powf(f64::from(half) / 2.0);
                let Difference { ulps, median, most, flipped } = difference(&place, zoom, kind);
                println!(
                    "| {name} | {kind:?} | {zoom:.0} | {ulps:.1} | {median:.3} | {most:.3} | {:.2} % |",
                    100.0 * flipped
                );
            }
        }
    }
}

/// Prints what rounding the point costs beside rounding the orbit, as shifts of the point in its units of the last place.
#[test]
#[ignore = "prints numbers for the documentation"]
fn shares_of_rounding() {
    for name in ["mandelbulb", "mandelbox", "box_bulb", "menger"] {
        let place = Place::of(name);
        let subject = place.formula.subject();
        let target = point((place.camera.position, place.direction), place.distance);
        // Points a thousandth in front of the surface, a little apart.
        let at =
            |k: usize| [0, 1, 2].map(|i| target[i] - place.direction[i] * 1e-3 + 1e-5 * ((k * (i + 3)) as f64).sin());
        let points: Vec<[f64; 3]> = (0..500).map(at).collect();
        let rounded: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| f64::from(x as f32))).collect();
        let kernel = subject.estimator(&subject.plan.choices).unwrap();
        let run = |precision: Precision, points: &[[f64; 3]]| {
            let cpu = Cpu::new(precision);
            let kernel = cpu.prepare(subject.arena, &kernel).unwrap();
            let columns = Estimator::columns(points, &[place.direction], &[1e-4], 1e-9);
            let out = cpu.run(&kernel, &[&cpu.upload(&columns).unwrap()]).unwrap();
            cpu.download(&out).unwrap().swap_remove(0)
        };
        let (exact, start, single) =
            (run(Precision::F64, &points), run(Precision::F64, &rounded), run(Precision::F32, &rounded));
        let ulp = Precision::F32.ulp(target.iter().fold(0.0, |most: f64, x| most.max(x.abs())));
        let median = |a: &[f64], b: &[f64]| {
            let mut all: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a - b).abs() / ulp).collect();
            all.sort_by(f64::total_cmp);
            all[all.len() / 2]
        };
        println!("| {name} | {:.2} | {:.2} |", median(&exact, &start), median(&start, &single));
    }
}

/// Not only is no pixel black: what rays meet is what brute force meets, as far in as f64 goes.
#[test]
fn depths_far_in_are_those_of_brute_force() {
    for name in ["mandelbulb", "mandelbox", "menger"] {
        let place = Place::of(name);
        for zoom in [1e5, 1e9, 1e13] {
            let graph = place.graph(zoom, Zoom::Dolly);
            let arena = Arc::new(Arena::default());
            let subject = Subject::new(place.formula.library(), &graph, &arena);
            let subject = subject.unwrap_or_else(|error| panic!("{}", error.message));
            let settings = RenderSettings { size: SIZE, precision: Precision::F64, ..RenderSettings::default() };
            let judged = truth::judge(&subject, 40, &settings).unwrap();
            println!(
                "{name} at {zoom:e}: {} hits, {:.4} footprints off, {:.2} % missed, {:.2} % early",
                judged.hits,
                judged.median_error,
                100.0 * judged.missed,
                100.0 * judged.early
            );
            assert!(judged.hits > 20, "{name} at {zoom:e}: {judged:?}");
            assert!(judged.median_error < 0.5 && judged.missed == 0.0, "{name} at {zoom:e}: {judged:?}");
        }
    }
}

#[test]
fn f32_serves_every_view_that_the_rule_gives_it() {
    for name in ["mandelbulb", "mandelbox", "box_bulb"] {
        let place = Place::of(name);
        for kind in [Zoom::Dolly, Zoom::Lens] {
            // The file's own view, and the closest one that is still f32's.
            let first = difference(&place, 1.0, kind);
            let closest = 0.9 * first.ulps / LEAST_ULPS;
            let zooms = [1.0, closest / 8.0, closest];
            for Difference { ulps, median, most, flipped } in zooms.map(|zoom| difference(&place, zoom, kind)) {
                if ulps < LEAST_ULPS {
                    continue; // the surface point may be nearer than most of the first view
                }
                let told = format!("{name}, {kind:?}, {ulps:.1} ulps: median {median}, 90 % {most}, flipped {flipped}");
                assert!(median < 0.25 && most < 0.5 && flipped < 0.01, "{told}");
            }
            // Two decades further it has lost the surface: the rule is not idle.
            let lost = difference(&place, closest * 100.0, kind);
            let Difference { ulps, most, flipped, .. } = lost;
            let told = format!("{name}, {kind:?}, {ulps} ulps: 90 % {most}, flipped {flipped}");
            assert!(ulps < LEAST_ULPS && (most > 0.5 || flipped > 0.1), "{told}");
        }
    }
}

/// A camera that looks straight onto a surface, this far in front of it, with every pixel's exact depth.
fn known(formula: &str, camera: Camera, exact: impl Fn([f64; 3]) -> f64) {
    let place = Place { formula: Formula::from_ron(formula).unwrap(), camera, direction: [0.0; 3], distance: 0.0 };
    let graph = place.formula.graph().clone().with_camera(camera);
    let (found, resolution, pixel_radius) = depths(&place, &graph, Precision::F64);
    assert!(!resolution.fits(Precision::F32) && resolution.fits(Precision::F64), "{resolution:?}");
    let frame = CameraFrame::new(&camera);
    for (k, t) in found.iter().enumerate() {
        let pixel = 7 * k as u32;
        let [x, y] = [pixel % SIZE.width, pixel / SIZE.width].map(|i| f64::from(i) + 0.5);
        let right = (x - f64::from(SIZE.width) / 2.0) * 2.0 * pixel_radius;
        let up = (f64::from(SIZE.height) / 2.0 - y) * 2.0 * pixel_radius;
        let d = [0, 1, 2].map(|i| frame.right[i] * right + frame.up[i] * up + frame.forward[i]);
        let d = glam::DVec3::from(d).normalize().to_array();
        let (t, exact) = (t.unwrap_or(f64::INFINITY), exact(d));
        assert!(
            (t - exact).abs() < pixel_radius * exact,
            "{formula}
pixel {x}, {y}: {t:e} instead of {exact:e}"
        );
    }
}

/// Depth of the unit sphere seen from `1 + delta` below the origin, without cancellation.
fn sphere_depth(delta: f64) -> impl Fn([f64; 3]) -> f64 {
    move |d| {
        let (c, b) = (delta * (2.0 + delta), -(1.0 + delta) * d[2]);
        c / (-b + (b * b - c).sqrt())
    }
}

/// Two powers of two near a billionth and a trillionth: sums with 1 are exact.
const DELTAS: [f64; 2] = [1.0 / (1u64 << 30) as f64, 1.0 / (1u64 << 40) as f64];

fn below(height: f64, at: [f64; 2], delta: f64) -> Camera {
    let position = [at[0], at[1], -height - delta];
    Camera::new(position, [at[0], at[1], -height], [0.0, 1.0, 0.0], 0.8)
}

#[test]
fn a_sphere_is_where_it_is_a_trillionth_away() {
    for delta in DELTAS {
        let primitive =
            r#"(nodes: { "ball": Sphere(centre: (0, 0, 0), radius: 1) }, output: "ball", bounding_radius: 1.5)"#;
        known(primitive, below(1.0, [0.0; 2], delta), sphere_depth(delta));
        // The Julia set of z^8 with constant 0 is the unit ball; 22 iterations leave no shell of 1e-18.
        let julia = r#"(nodes: { "bulb": bulb_power(power: 8) }, output: "bulb", constant: Julia((0, 0, 0)),
            escape_radius: 10, max_iterations: 22, bounding_radius: 1.2)"#;
        known(julia, below(1.0, [0.0; 2], delta), sphere_depth(delta));
    }
}

#[test]
fn a_plane_is_where_it_is_a_trillionth_away() {
    for delta in DELTAS {
        let plane =
            r#"(nodes: { "floor": Plane(normal: (0, 0, -1), offset: 1) }, output: "floor", bounding_radius: 3)"#;
        known(plane, below(1.0, [0.3, 0.2], delta), |d| delta / d[2]);
    }
}

#[test]
fn a_face_of_the_sponge_is_where_it_is_a_trillionth_away() {
    // With the box form the set after 7 iterations is made of cubes of 3^-7; near a corner the face is whole.
    let sponge = r#"(nodes: { "fold": menger_fold(), "grow": scale(scale: 3.0, centre: (1, 1, 1)),
        "sponge": Sequence(["fold", "grow"]) }, output: "sponge", constant: Off, escape_radius: 8, max_iterations: 7,
        bounding_radius: 1.75, estimate: (method: scalar, form: box, radius: 1))"#;
    for delta in DELTAS {
        known(sponge, below(1.0, [0.99998, 0.99998], delta), |d| delta / d[2]);
    }
}

#[test]
fn a_view_fits_the_precision_that_tells_its_pixels_apart() {
    let view = Resolution { footprint: 1e-3, size: 2.0 };
    assert!(view.fits(Precision::F32) && view.room(Precision::F32) > 100.0);
    assert!(!Resolution { footprint: 1e-7, size: 2.0 }.fits(Precision::F32));
}

fn render(arguments: &[&str]) -> (i32, String) {
    let folder = folder();
    let output = bulbfold(folder.path(), [&["render"], arguments].concat());
    let code = output.status.code().expect("it was not killed");
    assert_eq!(folder.path().join("mandelbulb.png").exists(), code == 0);
    (code, stderr(&output))
}

#[test]
fn precision_follows_the_zoom_and_says_so() {
    let view = |height: &str| format!("0,0,{height}");
    let run = |position: &str, more: &[&str]| {
        let position = view(position);
        let mut arguments = vec!["mandelbulb", "--size", "48x32", "--samples", "1", "--camera", &position];
        // The surface that is looked for below is that of the file's own iterations, and closer views would take more.
        arguments.extend(["--up", "0,1,0", "--set", "max_iterations=6"]);
        arguments.extend(more);
        render(&arguments)
    };
    // On the axis the bulb ends somewhere between 0.65 and 0.9: find it to 1e-15 by bisection.
    let bulb = Formula::builtin("mandelbulb").unwrap();
    let (mut inside, mut outside) = (0.6, 0.95);
    for _ in 0..60 {
        let middle = 0.5 * (inside + outside);
        *(if bulb.inside([0.0, 0.0, middle]) { &mut inside } else { &mut outside }) = middle;
    }
    let near = |delta: f64| format!("{:.17}", outside + delta);
    let target = format!("0,0,{inside:.17}");
    let run = |delta: f64, more: &[&str]| run(&near(delta), &[&["--target", &target], more].concat());

    let (code, said) = run(1.0, &["--backend", "cpu"]);
    assert!(code == 0 && !said.contains("too close"), "{said}");
    let (code, said) = run(1e-7, &["--backend", "cpu", "--stats"]);
    assert!(code == 0 && said.contains("too close for f32") && said.contains("cpu, f64"), "{said}");
    let (code, said) = run(1e-7, &["--backend", "cpu", "--quiet"]);
    assert!(code == 0 && said.is_empty(), "{said}");
    let (code, said) = run(1e-7, &["--backend", "cpu", "--precision", "f32", "--stats"]);
    assert!(
        code == 0 && said.contains("warning: this view is too close for f32") && said.contains("cpu, f32"),
        "{said}"
    );
    // A camera inside the set is not close to anything.
    let (code, said) = run(-0.3, &["--backend", "cpu"]);
    assert!(code == 0 && !said.contains("too close"), "{said}");
    let (code, said) = run(3e-15, &["--backend", "cpu"]);
    assert!(code == 0 && said.contains("warning: this view is too close for f64"), "{said}");
}
