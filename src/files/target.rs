//! What an output's name leads to.

use std::fs::{File, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The name that stands for stdout.
pub const STDOUT: &str = "-";
/// Links that lead to links, at most; as many as systems follow.
const MAX_LINKS: usize = 40;

/// Where something is to be written.
#[derive(Clone, Debug)]
pub struct Target {
    /// The name that was given.
    given: PathBuf,
    pub(super) kind: Kind,
}

#[derive(Clone, Debug)]
pub(super) enum Kind {
    Stdout,
    /// A pipe or a character device, open for writing.
    Stream(Arc<File>),
    /// A regular file or a free name, behind all links.
    File(Place),
}

/// A regular file that is or will be.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub(super) path: PathBuf,
    /// What is there now.
    pub(super) existing: Option<Metadata>,
}

/// What tells a file from all others, whatever its names.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FileId(#[cfg(unix)] (u64, u64), #[cfg(not(unix))] PathBuf);

impl FileId {
    /// The file behind a name and its links; `None` if there is none.
    pub fn of(path: &Path) -> Option<FileId> {
        #[cfg(unix)]
        return std::fs::metadata(path).ok().map(|data| FileId::from(&data));
        #[cfg(not(unix))]
        path.canonicalize().ok().map(FileId)
    }

    #[cfg(unix)]
    fn from(data: &Metadata) -> FileId {
        use std::os::unix::fs::MetadataExt;
        FileId((data.dev(), data.ino()))
    }
}

impl Target {
    /// Looks at what a name leads to; `-` is stdout. Pipes and devices are opened at once.
    ///
    /// Errors: what the system says; a folder, a block device, a socket, a file that may not be written to, a pipe without a reader,
    /// a link that another user has put into a folder of everybody.
    pub fn of(given: &Path) -> io::Result<Target> {
        let kind = match given.as_os_str() == STDOUT {
            true => Kind::Stdout,
            false => Kind::of(given)?,
        };
        Ok(Target { given: given.to_path_buf(), kind })
    }

    /// The name that was given.
    pub fn path(&self) -> &Path {
        &self.given
    }

    /// Whether it is stdout, under whatever name.
    pub fn is_stdout(&self) -> bool {
        matches!(self.kind, Kind::Stdout)
    }

    /// Whether bytes are passed on, so that a name's ending says nothing: stdout, a pipe, a device.
    pub fn is_stream(&self) -> bool {
        !matches!(self.kind, Kind::File(_))
    }

    /// Whether a file would be replaced.
    pub fn is_taken(&self) -> bool {
        matches!(&self.kind, Kind::File(Place { existing: Some(_), .. }))
    }

    /// Whether writing would replace this file.
    pub fn is_file(&self, id: &FileId) -> bool {
        match &self.kind {
            Kind::File(place) => FileId::of(&place.path).as_ref() == Some(id),
            _ => false,
        }
    }

    /// Tries whether the target's folder takes files; only that tells it, on every system.
    pub fn try_folder(&self) -> io::Result<()> {
        match &self.kind {
            Kind::File(place) => super::temporary::Temporary::create(place.folder(), None).map(|_| ()),
            _ => Ok(()),
        }
    }
}

impl Place {
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("."))
    }
}

impl Kind {
    fn of(given: &Path) -> io::Result<Kind> {
        let data = match std::fs::metadata(given) {
            Ok(data) => data,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Ok(Kind::File(Place { path: follow(given)?.0, existing: None }));
            }
            Err(error) => return Err(error),
        };
        if data.is_dir() {
            return Err(io::Error::other("it is a folder"));
        }
        let (_, is_descriptor) = follow(given)?;
        #[cfg(unix)]
        {
            // A socket cannot be opened by its name, and a file that is appended to would lose its place.
            if (is_descriptor || !data.is_file()) && is_own_stdout(&data) {
                return Ok(Kind::Stdout);
            }
        }
        if is_descriptor || !data.is_file() {
            return open_stream(given, &data).map(|file| Kind::Stream(Arc::new(file)));
        }
        let path = given.canonicalize()?;
        // A file that is protected from writing is to stay as it is.
        File::options().write(true).open(&path)?;
        Ok(Kind::File(Place { path, existing: Some(data) }))
    }
}

/// The name behind all links, and whether it is an open file of a process, which has no name that could be replaced.
fn follow(given: &Path) -> io::Result<(PathBuf, bool)> {
    let mut path = given.to_path_buf();
    for _ in 0..MAX_LINKS {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if folder.canonicalize().is_ok_and(|folder| folder.starts_with("/proc")) {
            return Ok((path, true));
        }
        match std::fs::symlink_metadata(&path) {
            Ok(data) if data.is_symlink() => {
                check_link(folder, &data)?;
                path = folder.join(std::fs::read_link(&path)?);
            }
            _ => return Ok((path, false)),
        }
    }
    Err(io::Error::other("too many links lead to each other"))
}

/// Refuses a link in a folder of everybody, such as `/tmp`, that neither this user nor the folder's owner made.
#[cfg(unix)]
fn check_link(folder: &Path, link: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::MetadataExt;
    const STICKY_AND_OPEN: u32 = 0o1002;
    let folder = std::fs::metadata(folder)?;
    let is_open = folder.mode() & STICKY_AND_OPEN == STICKY_AND_OPEN;
    if is_open && link.uid() != folder.uid() && super::owner::is_foreign_user(link.uid()) {
        return Err(io::Error::other("it is a link that another user has made, in a folder of everybody"));
    }
    Ok(())
}

#[cfg(not(unix))]
fn check_link(_: &Path, _: &Metadata) -> io::Result<()> {
    Ok(())
}

/// Whether this is what stdout leads to.
#[cfg(unix)]
fn is_own_stdout(data: &Metadata) -> bool {
    use std::os::fd::AsFd;
    let own = io::stdout().as_fd().try_clone_to_owned().and_then(|own| File::from(own).metadata());
    own.is_ok_and(|own| FileId::from(&own) == FileId::from(data))
}

/// Opens what bytes can be passed to.
#[cfg(unix)]
fn open_stream(path: &Path, data: &Metadata) -> io::Result<File> {
    use std::os::unix::fs::FileTypeExt;
    let kind = data.file_type();
    if kind.is_block_device() {
        return Err(io::Error::other("it is a block device, such as a disk"));
    }
    if kind.is_socket() {
        return Err(io::Error::other("it is a socket"));
    }
    if kind.is_fifo() { open_pipe(path) } else { File::options().write(true).open(path) }
}

#[cfg(not(unix))]
fn open_stream(_: &Path, _: &Metadata) -> io::Result<File> {
    Err(io::Error::other("it is not a regular file"))
}

/// Opens a named pipe. A reader may start a little later than the program does, but is not waited for without end.
#[cfg(unix)]
fn open_pipe(path: &Path) -> io::Result<File> {
    use std::os::fd::AsRawFd;
    use std::os::unix::fs::OpenOptionsExt;
    use std::time::Duration;
    const WAIT: Duration = Duration::from_millis(50);
    for _ in 0..100 {
        match File::options().write(true).custom_flags(libc::O_NONBLOCK).open(path) {
            Err(error) if error.raw_os_error() == Some(libc::ENXIO) => std::thread::sleep(WAIT),
            Err(error) => return Err(error),
            Ok(file) => {
                // SAFETY: the descriptor is open, and the call changes only how it waits: for the reader, from here on.
                let failed = unsafe { libc::fcntl(file.as_raw_fd(), libc::F_SETFL, 0) } != 0;
                return if failed { Err(io::Error::last_os_error()) } else { Ok(file) };
            }
        }
    }
    Err(io::Error::other("it is a pipe without a reader"))
}
