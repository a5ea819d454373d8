//! The detector by itself: a picture in, boxes out, and the truth beside them.
//!
//! `source scripts/env.sh; cargo run --release --example detect_picture`

use boresight::inference::OnnxDetector;
use boresight::models::optics::detection::Detection;
use boresight::models::optics::tier::Tier;
use boresight::simulation::Simulation;
use std::error::Error;
use std::path::Path;

/// What the shipped detector finds in the first picture of `urban_intercept`'s search camera that shows the UAV, and
/// where that truly is: x0, y0, x1, y1 [px].
pub fn found_and_truth() -> Result<(Vec<Detection>, [f64; 4]), Box<dyn Error>> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set("station.cameras.search.readout=full")
        .pictures(true)
        .open()?;
    let mut detector = OnnxDetector::load(Path::new("assets/models/boresight-p2-roi.onnx"), 1)?;
    while !run.step(1)? {
        for frame in run.frames().filter(|frame| frame.tier() == Tier::Search) {
            let shown = frame.truth().iter().find(|uav| uav.clear);
            if let (Some(uav), Some(rgb8)) = (shown, frame.rgb8()) {
                let mut found = Vec::new();
                detector.detect(rgb8, frame.rect().size_px, &mut found)?;
                return Ok((found, uav.box_px));
            }
        }
    }
    Err("the search camera never sees the UAV".into())
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), Box<dyn Error>> {
    let (found, truth) = found_and_truth()?;
    println!("the UAV is at {truth:.1?}");
    for Detection { box_px, score, .. } in found {
        println!("{box_px:.1?}, score {score:.2}");
    }
    Ok(())
}
