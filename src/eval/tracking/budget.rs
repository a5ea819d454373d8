//! The line-of-sight error by cause.

use super::bench::{Bench, CONTROLLERS, FIELD, FINE};
use super::job::{Job, all};
use super::results::{Budget, Cause, LosFigures, LosSums, Source};
use crate::eval::EvalError;

const SCENARIO: &str = "eval/table2_urban.toml";
/// A cause and how a run leaves it out.
type Switch = (&'static str, &'static [&'static str]);

/// What puts error in. Independent of each other, they add in squares.
const SOURCES: [Switch; 9] = [
    (
        "detector noise and misses",
        &["detector.truth.noise_px=0", "detector.truth.miss_rate=0"],
    ),
    (
        "turbulence before the cameras",
        &["turbulence.imaging=false"],
    ),
    ("gyros", &["station.mount.gyro=ideal"]),
    (
        "base motion",
        &["station.mount.base_motion={ rms_urad = 0, frequency_hz = 1 }"],
    ),
    (
        "friction, cogging, encoders",
        &[
            "station.mount.friction=false",
            "station.mount.cogging_share=0",
            "station.mount.encoder_bits=40",
        ],
    ),
    ("mirror's sensor", &["station.mount.mirror_noise_urad=0"]),
    (
        "boresight errors",
        &["station.mount.boresight_sigma_urad=0"],
    ),
    ("wind on the mount", &["station.mount.wind_load=false"]),
    ("wind on the UAV", &["weather.wind_speed_mps=0"]),
];
/// What only passes error on, more or less of it: left as they are where a source is alone.
const CONDITIONS: [Switch; 3] = [
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
    ("structural mode", &["station.mount.structural_mode_hz=0"]),
    (
        "mirror bandwidth",
        &["station.mount.mirror_bandwidth_hz=5000"],
    ),
];

/// Root of a difference of squares, with its sign.
fn root_difference(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    let difference = a?.powi(2) - b?.powi(2);
    Some(difference.abs().sqrt().copysign(difference))
}

/// The runs of a budget by what is left out: nothing, all sources, then each source and condition, then
/// all sources but each.
fn groups() -> Vec<Vec<&'static [&'static str]>> {
    let everything = SOURCES.iter().map(|(_, off)| *off).collect();
    let mut groups = vec![vec![], everything];
    groups.extend(SOURCES.iter().chain(&CONDITIONS).map(|(_, off)| vec![*off]));
    groups.extend((0..SOURCES.len()).map(|kept| {
        let others = SOURCES.iter().enumerate().filter(|(i, _)| *i != kept);
        others.map(|(_, (_, off))| *off).collect()
    }));
    groups
}

/// The causes, from the errors of all groups of runs [µrad rms].
fn causes(rms_urad: impl Fn(usize) -> Option<f64>) -> Vec<Cause> {
    let alone_from = 2 + SOURCES.len() + CONDITIONS.len();
    (SOURCES.iter().chain(&CONDITIONS).enumerate())
        .map(|(i, (name, off))| Cause {
            name,
            switch: off.join(", "),
            without_urad: rms_urad(2 + i),
            removed_urad: root_difference(rms_urad(0), rms_urad(2 + i)),
            alone_urad: (SOURCES.get(i))
                .and_then(|_| root_difference(rms_urad(alone_from + i), rms_urad(1))),
        })
        .collect()
}

/// The sources, each alone, and what is left without any, added in squares [µrad rms].
fn sum_urad(none_urad: Option<f64>, causes: &[Cause]) -> Option<f64> {
    let alone_urad2 = causes.iter().filter_map(|cause| cause.alone_urad);
    let alone_urad2: f64 = alone_urad2.map(|urad| urad * urad.abs()).sum();
    Some((none_urad?.powi(2) + alone_urad2).max(0.0).sqrt())
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
        let all = pooled.first().copied().unwrap_or_default();
        Ok(Budget {
            detector,
            controller,
            source: Source::of(&jobs[..each.min(jobs.len())]),
            all,
            none_urad: rms_urad(1),
            sum_urad: sum_urad(rms_urad(1), &causes),
            causes,
            beam_urad: root_difference(all.beam_rms_urad, all.rms_urad),
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

    #[test]
    fn independent_sources_add_up_to_the_whole() {
        // Errors of a made-up loop: what is left is 1, source i alone puts in (i + 1)² more.
        let variance = |kept: &dyn Fn(usize) -> bool| {
            let parts = (0..SOURCES.len()).filter(|i| kept(*i));
            1.0 + parts.map(|i| (i as f64 + 1.0).powi(2)).sum::<f64>()
        };
        let (sources, switches) = (SOURCES.len(), SOURCES.len() + CONDITIONS.len());
        let rms_urad = |group: usize| {
            let urad2 = match group {
                0 => variance(&|_| true),
                1 => variance(&|_| false),
                group if group < 2 + switches => variance(&|i| i != group - 2),
                group => variance(&|i| i == group - 2 - switches),
            };
            Some(urad2.sqrt())
        };
        assert_eq!(groups().len(), 2 + switches + sources);
        let causes = causes(rms_urad);
        for (i, cause) in causes.iter().enumerate().take(sources) {
            let expected = i as f64 + 1.0;
            assert!((cause.alone_urad.unwrap() - expected).abs() < 1e-9);
            assert!((cause.removed_urad.unwrap() - expected).abs() < 1e-9);
        }
        assert_eq!(causes[sources].alone_urad, None);
        let sum = sum_urad(rms_urad(1), &causes).unwrap();
        assert!((sum - rms_urad(0).unwrap()).abs() < 1e-9);
    }
}
