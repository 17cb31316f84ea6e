//! Reading planes and colours.

use super::{Palette, Plane};
use crate::colour::{parse_colour, read_colour};
use crate::diag::Diagnostic;
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};
use crate::graph::read::{Reader, cross, dot};

/// Reads `plane: (center: (x, y), height: h)`: the plane z = 0 seen from above, where the file gives no `right` and `up`.
pub(super) fn read_plane(reader: &mut Reader, value: &Value) -> Option<Plane> {
    let mut fields = Fields::new(value, "a plane", reader.d)?;
    let center = fields.optional_value("center").map(|v| read_center(reader, v));
    let height = fields.optional_value("height").map(|v| reader.number(v, 1e-300, 1e9));
    let mut axis = |name, default| fields.optional_value(name).map_or(Some(default), |v| reader.direction(v));
    let (right, up) = (axis("right", [1.0, 0.0, 0.0]), axis("up", [0.0, 1.0, 0.0]));
    let span = fields.span();
    fields.finish(reader.d);
    let Some(height) = height else {
        let help = "give it the length from the bottom to the top of the picture: `plane: (height: 2.5)`";
        reader.d.push(Diagnostic::error("a plane needs a `height`").label(span, "").help(help));
        return None;
    };
    let (center, height, right, up) = (center.unwrap_or(Some([0.0; 3]))?, height?, right?, up?);
    let normal = cross(right, up);
    let length = dot(normal, normal).sqrt();
    if length <= 1e-6 {
        let message = "the plane's right and up directions lie on one line";
        reader.d.push(Diagnostic::error(message).label(value.span, "").help("choose another `right` or `up`"));
        return None;
    }
    Some(Plane { center, height, right, up: cross(normal.map(|x| x / length), right) })
}

/// A point, whose z is 0 where only x and y are given.
fn read_center(reader: &mut Reader, value: &Value) -> Option<[f64; 3]> {
    match &value.kind {
        ValueKind::List(items) | ValueKind::Tuple { name: None, items } if items.len() == 2 => {
            let [x, y] = [0, 1].map(|i| reader.number(&items[i], -1e9, 1e9));
            Some([x?, y?, 0.0])
        }
        _ => reader.vector(value, -1e9, 1e9),
    }
}

/// Reads a list of one to five colours; those that are not given are the first one.
pub(super) fn read_palette(reader: &mut Reader, value: &Value) -> Option<Palette> {
    let items: &[Value] = match &value.kind {
        ValueKind::List(items) => items,
        _ => &[],
    };
    if items.is_empty() || items.len() > 5 {
        let message = "expected a list of 1 to 5 colours such as [(0.8, 0.6, 0.3), ...]";
        reader.d.push(Diagnostic::error(message).label(value.span, format!("found {}", value.describe())));
        return None;
    }
    let mut read = |item: &Value| match &item.kind {
        ValueKind::Str(text) if parse_colour(text).is_some() => read_colour(item, reader.d),
        _ => reader.vector(item, 0.0, 100.0),
    };
    let mut palette = [read(&items[0])?; 5];
    for (colour, item) in palette.iter_mut().zip(items).skip(1) {
        *colour = read(item)?;
    }
    Some(palette)
}

/// Reads a list of linear RGB colours, of exactly the length asked for.
pub(super) fn read_colours<const N: usize>(
    reader: &mut Reader,
    value: &Value,
    colours: &mut [[f64; 3]; N],
) -> Option<()> {
    let items: &[Value] = match &value.kind {
        ValueKind::List(items) => items,
        _ => &[],
    };
    if items.len() != N {
        let message = format!("expected a list of {N} colours such as [(0.8, 0.6, 0.3), ...]");
        reader.d.push(Diagnostic::error(message).label(value.span, format!("found {}", value.describe())));
        return None;
    }
    for (colour, item) in colours.iter_mut().zip(items) {
        *colour = reader.vector(item, 0.0, 100.0)?;
    }
    Some(())
}
