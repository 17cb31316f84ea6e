//! Bytes of light that was computed before, on the CPU: of all samples together, whatever computed them.

use super::pixels::bytes;
use crate::expr::Arena;
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::{Backend, BackendError, Kernel};
use crate::math::Precision;

/// Makes bytes of light.
pub struct Developed {
    cpu: Cpu,
    kernel: CpuKernel,
}

impl Developed {
    /// Makes a pipeline's kernel of bytes ready, that of [`Role::Encode`](super::Role::Encode).
    ///
    /// Errors: it cannot be compiled.
    pub fn new(arena: &Arena, kernel: &Kernel, precision: Precision) -> Result<Developed, BackendError> {
        let cpu = Cpu::new(precision);
        Ok(Developed { kernel: cpu.prepare(arena, kernel)?, cpu })
    }

    /// Three bytes of each pixel's linear red, green and blue.
    pub fn bytes(&self, light: &[[f32; 3]]) -> Result<Vec<u8>, BackendError> {
        let columns: Vec<Vec<f64>> = (0..3).map(|k| light.iter().map(|rgb| f64::from(rgb[k])).collect()).collect();
        let srgb = self.cpu.download(&self.cpu.run(&self.kernel, &[&self.cpu.upload(&columns)?])?)?;
        Ok(srgb[0].iter().flat_map(|&srgb| bytes(srgb)).collect())
    }
}
