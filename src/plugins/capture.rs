//! Cameras: lenses, sensors, boresights; exposures and their pictures.

use crate::components::capture::{
    AutoExposure, CameraOf, Exposures, Frames, Lamps, Readout, SensorCamera,
};
use crate::components::environment::Environment;
use crate::components::mount::{Mount, Optics, Station};
use crate::components::render::SceneHandles;
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::models::optics::seeing::{FrozenAir, SEEING_STREAM};
use crate::models::optics::sensor::Sensor;
use crate::parameters::capture::{
    boresight, exposure_control, lamps, optical_path, pinhole, seeing_optics, sensor_params,
    stray_optics,
};
use crate::plugins::render;
use crate::plugins::run::fallible;
use crate::scenario::{self, ResolvedCamera};
use crate::systems::capture::{self as systems, metering};
use crate::systems::render::scene;
use bevy::prelude::*;
use std::sync::Arc;

/// Adds the domain to both schedules, in [`TickSet::Capture`].
pub struct CapturePlugin;

impl Plugin for CapturePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Frames>()
            .add_systems(
                SetUp,
                (
                    fallible(spawn_cameras),
                    render::show.run_if(render::renders),
                )
                    .chain()
                    .in_set(TickSet::Capture),
            )
            .add_systems(
                Tick,
                (
                    scene::relight.run_if(
                        resource_exists::<SceneHandles>
                            .and_then(resource_changed::<Environment>)
                            .and_then(not(resource_added::<Environment>)),
                    ),
                    systems::set_cameras,
                    systems::expose,
                    systems::pause_lasers,
                    systems::render_frames,
                )
                    .chain()
                    .in_set(TickSet::Capture),
            );
    }
}

/// The station's cameras, wide to narrow.
fn spawn_cameras(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    clock: Res<SimClock>,
    seed: Res<Seed>,
    environment: Res<Environment>,
    stations: Query<(Entity, &Station, &Mount, &Optics)>,
) -> Result<(), PartError> {
    commands.insert_resource(Lamps(lamps(&loaded.scenario)));
    let scenario_stations = loaded.scenario.stations();
    let mut index = 0;
    for (entity, station, mount, optics) in &stations {
        let site = &scenario_stations[station.index];
        // All cameras of a station look through the same air.
        let turbulence = &loaded.scenario.turbulence;
        let mut rng = seed.stream(station.index as u64, SEEING_STREAM);
        let air = (turbulence.imaging)
            .then(|| Arc::new(FrozenAir::new(&mut rng, turbulence.outer_scale_m)));
        for camera in site.config.cameras.all() {
            let place = format!("{}.cameras.{}", site.place, camera.place);
            let ResolvedCamera { name, tier, .. } = camera;
            let path = optical_path(camera.path);
            let camera = &camera.config;
            let pinhole = pinhole(&loaded, &place, camera)?;
            let key = seed.stream(index as u64, "fixed pattern").bits();
            let r_enu_m = mount.r_enu_m;
            let params = sensor_params(camera, &environment, r_enu_m, &pinhole, key, air.is_some());
            let control = exposure_control(camera);
            // In the light on level ground; the control changes it by a tick or two.
            let bright_kcd_m2 = metering::bright_ground_kcd_m2(&environment);
            let exposure = control.wanted_s(bright_kcd_m2, params.saturation_kcd_s_m2());
            let latency_s = 0.5 * control.setting(exposure).time_s
                + camera.readout_latency_s
                + camera.inference_latency_s;
            let sensor = Sensor::new(&params).map_err(|error| loaded.refuse(&place, error))?;
            let boresight = boresight(site.config, path, &pinhole, *seed, index as u64)
                .map_err(|error| loaded.refuse(&format!("{}.calibrate", site.place), error))?;
            let view = mount.camera_view(path, &boresight, optics);
            let windowed = camera.readout == scenario::ReadoutMode::Window;
            commands.spawn((
                CameraOf(entity),
                SensorCamera {
                    index,
                    name: station.named(&name).into(),
                    tier,
                    pinhole,
                    period_ticks: u64::from(clock.tick_hz / camera.rate_hz),
                    latency_ticks: clock.ticks_of(latency_s),
                    sensor,
                    seeing: (air.as_ref())
                        .map(|air| Arc::new(seeing_optics(camera, &pinhole, air))),
                    control,
                    window_px: windowed.then_some(camera.window_px),
                    antialias: camera.antialias,
                },
                Readout::Off,
                Exposures::default(),
                AutoExposure::default(),
                (path, boresight, view, stray_optics(camera)),
            ));
            index += 1;
        }
    }
    Ok(())
}
