//! Sums of light that are the same in whatever order their terms come.

/// Bits behind the point.
const FRACTION: u32 = 60;
/// Steps of a light of 1.
const STEPS: f64 = (1_u64 << FRACTION) as f64;
/// Light from here on counts as without end: as many samples as there can be do not reach it together.
const MOST: f64 = (1_u64 << 50) as f64;

/// The sum of a pixel's samples of light, red, green and blue, in fixed point: steps of 2 to the power of -60. Whoever adds parts of
/// the samples, and then the parts, gets the same sum to the bit; sums of floating point do not have that.
///
/// Range: of up to 65,536 samples, each below 2 to the power of 50 in size; larger ones are infinite, and what is no number stays none.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct LightSum([i128; 3]);

/// Marks of what is no finite number.
const NAN: i128 = i128::MIN;
const BELOW: i128 = i128::MIN + 1;
const ABOVE: i128 = i128::MAX;

fn is_finite(x: i128) -> bool {
    x > BELOW && x < ABOVE
}

fn fixed(x: f64) -> i128 {
    match x {
        _ if x.is_nan() => NAN,
        _ if x >= MOST => ABOVE,
        _ if x <= -MOST => BELOW,
        _ => (x * STEPS).round() as i128,
    }
}

fn float(x: i128) -> f64 {
    match x {
        NAN => f64::NAN,
        BELOW => f64::NEG_INFINITY,
        ABOVE => f64::INFINITY,
        _ => x as f64 / STEPS,
    }
}

fn sum(a: i128, b: i128) -> i128 {
    match (is_finite(a), is_finite(b)) {
        (true, true) => a.saturating_add(b).clamp(BELOW, ABOVE),
        (true, false) => b,
        (false, true) => a,
        (false, false) if a == b => a,
        (false, false) => NAN,
    }
}

impl LightSum {
    /// Adds the light of a sample.
    pub fn add(&mut self, light: [f64; 3]) {
        self.join(&LightSum(light.map(fixed)));
    }

    /// The sum of as many equal samples.
    pub fn of_equal(light: [f64; 3], count: u32) -> LightSum {
        let times = |x: i128| if is_finite(x) { x * i128::from(count) } else { x };
        LightSum(light.map(fixed).map(times))
    }

    /// Adds the samples of another sum.
    pub fn join(&mut self, other: &LightSum) {
        (0..3).for_each(|k| self.0[k] = sum(self.0[k], other.0[k]));
    }

    /// The mean of this many samples, of at least one.
    pub fn mean(&self, count: u32) -> [f32; 3] {
        let scale = 1.0 / f64::from(count.max(1));
        self.0.map(|x| (float(x) * scale) as f32)
    }

    /// Adds the sum to bytes: seven bits a byte, the lowest first, the sign in the first one's lowest bit.
    pub fn write(&self, bytes: &mut Vec<u8>) {
        for x in self.0 {
            let mut left = ((x << 1) ^ (x >> 127)) as u128;
            while left > 0x7f {
                bytes.push(left as u8 | 0x80);
                left >>= 7;
            }
            bytes.push(left as u8);
        }
    }

    /// Reads [`LightSum::write`] from the front of bytes, which then begin behind it; nothing of bytes that are none.
    pub fn read(bytes: &mut &[u8]) -> Option<LightSum> {
        let mut sum = LightSum::default();
        for x in &mut sum.0 {
            let mut whole = 0_u128;
            for shift in (0..128).step_by(7) {
                let (&byte, rest) = bytes.split_first()?;
                *bytes = rest;
                whole |= u128::from(byte & 0x7f) << shift;
                if byte < 0x80 {
                    break;
                }
            }
            *x = (whole >> 1) as i128 ^ -((whole & 1) as i128);
        }
        Some(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::LightSum;

    /// Numbers of many sizes, all of single precision.
    fn samples() -> Vec<[f64; 3]> {
        let one = |i: u32, k: u32| {
            let h = (3 * i + k).wrapping_mul(0x9E37_79B1) ^ 0x85EB_CA6B;
            f64::from(h as f32 / 1e9) * f64::from(h % 40).exp2() * 1e-6
        };
        (0..500).map(|i| [one(i, 0), one(i, 1), -one(i, 2)]).collect()
    }

    fn of(samples: &[[f64; 3]]) -> LightSum {
        let mut sum = LightSum::default();
        samples.iter().for_each(|light| sum.add(*light));
        sum
    }

    #[test]
    fn parts_have_the_sum_of_the_whole() {
        let all = samples();
        let whole = of(&all);
        for cut in [1, 7, 250, 499] {
            let (head, tail) = all.split_at(cut);
            let mut parts = of(tail);
            parts.join(&of(head));
            assert_eq!(parts, whole, "{cut}");
        }
        let mean = |k: usize| all.iter().map(|light| light[k]).sum::<f64>() / 500.0;
        for (k, found) in whole.mean(500).into_iter().enumerate() {
            assert!((f64::from(found) / mean(k) - 1.0).abs() < 1e-7);
        }
    }

    #[test]
    fn what_is_no_number_stays_none() {
        let sum = of(&[[f64::NAN, f64::INFINITY, f64::INFINITY], [1.0, 1e30, f64::NEG_INFINITY]]);
        let [nan, above, both] = sum.mean(2);
        assert!(nan.is_nan() && above == f32::INFINITY && both.is_nan());
    }

    #[test]
    fn sums_come_back_from_bytes() {
        let sums = [of(&samples()), LightSum::default(), of(&[[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]])];
        let mut bytes = Vec::new();
        sums.iter().for_each(|sum| sum.write(&mut bytes));
        let mut left = &bytes[..];
        assert!(sums.iter().all(|sum| LightSum::read(&mut left) == Some(*sum)) && left.is_empty());
        assert!((0..bytes.len()).all(|end| {
            let mut left = &bytes[..end];
            std::iter::from_fn(|| LightSum::read(&mut left)).count() < 3
        }));
    }
}
