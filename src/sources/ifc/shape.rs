//! Faces of IFC products.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use ifc_lite_core::{AttributeValue, DecodedEntity, EntityDecoder, IfcType};
use std::f64::consts::TAU;

/// Deepest nesting of placements, mapped items and Boolean operands.
const DEEPEST: usize = 32;
/// Most faces of a file.
const MOST_FACES: usize = 8_000_000;
/// Most representation items of a file, each time counted that a map shows it.
const MOST_ITEMS: usize = 1_000_000;
/// Corners of a full circle.
const CORNERS: usize = 32;

/// Rings of a face: outline and holes.
type Face = Vec<Vec<DVec3>>;

/// A file's records.
pub struct Model<'a> {
    decoder: EntityDecoder<'a>,
    unit_m: f64,
    left: usize,
    items_left: usize,
}

impl<'a> Model<'a> {
    /// A model whose lengths are in units of `unit_m` [m].
    pub fn new(decoder: EntityDecoder<'a>, unit_m: f64) -> Self {
        Self {
            decoder,
            unit_m,
            left: MOST_FACES,
            items_left: MOST_ITEMS,
        }
    }

    /// A record; none where it is missing or damaged.
    pub fn entity(&mut self, id: u32) -> Option<DecodedEntity> {
        self.decoder.decode_by_id(id).ok()
    }

    /// Whether the file made more faces than are held.
    pub fn exhausted(&self) -> bool {
        self.left == 0 || self.items_left == 0
    }

    fn at(&mut self, entity: &DecodedEntity, slot: usize) -> Option<DecodedEntity> {
        let id = entity.get_ref(slot)?;
        self.entity(id)
    }

    fn all(&mut self, entity: &DecodedEntity, slot: usize) -> Vec<DecodedEntity> {
        let ids = entity.get_refs(slot).unwrap_or_default();
        ids.into_iter().filter_map(|id| self.entity(id)).collect()
    }

    /// A point or direction of two or three numbers, as they stand.
    fn vector(&mut self, entity: &DecodedEntity, slot: usize) -> Option<DVec3> {
        let found = self.at(entity, slot)?;
        Self::numbers(found.get_list(0)?)
    }

    fn numbers(list: &[AttributeValue]) -> Option<DVec3> {
        let number = |k: usize| list.get(k).map_or(Some(0.0), AttributeValue::as_float);
        Some(DVec3::new(number(0)?, number(1)?, number(2)?)).filter(|v| v.is_finite())
    }

    /// `IfcAxis2Placement3D` or `2D`, in metres.
    fn axis_placement(&mut self, placement: &DecodedEntity) -> Option<DAffine3> {
        let origin = self.vector(placement, 0)? * self.unit_m;
        if placement.ifc_type == IfcType::IfcAxis2Placement2D {
            let x = self.vector(placement, 1).unwrap_or(DVec3::X);
            return Some(axes(origin, DVec3::Z, x));
        }
        let z = self.vector(placement, 1).unwrap_or(DVec3::Z);
        let x = self.vector(placement, 2).unwrap_or(DVec3::X);
        Some(axes(origin, z, x))
    }

    /// A product's placement in the model.
    fn placement(&mut self, product: &DecodedEntity) -> DAffine3 {
        let mut found = DAffine3::IDENTITY;
        let mut next = self.at(product, 5);
        for _ in 0..DEEPEST {
            let Some(placement) = next.filter(|p| p.ifc_type == IfcType::IfcLocalPlacement) else {
                break;
            };
            let own = self
                .at(&placement, 1)
                .and_then(|own| self.axis_placement(&own));
            found = own.unwrap_or(DAffine3::IDENTITY) * found;
            next = self.at(&placement, 0);
        }
        found
    }

    /// The faces of a product's body in the model's frame [m].
    pub fn faces(&mut self, product: &DecodedEntity) -> Vec<Face> {
        let Some(shape) = self.at(product, 6) else {
            return Vec::new();
        };
        let placement = self.placement(product);
        let mut found = Vec::new();
        for representation in self.all(&shape, 2) {
            let name = representation.get_string(1).unwrap_or("Body").to_string();
            if !["Body", "Facetation", "Surface", "Tessellation"].contains(&name.as_str()) {
                continue;
            }
            for item in self.all(&representation, 3) {
                self.item(&item, placement, DEEPEST, &mut found);
            }
        }
        found
    }

    /// Adds a representation item's faces.
    fn item(&mut self, item: &DecodedEntity, to: DAffine3, depth: usize, found: &mut Vec<Face>) {
        if depth == 0 || self.exhausted() {
            return;
        }
        self.items_left -= 1;
        match item.ifc_type {
            IfcType::IfcMappedItem => {
                let Some((map, target)) = self.at(item, 0).zip(self.at(item, 1)) else {
                    return;
                };
                let origin = self
                    .at(&map, 0)
                    .and_then(|o| self.axis_placement(&o))
                    .unwrap_or(DAffine3::IDENTITY);
                let Some((representation, operator)) = self.at(&map, 1).zip(self.operator(&target))
                else {
                    return;
                };
                let to = to * operator * origin.inverse();
                for inner in self.all(&representation, 3) {
                    self.item(&inner, to, depth - 1, found);
                }
            }
            IfcType::IfcBooleanResult | IfcType::IfcBooleanClippingResult => {
                // The first operand, uncut.
                if let Some(first) = self.at(item, 1) {
                    self.item(&first, to, depth - 1, found);
                }
            }
            IfcType::IfcExtrudedAreaSolid | IfcType::IfcExtrudedAreaSolidTapered => {
                if let Some(faces) = self.extrusion(item) {
                    self.push(faces, to, found);
                }
            }
            IfcType::IfcFacetedBrep
            | IfcType::IfcFacetedBrepWithVoids
            | IfcType::IfcManifoldSolidBrep => {
                if let Some(shell) = self.at(item, 0) {
                    let faces = self.shell(&shell);
                    self.push(faces, to, found);
                }
            }
            IfcType::IfcShellBasedSurfaceModel | IfcType::IfcFaceBasedSurfaceModel => {
                for shell in self.all(item, 0) {
                    let faces = self.shell(&shell);
                    self.push(faces, to, found);
                }
            }
            IfcType::IfcTriangulatedFaceSet | IfcType::IfcPolygonalFaceSet => {
                if let Some(faces) = self.face_set(item) {
                    self.push(faces, to, found);
                }
            }
            _ => {}
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

    /// `IfcCartesianTransformationOperator3D`, with one scale or three.
    fn operator(&mut self, operator: &DecodedEntity) -> Option<DAffine3> {
        let origin = self.vector(operator, 2)? * self.unit_m;
        let x = self.vector(operator, 0).unwrap_or(DVec3::X);
        let three = operator.ifc_type != IfcType::IfcCartesianTransformationOperator2D;
        let z = if three {
            self.vector(operator, 4)
        } else {
            None
        };
        let y = self.vector(operator, 1);
        let z = z.or_else(|| y.map(|y| x.cross(y))).unwrap_or(DVec3::Z);
        let mut found = axes(origin, z, x);
        // A second axis against the right hand's mirrors.
        if y.is_some_and(|y| y.dot(found.matrix3.y_axis) < 0.0) {
            found.matrix3.y_axis = -found.matrix3.y_axis;
        }
        let scale = operator.get_float(3).unwrap_or(1.0);
        let own = |slot| operator.get_float(slot).unwrap_or(scale);
        let scales = match operator.ifc_type {
            IfcType::IfcCartesianTransformationOperator3DnonUniform => {
                DVec3::new(scale, own(5), own(6))
            }
            _ => DVec3::splat(scale),
        };
        let sound = scales.is_finite() && scales.abs().min_element() > 1e-9;
        found.matrix3 *= DMat3::from_diagonal(scales);
        sound.then_some(found)
    }

    /// Faces of a shell, or of a connected set of faces.
    fn shell(&mut self, shell: &DecodedEntity) -> Vec<Face> {
        let mut faces = Vec::new();
        for face in self.all(shell, 0) {
            let mut rings: Face = Vec::new();
            for bound in self.all(&face, 0) {
                let Some(looped) = self
                    .at(&bound, 0)
                    .filter(|l| l.ifc_type == IfcType::IfcPolyLoop)
                else {
                    continue;
                };
                let points = self.all(&looped, 0);
                let mut ring: Vec<DVec3> = points
                    .iter()
                    .filter_map(|p| Some(Self::numbers(p.get_list(0)?)? * self.unit_m))
                    .collect();
                if bound.get(1).and_then(AttributeValue::as_enum) == Some("F") {
                    ring.reverse();
                }
                if bound.ifc_type == IfcType::IfcFaceOuterBound {
                    rings.insert(0, ring);
                } else {
                    rings.push(ring);
                }
            }
            rings.retain(|ring| ring.len() >= 3);
            if !rings.is_empty() && faces.len() < self.left {
                faces.push(rings);
            }
        }
        faces
    }

    /// `IfcTriangulatedFaceSet` or `IfcPolygonalFaceSet`.
    fn face_set(&mut self, set: &DecodedEntity) -> Option<Vec<Face>> {
        let list = self.at(set, 0)?;
        let points: Vec<DVec3> = (list.get_list(0)?.iter())
            .map(|p| p.as_list().and_then(Self::numbers).unwrap_or(DVec3::NAN) * self.unit_m)
            .collect();
        let point = |index: &AttributeValue| {
            points
                .get(usize::try_from(index.as_int()?).ok()?.checked_sub(1)?)
                .copied()
        };
        let ring = |list: &[AttributeValue]| list.iter().map(point).collect::<Option<Vec<DVec3>>>();
        if set.ifc_type == IfcType::IfcTriangulatedFaceSet {
            let triangles = set.get_list(3)?.iter().filter_map(|t| ring(t.as_list()?));
            return Some(triangles.map(|t| vec![t]).collect());
        }
        let faces = set.get_refs(2)?;
        let mut found = Vec::new();
        for id in faces {
            let Some(face) = self.entity(id) else {
                continue;
            };
            let Some(outline) = face.get_list(0).and_then(ring) else {
                continue;
            };
            let holes = face.get_list(1).unwrap_or(&[]).iter();
            let holes = holes.filter_map(|hole| ring(hole.as_list()?));
            found.push(std::iter::once(outline).chain(holes).collect());
        }
        Some(found)
    }

    /// Floor, top and sides of an extruded area.
    fn extrusion(&mut self, solid: &DecodedEntity) -> Option<Vec<Face>> {
        let profile = self.at(solid, 0)?;
        let placement = self
            .at(solid, 1)
            .and_then(|p| self.axis_placement(&p))
            .unwrap_or(DAffine3::IDENTITY);
        let direction = self.vector(solid, 2).unwrap_or(DVec3::Z).try_normalize()?;
        let depth = solid.get_float(3).filter(|d| d.is_finite() && *d > 0.0)?;
        let arm = direction * depth * self.unit_m;
        let mut rings = self.profile(&profile, DEEPEST)?;
        for (k, ring) in rings.iter_mut().enumerate() {
            let twice: f64 = (0..ring.len())
                .map(|i| ring[i].perp_dot(ring[(i + 1) % ring.len()]))
                .sum();
            // The outline counter-clockwise, holes clockwise, seen from where the extrusion goes.
            if (twice > 0.0) != ((k == 0) == (arm.z > 0.0)) {
                ring.reverse();
            }
        }
        let bottom: Face = rings
            .iter()
            .map(|ring| ring.iter().map(|p| p.extend(0.0)).collect())
            .collect();
        let mut faces = vec![
            bottom
                .iter()
                .map(|ring| ring.iter().rev().copied().collect())
                .collect(),
            bottom
                .iter()
                .map(|ring| ring.iter().map(|p| *p + arm).collect())
                .collect(),
        ];
        for ring in &bottom {
            for (k, &a) in ring.iter().enumerate() {
                let b = ring[(k + 1) % ring.len()];
                faces.push(vec![vec![a, b, b + arm, a + arm]]);
            }
        }
        let all = faces.iter_mut().flatten().flatten();
        all.for_each(|r| *r = placement.transform_point3(*r));
        Some(faces)
    }

    /// Rings of a profile [m]: outline and holes.
    fn profile(&mut self, profile: &DecodedEntity, depth: usize) -> Option<Vec<Vec<DVec2>>> {
        let unit_m = self.unit_m;
        let number = |slot: usize| {
            profile
                .get_float(slot)
                .filter(|v| v.is_finite() && *v > 0.0)
                .map(|v| v * unit_m)
        };
        let rectangle = |x: f64, y: f64| {
            [(-x, -y), (x, -y), (x, y), (-x, y)]
                .map(|(x, y)| DVec2::new(x, y) / 2.0)
                .to_vec()
        };
        let circle = |x: f64, y: f64| -> Vec<DVec2> {
            let corner =
                |k: usize| DVec2::from_angle(TAU * k as f64 / CORNERS as f64) * DVec2::new(x, y);
            (0..CORNERS).map(corner).collect()
        };
        let mut rings = match profile.ifc_type {
            IfcType::IfcArbitraryClosedProfileDef => {
                return Some(vec![self.curve_at(profile, 2, depth)?]);
            }
            IfcType::IfcArbitraryProfileDefWithVoids => {
                let mut rings = vec![self.curve_at(profile, 2, depth)?];
                for hole in self.all(profile, 3) {
                    rings.extend(self.curve(&hole, depth).filter(|ring| ring.len() >= 3));
                }
                return Some(rings);
            }
            IfcType::IfcRectangleProfileDef | IfcType::IfcRoundedRectangleProfileDef => {
                vec![rectangle(number(3)?, number(4)?)]
            }
            IfcType::IfcRectangleHollowProfileDef => {
                let (x, y, wall) = (number(3)?, number(4)?, number(5)?);
                vec![
                    rectangle(x, y),
                    rectangle((x - 2.0 * wall).max(0.0), (y - 2.0 * wall).max(0.0)),
                ]
            }
            IfcType::IfcCircleProfileDef => vec![circle(number(3)?, number(3)?)],
            IfcType::IfcCircleHollowProfileDef => {
                let inner = (number(3)? - number(4)?).max(0.0);
                vec![circle(number(3)?, number(3)?), circle(inner, inner)]
            }
            IfcType::IfcEllipseProfileDef => vec![circle(number(3)?, number(4)?)],
            IfcType::IfcIShapeProfileDef => {
                let (w, h, web, flange) = (
                    number(3)? / 2.0,
                    number(4)? / 2.0,
                    number(5)? / 2.0,
                    number(6)?,
                );
                let right = [
                    (w, -h),
                    (w, flange - h),
                    (web, flange - h),
                    (web, h - flange),
                    (w, h - flange),
                    (w, h),
                ];
                let left = right.iter().rev().map(|(x, y)| (-x, *y));
                vec![
                    right
                        .into_iter()
                        .chain(left)
                        .map(|(x, y)| DVec2::new(x, y))
                        .collect(),
                ]
            }
            IfcType::IfcLShapeProfileDef => {
                let (h, w, t) = (number(3)?, number(4).or(number(3))?, number(5)?);
                let all = [(0.0, 0.0), (w, 0.0), (w, t), (t, t), (t, h), (0.0, h)];
                vec![
                    all.map(|(x, y)| DVec2::new(x - w / 2.0, y - h / 2.0))
                        .to_vec(),
                ]
            }
            _ => return None,
        };
        if let Some(placement) = self.at(profile, 2).and_then(|p| self.axis_placement(&p)) {
            let all = rings.iter_mut().flatten();
            all.for_each(|p| *p = placement.transform_point3(p.extend(0.0)).truncate());
        }
        rings.retain(|ring| ring.iter().any(|p| *p != ring[0]));
        Some(rings).filter(|rings| !rings.is_empty())
    }

    fn curve_at(
        &mut self,
        entity: &DecodedEntity,
        slot: usize,
        depth: usize,
    ) -> Option<Vec<DVec2>> {
        let curve = self.at(entity, slot)?;
        self.curve(&curve, depth).filter(|ring| ring.len() >= 3)
    }

    /// Corners of a flat closed curve [m], or of a part of one.
    fn curve(&mut self, curve: &DecodedEntity, depth: usize) -> Option<Vec<DVec2>> {
        let depth = depth.checked_sub(1)?;
        let mut points = match curve.ifc_type {
            IfcType::IfcPolyline => {
                let points = self.all(curve, 0);
                let flat = |p: &DecodedEntity| {
                    Some(Self::numbers(p.get_list(0)?)?.truncate() * self.unit_m)
                };
                points.iter().map(flat).collect::<Option<Vec<DVec2>>>()?
            }
            IfcType::IfcIndexedPolyCurve => self.indexed(curve)?,
            IfcType::IfcCompositeCurve => {
                let mut points: Vec<DVec2> = Vec::new();
                for segment in self.all(curve, 0) {
                    let parent = self.at(&segment, 2)?;
                    let mut part = self.curve(&parent, depth)?;
                    if segment.get(1).and_then(AttributeValue::as_enum) == Some("F") {
                        part.reverse();
                    }
                    points.extend(part);
                }
                points
            }
            IfcType::IfcCircle | IfcType::IfcEllipse => {
                let placement = self.at(curve, 0).and_then(|p| self.axis_placement(&p))?;
                let (x, y) = (
                    curve.get_float(1)?,
                    curve.get_float(2).or(curve.get_float(1))?,
                );
                let corner = |k: usize| {
                    DVec2::from_angle(TAU * k as f64 / CORNERS as f64)
                        * DVec2::new(x, y)
                        * self.unit_m
                };
                (0..CORNERS)
                    .map(|k| placement.transform_point3(corner(k).extend(0.0)).truncate())
                    .collect()
            }
            _ => return None,
        };
        points.dedup_by(|a, b| a.distance_squared(*b) < 1e-12);
        if points.len() > 3
            && points
                .first()
                .zip(points.last())
                .is_some_and(|(a, b)| a.distance_squared(*b) < 1e-12)
        {
            points.pop();
        }
        Some(points).filter(|points| points.iter().all(|p| p.is_finite()))
    }

    /// `IfcIndexedPolyCurve`: lines, and arcs through three points.
    fn indexed(&mut self, curve: &DecodedEntity) -> Option<Vec<DVec2>> {
        let list = self.at(curve, 0)?;
        let flat = |p: &AttributeValue| Some(Self::numbers(p.as_list()?)?.truncate() * self.unit_m);
        let points = list
            .get_list(0)?
            .iter()
            .map(flat)
            .collect::<Option<Vec<DVec2>>>()?;
        let Some(segments) = curve.get_list(1) else {
            return Some(points);
        };
        let mut found = Vec::new();
        for segment in segments {
            let AttributeValue::Typed { name, value } = segment else {
                return None;
            };
            let indices = value.as_list()?.iter();
            let ends = indices.map(|k| {
                points
                    .get(usize::try_from(k.as_int()?).ok()?.checked_sub(1)?)
                    .copied()
            });
            let ends = ends.collect::<Option<Vec<DVec2>>>()?;
            match (&**name, &ends[..]) {
                ("IFCARCINDEX", &[a, b, c]) => found.extend(arc(a, b, c)),
                _ => found.extend(ends),
            }
        }
        Some(found)
    }
}

/// A placement about a place with two axes, as `IfcAxis2Placement3D` has them.
fn axes(origin: DVec3, z: DVec3, x: DVec3) -> DAffine3 {
    let z = z.try_normalize().unwrap_or(DVec3::Z);
    let x = (x - z * x.dot(z))
        .try_normalize()
        .unwrap_or_else(|| z.any_orthonormal_vector());
    DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), origin)
}

/// Corners of the arc through three points.
fn arc(a: DVec2, b: DVec2, c: DVec2) -> Vec<DVec2> {
    let (u, v) = (b - a, c - a);
    let twice = 2.0 * u.perp_dot(v);
    if twice.abs() < 1e-12 {
        return vec![a, b, c];
    }
    let center = a + (u.length_squared() * v - v.length_squared() * u).perp() / twice * -1.0;
    let (from, radius) = ((a - center).to_angle(), a.distance(center));
    let turn = |p: DVec2| ((p - center).to_angle() - from).rem_euclid(TAU);
    let sweep = if turn(b) <= turn(c) {
        turn(c)
    } else {
        turn(c) - TAU
    };
    let steps = ((sweep.abs() / TAU * CORNERS as f64).ceil() as usize).max(2);
    (0..=steps)
        .map(|k| center + DVec2::from_angle(from + sweep * k as f64 / steps as f64) * radius)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arc_passes_its_three_points() {
        for (a, b, c) in [
            (
                DVec2::new(1.0, 0.0),
                DVec2::new(0.0, 1.0),
                DVec2::new(-1.0, 0.0),
            ),
            (
                DVec2::new(1.0, 0.0),
                DVec2::new(0.0, -1.0),
                DVec2::new(-1.0, 0.0),
            ),
            (
                DVec2::new(5.0, 3.0),
                DVec2::new(6.0, 3.5),
                DVec2::new(5.5, 5.0),
            ),
        ] {
            let points = arc(a, b, c);
            assert!(points[0].distance(a) < 1e-9 && points.last().unwrap().distance(c) < 1e-9);
            let near = points
                .iter()
                .map(|p| p.distance(b))
                .fold(f64::INFINITY, f64::min);
            assert!(near < 0.25, "{near}");
        }
    }
}
