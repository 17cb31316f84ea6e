//! Kernels as compiled pipelines, each made once: kernels of the same WGSL share theirs.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use super::scoped;
use super::slices::Slices;
use crate::expr::{Arena, Port};
use crate::kernel::wgsl::{self, TABLES, UNIFORMS};
use crate::kernel::work::Work;
use crate::kernel::{BackendError, Compiling, Kernel};

/// A kernel as a compiled pipeline.
pub(super) struct Pipelines {
    pub(super) compiled: Compiled,
    /// Of a march: most steps of a ray. Other kernels give one value for each element, whatever the others.
    pub(super) max_march_steps: Option<u32>,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    /// Length of the list of uniforms.
    pub(super) uniforms: usize,
    pub(super) slices: Slices,
}

type Pipeline = Result<wgpu::ComputePipeline, BackendError>;

/// A pipeline that a thread of its own compiles: drivers take their time for each.
pub(super) struct Compiled {
    thread: Mutex<Option<JoinHandle<Pipeline>>>,
    pipeline: OnceLock<Pipeline>,
}

impl Compiled {
    fn start(compile: impl FnOnce() -> Pipeline + Send + 'static) -> Compiled {
        Compiled { thread: Mutex::new(Some(std::thread::spawn(compile))), pipeline: OnceLock::new() }
    }

    /// The pipeline, as soon as it is there.
    pub(super) fn get(&self) -> Result<&wgpu::ComputePipeline, BackendError> {
        let wait = || {
            let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
            let ended_early = || Err(BackendError::DeviceLost("its compiler ended early".into()));
            thread.and_then(|thread| thread.join().ok()).unwrap_or_else(ended_early)
        };
        self.pipeline.get_or_init(wait).as_ref().map_err(Clone::clone)
    }
}

/// Pipelines by what they depend on: their WGSL (which holds no limit of march steps) and that limit.
type Known = HashMap<(String, u32), Arc<Pipelines>>;

/// The pipelines of a device, and what making them took.
#[derive(Default)]
pub(super) struct Cache {
    known: Mutex<Known>,
    compiling: Arc<Mutex<Compiling>>,
}

impl Cache {
    /// Compiling so far, after what is under way.
    pub(super) fn compiling(&self) -> Compiling {
        let known: Vec<_> = self.known.lock().unwrap_or_else(PoisonError::into_inner).values().cloned().collect();
        // An error is told to whoever runs the kernel.
        known.iter().for_each(|pipelines| drop(pipelines.compiled.get()));
        *self.compiling.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn count(&self, add: impl FnOnce(&mut Compiling)) {
        add(&mut self.compiling.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// The pipelines of a kernel: written, validated and compiled where no kernel of the same text was. Device errors go
    /// to the caller's error scopes.
    pub(super) fn get(
        &self,
        device: &wgpu::Device,
        arena: &Arena,
        kernel: &Kernel,
    ) -> Result<Arc<Pipelines>, BackendError> {
        let started = Instant::now();
        let limit = match kernel {
            Kernel::March(march) => march.max_march_steps,
            _ => 0,
        };
        let key = (wgsl::write(arena, kernel), limit);
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        self.count(|compiling| compiling.kernels += 1);
        if let Some(known) = known {
            self.count(|compiling| compiling.own += started.elapsed());
            return Ok(known);
        }
        let (module, _) = wgsl::validate(&key.0)?;
        let pipelines = Arc::new(self.start(device, arena, kernel, module));
        self.count(|compiling| {
            compiling.compiled += 1;
            compiling.own += started.elapsed();
        });
        self.known.lock().unwrap_or_else(PoisonError::into_inner).insert(key, pipelines.clone());
        Ok(pipelines)
    }

    /// The pipelines of a kernel, which begin to be compiled.
    fn start(&self, device: &wgpu::Device, arena: &Arena, kernel: &Kernel, module: naga::Module) -> Pipelines {
        let max_march_steps = match kernel {
            Kernel::March(march) => Some(march.max_march_steps),
            Kernel::Map(_) | Kernel::Estimate(_) => None,
        };
        let uniforms = kernel.uniforms(arena);
        let layout = bind_group_layout(
            device,
            if max_march_steps.is_some() { 5 } else { 3 },
            (uniforms > 0, !kernel.tables(arena).is_empty()),
        );
        let (entry, compiling) = (wgsl::entry_point(kernel), self.compiling.clone());
        let (device, layout_of_it) = (device.clone(), layout.clone());
        let compile = move || {
            let started = Instant::now();
            let pipeline = scoped(&device, || Ok(compile(&device, module, entry, &layout_of_it)));
            compiling.lock().unwrap_or_else(PoisonError::into_inner).driver += started.elapsed();
            pipeline
        };
        Pipelines {
            compiled: Compiled::start(compile),
            max_march_steps,
            layout,
            inputs: Port::scalars(&kernel.inputs()),
            outputs: Port::scalars(&kernel.outputs()),
            uniforms,
            slices: slices_of(arena, kernel),
        }
    }
}

/// How a kernel's work is cut before anything of it is measured.
fn slices_of(arena: &Arena, kernel: &Kernel) -> Slices {
    let orbits = match kernel {
        Kernel::Map(_) => &[][..],
        Kernel::Estimate(estimator) => &estimator.orbits,
        Kernel::March(march) => &march.estimator.orbits,
    };
    let iterations: u32 = orbits.iter().map(|orbit| orbit.max_iterations).sum();
    let products = Work::of(arena, kernel).total(1.0, f64::from(iterations));
    Slices::new(products, matches!(kernel, Kernel::Map(_)))
}

fn compile(
    device: &wgpu::Device,
    module: naga::Module,
    entry: &str,
    layout: &wgpu::BindGroupLayout,
) -> wgpu::ComputePipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(module)),
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        bind_group_layouts: &[Some(layout)],
        ..Default::default()
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&pipeline_layout),
        module: &module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions {
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        },
        cache: None,
    })
}

/// Binding 0 and that of the uniforms are uniforms, 1, 3 and that of the tables are read, 2 and 4 are written too.
fn bind_group_layout(
    device: &wgpu::Device,
    buffers: u32,
    (has_uniforms, has_tables): (bool, bool),
) -> wgpu::BindGroupLayout {
    let entries: Vec<wgpu::BindGroupLayoutEntry> = (0..buffers)
        .chain(has_uniforms.then_some(UNIFORMS))
        .chain(has_tables.then_some(TABLES))
        .map(|binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: match binding {
                    0 | UNIFORMS => wgpu::BufferBindingType::Uniform,
                    _ => wgpu::BufferBindingType::Storage { read_only: binding == TABLES || binding % 2 == 1 },
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}

#[cfg(test)]
mod tests {
    use std::sync::PoisonError;
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::time::Duration;

    use super::{Compiled, Pipeline};
    use crate::kernel::gpu::tests::gpu;
    use crate::kernel::wgsl::tests::pipeline;
    use crate::kernel::{Backend, BackendError};
    use crate::render::RenderSettings;

    /// Each job tells the next one that it runs and waits to be told: none of them could end before all have begun.
    #[test]
    fn kernels_compile_side_by_side() {
        const JOBS: usize = 4;
        let (tell, told): (Vec<Sender<()>>, Vec<_>) = (0..JOBS).map(|_| channel()).unzip();
        let job = |(number, told): (usize, Receiver<()>)| {
            let next = tell[(number + 1) % JOBS].clone();
            Compiled::start(move || -> Pipeline {
                let met = next.send(()).is_ok() && told.recv_timeout(Duration::from_secs(20)).is_ok();
                Err(BackendError::InvalidWgsl(if met { "met" } else { "alone" }.into()))
            })
        };
        let started: Vec<Compiled> = told.into_iter().enumerate().map(job).collect();
        for compiled in &started {
            let told = compiled.get().expect_err("nothing was compiled");
            assert!(matches!(&told, BackendError::InvalidWgsl(text) if text == "met"), "{told}");
        }
    }

    /// The first run of a kernel waits for it.
    #[test]
    fn preparing_waits_for_no_compiler() {
        let Some(gpu) = gpu() else { return };
        let (arena, pipeline) = pipeline("mandelbulb", &RenderSettings::default());
        for (name, kernel) in pipeline.kernels() {
            gpu.prepare(&arena, kernel).unwrap_or_else(|error| panic!("{name}: {error}"));
        }
        let waited_for = || {
            let known = gpu.cache.known.lock().unwrap_or_else(PoisonError::into_inner);
            known.values().filter(|pipelines| pipelines.compiled.pipeline.get().is_some()).count()
        };
        assert_eq!(waited_for(), 0);
        let compiled = gpu.compiling().expect("it counts").compiled as usize;
        assert_eq!(waited_for(), compiled, "the count waits for all");
    }
}
