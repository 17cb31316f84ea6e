//! Lights, surroundings and air: pictures of shapes whose radiance is known.

use bulbfold::engine::{Engine, Request};
use bulbfold::render::{PathTracing, Sampling};
use bulbfold::shade::Size;

use crate::support::{bulbfold, folder_with, pixels, success};

/// The radiance of a picture of some text with one sample a pixel, from the top left.
fn radiance(text: &str, size: (u32, u32)) -> Vec<[f32; 3]> {
    radiance_with(text, size, |request| request)
}

fn radiance_with(text: &str, (width, height): (u32, u32), change: impl Fn(Request) -> Request) -> Vec<[f32; 3]> {
    let engine = Engine::new();
    let formula = engine.read("scene.ron", text, &[]).unwrap_or_else(|error| panic!("{error}"));
    let request = Request { size: Size { width, height }, samples: 1, sampling: Sampling::Full, ..Request::default() };
    let job = engine.settle(&formula, &change(request), &mut ()).unwrap();
    let mut light = bulbfold::film::Radiance::new(Size { width, height });
    engine.render(&job, job.rows(), &mut light, &mut ()).unwrap();
    light.rgb.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect()
}

/// A floor z = 0 seen straight from above, two units wide, of a white matte stuff.
fn floor(scene: &str) -> String {
    format!(
        "(nodes: {{\"floor\": Plane(normal: (0, 0, 1), offset: 0.0)}}, output: \"floor\", bounding_radius: 4.0,
          camera: (position: (0, 0, 3), target: (0, 0, 0), up: (0, 1, 0), fov: 36.87),
          look: (occlusion: 0.0, palette: [(1, 1, 1)]), {scene})"
    )
}

/// Where a pixel of a picture of [`floor`] lies on it.
fn place(i: usize, edge: usize) -> (f64, f64) {
    let at = |k: usize| ((k as f64 + 0.5) / edge as f64 - 0.5) * 2.0;
    (at(i % edge), -at(i / edge))
}

const DARK: &str = "environment: Uniform((0, 0, 0))";

#[test]
fn a_lamp_fades_with_the_square_of_the_distance() {
    let lamp = "light: {\"a\": Point(at: (0, 0, 1), strength: 2.0, shadows: false)}";
    let found = radiance(&floor(&format!("{lamp}, {DARK}")), (9, 9));
    // What the layer on top adds is the same function of directions for both.
    let sun = "light: {\"a\": Sun(direction: (0, 0, 1), strength: 1.0, shadows: false)}";
    let level = radiance(&floor(&format!("{sun}, {DARK}")), (9, 9));
    assert!((f64::from(found[40][0]) / f64::from(level[40][0]) - 2.0).abs() < 1e-3, "{:?} {:?}", found[40], level[40]);
    for i in [0, 4, 36, 80] {
        let (x, y) = place(i, 9);
        let square = x * x + y * y + 1.0;
        // Matte: cosine over square, within what the layer adds.
        let expected = 2.0 * square.powf(-1.5);
        assert!((f64::from(found[i][0]) / expected - 1.0).abs() < 0.2, "{i}: {:?} {expected}", found[i]);
    }
}

#[test]
fn a_spot_lights_its_cone_alone() {
    let spot = "light: {\"a\": Spot(at: (0, 0, 2), target: (0, 0, 0), cone: 40.0, soft: 0.0, strength: 4.0)}";
    let found = radiance(&floor(&format!("{spot}, {DARK}")), (41, 41));
    for (i, rgb) in found.iter().enumerate() {
        let (x, y) = place(i, 41);
        let radius = x.hypot(y);
        let edge = 2.0 * 20f64.to_radians().tan();
        if (radius - edge).abs() > 0.08 {
            assert_eq!(rgb[0] > 0.0, radius < edge, "{x} {y}: {rgb:?}");
        }
    }
}

#[test]
fn a_ball_throws_a_soft_shadow_whose_edge_grows_with_the_light() {
    let scene = |angle: f64| {
        format!(
            "(nodes: {{\"floor\": Plane(normal: (0, 0, 1), offset: 0.0), \"ball\": Sphere(centre: (-2, 0, 1.0), radius: 0.5)}},
              output: Union([\"floor\", \"ball\"]), bounding_radius: 5.0,
              camera: (position: (0, 0, 4), target: (0, 0, 0), up: (0, 1, 0), fov: 28.07),
              look: (occlusion: 0.0, palette: [(1, 1, 1)]), {DARK},
              light: {{\"sun\": Sun(direction: (-2, 0, 1), strength: 1.0, angle: {angle})}})"
        )
    };
    let partly = |angle: f64| {
        let found = radiance(&scene(angle), (64, 64));
        let open = radiance(&scene(angle).replace("angle:", "shadows: false, angle:"), (64, 64));
        let row = (0..64).map(|y| y * 64 + 32).map(|i| found[i][0] / open[i][0]);
        assert!(row.clone().any(|share| share < 0.01), "there is a core");
        row.filter(|share| (0.05..0.95).contains(share)).count()
    };
    let (sharp, soft, softer) = (partly(0.5), partly(8.0), partly(16.0));
    assert!(sharp <= 2 && soft > sharp && softer > soft, "{sharp} {soft} {softer}");
}

/// Where estimates have to be multiplied by a small number they do not say how near the surface is: the shadow of a bulb on a floor is as long
/// as paths of light find it.
#[test]
fn soft_shadows_are_those_of_paths_where_estimates_say_little() {
    let scene = format!(
        "(nodes: {{\"bulb\": bulb_power(power: 8.0), \"floor\": Plane(normal: (0, 0, 1), offset: -1.3)}}, output: Union([\"bulb\", \"floor\"]),
          escape_radius: 10.0, max_iterations: 8, bounding_radius: 6.0, estimate: (method: \"scalar\", fudge: 0.15),
          camera: (position: (4, 0, 2.7), target: (4, 0, -1.3), up: (0, 1, 0), fov: 40),
          look: (occlusion: 0.0, palette: [(1, 1, 1)]), {DARK},
          light: {{\"sun\": Sun(direction: (-2, 0, 1), strength: 1.0, angle: 6.0)}})"
    );
    let row = |light: &[[f32; 3]]| -> f32 { light[24 * 48..25 * 48].iter().map(|rgb| rgb[0]).sum() };
    let path = PathTracing { samples: 64, bounces: 1, ..PathTracing::default() };
    let truth = row(&radiance_with(&scene, (48, 48), |request| Request { path: Some(path), ..request }));
    let direct = row(&radiance(&scene, (48, 48)));
    // By how near the estimate says that rays pass, next to nothing was lit.
    assert!((direct / truth - 1.0).abs() < 0.15, "{direct} {truth}");
}

/// A steel floor under a black ball in a white room: where the mirrored ray meets the ball the floor is black, elsewhere it shows the room.
#[test]
fn a_floor_mirrors_what_stands_on_it() {
    let scene = "(nodes: {\"floor\": Plane(normal: (0, 0, 1), offset: 0.0), \"ball\": Sphere(centre: (0, 1.5, 1.2), radius: 0.8)},
        output: Union([\"floor\", \"ball\"]), bounding_radius: 8.0,
        camera: (position: (0, -4, 2), target: (0, 0, 0), fov: 40.0), light: {}, environment: Uniform((1, 1, 1)),
        look: (occlusion: 0.0, palette: [(0, 0, 0)], material: \"matte\", parts: {\"floor\": (material: polished_steel(roughness: 0.0))}))";
    let edge = 160;
    let with = |mirrors: u32| move |request: Request| Request { mirrors, ..request };
    let (shown, open) = (radiance_with(scene, (edge, edge), with(3)), radiance_with(scene, (edge, edge), with(0)));
    let (mut black, mut white) = (0, 0);
    for (i, (rgb, open)) in shown.iter().zip(&open).enumerate() {
        // The ray through the pixel, where it meets the floor, and how closely the mirrored one passes the ball.
        let tangent = 20f64.to_radians().tan();
        let at = |k: usize| ((k as f64 + 0.5) / f64::from(edge) * 2.0 - 1.0) * tangent;
        let (u, v) = (at(i % edge as usize), -at(i / edge as usize));
        let down = 1.0 / 20f64.sqrt();
        let along = [0.0, 4.0 * down, -2.0 * down];
        let up = [0.0, 2.0 * down, 4.0 * down];
        let direction = [u, along[1] + up[1] * v, along[2] + up[2] * v];
        let size = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        let direction = direction.map(|x| x / size);
        let passes = |from: [f64; 3], direction: [f64; 3]| {
            let off = [0.0 - from[0], 1.5 - from[1], 1.2 - from[2]];
            let middle = (0..3).map(|k| off[k] * direction[k]).sum::<f64>();
            let square = (0..3).map(|k| off[k] * off[k]).sum::<f64>() - middle * middle;
            if middle > 0.0 { square.max(0.0).sqrt() } else { f64::INFINITY }
        };
        let t = -2.0 / direction[2];
        let floor = [direction[0] * t, -4.0 + direction[1] * t, 0.0];
        if t <= 0.0 || floor[0].hypot(floor[1]) > 7.0 || passes([0.0, -4.0, 2.0], direction) < 0.85 {
            continue;
        }
        let mirrored = passes(floor, [direction[0], direction[1], -direction[2]]);
        if mirrored < 0.72 {
            assert!(rgb[0] < 1e-3, "{i}: {rgb:?}");
            black += 1;
        } else if mirrored > 0.88 {
            assert!((rgb[0] - open[0]).abs() < 1e-3 && rgb[0] > 0.5, "{i}: {rgb:?} {open:?}");
            white += 1;
        }
    }
    assert!(black > 500 && white > 5000, "{black} {white}");
}

/// Both back ends mirror the same, several times over.
#[test]
fn back_ends_mirror_alike() {
    let scene = "(objects: {\"floor\": (field: Plane(offset: -1.0), material: polished_steel(roughness: 0.0)),
        \"wall\": (field: Plane(normal: (0, -1, 0), offset: -1.5), material: polished_steel(roughness: 0.1)),
        \"bulb\": (fractal: \"mandelbulb\", material: \"lacquer\", palette: \"ember\")}, bounding_radius: 6.0,
        camera: (position: (1, -4, 1.5), target: (0, 0, -0.3), fov: 40.0), atmosphere: (fog: 0.4))";
    let folder = folder_with(&[("scene.ron", scene)]);
    let render = |backend: &str, mirrors: &str| {
        let out = format!("{backend}{mirrors}.png");
        let arguments =
            ["render", "scene.ron", "--size", "96x72", "-q", "--backend", backend, "--mirrors", mirrors, "-o", &out];
        (bulbfold(folder.path(), arguments), folder.path().join(out))
    };
    let (done, cpu) = render("cpu", "3");
    success(&done);
    let (done, once) = render("cpu", "1");
    success(&done);
    assert_ne!(pixels(&cpu), pixels(&once), "mirrors show mirrors");
    let (done, gpu) = render("gpu", "3");
    if !done.status.success() {
        assert!(std::env::var("BULBFOLD_REQUIRE_GPU").is_err(), "{}", crate::support::stderr(&done));
        eprintln!("skipped: there is no GPU adapter");
        return;
    }
    let (cpu, gpu) = (pixels(&cpu), pixels(&gpu));
    let off = cpu.iter().zip(&gpu).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    assert!(off * 200 <= cpu.len(), "{off} of {} bytes differ", cpu.len());
}

#[test]
fn light_of_a_look_stays_in_the_world_and_a_headlight_moves() {
    let ball = |scene: &str| {
        format!(
            "(nodes: {{\"ball\": Sphere(centre: (0, 0, 0), radius: 1.0)}}, output: \"ball\", bounding_radius: 1.1,
              camera: (position: (0, -4, 0), fov: 40.0), look: (occlusion: 0.0, sun_direction: (1, 0, 0.2), sky: (0, 0, 0)), {scene})"
        )
    };
    let turn = |request: Request| {
        let camera = bulbfold::engine::CameraChange { turn: Some(std::f64::consts::PI), ..Default::default() };
        Request { camera, ..request }
    };
    // From behind, the side that is lit is the other one.
    let sides = |light: &[[f32; 3]]| {
        let sum = |range: std::ops::Range<usize>| -> f32 { range.map(|x| light[16 * 33 + x][0]).sum() };
        sum(8..14) < sum(19..25)
    };
    let own = radiance(&ball(""), (33, 33));
    let behind = radiance_with(&ball(""), (33, 33), turn);
    assert!(sides(&own) && !sides(&behind));
    let lamp = "light: {\"head\": Headlight(strength: 9.0)}, environment: Uniform((0, 0, 0))";
    let (front, back) = (radiance(&ball(lamp), (33, 33)), radiance_with(&ball(lamp), (33, 33), turn));
    let middle = 16 * 33 + 16;
    assert!(front[middle][0] > 0.1 && (front[middle][0] / back[middle][0] - 1.0).abs() < 1e-3);
}

#[test]
fn a_white_sky_lights_all_sides_by_one() {
    let ball = "(nodes: {\"ball\": Sphere(centre: (0, 0, 0), radius: 1.0)}, output: \"ball\", bounding_radius: 1.1,
        camera: (position: (0, -4, 0), fov: 40.0), look: (occlusion: 0.0, palette: [(1, 1, 1)]), light: {},
        environment: Uniform((1, 1, 1)))";
    for rgb in radiance(ball, (21, 21)) {
        assert!(rgb.iter().all(|x| (x - 1.0).abs() < 2e-3), "{rgb:?}");
    }
}

/// Whatever the rays are marched by, corners are looked at by the same estimate. Proofs end rays a little deeper in rough places than
/// estimates do, which darkens them.
#[test]
fn corners_are_as_dark_with_every_estimate() {
    let estimates = [("scalar", 1.0), ("scalar", 0.5), ("scalar", 0.25), ("gradient", 0.5), ("certified-ball", 1.0)];
    let means = estimates.map(|(method, fudge)| {
        let text = format!(
            "(nodes: {{\"bulb\": bulb_power(power: 8.0)}}, output: \"bulb\", max_iterations: 6, escape_radius: 10.0,
            light: {{}}, environment: Uniform((1, 1, 1)), look: (occlusion: 1.0, palette: [(1, 1, 1)]),
            camera: (position: (1.55, -2.25, 1.25), fov: 30.0), estimate: (method: \"{method}\", fudge: {fudge}))"
        );
        let found = radiance(&text, (320, 240));
        let shown: Vec<f64> = found.iter().filter(|rgb| rgb[0] != 1.0).map(|rgb| f64::from(rgb[0])).collect();
        assert!(shown.len() > 20_000);
        shown.iter().sum::<f64>() / shown.len() as f64
    });
    assert!(means[0] > 0.2 && means[0] < 0.9, "{means:?}");
    means[..4].iter().for_each(|mean| assert!((mean / means[1] - 1.0).abs() < 0.01, "{means:?}"));
    assert!((means[4] / means[0] - 1.0).abs() < 0.1, "{means:?}");
}

#[test]
fn fog_on_the_ground_thins_with_height() {
    let wall = |fog: &str| {
        format!(
            "(nodes: {{\"wall\": Plane(normal: (0, -1, 0), offset: 0.0)}}, output: \"wall\", bounding_radius: 6.0,
              camera: (position: (0, -4, 2), target: (0, 0, 2), fov: 50.0), look: (occlusion: 0.0, palette: [(0, 0, 0)]),
              light: {{}}, environment: Uniform((0, 0, 0)), atmosphere: (fog: 3.0, fog_color: (1, 1, 1), {fog}))"
        )
    };
    let column = |text: &str| -> Vec<f32> { radiance(text, (1, 21)).iter().map(|rgb| rgb[0]).collect() };
    let even = column(&wall(""));
    // The share that a length of fog keeps; the layer of the wall reflects nothing of a black room.
    assert!((even[10] - (1.0 - (-3.0_f32 / 6.0 * 4.0).exp())).abs() < 0.01, "{}", even[10]);
    let ground = column(&wall("ground_fog: (base: 0.0, falloff: 0.7)"));
    assert!(ground.windows(2).all(|pair| pair[0] <= pair[1] + 1e-4), "thicker below: {ground:?}");
    assert!(ground[20] > 3.0 * ground[0]);
}

#[test]
fn a_glow_surrounds_what_rays_pass() {
    let ball = "(nodes: {\"ball\": Sphere(centre: (0, 0, 0), radius: 1.0)}, output: \"ball\", bounding_radius: 4.0,
        camera: (position: (0, -8, 0), fov: 40.0), look: (occlusion: 0.0), light: {}, environment: Uniform((0, 0, 0)),
        atmosphere: (glow: (color: (1, 1, 1), width: 0.03)))";
    let found = radiance(ball, (65, 65));
    let row: Vec<f32> = (0..32).map(|x| found[32 * 65 + x][0]).collect();
    let edge = (0..32).rev().find(|x| row[*x] > 0.5).expect("it glows beside the ball");
    assert!((0..edge).all(|x| row[x] <= row[x + 1] + 1e-3), "{row:?}");
    assert!(row[0] < 0.05 * row[edge]);
}

#[test]
fn messages_name_the_light_and_what_is_there() {
    for (scene, word) in [
        ("light: {\"a\": Sum(strength: 1.0)}", "Sun"),
        ("light: {\"a\": Point(strength: 1.0)}", "at: (0.0, -1.0, 2.0)"),
        ("environment: Gradiant(ground: (0, 0, 0))", "Gradient"),
        ("light: {\"a\": Sun(directon: (0, 0, 1))}", "direction"),
        ("scene: (look: ())", "given twice"),
    ] {
        let error = Engine::new().read("scene.ron", &floor(scene), &[]).err().expect("it is wrong").to_string();
        assert!(error.contains(word), "{scene}: {error}");
    }
}

/// A sun that nothing shows is told.
#[test]
fn a_look_whose_sun_is_replaced_is_told() {
    let text = floor("light: {\"a\": Point(at: (0, 0, 1))}").replace("look: (", "look: (sun: (1, 1, 1), ");
    let folder = folder_with(&[("scene.ron", &text)]);
    let output = bulbfold(folder.path(), ["render", "scene.ron", "--size", "8x8", "-q", "-o", "a.png"]);
    success(&output);
    assert!(crate::support::stderr(&output).contains("`look.sun` has no effect beside `light`"));
}

#[test]
fn a_part_of_a_light_can_be_set() {
    let text = floor(
        "light: {\"key\": Sun(direction: (0, 0, 1), strength: 1.0, shadows: false)}, environment: Uniform((0, 0, 0))",
    );
    let folder = folder_with(&[("scene.ron", &text)]);
    let run = |set: &[&str]| {
        let mut arguments =
            vec!["render", "scene.ron", "--size", "8x8", "--force", "-o", "a.png", "--calibrate", "off", "-q"];
        set.iter().for_each(|set| arguments.extend(["--set", set]));
        success(&bulbfold(folder.path(), arguments));
        pixels(&folder.path().join("a.png"))
    };
    assert_ne!(run(&[]), run(&["light.key.strength=0.5"]));
    assert_ne!(run(&[]), run(&["environment=Uniform((1, 0, 0))"]));
}
