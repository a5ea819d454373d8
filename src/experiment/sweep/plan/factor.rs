//! A factor and its values: in a list, on a grid, or anywhere in a range.

use super::file::{FactorConfig, Level};
use std::collections::BTreeSet;

/// A factor's value in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// As the table has it.
    pub label: String,
    /// The number that it is, if it is one.
    pub number: Option<f64>,
    /// The changes to the scenario.
    pub set: Vec<String>,
}

/// A factor, ready to use.
#[derive(Clone, Debug, PartialEq)]
pub struct Factor {
    /// Name of its column.
    pub name: String,
    pub(super) values: Values,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    List(Vec<Setting>),
    Range {
        key: String,
        ends: [f64; 2],
        steps: u32,
        log: bool,
        whole: bool,
    },
}

impl Factor {
    pub(super) fn of(config: &FactorConfig) -> Self {
        let key = config.key.clone().unwrap_or_default();
        let listed = |value: &toml::Value| {
            let label = match value {
                toml::Value::String(text) => text.clone(),
                // The shortest text that is this number, with an exponent where it is long.
                toml::Value::Float(number) => format!("{number:?}"),
                other => other.to_string(),
            };
            let whole = value.as_integer().map(|whole| whole as f64);
            Setting {
                label,
                number: value.as_float().or(whole),
                set: vec![format!("{key}={value}")],
            }
        };
        let level = |level: &Level| Setting {
            label: level.name.clone(),
            number: level.name.parse().ok(),
            set: level.set.clone(),
        };
        let values = match (&config.values, &config.levels, config.range) {
            (Some(values), ..) => Values::List(values.iter().map(listed).collect()),
            (_, Some(levels), _) => Values::List(levels.iter().map(level).collect()),
            (.., range) => Values::Range {
                key,
                ends: range.unwrap_or_default(),
                steps: config.steps.unwrap_or(2),
                log: config.log,
                whole: config.whole,
            },
        };
        Self {
            name: config.name().to_owned(),
            values,
        }
    }

    /// Values in a grid.
    pub(super) fn count(&self) -> u64 {
        match &self.values {
            Values::List(list) => list.len() as u64,
            Values::Range { steps, .. } => u64::from(*steps),
        }
    }

    /// The value of this number in a grid.
    pub(super) fn at(&self, index: u64) -> Setting {
        match &self.values {
            Values::List(list) => list[index as usize % list.len()].clone(),
            Values::Range { steps, .. } => {
                self.in_range(index as f64 / f64::from((*steps).max(2) - 1), false)
            }
        }
    }

    /// The value at a place from 0 to 1 of the factor's values, each of them as likely.
    pub(super) fn between(&self, u: f64) -> Setting {
        match &self.values {
            Values::List(list) => {
                let index = (u * list.len() as f64) as usize;
                list[index.min(list.len() - 1)].clone()
            }
            Values::Range { .. } => self.in_range(u, true),
        }
    }

    /// The value at a place from 0 to 1 of a range. Of whole numbers each is as likely, or the nearest is taken.
    fn in_range(&self, u: f64, likely: bool) -> Setting {
        let Values::Range {
            key,
            ends: [from, to],
            log,
            whole,
            ..
        } = &self.values
        else {
            return self.at(0);
        };
        // The last number has as much of the range as each other one.
        let beyond = if *whole && likely { to + 1.0 } else { *to };
        let value = match log {
            // Not by powers of the ratio: the ends are to be what the file says.
            true if u > 0.0 && u < 1.0 => (from.ln() + u * (beyond.ln() - from.ln())).exp(),
            _ if u >= 1.0 => *to,
            _ => from + u * (beyond - from),
        };
        let (value, label) = match whole {
            true => {
                let near = if likely { value.floor() } else { value.round() };
                let value = near.clamp(*from, *to);
                (value, format!("{}", value as i64))
            }
            false => (value, format!("{value:?}")),
        };
        Setting {
            set: vec![format!("{key}={label}")],
            label,
            number: Some(value),
        }
    }

    /// A value that a grid would take twice, or a list holds twice.
    pub(super) fn repeated(&self, grid: bool) -> Option<String> {
        let labels: Vec<String> = match &self.values {
            Values::List(list) => list.iter().map(|setting| setting.label.clone()).collect(),
            Values::Range { whole: true, .. } if grid => (0..self.count())
                .map(|index| self.at(index).label)
                .collect(),
            Values::Range { .. } => Vec::new(),
        };
        let mut seen = BTreeSet::new();
        labels.into_iter().find(|label| !seen.insert(label.clone()))
    }
}
