//! How things appear to a camera, as far as truth without a picture says.

use crate::components::capture::{ExposedFrame, PixelRect, UavInFrame};
use crate::components::detect::Surroundings;
use crate::models::maths::kinematics::{los_to_az_el, wrap_pi};
use crate::models::sensing::measured::{Appearance, Patch};
use glam::DVec2;

/// How a thing in a frame appears in a picture that is shrunk so many times.
pub fn appearance(
    around: &Surroundings,
    frame: &ExposedFrame,
    seen: &UavInFrame,
    shrunk: u32,
) -> Appearance {
    let [x0, y0, x1, y1] = seen.box_px;
    let ray_enu = frame.pose.q_enu_cam * frame.pinhole.ray(seen.aim_px.into());
    let exposure = &frame.conditions.exposure;
    Appearance {
        tier: frame.tier,
        size_px: (x1 - x0).max(y1 - y0) / f64::from(shrunk),
        in_sky: around.is_sky(frame.pose.r_enu_m, ray_enu),
        transmittance: (-around.extinction_per_m * seen.range_m).exp(),
        gain: exposure.gain,
        smear_px: speed_pxps(frame, seen) * exposure.time_s / f64::from(shrunk),
    }
}

/// How fast a thing crosses the picture [px/s].
fn speed_pxps(frame: &ExposedFrame, seen: &UavInFrame) -> f64 {
    let motion = &frame.conditions.motion;
    let [x, y] = seen.aim_px;
    let own = motion
        .boxes
        .iter()
        .find(|([x0, y0, x1, y1], _)| (*x0..=*x1).contains(&x) && (*y0..=*y1).contains(&y));
    own.map_or(motion.still_pxps, |(_, pxps)| *pxps).length()
}

/// Where a thing is in the picture [px]: its true box, shifted as the air before the lens does.
pub fn shown_box_px(frame: &ExposedFrame, seen: &UavInFrame) -> [f64; 4] {
    let shift_px = (frame.seeing.as_ref()).map_or(DVec2::ZERO, |air| air.shift_px(seen.uav));
    let [x0, y0, x1, y1] = seen.box_px;
    [
        x0 + shift_px.x,
        y0 + shift_px.y,
        x1 + shift_px.x,
        y1 + shift_px.y,
    ]
}

/// Azimuth and elevation [rad] of a place on the sensor [px] of a frame.
pub fn az_el_rad(frame: &ExposedFrame, at_px: DVec2) -> DVec2 {
    los_to_az_el(frame.pose.q_enu_cam * frame.pinhole.ray(at_px))
}

/// The part of the sky that a part of a frame's sensor shows: a rectangle of azimuths and elevations around it.
pub fn patch(frame: &ExposedFrame, look: &PixelRect) -> Patch {
    let [x0, y0] = look.offset_px.map(f64::from);
    let [width, height] = look.size_px.map(f64::from);
    let middle = az_el_rad(frame, DVec2::new(x0 + 0.5 * width, y0 + 0.5 * height));
    let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
        .map(|(right, down)| az_el_rad(frame, DVec2::new(x0 + right * width, y0 + down * height)));
    let azimuths = corners.map(|corner| middle.x + wrap_pi(corner.x - middle.x));
    let elevations = corners.map(|corner| corner.y);
    let ends = |values: [f64; 4]| {
        let least = values.into_iter().fold(f64::INFINITY, f64::min);
        [least, values.into_iter().fold(f64::NEG_INFINITY, f64::max)]
    };
    Patch {
        tier: frame.tier,
        ifov_rad: frame.pinhole.ifov_rad(),
        az_rad: ends(azimuths),
        el_rad: ends(elevations),
    }
}
