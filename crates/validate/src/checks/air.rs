//! Wind, gusts and optical turbulence.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use crate::theory;
use boresight_models::air::atmosphere::Cn2Profile;
use boresight_models::air::shared_gusts::SharedNoise;
use boresight_models::air::turbulence::{AirPath, PathTurbulence};
use boresight_models::air::wind::{DrydenGust, MeanWind, dryden_scales, over_rough_ground};
use boresight_models::ground::roughness::{AreaShares, Roughness};
use boresight_models::laser::beam::Laser;
use boresight_models::maths::rng::Stream;
use glam::DVec3;
use std::f64::consts::TAU;

pub fn checks() -> Vec<Check> {
    [wind(), gusts(), paths(), hufnagel_valley(), spots()].concat()
}

fn wind() -> Vec<Check> {
    vec![
        Check {
            model: "wind",
            name: "mean wind at 100 m for 5 m/s at 10 m, roughness 0.1 m",
            reference: "logarithmic law: ln 1000/ln 100",
            value: 7.5,
            unit: "m/s",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("roughness length"),
            run: |scale| {
                let wind = MeanWind::new(5.0, 270.0, scale.of(0.1), 0.0).map_err(Fault::of)?;
                Ok(wind.mean_wind_enu_mps(100.0).x)
            },
        },
        Check {
            model: "wind",
            name: "10 m/s over open ground, over a city",
            reference: "EN 1991-1-4 (recalled), terrain IV over II: 0.540/1.007",
            value: 5.40 / 1.007,
            unit: "m/s",
            tolerance: Tolerance::Relative(2e-3),
            mutation: a_fifth_more("roughness length"),
            run: |scale| Ok(over_rough_ground(10.0, None, scale.of(1.0)).0),
        },
        Check {
            model: "wind",
            name: "displacement height of cubes on a quarter of the area",
            reference: "Macdonald, Griffiths & Hall, Atmos. Environ. 32, 1857, 1998, eq. 23",
            value: 0.4831,
            unit: "H",
            tolerance: Tolerance::Absolute(2e-4),
            mutation: a_fifth_more("share of the area"),
            run: |scale| {
                let cubes = Roughness {
                    mean_height_m: 1.0,
                    shares: Some(AreaShares {
                        plan: scale.of(0.25),
                        frontal: 0.25,
                    }),
                };
                Ok(cubes.displacement_m())
            },
        },
    ]
}

/// 15 kt, 20 ft above ground.
const W20_MPS: f64 = 15.0 * 1852.0 / 3600.0; // [m/s]
const MIL: &str = "MIL-F-8785C, 3.7.3.4, by hand";

fn open_field(speed_10m_mps: f64) -> Result<MeanWind, Fault> {
    MeanWind::new(speed_10m_mps, 270.0, 0.03, 0.0).map_err(Fault::of)
}

/// The highest mean over 3 s in ten minutes, the mean of 200 such spells, of a mean wind and a reported gust [m/s].
fn highest_gust_mps(wind_mps: f64, gust_mps: f64) -> Result<f64, Fault> {
    const DT_S: f64 = 0.25; // [s]
    const SPELLS: u32 = 200;
    let mut rng = Stream::new(5, 0, "gust");
    let mut gusts = DrydenGust::new(&open_field(wind_mps)?, &mut rng).reaching(Some(gust_mps));
    let mut sum_mps = 0.0;
    for _ in 0..SPELLS {
        let along: Vec<f64> = (0..2400)
            .map(|_| gusts.step(DT_S, 10.0, 0.0, &mut rng).x)
            .collect();
        let three_seconds = along.windows(12).map(|w| w.iter().sum::<f64>() / 12.0);
        sum_mps += three_seconds.fold(0.0, f64::max);
    }
    Ok(wind_mps + sum_mps / f64::from(SPELLS))
}

/// Correlation of a gust along the wind with that 5 s later, 30 m above ground, of a UAV of an airspeed [m/s].
fn correlation(airspeed_mps: f64) -> Result<f64, Fault> {
    let mut rng = Stream::new(3, 0, "gust");
    let mut gusts = DrydenGust::new(&open_field(8.0)?, &mut rng);
    let along: Vec<f64> = (0..100_000)
        .map(|_| gusts.step(1.0, 30.0, airspeed_mps, &mut rng).x)
        .collect();
    let square = along.iter().map(|u| u * u).sum::<f64>() / along.len() as f64;
    let lagged = along.iter().zip(&along[5..]).map(|(a, b)| a * b);
    Ok(lagged.sum::<f64>() / (along.len() - 5) as f64 / square)
}

/// What two places so far apart share of the noise that drives gusts of 240 m.
fn shared(apart_m: f64) -> f64 {
    const FIELDS: u64 = 20_000;
    let at = DVec3::new(430.0, -810.0, 80.0);
    let product = |field: u64| {
        let noise = SharedNoise::draw(1, &mut Stream::new(9, field, "shared gusts"));
        let [a, b] =
            [at, at + apart_m * DVec3::Y].map(|r_enu_m| noise.normals(r_enu_m, 240.0, 80.0));
        (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / 3.0
    };
    (0..FIELDS).map(product).sum::<f64>() / FIELDS as f64
}

fn gusts() -> Vec<Check> {
    let height = a_fifth_more("height above ground");
    let strength = a_fifth_more("wind at 20 ft");
    let scale_of = |name, value, unit, mutation, bound, run| Check {
        model: "wind",
        name,
        reference: MIL,
        value,
        unit,
        tolerance: Tolerance::Absolute(bound),
        mutation,
        run,
    };
    // Length scale of the gusts at 30 m, 98.43 ft [m].
    let l_u_m = 30.0 / (0.177 + 0.000823 * 30.0 / 0.3048f64).powf(1.2);
    vec![
        scale_of("length scale at 10 m", 67.37, "m", height, 5e-3, |scale| {
            Ok(dryden_scales(scale.of(10.0), W20_MPS).l_u_m)
        }),
        scale_of(
            "σ along, 15 kt, 10 m",
            1.4574,
            "m/s",
            strength,
            1e-4,
            |scale| Ok(dryden_scales(10.0, scale.of(W20_MPS)).sigma_u_mps),
        ),
        scale_of("σ upright, 15 kt", 0.7717, "m/s", strength, 1e-4, |scale| {
            Ok(dryden_scales(10.0, scale.of(W20_MPS)).sigma_w_mps)
        }),
        Check {
            model: "wind",
            name: "correlation of a gust with that 75 m on",
            reference: "Dryden's exp(-r/L), L by MIL-F-8785C",
            value: (-75.0 / l_u_m).exp(),
            unit: "",
            tolerance: Tolerance::Absolute(0.03),
            mutation: times("airspeed", 2.0),
            run: |scale| correlation(scale.of(15.0)),
        },
        Check {
            model: "wind",
            name: "highest 3 s mean in ten minutes, reported wind and gust 8 and 16 m/s",
            reference: "WMO-No. 8, definition of a gust",
            value: 16.0,
            unit: "m/s",
            tolerance: Tolerance::Relative(0.03),
            mutation: a_fifth_more("reported gust"),
            run: |scale| highest_gust_mps(8.0, scale.of(16.0)),
        },
        Check {
            model: "shared-gusts",
            name: "what neighbours 40 m apart share of gusts of 240 m",
            reference: "Dryden's exp(-d/L)",
            value: (-40.0 / 240.0f64).exp(),
            unit: "",
            tolerance: Tolerance::Absolute(0.045),
            mutation: times("distance", 2.0),
            run: |scale| Ok(shared(scale.of(40.0))),
        },
    ]
}

const LAMBDA_M: f64 = 1.064e-6; // [m]
const LENGTH_M: f64 = 1000.0; // [m]
const W0_M: f64 = 0.05; // [m]

/// A level path of 1 km at 1.064 µm without outer scale.
fn uniform(cn2: f64) -> PathTurbulence {
    let path = AirPath {
        length_m: LENGTH_M,
        h0_m: 10.0,
        h1_m: 10.0,
    };
    PathTurbulence::new(&Cn2Profile::Constant(cn2), &path, LAMBDA_M, f64::INFINITY)
}

fn paths() -> Vec<Check> {
    const UNIFORM: &str = "Andrews & Phillips, 2nd ed., uniform path, 1 km, 1.064 µm, Cn² 1e-14";
    let of_path = |name, value, unit, bound, run| Check {
        model: "turbulence",
        name,
        reference: UNIFORM,
        value,
        unit,
        tolerance: Tolerance::Relative(bound),
        mutation: a_fifth_more("Cn²"),
        run,
    };
    vec![
        of_path("Rytov variance, plane wave", 0.3088, "", 3e-3, |scale| {
            Ok(uniform(scale.of(1e-14)).rytov_plane)
        }),
        of_path(
            "Rytov variance, spherical wave",
            0.3088 * 0.4043,
            "",
            4e-3,
            |scale| Ok(uniform(scale.of(1e-14)).rytov_spherical),
        ),
        of_path("Fried parameter, plane wave", 5.00, "cm", 2e-3, |scale| {
            Ok(1e2 * uniform(scale.of(1e-14)).fried_plane_m)
        }),
        of_path(
            "Fried parameter, spherical wave",
            9.00,
            "cm",
            2e-3,
            |scale| Ok(1e2 * uniform(scale.of(1e-14)).fried_spherical_m),
        ),
    ]
}

/// HV-5/7 with its ground term and its pseudo-wind times factors.
fn hv(wind: f64, ground: f64) -> Cn2Profile {
    Cn2Profile::HufnagelValley {
        wind_mps: 21.0 * wind,
        ground: 1.7e-14 * ground,
    }
}

/// Moment of a profile over height up to 30 km, by Simpson's rule in steps of 5 m.
fn moment(profile: &Cn2Profile, power: f64) -> f64 {
    let n = 6000;
    let step_m = 30e3 / f64::from(n);
    let sum: f64 = (0..=n)
        .map(|i| {
            let h_m = f64::from(i) * step_m;
            let weight = match i {
                0 => 1.0,
                _ if i == n => 1.0,
                _ => f64::from(2 + 2 * (i % 2)),
            };
            weight * profile.cn2(h_m) * h_m.powf(power)
        })
        .sum();
    sum * step_m / 3.0
}

fn hufnagel_valley() -> Vec<Check> {
    const HV57: &str = "HV-5/7: 5 cm and 7 µrad at 500 nm, to more digits by an own integral";
    vec![
        Check {
            model: "turbulence",
            name: "HV-5/7: Fried parameter at the zenith, 500 nm",
            reference: HV57,
            value: 4.961,
            unit: "cm",
            tolerance: Tolerance::Relative(2e-4),
            mutation: a_fifth_more("ground term A"),
            run: |scale| {
                let path = AirPath {
                    length_m: 30e3,
                    h0_m: 0.0,
                    h1_m: 30e3,
                };
                let profile = hv(1.0, scale.of(1.0));
                let along = PathTurbulence::new(&profile, &path, 500e-9, f64::INFINITY);
                Ok(1e2 * along.fried_plane_m)
            },
        },
        Check {
            model: "turbulence",
            name: "HV-5/7: integral of Cn²",
            reference: HV57,
            value: 2.2354e-12,
            unit: "m^(1/3)",
            tolerance: Tolerance::Relative(2e-4),
            mutation: a_fifth_more("ground term A"),
            run: |scale| Ok(moment(&hv(1.0, scale.of(1.0)), 0.0)),
        },
        Check {
            model: "turbulence",
            name: "HV-5/7: isoplanatic angle, 500 nm",
            reference: HV57,
            value: 6.894,
            unit: "µrad",
            tolerance: Tolerance::Relative(2e-3),
            mutation: a_fifth_more("pseudo-wind"),
            run: |scale| {
                let k = TAU / 500e-9;
                let above = moment(&hv(scale.of(1.0), 1.0), 5.0 / 3.0);
                Ok(1e6 * (2.914 * k * k * above).powf(-0.6))
            },
        },
    ]
}

/// The radius in still air of the laser's focus at 1 km [m].
fn focus_m() -> f64 {
    let laser = Laser {
        power_w: 1.0,
        wavelength_m: LAMBDA_M,
        aperture_radius_m: W0_M,
        m2: 1.0,
    };
    laser.spot_radius_m(LENGTH_M, LENGTH_M)
}

fn spots() -> Vec<Check> {
    const HUYGENS: &str = "extended Huygens–Fresnel integral (Andrews & Phillips), summed finely";
    let w_m = LAMBDA_M * LENGTH_M / (0.5 * TAU * W0_M);
    let fried_m = |cn2| theory::fried_spherical_m(LAMBDA_M, cn2, LENGTH_M);
    let long = |name, cn2, run| Check {
        model: "turbulence",
        name,
        reference: HUYGENS,
        value: 1e3 * theory::long_term_m(w_m, W0_M, fried_m(cn2), f64::INFINITY),
        unit: "mm",
        tolerance: Tolerance::Relative(2e-3),
        mutation: a_fifth_more("Cn²"),
        run,
    };
    vec![
        Check {
            model: "turbulence",
            name: "long-term radius by the weak formula, from the model's radius and Rytov variance",
            reference: "Andrews & Phillips, ch. 6: W √(1 + 1.33 σ_R² Λ^(5/6)), by hand",
            value: 12.065,
            unit: "mm",
            tolerance: Tolerance::Relative(3e-3),
            mutation: a_fifth_more("Cn²"),
            run: |scale| {
                let rytov = uniform(scale.of(1e-14)).rytov_plane;
                Ok(1e3 * theory::weak_long_term_m(focus_m(), rytov, LENGTH_M, LAMBDA_M))
            },
        },
        Check {
            model: "turbulence",
            name: "long-term radius where turbulence is weak, Cn² 1e-16",
            reference: "Andrews & Phillips, ch. 6: W √(1 + 1.33 σ_R² Λ^(5/6))",
            value: 1e3 * theory::weak_long_term_m(w_m, 0.003_088, LENGTH_M, LAMBDA_M),
            unit: "mm",
            tolerance: Tolerance::Relative(1e-3),
            mutation: times("Cn²", 2.0),
            run: |scale| Ok(1e3 * uniform(scale.of(1e-16)).long_term_radius_m(focus_m())),
        },
        long("long-term radius, Cn² 1e-14", 1e-14, |scale| {
            Ok(1e3 * uniform(scale.of(1e-14)).long_term_radius_m(focus_m()))
        }),
        long("long-term radius, Cn² 1e-13", 1e-13, |scale| {
            Ok(1e3 * uniform(scale.of(1e-13)).long_term_radius_m(focus_m()))
        }),
        Check {
            model: "turbulence",
            name: "wander that long-term and short-term radius leave, rms, both axes",
            reference: "irradiance-weighted slope of Kolmogorov's phase over the aperture",
            value: 1e3 * LENGTH_M * theory::wander_rad(LAMBDA_M, W0_M, fried_m(1e-14)),
            unit: "mm",
            tolerance: Tolerance::Relative(0.10),
            mutation: times("Cn²", 2.0),
            run: |scale| {
                let t = uniform(scale.of(1e-14));
                let [long, short] = [
                    t.long_term_radius_m(focus_m()),
                    t.short_term_radius_m(focus_m()),
                ];
                Ok(1e3 * 0.5f64.sqrt() * (long * long - short * short).sqrt())
            },
        },
    ]
}
