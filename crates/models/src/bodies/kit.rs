//! What every airframe is built from.

use crate::flight::shape::Coat;
use glam::{DVec2, DVec3};

/// What an airframe is built from.
pub(super) struct Kit<'a> {
    /// Length, width, height [m].
    pub(super) size_m: [f64; 3],
    /// Motor-to-motor diagonal [m].
    pub(super) diagonal_m: f64,
    /// Hubs in plan, in the order of the flight model's rotors [m, body].
    pub(super) hubs: &'a [DVec2],
    /// Radius of the motors [m] where nothing else reaches the published size.
    pub(super) motor_m: f64,
    /// Middle of the battery [m, body].
    pub(super) battery_body_m: DVec3,
    /// Middle of the camera [m, body].
    pub(super) camera_body_m: DVec3,
    pub(super) coat: Coat,
    /// Whether the frame's own landing gear is down.
    pub(super) lowered: bool,
}

impl Kit<'_> {
    /// The sides, left and right, on which the frame's own skids hang: both or none.
    pub(super) fn skid_sides(&self) -> &'static [f64] {
        if self.lowered { &[-1.0, 1.0] } else { &[] }
    }
}
