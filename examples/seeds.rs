//! Many seeds of one scenario: a mean with its interval, without a sweep file.
//!
//! `cargo run --release --example seeds`

use boresight::models::maths::statistics::Mean;
use boresight::simulation::{Simulation, SimulationError};

/// Time to acquire in `urban_intercept` over so many seeds [s]: the mean and its 95 % interval.
pub fn acquisition_s(seeds: u64) -> Result<Mean, SimulationError> {
    let mut times_s = Vec::new();
    for seed in 1..=seeds {
        let mut run = Simulation::builder("scenarios/urban_intercept.toml")
            .set("detector.kind=truth")
            .seed(seed)
            .open()?;
        run.watch(|run| (run.view().stations()).any(|station| station.state().acquired()))?;
        times_s.push(run.t_s());
    }
    Ok(Mean::of(&times_s))
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    println!("acquired after {} s", acquisition_s(10)?.text());
    Ok(())
}
