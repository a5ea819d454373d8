//! Pointing laws and the measurements of loops.

use crate::check::{Check, Fault, Tolerance, a_fifth_more};
use crate::theory;
use boresight_models::control::lqg::{lqr_gain, solve_dare};
use boresight_models::control::paper::{PaperLaw, PaperPid};
use boresight_models::maths::frequency::{
    Margins, Response, bandwidth_hz, db, log_spaced, margins, step_figures,
};
use glam::DVec2;
use nalgebra::{Complex, DMatrix};
use std::f64::consts::{FRAC_PI_2, TAU};

pub fn checks() -> Vec<Check> {
    [lqg(), loops(), paper()].concat()
}

/// Solution of the scalar Riccati equation.
fn riccati(a: f64, b: f64, q: f64, r: f64) -> Result<f64, Fault> {
    let [a, b, q, r] = [a, b, q, r].map(|x| DMatrix::from_element(1, 1, x));
    Ok(solve_dare(&a, &b, &q, &r).map_err(Fault::of)?[(0, 0)])
}

/// Optimal gain on the rate of a sampled double integrator with the weights diag(1, 0) and `r`.
fn rate_gain(r: f64) -> Result<f64, Fault> {
    let a = DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 0.0, 1.0]);
    let b = DMatrix::from_row_slice(2, 1, &[0.0, 1.0]);
    let q = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 0.0]);
    let r = DMatrix::from_element(1, 1, r);
    let p = solve_dare(&a, &b, &q, &r).map_err(Fault::of)?;
    let gain = lqr_gain(&a, &b, &r, &p).ok_or(Fault::Nothing("lqr_gain"))?;
    Ok(gain[(0, 1)])
}

fn lqg() -> Vec<Check> {
    // b²p² + (r - a²r - b²q) p - qr = 0 at a 1.2, b 0.5, q 2, r 3.
    let half = 0.5 * (3.0 - 1.44 * 3.0 - 0.25 * 2.0);
    vec![
        Check {
            model: "lqg",
            name: "Riccati equation with all ones",
            reference: "p² = p + 1: the golden ratio",
            value: 0.5 * (1.0 + 5f64.sqrt()),
            unit: "",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("weight of the input"),
            run: |scale| riccati(1.0, 1.0, 1.0, scale.of(1.0)),
        },
        Check {
            model: "lqg",
            name: "Riccati equation of an unstable plant",
            reference: "quadratic equation",
            value: (-half + (half * half + 0.25 * 6.0f64).sqrt()) / 0.25,
            unit: "",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("pole of the plant"),
            run: |scale| riccati(scale.of(1.2), 0.5, 2.0, 3.0),
        },
        Check {
            model: "lqg",
            name: "gain on the rate of a double integrator",
            reference: "spectral factorisation: √((√17 - 1)/2)",
            value: (0.5 * (17f64.sqrt() - 1.0)).sqrt(),
            unit: "",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("weight of the input"),
            run: |scale| rate_gain(scale.of(1.0)),
        },
    ]
}

fn responses(of: impl Fn(Complex<f64>) -> Complex<f64>) -> Vec<Response> {
    let at = |frequency_hz| Response {
        frequency_hz,
        value: of(Complex::new(0.0, TAU * frequency_hz)),
    };
    log_spaced(0.01, 100.0, 400).into_iter().map(at).collect()
}

/// Margins of a gain of 10 /s and an integrator behind a delay [s].
fn delayed(delay_s: f64) -> Margins {
    margins(&responses(|s| 10.0 / s * (-s * delay_s).exp()))
}

fn loops() -> Vec<Check> {
    vec![
        Check {
            model: "pointing-loop",
            name: "phase margin of 10/s behind 30 ms",
            reference: "90° - KT",
            value: 90.0 - 0.3f64.to_degrees(),
            unit: "deg",
            tolerance: Tolerance::Absolute(0.01),
            mutation: a_fifth_more("delay"),
            run: |scale| {
                let found = delayed(scale.of(0.03)).phase_deg;
                Ok(found.ok_or(Fault::Nothing("margins"))?.value)
            },
        },
        Check {
            model: "pointing-loop",
            name: "gain margin of 10/s behind 30 ms",
            reference: "π/(2KT)",
            value: db(FRAC_PI_2 / 0.3),
            unit: "dB",
            tolerance: Tolerance::Absolute(0.01),
            mutation: a_fifth_more("delay"),
            run: |scale| {
                let found = delayed(scale.of(0.03)).gain_db;
                Ok(found.ok_or(Fault::Nothing("margins"))?.value)
            },
        },
        Check {
            model: "tuning",
            name: "-3 dB of a second-order system of 5 Hz, ζ 0.5",
            reference: "ω √(1 - 2ζ² + √((1 - 2ζ²)² + 1))",
            value: 5.0 * (0.5 + 1.25f64.sqrt()).sqrt(),
            unit: "Hz",
            tolerance: Tolerance::Relative(1e-3),
            mutation: a_fifth_more("natural frequency"),
            run: |scale| {
                let w = TAU * scale.of(5.0);
                let closed = responses(|s| w * w / (s * s + w * s + w * w));
                bandwidth_hz(&closed).ok_or(Fault::Nothing("bandwidth_hz"))
            },
        },
        Check {
            model: "tuning",
            name: "overshoot of a second-order step, ζ 0.5",
            reference: "e^(-πζ/√(1-ζ²))",
            value: theory::overshoot(0.5),
            unit: "",
            tolerance: Tolerance::Relative(1e-4),
            mutation: a_fifth_more("damping ratio"),
            run: |scale| {
                let damping = scale.of(0.5);
                let at = |k| theory::second_order_step(20.0, damping, 1e-4 * f64::from(k));
                let samples: Vec<f64> = (1..=20_000).map(at).collect();
                let figures = step_figures(&samples, 1.0, 1e-4);
                Ok(figures.ok_or(Fault::Nothing("step_figures"))?.overshoot)
            },
        },
    ]
}

fn paper() -> Vec<Check> {
    vec![Check {
        model: "the-papers-control-laws",
        name: "eq. 9, third frame of errors 20, 30 and 10 mrad at 60 Hz",
        reference: "by hand: Kp e + Ki Σ e dt + Kd Δe/dt",
        value: 0.15 + 0.002 - 1.2,
        unit: "mrad",
        tolerance: Tolerance::Absolute(1e-9),
        mutation: a_fifth_more("derivative gain"),
        run: |scale| {
            let law = PaperLaw {
                kd_s: scale.of(PaperLaw::COARSE.kd_s),
                ..PaperLaw::COARSE
            };
            let mut pid = PaperPid::default();
            let errors = [20e-3, 30e-3, 10e-3].map(|x| DVec2::new(x, 0.0));
            let outputs = errors.map(|error_rad| pid.step(&law, error_rad, 1.0 / 60.0));
            Ok(1e3 * outputs[2].x)
        },
    }]
}
