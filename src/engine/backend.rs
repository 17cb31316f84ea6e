//! Which back end does the work: the only place that opens a GPU.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use super::{BackendChoice, Composed, Error, Observer};
#[cfg(feature = "gpu")]
use crate::diag::Diagnostic;
use crate::kernel::cpu::Cpu;
#[cfg(feature = "gpu")]
use crate::kernel::gpu::{AdapterWanted, Gpu};
use crate::kernel::template::{Announced, Kept};
use crate::kernel::{Backend, BackendError};
use crate::math::Precision;

/// How often a lost device is opened again for one piece of work. A driver that loses it at the same place every time gives up
/// soon, and the CPU takes over.
#[cfg(feature = "gpu")]
const MOST_REBUILDS: u32 = 2;

/// Work that any back end can do.
pub trait Work {
    /// What comes out.
    type Output;
    /// Is told the back end that does it, in words: what its results follow from. Comes before [`Work::run`].
    fn begin(&mut self, _backend: &str) {}
    /// Does it; may be called again, on this back end opened anew or on another one, if this one fails, and then goes on at
    /// what is done. `kernels` has those of earlier work.
    fn run<B: Backend>(
        &mut self,
        backend: &B,
        kernels: &mut Kept<B>,
        observer: &mut dyn Observer,
    ) -> Result<Self::Output, BackendError>;
}

/// The back ends of an engine, and the kernels that they have compiled.
#[derive(Default)]
pub struct Backends {
    /// Of both precisions.
    cpu: [Mutex<Kept<Cpu>>; 2],
    /// Whether kernels are kept.
    keeps: bool,
    /// Kernels that will come.
    announced: Announced,
    /// Says whether there is hardware whose driver works.
    works: Option<fn() -> Result<bool, BackendError>>,
    #[cfg(feature = "gpu")]
    gpu: Mutex<Option<Opened>>,
}

/// A device that is open.
#[cfg(feature = "gpu")]
struct Opened {
    gpu: Gpu,
    /// Whether it is good enough where hardware is wanted.
    is_hardware: bool,
    kernels: Kept<Gpu>,
}

impl Backends {
    /// Keeps what is compiled from now on for later work.
    pub fn keep_kernels(&mut self) {
        self.cpu = std::array::from_fn(|_| Mutex::new(Kept::keeping(&self.announced)));
        #[cfg(feature = "gpu")]
        if let Some(opened) = self.gpu.get_mut().unwrap_or_else(PoisonError::into_inner) {
            opened.kernels = Kept::keeping(&self.announced);
        }
        self.keeps = true;
    }

    /// Asks this before a GPU is opened that nobody asked for by name.
    pub fn try_hardware(&mut self, works: fn() -> Result<bool, BackendError>) {
        self.works = Some(works);
    }

    /// Kernels that were compiled so far.
    pub fn compiled(&self) -> usize {
        let of = |kept: &Mutex<Kept<Cpu>>| kept.lock().unwrap_or_else(PoisonError::into_inner).compiled();
        let all = self.cpu.iter().map(of).sum::<usize>();
        #[cfg(feature = "gpu")]
        let all = all
            + self.gpu.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map_or(0, |gpu| gpu.kernels.compiled());
        all
    }

    /// How many structures the kernels of each name have had, where kernels are kept.
    pub fn structures(&self) -> BTreeMap<&'static str, usize> {
        let mut all = BTreeMap::new();
        let mut add = |of: &BTreeMap<&'static str, usize>| {
            of.iter().for_each(|(name, count)| *all.entry(*name).or_default() += count);
        };
        for kept in &self.cpu {
            add(kept.lock().unwrap_or_else(PoisonError::into_inner).structures());
        }
        #[cfg(feature = "gpu")]
        if let Some(gpu) = self.gpu.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
            add(gpu.kernels.structures());
        }
        all
    }

    /// Announces the kernels of a picture that will be rendered: what differs between them and others that are announced is a uniform from the start.
    pub fn announce(&self, composed: &Composed) {
        for pass in composed.pipeline.passes.iter() {
            self.announced.add(pass.role.name(), &composed.arena, &pass.kernel);
        }
    }

    /// Uses a device which is open already, whatever it is.
    #[cfg(feature = "gpu")]
    pub fn use_gpu(&mut self, gpu: Gpu) {
        let opened = Opened { gpu, is_hardware: true, kernels: self.kernels() };
        *self.gpu.get_mut().unwrap_or_else(PoisonError::into_inner) = Some(opened);
    }

    /// No kernels yet, to be kept or not.
    #[cfg(feature = "gpu")]
    fn kernels(&self) -> Kept<Gpu> {
        if self.keeps { Kept::keeping(&self.announced) } else { Kept::default() }
    }

    /// Does work on the back end that is wanted and says which one it was. With `Auto`, a GPU that fails hands over to the CPU.
    pub fn run<W: Work>(
        &self,
        wanted: BackendChoice,
        precision: Precision,
        work: &mut W,
        observer: &mut dyn Observer,
    ) -> Result<(String, W::Output), Error> {
        if wanted != BackendChoice::Cpu && precision == Precision::F32 {
            match self.run_on_gpu(wanted, work, observer) {
                Some(Ok(done)) => return Ok(done),
                Some(Err(error)) if wanted == BackendChoice::Gpu => {
                    return Err(Error::Backend {
                        error,
                        help: "`--backend cpu` renders the same picture without a GPU",
                    });
                }
                #[cfg(feature = "gpu")]
                Some(Err(error)) => observer.warn(Diagnostic::warning(format!("{error}; the CPU takes over"))),
                _ => {}
            }
        }
        self.run_on_cpu(precision, work, observer)
    }

    /// Does work on the CPU.
    pub fn run_on_cpu<W: Work>(
        &self,
        precision: Precision,
        work: &mut W,
        observer: &mut dyn Observer,
    ) -> Result<(String, W::Output), Error> {
        let cpu = Cpu::new(precision);
        let kept = &self.cpu[usize::from(precision == Precision::F64)];
        work.begin(&cpu.arithmetic());
        // Work that finds the kernels in use compiles its own.
        let output = match kept.try_lock() {
            Ok(mut kernels) => work.run(&cpu, &mut kernels, observer)?,
            Err(_) => work.run(&cpu, &mut Kept::default(), observer)?,
        };
        Ok((cpu.description(), output))
    }

    /// Does work on the GPU. `None` where `Auto` finds no hardware, which is nothing to talk about.
    #[cfg(feature = "gpu")]
    pub fn run_on_gpu<W: Work>(
        &self,
        wanted: BackendChoice,
        work: &mut W,
        observer: &mut dyn Observer,
    ) -> Option<Result<(String, W::Output), BackendError>> {
        let mut slot = self.gpu.lock().unwrap_or_else(PoisonError::into_inner);
        // Software adapters only where a GPU was asked for by name; hardware is preferred in either case.
        let is_enough = |opened: &Opened| opened.is_hardware || wanted == BackendChoice::Gpu;
        if !slot.as_ref().is_some_and(is_enough) {
            match self.works.filter(|_| wanted == BackendChoice::Auto).map(|works| works()) {
                Some(Ok(false)) => return None,
                Some(Err(error)) => return Some(Err(error)),
                _ => {}
            }
            let adapter = if wanted == BackendChoice::Gpu { AdapterWanted::Any } else { AdapterWanted::Hardware };
            match Gpu::new(adapter) {
                Ok(gpu) => {
                    let is_hardware = !gpu.adapter().is_software;
                    *slot = Some(Opened { gpu, is_hardware, kernels: self.kernels() });
                }
                Err(BackendError::NoAdapter(_)) if wanted == BackendChoice::Auto => return None,
                Err(error) => return Some(Err(error)),
            }
        }
        let opened = slot.as_mut()?;
        let name = format!("gpu, f32, {}", opened.gpu.adapter().name);
        work.begin(&name);
        let rebuild = |opened: &mut Opened| {
            opened.kernels.forget();
            opened.gpu.rebuild()
        };
        let done = with_rebuilds(opened, observer, rebuild, |opened, observer| {
            work.run(&opened.gpu, &mut opened.kernels, observer)
        });
        if done.is_err() {
            *slot = None;
        }
        Some(done.map(|output| (name, output)))
    }

    /// This build has no GPU.
    #[cfg(not(feature = "gpu"))]
    pub fn run_on_gpu<W: Work>(
        &self,
        wanted: BackendChoice,
        _: &mut W,
        _: &mut dyn Observer,
    ) -> Option<Result<(String, W::Output), BackendError>> {
        let text = "this bulbfold was built without the feature `gpu`".to_string();
        (wanted == BackendChoice::Gpu).then_some(Err(BackendError::NoAdapter(text)))
    }
}

/// Work on a device that is opened anew where it is lost, up to [`MOST_REBUILDS`] times. The work goes on at what it has done.
#[cfg(feature = "gpu")]
fn with_rebuilds<D, T>(
    device: &mut D,
    observer: &mut dyn Observer,
    rebuild: impl Fn(&mut D) -> Result<(), BackendError>,
    mut work: impl FnMut(&mut D, &mut dyn Observer) -> Result<T, BackendError>,
) -> Result<T, BackendError> {
    for _ in 0..MOST_REBUILDS {
        match work(device, observer) {
            Err(error @ BackendError::DeviceLost(_)) => {
                observer.note(&format!("{error}; it is opened again"));
                // A device that cannot be opened any more is as lost as before.
                rebuild(device).map_err(|_| error)?;
            }
            done => return done,
        }
    }
    work(device, observer)
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use super::*;

    fn lost() -> BackendError {
        BackendError::DeviceLost("for a test".into())
    }

    /// Counts its calls.
    struct Told(usize);

    impl Observer for Told {
        fn note(&mut self, _: &str) {
            self.0 += 1;
        }
    }

    /// The number of the device stands for what it was rebuilt to; work ends well on device `good`.
    fn run(good: u32, error: BackendError) -> (Result<u32, BackendError>, u32, usize) {
        let (mut device, mut told) = (0, Told(0));
        let rebuild = |device: &mut u32| {
            *device += 1;
            Ok(())
        };
        let work =
            |device: &mut u32, _: &mut dyn Observer| if *device == good { Ok(*device) } else { Err(error.clone()) };
        let done = with_rebuilds(&mut device, &mut told, rebuild, work);
        (done, device, told.0)
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
        let done: Result<(), _> = with_rebuilds(&mut 0, &mut (), none, |_, _| Err(lost()));
        assert_eq!(done, Err(lost()));
    }
}
