//! Flicker: what changes from picture to picture and motion does not explain.

use crate::shade::Size;

/// A small picture of a frame.
#[derive(Clone, PartialEq, Debug)]
pub struct Sight {
    /// Columns and rows.
    pub size: Size,
    /// Brightness of each pixel, from 0 to 1, as it is shown.
    pub brightness: Vec<f32>,
    /// Depth of each pixel in world units; [`Layer::NOWHERE`](super::Layer::NOWHERE) without a hit.
    pub depth: Vec<f32>,
}

/// What flickers in a picture between two others.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Flicker {
    /// Share of the pixels whose hit is neither where the neighbours' hits are nor between them.
    pub hits: f64,
    /// Share of the pixels whose brightness is outside of what the neighbours show around them.
    pub brightness: f64,
    /// How far the mean brightness is beside that of its neighbours, as a share of it.
    pub step: f64,
}

/// Pixels around that motion may bring here from one picture to the next.
const REACH: i64 = 3;
/// Ratios of depths, and differences of brightness, that are no flicker.
const DEPTH: f32 = 1.25;
const BRIGHTNESS: f32 = 0.12;

/// What flickers in the middle of three pictures of one size.
pub fn flicker(before: &Sight, own: &Sight, after: &Sight) -> Flicker {
    let (width, height) = (i64::from(own.size.width), i64::from(own.size.height));
    let around = |of: fn(&Sight) -> &[f32], x: i64, y: i64| {
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for sight in [before, after] {
            for v in (y - REACH).max(0)..(y + REACH + 1).min(height) {
                for u in (x - REACH).max(0)..(x + REACH + 1).min(width) {
                    let value = of(sight)[(v * width + u) as usize];
                    range = [range[0].min(value), range[1].max(value)];
                }
            }
        }
        range
    };
    let (mut hits, mut bright) = (0u32, 0u32);
    for y in 0..height {
        for x in 0..width {
            let at = (y * width + x) as usize;
            let [near, far] = around(|sight| &sight.depth, x, y);
            let [dark, light] = around(|sight| &sight.brightness, x, y);
            hits += u32::from(own.depth[at] < near / DEPTH || own.depth[at] > far * DEPTH);
            bright += u32::from(own.brightness[at] < dark - BRIGHTNESS || own.brightness[at] > light + BRIGHTNESS);
        }
    }
    let count = (width * height).max(1) as f64;
    let mean = |sight: &Sight| sight.brightness.iter().map(|b| f64::from(*b)).sum::<f64>() / count;
    let middle = f64::midpoint(mean(before), mean(after));
    let step = (mean(own) - middle).abs() / middle.max(1e-3);
    Flicker { hits: f64::from(hits) / count, brightness: f64::from(bright) / count, step }
}

#[cfg(test)]
mod tests {
    use super::{Flicker, Sight, flicker};
    use crate::shade::Size;

    /// A bright bar that begins at a column, in front of a dark wall.
    fn bar(first: u32) -> Sight {
        let size = Size { width: 40, height: 20 };
        let is_bar = |i: u32| (first..first + 8).contains(&(i % 40));
        let brightness = (0..800).map(|i| if is_bar(i) { 0.9 } else { 0.2 }).collect();
        let depth = (0..800).map(|i| if is_bar(i) { 1.0 } else { 4.0 }).collect();
        Sight { size, brightness, depth }
    }

    #[test]
    fn motion_is_no_flicker() {
        assert_eq!(flicker(&bar(10), &bar(12), &bar(14)), Flicker::default());
    }

    #[test]
    fn what_comes_and_goes_is_flicker() {
        let mut odd = bar(12);
        for i in [30, 70, 110, 111] {
            (odd.depth[i], odd.brightness[i]) = (0.2, 0.9);
        }
        let found = flicker(&bar(10), &odd, &bar(14));
        assert_eq!((found.hits, found.brightness), (4.0 / 800.0, 4.0 / 800.0));
        let mut dim = bar(12);
        dim.brightness.iter_mut().for_each(|b| *b *= 0.9);
        assert!((flicker(&bar(10), &dim, &bar(14)).step - 0.1).abs() < 1e-6);
    }
}
