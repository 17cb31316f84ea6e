//! How kernels run: straight-line ones in parts, marches in slices.

use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use super::pipelines::{Kind, Pipelines};
use super::slices::Slice;
use super::{Gpu, GpuColumns};
use crate::kernel::BackendError;
use crate::kernel::wgsl::{SAMPLED, UNIFORMS, WORKGROUP};

/// A kernel with values of its uniforms.
#[derive(Clone)]
pub struct GpuKernel {
    pub(super) pipelines: Arc<Pipelines>,
    /// Absent where there are no uniforms.
    pub(super) uniforms: Option<wgpu::Buffer>,
}

/// The uniform `Call` of `shaders/prelude.wgsl`, padded to whole vectors.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Call {
    n: u32,
    first: u32,
    end: u32,
    row: u32,
    slice: u32,
    padding: [u32; 3],
}

/// Buffers of a march: two lists of running rays (count, then numbers), read and written in turns.
struct MarchBuffers {
    lists: [wgpu::Buffer; 2],
    groups: [wgpu::BindGroup; 2],
    call: wgpu::Buffer,
}

impl Gpu {
    pub(super) fn run_kernel(&self, kernel: &GpuKernel, inputs: &[&GpuColumns]) -> Result<GpuColumns, BackendError> {
        let given: usize = inputs.iter().map(|c| c.columns).sum();
        assert_eq!(given, kernel.pipelines.inputs, "columns must match the kernel's inputs");
        let len = inputs.first().map_or(0, |c| c.len);
        assert!(inputs.iter().all(|c| c.len == len), "columns must be of equal length");
        let outputs = self.columns(kernel.pipelines.outputs, len)?;
        if len == 0 {
            return Ok(outputs);
        }
        let joined;
        let input = match inputs {
            [only] => *only,
            _ => {
                joined = self.join(inputs, given, len)?;
                &joined
            }
        };
        match &kernel.pipelines.kind {
            Kind::Straight(pipeline) => self.run_parts(kernel, pipeline, input, &outputs)?,
            Kind::March { start, march, max_march_steps } => {
                self.run_march(kernel, [start, march], *max_march_steps, input, &outputs)?;
            }
        }
        Ok(outputs)
    }

    /// Columns one after the other in one buffer.
    fn join(&self, inputs: &[&GpuColumns], columns: usize, len: usize) -> Result<GpuColumns, BackendError> {
        let joined = self.columns(columns, len)?;
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut at = 0;
        for input in inputs {
            let bytes = (input.columns * len * size_of::<f32>()) as u64;
            encoder.copy_buffer_to_buffer(&input.buffer, 0, &joined.buffer, at, bytes);
            at += bytes;
        }
        self.queue.submit([encoder.finish()]);
        Ok(joined)
    }

    fn call_buffer(&self) -> wgpu::Buffer {
        self.uniform_buffer(size_of::<Call>() as u64)
    }

    fn uniform_buffer(&self, size: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Compiled pipelines with values of their uniforms; those that the list lacks are 0.
    pub(super) fn with_uniforms(&self, pipelines: &Arc<Pipelines>, values: &[f64]) -> Result<GpuKernel, BackendError> {
        // The uniforms of a buffer are whole vectors to some drivers.
        let padded = pipelines.uniforms.next_multiple_of(4);
        let bytes = (padded * size_of::<f32>()) as u64;
        let most = self.device.limits().max_uniform_buffer_binding_size;
        if bytes > most {
            return Err(BackendError::OutOfMemory(format!("{bytes} bytes of uniforms, and {most} is the most")));
        }
        let uniforms = (padded > 0).then(|| {
            let mut numbers: Vec<f32> = values.iter().take(pipelines.uniforms).map(|&x| x as f32).collect();
            numbers.resize(padded, 0.0);
            let buffer = self.uniform_buffer(bytes);
            self.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&numbers));
            buffer
        });
        Ok(GpuKernel { pipelines: pipelines.clone(), uniforms })
    }

    fn bind(&self, kernel: &GpuKernel, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry> = buffers
            .iter()
            .enumerate()
            .map(|(i, buffer)| (i as u32, *buffer))
            .chain(kernel.uniforms.iter().map(|buffer| (UNIFORMS, buffer)))
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.pipelines.layout,
            entries: &entries,
        })
    }

    /// Commands of one dispatch over a range of elements. The uniform is written when they are submitted.
    fn dispatch(
        &self,
        pipeline: &wgpu::ComputePipeline,
        group: &wgpu::BindGroup,
        call: &wgpu::Buffer,
        n: usize,
        range: std::ops::Range<u32>,
        slice: u32,
    ) -> wgpu::CommandEncoder {
        let groups = (range.end - range.start).div_ceil(WORKGROUP);
        let width = groups.min(self.device.limits().max_compute_workgroups_per_dimension);
        let uniform =
            Call { n: n as u32, first: range.start, end: range.end, row: width * WORKGROUP, slice, padding: [0; 3] };
        self.queue.write_buffer(call, 0, bytemuck::bytes_of(&uniform));
        let mut encoder = self.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(width, groups.div_ceil(width), 1);
        }
        encoder
    }

    /// Elements in parts, each waited for and measured; all at once, and unmeasured, where that is short for certain.
    fn run_parts(
        &self,
        kernel: &GpuKernel,
        pipeline: &wgpu::ComputePipeline,
        input: &GpuColumns,
        outputs: &GpuColumns,
    ) -> Result<(), BackendError> {
        let call = self.call_buffer();
        let group = self.bind(kernel, &[&call, &input.buffer, &outputs.buffer]);
        let slices = &kernel.pipelines.slices;
        let (mut first, len) = (0, input.len as u32);
        if len <= slices.elements() / 2 {
            let encoder = self.dispatch(pipeline, &group, &call, input.len, 0..len, 0);
            self.queue.submit([encoder.finish()]);
            return Ok(());
        }
        self.wait()?;
        while first < len {
            let end = len.min(first.saturating_add(slices.elements()));
            let start = Instant::now();
            let encoder = self.dispatch(pipeline, &group, &call, input.len, first..end, 0);
            self.queue.submit([encoder.finish()]);
            self.wait()?;
            slices.learn(end - first, self.took(start));
            first = end;
        }
        Ok(())
    }

    /// Time since a dispatch was begun that has just ended.
    fn took(&self, start: Instant) -> Duration {
        let took = start.elapsed();
        self.dispatches.lock().unwrap_or_else(PoisonError::into_inner).add(took);
        took
    }

    /// Marches in slices until no ray runs or steps have run out. Twin: `run_march` in `kernel/cpu.rs`.
    fn run_march(
        &self,
        kernel: &GpuKernel,
        [start, march]: [&wgpu::ComputePipeline; 2],
        max_march_steps: u32,
        input: &GpuColumns,
        outputs: &GpuColumns,
    ) -> Result<(), BackendError> {
        let buffers = self.march_buffers(kernel, input, outputs)?;
        let (n, mut read) = (input.len, 1);
        let encoder = self.dispatch(start, &buffers.groups[read], &buffers.call, n, 0..n as u32, 0);
        read = 1 - read;
        let [mut running, _] = self.read_back(encoder, &buffers.lists[read], 8, read_counts)?;
        let (mut done, mut step) = (0, Duration::ZERO);
        while running > 0 && done < max_march_steps {
            let slice = kernel.pipelines.slices.slice(running, max_march_steps - done, step);
            let longest;
            (running, longest) = self.run_slice(kernel, march, &buffers, read, (n, running, slice))?;
            step = longest / slice.steps;
            done += slice.steps;
            read = 1 - read;
        }
        Ok(())
    }

    fn march_buffers(
        &self,
        kernel: &GpuKernel,
        input: &GpuColumns,
        outputs: &GpuColumns,
    ) -> Result<MarchBuffers, BackendError> {
        let bytes = ((input.len + 2) * size_of::<u32>()) as u64;
        let lists = [self.storage(bytes)?, self.storage(bytes)?];
        let call = self.call_buffer();
        let groups = [0, 1]
            .map(|read| self.bind(kernel, &[&call, &input.buffer, &outputs.buffer, &lists[read], &lists[1 - read]]));
        Ok(MarchBuffers { lists, groups, call })
    }

    /// Advances all listed rays by one slice, in as many dispatches as their number calls for. Gives how many still run and
    /// the time of the longest dispatch.
    fn run_slice(
        &self,
        kernel: &GpuKernel,
        march: &wgpu::ComputePipeline,
        buffers: &MarchBuffers,
        read: usize,
        (n, running, slice): (usize, u32, Slice),
    ) -> Result<(u32, Duration), BackendError> {
        let written = &buffers.lists[1 - read];
        self.queue.write_buffer(written, 0, &[0; 8]);
        let slices = &kernel.pipelines.slices;
        let (mut first, mut still_running, mut worked, mut longest) = (0, 0, 0, Duration::ZERO);
        while first < running {
            let end = running.min(first.saturating_add(slice.rays));
            let start = Instant::now();
            let encoder = self.dispatch(march, &buffers.groups[read], &buffers.call, n, first..end, slice.steps);
            let [count, work] = self.read_back(encoder, written, 8, read_counts)?;
            let took = self.took(start);
            slices.learn(work.wrapping_sub(worked).saturating_mul(SAMPLED), took);
            (first, still_running, worked, longest) = (end, count, work, longest.max(took));
        }
        Ok((still_running, longest))
    }
}

/// How many rays still run, and the estimates that were counted.
fn read_counts(bytes: &[u8]) -> [u32; 2] {
    bytes.first_chunk::<8>().map_or([0; 2], |bytes| bytemuck::cast(*bytes))
}
