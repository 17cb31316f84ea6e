//! Why there is no picture.

use std::fmt;

use crate::diag::{Diagnostic, Diagnostics, Sources};
use crate::kernel::BackendError;

/// Why there is no picture.
pub enum Error {
    /// The formula has errors; they point into its texts.
    Formula(Box<FormulaMessages>),
    /// The request contradicts itself or the formula.
    Request {
        /// What is wrong.
        text: String,
        /// What to do.
        help: String,
    },
    /// The back end failed.
    Backend {
        /// What happened.
        error: BackendError,
        /// What to do; may be empty.
        help: &'static str,
    },
    /// The sink refused rows.
    Sink(std::io::Error),
    /// The observer ended it.
    Cancelled,
}

/// Messages, and the texts that they point into.
pub struct FormulaMessages {
    /// The messages.
    pub messages: Diagnostics,
    /// The texts.
    pub sources: Sources,
}

impl Error {
    /// A request that cannot be met.
    pub fn request(text: impl Into<String>, help: impl Into<String>) -> Error {
        Error::Request { text: text.into(), help: help.into() }
    }

    /// An error of a formula whose texts are among these.
    pub fn of_formula(message: Diagnostic, sources: &Sources) -> Error {
        let mut messages = Diagnostics::default();
        messages.push(message);
        Error::Formula(Box::new(FormulaMessages { messages, sources: sources.clone() }))
    }
}

impl From<BackendError> for Error {
    fn from(error: BackendError) -> Error {
        Error::Backend { error, help: "" }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let helped = |f: &mut fmt::Formatter<'_>, help: &str| match help {
            "" => Ok(()),
            help => write!(f, "\n{help}"),
        };
        match self {
            Error::Formula(inner) => f.write_str(&inner.messages.render(&inner.sources, false)),
            Error::Request { text, help } => f.write_str(text).and_then(|()| helped(f, help)),
            Error::Backend { error, help } => write!(f, "{error}").and_then(|()| helped(f, help)),
            Error::Sink(error) => write!(f, "the picture cannot be written: {error}"),
            Error::Cancelled => f.write_str("the work was cancelled"),
        }
    }
}

// `unwrap` in a test prints the debug form: the same text, since it is made for people.
impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\n{self}")
    }
}

impl std::error::Error for Error {}
