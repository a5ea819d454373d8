//! What an ablation leaves out.

use crate::scenario::InputError;
use crate::scenario::check::Check;
use crate::scenario::load::{self, Checked};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What is left out, one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// What it is for, for people.
    #[serde(default)]
    pub description: String,
    /// Each thing left out.
    pub without: Vec<Without>,
}

/// A term or a rule that is left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Without {
    /// Its name: lower-case letters, digits and hyphens, since a folder is called so.
    pub name: String,
    /// What it does, in a sentence.
    pub does: String,
    /// Changes to a scenario that leave it out, as `--set` takes them.
    pub set: Vec<String>,
}

impl Checked for Rules {
    fn check(&self, check: &mut Check) {
        check.that(!self.without.is_empty(), "without", || {
            "there is nothing to leave out; name something".into()
        });
        for (index, without) in self.without.iter().enumerate() {
            let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            let plain = !without.name.is_empty() && without.name.chars().all(letters);
            let again = (self.without[..index].iter()).any(|other| other.name == without.name);
            check.table(&format!("without[{index}]"), |check| {
                check.that(plain, "name", || {
                    "give lower-case letters, digits and hyphens: a folder is called so".into()
                });
                check.that(!again, "name", || {
                    format!("`{}` is named twice; give another name", without.name)
                });
                check.that(!without.set.is_empty(), "set", || {
                    "nothing is changed; name a value such as \"tracker.tuning.cue_for=0\"".into()
                });
            });
        }
    }
}

impl Rules {
    /// Reads and checks a file.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        let path = crate::data::found(path);
        let parsed = load::parse(&load::read(&path)?, &path.display().to_string(), &[])?;
        Ok(parsed.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    #[test]
    fn what_the_shipped_recipe_sets_can_be_set() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let rules = Rules::load(&root.join("recipes/ablation.toml")).unwrap();
        assert!(rules.without.len() > 20);
        for rule in &rules.without {
            let path = root.join("scenarios/urban_intercept.toml");
            let before = Scenario::load(&path, &[]).unwrap().scenario;
            let after = Scenario::load(&path, &rule.set).unwrap().scenario;
            assert_ne!(before.tracker, after.tracker, "{}", rule.name);
        }
    }
}
