//! What light of one wavelength is to a silicon camera, behind its colour filters and a filter before the lens.

use crate::optics::mosaic::Mosaic;
use crate::optics::sensor::PHOTONS_PER_LUX_S_M2;

/// Planck's constant times the speed of light [J m].
const HC_J_M: f64 = 6.626_070_15e-34 * 299_792_458.0;

/// Quantum efficiency of silicon over its greatest, by wavelength [nm]: read off, to some 20 %, the curve that makers of
/// global-shutter sensors of the IMX287's generation publish, and beyond 1000 nm the fall of silicon's absorption.
const SILICON: [(f64, f64); 18] = [
    (300.0, 0.0),
    (350.0, 0.3),
    (400.0, 0.65),
    (450.0, 0.9),
    (500.0, 0.98),
    (530.0, 1.0),
    (600.0, 0.92),
    (650.0, 0.82),
    (700.0, 0.68),
    (750.0, 0.53),
    (800.0, 0.41),
    (850.0, 0.29),
    (900.0, 0.19),
    (950.0, 0.11),
    (1000.0, 0.05),
    (1064.0, 0.014),
    (1100.0, 0.005),
    (1180.0, 0.0),
];

/// Transmission of the red, green and blue filters of a mosaic by wavelength [nm]: dyes as usual, which all let infrared
/// through from some 850 nm on.
const DYES: [(f64, [f64; 3]); 12] = [
    (380.0, [0.03, 0.03, 0.4]),
    (450.0, [0.03, 0.06, 0.95]),
    (490.0, [0.03, 0.45, 0.65]),
    (530.0, [0.05, 1.0, 0.15]),
    (570.0, [0.3, 0.8, 0.04]),
    (600.0, [0.95, 0.3, 0.03]),
    (650.0, [1.0, 0.12, 0.03]),
    (700.0, [1.0, 0.2, 0.1]),
    (750.0, [1.0, 0.4, 0.2]),
    (800.0, [1.0, 0.75, 0.65]),
    (850.0, [1.0, 0.98, 0.97]),
    (1200.0, [1.0, 1.0, 1.0]),
];

/// Linear between the points of a table whose first column rises; its ends go on.
fn between<T: Copy>(table: &[(f64, T)], x: f64, mix: impl Fn(T, T, f64) -> T) -> Option<T> {
    let last = table.last()?;
    if x >= last.0 {
        return Some(last.1);
    }
    let above = table.iter().position(|(at, _)| *at > x)?;
    match above.checked_sub(1) {
        None => Some(table[0].1),
        Some(below) => {
            let ((x0, y0), (x1, y1)) = (table[below], table[above]);
            Some(mix(y0, y1, (x - x0) / (x1 - x0)))
        }
    }
}

/// Quantum efficiency of silicon at `wavelength_m` [m] over its greatest.
pub fn silicon(wavelength_m: f64) -> f64 {
    between(&SILICON, wavelength_m * 1e9, |a, b, t| a + (b - a) * t).unwrap_or(0.0)
}

/// What the colour filters of a sensor let through at `wavelength_m` [m].
fn dyes(mosaic: Mosaic, wavelength_m: f64) -> [f64; 3] {
    if mosaic == Mosaic::Mono {
        return [1.0; 3];
    }
    let mix = |a: [f64; 3], b: [f64; 3], t: f64| [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * t);
    between(&DYES, wavelength_m * 1e9, mix).unwrap_or([1.0; 3])
}

/// A filter before the lens that blocks a band: a notch at a laser's line, or an infrared-cut filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockingFilter {
    /// Shortest and longest wavelength of the band [m].
    pub band_m: [f64; 2],
    /// Optical density in it: 10 to the power of minus this passes; 0 is no filter.
    pub density: f64,
}

impl BlockingFilter {
    /// No filter.
    pub const NONE: Self = Self {
        band_m: [0.0; 2],
        density: 0.0,
    };

    /// What passes at `wavelength_m` [m].
    pub fn passes(&self, wavelength_m: f64) -> f64 {
        if (self.band_m[0]..=self.band_m[1]).contains(&wavelength_m) {
            10f64.powf(-self.density)
        } else {
            1.0
        }
    }
}

/// Luminance of the channels that makes as many electrons as 1 W/(m² sr) of `wavelength_m` [m] does [kcd sr/W]; also
/// the illuminance [klx] that makes as many as an irradiance of 1 W/m².
///
/// A pixel counts a photon of 555 nm with the sensor's quantum efficiency and 4.1e15 of them a lux and second
/// ([`PHOTONS_PER_LUX_S_M2`]); aperture, exposure, pixel and lens are the same for both.
pub fn kcd_per_w(mosaic: Mosaic, filter: &BlockingFilter, wavelength_m: f64) -> [f64; 3] {
    let photons_per_j = wavelength_m / HC_J_M;
    let counted = silicon(wavelength_m) * filter.passes(wavelength_m) * photons_per_j;
    let per_kcd = 1e3 * PHOTONS_PER_LUX_S_M2 * mosaic.filters();
    dyes(mosaic, wavelength_m).map(|dye| dye * counted / per_kcd)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::motion::Shutter;
    use crate::optics::sensor::{SensorParams, Transfer};

    #[test]
    fn silicon_sees_much_at_900_nm_and_little_at_1064() {
        assert_eq!(silicon(530e-9), 1.0);
        assert!((silicon(900e-9) / silicon(1064e-9) - 13.6).abs() < 0.1);
        assert!((silicon(975e-9) - 0.08).abs() < 1e-12);
        assert_eq!(silicon(1550e-9), 0.0);
        assert_eq!(silicon(100e-9), 0.0);
    }

    #[test]
    fn a_filter_blocks_its_band_alone() {
        let notch = BlockingFilter {
            band_m: [1030e-9, 1080e-9],
            density: 4.0,
        };
        assert!((notch.passes(1064e-9) / 1e-4 - 1.0).abs() < 1e-12);
        assert_eq!(notch.passes(976e-9), 1.0);
        assert_eq!(BlockingFilter::NONE.passes(976e-9), 1.0);
    }

    /// Watts on a pixel times quantum efficiency over the energy of a photon, by hand.
    #[test]
    fn a_watt_makes_the_electrons_that_its_photons_make() {
        let params = SensorParams {
            f_number: 5.6,
            pixel_pitch_m: 6.9e-6,
            transmission: 0.8,
            quantum_efficiency: 0.6,
            full_well_e: 22_000.0,
            read_noise_e: 0.0,
            dark_current_eps: 0.0,
            dsnu_e: 0.0,
            prnu: 0.0,
            pattern_key: 0,
            size_px: [640, 480],
            focal_px: 36_000.0,
            vignetting: 0.0,
            mosaic: Mosaic::Rggb,
            shutter: Shutter::Global,
            motion_blur: false,
            glare: 0.0,
            blur_sigma_px: 0.0,
            white_balance: [1.0; 3],
            transfer: Transfer::Linear,
        };
        for mosaic in [Mosaic::Rggb, Mosaic::Mono, Mosaic::None] {
            let params = SensorParams { mosaic, ..params };
            let [red, ..] = kcd_per_w(mosaic, &BlockingFilter::NONE, 1064e-9);
            let found = params.electrons_per_kcd_m2_s() * red;
            // 1 W/(m² sr) through pi/(4 N²) and 0.8 on (6.9 um)², 1.867e-19 J a photon, 0.0084 electrons each.
            let watts = std::f64::consts::PI / (4.0 * 5.6 * 5.6) * 0.8 * 6.9e-6 * 6.9e-6;
            let expected = watts / (6.626_070_15e-34 * 299_792_458.0 / 1064e-9) * 0.6 * 0.014;
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }
}
