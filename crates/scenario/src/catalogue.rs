//! The UAV catalogue: the files of `assets/uavs`, which are part of the program, and files of one's own.

use std::f64::consts::PI;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec2, DVec3};
use include_dir::{Dir, include_dir};
use schemars::JsonSchema;
use serde::Deserialize;
use thiserror::Error;

use super::check::Check;
use super::load::{self, Checked, InputError, Parsed, suggestion};
use super::skin::SkinKind;
use boresight_common::data;
use boresight_models::bodies::{hub_direction, overhang_m};
use boresight_models::flight::class::ObjectClass;
use boresight_models::flight::shape::{Coat, Frame, Shape};
use boresight_models::flight::uav::{Part, UavModel};
use boresight_models::shape::gltf::{GltfError, gltf_mesh};
use boresight_models::shape::mesh::MeshData;

/// The files of the catalogue, as they were when the program was built.
static SHIPPED: Dir = include_dir!("$CARGO_MANIFEST_DIR/../../assets/uavs");

const INCH_M: f64 = 0.0254; // [m]

/// Why there is no UAV of a name.
#[derive(Debug, Error)]
pub enum UavError {
    /// The catalogue has none.
    #[error("unknown model '{model}'{known}, or a path that ends in .toml")]
    Unknown {
        /// What was asked for.
        model: String,
        /// What there is.
        known: String,
    },
    /// Its file cannot be used.
    #[error(transparent)]
    File(#[from] InputError),
}

/// Names of the catalogue's UAVs, in their alphabet's order.
pub fn names() -> Vec<&'static str> {
    let mut names: Vec<&str> = (SHIPPED.files())
        .filter_map(|file| file.path().to_str()?.strip_suffix(".toml"))
        .collect();
    names.sort_unstable();
    names
}

/// A model must be a name of the catalogue, or a path, whose file is not read.
pub fn check(check: &mut Check, key: &str, model: &str) {
    let known = is_path(model) || names().contains(&model);
    check.that(known, key, || unknown(model).to_string());
}

/// The UAV of a name of the catalogue, or of a path, from the working directory or the program's data, that ends in `.toml`.
pub fn load(model: &str) -> Result<UavModel, UavError> {
    if is_path(model) {
        let path = &data::found(Path::new(model));
        let folder = path.parent().unwrap_or(Path::new(""));
        let beside = |name: &Path| std::fs::read(folder.join(name));
        return Ok(parse(
            &load::read(path)?,
            model,
            &path.display().to_string(),
            beside,
        )?);
    }
    let embedded = |name: &Path| {
        let file = SHIPPED.get_file(name);
        let bytes = file.map(|file| file.contents().to_vec());
        bytes.ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))
    };
    let name = format!("{model}.toml");
    let file = SHIPPED.get_file(&name).ok_or_else(|| unknown(model))?;
    let text = String::from_utf8_lossy(file.contents());
    let place = format!("assets/uavs/{name}");
    Ok(parse(&text, model, &place, embedded)?)
}

/// A model to learn from must be one, as by [`check`], and must not be held out; a file that cannot be read tells so when it is loaded.
pub fn check_learned(check: &mut Check, key: &str, model: &str) {
    self::check(check, key, model);
    let held_out = load(model).is_ok_and(|uav| uav.held_out);
    check.that(!held_out, key, || held_out_words(model));
}

/// Why a held-out model cannot be learned from, and what to do.
pub fn held_out_words(model: &str) -> String {
    format!(
        "'{model}' is held out, so that networks are judged by a UAV that they never saw: leave it out, or name another model"
    )
}

fn is_path(model: &str) -> bool {
    Path::new(model)
        .extension()
        .is_some_and(|extension| extension == "toml")
}

fn unknown(model: &str) -> UavError {
    UavError::Unknown {
        model: model.to_owned(),
        known: suggestion(model, &names()),
    }
}

/// Parses and checks a UAV's file; `file` is named in errors, `read` gives the bytes of a file beside it.
fn parse(
    text: &str,
    id: &str,
    file: &str,
    read: impl FnOnce(&Path) -> io::Result<Vec<u8>>,
) -> Result<UavModel, InputError> {
    let Parsed { value, places } = load::parse::<UavFile>(text, file, &[])?;
    let shape = (value.shape(read)).map_err(|error| places.refuse("shape.gltf", error))?;
    Ok(value.model(id, shape))
}

/// A UAV. Body axes are forward, left, up, from the centre of the rotors.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct UavFile {
    /// Maker and model.
    name: String,
    /// Whether it is kept for judging: recipes of data sets and tracks that networks learn from refuse it.
    #[serde(default)]
    held_out: bool,
    /// What it is for detectors and evaluations.
    class: UavClass,
    /// Take-off mass.
    mass_kg: f64,
    /// Motor-to-motor diagonal.
    diagonal_m: f64,
    /// Length, width, height. A frame of ours with four rotors has its hubs where this and the diagonal put
    /// them.
    size_m: [f64; 3],
    /// Principal moments of inertia about forward, left, up.
    inertia_kgm2: [f64; 3],
    /// Drag coefficient times frontal area. It should close `m g tan(tilt) = rho C_D A v² / 2` at the
    /// greatest speed and tilt in 1.225 kg/m³ air.
    drag_area_m2: f64,
    /// Greatest level speed in still air.
    v_max_mps: f64,
    /// Greatest tilt of the thrust axis from the vertical.
    max_tilt_deg: f64,
    /// Greatest roll or pitch rate; the autopilot allows half of it in yaw.
    max_rate_degps: f64,
    /// Its rotors, evenly spaced on the diagonal, neighbours turning in opposite senses.
    rotors: RotorsFile,
    /// What the laser may be aimed at.
    parts: PartsFile,
    /// What it looks like.
    shape: ShapeFile,
}

/// Class of a UAV.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum UavClass {
    /// A small, agile racer flown by first-person view.
    Fpv,
    /// A camera or industrial UAV with four rotors.
    Quadcopter,
    /// An industrial UAV with six rotors.
    Hexacopter,
}

/// Rotors.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Rotors")]
struct RotorsFile {
    /// How many, 4 or 6.
    count: usize,
    /// Propeller diameter.
    diameter_in: f64,
    /// Greatest total thrust over weight in 1.225 kg/m³ air.
    thrust_to_weight: f64,
    /// Time constant of the first-order speed lag.
    lag_s: f64,
    /// Hubs in body axes, the front left first, counter-clockwise seen from above; with `shape.gltf` alone.
    hubs_body_m: Option<Vec<[f64; 3]>>,
}

/// Parts that the laser may be aimed at.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Parts")]
struct PartsFile {
    /// The hull; absent its place: the centroid of the surface.
    body: FoundPart,
    /// The battery, one of them where there are more.
    battery: PlacedPart,
    /// The front left motor; absent its place: the hub of its rotor.
    rotor_hub: FoundPart,
    /// The camera.
    camera: PlacedPart,
    /// What the arms are made of; absent: as the body.
    arms: Option<SkinKind>,
}

/// A part whose place is given.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct PlacedPart {
    /// Its middle in body axes.
    at_body_m: [f64; 3],
    /// What it is made of.
    skin: SkinKind,
}

/// A part whose place the shape tells.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FoundPart {
    /// Its middle in body axes.
    at_body_m: Option<[f64; 3]>,
    /// What it is made of.
    skin: SkinKind,
}

/// Shape: either `frame` or `gltf`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Shape")]
struct ShapeFile {
    /// A frame of ours, built in the file's sizes.
    frame: Option<Frame>,
    /// A binary glTF 2.0 file, relative to this one: its triangles and base colours, without propellers; in
    /// metres, looking along +z with +y up.
    gltf: Option<PathBuf>,
    /// Colours of the frame, the propellers and what data sets fit on.
    #[serde(default)]
    paint: PaintFile,
}

/// Colours: linear albedo in red, green and blue, 0 to 1.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Paint")]
struct PaintFile {
    /// Hull.
    shell: [f64; 3],
    /// Arms.
    arms: [f64; 3],
    /// Landing gear.
    gear: [f64; 3],
    /// Lower half of the motors.
    motor: [f64; 3],
    /// Propellers.
    blades: [f64; 3],
}

impl Default for PaintFile {
    /// Dark, with carbon-fibre arms, gear and propellers and bare motors.
    fn default() -> Self {
        const CARBON: [f64; 3] = [0.035, 0.035, 0.038];
        Self {
            shell: [0.085, 0.09, 0.095],
            arms: CARBON,
            gear: CARBON,
            motor: [0.5, 0.5, 0.51],
            blades: CARBON,
        }
    }
}

/// Why the shape of a file cannot be used.
#[derive(Debug, Error)]
enum ShapeError {
    #[error("{}: cannot be read: {source}; name an existing file", file.display())]
    Read { file: PathBuf, source: io::Error },
    #[error("{}: {source}", file.display())]
    Gltf { file: PathBuf, source: GltfError },
    #[error(
        "{}: measures {found_m:.3} m in length, width and height, size_m says {size_m:.3}; export it in \
         metres, looking along +z with +y up, or correct size_m",
        file.display()
    )]
    Size {
        file: PathBuf,
        found_m: DVec3,
        size_m: DVec3,
    },
}

impl UavFile {
    /// Its shape; `read` gives the bytes of a file beside it.
    fn shape(&self, read: impl FnOnce(&Path) -> io::Result<Vec<u8>>) -> Result<Shape, ShapeError> {
        let file = match (&self.shape.gltf, self.shape.frame) {
            (Some(file), _) => file.clone(),
            // The check has made sure of one of them.
            (None, frame) => return Ok(Shape::Frame(frame.unwrap_or(Frame::Ribbed))),
        };
        let bytes = match read(&file) {
            Ok(bytes) => bytes,
            Err(source) => return Err(ShapeError::Read { file, source }),
        };
        let body = match gltf_mesh(&bytes) {
            Ok(body) => body,
            Err(source) => return Err(ShapeError::Gltf { file, source }),
        };
        let (found_m, size_m) = (measured_m(&body), DVec3::from(self.size_m));
        // Twice too large or small is no matter of what counts as part of it.
        let share = found_m / size_m;
        if share.min_element() < 0.5 || share.max_element() > 2.0 {
            return Err(ShapeError::Size {
                file,
                found_m,
                size_m,
            });
        }
        let hubs = self.rotors.hubs_body_m.iter().flatten();
        Ok(Shape::Own {
            body: Arc::new(body),
            hubs_body_m: hubs.copied().map(DVec3::from).collect(),
        })
    }

    fn model(self, id: &str, shape: Shape) -> UavModel {
        let colour = |rgb: [f64; 3]| rgb.map(|share| share as f32);
        let placed = |part: PlacedPart| Part {
            at_body_m: DVec3::from(part.at_body_m),
            skin: part.skin.skin(),
        };
        let found = |part: FoundPart| Part {
            at_body_m: part.at_body_m.map(DVec3::from),
            skin: part.skin.skin(),
        };
        let Self {
            rotors,
            parts,
            shape: ShapeFile { paint, .. },
            ..
        } = self;
        UavModel {
            id: id.to_owned(),
            name: self.name,
            held_out: self.held_out,
            class: match self.class {
                UavClass::Fpv => ObjectClass::Fpv,
                UavClass::Quadcopter => ObjectClass::Quadcopter,
                UavClass::Hexacopter => ObjectClass::Hexacopter,
            },
            mass_kg: self.mass_kg,
            diagonal_m: self.diagonal_m,
            size_m: self.size_m,
            rotor_count: rotors.count,
            propeller_diameter_m: rotors.diameter_in * INCH_M,
            v_max_mps: self.v_max_mps,
            max_tilt_rad: self.max_tilt_deg.to_radians(),
            max_rate_radps: self.max_rate_degps.to_radians(),
            thrust_to_weight: rotors.thrust_to_weight,
            inertia_kgm2: self.inertia_kgm2,
            drag_area_m2: self.drag_area_m2,
            rotor_lag_s: rotors.lag_s,
            arms: parts.arms.unwrap_or(parts.body.skin).skin(),
            body: found(parts.body),
            battery: placed(parts.battery),
            rotor_hub: found(parts.rotor_hub),
            camera: placed(parts.camera),
            shape,
            coat: Coat {
                shell: colour(paint.shell),
                arms: [colour(paint.arms); 2],
                gear: colour(paint.gear),
                motor: colour(paint.motor),
                blades: colour(paint.blades),
            },
        }
    }
}

/// Length, width and height [m].
fn measured_m(mesh: &MeshData) -> DVec3 {
    mesh.bounds_m()
        .map_or(DVec3::ZERO, |(low, high)| high - low)
}

impl Checked for UavFile {
    fn check(&self, check: &mut Check) {
        check.name("name", &self.name, &[]);
        check.within("mass_kg", self.mass_kg, 0.01..=1000.0);
        check.within("diagonal_m", self.diagonal_m, 0.02..=20.0);
        for (axis, side_m) in self.size_m.into_iter().enumerate() {
            check.within(&format!("size_m[{axis}]"), side_m, 0.01..=20.0);
        }
        for (axis, moment_kgm2) in self.inertia_kgm2.into_iter().enumerate() {
            check.positive(&format!("inertia_kgm2[{axis}]"), moment_kgm2);
        }
        let [x, y, z] = self.inertia_kgm2;
        check.that(x + y > z && y + z > x && z + x > y, "inertia_kgm2", || {
            format!("no body has [{x}, {y}, {z}]: each must be less than the other two together")
        });
        check.within("drag_area_m2", self.drag_area_m2, 1e-4..=10.0);
        check.within("v_max_mps", self.v_max_mps, 1.0..=150.0);
        check.within("max_tilt_deg", self.max_tilt_deg, 1.0..=80.0);
        check.within("max_rate_degps", self.max_rate_degps, 10.0..=3000.0);
        self.check_rotors(check);
        self.check_shape(check);
        let placed = |part: &PlacedPart| Some(part.at_body_m);
        for (key, at_body_m) in [
            ("body", self.parts.body.at_body_m),
            ("battery", placed(&self.parts.battery)),
            ("rotor_hub", self.parts.rotor_hub.at_body_m),
            ("camera", placed(&self.parts.camera)),
        ] {
            let reach_m = self.size_m.into_iter().fold(self.diagonal_m, f64::max);
            for (axis, x_m) in at_body_m.iter().flatten().enumerate() {
                let key = format!("parts.{key}.at_body_m[{axis}]");
                check.within(&key, *x_m, -reach_m..=reach_m);
            }
        }
    }
}

impl UavFile {
    fn check_rotors(&self, check: &mut Check) {
        let RotorsFile {
            count,
            diameter_in,
            thrust_to_weight,
            lag_s,
            ..
        } = self.rotors;
        check.that([4, 6].contains(&count), "rotors.count", || {
            format!("found {count}, must be 4 or 6")
        });
        let wanted = if self.class == UavClass::Hexacopter {
            6
        } else {
            4
        };
        let right = count == wanted || self.class == UavClass::Fpv;
        check.agrees(right, ("class", "rotors.count"), || {
            format!("has {wanted} rotors, but rotors.count is {count}: correct one of them")
        });
        check.within("rotors.diameter_in", diameter_in, 1.0..=100.0);
        // A fifth more than it takes to hold the height at the greatest tilt.
        let least = 1.2 / self.max_tilt_deg.to_radians().cos();
        let keys = ("rotors.thrust_to_weight", "max_tilt_deg");
        check.agrees(thrust_to_weight >= least, keys, || {
            format!("found {thrust_to_weight}, must be at least {least:.2} at this max_tilt_deg")
        });
        check.within("rotors.thrust_to_weight", thrust_to_weight, 1.0..=30.0);
        check.within("rotors.lag_s", lag_s, 1e-3..=1.0);
    }

    fn check_shape(&self, check: &mut Check) {
        let ShapeFile { frame, gltf, paint } = &self.shape;
        check.that(frame.is_some() || gltf.is_some(), "shape", || {
            "has no shape: add 'frame = ...' or 'gltf = ...' to this table".to_owned()
        });
        check.that(frame.is_none() || gltf.is_none(), "shape.gltf", || {
            "stands beside 'frame': leave one of them out".to_owned()
        });
        if gltf.is_some() && frame.is_some() {
            // Which of them stays decides what else is asked.
        } else if gltf.is_some() {
            self.check_hubs(check);
        } else {
            check.that(
                self.rotors.hubs_body_m.is_none(),
                "rotors.hubs_body_m",
                || {
                    "belongs to 'shape.gltf': a frame has its hubs where size and diagonal put them"
                        .to_owned()
                },
            );
            self.check_plan(check);
        }
        for (key, rgb) in [
            ("shell", paint.shell),
            ("arms", paint.arms),
            ("gear", paint.gear),
            ("motor", paint.motor),
            ("blades", paint.blades),
        ] {
            for (band, share) in rgb.into_iter().enumerate() {
                check.within(&format!("shape.paint.{key}[{band}]"), share, 0.0..=1.0);
            }
        }
    }

    /// A place for every rotor, each next to where the flight model has it.
    fn check_hubs(&self, check: &mut Check) {
        let (key, count) = ("rotors.hubs_body_m", self.rotors.count);
        let Some(hubs) = &self.rotors.hubs_body_m else {
            return check.that(false, key, || {
                "is missing: add 'hubs_body_m = [[x, y, z], ...]', a place for each rotor"
                    .to_owned()
            });
        };
        check.that(hubs.len() == count, key, || {
            let len = hubs.len();
            format!("has {len} places for {count} rotors: give each rotor one")
        });
        for (i, hub) in hubs.iter().enumerate() {
            let [x, y, _] = *hub;
            let off_rad = DVec2::new(x, y).angle_to(hub_direction(i, count)).abs();
            // Without a direction there is no angle.
            check.that(off_rad < PI / count as f64, &format!("{key}[{i}]"), || {
                "is out of turn: start at the front left, go on counter-clockwise seen from above"
                    .to_owned()
            });
        }
    }

    /// Four hubs on the diagonal lie within length and width.
    fn check_plan(&self, check: &mut Check) {
        let ([l, w, _], diagonal_m) = (self.size_m, self.diagonal_m);
        let beyond_m = overhang_m(self.size_m, diagonal_m);
        let hub = DVec2::new(l - beyond_m, w - beyond_m);
        let fits = beyond_m >= 0.0 && (hub.length() / diagonal_m - 1.0).abs() < 1e-6;
        let right = self.rotors.count != 4 || (fits && hub.min_element() > 0.0);
        check.that(right, "size_m", || {
            format!(
                "no four hubs on a diagonal of {diagonal_m} m lie at the corners of {l} m by {w} m - give \
                 length and width over the motors"
            )
        });
    }
}

#[cfg(test)]
mod tests;
