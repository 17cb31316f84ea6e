//! Reads string and character literals.

use std::ops::Range;

use super::scan;

/// Faults kept of one literal.
const MAX_FAULTS: usize = 10;

/// A literal and what is wrong with it.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Literal {
    /// Bytes of source text, quotes included.
    pub len: usize,
    /// The text that it stands for; wrong escapes are left out.
    pub value: String,
    /// Byte ranges of the source text, and what is wrong there.
    pub faults: Vec<(Range<usize>, &'static str)>,
}

/// Reads the string (`"..."`, `r"..."`, `r#"..."#`) that `text` starts with; `None` if it does not end.
pub(super) fn read_string(text: &str) -> Option<Literal> {
    let Some(hashes) = scan::raw_string_hashes(text) else {
        return read_quoted(text);
    };
    let start = hashes + 2;
    let end = format!("\"{}", "#".repeat(hashes));
    let len = text[start..].find(&end)?;
    Some(Literal { len: start + len + end.len(), value: text[start..start + len].to_owned(), faults: Vec::new() })
}

/// Reads a string in plain quotes.
fn read_quoted(text: &str) -> Option<Literal> {
    let mut literal = Literal::default();
    let mut at = 1;
    loop {
        let plain = text[at..].find(['"', '\\'])?;
        literal.value.push_str(&text[at..at + plain]);
        at += plain;
        if text[at..].starts_with('"') {
            literal.len = at + 1;
            return Some(literal);
        }
        at += read_continuation(&text[at..]).unwrap_or_else(|| push_escape(&mut literal, text, at, false));
    }
}

/// Bytes of a backslash at the end of a line and the white space after it.
fn read_continuation(text: &str) -> Option<usize> {
    let rest = text.strip_prefix("\\\r\n").or(text.strip_prefix("\\\n"))?;
    let spaces = scan::run(rest, |c| matches!(c, ' ' | '\t' | '\n' | '\r'));
    Some(text.len() - rest.len() + spaces)
}

/// Reads the escape at byte `at` into the literal; gives its length.
fn push_escape(literal: &mut Literal, text: &str, at: usize, is_char: bool) -> usize {
    match read_escape(&text[at..], is_char) {
        Ok((c, len)) => {
            literal.value.push(c);
            len
        }
        Err((len, fault)) => {
            if literal.faults.len() < MAX_FAULTS {
                literal.faults.push((at..at + len, fault));
            }
            len
        }
    }
}

/// Reads the character (`'c'`) that `text` starts with; `None` if it does not end.
pub(super) fn read_char(text: &str) -> Option<Literal> {
    let mut literal = Literal::default();
    let first = text[1..].chars().next().filter(|c| *c != '\n')?;
    let len = if first == '\\' {
        push_escape(&mut literal, text, 1, true)
    } else {
        literal.value.push(first);
        first.len_utf8()
    };
    if text[1 + len..].starts_with('\'') {
        literal.len = len + 2;
        return Some(literal);
    }
    let fault = "this is not one character; write strings in double quotes";
    let len = scan::char_len(text)?;
    literal.faults = vec![(0..len, fault)];
    literal.len = len;
    Some(literal)
}

/// Reads an escape, backslash included: the character and its bytes of source, or the bytes that are
/// wrong and why.
fn read_escape(text: &str, is_char: bool) -> Result<(char, usize), (usize, &'static str)> {
    let Some(kind) = text[1..].chars().next() else {
        return Err((1, "an escape is missing after `\\`"));
    };
    let c = match kind {
        '\'' | '"' | '\\' => kind,
        'n' => '\n',
        'r' => '\r',
        't' => '\t',
        '0' => '\0',
        'x' => return read_byte_escape(text, is_char),
        'u' => return read_unicode_escape(text),
        _ => return Err((1 + kind.len_utf8(), "unknown escape; `\\\\` is a backslash")),
    };
    Ok((c, 2))
}

/// Reads `\x41`, or in strings up to four of them that are one character in UTF-8.
fn read_byte_escape(text: &str, is_char: bool) -> Result<(char, usize), (usize, &'static str)> {
    let mut bytes = Vec::new();
    while bytes.len() < 4 {
        let at = bytes.len() * 4;
        let digits = text[at..].strip_prefix("\\x").and_then(|rest| rest.get(..2));
        let Some(byte) = digits.and_then(parse_hex) else {
            break;
        };
        bytes.push(byte as u8);
        let decoded = std::str::from_utf8(&bytes).ok().and_then(|s| s.chars().next());
        if let Some(c) = decoded {
            return Ok((c, at + 4));
        }
        if is_char {
            break;
        }
    }
    match bytes.len() {
        0 => Err((2, "`\\x` needs two hexadecimal digits")),
        n => Err((n * 4, "these bytes are not a character in UTF-8")),
    }
}

/// Reads `\u{1F600}`.
fn read_unicode_escape(text: &str) -> Result<(char, usize), (usize, &'static str)> {
    let Some(rest) = text[2..].strip_prefix('{') else {
        return Err((2, "`\\u` needs one to six hexadecimal digits in braces"));
    };
    let len = rest.bytes().take(7).take_while(u8::is_ascii_hexdigit).count();
    if len == 0 || len > 6 || !rest[len..].starts_with('}') {
        return Err((3 + len, "`\\u` needs one to six hexadecimal digits in braces"));
    }
    let c = parse_hex(&rest[..len]).and_then(char::from_u32);
    c.map(|c| (c, len + 4)).ok_or((len + 4, "there is no character of this number"))
}

/// Reads hexadecimal digits and nothing else.
fn parse_hex(digits: &str) -> Option<u32> {
    let is_hex = digits.bytes().all(|b| b.is_ascii_hexdigit());
    if is_hex { u32::from_str_radix(digits, 16).ok() } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The text of a literal that ends with the source and has no faults.
    fn read(source: &str) -> Option<String> {
        let reader = if source.starts_with('\'') { read_char } else { read_string };
        reader(source).filter(|l| l.len == source.len() && l.faults.is_empty()).map(|l| l.value)
    }

    #[test]
    fn literals_in_every_spelling() {
        for (source, value) in [
            (r#""""#, ""),
            (r#""a b""#, "a b"),
            (r#""\"\\\n\t\r\0\'""#, "\"\\\n\t\r\0'"),
            (r#""\x41\u{1F600}é""#, "A😀é"),
            (r#""\xc3\xa9""#, "é"),
            ("\"a\\\n   b\"", "ab"),
            ("\"a\nb\"", "a\nb"),
            (r#"r"\n""#, "\\n"),
            ("r##\"a\"#b\"##", "a\"#b"),
            ("'x'", "x"),
            (r"'\''", "'"),
            (r"'\u{e9}'", "é"),
            ("'''", "'"),
            ("'é'", "é"),
        ] {
            assert_eq!(read(source).as_deref(), Some(value), "{source}");
        }
    }

    #[test]
    fn faults_have_places() {
        for (source, range) in [
            (r#""a\qb""#, 2..4),
            (r#""\x4""#, 1..3),
            (r#""\xff\xff""#, 1..9),
            (r#""\u{}""#, 1..4),
            (r#""\u{1234567}""#, 1..11),
            (r#""\u{d800}""#, 1..9),
            (r#""\é""#, 1..4),
            (r#""\x4é""#, 1..3),
            ("'ab'", 0..4),
            ("''", 0..0),
            (r"'\xc3'", 1..5),
        ] {
            let reader = if source.starts_with('\'') { read_char } else { read_string };
            let found = reader(source).map(|l| l.faults[0].0.clone());
            assert_eq!(found.unwrap_or(0..0), range, "{source}");
        }
        for source in ["\"abc", "\"abc\\\"", "r#\"abc\"", "'", "'a", "'\\", "'\n'", "\"\\"] {
            let reader = if source.starts_with('\'') { read_char } else { read_string };
            assert_eq!(reader(source), None, "{source}");
        }
    }
}
