//! Where rows go.

use std::io;

use crate::film::{Image, PngFile};

/// Takes the rows of a picture from the top, three bytes of sRGB a pixel, some whole rows at a time.
pub trait Sink: Send {
    /// Takes the next rows.
    ///
    /// Errors end the render, which then has [`Error::Sink`](super::Error::Sink).
    fn push(&mut self, rows: Vec<u8>) -> io::Result<()>;
}

impl Sink for Image {
    fn push(&mut self, mut rows: Vec<u8>) -> io::Result<()> {
        self.rgb.append(&mut rows);
        Ok(())
    }
}

impl Sink for PngFile {
    /// [`PngFile::finish`] has the cause of an error.
    fn push(&mut self, rows: Vec<u8>) -> io::Result<()> {
        match PngFile::push(self, rows) {
            true => Ok(()),
            false => Err(io::Error::other("the file takes no more rows")),
        }
    }
}

/// A function that takes rows.
impl<F: FnMut(Vec<u8>) -> io::Result<()> + Send> Sink for F {
    fn push(&mut self, rows: Vec<u8>) -> io::Result<()> {
        self(rows)
    }
}
