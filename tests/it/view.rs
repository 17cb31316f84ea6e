//! Pictures of what a march did: what pixels show where the answer is known, legends, and the command.

use std::sync::Arc;

use bulbfold::check::Formula;
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::graph::{Camera, EstimateSettings, Method};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::math::Precision;
use bulbfold::render::{RenderSettings, Renderer, compose_pipeline};
use bulbfold::shade::Size;
use bulbfold::view::{Axis, Pixel, Shown, View, ViewKernels, diverging, find_truths, show, viridis};

use crate::support::{self, folder, stderr};

const SIZE: Size = Size { width: 48, height: 36 };

/// From 5 below, straight up.
const CAMERA: Camera = Camera::new([0.0, -5.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0], 0.5);

fn shown(formula: &Formula, view: View, estimate: EstimateSettings) -> Shown {
    shown_on(formula, view, estimate, CAMERA, Precision::F64)
}

fn shown_on(formula: &Formula, view: View, estimate: EstimateSettings, camera: Camera, precision: Precision) -> Shown {
    let graph = formula.graph().clone().with_camera(camera);
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: &graph };
    let settings = RenderSettings { size: SIZE, estimate, precision, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap();
    let kernels = ViewKernels::new(&composer, &pipeline, view).unwrap();
    let mut told = Vec::new();
    let marched = kernels.run(&Cpu::new(precision), &arena, SIZE, &mut |share| told.push(share)).unwrap();
    assert_eq!(told.last(), Some(&1.0));
    let truths = (view == View::Error).then(|| find_truths(&composer, &pipeline, SIZE, &mut |_| {}).unwrap());
    let shown = show(view, &composer, &pipeline, &marched, truths.as_ref());
    assert_eq!(shown.pixels.len(), (SIZE.width * SIZE.height) as usize);
    shown
}

fn automatic() -> EstimateSettings {
    EstimateSettings::default()
}

fn at(shown: &Shown, x: u32, y: u32) -> Pixel {
    shown.pixels[(y * SIZE.width + x) as usize]
}

fn value(pixel: Pixel) -> f64 {
    let Pixel::Value(value) = pixel else { panic!("{pixel:?} is no number") };
    value
}

fn class(shown: &Shown, pixel: Pixel) -> &str {
    let Pixel::Class(class) = pixel else { panic!("{pixel:?} is no class") };
    &shown.classes[class].name
}

fn ball() -> Formula {
    Formula::from_ron(
        r#"(nodes: { "ball": Sphere(centre: (0, 0, 0), radius: 1) }, output: "ball", bounding_radius: 2)"#,
    )
    .unwrap()
}

/// Pure scaling: after 4 iterations the ball of radius 16 / 2^4 = 1 is in. Its estimate with radius 0 is the distance to
/// the origin: twice too large and more.
fn dilation() -> Formula {
    let text = r#"(nodes: { "grow": scale(scale: 2.0) }, output: "grow", constant: Off, escape_radius: 16,
        max_iterations: 4, bounding_radius: 3, estimate: (method: scalar, form: linear, radius: 0))"#;
    Formula::from_ron(text).unwrap()
}

#[test]
fn an_exact_distance_has_no_error_and_no_overshoot() {
    let error = shown(&ball(), View::Error, automatic());
    // The ball is 2 asin(1 / 5) wide, the picture 0.5 radians high: it fills less than all of it.
    assert!(error.values().len() > 500 && error.count(0) > 200, "{:?}", error.summary());
    assert_eq!(error.count(1) + error.count(2), 0, "{:?}", error.summary());
    let [median, _, max] = error.spread().unwrap();
    assert!(median < 0.1 && max < 0.3, "{:?}", error.summary());
    let overshoot = shown(&ball(), View::Overshoot, automatic());
    // Walking in steps of a quarter of the threshold, which is half a footprint.
    assert!(overshoot.spread().unwrap()[2] <= 0.13, "{:?}", overshoot.summary());
}

#[test]
fn a_step_to_the_middle_of_a_ball_overshoots_by_its_radius() {
    let overshoot = shown(&dilation(), View::Overshoot, automatic());
    let pixel_radius = (CAMERA.fov / 2.0).tan() / f64::from(SIZE.height);
    // The first step of the middle ray lands on the closest point to the origin, a radius behind the surface at depth 4.
    let expected = 1.0 / (2.0 * pixel_radius * 4.0);
    let found = value(at(&overshoot, SIZE.width / 2, SIZE.height / 2));
    assert!((found - expected).abs() < 0.02 * expected, "{found} instead of {expected}");
    let confidence = shown(&dilation(), View::Confidence, automatic());
    let words = class(&confidence, at(&confidence, SIZE.width / 2, SIZE.height / 2));
    assert_eq!(words, "hit, overstepped by over 1 footprint");
    // Bisection finds the surface all the same, where the march did not step over the whole ball.
    let error = shown(&dilation(), View::Error, automatic());
    assert!(value(at(&error, SIZE.width / 2, SIZE.height / 2)).abs() < 0.1);
}

#[test]
fn a_short_estimate_is_walked_on_from_and_costs_steps() {
    // After 4 iterations the estimate is the depth to the ball of radius R / 16: 1 is right, 1.3 says 0 too early.
    let estimate = |radius| EstimateSettings { radius: Some(16.0 * radius), ..automatic() };
    let middle = |shown: &Shown| at(shown, SIZE.width / 2, SIZE.height / 2);
    let right = shown(&dilation(), View::Confidence, estimate(1.0));
    assert_eq!(class(&right, middle(&right)), "hit, settled");
    let short = shown(&dilation(), View::Confidence, estimate(1.3));
    assert_eq!(class(&short, middle(&short)), "hit, walked to over 4 footprints");
    let steps = [1.0, 1.3].map(|radius| value(middle(&shown(&dilation(), View::Steps, estimate(radius)))));
    assert!(steps[0] * 3.0 < steps[1], "{steps:?}");
    // An outside ray iterates until it escapes, an inside one 4 times, so the sum is between both.
    let iterations = value(middle(&shown(&dilation(), View::Iterations, estimate(1.0))));
    assert!(iterations > steps[0] && iterations <= 5.0 * steps[0], "{iterations} in {steps:?}");
}

#[test]
fn proofs_say_what_is_proven() {
    let formula = Formula::builtin("mandelbulb").unwrap();
    let estimate = EstimateSettings { method: Some(Method::Certified), ..automatic() };
    let camera = formula.graph().scene.camera.unwrap();
    let shown = shown_on(&formula, View::Confidence, estimate, camera, Precision::F64);
    let counts: Vec<usize> = (0..shown.classes.len()).map(|i| shown.count(i)).collect();
    assert_eq!(shown.classes[0].name, "proven empty");
    assert!(counts[0] > 300 && counts[1] > 300, "{:?}", shown.summary());
    // The undecided ones are those that a render of the same pixels counts.
    let subject = formula.subject();
    let settings = RenderSettings { size: SIZE, estimate, precision: Precision::F64, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&subject.composer(), &settings).unwrap();
    let cpu = Cpu::new(Precision::F64);
    let mut renderer = Renderer::new(&cpu, subject.arena, &pipeline, &settings).unwrap();
    renderer.render(&mut |_| true).unwrap();
    let undecided = counts[2] + counts[3] + counts[4];
    assert_eq!(renderer.stats.undecided, Some(undecided as u64), "{:?}", shown.summary());
    assert!(undecided > 10 && counts[5] == 0, "{:?}", shown.summary());
}

#[test]
fn unfinished_rays_and_starts_inside_are_told_apart() {
    let inside = Camera { position: [0.0, -0.5, 0.0], ..CAMERA };
    let shown = shown_on(&ball(), View::Confidence, automatic(), inside, Precision::F64);
    assert_eq!(class(&shown, at(&shown, 3, 3)), "starts inside");
    assert_eq!(shown.count(4), shown.pixels.len());
}

#[test]
fn a_union_says_whose_estimate_it_was() {
    let text = r#"(nodes: {
        "grow": scale(scale: 2.0),
        "left": Orbit(of: "grow", constant: Off, escape_radius: 16, max_iterations: 4),
        "apart": Transform(of: "left", translate: (-1.2, 0, 0)),
        "right": Box(centre: (1.2, 0, 0), half_size: (0.5, 0.5, 0.5)),
        "both": Union(["apart", "right"]),
    }, output: "both", bounding_radius: 3)"#;
    let formula = Formula::from_ron(text).unwrap();
    let wide = Camera { fov: 0.8, ..CAMERA };
    let shown = shown_on(&formula, View::Method, automatic(), wide, Precision::F64);
    let row = SIZE.height / 2;
    let words: Vec<&str> = (0..SIZE.width).map(|x| class(&shown, at(&shown, x, row))).collect();
    let first = |name: &str| words.iter().position(|w| w.starts_with(name));
    assert!(first("grow: scalar").is_some_and(|x| x < 24), "{words:?}");
    assert!(first("right: own").is_some_and(|x| x >= 24), "{words:?}");
    assert!(words.contains(&"no hit"), "{words:?}");
}

#[test]
fn combined_says_which_slope_was_the_larger() {
    let formula = Formula::builtin("box_bulb").unwrap();
    let subject = formula.subject();
    let estimate = EstimateSettings { method: Some(Method::Combined), ..automatic() };
    let camera = formula.graph().scene.camera.unwrap();
    let both = shown_on(&formula, View::Method, estimate, camera, Precision::F64);
    let names: Vec<&str> = both.classes.iter().map(|c| c.name.as_str()).collect();
    assert!(names.contains(&"scalar, logarithmic") && names.contains(&"gradient, logarithmic"), "{names:?}");
    // Where both methods are asked on their own, the smaller estimate is the one that is named.
    use bulbfold::compose::{Purpose, compose_estimator, deciders};
    use bulbfold::kernel::{Backend, Estimator, Kernel};
    let points: Vec<[f64; 3]> = (0..40_000).map(|k| [1, 2, 3].map(|i| 2.6 * f64::from(k * i + i).sin())).collect();
    let ask = |method: Method, purpose: Purpose| {
        let choices = subject.choices(Some(method)).unwrap();
        let kernel = Kernel::Estimate(compose_estimator(&subject.composer(), &choices, purpose).unwrap());
        let cpu = Cpu::new(Precision::F64);
        let columns = cpu.upload(&Estimator::columns(&points, &[[1.0, 0.0, 0.0]], &[1e-4], 1e-9)).unwrap();
        cpu.download(&cpu.run(&cpu.prepare(subject.arena, &kernel).unwrap(), &[&columns]).unwrap()).unwrap()
    };
    let decided = ask(Method::Combined, Purpose::Decision);
    let [scalar, gradient] = [Method::Scalar, Method::Gradient].map(|m| ask(m, Purpose::March).swap_remove(0));
    let names = deciders(&subject.composer(), &subject.choices(Some(Method::Combined)).unwrap());
    let mut seen = [0; 2];
    for i in (0..points.len()).filter(|&i| decided[1][i] < 0.5 && (scalar[i] - gradient[i]).abs() > 1e-9) {
        let wanted = if scalar[i] < gradient[i] { Method::Scalar } else { Method::Gradient };
        assert_eq!(names[decided[2][i] as usize].method, wanted, "{:?}", points[i]);
        seen[usize::from(wanted == Method::Gradient)] += 1;
    }
    assert!(seen[0] > 10 && seen[1] > 10, "{seen:?}");
}

#[test]
fn both_precisions_show_the_same() {
    let formula = Formula::builtin("mandelbox").unwrap().without_calibration();
    let camera = formula.graph().scene.camera.unwrap();
    let [a, b] = [Precision::F64, Precision::F32].map(|p| shown_on(&formula, View::Steps, automatic(), camera, p));
    let near = a.pixels.iter().zip(&b.pixels).filter(|pair| match pair {
        (Pixel::Value(a), Pixel::Value(b)) => (a - b).abs() <= 2.0,
        (a, b) => a == b,
    });
    assert!(near.count() * 100 > a.pixels.len() * 95);
}

#[test]
fn axes_lay_values_out_in_order() {
    let log = Axis::Log { low: 0.01, high: 100.0 };
    assert_eq!([0.0, 0.01, 1.0, 100.0, 1e9].map(|v| log.place(v)), [0.0, 0.0, 0.5, 1.0, 1.0]);
    let signed = Axis::Signed { near: 0.1, far: 100.0 };
    assert_eq!([-1e9, 0.0, 1e9].map(|v| signed.place(v)), [0.0, 0.5, 1.0]);
    assert!((signed.place(-3.0) + signed.place(3.0) - 1.0).abs() < 1e-12);
    for axis in [log, signed, Axis::fit(&[3.0, 40.0, 41.0, 90.0])] {
        let places: Vec<f64> = axis.ticks().into_iter().map(|v| axis.place(v)).collect();
        assert!(places.len() >= 3 && places.is_sorted(), "{axis:?} {places:?}");
    }
    assert_eq!(Axis::fit(&[3.0, 40.0, 90.0]), Axis::Log { low: 2.0, high: 50.0 });
    assert_eq!(Axis::fit(&[0.0, f64::NAN]), Axis::Log { low: 1.0, high: 10.0 });
}

/// Lightness L* of an sRGB colour (CIE 1976).
fn lightness(srgb: [f64; 3]) -> f64 {
    let linear = srgb.map(|x| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) });
    let y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
    116.0 * y.cbrt() - 16.0
}

#[test]
fn colour_maps_are_even() {
    // The ends of matplotlib's table: #440154 and #fde725; its middle #21918c.
    for (x, wanted) in [(0.0, [68.0, 1.0, 84.0]), (0.5, [33.0, 145.0, 140.0]), (1.0, [253.0, 231.0, 37.0])] {
        let found = viridis(x).map(|v| v * 255.0);
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 5.0), "{x}: {found:?}");
    }
    let steps: Vec<f64> = (0..=20).map(|i| lightness(viridis(f64::from(i) / 20.0))).collect();
    let differences: Vec<f64> = steps.windows(2).map(|w| w[1] - w[0]).collect();
    assert!(differences.iter().all(|d| (2.0..6.0).contains(d)), "{differences:?}");
    let of = |x: f64| lightness(diverging(x));
    assert!((1..=10).all(|i| of(0.5 + 0.05 * f64::from(i)) < of(0.45 + 0.05 * f64::from(i))));
    assert!((1..=10).all(|i| of(0.5 - 0.05 * f64::from(i)) < of(0.55 - 0.05 * f64::from(i))));
}

#[test]
fn the_legend_stands_below_and_the_picture_keeps_its_pixels() {
    let shown = shown(&ball(), View::Steps, automatic());
    let (plain, all) = (shown.plain_image(), shown.image());
    assert_eq!((plain.size.width, plain.size.height), (SIZE.width, SIZE.height));
    assert!(all.size.height > SIZE.height + 40 && all.size.width >= 300, "{:?}", all.size);
    let left = ((all.size.width - SIZE.width) / 2) as usize;
    for y in 0..SIZE.height as usize {
        let at = (y * all.size.width as usize + left) * 3;
        let row = y * SIZE.width as usize * 3;
        assert_eq!(all.rgb[at..at + SIZE.width as usize * 3], plain.rgb[row..row + SIZE.width as usize * 3]);
    }
    // Both ends of the colour bar, and letters.
    let legend = &all.rgb[all.size.width as usize * SIZE.height as usize * 3..];
    let has = |wanted: [f64; 3], off: f64| {
        legend.chunks(3).any(|c| c.iter().zip(wanted).all(|(a, b)| (f64::from(*a) - 255.0 * b).abs() <= off))
    };
    assert!(has(viridis(0.01), 3.0) && has(viridis(0.99), 3.0) && has([0.15; 3], 30.0));
}

fn bulbfold(folder: &std::path::Path, arguments: &[&str]) -> (i32, String) {
    let output = support::bulbfold(folder, arguments);
    assert!(output.stdout.is_empty());
    (output.status.code().expect("it was not killed"), stderr(&output))
}

#[test]
fn every_view_is_a_value_of_the_flag() {
    let folder = folder();
    for view in View::ALL {
        let name = format!("{}.png", view.name());
        let arguments = ["render", "box_bulb", "--view", view.name(), "--size", "64x36", "--stats", "-o", &name];
        let (code, said) = bulbfold(folder.path(), &[&arguments[..], &["--backend", "cpu"]].concat());
        assert_eq!(code, 0, "{said}");
        assert!(said.contains("estimate ") && said.contains('%'), "{said}");
        let image = std::fs::read(folder.path().join(&name)).expect("the picture is there");
        assert!(image.starts_with(b"\x89PNG"));
    }
    let (code, said) = bulbfold(folder.path(), &["render", "box_bulb", "--view", "steps", "--json"]);
    assert!(code == 2 && said.contains("--json"), "{said}");
    let (code, said) = bulbfold(folder.path(), &["render", "box_bulb", "--view", "depth"]);
    assert!(code == 2 && said.contains("confidence"), "{said}");
}
