//! PNG files, written row by row while the picture is still being made.

use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::files::{Output, Target};
use crate::shade::Size;

/// Bytes of a chunk of compressed data.
const CHUNK: usize = 1 << 18;
/// What names the text with the key of a picture's job.
pub(super) const KEYWORD: &str = "bulbfold-job";

/// A PNG file that takes rows from the top and compresses them on a thread of its own. Until [`PngFile::finish`] none of it
/// is seen under the target's name, so that a good picture is never replaced by a part of one.
///
/// The bytes depend on the picture alone, and not on how many rows come at a time. Memory: three times what is pushed at once.
pub struct PngFile {
    rows: Option<SyncSender<Vec<u8>>>,
    writer: Option<JoinHandle<io::Result<(Output, Duration)>>>,
}

impl PngFile {
    /// A picture at a path. Nothing is written before there are rows.
    pub fn new(path: &Path, size: Size) -> PngFile {
        PngFile::start(Target::of(path), size, None)
    }

    /// A picture at a target that has been looked at; it carries the key of its job where there is one.
    pub fn at(target: &Target, size: Size, key: Option<&str>) -> PngFile {
        PngFile::start(Ok(target.clone()), size, key.map(String::from))
    }

    fn start(target: io::Result<Target>, size: Size, key: Option<String>) -> PngFile {
        let (rows, received) = sync_channel(1);
        let writer = std::thread::spawn(move || write_rows(&target?, size, key, &received));
        PngFile { rows: Some(rows), writer: Some(writer) }
    }

    /// Takes some more rows, three bytes of sRGB a pixel. Returns false if nothing can be written any more;
    /// [`PngFile::finish`] then has the error.
    pub fn push(&mut self, rows: Vec<u8>) -> bool {
        self.rows.as_ref().is_some_and(|sender| sender.send(rows).is_ok())
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
        self.rows = None;
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

fn write_rows(
    target: &Target,
    size: Size,
    key: Option<String>,
    rows: &Receiver<Vec<u8>>,
) -> io::Result<(Output, Duration)> {
    let few = || io::Error::other("the picture has too few rows");
    let first = rows.recv().map_err(|_| few())?;
    let mut took = Duration::ZERO;
    let mut file = BufWriter::with_capacity(CHUNK, Output::new(target)?);
    let mut encoder = png::Encoder::new(&mut file, size.width, size.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    if let Some(key) = key {
        encoder.add_text_chunk(KEYWORD.into(), key)?;
    }
    let mut encoder = encoder.write_header()?;
    let mut stream = encoder.stream_writer_with_size(CHUNK)?;
    let mut left = size.width as usize * size.height as usize * 3;
    for bytes in std::iter::once(first).chain(rows) {
        let start = Instant::now();
        left = left.checked_sub(bytes.len()).ok_or_else(|| io::Error::other("the picture has too many rows"))?;
        stream.write_all(&bytes)?;
        took += start.elapsed();
    }
    if left > 0 {
        return Err(few());
    }
    let start = Instant::now();
    stream.finish()?;
    encoder.finish()?;
    let output = file.into_inner().map_err(io::IntoInnerError::into_error)?;
    Ok((output, took + start.elapsed()))
}
