//! A tick in the MCAP recording.

use crate::components::beam::{BeamState, LaserSource};
use crate::components::capture::{ExposedFrame, Frames, SensorCamera};
use crate::components::control::SearchScan;
use crate::components::detect::{DetectionBatch, DetectionQueue, DetectorInUse};
use crate::components::engage::Interlocks;
use crate::components::flight::{Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{CameraView, Mount, MountCommand, Optics, Station};
use crate::components::operator::{Command, Designation, Operator, Order};
use crate::components::record::{Logged, OwnTopics, Recording, StateHash};
use crate::components::run::{Failure, SimClock};
use crate::components::track::Tracker;
use crate::recording::{
    BoxAnnotation, FrameTransform, LogLevel, Picture, Recorder, RecordingError, SceneEntity,
    SceneShape, proto,
};
use crate::scenario::{DriveOrder, Exposure, Gains};
use crate::systems::track::followed;
use bevy::ecs::query::QueryData;
use bevy::prelude::*;
use glam::{DQuat, DVec3};
use std::sync::Arc;

fn xyz(v: DVec3) -> proto::Vec3 {
    proto::Vec3 {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

fn box_of([x0_px, y0_px, x1_px, y1_px]: [f64; 4]) -> proto::BoxPx {
    proto::BoxPx {
        x0_px,
        y0_px,
        x1_px,
        y1_px,
    }
}

fn transform<'a>(child: &'a str, r_enu_m: DVec3, q: DQuat) -> FrameTransform<'a> {
    FrameTransform {
        parent: "enu",
        child,
        translation_m: r_enu_m.to_array(),
        rotation: q.to_array(),
    }
}

/// What is done, and to what of it.
fn words<const N: usize>(what: &str, parts: [Option<String>; N]) -> String {
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    format!("{what}: {}", parts.join(", "))
}

/// A UAV or distractor as it is recorded.
type Flying = (
    &'static Uav,
    &'static Flight,
    Option<&'static HeatedSkin>,
    &'static UavStatus,
    Option<&'static Distractor>,
);

/// Everything that a tick may record.
#[derive(bevy::ecs::system::SystemParam)]
pub struct Recorded<'w, 's> {
    clock: Res<'w, SimClock>,
    hash: Res<'w, StateHash>,
    frames: Res<'w, Frames>,
    detector: Res<'w, DetectorInUse>,
    stations: Query<'w, 's, RecordedStation>,
    uavs: Query<'w, 's, Flying>,
    cameras: Query<'w, 's, (&'static SensorCamera, &'static CameraView)>,
}

/// A station as it is recorded.
#[derive(QueryData)]
pub struct RecordedStation {
    entity: Entity,
    station: &'static Station,
    mount: &'static Mount,
    command: &'static MountCommand,
    optics: &'static Optics,
    source: &'static LaserSource,
    beam: &'static BeamState,
    queue: &'static DetectionQueue,
    scan: &'static SearchScan,
    tracker: &'static Tracker,
    operator: &'static Operator,
    interlocks: &'static Interlocks,
}
type OneStation<'a> = RecordedStationItem<'a, 'a>;

/// Writes this tick into the recording.
pub fn write_recording(
    now: Recorded,
    mut logged: Query<&mut Logged>,
    mut own: ResMut<OwnTopics>,
    mut recording: ResMut<Recording>,
    mut failure: ResMut<Failure>,
) {
    let own = own.take();
    let recording = &mut *recording;
    let Some(mut recorder) = recording.recorder.take() else {
        return;
    };
    let written = now
        .write(recorder.get(), recording, &mut logged)
        .and_then(|()| now.write_own(recorder.get(), &own));
    match written {
        Ok(()) => recording.recorder = Some(recorder),
        // The file is dropped; the error is reported.
        Err(error) => failure.set(error),
    }
}

impl Recorded<'_, '_> {
    fn write(
        &self,
        recorder: &mut Recorder,
        recording: &Recording,
        logged: &mut Query<&mut Logged>,
    ) -> Result<(), RecordingError> {
        let tick = self.clock.tick;
        let t_s = self.clock.t_s();
        let own = proto::Tick {
            tick,
            simulated_s: t_s,
            state_hash: self.hash.0,
        };
        recorder.own(tick, &own)?;
        for station in &self.stations {
            if let Ok(mut logged) = logged.get_mut(station.entity) {
                self.write_log(recorder, &station, &mut logged)?;
            }
        }
        if tick.is_multiple_of(recording.state_period_ticks) {
            self.write_states(recorder, tick)?;
        }
        for frame in &self.frames.0 {
            self.write_frame(recorder, recording, frame)?;
        }
        for batch in self
            .stations
            .iter()
            .flat_map(|station| &station.queue.arrived)
        {
            self.write_detections(recorder, tick, batch)?;
            self.mark(recorder, recording, batch)?;
        }
        Ok(())
    }

    /// Writes what a caller's own systems have published in this tick.
    fn write_own(
        &self,
        recorder: &mut Recorder,
        own: &[(usize, Vec<u8>)],
    ) -> Result<(), RecordingError> {
        own.iter()
            .try_for_each(|(topic, json)| recorder.json(self.clock.tick, *topic, json))
    }

    /// Logs a station's orders, glances and changes of state that are new.
    fn write_log(
        &self,
        recorder: &mut Recorder,
        station: &OneStation,
        logged: &mut Logged,
    ) -> Result<(), RecordingError> {
        let tick = self.clock.tick;
        let part = |name: &str| station.station.named(name);
        let given = &station.operator.orders;
        while let Some(order) = given.get(logged.orders).filter(|o| o.tick <= tick) {
            let before = logged.orders.checked_sub(1).map(|at| &given[at].command);
            logged.orders += 1;
            // A controller outside drives in every tick: its first order stands for those that follow.
            if before.is_some_and(|before| before.drives() && order.command.drives()) {
                continue;
            }
            let text = self.order_text(order);
            recorder.log(tick, LogLevel::Info, &part("operator"), &text)?;
        }
        if let Some(glance) = station.scan.glance.filter(|glance| glance.since == tick) {
            let text = format!("glances at track {}", glance.track);
            recorder.log(tick, LogLevel::Info, &part("search"), &text)?;
        }
        for change in &station.tracker.changes[logged.changes..] {
            let text = format!("{}: {}", change.to.name(), change.reason);
            recorder.log(tick, LogLevel::Info, &part("tracker"), &text)?;
        }
        logged.changes = station.tracker.changes.len();
        Ok(())
    }

    /// An operator's order in words.
    fn order_text(&self, order: &Order) -> String {
        match &order.command {
            Command::Target(Designation::Uav(index)) => {
                let uav = self.uavs.iter().find(|(uav, ..)| uav.index == *index);
                let name = uav.map_or("", |(uav, ..)| uav.name.as_str());
                format!("points at {name}")
            }
            Command::Target(Designation::Track(id)) => format!("chooses track {id}"),
            Command::Target(Designation::Release) => "leaves the choice to the tracker".into(),
            Command::Fire(true) => "gives fire authority".into(),
            Command::Fire(false) => "holds fire".into(),
            Command::Slew([azimuth_deg, elevation_deg]) => {
                format!("slews to azimuth {azimuth_deg:.1}°, elevation {elevation_deg:.1}°")
            }
            Command::Law(name) => format!("changes the pointing law to {name}"),
            Command::Gains(gains) => {
                let of = |name: &str, gains: Option<Gains>| {
                    gains.map(|Gains { kp, ki_per_s, kd_s }| {
                        format!("{name} kp {kp}, ki {ki_per_s} /s, kd {kd_s} s")
                    })
                };
                words(
                    "sets gains",
                    [
                        of("coarse", gains.coarse),
                        of("precise", gains.precise),
                        (gains.gimbal_per_s).map(|per_s| format!("gimbal {per_s} /s")),
                    ],
                )
            }
            Command::Drive(drive) => words(
                "drives gimbal and mirror",
                [
                    (drive.rates_degps).map(|[az, el]| format!("rates {az}°/s, {el}°/s")),
                    (drive.mirror_urad).map(|[x, y]| format!("mirror {x} µrad, {y} µrad")),
                    (*drive == DriveOrder::default()).then(|| "no longer".to_owned()),
                ],
            ),
            Command::Camera(camera) => words(
                &format!("sets camera {}", camera.name),
                [
                    camera.exposure_s.map(|exposure| match exposure {
                        Exposure::Seconds(time_s) => format!("exposure {time_s} s"),
                        Exposure::Auto(_) => "automatic exposure".to_owned(),
                    }),
                    (camera.exposure_level).map(|level| format!("exposure level {level}")),
                ],
            ),
            Command::Fly(fly) => words(
                &format!("flies {}", fly.uav),
                [
                    (!fly.path_enu_m.is_empty()).then(|| format!("path {:?} m", fly.path_enu_m)),
                    (fly.speed_mps).map(|mps| format!("{mps} m/s")),
                    (fly.velocity_enu_mps).map(|v| format!("velocity {v:?} m/s")),
                    fly.land.then(|| "to the ground".to_owned()),
                    (fly.rotors.as_ref()).map(|rotors| format!("rotors {rotors:?}")),
                    (fly.heading_deg).map(|deg| format!("heading {deg}°")),
                ],
            ),
            Command::Weather(weather) => words(
                "changes the weather",
                [
                    (weather.wind_speed_mps).map(|mps| format!("wind {mps} m/s")),
                    (weather.wind_from_deg).map(|deg| format!("wind from {deg}°")),
                    (weather.visibility_m).map(|m| format!("visibility {m} m")),
                ],
            ),
        }
    }

    fn write_states(&self, recorder: &mut Recorder, tick: u64) -> Result<(), RecordingError> {
        self.write_transforms(recorder, tick)?;
        self.write_scene(recorder, tick)?;
        for (uav, flight, skin, status, distractor) in &self.uavs {
            let state = &flight.state;
            let [x, y, z, w] = state.q_enu_body.to_array();
            recorder.own(
                tick,
                &proto::UavState {
                    name: uav.name.clone(),
                    r_enu_m: Some(xyz(state.r_enu_m)),
                    v_enu_mps: Some(xyz(state.v_enu_mps)),
                    q_enu_body: Some(proto::Quat { x, y, z, w }),
                    skin_temperature_k: skin.map_or(f64::NAN, |skin| skin.temperature_k),
                    status: distractor
                        .map_or(status.name(), |distractor| distractor.kind.name())
                        .into(),
                    face_temperature_k: skin.map_or(f64::NAN, |skin| skin.face_k),
                    hole_m2: skin.map_or(0.0, |skin| skin.hole_m2),
                    lost: skin.map_or_else(Vec::new, HeatedSkin::lost_parts),
                },
            )?;
        }
        for station in &self.stations {
            let index = station.station.index;
            recorder.of_station(tick, index, &mount_state(&station))?;
            recorder.of_station(tick, index, &self.track_state(&station))?;
            recorder.of_station(tick, index, &beam_state(&station))?;
        }
        Ok(())
    }

    /// Where cameras and UAVs are.
    fn write_transforms(&self, recorder: &mut Recorder, tick: u64) -> Result<(), RecordingError> {
        let mut transforms: Vec<_> = (self.cameras.iter())
            .map(|(camera, view)| transform(&camera.name, view.pose.r_enu_m, view.pose.q_enu_cam))
            .collect();
        transforms.extend(self.uavs.iter().map(|(uav, flight, ..)| {
            transform(&uav.name, flight.state.r_enu_m, flight.state.q_enu_body)
        }));
        recorder.frame_transforms(tick, &transforms)
    }

    /// UAVs as boxes, and the beam as a line.
    fn write_scene(&self, recorder: &mut Recorder, tick: u64) -> Result<(), RecordingError> {
        let shapes: Vec<_> = self
            .uavs
            .iter()
            .map(|(uav, _, _, status, distractor)| {
                [SceneShape::Cube {
                    centre_m: [0.0; 3],
                    rotation: [0.0, 0.0, 0.0, 1.0],
                    size_m: uav.size_m,
                    colour: match status {
                        _ if distractor.is_some() => [0.4, 0.45, 0.5, 1.0],
                        UavStatus::Flying => [0.9, 0.6, 0.0, 1.0],
                        _ => [0.5, 0.1, 0.1, 1.0],
                    },
                }]
            })
            .collect();
        let beams: Vec<_> = (self.stations.iter())
            .filter(|station| station.beam.firing)
            .map(|station| {
                let laser = station.optics.laser;
                let range_m = station.tracker.range_m.unwrap_or(1_500.0);
                let end_m = laser.r_enu_m + laser.q_enu_cam * DVec3::new(0.0, 0.0, range_m);
                (
                    station.station.named("beam"),
                    [laser.r_enu_m.to_array(), end_m.to_array()],
                )
            })
            .collect();
        let lines: Vec<_> = (beams.iter())
            .map(|(_, points_m)| {
                [SceneShape::Line {
                    points_m,
                    width_m: 0.1,
                    colour: [0.84, 0.37, 0.0, 0.8],
                }]
            })
            .collect();
        let shown_s = 1.0 / 60.0; // [s]
        let lifetime_ticks = u32::try_from(self.clock.ticks_of(shown_s)).unwrap_or(1);
        let mut entities: Vec<_> = self
            .uavs
            .iter()
            .zip(&shapes)
            .map(|((uav, ..), shapes)| SceneEntity {
                id: &uav.name,
                frame: &uav.name,
                lifetime_ticks: 0,
                shapes,
            })
            .collect();
        entities.extend(
            beams
                .iter()
                .zip(&lines)
                .map(|((id, _), shapes)| SceneEntity {
                    id,
                    frame: "enu",
                    lifetime_ticks,
                    shapes,
                }),
        );
        recorder.scene_update(tick, &entities)
    }

    fn track_state(&self, station: &OneStation) -> proto::TrackState {
        let (tracker, t_s) = (station.tracker, self.clock.t_s());
        let mut state = proto::TrackState {
            state: tracker.state.name().into(),
            range_m: tracker.range_m.unwrap_or(f64::NAN),
            ..Default::default()
        };
        let Some(target) = tracker.target_track() else {
            return state;
        };
        let los = target.filter.predicted(t_s);
        let uavs = self.uavs.iter().map(|(uav, flight, ..)| (uav, flight));
        let index = followed(tracker, t_s, station.mount.r_enu_m, uavs).map(|(index, _)| index);
        let name = self.uavs.iter().find(|(uav, ..)| Some(uav.index) == index);
        state.target = name.map(|(uav, ..)| uav.name.clone()).unwrap_or_default();
        state.los_azimuth_rad = los.az_rad;
        state.los_elevation_rad = los.el_rad;
        state.los_azimuth_rate_radps = los.az_rate_radps;
        state.los_elevation_rate_radps = los.el_rate_radps;
        let [az, el] = los.covariance;
        state.los_covariance = vec![0.0; 16];
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            state.los_covariance[4 * (2 * i) + 2 * j] = az[(i, j)];
            state.los_covariance[4 * (2 * i + 1) + 2 * j + 1] = el[(i, j)];
        }
        state.track = Some(target.id);
        state.quality = target.filter.quality();
        state.class = self.detector.class(target.label()).into();
        state.uav_probability = target.uav_belief();
        state.belief = tracker
            .target_belief()
            .map_or(Vec::new(), |belief| belief.0.to_vec());
        state.doubt = tracker.doubt;
        state
    }

    fn write_frame(
        &self,
        recorder: &mut Recorder,
        recording: &Recording,
        frame: &ExposedFrame,
    ) -> Result<(), RecordingError> {
        self.write_truth(recorder, frame)?;
        self.write_miss(recorder, frame)?;
        if let Some(rgb8) = &frame.rgb8
            && recording.keeps(frame)
        {
            write_image(recorder, recording, frame, rgb8)?;
        }
        Ok(())
    }

    /// What the cameras should see in a frame.
    fn write_truth(
        &self,
        recorder: &mut Recorder,
        frame: &ExposedFrame,
    ) -> Result<(), RecordingError> {
        let name = |index: usize| {
            self.uavs
                .iter()
                .find(|(uav, ..)| uav.index == index)
                .map(|(uav, ..)| uav.name.clone())
                .unwrap_or_default()
        };
        let uavs = frame
            .truth
            .iter()
            .map(|seen| {
                let rendered = seen.rendered;
                let visible =
                    rendered.map_or(f64::from(u8::from(seen.clear)), |r| r.visible_fraction);
                let shown = rendered.and_then(|r| r.box_px);
                proto::UavTruth {
                    name: name(seen.uav),
                    r#box: Some(box_of(shown.unwrap_or(seen.box_px))),
                    visible_fraction: visible,
                    range_m: seen.range_m,
                }
            })
            .collect();
        let truth = proto::FrameTruth {
            camera: frame.name.to_string(),
            exposure_tick: frame.tick,
            uavs,
        };
        recorder.own(frame.tick, &truth)
    }

    /// The target's true distance from the laser's axis in a frame of a camera that holds it.
    fn write_miss(
        &self,
        recorder: &mut Recorder,
        frame: &ExposedFrame,
    ) -> Result<(), RecordingError> {
        let Ok(station) = self.stations.get(frame.station) else {
            return Ok(());
        };
        if !station.tracker.state.holds(frame.tier) {
            return Ok(());
        }
        let uavs = self
            .uavs
            .iter()
            .filter(|(_, _, _, status, _)| **status == UavStatus::Flying)
            .map(|(uav, flight, ..)| (uav, flight));
        let target = followed(station.tracker, self.clock.t_s(), frame.pose.r_enu_m, uavs)
            .map(|(index, _)| index);
        let seen = frame.truth.iter().find(|seen| Some(seen.uav) == target);
        let Some(seen) = seen.filter(|seen| !seen.distractor) else {
            return Ok(());
        };
        let miss = proto::MissDistance {
            camera: frame.name.to_string(),
            exposure_tick: frame.tick,
            miss_px: frame.reticle_px().distance(seen.aim_px.into()),
        };
        recorder.own(frame.tick, &miss)
    }

    /// Marks the recorded image of a batch that has arrived, if there is one.
    fn mark(
        &self,
        recorder: &mut Recorder,
        recording: &Recording,
        batch: &DetectionBatch,
    ) -> Result<(), RecordingError> {
        let frame = &batch.frame;
        if frame.rgb8.is_none() || !recording.keeps(frame) {
            return Ok(());
        }
        let [dx, dy] = frame.rect.offset_px.map(f64::from);
        let reticle = frame.reticle_px();
        let threshold = self.detector.reading.start_score;
        let boxes: Vec<_> = batch
            .detections
            .iter()
            .map(|detection| BoxAnnotation {
                label: self.detector.class(detection.label),
                score: detection.score,
                weak: detection.score < threshold,
                rect_px: {
                    let [x0, y0, x1, y1] = detection.box_px;
                    [x0 - dx, y0 - dy, x1 - dx, y1 - dy]
                },
            })
            .collect();
        recorder.image_annotations(
            self.clock.tick,
            frame.tick,
            frame.index,
            &boxes,
            [reticle.x - dx, reticle.y - dy],
        )
    }

    fn write_detections(
        &self,
        recorder: &mut Recorder,
        tick: u64,
        batch: &DetectionBatch,
    ) -> Result<(), RecordingError> {
        let detections = batch
            .detections
            .iter()
            .map(|detection| proto::Detection {
                r#box: Some(box_of(detection.box_px)),
                score: detection.score,
                label: self.detector.class(detection.label).into(),
            })
            .collect();
        recorder.own(
            tick,
            &proto::Detections {
                camera: batch.frame.name.to_string(),
                exposure_tick: batch.frame.tick,
                available_tick: batch.available_tick,
                detections,
                threshold: self.detector.reading.start_score,
            },
        )
    }
}

fn mount_state(station: &OneStation) -> proto::MountState {
    let (mount, command) = (station.mount, station.command);
    let (angle, rate) = (
        mount.gimbal.state.az_el_rad(),
        mount.gimbal.state.rates_radps(),
    );
    let tilt = mount.base.tilt_rad();
    proto::MountState {
        azimuth_rad: angle.x,
        elevation_rad: angle.y,
        azimuth_rate_radps: rate.x,
        elevation_rate_radps: rate.y,
        azimuth_rate_command_radps: command.gimbal.rate_radps[0],
        elevation_rate_command_radps: command.gimbal.rate_radps[1],
        mirror_x_rad: mount.mirror.deflection_rad().x,
        mirror_y_rad: mount.mirror.deflection_rad().y,
        mirror_x_command_rad: command.mirror_rad.x,
        mirror_y_command_rad: command.mirror_rad.y,
        base_tilt_east_rad: tilt.x,
        base_tilt_north_rad: tilt.y,
    }
}

fn beam_state(station: &OneStation) -> proto::BeamState {
    let (source, beam) = (station.source, station.beam);
    proto::BeamState {
        firing: beam.firing,
        power_at_exit_w: if beam.firing {
            source.laser.power_w
        } else {
            0.0
        },
        power_at_target_w: beam.power_at_target_w,
        power_in_bucket_w: beam.power_in_bucket_w,
        irradiance_wpm2: beam.irradiance_wpm2,
        spot_radius_m: beam.spot_radius_m,
        offset_m: beam.offset_m,
        transmittance: beam.transmittance,
        scintillation: beam.scintillation,
        interlocks: station
            .interlocks
            .reasons
            .iter()
            .map(ToString::to_string)
            .collect(),
        peak_wpm2: beam.peak_wpm2,
    }
}

/// Records the picture of a frame.
fn write_image(
    recorder: &mut Recorder,
    recording: &Recording,
    frame: &ExposedFrame,
    rgb8: &Arc<Vec<u8>>,
) -> Result<(), RecordingError> {
    let (camera, pinhole) = (frame.index, &frame.pinhole);
    let [w, h] = frame.rect.size_px;
    let picture = Picture {
        rgb8: rgb8.clone(),
        size_px: [w as u16, h as u16],
        quality: recording.jpeg_quality,
        most_bytes: recording.most_bytes([w, h]),
    };
    // A window is a picture of its own: its calibration has the shifted principal point.
    let [dx, dy] = frame.rect.offset_px.map(f64::from);
    let centre = pinhole.centre_px();
    let (f, cx, cy) = (pinhole.focal_px, centre.x - dx, centre.y - dy);
    let k_px = [f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0];
    recorder.camera_calibration(frame.tick, camera, w, h, k_px)?;
    recorder.picture(frame.tick, camera, picture)
}
