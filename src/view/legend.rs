//! The legend below a picture: title, colour bar with numbers, classes with their shares.

use super::colour::Axis;
use super::shown::Shown;
use crate::chart::{Anchor, Colour, Drawing, GREY, Item, Text, raster};
use crate::film::Image;
use crate::shade::Size;

/// Least width of a legend in its own units. Wider pictures get larger letters, narrower ones smaller letters within these
/// scales, and then a page that is wider than they are.
const WIDTH: f64 = 560.0;
const SCALES: [f64; 2] = [0.75, 2.5];
/// Edge around it.
const MARGIN: f64 = 12.0;
/// Sizes of texts.
const TITLE: f64 = 14.0;
const LABEL: f64 = 12.0;
/// Height and pieces of the colour bar.
const BAR: f64 = 14.0;
const PIECES: usize = 256;
/// Edge of a class's square.
const SQUARE: f64 = 11.0;

impl Shown {
    /// The picture with its legend below. The picture keeps its pixels; the page is as wide as the legend needs.
    pub fn image(&self) -> Image {
        let picture = self.plain_image();
        let scale = (f64::from(self.size.width) / WIDTH).clamp(SCALES[0], SCALES[1]);
        let legend = raster(&self.legend(f64::from(self.size.width) / scale), scale);
        // Too large for a raster only where the picture is too.
        let Ok(legend) = legend else { return picture };
        below(&picture, &legend)
    }

    /// The legend for a picture of a width.
    fn legend(&self, width: f64) -> Drawing {
        let width = width.max(WIDTH);
        let mut page = Drawing::new(width, 0.0, self.title.clone());
        page.items.clear();
        let mut y = MARGIN + TITLE;
        page.text(Text::new([MARGIN, y], self.title.clone(), TITLE).bold());
        if let Some(axis) = self.axis {
            y = self.bar(&mut page, axis, [MARGIN, width - MARGIN], y + 10.0);
        }
        y = self.squares(&mut page, width, y + 10.0);
        page.height = y + MARGIN;
        page
    }

    /// The colour bar with its numbers; returns the place below.
    fn bar(&self, page: &mut Drawing, axis: Axis, [left, right]: [f64; 2], top: f64) -> f64 {
        let width = right - left;
        for i in 0..PIECES {
            let place = (i as f64 + 0.5) / PIECES as f64;
            let x = left + width * i as f64 / PIECES as f64;
            // Pieces overlap by a unit, so that no seam shows between them.
            let piece = (width / PIECES as f64 + 1.0).min(right - x);
            page.items.push(Item::Rect([x, top, piece, BAR], bytes(axis.colour_at(place))));
        }
        let below = top + BAR;
        let mut last = f64::NEG_INFINITY;
        // The last number stands for all beyond it, too.
        let has_more = self.values().iter().any(|v| *v > axis.high());
        for tick in axis.ticks() {
            let x = left + width * axis.place(tick);
            page.line(&[[x, below], [x, below + 4.0]], GREY, 1.0);
            let text = Text::new(
                [0.0; 2],
                format!("{}{}", number(tick), if has_more && tick >= axis.high() * 0.999 { "+" } else { "" }),
                LABEL,
            );
            let half = text.width() / 2.0;
            let middle = x.clamp(left + half, right - half);
            if middle - half > last + 6.0 {
                last = middle + half;
                page.text(Text { at: [middle, below + 4.0 + LABEL], ..text }.anchor(Anchor::Middle));
            }
        }
        let y = below + 4.0 + LABEL;
        if self.ends.iter().all(|words| words.is_empty()) {
            return y;
        }
        let y = y + LABEL * 1.5;
        page.text(Text::new([left, y], self.ends[0], LABEL).colour(GREY));
        page.text(Text::new([right, y], self.ends[1], LABEL).colour(GREY).anchor(Anchor::End));
        y
    }

    /// Classes that have pixels, in lines; returns the place below.
    fn squares(&self, page: &mut Drawing, width: f64, top: f64) -> f64 {
        let (mut x, mut y) = (MARGIN, top);
        let all = self.pixels.len().max(1) as f64;
        let mut is_empty = true;
        for (i, class) in self.classes.iter().enumerate() {
            let count = self.count(i);
            if count == 0 {
                continue;
            }
            let text = Text::new([0.0; 2], format!("{} {}", class.name, share(count as f64 / all)), LABEL);
            let needed = SQUARE + 6.0 + text.width();
            if x + needed > width - MARGIN && x > MARGIN {
                (x, y) = (MARGIN, y + LABEL * 1.6);
            }
            page.items.push(Item::Rect([x, y, SQUARE, SQUARE], bytes(class.colour)));
            page.text(Text { at: [x + SQUARE + 6.0, y + SQUARE - 1.5], ..text });
            x += needed + 18.0;
            is_empty = false;
        }
        if is_empty { top - 10.0 } else { y + SQUARE }
    }
}

/// A number of the bar.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) { format!("{}", round(value)) } else { format!("{value:e}") }
}

/// Without the last digits of a power of ten.
fn round(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// A share as a percentage.
fn share(share: f64) -> String {
    match 100.0 * share {
        percent if percent < 0.01 => "< 0.01 %".into(),
        percent if percent < 0.1 => format!("{percent:.2} %"),
        percent if percent < 10.0 => format!("{percent:.1} %"),
        percent => format!("{percent:.0} %"),
    }
}

fn bytes(srgb: [f64; 3]) -> Colour {
    let [r, g, b] = srgb.map(|x| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
    Colour(r, g, b)
}

/// Two pictures, the second below the first; what either leaves free is white.
fn below(first: &Image, second: &Image) -> Image {
    let size = Size { width: first.size.width.max(second.size.width), height: first.size.height + second.size.height };
    let mut all = Image { size, rgb: vec![255; size.width as usize * size.height as usize * 3] };
    let rows = |image: &Image| image.rgb.chunks(image.size.width as usize * 3).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let row = size.width as usize * 3;
    for (i, line) in rows(first).into_iter().chain(rows(second)).enumerate() {
        // In the middle, by whole pixels.
        let at = i * row + (row - line.len()) / 6 * 3;
        all.rgb[at..at + line.len()].copy_from_slice(&line);
    }
    all
}
