//! Colours and gradients as formula files and the command line write them.

use super::gradient::{Gradient, Stop};
use super::space::{Rgb, from_oklch, linear};
use crate::diag::{Diagnostic, Diagnostics};
use crate::formula::decode::{FromValue, wrong_type};
use crate::formula::value::{Value, ValueKind};

/// How colours are written.
const COLOURS: &str = "a colour is \"#c06030\", \"rgb(192, 96, 48)\", \"oklch(0.6, 0.13, 45)\", or linear red, green and blue: (0.5, 0.1, 0.03)";

/// Reads `#rgb`, `#rrggbb`, `rrggbb`, `rgb(r, g, b)` with parts up to 255 or `oklch(lightness, chroma, hue)`.
pub fn parse_colour(text: &str) -> Option<Rgb> {
    let text = text.trim();
    if let Some((name, rest)) = text.split_once('(') {
        let parts: Vec<&str> = rest.strip_suffix(')')?.split([',', ' ', '/']).filter(|part| !part.is_empty()).collect();
        let number = |part: &str, percent: f64| match part.strip_suffix('%') {
            Some(share) => share.parse::<f64>().ok().map(|share| share / 100.0 * percent),
            None => part.trim_end_matches("deg").parse::<f64>().ok(),
        };
        let whole = if name.eq_ignore_ascii_case("oklch") { [1.0, 0.4, 360.0] } else { [255.0; 3] };
        let [a, b, c] =
            [0, 1, 2].map(|i| parts.get(i).and_then(|part| number(part, whole[i])).filter(|x| x.is_finite()));
        let (a, b, c) = (a?, b?, c?);
        return match name.trim().to_ascii_lowercase().as_str() {
            "rgb" | "rgba" => Some([a, b, c].map(|part| linear((part / 255.0).clamp(0.0, 1.0)))),
            "oklch" => Some(from_oklch(a, b.clamp(0.0, 1.0), c)),
            _ => None,
        };
    }
    let digits = text.strip_prefix('#').unwrap_or(text);
    if !digits.is_ascii() || !digits.chars().all(|c| c.is_ascii_hexdigit()) {
        return None;
    }
    let part = |i: usize| match digits.len() {
        3 => u8::from_str_radix(&digits[i..=i].repeat(2), 16).ok(),
        6 | 8 => u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).ok(),
        _ => None,
    };
    let [r, g, b] = [part(0)?, part(1)?, part(2)?].map(|byte| linear(f64::from(byte) / 255.0));
    Some([r, g, b])
}

/// Reads a colour of a formula file: a text as [`parse_colour`] takes it, or three linear numbers from 0 to 100.
pub fn read_colour(value: &Value, d: &mut Diagnostics) -> Option<Rgb> {
    match &value.kind {
        ValueKind::Str(text) => {
            let colour = parse_colour(text);
            if colour.is_none() {
                d.push(Diagnostic::error(format!("`{text}` is not a colour")).label(value.span, "").help(COLOURS));
            }
            colour
        }
        ValueKind::List(_) | ValueKind::Tuple { .. } => {
            let colour = <Rgb>::from_value(value, d)?;
            let is_in_range = colour.iter().all(|part| (0.0..=100.0).contains(part));
            if !is_in_range {
                let message = "the parts of a linear colour lie from 0 to 100";
                d.push(Diagnostic::error(message).label(value.span, "").help(COLOURS));
            }
            is_in_range.then_some(colour)
        }
        _ => {
            wrong_type(value, "a colour", d);
            None
        }
    }
}

/// Reads the stops of a gradient: a list of colours at equal distances, or of pairs of a colour and its place from 0 to 1, such as
/// `("#c06030", 0.25)`.
pub fn read_stops(value: &Value, is_cyclic: bool, d: &mut Diagnostics) -> Option<Gradient> {
    let items: &[Value] = match &value.kind {
        ValueKind::List(items) => items,
        _ => &[],
    };
    if items.is_empty() || items.len() > 256 {
        let message = "expected a list of 1 to 256 colours such as [\"#102040\", \"#e0a060\"]";
        d.push(Diagnostic::error(message).label(value.span, format!("found {}", value.describe())).help(COLOURS));
        return None;
    }
    let gaps = if is_cyclic { items.len() } else { (items.len() - 1).max(1) };
    let stops = items.iter().enumerate().map(|(i, item)| match &item.kind {
        ValueKind::Tuple { name: None, items } if items.len() == 2 => {
            let at = f64::from_value(&items[1], d)?;
            if !(0.0..=1.0).contains(&at) {
                d.push(Diagnostic::error("a stop lies from 0 to 1").label(items[1].span, format!("found {at}")));
                return None;
            }
            Some(Stop { at, colour: read_colour(&items[0], d)? })
        }
        _ => Some(Stop { at: i as f64 / gaps as f64, colour: read_colour(item, d)? }),
    });
    let stops: Vec<Option<Stop>> = stops.collect();
    Gradient::new(stops.into_iter().collect::<Option<Vec<_>>>()?, is_cyclic)
}

#[cfg(test)]
mod tests {
    use super::parse_colour;
    use crate::colour::hex;

    #[test]
    fn colours_are_read_in_all_forms() {
        for (text, expected) in [
            ("#c06030", "#c06030"),
            ("c06030", "#c06030"),
            ("#fa0", "#ffaa00"),
            ("rgb(192, 96, 48)", "#c06030"),
            ("rgb(100% 0% 50%)", "#ff0080"),
            ("oklch(1, 0, 0)", "#ffffff"),
            ("oklch(100% 0% 120deg)", "#ffffff"),
        ] {
            assert_eq!(parse_colour(text).map(hex).as_deref(), Some(expected), "{text}");
        }
        for wrong in ["", "#", "#ab", "#ggg", "red(1,2,3)", "rgb(1,2)", "rgb(1,2,3", "rgb(nan,1,2)", "ö#1", "äöü"] {
            assert_eq!(parse_colour(wrong), None, "{wrong}");
        }
    }
}
