//! What is known of an IFC product beside its shape.

use super::model::Model;
use ifc_lite_core::{DecodedEntity, IfcType};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};

/// Deepest tree of rooms, storeys and assemblies that is followed.
const DEEPEST: usize = 32;

/// What each object is a part of or stands in, and the objects that others are parts of.
pub fn parents(model: &mut Model, kinds: &[(u32, IfcType)]) -> (BTreeMap<u32, u32>, BTreeSet<u32>) {
    let mut parents = BTreeMap::new();
    let mut wholes = BTreeSet::new();
    for (id, kind) in kinds {
        // Attributes: the whole and its parts; the elements and the structure that contains them.
        let (whole, parts) = match kind {
            IfcType::IfcRelAggregates => (4, 5),
            IfcType::IfcRelContainedInSpatialStructure => (5, 4),
            _ => continue,
        };
        let Some(relation) = model.entity(*id) else {
            continue;
        };
        let Some(whole) = relation.get_ref(whole) else {
            continue;
        };
        wholes.insert(whole);
        for part in relation.get_refs(parts).unwrap_or_default() {
            parents.entry(part).or_insert(whole);
        }
    }
    (parents, wholes)
}

/// Name and type of an object, and the room, storey and building that it stands in.
pub fn known(
    model: &mut Model,
    product: &DecodedEntity,
    parents: &BTreeMap<u32, u32>,
) -> Map<String, Value> {
    let mut known = Map::new();
    let mut put = |key: &str, text: Option<&str>| {
        if let Some(text) = text.filter(|text| !text.is_empty()) {
            known.entry(key.to_string()).or_insert_with(|| text.into());
        }
    };
    put("id", product.get_string(0));
    put("type", Some(product.ifc_type.name()));
    put("name", product.get_string(2));
    put("description", product.get_string(3));
    put("object_type", product.get_string(4));
    if product.ifc_type == IfcType::IfcSpace {
        put("long_name", product.get_string(7));
    }
    let mut at = product.id;
    for _ in 0..DEEPEST {
        let Some(&above) = parents.get(&at) else {
            break;
        };
        at = above;
        let Some(entity) = model.entity(at) else {
            break;
        };
        let name = entity
            .get_string(2)
            .filter(|name| !name.is_empty())
            .or(entity.get_string(0));
        match entity.ifc_type {
            IfcType::IfcSpace => put("room", name),
            IfcType::IfcBuildingStorey => put("storey", name),
            IfcType::IfcBuilding => put("building", name),
            IfcType::IfcSite => put("site", name),
            _ => put("part_of", name),
        }
    }
    known
}
