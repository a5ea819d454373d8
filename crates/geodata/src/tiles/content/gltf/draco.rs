//! Meshes that Draco compressed (`KHR_draco_mesh_compression`).

use super::document::{Document, finite, floats};
use super::schema::Accessor;
use crate::tiles::content::draco::{Attribute, Points, absent, mesh};
use crate::tiles::content::error::ContentError;

/// A decoded mesh.
pub(crate) struct Mesh {
    /// Its corners, three a triangle.
    pub indices: Vec<u32>,
    /// Its points.
    pub points: Points,
}

impl Mesh {
    /// Decodes a mesh.
    pub fn new(document: &Document, data: &[u8], place: &str) -> Result<Self, ContentError> {
        let (indices, points) = mesh(data, document.context(), place)?;
        Ok(Self { indices, points })
    }

    fn attribute(&self, id: usize, place: &str) -> Result<&Attribute, ContentError> {
        let found = self.points.attributes.get(&id);
        found.ok_or_else(|| absent(id, place))
    }

    /// `N` numbers a point; what an attribute lacks is `fill`.
    pub fn floats<const N: usize>(
        &self,
        id: usize,
        accessor: &Accessor,
        fill: [f32; N],
        place: &str,
    ) -> Result<Vec<[f32; N]>, ContentError> {
        let attribute = self.attribute(id, place)?;
        let kind = attribute.kind;
        let unit = if accessor.normalized {
            kind.unit()
        } else {
            1.0
        };
        let values = attribute.points();
        let found: Vec<_> = values
            .map(|bytes| floats(kind, unit, bytes, fill))
            .collect();
        finite(&found, place)?;
        Ok(found)
    }

    /// One whole number a point.
    pub fn whole(&self, id: usize, place: &str) -> Result<Vec<u32>, ContentError> {
        let attribute = self.attribute(id, place)?;
        let values = attribute.points().map(|bytes| attribute.kind.whole(bytes));
        let found: Option<Vec<u32>> = values.collect();
        found.ok_or_else(|| ContentError::damaged(place, "not all of it are whole numbers"))
    }
}
