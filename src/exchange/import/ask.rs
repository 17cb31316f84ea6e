//! How tables ask a file for values, whichever program wrote it.

use super::value::Value;
use crate::diag::Diagnostics;

/// Something that has values by name.
pub trait Ask {
    /// The value of `name`; `default` where the file gives none, and after an error, which is pushed. It counts as read.
    fn ask(&self, name: &str, default: &Value, d: &mut Diagnostics) -> Value;

    /// A switch.
    fn switch(&self, name: &str, default: bool, d: &mut Diagnostics) -> bool {
        matches!(self.ask(name, &Value::Bool(default), d), Value::Bool(true))
    }

    /// A number.
    fn number(&self, name: &str, default: f64, d: &mut Diagnostics) -> f64 {
        match self.ask(name, &Value::Number(default), d) {
            Value::Number(number) => number,
            _ => default,
        }
    }

    /// Three numbers.
    fn vector(&self, name: &str, default: [f64; 3], d: &mut Diagnostics) -> [f64; 3] {
        match self.ask(name, &Value::Vector(default.to_vec()), d) {
            Value::Vector(parts) => std::array::from_fn(|i| parts.get(i).copied().unwrap_or(default[i])),
            _ => default,
        }
    }
}
