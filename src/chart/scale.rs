//! Logarithmic axes with a place of their own for 0, and the frames of panels.

use super::drawing::{Anchor, Drawing, GREY, GRID, INK, PALE, Point, Text};

/// Room between the end of the logarithmic part and the place of 0, in pixels.
const ZERO_GAP: f64 = 26.0;
/// Room between that place and the panel's edge.
const ZERO_EDGE: f64 = 12.0;

/// A logarithmic axis: values from `low` to `high` between two places on the page.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Scale {
    /// The least value; above 0.
    pub low: f64,
    /// The largest.
    pub high: f64,
    /// Where `low` is.
    pub from: f64,
    /// Where `high` is.
    pub to: f64,
    /// Where 0 is, on axes that have a place for it.
    pub zero: Option<f64>,
}

impl Scale {
    /// An axis that holds all of `values` that are above 0 and finite, with some room, and 0 if any of them is.
    /// `edges` are the panel's, the first where small values are.
    pub fn fit(values: impl Iterator<Item = f64>, edges: [f64; 2]) -> Scale {
        let (mut low, mut high, mut has_zero) = (f64::INFINITY, 0.0, false);
        for value in values.filter(|v| v.is_finite()) {
            has_zero |= value <= 0.0;
            if value > 0.0 {
                (low, high) = (value.min(low), value.max(high));
            }
        }
        if low > high {
            (low, high) = (0.1, 1.0);
        }
        let room = ((high / low).ln() * 0.06).max(0.35).exp();
        let zero = has_zero.then(|| edges[0] + ZERO_EDGE * (edges[1] - edges[0]).signum());
        Scale { low: low / room, high: high * room, from: edges[0], to: edges[1], zero }.with_gap()
    }

    /// An axis with given ends.
    pub fn between(low: f64, high: f64, edges: [f64; 2]) -> Scale {
        Scale { low, high, from: edges[0], to: edges[1], zero: None }
    }

    fn with_gap(mut self) -> Scale {
        if self.zero.is_some() {
            self.from += ZERO_GAP * (self.to - self.from).signum();
        }
        self
    }

    /// The place of a value. What is outside, infinite or not a number is at the nearest end (the upper one).
    pub fn at(&self, value: f64) -> f64 {
        if value <= 0.0 {
            return self.zero.unwrap_or(self.from);
        }
        let value = if value.is_finite() { value.clamp(self.low, self.high) } else { self.high };
        self.from + (self.to - self.from) * (value / self.low).ln() / (self.high / self.low).ln()
    }

    /// Values to label: decades, with 2 and 5 between them where there are few, every third where there are many.
    pub fn ticks(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        let parts: &[f64] = match decades {
            d if d < 1.0 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
            d if d < 3.0 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let every = (decades / 8.0).ceil().max(1.0) as i32;
        let first = self.low.log10().floor() as i32;
        let last = self.high.log10().ceil() as i32;
        (first..=last)
            .filter(|e| e.rem_euclid(every) == 0)
            .flat_map(|e| parts.iter().map(move |p| p * 10f64.powi(e)))
            .filter(|v| (self.low * 0.999..=self.high * 1.001).contains(v))
            .collect()
    }
}

/// Words for an axis and its numbers.
pub struct Words {
    /// What is measured, in which unit.
    pub title: String,
    /// A value as the axis shows it.
    pub label: fn(f64) -> String,
}

/// Two axes and the panel between them.
pub struct Panel {
    /// The horizontal one.
    pub x: Scale,
    /// The vertical one.
    pub y: Scale,
    /// Left, top, right, bottom.
    pub edges: [f64; 4],
}

impl Panel {
    /// A panel whose scales hold all of the points.
    pub fn fit(points: &[(f64, f64)], edges: [f64; 4]) -> Panel {
        let [left, top, right, bottom] = edges;
        let x = Scale::fit(points.iter().map(|p| p.0), [left, right]);
        let y = Scale::fit(points.iter().map(|p| p.1), [bottom, top]);
        Panel { x, y, edges }
    }

    /// The place of a point.
    pub fn at(&self, (x, y): (f64, f64)) -> Point {
        [self.x.at(x), self.y.at(y)]
    }

    /// Draws grid, axes and words; the vertical axis is titled above its upper end, so that all texts lie flat.
    pub fn frame(&self, page: &mut Drawing, x: &Words, y: &Words, size: f64) {
        let [left, top, right, bottom] = self.edges;
        let label = |at: Point, text: String| Text::new(at, text, size).colour(GREY);
        let mut last = f64::NEG_INFINITY;
        for tick in self.x.ticks() {
            let at = self.x.at(tick);
            page.line(&[[at, top], [at, bottom]], GRID, 1.0);
            let text = label([at, bottom + size * 1.45], (x.label)(tick)).anchor(Anchor::Middle);
            if at - text.width() / 2.0 > last + size * 0.6 {
                last = at + text.width() / 2.0;
                page.text(text);
            }
        }
        for tick in self.y.ticks() {
            let at = self.y.at(tick);
            page.line(&[[left, at], [right, at]], GRID, 1.0);
            page.text(label([left - size * 0.6, at + size * 0.35], (y.label)(tick)).anchor(Anchor::End));
        }
        if let Some(zero) = self.y.zero {
            page.dashes(&[[left, zero], [right, zero]], PALE, 1.0, 2.0);
            page.text(label([left - size * 0.6, zero + size * 0.35], "none".into()).anchor(Anchor::End));
        }
        page.line(&[[left, bottom], [right, bottom]], PALE, 1.0);
        let title = |at, text: &str| Text::new(at, text, size).colour(INK);
        page.text(title([right, bottom + size * 3.0], &x.title).anchor(Anchor::End));
        page.text(title([left, top - size * 0.8], &y.title));
    }
}

/// A share as per cent.
pub fn percent(share: f64) -> String {
    format!("{} %", plain(share * 100.0))
}

/// A number with as few digits as it needs; powers of ten where it is very large or small.
pub fn plain(value: f64) -> String {
    let exponent = value.abs().log10();
    if value == 0.0 {
        return "0".into();
    }
    if !(-3.01..5.0).contains(&exponent) {
        return format!("10^{}", exponent.round());
    }
    let digits = (2.0 - exponent.floor()).clamp(0.0, 4.0) as usize;
    let text = format!("{value:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    }
}

/// A time in the unit that suits it.
pub fn nanoseconds(ns: f64) -> String {
    match ns {
        ns if ns < 1e3 => format!("{} ns", plain(ns)),
        ns if ns < 1e6 => format!("{} \u{b5}s", plain(ns / 1e3)),
        ns => format!("{} ms", plain(ns / 1e6)),
    }
}

#[cfg(test)]
mod tests {
    use super::{Scale, nanoseconds, percent, plain};

    #[test]
    fn scales_hold_their_values_and_zero_has_its_own_place() {
        let scale = Scale::fit([0.0, 0.01, 1.0, f64::INFINITY].into_iter(), [400.0, 100.0]);
        let places = [0.0, 0.01, 0.1, 1.0, f64::INFINITY].map(|v| scale.at(v));
        assert!(places.windows(2).all(|w| w[0] > w[1]), "{places:?}");
        assert!(places.iter().all(|p| (100.0..=400.0).contains(p)), "{places:?}");
        let middle = (scale.at(0.01) + scale.at(1.0)) / 2.0;
        assert!((scale.at(0.1) - middle).abs() < 1e-9);
        assert!(Scale::fit(std::iter::empty(), [0.0, 1.0]).at(0.5).is_finite());
    }

    #[test]
    fn ticks_are_round_and_inside() {
        for (low, high) in [(0.3, 2.0), (0.03, 2.0), (1e-12, 0.3), (1.0, 1.5)] {
            let scale = Scale::between(low, high, [0.0, 100.0]);
            let ticks = scale.ticks();
            assert!((2..=9).contains(&ticks.len()), "{low} {high} {ticks:?}");
        }
    }

    #[test]
    fn numbers_are_short() {
        let shown = [0.5, 12.0, 0.004, 1500.0, 1e6, 1e-7, 0.0].map(plain);
        assert_eq!(shown, ["0.5", "12", "0.004", "1500", "10^6", "10^-7", "0"]);
        assert_eq!((percent(0.025).as_str(), nanoseconds(20_000.0).as_str()), ("2.5 %", "20 \u{b5}s"));
    }
}
