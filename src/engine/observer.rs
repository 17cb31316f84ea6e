//! The observer of a job: it receives progress and warnings, and may cancel.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::diag::Diagnostic;

/// What is being done.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Stage {
    /// Estimates are measured.
    Calibrating,
    /// Pixels are computed.
    Rendering,
    /// Points of a mesh or a volume are computed.
    Meshing,
}

/// Receives the progress of work. Every method has a default that does nothing, and `()` observes nothing.
pub trait Observer: Send {
    /// The share of a stage that is done, from 0 to 1.
    fn progress(&mut self, _stage: Stage, _share: f64) {}
    /// Something that a user should know, which stops nothing.
    fn warn(&mut self, _warning: Diagnostic) {}
    /// What was chosen, in a line.
    fn note(&mut self, _text: &str) {}
    /// True ends the work at the next tile.
    fn is_cancelled(&self) -> bool {
        false
    }
}

impl Observer for () {}

/// Ends work from another thread.
#[derive(Clone, Default, Debug)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks for the end.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether somebody asked for it.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Observes nothing, and ends where it is asked to.
impl Observer for Cancel {
    fn is_cancelled(&self) -> bool {
        Cancel::is_cancelled(self)
    }
}
