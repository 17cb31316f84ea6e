//! Tuples, structs, lists and maps, and how to go on after an error in them.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::reader::{Fail, Outcome, Reader};
use super::{report, scan};
use crate::diag::{Diagnostic, Span};
use crate::formula::value::{Name, Value, ValueKind};

/// Depth that the program's own stack surely bears.
const MAX_DEPTH: usize = 256;

/// What stands between two brackets.
struct Shape {
    /// The closing one.
    close: char,
    /// One item, with article.
    item: &'static str,
    /// Whether an item could start with this text.
    starts_item: fn(&str) -> bool,
}

/// Items of a tuple.
const TUPLE: Shape = Shape { close: ')', item: "a value", starts_item: scan::is_value_start };
/// Items of a list.
const LIST: Shape = Shape { close: ']', item: "a value", starts_item: scan::is_value_start };
/// Entries of a map.
const MAP: Shape = Shape { close: '}', item: "a key", starts_item: scan::is_value_start };
/// Fields of a struct.
const STRUCT: Shape = Shape { close: ')', item: "a field", starts_item: |text| scan::name_len(text) > 0 };

impl Reader<'_> {
    /// Reads an opening bracket.
    fn open(&mut self, bracket: char) -> Outcome<()> {
        let start = self.at;
        self.at += 1;
        let span = self.span_from(start);
        let depth = self.limits.depth.min(MAX_DEPTH);
        if self.open.len() >= depth {
            let message = format!("brackets are nested more than {depth} deep");
            self.report(Diagnostic::error(message).label(span, "one too many"));
            return Err(Fail::Stop);
        }
        self.open.push((bracket, span));
        Ok(())
    }

    /// Reads unit, tuple or struct. `start` is where the name before it starts.
    pub fn parens(&mut self, start: usize, name: Option<Name>) -> Outcome<Value> {
        self.open('(')?;
        self.skip_gap()?;
        let kind = if self.is_field_next() {
            let fields = self.fields()?;
            ValueKind::Struct { name, fields }
        } else {
            let items = self.items(&TUPLE)?;
            match name {
                None if items.is_empty() => ValueKind::Unit,
                _ => ValueKind::Tuple { name, items },
            }
        };
        Ok(Value::new(self.span_from(start), kind))
    }

    /// Reads a list.
    pub fn list(&mut self) -> Outcome<ValueKind> {
        self.open('[')?;
        Ok(ValueKind::List(self.items(&LIST)?))
    }

    /// Reads values up to the closing bracket. Unreadable ones become [`ValueKind::Invalid`].
    fn items(&mut self, shape: &Shape) -> Outcome<Vec<Value>> {
        let mut items = Vec::new();
        self.sequence(shape, |reader| {
            let start = reader.at;
            let (value, outcome) = reader.value_or_invalid(start);
            items.push(value);
            outcome
        })?;
        Ok(items)
    }

    /// Reads a value; after an error stands an invalid one from `start` on.
    fn value_or_invalid(&mut self, start: usize) -> (Value, Outcome<()>) {
        match self.value() {
            Ok(value) => (value, Ok(())),
            Err(fail) => (Value::new(self.span_from(start), ValueKind::Invalid), Err(fail)),
        }
    }

    /// Reads `name: value` pairs up to the `)`.
    fn fields(&mut self) -> Outcome<Vec<(Name, Value)>> {
        let mut fields = Vec::new();
        let mut places: HashMap<String, Span> = HashMap::new();
        self.sequence(&STRUCT, |reader| {
            if scan::name_len(reader.rest()) == 0 {
                return Err(reader.fail_expected("a field name"));
            }
            let name = reader.name()?;
            let (value, outcome) = reader.value_after_colon()?;
            match places.entry(name.text.clone()) {
                Entry::Occupied(first) => {
                    let what = format!("field `{}`", name.text);
                    reader.report_and_go_on(report::doubled(&what, name.span, *first.get()))?;
                }
                Entry::Vacant(place) => {
                    place.insert(name.span);
                    fields.push((name, value));
                }
            }
            outcome
        })?;
        Ok(fields)
    }

    /// Reads `:` and a value; after an error stands an invalid one, so that the name is not lost.
    fn value_after_colon(&mut self) -> Outcome<(Value, Outcome<()>)> {
        self.skip_gap()?;
        let start = self.at;
        if !self.eat(':') {
            let fail = self.fail_expected("`:` and a value");
            return Ok((Value::new(self.span(start, start), ValueKind::Invalid), Err(fail)));
        }
        self.skip_gap()?;
        Ok(self.value_or_invalid(self.at))
    }

    /// Reads a map.
    pub fn map(&mut self) -> Outcome<ValueKind> {
        self.open('{')?;
        let mut entries = Vec::new();
        let mut places: HashMap<String, Span> = HashMap::new();
        self.sequence(&MAP, |reader| {
            let key = reader.value()?;
            let (value, outcome) = reader.value_after_colon()?;
            let text = report::key_text(&key);
            match places.entry(text) {
                Entry::Occupied(first) => {
                    let what = format!("key {}", first.key());
                    reader.report_and_go_on(report::doubled(&what, key.span, *first.get()))?;
                }
                Entry::Vacant(place) => {
                    place.insert(key.span);
                    entries.push((key, value));
                }
            }
            outcome
        })?;
        Ok(ValueKind::Map(entries))
    }

    /// Reads items and the commas between them, up to and with the closing bracket.
    ///
    /// After an error in an item, and after a missing comma, it goes on with the next item. Each turn
    /// reads at least one character, or ends.
    fn sequence(&mut self, shape: &Shape, mut item: impl FnMut(&mut Self) -> Outcome<()>) -> Outcome<()> {
        let close = shape.close;
        let (mut had_item, mut after_item) = (false, false);
        loop {
            self.skip_gap()?;
            if self.eat(close) {
                self.open.pop();
                return Ok(());
            }
            let expected = match after_item {
                true => format!("`,` or `{close}`"),
                false => format!("{} or `{close}`", shape.item),
            };
            match self.peek() {
                None | Some(')' | ']' | '}') => {
                    return self.close_wrongly(&expected);
                }
                Some(',') => {
                    if !after_item {
                        let diagnostic = report::expected(self, &expected);
                        self.report_and_go_on(diagnostic)?;
                    }
                    self.at += 1;
                    after_item = false;
                    continue;
                }
                Some(_) if had_item && self.list_ran_into_field(close, after_item)? => {
                    return Ok(());
                }
                Some(_) if after_item && !std::mem::take(&mut self.has_read_comma) => {
                    let diagnostic = report::expected(self, &expected);
                    self.report_and_go_on(diagnostic)?;
                    if !(shape.starts_item)(self.rest()) {
                        self.at += scan::skip_len(self.rest());
                        continue;
                    }
                }
                Some(_) => {}
            }
            match item(self) {
                Ok(()) => {}
                Err(Fail::Stop) => return Err(Fail::Stop),
                Err(Fail::Item) => self.at += scan::skip_len(self.rest()),
            }
            (had_item, after_item) = (true, true);
        }
    }

    /// Whether a list goes on with `name:` inside a struct. Then its bracket must have been forgotten:
    /// that is reported, and the list counts as closed.
    fn list_ran_into_field(&mut self, close: char, after_item: bool) -> Outcome<bool> {
        let outer = self.open.len().checked_sub(2).map(|index| self.open[index].0);
        if close != ']' || outer != Some('(') || !self.is_field_next() {
            return Ok(false);
        }
        let diagnostic = report::unclosed_before_field(self);
        self.report_and_go_on(diagnostic)?;
        self.open.pop();
        self.has_read_comma = !after_item;
        Ok(true)
    }

    /// Whether `name:` comes next.
    fn is_field_next(&self) -> bool {
        let len = scan::loose_name_len(self.rest());
        len > 0 && self.peek_past_gap(self.at + len) == Some(':')
    }

    /// Reports the end of the text, or a closing bracket of the wrong kind; then the inner one counts as
    /// closed.
    ///
    /// The wrong one is left to an outer bracket if one waits for it, so the inner one was forgotten; but
    /// not if that would end the file here and now, with more text to come.
    fn close_wrongly(&mut self, expected: &str) -> Outcome<()> {
        if let Fail::Stop = self.fail_expected(expected) {
            return Err(Fail::Stop);
        }
        let wanted = match self.peek() {
            Some(')') => '(',
            Some(']') => '[',
            _ => '{',
        };
        self.open.pop();
        let waiting = self.open.iter().rposition(|(bracket, _)| *bracket == wanted);
        let is_forgotten = match waiting {
            None => false,
            Some(0) => self.peek_past_gap(self.at + 1).is_none(),
            Some(_) => true,
        };
        if !is_forgotten {
            self.at += 1;
        }
        Ok(())
    }
}
