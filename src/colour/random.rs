//! Random gradients whose colours go together.

use super::gradient::{Gradient, Stop};
use super::space::from_oklch;
use crate::math::random::Random;

/// Angles between the hues of a gradient, in degrees from its first: one hue, neighbours, opposites, three and four around.
const SCHEMES: [&[f64]; 6] = [
    &[0.0, 12.0],
    &[0.0, 35.0, -35.0],
    &[0.0, 180.0],
    &[0.0, 160.0, 200.0],
    &[0.0, 120.0, 240.0],
    &[0.0, 40.0, 180.0, 220.0],
];

/// The gradient of a seed: hues of one scheme, lightness that rises and falls, and chroma that shrinks towards both ends of it. The same for the same
/// seed on every machine.
pub fn random_gradient(seed: u64) -> Gradient {
    let mut random = Random::new(seed ^ 0x6772_6164_6965_6e74);
    let base = random.range(0.0, 360.0);
    let scheme = SCHEMES[random.below(SCHEMES.len())];
    let count = 4 + random.below(4);
    let is_cyclic = random.unit() < 0.5;
    let (low, high) = (random.range(0.14, 0.32), random.range(0.84, 0.97));
    let chroma = random.range(0.07, 0.16);
    let waves = if is_cyclic { 1.0 + random.below(2) as f64 } else { 0.5 + 0.5 * random.below(3) as f64 };
    let shift = random.range(-0.05, 0.05);
    let gaps = if is_cyclic { count } else { count - 1 } as f64;
    let mut stop = |i: usize| {
        let at = i as f64 / gaps;
        let wave = 0.5 - 0.5 * ((at * waves + shift) * std::f64::consts::TAU).cos();
        let lightness = low + (high - low) * wave;
        let hue = base + scheme[i % scheme.len()] + random.range(-8.0, 8.0);
        // Light and dark colours of much chroma look like plastic.
        let fade = 1.0 - (2.0 * lightness - 1.15).abs().powi(2) * 0.7;
        Stop { at, colour: from_oklch(lightness, chroma * fade.clamp(0.2, 1.0), hue) }
    };
    let stops: Vec<Stop> = (0..count).map(&mut stop).collect();
    Gradient::new(stops.clone(), is_cyclic).unwrap_or_else(|| unreachable!("{stops:?} are at least four stops"))
}

#[cfg(test)]
mod tests {
    use super::random_gradient;

    #[test]
    fn seeds_make_gradients_of_their_own() {
        for seed in 0..200 {
            let gradient = random_gradient(seed);
            assert_eq!(gradient, random_gradient(seed));
            assert_ne!(gradient, random_gradient(seed + 1));
            assert!(gradient.stops().iter().all(|stop| stop.colour.iter().all(|part| (0.0..=1.0).contains(part))));
        }
    }
}
