//! The window's own data: pace, free camera, session.

use crate::components::run::PartError;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::prelude::*;
use bevy_egui::egui;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// How far a single step goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepSize {
    /// One tick.
    Tick,
    /// To the next exposure of any camera.
    Frame,
}

/// The pace of the simulation: how many ticks a window frame runs, and nothing else.
#[derive(Resource, Clone, Debug)]
pub struct Pacing {
    /// Whether simulated time stands still.
    pub paused: bool,
    /// Simulated seconds per wall-clock second; infinite runs as many ticks as fit.
    pub speed: f64,
    /// A single step that was asked for.
    pub step: Option<StepSize>,
    /// Ticks that are due but have not run; below one between window frames.
    pub owed_ticks: f64,
    /// Tick at which the pace pauses by itself.
    pub pause_at: Option<u64>,
    /// Whether the run has come to its end.
    pub over: bool,
    /// Simulated seconds per wall-clock second as reached lately.
    pub reached: f64,
}

impl Default for Pacing {
    fn default() -> Self {
        Self {
            paused: false,
            speed: 1.0,
            step: None,
            owed_ticks: 0.0,
            pause_at: None,
            over: false,
            reached: 0.0,
        }
    }
}

/// Whether Bevy's main schedule now runs for a window frame rather than for a sensor frame, which
/// runs it too but must not see the window's input or draw its panels.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct WindowFrame {
    /// True in a window frame.
    pub active: bool,
    /// Wall-clock time since the last window frame [s].
    pub wall_s: f64,
}

/// The schedule of one window frame.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct DrawAndTick;

/// A picture of the window to be taken.
#[derive(Clone, Debug)]
pub struct ScreenshotRequest {
    /// Where it goes.
    pub file: PathBuf,
    /// Window frames drawn since its time came.
    pub drawn: u32,
}

/// What a window session keeps between its frames.
#[derive(Resource)]
pub struct Session {
    /// When it began.
    pub started: Instant,
    /// When the last window frame began.
    pub last: Instant,
    /// Wall-clock and simulated time of the last window frames [s].
    pub lately: VecDeque<(f64, f64)>,
    /// A screenshot that was asked for.
    pub screenshot: Option<ScreenshotRequest>,
    /// Called once with how the session ended and how long it took, before winit clears the world.
    pub ended: Option<SessionEnd>,
}

/// See [`Session::ended`].
pub type SessionEnd = Box<dyn FnOnce(&mut World, Result<(), PartError>, Duration) + Send + Sync>;

/// The picture that Bevy took of the window.
#[derive(Resource)]
pub struct Taken(pub Image);

/// A camera picture on the GPU.
#[derive(Clone, Debug)]
pub struct Uploaded {
    /// Time of the exposure it shows [s].
    pub t_s: f64,
    /// The image, the same for all pictures of a camera.
    pub image: Handle<Image>,
    /// Its name in egui.
    pub texture: egui::TextureId,
}

/// The pictures of the insets, by the cameras' numbers.
#[derive(Resource, Clone, Debug, Default)]
pub struct Insets(pub BTreeMap<usize, Uploaded>);

/// Marks the window's camera.
#[derive(Component)]
pub struct WindowCamera;

/// The free camera.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct FreeCamera {
    /// Position [m].
    pub r_enu_m: DVec3,
    /// Azimuth of the view, clockwise from north [rad].
    pub azimuth_rad: f64,
    /// Elevation of the view [rad].
    pub elevation_rad: f64,
    /// Vertical field of view [rad].
    pub vfov_rad: f64,
}

impl FreeCamera {
    /// Attitude of the optical frame (x right, y down, z forward) in ENU.
    pub fn q_enu_cam(&self) -> DQuat {
        // At zero angles the view looks north: right is east, down is down.
        let north = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        DQuat::from_rotation_z(-self.azimuth_rad)
            * DQuat::from_rotation_x(self.elevation_rad)
            * north
    }

    /// A point in the optical frame [m].
    pub fn to_cam(&self, r_enu_m: DVec3) -> DVec3 {
        self.q_enu_cam().inverse() * (r_enu_m - self.r_enu_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_free_camera_looks_along_its_angles() {
        let camera = FreeCamera {
            r_enu_m: DVec3::new(10.0, 20.0, 30.0),
            azimuth_rad: 315f64.to_radians(),
            elevation_rad: 0.3,
            vfov_rad: 0.9,
        };
        let los = crate::models::maths::kinematics::az_el_to_los(glam::DVec2::new(
            camera.azimuth_rad,
            0.3,
        ));
        let ahead = camera.to_cam(camera.r_enu_m + 50.0 * los);
        assert!(
            (ahead - DVec3::new(0.0, 0.0, 50.0)).length() < 1e-9,
            "{ahead}"
        );
        // North-west is ahead, so north-east lies to the right, and up is minus y.
        let right = camera.to_cam(camera.r_enu_m + DVec3::new(1.0, 1.0, 0.0));
        assert!(right.x > 1.4 && right.y.abs() < 1e-9, "{right}");
        assert!(camera.to_cam(camera.r_enu_m + DVec3::Z).y < 0.0);
    }
}
