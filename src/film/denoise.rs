//! A filter for the noise of paths, which keeps the edges of what is seen.
//!
//! In come a picture's light and what its first surfaces are: how much of a pixel they cover, where they are, their normals and own colours. Light is divided by the surfaces' colours,
//! so that these stay as sharp as they are, and averaged over ever wider neighbourhoods (H. Dammertz et al., "Edge-Avoiding A-Trous Wavelet Transform for fast Global
//! Illumination Filtering", 2010). A neighbour counts by how alike its surface is, and by how far its light is from the pixel's own, measured by the noise around both
//! (C. Schied et al., "Spatiotemporal Variance-Guided Filtering", 2017). What covers no surface stays as it is. Each pixel follows from its inputs alone, whatever the
//! number of threads.

use rayon::prelude::*;

use super::layers::{Layer, Layers};
use crate::shade::Size;

/// What the filter needs to know of each pixel.
pub const GUIDES: Layers =
    Layers::NONE.and(Layer::Alpha).and(Layer::Depth).and(Layer::Position).and(Layer::Normal).and(Layer::Albedo);

/// Rounds of the filter; each looks twice as far as the one before.
const ROUNDS: u32 = 5;
/// Weights of a cubic B-spline.
const SPLINE: [f32; 3] = [3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];
/// How far a neighbour may lie from the plane of a surface, in pixels at its depth.
const OFF_PLANE: f32 = 1.5;
/// Power of the cosine between normals.
const NORMALS: i32 = 32;
/// Difference of colours at which neighbours count little.
const COLOURS: f32 = 0.1;
/// Difference of light, in standard deviations of its noise, at which neighbours count little.
const LIGHT: f32 = 4.0;
/// The darkest colour by which light is divided.
const DARKEST: f32 = 0.02;
/// Pixels around one over which its noise is measured, in each direction.
const AROUND: i64 = 3;

/// A surface in a pixel.
#[derive(Clone, Copy, Default)]
struct Guide {
    alpha: f32,
    depth: f32,
    position: [f32; 3],
    normal: [f32; 3],
    albedo: [f32; 3],
}

impl Guide {
    /// Of the numbers of [`GUIDES`], in order; averages over a pixel become those of the part that is covered.
    fn of(numbers: &[f32]) -> Guide {
        let three = |at: usize| [numbers[at], numbers[at + 1], numbers[at + 2]];
        let alpha = numbers[0];
        let covered = if alpha > 0.0 { 1.0 / alpha } else { 0.0 };
        let albedo = three(8).map(|x| x * covered);
        Guide { alpha, depth: numbers[1], position: three(2), normal: unit(three(5)), albedo }
    }

    /// Whether there is a surface whose light is to be filtered.
    fn is_surface(&self) -> bool {
        self.alpha > 0.5 && f64::from(self.depth) < 0.5 * Layer::NOWHERE
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.map(|x| x / length) } else { [0.0; 3] }
}

fn brightness(light: [f32; 3]) -> f32 {
    dot(light, [0.2126, 0.7152, 0.0722])
}

/// A pixel while it is filtered: light without the surface's colour, and the variance of its brightness.
#[derive(Clone, Copy, Default)]
struct Pixel {
    light: [f32; 3],
    variance: f32,
}

/// Filters the light of a picture: three numbers a pixel. `guides` has the numbers of [`GUIDES`] for each pixel, and `pixel` is the angle of a pixel's edge in
/// radians.
pub fn denoise(size: Size, light: &mut [f32], guides: &[f32], pixel: f32) {
    let width = size.width as usize;
    let guides: Vec<Guide> = guides.chunks_exact(GUIDES.channels()).map(Guide::of).collect();
    let colour = |guide: &Guide| guide.albedo.map(|x| x.max(DARKEST));
    let mut pixels: Vec<Pixel> = light
        .chunks_exact(3)
        .zip(&guides)
        .map(|(rgb, guide)| {
            let colour = colour(guide);
            Pixel { light: [0, 1, 2].map(|k| rgb[k] / colour[k]), variance: 0.0 }
        })
        .collect();
    let picture = Picture { size, guides: &guides, pixel };
    let variances: Vec<f32> = (0..pixels.len()).into_par_iter().map(|i| picture.variance(&pixels, i)).collect();
    pixels.iter_mut().zip(variances).for_each(|(pixel, variance)| pixel.variance = variance);
    for round in 0..ROUNDS {
        pixels = (0..pixels.len()).into_par_iter().map(|i| picture.filtered(&pixels, i, 1 << round)).collect();
    }
    let rows = light.par_chunks_exact_mut(3 * width.max(1)).enumerate();
    rows.for_each(|(y, row)| {
        for (x, rgb) in row.chunks_exact_mut(3).enumerate() {
            let (guide, pixel) = (&guides[y * width + x], &pixels[y * width + x]);
            if guide.is_surface() {
                let colour = colour(guide);
                (0..3).for_each(|k| rgb[k] = pixel.light[k] * colour[k]);
            }
        }
    });
}

struct Picture<'a> {
    size: Size,
    guides: &'a [Guide],
    /// Angle of a pixel's edge, in radians.
    pixel: f32,
}

impl Picture<'_> {
    /// The pixel that is so many columns and rows from another one.
    fn beside(&self, at: usize, [right, down]: [i64; 2]) -> Option<usize> {
        let (width, height) = (i64::from(self.size.width), i64::from(self.size.height));
        let (x, y) = (at as i64 % width + right, at as i64 / width + down);
        ((0..width).contains(&x) && (0..height).contains(&y)).then(|| (y * width + x) as usize)
    }

    /// How much a neighbour's surface is like a pixel's own, from 0 to 1.
    fn likeness(&self, p: &Guide, q: &Guide, apart: f32) -> f32 {
        if !q.is_surface() {
            return 0.0;
        }
        let way = [0, 1, 2].map(|k| q.position[k] - p.position[k]);
        let off = dot(way, p.normal).abs() / (OFF_PLANE * apart * self.pixel * p.depth).max(f32::MIN_POSITIVE);
        let other = [0, 1, 2].map(|k| q.albedo[k] - p.albedo[k]);
        let colours = dot(other, other) / (COLOURS * COLOURS);
        dot(p.normal, q.normal).max(0.0).powi(NORMALS) * (-off - colours).exp()
    }

    /// The variance of brightness among the pixels around one that are like it.
    fn variance(&self, pixels: &[Pixel], at: usize) -> f32 {
        let guide = &self.guides[at];
        if !guide.is_surface() {
            return 0.0;
        }
        let (mut all, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for down in -AROUND..=AROUND {
            for right in -AROUND..=AROUND {
                let Some(other) = self.beside(at, [right, down]) else { continue };
                let weight = self.likeness(guide, &self.guides[other], right.abs().max(down.abs()).max(1) as f32);
                let light = brightness(pixels[other].light);
                (all, sum, squares) = (all + weight, sum + weight * light, squares + weight * light * light);
            }
        }
        let mean = sum / all.max(1e-6);
        (squares / all.max(1e-6) - mean * mean).max(0.0)
    }

    /// A pixel averaged with those that are `step` and twice as many pixels away.
    fn filtered(&self, pixels: &[Pixel], at: usize, step: i64) -> Pixel {
        let (guide, own) = (&self.guides[at], pixels[at]);
        if !guide.is_surface() {
            return own;
        }
        let light = brightness(own.light);
        // The noise of the pixel's own neighbourhood: a single bright dot has a variance of its own that says little.
        let deviation = LIGHT * self.smooth_variance(pixels, at).sqrt() + 1e-4 * (light + 1e-4);
        let (mut all, mut sum, mut variance) = (0.0, [0.0; 3], 0.0);
        for down in -2..=2i64 {
            for right in -2..=2i64 {
                let Some(other) = self.beside(at, [right * step, down * step]) else { continue };
                let spline = SPLINE[right.unsigned_abs() as usize] * SPLINE[down.unsigned_abs() as usize];
                let weight = match other == at {
                    true => spline,
                    false => {
                        let apart = (right.abs().max(down.abs()) * step) as f32;
                        let off = (brightness(pixels[other].light) - light).abs() / deviation;
                        spline * self.likeness(guide, &self.guides[other], apart) * (-off).exp()
                    }
                };
                all += weight;
                (0..3).for_each(|k| sum[k] += weight * pixels[other].light[k]);
                variance += weight * weight * pixels[other].variance;
            }
        }
        Pixel { light: sum.map(|x| x / all), variance: variance / (all * all) }
    }

    /// The variance of a pixel and of those next to it.
    fn smooth_variance(&self, pixels: &[Pixel], at: usize) -> f32 {
        let (mut all, mut sum) = (0.0, 0.0);
        for down in -1..=1i64 {
            for right in -1..=1i64 {
                let Some(other) = self.beside(at, [right, down]) else { continue };
                let weight = (2 - right.abs()) as f32 * (2 - down.abs()) as f32;
                if self.guides[other].is_surface() {
                    (all, sum) = (all + weight, sum + weight * pixels[other].variance);
                }
            }
        }
        sum / all.max(1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 32, height: 24 };

    /// A wall of which the right half has another colour, and whose last column is sky.
    fn scene() -> Vec<f32> {
        let pixel = |i: u32| {
            let (x, y) = ((i % SIZE.width) as f32, (i / SIZE.width) as f32);
            let shade = if x < 16.0 { 0.8 } else { 0.2 };
            let is_sky = i % SIZE.width == SIZE.width - 1;
            let [alpha, depth] = if is_sky { [0.0, 1e10] } else { [1.0, 10.0] };
            [alpha, depth, x * 0.1, y * 0.1, 10.0, 0.0, 0.0, -alpha, shade * alpha, shade * alpha, shade * alpha]
        };
        (0..SIZE.width * SIZE.height).flat_map(pixel).collect()
    }

    fn truth() -> Vec<f32> {
        scene().chunks_exact(11).flat_map(|pixel| [if pixel[0] > 0.0 { pixel[8] } else { 0.5 }; 3]).collect()
    }

    #[test]
    fn light_without_noise_stays_as_it_is() {
        let mut light = truth();
        denoise(SIZE, &mut light, &scene(), 0.01);
        assert!(light.iter().zip(truth()).all(|(a, b)| (a - b).abs() < 1e-4));
    }

    #[test]
    fn noise_goes_and_edges_and_the_sky_stay() {
        let (mut random, truth) = (1u32, truth());
        let mut noisy = truth.clone();
        for (i, rgb) in noisy.chunks_exact_mut(3).enumerate() {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let factor = 0.4 + 1.2 * (random >> 8) as f32 / (1 << 24) as f32;
            if i as u32 % SIZE.width != SIZE.width - 1 {
                rgb.iter_mut().for_each(|x| *x *= factor);
            }
        }
        let error = |light: &[f32]| light.iter().zip(&truth).map(|(a, b)| f64::from((a - b) * (a - b))).sum::<f64>();
        let (before, sky) = (error(&noisy), noisy[3 * 31..3 * 32].to_vec());
        denoise(SIZE, &mut noisy, &scene(), 0.01);
        assert!(error(&noisy) < 0.05 * before, "{} of {before}", error(&noisy));
        assert_eq!(&noisy[3 * 31..3 * 32], sky);
        // Beside the edge between two colours neither has taken from the other.
        let row = 3 * 12 * SIZE.width as usize;
        assert!(noisy[row + 3 * 15] > 0.65 && noisy[row + 3 * 16] < 0.28, "{:?}", &noisy[row + 42..row + 54]);
    }
}
