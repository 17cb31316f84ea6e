//! Temporary files: named at random, made exclusively, locked as long as their process lives.
//!
//! The lock is what tells a file in the making from one that a killed process left: it ends with the process, and it holds between
//! containers whose processes have equal numbers.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions, TryLockError};
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What all names begin and end with; sixteen hexadecimal digits are between. No name is near the limit of 255 bytes.
const BEFORE: &str = ".bulbfold-";
const AFTER: &str = ".tmp";
/// Names that are tried before something must be wrong.
const TRIES: usize = 100;

/// Files of this process that have no final name yet. Whoever holds it can rely on no file coming or going.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
/// Folders that were swept.
static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn lock(set: &'static Mutex<BTreeSet<PathBuf>>) -> MutexGuard<'static, BTreeSet<PathBuf>> {
    // A set of paths is never half changed.
    set.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file without a final name. Dropping it removes it.
pub(super) struct Temporary {
    path: PathBuf,
    /// Open, and locked where the file system has locks.
    pub(super) file: File,
}

impl Temporary {
    /// A new file in this folder, with these rights as far as the system's mask allows them (else those that new files have). Removes
    /// first what dead processes left there.
    pub(super) fn create(folder: &Path, mode: Option<u32>) -> io::Result<Temporary> {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        super::signals::watch();
        sweep_once(folder);
        for _ in 0..TRIES {
            let path = folder.join(random_name());
            let mut unfinished = lock(&UNFINISHED);
            let file = match open_new(&path, mode) {
                Ok(file) => file,
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(error),
            };
            // Another process may have swept the file away before it was locked, or be about to.
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => continue,
                _ if !is_linked(&file) => continue,
                _ => {}
            }
            unfinished.insert(path.clone());
            return Ok(Temporary { path, file });
        }
        Err(io::Error::other("no temporary name is free"))
    }

    /// Gives the file its final name, in place of what is there.
    pub(super) fn rename(&mut self, target: &Path) -> io::Result<()> {
        let mut unfinished = lock(&UNFINISHED);
        std::fs::rename(&self.path, target)?;
        unfinished.remove(&self.path);
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut unfinished = lock(&UNFINISHED);
        // Renamed files are not in the set.
        if unfinished.remove(&self.path) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Removes all unfinished files. None comes as long as the result is held.
#[cfg(unix)]
pub(super) fn remove_all() -> impl Drop {
    let mut unfinished = lock(&UNFINISHED);
    for path in std::mem::take(&mut *unfinished) {
        let _ = std::fs::remove_file(path);
    }
    unfinished
}

fn random_name() -> String {
    // Keys of the standard hash tables are random numbers of the system.
    let digits = RandomState::new().hash_one(std::process::id());
    format!("{BEFORE}{digits:016x}{AFTER}")
}

fn is_own_name(name: &str) -> bool {
    let digits = name.strip_prefix(BEFORE).and_then(|rest| rest.strip_suffix(AFTER));
    digits.is_some_and(|digits| digits.len() == 16 && digits.bytes().all(|c| c.is_ascii_hexdigit()))
}

/// A file that was not there, which no link leads to.
fn open_new(path: &Path, mode: Option<u32>) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create_new(true);
    #[cfg(unix)]
    if let Some(mode) = mode {
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, mode);
    }
    #[cfg(not(unix))]
    let _ = mode;
    options.open(path)
}

/// Whether a file still has a name.
fn is_linked(file: &File) -> bool {
    #[cfg(unix)]
    return file.metadata().is_ok_and(|data| std::os::unix::fs::MetadataExt::nlink(&data) > 0);
    #[cfg(not(unix))]
    {
        let _ = file;
        true
    }
}

/// Sweeps a folder unless this process did so already: an animation writes many files into one.
fn sweep_once(folder: &Path) {
    if lock(&SWEPT).insert(folder.to_path_buf()) {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.filter(|entry| entry.file_name().to_str().is_some_and(is_own_name)).for_each(|e| sweep(&e.path()));
    }
}

/// Removes a temporary file of this user that no living process holds. Whatever is in doubt stays.
fn sweep(path: &Path) {
    let Ok(data) = std::fs::symlink_metadata(path) else { return };
    if !data.is_file() {
        return;
    }
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
        if data.uid() != super::owner::own_user() {
            return;
        }
        options.custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK);
    }
    // The lock is held until the name is gone, so that whoever has just made the file sees either.
    if let Ok(file) = options.open(path)
        && file.metadata().is_ok_and(|data| data.is_file())
        && file.try_lock().is_ok()
    {
        let _ = std::fs::remove_file(path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_nobody_alive_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let alive = Temporary::create(folder.path(), None).unwrap();
        let dead = folder.path().join(random_name());
        let others = [".bulbfold-12.tmp", ".bulbfold-000000000000000g.tmp", "x.bulbfold-0123456789abcdef.tmp"];
        for path in std::iter::once(dead.clone()).chain(others.map(|name| folder.path().join(name))) {
            std::fs::write(path, "").unwrap();
        }
        let kept = folder.path().join(".bulbfold-0123456789abcdef.tmp");
        std::fs::create_dir(&kept).unwrap();
        lock(&SWEPT).remove(folder.path());
        sweep_once(folder.path());
        assert!(!dead.exists() && alive.path.exists() && kept.is_dir());
        assert!(others.iter().all(|name| folder.path().join(name).exists()));
        let path = alive.path.clone();
        drop(alive);
        assert!(!path.exists());
    }

    #[test]
    fn a_renamed_file_stays() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("x".repeat(255));
        let mut file = Temporary::create(folder.path(), None).unwrap();
        file.rename(&target).unwrap();
        drop(file);
        assert!(target.is_file());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
