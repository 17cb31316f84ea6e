//! A stroke font of our own, so that charts need no font of the system: each glyph is a path of a round pen.
//!
//! Glyphs stand on a grid with the baseline at 0, y upwards, small letters 50 high, capitals and digits 70. A glyph is its
//! width and a path: `M x y` lifts the pen, `L x y` draws a line, `C x y x y x y` a cubic curve, `E x y rx ry` an ellipse, and
//! `A x y rx ry from to` an arc around (x, y) between two angles in degrees (counter-clockwise when `to` is the larger);
//! `a` is an arc that the pen reaches drawing. Digits share one width, so that numbers stand in columns.

/// Units of the grid that a size of one pixel spans: capitals are 0.7 of the size.
const EM: f64 = 100.0;
/// Space between glyphs.
const GAP: f64 = 15.0;
/// Width of a space.
const SPACE: f64 = 30.0;
/// Size and rise of raised text.
const RAISED: (f64, f64) = (0.72, 34.0);

/// A part of a path, in grid units with y upwards.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Stroke {
    /// Lifts the pen.
    Move([f64; 2]),
    /// A line.
    Line([f64; 2]),
    /// A cubic curve: two control points and the end.
    Curve([f64; 2], [f64; 2], [f64; 2]),
}

impl Stroke {
    /// The same scaled and moved.
    fn placed(self, scale: f64, by: [f64; 2]) -> Stroke {
        let p = |[x, y]: [f64; 2]| [x * scale + by[0], y * scale + by[1]];
        match self {
            Stroke::Move(a) => Stroke::Move(p(a)),
            Stroke::Line(a) => Stroke::Line(p(a)),
            Stroke::Curve(a, b, c) => Stroke::Curve(p(a), p(b), p(c)),
        }
    }
}

/// Width of a text of this size, in pixels.
pub fn width(text: &str, size: f64) -> f64 {
    lay_out(text).1 * size / EM
}

/// A glyph at its place.
pub struct Placed {
    /// Which.
    pub glyph: char,
    /// Its left edge, in grid units.
    pub x: f64,
    /// Scale and rise of raised text; 1 and 0 else.
    pub raised: (f64, f64),
}

/// Glyphs of a text and where they stand.
pub fn places(text: &str) -> Vec<Placed> {
    lay_out(text).0
}

/// Strokes of one glyph; characters without one are boxes.
pub fn glyph_strokes(c: char) -> Vec<Stroke> {
    parse(glyph(c).1)
}

/// Strokes of a text in grid units, from x = 0; a size in pixels times 1/100 scales them.
pub fn strokes(text: &str) -> Vec<Stroke> {
    let placed = places(text).into_iter();
    placed
        .flat_map(|p| glyph_strokes(p.glyph).into_iter().map(move |s| s.placed(p.raised.0, [p.x, p.raised.1])))
        .collect()
}

fn lay_out(text: &str) -> (Vec<Placed>, f64) {
    let (mut places, mut x, mut end) = (Vec::new(), 0.0, 0.0);
    let mut is_raised = false;
    for c in text.chars() {
        if c == '^' {
            is_raised = true;
            continue;
        }
        is_raised &= c != ' ';
        let raised = if is_raised { RAISED } else { (1.0, 0.0) };
        if c == ' ' {
            x += SPACE;
            continue;
        }
        places.push(Placed { glyph: c, x, raised });
        end = x + glyph(c).0 * raised.0;
        x = end + GAP * raised.0;
    }
    (places, end)
}

fn glyph(c: char) -> (f64, &'static str) {
    let found = GLYPHS.iter().find(|(glyph, ..)| *glyph == c);
    found.map_or((36.0, "M 0 0 L 36 0 L 36 70 L 0 70 L 0 0"), |&(_, width, path)| (width, path))
}

/// Reads a path of [`GLYPHS`]; every glyph is read by a test.
fn parse(path: &str) -> Vec<Stroke> {
    let mut words = path.split_ascii_whitespace().peekable();
    let mut strokes = Vec::new();
    while let Some(verb) = words.next() {
        let mut n = || words.next().and_then(|w| w.parse::<f64>().ok()).unwrap_or(f64::NAN);
        match verb {
            "M" => strokes.push(Stroke::Move([n(), n()])),
            "L" => strokes.push(Stroke::Line([n(), n()])),
            "C" => strokes.push(Stroke::Curve([n(), n()], [n(), n()], [n(), n()])),
            "E" => arc(&mut strokes, [n(), n()], [n(), n()], [90.0, 450.0], true),
            "A" => arc(&mut strokes, [n(), n()], [n(), n()], [n(), n()], true),
            "a" => arc(&mut strokes, [n(), n()], [n(), n()], [n(), n()], false),
            _ => strokes.push(Stroke::Move([f64::NAN; 2])),
        }
    }
    strokes
}

/// An elliptic arc as cubic curves of at most a quarter turn.
fn arc(strokes: &mut Vec<Stroke>, centre: [f64; 2], radii: [f64; 2], [from, to]: [f64; 2], lift: bool) {
    let at = |angle: f64, tangent: f64| {
        let (sin, cos) = angle.to_radians().sin_cos();
        [centre[0] + radii[0] * (cos - tangent * sin), centre[1] + radii[1] * (sin + tangent * cos)]
    };
    let start = at(from, 0.0);
    strokes.push(if lift { Stroke::Move(start) } else { Stroke::Line(start) });
    let parts = ((to - from).abs() / 90.0).ceil().max(1.0);
    let turn = (to - from) / parts;
    // The usual length of tangents: exact at the middle of the arc.
    let k = 4.0 / 3.0 * (turn.to_radians() / 4.0).tan();
    for i in 0..parts as usize {
        let a = from + turn * i as f64;
        strokes.push(Stroke::Curve(at(a, k), at(a + turn, -k), at(a + turn, 0.0)));
    }
}

/// Character, width, path.
const GLYPHS: &[(char, f64, &str)] = &[
    ('a', 37.0, "A 19 32 18 18 150 0 L 37 0 M 37 30 L 16 30 a 16 15 16 15 90 270 C 27 0 37 6 37 17"),
    ('b', 42.0, "M 0 72 L 0 0 E 21 25 21 25"),
    ('c', 40.0, "A 22 25 22 25 42 318"),
    ('d', 42.0, "E 21 25 21 25 M 42 72 L 42 0"),
    ('e', 43.0, "M 0 26 L 43 26 a 21.5 25 21.5 25 3 316"),
    ('f', 25.0, "A 25 57 14 15 90 180 L 11 0 M 0 48 L 24 48"),
    ('g', 42.0, "E 21 25 21 25 M 42 50 L 42 0 a 21 0 21 20 0 -148"),
    ('h', 40.0, "M 0 72 L 0 0 A 20 30 20 20 180 0 L 40 0"),
    ('i', 0.0, "M 0 50 L 0 0 M 0 67 L 0 69"),
    ('j', 12.0, "M 12 50 L 12 -6 a -2 -6 14 14 0 -90 M 12 67 L 12 69"),
    ('k', 37.0, "M 0 72 L 0 0 M 34 50 L 0 19 M 13 31 L 37 0"),
    ('l', 11.0, "M 0 72 L 0 11 a 11 11 11 11 180 270"),
    ('m', 64.0, "M 0 50 L 0 0 A 16 34 16 16 180 0 L 32 0 A 48 34 16 16 180 0 L 64 0"),
    ('n', 40.0, "M 0 50 L 0 0 A 20 30 20 20 180 0 L 40 0"),
    ('o', 45.0, "E 22.5 25 22.5 25"),
    ('p', 42.0, "M 0 50 L 0 -20 E 21 25 21 25"),
    ('q', 42.0, "E 21 25 21 25 M 42 50 L 42 -20"),
    ('r', 23.0, "M 0 50 L 0 0 A 19 31 19 19 180 77"),
    (
        's',
        35.0,
        "M 33 41 C 30 47 25 50 18 50 C 8 50 2 45 2 38 C 2 30 9 28 18 26 C 27 24 35 21 35 13 C 35 5 28 0 18 0 C 9 0 3 4 0 10",
    ),
    ('t', 25.0, "M 11 66 L 11 13 a 24 13 13 13 180 270 M 0 48 L 25 48"),
    ('u', 40.0, "M 0 50 L 0 20 a 20 20 20 20 180 360 M 40 50 L 40 0"),
    ('v', 40.0, "M 0 50 L 20 0 L 40 50"),
    ('w', 58.0, "M 0 50 L 15 0 L 29 46 L 43 0 L 58 50"),
    ('x', 38.0, "M 0 50 L 38 0 M 38 50 L 0 0"),
    ('y', 40.0, "M 0 50 L 20 0 M 40 50 L 20 0 C 15 -13 11 -20 2 -20"),
    ('z', 37.0, "M 1 50 L 36 50 L 0 0 L 37 0"),
    ('A', 54.0, "M 0 0 L 27 70 L 54 0 M 9 24 L 45 24"),
    ('B', 45.0, "M 0 0 L 0 70 L 24 70 a 24 53 17 17 90 -90 L 0 36 M 24 36 a 26 18 19 18 90 -90 L 0 0"),
    ('C', 56.0, "A 32 35 32 35 46 314"),
    ('D', 54.0, "M 0 0 L 0 70 L 20 70 C 42 70 54 56 54 35 C 54 14 42 0 20 0 L 0 0"),
    ('E', 42.0, "M 42 70 L 0 70 L 0 0 L 42 0 M 0 37 L 36 37"),
    ('F', 41.0, "M 41 70 L 0 70 L 0 0 M 0 36 L 34 36"),
    ('G', 63.0, "A 32 35 32 35 46 345 L 63 34 L 38 34"),
    ('H', 50.0, "M 0 70 L 0 0 M 50 70 L 50 0 M 0 37 L 50 37"),
    ('I', 0.0, "M 0 70 L 0 0"),
    ('J', 28.0, "M 28 70 L 28 18 a 14 18 14 18 0 -170"),
    ('K', 47.0, "M 0 70 L 0 0 M 44 70 L 0 26 M 15 41 L 47 0"),
    ('L', 38.0, "M 0 70 L 0 0 L 38 0"),
    ('M', 60.0, "M 0 0 L 0 70 L 30 20 L 60 70 L 60 0"),
    ('N', 49.0, "M 0 0 L 0 70 L 49 0 L 49 70"),
    ('O', 66.0, "E 33 35 33 35"),
    ('P', 44.0, "M 0 0 L 0 70 L 25 70 a 25 51 19 19 90 -90 L 0 32"),
    ('Q', 66.0, "E 33 35 33 35 M 42 18 L 62 -4"),
    ('R', 47.0, "M 0 0 L 0 70 L 25 70 a 25 51 19 19 90 -90 L 0 32 M 24 32 L 47 0"),
    (
        'S',
        45.0,
        "M 42 57 C 38 66 31 70 23 70 C 10 70 3 63 3 53 C 3 42 12 39 23 36 C 35 33 45 30 45 18 C 45 7 36 0 23 0 C 12 0 4 5 0 14",
    ),
    ('T', 52.0, "M 0 70 L 52 70 M 26 70 L 26 0"),
    ('U', 48.0, "M 0 70 L 0 25 a 24 25 24 25 180 360 L 48 70"),
    ('V', 54.0, "M 0 70 L 27 0 L 54 70"),
    ('W', 78.0, "M 0 70 L 19 0 L 39 66 L 59 0 L 78 70"),
    ('X', 48.0, "M 0 70 L 48 0 M 48 70 L 0 0"),
    ('Y', 50.0, "M 0 70 L 25 34 L 50 70 M 25 34 L 25 0"),
    ('Z', 47.0, "M 2 70 L 46 70 L 0 0 L 47 0"),
    ('0', 42.0, "E 21 35 20 35"),
    ('1', 42.0, "M 8 57 L 24 70 L 24 0"),
    ('2', 42.0, "A 20 50 19 20 165 0 C 39 34 14 20 0 0 L 41 0"),
    ('3', 42.0, "A 20 53 17 17 150 -90 M 20 36 a 20 18 21 18 90 -150"),
    ('4', 42.0, "M 32 0 L 32 70 L -1 19 L 43 19"),
    ('5', 42.0, "M 37 70 L 7 70 L 4 37 C 9 43 15 45 21 45 C 33 45 41 36 41 23 C 41 9 32 0 20 0 C 11 0 4 4 0 11"),
    ('6', 42.0, "E 21 22 20 22 M 1 22 C 1 48 14 66 34 70"),
    ('7', 42.0, "M 0 70 L 41 70 L 13 0"),
    ('8', 42.0, "E 21 53 17 17 E 21 18 20 18"),
    ('9', 42.0, "E 21 48 20 22 M 41 48 C 41 22 28 4 8 0"),
    ('.', 0.0, "M 0 0 L 0 2"),
    (',', 3.0, "M 3 2 L -2 -12"),
    (':', 0.0, "M 0 2 L 0 4 M 0 44 L 0 46"),
    (';', 3.0, "M 3 2 L -2 -12 M 3 44 L 3 46"),
    ('!', 0.0, "M 0 70 L 0 20 M 0 0 L 0 2"),
    ('?', 36.0, "A 18 53 17 17 170 -40 C 25 36 18 32 18 20 M 18 0 L 18 2"),
    ('\'', 0.0, "M 0 72 L 0 56"),
    ('"', 14.0, "M 0 72 L 0 56 M 14 72 L 14 56"),
    ('(', 15.0, "M 15 82 C -4 58 -4 10 15 -14"),
    (')', 15.0, "M 0 82 C 19 58 19 10 0 -14"),
    ('[', 14.0, "M 14 80 L 0 80 L 0 -12 L 14 -12"),
    (']', 14.0, "M 0 80 L 14 80 L 14 -12 L 0 -12"),
    ('-', 24.0, "M 0 26 L 24 26"),
    ('\u{2013}', 40.0, "M 0 26 L 40 26"),
    ('\u{2212}', 38.0, "M 0 29 L 38 29"),
    ('+', 38.0, "M 0 29 L 38 29 M 19 48 L 19 10"),
    ('\u{b1}', 38.0, "M 0 36 L 38 36 M 19 55 L 19 17 M 0 3 L 38 3"),
    ('\u{d7}', 32.0, "M 0 45 L 32 13 M 32 45 L 0 13"),
    ('=', 38.0, "M 0 38 L 38 38 M 0 20 L 38 20"),
    ('<', 36.0, "M 36 48 L 0 29 L 36 10"),
    ('>', 36.0, "M 0 48 L 36 29 L 0 10"),
    ('\u{2264}', 36.0, "M 36 58 L 0 39 L 36 20 M 0 5 L 36 5"),
    ('\u{2192}', 58.0, "M 0 28 L 58 28 M 40 45 L 58 28 L 40 11"),
    ('/', 28.0, "M 0 -8 L 28 76"),
    ('|', 0.0, "M 0 78 L 0 -12"),
    ('_', 40.0, "M 0 -10 L 40 -10"),
    ('*', 28.0, "M 14 72 L 14 40 M 0 64 L 28 48 M 28 64 L 0 48"),
    ('%', 70.0, "E 14 54 14 16 E 56 16 14 16 M 56 72 L 14 -2"),
    ('&', 56.0, "M 56 0 L 14 48 C 4 62 12 70 21 70 C 32 70 38 58 28 48 L 12 36 C -6 22 0 0 22 0 C 38 0 50 14 53 32"),
    ('#', 46.0, "M 16 70 L 8 0 M 38 70 L 30 0 M 2 47 L 46 47 M 0 23 L 44 23"),
    ('~', 42.0, "M 0 24 C 8 38 16 36 21 30 C 26 24 34 22 42 36"),
    ('\u{b7}', 0.0, "M 0 29 L 0 31"),
    ('\u{b0}', 22.0, "E 11 60 11 11"),
    ('\u{b5}', 40.0, "M 0 50 L 0 -20 M 0 20 a 20 20 20 20 180 360 M 40 50 L 40 0"),
];

#[cfg(test)]
mod tests {
    use super::{GLYPHS, Stroke, parse, strokes, width};

    #[test]
    fn every_glyph_is_a_path_inside_its_box() {
        for (c, width, path) in GLYPHS {
            let strokes = parse(path);
            assert!(strokes.len() > 1 && matches!(strokes[0], Stroke::Move(_)), "{c}");
            for stroke in strokes {
                let end = match stroke {
                    Stroke::Move(p) | Stroke::Line(p) | Stroke::Curve(.., p) => p,
                };
                assert!((-3.0..=width + 3.0).contains(&end[0]) && (-21.0..=83.0).contains(&end[1]), "{c}: {end:?}");
            }
        }
    }

    #[test]
    fn widths_add_up() {
        assert_eq!(width("", 10.0), 0.0);
        assert_eq!(width("nn", 100.0), 40.0 + 15.0 + 40.0);
        assert_eq!(width("11", 50.0), width("88", 50.0));
        assert!(width("10^6", 10.0) < width("106", 10.0));
    }

    #[test]
    fn a_character_without_a_glyph_is_a_box() {
        assert_eq!(strokes("\u{4e2d}").len(), 5);
    }
}
