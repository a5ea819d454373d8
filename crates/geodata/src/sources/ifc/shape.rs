//! Faces of IFC products.

use super::brep::outwards;
use super::curve::CORNERS;
use super::model::{DEEPEST, Face, Lost, Model, numbers};
use super::profile::Area;
use crate::sources::whole;
use glam::{DAffine3, DVec2, DVec3};
use ifc_lite_core::{AttributeValue, DecodedEntity, IfcType};
use std::f64::consts::TAU;

/// Representations that show something else than the body, by their identifiers in small letters.
const BESIDE_THE_BODY: [&str; 15] = [
    "axis",
    "box",
    "footprint",
    "annotation",
    "profile",
    "reference",
    "clearance",
    "cog",
    "plan",
    "lighting",
    "surveypoints",
    "fillet",
    "grid",
    "referenceline",
    "body-fallback",
];

impl Model<'_> {
    /// The faces of a product's body in the model's frame [m]; what it has beside those is counted as left out.
    pub fn faces(&mut self, product: &DecodedEntity) -> Result<Vec<Face>, Lost> {
        let mut found = Vec::new();
        if product.get(6).is_none_or(AttributeValue::is_null) {
            return Ok(found);
        }
        let shape = self.need(product, 6)?;
        let placement = self.placement(product)?;
        let all = self.all(&shape, 2);
        let named = |representation: &DecodedEntity| {
            let name = representation.get_string(1).unwrap_or("Body");
            name.to_lowercase()
        };
        let (beside, bodies): (Vec<_>, Vec<_>) = all
            .iter()
            .partition(|one| BESIDE_THE_BODY.contains(&named(one).as_str()));
        for representation in &bodies {
            self.items(representation, 3, placement, DEEPEST, &mut found);
        }
        // A body in simpler forms, where its own is not read.
        let fallback = beside.iter().filter(|one| named(one) == "body-fallback");
        for representation in fallback.filter(|_| found.is_empty()).collect::<Vec<_>>() {
            self.items(representation, 3, placement, DEEPEST, &mut found);
        }
        if bodies.is_empty() && found.is_empty() {
            let names: Vec<_> = beside.iter().filter_map(|one| one.get_string(1)).collect();
            return Err(Lost {
                kind: "products without a body".into(),
                place: format!("#{} with {}", product.id, names.join(", ")),
            });
        }
        Ok(found)
    }

    /// Adds the faces of the items that an attribute lists.
    fn items(
        &mut self,
        entity: &DecodedEntity,
        slot: usize,
        to: DAffine3,
        depth: usize,
        found: &mut Vec<Face>,
    ) {
        for id in entity.get_refs(slot).unwrap_or_default() {
            let made = match self.entity(id) {
                Some(item) => self.item(&item, to, depth, found),
                None => Err(Lost {
                    kind: "shape items that are missing or damaged".into(),
                    place: format!("#{id}"),
                }),
            };
            if let Err(lost) = made {
                self.leave_out(lost);
            }
        }
    }

    /// Adds a representation item's faces.
    fn item(
        &mut self,
        item: &DecodedEntity,
        to: DAffine3,
        depth: usize,
        found: &mut Vec<Face>,
    ) -> Result<(), Lost> {
        if self.exhausted() {
            return Ok(());
        }
        let deeper = depth.checked_sub(1).ok_or_else(|| Lost::damaged(item))?;
        self.spend();
        match item.ifc_type {
            IfcType::IfcMappedItem => {
                let (map, target) = (self.need(item, 0)?, self.need(item, 1)?);
                let origin = self.axes_at(&map, 0)?;
                let representation = self.need(&map, 1)?;
                let to = to * self.operator(&target)? * origin.inverse();
                self.items(&representation, 3, to, deeper, found);
            }
            IfcType::IfcBooleanResult | IfcType::IfcBooleanClippingResult => {
                let first = self.need(item, 1)?;
                let union = item.get(0).and_then(AttributeValue::as_enum) == Some("UNION");
                self.item(&first, to, deeper, found)?;
                if union {
                    let second = self.need(item, 2)?;
                    self.item(&second, to, deeper, found)?;
                } else {
                    self.leave_out(Lost {
                        kind: "cuts of Boolean operations (the first operand stands uncut)".into(),
                        place: format!("#{}", item.id),
                    });
                }
            }
            IfcType::IfcCsgSolid => {
                let root = self.need(item, 0)?;
                self.item(&root, to, deeper, found)?;
            }
            IfcType::IfcFacetedBrep
            | IfcType::IfcFacetedBrepWithVoids
            | IfcType::IfcAdvancedBrep
            | IfcType::IfcAdvancedBrepWithVoids
            | IfcType::IfcManifoldSolidBrep => {
                let shell = self.need(item, 0)?;
                let mut faces = self.shell(&shell);
                outwards(&mut faces);
                self.push(faces, to, found);
                for void in item.get_refs(1).unwrap_or_default() {
                    self.leave_out(Lost {
                        kind: "voids inside B-reps".into(),
                        place: format!("#{void}"),
                    });
                }
            }
            IfcType::IfcShellBasedSurfaceModel | IfcType::IfcFaceBasedSurfaceModel => {
                for shell in self.all(item, 0) {
                    let faces = self.shell(&shell);
                    self.push(faces, to, found);
                }
            }
            _ => {
                let mut faces = self.solid(item)?;
                if matches!(
                    item.ifc_type,
                    IfcType::IfcTriangulatedFaceSet | IfcType::IfcPolygonalFaceSet
                ) {
                    outwards(&mut faces);
                }
                self.push(faces, to, found);
            }
        }
        Ok(())
    }

    /// The faces of an item that holds no others.
    fn solid(&mut self, item: &DecodedEntity) -> Result<Vec<Face>, Lost> {
        match item.ifc_type {
            IfcType::IfcExtrudedAreaSolid | IfcType::IfcExtrudedAreaSolidTapered => {
                self.extrusion(item)
            }
            IfcType::IfcRevolvedAreaSolid => self.revolution(item),
            IfcType::IfcTriangulatedFaceSet
            | IfcType::IfcTriangulatedIrregularNetwork
            | IfcType::IfcPolygonalFaceSet => {
                self.face_set(item).ok_or_else(|| Lost::damaged(item))
            }
            IfcType::IfcBlock => {
                let placement = self.axes_at(item, 0)?;
                let size = self.lengths(item, [1, 2, 3])?;
                let corners = [
                    (0.0, 0.0),
                    (size[0], 0.0),
                    (size[0], size[1]),
                    (0.0, size[1]),
                ];
                let area = vec![corners.map(DVec2::from).to_vec()];
                let up = DAffine3::from_translation(DVec3::Z * size[2]);
                Ok(between(&area, &area, placement, up))
            }
            IfcType::IfcRightCircularCylinder | IfcType::IfcRightCircularCone => {
                let placement = self.axes_at(item, 0)?;
                let [height, radius] = self.lengths(item, [1, 2])?;
                let area = vec![circle(radius)];
                let end = match item.ifc_type {
                    IfcType::IfcRightCircularCone => vec![vec![DVec2::ZERO; CORNERS]],
                    _ => area.clone(),
                };
                let up = DAffine3::from_translation(DVec3::Z * height);
                Ok(between(&area, &end, placement, up))
            }
            IfcType::IfcRectangularPyramid => {
                let placement = self.axes_at(item, 0)?;
                let [x, y, height] = self.lengths(item, [1, 2, 3])?;
                let corners = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)];
                let area = vec![corners.map(DVec2::from).to_vec()];
                let end = vec![vec![DVec2::new(x, y) / 2.0; 4]];
                let up = DAffine3::from_translation(DVec3::Z * height);
                Ok(between(&area, &end, placement, up))
            }
            IfcType::IfcSweptDiskSolid | IfcType::IfcSweptDiskSolidPolygonal => self.pipe(item),
            _ => Err(Lost::kind(item, "shape items")),
        }
    }

    /// Adds faces through a placement; a mirroring one turns them.
    fn push(&mut self, faces: Vec<Face>, to: DAffine3, found: &mut Vec<Face>) {
        let mirrors = to.matrix3.determinant() < 0.0;
        for mut face in faces.into_iter().take(self.left) {
            for ring in &mut face {
                ring.iter_mut().for_each(|r| *r = to.transform_point3(*r));
                if mirrors {
                    ring.reverse();
                }
            }
            self.left -= 1;
            found.push(face);
        }
    }

    /// `IfcTriangulatedFaceSet` (also an irregular network) or `IfcPolygonalFaceSet`.
    fn face_set(&mut self, set: &DecodedEntity) -> Option<Vec<Face>> {
        let list = self.at(set, 0)?;
        let points: Vec<DVec3> = (list.get_list(0)?.iter())
            .map(|p| p.as_list().and_then(numbers).unwrap_or(DVec3::NAN) * self.unit_m)
            .collect();
        let polygons = set.ifc_type == IfcType::IfcPolygonalFaceSet;
        // Where a list of numbers stands between the faces and the points, they count in it.
        let between = set.get_list(if polygons { 3 } else { 4 });
        let between = between.filter(|list| list.iter().all(|k| k.as_int().is_some()));
        let one = |index: &AttributeValue| usize::try_from(index.as_int()?).ok()?.checked_sub(1);
        let point = |index: &AttributeValue| {
            let mut k = one(index)?;
            if let Some(between) = between {
                k = one(between.get(k)?)?;
            }
            points.get(k).copied().filter(|p| p.is_finite())
        };
        let ring = |list: &[AttributeValue]| list.iter().map(point).collect::<Option<Vec<DVec3>>>();
        let mut lost = 0;
        let mut found: Vec<Face> = Vec::new();
        if polygons {
            for id in set.get_refs(2)? {
                let face = self.entity(id);
                let rings = face.and_then(|face| {
                    let outline = ring(face.get_list(0)?)?;
                    let holes = face.get_list(1).unwrap_or(&[]).iter();
                    let holes = holes.map(|hole| ring(hole.as_list()?));
                    std::iter::once(Some(outline)).chain(holes).collect()
                });
                match rings {
                    Some(rings) => found.push(rings),
                    None => lost += 1,
                }
            }
        } else {
            for triangle in set.get_list(3)? {
                match triangle.as_list().and_then(ring) {
                    Some(triangle) => found.push(vec![triangle]),
                    None => lost += 1,
                }
            }
        }
        for _ in 0..lost {
            self.leave_out(Lost {
                kind: "faces of sets with points that do not exist".into(),
                place: format!("#{}", set.id),
            });
        }
        Some(found)
    }

    /// Floor, top and sides of an extruded area, tapered or not.
    fn extrusion(&mut self, solid: &DecodedEntity) -> Result<Vec<Face>, Lost> {
        let damaged = || Lost::damaged(solid);
        let profile = self.need(solid, 0)?;
        let placement = self.axes_at(solid, 1)?;
        let direction = self.vector(solid, 2).and_then(DVec3::try_normalize);
        let direction = direction.ok_or_else(damaged)?;
        let [depth] = self.lengths(solid, [3])?;
        let arm = DAffine3::from_translation(direction * depth);
        let mut areas = self.profile(&profile, DEEPEST)?;
        if solid.ifc_type != IfcType::IfcExtrudedAreaSolidTapered {
            areas = self.mended(areas, &profile);
        }
        let mut ends = areas.clone();
        if solid.ifc_type == IfcType::IfcExtrudedAreaSolidTapered {
            let end = self.need(solid, 4)?;
            let end = self.profile(&end, DEEPEST)?;
            let corners = |areas: &[Area]| -> Vec<Vec<usize>> {
                let of = |area: &Area| area.iter().map(Vec::len).collect();
                areas.iter().map(of).collect()
            };
            if corners(&end) == corners(&ends) {
                ends = end;
            } else {
                let mut lost = Lost::damaged(solid);
                lost.kind = "tapers between different outlines (made straight)".into();
                self.leave_out(lost);
            }
        }
        let pairs = areas.iter().zip(&ends);
        Ok(pairs
            .flat_map(|(area, end)| between(area, end, placement, arm))
            .collect())
    }

    /// Areas whose outlines and voids cross or touch, as areas that do not; where those hold another area, it is noted.
    fn mended(&mut self, areas: Vec<Area>, profile: &DecodedEntity) -> Vec<Area> {
        let mut found = Vec::with_capacity(areas.len());
        for area in areas {
            let Some(mended) = whole::mended(&area) else {
                found.push(area);
                continue;
            };
            if mended.other_area {
                let place = format!("#{} {}", profile.id, profile.ifc_type.name());
                let what =
                    "it crosses itself or its voids: taken as what it runs around, less the voids";
                self.notes
                    .assume(place, what, "draw it anew where that is not meant");
            }
            found.extend(mended.shapes);
        }
        found
    }

    /// An area turned about an axis in its plane.
    fn revolution(&mut self, solid: &DecodedEntity) -> Result<Vec<Face>, Lost> {
        let damaged = || Lost::damaged(solid);
        let profile = self.need(solid, 0)?;
        let placement = self.axes_at(solid, 1)?;
        let axis = self.need(solid, 2)?;
        let origin = self.vector(&axis, 0).ok_or_else(damaged)? * self.unit_m;
        let along = self.vector(&axis, 1).unwrap_or(DVec3::Z);
        let along = along.try_normalize().ok_or_else(damaged)?;
        let angle = solid.get_float(3).ok_or_else(damaged)?;
        let angle = angle * self.angle([angle].into_iter(), solid);
        let whole = angle.abs() > TAU - 1e-6;
        let angle = angle.clamp(-TAU, TAU);
        let steps = ((angle.abs() / TAU * CORNERS as f64 - 1e-9).ceil() as usize).max(1);
        let turned = |k: usize| {
            let angle = angle * k as f64 / steps as f64;
            DAffine3::from_translation(origin)
                * DAffine3::from_axis_angle(along, angle)
                * DAffine3::from_translation(-origin)
        };
        let areas = self.profile(&profile, DEEPEST)?;
        let areas = self.mended(areas, &profile);
        let mut faces = Vec::new();
        for area in &areas {
            let mut own = Vec::new();
            for k in 0..steps {
                let step = turned(k).inverse() * turned(k + 1);
                let mut part = between(area, area, placement * turned(k), step);
                // Ends only where the turn begins and ends.
                let (first, last) = (k == 0 && !whole, k + 1 == steps && !whole);
                let ends: Vec<Face> = part.drain(..2).collect();
                let keep = [first, last].into_iter().zip(ends);
                own.extend(keep.filter_map(|(keep, face)| keep.then_some(face)));
                own.extend(part);
            }
            outward(&mut own);
            faces.extend(own);
        }
        Ok(faces)
    }
}

fn circle(radius: f64) -> Vec<DVec2> {
    let corner = |k: usize| DVec2::from_angle(TAU * k as f64 / CORNERS as f64) * radius;
    (0..CORNERS).map(corner).collect()
}

/// The faces between an area and another of as many corners, moved by `arm`: the two ends, then the sides.
fn between(area: &Area, end: &Area, placement: DAffine3, arm: DAffine3) -> Vec<Face> {
    let up = arm.translation.z >= 0.0;
    let sided = |area: &Area| -> Vec<(usize, bool)> {
        let turned = |(k, ring): (usize, &Vec<DVec2>)| {
            let twice: f64 = (0..ring.len())
                .map(|i| ring[i].perp_dot(ring[(i + 1) % ring.len()]))
                .sum();
            // The outline counter-clockwise, holes clockwise, seen from where the extrusion goes.
            (k, (twice > 0.0) != ((k == 0) == up))
        };
        area.iter().enumerate().map(turned).collect()
    };
    let flips = sided(area);
    let lift = |area: &Area, to: DAffine3| -> Face {
        let ring = |(k, flip): &(usize, bool)| {
            let points = area[*k].iter();
            let mut ring: Vec<DVec3> = points.map(|p| to.transform_point3(p.extend(0.0))).collect();
            if *flip {
                ring.reverse();
            }
            ring
        };
        flips.iter().map(ring).collect()
    };
    let (bottom, top) = (lift(area, placement), lift(end, placement * arm));
    let back = |ring: &Vec<DVec3>| ring.iter().rev().copied().collect();
    let mut faces = vec![bottom.iter().map(back).collect(), top.clone()];
    for (low, high) in bottom.iter().zip(&top) {
        for k in 0..low.len() {
            let next = (k + 1) % low.len();
            let (a, b, c, d) = (low[k], low[next], high[next], high[k]);
            if ((b - a).cross(c - a)).dot(d - a).abs() < 1e-9 {
                faces.push(vec![vec![a, b, c, d]]);
            } else {
                faces.extend([vec![vec![a, b, c]], vec![vec![a, c, d]]]);
            }
        }
    }
    faces
}

/// Turns the faces of a closed solid so that they are seen from outside.
fn outward(faces: &mut [Face]) {
    let corner = |face: &Face| face.first().and_then(|ring| ring.first()).copied();
    let Some(origin) = faces.iter().find_map(corner) else {
        return;
    };
    let pyramids = |ring: &Vec<DVec3>| -> f64 {
        let arms = ring.windows(2);
        arms.map(|pair| (ring[0] - origin).dot((pair[0] - origin).cross(pair[1] - origin)))
            .sum()
    };
    if faces.iter().flatten().map(pyramids).sum::<f64>() < 0.0 {
        faces.iter_mut().flatten().for_each(|ring| ring.reverse());
    }
}
