//! The drawing model: what the SVG and the PNG writer both read.
//!
//! Units are pixels of the finished chart at its natural size, x to the right and y down. Texts are strokes of the
//! [`super::font`], so a chart looks the same everywhere and needs no font of the system.

use super::font;
use crate::film::Image;

/// An sRGB colour.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Colour(pub u8, pub u8, pub u8);

/// Text and axes.
pub const INK: Colour = Colour(0x22, 0x22, 0x26);
/// Second-rank text.
pub const GREY: Colour = Colour(0x6a, 0x6c, 0x72);
/// Lines that only lead the eye.
pub const PALE: Colour = Colour(0xb9, 0xbb, 0xc0);
/// Grid lines.
pub const GRID: Colour = Colour(0xe7, 0xe8, 0xea);
/// Shaded areas.
pub const SHADE: Colour = Colour(0xf4, 0xf4, 0xf1);
/// The page.
pub const PAPER: Colour = Colour(0xff, 0xff, 0xff);

/// A point.
pub type Point = [f64; 2];

/// How a text stands at its place.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Anchor {
    /// Starts there.
    Start,
    /// Its middle is there.
    Middle,
    /// Ends there.
    End,
}

/// A line of text.
#[derive(Clone, PartialEq, Debug)]
pub struct Text {
    /// Where the baseline is.
    pub at: Point,
    /// The text; `^` raises the digits and signs that follow.
    pub text: String,
    /// Size in pixels, as of a font.
    pub size: f64,
    /// Colour.
    pub colour: Colour,
    /// Which part of the text stands at `at`.
    pub anchor: Anchor,
    /// Heavier strokes.
    pub bold: bool,
    /// Turned to be read from below.
    pub upright: bool,
    /// A ring of paper around the letters, for texts over lines.
    pub halo: bool,
}

impl Text {
    /// A text of ink that starts at a point.
    pub fn new(at: Point, text: impl Into<String>, size: f64) -> Text {
        Text {
            at,
            text: text.into(),
            size,
            colour: INK,
            anchor: Anchor::Start,
            bold: false,
            upright: false,
            halo: false,
        }
    }

    /// The same in a colour.
    #[must_use]
    pub fn colour(mut self, colour: Colour) -> Text {
        self.colour = colour;
        self
    }

    /// The same with its middle or end at the point.
    #[must_use]
    pub fn anchor(mut self, anchor: Anchor) -> Text {
        self.anchor = anchor;
        self
    }

    /// The same in bold.
    #[must_use]
    pub fn bold(mut self) -> Text {
        self.bold = true;
        self
    }

    /// The same with a ring of paper.
    #[must_use]
    pub fn halo(mut self) -> Text {
        self.halo = true;
        self
    }

    /// The same turned upwards.
    #[must_use]
    pub fn upright(mut self) -> Text {
        self.upright = true;
        self
    }

    /// Width of the letters, in pixels.
    pub fn width(&self) -> f64 {
        font::width(&self.text, self.size)
    }

    /// Width of the pen, in pixels.
    pub fn pen(&self) -> f64 {
        self.size * if self.bold { 0.125 } else { 0.082 }
    }

    /// How far the text starts before `at`, along its own direction.
    pub fn lead(&self) -> f64 {
        match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => self.width() / 2.0,
            Anchor::End => self.width(),
        }
    }
}

/// One thing to draw.
#[derive(Clone, PartialEq, Debug)]
pub enum Item {
    /// A filled rectangle: left, top, width, height.
    Rect([f64; 4], Colour),
    /// A line through points, with its width and the lengths of dashes and gaps (0 for none).
    Line {
        /// Corners.
        points: Vec<Point>,
        /// Colour.
        colour: Colour,
        /// Width of the pen.
        width: f64,
        /// Length of dashes and gaps; 0 is a whole line.
        dash: f64,
    },
    /// Filled circles of one kind.
    Dots {
        /// Centres.
        points: Vec<Point>,
        /// Diameter.
        diameter: f64,
        /// Colour.
        colour: Colour,
    },
    /// An open circle.
    Ring {
        /// Centre.
        centre: Point,
        /// Diameter to the middle of the pen.
        diameter: f64,
        /// Colour.
        colour: Colour,
        /// Width of the pen.
        width: f64,
    },
    /// A filled polygon.
    Area(Vec<Point>, Colour),
    /// A text.
    Text(Text),
    /// A picture in a rectangle: left, top, width, height.
    Picture([f64; 4], Image),
}

/// A chart.
#[derive(Clone, PartialEq, Debug)]
pub struct Drawing {
    /// Width in pixels.
    pub width: f64,
    /// Height in pixels.
    pub height: f64,
    /// What it shows in one line, for those who cannot see it.
    pub title: String,
    /// From back to front.
    pub items: Vec<Item>,
}

impl Drawing {
    /// An empty page.
    pub fn new(width: f64, height: f64, title: impl Into<String>) -> Drawing {
        Drawing { width, height, title: title.into(), items: vec![Item::Rect([0.0, 0.0, width, height], PAPER)] }
    }

    /// Adds a line.
    pub fn line(&mut self, points: &[Point], colour: Colour, width: f64) {
        self.items.push(Item::Line { points: points.to_vec(), colour, width, dash: 0.0 });
    }

    /// Adds a dashed line.
    pub fn dashes(&mut self, points: &[Point], colour: Colour, width: f64, dash: f64) {
        self.items.push(Item::Line { points: points.to_vec(), colour, width, dash });
    }

    /// Adds dots.
    pub fn dots(&mut self, points: &[Point], diameter: f64, colour: Colour) {
        self.items.push(Item::Dots { points: points.to_vec(), diameter, colour });
    }

    /// Adds a text.
    pub fn text(&mut self, text: Text) {
        self.items.push(Item::Text(text));
    }

    /// Pages one below the other.
    pub fn stack(drawings: Vec<Drawing>) -> Drawing {
        let width = drawings.iter().map(|d| d.width).fold(0.0, f64::max);
        let height = drawings.iter().map(|d| d.height).sum();
        let titles: Vec<&str> = drawings.iter().map(|d| d.title.as_str()).collect();
        let mut page = Drawing::new(width, height, titles.join("; "));
        let mut top = 0.0;
        for drawing in drawings {
            let below = top + drawing.height;
            page.items.extend(drawing.items.into_iter().map(|item| item.moved_down(top)));
            top = below;
        }
        page
    }
}

impl Item {
    fn moved_down(self, by: f64) -> Item {
        let all = |points: Vec<Point>| points.into_iter().map(|[x, y]| [x, y + by]).collect();
        match self {
            Item::Rect([x, y, w, h], colour) => Item::Rect([x, y + by, w, h], colour),
            Item::Line { points, colour, width, dash } => Item::Line { points: all(points), colour, width, dash },
            Item::Dots { points, diameter, colour } => Item::Dots { points: all(points), diameter, colour },
            Item::Ring { centre: [x, y], diameter, colour, width } => {
                Item::Ring { centre: [x, y + by], diameter, colour, width }
            }
            Item::Area(points, colour) => Item::Area(all(points), colour),
            Item::Text(text) => Item::Text(Text { at: [text.at[0], text.at[1] + by], ..text }),
            Item::Picture([x, y, w, h], image) => Item::Picture([x, y + by, w, h], image),
        }
    }
}
