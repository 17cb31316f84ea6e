//! A file that grows piece by piece: work that is to outlive its process.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};

use flate2::Crc;

/// Largest piece, in bytes.
const MOST: u32 = 1 << 30;

/// A file of pieces, each of which is whole or not there: what was being written when the process ended is cut off.
///
/// The file is locked as long as this lives. It stays where it is until [`Pieces::remove`].
pub struct Pieces {
    file: File,
    path: PathBuf,
    /// End of the last whole piece that was read or written.
    end: u64,
    /// Whether there may be more to read.
    reads: bool,
}

impl Pieces {
    /// Opens or makes the file of this path. One that begins otherwise than `head` is begun anew; true says that it was.
    ///
    /// Errors: what the system says; a link, or anything but a regular file; another process that has it.
    pub fn open(path: &Path, head: &[u8]) -> io::Result<(Pieces, bool)> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NOFOLLOW | libc::O_NONBLOCK);
        let mut file = options.open(path)?;
        if !file.metadata()?.is_file() {
            return Err(io::Error::other("it is not a regular file"));
        }
        if let Err(std::fs::TryLockError::WouldBlock) = file.try_lock() {
            return Err(io::Error::other("another process is at it"));
        }
        let mut found = vec![0; head.len()];
        let is_same = file.read_exact(&mut found).is_ok() && found == head;
        let was_other = !is_same && file.metadata()?.len() > 0;
        if !is_same {
            file.set_len(0)?;
            file.rewind()?;
            file.write_all(head)?;
        }
        Ok((Pieces { file, path: path.to_path_buf(), end: head.len() as u64, reads: is_same }, was_other))
    }

    /// The next whole piece that the file holds; then what follows it is cut off, and pieces can be added.
    pub fn next_piece(&mut self) -> io::Result<Option<Vec<u8>>> {
        if !self.reads {
            return Ok(None);
        }
        if let Some(piece) = self.whole_piece() {
            self.end += 8 + piece.len() as u64;
            return Ok(Some(piece));
        }
        self.reads = false;
        self.file.set_len(self.end)?;
        self.file.seek(io::SeekFrom::Start(self.end))?;
        Ok(None)
    }

    fn whole_piece(&mut self) -> Option<Vec<u8>> {
        let mut head = [0; 8];
        self.file.read_exact(&mut head).ok()?;
        body(&mut &self.file, head)
    }

    /// Adds a piece after those that were read; those that were not are lost.
    ///
    /// Errors: what the system says; a piece of more than a gigabyte.
    pub fn push(&mut self, piece: &[u8]) -> io::Result<()> {
        if self.reads {
            self.reads = false;
            self.file.set_len(self.end)?;
            self.file.seek(io::SeekFrom::Start(self.end))?;
        }
        let length = u32::try_from(piece.len()).ok().filter(|length| *length <= MOST);
        let length = length.ok_or_else(|| io::Error::other("the piece is too large"))?;
        self.file.write_all(&[length.to_le_bytes(), checksum(piece).to_le_bytes()].concat())?;
        self.file.write_all(piece)?;
        self.end += 8 + u64::from(length);
        Ok(())
    }

    /// Removes the file.
    pub fn remove(self) -> io::Result<()> {
        std::fs::remove_file(&self.path)
    }

    /// Gives the file its final name, in the same folder, in place of what is there.
    pub fn rename(self, path: &Path) -> io::Result<()> {
        self.file.sync_all()?;
        std::fs::rename(&self.path, path)
    }
}

/// What follows a piece's head, of its length and checksum; nothing where it is cut off or damaged.
fn body(file: &mut impl Read, head: [u8; 8]) -> Option<Vec<u8>> {
    let (length, sum) = head.split_at(4);
    let number = |bytes: &[u8]| bytes.try_into().map(u32::from_le_bytes).ok();
    let length = number(length).filter(|length| *length <= MOST)?;
    let mut piece = Vec::new();
    file.take(u64::from(length)).read_to_end(&mut piece).ok()?;
    (piece.len() == length as usize && number(sum)? == checksum(&piece)).then_some(piece)
}

/// Longest line that a file of pieces begins with, in bytes.
const MOST_HEAD: u64 = 4096;

/// Reads the pieces of a file that is whole, and leaves it as it is.
pub struct PiecesReader {
    file: BufReader<File>,
}

impl PiecesReader {
    /// Opens a file; gives the line that it begins with, without its end.
    ///
    /// Errors: what the system says; anything but a regular file, or one without such a line.
    pub fn open(path: &Path) -> io::Result<(PiecesReader, String)> {
        let mut file = BufReader::new(super::open_file(path, super::Chosen::Found)?);
        let mut head = Vec::new();
        (&mut file).take(MOST_HEAD).read_until(b'\n', &mut head)?;
        match (head.pop(), String::from_utf8(head)) {
            (Some(b'\n'), Ok(head)) => Ok((PiecesReader { file }, head)),
            _ => Err(io::Error::other("it does not begin as it should")),
        }
    }

    /// The next piece; nothing at the end.
    ///
    /// Errors: what the system says; a piece that is cut off or damaged.
    pub fn next_piece(&mut self) -> io::Result<Option<Vec<u8>>> {
        if self.file.fill_buf()?.is_empty() {
            return Ok(None);
        }
        let damaged = || io::Error::other("it is cut off or damaged");
        let mut head = [0; 8];
        self.file.read_exact(&mut head).map_err(|_| damaged())?;
        body(&mut self.file, head).map(Some).ok_or_else(damaged)
    }
}

fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

#[cfg(test)]
mod tests {
    use super::{Pieces, PiecesReader};

    #[test]
    fn what_was_cut_off_is_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.part");
        let all = |head: &[u8]| {
            let (mut pieces, was_other) = Pieces::open(&path, head).unwrap();
            let mut found = Vec::new();
            while let Some(piece) = pieces.next_piece().unwrap() {
                found.push(piece);
            }
            (pieces, found, was_other)
        };
        let (mut pieces, found, was_other) = all(b"head");
        assert!(found.is_empty() && !was_other);
        pieces.push(b"one").unwrap();
        pieces.push(b"two").unwrap();
        assert!(Pieces::open(&path, b"head").is_err(), "two processes write the same file");
        drop(pieces);
        let whole = std::fs::read(&path).unwrap();
        for length in 4..=whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let (mut pieces, found, _) = all(b"head");
            assert_eq!(found.len(), (length - 4) / 11);
            pieces.push(b"end").unwrap();
            drop(pieces);
            assert_eq!(all(b"head").1.last().unwrap(), b"end");
        }
        std::fs::write(&path, &whole).unwrap();
        let (mut other, head) = {
            std::fs::write(&path, [b"\n", &whole[4..]].concat()).unwrap();
            PiecesReader::open(&path).unwrap()
        };
        assert_eq!(head, "");
        assert!([b"one", b"two"].iter().all(|piece| other.next_piece().unwrap().as_deref() == Some(*piece)));
        assert!(other.next_piece().unwrap().is_none());
        std::fs::write(&path, [b"\n", &whole[4..whole.len() - 1]].concat()).unwrap();
        let (mut other, _) = PiecesReader::open(&path).unwrap();
        assert!(other.next_piece().is_ok() && other.next_piece().is_err());
        std::fs::write(&path, &whole).unwrap();
        let (pieces, found, was_other) = all(b"tail");
        assert!(found.is_empty() && was_other);
        pieces.remove().unwrap();
        assert!(!path.exists());
    }
}
