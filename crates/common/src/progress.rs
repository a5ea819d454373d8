//! How far a command has come, on standard error: a bar on a terminal, elsewhere a line every ten seconds.

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::io::Write as _;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two lines.
const EVERY: Duration = Duration::from_secs(10);

/// How far a command has come.
pub struct Progress {
    bar: ProgressBar,
    /// Whether lines take the place of a bar that nobody sees.
    lines: bool,
    last: Mutex<Instant>,
}

impl Progress {
    /// Of so many steps; `template` is indicatif's, with `{left}` for a comma and the time that is left, where it is known.
    pub fn new(steps: u64, template: &str) -> Self {
        let bar = ProgressBar::new(steps);
        // Templates are constants; should one be refused, the default style serves.
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> ").with_key("left", left));
        }
        Self {
            lines: bar.is_hidden(),
            bar,
            last: Mutex::new(Instant::now()),
        }
    }

    /// The same, of which nothing is shown.
    pub fn hidden() -> Self {
        Self {
            bar: ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden()),
            lines: false,
            last: Mutex::new(Instant::now()),
        }
    }

    /// The bar.
    pub fn bar(&self) -> &ProgressBar {
        &self.bar
    }

    /// Says how far it has come, where lines take the bar's place and the last one is old enough.
    pub fn say(&self, text: impl FnOnce() -> String) {
        if !self.lines {
            return;
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() >= EVERY {
            *last = Instant::now();
            // A closed pipe is no error.
            let _ = writeln!(std::io::stderr(), "{}", text());
        }
    }
}

/// The time that is left: nothing before it can be told, nor near the end.
fn left(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    let eta = state.eta();
    if state.pos() > 0 && eta >= Duration::from_secs(1) {
        // Writing to a string does not fail.
        let _ = write!(out, ", {:#} left", HumanDuration(eta));
    }
}
