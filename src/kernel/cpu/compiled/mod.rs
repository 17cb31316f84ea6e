//! Tapes as machine code, for processors with AVX-512: what the interpreter does, without its loads and stores.
//!
//! A kernel becomes one function over a frame of vectors, 16 rays in step (8 in f64), with its loops: rays, orbits' states and
//! temporaries stay in registers, and lanes that are done keep their values by masked moves. Results are those of the
//! interpreter to the last bit. [`trace`] says what is computed, [`emit`] in which registers, [`assemble`] in which
//! bytes. Other processors, and systems that allow no such code, have the interpreter.

mod assemble;
mod emit;
mod kernels;
mod kit;
mod segment;
mod trace;

use self::assemble::MachineCode;
pub(super) use self::kernels::compile;
use crate::kernel::Status;
use crate::kernel::cpu::Precision;
use crate::kernel::cpu::march::{COLUMNS, RAY, STATUS, STEPS, start_of};

/// One vector of the frame.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(super) struct Vector<T, const LANES: usize>([T; LANES]);

/// A kernel as machine code.
#[derive(Clone)]
pub(super) struct Compiled {
    precision: Precision,
    code: MachineCode,
    /// Vectors of the frame.
    slots: usize,
    /// First vector of the inputs; they lie behind each other.
    inputs: u16,
    /// First vector of the outputs.
    outputs: u16,
    /// Most steps of a ray, where this is a march.
    max_march_steps: Option<f64>,
}

impl Compiled {
    /// The same code with these values of its uniforms.
    pub(super) fn bind(&self, uniforms: &[f64]) -> Compiled {
        let mut bound = self.clone();
        bound.code.bind(uniforms, self.precision);
        bound
    }

    /// Runs the kernel on columns. `T` and `LANES` must be those that it was compiled for.
    pub(super) fn run<T: Element, const LANES: usize>(&self, inputs: &[&[T]], outputs: &mut [Vec<T>]) {
        assert_eq!(T::PRECISION, self.precision);
        let mut frame = vec![Vector([T::default(); LANES]); self.slots];
        match self.max_march_steps {
            Some(limit) => self.march(&mut frame, limit, inputs, outputs),
            None => self.map(&mut frame, inputs, outputs),
        }
    }

    fn call<T, const LANES: usize>(&self, frame: &mut [Vector<T, LANES>], wanted: u32) {
        debug_assert_eq!(frame.len(), self.slots);
        // SAFETY: `compile` makes code only at the level `Avx512`, and `run` makes the frame as long as it says.
        unsafe { self.code.run(frame, wanted) }
    }

    fn map<T: Element, const LANES: usize>(
        &self,
        frame: &mut [Vector<T, LANES>],
        inputs: &[&[T]],
        outputs: &mut [Vec<T>],
    ) {
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
    fn march<T: Element, const LANES: usize>(
        &self,
        frame: &mut [Vector<T, LANES>],
        limit: f64,
        inputs: &[&[T]],
        outputs: &mut [Vec<T>],
    ) {
        let mut waiting = 0..inputs[0].len();
        let mut rays = [None; LANES];
        let columns = self.inputs as usize..self.inputs as usize + COLUMNS;
        frame[columns.start + STATUS].0.fill(T::from_f64(Status::Miss.code()));
        // With fewer lanes running than this, finished rays make room for others.
        let enough = (LANES * 13 / 16) as u32;
        loop {
            for (lane, ray) in rays.iter_mut().enumerate() {
                let columns = &mut frame[columns.clone()];
                let value = |column: usize| -> f64 { columns[column].0[lane].into() };
                if value(STATUS) == 0.0 && value(STEPS) < limit {
                    continue;
                }
                if let Some(ray) = ray.take() {
                    for (output, vector) in outputs.iter_mut().zip(&columns[RAY..]) {
                        output[ray] = vector.0[lane];
                    }
                }
                if let Some(next) = waiting.next() {
                    *ray = Some(next);
                    let values = start_of(inputs, next).map(T::from_f64);
                    columns.iter_mut().zip(values).for_each(|(vector, value)| vector.0[lane] = value);
                }
            }
            if rays.iter().all(Option::is_none) {
                break;
            }
            self.call(frame, if waiting.is_empty() { 1 } else { enough });
        }
    }
}

/// The number of one lane.
pub(super) trait Element: Copy + Default + Into<f64> {
    const PRECISION: Precision;
    fn from_f64(x: f64) -> Self;
}

impl Element for f32 {
    const PRECISION: Precision = Precision::F32;
    fn from_f64(x: f64) -> f32 {
        x as f32
    }
}

impl Element for f64 {
    const PRECISION: Precision = Precision::F64;
    fn from_f64(x: f64) -> f64 {
        x
    }
}
