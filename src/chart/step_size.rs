//! The error of finite differences against their step, with the window of usable steps.

use std::fmt::Write as _;

use super::drawing::{Anchor, Colour, Drawing, GREY, INK, Item, Point, SHADE, Text};
use super::scale::{Panel, Scale, Words, percent, plain};
use super::{MARGIN, WIDTH, caption, target_words};
use crate::check::Target;
use crate::check::measure::step_size::{FOOTPRINTS, StepSizes, USABLE};
use crate::math::Precision;

/// Heading of [`csv`](StepChart::csv).
pub const CSV_HEADER: &str =
    "formula,points,median_estimate,backend,precision,h,median_error,ninth_decile_error,usable";

/// Errors beyond these are drawn at the edge.
const ERRORS: (f64, f64) = (1e-11, 10.0);

/// One formula's chart.
pub struct StepChart {
    /// Name of the fractal.
    pub formula: String,
    /// What was measured.
    pub sizes: StepSizes,
}

/// Colour of a target's line.
pub(super) fn target_colour(target: Target) -> Colour {
    match target {
        Target::CPU_F32 => Colour(0xd5, 0x5e, 0x00),
        Target::CPU_F64 => Colour(0x00, 0x72, 0xb2),
        Target::Gpu => Colour(0x00, 0x8a, 0x66),
    }
}

/// A target as its line's name.
pub(super) fn target_label(target: Target) -> &'static str {
    match target {
        Target::Cpu(precision) => precision.name(),
        Target::Gpu => "f32 on the GPU",
    }
}

impl StepChart {
    /// The chart.
    pub fn drawing(&self) -> Drawing {
        let mut page =
            Drawing::new(WIDTH, 620.0, format!("{}: error of finite differences against their step", self.formula));
        page.text(Text::new([MARGIN, 44.0], self.formula.clone(), 26.0).bold());
        page.text(Text::new([MARGIN, 70.0], "How far finite differences are off, and which steps h are usable", 15.0));
        let edges = [92.0, 146.0, 930.0, 500.0];
        let [left, top, right, bottom] = edges;
        let steps = &self.sizes.curves[0].errors;
        let panel = Panel {
            x: Scale::between(steps[0].h, steps[steps.len() - 1].h, [left, right]),
            y: Scale::between(ERRORS.0, ERRORS.1, [bottom, top]),
            edges,
        };
        let count = self.sizes.curves.len();
        for (i, curve) in self.sizes.curves.iter().enumerate() {
            if let Some((from, to)) = curve.window() {
                let (from, to) = (panel.x.at(from), panel.x.at(to));
                if i == 0 {
                    page.items.push(Item::Rect([from, top, to - from, bottom - top], SHADE));
                }
            }
        }
        let x = Words { title: "step h, world units".into(), label: plain };
        let y = Words { title: "error of the estimate relative to the exact gradient's".into(), label: percent };
        page.text(Text::new([MARGIN, 94.0], y.title.clone(), 13.0));
        panel.frame(&mut page, &x, &Words { title: String::new(), ..y }, 13.0);
        self.marks(&mut page, &panel);
        for (i, curve) in self.sizes.curves.iter().enumerate() {
            let colour = target_colour(curve.target);
            let line = |read: fn(&crate::check::measure::step_size::StepError) -> f64| -> Vec<Point> {
                curve.errors.iter().map(|e| panel.at((e.h, read(e)))).collect()
            };
            page.dashes(&line(|e| e.ninth), colour, 1.2, 4.0);
            page.line(&line(|e| e.median), colour, 2.4);
            self.window(&mut page, &panel, i, count);
        }
        self.notes(&mut page);
        page
    }

    /// The window of a curve as a bracket under the panel's top, with its name.
    fn window(&self, page: &mut Drawing, panel: &Panel, i: usize, count: usize) {
        let curve = &self.sizes.curves[i];
        let colour = target_colour(curve.target);
        let y = panel.edges[3] - 16.0 - 30.0 * (count - 1 - i) as f64;
        let name = target_label(curve.target);
        match curve.window() {
            Some((from, to)) => {
                let (a, b) = (panel.x.at(from), panel.x.at(to));
                page.line(&[[a, y - 5.0], [a, y + 5.0]], colour, 2.4);
                page.line(&[[b, y - 5.0], [b, y + 5.0]], colour, 2.4);
                page.line(&[[a, y], [b, y]], colour, 2.4);
                let words = format!("{name}: usable from {} to {}", plain(from), plain(to));
                let text = Text::new([a - 9.0, y + 4.5], words, 13.0).colour(colour).halo().bold();
                let fits = a - 9.0 - text.width() > panel.edges[0];
                page.text(match fits {
                    true => text.anchor(Anchor::End),
                    false => Text { at: [(a + b) / 2.0, y - 8.0], anchor: Anchor::Middle, ..text },
                });
            }
            None => {
                let words = format!("{name}: no step is usable");
                page.text(Text::new([panel.edges[0] + 12.0, y + 4.5], words, 13.0).colour(colour).halo().bold());
            }
        }
    }

    /// The limit of usable errors and the steps that marches take.
    fn marks(&self, page: &mut Drawing, panel: &Panel) {
        let [left, top, right, _] = panel.edges;
        let y = panel.y.at(USABLE);
        page.dashes(&[[left, y], [right, y]], INK, 1.0, 3.0);
        let text = format!("usable: median within {}", percent(USABLE));
        page.text(Text::new([left + 0.22 * (right - left), y - 6.0], text, 12.0).halo());
        let marks = [
            (Precision::F32.min_difference(), "least in f32"),
            (Precision::F64.min_difference(), "least in f64"),
            (self.sizes.estimate * 0.01, "0.01 of the estimate"),
            (self.sizes.estimate, "the estimate"),
        ];
        let mut marks = marks.to_vec();
        marks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut last = f64::NEG_INFINITY;
        for (h, words) in marks {
            let x = panel.x.at(h);
            let text = Text::new([x, top - 2.0], words, 11.5).colour(GREY).anchor(Anchor::Middle);
            let raised = x - text.width() / 2.0 < last + 8.0;
            let at = if raised { top - 18.0 } else { top - 2.0 };
            last = x + text.width() / 2.0;
            page.dashes(&[[x, at + 4.0], [x, panel.edges[3]]], GREY, 1.0, 2.0);
            page.text(Text { at: [x, at], ..text });
        }
    }

    fn notes(&self, page: &mut Drawing) {
        let text = format!(
            "Whole lines are medians, dashed ones the error that nine of ten points stay below; errors above {} are drawn at the edge. {} points, \
             each {FOOTPRINTS} footprints in front of a hit of the file's own view; their estimates have a median of {}. Compared with the \
             exact gradient of the same form in f64. A march takes 0.01 of its last estimate as its step, but no less than the \
             precision's least.",
            percent(ERRORS.1),
            self.sizes.points,
            plain(self.sizes.estimate)
        );
        caption(page, &text, [MARGIN, 556.0], WIDTH - 2.0 * MARGIN, 11.0);
    }

    /// A line for each step and target, as [`CSV_HEADER`] names them.
    pub fn csv(&self) -> String {
        let mut out = String::new();
        for curve in &self.sizes.curves {
            let (backend, precision) = target_words(curve.target);
            let window = curve.window();
            for e in &curve.errors {
                let usable = window.is_some_and(|(from, to)| (from..=to).contains(&e.h));
                let _ = writeln!(
                    out,
                    "{},{},{},{backend},{precision},{:e},{:e},{:e},{}",
                    super::csv_field(&self.formula),
                    self.sizes.points,
                    self.sizes.estimate,
                    e.h,
                    e.median,
                    e.ninth,
                    u8::from(usable)
                );
            }
        }
        out
    }
}
