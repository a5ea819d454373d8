//! A propagation of one's own: air that bends and spreads nothing, so that the beam is the lens's alone.
//!
//! `cargo run --release --example own_propagation`

use boresight::simulation::parts::{Across, PartError, Propagation, Sent, Shape};
use boresight::simulation::{Simulation, SimulationError};
use glam::DVec2;

/// The spot of diffraction, less what the air takes away.
#[derive(Clone, Debug)]
struct Vacuum;

impl Propagation for Vacuum {
    fn cross(&mut self, sent: &Sent) -> Result<Across, PartError> {
        let left = (-sent.air.warmed.extinction_per_m * sent.range_m).exp();
        Ok(Across {
            power_w: left * sent.laser.power_w,
            centre_m: DVec2::ZERO,
            shape: Shape::Gaussian {
                radius_m: sent.laser.spot_radius_m(sent.range_m, sent.focus_m),
            },
            relative: 1.0,
        })
    }

    fn boxed(&self) -> Box<dyn Propagation> {
        Box::new(self.clone())
    }
}

/// The greatest irradiance on the target [MW/m²] after 0.5 s of fire, by the way that the beam crosses the air.
pub fn run(propagation: &str) -> Result<f64, SimulationError> {
    let mut run = Simulation::builder("scenarios/urban_intercept.toml")
        .set("detector.kind=truth")
        .set(format!("turbulence.propagation={propagation}"))
        .propagation("vacuum", |_context| Ok(Box::new(Vacuum)))
        .open()?;
    let firing = |run: &Simulation| run.view().stations().any(|station| station.beam().firing);
    while !firing(&run) {
        run.step(1)?;
    }
    let (mut peak_wpm2, mut ticks) = (0.0, 0);
    while ticks < 480 && !run.step(1)? {
        let beams = run
            .view()
            .stations()
            .map(|station| station.beam().peak_wpm2);
        peak_wpm2 += beams.sum::<f64>();
        ticks += 1;
    }
    Ok(1e-6 * peak_wpm2 / f64::from(ticks))
}

#[allow(dead_code)] // The tests call the function above.
fn main() -> Result<(), SimulationError> {
    for propagation in ["vacuum", "scaling", "wave"] {
        println!(
            "{propagation}: {:.2} MW/m² on the average",
            run(propagation)?
        );
    }
    Ok(())
}
