//! What an input takes: bytes that are held at a time, and processor time.

use std::alloc::{GlobalAlloc, Layout};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes that are held by all threads now.
static HELD: AtomicUsize = AtomicUsize::new(0);
/// Most bytes that were held since the last call of [`start`].
static MOST: AtomicUsize = AtomicUsize::new(0);

/// An allocator that counts the bytes of the whole process.
pub struct Metered<A>(pub A);

fn add(bytes: usize) {
    let held = HELD.fetch_add(bytes, Ordering::Relaxed).wrapping_add(bytes);
    // A count that other threads give back meanwhile may lie below zero for a moment.
    if held < isize::MAX as usize {
        MOST.fetch_max(held, Ordering::Relaxed);
    }
}

// SAFETY: every call goes to `A` as it is; counting allocates nothing.
unsafe impl<A: GlobalAlloc> GlobalAlloc for Metered<A> {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: the caller keeps the rules of `alloc`.
        unsafe { self.0.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: the caller keeps the rules of `alloc_zeroed`.
        unsafe { self.0.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        add(size);
        // SAFETY: the caller keeps the rules of `realloc`.
        unsafe { self.0.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the rules of `dealloc`.
        unsafe { self.0.dealloc(old, layout) }
    }
}

/// Begins to measure an input.
pub fn start() {
    MOST.store(HELD.load(Ordering::Relaxed), Ordering::Relaxed);
}

/// Most bytes that were held since [`start`].
pub fn most_bytes() -> usize {
    MOST.load(Ordering::Relaxed)
}

/// Seconds of processor time that this process has taken; with `of_children` those that have ended.
pub fn processor_seconds(of_children: bool) -> f64 {
    #[cfg(unix)]
    {
        let mut used = std::mem::MaybeUninit::<libc::rusage>::uninit();
        let who = if of_children { libc::RUSAGE_CHILDREN } else { libc::RUSAGE_SELF };
        // SAFETY: the pointer is to room for a whole `rusage`, which the system fills where it returns 0.
        if unsafe { libc::getrusage(who, used.as_mut_ptr()) } == 0 {
            // SAFETY: see above.
            let used = unsafe { used.assume_init() };
            let seconds = |time: libc::timeval| time.tv_sec as f64 + time.tv_usec as f64 * 1e-6;
            return seconds(used.ru_utime) + seconds(used.ru_stime);
        }
    }
    let _ = of_children;
    0.0
}
