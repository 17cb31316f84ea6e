//! The files of parts: pieces of rows, behind a line that says of which bundle they are.

use std::io;
use std::path::Path;

use bulbfold::engine::{Job, Sink};
use bulbfold::files::{Pieces, PiecesReader};
use bulbfold::film::{Layer, Layers, LightSum, Rows};

use super::bundle::{Bundle, PROGRAM};

/// Rows that are kept together: few, so that little is lost. Those of pictures of paths take longer.
const ROWS: [u32; 2] = [32, 8];
/// Pixels that a GPU has to do at the same time.
const GPU_PIECE: u32 = 1 << 18;

/// What a piece of a part is: its first byte.
mod tag {
    /// The back end of the rows behind it, in words.
    pub const BACKEND: u8 = 0;
    /// Rows.
    pub const ROWS: u8 = 1;
    /// The sums of rows' samples.
    pub const SUMS: u8 = 2;
    /// The end, with the number of rows before it.
    pub const END: u8 = 3;
}

/// A piece of a part.
pub enum Piece {
    /// The back end of the rows behind it.
    Backend(String),
    /// Rows.
    Rows(Rows),
    /// The sums of their samples.
    Sums(Vec<LightSum>),
    /// How many rows there are.
    End(u32),
}

impl Piece {
    /// The piece of these bytes; nothing of bytes that are none.
    fn read(bytes: &[u8], layers: Layers) -> Option<Piece> {
        let (&tag, rest) = bytes.split_first()?;
        match tag {
            tag::BACKEND => String::from_utf8(rest.to_vec()).ok().map(Piece::Backend),
            tag::ROWS => Rows::from_bytes(rest, layers).map(Piece::Rows),
            tag::SUMS => {
                let (mut left, mut sums) = (rest, Vec::new());
                while !left.is_empty() {
                    sums.push(LightSum::read(&mut left)?);
                }
                Some(Piece::Sums(sums))
            }
            tag::END => rest.try_into().ok().map(u32::from_le_bytes).map(Piece::End),
            _ => None,
        }
    }

    /// Rows of this width.
    pub fn rows(&self, width: u32) -> u32 {
        let pixels = match self {
            Piece::Rows(rows) => rows.srgb.len() / 3,
            Piece::Sums(sums) => sums.len(),
            _ => 0,
        };
        (pixels / width.max(1) as usize) as u32
    }
}

/// What parts of a job's pictures hold of each pixel.
pub fn layers_of(data: Layers) -> Layers {
    data.or(Layers::SRGB).and(Layer::Radiance)
}

/// A part that is being rendered: what is there of it, and what is added.
pub struct Unfinished {
    pieces: Pieces,
    layers: Layers,
    width: u32,
    /// Rows of a piece on a CPU.
    band: u32,
    /// The last back end of the file, and that of the rows that come next.
    backends: [Option<String>; 2],
    /// Rows that are there.
    pub rows: u32,
}

impl Unfinished {
    /// Opens what an earlier run has left of a part of this job; true says that it was of another bundle and is begun anew.
    ///
    /// Errors: what the system says; another process that has it.
    pub fn open(path: &Path, head: &str, job: &Job) -> io::Result<(Unfinished, bool)> {
        let (layers, width) = (layers_of(job.request.layers), job.size().width);
        let band = ROWS[usize::from(job.request.path.is_some())];
        let (pieces, was_other) = Pieces::open(path, format!("{head}\n").as_bytes())?;
        let mut part = Unfinished { pieces, layers, width, band, backends: [None, None], rows: 0 };
        while let Some(bytes) = part.pieces.next_piece()? {
            match Piece::read(&bytes, layers) {
                Some(Piece::Backend(name)) => part.backends = [Some(name.clone()), Some(name)],
                Some(Piece::End(_)) => {}
                Some(piece) => part.rows += piece.rows(width),
                None => return Err(io::Error::other("it is damaged: remove it")),
            }
        }
        Ok((part, was_other))
    }

    fn add(&mut self, tag: u8, bytes: &[u8]) -> io::Result<()> {
        self.pieces.push(&[&[tag], bytes].concat())
    }

    /// Gives the part its name.
    pub fn finish(mut self, path: &Path) -> io::Result<()> {
        self.add(tag::END, &self.rows.to_le_bytes())?;
        self.pieces.rename(path)
    }
}

impl Sink for Unfinished {
    fn layers(&self) -> Layers {
        self.layers
    }

    fn most_rows(&self) -> Option<u32> {
        let is_gpu = self.backends[1].as_ref().is_some_and(|name| name.starts_with("gpu"));
        Some(if is_gpu { self.band.max(GPU_PIECE / self.width.max(1)) } else { self.band })
    }

    fn begin(&mut self, backend: &str) {
        self.backends[1] = Some(backend.to_string());
    }

    fn push(&mut self, rows: Rows) -> io::Result<()> {
        if self.backends[0] != self.backends[1] {
            let name = self.backends[1].clone();
            self.add(tag::BACKEND, name.as_deref().unwrap_or_default().as_bytes())?;
            self.backends[0] = name;
        }
        self.rows += (rows.srgb.len() / 3) as u32 / self.width.max(1);
        if rows.sums.is_empty() {
            return self.add(tag::ROWS, &rows.to_bytes());
        }
        let mut bytes = Vec::new();
        rows.sums.iter().for_each(|sum| sum.write(&mut bytes));
        self.add(tag::SUMS, &bytes)
    }
}

/// Reads a part from its front.
pub struct PartReader {
    pieces: PiecesReader,
    layers: Layers,
}

impl PartReader {
    /// Opens a part of a bundle.
    ///
    /// Errors: why it is none.
    pub fn open(bundle: &Bundle, number: u32, layers: Layers) -> Result<PartReader, String> {
        let opened = PiecesReader::open(&bundle.part(number));
        let (pieces, head) = opened.map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => "is missing".to_string(),
            _ => format!("cannot be read: {error}"),
        })?;
        match head == bundle.head(number) {
            true => Ok(PartReader { pieces, layers }),
            false => Err(why_other(&head, &bundle.head(number))),
        }
    }

    /// The next piece; nothing at the end.
    pub fn piece(&mut self) -> Result<Option<Piece>, String> {
        let bytes = self.pieces.next_piece().map_err(|error| format!("is broken: {error}"))?;
        let read = |bytes: Vec<u8>| Piece::read(&bytes, self.layers).ok_or_else(|| "is broken".to_string());
        bytes.map(read).transpose()
    }

    /// Whether all is there, of this many rows; gives the back ends that made it.
    pub fn check(mut self, width: u32, rows: u32) -> Result<Vec<String>, String> {
        let (mut backends, mut found, mut end) = (Vec::new(), 0, None);
        while let Some(piece) = self.piece()? {
            match piece {
                Piece::Backend(name) => backends.push(name),
                Piece::End(count) => end = Some(count),
                piece => found += piece.rows(width),
            }
        }
        match end == Some(rows) && found == rows {
            true => Ok(backends),
            false => Err("is broken: it is cut off".to_string()),
        }
    }
}

/// Why a part that begins with this line is none of a bundle whose part begins with that one.
fn why_other(found: &str, own: &str) -> String {
    let words = |line: &str| line.split(' ').map(str::to_string).collect::<Vec<String>>();
    match (&words(found)[..], &words(own)[..]) {
        ([.., version, program, _, _], [.., own, _, _, _]) if version != own || program != PROGRAM => {
            format!("was made by bulbfold {program}, and this is {PROGRAM}")
        }
        ([.., hash, _], [.., own, _]) if hash != own => "is of another job".to_string(),
        ([.., number], _) => format!("is part {number}, under another name"),
        _ => "is something else".to_string(),
    }
}
