//! Reading light and colour.

use super::read::Reader;
use super::settings::Look;
use crate::diag::Diagnostic;
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};

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
    if let Some(v) = fields.optional_value("fog") {
        look.fog = reader.number(v, 0.0, 100.0)?;
    }
    if let Some(v) = fields.optional_value("palette") {
        read_colours(reader, v, &mut look.palette)?;
    }
    if let Some(v) = fields.optional_value("background") {
        read_colours(reader, v, &mut look.background)?;
    }
    fields.finish(reader.d);
    Some(look)
}

/// Reads a list of linear RGB colours, of exactly the length asked for.
fn read_colours<const N: usize>(reader: &mut Reader, value: &Value, colours: &mut [[f64; 3]; N]) -> Option<()> {
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
