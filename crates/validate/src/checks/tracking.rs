//! Estimation: filters that know their own error, detections by truth, threat, distances of beams.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use boresight_models::engage::interlock::{arc_distance_rad, segment_distance_m};
use boresight_models::engage::threat::time_to_asset_s;
use boresight_models::maths::kinematics::los_to_az_el;
use boresight_models::maths::rng::Stream;
use boresight_models::optics::detection::{Candidate, TruthErrors, detect_truth};
use boresight_models::sensing::radar::{Plot, RadarErrors, RadarTrack};
use boresight_models::tracking::cartesian::{
    ACCELERATION_PSD, Bearing, CartesianTrack, FIRST_VELOCITY_SIGMA_MPS, crossing,
};
use boresight_models::tracking::estimation::{LosFilter, LosFilterParams, MotionMode};
use boresight_models::tracking::ranging::Ranging;
use glam::{DVec2, DVec3};
use nalgebra::Vector3;

pub fn checks() -> Vec<Check> {
    [detections(), filters(), stations(), engage()].concat()
}

/// Share found, and rms of the place across [px], of a UAV whose misses and noise are those over 20,000 frames.
fn detected(miss_rate: f64, noise_px: f64) -> [f64; 2] {
    const FRAMES: u64 = 20_000;
    let seen = Candidate {
        index: 0,
        box_px: [300.0, 200.0, 320.0, 212.0],
        distractor: false,
    };
    let errors = TruthErrors {
        noise_px,
        miss_rate,
        distractor_rate: 0.0,
        false_alarms_per_frame: 0.0,
    };
    let mut found = Vec::new();
    for key in 0..FRAMES {
        let all = std::iter::once(seen);
        detect_truth(
            all,
            &errors,
            [0, 0],
            [640, 480],
            [640, 480],
            key,
            &mut found,
        );
    }
    let square: f64 = found
        .iter()
        .map(|of| (of.centre_px()[0] - 310.0).powi(2))
        .sum();
    let count = found.len() as f64;
    [count / FRAMES as f64, (square / count).sqrt()]
}

fn detections() -> Vec<Check> {
    vec![
        Check {
            model: "truth-detector",
            name: "share of frames in which a UAV is found, miss rate 0.1",
            reference: "the rate that is set",
            value: 0.9,
            unit: "",
            tolerance: Tolerance::Absolute(0.01),
            mutation: a_fifth_more("miss rate"),
            run: |scale| Ok(detected(scale.of(0.1), 0.8)[0]),
        },
        Check {
            model: "truth-detector",
            name: "rms error of the place, noise 0.8 px",
            reference: "the noise that is set",
            value: 0.8,
            unit: "px",
            tolerance: Tolerance::Relative(0.03),
            mutation: a_fifth_more("noise"),
            run: |scale| Ok(detected(0.1, scale.of(0.8))[1]),
        },
    ]
}

/// Mean squared error of the line-of-sight filter in units of its covariance (six degrees of freedom), after 2 s at 60 Hz:
/// targets whose acceleration is Singer's, of twice the rms that the filter believes times `factor`.
fn los_nees(factor: f64) -> Result<f64, Fault> {
    const RUNS: u64 = 200;
    const SIGMA_RAD: f64 = 27e-6; // [rad]
    const TAU_S: f64 = 2.0; // [s]
    const STEPS: u32 = 20; // between exposures
    let dt_s = 1.0 / 60.0 / f64::from(STEPS);
    let believed = LosFilterParams {
        modes: [MotionMode {
            accel_mps2: 2.0,
            share: 1.0,
        }; 3],
        accel_tau_s: TAU_S,
        gate_nis: 1e9,
        ..LosFilterParams::default()
    };
    let accel_sigma = factor * 2.0 / believed.range_m;
    let mut nees = 0.0;
    for run in 0..RUNS {
        let mut rng = Stream::new(11, run, "nees");
        // At the horizon azimuth and elevation are alike.
        let mut axes = [0; 2].map(|_| {
            let rate = believed.initial_rate_sigma_radps * rng.normal();
            Vector3::new(0.0, rate, accel_sigma * rng.normal())
        });
        let sight = |axes: &[Vector3<f64>; 2], rng: &mut Stream| {
            DVec2::from(axes.map(|axis| axis[0] + SIGMA_RAD * rng.normal()))
        };
        let first = sight(&axes, &mut rng);
        let mut filter = LosFilter::start(believed, first, SIGMA_RAD, 0.0).map_err(Fault::of)?;
        let keep = (-dt_s / TAU_S).exp();
        let kick = accel_sigma * (1.0 - keep * keep).sqrt();
        for k in 1..=120 {
            for _ in 0..STEPS {
                for axis in &mut axes {
                    let accel = keep * axis[2] + kick * rng.normal();
                    let mean = 0.5 * (accel + axis[2]);
                    axis[0] += dt_s * axis[1] + 0.5 * dt_s * dt_s * mean;
                    axis[1] += dt_s * mean;
                    axis[2] = accel;
                }
            }
            filter.update(sight(&axes, &mut rng), SIGMA_RAD, f64::from(k) / 60.0);
        }
        let found = filter.predicted(2.0);
        let states = [
            Vector3::new(found.az_rad, found.az_rate_radps, found.az_accel_radps2),
            Vector3::new(found.el_rad, found.el_rate_radps, found.el_accel_radps2),
        ];
        for ((truth, state), covariance) in axes.iter().zip(states).zip(found.covariance) {
            let inverse = covariance.try_inverse();
            let inverse = inverse.ok_or(Fault::Nothing("LosFilter::predicted"))?;
            let off = truth - state;
            nees += off.dot(&(inverse * off)) / RUNS as f64;
        }
    }
    Ok(nees)
}

/// Mean squared error of a radar's cue in direction and range, in units of its deviations (three degrees of freedom), where
/// the radar's errors are those it states times `factor`.
fn radar_nees(factor: f64) -> f64 {
    const RUNS: u64 = 2000;
    let stated = RadarErrors {
        sigma_rad: 0.012,
        range_sigma_m: 15.0,
    };
    let true_errors = RadarErrors {
        sigma_rad: factor * stated.sigma_rad,
        range_sigma_m: factor * stated.range_sigma_m,
    };
    let mut nees = 0.0;
    for seed in 0..RUNS {
        let mut rng = Stream::new(seed, 0, "radar");
        let mut r_m = DVec3::new(-700.0, 650.0, 90.0);
        let mut v_mps = DVec3::from(FIRST_VELOCITY_SIGMA_MPS) * rng.normal3();
        let plot = |r_m: DVec3, t_s: f64, rng: &mut Stream| Plot {
            errors: stated,
            ..true_errors.plot(r_m, t_s, rng)
        };
        let mut track = RadarTrack::start(&plot(r_m, 0.0, &mut rng));
        let dt_s = 0.02; // [s]
        for i in 1..=375 {
            let t_s = f64::from(i) * dt_s;
            r_m += v_mps * dt_s;
            v_mps += rng.normal3() * (ACCELERATION_PSD * dt_s).sqrt();
            if i % 50 == 0 {
                track.update(&plot(r_m, t_s, &mut rng));
            }
        }
        let (cue, at) = (track.cue(375.0 * dt_s), los_to_az_el(r_m));
        let off = (at - cue.az_el_rad) * DVec2::new(at.y.cos(), 1.0) / cue.sigma_rad;
        let range = (r_m.length() - cue.range_m) / cue.range_sigma_m;
        nees += (off.length_squared() + range * range) / RUNS as f64;
    }
    nees
}

/// Mean squared error of the ranging in units of its deviation after 3 s, with a laser of 2 m times `factor` that is believed
/// to have 2 m.
fn ranging_nees(factor: f64) -> Result<f64, Fault> {
    const RUNS: u64 = 1000;
    let dt_s = 1.0 / 60.0;
    let mut nees = 0.0;
    for run in 0..RUNS {
        let mut rng = Stream::new(2, run, "ranging");
        let mut ranging = Ranging::new(0.35, 0.3).map_err(Fault::of)?;
        // What the model says of targets: 15 m/s of closing speed, 16 m²/s³ of acceleration.
        let (mut range_m, mut rate_mps) = (600.0, 15.0 * rng.normal());
        let span_m = 0.35 * (0.3 * rng.normal()).exp();
        for k in 0..180 {
            let t_s = f64::from(k) * dt_s;
            ranging.on_size(span_m / range_m * (0.05 * rng.normal()).exp(), 0.05, t_s);
            if k % 6 == 0 {
                ranging.on_laser(range_m + factor * 2.0 * rng.normal(), 2.0, t_s);
            }
            range_m += rate_mps * dt_s;
            rate_mps += (16.0 * dt_s).sqrt() * rng.normal();
        }
        let found = ranging.range_m(3.0);
        let (estimate_m, sigma_m) = found.ok_or(Fault::Nothing("Ranging::range_m"))?;
        nees += ((estimate_m - range_m) / sigma_m).powi(2) / RUNS as f64;
    }
    Ok(nees)
}

fn filters() -> Vec<Check> {
    vec![
        Check {
            model: "line-of-sight-filter",
            name: "mean squared error over the covariance, 200 runs",
            reference: "χ² of six degrees of freedom, five standard errors",
            value: 6.0,
            unit: "",
            tolerance: Tolerance::Absolute(1.22),
            mutation: times("targets' acceleration", 2.0),
            run: |scale| los_nees(scale.of(1.0)),
        },
        Check {
            model: "radar-cue",
            name: "mean squared error of the cue over its deviations, 2,000 runs",
            reference: "χ² of three degrees of freedom, five standard errors",
            value: 3.0,
            unit: "",
            tolerance: Tolerance::Absolute(0.27),
            mutation: times("radar's errors", 1.5),
            run: |scale| Ok(radar_nees(scale.of(1.0))),
        },
        Check {
            model: "ranging",
            name: "mean squared error of the range over its deviation, 1,000 runs",
            reference: "χ² of one degree of freedom, five standard errors",
            value: 1.0,
            unit: "",
            tolerance: Tolerance::Absolute(0.22),
            mutation: times("range finder's error", 2.0),
            run: |scale| ranging_nees(scale.of(1.0)),
        },
    ]
}

const STATIONS_M: [DVec3; 2] = [DVec3::ZERO, DVec3::new(320.0, -60.0, 10.0)];
const TARGET_M: DVec3 = DVec3::new(-250.0, 680.0, 90.0);

/// Where a station sees a target, with a noise [rad] that it states as 40 µrad.
fn bearing(from: usize, r_enu_m: DVec3, sigma_rad: f64, rng: &mut Stream) -> Bearing {
    let noise = rng.normal3() * sigma_rad;
    let at = los_to_az_el(r_enu_m - STATIONS_M[from]);
    Bearing {
        r_from_enu_m: STATIONS_M[from],
        az_el_rad: at + DVec2::new(noise.x / at.y.cos(), noise.y),
        sigma_rad: 4e-5,
    }
}

/// Mean squared error of two stations' track in units of its covariance (six degrees of freedom), the bearings' noise times
/// `factor`.
fn two_stations_nees(factor: f64) -> Result<f64, Fault> {
    const RUNS: u64 = 200;
    let sigma_rad = factor * 4e-5;
    let mut nees = 0.0;
    for seed in 0..RUNS {
        let mut rng = Stream::new(seed, 0, "cartesian");
        let mut r_m = TARGET_M;
        let mut v_mps = DVec3::from(FIRST_VELOCITY_SIGMA_MPS) * rng.normal3();
        // A start that is not gated by what the noise is: the first directions are exact but for what they state.
        let [a, b] = [0, 1].map(|from| bearing(from, r_m, 4e-5, &mut rng));
        let Some((at_m, covariance_m2)) = crossing(&a, &b, 1.0) else {
            continue;
        };
        let mut track = CartesianTrack::start(0.0, at_m, &covariance_m2);
        let (steps, report_s) = (12, 0.05);
        let dt_s = report_s / f64::from(steps);
        for k in 1..=60 {
            for _ in 0..steps {
                // White acceleration over a step: velocity and position are correlated.
                let (kick, push) = (rng.normal3(), rng.normal3());
                let root = (ACCELERATION_PSD * dt_s).sqrt();
                r_m += v_mps * dt_s + root * dt_s * (0.5 * kick + push / 12f64.sqrt());
                v_mps += root * kick;
            }
            let t_s = f64::from(k) * report_s;
            for from in 0..2 {
                track.take_bearing(t_s, &bearing(from, r_m, sigma_rad, &mut rng));
            }
        }
        nees += track.advanced(60.0 * report_s).distance2(r_m, v_mps) / RUNS as f64;
    }
    Ok(nees)
}

fn stations() -> Vec<Check> {
    vec![
        Check {
            model: "stations-network",
            name: "range at which two stations' directions cross",
            reference: "the target that both look at",
            value: TARGET_M.length(),
            unit: "m",
            tolerance: Tolerance::Absolute(1e-6),
            mutation: a_fifth_more(
                "the first station's range to what it looks at, along the other's line",
            ),
            run: |scale| {
                // The second station looks at the target; the first at a place on the second's line.
                let along_m = STATIONS_M[1] + scale.of(1.0) * (TARGET_M - STATIONS_M[1]);
                let mut none = Stream::new(1, 0, "none");
                let a = bearing(0, along_m, 0.0, &mut none);
                let b = bearing(1, TARGET_M, 0.0, &mut none);
                let found = crossing(&a, &b, 0.0).ok_or(Fault::Nothing("crossing"))?;
                Ok(found.0.length())
            },
        },
        Check {
            model: "stations-network",
            name: "mean squared error of two stations' track over its covariance, 200 runs",
            reference: "χ² of six degrees of freedom, five standard errors",
            value: 6.0,
            unit: "",
            tolerance: Tolerance::Absolute(1.22),
            mutation: times("noise of a bearing", 1.5),
            run: |scale| two_stations_nees(scale.of(1.0)),
        },
    ]
}

fn engage() -> Vec<Check> {
    vec![
        Check {
            model: "threat-and-target-choice",
            name: "time to the asset, 800 m away at 10 m/s head-on",
            reference: "distance over speed",
            value: 80.0,
            unit: "s",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("speed"),
            run: |scale| {
                let towards_mps = -scale.of(10.0) * DVec3::Y;
                Ok(time_to_asset_s(800.0 * DVec3::Y, towards_mps, DVec3::ZERO))
            },
        },
        Check {
            model: "interlocks",
            name: "distance of skew segments",
            reference: "common perpendicular",
            value: 2.0,
            unit: "m",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("height of the second"),
            run: |scale| {
                let up = scale.of(2.0);
                let a = [DVec3::NEG_X, DVec3::X];
                let b = [DVec3::new(0.3, -1.0, up), DVec3::new(0.3, 1.0, up)];
                Ok(segment_distance_m(a, b))
            },
        },
        Check {
            model: "interlocks",
            name: "angle from the horizon to a beam that passes 30° above it",
            reference: "great circle",
            value: 30.0,
            unit: "deg",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("angle"),
            run: |scale| {
                let (sin, cos) = scale.of(30f64).to_radians().sin_cos();
                let at = |x: f64| DVec3::new(x, cos, sin);
                let found_rad = arc_distance_rad(DVec3::ZERO, DVec3::Y, [at(-1.0), at(1.0)]);
                Ok(found_rad.to_degrees())
            },
        },
    ]
}
