//! Kernels as compiled pipelines, each made once: kernels of the same WGSL share theirs.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::slices::Slices;
use crate::expr::{Arena, Port};
use crate::kernel::wgsl::{self, UNIFORMS};
use crate::kernel::{BackendError, Compiling, Kernel};

/// A kernel as compiled pipelines.
pub(super) struct Pipelines {
    pub(super) kind: Kind,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    /// Length of the list of uniforms.
    pub(super) uniforms: usize,
    pub(super) slices: Slices,
}

/// How a kernel runs, and with what.
pub(super) enum Kind {
    /// One value for each element, whatever the others.
    Straight(wgpu::ComputePipeline),
    March {
        march: wgpu::ComputePipeline,
        max_march_steps: u32,
    },
}

/// Pipelines by what they depend on: their WGSL (which holds no limit of march steps) and that limit.
type Known = HashMap<(String, u32), Arc<Pipelines>>;

/// The pipelines of a device, and what making them took.
#[derive(Default)]
pub(super) struct Cache {
    known: Mutex<Known>,
    compiling: Mutex<Compiling>,
}

impl Cache {
    /// Compiling so far.
    pub(super) fn compiling(&self) -> Compiling {
        *self.compiling.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn count(&self, own: Duration, driver: Duration, compiled: bool) {
        let mut compiling = self.compiling.lock().unwrap_or_else(PoisonError::into_inner);
        compiling.kernels += 1;
        compiling.compiled += u32::from(compiled);
        compiling.own += own;
        compiling.driver += driver;
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
        if let Some(known) = known {
            self.count(started.elapsed(), Duration::ZERO, false);
            return Ok(known);
        }
        let (module, _) = wgsl::validate(&key.0)?;
        let own = started.elapsed();
        let pipelines = Arc::new(Pipelines::new(device, arena, kernel, module));
        self.count(own, started.elapsed() - own, true);
        self.known.lock().unwrap_or_else(PoisonError::into_inner).insert(key, pipelines.clone());
        Ok(pipelines)
    }
}

impl Pipelines {
    fn new(device: &wgpu::Device, arena: &Arena, kernel: &Kernel, module: naga::Module) -> Pipelines {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(module)),
        });
        let buffers = if matches!(kernel, Kernel::March(_)) { 5 } else { 3 };
        let uniforms = kernel.uniforms(arena);
        let layout = bind_group_layout(device, buffers, uniforms > 0);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            bind_group_layouts: &[Some(&layout)],
            ..Default::default()
        });
        let entry = wgsl::entry_point(kernel);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        let kind = match kernel {
            Kernel::Map(_) | Kernel::Estimate(_) => Kind::Straight(pipeline),
            Kernel::March(march) => Kind::March { march: pipeline, max_march_steps: march.max_march_steps },
        };
        Pipelines {
            kind,
            layout,
            inputs: Port::scalars(&kernel.inputs()),
            outputs: Port::scalars(&kernel.outputs()),
            uniforms,
            slices: Slices::new(),
        }
    }
}

/// Binding 0 and that of the uniforms are uniforms, 1 and 3 are read, 2 and 4 are written too.
fn bind_group_layout(device: &wgpu::Device, buffers: u32, has_uniforms: bool) -> wgpu::BindGroupLayout {
    let entries: Vec<wgpu::BindGroupLayoutEntry> = (0..buffers)
        .chain(has_uniforms.then_some(UNIFORMS))
        .map(|binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: match binding {
                    0 | UNIFORMS => wgpu::BufferBindingType::Uniform,
                    _ => wgpu::BufferBindingType::Storage { read_only: binding % 2 == 1 },
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}
