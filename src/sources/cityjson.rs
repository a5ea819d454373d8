//! CityJSON 1.0, 1.1, 2.0 and CityJSONSeq (CityJSON Specifications 2.0.1): city objects into layers.
//!
//! The `cityjson` crate holds the data model but reads no JSON (its reader is a crate of its own, not a dependency here), so the few
//! members that make triangles are read with serde.

mod document;

use super::error::{Fault, SourceError, read_bytes};
use super::options::Options;
use super::place::{self, Place};
use super::surfaces::{Corner, Surfaces, area_vector_m2};
use super::{Layer, LayerKind};
use crate::models::maths::geodesy::SiteFrame;
use crate::models::shape::textured::{Look, Texture};
use document::{Document, Geometry, Nest, Object};
use glam::{DMat4, DVec3};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Its buildings, as one layer: a feature for each city object that has geometry (buildings, their parts and installations).
///
/// Fails where the file is damaged, names no system that is known, or holds no building.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let layers = read_all(path, options)?;
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
    buildings.ok_or_else(|| none().of(path))
}

/// All that it holds: buildings, ground (land use, roads, water, relief), and what else stands in the city (bridges, vegetation,
/// furniture), each as far as the file has it, in one frame.
pub fn read_all(path: &Path, options: &Options) -> Result<Vec<Layer>, SourceError> {
    let bytes = read_bytes(path)?;
    let documents = document::parse(&bytes).map_err(|fault| fault.of(path))?;
    drop(bytes);
    let system = documents.first().and_then(|first| first.reference_system());
    let place = Place::of(options, system.as_deref(), path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    layers(&documents, &place, options, folder).map_err(|fault| fault.of(path))
}

/// What a city object's triangles are.
fn kind(object: &str) -> LayerKind {
    let ground = [
        "LandUse",
        "Road",
        "Railway",
        "Square",
        "TransportSquare",
        "Track",
        "Waterway",
        "WaterBody",
        "TINRelief",
        "GenericCityObject",
    ];
    let ground = ground.contains(&object) || (object == "PlantCover");
    if object.starts_with("Building") {
        LayerKind::Buildings
    } else if ground {
        LayerKind::Terrain
    } else {
        LayerKind::Surface
    }
}

/// Linear albedo of a surface by what it is, where the file gives no material.
fn albedo(object: &str, semantics: Option<&str>, up: f64) -> [f32; 4] {
    let [r, g, b] = match (semantics, object) {
        (Some("RoofSurface" | "OuterCeilingSurface"), _) => [0.30, 0.16, 0.12],
        (Some("GroundSurface"), _) => [0.18, 0.18, 0.18],
        (Some("Window"), _) => [0.08, 0.10, 0.12],
        (Some("Door"), _) => [0.16, 0.10, 0.06],
        (Some("WaterSurface"), _) | (_, "WaterBody" | "Waterway") => [0.05, 0.10, 0.13],
        (_, "Road" | "Railway" | "Square" | "TransportSquare" | "Track") => [0.12, 0.12, 0.12],
        (_, "PlantCover" | "SolitaryVegetationObject") => [0.08, 0.16, 0.05],
        (_, "LandUse" | "TINRelief" | "GenericCityObject") => [0.16, 0.18, 0.10],
        (None, _) if object.starts_with("Building") && up > 0.5 => [0.30, 0.16, 0.12],
        _ => [0.38, 0.34, 0.29],
    };
    [r, g, b, 1.0]
}

/// One kind of layer as it grows.
struct Gathered {
    kind: LayerKind,
    surfaces: Surfaces,
    features: Vec<Map<String, Value>>,
    /// Look of each texture of the document that is being read.
    looks: BTreeMap<usize, Option<usize>>,
}

/// A surface of a geometry: its rings and what it is.
struct Face {
    rings: Vec<Vec<Corner>>,
    semantics: Option<usize>,
    material: Option<usize>,
    texture: Option<usize>,
}

/// The documents as layers.
fn layers(
    documents: &[Document],
    place: &Place,
    options: &Options,
    folder: &Path,
) -> Result<Vec<Layer>, Fault> {
    let transform = documents.first().and_then(|first| first.transform);
    let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for document in documents {
        for r in document.positions(transform) {
            bounds = [bounds[0].min(r), bounds[1].max(r)];
        }
    }
    if !(bounds[0].is_finite() && bounds[1].is_finite()) {
        let what = "no vertices, or some that are no finite numbers";
        return Err(Fault::new(
            "vertices",
            what,
            "name a file that holds a city",
        ));
    }
    let site = place::site(options, place, bounds)?;
    let gathered = |kind| Gathered {
        kind,
        surfaces: Surfaces::default(),
        features: Vec::new(),
        looks: BTreeMap::new(),
    };
    let mut kinds = [LayerKind::Buildings, LayerKind::Terrain, LayerKind::Surface].map(gathered);
    for document in documents {
        kinds.iter_mut().for_each(|gathered| gathered.looks.clear());
        let reader = Reader {
            document,
            templates: documents.first().unwrap_or(document),
            source: document.positions(transform).collect(),
            place,
            site: &site,
            folder,
        };
        for (id, object) in &document.objects {
            let kind = kind(&object.kind);
            let Some(gathered) = kinds.iter_mut().find(|gathered| gathered.kind == kind) else {
                continue;
            };
            let at = |fault: Fault| Fault {
                place: format!("{} {id}: {}", object.kind, fault.place),
                ..fault
            };
            reader.object(id, object, options, gathered).map_err(at)?;
        }
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
            "no surfaces",
            "name a file with solids or surfaces, or another --lod",
        ));
    }
    Ok(layers)
}

/// One document with what its objects need.
struct Reader<'a> {
    document: &'a Document,
    /// The document that holds the templates: a sequence's first.
    templates: &'a Document,
    source: Vec<DVec3>,
    place: &'a Place,
    site: &'a SiteFrame,
    folder: &'a Path,
}

impl Reader<'_> {
    /// A point of the source in the layer's frame [m].
    fn enu_m(&self, r: DVec3) -> Result<DVec3, Fault> {
        Ok(self.site.ecef_to_enu(self.place.ecef_m(r)?))
    }

    /// Adds an object's chosen geometries.
    fn object(
        &self,
        id: &str,
        object: &Object,
        options: &Options,
        gathered: &mut Gathered,
    ) -> Result<(), Fault> {
        let chosen = choose(&object.geometry, options.lod.as_deref());
        let feature = gathered.features.len() as u32;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut any = false;
        for geometry in chosen {
            let (geometry, corners) = match geometry.template {
                Some(template) => {
                    let (geometry, corners) = self.instance(geometry, template)?;
                    (geometry, Some(corners))
                }
                None => (geometry, None),
            };
            let source = corners.as_ref().unwrap_or(&self.source);
            let shells = shells(&geometry.boundaries, &geometry.kind)?;
            for (number, shell) in shells.iter().enumerate() {
                let mut faces = Vec::new();
                for (k, surface) in shell.iter().enumerate() {
                    let face = self.face(geometry, source, surface, number, k)?;
                    if let Some(outline) = face.rings.first() {
                        any |= outline.len() >= 3;
                        faces.push(face);
                    }
                    for r in surface
                        .items()
                        .iter()
                        .flat_map(Nest::items)
                        .filter_map(|k| source.get(k.index()?))
                    {
                        (low, high) = (low.min(r.z), high.max(r.z));
                    }
                }
                outward(
                    &mut faces,
                    &geometry.kind,
                    gathered.kind,
                    &geometry.semantics,
                );
                for face in faces {
                    self.add(object, geometry, face, feature, gathered);
                }
            }
        }
        if any {
            let mut known = Map::new();
            known.insert("id".into(), id.into());
            known.insert("type".into(), object.kind.clone().into());
            if let Some(parent) = object.parents.first() {
                known.insert("parent".into(), parent.clone().into());
            }
            known.insert("bottom".into(), low.into());
            known.insert("top".into(), high.into());
            for (key, value) in &object.attributes {
                known.entry(key.clone()).or_insert_with(|| value.clone());
            }
            gathered.features.push(known);
        }
        Ok(())
    }

    /// The template that an instance shows, and its vertices in the source's coordinates.
    fn instance(
        &self,
        geometry: &Geometry,
        template: usize,
    ) -> Result<(&Geometry, Vec<DVec3>), Fault> {
        let wrong = |what: &str| Fault::new("GeometryInstance", what, "mend the file");
        let templates = self
            .templates
            .templates
            .as_ref()
            .or(self.document.templates.as_ref());
        let templates = templates.ok_or_else(|| wrong("no geometry-templates"))?;
        let shown = templates
            .templates
            .get(template)
            .ok_or_else(|| wrong("no such template"))?;
        let reference = geometry.boundaries.items().first().and_then(Nest::index);
        let reference = reference
            .and_then(|k| self.source.get(k))
            .ok_or_else(|| wrong("no such reference point"))?;
        if geometry.matrix.len() != 16 {
            return Err(wrong("transformationMatrix needs 16 numbers"));
        }
        let rows: [f64; 16] = std::array::from_fn(|k| geometry.matrix[k]);
        let matrix = DMat4::from_cols_array(&rows).transpose();
        let place = |r: &[f64; 3]| *reference + matrix.transform_point3(DVec3::from(*r));
        Ok((shown, templates.vertices.iter().map(place).collect()))
    }

    /// A surface in the layer's frame.
    fn face(
        &self,
        geometry: &Geometry,
        source: &[DVec3],
        surface: &Nest,
        shell: usize,
        number: usize,
    ) -> Result<Face, Fault> {
        let mut rings = Vec::new();
        let textures = self.texture_of(geometry, shell, number);
        let mut texture = None;
        for (n, ring) in surface.items().iter().enumerate() {
            let uv = textures
                .and_then(|nest| nest.items().get(n))
                .map_or(&[][..], Nest::items);
            texture = texture.or(uv.first().and_then(Nest::index));
            let mut corners = Vec::new();
            for (k, index) in ring.items().iter().enumerate() {
                let r = index.index().and_then(|index| source.get(index));
                let r = r.ok_or_else(|| {
                    Fault::new(
                        "boundaries",
                        "a vertex that does not exist",
                        "mend the file",
                    )
                })?;
                let uv = uv
                    .get(k + 1)
                    .and_then(Nest::index)
                    .and_then(|k| self.document.texture_vertex(k));
                let [u, v] = uv.unwrap_or([0.0; 2]);
                corners.push(Corner {
                    r_m: self.enu_m(*r)?,
                    uv: [u as f32, (1.0 - v) as f32],
                });
            }
            corners.dedup_by(|a, b| a.r_m == b.r_m);
            if corners.len() > 1 && corners.first().map(|c| c.r_m) == corners.last().map(|c| c.r_m)
            {
                corners.pop();
            }
            if n == 0 || corners.len() >= 3 {
                rings.push(corners);
            }
        }
        Ok(Face {
            rings,
            semantics: geometry
                .semantics
                .as_ref()
                .and_then(|s| value_at(&s.values, shell, number)),
            material: self.material_of(geometry, shell, number),
            texture,
        })
    }

    /// The texture's numbers of a surface, of the first theme.
    fn texture_of<'g>(
        &self,
        geometry: &'g Geometry,
        shell: usize,
        number: usize,
    ) -> Option<&'g Nest> {
        let values = &geometry.texture.values().next()?.values;
        // Rings of a surface: three levels down from a solid's shells, two from a multi-surface.
        let shells = matches!(
            geometry.kind.as_str(),
            "Solid" | "MultiSolid" | "CompositeSolid"
        );
        let own = if shells {
            flatten(values, &geometry.kind).get(shell).copied()?
        } else {
            values
        };
        own.items().get(number)
    }

    /// The material of a surface, of the first theme.
    fn material_of(&self, geometry: &Geometry, shell: usize, number: usize) -> Option<usize> {
        let theme = geometry.material.values().next()?;
        theme
            .value
            .or_else(|| value_at(theme.values.as_ref()?, shell, number))
    }

    /// Adds a face to its mesh.
    fn add(
        &self,
        object: &Object,
        geometry: &Geometry,
        face: Face,
        feature: u32,
        gathered: &mut Gathered,
    ) {
        let semantics = face
            .semantics
            .and_then(|k| geometry.semantics.as_ref()?.surfaces.get(k));
        let normal = area_vector_m2(&face.rings[0]).normalize_or_zero();
        let material = face.material.and_then(|k| self.document.material(k));
        let mut color = match material {
            Some(color) => color,
            None => albedo(&object.kind, semantics.map(|s| s.kind.as_str()), normal.z),
        };
        let look = face.texture.and_then(|k| {
            let surfaces = &mut gathered.surfaces;
            let made = gathered.looks.entry(k).or_insert_with(|| {
                let texture = self.image(k)?;
                Some(surfaces.add_look(Look {
                    texture: Some(Arc::new(texture)),
                    ..Look::default()
                }))
            });
            *made
        });
        if look.is_some() {
            color = [1.0; 4];
        }
        gathered
            .surfaces
            .polygon(&face.rings, feature, color, look.unwrap_or(0));
    }

    /// A picture beside the file; `None` where it is missing or damaged: the surface then has its plain colour.
    fn image(&self, texture: usize) -> Option<Texture> {
        let name = self.document.image(texture)?;
        let bytes = read_bytes(&self.folder.join(name)).ok()?;
        let mut reader = image::ImageReader::new(std::io::Cursor::new(bytes))
            .with_guessed_format()
            .ok()?;
        let mut limits = image::Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(16_384), Some(16_384));
        reader.limits(limits);
        let picture = reader.decode().ok()?.to_rgba8();
        Some(Texture {
            size_px: [picture.width(), picture.height()],
            rgba: picture.into_raw(),
        })
    }
}

/// The geometries of an object to show: those of the wanted level of detail, or else of the finest, or of the finest below the wanted.
fn choose<'a>(all: &'a [Geometry], wanted: Option<&str>) -> Vec<&'a Geometry> {
    let surfaces = |g: &&Geometry| !["MultiPoint", "MultiLineString"].contains(&g.kind.as_str());
    let level = |g: &Geometry| g.lod.as_ref().map_or(0.0, document::Lod::level);
    let wanted = wanted
        .and_then(|w| w.parse::<f64>().ok())
        .unwrap_or(f64::INFINITY);
    let levels = || all.iter().filter(surfaces).map(level);
    let below = levels()
        .filter(|l| *l <= wanted)
        .fold(f64::NEG_INFINITY, f64::max);
    let best = if below.is_finite() {
        below
    } else {
        levels().fold(f64::INFINITY, f64::min)
    };
    all.iter()
        .filter(surfaces)
        .filter(|g| level(g) == best)
        .collect()
}

/// The shells of boundaries or of values, whatever the geometry: a multi-surface is one shell. Inner shells of solids stay.
fn flatten<'a>(nest: &'a Nest, kind: &str) -> Vec<&'a Nest> {
    match kind {
        "Solid" => nest.items().iter().collect(),
        "MultiSolid" | "CompositeSolid" => nest.items().iter().flat_map(Nest::items).collect(),
        _ => vec![nest],
    }
}

/// The surfaces of each shell; only outer shells are seen, so that of a solid all but the first are empty.
fn shells<'a>(boundaries: &'a Nest, kind: &str) -> Result<Vec<&'a [Nest]>, Fault> {
    let known = [
        "Solid",
        "MultiSolid",
        "CompositeSolid",
        "MultiSurface",
        "CompositeSurface",
    ];
    if !known.contains(&kind) {
        return Err(Fault::new(
            "geometry",
            format!("type '{kind}' is not known"),
            "mend the file",
        ));
    }
    let outer = |solid: &'a Nest| {
        let shells = solid.items().iter().enumerate();
        shells
            .map(|(k, shell)| if k == 0 { shell.items() } else { &[][..] })
            .collect::<Vec<_>>()
    };
    Ok(match kind {
        "Solid" => outer(boundaries),
        "MultiSolid" | "CompositeSolid" => boundaries.items().iter().flat_map(outer).collect(),
        _ => vec![boundaries.items()],
    })
}

/// A value of a surface in the nested lists of semantics and materials, which may stop early or hold nothing.
fn value_at(values: &Nest, shell: usize, number: usize) -> Option<usize> {
    let first = values.items().first()?;
    let deep = |nest: &Nest| {
        nest.items()
            .first()
            .is_some_and(|first| !first.items().is_empty())
    };
    if first.items().is_empty() && !values.items().iter().any(|v| !v.items().is_empty()) {
        return values.items().get(number)?.index();
    }
    let shells: Vec<&Nest> = if deep(first) {
        values.items().iter().flat_map(Nest::items).collect()
    } else {
        values.items().iter().collect()
    };
    shells.get(shell)?.items().get(number)?.index()
}

/// Turns faces so that they are seen from outside: a closed shell by its volume, an open one of a building by its roofs, ground by its
/// upper side.
fn outward(
    faces: &mut [Face],
    kind: &str,
    layer: LayerKind,
    semantics: &Option<document::Semantics>,
) {
    let areas: Vec<DVec3> = faces
        .iter()
        .map(|face| face.rings.iter().take(1).map(|r| area_vector_m2(r)).sum())
        .collect();
    let flip = |face: &mut Face| face.rings.iter_mut().for_each(|ring| ring.reverse());
    if layer == LayerKind::Terrain && !kind.ends_with("Solid") {
        for (face, area) in faces.iter_mut().zip(&areas) {
            if area.z < -0.1 * area.length() {
                flip(face);
            }
        }
        return;
    }
    let total: f64 = areas.iter().map(|a| a.length()).sum();
    let open = areas.iter().sum::<DVec3>().length();
    // From the lowest corner: a shell may lack its ground.
    let corners = faces.iter().flat_map(|face| face.rings.iter().flatten());
    let low = corners.min_by(|a, b| a.r_m.z.total_cmp(&b.r_m.z));
    let origin = low.map_or(DVec3::ZERO, |corner| corner.r_m);
    // A pyramid over each face; holes do not change the sign of the whole.
    let height = |face: &Face| {
        face.rings
            .first()
            .and_then(|ring| ring.first())
            .map_or(DVec3::ZERO, |c| c.r_m - origin)
    };
    let volume: f64 = faces
        .iter()
        .zip(&areas)
        .map(|(face, area)| height(face).dot(*area))
        .sum();
    let roofs: f64 = (faces.iter().zip(&areas))
        .filter(|(face, _)| {
            let kind = face
                .semantics
                .and_then(|k| Some(semantics.as_ref()?.surfaces.get(k)?.kind.as_str()));
            kind == Some("RoofSurface")
        })
        .map(|(_, area)| area.z)
        .sum();
    let inside_out = if open < 0.02 * total || kind.ends_with("Solid") {
        volume < 0.0
    } else {
        roofs < 0.0
    };
    if inside_out {
        faces.iter_mut().for_each(flip);
    }
}

#[cfg(test)]
mod tests;
