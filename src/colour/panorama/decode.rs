//! Light of picture files.

use std::io::Cursor;

use super::Light;
use crate::colour::space::linear;

/// Most columns and rows of a file.
const MOST_SIZE: [u32; 2] = [8192, 4096];

/// Formats that are read, by how their files begin.
pub(super) fn light(bytes: &[u8]) -> Result<Light, String> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => of_png(bytes),
        #[cfg(feature = "formats")]
        [0x76, 0x2f, 0x31, 0x01, ..] => of_exr(bytes),
        #[cfg(feature = "formats")]
        [b'#', b'?', ..] => of_image(bytes, image::ImageFormat::Hdr),
        #[cfg(feature = "formats")]
        [0xff, 0xd8, 0xff, ..] => of_image(bytes, image::ImageFormat::Jpeg),
        #[cfg(feature = "formats")]
        _ => Err("is no picture that is read here: Radiance HDR, OpenEXR, PNG and JPEG are".into()),
        #[cfg(not(feature = "formats"))]
        _ => Err("is no PNG, and this build reads no other pictures".into()),
    }
}

/// Checks a size before memory is taken for it.
fn check(size: [u32; 2]) -> Result<(), String> {
    let [width, height] = size;
    let is_in_range = (0..2).all(|k| size[k] <= MOST_SIZE[k]);
    let [most_width, most_height] = MOST_SIZE;
    let too_large =
        || format!("is {width} by {height} pixels; {most_width} by {most_height} are the most: scale it down");
    if is_in_range { Ok(()) } else { Err(too_large()) }
}

fn broken(error: &dyn std::fmt::Display) -> String {
    format!("cannot be read as a picture: {error}")
}

fn of_png(bytes: &[u8]) -> Result<Light, String> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|error| broken(&error))?;
    let size = [reader.info().width, reader.info().height];
    check(size)?;
    let length = reader.output_buffer_size().ok_or("is too large")?;
    let mut buffer = vec![0; length];
    let info = reader.next_frame(&mut buffer).map_err(|error| broken(&error))?;
    let samples: Vec<f64> = match info.bit_depth {
        png::BitDepth::Sixteen => {
            buffer.as_chunks().0.iter().map(|two| f64::from(u16::from_be_bytes(*two)) / 65535.0).collect()
        }
        _ => buffer.iter().map(|byte| f64::from(*byte) / 255.0).collect(),
    };
    let count = info.color_type.samples();
    let pixel = |samples: &[f64]| {
        let of = |k: usize| linear(samples[if count > 2 { k } else { 0 }]) as f32;
        [of(0), of(1), of(2)]
    };
    Ok(Light { size, pixels: samples.chunks_exact(count).map(pixel).collect() })
}

#[cfg(feature = "formats")]
fn of_image(bytes: &[u8], format: image::ImageFormat) -> Result<Light, String> {
    let reader = || {
        let mut reader = image::ImageReader::with_format(Cursor::new(bytes), format);
        reader.no_limits();
        reader
    };
    let size = reader().into_dimensions().map_err(|error| broken(&error))?.into();
    check(size)?;
    let pixels = reader().decode().map_err(|error| broken(&error))?.into_rgb32f();
    let is_linear = format == image::ImageFormat::Hdr;
    let of = |part: f32| if is_linear { part } else { linear(f64::from(part)) as f32 };
    Ok(Light { size, pixels: pixels.pixels().map(|pixel| pixel.0.map(of)).collect() })
}

#[cfg(feature = "formats")]
fn of_exr(bytes: &[u8]) -> Result<Light, String> {
    use exr::prelude::{ReadChannels, ReadLayers, read};
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|error| broken(&error))?;
    for header in &meta.headers {
        let of = |edge: usize| u32::try_from(edge).unwrap_or(u32::MAX);
        check([of(header.layer_size.width()), of(header.layer_size.height())])?;
    }
    let make = |size: exr::math::Vec2<usize>, _: &_| (size.width(), vec![[0.0_f32; 3]; size.area()]);
    let set = |(width, pixels): &mut (usize, Vec<[f32; 3]>), at: exr::math::Vec2<usize>, rgba: (f32, f32, f32, f32)| {
        pixels[at.y() * *width + at.x()] = [rgba.0, rgba.1, rgba.2];
    };
    let reader = read().no_deep_data().largest_resolution_level().rgba_channels(make, set);
    let picture = reader.first_valid_layer().all_attributes().from_buffered(Cursor::new(bytes));
    let picture = picture.map_err(|error| broken(&error))?;
    let (width, pixels) = picture.layer_data.channel_data.pixels;
    let height = pixels.len() / width.max(1);
    Ok(Light { size: [width as u32, height as u32], pixels })
}
