//! The page of an experiment: main effects with intervals, curves, heat maps, best and worst runs.

use super::plan::{Plan, PlannedRun};
use super::run::Done;
use crate::experiment::ExperimentError;
use crate::experiment::figures::Kind;
use crate::models::engage::outcome::Outcome;
use crate::models::maths::statistics::{Mean, Rate};
use crate::output;
use crate::output::quoted;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, note, page, table};
use maud::{Markup, html};
use std::path::Path;

/// Groups into which the values of a sampled range are put.
const BINS: usize = 8;
/// Lines of a chart by the values of another factor.
const MOST_LINES: usize = 3;
/// Best and worst runs that are listed.
const LISTED: usize = 3;

type Row = (PlannedRun, Done);

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

/// A figure of every run that has it, as a number.
struct Figure<'a> {
    name: String,
    /// The run, and its value.
    values: Vec<(&'a PlannedRun, f64)>,
}

impl Figure<'_> {
    /// Its value, if all runs have the same.
    fn constant(&self) -> Option<f64> {
        let (_, first) = self.values.first()?;
        let same = |(_, value): &(&PlannedRun, f64)| value == first;
        self.values.iter().all(same).then_some(*first)
    }
}

/// The figures to be shown: numbers, and the share of runs that end neutralised.
fn figures<'a>(plan: &Plan, rows: &'a [Row]) -> Vec<Figure<'a>> {
    let of = |(key, kind): &(String, Kind)| {
        let value = |done: &Done| {
            let value = done.result.as_ref().ok()?.get(key)?;
            match kind {
                Kind::Number => value.as_f64(),
                Kind::Text if key == "outcome" => {
                    let won = value.as_str() == Some(Outcome::Neutralised.name());
                    Some(f64::from(u8::from(won)))
                }
                Kind::Text => None,
            }
        };
        let values: Vec<(&PlannedRun, f64)> = (rows.iter())
            .filter_map(|(run, done)| Some((run, value(done)?)))
            .collect();
        let name = match kind {
            Kind::Number => key.clone(),
            Kind::Text => "share neutralised".to_owned(),
        };
        (!values.is_empty()).then_some(Figure { name, values })
    };
    plan.figures.iter().filter_map(of).collect()
}

/// A group of runs by a factor: its label, its place on an axis, and whether a run is in it.
struct Group {
    label: String,
    place: Option<f64>,
    /// Numbers of the runs in it.
    runs: Vec<u64>,
}

/// The runs by the values of a factor; those of a sampled range in groups of equal size.
fn groups(rows: &[Row], factor: usize) -> Vec<Group> {
    let setting = |run: &PlannedRun| run.settings[factor].clone();
    let mut runs: Vec<&PlannedRun> = rows.iter().map(|(run, _)| run).collect();
    let mut groups: Vec<Group> = Vec::new();
    for run in &runs {
        let setting = setting(run);
        match groups.iter_mut().find(|group| group.label == setting.label) {
            Some(group) => group.runs.push(run.index),
            None => groups.push(Group {
                label: setting.label,
                place: setting.number,
                runs: vec![run.index],
            }),
        }
        if groups.len() > 4 * BINS {
            break;
        }
    }
    if groups.len() > 4 * BINS {
        let number = |run: &PlannedRun| run.settings[factor].number.unwrap_or(0.0);
        runs.sort_by(|a, b| number(a).total_cmp(&number(b)));
        return runs
            .chunks(runs.len().div_ceil(BINS))
            .map(|part| {
                let (from, to) = (number(part[0]), number(part[part.len() - 1]));
                let mean = part.iter().map(|run| number(run)).sum::<f64>() / part.len() as f64;
                Group {
                    label: format!("{from:.4} to {to:.4}"),
                    place: Some(mean),
                    runs: part.iter().map(|run| run.index).collect(),
                }
            })
            .collect();
    }
    if groups.iter().all(|group| group.place.is_some()) {
        groups.sort_by(|a, b| a.place.unwrap_or(0.0).total_cmp(&b.place.unwrap_or(0.0)));
    }
    groups
}

fn body(plan: &Plan, rows: &[Row]) -> Markup {
    let figures = figures(plan, rows);
    let by_factor: Vec<Vec<Group>> = (0..plan.factors.len())
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
            }
        }
        @if let Some(figure) = figures.iter().find(|figure| figure.constant().is_none()) {
            (extremes(plan, figure))
        }
        (note("Intervals are 95 %: of means by Student's t, of shares by Wilson. What a run does not have, such as the \
               time of what never happened, is not in the means; n counts the runs that have it."))
    }
}

/// Curves, tables and the heat map of a figure.
fn effects(plan: &Plan, figure: &Figure, by_factor: &[Vec<Group>]) -> Markup {
    html! {
        div .charts {
            @for (factor, groups) in by_factor.iter().enumerate() {
                (curves(plan, figure, by_factor, factor, groups))
            }
        }
        @for (factor, groups) in by_factor.iter().enumerate() {
            (effect(&plan.factors[factor].name, figure, groups))
        }
        @if let [first, second, ..] = by_factor {
            (heat_map(plan, figure, first, second))
        }
    }
}

/// The values of a figure in some runs.
fn values_in(figure: &Figure, runs: &[&[u64]]) -> Vec<f64> {
    let inside = |index: u64| runs.iter().all(|runs| runs.contains(&index));
    (figure.values.iter())
        .filter(|(run, _)| inside(run.index))
        .map(|(_, value)| *value)
        .collect()
}

/// Mean and its interval; of a share Wilson's.
fn estimate(figure: &Figure, values: &[f64]) -> Option<(f64, [f64; 2])> {
    if figure.name.starts_with("share") {
        let rate = Rate::count(values.iter().map(|value| *value > 0.5));
        return Some((rate.rate?, rate.interval_95));
    }
    let mean = Mean::of(values);
    let (middle, half) = (mean.mean?, mean.half_95.unwrap_or(0.0));
    Some((middle, [middle - half, middle + half]))
}

/// A figure over a factor of numbers, a line for each value of another factor that has few.
fn curves(
    plan: &Plan,
    figure: &Figure,
    by_factor: &[Vec<Group>],
    factor: usize,
    groups: &[Group],
) -> Markup {
    let places: Vec<f64> = groups.iter().filter_map(|group| group.place).collect();
    if places.len() < groups.len() || places.len() < 2 {
        return html! {};
    }
    let by = (by_factor.iter().enumerate())
        .find(|(other, groups)| *other != factor && (2..=MOST_LINES).contains(&groups.len()));
    let lines: Vec<(String, Series)> = match by {
        Some((other, others)) => others
            .iter()
            .map(|line| {
                let name = format!("{} {}", plan.factors[other].name, line.label);
                (name, series(figure, groups, Some(&line.runs)))
            })
            .collect(),
        None => vec![(String::new(), series(figure, groups, None))],
    };
    let named: Vec<(&str, &Series)> = lines.iter().map(|(n, s)| (n.as_str(), s)).collect();
    let chart = Chart {
        title: &figure.name,
        unit: "",
        scale: Scale::Linear,
        series: &named,
        limit: None,
    };
    let [low, high] = [places[0], places[places.len() - 1]];
    chart.figure(&Across::values(&plan.factors[factor].name, low, high))
}

/// Means over a factor, then a whisker for each: a stroke of its own behind a gap.
fn series(figure: &Figure, groups: &[Group], among: Option<&[u64]>) -> Series {
    let estimates: Vec<(f64, f64, [f64; 2])> = (groups.iter())
        .filter_map(|group| {
            let runs: Vec<&[u64]> = std::iter::once(&group.runs[..]).chain(among).collect();
            let (mean, interval) = estimate(figure, &values_in(figure, &runs))?;
            Some((group.place?, mean, interval))
        })
        .collect();
    let mut series: Series = estimates.iter().map(|(x, mean, _)| (*x, *mean)).collect();
    for (x, _, [low, high]) in estimates {
        series.extend([(x, f64::NAN), (x, low), (x, high)]);
    }
    series
}

/// The main effect of a factor: the figure by its values.
fn effect(name: &str, figure: &Figure, groups: &[Group]) -> Markup {
    let row = |group: &Group| {
        let values = values_in(figure, &[&group.runs]);
        let cells = match estimate(figure, &values) {
            Some((mean, [low, high])) => [mean, low, high].map(|x| format!("{x:.4}")),
            None => ["–"; 3].map(String::from),
        };
        let mut row = vec![group.label.clone()];
        row.extend(cells);
        row.push(values.len().to_string());
        row
    };
    let rows: Vec<Vec<String>> = groups.iter().map(row).collect();
    table(&[name, "mean", "from", "to", "n"], &rows)
}

/// The means over two factors, as cells shaded from the smallest to the largest.
fn heat_map(plan: &Plan, figure: &Figure, down: &[Group], across: &[Group]) -> Markup {
    let mean = |a: &Group, b: &Group| {
        let values = values_in(figure, &[&a.runs, &b.runs]);
        estimate(figure, &values).map(|(mean, _)| mean)
    };
    let cells: Vec<Vec<Option<f64>>> = (down.iter())
        .map(|a| across.iter().map(|b| mean(a, b)).collect())
        .collect();
    let all = || cells.iter().flatten().flatten().copied();
    let (low, high) = (
        all().fold(f64::INFINITY, f64::min),
        all().fold(f64::NEG_INFINITY, f64::max),
    );
    let share = |value: f64| match high > low {
        true => 70.0 * (value - low) / (high - low),
        false => 0.0,
    };
    html! {
        div .scroll {
            table {
                tr {
                    th { (plan.factors[0].name) " ↓ " (plan.factors[1].name) " →" }
                    @for group in across { th { (group.label) } }
                }
                @for (group, row) in down.iter().zip(&cells) {
                    tr {
                        td { (group.label) }
                        @for cell in row {
                            @match cell {
                                Some(value) => td .n style=(format_args!(
                                    "background:color-mix(in srgb,var(--s0) {:.0}%,transparent)", share(*value)
                                )) { (format_args!("{value:.3}")) },
                                None => td .n { "–" },
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The runs with the largest and the smallest values of a figure, and the commands that make them again.
fn extremes(plan: &Plan, figure: &Figure) -> Markup {
    let mut runs = figure.values.clone();
    runs.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.index.cmp(&b.0.index)));
    let row = |(run, value): &(&PlannedRun, f64)| {
        let settings: Vec<&str> = run.settings.iter().map(|s| s.label.as_str()).collect();
        vec![
            format!("{value:.4}"),
            run.index.to_string(),
            settings.join(", "),
            plan.command(run),
        ]
    };
    let head = [
        figure.name.as_str(),
        "run",
        "factors",
        "runs it again; `view` in place of `run` shows it",
    ];
    let last = runs
        .len()
        .saturating_sub(LISTED)
        .max(LISTED.min(runs.len()));
    let rows: Vec<Vec<String>> = (runs.iter().take(LISTED))
        .chain(&runs[last..])
        .map(row)
        .collect();
    html! {
        h2 { "Largest and smallest" }
        (table(&head, &rows))
    }
}
