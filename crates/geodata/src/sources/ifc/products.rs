//! The products of an IFC file.

use super::georeference::Stated;
use super::known::{known, parents};
use super::model::{Lost, Model};
use crate::sources::error::Fault;
use boresight_common::warning::Notes;
use glam::DVec3;
use ifc_lite_core::{
    AttributeValue, DecodedEntity, EntityDecoder, EntityScanner, IfcType, build_entity_index,
};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Products farther than this from the middle one are strays [m].
const STRAY_M: f64 = 1e5; // [m]

/// A product's faces in the frame of the placements [m], with what is known of it.
pub struct Product {
    /// Names and kinds of what it is and stands in.
    pub known: Map<String, Value>,
    /// Its kind.
    pub kind: IfcType,
    /// Rings of each face.
    pub faces: Vec<Vec<Vec<DVec3>>>,
}

/// What is read of a file before it is placed.
pub struct Made {
    /// Products with faces, then the rooms.
    pub products: Vec<Product>,
    /// Where it stands.
    pub stated: Stated,
    /// Metres in its unit of length.
    pub unit_m: f64,
    /// What was assumed and left out.
    pub notes: Notes,
}

impl Made {
    /// Lowest and highest corner in the frame of the placements [m].
    pub fn bounds(&self) -> [DVec3; 2] {
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

/// The products of a file, with units and what it states of its place.
///
/// Fails where the file is none, holds no shape, or states a unit or a place that is not understood.
pub fn products(bytes: &[u8]) -> Result<Made, Fault> {
    let bytes = step(bytes)?;
    let mut scanner = EntityScanner::new(bytes);
    let mut kinds: Vec<(u32, IfcType)> = Vec::new();
    while let Some((id, keyword, ..)) = scanner.next_entity() {
        kinds.push((id, IfcType::from_str(keyword)));
    }
    kinds.sort_by_key(|(id, _)| *id);
    let mut model = Model::new(EntityDecoder::with_index(bytes, build_entity_index(bytes)));
    if std::str::from_utf8(bytes).is_err() {
        let what = "some of it is neither ASCII nor UTF-8: those letters are lost";
        let mend = "export it again (ISO 10303-21 writes other letters as \\X2\\)";
        model.notes.assume("text", what, mend);
    }
    let mut counted = [0, 1];
    let mut line = |start: usize| {
        let start = start.min(bytes.len());
        if start < counted[0] {
            counted = [0, 1];
        }
        let between = bytes[counted[0]..start].iter();
        counted = [start, counted[1] + between.filter(|b| **b == b'\n').count()];
        format!("line {}", counted[1])
    };
    for start in scanner.malformed_record_starts() {
        model.notes.leave_out("damaged records", line(*start));
    }
    for start in scanner.skipped_oversized_id_starts() {
        let kind = "records with numbers above 4294967295";
        model.notes.leave_out(kind, line(*start));
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
    without_strays(&mut found, &mut model.notes);
    if found.is_empty() {
        return Err(Fault::new(
            "IFC",
            format!(
                "no product has a shape that is read{}",
                model.notes.left_out_in_brackets()
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

/// Leaves out products far from the middle one: such a one would move the frame of all others.
fn without_strays(products: &mut Vec<Product>, notes: &mut Notes) {
    let middle = |axis: usize| {
        let corners = products
            .iter()
            .flat_map(|p| p.faces.iter().flatten().flatten());
        let mut values: Vec<f64> = corners.map(|r| r[axis]).collect();
        let half = values.len() / 2;
        match values.is_empty() {
            true => 0.0,
            false => *values.select_nth_unstable_by(half, f64::total_cmp).1,
        }
    };
    let middle = DVec3::from([0, 1, 2].map(middle));
    let near = |r: &DVec3| r.is_finite() && r.distance(middle) < STRAY_M;
    products.retain(|product| {
        let near = product.faces.iter().flatten().flatten().all(near);
        if !near {
            let name = product.known.get("name").and_then(Value::as_str);
            let place = format!("{} '{}'", product.kind.name(), name.unwrap_or_default());
            notes.leave_out("products a hundred kilometres from the rest", place);
        }
        near
    });
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
