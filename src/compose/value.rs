//! A field at a point: its distance, what goes with it, and how two of them are joined.

use super::matter::{Place, joined};
use crate::expr::Expr;
use crate::kernel::records::Matter;

/// A field at a point.
#[derive(Clone, Copy)]
pub(super) struct FieldValue<'g> {
    /// Distance, below 0 inside where that is known.
    pub(super) d: Expr<'g>,
    /// Whether the point is in.
    pub(super) inside: Expr<'g>,
    /// Where the point is out, but the distance is not known: it is in what was cut away, at an unknown depth. Nowhere where
    /// absent.
    pub(super) unclear: Option<Expr<'g>>,
    /// Where the point is in, but not how deep.
    pub(super) shallow: Option<Expr<'g>>,
    /// For surfaces: unit gradient.
    pub(super) gradient: Option<Expr<'g>>,
    /// For surfaces: traps.
    pub(super) trap: Option<Expr<'g>>,
    /// For painted surfaces that have parts: what they are made of.
    pub(super) matter: Option<Matter<Expr<'g>>>,
    /// For painted surfaces without parts: what is known of the place, of which matter is made once all are joined.
    pub(super) place: Option<Place<'g>>,
    /// For decisions: number of the decider.
    pub(super) decider: Option<Expr<'g>>,
}

impl<'g> FieldValue<'g> {
    /// A distance and membership alone.
    pub(super) fn plain(d: Expr<'g>, inside: Expr<'g>) -> FieldValue<'g> {
        let (unclear, shallow) = (None, None);
        FieldValue { d, inside, unclear, shallow, gradient: None, trap: None, matter: None, place: None, decider: None }
    }

    /// The first field where the condition holds, with another distance and membership.
    fn pick(self, other: Self, first: Expr<'g>, d: Expr<'g>, inside: Expr<'g>) -> Self {
        let pick = |a: Option<Expr<'g>>, b: Option<Expr<'g>>| a.zip(b).map(|(a, b)| first.select(a, b));
        let either = |a: Option<Expr<'g>>, b: Option<Expr<'g>>| a.zip(b).map_or(a.or(b), |(a, b)| Some(a.or(b)));
        FieldValue {
            d,
            inside,
            unclear: either(self.unclear, other.unclear).map(|unclear| unclear.and(!inside)),
            shallow: either(self.shallow, other.shallow).map(|shallow| shallow.and(inside)),
            gradient: pick(self.gradient, other.gradient),
            trap: pick(self.trap, other.trap),
            matter: joined(self.matter, other.matter, |a, b| first.select(a, b)),
            place: Place::joined(self.place, other.place, |a, b| first.select(a, b)),
            decider: pick(self.decider, other.decider),
        }
    }

    /// The union of both.
    pub(super) fn nearer(self, other: Self) -> Self {
        self.pick(other, self.d.le(other.d), self.d.min(other.d), self.inside.or(other.inside))
    }

    /// What both share.
    pub(super) fn farther(self, other: Self) -> Self {
        self.pick(other, other.d.le(self.d), self.d.max(other.d), self.inside.and(other.inside))
    }

    /// What the field leaves of all.
    pub(super) fn turned(self) -> Self {
        let (unclear, shallow) = (self.shallow, self.unclear);
        FieldValue { d: -self.d, inside: !self.inside, unclear, shallow, gradient: self.gradient.map(|g| -g), ..self }
    }

    /// The union with a rounded seam, by the polynomial smooth minimum: at most a quarter of the radius below the smaller
    /// one, with slope 1 (Quilez).
    pub(super) fn smooth(self, other: Self, radius: f64) -> Self {
        let zero = self.d.lift(0.0);
        let overlap = (self.d.lift(radius) - (self.d - other.d).abs()).max(zero) * (1.0 / radius);
        let d = self.d.min(other.d) - overlap * overlap * (radius * 0.25);
        // A distance that is not known is 0 and no evidence of a seam.
        let is_known = [self.unclear, other.unclear].into_iter().flatten().map(|unclear| !unclear);
        let seam = is_known.fold(d.le(zero), |seam, known| seam.and(known));
        let inside = self.inside.or(other.inside).or(seam);
        let share = overlap * 0.5;
        let near = self.d.le(other.d);
        let blend = |a: Expr<'g>, b: Expr<'g>| near.select(a.mix(b, share), b.mix(a, share));
        let blended = |a: Option<Expr<'g>>, b: Option<Expr<'g>>| a.zip(b).map(|(a, b)| blend(a, b));
        let (gradient, matter) = (blended(self.gradient, other.gradient), joined(self.matter, other.matter, blend));
        let place = Place::joined(self.place, other.place, blend);
        FieldValue { gradient, matter, place, ..self.pick(other, near, d, inside) }
    }
}
