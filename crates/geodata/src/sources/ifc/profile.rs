//! Areas of IFC profiles.

use super::curve::CORNERS;
use super::model::{DEEPEST, Lost, Model};
use glam::{DAffine3, DVec2};
use ifc_lite_core::{DecodedEntity, IfcType};
use std::f64::consts::TAU;

/// An area: outline and holes [m].
pub type Area = Vec<Vec<DVec2>>;

/// A corner of an outline with the radius that rounds it [m].
type Corner = (DVec2, f64);

/// Corners of a quarter turn that rounds a corner.
const QUARTER: usize = CORNERS / 4;

impl Model<'_> {
    /// The areas of a profile [m].
    pub fn profile(&mut self, profile: &DecodedEntity, depth: usize) -> Result<Vec<Area>, Lost> {
        let damaged = || Lost::damaged(profile);
        let depth = depth.checked_sub(1).ok_or_else(damaged)?;
        self.spend().ok_or_else(damaged)?;
        match profile.ifc_type {
            IfcType::IfcArbitraryClosedProfileDef => Ok(vec![vec![self.ring(profile, 2)?]]),
            IfcType::IfcArbitraryProfileDefWithVoids => {
                let mut area = vec![self.ring(profile, 2)?];
                for hole in self.all(profile, 3) {
                    match self.closed(&hole) {
                        Ok(ring) => area.push(ring),
                        Err(lost) => self.leave_out(lost),
                    }
                }
                Ok(vec![area])
            }
            IfcType::IfcCenterLineProfileDef => {
                let curve = self.need(profile, 2)?;
                let line = self.curve(&curve, DEEPEST)?;
                let line: Vec<DVec2> = line.iter().map(|p| p.truncate()).collect();
                let width = profile.get_float(3).map(|w| w * self.unit_m);
                let width = width.filter(|w| w.is_finite() && *w > 0.0);
                Ok(vec![band(&line, width.ok_or_else(damaged)?)])
            }
            IfcType::IfcCompositeProfileDef => {
                let mut areas = Vec::new();
                for part in self.all(profile, 2) {
                    match self.profile(&part, depth) {
                        Ok(more) => areas.extend(more),
                        Err(lost) => self.leave_out(lost),
                    }
                }
                let some = !areas.is_empty();
                some.then_some(areas).ok_or_else(damaged)
            }
            IfcType::IfcDerivedProfileDef | IfcType::IfcMirroredProfileDef => {
                let parent = self.need(profile, 2)?;
                let mirror = DAffine3::from_scale(glam::DVec3::new(-1.0, 1.0, 1.0));
                let operator = match profile.ifc_type {
                    IfcType::IfcMirroredProfileDef => mirror,
                    _ => {
                        let operator = self.need(profile, 3)?;
                        self.operator(&operator)?
                    }
                };
                let mut areas = self.profile(&parent, depth)?;
                moved(&mut areas, operator);
                Ok(areas)
            }
            _ => {
                let placement = self.axes_at(profile, 2)?;
                let area = self.parametric(profile)?;
                let mut areas = vec![area];
                moved(&mut areas, placement);
                Ok(areas)
            }
        }
    }

    /// An area about its own place, from lengths and radii.
    fn parametric(&self, profile: &DecodedEntity) -> Result<Area, Lost> {
        let own = Sizes {
            profile,
            unit_m: self.unit_m,
            angle_rad: self.angle_rad,
        };
        let sound = |ring: &Vec<DVec2>| ring.len() >= 3 && ring.iter().all(|p| p.is_finite());
        let area = own.plain()?;
        let area = area.iter().all(sound).then_some(area);
        area.ok_or_else(|| Lost::damaged(profile))
    }
}

/// Lengths, radii and slopes of a profile.
struct Sizes<'a> {
    profile: &'a DecodedEntity,
    unit_m: f64,
    angle_rad: f64,
}

impl Sizes<'_> {
    /// A length, also a negative one [m].
    fn stated(&self, slot: usize) -> Option<f64> {
        self.profile.get_float(slot).map(|v| v * self.unit_m)
    }

    /// A positive length that may be absent [m].
    fn radius(&self, slot: usize) -> Option<f64> {
        self.stated(slot).filter(|v| v.is_finite() && *v > 0.0)
    }

    /// A positive length that must be there [m].
    fn length(&self, slot: usize) -> Result<f64, Lost> {
        let length = self.radius(slot);
        length.ok_or_else(|| Lost::damaged(self.profile))
    }

    /// A radius that is nothing where it is absent [m].
    fn r(&self, slot: usize) -> f64 {
        self.radius(slot).unwrap_or(0.0)
    }

    /// The tangent of an angle; nothing where it is absent, or as steep as no rolled section.
    fn slope(&self, slot: usize) -> f64 {
        let angle_rad = self.profile.get_float(slot).unwrap_or(0.0) * self.angle_rad;
        let tangent = Some(angle_rad.tan());
        tangent.filter(|s| s.abs() < 1.0).unwrap_or(0.0)
    }

    /// Rectangles, circles, trapezia; otherwise the shapes of rolled sections.
    fn plain(&self) -> Result<Area, Lost> {
        let own = self;
        let one = |corners: Vec<Corner>| vec![rounded(&corners)];
        Ok(match own.profile.ifc_type {
            IfcType::IfcRectangleProfileDef => one(rectangle(own.length(3)?, own.length(4)?, 0.0)),
            IfcType::IfcRoundedRectangleProfileDef => {
                one(rectangle(own.length(3)?, own.length(4)?, own.r(5)))
            }
            IfcType::IfcRectangleHollowProfileDef => {
                let (x, y, wall) = (own.length(3)?, own.length(4)?, own.length(5)?);
                let mut area = one(rectangle(x, y, own.r(7)));
                let inner = (x - 2.0 * wall, y - 2.0 * wall);
                if inner.0 > 0.0 && inner.1 > 0.0 {
                    area.push(rounded(&rectangle(inner.0, inner.1, own.r(6))));
                }
                area
            }
            IfcType::IfcCircleProfileDef => vec![ellipse(own.length(3)?, own.length(3)?)],
            IfcType::IfcCircleHollowProfileDef => {
                let inner = own.length(3)? - own.length(4)?;
                let mut area = vec![ellipse(own.length(3)?, own.length(3)?)];
                area.extend((inner > 0.0).then(|| ellipse(inner, inner)));
                area
            }
            IfcType::IfcEllipseProfileDef => vec![ellipse(own.length(3)?, own.length(4)?)],
            IfcType::IfcTrapeziumProfileDef => {
                let (bottom, top, y) = (own.length(3)?, own.length(4)?, own.length(5)? / 2.0);
                let from = own.stated(6).unwrap_or(0.0) - bottom / 2.0;
                one(sharp(&[
                    (-bottom / 2.0, -y),
                    (bottom / 2.0, -y),
                    (from + top, y),
                    (from, y),
                ]))
            }
            IfcType::IfcIShapeProfileDef | IfcType::IfcAsymmetricIShapeProfileDef => {
                one(own.double_flanged()?)
            }
            _ => one(own.rolled()?),
        })
    }

    /// I shapes, symmetric or not.
    fn double_flanged(&self) -> Result<Vec<Corner>, Lost> {
        let own = self;
        Ok(match own.profile.ifc_type {
            IfcType::IfcIShapeProfileDef => {
                let (width, thick) = (own.length(3)?, own.length(6)?);
                let flange = Flange {
                    width,
                    thick,
                    fillet: own.r(7),
                    edge: own.r(8),
                    slope: own.slope(9),
                };
                i_shape(own.length(4)?, own.length(5)?, flange, flange)
            }
            IfcType::IfcAsymmetricIShapeProfileDef => {
                // In IFC 2x3 the centre of gravity stands where the edges' radii stand since.
                let edges = own.profile.get(12).is_some();
                let edge = |slot| if edges { own.r(slot) } else { 0.0 };
                let bottom = Flange {
                    width: own.length(3)?,
                    thick: own.length(6)?,
                    fillet: own.r(7),
                    edge: edge(11),
                    slope: own.slope(12),
                };
                let top = Flange {
                    width: own.length(8)?,
                    thick: own.radius(9).unwrap_or(bottom.thick),
                    fillet: own.r(10),
                    edge: edge(13),
                    slope: own.slope(14),
                };
                i_shape(own.length(4)?, own.length(5)?, bottom, top)
            }
            _ => return Err(Lost::kind(own.profile, "profiles")),
        })
    }

    /// L, U, C, Z and T shapes.
    fn rolled(&self) -> Result<Vec<Corner>, Lost> {
        let own = self;
        Ok(match own.profile.ifc_type {
            IfcType::IfcLShapeProfileDef => {
                let (h, t) = (own.length(3)?, own.length(5)?);
                let w = own.radius(4).unwrap_or(h);
                let (fillet, edge, lean) = (own.r(6), own.r(7), own.slope(8));
                // The legs' thickness is that at their middle.
                let (dx, dy) = (lean * (w - t) / 2.0, lean * (h - t) / 2.0);
                let corners = [
                    (0.0, 0.0, 0.0),
                    (w, 0.0, 0.0),
                    (w, t - dx, edge),
                    (t + dy, t + dx, fillet),
                    (t - dy, h, edge),
                    (0.0, h, 0.0),
                ];
                corners
                    .map(|(x, y, r)| (DVec2::new(x - w / 2.0, y - h / 2.0), r))
                    .to_vec()
            }
            IfcType::IfcUShapeProfileDef => {
                let (h, b) = (own.length(3)? / 2.0, own.length(4)? / 2.0);
                let (web, thick) = (own.length(5)?, own.length(6)?);
                let (fillet, edge, lean) = (own.r(7), own.r(8), own.slope(9));
                // The flanges' thickness is that at their middle.
                let (tip, root) = (thick - lean * b, thick + lean * (b - web));
                let lower = [
                    (-b, -h, 0.0),
                    (b, -h, 0.0),
                    (b, tip - h, edge),
                    (web - b, root - h, fillet),
                ];
                with_mirror(&lower, |(x, y)| (x, -y))
            }
            IfcType::IfcCShapeProfileDef => {
                let (h, b) = (own.length(3)? / 2.0, own.length(4)? / 2.0);
                let (wall, girth, inner) = (own.length(5)?, own.length(6)?, own.r(7));
                let outer = if inner > 0.0 { inner + wall } else { 0.0 };
                let lower = [
                    (-b, -h, outer),
                    (b, -h, outer),
                    (b, girth - h, 0.0),
                    (b - wall, girth - h, 0.0),
                    (b - wall, wall - h, inner),
                    (wall - b, wall - h, inner),
                ];
                with_mirror(&lower, |(x, y)| (x, -y))
            }
            IfcType::IfcZShapeProfileDef => {
                let (h, b) = (own.length(3)? / 2.0, own.length(4)?);
                let (web, thick, fillet, edge) =
                    (own.length(5)? / 2.0, own.length(6)?, own.r(7), own.r(8));
                let lower = [
                    (-web, -h, 0.0),
                    (b - web, -h, 0.0),
                    (b - web, thick - h, edge),
                    (web, thick - h, fillet),
                ];
                turned_twice(&lower)
            }
            IfcType::IfcTShapeProfileDef => {
                let (h, b) = (own.length(3)? / 2.0, own.length(4)? / 2.0);
                let (web, thick) = (own.length(5)? / 2.0, own.length(6)?);
                let (web_lean, lean) = (own.slope(10), own.slope(11));
                // Thickness is that at the middle of a flange and of the web.
                let inner = thick + lean * (b / 2.0 - web);
                let tip = thick - lean * b / 2.0;
                let under = inner.min(2.0 * h);
                let (foot, neck) = (web - web_lean * h, web + web_lean * (h - thick));
                let right = [
                    (foot, -h, own.r(9)),
                    (neck, h - under, own.r(7)),
                    (b, h - tip, own.r(8)),
                    (b, h, 0.0),
                ];
                with_mirror(&right, |(x, y)| (-x, y))
            }
            _ => return Err(Lost::kind(own.profile, "profiles")),
        })
    }
}

/// A flange of an I: lengths [m] and the tangent of its inner side's slope.
#[derive(Clone, Copy)]
struct Flange {
    width: f64,
    thick: f64,
    fillet: f64,
    edge: f64,
    slope: f64,
}

/// An I of a depth and a web [m] between two flanges, whose thickness is that at the middle of each half.
fn i_shape(depth: f64, web: f64, bottom: Flange, top: Flange) -> Vec<Corner> {
    let (h, web) = (depth / 2.0, web / 2.0);
    let ends = |f: &Flange| {
        let half = (f.width / 2.0 - web) / 2.0;
        (f.thick - f.slope * half, f.thick + f.slope * half)
    };
    let ((low_tip, low_root), (high_tip, high_root)) = (ends(&bottom), ends(&top));
    let right = [
        (bottom.width / 2.0, -h, 0.0),
        (bottom.width / 2.0, low_tip - h, bottom.edge),
        (web, low_root - h, bottom.fillet),
        (web, h - high_root, top.fillet),
        (top.width / 2.0, h - high_tip, top.edge),
        (top.width / 2.0, h, 0.0),
    ];
    with_mirror(&right, |(x, y)| (-x, y))
}

/// Corners, then their mirror images from the last to the first.
fn with_mirror(half: &[(f64, f64, f64)], mirror: impl Fn((f64, f64)) -> (f64, f64)) -> Vec<Corner> {
    let own = half.iter().map(|(x, y, r)| (DVec2::new(*x, *y), *r));
    let other = half.iter().rev().map(|(x, y, r)| {
        let (x, y) = mirror((*x, *y));
        (DVec2::new(x, y), *r)
    });
    own.chain(other).collect()
}

/// Corners, then the same turned by half a turn.
fn turned_twice(half: &[(f64, f64, f64)]) -> Vec<Corner> {
    let own = half.iter().map(|(x, y, r)| (DVec2::new(*x, *y), *r));
    let other = half.iter().map(|(x, y, r)| (DVec2::new(-*x, -*y), *r));
    own.chain(other).collect()
}

fn sharp(corners: &[(f64, f64)]) -> Vec<Corner> {
    let corner = |(x, y): &(f64, f64)| (DVec2::new(*x, *y), 0.0);
    corners.iter().map(corner).collect()
}

fn rectangle(x: f64, y: f64, radius: f64) -> Vec<Corner> {
    let all = [(-x, -y), (x, -y), (x, y), (-x, y)];
    all.map(|(x, y)| (DVec2::new(x, y) / 2.0, radius)).to_vec()
}

fn ellipse(x: f64, y: f64) -> Vec<DVec2> {
    let corner = |k: usize| DVec2::from_angle(TAU * k as f64 / CORNERS as f64) * DVec2::new(x, y);
    (0..CORNERS).map(corner).collect()
}

/// The outline with its corners rounded, as far as its sides are long enough.
fn rounded(corners: &[Corner]) -> Vec<DVec2> {
    let n = corners.len();
    let mut found: Vec<DVec2> = Vec::new();
    for (k, &(at, radius)) in corners.iter().enumerate() {
        let (before, after) = (corners[(k + n - 1) % n].0 - at, corners[(k + 1) % n].0 - at);
        let (a, b) = (before.normalize_or_zero(), after.normalize_or_zero());
        let half = (a.dot(b).clamp(-1.0, 1.0).acos()) / 2.0;
        let reach = radius / half.tan();
        let fits = radius > 0.0
            && reach.is_finite()
            && reach <= before.length().min(after.length()) + 1e-9
            && half > 0.01;
        if !fits {
            found.push(at);
            continue;
        }
        let center = at + (a + b).normalize_or_zero() * radius / half.sin();
        let (from, to) = (at + a * reach - center, at + b * reach - center);
        let sweep = from.angle_to(to);
        let steps = (sweep.abs() / TAU * 4.0 * QUARTER as f64 - 1e-9).ceil();
        let steps = (steps as usize).max(1);
        let corner =
            |k: usize| center + DVec2::from_angle(sweep * k as f64 / steps as f64).rotate(from);
        found.extend((0..=steps).map(corner));
    }
    found.dedup_by(|a, b| a.distance_squared(*b) < 1e-16);
    found
}

/// The band of a width [m] along a line, mitred.
fn band(line: &[DVec2], width: f64) -> Area {
    let n = line.len();
    let closed = n > 3 && line[0].distance_squared(line[n - 1]) < 1e-12;
    let way = |k: usize| (line[k + 1] - line[k]).normalize_or_zero();
    let normal = |k: usize| {
        let (before, after) = match k {
            0 if closed => (way(n - 2), way(0)),
            0 => (way(0), way(0)),
            k if k == n - 1 && closed => (way(n - 2), way(0)),
            k if k == n - 1 => (way(n - 2), way(n - 2)),
            k => (way(k - 1), way(k)),
        };
        let middle = (before + after).normalize_or(after).perp();
        // A mitre of a sharp turn ends at four times the half width.
        middle * width / 2.0 / middle.dot(after.perp()).max(0.25)
    };
    let left = (0..n).map(|k| line[k] + normal(k));
    let right = (0..n).map(|k| line[k] - normal(k));
    if closed {
        let twice: f64 = line.windows(2).map(|p| p[0].perp_dot(p[1])).sum();
        let (left, right) = (left.skip(1).collect(), right.skip(1).collect());
        // The outer one of the two is the outline.
        return match twice > 0.0 {
            true => vec![right, left],
            false => vec![left, right],
        };
    }
    vec![right.chain(left.rev()).collect()]
}

fn moved(areas: &mut [Area], by: DAffine3) {
    for p in areas.iter_mut().flatten().flatten() {
        *p = by.transform_point3(p.extend(0.0)).truncate();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_m2(ring: &[DVec2]) -> f64 {
        let n = ring.len();
        (0..n)
            .map(|k| ring[k].perp_dot(ring[(k + 1) % n]))
            .sum::<f64>()
            / 2.0
    }

    #[test]
    fn a_rounded_square_loses_its_corners() {
        // Four corners of 32-gons' quarters: less than (4 - pi) r² by the arc's flatness.
        let ring = rounded(&rectangle(4.0, 4.0, 1.0));
        let polygon = 0.5 * 32.0 * (TAU / 32.0).sin();
        assert!((area_m2(&ring) - (16.0 - 4.0 + polygon)).abs() < 1e-9);
        // A radius that does not fit leaves the corner.
        assert!((area_m2(&rounded(&rectangle(1.0, 1.0, 3.0))) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn bands_have_the_area_of_their_line() {
        let line = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]].map(DVec2::from);
        assert!((area_m2(&band(&line, 0.2)[0]) - 7.0 * 0.2).abs() < 1e-9);
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]].map(DVec2::from);
        let both = band(&square, 0.2);
        let net = area_m2(&both[0]).abs() - area_m2(&both[1]).abs();
        assert!((net - 16.0 * 0.2).abs() < 1e-9, "{net}");
    }
}
