//! Shaders of Fragmentarium.

use bulbfold::check::Formula;

use crate::{import, imported, stderr};

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
