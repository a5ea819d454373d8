//! What an IFC file states of where it stands: map conversion, site, true north, world coordinate system.

use super::model::Model;
use super::system::{self, System};
use crate::sources::error::Fault;
use glam::{DAffine3, DVec2, DVec3};
use ifc_lite_core::{AttributeValue, DecodedEntity, IfcType, StepListItems};

/// What mends a conversion that is not understood.
const MEND: &str = "mend the file, or place it with --georef";

/// All that a file states of where it stands.
#[derive(Debug, Default)]
pub struct Stated {
    /// From the frame of its placements to that of the world coordinate system [m].
    pub world: DAffine3,
    /// Direction of true north in the model's plane.
    pub north: Option<DVec2>,
    /// From the model to a map.
    pub operation: Option<Operation>,
    /// The map, or another system that is named.
    pub system: Option<System>,
    /// Latitude and longitude of its site.
    pub site: Option<Site>,
    /// The reference height of its first building that states one.
    pub building: Option<Level>,
}

/// From the model's coordinates to a map's.
#[derive(Clone, Debug)]
pub struct Operation {
    /// The record.
    pub place: String,
    /// Where the model's origin lies: easting, northing and height in the map's unit, or longitude and latitude [deg].
    pub offset: DVec3,
    /// The model's x axis in the map.
    pub axis: DVec2,
    /// What lengths of the model are multiplied by, where it is stated.
    pub scale: Option<f64>,
    /// Scales of the three axes on top.
    pub factors: DVec3,
    /// Whether its offset is an angle.
    pub angles: bool,
}

/// The site's reference point.
#[derive(Clone, Debug)]
pub struct Site {
    /// The record.
    pub place: String,
    /// Latitude [deg].
    pub latitude_deg: f64,
    /// Longitude [deg].
    pub longitude_deg: f64,
    /// Height over the sea [m].
    pub elevation_m: Option<f64>,
    /// The reference point in the frame of the placements [m].
    pub origin_m: DVec3,
}

/// A height over the sea that a record states of its own origin.
#[derive(Clone, Debug)]
pub struct Level {
    /// The record.
    pub place: String,
    /// What the record calls it.
    pub name: &'static str,
    /// Height over the sea [m].
    pub elevation_m: f64,
    /// The record's origin in the frame of the placements [m].
    pub origin_m: DVec3,
}

impl Site {
    /// Its elevation, where it is stated.
    pub fn level(&self) -> Option<Level> {
        let elevation_m = self.elevation_m?;
        Some(Level {
            place: self.place.clone(),
            name: "RefElevation",
            elevation_m,
            origin_m: self.origin_m,
        })
    }
}

impl Stated {
    /// Reads what the records state.
    ///
    /// Fails where something is stated that is not understood.
    pub fn read(model: &mut Model, kinds: &[(u32, IfcType)]) -> Result<Self, Fault> {
        let mut stated = Self::default();
        let source = stated.take_operation(model, kinds)?;
        if stated.operation.is_none() {
            stated.take_property_sets(model, kinds)?;
        }
        stated.take_context(model, kinds, source)?;
        stated.take_site(model, kinds);
        stated.take_building(model, kinds);
        Ok(stated)
    }

    /// Takes the map conversion or rigid operation with its target; hands on the context that it starts from.
    fn take_operation(
        &mut self,
        model: &mut Model,
        kinds: &[(u32, IfcType)],
    ) -> Result<Option<u32>, Fault> {
        let all = |wanted: &'static [IfcType]| {
            let own = kinds.iter().filter(|(_, kind)| wanted.contains(kind));
            own.map(|(id, _)| *id)
        };
        let operations: Vec<u32> = all(&[
            IfcType::IfcMapConversion,
            IfcType::IfcMapConversionScaled,
            IfcType::IfcRigidOperation,
        ])
        .collect();
        let systems = || all(&[IfcType::IfcProjectedCRS, IfcType::IfcGeographicCRS]);
        let Some(&first) = operations.first() else {
            let named = systems().next().and_then(|id| model.entity(id));
            self.system = named.map(|it| System::read(model, &it)).transpose()?;
            return Ok(None);
        };
        let damaged = || Fault::new(format!("#{first}"), "the map conversion is damaged", MEND);
        let record = model.entity(first).ok_or_else(damaged)?;
        let place = format!("#{first} {}", record.ifc_type.name());
        if operations.len() > 1 {
            let what = format!("the first of {} map conversions counts", operations.len());
            model.notes.assume(&place, what, "leave one in the file");
        }
        let known = [IfcType::IfcProjectedCRS, IfcType::IfcGeographicCRS];
        let target = model.at(&record, 1);
        let target = target.filter(|target| known.contains(&target.ifc_type));
        let target = target.or_else(|| model.entity(systems().next()?));
        let id = target.as_ref().map(|target| target.id);
        self.system = target.map(|it| System::read(model, &it)).transpose()?;
        let texts: Vec<u32> = all(&[IfcType::IfcWellKnownText]).collect();
        let texts = texts.into_iter().filter_map(|text| model.entity(text));
        let own = |text: &DecodedEntity| id.is_some() && text.get_ref(1) == id;
        let text = texts.into_iter().find(own);
        if let Some(system) = &mut self.system {
            system.definition = text.and_then(|text| text.get_string(0).map(str::to_string));
        }
        let system = self.system.as_ref();
        let operation = match record.ifc_type {
            IfcType::IfcRigidOperation => rigid(&record, place, system)?,
            _ => conversion(model, &record, place, system)?,
        };
        self.operation = Some(operation);
        Ok(record.get_ref(0))
    }

    /// Takes what IFC 2x3 states in the property sets `ePSet_MapConversion` and `ePSet_ProjectedCRS`.
    fn take_property_sets(
        &mut self,
        model: &mut Model,
        kinds: &[(u32, IfcType)],
    ) -> Result<(), Fault> {
        let sets = kinds
            .iter()
            .filter(|(_, kind)| *kind == IfcType::IfcPropertySet);
        let (mut conversion, mut projected) = (None, None);
        for (id, _) in sets {
            let Some(set) = model.entity(*id) else {
                continue;
            };
            match set
                .get_string(2)
                .unwrap_or_default()
                .to_lowercase()
                .as_str()
            {
                "epset_mapconversion" => conversion = conversion.or(Some(set)),
                "epset_projectedcrs" => projected = projected.or(Some(set)),
                _ => {}
            }
        }
        if let Some(set) = &projected {
            self.system = Some(System::of_properties(model, set)?);
        }
        let Some(set) = conversion else {
            return Ok(());
        };
        let place = format!("#{} {}", set.id, set.get_string(2).unwrap_or_default());
        let mut lengths = [None, None, None];
        let (mut axis, mut scale) = ([None, None], None);
        let mut target = None;
        for (name, property) in system::properties(model, &set) {
            let value = property.get(2);
            let number = value.and_then(AttributeValue::as_float);
            let number = number.or_else(|| value?.as_string()?.trim().parse().ok());
            let number = number.filter(|v: &f64| v.is_finite());
            let slot = ["eastings", "northings", "orthogonalheight"]
                .iter()
                .position(|n| *n == name);
            match (slot, name.as_str()) {
                (Some(slot), _) => {
                    let unit = model.at(&property, 3);
                    let unit_m = unit.map(|unit| model.unit_m(&unit)).transpose()?;
                    lengths[slot] = number.map(|v| (v, unit_m));
                }
                (_, "xaxisabscissa") => axis[0] = number,
                (_, "xaxisordinate") => axis[1] = number,
                (_, "scale") => scale = number,
                (_, "targetcrs") => target = property.get_string(2).map(str::to_string),
                _ => {}
            }
        }
        let system = self
            .system
            .get_or_insert_with(|| System::default().at(&place));
        system.name = system.name.take().or(target);
        // A property's own unit goes before the map's.
        let map_m = system.unit_m.unwrap_or(model.unit_m);
        let length = |k: usize| lengths[k].map(|(v, unit_m)| v * unit_m.unwrap_or(map_m) / map_m);
        let mut operation = Operation::new(&place, [length(0), length(1), length(2)], model)?;
        operation.turn(axis, model);
        operation.scale = scale;
        self.operation = Some(operation.checked()?);
        Ok(())
    }

    /// Takes world coordinate system and true north of the context of the model.
    fn take_context(
        &mut self,
        model: &mut Model,
        kinds: &[(u32, IfcType)],
        source: Option<u32>,
    ) -> Result<(), Fault> {
        let own = |kind: &IfcType| *kind == IfcType::IfcGeometricRepresentationContext;
        let ids = kinds
            .iter()
            .filter(|(_, kind)| own(kind))
            .map(|(id, _)| *id);
        let all: Vec<_> = ids.filter_map(|id| model.entity(id)).collect();
        let solid = |context: &&DecodedEntity| context.get_float(2) == Some(3.0);
        let named = |context: &&DecodedEntity| context.get_string(1) == Some("Model");
        let chosen = (all.iter().find(|context| Some(context.id) == source))
            .or_else(|| all.iter().filter(solid).find(named))
            .or_else(|| all.iter().find(solid))
            .or_else(|| all.first());
        let Some(context) = chosen else {
            return Ok(());
        };
        let place = format!("#{} {}", context.id, context.ifc_type.name());
        let damaged = |_| Fault::new(&place, "its WorldCoordinateSystem is damaged", MEND);
        self.world = model.axes_at(context, 4).map_err(damaged)?;
        if context.get(5).is_none_or(AttributeValue::is_null) {
            return Ok(());
        }
        let north = model.vector(context, 5).map(DVec3::truncate);
        self.north = north.and_then(DVec2::try_normalize);
        if self.north.is_none() {
            let what = "its TrueNorth is no direction: taken as the y axis";
            model.notes.assume(place, what, MEND);
        }
        Ok(())
    }

    /// Takes the reference height of the first building that states one; 0 is what programs write that know none.
    fn take_building(&mut self, model: &mut Model, kinds: &[(u32, IfcType)]) {
        let buildings = kinds.iter().filter(|row| row.1 == IfcType::IfcBuilding);
        for (id, _) in buildings {
            let Some(building) = model.entity(*id) else {
                continue;
            };
            let elevation = building.get_float(9).filter(|v| v.is_finite() && *v != 0.0);
            let Some((elevation, placement)) = elevation.zip(model.placement(&building).ok())
            else {
                continue;
            };
            self.building = Some(Level {
                place: format!("#{id} IfcBuilding"),
                name: "ElevationOfRefHeight",
                elevation_m: elevation * model.unit_m,
                origin_m: placement.translation,
            });
            return;
        }
    }

    /// Takes the first site with a latitude and a longitude, and notes where others state another place.
    fn take_site(&mut self, model: &mut Model, kinds: &[(u32, IfcType)]) {
        for (id, kind) in kinds {
            if *kind != IfcType::IfcSite {
                continue;
            }
            let Some(site) = model.entity(*id) else {
                continue;
            };
            let absent = |slot| site.get(slot).is_none_or(AttributeValue::is_null);
            if absent(9) && absent(10) {
                continue;
            }
            let place = format!("#{id} IfcSite");
            let latitude = angle_deg(model, &site, 9).filter(|v| v.abs() <= 90.0);
            let longitude = angle_deg(model, &site, 10).filter(|v| v.abs() <= 180.0);
            let Some((latitude_deg, longitude_deg)) = latitude.zip(longitude) else {
                let what =
                    "its RefLatitude and RefLongitude are no place on Earth: taken as absent";
                model
                    .notes
                    .assume(place, what, "write degrees, minutes and seconds");
                continue;
            };
            if (latitude_deg, longitude_deg) == (0.0, 0.0) {
                let what = "latitude and longitude 0 are taken as not set";
                model.notes.assume(place, what, "state where the site lies");
                continue;
            }
            if let Some(first) = &self.site {
                if (first.latitude_deg, first.longitude_deg) != (latitude_deg, longitude_deg) {
                    let what = format!(
                        "its latitude and longitude are not those of {}, which count for the whole model",
                        first.place
                    );
                    let mend = "give each site a file of its own, or place it with --georef";
                    model.notes.assume(place, what, mend);
                }
                continue;
            }
            let Ok(placement) = model.placement(&site) else {
                let what = "its placement is damaged: its latitude and longitude are not used";
                model.notes.assume(place, what, MEND);
                continue;
            };
            let elevation = site.get_float(11).filter(|v| v.is_finite());
            self.site = Some(Site {
                place,
                latitude_deg,
                longitude_deg,
                elevation_m: elevation.map(|v| v * model.unit_m),
                origin_m: placement.translation,
            });
        }
    }
}

impl Operation {
    /// One that only moves: easting, northing and height.
    fn new(place: &str, offset: [Option<f64>; 3], model: &mut Model) -> Result<Self, Fault> {
        let [east, north, height] = offset;
        let finite = |v: Option<f64>, name: &str| {
            let what = format!("its {name} is no number");
            v.filter(|v| v.is_finite())
                .ok_or_else(|| Fault::new(place, what, MEND))
        };
        let (east, north) = (finite(east, "Eastings")?, finite(north, "Northings")?);
        if height.is_none_or(|v| !v.is_finite()) {
            let what = "its OrthogonalHeight is no number: taken as 0";
            model.notes.assume(place, what, MEND);
        }
        let height = height.filter(|v| v.is_finite()).unwrap_or(0.0);
        Ok(Self {
            place: place.into(),
            offset: DVec3::new(east, north, height),
            axis: DVec2::X,
            scale: None,
            factors: DVec3::ONE,
            angles: false,
        })
    }

    /// Turns it to a stated x axis, of any length.
    fn turn(&mut self, [x, y]: [Option<f64>; 2], model: &mut Model) {
        if x.is_none() && y.is_none() {
            return;
        }
        let axis = DVec2::new(x.unwrap_or(0.0), y.unwrap_or(0.0)).try_normalize();
        if axis.is_none() {
            let what = "XAxisAbscissa and XAxisOrdinate are no direction: taken as not turned";
            model.notes.assume(&self.place, what, MEND);
        }
        self.axis = axis.unwrap_or(DVec2::X);
    }

    /// The same, if its scales are some.
    fn checked(self) -> Result<Self, Fault> {
        let sound = |v: f64| v.is_finite() && v > 0.0;
        for (name, value) in [
            ("Scale", self.scale.unwrap_or(1.0)),
            ("FactorX", self.factors.x),
            ("FactorY", self.factors.y),
            ("FactorZ", self.factors.z),
        ] {
            if !sound(value) {
                let what = format!("its {name} of {value} is no scale");
                return Err(Fault::new(&self.place, what, MEND));
            }
        }
        Ok(self)
    }
}

/// `IfcMapConversion` or `IfcMapConversionScaled`.
fn conversion(
    model: &mut Model,
    record: &DecodedEntity,
    place: String,
    system: Option<&System>,
) -> Result<Operation, Fault> {
    if system.is_some_and(|system| system.geographic) {
        let what = "converts lengths into an IfcGeographicCRS";
        return Err(Fault::new(place, what, MEND));
    }
    let number = |slot| record.get_float(slot);
    let mut operation = Operation::new(&place, [2, 3, 4].map(number), model)?;
    operation.turn([5, 6].map(number), model);
    operation.scale = number(7);
    let factor = |slot| number(slot).unwrap_or(1.0);
    operation.factors = DVec3::new(factor(8), factor(9), factor(10));
    operation.checked()
}

/// `IfcRigidOperation`: a translation by lengths in a map, or by angles on the ellipsoid.
fn rigid(
    record: &DecodedEntity,
    place: String,
    system: Option<&System>,
) -> Result<Operation, Fault> {
    let geographic = system.filter(|system| system.geographic);
    let coordinate = |slot: usize| match record.get(slot) {
        Some(AttributeValue::Typed { name, value }) => {
            let angle = &**name == "IFCPLANEANGLEMEASURE";
            Some((value.as_float()?, angle))
        }
        Some(value) => Some((value.as_float()?, geographic.is_some())),
        None => None,
    };
    let wrong = |what: &str| Fault::new(&place, what, MEND);
    let both = coordinate(2).zip(coordinate(3));
    let ((first, angle), (second, other)) = both.ok_or_else(|| wrong("has no two coordinates"))?;
    if angle != other || angle != geographic.is_some() {
        return Err(wrong(
            "mixes lengths and angles, or has them against the other kind of system",
        ));
    }
    let height = record.get_float(4).unwrap_or(0.0);
    let to_deg = geographic.map_or(1.0, |system| system.angle_rad.to_degrees());
    let offset = DVec3::new(first * to_deg, second * to_deg, height);
    if !offset.is_finite() {
        return Err(wrong("has a coordinate that is no number"));
    }
    Ok(Operation {
        place,
        offset,
        axis: DVec2::X,
        scale: None,
        factors: DVec3::ONE,
        angles: angle,
    })
}

/// `IfcCompoundPlaneAngleMeasure` [deg]: degrees, minutes, seconds and millionths; any minus makes the whole negative.
fn angle_deg(model: &mut Model, site: &DecodedEntity, slot: usize) -> Option<f64> {
    let list = site.get_list(slot)?;
    let parts = list.iter().map(AttributeValue::as_float);
    let parts = parts.collect::<Option<Vec<f64>>>()?;
    let part = |k: usize| parts.get(k).copied().unwrap_or(0.0).abs();
    if parts.is_empty() || part(1) >= 60.0 || part(2) > 60.0 {
        return None;
    }
    let angle = part(0) + part(1) / 60.0 + (part(2) + part(3) / 1e6) / 3600.0;
    // A signed zero is one only in the bytes.
    let mut minus_zero = || {
        let attributes = StepListItems::of_record(model.bytes(site.id)?);
        let list = StepListItems::of_list(attributes?.nth(slot)?)?;
        Some(list.into_iter().any(|part| part == b"-0"))
    };
    let negative = parts.iter().any(|v| *v < 0.0) || minus_zero() == Some(true);
    Some(if negative { -angle } else { angle })
}
