//! A stage of the tracker replaced: what a track is, judged by its size alone.
//!
//! `cargo run --release --example own_stage`

use boresight::simulation::parts::{Recognition, TrackStage};
use boresight::simulation::{Simulation, SimulationError};

/// Energy that the laser emits in five seconds of `urban_intercept`, where what is at least so large is taken for a
/// UAV, and everything else for a bird [J].
pub fn energy_j(least_m: f64) -> Result<f64, SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .stage(TrackStage::Recognise, move |stage| {
            let t_s = stage.view().t_s();
            stage.each_tracker(|tracker| {
                for track in &mut tracker.table.tracks {
                    let range = track.range.range_m(t_s);
                    let span_m = range.map(|(range_m, _)| range_m * track.size_rad);
                    track.recognition = span_m.map(|span_m| {
                        let p_uav = if span_m >= least_m { 0.99 } else { 0.01 };
                        Recognition {
                            probabilities: [p_uav, 1.0 - p_uav, 0.0, 0.0, 0.0, 0.0],
                            t_s,
                        }
                    });
                }
            });
        })
        .open()?;
    run.run_until(5.0)?;
    Ok((run.view().stations())
        .map(|station| station.beam().energy_j)
        .sum())
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    for least_m in [0.1, 5.0] {
        println!("from {least_m} m on: {:.0} J", energy_j(least_m)?);
    }
    Ok(())
}
