//! The end of a run: outcome, summary, report.

use super::ReportError;
use super::run::{ContactBox, ContactFrame, ReportData, StationReport, write_report};
use super::states::StateSpan;
use super::statistics::MissStats;
use super::uavs::{CrashSummary, DealingSummary, Light, SightSummary, UavSummary};
use crate::VERSION;
use crate::app::Options;
use crate::components::beam::{BeamState, Dose};
use crate::components::capture::{SensorCamera, StationCameras, Tier};
use crate::components::detect::DetectorInUse;
use crate::components::engage::Interlocks;
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Mount, Station, Stations};
use crate::components::network::{Holding, Holdings};
use crate::components::record::{
    CameraHistory, Fate, Fates, History, KeptFrame, Recording, StateHash,
};
use crate::components::run::Stopwatch;
use crate::components::run::{RunEnd, SimClock};
use crate::components::track::{Tracker, TrackingState};
use crate::models::air::atmosphere::{extinction_per_m, transmittance};
use crate::models::decision::belief::{Belief, Term};
use crate::models::engage::outcome::Outcome;
use crate::models::tracking::picture::Follower;
use crate::output;
use crate::scenario::Loaded;
use crate::warning::Warning;
use bevy::platform::cell::SyncCell;
use bevy::prelude::*;
use serde::Serialize;
use std::time::Duration;

/// The numbers of one run, as `summary.json` has them; its keys do not change.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scenario.
    pub scenario: String,
    /// Version of the program.
    pub version: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// How the run ended.
    pub outcome: Outcome,
    /// Why it ended so.
    pub reason: String,
    /// Hash of the final state, 16 hexadecimal digits.
    pub state_hash: String,
    /// Simulated time \[s\].
    pub simulated_s: f64,
    /// Time at which it was stopped from outside (Ctrl-C, SIGTERM), before its end \[s\].
    pub stopped_s: Option<f64>,
    /// Simulated over elapsed time.
    pub real_time_factor: f64,
    /// When the coarse or precise camera of a station first held a target \[s\].
    pub time_to_acquire_s: Option<f64>,
    /// Time at which the last target failed \[s\].
    pub time_to_neutralise_s: Option<f64>,
    /// Distance between the target and the boresight \[px\].
    pub miss_distance_px: MissDistances,
    /// Time for which the firing beam's centre lay on the aim point \[s\].
    pub dwell_s: f64,
    /// Time for which the firing beam's axis lay on a distractor \[s\].
    pub distractor_s: f64,
    /// Time for which the firing beam's axis met a keep-out zone \[s\].
    pub keep_out_s: f64,
    /// Time for which the coarse or precise camera held what is no UAV \[s\].
    pub wrong_object_s: f64,
    /// UAVs that came within the asset's radius unharmed.
    pub leakers: usize,
    /// Energy that left the laser \[J\].
    pub energy_j: f64,
    /// The same for each UAV brought down by it \[J\]; `None` without any.
    pub energy_per_neutralised_j: Option<f64>,
    /// From each kill of a station to its next first shot at another target, of all stations \[s\].
    pub kill_to_shot_s: Vec<f64>,
    /// Sun and daylight, at the end.
    pub light: Light,
    /// Each UAV, in the order of the scenario.
    pub uavs: Vec<UavSummary>,
    /// Each station, in the order of the scenario.
    pub stations: Vec<StationSummary>,
    /// Each object of the stations' network, in the order of the identities; none without a network.
    pub objects: Vec<ObjectSummary>,
    /// Where the elapsed time went.
    pub share: Shares,
}

/// What a station did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StationSummary {
    /// Name in the scenario.
    pub name: String,
    /// When its coarse or precise camera first held a target \[s\].
    pub acquired_s: Option<f64>,
    /// Energy emitted \[J\].
    pub energy_j: f64,
    /// Time for which its firing beam's centre lay on its target's aim point \[s\].
    pub dwell_s: f64,
    /// Time for which its firing beam lay on a distractor \[s\].
    pub distractor_s: f64,
    /// Time for which its firing beam met one of its keep-out zones \[s\].
    pub keep_out_s: f64,
    /// Time for which its coarse or precise camera held what is no UAV \[s\].
    pub wrong_object_s: f64,
    /// Times at which it lost its target \[s\].
    pub lost_s: Vec<f64>,
    /// From each kill to its next first shot at another target \[s\].
    pub kill_to_shot_s: Vec<f64>,
}

/// An object that the stations' network knew.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ObjectSummary {
    /// Its identity: the station that first had it, and that station's number of it.
    pub identity: String,
    /// When it was first and last followed \[s\].
    pub from_s: f64,
    pub to_s: f64,
    /// Longest time between two exposures that showed it, of whatever station \[s\].
    pub longest_gap_s: f64,
    /// The stations whose cameras followed it.
    pub stations: Vec<String>,
    /// The stations that were to engage it, one after the other, with the time \[s\].
    pub engaged_by: Vec<(f64, String)>,
}

impl ObjectSummary {
    /// As the report has it.
    fn row(&self) -> [String; 6] {
        let seconds = |s: f64| format!("{s:.2} s");
        let engaged = |(t_s, name): &(f64, String)| format!("{name} ({t_s:.1} s)");
        [
            self.identity.clone(),
            seconds(self.from_s),
            seconds(self.to_s),
            seconds(self.longest_gap_s),
            self.stations.join(", "),
            (self.engaged_by.iter().map(engaged).collect::<Vec<_>>()).join(", "),
        ]
    }
}

/// Miss distance of both tracking cameras \[px\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MissDistances {
    /// Coarse camera.
    pub coarse: Option<MissStats>,
    /// Precise camera.
    pub precise: Option<MissStats>,
}

/// Shares of the elapsed time, 0 to 1 each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Shares {
    /// Drawing the cameras' images.
    pub render: f64,
    /// Waiting for the detector.
    pub inference: f64,
    /// Everything else.
    pub other: f64,
}

/// Results of a finished run.
pub struct Finished {
    /// The numbers.
    pub summary: Summary,
    /// What the report shows.
    pub report: ReportData,
    /// What its user should know of its files.
    pub warnings: Vec<Warning>,
}

/// Ends a run that took `elapsed` of wall-clock time: closes its recording and writes summary and
/// report beside it, if it has an output folder.
pub fn conclude(
    world: &mut World,
    loaded: &Loaded,
    options: &Options,
    elapsed: Duration,
) -> Result<Finished, ReportError> {
    let recorder = world.resource_mut::<Recording>().recorder.take();
    let written = recorder.map(|recorder| SyncCell::to_inner(recorder).finish());
    let written = written.transpose()?;
    let mut finished = finish(world, loaded, options, elapsed);
    if let (Some(written), Some(out)) = (written, &options.out) {
        let simulated_s = finished.summary.simulated_s;
        let warning = written.warning(&out.join("run.mcap"), simulated_s);
        finished.warnings.extend(warning);
    }
    if let Some(out) = &options.out {
        let text = serde_json::to_string_pretty(&finished.summary)? + "\n";
        output::write(&out.join("summary.json"), text)?;
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
    let fates = fates(world);
    let conditions = conditions(world);
    let (outcome, mut reason) = outcome(world, &fates, &conditions);
    let clock = world.resource::<SimClock>();
    let stopped = world.resource::<RunEnd>().stopped;
    let stopped_s = stopped.map(|tick| clock.at_s(tick));
    if let Some(t_s) = stopped_s {
        let whole_s = loaded.scenario.duration_s;
        reason += &format!("; the run was stopped at {t_s:.2} s of {whole_s} s");
    }
    let summary = Summary {
        scenario: loaded.scenario.name.clone(),
        version: VERSION.into(),
        seed: options.seed.unwrap_or(loaded.scenario.seed),
        outcome,
        reason,
        stopped_s,
        ..summary(world, &fates, elapsed)
    };
    let report = report(world, loaded, &summary, &fates);
    Finished {
        summary,
        report,
        warnings: Vec::new(),
    }
}

/// What became of a UAV.
struct Ended {
    /// Its index in the scenario.
    index: usize,
    name: String,
    status: UavStatus,
    dose: Dose,
    failure_temperature_k: f64,
    hole_m2: f64,
    lost: Vec<String>,
}

/// What became of each UAV, in the order of the scenario.
fn fates(world: &mut World) -> Vec<Ended> {
    let mut uavs = world.query::<(&Uav, &UavStatus, &HeatedSkin, &Dose)>();
    let mut fates: Vec<Ended> = uavs
        .iter(world)
        .map(|(uav, status, skin, dose)| Ended {
            index: uav.index,
            name: uav.name.clone(),
            status: *status,
            dose: *dose,
            failure_temperature_k: skin.limit_k,
            hole_m2: skin.hole_m2,
            lost: skin.lost_parts(),
        })
        .collect();
    fates.sort_by_key(|fate| fate.index);
    fates
}

/// Number of UAVs that the laser brought down.
fn brought_down(fates: &[Ended]) -> usize {
    fates
        .iter()
        .filter(|fate| fate.status.neutralised())
        .count()
}

/// The numbers that the world has; those of the scenario are left empty.
fn summary(world: &World, fates: &[Ended], elapsed: Duration) -> Summary {
    let clock = world.resource::<SimClock>();
    let known = &world.resource::<Fates>().uavs;
    let light = light(world);
    let stations = &world.resource::<Stations>().0;
    let of_stations = station_summaries(world);
    let sum = |of: fn(&StationSummary) -> f64| of_stations.iter().map(of).sum::<f64>();
    let energy_j = sum(|station| station.energy_j);
    let acquired_s = (of_stations.iter()).filter_map(|station| station.acquired_s);
    let stopwatch = world.resource::<Stopwatch>();
    let elapsed_s = elapsed.as_secs_f64().max(1e-9);
    let miss = |tier: Tier| {
        let all = stations
            .iter()
            .flat_map(|station| miss_px(world, *station, tier));
        MissStats::of(all.map(|(_, px)| px))
    };
    let down = brought_down(fates);
    let all_down = down == fates.len() && !fates.is_empty();
    let last_s = (known.iter().filter_map(|fate| fate.neutralised_s)).reduce(f64::max);
    let share = |part: Duration| part.as_secs_f64() / elapsed_s;
    let (render, inference) = (share(stopwatch.render), share(stopwatch.inference));
    Summary {
        state_hash: format!("{:016x}", world.resource::<StateHash>().0),
        simulated_s: clock.t_s(),
        real_time_factor: clock.t_s() / elapsed_s,
        time_to_acquire_s: acquired_s.reduce(f64::min),
        time_to_neutralise_s: last_s.filter(|_| all_down),
        miss_distance_px: MissDistances {
            coarse: miss(Tier::Coarse),
            precise: miss(Tier::Precise),
        },
        dwell_s: sum(|station| station.dwell_s),
        distractor_s: sum(|station| station.distractor_s),
        keep_out_s: sum(|station| station.keep_out_s),
        wrong_object_s: sum(|station| station.wrong_object_s),
        leakers: known
            .iter()
            .filter(|fate| fate.at_asset_s.is_some())
            .count(),
        energy_j,
        energy_per_neutralised_j: (down > 0).then(|| energy_j / down as f64),
        kill_to_shot_s: (of_stations.iter())
            .flat_map(|station| station.kill_to_shot_s.iter().copied())
            .collect(),
        light,
        uavs: (fates.iter())
            .map(|fate| uav_summary(world, fate, &light))
            .collect(),
        stations: of_stations,
        objects: object_summaries(world),
        share: Shares {
            render,
            inference,
            other: (1.0 - render - inference).max(0.0),
        },
        ..Summary::default()
    }
}

/// Sun and daylight.
fn light(world: &World) -> Light {
    let backdrop = &world.resource::<Environment>().backdrop;
    let up = backdrop.sun_dir_enu.z.clamp(-1.0, 1.0);
    Light {
        sun_elevation_deg: up.asin().to_degrees(),
        illuminance_lx: 1e3 * backdrop.sky.global_illuminance_klx(),
    }
}

/// What became of a UAV, and why.
fn uav_summary(world: &World, ended: &Ended, light: &Light) -> UavSummary {
    let unknown = Fate::default();
    let known = &world.resource::<Fates>().uavs;
    let fate = known.get(ended.index).unwrap_or(&unknown);
    let stations = &world.resource::<Stations>().0;
    let cameras = (stations.iter())
        .filter_map(|station| world.get::<StationCameras>(*station))
        .flat_map(StationCameras::entities);
    let crash = fate.crash.as_ref().map(|crash| CrashSummary {
        t_s: crash.t_s,
        r_enu_m: crash.r_enu_m.to_array(),
        into: crash.into.clone(),
    });
    let summary = UavSummary {
        name: ended.name.clone(),
        status: ended.status.name().into(),
        energy_j: ended.dose.energy_j,
        dwell_s: ended.dose.dwell_s,
        neutralised_s: fate.neutralised_s,
        at_asset_s: fate.at_asset_s,
        acquired_s: fate.acquired_s,
        hottest_k: fate.hottest_k,
        fails_at_k: ended.failure_temperature_k,
        hole_m2: ended.hole_m2,
        lost: ended.lost.clone(),
        crash,
        why: None,
        stations: (stations.iter())
            .filter_map(|station| dealing_summary(world, *station, ended.index))
            .collect(),
        cameras: cameras
            .filter_map(|camera| sight_summary(world, *camera, ended.index))
            .collect(),
    };
    UavSummary {
        why: summary.reason(light),
        ..summary
    }
}

/// What a station had to do with a UAV.
fn dealing_summary(world: &World, station: Entity, uav: usize) -> Option<DealingSummary> {
    let history: &History = world.get(station)?;
    let dealing = history.dealings.get(&uav).cloned().unwrap_or_default();
    let mut refused: Vec<(String, f64)> = (dealing.refused_s.into_iter())
        .map(|(reason, lasted_s)| (reason.to_owned(), lasted_s))
        .collect();
    refused.sort_by(|a, b| b.1.total_cmp(&a.1));
    Some(DealingSummary {
        name: world.get::<Station>(station)?.name.clone(),
        clear_s: dealing.clear_s,
        hidden_s: dealing.hidden_s,
        held_s: dealing.held_s,
        refused,
    })
}

/// What a camera showed of a UAV.
fn sight_summary(world: &World, camera: Entity, uav: usize) -> Option<SightSummary> {
    let history: &CameraHistory = world.get(camera)?;
    let camera: &SensorCamera = world.get(camera)?;
    let sight = history.sights.get(&uav).cloned().unwrap_or_default();
    let wanted = world.resource::<DetectorInUse>().reading.start_score;
    Some(SightSummary {
        name: camera.name.to_string(),
        tier: camera.tier.word().into(),
        in_view_s: sight.in_view_s,
        hidden_s: sight.hidden_s,
        pictures: sight.pictures,
        found: sight.found,
        largest_px: sight.size_px.largest(),
        typical_px: sight.size_px.median(),
        contrast: sight.contrast.median(),
        grey_level: sight.grey.median(),
        best_score: sight.best_score.filter(|_| wanted > 0.0),
        wanted_score: Some(wanted).filter(|wanted| *wanted > 0.0),
    })
}

/// What each station did, in the order of the scenario.
fn station_summaries(world: &World) -> Vec<StationSummary> {
    let fates = &world.resource::<Fates>().uavs;
    let clock = world.resource::<SimClock>();
    let of = |station: &Entity| {
        let beam: &BeamState = world.get(*station)?;
        let history: &History = world.get(*station)?;
        let tracker: &Tracker = world.get(*station)?;
        Some(StationSummary {
            name: world.get::<Station>(*station)?.name.clone(),
            acquired_s: history.acquired_s,
            energy_j: beam.energy_j,
            dwell_s: beam.dwell_s,
            distractor_s: beam.distractor_s,
            keep_out_s: history.keep_out_s,
            wrong_object_s: history.wrong_object_s,
            lost_s: (tracker.changes.iter())
                .filter(|change| change.to == TrackingState::Lost)
                .map(|change| clock.at_s(change.tick))
                .collect(),
            kill_to_shot_s: kill_to_shot_s(&history.shots, fates),
        })
    };
    let stations = &world.resource::<Stations>().0;
    stations.iter().filter_map(of).collect()
}

/// From each kill by a station to its next first shot at another target [s].
fn kill_to_shot_s(shots: &[(f64, usize)], fates: &[Fate]) -> Vec<f64> {
    let of = |pair: &[(f64, usize)]| {
        let ((first_s, target), (next_s, _)) = (pair[0], pair[1]);
        let killed_s = fates.get(target)?.neutralised_s?;
        (first_s <= killed_s && killed_s <= next_s).then_some(next_s - killed_s)
    };
    shots.windows(2).filter_map(of).collect()
}

/// What the stations' network knew, in the order of the identities.
fn object_summaries(world: &World) -> Vec<ObjectSummary> {
    let stations = &world.resource::<Stations>().0;
    let names: Vec<&str> = (stations.iter())
        .filter_map(|station| Some(world.get::<Station>(*station)?.name.as_str()))
        .collect();
    let name = |station: usize| names.get(station).copied().unwrap_or_default().to_owned();
    let of = |(identity, holding): (&Follower, &Holding)| ObjectSummary {
        identity: identity.named(&name(identity.station)),
        from_s: holding.from_s,
        to_s: holding.to_s,
        longest_gap_s: holding.longest_gap_s,
        stations: holding.stations.iter().copied().map(name).collect(),
        engaged_by: (holding.engaged_by.iter())
            .map(|(t_s, station)| (*t_s, name(*station)))
            .collect(),
    };
    world.resource::<Holdings>().0.iter().map(of).collect()
}

/// Miss distances of a station's cameras of a tier: (time [s], distance [px]), camera after camera.
fn miss_px(world: &World, station: Entity, tier: Tier) -> Vec<(f64, f64)> {
    let cameras = world
        .get::<StationCameras>(station)
        .map_or(&[][..], StationCameras::entities);
    let of_tier = |camera: &&Entity| {
        (world.get::<SensorCamera>(**camera)).is_some_and(|camera| camera.tier == tier)
    };
    (cameras.iter().filter(of_tier))
        .filter_map(|camera| world.get::<CameraHistory>(*camera))
        .flat_map(|history| history.miss_px.iter().copied())
        .collect()
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
fn outcome(world: &World, fates: &[Ended], conditions: &str) -> (Outcome, String) {
    let stations = &world.resource::<Stations>().0;
    let trackers = || {
        stations
            .iter()
            .filter_map(|station| world.get::<Tracker>(*station))
    };
    let acquired = (stations.iter()).any(|station| {
        world
            .get::<History>(*station)
            .is_some_and(|history| history.acquired_s.is_some())
    });
    let down = brought_down(fates);
    let known = &world.resource::<Fates>().uavs;
    let crashed: Vec<String> = fates
        .iter()
        .filter(|fate| matches!(fate.status, UavStatus::Struck | UavStatus::Crashed))
        .map(|fate| {
            let crash = known.get(fate.index).and_then(|fate| fate.crash.as_ref());
            let into = crash.map_or("the city or another UAV", |crash| &crash.into);
            let when = crash.map_or(String::new(), |crash| format!(" at {:.1} s", crash.t_s));
            format!("{} flew into {into}{when}", fate.name)
        })
        .collect();
    if !fates.is_empty() && down == fates.len() {
        return (
            Outcome::Neutralised,
            format!("{down} of {down} UAVs brought down by the laser"),
        );
    }
    if down > 0 {
        return (
            Outcome::PartlyNeutralised,
            format!("{down} of {} UAVs brought down", fates.len()),
        );
    }
    if !crashed.is_empty() {
        return (Outcome::Crashed, crashed.join(", "));
    }
    if acquired {
        let reached = trackers()
            .flat_map(|tracker| &tracker.changes)
            .map(|change| change.to)
            .filter(|state| *state != TrackingState::Lost)
            .max_by_key(|state| *state as u8);
        let interlocks = stations
            .iter()
            .filter_map(|station| world.get::<Interlocks>(*station));
        let mut reasons: Vec<&str> = Vec::new();
        for reason in interlocks.flat_map(|interlocks| &interlocks.reasons) {
            if !reasons.contains(reason) {
                reasons.push(reason);
            }
        }
        let why = if reasons.is_empty() {
            "the target outlasted the run".to_string()
        } else {
            format!("at the end: {}", reasons.join(", "))
        };
        let reached = reached.map_or("search", TrackingState::name);
        return (
            Outcome::Tracked,
            format!("tracking reached {reached}; {why}"),
        );
    }
    let tried = trackers()
        .flat_map(|tracker| &tracker.changes)
        .filter(|change| change.to == TrackingState::Acquire)
        .count();
    let why = if tried == 0 {
        format!("the search camera found no candidate{conditions}")
    } else {
        let were = if tried == 1 {
            "candidate was"
        } else {
            "candidates were"
        };
        format!("{tried} {were} confirmed neither by the coarse nor by the precise camera")
    };
    (Outcome::NotAcquired, why)
}

/// What the page of the run shows.
fn report(world: &World, loaded: &Loaded, summary: &Summary, fates: &[Ended]) -> ReportData {
    let detector = world.resource::<DetectorInUse>();
    let stations = &world.resource::<Stations>().0;
    let mut frames: Vec<&KeptFrame> = (stations.iter())
        .filter_map(|station| world.get::<History>(*station))
        .flat_map(|history| &history.frames)
        .collect();
    frames.sort_by_key(|frame| frame.tick);
    let failure_temperature_k = fates.first().map(|fate| fate.failure_temperature_k);
    ReportData {
        title: format!("Boresight: {}", loaded.scenario.name),
        scenario: summary.scenario.clone(),
        version: summary.version.clone(),
        seed: summary.seed,
        state_hash: summary.state_hash.clone(),
        outcome: summary.outcome.name().into(),
        succeeded: summary.outcome == Outcome::Neutralised,
        summary: rows(summary),
        stations: (stations.iter())
            .filter_map(|station| station_report(world, *station, loaded, summary.simulated_s))
            .map(|report| StationReport {
                failure_temperature_k,
                ..report
            })
            .collect(),
        light: summary.light,
        uavs: summary.uavs.clone(),
        objects: summary.objects.iter().map(ObjectSummary::row).collect(),
        frames: (frames.into_iter())
            .map(|frame| contact_frame(detector, frame))
            .collect(),
    }
}

/// What the page shows of a station, in a run that ended at `end_s` [s].
fn station_report(
    world: &World,
    station: Entity,
    loaded: &Loaded,
    end_s: f64,
) -> Option<StationReport> {
    let history: &History = world.get(station)?;
    Some(StationReport {
        name: world.get::<Station>(station)?.name.clone(),
        miss_coarse_px: miss_px(world, station, Tier::Coarse),
        miss_precise_px: miss_px(world, station, Tier::Precise),
        irradiance_wpm2: history.irradiance_wpm2.clone(),
        power_in_bucket_w: history.power_in_bucket_w.clone(),
        skin_temperature_k: history.skin_k.clone(),
        failure_temperature_k: None,
        los_error_urad: history.los_error_urad.clone(),
        belief: belief(history),
        states: state_spans(world.get(station)?, loaded, end_s),
    })
}

/// What speaks for the target: each term that says anything, and all together.
fn belief(history: &History) -> Vec<(&'static str, Vec<(f64, f64)>)> {
    let series = |value: &dyn Fn(&Belief) -> f64| {
        let points = history.belief.iter();
        points.map(|(t_s, belief)| (*t_s, value(belief))).collect()
    };
    let says = |term: &Term| {
        let says = |belief: &Belief| belief.0[*term as usize].abs() > 0.0;
        history.belief.iter().any(|(_, belief)| says(belief))
    };
    let terms = Term::ALL.into_iter().filter(says);
    let each = terms.map(|term| (term.name(), series(&|belief| belief.0[term as usize])));
    each.chain([("all", series(&Belief::log_odds))]).collect()
}

/// The states of the tracker until `end_s`.
fn state_spans(tracker: &Tracker, loaded: &Loaded, end_s: f64) -> Vec<StateSpan> {
    let changes = &tracker.changes;
    let hz = f64::from(loaded.scenario.tick_hz);
    let at_s = |tick: u64| tick as f64 / hz;
    let ends = changes.iter().skip(1).map(|change| at_s(change.tick));
    changes
        .iter()
        .zip(ends.chain([end_s]))
        .map(|(change, t1_s)| StateSpan {
            t0_s: at_s(change.tick),
            t1_s,
            name: change.to.name().into(),
            reason: change.reason.clone(),
        })
        .collect()
}

/// A picture of the run with its detections, in pixels of the picture.
fn contact_frame(detector: &DetectorInUse, frame: &KeptFrame) -> ContactFrame {
    let [dx, dy] = frame.offset_px.map(f64::from);
    let drawn = detector.drawn(&frame.detections).into_iter();
    let boxes = drawn.map(|detection| {
        let [x0, y0, x1, y1] = detection.box_px;
        ContactBox {
            label: detector.caption(detection),
            rect_px: [x0 - dx, y0 - dy, x1 - dx, y1 - dy],
            colour: [0, 158, 115],
        }
    });
    ContactFrame {
        camera: frame.camera.to_string(),
        time_s: frame.t_s,
        width: frame.size_px[0] as u16,
        height: frame.size_px[1] as u16,
        rgb8: frame.rgb8.to_vec(),
        boxes: boxes.collect(),
        reticle_px: [frame.centre_px[0] - dx, frame.centre_px[1] - dy],
        caption: frame.state.into(),
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
            format!("{}: {}", summary.outcome.name(), summary.reason),
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
    .chain(several(&summary.stations).iter().map(|station| {
        let value = format!(
            "{:.1} kJ, dwell {:.2} s",
            1e-3 * station.energy_j,
            station.dwell_s
        );
        (format!("station {}", station.name), value)
    }))
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

/// The stations where there are several: what one alone did is what the run did.
fn several(stations: &[StationSummary]) -> &[StationSummary] {
    match stations {
        [_] => &[],
        stations => stations,
    }
}

/// Most UAVs of which the terminal is told why they were not brought down.
const TOLD: usize = 12;

/// The summary for a terminal.
pub fn table(summary: &Summary) -> String {
    let rows = rows(summary);
    let mut lines: Vec<String> = (rows.iter())
        .map(|(label, value)| format!("{label:<24}{value}\n"))
        .collect();
    let unhurt = (summary.uavs.iter()).filter_map(|uav| Some((uav, uav.why.as_ref()?)));
    let (told, left): (Vec<_>, Vec<_>) = unhurt.enumerate().partition(|(i, _)| *i < TOLD);
    for (_, (uav, why)) in told {
        let missed = uav.acquired_s.map_or("not acquired: ", |_| "");
        lines.push(format!(
            "{:<24}{missed}{why}\n",
            format!("  why {}", uav.name)
        ));
    }
    if !left.is_empty() {
        lines.push(format!(
            "{:<24}in report.html\n",
            format!("  why {} more", left.len())
        ));
    }
    lines.concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summary_keys_are_stable() {
        let stats = MissStats {
            mean: 1.0,
            rms: 2.0,
            p50: 3.0,
            p95: 4.0,
            p99: 5.0,
            n: 6,
        };
        let summary = Summary {
            scenario: "urban".into(),
            version: "0.1.0".into(),
            seed: 7,
            outcome: Outcome::Neutralised,
            reason: "skin failed".into(),
            state_hash: "00000000deadbeef".into(),
            simulated_s: 12.5,
            stopped_s: None,
            real_time_factor: 101.0,
            time_to_acquire_s: None,
            time_to_neutralise_s: Some(9.0),
            miss_distance_px: MissDistances {
                coarse: None,
                precise: Some(stats),
            },
            dwell_s: 3.0,
            distractor_s: 0.0,
            keep_out_s: 0.0,
            wrong_object_s: 0.0,
            leakers: 0,
            energy_j: 9000.0,
            energy_per_neutralised_j: Some(9000.0),
            kill_to_shot_s: vec![1.5],
            light: Light {
                sun_elevation_deg: 30.0,
                illuminance_lx: 5e4,
            },
            uavs: vec![UavSummary {
                name: "one".into(),
                status: "down".into(),
                energy_j: 8500.0,
                dwell_s: 3.0,
                neutralised_s: Some(9.0),
                at_asset_s: None,
                acquired_s: Some(1.5),
                hottest_k: 573.0,
                fails_at_k: 573.0,
                hole_m2: 2e-4,
                lost: vec!["body".to_owned()],
                crash: Some(CrashSummary {
                    t_s: 9.5,
                    r_enu_m: [1.0, 2.0, 3.0],
                    into: "the ground".into(),
                }),
                why: None,
                stations: vec![DealingSummary {
                    name: "roof".into(),
                    clear_s: 8.0,
                    hidden_s: 1.0,
                    held_s: 7.5,
                    refused: vec![("no range".into(), 0.5)],
                }],
                cameras: vec![SightSummary {
                    name: "stv".into(),
                    tier: "search".into(),
                    in_view_s: 4.0,
                    hidden_s: 0.5,
                    pictures: 80,
                    found: 60,
                    largest_px: Some(5.0),
                    typical_px: Some(4.0),
                    contrast: Some(6.0),
                    grey_level: Some(140.0),
                    best_score: Some(0.75),
                    wanted_score: Some(0.25),
                }],
            }],
            stations: vec![StationSummary {
                name: "roof".into(),
                acquired_s: None,
                energy_j: 9000.0,
                dwell_s: 3.0,
                distractor_s: 0.0,
                keep_out_s: 0.0,
                wrong_object_s: 0.0,
                lost_s: vec![],
                kill_to_shot_s: vec![1.5],
            }],
            objects: vec![ObjectSummary {
                identity: "roof/3".into(),
                from_s: 1.0,
                to_s: 8.0,
                longest_gap_s: 0.125,
                stations: vec!["roof".into()],
                engaged_by: vec![(1.5, "roof".into())],
            }],
            share: Shares {
                render: 0.0,
                inference: 0.25,
                other: 0.75,
            },
        };
        assert_eq!(
            serde_json::to_string(&summary).unwrap(),
            concat!(
                r#"{"scenario":"urban","version":"0.1.0","seed":7,"outcome":"neutralised","#,
                r#""reason":"skin failed","state_hash":"00000000deadbeef","simulated_s":12.5,"#,
                r#""stopped_s":null,"real_time_factor":101.0,"time_to_acquire_s":null,"time_to_neutralise_s":9.0,"#,
                r#""miss_distance_px":{"coarse":null,"precise":{"mean":1.0,"rms":2.0,"p50":3.0,"#,
                r#""p95":4.0,"p99":5.0,"n":6}},"dwell_s":3.0,"distractor_s":0.0,"keep_out_s":0.0,"wrong_object_s":0.0,"leakers":0,"energy_j":9000.0,"#,
                r#""energy_per_neutralised_j":9000.0,"kill_to_shot_s":[1.5],"light":{"sun_elevation_deg":30.0,"illuminance_lx":50000.0},"uavs":[{"name":"one","status":"down","#,
                r#""energy_j":8500.0,"dwell_s":3.0,"neutralised_s":9.0,"at_asset_s":null,"#,
                r#""acquired_s":1.5,"hottest_k":573.0,"fails_at_k":573.0,"hole_m2":0.0002,"lost":["body"],"crash":{"t_s":9.5,"r_enu_m":[1.0,2.0,3.0],"into":"the ground"},"#,
                r#""why":null,"stations":[{"name":"roof","clear_s":8.0,"hidden_s":1.0,"held_s":7.5,"refused":[["no range",0.5]]}],"#,
                r#""cameras":[{"name":"stv","tier":"search","in_view_s":4.0,"hidden_s":0.5,"pictures":80,"found":60,"largest_px":5.0,"#,
                r#""typical_px":4.0,"contrast":6.0,"grey_level":140.0,"best_score":0.75,"wanted_score":0.25}]}],"#,
                r#""stations":[{"name":"roof","acquired_s":null,"energy_j":9000.0,"#,
                r#""dwell_s":3.0,"distractor_s":0.0,"keep_out_s":0.0,"wrong_object_s":0.0,"lost_s":[],"kill_to_shot_s":[1.5]}],"#,
                r#""objects":[{"identity":"roof/3","from_s":1.0,"to_s":8.0,"longest_gap_s":0.125,"#,
                r#""stations":["roof"],"engaged_by":[[1.5,"roof"]]}],"#,
                r#""share":{"render":0.0,"inference":0.25,"other":0.75}}"#
            )
        );
    }
}
