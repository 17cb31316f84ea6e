//! What a formula file says, before anyone asks what it means.
//!
//! RON files ([`super::ron`]) and Rhai scripts both become a [`Value`]; [`super::decode`] turns it
//! into the types of the program. Every part knows its place, for messages. Always holds for values
//! from RON: numbers are finite, no struct has a field twice, no map has a key twice.

use std::fmt;

use crate::diag::Span;

/// A value and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Value {
    /// From its first to its last character; [`Span::NONE`] if it stands in no file.
    pub span: Span,
    /// The value itself.
    pub kind: ValueKind,
}

/// An identifier and where it stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name {
    /// Place of the identifier (of a map key: with its quotes).
    pub span: Span,
    /// The identifier, without `r#`.
    pub text: String,
}

/// The kinds of value. RON's `Some(x)` is `x`, and `None` is the variant of that name.
#[derive(Clone, Debug, PartialEq)]
pub enum ValueKind {
    /// `()`.
    Unit,
    /// `true` or `false`.
    Bool(bool),
    /// Any number; scripts may make NaN and infinities, files cannot.
    Number(f64),
    /// `"text"`, `r"text"` or `'c'`.
    Str(String),
    /// `[1, 2]`.
    List(Vec<Value>),
    /// `(1, 2)` or `Name(1, 2)`; without name never empty.
    Tuple {
        /// What stands before the bracket.
        name: Option<Name>,
        /// In order.
        items: Vec<Value>,
    },
    /// `(a: 1)` or `Name(a: 1)`; never empty (then it is [`ValueKind::Unit`] or a tuple).
    Struct {
        /// What stands before the bracket.
        name: Option<Name>,
        /// In order, no name twice.
        fields: Vec<(Name, Value)>,
    },
    /// `{ "a": 1 }`, in order, no key twice.
    Map(Vec<(Value, Value)>),
    /// A bare identifier such as `Mandelbrot`.
    Variant(Name),
    /// Stands where the text could not be read. An error was reported, so whoever meets this gives up
    /// without another message.
    Invalid,
}

impl Value {
    /// A value at a place.
    pub fn new(span: Span, kind: ValueKind) -> Self {
        Self { span, kind }
    }

    /// Says what this is, for "expected ..., found ...": "a number", "`Step(...)`".
    pub fn describe(&self) -> String {
        match &self.kind {
            ValueKind::Unit => "`()`".into(),
            ValueKind::Bool(_) => "a boolean".into(),
            ValueKind::Number(number) if number.is_nan() => "NaN".into(),
            ValueKind::Number(number) if number.is_infinite() => "infinity".into(),
            ValueKind::Number(_) => "a number".into(),
            ValueKind::Str(_) => "a string".into(),
            ValueKind::List(_) => "a list".into(),
            ValueKind::Tuple { name: None, .. } => "a tuple".into(),
            ValueKind::Struct { name: None, .. } => "a struct".into(),
            ValueKind::Tuple { name: Some(name), .. } | ValueKind::Struct { name: Some(name), .. } => {
                format!("`{}(...)`", name.text)
            }
            ValueKind::Map(_) => "a map".into(),
            ValueKind::Variant(name) => format!("`{}`", name.text),
            ValueKind::Invalid => "something unreadable".into(),
        }
    }

    /// Whether this is the bare identifier `None`, which stands for an absent value.
    pub fn is_none(&self) -> bool {
        matches!(&self.kind, ValueKind::Variant(name) if name.text == "None")
    }

    /// What stands before the bracket of a tuple or struct, or the bare identifier itself.
    pub fn name(&self) -> Option<&Name> {
        match &self.kind {
            ValueKind::Tuple { name, .. } | ValueKind::Struct { name, .. } => name.as_ref(),
            ValueKind::Variant(name) => Some(name),
            _ => None,
        }
    }
}

impl Name {
    /// A name at a place.
    pub fn new(span: Span, text: impl Into<String>) -> Self {
        let text = text.into();
        Self { span, text }
    }
}

impl fmt::Display for ValueKind {
    /// As a RON file holds it, on one line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ValueKind::Unit => f.write_str("()"),
            ValueKind::Bool(value) => write!(f, "{value}"),
            ValueKind::Number(number) => write!(f, "{number}"),
            ValueKind::Str(text) => write!(f, "{text:?}"),
            ValueKind::List(items) => write!(f, "[{}]", joined(items.iter().map(|item| item.kind.to_string()))),
            ValueKind::Tuple { name, items } => {
                f.write_str(name.as_ref().map_or("", |name| &name.text))?;
                write!(f, "({})", joined(items.iter().map(|item| item.kind.to_string())))
            }
            ValueKind::Struct { name, fields } => {
                f.write_str(name.as_ref().map_or("", |name| &name.text))?;
                write!(f, "({})", joined(fields.iter().map(|(name, value)| format!("{}: {}", name.text, value.kind))))
            }
            ValueKind::Map(items) => {
                write!(f, "{{{}}}", joined(items.iter().map(|(key, value)| format!("{}: {}", key.kind, value.kind))))
            }
            ValueKind::Variant(name) => f.write_str(&name.text),
            ValueKind::Invalid => f.write_str("?"),
        }
    }
}

fn joined(parts: impl Iterator<Item = String>) -> String {
    parts.collect::<Vec<_>>().join(", ")
}
