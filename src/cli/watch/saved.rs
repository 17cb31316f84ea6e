//! Which files a formula is read from, and when they are saved.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use super::desk::Desk;
use crate::cli::Outcome;

/// Time between two looks at the files.
const PAUSE: Duration = Duration::from_millis(5);
/// A file that cannot be read is read again for so long before the error is told: an editor may be writing it.
const PATIENCE: Duration = Duration::from_millis(80);

/// What tells a file from the same one before it was saved: time, bytes.
type Mark = Option<(SystemTime, u64)>;

/// The files that are looked at.
pub struct Saved {
    file: PathBuf,
    marks: BTreeMap<PathBuf, Mark>,
}

fn mark(path: &Path) -> Mark {
    let data = std::fs::metadata(path).ok()?;
    Some((data.modified().ok()?, if data.is_file() { data.len() } else { 0 }))
}

impl Saved {
    /// A formula's file and what lies beside it.
    pub fn new(file: &Path) -> Saved {
        let mut saved = Saved { file: file.to_path_buf(), marks: BTreeMap::new() };
        saved.look_at(&[]);
        saved
    }

    /// Looks at these files from now on, too.
    fn look_at(&mut self, read: &[PathBuf]) {
        let folder = self.file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // The folder changes when a step is added.
        let beside = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let steps = beside.filter(|path| path.extension().is_some_and(|end| end == "rhai"));
        let all = [self.file.clone(), folder.to_path_buf()].into_iter().chain(steps).chain(read.iter().cloned());
        for path in all {
            self.marks.entry(path).or_insert_with_key(|path| mark(path));
        }
    }

    /// Whether a file was saved since the last call.
    fn is_saved(&mut self) -> bool {
        let mut is_saved = false;
        for (path, before) in &mut self.marks {
            let now = mark(path);
            is_saved |= now.is_some() && now != *before && !path.is_dir();
            *before = now;
        }
        is_saved
    }

    /// Reads the formula whenever it is saved, for ever.
    pub fn follow(mut self, desk: &Arc<Desk>) -> Outcome {
        let mut since = Some(Instant::now());
        loop {
            if let Some(begun) = since {
                let is_late = begun.elapsed() >= PATIENCE;
                if desk.read(begun, is_late) || is_late {
                    since = None;
                    self.look_at(&desk.files());
                }
            }
            std::thread::sleep(PAUSE);
            if self.is_saved() {
                since = Some(Instant::now());
            }
        }
    }
}
