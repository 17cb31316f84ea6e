//! From which radius on an orbit is lost: the escape radius pulled back through the iterations that are still to come.
//!
//! `T_N` is the escape radius; `T_k` is such that |z_k| > T_k makes |z_(k+1)| > T_(k+1), and never above the escape
//! radius, which ends an orbit at any iteration. Steps say how a radius is pulled back (`fn pull_back(t, p)`); one that
//! does not say leaves the escape radius, which is right and slow.

use crate::compose::maps::steps_of;
use crate::compose::{ComposeResult, Composer, FieldOrbit};
use crate::expr::Expr;
use crate::formula::step::StateWidth;
use crate::graph::{Constant, Escape, IterationMap, MapTree, NodeKind, NodeRef, Schedule, resolve_schedule};

/// Thresholds that differ by less than this factor share the larger one.
const ALIKE: f64 = 1.01;

/// Thresholds after each iteration: entry k is that of z after iteration k, counted from 0.
///
/// `largest_start` bounds the length of the start point that constants are made of.
pub(super) fn thresholds(
    composer: &Composer,
    maps: &[IterationMap],
    schedule: &Schedule,
    iterations: u32,
    escape_radius: f64,
    largest_start: f64,
    width: u8,
) -> ComposeResult<Vec<f64>> {
    let count = iterations.max(1) as usize;
    let mut all = vec![escape_radius; count];
    for k in (0..count - 1).rev() {
        let item = &maps[schedule.item(k + 1)];
        let needed = all[k + 1] + constant_length(item.constant, largest_start);
        let n = composer.arena.f((k + 1) as f64);
        let before = pull_back(composer, &item.map, needed, n, width)?;
        // Comparisons with what is not a number are false.
        all[k] = if before < escape_radius { before.max(0.0) } else { escape_radius };
    }
    Ok(all)
}

/// Shells that all of space is taken in, outermost first, as ratios of their radii.
const SHELLS: [f64; 3] = [1.5, 1.1, 1.02];
/// The smallest radius that is asked for.
const SMALLEST: f64 = 1e-3;

/// A radius, in an orbit's own frame, from which on to `far` all start points escape, by the steps' norm bounds alone; `None` where
/// that is not known, not even of the outermost shell.
pub(in crate::compose) fn lost_from(composer: &Composer, orbit: &FieldOrbit, far: f64) -> ComposeResult<Option<f64>> {
    let (graph, settings) = (composer.graph, &orbit.settings);
    // Steps that remember return to what they were, first maps say nothing of norms, and other starts and tests are not of the
    // point's length.
    let is_plain = settings.pre.is_empty() && settings.start.is_none() && settings.escape == Escape::Length;
    if !is_plain || steps_of(composer, orbit.root).iter().any(|step| step.remembers()) {
        return Ok(None);
    }
    let limit = settings.max_iterations;
    let (maps, schedule) = resolve_schedule(graph, orbit.root, settings.constant, limit);
    let width = graph.state_width(orbit.root, settings);
    let first = &maps[schedule.item(0)];
    let escapes = |radius: f64, ratio: f64| -> ComposeResult<bool> {
        let longest = radius * ratio + settings.slice.abs();
        let all = thresholds(composer, &maps, &schedule, limit, settings.escape_radius, longest, width)?;
        let needed = all[0] + constant_length(first.constant, longest);
        let before = pull_back(composer, &first.map, needed, composer.arena.f(0.0), width)?;
        Ok(before * (1.0 + 1e-9) <= radius)
    };
    let mut known = far;
    for ratio in SHELLS {
        while known > SMALLEST && escapes(known / ratio, ratio)? {
            known /= ratio;
        }
    }
    Ok((known < far).then_some(known))
}

/// Largest length of an iteration's constant.
fn constant_length(constant: Constant, start: f64) -> f64 {
    let length = |v: [f64; 4]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    match constant {
        Constant::Mandelbrot => start,
        Constant::Julia(v) => length(v),
        Constant::Mix(v, amount) => (1.0 - amount).abs() * start + amount.abs() * length(v),
        Constant::Off => 0.0,
    }
}

/// A radius beyond which the map's image is longer than `t`; infinite where none is known.
fn pull_back(composer: &Composer, map: &MapTree, t: f64, n: Expr, width: u8) -> ComposeResult<f64> {
    if !t.is_finite() {
        return Ok(f64::INFINITY);
    }
    match map {
        MapTree::Identity => Ok(t),
        MapTree::Step(node) => pull_back_step(composer, *node, t, n, width),
        MapTree::Sequence(parts) => parts.iter().rev().try_fold(t, |t, part| pull_back(composer, part, t, n, width)),
        MapTree::Repeat(of, times) => (0..*times).try_fold(t, |t, _| pull_back(composer, of, t, n, width)),
        MapTree::Blend(..) => Ok(f64::INFINITY),
        MapTree::Choose(_, then, otherwise) => {
            let then = pull_back(composer, then, t, n, width)?;
            Ok(then.max(pull_back(composer, otherwise, t, n, width)?))
        }
    }
}

fn pull_back_step(composer: &Composer, node: NodeRef, t: f64, n: Expr, width: u8) -> ComposeResult<f64> {
    let place = composer.graph.node(node);
    let NodeKind::Step { step, params } = &place.kind else { return Ok(t) };
    let n = composer.arena.expr(n.id);
    let map = super::super::maps::param_map(composer, step, params, n);
    let library = composer.library;
    let traced = step
        .trace_number(&library.engine, &library.sources, composer.arena, "pull_back", &[composer.arena.f(t)], &map)
        .map_err(|error| error.label(place.span, format!("used by the node `{}`", place.name)))?;
    let stated = traced.and_then(|e| e.as_constant()).map_or(f64::INFINITY, |c| c[0]);
    let known = if stated.is_nan() { f64::INFINITY } else { stated };
    // Of a longer state, either the three components that the step moves or the one that it leaves are long enough.
    let narrow = step.state == StateWidth::Three && width == 4;
    Ok(if narrow { known.max(t) * std::f64::consts::SQRT_2 } else { known })
}

/// The threshold of one item's iterations as an expression of the iteration's number.
pub(super) fn threshold_of<'g>(all: &[f64], schedule: &Schedule, item: usize, n: Expr<'g>) -> Expr<'g> {
    let mut groups: Vec<(usize, f64)> = Vec::new();
    for (k, &t) in all.iter().enumerate().filter(|(k, _)| schedule.item(*k) == item) {
        match groups.last_mut() {
            Some((last, known)) if t <= *known * ALIKE && *known <= t * ALIKE => (*last, *known) = (k, known.max(t)),
            _ => groups.push((k, t)),
        }
    }
    let last = groups.pop().map_or(f64::INFINITY, |(_, t)| t);
    let rest = groups.into_iter().rev();
    rest.fold(n.arena.f(last), |later, (k, t)| n.le(n.arena.f(k as f64)).select(n.arena.f(t), later))
}
