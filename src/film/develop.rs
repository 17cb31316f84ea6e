//! From radiance to what a screen shows: white balance, exposure, tone curve, encoding.
//!
//! Samples are averaged as radiance, and only their average is developed, as light adds up on a film. So a bright spot that
//! covers a part of a pixel counts by its light.

use super::agx;
use super::primaries::{balanced, p3_from_srgb};
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::{Curve, Encoding, Film};
use crate::kernel::records::Colour;

/// How radiance becomes what a screen shows.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Develop {
    /// What radiance is multiplied by: 1 leaves it as it is.
    pub exposure: f64,
    /// Colour temperature of what is to look white, in kelvin.
    pub white_balance: f64,
    /// What becomes of bright light.
    pub curve: Curve,
    /// The colour space of the bytes.
    pub encoding: Encoding,
}

/// What radiance is multiplied by before the fit.
const SCALE: f64 = 0.62;
/// The fit is `x (a x + b) / (x (c x + d) + e)` with these.
const FIT: [f64; 5] = [2.51, 0.03, 2.43, 0.59, 0.14];
/// Radiance that is as good as infinite: its square is still a number of single precision.
const BLINDING: f64 = 1e6;

impl Develop {
    /// Pictures of solids, where the film says nothing.
    pub const SOLID: Develop =
        Develop { exposure: 1.0, white_balance: Film::NEUTRAL, curve: Curve::Filmic, encoding: Encoding::Srgb };
    /// Pictures of a plane, where the film says nothing.
    pub const PLANE: Develop = Develop { curve: Curve::None, ..Develop::SOLID };

    /// As a film says; `kind` is what the picture has where it says nothing.
    pub fn of(film: &Film, kind: Develop) -> Develop {
        Develop {
            exposure: film.exposure.exp2(),
            white_balance: film.white_balance,
            curve: film.curve.unwrap_or(kind.curve),
            encoding: film.encoding,
        }
    }

    /// The radiance that is shown as this linear colour, of which 0 to 1 counts, at exposure 1 and a neutral white balance.
    pub fn radiance_of(self, shown: [f64; 3]) -> [f64; 3] {
        let shown = shown.map(|y| y.clamp(0.0, 1.0));
        match self.curve {
            Curve::None => shown,
            Curve::Filmic => shown.map(before_filmic),
            Curve::Agx => agx::radiance_of(shown),
        }
    }

    /// Radiance as the curve shows it: linear sRGB, from 0 to 1 but for NaN.
    fn shown(self, radiance: Expr<'_>) -> Expr<'_> {
        let arena = radiance.arena;
        let mut exposed = radiance * self.exposure;
        if self.white_balance != Film::NEUTRAL {
            let balance = balanced(self.white_balance, Film::NEUTRAL);
            exposed = times(balance, exposed.min(arena.f(BLINDING))).max(arena.f(0.0));
        }
        let shown = match self.curve {
            Curve::None => exposed,
            Curve::Filmic => {
                let [a, b, c, d, e] = FIT;
                let x = exposed.min(arena.f(BLINDING)) * SCALE;
                x * (x * a + b) / (x * (x * c + d) + e)
            }
            Curve::Agx => agx::shown(exposed.min(arena.f(BLINDING))),
        };
        shown.clamp(arena.f(0.0), arena.f(1.0))
    }

    /// Radiance as a file holds it: encoded, from 0 to 1. What is not a number is 0.
    fn encoded(self, radiance: Expr<'_>) -> Expr<'_> {
        let arena = radiance.arena;
        let (zero, one) = (arena.f(0.0), arena.f(1.0));
        let mut inside = self.shown(radiance);
        if self.encoding == Encoding::P3 {
            inside = times(p3_from_srgb(), inside).clamp(zero, one);
        }
        let root = inside.max(arena.f(SRGB_LINE_END)).sqrt().sqrt();
        let [rest @ .., highest] = SRGB_CURVE;
        let curve = rest.iter().rev().fold(root * 0.0 + highest, |sum, &coefficient| sum * root + coefficient);
        inside.le(arena.f(SRGB_LINE_END)).select(inside * 12.92, curve).min(one)
    }
}

/// What the filmic curve makes this of. The fit is a quadratic equation, with one root above 0.
fn before_filmic(y: f64) -> f64 {
    let [a, b, c, d, e] = FIT;
    let (p, q, r) = (c * y - a, d * y - b, e * y);
    ((-q - (q * q - 4.0 * p * r).sqrt()) / (2.0 * p)).max(0.0) / SCALE
}

/// A matrix, by rows, times a colour.
pub(super) fn times(rows: [[f64; 3]; 3], colour: Expr<'_>) -> Expr<'_> {
    colour.arena.compose(&rows.map(|row| colour.arena.v3(row).dot(colour)))
}

/// Below this linear value sRGB is a straight line.
const SRGB_LINE_END: f64 = 0.003_130_8;
/// The curve of sRGB as a polynomial of the fourth root of the linear value, from the constant on: within 3e-6 of it, a
/// thousandth of a byte, for a sixth of the time of powers.
const SRGB_CURVE: [f64; 7] =
    [-0.059_739_01, 0.141_958_26, 1.354_572_65, -0.825_280_02, 0.621_002_28, -0.294_247_64, 0.061_734_31];

/// Radiance to bytes of the film's colour space, all three in one number: red is worth 65536, green 256. What is not a number
/// is 0.
pub fn compose_develop(arena: &Arena, develop: Develop) -> Function {
    let mut inputs = Inputs::new(arena);
    let Colour { colour } = Colour::read(&mut inputs);
    let mut function = inputs.function("encode");
    let zero = arena.f(0.0);
    let bytes = is_light(develop, colour).select(develop.encoded(colour) * 255.0 + 0.5, zero).floor();
    let [red, green, blue] = [0, 1, 2].map(|i| bytes.components()[i]);
    function.output("srgb", (red * 256.0 + green) * 256.0 + blue);
    function
}

/// Radiance to encoded numbers from 0 to 1, for files of other depths than bytes. What is not a number is 0.
pub fn compose_encoded(arena: &Arena, develop: Develop) -> Function {
    let mut inputs = Inputs::new(arena);
    let Colour { colour } = Colour::read(&mut inputs);
    let mut function = inputs.function("encoded");
    let encoded = is_light(develop, colour).select(develop.encoded(colour), arena.f(0.0));
    function.output("encoded", encoded);
    function
}

/// Where a colour shows anything: a number, and above 0 where channels do not mix.
fn is_light(develop: Develop, colour: Expr<'_>) -> Expr<'_> {
    let arena = colour.arena;
    let mixes =
        develop.curve == Curve::Agx || develop.encoding == Encoding::P3 || develop.white_balance != Film::NEUTRAL;
    match mixes {
        false => arena.f(0.0).lt(colour),
        // What mixes is a number where all three are.
        true => {
            let is_number = arena.f(0.0).lt(colour).or(colour.le(arena.f(0.0)));
            let [red, green, blue] = [0, 1, 2].map(|i| is_number.components()[i]);
            red.and(green).and(blue).widen(3)
        }
    }
}
