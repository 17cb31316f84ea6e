//! `bulbfold render --resume`: rows of a picture that outlive a render which is stopped.

use std::io;
use std::path::PathBuf;

use bulbfold::engine::Sink;
use bulbfold::files::Pieces;
use bulbfold::film::{Layers, PictureFile, Pictures, Rows};

use super::output::cannot_write;
use super::session::talk;
use super::{Failure, usage};

/// Rows that are kept together: few, so that little is lost.
const BAND: u32 = 32;

/// The files of a picture, and the finished rows beside the first of them where they are to outlive the render.
pub struct Kept {
    /// The files.
    pub files: Pictures,
    part: Option<(Pieces, PathBuf)>,
    /// Rows that are there already.
    pub first: u32,
}

impl Kept {
    /// The files alone.
    pub fn without(files: Pictures) -> Kept {
        Kept { files, part: None, first: 0 }
    }

    /// The files with what an earlier render of the same picture has left.
    pub fn resumed(files: Pictures, (key, width): (&str, u32)) -> Result<Kept, Failure> {
        let Some(target) = files.0.first().map(PictureFile::target).filter(|target| !target.is_stream()) else {
            return Err(usage(
                "what went into a pipe cannot be resumed",
                "drop --resume, or name a file first: -o FILE",
            ));
        };
        let mut name = target.path().as_os_str().to_os_string();
        name.push(".part");
        let path = PathBuf::from(name);
        let failed = |error: io::Error| cannot_write(&path, &error);
        let layers: Vec<_> = files.wanted().iter().map(|layer| layer.name()).collect();
        let head = format!("bulbfold part 1 {key} {}\n", layers.join(","));
        let (pieces, was_other) = Pieces::open(&path, head.as_bytes()).map_err(failed)?;
        if was_other {
            talk(&format!("{} was of another picture and is begun anew", path.display()));
        }
        let mut kept = Kept { files, part: None, first: 0 };
        let pieces = kept.replay(pieces, width).map_err(failed)?;
        kept.part = Some((pieces, path));
        Ok(kept)
    }

    /// Gives the files the rows that are there.
    fn replay(&mut self, mut pieces: Pieces, width: u32) -> io::Result<Pieces> {
        let layers = self.files.wanted();
        while let Some(piece) = pieces.next_piece()? {
            let damaged = || io::Error::other("it is damaged: remove it");
            let rows = Rows::from_bytes(&piece, layers).ok_or_else(damaged)?;
            self.first += (rows.srgb.len() / 3 / width.max(1) as usize) as u32;
            self.files.push(&rows)?;
        }
        Ok(pieces)
    }

    /// Removes what was kept: the picture is whole.
    pub fn remove(part: Option<(Pieces, PathBuf)>) -> Result<(), Failure> {
        match part {
            None => Ok(()),
            Some((pieces, path)) => pieces.remove().map_err(|error| cannot_write(&path, &error)),
        }
    }

    /// The files, and what was kept beside them.
    pub fn split(self) -> (Pictures, Option<(Pieces, PathBuf)>) {
        (self.files, self.part)
    }
}

impl Sink for Kept {
    fn layers(&self) -> Layers {
        self.files.wanted()
    }

    fn most_rows(&self) -> Option<u32> {
        self.part.as_ref().map(|_| BAND)
    }

    fn push(&mut self, rows: Rows) -> io::Result<()> {
        if let Some((pieces, _)) = &mut self.part {
            pieces.push(&rows.to_bytes())?;
        }
        self.files.push(&rows)
    }
}
