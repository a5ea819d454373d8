//! IFC (STEP) building models: what their products look like, and where they belong: room, storey, building.
//!
//! `ifc-lite-core` reads the records; it makes no geometry, and its georeferencing takes defaults where something is not understood, so
//! that units and georeferencing are read here. What is made and what is not: `docs/sources.md`.

mod curve;
mod georeference;
mod model;
mod placing;
mod profile;
mod shape;
mod system;
mod units;

use super::error::{Fault, SourceError, read_bytes};
use super::options::Options;
use super::surfaces::{Corner, Surfaces};
use super::{Layer, LayerKind};
use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use crate::warning::Notes;
use georeference::Stated;
use glam::DVec3;
use ifc_lite_core::{
    AttributeValue, DecodedEntity, EntityDecoder, EntityScanner, IfcType, build_entity_index,
};
use model::{Lost, Model};
use placing::{Placing, ToEcef};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Deepest tree of rooms, storeys and assemblies that is followed.
const DEEPEST: usize = 32;

/// A product's faces in the frame of the placements [m], with what is known of it.
struct Product {
    known: Map<String, Value>,
    kind: IfcType,
    /// Rings of each face.
    faces: Vec<Vec<Vec<DVec3>>>,
}

/// The products of an IFC file with shapes, a feature each, with name, type, room, storey and building; rooms follow as features
/// without triangles. It stands where its map conversion or its site's latitude and longitude say, or where the options say.
///
/// Fails where the file is damaged, holds no shape, states a unit or a place that is not understood, or says nowhere where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let damaged = || Fault::new("IFC", "a record is damaged", "export it again").of(path);
    // Behind the library's interface lie indices of the file's own.
    let made = catch_unwind(AssertUnwindSafe(|| products(&bytes))).map_err(|_| damaged())?;
    let mut made = made.map_err(|fault| fault.of(path))?;
    drop(bytes);
    let [low, high] = made.bounds();
    let placing = Placing {
        stated: &made.stated,
        unit_m: made.unit_m,
        middle_m: (low + high) / 2.0,
        options,
    };
    let to_ecef = placing.to_ecef(path, &mut made.notes)?;
    let warnings = std::mem::take(&mut made.notes);
    let mut layer = layer(made, &to_ecef, options).map_err(|fault| fault.of(path))?;
    layer.warnings = warnings.warnings(path);
    Ok(layer)
}

/// What is read of a file before it is placed.
struct Made {
    /// Products with faces, then the rooms.
    products: Vec<Product>,
    stated: Stated,
    unit_m: f64,
    notes: Notes,
}

impl Made {
    /// Lowest and highest corner in the frame of the placements [m].
    fn bounds(&self) -> [DVec3; 2] {
        let all = self.products.iter().flat_map(|p| p.faces.iter());
        let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        all.flatten()
            .flatten()
            .fold(start, |[low, high], r| [low.min(*r), high.max(*r)])
    }
}

/// The text of a STEP file, without a byte-order mark.
fn step(bytes: &[u8]) -> Result<&[u8], Fault> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = text.trim_ascii_start();
    if text.starts_with(b"ISO-10303-21") {
        return Ok(text);
    }
    let (what, mend) = match text {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => ("it is UTF-16", "save it as UTF-8 or ASCII"),
        [b'P', b'K', ..] => (
            "it is an ifcZIP archive",
            "unzip it and name the .ifc inside",
        ),
        [0x1f, 0x8b, ..] => ("it is compressed with gzip", "unpack it"),
        [b'<', ..] => ("it is ifcXML", "export it as STEP (.ifc)"),
        _ => (
            "it does not begin with ISO-10303-21",
            "name an IFC file (STEP, .ifc)",
        ),
    };
    Err(Fault::new("IFC", what, mend))
}

/// Products that have no shape of their own by their nature.
fn shapeless(kind: &IfcType) -> bool {
    let all = [
        IfcType::IfcSpatialElement,
        IfcType::IfcSpatialStructureElement,
        IfcType::IfcPort,
        IfcType::IfcLinearElement,
        IfcType::IfcPositioningElement,
        IfcType::IfcStructuralItem,
        IfcType::IfcStructuralActivity,
        IfcType::IfcElementAssembly,
    ];
    all.into_iter().any(|one| kind.is_subtype_of(one))
}

/// The kind under which a product is left out that is never shown.
fn hidden(kind: &IfcType) -> Option<&'static str> {
    match kind {
        IfcType::IfcOpeningElement
        | IfcType::IfcOpeningStandardCase
        | IfcType::IfcVoidingFeature => Some("openings (walls and slabs stay uncut)"),
        IfcType::IfcAnnotation => Some("annotations"),
        IfcType::IfcGrid => Some("grids"),
        IfcType::IfcVirtualElement => Some("virtual elements"),
        _ => None,
    }
}

fn products(bytes: &[u8]) -> Result<Made, Fault> {
    let bytes = step(bytes)?;
    let mut scanner = EntityScanner::new(bytes);
    let mut kinds: Vec<(u32, IfcType)> = Vec::new();
    while let Some((id, keyword, ..)) = scanner.next_entity() {
        kinds.push((id, IfcType::from_str(keyword)));
    }
    kinds.sort_by_key(|(id, _)| *id);
    let mut model = Model::new(EntityDecoder::with_index(bytes, build_entity_index(bytes)));
    for start in scanner.malformed_record_starts() {
        let line = bytes[..(*start).min(bytes.len())].iter();
        let line = 1 + line.filter(|b| **b == b'\n').count();
        model
            .notes
            .leave_out("damaged records", format!("line {line}"));
    }
    for twins in kinds.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let place = format!("#{}", twins[0].0);
        model
            .notes
            .leave_out("records whose number is taken", place);
    }
    kinds.dedup_by_key(|(id, _)| *id);
    model.take_units(&kinds)?;
    let stated = Stated::read(&mut model, &kinds)?;
    let (parents, wholes) = parents(&mut model, &kinds);
    let mut found = Vec::new();
    let mut rooms = Vec::new();
    for (id, kind) in &kinds {
        if !kind.is_subtype_of(IfcType::IfcProduct) {
            continue;
        }
        let read = catch_unwind(AssertUnwindSafe(|| {
            product(&mut model, *id, kind, &parents, &wholes)
        }));
        let lost = || Lost {
            kind: "damaged products".into(),
            place: format!("#{id} {}", kind.name()),
        };
        match read.unwrap_or_else(|_| Err(lost())) {
            Ok(Some(product)) if product.kind == IfcType::IfcSpace => rooms.push(product),
            Ok(Some(product)) => found.push(product),
            Ok(None) => {}
            Err(lost) => model.notes.leave_out(lost.kind, lost.place),
        }
        if model.exhausted() {
            let what = "mapped items multiply to too many faces";
            return Err(Fault::new("IFC", what, "export fewer or simpler products"));
        }
    }
    if found.is_empty() {
        return Err(Fault::new(
            "IFC",
            format!(
                "no product has a shape that is read{}",
                reasons(model.notes)
            ),
            "export it with B-reps, extrusions or face sets",
        ));
    }
    found.extend(rooms);
    Ok(Made {
        products: found,
        stated,
        unit_m: model.unit_m,
        notes: model.notes,
    })
}

/// What was left out, in brackets.
fn reasons(notes: Notes) -> String {
    let warnings = notes.warnings(Path::new(""));
    let left_out = warnings
        .into_iter()
        .find(|warning| warning.place == "left out");
    left_out.map_or(String::new(), |warning| format!(" ({})", warning.what))
}

/// A product with its faces; none where it has none by its nature.
fn product(
    model: &mut Model,
    id: u32,
    kind: &IfcType,
    parents: &BTreeMap<u32, u32>,
    wholes: &BTreeSet<u32>,
) -> Result<Option<Product>, Lost> {
    let place = |product: &DecodedEntity| {
        let name = product.get_string(2).unwrap_or_default();
        format!("{} '{name}'", kind.name())
    };
    let lost = |what: &str| Lost {
        kind: what.into(),
        place: format!("#{id} {}", kind.name()),
    };
    let product = model.entity(id).ok_or_else(|| lost("damaged products"))?;
    if let Some(what) = hidden(kind) {
        return Err(lost(what));
    }
    let known = known(model, &product, parents);
    let mut made = Product {
        known,
        kind: kind.clone(),
        faces: Vec::new(),
    };
    if *kind == IfcType::IfcSpace {
        return Ok(Some(made));
    }
    if product.get(6).is_none_or(AttributeValue::is_null) {
        // A whole is shown by its parts.
        if shapeless(kind) || wholes.contains(&id) {
            return Ok(None);
        }
        return Err(lost("products without a shape"));
    }
    model.product = place(&product);
    let before = model.notes.count_left_out();
    let faces = model.faces(&product);
    model.product.clear();
    made.faces = faces.map_err(|lost| Lost {
        place: format!("{} of {}", lost.place, place(&product)),
        ..lost
    })?;
    let silent = made.faces.is_empty() && model.notes.count_left_out() == before;
    if silent && !shapeless(kind) {
        return Err(lost("products whose shape has no faces"));
    }
    let some = !made.faces.is_empty();
    Ok(some.then_some(made))
}

/// What each object is a part of or stands in, and the objects that others are parts of.
fn parents(model: &mut Model, kinds: &[(u32, IfcType)]) -> (BTreeMap<u32, u32>, BTreeSet<u32>) {
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
fn layer(made: Made, to_ecef: &ToEcef, options: &Options) -> Result<Layer, Fault> {
    let [low, high] = made.bounds();
    let products = made.products;
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
