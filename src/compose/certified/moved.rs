//! What becomes of a ball or a segment in a map.

use super::rules::{Line, RuleInputs, Tangent, step_rule};
use crate::compose::maps::condition;
use crate::compose::{ComposeResult, Composer};
use crate::expr::Expr;
use crate::expr::enclose::UNBOUNDED;
use crate::graph::{Condition, MapTree, NodeRef};

/// How much worse than the factor a segment's bound may be before it starts again: its direction is worth something.
const KEPT: f64 = 1.1;

/// Where a ball or segment has come to.
#[derive(Clone, Copy)]
pub(super) struct Moved<'g> {
    /// The centre.
    pub(super) z: Expr<'g>,
    /// Distance from it per distance from the start.
    pub(super) l: Expr<'g>,
    /// Rounding errors.
    pub(super) eta: Expr<'g>,
    /// Of a segment: derivative v by its parameter, and rho.
    pub(super) segment: Option<(Expr<'g>, Expr<'g>)>,
}

impl<'g> Moved<'g> {
    /// Each part made another, with its name.
    pub(super) fn map(&self, mut other: impl FnMut(&str, Expr<'g>) -> Expr<'g>) -> Moved<'g> {
        Moved {
            z: other("z", self.z),
            l: other("l", self.l),
            eta: other("eta", self.eta),
            segment: self.segment.map(|(v, rho)| (other("v", v), other("rho", rho))),
        }
    }

    /// The factor is the smaller of its own and the segment's, both being bounds; the segment starts again where it has
    /// become worse, or is not a number.
    pub(super) fn settled(self) -> Moved<'g> {
        let Some((v, rho)) = self.segment else { return self };
        let along = v.length() + rho;
        let kept = along.le(self.l * KEPT);
        Moved {
            l: along.lt(self.l).select(along, self.l),
            segment: Some((kept.select(v, v.lift(0.0)), kept.select(rho, self.l))),
            ..self
        }
    }
}

/// What all iterations read.
pub(super) struct Context<'a, 's> {
    pub(super) composer: &'s Composer<'a>,
    /// The start radius.
    pub(super) e0: Expr<'a>,
    /// The iteration's constant and its factor.
    pub(super) c: Expr<'a>,
    pub(super) c_l: Expr<'a>,
    pub(super) n: Expr<'a>,
    /// Relative error of one operation.
    pub(super) unit: f64,
}

impl<'a> Context<'a, '_> {
    /// The image of what is settled; it is not settled itself, since a constant may follow.
    pub(super) fn apply(&self, map: &MapTree, input: Moved<'a>) -> ComposeResult<Moved<'a>> {
        match map {
            MapTree::Identity => Ok(input),
            MapTree::Step(node) => self.step(*node, input),
            MapTree::Sequence(parts) => self.in_turn(parts.iter(), input),
            MapTree::Repeat(of, times) => self.in_turn(std::iter::repeat_n(&**of, *times as usize), input),
            MapTree::Blend(a, b, weight) => {
                let (a, b) = (self.apply(a, input)?.settled(), self.apply(b, input)?.settled());
                let (x, y) = (1.0 - weight, *weight);
                let sum = |a: Expr<'a>, b: Expr<'a>| a * x.abs() + b * y.abs();
                let segment = a.segment.zip(b.segment);
                Ok(Moved {
                    z: a.z * x + b.z * y,
                    l: sum(a.l, b.l),
                    eta: sum(a.eta, b.eta),
                    segment: segment.map(|((va, ra), (vb, rb))| (va * x + vb * y, sum(ra, rb))),
                })
            }
            MapTree::Choose(when, then, otherwise) => {
                let branches = (self.apply(then, input)?.settled(), self.apply(otherwise, input)?.settled());
                Ok(self.choose(*when, input, branches))
            }
        }
    }

    fn in_turn<'m>(&self, mut maps: impl Iterator<Item = &'m MapTree>, input: Moved<'a>) -> ComposeResult<Moved<'a>> {
        let Some(first) = maps.next() else { return Ok(input) };
        let moved = self.apply(first, input)?;
        maps.try_fold(moved, |moved, map| self.apply(map, moved.settled()))
    }

    fn radius(&self, moved: &Moved<'a>) -> Expr<'a> {
        moved.l * self.e0 + moved.eta
    }

    /// The segment and the tube around it that holds all images, rounding errors included.
    fn line(&self, moved: &Moved<'a>) -> Option<Line<'a>> {
        let (v, rho) = moved.segment?;
        let speed = v.length();
        let unit = v * (1.0 / speed.max(v.arena.f(1e-30)));
        Some(Line { v, unit, reach: speed * self.e0, tube: rho * self.e0 + moved.eta })
    }

    fn step(&self, node: NodeRef, input: Moved<'a>) -> ComposeResult<Moved<'a>> {
        let inputs = RuleInputs {
            z: input.z,
            e: self.radius(&input),
            c: self.c,
            e_c: self.c_l * self.e0,
            line: self.line(&input),
            l: input.l,
            n: self.n,
        };
        let Some(rule) = step_rule(self.composer, node, inputs)? else { return Ok(input) };
        let by_constant = rule.by_constant.map(|factor| factor * self.c_l);
        let l = rule.growth * input.l;
        // Those of a segment grow by what bounds its remainder.
        let of_rounding = match rule.tangent {
            Some(Tangent::Within(..) | Tangent::Chord(..)) => rule.stretch,
            _ => rule.growth,
        };
        // The sum of the coordinates is no shorter than the image.
        let size = rule.image.abs().dot(rule.image.lift(1.0));
        let rounding = size * (self.unit * rule.roundings);
        let moved = Moved {
            z: rule.image,
            l: by_constant.map_or(l, |more| l + more),
            eta: of_rounding * input.eta + rounding,
            segment: None,
        };
        let segment = input.segment.map(|(v, rho)| match rule.tangent {
            Some(Tangent::Within(middle, radius)) => (middle, rule.stretch * rho + radius),
            // Taylor along the segment, then across to the point.
            Some(Tangent::Bending(along, bend, within)) => (along, within * rho + bend * v.dot(v) * self.e0 * 0.5),
            Some(Tangent::Chord(middle, radius, factor)) => (middle, factor * rho + radius),
            // Worse than the factor, so it starts again.
            None => (v.lift(0.0), moved.l),
        });
        Ok(Moved { segment, ..moved })
    }

    /// The union of both branches where the condition is not decided over the ball. The other branch's distance from the
    /// centre's image is a jump that starts where the ball first meets the border, so it counts per length from there.
    fn choose(&self, when: Condition, input: Moved<'a>, (then, otherwise): (Moved<'a>, Moved<'a>)) -> Moved<'a> {
        let arena = self.composer.arena;
        let holds = condition(when, input.z);
        let pick = |a: Expr<'a>, b: Expr<'a>| holds.select(a, b);
        let margin = match when {
            Condition::RadiusBelow(limit) | Condition::RadiusAbove(limit) => (input.z.length() - limit).abs(),
            Condition::Negative(axis) | Condition::Positive(axis) => {
                input.z.component(axis.min(input.z.ty().width - 1)).abs()
            }
            // Conditions on the iteration number were decided by the schedule.
            Condition::IterationBelow(_) | Condition::IterationEvery(_) => arena.f(UNBOUNDED),
        };
        let decided = self.radius(&input).lt(margin);
        let (l, other_l) = (pick(then.l, otherwise.l), pick(otherwise.l, then.l));
        let room = margin - input.eta;
        let jump = (then.z - otherwise.z).length() * input.l / room;
        let jump = arena.f(0.0).lt(room).select(jump, arena.f(UNBOUNDED));
        let union = l.max(other_l + jump);
        let segment = then.segment.zip(otherwise.segment).map(|((va, ra), (vb, rb))| {
            let v = pick(va, vb);
            (decided.select(v, v.lift(0.0)), decided.select(pick(ra, rb), union))
        });
        Moved {
            z: pick(then.z, otherwise.z),
            l: decided.select(l, union),
            eta: decided.select(pick(then.eta, otherwise.eta), then.eta.max(otherwise.eta)),
            segment,
        }
    }
}
