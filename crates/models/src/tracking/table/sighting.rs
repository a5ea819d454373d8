//! What a frame of a camera saw, as directions.

use crate::maths::kinematics::wrap_pi;
use crate::optics::tier::Tier;
use crate::tracking::evidence::EvidenceParams;
use glam::DVec2;

/// A detection as a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation on the sky [rad].
    pub sigma_rad: f64,
    /// Larger side of the box [rad].
    pub size_rad: f64,
    /// Confidence of the detector.
    pub score: f64,
    /// Index of its class among the detector's.
    pub label: u32,
    /// Whether its score falls short of the detector's threshold.
    pub weak: bool,
}

/// A direction in which a track was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighted {
    /// When [s].
    pub t_s: f64,
    /// Azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation on the sky, its flutter counted [rad].
    pub sigma_rad: f64,
}

/// What one frame of a camera saw.
pub struct CameraLook<'a> {
    /// What the camera is for.
    pub tier: Tier,
    /// Time of the exposure [s].
    pub t_s: f64,
    /// Angle of a pixel [rad].
    pub ifov_rad: f64,
    /// How what it shows is read.
    pub reads: &'a EvidenceParams,
    /// The detections.
    pub sightings: &'a [Sighting],
    /// Whether a direction (azimuth, elevation) lay in the pixels that were read out.
    pub in_view: &'a dyn Fn(DVec2) -> bool,
    /// Whether sightings that fit no track start new ones.
    pub start_tracks: bool,
}

/// Great-circle distance of two nearby directions [rad].
pub fn separation_rad(a: DVec2, b: DVec2) -> f64 {
    let d = wrap_pi(a.x - b.x) * (0.5 * (a.y + b.y)).cos();
    d.hypot(a.y - b.y)
}
