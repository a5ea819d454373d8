//! CityJSON 1.0, 1.1, 2.0 and CityJSONSeq (CityJSON Specifications 2.0.1): city objects into layers.
//!
//! The `cityjson` crate holds the data model but reads no JSON (its reader is a crate of its own, not a dependency here), so the few
//! members that make triangles are read with serde.

mod document;
mod geometry;
mod kinds;
mod reader;
mod tolerant;

use super::error::{Fault, SourceError, read_bytes};
use super::options::Options;
use super::place::{self, Place};
use super::surfaces::Surfaces;
use super::{Layer, LayerKind};
use boresight_common::warning::Notes;
use document::Document;
use glam::DVec3;
use reader::{Found, Gathered, Reader, gather};
use std::collections::BTreeMap;
use std::path::Path;

/// Its buildings, as one layer: a feature for each city object that has geometry (buildings, their parts and installations).
///
/// Fails where the file is damaged, names no system that is known, or holds no building.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let mut layers = read_all(path, options)?;
    let warnings = layers
        .iter_mut()
        .map(|layer| std::mem::take(&mut layer.warnings));
    let warnings = warnings.flatten().collect();
    let buildings = layers
        .into_iter()
        .find(|layer| layer.kind == LayerKind::Buildings);
    let none = || {
        Fault::new(
            "CityObjects",
            "no building with surfaces",
            "name a file that has some",
        )
    };
    let layer = buildings.ok_or_else(|| none().of(path))?;
    Ok(Layer { warnings, ..layer })
}

/// All that it holds: buildings, ground (land use, roads, water, relief), and what else stands in the city (bridges, vegetation,
/// furniture), each as far as the file has it, in one frame. The first layer has the warnings.
pub fn read_all(path: &Path, options: &Options) -> Result<Vec<Layer>, SourceError> {
    let bytes = read_bytes(path)?;
    let mut notes = Notes::default();
    let documents = document::parse(&bytes, &mut notes).map_err(|fault| fault.of(path))?;
    drop(bytes);
    let placed = options.crs.is_some() || options.georef.is_some();
    let system = match documents.first() {
        Some(first) if !placed => first.reference_system().map_err(|fault| fault.of(path))?,
        _ => None,
    };
    let place = Place::of(options, system.as_deref(), path)?;
    place.note(&mut notes);
    let folder = path.parent().unwrap_or(Path::new("."));
    let read = layers(&documents, &place, options, folder, &mut notes);
    let mut layers = read.map_err(|fault| fault.of(path))?;
    if let Some(first) = layers.first_mut() {
        first.warnings = notes.warnings(path);
    }
    Ok(layers)
}

/// Points farther than this from the middle one are strays: of a map's coordinates, no city is larger [m].
const STRAY_M: f64 = 1e5; // [m]

/// Nearer than this to a map's own origin a city was hardly meant to lie [m].
const ORIGIN_M: f64 = 5e3; // [m]

/// The documents as layers.
fn layers(
    documents: &[Document],
    place: &Place,
    options: &Options,
    folder: &Path,
    notes: &mut Notes,
) -> Result<Vec<Layer>, Fault> {
    let transform = match documents.first() {
        Some(first) => first.transform()?,
        None => None,
    };
    let positions = |document: &Document, notes: &mut Notes, k: usize| {
        let own = document.transform().unwrap_or_else(|fault| {
            let place = format!("feature {k}: {}", fault.place);
            notes.leave_out("transforms of features that are none", place);
            None
        });
        document.positions(own.or(transform)).collect::<Vec<_>>()
    };
    let numbered = documents.iter().enumerate();
    let sources: Vec<Vec<DVec3>> = numbered.map(|(k, it)| positions(it, notes, k)).collect();
    let used = used(documents, &sources);
    let bounds = near(&used, place);
    let inside = |r: &DVec3| r.cmpge(bounds[0]).all() && r.cmple(bounds[1]).all();
    let corners = place.bounds(used.iter().filter(|r| inside(r)).copied());
    if !(corners[0].is_finite() && corners[1].is_finite()) {
        let what = format!("no surfaces with vertices{}", notes.left_out_in_brackets());
        let mend = "name a file with solids or surfaces";
        return Err(Fault::new("CityObjects", what, mend));
    }
    extent(documents, corners, notes);
    origin(place, corners, notes);
    let site = place::site(options, place, corners)?;
    let gathered = |kind| Gathered {
        kind,
        surfaces: Surfaces::default(),
        features: Vec::new(),
        looks: BTreeMap::new(),
    };
    let mut kinds = [LayerKind::Buildings, LayerKind::Terrain, LayerKind::Surface].map(gathered);
    let level = options.lod.as_deref().map(|lod| {
        let what = format!("'{lod}' is no level of detail");
        let level = lod.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        level.ok_or_else(|| Fault::new("lod", what, "write --lod 1 or --lod 2.2"))
    });
    let level = level.transpose()?;
    let reader = |(document, source)| Reader {
        document,
        templates: documents.first().unwrap_or(document),
        source,
        bounds,
        place,
        site: &site,
        folder,
        level,
    };
    let readers: Vec<Reader> = documents.iter().zip(sources).map(reader).collect();
    let mut found = Found::default();
    gather(&readers, &mut kinds, &mut found);
    notes.extend(found.notes);
    if let Some((count, first)) = found.other_level {
        let wanted = options.lod.as_deref().unwrap_or_default();
        let what =
            format!("{count} objects have none of {wanted} and show another (first {first})");
        notes.assume("lod", what, "name another level with --lod");
    }
    for gathered in &kinds {
        gathered.surfaces.note(notes);
    }
    let full = kinds
        .into_iter()
        .filter(|gathered| !gathered.features.is_empty());
    let layer = |gathered: Gathered| Layer {
        kind: gathered.kind,
        site,
        meshes: gathered.surfaces.finish(),
        features: gathered.features,
        warnings: Vec::new(),
    };
    let layers: Vec<Layer> = full.map(layer).collect();
    if layers.is_empty() {
        return Err(Fault::new(
            "CityObjects",
            format!("no surfaces{}", notes.left_out_in_brackets()),
            "name a file with solids or surfaces, or another --lod",
        ));
    }
    Ok(layers)
}

/// The points that geometries use, without those that are none.
fn used(documents: &[Document], sources: &[Vec<DVec3>]) -> Vec<DVec3> {
    let mut used = Vec::new();
    for (document, source) in documents.iter().zip(sources) {
        let mut own = vec![false; source.len()];
        let objects = document.objects.0.values().filter_map(|it| it.0.as_ref());
        let geometries = objects.flat_map(|it| it.geometry.0.iter());
        for geometry in geometries.filter_map(|it| it.0.as_ref()) {
            geometry.boundaries.each(&mut |k| {
                if let Some(used) = own.get_mut(k) {
                    *used = true;
                }
            });
        }
        let points = source
            .iter()
            .zip(own)
            .filter(|(r, used)| *used && r.is_finite());
        used.extend(points.map(|(r, _)| *r));
    }
    used
}

/// Lowest and highest corner of what is no stray point of a map: such a one would move the middle of all others.
fn near(points: &[DVec3], place: &Place) -> [DVec3; 2] {
    let all = [DVec3::NEG_INFINITY, DVec3::INFINITY];
    let Place::Crs(crs) = place else {
        return all;
    };
    if crs.is_geographic() || points.is_empty() {
        return all;
    }
    let middle = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|r| r[axis]).collect();
        let half = values.len() / 2;
        *values.select_nth_unstable_by(half, f64::total_cmp).1
    };
    let middle = DVec3::from([0, 1, 2].map(middle));
    let reach = STRAY_M / crs.units_m();
    [middle - reach, middle + reach]
}

/// Notes an extent that does not hold the vertices.
fn extent(documents: &[Document], corners: [DVec3; 2], notes: &mut Notes) {
    let Some([low, high]) = documents.first().and_then(Document::extent) else {
        return;
    };
    let slack = (high - low).abs() * 0.01 + 1.0;
    let outside = corners[0].cmplt(low - slack).any() || corners[1].cmpgt(high + slack).any();
    if outside {
        let what = format!(
            "it reaches from {low} to {high}, the vertices from {} to {}: the vertices count",
            corners[0], corners[1]
        );
        let mend = "check the transform, and name the system with --crs if it is another";
        notes.assume("geographicalExtent", what, mend);
    }
}

/// Notes vertices about a map's own origin, where they were hardly meant to lie.
fn origin(place: &Place, corners: [DVec3; 2], notes: &mut Notes) {
    let Place::Crs(crs) = place else {
        return;
    };
    let middle_m = (corners[0] + corners[1]) / 2.0 * crs.units_m();
    let far_m = middle_m.truncate().length();
    if !crs.is_geographic() && !crs.is_geocentric() && far_m < ORIGIN_M {
        let what = format!(
            "they lie {:.1} km from the map's own origin, where few maps have a city",
            far_m / 1e3
        );
        let mend = "check the transform, name the system with --crs, or place it with --georef";
        notes.assume("vertices", what, mend);
    }
}

#[cfg(test)]
mod tests;
