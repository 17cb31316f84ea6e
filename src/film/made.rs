//! PNG files that an earlier run has made.

use std::io::Cursor;
use std::path::Path;

use super::recipe::KEY;
use crate::files::{Chosen, read_bytes};
use crate::shade::Size;

/// A whole picture in a file.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MadePng {
    /// The key of the job that made it, where it says so.
    pub key: Option<String>,
}

/// Looks at a PNG file that is to be a picture of this size: all of it is decoded, and its checksums are compared.
///
/// Errors: what is wrong with it, as the end of a sentence that begins with its name.
pub fn read_png(path: &Path, size: Size) -> Result<MadePng, String> {
    // Compressed data is a little longer than what it holds, at most.
    let raw = u64::from(size.height) * (u64::from(size.width) * 8 + 1);
    let bytes = read_bytes(path, raw + raw / 64 + (1 << 20), Chosen::Found).map_err(|error| error.to_string())?;
    read_png_bytes(&bytes, size)
}

/// Looks at the bytes of a PNG file as [`read_png`] does.
///
/// Errors: what is wrong with it, as the end of a sentence that begins with its name.
pub fn read_png_bytes(bytes: &[u8], size: Size) -> Result<MadePng, String> {
    let broken = |error: png::DecodingError| format!("it is no whole PNG ({error})");
    let mut decoder = png::Decoder::new_with_options(Cursor::new(bytes), strict());
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(broken)?;
    let info = reader.info();
    if (info.width, info.height) != (size.width, size.height) {
        return Err(format!("its size is {}x{} and not {}x{}", info.width, info.height, size.width, size.height));
    }
    let is_colour = matches!(info.color_type, png::ColorType::Rgb | png::ColorType::Rgba);
    if !is_colour || !matches!(info.bit_depth, png::BitDepth::Eight | png::BitDepth::Sixteen) {
        return Err("its pixels have no colours of 8 or 16 bits".into());
    }
    let key = info.uncompressed_latin1_text.iter().find(|text| text.keyword == KEY).map(|text| text.text.clone());
    let mut rows = 0;
    while reader.next_row().map_err(broken)?.is_some() {
        rows += 1;
    }
    reader.finish().map_err(broken)?;
    if rows == size.height { Ok(MadePng { key }) } else { Err("it is no whole PNG (rows are missing)".into()) }
}

/// Compares every checksum.
fn strict() -> png::DecodeOptions {
    let mut options = png::DecodeOptions::default();
    options.set_ignore_checksums(false);
    options.set_skip_ancillary_crc_failures(false);
    options
}
