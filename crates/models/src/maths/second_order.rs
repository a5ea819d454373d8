//! Second-order systems stepped exactly: servos, resonances, the modes of a swaying base.

use std::f64::consts::TAU;

use thiserror::Error;

/// Why a second-order element cannot be built.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum SecondOrderError {
    /// A frequency, damping ratio or step that is not a positive finite number.
    #[error(
        "second-order element of {frequency_hz} Hz, damping {damping}, step {dt_s} s is not positive; give values above 0"
    )]
    NotPositive {
        /// Natural frequency [Hz].
        frequency_hz: f64,
        /// Damping ratio.
        damping: f64,
        /// Step [s].
        dt_s: f64,
    },
    /// An amplitude (stroke or rms) that is negative or not finite.
    #[error("amplitude {0} rad is not a non-negative number; give 0 or more")]
    Amplitude(f64),
}

/// State-transition matrix over `dt_s` of ẍ + 2ζωẋ + ω²x = 0, rows (x, ẋ), for any damping ratio
/// ζ > 0.
pub fn second_order_transition(
    frequency_hz: f64,
    damping: f64,
    dt_s: f64,
) -> Result<[[f64; 2]; 2], SecondOrderError> {
    if ![frequency_hz, damping, dt_s]
        .iter()
        .all(|x| *x > 0.0 && x.is_finite())
    {
        return Err(SecondOrderError::NotPositive {
            frequency_hz,
            damping,
            dt_s,
        });
    }
    let omega = TAU * frequency_hz;
    let sigma = damping * omega;
    // The damped frequency squared, negative when overdamped.
    let square = omega * omega - sigma * sigma;
    let x = square.abs().sqrt() * dt_s;
    let (c, s) = if x < 1e-4 {
        let x2 = square * dt_s * dt_s;
        (1.0 - 0.5 * x2, dt_s * (1.0 - x2 / 6.0))
    } else if square > 0.0 {
        (x.cos(), dt_s * x.sin() / x)
    } else {
        (x.cosh(), dt_s * x.sinh() / x)
    };
    let decay = (-sigma * dt_s).exp();
    Ok([
        [decay * (c + sigma * s), decay * s],
        [-decay * omega * omega * s, decay * (c - sigma * s)],
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_matrix_is_the_closed_form_of_every_damping() {
        // From rest at x = 1: the published free responses.
        let (hz, dt_s) = (3.0, 0.07);
        let w = TAU * hz;
        for damping in [0.1, 0.7, 1.0, 2.5] {
            let [[x, _], _] = second_order_transition(hz, damping, dt_s).unwrap();
            let s = damping * w;
            let expected = if damping < 1.0 {
                let wd = w * f64::sqrt(1.0 - damping * damping);
                (-s * dt_s).exp() * ((wd * dt_s).cos() + s / wd * (wd * dt_s).sin())
            } else if damping == 1.0 {
                (-w * dt_s).exp() * (1.0 + w * dt_s)
            } else {
                let root = w * f64::sqrt(damping * damping - 1.0);
                let (p, q) = (s - root, s + root);
                (q * (-p * dt_s).exp() - p * (-q * dt_s).exp()) / (q - p)
            };
            assert!((x - expected).abs() < 1e-12, "{damping}: {x} {expected}");
        }
    }

    #[test]
    fn two_steps_are_one_of_twice_the_length() {
        let once = second_order_transition(40.0, 0.3, 1e-3).unwrap();
        let twice = second_order_transition(40.0, 0.3, 2e-3).unwrap();
        for i in 0..2 {
            for j in 0..2 {
                let product = once[i][0] * once[0][j] + once[i][1] * once[1][j];
                assert!((product - twice[i][j]).abs() < 1e-9 * (1.0 + product.abs()));
            }
        }
    }

    #[test]
    fn bad_numbers_are_refused() {
        for (hz, damping, dt_s) in [(0.0, 0.7, 1e-3), (1.0, -0.1, 1e-3), (1.0, 0.7, f64::NAN)] {
            assert!(second_order_transition(hz, damping, dt_s).is_err());
        }
    }
}
