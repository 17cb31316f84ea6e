//! Orbits inside end shapes: their few iterations become part of the expression that the end is looked up in.

use super::maps::{Memory, Moved, apply, apply_all, fixed_constant, scalar_rules, steps_of};
use super::norm::scaled_length;
use super::{ComposeResult, Composer, escape};
use crate::expr::{Differentiator, Expr};
use crate::formula::step::Growth;
use crate::graph::{DeForm, NodeRef, OrbitSettings, resolve_schedule};

/// The distance of an orbit's set from a point of its frame, and whether the point is in.
///
/// The derivative is that of the steps' rules where all state one, else the exact one. After an orbit has escaped it
/// stays where it is.
pub(super) fn unrolled<'g>(
    composer: &Composer<'g>,
    root: NodeRef,
    settings: &OrbitSettings,
    start: Expr<'g>,
) -> ComposeResult<(Expr<'g>, Expr<'g>)> {
    let arena = composer.arena;
    let start = match start.ty().width {
        3 if composer.graph.state_width(root, settings) == 4 => {
            let parts = start.components();
            arena.compose(&[parts[0], parts[1], parts[2], arena.f(settings.slice)])
        }
        _ => start,
    };
    let roots = || [root].into_iter().chain(settings.pre.iter().chain(&settings.post).copied());
    let has_rules = roots().all(|root| scalar_rules(composer, root).is_some());
    let zero = start.lift(0.0);
    let first = Moved { z: start, dr: has_rules.then(|| arena.f(1.0)) };
    let first = apply_all(composer, &settings.pre, first, zero)?;
    let (c, dc) = (first.z, first.dr);
    let (mut z, mut dr) = match settings.start {
        Some(start) => (arena.constant(c.ty(), start), dc.map(|dc| dc.lift(0.0))),
        None => (c, dc),
    };
    let (maps, schedule) = resolve_schedule(composer.graph, root, settings.constant, settings.max_iterations);
    let mut stays = escape::stays(settings, z, None);
    let mut memory = Memory::nothing(composer, root, Moved { z, dr });
    for n in 0..settings.max_iterations {
        let item = &maps[schedule.item(n as usize)];
        let added = fixed_constant(arena, item.constant, c);
        let next = apply(composer, &item.map, Moved { z, dr }, added, arena.f(f64::from(n)), &mut memory)?;
        let weight = item.constant.start_weight();
        let next_dr = next.dr.zip(dc).map(|(dr, dc)| dr + dc * weight);
        dr = dr.zip(next_dr).map(|(before, after)| stays.select(after, before));
        z = stays.select(next.z + added, z);
        stays = escape::stays(settings, z, None);
    }
    let end = apply_all(composer, &settings.post, Moved { z, dr }, zero)?;
    let size = size(composer, root, settings, end.z)?;
    let slope = end.dr.unwrap_or_else(|| scaled_length(Differentiator::by(arena, start).tangents(size.value)[0]));
    let d = size.distance(slope.max(arena.f(1e-30)));
    let inside = if size.decides { stays.and(d.le(arena.f(0.0))) } else { stays };
    let outside = d.max(arena.f(0.0));
    Ok((inside.select(if size.decides { d } else { arena.f(0.0) }, outside), inside))
}

/// The size of an orbit's end in the sense of its form.
struct Size<'g> {
    value: Expr<'g>,
    form: DeForm,
    radius: f64,
    /// Whether it decides what is in.
    decides: bool,
}

impl<'g> Size<'g> {
    fn distance(&self, slope: Expr<'g>) -> Expr<'g> {
        match self.form {
            DeForm::Logarithmic => self.value * self.value.ln() * 0.5 / slope,
            _ => (self.value - self.radius) / slope,
        }
    }
}

/// Form and radius as the file says; else logarithmic where a step is a power, linear where none is.
fn size<'g>(composer: &Composer<'g>, root: NodeRef, settings: &OrbitSettings, z: Expr<'g>) -> ComposeResult<Size<'g>> {
    if let Some(shape) = settings.shape {
        let value = super::field::shape_at(composer, shape.field, z, composer.arena.f(0.0))?;
        return Ok(Size { value, form: DeForm::End, radius: 0.0, decides: true });
    }
    let estimate = settings.estimate;
    let is_power = steps_of(composer, root).iter().any(|step| step.growth == Some(Growth::Power));
    let form = estimate.form.unwrap_or(if is_power { DeForm::Logarithmic } else { DeForm::Linear });
    let axis = estimate.axis.unwrap_or([0.0, 0.0, 1.0]);
    let value = super::estimate::plain_size(form, axis, settings.escape, z);
    Ok(Size { value, form, radius: estimate.radius.unwrap_or(0.0), decides: form.is_shape() })
}
