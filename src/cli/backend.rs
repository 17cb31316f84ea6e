//! The back ends of this machine, for the commands that list or compare them.

use bulbfold::engine::{BackendChoice, Backends, Error, Work};
use bulbfold::kernel::BackendError;
use bulbfold::math::Precision;

#[cfg(feature = "gpu")]
use super::driver;
use super::session::talk;

/// Adapters with their text and whether they are in software, and why none of them can be used where a driver fails: tried in
/// another process.
pub fn tried_adapters() -> (Vec<(String, bool)>, Option<BackendError>) {
    #[cfg(feature = "gpu")]
    let found = {
        let tried = driver::try_any();
        (tried.adapters, tried.error)
    };
    #[cfg(not(feature = "gpu"))]
    let found = (Vec::new(), None);
    found
}

/// Whether there is graphics hardware whose driver works, tried in another process.
///
/// Errors: what the driver did wrong.
pub fn try_hardware() -> Result<bool, BackendError> {
    #[cfg(feature = "gpu")]
    let found = {
        let tried = driver::try_hardware();
        let has_hardware = tried.has_hardware();
        tried.error.map_or(Ok(has_hardware), Err)
    };
    #[cfg(not(feature = "gpu"))]
    let found = Ok(false);
    found
}

/// Does work on every back end of the machine, the reference (f64) first; on a GPU where its driver `works`.
pub fn run_everywhere<W: Work>(work: &mut W, works: bool) -> Vec<(String, Result<W::Output, Error>)> {
    let (mut results, backends) = (Vec::new(), Backends::default());
    for precision in [Precision::F64, Precision::F32] {
        match backends.run_on_cpu(precision, work, &mut ()) {
            Ok((name, output)) => results.push((name, Ok(output))),
            Err(error) => results.push((format!("cpu, {}", precision.name()), Err(error))),
        }
    }
    if !works {
        return results;
    }
    match backends.run_on_gpu(BackendChoice::Gpu, work, &mut ()) {
        Some(Ok((name, output))) => results.push((name, Ok(output))),
        Some(Err(BackendError::NoAdapter(text))) => talk(&format!("no GPU was tried: {text}")),
        Some(Err(error)) => results.push(("gpu, f32".into(), Err(error.into()))),
        None => {}
    }
    results
}
