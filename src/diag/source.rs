//! Source texts and places in them.

use std::sync::Arc;

/// Names one text of a [`Sources`].
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, PartialOrd, Ord)]
pub struct SourceId(u32);

/// A byte range of one source text.
///
/// Range: `start <= end <= text length`, on character borders. Whoever shows a span clamps it, so a
/// wrong one is ugly but harmless.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Span {
    /// The text.
    pub source: SourceId,
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

impl Span {
    /// No place, for things that stand in no file.
    pub const NONE: Self = Self { source: SourceId(u32::MAX), start: 0, end: 0 };

    /// A byte range. Offsets past 4 GiB saturate.
    pub fn new(source: SourceId, start: usize, end: usize) -> Self {
        let offset = |byte| u32::try_from(byte).unwrap_or(u32::MAX);
        Self { source, start: offset(start), end: offset(end.max(start)) }
    }

    /// The bytes in their text.
    pub fn range(self) -> std::ops::Range<usize> {
        self.start as usize..self.end as usize
    }

    /// Whether this is [`Span::NONE`].
    pub fn is_none(self) -> bool {
        self.source == Self::NONE.source
    }

    /// The least span that holds both. Of [`Span::NONE`] and another the other; of two texts the first.
    #[must_use]
    pub fn to(self, other: Self) -> Self {
        if self.is_none() {
            return other;
        }
        if self.source != other.source {
            return self;
        }
        Self { source: self.source, start: self.start.min(other.start), end: self.end.max(other.end) }
    }
}

/// One text and where its lines start.
#[derive(Clone, Debug)]
struct Source {
    /// As shown to people, for example a path.
    name: String,
    /// The whole text.
    text: Arc<str>,
    /// First byte of each line; never empty.
    line_starts: Vec<usize>,
}

/// All texts that spans may point into.
#[derive(Default, Clone, Debug)]
pub struct Sources {
    /// Indexed by [`SourceId`].
    list: Vec<Arc<Source>>,
}

/// Where a span starts, and how much of it is on that line.
pub(super) struct Place<'a> {
    /// 0-based line.
    pub line: usize,
    /// Text of the line, without its end.
    pub text: &'a str,
    /// Bytes of `text` that the span covers, on character borders.
    pub start: usize,
    /// See `start`.
    pub end: usize,
}

impl Sources {
    /// Adds a text under a name to show, for example its path.
    pub fn add(&mut self, name: impl Into<String>, text: impl Into<Arc<str>>) -> SourceId {
        let text = text.into();
        let line_starts = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        let id = SourceId(u32::try_from(self.list.len()).unwrap_or(u32::MAX));
        self.list.push(Arc::new(Source { name: name.into(), text, line_starts }));
        id
    }

    /// Name of a text; empty for an id of another `Sources`.
    pub fn name(&self, id: SourceId) -> &str {
        self.get(id).map_or("", |source| &source.name)
    }

    /// The names of all texts.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.list.iter().map(|source| &source.name[..])
    }

    /// The text itself; empty for an id of another `Sources`.
    pub fn text(&self, id: SourceId) -> &str {
        self.get(id).map_or("", |source| &source.text)
    }

    /// The whole text as a span, [`Span::NONE`] for an id of another `Sources`.
    pub fn whole(&self, id: SourceId) -> Span {
        self.get(id).map_or(Span::NONE, |source| Span::new(id, 0, source.text.len()))
    }

    /// Line and column where the span starts, both from 1, columns in characters.
    pub fn line_col(&self, span: Span) -> Option<(usize, usize)> {
        let place = self.place(span)?;
        let column = place.text[..place.start].chars().count();
        Some((place.line + 1, column + 1))
    }

    /// The name, number, string or operator that starts at a line and column (both from 1, columns in
    /// characters, as rhai's `Position` gives them).
    ///
    /// Range: past the last line or column it is the nearest place before. Covers at least one
    /// character (the line end, at the end of a line); empty only at the end of the text.
    pub fn span_at(&self, id: SourceId, line: usize, column: usize) -> Span {
        let Some(source) = self.get(id) else {
            return Span::NONE;
        };
        let last = source.line_starts.len() - 1;
        let line = line.saturating_sub(1).min(last);
        let (start, text) = (source.line_starts[line], source.line(line));
        let skipped = text.char_indices().nth(column.saturating_sub(1));
        let at = start + skipped.map_or(text.len(), |(at, _)| at);
        let rest = &source.text[at..];
        let len = token_len(&rest[..rest.find('\n').unwrap_or(rest.len())]);
        let least = rest.chars().next().map_or(0, char::len_utf8);
        Span::new(id, at, at + len.max(least))
    }

    /// The text of an id.
    fn get(&self, id: SourceId) -> Option<&Source> {
        self.list.get(id.0 as usize).map(AsRef::as_ref)
    }

    /// Text of a 0-based line without its end; empty if there is none.
    pub(super) fn line(&self, id: SourceId, line: usize) -> &str {
        self.get(id).map_or("", |source| source.line(line))
    }

    /// Resolves a span to the first line it touches, clamped to the text.
    pub(super) fn place(&self, span: Span) -> Option<Place<'_>> {
        let source = self.get(span.source)?;
        let mut start = (span.start as usize).min(source.text.len());
        while !source.text.is_char_boundary(start) {
            start -= 1;
        }
        let mut end = (span.end as usize).clamp(start, source.text.len());
        while !source.text.is_char_boundary(end) {
            end += 1;
        }
        let line = source.line_starts.partition_point(|&first| first <= start) - 1;
        let (first, text) = (source.line_starts[line], source.line(line));
        Some(Place { line, text, start: (start - first).min(text.len()), end: (end - first).min(text.len()) })
    }
}

impl Source {
    /// Text of a 0-based line without `\n` or `\r\n`; empty if there is none.
    fn line(&self, line: usize) -> &str {
        let Some(&start) = self.line_starts.get(line) else {
            return "";
        };
        match self.line_starts.get(line + 1) {
            Some(&next) => {
                let text = &self.text[start..next - 1];
                text.strip_suffix('\r').unwrap_or(text)
            }
            None => &self.text[start..],
        }
    }
}

/// Bytes of the token that one line of program text starts with.
fn token_len(text: &str) -> usize {
    const OPERATORS: [&str; 20] = [
        "**=", "..=", "==", "!=", "<=", ">=", "&&", "||", "**", "+=", "-=", "*=", "/=", "=>", "->", "..", "::", "??",
        "<<", ">>",
    ];
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let Some(first) = text.chars().next() else {
        return 0;
    };
    if is_word(first) {
        let word = text.find(|c| !is_word(c)).unwrap_or(text.len());
        let fraction = text[word..].strip_prefix('.').filter(|_| first.is_ascii_digit());
        let digits = fraction.map_or(0, |f| f.find(|c: char| !c.is_ascii_digit()).unwrap_or(f.len()));
        return if digits > 0 { word + 1 + digits } else { word };
    }
    if matches!(first, '"' | '\'' | '`') {
        let mut escaped = false;
        for (at, c) in text.char_indices().skip(1) {
            if c == first && !escaped {
                return at + 1;
            }
            escaped = c == '\\' && !escaped;
        }
        return 1;
    }
    let operator = OPERATORS.iter().find(|operator| text.starts_with(**operator));
    operator.map_or(first.len_utf8(), |operator| operator.len())
}
