//! Progress as the engines of Open Job Description read it, from the lines that a task writes.

use bulbfold::diag::Diagnostic;
use bulbfold::engine::{Observer, Stage};

use crate::cli::observer::Terminal;
use crate::cli::session::talk;
use crate::cli::{Failure, Outcome, Session};

/// An observer for people or, where it is asked for, for an engine.
pub struct Told<'a> {
    watch: Terminal<'a>,
    is_engine: bool,
    /// The last share that was told, in hundredths.
    told: Option<u32>,
}

impl<'a> Told<'a> {
    /// Tells an engine, or people.
    pub fn new(session: &'a Session, is_engine: bool) -> Told<'a> {
        Told { watch: if is_engine { session.hushed() } else { session.watch() }, is_engine, told: None }
    }

    /// Says what is being done.
    pub fn status(&self, text: &str) {
        if self.is_engine {
            talk(&format!("openjd_status: {text}"));
        }
    }

    /// Tells the engine why work failed, in a line.
    pub fn outcome(is_engine: bool, outcome: Outcome) -> Outcome {
        if let (true, Err(Failure::Usage(text) | Failure::Work(text))) = (is_engine, &outcome) {
            let line = text.lines().next().unwrap_or_default();
            talk(&format!("openjd_fail: {}", line.trim_start_matches("error: ")));
        }
        outcome
    }
}

impl Observer for Told<'_> {
    fn progress(&mut self, stage: Stage, share: f64) {
        let hundredths = (100.0 * share.clamp(0.0, 1.0)) as u32;
        if self.is_engine && self.told != Some(hundredths) {
            self.told = Some(hundredths);
            talk(&format!("openjd_progress: {hundredths}"));
        }
        self.watch.progress(stage, share);
    }

    fn warn(&mut self, warning: Diagnostic) {
        self.watch.warn(warning);
    }

    fn note(&mut self, text: &str) {
        self.watch.note(text);
    }
}
