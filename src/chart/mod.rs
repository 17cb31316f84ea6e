//! Charts of what estimates cost and how right they are: measurements to SVG, PNG and CSV.
//!
//! In come measurements of [`crate::check::measure`]; out comes a [`Drawing`], which [`svg()`] and [`raster()`] write, or the
//! same numbers as CSV. A chart has a light page, a quiet grid, names beside their lines, and few colours (Okabe and Ito,
//! 2008, which colour-blind readers can distinguish): one for each family of methods.

pub mod cost;
pub mod depth;
mod drawing;
mod font;
mod labels;
pub mod path;
mod raster;
mod scale;
pub mod step_size;
mod svg;

pub use drawing::{Anchor, Colour, Drawing, GREY, INK, Item, PAPER, Text};
pub use raster::raster;
pub use svg::svg;

use self::drawing::Point;
use crate::check::Target;
use crate::graph::Method;

/// Width of a page.
const WIDTH: f64 = 960.0;
/// Left edge of titles and captions.
const MARGIN: f64 = 28.0;

/// Kinds of method that share a colour.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Family {
    Rules,
    Exact,
    Differences,
    Proof,
}

impl Family {
    const ALL: [Family; 4] = [Family::Rules, Family::Exact, Family::Differences, Family::Proof];

    fn of(method: Option<Method>) -> Family {
        match method {
            None | Some(Method::Own | Method::Scalar) => Family::Rules,
            Some(Method::Delta | Method::DeltaRay) => Family::Differences,
            Some(method) if method.name().starts_with("certified") => Family::Proof,
            Some(_) => Family::Exact,
        }
    }

    fn colour(self) -> Colour {
        match self {
            Family::Rules => Colour(0x00, 0x72, 0xb2),
            Family::Exact => Colour(0x00, 0x8a, 0x66),
            Family::Differences => Colour(0xd5, 0x5e, 0x00),
            Family::Proof => Colour(0xa3, 0x4f, 0x8a),
        }
    }

    fn words(self) -> &'static str {
        match self {
            Family::Rules => "the steps' own rules",
            Family::Exact => "exact derivatives",
            Family::Differences => "finite differences",
            Family::Proof => "proofs",
        }
    }
}

/// The name of a method on charts and in CSV.
fn method_name(method: Option<Method>) -> &'static str {
    method.map_or("own", Method::name)
}

/// Back end and precision of a target, as words.
fn target_words(target: Target) -> (&'static str, &'static str) {
    match target {
        Target::Cpu(precision) => ("cpu", precision.name()),
        Target::Gpu => ("gpu", target.precision().name()),
    }
}

/// Draws a caption in lines of at most `width` and returns the place below it.
fn caption(page: &mut Drawing, text: &str, at: Point, width: f64, size: f64) -> f64 {
    let mut y = at[1];
    let mut line = String::new();
    for word in text.split(' ') {
        let longer = if line.is_empty() { word.to_string() } else { format!("{line} {word}") };
        if font::width(&longer, size) > width && !line.is_empty() {
            page.text(Text::new([at[0], y], std::mem::take(&mut line), size).colour(GREY));
            y += size * 1.45;
            line = word.to_string();
        } else {
            line = longer;
        }
    }
    page.text(Text::new([at[0], y], line, size).colour(GREY));
    y + size * 1.45
}

/// A field of a CSV line, quoted where it must be.
fn csv_field(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_string(),
    }
}
