//! Sweeps of the simulated mount's loops, and the gains that follow from them.
//!
//! Every loop is measured closed, as it runs, by [`crate::maths::frequency`]; the open loop follows
//! from it. Friction makes the answer depend on the amplitude, so rate and position loop are
//! swept while the axis turns steadily, at a rate that the sine never brings back to zero: friction is
//! then a constant torque, which the servo's integrator carries.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use glam::DVec2;

use super::law::{HandOver, PointingInput};
use super::paper::{PaperLaw, PaperPid, coarse_axis_rates};
use super::pointing::PointingLaw;
use super::tuned::{MirrorRemainder, TunedPointing};
use crate::maths::frequency::{
    Margin, Margins, Response, StepFigures, Sweep, bandwidth_hz, log_spaced, margins, open_loop,
    step_figures,
};
use crate::maths::rng::Stream;
use crate::maths::second_order::SecondOrderError;
use crate::mount::gimbal::{self, AxisParams, GimbalCommand, GimbalParams, GimbalState};
use crate::mount::gyro::{Gyro, GyroParams};
use crate::mount::mirror::{Mirror, MirrorParams};
use crate::tracking::estimation::{LosFilter, LosFilterError, LosFilterParams};

/// Least gain margin of a loop [dB].
pub const GAIN_MARGIN_DB: f64 = 6.0;
/// Least phase margin of a loop [deg].
pub const PHASE_MARGIN_DEG: f64 = 45.0;
/// The position loop may cross over at no more than this share of the rate loop's bandwidth, so that the
/// two can be tuned one by one.
pub const CASCADE_SHARE: f64 = 0.1;

/// An axis of the gimbal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MountAxis {
    /// Outer axis.
    Azimuth,
    /// Inner axis.
    Elevation,
}

impl MountAxis {
    fn of(self, gimbal: &GimbalParams) -> &AxisParams {
        match self {
            MountAxis::Azimuth => &gimbal.azimuth,
            MountAxis::Elevation => &gimbal.elevation,
        }
    }

    fn unit(self) -> DVec2 {
        match self {
            MountAxis::Azimuth => DVec2::X,
            MountAxis::Elevation => DVec2::Y,
        }
    }
}

/// Why a loop cannot be measured.
#[derive(Clone, Copy, Debug, thiserror::Error, PartialEq)]
pub enum TuningError {
    /// The mirror's parameters are out of range.
    #[error(transparent)]
    Mirror(#[from] SecondOrderError),
    /// The filter's parameters are out of range.
    #[error(transparent)]
    Filter(#[from] LosFilterError),
    /// No gain of the position loop keeps the margins.
    #[error(
        "no gimbal gain keeps {GAIN_MARGIN_DB} dB and {PHASE_MARGIN_DEG} deg of margin; make the mount stiffer or its loops faster (bandwidths, rates, latency, the gyros' delay)"
    )]
    NoGain,
}

/// The mount as the loops act on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MountPlant {
    /// Gimbal with both axes.
    pub gimbal: GimbalParams,
    /// Fast steering mirror.
    pub mirror: MirrorParams,
    /// Gyros on base and rotors.
    pub gyro: GyroParams,
    /// Tick [s].
    pub dt_s: f64,
}

/// The camera as the pointing loop sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraTiming {
    /// Ticks from frame to frame.
    pub period_ticks: u64,
    /// Ticks from exposure to detection.
    pub latency_ticks: u64,
    /// Standard deviation of a detection that the filter is told [rad].
    pub sigma_rad: f64,
}

/// One loop, measured.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopMeasurement {
    /// Name for reports.
    pub name: String,
    /// Unit of its input.
    pub unit: &'static str,
    /// Amplitude of the sine, and size of the step [`Self::unit`].
    pub amplitude: f64,
    /// Closed loop, output over input.
    pub closed: Vec<Response>,
    /// Open loop, error to output.
    pub open: Vec<Response>,
    /// Stability margins of the open loop.
    pub margins: Margins,
    /// −3 dB bandwidth of the closed loop [Hz].
    pub bandwidth_hz: Option<f64>,
    /// Response to a step of the amplitude, over the amplitude, at the ends of ticks.
    pub step: Vec<f64>,
    /// Rise, overshoot and settling of that response.
    pub step_figures: Option<StepFigures>,
    /// Tick [s].
    pub dt_s: f64,
}

/// Sweeps and steps a plant in closed loop.
fn measure<P: FnMut(f64) -> f64>(
    name: String,
    unit: &'static str,
    sweep: &Sweep,
    frequencies_hz: &[f64],
    step_s: f64,
    mut plant: impl FnMut() -> P,
) -> LoopMeasurement {
    let closed = sweep.run(frequencies_hz, &mut plant);
    let open = open_loop(&closed);
    let mut run = plant();
    let mut rest = 0.0;
    for _ in 0..(sweep.settle_s / sweep.dt_s).ceil() as usize {
        rest = run(0.0);
    }
    let step: Vec<f64> = (0..(step_s / sweep.dt_s).ceil() as usize)
        .map(|_| (run(sweep.amplitude) - rest) / sweep.amplitude)
        .collect();
    // Every loop here has an integrator, so it settles on its input.
    let step_figures = step_figures(&step, 1.0, sweep.dt_s);
    LoopMeasurement {
        name,
        unit,
        amplitude: sweep.amplitude,
        margins: margins(&open),
        bandwidth_hz: bandwidth_hz(&closed),
        closed,
        open,
        step,
        step_figures,
        dt_s: sweep.dt_s,
    }
}

/// Rate amplitude [rad/s] that takes a quarter of the torque at all frequencies.
fn rate_amplitude(axis: &AxisParams) -> f64 {
    let gain_per_s = 2.0 * axis.damping * TAU * axis.bandwidth_hz;
    0.25 * axis.torque_limit_nm / axis.inertia_kg_m2 / gain_per_s
}

/// Steady rate [rad/s] under a sweep of the gimbal: the sine leaves at least half of it, and it is far
/// above the rate at which friction changes.
fn steady_rate(axis: &AxisParams) -> f64 {
    let enough = 0.05; // [rad/s]
    (2.0 * rate_amplitude(axis)).max(enough)
}

/// An axis at a place where it can turn at the steady rate for a while.
fn start(plant: &MountPlant) -> GimbalState {
    let low = |axis: &AxisParams| {
        axis.travel_rad
            .map_or(0.0, |[low, high]| low + 0.2 * (high - low))
    };
    GimbalState::at_rest(DVec2::new(
        low(&plant.gimbal.azimuth),
        low(&plant.gimbal.elevation),
    ))
}

impl MountPlant {
    /// The gyros on the rotors without their noise: loops are measured with their bandwidth and delay.
    fn gyros(&self) -> Gyro<2> {
        Gyro::new(self.gyro.quiet(), Stream::new(0, 0, "axis gyros"))
    }
}

/// Rate loop of an axis closed: rate command → measured rate, both beyond the steady rate [rad/s].
fn rate_loop(plant: &MountPlant, axis: MountAxis) -> impl FnMut(f64) -> f64 + use<> {
    let MountPlant { gimbal, dt_s, .. } = *plant;
    let (mut state, steady) = (start(plant), steady_rate(axis.of(&gimbal)));
    let mut gyros = plant.gyros();
    move |u| {
        let rate_radps = (axis.unit() * (steady + u)).to_array();
        gimbal::step(
            &mut state,
            &gimbal,
            &GimbalCommand { rate_radps },
            [0.0; 2],
            dt_s,
        );
        state.read_gyros(&mut gyros, dt_s);
        state.gyro_rates_radps().dot(axis.unit()) - steady
    }
}

/// Whether the rate loop comes to rest after a step: sweeps of one that does not would measure its own swing.
fn rate_loop_settles(plant: &MountPlant, axis: MountAxis) -> bool {
    let amplitude = rate_amplitude(axis.of(&plant.gimbal));
    let mut run = rate_loop(plant, axis);
    // A second is many times what a loop of some hertz needs; of its end, a quarter counts.
    let ticks = (1.0 / plant.dt_s) as usize;
    let rates = (0..ticks).map(|_| run(amplitude) / amplitude);
    rates
        .skip(3 * ticks / 4)
        .all(|rate| (rate - 1.0).abs() < 0.1)
}

/// Position loop of an axis closed by a gain [1/s]: angle command → measured angle [rad], both beyond the
/// steady turn, which is fed forward.
fn position_loop(
    plant: &MountPlant,
    axis: MountAxis,
    gain_per_s: f64,
) -> impl FnMut(f64) -> f64 + use<> {
    let MountPlant { gimbal, dt_s, .. } = *plant;
    let (mut state, steady) = (start(plant), steady_rate(axis.of(&gimbal)));
    let origin = state.encoder_az_el_rad();
    let (mut turned, mut y, mut gyros) = (0.0, 0.0, plant.gyros());
    move |u| {
        let rate_radps = (axis.unit() * (steady + gain_per_s * (u - y))).to_array();
        gimbal::step(
            &mut state,
            &gimbal,
            &GimbalCommand { rate_radps },
            [0.0; 2],
            dt_s,
        );
        state.read_gyros(&mut gyros, dt_s);
        turned += steady * dt_s;
        y = axis.of(&gimbal).error_rad(
            state.encoder_az_el_rad().dot(axis.unit()),
            origin.dot(axis.unit()) + turned,
        );
        y
    }
}

/// Whole pointing loop: the target's line of sight → the boresight's, both along one axis [rad]. A camera
/// sees the target's true error frame by frame; detections come late, go through the filter to the
/// law, and the law moves gimbal and mirror. The base stands still.
fn pointing_loop(
    plant: &MountPlant,
    axis: MountAxis,
    camera: CameraTiming,
    filter: LosFilterParams,
    law: Box<dyn PointingLaw>,
) -> impl FnMut(f64) -> f64 + use<> {
    let MountPlant {
        gimbal,
        mirror,
        dt_s,
        ..
    } = *plant;
    let mut gyros = plant.gyros();
    // Level, where azimuth and cross-elevation are one.
    let origin = DVec2::ZERO;
    let mut state = GimbalState::at_rest(origin);
    let mut hand_over = HandOver::new(mirror.stroke_rad, dt_s);
    // Parameters were checked when the law was made.
    let mut mirror = Mirror::new(&mirror, dt_s).ok();
    let mut law = law;
    let mut track: Option<LosFilter> = None;
    let mut frames: VecDeque<(u64, DVec2)> = VecDeque::new();
    let mut tick = 0_u64;
    move |u| {
        let t_s = tick as f64 * dt_s;
        if tick.is_multiple_of(camera.period_ticks) {
            // The measured error is added to the pointing as measured: that gives the target's
            // direction, but for the encoder's step.
            let slip = state.encoder_az_el_rad() - state.az_el_rad();
            frames.push_back((tick, origin + axis.unit() * u + slip));
        }
        while let Some((exposed, los)) =
            frames.pop_front_if(|frame| frame.0 + camera.latency_ticks <= tick)
        {
            let exposed_s = exposed as f64 * dt_s;
            match &mut track {
                Some(track) => {
                    track.update(los, camera.sigma_rad, exposed_s);
                }
                None => track = LosFilter::start(filter, los, camera.sigma_rad, exposed_s).ok(),
            }
        }
        if let (Some(track), Some(mirror)) = (&track, &mut mirror) {
            let output = law.command(
                &mut hand_over,
                &gimbal,
                &PointingInput::sensed(track.predicted(t_s + law.lead_s()), &state, mirror),
            );
            gimbal::step(&mut state, &gimbal, &output.gimbal, [0.0; 2], dt_s);
            state.read_gyros(&mut gyros, dt_s);
            mirror.step(output.mirror_rad);
        }
        tick += 1;
        let deflection = mirror.map_or(DVec2::ZERO, |mirror| mirror.deflection_rad());
        (state.az_el_rad() + deflection - origin).dot(axis.unit())
    }
}

/// The paper's coarse loop (eq. 9): the target's line of sight → the boresight's, both along one
/// axis [rad]. Each frame's delayed error turns the gimbal by the law's increment.
fn paper_loop(
    plant: &MountPlant,
    axis: MountAxis,
    camera: CameraTiming,
    law: PaperLaw,
) -> impl FnMut(f64) -> f64 + use<> {
    let MountPlant { gimbal, dt_s, .. } = *plant;
    let mut state = GimbalState::at_rest(DVec2::ZERO);
    let (mut pid, mut command) = (PaperPid::default(), GimbalCommand::default());
    let mut gyros = plant.gyros();
    let mut frames: VecDeque<(u64, DVec2)> = VecDeque::new();
    let frame_s = camera.period_ticks as f64 * dt_s;
    let mut tick = 0_u64;
    move |u| {
        if tick.is_multiple_of(camera.period_ticks) {
            let error = axis.unit() * u - state.az_el_rad();
            // The image's down is the axis's −y.
            frames.push_back((tick, DVec2::new(error.x, -error.y)));
        }
        while let Some((_, error)) =
            frames.pop_front_if(|frame| frame.0 + camera.latency_ticks <= tick)
        {
            let increment = pid.step(&law, error, frame_s);
            let rates = coarse_axis_rates(state.encoder_az_el_rad(), increment, 1.0 / frame_s);
            command.rate_radps = rates.to_array();
        }
        gimbal::step(&mut state, &gimbal, &command, [0.0; 2], dt_s);
        state.read_gyros(&mut gyros, dt_s);
        tick += 1;
        state.az_el_rad().dot(axis.unit())
    }
}

/// Measures the paper's coarse loop.
pub fn measure_paper_loop(
    plant: &MountPlant,
    axis: MountAxis,
    camera: CameraTiming,
    law: PaperLaw,
) -> LoopMeasurement {
    let sweep = Sweep {
        dt_s: plant.dt_s,
        // Its rates are then clear of friction's Stribeck range.
        amplitude: 0.02, // [rad]
        settle_s: 15.0,  // [s]
        measure_s: 10.0, // [s]
    };
    let frequencies = log_spaced(0.02, 5.0, 30);
    measure(
        "pointing, paper (eq. 9)".into(),
        "rad",
        &sweep,
        &frequencies,
        12.0,
        || paper_loop(plant, axis, camera, law),
    )
}

/// Measures the rate loop of an axis.
pub fn measure_rate_loop(plant: &MountPlant, axis: MountAxis) -> LoopMeasurement {
    let sweep = Sweep {
        dt_s: plant.dt_s,
        amplitude: rate_amplitude(axis.of(&plant.gimbal)),
        settle_s: 1.0,  // [s]
        measure_s: 2.0, // [s]
    };
    let frequencies = log_spaced(0.5, 0.45 / plant.dt_s, 100);
    measure(
        "gimbal rate".into(),
        "rad/s",
        &sweep,
        &frequencies,
        0.4,
        || rate_loop(plant, axis),
    )
}

/// Measures the position loop of an axis under a gain [1/s].
pub fn measure_position_loop(
    plant: &MountPlant,
    axis: MountAxis,
    gain_per_s: f64,
) -> LoopMeasurement {
    let sweep = Sweep {
        dt_s: plant.dt_s,
        // What moves the rate command by the rate loop's amplitude.
        amplitude: rate_amplitude(axis.of(&plant.gimbal)) / gain_per_s,
        settle_s: 1.5,  // [s]
        measure_s: 2.0, // [s]
    };
    let frequencies = log_spaced(0.5, 0.2 / plant.dt_s, 80);
    measure(
        "gimbal position".into(),
        "rad",
        &sweep,
        &frequencies,
        1.0,
        || position_loop(plant, axis, gain_per_s),
    )
}

/// Measures the mirror's own loop.
pub fn measure_mirror(plant: &MountPlant) -> Result<LoopMeasurement, TuningError> {
    let sweep = Sweep {
        dt_s: plant.dt_s,
        amplitude: 0.02 * plant.mirror.stroke_rad,
        settle_s: 0.2,  // [s]
        measure_s: 0.2, // [s]
    };
    let mirror = Mirror::new(&plant.mirror, plant.dt_s)?;
    let frequencies = log_spaced(5.0, 0.48 / plant.dt_s, 80);
    Ok(measure(
        "mirror".into(),
        "rad",
        &sweep,
        &frequencies,
        0.02,
        || {
            let mut mirror = mirror;
            move |u| mirror.step(DVec2::new(u, 0.0)).x
        },
    ))
}

/// Measures the whole pointing loop under a law of a name.
pub fn measure_pointing_loop(
    plant: &MountPlant,
    axis: MountAxis,
    camera: CameraTiming,
    filter: LosFilterParams,
    (name, law): (&str, &dyn PointingLaw),
) -> Result<LoopMeasurement, TuningError> {
    filter.validate()?;
    Mirror::new(&plant.mirror, plant.dt_s)?;
    let sweep = Sweep {
        dt_s: plant.dt_s,
        // So small that the filter stays in its calm mode: it answers a larger sine by changing
        // modes, which no frequency response describes.
        amplitude: 0.1 * camera.sigma_rad,
        settle_s: 4.0,  // [s]
        measure_s: 4.0, // [s]
    };
    let frame_hz = 1.0 / (camera.period_ticks as f64 * plant.dt_s);
    let frequencies = log_spaced(0.1, 0.45 * frame_hz, 60);
    Ok(measure(
        format!("pointing, {name}"),
        "rad",
        &sweep,
        &frequencies,
        5.0,
        || pointing_loop(plant, axis, camera, filter, law.boxed()),
    ))
}

/// Gains that sweeps ask for, and what limits the gimbal's.
#[derive(Clone, Debug, PartialEq)]
pub struct Derived {
    /// Gains of the tuned law.
    pub law: TunedPointing,
    /// What keeps the gimbal's gain from being higher.
    pub limit: &'static str,
}

/// Highest gain [1/s] of an axis's position loop that keeps both margins and the cascade's
/// distance, and what limits it.
fn highest_gain(plant: &MountPlant, axis: MountAxis) -> Result<(f64, &'static str), TuningError> {
    let params = axis.of(&plant.gimbal);
    let reference_per_s = 0.2 * TAU * params.bandwidth_hz;
    let mut sweep = Sweep {
        dt_s: plant.dt_s,
        amplitude: rate_amplitude(params),
        settle_s: 0.8,  // [s]
        measure_s: 0.5, // [s]
    };
    let around =
        |low: f64, high: f64| log_spaced(low * params.bandwidth_hz, high * params.bandwidth_hz, 24);
    let rate = sweep.run(&around(0.3, 6.0), || rate_loop(plant, axis));
    sweep.amplitude /= reference_per_s;
    let open = open_loop(&sweep.run(&around(0.05, 12.0), || {
        position_loop(plant, axis, reference_per_s)
    }));
    let finite = |r: &Response| r.value.re.is_finite() && r.value.im.is_finite();
    let most_hz = match bandwidth_hz(&rate) {
        Some(hz) if open.iter().all(finite) => CASCADE_SHARE * hz,
        _ => return Err(TuningError::NoGain),
    };
    let limit = |factor: f64| {
        // The loop is proportional to the gain.
        let scaled: Vec<Response> = open
            .iter()
            .map(|r| Response {
                value: r.value * factor,
                ..*r
            })
            .collect();
        let loop_ = margins(&scaled);
        let below = |margin: Option<Margin>, least: f64| margin.is_some_and(|m| m.value < least);
        if below(loop_.gain_db, GAIN_MARGIN_DB) {
            Some("gain margin")
        } else if below(loop_.phase_deg, PHASE_MARGIN_DEG) {
            Some("phase margin")
        } else if loop_.phase_deg.is_some_and(|m| m.frequency_hz > most_hz) {
            Some("distance from the rate loop")
        } else {
            None
        }
    };
    // Upward in steps of a tenth until something binds, then bisection.
    let (mut low, mut high) = (0.0, 0.2);
    let mut reason = loop {
        match limit(high) {
            Some(reason) => break reason,
            None if high > 20.0 => return Err(TuningError::NoGain),
            None => (low, high) = (high, 1.1 * high),
        }
    };
    if low == 0.0 {
        return Err(TuningError::NoGain);
    }
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        match limit(middle) {
            Some(why) => (high, reason) = (middle, why),
            None => low = middle,
        }
    }
    Ok((reference_per_s * low, reason))
}

/// Longest lead [ticks]; a mirror that needs more is no fast steering mirror.
const MAX_LEAD_TICKS: usize = 32;

/// Ticks after which a mirror has done half of a step, and what then remains of its motion, found by
/// deflecting it.
fn mirror_lead(plant: &MountPlant) -> Result<(usize, MirrorRemainder), TuningError> {
    // How it moves has nothing to do with how far it may.
    let params = MirrorParams {
        stroke_rad: 1.0, // [rad]
        ..plant.mirror
    };
    let unit = 0.1 * params.stroke_rad;
    let mut mirror = Mirror::new(&params, plant.dt_s)?;
    // From rest: the share of the offset that remains.
    let mut left = Vec::new();
    while left.last().is_none_or(|left| *left > 0.5) && left.len() < MAX_LEAD_TICKS {
        left.push(1.0 - mirror.step(DVec2::new(unit, 0.0)).x / unit);
    }
    let (ticks, offset) = (left.len(), left.last().copied().unwrap_or(0.0));
    // From a flying start after one tick: what the rate adds.
    let mut mirror = Mirror::new(&params, plant.dt_s)?;
    mirror.step(DVec2::new(unit, 0.0));
    let (at, rate) = (mirror.deflection_rad().x, mirror.rate_radps().x);
    for _ in 0..ticks {
        mirror.step(DVec2::ZERO);
    }
    Ok((
        ticks,
        MirrorRemainder {
            offset,
            rate_s: (mirror.deflection_rad().x - offset * at) / rate,
        },
    ))
}

/// The tuned law's gains from sweeps of the simulated mount.
pub fn derive(plant: &MountPlant) -> Result<Derived, TuningError> {
    if ![MountAxis::Azimuth, MountAxis::Elevation]
        .iter()
        .all(|axis| rate_loop_settles(plant, *axis))
    {
        return Err(TuningError::NoGain);
    }
    let azimuth = highest_gain(plant, MountAxis::Azimuth)?;
    let elevation = highest_gain(plant, MountAxis::Elevation)?;
    let (gimbal_gain_per_s, limit) = if azimuth.0 < elevation.0 {
        azimuth
    } else {
        elevation
    };
    let (ticks, mirror_left) = mirror_lead(plant)?;
    Ok(Derived {
        law: TunedPointing {
            gimbal_gain_per_s,
            lead_s: ticks as f64 * plant.dt_s,
            mirror_left,
        },
        limit,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::second_order::second_order_transition;
    use nalgebra::Complex;

    const DT: f64 = 1.0 / 960.0;

    fn plant() -> MountPlant {
        MountPlant {
            gimbal: GimbalParams::default(),
            mirror: MirrorParams::default(),
            gyro: GyroParams::FIBRE,
            dt_s: DT,
        }
    }

    fn rigid() -> MountPlant {
        let mut plant = plant();
        plant.gyro = GyroParams::default();
        for axis in [&mut plant.gimbal.azimuth, &mut plant.gimbal.elevation] {
            *axis = axis.ideal();
            axis.structure = None;
            axis.viscous_nms = 0.0;
        }
        plant
    }

    #[test]
    fn rigid_rate_loop_is_the_closed_form() {
        // L = (2ζωs + ω²)/s², sampled with the torque held: 2ζω dt/(z − 1) + ω² dt²/(z − 1)².
        let axis = plant().gimbal.azimuth;
        let (w, z) = (TAU * axis.bandwidth_hz, axis.damping);
        let measured = measure_rate_loop(&rigid(), MountAxis::Azimuth);
        for r in &measured.open {
            let back = Complex::from_polar(1.0, TAU * r.frequency_hz * DT) - 1.0;
            let expected = 2.0 * z * w * DT / back + (w * DT).powi(2) / (back * back);
            assert!((r.value / expected - 1.0).norm() < 1e-3, "{r:?} {expected}");
        }
        // |L| = 1 at ω √(2ζ² + √(4ζ⁴ + 1)), but for the sampling.
        let crossover = w * (2.0 * z * z + (4.0 * z.powi(4) + 1.0).sqrt()).sqrt();
        let phase = measured.margins.phase_deg.unwrap();
        assert!(
            (TAU * phase.frequency_hz / crossover - 1.0).abs() < 0.03,
            "{phase:?}"
        );
    }

    #[test]
    fn rigid_position_loop_is_the_closed_form() {
        // L = K T/s with the rate loop's T: at low gain the crossover is K and the margin 90° less
        // T's lag, which vanishes to second order.
        let measured = measure_position_loop(&rigid(), MountAxis::Elevation, 15.0);
        let phase = measured.margins.phase_deg.unwrap();
        assert!(
            (TAU * phase.frequency_hz / 15.0 - 1.0).abs() < 0.03,
            "{phase:?}"
        );
        assert!((phase.value - 90.0).abs() < 2.0, "{phase:?}");
        // Rise time ln 9/K of a first-order loop.
        let step = measured.step_figures.unwrap();
        assert!(
            (step.rise_s / (9f64.ln() / 15.0) - 1.0).abs() < 0.1,
            "{step:?}"
        );
        assert!(step.overshoot < 0.01);
    }

    #[test]
    fn friction_does_not_enter_a_sweep_that_keeps_turning() {
        let with = measure_position_loop(&plant(), MountAxis::Azimuth, 15.0);
        let mut ideal = plant();
        ideal.gimbal.azimuth = ideal.gimbal.azimuth.ideal();
        let without = measure_position_loop(&ideal, MountAxis::Azimuth, 15.0);
        let [a, b] = [&with, &without].map(|m| m.margins.phase_deg.unwrap());
        assert!((a.value - b.value).abs() < 0.5, "{a:?} {b:?}");
        let [a, b] = [&with, &without].map(|m| m.margins.gain_db.unwrap());
        assert!((a.value - b.value).abs() < 0.2, "{a:?} {b:?}");
    }

    #[test]
    fn derived_gains_are_what_the_sweeps_ask_for() {
        let plant = plant();
        let law = derive(&plant).unwrap().law;
        // The mirror's coefficients are those of its transition matrix.
        let MirrorParams {
            natural_frequency_hz,
            damping,
            ..
        } = plant.mirror;
        let [left, _] = second_order_transition(natural_frequency_hz, damping, law.lead_s).unwrap();
        assert!((law.mirror_left.offset - left[0]).abs() < 1e-12);
        assert!((law.mirror_left.rate_s - left[1]).abs() < 1e-15);
        // The finer sweeps that are shown put the same bounds on the gain.
        for axis in [MountAxis::Azimuth, MountAxis::Elevation] {
            let rate = measure_rate_loop(&plant, axis).bandwidth_hz.unwrap();
            let loop_ = measure_position_loop(&plant, axis, law.gimbal_gain_per_s);
            assert!(
                loop_
                    .margins
                    .gain_db
                    .is_none_or(|m| m.value > GAIN_MARGIN_DB)
            );
            let phase = loop_.margins.phase_deg.unwrap();
            assert!(phase.value > PHASE_MARGIN_DEG);
            let share = phase.frequency_hz / rate;
            assert!((share / CASCADE_SHARE - 1.0).abs() < 0.05, "{share}");
        }
        // A weak structure lowers the gain.
        let mut weak = plant;
        for axis in [&mut weak.gimbal.azimuth, &mut weak.gimbal.elevation] {
            if let Some(structure) = &mut axis.structure {
                structure.locked_rotor_hz = 12.0; // [Hz]
            }
        }
        let softer = derive(&weak).unwrap().law.gimbal_gain_per_s;
        assert!(softer < 0.8 * law.gimbal_gain_per_s, "{softer}");
    }

    #[test]
    fn pointing_loop_settles_and_its_margins_follow_the_latency() {
        let mut plant = plant();
        // Its sine is a few steps of the encoder.
        plant.gimbal.azimuth.encoder_bits = None;
        let law = derive(&plant).unwrap().law;
        let measured = |latency_ticks| {
            let camera = CameraTiming {
                period_ticks: 8,
                latency_ticks,
                sigma_rad: 14e-6, // [rad]
            };
            let filter = LosFilterParams::default();
            let law = ("tuned", &law as &dyn PointingLaw);
            measure_pointing_loop(&plant, MountAxis::Azimuth, camera, filter, law).unwrap()
        };
        let (late, early) = (measured(29), measured(8));
        let last = late.step.last().unwrap();
        assert!((last - 1.0).abs() < 0.02, "{last}");
        assert!((late.closed[0].value - 1.0).norm() < 0.02);
        assert!(late.margins.peak_sensitivity > early.margins.peak_sensitivity);
    }

    #[test]
    fn a_mount_without_a_stable_gain_is_refused() {
        let mut wild = plant();
        for axis in [&mut wild.gimbal.azimuth, &mut wild.gimbal.elevation] {
            axis.bandwidth_hz = 150.0; // [Hz], far above what the tick can carry
        }
        assert_eq!(derive(&wild), Err(TuningError::NoGain));
    }
}
