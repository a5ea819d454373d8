//! Features of a glTF file: property tables as rows, and IDs of vertices and instances as numbers of rows
//! (`EXT_structural_metadata`, `EXT_mesh_features`, `EXT_instance_features`; `_BATCHID` of a b3dm).

use super::document::{Document, extension};
use super::schema::{FeatureIds, MeshFeatures};
use crate::tiles::content::bytes::json;
use crate::tiles::content::error::ContentError;
use crate::tiles::content::metadata::{PropertyTable, Schema};
use crate::tiles::content::model::Rows;
use boresight_models::shape::textured::NO_FEATURE;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// The rows of a content, those of its batch table first.
pub(crate) struct Features {
    /// What is known of each feature.
    pub rows: Rows,
    /// How many of them are the batch table's.
    batch: usize,
    /// First row and number of rows of each property table.
    tables: Vec<(usize, usize)>,
}

/// A set of feature IDs that a mesh or an instanced node brings.
pub(crate) enum Ids {
    /// None that is read.
    None,
    /// Rows of the batch table, in this attribute.
    Batch,
    /// A set of `EXT_mesh_features` or `EXT_instance_features`.
    Set(FeatureIds),
}

impl Features {
    /// Reads all property tables of a file.
    pub fn new(document: &Document, batch: Rows) -> Result<(Self, Vec<String>), ContentError> {
        const NAME: &str = "EXT_structural_metadata";
        let mut found = Self {
            batch: batch.len(),
            rows: batch,
            tables: Vec::new(),
        };
        let mut notes = Vec::new();
        let extensions = &document.root.extensions;
        if document
            .root
            .extensions_used
            .iter()
            .any(|name| name == "EXT_feature_metadata")
        {
            notes.push(
                "EXT_feature_metadata, which EXT_structural_metadata replaced, is left out".into(),
            );
        }
        let Some(own) = extensions.get(NAME) else {
            return Ok((found, notes));
        };
        for left_out in ["propertyTextures", "propertyAttributes"] {
            if own.get(left_out).is_some() {
                notes.push(format!("{NAME}: {left_out} are left out"));
            }
        }
        #[derive(serde::Deserialize, Default)]
        #[serde(default, rename_all = "camelCase")]
        struct Own {
            schema: Option<Schema>,
            schema_uri: Option<String>,
            property_tables: Vec<PropertyTable>,
        }
        let own: Own = extension(extensions, NAME, "glTF")?.unwrap_or_default();
        if own.property_tables.is_empty() {
            return Ok((found, notes));
        }
        let schema = match (own.schema, &own.schema_uri) {
            (Some(schema), _) => schema,
            (None, Some(uri)) => json(&document.read(uri, "schema")?, "schema")?,
            _ => return Err(ContentError::damaged(NAME, "its tables have no schema")),
        };
        for (index, table) in own.property_tables.iter().enumerate() {
            let place = format!("property table {index}");
            document.spend(table.size(), &place)?;
            let view = |view: usize, place: &str| document.view(view, place);
            let rows = table.rows(&schema, &view, &place)?;
            found.tables.push((found.rows.len(), rows.len()));
            found.rows.extend(rows);
        }
        Ok((found, notes))
    }

    /// Which set of IDs counts: the first that names a property table, or else the first. What comes by a texture
    /// has a different ID at every pixel, and is left out with a note.
    pub fn choose(
        &self,
        extensions: &Map<String, Value>,
        name: &str,
        batch_ids: bool,
        place: &str,
    ) -> Result<(Ids, Option<&'static str>), ContentError> {
        let sets: MeshFeatures = extension(extensions, name, place)?.unwrap_or_default();
        let textures = sets.feature_ids.iter().any(|set| set.texture.is_some());
        let note = textures.then_some("feature IDs in textures are left out");
        let mut sets = sets
            .feature_ids
            .into_iter()
            .filter(|set| set.texture.is_none());
        let first = sets.next();
        let chosen = match first {
            Some(first) if first.property_table.is_none() => Some(
                sets.find(|set| set.property_table.is_some())
                    .unwrap_or(first),
            ),
            other => other,
        };
        let ids = match chosen {
            Some(set) => Ids::Set(set),
            None if batch_ids && self.batch > 0 => Ids::Batch,
            None => Ids::None,
        };
        Ok((ids, note))
    }

    /// Turns IDs of a batch table into rows.
    pub fn of_batch(&self, ids: Vec<u32>) -> Vec<u32> {
        let row = |id: u32| {
            if (id as usize) < self.batch {
                id
            } else {
                NO_FEATURE
            }
        };
        ids.into_iter().map(row).collect()
    }

    /// Turns IDs of a set into rows. A set without a property table gets a row for each ID that occurs.
    pub fn of_set(
        &mut self,
        set: &FeatureIds,
        ids: Vec<u32>,
        place: &str,
    ) -> Result<Vec<u32>, ContentError> {
        let named = |id: &u32| Some(*id) != set.null_feature_id;
        let Some(table) = set.property_table else {
            let mut rows: BTreeMap<u32, u32> = ids
                .iter()
                .filter(|id| named(id))
                .map(|id| (*id, 0))
                .collect();
            for (id, row) in &mut rows {
                *row = self.rows.len() as u32;
                self.rows
                    .push(Map::from_iter([("featureId".to_owned(), Value::from(*id))]));
            }
            let row = |id: u32| rows.get(&id).copied().unwrap_or(NO_FEATURE);
            return Ok(ids.into_iter().map(row).collect());
        };
        let absent = || ContentError::damaged(place, format!("there is no property table {table}"));
        let (first, count) = *self.tables.get(table).ok_or_else(absent)?;
        let row = |id: u32| match named(&id) && (id as usize) < count {
            true => (first + id as usize) as u32,
            false => NO_FEATURE,
        };
        Ok(ids.into_iter().map(row).collect())
    }
}
