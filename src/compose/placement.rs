//! Placed fields: points from the world into a node's own frame, and distances back.

use super::certified::growth_of;
use super::maps::{Moved, apply_all};
use super::{ComposeResult, Composer};
use crate::expr::Expr;
use crate::graph::{NodeRef, Placement, Tiling};

/// One part of the way into a frame.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Place {
    /// Scaled, turned and moved.
    Placed(Placement),
    /// Through a map.
    Warped(NodeRef),
    /// Into the cell of the nearest copy, or along the axes that say so of the second nearest.
    Tiled(Tiling, [bool; 3]),
}

/// A chain of places, outermost first.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Frame {
    places: Vec<Place>,
}

impl Frame {
    /// This frame with one more placement inside it.
    pub fn inside(&self, placement: Placement) -> Frame {
        self.with(Place::Placed(placement))
    }

    /// This frame with one more place inside it.
    pub fn with(&self, place: Place) -> Frame {
        let mut places = self.places.clone();
        places.push(place);
        Frame { places }
    }

    /// Its places, outermost first.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// World units per unit of the inner frame, by placements alone.
    pub fn scale(&self) -> f64 {
        self.places.iter().map(|place| if let Place::Placed(p) = place { p.scale } else { 1.0 }).product()
    }

    /// What of w a placed orbit of four components sees where its `slice` is 0: placements of four components move it.
    pub fn slice(&self) -> f64 {
        let placed = self.places.iter().filter_map(|place| if let Place::Placed(p) = place { Some(p) } else { None });
        placed.fold(0.0, |w, placement| (w - placement.translate[3]) / placement.scale)
    }

    /// The maps that space is warped by.
    pub fn maps(&self) -> impl Iterator<Item = NodeRef> {
        self.places.iter().filter_map(|place| if let Place::Warped(by) = place { Some(*by) } else { None })
    }

    /// A world point in the inner frame, with the running derivative of the way.
    pub(super) fn locate<'g>(&self, composer: &Composer<'g>, start: Moved<'g>) -> ComposeResult<Moved<'g>> {
        self.places.iter().try_fold(start, |moved, place| place.enter(composer, moved))
    }

    /// How far from a world point nothing is nearer to its image than `d`, a distance of the inner frame. Below 0 it is how
    /// far all is inside.
    pub(super) fn distance_back<'g>(
        &self,
        composer: &Composer<'g>,
        p: Expr<'g>,
        d: Expr<'g>,
        unit: f64,
    ) -> ComposeResult<Expr<'g>> {
        let mut before = Vec::new();
        let mut at = p;
        for place in &self.places {
            before.push(at);
            at = place.enter(composer, Moved { z: at, dr: None })?.z;
        }
        let mut left = d.abs();
        for (place, at) in self.places.iter().zip(before).rev() {
            left = match place {
                Place::Placed(placement) => left * placement.scale,
                Place::Tiled(..) => left,
                Place::Warped(by) => {
                    // Where the map stretches by l at the point, d / l is as far as it can be; over a ball of that size it
                    // stretches by more, and what that leaves is certain. Smaller balls prove more beside poles.
                    let tiny = left.lift(1e-30);
                    let here = growth_of(composer, *by, at, left.lift(0.0), unit)?;
                    let most = left / here.max(tiny);
                    let mut proven = left.lift(0.0);
                    for share in [1.0, 0.5, 0.25] {
                        let ball = most * share;
                        let over = growth_of(composer, *by, at, ball, unit)?;
                        proven = proven.max(ball.min(left / over.max(tiny)));
                    }
                    proven
                }
            };
        }
        Ok(d.lt(d.lift(0.0)).select(-left, left))
    }

    /// World units per unit of the inner frame at a point, where space is warped too.
    pub(super) fn scale_at<'g>(&self, composer: &Composer<'g>, p: Expr<'g>, unit: f64) -> ComposeResult<Expr<'g>> {
        let mut scale = p.arena.f(1.0);
        let mut at = p;
        for place in &self.places {
            match place {
                Place::Placed(placement) => scale = scale * placement.scale,
                Place::Tiled(..) => {}
                Place::Warped(by) => {
                    scale = scale / growth_of(composer, *by, at, p.arena.f(0.0), unit)?.max(p.arena.f(1e-30))
                }
            }
            at = place.enter(composer, Moved { z: at, dr: None })?.z;
        }
        Ok(scale)
    }

    /// The farthest that a ball of `radius` around the inner origin reaches from the world's origin; `None` if space is
    /// warped or tiled.
    pub fn reach(&self, radius: f64) -> Option<f64> {
        self.places.iter().rev().try_fold(radius, |radius, place| {
            let Place::Placed(placement) = place else { return None };
            let offset = placement.translate[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
            Some(radius * placement.scale + offset)
        })
    }
}

impl Place {
    /// A point one frame further in. A fourth component is moved and scaled.
    pub(super) fn enter<'g>(&self, composer: &Composer<'g>, moved: Moved<'g>) -> ComposeResult<Moved<'g>> {
        let xyz = moved.z.xyz();
        let (inner, scale, up) = match self {
            Place::Warped(by) => {
                let c = moved.z.lift(0.0);
                return apply_all(composer, &[*by], moved, c);
            }
            Place::Placed(placement) => (place(xyz, *placement), 1.0 / placement.scale, placement.translate[3]),
            Place::Tiled(tiling, shift) => (tile(xyz, *tiling, *shift).0, 1.0, 0.0),
        };
        let z = match moved.z.ty().width {
            4 => {
                let parts = inner.components();
                let w = moved.z.component(3);
                let w = if up == 0.0 { w } else { w - up };
                xyz.arena.compose(&[parts[0], parts[1], parts[2], w * scale])
            }
            _ => inner,
        };
        Ok(Moved { z, dr: moved.dr.map(|dr| dr * scale) })
    }

    /// What becomes of a direction at a point, for places that are no maps.
    pub(super) fn turn<'g>(&self, z: Expr<'g>, v: Expr<'g>) -> Expr<'g> {
        match self {
            Place::Placed(placement) => rotate(v, placement.axis, -placement.angle) * (1.0 / placement.scale),
            Place::Tiled(tiling, shift) => v * tile(z, *tiling, *shift).1,
            Place::Warped(_) => v,
        }
    }

    /// Length in the inner frame of a unit of the outer one, for places that are no maps.
    pub(super) fn shrink(&self) -> f64 {
        if let Place::Placed(placement) = self { 1.0 / placement.scale } else { 1.0 }
    }
}

fn place(p: Expr<'_>, placement: Placement) -> Expr<'_> {
    let [x, y, z, _] = placement.translate;
    let moved = p - p.arena.v3([x, y, z]);
    rotate(moved, placement.axis, -placement.angle) * (1.0 / placement.scale)
}

/// A point in its cell, and the slope of that along each axis.
fn tile(p: Expr<'_>, tiling: Tiling, shift: [bool; 3]) -> (Expr<'_>, Expr<'_>) {
    let one = p.arena.f(1.0);
    let along = |i: usize| {
        let (x, period) = (p.component(i as u8), tiling.period[i]);
        if period == 0.0 {
            return (x, one);
        }
        let cell = (x * (1.0 / period) + 0.5).floor();
        let q = x - cell * period;
        if tiling.mirror {
            // 1 in every other cell, -1 in those between.
            let slope = one - (cell - (cell * 0.5).floor() * 2.0) * 2.0;
            return (q * slope, slope);
        }
        let side = q.lt(p.arena.f(0.0)).select(-one, one);
        (if shift[i] { q - side * period } else { q }, one)
    };
    let parts = [along(0), along(1), along(2)];
    (p.arena.compose(&parts.map(|part| part.0)), p.arena.compose(&parts.map(|part| part.1)))
}

/// The copies that a field of a tiling is looked up in: with mirrors the nearest alone, without them every combination of
/// the nearest and the second nearest along the axes.
pub(super) fn copies(tiling: Tiling) -> Vec<[bool; 3]> {
    let repeats = tiling.period.map(|period| period > 0.0 && !tiling.mirror);
    (0..8u8)
        .map(|i| [0, 1, 2].map(|axis| i >> axis & 1 == 1))
        .filter(|shift| shift.iter().zip(repeats).all(|(shift, repeats)| repeats || !shift))
        .collect()
}

/// How far nothing of copies farther than the second nearest can be, in the frame of the tiling.
pub(super) fn farther_copies(p: Expr<'_>, tiling: Tiling) -> Option<Expr<'_>> {
    let own = tile(p, tiling, [false; 3]).0;
    let axes = (0..3u8).filter(|axis| tiling.period[usize::from(*axis)] > 0.0 && !tiling.mirror);
    axes.map(|axis| own.component(axis).abs() + tiling.period[usize::from(axis)] * 0.5).reduce(|a, b| a.min(b))
}

/// Rows of the rotation about a unit axis.
pub fn rotation(axis: [f64; 3], angle: f64) -> [[f64; 3]; 3] {
    let (s, c) = angle.sin_cos();
    let [x, y, z] = axis;
    let t = 1.0 - c;
    [
        [t * x * x + c, t * x * y - s * z, t * x * z + s * y],
        [t * x * y + s * z, t * y * y + c, t * y * z - s * x],
        [t * x * z - s * y, t * y * z + s * x, t * z * z + c],
    ]
}

fn rotate<'g>(v: Expr<'g>, axis: [f64; 3], angle: f64) -> Expr<'g> {
    if angle == 0.0 {
        return v;
    }
    let rows = rotation(axis, angle).map(|row| v.arena.v3(row).dot(v));
    v.arena.compose(&rows)
}
