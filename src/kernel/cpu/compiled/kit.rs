//! The maths kit's functions in the form that compiled code calls.

use fearless_simd::{Avx512, Simd};

use super::Vector;
use super::assemble::Function;
use super::trace::Kit;
use crate::math::{Lanes, Real};

/// The function that computes the first two vectors' results into the next two.
pub(super) fn function(kit: Kit) -> Function {
    match kit {
        Kit::SinCos => sin_cos,
        Kit::Atan2 => atan2,
        Kit::Acos => acos,
        Kit::Asin => asin,
        Kit::Exp => exp,
        Kit::Ln => ln,
        Kit::Pow => pow,
    }
}

/// Applies a function to the vectors at an address.
///
/// # Safety
///
/// The processor must have AVX-512, and four vectors must lie at the address.
#[inline(always)]
unsafe fn apply(at: *mut f32, f: impl FnOnce([Lanes<Avx512>; 2]) -> [Lanes<Avx512>; 2]) {
    // SAFETY: the caller's promises.
    let (token, vectors) = unsafe { (Avx512::assume_supported(), &mut *at.cast::<[Vector; 4]>()) };
    token.vectorize(
        #[inline(always)]
        || {
            use crate::math::Pack;
            let [first, second] = f([Lanes::load(token, &vectors[0].0), Lanes::load(token, &vectors[1].0)]);
            first.store(&mut vectors[2].0);
            second.store(&mut vectors[3].0);
        },
    );
}

macro_rules! functions {
    ($($name:ident($a:ident, $b:ident) $body:expr;)*) => { $(
        /// Called by compiled code only, which keeps [`apply`]'s conditions.
        unsafe extern "sysv64" fn $name(at: *mut f32) {
            // SAFETY: compiled code runs only where the processor has AVX-512, and gives its frame's call slots.
            unsafe { apply(at, #[inline(always)] |[$a, $b]| { let _ = $b; $body }) }
        }
    )* };
}

functions! {
    sin_cos(a, b) { let (sin, cos) = a.sin_cos(); [sin, cos] };
    atan2(a, b) { let r = a.atan2(b); [r, r] };
    acos(a, b) { let r = a.acos(); [r, r] };
    asin(a, b) { let r = a.asin(); [r, r] };
    exp(a, b) { let r = a.exp(); [r, r] };
    ln(a, b) { let r = a.ln(); [r, r] };
    pow(a, b) { let r = a.pow(b); [r, r] };
}
