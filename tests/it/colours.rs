//! Colours by part and by traps of a file's own: known values of traps, colours in pictures, and what is refused.

use std::sync::Arc;

use bulbfold::check::{Backends, Formula, Target};
use bulbfold::compose::{Composer, Purpose, choose, compose_estimator};
use bulbfold::expr::Arena;
use bulbfold::graph::EstimateSettings;
use bulbfold::graph::print::listing_with_look;
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Estimator, Kernel, wgsl};
use bulbfold::math::Precision;
use bulbfold::render::{RenderSettings, Renderer, compose_pipeline};
use bulbfold::shade::Size;

use crate::support::formula;

const SIZE: Size = Size { width: 96, height: 54 };

/// Pixels of a picture in sRGB.
fn picture(text: &str) -> Vec<[u8; 3]> {
    let formula = formula(text);
    let settings = RenderSettings { size: SIZE, samples: 1, ..RenderSettings::default() };
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|error| panic!("{}", error.message));
    for (name, kernel) in pipeline.kernels() {
        let text = wgsl::write(&arena, kernel);
        wgsl::validate(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
    let cpu = Cpu::new(Precision::F32);
    let mut renderer = Renderer::new(&cpu, &arena, &pipeline, &settings).unwrap();
    let image = renderer.render(&mut |_| true).unwrap().expect("nobody stops it");
    image.rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()
}

/// Red and blue pixels.
fn counts(pixels: &[[u8; 3]]) -> [usize; 2] {
    let is_most =
        |p: &[u8; 3], i: usize| p[i] > 40 && (0..3).all(|k| k == i || f64::from(p[i]) > 1.8 * f64::from(p[k]));
    [0, 2].map(|i| pixels.iter().filter(|p| is_most(p, i)).count())
}

const NODES: &str = r#""ball": Sphere(radius: 0.5), "cube": Box(centre: (1.5, 0.0, 0.0), half_size: (0.4, 0.4, 0.4))"#;
const CAMERA: &str = "camera: (position: (0.75, -5.0, 1.0), target: (0.75, 0.0, 0.0), fov: 40.0)";

#[test]
fn parts_of_a_union_have_colours_of_their_own() {
    let parts = r#"look: (parts: { "ball": (palette: [(1.0, 0.0, 0.0)]), "cube": (palette: [(0.0, 0.0, 1.0)]) })"#;
    for join in ["Union([\"ball\", \"cube\"])", "SmoothUnion(of: [\"ball\", \"cube\"], radius: 0.2)"] {
        let text = format!("(nodes: {{ {NODES}, \"both\": {join} }}, output: \"both\", {CAMERA}, {parts})");
        let [red, blue] = counts(&picture(&text));
        assert!(red > 50 && blue > 50, "{join}: {red} red and {blue} blue pixels");
    }
    let plain = format!("(nodes: {{ {NODES}, \"both\": Union([\"ball\", \"cube\"]) }}, output: \"both\", {CAMERA})");
    assert_eq!(counts(&picture(&plain)), [0, 0]);
    let text = format!("(nodes: {{ {NODES}, \"both\": Union([\"ball\", \"cube\"]) }}, output: \"both\", {parts})");
    let listing = listing_with_look(formula(&text).graph());
    assert!(listing.contains("part ball palette") && listing.contains("part cube palette"), "{listing}");
}

/// The innermost part decides, copies have the colour of what they are of, and a map stands for its orbit.
#[test]
fn the_innermost_part_decides() {
    let text = format!(
        r#"(nodes: {{ {NODES}, "bulb": quaternion_square(), "pair": Union(["ball", "cube"]),
            "set": Transform(of: "bulb", translate: (0.75, 0.0, 1.2), scale: 0.3), "all": Union(["pair", "set"]) }},
            output: "all", {CAMERA}, max_iterations: 8,
            look: (parts: {{ "pair": (palette: [(1.0, 0.0, 0.0)]), "ball": (palette: [(0.0, 0.0, 1.0)]), "bulb": (palette: [(1.0, 0.0, 0.0)]) }}))"#
    );
    let [red, blue] = counts(&picture(&text));
    let without = text.replace(r#", "bulb": (palette: [(1.0, 0.0, 0.0)])"#, "");
    let [less, same] = counts(&picture(&without));
    assert!(red > less + 20 && less > 50 && blue == same && blue > 50, "{red} {less} {blue} {same}");
}

#[test]
fn a_plane_shows_colours_of_parts() {
    let text = format!(
        r#"(nodes: {{ {NODES}, "both": Union(["ball", "cube"]) }}, output: "both", plane: (center: (0.75, 0.0, 0.0), height: 4.0),
            look: (background: [(0, 0, 0), (0, 0, 0)], parts: {{ "ball": (palette: [(1.0, 0.0, 0.0)]), "cube": (palette: [(0.0, 0.0, 1.0)]) }}))"#
    );
    let [red, blue] = counts(&picture(&text));
    assert!(red > 50 && blue > 50, "{red} red and {blue} blue pixels");
}

/// The traps of an orbit, as a surface has them: in f64, and on every other back end the same but for its rounding.
fn traps(text: &str, point: [f64; 3]) -> [f64; 4] {
    let formula = formula(text);
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let plan = choose(&composer, &EstimateSettings::default()).unwrap_or_else(|error| panic!("{}", error.message));
    let surface =
        compose_estimator(&composer, &plan.choices, Purpose::Surface).unwrap_or_else(|e| panic!("{}", e.message));
    let columns = Estimator::columns(&[point], &[[1.0, 0.0, 0.0]], &[1e-4], 0.0);
    let (backends, kernel) = (Backends::new(), Kernel::Estimate(surface));
    let on = |target| backends.run(target, &arena, &kernel, &columns).unwrap_or_else(|error| panic!("{error}"));
    let of = |columns: Vec<Vec<f64>>| [3, 4, 5, 6].map(|i| columns[i][0]);
    let exact = of(on(Target::CPU_F64));
    for target in backends.targets() {
        let found = of(on(target));
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-3 * b.abs().max(1.0);
        assert!(found.iter().zip(&exact).all(near), "{}: {found:?}, expected {exact:?}", target.name());
    }
    exact
}

#[test]
fn traps_are_the_least_distances_of_the_orbit() {
    let text = |traps: &str| {
        format!(
            r#"(nodes: {{ "a": quaternion_square() }}, output: "a", constant: Julia((-0.2, 0.4, -0.4)), escape_radius: 10.0,
                max_iterations: 12, look: (traps: [{traps}]))"#
        )
    };
    let point = [0.9, 0.6, 0.4];
    let mut orbit = Vec::new();
    let [mut x, mut y, mut z] = point;
    while x * x + y * y + z * z <= 100.0 {
        (x, y, z) = (x * x - y * y - z * z - 0.2, 2.0 * x * y + 0.4, 2.0 * x * z - 0.4);
        orbit.push([x, y, z]);
    }
    assert!(orbit.len() > 2 && orbit.len() < 12, "{}", orbit.len());
    let least = |distance: &dyn Fn(&[f64; 3]) -> f64| orbit.iter().map(distance).fold(1e6, f64::min);
    let found = traps(
        &text(
            "Point((0.5, 0, 0)), Line((0, 0, 1)), Circle(normal: (0, 0, 1), radius: 1.0), Plane(normal: (1, 0, 0), offset: 0.5)",
        ),
        point,
    );
    let expected = [
        least(&|p| (p[0] - 0.5).powi(2) + p[1] * p[1] + p[2] * p[2]),
        least(&|p| p[0] * p[0] + p[1] * p[1]),
        least(&|p| (p[0].hypot(p[1]) - 1.0).powi(2) + p[2] * p[2]),
        least(&|p| (p[0] - 0.5).abs()),
    ];
    for (found, expected) in found.into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9 * expected.max(1.0), "{found}, expected {expected}");
    }
    let [iterations, line, none, ..] = traps(&text("Iterations, Line(at: (1, 0, 0), along: (0, 2, 0))"), point);
    assert!((iterations - (1.0 - orbit.len() as f64 / 12.0)).abs() < 1e-12, "{iterations}");
    let expected = least(&|p| (p[0] - 1.0).powi(2) + p[2] * p[2]);
    assert!((line - expected).abs() < 1e-9 && none == 1e6, "{line}, expected {expected}; {none}");
}

/// Of a box fold that folds x back: from the positive side, the negative one, or not at all.
#[test]
fn the_last_fold_is_followed_through_sequences_and_choices() {
    let text = |loop_: &str| {
        format!(
            r#"(nodes: {{ "fold": box_fold(limit: 1.0), "grow": scale(scale: 2.0), "loop": {loop_} }}, output: "loop", constant: Off,
                escape_radius: 50.0, max_iterations: 3, look: (traps: [LastFold("x"), LastFold("y")]))"#
        )
    };
    let sequence = text(r#"Sequence(["fold", "grow"])"#);
    // x: 0.6 -> 1.2 -> 0.8 (from above) -> 1.6 -> 0.4 (from above); y: -0.3 -> -0.6 -> -1.2 -> -0.8 (from below).
    assert_eq!(traps(&sequence, [0.6, -0.3, 0.0])[..2], [0.0, 1.0]);
    assert_eq!(traps(&sequence, [-0.6, 0.1, 0.0])[..2], [1.0, 1e6], "no fold moves y");
    let chosen = text(r#"Sequence([Choose(when: Positive("y"), then: "fold"), "grow"])"#);
    assert_eq!(traps(&chosen, [0.6, 0.01, 0.0])[..2], [0.0, 1e6]);
    assert_eq!(traps(&chosen, [0.6, -0.01, 0.0])[..2], [1e6, 1e6], "nothing is folded where y is negative");
}

#[test]
fn moving_a_trap_changes_the_picture() {
    let text = |trap: &str| {
        format!(
            r#"(nodes: {{ "bulb": bulb_power(power: 8.0) }}, output: "bulb", escape_radius: 4.0, max_iterations: 8, look: (traps: [{trap}]))"#
        )
    };
    let all = "Point((0.5, 0.0, 0.0)), Line((0.0, 0.0, 1.0)), Iterations, LastFold(\"x\")";
    for (a, b) in
        [("Point((0.5, 0.0, 0.0))", "Point((1.1, 0.0, 0.0))"), ("Iterations", "Line((0, 0, 1))"), (all, "Iterations")]
    {
        let (a, b) = (picture(&text(a)), picture(&text(b)));
        let changed = a.iter().zip(&b).filter(|(a, b)| (0..3).any(|i| a[i].abs_diff(b[i]) > 4)).count();
        assert!(changed > 200, "{changed} pixels change");
    }
}

#[test]
fn traps_cost_nothing_when_off() {
    let kernel = |look: &str| {
        let formula =
            formula(&format!(r#"(nodes: {{ "bulb": bulb_power(power: 8.0) }}, output: "bulb", look: ({look}))"#));
        formula.wgsl()
    };
    let plain = kernel("");
    assert_eq!(
        plain,
        kernel(
            "traps: [Point((0, 0, 0)), Plane(normal: (1, 0, 0), offset: 0.0), Plane(normal: (0, 1, 0), offset: 0), Plane(offset: 0)]"
        )
    );
    assert!(!plain.contains("albedo"));
    // Occlusion off, and one colour: nothing of the traps is left.
    let flat = kernel("occlusion: 0.0, traps: [Point((0.5, 0, 0))], palette: [(0.8, 0.8, 0.8)]");
    assert!(!flat.contains("trap ="), "an orbit carries a trap that nothing shows");
}

#[test]
fn parts_and_traps_that_cannot_be_are_refused() {
    for (look, expected) in [
        (r#"parts: { "bal": (palette: [(1, 0, 0)]) }"#, "there is no node `bal`"),
        (r#"parts: { "other": (palette: [(1, 0, 0)]) }"#, "`other` is no part of the picture"),
        (r#"parts: { "ball": (colour: (1, 0, 0)) }"#, "colour"),
        (r#"parts: { "ball": (palette: []) }"#, "1 to 5 colours"),
        ("traps: []", "1 to 4 traps"),
        ("traps: [Iterations, Iterations, Iterations, Iterations, Iterations]", "1 to 4 traps"),
        ("traps: [Ball((0, 0, 0))]", "expected a trap"),
        ("traps: [Circle(normal: (0, 0, 1))]", "`radius` is missing"),
        ("traps: [LastFold(\"w\")]", "not a coordinate"),
    ] {
        let text = format!("(nodes: {{ {NODES}, \"other\": Torus() }}, output: \"ball\", look: ({look}))");
        let error = Formula::from_ron(&text).err().unwrap_or_else(|| panic!("{look} is taken")).to_string();
        assert!(error.contains(expected), "{look}: {error}");
    }
}
