//! What a frame of a camera shows the tracker, and how it becomes tracks.

use super::tracker::{BoresightError, Tracker, TrackerParams, TrackingState};
use crate::maths::kinematics::{Pose, az_el_to_los, los_to_az_el};
use crate::optics::camera::{Pinhole, PixelRect};
use crate::optics::detection::Detection;
use crate::optics::tier::Tier;
use crate::tracking::table::{CameraLook, Sighting};
use glam::DVec2;

/// Standard deviation of the pointing knowledge [rad]: the drift of the base gyro within the
/// memory of the filter.
const POINTING_SIGMA_RAD: f64 = 5e-6;
/// A camera that turns faster [rad/s] follows nothing that flies: it slews, and what it sees is smeared.
const SLEW_RADPS: f64 = 0.1;
/// Standard deviation of a smeared detection's centre over the smear: that of a point of it, taken anywhere (1/√12).
const SMEAR_SHARE: f64 = 0.29;
/// Smear beyond which a picture shows no small target for sure [px].
const STEADY_PX: f64 = 4.0;

/// A frame as the station knows it, with what was found in it.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// Number of the camera, and what it is for.
    pub camera: usize,
    pub tier: Tier,
    /// Tick and time [s] of the exposure, and the tick in which the tracker may know of it.
    pub tick: u64,
    pub t_s: f64,
    pub available_tick: u64,
    /// How long it was exposed [s].
    pub exposure_s: f64,
    /// Geometry of the full sensor.
    pub pinhole: Pinhole,
    /// Where the station believes the camera to have been, and how turned.
    pub believed: Pose,
    /// Where the laser's axis is on the sensor by what the station knows [px], and its standard error on the sky [rad].
    pub reticle_px: DVec2,
    pub boresight_sigma_rad: f64,
    /// The pixels in which the detector looked, and by how much its picture was shrunk.
    pub look: PixelRect,
    pub shrunk: u32,
    /// What it found, in pixels of the full sensor.
    pub detections: &'a [Detection],
    /// The picture, 8-bit RGB row by row, and its place on the sensor; none in a run without pictures.
    pub picture: Option<(&'a [u8], PixelRect)>,
}

impl Shown<'_> {
    /// A whole frame at tick 0 in which nothing was found.
    pub fn whole(tier: Tier, pinhole: Pinhole, believed: Pose) -> Self {
        Self {
            camera: tier as usize,
            tier,
            tick: 0,
            t_s: 0.0,
            available_tick: 0,
            exposure_s: 0.0,
            pinhole,
            believed,
            reticle_px: pinhole.centre_px(),
            boresight_sigma_rad: 0.0,
            look: PixelRect {
                offset_px: [0; 2],
                size_px: [pinhole.width_px, pinhole.height_px],
            },
            shrunk: 1,
            detections: &[],
            picture: None,
        }
    }
}

/// Updates the track table with what a frame showed; returns for each detection the track it went to (of the paper's
/// rule, which knows no others, nothing).
pub fn take_in(tracker: &mut Tracker, params: &TrackerParams, shown: &Shown) -> Vec<Option<u32>> {
    let Shown {
        pinhole, tier, t_s, ..
    } = *shown;
    let smear_rad = smear_rad(tracker, shown);
    let sightings = sightings(shown, params, smear_rad);
    // What is smeared may fairly be missed, and starts nothing.
    let steady = smear_rad < STEADY_PX * pinhole.ifov_rad();
    let in_view = |az_el: DVec2| steady && sees(&pinhole, &shown.believed, shown.look, az_el);
    let look = CameraLook {
        tier,
        t_s,
        ifov_rad: pinhole.ifov_rad(),
        reads: &params.reads,
        sightings: &sightings,
        in_view: &in_view,
        // But in the search the precise camera sees what it was turned to: a track already.
        start_tracks: steady && (tier != Tier::Precise || tracker.state == TrackingState::Search),
    };
    let blind = params.nearest_to_centre
        && tier != Tier::Search
        && !matches!(
            tracker.state,
            TrackingState::Search | TrackingState::Acquire
        );
    let mut assigned = Vec::new();
    let chosen = if blind {
        let nearest = nearest_to_centre(shown);
        if let Some(target) = tracker.target {
            let sighting = nearest.map(|index| &sightings[index]);
            tracker.table.force(target, &look, sighting);
        }
        nearest
    } else {
        assigned = tracker.table.update(&look);
        tracker.follow_joined();
        tracker
            .target
            .and_then(|target| assigned.iter().position(|id| *id == Some(target)))
    };
    if let Some(index) = chosen {
        tracker.hits_in_state[tier] += 1;
        let linear = params.linear_angles;
        let aim_rad = tracker.aim_rad;
        tracker.error[tier] = Some(boresight_error(shown, index, linear, aim_rad));
    }
    assigned
}

/// How far the picture moved while a frame was exposed in a slew [rad], by the turn that the station believes the camera to
/// have made since its last frame.
fn smear_rad(tracker: &mut Tracker, shown: &Shown) -> f64 {
    let (t_s, turned) = (shown.t_s, shown.believed.q_enu_cam);
    let before = tracker.turned.insert(shown.camera, (t_s, turned));
    let rate_radps = match before {
        Some((before_s, before)) if t_s > before_s => {
            before.angle_between(turned) / (t_s - before_s)
        }
        _ => 0.0,
    };
    if rate_radps > SLEW_RADPS {
        rate_radps * shown.exposure_s
    } else {
        0.0
    }
}

/// The directions of the detections; the picture moved by `smear_rad` [rad] meanwhile.
fn sightings(shown: &Shown, params: &TrackerParams, smear_rad: f64) -> Vec<Sighting> {
    let pinhole = &shown.pinhole;
    let ifov_rad = pinhole.ifov_rad();
    let pointing_rad = POINTING_SIGMA_RAD.hypot(shown.boresight_sigma_rad);
    shown
        .detections
        .iter()
        .map(|detection| {
            let ray_cam = pinhole.ray(detection.aim_px.into());
            let [x0, y0, x1, y1] = detection.box_px;
            let size_px = (x1 - x0).max(y1 - y0);
            // A picture that was shrunk shows no finer than its pixels, and a larger box has more to err in.
            let centre_px = params.centre_sigma_px * f64::from(shown.shrunk);
            let sigma_px = centre_px.hypot(params.centre_sigma_rel * size_px);
            Sighting {
                az_el_rad: los_to_az_el(shown.believed.q_enu_cam * ray_cam),
                sigma_rad: (sigma_px * ifov_rad)
                    .hypot(pointing_rad)
                    .hypot(SMEAR_SHARE * smear_rad),
                size_rad: size_px * ifov_rad,
                score: detection.score,
                label: detection.label,
                weak: detection.score < params.start_score,
            }
        })
        .collect()
}

/// Whether a camera at `pose` sees a direction in the pixels it read out.
fn sees(pinhole: &Pinhole, pose: &Pose, rect: PixelRect, az_el_rad: DVec2) -> bool {
    let ray_cam = pose.q_enu_cam.inverse() * az_el_to_los(az_el_rad);
    // A target whose centre is at the very edge is cut and may fairly be missed.
    const EDGE_PX: f64 = 4.0;
    pinhole.project(ray_cam).is_some_and(|px| {
        [px.x, px.y]
            .iter()
            .zip(rect.offset_px)
            .zip(rect.size_px)
            .all(|((x, low), size)| {
                *x >= f64::from(low) + EDGE_PX && *x < f64::from(low + size) - EDGE_PX
            })
    })
}

fn nearest_to_centre(shown: &Shown) -> Option<usize> {
    let centre = shown.pinhole.centre_px();
    let distance = |i: &usize| centre.distance(shown.detections[*i].aim_px.into());
    (0..shown.detections.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

fn boresight_error(shown: &Shown, index: usize, linear: bool, aim_rad: DVec2) -> BoresightError {
    let pinhole = &shown.pinhole;
    let detection = &shown.detections[index];
    // Right and up on the sky is right and, in an image whose rows run down, up against them.
    let aim_px = DVec2::new(aim_rad.x, -aim_rad.y) / pinhole.ifov_rad();
    let px = DVec2::from(detection.aim_px) + aim_px;
    let [x0, y0, x1, y1] = detection.box_px;
    // What is to be brought to the target is the laser's axis, not the image's centre.
    let reticle_px = shown.reticle_px;
    let angles = |px| {
        if linear {
            pinhole.angles_linear(px)
        } else {
            pinhole.angles(px)
        }
    };
    BoresightError {
        exposure_tick: shown.tick,
        available_tick: shown.available_tick,
        angle_rad: angles(px) - angles(reticle_px),
        offset_px: px - reticle_px,
        half_side_px: 0.5 * (x1 - x0).min(y1 - y0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::kinematics::boresight_chain;
    use glam::{DQuat, DVec3};

    #[test]
    fn a_slew_smears_and_following_does_not() {
        let pinhole = Pinhole::from_hfov(640, 480, 0.1).unwrap();
        for (rate_radps, smear_rad) in [(0.02, 0.0), (0.3, 0.3 * 4e-3), (-0.3, 0.3 * 4e-3)] {
            let mut tracker = Tracker::default();
            let zero = DVec3::ZERO;
            let level = boresight_chain(zero, zero, 0.0, 0.0, DVec2::ZERO, zero);
            let mut shown = Shown::whole(Tier::Search, pinhole, level);
            shown.exposure_s = 4e-3;
            let north = shown.believed.q_enu_cam;
            let mut found = Vec::new();
            for k in 0..3_u32 {
                let t_s = f64::from(k) / 30.0;
                shown.t_s = t_s;
                shown.believed.q_enu_cam = DQuat::from_rotation_z(rate_radps * t_s) * north;
                found.push(super::smear_rad(&mut tracker, &shown));
            }
            // The first frame has none before it.
            assert_eq!(found[0], 0.0);
            assert!(
                found[1..]
                    .iter()
                    .all(|found| (found - smear_rad).abs() < 1e-9),
                "{found:?}"
            );
        }
    }
}
