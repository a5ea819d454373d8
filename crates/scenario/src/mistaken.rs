//! Files of one kind that are given where another kind is wanted.

use boresight_common::output::quoted;
use toml::de::{DeTable, DeValue};

/// A file of another kind than the wanted one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mistaken {
    /// The key that shows it.
    pub key: &'static str,
    /// What it is.
    pub is: &'static str,
    /// What it is not.
    pub wanted: &'static str,
    /// The command that takes it, and what else there is to do, with `FILE` where its path goes.
    pub mend: &'static str,
}

impl Mistaken {
    /// What is said of such a file.
    pub(super) fn message(&self, file: &str) -> String {
        let Self {
            key,
            is,
            wanted,
            mend,
        } = self;
        let mend = mend.replace("FILE", &quoted(file));
        format!("{key}: this file is {is}, not {wanted}: {mend}")
    }
}

/// Keys that a scenario has at its top and an experiment has not.
const OF_SCENARIOS: [&str; 4] = ["site", "uavs", "swarms", "station"];

impl Mistaken {
    /// An experiment where a scenario is wanted: it varies factors, or names the scenario that it varies.
    pub fn experiment(document: &DeTable) -> Option<Self> {
        if OF_SCENARIOS.iter().any(|key| document.contains_key(*key)) {
            return None;
        }
        let named = |key: &str| document.get(key).map(|value| value.get_ref());
        let key = match (named("factors"), named("scenario")) {
            (Some(DeValue::Array(_)), _) => "factors",
            (_, Some(DeValue::String(_))) => "scenario",
            _ => return None,
        };
        Some(Self {
            key,
            is: "an experiment",
            wanted: "a scenario",
            mend: "carry it out with `boresight sweep FILE --out FOLDER`, or give the scenario that it names",
        })
    }

    /// A scenario where an experiment is wanted.
    pub fn scenario(document: &DeTable) -> Option<Self> {
        let of_experiment = ["factors", "scenario"];
        if of_experiment.iter().any(|key| document.contains_key(*key)) {
            return None;
        }
        let key = OF_SCENARIOS
            .into_iter()
            .find(|key| document.contains_key(*key))?;
        Some(Self {
            key,
            is: "a scenario",
            wanted: "an experiment",
            mend: "run it with `boresight run FILE`, or write an experiment that names it in its key scenario",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_names_the_file() {
        let document = DeTable::parse("[[factors]]\nkey = 'k'").unwrap();
        let mistaken = Mistaken::experiment(document.get_ref()).unwrap();
        assert_eq!(
            mistaken.message("my sweeps/a.toml"),
            "factors: this file is an experiment, not a scenario: carry it out with `boresight sweep 'my sweeps/a.toml' \
             --out FOLDER`, or give the scenario that it names"
        );
    }

    type Judge = fn(&DeTable) -> Option<Mistaken>;

    fn key(judge: Judge, text: &str) -> Option<&'static str> {
        let document = DeTable::parse(text).unwrap();
        judge(document.get_ref()).map(|mistaken| mistaken.key)
    }

    #[test]
    fn kinds_are_told_by_their_keys() {
        let experiment = |text: &str| key(Mistaken::experiment, text);
        assert_eq!(
            experiment("name = 'x'\n[[factors]]\nkey = 'k'"),
            Some("factors")
        );
        assert_eq!(
            experiment("name = 'x'\nscenario = 's.toml'"),
            Some("scenario")
        );
        // A scenario with a key too many stays a scenario.
        assert_eq!(experiment("scenario = 's'\n[site]\naltitude_m = 1"), None);
        assert_eq!(experiment("factors = 3"), None);
        assert_eq!(experiment("name = 'x'"), None);
        let scenario = |text: &str| key(Mistaken::scenario, text);
        assert_eq!(scenario("name = 'x'\n[site]\naltitude_m = 1"), Some("site"));
        assert_eq!(scenario("[[swarms]]\ncount = 1"), Some("swarms"));
        assert_eq!(
            scenario("scenario = 's.toml'\n[site]\naltitude_m = 1"),
            None
        );
        assert_eq!(scenario("name = 'x'"), None);
    }
}
