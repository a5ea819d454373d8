//! Objects of a CityJSON document into surfaces.

use super::document::{Document, Geometry, MaterialTheme, Object, TextureTheme};
use super::geometry::{
    Face, choose, flatten, inner_shells, outward, shells, value_at, without_surfaces,
};
use super::kinds::{albedo, kind};
use super::tolerant::{Maybe, Nest, Table};
use crate::sources::LayerKind;
use crate::sources::error::read_bytes;
use crate::sources::place::Place;
use crate::sources::surfaces::{Corner, Surfaces, area_vector_m2};
use boresight_common::warning::Notes;
use boresight_models::maths::geodesy::SiteFrame;
use boresight_models::shape::textured::{Look, Texture};
use glam::{DMat4, DVec3};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// Longest side of a picture [px].
const LONGEST_PX: u32 = 16_384; // [px]

/// One kind of layer as it grows.
pub struct Gathered {
    /// What its triangles are.
    pub kind: LayerKind,
    /// Its polygons.
    pub surfaces: Surfaces,
    /// What is known of each object.
    pub features: Vec<Map<String, Value>>,
    /// Look of each texture of the document that is being read.
    pub looks: BTreeMap<usize, Option<usize>>,
}

/// What is found wrong or left out on the way.
#[derive(Default)]
pub struct Found {
    /// What the file's user should know.
    pub notes: Notes,
    /// Pictures that are missing or damaged.
    pictures: BTreeSet<String>,
    /// How many objects show another level of detail than the wanted, and the first of them.
    pub other_level: Option<(usize, String)>,
}

/// One document with what its objects need.
pub struct Reader<'a> {
    /// The document.
    pub document: &'a Document,
    /// The document that holds the templates: a sequence's first.
    pub templates: &'a Document,
    /// Its vertices in its coordinate reference system.
    pub source: Vec<DVec3>,
    /// Lowest and highest corner of what is no stray point.
    pub bounds: [DVec3; 2],
    /// Where it stands.
    pub place: &'a Place,
    /// The frame of the layers.
    pub site: &'a SiteFrame,
    /// Where its pictures lie.
    pub folder: &'a Path,
    /// The wanted level of detail.
    pub level: Option<f64>,
}

/// What an object's surfaces become, and what the record is called.
struct Target<'a> {
    gathered: &'a mut Gathered,
    found: &'a mut Found,
    object: &'a Object,
    /// Type and name.
    name: String,
    feature: u32,
}

impl Target<'_> {
    fn leave_out(&mut self, kind: &str) {
        self.found.notes.leave_out(kind, &self.name);
    }
}

impl Reader<'_> {
    /// Adds an object's chosen geometries; what cannot be read of it is counted.
    pub fn object(&self, id: &str, object: &Object, gathered: &mut Gathered, found: &mut Found) {
        let feature = gathered.features.len() as u32;
        let mut target = Target {
            gathered,
            found,
            object,
            name: format!("{} {id}", object.kind.or_empty()),
            feature,
        };
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut any = false;
        for geometry in self.chosen(id, &mut target) {
            let (geometry, corners) = match self.instance(geometry) {
                Ok(None) => (geometry, None),
                Ok(Some((template, corners))) => (template, Some(corners)),
                Err(what) => {
                    target.leave_out(what);
                    continue;
                }
            };
            let source = corners.as_deref().unwrap_or(&self.source);
            let before = target.found.notes.count_left_out();
            let [bottom, top] = self.geometry(geometry, source, &mut target);
            let nothing = bottom > top;
            if nothing && target.found.notes.count_left_out() == before {
                target.leave_out("geometries without surfaces");
            }
            any |= !nothing;
            (low, high) = (low.min(bottom), high.max(top));
        }
        if any {
            let mut known = Map::new();
            known.insert("id".into(), id.into());
            known.insert("type".into(), object.kind.or_empty().into());
            if let Some(parent) = object.parents.0.iter().find_map(|p| p.0.as_ref()) {
                known.insert("parent".into(), parent.clone().into());
            }
            known.insert("bottom".into(), low.into());
            known.insert("top".into(), high.into());
            for (key, value) in &object.attributes.0 {
                known.entry(key.clone()).or_insert_with(|| value.clone());
            }
            target.gathered.features.push(known);
        }
    }

    /// The geometries of an object that are shown; those that make no surfaces are counted.
    fn chosen<'g>(&'g self, id: &str, target: &mut Target<'g>) -> Vec<&'g Geometry> {
        let object = target.object;
        let mut with_surfaces = Vec::new();
        for geometry in &object.geometry.0 {
            let Maybe(Some(geometry)) = geometry else {
                target.leave_out("damaged geometries");
                continue;
            };
            let shown = self.template(geometry).unwrap_or(geometry);
            let kind = shown.kind.or_empty();
            match without_surfaces(kind) {
                Some(what) if kind != "GeometryInstance" => target.leave_out(what),
                _ => with_surfaces.push((geometry, shown.level())),
            }
        }
        let group = object.kind.or_empty() == "CityObjectGroup";
        if object.geometry.0.is_empty() && object.children.0.is_empty() && !group {
            target.leave_out("objects without geometry");
        }
        let (chosen, level) = choose(&with_surfaces, self.level);
        let other = self.level.is_some_and(|wanted| wanted != level);
        if other && !chosen.is_empty() {
            let first = || (0, format!("{} {id}", object.kind.or_empty()));
            target.found.other_level.get_or_insert_with(first).0 += 1;
        }
        chosen
    }

    /// Adds the surfaces of a geometry; the lowest and highest height of those that have an area.
    fn geometry(&self, geometry: &Geometry, source: &[DVec3], target: &mut Target) -> [f64; 2] {
        let kind = geometry.kind.or_empty();
        for _ in 0..inner_shells(&geometry.boundaries, kind) {
            target.leave_out("inner shells of solids");
        }
        if geometry.material.0.len() > 1 || geometry.texture.0.len() > 1 {
            target.leave_out("further themes of an appearance");
        }
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (number, shell) in shells(&geometry.boundaries, kind).iter().enumerate() {
            let mut faces = Vec::new();
            let mut heights = Vec::new();
            for (k, surface) in shell.iter().enumerate() {
                match self.face(geometry, source, surface, [number, k]) {
                    Ok(face) => {
                        faces.push(face);
                        let corners = surface.items().iter().flat_map(Nest::items);
                        let corners = corners.filter_map(|k| source.get(k.index()?));
                        heights.push(corners.fold([f64::INFINITY, f64::NEG_INFINITY], |at, r| {
                            [at[0].min(r.z), at[1].max(r.z)]
                        }));
                    }
                    Err(what) => target.leave_out(what),
                }
            }
            let semantics = geometry.semantics.0.as_ref();
            outward(&mut faces, kind, target.gathered.kind, semantics);
            for (face, [bottom, top]) in faces.iter().zip(heights) {
                if self.add(geometry, face, target) {
                    (low, high) = (low.min(bottom), high.max(top));
                } else {
                    target.leave_out("surfaces without an area");
                }
            }
        }
        [low, high]
    }

    /// The template that an instance shows.
    fn template(&self, geometry: &Geometry) -> Option<&Geometry> {
        let template = geometry.template.index()?;
        let own = |document: &Document| {
            let templates = document.templates.0.as_ref();
            templates.is_some_and(|it| !it.templates.0.is_empty())
        };
        let holder = [self.templates, self.document]
            .into_iter()
            .find(|d| own(d))?;
        let templates = &holder.templates.0.as_ref()?.templates.0;
        templates.get(template)?.0.as_ref()
    }

    /// The template that an instance shows, and its vertices in the source's coordinates; none for a geometry of its own.
    fn instance(
        &self,
        geometry: &Geometry,
    ) -> Result<Option<(&Geometry, Vec<DVec3>)>, &'static str> {
        if geometry.template.index().is_none() {
            return match geometry.kind.or_empty() {
                "GeometryInstance" => Err("instances without a template"),
                _ => Ok(None),
            };
        }
        let shown = self.template(geometry);
        let shown = shown.ok_or("instances of a template that does not exist")?;
        let reference = geometry.boundaries.items().first().and_then(Nest::index);
        let reference = reference.and_then(|k| self.source.get(k));
        let reference = reference.filter(|r| r.is_finite());
        let reference = reference.ok_or("instances about a point that does not exist")?;
        let rows: Vec<f64> = geometry.matrix.0.iter().map(|v| v.0).collect();
        let rows = <[f64; 16]>::try_from(rows).ok();
        let rows = rows.filter(|rows| {
            rows.iter().all(|v| v.is_finite()) && rows[12..] == [0.0, 0.0, 0.0, 1.0]
        });
        let rows = rows.ok_or(
            "instances whose transformationMatrix is not 16 numbers, row by row, the last 0 0 0 1",
        )?;
        let matrix = DMat4::from_cols_array(&rows).transpose();
        let holders = [self.templates, self.document].into_iter();
        let holder = holders.filter_map(|d| d.templates.0.as_ref());
        let holder = holder
            .into_iter()
            .find(|templates| !templates.templates.0.is_empty());
        let vertices = holder.map_or(&[][..], |templates| &templates.vertices.0);
        let place =
            |r: &super::tolerant::Point| *reference + matrix.transform_point3(DVec3::from(r.0));
        Ok(Some((shown, vertices.iter().map(place).collect())))
    }

    /// A surface in the layer's frame; otherwise why it is none.
    fn face(
        &self,
        geometry: &Geometry,
        source: &[DVec3],
        surface: &Nest,
        [shell, number]: [usize; 2],
    ) -> Result<Face, &'static str> {
        let mut rings = Vec::new();
        let textures = self.texture_of(geometry, shell, number);
        let mut texture = None;
        for (n, ring) in surface.items().iter().enumerate() {
            let uv = textures.and_then(|nest| nest.items().get(n));
            let uv = uv.map_or(&[][..], Nest::items);
            texture = texture.or(uv.first().and_then(Nest::index));
            let mut corners = Vec::new();
            for (k, index) in ring.items().iter().enumerate() {
                let r = index.index().and_then(|index| source.get(index));
                let r = r.ok_or("surfaces with a vertex that does not exist")?;
                if !r.is_finite() {
                    return Err("surfaces with a vertex that is no point");
                }
                let inside = r.cmpge(self.bounds[0]).all() && r.cmple(self.bounds[1]).all();
                if !inside {
                    return Err("surfaces a hundred kilometres from the rest");
                }
                let uv = uv.get(k + 1).and_then(Nest::index);
                let uv = uv.and_then(|k| self.document.texture_vertex(k));
                let [u, v] = uv.unwrap_or([0.0; 2]);
                let r_ecef_m = self.place.ecef_m(*r);
                let r_ecef_m = r_ecef_m.map_err(|_| "surfaces outside the coordinate system")?;
                corners.push(Corner {
                    r_m: self.site.ecef_to_enu(r_ecef_m),
                    uv: [u as f32, (1.0 - v) as f32],
                });
            }
            corners.dedup_by(|a, b| a.r_m == b.r_m);
            let ends = corners.first().zip(corners.last());
            if corners.len() > 1 && ends.is_some_and(|(a, b)| a.r_m == b.r_m) {
                corners.pop();
            }
            if corners.len() >= 3 {
                rings.push(corners);
            } else if n == 0 {
                return Err("surfaces of fewer than three corners");
            }
        }
        if rings.is_empty() {
            return Err("surfaces without corners");
        }
        let semantics = geometry.semantics.0.as_ref();
        Ok(Face {
            rings,
            semantics: semantics.and_then(|s| value_at(&s.values, shell, number)),
            material: self.material_of(geometry, shell, number),
            texture,
        })
    }

    /// The texture's numbers of a surface, of the theme that is shown.
    fn texture_of<'g>(
        &self,
        geometry: &'g Geometry,
        shell: usize,
        number: usize,
    ) -> Option<&'g Nest> {
        let [_, name] = self.document.themes();
        let values = &shown::<TextureTheme>(&geometry.texture, name)?.values;
        // Rings of a surface: three levels down from a solid's shells, two from a multi-surface.
        let kind = geometry.kind.or_empty();
        let own = match kind {
            "Solid" | "MultiSolid" | "CompositeSolid" => {
                flatten(values, kind).get(shell).copied()?
            }
            _ => values,
        };
        own.items().get(number)
    }

    /// The material of a surface, of the theme that is shown.
    fn material_of(&self, geometry: &Geometry, shell: usize, number: usize) -> Option<usize> {
        let [name, _] = self.document.themes();
        let theme = shown::<MaterialTheme>(&geometry.material, name)?;
        let all = theme.value.index();
        all.or_else(|| value_at(&theme.values, shell, number))
    }

    /// Adds a face to its mesh; whether it has an area.
    fn add(&self, geometry: &Geometry, face: &Face, target: &mut Target) -> bool {
        let semantics = geometry.semantics.0.as_ref();
        let semantics = face.semantics.and_then(|k| semantics?.kind(k));
        let normal = area_vector_m2(&face.rings[0]).normalize_or_zero();
        let material = face.material.and_then(|k| self.document.material(k));
        let object = target.object.kind.or_empty();
        let mut color = material.unwrap_or_else(|| albedo(object, semantics, normal.z));
        let look = face.texture.and_then(|k| self.look(k, target));
        if look.is_some() {
            color = [1.0; 4];
        }
        let surfaces = &mut target.gathered.surfaces;
        surfaces.polygon(&face.rings, target.feature, color, look.unwrap_or(0))
    }

    /// The look of a texture; none where its picture is missing, which is counted once.
    fn look(&self, texture: usize, target: &mut Target) -> Option<usize> {
        if let Some(known) = target.gathered.looks.get(&texture) {
            return *known;
        }
        let name = self.document.image(texture).unwrap_or("without a picture");
        let picture = self.image(name);
        if picture.is_none() && target.found.pictures.insert(name.into()) {
            let kind = "textures whose picture is missing or damaged";
            target.found.notes.leave_out(kind, name);
        }
        let look = picture.map(|texture| {
            target.gathered.surfaces.add_look(Look {
                texture: Some(Arc::new(texture)),
                ..Look::default()
            })
        });
        target.gathered.looks.insert(texture, look);
        look
    }

    /// A picture beside the file; `None` where it is missing or damaged: the surface then has its plain colour.
    fn image(&self, name: &str) -> Option<Texture> {
        let bytes = read_bytes(&self.folder.join(name)).ok()?;
        let mut reader = image::ImageReader::new(std::io::Cursor::new(bytes))
            .with_guessed_format()
            .ok()?;
        let mut limits = image::Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(LONGEST_PX), Some(LONGEST_PX));
        reader.limits(limits);
        let picture = reader.decode().ok()?.to_rgba8();
        Some(Texture {
            size_px: [picture.width(), picture.height()],
            rgba: picture.into_raw(),
        })
    }
}

/// The theme of a name, or else the first.
fn shown<'a, T>(themes: &'a Table<Maybe<T>>, name: Option<&str>) -> Option<&'a T> {
    let named = name.and_then(|name| themes.0.get(name));
    let theme = named.or_else(|| themes.0.values().find(|theme| theme.0.is_some()))?;
    theme.0.as_ref()
}

/// The objects of all documents into the layers that they belong to.
pub fn gather(readers: &[Reader], kinds: &mut [Gathered], found: &mut Found) {
    for reader in readers {
        kinds.iter_mut().for_each(|gathered| gathered.looks.clear());
        for (id, object) in &reader.document.objects.0 {
            let Maybe(Some(object)) = object else {
                found.notes.leave_out("damaged objects", id);
                continue;
            };
            let kind = kind(object.kind.or_empty());
            let own = kinds.iter_mut().find(|gathered| gathered.kind == kind);
            if let Some(gathered) = own {
                reader.object(id, object, gathered, found);
            }
        }
    }
}
