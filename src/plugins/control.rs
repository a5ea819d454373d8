//! Radar, search scan and control law; commands for mount and cameras.

use crate::components::capture::{SensorCamera, StationCameras};
use crate::components::control::{Controller, PointingLaws, Radar};
use crate::components::environment::Environment;
use crate::components::mount::{Gimbal, Mount, OpticalPath, Optics, PanTilt, Station};
use crate::components::operator::Operator;
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::components::track::TrackerParams;
use crate::models::control::tuning::MountPlant;
use crate::models::mount::gimbal::{GimbalCommand, GimbalState};
use crate::models::mount::gyro::Gyro;
use crate::parameters::control::{controller, laws, radar, search_scan};
use crate::parameters::mount::gimbal_params;
use crate::plugins::run::fallible;
use crate::scenario::{CameraPath, InputError, Loaded};
use crate::systems::control::radar::{Flying, track_by_radar};
use crate::systems::{control as systems, mount};
use bevy::prelude::*;

/// Adds the domain to both schedules, in [`TickSet::Control`].
pub struct ControlPlugin;

impl Plugin for ControlPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(laws())
            .add_systems(
                SetUp,
                (fallible(set_up), fallible(spawn_pan_tilts), mount::look)
                    .chain()
                    .in_set(TickSet::Control),
            )
            .add_systems(
                Tick,
                (
                    track_by_radar,
                    systems::change_laws,
                    systems::command_mount,
                    systems::command_pan_tilts,
                    systems::choose_readouts,
                )
                    .chain()
                    .in_set(TickSet::Control),
            );
    }
}

/// The engagement begins with what the radar knows and the mount at the scan's first gaze.
fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    clock: Res<SimClock>,
    environment: Res<Environment>,
    flying: Query<Flying>,
    laws: Res<PointingLaws>,
    cameras: Query<(&SensorCamera, &OpticalPath)>,
    mut stations: Query<(
        Entity,
        &Station,
        &Operator,
        &TrackerParams,
        &StationCameras,
        &mut Mount,
        &mut Optics,
    )>,
) -> Result<(), PartError> {
    let known = loaded.scenario.stations();
    for (entity, station, operator, params, own, mut mount, mut optics) in &mut stations {
        let site = &known[station.index];
        let mut radar = radar(&loaded.scenario, site.search, station.index, *seed, *clock);
        let period_s = clock.at_s(radar.period_ticks);
        radar.warm_up(period_s, mount.r_enu_m, &environment, &flying);
        radar.choose(0.0, mount.r_enu_m, params.r_asset_enu_m);
        let cameras: Vec<_> = cameras.iter_many(own.entities()).collect();
        let turned = |(_, path): &(&SensorCamera, &OpticalPath)| path.is_on_gimbal();
        let turned: Vec<_> = cameras.into_iter().filter(turned).collect();
        if turned.is_empty() {
            let place = format!("{}.cameras", site.place);
            return Err(loaded.refuse(&place, "the gimbal turns no camera").into());
        }
        let turned = turned.into_iter().map(|(camera, _)| camera);
        let scan = search_scan(site, turned.collect(), &clock, &radar);
        let first_gaze = mount.gimbal.params.within_stops(scan.gaze(0.0).az_el_rad);
        mount.gimbal.state = GimbalState::at_rest(first_gaze);
        *optics = mount.optics();
        let plant = mount.plant(clock.dt_s());
        let controller = controller(&loaded, &laws, &site.place, &plant)?;
        try_orders(&loaded, &laws, (station, operator), &controller, &plant)?;
        commands.entity(entity).insert((controller, scan, radar));
    }
    Ok(())
}

/// Obeys a station's orders of laws and gains on a copy of its controller, so that a bad one is found at once.
fn try_orders(
    loaded: &Loaded,
    laws: &PointingLaws,
    (station, operator): (&Station, &Operator),
    controller: &Controller,
    plant: &MountPlant,
) -> Result<(), InputError> {
    let mut tried = controller.clone();
    let given = loaded.scenario.operator.iter().enumerate();
    let own = given.filter(|(_, order)| order.is_for(&station.name));
    for ((index, _), order) in own.zip(&operator.orders) {
        tried
            .obey(&order.command, laws, plant)
            .map_err(|(key, what)| loaded.refuse(&format!("operator[{index}].{key}"), what))?;
    }
    Ok(())
}

/// Spawns the gimbals that turn one camera alone, each at the first gaze of its own scan.
fn spawn_pan_tilts(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    clock: Res<SimClock>,
    stations: Query<(Entity, &Station, &StationCameras, &Radar)>,
    mut cameras: Query<(&SensorCamera, &mut OpticalPath)>,
) -> Result<(), PartError> {
    let known = loaded.scenario.stations();
    for (station, Station { index, .. }, own, radar) in &stations {
        let site = &known[*index];
        for (entity, config) in own.iter().zip(site.config.cameras.all()) {
            let CameraPath::PanTilt(axes) = config.path else {
                continue;
            };
            let Ok((camera, mut path)) = cameras.get_mut(entity) else {
                continue;
            };
            let params = gimbal_params(&axes.as_mount(&site.config.mount), clock.dt_s());
            let place = format!("{}.cameras.{}", site.place, config.place);
            params
                .validate()
                .map_err(|error| loaded.refuse(&place, error))?;
            let rng = seed.stream(camera.index as u64, "pan-tilt");
            let gyros = Gyro::new(site.config.mount.gyro.params(), rng);
            let mut gimbal = Gimbal::new(params, gyros);
            let scan = search_scan(site, vec![camera], &clock, radar);
            let first_gaze = params.within_stops(scan.gaze(0.0).az_el_rad);
            gimbal.state = GimbalState::at_rest(first_gaze);
            let pan_tilt = PanTilt {
                station,
                camera: entity,
                gimbal,
                command: GimbalCommand::default(),
            };
            *path = pan_tilt.path();
            commands.spawn((pan_tilt, scan));
        }
    }
    Ok(())
}
