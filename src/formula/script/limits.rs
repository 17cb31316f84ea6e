//! How long a script may run and how much it may hold. Operations are counted by the engine, and say the same everywhere; bytes
//! where the program's allocator counts them; and the clock only ends what the others let pass, such as many long sorts.

use std::cell::Cell;
use std::time::{Duration, Instant};

use rhai::{Dynamic, Engine};

/// Bytes that the values of a script may take together.
const MAX_BYTES: isize = 64 << 20;
/// The time after which a script is refused: the processor's, so that no busy machine ends a script. All its operations take half
/// a second as a rule.
const MOST_TIME: Duration = Duration::from_secs(6);
/// A step is traced some dozens of times. Traces that take longer than this add up, and all of them together may take
/// [`MOST_TIME`]; what formulas need is a tenth of it.
const LONG: Duration = Duration::from_millis(100);
/// Operations between two looks at the clock: each can take some milliseconds.
const LOOK: u64 = 32;

/// What a run has used.
#[derive(Default)]
struct Meter {
    began: Cell<Option<Instant>>,
    held: Cell<isize>,
    /// Processor time of the thread.
    used: Cell<Duration>,
    /// What long traces have taken.
    long: Cell<Duration>,
}

/// Processor time that this thread has taken since it began, where the system is known to tell it; else the clock's.
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
fn thread_time(_: Instant) -> Duration {
    #[repr(C)]
    struct Time {
        seconds: i64,
        nanoseconds: i64,
    }
    unsafe extern "C" {
        fn clock_gettime(clock: i32, time: *mut Time) -> i32;
    }
    /// `CLOCK_THREAD_CPUTIME_ID` of Linux.
    const THREAD: i32 = 3;
    let mut time = Time { seconds: 0, nanoseconds: 0 };
    // SAFETY: the system writes two whole numbers of 64 bits, which is what there is room for.
    let failed = unsafe { clock_gettime(THREAD, &raw mut time) } != 0;
    if failed { Duration::ZERO } else { Duration::new(time.seconds as u64, time.nanoseconds as u32) }
}

/// Processor time that this thread has taken since it began, where the system is known to tell it; else the clock's.
#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
fn thread_time(began: Instant) -> Duration {
    began.elapsed()
}

thread_local! {
    /// Of this thread's run: a thread runs one script at a time.
    static METER: Meter = Meter::default();
}

/// Makes an engine ask the meter of its thread at every operation.
pub(super) fn limit(engine: &mut Engine) {
    engine.on_progress(|operations| METER.with(|meter| meter.exceeded(operations)).map(Dynamic::from));
}

/// Traces of another formula follow on this thread: what long ones took so far no longer counts.
pub(super) fn begin() {
    METER.with(|meter| meter.long.set(Duration::ZERO));
}

/// A script starts on this thread.
pub(super) fn start() {
    METER.with(Meter::start);
}

/// A trace ends on this thread.
pub(super) fn finish() {
    METER.with(Meter::finish);
}

impl Meter {
    fn start(&self) {
        let now = Instant::now();
        self.began.set(Some(now));
        self.used.set(thread_time(now));
        self.held.set(crate::memory::held());
    }

    fn finish(&self) {
        let took = self.began.get().map_or(Duration::ZERO, |began| thread_time(began).saturating_sub(self.used.get()));
        if took > LONG {
            self.long.set(self.long.get() + took);
        }
    }

    fn exceeded(&self, operations: u64) -> Option<String> {
        if crate::memory::held().wrapping_sub(self.held.get()) > MAX_BYTES {
            return Some(format!("the values of the script take more than {} MiB", MAX_BYTES >> 20));
        }
        let left = MOST_TIME.saturating_sub(self.long.get());
        let began = self.began.get().filter(|began| operations.is_multiple_of(LOOK) && began.elapsed() > left)?;
        let is_late = thread_time(began).saturating_sub(self.used.get()) > left;
        is_late.then(|| format!("the script runs longer than {} seconds", MOST_TIME.as_secs()))
    }
}
