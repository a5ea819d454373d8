//! A run from Rust that reads the cameras' frames and the truth behind them.
//!
//! `source scripts/env.sh; cargo run --release --example bare_run`

use boresight::app::{Options, build, step};
use boresight::components::capture::Frames;
use boresight::components::run::SimClock;
use boresight::scenario::Scenario;
use std::error::Error;
use std::path::Path;

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
pub fn frames() -> Result<Vec<Shown>, Box<dyn Error>> {
    let loaded = Scenario::load(Path::new("scenarios/urban_intercept.toml"), &[])?;
    let options = Options {
        capture: true,
        ..Options::default()
    };
    let mut app = build(&loaded, &options)?;
    let mut shown = Vec::new();
    for _ in 0..loaded.scenario.tick_hz / 10 {
        step(app.world_mut())?;
        let world = app.world();
        for frame in &world.resource::<Frames>().0 {
            let (Some(rgb8), Some(uav)) = (&frame.rgb8, frame.truth.first()) else {
                continue;
            };
            let [x, y] =
                [0, 1].map(|axis| uav.aim_px[axis] - f64::from(frame.rect.offset_px[axis]));
            let [w, h] = frame.rect.size_px.map(f64::from);
            if !(0.0..w).contains(&x) || !(0.0..h).contains(&y) {
                continue;
            }
            let first = 3 * (y as usize * frame.rect.size_px[0] as usize + x as usize);
            shown.push(Shown {
                camera: frame.name.to_string(),
                t_s: world.resource::<SimClock>().at_s(frame.tick),
                rgb8: [rgb8[first], rgb8[first + 1], rgb8[first + 2]],
                at_px: uav.aim_px,
            });
        }
    }
    Ok(shown)
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), Box<dyn Error>> {
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
