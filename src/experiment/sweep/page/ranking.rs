//! What of an experiment counts most for a figure: its factors by rank, and the runs at both ends.

use super::figure::{Figure, Values, estimate, values};
use super::groups::{Grouped, shown};
use crate::experiment::sweep::plan::{Plan, PlannedRun};
use crate::report::page::{percent, table};
use maud::{Markup, html};

/// Best and worst runs that are listed.
const LISTED: usize = 3;

/// Share of the variance among runs that the means of groups make up, less what groups of so many would make up by
/// chance: Kelley's epsilon squared (Proc. Natl. Acad. Sci. 21 (1935) 554; recalled), at least 0. `None` where each run
/// is a group of its own, or none differs.
fn explained(groups: &[Values]) -> Option<f64> {
    let all = || groups.iter().flatten().map(|(_, value)| *value);
    let filled = || groups.iter().filter(|values| !values.is_empty());
    let (runs, count) = (all().count(), filled().count());
    if runs <= count || count < 2 {
        return None;
    }
    let mean =
        |values: &Values| values.iter().map(|(_, value)| value).sum::<f64>() / values.len() as f64;
    let middle = all().sum::<f64>() / runs as f64;
    let total: f64 = all().map(|value| (value - middle).powi(2)).sum();
    let within: f64 = filled()
        .map(|values| {
            let mean = mean(values);
            values
                .iter()
                .map(|(_, value)| (value - mean).powi(2))
                .sum::<f64>()
        })
        .sum();
    let by_chance = (runs - 1) as f64 / (runs - count) as f64;
    (total > 0.0).then(|| (1.0 - by_chance * within / total).max(0.0))
}

/// The factors of an experiment by what they do to a figure, the strongest first; nothing of a single one.
pub(super) fn ranking(plan: &Plan, figure: &Figure, by_factor: &[Grouped]) -> Markup {
    if by_factor.len() < 2 {
        return html! {};
    }
    let mut ranks: Vec<Rank> = (plan.factors.iter().zip(by_factor))
        .map(|(factor, grouped)| Rank::of(&factor.name, figure, grouped))
        .collect();
    // Equal ones stay in the order of the file.
    let strength = |rank: &Rank| rank.explained.unwrap_or(-1.0);
    ranks.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
    let row = |(place, rank): (usize, &Rank)| {
        let end = |end: &Option<(String, f64)>| match end {
            Some((label, mean)) => format!("{} at {label}", shown(*mean)),
            None => "–".to_owned(),
        };
        vec![
            (place + 1).to_string(),
            rank.factor.clone(),
            percent(rank.explained),
            end(&rank.least),
            end(&rank.most),
        ]
    };
    let rows: Vec<Vec<String>> = ranks.iter().enumerate().map(row).collect();
    let head = ["", "factor", "variance", "smallest mean", "largest mean"];
    html! {
        h3 { "Factors by rank" }
        (table(&head, &rows))
    }
}

/// What a factor does to a figure.
#[derive(Debug, PartialEq)]
struct Rank {
    /// The factor.
    factor: String,
    /// Share of the variance that its values explain.
    explained: Option<f64>,
    /// Its values with the smallest and the largest mean, and these.
    least: Option<(String, f64)>,
    most: Option<(String, f64)>,
}

impl Rank {
    fn of(factor: &str, figure: &Figure, grouped: &Grouped) -> Self {
        let values = values(figure, grouped.groups.len(), |run| grouped.of_run[run]);
        let means: Vec<(&String, f64)> = (grouped.groups.iter().zip(&values))
            .filter_map(|(group, values)| Some((&group.label, estimate(figure, values)?.0)))
            .collect();
        let own = |end: Option<&(&String, f64)>| end.map(|(label, mean)| ((*label).clone(), *mean));
        Self {
            factor: factor.to_owned(),
            explained: explained(&values),
            least: own(means.iter().min_by(|a, b| a.1.total_cmp(&b.1))),
            // Of equal ones the first, too.
            most: own(means.iter().rev().max_by(|a, b| a.1.total_cmp(&b.1))),
        }
    }
}

/// The runs with the largest and the smallest values of a figure, and the commands that make them again.
pub(super) fn extremes(plan: &Plan, figure: &Figure) -> Markup {
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
        h3 { "Largest and smallest" }
        (table(&head, &rows))
    }
}

#[cfg(test)]
mod tests {
    use super::super::groups::Group;
    use super::*;

    fn groups(values: &[&[f64]]) -> Vec<Values> {
        let with_seeds =
            |values: &&[f64]| -> Values { (1..).zip(values.iter().copied()).collect() };
        values.iter().map(with_seeds).collect()
    }

    #[test]
    fn a_factor_explains_what_its_groups_have_apart() {
        // Nothing within the groups: all of it.
        let all = explained(&groups(&[&[1.0, 1.0], &[3.0, 3.0]]));
        assert_eq!(all, Some(1.0));
        // Nothing between them: less than chance, so none.
        let none = explained(&groups(&[&[1.0, 3.0], &[1.0, 3.0]]));
        assert_eq!(none, Some(0.0));
        // Squares about the mean of all: 6, about those of the groups: 2. Of 4 runs in 2 groups: 1 - 3/2 * 2/6.
        let root = 2f64.sqrt();
        let some = explained(&groups(&[&[0.0, root], &[2.0, 2.0 + root]]));
        assert!((some.unwrap() - 0.5).abs() < 1e-12, "{some:?}");
        // A run a group says nothing, nor do runs that are all alike.
        assert_eq!(explained(&groups(&[&[1.0], &[2.0]])), None);
        assert_eq!(explained(&groups(&[&[1.0, 1.0], &[1.0, 1.0]])), None);
        assert_eq!(explained(&groups(&[&[1.0, 2.0], &[]])), None);
    }

    #[test]
    fn a_rank_names_the_values_at_both_ends() {
        let run = |index: u64| PlannedRun {
            index,
            settings: Vec::new(),
            seed: index % 2,
        };
        let runs: Vec<PlannedRun> = (0..6).map(run).collect();
        let figure = Figure {
            name: "leakers".into(),
            share: false,
            seeds: true,
            range: [0.0, f64::INFINITY],
            values: runs.iter().zip([4.0, 6.0, 1.0, 1.0, 2.0, 4.0]).collect(),
        };
        let group = |label: &str| Group {
            label: label.into(),
            place: None,
        };
        let by = |of_run: [usize; 6]| Grouped {
            groups: ["a", "b", "c"].map(group).into(),
            of_run: of_run.into(),
            whole: false,
        };
        let strong = Rank::of("strong", &figure, &by([0, 0, 1, 1, 2, 2]));
        assert_eq!(strong.most, Some(("a".into(), 5.0)));
        assert_eq!(strong.least, Some(("b".into(), 1.0)));
        let weak = Rank::of("weak", &figure, &by([0, 1, 0, 1, 2, 2]));
        assert!(strong.explained > weak.explained, "{strong:?} {weak:?}");
    }
}
