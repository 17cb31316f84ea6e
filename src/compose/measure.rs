//! What is measured of an orbit's map in f64: how r grows far out, how far the set reaches, and whether the scalar rules grow as
//! fast as orbits do.

use super::maps::{Memory, Moved, apply};
use super::norm::scaled_length;
use super::orbit::{Carried, OrbitBuilder};
use super::placement::Frame;
use super::{Choice, ComposeResult, Composer, FieldOrbit, Purpose};
use crate::expr::{Function, Port, Type};
use crate::graph::{DeForm, NodeRef, OrbitSettings, resolve_schedule};
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::{Backend, Estimator, Kernel, inwards};
use crate::math::Precision;

/// Unit vectors spread evenly over the sphere (Fibonacci lattice), turned by `turn`.
pub(super) fn directions(count: usize, turn: f64) -> Vec<[f64; 3]> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let ring = (1.0 - z * z).sqrt();
            let angle = golden * i as f64 + turn;
            [ring * angle.cos(), ring * angle.sin(), z]
        })
        .collect()
}

/// How r grows far out.
pub(super) struct OrbitGrowth {
    /// Power in one iteration, on average over a cycle; 1 where r grows by a factor.
    pub(super) power: f64,
    /// In words.
    pub(super) evidence: String,
}

impl OrbitGrowth {
    /// The form that it calls for: a constant ratio is linear, a growing one logarithmic.
    pub(super) fn form(&self) -> DeForm {
        if self.power > 1.0 { DeForm::Logarithmic } else { DeForm::Linear }
    }
}

/// Cycles are measured in their first iterations only, which bounds the size of the function.
const MEASURED_CYCLE: usize = 16;

/// Measures the growth of r over one cycle, far out.
pub(super) fn measure_growth(composer: &Composer, orbit: &FieldOrbit) -> ComposeResult<OrbitGrowth> {
    let (function, iterations) = compose_growth(composer, orbit.root, &orbit.settings)?;
    let width = composer.graph.state_width(orbit.root, &orbit.settings) as usize;
    let cpu = Cpu::new(Precision::F64);
    let points = directions(64, 0.3);
    let radius_after = |scale: f64| -> Vec<f64> {
        let columns: Vec<Vec<f64>> =
            (0..width).map(|i| points.iter().map(|p| p.get(i).copied().unwrap_or(0.4) * scale).collect()).collect();
        run_f64(&cpu, composer, &Kernel::Map(function.clone()), &columns).swap_remove(0)
    };
    let exponent_between = |(near, far): (f64, f64)| -> f64 {
        let pairs = radius_after(near).into_iter().zip(radius_after(far));
        let exponents = pairs.map(|(a, b)| (b / a).ln() / (far / near).ln());
        let mut exponents: Vec<f64> = exponents.map(|e| if e.is_finite() { e } else { f64::MAX }).collect();
        exponents.sort_by(f64::total_cmp);
        exponents[exponents.len() / 2]
    };
    // What goes up and down grows in one decade and not in another: the smaller one counts.
    let first = exponent_between((1e3, 1e4));
    let exponent = if first > 1.05 { first.min(exponent_between((1.3e4, 1.1e5))) } else { first };
    Ok(if exponent > 1.05 {
        let shown = if exponent == f64::MAX { "a high power".to_string() } else { format!("power {exponent:.2}") };
        let power = exponent.powf(1.0 / iterations.max(1) as f64);
        OrbitGrowth { power, evidence: format!("far out r grows by {shown} a cycle") }
    } else {
        OrbitGrowth { power: 1.0, evidence: "far out r grows by a constant factor a cycle".to_string() }
    })
}

/// A function that maps z to r after one cycle of the schedule without its constants: how orbits grow far out. Also gives
/// the number of iterations in it: 16 at most.
pub fn compose_growth(
    composer: &Composer,
    root: NodeRef,
    settings: &OrbitSettings,
) -> ComposeResult<(Function, usize)> {
    let width = composer.graph.state_width(root, settings);
    let (maps, schedule) = resolve_schedule(composer.graph, root, settings.constant, settings.max_iterations);
    let mut function = Function::new("growth", vec![Port::new("z", Type::F.with_width(width))]);
    let z = composer.arena.input(0, Type::F.with_width(width));
    let n = composer.arena.f(0.0);
    let mut moved = Moved { z, dr: None };
    let mut memory = Memory::nothing(composer, root, moved);
    for item in schedule.cycle.iter().take(MEASURED_CYCLE) {
        moved = apply(composer, &maps[*item].map, moved, z.lift(0.0), n, &mut memory)?;
    }
    function.output("r", moved.z.length());
    Ok((function, schedule.cycle.len().min(MEASURED_CYCLE)))
}

/// Runs a kernel on the reference back end, which cannot fail.
pub(crate) fn run_f64(cpu: &Cpu, composer: &Composer, kernel: &Kernel, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let prepared = cpu.prepare(composer.arena, kernel).expect("the CPU takes every kernel");
    run_prepared(cpu, &prepared, columns)
}

/// The same for a kernel that runs several times.
pub(crate) fn run_prepared(cpu: &Cpu, prepared: &CpuKernel, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let columns = cpu.upload(columns).expect("the CPU holds every column");
    let result = cpu.run(prepared, &[&columns]).expect("the CPU runs every kernel");
    cpu.download(&result).expect("the CPU holds every column")
}

/// Radius of a ball around the orbit's own origin that holds every point whose orbit is still in after a few iterations:
/// an outer bound of the set, found by trying points on spheres from outside inwards.
pub(super) fn measure_extent(composer: &Composer, orbit: &FieldOrbit) -> ComposeResult<f64> {
    let mut probe = orbit.clone();
    probe.frame = Frame::default();
    let mut best = f64::MAX;
    // Few iterations leave the set thick enough for samples to hit, many leave it tight: the smallest hit ball wins.
    for iterations in [4, 7, 11, 16] {
        if iterations > orbit.settings.max_iterations && best != f64::MAX {
            break;
        }
        let limit = iterations.min(orbit.settings.max_iterations).max(1);
        let settings = OrbitSettings { max_iterations: limit, ..orbit.settings.clone() };
        let membership = compose_membership(composer, orbit.root, &settings)?;
        let cpu = Cpu::new(Precision::F64);
        let found = outermost_member(&cpu, composer, &membership);
        let Some(found) = found else { break };
        // A ball that shrinks at once means that the samples began to miss a thin set, not that it is smaller.
        if best != f64::MAX && found < best / 1.5 {
            break;
        }
        best = best.min(found);
    }
    let extent = if best == f64::MAX { 2.0 } else { best };
    beyond(composer, &probe, extent)
}

/// Points asked around a ball whether the set reaches beyond, at each of [`FURTHER`] goes.
const AROUND: usize = 2048;
const FURTHER: usize = 8;

/// The extent, or a larger one where members are beyond it: samples on spheres miss what is thin.
fn beyond(composer: &Composer, orbit: &FieldOrbit, mut extent: f64) -> ComposeResult<f64> {
    let cpu = Cpu::new(Precision::F64);
    let membership = compose_membership(composer, orbit.root, &orbit.settings)?;
    let membership = cpu.prepare(composer.arena, &membership).expect("the CPU takes every kernel");
    for go in 0..FURTHER {
        // From the extent to four times that, the golden section apart.
        let radius = |i: usize| extent * 4f64.powf((0.618_033_988_75 * i as f64).fract());
        let points = directions(AROUND, go as f64).into_iter().enumerate();
        let points: Vec<[f64; 3]> = points.map(|(i, p)| p.map(|x| x * radius(i * 311))).collect();
        let columns = Estimator::columns(&points, &points.iter().map(inwards).collect::<Vec<_>>(), &[1e-4], 0.0);
        let inside = run_prepared(&cpu, &membership, &columns).swap_remove(0);
        let reached = points
            .iter()
            .zip(inside)
            .filter(|(_, inside)| *inside > 0.5)
            .map(|(p, _)| p.iter().map(|x| x * x).sum::<f64>().sqrt());
        let farthest = reached.fold(0.0, f64::max);
        if farthest <= extent {
            break;
        }
        extent = farthest;
    }
    Ok(extent)
}

/// The largest sampled radius with a point inside, one sampling step further out.
fn outermost_member(cpu: &Cpu, composer: &Composer, membership: &Kernel) -> Option<f64> {
    let ratio: f64 = 1.08;
    let mut radius = 40.0;
    let membership = cpu.prepare(composer.arena, membership).expect("the CPU takes every kernel");
    for shell in 0..90 {
        let points = directions(600, f64::from(shell));
        let points: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| x * radius)).collect();
        let columns = Estimator::columns(&points, &points.iter().map(inwards).collect::<Vec<_>>(), &[1e-4], 0.0);
        let inside = run_prepared(cpu, &membership, &columns).swap_remove(0);
        if inside.iter().any(|&i| i > 0.5) {
            return Some(radius * ratio * ratio);
        }
        radius /= ratio;
    }
    None
}

/// A kernel that says `inside` for points of an orbit's own frame.
fn compose_membership(composer: &Composer, root: NodeRef, settings: &OrbitSettings) -> ComposeResult<Kernel> {
    let choice = Choice::default();
    let frame = Frame::default();
    let width = composer.graph.state_width(root, settings);
    let is_shape = settings.shape.is_some();
    let choice = Choice { form: if is_shape { DeForm::End } else { choice.form }, ..choice };
    let carried = Carried::NOTHING;
    let purpose = Purpose::Estimate;
    let builder = OrbitBuilder { composer, settings, root, frame: &frame, width, carried, choice: &choice, purpose };
    let orbit = builder.build("membership".to_string())?;
    let mut inputs = Estimator::inputs();
    inputs.extend(orbit.finish.output_ports());
    inputs.push(Port::new("inside", Type::B));
    inputs.push(Port::new("n", Type::F));
    let mut combine = Function::new("combine", inputs);
    let mut inside = composer.arena.input((combine.inputs.len() - 2) as u16, Type::B);
    if is_shape {
        let de = composer.arena.input(Estimator::inputs().len() as u16, Type::F);
        inside = inside.and(de.lt(composer.arena.f(0.0)));
    }
    combine.output("inside", inside);
    Ok(Kernel::Estimate(Estimator { orbits: vec![orbit], combine }))
}

/// Shells around the origin, and points on each of them, whose orbits tell how fast derivatives grow.
const SHELLS: usize = 8;
const POINTS: usize = 32;
/// Derivatives below this one say nothing of a factor for each iteration.
const GROWN: f64 = 8.0;
/// Share of the scalar rules' exponent that the real one must have. Those of the Mandelbox have 0.87 with 10 iterations and less with
/// fewer, since the "+1" is a sum of lengths; with 0.73 (amazing_cylinder) depths began to differ, with 0.65 stops were early.
const TIGHT: f64 = 0.75;

/// Whether the scalar rules grow as fast as orbits do: products of norms, which bound what is not conformal, may grow far
/// faster. `extent` is the set's.
pub(super) fn measure_tightness(composer: &Composer, orbit: &FieldOrbit, extent: f64) -> ComposeResult<bool> {
    let kernel = compose_derivatives(composer, orbit.root, &orbit.settings)?;
    let shells = (1..=SHELLS).map(|shell| extent * shell as f64 / SHELLS as f64);
    let points: Vec<[f64; 3]> =
        shells.flat_map(|radius| directions(POINTS, radius).into_iter().map(move |p| p.map(|x| x * radius))).collect();
    let along: Vec<[f64; 3]> = directions(points.len(), 1.0);
    let turned: Vec<[f64; 3]> = (0..points.len()).map(|i| along[i * 311 % points.len()]).collect();
    let columns = Estimator::columns(&points, &turned, &[1e-4], 0.0);
    let [rules, real]: [Vec<f64>; 2] =
        run_f64(&Cpu::new(Precision::F64), composer, &kernel, &columns).try_into().expect("two outputs");
    let grown = rules.iter().zip(&real).filter(|(dr, along)| **dr > GROWN && dr.is_finite() && along.is_finite());
    let (by_rules, really) = grown.fold((0.0, 0.0), |(a, b), (dr, along)| (a + dr.ln(), b + along.max(1e-300).ln()));
    Ok(by_rules * TIGHT <= really)
}

/// A kernel that gives the derivative of an orbit by the scalar rules and along the ray, for points of its own frame.
fn compose_derivatives(composer: &Composer, root: NodeRef, settings: &OrbitSettings) -> ComposeResult<Kernel> {
    let choice = Choice::default();
    let width = composer.graph.state_width(root, settings);
    let carried = Carried { scalar: true, along: true, ..Carried::NOTHING };
    let (frame, choice, purpose) = (&Frame::default(), &choice, Purpose::Estimate);
    let builder = OrbitBuilder { composer, settings, root, frame, width, carried, choice, purpose };
    let mut orbit = builder.build("derivatives".to_string())?;
    let (start, _) = builder.start()?;
    let state = start.as_inputs(0);
    let mut finish = Function::new("derivatives_finish", orbit.finish.inputs.clone());
    let zero = || composer.arena.f(0.0);
    finish.output("dr", state.dr.unwrap_or_else(zero));
    finish.output("along", state.along.map_or_else(zero, scaled_length));
    orbit.finish = finish;
    let mut inputs = Estimator::inputs();
    let first = inputs.len() as u16;
    inputs.extend(orbit.finish.output_ports());
    inputs.extend([Port::new("inside", Type::B), Port::new("n", Type::F)]);
    let mut combine = Function::new("combine", inputs);
    combine.output("dr", composer.arena.input(first, Type::F));
    combine.output("along", composer.arena.input(first + 1, Type::F));
    Ok(Kernel::Estimate(Estimator { orbits: vec![orbit], combine }))
}
