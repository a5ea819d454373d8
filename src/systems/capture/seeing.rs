//! Turbulence before the lens: what of the air lies before each thing in a frame, and what it makes of the picture.

use super::image::{ImageScratch, STRIPS, SeeingScratch};
use crate::components::capture::{ExposedFrame, SensorCamera, UavInFrame};
use crate::components::environment::Environment;
use crate::models::maths::kinematics::Pose;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::seeing::{FrameSeeing, Look, SeenThrough, Sight};
use bevy::prelude::*;
use bevy::tasks::ComputeTaskPool;
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Farthest that the background is looked for [m]; beyond, the air is not modelled.
const FAR_M: f64 = 8_000.0;
/// Where in a frame the background's distance is looked for, of its width and height from its middle.
const PROBES: [[f64; 2]; 5] = [
    [0.0, 0.0],
    [-0.25, -0.25],
    [0.25, -0.25],
    [-0.25, 0.25],
    [0.25, 0.25],
];

/// The seeing of a frame; none of a camera whose scenario has none. `flying` has place and velocity [m, m/s, enu] by the index
/// in the truth.
pub(super) fn of_frame(
    environment: &Environment,
    camera: &SensorCamera,
    pose: &Pose,
    [t_s, exposure_s]: [f64; 2],
    truth: &[UavInFrame],
    flying: impl Fn(usize) -> Option<(DVec3, DVec3)>,
) -> Option<Arc<FrameSeeing>> {
    let optics = camera.seeing.clone()?;
    let seen = truth.iter().filter_map(|seen| {
        let (r_enu_m, v_enu_mps) = flying(seen.uav)?;
        let ahead_enu = (r_enu_m - pose.r_enu_m).normalize_or_zero();
        Some(SeenThrough {
            index: seen.uav,
            box_px: seen.box_px,
            place_px: DVec2::from(seen.aim_px),
            sight: environment.sight(pose.r_enu_m, ahead_enu, seen.range_m),
            v_enu_mps,
        })
    });
    let flying = seen.collect();
    let look = Look {
        axes_enu: [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.q_enu_cam * axis),
        t_s,
        exposure_s,
        winds_enu_mps: environment.winds(pose.r_enu_m, &optics.air),
        seen_enu_mps: DVec3::ZERO,
    };
    Some(Arc::new(FrameSeeing {
        optics,
        look,
        flying,
    }))
}

/// The air before the background of a frame: all of it is as far away as the middle one of what some rays meet.
fn behind(environment: &Environment, frame: &ExposedFrame) -> Sight {
    let pinhole = &frame.pinhole;
    let ahead_enu = |place: [f64; 2]| {
        let [x, y] = [0, 1].map(|i| {
            let size_px = f64::from(frame.rect.size_px[i]);
            f64::from(frame.rect.offset_px[i]) + (0.5 + place[i]) * size_px
        });
        frame.pose.q_enu_cam * ray(pinhole, DVec2::new(x, y))
    };
    let dsm = &environment.city.dsm;
    let hits = PROBES.iter().filter_map(|place| {
        let ahead_enu = ahead_enu(*place);
        let range_m = dsm.first_hit(frame.pose.r_enu_m, ahead_enu, FAR_M)?;
        Some((range_m, ahead_enu))
    });
    let mut hits: Vec<_> = hits.collect();
    hits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let middle = hits.get(hits.len() / 2).copied();
    let (range_m, ahead_enu) = middle.unwrap_or((FAR_M, ahead_enu(PROBES[0])));
    environment.sight(frame.pose.r_enu_m, ahead_enu, range_m.max(1.0))
}

/// The direction of a place on a sensor, in the camera's frame.
fn ray(pinhole: &Pinhole, place_px: DVec2) -> DVec3 {
    ((place_px - pinhole.centre_px()) / pinhole.focal_px)
        .extend(1.0)
        .normalize()
}

/// Warps and blurs the pixels of a rendered frame as the air does; its identities are read before.
pub(super) fn disturb(world: &World, frame: &ExposedFrame, scratch: &mut ImageScratch) {
    let Some(seeing) = &frame.seeing else {
        return;
    };
    let behind = behind(world.resource::<Environment>(), frame);
    let mut parts = seeing.parts(frame.rect, &behind);
    parts.retain(|part| part.shows());
    if parts.is_empty() {
        return;
    }
    let ImageScratch { pixels, air, .. } = scratch;
    let SeeingScratch { picture, strips } = air;
    picture.read(pixels, frame.rect);
    let [width, height] = frame.rect.size_px.map(|n| n as usize);
    let strip = height.div_ceil(STRIPS);
    ComputeTaskPool::get().scope(|scope| {
        let (picture, parts) = (&*picture, &parts[..]);
        let rows = pixels.chunks_mut(8 * width * strip).zip(strips);
        for (i, (out, scratch)) in rows.enumerate() {
            let rows = i * strip..height.min((i + 1) * strip);
            scope.spawn(async move { picture.write(parts, rows, scratch, out) });
        }
    });
}
