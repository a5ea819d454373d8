//! From a scenario to an app, and from an app to a summary.

use crate::components::beam::{BeamState, Channel, FireCommand, LaserSource};
use crate::components::camera::{Frames, Readout, SensorCamera, Tier};
use crate::components::clock::SimClock;
use crate::components::environment::Environment;
use crate::components::record::{History, Recording, StateHash};
use crate::components::render::{LEAN_SHADER, LeanMaterial, LightUniform};
use crate::components::station::{Gyro, Misalignment, Mount, MountCommand};
use crate::components::track::{DetectionQueue, Tracker};
use crate::components::uav::{Air, Flight, Guidance, HeatedSkin, Uav, UavStatus};
use crate::inference::{DetectorError, OnnxDetector};
use crate::models::atmosphere::{air_density_kgpm3, extinction_per_m};
use crate::models::base_motion::BaseMotion;
use crate::models::beam::Laser;
use crate::models::camera::Pinhole;
use crate::models::city::City;
use crate::models::detection::TruthErrors;
use crate::models::geodesy::{Geodetic, SiteFrame};
use crate::models::gimbal::{AxisParams, GimbalParams, GimbalState};
use crate::models::kinematics::los_to_az_el;
use crate::models::mirror::{Mirror, MirrorParams};
use crate::models::multirotor::Airframe;
use crate::models::pid::PaperLaw;
use crate::models::pointing::TunedPointing;
use crate::models::rng::Stream;
use crate::models::search::{Sector, raster};
use crate::models::sensor::{Sensor, SensorParams, Transfer, auto_exposure};
use crate::models::sky::Sky;
use crate::models::sun::Sun;
use crate::models::thermal::Skin;
use crate::models::trajectory::{CompiledTrajectory, TrajectoryError};
use crate::models::turbulence::{
    GammaGamma, PaperIntensity, Path as AirPath, PathTurbulence, Scintillation, Wander,
};
use crate::models::uav::model;
use crate::models::uav_mesh::uav_mesh;
use crate::models::wind::{DrydenGust, MeanWind};
use crate::plugins::SimulationPlugins;
use crate::plugins::tick::Tick;
use crate::recording::{Meta, Recorder, RecordingError, SceneEntity, Shape};
use crate::scenario::{
    self, ControllerPreset, DetectorKind, Exposure, Focus, Images, IntensityModel, Loaded,
    Scenario, ScenarioError, SearchPattern,
};
use crate::systems::capture::{self, ImageScratch, SensorViews, Shape as UavShape};
use crate::systems::control::{Controller, PaperController, SearchScan};
use crate::systems::detect::Detector;
use crate::systems::engage::{Burst, Interlocks, KeepOut, Rules};
use crate::systems::mount::optics_of;
use crate::systems::render::{RenderError, Renderer, spawn_sensor_view};
use crate::systems::scene::{self, SceneContent, SceneHandles};
use crate::systems::track::{RangeFinder, TrackerParams};
use bevy::app::{Main, TaskPoolThreadAssignmentPolicy};
use bevy::log::{Level, LogPlugin};
use bevy::platform::cell::SyncCell;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::settings::{RenderCreation, WgpuSettings};
use bevy::shader::Shader;
use bevy::window::{ExitCondition, WindowPlugin};
use big_space::plugin::BigSpaceMinimalPlugins;
use glam::{DVec2, DVec3, Vec4};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Version of the program, as artefacts carry it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Why a run cannot be built or go on. Each prints as one line that names the mend.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The scenario file.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The city's parameters.
    #[error("{file}: city: {source}")]
    City {
        /// The scenario file.
        file: String,
        /// What is wrong.
        source: crate::models::city::CityError,
    },
    /// A flight plan.
    #[error("{file}: uavs[{index}].trajectory: {source}")]
    Trajectory {
        /// The scenario file.
        file: String,
        /// Index of the UAV.
        index: usize,
        /// What is wrong.
        source: TrajectoryError,
    },
    /// Another value of the scenario that a model does not take.
    #[error("{file}: {what}: {why}")]
    Value {
        /// The scenario file.
        file: String,
        /// The value's place.
        what: &'static str,
        /// What is wrong with it.
        why: String,
    },
    /// The detector.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The report.
    #[error(transparent)]
    Report(#[from] crate::report::ReportError),
    /// Rendering.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Image formation.
    #[error(transparent)]
    Sensor(#[from] crate::models::sensor::SensorError),
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Image(String),
    /// Without images the detector is blind.
    #[error(
        "detector.kind = \"onnx\" needs rendered images: run without --no-capture, or with \
         --set detector.kind=truth"
    )]
    NeedsImages,
    /// No graphics adapter.
    #[error(
        "no Vulkan adapter found: install a driver (on Debian and Ubuntu \
         `apt-get install mesa-vulkan-drivers` gives a software one), or run with --no-capture \
         --set detector.kind=truth"
    )]
    NoAdapter,
    /// No display to open a window on.
    #[error("no display: DISPLAY is not set; start it under a desktop, or with xvfb-run")]
    NoDisplay,
    /// The output folder.
    #[error("output folder {path}: {source}; name a folder that can be written with --out")]
    Output {
        /// The folder or file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A command-line argument.
    #[error("{argument}: {why}")]
    Argument {
        /// The argument.
        argument: &'static str,
        /// What is wrong with it.
        why: String,
    },
    /// A JSON file that was being written.
    #[error("cannot encode the summary: {0}")]
    Json(#[from] serde_json::Error),
}

/// The first error of a run; a tick in which one appears is the last.
#[derive(Resource, Default)]
pub struct Failure(Option<RunError>);

impl Failure {
    /// Keeps `error` unless one came before it.
    pub fn set(&mut self, error: impl Into<RunError>) {
        self.0.get_or_insert_with(|| error.into());
    }

    /// Takes the error, if there is one.
    pub fn take(&mut self) -> Option<RunError> {
        self.0.take()
    }
}

/// Wall-clock time by part. It is reported, and enters no state.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct Stopwatch {
    /// Rendering, readback and image formation.
    pub render: Duration,
    /// The detector.
    pub inference: Duration,
}

/// How a scenario is run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Seed instead of the scenario's.
    pub seed: Option<u64>,
    /// Worker threads; the machine's cores by default. It changes no result.
    pub threads: Option<usize>,
    /// Whether cameras render.
    pub capture: bool,
    /// Folder for recording, summary and report; none writes nothing.
    pub out: Option<PathBuf>,
    /// Whether the app gets a window.
    pub window: bool,
    /// Whether Bevy's warnings go to standard error; a process can start its log once only.
    pub log: bool,
    /// A city generated before, for runs without pictures; one with other parameters than the
    /// scenario's is not used.
    pub city: Option<Arc<City>>,
}

/// Where and when a run ends.
#[derive(Resource, Clone, Copy, Debug)]
pub struct Plan {
    /// Last tick.
    pub last_tick: u64,
    /// Tick at which every UAV had come to its end, if that has happened.
    pub settled: Option<u64>,
}

/// Simulated time that a run goes on after its last UAV has come down [s].
const AFTERMATH_S: f64 = 1.0;
/// Threads of the detector: fixed, since the order of its sums must not depend on the machine.
const INFERENCE_THREADS: usize = 2;
/// Mean reflectance of the ground for the light it throws back up.
const GROUND_ALBEDO: f64 = 0.18;
/// Wavelengths of the red, green and blue channel [m].
const CHANNELS_M: [f64; 3] = [610e-9, 550e-9, 465e-9];
/// Distance for which the cameras' turbulence blur is taken [m].
const BLUR_RANGE_M: f64 = 1_000.0;
/// Angle random walk of the base gyro, 0.01 deg/sqrt(h) [rad/sqrt(s)]: a small fibre gyro.
const GYRO_WALK: f64 = 0.01 * std::f64::consts::PI / 180.0 / 60.0;
/// What of Bevy's and wgpu's log is worth a user's eye; `RUST_LOG` overrides it.
const LOG_FILTER: &str = "wgpu=error,naga=warn,bevy_render=error,bevy_render::extract_resource=off,bevy_winit=error,winit=error,bevy_egui=error,bevy_render::renderer=error";

/// Whether a graphics adapter is there, and its name.
pub fn adapter() -> Result<wgpu::AdapterInfo, RunError> {
    let backends = wgpu::Backends::from_env().unwrap_or(wgpu::Backends::PRIMARY);
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    let instance = wgpu::Instance::new(descriptor);
    bevy::tasks::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
        .map(|adapter| adapter.get_info())
        .map_err(|_| RunError::NoAdapter)
}

/// Everything that can be checked of a scenario without running it: its values, flight plans,
/// city, weather and detector model.
pub fn check(loaded: &Loaded) -> Result<(), RunError> {
    let scenario = &loaded.scenario;
    let file = loaded.path.display().to_string();
    detector(scenario, scenario.seed)?;
    environment(scenario, &file, scenario.seed, None)?;
    for index in 0..scenario.uavs.len() {
        flight_plan(loaded, index)?;
    }
    Ok(())
}

/// The compiled trajectory of a UAV.
fn flight_plan(loaded: &Loaded, index: usize) -> Result<CompiledTrajectory, RunError> {
    let folder = loaded.path.parent().unwrap_or(Path::new("."));
    let load = |name: &str| std::fs::read_to_string(folder.join(name));
    loaded.scenario.uavs[index]
        .trajectory
        .compile(load)
        .map_err(|source| RunError::Trajectory {
            file: loaded.path.display().to_string(),
            index,
            source,
        })
}

/// Builds the app of a run, ready for its first tick.
pub fn build(loaded: &Loaded, options: &Options) -> Result<App, RunError> {
    let scenario = &loaded.scenario;
    let file = loaded.path.display().to_string();
    let seed = options.seed.unwrap_or(scenario.seed);
    let needs_images = scenario.detector.kind == DetectorKind::Onnx;
    if needs_images && !options.capture {
        return Err(RunError::NeedsImages);
    }
    let detector = detector(scenario, seed)?;
    if options.capture {
        adapter()?;
    }
    let clock = SimClock {
        tick: 0,
        tick_hz: scenario.tick_hz,
    };
    // Baked shadows depend on the sun, and only pictures show them.
    let city = options.city.clone().filter(|_| !options.capture);
    let environment = environment(scenario, &file, seed, city)?;

    let mut app = App::new();
    app.insert_resource(clock);
    add_bevy(&mut app, options);
    app.add_plugins(SimulationPlugins);
    if options.window {
        app.add_plugins(crate::plugins::view::ViewPlugin);
    }
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    let renderer = Renderer::take(&mut app);
    let world = app.world_mut();
    // Bevy's start-up systems run once, renderer or not.
    world.run_schedule(Main);
    if options.capture {
        spawn_scene(world, &environment, station_enu_m(scenario, &environment));
    }
    spawn_uavs(world, loaded, &environment)?;
    spawn_station(world, scenario, &file, &environment, clock)?;
    if options.capture {
        let mut renderer = renderer.ok_or(RunError::NoAdapter)?;
        capture::settle(world, &mut renderer);
        world.insert_non_send(renderer);
        world.insert_non_send(ImageScratch::default());
    }
    world.insert_resource(recording(loaded, options, seed, &environment)?);
    world.insert_resource(environment);
    world.insert_resource(detector);
    world.insert_resource(Plan {
        last_tick: clock.ticks_of(scenario.duration_s),
        settled: None,
    });
    world.init_resource::<Frames>();
    world.init_resource::<DetectionQueue>();
    world.init_resource::<Tracker>();
    world.init_resource::<Interlocks>();
    world.init_resource::<Burst>();
    world.init_resource::<StateHash>();
    world.init_resource::<History>();
    world.init_resource::<Failure>();
    world.init_resource::<Stopwatch>();
    world.insert_resource(RangeFinder(Stream::new(seed, 0, "range finder")));
    Ok(app)
}

/// Bevy itself: the same plugins for every run; without capture there is no renderer behind them.
fn add_bevy(app: &mut App, options: &Options) {
    let threads = options
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, std::num::NonZero::get));
    let mut pools = TaskPoolOptions::with_num_threads(threads);
    // Nothing in a run waits for files: one thread each is plenty for assets.
    let single = TaskPoolThreadAssignmentPolicy {
        min_threads: 1,
        max_threads: 1,
        percent: 0.0,
        on_thread_spawn: None,
        on_thread_destroy: None,
    };
    pools.io = single.clone();
    pools.async_compute = single;
    let backends = options
        .capture
        .then(|| wgpu::Backends::from_env().unwrap_or(wgpu::Backends::PRIMARY));
    let window = WindowPlugin {
        primary_window: options.window.then(|| Window {
            title: "Boresight".into(),
            resolution: (1280, 800).into(),
            present_mode: bevy::window::PresentMode::AutoNoVsync,
            ..default()
        }),
        exit_condition: if options.window {
            ExitCondition::OnPrimaryClosed
        } else {
            ExitCondition::DontExit
        },
        ..default()
    };
    let mut plugins = DefaultPlugins
        .build()
        .disable::<TransformPlugin>()
        .set(LogPlugin {
            filter: LOG_FILTER.into(),
            level: Level::WARN,
            ..default()
        })
        // It would take the render sub-app away to a thread of its own.
        .disable::<PipelinedRenderingPlugin>()
        .set(TaskPoolPlugin {
            task_pool_options: pools,
        })
        .set(window)
        .set(RenderPlugin {
            render_creation: RenderCreation::Automatic(Box::new(WgpuSettings {
                backends,
                ..default()
            })),
            // A pipeline that is still compiling would leave holes in the first frames.
            synchronous_pipeline_compilation: true,
            ..default()
        });
    if !options.log {
        plugins = plugins.disable::<LogPlugin>();
    }
    if !options.window {
        plugins = plugins.disable::<bevy::winit::WinitPlugin>();
    }
    app.add_plugins(plugins)
        .add_plugins(BigSpaceMinimalPlugins)
        .add_plugins(MaterialPlugin::<LeanMaterial>::default());
    let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
    // The handle is a constant of this crate, so it is always there to insert at.
    let _ = shaders.insert(
        &LEAN_SHADER,
        Shader::from_wgsl(include_str!("../assets/shaders/lean.wgsl"), "lean.wgsl"),
    );
}

fn detector(scenario: &Scenario, seed: u64) -> Result<Detector, RunError> {
    Ok(match scenario.detector.kind {
        DetectorKind::Onnx => Detector::Onnx {
            model: Box::new(OnnxDetector::load(
                &scenario.detector.onnx_model,
                INFERENCE_THREADS,
            )?),
            score_threshold: scenario.detector.score_threshold,
        },
        DetectorKind::Truth => {
            let errors = &scenario.detector.truth;
            Detector::Truth {
                errors: TruthErrors {
                    noise_px: errors.noise_px,
                    miss_rate: errors.miss_rate,
                    false_alarms_per_frame: errors.false_alarms_per_frame,
                },
                rng: Box::new(
                    Tier::ALL.map(|tier| Stream::new(seed, tier as u64, "truth detector")),
                ),
            }
        }
    })
}

fn environment(
    scenario: &Scenario,
    file: &str,
    seed: u64,
    city: Option<Arc<City>>,
) -> Result<Environment, RunError> {
    let value = |what, why: String| RunError::Value {
        file: file.into(),
        what,
        why,
    };
    let weather = scenario
        .weather
        .resolved()
        .map_err(|error| value("weather.metar", error.to_string()))?;
    let site = SiteFrame::new(Geodetic {
        latitude_rad: scenario.site.latitude_deg.to_radians(),
        longitude_rad: scenario.site.longitude_deg.to_radians(),
        height_m: scenario.site.altitude_m,
    });
    let sun = Sun::new(
        &scenario.time_utc,
        site.origin(),
        weather.pressure_pa,
        weather.temperature_k,
    )
    .map_err(|error| value("time_utc", error.to_string()))?;
    let sun_dir_enu = sun.sun_dir_enu();
    let city = match city.filter(|city| city.params == scenario.city) {
        Some(city) => city,
        None => {
            let mut city = City::generate(&scenario.city).map_err(|source| RunError::City {
                file: file.into(),
                source,
            })?;
            city.bake_shadows(sun_dir_enu);
            Arc::new(city)
        }
    };
    let mean_height_m = city.buildings.iter().map(|b| b.height_m()).sum::<f64>()
        / (city.buildings.len().max(1)) as f64;
    let day = sun_dir_enu.z > 0.0;
    // Roughness and displacement of a city: a tenth and 0.7 of the building height (Grimmond and
    // Oke, 1999), the displacement counted from the roofs that UAVs fly above.
    let mean_wind = MeanWind::new(
        weather.wind_speed_mps,
        weather.wind_from_rad.to_degrees(),
        (0.1 * mean_height_m).clamp(0.03, 2.0),
        0.7 * mean_height_m,
    )
    .map_err(|error| value("weather", error.to_string()))?;
    Ok(Environment {
        air_density_kgpm3: air_density_kgpm3(
            weather.pressure_pa,
            weather.temperature_k,
            weather.relative_humidity,
        ),
        cn2: scenario.turbulence.cn2_profile(mean_height_m, day),
        sky: Sky::new(
            sun_dir_enu,
            weather.visibility_m,
            weather.cloud_cover,
            GROUND_ALBEDO,
        ),
        site,
        city,
        weather,
        mean_wind,
        sun_dir_enu,
        seed,
    })
}

fn station_enu_m(scenario: &Scenario, environment: &Environment) -> DVec3 {
    scenario
        .station
        .position_enu_m
        .map_or_else(|| environment.city.station_enu_m(), DVec3::from_array)
}

fn spawn_scene(world: &mut World, environment: &Environment, r_station_enu_m: DVec3) {
    let rgb = |[r, g, b]: [f64; 3]| Vec4::new(r as f32, g as f32, b as f32, 0.0);
    let sky = &environment.sky;
    let extinction = CHANNELS_M.map(|m| extinction_per_m(environment.weather.visibility_m, m));
    scene::spawn(
        world,
        &SceneContent {
            r_site_ecef_m: environment.site.origin().to_ecef(),
            q_ecef_enu: environment.site.q_ecef_enu(),
            r_station_enu_m,
            tiles: &environment.city.chunks(),
            ground: &environment.city.ground_map,
            sky,
            sun_dir_enu: environment.sun_dir_enu,
            light: LightUniform {
                sun_klx: rgb(sky.sun_illuminance()),
                ambient_sky_klx: rgb(sky.ambient_down()),
                ambient_ground_klx: rgb(sky.ambient_up()),
                extinction_per_m: rgb(extinction),
                // A lit window seen from outside: some 80 cd/m^2.
                night: Vec4::new(0.08, 0.0, 0.0, 0.0),
                ..default()
            },
        },
    );
}

fn spawn_uavs(
    world: &mut World,
    loaded: &Loaded,
    environment: &Environment,
) -> Result<(), RunError> {
    for (index, uav) in loaded.scenario.uavs.iter().enumerate() {
        let plan = flight_plan(loaded, index)?;
        let catalogue = model(uav.model);
        let airframe = Airframe::new(catalogue);
        let mut rng = Stream::new(environment.seed, index as u64, "gusts");
        let gusts = DrydenGust::new(&environment.mean_wind, &mut rng);
        let r = plan.sample(0.0).r_enu_m;
        let ground_m = environment.city.dsm.terrain_m(r.x, r.y);
        let wind_enu_mps = environment.mean_wind.mean_wind_enu_mps(r.z - ground_m);
        let state = plan.initial_state(&airframe, wind_enu_mps, environment.air_density_kgpm3);
        let material = uav.skin.map_or(catalogue.skin, scenario::Skin::material);
        let mesh = Arc::new(uav_mesh(uav.model));
        let shape = UavShape::new(mesh.clone());
        if world.contains_resource::<SceneHandles>() {
            capture::spawn_uav(world, index, &mesh, (state.r_enu_m, state.q_enu_body));
        }
        world.spawn((
            Uav {
                index,
                name: uav.name.clone(),
                kind: uav.model,
            },
            Flight {
                airframe,
                state,
                aim_body_m: shape.centroid_body_m(),
            },
            Guidance(plan),
            Air {
                gusts,
                rng,
                wind_enu_mps,
            },
            HeatedSkin {
                skin: Skin {
                    temperature_k: environment.weather.temperature_k,
                    // The shell's chord in the stream is about the airframe's height.
                    length_m: catalogue.size_m[2],
                },
                material,
                irradiance_wpm2: 0.0,
            },
            UavStatus::Flying,
            shape,
        ));
    }
    Ok(())
}

fn gimbal_params(mount: &scenario::Mount) -> GimbalParams {
    let default = GimbalParams::default();
    let axis = |axis: AxisParams, travel_deg: Option<[f64; 2]>| AxisParams {
        torque_limit_nm: axis.inertia_kg_m2 * mount.max_acceleration_degps2.to_radians(),
        rate_limit_radps: mount.max_rate_degps.to_radians(),
        travel_rad: travel_deg.map(|limits| limits.map(f64::to_radians)),
        ..axis
    };
    GimbalParams {
        azimuth: axis(default.azimuth, mount.azimuth_limits_deg),
        elevation: axis(default.elevation, Some(mount.elevation_limits_deg)),
    }
}

/// Where the search camera looks: the sector, or the part of it that a cue points at.
fn search_scan(
    scenario: &Scenario,
    environment: &Environment,
    r_station_enu_m: DVec3,
    first_uav_enu_m: Option<DVec3>,
    search: &Pinhole,
) -> SearchScan {
    let sector = &scenario.search;
    let mut area = Sector {
        centre_azimuth_rad: sector.centre_azimuth_deg.to_radians(),
        centre_elevation_rad: sector.elevation_deg.to_radians(),
        width_rad: sector.width_deg.to_radians(),
        height_rad: sector.height_deg.to_radians(),
    };
    if let (Some(cue), Some(r_uav_enu_m)) = (&sector.cue, first_uav_enu_m) {
        let sigma_rad = cue.sigma_deg.to_radians();
        let mut rng = Stream::new(environment.seed, 0, "radar cue");
        let error = sigma_rad * DVec2::new(rng.normal(), rng.normal());
        let at = los_to_az_el(r_uav_enu_m - r_station_enu_m) + error;
        // Two deviations to either side hold the target nine times in ten.
        area = Sector {
            centre_azimuth_rad: at.x,
            centre_elevation_rad: at.y,
            width_rad: 4.0 * sigma_rad + search.hfov_rad(),
            height_rad: 4.0 * sigma_rad,
        };
    }
    let gazes_rad = match sector.pattern {
        SearchPattern::Raster => raster(&area, [search.hfov_rad(), search.vfov_rad()], 0.1),
        SearchPattern::Stare => vec![[area.centre_azimuth_rad, area.centre_elevation_rad]],
    };
    SearchScan {
        gazes_rad,
        index: 0,
        settled_since: None,
    }
}

/// Lens and sensor of a scenario's camera in the light and air of the run.
fn sensor_params(
    camera: &scenario::Camera,
    environment: &Environment,
    r_station_enu_m: DVec3,
) -> SensorParams {
    const WAVELENGTH_M: f64 = 550e-9;
    let pixel_pitch_m = camera.pixel_pitch_um * 1e-6;
    let ground_m = environment
        .city
        .dsm
        .terrain_m(r_station_enu_m.x, r_station_enu_m.y);
    let height_m = (r_station_enu_m.z - ground_m).max(1.0);
    let path = AirPath {
        length_m: BLUR_RANGE_M,
        h0_m: height_m,
        h1_m: height_m,
    };
    let fried_m = PathTurbulence::new(&environment.cn2, &path, WAVELENGTH_M).fried_spherical_m;
    // Standard deviations of the Gaussians that fit the cores of the Airy pattern (0.42 lambda N)
    // and of the long-exposure seeing disc (FWHM 0.98 lambda / r0, over 2.355).
    let diffraction_px = 0.42 * WAVELENGTH_M * camera.f_number / pixel_pitch_m;
    let seeing_px = 0.98 * WAVELENGTH_M / fried_m / 2.355 * camera.focal_length_m() / pixel_pitch_m;
    let blur = camera.optics_blur_px.hypot(diffraction_px).hypot(seeing_px);
    let mut params = SensorParams {
        f_number: camera.f_number,
        exposure_s: 1e-3,
        pixel_pitch_m,
        transmission: 0.8,
        quantum_efficiency: 0.6,
        full_well_e: camera.full_well_e,
        read_noise_e: camera.read_noise_e,
        gain_e_per_dn: None,
        blur_sigma_px: blur.min(16.0),
        transfer: Transfer::Srgb,
    };
    params.exposure_s = match camera.exposure_s {
        Exposure::Seconds(exposure_s) => exposure_s,
        Exposure::Auto(_) => auto_exposure(
            environment.sky.global_illuminance_klx(),
            &params,
            0.5 / f64::from(camera.rate_hz),
        ),
    };
    params
}

fn spawn_station(
    world: &mut World,
    scenario: &Scenario,
    file: &str,
    environment: &Environment,
    clock: SimClock,
) -> Result<(), RunError> {
    let value = |what, why: String| RunError::Value {
        file: file.into(),
        what,
        why,
    };
    let dt_s = clock.dt_s();
    let seed = environment.seed;
    let r_station_enu_m = station_enu_m(scenario, environment);
    let cameras = scenario.station.cameras.resolved();
    let mut first = world.query::<(&Uav, &Flight)>();
    let first_uav_enu_m = first
        .iter(world)
        .find(|(uav, _)| uav.index == 0)
        .map(|(_, flight)| flight.state.r_enu_m);
    let mut scan = None;
    for (tier, camera) in Tier::ALL.into_iter().zip(&cameras) {
        let pinhole = Pinhole::from_hfov(
            camera.width_px,
            camera.height_px,
            camera.hfov_deg.to_radians(),
        )
        .map_err(|error| value("station.cameras", error.to_string()))?;
        let params = sensor_params(camera, environment, r_station_enu_m);
        let latency_s =
            0.5 * params.exposure_s + camera.readout_latency_s + camera.inference_latency_s;
        let windowed = camera.readout == scenario::Readout::Window;
        let sensor_px = [camera.width_px, camera.height_px];
        let sensor = SensorCamera {
            tier,
            pinhole,
            period_ticks: u64::from(clock.tick_hz / camera.rate_hz),
            latency_ticks: clock.ticks_of(latency_s),
            sensor: Sensor::new(&params)?,
            window_px: windowed.then_some(camera.window_px),
            antialias: camera.antialias,
        };
        if tier == Tier::Search {
            let search = search_scan(
                scenario,
                environment,
                r_station_enu_m,
                first_uav_enu_m,
                &pinhole,
            );
            scan = Some(search);
        }
        let views = world
            .get_resource::<SceneHandles>()
            .map(|handles| handles.site_grid)
            .map(|site_grid| {
                let mut view = |size_px: [u32; 2]| {
                    spawn_sensor_view(world, site_grid, size_px, camera.antialias)
                };
                let full = view(sensor_px);
                let window = sensor
                    .window_px
                    .map(|side| view([side.min(sensor_px[0]), side.min(sensor_px[1])]));
                let magnifier = view([capture::MAGNIFY * capture::PATCH_PX; 2]);
                SensorViews {
                    full,
                    window,
                    magnifier,
                }
            });
        let entity = world.spawn((sensor, Readout::Off)).id();
        if let Some(views) = views {
            world.entity_mut(entity).insert(views);
        }
    }
    let scan = scan.ok_or_else(|| value("station.cameras", "no search camera".into()))?;
    let params = gimbal_params(&scenario.station.mount);
    params
        .validate()
        .map_err(|error| value("station.mount", error.to_string()))?;
    let mirror_params = MirrorParams {
        stroke_rad: scenario.station.mount.mirror_range_mrad * 1e-3,
        ..default()
    };
    let mirror = Mirror::new(&mirror_params, dt_s)
        .map_err(|error| value("station.mount", error.to_string()))?;
    let mut rng = Stream::new(seed, 0, "base motion");
    let mut base = BaseMotion::new(&scenario.station.mount.base_motion.params(), dt_s)
        .map_err(|error| value("station.mount.base_motion", error.to_string()))?;
    base.step(&mut rng);
    let mount = Mount {
        r_enu_m: r_station_enu_m,
        // The mount waits at the first gaze.
        gimbal: GimbalState::at_rest(scan.gazes_rad[0].into()),
        params,
        mirror_params,
        mirror,
        base,
        rng,
        base_rate_radps: [0.0; 2],
        gyro: Gyro {
            angle_random_walk: GYRO_WALK,
            rng: Stream::new(seed, 0, "gyro"),
            rate_enu_radps: DVec3::ZERO,
            tilt_enu_rad: base.tilt_rad(),
        },
    };
    let misalignment = Misalignment::default();
    let optics = optics_of(&mount, &misalignment);
    world.spawn((
        mount,
        MountCommand::default(),
        misalignment,
        optics,
        laser(scenario, environment),
        FireCommand::default(),
        BeamState::default(),
    ));
    world.insert_resource(scan);
    world.insert_resource(controller(scenario, &mirror_params, dt_s));
    let engage = &scenario.engage;
    world.insert_resource(TrackerParams {
        paper: scenario.controller.preset == ControllerPreset::Paper,
        lock_radius_px: engage.lock_radius_px,
        lock_dwell_s: engage.lock_dwell_s,
        break_radius_px: engage.break_radius_px,
    });
    world.insert_resource(Rules {
        authorised: engage.authorised,
        keep_out: engage
            .keep_out
            .iter()
            .map(|zone| KeepOut {
                name: zone.name.clone(),
                azimuth_rad: zone.azimuth_deg.map(f64::to_radians),
                elevation_rad: zone.elevation_deg.map(f64::to_radians),
            })
            .collect(),
        allow_solid_backstop: engage
            .allow_backstop
            .iter()
            .any(|backstop| *backstop != scenario::Backstop::Sky),
        min_clear_range_m: engage.min_clear_range_m,
        max_burst_s: engage.max_burst_s,
        pause_s: 1.0, // [s]
    });
    Ok(())
}

fn laser(scenario: &Scenario, environment: &Environment) -> LaserSource {
    let laser = &scenario.station.laser;
    let seed = environment.seed;
    let wavelength_m = laser.wavelength_nm * 1e-9;
    let mut rng = ["scintillation", "beam wander", "beam jitter"]
        .map(|purpose| Stream::new(seed, 0, purpose));
    // Both are retuned to the path when the first target is aimed at.
    let calm = GammaGamma::new(1e-3, 0.0);
    LaserSource {
        laser: Laser {
            power_w: laser.power_w,
            wavelength_m,
            aperture_radius_m: laser.aperture_radius_m,
            m2: laser.m2,
        },
        focus_m: match laser.focus {
            Focus::Metres(range_m) => Some(range_m),
            Focus::Target(_) => None,
        },
        jitter_rad: laser.jitter_urad * 1e-6,
        extinction_per_m: extinction_per_m(environment.weather.visibility_m, wavelength_m),
        channel: match scenario.turbulence.intensity {
            IntensityModel::Physical => {
                Channel::Physical(Box::new(Scintillation::new(calm, 1e-3, &mut rng[0])))
            }
            // The paper prints neither figure: no drift, a tenth a second of volatility.
            IntensityModel::Paper => Channel::Paper(PaperIntensity::new(0.0, 0.1)),
        },
        wander: Wander::new(0.0, 1e-2, &mut rng[1]),
        rng,
        path: None,
    }
}

fn controller(scenario: &Scenario, mirror: &MirrorParams, dt_s: f64) -> Controller {
    match scenario.controller.preset {
        ControllerPreset::Tuned => Controller::Tuned(TunedPointing::recommended(mirror, dt_s)),
        ControllerPreset::Paper => {
            let law = |printed: PaperLaw, gains: Option<scenario::Gains>| match gains {
                Some(gains) => PaperLaw {
                    kp: gains.kp,
                    ki_per_s: gains.ki_per_s,
                    kd_s: gains.kd_s,
                    ..printed
                },
                None => printed,
            };
            Controller::Paper(Box::new(PaperController::new(
                law(PaperLaw::COARSE, scenario.controller.coarse),
                law(PaperLaw::PRECISE, scenario.controller.precise),
            )))
        }
    }
}

/// Creates the output folder and the recording in it.
fn recording(
    loaded: &Loaded,
    options: &Options,
    seed: u64,
    environment: &Environment,
) -> Result<Recording, RunError> {
    let scenario = &loaded.scenario;
    let record = &scenario.record;
    let mut recording = Recording {
        recorder: None,
        state_period_ticks: u64::from(scenario.tick_hz / record.state_hz),
        image_every: match record.images {
            Images::All => 1,
            Images::None => 0,
            Images::Every(every) => u64::from(every),
        },
        jpeg_quality: record.jpeg_quality,
        images_seen: [0; 3],
        changes_logged: 0,
    };
    let (Some(out), Some(tick_hz)) = (&options.out, NonZeroU32::new(scenario.tick_hz)) else {
        return Ok(recording);
    };
    std::fs::create_dir_all(out).map_err(|source| RunError::Output {
        path: out.clone(),
        source,
    })?;
    let epoch = scenario.time_utc.timestamp_nanos_opt().unwrap_or(0);
    let mut recorder = Recorder::create(
        &out.join("run.mcap"),
        &Meta {
            scenario_name: &scenario.name,
            scenario_toml: &loaded.source,
            overrides: &loaded.overrides,
            seed,
            version: VERSION,
            epoch_unix_ns: u64::try_from(epoch).unwrap_or(0),
            tick_hz,
        },
    )?;
    let site = &scenario.site;
    recorder.location_fix(
        0,
        "enu",
        site.latitude_deg,
        site.longitude_deg,
        site.altitude_m,
    )?;
    let boxes: Vec<Shape> = environment
        .city
        .buildings
        .iter()
        .map(|building| {
            let outline = building.footprint_enu_m();
            let low = outline.iter().copied().fold(DVec2::MAX, DVec2::min);
            let high = outline.iter().copied().fold(DVec2::MIN, DVec2::max);
            let centre = 0.5 * (low + high);
            let base_m = environment.city.dsm.terrain_m(centre.x, centre.y);
            let height_m = building.height_m();
            Shape::Cube {
                centre_m: [centre.x, centre.y, base_m + 0.5 * height_m],
                rotation: [0.0, 0.0, 0.0, 1.0],
                size_m: [high.x - low.x, high.y - low.y, height_m],
                colour: [0.7, 0.7, 0.68, 1.0],
            }
        })
        .collect();
    let city = SceneEntity {
        id: "city",
        frame: "enu",
        lifetime_ticks: 0,
        shapes: &boxes,
    };
    recorder.scene_update(0, &[city])?;
    recording.recorder = Some(SyncCell::new(recorder));
    Ok(recording)
}

/// Runs one tick; true when the run is over.
pub fn step(world: &mut World) -> Result<bool, RunError> {
    world.run_schedule(Tick);
    if let Some(error) = world.resource_mut::<Failure>().take() {
        return Err(error);
    }
    let clock = *world.resource::<SimClock>();
    let mut statuses = world.query::<&UavStatus>();
    let ended = statuses.iter(world).len() > 0
        && statuses
            .iter(world)
            .all(|status| matches!(status, UavStatus::Down | UavStatus::Crashed));
    let mut plan = world.resource_mut::<Plan>();
    if ended && plan.settled.is_none() {
        plan.settled = Some(clock.tick);
    }
    let aftermath = clock.ticks_of(AFTERMATH_S);
    Ok(clock.tick >= plan.last_tick
        || plan
            .settled
            .is_some_and(|since| clock.tick >= since + aftermath))
}
