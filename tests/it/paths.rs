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

/// A request for so many paths a pixel.
pub fn paths(samples: u32) -> impl Fn(Request) -> Request {
    move |request| Request { path: Some(PathTracing { samples, ..PathTracing::default() }), ..request }
}

/// A ball of radius 1, seen from the front.
pub fn ball(scene: &str) -> String {
    format!(
        "(nodes: {{\"ball\": Sphere(centre: (0, 0, 0), radius: 1.0)}}, output: \"ball\", bounding_radius: 1.1,
          camera: (position: (0, -4, 0), fov: 30.0), {scene})"
    )
}

/// The mean of all channels.
pub fn mean(light: &[[f32; 3]]) -> f64 {
    light.iter().flatten().map(|x| f64::from(*x)).sum::<f64>() / (3 * light.len()) as f64
}

/// Under a sky of 1 what absorbs nothing is 1: nothing shows.
#[test]
fn white_matter_vanishes_in_a_white_room() {
    let white = "light: {}, environment: Uniform((1, 1, 1)), look: (palette: [(1, 1, 1)], material: MATERIAL)";
    for material in ["plain", "matte", "glass(tint: 1.0)"] {
        let scene = match material {
            "plain" => white.replace(", material: MATERIAL", ""),
            "matte" => white.replace("MATERIAL", "\"matte\""),
            _ => white.replace("MATERIAL", material),
        };
        let light = radiance(&ball(&scene), (24, 24), paths(64));
        let mean = mean(&light);
        assert!((mean - 1.0).abs() < 0.005, "{material}: {mean}");
    }
}

/// What a glass ball of index 1.5 in a room whose radiance is 1 + height shows along a ray, by Snell's law
/// and Fresnel's equations at each surface.
fn seen_in_glass(direction: [f64; 3], eye: [f64; 3]) -> f64 {
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let along = |a: [f64; 3], x: f64, b: [f64; 3], y: f64| [0, 1, 2].map(|k| a[k] * x + b[k] * y);
    let mirrored = |d: [f64; 3], n: [f64; 3]| along(d, 1.0, n, -2.0 * dot(d, n));
    // `n` against `d`, `ratio` of the index here to the one behind: the share that is reflected, and the direction behind.
    let behind = |d: [f64; 3], n: [f64; 3], ratio: f64| {
        let cosine = -dot(d, n);
        let out = (1.0 - ratio * ratio * (1.0 - cosine * cosine)).sqrt();
        let (s, p) = ((ratio * cosine - out) / (ratio * cosine + out), (ratio * out - cosine) / (ratio * out + cosine));
        ((s * s + p * p) / 2.0, along(d, ratio, n, ratio * cosine - out))
    };
    let room = |d: [f64; 3]| 1.0 + d[2];
    let middle = -dot(eye, direction);
    let square = dot(eye, eye) - middle * middle;
    if square >= 1.0 {
        return room(direction);
    }
    let mut point = along(eye, 1.0, direction, middle - (1.0 - square).sqrt());
    let (reflected, mut inner) = behind(direction, point, 1.0 / 1.5);
    let mut sum = reflected * room(mirrored(direction, point));
    let mut share = 1.0 - reflected;
    for _ in 0..8 {
        point = along(point, 1.0, inner, -2.0 * dot(point, inner));
        let inwards = point.map(|x| -x);
        let (reflected, out) = behind(inner, inwards, 1.5);
        sum += share * (1.0 - reflected) * room(out);
        share *= reflected;
        inner = mirrored(inner, inwards);
    }
    sum
}

/// A glass ball turns the room upside down.
#[test]
fn glass_bends_light_as_snell_and_fresnel_say() {
    let scene = ball(
        "light: {}, environment: Gradient(ground: (0, 0, 0), horizon: (1, 1, 1), zenith: (2, 2, 2)),
        look: (palette: [(1, 1, 1)], material: glass(tint: 1.0))",
    );
    let edge = 33;
    let light = radiance(&scene, (edge, edge), paths(512));
    let tangent = 15f64.to_radians().tan();
    let at = |k: u32| ((f64::from(k) + 0.5) / f64::from(edge) * 2.0 - 1.0) * tangent;
    let mut upside_down = 0;
    for (x, y) in [(16, 16), (16, 8), (16, 24), (10, 12), (22, 20), (16, 5), (16, 27)] {
        let (u, v) = (at(x), -at(y));
        let size = (1.0 + u * u + v * v).sqrt();
        let expected = seen_in_glass([u / size, 1.0 / size, v / size], [0.0, -4.0, 0.0]);
        let found = f64::from(light[(y * edge + x) as usize][0]);
        assert!((found - expected).abs() < 0.04, "{x} {y}: {found} {expected}");
        upside_down += usize::from((expected - 1.0) * v < -0.01);
    }
    assert!(upside_down >= 4, "{upside_down}");
}

/// What is left of white light behind a ball that bends nothing: the base colour to the power of the way inside over its depth.
#[test]
fn glass_is_darker_where_it_is_thicker() {
    let (base, depth) = ([0.5, 0.25, 0.8], 1.5);
    let scene = ball(&format!(
        "light: {{}}, environment: Uniform((1, 1, 1)), look: (palette: [(0.5, 0.25, 0.8)], material: glass(ior: 1.0, tint: 1.0, depth: {depth}))"
    ));
    let edge = 33;
    let light = radiance(&scene, (edge, edge), paths(256));
    let tangent = 15f64.to_radians().tan();
    let at = |k: u32| ((f64::from(k) + 0.5) / f64::from(edge) * 2.0 - 1.0) * tangent;
    for (x, y) in [(16, 16), (16, 9), (22, 20), (10, 12), (5, 16), (0, 0)] {
        let (u, v) = (at(x), at(y));
        // The square of the distance between the ray and the ball's middle, 4 units ahead.
        let square = 16.0 * (u * u + v * v) / (1.0 + u * u + v * v);
        let way = 2.0 * (1.0 - square).max(0.0).sqrt();
        for k in 0..3 {
            let expected: f64 = f64::powf(base[k], way / depth);
            let found = f64::from(light[(y * edge + x) as usize][k]);
            assert!((found - expected).abs() < 0.03, "{x} {y} {k}: {found} {expected}");
        }
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
    let room = "light: {}, environment: Gradient(ground: (0, 0, 0), horizon: (1, 1, 1), zenith: (2, 2, 2)),
        look: (palette: [(1, 1, 1)], material: glass(tint: 1.0))";
    let folder = folder_with(&[("glass.ron", &ball(room))]);
    for scene in ["mandelbulb", "glass.ron"] {
        let render = |backend: &str| {
            let out = format!("{scene}.{backend}.png");
            let arguments =
                ["render", scene, "--size", "80x60", "--paths", "8", "-q", "--backend", backend, "-o", &out];
            (bulbfold(folder.path(), arguments), folder.path().join(out))
        };
        let (on_cpu, cpu) = render("cpu");
        success(&on_cpu);
        let (on_gpu, gpu) = render("gpu");
        if !on_gpu.status.success() {
            assert!(std::env::var("BULBFOLD_REQUIRE_GPU").is_err(), "{}", stderr(&on_gpu));
            eprintln!("skipped: there is no GPU adapter");
            return;
        }
        let (cpu, gpu) = (pixels(&cpu), pixels(&gpu));
        let off = cpu.iter().zip(&gpu).filter(|(a, b)| a.abs_diff(**b) > 2).count();
        assert!(off * 500 <= cpu.len(), "{scene}: {off} of {} bytes differ", cpu.len());
    }
}

/// Filtered paths are nearer to the light than the paths themselves; all rows are those of the whole picture.
#[test]
fn filtered_noise_is_nearer_to_the_light() {
    let scene = "(nodes: {\"ball\": Sphere(centre: (0, 0, 0), radius: 1.0), \"floor\": Box(centre: (0, 0, -1.2), half_size: (4, 4, 0.2))},
        output: Union([\"ball\", \"floor\"]),
        bounding_radius: 7.0, camera: (position: (3, -5, 2.5), target: (0, 0, -0.4), fov: 40.0),
        light: {\"lamp\": Sphere(at: (-2, -2, 4), radius: 1.0, strength: 12.0)}, environment: Uniform((0.3, 0.35, 0.4)),
        look: (palette: [(0.8, 0.5, 0.3)]))";
    let size = (64, 48);
    let truth = radiance(scene, size, paths(1024));
    let noisy = radiance(scene, size, paths(2));
    let denoised = radiance(scene, size, |request| Request { denoise: true, ..paths(2)(request) });
    let off = |light: &[[f32; 3]]| {
        let squares = light.iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2));
        (squares.sum::<f64>() / (3 * light.len()) as f64).sqrt()
    };
    assert!(off(&denoised) < 0.7 * off(&noisy), "{} of {}", off(&denoised), off(&noisy));
    assert!((mean(&denoised) / mean(&truth) - 1.0).abs() < 0.03, "{} and {}", mean(&denoised), mean(&truth));
    let folder = folder_with(&[("scene.ron", scene)]);
    let arguments =
        ["render", "scene.ron", "--paths", "4", "--denoise", "--size", "48x32", "--backend", "cpu", "--quiet"];
    success(&bulbfold(folder.path(), [&arguments[..], &["-o", "a.png"]].concat()));
    success(&bulbfold(folder.path(), ["render", "a.png", "-o", "again.png", "--quiet"]));
    assert_eq!(
        pixels(&folder.path().join("a.png")),
        pixels(&folder.path().join("again.png")),
        "a picture knows its filter"
    );
    success(&bulbfold(folder.path(), [&arguments[..], &["--resume", "-o", "rows.png"]].concat()));
    assert_eq!(
        pixels(&folder.path().join("a.png")),
        pixels(&folder.path().join("rows.png")),
        "rows are those of the whole"
    );
}
