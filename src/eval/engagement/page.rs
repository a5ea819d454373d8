//! The page of the evaluation.

use super::belief::Calibration;
use super::job::{Outcome, picture};
use super::recipe::{Nearness, Rules};
use super::results::{Group, Results, Row};
use super::verdict::{Cause, HELD_SHARE, IN_TIME_S, LEAST_PX, OPEN_S, VISIBLE_S, nearness_name};
use crate::eval::EvalError;
use crate::models::maths::statistics::Rate;
use crate::output::put;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, note, page, percent, table};
use maud::{Markup, html};
use std::path::Path;

const STYLE: &str = ".failure{margin:1.6rem 0 0}.failure h3{margin:0 0 .2rem;font-size:1rem}\
    .failure p{margin:.1rem 0 .4rem}";
/// Failures whose pictures are in the page; what is left out lies beside the records.
const MOST_PICTURED: usize = 120;
/// Changes of state that a failure shows.
const MOST_STATES: usize = 8;

/// Writes `results.html`.
pub fn write(out: &Path, results: &Results) -> Result<(), EvalError> {
    let head = Head {
        title: "Boresight: engagements",
        heading: "Engagements drawn from a recipe",
        facts: &[
            ("Version", results.version),
            ("Detector", results.detector),
            ("", &results.command),
            (results.stopped.as_deref().unwrap_or_default(), ""),
        ],
        style: STYLE,
    };
    Ok(put(
        &out.join("results.html"),
        page(&head, &body(out, results)),
    )?)
}

fn body(out: &Path, results: &Results) -> Markup {
    let headline: Vec<Vec<String>> = (results.headline.iter())
        .map(|line| vec![line.name.clone(), percent(line.rate.rate), line.rate.text()])
        .collect();
    html! {
        h2 { "Shares" }
        (table(&["", "share", "count (95 % interval)"], &headline))
        (rules(&results.rules))
        (definitions())
        div .charts { (times(results)) }
        h2 { "Causes of failure" }
        (causes(&results.draws))
        h2 { "Beliefs" }
        (beliefs(&results.beliefs))
        @for group in &results.groups { (by(group, &results.rules)) }
        h2 { "Failures" }
        (failures(out, &results.draws))
    }
}

/// What each set of rules allows behind the target.
fn rules(rules: &[Rules]) -> Markup {
    let texts: Vec<String> = rules.iter().map(Rules::text).collect();
    note(&format!(
        "Rules of fire by what may lie behind the target, of which each engagement has one. {}.",
        texts.join("; ")
    ))
}

fn definitions() -> Markup {
    note(&format!(
        "Visible: in clear sight, at least {LEAST_PX} px long in the search camera and inside its field for \
         {VISIBLE_S} s in all. Acquired: the coarse camera held the UAV. Held: from then on, while the UAV is \
         in clear sight, for {:.0} % of the time. Neutralised: its skin failed within {IN_TIME_S} s of the \
         first sight. Open interlocks: what lies behind it, its line of sight and the sun would have \
         allowed fire for {OPEN_S} s in all. Given up: the tracker dropped it in clear sight. Intervals are \
         Wilson's.",
        100.0 * HELD_SHARE
    ))
}

/// Share of those with open interlocks neutralised over the time since they were first visible.
fn times(results: &Results) -> Markup {
    let series_of = |nearness: Nearness| -> Series {
        let open = |o: &&Outcome| o.verdict.visible && o.verdict.open;
        let visible = results.draws.iter().filter(open);
        let of: Vec<&Outcome> = visible.filter(|o| o.facts.nearness == nearness).collect();
        let mut times_s: Vec<f64> = (of.iter())
            .filter_map(|o| Some(o.record.neutralised_s? - o.record.visible_from_s?))
            .collect();
        times_s.sort_unstable_by(f64::total_cmp);
        let share = |count: usize| 100.0 * count as f64 / of.len() as f64;
        let steps = times_s.iter().enumerate();
        let steps = steps.flat_map(|(k, t_s)| [(*t_s, share(k)), (*t_s, share(k + 1))]);
        if of.is_empty() {
            return Series::new();
        }
        let last = (IN_TIME_S, share(times_s.len()));
        std::iter::once((0.0, 0.0))
            .chain(steps)
            .chain([last])
            .collect()
    };
    let kinds = [Nearness::None, Nearness::Far, Nearness::Near];
    let series = kinds.map(series_of);
    let names = kinds.map(|kind| match kind {
        Nearness::None => "nothing else",
        Nearness::Far => "something far",
        Nearness::Near => "something near",
    });
    let named: Vec<(&str, &Series)> = names.into_iter().zip(&series).collect();
    let chart = Chart {
        title: "Neutralised, of the visible with open interlocks",
        unit: "%",
        scale: Scale::Linear,
        series: &named,
        limit: None,
    };
    chart.figure(&Across::from_zero(
        "time since the first sight [s]",
        IN_TIME_S,
    ))
}

/// How right the tracker's beliefs were.
fn beliefs(calibration: &Calibration) -> Markup {
    let bins: Vec<Vec<String>> = (calibration.bins.iter())
        .map(|bin| {
            let [from, to] = bin.probability.map(|p| 100.0 * p);
            vec![
                format!("{from:.0}–{to:.0} %"),
                percent(Some(bin.mean)),
                percent(bin.uavs.rate),
                format!("{} of {}", bin.uavs.successes, bin.uavs.trials),
            ]
        })
        .collect();
    let terms: Vec<Vec<String>> = (calibration.terms.iter())
        .map(|term| {
            let weight = term.weight.map_or("not known".into(), |[value, half]| {
                format!("{value:.2} ± {half:.2}")
            });
            let said = format!("{} of {}", term.says.successes, term.says.trials);
            vec![term.name.to_owned(), said, weight]
        })
        .collect();
    html! {
        (note(
            "Once a second each track that may be a target is asked what it is held to be. Beliefs are right where the share of \
             UAVs is the mean probability."
        ))
        (table(&["probability of a UAV", "mean", "UAVs", "count"], &bins))
        (note(
            "What a term says is to be multiplied by its weight beside the others (logistic regression, 95 % interval by \
             engagements; 1: it says what it should; 0: it tells nothing). The prior is to be added."
        ))
        (table(&["term", "UAVs, of those in which it says something", "weight"], &terms))
    }
}

fn causes(draws: &[Outcome]) -> Markup {
    let nearness = [Nearness::None, Nearness::Far, Nearness::Near];
    let rows: Vec<Vec<String>> = (Cause::ALL.iter())
        .map(|cause| {
            let failed = draws.iter().filter(|o| o.verdict.cause == Some(*cause));
            let failed: Vec<&Outcome> = failed.collect();
            let of = |kind| failed.iter().filter(|o| o.facts.nearness == kind).count();
            let counts = nearness.map(|kind| of(kind).to_string());
            let total = failed.len().to_string();
            [vec![cause.name().to_owned(), total], counts.to_vec()].concat()
        })
        .collect();
    let named = nearness.map(|kind| format!("distractors {}", nearness_name(kind)));
    let head: Vec<&str> = (["cause", "failures"].into_iter())
        .chain(named.iter().map(String::as_str))
        .collect();
    html! {
        (table(&head, &rows))
        (note(
            "Every instant with the UAV in clear sight, from the moment the search first has it in its field, is \
             charged to one cause; a failure's is the one charged most, or the wrong object if anything \
             else was fired at. docs/validation/engagements.md defines them.",
        ))
    }
}

fn by(group: &Group, rules: &[Rules]) -> Markup {
    const HEAD: [&str; 7] = [
        "",
        "draws",
        "visible",
        "acquired",
        "held",
        "time held",
        "given up though seen",
    ];
    let of_rules = |rules: &Rules| {
        let name = &rules.name;
        [
            format!("neutralised, rules {name}"),
            format!("fired at something else, rules {name}"),
        ]
    };
    let head: Vec<String> = (HEAD.iter().map(ToString::to_string))
        .chain(rules.iter().flat_map(of_rules))
        .collect();
    let cells = |row: &Row| {
        let shares = &row.shares;
        let rate = |rate: &Rate| match rate.rate {
            Some(_) => rate.text(),
            None => "–".into(),
        };
        let fire = shares.by_rules.iter();
        let fire = fire.flat_map(|fire| [rate(&fire.neutralised), rate(&fire.fired_else)]);
        let all = [
            row.name.clone(),
            row.draws.to_string(),
            shares.visible.successes.to_string(),
            rate(&shares.acquired),
            rate(&shares.held),
            percent(shares.held_time),
            rate(&shares.given_up),
        ];
        all.into_iter().chain(fire).collect()
    };
    let rows: Vec<Vec<String>> = group.rows.iter().map(cells).collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    html! {
        h2 { "By " (group.by) }
        (table(&head, &rows))
    }
}

fn failures(out: &Path, draws: &[Outcome]) -> Markup {
    let failed: Vec<(&Outcome, Cause)> = (draws.iter())
        .filter_map(|outcome| Some((outcome, outcome.verdict.cause?)))
        .collect();
    html! {
        (note(
            "Boxes: green what the detector found, with its score; by truth, blue the UAV, orange what else \
             flies. stv, ctv and ptv are the search, coarse and precise camera.",
        ))
        @if failed.is_empty() { (note("none")) }
        @for (place, (outcome, cause)) in failed.iter().enumerate() {
            (failure(out, outcome, *cause, place < MOST_PICTURED))
        }
        @if failed.len() > MOST_PICTURED {
            (note("The pictures of later failures lie beside their records, in the folder draws."))
        }
    }
}

fn failure(out: &Path, outcome: &Outcome, cause: Cause, pictured: bool) -> Markup {
    let index = outcome.facts.index;
    let pictures = outcome.pictures.iter().filter(|_| pictured);
    // One that is gone leaves a gap, not an error: the record has the figures.
    let pictures = pictures.filter_map(|frame| {
        let jpeg = std::fs::read(picture(out, index, &frame.camera)).ok()?;
        Some(frame.figure(&jpeg))
    });
    html! {
        section .failure {
            h3 { (format_args!("Draw {index}: {}", cause.name())) }
            p { (outcome.description()) }
            p .note { (history(outcome)) }
            p { code { (outcome.command) } }
            div .sheet { @for figure in pictures { (figure) } }
            @let states = outcome.record.states.iter().rev().take(MOST_STATES).rev();
            ul .note {
                @for (t_s, state, reason) in states {
                    li { (format_args!("{t_s:.2} s {state}: {reason}")) }
                }
            }
        }
    }
}

/// When what happened, and how its time was charged.
fn history(outcome: &Outcome) -> String {
    let record = &outcome.record;
    let at = |t_s: Option<f64>| t_s.map_or("never".into(), |t_s| format!("at {t_s:.2} s"));
    let list = |parts: Vec<String>| match parts.is_empty() {
        true => "nothing".to_owned(),
        false => parts.join(", "),
    };
    let seconds = |(name, s): (&str, f64)| format!("{name} {s:.1} s");
    let charged = record
        .charges_s
        .iter()
        .map(|(c, s)| seconds((c.name(), *s)));
    let fired = record.fired_s.iter().map(|(what, s)| seconds((what, *s)));
    let looks = ["search", "coarse", "precise"].iter().zip(record.looks);
    let looks = looks.map(|(name, l)| {
        let before = match l.before {
            0 => String::new(),
            _ => format!(
                " (signal to clutter {:.1} before acquisition)",
                l.clutter_ratio
            ),
        };
        format!("{name} {} of {}{before}", l.found, l.frames)
    });
    format!(
        "Visible {}, acquired {}, precise {}, neutralised {}, ended at {:.2} s; held for {} of the time; given \
         up {} times, {} changes of target. Charged: {}. Fired at: {}. Found in frames: {}.",
        at(record.visible_from_s),
        at(record.acquired_s),
        at(record.precise_s),
        at(record.neutralised_s),
        record.end_s,
        percent(outcome.verdict.held_share),
        record.given_up.len(),
        record.target_changes,
        list(charged.collect()),
        list(fired.collect()),
        list(looks.collect()),
    )
}
