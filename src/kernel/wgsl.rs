//! WGSL (stand-in until the real writer is merged).

use super::{BackendError, Kernel};
use crate::expr::Arena;

/// Writes a kernel as WGSL.
pub fn write(_arena: &Arena, _kernel: &Kernel) -> String {
    String::new()
}

/// Parses and validates WGSL with naga.
pub fn validate(_text: &str) -> Result<(), BackendError> {
    Ok(())
}
