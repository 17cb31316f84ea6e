//! GPU (stand-in until the real back end is merged).

use super::{Backend, BackendError, Kernel};
use crate::expr::Arena;

/// Which adapter to take.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AdapterWanted {
    /// Whatever there is.
    Any,
}

/// A device.
pub struct Gpu;

impl Gpu {
    /// Opens an adapter.
    pub fn new(_wanted: AdapterWanted) -> Result<Gpu, BackendError> {
        Err(BackendError::NoAdapter("this build has only a stand-in".into()))
    }
}

impl Backend for Gpu {
    type Prepared = ();
    type Columns = Vec<Vec<f64>>;

    fn prepare(&self, _: &Arena, _: &Kernel) -> Result<(), BackendError> {
        Err(BackendError::NoAdapter("stand-in".into()))
    }

    fn upload(&self, columns: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, BackendError> {
        Ok(columns.to_vec())
    }

    fn download(&self, columns: &Vec<Vec<f64>>) -> Result<Vec<Vec<f64>>, BackendError> {
        Ok(columns.clone())
    }

    fn run(&self, (): &(), _: &[&Vec<Vec<f64>>]) -> Result<Vec<Vec<f64>>, BackendError> {
        Err(BackendError::NoAdapter("stand-in".into()))
    }
}
