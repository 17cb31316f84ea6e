//! Proofs instead of estimates: orbits that carry a whole ball, or a segment of the ray, around the point.
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

mod centre;
mod moved;
mod rounding;
mod rules;
mod thresholds;

use super::escape::{self, stays};
use super::field::shape_at;
use super::levels::Joined;
use super::maps::fixed_constant;
use super::orbit::OrbitBuilder;
use super::placement::{Frame, Place};
use super::{Choice, ComposeResult, Composer, Purpose};
use crate::expr::enclose::UNBOUNDED;
use crate::expr::{Arena, Expr, Function, Port, Type};
use crate::formula::step::Traced;
use crate::graph::{
    Constant, EndShape, Escape, IterationMap, Method, NO_ESCAPE, NodeRef, OrbitSettings, resolve_schedule,
};
use crate::kernel::records::Query;
use crate::kernel::{Estimator, Orbit};
use centre::Centre;
use moved::{Context, Moved};
use rounding::roundings;
pub(super) use thresholds::lost_from;

/// Share of a proven step that is taken: the rest is for rounding of the factor itself.
const MARGIN: f64 = 0.999;
/// Largest start radius, as a share of the extent of the set.
const LARGEST_START: f64 = 0.25;
/// Escape radii that an orbit is followed to for [`Purpose::Proof`].
const PROOF_ESCAPE: f64 = 16.0;

/// Builds the certified orbit of a node.
pub(super) fn compose_certified(orbit: &OrbitBuilder, name: String) -> ComposeResult<Orbit> {
    let OrbitBuilder { composer, settings, frame, width, choice, purpose, .. } = *orbit;
    Builder { composer, settings, frame, width, choice, purpose }.build(name, orbit)
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

/// State and frozen values in their order: outputs of `init`, and inputs of everything after it.
struct Inputs<'g> {
    init: Function,
    ports: Vec<Port>,
    arena: &'g Arena,
}

impl<'g> Inputs<'g> {
    /// The input that stands for a value of the start.
    fn give(&mut self, name: &str, e: Expr<'g>) -> Expr<'g> {
        self.init.output(name, e);
        self.ports.push(Port::new(name, e.ty()));
        self.arena.input((self.ports.len() - 1) as u16, e.ty())
    }

    /// The same, but constants stay what they are.
    fn keep(&mut self, name: &str, e: Expr<'g>) -> Expr<'g> {
        if e.as_constant().is_some() { e } else { self.give(name, e) }
    }
}

impl<'a> Builder<'a> {
    fn build(&self, name: String, orbit: &OrbitBuilder<'a>) -> ComposeResult<Orbit> {
        let (composer, arena) = (self.composer, self.composer.arena);
        let limit = self.settings.max_iterations;
        let (maps, schedule) = resolve_schedule(composer.graph, orbit.root, self.settings.constant, limit);
        // Constants are as long as the start point, which thresholds hold for up to here.
        let largest_start = self.choice.extent * (1.0 + LARGEST_START);
        let (escape, width) = (self.settings.escape_radius, self.width);
        let all = match self.settings.escape {
            Escape::Length => thresholds::thresholds(composer, &maps, &schedule, limit, escape, largest_start, width)?,
            // Other tests end an orbit where they hold, and nothing is known of the iterations before.
            other => vec![escape * other.scale(width)],
        };

        let (start, e0) = self.start()?;
        let first = self.first(start);
        let init = Function::new(format!("{name}_init"), Estimator::inputs());
        let mut inputs = Inputs { init, ports: Vec::new(), arena };
        let moved = first.map(|name, e| inputs.give(name, e));
        let joined = self.join(None, first, e0, arena.f(0.0))?;
        let joined = joined.map(|joined| Joined { d: inputs.give("level", joined.d), gradient: None });
        let mut centre = Centre::start(orbit)?;
        centre.iter_mut().for_each(|centre| centre.carry(moved.z, &mut inputs));
        let s = inputs.give("s", arena.f(0.0));
        let states = inputs.ports.len();
        let floor = self.floor(&maps, start, e0);
        let fixed = Frozen {
            e0: inputs.give("e0", e0),
            start: start.map(|name, e| inputs.keep(&format!("c_{name}"), e)),
            floor: floor.map(|floor| inputs.give("floor", floor)),
        };
        let moves = maps.iter().any(|m| m.constant.start_weight() != 0.0);
        centre.iter_mut().for_each(|centre| centre.freeze(fixed.start.z, moves, &mut inputs));
        let Inputs { init, mut ports, .. } = inputs;
        let n = arena.input(ports.len() as u16, Type::F);
        ports.push(Port::new("n", Type::F));

        let mut items = Vec::new();
        for (i, item) in maps.iter().enumerate() {
            let mut function = Function::new(format!("{name}_iterate_{i}"), ports.clone());
            let next = self.iterate(item, moved, &fixed, n)?;
            let limit = match self.settings.escape {
                Escape::Length => thresholds::threshold_of(&all, &schedule, i, n),
                _ => arena.f(all[0]),
            };
            let proven = self.prove(s, &next, fixed.floor.map_or(limit, |floor| limit.max(floor)));
            next.map(|name, e| {
                function.output(name, e);
                e
            });
            if let Some(joined) = self.join(joined.clone(), next, fixed.e0, n + 1.0)? {
                function.output("level", joined.d);
            }
            // NaN compares false, so it counts as escaped.
            let mut ended = match self.settings.escape {
                Escape::Length => !next.z.dot(next.z).le(self.escape_sq(n)),
                _ => !stays(self.settings, next.z, None),
            };
            if let Some(centre) = &centre {
                let next = centre.iterate(item, n)?;
                Centre::derivative(&next).into_iter().for_each(|(name, e)| function.output(name, e));
                ended = centre.has_ended(&next);
            }
            function.output("s", proven);
            function.output("escaped", ended);
            items.push(function);
        }
        let finish = Function::new(format!("{name}_finish"), ports.clone());
        let proven = fixed.e0.min(s * MARGIN).max(arena.f(0.0));
        let de = self.end_proof(moved, joined, &fixed, (proven, n))?;
        let finish = self.finish(finish, moved, centre.map_or(de, |centre| centre.mark_resolved(de)));
        ports.pop();
        let frozen = ports.split_off(states);
        Ok(Orbit { name, state: ports, frozen, init, items, schedule, finish, max_iterations: limit })
    }

    fn finish(&self, mut finish: Function, moved: Moved<'a>, de: Expr<'a>) -> Function {
        finish.output("de", de);
        if self.purpose == Purpose::Probe {
            finish.output("r", moved.z.length());
            let parts = moved.z.components();
            let w = parts.get(3).copied().unwrap_or_else(|| de.lift(0.0));
            finish.output("z", self.composer.arena.compose(&[parts[0], parts[1], parts[2], w]));
        }
        finish
    }

    /// The start as expressions of the [`Query`], and the start radius in world units.
    fn start(&self) -> ComposeResult<(Moved<'a>, Expr<'a>)> {
        let arena = self.composer.arena;
        let Query { p, d, h, .. } = Query::first(arena);
        let widen = |v: Expr<'a>, w: f64| {
            let parts = v.components();
            let embeds = self.settings.pre.iter().any(|node| self.composer.graph.embeds(*node));
            if self.width == 4 && !embeds { arena.compose(&[parts[0], parts[1], parts[2], arena.f(w)]) } else { v }
        };
        let along = self.choice.method == Method::Certified;
        let e0 = h.min(arena.f(self.choice.extent * LARGEST_START * self.frame.scale()));
        let zero = arena.f(0.0);
        let rounding = |z: Expr<'a>| z.length() * (4.0 * self.choice.precision.unit());
        let mut moved = Moved { z: p, l: arena.f(1.0), eta: rounding(p), segment: along.then_some((d, zero)) };
        let context = Context {
            composer: self.composer,
            e0,
            c: p.lift(0.0),
            c_l: zero,
            n: zero,
            unit: self.choice.precision.unit(),
        };
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

    /// The first state: the start point, or one that is the same for all.
    fn first(&self, start: Moved<'a>) -> Moved<'a> {
        let Some(at) = self.settings.start else { return start };
        let (arena, zero) = (self.composer.arena, start.l.lift(0.0));
        let z = arena.constant(start.z.ty(), at);
        let eta = arena.f(at.iter().map(|x| x * x).sum::<f64>().sqrt() * (4.0 * self.choice.precision.unit()));
        Moved { z, l: zero, eta, segment: start.segment.map(|(v, _)| (v.lift(0.0), zero)) }
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
        let c = fixed_constant(arena, item.constant, start.z);
        let weight = item.constant.start_weight();
        let c_l = start.l * weight.abs();
        let context = Context { composer: self.composer, e0: frozen.e0, c, c_l, n, unit: self.choice.precision.unit() };
        let mapped = context.apply(&item.map, moved)?;
        let z = mapped.z + c;
        let added = Moved {
            z,
            l: mapped.l + c_l,
            eta: mapped.eta + start.eta * weight.abs() + z.length() * (4.0 * self.choice.precision.unit()),
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

    /// The square of the radius from which on an orbit is not followed after its iteration `n`, counted from 0.
    fn escape_sq(&self, n: Expr<'a>) -> Expr<'a> {
        let square = |radius: f64| self.composer.arena.f(radius * radius);
        let escape = square(self.settings.escape_radius);
        if self.purpose != Purpose::Proof || self.settings.shape.is_some() {
            return escape;
        }
        // What is known of the whole ball once it is far out is more than at the first iteration that its centre escapes at.
        let further = square(self.settings.escape_radius * PROOF_ESCAPE);
        let last = self.composer.arena.f(f64::from(self.settings.max_iterations) - 1.5);
        last.lt(n).select(escape, further)
    }

    /// 0 if the start point is short enough for the thresholds, which hold for constants of its length; else the escape
    /// radius.
    fn floor(&self, maps: &[IterationMap], start: Moved<'a>, e0: Expr<'a>) -> Option<Expr<'a>> {
        if maps.iter().all(|m| m.constant.start_weight() == 0.0) || self.settings.escape != Escape::Length {
            return None;
        }
        let arena = self.composer.arena;
        let reach = start.z.length() + start.l * e0 + start.eta;
        let largest = arena.f(self.choice.extent * (1.0 + LARGEST_START));
        Some(reach.le(largest).select(arena.f(0.0), arena.f(self.settings.escape_radius)))
    }

    /// With an end shape the ball is also empty if the image's distance from the shape is above its radius; below 0
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
        let context = Context { composer: self.composer, e0, c, c_l: zero, n, unit: self.choice.precision.unit() };
        let mut end = moved;
        for node in &self.settings.post {
            let (maps, _) = resolve_schedule(self.composer.graph, *node, Constant::Off, 1);
            end = context.apply(&maps[0].map, end)?.settled();
        }
        let f = shape_at(self.composer, field, end.z, n)?;
        // Shapes are differences of lengths, so their terms may be longer than they are.
        let rounded = roundings(f) * 4.0 * self.choice.precision.unit();
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
        if self.settings.escape != Escape::Length {
            return self.prove_by_size(s, moved, threshold);
        }
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

    /// The same by what other tests compare: a size that changes no faster than z does, or how near z is to a point.
    fn prove_by_size(&self, s: Expr<'a>, moved: &Moved<'a>, threshold: Expr<'a>) -> Expr<'a> {
        let arena = self.composer.arena;
        let z = moved.z;
        let (room, factor) = match self.settings.escape {
            Escape::Near(point) => {
                let point = arena.constant(z.ty(), point);
                let rounded = (z.length() + point.length()) * (4.0 * self.choice.precision.unit());
                (threshold - (z - point).length() - rounded, moved.l)
            }
            Escape::Above(normal) | Escape::Beyond(normal) => {
                let normal = arena.constant(z.ty(), normal);
                let factor = moved.segment.map_or(moved.l, |(v, rho)| moved.l.min(rho + v.dot(normal).abs()));
                (escape::size(self.settings.escape, z).map_or(-threshold, |size| size - threshold), factor)
            }
            other => (escape::size(other, z).map_or(-threshold, |size| size - threshold), moved.l),
        };
        let proven = (room - moved.eta) / factor.max(arena.f(1e-30));
        let known = moved.l.lt(arena.f(UNBOUNDED)).and(z.length().lt(arena.f(UNBOUNDED)));
        known.and(s.lt(proven)).select(proven, s)
    }
}
