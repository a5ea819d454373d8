//! What GDAL keeps beside a band's values: scale, offset, unit, the code for missing values, in the file (tag 42112, `GDAL_NODATA`) or in the
//! file beside it (`.aux.xml`).

use crate::sources::error::Fault;
use boresight_common::warning::Notes;
use roxmltree::{Document, Node};
use std::path::Path;

/// What states a scale otherwise.
const MEND: &str = "write the heights themselves (gdal_translate -unscale -ot Float32)";

/// What is stated of the first band.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Band {
    /// Height of a step of the values.
    pub scale: Option<f64>,
    /// Height of the value 0.
    pub offset: Option<f64>,
    /// Unit of the heights, in words.
    pub unit: Option<String>,
    /// The value that stands for none.
    pub missing: Option<f64>,
    /// What the band is said to hold.
    pub description: Option<String>,
}

/// What the file beside a raster states of the raster.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beside {
    /// Of its first band.
    pub band: Band,
    /// Six numbers of its place on the map, as GDAL orders them.
    pub transform: Option<[f64; 6]>,
    /// Its coordinate system, as well-known text.
    pub system: Option<String>,
}

/// A number that an item states.
fn number(place: &str, text: &str) -> Result<f64, Fault> {
    let value = text.trim().parse::<f64>().ok();
    let what = || format!("'{}' is no number", text.trim());
    value
        .filter(|value| value.is_finite())
        .ok_or_else(|| Fault::new(place, what(), MEND))
}

/// The text inside an element.
fn text(node: Node<'_, '_>) -> String {
    let parts = node.descendants().filter(Node::is_text);
    parts.filter_map(|part| part.text()).collect()
}

/// Words of an item's name that speak of values: what it says would change heights.
const TELLING: [&str; 10] = [
    "scale", "offset", "unit", "factor", "nodata", "missing", "fill", "datum", "positive", "sign",
];
/// What such items say where they change nothing.
const NEUTRAL: [&str; 8] = ["", "1", "1.0", "0", "0.0", "m", "metre", "up"];

/// Notes an item of free text that speaks of values, but that no convention gives a meaning.
fn telling(name: &str, value: &str, notes: &mut Notes) {
    let lower = name.to_lowercase();
    let value = value.trim();
    let said = TELLING.iter().any(|word| lower.contains(word)) && !lower.contains("statistics");
    let neutral = NEUTRAL.contains(&value) || ["meter", "metres", "meters"].contains(&value);
    // Horizontal resolutions of TIFF itself.
    if said && !neutral && !lower.starts_with("tifftag") {
        let what = format!("'{value}' is not applied to the heights");
        notes.assume(format!("metadata item {name}"), what, MEND);
    }
}

impl Band {
    /// What the metadata in a file (tag 42112) states of its first band.
    pub fn parse(xml: &str, notes: &mut Notes) -> Result<Self, Fault> {
        let mut band = Self::default();
        if xml.trim().is_empty() {
            return Ok(band);
        }
        let Ok(document) = Document::parse(xml.trim()) else {
            notes.assume(
                "GDAL metadata",
                "they are no XML and are not read",
                "write the file again with gdal_translate",
            );
            return Ok(band);
        };
        let items = document.descendants().filter(|n| n.has_tag_name("Item"));
        for item in items {
            let sample = item.attribute("sample").unwrap_or("0");
            if sample.trim() != "0" {
                continue;
            }
            let name = item.attribute("name").unwrap_or("");
            let value = text(item);
            match item.attribute("role").unwrap_or("").to_lowercase().as_str() {
                "scale" => band.scale = Some(number("GDAL metadata: scale", &value)?),
                "offset" => band.offset = Some(number("GDAL metadata: offset", &value)?),
                "unittype" => band.unit = Some(value.trim().to_string()),
                "description" => band.description = Some(value.trim().to_string()),
                "nodata" => band.missing = Some(number("GDAL metadata: nodata", &value)?),
                // GDAL writes the unit with the role; others write the name alone.
                _ if name.eq_ignore_ascii_case("unittype") => {
                    band.unit = Some(value.trim().to_string());
                }
                _ => telling(name, &value, notes),
            }
        }
        Ok(band)
    }

    /// What is stated here, and else what another states. Where both state something and differ, the other's is noted.
    pub fn or(self, other: Self, notes: &mut Notes) -> Self {
        let mut differ = |what: &str, own: Option<f64>, other: Option<f64>| {
            if let (Some(own), Some(other)) = (own, other)
                && own != other
            {
                let what = format!("{what} {other} is not applied, the file itself states {own}");
                notes.assume(".aux.xml", what, "mend the one that is wrong");
            }
            own.or(other)
        };
        Self {
            scale: differ("scale", self.scale, other.scale),
            offset: differ("offset", self.offset, other.offset),
            missing: differ("no-data value", self.missing, other.missing),
            unit: {
                let (own, other) = (self.unit.clone(), other.unit.clone());
                if let (Some(own), Some(other)) = (&own, &other)
                    && own != other
                {
                    let what =
                        format!("unit '{other}' is not applied, the file itself states '{own}'");
                    notes.assume(".aux.xml", what, "mend the one that is wrong");
                }
                own.or(other)
            },
            description: self.description.or(other.description),
        }
    }
}

impl Beside {
    /// What the file beside a raster states (`dem.tif.aux.xml`, or `dem.aux.xml`); nothing where there is none.
    pub fn read(path: &Path, notes: &mut Notes) -> Result<Self, Fault> {
        let mut longer = path.as_os_str().to_owned();
        longer.push(".aux.xml");
        let found = std::fs::read_to_string(Path::new(&longer))
            .or_else(|_| std::fs::read_to_string(path.with_extension("aux.xml")));
        match found {
            Ok(xml) => Self::parse(&xml, notes),
            Err(_) => Ok(Self::default()),
        }
    }

    /// What a text states (GDAL's persistent auxiliary metadata).
    fn parse(xml: &str, notes: &mut Notes) -> Result<Self, Fault> {
        let xml = xml.trim_start_matches('\u{feff}').trim();
        let document = Document::parse(xml).map_err(|error| {
            let mend = "mend or remove it: it may state scale and unit";
            Fault::new(".aux.xml", format!("it is no XML: {error}"), mend)
        })?;
        let mut beside = Self::default();
        for node in document.root_element().children() {
            match node.tag_name().name() {
                "GeoTransform" => {
                    let text = text(node);
                    let numbers = text.split(',').map(|word| number(".aux.xml", word));
                    let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
                    beside.transform = numbers.try_into().ok();
                }
                "SRS" => beside.system = Some(text(node)),
                "PAMRasterBand" if node.attribute("band").unwrap_or("1") == "1" => {
                    beside.band.take(node, notes)?;
                }
                "GCPList" => notes.assume(
                    ".aux.xml",
                    "its control points are not applied",
                    "place the raster with them first (gdalwarp)",
                ),
                _ => {}
            }
        }
        Ok(beside)
    }
}

impl Band {
    /// Takes what a band's element states.
    fn take(&mut self, band: Node<'_, '_>, notes: &mut Notes) -> Result<(), Fault> {
        for node in band.children().filter(Node::is_element) {
            let value = text(node);
            match node.tag_name().name() {
                "Scale" => self.scale = Some(number(".aux.xml: Scale", &value)?),
                "Offset" => self.offset = Some(number(".aux.xml: Offset", &value)?),
                "UnitType" => self.unit = Some(value.trim().to_string()),
                "NoDataValue" => self.missing = value.trim().parse().ok(),
                "Description" => self.description = Some(value.trim().to_string()),
                "Metadata" => {
                    for item in node.children().filter(|n| n.has_tag_name("MDI")) {
                        let name = item.attribute("key").unwrap_or("");
                        telling(name, &text(item), notes);
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }
}
