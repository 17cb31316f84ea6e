//! What an orbit's end state says: its size, the derivative of that by the method of choice, and the distance that follows.

use super::field::shape_at;
use super::maps::Moved;
use super::norm::{frobenius_norm, largest_singular_value, long_length, scaled_length};
use super::orbit::{Constants, OrbitBuilder, State};
use super::paint::untouched;
use super::{ComposeResult, Purpose};
use crate::expr::{Differentiator, Expr, Function};
use crate::graph::{DeForm, Difference, Escape, Method, NO_ESCAPE};

/// The state after the last iteration and the post-transforms.
struct End<'g> {
    z: Expr<'g>,
    /// Its size in the sense of the form.
    size: Expr<'g>,
    dr: Option<Expr<'g>>,
    /// Gradients of the components of z.
    rows: Vec<Expr<'g>>,
    /// Derivative of z along the ray.
    along: Option<Expr<'g>>,
    /// Ends of the orbits of shifted points.
    shifted: Vec<Expr<'g>>,
    /// Their sizes.
    sizes: Vec<Expr<'g>>,
}

/// Escape radius up to which an iteration that grows by a factor leaves lengths that can be squared: the factor may be 10^10.
const SHORT: f64 = 1e9;

/// The greatest estimate, in world units: what stands for an infinite one.
const FARTHEST: f64 = 1e30;

impl<'a> OrbitBuilder<'a> {
    /// Fills `function`, which takes the state and frozen values; `n` is the number of iterations done.
    pub(super) fn finish(
        &self,
        function: &mut Function,
        state: &State<'a>,
        constants: &Constants<'a>,
        n: Expr<'a>,
    ) -> ComposeResult<()> {
        let arena = self.composer.arena;
        let end = self.end(state, n)?;
        let far = || state.trap.unwrap_or_else(|| untouched(arena));
        match (self.purpose, &state.joined) {
            (Purpose::Surface, Some(joined)) => {
                function.output("gradient", joined.gradient.unwrap_or_else(|| arena.v3([0.0, 0.0, 1.0])));
                function.output("trap", far());
                function.output("de", joined.d);
            }
            (_, Some(joined)) => function.output("de", joined.d),
            (purpose, None) => self.finish_end(function, (state, &end), constants, (purpose, n)),
        }
        self.finish_notes(function, &state.notes, state.z, n);
        if let (Purpose::Decision, Method::Combined, Some(dr)) = (self.purpose, self.choice.method, end.dr) {
            let gradient = self.gradient(&end, constants.h).map_or(arena.f(0.0), scaled_length);
            function.output("part", dr.lt(gradient).select(arena.f(1.0), arena.f(0.0)));
        }
        if self.purpose == Purpose::Probe {
            function.output("r", end.z.length());
            let parts = state.z.components();
            let w = parts.get(3).copied().unwrap_or_else(|| arena.f(0.0));
            function.output("z", arena.compose(&[parts[0], parts[1], parts[2], w]));
        }
        Ok(())
    }

    /// The distance of a state from the orbit's shape, and for surfaces the unit gradient.
    pub(super) fn looked_up(
        &self,
        state: &State<'a>,
        constants: &Constants<'a>,
        n: Expr<'a>,
    ) -> ComposeResult<(Expr<'a>, Option<Expr<'a>>)> {
        let end = self.end(state, n)?;
        if self.purpose != Purpose::Surface {
            return Ok((self.distance(end.size, self.slope(&end, constants.h), n), None));
        }
        let gradient = self.gradient(&end, constants.h);
        let slope = gradient.map_or(self.composer.arena.f(0.0), scaled_length);
        let unit = gradient.map(|gradient| gradient / slope.max(slope.lift(1e-30)));
        Ok((self.distance(end.size, slope, n), unit))
    }

    fn finish_end(
        &self,
        function: &mut Function,
        (state, end): (&State<'a>, &End<'a>),
        constants: &Constants<'a>,
        (purpose, n): (Purpose, Expr<'a>),
    ) {
        let arena = self.composer.arena;
        match purpose {
            Purpose::Surface => {
                let gradient = self.gradient(end, constants.h);
                let slope = gradient.map_or(arena.f(0.0), scaled_length);
                let direction = gradient.unwrap_or_else(|| arena.v3([0.0, 0.0, 1.0]));
                function.output("gradient", direction / slope.max(arena.f(1e-30)));
                function.output("trap", state.trap.unwrap_or_else(|| untouched(arena)));
                function.output("de", self.distance(end.size, slope, n));
            }
            Purpose::Truth if self.follows_footprint() => {
                function.output("de", self.mark_resolved(state, constants.hit_eps, arena.f(0.0)));
            }
            Purpose::Estimate
            | Purpose::Proof
            | Purpose::March
            | Purpose::Truth
            | Purpose::Probe
            | Purpose::Decision => {
                let slope = self.slope(end, constants.h);
                let de = self.distance(end.size, slope, n);
                let follows = self.follows_footprint();
                function.output("de", if follows { self.mark_resolved(state, constants.hit_eps, de) } else { de });
            }
        }
    }

    fn end(&self, state: &State<'a>, n: Expr<'a>) -> ComposeResult<End<'a>> {
        let arena = self.composer.arena;
        let zero = state.z.lift(0.0);
        let state = &self.measured(state);
        let moved = self.apply_all(&self.settings.post, Moved { z: state.z, dr: state.dr }, zero)?;
        let rows = match self.carried.jacobian {
            true => Differentiator::of_gradients(arena, &[(state.z, state.rows.clone())]).tangents(moved.z),
            false => Vec::new(),
        };
        let along = state.along.map(|along| Differentiator::new(arena, &[(state.z, along)]).derivative(moved.z));
        let shifted = state.shifted.iter().map(|z| {
            let moved = self.apply_all(&self.settings.post, Moved { z: *z, dr: None }, zero)?;
            Ok(moved.z)
        });
        let shifted = shifted.collect::<ComposeResult<Vec<_>>>()?;
        let sizes = shifted.iter().map(|z| self.size(*z, n)).collect::<ComposeResult<Vec<_>>>()?;
        let size = match self.tells_of_escaped() {
            true if self.stays_short() => moved.z.length(),
            true => long_length(moved.z, self.settings.escape_radius),
            false => self.size(moved.z, n)?,
        };
        Ok(End { z: moved.z, size, dr: moved.dr, rows, along, shifted, sizes })
    }

    /// True if the size is a length that nothing reads unless the orbit has escaped: what is inside has no distance.
    fn tells_of_escaped(&self) -> bool {
        let is_length = self.is_length() && self.settings.post.is_empty() && self.settings.escape == Escape::Length;
        let is_distance = matches!(self.purpose, Purpose::Estimate | Purpose::March | Purpose::Decision);
        is_length && is_distance && self.settings.shape.is_none() && self.settings.escape_radius < NO_ESCAPE
    }

    /// True if the size is the length of what is measured.
    fn is_length(&self) -> bool {
        match self.choice.form {
            DeForm::Linear => self.settings.escape == Escape::Length || self.settings.escape.is_convergence(),
            DeForm::Logarithmic => true,
            DeForm::Box | DeForm::Plane | DeForm::End => false,
        }
    }

    /// True if the squares of an escaped orbit are within single precision's range: one iteration only grows by a factor.
    fn stays_short(&self) -> bool {
        self.choice.form == DeForm::Linear && self.settings.escape_radius <= SHORT
    }

    /// The size of an end point in the sense of the form.
    fn size(&self, z: Expr<'a>, n: Expr<'a>) -> ComposeResult<Expr<'a>> {
        match (self.choice.form, self.settings.shape) {
            (DeForm::End, Some(shape)) => shape_at(self.composer, shape.field, z, n),
            (form, _) => Ok(plain_size(form, self.choice.axis, self.settings.escape, z)),
        }
    }

    /// How fast the size, or z itself, changes per unit of p by the method: the `dr` of every form.
    fn slope(&self, end: &End<'a>, h: Expr<'a>) -> Expr<'a> {
        let one = self.composer.arena.f(1.0);
        let of_gradient = || self.gradient(end, h).map_or(one, scaled_length);
        match self.choice.method {
            // Certified orbits end in a function of their own.
            Method::Scalar | Method::Own | Method::Certified | Method::CertifiedBall => end.dr.unwrap_or(one),
            Method::Gradient | Method::Potential | Method::Sinh => of_gradient(),
            Method::Combined => end.dr.map_or_else(of_gradient, |dr| dr.max(of_gradient())),
            Method::Jacobian => largest_singular_value(&end.rows),
            Method::Frobenius => frobenius_norm(&end.rows),
            Method::Directional => end.along.map_or(one, scaled_length),
            Method::Delta => match self.difference() {
                Difference::Z => largest_singular_value(&self.changes(end, h)),
                _ => of_gradient(),
            },
            Method::DeltaRay => match self.difference() {
                Difference::Z => scaled_length((end.shifted[0] - end.z) / h),
                _ => self.differences(end, h)[0].abs(),
            },
        }
    }

    /// The gradient of the size by p.
    fn gradient(&self, end: &End<'a>, h: Expr<'a>) -> Option<Expr<'a>> {
        let arena = self.composer.arena;
        if self.carried.jacobian {
            if !self.is_length() {
                let seeds = [(end.z, end.rows.clone())];
                return Some(Differentiator::of_gradients(arena, &seeds).tangents(end.size)[0]);
            }
            // Scaled before squaring: components of J may be as large as the square root of the range.
            let unit = end.z / end.size.max(arena.f(1e-30));
            return unit.components().into_iter().zip(&end.rows).map(|(u, row)| *row * u).reduce(|a, b| a + b);
        }
        (end.shifted.len() == 3).then(|| arena.compose(&self.differences(end, h)))
    }

    /// What finite differences are taken of: as wished, else what the form makes smoothest.
    fn difference(&self) -> Difference {
        self.choice.difference.unwrap_or(match (self.choice.method, self.choice.form) {
            // r may stay as it is along a ray that passes by: such steps miss.
            (Method::DeltaRay, _) => Difference::Z,
            (_, DeForm::Logarithmic) => Difference::LnR,
            _ => Difference::R,
        })
    }

    /// Finite differences of the size for each shifted point, all at one iteration count.
    fn differences(&self, end: &End<'a>, h: Expr<'a>) -> Vec<Expr<'a>> {
        let slope = |size: &Expr<'a>| {
            let size = *size;
            match self.difference() {
                Difference::LnR => (size / end.size).ln() * end.size / h,
                Difference::R | Difference::Z => (size - end.size) / h,
            }
        };
        end.sizes.iter().map(slope).collect()
    }

    /// The Jacobian's rows by finite differences.
    fn changes(&self, end: &End<'a>, h: Expr<'a>) -> Vec<Expr<'a>> {
        let arena = self.composer.arena;
        let columns: Vec<Vec<Expr<'a>>> = end.shifted.iter().map(|z| ((*z - end.z) / h).components()).collect();
        (0..columns[0].len()).map(|i| arena.compose(&[columns[0][i], columns[1][i], columns[2][i]])).collect()
    }

    /// The estimate in world units; negative in an end shape only. At a critical point the slope is 0 and the estimate grows beyond
    /// all bounds: it is [`FARTHEST`] there, as it nearly is beside. What is not a number, and what comes of a size that is
    /// infinite, comes out as not a number, to be counted: `max` may drop either, comparisons and sums do not.
    fn distance(&self, size: Expr<'a>, slope: Expr<'a>, n: Expr<'a>) -> Expr<'a> {
        let arena = self.composer.arena;
        let zero = arena.f(0.0);
        let tiny = arena.f(1e-30);
        // The same number, unless it is next to nothing.
        let known = slope + tiny;
        let converges = self.settings.escape.is_convergence();
        let logarithmic = || match converges {
            // Near a point that attracts by a power its logarithm is a potential as well, below 0.
            true => {
                let size = size.max(tiny);
                -(size * size.ln() * 0.5 / known)
            }
            false => size * size.ln() * 0.5 / known,
        };
        let d = match (self.choice.method, self.choice.form) {
            // |grad G| = |grad r| / (r power^n), so G / 2 |grad G| is the logarithmic form, and powers cannot overflow.
            (Method::Potential, _) => logarithmic(),
            (Method::Sinh, _) => logarithmic() * self.sinh_factor(size, n),
            (_, DeForm::Logarithmic) => logarithmic(),
            (_, DeForm::End) => size / known,
            (_, DeForm::Linear) if converges => (-size + self.choice.radius) / known,
            (_, DeForm::Linear | DeForm::Box | DeForm::Plane) => (size - self.choice.radius) / known,
        };
        let farthest = arena.f(FARTHEST);
        // A norm may lose NaN and be 0; the size does not.
        let far = size.lt(arena.f(1e38)).select(slope + farthest, arena.f(f64::NAN));
        // What `max` makes of NaN does not matter: it is not below the farthest.
        match self.choice.form {
            // In is what is not outside the shape, also where it is flat.
            DeForm::End => {
                let told = tiny.lt(slope).select(d.lt(farthest).select(d, far), far);
                size.le(zero).select(told.min(-tiny), told)
            }
            _ => d.lt(farthest).select(d.max(zero), far),
        }
    }

    /// e^-G sinh G / G = (1 - e^-2G) / 2G, from 1 near the set to 0 far away; G = ln r / power^n.
    fn sinh_factor(&self, r: Expr<'a>, n: Expr<'a>) -> Expr<'a> {
        let arena = self.composer.arena;
        // From a fixed start the first iteration gives the constant, which is where the potential begins.
        let n = if self.settings.start.is_some() { n - 1.0 } else { n };
        let potential = (r.ln() * (n * -self.choice.power.ln()).exp()).max(arena.f(0.0));
        let twice = potential * 2.0;
        let whole = (arena.f(1.0) - (-twice).exp()) / twice.max(arena.f(1e-3));
        // The difference loses its digits near 0; there the first terms of its series are exact enough.
        let series = arena.f(1.0) - twice * 0.5 + twice * twice * (1.0 / 6.0) - twice * twice * twice * (1.0 / 24.0);
        twice.lt(arena.f(1e-2)).select(series, whole)
    }
}

/// The size of an end point in the sense of a form, for orbits without an end shape.
pub(super) fn plain_size<'g>(form: DeForm, axis: [f64; 3], escape: Escape, z: Expr<'g>) -> Expr<'g> {
    match form {
        DeForm::Linear => super::escape::size(escape, z).unwrap_or_else(|| scaled_length(z)),
        DeForm::Logarithmic | DeForm::End => scaled_length(z),
        DeForm::Box => z.abs().components().into_iter().reduce(|a, b| a.max(b)).unwrap_or(z),
        DeForm::Plane => z.xyz().dot(z.arena.v3(axis)).abs(),
    }
}
