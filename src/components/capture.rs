//! Sensor cameras and the frames they deliver.

use crate::components::mount::Pointing;
pub use crate::models::optics::camera::PixelRect;
pub use crate::models::optics::tier::Tier;

use crate::models::maths::kinematics::Pose;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::exposure::ExposureControl;
pub use crate::models::optics::sensor::Conditions;
use crate::models::optics::sensor::Sensor;
use bevy::prelude::*;
use glam::DVec2;
use std::sync::Arc;

/// A sensor camera: data that never change during a run.
#[derive(Component, Clone, Debug)]
pub struct SensorCamera {
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
    /// How its exposure is set.
    pub control: ExposureControl,
    /// Side of the windowed readout [px]; `None` reads the full frame always.
    pub window_px: Option<u32>,
    /// Samples per pixel of the renderer: 1 or 4.
    pub antialias: u32,
}

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
    /// Tier of the camera.
    pub tier: Tier,
    /// The tick of the exposure.
    pub tick: u64,
    /// Exposures of this camera before this one.
    pub number: u64,
    /// Optical pose at the exposure.
    pub pose: Pose,
    /// What the station knew of its pointing then.
    pub pointing: Pointing,
    /// The pixels read out.
    pub rect: PixelRect,
    /// How the sensor was exposed.
    pub conditions: Conditions,
    /// The UAVs and distractors in front of the camera.
    pub truth: Vec<UavInFrame>,
    /// 8-bit RGB pixels of `rect`, row by row; `None` in a run that renders nothing.
    pub rgb8: Option<Arc<Vec<u8>>>,
}

impl ExposedFrame {
    /// Where the laser's axis is on the sensor [px], by what the station knew at the exposure.
    pub fn reticle_px(&self, pinhole: &Pinhole) -> DVec2 {
        self.pointing.alignment.reticle_px(pinhole, self.tier)
    }
}

/// The frames exposed in this tick, wide to narrow.
#[derive(Resource, Default, Debug)]
pub struct Frames(pub Vec<Arc<ExposedFrame>>);
