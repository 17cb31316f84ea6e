//! What an orbit's end state says: r, its derivative by the method of choice, and the distance that follows.

use super::orbit::{Constants, Moved, OrbitBuilder, State};
use super::{ComposeResult, Purpose};
use crate::expr::{Differentiator, Expr, Function, Type};
use crate::graph::DeForm;

impl<'a> OrbitBuilder<'a> {
    /// What the end state says.
    pub(super) fn finish(
        &self,
        function: &mut Function,
        state: &State<'a>,
        constants: &Constants<'a>,
    ) -> ComposeResult<()> {
        let arena = self.composer.arena;
        let zero = state.z.lift(0.0);
        let end = self.apply_all(&self.settings.post, Moved { z: state.z, dr: state.dr }, zero)?;
        let tiny = arena.f(1e-30);
        let r = end.z.length();
        // Scaled before squaring: components of J may be as large as the square root of the range.
        let unit = end.z / r.max(tiny);
        let gradient = if self.carried.jacobian {
            let rows = Differentiator::of_gradients(arena, &[(state.z, state.rows.clone())]).tangents(end.z);
            unit.components().into_iter().zip(rows).map(|(u, row)| row * u).reduce(|a, b| a + b)
        } else if self.carried.shifted {
            Some(arena.compose(&self.differences(state, r, constants.h)?))
        } else {
            None
        };
        let slope = gradient.map(scaled_length);
        match self.purpose {
            Purpose::Surface => {
                let g = gradient.unwrap_or_else(|| arena.v3([0.0, 0.0, 1.0]));
                function.output("gradient", g / slope.unwrap_or(tiny).max(tiny));
                function.output("trap", state.trap.unwrap_or_else(|| arena.constant(Type::V4, [1e6; 4])));
                function.output("de", self.distance(r, slope.unwrap_or(tiny).max(tiny)));
            }
            _ => {
                let dr = match (end.dr, slope) {
                    (Some(dr), Some(slope)) => dr.max(slope),
                    (dr, slope) => dr.or(slope).unwrap_or_else(|| arena.f(1.0)),
                };
                function.output("de", self.distance(r, dr.max(tiny)));
            }
        }
        if self.purpose == Purpose::Probe {
            function.output("r", r);
            let parts = state.z.components();
            let w = parts.get(3).copied().unwrap_or_else(|| arena.f(0.0));
            function.output("z", arena.compose(&[parts[0], parts[1], parts[2], w]));
        }
        Ok(())
    }

    /// Finite differences of r along each axis, all at one iteration count. Of ln r where the form is logarithmic (the
    /// window of usable steps is far wider there), turned back into a slope of r.
    fn differences(&self, state: &State<'a>, r: Expr<'a>, h: Expr<'a>) -> ComposeResult<Vec<Expr<'a>>> {
        let zero = state.z.lift(0.0);
        let mut slopes = Vec::new();
        for z in &state.shifted {
            let end = self.apply_all(&self.settings.post, Moved { z: *z, dr: None }, zero)?;
            let shifted = end.z.length();
            slopes.push(match self.choice.form {
                DeForm::Logarithmic => (shifted / r).ln() * r / h,
                DeForm::Linear => (shifted - r) / h,
            });
        }
        Ok(slopes)
    }

    /// The estimate in world units; never negative.
    fn distance(&self, r: Expr<'a>, dr: Expr<'a>) -> Expr<'a> {
        let zero = self.composer.arena.f(0.0);
        match self.choice.form {
            DeForm::Linear => ((r - self.choice.radius) / dr).max(zero),
            DeForm::Logarithmic => (r * r.ln() * 0.5 / dr).max(zero),
        }
    }
}

/// The length of a 3-vector whose squares may overflow single precision.
fn scaled_length(v: Expr<'_>) -> Expr<'_> {
    let parts = v.abs().components();
    let largest = parts[0].max(parts[1]).max(parts[2]).max(v.arena.f(1e-30));
    (v / largest).length() * largest
}
