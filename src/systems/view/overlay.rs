//! Marks over the window's picture: the station, the UAVs and the beam.

use super::style::{GREEN, GREY, RED, rimmed, status_colour};
use crate::components::beam::BeamState;
use crate::components::flight::{Distractor, Flight, Uav, UavStatus};
use crate::components::mount::{Mount, Station};
use crate::components::view::FreeCamera;
use bevy::prelude::*;
use bevy_egui::EguiContexts;
use bevy_egui::egui::{self, Align2, Color32, Pos2, Rect, Stroke, vec2};
use glam::DVec3;

/// Where points of the optical frame lie on the screen.
struct Screen {
    centre: Pos2,
    /// Focal length [points].
    focal: f64,
}

impl Screen {
    /// Nearest distance that is drawn [m].
    const NEAR_M: f64 = 0.5;

    fn new(rect: Rect, camera: &FreeCamera) -> Self {
        let focal = 0.5 * f64::from(rect.height()) / (0.5 * camera.vfov_rad).tan();
        Self {
            centre: rect.center(),
            focal,
        }
    }

    fn at(&self, r_cam_m: DVec3) -> Option<Pos2> {
        (r_cam_m.z >= Self::NEAR_M).then(|| {
            let [x, y] = [r_cam_m.x, r_cam_m.y].map(|x| (self.focal * x / r_cam_m.z) as f32);
            self.centre + vec2(x, y)
        })
    }

    /// The part of a line in front of the camera.
    fn line(&self, a_cam_m: DVec3, b_cam_m: DVec3) -> Option<[Pos2; 2]> {
        let clipped = |a: DVec3, b: DVec3| {
            let share = (Self::NEAR_M - a.z) / (b.z - a.z);
            // The clipped end must not fall short of the near distance by rounding.
            if a.z < Self::NEAR_M {
                a.lerp(b, share).with_z(Self::NEAR_M)
            } else {
                a
            }
        };
        if a_cam_m.z < Self::NEAR_M && b_cam_m.z < Self::NEAR_M {
            return None;
        }
        Some([
            self.at(clipped(a_cam_m, b_cam_m))?,
            self.at(clipped(b_cam_m, a_cam_m))?,
        ])
    }
}

/// Marks the station, the UAVs and the beam.
pub fn draw_overlay(
    mut contexts: EguiContexts,
    camera: Res<FreeCamera>,
    stations: Query<(&Station, &Mount, &BeamState)>,
    uavs: Query<(&Uav, &Flight, &UavStatus, Option<&Distractor>)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let painter = ctx.layer_painter(egui::LayerId::background());
    let screen = Screen::new(ctx.viewport_rect(), &camera);
    for (station, mount, _) in &stations {
        if let Some(at) = screen.at(camera.to_cam(mount.r_enu_m)) {
            painter.circle_filled(at, 3.5, GREEN);
            let below = at + vec2(0.0, 8.0);
            rimmed(&painter, below, Align2::CENTER_TOP, &station.name, GREEN);
        }
    }
    let first = stations.iter().next().map(|(_, mount, _)| mount.r_enu_m);
    for (uav, flight, status, distractor) in &uavs {
        let r_cam_m = camera.to_cam(flight.state.r_enu_m);
        for (_, mount, beam) in &stations {
            if beam.firing
                && beam.aimed == Some(uav.index)
                && let Some(line) = screen.line(camera.to_cam(mount.r_enu_m), r_cam_m)
            {
                painter.line_segment(line, Stroke::new(4.0, RED.gamma_multiply(0.35)));
                painter.line_segment(line, Stroke::new(1.5, RED));
            }
        }
        let Some(at) = screen.at(r_cam_m) else {
            continue;
        };
        let (colour, word) = match distractor {
            Some(distractor) => (GREY, distractor.kind.name()),
            None => (status_colour(*status), status.name()),
        };
        painter.circle_stroke(at, 12.0, Stroke::new(3.5, Color32::from_black_alpha(110)));
        painter.circle_stroke(at, 12.0, Stroke::new(1.8, colour));
        let range_m = first.map_or(0.0, |first| flight.state.r_enu_m.distance(first));
        let text = format!("{}  {range_m:.0} m  {word}", uav.name);
        rimmed(
            &painter,
            at + vec2(0.0, -17.0),
            Align2::CENTER_BOTTOM,
            &text,
            colour,
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_passes_the_camera_is_cut_at_it() {
        let screen = Screen {
            centre: Pos2::new(500.0, 400.0),
            focal: 1_000.0,
        };
        let behind = DVec3::new(0.0, 1.0, -10.0);
        let ahead = DVec3::new(0.0, 0.0, 100.0);
        let Some([a, b]) = screen.line(behind, ahead) else {
            panic!("half of it is in front")
        };
        assert_eq!(b, screen.centre);
        assert!(a.y > 400.0);
        assert!(screen.line(behind, behind).is_none());
    }
}
