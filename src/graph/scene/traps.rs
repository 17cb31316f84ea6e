//! Orbit traps: what the colours of a picture can tell of an orbit.

use crate::diag::Diagnostic;
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};
use crate::graph::NodeRef;
use crate::graph::read::Reader;

/// What of an orbit a colour of the palette tells.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Trap {
    /// How near it came to a point.
    Point([f64; 3]),
    /// How near it came to a line through `at` along a unit vector.
    Line {
        /// A point of it.
        at: [f64; 3],
        /// Its direction.
        along: [f64; 3],
    },
    /// How near it came to a circle.
    Circle {
        /// Its middle.
        centre: [f64; 3],
        /// Unit vector across its plane.
        normal: [f64; 3],
        /// Its radius.
        radius: f64,
    },
    /// How near it came to a sphere.
    Sphere {
        /// Its middle.
        centre: [f64; 3],
        /// Its radius.
        radius: f64,
    },
    /// How near it came to the surface of a box.
    Box {
        /// Its middle.
        centre: [f64; 3],
        /// Half of its edges.
        half_size: [f64; 3],
    },
    /// How near it came to the surface of a field of the graph.
    Field(NodeRef),
    /// How near it came to a plane.
    Plane {
        /// Unit normal.
        normal: [f64; 3],
        /// Distance from the origin along it.
        offset: f64,
    },
    /// How many of its iterations it took.
    Iterations,
    /// Whether the last fold that moved this coordinate (0 is x) found it on the positive side.
    LastFold(u8),
}

/// The traps where a file gives none: the origin, and the planes across the axes.
pub const TRAPS: [Option<Trap>; 4] = [
    Some(Trap::Point([0.0; 3])),
    Some(Trap::Plane { normal: [1.0, 0.0, 0.0], offset: 0.0 }),
    Some(Trap::Plane { normal: [0.0, 1.0, 0.0], offset: 0.0 }),
    Some(Trap::Plane { normal: [0.0, 0.0, 1.0], offset: 0.0 }),
];

/// How traps are written.
const FORMS: &str = "traps are: Point((0.5, 0, 0)), Line((0, 0, 1)), Line(at: (1, 0, 0), along: (0, 0, 1)), \
                     Circle(centre: (0, 0, 0), normal: (0, 0, 1), radius: 1.0), Plane(normal: (1, 0, 0), offset: 0.5), \
                     Sphere(centre: (0, 0, 0), radius: 1.0), Box(half_size: (1, 1, 1)), Field(\"node\"), Iterations, LastFold(\"x\")";

/// Reads a list of one to four traps.
pub(super) fn read_traps(reader: &mut Reader, value: &Value) -> Option<[Option<Trap>; 4]> {
    let items: &[Value] = match &value.kind {
        ValueKind::List(items) => items,
        _ => &[],
    };
    if items.is_empty() || items.len() > 4 {
        let message = "expected a list of 1 to 4 traps, one for each colour of the palette behind its first";
        let found = format!("found {}", value.describe());
        reader.d.push(Diagnostic::error(message).label(value.span, found).help(FORMS));
        return None;
    }
    let mut traps = [None; 4];
    for (trap, item) in traps.iter_mut().zip(items) {
        *trap = Some(read_trap(reader, item)?);
    }
    Some(traps)
}

fn read_trap(reader: &mut Reader, value: &Value) -> Option<Trap> {
    let name = value.name().map(|name| name.text.as_str());
    match (name, &value.kind) {
        (Some("Iterations"), ValueKind::Variant(_)) => Some(Trap::Iterations),
        (Some("Point"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            reader.vector(&items[0], -1e6, 1e6).map(Trap::Point)
        }
        (Some("Line"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            reader.direction(&items[0]).map(|along| Trap::Line { at: [0.0; 3], along })
        }
        (Some("LastFold"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            reader.word(&items[0], "coordinate", &[("x", 0), ("y", 1), ("z", 2)]).map(Trap::LastFold)
        }
        (Some("Field"), ValueKind::Tuple { items, .. }) if items.len() == 1 => reader.wire(&items[0]).map(Trap::Field),
        (Some("Sphere" | "Box"), ValueKind::Struct { .. }) => read_solid(reader, value),
        (Some("Line" | "Circle" | "Plane"), ValueKind::Struct { .. }) => {
            let mut fields = Fields::new(value, "a trap", reader.d)?;
            let mut point = |reader: &mut Reader, name: &'static str| {
                fields.optional_value(name).map_or(Some([0.0; 3]), |v| reader.vector(v, -1e6, 1e6))
            };
            let origin = match name {
                Some("Line") => point(reader, "at"),
                Some("Circle") => point(reader, "centre"),
                _ => Some([0.0; 3]),
            };
            let direction = if name == Some("Line") { "along" } else { "normal" };
            let across = fields.optional_value(direction).map_or(Some([0.0, 0.0, 1.0]), |v| reader.direction(v));
            let number = match name {
                Some("Circle") => reader.required_number(&mut fields, "radius", 0.0, 1e6),
                Some("Plane") => reader.required_number(&mut fields, "offset", -1e6, 1e6),
                _ => Some(0.0),
            };
            fields.finish(reader.d);
            let (at, across, number) = (origin?, across?, number?);
            Some(match name {
                Some("Line") => Trap::Line { at, along: across },
                Some("Circle") => Trap::Circle { centre: at, normal: across, radius: number },
                _ => Trap::Plane { normal: across, offset: number },
            })
        }
        _ => {
            let message = format!("expected a trap, found {}", value.describe());
            reader.d.push(Diagnostic::error(message).label(value.span, "").help(FORMS));
            None
        }
    }
}

/// Reads `Sphere(centre: (x, y, z), radius: r)` or `Box(centre: (x, y, z), half_size: (x, y, z))`.
fn read_solid(reader: &mut Reader, value: &Value) -> Option<Trap> {
    let is_box = value.name().is_some_and(|name| name.text == "Box");
    let mut fields = Fields::new(value, "a trap", reader.d)?;
    let centre = fields.optional_value("centre").map_or(Some([0.0; 3]), |v| reader.vector(v, -1e6, 1e6));
    let solid = match is_box {
        false => reader.required_number(&mut fields, "radius", 0.0, 1e6).map(|radius| (radius, [0.0; 3])),
        true => {
            let half_size = fields.optional_value("half_size");
            if half_size.is_none() {
                let message = "the field `half_size` is missing";
                reader.d.push(Diagnostic::error(message).label(fields.span(), "half of the box's edges").help(FORMS));
            }
            half_size.and_then(|v| reader.vector(v, 0.0, 1e6)).map(|half_size| (0.0, half_size))
        }
    };
    fields.finish(reader.d);
    let (centre, (radius, half_size)) = (centre?, solid?);
    Some(if is_box { Trap::Box { centre, half_size } } else { Trap::Sphere { centre, radius } })
}
