//! State hash, statistics, recording.

use crate::components::capture::SensorCamera;
use crate::components::control::SearchScan;
use crate::components::environment::Environment;
use crate::components::mount::{Mount, Station};
use crate::components::record::{
    CameraHistory, Fates, History, Logged, OwnTopics, Recording, StateHash,
};
use crate::components::run::{Options, PartError, RunScenario, Seed, SetUp, Tick, TickSet};
use crate::models::ground::city::City;
use crate::models::maths::polygon;
use crate::models::mount::gimbal::GimbalParams;
use crate::models::tracking::search::{SlewLimits, coverage_time_s};
use crate::place::found_anywhere;
use crate::plugins::run::fallible;
use crate::recording::{
    CITY, LogLevel, Meta, OwnTopic, Recorder, RecordingError, SceneEntity, SceneShape,
};
use crate::scenario::{Images, Loaded};
use crate::systems::{beam, record as systems};
use bevy::platform::cell::SyncCell;
use bevy::prelude::*;
use glam::{DQuat, DVec3};
use std::io::{self, Write};
use std::num::NonZeroU32;
use std::path::Path;

/// Adds the domain to both schedules, in [`TickSet::Record`].
pub struct RecordPlugin;

impl Plugin for RecordPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<StateHash>()
            .init_resource::<OwnTopics>()
            .add_systems(SetUp, fallible(set_up).in_set(TickSet::Record))
            .add_systems(
                Tick,
                systems::count_dwell
                    .in_set(TickSet::Beam)
                    .after(beam::count_distractors)
                    .before(beam::heat),
            )
            .add_systems(
                Tick,
                (
                    systems::hash_state,
                    systems::keep_series,
                    systems::keep_pictures,
                    systems::sights::note_crashes,
                    systems::sights::keep_dealings,
                    systems::sights::keep_sights,
                    systems::mcap::write_recording,
                )
                    .chain()
                    .in_set(TickSet::Record),
            );
    }
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    options: Res<Options>,
    seed: Res<Seed>,
    environment: Res<Environment>,
    stations: Query<(Entity, &Station, &SearchScan, &Mount)>,
    cameras: Query<(Entity, &SensorCamera)>,
    own_topics: Res<OwnTopics>,
) -> Result<(), PartError> {
    for (station, ..) in &stations {
        let own = (History::default(), Logged::default());
        commands.entity(station).insert(own);
    }
    for (camera, _) in &cameras {
        commands.entity(camera).insert(CameraHistory::default());
    }
    let scenario = &loaded.scenario;
    let record = &scenario.record;
    let first = stations.iter().next().map(|(.., mount)| mount.r_enu_m);
    commands.insert_resource(Fates {
        r_asset_enu_m: (scenario.tracker.asset_enu_m)
            .map_or(first.unwrap_or_default(), DVec3::from_array),
        asset_radius_m: scenario.tracker.asset_radius_m,
        uavs: Vec::new(),
    });
    let wanted = options.out.is_some() || options.live.is_some();
    let mut recorder = match NonZeroU32::new(scenario.tick_hz).filter(|_| wanted) {
        Some(tick_hz) => {
            let cameras: Vec<&str> = cameras.iter().map(|(_, camera)| &*camera.name).collect();
            let more = stations.iter().skip(1);
            let more: Vec<&str> = more.map(|(_, station, ..)| &*station.name).collect();
            let names = (&cameras[..], &more[..], own_topics.topics());
            Some(recorder(&loaded, &options, *seed, tick_hz, names)?)
        }
        None => None,
    };
    if let Some(recorder) = &mut recorder {
        record_city(recorder, &environment.city)?;
        for (_, station, scan, mount) in &stations {
            let text = search_plan(scan, &mount.gimbal.params);
            recorder.log(0, LogLevel::Info, &station.named("search"), &text)?;
        }
    }
    commands.insert_resource(Recording {
        recorder: recorder.map(SyncCell::new),
        state_period_ticks: u64::from(scenario.tick_hz / record.state_hz),
        image_every: match record.images {
            Images::All => 1,
            Images::None => 0,
            Images::Every(every) => u64::from(every),
        },
        jpeg_quality: record.jpeg_quality,
        picture_bits_per_px: record.picture_bits_per_px,
    });
    Ok(())
}

/// Creates the output folder and the recording in it, and serves it, each where it is asked for.
fn recorder(
    loaded: &Loaded,
    options: &Options,
    seed: Seed,
    tick_hz: NonZeroU32,
    (cameras, more_stations, own_topics): (&[&str], &[&str], &[OwnTopic]),
) -> Result<Recorder, PartError> {
    let scenario = &loaded.scenario;
    let out = options.out.as_deref();
    out.map(crate::output::create_dir).transpose()?;
    // What an earlier run left there would pass for this one's, should it end without its own.
    for name in ["summary.json", "report.html"] {
        let _ = out.map(|out| std::fs::remove_file(out.join(name)));
    }
    let epoch = scenario.time_utc.timestamp_nanos_opt().unwrap_or(0);
    // A recording lies elsewhere than its scenario.
    let folder = loaded.path.parent().unwrap_or(Path::new(""));
    let mut overrides = loaded.overrides.clone();
    overrides.extend(found_anywhere(&scenario.city, folder));
    let mut recorder = Recorder::create(
        out.map(|out| out.join("run.mcap")).as_deref(),
        options.live,
        &Meta {
            scenario_name: &scenario.name,
            scenario_toml: &loaded.source,
            overrides: &overrides,
            seed: seed.0,
            pictures: options.capture && !options.on_demand,
            version: crate::VERSION,
            epoch_unix_ns: u64::try_from(epoch).unwrap_or(0),
            tick_hz,
            cameras,
            more_stations,
            own_topics,
        },
    )?;
    if let Some(address) = recorder.live_address() {
        // Whoever has closed standard error does not ask.
        let _ = writeln!(io::stderr(), "live  ws://{address}");
    }
    let site = &scenario.site;
    recorder.location_fix(
        0,
        "enu",
        site.latitude_deg,
        site.longitude_deg,
        site.altitude_m,
    )?;
    Ok(recorder)
}

/// Records the buildings as boxes.
fn record_city(recorder: &mut Recorder, city: &City) -> Result<(), RecordingError> {
    let boxes: Vec<SceneShape> = city
        .buildings
        .iter()
        .map(|building| {
            // Along its longest wall.
            let outline = building.footprint_enu_m();
            let along = polygon::main_axis(outline);
            let [[x0, x1], [y0, y1]] =
                [along, along.perp()].map(|axis| polygon::span(outline, axis));
            let centre = 0.5 * ((x0 + x1) * along + (y0 + y1) * along.perp());
            let rotation = DQuat::from_rotation_z(along.to_angle());
            let base_m = city.dsm.terrain_m(centre.x, centre.y);
            let height_m = building.height_m();
            SceneShape::Cube {
                centre_m: [centre.x, centre.y, base_m + 0.5 * height_m],
                rotation: rotation.to_array(),
                size_m: [x1 - x0, y1 - y0, height_m],
                colour: [0.7, 0.7, 0.68, 1.0],
            }
        })
        .collect();
    let city = SceneEntity {
        id: CITY,
        frame: "enu",
        lifetime_ticks: 0,
        shapes: &boxes,
    };
    recorder.scene_update(0, &[city])
}

/// The search plan in words, for the log.
fn search_plan(scan: &SearchScan, mount: &GimbalParams) -> String {
    let slew = SlewLimits::of(&mount.azimuth);
    let gazes_rad: Vec<_> = scan.offsets_rad.iter().map(|o| o.to_array()).collect();
    format!(
        "{} pattern, gazes: {}, {:.1} by {:.1} deg, covered in {:.1} s if nothing shows",
        scan.pattern.name(),
        gazes_rad.len(),
        scan.area.width_rad.to_degrees(),
        scan.area.height_rad.to_degrees(),
        coverage_time_s(&gazes_rad, scan.empty_gaze_s(), &slew),
    )
}
