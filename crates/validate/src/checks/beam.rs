//! The laser without waves: beam, blooming by formula, `scaling`, `paper`, range finder.

use crate::check::{Check, Tolerance, a_fifth_more};
use boresight_models::laser::beam::{
    BloomingAir, Laser, blooming_factor, irradiance_wpm2, peak_irradiance_wpm2, power_in_bucket_w,
};
use boresight_models::laser::propagation::{PaperPropagation, PropagationContext, WaveSettings};
use boresight_models::laser::range_finder::{LitSurface, RangeFinderParams};
use boresight_models::maths::rng::Stream;
use std::f64::consts::{PI, SQRT_2};

pub fn checks() -> Vec<Check> {
    [beam(), blooming(), paper(), range_finder()].concat()
}

const LASER: Laser = Laser {
    power_w: 2000.0,
    wavelength_m: 1.064e-6,
    aperture_radius_m: 0.05,
    m2: 1.0,
};

/// Mean irradiance on the axis of a beam of 12 mm that jitters by so much about each axis [m], per watt [1/m²].
fn jittered_axis(sigma_m: f64) -> f64 {
    const DRAWS: u32 = 100_000;
    let mut rng = Stream::new(21, 0, "jitter");
    let sum: f64 = (0..DRAWS)
        .map(|_| irradiance_wpm2(1.0, 0.012, sigma_m * rng.normal().hypot(rng.normal())))
        .sum();
    sum / f64::from(DRAWS)
}

fn beam() -> Vec<Check> {
    vec![
        Check {
            model: "beam",
            name: "radius in a focus at 1 km, W0 5 cm, 1.064 µm",
            reference: "λL/(π W0), by hand",
            value: 6.774,
            unit: "mm",
            tolerance: Tolerance::Relative(1e-4),
            mutation: a_fifth_more("wavelength"),
            run: |scale| {
                let laser = Laser {
                    wavelength_m: scale.of(LASER.wavelength_m),
                    ..LASER
                };
                Ok(1e3 * laser.spot_radius_m(1000.0, 1000.0))
            },
        },
        Check {
            model: "beam",
            name: "radius of a collimated beam of M² 1.7 at its Rayleigh range",
            reference: "Siegman, Proc. SPIE 1224, 1990: √2 W0",
            value: 50.0 * SQRT_2,
            unit: "mm",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("M²"),
            run: |scale| {
                let rayleigh_m = PI * 0.05 * 0.05 / (1.7 * LASER.wavelength_m);
                let laser = Laser {
                    m2: scale.of(1.7),
                    ..LASER
                };
                Ok(1e3 * laser.spot_radius_m(rayleigh_m, f64::INFINITY))
            },
        },
        Check {
            model: "beam",
            name: "share of the power within the 1/e² radius",
            reference: "1 - e^-2",
            value: -f64::exp_m1(-2.0),
            unit: "",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("beam radius"),
            run: |scale| Ok(power_in_bucket_w(1.0, scale.of(0.01), 0.0, 0.01)),
        },
        Check {
            model: "beam",
            name: "share in a bucket of the beam's radius, the axis on its rim",
            reference: "Marcum: Q1(2, 2) = (1 + e^-4 I0(4))/2, I0 of Abramowitz & Stegun 9.8",
            value: 0.5 * (1.0 - (-4.0f64).exp() * 11.301_921_952_136_33),
            unit: "",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("beam radius"),
            run: |scale| Ok(power_in_bucket_w(1.0, scale.of(1.0), 1.0, 1.0)),
        },
        Check {
            model: "beam",
            name: "mean irradiance on the axis of 12 mm under 7.2 mm of jitter, per watt",
            reference: "2/(π (W² + 4 σ²)): Gaussians add",
            value: peak_irradiance_wpm2(1.0, 0.012f64.hypot(2.0 * 0.0072)),
            unit: "1/m²",
            tolerance: Tolerance::Relative(0.01),
            mutation: a_fifth_more("jitter"),
            run: |scale| Ok(jittered_axis(scale.of(0.0072))),
        },
    ]
}

/// Air that absorbs, in a wind [m/s], along a path of 1.5 km; the beam does not diffract.
const AIR: BloomingAir = BloomingAir {
    absorption_per_m: 1e-5,
    extinction_per_m: 0.0,
    temperature_k: 288.15,
    crosswind_mps: 4.0,
    slew_radps: 0.0,
};
const RAY: Laser = Laser { m2: 0.0, ..LASER };
const BLOOMING_M: f64 = 1500.0; // [m]

/// Distortion number over that of the collimated beam in air that is not otherwise changed.
fn over_collimated(focus_m: f64, air: &BloomingAir) -> f64 {
    RAY.distortion_number(BLOOMING_M, focus_m, air)
        / RAY.distortion_number(BLOOMING_M, f64::INFINITY, &AIR)
}

fn blooming() -> Vec<Check> {
    const GEBHARDT: &str = "Gebhardt, Proc. SPIE 1221, 1990 (recalled)";
    let a_m = 0.05 / SQRT_2;
    let heated = 2.7398e-4 / 288.15 * 1e-5 * 2000.0 * BLOOMING_M * BLOOMING_M;
    let (nf, ne, nw) = (6.0f64, 0.8f64, 5.0f64);
    vec![
        Check {
            model: "blooming",
            name: "distortion number of a collimated beam, 2 kW, 4 m/s, 1.5 km",
            reference: GEBHARDT,
            value: heated / (PI * 1.2250 * 1007.0 * 4.0 * a_m.powi(3)),
            unit: "",
            tolerance: Tolerance::Relative(2e-4),
            mutation: a_fifth_more("absorption"),
            run: |scale| {
                let air = BloomingAir {
                    absorption_per_m: scale.of(AIR.absorption_per_m),
                    ..AIR
                };
                Ok(RAY.distortion_number(BLOOMING_M, f64::INFINITY, &air))
            },
        },
        Check {
            model: "blooming",
            name: "its factor by focusing to a sixth",
            reference: GEBHARDT,
            value: 2.0 * nf * nf / (nf - 1.0) * (1.0 - nf.ln() / (nf - 1.0)),
            unit: "",
            tolerance: Tolerance::Relative(2e-3),
            mutation: a_fifth_more("focal distance"),
            run: |scale| {
                Ok(over_collimated(
                    scale.of(BLOOMING_M / (1.0 - 1.0 / 6.0)),
                    &AIR,
                ))
            },
        },
        Check {
            model: "blooming",
            name: "its factor by extinction of 0.8 over the path",
            reference: GEBHARDT,
            value: 2.0 / (ne * ne) * (ne - 1.0 + (-ne).exp()),
            unit: "",
            tolerance: Tolerance::Relative(1e-3),
            mutation: a_fifth_more("extinction"),
            run: |scale| {
                let air = BloomingAir {
                    extinction_per_m: scale.of(0.8) / BLOOMING_M,
                    ..AIR
                };
                Ok(over_collimated(f64::INFINITY, &air))
            },
        },
        Check {
            model: "blooming",
            name: "its factor by slewing, five times the wind at the end",
            reference: GEBHARDT,
            value: 2.0 / (nw * nw) * ((nw + 1.0) * nw.ln_1p() - nw),
            unit: "",
            tolerance: Tolerance::Relative(2e-3),
            mutation: a_fifth_more("slew rate"),
            run: |scale| {
                let air = BloomingAir {
                    slew_radps: scale.of(5.0) * AIR.crosswind_mps / BLOOMING_M,
                    ..AIR
                };
                Ok(over_collimated(f64::INFINITY, &air))
            },
        },
        Check {
            model: "blooming",
            name: "peak left at a distortion number of 4",
            reference: "Gebhardt, Appl. Opt. 15, 1479, 1976 (recalled): 1/(1 + N²/16)",
            value: 0.5,
            unit: "",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("distortion number"),
            run: |scale| Ok(blooming_factor(scale.of(4.0))),
        },
    ]
}

/// Mean intensity of the paper's eq. 7 after 0.8 s, of a drift [1/s].
fn paper_mean(gamma_per_s: f64) -> f64 {
    const DRAWS: u64 = 100_000;
    let after = |seed: u64| {
        let mut own = PaperPropagation::new(&PropagationContext {
            seed,
            station: 0,
            tick_hz: 960,
            scales_m: [20.0, 0.0],
            paper: [gamma_per_s, 0.5],
            wave: WaveSettings::default(),
        });
        // Unequal steps: the update is exact for any.
        own.step(0.24);
        own.step(0.56)
    };
    (0..DRAWS).map(after).sum::<f64>() / DRAWS as f64
}

fn paper() -> Vec<Check> {
    vec![Check {
        model: "propagation",
        name: "`paper`: mean intensity of eq. 7 after 0.8 s, drift 0.7 /s",
        reference: "geometric Brownian motion: e^(-γt)",
        value: (-0.56f64).exp(),
        unit: "",
        tolerance: Tolerance::Relative(0.01),
        mutation: a_fifth_more("drift"),
        run: |scale| Ok(paper_mean(scale.of(0.7))),
    }]
}

fn range_finder() -> Vec<Check> {
    const MEASURES: &str = "Measures, Laser Remote Sensing, 1984, ch. 7 (recalled)";
    fn of(range_m: f64, area_m2: f64, extinction_pm: f64) -> f64 {
        let finder = RangeFinderParams::default();
        let surface = LitSurface {
            range_m,
            share: finder.share(area_m2, range_m, 0.0),
            reflectance: 0.3,
        };
        finder.strength(&surface, extinction_pm)
    }
    vec![
        Check {
            model: "range-finder",
            name: "echo of a small target over that at twice the range",
            reference: MEASURES,
            value: 16.0,
            unit: "",
            tolerance: Tolerance::Relative(1e-3),
            mutation: a_fifth_more("the longer range"),
            run: |scale| Ok(of(1_000.0, 1e-4, 0.0) / of(scale.of(2_000.0), 1e-4, 0.0)),
        },
        Check {
            model: "range-finder",
            name: "echo of a wall over that at twice the range",
            reference: MEASURES,
            value: 4.0,
            unit: "",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("the longer range"),
            run: |scale| {
                let wall = f64::INFINITY;
                Ok(of(1_000.0, wall, 0.0) / of(scale.of(2_000.0), wall, 0.0))
            },
        },
        Check {
            model: "range-finder",
            name: "what 1 km of air of 0.1 /km leaves of an echo",
            reference: "Beer and Lambert, there and back: e^-0.2",
            value: (-0.2f64).exp(),
            unit: "",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("extinction"),
            run: |scale| Ok(of(1_000.0, 0.07, scale.of(1e-4)) / of(1_000.0, 0.07, 0.0)),
        },
    ]
}
