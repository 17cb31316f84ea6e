//! WebP: bytes, losslessly compressed. The comment is XMP.

use std::io::{self, Read, Seek, SeekFrom};

use image_webp::{ColorType, WebPEncoder};

use super::{MOST_COMMENT, Whole};

/// What is around the comment.
const XMP: [&str; 2] = [
    "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\"><rdf:Description \
     rdf:about=\"\" xmlns:dc=\"http://purl.org/dc/elements/1.1/\"><dc:description><rdf:Alt><rdf:li xml:lang=\"x-default\"> ",
    "</rdf:li></rdf:Alt></dc:description></rdf:Description></rdf:RDF></x:xmpmeta>",
];

pub(super) fn encode(picture: Whole) -> io::Result<Vec<u8>> {
    let size = picture.form.size;
    let samples = picture.bytes();
    let mut bytes = Vec::new();
    let mut encoder = WebPEncoder::new(&mut bytes);
    if let Some(profile) = picture.profile {
        encoder.set_icc_profile(profile);
    }
    encoder.set_xmp_metadata([XMP[0], picture.comment, XMP[1]].concat().into_bytes());
    let colours = if picture.form.transparent { ColorType::Rgba8 } else { ColorType::Rgb8 };
    encoder.encode(&samples, size.width, size.height, colours).map_err(io::Error::other)?;
    Ok(bytes)
}

pub(in super::super) fn comment<R: Read + Seek>(file: &mut R) -> Result<String, String> {
    let broken = |error: io::Error| format!("it is no whole WebP ({error})");
    file.seek(SeekFrom::Start(12)).map_err(broken)?;
    let mut head = [0; 8];
    loop {
        match file.read_exact(&mut head) {
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(String::new()),
            other => other.map_err(broken)?,
        }
        let length = u64::from(u32::from_le_bytes([head[4], head[5], head[6], head[7]]));
        if &head[..4] == b"XMP " && length <= MOST_COMMENT {
            let mut text = vec![0; length as usize];
            file.read_exact(&mut text).map_err(broken)?;
            return Ok(String::from_utf8_lossy(&text).into_owned());
        }
        file.seek(SeekFrom::Current((length + length % 2) as i64)).map_err(broken)?;
    }
}
