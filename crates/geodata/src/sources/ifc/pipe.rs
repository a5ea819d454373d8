//! Disks swept along lines.

use super::model::{DEEPEST, Face, Lost, Model};
use glam::{DQuat, DVec2, DVec3};
use ifc_lite_core::{DecodedEntity, IfcType};
use std::f64::consts::TAU;

impl Model<'_> {
    /// A disk, or a ring, along a curve, mitred where the curve turns.
    pub fn pipe(&mut self, solid: &DecodedEntity) -> Result<Vec<Face>, Lost> {
        let directrix = self.need(solid, 0)?;
        let line = self.curve(&directrix, DEEPEST)?;
        let [radius] = self.lengths(solid, [1])?;
        self.whole(solid, &directrix)?;
        let inner = self.lengths(solid, [2]).map(|[inner]| inner).ok();
        let inner = inner.filter(|inner| *inner < radius);
        let outside = sections(&line, radius);
        let inside = inner.map(|inner| sections(&line, inner));
        let mut faces = tube(&outside);
        if let Some(inside) = &inside {
            let mut wall = tube(inside);
            wall.iter_mut().flatten().for_each(|ring| ring.reverse());
            faces.extend(wall);
        }
        let n = line.len();
        let ends = [(0, line[0] - line[1]), (n - 1, line[n - 1] - line[n - 2])];
        for (k, out) in ends {
            let facing = |ring: &Vec<DVec3>| {
                let mut ring = ring.clone();
                let normal = (ring[1] - ring[0]).cross(ring[2] - ring[0]);
                if normal.dot(out) < 0.0 {
                    ring.reverse();
                }
                ring
            };
            let hole =
                (inside.as_ref()).map(|inside| facing(&inside[k]).into_iter().rev().collect());
            faces.push(std::iter::once(facing(&outside[k])).chain(hole).collect());
        }
        Ok(faces)
    }

    /// Whether a pipe runs along the whole of its line, as far as its parameters say.
    fn whole(&mut self, pipe: &DecodedEntity, line: &DecodedEntity) -> Result<(), Lost> {
        let (from, to) = (pipe.get_float(3).unwrap_or(0.0), pipe.get_float(4));
        let ends = match line.ifc_type {
            IfcType::IfcPolyline => {
                let points = line.get_refs(0).unwrap_or_default().len();
                to.is_none_or(|to| (to - (points as f64 - 1.0)).abs() < 1e-6)
            }
            _ => true,
        };
        if from.abs() > 1e-6 || !ends {
            return Err(Lost::kind(pipe, "shape items between parameters"));
        }
        if to.is_some() && line.ifc_type != IfcType::IfcPolyline {
            let what = "ends at parameters are taken as those of their lines";
            let mend = "export pipes without parameters";
            self.notes.assume(pipe.ifc_type.name(), what, mend);
        }
        Ok(())
    }
}

/// Corners of a pipe's round.
const PIPE_CORNERS: usize = 12;

/// The corners of a pipe at each point of its line, in the plane that halves the turn there. Their order goes with a frame that is
/// carried along the line without a twist.
fn sections(line: &[DVec3], radius: f64) -> Vec<Vec<DVec3>> {
    let way = |k: usize| (line[k + 1] - line[k]).normalize_or(DVec3::Z);
    let last = line.len() - 2;
    let mut x = way(0).any_orthonormal_vector();
    let mut found = Vec::with_capacity(line.len());
    for (k, r) in line.iter().enumerate() {
        let along = way(k.min(last));
        let before = if k == 0 { along } else { way(k - 1) };
        if (1..=last).contains(&k) {
            x = DQuat::from_rotation_arc(before, along) * x;
        }
        let y = along.cross(x);
        let plane = (before + along).normalize_or(along);
        let corner = |n: usize| {
            let arm = DVec2::from_angle(TAU * n as f64 / PIPE_CORNERS as f64) * radius;
            let arm = x * arm.x + y * arm.y;
            // Along the pipe into the plane; a mitre of a sharp turn ends at four times the radius.
            let slope = along.dot(plane).max(0.25);
            *r + arm - along * (arm.dot(plane) / slope)
        };
        found.push((0..PIPE_CORNERS).map(corner).collect());
    }
    found
}

/// The wall of a pipe over its sections, seen from outside.
fn tube(sections: &[Vec<DVec3>]) -> Vec<Face> {
    let mut faces = Vec::new();
    for pair in sections.windows(2) {
        let (low, high) = (&pair[0], &pair[1]);
        for n in 0..PIPE_CORNERS {
            let next = (n + 1) % PIPE_CORNERS;
            let (a, b, c, d) = (low[n], low[next], high[next], high[n]);
            faces.extend([vec![vec![a, b, c]], vec![vec![a, c, d]]]);
        }
    }
    faces
}
