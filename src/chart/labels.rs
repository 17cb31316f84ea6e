//! Names beside their lines: each is put where it covers least, near its line, with a leader where it must stand off.

use super::drawing::{Anchor, Colour, Drawing, Point, Text};

/// A name and the points that it may stand at, the best first.
pub struct Label {
    /// The name.
    pub text: String,
    /// Points of its line.
    pub anchors: Vec<Point>,
    /// Colour.
    pub colour: Colour,
    /// Heavier strokes.
    pub bold: bool,
}

/// What is in the way: boxes with what covering them costs.
#[derive(Default)]
pub struct Obstacles {
    boxes: Vec<([f64; 4], f64)>,
}

impl Obstacles {
    /// A marker of this size.
    pub fn point(&mut self, [x, y]: Point, size: f64) {
        self.boxes.push(([x - size / 2.0, y - size / 2.0, x + size / 2.0, y + size / 2.0], 30.0));
    }

    /// A line, which may be crossed where need be.
    pub fn line(&mut self, a: Point, b: Point) {
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let parts = (length / 6.0).ceil().max(1.0) as usize;
        for i in 0..=parts {
            let s = i as f64 / parts as f64;
            let p = [a[0] + (b[0] - a[0]) * s, a[1] + (b[1] - a[1]) * s];
            self.boxes.push(([p[0] - 1.0, p[1] - 1.0, p[0] + 1.0, p[1] + 1.0], 5.0));
        }
    }

    fn cost(&self, place: [f64; 4]) -> f64 {
        let meets = |b: &[f64; 4]| b[0] < place[2] && place[0] < b[2] && b[1] < place[3] && place[1] < b[3];
        self.boxes.iter().filter(|(b, _)| meets(b)).map(|(_, cost)| cost).sum()
    }
}

/// Directions to stand in from a point, and what each costs: beside the line is best.
const DIRECTIONS: [([f64; 2], f64); 8] = [
    ([1.0, 0.0], 0.0),
    ([-1.0, 0.0], 1.0),
    ([0.7, -0.7], 2.0),
    ([0.7, 0.7], 2.0),
    ([-0.7, -0.7], 3.0),
    ([-0.7, 0.7], 3.0),
    ([0.0, -1.0], 4.0),
    ([0.0, 1.0], 4.0),
];
/// Distances to stand off.
const DISTANCES: [f64; 5] = [9.0, 18.0, 32.0, 50.0, 74.0];

/// Places labels inside `edges` (left, top, right, bottom) and draws them with their leaders.
pub fn place(page: &mut Drawing, labels: &[Label], mut obstacles: Obstacles, edges: [f64; 4], size: f64) {
    for label in labels {
        let mut text = Text::new([0.0; 2], label.text.clone(), size).colour(label.colour).halo();
        text.bold = label.bold;
        let width = text.width();
        let mut best: Option<(f64, Point, Point, [f64; 4])> = None;
        for (i, anchor) in label.anchors.iter().enumerate() {
            for (direction, bias) in DIRECTIONS {
                for distance in DISTANCES {
                    let start = [anchor[0] + direction[0] * distance, anchor[1] + direction[1] * distance];
                    let left = start[0] - width * (1.0 - direction[0].signum() * f64::from(direction[0] != 0.0)) / 2.0;
                    let place = [left - 2.0, start[1] - size * 0.55, left + width + 2.0, start[1] + size * 0.55];
                    let outside =
                        place[0] < edges[0] || place[1] < edges[1] || place[2] > edges[2] || place[3] > edges[3];
                    if outside {
                        continue;
                    }
                    let cost = obstacles.cost(place) + bias + distance * 0.5 + i as f64 * 2.0;
                    if best.as_ref().is_none_or(|b| cost < b.0) {
                        best = Some((cost, *anchor, start, place));
                    }
                }
            }
        }
        let Some((_, anchor, start, place)) = best else { continue };
        if (start[0] - anchor[0]).hypot(start[1] - anchor[1]) > 12.0 {
            page.line(&[anchor, start], label.colour, 0.8);
        }
        text.at = [place[0] + 2.0, start[1] + size * 0.32];
        text.anchor = Anchor::Start;
        page.text(text);
        obstacles.boxes.push((place, 400.0));
    }
}
