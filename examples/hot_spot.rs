//! A hot spot grows on a UAV: temperatures of the place that the beam burns, every half second, side by side in one picture.
//!
//! `cargo run --release --example hot_spot`

use boresight::components::flight::UavStatus;
use boresight::simulation::{BurnView, Simulation, SimulationError};
use image::{Rgb, RgbImage};
use std::path::Path;

/// Pixels to a column of the grid.
const SCALE: u32 = 8;

/// The pictures, from the first light on, until the UAV falls or 12 s of fire have passed.
pub fn run(cn2: f64) -> Result<Vec<RgbImage>, SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set("duration_s=40")
        .set(format!("turbulence.cn2_ground={cn2}"))
        .open()?;
    let mut pictures = Vec::new();
    while pictures.len() < 24 && !run.step(1)? {
        if !run.view().tick().is_multiple_of(480) {
            continue;
        }
        for uav in run.view().uavs() {
            // The beam may stray to parts beside the one that it burns.
            let hottest = (uav.burns()).max_by(|a, b| peak_k(a).total_cmp(&peak_k(b)));
            pictures.extend(hottest.map(|burn| picture(&burn)));
            if uav.status() != UavStatus::Flying {
                return Ok(pictures);
            }
        }
    }
    Ok(pictures)
}

/// Greatest temperature of a place's face [K].
fn peak_k(burn: &BurnView) -> f64 {
    let rows = 0..burn.side();
    let places = rows.flat_map(|row| (0..burn.side()).map(move |column| (row, column)));
    let faces = places.filter_map(|(row, column)| burn.face_k(row, column));
    faces.fold(0.0, f64::max)
}

/// Cold is dark blue, then red and yellow up to 1200 K; what is burnt through to nothing is black, what lies beside grey.
fn picture(burn: &BurnView) -> RgbImage {
    let side = burn.side() as u32;
    RgbImage::from_fn(side * SCALE, side * SCALE, |x, y| {
        let Some(face_k) = burn.face_k((y / SCALE) as usize, (x / SCALE) as usize) else {
            return Rgb([128; 3]);
        };
        let share = ((face_k - 280.0) / 900.0).clamp(0.0, 1.0);
        let ramp =
            |from: f64, to: f64| (255.0 * ((share - from) / (to - from)).clamp(0.0, 1.0)) as u8;
        Rgb([
            ramp(0.0, 0.5),
            ramp(0.4, 0.9),
            ramp(0.9, 1.0).max(60 - ramp(0.0, 0.3).min(60)),
        ])
    })
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    let out = Path::new("out");
    for (name, cn2) in [("calm", 1e-15), ("strong", 1e-13)] {
        let pictures = run(cn2)?;
        let width = pictures.iter().map(|picture| picture.width() + SCALE).sum();
        let height = pictures.iter().map(RgbImage::height).max();
        let mut strip = RgbImage::new(width, height.unwrap_or(0));
        let mut left = 0;
        for picture in &pictures {
            image::imageops::replace(&mut strip, picture, left, 0);
            left += i64::from(picture.width() + SCALE);
        }
        let file = out.join(format!("hot_spot_{name}.png"));
        let saved = std::fs::create_dir_all(out).is_ok() && strip.save(&file).is_ok();
        let word = if saved { "is" } else { "cannot be written:" };
        println!(
            "Cn² {cn2:e}: {} pictures; {word} {}",
            pictures.len(),
            file.display()
        );
    }
    Ok(())
}
