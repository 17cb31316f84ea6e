//! Tapes as machine code, for processors with AVX-512: what the interpreter does, without its loads and stores.
//!
//! A kernel becomes one function over a frame of vectors, 16 rays in step, with its loops: rays, orbits' states and
//! temporaries stay in registers, and lanes that are done keep their values by masked moves. Results are those of the
//! interpreter to the last bit. [`trace`] says what is computed, [`segment`] in which registers, [`assemble`] in which
//! bytes. Other processors, and systems that allow no such code, have the interpreter.

mod assemble;
mod kernels;
mod kit;
mod segment;
mod trace;

use self::assemble::MachineCode;
pub(super) use self::kernels::compile;
use crate::kernel::Status;
use crate::kernel::cpu::march::{COLUMNS, RAY, STATUS, STEPS, start_of};

/// Rays in step.
const LANES: usize = 16;
/// Running lanes of a march below which its finished rays make room for others.
const ENOUGH: u32 = 13;

/// One vector of the frame.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(super) struct Vector([f32; LANES]);

/// A kernel as machine code.
pub(super) struct Compiled {
    code: MachineCode,
    /// Vectors of the frame.
    slots: usize,
    /// First vector of the inputs; they lie behind each other.
    inputs: u16,
    /// First vector of the outputs.
    outputs: u16,
    /// Most steps of a ray, where this is a march.
    max_march_steps: Option<f32>,
}

impl Compiled {
    /// Runs the kernel on columns.
    pub(super) fn run(&self, inputs: &[&[f32]], outputs: &mut [Vec<f32>]) {
        let mut frame = vec![Vector([0.0; LANES]); self.slots];
        match self.max_march_steps {
            Some(limit) => self.march(&mut frame, limit, inputs, outputs),
            None => self.map(&mut frame, inputs, outputs),
        }
    }

    fn call(&self, frame: &mut [Vector], wanted: u32) {
        debug_assert_eq!(frame.len(), self.slots);
        // SAFETY: `compile` makes code only at the level `Avx512`, and `run` makes the frame as long as it says.
        unsafe { self.code.run(frame, wanted) }
    }

    fn map(&self, frame: &mut [Vector], inputs: &[&[f32]], outputs: &mut [Vec<f32>]) {
        let len = inputs.first().map_or(0, |column| column.len());
        for at in (0..len).step_by(LANES) {
            let count = LANES.min(len - at);
            for (column, vector) in inputs.iter().zip(&mut frame[self.inputs as usize..]) {
                vector.0[..count].copy_from_slice(&column[at..at + count]);
                vector.0[count..].fill(column[at + count - 1]);
            }
            self.call(frame, 0);
            for (column, vector) in outputs.iter_mut().zip(&frame[self.outputs as usize..]) {
                column[at..at + count].copy_from_slice(&vector.0[..count]);
            }
        }
    }

    /// Marches rays; each that is done makes room for the next.
    fn march(&self, frame: &mut [Vector], limit: f32, inputs: &[&[f32]], outputs: &mut [Vec<f32>]) {
        let mut waiting = 0..inputs[0].len();
        let mut rays = [None; LANES];
        let columns = self.inputs as usize..self.inputs as usize + COLUMNS;
        frame[columns.start + STATUS].0.fill(Status::Miss.code() as f32);
        loop {
            for (lane, ray) in rays.iter_mut().enumerate() {
                let columns = &mut frame[columns.clone()];
                let is_done = columns[STATUS].0[lane] != 0.0 || columns[STEPS].0[lane] >= limit;
                if !is_done {
                    continue;
                }
                if let Some(ray) = ray.take() {
                    for (output, vector) in outputs.iter_mut().zip(&columns[RAY..]) {
                        output[ray] = vector.0[lane];
                    }
                }
                if let Some(next) = waiting.next() {
                    *ray = Some(next);
                    let values = start_of(inputs, next).map(|x| x as f32);
                    columns.iter_mut().zip(values).for_each(|(vector, value)| vector.0[lane] = value);
                }
            }
            if rays.iter().all(Option::is_none) {
                break;
            }
            self.call(frame, if waiting.is_empty() { 1 } else { ENOUGH });
        }
    }
}
