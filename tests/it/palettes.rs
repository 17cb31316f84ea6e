//! Gradients: presets, expressions against data, files of other programs, and the even use of what a view shows.

use std::sync::Arc;

use bulbfold::check::{Backends, Target};
use bulbfold::colour::{Gradient, hex, palettes, random_gradient};
use bulbfold::compose::{Composer, choose, compose_tones};
use bulbfold::engine::{Engine, Job, Request};
use bulbfold::expr::{Arena, Inputs, Type};
use bulbfold::graph::EstimateSettings;
use bulbfold::kernel::records::Matter;
use bulbfold::kernel::{Estimator, Kernel};
use bulbfold::render::tones;
use bulbfold::shade::Size;

use crate::support::{bulbfold, folder_with, formula, pixels, stderr, stdout, success};

/// The palettes are found, not listed: as many as there are files, each readable and described, no two alike.
#[test]
fn every_palette_is_read() {
    let files = std::fs::read_dir("formulas/palettes").expect("the folder is there").count();
    let all = palettes::all();
    assert!(all.len() == files && files >= 40, "{} of {files}", all.len());
    for (i, palette) in all.iter().enumerate() {
        assert!(palette.summary.ends_with('.') && palette.gradient.stops().len() >= 3, "{}", palette.name);
        assert!(all[..i].iter().all(|other| other.gradient != palette.gradient), "{} is there twice", palette.name);
    }
    let listed = stdout(&bulbfold(".".as_ref(), ["list", "palettes"]));
    for palette in all {
        let line = listed.lines().find(|line| line.trim_start().starts_with(&format!("{} ", palette.name)));
        let line = line.unwrap_or_else(|| panic!("{} is not listed", palette.name));
        assert!(line.contains(&hex(palette.gradient.at(0.0))) && line.matches('#').count() == 5, "{line}");
    }
}

/// A gradient as an expression against the same as data.
fn compare(gradient: &Gradient, backends: &Backends, target: Target) {
    let places: Vec<f64> = (-20..=120).map(|i| f64::from(i) / 100.0 + 0.001).collect();
    let arena = Arc::new(Arena::default());
    let mut inputs = Inputs::new(&arena);
    let t = inputs.take("t", Type::F);
    let mut function = inputs.function("gradient");
    function.output("colour", gradient.compose(&arena, t));
    let found = backends.run(target, &arena, &Kernel::Map(function), std::slice::from_ref(&places));
    let found = found.unwrap_or_else(|error| panic!("{error}"));
    for (i, t) in places.iter().enumerate() {
        let expected = gradient.at(*t);
        let near = (0..3).all(|k| (found[k][i] - expected[k]).abs() < 2e-5);
        assert!(near, "{} at {t}: {:?}, expected {expected:?}", target.name(), [0, 1, 2].map(|k| found[k][i]));
    }
}

#[test]
fn gradients_are_the_same_on_every_back_end() {
    let backends = Backends::new();
    for palette in palettes::all() {
        compare(&palette.gradient, &backends, Target::CPU_F64);
    }
    for target in backends.targets() {
        for gradient in ["ember", "jewels"].map(|name| palettes::named(name).expect("a preset").gradient.clone()) {
            compare(&gradient, &backends, target);
        }
        compare(&random_gradient(5), &backends, target);
    }
}

const BALL: &str = r#"(nodes: { "ball": Sphere(radius: 1.0) }, output: "ball",
    camera: (position: (0.0, -60.0, 0.0), fov: 2.4),
    look: (colour: Gradient(palette: "graphite", by: Position((0, 0, 1)))))"#;

/// Of a ball that is seen from far away heights have the distribution of a disc's: a quarter lies below -0.404.
#[test]
fn quantiles_are_those_of_what_is_seen() {
    let formula = formula(BALL);
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let plan = choose(&composer, &EstimateSettings::default()).expect("it composes");
    let found = tones(&composer, &plan, Size { width: 640, height: 360 }).expect("it composes");
    assert_eq!(found.len(), 1);
    for (k, expected) in [(0, -1.0), (4, -0.404), (8, 0.0), (12, 0.404), (16, 1.0)] {
        assert!((found[0][k] - expected).abs() < 0.06, "{k}: {:?}", found[0]);
    }
}

/// A job carries what was found, so that another machine renders the same.
#[test]
fn jobs_carry_their_quantiles() {
    let engine = Engine::new();
    let formula = engine.read("ball.ron", BALL, &[]).unwrap_or_else(|error| panic!("{error}"));
    let request = Request { size: Size { width: 96, height: 54 }, ..Request::default() };
    let job = engine.settle(&formula, &request, &mut ()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(job.tones.len(), 1);
    assert_eq!(job.graph().scene.look.tones(), job.tones);
    let text = serde_json::to_string(&job).expect("a job is data");
    let read: Job = serde_json::from_str(&text).expect("and is read again");
    assert_eq!(read.graph().scene.look.tones(), job.tones);
}

/// The numbers that the layers of a look are placed by, at points: in f64, and on every other back end the same but for its rounding.
fn numbers(text: &str, points: &[[f64; 3]]) -> Vec<[f64; 6]> {
    let formula = formula(text);
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let plan = choose(&composer, &EstimateSettings::default()).unwrap_or_else(|error| panic!("{}", error.message));
    let surface = compose_tones(&composer, &plan.choices).unwrap_or_else(|error| panic!("{}", error.message));
    let columns = Estimator::columns(points, &[[1.0, 0.0, 0.0]], &[1e-4], 1e-4);
    let (backends, kernel) = (Backends::new(), Kernel::Estimate(surface));
    let on = |target| backends.run(target, &arena, &kernel, &columns).unwrap_or_else(|error| panic!("{error}"));
    let of = |columns: &[Vec<f64>], i: usize| {
        let (base, emission) = (Matter::COLUMNS.base, Matter::COLUMNS.emission);
        [base, base + 1, base + 2, emission, emission + 1, emission + 2].map(|column| columns[column][i])
    };
    let exact = on(Target::CPU_F64);
    for target in backends.targets() {
        let found = on(target);
        for i in 0..points.len() {
            let near = of(&found, i).iter().zip(of(&exact, i)).all(|(a, b)| (a - b).abs() <= 2e-3 * b.abs().max(1.0));
            assert!(near, "{}: {:?}, expected {:?}", target.name(), of(&found, i), of(&exact, i));
        }
    }
    (0..points.len()).map(|i| of(&exact, i)).collect()
}

fn layers(by: &[&str], traps: &str, nodes: &str) -> String {
    let layers: Vec<String> =
        by.iter().map(|by| format!("Gradient(palette: \"ember\", by: {by}, place: Value(0, 1))")).collect();
    format!(
        r#"(nodes: {{ "a": quaternion_square(){nodes} }}, output: "a", constant: Julia((-0.2, 0.4, -0.4)), escape_radius: 10.0,
            max_iterations: 12, look: (traps: [{traps}], colour: [{}]))"#,
        layers.join(", ")
    )
}

/// The points of the orbit that [`layers`] has, until it escapes.
fn orbit([mut x, mut y, mut z]: [f64; 3]) -> Vec<[f64; 3]> {
    let mut orbit = Vec::new();
    while x * x + y * y + z * z <= 100.0 && orbit.len() < 12 {
        (x, y, z) = (x * x - y * y - z * z - 0.2, 2.0 * x * y + 0.4, 2.0 * x * z - 0.4);
        orbit.push([x, y, z]);
    }
    orbit
}

#[test]
fn traps_are_spheres_boxes_and_fields_and_know_when_and_where() {
    let point = [0.9, 0.6, 0.4];
    let orbit = orbit(point);
    let length = |p: &[f64; 3]| p.iter().map(|x| x * x).sum::<f64>().sqrt();
    let least = |of: &dyn Fn(&[f64; 3]) -> f64| {
        let worth = orbit.iter().map(of).enumerate();
        worth.min_by(|a, b| a.1.total_cmp(&b.1)).expect("an orbit has points")
    };
    let in_box = |p: &[f64; 3]| {
        let q = p.map(|x| x.abs() - 0.5);
        let outside = q.map(|x| x.max(0.0)).iter().map(|x| x * x).sum::<f64>().sqrt();
        (outside + q[0].max(q[1]).max(q[2]).min(0.0)).abs()
    };
    let traps = "Sphere(radius: 1.3), Box(half_size: (0.5, 0.5, 0.5)), Field(\"ring\"), Line((0, 0, 1))";
    let nodes = r#", "ring": Torus(major: 1.0, minor: 0.25)"#;
    let by = ["Trap(0)", "Trap(1)", "Trap(2)", "Trap(3)", "Caught(1)", "Where(3)"];
    let found = numbers(&layers(&by, traps, nodes), &[point])[0];
    let in_ring = |p: &[f64; 3]| ((p[0].hypot(p[1]) - 1.0).hypot(p[2]) - 0.25).abs();
    let off_line = |p: &[f64; 3]| p[0].hypot(p[1]);
    let expected = [
        least(&|p| (length(p) - 1.3).abs()).1,
        least(&in_box).1,
        least(&in_ring).1,
        least(&off_line).1,
        least(&in_box).0 as f64 + 1.0,
        orbit[least(&off_line).0][2],
    ];
    for (i, (found, expected)) in found.into_iter().zip(expected).enumerate() {
        assert!((found - expected).abs() < 1e-9 * expected.abs().max(1.0), "{}: {found}, expected {expected}", by[i]);
    }
}

/// The smooth count lies between the whole ones, and goes on where they jump.
#[test]
fn the_smooth_count_has_no_steps() {
    let points: Vec<[f64; 3]> = (0..4000).map(|i| [0.7 + f64::from(i) * 2e-4, 0.5, 0.3]).collect();
    let found = numbers(&layers(&["Iterations", "Smooth", "Radius"], "Point((0, 0, 0))", ""), &points);
    let mut jumps = 0;
    for (pair, point) in found.windows(2).zip(&points) {
        jumps += usize::from(pair[0][0] != pair[1][0]);
        assert!((pair[0][1] - pair[1][1]).abs() < 0.05, "at {point:?}: {pair:?}");
        assert!(pair[0][1] <= pair[0][0] && pair[0][1] >= pair[0][0] - 1.0, "at {point:?}: {pair:?}");
    }
    assert!(jumps >= 2, "{jumps} steps of the whole count");
    let last = *orbit(points[0]).last().expect("it has points");
    let radius = last.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!((found[0][2] - radius).abs() < 1e-9 * radius, "{} {radius}", found[0][2]);
}

#[test]
fn palettes_of_the_command_line_colour_pictures() {
    let folder = folder_with(&[
        ("ball.ron", BALL),
        ("red.map", "255 0 0\n250 0 0\n"),
        ("own.ron", "(stops: [\"#0000ff\", \"#0000f0\"])"),
        ("bad.map", "0 0 0\n0 0 x\n"),
    ]);
    let render = |options: &[&str]| {
        let name = format!("{}.png", options.join("_").replace(['.', '-'], ""));
        let base =
            ["render", "ball.ron", "--size", "64x36", "--samples", "1", "--backend", "cpu", "--force", "-o", &name];
        success(&bulbfold(folder.path(), base.iter().chain(options)));
        pixels(&folder.path().join(&name))
    };
    let centre = |picture: &[u8]| [0, 1, 2].map(|k| picture[(18 * 64 + 32) * 3 + k]);
    let [r, g, b] = centre(&render(&["--palette", "red.map"]));
    assert!(r > 60 && g < r / 3 && b < r / 3, "{r} {g} {b}");
    let [r, g, b] = centre(&render(&["--palette", "own.ron"]));
    assert!(b > 60 && g < b / 2 && r < b / 2, "{r} {g} {b}");
    let first = render(&["--palette", "random", "--seed", "1"]);
    assert_eq!(first, render(&["--palette=random", "--seed=1"]));
    assert_ne!(first, render(&["--palette", "random", "--seed", "2"]));
    for (options, expected) in [
        (["--palette", "embre"], "did you mean `ember`?"),
        (["--palette", "bad.map"], "bad.map:2"),
        (["--palette", "none.map"], "there is no palette"),
    ] {
        let output = bulbfold(folder.path(), ["render", "ball.ron"].iter().chain(&options));
        assert_eq!(output.status.code(), Some(2), "{options:?}");
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
}

#[test]
fn layers_that_cannot_be_are_refused() {
    for (look, expected) in [
        ("palette: \"embre\"", "there is no palette `embre`"),
        ("palette: 3", "expected a palette"),
        ("colour: []", "1 to 6 layers"),
        ("colour: Gradient(by: Smooth)", "needs a `palette`"),
        ("colour: Gradient(palette: \"ember\", by: Trap(4))", "the value"),
        ("colour: Gradient(palette: \"ember\", by: Colour)", "cannot be placed by"),
        ("colour: Gradient(palette: \"ember\", place: Value(1, 1))", "two equal numbers"),
        ("colour: Gradient(palette: \"ember\", place: Even)", "expected a place"),
        ("colour: Gradient(palette: [\"#12\"])", "is not a colour"),
        ("colour: Gradient(palette: Stops(colours: [(\"#123456\", 2.0)]))", "from 0 to 1"),
        ("colour: Gradient(palette: \"ember\", blend: Over)", "not a way to blend"),
        ("colour: Gradient(palette: \"ember\", weight: 2.0)", "the value"),
        ("colour: Gradiant(palette: \"ember\")", "a layer such as"),
        ("traps: [Sphere(centre: (0, 0, 0))]", "`radius` is missing"),
        ("traps: [Box(centre: (0, 0, 0))]", "`half_size` is missing"),
        ("traps: [Field(\"loop\")]", "is a map"),
    ] {
        let text = format!("(nodes: {{ \"loop\": bulb_power() }}, output: \"loop\", look: ({look}))");
        let error = bulbfold::check::Formula::from_ron(&text).err().unwrap_or_else(|| panic!("{look} is taken"));
        assert!(error.to_string().contains(expected), "{look}: {error}");
    }
}
