//! Triangle meshes with textures: what real cities are made of, read from tiles or from raw models.

use glam::{DAffine3, DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A picture on a surface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Texture {
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// Red, green, blue (sRGB) and alpha of each pixel, row by row from the top.
    pub rgba: Vec<u8>,
}

/// How the surface of a [`TexturedMesh`] looks.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Linear RGB albedo and alpha, multiplied with the texture and with the vertices' colours.
    pub base_color: [f32; 4],
    /// The picture on it.
    pub texture: Option<Arc<Texture>>,
    /// Whether the picture repeats outside 0..1; otherwise its border continues.
    pub repeats: bool,
    /// Whether the light is baked into the colours, so that no sun shall shine on it again.
    pub unlit: bool,
    /// Whether both sides are seen.
    pub double_sided: bool,
    /// Pixels below this alpha are holes; `None`: none are.
    pub alpha_cutoff: Option<f32>,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            base_color: [1.0; 4],
            texture: None,
            repeats: true,
            unlit: false,
            double_sided: false,
            alpha_cutoff: None,
        }
    }
}

/// How a tileset's surfaces are lit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TilesLight {
    /// As its files say: unlit materials have their light baked in, others are lit.
    #[default]
    AsStored,
    /// All of it as a photograph with its light baked in.
    Baked,
    /// All of it lit anew by sun and sky.
    Relit,
}

/// The axis of a mesh's file that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// x.
    X,
    /// y, as glTF, modellers and game engines have it: x to the right, z towards the viewer.
    #[default]
    Y,
    /// z, as surveys have it: x east, y north.
    Z,
}

impl UpAxis {
    /// Its letter.
    pub fn letter(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }

    /// The rotation that makes it z.
    pub fn to_z(self) -> DMat3 {
        match self {
            Self::X => DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::NEG_X),
            Self::Y => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            Self::Z => DMat3::IDENTITY,
        }
    }
}

impl std::str::FromStr for UpAxis {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let all = [Self::X, Self::Y, Self::Z].into_iter();
        let found = all
            .into_iter()
            .find(|axis| axis.letter().eq_ignore_ascii_case(text));
        found.ok_or("expected x, y or z")
    }
}

/// An indexed triangle mesh of one look; triangles wind counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TexturedMesh {
    /// Where the local frame's origin lies in the parent frame [m]; the axes are parallel.
    pub origin_m: DVec3,
    /// Vertices about the origin [m].
    pub positions: Vec<[f32; 3]>,
    /// Unit outward normals; empty: those of the triangles.
    pub normals: Vec<[f32; 3]>,
    /// Place in the texture, (0, 0) at its top left; empty where there is no texture.
    pub uv: Vec<[f32; 2]>,
    /// Linear RGB albedo and alpha of each vertex; empty: all one.
    pub colors: Vec<[f32; 4]>,
    /// Which feature of the content's table (a building, a tree) each vertex belongs to, or [`NO_FEATURE`]; empty: none.
    pub features: Vec<u32>,
    /// Three per triangle.
    pub indices: Vec<u32>,
    /// How it looks.
    pub look: Look,
}

impl TexturedMesh {
    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// A vertex in the parent frame [m].
    pub fn vertex_m(&self, index: u32) -> DVec3 {
        let [x, y, z] = self.positions[index as usize];
        self.origin_m + DVec3::new(x.into(), y.into(), z.into())
    }
}

/// Points of one size on the screen, as scanners measure them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Where the local frame's origin lies in the parent frame [m]; the axes are parallel.
    pub origin_m: DVec3,
    /// Points about the origin [m].
    pub positions: Vec<[f32; 3]>,
    /// Linear RGB albedo and alpha of each point; empty: all one.
    pub colors: Vec<[f32; 4]>,
    /// Unit normals; empty: unknown.
    pub normals: Vec<[f32; 3]>,
    /// Which feature of the content's table each point belongs to; empty: none.
    pub features: Vec<u32>,
}

/// A mesh and every place that it stands at.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedMesh {
    /// The mesh in its own frame.
    pub mesh: Arc<TexturedMesh>,
    /// From the mesh's parent frame to the content's: one for a mesh that stands once, many for instances.
    /// No placement mirrors (all determinants are positive).
    pub placements: Vec<DAffine3>,
    /// Which feature of the content's table each placement is, where instances are features; empty: none.
    /// It goes before the mesh's own [`TexturedMesh::features`].
    pub placement_features: Vec<u32>,
}

/// The feature ID of what belongs to no feature.
pub const NO_FEATURE: u32 = u32::MAX;
