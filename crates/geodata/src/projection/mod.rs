//! Coordinate reference systems: from any projected, geographic or geocentric system to WGS 84 and back.
//!
//! The projections are those of `proj4rs`, with `crs-definitions`' parameters by EPSG code, and so are the datum shifts: the
//! seven (or three) parameters of each code, no grids (docs/georeferencing.md says what that costs). Heights are over the
//! ellipsoid or over a geoid. National heights over a geoid are taken as heights over EGM96's.

mod error;
pub mod vertical;

pub use error::CrsError;
pub use vertical::Heights;

use boresight_models::maths::geodesy::{Geodetic, longitude_arc_deg, longitude_near_deg};
use glam::{DVec2, DVec3};
use proj4rs::Proj;
use proj4rs::transform::transform;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// Heights over the ellipsoid [m] that a place on the Earth may have: from below the deepest sea to where space begins.
pub const HEIGHTS_M: std::ops::RangeInclusive<f64> = -12_000.0..=100_000.0; // [m]
/// Distances from the Earth's centre [m] that such heights allow.
pub const RADII_M: std::ops::RangeInclusive<f64> = 6_344_000.0..=6_479_000.0; // [m]
/// How far from its central meridian a transverse Mercator projection is used at most [deg]: Norway in one zone needs 16. What lies farther
/// has its columns swapped.
const REACH_DEG: f64 = 18.0; // [deg]

/// Parts of PROJ strings that are replaced: of the two series for the transverse Mercator the one that stays exact far from the
/// meridian, and datum shifts of three countries with the parameters of EPSG 1314, 1777 and 5239.
const REPLACED: [(&str, &str); 4] = [
    ("+proj=tmerc", "+proj=etmerc"),
    (
        "+datum=OSGB36",
        "+ellps=airy +towgs84=446.448,-125.157,542.06,0.15,0.247,0.842,-20.489",
    ),
    (
        "+datum=potsdam",
        "+ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7",
    ),
    (
        "+towgs84=589,76,480,0,0,0,0",
        "+towgs84=572.213,85.334,461.94,4.9732,1.529,5.2484,3.5378",
    ),
];

/// A coordinate reference system. Coordinates are always east or longitude first, then north or latitude, then the height,
/// whatever order its register states; X, Y, Z in a geocentric one. Angles are in degrees, lengths in the system's own unit.
#[derive(Clone)]
pub struct Crs {
    name: String,
    proj: Proj,
    wgs84: Proj,
    heights: Heights,
    stated: bool,
    height_unit_m: f64,
    /// Whether the name says what unit its heights are in.
    unit_stated: bool,
    /// Central meridian of a transverse Mercator projection [deg].
    meridian_deg: Option<f64>,
    geoid: Geoid,
}

impl fmt::Debug for Crs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Crs({}, {:?})", self.name, self.heights)
    }
}

impl Crs {
    /// A system by its EPSG code (`EPSG:7415`, its URN or address), horizontal and vertical codes (`EPSG:28992+5709`), a name
    /// (`WGS84`, `CRS84`) or a PROJ string. `+ellipsoid` and `+geoid` behind a horizontal one say what heights are counted from.
    /// Where nothing does, heights with a geographic system are over the ellipsoid (RFC 7946), with a projected one over the
    /// geoid, as surveys give them.
    pub fn parse(text: &str) -> Result<Self, CrsError> {
        let text = text.trim();
        let unknown = || CrsError::Unknown(text.into());
        let (definition, vertical) = if text.starts_with('+') {
            let own = |word: &&str| ["+ellipsoid", "+geoid"].contains(word);
            let words = text.split_whitespace();
            let definition = words.clone().filter(|word| !own(word)).collect::<Vec<_>>();
            let vertical = words.filter(own).map(|word| word[1..].to_string()).next();
            (definition.join(" "), vertical)
        } else {
            let mut named = text
                .split(['+', ','])
                .filter(|part| !part.ends_with(":crs"));
            let first = named.next().unwrap_or("");
            let compound = epsg(first).and_then(vertical::parts);
            let definition = match compound {
                Some((horizontal, _)) => by_code(horizontal),
                None => definition(first),
            };
            let own = compound.map(|(_, vertical)| vertical.to_string());
            let vertical = named.next().map(|part| last(part).to_lowercase()).or(own);
            if named.next().is_some() {
                return Err(unknown());
            }
            (definition.ok_or_else(unknown)?, vertical)
        };
        let unsupported = |error: proj4rs::errors::Error| CrsError::Unsupported {
            name: text.into(),
            what: error.to_string(),
        };
        let replace = |text: String, (old, new): &(&str, &str)| text.replace(old, new);
        let exact = REPLACED.iter().fold(definition.clone(), replace);
        let proj = Proj::from_proj_string(&exact).map_err(unsupported)?;
        if !proj.has_inverse() {
            let what = "its projection has no inverse here".into();
            let name = text.into();
            return Err(CrsError::Unsupported { name, what });
        }
        let wgs84 = "+proj=longlat +datum=WGS84 +no_defs";
        let wgs84 = Proj::from_proj_string(wgs84).map_err(unsupported)?;
        let compound = definition.contains("+vunits") || definition.contains("+geoidgrids");
        let heights = match compound {
            true => Heights::Geoid("of the PROJ string"),
            false if proj.is_latlong() || proj.is_geocent() => Heights::Ellipsoid,
            false => Heights::Geoid("EGM96"),
        };
        let found = Self {
            name: text.into(),
            stated: compound || proj.is_geocent() || last(text) == "CRS84h",
            height_unit_m: if compound { proj.vto_meter() } else { 1.0 },
            unit_stated: definition.contains("+vunits"),
            meridian_deg: meridian_deg(&definition),
            proj,
            wgs84,
            heights,
            geoid: Geoid::default(),
        };
        match vertical {
            Some(vertical) => found.over(&vertical),
            None => Ok(found),
        }
    }

    /// The same system with heights counted as a vertical code says, `ellipsoid` or `geoid`.
    fn over(mut self, vertical: &str) -> Result<Self, CrsError> {
        match vertical {
            "ellipsoid" => self.heights = Heights::Ellipsoid,
            "geoid" => self.heights = Heights::Geoid("EGM96"),
            code => {
                let found = vertical::vertical(code)?;
                self.heights = found.heights;
                self.height_unit_m = found.unit_m;
                self.unit_stated = true;
            }
        }
        self.stated = true;
        Ok(self)
    }

    /// The same system with heights counted as a vertical code says; its name gets the code.
    pub fn with_vertical(self, code: &str) -> Result<Self, CrsError> {
        let mut found = self.over(code)?;
        found.name = format!("{}+{code}", found.name);
        Ok(found)
    }

    /// The same system with heights in a unit of so many metres.
    pub fn with_height_unit(mut self, unit_m: f64) -> Self {
        self.height_unit_m = unit_m;
        self
    }

    /// Metres in the unit of its heights.
    pub fn height_unit_m(&self) -> f64 {
        self.height_unit_m
    }

    /// Whether its name says in which unit its heights are.
    pub fn height_unit_is_stated(&self) -> bool {
        self.unit_stated
    }

    /// Metres in the unit of its east and north; 1 in a geographic one.
    pub fn map_unit_m(&self) -> f64 {
        if self.is_geographic() {
            1.0
        } else {
            self.proj.to_meter()
        }
    }

    /// The same system over a geoid that lies `height_m` [m] above the ellipsoid everywhere. Whoever states that height has heights
    /// over the geoid, where the system's name says nothing else.
    pub fn with_geoid_height(mut self, height_m: f64) -> Self {
        self.geoid.constant_m = Some(height_m);
        if !self.stated {
            self.heights = Heights::Geoid("stated");
            self.stated = true;
        }
        self
    }

    /// Its name, as it was given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What its heights are counted from.
    pub fn heights(&self) -> Heights {
        self.heights
    }

    /// Its heights in words, with whether that was assumed.
    pub fn heights_in_words(&self) -> String {
        let assumed = if self.stated {
            ""
        } else {
            ", as nothing else is said"
        };
        match (self.heights, self.geoid.constant_m) {
            (Heights::Ellipsoid, _) => format!("heights over WGS 84's ellipsoid{assumed}"),
            (Heights::Geoid("stated"), Some(m)) => {
                format!("heights over the geoid, {m} m above the ellipsoid")
            }
            (Heights::Geoid(name), Some(m)) => {
                format!("heights over the geoid ({name}), {m} m above the ellipsoid{assumed}")
            }
            (Heights::Geoid("EGM96"), None) => format!("heights over EGM96's geoid{assumed}"),
            (Heights::Geoid(name), None) => {
                format!("heights over the geoid ({name}), taken as EGM96's{assumed}")
            }
        }
    }

    /// Whether its name says what heights are counted from, or that was assumed.
    pub fn heights_are_stated(&self) -> bool {
        self.stated
    }

    /// Lowest and highest corner of points in this system's coordinates. Longitudes that lie across ±180° or 0° are taken on one side
    /// of it, so that the middle of the corners is the middle of the points.
    pub fn bounds(&self, points: impl Iterator<Item = DVec3> + Clone) -> [DVec3; 2] {
        let arc = longitude_arc_deg(points.clone().map(|r| r.x)).filter(|_| self.is_geographic());
        let middle = arc.map(|[west, east]| (west + east) / 2.0);
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for r in points {
            let r = r.with_x(middle.map_or(r.x, |middle| longitude_near_deg(r.x, middle)));
            bounds = [bounds[0].min(r), bounds[1].max(r)];
        }
        bounds
    }

    /// Whether its coordinates are longitude and latitude [deg].
    pub fn is_geographic(&self) -> bool {
        self.proj.is_latlong()
    }

    /// Metres in its units of easting, northing and height; one for a geographic system's longitude and latitude.
    pub fn units_m(&self) -> DVec3 {
        let flat_m = if self.is_geographic() {
            1.0
        } else {
            self.proj.to_meter()
        };
        DVec3::new(flat_m, flat_m, self.height_unit_m)
    }

    /// Whether its coordinates are X, Y and Z from the centre of the Earth.
    pub fn is_geocentric(&self) -> bool {
        self.proj.is_geocent()
    }

    /// The point at `r` (east or longitude, north or latitude, height), on WGS 84.
    pub fn to_geodetic(&self, r: DVec3) -> Result<Geodetic, CrsError> {
        let outside = || CrsError::Outside {
            name: self.name.clone(),
            x: r.x,
            y: r.y,
            z: r.z,
        };
        let z_m = if self.is_geocentric() {
            r.z
        } else {
            r.z * self.height_unit_m
        };
        let off = |why: String| CrsError::OffEarth {
            name: self.name.clone(),
            x: r.x,
            y: r.y,
            z: r.z,
            why,
        };
        if self.is_geocentric() && r.is_finite() && !RADII_M.contains(&r.length()) {
            let far_km = r.length() / 1e3;
            return Err(off(format!(
                "it is {far_km:.0} km from the centre, whose surface is 6357 to 6378 km from it"
            )));
        }
        // The projection gets the height as that over its own ellipsoid: national ellipsoids lie within metres of the geoid.
        let mut point = if self.is_geographic() {
            // Some rasters run from 0° to 360°.
            if r.y.abs() > 90.0 || r.x.abs() > 361.0 {
                return Err(outside());
            }
            (r.x.to_radians(), r.y.to_radians(), z_m)
        } else {
            (r.x, r.y, z_m / self.proj.vto_meter())
        };
        transform(&self.proj, &self.wgs84, &mut point).map_err(|_| outside())?;
        let (longitude_rad, latitude_rad, height_m) = point;
        let height_m = match self.heights {
            _ if self.is_geocentric() => height_m,
            Heights::Ellipsoid => z_m,
            Heights::Geoid(_) => z_m + self.geoid.height_m(latitude_rad, longitude_rad),
        };
        let found = Geodetic {
            latitude_rad,
            longitude_rad,
            height_m,
        };
        let all = [latitude_rad, longitude_rad, height_m];
        if !all.iter().all(|v| v.is_finite()) || latitude_rad.abs() > FRAC_PI_2 + 1e-9 {
            return Err(outside());
        }
        if !HEIGHTS_M.contains(&height_m) {
            return Err(off(format!("its height would be {height_m:.0} m")));
        }
        if let Some(meridian_deg) = self.meridian_deg {
            let longitude_deg = longitude_rad.to_degrees();
            let apart_deg = longitude_near_deg(longitude_deg, meridian_deg) - meridian_deg;
            if apart_deg.abs() > REACH_DEG {
                let apart_deg = apart_deg.abs();
                return Err(off(format!(
                    "it would be {apart_deg:.0}° from the meridian of the projection"
                )));
            }
        }
        Ok(found)
    }

    /// The ECEF position [m] of `r` (east or longitude, north or latitude, height).
    pub fn to_ecef(&self, r: DVec3) -> Result<DVec3, CrsError> {
        Ok(self.to_geodetic(r)?.to_ecef())
    }

    /// East or longitude and north or latitude of a point: the way back of [`Crs::to_geodetic`] without its height.
    pub fn horizontal(&self, point: Geodetic) -> Result<DVec2, CrsError> {
        let (longitude_rad, latitude_rad) = (point.longitude_rad, point.latitude_rad);
        let outside = || CrsError::Outside {
            name: self.name.clone(),
            x: longitude_rad.to_degrees(),
            y: latitude_rad.to_degrees(),
            z: point.height_m,
        };
        let unsupported = !self.proj.has_forward() || self.is_geocentric();
        let over = match self.heights {
            Heights::Ellipsoid => point.height_m,
            Heights::Geoid(_) => point.height_m - self.geoid.height_m(latitude_rad, longitude_rad),
        };
        let mut there = (longitude_rad, latitude_rad, over);
        let result = transform(&self.wgs84, &self.proj, &mut there);
        if unsupported || result.is_err() || !(there.0.is_finite() && there.1.is_finite()) {
            return Err(outside());
        }
        Ok(if self.is_geographic() {
            DVec2::new(there.0.to_degrees(), there.1.to_degrees())
        } else {
            DVec2::new(there.0, there.1)
        })
    }
}

/// What stands behind the last colon or slash.
fn last(part: &str) -> &str {
    part.rsplit([':', '/']).next().unwrap_or(part).trim()
}

/// The PROJ string of a horizontal system.
fn definition(part: &str) -> Option<String> {
    let lower = part.to_lowercase();
    if ["wgs84", "wgs 84", "crs84", "crs84h"].contains(&last(&lower)) {
        return Some("+proj=longlat +datum=WGS84 +no_defs".into());
    }
    by_code(epsg(part)?.try_into().ok()?)
}

/// The EPSG code that a name is or ends with.
fn epsg(part: &str) -> Option<u32> {
    let word = last(part);
    let epsg = part.to_lowercase().contains("epsg") || word == part.trim();
    word.parse().ok().filter(|_| epsg)
}

/// The PROJ string of a code.
fn by_code(code: u16) -> Option<String> {
    definition_of(code).map(Into::into)
}

/// The PROJ string of EPSG's code of a horizontal system; `None` where the register has none.
pub fn definition_of(code: u16) -> Option<&'static str> {
    crs_definitions::from_code(code).map(|found| found.proj4)
}

/// Central meridian of a transverse Mercator projection [deg].
fn meridian_deg(definition: &str) -> Option<f64> {
    let value = |key: &str| {
        let words = definition.split_whitespace();
        let mut values = words.filter_map(|word| word.strip_prefix(key)?.strip_prefix('='));
        values.next()
    };
    match value("+proj")? {
        "utm" => Some(6.0 * value("+zone")?.parse::<f64>().ok()? - 183.0),
        "tmerc" | "etmerc" if value("+pm").is_none() => {
            value("+lon_0").map_or(Some(0.0), |text| text.parse().ok())
        }
        _ => None,
    }
}

/// EGM96's geoid, worked out from its coefficients (degree 360) at nodes of a lattice and interpolated in between.
#[derive(Clone, Debug, Default)]
struct Geoid {
    constant_m: Option<f64>,
    nodes_m: Arc<Mutex<BTreeMap<[i32; 2], f64>>>,
}

/// Spacing of the geoid's lattice [deg]: the shortest wave of EGM96 is 64 times as long.
const GEOID_STEP_DEG: f64 = 1.0 / 64.0; // [deg]

impl Geoid {
    /// Its height over the ellipsoid [m].
    fn height_m(&self, latitude_rad: f64, longitude_rad: f64) -> f64 {
        if let Some(constant_m) = self.constant_m {
            return constant_m;
        }
        let (x, y) = (longitude_rad.to_degrees(), latitude_rad.to_degrees());
        if !(x.is_finite() && y.is_finite()) {
            return f64::NAN;
        }
        let (x, y) = (x / GEOID_STEP_DEG, y / GEOID_STEP_DEG);
        let (i, j) = (x.floor() as i32, y.floor() as i32);
        let mut nodes = self.nodes_m.lock().unwrap_or_else(PoisonError::into_inner);
        let mut at = |i: i32, j: i32| {
            *nodes.entry([i, j]).or_insert_with(|| {
                let (lon, lat) = (f64::from(i) * GEOID_STEP_DEG, f64::from(j) * GEOID_STEP_DEG);
                egm96::egm96_compute_altitude_offset(lat, lon)
            })
        };
        let (fx, fy) = (x - f64::from(i), y - f64::from(j));
        let south = at(i, j) * (1.0 - fx) + at(i + 1, j) * fx;
        let north = at(i, j + 1) * (1.0 - fx) + at(i + 1, j + 1) * fx;
        south * (1.0 - fy) + north * fy
    }
}

#[cfg(test)]
mod tests;
