//! Bulbfold composes hybrid 3D fractals from a graph of small formula steps and renders them.
#![warn(missing_docs)]

pub mod check;
pub mod compose;
pub mod diag;
pub mod expr;
pub mod formula;
pub mod graph;
pub mod kernel;
pub mod march;
pub mod math;
pub mod film;
pub mod render;
pub mod shade;
pub mod load;
