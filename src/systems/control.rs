//! Tracks become commands: mount rates, mirror deflection, readout windows.

pub mod radar;
mod search;

use crate::components::capture::{
    AutoExposure, CameraOf, Readout, SensorCamera, StationCameras, Tier,
};
use crate::components::control::{
    Controller, PaperController, PointingController, PointingLaws, Radar, SearchScan,
};
use crate::components::detect::DetectorInUse;
use crate::components::mount::{
    CameraView, Gimbal, Mount, MountCommand, OpticalPath, PanTilt, Station,
};
use crate::components::network::Tasking;
use crate::components::operator::{Command, Operator};
use crate::components::run::{Failure, SimClock};
use crate::components::track::{Tracker, TrackingState};
use crate::models::control::law::PointingInput;
use crate::models::control::paper::{coarse_axis_rates, precise_mirror};
use crate::models::control::tuning::MountPlant;
use crate::models::decision::situation::CONFIRM_HITS;
use crate::models::maths::kinematics::{Pose, az_el_to_los};
use crate::models::mount::gimbal::GimbalCommand;
use crate::models::tracking::search::Gaze;
use crate::parameters::control::with_gains;
use crate::scenario::{DriveOrder, GainsOrder, suggestion};
use crate::systems::control::search::{every_in_pass, search};
use bevy::ecs::query::QueryData;
use bevy::prelude::*;
use glam::DVec2;

/// A station as its mount is commanded.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Commanded {
    station: &'static Station,
    mount: &'static Mount,
    tracker: &'static Tracker,
    operator: &'static Operator,
    radar: &'static Radar,
    tasking: &'static Tasking,
    cameras: &'static StationCameras,
    scan: &'static mut SearchScan,
    controller: &'static mut Controller,
    command: &'static mut MountCommand,
}

/// Commands for the mounts.
pub fn command_mount(
    clock: Res<SimClock>,
    cameras: Query<&SensorCamera>,
    mut stations: Query<Commanded>,
    mut failure: ResMut<Failure>,
) {
    for commanded in &mut stations {
        let CommandedItem {
            station,
            mount,
            tracker,
            operator,
            radar,
            tasking,
            cameras: own,
            mut scan,
            mut controller,
            mut command,
        } = commanded;
        let gaze = (tracker.state == TrackingState::Search).then(|| {
            let tasked = tasking.cue(mount.r_enu_m, clock.t_s());
            let cue = tasked.or_else(|| radar.cue(clock.t_s()));
            scan.slew(operator.slew_rad, cue, clock.t_s());
            let cue = cue.filter(|_| scan.slew_rad.is_none());
            search(&clock, tracker, cue, &mut scan, &mount.gimbal)
        });
        if gaze.is_none() {
            // An interrupted gaze restarts.
            scan.settled_since = None;
            scan.glance = None;
        }
        match &mut *controller {
            Controller::Pointing(pointing) => {
                let fault = point(&clock, tracker, gaze, pointing, mount, &mut command);
                if let Some(fault) = fault {
                    failure.set(LawFault {
                        station: station.name.clone(),
                        law: pointing.name.clone(),
                        fault,
                        t_s: clock.t_s(),
                    });
                }
            }
            Controller::Paper(paper) => {
                // The paper is silent on acquisition: the mount turns to the candidate.
                let acquired = tracker
                    .target_track()
                    .filter(|_| tracker.state == TrackingState::Acquire)
                    .map(|track| Gaze::still(track.filter.predicted(clock.t_s()).az_el_rad()));
                if let Some(to) = gaze.or(acquired) {
                    command.gimbal = turn_to(&mount.gimbal, &to);
                    command.mirror_rad = DVec2::ZERO;
                } else if tracker.state != TrackingState::Acquire {
                    let periods_s = |tier: Tier| {
                        cameras
                            .iter_many(own.entities())
                            .find(|camera| camera.tier == tier)
                            .map(|camera| clock.at_s(camera.period_ticks))
                    };
                    steer_paper(tracker, periods_s, paper, mount, &mut command);
                }
            }
        }
        driven(&operator.drive, &mut command);
    }
}

/// What drives gimbal and mirror from outside takes the place of the law's commands, which goes on unheard.
fn driven(drive: &DriveOrder, command: &mut MountCommand) {
    if let Some(rates_degps) = drive.rates_degps {
        command.gimbal.rate_radps = rates_degps.map(f64::to_radians);
    }
    if let Some(mirror_urad) = drive.mirror_urad {
        command.mirror_rad = DVec2::from(mirror_urad) * 1e-6;
    }
}

/// Puts laws and gains in force that operators have ordered in this tick, and refuses those that cannot be had: a
/// scenario's are tried at the set-up.
pub fn change_laws(
    clock: Res<SimClock>,
    laws: Res<PointingLaws>,
    mut stations: Query<(&Mount, &mut Operator, &mut Controller)>,
) {
    for (mount, mut operator, mut controller) in &mut stations {
        let refused: Vec<(Command, String)> = (operator.due.iter())
            .filter_map(|command| {
                let obeyed = controller.obey(command, &laws, &mount.plant(clock.dt_s()));
                obeyed.err().map(|(_, why)| (command.clone(), why))
            })
            .collect();
        for (command, why) in refused {
            operator.refuse(&command, why);
        }
    }
}

impl Controller {
    /// Takes an ordered law or gains; what is wrong with the order, and at which key, if it cannot be obeyed.
    pub fn obey(
        &mut self,
        command: &Command,
        laws: &PointingLaws,
        plant: &MountPlant,
    ) -> Result<(), (&'static str, String)> {
        match (command, self) {
            (Command::Law(name), Self::Pointing(pointing)) => {
                // The hand-over stays: commands go on from where they are.
                pointing.law = laws
                    .make(name, plant)
                    .ok_or_else(|| {
                        let hint = suggestion(name, &laws.names().collect::<Vec<_>>());
                        ("law", format!("no law '{name}'{hint}"))
                    })?
                    .map_err(|error| ("law", error.to_string()))?;
                pointing.name = name.clone();
            }
            (Command::Law(_), Self::Paper(_)) => {
                let cure = "the paper's loops give way to no law during a run - start with another controller.preset";
                return Err(("law", cure.into()));
            }
            (Command::Gains(gains), Self::Pointing(pointing)) => {
                match (gains, pointing.law.gimbal_gain_per_s()) {
                    (
                        GainsOrder {
                            coarse: None,
                            precise: None,
                            gimbal_per_s: Some(ordered),
                        },
                        Some(gain),
                    ) => *gain = *ordered,
                    _ => {
                        let what = format!(
                            "the law '{}' cannot take these - the law 'tuned' takes gimbal_per_s, the \
                             paper's loops take coarse and precise",
                            pointing.name
                        );
                        return Err(("gains", what));
                    }
                }
            }
            (Command::Gains(gains), Self::Paper(paper)) => {
                if gains.gimbal_per_s.is_some() {
                    let what = "the paper's loops take coarse and precise";
                    return Err(("gains.gimbal_per_s", what.into()));
                }
                paper.coarse_law = with_gains(paper.coarse_law, gains.coarse);
                paper.precise_law = with_gains(paper.precise_law, gains.precise);
            }
            _ => {}
        }
        Ok(())
    }
}

/// The command that turns a gimbal to a gaze and moves along with it.
fn turn_to(gimbal: &Gimbal, gaze: &Gaze) -> GimbalCommand {
    let slews = (gimbal.params).position_command(&gimbal.state, gaze.az_el_rad);
    let rates_radps = DVec2::from(slews.rate_radps) + gaze.rates_radps;
    GimbalCommand {
        rate_radps: rates_radps.to_array(),
    }
}

/// Commands for the cameras' own pan-tilts: while the station searches they look where its radar has the
/// target, and otherwise through the sector.
pub fn command_pan_tilts(
    clock: Res<SimClock>,
    stations: Query<(&Tracker, &Radar, &Operator)>,
    mut pan_tilts: Query<(&mut PanTilt, &mut SearchScan)>,
) {
    for (mut pan_tilt, mut scan) in &mut pan_tilts {
        let Ok((tracker, radar, operator)) = stations.get(pan_tilt.station) else {
            continue;
        };
        let searches = tracker.state == TrackingState::Search;
        let slew_rad = operator.slew_rad.filter(|_| searches);
        let cue = radar.cue(clock.t_s()).filter(|_| searches);
        scan.slew(slew_rad, cue, clock.t_s());
        let cue = cue.filter(|_| slew_rad.is_none());
        let gaze = search(&clock, tracker, cue, &mut scan, &pan_tilt.gimbal);
        pan_tilt.command = turn_to(&pan_tilt.gimbal, &gaze);
    }
}

/// Why a law's command is not obeyed.
#[derive(Debug, thiserror::Error)]
#[error("station '{station}': the law '{law}' failed at {t_s:.3} s: {fault}")]
pub struct LawFault {
    station: String,
    law: String,
    fault: String,
    t_s: f64,
}

/// The law on the target's predicted line of sight; otherwise the mount turns to a gaze, or stops. Says what is
/// wrong with the command, if it is not obeyed.
fn point(
    clock: &SimClock,
    tracker: &Tracker,
    gaze: Option<Gaze>,
    pointing: &mut PointingController,
    mount: &Mount,
    command: &mut MountCommand,
) -> Option<String> {
    let PointingController { law, hand_over, .. } = pointing;
    let gimbal_az_el_rad = mount.measured_az_el_rad();
    let aim = tracker.aim_los(clock.t_s() + law.lead_s());
    let output = if let Some(los) = aim.filter(|_| gaze.is_none()) {
        let input = PointingInput {
            base_tilt_rad: mount.gyro.tilt_enu_rad,
            base_rate_radps: mount.gyro.rate_enu_radps,
            ..PointingInput::sensed(los, &mount.gimbal.state, &mount.mirror)
        };
        law.command(hand_over, &mount.gimbal.params, &input)
    } else {
        law.rest();
        let params = &mount.gimbal.params;
        hand_over.slew(params, &command.gimbal, gimbal_az_el_rad, gaze)
    };
    let rates_radps = DVec2::from(output.gimbal.rate_radps);
    let fault = law.fault();
    if fault.is_some() {
        return fault;
    }
    if !rates_radps.is_finite() || !output.mirror_rad.is_finite() {
        let mirror_rad = output.mirror_rad;
        return Some(format!(
            "it commands rates {rates_radps} rad/s, mirror {mirror_rad} rad; a law must return finite numbers"
        ));
    }
    command.gimbal = output.gimbal;
    command.mirror_rad = output.mirror_rad;
    None
}

/// Eqs. 9 and 10: each new frame of a camera turns its attitude by the law's increment.
fn steer_paper(
    tracker: &Tracker,
    frame_s: impl Fn(Tier) -> Option<f64>,
    paper: &mut PaperController,
    mount: &Mount,
    command: &mut MountCommand,
) {
    // Integrators of one target do not fit another.
    if paper.target != tracker.target {
        *paper = PaperController::new(paper.coarse_law, paper.precise_law);
        paper.target = tracker.target;
    }
    for tier in [Tier::Coarse, Tier::Precise] {
        let slot = tier as usize - Tier::Coarse as usize;
        let Some(error) = tracker.error[tier] else {
            continue;
        };
        let Some(frame_s) = frame_s(tier) else {
            continue;
        };
        if paper.used_tick[slot] == Some(error.exposure_tick) {
            continue;
        }
        paper.used_tick[slot] = Some(error.exposure_tick);
        if tier == Tier::Coarse {
            let u = paper
                .coarse
                .step(&paper.coarse_law, error.angle_rad, frame_s);
            paper.rates_radps =
                coarse_axis_rates(mount.measured_az_el_rad(), u, 1.0 / frame_s).to_array();
        } else {
            let u = paper
                .precise
                .step(&paper.precise_law, error.angle_rad, frame_s);
            let limit = DVec2::splat(mount.mirror_params.stroke_rad);
            command.mirror_rad =
                precise_mirror(mount.measured_az_el_rad(), command.mirror_rad, u, frame_s)
                    .clamp(-limit, limit);
        }
    }
    command.gimbal.rate_radps = paper.rates_radps;
}

/// Time after which the search camera joins in looking for a lost target [s].
const REFIND_S: f64 = 0.5;
/// One exposure in this many is read in full while a target is held: 10 Hz at the usual rates.
const WATCH_SEARCH: u64 = 3;
const WATCH_COARSE: u64 = 6;

/// What each camera reads out next.
pub fn choose_readouts(
    clock: Res<SimClock>,
    detector: Res<DetectorInUse>,
    stations: Query<(&Tracker, &SearchScan)>,
    mut cameras: Query<(
        &CameraOf,
        &SensorCamera,
        &OpticalPath,
        &CameraView,
        &AutoExposure,
        &mut Readout,
    )>,
) {
    for (of, camera, path, view, auto, mut readout) in &mut cameras {
        let Ok((tracker, scan)) = stations.get(of.0) else {
            continue;
        };
        let found_precisely = tracker
            .target_track()
            .is_some_and(|track| track.hits[Tier::Precise] >= CONFIRM_HITS);
        // The exposure that comes next.
        let frame = clock.tick / camera.period_ticks + 1;
        let frame_s = clock.at_s(camera.period_ticks);
        let for_light = auto.now.map_or(1, |(product_s, _)| {
            camera.control.read_every(product_s, frame_s)
        });
        let wanted = match (tracker.state, camera.tier) {
            // What the mount does not turn searches by itself.
            _ if !path.is_on_gimbal() => Readout::Full,
            (TrackingState::Search, tier) => {
                let every = match tier {
                    _ if scan.looks_with(tier) => every_in_pass(tier, frame_s),
                    Tier::Search => WATCH_SEARCH,
                    // In the middle of the gaze it shows what is too small for the search camera.
                    Tier::Coarse => WATCH_COARSE,
                    Tier::Precise => 0,
                };
                if every > 0 && frame.is_multiple_of(every) {
                    Readout::Full
                } else {
                    Readout::Off
                }
            }
            // It helps with a candidate that it has found.
            (TrackingState::Acquire, Tier::Precise) if !found_precisely => Readout::Off,
            // It helps where the coarse camera has not found the target again at once.
            (TrackingState::Lost, Tier::Search)
                if clock.at_s(clock.tick - tracker.since_tick) > REFIND_S =>
            {
                Readout::Full
            }
            // While a target is held, the wider cameras keep watch for others.
            (_, Tier::Search) if frame.is_multiple_of(WATCH_SEARCH) => Readout::Full,
            (_, Tier::Search) => Readout::Off,
            // Fewer frames, exposed for longer, show a target in little light that more do not.
            _ if !frame.is_multiple_of(for_light) => Readout::Off,
            (state, tier) => {
                let around = around_target(tracker, camera, &view.believed, clock.t_s())
                    .filter(|_| camera.window_px.or(detector.reading.roi_px).is_some());
                let settled = state.holds(tier) || state.holds(Tier::Precise);
                let watches = tier == Tier::Coarse
                    && state.holds(Tier::Coarse)
                    && frame.is_multiple_of(WATCH_COARSE);
                match around {
                    // What is too large for the network is shown to it shrunk, always.
                    Some(large) if detector.shrinks(&large) > 1 => large,
                    Some(around) if settled && !watches => around,
                    _ => Readout::Full,
                }
            }
        };
        readout.set_if_neq(wanted);
    }
}

/// A readout around the predicted target, where a camera at `pose` sees it.
fn around_target(
    tracker: &Tracker,
    camera: &SensorCamera,
    pose: &Pose,
    t_s: f64,
) -> Option<Readout> {
    let track = tracker.target_track()?;
    let los = track.filter.predicted(t_s).az_el_rad();
    let ray_cam = pose.q_enu_cam.inverse() * az_el_to_los(los);
    Some(Readout::Around {
        centre_px: camera.pinhole.project(ray_cam)?.to_array(),
        target_px: track.size_rad / camera.pinhole.ifov_rad(),
    })
}
