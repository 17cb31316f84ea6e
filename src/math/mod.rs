//! The maths kit: one trait, [`Real`], over scalars and SIMD lanes.
//!
//! In come numbers as `f64` constants ([`Real::splat`]) or slices ([`Pack::load`]); out go slices ([`Pack::store`]),
//! and masks for decisions. Code written once over `R: Real` runs as `f64`, the reference, on the standard library,
//! or as [`Lanes`], one native vector of `f32`, on the functions in [`lanes`].
//!
//! Greatest errors of [`Lanes`] against `f64`, in ulp of the `f32` result, each over at least 4 million inputs:
//!
//! | function | inputs                           | with FMA (AVX2, AVX-512) | without (SSE, fallback) |
//! |----------|----------------------------------|--------------------------|-------------------------|
//! | sin, cos | magnitudes up to 10              | 1.5                      | 1.6                     |
//! | sin, cos | magnitudes up to 1e4             | 1.6                      | 8.5e-8 absolute         |
//! | sin, cos | magnitudes up to 1e6             | 2.1                      | 1.2e-7 absolute         |
//! | atan2    | all                              | 2.1                      | 2.3                     |
//! | acos     | -1 to 1                          | 1.3                      | 1.3                     |
//! | asin     | -1 to 1                          | 2.4                      | 2.4                     |
//! | exp      | all                              | 1.1                      | 1.0                     |
//! | ln       | all, subnormals too              | 0.9                      | 0.9                     |
//! | pow      | base 1e-45 to 3e38, exponent 20  | 1.2                      | 1.4                     |
//! | pow      | base 0.5 to 2, exponent 500      | 6.3                      | 6.3                     |
//!
//! NaN in gives NaN out everywhere except in `min` and `max`. Both implementations agree on the borders where the
//! standard library differs from the trait: the origin has angle 0, and a negative or NaN base has no power, not even
//! the zeroth. Beyond 6e6, sine and cosine of `Lanes` are those of some other angle.

pub mod lanes;
pub mod precision;
pub mod random;
pub mod real;
pub mod scalar;

pub use lanes::Lanes;
pub use precision::Precision;
pub use real::{Pack, Real};
