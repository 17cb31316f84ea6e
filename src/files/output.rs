//! Writing: whole or not at all.

use std::fs::{File, Metadata};
use std::io::{self, Seek, Write};
use std::path::Path;

use super::target::{Kind, Place, Target};
use super::temporary::Temporary;

/// A target that is being written. Until [`Output::commit`] nothing of it is seen; dropped before, it never was.
pub struct Output {
    kind: Unfinished,
}

enum Unfinished {
    /// Bytes for a stream, which cannot take any back.
    Stream(Vec<u8>, Target),
    File(Temporary, Place),
}

impl Output {
    /// Nothing is written yet. Streams keep their bytes in memory, files keep them in a file beside the target.
    pub fn new(target: &Target) -> io::Result<Output> {
        let kind = match &target.kind {
            Kind::File(place) => {
                let mode = place.existing.as_ref().map(mode);
                Unfinished::File(Temporary::create(place.folder(), mode)?, place.clone())
            }
            _ => Unfinished::Stream(Vec::new(), target.clone()),
        };
        Ok(Output { kind })
    }

    /// Writes other bytes over some that are there, from so many bytes after the beginning; what is written next goes to the end as before.
    ///
    /// Errors: what the system says; bytes that are not there.
    pub fn overwrite(&mut self, from: u64, bytes: &[u8]) -> io::Result<()> {
        match &mut self.kind {
            Unfinished::Stream(all, _) => {
                let place =
                    usize::try_from(from).ok().and_then(|from| all.get_mut(from..from.checked_add(bytes.len())?));
                place.ok_or_else(|| io::Error::other("there are no bytes to write over"))?.copy_from_slice(bytes);
                Ok(())
            }
            Unfinished::File(temporary, _) => {
                let mut file = &temporary.file;
                let end = file.stream_position()?;
                if from + bytes.len() as u64 > end {
                    return Err(io::Error::other("there are no bytes to write over"));
                }
                file.seek(io::SeekFrom::Start(from))?;
                file.write_all(bytes)?;
                file.seek(io::SeekFrom::Start(end)).map(|_| ())
            }
        }
    }

    /// Passes the bytes on, or gives the file its name. A file that is replaced leaves its mode and owner to the new one.
    ///
    /// Errors: what the system says; something that has come under a free name meanwhile and is no file. The target then is what it was.
    pub fn commit(self) -> io::Result<()> {
        match self.kind {
            Unfinished::Stream(bytes, target) => match &target.kind {
                Kind::Stream(file) => (&**file).write_all(&bytes),
                _ => {
                    let mut out = io::stdout().lock();
                    out.write_all(&bytes).and_then(|()| out.flush())
                }
            },
            Unfinished::File(temporary, place) => finish(temporary, &place),
        }
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.kind {
            Unfinished::Stream(all, _) => all.write(bytes),
            Unfinished::File(temporary, _) => temporary.file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.kind {
            Unfinished::Stream(..) => Ok(()),
            Unfinished::File(temporary, _) => temporary.file.flush(),
        }
    }
}

/// Writes a file whole or not at all, or bytes into what is no file.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    Target::of(path)?.write(bytes)
}

impl Target {
    /// Writes all bytes, whole or not at all.
    pub fn write(&self, bytes: &[u8]) -> io::Result<()> {
        let mut output = Output::new(self)?;
        output.write_all(bytes)?;
        if let Unfinished::File(temporary, Place { existing: Some(_), .. }) = &output.kind {
            // What is replaced may be a user's own work, which a power failure must not take.
            temporary.file.sync_all()?;
        }
        output.commit()
    }
}

fn finish(mut temporary: Temporary, place: &Place) -> io::Result<()> {
    match std::fs::symlink_metadata(&place.path) {
        Ok(data) if !data.is_file() => {
            return Err(io::Error::other("something that is no regular file has taken its place"));
        }
        _ => {}
    }
    let is_alike = place.existing.as_ref().is_none_or(|existing| take_after(&temporary.file, existing));
    if is_alike { temporary.rename(&place.path) } else { copy(&temporary.file, &place.path) }
}

/// Gives a file the mode and the owner of another; false if the system does not allow that.
#[cfg(unix)]
fn take_after(file: &File, existing: &Metadata) -> bool {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
    let Ok(own) = file.metadata() else { return false };
    let is_owned = (own.uid(), own.gid()) == (existing.uid(), existing.gid())
        || fchown(file, Some(existing.uid()), Some(existing.gid())).is_ok();
    // A change of the owner clears bits of the mode, so that comes second.
    is_owned && file.set_permissions(std::fs::Permissions::from_mode(existing.mode() & 0o7777)).is_ok()
}

#[cfg(not(unix))]
fn take_after(_: &File, _: &Metadata) -> bool {
    true
}

/// The rights of a file.
fn mode(data: &Metadata) -> u32 {
    #[cfg(unix)]
    return std::os::unix::fs::MetadataExt::mode(data) & 0o777;
    #[cfg(not(unix))]
    {
        let _ = data;
        0o666
    }
}

/// Copies a finished file over one that belongs to somebody else, who keeps it.
fn copy(mut from: &File, target: &Path) -> io::Result<()> {
    let mut to = File::options().write(true).open(target)?;
    from.rewind()?;
    let length = io::copy(&mut from, &mut to)?;
    to.set_len(length)
}
