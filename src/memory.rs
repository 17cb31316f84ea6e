//! Bytes that a thread holds, counted where it asks for them.
//!
//! A program that runs scripts of others names [`Counted`] its allocator; scripts then stop where they hold too much. Without it
//! nothing is counted, and only the sizes of their single values are limited.

use std::alloc::{GlobalAlloc, Layout};
use std::cell::Cell;

thread_local! {
    /// Bytes asked for less bytes given back; what another thread gives back is missing here.
    static HELD: Cell<isize> = const { Cell::new(0) };
}

/// Bytes that this thread has asked for and not given back. Differences tell, the number itself may be below 0.
pub fn held() -> isize {
    HELD.with(Cell::get)
}

fn add(bytes: isize) {
    HELD.with(|held| held.set(held.get().wrapping_add(bytes)));
}

/// An allocator that counts for [`held`]. A layout is at most `isize::MAX` bytes long, so no size is cut.
pub struct Counted<A>(pub A);

// SAFETY: every call goes to `A` as it is; counting allocates nothing, since the counter is a constant without a destructor.
unsafe impl<A: GlobalAlloc> GlobalAlloc for Counted<A> {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as isize);
        // SAFETY: the caller keeps the rules of `alloc`.
        unsafe { self.0.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as isize);
        // SAFETY: the caller keeps the rules of `alloc_zeroed`.
        unsafe { self.0.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        add((size as isize).wrapping_sub(layout.size() as isize));
        // SAFETY: the caller keeps the rules of `realloc`.
        unsafe { self.0.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        add(-(layout.size() as isize));
        // SAFETY: the caller keeps the rules of `dealloc`.
        unsafe { self.0.dealloc(old, layout) }
    }
}

/// Stack of a thread that scripts run on, in bytes: values of scripts may lie in each other as deep as their bytes allow, and
/// are compared and dropped by recursion. Only what is used of it takes memory.
const STACK: usize = 512 << 20;

/// Runs something on a thread whose stack holds whatever scripts build; on this one where there is no such thread to be had.
pub fn with_deep_stack<T: Send>(run: impl FnOnce() -> T + Send) -> T {
    let cell = std::sync::Mutex::new(Some(run));
    let call = || cell.lock().ok().and_then(|mut run| run.take()).map(|run| run());
    let done = std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("main".into()).stack_size(STACK).spawn_scoped(scope, call);
        thread.ok().map(|thread| thread.join())
    });
    match done {
        Some(Ok(Some(value))) => value,
        Some(Err(panic)) => std::panic::resume_unwind(panic),
        Some(Ok(None)) | None => call().expect("what has not run yet is still there"),
    }
}

#[cfg(test)]
mod tests {
    use super::with_deep_stack;

    #[test]
    fn deep_recursion_returns() {
        fn deep(n: usize) -> usize {
            let kept = std::hint::black_box([n; 8]);
            if n == 0 { 0 } else { deep(n - 1) + 1 + kept[0] - n }
        }
        assert_eq!(with_deep_stack(|| deep(500_000)), 500_000);
    }
}
