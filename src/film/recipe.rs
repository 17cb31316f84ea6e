//! What pictures say of how they were made: the key of their job, and the job itself as text.
//!
//! The text is compressed. PNG has a chunk for it (`iTXt`); other formats hold a line of words, `bulbfold-job=KEY
//! bulbfold-recipe=BASE64`, where they hold comments. Files are read up to limits, since they come from anywhere.

use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

use crate::files::{Chosen, open_file};

/// What names the key of a picture's job.
pub(super) const KEY: &str = "bulbfold-job";
/// What names its recipe.
pub(super) const RECIPE: &str = "bulbfold-recipe";
/// Longest recipe, in bytes.
const MOST: u64 = 8 << 20;
/// Longest compressed recipe that is read, in bytes.
const MOST_PACKED: usize = 4 << 20;

/// What a picture says of how it was made.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Made {
    /// The key of its job: equal where pictures are.
    pub key: Option<String>,
    /// The recipe: a job as JSON. At most 8 MiB.
    pub recipe: Option<String>,
}

/// Formats that can tell, by how their files begin.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Magic {
    Png,
    #[cfg(feature = "formats")]
    Exr,
    #[cfg(feature = "formats")]
    Jpeg,
    #[cfg(feature = "formats")]
    WebP,
    #[cfg(feature = "formats")]
    Tiff,
    #[cfg(feature = "formats")]
    Hdr,
}

/// Bytes that are read to know a format.
const LEAST: usize = 12;

impl Magic {
    fn of(head: &[u8]) -> Option<Magic> {
        match head {
            [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => Some(Magic::Png),
            #[cfg(feature = "formats")]
            [0x76, 0x2f, 0x31, 0x01, ..] => Some(Magic::Exr),
            #[cfg(feature = "formats")]
            [0xff, 0xd8, 0xff, ..] => Some(Magic::Jpeg),
            #[cfg(feature = "formats")]
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some(Magic::WebP),
            #[cfg(feature = "formats")]
            [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => Some(Magic::Tiff),
            #[cfg(feature = "formats")]
            [b'#', b'?', b'R', b'A', b'D', b'I', b'A', b'N', b'C', b'E', ..] => Some(Magic::Hdr),
            _ => None,
        }
    }
}

/// Whether a file begins as a picture does.
pub fn is_picture(path: &Path) -> bool {
    let mut head = [0; LEAST];
    open_file(path, Chosen::Found).and_then(|mut file| file.read_exact(&mut head)).is_ok() && Magic::of(&head).is_some()
}

/// What a picture's file says of how it was made.
///
/// Errors: what the system says; a file that is no picture, or is damaged where it says so; as the end of a sentence that begins
/// with its name.
pub fn read_made(path: &Path) -> Result<Made, String> {
    let file = open_file(path, Chosen::Found).map_err(|error| error.to_string())?;
    read_made_from(&mut BufReader::new(file))
}

/// The same of bytes.
pub fn read_made_bytes(bytes: &[u8]) -> Result<Made, String> {
    read_made_from(&mut io::Cursor::new(bytes))
}

fn read_made_from<R: Read + Seek>(file: &mut R) -> Result<Made, String> {
    let mut head = [0; LEAST];
    let length = read_up_to(file, &mut head).map_err(|error| error.to_string())?;
    file.rewind().map_err(|error| error.to_string())?;
    let magic = Magic::of(&head[..length]).ok_or("it is no picture that is known here")?;
    match magic {
        Magic::Png => of_png(file),
        #[cfg(feature = "formats")]
        Magic::Exr => super::formats::exr::comment(file).and_then(|text| of_words(&text)),
        #[cfg(feature = "formats")]
        Magic::Jpeg => super::formats::jpeg::comment(file).and_then(|text| of_words(&text)),
        #[cfg(feature = "formats")]
        Magic::WebP => super::formats::webp::comment(file).and_then(|text| of_words(&text)),
        #[cfg(feature = "formats")]
        Magic::Tiff => super::formats::tiff::comment(file).and_then(|text| of_words(&text)),
        #[cfg(feature = "formats")]
        Magic::Hdr => super::formats::hdr::comment(file).and_then(|text| of_words(&text)),
    }
}

/// Reads as much as there is.
fn read_up_to(file: &mut impl Read, into: &mut [u8]) -> io::Result<usize> {
    let mut length = 0;
    while length < into.len() {
        match file.read(&mut into[length..])? {
            0 => break,
            more => length += more,
        }
    }
    Ok(length)
}

/// Chunks of a PNG, up to its end; only texts are read, others are passed over.
fn of_png<R: Read + Seek>(file: &mut R) -> Result<Made, String> {
    let broken = |error: io::Error| format!("it is no whole PNG ({error})");
    let mut made = Made::default();
    file.seek(SeekFrom::Start(8)).map_err(broken)?;
    let mut head = [0; 8];
    loop {
        file.read_exact(&mut head).map_err(broken)?;
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]);
        match &head[4..] {
            b"IEND" => return Ok(made),
            b"tEXt" | b"iTXt" if length as usize <= MOST_PACKED => {
                let mut data = vec![0; length as usize];
                file.read_exact(&mut data).map_err(broken)?;
                take_text(&head[4..], &data, &mut made)?;
                file.seek(SeekFrom::Current(4)).map_err(broken)?;
            }
            _ => drop(file.seek(SeekFrom::Current(i64::from(length) + 4)).map_err(broken)?),
        }
    }
}

/// Takes a text chunk of ours.
fn take_text(kind: &[u8], data: &[u8], made: &mut Made) -> Result<(), String> {
    let Some(end) = data.iter().position(|byte| *byte == 0) else { return Ok(()) };
    let (name, text) = (&data[..end], &data[end + 1..]);
    if kind == b"tEXt" && name == KEY.as_bytes() {
        made.key = key_of(text);
    }
    // Compressed, by zlib, of no language.
    if let (b"iTXt", true, [1, 0, 0, 0, packed @ ..]) = (kind, name == RECIPE.as_bytes(), text) {
        made.recipe = Some(unpacked(packed)?);
    }
    Ok(())
}

/// A key, which has hexadecimal digits alone.
fn key_of(text: &[u8]) -> Option<String> {
    let is_key = text.len() <= 64 && text.iter().all(u8::is_ascii_hexdigit);
    is_key.then(|| String::from_utf8_lossy(text).into_owned())
}

/// The data of the chunk that holds a recipe.
pub(super) fn png_chunk(recipe: &str) -> io::Result<Vec<u8>> {
    let mut data = RECIPE.as_bytes().to_vec();
    data.extend_from_slice(&[0, 1, 0, 0, 0]);
    data.extend(packed(recipe)?);
    Ok(data)
}

/// A text, compressed. The same bytes for the same text.
fn packed(text: &str) -> io::Result<Vec<u8>> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(text.as_bytes())?;
    encoder.finish()
}

fn unpacked(packed: &[u8]) -> Result<String, String> {
    let mut bytes = Vec::new();
    let length = flate2::read::ZlibDecoder::new(packed).take(MOST + 1).read_to_end(&mut bytes);
    let length = length.map_err(|error| format!("its recipe is damaged ({error})"))?;
    if length as u64 > MOST {
        return Err(format!("its recipe is larger than {MOST} bytes"));
    }
    String::from_utf8(bytes).map_err(|_| "its recipe is no text".into())
}

/// What formats with one comment hold: words, and nothing where nothing is known.
#[cfg(feature = "formats")]
pub(super) fn words(made: &Made) -> io::Result<String> {
    use base64::Engine;
    let mut words = vec![format!("Bulbfold {}", env!("CARGO_PKG_VERSION"))];
    words.extend(made.key.as_ref().map(|key| format!("{KEY}={key}")));
    if let Some(recipe) = &made.recipe {
        words.push(format!("{RECIPE}={}", base64::engine::general_purpose::STANDARD_NO_PAD.encode(packed(recipe)?)));
    }
    Ok(words.join(" "))
}

/// Reads [`words`] out of a comment.
#[cfg(feature = "formats")]
fn of_words(comment: &str) -> Result<Made, String> {
    use base64::Engine;
    let mut made = Made::default();
    for word in comment.split([' ', '\n', '"', '<']) {
        if let Some(key) = word.strip_prefix(KEY).and_then(|rest| rest.strip_prefix('=')) {
            made.key = key_of(key.as_bytes());
        }
        if let Some(text) = word.strip_prefix(RECIPE).and_then(|rest| rest.strip_prefix('=')) {
            if text.len() > MOST_PACKED {
                return Err("its recipe is too long".into());
            }
            let packed = base64::engine::general_purpose::STANDARD_NO_PAD.decode(text);
            made.recipe = Some(unpacked(&packed.map_err(|_| "its recipe is damaged")?)?);
        }
    }
    Ok(made)
}
