//! What a tile shows, whatever format it is stored in: b3dm, i3dm, pnts and cmpt (3D Tiles 1.0, OGC 18-053r2),
//! glTF 2.0 with its extensions (3D Tiles 1.1, OGC 22-025r4), any of them inside gzip. `docs/tile-content.md` says
//! which library reads what.

mod error;

pub use error::{ContentError, Fault};

use crate::models::shape::textured::{NO_FEATURE, PlacedMesh, PointCloud};
use serde_json::{Map, Value};
use std::sync::Arc;

/// The content of a tile, in the tile's frame [m]: z up, `RTC_CENTER` and up axis already applied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Content {
    /// Its meshes.
    pub meshes: Vec<PlacedMesh>,
    /// Its points.
    pub points: Vec<PointCloud>,
    /// What is known of each feature, by feature ID: batch tables and property tables alike.
    pub features: Vec<Map<String, Value>>,
    /// What was left out, in plain words, each once: lines, metadata of a kind that is not read, and the like.
    pub notes: Vec<String>,
}

impl Content {
    /// Number of triangles, counted once for each place that a mesh stands at.
    pub fn triangle_count(&self) -> usize {
        let placed = |placed: &PlacedMesh| placed.mesh.triangle_count() * placed.placements.len();
        self.meshes.iter().map(placed).sum()
    }

    /// Number of points.
    pub fn point_count(&self) -> usize {
        self.points.iter().map(|cloud| cloud.positions.len()).sum()
    }

    /// Takes another content in; its features follow the own ones, and its feature IDs with them.
    pub fn append(&mut self, mut other: Self) {
        let first = self.features.len() as u32;
        if first > 0 {
            let shift = |ids: &mut Vec<u32>| {
                for id in ids.iter_mut().filter(|id| **id != NO_FEATURE) {
                    *id = id.saturating_add(first);
                }
            };
            for placed in &mut other.meshes {
                shift(&mut placed.placement_features);
                if !placed.mesh.features.is_empty() {
                    shift(&mut Arc::make_mut(&mut placed.mesh).features);
                }
            }
            for cloud in &mut other.points {
                shift(&mut cloud.features);
            }
        }
        self.meshes.append(&mut other.meshes);
        self.points.append(&mut other.points);
        self.features.append(&mut other.features);
        for note in other.notes {
            self.note(note);
        }
    }

    /// Adds a note, unless it is there already.
    pub(crate) fn note(&mut self, note: impl Into<String>) {
        let note = note.into();
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }
}

/// Which axis of a glTF model points up (`asset.gltfUpAxis` of a 3D Tiles 1.0 tileset; y where it says nothing).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// x.
    X,
    /// y, as glTF has it.
    #[default]
    Y,
    /// z.
    Z,
}

/// Reads what lies at an address inside a content: a URI as the content has it, relative to it.
pub type Fetch<'f> = &'f dyn Fn(&str) -> Result<Vec<u8>, String>;

/// Decodes the bytes of a content. `up_axis` is that of its glTF models, `fetch` reads what it refers to (images,
/// buffers, models of instances, schemas of metadata); its error is passed on in words.
pub fn decode(bytes: &[u8], up_axis: UpAxis, fetch: Fetch) -> Result<Content, ContentError> {
    let _ = (bytes, up_axis, fetch);
    Err(ContentError::new(
        "content",
        Fault::Unsupported("everything is, so far".into()),
    ))
}
