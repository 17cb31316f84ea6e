//! Radiance HDR: light in three bytes and a common exponent, which holds it to about 1 %.

use std::io::{self, BufRead, BufReader, Read, Seek};

use image::Rgb;
use image::codecs::hdr::HdrEncoder;

use super::super::layers::Layer;
use super::{MOST_COMMENT, Whole};

/// How files begin.
const MAGIC: &str = "#?RADIANCE\n";

pub(super) fn encode(picture: &Whole) -> io::Result<Vec<u8>> {
    let light = picture.layer(Layer::Radiance);
    let pixels: Vec<Rgb<f32>> =
        light.chunks_exact(3).map(|c| Rgb([c[0].max(0.0), c[1].max(0.0), c[2].max(0.0)])).collect();
    let mut bytes = Vec::new();
    let size = picture.form.size;
    let encoder = HdrEncoder::new(&mut bytes);
    encoder.encode(&pixels, size.width as usize, size.height as usize).map_err(io::Error::other)?;
    let rest = bytes.strip_prefix(MAGIC.as_bytes()).ok_or_else(|| io::Error::other("the file begins oddly"))?;
    let comment = format!("{MAGIC}# {}\n", picture.comment);
    Ok([comment.as_bytes(), rest].concat())
}

pub(in super::super) fn comment<R: Read + Seek>(file: &mut R) -> Result<String, String> {
    let mut head = BufReader::new(file.by_ref().take(MOST_COMMENT));
    let mut comment = String::new();
    loop {
        let mut line = Vec::new();
        let length = head.read_until(b'\n', &mut line).map_err(|error| error.to_string())?;
        let line = String::from_utf8_lossy(&line);
        match line.strip_prefix('#') {
            Some(text) => comment.push_str(text),
            None if length == 0 || line.trim().is_empty() => return Ok(comment),
            None => {}
        }
    }
}
