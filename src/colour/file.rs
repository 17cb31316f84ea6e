//! Gradients of other programs' files: GIMP, Ultra Fractal, Fractint, and lists as CSS has them.

use std::fmt;

use super::ggr;
use super::gradient::{Gradient, Stop};
use super::space::linear;
use super::written::parse_colour;

/// Why a text is no gradient.
#[derive(Clone, PartialEq, Debug)]
pub struct FileError {
    /// The line, from 1.
    pub line: usize,
    /// What is wrong there.
    pub why: String,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.why)
    }
}

/// Places of Ultra Fractal's gradients.
const INDICES: f64 = 400.0;

/// Reads a gradient from a file's text, whose kind shows in the text itself: `.ggr` of GIMP, `.ugr` and `.gradient` of Ultra Fractal (the first
/// gradient of the file), `.map` of Fractint, or a list of colours as CSS has it.
///
/// Errors: the first line that cannot be read.
pub fn read_gradient(text: &str) -> Result<Gradient, FileError> {
    let text = text.trim_start_matches('\u{feff}');
    let wrong = |(line, why): (usize, String)| FileError { line, why };
    let first = text.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    let (stops, is_cyclic) = if first == "GIMP Gradient" {
        (ggr::stops(text).map_err(wrong)?, false)
    } else if text.contains("gradient:") || text.contains("index=") {
        (ultra_fractal(text).map_err(wrong)?, true)
    } else if is_map(first) {
        (map(text).map_err(wrong)?, true)
    } else {
        (list(text).map_err(wrong)?, false)
    };
    Gradient::new(stops, is_cyclic).ok_or_else(|| FileError { line: 1, why: "it holds no colour".into() })
}

/// `index=N color=B` pairs up to the end of the first gradient; a colour's red is its lowest byte.
fn ultra_fractal(text: &str) -> Result<Vec<Stop>, (usize, String)> {
    let mut stops = Vec::new();
    let (mut index, mut is_opacity) = (None, false);
    for (row, line) in text.lines().enumerate() {
        for word in line.split_whitespace() {
            if word == "}" && !stops.is_empty() {
                return Ok(stops);
            }
            is_opacity = match word {
                "opacity:" => true,
                "gradient:" => false,
                _ => is_opacity,
            };
            let Some((name, value)) = word.split_once('=').filter(|_| !is_opacity) else { continue };
            if !["index", "color"].contains(&name) {
                continue;
            }
            let number: i64 = value
                .parse()
                .map_err(|_| (row + 1, format!("expected a whole number behind `{name}=`, found `{value}`")))?;
            match (name, index.take()) {
                ("index", _) => index = Some(number),
                (_, Some(index)) => {
                    let part = |shift: u32| linear(((number >> shift) & 0xff) as f64 / 255.0);
                    let at = (index as f64 / INDICES).rem_euclid(1.0);
                    stops.push(Stop { at, colour: [part(0), part(8), part(16)] });
                }
                _ => return Err((row + 1, "a colour has no index".into())),
            }
        }
    }
    Ok(stops)
}

/// Whether a line is one of Fractint's: three numbers, then anything.
fn is_map(line: &str) -> bool {
    line.split_whitespace().take(3).filter(|part| part.parse::<u16>().is_ok()).count() == 3
}

fn map(text: &str) -> Result<Vec<Stop>, (usize, String)> {
    let rows = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let colours = rows.map(|(row, line)| {
        let parts: Vec<f64> =
            line.split_whitespace().take(3).filter_map(|part| part.parse::<u8>().ok()).map(f64::from).collect();
        match parts[..] {
            [r, g, b] => Ok([r, g, b].map(|part| linear(part / 255.0))),
            _ => Err((row + 1, "expected three numbers from 0 to 255".to_string())),
        }
    });
    let colours = colours.collect::<Result<Vec<_>, _>>()?;
    let count = colours.len() as f64;
    Ok(colours.into_iter().enumerate().map(|(i, colour)| Stop { at: i as f64 / count, colour }).collect())
}

/// Colours between commas or on lines, each perhaps with its place in percent; also inside of `linear-gradient(...)`.
fn list(text: &str) -> Result<Vec<Stop>, (usize, String)> {
    let mut given: Vec<(Option<f64>, [f64; 3])> = Vec::new();
    for (row, line) in text.lines().enumerate() {
        let line = line.trim().trim_end_matches(';');
        let inner = line.find("gradient(").map_or(line, |at| {
            let rest = &line[at + "gradient(".len()..];
            rest.strip_suffix(')').unwrap_or(rest)
        });
        for part in outside_brackets(inner) {
            let part = part.trim();
            if part.is_empty() || part.starts_with("to ") || part.ends_with("deg") || part.starts_with("//") {
                continue;
            }
            let (colour, place) = match part.rsplit_once(' ') {
                Some((colour, place)) if place.ends_with('%') && !colour.trim_end().ends_with(',') => {
                    (colour, Some(place))
                }
                _ => (part, None),
            };
            let at = place.and_then(|place| place.trim_end_matches('%').parse::<f64>().ok()).map(|place| place / 100.0);
            let colour = parse_colour(colour).ok_or((row + 1, format!("`{part}` is not a colour such as #c06030")))?;
            given.push((at, colour));
        }
    }
    Ok(spread(&given))
}

/// Parts between commas that are not inside of brackets.
fn outside_brackets(text: &str) -> Vec<&str> {
    let mut depth = 0;
    let parts = text.split(|c| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        c == ',' && depth == 0
    });
    parts.collect()
}

/// Stops without a place stand evenly between their neighbours, the first at 0 and the last at 1.
fn spread(given: &[(Option<f64>, [f64; 3])]) -> Vec<Stop> {
    let last = given.len().saturating_sub(1);
    let mut places: Vec<Option<f64>> = given.iter().map(|(at, _)| *at).collect();
    for (end, at) in [(0, 0.0), (last, 1.0)] {
        if let Some(place) = places.get_mut(end) {
            *place = place.or(Some(at));
        }
    }
    let known: Vec<(usize, f64)> = places.iter().enumerate().filter_map(|(i, at)| Some((i, (*at)?))).collect();
    let place = |i: usize| {
        let after = known.iter().position(|(k, _)| *k >= i).unwrap_or(known.len() - 1);
        let ((a, from), (b, to)) = (known[after.saturating_sub(1)], known[after]);
        if a == b || b == i { to } else { from + (to - from) * (i - a) as f64 / (b - a) as f64 }
    };
    given.iter().enumerate().map(|(i, (_, colour))| Stop { at: place(i), colour: *colour }).collect()
}

#[cfg(test)]
mod tests {
    use super::read_gradient;
    use crate::colour::{Gradient, hex};

    fn read(text: &str) -> Gradient {
        read_gradient(text).unwrap_or_else(|error| panic!("{text}: {error}"))
    }

    fn colours(gradient: &Gradient, places: &[f64]) -> Vec<String> {
        places.iter().map(|t| hex(gradient.at(*t))).collect()
    }

    #[test]
    fn gimp() {
        let text = "GIMP Gradient\nName: two\n2\n0 0.25 0.5 1 0 0 1 0 1 0 1 0 0\n0.5 0.75 1 0 1 0 1 0 0 1 1 0 0 0 0\n";
        let found = colours(&read(text), &[0.0, 0.25, 0.499_999, 1.0]);
        assert_eq!(found[0], "#ff0000");
        assert_eq!(found[3], "#0000ff");
        // Mixed in sRGB, as GIMP does it: 127.5 of 255, rounded either way.
        assert!(["#7f7f00", "#7f8000", "#807f00", "#808000"].contains(&found[1].as_str()), "{found:?}");
        assert!(read_gradient("GIMP Gradient\nName: x\n3\n0 0.5 1 1 1 1 1 0 0 0 1 0 0\n").is_err());
    }

    #[test]
    fn ultra_fractal() {
        let text = "Fire {\ngradient:\n  title=\"fire\" smooth=no\n  index=0 color=255\n  index=200 color=16711680\nopacity:\n  smooth=no index=0 opacity=255\n}\nOther {\ngradient:\nindex=0 color=0\n}\n";
        let gradient = read(text);
        assert_eq!(colours(&gradient, &[0.0, 0.5, 1.0]), ["#ff0000", "#0000ff", "#ff0000"]);
        assert!(gradient.is_cyclic());
    }

    #[test]
    fn fractint() {
        let gradient = read("0 0 0 Black\n255 255 255\n255 0 0 red\n  0 0 255\n");
        assert_eq!(colours(&gradient, &[0.0, 0.25, 0.5, 0.75]), ["#000000", "#ffffff", "#ff0000", "#0000ff"]);
        assert!(read_gradient("0 0 0\n0 0 300\n").is_err_and(|error| error.line == 2));
    }

    #[test]
    fn css() {
        for text in
            ["#000, #f00 25%, #fff", "linear-gradient(90deg, #000, rgb(255, 0, 0) 25%, #fff);", "#000\n#f00 25%\n#fff"]
        {
            let gradient = read(text);
            assert_eq!(colours(&gradient, &[0.0, 0.25, 1.0]), ["#000000", "#ff0000", "#ffffff"], "{text}");
        }
        assert_eq!(colours(&read("#010203"), &[0.3]), ["#010203"]);
        for wrong in ["", "\n\n", "red", "#12"] {
            assert!(read_gradient(wrong).is_err(), "{wrong:?}");
        }
    }
}
