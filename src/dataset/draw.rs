//! What every scene and still of a set holds, drawn from its seed.

use super::recipe::Recipe;
use super::stage::{Placed, Prop};
use crate::app::{self, RunError};
use crate::components::environment::Environment;
use crate::models::air::atmosphere::{Cn2Profile, air_density_kgpm3};
use crate::models::air::sky::Sky;
use crate::models::air::weather::Weather;
use crate::models::air::wind::MeanWind;
use crate::models::flight::distractor::{DistractorKind, GLIDE_RAD, tumbling_attitude, wing_rad};
use crate::models::flight::multirotor::MAX_ROTORS;
use crate::models::flight::uav::{UavClass, UavKind, model};
use crate::models::ground::city::{City, CityParams};
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use crate::models::maths::kinematics::{
    Pose, az_el_to_los, boresight_chain, los_to_az_el, wrap_pi,
};
use crate::models::maths::rng::Stream;
use crate::models::optics::camera::{Pinhole, PixelRect};
use crate::models::optics::raster;
use crate::models::optics::sensor::{SensorParams, Transfer};
use crate::models::shape::clutter::{ClutterKind, clutter_mesh};
use crate::models::shape::mesh::MeshData;
use crate::models::shape::uav_mesh::{UavMesh, UavStyle, drawn_distractor_mesh, styled_uav_mesh};
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::sync::Arc;

/// What stands behind the targets of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Background {
    /// Nothing but sky in the whole picture.
    Sky,
    /// Trees and fields, or their skyline.
    Forest,
    /// Buildings, or their skyline.
    Urban,
}

/// How the UAVs of a still fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Level, tilted by a few degrees.
    Level,
    /// Tilted hard to any side.
    Manoeuvre,
    /// Pitched up or down.
    ClimbDive,
}

/// Which part of the set a scene belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Training.
    Train,
    /// Validation.
    Val,
}

impl Split {
    /// The folder's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
        }
    }
}

/// `count` picks in the proportions of `shares`, met as exactly as whole numbers allow and
/// shuffled.
pub fn quota(count: u32, shares: &[f64], rng: &mut Stream) -> Vec<usize> {
    let total: f64 = shares.iter().sum();
    let mut picks = Vec::with_capacity(count as usize);
    let mut sum = 0.0;
    for (i, share) in shares.iter().enumerate() {
        sum += share;
        let until = (f64::from(count) * sum / total).round() as usize;
        picks.resize(until, i);
    }
    for i in (1..picks.len()).rev() {
        picks.swap(i, pick(i + 1, rng));
    }
    picks
}

/// A whole number below `count`.
fn pick(count: usize, rng: &mut Stream) -> usize {
    ((rng.uniform() * count as f64) as usize).min(count.saturating_sub(1))
}

/// The index of one of `shares`, in their proportions.
pub fn choose(shares: &[f64], rng: &mut Stream) -> usize {
    let mut rest = rng.uniform() * shares.iter().sum::<f64>();
    for (i, share) in shares.iter().enumerate() {
        rest -= share;
        if rest < 0.0 {
            return i;
        }
    }
    shares.len().saturating_sub(1)
}

fn log_range([from, to]: [f64; 2], rng: &mut Stream) -> f64 {
    rng.range(from.ln(), to.ln()).exp()
}

/// Background and split of every scene of a recipe, those with clips last.
pub fn plan(recipe: &Recipe) -> Vec<(Background, Split)> {
    let mut plan = assign(recipe, recipe.scenes, "dataset backgrounds");
    let clips = recipe.sequences.count;
    plan.extend(assign(recipe, clips, "dataset clips' backgrounds"));
    plan
}

fn assign(recipe: &Recipe, scenes: u32, purpose: &str) -> Vec<(Background, Split)> {
    let shares = &recipe.backgrounds;
    let mut rng = Stream::new(recipe.seed, 0, purpose);
    let kinds = [Background::Sky, Background::Forest, Background::Urban];
    let shares = [shares.sky, shares.forest, shares.urban];
    let backgrounds = quota(scenes, &shares, &mut rng);
    let mut splits = vec![Split::Train; backgrounds.len()];
    // Every background has its share of scenes to validate with; they are shuffled already.
    let mut owed = 0.0;
    for kind in 0..kinds.len() {
        for (scene, _) in (backgrounds.iter().enumerate()).filter(|(_, found)| **found == kind) {
            owed += recipe.val_share;
            if owed >= 0.5 {
                splits[scene] = Split::Val;
                owed -= 1.0;
            }
        }
    }
    let named = backgrounds.into_iter().map(|kind| kinds[kind]);
    named.zip(splits).collect()
}

/// A place, a time, a weather and a camera.
pub struct Scene {
    /// Its number.
    pub index: u32,
    /// What stands behind its targets.
    pub background: Background,
    /// City, sky and air.
    pub environment: Environment,
    /// Where the camera stands [m].
    pub r_camera_enu_m: DVec3,
    /// The camera.
    pub pinhole: Pinhole,
    /// Its sensor; the exposure is set for every still.
    pub sensor: SensorParams,
    /// Longest exposure [s].
    pub max_exposure_s: f64,
    /// Error of the automatic exposure [stops].
    pub exposure_error_stops: f64,
    /// Whether the exposure follows the picture, or the light.
    pub metered: bool,
    /// What may appear.
    pub props: Vec<Prop>,
    /// The UAVs among them, which come first.
    pub uavs: Vec<UavKind>,
    /// Cranes, masts and the like, about the origin.
    pub clutter: Vec<MeshData>,
    /// The seed of its clouds; none: their mean light only.
    pub clouds: Option<u64>,
    /// Where their tops are [m].
    tops_enu_m: Vec<DVec3>,
}

impl Scene {
    /// Draws scene `index` of a recipe and generates its surroundings.
    pub fn draw(recipe: &Recipe, index: u32, background: Background) -> Result<Self, RunError> {
        let stream = |purpose| Stream::new(recipe.seed, u64::from(index), purpose);
        let mut rng = stream("dataset light");
        let light = &recipe.light;
        let elevation_deg = match choose(&[light.day, light.low_sun, light.dusk], &mut rng) {
            0 => rng.range(15.0, 60.0),
            1 => rng.range(2.0, 15.0),
            _ => rng.range(-6.0, 2.0),
        };
        let sun_dir_enu = az_el_to_los(DVec2::new(
            rng.range(0.0, TAU),
            f64::to_radians(elevation_deg),
        ));
        let cloud_cover = match choose(&[0.4, 0.3, 0.3], &mut rng) {
            0 => rng.range(0.0, 0.2),
            1 => rng.range(0.2, 0.85),
            _ => rng.range(0.9, 1.0),
        };
        let weather = Weather {
            wind_speed_mps: 3.0, // [m/s]
            wind_from_rad: 0.0,
            gust_mps: None,
            visibility_m: log_range(light.visibility_m, &mut rng),
            temperature_k: 288.15,  // [K]
            relative_humidity: 0.5, // [-]
            pressure_pa: 101_325.0, // [Pa]
            cloud_cover,
            cloud_base_m: None,
            precipitation_mmph: 0.0, // [mm/h]
            snow: false,
        };

        let mut rng = stream("dataset city");
        let [least, most] = recipe.city.extent_m;
        let standard = CityParams {
            extent_m: rng.range(least, most),
            seed: rng.bits(),
            relief_m: rng.range(0.0, 25.0),
            river: rng.uniform() < 0.4,
            max_height_m: rng.range(40.0, 140.0),
            ..CityParams::default()
        };
        let params = match background {
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
        };
        let mut city = City::generate(&params).map_err(|source| RunError::City {
            file: format!("scene {index}"),
            source,
        })?;
        city.bake_shadows(sun_dir_enu);

        let mut rng = stream("dataset camera");
        let camera = &recipe.camera;
        let [width_px, height_px] = camera.sizes_px[pick(camera.sizes_px.len(), &mut rng)];
        let hfov_deg = match background {
            Background::Sky => camera.hfov_deg,
            _ => [camera.ground_hfov_deg, camera.hfov_deg[1]],
        };
        let hfov_rad = log_range(hfov_deg, &mut rng).to_radians();
        let value = |why: String| RunError::Value {
            file: format!("scene {index}"),
            what: "camera",
            why,
        };
        let pinhole = Pinhole::from_hfov(width_px, height_px, hfov_rad)
            .map_err(|error| value(error.to_string()))?;
        let r_camera_enu_m = stand(&city, camera.height_m, &mut rng);
        let sensor = SensorParams {
            f_number: 4.0,
            exposure_s: 1e-3,
            pixel_pitch_m: 5e-6,
            transmission: 0.8,
            quantum_efficiency: 0.6,
            full_well_e: log_range([4_000.0, 25_000.0], &mut rng),
            read_noise_e: log_range([2.0, 12.0], &mut rng),
            gain_e_per_dn: None,
            blur_sigma_px: rng.range(camera.blur_px[0], camera.blur_px[1]),
            transfer: Transfer::Srgb,
        };
        let error = camera.exposure_error_stops;
        let exposure_error_stops = rng.range(-error, error);
        let max_exposure_s = log_range([1.0 / 200.0, 1.0 / 50.0], &mut rng);
        let metered = rng.uniform() < 0.5;

        // As many looks of every class, so that the pictures of a scene differ in them.
        let uavs: Vec<UavKind> = (UavKind::ALL.into_iter())
            .flat_map(|kind| match model(kind).class {
                UavClass::Quadcopter => vec![kind; 2],
                _ => vec![kind; 4],
            })
            .collect();
        let mut rng = stream("dataset looks");
        let prop = |mesh: UavMesh, distractor| Prop {
            mesh: Arc::new(mesh),
            distractor,
        };
        let mut props: Vec<_> = (uavs.iter())
            .map(|kind| prop(styled_uav_mesh(*kind, &UavStyle::drawn(&mut rng)), None))
            .collect();
        let others = [
            (DistractorKind::Bird, 5),
            (DistractorKind::Aeroplane, 2),
            (DistractorKind::Balloon, 1),
            (DistractorKind::Leaf, 1),
        ];
        for kind in others.iter().flat_map(|(kind, count)| vec![*kind; *count]) {
            props.push(prop(drawn_distractor_mesh(kind, &mut rng), Some(kind)));
        }
        let mut rng = stream("dataset clouds");
        let clouds = (rng.uniform() < 0.8).then(|| rng.bits());
        let mut rng = stream("dataset clutter");
        let (clutter, tops_enu_m) = clutter(&city, background, r_camera_enu_m, &mut rng);
        let environment = Environment {
            site: SiteFrame::new(Geodetic {
                latitude_rad: 47.3769f64.to_radians(),
                longitude_rad: 8.5417f64.to_radians(),
                height_m: 455.0, // [m]
            }),
            city: Arc::new(city),
            mean_wind: MeanWind::new(weather.wind_speed_mps, 0.0, 0.5, 0.0)
                .map_err(|error| value(error.to_string()))?,
            air_density_kgpm3: air_density_kgpm3(
                weather.pressure_pa,
                weather.temperature_k,
                weather.relative_humidity,
            ),
            cn2: Cn2Profile::Constant(1e-14),
            sun_dir_enu,
            sky: Sky::new(
                sun_dir_enu,
                weather.visibility_m,
                weather.cloud_cover,
                app::GROUND_ALBEDO,
            ),
            weather,
            seed: recipe.seed,
        };
        Ok(Self {
            index,
            background,
            environment,
            r_camera_enu_m,
            pinhole,
            sensor,
            max_exposure_s,
            exposure_error_stops,
            metered,
            props,
            uavs,
            clutter,
            clouds,
            tops_enu_m,
        })
    }
}

/// Structures around the camera, and their tops: on the ground, antennas on whatever is highest.
fn clutter(
    city: &City,
    background: Background,
    r_camera_enu_m: DVec3,
    rng: &mut Stream,
) -> (Vec<MeshData>, Vec<DVec3>) {
    const STRUCTURES: usize = 12;
    let kinds = match background {
        Background::Forest => &[ClutterKind::Mast, ClutterKind::Pylon][..],
        _ => &ClutterKind::ALL,
    };
    let (mut meshes, mut tops) = (Vec::new(), Vec::new());
    for _ in 0..STRUCTURES {
        let kind = kinds[pick(kinds.len(), rng)];
        let apart_m = log_range([35.0, 400.0], rng) * DVec2::from_angle(rng.range(0.0, TAU));
        let at = r_camera_enu_m.truncate() + apart_m;
        let mut mesh = clutter_mesh(kind, rng);
        let ground_m = city.dsm.terrain_m(at.x, at.y);
        let surface_m = city.dsm.surface_m(at.x, at.y);
        let foot_m = match kind {
            ClutterKind::Antenna => surface_m,
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

/// What a still shows.
#[derive(Clone, Debug)]
pub struct Still {
    /// The camera's pose.
    pub pose: Pose,
    /// How the UAVs fly.
    pub motion: Motion,
    /// All that flies in it.
    pub placed: Vec<Placed>,
}

/// Tries to find a view before another size or place is drawn.
const VIEW_TRIES: usize = 60;

/// Draws one still; `None` if the scene has no room for what was drawn, and another draw may do.
pub fn still(
    recipe: &Recipe,
    scene: &Scene,
    count: usize,
    motion: Motion,
    rng: &mut Stream,
) -> Option<Still> {
    let size_px = DVec2::new(
        f64::from(scene.pinhole.width_px),
        f64::from(scene.pinhole.height_px),
    );
    let px = place_px(size_px, rng);
    let fate = match count {
        // Where a UAV would be.
        0 => {
            let range_m = log_range([30.0, 300.0], rng);
            let pose = view(scene, px, range_m, 10.0, rng)?;
            return Some(Still {
                pose,
                motion,
                placed: distractors(recipe, scene, &pose, rng),
            });
        }
        _ => target(recipe, scene, motion, rng)?,
    };
    let pose = view(scene, px, fate.range_m, fate.size_px, rng)?;
    let mut placed = vec![fate.at(&scene.pinhole, &pose, px)];
    let mut taken = vec![(px, fate.size_px)];
    if !clear(scene, &pose, &placed[0]) {
        return None;
    }
    for _ in 1..count {
        for _ in 0..10 {
            let px = place_px(size_px, rng);
            let Some(other) = target(recipe, scene, motion, rng) else {
                continue;
            };
            let apart = |(at, size): &(DVec2, f64)| at.distance(px) > size + other.size_px;
            let other_placed = other.at(&scene.pinhole, &pose, px);
            if placed.iter().all(|p| p.prop != other.prop)
                && taken.iter().all(apart)
                && clear(scene, &pose, &other_placed)
            {
                placed.push(other_placed);
                taken.push((px, other.size_px));
                break;
            }
        }
    }
    placed.extend(distractors(recipe, scene, &pose, rng));
    Some(Still {
        pose,
        motion,
        placed,
    })
}

/// A point of the picture, one in eight near its border.
fn place_px(size_px: DVec2, rng: &mut Stream) -> DVec2 {
    let mut at = DVec2::new(rng.uniform(), rng.uniform());
    if rng.uniform() < 0.125 {
        let axis = pick(2, rng);
        let depth = 0.03 * rng.uniform();
        at[axis] = if rng.uniform() < 0.5 {
            depth
        } else {
            1.0 - depth
        };
    }
    at * size_px
}

/// A UAV to be placed: which, how big, how it is turned.
struct Target {
    prop: usize,
    size_px: f64,
    range_m: f64,
    q_enu_body: DQuat,
    phase_rad: [f64; MAX_ROTORS],
}

impl Target {
    fn at(&self, pinhole: &Pinhole, pose: &Pose, px: DVec2) -> Placed {
        let r_enu_m = pose.r_enu_m + self.range_m * (pose.q_enu_cam * pinhole.ray(px));
        Placed {
            prop: self.prop,
            body: (r_enu_m, self.q_enu_body),
            phase_rad: self.phase_rad,
        }
    }
}

fn target(recipe: &Recipe, scene: &Scene, motion: Motion, rng: &mut Stream) -> Option<Target> {
    let targets = &recipe.targets;
    let shares = [targets.fpv, targets.quadcopter, targets.hexacopter];
    let classes = [UavClass::Fpv, UavClass::Quadcopter, UavClass::Hexacopter];
    let class = classes[choose(&shares, rng)];
    let of_class: Vec<usize> = (0..scene.uavs.len())
        .filter(|i| model(scene.uavs[*i]).class == class)
        .collect();
    let prop = of_class[pick(of_class.len(), rng)];
    let [least, most] = targets.size_px;
    let size_px = if rng.uniform() < targets.even_share {
        log_range(targets.size_px, rng)
    } else {
        // The mode of a log-normal distribution lies sigma^2 below its median.
        let mode = targets.mode_width_share * f64::from(scene.pinhole.width_px);
        let median = mode.ln() + targets.log_sigma.powi(2);
        (median + targets.log_sigma * rng.normal()).exp()
    };
    let q_enu_body = attitude(motion, rng);
    let mut phase_rad = [0.0; MAX_ROTORS];
    phase_rad.fill_with(|| rng.range(0.0, TAU));
    if !(least..=most).contains(&size_px) {
        return None;
    }
    let mut target = Target {
        prop,
        size_px,
        range_m: 0.0,
        q_enu_body,
        phase_rad,
    };
    target.range_m = range_for(scene, &target)?;
    let [nearest, farthest] = targets.range_m;
    let seen_m = 0.7 * scene.environment.weather.visibility_m;
    (nearest..=farthest.min(seen_m))
        .contains(&target.range_m)
        .then_some(target)
}

/// The range at which a UAV has the size wanted, seen level from the south [m].
fn range_for(scene: &Scene, target: &Target) -> Option<f64> {
    const SIDE_PX: u32 = 512;
    const LONG_PX: f64 = 100.0; // [px], as it is measured
    let pinhole = Pinhole {
        width_px: SIDE_PX,
        height_px: SIDE_PX,
        focal_px: 20_000.0,
    };
    let [length, width, _] = model(scene.uavs[target.prop]).size_m;
    let range_m = pinhole.focal_px * length.max(width) / LONG_PX;
    let zero = DVec3::ZERO;
    let pose = boresight_chain(zero, zero, 0.0, 0.0, DVec2::ZERO, zero);
    let masks = raster::fine_silhouette(
        &pinhole,
        &pose,
        (DVec3::Y * range_m, target.q_enu_body),
        &target.phase_rad,
        &scene.props[target.prop].mesh,
        PixelRect {
            offset_px: [0, 0],
            size_px: [SIDE_PX; 2],
        },
    );
    let [w, h] = masks.rect.size_px;
    let long_px = f64::from(w.max(h));
    Some(range_m * long_px / target.size_px * scene.pinhole.focal_px / pinhole.focal_px)
}

/// An attitude that fits a way to fly.
fn attitude(motion: Motion, rng: &mut Stream) -> DQuat {
    let yaw = DQuat::from_rotation_z(rng.range(0.0, TAU));
    let tilt = |rng: &mut Stream, most_deg: f64, least_deg: f64| {
        let axis = DVec2::from_angle(rng.range(0.0, TAU)).extend(0.0);
        let angle_rad = rng.range(least_deg, most_deg).to_radians();
        DQuat::from_axis_angle(axis, angle_rad)
    };
    match motion {
        Motion::Level => yaw * tilt(rng, 8.0, 0.0),
        Motion::Manoeuvre => yaw * tilt(rng, 60.0, 8.0),
        Motion::ClimbDive => {
            let nose_rad = rng.range(-35.0, 35.0).to_radians();
            yaw * DQuat::from_rotation_y(nose_rad) * tilt(rng, 8.0, 0.0)
        }
    }
}

/// Whether the camera's sight line to a prop is free.
fn clear(scene: &Scene, pose: &Pose, placed: &Placed) -> bool {
    scene.environment.line_of_sight(pose.r_enu_m, placed.body.0) == LineOfSight::Clear
}

/// The elevation above which nothing but sky is seen in a direction [rad].
fn skyline_rad(scene: &Scene, az_rad: f64) -> f64 {
    let dsm = &scene.environment.city.dsm;
    let (mut low, mut high) = (-0.5, 1.45); // [rad]
    for _ in 0..14 {
        let middle = 0.5 * (low + high);
        let dir = az_el_to_los(DVec2::new(az_rad, middle));
        match dsm.first_hit(scene.r_camera_enu_m, dir, 8_000.0) {
            Some(_) => low = middle,
            None => high = middle,
        }
    }
    high
}

/// Where a target stands against the line between ground and sky.
enum Place {
    /// Before the ground.
    Below,
    /// Close above the line.
    Above,
    /// In the sky, with the line in the picture.
    High,
}

/// The pose that shows a point at `range_m` in pixel `px` before the scene's background.
fn view(scene: &Scene, px: DVec2, range_m: f64, size_px: f64, rng: &mut Stream) -> Option<Pose> {
    let pinhole = &scene.pinhole;
    let dsm = &scene.environment.city.dsm;
    let roll_rad = rng.normal() * 1.5f64.to_radians();
    let place = match rng.uniform() {
        u if u < 0.5 => Place::Below,
        u if u < 0.75 => Place::Above,
        _ => Place::High,
    };
    let top = (rng.uniform() < 0.15 && !scene.tops_enu_m.is_empty())
        .then(|| scene.tops_enu_m[pick(scene.tops_enu_m.len(), rng)]);
    let size_rad = size_px / pinhole.focal_px;
    let (hfov_rad, vfov_rad) = (pinhole.hfov_rad(), pinhole.vfov_rad());
    for _ in 0..VIEW_TRIES {
        let az_rad = match top {
            Some(top) => {
                let at = los_to_az_el(top - scene.r_camera_enu_m);
                at.x + 0.4 * hfov_rad * rng.range(-1.0, 1.0)
            }
            None => rng.range(0.0, TAU),
        };
        let skyline = skyline_rad(scene, az_rad);
        let pose = match (scene.background, &place) {
            (Background::Sky, _) => {
                let sides = [-0.5, -0.25, 0.25, 0.5];
                let skyline = sides
                    .map(|side| skyline_rad(scene, az_rad + side * hfov_rad))
                    .into_iter()
                    .fold(skyline, f64::max);
                // Low over the roofs is where UAVs are looked for.
                let above_rad = -9f64.to_radians() * rng.uniform().max(1e-9).ln();
                let low_rad = skyline + 0.55 * vfov_rad;
                let el_rad = match top {
                    Some(top) => {
                        let at = los_to_az_el(top - scene.r_camera_enu_m);
                        low_rad.max(at.y + 0.4 * vfov_rad * rng.range(-1.0, 1.0))
                    }
                    None => low_rad + above_rad,
                };
                looking(scene, az_rad, el_rad, roll_rad)
            }
            (_, Place::Below) => {
                let depth_rad = (0.5 * vfov_rad).min(0.15);
                let el_rad = skyline - size_rad * 0.5 - depth_rad * rng.uniform().powi(2);
                shown_at(scene, az_rad, el_rad, roll_rad, px)
            }
            (_, Place::Above) => {
                let el_rad = skyline + size_rad * rng.range(0.5, 6.0);
                shown_at(scene, az_rad, el_rad, roll_rad, px)
            }
            (_, Place::High) => {
                // The line lies in the lower half of the picture.
                let el_rad = skyline + vfov_rad * rng.range(0.05, 0.45);
                looking(scene, az_rad, el_rad, roll_rad)
            }
        };
        let dir = pose.q_enu_cam * pinhole.ray(px);
        let hit = dsm.first_hit(scene.r_camera_enu_m, dir, 8_000.0);
        let below = scene.background != Background::Sky && matches!(place, Place::Below);
        let fits = match hit {
            None => !below,
            Some(hit_m) => below && hit_m > 1.02 * range_m + 1.0,
        };
        let up = (pose.q_enu_cam * DVec3::Z).z;
        if fits && up < 70f64.to_radians().sin() {
            return Some(pose);
        }
    }
    None
}

/// The pose with this boresight [rad].
pub fn looking(scene: &Scene, az_rad: f64, el_rad: f64, roll_rad: f64) -> Pose {
    boresight_chain(
        scene.r_camera_enu_m,
        DVec3::ZERO,
        az_rad,
        el_rad,
        DVec2::ZERO,
        DVec3::Z * roll_rad,
    )
}

/// The pose that shows a direction in pixel `px`.
fn shown_at(scene: &Scene, az_rad: f64, el_rad: f64, roll_rad: f64, px: DVec2) -> Pose {
    let gaze = gaze_at(scene, DVec2::new(az_rad, el_rad), roll_rad, px);
    looking(scene, gaze.x, gaze.y, roll_rad)
}

/// Azimuth and elevation of the boresight [rad] that show a direction `at` [rad] in pixel `px`.
pub fn gaze_at(scene: &Scene, at: DVec2, roll_rad: f64, px: DVec2) -> DVec2 {
    let mut gaze = at;
    for _ in 0..4 {
        let pose = looking(scene, gaze.x, gaze.y, roll_rad);
        let shown = los_to_az_el(pose.q_enu_cam * scene.pinhole.ray(px));
        gaze += DVec2::new(wrap_pi(at.x - shown.x), at.y - shown.y);
    }
    gaze
}

/// Birds and the like, anywhere in the picture.
fn distractors(recipe: &Recipe, scene: &Scene, pose: &Pose, rng: &mut Stream) -> Vec<Placed> {
    if rng.uniform() >= recipe.distractors.share {
        return Vec::new();
    }
    let pinhole = &scene.pinhole;
    let mut free: Vec<usize> = (scene.uavs.len()..scene.props.len()).collect();
    let mut placed = Vec::new();
    for _ in 0..1 + pick(4, rng) {
        let prop = free.swap_remove(pick(free.len(), rng));
        let Some(kind) = scene.props[prop].distractor else {
            continue;
        };
        let px = DVec2::new(
            rng.uniform() * f64::from(pinhole.width_px),
            rng.uniform() * f64::from(pinhole.height_px),
        );
        let reach_m = (scene.props[prop].mesh.outline_body_m().iter())
            .map(|p| p.length())
            .fold(0.0, f64::max);
        let size_px = log_range(recipe.distractors.size_px, rng);
        let range_m = (2.0 * pinhole.focal_px * reach_m / size_px).clamp(3.0, 15_000.0);
        let phase_rad = rng.range(0.0, TAU);
        let (q_enu_body, wing_rad) = match kind {
            DistractorKind::Leaf => (tumbling_attitude(rng.range(0.0, 10.0), phase_rad), 0.0),
            DistractorKind::Bird if rng.uniform() < 0.3 => {
                (attitude(Motion::Manoeuvre, rng), GLIDE_RAD)
            }
            DistractorKind::Bird => (attitude(Motion::ClimbDive, rng), wing_rad(phase_rad)),
            DistractorKind::Aeroplane | DistractorKind::Balloon => {
                (attitude(Motion::Level, rng), 0.0)
            }
        };
        let dir = pose.q_enu_cam * pinhole.ray(px);
        placed.push(Placed {
            prop,
            body: (pose.r_enu_m + range_m * dir, q_enu_body),
            phase_rad: [wing_rad; MAX_ROTORS],
        });
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotas_are_met_exactly_and_shuffled() {
        let mut rng = Stream::new(1, 0, "test");
        let picks = quota(200, &[0.45, 0.275, 0.275], &mut rng);
        let count = |kind| picks.iter().filter(|pick| **pick == kind).count();
        assert_eq!([count(0), count(1), count(2)], [90, 55, 55]);
        assert!(picks.windows(2).filter(|w| w[0] != w[1]).count() > 60);
        // Shares need not add up to 1, nor the count divide.
        let picks = quota(7, &[2.0, 1.0], &mut rng);
        assert_eq!(picks.iter().filter(|pick| **pick == 0).count(), 5);
        assert!(quota(0, &[1.0], &mut rng).is_empty());
    }

    #[test]
    fn every_background_has_its_share_to_validate_with() {
        let recipe = Recipe {
            scenes: 200,
            val_share: 0.25,
            ..Recipe::default()
        };
        let plan = plan(&recipe);
        assert_eq!(plan.len(), 200);
        for (kind, all) in [
            (Background::Sky, 90.0),
            (Background::Forest, 55.0),
            (Background::Urban, 55.0),
        ] {
            let val = plan.iter().filter(|s| **s == (kind, Split::Val)).count() as f64;
            assert!((val - 0.25 * all).abs() <= 1.0, "{kind:?}: {val}");
        }
        let none = Recipe {
            val_share: 0.0,
            ..recipe
        };
        assert!(
            super::plan(&none)
                .iter()
                .all(|(_, split)| *split == Split::Train)
        );
    }

    #[test]
    fn attitudes_fit_the_way_to_fly() {
        let mut rng = Stream::new(2, 0, "test");
        for (motion, least_deg, most_deg) in [
            (Motion::Level, 0.0, 8.0),
            (Motion::Manoeuvre, 8.0, 60.0),
            (Motion::ClimbDive, 0.0, 43.0),
        ] {
            for _ in 0..500 {
                let up = attitude(motion, &mut rng) * DVec3::Z;
                let tilt_deg = up.angle_between(DVec3::Z).to_degrees();
                assert!(
                    (least_deg - 1e-6..=most_deg + 1e-6).contains(&tilt_deg),
                    "{motion:?}: {tilt_deg}"
                );
            }
        }
    }

    #[test]
    fn a_uav_is_drawn_at_the_size_and_place_that_were_asked_for() {
        let recipe = Recipe::default();
        let scene = Scene::draw(&recipe, 3, Background::Sky).unwrap();
        let mut rng = Stream::new(3, 0, "test");
        let mut found = 0;
        for _ in 0..40 {
            let Some(target) = target(&recipe, &scene, Motion::Level, &mut rng) else {
                continue;
            };
            // Within the picture, away from its borders.
            let px = DVec2::new(0.4, 0.6)
                * DVec2::new(
                    f64::from(scene.pinhole.width_px),
                    f64::from(scene.pinhole.height_px),
                );
            let direction = DVec2::new(0.7, 0.2);
            let pose = shown_at(&scene, direction.x, direction.y, 0.03, px);
            let placed = target.at(&scene.pinhole, &pose, px);
            let r_cam_m = pose.q_enu_cam.inverse() * (placed.body.0 - pose.r_enu_m);
            assert!((scene.pinhole.project(r_cam_m).unwrap() - px).length() < 1e-6);
            let shown = los_to_az_el(placed.body.0 - pose.r_enu_m);
            assert!((shown - direction).length() < 1e-5, "{shown}");
            let masks = raster::fine_silhouette(
                &scene.pinhole,
                &pose,
                placed.body,
                &placed.phase_rad,
                &scene.props[placed.prop].mesh,
                PixelRect {
                    offset_px: [0, 0],
                    size_px: [scene.pinhole.width_px, scene.pinhole.height_px],
                },
            );
            let Some(seen) = super::super::label::label(&masks, |_, _| 1.0) else {
                continue;
            };
            let [x0, y0, x1, y1] = seen.box_px;
            let long_px = (x1 - x0).max(y1 - y0);
            // It is seen from another side than that it is measured from, and thin tips do not count.
            let ratio = long_px / target.size_px;
            assert!(
                (0.4..1.6).contains(&ratio),
                "{long_px} for {}",
                target.size_px
            );
            found += 1;
        }
        assert!(found > 10, "{found}");
    }
}
