//! The page of an experiment: main effects with intervals, curves, heat maps, best and worst runs.

use super::plan::{Plan, PlannedRun};
use super::run::Done;
use crate::experiment::ExperimentError;
use crate::experiment::figures::Kind;
use crate::models::engage::outcome::Outcome;
use crate::models::maths::statistics::{Mean, wilson_95};
use crate::output;
use crate::output::quoted;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, note, page, table};
use maud::{Markup, html};
use std::collections::BTreeMap;
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
    /// Whether its values are 1 and 0, of runs that end so and others.
    share: bool,
    /// Whether the runs have several seeds.
    seeds: bool,
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
        let share = *kind == Kind::Text;
        let name = match share {
            false => key.clone(),
            true => "share neutralised".to_owned(),
        };
        let figure = Figure {
            name,
            share,
            seeds: plan.seeds() > 1,
            values,
        };
        (!figure.values.is_empty()).then_some(figure)
    };
    plan.figures.iter().filter_map(of).collect()
}

/// A group of runs by a factor: its label, and its place on an axis.
#[derive(Clone, Debug, PartialEq)]
struct Group {
    label: String,
    place: Option<f64>,
}

/// The runs by the values of a factor.
#[derive(Debug, PartialEq)]
struct Grouped {
    groups: Vec<Group>,
    /// The group of each run, by the run's number.
    of_run: Vec<usize>,
}

/// The runs by the values of a factor; many numbers in groups of about equal size, all runs of a value in one.
fn groups(rows: &[Row], factor: usize) -> Grouped {
    let setting = |run: usize| &rows[run].0.settings[factor];
    // In the order in which they come.
    let mut known: BTreeMap<&str, usize> = BTreeMap::new();
    let mut groups: Vec<Group> = Vec::new();
    let mut of_run: Vec<usize> = (0..rows.len())
        .map(|run| {
            let setting = setting(run);
            *known.entry(&setting.label).or_insert_with(|| {
                groups.push(Group {
                    label: setting.label.clone(),
                    place: setting.number,
                });
                groups.len() - 1
            })
        })
        .collect();
    if groups.iter().any(|group| group.place.is_none()) {
        return Grouped { groups, of_run };
    }
    // Each group's runs, ascending by its number.
    let mut order: Vec<usize> = (0..groups.len()).collect();
    let place = |group: usize| groups[group].place.unwrap_or(0.0);
    order.sort_by(|a, b| place(*a).total_cmp(&place(*b)));
    let mut runs = vec![0; groups.len()];
    of_run.iter().for_each(|group| runs[*group] += 1);
    let most = match groups.len() > 4 * BINS {
        true => rows.len().div_ceil(BINS),
        false => 1,
    };
    let mut merged: Vec<Group> = Vec::new();
    let mut new_of = vec![0; groups.len()];
    let mut waiting = order.as_slice();
    while !waiting.is_empty() {
        let mut size = 0;
        let end = waiting.iter().position(|group| {
            size += runs[*group];
            size >= most
        });
        let (part, rest) = waiting.split_at(end.map_or(waiting.len(), |end| end + 1));
        waiting = rest;
        let (first, last) = (part[0], part[part.len() - 1]);
        let label = match first == last {
            true => groups[first].label.clone(),
            false => format!("{} to {}", shown(place(first)), shown(place(last))),
        };
        let sum: f64 = part.iter().map(|of| place(*of) * runs[*of] as f64).sum();
        let all: usize = part.iter().map(|of| runs[*of]).sum();
        part.iter().for_each(|of| new_of[*of] = merged.len());
        merged.push(Group {
            label,
            place: Some(if first == last {
                place(first)
            } else {
                sum / all as f64
            }),
        });
    }
    of_run.iter_mut().for_each(|group| *group = new_of[*group]);
    Grouped {
        groups: merged,
        of_run,
    }
}

/// A number to five digits.
fn shown(value: f64) -> String {
    const DIGITS: i32 = 5;
    let size = value.abs().log10().floor();
    if value != 0.0 && !(-4.0..f64::from(DIGITS + 1)).contains(&size) {
        return format!("{value:.*e}", DIGITS as usize - 1);
    }
    let size = if value == 0.0 { 0 } else { size as i32 };
    let text = format!("{value:.*}", (DIGITS - 1 - size).max(0) as usize);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
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
            }
        }
        (left(plan, rows, &by_factor))
        @if let Some(figure) = figures.iter().find(|figure| figure.constant().is_none()) {
            (extremes(plan, figure))
        }
        (note(if plan.seeds() > 1 { OVER_SEEDS } else { OVER_RUNS }))
        (note("What a run does not have, such as the time of what never happened, is not in the means; n counts the \
               runs that have it."))
    }
}

/// What the intervals are.
const OVER_SEEDS: &str = "Intervals are 95 %, over the seeds: the runs of a seed share its random numbers, so the other \
    factors are averaged within each seed first. Of means by Student's t, of shares by Wilson with as many trials as there \
    are seeds, which is rather too wide.";
const OVER_RUNS: &str = "There is one seed. Intervals are 95 %, of means by Student's t, of shares by Wilson, over all runs \
    of a group as if each had been drawn by itself: they hold the spread by the other factors, and none by chance.";

/// Curves, tables and the heat map of a figure.
fn effects(plan: &Plan, figure: &Figure, by_factor: &[Grouped]) -> Markup {
    html! {
        div .charts {
            @for factor in 0..by_factor.len() {
                (curves(plan, figure, by_factor, factor))
            }
        }
        @for (factor, grouped) in by_factor.iter().enumerate() {
            (effect(&plan.factors[factor].name, figure, grouped))
        }
        @if let [first, second, ..] = by_factor {
            (heat_map(plan, figure, first, second))
        }
    }
}

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
        let (name, Grouped { groups, of_run }) = (&plan.factors[factor].name, &by_factor[factor]);
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
            scale: Scale::Linear,
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

/// The values of a figure in a group of runs, with their seeds.
type Values = Vec<(u64, f64)>;

/// The values of a figure in each of so many groups; `group` finds that of a run's number.
fn values(figure: &Figure, groups: usize, group: impl Fn(usize) -> usize) -> Vec<Values> {
    let mut values = vec![Values::new(); groups];
    for (run, value) in &figure.values {
        values[group(run.index as usize)].push((run.seed, *value));
    }
    values
}

/// Mean and its interval, which is over the seeds where there are several; one value has none.
fn estimate(figure: &Figure, values: &[(u64, f64)]) -> Option<(f64, Option<[f64; 2]>)> {
    let mut by_seed: BTreeMap<u64, (f64, f64)> = BTreeMap::new();
    for (seed, value) in values {
        let (sum, count) = by_seed.entry(*seed).or_default();
        (*sum, *count) = (*sum + value, *count + 1.0);
    }
    let samples: Vec<f64> = match figure.seeds {
        false => values.iter().map(|(_, value)| *value).collect(),
        true => by_seed.values().map(|(sum, count)| sum / count).collect(),
    };
    let mean = Mean::of(&samples);
    let middle = mean.mean?;
    let interval = match figure.share {
        // However the runs of a seed depend on each other, they say no less than one of them.
        true => Some(wilson_95(middle, samples.len() as f64)),
        false => mean.half_95.map(|half| [middle - half, middle + half]),
    };
    Some((middle, interval))
}

/// A figure over a factor of numbers, a line for each value of another factor that has few.
fn curves(plan: &Plan, figure: &Figure, by_factor: &[Grouped], factor: usize) -> Markup {
    let Grouped { groups, of_run } = &by_factor[factor];
    let places: Vec<f64> = groups.iter().filter_map(|group| group.place).collect();
    if places.len() < groups.len() || places.len() < 2 {
        return html! {};
    }
    let by = (by_factor.iter().enumerate())
        .find(|(other, by)| *other != factor && (2..=MOST_LINES).contains(&by.groups.len()));
    let lines: Vec<(String, Series)> = match by {
        Some((other, by)) => {
            let count = by.groups.len();
            let group = |run: usize| of_run[run] * count + by.of_run[run];
            let values = values(figure, groups.len() * count, group);
            let line = |(index, line): (usize, &Group)| {
                let name = format!("{} {}", plan.factors[other].name, line.label);
                let own = values.iter().skip(index).step_by(count);
                (name, series(figure, groups, own))
            };
            by.groups.iter().enumerate().map(line).collect()
        }
        None => {
            let values = values(figure, groups.len(), |run| of_run[run]);
            vec![(String::new(), series(figure, groups, values.iter()))]
        }
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
fn series<'a>(
    figure: &Figure,
    groups: &[Group],
    values: impl Iterator<Item = &'a Values>,
) -> Series {
    let estimates: Vec<(f64, f64, Option<[f64; 2]>)> = (groups.iter().zip(values))
        .filter_map(|(group, values)| {
            let (mean, interval) = estimate(figure, values)?;
            Some((group.place?, mean, interval))
        })
        .collect();
    let mut series: Series = estimates.iter().map(|(x, mean, _)| (*x, *mean)).collect();
    for (x, _, interval) in estimates {
        if let Some([low, high]) = interval {
            series.extend([(x, f64::NAN), (x, low), (x, high)]);
        }
    }
    series
}

/// The main effect of a factor: the figure by its values.
fn effect(name: &str, figure: &Figure, grouped: &Grouped) -> Markup {
    let values = values(figure, grouped.groups.len(), |run| grouped.of_run[run]);
    let row = |(group, values): (&Group, &Values)| {
        let [mean, low, high] = match estimate(figure, values) {
            Some((mean, Some([low, high]))) => [mean, low, high].map(shown),
            Some((mean, None)) => [shown(mean), "–".into(), "–".into()],
            None => ["–"; 3].map(String::from),
        };
        vec![
            group.label.clone(),
            mean,
            low,
            high,
            values.len().to_string(),
        ]
    };
    let rows: Vec<Vec<String>> = grouped.groups.iter().zip(&values).map(row).collect();
    table(&[name, "mean", "from", "to", "n"], &rows)
}

/// The means over two factors, as cells shaded from the smallest to the largest.
fn heat_map(plan: &Plan, figure: &Figure, down: &Grouped, across: &Grouped) -> Markup {
    let count = across.groups.len();
    let group = |run: usize| down.of_run[run] * count + across.of_run[run];
    let values = values(figure, down.groups.len() * count, group);
    let mean = |values: &Values| estimate(figure, values).map(|(mean, _)| mean);
    let cells: Vec<Option<f64>> = values.iter().map(mean).collect();
    let all = || cells.iter().flatten().copied();
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
                    @for group in &across.groups { th .n { (group.label) } }
                }
                @for (group, row) in down.groups.iter().zip(cells.chunks(count)) {
                    tr {
                        td { (group.label) }
                        @for cell in row {
                            @match cell {
                                Some(value) => td .n style=(format_args!(
                                    "background:color-mix(in srgb,var(--s0) {:.0}%,transparent)", share(*value)
                                )) { (shown(*value)) },
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
            shown(*value),
            run.index.to_string(),
            settings.join(", "),
            plan.command(run),
        ]
    };
    let head = [
        figure.name.as_str(),
        "run",
        "factors",
        "`run` makes it again; `view` of its run.mcap plays it back",
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

#[cfg(test)]
mod tests {
    use super::super::plan::Setting;
    use super::super::run::Down;
    use super::*;

    fn rows(settings: impl IntoIterator<Item = (String, Option<f64>)>) -> Vec<Row> {
        let row = |(index, (label, number)): (usize, (String, Option<f64>))| {
            let run = PlannedRun {
                index: index as u64,
                settings: vec![Setting {
                    label,
                    number,
                    set: Vec::new(),
                }],
                seed: 1,
            };
            let done = Done {
                run: index as u64,
                key: String::new(),
                scenario_hash: String::new(),
                down: Down::default(),
                result: Ok(BTreeMap::new()),
            };
            (run, done)
        };
        settings.into_iter().enumerate().map(row).collect()
    }

    #[test]
    fn many_numbers_are_put_into_groups_and_words_are_not() {
        let words = (0..40).map(|n| (format!("level {n}"), None));
        assert_eq!(groups(&rows(words), 0).groups.len(), 40);
        // Small numbers, most of them several times; the last far more often than the others.
        let number = |n: u32| f64::from(n.min(60)) * 1e-15;
        let numbers = (0..200).map(|n| (format!("{:?}", number(n)), Some(number(n))));
        let Grouped { groups, of_run } = groups(&rows(numbers), 0);
        let labels: Vec<&str> = groups.iter().map(|group| group.label.as_str()).collect();
        assert_eq!(
            labels,
            [
                "0 to 2.4000e-14",
                "2.5000e-14 to 4.9000e-14",
                "5.0000e-14 to 6.0000e-14"
            ]
        );
        assert_eq!(
            (of_run[0], of_run[24], of_run[25], of_run[199]),
            (0, 0, 1, 2)
        );
        assert!(of_run[60..].iter().all(|group| *group == 2), "{of_run:?}");
    }

    #[test]
    fn numbers_keep_their_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1e-15, "1.0000e-15"),
            (2.5e-15, "2.5000e-15"),
            (0.001_234_56, "0.0012346"),
            (-3.25, "-3.25"),
            (1600.0, "1600"),
            (123_456.7, "123457"),
            (1.5e9, "1.5000e9"),
        ] {
            assert_eq!(shown(value), text);
        }
    }

    #[test]
    fn intervals_are_over_the_seeds() {
        let figure = |share, seeds| Figure {
            name: String::new(),
            share,
            seeds,
            values: Vec::new(),
        };
        let estimate = |share, values: &[(u64, f64)]| estimate(&figure(share, true), values);
        // Two points a seed, which differ by the point alone: 1 and 3, 2 and 4, 3 and 5.
        let values = [(1, 1.0), (1, 3.0), (2, 2.0), (2, 4.0), (3, 3.0), (3, 5.0)];
        let (mean, interval) = estimate(false, &values).unwrap();
        // Means 2, 3, 4 of three seeds: 4.3027 / √3.
        let half = 4.302_653 / 3f64.sqrt();
        let [low, high] = interval.unwrap();
        assert_eq!(mean, 3.0);
        assert!((high - 3.0 - half).abs() < 1e-5 && (3.0 - low - half).abs() < 1e-5);
        // One seed: over its runs. One value: none.
        let (mean, interval) = super::estimate(&figure(false, false), &values).unwrap();
        // s = √2, t = 2.5706.
        let half = 2.570_582 * (2.0f64 / 6.0).sqrt();
        assert!((interval.unwrap()[1] - mean - half).abs() < 1e-5);
        assert_eq!(estimate(false, &values[..1]), Some((1.0, None)));
        assert_eq!(estimate(false, &[]), None);
        // Two of three seeds won at both points are no more than two of three.
        let won = [(1, 1.0), (1, 1.0), (2, 1.0), (2, 1.0), (3, 0.0), (3, 0.0)];
        let (share, interval) = estimate(true, &won).unwrap();
        assert_eq!(
            (share, interval),
            (2.0 / 3.0, Some(wilson_95(2.0 / 3.0, 3.0)))
        );
    }
}
