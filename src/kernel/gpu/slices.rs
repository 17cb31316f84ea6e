//! How much work one dispatch gets: adapted to measured time, so that a picture on a slow device still appears in parts
//! that no driver takes for a hang, and a fast device is not kept waiting.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// A dispatch that takes less gets more work next time.
const SHORT: Duration = Duration::from_millis(20);
/// A dispatch that takes more gets less.
const LONG: Duration = Duration::from_millis(50);
/// A dispatch of a single step that takes more gets fewer elements.
const TOO_LONG: Duration = Duration::from_millis(100);
/// Elements that are never cut further: a few workgroups.
const FEWEST: u32 = 256;
/// Most steps of the first slice. Rays that are done wait for the others of their slice, so it stays short; later slices
/// hold only rays that still run.
const LONGEST_FIRST: u32 = 32;

/// What has been learnt about a kernel; kept from call to call.
#[derive(Debug)]
pub(super) struct Slices {
    /// March steps of a run's first dispatch.
    first: AtomicU32,
    /// Most elements of a dispatch.
    elements: AtomicU32,
}

impl Slices {
    pub(super) fn new() -> Slices {
        Slices { first: AtomicU32::new(4), elements: AtomicU32::new(1 << 16) }
    }

    /// March steps of a run's first dispatch.
    pub(super) fn first(&self) -> u32 {
        self.first.load(Ordering::Relaxed)
    }

    /// Most elements of a dispatch.
    pub(super) fn elements(&self) -> u32 {
        self.elements.load(Ordering::Relaxed)
    }

    /// Learns from the first dispatch of a march.
    pub(super) fn learn_first(&self, slice: u32, took: Duration) {
        self.first.store(adapt(slice, took).min(LONGEST_FIRST), Ordering::Relaxed);
    }

    /// Learns how many elements a dispatch may have from one of `elements` that could not be made shorter otherwise, and
    /// took `took`.
    pub(super) fn learn_elements(&self, elements: u32, took: Duration) {
        let now = self.elements();
        if took > TOO_LONG {
            self.elements.store((elements.min(now) / 2).max(FEWEST), Ordering::Relaxed);
        } else if took < SHORT && elements >= now {
            self.elements.store(now.saturating_mul(2).min(1 << 22), Ordering::Relaxed);
        }
    }
}

/// The next slice after one of `slice` steps took `took`.
pub(super) fn adapt(slice: u32, took: Duration) -> u32 {
    if took < SHORT {
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

    #[test]
    fn slices_follow_measured_time() {
        let (short, good, long) = (Duration::from_millis(1), Duration::from_millis(30), Duration::from_millis(70));
        assert_eq!([short, good, long].map(|took| adapt(8, took)), [16, 8, 4]);
        assert_eq!(adapt(1, long), 1);
    }

    #[test]
    fn a_single_step_that_takes_long_gets_fewer_elements() {
        let slices = Slices::new();
        slices.learn_elements(1 << 16, Duration::from_millis(300));
        assert_eq!(slices.elements(), 1 << 15);
        for _ in 0..20 {
            slices.learn_elements(1 << 16, Duration::from_millis(300));
        }
        assert_eq!(slices.elements(), FEWEST);
    }
}
