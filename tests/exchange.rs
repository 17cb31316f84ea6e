//! Work of other programs in, formulas out, as users see it: the built program in a fresh folder.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use bulbfold::check::Formula;
use bulbfold::graph::Method;

fn bulbfold(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bulbfold"));
    command.args(arguments).current_dir(folder).env("NO_COLOR", "1").env("BULBFOLD_CACHE", "").stdin(Stdio::null());
    command.output().expect("the program starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Imports a text under a name; returns the folder, the run and the name of the graph file.
fn import(name: &str, text: &str, arguments: &[&str]) -> (tempfile::TempDir, Output) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), text).unwrap();
    let mut all = vec!["import", name, "-o", "out.ron"];
    all.extend(arguments);
    let output = bulbfold(folder.path(), &all);
    (folder, output)
}

/// The formula that an import wrote.
fn imported(name: &str, text: &str, arguments: &[&str]) -> Formula {
    let (folder, output) = import(name, text, arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    Formula::open(folder.path().join("out.ron")).unwrap()
}

fn settings(main: &str, slots: &[&str]) -> String {
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
    let camera = formula.graph().camera.unwrap();
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
    assert_eq!(formula.graph().camera.unwrap().position, [1.5, -2.25, 0.125]);
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
    let output = bulbfold(folder.path(), &["test", "out.ron"]);
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
    let camera = legacy.graph().camera.unwrap();
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
    assert_eq!(objects.matches(r#", estimate: (method: "scalar", stop_at: 1.0)"#).count(), 2, "{objects}");
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

#[test]
fn broken_files_are_told_with_their_place() {
    let cases = [
        ("a.fract", "P6 3 4 255", "1:1", "this is not a settings file of Mandelbulber"),
        ("a.fract", "Mandelbulber 1.21;\npower 8;", "1:1", "open them in Mandelbulber 2"),
        ("a.fract", "# Mandelbulber settings file\n[main_parameters]\nfov;\n", "3:4", "`fov` has no value"),
        ("a.fract", "# Mandelbulber settings file\n[main_parameters]\nfov 1\n", "3:6", "does not end with `;`"),
        ("a.fract", "# Mandelbulber settings file\n[main_parameters]\nfov wide;\n", "3:5", "`fov` needs a number"),
        (
            "a.fract",
            "# Mandelbulber settings file\n[main_parameters]\nformula_1 4711;\n",
            "3:11",
            "formula number 4711",
        ),
        ("a.frag", "void main() {}", "1:1", "not a shader of Fragmentarium"),
        ("a.frag", "uniform float Secret; slider[0,1,2]\n", "1:1", "not among those that are known"),
        ("Mandelbulb.frag", "uniform float Power; slider[0,8]\n", "1:29", "`Power` has no default value"),
        (
            "Mandelbulb.frag",
            "uniform float Power; slider[0,8,16]\n#preset A\nPower =\n#endpreset\n",
            "3:1",
            "`Power` has no value",
        ),
        ("Mandelbulb.frag", "uniform float Power; slider[0,8,16]\n#preset A\nPower = 3\n", "2:1", "`A` does not end"),
    ];
    for (name, text, place, message) in cases {
        let (folder, output) = import(name, text, &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{text}\n{said}");
        assert!(said.contains(&format!("{name}:{place}")) && said.contains(message), "{text}\n{said}");
        assert!(!folder.path().join("out.ron").exists());
    }
    let (_folder, output) = import("a.txt", "", &[]);
    assert!(stderr(&output).contains("neither a .fract nor a .frag"), "{}", stderr(&output));
}

#[test]
fn values_that_steps_do_not_take_write_nothing() {
    let (folder, output) = import("box.fract", &settings("formula_1 8;", &["mandelbox_scale 1e5;"]), &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("values that the steps here do not take"), "{}", stderr(&output));
    assert!(!folder.path().join("out.ron").exists());
}

#[test]
fn nothing_is_overwritten_unless_forced() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.fract"), settings("formula_1 8;", &[""])).unwrap();
    let run = |arguments: &[&str]| bulbfold(folder.path(), arguments).status.code();
    assert_eq!(run(&["import", "a.fract"]), Some(0));
    assert_eq!(run(&["import", "a.fract"]), Some(2));
    assert_eq!(run(&["import", "a.fract", "--force"]), Some(0));
    let mut names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().map(|e| e.file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.fract", "a.ron"]);
}

const SHADER: &str = "\
#info A Mandelbox
#include \"DE-Raytracer.frag\"
#group Box
// Scale of the box.
uniform float Scale; slider[-3,3,5]
uniform float MinRad2;  slider[0,0.25,2]
uniform int Iterations; slider[0,13,50]
uniform vec3 Tint; slider[(0,0,0),(1,0.5,0),(1,1,1)]
float DE(vec3 p) { return length(p) - Scale; }
#preset Default
FOV = 0.5
Eye = 1,-2,3
Target = 0,0,0
Up = 0,0,1
Scale = 2
#endpreset
#preset Inside
Scale = -1.5
Iterations = 7
#endpreset
";

#[test]
fn a_preset_of_a_shader_is_chosen() {
    let formula = imported("anything.frag", SHADER, &[]);
    let value = |formula: &Formula, name: &str| formula.graph().params.iter().find(|p| p.name == name).unwrap().value;
    assert_eq!((value(&formula, "scale"), value(&formula, "min_radius")), (2.0, 0.5));
    let camera = formula.graph().camera.unwrap();
    assert_eq!((camera.position, camera.up), ([1.0, -2.0, 3.0], [0.0, 0.0, 1.0]));
    // The picture's height at distance 1 is 2 * 0.5.
    assert!(((camera.fov / 2.0).tan() - 0.5).abs() < 1e-9);
    let inside = imported("anything.frag", SHADER, &["--preset", "inside"]);
    assert_eq!((value(&inside, "scale"), inside.graph().orbit.max_iterations), (-1.5, 7));
    let (_folder, output) = import("anything.frag", SHADER, &["--preset", "Insides"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("did you mean `Inside`?"), "{}", stderr(&output));
    let (_folder, output) = import("anything.frag", SHADER, &[]);
    assert!(stderr(&output).contains("Tint = 1,0.5,0"), "{}", stderr(&output));
}

/// A compiler that may not be installed: with BULBFOLD_REQUIRE_COMPILERS it must be.
fn compiler(name: &str) -> bool {
    let found = Command::new(name).arg("--version").output().is_ok();
    let is_required = std::env::var_os("BULBFOLD_REQUIRE_COMPILERS").is_some_and(|value| !value.is_empty());
    assert!(found || !is_required, "{name} is not installed");
    if !found {
        eprintln!("skipped: {name} is not installed");
    }
    found
}

fn accepts(name: &str, arguments: &[&str], folder: &Path) {
    let output = Command::new(name).args(arguments).current_dir(folder).output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
    assert!(output.status.success(), "{name} {arguments:?}: {said}");
}

fn exported(folder: &Path, fractal: &str, target: &str, file: &str) -> Vec<u8> {
    let output = bulbfold(folder, &["export", fractal, "--to", target, "-o", file]);
    assert_eq!(output.status.code(), Some(0), "{fractal} {target}: {}", stderr(&output));
    std::fs::read(folder.join(file)).unwrap()
}

/// Fractals of every kind: powers, folds, turns, a shape's estimate, joined fields, a jump with finite differences.
const FRACTALS: &[&str] =
    &["mandelbulb", "mandelbox", "menger", "quaternion_julia", "icosahedron_kifs", "bulb_on_floor"];

#[test]
fn exported_shaders_compile() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (glslang, spirv_val) = (compiler("glslangValidator"), compiler("spirv-val"));
    for fractal in FRACTALS {
        let text = |target: &str| String::from_utf8(exported(folder, fractal, target, "out.txt")).unwrap();
        bulbfold::kernel::wgsl::validate(&text("wgsl")).unwrap();
        for target in ["hlsl", "msl"] {
            assert!(text(target).contains("float distance_estimate("), "{fractal} {target}");
        }
        let words = exported(folder, fractal, "spirv", "out.spv");
        assert_eq!(words[..4], [0x03, 0x02, 0x23, 0x07]);
        if spirv_val {
            accepts("spirv-val", &["out.spv"], folder);
        }
        let functions = text("glsl");
        let main = "in vec3 p;\nout vec4 o;\nvoid main() { o = vec4(distance_estimate(p)); }\n";
        std::fs::write(folder.join("glsl.frag"), format!("{ESSL}{functions}{main}")).unwrap();
        let toy = "uniform vec3 iResolution;\nout vec4 o;\n";
        let toy_main = "void main() { mainImage(o, gl_FragCoord.xy); }\n";
        std::fs::write(folder.join("toy.frag"), format!("{ESSL}{toy}{}{toy_main}", text("shadertoy"))).unwrap();
        // What Fragmentarium does with its own lines: includes are put in place, presets and groups taken out.
        let shader = text("fragmentarium");
        assert!(shader.contains("#include \"DE-Raytracer.frag\"") && shader.contains("#endpreset"));
        let code = without_fragmentarium(&shader);
        let main = "in vec3 p;\nout vec4 o;\nvoid main() { o = vec4(DE(p)); }\n";
        std::fs::write(folder.join("fragmentarium.frag"), format!("#version 330 compatibility\n{code}\n{main}"))
            .unwrap();
        if glslang {
            ["glsl.frag", "toy.frag", "fragmentarium.frag"]
                .iter()
                .for_each(|file| accepts("glslangValidator", &[file], folder));
        }
        std::fs::write(
            folder.join("out.hlsl"),
            text("hlsl") + "\nfloat4 main(float3 p : TEXCOORD0) : SV_Target { return distance_estimate(p); }\n",
        )
        .unwrap();
        if glslang {
            accepts(
                "glslangValidator",
                &["-D", "-S", "frag", "-e", "main", "-V", "-o", "hlsl.spv", "out.hlsl"],
                folder,
            );
        }
    }
}

#[test]
fn estimates_that_need_rays_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for method in ["directional", "certified"] {
        let output = bulbfold(folder.path(), &["export", "mandelbulb", "--to", "wgsl", "--de", method]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("needs the ray"), "{}", stderr(&output));
    }
    let output = bulbfold(folder.path(), &["export", "mandelbulb", "--to", "spirv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("write `-o NAME.spv`"), "{}", stderr(&output));
}

/// The first part of a shader for WebGL 2.
const ESSL: &str = "#version 300 es\nprecision highp float;\nprecision highp int;\n";

/// The values of a GLSL function `name` at points, by the GLSL compiler and the renderer behind this machine's EGL: a row of
/// pixels whose red, green and blue are the first 24 bits of each value. Nothing where they are not there and need not be.
fn run_glsl(functions: &str, name: &str, points: &[[f64; 3]]) -> Option<Vec<f64>> {
    let folder = tempfile::tempdir().unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/glsl/run.c");
    let mut cc = Command::new("cc");
    cc.current_dir(&folder).args(["-O1", "-o", "run"]).arg(source).args(["-lEGL", "-lGLESv2"]);
    let is_built = cc.output().is_ok_and(|output| output.status.success());
    let is_required = std::env::var_os("BULBFOLD_REQUIRE_COMPILERS").is_some_and(|value| !value.is_empty());
    assert!(is_built || !is_required, "scripts/glsl/run.c needs a C compiler and the headers of EGL and OpenGL ES");
    if !is_built {
        eprintln!("skipped: no C compiler, or no headers of EGL and OpenGL ES");
        return None;
    }
    let count = points.len();
    let listed: Vec<String> = points.iter().map(|[x, y, z]| format!("vec3({x:?}, {y:?}, {z:?})")).collect();
    let main = format!(
        "const vec3 points[{count}] = vec3[{count}]({});\nout vec4 colour;\nvoid main() {{\n\
         uint bits = floatBitsToUint({name}(points[int(gl_FragCoord.x)]));\n\
         colour = vec4(vec3(bits >> 24, (bits >> 16) & 255u, (bits >> 8) & 255u) / 255.0, 1.0);\n}}\n",
        listed.join(", ")
    );
    std::fs::write(folder.path().join("point.frag"), format!("{ESSL}{functions}{main}")).unwrap();
    let mut run = Command::new(folder.path().join("run"));
    run.current_dir(&folder).args(["1", &count.to_string(), "1", "out.ppm", "point.frag"]);
    let output = run.output().unwrap();
    let said = stderr(&output);
    if said.contains("EGL ") && !is_required {
        eprintln!("skipped: {said}");
        return None;
    }
    assert!(output.status.success(), "{said}");
    let picture = std::fs::read(folder.path().join("out.ppm")).unwrap();
    let pixels = &picture[picture.len() - 3 * count..];
    // The lowest byte is not there: half of it is the middle.
    let value = |pixel: &[u8]| f64::from(f32::from_bits(u32::from_be_bytes([pixel[0], pixel[1], pixel[2], 0x80])));
    Some(pixels.chunks(3).map(value).collect())
}

/// What GLSL shaders compute is what the library does, at points all over the bounding ball.
#[test]
fn exported_glsl_computes_our_own_distances() {
    let folder = tempfile::tempdir().unwrap();
    for (fractal, method) in [
        ("mandelbulb", "scalar"),
        ("mandelbulb", "gradient"),
        ("mandelbox", "scalar"),
        ("mandelbox", "delta"),
        ("menger", "scalar"),
        ("quaternion_julia", "combined"),
        ("icosahedron_kifs", "jacobian"),
        ("bulb_on_floor", "scalar"),
    ] {
        let formula = Formula::builtin(fractal).unwrap();
        let radius = formula.plan().bounding_radius;
        let points: Vec<[f64; 3]> =
            (0..300).map(|i| [7, 11, 17].map(|k| (f64::from((i * k) % 301) / 150.5 - 1.0) * 0.62 * radius)).collect();
        let method_of = Method::ALL.into_iter().find(|known| known.name() == method).unwrap();
        let expected: Vec<f64> =
            points.iter().map(|p| if formula.inside(*p) { 0.0 } else { formula.estimate(*p, method_of) }).collect();
        assert!(expected.iter().filter(|d| **d > 0.0).count() > 25, "{fractal}: a test of nothing");
        for target in ["glsl", "fragmentarium"] {
            let arguments = ["export", fractal, "--to", target, "--de", method, "--fudge", "1"];
            let output = bulbfold(folder.path(), &arguments);
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            let text = String::from_utf8(output.stdout).unwrap();
            let (functions, name) = match target {
                "glsl" => (text, "distance_estimate"),
                _ => (without_fragmentarium(&text), "DE"),
            };
            let Some(found) = run_glsl(&functions, name, &points) else { return };
            // In single precision an orbit at the border may take another turn.
            let near = |(found, expected): &(&f64, &f64)| (**found - **expected).abs() < 2e-4 + 0.01 * expected.abs();
            let far = found.iter().zip(&expected).filter(|pair| !near(pair)).count();
            let allowed = if method == "delta" { 9 } else { 3 };
            assert!(far <= allowed, "{fractal} {method} as {target}: {far} of {} points differ", points.len());
        }
    }
}

/// A shader for Fragmentarium without the lines that are its own: includes, groups, presets.
fn without_fragmentarium(shader: &str) -> String {
    let code = &shader[..shader.find("#preset").unwrap()];
    code.lines().filter(|line| !line.starts_with('#')).map(|line| format!("{line}\n")).collect()
}

/// The function that a file exports gives the library's own estimates: it is run as WGSL on the GPU back end.
#[cfg(feature = "gpu")]
#[test]
fn exported_distances_are_our_own() {
    let folder = tempfile::tempdir().unwrap();
    for (fractal, method) in [("mandelbulb", Method::Scalar), ("mandelbox", Method::Scalar), ("menger", Method::Scalar)]
    {
        let output =
            bulbfold(folder.path(), &["export", fractal, "--to", "wgsl", "--de", method.name(), "--fudge", "1"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let formula = Formula::builtin(fractal).unwrap();
        let radius = formula.graph().bounding_radius.unwrap_or(1.2);
        let points: Vec<[f64; 3]> =
            (0..60).map(|i| [7, 11, 17].map(|k| (f64::from((i * k) % 61) / 30.5 - 1.0) * 0.6 * radius)).collect();
        let Some(found) = gpu::run(&String::from_utf8(output.stdout).unwrap(), &points) else { return };
        for (p, found) in points.iter().zip(found) {
            let expected = if formula.inside(*p) { 0.0 } else { formula.estimate(*p, method) };
            assert!(
                (found - expected).abs() < 2e-4 + 0.02 * expected.abs(),
                "{fractal} at {p:?}: {found}, not {expected}"
            );
        }
    }
}

/// A compute shader around a function `distance_estimate`, on any adapter.
#[cfg(feature = "gpu")]
mod gpu {
    use wgpu::util::{BufferInitDescriptor, DeviceExt};

    const MAIN: &str = "
@group(0) @binding(0) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> distances: array<f32>;
@compute @workgroup_size(1)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    distances[id.x] = distance_estimate(points[id.x].xyz);
}
";

    /// Distances at points; nothing where there is no adapter and none is required.
    pub fn run(functions: &str, points: &[[f64; 3]]) -> Option<Vec<f64>> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let Some(adapter) = adapters.first() else {
            assert!(std::env::var_os("BULBFOLD_REQUIRE_GPU").is_none(), "there is no GPU adapter");
            eprintln!("skipped: there is no GPU adapter");
            return None;
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
        let source = wgpu::ShaderSource::Wgsl((functions.to_string() + MAIN).into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let bytes: Vec<u8> =
            points.iter().flat_map(|p| [p[0], p[1], p[2], 0.0]).flat_map(|x| (x as f32).to_le_bytes()).collect();
        let usage = wgpu::BufferUsages::STORAGE;
        let input = device.create_buffer_init(&BufferInitDescriptor { label: None, contents: &bytes, usage });
        let size = points.len() as u64 * 4;
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
        };
        let output = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let staging = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let entries = [&input, &output].map(|buffer| buffer.as_entire_binding());
        let entries: Vec<_> =
            (0u32..).zip(entries).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let layout = pipeline.get_bind_group_layout(0);
        let group =
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(points.len() as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&output, 0, &staging, 0, size);
        queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let view = staging.get_mapped_range(..).unwrap();
        Some(view.chunks(4).map(|word| f64::from(f32::from_le_bytes([word[0], word[1], word[2], word[3]]))).collect())
    }
}
