//! An operator at the console: holds fire until the target is locked, then gives authority.
//!
//! `cargo run --release --example operator`

use boresight::components::track::TrackingState;
use boresight::scenario::OrderConfig;
use boresight::simulation::{Simulation, SimulationError, What};

/// When the operator of `urban_intercept` gave authority, and when the laser first fired [s].
pub fn authority_and_fire_s() -> Result<Option<(f64, f64)>, SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .open()?;
    let fire = |may| OrderConfig {
        fire: Some(may),
        ..OrderConfig::default()
    };
    run.give(&fire(false))?;
    let mut given_s = None;
    while !run.step(1)? {
        let locked =
            (run.view().stations()).any(|station| station.state() == TrackingState::Engage);
        if locked && given_s.is_none() {
            // From two seconds later on.
            let at_s = run.t_s() + 2.0;
            run.give(&OrderConfig {
                t_s: at_s,
                ..fire(true)
            })?;
            given_s = Some(at_s);
        }
        let fires = |what: &What| matches!(what, What::Fire { .. });
        if let Some(shot) = run.events().iter().find(|event| fires(&event.what)) {
            return Ok(given_s.map(|given_s| (given_s, shot.t_s)));
        }
    }
    Ok(None)
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    match authority_and_fire_s()? {
        Some((given_s, fired_s)) => println!("authority at {given_s:.3} s, fire at {fired_s:.3} s"),
        None => println!("it never fires"),
    }
    Ok(())
}
