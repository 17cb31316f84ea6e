//! What views show without being told: the frame of what nobody framed, the iterations of close views, and a word where the camera
//! is in the set.

use std::path::Path;
use std::process::Output;

use bulbfold::check::Formula;
use bulbfold::compose::Composer;
use bulbfold::graph::{Camera, IterationLimit, ValidGraph};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::math::Precision;
use bulbfold::render::{Iterations, RenderSettings, Renderer, Standpoint, camera_of, compose_pipeline, standpoint};
use bulbfold::shade::Size;
use glam::DVec3;

use crate::support::{bulbfold, stderr};

const SIZE: Size = Size { width: 160, height: 90 };

fn run(arguments: &[&str]) -> Output {
    bulbfold(Path::new("."), arguments)
}

/// Angle that a ball fills of half the picture's height.
fn filled(camera: &Camera, middle: [f64; 3], radius: f64) -> f64 {
    let distance = (DVec3::from(camera.position) - DVec3::from(middle)).length();
    (radius / distance).asin() / (camera.fov / 2.0)
}

#[test]
fn frames_hold_what_is_there() {
    // A steep shape, a ball far from the origin, a small ball in a large stated one.
    let far = "(nodes: { \"a\": Sphere(centre: (40, 0, 0), radius: 2) }, output: \"a\")";
    let small = "(nodes: { \"a\": Sphere(radius: 0.5) }, output: \"a\", bounding_radius: 60)";
    let formulas = [
        (Formula::open("tests/it/reach/bumpy_ball.ron").unwrap(), [0.0; 3], 1.1),
        (Formula::from_ron(far).unwrap(), [40.0, 0.0, 0.0], 2.0),
        (Formula::from_ron(small).unwrap(), [0.0; 3], 0.5),
    ];
    for (formula, middle, radius) in formulas {
        let subject = formula.subject();
        let camera = camera_of(&subject.composer(), &subject.plan);
        let off = (DVec3::from(camera.target) - DVec3::from(middle)).length();
        assert!(off < radius, "{camera:?}");
        assert!(
            (0.6..1.05).contains(&filled(&camera, middle, radius)),
            "{}: {camera:?}",
            filled(&camera, middle, radius)
        );
    }
}

#[test]
fn a_camera_in_the_set_is_told_and_nothing_is_measured() {
    let folder = std::env::temp_dir().join(format!("bulbfold-inside-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let picture = folder.join("inside.png");
    let picture = picture.to_str().unwrap();
    let output =
        run(&["render", "tests/it/reach/inside.ron", "--size", "64x36", "--json", "-q", "--force", "-o", picture]);
    let told = stderr(&output);
    assert!(output.status.success(), "{told}");
    assert!(told.contains("inside the set") && told.contains("--camera="), "{told}");
    assert!(!told.contains("no estimate keeps"), "{told}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["calibration"]["rays"], 0, "{json}");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_way_out_is_free() {
    let formula = Formula::builtin("mandelbulb").unwrap();
    let subject = formula.subject();
    let camera = Camera::new([0.0, 0.1, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.6);
    let place = |camera: &Camera| standpoint(&subject.composer(), &subject.plan, camera).unwrap();
    let Standpoint::Inside(Some(out)) = place(&camera) else { panic!("{:?}", place(&camera)) };
    assert_eq!(place(&Camera { position: out, ..camera }), Standpoint::Free);
    assert!(out[0] < 0.0, "backwards from the target: {out:?}");
}

/// A graph as a camera sees it: the iterations of the view, and how much neighbouring pixels differ.
fn roughness(formula: &Formula, graph: &ValidGraph) -> f64 {
    let subject = formula.subject();
    let composer = Composer { graph, ..subject.composer() };
    let settings = RenderSettings { size: SIZE, precision: Precision::F64, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|error| panic!("{}", error.message));
    let cpu = Cpu::new(Precision::F64);
    let mut renderer = Renderer::new(&cpu, composer.arena, &pipeline, &settings).unwrap();
    let image = renderer.render(&mut |_| true).unwrap().unwrap();
    let gray: Vec<f64> = image.rgb.chunks(3).map(|c| c.iter().map(|x| f64::from(*x)).sum::<f64>() / 3.0).collect();
    gray.windows(2).map(|pair| (pair[0] - pair[1]).abs()).sum::<f64>() / gray.len() as f64
}

fn limits(graph: &ValidGraph) -> Vec<u32> {
    let mut all = Vec::new();
    let _ = graph.with_orbit_settings(|settings| all.push(settings.max_iterations));
    all
}

#[test]
fn close_views_of_built_ins_get_the_iterations_that_they_need() {
    let formula = Formula::builtin("mandelbulb").unwrap();
    let subject = formula.subject();
    let own = formula.graph().scene.camera.unwrap();
    let direction = (DVec3::from(own.target) - DVec3::from(own.position)).normalize();
    let depth = formula.ray(own.position, direction.to_array()).expect("the middle of the picture hits");
    let hit = DVec3::from(own.position) + direction * depth;
    let close = Camera { position: (hit - direction * (depth / 1000.0)).to_array(), target: hit.to_array(), ..own };
    let graph = formula.graph().clone().with_camera(close);
    let composer = Composer { graph: &graph, ..subject.composer() };
    // The file's own view keeps what the file states.
    assert_eq!(Iterations::of_view(&subject.composer(), &subject.plan, SIZE, true).unwrap(), None);
    let found =
        Iterations::of_view(&composer, &subject.plan, SIZE, false).unwrap().expect("the limit follows the view");
    let deep = found.apply(&graph);
    assert!(limits(&deep)[0] > limits(&graph)[0], "{:?} of {:?}", limits(&deep), limits(&graph));
    let (wall, detail) = (roughness(&formula, &graph), roughness(&formula, &deep));
    assert!(detail > 3.0 * wall, "neighbouring pixels differ by {detail:.2}, by {wall:.2} with the file's limit");
}

#[test]
fn limits_follow_the_view_unless_a_file_states_them() {
    let text = |limit: &str| {
        format!("(nodes: {{ \"b\": bulb_power(power: 8) }}, escape_radius: 4, {limit} bounding_radius: 1.5)")
    };
    let open = Formula::from_ron(&text("")).unwrap();
    let (subject, size) = (open.subject(), Size { width: 320, height: 180 });
    let of = |size: Size| {
        let found = Iterations::of_view(&subject.composer(), &subject.plan, size, true).unwrap().unwrap();
        limits(&found.apply(open.graph()))[0]
    };
    let (coarse, fine) = (of(size), of(Size { width: 320_000, height: 180_000 }));
    assert!((4..=20).contains(&coarse), "{coarse}");
    assert!(fine > coarse, "{fine} beside {coarse}");
    let stated = Formula::from_ron(&text("max_iterations: 5,")).unwrap();
    let subject = stated.subject();
    assert_eq!(Iterations::of_view(&subject.composer(), &subject.plan, size, false).unwrap(), None);
    // Stated on the command line it is stated, of built-in fractals too.
    let set = Formula::with("mandelbulb", &[("max_iterations", "5")]).unwrap();
    let _ = set.graph().with_orbit_settings(|settings| assert_eq!(settings.limit, IterationLimit::Stated));
}
