//! The optics of a path: extinction by aerosol and precipitation, air-light, air density and
//! optical turbulence strength with height.

/// Koschmieder's constant: extinction times visibility at 2 % contrast, -ln(0.02), as rounded
/// by Kim.
pub const KOSCHMIEDER: f64 = 3.912;

/// Aerosol extinction coefficient [1/m] at `wavelength_m` [m] for a meteorological visibility
/// `visibility_m` [m], after Koschmieder (2 % contrast, at 550 nm) and Kim, McArthur & Korevaar,
/// Proc. SPIE 4214 (2001).
///
/// Molecular absorption lines are not in it: it holds in the windows (0.55 to 1.1 um, 1.5 to
/// 1.6 um). A visibility that is not positive gives an infinite extinction.
pub fn extinction_per_m(visibility_m: f64, wavelength_m: f64) -> f64 {
    if visibility_m <= 0.0 {
        return f64::INFINITY;
    }
    let q = kim_exponent(visibility_m);
    KOSCHMIEDER / visibility_m * (wavelength_m / 550e-9).powf(-q)
}

/// Kim's exponent q for a meteorological visibility [m]: extinction by aerosol goes as the
/// wavelength to the power of -q. Thick fog is grey (q = 0).
pub fn kim_exponent(visibility_m: f64) -> f64 {
    match visibility_m * 1e-3 {
        km if km > 50.0 => 1.6,
        km if km > 6.0 => 1.3,
        km if km > 1.0 => 0.16 * km + 0.34,
        km if km > 0.5 => km - 0.5,
        _ => 0.0,
    }
}

/// What falls from the sky.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hydrometeor {
    /// Rain or drizzle.
    Rain,
    /// Snow that melts.
    WetSnow,
    /// Snow below freezing.
    DrySnow,
}

/// Extinction coefficient [1/m] of precipitation that falls at `rate_mmph` [mm/h of water].
///
/// Carbonneau & Wisely's rain (Proc. SPIE 3232, 1998) and the snow of ITU-R P.1817-1, table 2.
/// Drops and flakes are many wavelengths wide, so one value serves from the visible to 1.6 um: the
/// snow's is that at 550 nm, 0.6 (dry) to 1.4 % (wet) below the one at 1100 nm.
pub fn precipitation_extinction_per_m(falls: Hydrometeor, rate_mmph: f64) -> f64 {
    const DECIBEL_PER_KM: f64 = std::f64::consts::LN_10 / 10.0 * 1e-3; // [1/m]
    const NM: f64 = 550.0; // [nm]
    let (scale, power) = match falls {
        Hydrometeor::Rain => (1.076, 0.67),
        Hydrometeor::WetSnow => (1.023e-4 * NM + 3.7855466, 0.72),
        Hydrometeor::DrySnow => (5.42e-5 * NM + 5.4958776, 1.38),
    };
    scale * rate_mmph.max(0.0).powf(power) * DECIBEL_PER_KM
}

/// Transmittance [-] of `path_m` [m] of air with extinction `beta_per_m` [1/m] (Beer–Lambert).
pub fn transmittance(beta_per_m: f64, path_m: f64) -> f64 {
    (-beta_per_m * path_m).exp()
}

/// Apparent radiance at `range_m` [m] of a surface of radiance `l0`: the paper's eq. 5 restored,
/// `L0 exp(-beta R) + l_inscatter (1 - exp(-beta R))`.
///
/// `l_inscatter` is (sigma_s / beta) L_sun, the air-light of an infinitely deep path, in the unit of
/// `l0`. Single scattering, homogeneous air.
pub fn airlight(l0: f64, beta_per_m: f64, range_m: f64, l_inscatter: f64) -> f64 {
    let depth = beta_per_m * range_m;
    l0 * (-depth).exp() - l_inscatter * (-depth).exp_m1()
}

/// Specific gas constant of dry air [J/(kg K)]: CODATA 2018 R = 8.314462618 over the molar mass
/// 28.96546 g/mol of CIPM-2007 (Picard et al., Metrologia 45, 149, 2008).
const R_DRY: f64 = 8.314462618 / 28.96546e-3;
/// Specific gas constant of water vapour [J/(kg K)], molar mass 18.01528 g/mol (CIPM-2007).
const R_VAPOUR: f64 = 8.314462618 / 18.01528e-3;

/// Pressure [Pa] at `altitude_m` [m] in the standard atmosphere whose pressure at sea level is
/// `sea_level_pa` [Pa] (ICAO Doc 7488: 6.5 K/km below 11 km), as altimeters compute it.
pub fn pressure_at_pa(sea_level_pa: f64, altitude_m: f64) -> f64 {
    const LAPSE_KPM: f64 = 6.5e-3; // [K/m]
    const SEA_LEVEL_K: f64 = 288.15; // [K]
    const EXPONENT: f64 = 5.255_88; // g M / (R LAPSE)
    sea_level_pa * (1.0 - LAPSE_KPM / SEA_LEVEL_K * altitude_m).powf(EXPONENT)
}

/// Density [kg/m^3] of moist air at `pressure_pa` [Pa], `temperature_k` [K] and
/// `relative_humidity` in 0..1.
///
/// Ideal mixture of dry air and vapour; saturation pressure over water by the Magnus form of
/// Alduchov & Eskridge, J. Appl. Meteor. 35, 601 (1996), eq. 21, good to 0.4 % from -40 to 50 °C.
pub fn air_density_kgpm3(pressure_pa: f64, temperature_k: f64, relative_humidity: f64) -> f64 {
    let t_c = temperature_k - 273.15;
    let e_pa = relative_humidity * 610.94 * (17.625 * t_c / (t_c + 243.04)).exp();
    ((pressure_pa - e_pa) / R_DRY + e_pa / R_VAPOUR) / temperature_k
}

/// Strength of optical turbulence Cn² [m^-2/3] as a function of height above the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cn2Profile {
    /// The same Cn² [m^-2/3] everywhere: a horizontal path.
    Constant(f64),
    /// Hufnagel–Valley (Valley, Appl. Opt. 19, 574, 1980): pseudo-wind `wind_mps` [m/s] (rms speed
    /// from 5 to 20 km) and ground term `ground` [m^-2/3]. HV-5/7 is 21 m/s and 1.7e-14.
    HufnagelValley {
        /// Pseudo-wind [m/s].
        wind_mps: f64,
        /// Ground term A [m^-2/3].
        ground: f64,
    },
    /// Surface layer over a city by Monin–Obukhov similarity (Wyngaard, Izumi & Collins, J. Opt.
    /// Soc. Am. 61, 1646, 1971): z^-4/3 in free convection (day), z^-2/3 in neutral or stable air
    /// (night), z counted from the displacement height of the roofs.
    ///
    /// Valid above the roughness sublayer and inside the surface layer (some 100 m by day); within
    /// 1 m of the displacement height it is held constant.
    Urban {
        /// Cn² [m^-2/3] at `height_ref_m`.
        cn2_ref: f64,
        /// Height above the displacement height [m] at which `cn2_ref` holds.
        height_ref_m: f64,
        /// Zero-plane displacement [m]; about 0.7 of the mean building height (Grimmond & Oke,
        /// J. Appl. Meteor. 38, 1262, 1999).
        displacement_m: f64,
        /// Convective day, else night.
        day: bool,
    },
}

impl Cn2Profile {
    /// Cn² [m^-2/3] at `height_m` [m] above the ground.
    pub fn cn2(&self, height_m: f64) -> f64 {
        match *self {
            Self::Constant(cn2) => cn2,
            Self::HufnagelValley { wind_mps, ground } => {
                let h = height_m.max(0.0);
                0.00594 * (wind_mps / 27.0).powi(2) * (1e-5 * h).powi(10) * (-h / 1000.0).exp()
                    + 2.7e-16 * (-h / 1500.0).exp()
                    + ground * (-h / 100.0).exp()
            }
            Self::Urban {
                cn2_ref,
                height_ref_m,
                displacement_m,
                day,
            } => {
                let z = (height_m - displacement_m).max(1.0); // [m]
                let root = (z / height_ref_m).cbrt();
                let night = 1.0 / (root * root);
                cn2_ref * if day { night * night } else { night }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(value: f64, expected: f64, relative: f64) {
        assert!(
            (value / expected - 1.0).abs() < relative,
            "{value} against {expected}"
        );
    }

    #[test]
    fn extinction_has_the_published_values() {
        // Koschmieder and Kim worked by hand, to four digits.
        close(extinction_per_m(23e3, 1064e-9), 0.0721e-3, 1e-3);
        close(extinction_per_m(5e3, 1064e-9), 0.3687e-3, 2e-4);
        close(extinction_per_m(1e3, 1064e-9), 2.8126e-3, 2e-5);
    }

    #[test]
    fn pressure_falls_as_in_the_standard_atmosphere() {
        // ICAO Doc 7488, table 1 [Pa].
        for (altitude_m, pressure_pa) in [
            (-500.0, 107_478.0),
            (0.0, 101_325.0),
            (500.0, 95_461.0),
            (1_000.0, 89_875.0),
            (5_000.0, 54_020.0),
            (9_000.0, 30_742.0),
        ] {
            // The table is by geopotential height up to a metre or so here.
            close(pressure_at_pa(101_325.0, altitude_m), pressure_pa, 2e-3);
        }
    }

    #[test]
    fn every_kim_branch_has_its_exponent() {
        for (v_m, q) in [
            (60e3, 1.6),
            (50e3, 1.3),
            (3e3, 0.82),
            (0.75e3, 0.25),
            (0.3e3, 0.0),
        ] {
            let ratio = extinction_per_m(v_m, 1100e-9) / extinction_per_m(v_m, 550e-9);
            close(ratio, 2f64.powf(-q), 1e-12);
            close(extinction_per_m(v_m, 550e-9), 3.912 / v_m, 1e-15);
        }
        assert_eq!(extinction_per_m(0.0, 1e-6), f64::INFINITY);
    }

    #[test]
    fn precipitation_has_the_published_values() {
        // dB/km, by hand: 1.076 R^0.67, and a S^b at 550 nm.
        for (falls, rate_mmph, decibel_per_km) in [
            (Hydrometeor::Rain, 0.0, 0.0),
            (Hydrometeor::Rain, 1.0, 1.076),
            (Hydrometeor::Rain, 10.0, 5.0330),
            (Hydrometeor::Rain, 50.0, 14.795),
            (Hydrometeor::WetSnow, 1.0, 3.8418),
            (Hydrometeor::WetSnow, 5.0, 12.240),
            (Hydrometeor::DrySnow, 1.0, 5.5257),
            (Hydrometeor::DrySnow, 5.0, 50.930),
        ] {
            let kept = transmittance(precipitation_extinction_per_m(falls, rate_mmph), 1e3);
            let loss = -10.0 * kept.log10();
            assert!(
                (loss - decibel_per_km).abs() <= 1e-4 * decibel_per_km,
                "{falls:?} {rate_mmph}: {loss}"
            );
        }
    }

    #[test]
    fn contrast_at_the_visibility_is_two_percent() {
        let v = 10e3;
        let beta = extinction_per_m(v, 550e-9);
        close(transmittance(beta, v), 0.02, 1e-3);
        // A black target against the horizon: (L_horizon - L) / L_horizon.
        let contrast = 1.0 - airlight(0.0, beta, v, 1.0);
        close(contrast, 0.02, 1e-3);
    }

    #[test]
    fn airlight_has_its_limits() {
        assert_eq!(airlight(3.0, 1e-4, 0.0, 7.0), 3.0);
        close(airlight(3.0, 1e-2, 1e5, 7.0), 7.0, 1e-15);
        // A surface as bright as the air-light stays so at any range.
        close(airlight(7.0, 1e-4, 1234.0, 7.0), 7.0, 1e-15);
        // Thin limit: the first order of the series, second order (1e-18) below the tolerance.
        let beta = 1e-12;
        close(airlight(0.0, beta, 1e3, 7.0), 7.0 * beta * 1e3, 2e-9);
    }

    #[test]
    fn density_of_standard_and_moist_air() {
        // ICAO standard atmosphere at sea level: 1.2250 kg/m^3.
        close(air_density_kgpm3(101_325.0, 288.15, 0.0), 1.2250, 1e-4);
        // Saturation pressure at 20 °C is 2339.2 Pa (IAPWS-95): the vapour lowers the density by
        // (1/R_d - 1/R_v) e / T.
        let drop =
            air_density_kgpm3(101_325.0, 293.15, 0.0) - air_density_kgpm3(101_325.0, 293.15, 1.0);
        close(drop, (1.0 / 287.05 - 1.0 / 461.52) * 2339.2 / 293.15, 5e-3);
    }

    #[test]
    fn profiles_scale_as_published() {
        let hv57 = Cn2Profile::HufnagelValley {
            wind_mps: 21.0,
            ground: 1.7e-14,
        };
        close(hv57.cn2(0.0), 1.7e-14 + 2.7e-16, 1e-12);
        let urban = |day| Cn2Profile::Urban {
            cn2_ref: 1e-14,
            height_ref_m: 10.0,
            displacement_m: 15.0,
            day,
        };
        close(urban(true).cn2(25.0), 1e-14, 1e-12);
        close(urban(true).cn2(95.0), 1e-14 / 16.0, 1e-12); // 8^(-4/3)
        close(urban(false).cn2(95.0), 1e-14 / 4.0, 1e-12); // 8^(-2/3)
        // Between the houses: held at the 1 m value, never singular.
        close(urban(false).cn2(5.0), 1e-14 * 100f64.cbrt(), 1e-12);
    }
}
