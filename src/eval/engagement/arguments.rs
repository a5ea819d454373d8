//! What the command line asks for, and the command that repeats it.

use crate::output::quoted;
use clap::Args;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// What `boresight eval engagement` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Number of engagements.
    #[arg(long, default_value_t = 100)]
    pub n: u32,
    /// Seed of the draws; each is the same for every number of them.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Recipe file (TOML).
    #[arg(long, default_value = "recipes/engagement.toml")]
    pub recipe: PathBuf,
    /// Draw all engagements by the recipe's rules of fire of this name.
    #[arg(long, value_name = "NAME")]
    pub rules: Option<String>,
    /// Folder for results.json, results.html and the draws; an evaluation that was stopped goes
    /// on in it.
    #[arg(long, default_value = "out/engagement")]
    pub out: PathBuf,
    /// The truth detector in place of the network, without pictures: tests the structure, and measures
    /// nothing of what the loop does on pixels.
    #[arg(long)]
    pub truth: bool,
    /// Also keep what detector and recogniser say of each thing in each frame, as `draws/NUMBER.looks.jsonl`:
    /// `boresight fit-detector` makes a measured detector of it. Cities and UAVs are then of those that may be learned from, not
    /// those kept for judging.
    #[arg(long)]
    pub looks: bool,
    /// Change a value of every scenario, such as `detector.onnx_model=mine.onnx`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Draws made side by side, each in a process of its own (default: one a core).
    #[arg(long)]
    pub jobs: Option<NonZeroUsize>,
    /// Make this draw alone, in this process, and add nothing up.
    #[arg(long, value_name = "INDEX")]
    pub draw: Option<u32>,
}

impl Arguments {
    /// The options that a draw depends on.
    pub(super) fn options(&self) -> Vec<String> {
        let mut options = vec!["--seed".into(), self.seed.to_string()];
        options.extend(["--recipe".into(), self.recipe.display().to_string()]);
        if let Some(rules) = &self.rules {
            options.extend(["--rules".into(), rules.clone()]);
        }
        options.extend(["--out".into(), self.out.display().to_string()]);
        options.extend(self.truth.then(|| "--truth".into()));
        options.extend(self.looks.then(|| "--looks".into()));
        for set in &self.set {
            options.extend(["--set".into(), set.clone()]);
        }
        options
    }

    /// The command that repeats the evaluation.
    pub(super) fn command(&self) -> String {
        let options = self.options();
        let options: String = options.iter().map(|o| format!(" {}", quoted(o))).collect();
        format!("boresight eval engagement --n {}{options}", self.n)
    }
}
