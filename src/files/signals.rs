//! Signals that end the program take its temporary files with them.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the program asked for it: a library leaves signals alone.
static ASKED: AtomicBool = AtomicBool::new(false);
static WATCH: Once = Once::new();

/// Makes SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGXCPU remove all temporary files before they end the process, and SIGXFSZ an error of
/// the write that was too much. Signals that are ignored stay so. Nothing is done before the first temporary file.
pub fn clean_up_on_signals() {
    ASKED.store(true, Ordering::Relaxed);
}

/// Starts the thread that waits for signals, where it was asked for and does not run yet.
pub(super) fn watch() {
    if ASKED.load(Ordering::Relaxed) {
        WATCH.call_once(start);
    }
}

#[cfg(unix)]
fn start() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU, SIGXFSZ};
    let ending = [SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGXCPU].into_iter().filter(|signal| !is_ignored(*signal));
    if let Ok(mut signals) = signal_hook::iterator::Signals::new(ending) {
        let wait = move || signals.forever().for_each(end);
        // Without the thread the signals would be lost.
        if let Err(error) = std::thread::Builder::new().name("signals".into()).spawn(wait) {
            panic!("no thread can be started: {error}");
        }
    }
    // Handled at all, the signal makes the write fail with an error, and that is told as any other.
    let _ = signal_hook::flag::register(SIGXFSZ, std::sync::Arc::default());
}

#[cfg(not(unix))]
fn start() {}

/// Removes what is unfinished and ends the process as the signal does. No other thread starts a file meanwhile.
#[cfg(unix)]
fn end(signal: i32) {
    let _held = super::temporary::remove_all();
    let _ = signal_hook::low_level::emulate_default_handler(signal);
}

/// Whether the process was started with this signal ignored, as `nohup` does.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: with no new action the call only writes the present one to the place, which has its type.
    unsafe {
        libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) == 0
            && action.assume_init().sa_sigaction == libc::SIG_IGN
    }
}
