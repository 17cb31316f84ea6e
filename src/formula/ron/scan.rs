//! Cuts RON text into white space, identifiers and other words. Knows nothing of values.

/// Whether RON skips this character between tokens.
pub(super) fn is_space(c: char) -> bool {
    matches!(c, ' ' | '\t'..='\r' | '\u{85}' | '\u{200e}' | '\u{200f}' | '\u{2028}' | '\u{2029}' | '\u{feff}')
}

/// Whether an identifier may start with this character.
pub(super) fn is_name_start(c: char) -> bool {
    c == '_' || c.is_alphabetic()
}

/// Whether an identifier may go on with this character.
pub(super) fn is_name_char(c: char) -> bool {
    c == '_' || c.is_alphanumeric()
}

/// Whether an identifier after `r#` may have this character.
pub(super) fn is_raw_name_char(c: char) -> bool {
    is_name_char(c) || matches!(c, '.' | '+' | '-')
}

/// Bytes at the start of `text` whose characters all are of a kind.
pub(super) fn run(text: &str, is_of_kind: impl Fn(char) -> bool) -> usize {
    text.find(|c| !is_of_kind(c)).unwrap_or(text.len())
}

/// What stands between tokens.
pub(super) enum Gap {
    /// White space and comments of this many bytes, maybe none.
    Skipped(usize),
    /// A block comment starts at this byte and never ends.
    Unclosed(usize),
}

/// Measures the white space and comments at the start of `text`.
pub(super) fn gap(text: &str) -> Gap {
    let mut at = 0;
    loop {
        at += run(&text[at..], is_space);
        let rest = &text[at..];
        if rest.starts_with("//") {
            at += run(rest, |c| c != '\n');
        } else if rest.starts_with("/*") {
            match block_comment(rest) {
                Some(len) => at += len,
                None => return Gap::Unclosed(at),
            }
        } else {
            return Gap::Skipped(at);
        }
    }
}

/// Bytes of the (nested) block comment that `text` starts with, `None` if it does not end.
fn block_comment(text: &str) -> Option<usize> {
    let bytes = text.as_bytes();
    let (mut at, mut depth) = (0, 0_usize);
    while at < bytes.len() {
        if bytes[at..].starts_with(b"/*") {
            depth += 1;
            at += 2;
        } else if bytes[at..].starts_with(b"*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return Some(at);
            }
        } else {
            at += 1;
        }
    }
    None
}

/// Bytes of the identifier that `text` starts with (`r#` included), 0 if it starts with none.
pub(super) fn name_len(text: &str) -> usize {
    if is_string_start(text) || is_byte_start(text) {
        return 0;
    }
    if let Some(raw) = text.strip_prefix("r#") {
        let len = run(raw, is_raw_name_char);
        return if len > 0 { len + 2 } else { 0 };
    }
    if text.starts_with(is_name_start) { run(text, is_name_char) } else { 0 }
}

/// The same with the `.`, `+` and `-` after it that people may take for part of it.
pub(super) fn loose_name_len(text: &str) -> usize {
    match name_len(text) {
        0 => 0,
        len => len.max(run(text, is_raw_name_char)),
    }
}

/// Whether a string in any spelling starts here (not a byte string).
pub(super) fn is_string_start(text: &str) -> bool {
    text.starts_with('"') || raw_string_hashes(text).is_some()
}

/// Number of `#` of the raw string that starts here.
///
/// More than 255 count as none, as in Rust; that also keeps looking ahead cheap.
pub(super) fn raw_string_hashes(text: &str) -> Option<usize> {
    let rest = text.strip_prefix('r')?;
    let hashes = rest.bytes().take(256).take_while(|&b| b == b'#').count();
    rest[hashes..].starts_with('"').then_some(hashes)
}

/// Whether a byte string or byte literal starts here.
pub(super) fn is_byte_start(text: &str) -> bool {
    text.strip_prefix('b').is_some_and(|rest| rest.starts_with(['"', '\'']) || raw_string_hashes(rest).is_some())
}

/// Whether a value could start here.
pub(super) fn is_value_start(text: &str) -> bool {
    let is_bracket_or_quote = text.starts_with(['(', '[', '{', '\'', '"']);
    is_bracket_or_quote || is_string_start(text) || is_byte_start(text) || number_len(text) > 0 || name_len(text) > 0
}

/// Bytes of the number, well-formed or not, that `text` starts with: a sign and everything that could
/// belong to it. 0 if it starts with none.
pub(super) fn number_len(text: &str) -> usize {
    let sign = usize::from(text.starts_with(['+', '-']));
    let digits = &text[sign..];
    if sign == 0 && !digits.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        return 0;
    }
    let has_prefix = ["0x", "0o", "0b"].iter().any(|prefix| digits.starts_with(prefix));
    let mut before = ' ';
    let len = digits.find(|c| {
        let is_exponent_sign = matches!(c, '+' | '-') && matches!(before, 'e' | 'E') && !has_prefix;
        before = c;
        !(is_name_char(c) || c == '.' || is_exponent_sign)
    });
    sign + len.unwrap_or(digits.len())
}

/// Bytes to skip after an error: up to the next `,` or closing bracket outside inner brackets, strings
/// and comments, or the end.
pub(super) fn skip_len(text: &str) -> usize {
    let (mut at, mut depth) = (0, 0_usize);
    while let Some(c) = text[at..].chars().next() {
        let rest = &text[at..];
        match c {
            ',' | ')' | ']' | '}' if depth == 0 => return at,
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            _ => {}
        }
        let len = match c {
            '/' => match gap(rest) {
                Gap::Skipped(len) => len.max(1),
                Gap::Unclosed(_) => rest.len(),
            },
            '"' | 'r' if is_string_start(rest) => string_len(rest),
            '\'' => char_len(rest).unwrap_or(1),
            _ if is_name_start(c) => name_len(rest).max(1),
            _ => c.len_utf8(),
        };
        at += len;
    }
    at
}

/// Bytes of the string that `text` starts with, all of it if the string does not end.
fn string_len(text: &str) -> usize {
    if let Some(hashes) = raw_string_hashes(text) {
        let end = format!("\"{}", "#".repeat(hashes));
        let start = hashes + 2;
        let len = text[start..].find(&end);
        return len.map_or(text.len(), |len| start + len + end.len());
    }
    let mut escaped = false;
    for (at, byte) in text.bytes().enumerate().skip(1) {
        match byte {
            b'"' if !escaped => return at + 1,
            _ => escaped = byte == b'\\' && !escaped,
        }
    }
    text.len()
}

/// Bytes of the character literal that `text` starts with; at most 12 are looked at.
pub(super) fn char_len(text: &str) -> Option<usize> {
    let mut chars = text.char_indices().skip(1).take(12);
    let (_, first) = chars.next()?;
    if first == '\\' {
        chars.next()?;
    }
    chars.take_while(|(_, c)| *c != '\n').find(|(_, c)| *c == '\'').map(|(at, _)| at + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_end_where_they_should() {
        for (text, len) in [
            ("abc:", 3),
            ("r#a-b.c d", 7),
            ("r#", 0),
            ("r\"x\"", 0),
            ("b'x'", 0),
            ("br_x(", 4),
            ("größe ", 7),
            ("1a", 0),
        ] {
            assert_eq!(name_len(text), len, "{text}");
        }
    }

    #[test]
    fn numbers_end_where_they_should() {
        for (text, len) in
            [("-1.5e-3f32,", 10), ("0xe+1", 3), (".5]", 2), ("1_000 ", 5), ("x", 0), ("-", 1), ("1-2", 1)]
        {
            assert_eq!(number_len(text), len, "{text}");
        }
    }

    #[test]
    fn skipping_sees_brackets_strings_and_comments() {
        for (text, len) in [
            ("a, b", 1),
            ("a(1, 2), b", 7),
            ("\"a,\\\",\" ]", 8),
            ("/*,*/ // ,\n'a)'}", 15),
            ("r#\",\"#,", 6),
            ("')',", 3),
            ("abc", 3),
        ] {
            assert_eq!(skip_len(text), len, "{text}");
        }
    }
}
