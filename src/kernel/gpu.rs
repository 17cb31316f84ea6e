//! GPU (a stand-in until the real back end is merged).

use super::{Backend, BackendError, Kernel};
use crate::expr::Arena;

/// Which adapters will do.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AdapterWanted {
    /// Only real ones.
    Hardware,
    /// Software ones too.
    Any,
}

/// An adapter, as listings show it.
#[derive(Clone, Debug)]
pub struct AdapterLine {
    /// Name.
    pub name: String,
    /// Graphics API.
    pub backend: String,
    /// Kind of device.
    pub device_type: String,
    /// Driver.
    pub driver: String,
    /// True where the CPU does the work.
    pub is_software: bool,
}

/// The GPU back end.
pub struct Gpu;

impl Gpu {
    /// Opens an adapter.
    pub fn new(_: AdapterWanted) -> Result<Gpu, BackendError> {
        Err(BackendError::NoAdapter("this build has no GPU back end yet".into()))
    }
}

/// All adapters.
pub fn adapters() -> Vec<AdapterLine> {
    Vec::new()
}

impl Backend for Gpu {
    type Prepared = ();
    type Columns = ();

    fn prepare(&self, _: &Arena, _: &Kernel) -> Result<(), BackendError> {
        Ok(())
    }

    fn upload(&self, _: &[Vec<f64>]) -> Result<(), BackendError> {
        Ok(())
    }

    fn download(&self, (): &()) -> Result<Vec<Vec<f64>>, BackendError> {
        Ok(Vec::new())
    }

    fn run(&self, (): &(), _: &[&()]) -> Result<(), BackendError> {
        Ok(())
    }
}
