//! IFC (STEP) building models: what their products look like, and where they belong: room, storey, building.
//!
//! `ifc-lite-core` reads the records, units and georeferencing; it makes no geometry. What is made here: extruded areas, faceted
//! B-reps, surface models, triangulated and polygonal face sets, mapped items, local placements. Not made: curved B-reps, revolved and
//! swept solids, openings and other Boolean operations (the first operand stands uncut), curtain walls' grids, styles.

mod shape;

use super::error::{Fault, SourceError, read_bytes};
use super::options::Options;
use super::place::{self, Place};
use super::surfaces::{Corner, Surfaces};
use super::{Layer, LayerKind};
use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use glam::DVec3;
use ifc_lite_core::{
    DecodedEntity, EntityDecoder, EntityScanner, GeoRefExtractor, GeoRefSource, GeoReference,
    IfcType, build_entity_index,
};
use serde_json::{Map, Value};
use shape::Model;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Deepest tree of rooms, storeys and assemblies that is followed.
const DEEPEST: usize = 32;

/// A product's faces in the model's frame [m], with what is known of it.
struct Product {
    known: Map<String, Value>,
    kind: IfcType,
    /// Rings of each face.
    faces: Vec<Vec<Vec<DVec3>>>,
}

/// The products of an IFC file with shapes, a feature each, with name, type, room, storey and building; rooms follow as features
/// without triangles. It stands where its map conversion or its site's latitude and longitude say, or where the options say.
///
/// Fails where the file is damaged, holds no shape, or says nowhere where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let damaged = || Fault::new("IFC", "a record is damaged", "export it again").of(path);
    // Behind the library's interface lie indices of the file's own.
    let made = catch_unwind(AssertUnwindSafe(|| products(&bytes))).map_err(|_| damaged())?;
    let (products, georeference, unit_m) = made.map_err(|fault| fault.of(path))?;
    drop(bytes);
    let to_ecef = placing(georeference.as_ref(), unit_m, options, path)?;
    layer(products, &to_ecef, options).map_err(|fault| fault.of(path))
}

/// From the model's frame [m] to ECEF [m].
type ToEcef = Box<dyn Fn(DVec3) -> Result<DVec3, Fault>>;

/// Where the model stands.
fn placing(
    georeference: Option<&GeoReference>,
    unit_m: f64,
    options: &Options,
    path: &Path,
) -> Result<ToEcef, SourceError> {
    let local = options.georef.is_some();
    // A site's latitude and longitude stand back where the options name the map.
    let stands = |given: &&GeoReference| match given.source {
        None => false,
        Some(GeoRefSource::SiteLocation) => options.crs.is_none(),
        Some(_) => true,
    };
    let Some(given) = georeference.filter(|_| !local).filter(stands).cloned() else {
        let place = Place::of(options, None, path)?;
        return Ok(Box::new(move |r| place.ecef_m(r)));
    };
    if given.source == Some(GeoRefSource::SiteLocation) {
        let site = SiteFrame::new(Geodetic {
            latitude_rad: given.northings.to_radians(),
            longitude_rad: given.eastings.to_radians(),
            height_m: 0.0,
        });
        // The site's elevation is one over the sea.
        let wgs84 = place::crs("EPSG:4326+5773", options).map_err(|fault| fault.of(path))?;
        let ground = DVec3::new(
            given.eastings,
            given.northings,
            given.orthogonal_height * unit_m,
        );
        let height_m = wgs84
            .to_geodetic(ground)
            .map_err(|error| Fault::from(error).of(path))?
            .height_m;
        let site = SiteFrame::new(Geodetic {
            height_m,
            ..site.origin()
        });
        return Ok(Box::new(move |r| Ok(site.enu_to_ecef(r))));
    }
    let place = Place::of(options, given.crs_name.as_deref(), path)?;
    let map_m = given.map_unit_scale.unwrap_or(unit_m);
    Ok(Box::new(move |r| {
        let (e, n, h) = given.local_to_map(r.x / unit_m, r.y / unit_m, r.z / unit_m);
        place.ecef_m(DVec3::new(e, n, h) * map_m)
    }))
}

/// Products with faces, the georeferencing, and metres in the file's unit.
type Made = (Vec<Product>, Option<GeoReference>, f64);

fn products(bytes: &[u8]) -> Result<Made, Fault> {
    let mend = "name an IFC file (STEP, .ifc)";
    if !bytes.trim_ascii_start().starts_with(b"ISO-10303-21") {
        return Err(Fault::new(
            "IFC",
            "it does not begin with ISO-10303-21",
            mend,
        ));
    }
    let mut scanner = EntityScanner::new(bytes);
    let mut kinds: Vec<(u32, IfcType)> = Vec::new();
    while let Some((id, keyword, ..)) = scanner.next_entity() {
        kinds.push((id, IfcType::from_str(keyword)));
    }
    kinds.sort_unstable_by_key(|(id, _)| *id);
    kinds.dedup_by_key(|(id, _)| *id);
    let mut decoder = EntityDecoder::with_index(bytes, build_entity_index(bytes));
    let unit_m = Some(decoder.length_unit_scale())
        .filter(|m| m.is_finite() && (1e-6..1e4).contains(m))
        .unwrap_or(1.0);
    let georeference = GeoRefExtractor::extract(&mut decoder, &kinds)
        .ok()
        .flatten();
    let mut model = Model::new(decoder, unit_m);
    let parents = parents(&mut model, &kinds);
    let mut found = Vec::new();
    let mut rooms = Vec::new();
    for (id, kind) in &kinds {
        let hidden = [
            IfcType::IfcOpeningElement,
            IfcType::IfcAnnotation,
            IfcType::IfcGrid,
            IfcType::IfcVirtualElement,
        ];
        if !kind.is_subtype_of(IfcType::IfcProduct) || hidden.contains(kind) {
            continue;
        }
        let Some(product) = model.entity(*id) else {
            continue;
        };
        let known = known(&mut model, &product, &parents);
        if *kind == IfcType::IfcSpace {
            rooms.push(Product {
                known,
                kind: kind.clone(),
                faces: Vec::new(),
            });
            continue;
        }
        let faces = model.faces(&product);
        if !faces.is_empty() {
            found.push(Product {
                known,
                kind: kind.clone(),
                faces,
            });
        }
        if model.exhausted() {
            let what = "mapped items multiply to too many faces";
            return Err(Fault::new("IFC", what, "export fewer or simpler products"));
        }
    }
    if found.is_empty() {
        return Err(Fault::new(
            "IFC",
            "no product has a shape that is read",
            "export it with B-reps, extrusions or face sets",
        ));
    }
    found.extend(rooms);
    Ok((found, georeference, unit_m))
}

/// What each object is a part of or stands in.
fn parents(model: &mut Model, kinds: &[(u32, IfcType)]) -> BTreeMap<u32, u32> {
    let mut parents = BTreeMap::new();
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
        for part in relation.get_refs(parts).unwrap_or_default() {
            parents.entry(part).or_insert(whole);
        }
    }
    parents
}

/// Name and type of an object, and the room, storey and building that it stands in.
fn known(
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

/// Linear albedo of a product.
fn albedo(kind: &IfcType) -> [f32; 4] {
    let [r, g, b] = match kind {
        IfcType::IfcRoof => [0.30, 0.16, 0.12],
        IfcType::IfcSlab => [0.30, 0.30, 0.29],
        IfcType::IfcWindow | IfcType::IfcCurtainWall => [0.08, 0.10, 0.12],
        IfcType::IfcDoor => [0.16, 0.10, 0.06],
        IfcType::IfcSite => [0.16, 0.18, 0.10],
        _ => [0.38, 0.34, 0.29],
    };
    [r, g, b, 1.0]
}

/// The layer of products.
fn layer(products: Vec<Product>, to_ecef: &ToEcef, options: &Options) -> Result<Layer, Fault> {
    let corners = || {
        products
            .iter()
            .flat_map(|p| p.faces.iter().flatten().flatten())
    };
    let low = corners().fold(DVec3::INFINITY, |a, b| a.min(*b));
    let high = corners().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b));
    let site = match options.site {
        Some(site) => site,
        None => {
            let middle = ((low + high) / 2.0).with_z(low.z);
            SiteFrame::new(Geodetic::from_ecef(to_ecef(middle)?))
        }
    };
    let mut surfaces = Surfaces::default();
    let mut features = Vec::with_capacity(products.len());
    for product in products {
        let color = albedo(&product.kind);
        for face in &product.faces {
            let corner = |r: &DVec3| Ok::<Corner, Fault>(site.ecef_to_enu(to_ecef(*r)?).into());
            let ring = |ring: &Vec<DVec3>| ring.iter().map(corner).collect::<Result<Vec<_>, _>>();
            let rings = face.iter().map(ring).collect::<Result<Vec<_>, _>>()?;
            surfaces.polygon(&rings, features.len() as u32, color, 0);
        }
        features.push(product.known);
    }
    let meshes = surfaces.finish();
    if meshes.is_empty() {
        return Err(Fault::new(
            "IFC",
            "its faces have no area",
            "export it again",
        ));
    }
    Ok(Layer {
        kind: LayerKind::Buildings,
        site,
        meshes,
        features,
        warnings: Vec::new(),
    })
}

#[cfg(test)]
mod tests;
