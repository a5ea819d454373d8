//! A scenario that a program writes: the same station against a UAV at more and more range.
//!
//! `cargo run --release --example own_scenario`

use boresight::scenario::{InputError, Loaded};
use boresight::simulation::{Builder, SimulationError};

/// A station on a roof, and a UAV that hovers so far to the north [m].
fn scenario(range_m: f64) -> Result<Loaded, InputError> {
    let text = format!(
        r#"
name = "range"
duration_s = 20.0
time_utc = "2026-06-21T04:00:00Z"
site = {{ latitude_deg = 31.2, longitude_deg = 121.5, altitude_m = 4.0 }}
detector = {{ kind = "truth" }}

[station]
position_enu_m = [0.0, 0.0, 60.0]

[[uavs]]
name = "intruder"
model = "phantom4"
trajectory = {{ kind = "hover", position_enu_m = [0.0, {range_m:?}, 160.0] }}

[search]
centre_azimuth_deg = 0.0
width_deg = 60.0
cue = {{ sigma_deg = 0.7 }}
"#
    );
    Loaded::parse(text, "range.toml".into(), Vec::new())
}

/// When the UAV is neutralised [s]; none: not within 20 s.
pub fn neutralised_s(range_m: f64) -> Result<Option<f64>, SimulationError> {
    let mut run = Builder::loaded(scenario(range_m)?).open()?;
    run.watch(|run| run.view().uavs().any(|uav| uav.status().neutralised()))?;
    let mut fates = run.view().uavs().filter_map(|uav| uav.fate());
    Ok(fates.find_map(|fate| fate.neutralised_s))
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    for range_m in [400.0, 800.0, 1_600.0] {
        match neutralised_s(range_m)? {
            Some(t_s) => println!("{range_m} m: neutralised after {t_s:.1} s"),
            None => println!("{range_m} m: not within 20 s"),
        }
    }
    Ok(())
}
