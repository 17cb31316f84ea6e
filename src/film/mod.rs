//! Film: tiles, their pixels in an order that keeps neighbours together, and PNG files.

mod png;

use std::path::{Path, PathBuf};

pub use self::png::PngFile;

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

    /// All pixels of the tile, in blocks of 8 by 8: neighbours take similar ways, so they are marched together.
    pub fn pixels(&self) -> Vec<(u32, u32)> {
        let mut pixels = Vec::with_capacity((self.width * self.height) as usize);
        for block_y in (0..self.height).step_by(8) {
            for block_x in (0..self.width).step_by(8) {
                for y in block_y..(block_y + 8).min(self.height) {
                    for x in block_x..(block_x + 8).min(self.width) {
                        pixels.push((self.x + x, self.y + y));
                    }
                }
            }
        }
        pixels
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

    /// Writes a PNG beside the target and then renames it, so that a good file is never replaced by a broken one.
    pub fn write_png(&self, path: &Path) -> std::io::Result<()> {
        let mut file = PngFile::new(path, self.size);
        file.push(self.rgb.clone());
        file.finish().map(|_| ())
    }
}

/// The byte of an sRGB value between 0 and 1; what is outside takes the end, NaN is 0.
pub fn srgb_byte(value: f64) -> u8 {
    // Numbers from here on are whole, so that the sum is rounded to one, and that has the last bits.
    const WHOLE: f64 = (1_u64 << 52) as f64;
    let inside = if value > 0.0 { value.min(1.0) } else { 0.0 };
    (inside * 255.0 + WHOLE).to_bits() as u8
}

/// A temporary name in the same folder.
fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.tmp", std::process::id()));
    path.with_file_name(name)
}

/// Writes a file under a temporary name in the same folder, then renames it.
pub fn write_beside(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let temporary = beside(path);
    let result = std::fs::write(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, path));
    if result.is_err() {
        let _ = std::fs::remove_file(&temporary);
    }
    result
}
