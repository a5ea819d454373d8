//! What the factors do to a figure: curves, tables and heat maps.

use super::figure::{Figure, Values, estimate, values};
use super::groups::{Group, Grouped, shown};
use crate::experiment::sweep::plan::Plan;
use crate::report::chart::{Across, Chart, Series};
use crate::report::page::table;
use maud::{Markup, html};

/// Lines of a chart by the values of another factor.
pub(super) const MOST_LINES: usize = 3;

/// Curves, tables and the heat map of a figure.
pub(super) fn effects(plan: &Plan, figure: &Figure, by_factor: &[Grouped]) -> Markup {
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

/// A figure over a factor of numbers, a line for each value of another factor that has few.
fn curves(plan: &Plan, figure: &Figure, by_factor: &[Grouped], factor: usize) -> Markup {
    let Grouped {
        groups,
        of_run,
        whole,
    } = &by_factor[factor];
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
        scale: figure.scale(),
        series: &named,
        limit: None,
    };
    let [low, high] = [places[0], places[places.len() - 1]];
    let across = Across::values(&plan.factors[factor].name, low, high, *whole);
    chart.figure(&across)
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
