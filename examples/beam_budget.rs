//! The beam by itself, without a run and without an engine: spot and irradiance over range, in vacuum and in air.
//!
//! `cargo run --release --example beam_budget`

use boresight::models::air::atmosphere::{Cn2Profile, extinction_per_m, transmittance};
use boresight::models::air::turbulence::{AirPath, PathTurbulence};
use boresight::models::laser::beam::{Laser, peak_irradiance_wpm2};

/// The beam at one range.
pub struct AtRange {
    /// Range [m].
    pub range_m: f64,
    /// Long-term 1/e² radius in vacuum and in air [m].
    pub radius_m: [f64; 2],
    /// Mean irradiance in the middle of the spot, in vacuum and in air [W/m²].
    pub peak_wpm2: [f64; 2],
}

/// A beam of 10 kW focused at the target, 20 m above the ground on a sunny day with 10 km of visibility.
pub fn budget(ranges_m: &[f64]) -> Vec<AtRange> {
    let laser = Laser {
        power_w: 10e3,          // [W]
        wavelength_m: 1.064e-6, // [m]
        aperture_radius_m: 0.1, // [m]
        m2: 1.5,
    };
    let cn2 = Cn2Profile::HufnagelValley {
        wind_mps: 21.0,  // [m/s]
        ground: 1.7e-14, // [m^-2/3]
    };
    let per_m = extinction_per_m(10e3, laser.wavelength_m);
    let at = |range_m: f64| {
        let path = AirPath {
            length_m: range_m,
            h0_m: 20.0, // [m]
            h1_m: 20.0, // [m]
        };
        let turbulence = PathTurbulence::new(&cn2, &path, laser.wavelength_m, 20.0); // [m]
        let vacuum_m = laser.spot_radius_m(range_m, range_m);
        let air_m = laser.long_term_radius_m(range_m, range_m, &turbulence);
        let left_w = laser.power_w * transmittance(per_m, range_m);
        AtRange {
            range_m,
            radius_m: [vacuum_m, air_m],
            peak_wpm2: [
                peak_irradiance_wpm2(laser.power_w, vacuum_m),
                peak_irradiance_wpm2(left_w, air_m),
            ],
        }
    };
    ranges_m.iter().copied().map(at).collect()
}

#[allow(dead_code)] // The tests call the function above.
fn main() {
    for AtRange {
        range_m,
        radius_m: [vacuum_m, air_m],
        peak_wpm2: [vacuum_wpm2, air_wpm2],
    } in budget(&[500.0, 1_000.0, 2_000.0, 4_000.0])
    {
        println!(
            "{range_m:5} m: {:.1} mm and {:.2} MW/m² in vacuum, {:.1} mm and {:.2} MW/m² in air",
            1e3 * vacuum_m,
            1e-6 * vacuum_wpm2,
            1e3 * air_m,
            1e-6 * air_wpm2
        );
    }
}
