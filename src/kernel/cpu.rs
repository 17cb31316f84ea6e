//! The embedded CPU back end: tapes interpreted over packs of rays, in f64 (one ray at a time, the reference) or in wide
//! f32 (as many rays as four of the machine's vectors hold), with the work spread over threads.
//!
//! The loops here (iterate, march) have twins of the same names in `shaders/`; everything straight-line is a tape.

use std::ops::Range;

use fearless_simd::{Level, Simd, SimdBase, dispatch};
use rayon::prelude::*;

use super::tape::{Code, Constants, Instruction, Tape, lower_group};
use super::{Backend, BackendError, Estimator, Kernel, March, Orbit, Status, march_output_ports, ray_ports};
use crate::expr::ops::{Register, execute};
use crate::expr::{Arena, Port};
use crate::graph::Schedule;
use crate::math::{Lanes, Real};

/// Vectors that one register holds.
const WIDE: usize = 4;
/// Elements that one task works on.
const GROUP: usize = 1024;

/// Precision of the CPU back end.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Precision {
    /// Wide single precision.
    F32,
    /// Scalar double precision.
    F64,
}

/// The CPU back end.
#[derive(Clone, Copy, Debug)]
pub struct Cpu {
    precision: Precision,
    level: Level,
}

/// A kernel as tapes.
pub struct CpuKernel {
    program: Program,
    inputs: usize,
    outputs: usize,
}

enum Program {
    Map(TapeSet),
    Estimate(EstimatorTapes),
    March(MarchTapes),
}

/// Tapes that share a register file, and its constants.
struct TapeSet {
    tapes: Vec<Tape>,
    constants: Constants,
    registers: usize,
}

struct OrbitTapes {
    set: TapeSet,
    state: usize,
    frozen: usize,
    items: usize,
    schedule: Schedule,
    max_iterations: u32,
}

struct EstimatorTapes {
    orbits: Vec<OrbitTapes>,
    combine: TapeSet,
}

struct MarchTapes {
    estimator: EstimatorTapes,
    locate: TapeSet,
    advance: TapeSet,
    max_march_steps: u32,
}

/// Columns in memory, in the precision that the back end computes in.
#[derive(Clone, Debug)]
pub enum CpuColumns {
    /// Single precision.
    F32(Vec<Vec<f32>>),
    /// Double precision.
    F64(Vec<Vec<f64>>),
}

impl Cpu {
    /// A back end of this precision, at the best instruction set of the machine.
    pub fn new(precision: Precision) -> Cpu {
        Cpu { precision, level: Level::new() }
    }

    /// The precision.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The instruction set in use and the number of rays that one pack holds.
    pub fn description(&self) -> String {
        match self.precision {
            Precision::F64 => "cpu, f64, 1 ray at a time".into(),
            Precision::F32 => {
                let lanes = dispatch!(self.level, simd => pack_lanes(simd));
                format!("cpu, f32, {lanes} rays at a time ({:?})", self.level)
            }
        }
    }
}

#[inline(always)]
fn pack_lanes<S: Simd>(_: S) -> usize {
    S::f32s::LEN * WIDE
}

impl Backend for Cpu {
    type Prepared = CpuKernel;
    type Columns = CpuColumns;

    fn prepare(&self, arena: &Arena, kernel: &Kernel) -> Result<CpuKernel, BackendError> {
        let program = match kernel {
            Kernel::Map(function) => Program::Map(TapeSet::new(arena, &[(function, 0)], 0)),
            Kernel::Estimate(estimator) => Program::Estimate(EstimatorTapes::new(arena, estimator)),
            Kernel::March(march) => Program::March(MarchTapes::new(arena, march)),
        };
        Ok(CpuKernel { program, inputs: Port::scalars(&kernel.inputs()), outputs: Port::scalars(&kernel.outputs()) })
    }

    fn upload(&self, columns: &[Vec<f64>]) -> Result<CpuColumns, BackendError> {
        Ok(match self.precision {
            Precision::F64 => CpuColumns::F64(columns.to_vec()),
            Precision::F32 => CpuColumns::F32(columns.iter().map(|c| c.iter().map(|&x| x as f32).collect()).collect()),
        })
    }

    fn download(&self, columns: &CpuColumns) -> Result<Vec<Vec<f64>>, BackendError> {
        Ok(match columns {
            CpuColumns::F64(columns) => columns.clone(),
            CpuColumns::F32(columns) => columns.iter().map(|c| c.iter().map(|&x| f64::from(x)).collect()).collect(),
        })
    }

    fn run(&self, kernel: &CpuKernel, inputs: &[&CpuColumns]) -> Result<CpuColumns, BackendError> {
        Ok(match self.precision {
            Precision::F64 => {
                let columns: Vec<&[f64]> = inputs.iter().flat_map(|c| c.f64s()).collect();
                CpuColumns::F64(run_parallel(kernel, &columns, |k, i, o| run_group::<f64, 1>((), k, i, o)))
            }
            Precision::F32 => {
                let columns: Vec<&[f32]> = inputs.iter().flat_map(|c| c.f32s()).collect();
                let level = self.level;
                CpuColumns::F32(run_parallel(kernel, &columns, |k, i, o| {
                    dispatch!(level, simd => run_group::<Lanes<_>, WIDE>(simd, k, i, o));
                }))
            }
        })
    }
}

impl CpuColumns {
    fn f32s(&self) -> Vec<&[f32]> {
        match self {
            CpuColumns::F32(columns) => columns.iter().map(Vec::as_slice).collect(),
            CpuColumns::F64(_) => Vec::new(),
        }
    }

    fn f64s(&self) -> Vec<&[f64]> {
        match self {
            CpuColumns::F64(columns) => columns.iter().map(Vec::as_slice).collect(),
            CpuColumns::F32(_) => Vec::new(),
        }
    }
}

/// Cuts the columns into groups, runs each, and puts the results together.
fn run_parallel<T: Copy + Default + Send + Sync>(
    kernel: &CpuKernel,
    inputs: &[&[T]],
    run: impl Fn(&CpuKernel, &[&[T]], &mut [Vec<T>]) + Sync,
) -> Vec<Vec<T>> {
    assert_eq!(inputs.len(), kernel.inputs, "columns must match the kernel's inputs");
    let len = inputs.first().map_or(0, |c| c.len());
    let groups: Vec<Range<usize>> = (0..len).step_by(GROUP).map(|start| start..(start + GROUP).min(len)).collect();
    let results: Vec<Vec<Vec<T>>> = groups
        .into_par_iter()
        .map(|range| {
            let slices: Vec<&[T]> = inputs.iter().map(|c| &c[range.clone()]).collect();
            let mut outputs = vec![vec![T::default(); range.len()]; kernel.outputs];
            run(kernel, &slices, &mut outputs);
            outputs
        })
        .collect();
    let mut columns = vec![Vec::with_capacity(len); kernel.outputs];
    for group in results {
        for (column, part) in columns.iter_mut().zip(group) {
            column.extend(part);
        }
    }
    columns
}

impl TapeSet {
    fn new(arena: &Arena, functions: &[(&crate::expr::Function, u16)], free_from: u16) -> TapeSet {
        let end = functions.iter().map(|(f, at)| at + Port::scalars(&f.inputs) as u16).max().unwrap_or(0);
        let (tapes, constants) = lower_group(arena, functions, end.max(free_from));
        let registers = tapes.iter().map(|t| t.register_count).max().unwrap_or(0);
        TapeSet { tapes, constants, registers }
    }

    fn register_file<R: Real, const K: usize>(&self, token: R::Token) -> Vec<Register<R, K>> {
        let mut registers = vec![[R::splat(token, 0.0); K]; self.registers];
        for (register, value) in self.constants.iter() {
            registers[register as usize] = [R::splat(token, value); K];
        }
        registers
    }
}

impl OrbitTapes {
    fn new(arena: &Arena, orbit: &Orbit) -> OrbitTapes {
        let state = Port::scalars(&orbit.state);
        let frozen = Port::scalars(&orbit.frozen);
        let init_at = (state + frozen + 1) as u16;
        let mut functions = vec![(&orbit.init, init_at), (&orbit.finish, 0)];
        functions.extend(orbit.items.iter().map(|item| (item, 0)));
        OrbitTapes {
            set: TapeSet::new(arena, &functions, init_at),
            state,
            frozen,
            items: 2,
            schedule: orbit.schedule.clone(),
            max_iterations: orbit.max_iterations,
        }
    }
}

impl EstimatorTapes {
    fn new(arena: &Arena, estimator: &Estimator) -> EstimatorTapes {
        EstimatorTapes {
            orbits: estimator.orbits.iter().map(|orbit| OrbitTapes::new(arena, orbit)).collect(),
            combine: TapeSet::new(arena, &[(&estimator.combine, 0)], 0),
        }
    }
}

impl MarchTapes {
    fn new(arena: &Arena, march: &March) -> MarchTapes {
        MarchTapes {
            estimator: EstimatorTapes::new(arena, &march.estimator),
            locate: TapeSet::new(arena, &[(&march.locate, 0)], 0),
            advance: TapeSet::new(arena, &[(&march.advance, 0)], 0),
            max_march_steps: march.max_march_steps,
        }
    }
}

/// A number type that tapes can be interpreted over: knows how to enable its instruction set for a call.
pub trait Machine: Real {
    /// Calls `f` in a function compiled for the token's instruction set.
    fn enter<T>(token: Self::Token, f: impl FnOnce() -> T) -> T;
}

impl Machine for f64 {
    #[inline(always)]
    fn enter<T>((): (), f: impl FnOnce() -> T) -> T {
        f()
    }
}

impl<S: Simd> Machine for Lanes<S> {
    #[inline(always)]
    fn enter<T>(token: S, f: impl FnOnce() -> T) -> T {
        token.vectorize(f)
    }
}

/// Runs a tape on a register file. One instance a number type, entered by a plain call.
#[inline(never)]
fn interpret<R: Machine, const K: usize>(token: R::Token, tape: &Tape, registers: &mut [Register<R, K>]) {
    R::enter(
        token,
        #[inline(always)]
        || {
            for instruction in &tape.instructions {
                run_instruction::<R, K>(token, instruction, registers);
            }
        },
    );
}

#[inline(always)]
fn run_instruction<R: Machine, const K: usize>(
    token: R::Token,
    instruction: &Instruction,
    registers: &mut [Register<R, K>],
) {
    let o = &instruction.operands;
    match instruction.code {
        Code::Apply(operator) => execute::<R, K>(operator, token, registers, o),
        Code::Dot => {
            let (a, b) = (registers[o.args[0][0] as usize], registers[o.args[1][0] as usize]);
            let mut sum = a;
            for k in 0..K {
                sum[k] = a[k] * b[k];
            }
            for i in 1..o.width as usize {
                let (a, b) = (registers[o.args[0][i] as usize], registers[o.args[1][i] as usize]);
                for k in 0..K {
                    sum[k] = a[k].mul_add(b[k], sum[k]);
                }
            }
            registers[o.dst[0] as usize] = sum;
        }
        Code::SinCos => {
            for k in 0..K {
                let (sin, cos) = registers[o.args[0][0] as usize][k].sin_cos();
                registers[o.dst[0] as usize][k] = sin;
                registers[o.dst[1] as usize][k] = cos;
            }
        }
        Code::Copy => registers[o.dst[0] as usize] = registers[o.args[0][0] as usize],
    }
}

/// Register files of one task.
struct Files<R: Real, const K: usize> {
    orbits: Vec<Vec<Register<R, K>>>,
    combine: Vec<Register<R, K>>,
}

impl<R: Machine, const K: usize> Files<R, K> {
    fn new(token: R::Token, tapes: &EstimatorTapes) -> Self {
        Files {
            orbits: tapes.orbits.iter().map(|o| o.set.register_file(token)).collect(),
            combine: tapes.combine.register_file(token),
        }
    }
}

#[inline(always)]
fn run_group<R: Machine, const K: usize>(
    token: R::Token,
    kernel: &CpuKernel,
    inputs: &[&[R::Scalar]],
    outputs: &mut [Vec<R::Scalar>],
) where
    R::Scalar: Default,
{
    match &kernel.program {
        Program::Map(set) => run_map::<R, K>(token, set, inputs, outputs),
        Program::Estimate(tapes) => run_estimates::<R, K>(token, tapes, inputs, outputs),
        Program::March(tapes) => run_march::<R, K>(token, tapes, inputs, outputs),
    }
}

/// Reads a pack of a column, repeating the last element beyond its end.
#[inline(always)]
fn load_pack<R: Real, const K: usize>(token: R::Token, column: &[R::Scalar], at: usize) -> Register<R, K> {
    let mut register = [R::splat(token, 0.0); K];
    for (k, value) in register.iter_mut().enumerate() {
        let from = at + k * R::LANES;
        if from + R::LANES <= column.len() {
            *value = R::load(token, &column[from..]);
        } else {
            let mut lanes = [column[column.len() - 1]; 64];
            if from < column.len() {
                lanes[..column.len() - from].copy_from_slice(&column[from..]);
            }
            *value = R::load(token, &lanes);
        }
    }
    register
}

/// Writes a pack into a column, leaving out what lies beyond its end.
#[inline(always)]
fn store_pack<R: Real, const K: usize>(register: &Register<R, K>, column: &mut [R::Scalar], at: usize) {
    for (k, value) in register.iter().enumerate() {
        let from = at + k * R::LANES;
        if from + R::LANES <= column.len() {
            value.store(&mut column[from..]);
        } else if from < column.len() {
            let mut lanes = [column[0]; 64];
            value.store(&mut lanes);
            let count = column.len() - from;
            column[from..].copy_from_slice(&lanes[..count]);
        }
    }
}

#[inline(always)]
fn run_map<R: Machine, const K: usize>(
    token: R::Token,
    set: &TapeSet,
    inputs: &[&[R::Scalar]],
    outputs: &mut [Vec<R::Scalar>],
) {
    let tape = &set.tapes[0];
    let mut registers = set.register_file::<R, K>(token);
    for at in (0..inputs[0].len()).step_by(R::LANES * K) {
        for (column, &register) in inputs.iter().zip(&tape.inputs) {
            registers[register as usize] = load_pack(token, column, at);
        }
        interpret::<R, K>(token, tape, &mut registers);
        for (column, &register) in outputs.iter_mut().zip(&tape.outputs) {
            store_pack(&registers[register as usize], column, at);
        }
    }
}

#[inline(always)]
fn run_estimates<R: Machine, const K: usize>(
    token: R::Token,
    tapes: &EstimatorTapes,
    inputs: &[&[R::Scalar]],
    outputs: &mut [Vec<R::Scalar>],
) {
    let mut files = Files::<R, K>::new(token, tapes);
    let zero = R::splat(token, 0.0);
    let mut live = [zero; K];
    for at in (0..inputs[0].len()).step_by(R::LANES * K) {
        let mut point = [live; 5];
        for (value, column) in point.iter_mut().zip(inputs) {
            *value = load_pack(token, column, at);
        }
        for k in 0..K {
            live[k] = R::from_mask(token, zero.le(point[4][k]));
        }
        estimate::<R, K>(token, tapes, &mut files, &point, &live);
        for (column, &register) in outputs.iter_mut().zip(&tapes.combine.tapes[0].outputs) {
            store_pack(&files.combine[register as usize], column, at);
        }
    }
}

/// Estimates at a pack of points (`p`, `h`, `hit_eps`); the results lie in the output registers of `combine`.
/// Lanes where `live` is 0 are not waited for. Returns the iterations of all orbits.
#[inline(always)]
fn estimate<R: Machine, const K: usize>(
    token: R::Token,
    tapes: &EstimatorTapes,
    files: &mut Files<R, K>,
    point: &[Register<R, K>; 5],
    live: &Register<R, K>,
) -> Register<R, K> {
    let combine = &tapes.combine.tapes[0];
    let mut next = 0;
    for register in point {
        files.combine[combine.inputs[next] as usize] = *register;
        next += 1;
    }
    let mut total = [R::splat(token, 0.0); K];
    for (orbit, registers) in tapes.orbits.iter().zip(&mut files.orbits) {
        let (inside, n) = iterate::<R, K>(token, orbit, registers, point, live);
        let finish = &orbit.set.tapes[1];
        registers[orbit.state + orbit.frozen] = n;
        interpret::<R, K>(token, finish, registers);
        for &output in &finish.outputs {
            files.combine[combine.inputs[next] as usize] = registers[output as usize];
            next += 1;
        }
        files.combine[combine.inputs[next] as usize] = inside;
        files.combine[combine.inputs[next + 1] as usize] = n;
        next += 2;
        for k in 0..K {
            total[k] = total[k] + n[k];
        }
    }
    interpret::<R, K>(token, combine, &mut files.combine);
    total
}

/// Iterates an orbit until every live lane has escaped or `max_iterations` are done. Leaves the end state in the state
/// registers; returns 1 where a lane has not escaped, and the iterations done.
#[inline(always)]
fn iterate<R: Machine, const K: usize>(
    token: R::Token,
    orbit: &OrbitTapes,
    registers: &mut [Register<R, K>],
    point: &[Register<R, K>; 5],
    live: &Register<R, K>,
) -> (Register<R, K>, Register<R, K>) {
    let init = &orbit.set.tapes[0];
    for (value, &register) in point.iter().zip(&init.inputs) {
        registers[register as usize] = *value;
    }
    interpret::<R, K>(token, init, registers);
    for (i, &output) in init.outputs.iter().enumerate() {
        registers[i] = registers[output as usize];
    }
    let mut active = *live;
    let mut n = [R::splat(token, 0.0); K];
    for iteration in 0..orbit.max_iterations as usize {
        registers[orbit.state + orbit.frozen] = [R::splat(token, iteration as f64); K];
        let item = &orbit.set.tapes[orbit.items + orbit.schedule.item(iteration)];
        interpret::<R, K>(token, item, registers);
        if !keep_active::<R, K>(token, item, registers, orbit.state, &mut active, &mut n) {
            break;
        }
    }
    (active, n)
}

/// Takes over the new state where a lane is active, counts its iteration, and ends the lanes that escaped.
/// Returns whether any lane is still active.
#[inline(always)]
fn keep_active<R: Machine, const K: usize>(
    token: R::Token,
    item: &Tape,
    registers: &mut [Register<R, K>],
    state: usize,
    active: &mut Register<R, K>,
    n: &mut Register<R, K>,
) -> bool {
    let (zero, one) = (R::splat(token, 0.0), R::splat(token, 1.0));
    let mut masks = [zero.lt(one); K];
    let mut all = true;
    for k in 0..K {
        masks[k] = active[k].to_mask();
        all &= !R::mask_any(R::mask_not(masks[k]));
    }
    for i in 0..state {
        let mut new = registers[item.outputs[i] as usize];
        if !all {
            let old = registers[i];
            for k in 0..K {
                new[k] = R::select(masks[k], new[k], old[k]);
            }
        }
        registers[i] = new;
    }
    let escaped = registers[item.outputs[state] as usize];
    let mut any = false;
    for k in 0..K {
        n[k] = n[k] + active[k];
        active[k] = R::select(escaped[k].to_mask(), zero, active[k]);
        any |= R::mask_any(active[k].to_mask());
    }
    any
}

/// Rays being marched: their columns, compacted as rays finish.
struct Rays<T> {
    columns: Vec<Vec<T>>,
    ids: Vec<u32>,
}

/// Columns of [`Rays`]: ray, state, then counters.
const RAY: usize = 8;
const STATE: usize = 6;
const STATUS: usize = RAY + STATE - 1;
const STEPS: usize = RAY + STATE;
const ITERATIONS: usize = STEPS + 1;
const NAN: usize = STEPS + 2;
const COLUMNS: usize = STEPS + 3;

#[inline(always)]
fn run_march<R: Machine, const K: usize>(
    token: R::Token,
    tapes: &MarchTapes,
    inputs: &[&[R::Scalar]],
    outputs: &mut [Vec<R::Scalar>],
) where
    R::Scalar: Default,
{
    debug_assert_eq!(RAY, Port::scalars(&ray_ports()));
    debug_assert_eq!(COLUMNS - RAY, Port::scalars(&march_output_ports()));
    let pack = R::LANES * K;
    let len = inputs[0].len();
    let mut rays = Rays::start(inputs, R::scalar(0.0), R::scalar(-1.0), R::scalar(Status::Miss.code()));
    rays.retire(outputs, false);
    let mut files = Files::<R, K>::new(token, &tapes.estimator);
    let mut locate = tapes.locate.register_file::<R, K>(token);
    let mut advance = tapes.advance.register_file::<R, K>(token);
    for step in 0..tapes.max_march_steps {
        let mut finished = 0;
        for at in (0..rays.ids.len()).step_by(pack) {
            finished += march_pack::<R, K>(token, tapes, &mut files, &mut locate, &mut advance, &mut rays, at);
        }
        // Moving rays together costs about as much as an estimate of those moved: wait until a quarter is done.
        let last = step + 1 == tapes.max_march_steps;
        if last || finished * 4 >= rays.ids.len() {
            rays.retire(outputs, last);
        }
        if rays.ids.is_empty() {
            break;
        }
    }
    debug_assert!(outputs.iter().all(|c| c.len() == len));
}

/// Estimates once for a pack of rays and advances them. Returns how many of its rays are done.
#[inline(always)]
fn march_pack<R: Machine, const K: usize>(
    token: R::Token,
    tapes: &MarchTapes,
    files: &mut Files<R, K>,
    locate: &mut [Register<R, K>],
    advance: &mut [Register<R, K>],
    rays: &mut Rays<R::Scalar>,
    at: usize,
) -> usize {
    let (locate_tape, advance_tape) = (&tapes.locate.tapes[0], &tapes.advance.tapes[0]);
    for i in 0..RAY + STATE {
        let value = load_pack(token, &rays.columns[i], at);
        locate[locate_tape.inputs[i] as usize] = value;
        advance[advance_tape.inputs[i] as usize] = value;
    }
    interpret::<R, K>(token, locate_tape, locate);
    let mut point = [[R::splat(token, 0.0); K]; 5];
    for (value, &output) in point.iter_mut().zip(&locate_tape.outputs) {
        *value = locate[output as usize];
    }
    let status = locate[locate_tape.inputs[STATUS] as usize];
    let mut running = [R::splat(token, 0.0); K];
    for k in 0..K {
        running[k] = R::from_mask(token, status[k].eq(R::splat(token, 0.0)));
    }
    let iterations = estimate::<R, K>(token, &tapes.estimator, files, &point, &running);
    let combine = &tapes.estimator.combine.tapes[0];
    for i in 0..2 {
        advance[advance_tape.inputs[RAY + STATE + i] as usize] = files.combine[combine.outputs[i] as usize];
    }
    let de = files.combine[combine.outputs[0] as usize];
    interpret::<R, K>(token, advance_tape, advance);
    for i in 0..STATE {
        let mut value = load_pack::<R, K>(token, &rays.columns[RAY + i], at);
        let new = &advance[advance_tape.outputs[i] as usize];
        for k in 0..K {
            value[k] = R::select(running[k].to_mask(), new[k], value[k]);
        }
        store_pack::<R, K>(&value, &mut rays.columns[RAY + i], at);
    }
    let mut counts = [running, iterations, [R::splat(token, 0.0); K]];
    for k in 0..K {
        counts[1][k] = iterations[k] * running[k];
        counts[2][k] = running[k] * R::from_mask(token, R::mask_not(de[k].eq(de[k])));
    }
    for (i, count) in counts.iter().enumerate() {
        let mut sum = load_pack::<R, K>(token, &rays.columns[STEPS + i], at);
        for k in 0..K {
            sum[k] = sum[k] + count[k];
        }
        store_pack::<R, K>(&sum, &mut rays.columns[STEPS + i], at);
    }
    let end = (at + R::LANES * K).min(rays.ids.len());
    (at..end).filter(|&i| !rays.is_running(i)).count()
}

impl<T: Copy + Into<f64>> Rays<T> {
    /// All rays at their near end; `unknown` marks what no estimate has said yet.
    fn start(inputs: &[&[T]], zero: T, unknown: T, missed: T) -> Rays<T> {
        let len = inputs[0].len();
        let mut columns: Vec<Vec<T>> = inputs.iter().map(|c| c.to_vec()).collect();
        columns.push(inputs[6].to_vec()); // t starts at t_near
        columns.push(inputs[6].to_vec()); // and so does its front
        columns.extend([unknown, unknown, unknown, zero].map(|value| vec![value; len]));
        columns.extend([zero; 3].map(|value| vec![value; len]));
        // A ray whose range is empty has missed before it starts.
        for i in 0..len {
            if !(inputs[6][i].into() < inputs[7][i].into()) {
                columns[STATUS][i] = missed;
            }
        }
        Rays { columns, ids: (0..len as u32).collect() }
    }

    fn is_running(&self, i: usize) -> bool {
        self.columns[STATUS][i].into() == 0.0
    }

    /// Writes out the rays that are done (all of them at the end) and moves the others together.
    fn retire(&mut self, outputs: &mut [Vec<T>], all: bool) {
        let mut kept = 0;
        for i in 0..self.ids.len() {
            if all || !self.is_running(i) {
                let id = self.ids[i] as usize;
                for (output, column) in outputs.iter_mut().zip(&self.columns[RAY..]) {
                    output[id] = column[i];
                }
                continue;
            }
            if kept != i {
                for column in &mut self.columns {
                    column[kept] = column[i];
                }
                self.ids[kept] = self.ids[i];
            }
            kept += 1;
        }
        self.ids.truncate(kept);
        for column in &mut self.columns {
            column.truncate(kept);
        }
    }
}
