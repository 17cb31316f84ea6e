//! How kernels run: straight-line ones in parts, marches in slices.

use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use super::pipelines::Pipelines;
use super::{Gpu, GpuColumns};
use crate::expr::Arena;
use crate::kernel::wgsl::{SAMPLED, TABLES, UNIFORMS, WORKGROUP};
use crate::kernel::{BackendError, Kernel};

/// A kernel with values of its uniforms.
#[derive(Clone)]
pub struct GpuKernel {
    pub(super) pipelines: Arc<Pipelines>,
    /// Absent where there are no uniforms.
    pub(super) uniforms: Option<wgpu::Buffer>,
    /// The tables that it looks up, one behind the other, where there are any.
    pub(super) tables: Option<wgpu::Buffer>,
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
    most: u32,
    starts: u32,
    padding: u32,
}

/// What a dispatch covers.
#[derive(Clone, Copy)]
struct Part {
    /// Elements in a column.
    n: usize,
    /// First element, or entry of the list of running rays.
    first: u32,
    /// The one after its last.
    end: u32,
    /// Most march steps of this dispatch, and of a ray.
    steps: [u32; 2],
    /// Whether rays start.
    starts: bool,
}

/// A kernel that marches.
struct March<'a> {
    kernel: &'a GpuKernel,
    pipeline: &'a wgpu::ComputePipeline,
    /// Most steps of a ray.
    most: u32,
}

/// Buffers of a march: two lists of running rays (count, work, then numbers), read and written in turns.
struct MarchBuffers {
    lists: [wgpu::Buffer; 2],
    /// The uniforms of dispatches that are submitted together.
    calls: [wgpu::Buffer; PASSES.len()],
    /// For each of them, with the list that an even or odd number reads.
    groups: [wgpu::BindGroup; PASSES.len()],
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
        let mut encoder = self.encoder();
        let joined;
        let input = match inputs {
            [only] => *only,
            _ => {
                joined = self.join(&mut encoder, inputs, given, len)?;
                &joined
            }
        };
        let pipeline = kernel.pipelines.compiled.get()?;
        match kernel.pipelines.max_march_steps {
            None => self.run_parts(encoder, kernel, pipeline, input, &outputs)?,
            Some(most) => self.run_march(encoder, &March { kernel, pipeline, most }, input, &outputs)?,
        }
        Ok(outputs)
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Columns one after the other in one buffer.
    fn join(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        inputs: &[&GpuColumns],
        columns: usize,
        len: usize,
    ) -> Result<GpuColumns, BackendError> {
        let joined = self.columns(columns, len)?;
        let mut at = 0;
        for input in inputs {
            let bytes = (input.columns * len * size_of::<f32>()) as u64;
            encoder.copy_buffer_to_buffer(&input.buffer, 0, &joined.buffer, at, bytes);
            at += bytes;
        }
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
    pub(super) fn with_uniforms(
        &self,
        (pipelines, tables): (&Arc<Pipelines>, Option<wgpu::Buffer>),
        values: &[f64],
    ) -> Result<GpuKernel, BackendError> {
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
        Ok(GpuKernel { pipelines: pipelines.clone(), uniforms, tables })
    }

    /// A buffer of the tables that a kernel looks up, where there are any.
    pub(super) fn tables(&self, arena: &Arena, kernel: &Kernel) -> Result<Option<wgpu::Buffer>, BackendError> {
        let numbers: Vec<&[f32]> =
            kernel.tables(arena).into_iter().map(|number| arena.table(number).numbers()).collect();
        if numbers.is_empty() {
            return Ok(None);
        }
        let count: usize = numbers.iter().map(|numbers| numbers.len()).sum();
        let buffer = self.storage((count * size_of::<f32>()) as u64)?;
        let mut at = 0;
        for numbers in numbers {
            self.queue.write_buffer(&buffer, at, bytemuck::cast_slice(numbers));
            at += size_of_val(numbers) as u64;
        }
        Ok(Some(buffer))
    }

    fn bind(&self, kernel: &GpuKernel, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry> = buffers
            .iter()
            .enumerate()
            .map(|(i, buffer)| (i as u32, *buffer))
            .chain(kernel.uniforms.iter().map(|buffer| (UNIFORMS, buffer)))
            .chain(kernel.tables.iter().map(|buffer| (TABLES, buffer)))
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.pipelines.layout,
            entries: &entries,
        })
    }

    /// Adds the commands of one dispatch. The uniform is written before any of what is submitted next.
    fn dispatch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &wgpu::ComputePipeline,
        group: &wgpu::BindGroup,
        call: &wgpu::Buffer,
        part: Part,
    ) {
        let groups = (part.end - part.first).div_ceil(WORKGROUP);
        let width = groups.min(self.device.limits().max_compute_workgroups_per_dimension);
        let uniform = Call {
            n: part.n as u32,
            first: part.first,
            end: part.end,
            row: width * WORKGROUP,
            slice: part.steps[0],
            most: part.steps[1],
            starts: u32::from(part.starts),
            padding: 0,
        };
        self.queue.write_buffer(call, 0, bytemuck::bytes_of(&uniform));
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width, groups.div_ceil(width), 1);
    }

    /// Elements in parts, each waited for and measured; all at once, and unmeasured, where that is short for certain.
    fn run_parts(
        &self,
        mut encoder: wgpu::CommandEncoder,
        kernel: &GpuKernel,
        pipeline: &wgpu::ComputePipeline,
        input: &GpuColumns,
        outputs: &GpuColumns,
    ) -> Result<(), BackendError> {
        let call = self.call_buffer();
        let group = self.bind(kernel, &[&call, &input.buffer, &outputs.buffer]);
        let slices = &kernel.pipelines.slices;
        let (mut first, len) = (0, input.len as u32);
        let part = |first, end| Part { n: input.len, first, end, steps: [0; 2], starts: false };
        if len <= slices.elements() / 2 {
            self.dispatch(&mut encoder, pipeline, &group, &call, part(0, len));
            self.add(encoder);
            return Ok(());
        }
        self.add(encoder);
        while first < len {
            let end = len.min(first.saturating_add(slices.elements()));
            let ((), took) = self.measured(|| {
                let mut encoder = self.encoder();
                self.dispatch(&mut encoder, pipeline, &group, &call, part(first, end));
                self.wait_for(self.queue.submit([encoder.finish()]))
            })?;
            slices.learn(end - first, took);
            first = end;
        }
        Ok(())
    }

    /// Does something with the device and waits for it, on an idle device and while no other thread gives it work: gives its
    /// time.
    fn measured<T>(&self, work: impl FnOnce() -> Result<T, BackendError>) -> Result<(T, Duration), BackendError> {
        let _alone = self.turn.write().unwrap_or_else(PoisonError::into_inner);
        self.flush();
        self.wait()?;
        let start = Instant::now();
        let result = work()?;
        let took = start.elapsed();
        self.dispatches.lock().unwrap_or_else(PoisonError::into_inner).add(took);
        Ok((result, took))
    }

    /// Marches until no ray runs or steps have run out: without waiting where that is short for certain, else in slices. Twin:
    /// `run_march` in `kernel/cpu/march.rs`.
    fn run_march(
        &self,
        mut encoder: wgpu::CommandEncoder,
        march: &March,
        input: &GpuColumns,
        outputs: &GpuColumns,
    ) -> Result<(), BackendError> {
        let n = input.len;
        let buffers = self.march_buffers(march.kernel, input, outputs)?;
        let (mut running, mut pass) = (n as u32, 0);
        match march.kernel.pipelines.slices.unwatched(running, march.most) {
            None => self.add(encoder),
            Some(steps) => {
                self.add_passes(&mut encoder, march, &buffers, n, steps);
                if steps == march.most {
                    // The most expensive kernels: the device begins at once.
                    self.hand_over(encoder);
                    return Ok(());
                }
                let counts = self.staging(COUNTS);
                pass = PASSES.len();
                encoder.copy_buffer_to_buffer(&buffers.lists[pass % 2], 0, &counts, 0, COUNTS);
                [running, _] = self.read_back(self.hand_over(encoder), &counts, read_counts)?;
            }
        }
        while running > 0 {
            running = self.run_pass(march, &buffers, pass, n, running)?;
            pass += 1;
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
        let calls = [(); PASSES.len()].map(|()| self.call_buffer());
        let group = |i: usize| {
            let [read, written] = [&lists[i % 2], &lists[1 - i % 2]];
            self.bind(kernel, &[&calls[i], &input.buffer, &outputs.buffer, read, written])
        };
        let groups = std::array::from_fn(group);
        Ok(MarchBuffers { lists, calls, groups })
    }

    /// Adds the commands of a march of up to so many steps: passes over the rays that still run, whose number the device alone knows.
    fn add_passes(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        march: &March,
        buffers: &MarchBuffers,
        n: usize,
        most: u32,
    ) {
        for (pass, steps) in PASSES.into_iter().enumerate() {
            let part = Part { n, first: 0, end: n as u32, steps: [steps.min(most), march.most], starts: pass == 0 };
            encoder.clear_buffer(&buffers.lists[1 - pass % 2], 0, Some(COUNTS));
            self.dispatch(encoder, march.pipeline, &buffers.groups[pass], &buffers.calls[pass], part);
        }
    }

    /// Advances all running rays, in the first pass all there are, by slices as they fit: in as many dispatches as their number calls
    /// for. Gives how many go on.
    fn run_pass(
        &self,
        march: &March,
        buffers: &MarchBuffers,
        pass: usize,
        n: usize,
        running: u32,
    ) -> Result<u32, BackendError> {
        let read = pass % 2;
        let written = &buffers.lists[1 - read];
        self.queue.write_buffer(written, 0, &[0; COUNTS as usize]);
        let slices = &march.kernel.pipelines.slices;
        let counts = self.staging(COUNTS);
        let (mut first, mut going_on, mut worked) = (0, 0, 0);
        while first < running {
            // What a slice tells decides how large the next one is, in the same pass too: rays may be at different steps.
            let slice = slices.slice(running - first, march.most);
            let end = running.min(first.saturating_add(slice.rays));
            let part = Part { n, first, end, steps: [slice.steps, march.most], starts: pass == 0 };
            let ([count, work], took) = self.measured(|| {
                let mut encoder = self.encoder();
                self.dispatch(&mut encoder, march.pipeline, &buffers.groups[read], &buffers.calls[read], part);
                encoder.copy_buffer_to_buffer(written, 0, &counts, 0, COUNTS);
                self.read_back(self.queue.submit([encoder.finish()]), &counts, read_counts)
            })?;
            slices.learn_slice(slice, work.wrapping_sub(worked).saturating_mul(SAMPLED), count > going_on, took);
            (first, going_on, worked) = (end, count, work);
        }
        Ok(going_on)
    }
}

/// Steps of the passes of a march without waits: most rays end in the first, and few are left for the last.
const PASSES: [u32; 3] = [48, 192, u32::MAX];

/// Bytes at the head of a list: how many rays go on, and the estimates that were counted.
const COUNTS: u64 = 8;

/// How many rays go on, and the estimates that were counted.
fn read_counts(bytes: &[u8]) -> [u32; 2] {
    bytes.first_chunk::<8>().map_or([0; 2], |bytes| bytemuck::cast(*bytes))
}
