//! From a scenario to an app, and from an app to a summary.

use crate::components::beam::{BeamState, Channel, Dose, FireCommand, LaserSource};
use crate::components::capture::{Frames, Readout, SensorCamera, Tier};
use crate::components::clock::SimClock;
use crate::components::environment::Environment;
use crate::components::flight::{Air, Distractor, Flight, Guidance, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Alignment, Gyro, Misalignment, Mount, MountCommand, StationWind};
use crate::components::record::{History, Recording, StateHash};
use crate::components::render::{LEAN_SHADER, LeanMaterial, LightUniform};
use crate::components::track::{DetectionQueue, Operator, Order, Tracker};
use crate::inference::{DetectorError, Inference, OnnxDetector, Setup};
use crate::models::air::atmosphere::{air_density_kgpm3, pressure_at_pa};
use crate::models::air::sky::Sky;
use crate::models::air::sun::Sun;
use crate::models::air::turbulence::{
    GammaGamma, PaperIntensity, Path as AirPath, PathTurbulence, Scintillation, Wander,
};
use crate::models::air::wind::{DrydenGust, MeanWind};
use crate::models::control::lqg::{LqgMemory, LqgPointing, LqgWeights};
use crate::models::control::paper::PaperLaw;
use crate::models::control::pointing::{HandOver, PointingLaw, TunedPointing};
use crate::models::flight::multirotor::{Airframe, MAX_ROTORS, MultirotorState};
use crate::models::flight::trajectory::{CompiledTrajectory, Trajectory, TrajectoryError};
use crate::models::flight::uav::model;
use crate::models::ground::city::City;
use crate::models::ground::geodesy::{Geodetic, SiteFrame};
use crate::models::laser::beam::Laser;
use crate::models::laser::thermal::Skin;
use crate::models::maths::rng::Stream;
use crate::models::mount::gimbal::{AxisParams, GimbalParams, GimbalState, Structure, WindLoad};
use crate::models::mount::mirror::{Mirror, MirrorParams};
use crate::models::optics::calibration;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::detection::TruthErrors;
use crate::models::optics::sensor::{Sensor, SensorParams, Transfer, auto_exposure};
use crate::models::shape::uav_mesh::{UavMesh, distractor_mesh, uav_mesh};
use crate::models::tracking::estimation::LosFilterParams;
use crate::models::tracking::radar::RadarErrors;
use crate::models::tracking::search::{SETTLE_S, Sector, SlewLimits, coverage_time_s};
use crate::plugins::SimulationPlugins;
use crate::plugins::clock::Tick;
use crate::recording::{LogLevel, Meta, Recorder, RecordingError, SceneEntity, SceneShape};
use crate::scenario::{
    self, AssociationRule, Backstop, ControllerPreset, DetectorKind, Exposure, Focus, Images,
    IntensityModel, Loaded, Scenario, ScenarioError,
};
use crate::systems::capture::{self, ImageScratch, SensorViews, Shape as UavShape};
use crate::systems::control::{Controller, PaperController, PointingController, Radar, SearchScan};
use crate::systems::detect::Detector;
use crate::systems::engage::{Burst, Interlocks, Rules};
use crate::systems::mount::optics_of;
use crate::systems::render::renderer::{RenderError, Renderer, spawn_sensor_view};
use crate::systems::render::scene::{self, SceneContent, SceneHandles};
use crate::systems::track::{RangeFinder, TrackerParams, patience_s};
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
use glam::{DQuat, DVec2, DVec3, Vec4};
use std::f64::consts::TAU;
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
        source: crate::models::ground::city::CityError,
    },
    /// A flight plan.
    #[error("{file}: {list}[{index}].trajectory: {source}")]
    Trajectory {
        /// The scenario file.
        file: String,
        /// The scenario's list that it stands in.
        list: &'static str,
        /// Index in that list.
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
    /// A set of annotated pictures that is being made.
    #[error(transparent)]
    Dataset(#[from] crate::dataset::DatasetError),
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
    Sensor(#[from] crate::models::optics::sensor::SensorError),
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Image(String),
    /// Without images the detector is blind.
    #[error(
        "detector.kind = \"onnx\" needs rendered images: run without --no-capture, or with \
         --set detector.kind=truth"
    )]
    NeedsImages,
    /// The detector's thread.
    #[error("cannot start the detector's thread: {0}")]
    Thread(std::io::Error),
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
    /// A file that a command leaves.
    #[error(transparent)]
    Written(#[from] crate::output::OutputError),
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
    /// Waiting for the detector, which works while the next frames are rendered.
    pub inference: Duration,
}

/// How a scenario is run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Seed instead of the scenario's.
    pub seed: Option<u64>,
    /// Worker threads; the machine's cores by default. It changes no result.
    pub threads: Option<usize>,
    /// Whether the detector works within the tick rather than on a thread of its own; it changes no
    /// result.
    pub one_thread: bool,
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
pub(crate) const GROUND_ALBEDO: f64 = 0.18;
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
    detector(scenario, scenario.seed, false)?;
    environment(scenario, &file, scenario.seed, None)?;
    for (index, uav) in scenario.uavs.iter().enumerate() {
        flight_plan(loaded, "uavs", index, &uav.trajectory)?;
    }
    for (index, distractor) in scenario.distractors.iter().enumerate() {
        flight_plan(loaded, "distractors", index, &distractor.trajectory)?;
    }
    Ok(())
}

/// The compiled trajectory of entry `index` of a list of the scenario.
fn flight_plan(
    loaded: &Loaded,
    list: &'static str,
    index: usize,
    trajectory: &Trajectory,
) -> Result<CompiledTrajectory, RunError> {
    let folder = loaded.path.parent().unwrap_or(Path::new("."));
    let load = |name: &str| std::fs::read_to_string(folder.join(name));
    trajectory
        .compile(load)
        .map_err(|source| RunError::Trajectory {
            file: loaded.path.display().to_string(),
            list,
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
    let detector = detector(scenario, seed, !options.one_thread)?;
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

    let (mut app, renderer) = bevy_app(options, |app| {
        app.insert_resource(clock);
        app.add_plugins(SimulationPlugins);
        if options.window {
            app.add_plugins(crate::plugins::view::ViewPlugin);
        }
    });
    let world = app.world_mut();
    if options.capture {
        spawn_scene(world, &environment, station_enu_m(scenario, &environment));
        if scenario.weather.cloud_texture {
            scene::set_clouds(world, environment.weather.cloud_cover, seed);
        }
    }
    spawn_uavs(world, loaded, &environment)?;
    spawn_distractors(world, loaded, &environment)?;
    spawn_station(world, scenario, &file, &environment, clock)?;
    if options.capture {
        let mut renderer = renderer.ok_or(RunError::NoAdapter)?;
        capture::settle(world, &mut renderer);
        world.insert_non_send(renderer);
        world.insert_non_send(ImageScratch::default());
    }
    let mut recording = recording(loaded, options, seed, &environment)?;
    if let Some(recorder) = &mut recording.recorder {
        let scan = world.resource::<SearchScan>();
        let mount = gimbal_params(&scenario.station.mount, clock.dt_s());
        let text = search_plan(scan, &mount);
        recorder.get().log(0, LogLevel::Info, "search", &text)?;
    }
    world.insert_resource(recording);
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

/// Bevy with the plugins that `more` adds, started up, and its renderer where there is one.
pub(crate) fn bevy_app(options: &Options, more: impl FnOnce(&mut App)) -> (App, Option<Renderer>) {
    let mut app = App::new();
    add_bevy(&mut app, options);
    more(&mut app);
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    let renderer = Renderer::take(&mut app);
    // Bevy's start-up systems run once, renderer or not.
    app.world_mut().run_schedule(Main);
    (app, renderer)
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

/// The detector of a scenario; a network works on a thread of its own if `threaded`.
fn detector(scenario: &Scenario, seed: u64, threaded: bool) -> Result<Detector, RunError> {
    let settings = &scenario.detector;
    Ok(match settings.kind {
        DetectorKind::Onnx => {
            let setup = Setup {
                threads: INFERENCE_THREADS,
                provider: settings.provider,
                named_in: "detector.onnx_model",
            };
            let model = OnnxDetector::load_with(&settings.onnx_model, &setup)?;
            for camera in &scenario.station.cameras.resolved() {
                model.input_px([camera.width_px, camera.height_px])?;
            }
            let recommended = model.score_threshold();
            let inference = if threaded {
                Inference::on_thread(model).map_err(RunError::Thread)?
            } else {
                Inference::on_caller(model)
            };
            Detector::Onnx {
                inference: Box::new(inference),
                score_threshold: settings.score_threshold.unwrap_or(recommended),
                roi_px: Some(settings.roi_px).filter(|side| *side > 0),
            }
        }
        DetectorKind::Truth => {
            let errors = &settings.truth;
            Detector::Truth {
                errors: TruthErrors {
                    noise_px: errors.noise_px,
                    miss_rate: errors.miss_rate,
                    distractor_rate: errors.distractor_rate,
                    false_alarms_per_frame: errors.false_alarms_per_frame,
                },
                seed,
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
    let pressure_pa = pressure_at_pa(weather.pressure_pa, scenario.site.altitude_m);
    let sun = Sun::new(
        &scenario.time_utc,
        site.origin(),
        pressure_pa,
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
    let roughness_m = (0.1 * mean_height_m).clamp(0.03, 2.0); // [m]
    let weather = scenario.weather.at_site(weather, roughness_m);
    let mean_wind = MeanWind::new(
        weather.wind_speed_mps,
        weather.wind_from_rad.to_degrees(),
        roughness_m,
        0.7 * mean_height_m,
    )
    .map_err(|error| value("weather", error.to_string()))?;
    Ok(Environment {
        air_density_kgpm3: air_density_kgpm3(
            pressure_pa,
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

pub(crate) fn spawn_scene(world: &mut World, environment: &Environment, r_station_enu_m: DVec3) {
    let rgb = |[r, g, b]: [f64; 3]| Vec4::new(r as f32, g as f32, b as f32, 0.0);
    let sky = &environment.sky;
    let extinction = CHANNELS_M.map(|m| environment.weather.extinction_per_m(m));
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
        let mut rng = Stream::new(environment.seed, index as u64, "spread");
        let plan = flight_plan(loaded, "uavs", index, &uav.trajectory)?.spread(
            uav.spread_m,
            uav.spread_s,
            &mut rng,
        );
        let catalogue = model(uav.model);
        let airframe = Airframe::new(catalogue);
        let air = air_at(environment, index, plan.sample(0.0).r_enu_m);
        let state = plan.initial_state(&airframe, air.wind_enu_mps, environment.air_density_kgpm3);
        let part = loaded.scenario.engage.aim;
        let catalogued = catalogue.part_skin(part);
        let material = uav.skin.map_or(catalogued, scenario::Skin::material);
        let mesh = Arc::new(uav_mesh(uav.model));
        let aim_body_m = mesh.part_body_m(catalogue, part);
        let shape = shown(world, index, mesh, &state);
        world.spawn((
            Uav {
                index,
                name: uav.name.clone(),
                size_m: catalogue.size_m,
            },
            Flight { state, aim_body_m },
            Guidance {
                plan,
                airframe,
                mass_kg: catalogue.mass_kg,
            },
            air,
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
            Dose::default(),
            shape,
        ));
    }
    Ok(())
}

/// Birds and balloons: their indices come after the UAVs'.
fn spawn_distractors(
    world: &mut World,
    loaded: &Loaded,
    environment: &Environment,
) -> Result<(), RunError> {
    let uavs = loaded.scenario.uavs.len();
    for (number, distractor) in loaded.scenario.distractors.iter().enumerate() {
        let index = uavs + number;
        let mut rng = Stream::new(environment.seed, index as u64, "spread");
        let plan = flight_plan(loaded, "distractors", number, &distractor.trajectory)?.spread(
            distractor.spread_m,
            distractor.spread_s,
            &mut rng,
        );
        let start = plan.sample(0.0);
        let state = MultirotorState {
            r_enu_m: start.r_enu_m,
            v_enu_mps: start.v_enu_mps,
            q_enu_body: DQuat::IDENTITY,
            omega_body_radps: DVec3::ZERO,
            rotor_speed_radps: [0.0; MAX_ROTORS],
            rotor_phase_rad: [0.0; MAX_ROTORS],
            drag_estimate_enu_mps2: DVec3::ZERO,
        };
        let mesh = Arc::new(distractor_mesh(distractor.kind));
        let aim_body_m = mesh.centroid_body_m();
        let shape = shown(world, index, mesh, &state);
        let phase_rad = Stream::new(environment.seed, index as u64, "wingbeat").range(0.0, TAU);
        world.spawn((
            Uav {
                index,
                name: distractor.name.clone(),
                size_m: distractor.kind.size_m(),
            },
            Flight { state, aim_body_m },
            Distractor {
                kind: distractor.kind,
                plan,
                phase_rad,
            },
            air_at(environment, index, start.r_enu_m),
            UavStatus::Flying,
            shape,
        ));
    }
    Ok(())
}

/// The air at the start of a flight.
fn air_at(environment: &Environment, index: usize, r_enu_m: DVec3) -> Air {
    let mut rng = Stream::new(environment.seed, index as u64, "gusts");
    let gusts =
        DrydenGust::new(&environment.mean_wind, &mut rng).reaching(environment.weather.gust_mps);
    let ground_m = environment.city.dsm.terrain_m(r_enu_m.x, r_enu_m.y);
    let wind_enu_mps = environment
        .mean_wind
        .mean_wind_enu_mps(r_enu_m.z - ground_m);
    Air {
        gusts,
        rng,
        wind_enu_mps,
    }
}

/// A shape, put into the scene where there is one.
fn shown(world: &mut World, index: usize, mesh: Arc<UavMesh>, state: &MultirotorState) -> UavShape {
    if world.contains_resource::<SceneHandles>() {
        capture::spawn_uav(world, index, &mesh, (state.r_enu_m, state.q_enu_body));
    }
    UavShape::new(mesh)
}

/// The mirror of a scenario's mount.
pub(crate) fn mirror_params(mount: &scenario::Mount) -> MirrorParams {
    MirrorParams {
        natural_frequency_hz: mount.mirror_bandwidth_hz,
        stroke_rad: mount.mirror_range_mrad * 1e-3,
        ..default()
    }
}

/// The gimbal of a scenario's mount, commanded every `dt_s`.
pub(crate) fn gimbal_params(mount: &scenario::Mount, dt_s: f64) -> GimbalParams {
    let default = GimbalParams::default();
    let axis = |axis: AxisParams, travel_deg: Option<[f64; 2]>| {
        let structure = axis
            .structure
            .filter(|_| mount.structural_mode_hz > 0.0)
            .map(|structure| Structure {
                locked_rotor_hz: mount.structural_mode_hz,
                backlash_rad: mount.backlash_urad * 1e-6,
                ..structure
            });
        let rotor_share = structure.map_or(1.0, |structure| structure.rotor_share);
        // A coarse tick cannot carry the whole bandwidth: see models/mount/gimbal.rs.
        let sampled_hz = 0.75 * rotor_share / (2.0 * axis.damping * TAU * dt_s);
        let axis = AxisParams {
            torque_limit_nm: axis.inertia_kg_m2 * mount.max_acceleration_degps2.to_radians(),
            rate_limit_radps: mount.max_rate_degps.to_radians(),
            travel_rad: travel_deg.map(|limits| limits.map(f64::to_radians)),
            structure,
            encoder_bits: Some(mount.encoder_bits),
            bandwidth_hz: axis.bandwidth_hz.min(sampled_hz),
            ..axis
        };
        if mount.friction { axis } else { axis.ideal() }
    };
    GimbalParams {
        azimuth: axis(default.azimuth, mount.azimuth_limits_deg),
        elevation: axis(default.elevation, Some(mount.elevation_limits_deg)),
    }
}

/// Standard deviation of a beacon's centroid [px] and centroids per camera in a calibration.
const CENTROID_SIGMA_PX: f64 = 0.2;
const CENTROIDS: usize = 200;

/// How the cameras are turned against the laser, and what the calibration finds of it.
fn boresights(
    station: &scenario::Station,
    pinholes: &[Pinhole],
    seed: u64,
) -> Result<(Misalignment, Alignment), calibration::CalibrationError> {
    let sigma_rad = 1e-6 * station.mount.boresight_sigma_urad;
    let (mut truth, mut known) = (Misalignment::default(), Alignment::default());
    for (i, (tier, pinhole)) in Tier::ALL.into_iter().zip(pinholes).enumerate() {
        let mut rng = Stream::new(seed, i as u64, "boresight");
        // The precise camera looks through the laser's own optics.
        let share = if tier == Tier::Precise {
            1.0 / 3.0
        } else {
            1.0
        };
        let mut draw = || share * sigma_rad * rng.normal();
        truth.0[i] = DVec3::new(draw(), draw(), draw());
        if station.calibrate {
            let mut rng = Stream::new(seed, i as u64, "calibration");
            let centroids =
                calibration::measure(pinhole, truth.0[i], CENTROIDS, CENTROID_SIGMA_PX, &mut rng);
            let found = calibration::estimate(pinhole, &centroids, CENTROID_SIGMA_PX)?;
            known.rotation_rad[i] = found.rotation_rad;
            known.sigma_rad[i] = found.standard_error_rad.truncate().max_element();
        } else {
            known.sigma_rad[i] = share * sigma_rad;
        }
    }
    Ok((truth, known))
}

/// The wind at the station.
fn station_wind(environment: &Environment, r_station_enu_m: DVec3) -> StationWind {
    let [x, y, z] = r_station_enu_m.to_array();
    let height_agl_m = z - environment.city.dsm.terrain_m(x, y);
    let mut rng = Stream::new(environment.seed, 0, "station wind");
    StationWind {
        load: WindLoad::default(),
        mean_enu_mps: environment.mean_wind.mean_wind_enu_mps(height_agl_m),
        height_agl_m,
        air_density_kgpm3: environment.air_density_kgpm3,
        gusts: DrydenGust::new(&environment.mean_wind, &mut rng)
            .reaching(environment.weather.gust_mps),
        rng,
        torque_nm: [0.0; 2],
    }
}

/// The radar of a scenario, before its first plot.
fn radar(scenario: &Scenario, seed: u64, clock: SimClock) -> Radar {
    let cue = scenario.search.cue.as_ref();
    let name = cue.and_then(|cue| cue.target.as_ref());
    Radar {
        errors: cue.map(|cue| RadarErrors {
            sigma_rad: cue.sigma_deg.to_radians(),
            range_sigma_m: cue.range_sigma_m,
        }),
        period_ticks: cue.map_or(1, |cue| clock.ticks_of(1.0 / cue.rate_hz).max(1)),
        latency_ticks: cue.map_or(0, |cue| clock.ticks_of(cue.latency_s)),
        target: name.and_then(|name| scenario.uavs.iter().position(|uav| uav.name == *name)),
        rng: Stream::new(seed, 0, "radar"),
        waiting: std::collections::VecDeque::new(),
        track: None,
    }
}

/// Where the search camera looks: the sector, or the part of it that the radar points at.
fn search_scan(scenario: &Scenario, search: &Pinhole, rate_hz: u32, radar: &Radar) -> SearchScan {
    let sector = &scenario.search;
    SearchScan::new(
        sector.pattern,
        Sector {
            centre_azimuth_rad: sector.centre_azimuth_deg.to_radians(),
            centre_elevation_rad: sector.elevation_deg.to_radians(),
            width_rad: sector.width_deg.to_radians(),
            height_rad: sector.height_deg.to_radians(),
        },
        [search.hfov_rad(), search.vfov_rad()],
        1.0 / f64::from(rate_hz),
        radar.cue(0.0),
    )
}

/// The search plan in words, for the log.
fn search_plan(scan: &SearchScan, mount: &GimbalParams) -> String {
    let axis = mount.azimuth;
    let slew = SlewLimits {
        rate_radps: axis.rate_limit_radps,
        acceleration_radps2: axis.torque_limit_nm / axis.inertia_kg_m2,
        settle_s: SETTLE_S,
    };
    format!(
        "{} pattern, gazes: {}, {:.1} by {:.1} deg, covered in {:.1} s if nothing shows",
        scan.pattern.name(),
        scan.gazes_rad.len(),
        scan.area.width_rad.to_degrees(),
        scan.area.height_rad.to_degrees(),
        coverage_time_s(&scan.gazes_rad, scan.gaze_s, &slew),
    )
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
    let mut radar = radar(scenario, seed, clock);
    let mut uavs = world.query_filtered::<(&Uav, &Flight), Without<Distractor>>();
    let airborne = uavs
        .iter(world)
        .map(|(uav, flight)| (uav.index, flight.state.r_enu_m - r_station_enu_m));
    // The engagement begins with the radar's first plot.
    let first = radar.look(0.0, airborne);
    radar.take(first);
    let mut scan = None;
    let mut pinholes = Vec::new();
    for (tier, camera) in Tier::ALL.into_iter().zip(&cameras) {
        let pinhole = Pinhole::from_hfov(
            camera.width_px,
            camera.height_px,
            camera.hfov_deg.to_radians(),
        )
        .map_err(|error| value("station.cameras", error.to_string()))?;
        pinholes.push(pinhole);
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
            scan = Some(search_scan(scenario, &pinhole, camera.rate_hz, &radar));
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
    let station = &scenario.station;
    let params = gimbal_params(&station.mount, dt_s);
    params
        .validate()
        .map_err(|error| value("station.mount", error.to_string()))?;
    let mirror_params = mirror_params(&station.mount);
    let mirror = Mirror::new(&mirror_params, dt_s)
        .map_err(|error| value("station.mount", error.to_string()))?;
    let mut rng = Stream::new(seed, 0, "base motion");
    let mut base = station
        .mount
        .base_motion
        .model(dt_s, &mut rng)
        .map_err(|error| value("station.mount.base_motion", error))?;
    base.step(&mut rng);
    let (misalignment, alignment) = boresights(station, &pinholes, seed)
        .map_err(|error| value("station.calibrate", error.to_string()))?;
    let mount = Mount {
        r_enu_m: r_station_enu_m,
        // The mount waits at the first gaze.
        gimbal: GimbalState::at_rest(params.within_stops(scan.gazes_rad[0].into())),
        params,
        axis_gyro_rng: Stream::new(seed, 0, "axis gyros"),
        mirror_params,
        mirror,
        rng,
        base_rate_radps: [0.0; 2],
        gyro: Gyro {
            angle_random_walk: GYRO_WALK,
            rng: Stream::new(seed, 0, "gyro"),
            rate_enu_radps: DVec3::ZERO,
            tilt_enu_rad: base.tilt_rad(),
        },
        base,
        wind: station
            .mount
            .wind_load
            .then(|| station_wind(environment, r_station_enu_m)),
        alignment,
    };
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
    world.insert_resource(radar);
    world.insert_resource(controller(scenario, file, &params, &mirror_params, dt_s)?);
    let engage = &scenario.engage;
    world.insert_resource(tracker_params(scenario, r_station_enu_m));
    world.insert_resource(operator(scenario, clock));
    let keep_out = |zone: &scenario::KeepOut| {
        zone.zone()
            .ok_or_else(|| value("engage.keep_out", "has no shape".into()))
    };
    world.insert_resource(Rules {
        authorised: engage.authorised,
        keep_out: (engage.keep_out.iter().map(keep_out)).collect::<Result<_, RunError>>()?,
        sun_exclusion_rad: engage.sun_exclusion_deg.to_radians(),
        look_ahead_s: engage.look_ahead_s,
        beam_radius_m: scenario.station.laser.aperture_radius_m,
        allow_sky: engage.allow_backstop.contains(&Backstop::Sky),
        allow_ground: engage.allow_backstop.contains(&Backstop::Ground),
        allow_building: engage.allow_backstop.contains(&Backstop::Building),
        min_clear_range_m: engage.min_clear_range_m,
        max_burst_s: engage.max_burst_s,
        pause_s: 1.0, // [s]
    });
    Ok(())
}

pub(crate) fn tracker_params(scenario: &Scenario, r_station_enu_m: DVec3) -> TrackerParams {
    let scenario::Tracker {
        rule,
        centre_sigma_px,
        min_quality,
        min_score,
        switch_ratio,
        asset_enu_m,
    } = scenario.tracker;
    let engage = &scenario.engage;
    let paper = scenario.controller.preset == ControllerPreset::Paper;
    let (specified_px, least_score, aim) = match scenario.detector.kind {
        DetectorKind::Onnx => (0.5, 0.0, Some(engage.aim)), // [px], score
        // A filter that counts on no error at all would trust nothing else.
        DetectorKind::Truth => (scenario.detector.truth.noise_px.max(0.02), 0.72, None),
    };
    TrackerParams {
        nearest_to_centre: rule.map_or(paper, |rule| rule == AssociationRule::Paper),
        linear_angles: paper,
        centre_sigma_px: centre_sigma_px.unwrap_or(specified_px),
        min_quality,
        min_score: min_score.unwrap_or(least_score),
        switch_ratio,
        r_asset_enu_m: asset_enu_m.map_or(r_station_enu_m, DVec3::from_array),
        aim,
        lock_radius_px: engage.lock_radius_px,
        lock_dwell_s: engage.lock_dwell_s,
        break_radius_px: engage.break_radius_px,
        patience_s: (scenario.station.cameras.resolved())
            .map(|camera| patience_s(f64::from(camera.rate_hz))),
    }
}

fn operator(scenario: &Scenario, clock: SimClock) -> Operator {
    let orders = scenario.operator.iter().map(|order| Order {
        tick: clock.ticks_of(order.t_s),
        designate: order
            .designate
            .as_ref()
            .and_then(|name| scenario.uavs.iter().position(|uav| uav.name == *name)),
    });
    Operator {
        orders: orders.collect(),
        next: 0,
    }
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
        extinction_per_m: environment.weather.extinction_per_m(wavelength_m),
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

/// The controller of a scenario for its mount.
pub(crate) fn controller(
    scenario: &Scenario,
    file: &str,
    gimbal: &GimbalParams,
    mirror: &MirrorParams,
    dt_s: f64,
) -> Result<Controller, RunError> {
    let refused = |error: String| RunError::Value {
        file: file.into(),
        what: "controller",
        why: error,
    };
    let pointing = |law| {
        Controller::Pointing(Box::new(PointingController {
            law,
            hand_over: HandOver::new(mirror.stroke_rad, dt_s),
        }))
    };
    Ok(match scenario.controller.preset {
        ControllerPreset::Tuned => pointing(PointingLaw::Tuned(
            TunedPointing::recommended(gimbal, mirror, dt_s)
                .map_err(|error| refused(error.to_string()))?,
        )),
        ControllerPreset::Lqg => {
            let tau_s = LosFilterParams::default().accel_tau_s;
            let law = LqgPointing::new(gimbal, mirror, tau_s, &LqgWeights::default(), dt_s)
                .map_err(|error| refused(error.to_string()))?;
            pointing(PointingLaw::Lqg(law, LqgMemory::default()))
        }
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
    })
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
        unmarked: Vec::new(),
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
    let boxes: Vec<SceneShape> = environment
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
            SceneShape::Cube {
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
    let mut statuses = world.query_filtered::<&UavStatus, Without<Distractor>>();
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
