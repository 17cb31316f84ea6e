//! The precisions that kernels compute in, and what each of them can resolve.

use serde::{Deserialize, Serialize};

/// How numbers are stored and computed with.
///
/// A further precision is a further variant: the methods here say all that the rest of the program asks of one.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Precision {
    /// Single precision: 24 significant bits.
    F32,
    /// Double precision: 53 significant bits.
    F64,
}

impl Precision {
    /// All precisions, the coarsest first.
    pub const ALL: [Precision; 2] = [Precision::F32, Precision::F64];

    /// The name in flags, messages and files.
    pub const fn name(self) -> &'static str {
        match self {
            Precision::F32 => "f32",
            Precision::F64 => "f64",
        }
    }

    /// Significant bits of a number.
    pub const fn bits(self) -> u32 {
        match self {
            Precision::F32 => f32::MANTISSA_DIGITS,
            Precision::F64 => f64::MANTISSA_DIGITS,
        }
    }

    /// Bytes of a number.
    pub const fn bytes(self) -> usize {
        match self {
            Precision::F32 => size_of::<f32>(),
            Precision::F64 => size_of::<f64>(),
        }
    }

    /// Relative error of one operation that rounds to the nearest number, at most: 2^-[`bits`](Precision::bits).
    pub const fn unit(self) -> f64 {
        self.epsilon() / 2.0
    }

    /// Distance of 1 from the next number above it.
    pub const fn epsilon(self) -> f64 {
        match self {
            Precision::F32 => f32::EPSILON as f64,
            Precision::F64 => f64::EPSILON,
        }
    }

    /// Distance of neighbouring numbers of this size, and 0 for sizes that are not above 0 or not finite. Numbers below the
    /// least normal one lie further apart than this says.
    pub fn ulp(self, size: f64) -> f64 {
        match size > 0.0 && size.is_finite() {
            true => (size.log2().floor() + 1.0 - f64::from(self.bits())).exp2(),
            false => 0.0,
        }
    }

    /// Least step of finite differences, as a share of the larger of 1 and the point's coordinates: a shorter step leaves
    /// too few digits in the difference.
    pub const fn min_difference(self) -> f64 {
        match self {
            Precision::F32 => 1e-5,
            Precision::F64 => 1e-8,
        }
    }
}

impl std::fmt::Display for Precision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::Precision;

    #[test]
    fn the_numbers_of_each_precision_are_those_of_its_format() {
        assert_eq!(Precision::F32.unit(), 1.0 / f64::from(1u32 << 24));
        assert_eq!(Precision::F64.unit(), 1.0 / (1u64 << 53) as f64);
        for size in [4.5e-9, 0.3, 1.0, 1.5, 2.0, 77.0, 3e5] {
            let single = size as f32;
            let above = f32::from_bits(single.to_bits() + 1);
            assert_eq!(Precision::F32.ulp(f64::from(single)), f64::from(above) - f64::from(single), "{size}");
            assert_eq!(Precision::F64.ulp(size), f64::from_bits(size.to_bits() + 1) - size, "{size}");
        }
        for precision in Precision::ALL {
            assert_eq!(precision.ulp(1.0), precision.epsilon(), "{precision}");
            assert_eq!([0.0, -1.0, f64::NAN, f64::INFINITY].map(|size| precision.ulp(size)), [0.0; 4], "{precision}");
            assert!(precision.unit() < precision.min_difference(), "{precision}");
        }
    }
}
