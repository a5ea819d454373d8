//! The runs of an experiment by the values of a factor.

use crate::experiment::sweep::plan::PlannedRun;
use crate::experiment::sweep::run::Done;
use std::collections::BTreeMap;

/// Groups into which the values of a sampled range are put.
const BINS: usize = 8;

pub(super) type Row = (PlannedRun, Done);

/// A group of runs by a factor: its label, and its place on an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    pub(super) label: String,
    pub(super) place: Option<f64>,
}

/// The runs by the values of a factor.
#[derive(Debug, PartialEq)]
pub(super) struct Grouped {
    pub(super) groups: Vec<Group>,
    /// The group of each run, by the run's number.
    pub(super) of_run: Vec<usize>,
    /// Whether the values are whole numbers.
    pub(super) whole: bool,
}

/// The runs by the values of a factor; many numbers in groups of about equal size, all runs of a value in one.
pub(super) fn groups(rows: &[Row], factor: usize) -> Grouped {
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
        return Grouped {
            groups,
            of_run,
            whole: false,
        };
    }
    let whole = groups
        .iter()
        .all(|group| group.place.is_some_and(|place| place.fract() == 0.0));
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
        whole,
    }
}

/// A number to five digits.
pub(super) fn shown(value: f64) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::sweep::plan::Setting;
    use crate::experiment::sweep::run::Down;

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
    fn numbers_know_whether_they_are_whole() {
        let whole = |values: &[f64]| {
            let values = values.iter().map(|value| (value.to_string(), Some(*value)));
            groups(&rows(values), 0).whole
        };
        assert!(whole(&[1.0, 4.0, 16.0]));
        assert!(!whole(&[1.0, 1.5, 2.0]));
        assert!(!groups(&rows([("day".to_owned(), None)]), 0).whole);
    }

    #[test]
    fn many_numbers_are_put_into_groups_and_words_are_not() {
        let words = (0..40).map(|n| (format!("level {n}"), None));
        assert_eq!(groups(&rows(words), 0).groups.len(), 40);
        // Small numbers, most of them several times; the last far more often than the others.
        let number = |n: u32| f64::from(n.min(60)) * 1e-15;
        let numbers = (0..200).map(|n| (format!("{:?}", number(n)), Some(number(n))));
        let Grouped { groups, of_run, .. } = groups(&rows(numbers), 0);
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
}
