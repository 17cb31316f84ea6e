//! The number type that everything numerical is generic over.
//!
//! `f64` is the scalar reference; [`Lanes`](super::lanes::Lanes) is one native SIMD vector of `f32`. The operator table
//! (`expr/ops.rs`) evaluates every operator once, over this trait, so the interpreter has one body for both precisions.
//! Every method of an implementation that runs below a SIMD dispatch point must be `#[inline(always)]`.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or a SIMD vector of them, with the functions that the operators of a formula need.
///
/// Comparison results are masks; `select` takes `a` where the mask is true.
/// NaN in, NaN out, except for `min` and `max`, which may return either operand.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Proof of the instruction set that the values were made for; `()` for scalars.
    type Token: Copy;
    /// The result of a comparison.
    type Mask: Copy;

    /// All lanes `x`, rounded to the precision of a lane.
    fn splat(token: Self::Token, x: f64) -> Self;

    /// `|self|`.
    fn abs(self) -> Self;
    /// Square root; NaN below 0.
    fn sqrt(self) -> Self;
    /// Largest integer not above `self`.
    fn floor(self) -> Self;
    /// The smaller of the two.
    fn min(self, other: Self) -> Self;
    /// The larger of the two.
    fn max(self, other: Self) -> Self;
    /// `self * a + b`, fused where the machine can.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Sine and cosine of an angle in radians.
    fn sin_cos(self) -> (Self, Self);
    /// Angle of the point (`x`, `self`) in (-pi, pi]; 0 at the origin.
    fn atan2(self, x: Self) -> Self;
    /// Inverse cosine in [0, pi]; NaN outside [-1, 1].
    fn acos(self) -> Self;
    /// Inverse sine in [-pi/2, pi/2]; NaN outside [-1, 1].
    fn asin(self) -> Self;
    /// e to the power `self`.
    fn exp(self) -> Self;
    /// Natural logarithm; -infinity at 0, NaN below.
    fn ln(self) -> Self;
    /// `self` to the power `y`; NaN for a negative base and 0^0 = 1.
    fn pow(self, y: Self) -> Self;

    /// `self < other`.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`.
    fn le(self, other: Self) -> Self::Mask;
    /// `self == other`.
    fn eq(self, other: Self) -> Self::Mask;
    /// `a` where `mask`, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Both.
    fn mask_and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Either.
    fn mask_or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Neither.
    fn mask_not(a: Self::Mask) -> Self::Mask;
    /// 1 where the mask is true, else 0.
    fn from_mask(token: Self::Token, mask: Self::Mask) -> Self;
    /// True where `self` is above one half: the inverse of [`Real::from_mask`].
    fn to_mask(self) -> Self::Mask;
}

/// A [`Real`] whose lanes can be looked at: moved from and to memory, and decided on.
pub trait Pack: Real {
    /// One lane.
    type Scalar: Copy + Send + Sync + Into<f64> + PartialOrd + 'static;
    /// Lanes in one value.
    const LANES: usize;

    /// Reads `LANES` values from the front of `src`. Panics when `src` is shorter.
    fn load(token: Self::Token, src: &[Self::Scalar]) -> Self;
    /// Writes `LANES` values to the front of `dst`. Panics when `dst` is shorter.
    fn store(self, dst: &mut [Self::Scalar]);
    /// Rounds a number to the precision of a lane.
    fn scalar(x: f64) -> Self::Scalar;
    /// True when the mask is in any lane.
    fn mask_any(mask: Self::Mask) -> bool;
}
