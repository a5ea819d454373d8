//! The end of a run: outcome, summary, report.

use crate::app::{Options, RunError, VERSION};
use crate::components::beam::{BeamState, Dose};
use crate::components::capture::Tier;
use crate::components::detect::Detector;
use crate::components::engage::Interlocks;
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::Mount;
use crate::components::record::{History, Recording, StateHash};
use crate::components::run::SimClock;
use crate::components::run::Stopwatch;
use crate::components::track::{Tracker, TrackingState};
use crate::models::air::atmosphere::{extinction_per_m, transmittance};
use crate::report::{
    ContactBox, ContactFrame, MissDistances, MissStats, ReportData, Shares, StateSpan, Summary,
    UavSummary, write_report,
};
use crate::scenario::Loaded;
use bevy::platform::cell::SyncCell;
use bevy::prelude::*;
use std::time::Duration;

/// What a finished run has to say.
pub struct Finished {
    /// The numbers.
    pub summary: Summary,
    /// What the report shows.
    pub report: ReportData,
}

/// Ends a run that took `elapsed` of wall-clock time: closes its recording and writes summary and
/// report beside it, if it has an output folder.
pub fn conclude(
    world: &mut World,
    loaded: &Loaded,
    options: &Options,
    elapsed: Duration,
) -> Result<Finished, RunError> {
    if let Some(recorder) = world.resource_mut::<Recording>().recorder.take() {
        SyncCell::to_inner(recorder).finish()?;
    }
    let finished = finish(world, loaded, options, elapsed);
    if let Some(out) = &options.out {
        let path = out.join("summary.json");
        let text = serde_json::to_string_pretty(&finished.summary)? + "\n";
        std::fs::write(&path, text).map_err(|source| RunError::Output { path, source })?;
        write_report(&out.join("report.html"), &finished.report)?;
    }
    Ok(finished)
}

/// Sums up a run that took `elapsed` of wall-clock time.
pub fn finish(
    world: &mut World,
    loaded: &Loaded,
    options: &Options,
    elapsed: Duration,
) -> Finished {
    let clock = *world.resource::<SimClock>();
    let mut stations = world.query::<&BeamState>();
    let beam = stations.iter(world).next().copied().unwrap_or_default();
    let mut uavs = world.query::<(&Uav, &UavStatus, &HeatedSkin, &Dose)>();
    let mut doses: Vec<_> = uavs
        .iter(world)
        .map(|(uav, .., dose)| (uav.index, *dose))
        .collect();
    doses.sort_by_key(|(index, _)| *index);
    let mut statuses: Vec<_> = uavs
        .iter(world)
        .map(|(uav, status, skin, _)| {
            (
                uav.index,
                uav.name.clone(),
                *status,
                skin.material.failure_temperature_k,
            )
        })
        .collect();
    statuses.sort_by_key(|(index, ..)| *index);
    let failure_temperature_k = statuses.first().map(|(.., kelvin)| *kelvin);
    let conditions = conditions(world);
    let stopwatch = *world.resource::<Stopwatch>();
    let history = world.resource::<History>();
    let tracker = world.resource::<Tracker>();
    let interlocks = world.resource::<Interlocks>();
    let (outcome, reason) = outcome(&statuses, history, tracker, interlocks, &conditions);
    let miss = |tier: Tier| {
        MissStats::of(
            history.miss_px[tier as usize]
                .iter()
                .map(|(_, distance)| *distance),
        )
    };
    let down = statuses
        .iter()
        .filter(|(_, _, status, _)| status.neutralised())
        .count();
    let neutralised = down == statuses.len();
    let share = |part: Duration| part.as_secs_f64() / elapsed.as_secs_f64().max(1e-9);
    let (render, inference) = (share(stopwatch.render), share(stopwatch.inference));
    let summary = Summary {
        scenario: loaded.scenario.name.clone(),
        version: VERSION.into(),
        seed: options.seed.unwrap_or(loaded.scenario.seed),
        outcome: outcome.into(),
        reason,
        state_hash: format!("{:016x}", world.resource::<StateHash>().0),
        simulated_s: clock.t_s(),
        real_time_factor: clock.t_s() / elapsed.as_secs_f64().max(1e-9),
        time_to_acquire_s: history.acquired_s,
        time_to_neutralise_s: history
            .neutralised_s
            .iter()
            .flatten()
            .copied()
            .reduce(f64::max)
            .filter(|_| neutralised && !statuses.is_empty()),
        miss_distance_px: MissDistances {
            coarse: miss(Tier::Coarse),
            precise: miss(Tier::Precise),
        },
        dwell_s: beam.dwell_s,
        distractor_s: beam.distractor_s,
        energy_j: beam.energy_j,
        energy_per_neutralised_j: (down > 0).then(|| beam.energy_j / down as f64),
        uavs: statuses
            .iter()
            .zip(&doses)
            .map(|((index, name, status, _), (_, dose))| UavSummary {
                name: name.clone(),
                status: status.name().into(),
                energy_j: dose.energy_j,
                dwell_s: dose.dwell_s,
                neutralised_s: history.neutralised_s.get(*index).copied().flatten(),
            })
            .collect(),
        share: Shares {
            render,
            inference,
            other: (1.0 - render - inference).max(0.0),
        },
    };
    let detector = world.resource::<Detector>();
    let report = report(
        loaded,
        &summary,
        history,
        tracker,
        detector,
        failure_temperature_k,
    );
    Finished { summary, report }
}

/// What of its contrast the nearest UAV keeps through the air, where that is too little to see.
fn conditions(world: &mut World) -> String {
    // Koschmieder's threshold: what keeps less than 2 % of its contrast is not seen.
    const THRESHOLD: f64 = 0.02;
    let mut uavs = world.query_filtered::<&Flight, Without<Distractor>>();
    let mut mounts = world.query::<&Mount>();
    let Some(station) = mounts.iter(world).next().map(|mount| mount.r_enu_m) else {
        return String::new();
    };
    let nearest_m = uavs
        .iter(world)
        .map(|flight| flight.state.r_enu_m.distance(station))
        .fold(f64::INFINITY, f64::min);
    let visibility_m = world.resource::<Environment>().weather.visibility_m;
    let kept = transmittance(extinction_per_m(visibility_m, 550e-9), nearest_m);
    if kept > THRESHOLD || !nearest_m.is_finite() {
        return String::new();
    }
    format!(
        ": through {visibility_m:.0} m of visibility a UAV at {nearest_m:.0} m keeps {kept:.0e} of \
         its contrast"
    )
}

/// One word and one sentence on how it ended.
fn outcome(
    statuses: &[(usize, String, UavStatus, f64)],
    history: &History,
    tracker: &Tracker,
    interlocks: &Interlocks,
    conditions: &str,
) -> (&'static str, String) {
    let down = statuses
        .iter()
        .filter(|(_, _, status, _)| status.neutralised())
        .count();
    let crashed: Vec<&str> = statuses
        .iter()
        .filter(|(_, _, status, _)| *status == UavStatus::Crashed)
        .map(|(_, name, ..)| name.as_str())
        .collect();
    if !statuses.is_empty() && down == statuses.len() {
        return (
            "neutralised",
            format!("{down} of {down} UAVs brought down by the laser"),
        );
    }
    if down > 0 {
        return (
            "partly_neutralised",
            format!("{down} of {} UAVs brought down", statuses.len()),
        );
    }
    if !crashed.is_empty() {
        return (
            "crashed",
            format!("{} flew into the city", crashed.join(", ")),
        );
    }
    if history.acquired_s.is_some() {
        let reached = tracker
            .changes
            .iter()
            .map(|change| change.to)
            .filter(|state| *state != TrackingState::Lost)
            .max_by_key(|state| *state as u8);
        let why = if interlocks.0.is_empty() {
            "the target outlasted the run".to_string()
        } else {
            format!("at the end: {}", interlocks.0.join(", "))
        };
        let reached = reached.map_or("search", TrackingState::name);
        return ("tracked", format!("tracking reached {reached}; {why}"));
    }
    let tried = tracker
        .changes
        .iter()
        .filter(|change| change.to == TrackingState::Acquire)
        .count();
    let why = if tried == 0 {
        format!("the search camera found no candidate{conditions}")
    } else {
        format!("{tried} candidates were not confirmed by the coarse camera")
    };
    ("not_acquired", why)
}

fn report(
    loaded: &Loaded,
    summary: &Summary,
    history: &History,
    tracker: &Tracker,
    detector: &Detector,
    failure_temperature_k: Option<f64>,
) -> ReportData {
    let hz = f64::from(loaded.scenario.tick_hz);
    let at_s = |tick: u64| tick as f64 / hz;
    let ends = tracker
        .changes
        .iter()
        .skip(1)
        .map(|change| at_s(change.tick));
    let states = tracker
        .changes
        .iter()
        .zip(ends.chain([summary.simulated_s]))
        .map(|(change, t1_s)| StateSpan {
            t0_s: at_s(change.tick),
            t1_s,
            name: change.to.name().into(),
            reason: change.reason.clone(),
        })
        .collect();
    let frames = history
        .frames
        .iter()
        .map(|frame| {
            let [dx, dy] = frame.offset_px.map(f64::from);
            let boxes = frame.detections.iter().map(|detection| {
                let [x0, y0, x1, y1] = detection.box_px;
                ContactBox {
                    label: detector.caption(detection),
                    rect_px: [x0 - dx, y0 - dy, x1 - dx, y1 - dy],
                    colour: [0, 158, 115],
                }
            });
            ContactFrame {
                camera: frame.tier.name().into(),
                time_s: frame.t_s,
                width: frame.size_px[0] as u16,
                height: frame.size_px[1] as u16,
                rgb8: frame.rgb8.to_vec(),
                boxes: boxes.collect(),
                reticle_px: [frame.centre_px[0] - dx, frame.centre_px[1] - dy],
                caption: frame.state.into(),
            }
        })
        .collect();
    ReportData {
        title: format!("Boresight: {}", loaded.scenario.name),
        scenario: summary.scenario.clone(),
        version: summary.version.clone(),
        seed: summary.seed,
        state_hash: summary.state_hash.clone(),
        outcome: summary.outcome.clone(),
        succeeded: summary.outcome == "neutralised",
        summary: rows(summary),
        miss_coarse_px: history.miss_px[Tier::Coarse as usize].clone(),
        miss_precise_px: history.miss_px[Tier::Precise as usize].clone(),
        irradiance_wpm2: history.irradiance_wpm2.clone(),
        power_in_bucket_w: history.power_in_bucket_w.clone(),
        skin_temperature_k: history.skin_k.clone(),
        failure_temperature_k,
        los_error_urad: history.los_error_urad.clone(),
        states,
        frames,
    }
}

/// The summary as labels and values with their units.
fn rows(summary: &Summary) -> Vec<(String, String)> {
    let seconds = |t: Option<f64>| t.map_or("never".into(), |t| format!("{t:.2} s"));
    let miss = |stats: &Option<MissStats>| {
        stats.map_or("no frames".into(), |s| {
            format!(
                "mean {:.2}, rms {:.2}, 95 % {:.2}, 99 % {:.2} px ({} frames)",
                s.mean, s.rms, s.p95, s.p99, s.n
            )
        })
    };
    let percent = |x: f64| format!("{:.1} %", 100.0 * x);
    let share = &summary.share;
    [
        (
            "outcome",
            format!("{}: {}", summary.outcome, summary.reason),
        ),
        ("time to acquire", seconds(summary.time_to_acquire_s)),
        ("time to neutralise", seconds(summary.time_to_neutralise_s)),
        (
            "coarse miss distance",
            miss(&summary.miss_distance_px.coarse),
        ),
        (
            "precise miss distance",
            miss(&summary.miss_distance_px.precise),
        ),
        (
            "dwell on the aim point",
            format!("{:.2} s", summary.dwell_s),
        ),
        (
            "beam on distractors",
            format!("{:.2} s", summary.distractor_s),
        ),
        (
            "energy emitted",
            format!("{:.1} kJ", 1e-3 * summary.energy_j),
        ),
        (
            "energy per UAV down",
            summary
                .energy_per_neutralised_j
                .map_or("none down".into(), |j| format!("{:.1} kJ", 1e-3 * j)),
        ),
        ("simulated", format!("{:.2} s", summary.simulated_s)),
        (
            "real-time factor",
            format!("{:.3}", summary.real_time_factor),
        ),
        (
            "wall time",
            format!(
                "rendering {}, inference {}, other {}",
                percent(share.render),
                percent(share.inference),
                percent(share.other)
            ),
        ),
        ("seed", summary.seed.to_string()),
        ("state hash", summary.state_hash.clone()),
    ]
    .map(|(label, value)| (label.to_string(), value))
    .into_iter()
    .chain(summary.uavs.iter().map(|uav| {
        let value = format!(
            "{}, {:.1} kJ, dwell {:.2} s",
            uav.status,
            1e-3 * uav.energy_j,
            uav.dwell_s
        );
        (format!("UAV {}", uav.name), value)
    }))
    .collect()
}

/// The summary for a terminal.
pub fn table(summary: &Summary) -> String {
    rows(summary)
        .iter()
        .map(|(label, value)| format!("{label:<24}{value}\n"))
        .collect()
}
