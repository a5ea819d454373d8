//! The page of an ablation.

use super::results::{Ablation, cell};
use crate::eval::EvalError;
use crate::output::put;
use crate::report::page::{Head, note, page, table};
use maud::html;
use std::path::Path;

/// Writes it.
pub fn write(path: &Path, ablation: &Ablation) -> Result<(), EvalError> {
    let draws = ablation.draws.to_string();
    let head = Head {
        title: "Boresight: ablation",
        heading: "What each term and rule of the tracker brings",
        facts: &[
            ("Version", ablation.version),
            ("Detector", ablation.detector),
            ("Engagements", &draws),
            ("", &ablation.command),
            (ablation.stopped.as_deref().unwrap_or_default(), ""),
        ],
        style: "",
    };
    let rows: Vec<Vec<String>> = (ablation.rules.iter())
        .map(|effect| {
            vec![
                effect.without.name.clone(),
                effect.without.does.clone(),
                effect.changed.to_string(),
                cell(&effect.acquired),
                cell(&effect.neutralised),
                cell(&effect.fired_else),
                cell(&effect.given_up),
                effect.later_s.text(),
            ]
        })
        .collect();
    let columns = [
        "without",
        "which does",
        "draws that end otherwise",
        "acquired",
        "neutralised",
        "fired at something else",
        "given up though seen",
        "acquired later [s]",
    ];
    let body = html! {
        (note(
            "The same engagements with all rules, and without one at a time. Each cell is the share without it less the share with \
             it, in percent, with its 95 % interval for pairs (Agresti and Min), and in how many of the pairs that count it differs. \
             A star: beyond chance at 5 % by McNemar's exact test. One star in twenty is chance."
        ))
        (table(&columns, &rows))
    };
    Ok(put(path, page(&head, &body))?)
}
