//! The picture that surrounds a scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Beside;
use crate::colour::{MOST_BYTES, Panorama};
use crate::diag::{Diagnostic, Diagnostics};
use crate::files::{Chosen, read_bytes};
use crate::formula::value::Value;
use crate::graph::wanted_picture;

/// A picture with the name that the file gives it.
pub type Named = (String, Arc<Panorama>);

/// The picture that a file's surroundings name: one that came with it, else a file beside it, else one in the current folder. An error
/// is pushed.
pub(super) fn load_picture(value: &Value, beside: Beside, d: &mut Diagnostics) -> Option<Named> {
    let (name, span) = wanted_picture(value)?;
    let carried = beside.pictures.iter().find(|(known, _)| known == name);
    let found = match carried {
        Some((_, text)) => Panorama::of_text(text),
        None => read_bytes(&place(name, beside.folder), MOST_BYTES, Chosen::Named)
            .map_err(|error| format!("cannot be read: {error}"))
            .and_then(|bytes| Panorama::decode(&bytes)),
    };
    match found {
        Ok(panorama) => Some((name.to_string(), Arc::new(panorama))),
        Err(why) => {
            let help = "the file lies beside the formula's, or in the current folder";
            d.push(Diagnostic::error(format!("{name} {why}")).label(span, "named here").help(help));
            None
        }
    }
}

fn place(name: &str, folder: Option<&Path>) -> PathBuf {
    let beside = folder.map(|folder| folder.join(name)).filter(|path| path.exists());
    beside.unwrap_or_else(|| PathBuf::from(name))
}
