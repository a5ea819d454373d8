//! What a tile shows, whatever format it is stored in.

use crate::models::shape::textured::{PlacedMesh, PointCloud};
use serde_json::{Map, Value};

/// The content of a tile, in the tile's frame [m]: z up, `RTC_CENTER` and up axis already applied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Content {
    /// Its meshes.
    pub meshes: Vec<PlacedMesh>,
    /// Its points.
    pub points: Vec<PointCloud>,
    /// What is known of each feature, by feature ID: batch tables and property tables alike.
    pub features: Vec<Map<String, Value>>,
}
