//! Tapes as machine code, for processors with AVX-512 or AVX2: what the interpreter does, without its loads and stores.
//!
//! A kernel becomes one function over a frame of vectors, two in step (each of 16 rays with AVX-512, of 8 with AVX2; half of that in
//! f64), with its loops: temporaries stay in registers, orbits' states too where they fit. Lanes that are done keep their values: by masked moves
//! with AVX-512; with AVX2 all lanes go on, and what each was when it ended is set aside. Results are those of the interpreter to the last bit. [`trace`] says what is computed, [`emit`] in
//! which registers, [`assemble`] and [`active`] in which instructions, of the sets in [`instructions`]. Other processors,
//! and systems that allow no such code, have the interpreter.

mod active;
mod assemble;
mod copies;
mod emit;
mod instructions;
mod kernels;
mod kit;
mod march;
mod segment;
mod trace;

use std::marker::PhantomData;

use self::assemble::{Line, MachineCode};
pub(super) use self::copies::COPIES;
use self::copies::MOST_COPIES;
pub(super) use self::instructions::InstructionSet;
pub(super) use self::kernels::compile;
use crate::kernel::cpu::Precision;

/// A kernel as machine code.
#[derive(Clone)]
pub(super) struct Compiled {
    set: InstructionSet,
    precision: Precision,
    /// Vectors in step.
    copies: usize,
    code: MachineCode,
    /// Vectors of the frame.
    slots: usize,
    columns: Columns,
}

/// Where a kernel's columns lie in the frame: one behind the other, each as many vectors as there are in step.
#[derive(Clone)]
struct Columns {
    /// First vector of the inputs.
    inputs: usize,
    /// The inputs that the code reads.
    read: Vec<usize>,
    /// First vector of the outputs.
    outputs: usize,
    /// Most steps of a ray, where this is a march.
    max_march_steps: Option<f64>,
}

/// The vectors that machine code works on, each of `LANES` numbers.
struct Frame<T, const LANES: usize> {
    lines: Vec<Line>,
    vectors: usize,
    copies: usize,
    numbers: PhantomData<T>,
}

impl<T: Element, const LANES: usize> Frame<T, LANES> {
    fn new(vectors: usize, copies: usize) -> Frame<T, LANES> {
        let lines = vec![Line::default(); (vectors * size_of::<[T; LANES]>()).div_ceil(size_of::<Line>())];
        Frame { lines, vectors, copies, numbers: PhantomData }
    }

    /// Elements in step.
    fn lanes(&self) -> usize {
        LANES * self.copies
    }

    /// All vectors.
    fn vectors(&mut self) -> &mut [[T; LANES]] {
        // SAFETY: the lines are as long as so many vectors, aligned more strictly, and any bits of them are numbers.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.vectors) }
    }

    /// The columns from the vector `first` on. `K` are the vectors in step.
    fn columns<const K: usize>(&mut self, first: usize) -> &mut [[[T; LANES]; K]] {
        assert_eq!(K, self.copies);
        self.vectors()[first..].as_chunks_mut().0
    }

    /// The numbers of these columns: those of the first column in all lanes, then those of the next.
    fn numbers(&mut self, first: usize) -> &mut [T] {
        self.vectors()[first..].as_flattened_mut()
    }

    /// One lane of the column that is number `column` of those from the vector `first` on.
    fn lane(&mut self, first: usize, column: usize, lane: usize) -> &mut T {
        let vector = first + column * self.copies + lane / LANES;
        &mut self.vectors()[vector][lane % LANES]
    }
}

impl Compiled {
    /// The same code with these values of its uniforms.
    pub(super) fn bind(&self, uniforms: &[f64]) -> Compiled {
        let mut bound = self.clone();
        bound.code.bind(uniforms, self.precision);
        bound
    }

    /// Runs the kernel on columns. `T` must be the number that it was compiled for.
    pub(super) fn run<T: Element>(&self, inputs: &[&[T]], outputs: &mut [&mut [T]]) {
        assert_eq!(T::PRECISION, self.precision);
        match self.copies {
            COPIES => self.run_copies::<T, COPIES>(inputs, outputs),
            _ => self.run_copies::<T, MOST_COPIES>(inputs, outputs),
        }
    }

    fn run_copies<T: Element, const K: usize>(&self, inputs: &[&[T]], outputs: &mut [&mut [T]]) {
        match self.set.lanes(self.precision) {
            16 => self.run_frame::<T, 16, K>(inputs, outputs),
            8 => self.run_frame::<T, 8, K>(inputs, outputs),
            _ => self.run_frame::<T, 4, K>(inputs, outputs),
        }
    }

    fn run_frame<T: Element, const LANES: usize, const K: usize>(&self, inputs: &[&[T]], outputs: &mut [&mut [T]]) {
        assert_eq!(size_of::<[T; LANES]>(), self.set.bytes());
        let mut frame = Frame::new(self.slots, self.copies);
        match self.columns.max_march_steps {
            Some(limit) => self.march::<T, LANES, K>(&mut frame, limit, inputs, outputs),
            None => self.map::<T, LANES, K>(&mut frame, inputs, outputs),
        }
    }

    fn call<T, const LANES: usize>(&self, frame: &mut Frame<T, LANES>, wanted: u32) {
        debug_assert_eq!(frame.vectors, self.slots);
        // SAFETY: `Cpu` asks for code of its own level only, and `run_frame` makes the frame as long as it says.
        unsafe { self.code.run(&mut frame.lines, wanted) }
    }

    fn map<T: Element, const LANES: usize, const K: usize>(
        &self,
        frame: &mut Frame<T, LANES>,
        inputs: &[&[T]],
        outputs: &mut [&mut [T]],
    ) {
        let Columns { read, inputs: first_input, outputs: first_output, .. } = &self.columns;
        let len = inputs.first().map_or(0, |column| column.len());
        let whole = len / frame.lanes();
        let columns = read.iter().map(|&i| (first_input + i * K, inputs[i].as_chunks().0.as_chunks().0));
        let columns: Vec<(usize, &[[[T; LANES]; K]])> = columns.collect();
        let results = outputs.iter_mut().enumerate();
        let results = results.map(|(i, column)| (first_output + i * K, column.as_chunks_mut().0.as_chunks_mut().0));
        let mut results: Vec<(usize, &mut [[[T; LANES]; K]])> = results.collect();
        for at in 0..whole {
            let vectors = frame.vectors();
            for (slot, column) in &columns {
                *vectors[*slot..].first_chunk_mut().expect("the frame holds every column") = column[at];
            }
            self.call(frame, 0);
            let vectors = frame.vectors();
            for (slot, column) in &mut results {
                column[at] = *vectors[*slot..].first_chunk().expect("the frame holds every column");
            }
        }
        // What is left, and its last element as often as there is room.
        let at = whole * frame.lanes();
        if at == len {
            return;
        }
        for lane in 0..frame.lanes() {
            read.iter().for_each(|&i| *frame.lane(*first_input, i, lane) = inputs[i][(at + lane).min(len - 1)]);
        }
        self.call(frame, 0);
        for (i, column) in outputs.iter_mut().enumerate() {
            (at..len).for_each(|j| column[j] = *frame.lane(*first_output, i, j - at));
        }
    }
}

/// The number of one lane: of four or eight bytes, of which all patterns are numbers.
pub(super) trait Element: Copy + Default + PartialOrd + Into<f64> {
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
