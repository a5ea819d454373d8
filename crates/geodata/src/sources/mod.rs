//! Raw models of places: meshes, city models, height rasters, footprints, buildings, read into one form.

pub mod cityjson;
pub mod error;
pub mod footprints;
pub mod geotiff;
pub mod gltf;
pub mod ifc;
pub mod json;
mod mesh;
pub mod obj;
pub mod options;
pub mod place;
pub mod ply;
pub mod surfaces;
mod unit;
mod whole;

use boresight_common::warning::Warning;
use boresight_models::maths::geodesy::SiteFrame;
use boresight_models::shape::textured::TexturedMesh;
use serde_json::{Map, Value};

/// What the triangles of a layer are, as far as its source says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerKind {
    /// Bare ground.
    Terrain,
    /// Buildings alone.
    Buildings,
    /// Everything in one surface, as photogrammetry sees it.
    Surface,
}

/// One source, read.
#[derive(Clone, Debug)]
pub struct Layer {
    /// What its triangles are.
    pub kind: LayerKind,
    /// East, north, up about this point: the parent frame of the meshes.
    pub site: SiteFrame,
    /// Its meshes.
    pub meshes: Vec<TexturedMesh>,
    /// What is known of each feature, by feature ID (`TexturedMesh::features`).
    pub features: Vec<Map<String, Value>>,
    /// What its reader took for granted or left out; of a source of several layers the first has all.
    pub warnings: Vec<Warning>,
}
