//! Outlines of GeoJSON (RFC 7946), alone or as a sequence of rows (RFC 8142, one a line).

use super::outline::Footprint;
use crate::sources::error::Fault;
use crate::sources::json::without_nan;
use boresight_common::warning::Notes;
use geojson::{Geometry, GeometryValue, Position};
use glam::DVec2;
use serde::de::IgnoredAny;
use serde_json::{Deserializer, Map, Value};

/// What stands before each row of a text sequence (RFC 8142).
const RECORD_SEPARATOR: char = '\u{1e}';
/// The kinds of geometry.
const GEOMETRIES: [&str; 7] = [
    "Polygon",
    "MultiPolygon",
    "GeometryCollection",
    "Point",
    "MultiPoint",
    "LineString",
    "MultiLineString",
];
const MEND: &str = "name a GeoJSON file of polygons, or an .osm.pbf file";

/// What a GeoJSON file holds.
#[derive(Debug, Default)]
pub struct Outlines {
    /// Its polygons.
    pub footprints: Vec<Footprint>,
    /// The system that an old file names (GeoJSON 2008), or why it is not understood.
    pub system: Option<Result<String, Fault>>,
    features: u64,
    /// The first feature whose corners have heights.
    high: Option<String>,
}

/// Whether a text in JSON is for this reader to take or to refuse by name: all but CityJSON, by the `type` of the first value wherever that
/// stands among its members.
pub fn is_geojson(bytes: &[u8]) -> bool {
    #[derive(serde::Deserialize)]
    struct Head {
        #[serde(rename = "type")]
        kind: Option<Value>,
    }
    let text = String::from_utf8_lossy(bytes);
    let text = text.trim_start_matches(['\u{feff}', RECORD_SEPARATOR]);
    let head = Deserializer::from_str(text).into_iter::<Head>().next();
    let kind = head.and_then(Result::ok).and_then(|head| head.kind);
    match kind.as_ref().and_then(Value::as_str) {
        Some(kind) => !kind.starts_with("CityJSON"),
        // Damaged, or of another format.
        None => !text.contains("\"CityJSON"),
    }
}

/// The polygons of a GeoJSON text. What has none is said to the notes.
///
/// Fails where the text is no GeoJSON, or another format in JSON.
pub fn read(bytes: &[u8], notes: &mut Notes) -> Result<Outlines, Fault> {
    let text = text(bytes, notes);
    let text = without_nan(&text);
    let mut found = Outlines::default();
    let mut wrong: Option<Fault> = None;
    let mut rows = 0_u64;
    let mut row = |place: String, read: Result<Value, serde_json::Error>, notes: &mut Notes| {
        rows += 1;
        let read = read.map_err(|error| Fault::new("GeoJSON", error, MEND));
        let taken = read.and_then(|value| found.take(value, notes));
        if let Err(fault) = taken {
            notes.leave_out("rows that are no GeoJSON", place);
            wrong.get_or_insert(fault);
        }
    };
    if text.contains(RECORD_SEPARATOR) {
        let rows = text.split(RECORD_SEPARATOR).map(str::trim).enumerate();
        for (k, text) in rows.filter(|(_, row)| !row.is_empty()) {
            row(format!("row {k}"), serde_json::from_str(text), notes);
        }
    } else if is_rows(&text) {
        let rows = text.lines().map(str::trim).enumerate();
        for (k, text) in rows.filter(|(_, row)| !row.is_empty()) {
            row(format!("line {}", k + 1), serde_json::from_str(text), notes);
        }
    } else {
        for (k, value) in Deserializer::from_str(&text).into_iter().enumerate() {
            // Nothing can be read behind a fault.
            let value = value.map_err(|error| Fault::new("GeoJSON", error, MEND))?;
            row(format!("row {}", k + 1), Ok(value), notes);
        }
    }
    if let Some(name) = &found.high {
        let what = format!("heights of corners are not read (first {name})");
        let mend = "buildings stand on --terrain, or at --base-height";
        notes.assume("coordinates", what, mend);
    }
    match wrong {
        Some(fault) if rows == 1 || found.features == 0 => Err(fault),
        _ if rows == 0 => Err(Fault::new("GeoJSON", "the file is empty", MEND)),
        _ => Ok(found),
    }
}

/// The text of a file, without its byte-order mark.
fn text(bytes: &[u8], notes: &mut Notes) -> String {
    let text = String::from_utf8_lossy(bytes);
    if let std::borrow::Cow::Owned(_) = text {
        let what = "some of its text is not UTF-8, those letters are lost";
        notes.assume("text", what, "save it as UTF-8");
    }
    text.strip_prefix('\u{feff}').unwrap_or(&text).to_string()
}

/// Whether each line is a value of its own: the first is whole.
fn is_rows(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let first = lines.next();
    lines.next().is_some()
        && first.is_some_and(|first| serde_json::from_str::<IgnoredAny>(first).is_ok())
}

impl Outlines {
    /// Takes in one value of the file.
    fn take(&mut self, value: Value, notes: &mut Notes) -> Result<(), Fault> {
        let Value::Object(mut members) = value else {
            return Err(Fault::new("GeoJSON", "a value that is no object", MEND));
        };
        let kind = members
            .get("type")
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_string();
        refuse_others(&members, &kind)?;
        if let Some(crs) = members.get("crs") {
            self.system_of(crs, notes);
        }
        match (kind.as_str(), members.remove("features")) {
            ("FeatureCollection" | "", Some(Value::Array(features))) => {
                for feature in features {
                    self.feature(feature, notes);
                }
            }
            ("FeatureCollection", None | Some(Value::Null)) => {}
            ("Feature", _) => self.feature(Value::Object(members), notes),
            (kind, _) if GEOMETRIES.contains(&kind) => {
                self.features += 1;
                let name = format!("geometry {}", self.features);
                self.geometry(Value::Object(members), Map::new(), name, notes);
            }
            _ => {
                let what = match kind.as_str() {
                    "" => "no member \"type\" says what it is".into(),
                    kind => format!("its type {kind:?} is none of GeoJSON"),
                };
                return Err(Fault::new("GeoJSON", what, MEND));
            }
        }
        Ok(())
    }

    /// Takes in a feature.
    fn feature(&mut self, feature: Value, notes: &mut Notes) {
        self.features += 1;
        let mut name = format!("feature {}", self.features);
        let Value::Object(mut members) = feature else {
            return notes.leave_out("features that are no objects", name);
        };
        let mut known = match members.remove("properties") {
            Some(Value::Object(known)) => known,
            _ => Map::new(),
        };
        let id = match members.remove("id") {
            Some(Value::String(text)) => Some(text),
            Some(Value::Number(number)) => Some(number.to_string()),
            _ => None,
        };
        if let Some(id) = id {
            name = format!("{name}, id {id}");
            known.entry("id").or_insert(Value::from(id));
        }
        match members.remove("geometry") {
            None | Some(Value::Null) if members.get("place").is_some_and(Value::is_object) => {
                notes.leave_out("features with a place of JSON-FG alone", name);
            }
            None | Some(Value::Null) => notes.leave_out("features without a geometry", name),
            Some(geometry) => self.geometry(geometry, known, name, notes),
        }
    }

    /// Takes in the polygons of a geometry.
    fn geometry(
        &mut self,
        geometry: Value,
        known: Map<String, Value>,
        name: String,
        notes: &mut Notes,
    ) {
        let geometry: Geometry = match serde_json::from_value(geometry) {
            Ok(geometry) => geometry,
            Err(error) => {
                let place = format!("{name}: {error}");
                return notes.leave_out("features whose geometry is damaged", place);
            }
        };
        let before = self.footprints.len();
        let kind = geometry.value.type_name();
        self.polygons(geometry.value, &known, &name);
        if self.footprints.len() == before {
            notes.leave_out("features without a polygon", format!("{name}, {kind}"));
        }
    }

    /// Gathers the polygons of a geometry.
    fn polygons(&mut self, value: GeometryValue, known: &Map<String, Value>, name: &str) {
        let mut add = |rings: Vec<Vec<Position>>| {
            let point = |p: &Position| {
                let number = |k: usize| p.as_slice().get(k).copied().unwrap_or(f64::NAN);
                DVec2::new(number(0), number(1))
            };
            let high = |p: &Position| p.as_slice().get(2).is_some_and(|z| *z != 0.0);
            if self.high.is_none() && rings.iter().flatten().any(high) {
                self.high = Some(name.to_string());
            }
            if rings.first().is_some_and(|ring| !ring.is_empty()) {
                self.footprints.push(Footprint {
                    rings: (rings.iter())
                        .map(|ring| ring.iter().map(point).collect())
                        .collect(),
                    known: known.clone(),
                    name: name.to_string(),
                });
            }
        };
        match value {
            GeometryValue::Polygon { coordinates } => add(coordinates),
            GeometryValue::MultiPolygon { coordinates } => coordinates.into_iter().for_each(add),
            GeometryValue::GeometryCollection { geometries } => {
                for geometry in geometries {
                    self.polygons(geometry.value, known, name);
                }
            }
            _ => {}
        }
    }

    /// Takes in the `crs` member of an old file.
    fn system_of(&mut self, crs: &Value, notes: &mut Notes) {
        if crs.is_null() {
            let what = "null: no system is stated, longitudes and latitudes on WGS 84 are taken";
            return notes.assume("crs", what, "name another with --crs");
        }
        let found = named(crs).ok_or_else(|| {
            let what = format!("{crs} is not understood");
            Fault::new("crs", what, "name the system with --crs")
        });
        match &self.system {
            Some(Ok(first)) if found.as_ref() != Ok(first) => {
                let what = format!("{crs} in a file whose first system is {first}");
                self.system = Some(Err(Fault::new("crs", what, "split the file by system")));
            }
            Some(_) => {}
            None => self.system = Some(found),
        }
    }
}

/// The system of a `crs` member in its forms: a name, a code of EPSG's, or a link to one.
fn named(crs: &Value) -> Option<String> {
    if let Some(name) = crs.as_str() {
        return Some(name.to_string());
    }
    let about = crs.get("properties").unwrap_or(crs);
    if let Some(name) = about.get("name").and_then(Value::as_str) {
        return Some(name.to_string());
    }
    let code = about
        .get("code")
        .map(|code| code.to_string().replace('"', ""));
    if let Some(code) = code {
        return Some(match code.contains(':') {
            true => code,
            false => format!("EPSG:{code}"),
        });
    }
    let link = about.get("href")?.as_str()?.to_lowercase();
    let (_, behind) = link.split_once("epsg")?;
    let digits = |part: &&str| !part.is_empty() && part.bytes().all(|c| c.is_ascii_digit());
    let code = behind.split(['/', ':', '.', '?', '=']).rfind(digits)?;
    Some(format!("EPSG:{code}"))
}

/// An error for other formats that are written in JSON, with the way to GeoJSON.
fn refuse_others(members: &Map<String, Value>, kind: &str) -> Result<(), Fault> {
    let esri = members.contains_key("geometryType") || members.contains_key("spatialReference");
    let (what, mend) = match kind {
        "CityJSON" | "CityJSONFeature" => ("CityJSON, not GeoJSON", "end its name in .city.json"),
        "Topology" => (
            "TopoJSON, which is not read",
            "convert it (topo2geo, or ogr2ogr city.geojson city.json)",
        ),
        "" if members.contains_key("osm3s") => (
            "Overpass JSON, which is not read",
            "convert it (osmtogeojson city.json > city.geojson)",
        ),
        "" if esri => (
            "Esri JSON, which is not read",
            "convert it (ogr2ogr city.geojson city.json)",
        ),
        _ => return Ok(()),
    };
    Err(Fault::new("GeoJSON", format!("it is {what}"), mend))
}
