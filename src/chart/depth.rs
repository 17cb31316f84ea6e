//! Error against zoom, with the places where precisions end.

use std::fmt::Write as _;

use super::drawing::{Anchor, Drawing, GREY, INK, Point, Text};
use super::scale::{Panel, Scale, Words, percent, plain};
use super::step_size::{target_colour, target_label};
use super::{MARGIN, WIDTH, caption, method_name, target_words};
use crate::check::Target;
use crate::check::measure::Measured;
use crate::check::measure::depth::{Depths, GOOD, SETTLED};

/// Heading of [`csv`](DepthChart::csv).
pub const CSV_HEADER: &str =
    "formula,method,fudge,rays,zoom,settled,backend,precision,median_error_footprints,missed,early,unfinished,nan,good";

/// Errors in footprints beyond these are drawn at the edge.
const ERRORS: (f64, f64) = (1e-3, 1e3);

/// One formula's chart.
pub struct DepthChart {
    /// Name of the fractal.
    pub formula: String,
    /// What was measured.
    pub depths: Depths,
}

impl DepthChart {
    /// Targets, each with its last good zoom.
    fn ends(&self) -> Vec<(Target, Option<f64>)> {
        let targets = self.depths.zooms[0].measured.iter().map(|(target, _)| *target);
        targets.map(|target| (target, self.depths.end_of(target))).collect()
    }

    /// The chart.
    pub fn drawing(&self) -> Drawing {
        let mut page = Drawing::new(WIDTH, 656.0, format!("{}: depth error against zoom", self.formula));
        page.text(Text::new([MARGIN, 44.0], self.formula.clone(), 26.0).bold());
        page.text(Text::new([MARGIN, 70.0], "How far depths are off when the camera moves towards the surface", 15.0));
        let zooms = &self.depths.zooms;
        let x = Scale::between(1.0, zooms[zooms.len() - 1].zoom, [92.0, 900.0]);
        let errors =
            Panel { x, y: Scale::between(ERRORS.0, ERRORS.1, [350.0, 120.0]), edges: [92.0, 120.0, 900.0, 350.0] };
        let wrong = Panel {
            x,
            y: Scale::fit([0.0, 0.02, 1.0].into_iter(), [520.0, 410.0]),
            edges: [92.0, 410.0, 900.0, 520.0],
        };
        let words = |title: &str, label| Words { title: title.into(), label };
        errors.frame(&mut page, &words("", plain), &words("median depth error, footprints", plain), 13.0);
        let zoom = words("zoom: how many times nearer the camera is than in the file's view", plain);
        wrong.frame(&mut page, &zoom, &words("missed + early", percent), 13.0);
        let limit = errors.y.at(GOOD);
        page.dashes(&[[92.0, limit], [900.0, limit]], INK, 1.0, 3.0);
        page.text(Text::new([100.0, limit - 6.0], "half a footprint", 12.0).halo());
        for (target, end) in self.ends() {
            let colour = target_colour(target);
            page.line(&self.line(&errors, target, |m| m.median_error), colour, 2.4);
            page.line(&self.line(&wrong, target, Measured::wrong), colour, 2.0);
            let line = self.line(&errors, target, |m| m.median_error);
            page.dots(&line, 6.5, colour);
            if let Some([x, y]) = line.last() {
                page.text(Text::new([x + 10.0, y + 4.5], target_label(target), 13.0).colour(colour).bold());
            }
            if let Some(end) = end {
                let at = x.at(end);
                page.dashes(&[[at, 112.0], [at, 520.0]], colour, 1.4, 4.0);
                let words = format!("{} is good to {}", target_label(target), plain(end));
                let text = Text::new([at, 106.0], words, 13.0).colour(colour).bold();
                page.text(if at > 700.0 { text.anchor(Anchor::End) } else { text.anchor(Anchor::Middle) });
            }
        }
        self.notes(&mut page);
        page
    }

    fn line(&self, panel: &Panel, target: Target, read: fn(&Measured) -> f64) -> Vec<Point> {
        let judged = self.depths.zooms.iter().filter(|z| z.settled >= SETTLED);
        judged
            .flat_map(|z| z.measured.iter().filter(move |(t, _)| *t == target).map(move |(_, m)| (z.zoom, read(m))))
            .map(|p| panel.at(p))
            .collect()
    }

    fn notes(&self, page: &mut Drawing) {
        let candidate = &self.depths.candidate;
        let last = self.depths.zooms.iter().rfind(|z| z.settled >= SETTLED);
        let text = format!(
            "Method {} at fudge {}, {} rays a zoom towards the hit nearest to the middle of the file's view. The truth is found in \
             f64 by fixed small steps at each zoom; zooms where fewer than {} of the rays settle on a hit are left out; the last one shown is {}. Truth and march share f64, \
             so its own rounding shows only where they differ. A footprint is a pixel's diameter at the hit. Values beyond the panel's ends \
             are drawn at its edge.",
            method_name(candidate.method),
            plain(candidate.fudge),
            self.depths.rays,
            percent(SETTLED),
            last.map_or("0".into(), |z| plain(z.zoom))
        );
        let below = caption(page, &text, [MARGIN, 582.0], WIDTH - 2.0 * MARGIN, 11.0);
        let ends = self.ends();
        let end = |wanted: Target| ends.iter().find(|(t, _)| *t == wanted).and_then(|(_, end)| *end);
        if let (Some(single), Some(double)) = (end(Target::CPU_F32), end(Target::CPU_F64)) {
            let text =
                format!("f32 is within half a footprint up to zoom {}, f64 up to {}.", plain(single), plain(double));
            page.text(Text::new([MARGIN, below + 4.0], text, 11.0).colour(GREY));
        }
    }

    /// A line for each zoom and target, as [`CSV_HEADER`] names them.
    pub fn csv(&self) -> String {
        let mut out = String::new();
        for z in &self.depths.zooms {
            for (target, m) in &z.measured {
                let (backend, precision) = target_words(*target);
                let good = z.settled >= SETTLED && m.median_error <= GOOD;
                let _ = writeln!(
                    out,
                    "{},{},{},{},{:e},{},{backend},{precision},{:e},{},{},{},{},{}",
                    super::csv_field(&self.formula),
                    method_name(self.depths.candidate.method),
                    self.depths.candidate.fudge,
                    self.depths.rays,
                    z.zoom,
                    z.settled,
                    m.median_error,
                    m.missed,
                    m.early,
                    m.unfinished,
                    m.nan,
                    u8::from(good)
                );
            }
        }
        out
    }
}
