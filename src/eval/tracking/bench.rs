//! The sections of the evaluation: which runs each makes, and what it takes from them.

use super::job::{Job, Observed, all};
use super::mot;
use super::results::{LosFigures, LosRow, LosSums, Manoeuvre, Search, Source, Suite, Table2};
use crate::app::{self, RunError};
use crate::eval::EvalError;
use crate::experiment::runner::Runner;
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::maths::rng::Stream;
use crate::models::maths::statistics::Rate;
use crate::report::chart::Series;
use crate::report::statistics::MissStats;
use glam::{DVec2, DVec3};
use std::path::{Path, PathBuf};

/// Detector of the tables: truth with 1 px noise, 5 % misses and 30 ms latency (2 ms of it readout).
pub(super) const FIELD: &[&str] = &[
    "detector.kind=truth",
    "detector.truth.noise_px=1",
    "detector.truth.miss_rate=0.05",
    "detector.truth.false_alarms_per_frame=0",
    "station.cameras.search.inference_latency_s=0.028",
    "station.cameras.coarse.inference_latency_s=0.028",
    "station.cameras.precise.inference_latency_s=0.028",
];
/// Detector of the precision target: truth with 0.1 px noise and no misses.
pub(super) const FINE: &[&str] = &[
    "detector.kind=truth",
    "detector.truth.noise_px=0.1",
    "detector.truth.miss_rate=0",
    "detector.truth.false_alarms_per_frame=0",
];
/// Detector on rendered images.
const RENDERED: &[&str] = &["detector.kind=onnx"];

/// The control laws and how a run selects them.
pub(super) const CONTROLLERS: [(&str, &[&str]); 3] = [
    ("paper", &["controller.preset=paper"]),
    ("tuned", &["controller.preset=tuned"]),
    ("lqg", &["controller.preset=lqg"]),
];

/// The UAVs of the paper's Table 2, the scenario of each, and how another scenario gets it.
const TABLE2_UAVS: [(&str, &str, &str); 3] = [
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

/// A row of Table 2 before its run.
struct Table2Case {
    cameras: &'static str,
    uav: &'static str,
    detector: &'static str,
    controller: &'static str,
    job: Job,
}

impl Table2Case {
    /// The row after its run, with the miss distances of that many precise frames.
    fn row(&self, seen: Observed, frames: usize) -> Table2 {
        // As many coarse frames as go with the precise ones: half as many at 60 Hz.
        let curves = [seen.after_lock(0, frames / 2), seen.after_lock(1, frames)];
        let stats = |series: &Series| MissStats::of(series.iter().map(|(_, px)| *px));
        Table2 {
            cameras: self.cameras,
            uav: self.uav,
            detector: self.detector,
            controller: self.controller,
            source: Source::of(std::slice::from_ref(&self.job)),
            acquired_s: seen.acquired_s,
            precise_s: seen.precise_s,
            frames,
            coarse_px: stats(&curves[0]),
            precise_px: stats(&curves[1]),
            curves,
            pictures: seen.pictures,
        }
    }
}

/// Where the runs are made.
pub(super) struct Bench {
    pub(super) quick: bool,
    pub(super) runner: Runner,
    out: PathBuf,
    /// What could not be run, and why.
    pub(super) not_run: Vec<String>,
}

impl Bench {
    pub(super) fn new(quick: bool, out: &Path) -> Self {
        Self {
            quick,
            runner: Runner::default(),
            out: out.into(),
            not_run: Vec::new(),
        }
    }

    pub(super) fn seeds(&self, full: u64, quick: u64) -> std::ops::RangeInclusive<u64> {
        1..=if self.quick { quick } else { full }
    }

    pub(super) fn table2(&mut self) -> Result<Vec<Table2>, EvalError> {
        let frames = if self.quick { 300 } else { 1500 };
        let rendered = match app::adapter() {
            Ok(_) => true,
            Err(error @ RunError::NoAdapter) => {
                self.not_run.push(format!("table2 with onnx: {error}"));
                false
            }
            Err(error) => return Err(error.into()),
        };
        let (pictured, blind): (Vec<_>, Vec<_>) = self
            .table2_cases(rendered)
            .into_iter()
            .partition(|case| case.job.capture);
        let mut rows = Vec::new();
        // Those without pictures side by side, then the others one after another.
        for (label, cases) in [("table2, truth", blind), ("table2, onnx", pictured)] {
            let jobs: Vec<Job> = cases.iter().map(|case| case.job.clone()).collect();
            let seen = all(label, &jobs, &self.runner, |_, seen| Ok(seen))?;
            let cases = cases.iter().zip(seen);
            rows.extend(cases.map(|(case, seen)| case.row(seen, frames)));
        }
        Ok(rows)
    }

    /// The rows of Table 2, those on rendered images only where there is an adapter.
    fn table2_cases(&self, rendered: bool) -> Vec<Table2Case> {
        let length = if self.quick {
            "duration_s=4"
        } else {
            "duration_s=14"
        };
        let mut cases = Vec::new();
        for cameras in ["paper", "urban_1km"] {
            for (uav, paper_scenario, model) in TABLE2_UAVS {
                for (detector, set) in [("truth", FIELD), ("onnx", RENDERED)] {
                    for (controller, law) in CONTROLLERS {
                        let capture = detector == "onnx";
                        let short = self.quick && (uav != "phantom4" || controller == "paper");
                        if capture && (!rendered || short) {
                            continue;
                        }
                        let scenario = match cameras {
                            "paper" => paper_scenario,
                            _ => "eval/table2_urban.toml",
                        };
                        let blind = Job::blind(scenario, &[&[model, length], set, law], 1);
                        cases.push(Table2Case {
                            cameras,
                            uav,
                            detector,
                            controller,
                            job: Job { capture, ..blind },
                        });
                    }
                }
            }
        }
        cases
    }

    pub(super) fn precision(&self) -> Result<Vec<LosRow>, EvalError> {
        let mut rows = Vec::new();
        for (controller, law) in CONTROLLERS {
            let jobs: Vec<Job> = self
                .seeds(10, 2)
                .map(|seed| Job::blind("eval/table2_urban.toml", &[FINE, law], seed))
                .collect();
            let label = format!("precision, {controller}");
            let runs = all(&label, &jobs, &self.runner, |_, seen| {
                Ok(LosSums::of(&seen))
            })?;
            rows.push(LosRow {
                controller,
                source: Source::of(&jobs),
                pointing: LosFigures::pooled(&runs),
            });
        }
        Ok(rows)
    }

    pub(super) fn weave(&self) -> Result<Vec<Manoeuvre>, EvalError> {
        self.manoeuvre("eval/weave.toml", false)
    }

    pub(super) fn occlusion(&self) -> Result<Vec<Manoeuvre>, EvalError> {
        self.manoeuvre("eval/occlusion.toml", true)
    }

    fn manoeuvre(&self, scenario: &str, hides: bool) -> Result<Vec<Manoeuvre>, EvalError> {
        let mut rows = Vec::new();
        for (controller, law) in CONTROLLERS {
            let jobs: Vec<Job> = self
                .seeds(20, 3)
                .map(|seed| Job::blind(scenario, &[FIELD, law], seed))
                .collect();
            let label = format!("{scenario}, {controller}");
            let runs = all(&label, &jobs, &self.runner, |_, seen| {
                let kept = if hides {
                    reacquired(&seen)
                } else {
                    woven(&seen)
                };
                let hidden_s = seen.occlusion_s().map(|[from, to]| to - from);
                Ok((kept, hidden_s, LosSums::of(&seen)))
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
                pointing: LosFigures::pooled(runs.iter().map(|(.., los)| los)),
            });
        }
        Ok(rows)
    }

    pub(super) fn suite(&self) -> Result<Vec<Suite>, EvalError> {
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
                let runs = all(&label, &jobs, &self.runner, |job, seen| {
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

    pub(super) fn search(&self) -> Result<Vec<Search>, EvalError> {
        const PATTERNS: [(&str, &[&str]); 3] = [
            ("raster", &["search.pattern=raster"]),
            ("spiral", &["search.pattern=spiral"]),
            (
                "cue",
                &[
                    "search.pattern=raster",
                    "search.cue={ kind = 'truth', sigma_deg = 0.7, rate_hz = 1.0 }",
                ],
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
                &self.runner,
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
}

/// A trajectory for the search: somewhere in the sector, 1 km away, across the line of sight.
fn intruder(seed: u64) -> String {
    let mut rng = Stream::new(seed, 0, "evaluation of the search");
    let azimuth = rng.range(290.0, 340.0).to_radians(); // [deg]
    let elevation = rng.range(3.0, 9.0).to_radians(); // [deg]
    let speed_mps = if rng.uniform() < 0.5 { 8.0 } else { -8.0 }; // [m/s]
    let across = DVec3::new(azimuth.cos(), -azimuth.sin(), 0.0);
    let towards = az_el_to_los(DVec2::new(azimuth, elevation));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::statistics::Lock;
    use crate::models::ground::city::City;
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
}
