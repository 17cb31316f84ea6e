//! Tests of the functions against the standard library's, in ulp.

use super::*;
use fearless_simd::Level;

const INF: f32 = f32::INFINITY;
const NAN: f32 = f32::NAN;
/// Inputs for one accuracy check; a multiple of every lane count.
const SAMPLES: usize = 1 << 17;

/// Evaluates an expression over `Lanes` for all pairs of inputs, at one SIMD level.
macro_rules! evaluate {
    ($level:expr, $a:expr, $b:expr, |$x:pat_param, $y:pat_param| $body:expr) => {
        fearless_simd::dispatch!($level, token => map_lanes(token, $a, $b, #[inline(always)] |$x, $y| $body))
    };
}

/// Checks an expression over `Lanes` against one over `f64`, at every level, to an error in ulp or absolute.
macro_rules! assert_close {
    (
        $ulps:expr, $absolute:expr, $a:expr, $b:expr,
        |$x:pat_param, $y:pat_param| $body:expr, |$u:pat_param, $v:pat_param| $reference:expr
    ) => {
        let reference: fn(f64, f64) -> f64 = |$u, $v| $reference;
        for level in levels() {
            let results = evaluate!(level, &$a, &$b, |$x, $y| $body);
            compare(level, &$a, &$b, &results, reference, $ulps, $absolute);
        }
    };
}

/// Checks an expression over `Lanes` for a table of (input, input, exact result), at every level.
macro_rules! assert_exact {
    ($table:expr, |$x:pat_param, $y:pat_param| $body:expr) => {
        let (a, b, want) = columns(&$table);
        for level in levels() {
            let results = evaluate!(level, &a, &b, |$x, $y| $body);
            for (i, want) in want.iter().enumerate() {
                let got = results[i];
                let same = got.to_bits() == want.to_bits() || got.is_nan() && want.is_nan();
                assert!(same, "{level:?}: ({:e}, {:e}) gave {got:e}, not {want:e}", a[i], b[i]);
            }
        }
    };
}

#[inline(always)]
fn map_lanes<S: Simd>(token: S, a: &[f32], b: &[f32], f: impl Fn(Lanes<S>, Lanes<S>) -> Lanes<S>) -> Vec<f32> {
    let mut out = vec![0.0; a.len()];
    let width = Lanes::<S>::LANES;
    for start in (0..a.len()).step_by(width) {
        let x = Lanes::load(token, &a[start..]);
        let y = Lanes::load(token, &b[start..]);
        f(x, y).store(&mut out[start..]);
    }
    out
}

/// The best level of this machine and, on x86, all below it.
fn levels() -> Vec<Level> {
    let best = Level::new();
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    let lower = [best.as_avx2().map(Simd::level), best.as_sse4_2().map(Simd::level), best.as_sse2().map(Simd::level)];
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    let lower = [None];
    std::iter::once(best).chain(lower.into_iter().flatten()).collect()
}

/// Columns of a table, padded to a multiple of every lane count.
fn columns(table: &[[f32; 3]]) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let mut rows = table.to_vec();
    rows.resize(table.len().next_multiple_of(16), table[0]);
    let column = |i: usize| rows.iter().map(|row| row[i]).collect();
    (column(0), column(1), column(2))
}

/// Distance between neighbours of type `f32` around `x`.
fn ulp(x: f64) -> f64 {
    let exponent = ((x.abs() as f32).min(f32::MAX).to_bits() >> 23).max(1);
    f64::from(exponent as i32 - 150).exp2()
}

fn compare(
    level: Level,
    a: &[f32],
    b: &[f32],
    results: &[f32],
    reference: fn(f64, f64) -> f64,
    ulps: f64,
    absolute: f64,
) {
    for ((&x, &y), &got) in a.iter().zip(b).zip(results) {
        let want = reference(x.into(), y.into());
        let error = (f64::from(got) - want).abs();
        let same = got == want as f32 || got.is_nan() && want.is_nan();
        assert!(
            same || error <= absolute || error <= ulps * ulp(want),
            "{level:?}: ({x:e}, {y:e}) gave {got:e}, not {want:e}: {} ulp",
            error / ulp(want)
        );
    }
}

/// Numbers spread over [0, 1): a golden-ratio sequence, `seed` apart.
fn spread(seed: f64) -> impl Iterator<Item = f64> {
    (0..SAMPLES).map(move |i| (seed + i as f64 * 0.618_033_988_749_894_9).fract())
}

/// Samples from `low` to `high`.
fn linear(low: f64, high: f64) -> Vec<f32> {
    spread(0.25).map(|t| (low + (high - low) * t) as f32).collect()
}

/// Samples of both signs with magnitudes from `low` to `high`, as many in each octave.
fn octaves(low: f64, high: f64) -> Vec<f32> {
    let magnitude = |t: f64| low * (high / low).powf((t * 4096.0).fract());
    let signed = |t: f64| if t < 0.5 { -magnitude(t) } else { magnitude(t) };
    spread(0.375).map(|t| signed(t) as f32).collect()
}

fn magnitudes(samples: Vec<f32>) -> Vec<f32> {
    samples.into_iter().map(f32::abs).collect()
}

#[test]
fn sin_cos_is_close() {
    for x in [linear(-1e4, 1e4), octaves(1e-8, 10.0)] {
        assert_close!(2.0, 1e-7, x, x, |x, _| x.sin_cos().0, |x, _| x.sin());
        assert_close!(2.0, 1e-7, x, x, |x, _| x.sin_cos().1, |x, _| x.cos());
    }
    let far = linear(-1e6, 1e6);
    assert_close!(2.0, 2e-7, far, far, |x, _| x.sin_cos().0, |x, _| x.sin());
    assert_close!(2.0, 2e-7, far, far, |x, _| x.sin_cos().1, |x, _| x.cos());
}

#[test]
fn sin_cos_is_close_around_quarter_turns() {
    let border = |k: i32| (f64::from(k) * std::f64::consts::FRAC_PI_4) as f32;
    let near = |x: f32| [x.next_down(), x, x.next_up(), -x];
    let x: Vec<f32> = (0..4096).flat_map(|k| near(border(k))).collect();
    assert_close!(2.0, 1e-7, x, x, |x, _| x.sin_cos().0, |x, _| x.sin());
    assert_close!(2.0, 1e-7, x, x, |x, _| x.sin_cos().1, |x, _| x.cos());
}

#[test]
fn sin_cos_of_awkward_inputs() {
    let sines = [
        [0.0, 0.0, 0.0],
        [-0.0, 0.0, -0.0],
        [1e-30, 0.0, 1e-30],
        [-1e-45, 0.0, -1e-45],
        [INF, 0.0, NAN],
        [-INF, 0.0, NAN],
        [NAN, 0.0, NAN],
    ];
    assert_exact!(sines, |x, _| x.sin_cos().0);
    let cosines = [[0.0, 0.0, 1.0], [-0.0, 0.0, 1.0], [INF, 0.0, NAN], [NAN, 0.0, NAN]];
    assert_exact!(cosines, |x, _| x.sin_cos().1);
    let huge = octaves(1e6, 3e38);
    for level in levels() {
        let lengths = evaluate!(level, &huge, &huge, |x, _| {
            let (sin, cos) = x.sin_cos();
            sin * sin + cos * cos
        });
        assert!(lengths.iter().all(|length| (length - 1.0).abs() < 1e-3));
    }
}

#[test]
fn atan2_is_close() {
    let pairs = [
        (linear(-10.0, 10.0), octaves(1e-2, 1e2)),
        (octaves(1e-20, 1e20), linear(-1.0, 1.0)),
        (octaves(1e-38, 1e38), octaves(1e-7, 1e7)),
    ];
    for (y, x) in pairs {
        assert_close!(3.0, 0.0, y, x, |y, x| y.atan2(x), |y, x| y.atan2(x));
    }
    let x = linear(0.9, 1.1);
    let y = linear(-1.0, 1.0);
    assert_close!(3.0, 0.0, y, x, |y, x| (y / y).atan2(x), |_, x| 1f64.atan2(x));
}

#[test]
fn atan2_of_awkward_inputs() {
    let quarter = PI / 4.0;
    let table = [
        [0.0, 0.0, 0.0],
        [-0.0, 0.0, -0.0],
        [0.0, -0.0, 0.0],
        [-0.0, -0.0, -0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, PI],
        [-0.0, 1.0, -0.0],
        [-0.0, -1.0, -PI],
        [1.0, 0.0, FRAC_PI_2],
        [-1.0, 0.0, -FRAC_PI_2],
        [1.0, -0.0, FRAC_PI_2],
        [1e-45, 0.0, FRAC_PI_2],
        [1e-45, 1e-45, quarter],
        [1.0, 1.0, quarter],
        [1.0, -1.0, 3.0 * quarter],
        [-1.0, 1.0, -quarter],
        [-1.0, -1.0, -3.0 * quarter],
        [INF, 1.0, FRAC_PI_2],
        [-INF, -1.0, -FRAC_PI_2],
        [1.0, INF, 0.0],
        [1.0, -INF, PI],
        [INF, INF, quarter],
        [INF, -INF, 3.0 * quarter],
        [f32::MAX, f32::MAX, quarter],
        [NAN, 1.0, NAN],
        [1.0, NAN, NAN],
        [NAN, 0.0, NAN],
        [NAN, -0.0, NAN],
        [NAN, INF, NAN],
        [0.0, NAN, NAN],
    ];
    assert_exact!(table, |y, x| y.atan2(x));
}

#[test]
fn acos_and_asin_are_close() {
    let near_one = octaves(1e-12, 1.0).into_iter().map(|x| 1.0 - x.abs()).collect();
    for x in [linear(-1.0, 1.0), octaves(1e-12, 1.0), near_one] {
        assert_close!(3.0, 0.0, x, x, |x, _| x.acos(), |x, _| x.acos());
        assert_close!(3.0, 0.0, x, x, |x, _| x.asin(), |x, _| x.asin());
    }
}

#[test]
fn acos_and_asin_of_awkward_inputs() {
    let beyond = 1f32.next_up();
    let acos = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, PI],
        [0.0, 0.0, FRAC_PI_2],
        [-0.0, 0.0, FRAC_PI_2],
        [beyond, 0.0, NAN],
        [-INF, 0.0, NAN],
        [NAN, 0.0, NAN],
    ];
    assert_exact!(acos, |x, _| x.acos());
    let asin = [
        [1.0, 0.0, FRAC_PI_2],
        [-1.0, 0.0, -FRAC_PI_2],
        [0.0, 0.0, 0.0],
        [-0.0, 0.0, -0.0],
        [1e-45, 0.0, 1e-45],
        [-beyond, 0.0, NAN],
        [INF, 0.0, NAN],
        [NAN, 0.0, NAN],
    ];
    assert_exact!(asin, |x, _| x.asin());
}

#[test]
fn exp_is_close_and_saturates() {
    for x in [linear(-110.0, 95.0), octaves(1e-9, 80.0)] {
        assert_close!(2.0, 0.0, x, x, |x, _| x.exp(), |x, _| x.exp());
    }
    let table = [
        [0.0, 0.0, 1.0],
        [-0.0, 0.0, 1.0],
        [1e-45, 0.0, 1.0],
        [88.73, 0.0, INF],
        [1e30, 0.0, INF],
        [INF, 0.0, INF],
        [-103.98, 0.0, 0.0],
        [-103.9, 0.0, 1e-45],
        [-1e30, 0.0, 0.0],
        [-INF, 0.0, 0.0],
        [NAN, 0.0, NAN],
    ];
    assert_exact!(table, |x, _| x.exp());
}

#[test]
fn ln_is_close_and_marks_its_borders() {
    for x in [linear(0.5, 2.0), magnitudes(octaves(1e-38, 1e38)), linear(1e-45, 1.2e-38)] {
        assert_close!(2.0, 0.0, x, x, |x, _| x.ln(), |x, _| x.ln());
    }
    let table = [
        [1.0, 0.0, 0.0],
        [0.0, 0.0, -INF],
        [-0.0, 0.0, -INF],
        [-1e-45, 0.0, NAN],
        [-1.0, 0.0, NAN],
        [-INF, 0.0, NAN],
        [INF, 0.0, INF],
        [NAN, 0.0, NAN],
        [f32::MAX, 0.0, 88.722_84],
        [1e-45, 0.0, -103.278_93],
    ];
    assert_exact!(table, |x, _| x.ln());
}

#[test]
fn pow_is_close() {
    let pairs = [
        (magnitudes(octaves(1e-6, 1e6)), linear(-20.0, 20.0)),
        (magnitudes(octaves(1e-44, 1e38)), linear(-20.0, 20.0)),
        (linear(0.9, 1.1), octaves(1e-3, 1e3)),
    ];
    for (x, y) in pairs {
        assert_close!(3.0, 0.0, x, y, |x, y| x.pow(y), |x, y| x.powf(y));
    }
}

#[test]
fn pow_of_awkward_inputs() {
    let table = [
        [0.0, 0.0, 1.0],
        [-0.0, 0.0, 1.0],
        [5.0, 0.0, 1.0],
        [INF, 0.0, 1.0],
        [INF, -0.0, 1.0],
        [0.0, 2.0, 0.0],
        [-0.0, 1e-45, 0.0],
        [0.0, -2.0, INF],
        [0.0, INF, 0.0],
        [0.0, -INF, INF],
        [-2.0, 2.0, NAN],
        [-2.0, 0.0, NAN],
        [-INF, 1.0, NAN],
        [INF, 1e-45, INF],
        [INF, -1e-45, 0.0],
        [INF, INF, INF],
        [1.0, INF, 1.0],
        [1.0, -1e38, 1.0],
        [2.0, INF, INF],
        [2.0, -INF, 0.0],
        [0.5, INF, 0.0],
        [0.5, -INF, INF],
        [1f32.next_up(), f32::MAX, INF],
        [1f32.next_down(), f32::MAX, 0.0],
        [2.0, 128.0, INF],
        [2.0, -149.0, 1e-45],
        [2.0, -151.0, 0.0],
        [1e-45, 1.0, 1e-45],
        [3.0, 2.0, 9.0],
        [NAN, 0.0, NAN],
        [1.0, NAN, NAN],
        [0.0, NAN, NAN],
        [INF, NAN, NAN],
        [NAN, NAN, NAN],
    ];
    assert_exact!(table, |x, y| x.pow(y));
}

#[test]
fn masks_select_and_convert() {
    let table = [[1.0, 2.0, 1.0], [2.0, 1.0, 0.0], [1.0, 1.0, 0.0], [NAN, 1.0, 0.0]];
    assert_exact!(table, |x, y| below(x, y));
    let table = [[1.0, 2.0, 1.0], [2.0, 1.0, 1.0], [1.0, 1.0, 1.0], [NAN, 1.0, -1.0]];
    assert_exact!(table, |x, y| smaller_or_negated(x, y));
    let table = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.6, 0.0, 1.0], [1.0, 0.0, 1.0]];
    assert_exact!(table, |x, _| round_through_mask(x));
}

#[inline(always)]
fn below<S: Simd>(x: Lanes<S>, y: Lanes<S>) -> Lanes<S> {
    let not_below = Lanes::<S>::mask_not(x.lt(y));
    Lanes::from_mask(x.0.token(), Lanes::<S>::mask_not(not_below))
}

#[inline(always)]
fn smaller_or_negated<S: Simd>(x: Lanes<S>, y: Lanes<S>) -> Lanes<S> {
    let ordered = Lanes::<S>::mask_or(x.le(y), y.lt(x));
    Lanes::select(Lanes::<S>::mask_and(ordered, x.eq(x)), x.min(y), -y)
}

#[inline(always)]
fn round_through_mask<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    Lanes::from_mask(x.0.token(), x.to_mask())
}

#[test]
fn arithmetic_is_exact() {
    let a = magnitudes(octaves(0.1, 100.0));
    let b = linear(1.0, 2.0);
    assert_close!(0.5, 0.0, a, b, |x, y| x + y, |x, y| x + y);
    assert_close!(0.5, 0.0, a, b, |x, y| x - y, |x, y| x - y);
    assert_close!(0.5, 0.0, a, b, |x, y| x * y, |x, y| x * y);
    assert_close!(0.5, 0.0, a, b, |x, y| x / y, |x, y| x / y);
    assert_close!(0.5, 0.0, a, b, |x, _| x.sqrt(), |x, _| x.sqrt());
    assert_close!(1.0, 0.0, a, b, |x, y| x.mul_add(y, x), |x, y| x * y + x);
    assert_close!(0.0, 0.0, a, b, |x, _| (-x).floor().abs(), |x, _| x.ceil());
    assert_close!(0.0, 0.0, a, b, |x, y| x.max(y), |x, y| x.max(y));
}

#[test]
fn splat_and_mask_any_see_every_lane() {
    let mut samples = vec![1.0; 16];
    samples[15] = 3.0;
    for level in levels() {
        let any = fearless_simd::dispatch!(level, token => any_above(token, &samples, 2.0));
        let none = fearless_simd::dispatch!(level, token => any_above(token, &samples, 3.0));
        assert!(any && !none, "{level:?}");
    }
}

#[inline(always)]
fn any_above<S: Simd>(token: S, samples: &[f32], border: f64) -> bool {
    let border = Lanes::<S>::splat(token, border);
    let mut chunks = samples.chunks_exact(Lanes::<S>::LANES);
    chunks.any(
        #[inline(always)]
        |chunk| Lanes::<S>::mask_any(border.lt(Lanes::load(token, chunk))),
    )
}
