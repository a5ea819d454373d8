//! Spots of focused beams over some paths: spread, wander and fluctuation of the peak against theory's lengths.
//!
//! `cargo run --release --example spots -p boresight-wave`: some minutes. The short-term radius and the variance of the peak
//! in `boresight-models` (`air/turbulence.rs`) have their factors from its table.

use boresight_wave::{Aperture, Exposures, Sampling, VonKarman, Wave, WaveError, even_layers};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::{PI, TAU};

const WAVELENGTH_M: f64 = 1.064e-6; // [m]
const DRAWS: u32 = 200;

fn main() -> Result<(), WaveError> {
    println!(
        "range Cn2 W0: D/r0; 1/e² radius in vacuum, short, long, wander [mm]; variance of the log peak"
    );
    for (range_m, cn2, w0_m) in [
        (1000.0, 1e-15, 0.05),
        (500.0, 1e-14, 0.05),
        (1000.0, 1e-14, 0.025),
        (1000.0, 1e-14, 0.05),
        (2000.0, 1e-14, 0.05),
        (1000.0, 1e-14, 0.1),
        (1000.0, 5e-14, 0.05),
        (500.0, 1e-13, 0.05),
    ] {
        row(range_m, cn2, w0_m)?;
    }
    Ok(())
}

fn row(range_m: f64, cn2: f64, w0_m: f64) -> Result<(), WaveError> {
    let beam = Aperture {
        power_w: 1.0,
        radius_m: w0_m,
        clear_radius_m: f64::INFINITY,
        wavelength_m: WAVELENGTH_M,
        m2: 1.0,
        focus_m: range_m,
    };
    let layers = even_layers(range_m, 10, |_| (cn2, [0.0; 2]));
    let grid = Sampling::grid(&beam, &layers, range_m)?;
    let spectrum = VonKarman {
        outer_m: 300.0,
        inner_m: 0.0,
    };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut normal = move || StandardNormal.sample(&mut rng);
    let mut exposures = Exposures::new(grid);
    let (mut sum, mut square) = (0.0, 0.0);
    for _ in 0..DRAWS {
        let mut wave = Wave::new(grid, &spectrum, layers.clone(), range_m, 1, &mut normal);
        let spot = wave.send(&beam, 0.0);
        let log = spot.peak_wpm2().ln();
        (sum, square) = (sum + log, square + log * log);
        exposures.add(&spot);
    }
    let draws = f64::from(DRAWS);
    let k = TAU / WAVELENGTH_M;
    let fried_m = (0.423 * k * k * cn2 * range_m * 3.0 / 8.0).powf(-0.6);
    let long_m = (2.0 / (PI * exposures.long().at_wpm2(0.0, 0.0))).sqrt();
    println!(
        "{range_m} m {cn2:e} {w0_m} m: {:.2}; {:.2} {:.2} {:.2} {:.2}; {:.4}",
        2.0 * w0_m / fried_m,
        1e3 * WAVELENGTH_M * range_m / (PI * w0_m),
        1e3 * exposures.short().radius_m(),
        1e3 * long_m,
        1e3 * exposures.wander_rms_m(),
        square / draws - (sum / draws).powi(2),
    );
    Ok(())
}
