//! From radiance to what a screen shows: exposure, tone curve, encoding.
//!
//! Samples are averaged as radiance, and only their average is developed, as light adds up on a film. So a bright spot that
//! covers a part of a pixel counts by its light.

use crate::expr::{Arena, Expr, Function, Inputs};
use crate::kernel::records::Colour;

/// How radiance becomes what a screen shows.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Develop {
    /// What radiance is multiplied by.
    pub exposure: f64,
    /// What becomes of bright light.
    pub curve: Curve,
}

/// What becomes of bright light.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Curve {
    /// Nothing: radiance from 0 to 1 is shown as it is, and what is brighter as 1. Drawings such as pictures of a plane.
    Straight,
    /// It is compressed smoothly, as film does (the rational fit of the ACES curve by Narkowicz, 2015).
    Filmic,
}

/// What radiance is multiplied by before the fit.
const SCALE: f64 = 0.62;
/// The fit is `x (a x + b) / (x (c x + d) + e)` with these.
const FIT: [f64; 5] = [2.51, 0.03, 2.43, 0.59, 0.14];
/// Radiance that is as good as infinite: its square is still a number of single precision.
const BLINDING: f64 = 1e6;

impl Develop {
    /// Pictures of solids.
    pub const SOLID: Develop = Develop { exposure: 1.0, curve: Curve::Filmic };
    /// Pictures of a plane.
    pub const PLANE: Develop = Develop { exposure: 1.0, curve: Curve::Straight };

    /// The radiance that is shown as this linear colour, of which 0 to 1 counts.
    pub fn radiance_of(self, shown: [f64; 3]) -> [f64; 3] {
        shown.map(|y| self.before_curve(y.clamp(0.0, 1.0)) / self.exposure)
    }

    /// What the curve makes this of. The fit is a quadratic equation, with one root above 0.
    fn before_curve(self, y: f64) -> f64 {
        if self.curve == Curve::Straight {
            return y;
        }
        let [a, b, c, d, e] = FIT;
        let (p, q, r) = (c * y - a, d * y - b, e * y);
        ((-q - (q * q - 4.0 * p * r).sqrt()) / (2.0 * p)).max(0.0) / SCALE
    }

    /// Radiance as the curve shows it: linear, from 0 to 1 but for NaN.
    fn shown(self, radiance: Expr<'_>) -> Expr<'_> {
        let arena = radiance.arena;
        let exposed = radiance * self.exposure;
        let shown = match self.curve {
            Curve::Straight => exposed,
            Curve::Filmic => {
                let [a, b, c, d, e] = FIT;
                let x = exposed.min(arena.f(BLINDING)) * SCALE;
                x * (x * a + b) / (x * (x * c + d) + e)
            }
        };
        shown.clamp(arena.f(0.0), arena.f(1.0))
    }
}

/// Below this linear value sRGB is a straight line.
const SRGB_LINE_END: f64 = 0.003_130_8;
/// The curve of sRGB as a polynomial of the fourth root of the linear value, from the constant on: within 3e-6 of it, a
/// thousandth of a byte, for a sixth of the time of powers.
const SRGB_CURVE: [f64; 7] =
    [-0.059_739_01, 0.141_958_26, 1.354_572_65, -0.825_280_02, 0.621_002_28, -0.294_247_64, 0.061_734_31];

/// Radiance to bytes of sRGB (IEC 61966-2-1), all three in one number: red is worth 65536, green 256. What is not a number
/// is 0.
pub fn compose_develop(arena: &Arena, develop: Develop) -> Function {
    let mut inputs = Inputs::new(arena);
    let Colour { colour } = Colour::read(&mut inputs);
    let mut function = inputs.function("encode");
    let (zero, one) = (arena.f(0.0), arena.f(1.0));
    let inside = develop.shown(colour);
    let root = inside.max(arena.f(SRGB_LINE_END)).sqrt().sqrt();
    let [rest @ .., highest] = SRGB_CURVE;
    let curve = rest.iter().rev().fold(root * 0.0 + highest, |sum, &coefficient| sum * root + coefficient);
    let srgb = inside.le(arena.f(SRGB_LINE_END)).select(inside * 12.92, curve);
    let bytes = zero.lt(colour).select(srgb.min(one) * 255.0 + 0.5, zero).floor();
    let [red, green, blue] = [0, 1, 2].map(|i| bytes.components()[i]);
    function.output("srgb", (red * 256.0 + green) * 256.0 + blue);
    function
}
