//! The most that a core can compute: products and sums in one, in independent chains over the machine's widest vectors.

use std::sync::Barrier;
use std::time::Instant;

use fearless_simd::{Level, Simd, SimdBase, SimdFloat, dispatch};

use crate::math::Precision;

/// Chains that do not wait for each other: more than any core's latency times its units.
const CHAINS: usize = 16;
/// Links of each chain in a run: about a millisecond.
const LINKS: usize = 200_000;
/// Runs; the fastest counts.
const RUNS: usize = 8;

/// Products and sums in one, in a second, of so many threads together: the number of scalars. Takes some milliseconds.
/// Threads that share a core's units do not double it.
pub fn peak_mul_adds(precision: Precision, threads: usize) -> f64 {
    (0..RUNS).map(|_| together(precision, threads)).fold(0.0, f64::max)
}

/// The sum of the rates of threads that run at the same time.
fn together(precision: Precision, threads: usize) -> f64 {
    let level = Level::new();
    let one = || match precision {
        Precision::F32 => dispatch!(level, simd => rate::<_, Single>(simd)),
        Precision::F64 => dispatch!(level, simd => rate::<_, Double>(simd)),
    };
    let begin = Barrier::new(threads);
    std::thread::scope(|scope| {
        let start = || {
            begin.wait();
            one()
        };
        let running: Vec<_> = (0..threads).map(|_| scope.spawn(start)).collect();
        running.into_iter().map(|thread| thread.join().unwrap_or(0.0)).sum()
    })
}

/// A vector of some precision at any SIMD level.
trait Vector {
    type Of<S: Simd>: SimdFloat<S>;
    /// Puts a number in every lane.
    fn splat<S: Simd>(token: S, x: f64) -> Self::Of<S>;
    /// The first lane.
    fn first<S: Simd>(vector: Self::Of<S>) -> f64;
}

struct Single;

impl Vector for Single {
    type Of<S: Simd> = S::f32s;
    #[inline(always)]
    fn splat<S: Simd>(token: S, x: f64) -> S::f32s {
        S::f32s::splat(token, x as f32)
    }
    #[inline(always)]
    fn first<S: Simd>(vector: S::f32s) -> f64 {
        f64::from(vector.as_slice()[0])
    }
}

struct Double;

impl Vector for Double {
    type Of<S: Simd> = S::f64s;
    #[inline(always)]
    fn splat<S: Simd>(token: S, x: f64) -> S::f64s {
        S::f64s::splat(token, x)
    }
    #[inline(always)]
    fn first<S: Simd>(vector: S::f64s) -> f64 {
        vector.as_slice()[0]
    }
}

#[inline(always)]
fn rate<S: Simd, V: Vector>(token: S) -> f64 {
    // Near 1 and drifting slowly, so that no number becomes special; hidden from the compiler.
    let factor = V::splat(token, std::hint::black_box(0.999_999));
    let term = V::splat(token, std::hint::black_box(1e-6));
    let mut chains = [V::splat(token, 1.0); CHAINS];
    let start = Instant::now();
    for _ in 0..LINKS {
        for chain in &mut chains {
            *chain = chain.mul_add(factor, term);
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    std::hint::black_box(chains.map(|chain| V::first::<S>(chain)));
    (LINKS * CHAINS * V::Of::<S>::LEN) as f64 / seconds.max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::peak_mul_adds;
    use crate::math::Precision;

    #[test]
    fn the_peak_is_a_rate() {
        for precision in [Precision::F32, Precision::F64] {
            let peak = peak_mul_adds(precision, 1);
            assert!(peak.is_finite() && peak > 1e6, "{precision:?}: {peak} a second");
            assert!(peak_mul_adds(precision, 3) > 1e6);
        }
    }
}
