//! `boresight eval tracking`: many runs of acquisition, tracking and pointing, and what they add up to.
//!
//! Every number comes from runs that `boresight run` repeats: the JSON names scenario, changes and
//! seeds of each. The truth is only looked at, never fed back.

pub mod clip;
pub mod coco;
pub mod cost;
pub mod detector;
pub mod job;
pub mod mot;
mod page;
pub mod statistics;

use crate::app::{self, RunError};
use crate::models::ground::city::{City, CityParams};
use crate::models::maths::rng::Stream;
use crate::report::{MissStats, Series};
use clap::{Args, ValueEnum};
use glam::DVec3;
use job::{Job, Observed, all};
use serde::Serialize;
use statistics::{Lock, Rate, Sums};
use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

/// What `boresight eval tracking` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Folder for tracking.json, tracking.html, the pictures and the MOTChallenge files.
    #[arg(long, default_value = "out/eval")]
    pub out: PathBuf,
    /// Few seeds and short runs.
    #[arg(long)]
    pub quick: bool,
    /// Only this section; may be repeated.
    #[arg(long, value_name = "SECTION")]
    pub only: Vec<Section>,
}

/// Parts of the evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Section {
    /// The paper's Table 2: miss distances of three UAVs.
    Table2,
    /// Line-of-sight error with a detector of 0.1 px noise.
    Precision,
    /// A UAV that weaves at 3 m/s².
    Weave,
    /// A UAV that is hidden for a second.
    Occlusion,
    /// Several targets: association by the paper's rule and by ours.
    Suite,
    /// Probability and time of acquisition.
    Search,
    /// The line-of-sight error by cause.
    Budget,
}

/// A word of a command line, quoted where a shell would read it otherwise.
fn quoted(word: impl std::fmt::Display) -> String {
    let word = word.to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+,:=@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// Refuses a number that is not from `low` to `high`.
fn within(argument: &'static str, value: f64, low: f64, high: f64) -> Result<(), RunError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(RunError::Argument {
        argument,
        why: format!("{value}, must be {low} to {high}"),
    })
}

/// Refuses a share, where one is given, that is not from 0 to 1.
fn within_share(argument: &'static str, value: Option<f64>) -> Result<(), RunError> {
    value.map_or(Ok(()), |value| within(argument, value, 0.0, 1.0))
}

/// Threads of a model: `wanted`, or one a core.
fn threads(wanted: Option<NonZeroUsize>) -> usize {
    let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    wanted.unwrap_or_else(cores).get()
}

/// One line on standard error; a closed pipe is no error.
fn progress(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Detector of the tables: truth with 1 px noise, 5 % misses and 30 ms latency (2 ms of it readout).
const FIELD: &[&str] = &[
    "detector.kind=truth",
    "detector.truth.noise_px=1",
    "detector.truth.miss_rate=0.05",
    "detector.truth.false_alarms_per_frame=0",
    "station.cameras.search.inference_latency_s=0.028",
    "station.cameras.coarse.inference_latency_s=0.028",
    "station.cameras.precise.inference_latency_s=0.028",
];
/// Detector of the precision target: truth with 0.1 px noise and no misses.
const FINE: &[&str] = &[
    "detector.kind=truth",
    "detector.truth.noise_px=0.1",
    "detector.truth.miss_rate=0",
    "detector.truth.false_alarms_per_frame=0",
];
/// Detector on rendered images.
const RENDERED: &[&str] = &["detector.kind=onnx"];

const CONTROLLERS: [(&str, &[&str]); 3] = [
    ("paper", &["controller.preset=paper"]),
    ("tuned", &["controller.preset=tuned"]),
    ("lqg", &["controller.preset=lqg"]),
];

/// Targets that the project set itself.
const PRECISE_MEAN_PX: f64 = 0.59; // [px], the paper's field figure
const LOS_RMS_URAD: f64 = 2.0; // [µrad]
const LOS_PEAK_URAD: f64 = 30.0; // [µrad]
const SATURATED_SHARE: f64 = 0.01;
const FAILED_RATIO: f64 = 0.1;

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
    pub precision: Vec<Precision>,
    /// A weaving UAV.
    pub weave: Vec<Manoeuvre>,
    /// A UAV that is hidden for a second.
    pub occlusion: Vec<Manoeuvre>,
    /// Several targets.
    pub suite: Vec<Suite>,
    /// Acquisition.
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
    budget: Option<(&'static str, &'static str)>,
}

impl Target {
    fn at_most(
        name: impl Into<String>,
        limit: f64,
        unit: &'static str,
        value: Option<f64>,
    ) -> Self {
        Self {
            name: name.into(),
            limit,
            unit,
            value,
            met: value.map(|value| value <= limit),
            dominated_by: None,
            budget: None,
        }
    }

    /// With the budget that tells the largest cause.
    fn explained_by(mut self, detector: &'static str, controller: &'static str) -> Self {
        self.budget = Some((detector, controller));
        self
    }
}

/// Where runs come from: the command of the first, and all seeds.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Source {
    /// Command of the first seed.
    pub command: String,
    /// Seeds.
    pub seeds: Vec<u64>,
}

impl Source {
    fn of(jobs: &[Job]) -> Self {
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
    /// UAV.
    pub uav: &'static str,
    /// Detector.
    pub detector: &'static str,
    /// Controller.
    pub controller: &'static str,
    /// The run.
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
    curves: [Series; 2],
    #[serde(skip)]
    pictures: Vec<crate::components::record::KeptFrame>,
}

/// Line-of-sight error, settled, over seeds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Pointing {
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

impl Pointing {
    fn of(run: &Pointed) -> Self {
        let Pointed {
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

    fn pooled<'a>(runs: impl IntoIterator<Item = &'a Pointed>) -> Self {
        let mut sum = Pointed::default();
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
struct Pointed {
    los: Sums,
    beam: Sums,
    ticks: [u64; 3],
    /// Settled, precisely tracked time [s].
    seconds: f64,
}

fn pointed(_: &Job, seen: Observed) -> Result<Pointed, RunError> {
    Ok(Pointed {
        los: seen.los_rad,
        beam: seen.beam_rad,
        ticks: seen.ticks,
        seconds: seen.ticks[1] as f64 / f64::from(seen.tick_hz.max(1)),
    })
}

/// Line-of-sight error of a controller with the fine detector.
#[derive(Serialize)]
pub struct Precision {
    /// Controller.
    pub controller: &'static str,
    /// The runs.
    pub source: Source,
    /// The error.
    pub pointing: Pointing,
}

/// A manoeuvre or an occlusion over seeds.
#[derive(Serialize)]
pub struct Manoeuvre {
    /// Controller.
    pub controller: &'static str,
    /// The runs.
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
    pub pointing: Pointing,
}

/// A scenario with several targets under one association rule.
#[derive(Serialize)]
pub struct Suite {
    /// Scenario.
    pub scenario: &'static str,
    /// Association rule.
    pub rule: &'static str,
    /// The runs.
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
    /// Each run.
    pub runs: Vec<Lock>,
}

/// Acquisition with one pattern.
#[derive(Serialize)]
pub struct Search {
    /// Pattern.
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
    /// Controller.
    pub controller: &'static str,
    /// The runs with all causes.
    pub source: Source,
    /// Error with all causes.
    pub all: Pointing,
    /// Error with all switchable causes off [µrad rms].
    pub none_urad: Option<f64>,
    /// The causes.
    pub causes: Vec<Cause>,
    /// Beam wander by the air and jitter of the beam director, which the tracking does not see: root of the
    /// beam's variance on the target less that of the line of sight [µrad rms].
    pub beam_urad: Option<f64>,
    /// Root of the variance that switching off causes one by one does not account for, negative
    /// if it accounts for more than there is [µrad rms].
    pub residual_urad: Option<f64>,
}

/// One cause of line-of-sight error.
#[derive(Serialize)]
pub struct Cause {
    /// Its name.
    pub name: &'static str,
    /// How it is switched off.
    pub switch: String,
    /// Error without it [µrad rms].
    pub without_urad: Option<f64>,
    /// Root of the variance that goes with it, negative if the error grows [µrad rms].
    pub removed_urad: Option<f64>,
    /// Error with no other cause [µrad rms].
    pub only_urad: Option<f64>,
}

/// Root of a difference of squares, with its sign.
fn root_difference(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    let difference = a?.powi(2) - b?.powi(2);
    Some(difference.abs().sqrt().copysign(difference))
}

/// Carries out the evaluation and writes what it leaves.
pub fn tracking(arguments: &Arguments) -> Result<Evaluation, RunError> {
    let source = |error| RunError::City {
        file: "eval".into(),
        source: error,
    };
    let params = CityParams::default();
    let mut bench = Bench {
        quick: arguments.quick,
        city: Arc::new(City::generate(&params).map_err(source)?),
        out: arguments.out.clone(),
        not_run: Vec::new(),
    };
    let sections = arguments.only.iter().filter_map(|section| {
        let value = section.to_possible_value()?;
        Some(format!(" --only {}", value.get_name()))
    });
    let mut evaluation = Evaluation {
        version: app::VERSION,
        command: format!(
            "boresight eval tracking{}{}",
            if arguments.quick { " --quick" } else { "" },
            sections.collect::<String>()
        ),
        quick: arguments.quick,
        ..Evaluation::default()
    };
    mot::writable(&arguments.out.join("tracking.json"))?;
    for section in Section::value_variants() {
        if !arguments.only.is_empty() && !arguments.only.contains(section) {
            continue;
        }
        let started = std::time::Instant::now();
        match section {
            Section::Table2 => evaluation.table2 = bench.table2()?,
            Section::Precision => evaluation.precision = bench.precision()?,
            Section::Weave => evaluation.weave = bench.manoeuvre("eval/weave.toml", false)?,
            Section::Occlusion => {
                evaluation.occlusion = bench.manoeuvre("eval/occlusion.toml", true)?;
            }
            Section::Suite => evaluation.suite = bench.suite()?,
            Section::Search => evaluation.search = bench.search()?,
            Section::Budget => evaluation.budget = bench.budget()?,
        }
        progress(&format!(
            "{section:?}: {:.0} s",
            started.elapsed().as_secs_f64()
        ));
    }
    evaluation.not_run = bench.not_run;
    evaluation.targets = evaluation.targets();
    let text = serde_json::to_string_pretty(&evaluation)? + "\n";
    mot::put(&arguments.out.join("tracking.json"), &text)?;
    page::write(&arguments.out, &evaluation)?;
    Ok(evaluation)
}

struct Bench {
    quick: bool,
    city: Arc<City>,
    out: PathBuf,
    not_run: Vec<String>,
}

impl Bench {
    fn seeds(&self, full: u64, quick: u64) -> std::ops::RangeInclusive<u64> {
        1..=if self.quick { quick } else { full }
    }

    fn table2(&mut self) -> Result<Vec<Table2>, RunError> {
        const UAVS: [(&str, &str, &str); 3] = [
            (
                "phantom4",
                "paper_table2_phantom4.toml",
                "uavs.0.model=phantom4",
            ),
            ("mavic2", "paper_table2_mavic.toml", "uavs.0.model=mavic2"),
            (
                "matrice200",
                "paper_table2_matrice200.toml",
                "uavs.0.model=matrice200",
            ),
        ];
        let (frames, length) = if self.quick {
            (300, "duration_s=4")
        } else {
            (1500, "duration_s=14")
        };
        let rendered = match app::adapter() {
            Ok(_) => true,
            Err(error @ RunError::NoAdapter) => {
                self.not_run.push(format!("table2 with onnx: {error}"));
                false
            }
            Err(error) => return Err(error),
        };
        let mut cases = Vec::new();
        for cameras in ["paper", "urban_1km"] {
            for (uav, paper_scenario, model) in UAVS {
                for (detector, set) in [("truth", FIELD), ("onnx", RENDERED)] {
                    for (controller, law) in CONTROLLERS {
                        let capture = detector == "onnx";
                        let short = self.quick && (uav != "phantom4" || controller == "paper");
                        if capture && (!rendered || short) {
                            continue;
                        }
                        let base = Job::blind(
                            match cameras {
                                "paper" => paper_scenario,
                                _ => "eval/table2_urban.toml",
                            },
                            &[&[model, length], set, law],
                            1,
                        );
                        cases.push((cameras, uav, detector, controller, Job { capture, ..base }));
                    }
                }
            }
        }
        let city = self.city.clone();
        let mut rows = Vec::new();
        // Those without pictures side by side, then the others one after another.
        for capture in [false, true] {
            let (jobs, some): (Vec<Job>, Vec<_>) = cases
                .iter()
                .filter(|(.., job)| job.capture == capture)
                .map(|(cameras, uav, detector, controller, job)| {
                    (job.clone(), (*cameras, *uav, *detector, *controller))
                })
                .unzip();
            let label = if capture {
                "table2, onnx"
            } else {
                "table2, truth"
            };
            let seen = all(label, &jobs, &city, |_, seen| Ok(seen))?;
            for ((job, seen), (cameras, uav, detector, controller)) in
                jobs.iter().zip(seen).zip(some)
            {
                // As many coarse frames as go with the precise ones: half as many at 60 Hz.
                let curves = [seen.after_lock(0, frames / 2), seen.after_lock(1, frames)];
                let stats = |series: &Series| MissStats::of(series.iter().map(|(_, px)| *px));
                rows.push(Table2 {
                    cameras,
                    uav,
                    detector,
                    controller,
                    source: Source::of(std::slice::from_ref(job)),
                    acquired_s: seen.acquired_s,
                    precise_s: seen.precise_s,
                    frames,
                    coarse_px: stats(&curves[0]),
                    precise_px: stats(&curves[1]),
                    curves,
                    pictures: seen.pictures,
                });
            }
        }
        Ok(rows)
    }

    fn precision(&self) -> Result<Vec<Precision>, RunError> {
        let mut rows = Vec::new();
        for (controller, law) in CONTROLLERS {
            let jobs: Vec<Job> = self
                .seeds(10, 2)
                .map(|seed| Job::blind("eval/table2_urban.toml", &[FINE, law], seed))
                .collect();
            let label = format!("precision, {controller}");
            let runs = all(&label, &jobs, &self.city, pointed)?;
            rows.push(Precision {
                controller,
                source: Source::of(&jobs),
                pointing: Pointing::pooled(&runs),
            });
        }
        Ok(rows)
    }

    fn manoeuvre(&self, scenario: &str, hides: bool) -> Result<Vec<Manoeuvre>, RunError> {
        let mut rows = Vec::new();
        for (controller, law) in CONTROLLERS {
            let jobs: Vec<Job> = self
                .seeds(20, 3)
                .map(|seed| Job::blind(scenario, &[FIELD, law], seed))
                .collect();
            let label = format!("{scenario}, {controller}");
            let runs = all(&label, &jobs, &self.city, |job, seen| {
                let kept = if hides {
                    reacquired(&seen)
                } else {
                    woven(&seen)
                };
                let hidden_s = seen.occlusion_s().map(|[from, to]| to - from);
                Ok((kept, hidden_s, pointed(job, seen)?))
            })?;
            let times = |pick: fn(&Kept) -> Option<f64>| {
                MissStats::of(runs.iter().filter_map(|(kept, ..)| pick(kept)))
            };
            let hidden = runs.iter().filter_map(|(_, hidden_s, _)| *hidden_s);
            rows.push(Manoeuvre {
                controller,
                source: Source::of(&jobs),
                success: Rate::count(runs.iter().map(|(kept, ..)| kept.success)),
                hidden_s: hidden
                    .map(|s| [s, s])
                    .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
                    .filter(|_| hides),
                reacquired_s: times(|kept| kept.after_s),
                precise_again_s: times(|kept| kept.precise_after_s),
                pointing: Pointing::pooled(runs.iter().map(|(.., pointed)| pointed)),
            });
        }
        Ok(rows)
    }

    fn suite(&self) -> Result<Vec<Suite>, RunError> {
        const SCENARIOS: [(&str, &str); 6] = [
            ("crossing", "eval/suite_crossing.toml"),
            ("overtaking", "eval/suite_overtaking.toml"),
            ("swarm", "eval/suite_swarm.toml"),
            ("birds", "eval/suite_birds.toml"),
            ("occlusion", "eval/suite_occlusion.toml"),
            ("decoy", "eval/suite_decoy.toml"),
        ];
        const RULES: [(&str, &[&str]); 2] = [
            ("paper", &["tracker.rule=paper"]),
            ("global", &["tracker.rule=global"]),
        ];
        let mut rows = Vec::new();
        for (scenario, file) in SCENARIOS {
            for (rule, set) in RULES {
                let jobs: Vec<Job> = self
                    .seeds(20, 2)
                    .map(|seed| Job::blind(file, &[set], seed))
                    .collect();
                let folder = self.out.join("mot");
                let label = format!("{scenario}, {rule}");
                let runs = all(&label, &jobs, &self.city, |job, seen| {
                    let name = format!("{scenario}-{:02}", job.seed);
                    let (size_px, rate_hz) = seen.coarse;
                    let paper = rule == "paper";
                    let mut sets = vec![("all", mot::all(&seen, paper))];
                    if seen.lock.first_uav.is_some() {
                        sets.push(("lock", mot::lock(&seen, paper)));
                    }
                    for (set, sequence) in sets {
                        let folder = folder.join(set);
                        mot::write(&folder, &name, rule, rate_hz, size_px, &sequence)?;
                    }
                    Ok(seen.lock)
                })?;
                let locks = || runs.iter().filter(|lock| lock.first_uav.is_some());
                rows.push(Suite {
                    scenario,
                    rule,
                    source: Source::of(&jobs),
                    locked: Rate::of(locks().count(), runs.len()),
                    lost: Rate::count(locks().map(|lock| lock.lost)),
                    failed: Rate::count(
                        runs.iter()
                            .map(|lock| lock.first_uav.is_none() || lock.lost),
                    ),
                    switches: runs.iter().map(|lock| lock.switches).sum(),
                    false_lock_s: runs.iter().map(|lock| lock.false_lock_s).sum::<f64>()
                        / runs.len().max(1) as f64,
                    runs,
                });
            }
        }
        Ok(rows)
    }

    fn search(&self) -> Result<Vec<Search>, RunError> {
        const PATTERNS: [(&str, &[&str]); 3] = [
            ("raster", &["search.pattern=raster"]),
            ("spiral", &["search.pattern=spiral"]),
            (
                "cue",
                &["search.pattern=raster", "search.cue={ sigma_deg = 0.7 }"],
            ),
        ];
        let limit_s = 60.0; // [s]
        let length = format!("duration_s={limit_s}");
        let mut rows = Vec::new();
        for (pattern, set) in PATTERNS {
            let jobs: Vec<Job> = self
                .seeds(20, 3)
                .map(|seed| {
                    let start = format!("uavs.0.trajectory={}", intruder(seed));
                    Job::blind("eval/search.toml", &[FIELD, &[&start, &length], set], seed)
                })
                .collect();
            let runs = all(
                &format!("search, {pattern}"),
                &jobs,
                &self.city,
                |_, seen| {
                    Ok((
                        seen.lock.locked_s,
                        seen.acquired_s.filter(|_| !seen.acquired_uav),
                    ))
                },
            )?;
            let mut times_s: Vec<f64> = runs.iter().filter_map(|(right_s, _)| *right_s).collect();
            times_s.sort_unstable_by(f64::total_cmp);
            rows.push(Search {
                pattern,
                source: Source::of(&jobs),
                acquired: Rate::of(times_s.len(), runs.len()),
                wrong: runs.iter().filter(|(_, wrong_s)| wrong_s.is_some()).count(),
                time_s: MissStats::of(times_s.iter().copied()),
                times_s,
                limit_s,
            });
        }
        Ok(rows)
    }

    fn budget(&self) -> Result<Vec<Budget>, RunError> {
        const SWITCHES: [(&str, &[&str]); 9] = [
            (
                "detector noise and misses",
                &["detector.truth.noise_px=0", "detector.truth.miss_rate=0"],
            ),
            (
                "latency",
                &[
                    "station.cameras.search.readout_latency_s=0",
                    "station.cameras.search.inference_latency_s=0",
                    "station.cameras.coarse.readout_latency_s=0",
                    "station.cameras.coarse.inference_latency_s=0",
                    "station.cameras.precise.readout_latency_s=0",
                    "station.cameras.precise.inference_latency_s=0",
                ],
            ),
            (
                "base motion",
                &["station.mount.base_motion={ rms_urad = 0, frequency_hz = 1 }"],
            ),
            (
                "friction, encoders, gyro",
                &["station.mount.friction=false"],
            ),
            ("structural mode", &["station.mount.structural_mode_hz=0"]),
            (
                "boresight errors",
                &["station.mount.boresight_sigma_urad=0"],
            ),
            ("wind on the mount", &["station.mount.wind_load=false"]),
            (
                "mirror bandwidth",
                &["station.mount.mirror_bandwidth_hz=5000"],
            ),
            ("wind on the UAV", &["weather.wind_speed_mps=0"]),
        ];
        const FILE: &str = "eval/table2_urban.toml";
        let length: &[&str] = &[if self.quick {
            "duration_s=6"
        } else {
            "duration_s=14"
        }];
        let mut rows = Vec::new();
        for (controller, law) in CONTROLLERS.into_iter().skip(1) {
            for (detector, set) in [("field", FIELD), ("fine", FINE)] {
                // All causes, none, then each left out, then each alone.
                let everything: Vec<&[&str]> = SWITCHES.iter().map(|(_, off)| *off).collect();
                let mut groups: Vec<Vec<&[&str]>> = vec![vec![], everything];
                groups.extend(SWITCHES.iter().map(|(_, off)| vec![*off]));
                groups.extend((0..SWITCHES.len()).map(|kept| {
                    let others = SWITCHES.iter().enumerate().filter(|(i, _)| *i != kept);
                    others.map(|(_, (_, off))| *off).collect()
                }));
                let seeds = self.seeds(8, 2);
                let jobs: Vec<Job> = groups
                    .iter()
                    .flat_map(|off| {
                        let changes = [&[length, set, law], &off[..]].concat();
                        seeds
                            .clone()
                            .map(move |seed| Job::blind(FILE, &changes, seed))
                    })
                    .collect();
                let label = format!("budget, {controller}, {detector}");
                let runs = all(&label, &jobs, &self.city, pointed)?;
                let each = seeds.count();
                let pooled: Vec<Pointing> = runs.chunks(each).map(Pointing::pooled).collect();
                let rms = |index: usize| pooled.get(index).and_then(|pointing| pointing.rms_urad);
                let count = SWITCHES.len();
                let causes: Vec<Cause> = SWITCHES
                    .iter()
                    .enumerate()
                    .map(|(i, (name, off))| Cause {
                        name,
                        switch: off.join(", "),
                        without_urad: rms(2 + i),
                        removed_urad: root_difference(rms(0), rms(2 + i)),
                        only_urad: rms(2 + count + i),
                    })
                    .collect();
                let accounted: f64 = causes
                    .iter()
                    .filter_map(|cause| cause.removed_urad)
                    .map(|urad| urad * urad.abs())
                    .sum();
                let all = pooled.first().copied().unwrap_or_default();
                rows.push(Budget {
                    detector,
                    controller,
                    source: Source::of(&jobs[..each.min(jobs.len())]),
                    all,
                    none_urad: rms(1),
                    causes,
                    beam_urad: root_difference(all.beam_rms_urad, all.rms_urad),
                    residual_urad: all.rms_urad.map(|urad| {
                        let rest = urad * urad - accounted;
                        rest.abs().sqrt().copysign(rest)
                    }),
                });
            }
        }
        Ok(rows)
    }
}

/// A trajectory for the search: somewhere in the sector, 1 km away, across the line of sight.
fn intruder(seed: u64) -> String {
    let mut rng = Stream::new(seed, 0, "evaluation of the search");
    let azimuth = rng.range(290.0, 340.0).to_radians(); // [deg]
    let elevation = rng.range(3.0, 9.0).to_radians(); // [deg]
    let speed_mps = if rng.uniform() < 0.5 { 8.0 } else { -8.0 }; // [m/s]
    let across = DVec3::new(azimuth.cos(), -azimuth.sin(), 0.0);
    let towards =
        crate::models::maths::kinematics::az_el_to_los(glam::DVec2::new(azimuth, elevation));
    // The station's axes cross 48 m above the site's street level.
    let [e, n, u] = (DVec3::new(0.0, 0.0, 48.0) + 1_000.0 * towards).to_array(); // [m]
    let [ve, vn, vu] = (speed_mps * across).to_array();
    format!(
        "{{ kind = \"straight\", start_enu_m = [{e:.1}, {n:.1}, {u:.1}], \
         velocity_enu_mps = [{ve:.3}, {vn:.3}, {vu:.3}] }}"
    )
}

/// Whether a target was kept through a manoeuvre, and when it came back.
struct Kept {
    success: bool,
    after_s: Option<f64>,
    precise_after_s: Option<f64>,
}

/// One identity from the first precise lock on, and still on the UAV at the end.
fn woven(seen: &Observed) -> Kept {
    let from_s = seen.precise_s.unwrap_or(f64::INFINITY);
    let mut changes = seen.targets.iter().filter(|(t_s, _)| *t_s > from_s);
    Kept {
        success: seen.precise_s.is_some()
            && changes.next().is_none()
            && seen.lock.first_uav == Some(0)
            && !seen.lock.lost,
        after_s: None,
        precise_after_s: None,
    }
}

/// How long the UAV of the occlusion must be hidden for the run to count [s].
const HIDDEN_S: std::ops::RangeInclusive<f64> = 0.8..=1.2;

/// The same identity before and after the one time hidden, and still on the UAV at the end.
fn reacquired(seen: &Observed) -> Kept {
    let hidden = seen.occlusion_s();
    let Some([from_s, to_s]) = hidden.filter(|[from, to]| HIDDEN_S.contains(&(to - from))) else {
        return Kept {
            success: false,
            after_s: None,
            precise_after_s: None,
        };
    };
    let before = seen.on_first.iter().rev().find(|(t_s, ..)| *t_s < from_s);
    let same = |(t_s, id, _): &&(f64, u32, bool)| {
        *t_s >= to_s && before.is_some_and(|(_, known, _)| known == id)
    };
    let after = seen.on_first.iter().find(same);
    let precise = seen
        .on_first
        .iter()
        .filter(|(.., precise)| *precise)
        .find(same);
    let since = |at: &(f64, u32, bool)| at.0 - to_s;
    Kept {
        success: after.is_some() && seen.lock.first_uav == Some(0) && !seen.lock.lost,
        after_s: after.map(since),
        precise_after_s: precise.map(since),
    }
}

impl Evaluation {
    fn targets(&self) -> Vec<Target> {
        let mut targets = Vec::new();
        let tuned = self.table2.iter().filter(|row| {
            (row.cameras, row.controller, row.detector) == ("urban_1km", "tuned", "onnx")
        });
        for row in tuned {
            targets.push(Target::at_most(
                format!("urban_1km, tuned, onnx, {}: mean precise miss", row.uav),
                PRECISE_MEAN_PX,
                "px",
                row.precise_px.map(|stats| stats.mean),
            ));
        }
        for row in self
            .precision
            .iter()
            .filter(|row| row.controller != "paper")
        {
            let pointing = &row.pointing;
            let what = format!("0.1 px, {}: line-of-sight", row.controller);
            let measured = pointing.rms_urad.map(|_| pointing.saturated_share);
            targets.extend([
                Target::at_most(
                    format!("{what} error rms"),
                    LOS_RMS_URAD,
                    "µrad",
                    pointing.rms_urad,
                )
                .explained_by("fine", row.controller),
                Target::at_most(
                    format!("{what} error peak"),
                    LOS_PEAK_URAD,
                    "µrad",
                    pointing.peak_urad,
                )
                .explained_by("fine", row.controller),
                Target::at_most(
                    format!("{what} time with the mirror at its stop"),
                    SATURATED_SHARE,
                    "of the time",
                    measured,
                ),
            ]);
        }
        // Of all runs, not of the locks: a rule that locks less has less to lose.
        let failed = |rule: &str| {
            let rows = self.suite.iter().filter(|row| row.rule == rule);
            let (failed, runs) = rows.fold((0, 0), |(failed, runs), row| {
                (failed + row.failed.successes, runs + row.failed.trials)
            });
            Rate::of(failed, runs)
        };
        if !self.suite.is_empty() {
            let (paper, ours) = (failed("paper"), failed("global"));
            let ratio = ours
                .rate
                .zip(paper.rate.filter(|rate| *rate > 0.0))
                .map(|(ours, paper)| ours / paper);
            targets.push(Target::at_most(
                format!(
                    "suite: rate of runs without a lock that lasts, ours ({}) over the paper's rule ({})",
                    ours.text(),
                    paper.text()
                ),
                FAILED_RATIO,
                "of the paper's rate",
                ratio,
            ));
        }
        for target in &mut targets {
            if let (Some(false), Some((detector, controller))) = (target.met, target.budget) {
                target.dominated_by = self.dominant(detector, controller);
            }
        }
        targets
    }

    /// The largest cause in the budget of a detector and controller, if one was made.
    fn dominant(&self, detector: &str, controller: &str) -> Option<String> {
        let budget = self
            .budget
            .iter()
            .find(|row| (row.detector, row.controller) == (detector, controller))?;
        let cause = budget.causes.iter().max_by(|a, b| {
            let urad = |cause: &Cause| cause.removed_urad.unwrap_or(f64::NEG_INFINITY);
            urad(a).total_cmp(&urad(b))
        })?;
        Some(format!("{} ({:.2} µrad)", cause.name, cause.removed_urad?))
    }

    /// Targets and main figures for a terminal.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for target in &self.targets {
            let value = target
                .value
                .map_or("not measured".into(), |v| format!("{v:.3}"));
            let met = match target.met {
                Some(true) => "met",
                Some(false) => "MISSED",
                None => "open",
            };
            text += &format!(
                "{met:<7} {}: {value}, at most {} {}",
                target.name, target.limit, target.unit
            );
            if let Some(cause) = &target.dominated_by {
                text += &format!("; largest cause: {cause}");
            }
            text.push('\n');
        }
        for why in &self.not_run {
            text += &format!("not run: {why}\n");
        }
        if !self.suite.is_empty() {
            text += "score the MOTChallenge files: python tests/score_mot.py DIR\n";
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::ground::dsm::LineOfSight;
    use crate::scenario::Scenario;
    use std::path::Path;

    fn folder() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/eval")
    }

    #[test]
    fn the_building_hides_the_line_as_long_as_the_scenario_says() {
        let path = folder().join("occlusion.toml");
        let scenario = Scenario::load(&path, &[]).unwrap().scenario;
        let city = City::generate(&scenario.city).unwrap();
        let station_enu_m = DVec3::from(scenario.station.position_enu_m.unwrap());
        let plan = scenario.uavs[0]
            .trajectory
            .compile(|_| Ok(String::new()))
            .unwrap();
        let hidden: Vec<f64> = (0..(100.0 * scenario.duration_s) as u32)
            .map(|i| f64::from(i) / 100.0)
            .filter(|t_s| {
                let at = plan.sample(*t_s).r_enu_m;
                city.dsm.line_of_sight(station_enu_m, at) != LineOfSight::Clear
            })
            .collect();
        let (first, last) = (hidden[0], hidden[hidden.len() - 1]);
        // Once, without a gap.
        assert_eq!(hidden.len(), (100.0 * (last - first)).round() as usize + 1);
        assert!(
            (first - 7.94).abs() < 0.03 && (last - 8.93).abs() < 0.03,
            "{first} {last}"
        );
        // The suite hides its first UAV behind the same building.
        let first_uav = |name: &str| {
            let text = std::fs::read_to_string(folder().join(name)).unwrap();
            let table: toml::Table = toml::from_str(&text).unwrap();
            table["uavs"][0]["trajectory"].clone()
        };
        assert_eq!(
            first_uav("occlusion.toml"),
            first_uav("suite_occlusion.toml")
        );
    }

    #[test]
    fn a_target_is_back_only_with_its_identity() {
        let seen = |after: u32, hidden_s: [f64; 2]| Observed {
            hidden_s: vec![hidden_s],
            on_first: vec![(1.0, 3, true), (2.5, after, false), (2.75, after, true)],
            lock: Lock {
                first_uav: Some(0),
                ..Lock::default()
            },
            ..Observed::default()
        };
        let same = reacquired(&seen(3, [1.25, 2.25]));
        assert!(same.success);
        assert_eq!(
            (same.after_s, same.precise_after_s),
            (Some(0.25), Some(0.5))
        );
        assert!(!reacquired(&seen(4, [1.25, 2.25])).success);
        // Hidden for too short a time proves nothing.
        assert!(!reacquired(&seen(3, [1.25, 1.5])).success);
    }

    #[test]
    fn differences_of_squares_keep_their_sign() {
        assert_eq!(root_difference(Some(5.0), Some(4.0)), Some(3.0));
        assert_eq!(root_difference(Some(4.0), Some(5.0)), Some(-3.0));
        assert_eq!(root_difference(None, Some(1.0)), None);
    }
}
