//! Messages as text for people: cuts the source lines to size, and lets annotate-snippets draw them.

use std::borrow::Cow;
use std::fmt::Write;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};

use super::source::{SourceId, Sources};
use super::{Diagnostic, Severity};

/// Messages shown before the rest is only counted.
const MAX_SHOWN: usize = 20;
/// Labels shown of one message.
const MAX_LABELS: usize = 10;
/// Longest source line shown whole, in characters.
const MAX_COLUMNS: usize = 120;
/// Characters shown before a label on a longer line.
const COLUMNS_BEFORE: usize = 40;
/// Longest title, label or help shown whole, in characters.
const MAX_MESSAGE: usize = 500;
/// Labels farther apart than this get a picture each.
const MAX_GAP: usize = 200;
/// Wider than every line made here, so that only this file cuts lines.
const DRAWING_WIDTH: usize = 100_000;
/// Stands for what is cut off.
const ELLIPSIS: &str = "...";

/// Writes the messages; see [`super::Diagnostics::render`].
pub(super) fn render(list: &[Diagnostic], sources: &Sources, color: bool) -> String {
    let renderer = if color { Renderer::styled() } else { Renderer::plain() };
    let renderer = renderer.term_width(DRAWING_WIDTH);
    let mut shown: Vec<&Diagnostic> = list.iter().collect();
    if shown.len() > MAX_SHOWN {
        shown.sort_by_key(|d| d.severity == Severity::Warning);
        shown.truncate(MAX_SHOWN);
    }
    let mut out = String::new();
    for diagnostic in &shown {
        if !out.is_empty() {
            out.push('\n');
        }
        out.push_str(&render_one(diagnostic, sources, &renderer));
        out.push('\n');
    }
    if list.len() > shown.len() {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "\n... and {} more", list.len() - shown.len());
    }
    out
}

/// Writes one message without a newline at its end.
fn render_one(diagnostic: &Diagnostic, sources: &Sources, renderer: &Renderer) -> String {
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let excerpts = excerpts(diagnostic, sources);
    let title = level.primary_title(message(&diagnostic.message));
    let mut group = Group::with_title(title);
    for excerpt in &excerpts {
        let mut snippet =
            Snippet::source(excerpt.text.as_str()).line_start(excerpt.first_line + 1).path(excerpt.path.as_str());
        for mark in &excerpt.marks {
            let kind = if mark.is_primary { AnnotationKind::Primary } else { AnnotationKind::Context };
            snippet = snippet.annotation(kind.span(mark.start..mark.end).label(mark.text.as_str()));
        }
        group = group.element(snippet);
    }
    let mut help_lines = String::new();
    for help in &diagnostic.help {
        if excerpts.is_empty() {
            let _ = write!(help_lines, "\n  = help: {}", message(help));
        } else {
            group = group.element(Level::HELP.message(message(help)));
        }
    }
    let mut out = renderer.render(&[group]) + help_lines.as_str();
    for fix in excerpts.iter().filter_map(|excerpt| excerpt.column_fix.as_ref()) {
        out = out.replacen(&fix.drawn, &fix.meant, 1);
    }
    let lines: Vec<&str> = out.lines().map(str::trim_end).collect();
    lines.join("\n")
}

/// Some lines of one text, ready to draw.
struct Excerpt {
    /// The text they are from.
    source: SourceId,
    /// Its name.
    path: String,
    /// 0-based number of the first line.
    first_line: usize,
    /// 0-based number of the last line.
    last_line: usize,
    /// Labels, as indices into the message's list, until the text is made.
    labels: Vec<usize>,
    /// Whether its one line is cut, so that nothing else may join it.
    is_cut: bool,
    /// The lines as shown.
    text: String,
    /// What to draw under them.
    marks: Vec<Mark>,
    /// Correction of the column, as annotate-snippets counts it in the cut line.
    column_fix: Option<ColumnFix>,
}

/// A label on an [`Excerpt`].
struct Mark {
    /// Byte range of the excerpt's text.
    start: usize,
    /// See `start`.
    end: usize,
    /// What it says.
    text: String,
    /// Whether it is the first label of the message.
    is_primary: bool,
}

/// Text to replace once in the drawing.
struct ColumnFix {
    /// `path:line:column` with the column in the cut line.
    drawn: String,
    /// The same with the true column.
    meant: String,
}

/// Sorts the labels into excerpts, the primary one first.
fn excerpts(diagnostic: &Diagnostic, sources: &Sources) -> Vec<Excerpt> {
    let mut out: Vec<Excerpt> = Vec::new();
    for (index, (span, _)) in diagnostic.labels.iter().enumerate().take(MAX_LABELS) {
        let Some(place) = sources.place(*span) else {
            continue;
        };
        let is_cut = place.text.chars().nth(MAX_COLUMNS).is_some();
        let joins = |e: &&mut Excerpt| {
            let is_near = place.line + MAX_GAP >= e.first_line && place.line <= e.last_line + MAX_GAP;
            e.source == span.source && !e.is_cut && !is_cut && is_near
        };
        if let Some(excerpt) = out.iter_mut().find(joins) {
            excerpt.first_line = excerpt.first_line.min(place.line);
            excerpt.last_line = excerpt.last_line.max(place.line);
            excerpt.labels.push(index);
            continue;
        }
        out.push(Excerpt {
            source: span.source,
            path: message(sources.name(span.source)).replace('\n', "\u{240a}"),
            first_line: place.line,
            last_line: place.line,
            labels: vec![index],
            is_cut,
            text: String::new(),
            marks: Vec::new(),
            column_fix: None,
        });
    }
    for excerpt in &mut out {
        draw(excerpt, diagnostic, sources);
    }
    out
}

/// Fills the text and marks of an excerpt.
fn draw(excerpt: &mut Excerpt, diagnostic: &Diagnostic, sources: &Sources) {
    for line in excerpt.first_line..=excerpt.last_line {
        if line > excerpt.first_line {
            excerpt.text.push('\n');
        }
        let offset = excerpt.text.len();
        let whole = sources.line(excerpt.source, line);
        let mut window = 0..whole.len();
        if whole.chars().nth(MAX_COLUMNS).is_some() {
            let label = excerpt.labels.first().filter(|_| excerpt.is_cut);
            let place = label.and_then(|&index| sources.place(diagnostic.labels[index].0));
            window = cut_window(whole, place.map_or(0, |place| place.start));
        }
        let cut = if window.start > 0 { ELLIPSIS } else { "" };
        excerpt.text.push_str(cut);
        excerpt.text.push_str(&printable(&whole[window.clone()]));
        excerpt.text.push_str(if window.end < whole.len() { ELLIPSIS } else { "" });
        for &index in &excerpt.labels {
            let (span, text) = &diagnostic.labels[index];
            let Some(place) = sources.place(*span).filter(|place| place.line == line) else {
                continue;
            };
            let drawn = |at: usize| {
                let at = at.clamp(window.start, window.end);
                offset + cut.len() + printable(&whole[window.start..at]).len()
            };
            excerpt.marks.push(Mark {
                start: drawn(place.start),
                end: drawn(place.end),
                text: message(text),
                is_primary: index == 0,
            });
            if window.start > 0 {
                let columns = |to: usize| whole[..to].chars().count() + 1;
                let drawn_column = whole[window.start..place.start].chars().count() + cut.len() + 1;
                let at = format!("{}:{}:", excerpt.path, line + 1);
                excerpt.column_fix = Some(ColumnFix {
                    drawn: format!("{at}{drawn_column}"),
                    meant: format!("{at}{}", columns(place.start)),
                });
            }
        }
    }
    // annotate-snippets does not count an empty last line as a line.
    if excerpt.text.is_empty() || excerpt.text.ends_with('\n') {
        excerpt.text.push(' ');
    }
}

/// The bytes of a long line to show around byte `start`, at most [`MAX_COLUMNS`] characters.
fn cut_window(line: &str, start: usize) -> std::ops::Range<usize> {
    let before = line[..start].char_indices().rev().take(COLUMNS_BEFORE);
    let from = before.last().map_or(start, |(at, _)| at);
    let mut after = line[from..].char_indices();
    let to = after.nth(MAX_COLUMNS).map_or(line.len(), |(at, _)| from + at);
    from..to
}

/// A title, label or help: without control characters, and cut when very long.
fn message(text: &str) -> String {
    match text.char_indices().nth(MAX_MESSAGE) {
        Some((at, _)) => format!("{}{ELLIPSIS}", printable(&text[..at])),
        None => printable(text).into_owned(),
    }
    .replace('\t', "    ")
}

/// Replaces control and text direction characters, one for one, so that columns stay right.
///
/// Tabs stay (annotate-snippets widens them), and newlines, which no source line has.
pub fn printable(text: &str) -> Cow<'_, str> {
    let replacement = |c: char| match c {
        '\t' | '\n' => c,
        '\0'..='\u{1f}' => char::from_u32(0x2400 + u32::from(c)).unwrap_or('\u{fffd}'),
        '\u{7f}' => '\u{2421}',
        '\u{80}'..='\u{9f}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' => '\u{fffd}',
        '\u{2066}'..='\u{2069}' | '\u{feff}' => '\u{fffd}',
        _ => c,
    };
    if text.chars().all(|c| replacement(c) == c) {
        Cow::Borrowed(text)
    } else {
        Cow::Owned(text.chars().map(replacement).collect())
    }
}
