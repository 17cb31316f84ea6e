//! Fields with a distance of their own: primitives, and shapes of step files.

use super::field::{FieldBuilder, field_primitives};
use super::maps::param_map;
use super::paint::{Marked, untouched};
use super::placement::Frame;
use super::value::FieldValue;
use super::{ComposeResult, Composer, Purpose};
use crate::expr::enclose::Encloser;
use crate::expr::{Differentiator, Expr};
use crate::formula::step::Step;
use crate::graph::{Marks, NodeRef, ParamInput, Primitive, SphereForm};
use crate::kernel::records::Query;

impl<'g> FieldBuilder<'_, 'g> {
    pub(super) fn primitive(
        &self,
        node: NodeRef,
        primitive: &Primitive,
        frame: &Frame,
    ) -> ComposeResult<FieldValue<'g>> {
        let arena = self.composer.arena;
        let Query { hit_eps, .. } = Query::first(arena);
        let local = self.local(frame)?.xyz();
        let d = self.back(frame, signed_distance(primitive, local))?;
        let is_shell = matches!(primitive, Primitive::Sphere { form: SphereForm::Shell, .. });
        let limit = if is_shell { hit_eps } else { arena.f(0.0) };
        // The solid form is flat inside: its normal is that of the signed one.
        let smooth = match *primitive {
            Primitive::Sphere { centre, radius, .. } => {
                let signed = Primitive::Sphere { centre, radius, form: SphereForm::Signed };
                signed_distance(&signed, local)
            }
            _ => signed_distance(primitive, local),
        };
        let value = self.own((node, frame), d, d.le(limit), smooth)?;
        let is_flat = matches!(primitive, Primitive::Sphere { form: SphereForm::Solid | SphereForm::Shell, .. });
        Ok(FieldValue { shallow: is_flat.then_some(value.inside), ..value })
    }

    /// A shape of a step file.
    pub(super) fn shape(
        &self,
        node: NodeRef,
        (step, params): (&Step, &[ParamInput]),
        frame: &Frame,
    ) -> ComposeResult<FieldValue<'g>> {
        let Composer { arena, library, graph } = *self.composer;
        let map = param_map(self.composer, step, params, self.n);
        let local = self.local(frame)?;
        let place = graph.node(node);
        let d = step
            .trace_distance(&library.engine, &library.sources, arena, local, &map)
            .map_err(|error| error.label(place.span, format!("used by the node `{}`", place.name)))?;
        let empty = match self.purpose {
            Purpose::Proof => self.proven_empty(d),
            _ => self.back(frame, d)?,
        };
        self.own((node, frame), empty, d.le(arena.f(0.0)), d)
    }

    /// How far around the point a shape's distance `d` is proven to stay above 0: `h` or nothing. What the shape's file says of
    /// its slope is not asked, and may be wrong.
    fn proven_empty(&self, d: Expr<'g>) -> Expr<'g> {
        let Query { h, .. } = Query::first(self.composer.arena);
        let zero = h.lift(0.0);
        let least = Encloser::new(self.composer.arena, &[(self.at, h)]).bounds(d)[0].lo;
        zero.lt(least).select(h, zero)
    }

    /// A field with a distance of its own; `smooth` has the normal.
    fn own(
        &self,
        (node, frame): (NodeRef, &Frame),
        d: Expr<'g>,
        inside: Expr<'g>,
        smooth: Expr<'g>,
    ) -> ComposeResult<FieldValue<'g>> {
        let arena = self.composer.arena;
        let surface = self.purpose == Purpose::Surface;
        let gradient = surface.then(|| {
            let slope = Differentiator::by(arena, self.at).tangents(smooth)[0];
            slope / slope.length().max(arena.f(1e-30))
        });
        let decider = (self.purpose == Purpose::Decision).then(|| {
            let k = field_primitives(self.composer).iter().position(|p| *p == node).unwrap_or(0);
            arena.f((2 * self.specs.len() + k) as f64)
        });
        let trap = surface.then(|| untouched(arena));
        let plain = FieldValue::plain(d, inside);
        let value = FieldValue { gradient, trap, decider, ..plain };
        self.painted(value, frame, arena.f(0.0), &Marked::read(arena, Marks::default(), &[]))
    }
}

/// The exact signed distance of a primitive.
pub(super) fn signed_distance<'g>(primitive: &Primitive, p: Expr<'g>) -> Expr<'g> {
    let arena = p.arena;
    let zero = arena.f(0.0);
    let planar = |x: Expr<'g>, y: Expr<'g>| (x * x + y * y).sqrt();
    match *primitive {
        Primitive::Sphere { centre, radius, form } => {
            let d = (p - arena.v3(centre)).length() - radius;
            match form {
                SphereForm::Signed => d,
                SphereForm::Solid => d.max(zero),
                SphereForm::Shell => d.abs(),
            }
        }
        Primitive::Box { centre, half_size } => {
            let q = ((p - arena.v3(centre)).abs() - arena.v3(half_size)).components();
            let outside = arena.compose(&[q[0].max(zero), q[1].max(zero), q[2].max(zero)]).length();
            outside + q[0].max(q[1]).max(q[2]).min(zero)
        }
        Primitive::Torus { centre, major, minor } => {
            let q = (p - arena.v3(centre)).components();
            planar(planar(q[0], q[1]) - major, q[2]) - minor
        }
        Primitive::Plane { normal, offset } => p.dot(arena.v3(normal)) - offset,
        Primitive::Cylinder { centre, radius, half_height } => {
            let q = (p - arena.v3(centre)).components();
            let side = planar(q[0], q[1]) - radius;
            let cap = q[2].abs() - half_height;
            planar(side.max(zero), cap.max(zero)) + side.max(cap).min(zero)
        }
    }
}
