//! A recording's run made again: scenario and seed are in the file, and every tick is the same.
//!
//! `cargo run --release --example repeat`

use boresight::simulation::{Simulation, SimulationError};
use std::path::Path;

/// Records a second of `urban_intercept` with a seed into a folder, and makes it again from the recording: the hashes of
/// the last tick.
pub fn twice(out: &Path, seed: u64) -> Result<[u64; 2], SimulationError> {
    let mut first = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set("duration_s=1")
        .seed(seed)
        .record(out)
        .open()?;
    first.step(u64::MAX)?;
    let hash = first.view().state_hash();
    first.finish()?;
    let mut again = Simulation::open(out.join("run.mcap"))?;
    again.step(u64::MAX)?;
    Ok([hash, again.view().state_hash()])
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    let out = std::env::temp_dir().join("boresight-repeat");
    let [first, again] = twice(&out, 7)?;
    println!("{first:016x}, and again {again:016x}");
    Ok(())
}
