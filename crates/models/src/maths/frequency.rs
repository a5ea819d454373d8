//! Frequency response of a sampled plant by swept sine, margins of a loop, figures of a step response.
//!
//! A plant is a closure that takes the input of one tick and returns its output at the tick's end.
//! After settling, input and output are correlated with one sine over whole periods, as a servo
//! analyser does; the harmonics that friction and saturation make are orthogonal to it and drop out,
//! so what is measured is the describing function *at that amplitude*.
//!
//! The open loop comes from the closed one: with the error r − y driving the loop,
//! L = T/(1 − T). That needs no break in the loop, which could not run without its integrators.

use std::f64::consts::TAU;

use nalgebra::Complex;

/// Response at one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Frequency [Hz].
    pub frequency_hz: f64,
    /// Output over input, complex amplitude.
    pub value: Complex<f64>,
}

/// How a sweep is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Tick [s].
    pub dt_s: f64,
    /// Amplitude of the input [input units].
    pub amplitude: f64,
    /// Time before the correlation begins [s].
    pub settle_s: f64,
    /// Least time of the correlation [s]; at least two periods are taken.
    pub measure_s: f64,
}

impl Sweep {
    /// Responses near `frequencies_hz`; `plant` makes a fresh plant for each.
    ///
    /// Every frequency is moved by less than a tick in the measuring time, to one of which a whole
    /// number of periods fills a whole number of ticks.
    pub fn run<P: FnMut(f64) -> f64>(
        &self,
        frequencies_hz: &[f64],
        mut plant: impl FnMut() -> P,
    ) -> Vec<Response> {
        frequencies_hz
            .iter()
            .map(|&wanted_hz| {
                let periods = (self.measure_s * wanted_hz).ceil().max(2.0);
                let ticks = (periods / (wanted_hz * self.dt_s)).round();
                let step = TAU * periods / ticks;
                let mut plant = plant();
                let settle = (self.settle_s / self.dt_s).ceil() as u64;
                let mut sum = Complex::new(0.0, 0.0);
                for tick in 0..settle + ticks as u64 {
                    let phase = step * tick as f64;
                    let y = plant(self.amplitude * phase.sin());
                    if tick >= settle {
                        // The output belongs to the tick's end.
                        sum += Complex::from_polar(y, -(phase + step));
                    }
                }
                // Σ a sin(θ + φ) e^{−iθ} over whole periods = a N e^{iφ}/(2i).
                let value = sum * Complex::new(0.0, 2.0) / (ticks * self.amplitude);
                Response {
                    frequency_hz: periods / (ticks * self.dt_s),
                    value,
                }
            })
            .collect()
    }
}

/// `count` frequencies in equal ratios from `low_hz` to `high_hz`, both included.
pub fn log_spaced(low_hz: f64, high_hz: f64, count: usize) -> Vec<f64> {
    let ratio = (high_hz / low_hz).ln() / (count.max(2) - 1) as f64;
    (0..count)
        .map(|k| low_hz * (ratio * k as f64).exp())
        .collect()
}

/// Open loop of a unity-feedback loop from its closed-loop response: L = T/(1 − T).
pub fn open_loop(closed: &[Response]) -> Vec<Response> {
    let one = Complex::new(1.0, 0.0);
    closed
        .iter()
        .map(|r| Response {
            value: r.value / (one - r.value),
            ..*r
        })
        .collect()
}

/// Phases [rad] without jumps; the first within (−3π/2, π/2].
pub fn unwrapped_phase_rad(responses: &[Response]) -> Vec<f64> {
    let mut last: Option<f64> = None;
    responses
        .iter()
        .map(|r| {
            let centre = last.unwrap_or(-0.25 * TAU);
            let raw = r.value.arg();
            let phase = raw + TAU * ((centre - raw) / TAU).round();
            last = Some(phase);
            phase
        })
        .collect()
}

/// A margin and the frequency at which it is found.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Margin {
    /// Gain margin [dB] or phase margin [deg].
    pub value: f64,
    /// Frequency [Hz].
    pub frequency_hz: f64,
}

/// Stability margins of a loop.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Margins {
    /// Least factor above one, in dB, by which the gain may grow at a phase of −180°; none if the
    /// phase never gets there below unit gain.
    pub gain_db: Option<Margin>,
    /// Least distance of the phase from −180° where the gain passes one [deg].
    pub phase_deg: Option<Margin>,
    /// Largest |1/(1 + L)|: the inverse of the least distance from −1.
    pub peak_sensitivity: f64,
}

/// Decibels of a magnitude.
pub fn db(magnitude: f64) -> f64 {
    20.0 * magnitude.log10()
}

/// Margins of an open loop, interpolated along logarithmic frequency, gain and phase.
pub fn margins(open: &[Response]) -> Margins {
    let phase = unwrapped_phase_rad(open);
    let gain: Vec<f64> = open.iter().map(|r| r.value.norm().ln()).collect();
    let (mut gain_db, mut phase_deg): (Option<Margin>, Option<Margin>) = (None, None);
    let keep_less = |kept: &mut Option<Margin>, new: Margin| {
        if kept.is_none_or(|kept| new.value < kept.value) {
            *kept = Some(new);
        }
    };
    for k in 1..open.len() {
        let (a, b) = (k - 1, k);
        let at = |s: f64| {
            let (low, high) = (open[a].frequency_hz, open[b].frequency_hz);
            low * (high / low).powf(s)
        };
        // The gain passes one.
        if gain[a] * gain[b] <= 0.0 && gain[a] != gain[b] {
            let s = gain[a] / (gain[a] - gain[b]);
            let crossing = phase[a] + s * (phase[b] - phase[a]);
            // Distance from the nearest odd multiple of a half turn.
            let turns = ((crossing / TAU) - 0.5).round() + 0.5;
            let margin = Margin {
                value: (crossing - turns * TAU).abs().to_degrees(),
                frequency_hz: at(s),
            };
            keep_less(&mut phase_deg, margin);
        }
        // The phase passes an odd multiple of a half turn.
        let sector = |p: f64| (p / TAU - 0.5).floor();
        if sector(phase[a]) != sector(phase[b]) {
            let odd = (sector(phase[a]).max(sector(phase[b])) + 0.5) * TAU;
            let s = (odd - phase[a]) / (phase[b] - phase[a]);
            let value = -db((gain[a] + s * (gain[b] - gain[a])).exp());
            if value > 0.0 {
                let frequency_hz = at(s);
                keep_less(
                    &mut gain_db,
                    Margin {
                        value,
                        frequency_hz,
                    },
                );
            }
        }
    }
    let one = Complex::new(1.0, 0.0);
    let peak_sensitivity = open
        .iter()
        .map(|r| 1.0 / (one + r.value).norm())
        .fold(0.0, f64::max);
    Margins {
        gain_db,
        phase_deg,
        peak_sensitivity,
    }
}

/// Frequency [Hz] at which a closed loop first falls 3 dB below its response at the lowest one.
pub fn bandwidth_hz(closed: &[Response]) -> Option<f64> {
    let floor = closed.first()?.value.norm().ln() - 0.5 * std::f64::consts::LN_2;
    closed.windows(2).find_map(|pair| {
        let [a, b] = [0, 1].map(|i: usize| pair[i].value.norm().ln() - floor);
        let (low, high) = (pair[0].frequency_hz, pair[1].frequency_hz);
        (a > 0.0 && b <= 0.0).then(|| low * (high / low).powf(a / (a - b)))
    })
}

/// Figures of a step response.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct StepFigures {
    /// Time from 10 % to 90 % of the final value [s].
    pub rise_s: f64,
    /// Highest excess over the final value, as a share of it.
    pub overshoot: f64,
    /// Time after which it stays within 2 % of the final value [s]; none if it does not by the end.
    pub settling_s: Option<f64>,
}

/// Figures of a response to a step at time zero, sampled at the ends of ticks of `dt_s`, that has
/// settled on `last`; `None` if it never reaches 90 %.
pub fn step_figures(samples: &[f64], last: f64, dt_s: f64) -> Option<StepFigures> {
    let share = |k: usize| samples[k] / last;
    // Time at which a share is first reached, interpolated from the sample (or the zero) before.
    let reach = |wanted: f64| {
        (0..samples.len()).find(|&k| share(k) >= wanted).map(|k| {
            let before = if k == 0 { 0.0 } else { share(k - 1) };
            (k as f64 + (wanted - before) / (share(k) - before)) * dt_s
        })
    };
    let rise_s = reach(0.9)? - reach(0.1)?;
    let overshoot = (0..samples.len()).map(share).fold(0.0, f64::max) - 1.0;
    let outside = (0..samples.len()).rposition(|k| (share(k) - 1.0).abs() > 0.02);
    Some(StepFigures {
        rise_s,
        overshoot: overshoot.max(0.0),
        settling_s: (outside.map_or(0, |k| k + 1) < samples.len())
            .then(|| outside.map_or(0.0, |k| (k + 1) as f64 * dt_s)),
    })
}

#[cfg(test)]
mod tests {
    use super::super::second_order::second_order_transition;
    use super::*;
    use std::collections::VecDeque;

    const DT: f64 = 1.0 / 960.0;

    fn sweep() -> Sweep {
        Sweep {
            dt_s: DT,
            amplitude: 0.3,
            settle_s: 4.0,
            measure_s: 1.0,
        }
    }

    #[test]
    fn first_order_and_delay_are_their_z_transforms() {
        // y' = a y + (1 − a) u: H = (1 − a) z/(z − a) with the output at the tick's end taken a
        // tick after its input; delayed by n ticks, times z⁻ⁿ.
        let (a, n) = (0.98f64, 7);
        let frequencies = log_spaced(0.1, 400.0, 25);
        let responses = sweep().run(&frequencies, || {
            let mut y = 0.0;
            let mut line = VecDeque::from(vec![0.0; n]);
            move |u| {
                line.push_back(u);
                y = a * y + (1.0 - a) * line.pop_front().unwrap();
                y
            }
        });
        for (r, wanted) in responses.iter().zip(frequencies) {
            assert!((r.frequency_hz / wanted - 1.0).abs() < 2e-3 || wanted > 50.0);
            let theta = TAU * r.frequency_hz * DT;
            let z = Complex::from_polar(1.0, theta);
            // The tick's end is one tick after the input's sample.
            let expected = (1.0 - a) / (z - a) * Complex::from_polar(1.0, -theta * n as f64);
            assert!((r.value - expected).norm() < 1e-9, "{r:?} {expected}");
        }
    }

    #[test]
    fn second_order_servo_is_met_up_to_its_hold() {
        let (natural_hz, damping) = (500.0, 0.7);
        let [[a, b], [c, d]] = second_order_transition(natural_hz, damping, DT).unwrap();
        let responses = sweep().run(&log_spaced(1.0, 40.0, 12), || {
            let (mut x, mut rate) = (0.0, 0.0);
            move |u| {
                let offset = x - u;
                (x, rate) = (u + a * offset + b * rate, c * offset + d * rate);
                x
            }
        });
        let w0 = TAU * natural_hz;
        for r in responses {
            let w = TAU * r.frequency_hz;
            let s = Complex::new(0.0, w);
            let servo = w0 * w0 / (s * s + 2.0 * damping * w0 * s + w0 * w0);
            // A zero-order hold delays by half a tick and lowers by sinc; its images are 960 Hz away.
            let x = 0.5 * w * DT;
            let hold = Complex::from_polar(x.sin() / x, -x);
            assert!((r.value / (servo * hold) - 1.0).norm() < 0.02, "{r:?}");
        }
    }

    fn analytic(f: impl Fn(Complex<f64>) -> Complex<f64>) -> Vec<Response> {
        log_spaced(0.01, 100.0, 400)
            .into_iter()
            .map(|frequency_hz| Response {
                frequency_hz,
                value: f(Complex::new(0.0, TAU * frequency_hz)),
            })
            .collect()
    }

    #[test]
    fn margins_of_an_integrator_with_delay_are_the_closed_form() {
        // L = K e^{−sT}/s: crossover K, phase margin 90° − KT, gain margin π/(2KT).
        let (k, delay) = (10.0, 0.03);
        let loop_ = analytic(|s| k / s * (-s * delay).exp());
        let m = margins(&loop_);
        let phase = m.phase_deg.unwrap();
        assert!((phase.value - (90.0 - (k * delay).to_degrees())).abs() < 0.01);
        assert!((phase.frequency_hz / (k / TAU) - 1.0).abs() < 1e-4);
        let gain = m.gain_db.unwrap();
        let expected = std::f64::consts::FRAC_PI_2 / (k * delay);
        assert!((gain.value - db(expected)).abs() < 0.01, "{gain:?}");
        assert!((gain.frequency_hz - 0.25 / delay).abs() < 0.01);
        // The distance from −1 is no greater than either margin allows.
        let nearest = 1.0 / m.peak_sensitivity;
        assert!(nearest < 1.0 - 1.0 / expected + 1e-3);
        assert!(nearest < 2.0 * (0.5 * phase.value.to_radians()).sin() + 1e-3);
    }

    #[test]
    fn margins_of_a_second_order_loop_are_the_closed_form() {
        // L = ω²/(s(s + 2ζω)): crossover ω√(√(4ζ⁴+1) − 2ζ²), margin atan(2ζω/ω_c), no gain margin;
        // closed, it is the standard second-order system.
        let (w, z) = (TAU * 5.0, 0.5f64);
        let loop_ = analytic(|s| w * w / (s * (s + 2.0 * z * w)));
        let m = margins(&loop_);
        let crossover = w * ((4.0 * z.powi(4) + 1.0).sqrt() - 2.0 * z * z).sqrt();
        let phase = m.phase_deg.unwrap();
        assert!((TAU * phase.frequency_hz / crossover - 1.0).abs() < 1e-3);
        assert!((phase.value - (2.0 * z * w / crossover).atan().to_degrees()).abs() < 0.02);
        assert!(m.gain_db.is_none());
        let closed = analytic(|s| w * w / (s * s + 2.0 * z * w * s + w * w));
        let back = open_loop(&closed);
        for (a, b) in back.iter().zip(&loop_) {
            assert!((a.value / b.value - 1.0).norm() < 1e-6);
        }
        // −3 dB at ω√(1 − 2ζ² + √((1 − 2ζ²)² + 1)).
        let q = 1.0 - 2.0 * z * z;
        let expected = 5.0 * (q + (q * q + 1.0).sqrt()).sqrt();
        assert!((bandwidth_hz(&closed).unwrap() / expected - 1.0).abs() < 1e-3);
    }

    #[test]
    fn step_figures_of_first_and_second_order() {
        let dt = 1e-4;
        let samples = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (1..=40_000).map(|k| f(f64::from(k) * dt)).collect()
        };
        // 1 − e^{−t/τ}: rise τ ln 9, settling τ ln 50.
        let tau = 0.1;
        let first = step_figures(&samples(&|t| 2.0 - 2.0 * (-t / tau).exp()), 2.0, dt).unwrap();
        assert!((first.rise_s / (tau * 9f64.ln()) - 1.0).abs() < 1e-4);
        assert!((first.settling_s.unwrap() / (tau * 50f64.ln()) - 1.0).abs() < 1e-3);
        assert_eq!(first.overshoot, 0.0);
        // Overshoot e^{−πζ/√(1−ζ²)}.
        let (w, z) = (20.0, 0.5f64);
        let wd = w * (1.0 - z * z).sqrt();
        let second =
            samples(&|t| 1.0 - (-z * w * t).exp() * ((wd * t).cos() + z * w / wd * (wd * t).sin()));
        let figures = step_figures(&second, 1.0, dt).unwrap();
        let expected = (-std::f64::consts::PI * z / (1.0 - z * z).sqrt()).exp();
        assert!((figures.overshoot - expected).abs() < 1e-5);
        assert!(step_figures(&[0.0, 0.1], 1.0, dt).is_none());
        assert_eq!(
            step_figures(&[0.0, 0.95], 1.0, dt).unwrap().settling_s,
            None
        );
    }
}
