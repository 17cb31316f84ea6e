//! Files: the one place that reads what is named or found, and writes what is asked for.
//!
//! Reading ([`read_bytes`], [`read_text`]) takes regular files and pipes up to a limit, so nothing blocks on what was only found
//! beside a formula, and no device fills the memory. Writing starts with a look at the [`Target`]: links are followed, pipes and
//! devices are written into, and a regular file appears whole under its name or not at all. Until then its bytes are in a file
//! beside it that [`clean_up_on_signals`] removes; what a killed process left, the next one that writes there sweeps away.
//!
//! ```
//! # fn main() -> std::io::Result<()> {
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("a.ron");
//! bulbfold::files::write(&path, b"(nodes: {})")?;
//! assert_eq!(bulbfold::files::read_text(&path, 100, bulbfold::files::Chosen::Named)?, "(nodes: {})");
//! # Ok(())
//! # }
//! ```

mod output;
mod owner;
mod pieces;
mod read;
mod signals;
mod target;
mod temporary;

pub use self::output::{Output, write};
pub use self::owner::is_foreign;
pub use self::pieces::{Pieces, PiecesReader};
pub use self::read::{Chosen, MAX_TEXT, open_file, read_bytes, read_text};
pub use self::signals::clean_up_on_signals;
pub use self::target::{FileId, STDOUT, Target};
