//! Settings of Mandelbulber: formulas, hybrids, objects and what is listed as lost.

use super::{import, imported};

use crate::support::{bulbfold, stderr};

/// Settings of version 2.20 with sections for slots.
pub fn settings(main: &str, slots: &[&str]) -> String {
    let slots: Vec<String> = (1..).zip(slots).map(|(i, slot)| format!("[fractal_{i}]\n{slot}")).collect();
    format!(
        "# Mandelbulber settings file\n# version 2.20\n# only modified parameters\n[main_parameters]\n{main}\n{}\n",
        slots.join("\n")
    )
}

/// 6 on the diagonal folds to -4, is far from the ball, times 2 plus 6 is -2; a box of scale 2 holds its corner.
#[test]
fn a_mandelbox_has_its_scale_and_limits() {
    let text = settings(
        "formula_1 8;\nN 12;\ncamera 9 -18 9;\ntarget 0 0 0;\ncamera_top 0 0 1;\nfov 1;",
        &["mandelbox_scale 2;"],
    );
    let formula = imported("box.fract", &text, &[]);
    assert!(formula.inside([6.0, 6.0, 6.0]));
    assert!(!formula.inside([6.2, 0.0, 0.0]));
    let camera = formula.graph().scene.camera.unwrap();
    assert_eq!(camera.position, [9.0, -18.0, 9.0]);
    assert!((camera.fov.to_degrees() - 53.130102).abs() < 1e-5);
    assert_eq!(formula.graph().orbit.max_iterations, 12);
    assert_eq!(formula.graph().orbit.escape_radius, 100.0);
}

/// Settings list only what is not default, and the default power of a Mandelbulb is 9. Its orbit on the x axis is that of
/// r^9 + c, and the axis is no seam of the asin convention.
#[test]
fn defaults_are_the_programs_own() {
    let formula = imported("bulb.fract", &settings("N 8;", &[""]), &[]);
    let power = formula.graph().params.iter().find(|param| param.name == "power").unwrap().value;
    assert_eq!(power, 9.0);
    assert_eq!(formula.graph().orbit.escape_radius, 10.0);
    assert!(formula.inside([0.0, 0.0, 0.0]) && !formula.inside([1.3, 0.0, 0.0]));
}

#[test]
fn decimal_commas_are_points() {
    let text = settings("formula_1 2;\ncamera 1,5 -2,25 0,125;\nfov 0,5;", &["power 7,5;"]);
    let formula = imported("bulb.fract", &text, &[]);
    assert_eq!(formula.graph().params[0].value, 7.5);
    assert_eq!(formula.graph().scene.camera.unwrap().position, [1.5, -2.25, 0.125]);
}

#[test]
fn a_julia_constant_replaces_the_point() {
    let text = settings("formula_1 5;\njulia_mode true;\njulia_c -0.125 0 0.885;\nN 12;", &[""]);
    let formula = imported("quaternion.fract", &text, &[]);
    // The points that the repository's own quaternion Julia set knows to be inside and outside.
    assert!(formula.inside([-0.31, -0.42, 0.52]) && formula.inside([0.13, 0.18, -0.88]));
    assert!(!formula.inside([1.6, 0.0, 0.0]));
}

/// One iteration of a Mandelbox of scale -1.5, then one of a bulb of power 8: the numbers of `box_bulb`'s own tests.
#[test]
fn a_hybrid_takes_turns() {
    let main = "hybrid_fractal_enable true;\nformula_1 8;\nformula_2 2;\nN 4;";
    let (folder, output) = import("hybrid.fract", &settings(main, &["mandelbox_scale -1.5;", "power 8;"]), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let mut text = std::fs::read_to_string(folder.path().join("out.ron")).unwrap();
    assert!(text.contains(r#"Alternate([("mandelbox_1", 1), ("mandelbulb_2", 1)])"#), "{text}");
    let tests = "tests: [Orbit(point: (0.25, 0.0, 0.0), iterations: 1, expect: [-1.25, 0.0, 0.0]), Orbit(point: (0.25, 0.0, 0.0), iterations: 2, expect: [6.2104644775390625, 0.0, 0.0])]\n)";
    text.truncate(text.rfind(')').unwrap());
    std::fs::write(folder.path().join("out.ron"), text + tests).unwrap();
    let output = bulbfold(folder.path(), ["test", "out.ron"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

/// A formula that may run until iteration 2 only, and a weight, which also weakens the constant.
#[test]
fn ranges_and_weights_are_kept() {
    let main = "hybrid_fractal_enable true;\nformula_1 8;\nformula_stop_iteration_1 2;\nformula_2 2;\nformula_weight_2 0.25;\nN 8;";
    let (folder, output) = import("hybrid.fract", &settings(main, &["", ""]), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = std::fs::read_to_string(folder.path().join("out.ron")).unwrap();
    assert!(text.contains("weight: 0.25"), "{text}");
    assert!(text.contains("Mix(julia: (0.0, 0.0, 0.0), amount: 0.75)"), "{text}");
    assert!(text.contains(r#"Between(of: "mandelbox_1", from: 0, to: 1, otherwise: "#), "{text}");
}

/// A sponge of twice the size reaches to 2; cut with a ball of radius 1 around its corner.
#[test]
fn objects_are_placed_scaled_and_joined() {
    let main = "boolean_operators true;\nformula_1 7;\nformula_scale_1 2;\nN 6;\nprimitive_sphere_1_enabled true;\nprimitive_sphere_1_position 4 0 0;\nprimitive_sphere_1_radius 0.5;";
    let formula = imported("objects.fract", &settings(main, &[""]), &[]);
    assert!(formula.inside([2.0, 2.0, 2.0]) && !formula.inside([2.1, 2.0, 2.0]));
    assert!(formula.inside([4.4, 0.0, 0.0]) && !formula.inside([4.6, 0.0, 0.0]));
}

/// Old pictures stand in a mirror: what was at z is at -z, and so is the camera.
#[test]
fn legacy_pictures_are_mirrored_with_their_camera() {
    let main = "legacy_coordinate_system true;\nformula_1 2;\njulia_mode true;\njulia_c 0 0 0.3;\ncamera 0 -3 1;\ntarget 0 0 0.25;\ncamera_top 0 0 1;\nN 10;";
    let legacy = imported("old.fract", &settings(main, &["power 2;"]), &[]);
    let now =
        imported("new.fract", &settings(&main.replace("legacy_coordinate_system true;\n", ""), &["power 2;"]), &[]);
    let camera = legacy.graph().scene.camera.unwrap();
    assert_eq!((camera.position, camera.target, camera.up), ([0.0, -3.0, -1.0], [0.0, 0.0, -0.25], [0.0, 0.0, 1.0]));
    let mut seen = [0, 0];
    for i in 0..400 {
        let at = |k: u32| f64::from((i * k) % 37) / 18.5 - 1.0;
        let p = [at(7), at(11), at(17)];
        let inside = now.inside(p);
        assert_eq!(legacy.inside([p[0], p[1], -p[2]]), inside, "{p:?}");
        seen[usize::from(inside)] += 1;
    }
    assert!(seen.iter().all(|count| *count > 10), "{seen:?}");
}

fn written(main: &str, slots: &[&str]) -> String {
    let (folder, output) = import("some.fract", &settings(main, slots), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    std::fs::read_to_string(folder.path().join("out.ron")).unwrap()
}

/// One iteration of each, worked out by hand from the program's own maps, and the point added.
#[test]
fn formulas_have_the_programs_maps() {
    let [x, y, z] = [0.3f64, -0.4, 0.5];
    let r = (x * x + y * y + z * z).sqrt();
    let (polar, azimuth) = (4.0 * (y / r).acos(), 3.0 * x.atan2(z));
    let iq = [polar.sin() * azimuth.sin(), polar.cos(), polar.sin() * azimuth.cos()].map(|part| part * r.powi(4));
    let cases: [(&str, &str, [f64; 3]); 6] = [
        ("formula_1 48;", "", [x * x - 2.0 * y * z, z * z + 2.0 * x * y, y * y + 2.0 * x * z]),
        ("formula_1 49;", "", [x * x - 2.0 * y * z, z * z + 2.0 * x * y, -y * y + 2.0 * x * z]),
        ("formula_1 50;", "", [x * x + 2.0 * y * z, -y * y - 2.0 * x * z, -z * z + 2.0 * x * y]),
        ("formula_1 83;", "transf_pwr_8 4;\ntransf_pwr_8a 3;", iq),
        // The two polar angles make half a turn, whatever they are.
        ("formula_1 800;", "", [0.0, 0.0, -r * r]),
        ("formula_1 4;", "", [x * x - y * y - z * z, 2.0 * x * y, 2.0 * x * z]),
    ];
    for (main, slot, image) in cases {
        let found = imported("one.fract", &settings(main, &[slot]), &[]).orbit([x, y, z], 1);
        for ((found, image), p) in found.iter().zip(image).zip([x, y, z]) {
            assert!((found - image - p).abs() < 1e-12, "{main} {found} {image}");
        }
    }
    // Inside the small ball all is 4 times as large, then twice; z becomes -2 z rho times 5.
    let formula = imported("one.fract", &settings("formula_1 16;", &[""]), &[]);
    let found = formula.orbit([0.25, 0.0, 0.25], 1);
    assert!((found[0] - 0.25).abs() < 1e-12 && found[1].abs() < 1e-12 && (found[2] + 39.75).abs() < 1e-12, "{found:?}");
}

/// Mandelbulber turns by `IFS_rotation` without a switch in files of its first versions.
#[test]
fn old_kaleidoscopes_turn_without_a_switch() {
    let slot = "IFS_abs_x true;\nIFS_rotation 45 0 0;";
    let text = settings("formula_1 10;", &[slot]);
    let turns = |text: &str| {
        let formula = imported("ifs.fract", text, &[]);
        // Mirrored to (1, 1, 0); without a turn about (1, 0, 0) the scaling by 2 about that makes (1, 2, 0) of it.
        let found = formula.orbit([-1.0, 1.0, 0.0], 1);
        (found[1] - 2.0).abs() > 0.1
    };
    assert!(!turns(&text));
    assert!(turns(&text.replace("# version 2.20", "# version 2.05")));
    assert!(!turns(
        &text.replace("# version 2.20", "# version 2.05").replace("45 0 0;", "45 0 0;\nIFS_rotation_enabled false;")
    ));
}

/// The program draws cylinders without caps without ends.
#[test]
fn open_cylinders_go_on() {
    let main = "formula_1 7;\nprimitive_cylinder_1_enabled true;\nprimitive_cylinder_1_radius 0.5;\nprimitive_cylinder_1_position 3 0 0;";
    let inside = |main: &str, z: f64| imported("some.fract", &settings(main, &[""]), &[]).inside([3.2, 0.0, z]);
    assert!(inside(main, 0.4) && !inside(main, 0.6));
    let open = format!("{main}\nprimitive_cylinder_1_caps false;");
    assert!(inside(&open, 0.6) && inside(&open, -20.0));
}

/// Hairs that are thinner than any number belong to what rays show that stop at an estimate.
#[test]
fn rays_stop_at_the_programs_own_estimate() {
    let bulb = written("formula_1 3;\ndetail_level 2;", &[""]);
    assert!(
        bulb.contains(r#"estimate: (method: "scalar", stop_at: 0.5)"#) && bulb.contains("bounding_radius: 2.0"),
        "{bulb}"
    );
    let objects = written("boolean_operators true;\nformula_1 7;\nformula_2 8;", &["", ""]);
    assert_eq!(objects.matches("stop_at: 1.0").count(), 1, "a threshold is one of rays: {objects}");
    let hybrid = written("hybrid_fractal_enable true;\nformula_1 7;\nformula_2 8;", &["", ""]);
    assert!(hybrid.contains("estimate: (stop_at: 1.0)") && !hybrid.contains("bounding_radius"), "{hybrid}");
}

#[test]
fn what_is_not_carried_over_is_listed() {
    let text = settings(
        "formula_1 8;\nrepeat 4 0 0;\nvolumetric_fog_enabled true;",
        &["mandelbox_offset 1 0 0;\nIFS_scale 3;"],
    );
    let (_folder, output) = import("box.fract", &text, &[]);
    let said = stderr(&output);
    let (shape, rest) = said.split_once("not carried over: light").unwrap();
    assert!(shape.contains("repeat 4 0 0") && shape.contains("mandelbox_offset 1 0 0"), "{said}");
    let (look, unread) = rest.split_once("left out:").unwrap();
    assert!(look.contains("volumetric_fog_enabled true") && unread.contains("IFS_scale 3"), "{said}");
}
