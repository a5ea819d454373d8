//! Where an IFC model stands: by its map conversion, its site, or what the options state.

use super::georeference::{Operation, Site, Stated};
use crate::sources::error::{Fault, SourceError};
use crate::sources::options::Options;
use crate::sources::place::{self, Place};
use boresight_common::warning::Notes;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DAffine3, DVec2, DVec3};
use std::path::Path;

/// From the frame of the placements [m] to ECEF [m].
pub type ToEcef = Box<dyn Fn(DVec3) -> Result<DVec3, Fault>>;

/// How a contradiction in a file is settled from outside.
const MEND: &str = "if that is wrong, name the map with --crs or place it with --georef";
/// Farther than this [m] two statements of one place contradict each other: cities have no larger building.
const APART_M: f64 = 2e3; // [m]
/// Farther than this [m] from its site a model cannot stand in the site's plane: there the Earth falls away by 800 m.
const FARTHEST_M: f64 = 100e3; // [m]
/// Coordinates farther than this [m] from the origin are those of a map.
const MAP_M: f64 = 50e3; // [m]
/// Nearer than this [m] to a map's own origin a model was hardly meant to stand.
const ORIGIN_M: f64 = 5e3; // [m]
/// Two heights farther apart than this [m] contradict each other.
const HEIGHT_M: f64 = 5.0; // [m]

/// What is placed.
pub struct Placing<'a> {
    /// What the file states.
    pub stated: &'a Stated,
    /// Metres in the file's unit of length.
    pub unit_m: f64,
    /// The middle of the model in the frame of its placements [m].
    pub middle_m: DVec3,
    /// What the user states.
    pub options: &'a Options,
}

impl Placing<'_> {
    /// Where the model stands; what was taken for granted is noted.
    ///
    /// Fails where nothing says where it stands, or something that is not understood.
    pub fn to_ecef(&self, path: &Path, notes: &mut Notes) -> Result<ToEcef, SourceError> {
        let (stated, options) = (self.stated, self.options);
        let world = self.world(notes);
        if options.georef.is_some() {
            let place = Place::of(options, None, path)?;
            return Ok(Box::new(move |r| place.ecef_m(world.transform_point3(r))));
        }
        let fault = |fault: Fault| fault.of(path);
        let operation = self.set_operation(world, notes).map_err(fault)?;
        match (operation, &stated.site) {
            (Some(operation), _) if operation.angles => {
                self.geographic(operation, world, notes).map_err(fault)
            }
            (Some(operation), _) => self.mapped(operation, world, path, notes),
            (None, Some(site)) if options.crs.is_none() => {
                if let Some(found) = self.in_the_map_of(site, world, path, notes) {
                    return Ok(found);
                }
                self.at_site(site, notes).map_err(fault)
            }
            _ => self.in_a_map(world, path, notes),
        }
    }

    /// The map conversion, if it is set and names its system; where it does not, the site's latitude and longitude count.
    fn set_operation(
        &self,
        world: DAffine3,
        notes: &mut Notes,
    ) -> Result<Option<&Operation>, Fault> {
        let Some(operation) = &self.stated.operation else {
            return Ok(None);
        };
        let near_m = world.transform_point3(self.middle_m).truncate().length();
        let unset = operation.offset.truncate() == DVec2::ZERO && near_m < MAP_M;
        let named = |it: &super::system::System| it.name.is_some() || it.is_described();
        let nameless =
            self.options.crs.is_none() && !self.stated.system.as_ref().is_some_and(named);
        let what = match (unset, nameless) {
            (true, _) => {
                "its eastings and northings are 0, where no map has a city: it is taken as not set"
            }
            (false, true) => "it names no coordinate reference system: it is not used",
            _ => return Ok(Some(operation)),
        };
        if self.stated.site.is_none() && unset {
            let mend = "state them, or place it with --georef";
            return Err(Fault::new(&operation.place, what, mend));
        }
        if self.stated.site.is_none() {
            return Ok(Some(operation));
        }
        let what = format!("{what}, and the site's latitude and longitude count");
        notes.assume(&operation.place, what, MEND);
        Ok(None)
    }

    /// From the frame of the placements to that of the world coordinate system.
    fn world(&self, notes: &mut Notes) -> DAffine3 {
        let world = self.stated.world;
        if !world.abs_diff_eq(DAffine3::IDENTITY, 1e-9) {
            let what = format!(
                "the origin of placements is taken to lie at {} m of it",
                world.translation
            );
            notes.assume("WorldCoordinateSystem", what, MEND);
        }
        world
    }

    /// Coordinates that are those of a map, in metres: the options' or the one that the file names.
    fn in_a_map(
        &self,
        world: DAffine3,
        path: &Path,
        notes: &mut Notes,
    ) -> Result<ToEcef, SourceError> {
        let system = self.stated.system.as_ref();
        let own = match system {
            Some(system) if self.options.crs.is_none() => {
                let far = world.transform_point3(self.middle_m).truncate().length();
                let name = system.known_name(notes);
                if far < MAP_M && !system.geographic {
                    let name = name.unwrap_or_default();
                    let what = format!("{name} is named, but no map conversion says where in it");
                    let mend = "place it with --georef, or name the system with --crs if its coordinates are that map's";
                    return Err(Fault::new(&system.place, what, mend).of(path));
                }
                let what = "no map conversion is stated: its coordinates are taken as the map's";
                notes.assume(&system.place, what, MEND);
                name
            }
            _ => None,
        };
        let place = Place::of(self.options, own.as_deref(), path)?;
        place.note(notes);
        let unit_m = units_m(&place);
        Ok(Box::new(move |r| {
            place.ecef_m(world.transform_point3(r) / unit_m)
        }))
    }

    /// A model far from its origin, whose coordinates are those of the map that is named beside its site.
    fn in_the_map_of(
        &self,
        site: &Site,
        world: DAffine3,
        path: &Path,
        notes: &mut Notes,
    ) -> Option<ToEcef> {
        let system = self.stated.system.as_ref()?;
        let middle_m = world.transform_point3(self.middle_m);
        if middle_m.truncate().length() < MAP_M {
            return None;
        }
        let mut own = Notes::default();
        let name = system.known_name(&mut own)?;
        let place = Place::of(self.options, Some(&name), path).ok()?;
        let unit_m = units_m(&place);
        let there = place.ecef_m(middle_m / unit_m).ok()?;
        if apart_m(there, site) > 10.0 * APART_M {
            return None;
        }
        place.note(&mut own);
        let what = "no map conversion is stated: its coordinates are taken as the map's";
        own.assume(&system.place, what, MEND);
        notes.extend(own);
        Some(Box::new(move |r| {
            place.ecef_m(world.transform_point3(r) / unit_m)
        }))
    }

    /// About the site's reference point, with y to true north.
    fn at_site(&self, site: &Site, notes: &mut Notes) -> Result<ToEcef, Fault> {
        let origin_m = site.origin_m;
        let far_m = (self.middle_m - origin_m).truncate().length();
        if far_m > FARTHEST_M {
            let what = format!(
                "the model lies {:.0} km from the point whose latitude and longitude are stated: its coordinates are those of \
                 a map that is not named",
                far_m / 1e3
            );
            let mend = "name the map with --crs, or place it with --georef";
            return Err(Fault::new(&site.place, what, mend));
        }
        if far_m > APART_M {
            let what = format!(
                "the model lies {:.1} km from the point that is taken to have the site's latitude and longitude",
                far_m / 1e3
            );
            notes.assume(&site.place, what, MEND);
        }
        if origin_m.length() > 1.0 {
            let what = format!(
                "its latitude and longitude are taken as those of its placement's origin, {origin_m} m from the model's"
            );
            notes.assume(&site.place, what, MEND);
        }
        let elevation_m = self.elevation_m(site, notes);
        let ground = DVec3::new(site.longitude_deg, site.latitude_deg, elevation_m);
        self.about(ground, origin_m)
    }

    /// Height over the sea [m] of a site's origin: its own, or what its building's reference height makes of it.
    fn elevation_m(&self, site: &Site, notes: &mut Notes) -> f64 {
        let mend = "state RefElevation of the site, or place it with --georef";
        let building = self.stated.building.as_ref();
        let by_building = building.map(|level| {
            let elevation_m = level.elevation_m + site.origin_m.z - level.origin_m.z;
            (level, elevation_m)
        });
        match (site.elevation_m, by_building) {
            (Some(own_m), Some((level, by_building_m))) => {
                if (own_m - by_building_m).abs() > HEIGHT_M {
                    let what = format!(
                        "by its {} the site lies {by_building_m:.1} m over the sea, which contradicts the site's RefElevation \
                         of {own_m:.1} m: the latter counts",
                        level.name
                    );
                    notes.assume(&level.place, what, MEND);
                }
                own_m
            }
            (Some(own_m), None) => own_m,
            (None, Some((level, by_building_m))) => {
                let what = format!(
                    "RefElevation is not stated: taken as {by_building_m:.1} m over the sea, by {} of {}",
                    level.name, level.place
                );
                notes.assume(&site.place, what, mend);
                by_building_m
            }
            (None, None) => {
                let what = "RefElevation is not stated: taken as 0 m over the sea";
                notes.assume(&site.place, what, mend);
                0.0
            }
        }
    }

    /// About a longitude and latitude that a rigid operation states.
    fn geographic(
        &self,
        operation: &Operation,
        world: DAffine3,
        notes: &mut Notes,
    ) -> Result<ToEcef, Fault> {
        let offset = operation.offset;
        let fits = offset.y.abs() <= 90.0 && offset.x.abs() <= 180.0;
        let turned = offset.x.abs() <= 90.0 && offset.y.abs() <= 180.0;
        let offset = match (fits, turned) {
            (true, _) => offset,
            (false, true) => DVec3::new(offset.y, offset.x, offset.z),
            _ => {
                let what = format!("({}, {}) is no longitude and latitude", offset.x, offset.y);
                return Err(Fault::new(&operation.place, what, MEND));
            }
        };
        if turned {
            let what = format!(
                "its coordinates are taken as longitude {} and latitude {}",
                offset.x, offset.y
            );
            notes.assume(&operation.place, what, MEND);
        }
        let system = self.stated.system.as_ref();
        let unit_m = system.and_then(|system| system.unit_m);
        let height_m = offset.z * unit_m.unwrap_or(self.unit_m);
        let found = self.about(offset.with_z(height_m), DVec3::ZERO)?;
        Ok(Box::new(move |r| found(world.transform_point3(r))))
    }

    /// In the plane about a longitude and latitude [deg] at a height over the sea [m], where `origin_m` of the model lies.
    fn about(&self, ground: DVec3, origin_m: DVec3) -> Result<ToEcef, Fault> {
        let wgs84 = place::crs("EPSG:4326+5773", self.options)?;
        let site = SiteFrame::new(wgs84.to_geodetic(ground)?);
        let north = self.stated.north.unwrap_or(DVec2::Y);
        let east = DVec2::new(north.y, -north.x);
        Ok(Box::new(move |r| {
            let arm = r - origin_m;
            let flat = arm.truncate();
            let enu = DVec3::new(flat.dot(east), flat.dot(north), arm.z);
            Ok(site.enu_to_ecef(enu))
        }))
    }

    /// Through a map conversion, or a rigid operation by lengths.
    fn mapped(
        &self,
        operation: &Operation,
        world: DAffine3,
        path: &Path,
        notes: &mut Notes,
    ) -> Result<ToEcef, SourceError> {
        let system = self.stated.system.as_ref();
        let own = match self.options.crs {
            Some(_) => None,
            None => system.and_then(|system| system.known_name(notes)),
        };
        let place = Place::of(self.options, own.as_deref(), path)?;
        place.note(notes);
        let crs_m = units_m(&place);
        let scales = self.scales(operation, crs_m, notes);
        let middle_m = world.transform_point3(self.middle_m);
        let offset_m = operation.offset * scales.map_m;
        let flat_m = offset_m.truncate();
        let doubled = flat_m.length() > MAP_M
            && middle_m.truncate().distance(flat_m) < 10.0 * APART_M
            && middle_m.truncate().length() > MAP_M;
        let (axis, scale) = (operation.axis, scales.model);
        let to_map: Box<dyn Fn(DVec3) -> DVec3> = if doubled {
            let what = "the model's coordinates are those of the map already: the conversion is not applied again";
            notes.assume(&operation.place, what, MEND);
            Box::new(move |r| world.transform_point3(r))
        } else {
            Box::new(move |r| {
                let r = world.transform_point3(r) * scale;
                axis.rotate(r.truncate()).extend(r.z) + offset_m
            })
        };
        let far_m = to_map(self.middle_m).truncate().length();
        if far_m < ORIGIN_M {
            let what = format!(
                "it puts the model {:.1} km from the map's own origin, where few maps have a city",
                far_m / 1e3
            );
            notes.assume(&operation.place, what, MEND);
        }
        let to_ecef: ToEcef = Box::new(move |r| place.ecef_m(to_map(r) / crs_m));
        self.contradictions(operation, &to_ecef, notes)
            .map_err(|fault| fault.of(path))?;
        Ok(to_ecef)
    }

    /// Metres in the map's unit, and metres on the map in a metre of the model along each axis.
    fn scales(&self, operation: &Operation, crs_m: DVec3, notes: &mut Notes) -> Scales {
        let unit_m = self.unit_m;
        let map_m = self.stated.system.as_ref().and_then(|system| system.unit_m);
        let rigid = operation.place.ends_with("IfcRigidOperation");
        let scale = operation.scale.unwrap_or(1.0);
        let near = |v: f64| (v - 1.0).abs() < 0.02;
        let flat = operation.factors.x;
        let stated_m = map_m;
        let (mut map_m, mut scale) = (map_m.unwrap_or(unit_m), scale);
        let place = &operation.place;
        if rigid {
            // It has no scale of its own: lengths are converted by their units.
            scale = unit_m / map_m;
        } else if near(scale * flat * map_m / unit_m) {
            // The units are told apart by the scale, or do not differ.
            if stated_m.is_none() && self.metres_are_meant(operation, crs_m) {
                let what = "its eastings and northings are taken in metres, as in the model's unit they would lie at the map's \
                            own origin";
                notes.assume(place, what, "state the map's unit (MapUnit)");
                map_m = 1.0;
                scale *= unit_m;
            }
        } else if stated_m.is_some() && near(scale * flat) {
            let what = format!(
                "its Scale of {scale} leaves the model's unit of {unit_m} m and the map's of {map_m} m as if they were one: \
                 lengths are converted by their units"
            );
            notes.assume(place, what, format!("write a Scale of {}", unit_m / map_m));
            scale *= unit_m / map_m;
        } else if stated_m.is_none() && near(scale * flat / unit_m) {
            let what = format!(
                "its Scale of {scale} turns the model's unit into metres: eastings, northings and heights are taken in metres"
            );
            notes.assume(place, what, "state the map's unit (MapUnit)");
            map_m = 1.0;
        } else {
            let what = format!(
                "a metre of the model is made {} m of the map",
                scale * flat * map_m / unit_m
            );
            notes.assume(place, what, MEND);
        }
        let model = operation.factors * scale * map_m / unit_m;
        // Of two feet that differ by 2 in a million the map's own is meant.
        let own = crs_m.x;
        if own != map_m && (map_m / own - 1.0).abs() < 1e-4 {
            if (map_m / own - 1.0).abs() > 1e-9 {
                let what = format!("its unit of {map_m} m is taken as the map's own of {own} m");
                notes.assume(place, what, MEND);
            }
            map_m = own;
        } else if own != map_m && stated_m.is_some() {
            let what = format!(
                "its unit of {map_m} m is not the map's own of {own} m: eastings and northings are taken in the former"
            );
            notes.assume(place, what, "mend MapUnit, or name the map that is meant");
        }
        Scales { map_m, model }
    }

    /// Whether eastings without a unit lie on the map only in metres.
    fn metres_are_meant(&self, operation: &Operation, crs_m: DVec3) -> bool {
        let flat = operation.offset.truncate().length();
        let differ = self.unit_m < 0.5 * crs_m.x;
        differ && flat * self.unit_m < 20e3 && flat > MAP_M
    }

    /// Notes where the site's latitude, longitude and height or true north contradict the map conversion.
    fn contradictions(
        &self,
        operation: &Operation,
        to_ecef: &ToEcef,
        notes: &mut Notes,
    ) -> Result<(), Fault> {
        if let Some(site) = &self.stated.site {
            let apart_m = apart_m(to_ecef(self.middle_m)?, site);
            if apart_m > APART_M {
                let what = format!(
                    "its latitude and longitude lie {:.1} km from where {} puts the model: the latter counts",
                    apart_m / 1e3,
                    operation.place
                );
                notes.assume(&site.place, what, MEND);
            }
        }
        let site = self.stated.site.as_ref().and_then(Site::level);
        for level in site.iter().chain(&self.stated.building) {
            let here = Geodetic::from_ecef(to_ecef(level.origin_m)?);
            let wgs84 = place::crs("EPSG:4326+5773", self.options)?;
            let (longitude, latitude) = (here.longitude_rad, here.latitude_rad);
            let ground = DVec3::new(longitude.to_degrees(), latitude.to_degrees(), 0.0);
            let over_the_sea_m = here.height_m - wgs84.to_geodetic(ground)?.height_m;
            let stated_m = level.elevation_m;
            if stated_m != 0.0 && (stated_m - over_the_sea_m).abs() > HEIGHT_M {
                let what = format!(
                    "its {} of {stated_m:.1} m contradicts {}, by which it lies {over_the_sea_m:.1} m over the sea: the \
                     latter counts",
                    level.name, operation.place
                );
                notes.assume(&level.place, what, MEND);
            }
        }
        // North of the map in the model's plane, which is some degrees off true north at most.
        let grid = DVec2::new(operation.axis.y, operation.axis.x);
        let apart_deg = self
            .stated
            .north
            .map(|north| north.angle_to(grid).to_degrees());
        if let Some(apart_deg) = apart_deg.filter(|deg| deg.abs() > 10.0) {
            let what = format!(
                "it lies {apart_deg:.0}° off the north of {}: the latter counts",
                operation.place
            );
            notes.assume("TrueNorth", what, MEND);
        }
        Ok(())
    }
}

/// What lengths are multiplied by.
struct Scales {
    /// Metres in the map's unit.
    map_m: f64,
    /// Metres on the map in a metre of the model.
    model: DVec3,
}

/// Metres in the units of a place's coordinates.
fn units_m(place: &Place) -> DVec3 {
    match place {
        Place::Crs(crs) => crs.units_m(),
        Place::Local(_) => DVec3::ONE,
    }
}

/// How far a point lies from a site's latitude and longitude, along the ground [m].
fn apart_m(r_ecef_m: DVec3, site: &Site) -> f64 {
    let there = Geodetic {
        latitude_rad: site.latitude_deg.to_radians(),
        longitude_rad: site.longitude_deg.to_radians(),
        height_m: 0.0,
    };
    let here = Geodetic {
        height_m: 0.0,
        ..Geodetic::from_ecef(r_ecef_m)
    };
    here.to_ecef().distance(there.to_ecef())
}
