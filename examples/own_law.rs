//! A pointing law of one's own: the gimbal alone follows, the mirror stays at home.
//!
//! `cargo run --release --example own_law`

use boresight::simulation::parts::{
    Aim, GimbalCommand, GimbalParams, HandOver, PointingInput, PointingLaw, PointingOutput,
};
use boresight::simulation::{Simulation, SimulationError};
use glam::DVec2;

/// Rate of the line of sight plus a proportional part.
#[derive(Clone, Debug)]
struct GimbalAlone {
    gain_per_s: f64,
}

impl PointingLaw for GimbalAlone {
    fn command(
        &mut self,
        hand_over: &mut HandOver,
        gimbal: &GimbalParams,
        input: &PointingInput,
    ) -> PointingOutput {
        let aim = Aim::new(gimbal, input, self.lead_s());
        let gains_per_s = [self.gain_per_s; 2];
        let present_radps = input.gimbal_rates_radps;
        let rates_radps = hand_over.gimbal_rates(gimbal, gains_per_s, &aim, present_radps);
        PointingOutput {
            gimbal: GimbalCommand {
                rate_radps: rates_radps.to_array(),
            },
            mirror_rad: hand_over.mirror(DVec2::ZERO),
        }
    }
}

/// Root mean square of the pointing error in the second of two seconds [µrad], and the state's hash at their end.
pub fn run(law: &str) -> Result<(f64, u64), SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set(format!("controller.preset={law}"))
        .law("gimbal_alone", |_plant| {
            Ok(Box::new(GimbalAlone { gain_per_s: 8.0 }))
        })
        .open()?;
    run.run_until(2.0)?;
    let errors = run.view().stations().flat_map(|station| {
        let history = &station.history().los_error_urad;
        history.iter().filter(|(t_s, _)| *t_s > 1.0)
    });
    let (sum, count) = errors.fold((0.0, 0), |(sum, count), (_, e)| (sum + e * e, count + 1));
    let rms_urad = (sum / f64::from(count)).sqrt();
    Ok((rms_urad, run.view().state_hash()))
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    for law in ["tuned", "gimbal_alone"] {
        let (rms_urad, hash) = run(law)?;
        println!("{law}: {rms_urad:.1} µrad rms, state {hash:016x}");
    }
    Ok(())
}
