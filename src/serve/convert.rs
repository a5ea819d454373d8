//! What clients see of a run: views as messages.

use crate::components::capture::UavInFrame;
use crate::components::operator::{Answer, Command};
use crate::simulation::{
    AirView, Event, FrameView, Simulation, StationView, TrackView, UavView, View, What,
};
use boresight_lockstep::{VERSION, proto};
use glam::{DQuat, DVec3};

fn quat(q: DQuat) -> Vec<f64> {
    q.to_array().to_vec()
}

fn vec3(r: DVec3) -> Vec<f64> {
    r.to_array().to_vec()
}

/// What a client is told that is let in.
pub(super) fn welcome(
    run: &Simulation,
    pace: Option<f64>,
    pictures: bool,
    outside_detector: bool,
) -> proto::Welcome {
    let view = run.view();
    let cameras = view.stations().flat_map(|station| {
        station.cameras().map(move |camera| {
            let pinhole = camera.pinhole();
            proto::Camera {
                name: camera.name().to_owned(),
                station: station.name().to_owned(),
                index: camera.index() as u32,
                tier: camera.tier().word().to_owned(),
                width_px: pinhole.width_px,
                height_px: pinhole.height_px,
                focal_px: pinhole.focal_px,
                period_ticks: (camera.period_s() * f64::from(view.tick_hz())).round() as u64,
            }
        })
    });
    proto::Welcome {
        version: VERSION,
        program: crate::VERSION.to_owned(),
        scenario: run.scenario().scenario.name.clone(),
        seed: run.seed(),
        tick_hz: view.tick_hz(),
        last_tick: view.last_tick(),
        stations: view
            .stations()
            .map(|station| station.name().to_owned())
            .collect(),
        uavs: view.uavs().map(|uav| uav.name().to_owned()).collect(),
        cameras: cameras.collect(),
        pace,
        pictures,
        outside_detector,
    }
}

/// The run as its last tick left it, without what is not wanted.
pub(super) fn state(view: View, wanted: proto::GetState) -> proto::State {
    let stations = view.stations().filter(|_| !wanted.no_stations);
    let uavs = view.uavs().filter(|_| !wanted.no_uavs);
    proto::State {
        tick: view.tick(),
        t_s: view.t_s(),
        state_hash: view.state_hash(),
        stations: stations.map(|station| of_station(&station)).collect(),
        uavs: uavs.map(|uav| of_uav(&uav)).collect(),
        air: (!wanted.no_air).then(|| air(&view.air())),
        ..proto::State::default()
    }
}

fn of_station(station: &StationView) -> proto::Station {
    let mount = station.mount();
    let beam = station.beam();
    let two = |v: glam::DVec2| v.to_array().to_vec();
    proto::Station {
        name: station.name().to_owned(),
        state: station.state().name().to_owned(),
        law: station.law().to_owned(),
        mount: Some(proto::Mount {
            r_enu_m: vec3(mount.r_enu_m),
            az_el_rad: two(mount.az_el_rad),
            az_el_rates_radps: two(mount.rates_radps),
            measured_az_el_rad: two(mount.measured_az_el_rad),
            measured_az_el_rates_radps: two(mount.measured_rates_radps),
            mirror_rad: two(mount.mirror_rad),
            mirror_at_stop: mount.mirror_at_stop,
            base_tilt_enu_rad: vec3(mount.base_tilt_rad),
            commanded_az_el_rates_radps: two(mount.commanded_rates_radps),
            commanded_mirror_rad: two(mount.commanded_mirror_rad),
            laser_axis_enu: vec3(mount.laser.q_enu_cam * DVec3::Z),
            believed_axis_enu: vec3(mount.believed_axis_enu),
        }),
        beam: Some(proto::Beam {
            firing: beam.firing,
            fires_next: station.fires(),
            interlocks: station
                .interlocks()
                .iter()
                .map(|&why| why.to_owned())
                .collect(),
            aimed: beam.aimed.map(|index| index as u32),
            power_at_target_w: beam.power_at_target_w,
            power_in_bucket_w: beam.power_in_bucket_w,
            irradiance_wpm2: beam.irradiance_wpm2,
            spot_radius_m: beam.spot_radius_m,
            offset_m: beam.offset_m,
            on_aim_point: beam.on_aim_point,
            transmittance: beam.transmittance,
            scintillation: beam.scintillation,
            energy_j: beam.energy_j,
            dwell_s: beam.dwell_s,
            peak_wpm2: beam.peak_wpm2,
        }),
        tracks: station.tracks().map(|of| track(&of)).collect(),
        target: station.target().map(|target| target.id()),
        target_uav_probability: station.target_uav_probability(),
    }
}

fn track(track: &TrackView) -> proto::Track {
    let motion = track.motion_enu();
    let range = track.range_m();
    let two = |v: glam::DVec2| v.to_array().to_vec();
    proto::Track {
        id: track.id(),
        is_target: track.is_target(),
        az_el_rad: two(track.az_el_rad()),
        sigma_az_el_rad: two(track.sigma_rad()),
        az_el_rates_radps: two(track.rates_radps()),
        range_m: range.map(|(range_m, _)| range_m),
        sigma_range_m: range.map(|(_, sigma_m)| sigma_m),
        r_enu_m: motion.map_or_else(Vec::new, |(r_enu_m, _)| vec3(r_enu_m)),
        v_enu_mps: motion.map_or_else(Vec::new, |(_, v_enu_mps)| vec3(v_enu_mps)),
        uav_probability: track.uav_probability(),
        size_rad: track.size_rad(),
        hits: track.hits(),
    }
}

fn of_uav(uav: &UavView) -> proto::Uav {
    let fate = uav.fate();
    proto::Uav {
        name: uav.name().to_owned(),
        index: uav.index() as u32,
        distractor: uav.distractor().is_some(),
        status: uav.status().name().to_owned(),
        r_enu_m: vec3(uav.r_enu_m()),
        v_enu_mps: vec3(uav.v_enu_mps()),
        q_enu_body: quat(uav.q_enu_body()),
        aim_enu_m: vec3(uav.aim_enu_m()),
        skin_k: uav.skin_k(),
        acquired_s: fate.and_then(|fate| fate.acquired_s),
        neutralised_s: fate.and_then(|fate| fate.neutralised_s),
        at_asset_s: fate.and_then(|fate| fate.at_asset_s),
        face_k: uav.face_k(),
        hole_m2: uav.hole_m2(),
        lost: uav.lost(),
    }
}

fn air(air: &AirView) -> proto::Air {
    let weather = air.weather();
    proto::Air {
        wind_speed_mps: weather.wind_speed_mps,
        wind_from_rad: weather.wind_from_rad,
        visibility_m: weather.visibility_m,
        temperature_k: weather.temperature_k,
        cloud_cover: weather.cloud_cover,
        precipitation_mmph: weather.precipitation_mmph,
    }
}

/// A frame, with its pixels and its truth where they are wanted.
pub(super) fn frame(frame: FrameView, pixels: bool, truth: bool) -> proto::Frame {
    let rect = frame.rect();
    let rgb8 = frame.rgb8().filter(|_| pixels);
    let truth = if truth { frame.truth() } else { &[] };
    proto::Frame {
        camera: frame.camera().to_owned(),
        index: frame.camera_index() as u32,
        tier: frame.tier().word().to_owned(),
        tick: frame.tick(),
        number: frame.number(),
        x_px: rect.offset_px[0],
        y_px: rect.offset_px[1],
        width_px: rect.size_px[0],
        height_px: rect.size_px[1],
        rgb8: rgb8.map(<[u8]>::to_vec).unwrap_or_default(),
        r_enu_m: vec3(frame.pose().r_enu_m),
        q_enu_cam: quat(frame.pose().q_enu_cam),
        believed_q_enu_cam: quat(frame.believed().q_enu_cam),
        focal_px: frame.pinhole().focal_px,
        exposure_s: frame.conditions().exposure.time_s,
        truth: truth.iter().map(in_frame).collect(),
    }
}

fn in_frame(seen: &UavInFrame) -> proto::InFrame {
    let rendered = seen.rendered.as_ref();
    proto::InFrame {
        uav: seen.uav as u32,
        distractor: seen.distractor,
        box_px: seen.box_px.to_vec(),
        aim_px: seen.aim_px.to_vec(),
        range_m: seen.range_m,
        clear: seen.clear,
        visible_box_px: rendered
            .and_then(|of| of.box_px)
            .map(|of| of.to_vec())
            .unwrap_or_default(),
        visible_fraction: rendered.map(|of| of.visible_fraction),
    }
}

/// Something that happened.
pub(super) fn event(event: &Event) -> proto::Event {
    use proto::event::What as Is;
    let (of, what) = match &event.what {
        What::State {
            station,
            to,
            reason,
        } => {
            let change = proto::StateChange {
                to: to.name().to_owned(),
                reason: reason.clone(),
            };
            (station, Is::State(change))
        }
        What::Order {
            station,
            command,
            answer,
        } => (station, Is::Order(order_answer(command, answer))),
        What::Fire { station, .. } => (station, Is::Fire(true)),
        What::CeaseFire { station } => (station, Is::Fire(false)),
        What::Uav { name, status, .. } => (name, Is::Uav(status.name().to_owned())),
        What::AtAsset { name, .. } => (name, Is::AtAsset(true)),
    };
    proto::Event {
        tick: event.tick,
        t_s: event.t_s,
        of: of.clone(),
        what: Some(what),
    }
}

fn order_answer(command: &Command, answer: &Answer) -> proto::OrderAnswer {
    let (answer, reason) = answer.words();
    proto::OrderAnswer {
        order: command.name().to_owned(),
        answer: answer.to_owned(),
        reason: reason.to_owned(),
    }
}
