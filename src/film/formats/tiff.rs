//! TIFF: bytes or 16-bit numbers, losslessly compressed (Deflate).

use std::io::{self, Cursor, Read, Seek};

use tiff::decoder::{Decoder, Limits};
use tiff::encoder::colortype::{ColorType, RGB8, RGB16};
use tiff::encoder::compression::DeflateLevel;
use tiff::encoder::{Compression, Rational, TiffEncoder, TiffValue};
use tiff::tags::{ExtraSamples, ResolutionUnit, Tag};

use super::super::file::Depth;
use super::{MOST_COMMENT, Whole};

/// The tag of colour profiles.
const ICC: Tag = Tag::Unknown(34675);

pub(super) fn encode(picture: Whole) -> io::Result<Vec<u8>> {
    match picture.form.depth {
        Depth::Eight => write::<RGB8>(&picture, &picture.bytes()),
        Depth::Sixteen => write::<RGB16>(&picture, picture.samples),
    }
    .map_err(io::Error::other)
}

fn write<C: ColorType>(picture: &Whole, samples: &[C::Inner]) -> tiff::TiffResult<Vec<u8>>
where
    [C::Inner]: TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    let mut file = TiffEncoder::new(&mut bytes)?.with_compression(Compression::Deflate(DeflateLevel::Balanced));
    let mut image = file.new_image::<C>(picture.form.size.width, picture.form.size.height)?;
    if picture.form.transparent {
        image.extra_samples(&[ExtraSamples::UnassociatedAlpha])?;
    }
    if let Some(dpi) = picture.form.dpi {
        let n = (dpi * 1000.0).round().clamp(1.0, f64::from(u32::MAX)) as u32;
        image.resolution(ResolutionUnit::Inch, Rational { n, d: 1000 });
    }
    image.encoder().write_tag(Tag::ImageDescription, picture.comment)?;
    if let Some(profile) = &picture.profile {
        image.encoder().write_tag(ICC, &profile[..])?;
    }
    image.write_data(samples)?;
    Ok(bytes.into_inner())
}

pub(in super::super) fn comment<R: Read + Seek>(file: &mut R) -> Result<String, String> {
    let broken = |error: tiff::TiffError| format!("it is no whole TIFF ({error})");
    let mut limits = Limits::default();
    limits.ifd_value_size = MOST_COMMENT as usize;
    let mut decoder = Decoder::new(file).map_err(broken)?.with_limits(limits);
    let text = decoder.find_tag(Tag::ImageDescription).map_err(broken)?;
    Ok(text.and_then(|text| text.into_string().ok()).unwrap_or_default())
}
