//! The reader's messages.

use super::number::NumberError;
use super::reader::Reader;
use super::scan;
use crate::diag::{Diagnostic, Span};
use crate::formula::value::{Value, ValueKind};

/// Characters of a word shown in a message.
const MAX_WORD: usize = 30;

/// "expected ..., found ..." for the next token, with the bracket that is open there if the next token
/// closes the wrong one or is the end.
pub(super) fn expected(reader: &Reader<'_>, expected: &str) -> Diagnostic {
    let rest = reader.rest();
    let len = token_len(rest);
    let span = reader.span(reader.at, reader.at + len);
    let found = match rest.chars().next() {
        None => "end of file".into(),
        Some(_) if scan::is_string_start(rest) => "a string".into(),
        Some(_) => quoted(&rest[..len]),
    };
    let diagnostic = Diagnostic::error(format!("expected {expected}, found {found}"));
    let diagnostic = diagnostic.label(span, format!("expected {expected}"));
    let closed = match rest.chars().next() {
        Some(')') => Some('('),
        Some(']') => Some('['),
        Some('}') => Some('{'),
        _ => None,
    };
    let diagnostic = match reader.open.last() {
        Some((bracket, place)) if rest.is_empty() || closed.is_some_and(|b| b != *bracket) => {
            diagnostic.label(*place, format!("this `{bracket}` is not closed"))
        }
        _ => diagnostic,
    };
    match rest.chars().next() {
        Some('{') if reader.text[..reader.at].ends_with(scan::is_name_char) => {
            diagnostic.help("write fields in round brackets: `Name( ... )`")
        }
        Some('=') => diagnostic.help("write `name: value`, with a colon"),
        Some(':') => diagnostic.help("write `name: value` for all items of the brackets or for none"),
        Some(';') => diagnostic.help("items stand apart by `,`"),
        Some('/') => diagnostic.help("comments are `// ...` and `/* ... */`"),
        Some('#') => diagnostic.help("comments start with `//`"),
        _ => diagnostic,
    }
}

/// A list in which a field of the struct around it follows.
pub(super) fn unclosed_before_field(reader: &Reader<'_>) -> Diagnostic {
    let diagnostic = expected(reader, "`]`");
    match reader.open.last() {
        Some((_, place)) => diagnostic.label(*place, "this `[` is not closed"),
        None => diagnostic,
    }
}

/// Bytes of the next token, as far as a message marks it.
fn token_len(rest: &str) -> usize {
    let word = scan::name_len(rest).max(scan::number_len(rest));
    if word > 0 { word } else { rest.chars().next().map_or(0, char::len_utf8) }
}

/// A word of the text in quotes, cut if long.
fn quoted(word: &str) -> String {
    match word.char_indices().nth(MAX_WORD) {
        Some((at, _)) => format!("`{}...`", &word[..at]),
        None => format!("`{word}`"),
    }
}

/// Text after the one value of a file.
pub(super) fn after_end(reader: &Reader<'_>, value: &Value) -> Diagnostic {
    let diagnostic = expected(reader, "end of file").label(value.span, "the file's value");
    let mut diagnostic = Diagnostic { help: Vec::new(), ..diagnostic };
    let is_name = matches!(value.kind, ValueKind::Variant(_));
    diagnostic = match reader.rest().chars().next() {
        Some(':') if is_name => diagnostic.help("put the fields into brackets: `( name: value, ... )`"),
        Some('{') if is_name => diagnostic.help("write fields in round brackets: `Name( ... )`"),
        _ => diagnostic.help("a file holds one value"),
    };
    diagnostic
}

/// A number that cannot be used.
pub(super) fn bad_number(text: &str, error: &NumberError, span: Span) -> Diagnostic {
    let word = quoted(text);
    let (message, label) = match error {
        NumberError::Malformed => (format!("{word} is not a number"), "not spelled like one"),
        NumberError::TooLarge => (format!("the number {word} is too large"), "cannot be stored"),
        NumberError::NotFinite => (format!("numbers must be finite, but this is {word}"), "not finite"),
    };
    Diagnostic::error(message).label(span, label)
}

/// A field or key that stands twice in the same brackets.
pub(super) fn doubled(what: &str, second: Span, first: Span) -> Diagnostic {
    Diagnostic::error(format!("{what} is given twice"))
        .label(second, "given again here")
        .label(first, "first given here")
}

/// Text that is the same for equal map keys and no others.
pub(super) fn key_text(key: &Value) -> String {
    let list = |items: &[Value]| items.iter().map(key_text).collect::<Vec<_>>().join(", ");
    let pair = |left: String, right: &Value| format!("{left}: {}", key_text(right));
    match &key.kind {
        ValueKind::Unit => "()".into(),
        ValueKind::Bool(bool) => bool.to_string(),
        // Adding zero makes -0 and 0 the same key.
        ValueKind::Number(number) => (number + 0.0).to_string(),
        ValueKind::Str(text) => format!("{text:?}"),
        ValueKind::List(items) => format!("[{}]", list(items)),
        ValueKind::Tuple { name, items } => {
            format!("{}({})", name.as_ref().map_or("", |name| &name.text), list(items))
        }
        ValueKind::Struct { name, fields } => {
            let fields: Vec<_> = fields.iter().map(|(name, value)| pair(name.text.clone(), value)).collect();
            format!("{}({})", name.as_ref().map_or("", |name| &name.text), fields.join(", "))
        }
        ValueKind::Map(entries) => {
            let entries: Vec<_> = entries.iter().map(|(key, value)| pair(key_text(key), value)).collect();
            format!("{{{}}}", entries.join(", "))
        }
        ValueKind::Variant(name) => name.text.clone(),
        // No two are the same: each was reported already.
        ValueKind::Invalid => format!("invalid at {}", key.span.start),
    }
}
