//! A small interpreter of GLSL: enough to run the distance estimate of a shader at a few points.
//!
//! In comes a shader's text; [`Machine::run`] gives the value of its distance estimate and every vector that a variable held on
//! the way, among them the orbit, whatever the shader calls it. Numbers are computed in double precision. What the interpreter
//! does not know is an error that says what and where; nothing is passed over.

mod builtin;
mod run;
mod syntax;
mod token;
mod value;

pub use run::Machine;
pub use syntax::parse;
pub use token::tokens;
pub use value::Value;

#[cfg(test)]
mod tests;
