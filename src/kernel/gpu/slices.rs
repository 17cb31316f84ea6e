//! How much work one dispatch gets: chosen by the measured time of those before it, so that no driver takes a dispatch for a
//! hang, a picture on a slow device appears in parts, and a fast device is not kept waiting.
//!
//! Work is counted in estimates: an element's, or one step of a ray. A kernel's first dispatch is as small as any; each may be
//! [`GROWTH`] times as large as the largest so far, as long as the worst price that was measured leaves it within
//! [`TARGET`].

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time that a dispatch should take: short enough for one whose work turns out eight times as dear to end before
/// [`TOO_LONG`].
const TARGET: Duration = Duration::from_millis(12);
/// No dispatch should take more.
const TOO_LONG: Duration = Duration::from_millis(100);
/// A slice that takes more than this gets fewer steps next time; one that takes less than the target gets more.
const LONG: Duration = Duration::from_millis(25);
/// Least work of a dispatch, and of the first: a few workgroups.
const FEWEST: u32 = 256;
/// Most work of a dispatch.
const MOST: f64 = (1 << 26) as f64;
/// How much more work than the largest dispatch so far one may get.
const GROWTH: f64 = 8.0;
/// What is left of a price when the next one is lower: dear parts of a picture come again.
const MEMORY: f64 = 0.95;
/// Most steps of the first slice. Rays that are done wait for the others of their slice, so it stays short; later slices
/// hold only rays that still run.
const LONGEST_FIRST: u32 = 32;

/// What has been learnt about a kernel; kept from call to call.
#[derive(Debug)]
pub(super) struct Slices(Mutex<Learnt>);

#[derive(Clone, Copy, Debug)]
struct Learnt {
    /// March steps of a run's first slice.
    first: u32,
    /// Most work that one dispatch has done.
    largest: f64,
    /// Seconds for a unit of work, where it is dear; 0 before anything is known.
    price: f64,
}

impl Learnt {
    fn allowed(&self) -> f64 {
        let affordable = if self.price > 0.0 { TARGET.as_secs_f64() / self.price } else { 0.0 };
        affordable.min(self.largest * GROWTH).clamp(f64::from(FEWEST), MOST)
    }
}

impl Slices {
    pub(super) fn new() -> Slices {
        Slices(Mutex::new(Learnt { first: 1, largest: 0.0, price: 0.0 }))
    }

    fn learnt(&self) -> MutexGuard<'_, Learnt> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// March steps of a run's first slice.
    pub(super) fn first(&self) -> u32 {
        self.learnt().first
    }

    /// Most elements of a dispatch that does `steps` estimates for each.
    pub(super) fn elements(&self, steps: u32) -> u32 {
        ((self.learnt().allowed() / f64::from(steps)) as u32).max(FEWEST)
    }

    /// Steps for `elements` elements, of at most `wanted`, that fit into one dispatch; 1 where not even one does.
    pub(super) fn steps(&self, elements: u32, wanted: u32) -> u32 {
        ((self.learnt().allowed() / f64::from(elements)) as u32).clamp(1, wanted.max(1))
    }

    /// Learns from the first slice of a march.
    pub(super) fn learn_first(&self, slice: u32, took: Duration) {
        self.learnt().first = adapt(slice, took).min(LONGEST_FIRST);
    }

    /// Learns from a dispatch that made `work` estimates. Those of little work say more about the way to the device than
    /// about the kernel, unless they took long.
    pub(super) fn learn(&self, work: u32, took: Duration) {
        let mut learnt = self.learnt();
        let work = f64::from(work.max(1));
        if work * 4.0 >= learnt.allowed() || took > TARGET {
            learnt.price = (took.as_secs_f64() / work).max(learnt.price * MEMORY);
            learnt.largest = if took > TOO_LONG { work / 2.0 } else { learnt.largest.max(work) };
        }
    }
}

/// The next slice after one of `slice` steps, whose longest dispatch took `took`.
pub(super) fn adapt(slice: u32, took: Duration) -> u32 {
    if took < TARGET {
        slice.saturating_mul(2)
    } else if took > LONG {
        (slice / 2).max(1)
    } else {
        slice
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dispatches estimates on a device that takes `price` seconds for one and as much as 100 more for each dispatch. Gives the
    /// longest dispatch, and how many there were.
    fn simulate(slices: &Slices, elements: u32, price: f64) -> (Duration, usize) {
        let (mut left, mut longest, mut count) = (elements, Duration::ZERO, 0);
        while left > 0 {
            let part = slices.elements(1).min(left);
            let took = Duration::from_secs_f64((f64::from(part) + 100.0) * price);
            slices.learn(part, took);
            (left, longest, count) = (left - part, longest.max(took), count + 1);
        }
        (longest, count)
    }

    #[test]
    fn no_dispatch_is_long_on_fast_and_slow_devices() {
        for price in [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4] {
            let slices = Slices::new();
            let (longest, _) = simulate(&slices, 1 << 17, price);
            assert!(longest < TOO_LONG, "{price}: {longest:?}");
            // A part of the picture where everything is eight times as dear.
            let (longest, _) = simulate(&slices, 1 << 14, price * 8.0);
            assert!(longest <= TOO_LONG || price > 4e-5, "{price}: {longest:?}");
            let (longest, _) = simulate(&slices, 1 << 14, price * 8.0);
            assert!(longest < TOO_LONG || price > 4e-5, "{price}: {longest:?}");
        }
    }

    #[test]
    fn a_fast_device_soon_gets_all_at_once() {
        let slices = Slices::new();
        let (_, count) = simulate(&slices, 1 << 20, 1e-9);
        assert!(count <= 6, "{count}");
        assert_eq!(simulate(&slices, 1 << 20, 1e-9).1, 1);
    }

    #[test]
    fn slices_follow_measured_time() {
        let (short, good, long) = (Duration::from_millis(1), Duration::from_millis(15), Duration::from_millis(70));
        assert_eq!([short, good, long].map(|took| adapt(8, took)), [16, 8, 4]);
        assert_eq!(adapt(1, long), 1);
    }

    #[test]
    fn steps_fill_a_dispatch_and_no_more() {
        let slices = Slices::new();
        assert_eq!(slices.steps(1 << 16, 32), 1);
        for _ in 0..8 {
            slices.learn(slices.elements(1), Duration::from_micros(100));
        }
        assert_eq!(slices.steps(1 << 16, 32), 32);
    }
}
