//! The derivative of the centre's orbit, carried beside the bounds where orbits end at the footprint.
//!
//! The bound l would not do: it depends on how large a ball the march proposes, and where little can be proven it says of points
//! well in front of the set that the threshold's image is as wide as all of it.

use super::Inputs;
use crate::compose::ComposeResult;
use crate::compose::orbit::{Constants, OrbitBuilder, State};
use crate::expr::Expr;
use crate::graph::IterationMap;

/// The centre with its derivative: that of the scalar rules, or along the ray where a step has none.
pub(super) struct Centre<'a, 's> {
    orbit: &'s OrbitBuilder<'a>,
    state: State<'a>,
    constants: Constants<'a>,
}

impl<'a, 's> Centre<'a, 's> {
    /// The centre of a start, as expressions of the estimator's inputs; `None` where orbits go on to the limit.
    pub(super) fn start(orbit: &'s OrbitBuilder<'a>) -> ComposeResult<Option<Self>> {
        if !orbit.follows_footprint() {
            return Ok(None);
        }
        let (state, constants) = orbit.start()?;
        Ok(Some(Centre { orbit, state, constants }))
    }

    /// Makes the derivative a part of the state, whose centre is `z`.
    pub(super) fn carry(&mut self, z: Expr<'a>, inputs: &mut Inputs<'a>) {
        self.state.z = z;
        self.state.dr = self.state.dr.map(|dr| inputs.give("dr", dr));
        self.state.along = self.state.along.map(|along| inputs.give("along", along));
    }

    /// Freezes what iterations read of the start, whose centre is `c`; `moves` says whether their constants move with it.
    pub(super) fn freeze(&mut self, c: Expr<'a>, moves: bool, inputs: &mut Inputs<'a>) {
        let mut keep = |name: &str, e: Expr<'a>| if moves { inputs.keep(name, e) } else { e.lift(0.0) };
        self.constants.c = c;
        self.constants.dc = keep("dc", self.constants.dc);
        self.constants.along = self.constants.along.map(|along| keep("c_along", along));
        self.constants.hit_eps = inputs.give("hit_eps", self.constants.hit_eps);
    }

    /// The state after an iteration.
    pub(super) fn iterate(&self, item: &IterationMap, n: Expr<'a>) -> ComposeResult<State<'a>> {
        self.orbit.iterate(item, &self.state, &self.constants, n)
    }

    /// The derivative after an iteration, under its name.
    pub(super) fn derivative(next: &State<'a>) -> Option<(&'static str, Expr<'a>)> {
        next.dr.map(|dr| ("dr", dr)).or(next.along.map(|along| ("along", along)))
    }

    /// Whether the orbit ends after an iteration.
    pub(super) fn has_ended(&self, next: &State<'a>) -> Expr<'a> {
        self.orbit.has_ended(next, self.constants.hit_eps)
    }

    /// What an orbit that ended here is answered with: `de`, or the mark of what is resolved.
    pub(super) fn mark_resolved(&self, de: Expr<'a>) -> Expr<'a> {
        self.orbit.mark_resolved(&self.state, self.constants.hit_eps, de)
    }
}
