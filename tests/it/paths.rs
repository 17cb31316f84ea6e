//! Paths of light: rooms and skies whose light is known, on both back ends.

use bulbfold::engine::{BackendChoice, Engine, Request};
use bulbfold::render::PathTracing;
use bulbfold::shade::Size;

use crate::support::{bulbfold, folder_with, pixels, stderr, success};

/// The radiance of a picture of some text, from the top left.
fn radiance(text: &str, (width, height): (u32, u32), change: impl Fn(Request) -> Request) -> Vec<[f32; 3]> {
    let engine = Engine::new();
    let formula = engine.read("scene.ron", text, &[]).unwrap_or_else(|error| panic!("{error}"));
    let size = Size { width, height };
    let request = change(Request { size, samples: 1, backend: BackendChoice::Cpu, ..Request::default() });
    let job = engine.settle(&formula, &request, &mut ()).unwrap();
    let mut light = bulbfold::film::Radiance::new(size);
    engine.render(&job, job.rows(), &mut light, &mut ()).unwrap();
    light.rgb.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect()
}

fn paths(samples: u32) -> impl Fn(Request) -> Request {
    move |request| Request { path: Some(PathTracing { samples, ..PathTracing::default() }), ..request }
}

fn ball(scene: &str) -> String {
    format!(
        "(nodes: {{\"ball\": Sphere(centre: (0, 0, 0), radius: 1.0)}}, output: \"ball\", bounding_radius: 1.1,
          camera: (position: (0, -4, 0), fov: 30.0), {scene})"
    )
}

fn mean(light: &[[f32; 3]]) -> f64 {
    light.iter().flatten().map(|x| f64::from(*x)).sum::<f64>() / (3 * light.len()) as f64
}

/// Under a sky of 1 what absorbs nothing is 1: nothing shows.
#[test]
fn white_matter_vanishes_in_a_white_room() {
    let white = "light: {}, environment: Uniform((1, 1, 1)), look: (palette: [(1, 1, 1)], material: MATERIAL)";
    for material in ["\"plain\"", "(\"matte\", roughness: 1.0)"] {
        let scene = match material {
            "\"plain\"" => white.replace(", material: MATERIAL", ""),
            _ => white.replace("MATERIAL", "\"matte\""),
        };
        let light = radiance(&ball(&scene), (24, 24), paths(64));
        let mean = mean(&light);
        assert!((mean - 1.0).abs() < 0.005, "{material}: {mean}");
    }
}

/// A ball under a sun, a lamp and an even sky: what `direct` sums up is what paths find.
#[test]
fn direct_and_path_agree_where_nothing_is_reflected_twice() {
    let scene = "look: (occlusion: 0.0, palette: [(0.5, 0.5, 0.5)]), environment: Uniform((0.3, 0.3, 0.3)),
        light: {\"sun\": Sun(direction: (0.3, -1, 0.8), strength: 1.5, angle: 1.0), \"lamp\": Point(at: (2, -3, 0), strength: 4.0)}";
    let direct = radiance(&ball(scene), (32, 32), |request| request);
    let traced = radiance(&ball(scene), (32, 32), paths(256));
    // The layer mirrors a sky of one colour alike in both.
    let (a, b) = (mean(&direct), mean(&traced));
    assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
    let middle = |light: &[[f32; 3]]| light[12 * 32 + 18][0];
    assert!((middle(&direct) / middle(&traced) - 1.0).abs() < 0.05, "{} {}", middle(&direct), middle(&traced));
}

/// A floor under a red wall is reddish where light comes back from it; without bounces it is not.
#[test]
fn walls_colour_what_is_near() {
    let scene = "(nodes: {\"floor\": Plane(normal: (0, 0, 1), offset: 0.0), \"wall\": Box(centre: (-1, 0, 1), half_size: (0.2, 2, 1))},
        output: Union([\"floor\", \"wall\"]), bounding_radius: 6.0,
        camera: (position: (0.5, 0, 3), target: (0.2, 0, 0), up: (0, 1, 0), fov: 25.0),
        look: (occlusion: 0.0, palette: [(0.8, 0.8, 0.8)], parts: {\"wall\": (palette: [(0.9, 0.05, 0.05)])}),
        environment: Uniform((0, 0, 0)), light: {\"sun\": Sun(direction: (1, 0, 1.5), strength: 2.0)})";
    let red = |bounces: u32| {
        let light = radiance(scene, (32, 32), |request| Request {
            path: Some(PathTracing { samples: 64, bounces, ..PathTracing::default() }),
            ..request
        });
        let column = (12..20).map(|y| light[y * 32 + 2]);
        let (r, g) = column.fold((0.0, 0.0), |(r, g), rgb| (r + rgb[0], g + rgb[1]));
        r / g
    };
    assert!((red(1) - 1.0).abs() < 1e-3, "{}", red(1));
    assert!(red(4) > 1.1, "{}", red(4));
}

/// What is out of focus is spread, what is in focus is not.
#[test]
fn an_open_lens_blurs_what_is_not_in_focus() {
    let scene = |focus: f64| {
        format!(
            "(nodes: {{\"ball\": Sphere(centre: (0, 0, 0), radius: 0.5)}}, output: \"ball\", bounding_radius: 0.6,
              camera: (position: (0, -4, 0), fov: 30.0, aperture: 0.2, focus: {focus}),
              light: {{}}, environment: Uniform((1, 1, 1)), look: (background: [(0, 0, 0), (0, 0, 0)], palette: [(1, 1, 1)]))"
        )
    };
    let partly = |focus: f64| {
        let light = radiance(&scene(focus), (64, 64), paths(64));
        (0..64).filter(|x| (0.05..0.95).contains(&light[32 * 64 + x][0])).count()
    };
    let (sharp, soft) = (partly(4.0), partly(1.5));
    assert!(sharp <= 6 && soft >= 2 * sharp.max(4), "{sharp} {soft}");
}

/// The same seed gives the same picture, another one another, and less noise is asked for by more samples.
#[test]
fn noise_falls_with_samples_and_the_seed_chooses_it() {
    let scene =
        ball("light: {\"lamp\": Sphere(at: (2, -2, 2), radius: 1.0, strength: 9.0)}, environment: Uniform((0, 0, 0))");
    let with = |samples: u32, seed: u32| {
        radiance(&scene, (24, 24), |request| Request {
            path: Some(PathTracing { samples, seed, ..PathTracing::default() }),
            ..request
        })
    };
    let difference = |a: &[[f32; 3]], b: &[[f32; 3]]| -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| f64::from((a - b) * (a - b))).sum()
    };
    let (few, again, other) = (with(4, 0), with(4, 0), with(4, 1));
    assert_eq!(few, again);
    let noise = difference(&few, &other);
    assert!(noise > 0.0);
    assert!(difference(&with(64, 0), &with(64, 1)) < noise / 8.0);
}

/// The same random numbers lead to the same paths: both back ends make the same picture but for rounding.
#[test]
fn back_ends_follow_the_same_paths() {
    let folder = folder_with(&[]);
    let render = |backend: &str| {
        let out = format!("{backend}.png");
        let arguments =
            ["render", "mandelbulb", "--size", "80x60", "--paths", "8", "-q", "--backend", backend, "-o", &out];
        bulbfold(folder.path(), arguments)
    };
    success(&render("cpu"));
    let on_gpu = render("gpu");
    if !on_gpu.status.success() {
        assert!(std::env::var("BULBFOLD_REQUIRE_GPU").is_err(), "{}", stderr(&on_gpu));
        eprintln!("skipped: there is no GPU adapter");
        return;
    }
    let [cpu, gpu] = ["cpu.png", "gpu.png"].map(|name| pixels(&folder.path().join(name)));
    let off = cpu.iter().zip(&gpu).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    assert!(off * 500 <= cpu.len(), "{off} of {} bytes differ", cpu.len());
}
