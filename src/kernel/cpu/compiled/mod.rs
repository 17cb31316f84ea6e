//! Tapes as machine code, for processors with AVX-512 or AVX2: what the interpreter does, without its loads and stores.
//!
//! A kernel becomes one function with its loops over a frame of vectors, two or three in step (each of 16 rays with AVX-512, of 8
//! with AVX2; half of that in f64), and over the columns where they lie ([`blocks`]): temporaries stay in registers, orbits' states
//! too where they fit. Lanes that are done keep their values: by masked moves with AVX-512, by a choice of old or new with AVX2.
//! Results are those of the interpreter to the last bit. [`trace`] says what is computed, [`emit`] in which registers, [`assemble`]
//! and [`active`] in which instructions, of the sets in [`instructions`]. Other processors, and systems that allow no such code,
//! have the interpreter.

mod active;
mod assemble;
mod blocks;
mod copies;
mod emit;
mod instructions;
mod kernels;
mod kit;
mod march;
mod masks;
mod segment;
mod trace;

use std::marker::PhantomData;
use std::sync::OnceLock;

use memmap2::MmapMut;

use self::assemble::{Line, MachineCode};
use self::copies::{COPIES, MORE_COPIES};
pub(super) use self::instructions::InstructionSet;
pub(super) use self::kernels::compile;
use crate::math::Precision;

/// Whether the system lets the process make code of its own, which service managers and sandboxes may refuse. Tried once.
pub(super) fn is_allowed() -> bool {
    static ALLOWED: OnceLock<bool> = OnceLock::new();
    *ALLOWED.get_or_init(|| MmapMut::map_anon(1).and_then(MmapMut::make_exec).is_ok())
}

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
    columns: ColumnPlaces,
}

/// Where a kernel finds its columns.
#[derive(Clone)]
struct ColumnPlaces {
    /// Of a march: the first vector of its columns, which lie one behind the other, each as many vectors as there are in step.
    /// Of other kernels: the first vector with the addresses of inputs and outputs.
    first: usize,
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

    /// Writes addresses behind each other from the vector `first` on.
    fn set_addresses(&mut self, first: usize, addresses: impl Iterator<Item = usize>) {
        let room = &mut self.vectors()[first..];
        // SAFETY: these vectors' memory, aligned more strictly than addresses, of which any bits are numbers.
        let room = unsafe {
            std::slice::from_raw_parts_mut(room.as_mut_ptr().cast::<u64>(), size_of_val(room) / size_of::<u64>())
        };
        room.iter_mut().zip(addresses).for_each(|(place, address)| *place = address as u64);
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
        match self.set.lanes(self.precision) {
            16 => self.run_frame::<T, 16>(inputs, outputs),
            8 => self.run_frame::<T, 8>(inputs, outputs),
            _ => self.run_frame::<T, 4>(inputs, outputs),
        }
    }

    fn run_frame<T: Element, const LANES: usize>(&self, inputs: &[&[T]], outputs: &mut [&mut [T]]) {
        assert_eq!(size_of::<[T; LANES]>(), self.set.bytes());
        let mut frame = Frame::new(self.slots, self.copies);
        match self.columns.max_march_steps {
            Some(limit) if self.copies == MORE_COPIES => {
                self.march::<T, LANES, MORE_COPIES>(&mut frame, limit, inputs, outputs);
            }
            Some(limit) => self.march::<T, LANES, COPIES>(&mut frame, limit, inputs, outputs),
            None => self.map::<T, LANES>(&mut frame, inputs, outputs),
        }
    }

    fn call<T, const LANES: usize>(&self, frame: &mut Frame<T, LANES>, wanted: u32) {
        debug_assert_eq!(frame.vectors, self.slots);
        // SAFETY: `Cpu` asks for code of its own level only, and `run_frame` makes the frame as long as it says.
        unsafe { self.code.run(&mut frame.lines, wanted) }
    }

    /// Runs over columns block by block.
    fn map<T: Element, const LANES: usize>(
        &self,
        frame: &mut Frame<T, LANES>,
        inputs: &[&[T]],
        outputs: &mut [&mut [T]],
    ) {
        let len = inputs.first().map_or(0, |column| column.len());
        let lanes = frame.lanes();
        let rest = len % lanes;
        if rest < len {
            self.blocks(frame, len / lanes, inputs, outputs);
        }
        if rest > 0 {
            // What is left, and its last element as often as there is room.
            let padded = |column: &&[T]| (len - rest..len - rest + lanes).map(|i| column[i.min(len - 1)]).collect();
            let inputs: Vec<Vec<T>> = inputs.iter().map(padded).collect();
            let inputs: Vec<&[T]> = inputs.iter().map(Vec::as_slice).collect();
            let mut results = vec![vec![T::default(); lanes]; outputs.len()];
            let mut columns: Vec<&mut [T]> = results.iter_mut().map(Vec::as_mut_slice).collect();
            self.blocks(frame, 1, &inputs, &mut columns);
            for (output, result) in outputs.iter_mut().zip(&results) {
                output[len - rest..].copy_from_slice(&result[..rest]);
            }
        }
    }

    /// Runs over the first blocks of columns.
    fn blocks<T: Element, const LANES: usize>(
        &self,
        frame: &mut Frame<T, LANES>,
        count: usize,
        inputs: &[&[T]],
        outputs: &mut [&mut [T]],
    ) {
        let lens = inputs.iter().map(|column| column.len()).chain(outputs.iter().map(|column| column.len()));
        assert!(lens.min() >= Some(count * frame.lanes()), "columns must have the blocks that are asked for");
        let inputs = inputs.iter().map(|column| column.as_ptr().expose_provenance());
        let outputs = outputs.iter_mut().map(|column| column.as_mut_ptr().expose_provenance());
        frame.set_addresses(self.columns.first, inputs.chain(outputs));
        self.call(frame, count as u32);
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
