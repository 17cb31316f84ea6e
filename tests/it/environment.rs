//! Pictures of surroundings: what they light, where they are, and how they travel.

use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

use bulbfold::check::{Backends, Target};
use bulbfold::colour::Panorama;
use bulbfold::engine::{BackendChoice, Engine, Request};
use bulbfold::expr::{Arena, Function, Port, Table, Type};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Backend, Kernel};
use bulbfold::math::Precision;
use bulbfold::render::Sampling;
use bulbfold::shade::Size;

use crate::paths::{ball, mean, paths};
use crate::support::{bulbfold, folder, folder_with, pixels, stderr, success};

/// A Radiance HDR file of texels with a common exponent.
fn hdr(path: &Path, (width, height): (usize, usize), of: impl Fn(usize, usize) -> [u8; 4]) {
    let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes();
    (0..height).for_each(|y| (0..width).for_each(|x| bytes.extend(of(x, y))));
    std::fs::write(path, bytes).unwrap();
}

/// The texel whose parts are all 1.
const ONE: [u8; 4] = [128, 128, 128, 129];
/// The texel whose parts are all 2048.
const BRIGHT: [u8; 4] = [128, 128, 128, 140];

/// The radiance of a picture of some text that lies in a folder, from the top left.
fn radiance(folder: &Path, text: &str, edge: u32, change: impl Fn(Request) -> Request) -> Vec<[f32; 3]> {
    let engine = Engine::new();
    let name = folder.join("scene.ron");
    let formula = engine.read(&name.to_string_lossy(), text, &[]).unwrap_or_else(|error| panic!("{text}\n{error}"));
    let size = Size { width: edge, height: edge };
    let request =
        Request { size, samples: 1, sampling: Sampling::Full, backend: BackendChoice::Cpu, ..Request::default() };
    let job = engine.settle(&formula, &change(request), &mut ()).unwrap();
    let mut light = bulbfold::film::Radiance::new(size);
    engine.render(&job, job.rows(), &mut light, &mut ()).unwrap();
    light.rgb.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect()
}

fn direct(request: Request) -> Request {
    request
}

#[test]
fn a_white_picture_is_a_white_room() {
    let folder = folder();
    hdr(&folder.path().join("white.hdr"), (16, 8), |_, _| ONE);
    let scene = |environment: &str, material: &str| {
        ball(&format!(
            "light: {{}}, environment: {environment}, look: (palette: [(1, 1, 1)], occlusion: 0.0{material})"
        ))
    };
    let picture = "Picture(file: \"white.hdr\")";
    let [uniform, found] =
        ["Uniform((1, 1, 1))", picture].map(|environment| radiance(folder.path(), &scene(environment, ""), 24, direct));
    assert!(uniform.iter().flatten().zip(found.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-3));
    for material in ["", ", material: \"matte\"", ", material: glass(tint: 1.0)"] {
        let mean = mean(&radiance(folder.path(), &scene(picture, material), 24, paths(64)));
        assert!((mean - 1.0).abs() < 0.005, "{material}: {mean}");
    }
}

/// A picture that is black but for one texel lights a matte ball as a sun of its light does.
#[test]
fn one_bright_texel_is_a_sun() {
    let folder = folder();
    let (width, height) = (256, 128);
    let (x, y) = (90, 40);
    hdr(&folder.path().join("sun.hdr"), (width, height), |i, j| if (i, j) == (x, y) { BRIGHT } else { [0; 4] });
    let polar = (y as f64 + 0.5) / height as f64 * PI;
    let around = ((x as f64 + 0.5) / width as f64 - 0.5) * 2.0 * PI;
    let solid = PI / height as f64 * 2.0 * PI / width as f64 * polar.sin();
    let [sx, sy, sz] = [polar.sin() * around.sin(), polar.sin() * around.cos(), polar.cos()];
    let look = "look: (palette: [(0.6, 0.6, 0.6)], material: \"matte\", occlusion: 0.0)";
    // The sun stands behind the ball unless the camera does: it looks from where the light is.
    let turned = |scene: &str| ball(scene).replace("position: (0, -4, 0)", "position: (-4, 1, 1)");
    let picture = turned(&format!("light: {{}}, environment: Picture(file: \"sun.hdr\", strength: 2.0), {look}"));
    let strength = 2.0 * 2048.0 * solid / PI;
    let sun = turned(&format!(
        "light: {{\"a\": Sun(direction: ({sx}, {sy}, {sz}), strength: {strength}, angle: 1.0)}}, environment: Uniform((0, 0, 0)), {look}"
    ));
    let expected = radiance(folder.path(), &sun, 24, paths(64));
    let found = radiance(folder.path(), &picture, 24, paths(64));
    let (a, b) = (mean(&found), mean(&expected));
    assert!(b > 0.01 && (a / b - 1.0).abs() < 0.02, "{a} {b}");
    // Without samples towards the bright texel one path in 40 000 would find it.
    let few = mean(&radiance(folder.path(), &picture, 24, paths(4)));
    assert!((few / b - 1.0).abs() < 0.05, "{few} {b}");
    // Without paths the light of surroundings is as smooth as nine numbers can say.
    let smooth = mean(&radiance(folder.path(), &picture, 24, direct));
    assert!((smooth / b - 1.0).abs() < 0.2, "{smooth} {b}");
}

/// Where the camera sees a quarter of the picture that is white, by the turn.
#[test]
fn pictures_turn_around_z() {
    let folder = folder();
    hdr(&folder.path().join("quarter.hdr"), (64, 32), |x, _| if (24..40).contains(&x) { ONE } else { [0; 4] });
    let seen = |turn: f64, target: [f64; 3]| {
        let [x, y, z] = target;
        let text = format!(
            "(nodes: {{\"ball\": Sphere(centre: (0, 0, -50), radius: 1.0)}}, output: \"ball\", bounding_radius: 52.0,
              camera: (position: (0, 0, 0), target: ({x}, {y}, {z}), fov: 10.0), light: {{}}, look: (occlusion: 0.0),
              environment: Picture(file: \"quarter.hdr\", turn: {turn}))"
        );
        mean(&radiance(folder.path(), &text, 8, direct))
    };
    let [right, ahead, left, behind] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    for (turn, white) in [(0.0, ahead), (90.0, left), (180.0, behind), (-90.0, right), (450.0, left)] {
        for target in [right, ahead, left, behind] {
            let expected = if target == white { 1.0 } else { 0.0 };
            assert!((seen(turn, target) - expected).abs() < 1e-3, "{turn} {target:?}");
        }
    }
}

/// A sky that the program has painted itself is the sky, in every format that holds light.
#[test]
fn a_painted_sky_is_the_sky() {
    let scene = |environment: &str| {
        format!(
            "(nodes: {{\"ball\": Sphere(centre: (0, 2, 0), radius: 1.0)}}, output: \"ball\", bounding_radius: 3.1,
              camera: (position: (0, -2, 0.5), target: (0, 2, 0), fov: 40.0), light: {{}},
              look: (palette: [(0.7, 0.7, 0.7)], occlusion: 0.0), environment: {environment})"
        )
    };
    let sky = "Gradient(ground: (0.1, 0.2, 0.1), horizon: (0.7, 0.7, 0.6), zenith: (0.2, 0.3, 0.9))";
    let empty = format!(
        "(nodes: {{\"ball\": Sphere(centre: (0, 0, -500), radius: 0.01)}}, output: \"ball\", bounding_radius: 501.0,
          camera: (position: (0, 0, 0), target: (0, 1, 0), lens: Equirectangular), light: {{}}, environment: {sky})"
    );
    let folder = folder_with(&[("empty.ron", &empty)]);
    success(&bulbfold(
        folder.path(),
        ["render", "empty.ron", "-q", "--backend", "cpu", "--size", "128x64", "-o", "sky.exr", "-o", "sky.hdr"],
    ));
    for integrator in [None, Some(64)] {
        let light = |environment: &str| match integrator {
            None => radiance(folder.path(), &scene(environment), 32, direct),
            Some(samples) => radiance(folder.path(), &scene(environment), 32, paths(samples)),
        };
        let expected = light(sky);
        for file in ["sky.exr", "sky.hdr"] {
            let found = light(&format!("Picture(file: \"{file}\")"));
            let off: f64 =
                expected.iter().flatten().zip(found.iter().flatten()).map(|(a, b)| f64::from((a - b).abs())).sum();
            let off = off / (3 * found.len()) as f64;
            assert!(off < 0.015, "{file} {integrator:?}: {off}");
        }
    }
}

/// What an index finds, on every back end, with machine code and without.
#[test]
fn tables_are_looked_up_alike_everywhere() {
    let arena = Arena::default();
    let table = Arc::new(Table::new((0..1000).map(|i| (i * i) as f32).collect()));
    let other = Arc::new(Table::new(vec![-1.0, -2.0]));
    let index = arena.input(0, Type::F);
    let mut function = Function::new("find", vec![Port::new("index", Type::F)]);
    function.output("a", arena.look_up(&table, index));
    function.output("b", arena.look_up(&other, index) + arena.look_up(&table, index + 1.0));
    let indices: Vec<f64> = (-3..1005).map(|i| f64::from(i) + 0.25).collect();
    let kernel = Kernel::Map(function);
    let at = |i: f64| f64::from(table.at(i));
    let expected: Vec<Vec<f64>> = vec![
        indices.iter().map(|i| at(*i)).collect(),
        indices.iter().map(|i| f64::from(other.at(*i)) + at(i + 1.0)).collect(),
    ];
    let backends = Backends::new();
    if let Some(why) = backends.why_no_gpu() {
        assert!(std::env::var("BULBFOLD_REQUIRE_GPU").is_err(), "{why}");
        eprintln!("the GPU is left out: {why}");
    }
    for target in backends.targets() {
        assert_eq!(
            backends.run(target, &arena, &kernel, std::slice::from_ref(&indices)).unwrap(),
            expected,
            "{target:?}"
        );
    }
    for cpu in [Precision::F32, Precision::F64].map(|precision| Cpu::new(precision).interpreted()) {
        let prepared = cpu.prepare(&arena, &kernel).unwrap();
        let found = cpu.run(&prepared, &[&cpu.upload(std::slice::from_ref(&indices)).unwrap()]).unwrap();
        assert_eq!(cpu.download(&found).unwrap(), expected);
    }
    assert_eq!(arena.look_up(&table, arena.f(7.9)).as_constant().map(|c| c[0]), Some(49.0));
    assert_eq!(Target::CPU_F64, backends.targets()[0]);
}

#[test]
fn back_ends_see_the_same_surroundings() {
    let folder = folder();
    hdr(
        &folder.path().join("dots.hdr"),
        (64, 32),
        |x, y| if (x * 7 + y * 3) % 11 == 0 { [200, 90, 60, 131] } else { ONE },
    );
    let scene = ball(
        "light: {}, environment: Picture(file: \"dots.hdr\", turn: 25.0), look: (palette: [(0.8, 0.7, 0.6)], material: polished_steel())",
    );
    std::fs::write(folder.path().join("scene.ron"), scene).unwrap();
    for more in [&[][..], &["--paths", "8"]] {
        let render = |backend: &str| {
            let out = format!("{backend}{}.png", more.len());
            let arguments = ["render", "scene.ron", "-q", "--size", "80x60", "--backend", backend, "-o", &out];
            (bulbfold(folder.path(), [&arguments[..], more].concat()), folder.path().join(out))
        };
        let ((on_cpu, cpu), (on_gpu, gpu)) = (render("cpu"), render("gpu"));
        success(&on_cpu);
        if !on_gpu.status.success() {
            assert!(std::env::var("BULBFOLD_REQUIRE_GPU").is_err(), "{}", stderr(&on_gpu));
            eprintln!("skipped: there is no GPU adapter");
            return;
        }
        let (cpu, gpu) = (pixels(&cpu), pixels(&gpu));
        let off = cpu.iter().zip(&gpu).filter(|(a, b)| a.abs_diff(**b) > 2).count();
        assert!(off * 500 <= cpu.len(), "{more:?}: {off} of {} bytes differ", cpu.len());
    }
}

/// A picture file carries its surroundings: another machine, without the file, makes the same picture.
#[test]
fn pictures_carry_their_surroundings() {
    let scene = ball("light: {}, environment: Picture(file: \"dots.hdr\"), look: (palette: [(1, 1, 1)])");
    let here = folder_with(&[("scene.ron", &scene)]);
    hdr(&here.path().join("dots.hdr"), (64, 32), |x, y| [(x * 4) as u8 | 128, (y * 8) as u8, 90, 129]);
    let arguments = ["render", "scene.ron", "-q", "--backend", "cpu", "--size", "48x32"];
    success(&bulbfold(here.path(), [&arguments[..], &["-o", "a.png"]].concat()));
    let turned = ["--set", "environment.turn=90", "--set", "environment.strength=0.5", "-o", "turned.png"];
    success(&bulbfold(here.path(), [&arguments[..], &turned].concat()));
    assert!(pixels(&here.path().join("a.png")) != pixels(&here.path().join("turned.png")));
    // A picture that surrounds another formula lies in the current folder.
    let set = ["--set", "environment=Picture(file: \"dots.hdr\")", "-o", "bulb.png"];
    let bulb = ["render", "mandelbulb", "-q", "--backend", "cpu", "--size", "48x32"];
    success(&bulbfold(here.path(), [&bulb[..], &set].concat()));
    let there = folder();
    for name in ["a.png", "bulb.png"] {
        std::fs::copy(here.path().join(name), there.path().join(name)).unwrap();
        success(&bulbfold(there.path(), ["render", name, "-q", "-o", "again.png", "--force"]));
        assert!(
            std::fs::read(there.path().join("again.png")).unwrap() == std::fs::read(here.path().join(name)).unwrap()
        );
    }
    // Another picture under the same name is another job.
    hdr(&here.path().join("dots.hdr"), (64, 32), |_, _| ONE);
    success(&bulbfold(here.path(), [&arguments[..], &["-o", "other.png"]].concat()));
    assert!(pixels(&here.path().join("a.png")) != pixels(&here.path().join("other.png")));
}

#[test]
fn what_is_no_picture_is_told_with_its_place() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    hdr(&path("square.hdr"), (8, 8), |_, _| ONE);
    std::fs::write(path("text.hdr"), "not a picture").unwrap();
    std::fs::write(path("cut.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\nabc").unwrap();
    std::fs::write(path("large.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 40000\n").unwrap();
    for (environment, told) in [
        ("Picture(file: \"none.hdr\")", "none.hdr cannot be read"),
        ("Picture(file: \"text.hdr\")", "text.hdr is no picture"),
        ("Picture(file: \"cut.hdr\")", "cut.hdr cannot be read as a picture"),
        ("Picture(file: \"square.hdr\")", "8 by 8 pixels; surroundings are twice as wide"),
        ("Picture(file: \"large.hdr\")", "8192 by 4096 are the most"),
        ("Picture()", "expected an environment"),
        ("Picture(turn: 3)", "needs a file"),
        ("Picture(file: 3)", "needs a file"),
        ("Picture(file: \"square.hdr\", turned: 3)", "turned"),
        ("Picture(file: \"square.hdr\", strength: -1)", "strength"),
    ] {
        let scene = ball(&format!("look: (occlusion: 0.5),\n environment: {environment}"));
        std::fs::write(path("scene.ron"), scene).unwrap();
        let output = bulbfold(folder.path(), ["render", "scene.ron", "-q", "-o", "a.png"]);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{environment}: {text}");
        assert!(text.contains(told) && text.contains("scene.ron:3:"), "{environment}: {text}");
    }
    assert!(Panorama::decode(&[]).is_err());
}
