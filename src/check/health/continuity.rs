//! Where a map jumps: pairs of points that come ever closer together while their images stay apart.

use crate::math::random::Random;

/// Pairs that are followed, candidates that each tries at every round, and the rounds.
const PAIRS: usize = 96;
const TRIES: usize = 12;
const ROUNDS: usize = 52;
/// Shortening of a pair in a round. Slowly enough for pairs to reach an axis while they shrink: the stretch beside an axis
/// where a map jumps falls with the distance from it.
const SHORTER: f64 = 0.7;
/// Distance of the first pairs.
const FIRST: f64 = 0.4;
/// Half the side of the box that pairs start in.
const REACH: f64 = 2.5;
/// An exponent of the images' distance by the points' below this is a jump; below the next one the stretch is unbounded.
const JUMP: f64 = 0.05;
const UNBOUNDED: f64 = 0.8;
/// Images must stay apart by this share of their size: more than rounding.
const APART: f64 = 1e-4;
/// Images of this size, next to a point where they jump, are a pole.
const POLE: f64 = 1e6;

/// The worst that was found in a map.
#[derive(Clone, PartialEq, Debug)]
pub(super) enum Continuity {
    /// Nothing worse than a bounded stretch; the largest seen between close points.
    Lipschitz(f64),
    /// The stretch grows without bound towards a point, as this (negative) power of the distance.
    Unbounded {
        /// Where.
        at: Vec<f64>,
        /// Exponent.
        exponent: f64,
    },
    /// The images of points next to each other are this far apart.
    Jump {
        /// Where.
        at: Vec<f64>,
        /// How far.
        by: f64,
    },
    /// The map goes to infinity.
    Pole {
        /// Where.
        at: Vec<f64>,
    },
}

/// A pair of points and how far apart their images were after each round.
struct Pair {
    a: Vec<f64>,
    b: Vec<f64>,
    apart: Vec<f64>,
    size: f64,
}

/// A map of many states at once.
pub(super) type Images<'a> = dyn Fn(&[Vec<f64>]) -> Vec<Vec<f64>> + 'a;

/// Looks for jumps of a map of `width` components.
pub(super) fn search(width: usize, map: &Images) -> Continuity {
    let mut random = Random::new(17);
    let mut pairs: Vec<Pair> = (0..PAIRS).map(|i| start(&mut random, width, i)).collect();
    for round in 0..ROUNDS {
        let distance = distance_after(round + 1);
        let candidates: Vec<(Vec<f64>, Vec<f64>)> =
            pairs.iter().flat_map(|pair| candidates(&mut random, pair, distance)).collect();
        let ends: Vec<Vec<f64>> = candidates.iter().flat_map(|(a, b)| [a.clone(), b.clone()]).collect();
        let images = map(&ends);
        for (i, pair) in pairs.iter_mut().enumerate() {
            // NaN is looked for elsewhere; here it is no distance.
            let apart = |k: usize| distance_of(&images[2 * k], &images[2 * k + 1]);
            let own = i * TRIES..(i + 1) * TRIES;
            let best = own.filter(|&k| apart(k).is_finite()).max_by(|&x, &y| apart(x).total_cmp(&apart(y)));
            let Some(best) = best else { continue };
            (pair.a, pair.b) = candidates[best].clone();
            pair.apart.push(apart(best));
            pair.size = images[2 * best].iter().fold(1.0, |size: f64, x| size.max(x.abs()));
        }
    }
    judge(&pairs)
}

/// Distance of the points of a pair after some rounds.
fn distance_after(rounds: usize) -> f64 {
    FIRST * SHORTER.powi(rounds as i32)
}

/// Half of the pairs start anywhere, half beside an axis or a plane through the origin, where formulas have their seams.
fn start(random: &mut Random, width: usize, i: usize) -> Pair {
    let mut a: Vec<f64> = (0..width).map(|_| random.range(-REACH, REACH)).collect();
    if i % 2 == 1 {
        let kept = random.below(width);
        for (axis, x) in a.iter_mut().enumerate().filter(|(axis, _)| *axis != kept) {
            *x = if i % 4 == 1 || axis % 2 == 0 { *x * 0.04 } else { *x };
        }
    }
    let direction = unit(random, width);
    let b = a.iter().zip(direction).map(|(x, d)| x + FIRST * d).collect();
    Pair { a, b, apart: Vec::new(), size: 1.0 }
}

/// Both ends of a pair, which overlap so that no jump falls between them, and pairs of this length around it.
fn candidates(random: &mut Random, pair: &Pair, distance: f64) -> Vec<(Vec<f64>, Vec<f64>)> {
    let along = |share: f64| pair.a.iter().zip(&pair.b).map(|(a, b)| a + share * (b - a)).collect::<Vec<f64>>();
    let mut all = vec![(pair.a.clone(), along(SHORTER)), (along(1.0 - SHORTER), pair.b.clone())];
    let middle = along(0.5);
    while all.len() < TRIES {
        let spread = 2.0 * distance * random.unit();
        let shift = unit(random, middle.len());
        let direction = unit(random, middle.len());
        let at = |sign: f64| {
            let parts = middle.iter().zip(&shift).zip(&direction);
            parts.map(|((m, s), d)| m + spread * s + sign * 0.5 * distance * d).collect::<Vec<f64>>()
        };
        all.push((at(-1.0), at(1.0)));
    }
    all
}

fn unit(random: &mut Random, width: usize) -> Vec<f64> {
    let v: Vec<f64> = (0..width).map(|_| random.range(-1.0, 1.0)).collect();
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
    v.into_iter().map(|x| x / length).collect()
}

fn distance_of(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

fn judge(pairs: &[Pair]) -> Continuity {
    let middle = ROUNDS / 2;
    let mut worst = Continuity::Lipschitz(0.0);
    let mut worst_exponent = UNBOUNDED;
    for pair in pairs.iter().filter(|pair| pair.apart.len() == ROUNDS) {
        let (wide, narrow) = (pair.apart[middle], pair.apart[ROUNDS - 1]);
        let exponent = (wide / narrow).ln() / (distance_after(middle + 1) / distance_after(ROUNDS)).ln();
        // Rounding keeps images apart by a few units of the last digit, however close the points are.
        let is_real = narrow > 1e-12 * pair.size;
        if is_real && exponent < worst_exponent {
            worst_exponent = exponent;
            let at = pair.a.clone();
            worst = match exponent < JUMP {
                _ if pair.size > POLE => Continuity::Pole { at },
                true if narrow > APART * pair.size => Continuity::Jump { at, by: narrow },
                _ => Continuity::Unbounded { at, exponent: exponent - 1.0 },
            };
        } else if let Continuity::Lipschitz(largest) = &mut worst {
            *largest = largest.max(wide / distance_after(middle + 1));
        }
    }
    worst
}
