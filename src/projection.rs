//! Coordinate reference systems: from any projected, geographic or geocentric system to WGS 84 and back.
//!
//! The projections are those of `proj4rs`, with `crs-definitions`' parameters by EPSG code, and so are the datum shifts: the
//! seven (or three) parameters of each code, no grids (docs/georeferencing.md says what that costs). Heights are over the
//! ellipsoid or over a geoid. National heights over a geoid are taken as heights over EGM96's.

use crate::models::maths::geodesy::{Geodetic, longitude_arc_deg, longitude_near_deg};
use glam::{DVec2, DVec3};
use proj4rs::Proj;
use proj4rs::transform::transform;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// Why coordinates cannot be understood.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CrsError {
    /// A name that is no coordinate reference system known here.
    #[error(
        "'{0}' is no coordinate reference system known here; write EPSG:7415, EPSG:2056+5728, EPSG:25832+ellipsoid, WGS84 or a PROJ string (+proj=utm +zone=32 +ellps=GRS80)"
    )]
    Unknown(String),
    /// A vertical system that is not known.
    #[error(
        "'{0}' is no vertical system known here; write +ellipsoid (over WGS 84's) or +geoid (over EGM96's) in its place, with --geoid-height where its height over the ellipsoid is known"
    )]
    Vertical(String),
    /// A projection that cannot be worked out.
    #[error("'{name}': {what}; give the coordinates in another system, EPSG:4979 for instance")]
    Unsupported {
        /// The system.
        name: String,
        /// What is not supported.
        what: String,
    },
    /// Coordinates outside the system's domain.
    #[error(
        "({x}, {y}, {z}) is no point of {name}; check the system and the order of the coordinates (east or longitude first)"
    )]
    Outside {
        /// The system.
        name: String,
        /// East, longitude or X, as it was given.
        x: f64,
        /// North, latitude or Y.
        y: f64,
        /// Height or Z.
        z: f64,
    },
}

/// What heights are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heights {
    /// WGS 84's ellipsoid.
    Ellipsoid,
    /// A geoid, or the national levelling that stands for it, by its name.
    Geoid(&'static str),
}

/// Vertical systems over a geoid: EPSG code, name, metres in its unit.
const VERTICAL: [(u16, &str, f64); 37] = [
    (3855, "EGM2008", 1.0),
    (3886, "Fao 1979", 1.0),
    (3900, "N2000", 1.0),
    (5193, "Incheon", 1.0),
    (5214, "Genoa 1942", 1.0),
    (5613, "RH2000", 1.0),
    (5621, "EVRF2007", 1.0),
    (5701, "Newlyn (ODN)", 1.0),
    (5702, "NGVD29", 1200.0 / 3937.0),
    (5703, "NAVD88", 1.0),
    (5705, "Baltic 1977", 1.0),
    (5709, "NAP", 1.0),
    (5710, "Ostend (TAW)", 1.0),
    (5711, "AHD", 1.0),
    (5714, "mean sea level", 1.0),
    (5720, "NGF-IGN69", 1.0),
    (5728, "LN02", 1.0),
    (5729, "LHN95", 1.0),
    (5730, "EVRF2000", 1.0),
    (5731, "Malin Head", 1.0),
    (5737, "Yellow Sea 1985", 1.0),
    (5738, "HKPD", 1.0),
    (5773, "EGM96", 1.0),
    (5776, "NN54", 1.0),
    (5778, "GHA", 1.0),
    (5780, "Cascais", 1.0),
    (5782, "Alicante", 1.0),
    (5783, "DHHN92", 1.0),
    (5798, "EGM84", 1.0),
    (5799, "DVR90", 1.0),
    (5941, "NN2000", 1.0),
    (6360, "NAVD88 (US feet)", 1200.0 / 3937.0),
    (6695, "JGD2011", 1.0),
    (7837, "DHHN2016", 1.0),
    (7839, "NZVD2016", 1.0),
    (8228, "NAVD88 (feet)", 0.3048),
    (9389, "EVRF2019", 1.0),
];

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
            let mut parts = text
                .split(['+', ','])
                .filter(|part| !part.ends_with(":crs"));
            let definition = definition(parts.next().unwrap_or("")).ok_or_else(unknown)?;
            let vertical = parts.next().map(|part| last(part).to_lowercase());
            if parts.next().is_some() {
                return Err(unknown());
            }
            (definition, vertical)
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
        let (heights, height_unit_m) = match vertical.as_deref() {
            Some("ellipsoid" | "4979") => (Heights::Ellipsoid, 1.0),
            Some("geoid") => (Heights::Geoid("EGM96"), proj.vto_meter()),
            Some(code) => {
                let known = VERTICAL.iter().find(|known| code == known.0.to_string());
                let (_, name, unit_m) = known.ok_or_else(|| CrsError::Vertical(code.into()))?;
                (Heights::Geoid(name), *unit_m)
            }
            None if compound => (Heights::Geoid("of the code"), proj.vto_meter()),
            None if proj.is_latlong() || proj.is_geocent() => (Heights::Ellipsoid, 1.0),
            None => (Heights::Geoid("EGM96"), 1.0),
        };
        let three = ["4979", "4978", "CRS84h"].contains(&last(text));
        Ok(Self {
            name: text.into(),
            stated: vertical.is_some() || compound || proj.is_geocent() || three,
            proj,
            wgs84,
            heights,
            height_unit_m,
            geoid: Geoid::default(),
        })
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
        // The projection gets the height as that over its own ellipsoid: national ellipsoids lie within metres of the geoid.
        let mut point = if self.is_geographic() {
            if r.y.abs() > 90.0 || r.x.abs() > 720.0 {
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
        if all.iter().all(|v| v.is_finite())
            && latitude_rad.abs() <= FRAC_PI_2 + 1e-9
            && height_m.abs() < 1e8
        {
            Ok(found)
        } else {
            Err(outside())
        }
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

/// The PROJ string of a horizontal or compound system.
fn definition(part: &str) -> Option<String> {
    let lower = part.to_lowercase();
    let word = last(part);
    if ["wgs84", "wgs 84", "crs84", "crs84h"].contains(&last(&lower)) {
        return Some("+proj=longlat +datum=WGS84 +no_defs".into());
    }
    let epsg = lower.contains("epsg") || word == part.trim();
    let code = word.parse().ok().filter(|_| epsg)?;
    crs_definitions::from_code(code).map(|found| found.proj4.into())
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
#[path = "projection/tests.rs"]
mod tests;
