//! Film: tiles, their pixels in an order that keeps neighbours together, radiance and how it is developed, and the files of pictures.

mod agx;
mod denoise;
mod develop;
mod encoded;
mod file;
mod flicker;
#[cfg(feature = "formats")]
mod formats;
#[cfg_attr(not(feature = "formats"), allow(dead_code))]
mod icc;
mod layers;
mod light_sum;
mod made;
#[cfg(feature = "formats")]
mod movie;
mod png;
mod primaries;
mod progress;
mod recipe;
mod shutter;

use std::path::Path;

pub use self::denoise::{GUIDES, denoise};
pub use self::develop::{Develop, compose_develop, compose_encoded};
pub use self::file::{Depth, Form, Format, PictureFile, Pictures};
pub use self::flicker::{Flicker, Sight, flicker};
pub use self::layers::{Layer, Layers, Radiance, Rows};
pub use self::light_sum::LightSum;
pub use self::made::{MadePng, read_png, read_png_bytes};
#[cfg(feature = "formats")]
pub use self::movie::{Movie, MovieForm, MovieFormat};
pub use self::png::{PngFile, PngForm};
pub use self::recipe::{Made, is_picture, read_made, read_made_bytes};
pub use self::shutter::Shutter;

use crate::files::Target;
use crate::shade::Size;

/// A rectangle of pixels.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Tile {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Edge length of tiles.
pub const TILE: u32 = 256;

/// Cuts a picture into tiles, row by row.
pub fn tiles(size: Size) -> Vec<Tile> {
    Tile { x: 0, y: 0, width: size.width, height: size.height }.cut(TILE)
}

impl Tile {
    /// Cuts the rectangle into tiles of this edge length or less, row by row.
    pub fn cut(&self, edge: u32) -> Vec<Tile> {
        let mut tiles = Vec::new();
        for y in (0..self.height).step_by(edge as usize) {
            for x in (0..self.width).step_by(edge as usize) {
                let (width, height) = (edge.min(self.width - x), edge.min(self.height - y));
                tiles.push(Tile { x: self.x + x, y: self.y + y, width, height });
            }
        }
        tiles
    }

    /// The squares of 2 to the power of `shift` pixels an edge that have some of these pixels, counted in such squares.
    pub fn grouped(&self, shift: u32) -> Tile {
        let (x, y) = (self.x >> shift, self.y >> shift);
        let (right, bottom) = ((self.x + self.width - 1) >> shift, (self.y + self.height - 1) >> shift);
        Tile { x, y, width: right + 1 - x, height: bottom + 1 - y }
    }

    /// Pixels of the tile.
    pub fn count(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// All pixels of the tile, in blocks of 8 by 8: neighbours take similar ways, so they are marched together.
    pub fn pixels(&self) -> Vec<(u32, u32)> {
        let mut pixels = Vec::with_capacity(self.count());
        self.cut(8).iter().flat_map(Tile::rows).for_each(|row| pixels.extend(row.places()));
        pixels
    }

    /// The rows, from the top.
    pub fn rows(&self) -> impl Iterator<Item = Row> + use<> {
        let Tile { x, y, width: len, height } = *self;
        (y..y + height).map(move |y| Row { x, y, len })
    }
}

/// Pixels beside each other.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Row {
    /// The first one's column.
    pub x: u32,
    /// The row that they are in.
    pub y: u32,
    /// Pixels.
    pub len: u32,
}

impl Row {
    /// The pixels' places, from the left.
    pub fn places(&self) -> impl ExactSizeIterator<Item = (u32, u32)> + use<> {
        let Row { x, y, len } = *self;
        (0..len).map(move |column| (x + column, y))
    }

    /// Takes a pixel if it is the next one.
    pub fn take(&mut self, place: (u32, u32)) -> bool {
        let is_next = place == (self.x + self.len, self.y);
        self.len += u32::from(is_next);
        is_next
    }
}

/// A tile of a picture's memory that is written without touching any other: the tiles of a band are written at the same time.
pub struct Window<'a, T> {
    /// Where it is.
    pub tile: Tile,
    rows: Vec<&'a mut [T]>,
}

/// Cuts the memory of a rectangle, row by row, into tiles of this edge length or less.
pub fn windows<T>(all: Tile, pixels: &mut [T], edge: u32) -> Vec<Window<'_, T>> {
    let empty = |tile: Tile| Window { tile, rows: Vec::with_capacity(tile.height as usize) };
    let mut windows: Vec<Window<T>> = all.cut(edge).into_iter().map(empty).collect();
    let beside = all.width.div_ceil(edge) as usize;
    for (y, row) in pixels.chunks_exact_mut(all.width as usize).enumerate() {
        let windows = windows[y / edge as usize * beside..].iter_mut();
        windows.zip(row.chunks_mut(edge as usize)).for_each(|(window, part)| window.rows.push(part));
    }
    windows
}

impl<T> Window<'_, T> {
    /// Sets a pixel by its place in the picture.
    #[inline]
    pub fn set(&mut self, (x, y): (u32, u32), value: T) {
        self.rows[(y - self.tile.y) as usize][(x - self.tile.x) as usize] = value;
    }

    /// Sets pixels that are beside each other.
    pub fn set_row(&mut self, row: Row, values: impl IntoIterator<Item = T>) {
        let pixels = &mut self.rows[(row.y - self.tile.y) as usize][(row.x - self.tile.x) as usize..];
        pixels[..row.len as usize].iter_mut().zip(values).for_each(|(pixel, value)| *pixel = value);
    }
}

/// An 8-bit sRGB picture.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Image {
    /// Columns and rows.
    pub size: Size,
    /// Rows from the top, three bytes a pixel.
    pub rgb: Vec<u8>,
}

impl Image {
    /// A black picture.
    pub fn new(size: Size) -> Image {
        Image { size, rgb: vec![0; size.width as usize * size.height as usize * 3] }
    }

    /// Sets a pixel from sRGB values between 0 and 1; NaN is black.
    pub fn set(&mut self, (x, y): (u32, u32), srgb: [f64; 3]) {
        let at = (y as usize * self.size.width as usize + x as usize) * 3;
        for (byte, value) in self.rgb[at..at + 3].iter_mut().zip(srgb) {
            *byte = srgb_byte(value);
        }
    }

    /// Four bytes a pixel: red, green, blue and 255.
    pub fn rgba(&self) -> Vec<u8> {
        self.rgb.chunks_exact(3).flat_map(|rgb| [rgb[0], rgb[1], rgb[2], 255]).collect()
    }

    /// Writes a PNG, whole or not at all.
    pub fn write_png(&self, path: &Path) -> std::io::Result<()> {
        self.write_png_to(&Target::of(path)?)
    }

    /// Writes a PNG to a target that has been looked at, whole or not at all.
    pub fn write_png_to(&self, target: &Target) -> std::io::Result<()> {
        let mut file = PngFile::at(target, PngForm::plain(self.size));
        file.push(self.rgb.clone());
        file.finish().map(|_| ())
    }
}

/// The byte of an sRGB value between 0 and 1; what is outside takes the end, NaN is 0.
#[inline]
pub fn srgb_byte(value: f64) -> u8 {
    // Numbers from here on are whole, so that the sum is rounded to one, and that has the last bits.
    const WHOLE: f64 = (1_u64 << 52) as f64;
    // NaN goes with the first of the two.
    let inside = value.max(0.0);
    let inside = inside.min(1.0);
    (inside * 255.0 + WHOLE).to_bits() as u8
}
