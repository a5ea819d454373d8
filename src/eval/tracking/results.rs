//! What the evaluation measured, as `tracking.json` has it.

use super::job::{Job, Observed};
use crate::components::record::KeptFrame;
use crate::eval::statistics::{Lock, Sums};
use crate::models::maths::statistics::Rate;
use crate::report::chart::Series;
use crate::report::statistics::MissStats;
use serde::Serialize;

/// Everything that was measured.
#[derive(Default, Serialize)]
pub struct Evaluation {
    /// Version of the program.
    pub version: &'static str,
    /// The command that repeats it.
    pub command: String,
    /// Whether seeds and lengths were cut.
    pub quick: bool,
    /// What could not be run, and why.
    pub not_run: Vec<String>,
    /// Targets and whether they are met.
    pub targets: Vec<Target>,
    /// Miss distances.
    pub table2: Vec<Table2>,
    /// Line-of-sight error with a fine detector.
    pub precision: Vec<LosRow>,
    /// A weaving UAV.
    pub weave: Vec<Manoeuvre>,
    /// A UAV that is hidden for a second.
    pub occlusion: Vec<Manoeuvre>,
    /// Several targets.
    pub suite: Vec<Suite>,
    /// Probability and time of acquisition.
    pub search: Vec<Search>,
    /// Line-of-sight error by cause.
    pub budget: Vec<Budget>,
}

/// A target and what was measured.
#[derive(Clone, Debug, Serialize)]
pub struct Target {
    /// What is measured.
    pub name: String,
    /// Largest value that meets it.
    pub limit: f64,
    /// Unit of limit and value.
    pub unit: &'static str,
    /// Measured value; absent if it was not measured.
    pub value: Option<f64>,
    /// Whether it is met.
    pub met: Option<bool>,
    /// Largest cause of the line-of-sight error, where the target is missed and a budget of the
    /// same detector and controller was made.
    pub dominated_by: Option<String>,
    /// Detector and controller of that budget.
    #[serde(skip)]
    pub(super) budget: Option<(&'static str, &'static str)>,
}

/// Where runs come from: the command of the first, and all seeds.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Source {
    /// Command of the first seed.
    pub command: String,
    /// Seeds of all of them.
    pub seeds: Vec<u64>,
}

impl Source {
    pub(super) fn of(jobs: &[Job]) -> Self {
        Self {
            command: jobs.first().map(Job::command).unwrap_or_default(),
            seeds: jobs.iter().map(|job| job.seed).collect(),
        }
    }
}

/// Miss distances of one UAV with one set of cameras, detector and controller.
#[derive(Serialize)]
pub struct Table2 {
    /// Camera preset.
    pub cameras: &'static str,
    /// Model of the UAV.
    pub uav: &'static str,
    /// `truth` or `onnx`.
    pub detector: &'static str,
    /// Preset of the controller.
    pub controller: &'static str,
    /// The run it comes from.
    pub source: Source,
    /// First Coarse state [s].
    pub acquired_s: Option<f64>,
    /// First Precise state [s]; the frames count from here.
    pub precise_s: Option<f64>,
    /// Frames of the precise camera asked for.
    pub frames: usize,
    /// Miss distance of the coarse camera [px].
    pub coarse_px: Option<MissStats>,
    /// Miss distance of the precise camera [px].
    pub precise_px: Option<MissStats>,
    #[serde(skip)]
    pub(super) curves: [Series; 2],
    #[serde(skip)]
    pub(super) pictures: Vec<KeptFrame>,
}

/// Line-of-sight error, settled, over seeds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct LosFigures {
    /// Root mean square over all seeds [µrad].
    pub rms_urad: Option<f64>,
    /// Largest error [µrad].
    pub peak_urad: Option<f64>,
    /// The beam's centre on the target, moved by wander and director jitter besides: rms [µrad].
    pub beam_rms_urad: Option<f64>,
    /// Share of the settled time with a precise track.
    pub precise_share: f64,
    /// Share of that in which the mirror is at its stop.
    pub saturated_share: f64,
    /// Settled, precisely tracked time [s].
    pub seconds: f64,
}

impl LosFigures {
    fn of(run: &LosSums) -> Self {
        let LosSums {
            los,
            beam,
            ticks,
            seconds,
        } = run;
        let share = |part: u64, whole: u64| part as f64 / (whole.max(1)) as f64;
        Self {
            rms_urad: los.rms().map(|rad| 1e6 * rad),
            peak_urad: (los.n > 0).then_some(1e6 * los.peak),
            beam_rms_urad: beam.rms().map(|rad| 1e6 * rad),
            precise_share: share(ticks[1], ticks[0]),
            saturated_share: share(ticks[2], ticks[1]),
            seconds: *seconds,
        }
    }

    pub(super) fn pooled<'a>(runs: impl IntoIterator<Item = &'a LosSums>) -> Self {
        let mut sum = LosSums::default();
        for run in runs {
            sum.los.merge(&run.los);
            sum.beam.merge(&run.beam);
            for (total, ticks) in sum.ticks.iter_mut().zip(run.ticks) {
                *total += ticks;
            }
            sum.seconds += run.seconds;
        }
        Self::of(&sum)
    }
}

/// Sums of one run.
#[derive(Clone, Copy, Default)]
pub(super) struct LosSums {
    los: Sums,
    beam: Sums,
    /// Settled ticks, those with a precise track, those of them with the mirror at its stop.
    ticks: [u64; 3],
    /// Settled, precisely tracked time [s].
    seconds: f64,
}

impl LosSums {
    pub(super) fn of(seen: &Observed) -> Self {
        Self {
            los: seen.los_rad,
            beam: seen.beam_rad,
            ticks: seen.ticks,
            seconds: seen.ticks[1] as f64 / f64::from(seen.tick_hz.max(1)),
        }
    }
}

/// Line-of-sight error of a controller with the fine detector.
#[derive(Serialize)]
pub struct LosRow {
    /// Preset of the controller.
    pub controller: &'static str,
    /// The runs it sums up.
    pub source: Source,
    /// Line-of-sight error over all seeds.
    pub pointing: LosFigures,
}

/// A manoeuvre or an occlusion over seeds.
#[derive(Serialize)]
pub struct Manoeuvre {
    /// Preset of the controller.
    pub controller: &'static str,
    /// The runs it sums up.
    pub source: Source,
    /// Weave: one identity from the first precise lock to the end, on the UAV at the end.
    /// Occlusion: the same identity before and after, on the UAV at the end.
    pub success: Rate,
    /// Shortest and longest time hidden [s].
    pub hidden_s: Option<[f64; 2]>,
    /// From the end of the occlusion to the next hit of the same UAV with a track held [s].
    pub reacquired_s: Option<MissStats>,
    /// From the end of the occlusion to the next precise track [s].
    pub precise_again_s: Option<MissStats>,
    /// Line-of-sight error.
    pub pointing: LosFigures,
}

/// A scenario with several targets under one association rule.
#[derive(Serialize)]
pub struct Suite {
    /// Short name of the scenario.
    pub scenario: &'static str,
    /// Association rule.
    pub rule: &'static str,
    /// The runs it sums up.
    pub source: Source,
    /// Runs in which a UAV was locked.
    pub locked: Rate,
    /// Those of them whose lock was lost.
    pub lost: Rate,
    /// Runs in which no UAV was locked or the lock was lost.
    pub failed: Rate,
    /// Times that the tracker went over to something else.
    pub switches: u32,
    /// Time on something else than the UAV locked first, a run [s].
    pub false_lock_s: f64,
    /// What became of the lock in each run.
    pub runs: Vec<Lock>,
}

/// Acquisition with one pattern.
#[derive(Serialize)]
pub struct Search {
    /// Pattern of the search.
    pub pattern: &'static str,
    /// The runs; each seed has its own start, given in the command of the first.
    pub source: Source,
    /// Runs in which the coarse camera confirmed the UAV.
    pub acquired: Rate,
    /// Runs in which it first confirmed something else.
    pub wrong: usize,
    /// Time it took [s].
    pub time_s: Option<MissStats>,
    /// Times in order [s].
    pub times_s: Vec<f64>,
    /// Length of the runs [s].
    pub limit_s: f64,
}

/// Line-of-sight error by cause, for one detector and controller.
#[derive(Serialize)]
pub struct Budget {
    /// Detector: `field` has 1 px, 5 % misses and 30 ms; `fine` 0.1 px and no misses.
    pub detector: &'static str,
    /// Preset of the controller.
    pub controller: &'static str,
    /// The runs with all causes.
    pub source: Source,
    /// Error with all causes.
    pub all: LosFigures,
    /// Error with all sources off: the target's own motion, frames, the filter [µrad rms].
    pub none_urad: Option<f64>,
    /// What each cause contributes.
    pub causes: Vec<Cause>,
    /// Beam wander by the air and jitter of the beam director, which the tracking does not see: root of the
    /// beam's variance on the target less that of the line of sight [µrad rms].
    pub beam_urad: Option<f64>,
    /// That and the sources, each alone, added in squares [µrad rms].
    pub sum_urad: Option<f64>,
}

/// One cause of line-of-sight error.
#[derive(Serialize)]
pub struct Cause {
    /// What causes the error.
    pub name: &'static str,
    /// How it is switched off.
    pub switch: String,
    /// Error without it [µrad rms].
    pub without_urad: Option<f64>,
    /// Root of the variance that goes with it, negative if the error grows [µrad rms].
    pub removed_urad: Option<f64>,
    /// Root of what it adds to the variance where no other source is, negative if the error falls; absent of
    /// what only passes error on [µrad rms].
    pub alone_urad: Option<f64>,
}
