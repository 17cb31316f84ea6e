//! Reads RON text into a [`Value`], and reports everything that is wrong with it.
//!
//! In comes one text of a [`Sources`]; out go a value whose every part knows its place, and messages.
//! The `ron` crate stops at the first error and keeps no places in its values, so this is a reader of
//! its own, for the same language (less byte strings, and less NaN and infinities, which no formula
//! can use). Always holds: no text makes it panic, and time grows with the length of the text only.
//!
//! ```
//! use bulbfold::diag::{Diagnostics, Sources};
//! use bulbfold::formula::ron::{Limits, read_ron};
//!
//! let mut sources = Sources::default();
//! let id = sources.add("box.ron", "(scale: 1e999, limit: [1, 2)");
//! let mut diagnostics = Diagnostics::default();
//! read_ron(&sources, id, &Limits::default(), &mut diagnostics);
//! let messages: Vec<&str> = diagnostics.iter().map(|d| d.message.as_str()).collect();
//! assert_eq!(messages, ["the number `1e999` is too large", "expected `,` or `]`, found `)`"]);
//! ```

mod attributes;
mod brackets;
mod number;
mod reader;
mod report;
mod scan;
mod text;

use super::value::Value;
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};

/// Sizes beyond which a text is refused, so that hostile ones cost little.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of text.
    pub bytes: usize,
    /// Brackets open at once; more than 256 count as 256.
    pub depth: usize,
    /// Values, inner ones and map keys included.
    pub values: usize,
}

impl Default for Limits {
    /// 1 MiB, 64 deep, 100,000 values.
    fn default() -> Self {
        Self { bytes: 1 << 20, depth: 64, values: 100_000 }
    }
}

/// Reads a whole text as one RON value.
///
/// Errors: each is pushed; after 100 of one text reading stops. `None` if the text is no value, a
/// bracket, string or comment is never closed, or a limit is passed. Otherwise there is a value even
/// after errors, so that more can be found in it: parts that could not be read are
/// [`ValueKind::Invalid`](super::value::ValueKind::Invalid), and of doubled names the first is kept.
/// Ask [`Diagnostics::has_errors`] whether all is well. Cost: linear in the length of the text.
pub fn read_ron(sources: &Sources, id: SourceId, limits: &Limits, diagnostics: &mut Diagnostics) -> Option<Value> {
    let text = sources.text(id);
    if text.len() > limits.bytes {
        let message = format!("the file has {} bytes, but at most {} are allowed", text.len(), limits.bytes);
        diagnostics.push(Diagnostic::error(message).label(Span::new(id, 0, 0), "too long"));
        return None;
    }
    reader::Reader::new(text, id, limits, diagnostics).document()
}

#[cfg(test)]
mod tests;
