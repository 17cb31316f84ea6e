//! Columns of numbers in memory.

use std::cell::RefCell;
use std::thread::LocalKey;

/// Columns in memory, in the precision that the back end computes in.
#[derive(Clone, Debug)]
pub enum CpuColumns {
    /// Single precision.
    F32(Columns<f32>),
    /// Double precision.
    F64(Columns<f64>),
}

/// Columns of one length, one behind the other; the memory may be longer.
#[derive(Clone, Debug)]
pub struct Columns<T: Number> {
    numbers: Vec<T>,
    count: usize,
    len: usize,
}

/// Numbers of columns.
pub trait Number: Copy + Default + Send + 'static {
    /// Memory of columns that this thread no longer needs. It is in the cache, and no page of it is new.
    fn spare() -> &'static LocalKey<RefCell<Vec<Vec<Self>>>>;
}

/// Memories that a thread keeps: as many as the kernels of a tile need at the same time.
const MOST_SPARE: usize = 8;
/// Numbers that a memory has room for at least: the columns of most kernels of a tile, so that it need not be moved to grow.
const LEAST_NUMBERS: usize = 1 << 16;
/// Most numbers of a memory that is kept.
const MOST_NUMBERS: usize = 1 << 18;

thread_local! {
    static SPARE_F32: RefCell<Vec<Vec<f32>>> = const { RefCell::new(Vec::new()) };
    static SPARE_F64: RefCell<Vec<Vec<f64>>> = const { RefCell::new(Vec::new()) };
}

impl Number for f32 {
    fn spare() -> &'static LocalKey<RefCell<Vec<Vec<f32>>>> {
        &SPARE_F32
    }
}

impl Number for f64 {
    fn spare() -> &'static LocalKey<RefCell<Vec<Vec<f64>>>> {
        &SPARE_F64
    }
}

impl<T: Number> Drop for Columns<T> {
    fn drop(&mut self) {
        let numbers = std::mem::take(&mut self.numbers);
        // A thread that ends has no spare memory any more.
        let _ = T::spare().try_with(|spare| {
            let mut spare = spare.borrow_mut();
            if spare.len() < MOST_SPARE && numbers.capacity() <= MOST_NUMBERS {
                spare.push(numbers);
            }
        });
    }
}

impl<T: Number> Columns<T> {
    /// Columns for results: they hold any numbers.
    pub(super) fn new(count: usize, len: usize) -> Columns<T> {
        let mut numbers = T::spare().with(|spare| spare.borrow_mut().pop()).unwrap_or_default();
        // Memory that was longer stays so, that nothing is ever filled twice.
        let needed = count * Columns::<T>::stride(len);
        if numbers.capacity() < needed {
            numbers = Vec::with_capacity(needed.max(LEAST_NUMBERS));
        }
        if numbers.len() < needed {
            numbers.resize(needed, T::default());
        }
        Columns { numbers, count, len }
    }

    pub(super) fn from_f64(columns: &[impl AsRef<[f64]>], convert: impl Fn(f64) -> T) -> Columns<T> {
        let mut made = Columns::new(columns.len(), columns.first().map_or(0, |column| column.as_ref().len()));
        for (to, from) in made.each_mut().zip(columns) {
            to.iter_mut().zip(from.as_ref()).for_each(|(to, &from)| *to = convert(from));
        }
        made
    }

    /// Numbers from the start of a column to that of the next: whole lines of the cache, and one more, since elements of
    /// columns that lie a power of two apart would all take the same few places in it.
    fn stride(len: usize) -> usize {
        let line = 64 / size_of::<T>();
        (len.div_ceil(line) + 1) * line
    }

    fn column(&self, number: usize) -> &[T] {
        &self.numbers[number * Columns::<T>::stride(self.len)..][..self.len]
    }

    fn each(&self) -> impl Iterator<Item = &[T]> {
        (0..self.count).map(|number| self.column(number))
    }

    pub(super) fn each_mut(&mut self) -> impl Iterator<Item = &mut [T]> {
        let len = self.len;
        let columns = self.numbers.chunks_exact_mut(Columns::<T>::stride(len));
        columns.take(self.count).map(move |column| &mut column[..len])
    }
}

impl CpuColumns {
    pub(super) fn count(&self) -> usize {
        match self {
            CpuColumns::F32(columns) => columns.count,
            CpuColumns::F64(columns) => columns.count,
        }
    }

    pub(super) fn f32s(&self) -> Vec<&[f32]> {
        match self {
            CpuColumns::F32(columns) => columns.each().collect(),
            CpuColumns::F64(_) => Vec::new(),
        }
    }

    pub(super) fn f64s(&self) -> Vec<&[f64]> {
        match self {
            CpuColumns::F64(columns) => columns.each().collect(),
            CpuColumns::F32(_) => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::{Columns, LEAST_NUMBERS, MOST_NUMBERS, MOST_SPARE, Number};
    use crate::kernel::Backend;
    use crate::kernel::cpu::{Cpu, CpuColumns};
    use crate::kernel::wgsl::tests::pipeline;
    use crate::math::Precision;
    use crate::render::{RenderSettings, Role};

    /// Where the numbers of columns lie.
    fn place(columns: &CpuColumns) -> usize {
        match columns {
            CpuColumns::F32(columns) => columns.numbers.as_ptr().addr(),
            CpuColumns::F64(columns) => columns.numbers.as_ptr().addr(),
        }
    }

    /// Memory that lies where what was given back would be given out again.
    fn in_the_way<T: Number>() -> Vec<Vec<T>> {
        (0..4 * MOST_SPARE).map(|_| Vec::with_capacity(LEAST_NUMBERS)).collect()
    }

    #[test]
    fn the_next_tile_lies_where_the_first_lay() {
        let (arena, pipeline) = pipeline("mandelbulb", &RenderSettings::default());
        for precision in [Precision::F32, Precision::F64] {
            let cpu = Cpu::new(precision);
            let [camera, march] = [Role::Camera, Role::March]
                .map(|role| pipeline.kernel(role))
                .map(|kernel| cpu.prepare(&arena, kernel).expect("the CPU takes any kernel"));
            // Pixels, rays and their ends, all of them there at the same time; the second tile is smaller.
            let tile = |pixels: usize| {
                let pixels: Vec<f64> = (0..pixels).map(|i| i as f64 + 0.5).collect();
                let pixels = cpu.upload(&[pixels.clone(), pixels]).expect("the CPU has memory");
                let rays = cpu.run(&camera, &[&pixels]).expect("it runs");
                let ends = cpu.run(&march, &[&rays]).expect("it runs");
                BTreeSet::from([&pixels, &rays, &ends].map(place))
            };
            let first = tile(100);
            assert_eq!(first.len(), 3);
            let _taken = (in_the_way::<f32>(), in_the_way::<f64>());
            assert_eq!(tile(60), first, "{precision:?}");
        }
    }

    #[test]
    fn a_thread_keeps_little() {
        let spare = || f64::spare().with(|spare| spare.borrow().iter().map(Vec::capacity).collect::<Vec<_>>());
        assert_eq!(spare(), [0; 0], "a thread begins with none");
        drop(Columns::<f64>::new(1, MOST_NUMBERS + 1));
        assert_eq!(spare(), [0; 0], "large memory is given back");
        let many: Vec<Columns<f64>> = (0..2 * MOST_SPARE).map(|_| Columns::new(1, 10)).collect();
        drop(many);
        assert_eq!(spare(), [LEAST_NUMBERS; MOST_SPARE]);
    }
}
