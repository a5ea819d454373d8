//! Lumped heating of a UAV skin under a laser spot.
//!
//! Assumptions: uniform temperature over the spot and through the skin (thin: the diffusion time
//! through it is short against the dwell), adiabatic back (still air inside), no conduction along
//! the skin (a lower bound on the time for aluminium spots of a few mm; plastics and composites
//! conduct little), constant properties, no latent heat and no ablation. Failure is the first time
//! the temperature reaches the material's limit: loss of function, not perforation.

use crate::maths::kinematics::GRAVITY_MPS2;

/// Stefan–Boltzmann constant [W/(m^2 K^4)] (CODATA 2018).
const STEFAN_BOLTZMANN: f64 = 5.670374419e-8;
/// Specific gas constant of dry air [J/(kg K)] (ICAO standard atmosphere).
const R_DRY: f64 = 287.053;
/// Pressure for the film properties of air [Pa]: sea level, within 5 % in the lowest 400 m.
const PRESSURE_PA: f64 = 101_325.0;
/// Prandtl number of air near 300 K [-] (Incropera et al., Fundamentals of Heat and Mass Transfer,
/// 7th ed., table A.4).
const PRANDTL: f64 = 0.707;

/// Material of a skin, with the properties that decide how the laser heats it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinMaterial {
    /// Name for reports.
    pub name: &'static str,
    /// Mass per area [kg/m^2]: density times the thickness that heats up.
    pub areal_density_kgpm2: f64,
    /// Specific heat [J/(kg K)].
    pub specific_heat_jpkgk: f64,
    /// Absorptivity at about 1 um [-].
    pub absorptivity: f64,
    /// Thermal emissivity [-].
    pub emissivity: f64,
    /// Temperature at which the part loses its function [K].
    pub failure_temperature_k: f64,
}

impl SkinMaterial {
    /// Time for which an irradiance [W/m²] must last until a skin at this temperature [K] fails, without cooling [s].
    pub fn failure_s(&self, irradiance_wpm2: f64, temperature_k: f64) -> f64 {
        let rise_k = (self.failure_temperature_k - temperature_k).max(0.0);
        let wanted_jpm2 = self.areal_density_kgpm2 * self.specific_heat_jpkgk * rise_k;
        wanted_jpm2 / (self.absorptivity * irradiance_wpm2)
    }
}

/// Dark polycarbonate shell, 1.5 mm.
///
/// 1200 kg/m^3, 1250 J/(kg K) and a glass transition at 147 °C are handbook values (Mark, Polymer
/// Data Handbook, Oxford 1999). The absorptivity is an assumption for carbon-black pigment (white or
/// clear shells absorb much less at 1 um); the emissivity is that of non-metals (Incropera A.11).
pub const POLYCARBONATE_SHELL: SkinMaterial = SkinMaterial {
    name: "polycarbonate shell",
    areal_density_kgpm2: 1.8,
    specific_heat_jpkgk: 1250.0,
    absorptivity: 0.9,
    emissivity: 0.9,
    failure_temperature_k: 420.0,
};

/// Dark ABS shell, 2 mm.
///
/// 1050 kg/m^3, 1400 J/(kg K) and a glass transition at 105 °C (Mark, Polymer Data Handbook, Oxford
/// 1999, styrene copolymers); optical values as for the polycarbonate shell.
pub const ABS_SHELL: SkinMaterial = SkinMaterial {
    name: "ABS shell",
    areal_density_kgpm2: 2.1,
    specific_heat_jpkgk: 1400.0,
    absorptivity: 0.9,
    emissivity: 0.9,
    failure_temperature_k: 378.0,
};

/// Carbon-fibre epoxy arm or plate, 1.5 mm.
///
/// 1400 kg/m^3 and 935 J/(kg K) at 300 K: graphite-fibre epoxy, Incropera table A.2. Failure at the
/// 180 °C glass transition of a 177 °C-cured epoxy (CMH-17), where the matrix stops carrying
/// compression; absorptivity and emissivity of black carbon, an assumption good to 0.1.
pub const CARBON_EPOXY: SkinMaterial = SkinMaterial {
    name: "carbon-fibre epoxy",
    areal_density_kgpm2: 2.1,
    specific_heat_jpkgk: 935.0,
    absorptivity: 0.9,
    emissivity: 0.85,
    failure_temperature_k: 453.0,
};

/// Outer 2 mm of a wrapped lithium-polymer pouch cell.
///
/// About 2200 kg/m^3 and 1000 J/(kg K) for the stack (assumption, typical of published cells); fails
/// when the polyethylene separator melts at 130 °C (Feng et al., Energy Storage Materials 10, 246,
/// 2018). The 2 mm are the depth heat reaches in about ten seconds across the layers.
pub const LIPO_POUCH: SkinMaterial = SkinMaterial {
    name: "LiPo pouch",
    areal_density_kgpm2: 4.4,
    specific_heat_jpkgk: 1000.0,
    absorptivity: 0.9,
    emissivity: 0.9,
    failure_temperature_k: 403.0,
};

/// A pouch cell behind the plastic shell of its pack: 1.5 mm of polycarbonate over [`LIPO_POUCH`].
///
/// Masses add and the specific heat is their mean by mass. The limit stays the separator's. That the
/// two warm as one is an assumption, and a crude one: heat takes some 15 s through such a shell, so
/// that a strong beam melts through it first.
pub const SHELLED_POUCH: SkinMaterial = SkinMaterial {
    name: "LiPo pouch in its shell",
    areal_density_kgpm2: POLYCARBONATE_SHELL.areal_density_kgpm2 + LIPO_POUCH.areal_density_kgpm2,
    specific_heat_jpkgk: (POLYCARBONATE_SHELL.areal_density_kgpm2
        * POLYCARBONATE_SHELL.specific_heat_jpkgk
        + LIPO_POUCH.areal_density_kgpm2 * LIPO_POUCH.specific_heat_jpkgk)
        / (POLYCARBONATE_SHELL.areal_density_kgpm2 + LIPO_POUCH.areal_density_kgpm2),
    absorptivity: 0.9,
    emissivity: 0.9,
    failure_temperature_k: 403.0,
};

/// Bell of an outrunner motor: a 1 mm steel flux ring over 1.5 mm of magnets.
///
/// 7850 kg/m^3 and 7500 kg/m^3, both near 450 J/(kg K) (handbook values of steel and sintered NdFeB).
/// Absorptivity 0.5 of a dark oxidised or painted bell at 1 um is an assumption good to 0.2; fails at
/// 150 °C, the highest working temperature of SH-grade magnets.
pub const MOTOR_BELL: SkinMaterial = SkinMaterial {
    name: "motor bell",
    areal_density_kgpm2: 19.1,
    specific_heat_jpkgk: 450.0,
    absorptivity: 0.5,
    emissivity: 0.8,
    failure_temperature_k: 423.0,
};

/// Anodised aluminium 6061 sheet, 1 mm.
///
/// 2700 kg/m^3, 896 J/(kg K), solidus 855 K (ASM Metals Handbook vol. 2). Absorptivity 0.14 (the solar
/// value, used at 1 um) and emissivity 0.84: anodised aluminium, Incropera table A.12.
pub const ALUMINIUM: SkinMaterial = SkinMaterial {
    name: "aluminium",
    areal_density_kgpm2: 2.7,
    specific_heat_jpkgk: 896.0,
    absorptivity: 0.14,
    emissivity: 0.84,
    failure_temperature_k: 855.0,
};

/// The heated patch of a UAV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skin {
    /// Temperature [K].
    pub temperature_k: f64,
    /// Length of the plate along the flow [m], for the convection correlations.
    pub length_m: f64,
}

impl Skin {
    /// Advances by `dt_s` [s] under the incident `irradiance_wpm2` [W/m^2] in air of
    /// `air_temperature_k` [K] that passes at `relative_wind_mps` [m/s].
    ///
    /// Rosenbrock–Euler step with the exact Jacobian: exact for constant coefficients, second order
    /// in the radiation and natural convection terms, stable for any `dt_s` (Hochbruck & Ostermann,
    /// Acta Numerica 19, 209, 2010).
    pub fn step(
        &mut self,
        dt_s: f64,
        irradiance_wpm2: f64,
        air_temperature_k: f64,
        relative_wind_mps: f64,
        material: &SkinMaterial,
    ) {
        let t = self.temperature_k;
        let (loss, slope) = self.loss_wpm2(air_temperature_k, relative_wind_mps, material);
        let capacity = material.areal_density_kgpm2 * material.specific_heat_jpkgk; // [J/(m^2 K)]
        let rate = (material.absorptivity * irradiance_wpm2 - loss) / capacity; // [K/s]
        let x = -slope / capacity * dt_s;
        // phi_1(x) = (e^x - 1)/x, 1 at zero.
        let phi = if x == 0.0 { 1.0 } else { x.exp_m1() / x };
        self.temperature_k = t + dt_s * rate * phi;
    }

    /// Whether the skin has reached the material's failure temperature.
    pub fn failed(&self, material: &SkinMaterial) -> bool {
        self.temperature_k >= material.failure_temperature_k
    }

    /// Heat lost to the air and the surroundings [W/m^2] and its derivative [W/(m^2 K)] with respect
    /// to the skin temperature.
    fn loss_wpm2(&self, air_k: f64, wind_mps: f64, material: &SkinMaterial) -> (f64, f64) {
        let t = self.temperature_k;
        let excess = t - air_k;
        // Sutherland's viscosity (White, Viscous Fluid Flow, table 1-2) at air temperature; the
        // conductivity follows from the Prandtl number and cp = 1006 J/(kg K).
        let mu = 1.716e-5 * (air_k / 273.15).powf(1.5) * (273.15 + 110.4) / (air_k + 110.4);
        let nu = mu * R_DRY * air_k / PRESSURE_PA; // [m^2/s]
        let conductivity = mu * 1006.0 / PRANDTL; // [W/(m K)]

        // Mean Nusselt number of a flat plate, laminar, then mixed past Re = 5e5 (Incropera
        // eqs. 7.30 and 7.38).
        let re = wind_mps.abs() * self.length_m / nu;
        let nusselt = PRANDTL.cbrt()
            * if re < 5e5 {
                0.664 * re.sqrt()
            } else {
                0.037 * re.powf(0.8) - 871.0
            };
        let forced = nusselt * conductivity / self.length_m; // [W/(m^2 K)]
        // Vertical plate in still air, Nu = 0.59 Ra^(1/4) (McAdams; Incropera eq. 9.24).
        let rayleigh =
            GRAVITY_MPS2 * excess.abs() * self.length_m.powi(3) * PRANDTL / (air_k * nu * nu);
        let natural = 0.59 * rayleigh.sqrt().sqrt() * conductivity / self.length_m;
        // The natural coefficient goes as |T - Ta|^(1/4): its flux has 5/4 of its slope.
        let (convection, convection_slope) = if forced >= natural {
            (forced, forced)
        } else {
            (natural, 1.25 * natural)
        };
        let radiation = material.emissivity * STEFAN_BOLTZMANN;
        (
            convection * excess + radiation * (t.powi(4) - air_k.powi(4)),
            convection_slope + 4.0 * radiation * t.powi(3),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AIR_K: f64 = 293.15;

    fn skin() -> Skin {
        Skin {
            temperature_k: AIR_K,
            length_m: 0.2,
        }
    }

    /// A material that does not radiate: linear under forced convection.
    fn linear() -> SkinMaterial {
        SkinMaterial {
            emissivity: 0.0,
            ..POLYCARBONATE_SHELL
        }
    }

    #[test]
    fn forced_convection_has_the_textbook_value() {
        // Laminar plate of 0.2 m in 10 m/s at 20 °C with nu = 15.11e-6, k = 0.02570, Pr = 0.707
        // (table values at 293 K): h = 0.664 sqrt(132 363) 0.8909 0.1285 = 27.66 W/(m^2 K).
        let mut hot = skin();
        hot.temperature_k += 50.0;
        let (loss, slope) = hot.loss_wpm2(AIR_K, 10.0, &linear());
        assert!((loss / 50.0 / 27.66 - 1.0).abs() < 0.02, "{}", loss / 50.0);
        assert!((slope * 50.0 / loss - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_skin_under_a_strong_beam_fails_when_its_heat_says() {
        const IRRADIANCE_WPM2: f64 = 1e6;
        for material in [ABS_SHELL, CARBON_EPOXY] {
            let expected_s = material.failure_s(IRRADIANCE_WPM2, AIR_K);
            let (mut hot, mut t_s) = (skin(), 0.0);
            while !hot.failed(&material) {
                hot.step(1e-4, IRRADIANCE_WPM2, AIR_K, 10.0, &material);
                t_s += 1e-4;
            }
            // Cooling takes half a percent by then.
            assert!((t_s / expected_s - 1.0).abs() < 0.01, "{t_s} {expected_s}");
            assert_eq!(material.failure_s(IRRADIANCE_WPM2, 1e3), 0.0);
        }
    }

    #[test]
    fn still_air_still_cools() {
        // Ra = 9.81 (50/293) 0.2^3 0.707/(15.11e-6)^2 = 4.15e7, Nu = 47.3, h = 6.08 W/(m^2 K).
        let mut hot = skin();
        hot.temperature_k += 50.0;
        let (loss, slope) = hot.loss_wpm2(AIR_K, 0.0, &linear());
        assert!((loss / 50.0 / 6.08 - 1.0).abs() < 0.02, "{}", loss / 50.0);
        assert!((slope * 50.0 / loss - 1.25).abs() < 1e-12);
    }

    #[test]
    fn jacobian_is_the_derivative_of_the_loss() {
        for (wind, t) in [(0.0, 500.0), (15.0, 700.0), (60.0, 400.0)] {
            let at = |t| {
                Skin {
                    temperature_k: t,
                    length_m: 0.5,
                }
                .loss_wpm2(AIR_K, wind, &CARBON_EPOXY)
            };
            let numeric = (at(t + 1e-3).0 - at(t - 1e-3).0) / 2e-3;
            assert!((at(t).1 / numeric - 1.0).abs() < 1e-7);
        }
    }

    #[test]
    fn linear_heating_is_exact_at_any_step() {
        let material = linear();
        let (wind, irradiance, end) = (12.0, 2e5, 4.0);
        let h = {
            let mut hot = skin();
            hot.temperature_k += 1.0;
            hot.loss_wpm2(AIR_K, wind, &material).0
        };
        let tau = material.areal_density_kgpm2 * material.specific_heat_jpkgk / h;
        let rise = material.absorptivity * irradiance / h;
        let exact = AIR_K + rise * (1.0 - (-end / tau).exp());
        for steps in [4000, 200, 1] {
            let mut skin = skin();
            for _ in 0..steps {
                skin.step(end / f64::from(steps), irradiance, AIR_K, wind, &material);
            }
            assert!((skin.temperature_k / exact - 1.0).abs() < 1e-11);
        }
    }

    #[test]
    fn time_to_failure_is_the_closed_form() {
        let material = linear();
        let (wind, irradiance, dt) = (12.0, 3e5, 1e-3);
        let mut hot = skin();
        hot.temperature_k += 1.0;
        let h = hot.loss_wpm2(AIR_K, wind, &material).0;
        let tau = material.areal_density_kgpm2 * material.specific_heat_jpkgk / h;
        let rise = material.absorptivity * irradiance / h;
        let expected = -tau * (1.0 - (material.failure_temperature_k - AIR_K) / rise).ln();
        let mut skin = skin();
        let mut t = 0.0;
        while !skin.failed(&material) {
            skin.step(dt, irradiance, AIR_K, wind, &material);
            t += dt;
        }
        assert!(t - expected >= 0.0 && t - expected <= dt, "{t} {expected}");
    }

    #[test]
    fn nonlinear_heating_matches_a_fine_runge_kutta() {
        for (material, wind, irradiance) in [
            (CARBON_EPOXY, 8.0, 1e6),
            (POLYCARBONATE_SHELL, 0.0, 2e5),
            (ALUMINIUM, 3.0, 5e6),
        ] {
            let capacity = material.areal_density_kgpm2 * material.specific_heat_jpkgk;
            let rate = |t: f64| {
                let at = Skin {
                    temperature_k: t,
                    length_m: 0.2,
                };
                (material.absorptivity * irradiance - at.loss_wpm2(AIR_K, wind, &material).0)
                    / capacity
            };
            let (end, fine) = (3.0, 60_000);
            let dt = end / f64::from(fine);
            let mut t = AIR_K;
            for _ in 0..fine {
                let k1 = rate(t);
                let k2 = rate(t + 0.5 * dt * k1);
                let k3 = rate(t + 0.5 * dt * k2);
                let k4 = rate(t + dt * k3);
                t += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
            }
            for (steps, tolerance) in [(3000, 1e-7), (150, 1e-5)] {
                let mut skin = skin();
                for _ in 0..steps {
                    skin.step(end / f64::from(steps), irradiance, AIR_K, wind, &material);
                }
                let error = skin.temperature_k / t - 1.0;
                assert!(error.abs() < tolerance, "{error}");
            }
        }
    }

    #[test]
    fn absurd_steps_stay_stable_and_find_equilibrium() {
        let mut skin = skin();
        for _ in 0..100 {
            skin.step(1e4, 1e6, AIR_K, 5.0, &CARBON_EPOXY);
            assert!(skin.temperature_k.is_finite() && skin.temperature_k > AIR_K);
        }
        // At equilibrium what is absorbed is lost.
        let (loss, _) = skin.loss_wpm2(AIR_K, 5.0, &CARBON_EPOXY);
        assert!((loss / (CARBON_EPOXY.absorptivity * 1e6) - 1.0).abs() < 1e-9);
    }
}
