//! The back ends of this machine, for the commands that list or compare them.

use bulbfold::engine::{BackendChoice, Backends, Error, Work};
use bulbfold::kernel::BackendError;
#[cfg(feature = "gpu")]
use bulbfold::kernel::gpu::{AdapterInfoLine, adapters};

use bulbfold::math::Precision;

use super::session::talk;

/// A line for each adapter: text, and whether it is a software one.
#[cfg(feature = "gpu")]
pub fn adapter_lines() -> Vec<(String, bool)> {
    let line = |a: &AdapterInfoLine| format!("{} ({}, {}, {})", a.name, a.backend, a.device_type, a.driver);
    adapters().iter().map(|a| (line(a), a.is_software)).collect()
}

/// A line for each adapter; none in this build.
#[cfg(not(feature = "gpu"))]
pub fn adapter_lines() -> Vec<(String, bool)> {
    Vec::new()
}

/// Does work on every back end of the machine, the reference (f64) first.
pub fn run_everywhere<W: Work>(work: &mut W) -> Vec<(String, Result<W::Output, Error>)> {
    let (mut results, backends) = (Vec::new(), Backends::default());
    for precision in [Precision::F64, Precision::F32] {
        match backends.run_on_cpu(precision, work, &mut ()) {
            Ok((name, output)) => results.push((name, Ok(output))),
            Err(error) => results.push((format!("cpu, {}", precision.name()), Err(error))),
        }
    }
    match backends.run_on_gpu(BackendChoice::Gpu, work, &mut ()) {
        Some(Ok((name, output))) => results.push((name, Ok(output))),
        Some(Err(BackendError::NoAdapter(text))) => talk(&format!("no GPU was tried: {text}")),
        Some(Err(error)) => results.push(("gpu, f32".into(), Err(error.into()))),
        None => {}
    }
    results
}
