//! `wave`, the split steps through air, and `scaling`, which goes by theory.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use crate::theory;
use boresight_models::air::atmosphere::Cn2Profile;
use boresight_models::air::turbulence::{AirPath, PathTurbulence};
use boresight_models::laser::beam::{BloomingAir, Laser, peak_irradiance_wpm2};
use boresight_models::laser::propagation::{
    BeamAir, Propagation, PropagationContext, Scaling, Sent, WaveSettings,
};
use boresight_models::maths::rng::Stream;
use boresight_wave::{Absorbing, Aperture, Exposures, Grid, Spot, VonKarman, Wave, even_layers};
use glam::DVec2;
use std::f64::consts::{PI, TAU};

pub fn checks() -> Vec<Check> {
    [
        still_air(),
        energy(),
        scintillation(),
        focused(),
        blooming(),
        scaling(),
    ]
    .concat()
}

const LAMBDA_M: f64 = 1.064e-6; // [m]
const LENGTH_M: f64 = 1000.0; // [m]
const W0_M: f64 = 0.05; // [m]
const LASER: Aperture = Aperture {
    power_w: 1000.0,
    radius_m: W0_M,
    clear_radius_m: f64::INFINITY,
    wavelength_m: LAMBDA_M,
    m2: 1.0,
    focus_m: LENGTH_M,
};
/// Kolmogorov's turbulence up to an outer scale.
pub const KOLMOGOROV: VonKarman = VonKarman {
    outer_m: 100.0,
    inner_m: 0.0,
};
/// Radius of the focus in still air [m].
const FOCUS_M: f64 = LAMBDA_M * LENGTH_M / (PI * W0_M);

/// Normal numbers of a seed.
pub fn normals(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = Stream::new(seed, 0, "validate");
    move || rng.normal()
}

/// A square of samples.
pub fn grid(n: usize, spacing_m: f64) -> Grid {
    Grid { n, spacing_m }
}

fn path(grid: Grid, spectrum: &VonKarman, cn2: f64, layers: usize, seed: u64) -> Wave {
    let layers = even_layers(LENGTH_M, layers, |_| (cn2, [3.0, 1.0]));
    Wave::new(grid, spectrum, layers, LENGTH_M, 1, &mut normals(seed))
}

/// What arrives through still air in so many steps, of a wavelength [m].
fn in_still_air(wavelength_m: f64, steps: usize) -> Spot {
    let laser = Aperture {
        wavelength_m,
        ..LASER
    };
    path(grid(256, 1.5e-3), &KOLMOGOROV, 0.0, steps, 1).send(&laser, 0.0)
}

fn still_air() -> Vec<Check> {
    const CLOSED: &str = "Gaussian beam, closed form";
    let mutation = a_fifth_more("wavelength");
    vec![
        Check {
            model: "propagation",
            name: "`wave` in still air: peak of 1 kW",
            reference: CLOSED,
            value: 1e-6 * peak_irradiance_wpm2(1000.0, FOCUS_M),
            unit: "MW/m²",
            tolerance: Tolerance::Relative(1e-3),
            mutation,
            run: |scale| Ok(1e-6 * in_still_air(scale.of(LAMBDA_M), 4).peak_wpm2()),
        },
        Check {
            model: "propagation",
            name: "`wave` in still air: radius",
            reference: CLOSED,
            value: 1e3 * FOCUS_M,
            unit: "mm",
            tolerance: Tolerance::Relative(1e-3),
            mutation,
            run: |scale| Ok(1e3 * in_still_air(scale.of(LAMBDA_M), 4).radius_m()),
        },
        Check {
            model: "propagation",
            name: "`wave`: greatest difference of 16 steps and one, over the peak",
            reference: "free space is one step, however it is cut",
            value: 0.0,
            unit: "",
            tolerance: Tolerance::Absolute(1e-6),
            mutation: a_fifth_more("wavelength of the one step"),
            run: |scale| {
                let (one, many) = (
                    in_still_air(scale.of(LAMBDA_M), 1),
                    in_still_air(LAMBDA_M, 16),
                );
                let pairs = one.irradiance_wpm2.iter().zip(&many.irradiance_wpm2);
                let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                Ok(most / many.peak_wpm2())
            },
        },
    ]
}

/// Share of the power that is left after ten layers of turbulence in air of an extinction [1/m].
fn left(extinction_pm: f64) -> f64 {
    let mut wave = path(grid(256, 2e-3), &KOLMOGOROV, 1e-14, 10, 2);
    wave.periodic();
    let spot = wave.send(&LASER, extinction_pm);
    spot.power_w() / wave.sent_w()
}

fn energy() -> Vec<Check> {
    vec![
        Check {
            model: "propagation",
            name: "`wave`: energy that eleven steps keep, but for 1e-9 of extinction",
            reference: "screens and free space are unitary: 1e-9 a step",
            value: 1.0,
            unit: "",
            tolerance: Tolerance::Absolute(1.1e-8),
            mutation: times("extinction", 100.0),
            run: |scale| Ok(left(scale.of(1e-12))),
        },
        Check {
            model: "propagation",
            name: "`wave`: what air of 0.1 /km leaves over 1 km",
            reference: "Beer and Lambert: e^-0.1",
            value: (-0.1f64).exp(),
            unit: "",
            tolerance: Tolerance::Relative(1.1e-8),
            mutation: a_fifth_more("extinction"),
            run: |scale| Ok(left(scale.of(1e-4))),
        },
    ]
}

/// Scintillation index of a plane wave at the end of a uniform path of a Rytov variance.
pub fn plane_index(rytov: f64, grid: Grid, layers: usize, draws: u64) -> f64 {
    let k = TAU / LAMBDA_M;
    let cn2 = rytov / (1.23 * k.powf(7.0 / 6.0) * LENGTH_M.powf(11.0 / 6.0));
    let flat = Aperture {
        radius_m: 1e6,
        focus_m: f64::INFINITY,
        power_w: PI / 2.0 * 1e12,
        ..LASER
    };
    let (mut mean, mut square, mut number) = (0.0, 0.0, 0.0);
    for seed in 0..draws {
        let mut wave = path(grid, &KOLMOGOROV, cn2, layers, 100 + seed);
        wave.periodic();
        for value in wave.send(&flat, 0.0).irradiance_wpm2 {
            mean += value;
            square += value * value;
            number += 1.0;
        }
    }
    let mean: f64 = mean / number;
    square / number / (mean * mean) - 1.0
}

fn scintillation() -> Vec<Check> {
    let weak = |name, value, run| Check {
        model: "propagation",
        name,
        reference: "weak fluctuations to second order (Andrews & Phillips, ch. 8 and 9)",
        value,
        unit: "",
        tolerance: Tolerance::Relative(0.10),
        mutation: a_fifth_more("Cn²"),
        run,
    };
    vec![
        weak(
            "plane wave, scintillation index at Rytov variance 0.05",
            0.0496,
            |scale| Ok(plane_index(scale.of(0.05), grid(256, 3e-3), 10, 12)),
        ),
        weak(
            "plane wave, scintillation index at Rytov variance 0.1",
            0.0999,
            |scale| Ok(plane_index(scale.of(0.1), grid(256, 3e-3), 10, 12)),
        ),
        Check {
            model: "propagation",
            name: "plane wave, scintillation index at Rytov variance 40",
            reference: "Andrews & Phillips, ch. 9, saturated: 1 + 0.86 σ_R^(-4/5)",
            value: 1.0 + 0.86 * 40f64.powf(-0.4),
            unit: "",
            tolerance: Tolerance::Relative(0.15),
            mutation: times("Cn²", 0.005),
            run: |scale| Ok(plane_index(scale.of(40.0), grid(512, 7e-4), 40, 2)),
        },
    ]
}

/// A large outer scale \[m\]: the wander's theory has none.
pub const FAR_M: f64 = 300.0; // [m]

/// Many moments of the focused beam through a Cn².
pub fn exposures(cn2: f64, draws: u64) -> Exposures {
    let spectrum = VonKarman {
        outer_m: FAR_M,
        inner_m: 0.0,
    };
    let grid = grid(128, 2.2e-3);
    let mut all = Exposures::new(grid);
    for seed in 0..draws {
        all.add(&path(grid, &spectrum, cn2, 10, 1000 + seed).send(&LASER, 0.0));
    }
    all
}

/// 1/e² radius of the mean irradiance on the axis [m].
pub fn long_term_m(exposures: &Exposures) -> f64 {
    (2.0 * LASER.power_w / (PI * exposures.long().at_wpm2(0.0, 0.0))).sqrt()
}

fn focused() -> Vec<Check> {
    let fried_m = |cn2| theory::fried_spherical_m(LAMBDA_M, cn2, LENGTH_M);
    vec![
        Check {
            model: "propagation",
            name: "`wave`: long-term radius, Cn² 1e-14",
            reference: "extended Huygens–Fresnel integral (Andrews & Phillips), outer scale 300 m",
            value: 1e3 * theory::long_term_m(FOCUS_M, W0_M, fried_m(1e-14), FAR_M),
            unit: "mm",
            tolerance: Tolerance::Relative(0.05),
            mutation: times("Cn²", 1.5),
            run: |scale| Ok(1e3 * long_term_m(&exposures(scale.of(1e-14), 250))),
        },
        Check {
            model: "propagation",
            name: "`wave`: centroid's wander, rms, both axes, Cn² 1e-15",
            reference: "irradiance-weighted slope of Kolmogorov's phase over the aperture",
            value: 1e3 * LENGTH_M * theory::wander_rad(LAMBDA_M, W0_M, fried_m(1e-15)),
            unit: "mm",
            tolerance: Tolerance::Relative(0.15),
            mutation: times("Cn²", 2.0),
            run: |scale| Ok(1e3 * exposures(scale.of(1e-15), 250).wander_rms_m()),
        },
    ]
}

/// Peak that is left of a beam that warms the wind, of so much power [W], over that in cold air.
fn bloomed(power_w: f64) -> f64 {
    let air = Absorbing {
        absorption_pm: 1e-5,
        temperature_k: 288.15,
        pressure_pa: 101_325.0,
        refractivity: 2.74e-4,
    };
    let laser = Aperture { power_w, ..LASER };
    let layers = even_layers(LENGTH_M, 24, |_| (0.0, [4.0, 0.0]));
    let mut normal = normals(1);
    let grid = grid(128, 1.9e-3);
    let mut wave = Wave::new(grid, &KOLMOGOROV, layers, LENGTH_M, 1, &mut normal);
    let cold = wave.send(&laser, 0.0).peak_wpm2();
    let mut warm = cold;
    for _ in 0..60 {
        warm = wave.heat(&laser, 0.0, &air, 1e-3).peak_wpm2();
    }
    warm / cold
}

fn blooming() -> Vec<Check> {
    let left = |number: f64| 1.0 / (1.0 + 0.0625 * number * number);
    let by_fit = |name, number, factor, run| Check {
        model: "blooming",
        name,
        reference: "Gebhardt's fit, Appl. Opt. 15, 1479, 1976 (recalled)",
        value: left(number),
        unit: "",
        tolerance: Tolerance::Relative(0.15),
        mutation: times("power", factor),
        run,
    };
    let by_poppy = |name, value, bound, run| Check {
        model: "blooming",
        name,
        reference: "poppy 1.1.2, ThermalBloomingWFE: tests/blooming_poppy.py",
        value,
        unit: "",
        tolerance: Tolerance::Relative(bound),
        mutation: a_fifth_more("power"),
        run,
    };
    vec![
        by_poppy(
            "`wave`: peak left of 3 kW focused at 1 km",
            0.850,
            0.02,
            |scale| Ok(bloomed(scale.of(3e3))),
        ),
        by_poppy(
            "`wave`: peak left of 12 kW focused at 1 km",
            0.472,
            0.04,
            |scale| Ok(bloomed(scale.of(12e3))),
        ),
        by_fit(
            "`wave`: peak left at a distortion number of 0.94",
            0.94,
            4.0,
            |scale| Ok(bloomed(scale.of(3e3))),
        ),
        by_fit(
            "`wave`: peak left at a distortion number of 3.75",
            3.75,
            2.0,
            |scale| Ok(bloomed(scale.of(12e3))),
        ),
    ]
}

/// Mean irradiance on the axis by `scaling` of 1 kW focused at 1 km through a Cn² [W/m²].
fn scaling_axis(cn2: f64) -> Result<f64, Fault> {
    const DRAWS: u64 = 40_000;
    let laser = Laser {
        power_w: 1000.0,
        wavelength_m: LAMBDA_M,
        aperture_radius_m: W0_M,
        m2: 1.0,
    };
    let level = AirPath {
        length_m: LENGTH_M,
        h0_m: 30.0,
        h1_m: 30.0,
    };
    let profile = Cn2Profile::Constant(cn2);
    let air = BeamAir {
        turbulence: PathTurbulence::new(&profile, &level, LAMBDA_M, f64::INFINITY),
        layers: Vec::new(),
        warmed: BloomingAir {
            absorption_per_m: 0.0,
            extinction_per_m: 0.0,
            temperature_k: 290.0,
            crosswind_mps: 4.0,
            slew_radps: 0.0,
        },
    };
    let sent = Sent {
        laser: &laser,
        fires: true,
        range_m: LENGTH_M,
        focus_m: LENGTH_M,
        air: &air,
        is_new: true,
        turned: None,
        dt_s: 1.0 / 960.0,
    };
    let mut sum = 0.0;
    for seed in 0..DRAWS {
        let mut scaling = Scaling::new(&PropagationContext {
            seed,
            station: 0,
            tick_hz: 960,
            scales_m: [f64::INFINITY, 0.0],
            paper: [0.0, 0.1],
            wave: WaveSettings::default(),
        });
        sum += scaling.cross(&sent)?.at_wpm2(DVec2::ZERO) / DRAWS as f64;
    }
    Ok(sum)
}

fn scaling() -> Vec<Check> {
    let fried_m = theory::fried_spherical_m(LAMBDA_M, 1e-14, LENGTH_M);
    let long_m = theory::long_term_m(FOCUS_M, W0_M, fried_m, f64::INFINITY);
    vec![Check {
        model: "propagation",
        name: "`scaling`: mean irradiance on the axis of 1 kW, Cn² 1e-14",
        reference: "extended Huygens–Fresnel integral (Andrews & Phillips)",
        value: 1e-6 * peak_irradiance_wpm2(1000.0, long_m),
        unit: "MW/m²",
        tolerance: Tolerance::Relative(0.03),
        mutation: a_fifth_more("Cn²"),
        run: |scale| Ok(1e-6 * scaling_axis(scale.of(1e-14))?),
    }]
}
