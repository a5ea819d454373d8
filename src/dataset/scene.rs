//! A scene of a set: place, time, weather and camera, drawn from its seed.

use super::error::DatasetError;
use super::recipe::{self, CameraRanges, CityRanges, Recipe};
use super::shares::{Background, choose, log_range, pick};
use super::stage::Prop;
use crate::components::environment::Environment;
use crate::models::air::atmosphere::{Cn2Profile, air_density_kgpm3};
use crate::models::air::backdrop::Backdrop;
use crate::models::air::sky::{GROUND_ALBEDO, Sky};
use crate::models::air::weather::Weather;
use crate::models::air::wind::{MeanWind, WindError};
use crate::models::bodies::{UavStyle, drawn_distractor_mesh, styled_uav_mesh};
use crate::models::flight::class::ObjectClass;
use crate::models::flight::distractor::DistractorKind;
use crate::models::flight::uav::UavModel;
use crate::models::ground::city::{City, CityParams, learned_seed};
use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::maths::rng::Stream;
use crate::models::optics::camera::{CameraError, Pinhole};
use crate::models::optics::exposure::white_balance;
use crate::models::optics::mosaic::Mosaic;
use crate::models::optics::motion::Shutter;
use crate::models::optics::sensor::{Sensor, SensorParams, Transfer};
use crate::models::shape::mesh::MeshData;
use crate::models::shape::structures::{StructureKind, structure_mesh};
use crate::scenario::{UNREPORTED_WEATHER, catalogue};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// A place, a time, a weather and a camera.
pub struct Scene {
    /// Its number.
    pub index: u32,
    /// What stands behind its targets.
    pub background: Background,
    /// City, sky and air.
    pub environment: Environment,
    /// The camera and its place.
    pub camera: SceneCamera,
    /// Its sensor, ready.
    pub sensor: Sensor,
    /// What may appear.
    pub props: Vec<Prop>,
    /// The UAVs among the props, which come first.
    pub uavs: Vec<Arc<UavModel>>,
    /// Cranes, masts and the like, about the origin.
    pub clutter: Vec<MeshData>,
    /// Tops of the clutter [m].
    pub tops_enu_m: Vec<DVec3>,
}

/// The camera of a scene.
pub struct SceneCamera {
    /// Its place [m].
    pub r_enu_m: DVec3,
    /// Its projection.
    pub pinhole: Pinhole,
    /// What its sensor is made of; the exposure is set for every still.
    pub sensor: SensorParams,
    /// Longest exposure [s].
    pub max_exposure_s: f64,
    /// Error of the automatic exposure [stops].
    pub exposure_error_stops: f64,
    /// Whether the exposure follows the picture, or the light.
    pub metered: bool,
}

impl Scene {
    /// Draws scene `index` of a recipe and generates its surroundings.
    ///
    /// Every part has a stream of its own, so that a change to one leaves the others as they are.
    pub fn draw(recipe: &Recipe, index: u32, background: Background) -> Result<Self, DatasetError> {
        let stream = |purpose| Stream::new(recipe.seed, u64::from(index), purpose);
        let (sun_dir_enu, weather) = light(&recipe.light, &mut stream("dataset light"));
        let params = city_params(&recipe.city, background, &mut stream("dataset city"));
        let mut city = City::generate(&params).map_err(|source| DatasetError::City {
            scene: index,
            source,
        })?;
        city.bake_shadows(sun_dir_enu);
        let mut rng = stream("dataset camera");
        let mut camera =
            SceneCamera::draw(&recipe.camera, background, &city, &mut rng).map_err(|source| {
                DatasetError::Camera {
                    scene: index,
                    source,
                }
            })?;
        let (props, uavs) = props(&recipe.targets, &mut stream("dataset looks"))?;
        let mut rng = stream("dataset clouds");
        let clouds = (rng.uniform() < 0.8).then(|| rng.bits());
        let mut rng = stream("dataset clutter");
        let (clutter, tops_enu_m) = clutter(&city, background, camera.r_enu_m, &mut rng);
        let environment = environment(city, weather, sun_dir_enu, clouds).map_err(|source| {
            DatasetError::Wind {
                scene: index,
                source,
            }
        })?;
        let balance = &recipe.camera.white_balance_error_stops;
        let mut rng = stream("dataset white balance");
        camera.sensor.white_balance = drawn_balance(&environment, *balance, &mut rng);
        let sensor = Sensor::new(&camera.sensor)?;
        Ok(Self {
            index,
            background,
            environment,
            camera,
            sensor,
            props,
            uavs,
            clutter,
            tops_enu_m,
        })
    }
}

/// The direction to the sun and the weather.
fn light(light: &recipe::Light, rng: &mut Stream) -> (DVec3, Weather) {
    let elevation_deg = match choose(&[light.day, light.low_sun, light.dusk], rng) {
        0 => rng.range(15.0, 60.0),
        1 => rng.range(2.0, 15.0),
        _ => rng.range(-6.0, 2.0),
    };
    let azimuth_rad = rng.range(0.0, TAU);
    let sun_dir_enu = az_el_to_los(DVec2::new(azimuth_rad, f64::to_radians(elevation_deg)));
    // Few small cumuli are as common as a clear sky: their crumbs are taken for UAVs.
    let cloud_cover = match choose(&[0.25, 0.3, 0.2, 0.25], rng) {
        0 => rng.range(0.0, 0.12),
        1 => rng.range(0.12, 0.4),
        2 => rng.range(0.4, 0.85),
        _ => rng.range(0.9, 1.0),
    };
    let weather = Weather {
        visibility_m: log_range(light.visibility_m, rng),
        cloud_cover,
        ..UNREPORTED_WEATHER
    };
    (sun_dir_enu, weather)
}

/// What the surroundings look like: a city, or open country.
fn city_params(ranges: &CityRanges, background: Background, rng: &mut Stream) -> CityParams {
    let [least, most] = ranges.extent_m;
    let standard = CityParams {
        extent_m: rng.range(least, most),
        seed: learned_seed(rng.bits()),
        relief_m: rng.range(0.0, 25.0),
        river: rng.uniform() < 0.4,
        max_height_m: rng.range(40.0, 140.0),
        ..CityParams::default()
    };
    match background {
        Background::Forest => CityParams {
            forest_share: rng.range(0.25, 0.8),
            building_density: rng.range(0.0, 0.15),
            ..standard
        },
        Background::Sky | Background::Urban => CityParams {
            building_density: rng.range(0.6, 0.95),
            park_share: rng.range(0.02, 0.12),
            ..standard
        },
    }
}

/// White balance by the scene's light, or daylight's in one of five cameras, with an error in red
/// and blue of the standard deviation `error_stops`.
fn drawn_balance(environment: &Environment, error_stops: f64, rng: &mut Stream) -> [f64; 3] {
    const DAYLIGHT: f64 = 0.2;
    let fixed = rng.uniform() < DAYLIGHT;
    let balance = if fixed {
        [1.0; 3]
    } else {
        white_balance(environment.backdrop.sky.illuminant_klx())
    };
    let mut off = || (error_stops * rng.normal()).exp2();
    let balance = [balance[0] * off(), balance[1], balance[2] * off()];
    let least = balance.into_iter().fold(f64::MAX, f64::min);
    balance.map(|gain| gain / least)
}

impl SceneCamera {
    fn draw(
        ranges: &CameraRanges,
        background: Background,
        city: &City,
        rng: &mut Stream,
    ) -> Result<Self, CameraError> {
        let [width_px, height_px] = ranges.sizes_px[pick(ranges.sizes_px.len(), rng)];
        let hfov_deg = match background {
            Background::Sky => ranges.hfov_deg,
            _ => [ranges.ground_hfov_deg, ranges.hfov_deg[1]],
        };
        let hfov_rad = log_range(hfov_deg, rng).to_radians();
        let pinhole = Pinhole::from_hfov(width_px, height_px, hfov_rad)?;
        let r_enu_m = stand(city, ranges.height_m, rng);
        let sensor = SensorParams {
            f_number: 4.0,
            pixel_pitch_m: 5e-6,
            transmission: 0.8,
            quantum_efficiency: 0.6,
            full_well_e: log_range([4_000.0, 25_000.0], rng),
            read_noise_e: log_range([2.0, 12.0], rng),
            dark_current_eps: log_range([1.0, 100.0], rng),
            dsnu_e: log_range([0.3, 4.0], rng),
            prnu: log_range([0.003, 0.02], rng),
            pattern_key: rng.bits(),
            size_px: [width_px, height_px],
            focal_px: pinhole.focal_px,
            vignetting: rng.range(0.0, 0.35),
            mosaic: if rng.uniform() < ranges.mosaic_share {
                Mosaic::Rggb
            } else {
                Mosaic::None
            },
            // Annotations are those of one instant.
            shutter: Shutter::Global,
            motion_blur: true,
            glare: log_range([0.3, 3.0], rng),
            blur_sigma_px: rng.range(ranges.blur_px[0], ranges.blur_px[1]),
            // Of the scene's light, which is not drawn yet; see `Scene::draw`.
            white_balance: [1.0; 3],
            transfer: Transfer::Srgb,
        };
        let error = ranges.exposure_error_stops;
        Ok(Self {
            r_enu_m,
            pinhole,
            sensor,
            exposure_error_stops: rng.range(-error, error),
            max_exposure_s: log_range([1.0 / 200.0, 1.0 / 50.0], rng),
            metered: rng.uniform() < 0.5,
        })
    }
}

/// Birds that may follow one of their kind.
const FLOCK: usize = 6;

/// What may appear, and which UAVs come first in it: as many looks of every class, so that the
/// pictures of a scene differ in them, and some distractors.
fn props(
    targets: &recipe::Targets,
    rng: &mut Stream,
) -> Result<(Vec<Prop>, Vec<Arc<UavModel>>), DatasetError> {
    let mut uavs = Vec::new();
    for model in &targets.models {
        let uav = Arc::new(catalogue::load(model)?);
        uavs.extend(match uav.class {
            ObjectClass::Quadcopter => vec![uav; 2],
            _ => vec![uav; 4],
        });
    }
    let (classes, shares) = targets.shares();
    for (class, share) in classes.into_iter().zip(shares) {
        if share > 0.0 && uavs.iter().all(|uav| uav.class != class) {
            return Err(DatasetError::NoModel { class });
        }
    }
    let mut props: Vec<_> = (uavs.iter())
        .map(|uav| Prop {
            mesh: Arc::new(styled_uav_mesh(uav, &UavStyle::drawn(rng))),
            distractor: None,
        })
        .collect();
    let others = [
        (DistractorKind::Bird, 3),
        (DistractorKind::Crow, 1),
        (DistractorKind::Pigeon, 1),
        (DistractorKind::Swift, 1),
        (DistractorKind::Goose, 1),
        (DistractorKind::Raptor, 2),
        (DistractorKind::Aeroplane, 1),
        (DistractorKind::Contrail, 1),
        (DistractorKind::Turboprop, 2),
        (DistractorKind::LightAircraft, 2),
        (DistractorKind::Helicopter, 2),
        (DistractorKind::Balloon, 2),
        (DistractorKind::Leaf, 2),
    ];
    for kind in others.iter().flat_map(|(kind, count)| vec![*kind; *count]) {
        props.push(Prop {
            mesh: Arc::new(drawn_distractor_mesh(kind, rng)),
            distractor: Some(kind),
        });
    }
    // Birds of a flock share their mesh.
    let birds: Vec<Prop> = (props.iter())
        .filter(|prop| prop.distractor.is_some_and(|kind| kind.species().is_some()))
        .cloned()
        .collect();
    props.extend(vec![birds[pick(birds.len(), rng)].clone(); FLOCK]);
    Ok((props, uavs))
}

/// The world around a scene, whose clouds are drawn if they have a seed; its wind moves nothing in the pictures.
fn environment(
    city: City,
    weather: Weather,
    sun_dir_enu: DVec3,
    clouds: Option<u64>,
) -> Result<Environment, WindError> {
    let sky = Sky::new(
        sun_dir_enu,
        weather.visibility_m,
        weather.cloud_cover,
        GROUND_ALBEDO,
    );
    Ok(Environment {
        site: SiteFrame::new(Geodetic {
            latitude_rad: 47.3769f64.to_radians(),
            longitude_rad: 8.5417f64.to_radians(),
            height_m: 455.0, // [m]
        }),
        city: Arc::new(city),
        tiles: None,
        mean_wind: MeanWind::new(
            weather.wind_speed_mps,
            weather.wind_from_rad.to_degrees(),
            0.5, // [m]
            0.0, // [m]
        )?,
        air_density_kgpm3: air_density_kgpm3(
            weather.pressure_pa,
            weather.temperature_k,
            weather.relative_humidity,
        ),
        cn2: Cn2Profile::Constant(1e-14),
        backdrop: Backdrop::new(sky, sun_dir_enu).with_clouds(weather.cloud_cover, clouds),
        weather,
    })
}

/// Structures around the camera, and their tops: on the ground, antennas on whatever is highest.
fn clutter(
    city: &City,
    background: Background,
    r_camera_enu_m: DVec3,
    rng: &mut Stream,
) -> (Vec<MeshData>, Vec<DVec3>) {
    const STRUCTURES: usize = 16;
    let kinds = match background {
        Background::Forest => &[
            StructureKind::Mast,
            StructureKind::Pylon,
            StructureKind::Masthead,
            StructureKind::BareTree,
            StructureKind::Treeline,
        ][..],
        _ => &StructureKind::ALL,
    };
    let (mut meshes, mut tops) = (Vec::new(), Vec::new());
    for _ in 0..STRUCTURES {
        let kind = kinds[pick(kinds.len(), rng)];
        let apart_m = log_range([35.0, 400.0], rng) * DVec2::from_angle(rng.range(0.0, TAU));
        let at = r_camera_enu_m.truncate() + apart_m;
        let mut mesh = structure_mesh(kind, rng);
        let ground_m = city.dsm.terrain_m(at.x, at.y);
        let surface_m = city.dsm.surface_m(at.x, at.y);
        let foot_m = match kind {
            StructureKind::Antenna => surface_m,
            // No house stands on a crane.
            _ if surface_m > ground_m + 1.0 => continue,
            _ => ground_m,
        };
        let Some((low, high)) = mesh.bounds_m() else {
            continue;
        };
        mesh.origin_enu_m = at.extend(foot_m);
        tops.push(mesh.origin_enu_m + (0.5 * (low + high)).truncate().extend(high.z));
        meshes.push(mesh);
    }
    (meshes, tops)
}

/// A place for a camera: in the open, with nothing close above the line of its feet.
fn stand(city: &City, height_m: [f64; 2], rng: &mut Stream) -> DVec3 {
    let half_m = 0.45 * city.params.extent_m;
    let height_m = log_range(height_m, rng);
    let mut at = DVec3::ZERO;
    for _ in 0..500 {
        let (e, n) = (rng.range(-half_m, half_m), rng.range(-half_m, half_m));
        at = DVec3::new(e, n, city.dsm.terrain_m(e, n) + height_m);
        let free = (0..16).all(|i| {
            let around = 6.0 * DVec2::from_angle(TAU * f64::from(i) / 16.0);
            city.dsm.surface_m(e + around.x, n + around.y) < at.z - 1.0
        });
        if free && city.dsm.surface_m(e, n) < at.z - 1.0 {
            return at;
        }
    }
    at.z = city.dsm.surface_m(at.x, at.y) + 3.0;
    at
}
