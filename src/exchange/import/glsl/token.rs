//! The words of GLSL: comments and lines of the preprocessor taken out, simple definitions put in.

use std::collections::HashMap;

/// Binary operators, loosest first.
pub const OPERATORS: &[&[&str]] = &[
    &["||"],
    &["^^"],
    &["&&"],
    &["|"],
    &["^"],
    &["&"],
    &["==", "!="],
    &["<=", ">=", "<", ">"],
    &["<<", ">>"],
    &["+", "-"],
    &["*", "/", "%"],
];

/// A word with its line, from 1.
#[derive(Clone, PartialEq, Debug)]
pub struct Token {
    /// What it is.
    pub kind: Kind,
    /// Line of the text.
    pub line: usize,
}

/// Kinds of words.
#[derive(Clone, PartialEq, Debug)]
pub enum Kind {
    /// A name or a keyword.
    Name(String),
    /// A whole number.
    Int(i64),
    /// A number with a point or an exponent.
    Float(f64),
    /// An operator or a bracket.
    Sign(&'static str),
}

/// Operators and brackets, longest first.
const SIGNS: &[&str] = &[
    "<<=", ">>=", "++", "--", "+=", "-=", "*=", "/=", "%=", "&=", "|=", "^=", "==", "!=", "<=", ">=", "&&", "||", "^^",
    "<<", ">>", "+", "-", "*", "/", "%", "<", ">", "=", "!", "&", "|", "^", "~", "?", ":", ";", ",", ".", "(", ")",
    "[", "]", "{", "}",
];

/// Most words after definitions are put in.
const MAX_TOKENS: usize = 400_000;

/// Words of a shader. `#preset` blocks and lines that begin with `#` are left out; `#define NAME words` and `#ifdef` of such
/// names are followed. The error names the line.
pub fn tokens(text: &str) -> Result<Vec<Token>, String> {
    let text = without_comments(text);
    let mut defined: HashMap<String, Vec<Token>> = HashMap::new();
    let mut found = Vec::new();
    let mut in_preset = false;
    let mut conditions: Vec<bool> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let (line, number) = (line.trim(), i + 1);
        let Some(directive) = line.strip_prefix('#') else {
            if !in_preset && conditions.iter().all(|holds| *holds) {
                // Behind a uniform stands its slider.
                let is_uniform = line.starts_with("uniform");
                let end = line.find(';').filter(|_| is_uniform).map_or(line.len(), |at| at + 1);
                words(&line[..end], number, &defined, &mut found)?;
            }
            continue;
        };
        let directive = directive.trim();
        let lower = directive.to_lowercase();
        let mut parts = directive.split_whitespace();
        let (command, name) = (parts.next().unwrap_or(""), parts.next().unwrap_or("").to_string());
        match command {
            _ if lower.starts_with("preset") => in_preset = true,
            _ if lower.starts_with("endpreset") => in_preset = false,
            "ifdef" => conditions.push(defined.contains_key(&name)),
            "ifndef" => conditions.push(!defined.contains_key(&name)),
            "if" => conditions.push(name != "0"),
            "else" => {
                if let Some(last) = conditions.last_mut() {
                    *last = !*last;
                }
            }
            "endif" => {
                conditions.pop();
            }
            "define" if conditions.iter().all(|holds| *holds) => {
                let mut value = Vec::new();
                // Definitions with arguments are not followed: their use is an unknown function.
                if !name.contains('(') {
                    let rest = directive.split_once(&name).map_or("", |(_, rest)| rest);
                    words(rest, number, &defined, &mut value)?;
                }
                defined.insert(name, value);
            }
            _ => {}
        }
    }
    Ok(found)
}

fn without_comments(text: &str) -> String {
    let mut kept = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('/') {
        let end = match rest.as_bytes().get(at + 1) {
            Some(b'*') => rest[at..].find("*/").map_or(rest.len(), |i| at + i + 2),
            Some(b'/') => rest[at..].find('\n').map_or(rest.len(), |i| at + i),
            _ => {
                kept.push_str(&rest[..=at]);
                rest = &rest[at + 1..];
                continue;
            }
        };
        kept.push_str(&rest[..at]);
        // Lines keep their numbers.
        kept.extend(rest[at..end].chars().filter(|c| *c == '\n'));
        kept.push(' ');
        rest = &rest[end..];
    }
    kept + rest
}

fn words(
    line: &str,
    number: usize,
    defined: &HashMap<String, Vec<Token>>,
    found: &mut Vec<Token>,
) -> Result<(), String> {
    let mut rest = line;
    while let Some(c) = rest.chars().next() {
        if found.len() > MAX_TOKENS {
            return Err(format!("line {number}: the code is too long"));
        }
        let end = match c {
            _ if c.is_whitespace() => {
                rest = &rest[c.len_utf8()..];
                continue;
            }
            _ if c.is_ascii_alphabetic() || c == '_' => {
                let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
                match defined.get(&rest[..end]) {
                    Some(value) => found.extend(value.iter().map(|token| Token { line: number, ..token.clone() })),
                    None => found.push(Token { kind: Kind::Name(rest[..end].to_string()), line: number }),
                }
                end
            }
            _ if c.is_ascii_digit() || (c == '.' && rest[1..].starts_with(|c: char| c.is_ascii_digit())) => {
                let (kind, end) = numeral(rest).ok_or_else(|| format!("line {number}: a number cannot be read"))?;
                found.push(Token { kind, line: number });
                end
            }
            _ => {
                let sign = SIGNS.iter().find(|sign| rest.starts_with(**sign));
                let sign = sign.ok_or_else(|| format!("line {number}: the character `{c}` is not known"))?;
                found.push(Token { kind: Kind::Sign(sign), line: number });
                sign.len()
            }
        };
        rest = &rest[end..];
    }
    Ok(())
}

fn numeral(text: &str) -> Option<(Kind, usize)> {
    let bytes = text.as_bytes();
    let mut end = 0;
    while let Some(byte) = bytes.get(end) {
        let is_sign = matches!(byte, b'+' | b'-') && end > 0 && matches!(bytes[end - 1], b'e' | b'E');
        if !(byte.is_ascii_digit() || matches!(byte, b'.' | b'e' | b'E') || is_sign) {
            break;
        }
        end += 1;
    }
    let digits = &text[..end];
    let suffix = text[end..].find(|c: char| !matches!(c, 'f' | 'F' | 'u' | 'l' | 'L')).unwrap_or(text.len() - end);
    let is_float = digits.contains(['.', 'e', 'E']) || text[end..end + suffix].contains(['f', 'F']);
    let kind = if is_float { Kind::Float(digits.parse().ok()?) } else { Kind::Int(digits.parse().ok()?) };
    Some((kind, end + suffix))
}
