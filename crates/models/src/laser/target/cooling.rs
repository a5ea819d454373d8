//! Heat that a face loses to the air and its surroundings.

use crate::maths::kinematics::GRAVITY_MPS2;

/// Stefan–Boltzmann constant [W/(m² K⁴)] (CODATA 2018).
pub(super) const STEFAN_BOLTZMANN: f64 = 5.670374419e-8;
/// Specific gas constant of dry air [J/(kg K)] (ICAO standard atmosphere).
const R_DRY: f64 = 287.053;
/// Pressure for the film properties of air [Pa]: sea level, within 5 % in the lowest 400 m.
const PRESSURE_PA: f64 = 101_325.0;
/// Prandtl number of air near 300 K (Incropera et al., Fundamentals of Heat and Mass Transfer, 7th ed., table A.4).
const PRANDTL: f64 = 0.707;

/// The air over a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// Temperature of the air and of the surroundings [K].
    pub air_k: f64,
    /// Speed of the air over the face [m/s].
    pub wind_mps: f64,
    /// Length of the face along the flow [m].
    pub length_m: f64,
}

impl Film {
    /// Coefficient of convection [W/(m² K)] from a face of a temperature [K]: forced or natural, whichever is greater.
    ///
    /// Mean Nusselt number of a flat plate, laminar, then mixed past Re = 5e5 (Incropera, eqs. 7.30 and 7.38); of a
    /// vertical plate in still air Nu = 0.59 Ra^(1/4) (McAdams; Incropera, eq. 9.24).
    pub fn convection_wpm2k(&self, face_k: f64) -> f64 {
        let air_k = self.air_k;
        // Sutherland's viscosity (White, Viscous Fluid Flow, table 1-2); cp = 1006 J/(kg K) gives the conductivity.
        let mu = 1.716e-5 * (air_k / 273.15).powf(1.5) * (273.15 + 110.4) / (air_k + 110.4);
        let nu = mu * R_DRY * air_k / PRESSURE_PA; // [m²/s]
        let conductivity = mu * 1006.0 / PRANDTL; // [W/(m K)]
        let re = self.wind_mps.abs() * self.length_m / nu;
        let nusselt = PRANDTL.cbrt()
            * if re < 5e5 {
                0.664 * re.sqrt()
            } else {
                0.037 * re.powf(0.8) - 871.0
            };
        let forced = nusselt * conductivity / self.length_m;
        let excess_k = (face_k - air_k).abs();
        let rayleigh =
            GRAVITY_MPS2 * excess_k * self.length_m.powi(3) * PRANDTL / (air_k * nu * nu);
        let natural = 0.59 * rayleigh.sqrt().sqrt() * conductivity / self.length_m;
        forced.max(natural)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film(wind_mps: f64) -> Film {
        Film {
            air_k: 293.15,
            wind_mps,
            length_m: 0.2,
        }
    }

    #[test]
    fn forced_convection_has_the_textbook_value() {
        // Laminar plate of 0.2 m in 10 m/s at 20 °C with nu = 15.11e-6, k = 0.02570, Pr = 0.707
        // (table values at 293 K): h = 0.664 sqrt(132 363) 0.8909 0.1285 = 27.66 W/(m² K).
        let found = film(10.0).convection_wpm2k(343.15);
        assert!((found / 27.66 - 1.0).abs() < 0.02, "{found}");
    }

    #[test]
    fn still_air_still_cools() {
        // Ra = 9.81 (50/293) 0.2³ 0.707/(15.11e-6)² = 4.15e7, Nu = 47.3, h = 6.08 W/(m² K).
        let found = film(0.0).convection_wpm2k(343.15);
        assert!((found / 6.08 - 1.0).abs() < 0.02, "{found}");
    }
}
