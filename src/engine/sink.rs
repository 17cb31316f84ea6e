//! Where rows go.

use std::io;

use crate::film::{Image, Layer, Layers, PictureFile, Pictures, PngFile, Radiance, Rows, Shutter};

/// Takes the rows of a picture from the top, some whole rows at a time.
pub trait Sink: Send {
    /// What it wants of each pixel. What a kernel of its own finds out has to be in the request, too ([`Request::layers`](super::Request::layers)).
    fn layers(&self) -> Layers {
        Layers::SRGB
    }

    /// Most rows that it wants at a time, for sinks that keep them; as many as suit the back end without it.
    fn most_rows(&self) -> Option<u32> {
        None
    }

    /// Is told the back end of the next rows, in words: what they follow from besides the job. Comes before the first of them, and
    /// where another one takes over.
    fn begin(&mut self, _backend: &str) {}

    /// Takes the next rows.
    ///
    /// Errors end the render, which then has [`Error::Sink`](super::Error::Sink).
    fn push(&mut self, rows: Rows) -> io::Result<()>;
}

impl Sink for Image {
    fn push(&mut self, mut rows: Rows) -> io::Result<()> {
        self.rgb.append(&mut rows.srgb);
        Ok(())
    }
}

impl Sink for Radiance {
    fn layers(&self) -> Layers {
        Layers::SRGB.and(Layer::Radiance)
    }

    fn push(&mut self, mut rows: Rows) -> io::Result<()> {
        self.rgb.append(&mut rows.radiance);
        Ok(())
    }
}

impl Sink for PngFile {
    /// [`PngFile::finish`] has the cause of an error.
    fn push(&mut self, rows: Rows) -> io::Result<()> {
        match PngFile::push(self, rows.srgb) {
            true => Ok(()),
            false => Err(io::Error::other("the file takes no more rows")),
        }
    }
}

impl Sink for PictureFile {
    fn layers(&self) -> Layers {
        self.wanted()
    }

    /// [`PictureFile::finish`] has the cause of an error.
    fn push(&mut self, rows: Rows) -> io::Result<()> {
        PictureFile::push(self, &rows)
    }
}

impl Sink for Pictures {
    fn layers(&self) -> Layers {
        self.wanted()
    }

    /// [`Pictures::finish`] has the cause of an error.
    fn push(&mut self, rows: Rows) -> io::Result<()> {
        Pictures::push(self, &rows)
    }
}

impl Sink for Shutter {
    fn layers(&self) -> Layers {
        self.wanted()
    }

    fn push(&mut self, rows: Rows) -> io::Result<()> {
        Shutter::push(self, rows);
        Ok(())
    }
}

/// A function that takes rows.
impl<F: FnMut(Rows) -> io::Result<()> + Send> Sink for F {
    fn push(&mut self, rows: Rows) -> io::Result<()> {
        self(rows)
    }
}
