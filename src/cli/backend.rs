//! Which back end does the work: the only place of the program that opens a GPU.

use bulbfold::kernel::cpu::{Cpu, Precision};
#[cfg(feature = "gpu")]
use bulbfold::kernel::gpu::{AdapterWanted, Gpu};
use bulbfold::kernel::{Backend, BackendError};

use super::arguments::{BackendArg, PrecisionArg};
#[cfg(feature = "gpu")]
use super::driver;
use super::session::talk;
use super::{Failure, Session, message, usage};

/// How often a lost device is opened again for one piece of work. A driver that loses it at the same place every time gives up
/// soon, and the CPU takes over.
#[cfg(feature = "gpu")]
const MOST_REBUILDS: u32 = 2;

/// Work that any back end can do.
pub trait Job {
    /// What comes out.
    type Output;
    /// Does it; may be called again, on this back end opened anew or on another one, if this one fails, and then goes on at
    /// what is done.
    fn run<B: Backend>(&mut self, backend: &B) -> Result<Self::Output, BackendError>;
}

/// What is asked of the back end.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Which one.
    pub backend: BackendArg,
    /// Precision, where it was given.
    pub precision: Option<PrecisionArg>,
}

impl Wanted {
    /// The precision in effect, where nothing else is asked `default`.
    pub fn precision(self, default: PrecisionArg) -> Result<PrecisionArg, Failure> {
        match (self.backend, self.precision) {
            (BackendArg::Gpu, Some(PrecisionArg::F64)) => {
                let help = "drop one of them: `--precision f64` runs on the CPU";
                Err(usage("GPUs compute in f32: `--backend gpu` and `--precision f64` exclude each other", help))
            }
            (BackendArg::Gpu, None) => Ok(PrecisionArg::F32),
            (_, given) => Ok(given.unwrap_or(default)),
        }
    }
}

/// Does a job on the back end that was asked for and says which one it was. With `auto`, a GPU that fails hands over to
/// the CPU.
pub fn run_job<J: Job>(
    session: &Session,
    wanted: BackendArg,
    precision: PrecisionArg,
    job: &mut J,
) -> Result<(String, J::Output), Failure> {
    if wanted != BackendArg::Cpu && precision == PrecisionArg::F32 {
        match run_on_gpu(wanted, job) {
            Some(Ok(done)) => return Ok(done),
            Some(Err(error)) if wanted == BackendArg::Gpu => {
                return Err(Failure::Work(message(
                    &error.to_string(),
                    "`--backend cpu` renders the same picture without a GPU",
                )));
            }
            Some(Err(error)) => session.warn(&format!("{error}; the CPU takes over")),
            None => {}
        }
    }
    let cpu = Cpu::new(precision.cpu());
    let output = job.run(&cpu).map_err(|error| Failure::Work(message(&error.to_string(), "")))?;
    Ok((cpu.description(), output))
}

/// `None` where `auto` finds no hardware, which is nothing to talk about.
#[cfg(feature = "gpu")]
fn run_on_gpu<J: Job>(wanted: BackendArg, job: &mut J) -> Option<Result<(String, J::Output), BackendError>> {
    if wanted == BackendArg::Auto {
        // Nobody asked for this driver, so it may end no more than a process of its own.
        let tried = driver::try_hardware();
        if let Some(error) = tried.error {
            return Some(Err(error));
        }
        if !tried.has_hardware() {
            return None;
        }
    }
    // Software adapters only where a GPU was asked for by name; hardware is preferred in either case.
    let adapter = if wanted == BackendArg::Gpu { AdapterWanted::Any } else { AdapterWanted::Hardware };
    let gpu = match Gpu::new(adapter) {
        Ok(gpu) => gpu,
        Err(BackendError::NoAdapter(_)) if wanted == BackendArg::Auto => return None,
        Err(error) => return Some(Err(error)),
    };
    let name = format!("gpu, f32, {}", gpu.adapter().name);
    let (mut gpu, mut told) = (gpu, |error: &BackendError| talk(&format!("{error}; it is opened again")));
    Some(with_rebuilds(&mut gpu, Gpu::rebuild, |gpu| job.run(gpu), &mut told).map(|output| (name, output)))
}

/// Work on a device that is opened anew where it is lost, up to [`MOST_REBUILDS`] times. The work goes on at what it has done.
#[cfg(feature = "gpu")]
fn with_rebuilds<D, T>(
    device: &mut D,
    rebuild: impl Fn(&mut D) -> Result<(), BackendError>,
    mut work: impl FnMut(&D) -> Result<T, BackendError>,
    told: &mut dyn FnMut(&BackendError),
) -> Result<T, BackendError> {
    for _ in 0..MOST_REBUILDS {
        match work(device) {
            Err(error @ BackendError::DeviceLost(_)) => {
                told(&error);
                // A device that cannot be opened any more is as lost as before.
                rebuild(device).map_err(|_| error)?;
            }
            done => return done,
        }
    }
    work(device)
}

#[cfg(not(feature = "gpu"))]
fn run_on_gpu<J: Job>(wanted: BackendArg, _: &mut J) -> Option<Result<(String, J::Output), BackendError>> {
    let text = "this bulbfold was built without the feature `gpu`".to_string();
    (wanted == BackendArg::Gpu).then_some(Err(BackendError::NoAdapter(text)))
}

/// Adapters with their text and whether they are in software, and why none of them can be used where a driver fails: tried in
/// another process.
pub fn tried_adapters() -> (Vec<(String, bool)>, Option<BackendError>) {
    #[cfg(feature = "gpu")]
    {
        let tried = driver::try_any();
        return (tried.adapters, tried.error);
    }
    #[cfg(not(feature = "gpu"))]
    (Vec::new(), None)
}

/// Whether there is graphics hardware whose driver works, tried in another process.
#[cfg(feature = "chart")]
pub fn hardware_works() -> bool {
    #[cfg(feature = "gpu")]
    return driver::try_hardware().has_hardware();
    #[cfg(not(feature = "gpu"))]
    false
}

/// Runs a job on every back end of the machine, the reference (f64) first; on a GPU where its driver `works`.
pub fn run_everywhere<J: Job>(job: &mut J, works: bool) -> Vec<(String, Result<J::Output, BackendError>)> {
    let mut results = Vec::new();
    for precision in [Precision::F64, Precision::F32] {
        let cpu = Cpu::new(precision);
        results.push((cpu.description(), job.run(&cpu)));
    }
    if !works {
        return results;
    }
    match run_on_gpu(BackendArg::Gpu, job) {
        Some(Ok((name, output))) => results.push((name, Ok(output))),
        Some(Err(BackendError::NoAdapter(text))) => talk(&format!("no GPU was tried: {text}")),
        Some(Err(error)) => results.push(("gpu, f32".into(), Err(error))),
        None => {}
    }
    results
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use super::*;

    fn lost() -> BackendError {
        BackendError::DeviceLost("for a test".into())
    }

    /// The number of the device stands for what it was rebuilt to; work ends well on device `good`.
    fn run(good: u32, error: BackendError) -> (Result<u32, BackendError>, u32, usize) {
        let (mut device, mut told) = (0, 0);
        let rebuild = |device: &mut u32| {
            *device += 1;
            Ok(())
        };
        let work = |device: &u32| if *device == good { Ok(*device) } else { Err(error.clone()) };
        let done = with_rebuilds(&mut device, rebuild, work, &mut |_| told += 1);
        (done, device, told)
    }

    #[test]
    fn a_lost_device_is_opened_again_and_the_work_goes_on() {
        assert_eq!(run(0, lost()), (Ok(0), 0, 0));
        assert_eq!(run(2, lost()), (Ok(2), 2, 2));
        assert_eq!(run(3, lost()), (Err(lost()), 2, 2));
        let small = BackendError::OutOfMemory("for a test".into());
        assert_eq!(run(1, small.clone()), (Err(small), 0, 0), "more of the same memory does not help");
    }

    #[test]
    fn a_device_that_cannot_be_opened_again_is_lost() {
        let none = |_: &mut u32| Err(BackendError::NoAdapter("gone".into()));
        let done: Result<(), _> = with_rebuilds(&mut 0, none, |_| Err(lost()), &mut |_| {});
        assert_eq!(done, Err(lost()));
    }
}
