//! How much work one dispatch gets: chosen by the measured time of those before it, so that no driver takes a dispatch for a
//! hang, a picture on a slow device appears in parts, and a fast device is not kept waiting.
//!
//! Work is counted in estimates: an element's, or one step of a ray. A kernel's first dispatch is as small as any, and its time
//! is that of the driver's compiler. From the second on each may be [`GROWTH`] times as large as the largest so far, as long as
//! the price that was measured leaves it within [`TARGET`]. Most rays of a slice end before its last step. So a slice may hold
//! [`MARGIN`] times as many steps as would fit if none did, and then still ends before [`TOO_LONG`].

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time that a dispatch should take.
const TARGET: Duration = Duration::from_millis(12);
/// No dispatch should take more.
const TOO_LONG: Duration = Duration::from_millis(100);
/// How much longer than expected a dispatch may take and still end in time.
const MARGIN: f64 = 8.0;
/// Least work of a dispatch: a few workgroups.
const FEWEST: u32 = 256;
/// Products of two numbers that any device takes in a second at least: the assumed throughput before it is measured.
const LEAST_RATE: f64 = 1e9;
/// Most work of a dispatch.
const MOST: f64 = (1 << 26) as f64;
/// How much more work than the largest dispatch so far one may get.
const GROWTH: f64 = 8.0;
/// What is kept of a price when the next one is lower: expensive parts of a picture come again.
const MEMORY: f64 = 0.8;
/// Steps of a slice that most rays end within. Shorter ones cost more in lists than they save in waiting for the longest
/// rays.
const STEPS: f64 = 64.0;
/// Elements that a device takes at the same time: it is not cut into parts of fewer to get longer slices.
const PARALLEL: f64 = 4096.0;

/// Steps that rays of a picture do not go on average: a march that cannot be stopped is assumed to take so many.
const ASKED: u32 = 512;

/// What has been learnt about a kernel; kept from call to call.
#[derive(Debug)]
pub(super) struct Slices {
    /// Work of the first dispatch.
    first: f64,
    learnt: Mutex<Learnt>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Learnt {
    /// Whether it has run: many drivers make its machine code only then.
    has_run: bool,
    /// Most work that one dispatch has done.
    largest: f64,
    /// Seconds for a unit of work where it is expensive; 0 before anything is known.
    price: f64,
    /// Seconds that one step of a ray takes at most, however few rays there are; 0 before anything is known.
    step: f64,
}

/// A part of a march: how many rays a dispatch takes, and how many steps each goes at most.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Slice {
    pub(super) rays: u32,
    pub(super) steps: u32,
}

impl Learnt {
    /// Work that takes the target time.
    fn allowed(&self, first: f64) -> f64 {
        if self.price > 0.0 {
            let affordable = TARGET.as_secs_f64() / self.price;
            return affordable.min(self.largest * GROWTH).clamp(f64::from(FEWEST), MOST);
        }
        first
    }
}

impl Slices {
    /// Nothing is known but how many products of numbers an estimate takes at most: of the first dispatch any device makes
    /// so many that they take it the target time, and elements that need no loop it makes all at once.
    pub(super) fn new(products: f64, is_straight: bool) -> Slices {
        let time = if is_straight { 2 * TOO_LONG } else { TARGET };
        let first = LEAST_RATE * time.as_secs_f64() / products.max(1.0);
        Slices { first: first.clamp(f64::from(FEWEST), MOST), learnt: Mutex::default() }
    }

    fn learnt(&self) -> MutexGuard<'_, Learnt> {
        self.learnt.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes as known how many seconds an estimate takes, and a step of a ray.
    #[cfg(test)]
    pub(super) fn know(&self, price: f64, step: f64) {
        *self.learnt() = Learnt { has_run: true, largest: MOST, price, step };
    }

    /// Most elements of a dispatch that makes one estimate for each.
    pub(super) fn elements(&self) -> u32 {
        self.learnt().allowed(self.first) as u32
    }

    /// Steps that a march of so many rays, each of up to `most` steps, may go without being watched: it ends in time whatever
    /// the rays are. `None` if that is not sure.
    pub(super) fn unwatched(&self, rays: u32, most: u32) -> Option<u32> {
        let learnt = self.learnt();
        let in_time = TOO_LONG.as_secs_f64();
        let all = learnt.price * f64::from(rays) * f64::from(most.min(ASKED));
        let steps = if learnt.step > 0.0 { (in_time / 2.0 / learnt.step) as u32 } else { most };
        (learnt.price > 0.0 && all <= in_time && steps >= most.min(ASKED)).then_some(steps.min(most))
    }

    /// The next slice of a march in which up to `running` rays have up to `left` steps to go.
    pub(super) fn slice(&self, running: u32, left: u32) -> Slice {
        let learnt = *self.learnt();
        let most = learnt.allowed(self.first) * MARGIN;
        let wanted = (most / f64::from(running)).max(STEPS).min(most / f64::from(running).min(PARALLEL));
        let in_time = if learnt.step > 0.0 { (TOO_LONG / 2).as_secs_f64() / learnt.step } else { wanted };
        let steps = wanted.min(in_time).clamp(1.0, f64::from(left));
        Slice { rays: ((most / steps) as u32).clamp(FEWEST, running.max(FEWEST)), steps: steps as u32 }
    }

    /// Learns from a slice that made `work` estimates; of its rays some went all steps where `goes_on`.
    pub(super) fn learn_slice(&self, slice: Slice, work: u32, goes_on: bool, took: Duration) {
        {
            let mut learnt = self.learnt();
            if learnt.has_run && goes_on {
                // Many rays tell more than the time of one step; the fewest tell most.
                let step = took.as_secs_f64() / f64::from(slice.steps);
                let known = if learnt.step > 0.0 { learnt.step / MEMORY } else { step };
                learnt.step = step.min(known);
            }
        }
        self.learn(work, took);
    }

    /// Learns from a dispatch that made `work` estimates. Those of little work say more about the way to the device and the
    /// last few rays than about the kernel, unless they took too long.
    pub(super) fn learn(&self, work: u32, took: Duration) {
        let mut learnt = self.learnt();
        if !std::mem::replace(&mut learnt.has_run, true) {
            return;
        }
        let work = f64::from(work.max(1));
        if work * 4.0 >= learnt.allowed(self.first) || took > TOO_LONG {
            // The largest says most: the way to the device has the smallest part in it.
            let remembered = if work > learnt.largest { 0.0 } else { learnt.price * MEMORY };
            learnt.price = (took.as_secs_f64() / work).max(remembered);
            learnt.largest = if took > TOO_LONG { work / 2.0 } else { learnt.largest.max(work) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A kernel so expensive that its first dispatch is as small as any.
    fn unknown() -> Slices {
        Slices::new(1e9, false)
    }

    /// Dispatches estimates on a device that takes `price` seconds for one and as much as 100 more for each dispatch. Gives the
    /// longest dispatch, and how many there were.
    fn simulate(slices: &Slices, elements: u32, price: f64) -> (Duration, usize) {
        let (mut left, mut longest, mut count) = (elements, Duration::ZERO, 0);
        while left > 0 {
            let part = slices.elements().min(left);
            let took = Duration::from_secs_f64((f64::from(part) + 100.0) * price);
            slices.learn(part, took);
            (left, longest, count) = (left - part, longest.max(took), count + 1);
        }
        (longest, count)
    }

    #[test]
    fn no_dispatch_is_long_on_fast_and_slow_devices() {
        for price in [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4] {
            let slices = unknown();
            let (longest, _) = simulate(&slices, 1 << 17, price);
            assert!(longest < TOO_LONG, "{price}: {longest:?}");
            // A part of the picture where everything is eight times as expensive; 256 elements are never cut.
            let (longest, _) = simulate(&slices, 1 << 14, price * 8.0);
            assert!(longest <= TOO_LONG || price > 4e-5, "{price}: {longest:?}");
        }
    }

    #[test]
    fn a_fast_device_soon_gets_all_at_once() {
        let slices = unknown();
        let (_, count) = simulate(&slices, 1 << 20, 1e-9);
        assert!(count <= 6, "{count}");
        assert_eq!(simulate(&slices, 1 << 20, 1e-9).1, 1);
    }

    #[test]
    fn the_way_to_the_device_is_no_price_of_the_kernel() {
        let slices = unknown();
        for _ in 0..8 {
            slices.learn(slices.elements(), Duration::from_millis(1));
        }
        assert!(slices.elements() > 1 << 22, "{}", slices.elements());
    }

    /// The driver's compiler takes a hundred times as long as the first dispatch itself, and says nothing of the others.
    #[test]
    fn the_compiler_is_no_price_of_the_kernel() {
        let slices = unknown();
        slices.learn(slices.elements(), Duration::from_millis(90));
        assert_eq!(slices.elements(), FEWEST);
        let (_, count) = simulate(&slices, 1 << 16, 1e-8);
        assert!(count <= 4, "{count}");
    }

    #[test]
    fn only_what_ends_in_time_goes_without_being_watched() {
        let slices = unknown();
        assert_eq!(slices.unwatched(1 << 16, 1000), None);
        // 512 estimates for each of 65536 rays, in 67 ms.
        slices.know(2e-9, 0.0);
        assert_eq!(slices.unwatched(1 << 16, 1000), Some(1000));
        assert_eq!(slices.unwatched(1 << 16, 1), Some(1), "a march of one step is short too");
        assert_eq!(slices.unwatched(1 << 17, 1000), None);
        // One ray of 1000 steps in 40 ms, one of 20000 in 800.
        slices.know(2e-9, 4e-5);
        assert_eq!(slices.unwatched(1 << 16, 1000), Some(1000));
        assert_eq!(slices.unwatched(1 << 16, 20_000), Some(1250));
        slices.know(2e-9, 1e-4);
        assert_eq!(slices.unwatched(1 << 16, 1000), None);
    }

    #[test]
    fn slices_go_on_for_as_long_as_most_rays_and_end_in_time() {
        let slices = unknown();
        // At first nothing is known: as little work, however many rays there are.
        assert_eq!(slices.slice(1 << 16, 1000), Slice { rays: 2048, steps: 1 });
        assert_eq!(slices.slice(64, 1000), Slice { rays: 256, steps: 32 });
        // A million estimates in the target time: eight million, if all rays go to the end, still in less than 100 ms.
        simulate(&slices, 1 << 24, 12e-9);
        let Slice { rays, steps } = slices.slice(1 << 16, 1000);
        assert!(rays > 60_000 && (110..=130).contains(&steps), "{rays} x {steps}");
        // Few rays may go to their end.
        assert_eq!(slices.slice(300, 800), Slice { rays: 300, steps: 800 });
        // So may many, in parts.
        assert!(slices.slice(1 << 22, 1000).steps >= STEPS as u32);
    }

    /// A step is never shorter than what one ray takes for it; how long that is the fewest rays tell.
    #[test]
    fn a_few_slow_rays_end_in_time() {
        let slices = unknown();
        simulate(&slices, 1 << 24, 12e-9);
        let slice = |rays, steps| Slice { rays, steps };
        slices.learn_slice(slice(300, 10), 3000, true, Duration::from_millis(10));
        assert_eq!(slices.slice(300, 800).steps, 50);
        // Many rays take longer without a step of one taking longer.
        slices.learn_slice(slice(1 << 16, 10), 1 << 19, true, Duration::from_millis(20));
        assert_eq!(slices.slice(300, 800).steps, 40);
        slices.learn_slice(slice(2, 10), 20, true, Duration::from_micros(100));
        assert_eq!(slices.slice(300, 800).steps, 800);
        // Where all rays ended before the last step nothing is known of it.
        slices.learn_slice(slice(2, 800), 20, false, Duration::from_millis(90));
        assert_eq!(slices.slice(300, 800).steps, 800);
    }

    /// A march of 300000 rays that end after some 20 steps is learnt in a few dispatches, the first time too.
    #[test]
    fn a_march_takes_few_dispatches() {
        for first_time in [true, false] {
            let slices = unknown();
            let price = 12e-9;
            if !first_time {
                simulate(&slices, 1 << 24, price);
            }
            let (mut left, mut count) = (300_000, 0);
            while left > 0 {
                let slice = slices.slice(left, 1000);
                let work = slice.rays.min(left) * slice.steps.min(20);
                let compiler = if count == 0 && first_time { 0.09 } else { 0.0 };
                let took = Duration::from_secs_f64((f64::from(work) + 100.0) * price + compiler);
                assert!(took < TOO_LONG);
                slices.learn_slice(slice, work, slice.steps < 20, took);
                (left, count) = (left - slice.rays.min(left), count + 1);
            }
            assert!(count <= if first_time { 8 } else { 3 }, "{count}");
        }
    }
}
