//! Light and colour: what a picture's surfaces look like.

use super::fields::{read_colours, read_palette};
use crate::diag::{Diagnostic, Span};
use crate::formula::decode::{Fields, entries};
use crate::formula::value::{Value, ValueKind};
use crate::graph::NodeRef;
use crate::graph::read::Reader;

/// Base colour, and those that the traps blend in. Colours are linear RGB.
pub type Palette = [[f64; 3]; 5];

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

/// What a part of the picture is made of.
#[derive(Clone, PartialEq, Debug)]
pub struct Part {
    /// Its node: a field, or the map of an orbit.
    pub node: NodeRef,
    /// Place of its name in the file.
    pub span: Span,
    /// Its colours.
    pub palette: Palette,
}

/// Light and colour. Colours are linear RGB.
#[derive(Clone, PartialEq, Debug)]
pub struct Look {
    /// Direction towards the sun, in the camera's frame: right, up, back.
    pub sun_direction: [f64; 3],
    /// Colour times strength of the sun.
    pub sun: [f64; 3],
    /// Colour times strength of the sky.
    pub sky: [f64; 3],
    /// Whether the sun casts shadows.
    pub shadows: bool,
    /// Strength of ambient occlusion, 0 to 1.
    pub occlusion: f64,
    /// Greatest distance from which something darkens a corner, in world units; a share of the depth where absent.
    pub occlusion_radius: Option<f64>,
    /// Colours of all that has none of its own.
    pub palette: Palette,
    /// What blends in the palette's colours behind its first, the first of them over the others.
    pub traps: [Option<Trap>; 4],
    /// Parts with colours of their own.
    pub parts: Vec<Part>,
    /// Background at the bottom and the top of the picture.
    pub background: [[f64; 3]; 2],
    /// Share of light lost per unit of distance; 0 is no fog.
    pub fog: f64,
}

impl Look {
    /// Whether colours depend on orbit traps.
    pub fn reads_traps(&self) -> bool {
        let palettes = || self.parts.iter().map(|part| &part.palette).chain([&self.palette]);
        let shows = |i: usize| palettes().any(|palette| palette[i + 1] != palette[0]);
        (0..4).any(|i| self.traps[i].is_some() && shows(i))
    }

    /// The coordinates whose folds are followed.
    pub fn folds(&self) -> impl Iterator<Item = (usize, u8)> {
        let axis = |trap: &Option<Trap>| if let Some(Trap::LastFold(axis)) = trap { Some(*axis) } else { None };
        self.traps.iter().enumerate().filter_map(move |(i, trap)| Some((i, axis(trap)?)))
    }
}

impl Default for Look {
    fn default() -> Self {
        Look {
            sun_direction: [-0.55, 0.75, 0.6],
            sun: [2.1, 1.9, 1.6],
            sky: [0.42, 0.55, 0.78],
            shadows: true,
            occlusion: 0.85,
            occlusion_radius: None,
            palette: [
                [0.72, 0.68, 0.60],
                [0.75, 0.36, 0.12],
                [0.10, 0.33, 0.55],
                [0.82, 0.58, 0.20],
                [0.30, 0.46, 0.28],
            ],
            traps: TRAPS,
            parts: Vec::new(),
            background: [[0.035, 0.045, 0.065], [0.16, 0.21, 0.29]],
            fog: 0.0,
        }
    }
}

/// Reads `look: (...)`; what is not given keeps its default.
pub(super) fn read_look(reader: &mut Reader, value: &Value) -> Option<Look> {
    let mut look = Look::default();
    let mut fields = Fields::new(value, "a look", reader.d)?;
    if let Some(v) = fields.optional_value("sun_direction") {
        look.sun_direction = reader.direction(v)?;
    }
    for (name, colour) in [("sun", &mut look.sun), ("sky", &mut look.sky)] {
        if let Some(v) = fields.optional_value(name) {
            *colour = reader.vector(v, 0.0, 100.0)?;
        }
    }
    look.shadows = fields.or("shadows", look.shadows, reader.d);
    if let Some(v) = fields.optional_value("occlusion") {
        look.occlusion = reader.number(v, 0.0, 1.0)?;
    }
    if let Some(v) = fields.optional_value("occlusion_radius") {
        look.occlusion_radius = Some(reader.number(v, 1e-9, 1e9)?);
    }
    if let Some(v) = fields.optional_value("fog") {
        look.fog = reader.number(v, 0.0, 100.0)?;
    }
    if let Some(v) = fields.optional_value("palette") {
        look.palette = read_palette(reader, v)?;
    }
    if let Some(v) = fields.optional_value("traps") {
        look.traps = read_traps(reader, v)?;
    }
    if let Some(v) = fields.optional_value("parts") {
        for (name, value) in entries(v, "parts of the picture", reader.d) {
            let node = reader.wire(&Value::new(name.span, ValueKind::Str(name.text.clone())));
            let mut fields = Fields::new(value, "a part's look", reader.d)?;
            let palette = fields.optional_value("palette").map_or(Some(look.palette), |v| read_palette(reader, v));
            fields.finish(reader.d);
            look.parts.push(Part { node: node?, span: name.span, palette: palette? });
        }
    }
    if let Some(v) = fields.optional_value("background") {
        read_colours(reader, v, &mut look.background)?;
    }
    fields.finish(reader.d);
    Some(look)
}

/// How traps are written.
const FORMS: &str = "traps are: Point((0.5, 0, 0)), Line((0, 0, 1)), Line(at: (1, 0, 0), along: (0, 0, 1)), \
                     Circle(centre: (0, 0, 0), normal: (0, 0, 1), radius: 1.0), Plane(normal: (1, 0, 0), offset: 0.5), Iterations, \
                     LastFold(\"x\")";

/// Reads a list of one to four traps.
fn read_traps(reader: &mut Reader, value: &Value) -> Option<[Option<Trap>; 4]> {
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
