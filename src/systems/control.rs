//! Tracks become commands: mount rates, mirror deflection, readout windows.

use crate::components::camera::{Readout, SensorCamera, Tier};
use crate::components::clock::SimClock;
use crate::components::station::{Mount, MountCommand, Optics};
use crate::components::track::{Tracker, TrackingState};
use crate::models::kinematics::az_el_to_los;
use crate::models::pid::{PaperLaw, PaperPid, increment_to_axis_rates};
use crate::models::pointing::{PointingInput, TunedPointing};
use bevy::prelude::*;
use glam::DVec2;

/// The control law of a run.
#[derive(Resource, Clone, Debug)]
pub enum Controller {
    /// Eqs. 8 to 10 as printed, frame by frame.
    Paper(Box<PaperController>),
    /// Prediction, rate feed-forward, mirror on the residual.
    Tuned(TunedPointing),
}

/// Laws and memory of the paper's two loops.
#[derive(Clone, Debug)]
pub struct PaperController {
    /// Eq. 9.
    pub coarse_law: PaperLaw,
    /// Eq. 10.
    pub precise_law: PaperLaw,
    /// Memory of the coarse loop.
    pub coarse: PaperPid,
    /// Memory of the precise loop.
    pub precise: PaperPid,
    /// Exposures last used by each loop.
    pub used_tick: [Option<u64>; 2],
    /// Rates that perform the last coarse increment [rad/s].
    pub rates_radps: [f64; 2],
}

impl PaperController {
    /// Loops at rest.
    pub fn new(coarse_law: PaperLaw, precise_law: PaperLaw) -> Self {
        Self {
            coarse_law,
            precise_law,
            coarse: PaperPid::default(),
            precise: PaperPid::default(),
            used_tick: [None; 2],
            rates_radps: [0.0; 2],
        }
    }
}

/// The search scan: gazes and where it stands.
#[derive(Resource, Clone, Debug)]
pub struct SearchScan {
    /// Azimuth and elevation of every gaze [rad].
    pub gazes_rad: Vec<[f64; 2]>,
    /// The present gaze.
    pub index: usize,
    /// Since when the mount rests at it.
    pub settled_since: Option<u64>,
}

/// A gaze begins when the mount is this close to it [rad] and this slow [rad/s].
const SETTLED_RAD: f64 = 2e-3;
const SETTLED_RADPS: f64 = 5e-3;
/// How long a gaze lasts [s], and how long at most while something in it looks like a target.
const GAZE_S: f64 = 0.5;
const LONGEST_GAZE_S: f64 = 2.0;
/// Hits that make a track worth a longer gaze.
const PROMISING_HITS: u32 = 3;

/// Commands for the mount.
pub fn command_mount(
    clock: Res<SimClock>,
    tracker: Res<Tracker>,
    cameras: Query<&SensorCamera>,
    mut controller: ResMut<Controller>,
    mut scan: ResMut<SearchScan>,
    station: Single<(&Mount, &mut MountCommand)>,
) {
    let (mount, mut command) = station.into_inner();
    match tracker.state {
        TrackingState::Search => {
            let gaze = search(&clock, &tracker, &mut scan, mount);
            command.gimbal = mount.params.position_command(&mount.gimbal, gaze);
            command.mirror_rad = DVec2::ZERO;
        }
        _ => match &mut *controller {
            Controller::Tuned(law) => point(&clock, &tracker, law, mount, &mut command),
            Controller::Paper(paper) => {
                if tracker.state == TrackingState::Acquire {
                    // The paper is silent on acquisition: the mount turns to the candidate.
                    if let Some(track) = tracker.target_track() {
                        let los = track.filter.predicted(clock.t_s()).az_el_rad();
                        command.gimbal = mount.params.position_command(&mount.gimbal, los);
                        command.mirror_rad = DVec2::ZERO;
                    }
                } else {
                    steer_paper(&clock, &tracker, &cameras, paper, mount, &mut command);
                }
            }
        },
    }
}

/// The present gaze; moves on when it has lasted.
fn search(clock: &SimClock, tracker: &Tracker, scan: &mut SearchScan, mount: &Mount) -> DVec2 {
    let gaze: DVec2 = scan.gazes_rad[scan.index].into();
    let error = mount.params.error_rad(gaze, mount.measured_az_el_rad());
    let slow = mount.measured_rates_radps().length() < SETTLED_RADPS;
    if scan.settled_since.is_none() && error.length() < SETTLED_RAD && slow {
        scan.settled_since = Some(clock.tick);
    }
    if let Some(since) = scan.settled_since {
        let rested_s = clock.at_s(clock.tick - since);
        let promising = tracker.table.tracks.iter().any(|track| {
            let fresh = track.filter.coast_s(clock.t_s()) < 0.3;
            let (rate, sigmas) = track.motion(clock.t_s());
            fresh && track.total_hits() >= PROMISING_HITS && rate > 1e-3 && sigmas > 3.0
        });
        let longest_s = if promising { LONGEST_GAZE_S } else { GAZE_S };
        if rested_s > longest_s && scan.gazes_rad.len() > 1 {
            scan.index = (scan.index + 1) % scan.gazes_rad.len();
            scan.settled_since = None;
        }
    }
    gaze
}

/// The tuned law on the target's predicted line of sight; without a track the mount stands still.
fn point(
    clock: &SimClock,
    tracker: &Tracker,
    law: &TunedPointing,
    mount: &Mount,
    command: &mut MountCommand,
) {
    let Some(track) = tracker.target_track() else {
        *command = MountCommand::default();
        return;
    };
    let output = law.command(
        &mount.params,
        &PointingInput {
            los: track.filter.predicted(clock.t_s() + law.lead_s),
            gimbal_az_el_rad: mount.measured_az_el_rad(),
            gimbal_rates_radps: mount.measured_rates_radps(),
            base_tilt_rad: mount.gyro.tilt_enu_rad,
            base_rate_radps: mount.gyro.rate_enu_radps,
        },
    );
    // Far off target (a slew), the proportional law would overrun: brake as a position servo.
    let error = mount.params.error_rad(
        track.filter.predicted(clock.t_s()).az_el_rad(),
        mount.measured_az_el_rad(),
    );
    const SLEW_RAD: f64 = 0.02;
    let target = track.filter.predicted(clock.t_s() + law.lead_s);
    let rates_radps = DVec2::new(target.az_rate_radps, target.el_rate_radps);
    let keyhole = mount
        .params
        .keyhole_azimuth(target.az_el_rad(), rates_radps);
    if error.length() > SLEW_RAD || keyhole.is_some() {
        command.gimbal =
            mount
                .params
                .catch_up_command(&mount.gimbal, target.az_el_rad(), rates_radps);
        command.mirror_rad = DVec2::ZERO;
    } else {
        command.gimbal = output.gimbal;
        command.mirror_rad = output.mirror_rad;
    }
}

/// Eqs. 9 and 10: each new frame of a camera turns its attitude by the law's increment.
fn steer_paper(
    clock: &SimClock,
    tracker: &Tracker,
    cameras: &Query<&SensorCamera>,
    paper: &mut PaperController,
    mount: &Mount,
    command: &mut MountCommand,
) {
    for tier in [Tier::Coarse, Tier::Precise] {
        let slot = tier as usize - Tier::Coarse as usize;
        let Some(error) = tracker.error[tier as usize] else {
            continue;
        };
        let Some(camera) = cameras.iter().find(|camera| camera.tier == tier) else {
            continue;
        };
        if paper.used_tick[slot] == Some(error.exposure_tick) {
            continue;
        }
        paper.used_tick[slot] = Some(error.exposure_tick);
        let frame_s = clock.at_s(camera.period_ticks);
        if tier == Tier::Coarse {
            let u = paper
                .coarse
                .step(&paper.coarse_law, error.angle_rad, frame_s);
            let elevation_rad = mount.measured_az_el_rad().y;
            paper.rates_radps = increment_to_axis_rates(u, 1.0 / frame_s, elevation_rad);
        } else {
            let u = paper
                .precise
                .step(&paper.precise_law, error.angle_rad, frame_s);
            // Eq. 10's update is a rate times the frame time; the image's down is the mirror's -y.
            let limit = DVec2::splat(mount.mirror_params.stroke_rad);
            let step = DVec2::new(u.x, -u.y) * frame_s;
            command.mirror_rad = (command.mirror_rad + step).clamp(-limit, limit);
        }
    }
    command.gimbal.rate_radps = paper.rates_radps;
}

/// Time after which the search camera joins in looking for a lost target [s].
const REFIND_S: f64 = 0.5;
/// Of so many exposures one is read in full while a target is held: 10 Hz at the usual rates.
const WATCH_SEARCH: u64 = 3;
const WATCH_COARSE: u64 = 6;

/// Whether a camera holds a target in `state`.
fn held(state: TrackingState) -> bool {
    matches!(
        state,
        TrackingState::Coarse | TrackingState::Precise | TrackingState::Engage
    )
}

/// What each camera reads out next.
pub fn choose_readouts(
    clock: Res<SimClock>,
    tracker: Res<Tracker>,
    station: Single<(&Mount, &Optics)>,
    mut cameras: Query<(&SensorCamera, &mut Readout)>,
) {
    let (mount, optics) = *station;
    for (camera, mut readout) in &mut cameras {
        // The exposure that comes next.
        let frame = clock.tick / camera.period_ticks + 1;
        let track = tracker.target_track();
        let wanted = match (tracker.state, camera.tier) {
            (TrackingState::Search, Tier::Search) => Readout::Full,
            (TrackingState::Search, _) | (TrackingState::Acquire, Tier::Precise) => Readout::Off,
            // It helps where the coarse camera has not found the target again at once.
            (TrackingState::Lost, Tier::Search)
                if clock.at_s(clock.tick - tracker.since_tick) > REFIND_S =>
            {
                Readout::Full
            }
            // While a target is held, the wider cameras keep watch for others.
            (_, Tier::Search) if frame.is_multiple_of(WATCH_SEARCH) => Readout::Full,
            (_, Tier::Search) => Readout::Off,
            (state, Tier::Coarse) if held(state) && frame.is_multiple_of(WATCH_COARSE) => {
                Readout::Full
            }
            (state, tier)
                if camera.window_px.is_some()
                    && (tier == Tier::Coarse && held(state)
                        || matches!(state, TrackingState::Precise | TrackingState::Engage)) =>
            {
                let px = track.and_then(|track| {
                    let pose = optics.pointing.believed_pose(mount.r_enu_m, camera.tier);
                    let los = track.filter.predicted(clock.t_s()).az_el_rad();
                    camera
                        .pinhole
                        .project(pose.q_enu_cam.inverse() * az_el_to_los(los))
                });
                px.map_or(Readout::Full, |px| Readout::Around(px.to_array()))
            }
            _ => Readout::Full,
        };
        readout.set_if_neq(wanted);
    }
}
