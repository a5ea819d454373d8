//! A run whose cameras' frames are read, beside the truth behind them.
//!
//! `source scripts/env.sh; cargo run --release --example bare_run`

use boresight::simulation::{Simulation, SimulationError};

/// What a frame showed.
pub struct Shown {
    /// Name of the camera, and time of the exposure [s].
    pub camera: String,
    pub t_s: f64,
    /// Red, green and blue of the pixel at the UAV's true place.
    pub rgb8: [u8; 3],
    /// The UAV's true place [px].
    pub at_px: [f64; 2],
}

/// The frames of the first tenth of a second that show the UAV of `urban_intercept`.
pub fn frames() -> Result<Vec<Shown>, SimulationError> {
    let mut run = Simulation::open("scenarios/urban_intercept.toml")?;
    let mut shown = Vec::new();
    for _ in 0..run.view().tick_hz() / 10 {
        run.step(1)?;
        for frame in run.frames() {
            let uav = frame.truth().first();
            if let Some(uav) = uav
                && let Some(rgb8) = frame.pixel(uav.aim_px)
            {
                shown.push(Shown {
                    camera: frame.camera().to_owned(),
                    t_s: run.t_s(),
                    rgb8,
                    at_px: uav.aim_px,
                });
            }
        }
    }
    Ok(shown)
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    for Shown {
        camera,
        t_s,
        rgb8,
        at_px: [x, y],
    } in frames()?
    {
        println!("{t_s:.3} s {camera}: the UAV is at {x:.1}, {y:.1} px, colour {rgb8:?}");
    }
    Ok(())
}
