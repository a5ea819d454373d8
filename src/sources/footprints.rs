//! Outlines of buildings with heights (GeoJSON, OpenStreetMap), extruded from the ground.

mod osm;
mod outline;

use super::error::{Fault, SourceError, read_bytes};
use super::geotiff::Ground;
use super::options::Options;
use super::place;
use super::surfaces::{Corner, Surfaces};
use super::{Layer, LayerKind};
use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use crate::models::maths::polygon;
use crate::projection::Crs;
use geojson::{GeoJson, GeometryValue};
use glam::{DVec2, DVec3};
use outline::{Footprint, TALLEST_M};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use serde_json::{Map, Value};
use std::path::Path;

/// Height of a building of which nothing is known [m].
const UNKNOWN_M: f64 = 8.0; // [m]
/// Linear albedo of walls and roofs.
const WALL: [f32; 4] = [0.38, 0.34, 0.29, 1.0];
/// Of a roof.
const ROOF: [f32; 4] = [0.24, 0.20, 0.18, 1.0];

/// Buildings from outlines: polygons of a GeoJSON file, or ways and multipolygons tagged `building` or `building:part` of an
/// `.osm.pbf` file. They stand on the options' terrain, else at their base height; outlines beside the terrain are left out.
///
/// Fails where the file is damaged, names a system that is not known, or holds no outline.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    if name.ends_with(".osm") {
        let mend = "convert it (osmium cat city.osm -o city.osm.pbf)";
        return Err(Fault::new("OpenStreetMap data", "XML is not read", mend).of(path));
    }
    let found = if name.ends_with(".pbf") {
        osm::read(&bytes).map(|found| (found, "WGS84".to_string()))
    } else {
        parse_geojson(&bytes)
    };
    let (footprints, system) = found.map_err(|fault| fault.of(path))?;
    drop(bytes);
    let degrees = |r: &DVec2| r.x.abs() <= 180.0 && r.y.abs() <= 90.0;
    let all_degrees = footprints
        .iter()
        .flat_map(|f| f.rings.iter().flatten())
        .all(degrees);
    // A map named for other sources beside it does not turn longitudes and latitudes into metres.
    let named = options
        .crs
        .as_deref()
        .filter(|_| !name.ends_with(".pbf") && !all_degrees);
    let system = named.unwrap_or(&system);
    let crs = place::crs(system, options).map_err(|fault| fault.of(path))?;
    let ground = match &options.terrain {
        Some(terrain) => {
            let own = Options {
                crs: options.terrain_crs.clone(),
                ..options.clone()
            };
            Some(Ground::read(terrain, &own)?)
        }
        None => None,
    };
    buildings(&footprints, &crs, ground.as_ref(), options).map_err(|fault| fault.of(path))
}

/// The polygons of a GeoJSON text, and its system: WGS 84, but where an old file names another.
fn parse_geojson(bytes: &[u8]) -> Result<(Vec<Footprint>, String), Fault> {
    let mend = "name a GeoJSON file of polygons, or an .osm.pbf file";
    let parsed: GeoJson =
        serde_json::from_slice(bytes).map_err(|error| Fault::new("GeoJSON", error, mend))?;
    let mut system = "WGS84".to_string();
    let mut found = Vec::new();
    match parsed {
        GeoJson::FeatureCollection(collection) => {
            let named = collection.foreign_members.as_ref().and_then(|members| {
                let name = members.get("crs")?.get("properties")?.get("name")?;
                name.as_str().map(str::to_string)
            });
            system = named.unwrap_or(system);
            for feature in collection.features {
                let mut known = feature.properties.unwrap_or_default();
                if let Some(id) = feature.id {
                    let id = match id {
                        geojson::feature::Id::String(text) => Value::from(text),
                        geojson::feature::Id::Number(number) => Value::from(number.to_string()),
                    };
                    known.entry("id").or_insert(id);
                }
                if let Some(geometry) = feature.geometry {
                    polygons(geometry.value, &known, &mut found);
                }
            }
        }
        GeoJson::Feature(feature) => {
            let known = feature.properties.unwrap_or_default();
            if let Some(geometry) = feature.geometry {
                polygons(geometry.value, &known, &mut found);
            }
        }
        GeoJson::Geometry(geometry) => polygons(geometry.value, &Map::new(), &mut found),
    }
    Ok((found, system))
}

/// Gathers the polygons of a geometry.
fn polygons(value: GeometryValue, known: &Map<String, Value>, found: &mut Vec<Footprint>) {
    let mut add = |rings: Vec<Vec<geojson::Position>>| {
        let point = |p: &geojson::Position| {
            let numbers = p.as_slice();
            DVec2::new(
                numbers.first().copied().unwrap_or(f64::NAN),
                numbers.get(1).copied().unwrap_or(f64::NAN),
            )
        };
        let rings = rings
            .iter()
            .map(|ring| ring.iter().map(point).collect())
            .collect();
        found.push(Footprint {
            rings,
            known: known.clone(),
        });
    };
    match value {
        GeometryValue::Polygon { coordinates } => add(coordinates),
        GeometryValue::MultiPolygon { coordinates } => coordinates.into_iter().for_each(add),
        GeometryValue::GeometryCollection { geometries } => {
            geometries
                .into_iter()
                .for_each(|geometry| polygons(geometry.value, known, found));
        }
        _ => {}
    }
}

/// Outlines that parts of a building stand in for.
fn replaced(footprints: &[Footprint]) -> Vec<bool> {
    let mut replaced = vec![false; footprints.len()];
    let part = |footprint: &Footprint| footprint.known.contains_key("building:part");
    // Degrees are large units: in smaller ones areas do not look like none.
    let outline = |footprint: &Footprint| {
        let ring = footprint.rings.first().filter(|ring| ring.len() >= 3)?;
        Some(ring.iter().map(|r| *r * 1e6).collect::<Vec<DVec2>>())
    };
    let boxes = footprints
        .iter()
        .enumerate()
        .filter(|(_, f)| !part(f))
        .filter_map(|(k, f)| {
            let ring = outline(f)?;
            let low = ring.iter().fold(DVec2::INFINITY, |a, b| a.min(*b));
            let high = ring.iter().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
            let finite = low.is_finite() && high.is_finite();
            finite.then(|| {
                GeomWithData::new(
                    Rectangle::<[f64; 2]>::from_corners(low.into(), high.into()),
                    k,
                )
            })
        });
    let tree = RTree::bulk_load(boxes.collect());
    for ring in footprints.iter().filter(|f| part(f)).filter_map(outline) {
        let middle = polygon::centroid(&ring);
        if !middle.is_finite() {
            continue;
        }
        for found in tree.locate_in_envelope_intersecting(AABB::from_point(middle.to_array())) {
            let footprint = &footprints[found.data];
            replaced[found.data] |=
                outline(footprint).is_some_and(|ring| polygon::encloses(&ring, middle));
        }
    }
    replaced
}

/// The layer of extruded outlines.
fn buildings(
    footprints: &[Footprint],
    crs: &Crs,
    ground: Option<&Ground>,
    options: &Options,
) -> Result<Layer, Fault> {
    let points = || footprints.iter().flat_map(|f| f.rings.iter().flatten());
    let low = points().fold(DVec2::INFINITY, |a, b| a.min(*b));
    let high = points().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
    if !(low.is_finite() && high.is_finite()) {
        let what = "no polygon, or coordinates that are no numbers";
        return Err(Fault::new(
            "outlines",
            what,
            "name a file with outlines of buildings",
        ));
    }
    let base = |r: DVec2| Ok::<_, Fault>(crs.to_geodetic(r.extend(options.base_height_m))?);
    // Height of the ground over the ellipsoid: the lowest along the outline.
    let mut stands = Vec::with_capacity(footprints.len());
    for footprint in footprints {
        let mut least: Option<f64> = None;
        for r in footprint.rings.first().into_iter().flatten() {
            let place = base(*r)?;
            let height_m = ground.map_or(Some(place.height_m), |ground| ground.height_m(place));
            least = height_m.map(|h| least.map_or(h, |l| l.min(h))).or(least);
        }
        stands.push(least);
    }
    let site = match options.site {
        Some(site) => site,
        None => {
            let lowest = stands
                .iter()
                .flatten()
                .copied()
                .fold(f64::INFINITY, f64::min);
            let middle = base((low + high) / 2.0)?;
            let height_m = if lowest.is_finite() {
                lowest
            } else {
                middle.height_m
            };
            SiteFrame::new(Geodetic { height_m, ..middle })
        }
    };
    let replaced = replaced(footprints);
    let mut surfaces = Surfaces::default();
    let mut features = Vec::new();
    for ((footprint, stand), replaced) in footprints.iter().zip(stands).zip(replaced) {
        let (Some(stand_m), false) = (stand, replaced) else {
            continue;
        };
        let unknown_m = options
            .building_height_m
            .unwrap_or(UNKNOWN_M)
            .clamp(0.1, TALLEST_M);
        let [low_m, high_m, roof_m] = footprint.heights_m(unknown_m);
        let at = |r: &DVec2, up_m: f64| {
            let place = Geodetic {
                height_m: stand_m + up_m,
                ..base(*r)?
            };
            Ok::<_, Fault>(site.ecef_to_enu(place.to_ecef()))
        };
        let mut rings = Vec::new();
        for (k, ring) in footprint.rings.iter().enumerate() {
            let corners = ring.iter().map(|r| Ok([at(r, low_m)?, at(r, high_m)?]));
            let corners = corners.collect::<Result<Vec<[DVec3; 2]>, Fault>>()?;
            let ring = tidy(corners, k == 0);
            if ring.is_empty() && k == 0 {
                break;
            }
            rings.extend(Some(ring).filter(|ring| !ring.is_empty()));
        }
        if rings.is_empty() {
            continue;
        }
        let number = features.len() as u32;
        let looks = [("building:colour", WALL), ("roof:colour", ROOF)];
        let [wall, roof] =
            looks.map(|(key, plain)| footprint.text(key).and_then(colour).unwrap_or(plain));
        let pyramid = footprint.text("roof:shape") == Some("pyramidal") && rings.len() == 1;
        let roof_m = if pyramid { roof_m } else { 0.0 };
        extrude(&mut surfaces, &rings, roof_m, number, [wall, roof]);
        let mut known = footprint.known.clone();
        known.insert("ground_ellipsoid_m".into(), stand_m.into());
        known.insert("bottom_m".into(), low_m.into());
        known.insert("top_m".into(), high_m.into());
        features.push(known);
    }
    if features.is_empty() {
        let what = "no outline has an area and ground under it";
        return Err(Fault::new(
            "outlines",
            what,
            "check the terrain's extent and both coordinate systems",
        ));
    }
    Ok(Layer {
        kind: LayerKind::Buildings,
        site,
        meshes: surfaces.finish(),
        features,
        warnings: Vec::new(),
    })
}

/// An open ring of bottom and top corners without repeated ones, counter-clockwise seen from above for an outline, clockwise for a hole.
/// Empty where nothing is left.
fn tidy(mut ring: Vec<[DVec3; 2]>, outline: bool) -> Vec<[DVec3; 2]> {
    let same = |a: &[DVec3; 2], b: &[DVec3; 2]| a[0].distance_squared(b[0]) < 1e-6;
    ring.dedup_by(|a, b| same(a, b));
    while ring.len() > 1
        && ring
            .first()
            .zip(ring.last())
            .is_some_and(|(a, b)| same(a, b))
    {
        ring.pop();
    }
    let flat: Vec<DVec2> = ring.iter().map(|c| c[0].truncate()).collect();
    let first = flat.first().copied().unwrap_or_default();
    let twice: f64 = flat
        .windows(2)
        .map(|w| (w[0] - first).perp_dot(w[1] - first))
        .sum();
    if ring.len() < 3 || twice.abs() < 0.02 || !twice.is_finite() {
        return Vec::new();
    }
    if (twice > 0.0) != outline {
        ring.reverse();
    }
    ring
}

/// Walls, roof and floor of a building.
fn extrude(
    surfaces: &mut Surfaces,
    rings: &[Vec<[DVec3; 2]>],
    roof_m: f64,
    feature: u32,
    [wall, roof]: [[f32; 4]; 2],
) {
    let eaves = |c: &[DVec3; 2]| c[1] - DVec3::Z * roof_m;
    for ring in rings {
        for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            let face = [a[0], b[0], eaves(b), eaves(a)].map(Corner::from);
            surfaces.polygon(&[face.to_vec()], feature, wall, 0);
        }
    }
    let floor: Vec<Vec<Corner>> = rings
        .iter()
        .map(|ring| ring.iter().rev().map(|c| c[0].into()).collect())
        .collect();
    surfaces.polygon(&floor, feature, wall, 0);
    if roof_m > 0.0 {
        let outline: Vec<DVec2> = rings[0].iter().map(|c| c[1].truncate()).collect();
        let apex = polygon::centroid(&outline).extend(rings[0][0][1].z);
        for (a, b) in rings[0].iter().zip(rings[0].iter().cycle().skip(1)) {
            surfaces.polygon(
                &[[eaves(a), eaves(b), apex].map(Corner::from).to_vec()],
                feature,
                roof,
                0,
            );
        }
    } else {
        let top: Vec<Vec<Corner>> = rings
            .iter()
            .map(|ring| ring.iter().map(|c| c[1].into()).collect())
            .collect();
        surfaces.polygon(&top, feature, roof, 0);
    }
}

/// Linear albedo of a colour of the screen, `#rrggbb`.
fn colour(text: &str) -> Option<[f32; 4]> {
    let hex = text
        .strip_prefix('#')
        .filter(|hex| hex.len() == 6 && hex.is_ascii())?;
    let part = |k: usize| u8::from_str_radix(hex.get(2 * k..2 * k + 2)?, 16).ok();
    let linear = |v: u8| (f32::from(v) / 255.0).powf(2.2);
    Some([linear(part(0)?), linear(part(1)?), linear(part(2)?), 1.0])
}

#[cfg(test)]
mod tests;
