//! Outlines of buildings with heights (GeoJSON, OpenStreetMap), extruded from the ground.

mod extrude;
mod geojson;
mod length;
mod osm;
mod outline;
mod pbf;
mod rings;

use super::error::{Fault, SourceError, read_bytes};
use super::geotiff::Ground;
use super::options::Options;
use super::place;
use super::surfaces::Surfaces;
use super::whole;
use super::{Layer, LayerKind};
use crate::projection::Crs;
use boresight_common::warning::Notes;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::maths::polygon;
use extrude::{extrude, tidy};
pub use geojson::is_geojson;
use glam::{DVec2, DVec3};
use outline::{Footprint, Remarks, TALLEST_M};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use std::path::Path;

/// Height of a building of which nothing is known [m].
const UNKNOWN_M: f64 = 8.0; // [m]
/// Outlines farther than this from the middle one are strays: no city is larger [m].
const STRAY_M: f64 = 1e5; // [m]
/// Linear albedo of walls.
const WALL: [f32; 4] = [0.38, 0.34, 0.29, 1.0];
/// Linear albedo of roofs.
const ROOF: [f32; 4] = [0.24, 0.20, 0.18, 1.0];

/// Buildings from outlines: polygons of a GeoJSON file or sequence, or ways and multipolygons tagged `building` or `building:part` of an
/// `.osm.pbf` file. They stand on the options' terrain, else at their base height. What lies under the ground, beside the terrain or has no
/// outline is left out, and said in the layer's warnings.
///
/// Fails where the file is damaged, names a system that is not known, or holds no outline.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    let mut notes = Notes::default();
    let found = parse(&bytes, &name, options, &mut notes);
    let (mut footprints, system) = found.map_err(|fault| fault.of(path))?;
    drop(bytes);
    let crs = place::crs(&system, options).map_err(|fault| fault.of(path))?;
    if crs.is_geographic() {
        one_turn(&mut footprints);
    }
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
    if ground.is_none() {
        place::note_heights(&crs, &mut notes);
    }
    let layer = buildings(footprints, &crs, ground.as_ref(), options, &mut notes);
    let layer = layer.map_err(|fault| fault.of(path))?;
    let mut warnings = notes.warnings(path);
    warnings.extend(ground.into_iter().flat_map(|ground| ground.warnings));
    Ok(Layer { warnings, ..layer })
}

/// The outlines of a file and the name of their system.
fn parse(
    bytes: &[u8],
    name: &str,
    options: &Options,
    notes: &mut Notes,
) -> Result<(Vec<Footprint>, String), Fault> {
    const WGS84: &str = "WGS84";
    let xml = bytes.trim_ascii_start().starts_with(b"<");
    if [".osm", ".osm.gz", ".osm.bz2", ".o5m"]
        .iter()
        .any(|end| name.ends_with(end))
        || xml
    {
        let mend = "convert it (osmium cat city.osm -o city.osm.pbf)";
        return Err(Fault::new(
            "OpenStreetMap data",
            "of its forms only .osm.pbf is read",
            mend,
        ));
    }
    // A map named for other sources beside it does not turn longitudes and latitudes into metres.
    let geographic =
        |name: &&String| place::crs(name, options).is_ok_and(|crs| crs.is_geographic());
    if name.ends_with(".pbf") {
        let system = options.crs.as_ref().filter(geographic).cloned();
        return Ok((osm::read(bytes, notes)?, system.unwrap_or(WGS84.into())));
    }
    let outlines = geojson::read(bytes, notes)?;
    let degrees = look_like_degrees(&outlines.footprints);
    let own = match (outlines.system, &options.crs) {
        // Another system than the one that is not understood is named.
        (Some(Err(_)), Some(_)) => None,
        (own, _) => own.transpose()?,
    };
    let named = options
        .crs
        .as_ref()
        .filter(|name| !degrees || geographic(name));
    let system = named.cloned().or(own).unwrap_or(WGS84.into());
    Ok((outlines.footprints, system))
}

/// Whether most points may be longitudes and latitudes [deg].
fn look_like_degrees(footprints: &[Footprint]) -> bool {
    let points = || footprints.iter().flat_map(|f| f.rings.iter().flatten());
    let degrees = points().filter(|r| r.x.abs() <= 360.0 && r.y.abs() <= 90.0);
    2 * degrees.count() > points().count()
}

/// Brings longitudes [deg] to within half a turn of their mean direction: outlines on both sides of the meridian of 180° are neighbours.
fn one_turn(footprints: &mut [Footprint]) {
    let points = footprints.iter().flat_map(|f| f.rings.iter().flatten());
    let mean: DVec2 = (points.filter(|r| r.is_finite()))
        .map(|r| DVec2::from_angle(r.x.to_radians()))
        .sum();
    let middle = mean.to_angle().to_degrees();
    for r in footprints
        .iter_mut()
        .flat_map(|f| f.rings.iter_mut().flatten())
    {
        r.x -= 360.0 * ((r.x - middle) / 360.0).round();
    }
}

/// Share of an outline that its parts must cover to stand in its place.
const COVERED: f64 = 0.5;

/// Outlines that parts of a building stand in for: those whose parts cover half of them.
fn replaced(footprints: &[Footprint], notes: &mut Notes) -> Vec<bool> {
    let mut covered = vec![0.0; footprints.len()];
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
    // About its first corner: far from the origin the digits of an area are lost.
    let area = |ring: &[DVec2]| {
        let about: Vec<DVec2> = ring.iter().map(|r| *r - ring[0]).collect();
        polygon::area_m2(&about).abs()
    };
    for ring in footprints.iter().filter(|f| part(f)).filter_map(outline) {
        let middle = polygon::centroid(&ring);
        if !middle.is_finite() {
            continue;
        }
        for found in tree.locate_in_envelope_intersecting(AABB::from_point(middle.to_array())) {
            let whole = outline(&footprints[found.data]);
            if let Some(whole) = whole.filter(|whole| polygon::encloses(whole, middle)) {
                let share = area(&ring) / area(&whole);
                covered[found.data] += share;
            }
        }
    }
    let partly = |(share, _): &(&f64, &Footprint)| **share > 0.0 && **share < COVERED;
    let mut kept = covered.iter().zip(footprints).filter(partly).peekable();
    if let Some((_, first)) = kept.peek() {
        let first = first.name.clone();
        let what = format!(
            "{} stand beside their parts, which cover less than half of them (first {first})",
            kept.count()
        );
        notes.assume("outlines", what, "draw parts that cover the whole building");
    }
    covered.into_iter().map(|share| share >= COVERED).collect()
}

/// The least of a footprint's ground heights [m over the ellipsoid].
///
/// Fails where a corner lies nowhere on the Earth; `None` beside the terrain.
fn stand_m(
    footprint: &Footprint,
    base: &impl Fn(DVec2) -> Result<Geodetic, Fault>,
    ground: Option<&Ground>,
) -> Result<Option<f64>, Fault> {
    let mut least: Option<f64> = None;
    for ring in &footprint.rings {
        for r in ring {
            base(*r)?;
        }
    }
    for r in footprint.rings.first().into_iter().flatten() {
        let place = base(*r)?;
        let height_m = ground.map_or(Some(place.height_m), |ground| ground.height_m(place));
        least = height_m.map(|h| least.map_or(h, |l| l.min(h))).or(least);
    }
    Ok(least)
}

/// Outlines that stand somewhere, with the height of the ground below each [m over the ellipsoid].
fn standing(
    footprints: Vec<Footprint>,
    base: &impl Fn(DVec2) -> Result<Geodetic, Fault>,
    ground: Option<&Ground>,
    notes: &mut Notes,
) -> Result<Vec<(Footprint, f64)>, Fault> {
    if footprints.is_empty() {
        let mend = "name a file with outlines of buildings";
        return Err(Fault::new("outlines", "no polygon", mend));
    }
    let above = |footprint: &Footprint| {
        let under = footprint.is_underground();
        if under {
            notes.leave_out("buildings under the ground", &footprint.name);
        }
        !under
    };
    let footprints: Vec<_> = footprints.into_iter().filter(above).collect();
    let replaced = replaced(&footprints, notes);
    let mut wrong = None;
    let mut standing = Vec::new();
    for (footprint, replaced) in footprints.into_iter().zip(replaced) {
        match stand_m(&footprint, base, ground) {
            _ if replaced => {}
            Ok(Some(stand_m)) => standing.push((footprint, stand_m)),
            Ok(None) => notes.leave_out("outlines beside the terrain", footprint.name),
            Err(fault) => {
                notes.leave_out("outlines that lie nowhere on the Earth", footprint.name);
                wrong.get_or_insert(fault);
            }
        }
    }
    match wrong {
        Some(fault) if standing.is_empty() => Err(fault),
        _ => Ok(standing),
    }
}

/// Leaves out outlines a hundred kilometres from the middle one: of a null island, or of exchanged numbers.
fn without_strays(
    standing: &mut Vec<(Footprint, f64)>,
    base: &impl Fn(DVec2) -> Result<Geodetic, Fault>,
    notes: &mut Notes,
) -> Result<(), Fault> {
    let places = standing.iter().map(|(footprint, _)| {
        let first = footprint.rings.iter().flatten().next();
        Ok(base(first.copied().unwrap_or_default())?.to_ecef())
    });
    let places = places.collect::<Result<Vec<DVec3>, Fault>>()?;
    let middle = [0, 1, 2].map(|axis| {
        let mut values: Vec<f64> = places.iter().map(|r| r[axis]).collect();
        let half = values.len() / 2;
        match values.is_empty() {
            true => 0.0,
            false => *values.select_nth_unstable_by(half, f64::total_cmp).1,
        }
    });
    // Of few outlines the median of each axis may lie nowhere: the nearest of them stands for it. Off Africa, where latitude and
    // longitude are 0, there is sea alone: what lies there states no place.
    let null_island = Geodetic {
        latitude_rad: 0.0,
        longitude_rad: 0.0,
        height_m: 0.0,
    }
    .to_ecef();
    let at_sea = |r: &&DVec3| r.distance(null_island) < STRAY_M;
    let on_land = places.iter().filter(|r| !at_sea(r));
    let apart = |r: &&DVec3| r.distance_squared(middle.into());
    let centre = on_land
        .min_by(|a, b| apart(a).total_cmp(&apart(b)))
        .or(places.first());
    let Some(centre) = centre.copied() else {
        return Ok(());
    };
    let mut wrong = None;
    standing.retain(|(footprint, _)| {
        let mut corners = footprint.rings.iter().flatten();
        let near = corners.all(|r| match base(*r) {
            Ok(place) => place.to_ecef().distance(centre) < STRAY_M,
            Err(fault) => {
                wrong.get_or_insert(fault);
                true
            }
        });
        if !near {
            notes.leave_out(
                "outlines a hundred kilometres from the rest",
                &footprint.name,
            );
        }
        near
    });
    wrong.map_or(Ok(()), Err)
}

/// The frame of the outlines: that of the options, or one in their middle on their lowest ground.
fn site(
    standing: &[(Footprint, f64)],
    base: &impl Fn(DVec2) -> Result<Geodetic, Fault>,
    options: &Options,
) -> Result<SiteFrame, Fault> {
    if let Some(site) = options.site {
        return Ok(site);
    }
    let points = || standing.iter().flat_map(|(f, _)| f.rings.iter().flatten());
    let low = points().fold(DVec2::INFINITY, |a, b| a.min(*b));
    let high = points().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
    let height_m = (standing.iter()).fold(f64::INFINITY, |low, (_, stand_m)| low.min(*stand_m));
    Ok(SiteFrame::new(Geodetic {
        height_m,
        ..base((low + high) / 2.0)?
    }))
}

/// The error of a file whose outlines are all left out.
fn nothing(notes: &Notes) -> Fault {
    let what = match notes.count_left_out() {
        0 => "no outline has an area".to_string(),
        _ => format!("none is left: {}", notes.left_out().join("; ")),
    };
    let mend = "check the outlines, their coordinate system and that of the terrain";
    Fault::new("outlines", what, mend)
}

/// The layer of extruded outlines; what is left out is said to the notes.
fn buildings(
    footprints: Vec<Footprint>,
    crs: &Crs,
    ground: Option<&Ground>,
    options: &Options,
    notes: &mut Notes,
) -> Result<Layer, Fault> {
    let turned = |x: f64| match crs.is_geographic() && x.abs() > 180.0 {
        true => x - 360.0 * (x / 360.0).round(),
        false => x,
    };
    let base = |r: DVec2| {
        let r = DVec3::new(turned(r.x), r.y, options.base_height_m);
        Ok::<_, Fault>(crs.to_geodetic(r)?)
    };
    let mut standing = standing(footprints, &base, ground, notes)?;
    without_strays(&mut standing, &base, notes)?;
    if standing.is_empty() {
        return Err(nothing(notes));
    }
    let site = site(&standing, &base, options)?;
    let unknown_m = options
        .building_height_m
        .unwrap_or(UNKNOWN_M)
        .clamp(0.1, TALLEST_M);
    let mut remarks = Remarks::default();
    let mut crossed = (0, None);
    let mut surfaces = Surfaces::default();
    let mut features = Vec::new();
    for (footprint, stand_m) in standing {
        let at = |r: &DVec2, up_m: f64| {
            let place = Geodetic {
                height_m: stand_m + up_m,
                ..base(*r)?
            };
            Ok::<_, Fault>(site.ecef_to_enu(place.to_ecef()))
        };
        let [low_m, high_m, roof_m] = footprint.heights_m(unknown_m, &mut remarks);
        let mended = whole::mended(&footprint.rings);
        if mended.as_ref().is_some_and(|mended| mended.other_area) {
            crossed.0 += 1;
            crossed.1.get_or_insert(footprint.name.clone());
        }
        let shapes = mended.map_or_else(|| vec![footprint.rings.clone()], |mended| mended.shapes);
        let mut solids = Vec::new();
        for shape in &shapes {
            let mut rings = Vec::new();
            for (k, ring) in shape.iter().enumerate() {
                let corners = ring.iter().map(|r| Ok([at(r, low_m)?, at(r, high_m)?]));
                let corners = corners.collect::<Result<Vec<[DVec3; 2]>, Fault>>()?;
                let ring = tidy(corners, k == 0);
                if ring.is_empty() && k == 0 {
                    break;
                }
                rings.extend(Some(ring).filter(|ring| !ring.is_empty()));
            }
            solids.extend(Some(rings).filter(|rings| !rings.is_empty()));
        }
        if solids.is_empty() {
            notes.leave_out("outlines without an area", &footprint.name);
            continue;
        }
        let number = features.len() as u32;
        let pyramid = is_pyramid(&footprint, solids.iter().map(Vec::len).sum(), notes);
        let roof_m = if pyramid { roof_m } else { 0.0 };
        let colours = colours(&footprint, notes);
        for rings in &solids {
            extrude(&mut surfaces, rings, roof_m, number, colours);
        }
        let mut known = footprint.known;
        known.insert("ground_ellipsoid_m".into(), stand_m.into());
        known.insert("bottom_m".into(), low_m.into());
        known.insert("top_m".into(), high_m.into());
        features.push(known);
    }
    if features.is_empty() {
        return Err(nothing(notes));
    }
    remarks.say(unknown_m, notes);
    if let (count, Some(first)) = crossed {
        let what = format!(
            "{count} cross or touch themselves or their holes (first {first}): taken as what they run around, less their holes"
        );
        notes.assume("outlines", what, "draw them anew where that is not meant");
    }
    Ok(Layer {
        kind: LayerKind::Buildings,
        site,
        meshes: surfaces.finish(),
        features,
        warnings: Vec::new(),
    })
}

/// Whether a building has a pyramid for a roof; of other shapes it is said that they are made flat.
fn is_pyramid(footprint: &Footprint, rings: usize, notes: &mut Notes) -> bool {
    let shape = ["roof:shape", "roof_shape"]
        .iter()
        .find_map(|key| footprint.text(key));
    match shape {
        None | Some("flat" | "") => false,
        Some("pyramidal") if rings == 1 => true,
        Some(shape) => {
            let place = format!("{}, {shape}", footprint.name);
            notes.leave_out("roof shapes, made flat at full height", place);
            false
        }
    }
}

/// Linear albedos of walls and roof.
fn colours(footprint: &Footprint, notes: &mut Notes) -> [[f32; 4]; 2] {
    let keys = [
        ["building:colour", "building:color", "facade_color"],
        ["roof:colour", "roof:color", "roof_color"],
    ];
    let mut look = |keys: [&str; 3], plain| {
        let Some(text) = keys
            .iter()
            .find_map(|key| footprint.text(key))
            .filter(|text| !text.is_empty())
        else {
            return plain;
        };
        colour(text).unwrap_or_else(|| {
            let place = format!(
                "{}, {}",
                footprint.name,
                text.chars().take(40).collect::<String>()
            );
            notes.leave_out("colours that are not understood", place);
            plain
        })
    };
    [look(keys[0], WALL), look(keys[1], ROOF)]
}

/// Colours by the names that HTML 4 has, as OpenStreetMap uses them, and the commonest of CSS on roofs.
const NAMED: [(&str, &str); 26] = [
    ("black", "#000000"),
    ("silver", "#c0c0c0"),
    ("gray", "#808080"),
    ("grey", "#808080"),
    ("white", "#ffffff"),
    ("maroon", "#800000"),
    ("red", "#ff0000"),
    ("purple", "#800080"),
    ("fuchsia", "#ff00ff"),
    ("green", "#008000"),
    ("lime", "#00ff00"),
    ("olive", "#808000"),
    ("yellow", "#ffff00"),
    ("navy", "#000080"),
    ("blue", "#0000ff"),
    ("teal", "#008080"),
    ("aqua", "#00ffff"),
    ("brown", "#a52a2a"),
    ("orange", "#ffa500"),
    ("pink", "#ffc0cb"),
    ("beige", "#f5f5dc"),
    ("tan", "#d2b48c"),
    ("lightgray", "#d3d3d3"),
    ("lightgrey", "#d3d3d3"),
    ("darkgray", "#a9a9a9"),
    ("darkgrey", "#a9a9a9"),
];

/// Linear albedo of a colour of the screen: `#rrggbb`, `#rgb` or a name.
fn colour(text: &str) -> Option<[f32; 4]> {
    let lower = text.to_lowercase();
    let named = NAMED.iter().find(|(name, _)| *name == lower);
    let hex = named.map_or(lower.as_str(), |(_, hex)| hex);
    let hex = hex.strip_prefix('#').filter(|hex| hex.is_ascii())?;
    let digits: String = match hex.len() {
        3 => hex.chars().flat_map(|c| [c, c]).collect(),
        6 => hex.into(),
        _ => return None,
    };
    let part = |k: usize| u8::from_str_radix(digits.get(2 * k..2 * k + 2)?, 16).ok();
    let linear = |v: u8| (f32::from(v) / 255.0).powf(2.2);
    Some([linear(part(0)?), linear(part(1)?), linear(part(2)?), 1.0])
}

#[cfg(test)]
mod tests;
