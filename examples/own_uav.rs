//! A UAV of one's own, `examples/own_uav.toml`, against `urban_intercept`'s station.
//!
//! `cargo run --release --example own_uav`

use boresight::scenario::catalogue;
use boresight::simulation::{Simulation, SimulationError};
use std::error::Error;

/// The file; dropped into `assets/uavs` it would be the catalogue's `own_uav`.
pub const OWN: &str = "examples/own_uav.toml";

/// When `urban_intercept`'s station has neutralised a model that flies in place of its UAV [s]; none: never.
pub fn neutralised_s(model: &str) -> Result<Option<f64>, SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set(format!("uavs.0.model={model}"))
        .open()?;
    let mut at_s = None;
    run.watch(|run| {
        let mut uavs = run.view().uavs();
        at_s = (uavs.any(|uav| uav.status().neutralised())).then_some(run.t_s());
        at_s.is_some()
    })?;
    Ok(at_s)
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), Box<dyn Error>> {
    for model in ["phantom4", OWN] {
        let uav = catalogue::load(model)?;
        print!(
            "{}, {} kg, {} rotors: ",
            uav.name, uav.mass_kg, uav.rotor_count
        );
        match neutralised_s(model)? {
            Some(t_s) => println!("neutralised after {t_s:.1} s"),
            None => println!("gets away"),
        }
    }
    Ok(())
}
