//! Light of a picture of surroundings, picked by chance where it is bright.
//!
//! A row is picked by the light of its texels, then a texel of the row, each by Walker's alias method in the form of Vose (1991): two
//! numbers are looked up for each. What is left of the random numbers says where in the texel.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use crate::colour::{Panorama, place};
use crate::expr::{Arena, Expr, Table};

/// Least chance of a texel, as a share of the mean: no light is left to scattered rays alone.
const LEAST: f64 = 0.02;

/// How directions towards a picture's light are picked.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Sampler {
    size: [u32; 2],
    /// Of rows, then of each row's texels: the share of its place that a number keeps, and which takes the rest. Then the density of
    /// each texel's directions by solid angle, times the sine of the angle from straight up.
    table: Arc<Table>,
    turn: f64,
}

impl Sampler {
    pub fn new(panorama: &Panorama, turn: f64) -> Sampler {
        let [width, height] = panorama.size().map(|edge| edge as usize);
        let chances = chances(panorama);
        let rows: Vec<f64> = chances.chunks(width).map(|row| row.iter().sum()).collect();
        let sum: f64 = rows.iter().sum();
        let mut numbers = aliases(&rows);
        chances.chunks(width).for_each(|row| numbers.extend(aliases(row)));
        let whole = (width * height) as f64 / (TAU * PI);
        numbers.extend(chances.iter().map(|chance| (chance / sum * whole) as f32));
        debug_assert_eq!(numbers.len(), 2 * height + 3 * width * height);
        Sampler { size: panorama.size(), table: Arc::new(Table::new(numbers)), turn }
    }

    /// A direction by two random numbers.
    pub fn direction<'g>(&self, arena: &'g Arena, (u, v): (Expr<'g>, Expr<'g>)) -> Expr<'g> {
        let [width, height] = self.size.map(f64::from);
        let (row, down) = self.pick(arena, v, (height, arena.f(0.0)));
        let first = row * (2.0 * width) + 2.0 * height;
        let (column, across) = self.pick(arena, u, (width, first));
        let around = (column + across) * (TAU / width) - (PI + self.turn);
        let polar = (row + down) * (PI / height);
        let flat = polar.sin();
        arena.compose(&[flat * around.sin(), flat * around.cos(), polar.cos()])
    }

    /// The density of a direction by solid angle.
    pub fn density<'g>(&self, arena: &'g Arena, direction: Expr<'g>) -> Expr<'g> {
        let [width, height] = self.size.map(f64::from);
        let [across, down] = place(direction, self.turn);
        let number = |share: Expr<'g>, count: f64| (share * count).floor().clamp(arena.f(0.0), arena.f(count - 1.0));
        let texel = number(down, height) * width + number(across, width);
        let parts = direction.components();
        let flat = (parts[0] * parts[0] + parts[1] * parts[1]).sqrt();
        arena.look_up(&self.table, texel + 2.0 * height + 2.0 * width * height) / flat.max(arena.f(1e-6))
    }

    /// A number below `count` by a random one, from the pairs that begin at an index, and what is left of it.
    fn pick<'g>(&self, arena: &'g Arena, random: Expr<'g>, (count, first): (f64, Expr<'g>)) -> (Expr<'g>, Expr<'g>) {
        let scaled = random * count;
        let number = scaled.floor().min(arena.f(count - 1.0));
        let rest = scaled - number;
        let at = number * 2.0 + first;
        let kept = arena.look_up(&self.table, at);
        let is_kept = rest.lt(kept);
        let other = arena.look_up(&self.table, at + 1.0);
        let left = is_kept.select(rest / kept, (rest - kept) / (1.0 - kept));
        (is_kept.select(number, other), left.clamp(arena.f(0.0), arena.f(1.0)))
    }
}

/// How often each texel is picked: by the light of what is shown within it, mixed from its neighbours, and its solid angle.
fn chances(panorama: &Panorama) -> Vec<f64> {
    let [width, height] = panorama.size().map(|edge| edge as usize);
    let light: Vec<f64> =
        panorama.texels().map(|rgb| rgb.iter().map(|part| f64::from(*part)).sum::<f64>() / 3.0).collect();
    let mixed = |own: f64, before: f64, after: f64| own * 0.75 + (before + after) * 0.125;
    let mut across = Vec::with_capacity(light.len());
    for row in light.chunks(width) {
        across.extend((0..width).map(|x| mixed(row[x], row[(x + width - 1) % width], row[(x + 1) % width])));
    }
    let at = |x: usize, y: usize| across[y * width + x];
    let row = |y: usize| (0..width).map(move |x| (x, y));
    let whole = (0..height).flat_map(row);
    let light = whole.map(|(x, y)| mixed(at(x, y), at(x, y.saturating_sub(1)), at(x, (y + 1).min(height - 1))));
    let light: Vec<f64> = light.collect();
    let least = light.iter().sum::<f64>() / light.len() as f64 * LEAST;
    let sine = |i: usize| (((i / width) as f64 + 0.5) / height as f64 * PI).sin();
    light.iter().enumerate().map(|(i, light)| light.max(least).max(1e-30) * sine(i)).collect()
}

/// Of each number: the share of its place that it keeps, and which number takes the rest.
fn aliases(chances: &[f64]) -> Vec<f32> {
    let scale = chances.len() as f64 / chances.iter().sum::<f64>();
    let mut left: Vec<f64> = chances.iter().map(|chance| chance * scale).collect();
    let mut pairs: Vec<[f32; 2]> = (0..chances.len()).map(|i| [1.0, i as f32]).collect();
    let (mut poor, mut rich): (Vec<usize>, Vec<usize>) = (0..left.len()).partition(|i| left[*i] < 1.0);
    while let (Some(low), Some(high)) = (poor.pop(), rich.pop()) {
        pairs[low] = [left[low] as f32, high as f32];
        left[high] -= 1.0 - left[low];
        if left[high] < 1.0 { poor.push(high) } else { rich.push(high) }
    }
    pairs.into_flattened()
}

#[cfg(test)]
mod tests {
    use super::aliases;

    #[test]
    fn each_number_is_picked_as_often_as_it_should_be() {
        let chances = [5.0, 1.0, 0.25, 0.0, 3.75];
        let pairs = aliases(&chances);
        let mut found = [0.0; 5];
        for (i, pair) in pairs.chunks(2).enumerate() {
            found[i] += f64::from(pair[0]) / 5.0;
            found[pair[1] as usize] += (1.0 - f64::from(pair[0])) / 5.0;
        }
        assert!((0..5).all(|i| (found[i] - chances[i] / 10.0).abs() < 1e-6), "{found:?}");
    }
}
