//! The GPU back end: generated WGSL, run as compute by wgpu.
//!
//! Columns stay in device memory until they are downloaded: one buffer holds all columns of a result, column `j` of
//! element `i` at `j * len + i`, in single precision. Rays march in slices (see the modules `program` and `slices`), so that no dispatch
//! runs long enough for a driver to reset the device. Errors of the device never panic and never reach stderr: every
//! call gives them back as [`BackendError`]. After [`BackendError::DeviceLost`], [`Gpu::rebuild`] makes a new device; kernels must
//! then be prepared and columns be uploaded again.

mod adapter;
mod pipelines;
mod program;
mod slices;
#[cfg(test)]
mod tests;

use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;

pub use adapter::{AdapterInfoLine, AdapterWanted, adapters};
pub use program::GpuKernel;

use super::{Backend, BackendError, Batch, Compiling, Kernel, Results, Wanted};
use crate::expr::Arena;

/// How work is cut for hardware: it takes less time than the threads that make its work ready and read its results.
const FOR_HARDWARE: Batch = Batch { elements: 1 << 18, at_once: 4 };
/// The same for software drivers, which need the threads themselves: one part is computed while what another has computed is read.
const FOR_SOFTWARE: Batch = Batch { elements: 1 << 16, at_once: 2 };
/// Time after which a device that does not answer counts as lost.
const LONGEST_WAIT: Duration = Duration::from_secs(60);

/// A graphics device that runs kernels.
pub struct Gpu {
    wanted: AdapterWanted,
    adapter: AdapterInfoLine,
    device: wgpu::Device,
    queue: wgpu::Queue,
    trouble: Trouble,
    cache: pipelines::Cache,
    dispatches: Mutex<Dispatches>,
    /// Commands that are submitted with the next ones that somebody waits for: a submission is expensive, however few they are.
    /// Locked after `turn`.
    pending: Mutex<Vec<wgpu::CommandBuffer>>,
    /// Held alone by the thread whose dispatch is being measured, and with others by those that hand over work.
    turn: RwLock<()>,
}

/// What a device was given to do, as far as it was waited for.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Dispatches {
    /// Dispatches that were measured.
    pub count: u64,
    /// The longest of them.
    pub longest: Duration,
}

impl Dispatches {
    fn add(&mut self, took: Duration) {
        self.count += 1;
        self.longest = self.longest.max(took);
    }
}

/// Columns of equal length in device memory.
pub struct GpuColumns {
    buffer: wgpu::Buffer,
    columns: usize,
    len: usize,
}

/// What went wrong outside any call: the first error, reported once, or always if the device is lost.
#[derive(Clone, Default)]
struct Trouble(Arc<Mutex<Option<BackendError>>>);

impl Trouble {
    fn set(&self, error: BackendError) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    fn check(&self) -> Result<(), BackendError> {
        let mut stored = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &*stored {
            Some(BackendError::DeviceLost(text)) => Err(BackendError::DeviceLost(text.clone())),
            _ => stored.take().map_or(Ok(()), Err),
        }
    }
}

/// The back end's error for one of wgpu's.
fn backend_error(error: &wgpu::Error) -> BackendError {
    match error {
        wgpu::Error::OutOfMemory { source } => BackendError::OutOfMemory(source.to_string()),
        wgpu::Error::Validation { description, .. } => BackendError::InvalidWgsl(description.clone()),
        wgpu::Error::Internal { description, .. } => BackendError::DeviceLost(description.clone()),
    }
}

/// Runs `work` and gives back the first error that the device reported in it, on this thread.
fn scoped<T>(device: &wgpu::Device, work: impl FnOnce() -> Result<T, BackendError>) -> Result<T, BackendError> {
    let filters = [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Validation];
    let scopes = filters.map(|filter| device.push_error_scope(filter));
    let result = work();
    // Use of a buffer for which there was no memory is invalid too: the outer scopes tell the cause.
    let mut cause = None;
    for scope in scopes.into_iter().rev() {
        cause = pollster::block_on(scope.pop()).or(cause);
    }
    match cause {
        Some(error) => Err(backend_error(&error)),
        None => result,
    }
}

impl Gpu {
    /// Opens the best adapter of the kind wanted: discrete before integrated before virtual before software.
    ///
    /// Errors: [`BackendError::NoAdapter`] where there is none, [`BackendError::DeviceLost`] where it cannot be opened.
    pub fn new(wanted: AdapterWanted) -> Result<Gpu, BackendError> {
        let (adapter, line) = adapter::choose(wanted)?;
        let request =
            wgpu::DeviceDescriptor { label: Some("bulbfold"), required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&request))
            .map_err(|error| BackendError::DeviceLost(format!("{} cannot be opened: {error}", line.name)))?;
        let trouble = Trouble::default();
        let stored = trouble.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| stored.set(backend_error(&error))));
        let stored = trouble.clone();
        device.set_device_lost_callback(move |_, text| stored.set(BackendError::DeviceLost(text)));
        Ok(Gpu {
            wanted,
            adapter: line,
            device,
            queue,
            trouble,
            cache: pipelines::Cache::default(),
            dispatches: Mutex::default(),
            pending: Mutex::default(),
            turn: RwLock::default(),
        })
    }

    /// Replaces a lost device by a new one. What was prepared or uploaded before is of no use any more.
    pub fn rebuild(&mut self) -> Result<(), BackendError> {
        *self = Gpu::new(self.wanted)?;
        Ok(())
    }

    /// Dispatches so far.
    pub fn dispatches(&self) -> Dispatches {
        *self.dispatches.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The adapter in use.
    pub fn adapter(&self) -> &AdapterInfoLine {
        &self.adapter
    }

    /// Runs `work` and gives back the first error that the device reported in it or before.
    fn scoped<T>(&self, work: impl FnOnce() -> Result<T, BackendError>) -> Result<T, BackendError> {
        self.trouble.check()?;
        let result = scoped(&self.device, work);
        if result.is_err() {
            // A lost device fails in many ways; that it is lost is told when it is polled.
            let _ = self.device.poll(wgpu::PollType::Poll);
        }
        self.trouble.check()?;
        result
    }

    /// A buffer that kernels read and write; never of size 0, which cannot be bound.
    fn storage(&self, bytes: u64) -> Result<wgpu::Buffer, BackendError> {
        let limits = self.device.limits();
        let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
        if bytes > most {
            return Err(BackendError::OutOfMemory(format!("{bytes} bytes in one buffer, and {most} is the most")));
        }
        use wgpu::BufferUsages as Usage;
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.max(4),
            usage: Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST,
            mapped_at_creation: false,
        }))
    }

    /// Columns with contents still to be written.
    fn columns(&self, columns: usize, len: usize) -> Result<GpuColumns, BackendError> {
        let buffer = self.storage((columns * len * size_of::<f32>()) as u64)?;
        Ok(GpuColumns { buffer, columns, len })
    }

    /// A buffer that results are copied into to be read.
    fn staging(&self, bytes: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Waits for commands and hands what they copied into `staging` to `read`.
    fn read_back<T>(
        &self,
        submission: wgpu::SubmissionIndex,
        staging: &wgpu::Buffer,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, BackendError> {
        let (sender, mapped) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        self.wait_for(submission)?;
        // Another thread's poll may be about to tell it.
        match mapped.recv_timeout(LONGEST_WAIT) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(BackendError::DeviceLost(error.to_string())),
            Err(_) => return Err(BackendError::DeviceLost("it did not give its results".into())),
        }
        let view = staging.get_mapped_range(..).map_err(|error| BackendError::DeviceLost(error.to_string()))?;
        let result = read(&view);
        drop(view);
        staging.unmap();
        Ok(result)
    }

    /// Takes commands without waiting for them.
    fn add(&self, encoder: wgpu::CommandEncoder) {
        let commands = encoder.finish();
        self.pending.lock().unwrap_or_else(PoisonError::into_inner).push(commands);
    }

    /// Hands commands over, and those before them, at a time when nothing is measured.
    fn hand_over(&self, encoder: wgpu::CommandEncoder) -> wgpu::SubmissionIndex {
        let _others = self.turn.read().unwrap_or_else(PoisonError::into_inner);
        self.add(encoder);
        self.flush()
    }

    /// Hands over what is pending. Whoever calls this has the turn.
    fn flush(&self) -> wgpu::SubmissionIndex {
        let mut pending = self.pending.lock().unwrap_or_else(PoisonError::into_inner);
        self.queue.submit(pending.drain(..))
    }

    /// Waits until the device has done all that was submitted.
    fn wait(&self) -> Result<(), BackendError> {
        self.poll(None)
    }

    /// Waits until the device has done what was submitted up to here.
    fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<(), BackendError> {
        self.poll(Some(submission))
    }

    fn poll(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<(), BackendError> {
        let poll = wgpu::PollType::Wait { submission_index, timeout: Some(LONGEST_WAIT) };
        if let Err(error) = self.device.poll(poll) {
            self.trouble.set(BackendError::DeviceLost(error.to_string()));
        }
        self.trouble.check()
    }
}

impl Backend for Gpu {
    type Prepared = GpuKernel;
    type Columns = GpuColumns;

    fn batch(&self) -> Batch {
        if self.adapter.is_software { FOR_SOFTWARE } else { FOR_HARDWARE }
    }

    fn prepare(&self, arena: &Arena, kernel: &Kernel) -> Result<GpuKernel, BackendError> {
        self.scoped(|| {
            let pipelines = self.cache.get(&self.device, arena, kernel)?;
            self.with_uniforms((&pipelines, self.tables(arena, kernel)?), &[])
        })
    }

    fn bind(&self, kernel: &GpuKernel, uniforms: &[f64]) -> Result<GpuKernel, BackendError> {
        self.scoped(|| self.with_uniforms((&kernel.pipelines, kernel.tables.clone()), uniforms))
    }

    fn compiling(&self) -> Option<Compiling> {
        Some(self.cache.compiling())
    }

    fn upload(&self, columns: &[impl AsRef<[f64]>]) -> Result<GpuColumns, BackendError> {
        self.scoped(|| {
            let result = self.columns(columns.len(), columns.first().map_or(0, |column| column.as_ref().len()))?;
            let Some(size) = std::num::NonZeroU64::new((result.columns * result.len * size_of::<f32>()) as u64) else {
                return Ok(result);
            };
            let refused = || BackendError::DeviceLost("it takes no data".into());
            let mut view = self.queue.write_buffer_with(&result.buffer, 0, size).ok_or_else(refused)?;
            let (numbers, _) = view.slice(..).into_chunks::<{ size_of::<f32>() }>();
            numbers.write_iter(columns.iter().flat_map(|column| column.as_ref()).map(|&x| (x as f32).to_ne_bytes()));
            drop(view);
            Ok(result)
        })
    }

    fn download(&self, columns: &GpuColumns) -> Result<Vec<Vec<f64>>, BackendError> {
        self.download_only(columns, &Vec::from_iter(0..columns.columns))
    }

    fn read<R>(&self, wanted: &[Wanted<GpuColumns>], take: impl FnOnce(Results) -> R) -> Result<R, BackendError> {
        let all = || wanted.iter().flat_map(|(columns, numbers)| numbers.iter().map(move |&number| (columns, number)));
        let bytes = |columns: &GpuColumns| (columns.len * size_of::<f32>()) as u64;
        let total = all().map(|(columns, _)| bytes(columns)).sum();
        if total == 0 {
            return Ok(take(cut(wanted, &[])));
        }
        self.scoped(|| {
            let staging = self.staging(total);
            let mut encoder = self.encoder();
            let mut at = 0;
            for (columns, number) in all().filter(|(columns, _)| columns.len > 0) {
                let bytes = bytes(columns);
                encoder.copy_buffer_to_buffer(&columns.buffer, number as u64 * bytes, &staging, at, bytes);
                at += bytes;
            }
            self.read_back(self.hand_over(encoder), &staging, |bytes| take(cut(wanted, bytemuck::cast_slice(bytes))))
        })
    }

    fn run(&self, kernel: &GpuKernel, inputs: &[&GpuColumns]) -> Result<GpuColumns, BackendError> {
        self.scoped(|| self.run_kernel(kernel, inputs))
    }

    fn finish(&self) -> Result<(), BackendError> {
        {
            let _others = self.turn.read().unwrap_or_else(PoisonError::into_inner);
            self.flush();
        }
        self.wait()
    }
}

/// The columns that are wanted, which lie one behind the other.
fn cut<'a>(wanted: &[Wanted<GpuColumns>], numbers: &'a [f32]) -> Results<'a> {
    let mut rest = numbers;
    let mut next = |len: usize| rest.split_off(..len).expect("all were copied");
    Results::F32(wanted.iter().map(|(columns, of)| of.iter().map(|_| next(columns.len)).collect()).collect())
}
