//! Values with named parts: structs, and maps whose keys are names.

use std::collections::HashMap;

use super::{FromValue, wrong_type};
use crate::diag::{Diagnostic, Diagnostics, Span};
use crate::formula::value::{Name, Value, ValueKind};

/// Unknown fields that get a hint; the rest are only named.
const MAX_HINTS: usize = 50;

/// The named parts of one value, and which of them have been asked for.
///
/// Takes structs (with or without name), maps whose keys are strings or bare identifiers, and `()` and
/// `Name()` as structs without fields.
pub struct Fields<'a> {
    /// What the value is, with article: "a fractal".
    what: &'static str,
    /// The whole value.
    span: Span,
    /// What stands before the bracket.
    name: Option<&'a Name>,
    /// All parts, in order.
    entries: Vec<(Name, &'a Value)>,
    /// Where in `entries` a name is.
    places: HashMap<String, usize>,
    /// Which entries were asked for.
    used: Vec<bool>,
    /// Names asked for.
    asked: Vec<&'static str>,
}

impl<'a> Fields<'a> {
    /// Opens a value; `None` after reporting that it has no named parts.
    ///
    /// `what` says in messages what the value is, with article: "a fractal".
    pub fn new(value: &'a Value, what: &'static str, diagnostics: &mut Diagnostics) -> Option<Self> {
        let name = match &value.kind {
            ValueKind::Struct { name, .. } => name.as_ref(),
            ValueKind::Tuple { name, items } if items.is_empty() => name.as_ref(),
            ValueKind::Map(_) | ValueKind::Unit => None,
            _ => {
                let expected = format!("{what}, that is, fields such as `(name: value)`");
                wrong_type(value, &expected, diagnostics);
                return None;
            }
        };
        let entries = entries(value, what, diagnostics);
        let places = entries.iter().enumerate().map(|(index, (name, _))| (name.text.clone(), index));
        Some(Self {
            what,
            span: value.span,
            name,
            places: places.collect(),
            used: vec![false; entries.len()],
            entries,
            asked: Vec::new(),
        })
    }

    /// Place of the whole value.
    pub fn span(&self) -> Span {
        self.span
    }

    /// What stands before the bracket, as in `Step(...)`.
    pub fn name(&self) -> Option<&'a Name> {
        self.name
    }

    /// Reads a field that must be there; `None` after reporting that it is not, or is of the wrong type.
    pub fn required<T: FromValue>(&mut self, name: &'static str, diagnostics: &mut Diagnostics) -> Option<T> {
        let Some(value) = self.optional_value(name) else {
            let message = format!("{} needs the field `{name}`", self.what);
            let label = format!("`{name}` is missing here");
            let help = format!("add `{name}: ...`, {}", T::EXPECTED);
            diagnostics.push(Diagnostic::error(message).label(self.span, label).help(help));
            return None;
        };
        T::from_value(value, diagnostics)
    }

    /// Reads a field that may be absent (or `None`); also `None` after reporting a wrong type.
    pub fn optional<T: FromValue>(&mut self, name: &'static str, diagnostics: &mut Diagnostics) -> Option<T> {
        T::from_value(self.optional_value(name)?, diagnostics)
    }

    /// Reads a field, or takes the default if it is absent, or `None`, or (reported) of the wrong type.
    pub fn or<T: FromValue>(&mut self, name: &'static str, default: T, diagnostics: &mut Diagnostics) -> T {
        self.optional(name, diagnostics).unwrap_or(default)
    }

    /// The value of a field as it is. Absent if its value is `None`.
    pub fn optional_value(&mut self, name: &'static str) -> Option<&'a Value> {
        if !self.asked.contains(&name) {
            self.asked.push(name);
        }
        let index = *self.places.get(name)?;
        self.used[index] = true;
        let value = self.entries[index].1;
        (!value.is_none()).then_some(value)
    }

    /// All fields not asked for yet, in order; from now on they count as asked for.
    pub fn rest(&mut self) -> Vec<(Name, &'a Value)> {
        let unused = self.used.iter_mut().zip(&self.entries).filter(|(used, _)| !**used);
        unused
            .map(|(used, (name, value))| {
                *used = true;
                (name.clone(), *value)
            })
            .collect()
    }

    /// Reports every field that was not read, with the nearest legal name, or all of them.
    pub fn finish(self, diagnostics: &mut Diagnostics) {
        let unknown = self.entries.iter().zip(&self.used).filter(|(_, used)| !**used);
        for (count, ((name, _), _)) in unknown.enumerate() {
            let mut diagnostic = Diagnostic::error(format!("{} has no field `{}`", self.what, name.text))
                .label(name.span, "unknown field");
            if count < MAX_HINTS {
                diagnostic = diagnostic.did_you_mean(&name.text, self.asked.iter().copied());
                if diagnostic.help.is_empty() {
                    diagnostic = diagnostic.help(self.legal_names());
                }
            }
            diagnostics.push(diagnostic);
        }
    }

    /// "the fields of a fractal are `a` and `b`".
    fn legal_names(&self) -> String {
        let what = self.what;
        match self.asked.as_slice() {
            [] => format!("{what} has no fields"),
            [only] => format!("the only field of {what} is `{only}`"),
            [first @ .., last] => {
                let first: Vec<String> = first.iter().map(|name| format!("`{name}`")).collect();
                format!("the fields of {what} are {} and `{last}`", first.join(", "))
            }
        }
    }
}

/// The parts of a struct or map by name, in order; reports keys that are no names.
///
/// Keys may be strings or bare identifiers. `()` has no parts. Of a name given twice (which no RON file
/// can hold, except once as string and once bare) the first stays, and the second is reported.
pub fn entries<'a>(value: &'a Value, what: &str, diagnostics: &mut Diagnostics) -> Vec<(Name, &'a Value)> {
    let entries = match &value.kind {
        ValueKind::Struct { fields, .. } => {
            return fields.iter().map(|(name, value)| (name.clone(), value)).collect();
        }
        ValueKind::Map(entries) => entries,
        ValueKind::Tuple { items, .. } if items.is_empty() => return Vec::new(),
        ValueKind::Unit => return Vec::new(),
        _ => {
            let expected = format!("{what}, that is, names and values such as `(name: value)`");
            wrong_type(value, &expected, diagnostics);
            return Vec::new();
        }
    };
    let mut out = Vec::with_capacity(entries.len());
    let mut places: HashMap<&str, Span> = HashMap::new();
    for (key, value) in entries {
        let (ValueKind::Str(text) | ValueKind::Variant(Name { text, .. })) = &key.kind else {
            wrong_type(key, "a name", diagnostics);
            continue;
        };
        if let Some(first) = places.insert(text, key.span) {
            diagnostics.push(
                Diagnostic::error(format!("`{text}` is given twice"))
                    .label(key.span, "given again here")
                    .label(first, "first given here"),
            );
            continue;
        }
        out.push((Name::new(key.span, text.as_str()), value));
    }
    out
}
