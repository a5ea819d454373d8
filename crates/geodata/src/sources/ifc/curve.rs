//! Corners of IFC curves.

use super::model::{DEEPEST, Lost, Model, numbers};
use glam::{DAffine3, DVec2, DVec3};
use ifc_lite_core::{AttributeValue, DecodedEntity, IfcType};
use std::f64::consts::TAU;

/// Corners of a full circle.
pub const CORNERS: usize = 32;
/// Corners of a span of a spline.
const SPAN_CORNERS: usize = 8;

/// Points nearer than this are one [m²].
const SAME_M2: f64 = 1e-12; // [m²]

impl Model<'_> {
    /// Corners of the closed curve that an attribute refers to [m], the first not repeated.
    pub fn ring(&mut self, entity: &DecodedEntity, slot: usize) -> Result<Vec<DVec2>, Lost> {
        let curve = self.need(entity, slot)?;
        self.closed(&curve)
    }

    /// Corners of a closed curve [m], the first not repeated.
    pub fn closed(&mut self, curve: &DecodedEntity) -> Result<Vec<DVec2>, Lost> {
        let mut points = self.curve(curve, DEEPEST)?;
        let ends = points.first().zip(points.last());
        if points.len() > 3 && ends.is_some_and(|(a, b)| a.distance_squared(*b) < SAME_M2) {
            points.pop();
        }
        let flat = points.iter().map(|p| p.truncate()).collect::<Vec<_>>();
        let sound = flat.len() >= 3;
        sound.then_some(flat).ok_or_else(|| Lost::damaged(curve))
    }

    /// Corners of a curve from its beginning to its end [m].
    pub fn curve(&mut self, curve: &DecodedEntity, depth: usize) -> Result<Vec<DVec3>, Lost> {
        let damaged = || Lost::damaged(curve);
        let depth = depth.checked_sub(1).ok_or_else(damaged)?;
        self.spend().ok_or_else(damaged)?;
        let mut points = match curve.ifc_type {
            IfcType::IfcPolyline => {
                let points = self.all(curve, 0);
                let place = |p: &DecodedEntity| Some(numbers(p.get_list(0)?)? * self.unit_m);
                points.iter().map(place).collect::<Option<Vec<DVec3>>>()
            }
            IfcType::IfcIndexedPolyCurve => self.indexed(curve),
            IfcType::IfcCompositeCurve
            | IfcType::IfcCompositeCurveOnSurface
            | IfcType::IfcBoundaryCurve
            | IfcType::IfcOuterBoundaryCurve => Some(self.composite(curve, depth)?),
            IfcType::IfcTrimmedCurve => Some(self.trimmed(curve, depth)?),
            IfcType::IfcCircle | IfcType::IfcEllipse => {
                let (placement, radii) = self.conic(curve)?;
                Some(turn(placement, radii, 0.0, TAU))
            }
            IfcType::IfcBSplineCurveWithKnots | IfcType::IfcRationalBSplineCurveWithKnots => {
                self.spline(curve)
            }
            IfcType::IfcSurfaceCurve | IfcType::IfcSeamCurve | IfcType::IfcIntersectionCurve => {
                let curve = self.need(curve, 0)?;
                Some(self.curve(&curve, depth)?)
            }
            _ => return Err(Lost::kind(curve, "curves")),
        }
        .ok_or_else(damaged)?;
        points.dedup_by(|a, b| a.distance_squared(*b) < SAME_M2);
        let finite = points.len() >= 2 && points.iter().all(|p| p.is_finite());
        finite.then_some(points).ok_or_else(damaged)
    }

    /// The segments of a composite curve, one after the other.
    fn composite(&mut self, curve: &DecodedEntity, depth: usize) -> Result<Vec<DVec3>, Lost> {
        let mut points: Vec<DVec3> = Vec::new();
        for segment in self.all(curve, 0) {
            if segment.ifc_type == IfcType::IfcCurveSegment {
                return Err(Lost::kind(&segment, "of curves"));
            }
            let parent = self.need(&segment, 2)?;
            let mut part = self.curve(&parent, depth)?;
            if segment.get(1).and_then(AttributeValue::as_enum) == Some("F") {
                part.reverse();
            }
            points.extend(part);
        }
        Ok(points)
    }

    /// Placement and radii [m] of a circle or an ellipse.
    fn conic(&mut self, curve: &DecodedEntity) -> Result<(DAffine3, DVec2), Lost> {
        let placement = self.axes_at(curve, 0)?;
        let x = curve.get_float(1);
        let y = match curve.ifc_type {
            IfcType::IfcEllipse => curve.get_float(2),
            _ => x,
        };
        let radii = x.zip(y).map(|(x, y)| DVec2::new(x, y) * self.unit_m);
        let sound = radii.filter(|r| r.is_finite() && r.min_element() > 0.0);
        Ok((placement, sound.ok_or_else(|| Lost::damaged(curve))?))
    }

    /// A part of a line, circle or ellipse, between two parameters or points.
    fn trimmed(&mut self, curve: &DecodedEntity, depth: usize) -> Result<Vec<DVec3>, Lost> {
        let damaged = || Lost::damaged(curve);
        let basis = self.need(curve, 0)?;
        let by_points = curve.get(4).and_then(AttributeValue::as_enum) == Some("CARTESIAN");
        let agrees = curve.get(3).and_then(AttributeValue::as_enum) != Some("F");
        let (from, to) = (self.trim(curve, 1), self.trim(curve, 2));
        match basis.ifc_type {
            IfcType::IfcLine => {
                let origin = self.vector(&basis, 0).ok_or_else(damaged)? * self.unit_m;
                let arm = self.need(&basis, 1)?;
                let along = self.vector(&arm, 0).and_then(DVec3::try_normalize);
                let along = along.zip(arm.get_float(1)).ok_or_else(damaged)?;
                let along = along.0 * along.1 * self.unit_m;
                let end = |(parameter, point): (Option<f64>, Option<DVec3>)| {
                    let by_parameter = parameter.map(|t| origin + along * t);
                    if by_points {
                        point.or(by_parameter)
                    } else {
                        by_parameter.or(point)
                    }
                };
                let ends = end(from).zip(end(to)).ok_or_else(damaged)?;
                Ok(vec![ends.0, ends.1])
            }
            IfcType::IfcCircle | IfcType::IfcEllipse => {
                let (placement, radii) = self.conic(&basis)?;
                let all = [from.0, to.0].into_iter().flatten();
                let angle_rad = self.angle(all, curve);
                let end = |(parameter, point): (Option<f64>, Option<DVec3>)| {
                    let by_parameter = parameter.map(|t| t * angle_rad);
                    let by_point = point.map(|point| {
                        let own = placement.inverse().transform_point3(point).truncate() / radii;
                        own.to_angle()
                    });
                    if by_points {
                        by_point.or(by_parameter)
                    } else {
                        by_parameter.or(by_point)
                    }
                };
                let (from, to) = end(from).zip(end(to)).ok_or_else(damaged)?;
                let sweep = if agrees { to - from } else { from - to };
                let sweep = match sweep.rem_euclid(TAU) {
                    none if none < 1e-9 || TAU - none < 1e-9 => TAU,
                    some => some,
                };
                Ok(turn(
                    placement,
                    radii,
                    from,
                    if agrees { sweep } else { -sweep },
                ))
            }
            // Between its own ends the whole curve is meant.
            _ => {
                let mut points = self.curve(&basis, depth)?;
                let near = |point: Option<DVec3>, end: Option<&DVec3>| {
                    point.zip(end).is_some_and(|(a, b)| a.distance(*b) < 1e-3)
                };
                if !agrees {
                    points.reverse();
                }
                let whole = near(from.1, points.first()) && near(to.1, points.last());
                whole
                    .then_some(points)
                    .ok_or_else(|| Lost::kind(curve, "curves on splines and polylines"))
            }
        }
    }

    /// The parameter and the point [m] that a trimmed curve states for an end.
    fn trim(&mut self, curve: &DecodedEntity, slot: usize) -> (Option<f64>, Option<DVec3>) {
        let list = curve.get_list(slot).unwrap_or_default();
        let parameter = list.iter().find_map(AttributeValue::as_float);
        let id = list.iter().find_map(AttributeValue::as_entity_ref);
        let point = id.and_then(|id| self.entity(id));
        let point = point.and_then(|p| numbers(p.get_list(0)?));
        (
            parameter.filter(|t| t.is_finite()),
            point.map(|p| p * self.unit_m),
        )
    }

    /// Radians in the unit of some angles: degrees where no unit is stated and radians would be more than a turn.
    pub fn angle(&mut self, angles: impl Iterator<Item = f64>, record: &DecodedEntity) -> f64 {
        let most = angles.fold(0.0_f64, |most, angle| most.max(angle.abs()));
        if self.angle_stated || most <= TAU + 1e-3 {
            return self.angle_rad;
        }
        let what = "no plane-angle unit is assigned and some angles are more than a turn in radians: taken as degrees";
        self.notes.assume(
            record.ifc_type.name(),
            what,
            "assign a PLANEANGLEUNIT to the project",
        );
        TAU / 360.0
    }

    /// `IfcIndexedPolyCurve`: lines, and arcs through three points.
    fn indexed(&mut self, curve: &DecodedEntity) -> Option<Vec<DVec3>> {
        let list = self.at(curve, 0)?;
        let place = |p: &AttributeValue| Some(numbers(p.as_list()?)? * self.unit_m);
        let points = list.get_list(0)?.iter().map(place);
        let points = points.collect::<Option<Vec<DVec3>>>()?;
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
                let k = usize::try_from(k.as_int()?).ok()?.checked_sub(1)?;
                points.get(k).copied()
            });
            let ends = ends.collect::<Option<Vec<DVec3>>>()?;
            match (&**name, &ends[..]) {
                ("IFCARCINDEX", &[a, b, c]) => found.extend(arc(a, b, c)),
                _ => found.extend(ends),
            }
        }
        Some(found)
    }

    /// Points of a B-spline with knots, rational or not (de Boor).
    fn spline(&mut self, curve: &DecodedEntity) -> Option<Vec<DVec3>> {
        let degree = usize::try_from(curve.get(0)?.as_int()?).ok()?;
        let controls = self.all(curve, 1);
        let controls = controls.iter().map(|p| numbers(p.get_list(0)?));
        let controls = controls.collect::<Option<Vec<DVec3>>>()?;
        let weights = match curve.get_list(8) {
            Some(list) => list
                .iter()
                .map(AttributeValue::as_float)
                .collect::<Option<Vec<f64>>>()?,
            None => vec![1.0; controls.len()],
        };
        if !(1..=16).contains(&degree) || controls.len() <= degree {
            return None;
        }
        let wanted = controls.len() + degree + 1;
        let times = curve.get_list(5)?.iter().map(AttributeValue::as_int);
        let values = curve.get_list(6)?.iter().map(AttributeValue::as_float);
        let mut knots = Vec::new();
        for (times, value) in times.zip(values) {
            let times = usize::try_from(times?).ok()?.min(degree + 1);
            knots.extend(std::iter::repeat_n(value?, times));
            if knots.len() > wanted {
                return None;
            }
        }
        let sound = weights.len() == controls.len()
            && knots.len() == wanted
            && knots.windows(2).all(|pair| pair[0] <= pair[1]);
        if !sound {
            return None;
        }
        let points: Vec<[f64; 4]> = (controls.iter().zip(&weights))
            .map(|(p, w)| [p.x * w, p.y * w, p.z * w, *w])
            .collect();
        let mut found = Vec::new();
        for k in degree..controls.len() {
            let (from, to) = (knots[k], knots[k + 1]);
            let steps = (0..=SPAN_CORNERS).filter(|_| to > from);
            for step in steps {
                let t = from + (to - from) * step as f64 / SPAN_CORNERS as f64;
                let [x, y, z, w] = de_boor(&points, &knots, degree, k, t);
                found.push(DVec3::new(x, y, z) / w * self.unit_m);
            }
        }
        Some(found)
    }
}

/// A point of a B-spline in the span after knot `k`.
fn de_boor(points: &[[f64; 4]], knots: &[f64], degree: usize, k: usize, t: f64) -> [f64; 4] {
    let mut own: Vec<[f64; 4]> = points[k - degree..=k].to_vec();
    for round in 1..=degree {
        for j in (round..=degree).rev() {
            let (low, high) = (knots[j + k - degree], knots[j + 1 + k - round]);
            let share = if high > low {
                (t - low) / (high - low)
            } else {
                0.0
            };
            own[j] = std::array::from_fn(|n| own[j - 1][n] * (1.0 - share) + own[j][n] * share);
        }
    }
    own[degree]
}

/// Corners of a turn about a placement from an angle on, over a sweep [rad].
fn turn(placement: DAffine3, radii: DVec2, from: f64, sweep: f64) -> Vec<DVec3> {
    let steps = ((sweep.abs() / TAU * CORNERS as f64 - 1e-9).ceil() as usize).clamp(2, CORNERS);
    let corner = |k: usize| {
        let own = DVec2::from_angle(from + sweep * k as f64 / steps as f64) * radii;
        placement.transform_point3(own.extend(0.0))
    };
    (0..=steps).map(corner).collect()
}

/// Corners of the arc through three points.
fn arc(a: DVec3, b: DVec3, c: DVec3) -> Vec<DVec3> {
    let (u, v) = (b - a, c - a);
    let normal = u.cross(v);
    if normal.length() < 1e-12 {
        return vec![a, b, c];
    }
    let twice = 2.0 * normal.length_squared();
    let center =
        a + (u.length_squared() * v.cross(normal) + v.length_squared() * normal.cross(u)) / twice;
    let radius = a.distance(center);
    let x = (a - center) / radius;
    let y = normal.normalize().cross(x);
    let angle = |p: DVec3| {
        let arm = p - center;
        arm.dot(y).atan2(arm.dot(x)).rem_euclid(TAU)
    };
    let sweep = angle(c);
    let steps = ((sweep / TAU * CORNERS as f64 - 1e-9).ceil() as usize).max(2);
    let corner = |k: usize| {
        let angle = sweep * k as f64 / steps as f64;
        center + (x * angle.cos() + y * angle.sin()) * radius
    };
    (0..=steps).map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arc_passes_its_three_points() {
        for (a, b, c) in [
            ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]),
            ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]),
            ([5.0, 3.0, 1.0], [6.0, 3.5, 1.5], [5.5, 5.0, 2.0]),
        ] {
            let [a, b, c] = [a, b, c].map(DVec3::from);
            let points = arc(a, b, c);
            assert!(points[0].distance(a) < 1e-9 && points.last().unwrap().distance(c) < 1e-9);
            let near = points
                .iter()
                .map(|p| p.distance(b))
                .fold(f64::INFINITY, f64::min);
            assert!(near < 0.25, "{near}");
        }
    }

    #[test]
    fn a_rational_spline_of_degree_2_is_a_quarter_of_a_circle() {
        let half = 0.5_f64.sqrt();
        let points = [
            [1.0, 0.0, 0.0, 1.0],
            [half, half, 0.0, half],
            [0.0, 1.0, 0.0, 1.0],
        ];
        let knots = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        for k in 0..=10 {
            let [x, y, _, w] = de_boor(&points, &knots, 2, 2, f64::from(k) / 10.0);
            assert!(((x / w).hypot(y / w) - 1.0).abs() < 1e-12);
        }
    }
}
