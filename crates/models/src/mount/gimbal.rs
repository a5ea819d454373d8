//! Two-axis direct-drive gimbal: each axis a rotor and a load on a spring, with limited torque, dry
//! and viscous friction, backlash, a speed limit and travel stops, under an inner PI rate loop that
//! sees an encoder and a rate gyro.
//!
//! Angles are relative to the base: azimuth clockwise from the base's north, elevation up. The two
//! axes are dynamically independent (balanced load, no gyroscopic coupling). The encoder sits on
//! the load, the gyro on the rotor's hub: closed on the rotor's side, the rate loop damps the
//! spring's mode whatever its frequency. The gyro's reading is taken relative to the base.
//!
//! In the coordinates centre of inertia and twist, the mechanics are stepped exactly for a torque
//! held over a substep; dry friction is the torque that the end of the substep demands (implicit,
//! with a true state of rest), viscous friction its mean over the substep, cogging that of its start. The rate loop is of type
//! 2, so a steady acceleration leaves no rate error and needs no feed-forward (measured: none
//! helps). The sampled loop is stable while 2 · damping · bandwidth · 2π · dt / rotor's share of the
//! inertia stays below 1 (15 Hz at 960 Hz gives 0.7).

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use thiserror::Error;

use crate::maths::kinematics::{az_el_to_los, base_rate_on_axes, wrap_pi};
use crate::maths::second_order::second_order_transition;
use crate::mount::drive::{Cogging, Friction};
use crate::mount::gyro::Gyro;

/// A gimbal parameter out of its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("gimbal parameter {name} = {value} is out of range; give a plain value above 0")]
pub struct GimbalError {
    /// Field name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

/// First structural mode of an axis: rotor and load on a torsional spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Structure {
    /// Frequency of the load on the locked rotor [Hz].
    pub locked_rotor_hz: f64,
    /// Damping ratio of the load on the locked rotor.
    pub damping: f64,
    /// Share of the axis's inertia that sits on the rotor's side, in (0, 1).
    pub rotor_share: f64,
    /// Free twist between the two ends of the spring [rad].
    pub backlash_rad: f64,
}

/// One gimbal axis and its rate servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisParams {
    /// Moment of inertia about the axis [kg m²].
    pub inertia_kg_m2: f64,
    /// Largest motor torque [N m].
    pub torque_limit_nm: f64,
    /// Viscous friction at the rotor [N m s/rad].
    pub viscous_nms: f64,
    /// Dry friction; `None` has none.
    pub friction: Option<Friction>,
    /// Cogging of the motor; `None` has none.
    pub cogging: Option<Cogging>,
    /// Structural mode; `None` is a rigid axis.
    pub structure: Option<Structure>,
    /// Bits of the encoder per turn; `None` reads the angle itself.
    pub encoder_bits: Option<u32>,
    /// Largest rate [rad/s]: the command is limited to it and the motor gives no torque beyond it.
    pub rate_limit_radps: f64,
    /// Natural frequency of the closed rate loop [Hz].
    pub bandwidth_hz: f64,
    /// Damping ratio of the closed rate loop.
    pub damping: f64,
    /// Travel stops [rad], lower then upper; `None` turns without end (slip ring).
    pub travel_rad: Option<[f64; 2]>,
}

/// A two-axis gimbal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GimbalParams {
    /// Outer axis.
    pub azimuth: AxisParams,
    /// Inner axis.
    pub elevation: AxisParams,
}

impl Default for GimbalParams {
    /// A small beam director (assumed, no particular product): some 40 kg of optics and yoke within
    /// 0.4 m, so 8 and 5 kg m²; direct-drive torque motors of 60 and 40 N m give 7.5 and
    /// 8 rad/s², three times what a 20 m/s target passing at 50 m asks in rate change; 60°/s covers
    /// that target (0.4 rad/s) and slews across the sector in 3 s. Preloaded bearings and lip seals
    /// break away at 1 % of the torque limit, after 0.2 mrad, and run at two thirds of that (their bristles'
    /// damping is half of the critical one of the axis upon them); the
    /// motors cog by 0.12 and 0.08 N m; no gears, so no backlash. The optics swing at 40 Hz on the locked rotor (80 Hz with the rotor free), with
    /// the 2 % damping of bolted metal. The encoder has 24 bits (0.37 µrad).
    fn default() -> Self {
        let degree = PI / 180.0;
        let azimuth = AxisParams {
            inertia_kg_m2: 8.0,    // [kg m²]
            torque_limit_nm: 60.0, // [N m]
            viscous_nms: 2.0,      // [N m s/rad]
            friction: Some(Friction {
                coulomb_nm: 0.4,      // [N m]
                breakaway_nm: 0.6,    // [N m]
                stribeck_radps: 2e-3, // [rad/s]
                presliding_rad: 2e-4, // [rad]
                bristle_nms: 150.0,   // [N m s/rad]
            }),
            cogging: Some(Cogging {
                torque_nm: 0.12, // [N m]
                per_turn: 180.0,
            }),
            structure: Some(Structure {
                locked_rotor_hz: 40.0, // [Hz]
                damping: 0.02,
                rotor_share: 0.25,
                backlash_rad: 0.0, // [rad]
            }),
            encoder_bits: Some(24),
            rate_limit_radps: 60.0 * degree,
            bandwidth_hz: 15.0, // [Hz]
            damping: 0.9,
            travel_rad: None,
        };
        Self {
            azimuth,
            elevation: AxisParams {
                inertia_kg_m2: 5.0,    // [kg m²]
                torque_limit_nm: 40.0, // [N m]
                viscous_nms: 1.5,      // [N m s/rad]
                friction: Some(Friction {
                    coulomb_nm: 0.27,     // [N m]
                    breakaway_nm: 0.4,    // [N m]
                    stribeck_radps: 2e-3, // [rad/s]
                    presliding_rad: 2e-4, // [rad]
                    bristle_nms: 100.0,   // [N m s/rad]
                }),
                cogging: Some(Cogging {
                    torque_nm: 0.08, // [N m]
                    per_turn: 180.0,
                }),
                travel_rad: Some([-20.0 * degree, 85.0 * degree]),
                ..azimuth
            },
        }
    }
}

impl AxisParams {
    /// This axis without dry friction, cogging, backlash and encoder steps.
    pub fn ideal(self) -> Self {
        Self {
            friction: None,
            structure: self.structure.map(|structure| Structure {
                backlash_rad: 0.0,
                ..structure
            }),
            cogging: None,
            encoder_bits: None,
            ..self
        }
    }

    fn validate(&self) -> Result<(), GimbalError> {
        let mut positive = vec![
            ("inertia_kg_m2", self.inertia_kg_m2),
            ("torque_limit_nm", self.torque_limit_nm),
            ("rate_limit_radps", self.rate_limit_radps),
            ("bandwidth_hz", self.bandwidth_hz),
            ("damping", self.damping),
        ];
        let mut at_least_zero = vec![("viscous_nms", self.viscous_nms)];
        if let Some(friction) = self.friction {
            positive.push(("stribeck_radps", friction.stribeck_radps));
            at_least_zero.push(("coulomb_nm", friction.coulomb_nm));
            let rise_nm = friction.breakaway_nm - friction.coulomb_nm;
            at_least_zero.push(("breakaway_nm - coulomb_nm", rise_nm));
            at_least_zero.push(("presliding_rad", friction.presliding_rad));
            at_least_zero.push(("bristle_nms", friction.bristle_nms));
        }
        if let Some(cogging) = self.cogging {
            at_least_zero.push(("cogging.torque_nm", cogging.torque_nm));
            positive.push(("cogging.per_turn", cogging.per_turn));
        }
        if let Some(structure) = self.structure {
            positive.push(("locked_rotor_hz", structure.locked_rotor_hz));
            positive.push(("structure.damping", structure.damping));
            positive.push(("rotor_share", structure.rotor_share));
            positive.push(("1 - rotor_share", 1.0 - structure.rotor_share));
            at_least_zero.push(("backlash_rad", structure.backlash_rad));
        }
        if let Some([low, high]) = self.travel_rad {
            positive.push(("travel_rad", high - low));
        }
        let bad = |least: fn(f64) -> bool| {
            move |&&(_, value): &&(&'static str, f64)| !(least(value) && value.is_finite())
        };
        let wrong = positive.iter().find(bad(|value| value > 0.0));
        let wrong = wrong.or_else(|| at_least_zero.iter().find(bad(|value| value >= 0.0)));
        if let Some(&(name, value)) = wrong {
            return Err(GimbalError { name, value });
        }
        match self.encoder_bits {
            Some(bits) if !(1..=48).contains(&bits) => Err(GimbalError {
                name: "encoder_bits",
                value: f64::from(bits),
            }),
            _ => Ok(()),
        }
    }

    /// Angle [rad] to turn from `angle_rad` to reach `target_rad` (any multiple of a turn): the
    /// shortest way the stops allow; to the nearer stop when the target lies beyond them.
    pub fn error_rad(&self, target_rad: f64, angle_rad: f64) -> f64 {
        let shortest = wrap_pi(target_rad - angle_rad);
        let Some([low, high]) = self.travel_rad else {
            return shortest;
        };
        [shortest, shortest - TAU * shortest.signum()]
            .into_iter()
            .find(|e| (low..=high).contains(&(angle_rad + e)))
            .unwrap_or((angle_rad + shortest).min(high).max(low) - angle_rad)
    }
}

impl GimbalParams {
    /// Checks every field.
    pub fn validate(&self) -> Result<(), GimbalError> {
        self.azimuth.validate()?;
        self.elevation.validate()
    }

    /// Angles [rad] to turn in azimuth (x) and elevation (y) from `az_el_rad` to `target_rad`.
    pub fn error_rad(&self, target_rad: DVec2, az_el_rad: DVec2) -> DVec2 {
        DVec2::new(
            self.azimuth.error_rad(target_rad.x, az_el_rad.x),
            self.elevation.error_rad(target_rad.y, az_el_rad.y),
        )
    }

    /// The angles [rad] between the stops that point as `az_el_rad` does, or the nearest stops.
    pub fn within_stops(&self, az_el_rad: DVec2) -> DVec2 {
        let middle = |axis: &AxisParams| {
            axis.travel_rad
                .map_or(0.0, |[low, high]| 0.5 * (low + high))
        };
        let middle_rad = DVec2::new(middle(&self.azimuth), middle(&self.elevation));
        middle_rad + self.error_rad(az_el_rad, middle_rad)
    }

    /// The command that slews to a position [rad] and stops there: proportional near the target,
    /// on the braking parabola at 80 % of the torque far from it.
    pub fn position_command(&self, state: &GimbalState, target_rad: DVec2) -> GimbalCommand {
        let error = self.error_rad(target_rad, state.encoder_az_el_rad());
        let rate = |axis: &AxisParams, error: f64| {
            // Three eighths of the rate loop's bandwidth: steps settle fast and do not overshoot.
            let linear = 0.375 * TAU * axis.bandwidth_hz * error.abs();
            let braking = (1.6 * axis.torque_limit_nm / axis.inertia_kg_m2 * error.abs()).sqrt();
            linear.min(braking).copysign(error)
        };
        GimbalCommand {
            rate_radps: [rate(&self.azimuth, error.x), rate(&self.elevation, error.y)],
        }
    }

    /// Azimuth [rad] and its rate [rad/s] to follow instead of the target's while it passes so near
    /// the zenith that its azimuth turns faster than the axis can; `None` elsewhere.
    ///
    /// Seen on a plane above the station a target in straight level flight moves uniformly, so its
    /// azimuth is that of its closest point ± atan(v t/ρ), t counted from there. The axis turns at
    /// a constant rate ω through the same azimuth at the same moment, from −T to T with
    /// ω T = atan(v T/ρ): it leaves the target early, and meets it again on the exit side.
    pub fn keyhole_azimuth(&self, az_el_rad: DVec2, rates_radps: DVec2) -> Option<[f64; 2]> {
        // The rest of the rate limit lets the servo follow the ramp.
        let omega = 0.9 * self.azimuth.rate_limit_radps;
        let d = az_el_to_los(az_el_rad);
        // Below 45° an azimuth this fast belongs to no pass of the zenith.
        if d.z < std::f64::consts::FRAC_1_SQRT_2 {
            return None;
        }
        let (sin_el, cos_el) = az_el_rad.y.sin_cos();
        let (sin_az, cos_az) = az_el_rad.x.sin_cos();
        let out = DVec2::new(sin_az, cos_az);
        let right = DVec2::new(cos_az, -sin_az);
        // Place and velocity on the plane, in heights: the distance from the zenith is cot(el).
        let r = out * (cos_el / sin_el);
        let v = right * (cos_el / sin_el * rates_radps.x) - out * (rates_radps.y / d.z.powi(2));
        let speed = v.length();
        if speed < 1e-9 {
            return None;
        }
        let t = r.dot(v) / (speed * speed); // since the closest point [s]
        let side = (v.x * r.y - v.y * r.x).signum();
        let peak = speed * speed / (v.x * r.y - v.y * r.x).abs().max(1e-12);
        if peak <= omega {
            return None;
        }
        // Newton's method comes down on the root from above, where the function is concave.
        let mut half_s = 0.5 * PI / omega;
        for _ in 0..12 {
            let x = peak * half_s;
            half_s -= (x.atan() - omega * half_s) / (peak / (1.0 + x * x) - omega);
        }
        (t.abs() < half_s).then(|| {
            let closest = v.x.atan2(v.y) - side * 0.5 * PI;
            [wrap_pi(closest + side * omega * t), side * omega]
        })
    }
}

/// State of one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisState {
    /// Angle of the load relative to the base [rad]; wrapped to (−π, π] on an axis without stops.
    pub angle_rad: f64,
    /// Rate of the load relative to the base [rad/s].
    pub rate_radps: f64,
    /// Angle of the rotor less that of the load [rad].
    pub twist_rad: f64,
    /// Its rate [rad/s].
    pub twist_rate_radps: f64,
    /// Integrator of the rate loop [N m].
    pub integral_nm: f64,
    /// Motor torque of the last step [N m].
    pub torque_nm: f64,
    /// Deflection of the bearing's bristles [rad]; see [`Friction`].
    pub bristle_rad: f64,
    /// Reading of the encoder [rad].
    pub encoder_rad: f64,
    /// Reading of the gyro [rad/s]: the rotor's own rate until [`GimbalState::read_gyros`].
    pub gyro_radps: f64,
}

impl AxisState {
    /// Rate of the rotor relative to the base [rad/s].
    fn rotor_radps(&self) -> f64 {
        self.rate_radps + self.twist_rate_radps
    }
}

/// State of a two-axis gimbal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GimbalState {
    /// Outer axis.
    pub azimuth: AxisState,
    /// Inner axis.
    pub elevation: AxisState,
}

impl GimbalState {
    /// At rest at an azimuth (x) and an elevation (y) [rad].
    pub fn at_rest(az_el_rad: DVec2) -> Self {
        let axis = |angle_rad| AxisState {
            angle_rad,
            encoder_rad: angle_rad,
            ..AxisState::default()
        };
        Self {
            azimuth: axis(az_el_rad.x),
            elevation: axis(az_el_rad.y),
        }
    }

    /// True azimuth (x) and elevation (y) of the load [rad].
    pub fn az_el_rad(&self) -> DVec2 {
        DVec2::new(self.azimuth.angle_rad, self.elevation.angle_rad)
    }

    /// True azimuth (x) and elevation (y) rates of the load [rad/s].
    pub fn rates_radps(&self) -> DVec2 {
        DVec2::new(self.azimuth.rate_radps, self.elevation.rate_radps)
    }

    /// Azimuth (x) and elevation (y) that the encoders read [rad].
    pub fn encoder_az_el_rad(&self) -> DVec2 {
        DVec2::new(self.azimuth.encoder_rad, self.elevation.encoder_rad)
    }

    /// Azimuth (x) and elevation (y) rates that the gyros read [rad/s].
    pub fn gyro_rates_radps(&self) -> DVec2 {
        DVec2::new(self.azimuth.gyro_radps, self.elevation.gyro_radps)
    }

    /// Torque on azimuth and elevation [N m] by which the load's inertia drags behind a base that
    /// in the last `dt_s` [s] came to the rate `rate_enu_radps` [rad/s] and turned by
    /// `turned_enu_rad` [rad]; `base_rate_radps` is its rate about the axes, brought up to date.
    ///
    /// The torque −J Δω/dt is held over the tick, so it moves the load by the mean of the base's
    /// rates; what the base really turned is a little different, and inertia leaves the load behind
    /// by that.
    pub fn follow_base(
        &mut self,
        params: &GimbalParams,
        base_rate_radps: &mut [f64; 2],
        rate_enu_radps: DVec3,
        turned_enu_rad: DVec3,
        dt_s: f64,
    ) -> [f64; 2] {
        let on_axes = |enu| base_rate_on_axes(self.azimuth.angle_rad, enu);
        let (rate, turned_rad) = (on_axes(rate_enu_radps), on_axes(turned_enu_rad));
        let before = std::mem::replace(base_rate_radps, rate);
        let slip_rad = [0, 1].map(|i| 0.5 * dt_s * (rate[i] + before[i]) - turned_rad[i]);
        self.azimuth.angle_rad += slip_rad[0];
        self.elevation.angle_rad += slip_rad[1];
        let inertia = [params.azimuth.inertia_kg_m2, params.elevation.inertia_kg_m2];
        [0, 1].map(|i| -inertia[i] * (rate[i] - before[i]) / dt_s)
    }

    /// Reads the gyros on the rotors after a step of `dt_s` [s].
    pub fn read_gyros(&mut self, gyros: &mut Gyro<2>, dt_s: f64) {
        let rates_radps = [&self.azimuth, &self.elevation].map(AxisState::rotor_radps);
        let [azimuth, elevation] = gyros.read(rates_radps, dt_s);
        (self.azimuth.gyro_radps, self.elevation.gyro_radps) = (azimuth, elevation);
    }
}

/// Command to the gimbal, azimuth then elevation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GimbalCommand {
    /// Rate [rad/s].
    pub rate_radps: [f64; 2],
}

/// Wind load: drag at a point ahead of the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindLoad {
    /// Area [m²].
    pub area_m2: f64,
    /// Drag coefficient.
    pub drag: f64,
    /// How far the centre of pressure lies ahead of the axes along the line of sight [m].
    pub arm_m: f64,
}

impl Default for WindLoad {
    /// A box of 0.5 m side, C_D of a cube face on to edge on (1.05 to 0.8, Hoerner) with the yoke's
    /// drag added, its tube 0.15 m longer ahead of the axes than behind (assumed).
    fn default() -> Self {
        Self {
            area_m2: 0.25, // [m²]
            drag: 1.2,
            arm_m: 0.15, // [m]
        }
    }
}

impl WindLoad {
    /// Torque [N m] of `wind_enu_mps` [m/s] about azimuth (clockwise) and elevation (up) at
    /// `az_el_rad`: the arm times the drag ½ ρ C_D A |v| v across the line of sight.
    pub fn torque_nm(
        &self,
        air_density_kgpm3: f64,
        wind_enu_mps: DVec3,
        az_el_rad: DVec2,
    ) -> [f64; 2] {
        let (sin_az, cos_az) = az_el_rad.x.sin_cos();
        let (sin_el, cos_el) = az_el_rad.y.sin_cos();
        let right = DVec3::new(cos_az, -sin_az, 0.0);
        let up = DVec3::new(-sin_el * sin_az, -sin_el * cos_az, cos_el);
        let drag_n = 0.5 * air_density_kgpm3 * self.drag * self.area_m2 * wind_enu_mps.length();
        let moment = self.arm_m * drag_n * wind_enu_mps;
        [cos_el * moment.dot(right), moment.dot(up)]
    }
}

/// Advances the gimbal by `dt_s` under a command and disturbance torques [N m] (azimuth,
/// elevation), which are spread over rotor and load like their inertia. A moving base enters in
/// the same way, as the torque −J·α about each axis, with α from the change of
/// [`crate::maths::kinematics::base_rate_on_axes`].
pub fn step(
    state: &mut GimbalState,
    params: &GimbalParams,
    command: &GimbalCommand,
    disturbance_torque_nm: [f64; 2],
    dt_s: f64,
) {
    for (i, (axis, p)) in [
        (&mut state.azimuth, &params.azimuth),
        (&mut state.elevation, &params.elevation),
    ]
    .into_iter()
    .enumerate()
    {
        axis.torque_nm = servo_torque(axis, p, command.rate_radps[i], dt_s);
        advance(axis, p, disturbance_torque_nm[i], dt_s);
    }
}

/// The motor torque [N m] that the rate loop asks for.
fn servo_torque(
    state: &mut AxisState,
    params: &AxisParams,
    rate_command_radps: f64,
    dt_s: f64,
) -> f64 {
    let inertia = params.inertia_kg_m2;
    let limit = params.rate_limit_radps;
    let mut wanted = rate_command_radps.min(limit).max(-limit);
    if let Some([low, high]) = params.travel_rad {
        // Brake ahead of a stop at half the torque, which leaves the rest for disturbances.
        let slowest = |room: f64| (params.torque_limit_nm / inertia * room.max(0.0)).sqrt();
        wanted = wanted
            .min(slowest(high - state.encoder_rad))
            .max(-slowest(state.encoder_rad - low));
    }
    let omega = TAU * params.bandwidth_hz;
    let error = wanted - state.gyro_radps;
    let demand = 2.0 * params.damping * omega * inertia * error + state.integral_nm;
    let mut torque = demand
        .min(params.torque_limit_nm)
        .max(-params.torque_limit_nm);
    if state.gyro_radps.abs() >= limit && torque * state.gyro_radps > 0.0 {
        torque = 0.0;
    }
    // Conditional integration: hold while saturated unless the error leads back out.
    if torque == demand || error * (demand - torque) < 0.0 {
        state.integral_nm += omega * omega * inertia * error * dt_s;
    }
    torque
}

/// Substeps are at most this long [s]: a sixth of the free mode's phase at 80 Hz.
const SUBSTEP_S: f64 = 1.0 / 3840.0;

/// Moves one axis for `dt_s` under its motor torque and a disturbance [N m], and reads its sensors.
fn advance(state: &mut AxisState, params: &AxisParams, disturbance_nm: f64, dt_s: f64) {
    // Slightly less, so that rounding does not cost another substep.
    let substeps = (dt_s / SUBSTEP_S - 1e-6).ceil().max(1.0);
    let plant = Plant::new(params, dt_s / substeps);
    for _ in 0..substeps as usize {
        plant.substep(state, params, disturbance_nm);
        match params.travel_rad {
            None => state.angle_rad = wrap_pi(state.angle_rad),
            // The stop is a hard, inelastic one, and the load meets it.
            Some([low, high]) => {
                let (angle, rate) = (state.angle_rad, state.rate_radps);
                let blocked = (angle > high && rate > 0.0) || (angle < low && rate < 0.0);
                state.angle_rad = angle.min(high).max(low);
                if blocked {
                    state.rate_radps = 0.0;
                    if params.structure.is_some() {
                        // The rotor runs on against the spring.
                        state.twist_rad += angle - state.angle_rad;
                        state.twist_rate_radps += rate;
                    }
                }
            }
        }
    }
    state.encoder_rad = match params.encoder_bits {
        Some(bits) => {
            let lsb = TAU / (bits as f64).exp2();
            (state.angle_rad / lsb).round() * lsb
        }
        None => state.angle_rad,
    };
    state.gyro_radps = state.rotor_radps();
}

/// One axis discretised over a substep. Centre of inertia q and twist φ (rotor less load) move
/// independently: J q̈ = T + d and φ̈ = T/J_r − 2ζωφ̇ − ω²(φ − slack), with the torque T on the rotor,
/// ω and ζ those of the free mode.
struct Plant {
    dt_s: f64,
    inertia_kg_m2: f64,
    /// Rotor's share of the inertia; 1 for a rigid axis.
    share: f64,
    /// Half of the backlash [rad].
    slack_rad: f64,
    /// Free mode: frequency [Hz] and damping ratio.
    mode: [f64; 2],
    /// Twist per torque on the rotor [rad/(N m)], at rest in the accelerating frame.
    compliance: f64,
    transition: [[f64; 2]; 2],
}

impl Plant {
    fn new(params: &AxisParams, dt_s: f64) -> Self {
        let mut plant = Self {
            dt_s,
            inertia_kg_m2: params.inertia_kg_m2,
            share: 1.0,
            slack_rad: 0.0,
            mode: [0.0; 2],
            compliance: 0.0,
            transition: [[0.0; 2]; 2],
        };
        if let Some(structure) = params.structure {
            // With the rotor free the load swings faster: ω² = K/(J share (1 − share)).
            let root = structure.rotor_share.sqrt();
            let omega = TAU * structure.locked_rotor_hz;
            plant.share = structure.rotor_share;
            plant.slack_rad = 0.5 * structure.backlash_rad;
            plant.mode = [structure.locked_rotor_hz / root, structure.damping / root];
            plant.compliance = 1.0 / (params.inertia_kg_m2 * omega * omega);
            plant.transition = plant.spring(dt_s);
        }
        plant
    }

    fn spring(&self, dt_s: f64) -> [[f64; 2]; 2] {
        let [frequency_hz, damping] = self.mode;
        // Only a step of zero length is refused; it changes nothing.
        second_order_transition(frequency_hz, damping, dt_s).unwrap_or([[1.0, 0.0], [0.0, 1.0]])
    }

    /// Which end of the slack the twist rests on: −1, 1, or 0 between them.
    fn side(&self, twist_rad: f64) -> f64 {
        if self.slack_rad == 0.0 || twist_rad.abs() > self.slack_rad {
            twist_rad.signum()
        } else {
            0.0
        }
    }

    /// Twist and its rate a time later under a held torque on the rotor, on the given side.
    fn twist(
        &self,
        [twist, rate]: [f64; 2],
        side: f64,
        torque_nm: f64,
        dt_s: f64,
        [[a, b], [c, d]]: [[f64; 2]; 2],
    ) -> [f64; 2] {
        if side == 0.0 {
            let push = torque_nm / (self.share * self.inertia_kg_m2);
            return [
                twist + dt_s * (rate + 0.5 * dt_s * push),
                rate + dt_s * push,
            ];
        }
        let rest = side * self.slack_rad + torque_nm * self.compliance;
        let offset = twist - rest;
        [rest + a * offset + b * rate, c * offset + d * rate]
    }

    /// The twist through a substep, changing sides where it leaves or meets the spring.
    fn twist_over(&self, mut at: [f64; 2], torque_nm: f64) -> [f64; 2] {
        if self.share == 1.0 {
            return [0.0; 2];
        }
        if self.slack_rad == 0.0 {
            return self.twist(at, 1.0, torque_nm, self.dt_s, self.transition);
        }
        let (mut left_s, mut transition) = (self.dt_s, self.transition);
        for _ in 0..8 {
            let side = self.side(at[0]);
            let end = self.twist(at, side, torque_nm, left_s, transition);
            if self.side(end[0]) == side {
                return end;
            }
            // Bisect for the first moment on the other side.
            let (mut low_s, mut high_s, mut next) = (0.0, left_s, end);
            for _ in 0..40 {
                let middle_s = 0.5 * (low_s + high_s);
                let there = self.twist(at, side, torque_nm, middle_s, self.spring(middle_s));
                if self.side(there[0]) == side {
                    low_s = middle_s;
                } else {
                    (high_s, next) = (middle_s, there);
                }
            }
            at = next;
            left_s -= high_s;
            if left_s <= 0.0 {
                break;
            }
            transition = self.spring(left_s);
        }
        at
    }

    fn substep(&self, state: &mut AxisState, params: &AxisParams, disturbance_nm: f64) {
        let h = self.dt_s;
        let load_share = 1.0 - self.share;
        let twist = [state.twist_rad, state.twist_rate_radps];
        let q_rate = state.rate_radps + self.share * twist[1];
        let side = if self.slack_rad == 0.0 {
            1.0
        } else {
            self.side(twist[0])
        };
        // The rotor's rate at the end is affine in the torque on the rotor: without friction ...
        let cogging_nm = params.cogging.map_or(0.0, |cogging| {
            cogging.at_nm(state.angle_rad + state.twist_rad)
        });
        let drive = state.torque_nm + cogging_nm;
        let before = state.rate_radps + twist[1];
        let free_twist_rate = if self.share == 1.0 {
            0.0
        } else {
            self.twist(twist, side, drive, h, self.transition)[1]
        };
        let free = q_rate
            + h * (drive + disturbance_nm) / self.inertia_kg_m2
            + load_share * free_twist_rate;
        // ... and how much a torque changes it.
        let gain = if self.share == 1.0 {
            h / self.inertia_kg_m2
        } else if side == 0.0 {
            h / (self.share * self.inertia_kg_m2)
        } else {
            h / self.inertia_kg_m2 - load_share * self.transition[1][0] * self.compliance
        };
        let drag = 0.5 * gain * params.viscous_nms;
        let slipping = free - drag * before;
        let (dry, bristle_rad) = params.friction.map_or((0.0, 0.0), |friction| {
            // What viscous drag leaves of the rate and of the gain.
            let [free, gain] = [slipping, gain].map(|x| x / (1.0 + drag));
            friction.torque_nm(state.bristle_rad, before, free, gain, h)
        });
        state.bristle_rad = bristle_rad;
        let after = (slipping - gain * dry) / (1.0 + drag);
        let torque = drive - dry - 0.5 * params.viscous_nms * (before + after);

        let push = (torque + disturbance_nm) / self.inertia_kg_m2;
        let q_turn = h * (q_rate + 0.5 * h * push);
        let q_rate = q_rate + h * push;
        let [phi, phi_rate] = self.twist_over(twist, torque);
        state.angle_rad += q_turn - self.share * (phi - twist[0]);
        state.rate_radps = q_rate - self.share * phi_rate;
        state.twist_rad = phi;
        state.twist_rate_radps = phi_rate;
    }
}

#[cfg(test)]
mod tests;
