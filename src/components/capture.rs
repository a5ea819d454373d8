//! Sensor cameras and the frames they deliver.

use crate::components::mount::{Boresight, OpticalPath, Pointing};
use crate::models::ground::city::{Met, Standing};
use crate::models::maths::kinematics::Pose;
pub use crate::models::optics::camera::PixelRect;
pub use crate::models::optics::tier::Tier;

use crate::models::optics::camera::Pinhole;
use crate::models::optics::exposure::ExposureControl;
use crate::models::optics::seeing::{FrameSeeing, SeeingOptics};
pub use crate::models::optics::sensor::Conditions;
use crate::models::optics::sensor::Sensor;
use crate::models::optics::stray::lamp::LampBeam;
use crate::models::optics::stray::response::BlockingFilter;
use bevy::prelude::*;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The station that a camera belongs to.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[relationship(relationship_target = StationCameras)]
pub struct CameraOf(pub Entity);

/// The cameras of a station, in the order of the scenario.
#[derive(Component, Clone, Debug, Default)]
#[relationship_target(relationship = CameraOf)]
pub struct StationCameras(Vec<Entity>);

impl StationCameras {
    /// Their entities.
    pub fn entities(&self) -> &[Entity] {
        &self.0
    }
}

/// A sensor camera: data that never change during a run, but for the control of its exposure, which an order may.
#[derive(Component, Clone, Debug)]
pub struct SensorCamera {
    /// Its number among all cameras of the run, in the order of the scenario.
    pub index: usize,
    /// Its name, which heads its topics in a recording.
    pub name: Arc<str>,
    /// Search, coarse or precise.
    pub tier: Tier,
    /// Geometry of the full sensor.
    pub pinhole: Pinhole,
    /// Ticks between exposures.
    pub period_ticks: u64,
    /// Ticks from the instant of exposure until its detections reach the tracker.
    pub latency_ticks: u64,
    /// Noise and blur.
    pub sensor: Sensor,
    /// Turbulence before its lens; none where a scenario has none, or its blur is the sensor's.
    pub seeing: Option<Arc<SeeingOptics>>,
    /// How its exposure is set.
    pub control: ExposureControl,
    /// Side of the windowed readout [px]; `None` reads the full frame always.
    pub window_px: Option<u32>,
    /// Samples per pixel of the renderer: 1 or 4.
    pub antialias: u32,
}

/// What a camera does about the light of lasers and lamps.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct StrayOptics {
    /// The filter before the lens.
    pub filter: BlockingFilter,
    /// What keeps the station's own laser out of the exposures.
    pub gate: LaserGate,
    /// Distance of the lens from the laser's axis, to its right [m].
    pub offset_m: f64,
    /// Diameter of the lens [m].
    pub lens_m: f64,
}

/// What keeps a station's own laser out of a camera's exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LaserGate {
    /// Nothing.
    None,
    /// The laser pauses while the camera exposes.
    Pause,
    /// The camera takes no frames while the laser fires.
    Blank,
}

/// A searchlight or dazzler.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// Its beam.
    pub beam: LampBeam,
    /// Index of the UAV or distractor that carries it; `None`: it stands.
    pub on: Option<usize>,
    /// Where one that stands is [m].
    pub r_enu_m: DVec3,
    /// Index of the station that it is pointed at.
    pub at: usize,
    /// First and last instant that it shines [s].
    pub lit_s: [f64; 2],
}

/// The searchlights and dazzlers of the run, in the order of the scenario.
#[derive(Resource, Clone, Debug, Default)]
pub struct Lamps(pub Vec<Lamp>);

/// What a camera is asked to read out at its next exposures.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub enum Readout {
    /// Nothing: the camera idles.
    Off,
    /// The whole sensor.
    Full,
    /// What is around the predicted target: the window of a camera that has one, and there the
    /// detector's region.
    Around {
        /// Where the target is expected [px].
        centre_px: [f64; 2],
        /// How large it is expected to be [px].
        target_px: f64,
    },
}

/// Where a UAV is in a frame, from the truth of the very same tick.
#[derive(Clone, Debug, PartialEq)]
pub struct UavInFrame {
    /// Index of the UAV in the scenario; distractors come after all UAVs.
    pub uav: usize,
    /// Whether it is no UAV.
    pub distractor: bool,
    /// Box around the airframe's projection [px]: x0, y0, x1, y1 in full-sensor pixels.
    pub box_px: [f64; 4],
    /// Projection of the aim point [px].
    pub aim_px: [f64; 2],
    /// Distance from the camera [m].
    pub range_m: f64,
    /// Whether the line of sight to the aim point clears terrain and buildings.
    pub clear: bool,
    /// What the rendered identities say; `None` in a run that renders nothing.
    pub rendered: Option<RenderedTruth>,
}

/// Truth counted from the identity samples of a rendered frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderedTruth {
    /// Smallest box around all pixels with a sample of the UAV [px], `None` if none is visible.
    pub box_px: Option<[f64; 4]>,
    /// Centroid of the visible samples [px].
    pub centroid_px: Option<[f64; 2]>,
    /// Visible samples over samples of the unoccluded silhouette inside the frame, 0 to 1.
    pub visible_fraction: f64,
}

/// How often a camera has exposed so far.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exposures(pub u64);

/// A camera's automatic exposure. It meters the model's sky and ground in the field, not the
/// picture, so that a run without pictures is the same run.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct AutoExposure {
    /// Product of exposure time and gain [s], and the tick it was set at; none before the first
    /// exposure, which begins settled.
    pub now: Option<(f64, u64)>,
}

/// One exposure of one camera.
#[derive(Clone, Debug)]
pub struct ExposedFrame {
    /// The camera.
    pub camera: Entity,
    /// The station that it belongs to.
    pub station: Entity,
    /// Its number and name.
    pub index: usize,
    pub name: Arc<str>,
    /// Its tier.
    pub tier: Tier,
    /// Geometry of its full sensor.
    pub pinhole: Pinhole,
    /// The tick of the exposure.
    pub tick: u64,
    /// Exposures of this camera before this one.
    pub number: u64,
    /// Where the camera looked.
    pub pose: Pose,
    /// Where the station believed it to look.
    pub believed: Pose,
    /// How it is turned against the laser.
    pub boresight: Boresight,
    /// The pixels read out.
    pub rect: PixelRect,
    /// How the sensor was exposed.
    pub conditions: Conditions,
    /// The UAVs and distractors in front of the camera.
    pub truth: Vec<UavInFrame>,
    /// What the air does to the picture, of which truth knows nothing; none without turbulence before the lens.
    pub seeing: Option<Arc<FrameSeeing>>,
    /// 8-bit RGB pixels of `rect`, row by row; `None` in a run that renders nothing.
    pub rgb8: Option<Arc<Vec<u8>>>,
}

impl ExposedFrame {
    /// A full frame without content, at tick 0, of a camera that belongs to no station and looks level to the north.
    pub fn bare(tier: Tier, pinhole: Pinhole) -> Self {
        let north = Pointing::default().pose(DVec3::ZERO, OpticalPath::OnGimbal, DVec3::ZERO);
        Self {
            camera: Entity::PLACEHOLDER,
            station: Entity::PLACEHOLDER,
            index: tier as usize,
            name: tier.name().into(),
            tier,
            pinhole,
            tick: 0,
            number: 0,
            pose: north,
            believed: north,
            boresight: Boresight::default(),
            rect: PixelRect {
                offset_px: [0; 2],
                size_px: [pinhole.width_px, pinhole.height_px],
            },
            conditions: Conditions::default(),
            truth: Vec::new(),
            seeing: None,
            rgb8: None,
        }
    }

    /// Where the laser's axis is on the sensor [px], by what the station knew at the exposure.
    pub fn reticle_px(&self) -> DVec2 {
        self.boresight.reticle_px(&self.pinhole)
    }
}

/// The frames exposed in this tick, in the order of the cameras.
#[derive(Resource, Clone, Default, Debug)]
pub struct Frames(pub Vec<Arc<ExposedFrame>>);

/// What a camera sees in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// Nothing solid.
    Sky,
    /// The UAV or distractor of this index; distractors come after all UAVs.
    Flying(usize),
    /// Something of the city.
    City(Met),
}

/// How far a camera sees in each pixel of its sensor, row by row from the top, and what, at the middle of the pixel.
#[derive(Clone, Debug)]
pub struct Depth {
    /// The tick that it shows.
    pub tick: u64,
    /// Geometry of the sensor.
    pub pinhole: Pinhole,
    /// Where the camera is, and how it is turned.
    pub pose: Pose,
    /// Distance ahead, along the camera's axis [m]; infinite in the sky.
    pub planar_m: Vec<f32>,
    /// Normal of the surface, towards the camera, east, north, up, worked out from the distances beside; nothing in the sky and
    /// where all around lies on other surfaces.
    pub normals_enu: Vec<[f32; 3]>,
    /// What is seen.
    pub seen: Vec<Seen>,
}

impl Depth {
    /// Right and down [1] of a pixel's middle at a distance of 1 ahead.
    pub fn ray(pinhole: &Pinhole, x: usize, y: usize) -> DVec2 {
        let middle_px = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        (middle_px - pinhole.centre_px()) / pinhole.focal_px
    }

    /// Distance from the camera [m] of what each pixel shows; infinite in the sky.
    pub fn ranges_m(&self) -> Vec<f32> {
        let width = self.pinhole.width_px as usize;
        let range_m = |(index, planar_m): (usize, &f32)| {
            let ray = Self::ray(&self.pinhole, index % width, index / width);
            (f64::from(*planar_m) * ray.extend(1.0).length()) as f32
        };
        self.planar_m.iter().enumerate().map(range_m).collect()
    }

    /// Where what a pixel shows is [m]; none in the sky and outside the picture.
    pub fn place_enu_m(&self, x: usize, y: usize) -> Option<DVec3> {
        let width = self.pinhole.width_px as usize;
        let planar_m = self.planar_m.get(y * width + x).filter(|_| x < width)?;
        let ahead_m = Some(f64::from(*planar_m)).filter(|z_m| z_m.is_finite())?;
        let r_cam_m = Self::ray(&self.pinhole, x, y).extend(1.0) * ahead_m;
        Some(self.pose.r_enu_m + self.pose.q_enu_cam * r_cam_m)
    }
}

/// What depths are made with; each is made when it is first wanted.
#[derive(Resource, Clone, Debug, Default)]
pub struct DepthViews {
    /// The views that show them, by the number of their camera.
    pub views: BTreeMap<usize, Entity>,
    /// Where what is seen stands.
    pub standing: Option<Arc<Standing>>,
}
