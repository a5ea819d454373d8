//! A run that goes by the clock, and how it keeps to it.

use std::time::{Duration, Instant};

/// A time of the clock as a command line gives it [s].
pub(super) fn seconds(text: &str) -> Result<Duration, &'static str> {
    let usable = |s: &f64| *s > 0.0 && *s <= 86_400.0;
    let seconds = text.parse().ok().filter(usable);
    seconds
        .map(Duration::from_secs_f64)
        .ok_or("must be a number of seconds above 0, a day at most")
}

/// The clock of a run: tick `n` is to end when the time of tick `n` has come.
pub(super) struct Pace {
    /// Wall-clock time of a tick.
    tick: Duration,
    /// An instant and the tick that ended then; none while the run stands still.
    base: Option<(Instant, u64)>,
    ticks: u64,
    late: u64,
    most_late: Duration,
}

impl Pace {
    /// So many simulated seconds a second.
    pub(super) fn new(factor: f64, tick_hz: u32) -> Self {
        let tick_s = 1.0 / (f64::from(tick_hz) * factor);
        Self {
            tick: Duration::try_from_secs_f64(tick_s).unwrap_or(Duration::MAX),
            base: None,
            ticks: 0,
            late: 0,
            most_late: Duration::ZERO,
        }
    }

    /// As fast as it goes: the next tick is always due, and none is late.
    pub(super) fn free() -> Self {
        Self {
            tick: Duration::ZERO,
            base: None,
            ticks: 0,
            late: 0,
            most_late: Duration::ZERO,
        }
    }

    /// The run stands still: the clock begins anew with its next tick.
    pub(super) fn stand(&mut self) {
        self.base = None;
    }

    /// When tick `tick` ends by the clock.
    fn end(&mut self, tick: u64) -> Instant {
        let (since, from) = *self.base.get_or_insert_with(|| (Instant::now(), tick));
        let ticks = u32::try_from(tick.saturating_sub(from)).unwrap_or(u32::MAX);
        let after = self.tick.saturating_mul(ticks);
        // What never comes comes in a year.
        since
            .checked_add(after)
            .unwrap_or(since + Duration::from_secs(31_536_000))
    }

    /// When the next tick begins after tick `tick`.
    pub(super) fn due(&mut self, tick: u64) -> Instant {
        self.end(tick)
    }

    /// Tick `tick` has ended.
    pub(super) fn note(&mut self, tick: u64) {
        self.ticks += 1;
        if self.tick.is_zero() {
            return;
        }
        let late = Instant::now().saturating_duration_since(self.end(tick));
        if late > Duration::ZERO {
            self.late += 1;
            self.most_late = self.most_late.max(late);
        }
    }

    /// Ticks that ended late, and the longest delay [s].
    pub(super) fn late(&self) -> (u64, f64) {
        (self.late, self.most_late.as_secs_f64())
    }

    /// The same in words.
    pub(super) fn told(&self) -> String {
        if self.tick.is_zero() {
            return format!("{} ticks as fast as they went", self.ticks);
        }
        let most_ms = 1e3 * self.most_late.as_secs_f64();
        format!(
            "{} of {} ticks by the clock ended late, at most by {most_ms:.1} ms",
            self.late, self.ticks
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_after_its_time_is_late_and_a_pause_is_no_delay() {
        let mut pace = Pace::new(1.0, 100);
        let begun = pace.due(0);
        assert_eq!(pace.due(10) - begun, Duration::from_millis(100));
        pace.note(10);
        assert_eq!(pace.late(), (0, 0.0));
        std::thread::sleep(Duration::from_millis(30));
        pace.note(1);
        let (late, most_s) = pace.late();
        assert!(late == 1 && most_s >= 0.019, "{most_s}");
        pace.stand();
        assert!(pace.due(11) > begun + Duration::from_millis(29));
        pace.note(12);
        assert_eq!(pace.late().0, 1);
        // Without a clock nothing is late.
        let mut free = Pace::free();
        free.due(0);
        std::thread::sleep(Duration::from_millis(2));
        free.note(1);
        assert!(free.late() == (0, 0.0) && free.due(1) <= Instant::now());
        // The slowest pace overflows nothing.
        let mut slow = Pace::new(1e-300, 1);
        slow.due(0);
        slow.due(u64::MAX);
    }
}
