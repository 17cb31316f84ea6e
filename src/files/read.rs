//! Reading with limits.

use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Read};
use std::path::Path;

/// Largest text of a formula, a step or another program's file, in bytes.
pub const MAX_TEXT: u64 = 1 << 20;

/// Who chose a file.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Chosen {
    /// The user named it: it may be a pipe, which is waited for.
    Named,
    /// The program found it, in a folder: only a regular file is read.
    Found,
}

/// The bytes of a file.
///
/// Errors: what the system says; a folder, a block device or a socket; anything but a regular file where it was only found; more
/// than `limit` bytes, of which no more are read than that.
pub fn read_bytes(path: &Path, limit: u64, chosen: Chosen) -> io::Result<Vec<u8>> {
    let file = open_file(path, chosen)?;
    let data = file.metadata()?;
    let large = || io::Error::other(format!("it is larger than {limit} bytes"));
    if data.len() > limit {
        return Err(large());
    }
    let mut bytes = Vec::with_capacity(data.len() as usize);
    file.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(large()) } else { Ok(bytes) }
}

/// Opens a file to be read piece by piece.
///
/// Errors: what the system says; a folder, a block device or a socket; anything but a regular file where it was only found.
pub fn open_file(path: &Path, chosen: Chosen) -> io::Result<File> {
    let data = std::fs::metadata(path)?;
    check_kind(&data, chosen)?;
    let file = open(path, &data)?;
    // What was looked at may have gone since.
    check_kind(&file.metadata()?, chosen)?;
    Ok(file)
}

/// The text of a file, as [`read_bytes`] reads it.
///
/// Errors: also bytes that are not UTF-8; the message names the first one.
pub fn read_text(path: &Path, limit: u64, chosen: Chosen) -> io::Result<String> {
    String::from_utf8(read_bytes(path, limit, chosen)?)
        .map_err(|error| io::Error::other(format!("byte {} is not UTF-8 text", error.utf8_error().valid_up_to())))
}

fn check_kind(data: &Metadata, chosen: Chosen) -> io::Result<()> {
    if data.is_dir() {
        return Err(io::Error::other("it is a folder"));
    }
    let is_taken = data.is_file() || chosen == Chosen::Named && is_stream(data);
    if is_taken { Ok(()) } else { Err(io::Error::other("it is not a regular file")) }
}

/// Whether bytes come one after another: of a pipe or a character device such as a terminal.
#[cfg(unix)]
fn is_stream(data: &Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    data.file_type().is_fifo() || data.file_type().is_char_device()
}

#[cfg(not(unix))]
fn is_stream(data: &Metadata) -> bool {
    !data.is_file()
}

/// Opens a file that was looked at. A regular file never blocks, even if a pipe has taken its place.
fn open(path: &Path, data: &Metadata) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    if data.is_file() {
        std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    }
    #[cfg(not(unix))]
    let _ = data;
    options.open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_read_beyond_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "four").unwrap();
        assert_eq!(read_text(&path, 4, Chosen::Found).unwrap(), "four");
        let error = read_text(&path, 3, Chosen::Named).unwrap_err().to_string();
        assert_eq!(error, "it is larger than 3 bytes");
        assert_eq!(read_bytes(folder.path(), 9, Chosen::Named).unwrap_err().to_string(), "it is a folder");
        std::fs::write(&path, [b'a', 0xff]).unwrap();
        assert_eq!(read_text(&path, 9, Chosen::Named).unwrap_err().to_string(), "byte 1 is not UTF-8 text");
    }

    #[cfg(unix)]
    #[test]
    fn devices_are_read_to_the_limit_where_they_are_named_and_never_where_they_are_found() {
        let zero = Path::new("/dev/zero");
        assert_eq!(read_bytes(zero, 99, Chosen::Named).unwrap_err().to_string(), "it is larger than 99 bytes");
        assert_eq!(read_bytes(zero, 99, Chosen::Found).unwrap_err().to_string(), "it is not a regular file");
        assert_eq!(read_bytes(Path::new("/dev/null"), 99, Chosen::Named).unwrap(), b"");
    }
}
