//! Placed fields: points from the world into a node's own frame.

use crate::expr::Expr;
use crate::graph::Placement;

/// A chain of placements, outermost first.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Frame {
    placements: Vec<Placement>,
}

impl Frame {
    /// This frame with one more placement inside it.
    pub fn inside(&self, placement: Placement) -> Frame {
        let mut placements = self.placements.clone();
        placements.push(placement);
        Frame { placements }
    }

    /// World units per unit of the inner frame.
    pub fn scale(&self) -> f64 {
        self.placements.iter().map(|p| p.scale).product()
    }

    /// A world point in the inner frame. A fourth component is only scaled.
    pub fn local_from_world<'g>(&self, p: Expr<'g>) -> Expr<'g> {
        if p.ty().width == 4 && !self.placements.is_empty() {
            let local = self.local_from_world(p.xyz()).components();
            return p.arena.compose(&[local[0], local[1], local[2], p.component(3) * (1.0 / self.scale())]);
        }
        self.placements.iter().fold(p, |p, placement| {
            let moved = p - p.arena.v3(placement.translate);
            let turned = rotate(moved, placement.axis, -placement.angle);
            turned * (1.0 / placement.scale)
        })
    }

    /// The farthest that a ball of `radius` around the inner origin reaches from the world's origin.
    pub fn reach(&self, radius: f64) -> f64 {
        self.placements.iter().rev().fold(radius, |radius, placement| {
            let offset = placement.translate.iter().map(|x| x * x).sum::<f64>().sqrt();
            radius * placement.scale + offset
        })
    }
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
