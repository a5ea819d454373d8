//! A pointing law of one's own: the gimbal alone follows, the mirror stays at home.
//!
//! `cargo run --release --example own_law`

use boresight::app::{Options, build_with, step};
use boresight::components::control::PointingLaws;
use boresight::components::mount::first_station;
use boresight::components::record::History;
use boresight::models::control::law::{Aim, HandOver, PointingInput, PointingOutput};
use boresight::models::control::pointing::PointingLaw;
use boresight::models::mount::gimbal::{GimbalCommand, GimbalParams};
use boresight::scenario::Scenario;
use glam::DVec2;
use std::error::Error;
use std::path::Path;

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

/// Root mean square of the pointing error in the second of two seconds [µrad].
pub fn rms_urad(law: &str) -> Result<f64, Box<dyn Error>> {
    let set = ["detector.kind=truth", &format!("controller.preset={law}")].map(String::from);
    let loaded = Scenario::load(Path::new("scenarios/urban_intercept.toml"), &set)?;
    let mut app = build_with(&loaded, &Options::default(), |app| {
        let mut laws = app.world_mut().resource_mut::<PointingLaws>();
        laws.add("gimbal_alone", |_plant| {
            Ok(Box::new(GimbalAlone { gain_per_s: 8.0 }))
        });
    })?;
    for _ in 0..2 * loaded.scenario.tick_hz {
        step(app.world_mut())?;
    }
    let history = first_station::<History>(app.world()).ok_or("no station")?;
    let late = history.los_error_urad.iter().filter(|(t_s, _)| *t_s > 1.0);
    let (sum, count) = late.fold((0.0, 0), |(sum, count), (_, e)| (sum + e * e, count + 1));
    Ok((sum / f64::from(count)).sqrt())
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), Box<dyn Error>> {
    for law in ["tuned", "gimbal_alone"] {
        println!("{law}: {:.1} µrad rms", rms_urad(law)?);
    }
    Ok(())
}
