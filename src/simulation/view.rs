//! What can be read of a run between two ticks. Nothing here can change it.

use crate::components::beam::{BeamPath, BeamState, Dose, FireCommand, LaserSource};
use crate::components::capture::{
    AutoExposure, Conditions, ExposedFrame, PixelRect, Readout, SensorCamera, StationCameras,
    UavInFrame,
};
use crate::components::control::{Controller, Radar};
use crate::components::detect::{DetectionQueue, Question};
use crate::components::engage::Interlocks;
use crate::components::environment::Environment;
use crate::components::flight::{
    Air, Distractor, Flight, Guidance, HeatedSkin, Uav, UavShape, UavStatus,
};
use crate::components::mount::{CameraView as Look, Mount, MountCommand, Optics, Station};
use crate::components::operator::{Answer, Operator, Order};
use crate::components::record::{CameraHistory, Fate, Fates, History, StateHash};
use crate::components::run::{Cast, RunEnd, SimClock};
use crate::components::track;
use crate::models::decision::tracker::{Tracker, TrackingState};
use crate::models::flight::distractor::DistractorKind;
use crate::models::ground::city::City;
use crate::models::ground::dsm::LineOfSight;
use crate::models::laser::target::Patch;
use crate::models::maths::geodesy::SiteFrame;
use crate::models::maths::kinematics::Pose;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::detection::Detection;
use crate::models::optics::tier::Tier;
use crate::models::tracking::table::Track;
use bevy::prelude::World;
use glam::{DQuat, DVec2, DVec3};
use std::sync::Arc;

/// A run as its last tick left it.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub(super) world: &'a World,
}

impl<'a> View<'a> {
    fn cast(&self) -> &'a Cast {
        self.world.resource::<Cast>()
    }

    fn clock(&self) -> SimClock {
        *self.world.resource::<SimClock>()
    }

    /// Ticks since the start.
    pub fn tick(&self) -> u64 {
        self.clock().tick
    }

    /// Ticks a second [Hz].
    pub fn tick_hz(&self) -> u32 {
        self.clock().tick_hz
    }

    /// Simulated time [s].
    pub fn t_s(&self) -> f64 {
        self.clock().t_s()
    }

    /// The tick after which the run ends at the latest.
    pub fn last_tick(&self) -> u64 {
        self.world.resource::<RunEnd>().last_tick
    }

    /// Hash of the whole state; each tick's covers the one before.
    pub fn state_hash(&self) -> u64 {
        self.world.resource::<StateHash>().0
    }

    /// The stations, in the order of the scenario.
    pub fn stations(&self) -> impl Iterator<Item = StationView<'a>> + use<'a> {
        let world = self.world;
        let entities = &self.cast().stations;
        entities.iter().filter_map(move |entity| {
            let parts = world.get_entity(*entity).ok()?;
            let (station, mount, optics, command, tracker, operator, beam, fire) = parts
                .get_components::<(
                    &Station,
                    &Mount,
                    &Optics,
                    &MountCommand,
                    &track::Tracker,
                    &Operator,
                    &BeamState,
                    &FireCommand,
                )>()
                .ok()?;
            let (source, interlocks, queue, history, radar, controller, cameras) = parts
                .get_components::<(
                    &LaserSource,
                    &Interlocks,
                    &DetectionQueue,
                    &History,
                    &Radar,
                    &Controller,
                    &StationCameras,
                )>()
                .ok()?;
            Some(StationView {
                world,
                clock: *world.resource::<SimClock>(),
                station,
                mount,
                optics,
                command,
                tracker,
                operator,
                beam,
                fire,
                source,
                interlocks,
                queue,
                history,
                radar,
                controller,
                cameras,
            })
        })
    }

    /// The station of a name.
    pub fn station(&self, name: &str) -> Option<StationView<'a>> {
        self.stations().find(|station| station.name() == name)
    }

    /// The UAVs in the order of the scenario, and after them the distractors.
    pub fn uavs(&self) -> impl Iterator<Item = UavView<'a>> + use<'a> {
        let world = self.world;
        let entities = &self.cast().flying;
        entities.iter().filter_map(move |entity| {
            let parts = world.get_entity(*entity).ok()?;
            let (uav, flight) = parts.get_components::<(&Uav, &Flight)>().ok()?;
            Some(UavView {
                uav,
                shape: parts.get::<UavShape>(),
                flight,
                status: parts.get::<UavStatus>().copied(),
                distractor: parts.get::<Distractor>().map(|distractor| distractor.kind),
                skin: parts.get::<HeatedSkin>(),
                dose: parts.get::<Dose>().copied().unwrap_or_default(),
                rotors: (parts.get::<Guidance>()).map_or(0, |own| own.airframe.rotor_count),
                wind_enu_mps: parts.get::<Air>().map(|air| air.wind_enu_mps),
                fate: (world.resource::<Fates>().uavs).get(uav.index),
            })
        })
    }

    /// City, weather and light.
    pub fn air(&self) -> AirView<'a> {
        AirView {
            environment: self.world.resource::<Environment>(),
        }
    }
}

/// A station: its mount, its laser, and what it knows.
#[derive(Clone, Copy)]
pub struct StationView<'a> {
    world: &'a World,
    clock: SimClock,
    station: &'a Station,
    mount: &'a Mount,
    optics: &'a Optics,
    command: &'a MountCommand,
    tracker: &'a Tracker,
    operator: &'a Operator,
    beam: &'a BeamState,
    fire: &'a FireCommand,
    source: &'a LaserSource,
    interlocks: &'a Interlocks,
    queue: &'a DetectionQueue,
    history: &'a History,
    radar: &'a Radar,
    controller: &'a Controller,
    cameras: &'a StationCameras,
}

impl<'a> StationView<'a> {
    /// Its number in the scenario.
    pub fn index(&self) -> usize {
        self.station.index
    }

    /// Its name.
    pub fn name(&self) -> &'a str {
        &self.station.name
    }

    /// Gimbal, mirror and base: truth beside what the station measures.
    pub fn mount(&self) -> MountView {
        let Mount {
            gimbal,
            mirror,
            base,
            ..
        } = self.mount;
        MountView {
            r_enu_m: self.mount.r_enu_m,
            az_el_rad: gimbal.state.az_el_rad(),
            rates_radps: gimbal.state.rates_radps(),
            measured_az_el_rad: gimbal.state.encoder_az_el_rad(),
            measured_rates_radps: gimbal.state.gyro_rates_radps(),
            mirror_rad: mirror.deflection_rad(),
            mirror_at_stop: mirror.at_stop(),
            base_tilt_rad: base.tilt_rad(),
            commanded_rates_radps: self.command.gimbal.rate_radps.into(),
            commanded_mirror_rad: self.command.mirror_rad,
            laser: self.optics.laser,
            believed_axis_enu: self.optics.pointing.laser_axis_enu(),
        }
    }

    /// What the beam did in the last tick.
    pub fn beam(&self) -> &'a BeamState {
        self.beam
    }

    /// The air between the laser and the UAV nearest to its axis, as it was last worked out.
    pub fn beam_path(&self) -> Option<&'a BeamPath> {
        self.source.path.as_ref()
    }

    /// Whether the laser is to emit in the next tick.
    pub fn fires(&self) -> bool {
        self.fire.fire
    }

    /// Why the laser may not fire; empty while it may.
    pub fn interlocks(&self) -> &'a [&'static str] {
        &self.interlocks.reasons
    }

    /// Name of the pointing law in force; "paper" for the paper's two loops.
    pub fn law(&self) -> &'a str {
        match self.controller {
            Controller::Paper(_) => crate::scenario::PAPER,
            Controller::Pointing(pointing) => &pointing.name,
        }
    }

    /// State of the engagement.
    pub fn state(&self) -> TrackingState {
        self.tracker.state
    }

    /// Everything that the tracker knows.
    pub fn tracker(&self) -> &'a Tracker {
        self.tracker
    }

    /// The tracks, in the order of their identities.
    pub fn tracks(&self) -> impl Iterator<Item = TrackView<'a>> + use<'a> {
        let (r_station_enu_m, t_s) = (self.mount.r_enu_m, self.clock.t_s());
        let target = self.tracker.target;
        (self.tracker.table.tracks.iter()).map(move |track| TrackView {
            track,
            t_s,
            r_station_enu_m,
            is_target: target == Some(track.id),
        })
    }

    /// The target's track.
    pub fn target(&self) -> Option<TrackView<'a>> {
        self.tracks().find(|track| track.is_target)
    }

    /// Probability that the target is a UAV, as far as fire is concerned.
    pub fn target_uav_probability(&self) -> Option<f64> {
        self.tracker.target_uav_probability()
    }

    /// The operator's orders, those to come as well, and what of them is in force.
    pub fn operator(&self) -> &'a Operator {
        self.operator
    }

    /// The operator's orders that have come due, each with what has come of it.
    pub fn orders(&self) -> impl Iterator<Item = (&'a Order, &'a Answer)> + use<'a> {
        self.operator.orders.iter().zip(&self.operator.answers)
    }

    /// How many of those there are.
    pub(super) fn orders_due(&self) -> usize {
        self.operator.answers.len()
    }

    /// One of those.
    pub(super) fn order(&self, at: usize) -> Option<(&'a Order, &'a Answer)> {
        Some((
            self.operator.orders.get(at)?,
            self.operator.answers.get(at)?,
        ))
    }

    /// Where the radar has its targets now: number (in the scenario, where the radar plots the truth), azimuth (x) and elevation (y) [rad] and range [m].
    pub fn radar(&self) -> impl Iterator<Item = (usize, DVec2, f64)> + use<'a> {
        let t_s = self.clock.t_s();
        let cues = self.radar.cues(t_s);
        cues.map(|(number, cue)| (number, cue.az_el_rad, cue.range_m))
    }

    /// The answers of the detector that arrived in the last tick.
    pub fn arrived(&self) -> impl Iterator<Item = Arrived<'a>> + use<'a> {
        self.queue.arrived.iter().map(|batch| Arrived {
            frame: FrameView::of(&batch.frame),
            look: batch.look,
            detections: &batch.detections,
            best_scores: &batch.best_scores,
        })
    }

    /// The station's cameras, in the order of the scenario.
    pub fn cameras(&self) -> impl Iterator<Item = CameraView<'a>> + use<'a> {
        let (world, clock) = (self.world, self.clock);
        self.cameras.entities().iter().filter_map(move |entity| {
            let parts = world.get_entity(*entity).ok()?;
            let (camera, look, readout, exposure, history) = parts
                .get_components::<(
                    &SensorCamera,
                    &Look,
                    &Readout,
                    &AutoExposure,
                    &CameraHistory,
                )>()
                .ok()?;
            Some(CameraView {
                clock,
                camera,
                look,
                readout: *readout,
                exposure,
                history,
            })
        })
    }

    /// The camera of a tier, the first if there are several.
    pub fn camera(&self, tier: Tier) -> Option<CameraView<'a>> {
        self.cameras().find(|camera| camera.tier() == tier)
    }

    /// The time series that summary and report are made of.
    pub fn history(&self) -> &'a History {
        self.history
    }
}

/// A mount. Azimuths run clockwise from north; rates are relative to the base; deflections are of the line of sight,
/// right (x) and up (y).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MountView {
    /// Where the axes cross, east, north, up of the site [m].
    pub r_enu_m: DVec3,
    /// True azimuth (x) and elevation (y) [rad], and their rates [rad/s].
    pub az_el_rad: DVec2,
    pub rates_radps: DVec2,
    /// The same by encoders and gyros.
    pub measured_az_el_rad: DVec2,
    pub measured_rates_radps: DVec2,
    /// Deflection by the mirror [rad], and whether it is at a stop.
    pub mirror_rad: DVec2,
    pub mirror_at_stop: bool,
    /// Tilt of the base, a rotation vector about east, north, up [rad].
    pub base_tilt_rad: DVec3,
    /// What was commanded for the next tick: rates [rad/s] and deflection [rad].
    pub commanded_rates_radps: DVec2,
    pub commanded_mirror_rad: DVec2,
    /// The laser's true place and attitude; it points along its z.
    pub laser: Pose,
    /// Where the station believes its laser to point.
    pub believed_axis_enu: DVec3,
}

/// What the tracker believes of one object, carried on to the present tick.
#[derive(Clone, Copy)]
pub struct TrackView<'a> {
    track: &'a Track,
    t_s: f64,
    r_station_enu_m: DVec3,
    is_target: bool,
}

impl<'a> TrackView<'a> {
    /// Its identity, which no other track of the run ever has.
    pub fn id(&self) -> u32 {
        self.track.id
    }

    /// Whether it is the target.
    pub fn is_target(&self) -> bool {
        self.is_target
    }

    /// Azimuth (x) and elevation (y) [rad].
    pub fn az_el_rad(&self) -> DVec2 {
        self.track.filter.predicted(self.t_s).az_el_rad()
    }

    /// Standard deviation of those [rad].
    pub fn sigma_rad(&self) -> DVec2 {
        self.track.filter.predicted(self.t_s).sigma_rad()
    }

    /// Rates of azimuth (x) and elevation (y) [rad/s].
    pub fn rates_radps(&self) -> DVec2 {
        let los = self.track.filter.predicted(self.t_s);
        DVec2::new(los.az_rate_radps, los.el_rate_radps)
    }

    /// Range and its standard deviation [m], where it is known.
    pub fn range_m(&self) -> Option<(f64, f64)> {
        self.track.range.range_m(self.t_s)
    }

    /// Position [m] and velocity [m/s], east, north, up of the site, where the range is known.
    pub fn motion_enu(&self) -> Option<(DVec3, DVec3)> {
        self.track.position_enu(self.r_station_enu_m, self.t_s)
    }

    /// Probability that it is a UAV.
    pub fn uav_probability(&self) -> f64 {
        self.track.uav_belief()
    }

    /// Larger side of its box on the sky [rad].
    pub fn size_rad(&self) -> f64 {
        self.track.size_rad
    }

    /// Frames that have shown it, of all cameras.
    pub fn hits(&self) -> u32 {
        self.track.total_hits()
    }

    /// All that is known of it.
    pub fn track(&self) -> &'a Track {
        self.track
    }
}

/// A camera of a station.
#[derive(Clone, Copy)]
pub struct CameraView<'a> {
    clock: SimClock,
    camera: &'a SensorCamera,
    look: &'a Look,
    readout: Readout,
    exposure: &'a AutoExposure,
    history: &'a CameraHistory,
}

impl<'a> CameraView<'a> {
    /// Its number among all cameras of the run.
    pub fn index(&self) -> usize {
        self.camera.index
    }

    /// Its name.
    pub fn name(&self) -> &'a str {
        &self.camera.name
    }

    /// Search, coarse or precise.
    pub fn tier(&self) -> Tier {
        self.camera.tier
    }

    /// Geometry of the full sensor.
    pub fn pinhole(&self) -> Pinhole {
        self.camera.pinhole
    }

    /// Time between exposures [s].
    pub fn period_s(&self) -> f64 {
        self.clock.at_s(self.camera.period_ticks)
    }

    /// Whether it is due to expose at a tick; it does unless it idles.
    pub fn exposes_at(&self, tick: u64) -> bool {
        tick.is_multiple_of(self.camera.period_ticks)
    }

    /// Time from an exposure to the arrival of its detections [s].
    pub fn latency_s(&self) -> f64 {
        self.clock.at_s(self.camera.latency_ticks)
    }

    /// Where it is and how it is turned, in truth.
    pub fn pose(&self) -> Pose {
        self.look.pose
    }

    /// The same as the station believes it.
    pub fn believed(&self) -> Pose {
        self.look.believed
    }

    /// What it reads at its next exposure: nothing, the whole sensor, or what is around the target.
    pub fn readout(&self) -> Readout {
        self.readout
    }

    /// Exposure time times gain [s]; none before the first exposure.
    pub fn exposure_s(&self) -> Option<f64> {
        self.exposure.now.map(|(product_s, _)| product_s)
    }

    /// What it leaves for summary and report.
    pub fn history(&self) -> &'a CameraHistory {
        self.history
    }
}

/// One exposure of one camera, with the truth of its very tick.
#[derive(Clone, Copy)]
pub struct FrameView<'a> {
    frame: &'a Arc<ExposedFrame>,
}

/// A frame that is kept while the run goes on; its pixels are shared, not copied.
#[derive(Clone, Debug)]
pub struct Frame(Arc<ExposedFrame>);

impl Frame {
    pub(super) fn of(frame: Arc<ExposedFrame>) -> Self {
        Self(frame)
    }

    /// What can be read of it.
    pub fn view(&self) -> FrameView<'_> {
        FrameView::of(&self.0)
    }
}

impl<'a> FrameView<'a> {
    pub(super) fn of(frame: &'a Arc<ExposedFrame>) -> Self {
        Self { frame }
    }

    /// The frame itself, to be kept while the run goes on.
    pub fn keep(&self) -> Frame {
        Frame(self.frame.clone())
    }

    /// The frame of a question to a detector.
    pub fn asked(question: &'a Question) -> Self {
        Self::of(&question.frame)
    }

    /// Name of the camera.
    pub fn camera(&self) -> &'a str {
        &self.frame.name
    }

    /// Its number among all cameras of the run.
    pub fn camera_index(&self) -> usize {
        self.frame.index
    }

    /// Search, coarse or precise.
    pub fn tier(&self) -> Tier {
        self.frame.tier
    }

    /// Tick of the exposure.
    pub fn tick(&self) -> u64 {
        self.frame.tick
    }

    /// Exposures of this camera before this one.
    pub fn number(&self) -> u64 {
        self.frame.number
    }

    /// The pixels that were read out: offset and size on the sensor [px].
    pub fn rect(&self) -> PixelRect {
        self.frame.rect
    }

    /// Red, green and blue of those pixels, 8 bits each, row by row from the top; none in a run without pictures.
    pub fn rgb8(&self) -> Option<&'a [u8]> {
        self.frame.rgb8.as_ref().map(|rgb8| rgb8.as_slice())
    }

    /// Colour of the pixel in which a place of the full sensor [px] lies; none outside what was read out, and without
    /// pictures.
    pub fn pixel(&self, at_px: [f64; 2]) -> Option<[u8; 3]> {
        let PixelRect {
            offset_px,
            size_px: [width, height],
        } = self.frame.rect;
        let [x, y] = [0, 1].map(|axis| at_px[axis] - f64::from(offset_px[axis]));
        let inside = (0.0..f64::from(width)).contains(&x) && (0.0..f64::from(height)).contains(&y);
        let first = 3 * (y as usize * width as usize + x as usize);
        let rgb8 = self.rgb8().filter(|_| inside)?;
        rgb8.get(first..first + 3)?.try_into().ok()
    }

    /// Geometry of the full sensor.
    pub fn pinhole(&self) -> Pinhole {
        self.frame.pinhole
    }

    /// Where the camera was and how it was turned, in truth.
    pub fn pose(&self) -> Pose {
        self.frame.pose
    }

    /// The same as the station believed it.
    pub fn believed(&self) -> Pose {
        self.frame.believed
    }

    /// How the sensor was exposed.
    pub fn conditions(&self) -> &'a Conditions {
        &self.frame.conditions
    }

    /// The UAVs and distractors in front of the camera.
    pub fn truth(&self) -> &'a [UavInFrame] {
        &self.frame.truth
    }
}

/// An answer of the detector that has arrived, its latency over.
#[derive(Clone, Copy)]
pub struct Arrived<'a> {
    /// The frame that it is about.
    pub frame: FrameView<'a>,
    /// The pixels in which the detector looked: offset and size on the sensor [px].
    pub look: PixelRect,
    /// What was found, in pixels of the full sensor.
    pub detections: &'a [Detection],
    /// The best score given to anything near each object of the frame's truth, in its order, below the threshold too.
    pub best_scores: &'a [Option<f64>],
}

/// A UAV or a distractor: the truth.
#[derive(Clone, Copy)]
pub struct UavView<'a> {
    uav: &'a Uav,
    shape: Option<&'a UavShape>,
    flight: &'a Flight,
    status: Option<UavStatus>,
    distractor: Option<DistractorKind>,
    skin: Option<&'a HeatedSkin>,
    dose: Dose,
    rotors: usize,
    wind_enu_mps: Option<DVec3>,
    fate: Option<&'a Fate>,
}

impl<'a> UavView<'a> {
    /// Its number in the scenario; distractors come after all UAVs.
    pub fn index(&self) -> usize {
        self.uav.index
    }

    /// Its name.
    pub fn name(&self) -> &'a str {
        &self.uav.name
    }

    /// What it is, if it is no UAV.
    pub fn distractor(&self) -> Option<DistractorKind> {
        self.distractor
    }

    /// Length, width and height [m].
    pub fn size_m(&self) -> [f64; 3] {
        self.uav.size_m
    }

    /// Half of the larger side of its outline, seen from above [m].
    pub fn radius_m(&self) -> f64 {
        let [length_m, width_m, _] = self.uav.size_m;
        0.5 * length_m.max(width_m)
    }

    /// Where it is, east, north, up of the site [m].
    pub fn r_enu_m(&self) -> DVec3 {
        self.flight.state.r_enu_m
    }

    /// Its velocity over the ground [m/s].
    pub fn v_enu_mps(&self) -> DVec3 {
        self.flight.state.v_enu_mps
    }

    /// How it is turned: from its body's axes, forward, left and up, to east, north, up.
    pub fn q_enu_body(&self) -> DQuat {
        self.flight.state.q_enu_body
    }

    /// How it turns: rates about its body's axes, forward, left and up [rad/s].
    pub fn rates_body_radps(&self) -> DVec3 {
        self.flight.state.omega_body_radps
    }

    /// Rotors of its airframe; none of a distractor.
    pub fn rotors(&self) -> usize {
        self.rotors
    }

    /// Where the part aimed at is [m].
    pub fn aim_enu_m(&self) -> DVec3 {
        self.flight.aim_enu_m()
    }

    /// Points of its body, forward, left and up [m], whose box holds the airframe with its rotors.
    pub fn outline_body_m(&self) -> &'a [DVec3] {
        self.shape.map_or(&[], |shape| &shape.outline_body_m)
    }

    /// What has become of it; a distractor flies.
    pub fn status(&self) -> UavStatus {
        self.status.unwrap_or(UavStatus::Flying)
    }

    /// The hottest of what would fail under beams, a wall that bears or what lies behind one [K]; none of a distractor.
    pub fn skin_k(&self) -> Option<f64> {
        self.skin.map(|skin| skin.temperature_k)
    }

    /// The hottest place that beams have fallen on [K]; none of a distractor.
    pub fn face_k(&self) -> Option<f64> {
        self.skin.map(|skin| skin.face_k)
    }

    /// Area that is burnt through [m²].
    pub fn hole_m2(&self) -> f64 {
        self.skin.map_or(0.0, |skin| skin.hole_m2)
    }

    /// Parts that lasers have destroyed, in the order of their loss: body, battery, motor, arm, camera.
    pub fn lost(&self) -> Vec<String> {
        self.skin.map_or_else(Vec::new, HeatedSkin::lost_parts)
    }

    /// Where beams have fallen on it, while that is warm or marked, in the order in which they did.
    pub fn burns(&self) -> impl Iterator<Item = BurnView<'a>> {
        let patches = self.skin.map_or(&[][..], |skin| &skin.patches);
        patches.iter().map(BurnView)
    }

    /// Mean irradiance within 5 cm of the aim point in the last tick [W/m²].
    pub fn irradiance_wpm2(&self) -> f64 {
        self.skin.map_or(0.0, |skin| skin.irradiance_wpm2)
    }

    /// What lasers have spent on it.
    pub fn dose(&self) -> Dose {
        self.dose
    }

    /// The wind that it meets, gusts included [m/s]; none of a distractor that has no air of its own.
    pub fn wind_enu_mps(&self) -> Option<DVec3> {
        self.wind_enu_mps
    }

    /// When it was acquired, crashed, neutralised; none of a distractor, and before the first tick.
    pub fn fate(&self) -> Option<&'a Fate> {
        self.fate
    }
}

/// A place that beams have fallen on: a square grid on a plane that faced the beam when it first came, rows downwards.
#[derive(Clone, Copy)]
pub struct BurnView<'a>(&'a Patch);

impl<'a> BurnView<'a> {
    /// The part: body, battery, motor, arm or camera.
    pub fn part(&self) -> &'static str {
        self.0.struck.part
    }

    /// Its middle, forward, left and up on the body [m].
    pub fn middle_body_m(&self) -> DVec3 {
        self.0.middle_body_m
    }

    /// Columns along each side.
    pub fn side(&self) -> usize {
        self.0.grid.side
    }

    /// Distance between columns [m].
    pub fn cell_m(&self) -> f64 {
        self.0.grid.cell_m
    }

    /// Temperature of the face at a row and column [K]; `None` beside the part and where nothing is left.
    pub fn face_k(&self, row: usize, column: usize) -> Option<f64> {
        let grid = &self.0.grid;
        let is_inside = row < grid.side && column < grid.side;
        is_inside.then(|| grid.face_k(row * grid.side + column))?
    }

    /// What a place at a row and column looks like.
    pub fn mark(&self, row: usize, column: usize) -> Mark {
        let grid = &self.0.grid;
        let at = row * grid.side + column;
        match () {
            () if row >= grid.side || column >= grid.side || !grid.is_there(at) => Mark::Beside,
            () if grid.is_open(at) => Mark::Open,
            () if grid.is_black(at) => Mark::Black,
            () => Mark::Sound,
        }
    }

    /// Area that is burnt through [m²].
    pub fn hole_m2(&self) -> f64 {
        self.0.grid.hole_m2()
    }
}

/// What a place on a wall looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// The part does not reach so far.
    Beside,
    /// As it was.
    Sound,
    /// Turned black.
    Black,
    /// Its first layer is burnt through.
    Open,
}

/// City, weather and light.
#[derive(Clone, Copy)]
pub struct AirView<'a> {
    environment: &'a Environment,
}

impl<'a> AirView<'a> {
    /// The city: heights of ground and roofs, buildings, trees.
    pub fn city(&self) -> &'a City {
        &self.environment.city
    }

    /// The local frame on the Earth.
    pub fn site(&self) -> &'a SiteFrame {
        &self.environment.site
    }

    /// Density of the air at the site [kg/m³].
    pub fn density_kgpm3(&self) -> f64 {
        self.environment.air_density_kgpm3
    }

    /// Wind at 10 m, visibility, temperature and what falls.
    pub fn weather(&self) -> &'a crate::models::air::weather::Weather {
        &self.environment.weather
    }

    /// Mean wind at a place, gusts left out [m/s].
    pub fn mean_wind_enu_mps(&self, r_enu_m: DVec3) -> DVec3 {
        let height_m = self.height_agl_m(r_enu_m);
        self.environment.mean_wind.mean_wind_enu_mps(height_m)
    }

    /// Structure parameter of the refractive index at a place [m^(-2/3)].
    pub fn cn2(&self, r_enu_m: DVec3) -> f64 {
        (self.environment.cn2).cn2(self.height_agl_m(r_enu_m).max(1.0))
    }

    /// Height of a place above the bare ground [m].
    pub fn height_agl_m(&self, r_enu_m: DVec3) -> f64 {
        r_enu_m.z - (self.environment.city.dsm).terrain_m(r_enu_m.x, r_enu_m.y)
    }

    /// Direction to the sun.
    pub fn sun_dir_enu(&self) -> DVec3 {
        self.environment.backdrop.sun_dir_enu
    }

    /// What stands between two places.
    pub fn line_of_sight(&self, from_enu_m: DVec3, to_enu_m: DVec3) -> LineOfSight {
        self.environment.line_of_sight(from_enu_m, to_enu_m)
    }

    /// What the city is, in words.
    pub fn describe(&self) -> String {
        self.environment.describe()
    }
}
