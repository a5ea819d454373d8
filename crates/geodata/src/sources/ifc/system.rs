//! Coordinate reference systems as IFC files name them.

use super::model::{DEEPEST, Model};
use super::units::named_unit_m;
use crate::projection::Crs;
use crate::sources::error::Fault;
use boresight_common::warning::Notes;
use ifc_lite_core::{AttributeValue, DecodedEntity, IfcType};

/// A system that a file names.
#[derive(Clone, Debug, Default)]
pub struct System {
    /// The record.
    pub place: String,
    /// Its name, mostly an EPSG code.
    pub name: Option<String>,
    description: Option<String>,
    datum: Option<String>,
    vertical: Option<String>,
    projection: Option<String>,
    zone: Option<String>,
    /// Its definition as well-known text.
    pub definition: Option<String>,
    /// Metres in the unit of a map, or of the heights of a geographic system.
    pub unit_m: Option<f64>,
    /// Whether it counts longitudes and latitudes.
    pub geographic: bool,
    /// Radians in its unit of angles.
    pub angle_rad: f64,
}

impl System {
    /// The same, stated in a record.
    pub fn at(self, place: &str) -> Self {
        Self {
            place: place.into(),
            angle_rad: 1.0,
            ..self
        }
    }

    /// `IfcProjectedCRS` or `IfcGeographicCRS`.
    pub fn read(model: &mut Model, record: &DecodedEntity) -> Result<Self, Fault> {
        let place = format!("#{} {}", record.id, record.ifc_type.name());
        let text = |slot: usize| {
            let text = record.get_string(slot).map(str::trim);
            text.filter(|text| !text.is_empty()).map(str::to_string)
        };
        let mut system = Self {
            name: text(0),
            description: text(1),
            datum: text(2),
            geographic: record.ifc_type == IfcType::IfcGeographicCRS,
            ..Self::default()
        }
        .at(&place);
        if system.geographic {
            let meridian = text(3).unwrap_or_default();
            let own = ["", "greenwich", "0"].contains(&meridian.to_lowercase().as_str());
            if !own {
                let what = format!("its prime meridian '{meridian}' is not Greenwich");
                return Err(Fault::new(place, what, "name the system with --crs"));
            }
            system.angle_rad = match model.at(record, 4) {
                Some(unit) => model.unit(&unit, "RADIAN", DEEPEST)?,
                None => model.angle_rad,
            };
            let unit = model.at(record, 5);
            system.unit_m = unit.map(|unit| model.unit_m(&unit)).transpose()?;
            return Ok(system);
        }
        system.vertical = text(3);
        system.projection = text(4);
        system.zone = text(5);
        if record.get(6).is_some_and(|unit| !unit.is_null()) {
            let missing = || Fault::new(&place, "its MapUnit is missing", "mend the file");
            let unit = model.at(record, 6).ok_or_else(missing)?;
            system.unit_m = Some(model.unit_m(&unit)?);
        }
        Ok(system)
    }

    /// `ePSet_ProjectedCRS`.
    pub fn of_properties(model: &mut Model, set: &DecodedEntity) -> Result<Self, Fault> {
        let place = format!("#{} {}", set.id, set.get_string(2).unwrap_or_default());
        let mut system = Self::default().at(&place);
        for (name, property) in properties(model, set) {
            let text = property.get_string(2).map(str::trim);
            let text = text.filter(|text| !text.is_empty()).map(str::to_string);
            match name.as_str() {
                "name" => system.name = text,
                "description" => system.description = text,
                "geodeticdatum" => system.datum = text,
                "verticaldatum" => system.vertical = text,
                "mapprojection" => system.projection = text,
                "mapzone" => system.zone = text,
                "mapunit" => {
                    let Some(text) = text else { continue };
                    let what = format!("its MapUnit '{text}' is not known");
                    let unknown = || Fault::new(&place, what, "write METRE or FOOT");
                    system.unit_m = Some(named_unit_m(&text).ok_or_else(unknown)?);
                }
                _ => {}
            }
        }
        Ok(system)
    }

    /// The name under which the system is known here, with its heights where they are stated; what was taken for granted is noted.
    pub fn known_name(&self, notes: &mut Notes) -> Option<String> {
        let own = self.name.as_deref().and_then(known);
        let name = own.or_else(|| {
            let described = self.description.as_deref().and_then(coded);
            let defined = || self.definition.as_deref().and_then(identified);
            let found = described.or_else(defined).or_else(|| self.utm())?;
            let stated = self.name.as_deref().unwrap_or_default();
            let what = format!("'{stated}' is taken as {found}");
            notes.assume(&self.place, what, "name it with --crs");
            Some(found)
        });
        // What is not known is named in the error.
        let name = name.or_else(|| self.name.clone())?;
        let Ok(crs) = Crs::parse(&name) else {
            return Some(name);
        };
        let Some(vertical) = self
            .vertical
            .as_deref()
            .filter(|_| !crs.heights_are_stated())
        else {
            return Some(name);
        };
        let heights = heights(vertical).filter(|heights| {
            let with = format!("{name}+{heights}");
            Crs::parse(&with).is_ok()
        });
        match heights {
            Some(heights) => Some(format!("{name}+{heights}")),
            None => {
                let what = format!(
                    "its vertical datum '{vertical}' is not known: {}",
                    crs.heights_in_words()
                );
                let mend = format!("state it with --crs {name}+geoid or {name}+ellipsoid");
                notes.assume(&self.place, what, mend);
                Some(format!("{name}+geoid"))
            }
        }
    }

    /// Whether words beside its name say which it is.
    pub fn is_described(&self) -> bool {
        let words = [&self.description, &self.definition, &self.projection];
        words.into_iter().any(Option::is_some)
    }

    /// The code of a UTM zone that is named in words.
    fn utm(&self) -> Option<String> {
        let words = [&self.name, &self.description, &self.projection, &self.zone];
        let words: Vec<String> = words
            .into_iter()
            .flatten()
            .map(|text| text.to_uppercase())
            .collect();
        let all = words.join(" ");
        if !all.contains("UTM") {
            return None;
        }
        let zone = (words.iter().rev()).find_map(|text| {
            let text = text.replace("UTM", " ").replace("ZONE", " ");
            let parts: Vec<&str> = text.split(|c: char| !c.is_alphanumeric()).collect();
            parts.iter().enumerate().find_map(|(k, part)| {
                let digits = part.trim_end_matches(|c: char| c.is_alphabetic());
                let zone: u32 = digits.parse().ok()?;
                let half = match &part[digits.len()..] {
                    "" => parts.get(k + 1).copied().unwrap_or(""),
                    own => own,
                };
                // The bands of latitude from C to M lie in the south.
                let band = half.len() == 1 && ("C"..="M").contains(&half);
                let south = band || ["S", "SOUTH"].contains(&half);
                (1..=60).contains(&zone).then_some((zone, south))
            })
        });
        let (zone, south) = zone?;
        let datum = self.datum.as_deref().unwrap_or(&all).to_uppercase();
        let etrs = datum.contains("ETRS") || datum.contains("6258");
        let wgs = datum.contains("WGS") || datum.contains("6326");
        let nad83 = datum.contains("NAD83") || datum.contains("6269");
        match (etrs, wgs, south) {
            _ if nad83 && !south && zone <= 23 => Some(format!("EPSG:{}", 26900 + zone)),
            (true, _, false) if (28..=38).contains(&zone) => Some(format!("EPSG:{}", 25800 + zone)),
            (_, true, false) => Some(format!("EPSG:{}", 32600 + zone)),
            (_, true, true) => Some(format!("EPSG:{}", 32700 + zone)),
            _ => None,
        }
    }
}

/// The properties of a set: their names in small letters and their records.
pub fn properties(model: &mut Model, set: &DecodedEntity) -> Vec<(String, DecodedEntity)> {
    let all = model.all(set, 4).into_iter();
    let named = |property: DecodedEntity| {
        let name = property.get_string(0)?.trim().to_lowercase();
        let stated = property
            .get(2)
            .is_some_and(|value: &AttributeValue| !value.is_null());
        stated.then_some((name, property))
    };
    all.filter_map(named).collect()
}

/// A name that is known here, in one of the spellings that files have.
fn known(name: &str) -> Option<String> {
    let tight: String = name.split_whitespace().collect();
    let tight = tight.replace(['/', '_'], ":");
    let all = [name.trim().to_string(), tight];
    let found = all.into_iter().find(|name| Crs::parse(name).is_ok());
    found.or_else(|| coded(name))
}

/// The code behind the letters EPSG in a text.
fn coded(text: &str) -> Option<String> {
    let upper = text.to_uppercase();
    let after = &upper[upper.find("EPSG")? + 4..];
    let from = after
        .find(|c: char| c.is_ascii_digit())
        .filter(|k| *k < 4)?;
    let digits: String = after[from..]
        .chars()
        .take_while(char::is_ascii_digit)
        .collect();
    let name = format!("EPSG:{digits}");
    Crs::parse(&name).is_ok().then_some(name)
}

/// The code that a well-known text ends with: that of the whole stands last.
fn identified(text: &str) -> Option<String> {
    coded(&text[text.to_ascii_uppercase().rfind("EPSG")?..])
}

/// What a vertical datum's name says behind a horizontal code: an EPSG code, `geoid` or `ellipsoid`.
fn heights(name: &str) -> Option<String> {
    let word: String = name.chars().filter(|c| c.is_alphanumeric()).collect();
    let word = word.to_uppercase();
    let digits = word
        .trim_start_matches("EPSG")
        .trim_start_matches("URNOGCDEFCRS");
    let digits = digits.trim_start_matches("EPSG");
    if !digits.is_empty() && digits.chars().all(|c| c.is_ascii_digit()) {
        return Some(digits.into());
    }
    let any = |names: &[&str]| names.iter().any(|name| word.contains(name));
    if any(&["ELLIPS"]) || ["WGS84", "GRS80", "ETRS89"].contains(&word.as_str()) {
        return Some("ellipsoid".into());
    }
    // Levellings and geoids, as files abbreviate them.
    let over_the_sea = any(&[
        "DHHN",
        "NHN",
        "NAP",
        "AMSTERDAM",
        "LN02",
        "LHN95",
        "EGM",
        "NAVD",
        "NGVD",
        "NEWLYN",
        "AHD",
        "RH2000",
        "RH70",
        "NN2000",
        "NN1954",
        "N2000",
        "N60",
        "DVR90",
        "EVRF",
        "EVRS",
        "IGN69",
        "NGF",
        "SEALEVEL",
        "OSTEND",
        "TAW",
        "KRONSTA",
        "KRON86",
        "BALTIC",
        "BPV",
        "TRIEST",
        "GHA",
        "GENOA",
        "GENOVA",
        "MALIN",
        "CASCAIS",
        "ALICANTE",
        "GEOID",
        "NZVD",
        "JGD",
        "QUASI",
        "ORTHOMETRIC",
    ]) || ["NN", "ODN", "OD", "MSL", "SL", "NMM"].contains(&word.as_str());
    over_the_sea.then(|| "geoid".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_in_many_spellings() {
        for (name, want) in [
            ("EPSG:25832", "EPSG:25832"),
            ("epsg: 25832", "epsg: 25832"),
            ("EPSG/25832", "EPSG/25832"),
            ("EPSG 25832", "EPSG:25832"),
            ("25832", "25832"),
            ("urn:ogc:def:crs:EPSG::25832", "urn:ogc:def:crs:EPSG::25832"),
            ("ETRS89 / UTM zone 32N (EPSG:25832)", "EPSG:25832"),
        ] {
            assert_eq!(known(name).as_deref(), Some(want), "{name}");
        }
        assert_eq!(
            (known("Gauss"), known("EPSG:1"), known("")),
            (None, None, None)
        );
    }

    #[test]
    fn zones_and_heights_are_understood_in_words() {
        let utm = |projection: &str, zone: &str, datum: &str| {
            let system = System {
                projection: Some(projection.into()),
                zone: Some(zone.into()),
                datum: Some(datum.into()),
                ..System::default()
            };
            system.utm()
        };
        assert_eq!(utm("UTM", "32N", "ETRS89").as_deref(), Some("EPSG:25832"));
        assert_eq!(utm("UTM", "UTM32", "WGS84").as_deref(), Some("EPSG:32632"));
        assert_eq!(
            utm("utm grid", "Zone 56 South", "WGS 84").as_deref(),
            Some("EPSG:32756")
        );
        assert_eq!(utm("UTM", "17T", "NAD83").as_deref(), Some("EPSG:26917"));
        assert_eq!(utm("UTM", "23K", "WGS84").as_deref(), Some("EPSG:32723"));
        assert_eq!(utm("Gauss-Krüger", "3", "DHDN"), None);
        for (name, want) in [
            ("EPSG:7837", Some("7837")),
            ("DHHN2016", Some("geoid")),
            ("Normaal Amsterdams Peil (NAP)", Some("geoid")),
            ("WGS84 ellipsoid", Some("ellipsoid")),
            ("mine", None),
        ] {
            assert_eq!(heights(name).as_deref(), want, "{name}");
        }
    }
}
