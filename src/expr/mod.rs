//! Expressions: what every formula, camera and light becomes before it becomes a kernel.
//!
//! In comes straight-line mathematics, written with [`Expr`] and its operators (by the tracer that runs step files, or
//! by Rust code). Out come [`Function`]s: named inputs and outputs over nodes of one hash-consed [`Arena`]. Between, each
//! node has a fixed [`Type`], equal nodes are one node, constants are folded and local identities applied, so what a
//! formula does not need is already gone. [`differentiate`] turns expressions into expressions: no back end knows
//! what a derivative is. Operators are rows of one table, [`ops`].
//!
//! ```
//! use bulbfold::expr::{Arena, Type};
//! let arena = Arena::default();
//! let z = arena.input(0, Type::V3);
//! let folded = z.clamp(arena.f(-1.0), arena.f(1.0)) * 2.0 - z; // box fold
//! assert_eq!(folded.ty(), Type::V3);
//! ```

mod arena;
pub mod differentiate;
pub mod enclose;
mod function;
mod functions;
mod linear;
pub mod noise;
pub mod notation;
pub mod ops;
pub mod print;
mod simplify;
mod table;

pub use arena::{Arena, Expr, Node, NodeId, Op, Type};
pub use differentiate::Differentiator;
pub use enclose::{Bounds, Encloser, substitute};
pub use function::{Function, Inputs, Port};
pub use table::Table;
