//! Shells, values and sides of CityJSON geometries.

use super::document::{Geometry, Semantics};
use super::tolerant::Nest;
use crate::sources::LayerKind;
use crate::sources::surfaces::{Corner, area_vector_m2};
use glam::DVec3;

/// A surface of a geometry: its rings and what it is.
pub struct Face {
    /// Outline and holes.
    pub rings: Vec<Vec<Corner>>,
    /// Its kind's number.
    pub semantics: Option<usize>,
    /// Its material's number.
    pub material: Option<usize>,
    /// Its texture's number.
    pub texture: Option<usize>,
}

/// Why a geometry makes no surfaces, by its type.
pub fn without_surfaces(kind: &str) -> Option<&'static str> {
    match kind {
        "Solid" | "MultiSolid" | "CompositeSolid" | "MultiSurface" | "CompositeSurface" => None,
        "MultiPoint" => Some("MultiPoint geometries"),
        "MultiLineString" => Some("MultiLineString geometries"),
        extension if extension.starts_with('+') => Some("geometries of extensions"),
        _ => Some("geometries of an unknown type"),
    }
}

/// The geometries to show: those of the wanted level of detail, or else of the finest below it, or of the coarsest; and their level.
pub fn choose<'a>(all: &[(&'a Geometry, f64)], wanted: Option<f64>) -> (Vec<&'a Geometry>, f64) {
    let limit = wanted.unwrap_or(f64::INFINITY);
    let levels = || all.iter().map(|(_, level)| *level);
    let below = levels()
        .filter(|l| *l <= limit)
        .fold(f64::NEG_INFINITY, f64::max);
    let best = if below.is_finite() {
        below
    } else {
        levels().fold(f64::INFINITY, f64::min)
    };
    let chosen = all.iter().filter(|(_, level)| *level == best);
    (chosen.map(|(geometry, _)| *geometry).collect(), best)
}

/// The shells of boundaries or of values, whatever the geometry: a multi-surface is one shell. Inner shells of solids stay.
pub fn flatten<'a>(nest: &'a Nest, kind: &str) -> Vec<&'a Nest> {
    match kind {
        "Solid" => nest.items().iter().collect(),
        "MultiSolid" | "CompositeSolid" => nest.items().iter().flat_map(Nest::items).collect(),
        _ => vec![nest],
    }
}

/// The surfaces of each shell; only outer shells are seen, so that of a solid all but the first are empty.
pub fn shells<'a>(boundaries: &'a Nest, kind: &str) -> Vec<&'a [Nest]> {
    let outer = |solid: &'a Nest| {
        let shells = solid.items().iter().enumerate();
        shells
            .map(|(k, shell)| if k == 0 { shell.items() } else { &[][..] })
            .collect::<Vec<_>>()
    };
    match kind {
        "Solid" => outer(boundaries),
        "MultiSolid" | "CompositeSolid" => boundaries.items().iter().flat_map(outer).collect(),
        _ => vec![boundaries.items()],
    }
}

/// How many shells of solids lie inside others.
pub fn inner_shells(boundaries: &Nest, kind: &str) -> usize {
    let inner = |solid: &Nest| solid.items().len().saturating_sub(1);
    match kind {
        "Solid" => inner(boundaries),
        "MultiSolid" | "CompositeSolid" => boundaries.items().iter().map(inner).sum(),
        _ => 0,
    }
}

/// A value of a surface in the nested lists of semantics and materials, which may stop early or hold nothing.
pub fn value_at(values: &Nest, shell: usize, number: usize) -> Option<usize> {
    let first = values.items().first()?;
    let deep = |nest: &Nest| {
        nest.items()
            .first()
            .is_some_and(|first| !first.items().is_empty())
    };
    if first.items().is_empty() {
        // One list for all surfaces, unless the first shell alone has none.
        let own = values.items().get(number).and_then(Nest::index);
        if own.is_some() || shell == 0 {
            return own;
        }
    }
    let found = match deep(first) {
        true => values.items().iter().flat_map(Nest::items).nth(shell),
        false => values.items().get(shell),
    };
    found?.items().get(number)?.index()
}

/// Turns faces so that they are seen from outside: a closed shell by its volume, an open one of a building by its roofs, ground by its
/// upper side.
pub fn outward(faces: &mut [Face], kind: &str, layer: LayerKind, semantics: Option<&Semantics>) {
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
            let kind = face.semantics.and_then(|k| semantics?.kind(k));
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
