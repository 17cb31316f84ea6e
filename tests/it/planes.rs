//! Pictures of planes: estimates of points with known distances, what pictures show of them, and what commands say.

use std::sync::Arc;

use bulbfold::check::{Backends, Formula, Target};
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::film::Image;
use bulbfold::kernel::Backend;
use bulbfold::kernel::cpu::Cpu;
use bulbfold::math::Precision;
use bulbfold::render::{RenderSettings, Renderer, Stats, compose_pipeline};
use bulbfold::shade::Size;

use crate::support::{bulbfold, folder, pixels, stderr, stdout};

type P = [f64; 3];

thread_local! {
    /// Opened once a thread and never closed: drivers cannot be while a thread ends.
    static BACKENDS: &'static Backends = Box::leak(Box::new(Backends::new()));
}

/// Julia sets of z^2 + c; `set` holds more fields.
fn julia(c: [f64; 2], set: &str) -> Formula {
    let text = format!(
        "(nodes: {{ \"square\": quaternion_power(power: 2.0) }}, constant: Julia(({}, {}, 0.0)), escape_radius: 1000.0, \
         max_iterations: 400, bounding_radius: 2.1, {set})",
        c[0], c[1]
    );
    Formula::from_ron(&text).unwrap_or_else(|error| panic!("{text}\n{error}"))
}

/// Estimates and membership on every back end.
fn estimates(formula: &Formula, points: &[P]) -> Vec<(Target, Vec<(f64, bool)>)> {
    let backends = BACKENDS.with(|backends| *backends);
    let subject = formula.subject();
    let kernel = subject.estimator(&subject.plan.choices).unwrap_or_else(|error| panic!("{}", error.message));
    let on = |target| (target, subject.estimates(backends, target, &kernel, points).unwrap());
    backends.targets().into_iter().map(on).collect()
}

/// Relative error of estimates whose orbits go up to a few hundred iterations.
fn slack(target: Target) -> f64 {
    if target == Target::CPU_F64 { 1e-5 } else { 2e-3 }
}

/// Koebe's theorem, of the potential G and the estimate G / 2 |G'|: the distance is from sinh G / 2 e^G |G'| to
/// 2 sinh G / |G'|. Close to the set that is from once to four times the estimate.
fn assert_koebe(de: f64, potential: f64, distance: f64, p: &P) {
    let least = de * (1.0 - (-2.0 * potential).exp()) / (2.0 * potential);
    let most = 4.0 * de * potential.sinh() / potential;
    let room = 1.001;
    assert!(least <= distance * room && distance <= most * room, "{p:?}: {distance} is not in {least} to {most}");
}

/// z = w + 1/w with |w| > 1 is outside the segment from -2 to 2, where ln |w| is the potential of z^2 - 2: both are exact.
#[test]
fn estimates_of_two_julia_sets_are_exact() {
    let at = |r: f64, turn: f64| (r * turn.cos(), r * turn.sin());
    let circles: Vec<(f64, f64)> =
        [1.001, 1.05, 1.3, 2.0].iter().flat_map(|&r| (0..7).map(move |k| at(r, 0.3 + 0.9 * f64::from(k)))).collect();
    let disc: Vec<P> = circles.iter().map(|&(x, y)| [x, y, 0.0]).collect();
    for (target, found) in estimates(&julia([0.0, 0.0], ""), &disc) {
        for (p, (de, inside)) in disc.iter().zip(found) {
            // r ln r / 2 at every level of z -> z^2.
            let r = p[0].hypot(p[1]);
            let expected = r * r.ln() / 2.0;
            assert!(!inside && (de / expected - 1.0).abs() < slack(target), "{target:?} {p:?}: {de}, not {expected}");
            assert_koebe(de, r.ln(), r - 1.0, p);
        }
    }
    let plane = |&(u, v): &(f64, f64)| {
        let square = u * u + v * v;
        [u + u / square, v - v / square, 0.0]
    };
    let segment: Vec<P> = circles.iter().map(plane).collect();
    for (target, found) in estimates(&julia([-2.0, 0.0], ""), &segment) {
        for (((u, v), p), (de, inside)) in circles.iter().zip(&segment).zip(found) {
            let r = u.hypot(*v);
            // |w| |dz/dw| of dz/dw = 1 - 1/w^2.
            let (real, imaginary) = (1.0 - (u * u - v * v) / r.powi(4), 2.0 * u * v / r.powi(4));
            let expected = r.ln() * r * real.hypot(imaginary) / 2.0;
            let distance = (p[0].abs() - 2.0).max(0.0).hypot(p[1]);
            assert!(!inside && (de / expected - 1.0).abs() < slack(target), "{target:?} {p:?}: {de}, not {expected}");
            assert_koebe(de, r.ln(), distance, p);
        }
    }
}

/// Left of the tip at -2 the distance is known, and at the tip of a slit the estimate is the distance itself. Right of the
/// cusp at 1/4 both branches of the cardioid c = w / 2 - w^2 / 4 bend away, and the set is no further than they are.
#[test]
fn estimates_of_the_mandelbrot_set_keep_koebes_bounds() {
    let formula = Formula::builtin("mandelbrot").unwrap();
    let lengths = [1e-3, 1e-2, 0.1, 0.5, 1.0];
    let places: Vec<(P, f64)> = lengths
        .iter()
        .flat_map(|&d| [([-2.0 - d, 0.0, 0.0], d), ([0.25 + d, 0.0, 0.0], from_cardioid(0.25 + d))])
        .collect();
    let points: Vec<P> = places.iter().map(|(p, _)| *p).collect();
    for (target, found) in estimates(&formula, &points) {
        for ((p, d), (de, inside)) in places.iter().zip(found) {
            let room = 1.0 + slack(target);
            assert!(!inside && de <= d * room, "{target:?} {p:?}: {de} of {d}");
            assert!(p[0] > 0.0 || *d <= 4.0 * de * room, "{target:?} {p:?}: {de} of {d}");
            if p[0] < -2.0 && *d <= 1e-3 {
                assert!((de / d - 1.0).abs() < 0.05, "{target:?} {p:?}: {de} of {d}");
            }
        }
    }
}

/// The distance of a real number from the boundary of the cardioid.
fn from_cardioid(x: f64) -> f64 {
    let away = |k: u32| {
        let turn = f64::from(k) * std::f64::consts::PI / 100_000.0;
        let real = turn.cos() / 2.0 - (2.0 * turn).cos() / 4.0;
        (real - x).hypot(turn.sin() / 2.0 - (2.0 * turn).sin() / 4.0)
    };
    (0..=100_000).map(away).fold(f64::INFINITY, f64::min)
}

/// The cardioid and the disc of period two, a hundredth inside; and three points that leave at once.
#[test]
fn members_of_the_mandelbrot_set_are_known() {
    let formula = Formula::builtin("mandelbrot").unwrap();
    let turns = (0..24).map(|k| f64::from(k) * std::f64::consts::TAU / 24.0);
    // c = w / 2 - w^2 / 4 with |w| < 1.
    let cardioid = |turn: f64| {
        let (x, y) = (0.99 * turn.cos(), 0.99 * turn.sin());
        [x / 2.0 - (x * x - y * y) / 4.0, y / 2.0 - x * y / 2.0, 0.0]
    };
    let disc = |turn: f64| [-1.0 + 0.2475 * turn.cos(), 0.2475 * turn.sin(), 0.0];
    let mut points: Vec<P> = turns.flat_map(|turn| [cardioid(turn), disc(turn)]).collect();
    let members = points.len();
    points.extend([[0.5, 0.5, 0.0], [-2.1, 0.0, 0.0], [0.0, 1.2, 0.0]]);
    for (target, found) in estimates(&formula, &points) {
        for (i, (_, inside)) in found.iter().enumerate() {
            assert_eq!(*inside, i < members, "{target:?} {:?}", points[i]);
        }
    }
}

fn picture(formula: &Formula, backend: &impl Backend, size: Size, samples: u32) -> (Image, Stats) {
    let arena = Arc::new(Arena::default());
    let settings = RenderSettings { size, samples, ..RenderSettings::default() };
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|error| panic!("{}", error.message));
    let mut renderer = Renderer::new(backend, &arena, &pipeline, &settings).unwrap();
    let image = renderer.render(&mut |_| true).unwrap().expect("nobody stops it");
    (image, renderer.stats)
}

fn row(image: &Image, y: u32) -> &[u8] {
    let width = image.size.width as usize * 3;
    &image.rgb[y as usize * width..][..width]
}

/// The area is 1.50659 (Munafo; Förstemann). What is so close to the set that no pixel could show it is drawn as set, which
/// adds a few hundredths, the boundary being of dimension 2; conjugates are alike.
#[test]
fn the_mandelbrot_sets_picture_has_its_area_and_symmetry() {
    let formula = Formula::builtin("mandelbrot").unwrap();
    let size = Size { width: 300, height: 200 };
    for precision in [Precision::F64, Precision::F32] {
        let (image, stats) = picture(&formula, &Cpu::new(precision), size, 1);
        let pixel = 2.6 / 200.0;
        let area = stats.hits as f64 * pixel * pixel;
        assert!((1.50..1.60).contains(&area), "{area}");
        assert_eq!((stats.rays, stats.estimates, stats.nan, stats.shadow_estimates), (60_000, 60_000, 0, 0));
        let different = (0..100).filter(|&y| row(&image, y) != row(&image, 199 - y)).count();
        assert_eq!(different, 0, "rows differ from their mirror images");
    }
}

/// The segment from -2 to 2 has no inside, and is drawn about a pixel wide at any scale.
#[test]
fn what_is_thinner_than_a_pixel_is_a_line() {
    for height in [2.0, 0.02, 0.0002] {
        let formula = julia([-2.0, 0.0], &format!("plane: (center: (0.3, 0.0), height: {height})"));
        let (image, stats) = picture(&formula, &Cpu::new(Precision::F64), Size { width: 41, height: 41 }, 1);
        let light = |y: u32| row(&image, y)[20 * 3..][..3].iter().map(|&byte| u32::from(byte)).sum::<u32>();
        assert!(stats.hits <= 41, "{} hits", stats.hits);
        let [on, beside, third] = [20, 21, 23].map(light);
        assert!(on + 120 < beside && beside + 50 < third, "height {height}: {on} {beside} {third}");
        assert!(light(17).abs_diff(third) <= 3, "both sides are alike");
    }
}

/// The share of bytes that are more than 16 apart.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 16).count() as f64 / a.len() as f64
}

#[test]
fn precisions_agree() {
    let size = Size { width: 160, height: 90 };
    for name in ["mandelbrot", "julia_set", "burning_ship"] {
        let formula = Formula::builtin(name).unwrap();
        let [a, b] = [Precision::F64, Precision::F32].map(|p| picture(&formula, &Cpu::new(p), size, 2).0);
        let share = difference(&a.rgb, &b.rgb);
        assert!(share < 0.005, "{name}: {share}");
    }
}

#[test]
fn the_gpu_draws_the_same() {
    let folder = folder();
    let slice = "plane=(height: 2.6, right: (1, 1, 0), up: (0, 0, 1))";
    for (name, set) in [("mandelbrot", "power=2"), ("burning_ship", "power=2"), ("mandelbulb", slice)] {
        let render = |backend: &str| {
            let output = format!("{backend}.png");
            let common = ["render", name, "--set", set, "--size", "120x80", "--calibrate", "off", "--quiet", "--force"];
            bulbfold(folder.path(), [&common[..], &["--backend", backend, "-o", &output]].concat())
        };
        let tried = render("gpu");
        if !tried.status.success() {
            assert!(std::env::var("BULBFOLD_REQUIRE_GPU").map_or(true, |v| v != "1"), "{}", stderr(&tried));
            return;
        }
        assert!(render("cpu").status.success());
        let share = difference(&pixels(&folder.path().join("gpu.png")), &pixels(&folder.path().join("cpu.png")));
        assert!(share < 0.005, "{name}: {share}");
    }
}

/// A solid's cut: the ball of radius 1 in the plane z = 0.6 is a disc of radius 0.8.
#[test]
fn planes_cut_solids() {
    let text = r#"(nodes: { "ball": Sphere(centre: (0, 0, 0), radius: 1) }, output: "ball", bounding_radius: 1.5,
        plane: (center: (0.5, 0.0, 0.6), height: 2.0))"#;
    let formula = Formula::from_ron(text).unwrap_or_else(|error| panic!("{error}"));
    let size = Size { width: 200, height: 200 };
    let (_, stats) = picture(&formula, &Cpu::new(Precision::F64), size, 1);
    // The picture reaches from x = -0.5 on: all of the disc but a segment of half angle acos(0.5 / 0.8).
    let half = (0.5_f64 / 0.8).acos();
    let expected = 0.64 * (std::f64::consts::PI - half + half.sin() * half.cos());
    let area = stats.hits as f64 * 1e-4;
    assert!((area - expected).abs() < 0.01, "{area}, not {expected}");
    // What holds along rays gives way to what holds all around.
    let folder = folder();
    for (asked, taken) in [("directional", "jacobian"), ("certified", "gradient")] {
        let common = ["render", "mandelbulb", "--set", "plane=(height: 2.6)", "--size", "24x16", "--stats", "--force"];
        let output = bulbfold(folder.path(), [&common[..], &["--backend", "cpu", "--de", asked]].concat());
        let told = format!("{taken}, logarithmic: for `{asked}`");
        assert!(output.status.success() && stderr(&output).contains(&told), "{}", stderr(&output));
    }
}

#[test]
fn precision_follows_the_pixels_size() {
    let folder = folder();
    let render = |height: &str| {
        let set = format!("height={height}");
        let common = ["render", "mandelbrot", "--backend", "cpu", "--size", "24x16", "--samples", "1", "--force"];
        let place = ["--set", "x=-0.75", "--set", "y=0.1", "--set", "max_iterations=50", "--set", &set];
        let output = bulbfold(folder.path(), [&common[..], &place[..]].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        stderr(&output)
    };
    assert!(!render("0.1").contains("too close"));
    assert!(render("1e-6").contains("the CPU takes it in f64"));
    assert!(render("1e-14").contains("too close for f64"));
}

#[test]
fn sweeps_zoom_with_the_kernels_of_the_first_frame() {
    let folder = folder();
    let common = ["render", "mandelbrot", "--backend", "cpu", "--size", "48x32", "--samples", "1", "--quiet"];
    let place = ["--set", "x=-1.7649", "--set", "max_iterations=200"];
    let sweep = ["--sweep", "height=0.5..0.1", "--frames", "3", "--json", "-o", "f%d.png"];
    let output = bulbfold(folder.path(), [&common[..], &place[..], &sweep[..]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((&report["frames"], &report["kernels_compiled"]), (&3.into(), &6.into()), "{report}");
    let own = ["--set", "height=0.3", "-o", "own.png"];
    assert!(bulbfold(folder.path(), [&common[..], &place[..], &own[..]].concat()).status.success());
    assert_eq!(pixels(&folder.path().join("f2.png")), pixels(&folder.path().join("own.png")));
}

#[test]
fn what_needs_rays_says_so() {
    let folder = folder();
    for (arguments, message) in [
        (vec!["truth", "mandelbrot"], "`truth` follows rays"),
        (vec!["audit", "mandelbrot"], "`audit` follows rays"),
        (vec!["calibrate", "mandelbrot"], "`calibrate` follows rays"),
        (vec!["chart", "mandelbrot", "-o", "c.svg"], "`chart` follows rays"),
        (vec!["render", "mandelbrot", "--view", "iterations"], "`--view` follows rays"),
        (vec!["render", "mandelbrot", "--fov", "30"], "which has no camera"),
        (vec!["render", "mandelbulb", "--set", "plane=(center: (0, 0))"], "a plane needs a `height`"),
        (vec!["render", "mandelbulb", "--set", "plane=(height: -1)"], "--set plane:1:10"),
        (vec!["render", "mandelbulb", "--set", "plane=(height: 1, up: (2, 0, 0))"], "lie on one line"),
    ] {
        let output = bulbfold(folder.path(), &arguments);
        assert!(
            output.status.code() == Some(2) && stderr(&output).contains(message),
            "{arguments:?}: {}",
            stderr(&output)
        );
    }
    let explained = bulbfold(folder.path(), ["explain", "mandelbrot"]);
    assert!(stdout(&explained).contains("Pictures show the points of a plane"));
    let list = bulbfold(folder.path(), ["list", "--dimension", "2"]);
    assert!(stdout(&list).contains("mandelbrot"));
}
