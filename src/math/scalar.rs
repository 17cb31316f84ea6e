//! `f64` as a [`Real`]: the scalar reference, from the standard library.

use super::real::{Pack, Real};

/// True where the target always has a fused multiply-add; without it, `f64::mul_add` is a slow library call.
const FUSED: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));

impl Real for f64 {
    type Token = ();
    type Mask = bool;
    #[inline(always)]
    fn splat(_token: (), x: f64) -> Self {
        x
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn floor(self) -> Self {
        self.floor()
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.min(other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.max(other)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        if FUSED { f64::mul_add(self, a, b) } else { self * a + b }
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        self.sin_cos()
    }

    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        if self == 0.0 && x == 0.0 { self } else { self.atan2(x) }
    }

    #[inline(always)]
    fn acos(self) -> Self {
        self.acos()
    }

    #[inline(always)]
    fn asin(self) -> Self {
        self.asin()
    }

    #[inline(always)]
    fn exp(self) -> Self {
        self.exp()
    }

    #[inline(always)]
    fn ln(self) -> Self {
        self.ln()
    }

    #[inline(always)]
    fn pow(self, y: Self) -> Self {
        if self >= 0.0 && !y.is_nan() { self.abs().powf(y) } else { f64::NAN }
    }

    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }

    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }

    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }

    #[inline(always)]
    fn mask_and(a: bool, b: bool) -> bool {
        a & b
    }

    #[inline(always)]
    fn mask_or(a: bool, b: bool) -> bool {
        a | b
    }

    #[inline(always)]
    fn mask_not(a: bool) -> bool {
        !a
    }

    #[inline(always)]
    fn from_mask(_token: (), mask: bool) -> Self {
        f64::from(u8::from(mask))
    }

    #[inline(always)]
    fn to_mask(self) -> bool {
        self > 0.5
    }
}

impl Pack for f64 {
    type Scalar = f64;
    const LANES: usize = 1;

    #[inline(always)]
    fn load(_token: (), src: &[f64]) -> Self {
        src[0]
    }

    #[inline(always)]
    fn store(self, dst: &mut [f64]) {
        dst[0] = self;
    }

    #[inline(always)]
    fn scalar(x: f64) -> f64 {
        x
    }

    #[inline(always)]
    fn mask_any(mask: bool) -> bool {
        mask
    }
}

#[cfg(test)]
mod tests {
    use super::Real;

    #[test]
    fn follows_the_trait_where_the_standard_library_differs() {
        assert_eq!(Real::atan2(0.0, -0.0), 0.0);
        assert_eq!(Real::atan2(-0.0, -0.0), 0.0);
        assert_eq!(Real::atan2(0.0, -1.0), std::f64::consts::PI);
        assert_eq!(Real::pow(0.0, 0.0), 1.0);
        assert_eq!(Real::pow(-0.0, -1.0), f64::INFINITY);
        assert!(Real::pow(-2.0, 2.0).is_nan());
        assert!(Real::pow(f64::NAN, 0.0).is_nan());
        assert!(Real::pow(1.0, f64::NAN).is_nan());
    }
}
