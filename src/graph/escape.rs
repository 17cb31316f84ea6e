//! When an orbit ends before its last iteration: by the length of z, or by another test.

use std::fmt;

use super::read::Reader;
use super::{Constant, OrbitSettings};
use crate::diag::Diagnostic;
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};

/// What of z is compared with the orbit's `escape_radius`. Directions have length 1; all four components count where z has four.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub enum Escape {
    /// r is above it.
    #[default]
    Length,
    /// The largest component in size is above it.
    Largest,
    /// The sum of the components' sizes is above it.
    Sum,
    /// The share of z along a direction is above it: z lies beyond a plane.
    Above([f64; 4]),
    /// That share is above it in size: z has left a slab around the origin.
    Beyond([f64; 4]),
    /// The distance from a point is below it: the orbit converges to that point.
    Near([f64; 4]),
    /// z moves by less in an iteration, or by less than this share of r where r is above 1: the orbit converges to any point.
    Still,
}

impl Escape {
    /// Whether orbits end where something becomes small.
    pub const fn is_convergence(self) -> bool {
        matches!(self, Escape::Near(_) | Escape::Still)
    }

    /// The number that its size is multiplied by so that it changes no faster than z does.
    pub fn scale(self, width: u8) -> f64 {
        if self == Escape::Sum { 1.0 / f64::from(width).sqrt() } else { 1.0 }
    }
}

impl fmt::Display for Escape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Escape::Length => f.write_str("length"),
            Escape::Largest => f.write_str("largest component"),
            Escape::Sum => f.write_str("sum of components"),
            Escape::Above(normal) => write!(f, "along {}", Point(*normal)),
            Escape::Beyond(normal) => write!(f, "along {} in size", Point(*normal)),
            Escape::Near(point) => write!(f, "near {}", Point(*point)),
            Escape::Still => f.write_str("still"),
        }
    }
}

impl fmt::Display for Constant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Constant::Mandelbrot => f.write_str("Mandelbrot"),
            Constant::Julia(point) => write!(f, "Julia({})", Point(*point)),
            Constant::Mix(point, amount) => write!(f, "Mix({}, {amount})", Point(*point)),
            Constant::Off => f.write_str("Off"),
        }
    }
}

/// A point as files write it, with its fourth component where that is not 0.
pub(crate) struct Point(pub(crate) [f64; 4]);

impl fmt::Display for Point {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z, w] = self.0;
        if w == 0.0 { write!(f, "({x}, {y}, {z})") } else { write!(f, "({x}, {y}, {z}, {w})") }
    }
}

/// How escape tests are written.
const FORMS: &str = "escape tests are: Length(30.0), Largest(4.0), Sum(4.0), Above(\"x\", 4.0), Below(\"x\", -4.0), Beyond(\"x\", 4.0), \
                     Plane(normal: (1, 0, 0), offset: 4.0), Near((1, 0, 0), 0.001), Still(0.001)";

impl Reader<'_> {
    /// Three or four numbers; a fourth is 0 if there are three.
    pub(super) fn point(&mut self, value: &Value) -> Option<[f64; 4]> {
        match &value.kind {
            ValueKind::List(items) | ValueKind::Tuple { name: None, items } if items.len() == 4 => {
                self.four = self.four.or(Some(value.span));
                let parts: Vec<Option<f64>> = items.iter().map(|item| self.number(item, -1e6, 1e6)).collect();
                Some([parts[0]?, parts[1]?, parts[2]?, parts[3]?])
            }
            _ => self.vector(value, -1e6, 1e6).map(|[x, y, z]| [x, y, z, 0.0]),
        }
    }

    /// The escape test, by `escape` or by `escape_radius`; false where neither is given.
    pub(super) fn escape(&mut self, fields: &mut Fields, settings: &mut OrbitSettings) -> bool {
        match (fields.optional_value("escape"), fields.optional_value("escape_radius")) {
            (None, None) => return false,
            (None, Some(radius)) => {
                settings.escape = Escape::Length;
                settings.escape_radius = self.number(radius, 1e-3, 1e6).unwrap_or(settings.escape_radius);
            }
            (Some(test), None) => {
                let read = read_escape(self, test);
                (settings.escape, settings.escape_radius) = read.unwrap_or((Escape::Length, settings.escape_radius));
            }
            (Some(test), Some(radius)) => self.d.push(
                Diagnostic::error("an orbit has one escape test, and these are two")
                    .label(test.span, "one test")
                    .label(radius.span, "another test: `escape_radius: 30.0` is short for `escape: Length(30.0)`")
                    .help("leave one of them out"),
            ),
        }
        true
    }
}

/// Reads an escape test and the number that it compares with.
pub(super) fn read_escape(reader: &mut Reader, value: &Value) -> Option<(Escape, f64)> {
    let size = |reader: &mut Reader, v: &Value| reader.number(v, 1e-3, 1e6);
    let small = |reader: &mut Reader, v: &Value| reader.number(v, 1e-12, 1e3);
    let any = |reader: &mut Reader, v: &Value| reader.number(v, -1e6, 1e6);
    let name = value.name().map(|name| name.text.as_str());
    match (name, &value.kind) {
        (Some("Length"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            Some((Escape::Length, size(reader, &items[0])?))
        }
        (Some("Largest"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            Some((Escape::Largest, size(reader, &items[0])?))
        }
        (Some("Sum"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            Some((Escape::Sum, size(reader, &items[0])?))
        }
        (Some("Still"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            Some((Escape::Still, small(reader, &items[0])?))
        }
        (Some("Above"), ValueKind::Tuple { items, .. }) if items.len() == 2 => {
            Some((Escape::Above(axis(reader, &items[0], 1.0)?), any(reader, &items[1])?))
        }
        (Some("Below"), ValueKind::Tuple { items, .. }) if items.len() == 2 => {
            Some((Escape::Above(axis(reader, &items[0], -1.0)?), -any(reader, &items[1])?))
        }
        (Some("Beyond"), ValueKind::Tuple { items, .. }) if items.len() == 2 => {
            Some((Escape::Beyond(axis(reader, &items[0], 1.0)?), size(reader, &items[1])?))
        }
        (Some("Near"), ValueKind::Tuple { items, .. }) if items.len() == 2 => {
            Some((Escape::Near(reader.point(&items[0])?), small(reader, &items[1])?))
        }
        (Some("Plane"), ValueKind::Struct { .. }) => read_plane(reader, value),
        _ => {
            let message = format!("expected an escape test, found {}", value.describe());
            reader.d.push(Diagnostic::error(message).label(value.span, "").help(FORMS));
            None
        }
    }
}

fn read_plane(reader: &mut Reader, value: &Value) -> Option<(Escape, f64)> {
    let mut fields = Fields::new(value, "an escape test", reader.d)?;
    let normal = fields.optional_value("normal").map(|v| (v.span, reader.point(v)));
    let offset = reader.required_number(&mut fields, "offset", -1e6, 1e6);
    let span = fields.span();
    fields.finish(reader.d);
    let Some((place, normal)) = normal else {
        reader.d.push(Diagnostic::error("the field `normal` is missing").label(span, "a direction such as (1, 0, 0)"));
        return None;
    };
    let normal = normal?;
    let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length == 0.0 {
        reader.d.push(Diagnostic::error("a direction cannot be (0, 0, 0)").label(place, ""));
        return None;
    }
    Some((Escape::Above(normal.map(|x| x / length)), offset?))
}

/// The direction of a coordinate.
fn axis(reader: &mut Reader, value: &Value, sign: f64) -> Option<[f64; 4]> {
    let i: usize = reader.word(value, "coordinate", &[("x", 0), ("y", 1), ("z", 2), ("w", 3)])?;
    if i == 3 {
        reader.four = reader.four.or(Some(value.span));
    }
    let mut axis = [0.0; 4];
    axis[i] = sign;
    Some(axis)
}
