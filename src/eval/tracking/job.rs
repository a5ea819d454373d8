//! One run of an evaluation: a scenario with changes and a seed, watched tick by tick against the truth.

use crate::app::{self, Options, RunError};
use crate::components::beam::BeamState;
use crate::components::capture::{Frames, SensorCamera, Tier};
use crate::components::environment::Environment;
use crate::components::flight::{Flight, Uav};
use crate::components::mount::{CameraView, Mount, Optics, first_station};
use crate::components::record::{CameraHistory, KeptFrame};
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::eval::EvalError;
use crate::eval::shared::{FRESH_S, confirmed, in_parallel};
use crate::eval::statistics::{Hold, Lock, Sums, lock};
use crate::models::ground::city::City;
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::kinematics::{az_el_to_los, error_angles, los_to_az_el};
use crate::models::optics::tier::PerTier;
use crate::models::tracking::table::{Track, separation_rad};
use crate::report::chart::Series;
use crate::scenario::Scenario;
use bevy::prelude::*;
use glam::DVec2;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;

/// A run to be made.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Job {
    /// The scenario file.
    pub scenario: PathBuf,
    /// Changes, as `--set` takes them.
    pub set: Vec<String>,
    /// Seed of every random stream.
    pub seed: u64,
    /// Whether cameras render.
    pub capture: bool,
}

impl Job {
    /// A run without pictures of a scenario of the folder `scenarios`.
    pub fn blind(scenario: &str, set: &[&[&str]], seed: u64) -> Self {
        Self {
            scenario: PathBuf::from("scenarios").join(scenario),
            set: set.concat().iter().map(ToString::to_string).collect(),
            seed,
            capture: false,
        }
    }

    /// The command that makes this run.
    pub fn command(&self) -> String {
        let set = self.set.iter().map(|set| format!(" --set '{set}'"));
        format!(
            "boresight run {} --seed {}{}{}",
            self.scenario.display(),
            self.seed,
            if self.capture { "" } else { " --no-capture" },
            set.collect::<String>()
        )
    }
}

/// Time after the first precise lock from which the pointing counts as settled [s].
pub const SETTLE_S: f64 = 1.0;
/// A UAV further from the claimed line of sight than this is not what is held [rad].
const ON_RAD: f64 = 1e-3;
/// Centre and side of a square box [px].
pub type Square = [f64; 3];

/// A UAV in a snapshot, in the coarse camera's full-sensor pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Its index in the scenario.
    pub uav: usize,
    /// About its aim point.
    pub square: Square,
    /// Whether the line of sight to it is clear.
    pub clear: bool,
    /// Whether its aim point falls on the sensor.
    pub inside: bool,
}

/// Truth and tracks at an instant of the coarse camera's clock.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// The UAVs in front of the camera.
    pub uavs: Vec<Seen>,
    /// Confirmed tracks: identity and where they are believed.
    pub tracks: Vec<(u32, Square)>,
    /// The locked object.
    pub locked: Option<(u32, Square)>,
}

/// What one run showed.
#[derive(Default)]
pub struct Observed {
    /// Time of the first Coarse state [s].
    pub acquired_s: Option<f64>,
    /// Whether the first Coarse state was on a UAV.
    pub acquired_uav: bool,
    /// Time of the first Precise state [s].
    pub precise_s: Option<f64>,
    /// State at the end.
    pub state: &'static str,
    /// Miss distance of the coarse and precise camera [px], from the run's history.
    pub miss_px: [Series; 2],
    /// Error of the laser's axis from the first UAV's aim point [rad], every tick, settled, while
    /// a precise track is claimed.
    pub los_rad: Sums,
    /// The same of the beam's centre, which wander and jitter move [rad].
    pub beam_rad: Sums,
    /// Settled ticks, those with a precise track, those of them with the mirror at its stop.
    pub ticks: [u64; 3],
    /// Ticks per second [Hz].
    pub tick_hz: u32,
    /// Intervals in which the first UAV was hidden [s].
    pub hidden_s: Vec<[f64; 2]>,
    /// Identity of the target and time, at every change.
    pub targets: Vec<(f64, Option<u32>)>,
    /// Coarse, precise or engaged on the first UAV with a hit of the last quarter of a second, sampled at the
    /// coarse camera's rate: time [s], identity, whether precise.
    pub on_first: Vec<(f64, u32, bool)>,
    /// What is held, at the coarse camera's rate.
    pub holds: Vec<Hold>,
    /// What became of the first lock.
    pub lock: Lock,
    /// Snapshots from the first Coarse state on, at the coarse camera's rate.
    pub snapshots: Vec<Snapshot>,
    /// Last picture of each camera.
    pub pictures: Vec<KeptFrame>,
    /// Size [px] and rate [Hz] of the coarse camera.
    pub coarse: ([u32; 2], u32),
    /// Angle of a pixel of the precise camera [rad].
    pub precise_ifov_rad: f64,
    /// Distance of the first UAV at the end [m].
    pub range_m: f64,
}

impl Observed {
    /// The first miss distances of a camera after the first precise lock [px].
    pub fn after_lock(&self, tier: usize, frames: usize) -> Series {
        let from_s = self.precise_s.unwrap_or(f64::INFINITY);
        let series = self.miss_px[tier].iter();
        series
            .filter(|(t_s, _)| *t_s >= from_s)
            .take(frames)
            .copied()
            .collect()
    }

    /// The interval in which the first UAV was hidden, if there was just one.
    pub fn occlusion_s(&self) -> Option<[f64; 2]> {
        match self.hidden_s[..] {
            [only] => Some(only),
            _ => None,
        }
    }
}

/// Makes a run to its end.
pub fn observe(job: &Job, city: Option<Arc<City>>) -> Result<Observed, RunError> {
    let loaded = Scenario::load(&job.scenario, &job.set)?;
    let options = Options {
        seed: Some(job.seed),
        capture: job.capture,
        city,
        ..Options::default()
    };
    let mut app = app::build(&loaded, &options)?;
    let world = app.world_mut();
    let mut watch = Watch::new(world, &loaded.scenario);
    loop {
        let over = app::step(world)?;
        watch.tick(world);
        if over {
            break;
        }
    }
    Ok(watch.conclude(world))
}

type Station = (
    &'static Mount,
    &'static Optics,
    &'static BeamState,
    &'static Tracker,
);

struct Watch {
    seen: Observed,
    uavs: QueryState<(&'static Uav, &'static Flight)>,
    station: QueryState<Station>,
    cameras: PerTier<Option<(Entity, SensorCamera)>>,
    hidden: bool,
    /// Number of UAVs: what has a higher index is a bird or a balloon.
    count: usize,
}

impl Watch {
    fn new(world: &mut World, scenario: &Scenario) -> Self {
        let mut cameras: PerTier<Option<(Entity, SensorCamera)>> = PerTier::default();
        for (entity, camera) in world.query::<(Entity, &SensorCamera)>().iter(world) {
            cameras[camera.tier].get_or_insert((entity, camera.clone()));
        }
        Self {
            seen: Observed::default(),
            uavs: world.query(),
            station: world.query(),
            cameras,
            hidden: false,
            count: scenario.uavs.len(),
        }
    }

    /// Takes in what a tick left.
    fn tick(&mut self, world: &World) {
        let clock = world.resource::<SimClock>();
        let t_s = clock.t_s();
        let (Ok((mount, optics, beam, tracker)), Some((entity, coarse))) =
            (self.station.single(world), &self.cameras.coarse)
        else {
            return;
        };
        let Some(view) = world.get::<CameraView>(*entity) else {
            return;
        };
        let held = tracker.state.acquired();
        let precise = tracker.state.holds(Tier::Precise);
        let seen = &mut self.seen;
        if seen.targets.last().map_or(Some(None), |last| Some(last.1)) != Some(tracker.target) {
            seen.targets.push((t_s, tracker.target));
        }
        if precise && seen.precise_s.is_none() {
            seen.precise_s = Some(t_s);
        }
        let mut flights: Vec<(usize, &Flight)> = self
            .uavs
            .iter(world)
            .map(|(uav, flight)| (uav.index, flight))
            .collect();
        flights.sort_unstable_by_key(|(index, _)| *index);
        let now = Instant {
            world,
            clock,
            t_s,
            tracker,
            held,
            precise,
            mount,
            optics,
            beam,
            coarse,
            view,
            flights: &flights,
            count: self.count,
        };
        now.pointing(seen);
        if !clock.tick.is_multiple_of(coarse.period_ticks) {
            return;
        }
        self.hidden = now.occlusion(seen, self.hidden);
        now.hold(seen);
        if seen.acquired_s.is_some() {
            seen.snapshots.push(now.snapshot());
        }
    }

    fn conclude(mut self, world: &mut World) -> Observed {
        let clock = *world.resource::<SimClock>();
        self.seen.state =
            first_station::<Tracker>(world).map_or("", |tracker| tracker.state.name());
        let mut histories = world.query::<&mut CameraHistory>();
        for tier in Tier::ALL {
            if let Some((entity, _)) = &self.cameras[tier]
                && let Ok(mut history) = histories.get_mut(world, *entity)
            {
                let history = std::mem::take(&mut *history);
                self.seen.pictures.extend(history.latest);
                if tier != Tier::Search {
                    self.seen.miss_px[tier as usize - 1] = history.miss_px;
                }
            }
        }
        if let (Some((_, coarse)), Some((_, precise))) =
            (&self.cameras.coarse, &self.cameras.precise)
        {
            let pinhole = &coarse.pinhole;
            let rate_hz = u64::from(clock.tick_hz) / coarse.period_ticks.max(1);
            self.seen.coarse = ([pinhole.width_px, pinhole.height_px], rate_hz as u32);
            self.seen.precise_ifov_rad = precise.pinhole.ifov_rad();
        }
        self.seen.tick_hz = clock.tick_hz;
        self.seen.lock = lock(&self.seen.holds);
        self.seen
    }
}

/// A tick, and what is looked at in it.
struct Instant<'a> {
    world: &'a World,
    clock: &'a SimClock,
    /// Its time [s].
    t_s: f64,
    tracker: &'a Tracker,
    /// Whether a target is held, and whether precisely.
    held: bool,
    precise: bool,
    mount: &'a Mount,
    optics: &'a Optics,
    beam: &'a BeamState,
    coarse: &'a SensorCamera,
    view: &'a CameraView,
    /// All that fly, by index.
    flights: &'a [(usize, &'a Flight)],
    /// Number of UAVs among them, which come first.
    count: usize,
}

impl Instant<'_> {
    /// How far laser and beam are from the first UAV's aim point, once settled.
    fn pointing(&self, seen: &mut Observed) {
        let (Some((_, flight)), Some(precise_s)) = (self.flights.first(), seen.precise_s) else {
            return;
        };
        if self.t_s < precise_s + SETTLE_S {
            return;
        }
        let los_enu = flight.aim_enu_m() - self.optics.laser.r_enu_m;
        seen.range_m = los_enu.length();
        seen.ticks[0] += 1;
        if self.precise {
            seen.ticks[1] += 1;
            let error = error_angles(self.optics.laser.q_enu_cam, los_enu).length();
            seen.los_rad.push(error);
            if self.beam.aimed == Some(0) {
                seen.beam_rad.push(self.beam.offset_m / seen.range_m);
            }
            seen.ticks[2] += u64::from(self.mount.mirror.at_stop());
        }
    }

    /// Whether nothing stands between the station and a UAV.
    fn is_clear(&self, flight: &Flight) -> bool {
        let environment = self.world.resource::<Environment>();
        let sight = environment.line_of_sight(self.mount.r_enu_m, flight.aim_enu_m());
        sight == LineOfSight::Clear
    }

    /// Whether the first UAV is hidden; `before` says whether it was.
    fn occlusion(&self, seen: &mut Observed, before: bool) -> bool {
        let Some((_, flight)) = self.flights.first() else {
            return before;
        };
        let step_s = self.clock.at_s(self.coarse.period_ticks);
        let hidden = !self.is_clear(flight);
        match seen.hidden_s.last_mut() {
            Some(last) if hidden && before => last[1] = self.t_s + step_s,
            _ if hidden => seen.hidden_s.push([self.t_s, self.t_s + step_s]),
            _ => {}
        }
        hidden
    }

    /// The UAV on the claimed line of sight: the nearest of all that fly, if it is a UAV.
    fn on(&self, target: &Track) -> Option<usize> {
        let los = target.filter.predicted(self.t_s).az_el_rad();
        (self.flights.iter())
            .map(|(index, flight)| {
                let at = los_to_az_el(flight.aim_enu_m() - self.mount.r_enu_m);
                (separation_rad(los, at), *index)
            })
            .filter(|(separation, _)| *separation < ON_RAD)
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map(|(_, index)| index)
            .filter(|index| *index < self.count)
    }

    /// What is held.
    fn hold(&self, seen: &mut Observed) {
        let (t_s, held) = (self.t_s, self.held);
        let target = self.tracker.target_track();
        let on = target.and_then(|track| self.on(track));
        seen.holds.push(Hold { t_s, held, on });
        let fresh = target.is_some_and(|track| track.filter.coast_s(t_s) < FRESH_S);
        if let (true, true, Some(0), Some(id)) = (held, fresh, on, self.tracker.target) {
            seen.on_first.push((t_s, id, self.precise));
        }
        if held && seen.acquired_s.is_none() {
            seen.acquired_s = Some(t_s);
            seen.acquired_uav = on.is_some();
        }
    }

    /// Truth and tracks in the coarse camera.
    fn snapshot(&self) -> Snapshot {
        let pinhole = &self.coarse.pinhole;
        let pose = self.view.pose;
        let frames = self.world.resource::<Frames>();
        let exposed = frames.0.iter().find(|frame| frame.tier == Tier::Coarse);
        let uavs = self.flights.iter().filter(|(index, _)| *index < self.count);
        let uavs = uavs.filter_map(|(index, flight)| {
            let to_uav_m = flight.aim_enu_m() - pose.r_enu_m;
            let px = pinhole.project(pose.q_enu_cam.inverse() * to_uav_m)?;
            let side_px = exposed.and_then(|frame| {
                let [x0, y0, x1, y1] = frame.truth.iter().find(|s| s.uav == *index)?.box_px;
                Some((x1 - x0).max(y1 - y0))
            });
            Some(Seen {
                uav: *index,
                square: [px.x, px.y, side_px.unwrap_or(0.0)],
                clear: self.is_clear(flight),
                inside: pinhole.contains(px),
            })
        });
        let tracks = self.tracker.table.tracks.iter();
        let target = self.tracker.target_track();
        Snapshot {
            uavs: uavs.collect(),
            tracks: tracks
                .filter(|track| confirmed(track, self.t_s))
                .filter_map(|track| self.place(track))
                .filter(|(_, [x, y, _])| pinhole.contains(DVec2::new(*x, *y)))
                .collect(),
            locked: target
                .filter(|_| self.held)
                .and_then(|track| self.place(track)),
        }
    }

    /// Identity of a track, and where the station believes it in the coarse camera.
    fn place(&self, track: &Track) -> Option<(u32, Square)> {
        let pinhole = &self.coarse.pinhole;
        let los_enu = az_el_to_los(track.filter.predicted(self.t_s).az_el_rad());
        let px = pinhole.project(self.view.believed.q_enu_cam.inverse() * los_enu)?;
        Some((track.id, [px.x, px.y, track.size_rad / pinhole.ifov_rad()]))
    }
}

/// Makes all runs, those without pictures on all cores, and returns what they showed in the order
/// of the jobs; `reduce` keeps what is wanted of each.
pub fn all<T: Send>(
    label: &str,
    jobs: &[Job],
    city: &Arc<City>,
    reduce: impl Fn(&Job, Observed) -> Result<T, EvalError> + Sync,
) -> Result<Vec<T>, EvalError> {
    let rendered = jobs.iter().any(|job| job.capture);
    // Rendered runs share one graphics device and spread their work themselves.
    let threads = if rendered {
        1
    } else {
        std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
    };
    in_parallel(label, jobs, threads, |job| {
        reduce(job, observe(job, Some(city.clone()))?)
    })
}
