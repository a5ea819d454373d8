//! One run of an evaluation: a scenario with changes and a seed, watched tick by tick against the truth.

use crate::components::record::KeptFrame;
use crate::eval::EvalError;
use crate::eval::shared::{FRESH_S, confirmed, in_parallel};
use crate::eval::statistics::{Hold, Lock, Sums, lock};
use crate::experiment::runner::Runner;
use crate::models::decision::tracker::Tracker;
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::kinematics::{az_el_to_los, error_angles};
use crate::models::optics::tier::{PerTier, Tier};
use crate::models::tracking::held::on_sight;
use crate::models::tracking::table::Track;
use crate::report::chart::Series;
use crate::scenario::Scenario;
use crate::simulation::{CameraView, Simulation, StationView, UavView, View};
use glam::DVec2;
use serde::Serialize;
use std::path::PathBuf;

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
pub fn observe(job: &Job, runner: &Runner) -> Result<Observed, EvalError> {
    let loaded = Scenario::load(&job.scenario, &job.set)?;
    let seen = runner.make(&loaded, job.seed, job.capture, |mut run| {
        let mut watch = Watch::new();
        run.watch(|run| {
            watch.tick(run);
            false
        })?;
        Ok(watch.conclude(&run))
    })?;
    Ok(seen)
}

/// The first station's cameras, by their tiers.
type OfTier<'a> = PerTier<Option<CameraView<'a>>>;

fn of_tier(station: StationView<'_>) -> OfTier<'_> {
    let mut cameras = PerTier::default();
    for tier in Tier::ALL {
        cameras[tier] = station.camera(tier);
    }
    cameras
}

struct Watch {
    seen: Observed,
    hidden: bool,
}

impl Watch {
    fn new() -> Self {
        Self {
            seen: Observed::default(),
            hidden: false,
        }
    }

    /// Takes in what a tick left.
    fn tick(&mut self, run: &Simulation) {
        let view = run.view();
        let Some(station) = view.stations().next() else {
            return;
        };
        let Some(coarse) = station.camera(Tier::Coarse) else {
            return;
        };
        let (t_s, tracker) = (view.t_s(), station.tracker());
        let held = tracker.state.acquired();
        let precise = tracker.state.holds(Tier::Precise);
        let seen = &mut self.seen;
        if seen.targets.last().map_or(Some(None), |last| Some(last.1)) != Some(tracker.target) {
            seen.targets.push((t_s, tracker.target));
        }
        if precise && seen.precise_s.is_none() {
            seen.precise_s = Some(t_s);
        }
        let now = Instant {
            run,
            view,
            t_s,
            tracker,
            held,
            precise,
            station,
            coarse,
            flying: view.uavs().collect(),
        };
        now.pointing(seen);
        if !coarse.exposes_at(view.tick()) {
            return;
        }
        self.hidden = now.occlusion(seen, self.hidden);
        now.hold(seen);
        if seen.acquired_s.is_some() {
            seen.snapshots.push(now.snapshot());
        }
    }

    fn conclude(mut self, run: &Simulation) -> Observed {
        let view = run.view();
        let Some(station) = view.stations().next() else {
            return self.seen;
        };
        let seen = &mut self.seen;
        seen.state = station.state().name();
        let cameras = of_tier(station);
        for tier in Tier::ALL {
            if let Some(camera) = &cameras[tier] {
                let history = camera.history();
                seen.pictures.extend(history.latest.clone());
                if tier != Tier::Search {
                    seen.miss_px[tier as usize - 1].clone_from(&history.miss_px);
                }
            }
        }
        if let (Some(coarse), Some(precise)) = (&cameras.coarse, &cameras.precise) {
            let pinhole = coarse.pinhole();
            let rate_hz = (1.0 / coarse.period_s()).floor();
            seen.coarse = ([pinhole.width_px, pinhole.height_px], rate_hz as u32);
            seen.precise_ifov_rad = precise.pinhole().ifov_rad();
        }
        seen.tick_hz = view.tick_hz();
        seen.lock = lock(&seen.holds);
        self.seen
    }
}

/// A tick, and what is looked at in it.
struct Instant<'a> {
    run: &'a Simulation,
    view: View<'a>,
    /// Its time [s].
    t_s: f64,
    tracker: &'a Tracker,
    /// Whether a target is held, and whether precisely.
    held: bool,
    precise: bool,
    station: StationView<'a>,
    coarse: CameraView<'a>,
    /// All that fly, by index.
    flying: Vec<UavView<'a>>,
}

impl Instant<'_> {
    /// How far laser and beam are from the first UAV's aim point, once settled.
    fn pointing(&self, seen: &mut Observed) {
        let (Some(uav), Some(precise_s)) = (self.flying.first(), seen.precise_s) else {
            return;
        };
        if self.t_s < precise_s + SETTLE_S {
            return;
        }
        let laser = self.station.mount().laser;
        let los_enu = uav.aim_enu_m() - laser.r_enu_m;
        seen.range_m = los_enu.length();
        seen.ticks[0] += 1;
        if self.precise {
            seen.ticks[1] += 1;
            let error = error_angles(laser.q_enu_cam, los_enu).length();
            seen.los_rad.push(error);
            let beam = self.station.beam();
            if beam.aimed == Some(0) {
                seen.beam_rad.push(beam.offset_m / seen.range_m);
            }
            seen.ticks[2] += u64::from(self.station.mount().mirror_at_stop);
        }
    }

    /// Whether nothing stands between the station and a UAV.
    fn is_clear(&self, uav: &UavView) -> bool {
        let from_enu_m = self.station.mount().r_enu_m;
        let sight = (self.view.air()).line_of_sight(from_enu_m, uav.aim_enu_m());
        sight == LineOfSight::Clear
    }

    /// Whether the first UAV is hidden; `before` says whether it was.
    fn occlusion(&self, seen: &mut Observed, before: bool) -> bool {
        let Some(uav) = self.flying.first() else {
            return before;
        };
        let step_s = self.coarse.period_s();
        let hidden = !self.is_clear(uav);
        match seen.hidden_s.last_mut() {
            Some(last) if hidden && before => last[1] = self.t_s + step_s,
            _ if hidden => seen.hidden_s.push([self.t_s, self.t_s + step_s]),
            _ => {}
        }
        hidden
    }

    /// The UAV on the claimed line of sight: the nearest of all that fly, if it is a UAV.
    fn on(&self, target: &Track) -> Option<usize> {
        let sight = az_el_to_los(target.filter.predicted(self.t_s).az_el_rad());
        let r_station_enu_m = self.station.mount().r_enu_m;
        let things = (self.flying.iter())
            .map(|uav| (uav, uav.aim_enu_m() - r_station_enu_m, uav.radius_m()));
        on_sight(things, sight)
            .filter(|uav| uav.distractor().is_none())
            .map(|uav| uav.index())
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
        let pinhole = self.coarse.pinhole();
        let pose = self.coarse.pose();
        let exposed = self.run.frames().find(|frame| frame.tier() == Tier::Coarse);
        let uavs = (self.flying.iter()).filter(|uav| uav.distractor().is_none());
        let uavs = uavs.filter_map(|uav| {
            let to_uav_m = uav.aim_enu_m() - pose.r_enu_m;
            let px = pinhole.project(pose.q_enu_cam.inverse() * to_uav_m)?;
            let side_px = exposed.and_then(|frame| {
                let mut truth = frame.truth().iter();
                let [x0, y0, x1, y1] = truth.find(|s| s.uav == uav.index())?.box_px;
                Some((x1 - x0).max(y1 - y0))
            });
            Some(Seen {
                uav: uav.index(),
                square: [px.x, px.y, side_px.unwrap_or(0.0)],
                clear: self.is_clear(uav),
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
        let pinhole = self.coarse.pinhole();
        let los_enu = az_el_to_los(track.filter.predicted(self.t_s).az_el_rad());
        let px = pinhole.project(self.coarse.believed().q_enu_cam.inverse() * los_enu)?;
        Some((track.id, [px.x, px.y, track.size_rad / pinhole.ifov_rad()]))
    }
}

/// Makes all runs, those without pictures on all cores, and returns what they showed in the order
/// of the jobs; `reduce` keeps what is wanted of each.
pub fn all<T: Send>(
    label: &str,
    jobs: &[Job],
    runner: &Runner,
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
        reduce(job, observe(job, runner)?)
    })
}
