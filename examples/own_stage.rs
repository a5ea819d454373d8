//! A stage of the tracker replaced: what a track is, judged by its size alone.
//!
//! `source scripts/env.sh; cargo run --release --example own_stage`

use bevy::ecs::schedule::ScheduleCleanupPolicy;
use bevy::prelude::*;
use boresight::app::{Options, build_with, step};
use boresight::components::beam::BeamState;
use boresight::components::mount::first_station;
use boresight::components::run::{SimClock, Tick};
use boresight::components::track::{TrackStage, Tracker};
use boresight::models::tracking::recognition::Recognition;
use boresight::scenario::Scenario;
use std::error::Error;
use std::path::Path;

/// The least span of what is taken for a UAV.
#[derive(Resource)]
struct Least(f64); // [m]

/// What is large enough is a UAV, and everything else a bird.
fn by_size(clock: Res<SimClock>, least: Res<Least>, mut stations: Query<&mut Tracker>) {
    let t_s = clock.t_s();
    for mut tracker in &mut stations {
        for track in &mut tracker.table.tracks {
            let span_m = track
                .range
                .range_m(t_s)
                .map(|(range_m, _)| range_m * track.size_rad);
            track.recognition = span_m.map(|span_m| {
                let p_uav = if span_m >= least.0 { 0.99 } else { 0.01 };
                Recognition {
                    probabilities: [p_uav, 1.0 - p_uav, 0.0, 0.0, 0.0, 0.0],
                    t_s,
                }
            });
        }
    }
}

/// Energy that the laser emits in five seconds of `urban_intercept`, where a UAV is at least so large [J].
pub fn energy_j(least_m: f64) -> Result<f64, Box<dyn Error>> {
    let set = ["detector.kind=truth"].map(String::from);
    let loaded = Scenario::load(Path::new("scenarios/urban_intercept.toml"), &set)?;
    let mut replaced = Ok(0);
    let mut app = build_with(&loaded, &Options::default(), |app| {
        let all = ScheduleCleanupPolicy::RemoveSystemsOnly;
        replaced = app.remove_systems_in_set(Tick, TrackStage::Recognise, all);
        app.insert_resource(Least(least_m))
            .add_systems(Tick, by_size.in_set(TrackStage::Recognise));
    })?;
    assert_eq!(replaced?, 1, "the recogniser is one system");
    for _ in 0..5 * loaded.scenario.tick_hz {
        step(app.world_mut())?;
    }
    let beam: &BeamState = first_station(app.world()).ok_or("no station")?;
    Ok(beam.energy_j)
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), Box<dyn Error>> {
    for least_m in [0.1, 5.0] {
        println!("from {least_m} m on: {:.0} J", energy_j(least_m)?);
    }
    Ok(())
}
