//! What a camera's automatic exposure meters: the model's sky, its clouds and ground in its field.

use crate::components::capture::{AutoExposure, SensorCamera};
use crate::components::environment::Environment;
use crate::models::air::daylight::luminance;
use crate::models::air::sky::CHANNELS_M;
use crate::models::maths::kinematics::Pose;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::exposure::{Exposure, metered};
use crate::models::optics::stray::light::StrayLight;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Columns and rows of the sight lines along which the field is metered.
const COLUMNS: u32 = 4;
const ROWS: u32 = 3;
/// Reflectance of the brightest surfaces that are to keep their tones: light walls.
const BRIGHT_ALBEDO: f64 = 0.5;
/// Farthest ground that is told from the sky [m].
const FAR_M: f64 = 8_000.0;

/// The luminance of a bright surface in the light on level ground [kcd/m^2].
pub fn bright_ground_kcd_m2(environment: &Environment) -> f64 {
    BRIGHT_ALBEDO * environment.backdrop.sky.global_illuminance_klx() / PI
}

/// The luminance that a camera's whole field is metered at [kcd/m^2].
pub fn metered_kcd_m2(environment: &Environment, pinhole: &Pinhole, pose: &Pose) -> f64 {
    metered_with_kcd_m2(environment, pinhole, pose, None)
}

/// The same with the light of lasers and lamps upon it.
fn metered_with_kcd_m2(
    environment: &Environment,
    pinhole: &Pinhole,
    pose: &Pose,
    stray: Option<&StrayLight>,
) -> f64 {
    let backdrop = &environment.backdrop;
    let size_px = 2.0 * pinhole.centre_px();
    let cell_rad = size_px.x / f64::from(COLUMNS) / pinhole.focal_px;
    let ground = [bright_ground_kcd_m2(environment); 3];
    let extinction = CHANNELS_M.map(|m| environment.weather.extinction_per_m(m));
    metered((0..COLUMNS * ROWS).map(|i| {
        let cell = DVec2::new(f64::from(i % COLUMNS), f64::from(i / COLUMNS)) + 0.5;
        let px = size_px * cell / DVec2::new(f64::from(COLUMNS), f64::from(ROWS));
        let dir_cam = pinhole.ray(px);
        let dir_enu: DVec3 = pose.q_enu_cam * dir_cam;
        let dsm = &environment.city.dsm;
        let veil_kcd_m2 = stray.map_or(0.0, |stray| luminance(stray.veil_kcd_m2(dir_cam)));
        let scene_kcd_m2 = luminance(match dsm.first_hit(pose.r_enu_m, dir_enu, FAR_M) {
            Some(range_m) => backdrop
                .sky
                .through_air(ground, dir_enu, extinction, range_m),
            None => backdrop.radiance(dir_enu, cell_rad),
        });
        scene_kcd_m2 + veil_kcd_m2
    }))
}

/// The setting of a camera's next exposure: its control goes on from the last one.
pub(super) fn control(
    auto: &mut AutoExposure,
    camera: &SensorCamera,
    environment: &Environment,
    pose: &Pose,
    (tick, dt_s): (u64, f64),
    stray: Option<&StrayLight>,
) -> Exposure {
    let control = auto.now.map_or(camera.control, |(_, then)| {
        camera.control.read_after((tick - then) as f64 * dt_s)
    });
    let product_s = if control.is_fixed() {
        control.time_s[0]
    } else {
        let metered_kcd_m2 = metered_with_kcd_m2(environment, &camera.pinhole, pose, stray);
        let wanted_s =
            control.wanted_s(metered_kcd_m2, camera.sensor.params().saturation_kcd_s_m2());
        match auto.now {
            Some((now_s, then)) => control.approach_s(now_s, wanted_s, (tick - then) as f64 * dt_s),
            None => wanted_s,
        }
    };
    auto.now = Some((product_s, tick));
    control.setting(product_s)
}
