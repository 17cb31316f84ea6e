//! Bulbfold composes hybrid 3D fractals from a graph of small formula steps and renders them.
//!
//! A picture, as the program makes it, takes an [`Engine`](engine::Engine) and a [`Formula`](engine::Formula):
//!
//! ```
//! use bulbfold::engine::{Engine, Request};
//! use bulbfold::shade::Size;
//!
//! let engine = Engine::new();
//! let formula = engine.open("mandelbulb")?; // or the path of a file
//! let request = Request { size: Size { width: 64, height: 36 }, ..Request::default() };
//! let image = engine.picture(&formula, &request, &mut ())?;
//! assert_eq!(image.rgba().len(), 64 * 36 * 4);
//! # Ok::<(), bulbfold::engine::Error>(())
//! ```
//!
//! The folder `examples` has an animation, a step of your own and distances for another program.
//!
//! The way of the data is the way of the modules; each imports only from those before it:
//!
//! 1. [`diag`], [`math`], [`memory`] and [`files`]: places in texts and messages about them; numbers and SIMD lanes; what a thread
//!    holds; reading within limits and writing whole or not at all. Used by all, use none.
//! 2. [`expr`]: straight-line mathematics as a hash-consed graph, simplified and differentiated.
//! 3. [`formula`]: step files, graph files and scripts, read into plain data; steps are *traced* into expressions.
//! 4. [`graph`]: a fractal as nodes and wires, validated.
//! 5. [`kernel`]: functions and the loops around them, in a form that every back end runs: the embedded CPU interpreter
//!    (f64, wide f32) and generated WGSL.
//! 6. [`compose`]: from a graph to distance estimators, with the method and form that suit it.
//! 7. [`march`], [`shade`], [`film`]: rays to hits, hits to colours, colours to a picture.
//! 8. [`load`] and [`render`] join the stages, [`precision`] says which one a view needs; [`check`] tests formulas and
//!    measures estimates, [`calibrate`] chooses by what was measured, `chart` draws it and `view` shows it pixel by pixel. [`engine`]
//!    joins all of it.
//! 9. [`exchange`]: settings of other programs in, distance functions for other programs out. [`mesh`]: surfaces and volumes as files.
//!
//! Testing a formula of your own takes a few lines:
//!
//! ```
//! use bulbfold::check::Formula;
//!
//! let formula = Formula::from_ron(
//!     r#"(nodes: { "bulb": bulb_power(power: 8) }, escape_radius: 10, max_iterations: 10)"#,
//! )?;
//! assert!(formula.inside([0.0, 0.0, 0.0]));
//! assert!(!formula.inside([1.3, 0.0, 0.0]));
//! # Ok::<(), bulbfold::check::FormulaError>(())
//! ```
#![warn(missing_docs)]

pub mod calibrate;
#[cfg(feature = "chart")]
pub mod chart;
pub mod check;
pub mod colour;
pub mod compose;
pub mod diag;
pub mod engine;
pub mod exchange;
pub mod explore;
pub mod expr;
pub mod files;
pub mod film;
pub mod formula;
pub mod graph;
pub mod kernel;
pub mod live;
pub mod load;
pub mod march;
pub mod math;
pub mod memory;
pub mod mesh;
pub mod motion;
pub mod precision;
pub mod render;
pub mod shade;
#[cfg(feature = "chart")]
pub mod view;
