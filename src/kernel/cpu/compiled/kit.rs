//! The maths kit's functions in the form that compiled code calls.

use fearless_simd::{Avx512, Simd};

use super::Vector;
use super::assemble::Function;
use super::trace::Kit;
use crate::kernel::cpu::Precision;
use crate::math::{Lanes, Pack, Real};

/// The kit of one precision.
#[derive(Clone, Copy)]
pub(super) struct Kits {
    pub(super) precision: Precision,
}

impl Kits {
    /// The function that computes the first two vectors' results into the next two.
    pub(super) fn function(self, kit: Kit) -> Function {
        let functions: [Function; 2] = match kit {
            Kit::SinCos => [wide::sin_cos, scalar::sin_cos],
            Kit::Atan2 => [wide::atan2, scalar::atan2],
            Kit::Acos => [wide::acos, scalar::acos],
            Kit::Asin => [wide::asin, scalar::asin],
            Kit::Exp => [wide::exp, scalar::exp],
            Kit::Ln => [wide::ln, scalar::ln],
            Kit::Pow => [wide::pow, scalar::pow],
        };
        functions[usize::from(self.precision == Precision::F64)]
    }
}

/// Applies a function to the vectors at an address, all lanes at once.
///
/// # Safety
///
/// The processor must have AVX-512, and four vectors must lie at the address.
#[inline(always)]
unsafe fn apply_wide(at: *mut u8, f: impl FnOnce([Lanes<Avx512>; 2]) -> [Lanes<Avx512>; 2]) {
    // SAFETY: the caller's promises.
    let (token, vectors) = unsafe { (Avx512::assume_supported(), &mut *at.cast::<[Vector<f32, 16>; 4]>()) };
    token.vectorize(
        #[inline(always)]
        || {
            let [first, second] = f([Lanes::load(token, &vectors[0].0), Lanes::load(token, &vectors[1].0)]);
            first.store(&mut vectors[2].0);
            second.store(&mut vectors[3].0);
        },
    );
}

/// Applies a function to the vectors at an address, lane by lane: as the interpreter does.
///
/// # Safety
///
/// Four vectors must lie at the address.
#[inline(always)]
unsafe fn apply_scalar(at: *mut u8, f: impl Fn([f64; 2]) -> [f64; 2]) {
    // SAFETY: the caller's promise.
    let vectors = unsafe { &mut *at.cast::<[Vector<f64, 8>; 4]>() };
    for lane in 0..8 {
        [vectors[2].0[lane], vectors[3].0[lane]] = f([vectors[0].0[lane], vectors[1].0[lane]]);
    }
}

macro_rules! functions {
    ($apply:ident; $($name:ident($a:ident, $b:ident) $body:expr;)*) => { $(
        /// Called by compiled code only, which keeps the conditions.
        pub(super) unsafe extern "sysv64" fn $name(at: *mut u8) {
            // SAFETY: compiled code runs only where the processor has AVX-512, and gives its frame's call slots.
            unsafe { $apply(at, #[inline(always)] |[$a, $b]| { let _ = $b; $body }) }
        }
    )* };
}

macro_rules! kit {
    ($module:ident, $apply:ident) => {
        mod $module {
            use super::*;
            functions! { $apply;
                sin_cos(a, b) { let (sin, cos) = Real::sin_cos(a); [sin, cos] };
                atan2(a, b) [Real::atan2(a, b); 2];
                acos(a, b) [Real::acos(a); 2];
                asin(a, b) [Real::asin(a); 2];
                exp(a, b) [Real::exp(a); 2];
                ln(a, b) [Real::ln(a); 2];
                pow(a, b) [Real::pow(a, b); 2];
            }
        }
    };
}

kit!(wide, apply_wide);
kit!(scalar, apply_scalar);
