//! Scenes: whole formulas as objects, from files and built-in ones, with places and paints of their own.

use std::path::Path;

use bulbfold::check::Formula;
use bulbfold::formula::embedded;
use bulbfold::graph::NodeKind;

use crate::support::{bulbfold, folder_with, formula, pixels, stderr, success};

/// The estimate of an object is that of its formula, where it stands.
#[test]
fn objects_are_their_formulas_where_they_stand() {
    let scene = formula(
        "(objects: {\"a\": (fractal: \"menger\", at: (3, 0, 0), scale: 0.5), \"b\": (field: Sphere(radius: 0.5), at: (-3, 0, 0))})",
    );
    let menger = Formula::builtin("menger").unwrap();
    for p in [[0.2, 0.3, 0.9], [1.4, 0.1, 0.2], [0.0, -1.3, 0.4]] {
        let there = [3.0 + 0.5 * p[0], 0.5 * p[1], 0.5 * p[2]];
        assert_eq!(scene.inside(there), menger.inside(p), "{p:?}");
    }
    assert!((scene.chosen_estimate([-3.0, 0.0, 1.5]) - 1.0).abs() < 1e-6);
    assert!(scene.inside([-3.0, 0.0, 0.2]) && !scene.inside([0.0; 3]));
}

#[test]
fn values_and_presets_reach_the_objects_formula() {
    let power = |object: &str| {
        let scene = formula(&format!("(objects: {{\"a\": ({object})}})"));
        let step = scene.graph().nodes.iter().find(|node| matches!(node.kind, NodeKind::Step { .. }));
        format!(
            "{:?}",
            step.map(|node| if let NodeKind::Step { params, .. } = &node.kind { params.clone() } else { Vec::new() })
        )
    };
    let plain = power("fractal: \"mandelbulb\"");
    let five = power("fractal: \"mandelbulb\", set: {\"power\": 5.0}");
    assert!(plain.contains("8.0") && five.contains("5.0"), "{plain} {five}");
    assert_eq!(five, power("fractal: \"mandelbulb\", preset: \"five\""));
}

#[test]
fn files_are_found_beside_the_scene_and_set_from_the_command_line() {
    let folder = folder_with(&[
        (
            "scene.ron",
            "(objects: {\"a\": (fractal: \"inner.ron\", palette: [(0.9, 0.1, 0.1)])}, camera: (position: (0, -4, 0)))",
        ),
        (
            "inner.ron",
            "(params: {\"size\": (default: 0.5, min: 0.1, max: 2.0)}, nodes: {\"ball\": Sphere(radius: \"size\")}, output: \"ball\")",
        ),
    ]);
    let render = |set: &[&str]| {
        let mut arguments =
            vec!["render", "scene.ron", "--size", "32x24", "--calibrate", "off", "--force", "-q", "-o", "a.png"];
        set.iter().for_each(|set| arguments.extend(["--set", set]));
        success(&bulbfold(folder.path(), arguments));
        pixels(&folder.path().join("a.png"))
    };
    let (small, large) = (render(&[]), render(&["objects.a.set.size=1.2"]));
    let red = |pixels: &[u8]| pixels.chunks(3).filter(|rgb| u32::from(rgb[0]) > 2 * u32::from(rgb[2])).count();
    assert!(red(&large) > 2 * red(&small) && red(&small) > 20, "{} {}", red(&small), red(&large));
}

#[test]
fn what_is_wrong_with_an_object_is_told_with_its_place() {
    let folder = folder_with(&[
        ("loop.ron", "(objects: {\"a\": (fractal: \"loop.ron\")})"),
        ("name.ron", "(objects: {\"a\": (fractal: \"mandelbulp\")})"),
        ("both.ron", "(objects: {\"a\": (fractal: \"menger\", field: Sphere())})"),
        ("twice.ron", "(nodes: {\"a\": Sphere()}, objects: {\"a\": (field: Sphere())}, output: \"a\")"),
        ("param.ron", "(objects: {\"a\": (fractal: \"mandelbulb\", set: {\"pover\": 3.0})})"),
    ]);
    for (file, words) in [
        ("loop.ron", ["nested more than 4 deep", "loop.ron:1"]),
        ("name.ron", ["mandelbulb", "needed by the object `a`"]),
        ("both.ron", ["one fractal or one field", "both.ron:1"]),
        ("twice.ron", ["two nodes called `a`", "twice.ron:1"]),
        ("param.ron", ["power", "param.ron:1"]),
    ] {
        let output = bulbfold(folder.path(), ["render", file, "--size", "8x8"]);
        assert_eq!(output.status.code(), Some(2), "{file}: {}", stderr(&output));
        assert!(!stderr(&output).contains("which node is drawn"), "{file}: {}", stderr(&output));
        words.iter().for_each(|word| assert!(stderr(&output).contains(word), "{file}: {}", stderr(&output)));
    }
}

/// Every scene that is built in renders, and is explained by its first line.
#[test]
fn built_in_scenes_render() {
    let folder = folder_with(&[]);
    for (name, text) in embedded::SCENES {
        assert!(text.contains("summary:"), "{name} has no summary");
        let out = format!("{name}.png");
        success(&bulbfold(
            folder.path(),
            ["render", name, "--size", "48x27", "--samples", "1", "--calibrate", "off", "-q", "-o", &out],
        ));
        assert!(Path::new(&folder.path().join(&out)).exists());
    }
}
