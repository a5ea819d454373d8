//! From a scenario to an app that steps: Bevy, the plugins, the set-up.

use crate::components::detect::DetectorInUse;
use crate::components::run::{Kept, PartError, RunScenario};
use crate::plugins::SimulationPlugins;
use crate::plugins::render::ScenePlugin;
use crate::scenario::{InputError, Loaded};
use crate::systems::render::renderer::Renderer;
use crate::systems::run;
use bevy::app::{
    Main, PluginGroupBuilder, TaskPoolThreadAssignmentPolicy, TerminalCtrlCHandlerPlugin,
};
use bevy::log::{Level, LogPlugin};
use bevy::pbr::PbrPlugin;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::settings::{RenderCreation, WgpuSettings};
use bevy::window::{ExitCondition, WindowPlugin};
use std::sync::Arc;

pub use crate::components::run::Options;

/// Why a run cannot be built or go on. Each prints as one line that names the mend.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The scenario cannot be read or is not valid.
    #[error(transparent)]
    Scenario(#[from] InputError),
    /// A domain failed, in its set-up or in a tick.
    #[error(transparent)]
    Part(#[from] PartError),
    /// Without images the detector is blind.
    #[error(
        "detector.kind = \"onnx\" needs rendered images; run without --no-capture, or with \
         --set detector.kind=truth"
    )]
    NeedsImages,
    /// No graphics adapter.
    #[error(
        "no Vulkan adapter found; install a driver (on Debian and Ubuntu \
         `apt-get install mesa-vulkan-drivers` gives a software one), or run with --no-capture \
         --set detector.kind=truth"
    )]
    NoAdapter,
}

/// Log filter for Bevy, wgpu and Foxglove, to which a client that goes is an error; `RUST_LOG` overrides it.
const LOG_FILTER: &str = "wgpu=error,naga=warn,bevy_render=error,bevy_render::extract_resource=off,bevy_winit=error,winit=error,bevy_egui=error,bevy_render::renderer=error,foxglove=off";

/// The graphics adapter that would render, if there is one.
pub fn adapter() -> Result<wgpu::AdapterInfo, RunError> {
    let backends = wgpu::Backends::from_env().unwrap_or(wgpu::Backends::PRIMARY);
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    let instance = wgpu::Instance::new(descriptor);
    bevy::tasks::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
        .map(|adapter| adapter.get_info())
        .map_err(|_| RunError::NoAdapter)
}

/// Sets a scenario up without pictures, and so finds all that keeps it from running.
pub fn check(loaded: &Loaded) -> Result<(), RunError> {
    checked(loaded).map(drop)
}

/// The same, and what was set up.
pub fn checked(loaded: &Loaded) -> Result<App, RunError> {
    let options = Options {
        one_thread: true,
        ..Options::default()
    };
    set_up(loaded, &options, |_| {})
}

/// Builds the app of a run, ready for its first tick.
pub fn build(loaded: &Loaded, options: &Options) -> Result<App, RunError> {
    build_with(loaded, options, |_| {})
}

/// As [`build`], with plugins of the caller's own: `more` adds them after the simulation's, before the
/// set-up. They may add systems to the sets of both schedules.
///
/// ```
/// use bevy::prelude::*;
/// use boresight::app::{Options, build_with, step};
/// use boresight::components::run::{Tick, TickSet};
/// use boresight::components::track::Tracker;
/// use boresight::scenario::Scenario;
///
/// #[derive(Resource, Default)]
/// struct MostTracks(usize);
///
/// fn count(stations: Query<&Tracker>, mut most: ResMut<MostTracks>) {
///     for tracker in &stations {
///         most.0 = most.0.max(tracker.table.tracks.len());
///     }
/// }
///
/// let path = std::path::Path::new("scenarios/urban_intercept.toml");
/// let loaded = Scenario::load(path, &["detector.kind=truth".into()])?;
/// let mut app = build_with(&loaded, &Options::default(), |app| {
///     app.init_resource::<MostTracks>()
///         .add_systems(Tick, count.in_set(TickSet::Record));
/// })?;
/// for _ in 0..960 {
///     step(app.world_mut())?;
/// }
/// assert!(app.world().resource::<MostTracks>().0 >= 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn build_with(
    loaded: &Loaded,
    options: &Options,
    more: impl FnOnce(&mut App),
) -> Result<App, RunError> {
    let app = set_up(loaded, options, more)?;
    let detector = &app.world().resource::<DetectorInUse>().detector;
    if detector.wants_pictures() && !options.capture {
        return Err(RunError::NeedsImages);
    }
    Ok(app)
}

/// An app with every plugin, its set-up run.
fn set_up(
    loaded: &Loaded,
    options: &Options,
    more: impl FnOnce(&mut App),
) -> Result<App, RunError> {
    let mut app = prepare_with(loaded, options, more)?;
    run::set_up(app.world_mut())?;
    Ok(app)
}

/// As [`build_with`], but the set-up is still to be run: a window shows meanwhile that it is at work.
pub fn prepare_with(
    loaded: &Loaded,
    options: &Options,
    more: impl FnOnce(&mut App),
) -> Result<App, RunError> {
    if options.capture {
        adapter()?;
    }
    let (mut app, renderer) = bevy_app(options, |app| {
        app.add_plugins(SimulationPlugins);
        more(app);
    });
    let world = app.world_mut();
    world.insert_resource(RunScenario(Arc::new(loaded.clone())));
    world.insert_resource(options.clone());
    match renderer {
        Some(renderer) => Kept::put(world, renderer),
        None if options.capture => return Err(RunError::NoAdapter),
        None => {}
    }
    Ok(app)
}

/// Runs one tick; true when the run is over.
pub fn step(world: &mut World) -> Result<bool, RunError> {
    Ok(run::step(world)?)
}

/// Bevy with the plugins that `more` adds, started up, and its renderer where there is one.
pub(crate) fn bevy_app(options: &Options, more: impl FnOnce(&mut App)) -> (App, Option<Renderer>) {
    let mut app = App::new();
    app.add_plugins(bevy_plugins(options));
    app.add_plugins(ScenePlugin);
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
fn bevy_plugins(options: &Options) -> PluginGroupBuilder {
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
        })
        // The lean material has neither prepass nor deferred lighting.
        .set(PbrPlugin {
            prepass_enabled: false,
            add_default_deferred_lighting_plugin: false,
            ..default()
        });
    if !options.log {
        plugins = plugins.disable::<LogPlugin>();
    }
    // The commands listen for signals themselves.
    plugins = plugins.disable::<TerminalCtrlCHandlerPlugin>();
    if !options.window {
        plugins = plugins.disable::<bevy::winit::WinitPlugin>();
    }
    plugins
}
