//! PNG files, written row by row while the picture is still being made.

use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::icc::CODE_POINTS;
use super::recipe::{KEY, png_chunk};
use crate::files::{Output, Target};
use crate::graph::Encoding;
use crate::shade::Size;

/// Bytes of a chunk of compressed data.
const CHUNK: usize = 1 << 18;
/// Inches of a metre.
const INCHES: f64 = 1.0 / 0.0254;

/// What a PNG file holds.
#[derive(Clone, PartialEq, Debug)]
pub struct PngForm {
    /// Columns and rows.
    pub size: Size,
    /// Whether pixels have four numbers, of which the last is the coverage, or three.
    pub alpha: bool,
    /// Whether numbers have two bytes, the higher first, or one.
    pub is_deep: bool,
    /// Pixels an inch, where printers are told.
    pub dpi: Option<f64>,
    /// The colour space; the file names those that are not sRGB.
    pub encoding: Encoding,
    /// The key of the picture's job.
    pub key: Option<String>,
}

impl PngForm {
    /// Bytes of sRGB, and nothing else.
    pub fn plain(size: Size) -> PngForm {
        PngForm { size, alpha: false, is_deep: false, dpi: None, encoding: Encoding::Srgb, key: None }
    }

    /// Bytes of a pixel.
    fn bytes(&self) -> usize {
        (3 + usize::from(self.alpha)) << usize::from(self.is_deep)
    }
}

/// What the writing thread is told.
enum Message {
    Rows(Vec<u8>),
    Recipe(String),
}

/// A PNG file that takes rows from the top and compresses them on a thread of its own. Until [`PngFile::finish`] none of it
/// is seen under the target's name, so that a good picture is never replaced by a part of one.
///
/// The bytes depend on the picture alone, and not on how many rows come at a time. Memory: three times what is pushed at once.
pub struct PngFile {
    messages: Option<SyncSender<Message>>,
    writer: Option<JoinHandle<io::Result<(Output, Duration)>>>,
}

impl PngFile {
    /// A picture at a path. Nothing is written before there are rows.
    pub fn new(path: &Path, size: Size) -> PngFile {
        PngFile::start(Target::of(path), PngForm::plain(size))
    }

    /// A picture at a target that has been looked at.
    pub fn at(target: &Target, form: PngForm) -> PngFile {
        PngFile::start(Ok(target.clone()), form)
    }

    fn start(target: io::Result<Target>, form: PngForm) -> PngFile {
        let (messages, received) = sync_channel(1);
        let writer = std::thread::spawn(move || write_rows(&target?, &form, &received));
        PngFile { messages: Some(messages), writer: Some(writer) }
    }

    /// Takes some more rows, as the form says. Returns false if nothing can be written any more;
    /// [`PngFile::finish`] then has the error.
    pub fn push(&mut self, rows: Vec<u8>) -> bool {
        self.messages.as_ref().is_some_and(|sender| sender.send(Message::Rows(rows)).is_ok())
    }

    /// Says how the picture was made, after some of its rows. Returns false as [`PngFile::push`] does.
    pub fn tell(&mut self, recipe: &str) -> bool {
        self.messages.as_ref().is_some_and(|sender| sender.send(Message::Recipe(recipe.to_string())).is_ok())
    }

    /// Waits for the last rows and gives the file its name. Returns the time that compressing and writing took.
    ///
    /// Errors: whatever the system says, and too few rows; the target is then what it was.
    pub fn finish(mut self) -> io::Result<Duration> {
        let (output, took) = self.close()?;
        output.commit()?;
        Ok(took)
    }

    fn close(&mut self) -> io::Result<(Output, Duration)> {
        self.messages = None;
        let writer = self.writer.take().ok_or_else(|| io::Error::other("the file is closed"))?;
        writer.join().unwrap_or_else(|_| Err(io::Error::other("the writing thread broke off")))
    }
}

impl Drop for PngFile {
    /// Waits for the thread: what was written of a picture that was never finished is gone then.
    fn drop(&mut self) {
        let _ = self.close();
    }
}

fn write_rows(target: &Target, form: &PngForm, messages: &Receiver<Message>) -> io::Result<(Output, Duration)> {
    let few = || io::Error::other("the picture has too few rows");
    let first = messages.recv().map_err(|_| few())?;
    let mut took = Duration::ZERO;
    let mut file = BufWriter::with_capacity(CHUNK, Output::new(target)?);
    let mut encoder = header(&mut file, form)?;
    let mut stream = encoder.stream_writer_with_size(CHUNK)?;
    let mut left = form.size.width as usize * form.size.height as usize * form.bytes();
    let mut recipe = None;
    for message in std::iter::once(first).chain(messages) {
        let start = Instant::now();
        match message {
            Message::Rows(bytes) => {
                left =
                    left.checked_sub(bytes.len()).ok_or_else(|| io::Error::other("the picture has too many rows"))?;
                stream.write_all(&bytes)?;
            }
            Message::Recipe(text) => recipe = Some(text),
        }
        took += start.elapsed();
    }
    if left > 0 {
        return Err(few());
    }
    let start = Instant::now();
    stream.finish()?;
    if let Some(recipe) = recipe {
        encoder.write_chunk(png::chunk::iTXt, &png_chunk(&recipe)?)?;
    }
    encoder.finish()?;
    let output = file.into_inner().map_err(io::IntoInnerError::into_error)?;
    Ok((output, took + start.elapsed()))
}

/// Writes what stands before the pixels.
fn header<W: Write>(file: W, form: &PngForm) -> io::Result<png::Writer<W>> {
    let mut encoder = png::Encoder::new(file, form.size.width, form.size.height);
    encoder.set_color(if form.alpha { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_depth(if form.is_deep { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
    encoder.set_compression(png::Compression::Fast);
    if let Some(dpi) = form.dpi {
        let pixels = (dpi * INCHES).round().clamp(1.0, f64::from(u32::MAX)) as u32;
        let unit = png::Unit::Meter;
        encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: pixels, yppu: pixels, unit }));
    }
    if let Some(key) = &form.key {
        encoder.add_text_chunk(KEY.into(), key.clone())?;
    }
    let mut writer = encoder.write_header()?;
    if form.encoding == Encoding::P3 {
        writer.write_chunk(png::chunk::ChunkType(*b"cICP"), &CODE_POINTS)?;
    }
    Ok(writer)
}
