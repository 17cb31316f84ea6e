//! Surfaces where rays stop at a threshold: the normal is that of the estimate over the threshold, not below it.
//!
//! A point that far from the set sees detail of its size. The gradient of an orbit's end is that of the finest detail, so neighbouring
//! pixels would get normals that have nothing to do with each other. Instead the estimate is taken at the corners of a
//! tetrahedron as large as the threshold; their differences are the normal.

use super::field::{FieldBuilder, Leaf, Shows, drop_unread, field_orbits};
use super::matter::{Painter, write_matter};
use super::orbit::compose_orbit;
use super::paint::untouched;
use super::{Choice, ComposeResult, Composer, Purpose};
use crate::expr::{Expr, Function, substitute};
use crate::kernel::records::{Query, Surface};
use crate::kernel::{Estimator, Orbit};

/// Corners of a tetrahedron, in thresholds.
const CORNERS: [[f64; 3]; 4] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];

/// The estimator of [`Purpose::Surface`] with normals over the threshold. Traps are those of the point itself.
pub(super) fn compose_soft_surface(composer: &Composer, choices: &[Choice]) -> ComposeResult<Estimator> {
    let (arena, look) = (composer.arena, &composer.graph.scene.look);
    let specs = field_orbits(composer);
    let Query { p, hit_eps, .. } = Query::first(arena);
    let corner = |to: [f64; 3]| p + arena.v3(to) * hit_eps;
    let mut orbits: Vec<Orbit> = Vec::new();
    let places = std::iter::once(None).chain(CORNERS.map(Some)).enumerate();
    for (k, place) in places {
        let purpose = if place.is_some() { Purpose::Estimate } else { Purpose::Surface };
        for (i, (spec, choice)) in specs.iter().zip(choices).enumerate() {
            let name = format!("orbit_{}", k * specs.len() + i);
            let mut orbit = compose_orbit(composer, name, spec.root, &spec.settings, &spec.frame, choice, purpose)?;
            if let Some(to) = place {
                let roots: Vec<Expr> = orbit.init.outputs.iter().map(|(_, id)| arena.expr(*id)).collect();
                let moved = substitute(arena, &roots, &[(p, corner(to))]);
                orbit.init.outputs.iter_mut().zip(moved).for_each(|(output, e)| output.1 = e.id);
            }
            orbits.push(orbit);
        }
    }
    let mut inputs = Estimator::inputs();
    let leaves: Vec<Leaf> = orbits.iter().map(|orbit| Leaf::new(arena, orbit, &mut inputs)).collect();
    let (own, corners) = leaves.split_at(specs.len());
    let mut combine = Function::new("combine", inputs);
    let builder = |leaves, purpose, at| {
        let (specs, n, painter) = (&specs[..], arena.f(0.0), Painter::of_look(look));
        let shows = Shows::Matter;
        FieldBuilder { composer, specs, choices, leaves: Some(leaves), purpose, at, n, painter, shows }
    };
    let field = |leaves, purpose, at| {
        let field: FieldBuilder = builder(leaves, purpose, at);
        field.value(composer.graph.output, &Default::default())
    };
    let value = field(own, Purpose::Surface, p)?;
    let mut slope = arena.v3([0.0; 3]);
    for (k, to) in CORNERS.into_iter().enumerate() {
        let leaves = &corners[k * specs.len()..][..specs.len()];
        slope = slope + arena.v3(to) * field(leaves, Purpose::Estimate, corner(to))?.d;
    }
    let length = slope.length();
    let fallback = value.gradient.unwrap_or_else(|| arena.v3([0.0, 0.0, 1.0]));
    // Where nothing differs, or something is not a number, the point's own gradient has to do.
    let is_known = arena.f(0.0).lt(length).and(length.lt(arena.f(1e30)));
    let gradient = is_known.select(slope / length.max(arena.f(1e-30)), fallback);
    Surface { gradient, trap: value.trap.unwrap_or_else(|| untouched(arena)) }.write(&mut combine);
    if let Some(matter) = builder(own, Purpose::Surface, p).matter(&value)? {
        write_matter(look, matter, &mut combine);
    }
    drop_unread(arena, &mut orbits, &combine);
    Ok(Estimator { orbits, combine })
}
