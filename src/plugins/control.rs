//! Radar, search scan and control law; commands for mount and cameras.

use crate::components::capture::{SensorCamera, StationCameras, Tier};
use crate::components::control::{
    Controller, PaperController, PointingController, PointingLaws, Radar, SearchScan,
};
use crate::components::flight::{Distractor, Flight, Uav};
use crate::components::mount::{Gimbal, Mount, OpticalPath, Optics, PanTilt, Station};
use crate::components::operator::Operator;
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::models::control::POINTING_LAWS;
use crate::models::control::law::HandOver;
use crate::models::control::paper::PaperLaw;
use crate::models::control::tuning::MountPlant;
use crate::models::maths::rng::Stream;
use crate::models::mount::gimbal::{GimbalCommand, GimbalState};
use crate::models::tracking::radar::RadarErrors;
use crate::models::tracking::search::Sector;
use crate::plugins::mount::gimbal_params;
use crate::plugins::run::fallible;
use crate::scenario::{
    self, CameraPath, InputError, Loaded, ResolvedStation, Scenario, SearchSector,
};
use crate::systems::control::with_gains;
use crate::systems::{control as systems, mount};
use bevy::prelude::*;
use std::collections::{BTreeMap, VecDeque};

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
                    systems::track_by_radar,
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

/// The pointing laws that every run knows.
pub fn laws() -> PointingLaws {
    let mut laws = PointingLaws::default();
    for (name, make) in POINTING_LAWS {
        laws.add(name, make);
    }
    laws
}

/// The engagement begins with the radar's first plot and the mount at the scan's first gaze.
fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    clock: Res<SimClock>,
    uavs: Query<(&Uav, &Flight), Without<Distractor>>,
    laws: Res<PointingLaws>,
    cameras: Query<(&SensorCamera, &OpticalPath)>,
    mut stations: Query<(
        Entity,
        &Station,
        &Operator,
        &StationCameras,
        &mut Mount,
        &mut Optics,
    )>,
) -> Result<(), PartError> {
    let known = loaded.scenario.stations();
    for (entity, station, operator, own, mut mount, mut optics) in &mut stations {
        let site = &known[station.index];
        let mut radar = radar(
            &loaded.scenario,
            site.search,
            seed.stream(station.index as u64, "radar"),
            *clock,
        );
        let airborne = uavs
            .iter()
            .map(|(uav, flight)| (uav.index, flight.state.r_enu_m - mount.r_enu_m));
        let first = radar.look(0.0, airborne);
        radar.take(&first);
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
            let mut gimbal = Gimbal::new(params, seed.stream(camera.index as u64, "pan-tilt"));
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

/// The controller of a scenario for the mount of the station that stands at `station` in the file.
pub fn controller(
    loaded: &Loaded,
    laws: &PointingLaws,
    station: &str,
    plant: &MountPlant,
) -> Result<Controller, InputError> {
    let settings = &loaded.scenario.controller;
    if settings.is_paper() {
        return Ok(Controller::Paper(Box::new(PaperController::new(
            with_gains(PaperLaw::COARSE, settings.coarse),
            with_gains(PaperLaw::PRECISE, settings.precise),
        ))));
    }
    let name = &settings.preset;
    let law = laws.make(name, plant).ok_or_else(|| {
        let known: Vec<&str> = laws.names().chain([scenario::PAPER]).collect();
        let hint = scenario::suggestion(name, &known);
        loaded.refuse("controller.preset", format!("no law '{name}'{hint}"))
    })?;
    // The gains follow from the mount: where none is stable, the mount is what to change.
    let law = law.map_err(|error| loaded.refuse(&format!("{station}.mount"), error))?;
    Ok(Controller::Pointing(Box::new(PointingController {
        name: name.clone(),
        law,
        hand_over: HandOver::new(plant.mirror.stroke_rad, plant.dt_s),
    })))
}

/// The radar of a scenario, before its first plot.
fn radar(scenario: &Scenario, search: &SearchSector, rng: Stream, clock: SimClock) -> Radar {
    let cue = search.cue.as_ref();
    let name = cue.and_then(|cue| cue.target.as_ref());
    Radar {
        errors: cue.map(|cue| RadarErrors {
            sigma_rad: cue.sigma_deg.to_radians(),
            range_sigma_m: cue.range_sigma_m,
        }),
        period_ticks: cue.map_or(1, |cue| clock.ticks_of(1.0 / cue.rate_hz).max(1)),
        latency_ticks: cue.map_or(0, |cue| clock.ticks_of(cue.latency_s)),
        target: name.and_then(|name| scenario.uavs.iter().position(|uav| uav.name == *name)),
        all: cue.is_some_and(|cue| cue.all),
        dismissed: Vec::new(),
        rng,
        waiting: VecDeque::new(),
        tracks: BTreeMap::new(),
    }
}

/// Where cameras, which one gimbal turns, look for a target: the sector, or the part of it that the radar
/// points at.
fn search_scan(
    site: &ResolvedStation,
    cameras: Vec<&SensorCamera>,
    clock: &SimClock,
    radar: &Radar,
) -> SearchScan {
    let sector = site.search;
    let first_of = |tier: Tier| {
        let camera = cameras.iter().find(|camera| camera.tier == tier)?;
        let pinhole = &camera.pinhole;
        let field_rad = [pinhole.hfov_rad(), pinhole.vfov_rad()];
        Some((tier, field_rad, clock.at_s(camera.period_ticks)))
    };
    let searching: Vec<_> = Tier::ALL.into_iter().filter_map(first_of).collect();
    let area = Sector {
        centre_azimuth_rad: sector.centre_azimuth_deg.to_radians(),
        centre_elevation_rad: sector.elevation_deg.to_radians(),
        width_rad: sector.width_deg.to_radians(),
        height_rad: sector.height_deg.to_radians(),
    };
    let cue = radar.cue(0.0);
    SearchScan::new(sector.pattern, area, &searching, cue)
}
