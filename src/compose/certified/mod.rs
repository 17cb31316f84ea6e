//! Proofs in the place of estimates: orbits that carry a whole ball, or a segment of the ray, around the point.
//!
//! An orbit starts with a radius e0 that the march proposes. It carries the centre's orbit z and a factor l: the images
//! of all points within s of the start, for any s up to e0, lie within l s of z. Where |z| - l s stays above the radius
//! from which no orbit returns ([`thresholds`]) all of them escape, so the largest such s is proven empty. Because l is a
//! bound for every smaller start too, one orbit answers for all s: no halving.
//!
//! The segment form follows the ray's direction as well: the images of p + s d lie within rho s of z + s v. A step maps v by
//! its derivative, bounded over the ball, and rho by its stretch; where that is no better than the factor, it starts
//! again with v = 0. Rounding is a third part, eta, which does not shrink with s.
//!
//! [`rules`] says where growth comes from.

mod rounding;
mod rules;
mod thresholds;

use super::field::shape_at;
use super::levels::Joined;
use super::maps::condition;
use super::placement::{Frame, Place};
use super::{Choice, ComposeResult, Composer, Purpose};
use crate::expr::differentiate::reachable;
use crate::expr::enclose::UNBOUNDED;
use crate::expr::{Expr, Function, Port, Type};
use crate::formula::step::Traced;
use crate::graph::{
    Condition, Constant, EndShape, IterationMap, MapTree, Method, NO_ESCAPE, NodeRef, OrbitSettings, resolve_schedule,
};
use crate::kernel::{Estimator, EstimatorInputs, Orbit};
use rules::{Line, RuleInputs, Tangent, step_rule};

/// Share of a proven step that is taken: the rest is for rounding of the factor itself.
const MARGIN: f64 = 0.999;
/// Largest start radius, as a share of the extent of the set.
const LARGEST_START: f64 = 0.25;

/// How much worse than the factor a segment's bound may be before it starts again: its direction is worth something.
const KEPT: f64 = 1.1;

/// Where a ball or segment has come to.
#[derive(Clone, Copy)]
struct Moved<'g> {
    /// The centre.
    z: Expr<'g>,
    /// Distance from it per distance from the start.
    l: Expr<'g>,
    /// Rounding errors.
    eta: Expr<'g>,
    /// Of a segment: derivative v by its parameter, and rho.
    segment: Option<(Expr<'g>, Expr<'g>)>,
}

impl<'g> Moved<'g> {
    fn parts(&self, prefix: &str) -> Vec<(String, Expr<'g>)> {
        let mut parts = vec![("z", self.z), ("l", self.l), ("eta", self.eta)];
        if let Some((v, rho)) = self.segment {
            parts.extend([("v", v), ("rho", rho)]);
        }
        parts.into_iter().map(|(name, e)| (format!("{prefix}{name}"), e)).collect()
    }

    /// The same parts as inputs from `first` on; constants stay what they are if `keep` says so.
    fn as_inputs(&self, first: usize, keep: bool) -> Moved<'g> {
        let mut next = first as u16;
        let mut input = |e: Expr<'g>| {
            if keep && e.as_constant().is_some() {
                return e;
            }
            next += 1;
            e.arena.input(next - 1, e.ty())
        };
        Moved {
            z: input(self.z),
            l: input(self.l),
            eta: input(self.eta),
            segment: self.segment.map(|(v, rho)| (input(v), input(rho))),
        }
    }

    /// The factor is the smaller of its own and the segment's, both being bounds; the segment starts again where it has
    /// become worse, or is not a number.
    fn settled(self) -> Moved<'g> {
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
struct Context<'a, 's> {
    composer: &'s Composer<'a>,
    /// The start radius.
    e0: Expr<'a>,
    /// The iteration's constant and its factor.
    c: Expr<'a>,
    c_l: Expr<'a>,
    n: Expr<'a>,
    /// Relative error of one operation.
    unit: f64,
}

/// Builds the certified orbit of a node; `purpose` is to march or to probe.
pub(super) fn compose_certified(
    composer: &Composer,
    name: String,
    root: NodeRef,
    settings: &OrbitSettings,
    frame: &Frame,
    choice: &Choice,
    purpose: Purpose,
) -> ComposeResult<Orbit> {
    let width = composer.graph.state_width(root, settings);
    Builder { composer, settings, frame, width, choice, purpose }.build(name, root)
}

/// Most that a map stretches distances from `z` within a ball of radius `e`.
pub(super) fn growth_of<'a>(
    composer: &Composer<'a>,
    by: NodeRef,
    z: Expr<'a>,
    e: Expr<'a>,
    unit: f64,
) -> ComposeResult<Expr<'a>> {
    let zero = e.lift(0.0);
    let context = Context { composer, e0: e, c: z.lift(0.0), c_l: zero, n: zero, unit };
    let (maps, _) = resolve_schedule(composer.graph, by, Constant::Off, 1);
    let start = Moved { z, l: e.lift(1.0), eta: zero, segment: None };
    Ok(context.apply(&maps[0].map, start)?.l)
}

struct Builder<'a> {
    composer: &'a Composer<'a>,
    settings: &'a OrbitSettings,
    frame: &'a Frame,
    width: u8,
    choice: &'a Choice,
    purpose: Purpose,
}

/// What `init` fixes for an orbit.
struct Frozen<'g> {
    start: Moved<'g>,
    e0: Expr<'g>,
    /// Least threshold: the escape radius where the start point is too long for the others.
    floor: Option<Expr<'g>>,
}

impl<'a> Builder<'a> {
    fn build(&self, name: String, root: NodeRef) -> ComposeResult<Orbit> {
        let (composer, arena) = (self.composer, self.composer.arena);
        let limit = self.settings.max_iterations;
        let (maps, schedule) = resolve_schedule(composer.graph, root, self.settings.constant, limit);
        // Constants are as long as the start point, which thresholds hold for up to here.
        let largest_start = self.choice.extent * (1.0 + LARGEST_START);
        let (escape, width) = (self.settings.escape_radius, self.width);
        let all = thresholds::thresholds(composer, &maps, &schedule, limit, escape, largest_start, width)?;

        let (start, e0) = self.start()?;
        let mut init = Function::new(format!("{name}_init"), Estimator::inputs());
        let mut state = Vec::new();
        let mut give = |name: String, e: Expr, ports: &mut Vec<Port>| {
            init.output(name.clone(), e);
            ports.push(Port::new(name, e.ty()));
        };
        for (name, e) in start.parts("") {
            give(name, e, &mut state);
        }
        let first = self.join(None, start, e0, arena.f(0.0))?;
        if let Some(joined) = &first {
            give("level".into(), joined.d, &mut state);
        }
        give("s".into(), arena.f(0.0), &mut state);
        let mut frozen = Vec::new();
        give("e0".into(), e0, &mut frozen);
        for (name, e) in start.parts("c_").into_iter().filter(|(_, e)| e.as_constant().is_none()) {
            give(name, e, &mut frozen);
        }
        let floor = self.floor(&maps, start, e0);
        if let Some(floor) = floor {
            give("floor".into(), floor, &mut frozen);
        }

        let moved = start.as_inputs(0, false);
        let s = arena.input((state.len() - 1) as u16, Type::F);
        let joined = first.map(|_| Joined { d: arena.input((state.len() - 2) as u16, Type::F), gradient: None });
        let mut ports: Vec<Port> = state.iter().chain(&frozen).cloned().collect();
        let fixed = Frozen {
            e0: arena.input(state.len() as u16, Type::F),
            start: start.as_inputs(state.len() + 1, true),
            floor: floor.map(|_| arena.input((ports.len() - 1) as u16, Type::F)),
        };
        let n = arena.input(ports.len() as u16, Type::F);
        ports.push(Port::new("n", Type::F));
        let mut items = Vec::new();
        for (i, item) in maps.iter().enumerate() {
            let mut function = Function::new(format!("{name}_iterate_{i}"), ports.clone());
            let next = self.iterate(item, moved, &fixed, n)?;
            let limit = thresholds::threshold_of(&all, &schedule, i, n);
            let s = self.prove(s, &next, fixed.floor.map_or(limit, |floor| limit.max(floor)));
            for (name, e) in next.parts("") {
                function.output(name, e);
            }
            if let Some(joined) = self.join(joined.clone(), next, fixed.e0, n + 1.0)? {
                function.output("level", joined.d);
            }
            function.output("s", s);
            let escape = arena.f(self.settings.escape_radius * self.settings.escape_radius);
            // NaN compares false, so it counts as escaped.
            function.output("escaped", !next.z.dot(next.z).le(escape));
            items.push(function);
        }
        let mut finish = Function::new(format!("{name}_finish"), ports);
        let proven = fixed.e0.min(s * MARGIN).max(arena.f(0.0));
        finish.output("de", self.end_proof(moved, joined, &fixed, (proven, n))?);
        if self.purpose == Purpose::Probe {
            finish.output("r", moved.z.length());
            let parts = moved.z.components();
            let w = parts.get(3).copied().unwrap_or_else(|| arena.f(0.0));
            finish.output("z", arena.compose(&[parts[0], parts[1], parts[2], w]));
        }
        Ok(Orbit { name, state, frozen, init, items, schedule, finish, max_iterations: limit })
    }

    /// The start as expressions of the [`EstimatorInputs`], and the start radius in world units.
    fn start(&self) -> ComposeResult<(Moved<'a>, Expr<'a>)> {
        let arena = self.composer.arena;
        let EstimatorInputs { p, d, h, .. } = EstimatorInputs::new(arena);
        let widen = |v: Expr<'a>, w: f64| {
            let parts = v.components();
            let embeds = self.settings.pre.iter().any(|node| self.composer.graph.embeds(*node));
            if self.width == 4 && !embeds { arena.compose(&[parts[0], parts[1], parts[2], arena.f(w)]) } else { v }
        };
        let along = self.choice.method == Method::Certified;
        let e0 = h.min(arena.f(self.choice.extent * LARGEST_START * self.frame.scale()));
        let zero = arena.f(0.0);
        let rounding = |z: Expr<'a>| z.length() * (4.0 * self.choice.unit);
        let mut moved = Moved { z: p, l: arena.f(1.0), eta: rounding(p), segment: along.then_some((d, zero)) };
        let context =
            Context { composer: self.composer, e0, c: p.lift(0.0), c_l: zero, n: zero, unit: self.choice.unit };
        for place in self.frame.places() {
            moved = match place {
                Place::Warped(by) => {
                    let (maps, _) = resolve_schedule(self.composer.graph, *by, Constant::Off, 1);
                    context.apply(&maps[0].map, moved)?.settled()
                }
                _ => {
                    let z = place.enter(self.composer, Traced { z: moved.z, dr: None })?.z;
                    let shrink = place.shrink();
                    let segment = moved.segment.map(|(v, rho)| (place.turn(moved.z, v), rho * shrink));
                    Moved { z, l: moved.l * shrink, eta: moved.eta * shrink + rounding(z), segment }
                }
            };
        }
        moved.z = widen(moved.z, self.settings.slice);
        moved.segment = moved.segment.map(|(v, rho)| (widen(v, 0.0), rho));
        let context = Context { c: moved.z.lift(0.0), ..context };
        for node in &self.settings.pre {
            let (maps, _) = resolve_schedule(self.composer.graph, *node, Constant::Off, 1);
            moved = context.apply(&maps[0].map, moved)?.settled();
        }
        Ok((moved, e0))
    }

    /// One iteration: the map, then the constant, which is the start point's share and a fixed one.
    fn iterate(
        &self,
        item: &IterationMap,
        moved: Moved<'a>,
        frozen: &Frozen<'a>,
        n: Expr<'a>,
    ) -> ComposeResult<Moved<'a>> {
        let arena = self.composer.arena;
        let start = &frozen.start;
        let fixed = |v: [f64; 3]| arena.constant(start.z.ty(), [v[0], v[1], v[2], 0.0]);
        let c = match item.constant {
            Constant::Mandelbrot => start.z,
            Constant::Julia(v) => fixed(v),
            Constant::Mix(v, amount) => start.z * (1.0 - amount) + fixed(v) * amount,
            Constant::Off => start.z.lift(0.0),
        };
        let weight = item.constant.start_weight();
        let c_l = start.l * weight.abs();
        let context = Context { composer: self.composer, e0: frozen.e0, c, c_l, n, unit: self.choice.unit };
        let mapped = context.apply(&item.map, moved)?;
        let z = mapped.z + c;
        let added = Moved {
            z,
            l: mapped.l + c_l,
            eta: mapped.eta + start.eta * weight.abs() + z.length() * (4.0 * self.choice.unit),
            segment: mapped
                .segment
                .zip(start.segment)
                .map(|((v, rho), (c_v, c_rho))| (v + c_v * weight, rho + c_rho * weight.abs())),
        }
        .settled();
        // What is not a number is no bound either.
        let cap = |e: Expr<'a>| e.le(arena.f(UNBOUNDED)).select(e, arena.f(UNBOUNDED));
        Ok(Moved { l: cap(added.l), eta: cap(added.eta), ..added })
    }

    /// 0 where the start point is short enough for the thresholds, which hold for constants of its length; else the escape
    /// radius.
    fn floor(&self, maps: &[IterationMap], start: Moved<'a>, e0: Expr<'a>) -> Option<Expr<'a>> {
        if maps.iter().all(|m| m.constant.start_weight() == 0.0) {
            return None;
        }
        let arena = self.composer.arena;
        let reach = start.z.length() + start.l * e0 + start.eta;
        let largest = arena.f(self.choice.extent * (1.0 + LARGEST_START));
        Some(reach.le(largest).select(arena.f(0.0), arena.f(self.settings.escape_radius)))
    }

    /// With an end shape the ball is also empty where the image's distance from the shape is above its radius; below 0
    /// where the start point is in, as deep as is proven the same way. Without one it is what was proven by escaping.
    fn end_proof(
        &self,
        moved: Moved<'a>,
        joined: Option<Joined<'a>>,
        fixed: &Frozen<'a>,
        (by_escape, n): (Expr<'a>, Expr<'a>),
    ) -> ComposeResult<Expr<'a>> {
        let Some(shape) = self.settings.shape else { return Ok(by_escape) };
        let zero = by_escape.lift(0.0);
        let d = match joined {
            Some(joined) => joined.d,
            None => self.looked_up(shape.field, moved, fixed.e0, n)?,
        };
        let proven = fixed.e0.min(d.abs() * MARGIN);
        // An orbit that escapes is out whatever the shape says, so the inside is proven only where none can.
        let depth = if self.settings.escape_radius < NO_ESCAPE { zero } else { proven };
        Ok(d.lt(zero).select(-depth.max(zero.lift(1e-30)), proven.max(by_escape)))
    }

    /// How far from the start point nothing of the shape's preimage is, or below 0 how far all is in.
    fn looked_up(&self, field: NodeRef, moved: Moved<'a>, e0: Expr<'a>, n: Expr<'a>) -> ComposeResult<Expr<'a>> {
        let arena = self.composer.arena;
        let zero = arena.f(0.0);
        let c = moved.z.lift(0.0);
        let context = Context { composer: self.composer, e0, c, c_l: zero, n, unit: self.choice.unit };
        let mut end = moved;
        for node in &self.settings.post {
            let (maps, _) = resolve_schedule(self.composer.graph, *node, Constant::Off, 1);
            end = context.apply(&maps[0].map, end)?.settled();
        }
        let f = shape_at(self.composer, field, end.z, n)?;
        let rounded = reachable(arena, &[f.id]).len() as f64 * 4.0 * self.choice.unit;
        let sure = f.abs() - end.eta - (end.z.length() + 1.0) * rounded;
        let known = end.l.lt(arena.f(UNBOUNDED)).and(f.abs().lt(arena.f(UNBOUNDED)));
        let proven = known.select(sure / end.l.max(arena.f(1e-30)), zero).max(zero);
        Ok(f.le(zero).select(-proven.max(arena.f(1e-30)), proven))
    }

    /// The levels so far joined with that of a state after `n` iterations.
    fn join(
        &self,
        before: Option<Joined<'a>>,
        moved: Moved<'a>,
        e0: Expr<'a>,
        n: Expr<'a>,
    ) -> ComposeResult<Option<Joined<'a>>> {
        let Some(EndShape { field, levels: Some(levels) }) = self.settings.shape else { return Ok(None) };
        let before = before.unwrap_or_else(|| Joined::nothing(levels.join, n, false));
        let next = Joined { d: self.looked_up(field, moved, e0, n)?, gradient: None };
        Ok(Some(before.with(levels, n, next)))
    }

    /// The largest start radius proven so far: everything within it is above the threshold now.
    fn prove(&self, s: Expr<'a>, moved: &Moved<'a>, threshold: Expr<'a>) -> Expr<'a> {
        let arena = self.composer.arena;
        let r = moved.z.length();
        // Lengths of a segment, on both sides of its middle, change only by its direction's share towards the origin. All
        // is multiplied by r, so that one division is enough.
        let factor = moved.segment.map_or(moved.l, |(v, rho)| {
            let (towards, all) = (rho * r + v.dot(moved.z).abs(), moved.l * r);
            towards.lt(all).select(towards, all)
        });
        let room = r - threshold - moved.eta;
        let room = if moved.segment.is_some() { room * r } else { room };
        let proven = room / factor.max(arena.f(1e-30));
        let known = moved.l.lt(arena.f(UNBOUNDED)).and(r.lt(arena.f(UNBOUNDED)));
        known.and(s.lt(proven)).select(proven, s)
    }
}

impl<'a> Context<'a, '_> {
    /// The image of what is settled; it is not settled itself, since a constant may follow.
    fn apply(&self, map: &MapTree, input: Moved<'a>) -> ComposeResult<Moved<'a>> {
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
