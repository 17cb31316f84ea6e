//! Noise of arithmetic alone, so that every back end makes the same of it: gradient noise over a lattice whose corners are
//! shuffled by a polynomial.
//!
//! Source: K. Perlin, "Improving noise", 2002, for the noise and its fade; S. Gustavson and I. McEwan, "Tiling simplex noise and flow noise in two
//! and three dimensions", 2022, for the polynomial. Here a corner's slope has three shares of its number as components.

use super::{Arena, Expr, Type};

/// Corners along an axis before the lattice repeats; all numbers below stay whole in single precision.
const PERIOD: f64 = 289.0;
/// Largest number of octaves.
pub const MOST_OCTAVES: i64 = 8;
/// Divisors of a corner's number whose rests are the components of its slope: without common factors.
const SHARES: [f64; 3] = [7.0, 11.0, 17.0];
/// Makes most of the values fill the range from -1 to 1.
const GAIN: f64 = 1.25;

/// The rest of a whole number. The half keeps quotients away from whole numbers, where rounding would decide.
fn rest(x: Expr<'_>, by: f64) -> Expr<'_> {
    x - ((x + 0.5) * (1.0 / by)).floor() * by
}

/// Shuffles the numbers from 0 up to the period.
fn shuffled(x: Expr<'_>) -> Expr<'_> {
    rest((x * 34.0 + 10.0) * x, PERIOD)
}

/// The noise of one layer of four corners: at `fx` and `fx - 1`, `fy` and `fy - 1`, all at `fz`, mixed along x and y.
fn layer<'g>(arena: &'g Arena, corners: Expr<'g>, [fx, fy, fz]: [Expr<'g>; 3], [ux, uy]: [Expr<'g>; 2]) -> Expr<'g> {
    let corner = |dx: [f64; 4]| arena.constant(Type::V4, dx);
    let offsets = [fx.widen(4) - corner([0.0, 1.0, 0.0, 1.0]), fy.widen(4) - corner([0.0, 0.0, 1.0, 1.0]), fz.widen(4)];
    let slope = |by: f64| rest(corners, by) * (2.0 / (by - 1.0)) - 1.0;
    let terms = SHARES.into_iter().zip(offsets).map(|(by, offset)| slope(by) * offset);
    let Some(sum) = terms.reduce(|a, b| a + b) else { return arena.f(0.0) };
    let along_x = |i: u8| sum.component(i).mix(sum.component(i + 1), ux);
    along_x(0).mix(along_x(2), uy)
}

impl<'g> Expr<'g> {
    /// Gradient noise at a point of three components: smooth, about from -1 to 1, 0 at corners of the lattice of whole
    /// numbers. It repeats after 289 units.
    pub fn noise(self) -> Expr<'g> {
        let arena = self.arena;
        let whole = self.floor();
        let inside = self - whole;
        let start = rest(whole, PERIOD);
        let next = rest(start + 1.0, PERIOD);
        let fade = inside * inside * inside * (inside * (inside * 6.0 - 15.0) + 10.0);
        let (first, second) = (start.components(), next.components());
        let [x0, x1] = [shuffled(first[0]), shuffled(second[0])];
        let columns = arena.compose(&[x0 + first[1], x1 + first[1], x0 + second[1], x1 + second[1]]);
        let columns = shuffled(rest(columns, PERIOD));
        let slab = |z: Expr<'g>| shuffled(rest(columns + z, PERIOD));
        let (at, share) = (inside.components(), fade.components());
        let across = [share[0], share[1]];
        let low = layer(arena, slab(first[2]), [at[0], at[1], at[2]], across);
        let high = layer(arena, slab(second[2]), [at[0], at[1], at[2] - 1.0], across);
        low.mix(high, share[2]) * GAIN
    }

    /// A sum of noises, each of half the size and half the height of the one before.
    pub fn octaves(self, count: u32) -> Expr<'g> {
        let mut sum = self.noise();
        let (mut point, mut height) = (self, 1.0);
        for _ in 1..count {
            // Moved, so that the zeros of the lattices do not meet.
            point = point * 2.0 + self.arena.v3([17.3, 5.9, 11.7]);
            height *= 0.5;
            sum = sum + point.noise() * height;
        }
        sum
    }
}
