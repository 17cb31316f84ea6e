//! SVG text. Coordinates have one decimal: charts are small files and lie well in a repository.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::Cursor;

use super::drawing::{Colour, Drawing, Item, Point, Text};
use super::font::{self, Stroke};
use crate::film::Image;

/// Quality of embedded JPEGs.
const JPEG_QUALITY: u8 = 82;

/// A drawing as an SVG document. Errors come from the encoder of pictures.
pub fn svg(drawing: &Drawing) -> Result<String, String> {
    let (w, h) = (drawing.width, drawing.height);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" role=\"img\" \
         fill=\"none\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n<title>{}</title>\n",
        escape(&drawing.title)
    );
    write_glyphs(&mut out, drawing);
    for item in &drawing.items {
        write_item(&mut out, item)?;
    }
    out.push_str("</svg>\n");
    Ok(out)
}

fn write_item(out: &mut String, item: &Item) -> Result<(), String> {
    let write = |out: &mut String, args: std::fmt::Arguments| {
        let _ = out.write_fmt(args);
    };
    match item {
        Item::Rect([x, y, w, h], colour) => write(
            out,
            format_args!(
                "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\"/>\n",
                short(*x),
                short(*y),
                short(*w),
                short(*h),
                hex(*colour)
            ),
        ),
        Item::Line { points, colour, width, dash } => {
            let dashes = match dash {
                d if *d > 0.0 => format!(" stroke-dasharray=\"{} {}\" stroke-linecap=\"butt\"", short(*d), short(*d)),
                _ => String::new(),
            };
            let (d, c, w) = (path(points), hex(*colour), short(*width));
            write(out, format_args!("<path d=\"{d}\" stroke=\"{c}\" stroke-width=\"{w}\"{dashes}/>\n"));
        }
        // A line of no length with round ends is a dot, in a tenth of the bytes of a circle.
        Item::Dots { points, diameter, colour } => {
            let d: String = points.iter().map(|[x, y]| format!("M{} {}h0", short(*x), short(*y))).collect();
            let (c, w) = (hex(*colour), short(*diameter));
            write(out, format_args!("<path d=\"{d}\" stroke=\"{c}\" stroke-width=\"{w}\"/>\n"));
        }
        Item::Ring { centre, diameter, colour, width } => write(
            out,
            format_args!(
                "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" stroke=\"{}\" stroke-width=\"{}\"/>\n",
                short(centre[0]),
                short(centre[1]),
                short(diameter / 2.0),
                hex(*colour),
                short(*width)
            ),
        ),
        Item::Area(points, colour) => {
            write(out, format_args!("<path d=\"{}Z\" fill=\"{}\"/>\n", path(points), hex(*colour)));
        }
        Item::Text(text) => write_text(out, text),
        Item::Picture([x, y, w, h], image) => {
            let data = base64(&jpeg(image)?);
            write(
                out,
                format_args!(
                    "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" href=\"data:image/jpeg;base64,{data}\"/>\n",
                    short(*x),
                    short(*y),
                    short(*w),
                    short(*h)
                ),
            );
        }
    }
    Ok(())
}

/// Every glyph that is used, once.
fn write_glyphs(out: &mut String, drawing: &Drawing) {
    let mut used = BTreeSet::new();
    for item in &drawing.items {
        if let Item::Text(text) = item {
            used.extend(font::places(&text.text).into_iter().map(|p| p.glyph));
        }
    }
    out.push_str("<defs>");
    for glyph in used {
        let _ = write!(out, "<path id=\"{}\" d=\"{}\"/>", glyph_id(glyph), glyph_path(&font::glyph_strokes(glyph)));
    }
    out.push_str("</defs>\n");
}

fn glyph_id(glyph: char) -> String {
    if glyph.is_ascii_alphabetic() { glyph.to_string() } else { format!("_{:x}", u32::from(glyph)) }
}

/// A text as a group of glyphs in grid units, with the words for those who have them read.
fn write_text(out: &mut String, text: &Text) {
    let scale = text.size / 100.0;
    let [x, y] = text.at;
    let place = match text.upright {
        false => format!("translate({} {})", short(x - text.lead()), short(y)),
        true => format!("translate({} {})rotate(-90)", short(x), short(y + text.lead())),
    };
    let glyphs: String = font::places(&text.text)
        .iter()
        .map(|p| match p.raised {
            (1.0, _) => format!("<use href=\"#{}\" x=\"{}\"/>", glyph_id(p.glyph), p.x.round()),
            (size, rise) => {
                format!(
                    "<use href=\"#{}\" transform=\"translate({} {})scale({size})\"/>",
                    glyph_id(p.glyph),
                    p.x.round(),
                    -rise
                )
            }
        })
        .collect();
    let words = escape(&text.text.replace('^', ""));
    let pen = text.pen() / scale;
    let halo = match text.halo {
        true => format!("<g stroke=\"#fff\" stroke-width=\"{}\">{glyphs}</g>", short(pen + 3.6 / scale)),
        false => String::new(),
    };
    let _ = writeln!(
        out,
        "<g aria-label=\"{words}\" transform=\"{place}scale({})\" stroke=\"{}\" stroke-width=\"{}\">{halo}{glyphs}</g>",
        (scale * 1000.0).round() / 1000.0,
        hex(text.colour),
        short(pen)
    );
}

/// Strokes as relative commands in whole units, y down.
fn glyph_path(strokes: &[Stroke]) -> String {
    let mut d = String::new();
    let mut at = [0i64; 2];
    let round = |[x, y]: Point| [x.round() as i64, (-y).round() as i64];
    for stroke in strokes {
        let (verb, points) = match *stroke {
            Stroke::Move(p) => ('m', vec![round(p)]),
            Stroke::Line(p) => ('l', vec![round(p)]),
            Stroke::Curve(a, b, c) => ('c', vec![round(a), round(b), round(c)]),
        };
        d.push(verb);
        for (i, [x, y]) in points.iter().enumerate() {
            let separator = if i > 0 && *x >= at[0] { " " } else { "" };
            let second = if *y >= at[1] { " " } else { "" };
            let _ = write!(d, "{separator}{}{second}{}", x - at[0], y - at[1]);
        }
        at = points[points.len() - 1];
    }
    d
}

fn path(points: &[Point]) -> String {
    let part = |(i, [x, y]): (usize, &Point)| format!("{}{} {}", if i == 0 { "M" } else { "L" }, short(*x), short(*y));
    points.iter().enumerate().map(part).collect()
}

/// A number with at most one decimal.
fn short(x: f64) -> String {
    let rounded = (x * 10.0).round() / 10.0;
    if rounded == 0.0 { "0".into() } else { rounded.to_string() }
}

fn hex(Colour(r, g, b): Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// A text as XML may hold it.
fn escape(text: &str) -> String {
    let legal = text.chars().filter(|c| !c.is_control());
    legal.fold(String::new(), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
        out
    })
}

fn jpeg(image: &Image) -> Result<Vec<u8>, String> {
    let mut bytes = Cursor::new(Vec::new());
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
    let (width, height) = (image.size.width, image.size.height);
    image::ImageEncoder::write_image(encoder, &image.rgb, width, height, image::ExtendedColorType::Rgb8)
        .map_err(|error| format!("the picture cannot be encoded: {error}"))?;
    Ok(bytes.into_inner())
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = [0, 1, 2].iter().fold(0u32, |word, &i| word << 8 | u32::from(chunk.get(i).copied().unwrap_or(0)));
        for i in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * i)) as usize & 63];
            out.push(if i <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{base64, escape, glyph_path, short};
    use crate::chart::font::strokes;

    #[test]
    fn base64_is_that_of_rfc_4648() {
        let cases =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")];
        for (text, expected) in cases {
            assert_eq!(base64(text.as_bytes()), expected);
        }
    }

    #[test]
    fn texts_and_numbers_are_safe_in_xml() {
        assert_eq!(escape("a<b & \"c\"\u{1}"), "a&lt;b &amp; &quot;c&quot;");
        assert_eq!((short(-0.01).as_str(), short(12.34).as_str(), short(-3.0).as_str()), ("0", "12.3", "-3"));
    }

    #[test]
    fn glyphs_are_relative_paths() {
        assert_eq!(glyph_path(&strokes("T")), "m0-70l52 0m-26 0l0 70");
    }
}
