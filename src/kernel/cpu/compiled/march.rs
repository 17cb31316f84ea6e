//! Marches by machine code: which rays have which lanes.
//!
//! Neighbours take similar ways, and whole vectors of them go in and out at once. So rays start together, as many as there are
//! lanes, until half of these are idle. The rays that are left share lanes then: each that is done makes room for the next.

use super::{Compiled, Element, Frame};
use crate::kernel::Status;
use crate::kernel::cpu::march::{COLUMNS, ENDS, RAY, STATUS, STEPS, start};

impl Compiled {
    /// Marches rays of at most `limit` steps.
    pub(super) fn march<T: Element, const LANES: usize, const K: usize>(
        &self,
        frame: &mut Frame<T, LANES>,
        limit: f64,
        inputs: &[&[T]],
        outputs: &mut [&mut [T]],
    ) {
        let limit = T::from_f64(limit);
        // SAFETY: the processor has the instruction set that the code was made for, and all of these have AVX2.
        unsafe {
            let left = self.march_neighbours::<T, LANES, K>(frame, limit, inputs, outputs);
            self.march_left(frame, limit, Rays::new(inputs, outputs, left));
        }
    }

    /// Starts all rays, and marches neighbours together until half of them are done. Gives the numbers of the rays that are not.
    /// A vector is copied by one instruction, since the code that reads it would wait for parts.
    #[target_feature(enable = "avx2")]
    fn march_neighbours<T: Element, const LANES: usize, const K: usize>(
        &self,
        frame: &mut Frame<T, LANES>,
        limit: T,
        inputs: &[&[T]],
        outputs: &mut [&mut [T]],
    ) -> Vec<u32> {
        let (lanes, len) = (LANES * K, inputs[0].len());
        let enough = lanes / 2 + 1;
        let mut left = Vec::with_capacity(len);
        let [near, far] = ENDS.map(|column| inputs[column]);
        let inputs: Vec<&[[[T; LANES]; K]]> = inputs.iter().map(|column| column.as_chunks().0.as_chunks().0).collect();
        // Loops, not closures: what is called with one is not made for AVX2, and calls it for every number.
        for at in 0..len / lanes {
            let columns = frame.columns::<K>(self.columns.first);
            for (column, input) in columns.iter_mut().zip(&inputs) {
                *column = input[at];
            }
            if start_lanes(columns) >= enough {
                self.call(frame, enough as u32);
            }
            let columns = frame.columns::<K>(self.columns.first);
            for (column, output) in columns[RAY..].iter().zip(&mut *outputs) {
                output.as_chunks_mut().0.as_chunks_mut().0[at] = *column;
            }
            push_running(&mut left, limit, at * lanes, outputs, lanes);
        }
        let rest = len / lanes * lanes;
        let mut states: Vec<&mut [T]> = outputs.iter_mut().map(|column| &mut column[rest..]).collect();
        start([near, far].map(|column| &column[rest..]), &mut states, T::from_f64);
        push_running(&mut left, limit, rest, outputs, len - rest);
        left
    }

    /// Marches rays to their ends.
    #[target_feature(enable = "avx2")]
    fn march_left<T: Element, const LANES: usize>(&self, frame: &mut Frame<T, LANES>, limit: T, mut rays: Rays<T>) {
        let lanes = frame.lanes();
        let mut held: Vec<Option<u32>> = vec![None; lanes];
        let (mut done, mut new) = (Vec::with_capacity(lanes), Vec::with_capacity(lanes));
        let mut busy = 0;
        frame.numbers(self.columns.first)[STATUS * lanes..][..lanes].fill(T::from_f64(Status::Miss.code()));
        // With fewer lanes running than this, finished rays make room for others.
        let enough = (lanes * 4 / 5) as u32;
        loop {
            let numbers = frame.numbers(self.columns.first);
            done.clear();
            new.clear();
            for (lane, held) in held.iter_mut().enumerate() {
                if is_running(limit, numbers[STATUS * lanes + lane], numbers[STEPS * lanes + lane]) {
                    continue;
                }
                if let Some(ray) = *held {
                    done.push((lane, ray as usize));
                }
                *held = rays.waiting.next();
                if let Some(ray) = *held {
                    new.push((lane, ray as usize));
                }
            }
            rays.put(&done, numbers, lanes);
            rays.take(&new, numbers, lanes);
            busy = busy + new.len() - done.len();
            if busy == 0 {
                break;
            }
            self.call(frame, if rays.waiting.len() == 0 { 1 } else { enough });
        }
    }
}

/// Puts the rays of all lanes at their near ends. Gives how many of them have not missed before they start.
#[inline(always)]
fn start_lanes<T: Element, const LANES: usize, const K: usize>(columns: &mut [[[T; LANES]; K]]) -> usize {
    let (ray, state) = columns.split_at_mut(RAY);
    let mut state = state.iter_mut().map(|column| column.as_flattened_mut());
    let mut state: [&mut [T]; COLUMNS - RAY] =
        std::array::from_fn(|_| state.next().expect("a march has these columns"));
    start(ENDS.map(|column| ray[column].as_flattened()), &mut state, T::from_f64);
    state[STATUS - RAY].iter().filter(|&&status| status == T::default()).count()
}

/// Adds the numbers of the rays that are not done, of so many from the first on.
fn push_running<T: Element>(left: &mut Vec<u32>, limit: T, first: usize, outputs: &[&mut [T]], count: usize) {
    let column = |number: usize| &outputs[number - RAY][first..][..count];
    for (i, (status, steps)) in column(STATUS).iter().zip(column(STEPS)).enumerate() {
        if is_running(limit, *status, *steps) {
            left.push((first + i) as u32);
        }
    }
}

fn is_running<T: Element>(limit: T, status: T, steps: T) -> bool {
    status == T::default() && steps < limit
}

/// Rays that go to lanes and come back from there.
struct Rays<'a, T> {
    inputs: [&'a [T]; RAY],
    outputs: [&'a mut [T]; COLUMNS - RAY],
    waiting: std::vec::IntoIter<u32>,
}

impl<'a, T: Element> Rays<'a, T> {
    /// Rays of which those with the numbers `waiting` are not done.
    fn new(inputs: &[&'a [T]], outputs: &'a mut [&mut [T]], waiting: Vec<u32>) -> Rays<'a, T> {
        let mut columns = outputs.iter_mut().map(|column| &mut **column);
        Rays {
            inputs: inputs.try_into().expect("a march has the columns of a ray"),
            outputs: std::array::from_fn(|_| columns.next().expect("a march has these results")),
            waiting: waiting.into_iter(),
        }
    }

    /// Writes down how far rays came, each in its lane; `numbers` are the columns of all lanes.
    fn put(&mut self, places: &[(usize, usize)], numbers: &[T], lanes: usize) {
        for (column, numbers) in self.outputs.iter_mut().zip(numbers[RAY * lanes..].chunks_exact(lanes)) {
            for &(lane, ray) in places {
                column[ray] = numbers[lane];
            }
        }
    }

    /// Puts rays into lanes.
    fn take(&self, places: &[(usize, usize)], numbers: &mut [T], lanes: usize) {
        let columns = self.inputs.iter().copied().chain(self.outputs.iter().map(|column| &**column));
        for (column, numbers) in columns.zip(numbers.chunks_exact_mut(lanes)) {
            for &(lane, ray) in places {
                numbers[lane] = column[ray];
            }
        }
    }
}
