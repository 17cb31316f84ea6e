//! Gradients: stops mixed in OKLab.

use super::space::{Rgb, compose_from_oklab, from_oklab, oklab};
use crate::expr::{Arena, Expr};

/// Most stops of a gradient; files with more are simplified.
pub const MOST_STOPS: usize = 64;
/// Distance in OKLab below which a simplified gradient may be off: half of what the eye tells apart side by side.
const UNSEEN: f64 = 0.006;

/// A colour at a place.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Stop {
    /// From 0 to 1.
    pub at: f64,
    /// Its colour.
    pub colour: Rgb,
}

/// Colours from 0 to 1: stops in order, at least one; between two of them colours are mixed in OKLab.
#[derive(Clone, PartialEq, Debug)]
pub struct Gradient {
    stops: Vec<Stop>,
    is_cyclic: bool,
}

impl Gradient {
    /// A gradient of stops, which are put in order; `None` where there are none, or where something is not a number. A cyclic one goes on from its last stop to its
    /// first. Two stops at one place make an edge.
    pub fn new(mut stops: Vec<Stop>, is_cyclic: bool) -> Option<Gradient> {
        let is_usable = |stop: &Stop| stop.at.is_finite() && stop.colour.iter().all(|part| part.is_finite());
        if stops.is_empty() || !stops.iter().all(is_usable) {
            return None;
        }
        stops.iter_mut().for_each(|stop| stop.at = stop.at.clamp(0.0, 1.0));
        stops.sort_by(|a, b| a.at.total_cmp(&b.at));
        Some(Gradient { stops: simplified(stops), is_cyclic })
    }

    /// Colours at equal distances: from 0 to 1, or all around where the gradient is cyclic.
    pub fn even(colours: &[Rgb], is_cyclic: bool) -> Option<Gradient> {
        let gaps = if is_cyclic { colours.len() } else { colours.len() - usize::from(colours.len() > 1) };
        let stop = |(i, colour): (usize, &Rgb)| Stop { at: i as f64 / gaps.max(1) as f64, colour: *colour };
        Gradient::new(colours.iter().enumerate().map(stop).collect(), is_cyclic)
    }

    /// The stops, in order.
    pub fn stops(&self) -> &[Stop] {
        &self.stops
    }

    /// Whether 1 goes on at 0; otherwise what lies outside has the colour of the end.
    pub fn is_cyclic(&self) -> bool {
        self.is_cyclic
    }

    /// The same colours, all around or not.
    #[must_use]
    pub fn with_cycle(mut self, is_cyclic: bool) -> Gradient {
        self.is_cyclic = is_cyclic;
        self
    }

    /// The stops between which colours are mixed: of a cyclic gradient those beyond both ends, too.
    fn knots(&self) -> Vec<Stop> {
        let mut knots = self.stops.clone();
        if let ([first, ..], [.., last]) = (&self.stops[..], &self.stops[..])
            && self.is_cyclic
        {
            knots.insert(0, Stop { at: last.at - 1.0, ..*last });
            knots.push(Stop { at: first.at + 1.0, ..*first });
        }
        knots
    }

    /// The colour at `t`.
    pub fn at(&self, t: f64) -> Rgb {
        let t = if self.is_cyclic { t - t.floor() } else { t };
        let knots = self.knots();
        let after = knots.partition_point(|knot| knot.at <= t);
        let (a, b) = (knots[after.saturating_sub(1)], knots[after.min(knots.len() - 1)]);
        if after == 0 || after == knots.len() || a.colour == b.colour {
            return a.colour;
        }
        let share = (t - a.at) / (b.at - a.at);
        let (from, to) = (oklab(a.colour), oklab(b.colour));
        from_oklab([0, 1, 2].map(|i| from[i] + (to[i] - from[i]) * share)).map(|part| part.max(0.0))
    }

    /// The colour at an expression: a sum with a term for each pair of stops, and one way back from OKLab.
    pub fn compose<'g>(&self, arena: &'g Arena, t: Expr<'g>) -> Expr<'g> {
        let t = if self.is_cyclic { t - t.floor() } else { t };
        let knots = self.knots();
        let mut lab = arena.v3(oklab(knots[0].colour));
        for pair in knots.windows(2) {
            let (from, to) = (oklab(pair[0].colour), oklab(pair[1].colour));
            let change = arena.v3([0, 1, 2].map(|i| to[i] - from[i]));
            let width = pair[1].at - pair[0].at;
            let share = match width > 1e-6 {
                true => ((t - pair[0].at) * (1.0 / width)).clamp(arena.f(0.0), arena.f(1.0)),
                false => arena.f(pair[1].at).le(t).select(arena.f(1.0), arena.f(0.0)),
            };
            lab = lab + change * share;
        }
        compose_from_oklab(lab)
    }
}

/// The stops without those that others make nearly the same of, as few as [`MOST_STOPS`].
fn simplified(stops: Vec<Stop>) -> Vec<Stop> {
    let labs: Vec<[f64; 3]> = stops.iter().map(|stop| oklab(stop.colour)).collect();
    let mut kept = vec![0, stops.len() - 1];
    kept.dedup();
    // The worst stop is taken in until none is worth it (Ramer, Douglas and Peucker).
    while kept.len() < MOST_STOPS {
        let off = |i: usize, a: usize, b: usize| {
            let width = (stops[b].at - stops[a].at).max(1e-12);
            let share = (stops[i].at - stops[a].at) / width;
            (0..3).map(|k| (labs[a][k] + (labs[b][k] - labs[a][k]) * share - labs[i][k]).powi(2)).sum::<f64>().sqrt()
        };
        let worst = kept.windows(2).flat_map(|pair| (pair[0] + 1..pair[1]).map(move |i| (i, pair[0], pair[1])));
        let worst = worst.map(|(i, a, b)| (off(i, a, b), i)).max_by(|a, b| a.0.total_cmp(&b.0));
        match worst.filter(|(off, _)| *off > UNSEEN || stops.len() <= MOST_STOPS / 4) {
            Some((_, i)) => {
                kept.push(i);
                kept.sort_unstable();
            }
            None => break,
        }
    }
    kept.into_iter().map(|i| stops[i]).collect()
}

#[cfg(test)]
mod tests {
    use super::{Gradient, Stop};

    #[test]
    fn stops_are_met_and_ends_stay() {
        let colours = [[0.0; 3], [0.5, 0.1, 0.0], [1.0; 3]];
        let gradient = Gradient::even(&colours, false).expect("three stops");
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        for (t, colour) in
            [(-3.0, colours[0]), (0.0, colours[0]), (0.5, colours[1]), (1.0, colours[2]), (9.0, colours[2])]
        {
            assert!(near(gradient.at(t), colour), "{t}: {:?}", gradient.at(t));
        }
        // Halfway between black and white OKLab is half as light: 0.5 cubed.
        let grey = Gradient::even(&[[0.0; 3], [1.0; 3]], false).expect("two stops").at(0.5);
        assert!(near(grey, [0.125; 3]), "{grey:?}");
    }

    #[test]
    fn cyclic_gradients_go_around() {
        let gradient = Gradient::even(&[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], true).expect("two stops");
        assert_eq!(gradient.at(0.0), gradient.at(1.0));
        assert_eq!(gradient.at(0.25), gradient.at(-0.75));
        let (a, b) = (gradient.at(0.25), gradient.at(0.75));
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9), "{a:?} {b:?}");
    }

    #[test]
    fn long_lists_become_short() {
        let stops = (0..256).map(|i| Stop { at: f64::from(i) / 255.0, colour: [(f64::from(i) / 255.0).powi(3); 3] });
        let gradient = Gradient::new(stops.collect(), false).expect("stops");
        assert!(gradient.stops().len() < 4, "{}", gradient.stops().len());
        assert!(Gradient::new(vec![], false).is_none());
        assert!(Gradient::new(vec![Stop { at: f64::NAN, colour: [0.0; 3] }], false).is_none());
    }
}
