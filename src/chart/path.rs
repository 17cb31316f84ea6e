//! The way of a camera: seen from above and from the side, its clearance and its pace over time.

use super::drawing::{Anchor, Colour, Drawing, GREY, INK, PALE, Point, Text};
use super::scale::{Panel, Scale, Words, plain};
use super::{MARGIN, WIDTH};
use crate::engine::path::Place;

const WAY: Colour = Colour(0x00, 0x72, 0xb2);
const LOOK: Colour = Colour(0xd5, 0x5e, 0x00);
const PACE: Colour = Colour(0x00, 0x8a, 0x66);

/// A film's camera: a place a frame.
pub struct PathChart {
    /// Name of the scene.
    pub name: String,
    /// The places, in the order of their times.
    pub places: Vec<Place>,
}

impl PathChart {
    /// Speed at each place but the first, in distances to the surface a second.
    pub fn paces(&self) -> Vec<(f64, f64)> {
        let pace = |pair: &[Place]| {
            let moved = [0, 1, 2].map(|k| pair[1].camera.position[k] - pair[0].camera.position[k]);
            let way = moved.iter().map(|x| x * x).sum::<f64>().sqrt();
            let clearance = f64::midpoint(pair[0].clearance, pair[1].clearance);
            (pair[1].time, way / clearance.max(1e-300) / (pair[1].time - pair[0].time))
        };
        self.places.windows(2).map(pace).collect()
    }

    /// The chart.
    pub fn drawing(&self) -> Drawing {
        let mut page = Drawing::new(WIDTH, 860.0, format!("{}: the camera's way", self.name));
        page.text(Text::new([MARGIN, 44.0], self.name.clone(), 26.0).bold());
        let (first, last) = (self.places[0].time, self.places[self.places.len() - 1].time);
        let words = format!("The camera's way in {} frames, {:.2} s", self.places.len(), last - first);
        page.text(Text::new([MARGIN, 70.0], words, 15.0));
        self.map(&mut page, [0, 1], "from above", [MARGIN, 100.0, 470.0, 430.0]);
        self.map(&mut page, [0, 2], "from the side", [490.0, 100.0, 932.0, 430.0]);
        let clearance: Vec<(f64, f64)> = self.places.iter().map(|place| (place.time, place.clearance)).collect();
        self.course(&mut page, &clearance, "distance to the surface, world units", [92.0, 490.0, 932.0, 630.0]);
        let paces = self.paces();
        self.course(&mut page, &paces, "speed, distances to the surface a second", [92.0, 690.0, 932.0, 820.0]);
        page
    }

    /// Two coordinates of the way, and where the camera looks.
    fn map(&self, page: &mut Drawing, [u, v]: [usize; 2], title: &str, [left, top, right, bottom]: [f64; 4]) {
        let position = |place: &Place| [place.camera.position[u], place.camera.position[v]];
        let ranges = [0, 1].map(|k| {
            let values = self.places.iter().map(|place| position(place)[k]);
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        });
        let size = ranges.iter().map(|(low, high)| high - low).fold(1e-12, f64::max);
        let scale = 0.82 * (right - left).min(bottom - top) / size;
        let middle = ranges.map(|(low, high)| f64::midpoint(low, high));
        let at = |[x, y]: [f64; 2]| -> Point {
            [f64::midpoint(left, right) + (x - middle[0]) * scale, f64::midpoint(top, bottom) - (y - middle[1]) * scale]
        };
        let frame = [[left, top], [right, top], [right, bottom], [left, bottom], [left, top]];
        page.line(&frame, PALE, 1.0);
        let name = |k: usize| ["x", "y", "z"][k];
        let text =
            format!("{title}: {} to the right, {} upwards, {} world units across", name(u), name(v), short(size));
        page.text(Text::new([left + 8.0, top + 18.0], text, 13.0).colour(GREY));
        let points: Vec<Point> = self.places.iter().map(|place| at(position(place))).collect();
        page.line(&points, WAY, 2.2);
        let every = (self.places.len() / 24).max(1);
        for place in self.places.iter().step_by(every) {
            let from = position(place);
            let to = [place.camera.target[u], place.camera.target[v]];
            let way = [to[0] - from[0], to[1] - from[1]];
            let length = way[0].hypot(way[1]).max(1e-300);
            let [a, b] = at(from);
            page.line(&[[a, b], [a + 16.0 * way[0] / length, b - 16.0 * way[1] / length]], LOOK, 1.4);
        }
        page.dots(&points[..1], 9.0, INK);
        page.text(Text::new([points[0][0] + 8.0, points[0][1] - 6.0], "start", 13.0).halo());
    }

    /// Numbers over time.
    fn course(&self, page: &mut Drawing, points: &[(f64, f64)], title: &str, edges: [f64; 4]) {
        let [left, top, right, bottom] = edges;
        let (first, last) = (self.places[0].time, self.places[self.places.len() - 1].time);
        let y = Scale::fit(points.iter().map(|point| point.1), [bottom, top]);
        let at = |(time, value): (f64, f64)| [left + (right - left) * (time - first) / (last - first), y.at(value)];
        // Seconds are no logarithms: they are written below.
        let panel = Panel { x: Scale::between(1.11, 1.12, [left, right]), y, edges };
        let words = |title: &str| Words { title: title.into(), label: plain };
        panel.frame(page, &words(""), &words(title), 13.0);
        for i in 0..=4 {
            let time = first + (last - first) * f64::from(i) / 4.0;
            let place = [left + (right - left) * f64::from(i) / 4.0, bottom + 19.0];
            page.text(Text::new(place, format!("{time:.1} s"), 13.0).colour(GREY).anchor(Anchor::Middle));
        }
        page.line(&points.iter().map(|point| at(*point)).collect::<Vec<Point>>(), PACE, 2.0);
    }
}

/// A number with three digits.
fn short(x: f64) -> String {
    if (0.01..1000.0).contains(&x) { format!("{x:.3}") } else { format!("{x:.2e}") }
}
