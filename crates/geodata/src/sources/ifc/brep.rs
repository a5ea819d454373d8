//! Faces of B-reps and surface models.

use super::model::{DEEPEST, Face, Lost, Model, numbers};
use crate::sources::surfaces::{Corner, area_vector_m2};
use glam::DVec3;
use ifc_lite_core::{AttributeValue, DecodedEntity, IfcType};

/// Corners without places in a texture.
fn corners(ring: &[DVec3]) -> Vec<Corner> {
    ring.iter().copied().map(Corner::from).collect()
}

/// Turns the faces of a closed shell that is inside out. Of one that is not closed the sense of its faces counts.
pub fn outwards(faces: &mut [Face]) {
    let rings = || faces.iter().flatten();
    let Some(origin) = rings().flatten().next().copied() else {
        return;
    };
    // The area vectors of a closed shell add up to nothing.
    let sum = |of: &dyn Fn(&Vec<DVec3>) -> f64| rings().map(of).sum::<f64>();
    let all: DVec3 = rings().map(|ring| area_vector_m2(&corners(ring))).sum();
    let areas = sum(&|ring| area_vector_m2(&corners(ring)).length());
    let volume = sum(&|ring| (ring[0] - origin).dot(area_vector_m2(&corners(ring))));
    if all.length() < 1e-6 * areas && volume < 0.0 {
        for ring in faces.iter_mut().flatten() {
            ring.reverse();
        }
    }
}

impl Model<'_> {
    /// Faces of a shell, or of a connected set of faces.
    pub fn shell(&mut self, shell: &DecodedEntity) -> Vec<Face> {
        let mut faces = Vec::new();
        for id in shell.get_refs(0).unwrap_or_default() {
            let face = self.entity(id).ok_or_else(|| Lost {
                kind: "faces that are missing or damaged".into(),
                place: format!("#{id}"),
            });
            match face.and_then(|face| self.face(&face)) {
                Ok(rings) if faces.len() < self.left => faces.push(rings),
                Ok(_) => {}
                Err(lost) => self.leave_out(lost),
            }
        }
        faces
    }

    /// The rings of a flat face.
    fn face(&mut self, face: &DecodedEntity) -> Result<Face, Lost> {
        if matches!(
            face.ifc_type,
            IfcType::IfcAdvancedFace | IfcType::IfcFaceSurface
        ) {
            let surface = self.need(face, 1)?;
            if surface.ifc_type != IfcType::IfcPlane {
                return Err(Lost::kind(&surface, "faces of curved B-reps"));
            }
        }
        let mut rings: Face = Vec::new();
        let mut outer = false;
        for bound in self.all(face, 0) {
            let looped = self.need(&bound, 0)?;
            let mut ring = match looped.ifc_type {
                IfcType::IfcPolyLoop => {
                    let points = self.all(&looped, 0);
                    let place = |p: &DecodedEntity| Some(numbers(p.get_list(0)?)? * self.unit_m);
                    let found = points.iter().map(place).collect::<Option<Vec<_>>>();
                    found.ok_or_else(|| Lost::damaged(&looped))?
                }
                IfcType::IfcEdgeLoop => self.edges(&looped)?,
                _ => return Err(Lost::kind(&looped, "of faces")),
            };
            if bound.get(1).and_then(AttributeValue::as_enum) == Some("F") {
                ring.reverse();
            }
            if bound.ifc_type == IfcType::IfcFaceOuterBound {
                outer = true;
                rings.insert(0, ring);
            } else {
                rings.push(ring);
            }
        }
        rings.retain(|ring| ring.len() >= 3);
        if !outer {
            // The outline is what holds the others.
            let area = |ring: &Vec<DVec3>| area_vector_m2(&corners(ring)).length_squared();
            rings.sort_by(|a, b| area(b).total_cmp(&area(a)));
        }
        let some = !rings.is_empty();
        some.then_some(rings).ok_or_else(|| Lost::damaged(face))
    }

    /// Corners along the edges of a loop.
    fn edges(&mut self, looped: &DecodedEntity) -> Result<Vec<DVec3>, Lost> {
        let damaged = || Lost::damaged(looped);
        let mut ring = Vec::new();
        for oriented in self.all(looped, 0) {
            let edge = self.need(&oriented, 2)?;
            let mut ends = Vec::new();
            for slot in [0, 1] {
                let vertex = self.need(&edge, slot)?;
                ends.push(self.vector(&vertex, 0).ok_or_else(damaged)? * self.unit_m);
            }
            let curve = self.at(&edge, 2);
            let mut part = match curve {
                Some(curve) if curve.ifc_type != IfcType::IfcLine => {
                    // Against the curve's own sense the edge runs from its end to its beginning.
                    let against = edge.get(3).and_then(AttributeValue::as_enum) == Some("F");
                    if against {
                        ends.reverse();
                    }
                    let mut part = self.edge(&curve, [ends[0], ends[1]])?;
                    if against {
                        part.reverse();
                    }
                    part
                }
                _ => ends,
            };
            if oriented.get(3).and_then(AttributeValue::as_enum) == Some("F") {
                part.reverse();
            }
            // The next edge begins where this one ends.
            part.pop();
            ring.extend(part);
        }
        Ok(ring)
    }

    /// Corners of a curved edge between two of its points: the part of a closed curve, or the whole of an open one.
    fn edge(&mut self, curve: &DecodedEntity, ends: [DVec3; 2]) -> Result<Vec<DVec3>, Lost> {
        let mut points = self.curve(curve, DEEPEST)?;
        let n = points.len();
        let closed = n > 2 && points[0].distance(points[n - 1]) < 1e-6;
        if !closed {
            if points[0].distance(ends[1]) < points[0].distance(ends[0]) {
                points.reverse();
            }
            (points[0], points[n - 1]) = (ends[0], ends[1]);
            return Ok(points);
        }
        points.pop();
        let nearest = |end: DVec3| {
            let far = |k: &usize| points[*k].distance(end);
            (0..points.len()).min_by(|a, b| far(a).total_cmp(&far(b)))
        };
        let (from, to) = (nearest(ends[0]), nearest(ends[1]));
        let (from, to) = from.zip(to).ok_or_else(|| Lost::damaged(curve))?;
        let steps = match (to + points.len() - from) % points.len() {
            0 => points.len(),
            steps => steps,
        };
        let mut part: Vec<DVec3> = (0..=steps)
            .map(|k| points[(from + k) % points.len()])
            .collect();
        part[0] = ends[0];
        part[steps] = ends[1];
        Ok(part)
    }
}
