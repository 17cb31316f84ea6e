//! Tests of step files: worked examples on every back end, and both functions against the exact derivative.

use std::sync::Arc;

use rhai::Map;

use super::backends::{Backends, Target};
use super::report::expect_near;
use crate::expr::{Arena, Differentiator, Expr, Function, Port, Type};
use crate::formula::library::Library;
use crate::formula::shape::ShapeDistance;
use crate::formula::step::{ParamValue, StateWidth, Step, StepExample, StepInputs, Traced, script_value};
use crate::kernel::Kernel;
use crate::math::random::Random;

/// Random points of the derivative checks, and half the side of the box that they lie in.
const POINTS: usize = 50;
const REACH: f64 = 2.5;
/// How far beside an example's point derivatives are checked.
const BESIDE: f64 = 0.05;
/// Step of the central differences; the error is of its square, rounding of 1e-16 / 1e-5.
const DIFFERENCE: f64 = 1e-5;
/// Relative error of an exact derivative against differences that agree with those of half the step.
const DERIVATIVE_TOLERANCE: f64 = 1e-5;
/// Relative share that an exact rule may be below the true stretch: rounding of the singular value.
const BOUND_TOLERANCE: f64 = 1e-6;

/// Error of a shape's slope.
const SLOPE_TOLERANCE: f64 = 1e-6;

/// Number of the input that is what a step had before.
const BEFORE: u16 = 2;

/// Parameters that differ from the defaults.
pub(super) type Params = Vec<(String, ParamValue)>;

/// A step and where it is traced.
pub(super) struct StepCase<'a> {
    pub(super) library: &'a Library,
    pub(super) step: &'a Step,
    pub(super) backends: &'a Backends,
}

/// State widths that a step is checked with.
pub(super) fn widths(step: &Step) -> &'static [u8] {
    match step.state {
        StateWidth::Three => &[3],
        StateWidth::Four => &[4],
        StateWidth::Any => &[3, 4],
        StateWidth::Embeds => &[3],
    }
}

/// Components of what a step makes of a state: a shape's is its distance.
fn image_width(step: &Step, width: usize) -> usize {
    match step.state {
        _ if step.is_shape() => 1,
        StateWidth::Embeds => 4,
        _ => width,
    }
}

/// Length of what an error message shows of a vector.
fn shown(v: &[f64]) -> String {
    format!("{v:?}")
}

impl StepCase<'_> {
    fn params(&self, arena: &Arc<Arena>, given: &[(String, ParamValue)]) -> Map {
        let mut map = Map::new();
        for param in &self.step.params {
            let value = given.iter().find(|(name, _)| *name == param.name).map_or(&param.default, |(_, value)| value);
            map.insert(param.name.as_str().into(), script_value(arena, &param.kind, value));
        }
        map
    }

    pub(super) fn trace<'g>(
        &self,
        arena: &'g Arc<Arena>,
        width: u8,
        params: &[(String, ParamValue)],
        with_dr: bool,
    ) -> Result<(Vec<Port>, Traced<'g>), String> {
        let ty = Type::F.with_width(width);
        let ports = ["z", "c", "before"].map(|name| Port::new(name, ty)).into_iter();
        let ports = ports.chain(["dr", "before_dr"].map(|name| Port::new(name, Type::F))).collect();
        let number = |i: u16| with_dr.then(|| arena.input(i, Type::F));
        let before = self.step.remembers().then(|| Traced { z: arena.input(BEFORE, ty), dr: number(4) });
        let inputs = StepInputs { z: arena.input(0, ty), c: arena.input(1, ty), dr: number(3), before };
        let map = self.params(arena, params);
        if self.step.is_shape() {
            let Library { engine, sources, .. } = self.library;
            let distance = self.step.trace_distance(engine, sources, arena, inputs.z, &map);
            return distance
                .map(|z| (ports, Traced { z, dr: None }))
                .map_err(|error| error.rendered(&self.library.sources));
        }
        let traced = self.step.trace(&self.library.engine, &self.library.sources, arena, inputs, &map);
        traced.map(|traced| (ports, traced)).map_err(|error| error.rendered(&self.library.sources))
    }

    /// One worked example on one back end.
    pub(super) fn example(&self, example: &StepExample, target: Target) -> Result<(), String> {
        let arena = Arc::new(Arena::default());
        let width = example.z.len();
        let (ports, traced) = self.trace(&arena, width as u8, &example.params, example.dr.is_some())?;
        let mut function = Function::new("step", ports);
        function.output("z", traced.z);
        if let Some(dr) = traced.dr {
            function.output("dr", dr);
        }
        let mut c = example.c.clone().unwrap_or_default();
        c.resize(width, 0.0);
        let mut before = example.before.clone().unwrap_or_default();
        before.resize(width, 0.0);
        let drs = [example.dr.map_or(1.0, |(before, _)| before), example.before_dr];
        let inputs = example.z.iter().chain(&c).chain(&before).chain(&drs);
        let columns: Vec<Vec<f64>> = inputs.map(|x| vec![*x]).collect();
        let out = self.backends.run(target, &arena, &Kernel::Map(function), &columns).map_err(|e| e.to_string())?;
        let found: Vec<f64> = out.iter().map(|column| column[0]).collect();
        let tolerance = example.tolerance + target.step_slack();
        // A fold moves all components alike, so rounding is that of the largest one.
        let size = example.z.iter().chain(&example.expect).fold(1.0, |a: f64, b| a.max(b.abs()));
        let near = |(e, f): (&f64, &f64)| (e - f).abs() <= tolerance * size; // false for NaN
        if !example.expect.iter().zip(&found).all(near) {
            let text = format!("expected {}, found {}", shown(&example.expect), shown(&found[..example.expect.len()]));
            return Err(format!("step at z = {}: {text} (tolerance {:.1e})", shown(&example.z), tolerance * size));
        }
        match (example.dr, found.get(image_width(self.step, width))) {
            (Some((_, expected)), Some(found)) => expect_near("dr", *found, expected, tolerance),
            (Some(_), None) => Err("the example gives `dr`, but the step has no scalar rule".into()),
            (None, _) => Ok(()),
        }
    }

    /// Sets of parameters and points to check derivatives at: random ones, and for each example's parameters points beside
    /// its own (which often lie on a crease, where a derivative is anyone's choice).
    fn samples(&self, width: u8) -> Vec<(Params, Vec<Vec<f64>>)> {
        let mut random = Random::new(3);
        let points = (0..POINTS).map(|_| (0..width).map(|_| random.range(-REACH, REACH)).collect()).collect();
        let mut samples = vec![(Vec::new(), points)];
        let examples = self.step.examples.iter().filter(|e| e.z.len() == usize::from(width));
        samples.extend(examples.map(|e| {
            let mut beside = || e.z.iter().map(|x| x + random.range(-BESIDE, BESIDE)).collect();
            (e.params.clone(), (0..4).map(|_| beside()).collect())
        }));
        samples
    }

    /// The automatic derivative against central differences, away from creases.
    pub(super) fn derivative(&self) -> Result<(), String> {
        for &width in widths(self.step) {
            for (params, points) in self.samples(width) {
                for &by in self.states() {
                    self.derivative_at(width, &params, &points, by)?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn jacobian_function(
        &self,
        arena: &Arc<Arena>,
        width: u8,
        params: &[(String, ParamValue)],
        with_dr: bool,
    ) -> Result<Function, String> {
        self.jacobian_by(arena, width, params, (0, with_dr))
    }

    /// The derivative by the input `by`: the state's number, or [`BEFORE`].
    fn jacobian_by(
        &self,
        arena: &Arc<Arena>,
        width: u8,
        params: &[(String, ParamValue)],
        (by, with_dr): (u16, bool),
    ) -> Result<Function, String> {
        let (ports, traced) = self.trace(arena, width, params, with_dr)?;
        let mut function = Function::new("jacobian", ports);
        function.output("z", traced.z);
        let z = arena.input(by, Type::F.with_width(width));
        for i in 0..width {
            let mut axis = [0.0; 4];
            axis[usize::from(i)] = 1.0;
            let seeds: [(Expr, Expr); 1] = [(z, arena.constant(z.ty(), axis))];
            function.output(format!("j_{i}"), Differentiator::new(arena, &seeds).derivative(traced.z));
        }
        if let Some(dr) = traced.dr {
            function.output("dr", dr);
        }
        Ok(function)
    }

    /// Columns of inputs for states, with a fixed constant and state before, and running derivatives of 1 and 0.
    pub(super) fn columns(width: u8, states: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut columns: Vec<Vec<f64>> =
            (0..usize::from(width)).map(|i| states.iter().map(|z| z[i]).collect()).collect();
        for fixed in [[0.3, -0.2, 0.45, 0.1], [-0.4, 0.25, 0.15, -0.35]] {
            columns.extend(fixed.iter().take(usize::from(width)).map(|x| vec![*x; states.len()]));
        }
        columns.extend([1.0, 0.0].map(|dr| vec![dr; states.len()]));
        columns
    }

    fn derivative_at(
        &self,
        width: u8,
        params: &[(String, ParamValue)],
        points: &[Vec<f64>],
        by: u16,
    ) -> Result<(), String> {
        let arena = Arc::new(Arena::default());
        let function = self.jacobian_by(&arena, width, params, (by, false))?;
        let n = usize::from(width);
        let m = image_width(self.step, n);
        // Each point, then along each axis four moves: -h, +h, -h/2, +h/2.
        let mut states = Vec::new();
        for p in points {
            states.push(p.clone());
            let h = DIFFERENCE * p.iter().fold(1.0, |a: f64, b| a.max(b.abs()));
            for axis in 0..n {
                for offset in [-h, h, -h / 2.0, h / 2.0] {
                    let mut moved = p.clone();
                    moved[axis] += offset;
                    states.push(moved);
                }
            }
        }
        let kernel = Kernel::Map(function);
        let out = self.backends.run(Target::CPU_F64, &arena, &kernel, &Self::columns_by(width, &states, by));
        let out = out.map_err(|e| e.to_string())?;
        let each = 1 + 4 * n;
        for (i, p) in points.iter().enumerate() {
            for axis in 0..n {
                for component in 0..m {
                    let value = |k: usize| out[component][i * each + 1 + 4 * axis + k];
                    let h = DIFFERENCE * p.iter().fold(1.0, |a: f64, b| a.max(b.abs()));
                    let (wide, narrow) = ((value(1) - value(0)) / (2.0 * h), (value(3) - value(2)) / h);
                    let one_sided = (out[component][i * each] - value(0)) / h;
                    let exact = out[m * (1 + axis) + component][i * each];
                    let size = wide.abs().max(1.0);
                    // Differences that disagree stand over a crease or a pole; so do one-sided ones that differ.
                    let smooth = (wide - narrow).abs() <= 1e-6 * size && (one_sided - wide).abs() <= 1e-2 * size;
                    let near = (exact - wide).abs() <= DERIVATIVE_TOLERANCE * size;
                    if smooth && !near {
                        return Err(format!(
                            "at z = {} with {params:?}: derivative of component {component} along axis {axis}: \
                             expected {wide} (central difference), found {exact}",
                            shown(p)
                        ));
                    }
                }
            }
        }
        Ok(())
    }

    /// A rule that calls itself exact is never below the largest stretch of the differentiated map.
    pub(super) fn bound(&self) -> Result<(), String> {
        for &width in widths(self.step) {
            for (params, points) in self.samples(width) {
                for &by in self.states() {
                    self.bound_by(width, &params, &points, by)?;
                }
            }
        }
        Ok(())
    }

    /// Of a step that remembers the rule bounds the stretch by each of the two states, the other one at rest.
    fn bound_by(&self, width: u8, params: &Params, points: &[Vec<f64>], by: u16) -> Result<(), String> {
        let arena = Arc::new(Arena::default());
        let kernel = Kernel::Map(self.jacobian_by(&arena, width, params, (by, true))?);
        let out = self.backends.run(Target::CPU_F64, &arena, &kernel, &Self::columns_by(width, points, by));
        let out = out.map_err(|e| e.to_string())?;
        let n = usize::from(width);
        let m = image_width(self.step, n);
        for (i, p) in points.iter().enumerate() {
            let columns: Vec<Vec<f64>> = (0..n).map(|a| (0..m).map(|k| out[m * (1 + a) + k][i]).collect()).collect();
            let (stretch, rule) = (largest_stretch(&columns), out[m * (1 + n)][i]);
            let bounds = rule >= stretch * (1.0 - BOUND_TOLERANCE);
            let name = if by == BEFORE { "before" } else { "z" };
            if stretch.is_finite() && !bounds {
                return Err(format!(
                    "at {name} = {} with {params:?}: the rule is marked exact; expected at least the stretch {stretch}, found {rule}",
                    shown(p)
                ));
            }
        }
        Ok(())
    }

    /// Inputs that a step is differentiated by.
    fn states(&self) -> &'static [u16] {
        if self.step.remembers() { &[0, BEFORE] } else { &[0] }
    }

    /// Columns where the input `by` runs over the states: the others are fixed, their running derivatives 0.
    fn columns_by(width: u8, states: &[Vec<f64>], by: u16) -> Vec<Vec<f64>> {
        let mut columns = Self::columns(width, states);
        if by == BEFORE {
            let n = usize::from(width);
            (0..n).for_each(|i| columns.swap(i, usize::from(BEFORE) * n + i));
            columns.swap(3 * n, 3 * n + 1);
        }
        columns
    }
}

impl StepCase<'_> {
    /// The slope of a shape's distance: nowhere above 1, and 1 outside of a shape whose distance is exact. Of four
    /// components it is asked on the unit sphere alone.
    pub(super) fn slope(&self) -> Result<(), String> {
        for &width in widths(self.step) {
            for (params, mut points) in self.samples(width) {
                if width == 4 {
                    points.iter_mut().for_each(|p| {
                        let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
                        p.iter_mut().for_each(|x| *x /= length);
                    });
                }
                let arena = Arc::new(Arena::default());
                let kernel = Kernel::Map(self.jacobian_function(&arena, width, &params, false)?);
                let out = self.backends.run(Target::CPU_F64, &arena, &kernel, &Self::columns(width, &points));
                let out = out.map_err(|e| e.to_string())?;
                for (i, p) in points.iter().enumerate() {
                    let slope = (1..=usize::from(width)).map(|k| out[k][i] * out[k][i]).sum::<f64>().sqrt();
                    let must_rise = self.step.distance == Some(ShapeDistance::Exact) && out[0][i] > 0.0;
                    let least = if must_rise { 1.0 - SLOPE_TOLERANCE } else { 0.0 };
                    if !(least..=1.0 + SLOPE_TOLERANCE).contains(&slope) {
                        let text = format!("expected a slope of {least} to 1 (fn distance), found {slope}");
                        return Err(format!("at z = {} with {params:?}: {text}", shown(p)));
                    }
                }
            }
        }
        Ok(())
    }
}

/// The largest singular value of a matrix given by columns, by Jacobi rotations of the Gram matrix.
pub(super) fn largest_stretch(columns: &[Vec<f64>]) -> f64 {
    let n = columns.len();
    let mut g: Vec<Vec<f64>> = (0..n)
        .map(|i| (0..n).map(|j| columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum()).collect())
        .collect();
    for _ in 0..30 {
        for p in 0..n {
            for q in p + 1..n {
                if g[p][q] == 0.0 {
                    continue;
                }
                let angle = 0.5 * (2.0 * g[p][q]).atan2(g[q][q] - g[p][p]);
                let (s, c) = angle.sin_cos();
                for row in &mut g {
                    let (a, b) = (row[p], row[q]);
                    row[p] = c * a - s * b;
                    row[q] = s * a + c * b;
                }
                let (above, below) = g.split_at_mut(q);
                for (x, y) in above[p].iter_mut().zip(&mut below[0]) {
                    (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
                }
            }
        }
    }
    (0..n).map(|i| g[i][i]).fold(0.0, f64::max).sqrt()
}
