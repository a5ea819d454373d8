//! The line-of-sight error by cause.

use super::bench::{Bench, CONTROLLERS, FIELD, FINE};
use super::job::{Job, all};
use super::results::{Budget, Cause, LosFigures, LosSums, Source};
use crate::eval::EvalError;

const SCENARIO: &str = "eval/table2_urban.toml";
/// The causes and how a run leaves each out.
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

/// Root of a difference of squares, with its sign.
fn root_difference(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    let difference = a?.powi(2) - b?.powi(2);
    Some(difference.abs().sqrt().copysign(difference))
}

/// The runs of a budget by what is left out: nothing, all causes, then each cause, then all but each.
fn groups() -> Vec<Vec<&'static [&'static str]>> {
    let everything = SWITCHES.iter().map(|(_, off)| *off).collect();
    let mut groups = vec![vec![], everything];
    groups.extend(SWITCHES.iter().map(|(_, off)| vec![*off]));
    groups.extend((0..SWITCHES.len()).map(|kept| {
        let others = SWITCHES.iter().enumerate().filter(|(i, _)| *i != kept);
        others.map(|(_, (_, off))| *off).collect()
    }));
    groups
}

/// The causes, from the errors of all groups of runs [µrad rms].
fn causes(rms_urad: impl Fn(usize) -> Option<f64>) -> Vec<Cause> {
    let count = SWITCHES.len();
    (SWITCHES.iter().enumerate())
        .map(|(i, (name, off))| Cause {
            name,
            switch: off.join(", "),
            without_urad: rms_urad(2 + i),
            removed_urad: root_difference(rms_urad(0), rms_urad(2 + i)),
            only_urad: rms_urad(2 + count + i),
        })
        .collect()
}

impl Bench {
    pub(super) fn budget(&self) -> Result<Vec<Budget>, EvalError> {
        let mut rows = Vec::new();
        for (controller, law) in CONTROLLERS.into_iter().skip(1) {
            for (detector, set) in [("field", FIELD), ("fine", FINE)] {
                rows.push(self.budget_of(controller, law, detector, set)?);
            }
        }
        Ok(rows)
    }

    fn budget_of(
        &self,
        controller: &'static str,
        law: &[&str],
        detector: &'static str,
        set: &[&str],
    ) -> Result<Budget, EvalError> {
        let length: &[&str] = &[if self.quick {
            "duration_s=6"
        } else {
            "duration_s=14"
        }];
        let seeds = self.seeds(8, 2);
        let jobs: Vec<Job> = groups()
            .iter()
            .flat_map(|off| {
                let changes = [&[length, set, law], &off[..]].concat();
                seeds
                    .clone()
                    .map(move |seed| Job::blind(SCENARIO, &changes, seed))
            })
            .collect();
        let label = format!("budget, {controller}, {detector}");
        let runs = all(&label, &jobs, &self.runner, |_, seen| {
            Ok(LosSums::of(&seen))
        })?;
        let each = seeds.count();
        let pooled: Vec<LosFigures> = runs.chunks(each).map(LosFigures::pooled).collect();
        let rms_urad = |group: usize| pooled.get(group).and_then(|figures| figures.rms_urad);
        let causes = causes(rms_urad);
        let accounted_urad2: f64 = (causes.iter())
            .filter_map(|cause| cause.removed_urad)
            .map(|urad| urad * urad.abs())
            .sum();
        let all = pooled.first().copied().unwrap_or_default();
        Ok(Budget {
            detector,
            controller,
            source: Source::of(&jobs[..each.min(jobs.len())]),
            all,
            none_urad: rms_urad(1),
            causes,
            beam_urad: root_difference(all.beam_rms_urad, all.rms_urad),
            residual_urad: all.rms_urad.map(|urad| {
                let rest_urad2 = urad * urad - accounted_urad2;
                rest_urad2.abs().sqrt().copysign(rest_urad2)
            }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_squares_keep_their_sign() {
        assert_eq!(root_difference(Some(5.0), Some(4.0)), Some(3.0));
        assert_eq!(root_difference(Some(4.0), Some(5.0)), Some(-3.0));
        assert_eq!(root_difference(None, Some(1.0)), None);
    }
}
