//! A content as the rest of the program sees it, and what its readers share.

use crate::tiles::content::error::{ContentError, Fault};
use boresight_models::shape::textured::{NO_FEATURE, PlacedMesh, PointCloud, UpAxis};
use glam::DAffine3;
use serde_json::{Map, Value};
use std::cell::Cell;
use std::sync::Arc;

/// Most bytes that a content may decode to, pictures and files that it refers to included [byte].
pub(crate) const MAX_DECODED: u64 = 1 << 29;

/// What is known of each feature, by name of the property.
pub type Rows = Vec<Map<String, Value>>;

/// The content of a tile, in the tile's frame [m]: z up, `RTC_CENTER` and up axis already applied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Content {
    /// Its meshes.
    pub meshes: Vec<PlacedMesh>,
    /// Its points.
    pub points: Vec<PointCloud>,
    /// What is known of each feature, by feature ID: batch tables and property tables alike.
    pub features: Rows,
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

/// Reads what lies at an address inside a content: a URI as the content has it, relative to it.
pub type Fetch<'f> = &'f dyn Fn(&str) -> Result<Vec<u8>, String>;

/// What the readers of a content share.
pub(crate) struct Context<'f> {
    /// The up axis of glTF models.
    pub up_axis: UpAxis,
    /// Reads what the content refers to.
    pub fetch: Fetch<'f>,
    /// What was decoded so far [byte].
    spent: Cell<u64>,
}

impl<'f> Context<'f> {
    /// Nothing decoded so far.
    pub fn new(up_axis: UpAxis, fetch: Fetch<'f>) -> Self {
        let spent = Cell::new(0);
        Self {
            up_axis,
            fetch,
            spent,
        }
    }

    /// Counts bytes that are about to be decoded; an error where they are too many.
    pub fn spend(&self, bytes: usize, place: &str) -> Result<(), ContentError> {
        let amount = self.spent.get().saturating_add(bytes as u64);
        if amount > MAX_DECODED {
            let (what, limit) = ("bytes", MAX_DECODED);
            let fault = Fault::TooLarge {
                what,
                amount,
                limit,
            };
            return Err(ContentError::new(place, fault));
        }
        self.spent.set(amount);
        Ok(())
    }

    /// What may still be decoded [byte].
    pub fn left(&self) -> u64 {
        MAX_DECODED - self.spent.get()
    }

    /// Decodes what lies beside another file: `fetch` reads what that refers to, and what it decodes counts here.
    pub fn beside<T>(&self, fetch: Fetch, decode: impl FnOnce(&Context) -> T) -> T {
        let inner = Context {
            up_axis: self.up_axis,
            fetch,
            spent: Cell::new(self.spent.get()),
        };
        let found = decode(&inner);
        self.spent.set(inner.spent.get());
        found
    }

    /// A file that the content refers to.
    pub fn read(&self, uri: &str, place: &str) -> Result<Vec<u8>, ContentError> {
        let missing = |why| {
            let uri = uri.to_owned();
            ContentError::new(place, Fault::Missing { uri, why })
        };
        let found = (self.fetch)(uri).map_err(missing)?;
        self.spend(found.len(), place)?;
        Ok(found)
    }
}

/// The rotation that takes a glTF model whose up axis is given into a frame with z up (as 3D Tiles 1.0 and its
/// implementations have it: about x for y up, about y for x up).
pub(crate) fn up(axis: UpAxis) -> DAffine3 {
    DAffine3::from_mat3(axis.to_z())
}

/// Linear light of an sRGB value of 0..1 (IEC 61966-2-1).
pub(crate) fn linear(srgb: f64) -> f32 {
    if srgb <= 0.04045 {
        (srgb / 12.92) as f32
    } else {
        ((srgb + 0.055) / 1.055).powf(2.4) as f32
    }
}
