//! Export to shader languages: compilers accept it, and it computes our own distances.

use std::path::Path;
use std::process::Command;

use bulbfold::check::Formula;
use bulbfold::graph::Method;

use crate::support::{bulbfold, folder, stderr, stdout};

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
    let said = format!("{}{}", stdout(&output), stderr(&output));
    assert!(output.status.success(), "{name} {arguments:?}: {said}");
}

fn exported(folder: &Path, fractal: &str, target: &str, file: &str) -> Vec<u8> {
    let output = bulbfold(folder, ["export", fractal, "--to", target, "-o", file]);
    assert_eq!(output.status.code(), Some(0), "{fractal} {target}: {}", stderr(&output));
    std::fs::read(folder.join(file)).unwrap()
}

/// Fractals of every kind: powers, folds, turns, a shape's estimate, joined fields, a jump with finite differences.
const FRACTALS: &[&str] =
    &["mandelbulb", "mandelbox", "menger", "quaternion_julia", "icosahedron_kifs", "bulb_on_floor"];

#[test]
fn exported_shaders_compile() {
    let folder = folder();
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
    let folder = folder();
    for method in ["directional", "certified"] {
        let output = bulbfold(folder.path(), ["export", "mandelbulb", "--to", "wgsl", "--de", method]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("needs the ray"), "{}", stderr(&output));
    }
    let output = bulbfold(folder.path(), ["export", "mandelbulb", "--to", "spirv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("write `-o NAME.spv`"), "{}", stderr(&output));
}

/// The first part of a shader for WebGL 2.
const ESSL: &str = "#version 300 es\nprecision highp float;\nprecision highp int;\n";

/// The values of a GLSL function `name` at points, by the GLSL compiler and the renderer behind this machine's EGL: a row of
/// pixels whose red, green and blue are the first 24 bits of each value. Nothing where they are not there and need not be.
fn run_glsl(functions: &str, name: &str, points: &[[f64; 3]]) -> Option<Vec<f64>> {
    let folder = folder();
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
    let folder = folder();
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
            let output = bulbfold(folder.path(), arguments);
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            let text = stdout(&output);
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
