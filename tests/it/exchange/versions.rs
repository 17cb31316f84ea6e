//! Settings of Mandelbulber are read by the version that they state.

use super::mandelbulber::settings;
use super::{import, imported};

use crate::support::{folder, stderr};

/// A file of `tests/exchange/cases`.
macro_rules! case {
    ($name:literal) => {
        include_str!(concat!("cases/", $name))
    };
}

/// Settings of another version than 2.20.
fn of_version(version: &str, main: &str, slots: &[&str]) -> String {
    settings(main, slots).replace("# version 2.20", &format!("# version {version}"))
}

fn said(name: &str, text: &str) -> (Option<i32>, String) {
    let (_folder, output) = import(name, text, &[]);
    (output.status.code(), stderr(&output))
}

#[test]
fn fields_of_view_are_degrees_since_2_21() {
    let fov = |text: &str| imported("view.fract", text, &[]).graph().scene.camera.unwrap().fov.to_degrees();
    assert!((fov(case!("fov28.fract")) - 30.0).abs() < 1e-9);
    assert!((fov(case!("fov62.fract")) - 61.93).abs() < 1e-9);
    for (version, stated, degrees) in
        [("2.20", "0.5", 28.0725), ("2.21", "28.0725", 28.0725), ("2.20", "53.13", 53.1301)]
    {
        let text = of_version(version, &format!("formula_1 2;\nfov {stated};"), &[""]);
        assert!((fov(&text) - degrees).abs() < 1e-3, "{version} {stated}");
    }
    // The default is the same view in both.
    assert!((fov(&of_version("2.20", "", &[""])) - fov(&of_version("2.30", "", &[""]))).abs() < 1e-9);
    // Fish eyes see more than a flat picture can show: the file is taken and the loss is listed.
    let (code, said) = said("wide.fract", &of_version("2.20", "perspective_type 1;\nfov 1;", &[""]));
    assert_eq!(code, Some(0), "{said}");
    let shape = said.split("not carried over: light").next().unwrap();
    assert!(shape.contains("fov 1") && shape.contains("perspective_type 1"), "{said}");
}

#[test]
fn trees_of_objects_are_read() {
    let formula = imported("tree.fract", case!("tree.fract"), &[]);
    let scale = formula.graph().params.iter().find(|param| param.name == "scale").unwrap().value;
    assert_eq!(scale, -1.5);
}

/// A box of turns without a ball; the tree's numbers stand in any of the forms that the program has written.
#[test]
fn trees_join_hybrids_and_primitives() {
    let main = "node_0001_definition boolean 1,1,11,0,100,0;\n\
        node_0002_definition hybrid 2,2,10,1,101,0;\n\
        node_0003_definition mandelbox 3,1,2,1,0;\n\
        node_0004_definition bulb,4,1,2,2;\n\
        node_0005_definition sphere 5,5,2,1,200,1;\n\
        node_0005_position 10 0 0;\n\
        primitive_sphere_1_object_id 200;\nprimitive_sphere_1_radius 0.5;\nN 4;";
    let slots = ["formula 8;\nmandelbox_scale -1.5;", "formula 2;\npower 8;"];
    let text = of_version("2.35", main, &slots);
    let formula = imported("scene.fract", &text, &[]);
    assert!(formula.inside([10.4, 0.0, 0.0]) && !formula.inside([10.6, 0.0, 0.0]));
    // One iteration of the box and one of the bulb: the numbers of `box_bulb`'s own tests.
    let alone = "node_0002_definition hybrid 2,2,10,0,101,0;\n\
        node_0003_definition mandelbox 3,3,1,2,1,0;\nnode_0004_definition bulb 4,4,1,2,2,1;\nN 4;";
    let formula = imported("hybrid.fract", &of_version("2.35", alone, &slots), &[]);
    assert!((formula.orbit([0.25, 0.0, 0.0], 1)[0] + 1.25).abs() < 1e-12);
    assert!((formula.orbit([0.25, 0.0, 0.0], 2)[0] - 6.2104644775390625).abs() < 1e-9);
    // The same formula twice, in two places.
    let twice = "node_0001_definition or 1,1,11,0,100,0;\n\
        node_0002_definition sponge 2,2,1,1,1,0;\nnode_0003_definition sponge 3,3,1,1,1,1;\nnode_0003_position 4 0 0;\nN 6;";
    let formula = imported("two.fract", &of_version("2.35", twice, &["formula 7;"]), &[]);
    assert!(formula.inside([1.0, 1.0, 1.0]) && formula.inside([5.0, 1.0, 1.0]) && !formula.inside([2.5, 0.9, 0.9]));
}

#[test]
fn broken_trees_are_told_with_their_place() {
    for (definition, message) in [
        ("mandelbox 1,1,7,0,1,0", "defines no object that this reader knows"),
        ("mandelbox", "defines no object that this reader knows"),
        ("ball 1,1,2,0,200,0", "a primitive that the file does not describe"),
    ] {
        let text = of_version("2.35", &format!("node_0001_definition {definition};"), &["formula 8;"]);
        let (code, said) = said("tree.fract", &text);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("tree.fract:5:") && said.contains(message), "{said}");
    }
}

#[test]
fn newer_versions_are_refused_with_their_line() {
    let (code, said) = said("scene.fract", case!("newer.fract"));
    assert_eq!(code, Some(2));
    let first = said.lines().next().unwrap();
    assert!(first.contains("version 3.10") && first.contains("newer") && said.contains("scene.fract:2:1"), "{said}");
}

#[test]
fn names_that_nobody_knows_stand_at_the_top() {
    let (code, said) =
        said("scene.fract", &of_version("2.33", "formula_1 2;\nglow_enabled true;\nsome_list boxes;", &[""]));
    assert_eq!(code, Some(0));
    assert!(
        said.starts_with("warning: not known to this reader") && said.lines().nth(1) == Some("  some_list boxes"),
        "{said}"
    );
}

#[test]
fn the_main_light_is_numbered_since_2_25() {
    let light = |text: &str| {
        let look = imported("light.fract", text, &[]).graph().scene.look.clone();
        (look.sun, look.sun_direction)
    };
    let (sun, direction) = light(case!("sun.fract"));
    assert!((sun[0] - 1.0).abs() < 0.02 && sun[1] < 0.3 && sun[2] < sun[1], "{sun:?}");
    // 60 degrees to the right of the camera and 30 above it: right, up and back.
    let [right, up, back] = direction;
    assert!((right - 0.75).abs() < 1e-3 && (up - 0.5).abs() < 1e-3 && (back - 0.433).abs() < 1e-3, "{direction:?}");
    // Old files say the same with other names.
    let new = "formula_1 2;\nlight1_is_defined true;\nlight1_rotation 20 -10 0;\nlight1_relative_position false;\nlight1_intensity 2;";
    let old = "formula_1 2;\nmain_light_alpha 20;\nmain_light_beta -10;\nmain_light_position_relative false;\nmain_light_intensity 2;";
    assert_eq!(light(&of_version("2.30", new, &[""])), light(&of_version("2.20", old, &[""])));
    let off = "formula_1 2;\nlight1_is_defined true;\nlight1_enabled false;";
    assert_eq!(light(&of_version("2.30", off, &[""])).0, [0.0; 3]);
}

#[test]
fn scripts_behind_values_are_listed() {
    let text = of_version("2.34", "formula_1 2;", &["power 5.5;5 + sin(t);"]);
    let (folder, output) = import("script.fract", &text, &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("power 5.5;5 + sin(t) (scripts are not run; the value is 5.5)"),
        "{}",
        stderr(&output)
    );
    let graph = std::fs::read_to_string(folder.path().join("out.ron")).unwrap();
    assert!(graph.contains("default: 5.5"), "{graph}");
}

#[test]
fn the_first_versions_have_one_factor_for_the_constant() {
    let (folder, output) =
        import("old.fract", &of_version("2.04", "formula_1 2;\nfractal_constant_factor 0.5;", &[""]), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let graph = std::fs::read_to_string(folder.path().join("out.ron")).unwrap();
    assert!(graph.contains("amount: 0.5"), "{graph}");
}

/// Latin-1, UTF-16 and files over 1 MiB are read; lines and sections that nothing reads may hold anything.
#[test]
fn unusual_files_are_read() {
    let text = of_version(
        "2.20",
        "formula_1 8;\nmat1_name caf\u{e9};\nfractal_enable_3",
        &["mandelbox_scale 2.5;", "%!", "IFS_scale"],
    );
    let scale = |bytes: &[u8]| {
        let folder = folder();
        std::fs::write(folder.path().join("a.fract"), bytes).unwrap();
        let output = super::bulbfold(folder.path(), ["import", "a.fract"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        std::fs::read_to_string(folder.path().join("a.ron")).unwrap().contains("default: 2.5")
    };
    assert!(scale(text.as_bytes()));
    assert!(scale(&text.chars().map(|c| c as u8).collect::<Vec<u8>>()));
    let utf16: Vec<u8> = std::iter::once(0xfeff).chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    assert!(scale(&utf16));
    assert!(scale(format!("{text}[frames]\n{}", "1;2;3;4;5;6;7;8\n".repeat(100_000)).as_bytes()));
}
