//! Progress on stderr: a bar on a terminal, a line now and then elsewhere, nothing for short work.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::session::talk;

/// Work shorter than this shows nothing.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time between two lines where there is no terminal.
const INTERVAL: Duration = Duration::from_secs(10);
/// Steps of the bar.
const LENGTH: u64 = 1000;

/// Shows how far some work is.
pub struct Progress {
    quiet: bool,
    terminal: bool,
    start: Instant,
    last_line: Instant,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Starts the clock; `quiet` shows nothing at all.
    pub fn new(quiet: bool) -> Progress {
        let now = Instant::now();
        Progress { quiet, terminal: std::io::stderr().is_terminal(), start: now, last_line: now, bar: None }
    }

    /// Tells the share that is done.
    pub fn update(&mut self, share: f64) {
        let elapsed = self.start.elapsed();
        if self.quiet || elapsed < PATIENCE || share <= 0.0 {
            return;
        }
        let left = Duration::from_secs_f64((elapsed.as_secs_f64() * (1.0 - share) / share).clamp(0.0, 1e6));
        if self.terminal {
            let bar = self.bar.get_or_insert_with(new_bar);
            bar.set_position((share * LENGTH as f64) as u64);
            bar.set_message(format!("{} left", short(left)));
        } else if self.last_line.elapsed() >= INTERVAL {
            self.last_line = Instant::now();
            talk(&format!("{:.0} %, {} left", share * 100.0, short(left)));
        }
    }

    /// Removes the bar.
    pub fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

fn new_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(LENGTH).with_style(style)
}

/// A time as people say it.
pub fn short(time: Duration) -> String {
    match time.as_secs() {
        0 if time.as_millis() < 1000 => format!("{} ms", time.as_millis()),
        seconds @ 0..60 => format!("{seconds} s"),
        seconds @ 60..3600 => format!("{} min {} s", seconds / 60, seconds % 60),
        seconds => format!("{} h {} min", seconds / 3600, seconds / 60 % 60),
    }
}
