//! A UAV of one's own, `examples/own_uav.toml`, against `urban_intercept`'s station.
//!
//! `cargo run --release --example own_uav`

use boresight::app::{Options, build, step};
use boresight::components::flight::UavStatus;
use boresight::components::run::SimClock;
use boresight::scenario::{Scenario, catalogue};
use std::error::Error;
use std::path::Path;

/// The file; dropped into `assets/uavs` it would be the catalogue's `own_uav`.
pub const OWN: &str = "examples/own_uav.toml";

/// When `urban_intercept`'s station has neutralised a model that flies in place of its UAV [s]; none: never.
pub fn neutralised_s(model: &str) -> Result<Option<f64>, Box<dyn Error>> {
    let set = ["detector.kind=truth", &format!("uavs.0.model={model}")].map(String::from);
    let loaded = Scenario::load(Path::new("scenarios/urban_intercept.toml"), &set)?;
    let mut app = build(&loaded, &Options::default())?;
    let world = app.world_mut();
    let mut uavs = world.query::<&UavStatus>();
    while world.resource::<SimClock>().t_s() < loaded.scenario.duration_s {
        step(world)?;
        if uavs.iter(world).any(|status| status.neutralised()) {
            return Ok(Some(world.resource::<SimClock>().t_s()));
        }
    }
    Ok(None)
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
