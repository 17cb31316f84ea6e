//! Norms of vectors and of Jacobians, as expressions. All scale before they square, so that single precision does not
//! overflow before the result does.

use crate::expr::{Arena, Expr};

/// The length of a vector.
pub fn scaled_length(v: Expr<'_>) -> Expr<'_> {
    let largest = v.abs().components().into_iter().fold(v.arena.f(1e-30), |a, b| b.max(a));
    (v / largest).length() * largest
}

/// The length of a vector that is at least `least` long. It is scaled by a power of two that takes squares from the low end of
/// single precision's range to its high end: rounded as without, and finite up to 2^114 `least` or 2^127.
pub fn long_length(v: Expr<'_>, least: f64) -> Expr<'_> {
    // Squares keep all their digits where the largest is above 2^-102, and three of them below 2^126 have a sum.
    let scale = (-51.0 - least.log2().floor()).max(-65.0).exp2();
    (v * scale).length() * (1.0 / scale)
}

/// The rows divided by their largest component in size, and that.
fn scaled_rows<'g>(rows: &[Expr<'g>]) -> (Vec<Expr<'g>>, Expr<'g>) {
    let sizes = rows.iter().map(|row| row.abs()).reduce(|a, b| a.max(b)).expect("a Jacobian has rows");
    let parts = sizes.components();
    let largest = parts[0].max(parts[1]).max(parts[2]).max(sizes.arena.f(1e-30));
    (rows.iter().map(|row| *row / largest).collect(), largest)
}

/// The root of the sum of squares of a matrix, given by its rows (3-vectors, at least one).
pub fn frobenius_norm<'g>(rows: &[Expr<'g>]) -> Expr<'g> {
    let (rows, largest) = scaled_rows(rows);
    rows.iter().map(|row| row.dot(*row)).reduce(|a, b| a + b).expect("a Jacobian has rows").sqrt() * largest
}

/// The largest singular value of a matrix, given by its rows (3-vectors, at least one): exact to rounding, also where
/// singular values coincide.
///
/// It is the root of the largest eigenvalue of J^T J, without iteration (D. Eberly, A robust eigensolver for 3x3 symmetric
/// matrices, 2014): the cubic's trigonometric solution gives the eigenvalue that lies apart from the other two to full
/// precision. Where that is the smallest one, the largest follows from the 2x2 matrix across its eigenvector.
pub fn largest_singular_value<'g>(rows: &[Expr<'g>]) -> Expr<'g> {
    let arena = rows[0].arena;
    let (rows, largest) = scaled_rows(rows);
    let gram = Symmetric::gram(&rows);
    let third = arena.f(1.0 / 3.0);
    let mean = (gram.xx + gram.yy + gram.zz) * third;
    // The matrix without its mean, of size about 1.
    let off = Symmetric { xx: gram.xx - mean, yy: gram.yy - mean, zz: gram.zz - mean, ..gram };
    let spread = ((off.xx * off.xx + off.yy * off.yy + off.zz * off.zz) * 0.5
        + (off.xy * off.xy + off.xz * off.xz + off.yz * off.yz))
        .sqrt()
        * third.sqrt();
    let unit = off.scaled(arena.f(1.0) / spread.max(arena.f(1e-18)));
    // acos clamps what rounding puts outside of -1 to 1.
    let angle = (unit.determinant() * 0.5).acos() * third;
    let apart_above = angle.cos() * 2.0;
    let lowest = (angle + 2.0 * std::f64::consts::FRAC_PI_3).cos() * 2.0;
    let apart_below = unit.largest_across(unit.eigenvector(lowest));
    let is_above = angle.lt(arena.f(std::f64::consts::FRAC_PI_6));
    let highest = mean + spread * is_above.select(apart_above, apart_below);
    highest.max(arena.f(0.0)).sqrt() * largest
}

/// A symmetric 3x3 matrix.
#[derive(Clone, Copy)]
struct Symmetric<'g> {
    xx: Expr<'g>,
    yy: Expr<'g>,
    zz: Expr<'g>,
    xy: Expr<'g>,
    xz: Expr<'g>,
    yz: Expr<'g>,
}

impl<'g> Symmetric<'g> {
    /// J^T J.
    fn gram(rows: &[Expr<'g>]) -> Symmetric<'g> {
        let parts: Vec<Vec<Expr<'g>>> = rows.iter().map(|row| row.components()).collect();
        let entry = |i: usize, j: usize| {
            parts.iter().map(|row| row[i] * row[j]).reduce(|a, b| a + b).expect("a Jacobian has rows")
        };
        Symmetric {
            xx: entry(0, 0),
            yy: entry(1, 1),
            zz: entry(2, 2),
            xy: entry(0, 1),
            xz: entry(0, 2),
            yz: entry(1, 2),
        }
    }

    fn scaled(self, factor: Expr<'g>) -> Symmetric<'g> {
        Symmetric {
            xx: self.xx * factor,
            yy: self.yy * factor,
            zz: self.zz * factor,
            xy: self.xy * factor,
            xz: self.xz * factor,
            yz: self.yz * factor,
        }
    }

    fn rows(self) -> [Expr<'g>; 3] {
        let arena = self.xx.arena;
        [[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]]
            .map(|row| arena.compose(&row))
    }

    fn determinant(self) -> Expr<'g> {
        let [x, y, z] = self.rows();
        x.dot(y.cross(z))
    }

    fn times(self, v: Expr<'g>) -> Expr<'g> {
        v.arena.compose(&self.rows().map(|row| row.dot(v)))
    }

    /// The unit eigenvector of an eigenvalue that no other one is near: across two rows of what is left without it. Where
    /// all is 0 any vector is one.
    fn eigenvector(self, value: Expr<'g>) -> Expr<'g> {
        let arena = value.arena;
        let less = Symmetric { xx: self.xx - value, yy: self.yy - value, zz: self.zz - value, ..self };
        let [x, y, z] = less.rows();
        let longer = |a: Expr<'g>, b: Expr<'g>| a.dot(a).lt(b.dot(b)).select(b, a);
        let across = longer(longer(x.cross(y), y.cross(z)), x.cross(z));
        let length = across.length();
        let is_zero = length.lt(arena.f(1e-9));
        is_zero.select(arena.v3([0.0, 0.0, 1.0]), across / length.max(arena.f(1e-9)))
    }

    /// The largest eigenvalue of the 2x2 matrix on the plane across a unit vector.
    fn largest_across(self, normal: Expr<'g>) -> Expr<'g> {
        let (u, w) = tangents(normal);
        let (at_u, at_w) = (self.times(u), self.times(w));
        let (uu, ww, uw) = (u.dot(at_u), w.dot(at_w), u.dot(at_w));
        let half = (uu - ww) * 0.5;
        (uu + ww) * 0.5 + (half * half + uw * uw).sqrt()
    }
}

/// Two unit vectors across a unit vector and each other (Duff et al., Building an orthonormal basis, revisited, 2017).
fn tangents(normal: Expr<'_>) -> (Expr<'_>, Expr<'_>) {
    let arena: &Arena = normal.arena;
    let n = normal.components();
    let (one, zero) = (arena.f(1.0), arena.f(0.0));
    let sign = n[2].lt(zero).select(-one, one);
    let a = -one / (sign + n[2]);
    let b = n[0] * n[1] * a;
    let u = arena.compose(&[one + sign * n[0] * n[0] * a, sign * b, -(sign * n[0])]);
    let w = arena.compose(&[b, sign + n[1] * n[1] * a, -n[1]]);
    (u, w)
}
