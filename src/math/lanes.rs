//! [`Lanes`], one native SIMD vector of `f32`, and the elementary functions that `fearless_simd` lacks.
//!
//! The functions are branch-free and make no calls. Their caller must be inlined into a SIMD dispatch point, and all
//! code in between, closures too, must be `#[inline(always)]`:
//!
//! ```ignore
//! #[inline(always)]
//! fn sines<S: Simd>(token: S, samples: &mut [f32]) {
//!     for chunk in samples.chunks_exact_mut(Lanes::<S>::LANES) {
//!         Lanes::load(token, chunk).sin_cos().0.store(chunk);
//!     }
//! }
//! fearless_simd::dispatch!(Level::new(), token => sines(token, &mut samples));
//! ```
//!
//! Where an exact product is needed, `mul_add_precise` is used: one instruction with FMA, an emulation without.
//! Coefficients come from Cephes (Moshier), SLEEF (Shibata and Petrogalli) and our own fits, as noted at each function.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, LN_2, LOG2_E, PI};
use std::ops::{Add, Div, Mul, Neg, Sub};

use fearless_simd::{Bytes, ExtractToken, Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask};

use super::real::{Pack, Real};

/// 1.5 * 2^23: adding it rounds a small number to an integer, which the low bits of the sum then hold.
const ROUNDER: f32 = 12_582_912.0;

/// One native SIMD vector of `f32` at the SIMD level `S`.
#[derive(Clone, Copy)]
pub struct Lanes<S: Simd>(pub S::f32s);

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(self.0 * other.0)
    }
}

impl<S: Simd> Div for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(self.0 / other.0)
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<S: Simd> Real for Lanes<S> {
    type Token = S;
    type Mask = S::mask32s;
    #[inline(always)]
    fn splat(token: S, x: f64) -> Self {
        Self(S::f32s::splat(token, x as f32))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.floor())
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self(self.0.mul_add(a.0, b.0))
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = sin_cos::<S>(self.0);
        (Self(sin), Self(cos))
    }

    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        Self(atan2::<S>(self.0, x.0))
    }

    #[inline(always)]
    fn acos(self) -> Self {
        Self(acos::<S>(self.0))
    }

    #[inline(always)]
    fn asin(self) -> Self {
        Self(asin::<S>(self.0))
    }

    #[inline(always)]
    fn exp(self) -> Self {
        Self(exp::<S>(self.0))
    }

    #[inline(always)]
    fn ln(self) -> Self {
        Self(ln::<S>(self.0))
    }

    #[inline(always)]
    fn pow(self, y: Self) -> Self {
        Self(pow::<S>(self.0, y.0))
    }

    #[inline(always)]
    fn lt(self, other: Self) -> S::mask32s {
        self.0.simd_lt(other.0)
    }

    #[inline(always)]
    fn le(self, other: Self) -> S::mask32s {
        self.0.simd_le(other.0)
    }

    #[inline(always)]
    fn eq(self, other: Self) -> S::mask32s {
        self.0.simd_eq(other.0)
    }

    #[inline(always)]
    fn select(mask: S::mask32s, a: Self, b: Self) -> Self {
        Self(mask.select(a.0, b.0))
    }

    #[inline(always)]
    fn mask_and(a: S::mask32s, b: S::mask32s) -> S::mask32s {
        a & b
    }

    #[inline(always)]
    fn mask_or(a: S::mask32s, b: S::mask32s) -> S::mask32s {
        a | b
    }

    #[inline(always)]
    fn mask_not(a: S::mask32s) -> S::mask32s {
        !a
    }

    #[inline(always)]
    fn from_mask(token: S, mask: S::mask32s) -> Self {
        Self(mask.select(S::f32s::splat(token, 1.0), S::f32s::splat(token, 0.0)))
    }

    #[inline(always)]
    fn to_mask(self) -> S::mask32s {
        self.0.simd_gt(0.5)
    }
}

impl<S: Simd> Pack for Lanes<S> {
    type Scalar = f32;
    const LANES: usize = <S::f32s as SimdBase<S>>::LEN;

    #[inline(always)]
    fn load(token: S, src: &[f32]) -> Self {
        Self(S::f32s::from_slice(token, &src[..Self::LANES]))
    }

    #[inline(always)]
    fn store(self, dst: &mut [f32]) {
        self.0.store_slice(&mut dst[..Self::LANES]);
    }

    #[inline(always)]
    fn scalar(x: f64) -> f32 {
        x as f32
    }

    #[inline(always)]
    fn mask_any(mask: S::mask32s) -> bool {
        mask.any_true()
    }
}

/// All lanes `value`, at the level of `like`.
#[inline(always)]
fn same<S: Simd>(like: S::f32s, value: f32) -> S::f32s {
    S::f32s::splat(like.token(), value)
}

/// The polynomial with `coefficients`, highest power first, at `x`: even and odd powers apart, to halve the latency.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(x: S::f32s, coefficients: [f32; N]) -> S::f32s {
    let square = x * x;
    let mut high = same::<S>(x, coefficients[0]);
    let mut low = same::<S>(x, coefficients[1]);
    let mut power = 2;
    while power < N {
        let next = high.mul_add(square, coefficients[power]);
        high = low;
        low = next;
        power += 1;
    }
    high.mul_add(x, low)
}

/// Sine and cosine: three-part Cody-Waite reduction to [-pi/4, pi/4], then the polynomials of Cephes `sinf` and `cosf`.
///
/// Beyond about 6e6, where the quarter turns no longer fit `ROUNDER`, the result is some point on the unit circle.
#[inline(always)]
fn sin_cos<S: Simd>(x: S::f32s) -> (S::f32s, S::f32s) {
    // pi/2 as the sum of three `f32`; all positive, to keep the sign of -0.
    const HALF_PI: [f32; 3] = [FRAC_PI_2.next_down(), 7.549_789_4e-8, 5.390_303e-15];
    let shifted = x.mul_add(2.0 * FRAC_1_PI, ROUNDER);
    let quarter_turns = shifted - ROUNDER;
    let turns: S::u32s = shifted.bitcast();

    // The first product must not be rounded, even where a fused multiply-add has to be emulated.
    let reduced = quarter_turns.mul_add_precise(-HALF_PI[0], x);
    let reduced = quarter_turns.mul_add(-HALF_PI[1], reduced);
    let reduced = quarter_turns.mul_add(-HALF_PI[2], reduced);
    let r = reduced.abs().simd_le(1.0).select(reduced, x * 0.0);

    let z = r * r;
    let sin = z.mul_add(-1.951_529_6e-4, 8.332_161e-3).mul_add(z, -0.166_666_55);
    // Adding 0 makes this 0, not -0, for r = -0, which keeps the sign of sin(-0).
    let sin = z.mul_add(sin, 0.0).mul_add(r, r);
    let cos = z.mul_add(2.443_315_7e-5, -1.388_731_6e-3).mul_add(z, 4.166_664_6e-2);
    let cos = cos.mul_add(z, -0.5).mul_add(z, 1.0);

    let even = (turns & 1).simd_eq(0);
    let sin_sign = (turns & 2) << 30;
    let cos_sign = ((turns + 1) & 2) << 30;
    (flip_sign::<S>(even.select(sin, cos), sin_sign), flip_sign::<S>(even.select(cos, sin), cos_sign))
}

/// `x` with the bits of `sign` flipped.
#[inline(always)]
fn flip_sign<S: Simd>(x: S::f32s, sign: S::u32s) -> S::f32s {
    let bits: S::u32s = x.bitcast();
    (bits ^ sign).bitcast()
}

/// Angle of (`x`, `y`): the smaller over the larger magnitude, and SLEEF's `atan2f_u35` polynomial on [0, 1].
///
/// The first coefficient is 3e-8 above SLEEF's, which makes the diagonals exact.
#[inline(always)]
fn atan2<S: Simd>(y: S::f32s, x: S::f32s) -> S::f32s {
    let (width, height) = (x.abs(), y.abs());
    let steep = height.simd_gt(width);
    let large = steep.select(height, width);
    let small = steep.select(width, height);
    let ratio = small / large;
    // Two infinities count as the diagonal; the origin has angle 0. What is not a number equals nothing and stays.
    let diagonal = large.simd_eq(0.0).select(same::<S>(x, 0.0), same::<S>(x, 1.0));
    let ratio = small.simd_eq(large).select(diagonal, ratio);

    let z = ratio * ratio;
    let tail = polynomial::<S, 8>(
        z,
        [
            0.002_823_669,
            -0.015_956_903,
            0.042_504_99,
            -0.074_890_09,
            0.106_347_93,
            -0.142_027_36,
            0.199_926_96,
            -0.333_331_02,
        ],
    );
    // FRAC_PI_2 is this much too large.
    let excess = steep.select(same::<S>(x, 4.371_139e-8), same::<S>(x, 0.0));
    let angle = (ratio * z).mul_add(tail, excess) + ratio;
    let angle = steep.select(same::<S>(x, FRAC_PI_2) - angle, angle);
    let angle = x.simd_lt(0.0).select(same::<S>(x, PI) - angle, angle);
    angle.copysign(y)
}

/// asin of `|x|` where that is at most one half, else of sqrt((1 - |x|) / 2): and a mask, true in the latter case.
///
/// The polynomial is that of Cephes `asinf`.
#[inline(always)]
fn asin_core<S: Simd>(x: S::f32s) -> (S::f32s, S::mask32s) {
    let magnitude = x.abs();
    let large = magnitude.simd_gt(0.5);
    let z = large.select(magnitude.mul_add(-0.5, 0.5), magnitude * magnitude);
    let s = large.select(z.sqrt(), magnitude);
    let tail = polynomial::<S, 5>(z, [0.042_163_2, 0.024_181_312, 0.045_470_026, 0.074_953, 0.166_667_52]);
    ((s * z).mul_add(tail, s), large)
}

/// Inverse sine: asin x = pi/2 - 2 asin sqrt((1 - x) / 2) above one half.
#[inline(always)]
fn asin<S: Simd>(x: S::f32s) -> S::f32s {
    let (core, large) = asin_core::<S>(x);
    let angle = large.select(core.mul_add(-2.0, FRAC_PI_2), core);
    angle.copysign(x)
}

/// Inverse cosine: 2 asin sqrt((1 - x) / 2) above one half, pi minus that of -x below minus one half.
#[inline(always)]
fn acos<S: Simd>(x: S::f32s) -> S::f32s {
    let (core, large) = asin_core::<S>(x);
    let outer = x.simd_lt(0.0).select(same::<S>(x, PI), same::<S>(x, 0.0));
    let base = large.select(outer, same::<S>(x, FRAC_PI_2));
    let factor = large.select(same::<S>(x, 2.0), same::<S>(x, -1.0));
    core.copysign(x).mul_add(factor, base)
}

/// `value * 2^n`, where `shifted` is `n + ROUNDER` and -200 < n < 200; two factors, so that subnormals come out.
#[inline(always)]
fn scale<S: Simd>(value: S::f32s, shifted: S::f32s) -> S::f32s {
    let bits: S::i32s = shifted.bitcast();
    let both = bits + (254 - ROUNDER.to_bits() as i32);
    let first = both >> 1;
    let second = both - first;
    let first: S::f32s = (first << 23).bitcast();
    let second: S::f32s = (second << 23).bitcast();
    value * first * second
}

/// `x` held to [`low`, `high`]; NaN stays.
#[inline(always)]
fn hold<S: Simd>(x: S::f32s, low: f32, high: f32) -> S::f32s {
    let x = x.simd_gt(high).select(same::<S>(x, high), x);
    x.simd_lt(low).select(same::<S>(x, low), x)
}

/// e^x: reduction by multiples of ln 2, then the polynomial of Cephes `expf`.
#[inline(always)]
fn exp<S: Simd>(x: S::f32s) -> S::f32s {
    // ln 2 as the sum of two `f32`, the first short enough for exact products.
    const LN_2_PARTS: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    let x = hold::<S>(x, -104.0, 89.0);
    let shifted = x.mul_add(LOG2_E, ROUNDER);
    let n = shifted - ROUNDER;
    let r = n.mul_add(-LN_2_PARTS[0], x);
    let r = n.mul_add(-LN_2_PARTS[1], r);
    let tail = polynomial::<S, 6>(r, [1.987_569_1e-4, 1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5]);
    let power = (r * r).mul_add(tail, r) + 1.0;
    scale::<S>(power, shifted)
}

/// `x` as m * 2^e with sqrt(1/2) <= m < sqrt(2): (e, m). For positive finite `x`, subnormals included.
#[inline(always)]
fn split<S: Simd>(x: S::f32s) -> (S::f32s, S::f32s) {
    const SQRT_HALF: i32 = std::f32::consts::FRAC_1_SQRT_2.to_bits() as i32;
    let tiny = x.simd_lt(f32::MIN_POSITIVE);
    let normal = tiny.select(x * 16_777_216.0, x);
    let bits: S::i32s = normal.bitcast();
    let above = bits - SQRT_HALF;
    let exponent: S::f32s = (above >> 23).to_float();
    let exponent = tiny.select(exponent - 24.0, exponent);
    let mantissa: S::f32s = (bits - (above & !0x7f_ffff)).bitcast();
    (exponent, mantissa)
}

/// Natural logarithm, with the polynomial of Cephes `logf`.
#[inline(always)]
fn ln<S: Simd>(x: S::f32s) -> S::f32s {
    let (exponent, mantissa) = split::<S>(x);
    let f = mantissa - 1.0;
    let z = f * f;
    let tail = polynomial::<S, 9>(
        f,
        [
            0.070_376_84,
            -0.115_146_1,
            0.116_769_984,
            -0.124_201_41,
            0.142_493_23,
            -0.166_680_58,
            0.200_007_15,
            -0.249_999_94,
            0.333_333_3,
        ],
    );
    let small = (f * z).mul_add(tail, exponent * -2.121_944_4e-4);
    let small = z.mul_add(-0.5, small);
    let result = exponent.mul_add(0.693_359_4, f + small);

    // Infinity and NaN give themselves.
    let result = x.simd_lt(f32::INFINITY).select(result, x);
    let below = x.simd_lt(0.0).select(same::<S>(x, f32::NAN), result);
    x.simd_eq(0.0).select(same::<S>(x, f32::NEG_INFINITY), below)
}

/// log2 of a positive finite `x` as an unevaluated sum (high, low) of two `f32`, good to about 2^-31.
///
/// log2 m = s (2 / ln 2 + s^2 Q(s^2)) with s = (m - 1) / (m + 1); Q is our own fit for s^2 up to 0.0295.
#[inline(always)]
fn log2_pair<S: Simd>(x: S::f32s) -> (S::f32s, S::f32s) {
    // 2 / ln 2 as the sum of two `f32`.
    const LEAD: [f32; 2] = [2.885_39, 3.851_926e-8];
    let (exponent, mantissa) = split::<S>(x);
    let numerator = mantissa - 1.0;
    let denominator = mantissa + 1.0;
    let denominator_low = mantissa - (denominator - 1.0);

    // s and what its rounding lost.
    let reciprocal = same::<S>(x, 1.0) / denominator;
    let s = numerator * reciprocal;
    let rest = (-s).mul_add_precise(denominator, numerator);
    let s_low = (-s).mul_add(denominator_low, rest) * reciprocal;

    let z = s * s;
    let tail = polynomial::<S, 4>(z, [0.336_587_9, 0.411_901_27, 0.577_079_8, 0.961_796_7]);
    let product = s * LEAD[0];
    let low = s.mul_sub_precise(LEAD[0], product);
    let low = s.mul_add(LEAD[1], low);
    let low = s_low.mul_add(LEAD[0], low);
    let low = (s * z).mul_add(tail, low);

    // The exponent is 0 or larger than the product, so these two sums lose nothing.
    let sum = exponent + product;
    let low = product - (sum - exponent) + low;
    let high = sum + low;
    (high, low - (high - sum))
}

/// x^y as 2^(y log2 x), with the exponent in two `f32`; 2^r is our own fit for |r| <= 1/2.
#[inline(always)]
fn pow<S: Simd>(x: S::f32s, y: S::f32s) -> S::f32s {
    let (log, log_low) = log2_pair::<S>(x);
    let log = x.simd_eq(0.0).select(same::<S>(x, f32::NEG_INFINITY), log);
    let log = x.simd_eq(f32::INFINITY).select(x, log);
    let high = y * log;
    let low = y.mul_add(log_low, y.mul_sub_precise(log, high));
    let low = high.abs().simd_lt(160.0).select(low, same::<S>(x, 0.0));
    let high = hold::<S>(high, -151.0, 129.0);

    let shifted = high + ROUNDER;
    let r = (high - (shifted - ROUNDER)) + low;
    let tail = polynomial::<S, 6>(r, [1.545_316_3e-4, 1.339_086_3e-3, 9.618_083e-3, 5.550_357e-2, 0.240_226_5, LN_2]);
    let power = scale::<S>(r.mul_add(tail, 1.0), shifted);

    let one = same::<S>(x, 1.0);
    let power = (x.simd_eq(1.0) | y.simd_eq(0.0)).select(one, power);
    (x.simd_ge(0.0) & y.simd_eq(y)).select(power, same::<S>(x, f32::NAN))
}

#[cfg(test)]
mod tests;
