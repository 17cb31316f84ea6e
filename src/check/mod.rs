//! Testing formulas: what `bulbfold test` runs, and a few lines that unit tests of a user's own formula need.
//!
//! In come formula and step files ([`run_paths`]) or one formula ([`Formula`]); out come a [`Report`] or plain numbers.
//! Every test of a file runs on every back end that the machine has: the f64 interpreter is the reference, wide f32 and
//! the GPU are compared with what the file says, too. [`truth`] marches without any estimate and judges those that do; [`health`] looks for what is wrong in a formula.
//!
//! ```
//! use bulbfold::check::Formula;
//! use bulbfold::graph::Method;
//!
//! let bulb = Formula::builtin("mandelbulb").unwrap();
//! assert!(bulb.inside([0.0, 0.0, 0.0]));
//! assert!(!bulb.inside([2.0, 0.0, 0.0]));
//! let depth = bulb.ray([0.0, -4.0, 0.0], [0.0, 1.0, 0.0]).expect("the ray meets the bulb");
//! assert!(bulb.estimate([0.0, -4.0 + 0.9 * depth, 0.0], Method::Gradient) > 0.0);
//! ```

mod agreement;
pub mod audit;
pub mod backends;
mod cases;
pub mod exact;
mod formula;
pub mod health;
mod imported;
mod materials;
pub mod measure;
mod report;
mod runner;
mod steps;
mod subject;
mod traits;
pub mod truth;

pub use crate::math::random::{self, Random};
pub use agreement::{Agreement, agreement};
pub use backends::{Backends, Target};
pub use formula::{Formula, FormulaError};
pub use imported::measure_for_import;
pub use report::{Outcome, Report, Verdict};
pub use runner::{Options, REQUIRE_GPU, check_calibration, run_graph, run_paths, run_paths_with};
pub use subject::Subject;
pub use traits::is_conformal;
