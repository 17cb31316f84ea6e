//! JPEG: bytes, with losses that are hard to see. Quality 92.

use std::io::{self, Read, Seek, SeekFrom};

use image::codecs::jpeg::{JpegEncoder, PixelDensity};
use image::{ExtendedColorType, ImageEncoder};

use super::{MOST_COMMENT, Whole};

/// From 1 to 100.
const QUALITY: u8 = 92;
/// Most bytes of a comment, which may be one of several.
const MOST: usize = 65_000;

pub(super) fn encode(picture: Whole) -> io::Result<Vec<u8>> {
    let size = picture.form.size;
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
    if let Some(dpi) = picture.form.dpi {
        encoder.set_pixel_density(PixelDensity::dpi(dpi.round().clamp(1.0, f64::from(u16::MAX)) as u16));
    }
    let samples = picture.bytes();
    if let Some(profile) = picture.profile {
        encoder.set_icc_profile(profile).map_err(io::Error::other)?;
    }
    encoder.encode(&samples, size.width, size.height, ExtendedColorType::Rgb8).map_err(io::Error::other)?;
    // Behind the first segment, which has to be JFIF's.
    let first = 4 + bytes.get(4..6).map_or(0, |length| usize::from(u16::from_be_bytes([length[0], length[1]])));
    let (head, rest) = bytes.split_at(first.min(bytes.len()));
    let mut whole = head.to_vec();
    for piece in picture.comment.as_bytes().chunks(MOST) {
        whole.extend_from_slice(&[0xff, 0xfe]);
        whole.extend_from_slice(&(piece.len() as u16 + 2).to_be_bytes());
        whole.extend_from_slice(piece);
    }
    whole.extend_from_slice(rest);
    Ok(whole)
}

/// All comments in front of the picture, joined.
pub(in super::super) fn comment<R: Read + Seek>(file: &mut R) -> Result<String, String> {
    let broken = |error: io::Error| format!("it is no whole JPEG ({error})");
    let mut comment = Vec::new();
    file.seek(SeekFrom::Start(2)).map_err(broken)?;
    let mut head = [0; 4];
    loop {
        file.read_exact(&mut head).map_err(broken)?;
        let length = u16::from_be_bytes([head[2], head[3]]);
        let Some(inner) = length.checked_sub(2).filter(|_| head[0] == 0xff) else {
            return Err("it is no whole JPEG (a segment is damaged)".into());
        };
        match head[1] {
            // The data begin.
            0xda => return Ok(String::from_utf8_lossy(&comment).into_owned()),
            0xfe if (comment.len() as u64) < MOST_COMMENT => {
                let mut piece = vec![0; usize::from(inner)];
                file.read_exact(&mut piece).map_err(broken)?;
                comment.extend(piece);
            }
            _ => drop(file.seek(SeekFrom::Current(i64::from(inner))).map_err(broken)?),
        }
    }
}
