//! What the engagements add up to.

use super::belief::Calibration;
use super::job::Outcome;
use super::recipe::Rules;
use super::verdict::{
    Cause, HELD_SHARE, IN_TIME_S, VISIBLE_S, What, clutter_band, nearness_name, size_band,
};
use crate::models::maths::statistics::Rate;
use crate::report::page::percent;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Everything that was measured, as `results.json` has it.
#[derive(Serialize)]
pub struct Results {
    /// Version of the program.
    pub version: &'static str,
    /// The command that repeats the evaluation.
    pub command: String,
    /// What found the UAVs: `rendered pixels` or `truth detector`.
    pub detector: &'static str,
    /// What was left out, where it was stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// The rules of fire among which each engagement has one.
    pub rules: Vec<Rules>,
    /// Shares of all engagements.
    pub headline: Vec<Line>,
    /// The same by what was drawn.
    pub groups: Vec<Group>,
    /// Failures by cause.
    pub causes: BTreeMap<&'static str, usize>,
    /// How right the tracker's beliefs were.
    pub beliefs: Calibration,
    /// Every engagement.
    pub draws: Vec<Outcome>,
}

/// One share of the headline.
#[derive(Serialize)]
pub struct Line {
    /// What is counted, of what.
    pub name: String,
    /// How often.
    pub rate: Rate,
}

/// The shares by one property.
#[derive(Serialize)]
pub struct Group {
    /// The property.
    pub by: &'static str,
    /// Its values.
    pub rows: Vec<Row>,
}

/// The shares of the engagements with one value of a property.
#[derive(Serialize)]
pub struct Row {
    /// The value.
    pub name: String,
    /// Engagements.
    pub draws: usize,
    /// The shares.
    #[serde(flatten)]
    pub shares: Shares,
}

/// The shares of some engagements.
#[derive(Serialize)]
pub struct Shares {
    /// The UAV was visible, of all.
    pub visible: Rate,
    /// The coarse camera held the UAV, of the visible.
    pub acquired: Rate,
    /// It was held for [`HELD_SHARE`] of the time from then on, of the acquired.
    pub held: Rate,
    /// Share of the time of all acquired for which it was held.
    pub held_time: Option<f64>,
    /// Given up though shown, of the acquired.
    pub given_up: Rate,
    /// What came of fire, by its rules.
    pub by_rules: Vec<Fire>,
}

/// What came of fire by some rules.
#[derive(Serialize)]
pub struct Fire {
    /// Name of the rules.
    pub rules: String,
    /// Engagements by them.
    pub draws: usize,
    /// Their interlocks were open, of the visible.
    pub open: Rate,
    /// Neutralised in time, of the visible whose interlocks were open.
    pub neutralised: Rate,
    /// Something else was fired at, of all.
    pub fired_else: Rate,
}

impl Fire {
    fn of(rules: &Rules, outcomes: &[&Outcome]) -> Self {
        let by: Vec<&Outcome> = (outcomes.iter().copied())
            .filter(|o| o.facts.rules == rules.name)
            .collect();
        let visible = || by.iter().copied().filter(|o| o.verdict.visible);
        Self {
            rules: rules.name.clone(),
            draws: by.len(),
            open: Rate::count(visible().map(|o| o.verdict.open)),
            neutralised: neutralised(visible()),
            fired_else: Rate::count(by.iter().map(|o| o.verdict.fired_else)),
        }
    }
}

impl Shares {
    fn of(outcomes: &[&Outcome], rules: &[Rules]) -> Self {
        let visible = || outcomes.iter().filter(|o| o.verdict.visible);
        let acquired = || visible().filter(|o| o.verdict.acquired);
        let (held_s, after_s) = acquired().fold((0.0, 0.0), |(held_s, after_s), o| {
            let held = o.record.held_s.get(What::Uav.name()).copied();
            (held_s + held.unwrap_or(0.0), after_s + o.record.after_s)
        });
        Self {
            visible: Rate::of(visible().count(), outcomes.len()),
            acquired: Rate::count(visible().map(|o| o.verdict.acquired)),
            held: Rate::count(acquired().filter_map(|o| o.verdict.held())),
            held_time: (after_s > 0.0).then(|| held_s / after_s),
            given_up: Rate::count(acquired().map(|o| o.verdict.given_up)),
            by_rules: rules
                .iter()
                .map(|rules| Fire::of(rules, outcomes))
                .collect(),
        }
    }
}

/// The share neutralised of those whose interlocks were open.
fn neutralised<'a>(outcomes: impl Iterator<Item = &'a Outcome>) -> Rate {
    let open = outcomes.filter(|o| o.verdict.open);
    Rate::count(open.map(|o| o.verdict.neutralised))
}

/// A snake-case word of the recipe in plain words.
fn words(value: &impl Serialize) -> String {
    let name = serde_json::to_value(value).ok();
    let name = name.as_ref().and_then(serde_json::Value::as_str);
    name.unwrap_or_default().replace('_', " ")
}

/// A property by which the shares are told apart.
type Property = (&'static str, fn(&Outcome) -> String);

const PROPERTIES: [Property; 11] = [
    ("model", |o| o.facts.model.clone()),
    ("airframe", |o| {
        let held_out = o.facts.held_out;
        if held_out { "held out" } else { "learned from" }.into()
    }),
    ("city", |o| {
        let real = o.facts.real.as_ref();
        real.map_or("generated".into(), |name| format!("real: {name}"))
    }),
    ("size in the search camera", |o| {
        let size_px = o.record.size_px.map_or(0.0, |[search, _]| search);
        size_band(size_px).into()
    }),
    ("signal-to-clutter ratio before acquisition", |o| {
        clutter_band(&o.record.looks).into()
    }),
    ("background", |o| words(&o.facts.background)),
    ("light", |o| words(&o.facts.light)),
    ("distractors", |o| nearness_name(o.facts.nearness).into()),
    ("kind of distractor", |o| {
        o.facts.distractor.clone().unwrap_or_else(|| "none".into())
    }),
    ("search", |o| {
        if o.facts.cued { "cued" } else { "uncued" }.into()
    }),
    ("flight", |o| words(&o.facts.flight)),
];

impl Outcome {
    /// Whether the UAV was small, how it flew, and the rest, in a line.
    pub fn description(&self) -> String {
        let facts = &self.facts;
        let size = self
            .record
            .size_px
            .map_or("hidden".into(), |[search, precise]| {
                format!("{search:.1} px in the search camera, {precise:.0} px in the precise one")
            });
        let other = facts
            .distractor
            .as_ref()
            .map_or("nothing else".into(), |kind| {
                format!("{} ({kind})", nearness_name(facts.nearness))
            });
        format!(
            "{} at {:.0} m, {}, {size}; before {}, {}; beside it {other}; {}; rules of fire: {}",
            facts.model,
            facts.range_m,
            words(&facts.flight),
            words(&facts.background),
            words(&facts.light),
            if facts.cued { "cued" } else { "uncued" },
            facts.rules,
        )
    }
}

impl Results {
    /// Adds outcomes up.
    pub fn of(
        command: String,
        detector: &'static str,
        rules: Vec<Rules>,
        draws: Vec<Outcome>,
    ) -> Self {
        let all: Vec<&Outcome> = draws.iter().collect();
        let groups = PROPERTIES.iter().map(|(by, value)| {
            let mut rows: BTreeMap<String, Vec<&Outcome>> = BTreeMap::new();
            for outcome in &all {
                rows.entry(value(outcome)).or_default().push(outcome);
            }
            let row = |(name, outcomes): (String, Vec<&Outcome>)| Row {
                name,
                draws: outcomes.len(),
                shares: Shares::of(&outcomes, &rules),
            };
            Group {
                by,
                rows: rows.into_iter().map(row).collect(),
            }
        });
        let causes = Cause::ALL.map(|cause| {
            let failed = all.iter().filter(|o| o.verdict.cause == Some(cause));
            (cause.name(), failed.count())
        });
        Self {
            version: crate::VERSION,
            command,
            detector,
            stopped: None,
            headline: headline(&all, detector, &rules),
            groups: groups.collect(),
            rules,
            causes: causes.into_iter().filter(|(_, count)| *count > 0).collect(),
            beliefs: Calibration::of(&draws),
            draws,
        }
    }

    /// The shares and causes for a terminal.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        for line in &self.headline {
            let _ = writeln!(text, "{:<110}{}", line.name, line.rate.text());
        }
        for (cause, count) in &self.causes {
            let _ = writeln!(text, "failed, {cause:<102}{count}");
        }
        if let Some(stopped) = &self.stopped {
            let _ = writeln!(text, "{stopped}");
        }
        text
    }
}

fn headline(all: &[&Outcome], detector: &str, rules: &[Rules]) -> Vec<Line> {
    let shares = Shares::of(all, rules);
    let held_time = percent(shares.held_time);
    let mut lines = vec![
        (
            format!("UAV visible for {VISIBLE_S} s, of all"),
            shares.visible,
        ),
        ("acquired, of the visible".into(), shares.acquired),
        (
            format!(
                "held for {:.0} % of the time, of the acquired ({held_time} of all time)",
                100.0 * HELD_SHARE
            ),
            shares.held,
        ),
        (
            "given up though seen, of the acquired".into(),
            shares.given_up,
        ),
    ];
    for fire in shares.by_rules {
        let by = format!("by the rules '{}'", fire.rules);
        lines.push((format!("interlocks open, of the visible, {by}"), fire.open));
        for (how, cued) in [("cued", true), ("uncued", false)] {
            let visible = all.iter().copied().filter(|o| o.verdict.visible);
            let these = visible.filter(|o| o.facts.rules == fire.rules && o.facts.cued == cued);
            lines.push((
                format!(
                    "neutralised within {IN_TIME_S} s, of those {how} with open interlocks, {by}"
                ),
                neutralised(these),
            ));
        }
        lines.push((
            format!("fired at something else, of all, {by}"),
            fire.fired_else,
        ));
    }
    let line = |(name, rate): (String, Rate)| Line {
        name: format!("{detector}: {name}"),
        rate,
    };
    lines.into_iter().map(line).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::eval::engagement::recipe::Recipe;
    use crate::eval::engagement::verdict::{Record, Verdict};

    const SHIPPED: &str = include_str!("../../../recipes/engagement.toml");

    /// An engagement that was won, or that never was allowed.
    pub fn outcome(index: u32, rules: &str, held_out: bool, won: bool) -> Outcome {
        let facts = serde_json::json!({
            "index": index, "model": "m", "held_out": held_out, "real": null, "rules": rules, "flight": "hover",
            "range_m": 500.0, "background": "city", "light": "day", "metar": "", "cloud_texture": false,
            "cued": true, "nearness": "none", "distractor": null,
        });
        let record = Record {
            visible_s: 20.0,
            shown_s: 20.0,
            visible_from_s: Some(0.0),
            acquired_s: Some(1.0),
            neutralised_s: won.then_some(5.0),
            open_s: if won { 5.0 } else { 0.0 },
            ..Record::default()
        };
        Outcome {
            key: String::new(),
            facts: serde_json::from_value(facts).unwrap(),
            verdict: Verdict::of(&record),
            record,
            command: String::new(),
            pictures: Vec::new(),
        }
    }

    #[test]
    fn fire_is_counted_by_its_rules_and_each_is_named() {
        let rules = Recipe::parse(SHIPPED, "r.toml").unwrap().rules;
        let draws = vec![
            outcome(0, "default", true, false),
            outcome(1, "default", false, true),
            outcome(2, "loose", true, true),
        ];
        let results = Results::of(String::new(), "truth detector", rules, draws);
        assert_eq!(results.causes.len(), 0);
        let line = |words: &str| {
            let named = |line: &&Line| line.name.contains(words);
            let found = results.headline.iter().find(named);
            let rate = found.unwrap_or_else(|| panic!("{words}")).rate;
            (rate.successes, rate.trials)
        };
        assert_eq!(
            line("interlocks open, of the visible, by the rules 'default'"),
            (1, 2)
        );
        assert_eq!(
            line("those cued with open interlocks, by the rules 'default'"),
            (1, 1)
        );
        assert_eq!(
            line("those cued with open interlocks, by the rules 'loose'"),
            (1, 1)
        );
        assert_eq!(
            line("something else, of all, by the rules 'default'"),
            (0, 2)
        );
        let by = |by: &str| results.groups.iter().find(|group| group.by == by).unwrap();
        let [held_out, known] = &by("airframe").rows[..] else {
            panic!("held out and learned from");
        };
        assert_eq!((&held_out.name[..], held_out.draws), ("held out", 2));
        let fire = &held_out.shares.by_rules;
        assert_eq!(
            fire.iter().map(|f| &f.rules[..]).collect::<Vec<_>>(),
            ["default", "loose"]
        );
        assert_eq!(
            (fire[0].neutralised.trials, fire[1].neutralised.trials),
            (0, 1)
        );
        assert_eq!((known.draws, known.shares.by_rules[1].draws), (1, 0));
        assert_eq!(by("city").rows[0].name, "generated");
    }
}
