//! Light developed into whole numbers, on the CPU: for pictures of more than bytes, with alpha, or dithered.

use std::io;

use super::develop::{Develop, compose_encoded};
use crate::expr::Arena;
use crate::kernel::cpu::{Cpu, CpuKernel};
use crate::kernel::{Backend, Kernel};
use crate::math::Precision;

/// Develops light, row by row.
pub(super) struct Developer {
    cpu: Cpu,
    kernel: CpuKernel,
    /// Whether rounding is spread over neighbours.
    dithers: bool,
}

impl Developer {
    /// Compiles what a film does to light.
    pub fn new(develop: Develop, dithers: bool) -> io::Result<Developer> {
        let (arena, cpu) = (Arena::default(), Cpu::new(Precision::F32));
        let kernel = cpu.prepare(&arena, &Kernel::Map(compose_encoded(&arena, develop)));
        Ok(Developer { cpu, kernel: kernel.map_err(io::Error::other)?, dithers })
    }

    /// Three whole numbers from 0 to `most` for each pixel of rows of this width, which begin at row `top`.
    pub fn develop(&self, light: &[f32], most: u16, (width, top): (u32, u32)) -> io::Result<Vec<u16>> {
        let column = |k: usize| light.iter().skip(k).step_by(3).map(|&x| f64::from(x)).collect::<Vec<f64>>();
        let columns = [column(0), column(1), column(2)];
        let run = || {
            let given = self.cpu.upload(&columns)?;
            self.cpu.download(&self.cpu.run(&self.kernel, &[&given])?)
        };
        let encoded = run().map_err(io::Error::other)?;
        let width = width.max(1) as usize;
        let mut numbers = Vec::with_capacity(light.len());
        for i in 0..columns[0].len() {
            let (x, y) = ((i % width) as f64, f64::from(top) + (i / width) as f64);
            for (k, column) in encoded.iter().enumerate() {
                let threshold = if self.dithers { noise(x + CHANNELS_APART * k as f64, y) } else { 0.5 };
                numbers.push((column[i] * f64::from(most) + threshold).floor().clamp(0.0, f64::from(most)) as u16);
            }
        }
        Ok(numbers)
    }
}

/// Columns between the noise of two channels.
const CHANNELS_APART: f64 = 47.0;

/// Numbers from 0 to 1, evenly spread in every small neighbourhood: interleaved gradient noise (J. Jimenez, "Next Generation
/// Post Processing in Call of Duty: Advanced Warfare", 2014).
fn noise(x: f64, y: f64) -> f64 {
    (52.982_918_9 * (0.067_110_56 * x + 0.005_837_15 * y).fract()).fract()
}

#[cfg(test)]
mod tests {
    use super::{Developer, noise};
    use crate::film::Develop;

    #[test]
    fn dithered_bytes_have_the_average_of_what_they_stand_for() {
        let developer = Developer::new(Develop::PLANE, true).unwrap();
        // 100.3 of 255 in sRGB, as linear light.
        let light = ((100.3_f64 / 255.0 + 0.055) / 1.055).powf(2.4) as f32;
        let bytes = developer.develop(&vec![light; 64 * 64 * 3], 255, (64, 7)).unwrap();
        assert!(bytes.iter().all(|&byte| byte == 100 || byte == 101));
        let mean = bytes.iter().map(|&byte| f64::from(byte)).sum::<f64>() / bytes.len() as f64;
        assert!((mean - 100.3).abs() < 0.03, "{mean}");
        assert!(developer.develop(&[0.0, 1.0, f32::NAN], 255, (1, 0)).unwrap() == [0, 255, 0]);
    }

    #[test]
    fn noise_is_evenly_spread() {
        let mut all: Vec<f64> = (0..64 * 64).map(|i| noise(f64::from(i % 64), f64::from(i / 64))).collect();
        all.sort_by(f64::total_cmp);
        let off = |(i, x): (usize, &f64)| (x - (i as f64 + 0.5) / 4096.0).abs();
        assert!(all.iter().enumerate().map(off).fold(0.0, f64::max) < 0.02);
    }
}
