//! A system of one's own in the tick, and a topic of one's own in the recording: how many tracks there are.
//!
//! `source scripts/env.sh; cargo run --release --example own_topic`

use bevy::prelude::*;
use boresight::app::{Options, build_with, step};
use boresight::components::mount::Station;
use boresight::components::record::{OwnTopics, TopicOf};
use boresight::components::run::{Failure, SimClock, Tick, TickSet};
use boresight::components::track::Tracker;
use boresight::report::summary::conclude;
use boresight::scenario::Scenario;
use schemars::JsonSchema;
use serde::Serialize;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

/// A message of the topic.
#[derive(Serialize, JsonSchema)]
struct TrackCount {
    station: String,
    tracks: usize,
}

#[derive(Resource)]
struct Counts(TopicOf<TrackCount>);

/// Publishes the counts ten times a second.
fn count(
    clock: Res<SimClock>,
    counts: Res<Counts>,
    stations: Query<(&Station, &Tracker)>,
    mut topics: ResMut<OwnTopics>,
    mut failure: ResMut<Failure>,
) {
    for (station, tracker) in stations.iter().filter(|_| clock.due(10)) {
        let message = TrackCount {
            station: station.name.clone(),
            tracks: tracker.table.tracks.len(),
        };
        if let Err(error) = topics.publish(counts.0, &message) {
            failure.set(error);
        }
    }
}

/// The own part: a resource, a topic and a system that runs after the tracker.
fn own_part(app: &mut App) {
    let topic = app
        .world_mut()
        .resource_mut::<OwnTopics>()
        .add("/mine/tracks");
    app.insert_resource(Counts(topic));
    app.add_systems(Tick, count.after(TickSet::Engage).before(TickSet::Record));
}

/// Records two seconds of `urban_intercept`, seen by the truth detector, into a folder.
pub fn record(out: &Path) -> Result<(), Box<dyn Error>> {
    let set = ["detector.kind=truth", "duration_s=2"].map(String::from);
    let loaded = Scenario::load(Path::new("scenarios/urban_intercept.toml"), &set)?;
    let options = Options {
        out: Some(out.to_owned()),
        ..Options::default()
    };
    let started = Instant::now();
    let mut app = build_with(&loaded, &options, own_part)?;
    while !step(app.world_mut())? {}
    conclude(app.world_mut(), &loaded, &options, started.elapsed())?;
    Ok(())
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), Box<dyn Error>> {
    let out = std::env::temp_dir().join("boresight-own-topic");
    record(&out)?;
    println!("{}", out.join("run.mcap").display());
    Ok(())
}
