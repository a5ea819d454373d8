//! Places by latitude and longitude, or above ground and roofs: written in place of the three numbers of a key that ends in
//! `_enu_m`, and put into the text as these numbers once the city is known.

use std::ops::Range;

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::load::{Found, InputError, Places};
use super::site::Site;
use super::text::{join, one_line};
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};

/// A place, in place of `[east, north, up]` wherever a key ends in `_enu_m`, or of `[east, north]` where one ends in
/// `_en_m`: `{ lat = 47.3769, lon = 8.5417, height_m = 30, above = "roof" }`. It is written on one line, as a whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Place")]
pub struct GivenPlace {
    /// Geodetic latitude (WGS 84), north positive [deg]; with `lon`.
    pub lat: Option<f64>,
    /// Longitude, east positive [deg].
    pub lon: Option<f64>,
    /// East of the site point, in place of `lat` and `lon`; with `north_m`.
    pub east_m: Option<f64>,
    /// North of the site point.
    pub north_m: Option<f64>,
    /// Height above what `above` says.
    #[serde(default)]
    pub height_m: f64,
    /// What the height counts from.
    #[serde(default)]
    pub above: Above,
}

/// What the height of a place counts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Above {
    /// The bare ground there.
    #[default]
    Ground,
    /// The highest surface there: a roof, a bridge, a tree, or the ground where it is open.
    Roof,
    /// The WGS-84 ellipsoid.
    Ellipsoid,
    /// The site point's level.
    Site,
}

impl GivenPlace {
    /// Where it is in the site's frame [m], where that needs no city; else how high above the ground or the roof at
    /// that place.
    pub fn in_site(&self, site: &SiteFrame) -> DVec3 {
        let (Some(lat), Some(lon)) = (self.lat, self.lon) else {
            let [e, n] = [self.east_m, self.north_m].map(Option::unwrap_or_default);
            let up_m = match self.above {
                Above::Ellipsoid => self.up_of_ellipsoid_m(site, DVec2::new(e, n)),
                _ => self.height_m,
            };
            return DVec3::new(e, n, up_m);
        };
        // The vertical of another place leans: heights are those over the place itself.
        let height_m = match self.above {
            Above::Ellipsoid => self.height_m,
            _ => site.origin().height_m,
        };
        let r_enu_m = site.ecef_to_enu(
            Geodetic {
                latitude_rad: lat.to_radians(),
                longitude_rad: lon.to_radians(),
                height_m,
            }
            .to_ecef(),
        );
        match self.above {
            Above::Ellipsoid => r_enu_m,
            _ => r_enu_m.with_z(self.height_m),
        }
    }

    /// Up of a place on the map whose height over the ellipsoid is given.
    fn up_of_ellipsoid_m(&self, site: &SiteFrame, en_m: DVec2) -> f64 {
        // The level surface falls away from the tangent plane by metres in kilometres: two steps settle it.
        let mut up_m = self.height_m - site.origin().height_m;
        for _ in 0..3 {
            let over_m = site.enu_to_geodetic(en_m.extend(up_m)).height_m;
            up_m += self.height_m - over_m;
        }
        up_m
    }

    /// What is wrong with it.
    fn fault(&self) -> Option<String> {
        let earth = self.lat.is_some() && self.lon.is_some();
        let map = self.east_m.is_some() && self.north_m.is_some();
        let given = [self.lat, self.lon, self.east_m, self.north_m];
        if given.iter().flatten().count() != 2 || earth == map {
            return Some("give lat and lon, or east_m and north_m".into());
        }
        let within = |name: &str, value: Option<f64>, most: f64| {
            let value = value.filter(|value| !(-most..=most).contains(value))?;
            Some(format!(
                "{name}: found {value}, must be from {} to {most}",
                -most
            ))
        };
        within("lat", self.lat, 90.0)
            .or_else(|| within("lon", self.lon, 180.0))
            .or_else(|| within("east_m", self.east_m, 50_000.0))
            .or_else(|| within("north_m", self.north_m, 50_000.0))
            .or_else(|| within("height_m", Some(self.height_m), 20_000.0))
    }
}

/// A place as it stands in a scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// The place.
    pub place: GivenPlace,
    /// Dotted path of the value that it takes the place of.
    pub path: String,
    /// Whether that value has no height.
    flat: bool,
    /// The override that it stands in, from 0; `None`: the file.
    set: Option<usize>,
    /// Where in that text.
    span: Range<usize>,
}

/// All places of a scenario's text and its overrides, and what is wrong with others; a text that is no TOML has none.
pub(super) fn find(
    text: &str,
    overrides: &[String],
    places: &Places,
) -> (Vec<Written>, Vec<Found>) {
    let mut found = (Vec::new(), Vec::new());
    if let Ok(table) = DeTable::parse(text) {
        let root = DeValue::Table(table.into_inner());
        look(&root, text, (None, 0), "", false, &mut found, places);
    }
    for (number, set) in overrides.iter().enumerate() {
        let Some((path, value)) = set.split_once('=') else {
            continue;
        };
        let document = format!("v={value}");
        let start = path.len() + 1;
        if let Ok(table) = DeTable::parse(&document)
            && let Some(value) = table.get_ref().get("v")
        {
            // Overrides number list entries by dots.
            let path = path.trim();
            let wanted = is_place_key(path.rsplit('.').find(|key| key.parse::<usize>().is_err()));
            let at = (Some(number), start as isize - 2);
            look_at(value, &document, at, path, wanted, &mut found, places);
        }
    }
    found
}

fn is_place_key(key: Option<&str>) -> bool {
    key.is_some_and(|key| key.ends_with("_enu_m") || key.ends_with("_en_m"))
}

/// Looks for places in a value; `at` says which override the text is, and where it begins there.
fn look(
    value: &DeValue,
    text: &str,
    at: (Option<usize>, isize),
    path: &str,
    wanted: bool,
    found: &mut (Vec<Written>, Vec<Found>),
    places: &Places,
) {
    match value {
        DeValue::Table(table) => {
            for (key, value) in table {
                let mut child = path.to_owned();
                join(&mut child, key.get_ref());
                let wanted = is_place_key(Some(key.get_ref()));
                look_at(value, text, at, &child, wanted, found, places);
            }
        }
        DeValue::Array(array) => {
            for (index, item) in array.iter().enumerate() {
                let child = format!("{path}[{index}]");
                look_at(item, text, at, &child, wanted, found, places);
            }
        }
        _ => {}
    }
}

fn look_at(
    value: &Spanned<DeValue>,
    text: &str,
    at: (Option<usize>, isize),
    path: &str,
    wanted: bool,
    found: &mut (Vec<Written>, Vec<Found>),
    places: &Places,
) {
    let DeValue::Table(_) = value.get_ref() else {
        return look(value.get_ref(), text, at, path, wanted, found, places);
    };
    if !wanted {
        return look(value.get_ref(), text, at, path, false, found, places);
    }
    let span = value.span();
    let own = |k: usize| (k as isize + at.1).max(0) as usize;
    let refuse = |message: String| places.at(at.0, own(span.start), path, &message);
    let written = text.get(span.clone()).unwrap_or_default();
    let place = match read(written) {
        Ok(place) => place,
        Err(message) => {
            found.1.push(refuse(message));
            STAND_IN
        }
    };
    let key = path.split('[').next().unwrap_or_default();
    let last = key.rsplit('.').find(|key| key.parse::<usize>().is_err());
    found.0.push(Written {
        place,
        path: path.to_owned(),
        flat: last.is_some_and(|key| key.ends_with("_en_m")),
        set: at.0,
        span: own(span.start)..own(span.end),
    });
}

/// What stands in for a place that is none, so that the rest can be read.
const STAND_IN: GivenPlace = GivenPlace {
    lat: None,
    lon: None,
    east_m: Some(0.0),
    north_m: Some(500.0),
    height_m: 100.0,
    above: Above::Site,
};

/// The place that a text is; else what is wrong with it.
fn read(written: &str) -> Result<GivenPlace, String> {
    if !written.starts_with('{') {
        return Err("write a place as a whole: { lat = ..., lon = ... }".into());
    }
    #[derive(Deserialize)]
    struct Holder {
        v: GivenPlace,
    }
    let place = toml::from_str::<Holder>(&format!("v={written}"));
    let place = place
        .map_err(|error| one_line(error.message()).replace('`', "'"))?
        .v;
    match place.fault() {
        Some(fault) => Err(fault),
        None => Ok(place),
    }
}

impl Written {
    /// The error of this place.
    pub(super) fn refuse(&self, places: &Places, message: &str) -> InputError {
        (places.at(self.set, self.span.start, &self.path, message)).error
    }
}

/// The text and the overrides with numbers in the places' places, line for line.
pub(super) fn put(
    text: &str,
    overrides: &[String],
    written: &[(&Written, DVec3)],
) -> (String, Vec<String>) {
    let (mut text, mut overrides) = (text.to_owned(), overrides.to_vec());
    // From the last to the first, so that positions stay.
    let mut order: Vec<&(&Written, DVec3)> = written.iter().collect();
    order.sort_by_key(|(at, _)| std::cmp::Reverse(at.span.start));
    for (at, r) in order {
        let target = match at.set {
            None => &mut text,
            Some(number) => match overrides.get_mut(number) {
                Some(set) => set,
                None => continue,
            },
        };
        let Some(old) = target.get(at.span.clone()) else {
            continue;
        };
        let lines = "\n".repeat(old.matches('\n').count());
        let new = match at.flat {
            true => format!("[{:?}, {:?}{lines}]", r.x, r.y),
            false => format!("[{:?}, {:?}, {:?}{lines}]", r.x, r.y, r.z),
        };
        target.replace_range(at.span.clone(), &new);
    }
    (text, overrides)
}

/// The site that a text and its overrides state, as far as they do.
pub(super) fn site(text: &str, overrides: &[String]) -> Option<SiteFrame> {
    let table = DeTable::parse(text).ok();
    let number = |key: &str| {
        let path = format!("site.{key}");
        let set = overrides.iter().rev().find_map(|set| {
            let (at, value) = set.split_once('=')?;
            (at.trim() == path).then(|| value.trim().parse::<f64>().ok())?
        });
        let own = || {
            let DeValue::Table(site) = table.as_ref()?.get_ref().get("site")?.get_ref() else {
                return None;
            };
            let text = match site.get(key)?.get_ref() {
                DeValue::Float(float) => float.as_str().replace('_', ""),
                DeValue::Integer(integer) => integer.as_str().replace('_', ""),
                _ => return None,
            };
            text.parse::<f64>().ok()
        };
        set.or_else(own)
    };
    let site = Site {
        latitude_deg: number("latitude_deg")?,
        longitude_deg: number("longitude_deg")?,
        altitude_m: number("altitude_m")?,
    };
    Some(site.frame())
}
