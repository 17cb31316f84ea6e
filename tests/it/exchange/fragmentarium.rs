//! Shaders of Fragmentarium.

use bulbfold::check::Formula;

use super::{import, imported};

use crate::support::stderr;

const SHADER: &str = "\
#info A box
#include \"DE-Raytracer.frag\"
#group Box
// Scale of the box.
uniform float Scale; slider[-3,3,5]
uniform float MinRad2;  slider[0,0.25,2]
uniform int Iterations; slider[0,13,50]
uniform vec3 Tint; slider[(0,0,0),(1,0.5,0),(1,1,1)]
float DE(vec3 p) {
    vec3 w = p;
    float stretch = 1.0;
    for (int n = 0; n < Iterations && dot(w, w) < 1e4; n++) {
        w = 2.0 * clamp(w, -1.0, 1.0) - w;
        float near = dot(w, w), grow = near < MinRad2 ? 1.0 / MinRad2 : (near < 1.0 ? 1.0 / near : 1.0);
        w = w * grow * Scale + p;
        stretch = stretch * grow * abs(Scale) + 1.0;
    }
    return length(w) / stretch;
}
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
    let camera = formula.graph().scene.camera.unwrap();
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

/// A shader around a loop over `z`, whose start is `p`.
fn shader(uniforms: &str, body: &str) -> String {
    format!(
        "#include \"MathUtils.frag\"\n{uniforms}\nuniform int Iterations; slider[0,9,40]\n\
         float DE(vec3 p) {{\n vec3 z = p; float d = 1.0; int i = 0;\n while (i < Iterations) {{\n\
         if (length(z) > 20.0) break;\n{body}\n i++; }}\n return 0.5 * length(z) / d;\n}}\n"
    )
}

/// Angles from the pole and from the plane; folds by comparisons; turns from the left and from the right.
const KNOWN: &[(&str, &str, &str)] = &[
    (
        "Mandelbulb",
        "uniform float Power; slider[2,8,16]",
        "float r = length(z), a = Power * atan(length(z.xy), z.z), b = Power * atan(z.y, z.x); d = d * Power * pow(r, Power - 1.0) + 1.0; z = pow(r, Power) * vec3(cos(b) * sin(a), sin(a) * sin(b), cos(a)) + p;",
    ),
    (
        "Mandelbulb alternate",
        "uniform float Power; slider[2,5.5,16]",
        "float r = length(z), a = Power * asin(z.z / r), b = Power * atan(z.y, z.x); d = d * Power * pow(r, Power - 1.0) + 1.0; z = pow(r, Power) * vec3(cos(a) * cos(b), cos(a) * sin(b), sin(a)); z += p;",
    ),
    (
        "Octahedron",
        "uniform float Scale; slider[1,1.8,4]\nuniform float Angle1; slider[-90,25,90]\nuniform vec3 Rot1; slider[(0,0,0),(1,2,2),(3,3,3)]\nuniform vec3 Offset; slider[(0,0,0),(1,0.1,0.2),(1,1,1)]",
        "z = rotationMatrix3(normalize(Rot1), Angle1) * z; if (z.x < -z.y) z.xy = -z.yx; if (z.x < -z.z) z.xz = -z.zx; if (z.x < z.y) z.xy = z.yx; if (z.x < z.z) z.xz = z.zx; z = Offset + (z - Offset) * Scale; d *= Scale;",
    ),
    (
        "Tetrahedron",
        "uniform float Scale; slider[1,2,4]\nuniform float Angle2; slider[-90,-40,90]\nuniform vec3 Rot2; slider[(0,0,0),(1,0,0),(3,3,3)]\nuniform vec3 Offset; slider[(0,0,0),(1,1,1),(1,1,1)]",
        "if (z.x + z.y < 0.0) z.xy = -z.yx; if (z.x + z.z < 0.0) z.xz = -z.zx; if (z.y + z.z < 0.0) z.yz = -z.zy; z = Scale * z - (Scale - 1.0) * Offset; z = z * rotationMatrix3(Rot2, Angle2); d *= Scale;",
    ),
    (
        "Menger",
        "uniform float Scale; slider[1,3,4]\nuniform vec3 Offset; slider[(0,0,0),(1,0.9,1),(1,1,1)]",
        "z = abs(z); if (z.x < z.y) z.xy = z.yx; if (z.x < z.z) z.xz = z.zx; if (z.y < z.z) z.yz = z.zy; vec3 s = Offset * (Scale - 1.0); z = z * Scale - s; if (z.z < -0.5 * s.z) z.z += s.z; d *= Scale;",
    ),
];

/// A shader is what its code computes, whatever it is called; the same with anything changed is not.
#[test]
fn shaders_are_recognised_by_what_they_compute() {
    for (name, uniforms, body) in KNOWN {
        let text = shader(uniforms, body);
        let (_folder, output) = import("nameless.frag", &text, &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{name}: {said}");
        assert!(said.starts_with(&format!("recognised as {name}: ")), "{name}: {said}");
        for (what, changed) in [
            ("a step more", text.replace(" i++;", "z = abs(z) - 0.1; i++;")),
            ("another factor", text.replace("z = ", "z = 1.01 * ")),
            ("another start", text.replace("vec3 z = p;", "vec3 z = p + vec3(0.3, 0.1, -0.2);")),
            ("cut", text.replace("return 0.5", "return abs(p.x) + abs(p.y) + 900.0 * 0.5")),
        ] {
            assert_ne!(changed, text, "{name}: {what}");
            let (folder, output) = import("Mandelbulb.frag", &changed, &[]);
            assert_eq!(output.status.code(), Some(2), "{name}, {what}: {}", stderr(&output));
            assert!(stderr(&output).contains("none that is known here"), "{name}, {what}: {}", stderr(&output));
            assert!(!folder.path().join("out.ron").exists());
        }
    }
}

/// Slider names and names of files say nothing.
#[test]
fn names_are_no_evidence() {
    for text in [include_str!("cases/ripples.frag"), include_str!("cases/lattice.frag")] {
        let (_folder, output) = import("Mandelbox.frag", text, &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("is none that is known here") || said.contains("cannot be run here"), "{said}");
        assert!(said.contains("--as NAME"), "{said}");
    }
    let (folder, output) = import("lattice.frag", include_str!("cases/lattice.frag"), &["--as", "mandelbox"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let first = stderr(&output).lines().next().unwrap().to_string();
    assert!(first.starts_with("warning:") && first.contains("was not read"), "{first}");
    let graph = std::fs::read_to_string(folder.path().join("out.ron")).unwrap();
    assert!(graph.contains("was not read"), "{graph}");
    let (_folder, output) = import("lattice.frag", include_str!("cases/lattice.frag"), &["--as", "mandelbix"]);
    assert!(stderr(&output).contains("did you mean `mandelbox`?"), "{}", stderr(&output));
}

/// A power of 3 comes from the chosen preset; the easing curve of another one is listed.
#[test]
fn easing_curves_are_animations() {
    let bulb = shader("", KNOWN[0].2);
    let body = &bulb[bulb.find("float DE").unwrap()..];
    let text = include_str!("cases/Mandelbulb.frag").replace("float DE(vec3 p) { return length(p) - 1.0; }", body);
    let (folder, output) = import("Mandelbulb.frag", &text, &["--preset", "Default"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("Power1:SineCurve") && said.contains("animations are not carried over"), "{said}");
    let graph = std::fs::read_to_string(folder.path().join("out.ron")).unwrap();
    assert!(graph.contains("\"power\": (default: 3.0"), "{graph}");
    // A broken line of a preset that is not chosen refuses nothing.
    let broken = text.replace("Power1:SineCurve:1:2:8:1:100:0.3:1:1.7:1:0", "Power1 moves");
    let (_folder, output) = import("Mandelbulb.frag", &broken, &["--preset", "Default"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let (_folder, output) = import("Mandelbulb.frag", &broken, &["--preset", "Range"]);
    assert_eq!(output.status.code(), Some(2));
}

/// What the interpreter does not know is told with the place and the reason.
#[test]
fn code_that_cannot_be_run_is_refused_with_the_reason() {
    for (body, words) in [
        ("z = noise(z);", "the function `noise`"),
        ("z += time;", "the variable `time`"),
        ("while (true) { d += 1.0; }", "runs for too long"),
    ] {
        let (_folder, output) = import("a.frag", &shader("", body), &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("a.frag:4:1") && said.contains(words), "{said}");
    }
}
