//! Marks over the window's picture: the station, the UAVs and the beam.

use super::style::{GREEN, GREY, RED, rimmed, source_colour, status_colour};
use crate::components::beam::BeamState;
use crate::components::flight::{Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Mount, Station};
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::components::view::{Estimate, Estimates, FreeCamera, Playback};
use crate::models::maths::kinematics::az_el_to_los;
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

/// A skin from which its temperature is written beside the UAV [K].
const HOT_K: f64 = 330.0;
/// A target's distance along its direction where its range is not known [m].
const FAR_M: f64 = 1_000.0;

/// Takes over where the stations of the run believe their targets.
pub fn look_at_tracks(
    clock: Res<SimClock>,
    stations: Query<(&Mount, &Tracker)>,
    mut estimates: ResMut<Estimates>,
) {
    let believed = stations.iter().filter_map(|(mount, tracker)| {
        let los = tracker.target_track()?.filter.predicted(clock.t_s());
        let [azimuth, elevation] = &los.covariance;
        Some(Estimate {
            r_station_enu_m: mount.r_enu_m,
            az_el_rad: los.az_el_rad(),
            sigma_rad: azimuth[(0, 0)].max(elevation[(0, 0)]).sqrt(),
            range_m: tracker.range_m,
            source: 0,
        })
    });
    estimates.0 = believed.collect();
}

/// Circles of three standard deviations where the targets are believed.
fn draw_estimates(
    painter: &egui::Painter,
    screen: &Screen,
    camera: &FreeCamera,
    estimates: &[Estimate],
) {
    const LEAST_RADIUS: f32 = 5.0;
    for estimate in estimates {
        let range_m = estimate.range_m.unwrap_or(FAR_M);
        let r_enu_m = estimate.r_station_enu_m + range_m * az_el_to_los(estimate.az_el_rad);
        let r_cam_m = camera.to_cam(r_enu_m);
        if let Some(at) = screen.at(r_cam_m) {
            let spread_m = 3.0 * estimate.sigma_rad * range_m;
            let radius = (screen.focal * spread_m / r_cam_m.z) as f32;
            let colour = source_colour(estimate.source);
            let stroke = Stroke::new(1.2, colour);
            painter.circle_stroke(at, radius.max(LEAST_RADIUS), stroke);
        }
    }
}

/// Marks what flies in a second recording, and its beams.
fn draw_second(painter: &egui::Painter, screen: &Screen, camera: &FreeCamera, playback: &Playback) {
    for (source, timeline) in playback.timelines.iter().enumerate().skip(1) {
        let tick = timeline.tick_at(playback.t_s);
        let colour = source_colour(source);
        for (name, series) in &timeline.uavs {
            let Some(uav) = series.at(tick) else {
                continue;
            };
            let r_cam_m = camera.to_cam(uav.r_enu_m);
            for station in timeline.stations.iter().filter(|s| s.fires(tick)) {
                let aims = (station.track.at(tick)).is_some_and(|track| track.target == *name);
                let from = timeline.r_enu_m(station).filter(|_| aims);
                if let Some(line) = from.and_then(|r| screen.line(camera.to_cam(r), r_cam_m)) {
                    painter.line_segment(line, Stroke::new(1.5, colour));
                }
            }
            if let Some(at) = screen.at(r_cam_m) {
                let half = vec2(7.0, 7.0);
                let square = Rect::from_min_max(at - half, at + half);
                let stroke = Stroke::new(1.5, colour);
                painter.rect_stroke(square, 0.0, stroke, egui::StrokeKind::Middle);
                let below = at + vec2(0.0, 10.0);
                let text = format!("{name}  {}", uav.status);
                rimmed(painter, below, Align2::CENTER_TOP, &text, colour);
            }
        }
    }
}

/// What flies, as it is marked.
type Marked = (
    &'static Uav,
    &'static Flight,
    &'static UavStatus,
    Option<&'static Distractor>,
    Option<&'static HeatedSkin>,
);

/// Marks the station, the UAVs and the beam.
pub fn draw_overlay(
    mut contexts: EguiContexts,
    camera: Res<FreeCamera>,
    estimates: Res<Estimates>,
    playback: Option<Res<Playback>>,
    stations: Query<(&Station, &Mount, &BeamState)>,
    uavs: Query<Marked>,
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
    for (uav, flight, status, distractor, skin) in &uavs {
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
        let mut text = format!("{}  {range_m:.0} m  {word}", uav.name);
        let skin_k = skin.map_or(0.0, |skin| skin.temperature_k);
        if skin_k > HOT_K {
            text += &format!("  {:.0} °C", skin_k - 273.15);
        }
        rimmed(
            &painter,
            at + vec2(0.0, -17.0),
            Align2::CENTER_BOTTOM,
            &text,
            colour,
        );
    }
    draw_estimates(&painter, &screen, &camera, &estimates.0);
    if let Some(playback) = &playback {
        draw_second(&painter, &screen, &camera, playback);
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
