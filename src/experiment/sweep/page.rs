//! The page of an experiment: main effects with intervals, curves, heat maps, ranks, best and worst runs.

mod effects;
mod figure;
mod groups;
mod ranking;

use super::plan::Plan;
use super::run::Done;
use crate::experiment::ExperimentError;
use crate::output;
use crate::output::quoted;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, note, page};
use effects::{MOST_LINES, effects};
use figure::figures;
use groups::{Grouped, Row, groups};
use maud::{Markup, html};
use ranking::{extremes, ranking};
use std::path::Path;

/// Writes `sweep.html`.
pub(super) fn write(
    folder: &Path,
    plan: &Plan,
    rows: &[Row],
    experiment: &Path,
) -> Result<(), ExperimentError> {
    let command = format!(
        "boresight sweep {} --out {}",
        quoted(experiment.display()),
        quoted(folder.display())
    );
    let failed = rows.iter().filter(|(_, done)| done.result.is_err()).count();
    let counts = format!("{} runs, {failed} failed", rows.len());
    let head = Head {
        title: &format!("Boresight: {}", plan.experiment.name),
        heading: &plan.experiment.name,
        facts: &[
            ("Runs", &counts),
            ("Version", crate::VERSION),
            ("", &command),
        ],
        style: "",
    };
    Ok(output::write(
        &folder.join("sweep.html"),
        page(&head, &body(plan, rows)),
    )?)
}

fn body(plan: &Plan, rows: &[Row]) -> Markup {
    let figures = figures(plan, rows);
    let by_factor: Vec<Grouped> = (0..plan.factors.len())
        .map(|factor| groups(rows, factor))
        .collect();
    html! {
        @if !plan.experiment.description.is_empty() { p { (plan.experiment.description) } }
        @if !plan.experiment.pictures {
            (note("Runs without pictures: the truth detector proves nothing about finding or choosing targets."))
        }
        @for figure in &figures {
            h2 { (figure.name) }
            @if let Some(value) = figure.constant() {
                p { (format_args!("{value} in all {} runs.", figure.values.len())) }
            } @else {
                (effects(plan, figure, &by_factor))
                (ranking(plan, figure, &by_factor))
                (extremes(plan, figure))
            }
        }
        (left(plan, rows, &by_factor))
        (note(if plan.seeds() > 1 { OVER_SEEDS } else { OVER_RUNS }))
        @if plan.factors.len() > 1 { (note(RANKS)) }
        (note("What a run does not have, such as the time of what never happened, is not in the means; n counts the \
               runs that have it."))
    }
}

/// What the intervals are.
const OVER_SEEDS: &str = "Intervals are 95 %, over the seeds: the runs of a seed share its random numbers, so the other \
    factors are averaged within each seed first. Of means by Student's t, cut to what the figure can be, of shares by Wilson \
    with as many trials as there are seeds, which is rather too wide.";
const OVER_RUNS: &str = "There is one seed. Intervals are 95 %, of means by Student's t, cut to what the figure can be, of \
    shares by Wilson, over all runs of a group as if each had been drawn by itself: they hold the spread by the other \
    factors, and none by chance.";
/// What the ranks are.
const RANKS: &str = "Factors are ranked by the share of the variance among all runs that the means over their values make \
    up, less what as many values would make up by chance (Kelley's epsilon squared). What two factors do only together is \
    in neither.";

/// UAVs that are not brought down yet, mean over the runs, over time; a line for each value of a factor that has few.
/// Nothing where at most one flies.
fn left(plan: &Plan, rows: &[Row], by_factor: &[Grouped]) -> Markup {
    let several = rows.iter().any(|(_, done)| done.down.uavs > 1);
    let downs = rows.iter().flat_map(|(_, done)| &done.down.at_s);
    let end_s = downs.copied().fold(0.0, f64::max).ceil();
    let few: Vec<usize> = (0..by_factor.len())
        .filter(|factor| (2..=MOST_LINES).contains(&by_factor[*factor].groups.len()))
        .collect();
    if !several || end_s == 0.0 || few.is_empty() {
        return html! {};
    }
    let chart = |factor: usize| {
        let (name, Grouped { groups, of_run, .. }) =
            (&plan.factors[factor].name, &by_factor[factor]);
        let line = |number: usize| -> Series {
            let whole =
                |(run, (_, done)): &(usize, &Row)| of_run[*run] == number && done.result.is_ok();
            let runs: Vec<&Done> = (rows.iter().enumerate().filter(whole))
                .map(|(_, (_, done))| done)
                .collect();
            let at = |t_s: f64| {
                let left: usize = runs.iter().map(|done| done.down.left(t_s)).sum();
                (t_s, left as f64 / runs.len() as f64)
            };
            (0..=end_s as u32).map(f64::from).map(at).collect()
        };
        let lines: Vec<(String, Series)> = (groups.iter().enumerate())
            .map(|(number, group)| (format!("{name} {}", group.label), line(number)))
            .collect();
        let named: Vec<(&str, &Series)> = lines.iter().map(|(n, s)| (n.as_str(), s)).collect();
        let chart = Chart {
            title: "Not brought down, mean",
            unit: "UAVs",
            scale: Scale::Whole,
            series: &named,
            limit: None,
        };
        chart.figure(&Across::from_zero("time [s]", end_s))
    };
    html! {
        h2 { "UAVs left" }
        div .charts {
            @for factor in few { (chart(factor)) }
        }
    }
}
