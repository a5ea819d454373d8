//! How much light the air throws into a direction: aerosol, drops and molecules.

use std::f64::consts::PI;

/// Phase functions and albedos of what scatters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParticleOptics {
    /// Extinction over backscatter [sr].
    pub lidar_ratio_sr: f64,
    /// Scattering over extinction.
    pub albedo: f64,
    /// Asymmetry of the forward lobe.
    pub forward: f64,
}

/// Asymmetry of the backward lobe of either kind: chosen, of the width that Mie computations show within some 30° of
/// the way back.
const BACKWARD: f64 = -0.5;

/// Urban aerosol: lidar ratios of 45 to 60 sr at 532 nm (Müller et al., J. Geophys. Res. 112, D16202, 2007: 53 to 58 sr
/// over European and Asian cities; recalled), albedo as the beam's heating has it, asymmetry usual for haze.
pub const URBAN: ParticleOptics = ParticleOptics {
    lidar_ratio_sr: 50.0, // [sr]
    albedo: 0.9,
    forward: 0.7,
};

/// Drops of fog, drizzle and rain: 18.5 sr (O'Connor, Illingworth & Hogan, J. Atmos. Oceanic Technol. 21, 777, 2004, for
/// stratocumulus), no absorption below 1.1 µm.
pub const DROPS: ParticleOptics = ParticleOptics {
    lidar_ratio_sr: 18.5, // [sr]
    albedo: 1.0,
    forward: 0.85,
};

/// Visibility below which haze is fog, of drops [m] (WMO-No. 407).
pub const FOG_VISIBILITY_M: f64 = 1_000.0;

impl ParticleOptics {
    /// The share of the scattering in the backward lobe that gives the lidar ratio.
    fn backward_share(&self) -> f64 {
        let wanted = 1.0 / (self.lidar_ratio_sr * self.albedo);
        let [forward, backward] =
            [self.forward, BACKWARD].map(|g| henyey_greenstein_per_sr(g, -1.0));
        ((wanted - forward) / (backward - forward)).clamp(0.0, 1.0)
    }

    /// Scattering into a direction over extinction [1/sr], by the cosine of the angle that light is turned through: two
    /// lobes of Henyey and Greenstein (Kattawar, J. Quant. Spectrosc. Radiat. Transfer 15, 839, 1975), mixed so that
    /// straight back it is one over the lidar ratio.
    pub fn per_sr(&self, cos_turned: f64) -> f64 {
        let back = self.backward_share();
        let [forward, backward] =
            [self.forward, BACKWARD].map(|g| henyey_greenstein_per_sr(g, cos_turned));
        self.albedo * ((1.0 - back) * forward + back * backward)
    }
}

/// The phase function of Henyey and Greenstein (Astrophys. J. 93, 70, 1941) [1/sr], 1 over the sphere.
fn henyey_greenstein_per_sr(g: f64, cos_turned: f64) -> f64 {
    let spread = 1.0 + g * g - 2.0 * g * cos_turned;
    (1.0 - g * g) / (4.0 * PI * spread * spread.sqrt())
}

/// Scattering of clean air at sea level [1/m] at `wavelength_m` [m]: 1.16e-5 at 550 nm, falling with the power 4.08 (fit
/// to Bucholtz, Appl. Opt. 34, 2765, 1995; good to 2 % from 400 to 1100 nm).
pub fn molecular_per_m(wavelength_m: f64) -> f64 {
    1.16e-5 * (550e-9 / wavelength_m).powf(4.08) // [1/m]
}

/// The air that light of one wavelength crosses, the same everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatteringAir {
    /// Whole extinction [1/m].
    pub extinction_per_m: f64,
    /// Its part by haze or fog [1/m], without the molecules'.
    pub particles_per_m: f64,
    /// What those are.
    pub particles: ParticleOptics,
    /// Its part by what falls [1/m].
    pub falling_per_m: f64,
    /// Its part by molecules [1/m].
    pub molecules_per_m: f64,
}

impl ScatteringAir {
    /// The air of a visibility [m] for light of `wavelength_m` [m]: extinction by the aerosol with the molecules, and by
    /// all together [1/m].
    pub fn new(
        visibility_m: f64,
        wavelength_m: f64,
        [aerosol_per_m, extinction_per_m]: [f64; 2],
    ) -> Self {
        let molecules_per_m = molecular_per_m(wavelength_m).min(aerosol_per_m);
        Self {
            extinction_per_m,
            particles_per_m: aerosol_per_m - molecules_per_m,
            particles: if visibility_m < FOG_VISIBILITY_M {
                DROPS
            } else {
                URBAN
            },
            falling_per_m: (extinction_per_m - aerosol_per_m).max(0.0),
            molecules_per_m,
        }
    }

    /// Scattering into a direction [1/(m sr)], by the cosine of the angle that light is turned through.
    pub fn per_m_sr(&self, cos_turned: f64) -> f64 {
        let rayleigh_per_sr = 3.0 / (16.0 * PI) * (1.0 + cos_turned * cos_turned);
        self.particles_per_m * self.particles.per_sr(cos_turned)
            + self.falling_per_m * DROPS.per_sr(cos_turned)
            + self.molecules_per_m * rayleigh_per_sr
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_back_it_is_the_lidar_ratio_and_over_the_sphere_the_albedo() {
        for particles in [URBAN, DROPS] {
            let back = particles.per_sr(-1.0) * particles.lidar_ratio_sr;
            assert!((back - 1.0).abs() < 1e-12, "{back}");
            let count = 200_000;
            let whole: f64 = (0..count)
                .map(|i| {
                    let cos = 2.0 * (f64::from(i) + 0.5) / f64::from(count) - 1.0;
                    particles.per_sr(cos) * 4.0 * PI / f64::from(count)
                })
                .sum();
            assert!((whole / particles.albedo - 1.0).abs() < 1e-6, "{whole}");
            let share = particles.backward_share();
            assert!(share > 0.0 && share < 0.2, "{share}");
        }
    }

    #[test]
    fn molecules_send_back_three_over_eight_pi() {
        let air = ScatteringAir::new(1e12, 532e-9, [molecular_per_m(532e-9); 2]);
        let ratio_sr = air.molecules_per_m / air.per_m_sr(-1.0);
        assert!(
            (ratio_sr / (8.0 * PI / 3.0) - 1.0).abs() < 1e-12,
            "{ratio_sr}"
        );
    }
}
