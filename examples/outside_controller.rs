//! A controller outside the simulation: it reads what the station measures and drives gimbal and mirror by orders.
//!
//! `cargo run --release --example outside_controller`

use boresight::models::maths::kinematics::error_angles;
use boresight::scenario::{DriveOrder, OrderConfig};
use boresight::simulation::{Simulation, SimulationError, StationView};

/// Gimbal rate per angle still to turn [1/s].
const GAIN_PER_S: f64 = 8.0;

/// The rates that follow the target, once a camera holds it; nothing before: then the law in force searches.
fn drive(station: &StationView) -> DriveOrder {
    let Some(target) = station.target().filter(|_| station.state().acquired()) else {
        return DriveOrder::default();
    };
    let mount = station.mount();
    let off_rad = target.az_el_rad() - mount.measured_az_el_rad;
    let rates_radps = target.rates_radps() + GAIN_PER_S * off_rad;
    DriveOrder {
        rates_degps: Some(rates_radps.to_array().map(f64::to_degrees)),
        mirror_urad: Some([0.0; 2]),
    }
}

/// The laser's angle off the UAV's aim point in the last of three seconds of `urban_intercept`, root mean square [µrad],
/// and the hash of the run.
pub fn run() -> Result<(f64, u64), SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set("engage.authorised=false")
        .open()?;
    let (mut sum, mut count) = (0.0, 0);
    while run.t_s() < 3.0 {
        run.step(1)?;
        let view = run.view();
        let (Some(station), Some(uav)) = (view.stations().next(), view.uavs().next()) else {
            break;
        };
        if run.t_s() > 2.0 {
            let laser = station.mount().laser;
            let los_enu = uav.aim_enu_m() - laser.r_enu_m;
            sum += error_angles(laser.q_enu_cam, los_enu).length_squared();
            count += 1;
        }
        let drive = drive(&station);
        run.give(&OrderConfig {
            drive: Some(drive),
            ..OrderConfig::default()
        })?;
    }
    Ok((
        1e6 * (sum / f64::from(count)).sqrt(),
        run.view().state_hash(),
    ))
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    let (rms_urad, hash) = run()?;
    println!("{rms_urad:.1} µrad rms; state hash {hash:016x}");
    Ok(())
}
