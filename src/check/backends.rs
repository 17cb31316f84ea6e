//! The back ends that tests run on, and what each may be off by.

use std::time::{Duration, Instant};

use crate::expr::Arena;
use crate::graph::Method;
use crate::kernel::cpu::Cpu;
#[cfg(feature = "gpu")]
use crate::kernel::gpu::{AdapterWanted, Gpu};
use crate::kernel::{Backend, BackendError, Kernel};
use crate::math::Precision;
use crate::render::{Pipeline, RenderSettings, Renderer};

/// One back end in one precision.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Target {
    /// The CPU back end.
    Cpu(Precision),
    /// Generated WGSL on an adapter, in single precision.
    Gpu,
}

impl Target {
    /// The CPU in double precision, the reference.
    pub const CPU_F64: Target = Target::Cpu(Precision::F64);
    /// The CPU in single precision.
    pub const CPU_F32: Target = Target::Cpu(Precision::F32);

    /// The last part of a test's name.
    pub fn name(self) -> &'static str {
        match self {
            Target::CPU_F64 => "cpu_f64",
            Target::CPU_F32 => "cpu_f32",
            Target::Gpu => "gpu",
        }
    }

    /// What it computes in.
    pub const fn precision(self) -> Precision {
        match self {
            Target::Cpu(precision) => precision,
            Target::Gpu => Precision::F32,
        }
    }

    /// Relative error (absolute below 1) that an estimate may have on top of a test's own tolerance.
    pub fn estimate_slack(self, method: Method) -> f64 {
        match (self, method) {
            (Target::CPU_F64, _) => 0.0,
            // A difference of two numbers of 24 bits over a step of a hundredth of the estimate.
            (_, method) if method.is_difference() => 1e-2,
            // Ten iterations of a power 8 lose about 3 of 7 digits: every one multiplies the relative error by 8.
            _ => 2e-4,
        }
    }

    /// Relative error (absolute below 1) that a step's worked example may have on top of its own tolerance.
    pub fn step_slack(self) -> f64 {
        match self {
            Target::CPU_F64 => 0.0,
            // sin, cos, atan2 and pow of the lane kit and of drivers: a few units of 6e-8 each, multiplied by powers.
            Target::CPU_F32 => 1e-4,
            // WGSL grants sin and cos 2^-11 absolute on [-pi, pi]; drivers do far better, but not 1e-4 on all.
            Target::Gpu => 1e-3,
        }
    }

    /// Relative error of a state after this many iterations: rounding doubles or worse each time.
    pub fn orbit_slack(self, iterations: u32) -> f64 {
        match self {
            Target::CPU_F64 => 0.0,
            _ => 1e-6 * 8f64.powi(iterations.min(5) as i32),
        }
    }

    /// Shift that rounding of a point's coordinates can stand for, relative to the size of the set.
    pub fn rounding(self) -> f64 {
        match self {
            Target::CPU_F64 => 1e-10,
            _ => 2e-6,
        }
    }

    /// Part of the depth that a ray's hit may be off by, and least hit threshold.
    pub fn depth_slack(self) -> f64 {
        match self {
            Target::CPU_F64 => 0.0,
            _ => 1e-4,
        }
    }
}

/// The back ends of this machine.
pub struct Backends {
    double: Cpu,
    single: Cpu,
    #[cfg(feature = "gpu")]
    gpu: Option<Gpu>,
    no_gpu: Option<String>,
}

impl Backends {
    /// Both CPU precisions and the GPU, where an adapter exists.
    pub fn new() -> Backends {
        #[cfg(feature = "gpu")]
        return Backends::cpu_only().with_gpu(AdapterWanted::Any);
        #[cfg(not(feature = "gpu"))]
        Backends::cpu_only()
    }

    /// Both CPU precisions and the GPU, where there is a hardware one.
    pub fn with_hardware() -> Backends {
        #[cfg(feature = "gpu")]
        return Backends::cpu_only().with_gpu(AdapterWanted::Hardware);
        #[cfg(not(feature = "gpu"))]
        Backends::cpu_only()
    }

    #[cfg(feature = "gpu")]
    fn with_gpu(self, wanted: AdapterWanted) -> Backends {
        match Gpu::new(wanted) {
            Ok(gpu) => Backends { gpu: Some(gpu), no_gpu: None, ..self },
            Err(error) => Backends { no_gpu: Some(error.to_string()), ..self },
        }
    }

    /// Both CPU precisions.
    pub fn cpu_only() -> Backends {
        Backends {
            double: Cpu::new(Precision::F64),
            single: Cpu::new(Precision::F32),
            #[cfg(feature = "gpu")]
            gpu: None,
            no_gpu: Some("not asked for, or built without it".to_string()),
        }
    }

    /// Why the GPU is not among the targets.
    pub fn why_no_gpu(&self) -> Option<&str> {
        self.no_gpu.as_deref()
    }

    /// What tests run on, the reference first.
    pub fn targets(&self) -> Vec<Target> {
        let mut targets = vec![Target::CPU_F64, Target::CPU_F32];
        targets.extend(self.no_gpu.is_none().then_some(Target::Gpu));
        targets
    }

    /// Runs a kernel on columns of its inputs and gives the columns of its outputs.
    pub fn run(
        &self,
        target: Target,
        arena: &Arena,
        kernel: &Kernel,
        columns: &[Vec<f64>],
    ) -> Result<Vec<Vec<f64>>, BackendError> {
        match target {
            Target::CPU_F64 => run_on(&self.double, arena, kernel, columns),
            Target::CPU_F32 => run_on(&self.single, arena, kernel, columns),
            Target::Gpu => self.run_gpu(arena, kernel, columns),
        }
    }

    /// Runs a kernel as [`Backends::run`] does, several times; gives the columns and the time of the fastest run, without
    /// preparing and copying.
    pub fn run_timed(
        &self,
        target: Target,
        arena: &Arena,
        kernel: &Kernel,
        columns: &[Vec<f64>],
    ) -> Result<(Vec<Vec<f64>>, Duration), BackendError> {
        match target {
            Target::CPU_F64 => time_on(&self.double, arena, kernel, columns),
            Target::CPU_F32 => time_on(&self.single, arena, kernel, columns),
            #[cfg(feature = "gpu")]
            Target::Gpu => time_on(self.gpu.as_ref().ok_or_else(|| self.absent())?, arena, kernel, columns),
            #[cfg(not(feature = "gpu"))]
            Target::Gpu => Err(self.absent()),
        }
    }

    /// Depths of all pixels of a picture, row by row.
    pub fn depths(
        &self,
        target: Target,
        arena: &Arena,
        pipeline: &Pipeline,
        settings: &RenderSettings,
    ) -> Result<Vec<Option<f64>>, BackendError> {
        match target {
            Target::CPU_F64 => depths_on(&self.double, arena, pipeline, settings),
            Target::CPU_F32 => depths_on(&self.single, arena, pipeline, settings),
            Target::Gpu => self.depths_gpu(arena, pipeline, settings),
        }
    }

    #[cfg(feature = "gpu")]
    fn run_gpu(&self, arena: &Arena, kernel: &Kernel, columns: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, BackendError> {
        run_on(self.gpu.as_ref().ok_or_else(|| self.absent())?, arena, kernel, columns)
    }

    #[cfg(feature = "gpu")]
    fn depths_gpu(
        &self,
        arena: &Arena,
        pipeline: &Pipeline,
        settings: &RenderSettings,
    ) -> Result<Vec<Option<f64>>, BackendError> {
        depths_on(self.gpu.as_ref().ok_or_else(|| self.absent())?, arena, pipeline, settings)
    }

    #[cfg(not(feature = "gpu"))]
    fn run_gpu(&self, _: &Arena, _: &Kernel, _: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, BackendError> {
        Err(self.absent())
    }

    #[cfg(not(feature = "gpu"))]
    fn depths_gpu(&self, _: &Arena, _: &Pipeline, _: &RenderSettings) -> Result<Vec<Option<f64>>, BackendError> {
        Err(self.absent())
    }

    fn absent(&self) -> BackendError {
        BackendError::NoAdapter(self.no_gpu.clone().unwrap_or_default())
    }
}

impl Default for Backends {
    fn default() -> Self {
        Backends::new()
    }
}

fn run_on<B: Backend>(
    backend: &B,
    arena: &Arena,
    kernel: &Kernel,
    columns: &[Vec<f64>],
) -> Result<Vec<Vec<f64>>, BackendError> {
    let prepared = backend.prepare(arena, kernel)?;
    let columns = backend.upload(columns)?;
    backend.download(&backend.run(&prepared, &[&columns])?)
}

/// Runs that a time is taken of, at most.
const TIMED_RUNS: usize = 4;
/// Time after which no further run is made.
const TIMED_ENOUGH: Duration = Duration::from_millis(60);

fn time_on<B: Backend>(
    backend: &B,
    arena: &Arena,
    kernel: &Kernel,
    columns: &[Vec<f64>],
) -> Result<(Vec<Vec<f64>>, Duration), BackendError> {
    let prepared = backend.prepare(arena, kernel)?;
    let columns = backend.upload(columns)?;
    let begin = Instant::now();
    let mut fastest = Duration::MAX;
    let mut out = Vec::new();
    for _ in 0..TIMED_RUNS {
        let start = Instant::now();
        // A GPU has done its work only when its columns have come back.
        out = backend.download(&backend.run(&prepared, &[&columns])?)?;
        fastest = fastest.min(start.elapsed());
        if begin.elapsed() > TIMED_ENOUGH {
            break;
        }
    }
    Ok((out, fastest))
}

fn depths_on<B: Backend>(
    backend: &B,
    arena: &Arena,
    pipeline: &Pipeline,
    settings: &RenderSettings,
) -> Result<Vec<Option<f64>>, BackendError> {
    let size = settings.size;
    let pixels: Vec<(u32, u32)> = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))).collect();
    Renderer::new(backend, arena, pipeline, settings)?.depths(&pixels)
}

/// A duration as test lines show it.
pub(super) fn shown(time: Duration) -> String {
    match time.as_secs_f64() {
        s if s < 1.0 => format!("{:.0} ms", s * 1e3),
        s => format!("{s:.1} s"),
    }
}
