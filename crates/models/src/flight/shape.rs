//! What a UAV is built from, one of our frames or triangles of its own, and its paint.

use std::sync::Arc;

use glam::DVec3;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::shape::mesh::MeshData;

/// What a UAV is built from.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A frame of ours, in the UAV's sizes.
    Frame(Frame),
    /// Triangles of its own.
    Own {
        /// All but the propellers [m, body].
        body: Arc<MeshData>,
        /// Rotor hubs, front left first, counter-clockwise seen from above [m, body].
        hubs_body_m: Vec<DVec3>,
    },
}

/// A kit of parts, built in the sizes and colours of a UAV with any number of rotors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// A rounded shell, arms that grow out of it, fixed skids.
    Phantom,
    /// A flat hull, front arms at shoulder height, rear arms folded out from below.
    Mavic,
    /// A long hull with round arms, receivers on masts, two batteries at the back, skids.
    Matrice200,
    /// A round hull with round arms, a battery between each pair, high retractable gear.
    Matrice600,
    /// Carbon plates, bare electronics, a battery strapped on top.
    Racer,
    /// A self-built frame: two plates, deep ribbed arms that end in feet.
    Ribbed,
}

impl Frame {
    /// Diagonal of the UAV whose sizes its parts have [m]; none: its parts follow the UAV's sizes.
    pub fn diagonal_m(self) -> Option<f64> {
        match self {
            Self::Phantom => Some(0.350),
            Self::Matrice200 => Some(0.643),
            Self::Matrice600 => Some(1.133),
            Self::Racer => Some(0.22),
            Self::Mavic | Self::Ribbed => None,
        }
    }
}

/// Paint of an airframe: linear RGB albedo of its parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Hull.
    pub shell: [f32; 3],
    /// Arms in front and behind.
    pub arms: [[f32; 3]; 2],
    /// Landing gear.
    pub gear: [f32; 3],
    /// Lower half of the motors.
    pub motor: [f32; 3],
    /// Propellers.
    pub blades: [f32; 3],
}
