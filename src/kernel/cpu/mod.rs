//! The embedded CPU back end: tapes interpreted over packs of rays, in f64 (one ray at a time, the reference) or in wide
//! f32 (as many rays as four of the machine's vectors hold), with the work spread over threads. Where the processor has
//! AVX-512 or AVX2, tapes become machine code instead, with the same results ([`Cpu::interpreted`] switches that off).
//!
//! The loops here (iterate, march) have twins of the same names in `shaders/`; everything straight-line is a tape.

mod columns;
#[cfg(target_arch = "x86_64")]
mod compiled;
mod estimate;
mod interpret;
mod march;
mod tapes;

use std::sync::atomic::{AtomicBool, Ordering};

use fearless_simd::{Level, Simd, SimdBase, dispatch};
use rayon::prelude::*;

pub use self::columns::CpuColumns;
use self::columns::{Columns, Number};
#[cfg(target_arch = "x86_64")]
use self::compiled::InstructionSet;
use self::estimate::{run_estimates, run_map};
use self::interpret::Machine;
use self::march::run_march;
use self::tapes::Program;
use super::{Backend, BackendError, Batch, Kernel, Results, Wanted};
use crate::expr::{Arena, Port};
use crate::math::{Lanes, Pack, Precision};

/// Vectors that one register holds.
const WIDE: usize = 4;
/// Elements that one task works on.
const GROUP: usize = 4096;

/// The CPU back end.
#[derive(Clone, Copy, Debug)]
pub struct Cpu {
    precision: Precision,
    level: Level,
    /// What kernels are compiled for, if they are.
    #[cfg(target_arch = "x86_64")]
    set: Option<InstructionSet>,
}

/// A kernel as tapes, which hold the tables that compiled code looks up.
pub struct CpuKernel {
    program: Program,
    #[cfg(target_arch = "x86_64")]
    compiled: Option<compiled::Compiled>,
    inputs: usize,
    outputs: usize,
}

impl Cpu {
    /// A back end of this precision, at the best instruction set of the machine.
    pub fn new(precision: Precision) -> Cpu {
        let level = Level::new();
        #[cfg(target_arch = "x86_64")]
        let set = match level {
            _ if !compiled::is_allowed() => None,
            Level::Avx512(_) => Some(InstructionSet::Avx512),
            Level::Avx2(_) => Some(InstructionSet::Avx2),
            _ => None,
        };
        Cpu {
            precision,
            level,
            #[cfg(target_arch = "x86_64")]
            set,
        }
    }

    /// True where kernels become machine code: on processors with AVX-512 or AVX2, where the system allows it.
    pub fn compiles(&self) -> bool {
        self.machine_code().is_some()
    }

    /// The same back end without machine code of its own making: tapes are interpreted. It gives the same results.
    pub fn interpreted(self) -> Cpu {
        Cpu {
            #[cfg(target_arch = "x86_64")]
            set: None,
            ..self
        }
    }

    /// The same back end as processors without AVX-512 have it. Where this one has it, results are the same but for
    /// functions such as sines, which may differ in their last bits with the vectors' length.
    pub fn narrow(self) -> Cpu {
        #[cfg(target_arch = "x86_64")]
        if let (Some(InstructionSet::Avx512), Some(avx2)) = (self.set, self.level.as_avx2()) {
            return Cpu { set: Some(InstructionSet::Avx2), level: Level::Avx2(avx2), ..self };
        }
        self
    }

    /// Name of the instruction set that kernels are compiled for, and the rays of a vector.
    fn machine_code(&self) -> Option<(&'static str, usize)> {
        #[cfg(target_arch = "x86_64")]
        return self.set.map(|set| (set.name(), set.lanes(self.precision)));
        #[cfg(not(target_arch = "x86_64"))]
        None
    }

    /// The precision.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// What results follow from besides the kernel: precision and instruction set. Functions such as sines may differ in their last bits
    /// between instruction sets, and nothing else does.
    pub fn arithmetic(&self) -> String {
        // The level's debug text is its name and then its token.
        let level = format!("{:?}", self.level);
        let name = match level.split('(').next().unwrap_or_default() {
            "Avx512" => "AVX-512",
            "Avx2" => "AVX2",
            other => other,
        };
        format!("cpu, {}, {name}", self.precision.name())
    }

    /// The instruction set in use and the number of rays that a vector holds, or a pack of the interpreter.
    pub fn description(&self) -> String {
        let precision = self.precision.name();
        if let Some((name, rays)) = self.machine_code() {
            let some =
                if INTERPRETED.load(Ordering::Relaxed) { ", some kernels interpreted for want of memory" } else { "" };
            return format!("cpu, {precision}, {rays} rays a vector (machine code for {name}{some})");
        }
        let why = if is_refused() { ": the system refuses machine code" } else { "" };
        match self.precision {
            Precision::F64 => format!("cpu, f64, 1 ray at a time (interpreted{why})"),
            Precision::F32 => {
                let lanes = dispatch!(self.level, simd => pack_lanes(simd));
                // The level's debug text is its name and then its token.
                let level = format!("{:?}", self.level);
                let name = level.split('(').next().unwrap_or_default();
                format!("cpu, f32, {lanes} rays at a time (interpreted, {name}{why})")
            }
        }
    }
}

/// Whether a kernel of this process had to be interpreted where it should have become machine code.
static INTERPRETED: AtomicBool = AtomicBool::new(false);

/// Whether the system refuses to make memory executable, as service managers and sandboxes may: kernels are interpreted then.
/// False on processors that no machine code is made for.
pub fn is_refused() -> bool {
    #[cfg(target_arch = "x86_64")]
    return !compiled::is_allowed();
    #[cfg(not(target_arch = "x86_64"))]
    false
}

#[inline(always)]
fn pack_lanes<S: Simd>(_: S) -> usize {
    S::f32s::LEN * WIDE
}

impl Backend for Cpu {
    type Prepared = CpuKernel;
    type Columns = CpuColumns;

    fn batch(&self) -> Batch {
        Batch { elements: GROUP, at_once: usize::MAX }
    }

    fn prepare(&self, arena: &Arena, kernel: &Kernel) -> Result<CpuKernel, BackendError> {
        let program = Program::new(arena, kernel);
        #[cfg(target_arch = "x86_64")]
        let compiled = self.set.and_then(|set| compiled::compile(&program, self.precision, set));
        #[cfg(target_arch = "x86_64")]
        if self.set.is_some() && compiled.is_none() {
            INTERPRETED.store(true, Ordering::Relaxed);
        }
        Ok(CpuKernel {
            #[cfg(target_arch = "x86_64")]
            compiled,
            program,
            inputs: Port::scalars(&kernel.inputs()),
            outputs: Port::scalars(&kernel.outputs()),
        })
    }

    fn bind(&self, kernel: &CpuKernel, uniforms: &[f64]) -> Result<CpuKernel, BackendError> {
        Ok(CpuKernel {
            #[cfg(target_arch = "x86_64")]
            compiled: kernel.compiled.as_ref().map(|compiled| compiled.bind(uniforms)),
            program: kernel.program.bind(uniforms),
            ..*kernel
        })
    }

    fn upload(&self, columns: &[impl AsRef<[f64]>]) -> Result<CpuColumns, BackendError> {
        Ok(match self.precision {
            Precision::F64 => CpuColumns::F64(Columns::from_f64(columns, |x| x)),
            Precision::F32 => CpuColumns::F32(Columns::from_f64(columns, |x| x as f32)),
        })
    }

    fn download(&self, columns: &CpuColumns) -> Result<Vec<Vec<f64>>, BackendError> {
        self.download_only(columns, &Vec::from_iter(0..columns.count()))
    }

    fn read<R>(&self, wanted: &[Wanted<CpuColumns>], take: impl FnOnce(Results) -> R) -> Result<R, BackendError> {
        Ok(take(match self.precision {
            Precision::F32 => Results::F32(pick(wanted, CpuColumns::f32s)),
            Precision::F64 => Results::F64(pick(wanted, CpuColumns::f64s)),
        }))
    }

    fn run(&self, kernel: &CpuKernel, inputs: &[&CpuColumns]) -> Result<CpuColumns, BackendError> {
        Ok(match self.precision {
            Precision::F64 => {
                let columns: Vec<&[f64]> = inputs.iter().flat_map(|c| c.f64s()).collect();
                CpuColumns::F64(run_parallel(kernel, &columns, |k, i, o| {
                    #[cfg(target_arch = "x86_64")]
                    if let Some(compiled) = &k.compiled {
                        return compiled.run(i, o);
                    }
                    run_group::<f64, 1>((), k, i, o);
                }))
            }
            Precision::F32 => {
                let columns: Vec<&[f32]> = inputs.iter().flat_map(|c| c.f32s()).collect();
                let level = self.level;
                CpuColumns::F32(run_parallel(kernel, &columns, |k, i, o| {
                    #[cfg(target_arch = "x86_64")]
                    if let Some(compiled) = &k.compiled {
                        return compiled.run(i, o);
                    }
                    dispatch!(level, simd => run_group::<Lanes<_>, WIDE>(simd, k, i, o));
                }))
            }
        })
    }
}

/// The columns that are wanted.
fn pick<'a, T>(wanted: &[Wanted<'a, CpuColumns>], all: impl Fn(&'a CpuColumns) -> Vec<&'a [T]>) -> Vec<Vec<&'a [T]>> {
    let picked = |&(columns, numbers): &Wanted<'a, CpuColumns>| {
        let all = all(columns);
        numbers.iter().map(|&number| all[number]).collect()
    };
    wanted.iter().map(picked).collect()
}

/// Cuts the columns into groups and runs each.
fn run_parallel<T: Number + Sync>(
    kernel: &CpuKernel,
    inputs: &[&[T]],
    run: impl Fn(&CpuKernel, &[&[T]], &mut [&mut [T]]) + Sync,
) -> Columns<T> {
    assert_eq!(inputs.len(), kernel.inputs, "columns must match the kernel's inputs");
    let len = inputs.first().map_or(0, |c| c.len());
    let mut columns = Columns::new(kernel.outputs, len);
    // The parts of all columns that belong to one group.
    let mut groups: Vec<Vec<&mut [T]>> = (0..len.div_ceil(GROUP)).map(|_| Vec::new()).collect();
    for column in columns.each_mut() {
        groups.iter_mut().zip(column.chunks_mut(GROUP)).for_each(|(group, part)| group.push(part));
    }
    groups.into_par_iter().enumerate().for_each(|(number, mut outputs)| {
        let range = number * GROUP..((number + 1) * GROUP).min(len);
        let slices: Vec<&[T]> = inputs.iter().map(|c| &c[range.clone()]).collect();
        run(kernel, &slices, &mut outputs);
    });
    columns
}

#[inline(always)]
fn run_group<R: Machine + Pack, const K: usize>(
    token: R::Token,
    kernel: &CpuKernel,
    inputs: &[&[R::Scalar]],
    outputs: &mut [&mut [R::Scalar]],
) where
    R::Scalar: Default,
{
    match &kernel.program {
        Program::Map(set) => run_map::<R, K>(token, set, inputs, outputs),
        Program::Estimate(tapes) => run_estimates::<R, K>(token, tapes, inputs, outputs),
        Program::March(tapes) => run_march::<R, K>(token, tapes, inputs, outputs),
    }
}
