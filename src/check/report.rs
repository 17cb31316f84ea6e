//! The results of tests, and their text.

use std::fmt;
use std::io::{self, Write};
use std::time::Duration;

use super::backends::shown;

/// How a test ended.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Verdict {
    /// As expected.
    Passed,
    /// Not as expected; the text shows what was found beside what was expected.
    Failed(String),
    /// Not run; the text says why.
    Skipped(String),
}

/// One test.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// File, what is tested and on which back end, joined by `::`.
    pub name: String,
    /// How it ended.
    pub verdict: Verdict,
    /// How long it took.
    pub time: Duration,
    /// `file:line` of the test, where it stands in a file.
    pub place: Option<String>,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.verdict {
            Verdict::Passed => write!(f, "test {} ... ok ({})", self.name, shown(self.time)),
            Verdict::Failed(_) => write!(f, "test {} ... FAILED ({})", self.name, shown(self.time)),
            Verdict::Skipped(why) => write!(f, "test {} ... skipped: {why}", self.name),
        }
    }
}

/// All tests of a run.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// In the order in which they ran.
    pub outcomes: Vec<Outcome>,
    /// From start to end.
    pub time: Duration,
}

impl Report {
    /// Tests that passed.
    pub fn passed(&self) -> usize {
        self.outcomes.iter().filter(|o| o.verdict == Verdict::Passed).count()
    }

    /// Tests that failed.
    pub fn failed(&self) -> usize {
        self.outcomes.iter().filter(|o| matches!(o.verdict, Verdict::Failed(_))).count()
    }

    /// Tests that did not run.
    pub fn skipped(&self) -> usize {
        self.outcomes.iter().filter(|o| matches!(o.verdict, Verdict::Skipped(_))).count()
    }

    /// Whether none failed.
    pub fn is_ok(&self) -> bool {
        self.failed() == 0
    }

    /// Writes a line for each test, then the failures, then the summary.
    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        for outcome in &self.outcomes {
            writeln!(out, "{outcome}")?;
        }
        self.print_end(out)
    }

    /// Writes the failures and the summary, for a caller that showed the lines while the tests ran.
    pub fn print_end(&self, out: &mut dyn Write) -> io::Result<()> {
        if !self.is_ok() {
            writeln!(out, "\nfailures:")?;
        }
        for outcome in &self.outcomes {
            if let Verdict::Failed(text) = &outcome.verdict {
                let place = outcome.place.as_ref().map(|p| format!("\n  at {p}")).unwrap_or_default();
                writeln!(out, "\n{}{place}\n  {}", outcome.name, text.trim_end().replace('\n', "\n  "))?;
            }
        }
        let result = if self.is_ok() { "ok" } else { "FAILED" };
        let (passed, failed, skipped) = (self.passed(), self.failed(), self.skipped());
        let time = self.time.as_secs_f64();
        writeln!(out, "\ntest result: {result}. {passed} passed; {failed} failed; {skipped} skipped; in {time:.1} s")
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = Vec::new();
        self.print(&mut text).map_err(|_| fmt::Error)?;
        f.write_str(&String::from_utf8_lossy(&text))
    }
}

/// `Err` with found and expected values where `found` is further off than `slack`: absolute below 1, relative above.
pub(super) fn expect_near(what: &str, found: f64, expected: f64, slack: f64) -> Result<(), String> {
    if (found - expected).abs() <= slack * expected.abs().max(1.0) {
        return Ok(());
    }
    Err(format!("{what}: expected {expected} (tolerance {slack:.1e}), found {found}"))
}
