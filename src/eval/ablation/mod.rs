//! `boresight eval ablation`: what each term and rule of the tracker brings.
//!
//! The same engagements are made with all of them and without each. What changes is counted pair by pair, so that a few draws tell
//! much: a draw in which a rule does nothing ends the same to the bit.

mod page;
mod results;
mod rules;

use super::engagement::{self, Drawn};
use super::{EvalError, shared::progress};
use crate::output::{put_json, quoted, writable};
use clap::Args;
use results::{Ablation, Effect};
use rules::Rules;
use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// What `boresight eval ablation` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Number of engagements with all rules, and without each.
    #[arg(long, default_value_t = 100)]
    pub n: u32,
    /// Seed of the draws.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Recipe file of the engagements (TOML).
    #[arg(long, default_value = "recipes/engagement.toml")]
    pub recipe: PathBuf,
    /// What is left out, one after the other (TOML).
    #[arg(long, default_value = "recipes/ablation.toml")]
    pub rules: PathBuf,
    /// Leave out only what has this name; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub only: Vec<String>,
    /// Folder for ablation.json, ablation.html and the engagements; what was stopped goes on in it.
    #[arg(long, default_value = "out/ablation")]
    pub out: PathBuf,
    /// The network on rendered pixels in place of the measured detector: some forty times slower.
    #[arg(long)]
    pub pixels: bool,
    /// Change a value of every scenario; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Draws made side by side, each in a process of its own (default: one a core).
    #[arg(long)]
    pub jobs: Option<NonZeroUsize>,
}

/// No rule has a name that was asked for.
#[derive(Debug, thiserror::Error)]
#[error("--only: there is no `{name}` in {}; it has {}", file.display(), .names.join(", "))]
struct NoSuchRule {
    name: String,
    file: PathBuf,
    names: Vec<String>,
}

/// Carries it out; what to tell the user.
pub fn evaluate(arguments: &Arguments) -> Result<String, EvalError> {
    let mut rules = Rules::load(&arguments.rules)?.without;
    let names = || rules.iter().map(|rule| rule.name.clone()).collect();
    if let Some(name) = (arguments.only.iter()).find(|name| rules.iter().all(|r| r.name != **name))
    {
        return Err(EvalError::own(NoSuchRule {
            name: name.clone(),
            file: arguments.rules.clone(),
            names: names(),
        }));
    }
    rules.retain(|rule| arguments.only.is_empty() || arguments.only.contains(&rule.name));
    let json = arguments.out.join("ablation.json");
    writable(&json)?;
    for rule in &rules {
        engagement::check(&arguments.engagements(&rule.name, &rule.set))?;
    }
    let Drawn {
        draws,
        detector,
        mut stopped,
        ..
    } = engagement::drawn(&arguments.engagements("all", &[]))?;
    let mut effects = Vec::new();
    for rule in rules {
        if stopped.is_some() {
            break;
        }
        progress(&format!("without {}", rule.name));
        match engagement::drawn(&arguments.engagements(&rule.name, &rule.set)) {
            Ok(left_out) if left_out.stopped.is_none() => {
                effects.push(Effect::of(rule, &draws, &left_out.draws));
            }
            Ok(_) | Err(EvalError::Stopped) => {
                let rest = format!("without {} and what follows is left out", rule.name);
                stopped = crate::stop::said(&rest);
            }
            Err(error) => return Err(error),
        }
    }
    let ablation = Ablation {
        version: crate::VERSION,
        command: arguments.command(),
        detector,
        draws: draws.len(),
        stopped,
        rules: effects,
    };
    put_json(&json, &ablation)?;
    let page = arguments.out.join("ablation.html");
    page::write(&page, &ablation)?;
    Ok(format!("{}page  {}", ablation.text(), page.display()))
}

impl Arguments {
    /// The engagements with some changes, in a folder of their own.
    fn engagements(&self, folder: &str, set: &[String]) -> engagement::Arguments {
        let measured = (!self.pixels).then(|| "detector.kind=measured".into());
        engagement::Arguments {
            n: self.n,
            seed: self.seed,
            recipe: self.recipe.clone(),
            rules: None,
            out: self.out.join(folder),
            truth: false,
            looks: false,
            set: (measured.into_iter().chain(self.set.clone()))
                .chain(set.iter().cloned())
                .collect(),
            jobs: self.jobs,
            draw: None,
        }
    }

    /// The command that repeats it.
    fn command(&self) -> String {
        let path = |path: &Path| quoted(path.display());
        let mut command = format!(
            "boresight eval ablation --n {} --seed {} --recipe {} --rules {} --out {}",
            self.n,
            self.seed,
            path(&self.recipe),
            path(&self.rules),
            path(&self.out)
        );
        if self.pixels {
            command += " --pixels";
        }
        for (option, values) in [("--only", &self.only), ("--set", &self.set)] {
            for value in values {
                // Writing to a string cannot fail.
                let _ = write!(command, " {option} {}", quoted(value));
            }
        }
        command
    }
}
