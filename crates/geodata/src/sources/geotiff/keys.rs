//! The GeoKeys of a raster: which system its map and its heights are in.

use super::metadata::Beside;
use super::own;
use super::tiff::Tiff;
use crate::projection::{Crs, vertical};
use crate::sources::error::Fault;
use crate::sources::options::Options;
use crate::sources::place;
use crate::sources::unit;
use boresight_common::warning::Notes;
use geotiff_core::crs::RasterType;
use geotiff_core::geokeys::{self as key, GeoKeyDirectory};

/// The keys of a GeoTIFF.
pub struct Keys {
    directory: GeoKeyDirectory,
}

/// The system of a raster.
pub struct System {
    /// It, with its heights in the unit that the file states.
    pub crs: Crs,
    /// What the raster's east and north are multiplied with to be in the system's unit.
    pub to_map: f64,
}

/// A system as the keys say it.
enum Horizontal {
    /// Its code by EPSG.
    Code(u16),
    /// Its PROJ string, of parameters that the keys state.
    Own(String),
}

/// Kinds of maps: projected, geographic, geocentric.
const MODELS: [u16; 3] = [1, 2, 3];
/// Keys that change where a raster lies, and are not applied: datum shift, prime meridian.
const SHIFTS: [(u16, &str); 2] = [(2062, "GeogTOWGS84"), (2061, "GeogPrimeMeridianLong")];

/// What names a system in place of the file.
pub const NAME: &str = "name it with --crs (crs of a scenario's source)";

impl Keys {
    /// Those of a file; none where it has no directory of keys.
    pub fn of(tiff: &Tiff) -> Self {
        let directory: Vec<u16> = tiff.numbers(34_735).iter().map(|v| *v as u16).collect();
        let parsed = GeoKeyDirectory::parse(&directory, &tiff.numbers(34_736), tiff.text(34_737));
        Self {
            directory: parsed.unwrap_or_default(),
        }
    }

    /// Whether pixels are areas or points.
    pub fn raster_type(&self) -> RasterType {
        let code = self.directory.get_short(key::GT_RASTER_TYPE);
        RasterType::from_code(code.unwrap_or(1))
    }

    fn short(&self, id: u16) -> Option<u16> {
        self.directory.get_short(id)
    }

    /// A code that names something.
    fn code(&self, id: u16) -> Option<u16> {
        self.short(id).filter(|code| !own::NONE.contains(code))
    }

    /// What the keys call their system, in words.
    fn citation(&self, ids: &[u16]) -> String {
        let words = ids.iter().filter_map(|id| self.directory.get_ascii(*id));
        let first = words.map(|text| text.trim_matches(['|', ' ', '\0'])).next();
        first.map_or(String::new(), |text| format!(" ('{text}')"))
    }

    /// The system that the keys name by its code, or define by its parameters; `None` where they name none.
    fn horizontal(&self) -> Result<Option<Horizontal>, Fault> {
        let own = |defined: Result<String, String>, ids: &[u16]| {
            let fault = |what: String| {
                let what = format!("its keys define {what}{}", self.citation(ids));
                let mend = format!("{NAME} by its code or PROJ string");
                Fault::new("coordinates", what, mend)
            };
            defined
                .map(|text| Some(Horizontal::Own(text)))
                .map_err(fault)
        };
        let coded = |code: u16| Horizontal::Code(code);
        let projected = self.short(key::PROJECTED_CRS_TYPE);
        let geodetic = self.short(key::GEODETIC_CRS_TYPE);
        let map = [key::PROJ_CITATION, key::GT_CITATION];
        match self
            .short(key::GT_MODEL_TYPE)
            .filter(|m| MODELS.contains(m))
        {
            Some(3) => {
                let mend = "bring it onto a map (gdalwarp -t_srs)";
                Err(Fault::new(
                    "coordinates",
                    "a raster in geocentric coordinates",
                    mend,
                ))
            }
            Some(2) => match self.code(key::GEODETIC_CRS_TYPE) {
                None if geodetic.is_some() => own(
                    own::geographic(&self.directory),
                    &[key::GEOG_CITATION, key::GT_CITATION],
                ),
                code => Ok(code.map(coded)),
            },
            model => match self.code(key::PROJECTED_CRS_TYPE) {
                Some(code) => Ok(Some(coded(code))),
                None if model == Some(1)
                    || projected.is_some()
                    || self.short(key::PROJ_COORD_TRANS).is_some() =>
                {
                    own(own::projected(&self.directory), &map)
                }
                None => Ok(self.code(key::GEODETIC_CRS_TYPE).map(coded)),
            },
        }
    }

    /// The vertical code that the keys name: of the system, else of its datum, else by the name that stands in its citation.
    fn vertical(&self, notes: &mut Notes) -> Option<String> {
        let code = self.code(key::VERTICAL_CS_TYPE);
        if let Some(code) = code.or(self.code(key::VERTICAL_DATUM)) {
            return Some(code.to_string());
        }
        let name = self.directory.get_ascii(key::VERTICAL_CITATION)?;
        let name = name.trim_matches(['|', ' ', '\0']);
        if name.is_empty() {
            return None;
        }
        let found = match name.to_lowercase().contains("ellipsoid") {
            true => Some("ellipsoid"),
            false => vertical::named_in(name),
        };
        let taken = found.map_or("as nothing is known of that name".into(), |code| {
            format!("taken as {code}")
        });
        notes.assume(
            "vertical system",
            format!("it is '{name}' without a code, {taken}"),
            "name it with --crs EPSG:MAP+VERTICAL (crs of a scenario's source)",
        );
        found.map(str::to_string)
    }

    /// Whether the keys state a unit of heights.
    pub fn state_height_unit(&self) -> bool {
        self.code(key::VERTICAL_UNITS).is_some()
    }

    /// Metres in the unit of heights that the keys state.
    fn height_unit_m(&self) -> Result<Option<f64>, Fault> {
        let Some(code) = self.code(key::VERTICAL_UNITS) else {
            return Ok(None);
        };
        let mend = "give the heights in metres (gdal_translate -scale), or remove the key";
        let unknown = || {
            Fault::new(
                "VerticalUnits",
                format!("{code} is no unit of length known here"),
                mend,
            )
        };
        unit::by_code(code).map(Some).ok_or_else(unknown)
    }

    /// The map that the keys name, else that of the file beside the raster, with what east and north are multiplied with; `None` where
    /// neither names one.
    pub fn map(&self, beside: &Beside, notes: &mut Notes) -> Result<Option<System>, Fault> {
        let name = match self.horizontal()? {
            Some(Horizontal::Own(text)) => {
                if own::is_unshifted(&text) {
                    let what = "the keys state no shift to WGS 84: taken as none";
                    notes.assume("datum", what, format!("{NAME} by its code or PROJ string"));
                }
                let crs = Crs::parse(&text)?;
                let to_map = self.to_map(&crs)?;
                return Ok(Some(System { crs, to_map }));
            }
            Some(Horizontal::Code(code)) => format!("EPSG:{code}"),
            None => match beside.system.as_deref().and_then(of_wkt) {
                Some(name) => name,
                None => return Ok(None),
            },
        };
        let stated = |(id, _): &&(u16, &str)| {
            let numbers = self.directory.get_double(*id);
            numbers.is_some_and(|numbers| numbers.iter().any(|number| *number != 0.0))
        };
        for (_, shift) in SHIFTS.iter().filter(stated) {
            let what = format!("the file's own is not applied: that of {name} counts");
            notes.assume(shift, what, format!("{NAME} as a PROJ string that has it"));
        }
        let crs = Crs::parse(&name)?;
        let to_map = self.to_map(&crs)?;
        if to_map != 1.0 {
            let what = format!(
                "the file's unit is {to_map:.9} times that of {name}: its coordinates are taken in the file's"
            );
            let mend = "name the system in the file's unit, or mend the key";
            notes.assume("unit of the map", what, mend);
        }
        Ok(Some(System { crs, to_map }))
    }

    /// The system of a raster of heights: that of the options, else that of the keys, else that of the file beside it. What the options
    /// leave open of heights and their unit counts as the file states it. `None` where nothing names a map.
    pub fn system(
        &self,
        options: &Options,
        beside: &Beside,
        notes: &mut Notes,
    ) -> Result<Option<System>, Fault> {
        let map = match &options.crs {
            Some(name) => Some(System {
                crs: Crs::parse(name)?,
                to_map: 1.0,
            }),
            None => self.map(beside, notes)?,
        };
        let Some(System { mut crs, to_map }) = map else {
            return Ok(None);
        };
        if !crs.heights_are_stated()
            && let Some(code) = self.vertical(notes)
        {
            let without = self.code(key::VERTICAL_UNITS).is_none();
            if without && (5101..=5106).contains(&code.parse().unwrap_or(0)) {
                let what = format!(
                    "of the code {code} of GeoTIFF 1.0, taken in metres, as no unit is said"
                );
                notes.assume(
                    "heights",
                    what,
                    "say it with the key VerticalUnits, or by a code with --crs EPSG:MAP+VERTICAL",
                );
            }
            crs = crs.with_vertical(&code)?;
        }
        let crs = place::over_geoid(crs, options);
        let crs = match self.height_unit_m()? {
            Some(unit_m) => stated(crs, unit_m, "VerticalUnits", options, notes),
            None => crs,
        };
        Ok(Some(System { crs, to_map }))
    }

    /// What east and north are multiplied with: the keys may state another unit than the system's.
    fn to_map(&self, crs: &Crs) -> Result<f64, Fault> {
        let unknown = |code: u16| {
            let name = match crs.is_geographic() {
                true => "GeogAngularUnits",
                false => "ProjLinearUnits",
            };
            let what = format!("{code} is no unit known here");
            let mend = format!("write it in degrees or metres (gdalwarp -t_srs), or {NAME}");
            Fault::new(name, what, mend)
        };
        let unit = own::map_unit(&self.directory, crs.is_geographic()).map_err(unknown)?;
        let Some(unit) = unit else {
            return Ok(1.0);
        };
        let to_map = unit / crs.map_unit_m();
        Ok(if (to_map - 1.0).abs() < 1e-9 {
            1.0
        } else {
            to_map
        })
    }
}

/// The system with heights in a unit that the file states; where the options' vertical code says another, that one counts.
pub fn stated(crs: Crs, unit_m: f64, place: &str, options: &Options, notes: &mut Notes) -> Crs {
    let own_m = crs.height_unit_m();
    if (unit_m / own_m - 1.0).abs() < 1e-12 {
        return crs;
    }
    if !crs.height_unit_is_stated() {
        return crs.with_height_unit(unit_m);
    }
    let by_user = options
        .crs
        .as_deref()
        .is_some_and(|name| Crs::parse(name).is_ok_and(|crs| crs.height_unit_is_stated()));
    let [taken_m, other_m] = if by_user {
        [own_m, unit_m]
    } else {
        [unit_m, own_m]
    };
    let what = format!(
        "the unit is {unit_m} m, that of {} {own_m} m: taken as {taken_m} m, not {other_m} m",
        crs.name()
    );
    notes.assume(
        place,
        what,
        "name a vertical system in the right unit with --crs EPSG:MAP+VERTICAL, or mend the file",
    );
    if by_user {
        crs
    } else {
        crs.with_height_unit(unit_m)
    }
}

/// The code that stands last in a well-known text: that of the whole system.
pub fn of_wkt(text: &str) -> Option<String> {
    let text = text.trim().trim_end_matches(']').to_uppercase();
    let at = text
        .rfind("AUTHORITY[\"EPSG\",")
        .or(text.rfind("ID[\"EPSG\","))?;
    let digits = text[at..].split(',').nth(1)?.trim_matches(['"', ' ', ']']);
    let code: u32 = digits.parse().ok()?;
    // Behind the code of the whole nothing follows.
    let whole = text[at..].matches(['[', ']']).count() == 1;
    whole.then(|| format!("EPSG:{code}"))
}
