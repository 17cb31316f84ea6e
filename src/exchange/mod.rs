//! Work of other programs in, formulas out.
//!
//! [`import`] reads the settings of other fractal programs and makes the text of a graph file; [`export`] writes a
//! formula's distance estimate in the languages of other programs.

#[cfg(feature = "formats")]
pub mod camera;
pub mod export;
pub mod import;
