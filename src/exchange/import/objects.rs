//! Mandelbulber's objects: formulas joined by Boolean operators, primitives, limits, and where they all stand.

use super::ask::Ask;
use super::place::{Matrix, axis_angle, mirrored, transposed, turn};
use super::settings::Section;
use super::value::{written, written_vector};
use super::{Lost, LostKind};
use crate::diag::Diagnostics;

/// The primitives that have counterparts.
const PRIMITIVES: &[&str] = &["plane", "box", "sphere", "cylinder", "torus"];

/// Puts `node` where an object stands of `scale` times its own size, which the program turns by turning the point (in degrees).
pub fn placed(node: &str, position: [f64; 3], degrees: [f64; 3], scale: f64, is_mirrored: bool) -> String {
    let (matrix, position) = seen(turn(degrees), position, is_mirrored);
    if position == [0.0; 3] && degrees == [0.0; 3] && scale == 1.0 {
        return node.to_string();
    }
    // The program turns the point; the object turns the other way.
    let (axis, angle) = axis_angle(transposed(matrix));
    format!(
        "Transform(of: {node}, translate: {}, axis: {}, angle: {}, scale: {})",
        written_vector(&position),
        written_vector(&axis),
        written(angle),
        written(scale)
    )
}

fn seen(matrix: Matrix, position: [f64; 3], is_mirrored: bool) -> (Matrix, [f64; 3]) {
    match is_mirrored {
        true => (mirrored(matrix), [position[0], position[1], -position[2]]),
        false => (matrix, position),
    }
}

/// Nodes joined by the operators of `boolean_operator_1` ...; `nodes` holds slot numbers and nodes.
pub fn joined(nodes: &[(usize, String)], main: &Section, d: &mut Diagnostics) -> String {
    let mut node = nodes[0].1.clone();
    for (number, next) in &nodes[1..] {
        node = join(&node, next, main.number(&format!("boolean_operator_{}", number - 1), 1.0, d));
    }
    node
}

/// Two nodes joined by an operator: 0 and, 1 or, 2 the first without the second, 3 the other way round.
pub fn join(a: &str, b: &str, operator: f64) -> String {
    match operator as i32 {
        0 => format!("Intersection([{a}, {b}])"),
        2 => format!("Difference(a: {a}, b: {b})"),
        3 => format!("Difference(a: {b}, b: {a})"),
        _ => format!("Union([{a}, {b}])"),
    }
}

/// Half the length of a cylinder without ends.
const ENDLESS: f64 = 1e4;

/// Whether the settings switch a primitive on.
pub fn has_primitives(main: &Section) -> bool {
    primitives(main).iter().any(|prefix| main.has(&format!("{prefix}_enabled")))
}

/// Joins the primitives of the settings to `node`; says whether one of them has no end: a plane, or an open cylinder.
pub fn with_primitives(
    mut node: String,
    main: &Section,
    is_mirrored: bool,
    lost: &mut Vec<Lost>,
    d: &mut Diagnostics,
) -> (String, bool) {
    let mut has_no_end = false;
    let mut shapes: Vec<(String, f64)> = Vec::new();
    for prefix in primitives(main) {
        if !main.switch(&format!("{prefix}_enabled"), false, d) {
            continue;
        }
        let Some((shape, is_endless)) = primitive(&prefix, main, is_mirrored, lost, d) else { continue };
        has_no_end |= is_endless;
        let position = main.vector(&format!("{prefix}_position"), [0.0; 3], d);
        let degrees = main.vector(&format!("{prefix}_rotation"), [0.0; 3], d);
        let operator = main.number(&format!("{prefix}_boolean_operator"), 1.0, d);
        shapes.push((placed(&shape, position, degrees, 1.0, is_mirrored), operator));
    }
    for (shape, operator) in shapes {
        node = join(&node, &shape, operator);
    }
    (node, has_no_end)
}

/// A primitive at the origin, and whether it has no end; one without a counterpart is listed as lost.
pub fn primitive(
    prefix: &str,
    main: &Section,
    is_mirrored: bool,
    lost: &mut Vec<Lost>,
    d: &mut Diagnostics,
) -> Option<(String, bool)> {
    let of = |name: &str| format!("{prefix}_{name}");
    let kind = prefix.split('_').nth(1).unwrap_or_default();
    let Some(shape) = shape(kind, &of, main, is_mirrored, d) else {
        let what = format!("{prefix} (a {kind})");
        let why = "primitives here are solid planes, boxes, spheres, cylinders and tori".into();
        lost.push(Lost { kind: LostKind::Shape, what, why });
        return None;
    };
    Some((shape, kind == "plane" || is_open(kind, &of, main, d)))
}

/// Names of all primitives of the settings, such as `primitive_box_1`, in the order of the file.
fn primitives(main: &Section) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for entry in &main.entries {
        let parts: Vec<&str> = entry.name.splitn(4, '_').collect();
        if let ["primitive", kind, number, _] = parts[..]
            && number.chars().all(|c| c.is_ascii_digit())
        {
            let name = format!("primitive_{kind}_{number}");
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    names
}

/// Whether a primitive is a cylinder without caps, which the program draws without ends.
fn is_open(kind: &str, of: &dyn Fn(&str) -> String, main: &Section, d: &mut Diagnostics) -> bool {
    kind == "cylinder" && !main.switch(&of("caps"), true, d)
}

fn shape(
    kind: &str,
    of: &dyn Fn(&str) -> String,
    main: &Section,
    is_mirrored: bool,
    d: &mut Diagnostics,
) -> Option<String> {
    let is_hollow = kind != "sphere" && main.switch(&of("empty"), false, d);
    if !PRIMITIVES.contains(&kind) || is_hollow {
        return None;
    }
    Some(match kind {
        "plane" => format!("Plane(normal: (0.0, 0.0, {}), offset: 0.0)", if is_mirrored { "-1.0" } else { "1.0" }),
        "box" => {
            let size = main.vector(&of("size"), [1.0; 3], d).map(|part| 0.5 * part);
            format!("Box(half_size: {})", written_vector(&size))
        }
        "sphere" => {
            let form = if main.switch(&of("empty"), false, d) { "shell" } else { "signed" };
            format!("Sphere(radius: {}, form: {form})", written(main.number(&of("radius"), 1.0, d)))
        }
        "cylinder" => {
            let radius = main.number(&of("radius"), 0.5, d);
            let height = 0.5 * main.number(&of("height"), 1.0, d);
            let half_height = if is_open(kind, of, main, d) { ENDLESS } else { height };
            format!("Cylinder(radius: {}, half_height: {})", written(radius), written(half_height))
        }
        _ => {
            let (major, minor) = (main.number(&of("radius"), 1.0, d), main.number(&of("tube_radius"), 0.2, d));
            format!("Torus(major: {}, minor: {})", written(major), written(minor))
        }
    })
}

/// Cuts `node` with the box of the limits, where they are enabled.
pub fn limited(node: String, main: &Section, is_mirrored: bool, d: &mut Diagnostics) -> String {
    if !main.switch("limits_enabled", false, d) {
        return node;
    }
    let (min, max) = (main.vector("limit_min", [-10.0; 3], d), main.vector("limit_max", [10.0; 3], d));
    let half: [f64; 3] = std::array::from_fn(|i| (0.5 * (max[i] - min[i])).abs().max(1e-9));
    let mut centre: [f64; 3] = std::array::from_fn(|i| 0.5 * (max[i] + min[i]));
    if is_mirrored {
        centre[2] = -centre[2];
    }
    format!("Intersection([{node}, Box(centre: {}, half_size: {})])", written_vector(&centre), written_vector(&half))
}
