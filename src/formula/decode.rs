//! Turns [`Value`]s into the types of the program, and reports everything that does not fit.
//!
//! In come values from RON files or Rhai scripts; out go numbers, texts, lists and fields by name.
//! Nothing here stops at the first error: ask for all fields, [`Fields::finish`], and only then look
//! whether there were any.
//!
//! ```
//! use bulbfold::diag::{Diagnostics, Sources};
//! use bulbfold::formula::{decode::Fields, ron::{Limits, read_ron}};
//!
//! let mut sources = Sources::default();
//! let id = sources.add("fold.ron", "(limit: 1.5, colour: \"red\")");
//! let mut d = Diagnostics::default();
//! let value = read_ron(&sources, id, &Limits::default(), &mut d).unwrap();
//! let mut fields = Fields::new(&value, "a box fold", &mut d).unwrap();
//! let limit: f64 = fields.or("limit", 1.0, &mut d);
//! let scale: f64 = fields.or("scale", 2.0, &mut d);
//! fields.finish(&mut d);
//! assert_eq!((limit, scale), (1.5, 2.0));
//! assert_eq!(d.iter().next().unwrap().message, "a box fold has no field `colour`");
//! ```

mod fields;

pub use fields::{Fields, entries};

use super::value::{Value, ValueKind};
use crate::diag::{Diagnostic, Diagnostics, Span};

/// Greatest whole number up to which `f64` holds every whole number.
const MAX_WHOLE: f64 = 9_007_199_254_740_992.0;

/// A type that can be read from a [`Value`].
pub trait FromValue: Sized {
    /// What a value must be, for "expected ..., found ...".
    const EXPECTED: &str;

    /// Reads the value; `None` after reporting why not.
    fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self>;
}

/// Reports that a value is not what was expected; silent about [`ValueKind::Invalid`], which was
/// reported already.
pub fn wrong_type(value: &Value, expected: &str, diagnostics: &mut Diagnostics) {
    if value.kind == ValueKind::Invalid {
        return;
    }
    let message = format!("expected {expected}, found {}", value.describe());
    let diagnostic = Diagnostic::error(message).label(value.span, format!("expected {expected}"));
    diagnostics.push(match &value.kind {
        ValueKind::Variant(name) if expected == String::EXPECTED => {
            diagnostic.help(format!("put it into quotes: \"{}\"", name.text))
        }
        ValueKind::Str(_) if expected == f64::EXPECTED => diagnostic.help("numbers stand without quotes"),
        _ => diagnostic,
    });
}

/// Whether a number is within its limits, both included; reports it if not, or if it is NaN.
///
/// `what` starts the message, for example "`power`". An infinite limit is none.
pub fn check_range(value: f64, min: f64, max: f64, what: &str, span: Span, diagnostics: &mut Diagnostics) -> bool {
    if (min..=max).contains(&value) {
        return true;
    }
    let (least, most) = (number_text(min), number_text(max));
    let range = match (min.is_finite(), max.is_finite()) {
        (true, true) => format!("from {least} to {most}"),
        (true, false) => format!("at least {least}"),
        (false, true) => format!("at most {most}"),
        (false, false) => "a number".into(),
    };
    let message = format!("{what} must be {range}, but is {}", number_text(value));
    diagnostics.push(Diagnostic::error(message).label(span, format!("must be {range}")));
    false
}

/// A number as people write it: very large and small ones with an exponent.
fn number_text(number: f64) -> String {
    let size = number.abs();
    if size.is_finite() && size != 0.0 && !(1e-4..1e15).contains(&size) {
        format!("{number:e}")
    } else {
        number.to_string()
    }
}

impl FromValue for f64 {
    const EXPECTED: &str = "a number";

    /// Range: finite.
    fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self> {
        match value.kind {
            ValueKind::Number(number) if number.is_finite() => Some(number),
            ValueKind::Number(_) => {
                wrong_type(value, "a finite number", diagnostics);
                None
            }
            _ => {
                wrong_type(value, Self::EXPECTED, diagnostics);
                None
            }
        }
    }
}

/// Reads a whole number from 0 to `max`.
fn whole(value: &Value, max: f64, expected: &str, diagnostics: &mut Diagnostics) -> Option<f64> {
    match value.kind {
        ValueKind::Number(number) if number.fract() == 0.0 && (0.0..=max).contains(&number) => Some(number),
        ValueKind::Number(number) if number.is_finite() => {
            let message = format!("expected {expected}, found {}", number_text(number));
            let label = format!("expected {expected}");
            diagnostics.push(Diagnostic::error(message).label(value.span, label));
            None
        }
        _ => {
            wrong_type(value, expected, diagnostics);
            None
        }
    }
}

impl FromValue for u32 {
    const EXPECTED: &str = "a whole number from 0 to 4294967295";

    fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self> {
        whole(value, u32::MAX.into(), Self::EXPECTED, diagnostics).map(|number| number as Self)
    }
}

impl FromValue for usize {
    const EXPECTED: &str = "a whole number from 0 up";

    /// Range: to 2^53, or `usize::MAX` if that is less.
    fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self> {
        let max = MAX_WHOLE.min(Self::MAX as f64);
        whole(value, max, Self::EXPECTED, diagnostics).map(|number| number as Self)
    }
}

impl FromValue for bool {
    const EXPECTED: &str = "`true` or `false`";

    fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self> {
        if let ValueKind::Bool(bool) = value.kind {
            return Some(bool);
        }
        wrong_type(value, Self::EXPECTED, diagnostics);
        None
    }
}

impl FromValue for String {
    const EXPECTED: &str = "a string";

    fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self> {
        if let ValueKind::Str(text) = &value.kind {
            return Some(text.clone());
        }
        wrong_type(value, Self::EXPECTED, diagnostics);
        None
    }
}

impl FromValue for Value {
    const EXPECTED: &str = "a value";

    fn from_value(value: &Value, _: &mut Diagnostics) -> Option<Self> {
        (value.kind != ValueKind::Invalid).then(|| value.clone())
    }
}

impl<T: FromValue> FromValue for Vec<T> {
    const EXPECTED: &str = "a list";

    /// Reports every item that does not fit, not the first only.
    fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self> {
        let ValueKind::List(items) = &value.kind else {
            wrong_type(value, Self::EXPECTED, diagnostics);
            return None;
        };
        let read: Vec<Option<T>> = items.iter().map(|item| T::from_value(item, diagnostics)).collect();
        read.into_iter().collect()
    }
}

/// Reads a tuple or list of exactly `N` numbers.
fn numbers<const N: usize>(value: &Value, expected: &str, diagnostics: &mut Diagnostics) -> Option<[f64; N]> {
    let items = match &value.kind {
        ValueKind::List(items) | ValueKind::Tuple { name: None, items } => items,
        _ => {
            wrong_type(value, expected, diagnostics);
            return None;
        }
    };
    if items.len() != N {
        let message = format!("expected {expected}, found {} of {} items", value.describe(), items.len());
        let label = format!("expected {expected}");
        diagnostics.push(Diagnostic::error(message).label(value.span, label));
        return None;
    }
    let mut out = [0.0; N];
    let mut is_good = true;
    for (number, item) in out.iter_mut().zip(items) {
        match f64::from_value(item, diagnostics) {
            Some(read) => *number = read,
            None => is_good = false,
        }
    }
    is_good.then_some(out)
}

/// Implements [`FromValue`] for arrays of numbers.
macro_rules! impl_numbers {
    ($($count:literal $expected:literal)*) => {$(
        impl FromValue for [f64; $count] {
            const EXPECTED: &str = $expected;

            fn from_value(value: &Value, diagnostics: &mut Diagnostics) -> Option<Self> {
                numbers(value, Self::EXPECTED, diagnostics)
            }
        }
    )*};
}

impl_numbers! {
    2 "two numbers such as (1, 2)"
    3 "three numbers such as (1, 2, 3)"
    4 "four numbers such as (1, 2, 3, 4)"
}

#[cfg(test)]
mod tests;
