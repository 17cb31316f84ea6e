//! Equirectangular pictures of surroundings: read from files, carried in texts, and looked up by direction.
//!
//! A picture is kept with at most 1024 by 512 texels of three bytes and a common exponent, as Radiance HDR has them (G. Ward, "Real
//! pixels", 1991): so a job that carries one stays small, and whoever renders it has the same light.

mod decode;

use std::f64::consts::{PI, TAU};
use std::fmt;
use std::io::{Read, Write};
use std::sync::{Arc, OnceLock};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;

use crate::expr::{Arena, Expr, Table};

/// Largest file that is read, in bytes.
pub const MOST_BYTES: u64 = 256 << 20;
/// Most columns and rows that are kept.
const MOST_SIZE: [u32; 2] = [1024, 512];
/// The largest radiance that is kept.
const BRIGHTEST: f32 = 1e9;

/// An equirectangular picture: radiance by direction, linear. Rows go from straight up to straight down. The middle column is the
/// direction y, and columns to the right of it turn to the direction x, as one sees it from inside; z is up.
pub struct Panorama {
    size: [u32; 2],
    /// Red, green and blue of each texel, row by row.
    texels: Arc<Table>,
    /// Its own text, once it is asked for.
    text: OnceLock<String>,
}

impl fmt::Debug for Panorama {
    /// What differs where pictures do.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "picture of {:?}, {:?}", self.size, self.texels)
    }
}

impl PartialEq for Panorama {
    fn eq(&self, other: &Panorama) -> bool {
        self.size == other.size && self.texels == other.texels
    }
}

/// Light of a picture at full size, row by row.
struct Light {
    size: [u32; 2],
    pixels: Vec<[f32; 3]>,
}

impl Panorama {
    /// Reads a Radiance HDR, OpenEXR, PNG or JPEG file; the last two are taken to be sRGB. Larger ones are averaged down.
    ///
    /// Errors: why it cannot be, as the end of a sentence that begins with the file's name.
    pub fn decode(bytes: &[u8]) -> Result<Panorama, String> {
        let light = decode::light(bytes)?;
        let [width, height] = light.size;
        // A row more or less is no harm.
        if width < 2 || height < 1 || width.abs_diff(2 * height) > 2 + width / 50 {
            return Err(format!(
                "is {width} by {height} pixels; surroundings are twice as wide as high (equirectangular)"
            ));
        }
        let size = [width.min(MOST_SIZE[0]), height.min(MOST_SIZE[1])];
        let light = light.averaged(size);
        let rgbe: Vec<[u8; 4]> = light.pixels.into_iter().map(packed).collect();
        Ok(Panorama::new(light.size, &rgbe))
    }

    fn new(size: [u32; 2], rgbe: &[[u8; 4]]) -> Panorama {
        let texels = rgbe.iter().flat_map(|texel| unpacked(*texel)).collect();
        Panorama { size, texels: Arc::new(Table::new(texels)), text: OnceLock::new() }
    }

    /// The picture as a text of base64, compressed: what a job carries. Reading it again gives the same picture.
    pub fn text(&self) -> &str {
        self.text.get_or_init(|| self.written())
    }

    fn written(&self) -> String {
        let mut bytes = self.size.map(u32::to_le_bytes).concat();
        let rgbe: Vec<[u8; 4]> = self.texels().map(packed).collect();
        (0..4).for_each(|k| bytes.extend(rgbe.iter().map(|texel| texel[k])));
        let mut packer = ZlibEncoder::new(Vec::new(), Compression::default());
        // Memory takes all that is written.
        let packed = packer.write_all(&bytes).and_then(|()| packer.finish()).unwrap_or_default();
        STANDARD.encode(packed)
    }

    /// Reads a picture's own text.
    ///
    /// Errors: it is none, as the end of a sentence that begins with its name.
    pub fn of_text(text: &str) -> Result<Panorama, String> {
        let broken = || "is no picture of surroundings, or damaged".to_string();
        let most = 8 + 4 * u64::from(MOST_SIZE[0] * MOST_SIZE[1]);
        let packed = STANDARD.decode(text).map_err(|_| broken())?;
        let mut bytes = Vec::new();
        ZlibDecoder::new(&packed[..]).take(most + 1).read_to_end(&mut bytes).map_err(|_| broken())?;
        let (head, planes) = bytes.split_at_checked(8).ok_or_else(broken)?;
        let number = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let size = [number(0), number(4)];
        let is_in_range = (0..2).all(|k| (1..=MOST_SIZE[k]).contains(&size[k]));
        if !is_in_range || planes.len() as u64 != 4 * u64::from(size[0]) * u64::from(size[1]) {
            return Err(broken());
        }
        let count = planes.len() / 4;
        let rgbe: Vec<[u8; 4]> = (0..count).map(|i| [0, 1, 2, 3].map(|k| planes[k * count + i])).collect();
        Ok(Panorama::new(size, &rgbe))
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The radiance of each texel, row by row.
    pub fn texels(&self) -> impl Iterator<Item = [f32; 3]> {
        self.texels.numbers().as_chunks().0.iter().copied()
    }

    /// The mean radiance of all directions.
    pub fn mean(&self) -> [f64; 3] {
        let (mut sum, mut all) = ([0.0; 3], 0.0);
        for (texel, [_, _, share]) in self.texels().zip(self.directions(1)) {
            (0..3).for_each(|k| sum[k] += f64::from(texel[k]) * share);
            all += share;
        }
        sum.map(|part| part / all)
    }

    /// Of each texel, row by row, and of each of its `parts` by `parts` parts: the angle around z from y to x, that from straight up, and
    /// the solid angle.
    pub fn directions(&self, parts: u32) -> impl Iterator<Item = [f64; 3]> + use<> {
        let [width, height] = self.size.map(f64::from);
        let share = 1.0 / f64::from(parts);
        let part = move |x: u32, y: u32, i: u32| {
            let (x, y) = (f64::from(x) + f64::from(i % parts) * share, f64::from(y) + f64::from(i / parts) * share);
            let [top, bottom] = [y, y + share].map(|edge| (edge / height * PI).cos());
            let (around, polar) = (((x + 0.5 * share) / width - 0.5) * TAU, (y + 0.5 * share) / height * PI);
            [around, polar, (top - bottom) * TAU / width * share]
        };
        let [columns, rows] = self.size;
        let texel = move |x: u32, y: u32| (0..parts * parts).map(move |i| part(x, y, i));
        (0..rows).flat_map(move |y| (0..columns).flat_map(move |x| texel(x, y)))
    }

    /// Radiance from a direction, a unit vector, in a picture that is turned around z (from x to y) by an angle in radians: between
    /// the texels around it.
    pub fn radiance<'g>(&self, arena: &'g Arena, turn: f64, direction: Expr<'g>) -> Expr<'g> {
        let [width, height] = self.size.map(f64::from);
        let [across, down] = place(direction, turn);
        let (x, y) = (across * width - 0.5, down * height - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (zero, last_row) = (arena.f(0.0), arena.f(height - 1.0));
        let right = left + 1.0;
        let columns = [left.lt(zero).select(left + width, left), right.lt(arena.f(width)).select(right, right - width)];
        let rows = [top, top + 1.0].map(|row| row.clamp(zero, last_row));
        let texel = |row: Expr<'g>, column: Expr<'g>| {
            let first = (row * width + column) * 3.0;
            arena.compose(&[0.0, 1.0, 2.0].map(|k| arena.look_up(&self.texels, first + k)))
        };
        let along = |row: Expr<'g>| texel(row, columns[0]).mix(texel(row, columns[1]), x - left);
        along(rows[0]).mix(along(rows[1]), y - top)
    }
}

/// Where a direction is in a picture that is turned by an angle: shares of its width from the left and of its height from the top.
pub fn place(direction: Expr<'_>, turn: f64) -> [Expr<'_>; 2] {
    let parts = direction.components();
    let across = parts[0].atan2(parts[1]) * (1.0 / TAU) + (0.5 + turn / TAU).rem_euclid(1.0);
    let flat = (parts[0] * parts[0] + parts[1] * parts[1]).sqrt();
    [across - across.floor(), 0.5 - parts[2].atan2(flat) * (1.0 / PI)]
}

/// Three bytes and a common exponent; the largest one has its highest bit.
fn packed(rgb: [f32; 3]) -> [u8; 4] {
    let rgb = rgb.map(|part| if part > 0.0 { f64::from(part.min(BRIGHTEST)) } else { 0.0 });
    let most = rgb.iter().fold(0.0, |most: f64, part| most.max(*part));
    if most < 1e-30 {
        return [0; 4];
    }
    let mut exponent = most.log2().floor() as i32 + 1;
    let bytes = |exponent: i32| rgb.map(|part| (part * 2f64.powi(8 - exponent)).round());
    if bytes(exponent).iter().any(|byte| *byte > 255.0) {
        exponent += 1;
    }
    let [r, g, b] = bytes(exponent).map(|byte| byte as u8);
    [r, g, b, (exponent + 128) as u8]
}

fn unpacked([r, g, b, exponent]: [u8; 4]) -> [f32; 3] {
    let scale = 2f64.powi(i32::from(exponent) - 136);
    [r, g, b].map(|byte| (f64::from(byte) * scale) as f32)
}

impl Light {
    /// The picture with fewer columns and rows, each the mean of what it covers.
    fn averaged(self, size: [u32; 2]) -> Light {
        if size == self.size {
            return self;
        }
        let [columns, rows] = [0, 1].map(|k| shares(self.size[k], size[k]));
        let width = self.size[0] as usize;
        let mut pixels = Vec::with_capacity(size[0] as usize * size[1] as usize);
        for row in &rows {
            for column in &columns {
                let mut sum = [0.0; 3];
                for &(y, down) in row {
                    for &(x, across) in column {
                        let pixel = self.pixels[y * width + x];
                        (0..3).for_each(|k| sum[k] += f64::from(pixel[k].min(BRIGHTEST)) * down * across);
                    }
                }
                pixels.push(sum.map(|part| part as f32));
            }
        }
        Light { size, pixels }
    }
}

/// Of each of `to` parts: the numbers of those of `from` that it covers, and their shares of it.
fn shares(from: u32, to: u32) -> Vec<Vec<(usize, f64)>> {
    let scale = f64::from(from) / f64::from(to);
    let part = |i: u32| {
        let (start, end) = (f64::from(i) * scale, f64::from(i + 1) * scale);
        let covered = start as u32..(end.ceil() as u32).min(from);
        let share = |j: u32| (end.min(f64::from(j + 1)) - start.max(f64::from(j))) / scale;
        covered.map(|j| (j as usize, share(j))).collect()
    };
    (0..to).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::{Light, Panorama, packed, shares, unpacked};

    #[test]
    fn light_is_kept_to_half_a_percent() {
        for light in [[1.0, 1.0, 1.0], [0.3, 0.7, 0.2], [1e6, 2e5, 1e4], [1e-4, 3e-4, 2e-4], [255.9, 0.0, 128.0]] {
            let found = unpacked(packed(light));
            let most = light.iter().copied().fold(0.0, f32::max);
            assert!((0..3).all(|k| (found[k] - light[k]).abs() <= most / 256.0), "{light:?} {found:?}");
            assert_eq!(packed(found), packed(light), "what is kept is kept");
        }
        assert_eq!(unpacked(packed([1.0, 0.5, 0.0])), [1.0, 0.5, 0.0]);
        assert_eq!(packed([f32::NAN, -1.0, 0.0]), [0; 4]);
    }

    #[test]
    fn smaller_pictures_have_the_same_mean() {
        let pixels = (0..70).map(|i| [i as f32, 1.0, 0.0]).collect();
        let light = Light { size: [10, 7], pixels }.averaged([4, 3]);
        let mean = light.pixels.iter().map(|p| p[0]).sum::<f32>() / 12.0;
        assert!((mean - 34.5).abs() < 1e-3 && light.pixels.iter().all(|p| (p[1] - 1.0).abs() < 1e-6));
        assert!(shares(10, 4).iter().all(|part| (part.iter().map(|p| p.1).sum::<f64>() - 1.0).abs() < 1e-12));
    }

    #[test]
    fn texts_give_the_same_picture() {
        let rgbe: Vec<[u8; 4]> = (0..8).map(|i| packed([i as f32, 0.5, 2.0])).collect();
        let picture = Panorama::new([4, 2], &rgbe);
        assert_eq!(Panorama::of_text(picture.text()).as_ref(), Ok(&picture));
        assert!((picture.directions(3).map(|d| d[2]).sum::<f64>() - 4.0 * std::f64::consts::PI).abs() < 1e-12);
        for text in ["", "no", &picture.text()[..12], "eJxjYAACAAAEAAE="] {
            assert!(Panorama::of_text(text).is_err(), "{text}");
        }
    }
}
