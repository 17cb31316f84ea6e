//! Places in source texts, and messages about them.
//!
//! In come texts ([`Sources::add`]) and, from every stage that reads them, [`Diagnostic`]s whose
//! labels carry [`Span`]s. Out goes text for people ([`Diagnostics::render`]). Always holds: no
//! span, text or message makes the renderer panic; a span that fits no text is shown without a place.
//!
//! ```
//! use bulbfold::diag::{Diagnostic, Diagnostics, Sources, nearest};
//!
//! let mut sources = Sources::default();
//! let id = sources.add("box.ron", "(limti: 1.0)");
//! let mut diagnostics = Diagnostics::default();
//! diagnostics.push(
//!     Diagnostic::error("unknown field `limti`")
//!         .label(sources.span_at(id, 1, 2), "not a field of a box fold")
//!         .help(format!("did you mean `{}`?", nearest("limti", ["limit", "scale"]).unwrap())),
//! );
//! assert!(diagnostics.render(&sources, false).starts_with("error: unknown field `limti`\n --> box.ron:1:2"));
//! ```

mod nearest;
mod render;
mod source;

pub use nearest::nearest;
pub use render::printable;
pub use source::{SourceId, Sources, Span};

/// How bad the subject of a [`Diagnostic`] is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Severity {
    /// The work cannot be done.
    Error,
    /// The work can be done, but is probably not what was meant.
    Warning,
}

/// One message: what is wrong, where, and what to try next.
#[derive(Clone, Debug)]
pub struct Diagnostic {
    /// Whether the work can go on.
    pub severity: Severity,
    /// What is wrong, in one sentence without a full stop.
    pub message: String,
    /// Places and what each has to do with it. The first is the primary one.
    pub labels: Vec<(Span, String)>,
    /// What to try next, one sentence each.
    pub help: Vec<String>,
}

impl Diagnostic {
    /// The message alone, as a plain text for people.
    pub fn rendered(self, sources: &Sources) -> String {
        let mut d = Diagnostics::default();
        d.push(self);
        d.render(sources, false)
    }

    /// Starts an error.
    pub fn error(message: impl Into<String>) -> Self {
        Self::new(Severity::Error, message.into())
    }

    /// Starts a warning.
    pub fn warning(message: impl Into<String>) -> Self {
        Self::new(Severity::Warning, message.into())
    }

    /// A message without labels and help.
    fn new(severity: Severity, message: String) -> Self {
        Self { severity, message, labels: Vec::new(), help: Vec::new() }
    }

    /// Adds a place; the first one added is the primary one. [`Span::NONE`] is kept but not shown.
    #[must_use]
    pub fn label(mut self, span: Span, text: impl Into<String>) -> Self {
        self.labels.push((span, text.into()));
        self
    }

    /// Adds a line of help.
    #[must_use]
    pub fn help(mut self, text: impl Into<String>) -> Self {
        self.help.push(text.into());
        self
    }

    /// Adds "did you mean" with the candidate [`nearest()`] to `name`, if one is near enough.
    #[must_use]
    pub fn did_you_mean<'a>(self, name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Self {
        match nearest(name, candidates) {
            Some(near) => self.help(format!("did you mean `{near}`?")),
            None => self,
        }
    }

    /// Place of the first label, or [`Span::NONE`].
    pub fn span(&self) -> Span {
        self.labels.first().map_or(Span::NONE, |(span, _)| *span)
    }
}

/// The messages of a run, in the order in which they were found.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics {
    /// All of them; [`Diagnostics::render`] shows only some.
    list: Vec<Diagnostic>,
}

impl Diagnostics {
    /// Adds a message.
    pub fn push(&mut self, diagnostic: Diagnostic) {
        self.list.push(diagnostic);
    }

    /// Adds all messages of another run (or list).
    pub fn extend(&mut self, diagnostics: impl IntoIterator<Item = Diagnostic>) {
        self.list.extend(diagnostics);
    }

    /// Whether the work cannot be done.
    pub fn has_errors(&self) -> bool {
        self.error_count() > 0
    }

    /// Number of errors, without warnings.
    pub fn error_count(&self) -> usize {
        self.iter().filter(|d| d.severity == Severity::Error).count()
    }

    /// All messages, in the order in which they were found.
    pub fn iter(&self) -> std::slice::Iter<'_, Diagnostic> {
        self.list.iter()
    }

    /// Whether there is nothing to tell.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Number of messages, errors and warnings.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Writes the messages for people, with the source lines they speak of.
    ///
    /// Shape: one block a message with an empty line between, a newline at the end; empty if there
    /// are none. At most 20 are shown (then errors go before warnings), and the rest is counted.
    /// Without `color` the text has no escape codes; control characters of the sources and messages
    /// are replaced in either case.
    pub fn render(&self, sources: &Sources, color: bool) -> String {
        render::render(&self.list, sources, color)
    }
}

impl IntoIterator for Diagnostics {
    type Item = Diagnostic;
    type IntoIter = std::vec::IntoIter<Diagnostic>;

    fn into_iter(self) -> Self::IntoIter {
        self.list.into_iter()
    }
}

impl<'a> IntoIterator for &'a Diagnostics {
    type Item = &'a Diagnostic;
    type IntoIter = std::slice::Iter<'a, Diagnostic>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

#[cfg(test)]
mod tests;
