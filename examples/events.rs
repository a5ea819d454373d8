//! What happens in a run, as a log: states, fire, fates.
//!
//! `cargo run --release --example events`

use boresight::simulation::{Event, Simulation, SimulationError, What};

/// The events of `urban_intercept`, seen by the truth detector.
pub fn events() -> Result<Vec<Event>, SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .open()?;
    let mut events = Vec::new();
    while !run.step(100)? {
        events.extend_from_slice(run.events());
    }
    events.extend_from_slice(run.events());
    Ok(events)
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    for Event { t_s, what, .. } in events()? {
        let text = match what {
            What::State {
                station,
                to,
                reason,
            } => format!("{station}: {}, {reason}", to.name()),
            What::Order {
                station, answer, ..
            } => format!("{station}: an order: {answer:?}"),
            What::Fire { station, .. } => format!("{station}: fires"),
            What::CeaseFire { station } => format!("{station}: ceases fire"),
            What::Uav { name, status, .. } => format!("{name}: {}", status.name()),
            What::AtAsset { name, .. } => format!("{name}: at the asset"),
        };
        println!("{t_s:7.3} s  {text}");
    }
    Ok(())
}
