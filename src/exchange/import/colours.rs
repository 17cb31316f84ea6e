//! Colours of Mandelbulber's materials: gradients of new files, palettes of old ones.

use super::ask::Ask;
use super::settings::{Entry, Section};
use super::value::{written, written_vector};
use super::{Lost, LostKind};
use crate::colour::{Gradient, Rgb, Stop, hex, parse_colour};
use crate::diag::{Diagnostic, Diagnostics};

/// Names of a gradient: of the first material, and of files before 2.20, which have colours at equal distances; then those of files before
/// materials.
const GRADIENTS: [&str; 2] = ["mat1_surface_color_gradient", "surface_color_gradient"];
const PALETTES: [&str; 2] = ["mat1_surface_color_palette", "surface_color_palette"];
/// Places of gradients are whole numbers up to this.
const PLACES: f64 = 10_000.0;
/// The gradient of a new file (Mandelbulber 2.32, `initparameters.cpp`).
const DEFAULT: &str = "0 fd6029 1000 698403 2000 fff59b 3000 f5bd22 4000 0b5e87 5000 c68876 6000 a51c64 7000 3b9fee 8000 d4ffd4 9000 aba53c";
/// The distance from the origin after which a gradient comes again at speed 1: its index is 5000 times the distance, and a turn 2560 (`fractal_coloring.cpp`,
/// `compute_fractal`'s default).
const PERIOD: f64 = 0.512;

/// The fields of `look` for the colours of a surface.
pub(super) fn colours(main: &Section, lost: &mut Vec<Lost>, d: &mut Diagnostics) -> Vec<String> {
    let names = |name: &str| [format!("mat1_{name}"), name.to_string()];
    let given = |name: &str| names(name).into_iter().find(|name| main.has(name));
    let switch = given("use_colors_from_palette").or_else(|| main.has("fractal_color").then(|| "fractal_color".into()));
    let is_coloured = switch.is_none_or(|name| main.switch(&name, true, d));
    if !is_coloured {
        return plain(main, d).into_iter().collect();
    }
    let number = |name: &str, default: f64, d: &mut Diagnostics| {
        given(name).map_or(default, |name| main.number(&name, default, d))
    };
    let speed = number("coloring_speed", 1.0, d);
    let offset = number("coloring_palette_offset", 0.0, d);
    let (gradient, is_old) = match read(main, d) {
        Some(found) => found,
        None => return Vec::new(),
    };
    let offset = if is_old { offset / gradient.stops().len() as f64 } else { offset };
    let algorithm =
        given("fractal_coloring_algorithm").and_then(|name| main.raw(&name).map(|entry| entry.value.clone()));
    if algorithm.as_deref().is_some_and(|value| value != "0") {
        let why = "the gradient is placed by the orbit's least distance from the origin".into();
        let what = format!("fractal_coloring_algorithm {}", algorithm.unwrap_or_default());
        lost.push(Lost { kind: LostKind::Look, what, why });
    }
    let stop = |stop: &Stop| format!("(\"{}\", {})", hex(stop.colour), written(stop.at));
    let stops: Vec<String> = gradient.stops().iter().map(stop).collect();
    let period = PERIOD / speed.abs().max(1e-6);
    vec![format!(
        "colour: Gradient(palette: Stops(colours: [{}], cyclic: true), by: Trap(0), place: Cyclic({}, {}))",
        stops.join(", "),
        written(period),
        written(offset)
    )]
}

/// The one colour of a surface without a gradient: three hexadecimal numbers up to ffff.
fn plain(main: &Section, d: &mut Diagnostics) -> Option<String> {
    let name = ["mat1_surface_color", "surface_color"].into_iter().find(|name| main.has(name))?;
    let colour = super::view::colour(main, name, [0.6; 3], d);
    Some(format!("palette: [{}]", written_vector(&colour)))
}

/// The gradient, and whether it is a palette of an old file.
fn read(main: &Section, d: &mut Diagnostics) -> Option<(Gradient, bool)> {
    let find = |names: [&'static str; 2]| names.into_iter().find(|name| main.has(name)).and_then(|name| main.raw(name));
    let (entry, is_old) = match (find(GRADIENTS), find(PALETTES)) {
        (Some(entry), _) => (Some(entry), false),
        (None, Some(entry)) => (Some(entry), true),
        (None, None) => (None, false),
    };
    let text = entry.map_or(DEFAULT, |entry| entry.value.as_str());
    let found = if is_old { palette(text) } else { gradient(text) };
    if found.is_none() {
        refuse(entry, is_old, d);
    }
    found.map(|gradient| (gradient, is_old))
}

fn refuse(entry: Option<&Entry>, is_old: bool, d: &mut Diagnostics) {
    let Some(entry) = entry else { return };
    let expected = match is_old {
        true => "hexadecimal colours such as fd6029 698403",
        false => "places and hexadecimal colours such as 0 fd6029 1000 698403",
    };
    let message = format!("`{}` needs {expected}", entry.name);
    d.push(Diagnostic::error(message).label(entry.span, format!("expected {expected}")));
}

fn gradient(text: &str) -> Option<Gradient> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let stop = |pair: &[&str]| {
        let [at, colour] = pair else { return None };
        Some(Stop { at: at.parse::<f64>().ok()? / PLACES, colour: parse_colour(colour)? })
    };
    Gradient::new(words.chunks(2).map(stop).collect::<Option<Vec<_>>>()?, true)
}

fn palette(text: &str) -> Option<Gradient> {
    let colours: Option<Vec<Rgb>> = text.split_whitespace().map(parse_colour).collect();
    let colours = colours.filter(|colours| !colours.is_empty())?;
    Gradient::even(&colours, true)
}
