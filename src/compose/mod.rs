//! The composer: from a graph to estimators.
//!
//! In comes a [`ValidGraph`] and, for each of its orbits, a [`Choice`] of method, form and radius. Out come
//! [`Estimator`](crate::kernel::Estimator)s over one arena: `de` and `inside` for marching, normals and traps for shading, everything for probing.
//! The composer, never a step, adds `c` and owns the running derivative's "+1"; it differentiates whole iterations, so
//! equal subexpressions of value and derivative are computed once.

mod bounds;
mod certified;
pub mod choose;
mod escape;
mod estimate;
mod field;
mod footprint;
mod levels;
mod maps;
pub(crate) mod matter;
mod measure;
mod nearby;
pub mod norm;
mod orbit;
pub(crate) mod paint;
mod parts;
pub mod placement;
mod reach;
mod soft;
mod solid;
mod trusted;
mod unread;
mod unrolled;
mod value;

pub use bounds::{Bounds, Sides};
pub use choose::{Choice, Plan, choose};
pub use field::{Decider, FieldOrbit, compose_estimator, compose_tones, deciders, field_orbits};
pub use maps::scalar_rules;
pub use measure::compose_growth;
pub use parts::{IterationParts, Part, iteration_parts};
pub use reach::Reach;
pub(crate) use reach::empty_balls;

use std::sync::Arc;

use crate::diag::Diagnostic;
use crate::expr::Arena;
use crate::formula::library::Library;
use crate::graph::ValidGraph;

/// What an estimator is for, which decides its outputs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Purpose {
    /// `de, inside`, of what `max_iterations` says exactly.
    Estimate,
    /// `de, inside`, of orbits that go on for a while after they escaped, so that proofs reach further; `inside` is not to be
    /// asked, and methods that prove nothing take it for [`Purpose::Estimate`].
    Proof,
    /// The same for a march, whose orbits end where their detail is below the hit threshold: what is resolved is inside.
    March,
    /// `de, inside`, of which only `inside` is to be asked: as a march sees it, but told without any derivative, by the orbit
    /// of a point beside.
    Truth,
    /// `gradient: vec3, trap: vec4`: the field's direction of growth, and the traps of the orbit; behind them what a painted surface is
    /// made of, as far as it is not the same everywhere.
    Surface,
    /// `de, inside, n, r, z: vec4`; `r` and `z` of the first orbit.
    Probe,
    /// `de, inside, decider`: the number of what the estimate came from, as [`deciders`] lists it.
    Decision,
}

/// What every part of the composer needs.
#[derive(Clone, Copy)]
pub struct Composer<'a> {
    /// Where nodes go.
    pub arena: &'a Arc<Arena>,
    /// Steps and script engine.
    pub library: &'a Library,
    /// The fractal.
    pub graph: &'a ValidGraph,
}

/// Composing fails only where a step's own script does.
pub type ComposeResult<T> = Result<T, Diagnostic>;
