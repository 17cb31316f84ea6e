//! What is kept of a picture, row by row.

use crate::shade::Size;

/// What may be kept of each pixel.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Layer {
    /// Red, green and blue as bytes of sRGB, developed. Every render has it.
    Srgb,
    /// Red, green and blue of the light itself: linear, `f32`, the average of the samples before exposure and tone curve.
    Radiance,
}

impl Layer {
    /// All of them.
    pub const ALL: [Layer; 2] = [Layer::Srgb, Layer::Radiance];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Layer::Srgb => "srgb",
            Layer::Radiance => "radiance",
        }
    }

    /// Names of what a pixel has, in order.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Layer::Srgb | Layer::Radiance => &["R", "G", "B"],
        }
    }

    /// Bytes of one channel of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            Layer::Srgb => 1,
            Layer::Radiance => 4,
        }
    }
}

/// Some whole rows of a picture, from the left and the top.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Rows {
    /// [`Layer::Srgb`]: three bytes a pixel.
    pub srgb: Vec<u8>,
    /// [`Layer::Radiance`]: three numbers a pixel, and none where nobody wants them.
    pub radiance: Vec<f32>,
}

/// The light of a picture in memory.
#[derive(Clone, PartialEq, Debug)]
pub struct Radiance {
    /// Columns and rows.
    pub size: Size,
    /// Red, green and blue of each pixel, from the top left.
    pub rgb: Vec<f32>,
}

impl Radiance {
    /// No rows yet.
    pub fn new(size: Size) -> Radiance {
        Radiance { size, rgb: Vec::new() }
    }
}
