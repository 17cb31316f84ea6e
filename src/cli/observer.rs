//! What the terminal shows of work: progress, warnings, and notes that `--quiet` suppresses.

use bulbfold::diag::Diagnostic;
use bulbfold::engine::{Observer, Stage};

use super::Session;
use super::progress::Progress;
use super::session::talk;

/// An observer that talks on stderr.
pub struct Terminal<'a> {
    session: &'a Session,
    quiet: bool,
    /// The stage that is shown.
    shown: Option<(Stage, Progress)>,
}

impl<'a> Terminal<'a> {
    /// Nothing is shown yet; `quiet` shows only warnings.
    pub fn new(session: &'a Session, quiet: bool) -> Terminal<'a> {
        Terminal { session, quiet, shown: None }
    }
}

impl Observer for Terminal<'_> {
    fn progress(&mut self, stage: Stage, share: f64) {
        let is_other = self.shown.as_ref().is_none_or(|(shown, _)| *shown != stage);
        if is_other {
            self.shown = Some((stage, Progress::new(self.quiet)));
        }
        if let Some((_, progress)) = &mut self.shown {
            match share < 1.0 {
                true => progress.update(share),
                false => progress.finish(),
            }
        }
    }

    fn warn(&mut self, warning: Diagnostic) {
        self.session.tell(warning);
    }

    fn note(&mut self, text: &str) {
        if !self.quiet {
            talk(text);
        }
    }
}

impl Drop for Terminal<'_> {
    fn drop(&mut self) {
        if let Some((_, progress)) = &mut self.shown {
            progress.finish();
        }
    }
}
