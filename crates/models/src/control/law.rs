//! What all pointing laws share: what they read, what they command, the line of sight as the gimbal
//! sees it, and starting and stopping without a jump.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::maths::kinematics::{exp_so3, los_to_az_el};
use crate::mount::gimbal::{GimbalCommand, GimbalParams, GimbalState};
use crate::mount::mirror::Mirror;
use crate::tracking::estimation::LosState;
use crate::tracking::search::Gaze;

/// What a pointing law reads at the start of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointingInput {
    /// Line of sight predicted for the tick's start plus the law's lead.
    pub los: LosState,
    /// Azimuth (x) and elevation (y) from the encoders [rad].
    pub gimbal_az_el_rad: DVec2,
    /// Rates of azimuth (x) and elevation (y) relative to the base [rad/s].
    pub gimbal_rates_radps: DVec2,
    /// Deflection of the mirror by its sensor, right (x) and up (y) [rad].
    pub mirror_rad: DVec2,
    /// Rate of that deflection [rad/s].
    pub mirror_rates_radps: DVec2,
    /// Tilt of the base from the integrated gyro, the same that the measurements were turned with:
    /// a rotation vector about `enu` [rad]; zero without a gyro.
    pub base_tilt_rad: DVec3,
    /// Angular velocity of the base from the gyro, in `enu` [rad/s]; zero without a gyro.
    pub base_rate_radps: DVec3,
}

impl PointingInput {
    /// What the sensors of gimbal and mirror say, on a base at rest.
    pub fn sensed(los: LosState, gimbal: &GimbalState, mirror: &Mirror) -> Self {
        Self {
            los,
            gimbal_az_el_rad: gimbal.encoder_az_el_rad(),
            gimbal_rates_radps: gimbal.gyro_rates_radps(),
            mirror_rad: mirror.measured_rad(),
            mirror_rates_radps: mirror.rate_radps(),
            base_tilt_rad: DVec3::ZERO,
            base_rate_radps: DVec3::ZERO,
        }
    }
}

/// Commands for one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointingOutput {
    /// For [`crate::mount::gimbal::step`].
    pub gimbal: GimbalCommand,
    /// For [`crate::mount::mirror::Mirror::step`]: deflection right (x) and up (y) [rad].
    pub mirror_rad: DVec2,
}

/// The line of sight as the gimbal sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Rates of the line of sight relative to the moving base, azimuth and elevation [rad/s].
    pub rates_radps: DVec2,
    /// Axis angles still to turn [rad].
    pub error_rad: DVec2,
    /// Mirror deflection that would put the boresight on it, right and up [rad].
    pub deflection_rad: DVec2,
    /// Cosine of the gimbal's elevation, not below 0.05: sky angle per azimuth angle.
    pub cos_el: f64,
}

impl Aim {
    /// The aim when base and gimbal have moved on by `ahead_s` at their present rates.
    ///
    /// A load that is balanced and free of friction stands still in space while the base shakes:
    /// gimbal rate and base rate are then opposite and cancel here. Predicting the base alone with
    /// its acceleration (as from a model of its spectrum) breaks that, and makes the error worse.
    pub fn new(gimbal: &GimbalParams, input: &PointingInput, ahead_s: f64) -> Self {
        let tilt = input.base_tilt_rad + ahead_s * input.base_rate_radps;
        let at = input.gimbal_az_el_rad + ahead_s * input.gimbal_rates_radps;

        let (d_enu, d_dot_enu) = input.los.direction_enu();
        let q_base_enu = exp_so3(-tilt);
        let d = q_base_enu * d_enu;
        let d_dot = q_base_enu * (d_dot_enu - input.base_rate_radps.cross(d_enu));

        // Line of sight in the base's azimuth and elevation, and its rates.
        let horizontal2 = (d.x * d.x + d.y * d.y).max(1e-6);
        let rates_radps = DVec2::new(
            (d.y * d_dot.x - d.x * d_dot.y) / horizontal2,
            d_dot.z / horizontal2.sqrt(),
        );
        let mut az_el = los_to_az_el(d);
        let mut rates_radps = rates_radps;
        // At the zenith the azimuth cannot follow: it turns steadily through, and meets the target
        // on the other side.
        if let Some([az, rate]) = gimbal.keyhole_azimuth(az_el, rates_radps) {
            (az_el.x, rates_radps.x) = (az, rate);
        }
        Self {
            rates_radps,
            error_rad: gimbal.error_rad(az_el, at),
            deflection_rad: deflection_to(d, at),
            cos_el: at.y.cos().max(0.05),
        }
    }
}

/// Mirror deflection [rad], right (x) and up (y), that turns the boresight of a gimbal at `az_el_rad`
/// to the direction `d_base` in the base's frame.
pub fn deflection_to(d_base: DVec3, az_el_rad: DVec2) -> DVec2 {
    // The direction in the gimbal: right, forward, up.
    let in_gimbal = exp_so3(DVec3::new(-az_el_rad.y, 0.0, 0.0))
        * (exp_so3(DVec3::new(0.0, 0.0, az_el_rad.x)) * d_base);
    let across = DVec2::new(in_gimbal.x, in_gimbal.z);
    let sine = across.length();
    // Great-circle angle along `across`; angle/sine → 1 at the centre.
    let angle = sine.atan2(in_gimbal.y);
    if sine > 1e-9 {
        across * (angle / sine)
    } else {
        across
    }
}

/// Share of the torque limit that turning to a target may use; the rest is for disturbances.
pub(super) const TORQUE_SHARE: f64 = 0.7;
/// Fastest change of a rate command, in shares of that torque's acceleration: braking along the
/// parabola takes one, and must not be held up.
pub(super) const EASE: f64 = 1.2;
/// Fastest change of the mirror's set deflection [rad/s]: it crosses its stroke in 25 ms, twenty times
/// faster than it moves while it tracks.
pub(super) const MIRROR_SLEW_RADPS: f64 = 0.2;
/// The mirror waits at its centre while the target is this many strokes away.
const ENGAGE_STROKES: f64 = 2.0;

/// Rate [rad/s] at which to turn through `error_rad`: proportional near the target, on the braking
/// parabola of the deceleration `accel_radps2` far from it, with no corner between.
pub fn turn_rate(gain_per_s: f64, accel_radps2: f64, error_rad: f64) -> f64 {
    // The straight line ends where following it takes just that deceleration.
    let corner = accel_radps2 / (gain_per_s * gain_per_s);
    let error = error_rad.abs();
    let rate = if error > corner {
        (2.0 * accel_radps2 * (error - 0.5 * corner)).sqrt()
    } else {
        gain_per_s * error
    };
    rate.copysign(error_rad)
}

/// Memory that keeps commands from jumping when loops are handed over.
///
/// The part of the gimbal's command that turns to the target moves no faster than the motor can
/// follow, starting from the rate in force when the law takes over; the mirror's set deflection moves
/// at a bounded rate from where it is, to its new course or back to its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandOver {
    pub(super) stroke_rad: f64,
    pub(super) dt_s: f64,
    /// Rate of turning to the target commanded last [rad/s].
    pub(super) turn_radps: Option<DVec2>,
    pub(super) set_rad: DVec2,
}

impl HandOver {
    /// For a centred mirror of `stroke_rad` to each side, and commands every `dt_s`.
    pub fn new(stroke_rad: f64, dt_s: f64) -> Self {
        Self {
            stroke_rad,
            dt_s,
            turn_radps: None,
            set_rad: DVec2::ZERO,
        }
    }

    /// Gimbal rates [rad/s] for an aim, by the gain of each axis [1/s].
    pub fn gimbal_rates(
        &mut self,
        gimbal: &GimbalParams,
        gains_per_s: [f64; 2],
        aim: &Aim,
        present_radps: DVec2,
    ) -> DVec2 {
        let accel = DVec2::from_array(
            [&gimbal.azimuth, &gimbal.elevation]
                .map(|axis| TORQUE_SHARE * axis.torque_limit_nm / axis.inertia_kg_m2),
        );
        let wanted = DVec2::from_array(
            [0, 1].map(|i| turn_rate(gains_per_s[i], accel[i], aim.error_rad[i])),
        );
        let before = self.turn_radps.unwrap_or(present_radps - aim.rates_radps);
        let step = EASE * self.dt_s * accel;
        let turn = wanted.min(before + step).max(before - step);
        self.turn_radps = Some(turn);
        aim.rates_radps + turn
    }

    /// The mirror's set deflection [rad] on its way to `wanted_rad`.
    pub fn mirror(&mut self, wanted_rad: DVec2) -> DVec2 {
        let stroke = DVec2::splat(self.stroke_rad);
        let wanted = if wanted_rad.abs().max_element() > ENGAGE_STROKES * self.stroke_rad {
            DVec2::ZERO
        } else {
            wanted_rad.clamp(-stroke, stroke)
        };
        let step = DVec2::splat(MIRROR_SLEW_RADPS * self.dt_s);
        self.set_rad = wanted.clamp(self.set_rad - step, self.set_rad + step);
        self.set_rad
    }

    /// Lets go of the target and slews to a gaze and along with it, or stops without one: from the rates
    /// commanded before, and the mirror on its way home.
    pub fn slew(
        &mut self,
        gimbal: &GimbalParams,
        commanded: &GimbalCommand,
        az_el_rad: DVec2,
        gaze: Option<Gaze>,
    ) -> PointingOutput {
        self.turn_radps = None;
        let gaze = gaze.unwrap_or(Gaze::still(az_el_rad));
        let error = gimbal.error_rad(gaze.az_el_rad, az_el_rad);
        let rate_radps = [0, 1].map(|i| {
            let axis = [&gimbal.azimuth, &gimbal.elevation][i];
            let accel = TORQUE_SHARE * axis.torque_limit_nm / axis.inertia_kg_m2;
            // A quarter of the rate loop's bandwidth keeps the cascade well damped.
            let wanted =
                turn_rate(0.25 * TAU * axis.bandwidth_hz, accel, error[i]) + gaze.rates_radps[i];
            let (before, step) = (commanded.rate_radps[i], EASE * accel * self.dt_s);
            wanted.min(before + step).max(before - step)
        });
        PointingOutput {
            gimbal: GimbalCommand { rate_radps },
            mirror_rad: self.mirror(DVec2::ZERO),
        }
    }
}
