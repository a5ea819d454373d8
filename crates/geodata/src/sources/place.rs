//! How the coordinates of a source become places on the Earth: through its coordinate reference system, or through the
//! parameters that `boresight georef` has fitted.

use super::error::{Fault, SourceError, read_bytes};
use super::options::Options;
use crate::projection::{Crs, CrsError, RADII_M};
use boresight_common::warning::Notes;
use boresight_models::ground::georeference::Placement;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DAffine3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Parameters that place a local model on the Earth: the head of the file that `boresight georef --out` writes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// A point of the model, in its own frame and unit.
    pub center_local: [f64; 3],
    /// Where that point stands: ECEF [m].
    pub translation_ecef_m: [f64; 3],
    /// Axis times angle of the rotation from the model's axes to ECEF's [rad].
    pub rotation_vector_rad: [f64; 3],
    /// Metres in the model's unit.
    pub scale: f64,
}

impl From<Placement> for Parameters {
    fn from(placement: Placement) -> Self {
        Self {
            center_local: placement.center_local.into(),
            translation_ecef_m: placement.r_ecef_m.into(),
            rotation_vector_rad: placement.q_ecef_local.to_scaled_axis().into(),
            scale: placement.scale,
        }
    }
}

impl From<Parameters> for Placement {
    fn from(parameters: Parameters) -> Self {
        Self {
            center_local: parameters.center_local.into(),
            r_ecef_m: parameters.translation_ecef_m.into(),
            q_ecef_local: DQuat::from_scaled_axis(parameters.rotation_vector_rad.into()),
            scale: parameters.scale,
        }
    }
}

/// What of a parameter file places a model; the rest says how good it is.
#[derive(Deserialize)]
struct File {
    placement: Parameters,
}

/// The placement that a parameter file holds.
pub fn placement(path: &Path) -> Result<Placement, SourceError> {
    let bytes = read_bytes(path)?;
    let mend = "write it with boresight georef POINTS.csv --out FILE";
    let fault = |what: String| Fault::new("georeference", what, mend).of(path);
    let text = str::from_utf8(&bytes).map_err(|error| fault(error.to_string()))?;
    let read = toml::from_str::<File>(text);
    let file = read.map_err(|error| fault(error.message().to_string()))?;
    let placement = Placement::from(file.placement);
    let affine = placement.affine();
    let far = placement.r_ecef_m.length();
    if !affine.is_finite() || !(1e-6..1e6).contains(&placement.scale) || !RADII_M.contains(&far) {
        return Err(fault("its placement is none on the Earth".into()));
    }
    Ok(placement)
}

/// From a source's coordinates to ECEF.
#[derive(Clone, Debug)]
pub enum Place {
    /// Through a coordinate reference system.
    Crs(Box<Crs>),
    /// A local model, through fitted parameters.
    Local(DAffine3),
}

impl From<CrsError> for Fault {
    fn from(error: CrsError) -> Self {
        Self::new("coordinates", error, "or name the right system with --crs")
    }
}

/// A system by its name, over the geoid that the options state.
pub fn crs(name: &str, options: &Options) -> Result<Crs, Fault> {
    Ok(over_geoid(Crs::parse(name)?, options))
}

/// A system over the geoid that the options state.
pub fn over_geoid(crs: Crs, options: &Options) -> Crs {
    match options.geoid_height_m {
        Some(height_m) => crs.with_geoid_height(height_m),
        None => crs,
    }
}

/// Notes what heights are counted from where the system does not say it.
pub fn note_heights(crs: &Crs, notes: &mut Notes) {
    if crs.heights_are_stated() {
        return;
    }
    let (name, taken) = (crs.name(), crs.heights_in_words());
    let [ellipsoid, geoid] = match name.starts_with('+') {
        true => ["+ellipsoid", "+geoid"].map(|kind| format!("'{name} {kind}'")),
        false => ["+ellipsoid", "+geoid"].map(|kind| format!("{name}{kind}")),
    };
    let mend = format!(
        "say which: --crs {ellipsoid} or {geoid} (crs of a scenario's source), or a vertical system in the file"
    );
    notes.assume("heights", taken, mend);
}

impl Place {
    /// What the options state, or else the system `own` that the source itself names. Heights of a map without a vertical system
    /// count in the map's own unit.
    pub fn of(options: &Options, own: Option<&str>, path: &Path) -> Result<Self, SourceError> {
        if let Some(georef) = &options.georef {
            return Ok(Self::Local(placement(georef)?.affine()));
        }
        let mend = "name its system with --crs, or place it with --georef";
        let none = || {
            Fault::new(
                "coordinates",
                "no coordinate reference system is named",
                mend,
            )
        };
        let name = options.crs.as_deref().or(own).ok_or_else(none);
        let found = name.and_then(|name| crs(name, options));
        // Three coordinates of a model are in one unit, unless its system says otherwise.
        let found = found.map(
            |crs| match crs.height_unit_is_stated() || crs.is_geocentric() {
                true => crs,
                false => {
                    let unit_m = crs.map_unit_m();
                    crs.with_height_unit(unit_m)
                }
            },
        );
        found
            .map(|crs| Self::Crs(Box::new(crs)))
            .map_err(|fault| fault.of(path))
    }

    /// Notes what the place takes for granted: heights over the geoid or the ellipsoid, where nothing says which. Every reader calls it
    /// once a file whose own heights count.
    pub fn note(&self, notes: &mut Notes) {
        if let Self::Crs(crs) = self {
            note_heights(crs, notes);
            let unit_m = crs.height_unit_m();
            if !crs.height_unit_is_stated() && unit_m != 1.0 {
                let what = format!("in the map's unit of {unit_m} m, as nothing else is said");
                let mend = format!(
                    "name the vertical system: --crs {}+CODE, such as +5703 for metres or +6360 for US feet",
                    crs.name()
                );
                notes.assume("heights", what, mend);
            }
        }
    }

    /// Lowest and highest corner of a source's points, in its coordinates; across ±180° the longitudes go on beyond it.
    pub fn bounds(&self, points: impl Iterator<Item = DVec3> + Clone) -> [DVec3; 2] {
        match self {
            Self::Crs(crs) => crs.bounds(points),
            Self::Local(_) => {
                let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                points.fold(start, |[low, high], r| [low.min(r), high.max(r)])
            }
        }
    }

    /// The ECEF position [m] of a point of the source.
    pub fn ecef_m(&self, r: DVec3) -> Result<DVec3, Fault> {
        match self {
            Self::Crs(crs) => Ok(crs.to_ecef(r)?),
            Self::Local(affine) => Ok(affine.transform_point3(r)),
        }
    }
}

/// The frame of a layer: that of the options, or one in the middle of `bounds` (lowest and highest corner in the source's coordinates) at
/// their lowest height.
pub fn site(options: &Options, place: &Place, bounds: [DVec3; 2]) -> Result<SiteFrame, Fault> {
    if let Some(site) = options.site {
        return Ok(site);
    }
    let middle = (bounds[0] + bounds[1]) / 2.0;
    let middle = match place {
        Place::Crs(crs) if !crs.is_geocentric() => middle.with_z(bounds[0].z),
        _ => middle,
    };
    let r_ecef_m = place.ecef_m(middle)?;
    if !RADII_M.contains(&r_ecef_m.length()) {
        let far_km = r_ecef_m.length() / 1e3;
        let what =
            format!("their middle lies {far_km:.0} km from the centre of the Earth, not on it");
        let mend = "check the unit of the model, and the parameters of --georef";
        return Err(Fault::new("coordinates", what, mend));
    }
    Ok(SiteFrame::new(Geodetic::from_ecef(r_ecef_m)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_models::maths::geodesy::longitude_near_deg;

    #[test]
    fn a_parameter_file_comes_back() {
        let placement_ = Placement {
            center_local: DVec3::new(1.0, 2.0, 3.0),
            r_ecef_m: DVec3::new(3_924_000.0, 299_000.0, 5_002_000.0),
            q_ecef_local: DQuat::from_scaled_axis(DVec3::new(0.1, 2.0, -0.7)),
            scale: 0.0254,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("georef.toml");
        let body = toml::to_string(&Parameters::from(placement_)).unwrap();
        std::fs::write(&path, format!("[placement]\n{body}\n[fit]\nrms_m = 0.1\n")).unwrap();
        let back = placement(&path).unwrap();
        let r = DVec3::new(200.0, -300.0, 20.0);
        assert!(back.to_ecef(r).distance(placement_.to_ecef(r)) < 2e-9);
        for wrong in ["", "[placement]\nscale = 1.0\n", "placement = 3", "\u{0}"] {
            std::fs::write(&path, wrong).unwrap();
            assert!(
                matches!(placement(&path), Err(SourceError::Content { .. })),
                "{wrong}"
            );
        }
        std::fs::write(
            &path,
            format!("[placement]\n{}", body.replace("0.0254", "nan")),
        )
        .unwrap();
        assert!(placement(&path).is_err());
    }

    #[test]
    fn heights_that_nothing_states_are_noted_once_with_what_states_them() {
        let noted = |name: &str, options: &Options| {
            let options = Options {
                crs: Some(name.into()),
                ..options.clone()
            };
            let place = Place::of(&options, None, Path::new("a.obj")).unwrap();
            let mut notes = Notes::default();
            place.note(&mut notes);
            place.note(&mut notes);
            let warnings = notes.warnings(Path::new("a.obj"));
            warnings.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        let plain = Options::default();
        for (name, taken) in [
            ("EPSG:25832", "geoid"),
            ("WGS84", "ellipsoid"),
            ("+proj=utm +zone=32 +ellps=GRS80", "geoid"),
        ] {
            let lines = noted(name, &plain);
            assert_eq!(lines.len(), 1, "{name}");
            assert!(
                lines[0].contains(taken) && lines[0].contains("+ellipsoid"),
                "{lines:?}"
            );
            // What the warning names silences it.
            for kind in ["+ellipsoid", "+geoid"] {
                let space = if name.starts_with('+') { " " } else { "" };
                let named = format!("{name}{space}{kind}");
                assert!(lines[0].contains(&named), "{lines:?}");
                assert!(noted(&named, &plain).is_empty(), "{named}");
            }
        }
        for name in ["EPSG:7415", "EPSG:4978", "EPSG:4979", "EPSG:2056+5728"] {
            assert!(noted(name, &plain).is_empty(), "{name}");
        }
        let stated = Options {
            geoid_height_m: Some(47.5),
            ..plain
        };
        assert!(noted("WGS84", &stated).is_empty());
    }

    #[test]
    fn the_middle_of_a_source_across_the_antimeridian_lies_in_it() {
        let place = Place::Crs(Box::new(Crs::parse("WGS84").unwrap()));
        let points = [[179.99, -16.5, 3.0], [-179.98, -16.4, 9.0]].map(DVec3::from);
        let bounds = place.bounds(points.into_iter());
        let site = site(&Options::default(), &place, bounds).unwrap();
        let middle_deg = site.origin().longitude_rad.to_degrees();
        assert!(
            (longitude_near_deg(middle_deg, 180.0) - 180.005).abs() < 1e-9,
            "{middle_deg}"
        );
    }

    #[test]
    fn a_model_whose_middle_is_not_on_the_earth_is_refused() {
        let place = Place::Local(DAffine3::from_translation(DVec3::new(
            6_378_137.0,
            0.0,
            0.0,
        )));
        let bounds = |far: f64| [DVec3::ZERO, DVec3::new(far, 2.0, 3.0)];
        assert!(site(&Options::default(), &place, bounds(100.0)).is_ok());
        // Millimetres that count as metres.
        let error = site(&Options::default(), &place, bounds(1e6)).unwrap_err();
        assert!(error.to_string().contains("6878 km"), "{error}");
    }

    #[test]
    fn a_source_without_a_system_says_what_to_name() {
        let path = Path::new("model.obj");
        let error = Place::of(&Options::default(), None, path)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("--crs") && error.contains("--georef"),
            "{error}"
        );
        let options = Options {
            crs: Some("EPSG:7415".into()),
            ..Options::default()
        };
        let place = Place::of(&options, Some("nonsense"), path).unwrap();
        let corner = DVec3::new(84_600.0, 447_200.0, 1.5);
        let site = site(&options, &place, [corner, corner + DVec3::splat(100.0)]).unwrap();
        let middle = corner + DVec3::new(50.0, 50.0, 0.0);
        let r_enu_m = site.ecef_to_enu(place.ecef_m(middle).unwrap());
        assert!(r_enu_m.length() < 1e-6);
    }
}
