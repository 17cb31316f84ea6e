//! The recursive-descent reader: names and plain values. Brackets are in [`super::brackets`].

use super::number;
use super::scan::{self, Gap};
use super::text::{self, Literal};
use super::{Limits, report};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Span};
use crate::formula::value::{Name, Value, ValueKind};

/// Errors of one text after which reading stops.
const MAX_ERRORS: usize = 100;

/// How far an error reaches. It has been reported already.
pub(super) enum Fail {
    /// The rest of the item, up to the next `,` or closing bracket.
    Item,
    /// The rest of the text.
    Stop,
}

/// What the parts of the reader give back.
pub(super) type Outcome<T> = Result<T, Fail>;

/// Reads one text from front to back.
pub(super) struct Reader<'a> {
    /// The whole text.
    pub text: &'a str,
    /// Next byte to read, on a character border.
    pub at: usize,
    /// The text's id, for spans.
    id: SourceId,
    /// Brackets that are open here, the innermost last, and where.
    pub open: Vec<(char, Span)>,
    /// Whether an inner list, taken as closed, has read the comma after it.
    pub has_read_comma: bool,
    /// Sizes that end the reading.
    pub limits: &'a Limits,
    /// Values seen.
    values: usize,
    /// Errors reported.
    errors: usize,
    /// Where they go.
    diagnostics: &'a mut Diagnostics,
}

impl<'a> Reader<'a> {
    /// Starts at the front of a text.
    pub fn new(text: &'a str, id: SourceId, limits: &'a Limits, diagnostics: &'a mut Diagnostics) -> Self {
        Self { text, at: 0, id, open: Vec::new(), has_read_comma: false, limits, values: 0, errors: 0, diagnostics }
    }

    /// Reads attributes, one value and the end of the text.
    pub fn document(mut self) -> Option<Value> {
        let value = self.skip_gap().and_then(|()| {
            self.attributes()?;
            let value = self.value()?;
            self.skip_gap()?;
            Ok(value)
        });
        let value = value.ok()?;
        if self.at < self.text.len() && self.errors == 0 {
            let diagnostic = report::after_end(&self, &value);
            self.report(diagnostic);
        }
        Some(value)
    }

    // Small steps.

    /// Text not yet read.
    pub fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    /// Next character.
    pub fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    /// Span from a byte to the next byte to read.
    pub fn span_from(&self, start: usize) -> Span {
        self.span(start, self.at)
    }

    /// Span of a byte range.
    pub fn span(&self, start: usize, end: usize) -> Span {
        Span::new(self.id, start, end)
    }

    /// Reads a character if it is the next one.
    pub fn eat(&mut self, wanted: char) -> bool {
        let is_next = self.rest().starts_with(wanted);
        if is_next {
            self.at += wanted.len_utf8();
        }
        is_next
    }

    /// Pushes an error; `Fail::Stop` if it was one too many.
    pub fn report(&mut self, diagnostic: Diagnostic) -> Fail {
        self.diagnostics.push(diagnostic);
        self.errors += 1;
        if self.errors < MAX_ERRORS { Fail::Item } else { Fail::Stop }
    }

    /// Pushes an error that leaves the reading where it is.
    pub fn report_and_go_on(&mut self, diagnostic: Diagnostic) -> Outcome<()> {
        match self.report(diagnostic) {
            Fail::Item => Ok(()),
            Fail::Stop => Err(Fail::Stop),
        }
    }

    /// Pushes "expected ..., found ..." for the next token.
    pub fn fail_expected(&mut self, expected: &str) -> Fail {
        let diagnostic = report::expected(self, expected);
        let at_end = self.at == self.text.len();
        let fail = self.report(diagnostic);
        if at_end { Fail::Stop } else { fail }
    }

    /// Skips white space and comments.
    pub fn skip_gap(&mut self) -> Outcome<()> {
        match scan::gap(self.rest()) {
            Gap::Skipped(len) => {
                self.at += len;
                Ok(())
            }
            Gap::Unclosed(len) => {
                let start = self.at + len;
                let label = "this comment is never closed";
                self.report(
                    Diagnostic::error("expected `*/`, found end of file").label(self.span(start, start + 2), label),
                );
                Err(Fail::Stop)
            }
        }
    }

    /// Next character after white space and comments, without reading them.
    pub fn peek_past_gap(&self, from: usize) -> Option<char> {
        match scan::gap(&self.text[from..]) {
            Gap::Skipped(len) => self.text[from + len..].chars().next(),
            Gap::Unclosed(_) => None,
        }
    }

    // Values.

    /// Reads one value; white space before it has been read.
    pub fn value(&mut self) -> Outcome<Value> {
        let start = self.at;
        let rest = self.rest();
        self.values += 1;
        if self.values > self.limits.values {
            let message = format!("the file has more than {} values", self.limits.values);
            self.report(Diagnostic::error(message).label(self.span(start, start), "stopped reading here"));
            return Err(Fail::Stop);
        }
        let kind = match rest.chars().next() {
            Some('(') => return self.parens(start, None),
            Some('[') => self.list()?,
            Some('{') => self.map()?,
            Some('\'') => self.char()?,
            Some(_) if scan::is_string_start(rest) => self.string()?,
            Some(_) if scan::is_byte_start(rest) => {
                let diagnostic = Diagnostic::error("byte strings have no use in formula files")
                    .label(self.span(start, start + 1), "this `b` makes it one")
                    .help("leave the `b` out");
                return Err(self.report(diagnostic));
            }
            Some(_) if scan::number_len(rest) > 0 => self.number()?,
            Some(_) if scan::name_len(rest) > 0 => return self.named(start),
            _ => return Err(self.fail_expected("a value")),
        };
        Ok(Value::new(self.span_from(start), kind))
    }

    /// Reads a string in any spelling.
    pub fn string(&mut self) -> Outcome<ValueKind> {
        match text::read_string(self.rest()) {
            Some(literal) => self.literal(literal),
            None => {
                let quote = self.rest().find('"').unwrap_or(0);
                let span = self.span(self.at, self.at + quote + 1);
                let diagnostic = Diagnostic::error("this string is never closed").label(span, "opened here");
                self.report(diagnostic);
                Err(Fail::Stop)
            }
        }
    }

    /// Reads a character.
    fn char(&mut self) -> Outcome<ValueKind> {
        match text::read_char(self.rest()) {
            Some(literal) => self.literal(literal),
            None => {
                let diagnostic = Diagnostic::error("this is not one character in quotes")
                    .label(self.span(self.at, self.at + 1), "opened here")
                    .help("write strings in double quotes");
                self.at += 1;
                Err(self.report(diagnostic))
            }
        }
    }

    /// Reports a literal's faults and steps over it.
    fn literal(&mut self, literal: Literal) -> Outcome<ValueKind> {
        let is_good = literal.faults.is_empty();
        for (range, fault) in literal.faults {
            let span = self.span(self.at + range.start, self.at + range.end);
            self.report_and_go_on(Diagnostic::error("a string or character is misspelled").label(span, fault))?;
        }
        self.at += literal.len;
        Ok(if is_good { ValueKind::Str(literal.value) } else { ValueKind::Invalid })
    }

    /// Reads a number.
    fn number(&mut self) -> Outcome<ValueKind> {
        let len = scan::number_len(self.rest());
        self.number_of_len(len)
    }

    /// Reads the next bytes as a number, and reports it if it is none or not finite.
    fn number_of_len(&mut self, len: usize) -> Outcome<ValueKind> {
        let text = &self.rest()[..len];
        let start = self.at;
        self.at += len;
        match number::parse_number(text) {
            Ok(number) => Ok(ValueKind::Number(number)),
            Err(error) => {
                let diagnostic = report::bad_number(text, &error, self.span_from(start));
                self.report_and_go_on(diagnostic)?;
                Ok(ValueKind::Invalid)
            }
        }
    }

    /// Reads a value that starts with an identifier.
    fn named(&mut self, start: usize) -> Outcome<Value> {
        let len = scan::name_len(self.rest());
        let word = &self.rest()[..len];
        if number::is_not_finite_name(word) {
            let kind = self.number_of_len(len)?;
            return Ok(Value::new(self.span_from(start), kind));
        }
        let name = self.name()?;
        let is_called = self.peek_past_gap(self.at) == Some('(');
        let kind = match word {
            "true" => ValueKind::Bool(true),
            "false" => ValueKind::Bool(false),
            _ if is_called => {
                self.skip_gap()?;
                return Ok(without_some(self.parens(start, Some(name))?));
            }
            _ => ValueKind::Variant(name),
        };
        Ok(Value::new(self.span_from(start), kind))
    }

    /// Reads an identifier that is known to start here.
    pub fn name(&mut self) -> Outcome<Name> {
        let start = self.at;
        let len = scan::name_len(self.rest());
        let loose = scan::loose_name_len(self.rest());
        let word = &self.rest()[..len];
        if let Some(text) = word.strip_prefix("r#") {
            self.at += len;
            return Ok(Name::new(self.span_from(start), text));
        }
        self.at += loose;
        let text = &self.text[start..self.at];
        if loose > len {
            let diagnostic = Diagnostic::error(format!("`{text}` is not an identifier"))
                .label(self.span(start + len, self.at), "letters, digits and `_` only")
                .help(format!("if this is meant as a name, write `r#{text}`"));
            self.report_and_go_on(diagnostic)?;
        }
        Ok(Name::new(self.span_from(start), text))
    }
}

/// `x` of `Some(x)`, and any other value as it is.
fn without_some(mut value: Value) -> Value {
    match &mut value.kind {
        ValueKind::Tuple { name: Some(name), items } if name.text == "Some" && items.len() == 1 => {
            items.pop().unwrap_or(value)
        }
        ValueKind::Struct { name, .. } if name.as_ref().is_some_and(|name| name.text == "Some") => {
            *name = None;
            value
        }
        _ => value,
    }
}
