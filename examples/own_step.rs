//! A formula step of your own, from its text: a twist before a Mandelbulb. `cargo run --release --example own_step`

use bulbfold::engine::{Engine, Request};
use bulbfold::shade::Size;

const LEAN: &str = r#"
// Lean: moves x by a share of y.
fn step(z, c, p) {
    vec3(z.x + p.by * z.y, z.y, z.z)
}

// No direction is stretched by more than this.
fn derivative(z, dr, p) {
    dr * (1.0 + abs(p.by))
}

#{
    group: "transform",
    summary: "Moves x by a share of y.",
    scalar_rule: "exact",
    params: [#{ name: "by", type: "float", "default": 0.2, min: -1.0, max: 1.0, unit: "", help: "The share." }],
    examples: [#{ z: [1.0, 2.0, 3.0], expect: [1.4, 2.0, 3.0] }],
}
"#;

const FORMULA: &str = r#"(
    nodes: { "lean": lean(by: 0.15), "bulb": bulb_power(power: 8), "map": Sequence(["lean", "bulb"]) },
    output: "map",
    escape_radius: 10,
)"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let engine = Engine::new().with_step("lean", LEAN)?;
    let formula = engine.read("leaning.ron", FORMULA, &[])?;
    let request = Request { size: Size { width: 640, height: 360 }, ..Request::default() };
    let image = engine.picture(&formula, &request, &mut ())?;
    Ok(image.write_png("leaning.png".as_ref())?)
}
