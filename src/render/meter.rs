//! How far a render is, told from any thread.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Is told the share that is done, and returns false to stop.
pub(super) type Progress<'a> = dyn FnMut(f64) -> bool + Send + 'a;

/// Counts rays that are done against those that are still to come.
///
/// How many pixels will be refined is known only of bands whose first pass is done; the others are taken to be like them.
pub(super) struct Meter<'a> {
    state: Mutex<State<'a>>,
    stopped: AtomicBool,
}

struct State<'a> {
    progress: &'a mut Progress<'a>,
    /// Pixels of the picture.
    pixels: f64,
    /// Samples of a refined pixel besides its first.
    others: f64,
    /// Pixels whose samples are decided, and how many of them get all.
    decided: f64,
    refined: f64,
    done: f64,
    told: f64,
}

/// Pixels that count as decided, with this share of them refined, before any are.
const PRIOR: (f64, f64) = (1000.0, 0.4);

impl<'a> Meter<'a> {
    /// For a picture of so many pixels, which have so many samples where they are refined.
    pub(super) fn new(progress: &'a mut Progress<'a>, pixels: f64, samples: usize) -> Meter<'a> {
        let others = samples as f64 - 1.0;
        let state = State { progress, pixels, others, decided: 0.0, refined: 0.0, done: 0.0, told: 0.0 };
        Meter { state: Mutex::new(state), stopped: AtomicBool::new(false) }
    }

    /// Notes how many of some pixels will get all their samples.
    pub(super) fn decide(&self, pixels: usize, refined: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.decided += pixels as f64;
        state.refined += refined as f64;
    }

    /// Counts rays that are done and tells the share.
    pub(super) fn advance(&self, rays: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.done += rays as f64;
        let open = state.pixels - state.decided;
        let share = (state.refined + PRIOR.0 * PRIOR.1) / (state.decided + PRIOR.0);
        let all = state.pixels + (state.refined + open * share) * state.others;
        state.told = state.told.max((state.done / all).min(0.999));
        let told = state.told;
        if !(state.progress)(told) {
            self.stopped.store(true, Ordering::Relaxed);
        }
    }

    /// Tells that everything is done.
    pub(super) fn finish(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        (state.progress)(1.0);
    }

    /// Whether the render was told to stop.
    pub(super) fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}
