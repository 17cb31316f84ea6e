//! Picture formats other than PNG, each from a whole picture in memory to the bytes of a file, and the comment that such a file
//! holds.

pub(super) mod exr;
pub(super) mod hdr;
pub(super) mod jpeg;
pub(super) mod tiff;
pub(super) mod webp;

use std::io;

use super::file::{Form, Format};
use super::layers::Layer;

/// A whole picture.
pub(super) struct Whole<'a> {
    /// What is wanted.
    pub form: &'a Form,
    /// Developed numbers, three or four a pixel; nothing for formats of light.
    pub samples: &'a [u16],
    /// Layers of light and data; nothing for formats of developed numbers.
    pub layers: &'a [(Layer, Vec<f32>)],
    /// What the file says of how it was made.
    pub comment: &'a str,
    /// The profile of its colour space, where it has to be named.
    pub profile: Option<Vec<u8>>,
}

impl Whole<'_> {
    /// The developed numbers as bytes.
    fn bytes(&self) -> Vec<u8> {
        self.samples.iter().map(|&sample| sample as u8).collect()
    }

    /// The numbers of a layer.
    fn layer(&self, wanted: Layer) -> &[f32] {
        self.layers.iter().find(|(layer, _)| *layer == wanted).map_or(&[], |(_, numbers)| numbers)
    }
}

/// The bytes of a picture's file.
pub(super) fn encode(picture: Whole) -> io::Result<Vec<u8>> {
    match picture.form.format {
        Format::Png => Err(io::Error::other("PNG files are written row by row")),
        Format::Exr => exr::encode(&picture),
        Format::Hdr => hdr::encode(&picture),
        Format::Jpeg => jpeg::encode(picture),
        Format::Tiff => tiff::encode(picture),
        Format::WebP => webp::encode(picture),
    }
}

/// Longest comment that is read, in bytes.
const MOST_COMMENT: u64 = 8 << 20;
