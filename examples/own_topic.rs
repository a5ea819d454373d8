//! A topic of one's own in the recording: how many tracks there are, ten times a second.
//!
//! `cargo run --release --example own_topic`

use boresight::simulation::{Simulation, SimulationError};
use schemars::JsonSchema;
use serde::Serialize;
use std::path::Path;

/// A message of the topic.
#[derive(Serialize, JsonSchema)]
struct TrackCount {
    station: String,
    tracks: usize,
}

/// Records two seconds of `urban_intercept`, seen by the truth detector, into a folder.
pub fn record(out: &Path) -> Result<(), SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set("duration_s=2")
        .record(out)
        .topic("/mine/tracks", 10, |view| {
            let station = view.stations().next()?;
            Some(TrackCount {
                station: station.name().to_owned(),
                tracks: station.tracks().count(),
            })
        })
        .open()?;
    run.step(u64::MAX)?;
    run.finish()?;
    Ok(())
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    let out = std::env::temp_dir().join("boresight-own-topic");
    record(&out)?;
    println!("{}", out.join("run.mcap").display());
    Ok(())
}
