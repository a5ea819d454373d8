//! What leaving rules out changes.

use super::rules::Without;
use crate::eval::engagement::Outcome;
use crate::models::maths::statistics::{Mean, Paired};
use serde::Serialize;
use std::fmt::Write as _;

/// What was found, as `ablation.json` has it.
#[derive(Serialize)]
pub struct Ablation {
    /// Version of the program.
    pub version: &'static str,
    /// The command that repeats it.
    pub command: String,
    /// What found the UAVs.
    pub detector: &'static str,
    /// Engagements made with all rules.
    pub draws: usize,
    /// What was left out, where it was stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// Each rule.
    pub rules: Vec<Effect>,
}

/// What leaving something out changes.
#[derive(Serialize)]
pub struct Effect {
    /// What is left out.
    #[serde(flatten)]
    pub without: Without,
    /// Draws that end in any other way than with it.
    pub changed: usize,
    /// Share acquired, of those visible either way.
    pub acquired: Paired,
    /// Share neutralised in time, of those whose interlocks were open either way.
    pub neutralised: Paired,
    /// Share that fired at something else, of all.
    pub fired_else: Paired,
    /// Share given up though seen, of those acquired either way.
    pub given_up: Paired,
    /// How much later the UAV is acquired, where it is either way [s].
    pub later_s: Mean,
}

impl Effect {
    /// Of the same engagements with all rules and without one.
    pub fn of(without: Without, with: &[Outcome], left_out: &[Outcome]) -> Self {
        let pairs = || with.iter().zip(left_out);
        let share = |counts: fn(&Outcome) -> bool, succeeds: fn(&Outcome) -> bool| {
            let both = pairs().filter(move |(a, b)| counts(a) && counts(b));
            Paired::of(both.map(move |(a, b)| [succeeds(a), succeeds(b)]))
        };
        let later_s: Vec<f64> = pairs()
            .filter_map(|(a, b)| Some(b.record.acquired_s? - a.record.acquired_s?))
            .collect();
        Self {
            without,
            changed: pairs().filter(|(a, b)| a.record != b.record).count(),
            acquired: share(|o| o.verdict.visible, |o| o.verdict.acquired),
            neutralised: share(|o| o.verdict.open, |o| o.verdict.neutralised),
            fired_else: share(|_| true, |o| o.verdict.fired_else),
            given_up: share(|o| o.verdict.acquired, |o| o.verdict.given_up),
            later_s: Mean::of(&later_s),
        }
    }
}

/// A change of a share as a cell has it, such as `+3 (−1 to +7) %, 4 of 120`; marked where it is beyond chance.
pub fn cell(paired: &Paired) -> String {
    let Some(difference) = paired.difference else {
        return "no draw".into();
    };
    let [low, high] = paired.interval_95.map(|x| 100.0 * x);
    format!(
        "{:+.1} ({low:+.1} to {high:+.1}) %, {} of {} differ{}",
        100.0 * difference,
        paired.only[0] + paired.only[1],
        paired.trials,
        if paired.tells() { " *" } else { "" }
    )
}

impl Ablation {
    /// The effects for a terminal.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{}: {} draws with all rules, and without each; * beyond chance at 5 %\n",
            self.detector, self.draws
        );
        for effect in &self.rules {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "without {}: {} draws end otherwise\n  acquired {}\n  neutralised {}\n  fired at something else {}\n  \
                 given up {}\n  acquired later by {} s",
                effect.without.name,
                effect.changed,
                cell(&effect.acquired),
                cell(&effect.neutralised),
                cell(&effect.fired_else),
                cell(&effect.given_up),
                effect.later_s.text()
            );
        }
        if let Some(stopped) = &self.stopped {
            let _ = writeln!(text, "{stopped}");
        }
        text
    }
}
