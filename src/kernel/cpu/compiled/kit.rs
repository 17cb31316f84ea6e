//! The maths kit's functions in the form that compiled code calls.

use fearless_simd::{Avx2, Avx512, Simd};

use super::assemble::Function;
use super::instructions::InstructionSet;
use super::trace::Kit;
use crate::expr::Table;
use crate::kernel::cpu::interpret::looked_up;
use crate::math::Precision;
use crate::math::{Lanes, Pack, Real};

/// The kit of one instruction set and precision.
#[derive(Clone, Copy)]
pub(super) struct Kits {
    pub(super) set: InstructionSet,
    pub(super) precision: Precision,
}

impl Kits {
    /// The function that computes the first two vectors' results into the next two; it is given the address of a table, 0 where it needs
    /// none.
    pub(super) fn function(self, kit: Kit) -> Function {
        let [wide, narrow]: [[Function; 2]; 2] = match kit {
            Kit::SinCos => [[wide::sin_cos, scalar_8::sin_cos], [narrow::sin_cos, scalar_4::sin_cos]],
            Kit::Atan2 => [[wide::atan2, scalar_8::atan2], [narrow::atan2, scalar_4::atan2]],
            Kit::Acos => [[wide::acos, scalar_8::acos], [narrow::acos, scalar_4::acos]],
            Kit::Asin => [[wide::asin, scalar_8::asin], [narrow::asin, scalar_4::asin]],
            Kit::Exp => [[wide::exp, scalar_8::exp], [narrow::exp, scalar_4::exp]],
            Kit::Ln => [[wide::ln, scalar_8::ln], [narrow::ln, scalar_4::ln]],
            Kit::Pow => [[wide::pow, scalar_8::pow], [narrow::pow, scalar_4::pow]],
            Kit::Lookup(_) => [[wide_lookup, scalar_lookup::<8>], [narrow_lookup, scalar_lookup::<4>]],
        };
        let functions = if self.set == InstructionSet::Avx512 { wide } else { narrow };
        functions[usize::from(self.precision == Precision::F64)]
    }
}

/// Applies a function to the vectors at an address, all lanes at once.
///
/// # Safety
///
/// The processor must have the token's instruction set, and four vectors of `LANES` numbers must lie at the address.
#[inline(always)]
unsafe fn apply_lanes<S: Simd, const LANES: usize>(
    token: S,
    at: *mut u8,
    f: impl FnOnce([Lanes<S>; 2]) -> [Lanes<S>; 2],
) {
    // SAFETY: the caller's promise.
    let vectors = unsafe { &mut *at.cast::<[[f32; LANES]; 4]>() };
    token.vectorize(
        #[inline(always)]
        || {
            let [first, second] = f([Lanes::load(token, &vectors[0]), Lanes::load(token, &vectors[1])]);
            first.store(&mut vectors[2]);
            second.store(&mut vectors[3]);
        },
    );
}

/// The same with AVX-512.
///
/// # Safety
///
/// The processor must have it; four vectors must lie at the address.
#[inline(always)]
unsafe fn apply_wide(at: *mut u8, f: impl FnOnce([Lanes<Avx512>; 2]) -> [Lanes<Avx512>; 2]) {
    // SAFETY: the caller's promises.
    unsafe { apply_lanes::<_, 16>(Avx512::assume_supported(), at, f) }
}

/// The same with AVX2.
///
/// # Safety
///
/// The processor must have it; four vectors must lie at the address.
#[inline(always)]
unsafe fn apply_narrow(at: *mut u8, f: impl FnOnce([Lanes<Avx2>; 2]) -> [Lanes<Avx2>; 2]) {
    // SAFETY: the caller's promises.
    unsafe { apply_lanes::<_, 8>(Avx2::assume_supported(), at, f) }
}

/// Applies a function to the vectors at an address, lane by lane: as the interpreter does.
///
/// # Safety
///
/// Four vectors of `LANES` numbers must lie at the address.
#[inline(always)]
unsafe fn apply_scalar<const LANES: usize>(at: *mut u8, f: impl Fn([f64; 2]) -> [f64; 2]) {
    // SAFETY: the caller's promise.
    let [a, b, first, second] = unsafe { &mut *at.cast::<[[f64; LANES]; 4]>() };
    for (((&mut a, &mut b), first), second) in a.iter_mut().zip(b).zip(first).zip(second) {
        [*first, *second] = f([a, b]);
    }
}

macro_rules! functions {
    ($apply:path; $($name:ident($a:ident, $b:ident) $body:expr;)*) => { $(
        /// Called by compiled code only, which keeps the conditions.
        pub(super) unsafe extern "sysv64" fn $name(at: *mut u8, _: *const Table) {
            // SAFETY: compiled code runs only where the processor has its instruction set, and gives its frame's call slots.
            unsafe { $apply(at, #[inline(always)] |[$a, $b]| { let _ = $b; $body }) }
        }
    )* };
}

macro_rules! kit {
    ($module:ident, $apply:path) => {
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

/// Called by compiled code only, which keeps the conditions: its kernel holds the table.
unsafe extern "sysv64" fn wide_lookup(at: *mut u8, table: *const Table) {
    // SAFETY: compiled code runs only where the processor has its instruction set, gives its frame's call slots, and its table.
    unsafe { apply_wide(at, |[index, _]| [looked_up(Avx512::assume_supported(), &*table, index); 2]) }
}

/// The same with AVX2.
unsafe extern "sysv64" fn narrow_lookup(at: *mut u8, table: *const Table) {
    // SAFETY: as above.
    unsafe { apply_narrow(at, |[index, _]| [looked_up(Avx2::assume_supported(), &*table, index); 2]) }
}

/// The same lane by lane.
unsafe extern "sysv64" fn scalar_lookup<const LANES: usize>(at: *mut u8, table: *const Table) {
    // SAFETY: as above.
    unsafe { apply_scalar::<LANES>(at, |[index, _]| [f64::from((*table).at(index)); 2]) }
}

kit!(wide, apply_wide);
kit!(narrow, apply_narrow);
kit!(scalar_8, apply_scalar::<8>);
kit!(scalar_4, apply_scalar::<4>);
