//! The window's own data: pace, free camera, session, what it plays back.

use crate::components::run::PartError;
use crate::recording::timeline::Timeline;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::prelude::*;
use bevy_egui::egui;
use glam::{DQuat, DVec2, DVec3};
use std::collections::BTreeMap;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
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
    /// Frames of the window per wall-clock second lately.
    pub frames_hz: f64,
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
            frames_hz: 0.0,
        }
    }
}

/// Whether Bevy's main schedule now runs for a window frame rather than for a sensor frame, which
/// runs it too but must not see the window's input or draw its panels.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct WindowFrame {
    /// True in a window frame.
    pub active: bool,
    /// Whether the scene is still to be built.
    pub waiting: bool,
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
    /// The simulated time that it shows [s]; a playback stands there from the beginning.
    pub at_s: Option<f64>,
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
    /// Window frames drawn while the scene is still to be built; none once it stands.
    pub waiting: Option<u32>,
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

/// Something that the detector found in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Where: x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// What it is taken for.
    pub caption: String,
    /// Whether it counts only where a track awaits it.
    pub weak: bool,
}

/// A camera's picture as the window shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Time of the exposure [s].
    pub t_s: f64,
    /// Width and height [px].
    pub size_px: [u32; 2],
    /// 8-bit RGB rows.
    pub rgb8: Arc<Vec<u8>>,
    /// Whether it is but a part of the camera's sensor.
    pub part: bool,
    /// What the detector found in it, the weakest first.
    pub found: Vec<Found>,
    /// Where the boresight is [px].
    pub reticle_px: Option<[f64; 2]>,
    /// The tracking state then.
    pub state: String,
}

/// A camera beside the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraShown {
    /// Its name.
    pub name: String,
    /// What else stands above its picture.
    pub note: String,
    /// Its last picture.
    pub picture: Option<Picture>,
}

/// The cameras beside the scene: a column for the run, or for each recording that is played back.
#[derive(Resource, Clone, Debug, Default)]
pub struct Pictures(pub Vec<Vec<CameraShown>>);

/// A picture on the GPU.
#[derive(Clone, Debug)]
pub struct Uploaded {
    /// Time of the exposure it shows [s].
    pub t_s: f64,
    /// The image, the same for all pictures of a camera.
    pub image: Handle<Image>,
    /// Its name in egui.
    pub texture: egui::TextureId,
}

/// Whether the pictures are marked with what the detector found below its threshold, too.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct ShowWeak(pub bool);

/// The pictures of [`Pictures`] on the GPU, by column and camera.
#[derive(Resource, Clone, Debug, Default)]
pub struct Insets(pub BTreeMap<(usize, String), Uploaded>);

/// Where a station believes its target to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The station [m].
    pub r_station_enu_m: DVec3,
    /// Azimuth and elevation of the target [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation of its direction, the larger of both [rad].
    pub sigma_rad: f64,
    /// Its range [m], if it is known.
    pub range_m: Option<f64>,
    /// Number of the recording that it is from.
    pub source: usize,
}

/// What all stations believe.
#[derive(Resource, Clone, Debug, Default)]
pub struct Estimates(pub Vec<Estimate>);

/// How far a step of a playback goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlayStep {
    /// One tick.
    Tick,
    /// To the next picture of any camera, or state where there is none.
    Frame,
    /// To the next entry of the log, or change of a laser.
    Event,
    /// To the end.
    End,
}

/// A line of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveLine {
    /// Whose it is: a camera's, a station's.
    pub name: String,
    /// Number of the recording.
    pub source: usize,
    /// Its number among those of its recording in the plot, by which it is coloured.
    pub number: usize,
    /// Time [s] and value.
    pub points: Vec<[f64; 2]>,
    /// Whether the user wants it.
    pub shown: bool,
}

/// A figure over time, from each recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// What it is, with its unit.
    pub title: &'static str,
    /// Whether its scale is logarithmic.
    pub logarithmic: bool,
    /// Its lines, recording after recording.
    pub lines: Vec<CurveLine>,
    /// Least and greatest value of all lines.
    pub range: [f64; 2],
}

impl Curve {
    /// Whether the user wants any of its lines.
    pub fn shown(&self) -> bool {
        self.lines.iter().any(|line| line.shown)
    }
}

/// Recordings that are played back: no tick runs, and what was recorded takes the places of UAVs, cameras and
/// lasers. The first fills the scene, a second is marked in it.
#[derive(Resource, Clone, Debug)]
pub struct Playback {
    /// One or two recordings.
    pub timelines: Vec<Timeline>,
    /// The time shown [s].
    pub t_s: f64,
    /// Whether time runs backwards.
    pub backwards: bool,
    /// A step that was asked for, forwards or back.
    pub step: Option<(PlayStep, bool)>,
    /// The part of the run that the time line shows: from, to [s].
    pub span_s: [f64; 2],
    /// Times of events in the order of time [s].
    pub events_s: Vec<f64>,
    /// Figures over time.
    pub curves: Vec<Curve>,
}

impl Playback {
    /// Time of the last tick of all [s].
    pub fn end_s(&self) -> f64 {
        let ends = self.timelines.iter().map(|t| t.t_s(t.last_tick));
        ends.fold(0.0, f64::max)
    }
}

/// From where the window looks at the scene.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub enum Sight {
    /// From wherever the user has flown.
    #[default]
    Free,
    /// From beside a UAV or distractor, by its scenario index.
    Chase {
        /// Whom.
        uav: usize,
        /// From how far [m].
        distance_m: f64,
    },
    /// As a camera of a station looks, by the camera's number.
    Camera(usize),
}

/// The station whose orders and panel are shown, by its number.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChosenStation(pub usize);

/// A row of the list of tracks.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackRow {
    /// What it says of the track.
    pub text: String,
    /// For how long the track has been gone [s of the wall clock].
    pub ended_s: Option<f64>,
}

/// The lists of tracks.
#[derive(Resource, Clone, Debug, Default)]
pub struct TrackRows {
    /// Rows by station and by the track's identity.
    pub lists: BTreeMap<usize, BTreeMap<u32, TrackRow>>,
    /// Whether the pointer is over the list that is shown.
    pub pointed_at: bool,
}

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
