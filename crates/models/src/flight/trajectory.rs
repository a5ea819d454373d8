//! The paths of UAVs, as a scenario states them and as the simulation samples them.
//!
//! Positions are site-local `[east, north, up]` in metres, up measured from the site origin.

use super::multirotor::{Airframe, MultirotorState, Setpoint};
use crate::maths::rng::Stream;
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use thiserror::Error;

/// Below this horizontal speed [m/s] a UAV keeps its heading instead of facing its velocity.
const HEADING_SPEED_MPS: f64 = 0.5; // [m/s]
/// Acceleration with which a pop-up starts and ends its rise, and a recorded flight stops after
/// its last row [m/s^2].
const GENTLE_ACCELERATION_MPS2: f64 = 3.0; // [m/s^2]

/// A path as a scenario states it. Except when hovering, the nose follows the velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Trajectory {
    /// Steady straight flight.
    Straight {
        /// Position at time 0 [m, enu].
        start_enu_m: [f64; 3],
        /// Velocity [m/s, enu].
        velocity_enu_mps: [f64; 3],
    },
    /// Straight legs at one speed, corners rounded by parabolas of constant acceleration. An open
    /// path starts at its speed and comes to a stop on its last point; a looped one returns to its
    /// first point for ever.
    Waypoints {
        /// At least two points [m, enu].
        points_enu_m: Vec<[f64; 3]>,
        /// Speed on the legs [m/s].
        speed_mps: f64,
        /// Whether the path closes on its first point; default false.
        #[serde(default, rename = "loop")]
        closed: bool,
        /// Acceleration in the corners [m/s^2]; default 4.
        #[serde(default = "default_corner_acceleration_mps2")]
        corner_acceleration_mps2: f64,
    },
    /// A level circle.
    Orbit {
        /// Centre [m, enu]; its height is the flight height.
        centre_enu_m: [f64; 3],
        /// Radius [m].
        radius_m: f64,
        /// Speed along the circle [m/s].
        speed_mps: f64,
        /// Sense seen from above; default true.
        #[serde(default = "default_clockwise")]
        clockwise: bool,
        /// Compass bearing of the UAV from the centre at time 0 [deg]; default 0, north.
        #[serde(default)]
        start_bearing_deg: f64,
    },
    /// Evasive flight: a straight line with a sinusoidal weave to both sides of it.
    Weave {
        /// Position at time 0 [m, enu].
        start_enu_m: [f64; 3],
        /// Velocity of the line [m/s, enu]; not vertical.
        velocity_enu_mps: [f64; 3],
        /// Peak sideways acceleration [m/s^2].
        lateral_acceleration_mps2: f64,
        /// Period of the weave [s].
        period_s: f64,
    },
    /// Hides low, rises straight up and hovers.
    PopUp {
        /// Hover position after the rise [m, enu].
        position_enu_m: [f64; 3],
        /// Height before the rise [m, enu up]; below the hover position.
        hide_height_m: f64,
        /// Start of the rise [s]; default 0.
        #[serde(default)]
        pop_time_s: f64,
        /// Greatest speed of the rise [m/s].
        rise_speed_mps: f64,
        /// Compass heading of the nose [deg]; default 0, north.
        #[serde(default)]
        heading_deg: f64,
    },
    /// Stays in place.
    Hover {
        /// Position [m, enu].
        position_enu_m: [f64; 3],
        /// Compass heading of the nose [deg]; default 0, north.
        #[serde(default)]
        heading_deg: f64,
    },
    /// A flown path, interpolated by cubics through its rows; it comes to a stop after the last.
    Recorded {
        /// CSV file with the header `t_s,east_m,north_m,up_m`; its first row is time 0.
        file: String,
    },
}

fn default_corner_acceleration_mps2() -> f64 {
    4.0 // [m/s^2]
}

fn default_clockwise() -> bool {
    true
}

/// Why a trajectory cannot be flown; each message says how to correct it.
#[derive(Debug, Error)]
pub enum TrajectoryError {
    /// A field holds NaN or infinity.
    #[error("{0} is not finite; give plain numbers")]
    NotFinite(&'static str),
    /// A field that must be positive is not.
    #[error("{0} is {1}; give a value above 0")]
    NotPositive(&'static str, f64),
    /// A path of fewer than two waypoints.
    #[error("points_enu_m has {0} point(s); give at least 2")]
    TooFewWaypoints(usize),
    /// Two successive waypoints coincide.
    #[error("waypoint {0} (counted from 1) repeats the one before it; remove it")]
    RepeatedWaypoint(usize),
    /// The corners at the ends of a leg take more than its length.
    #[error(
        "the leg to waypoint {waypoint} (counted from 1) is too short for its corners; \
         lower speed_mps to {speed_mps:.2}, or raise corner_acceleration_mps2 to {acceleration_mps2:.2}"
    )]
    LegTooShort {
        /// The waypoint the leg leads to, counted from 1.
        waypoint: usize,
        /// The greatest speed this leg allows [m/s].
        speed_mps: f64,
        /// The least corner acceleration this leg allows [m/s^2].
        acceleration_mps2: f64,
    },
    /// A weave about a line without a horizontal direction.
    #[error("velocity_enu_mps is vertical or zero; a weave needs a horizontal part")]
    NoSideways,
    /// A pop-up that does not rise.
    #[error("hide_height_m {hide_m} is not below the hover height {hover_m}; lower it")]
    NoRise {
        /// Height before the rise [m].
        hide_m: f64,
        /// Hover height [m].
        hover_m: f64,
    },
    /// The recorded file could not be read.
    #[error(
        "{file}: cannot be read: {source}; name an existing file, from the scenario's folder or whole"
    )]
    Unreadable {
        /// The file named by the scenario.
        file: String,
        /// The reader's error.
        source: std::io::Error,
    },
    /// The recorded file is not a CSV of the expected columns.
    #[error(
        "{file}: {source}; the header must be t_s,east_m,north_m,up_m and every row four numbers"
    )]
    Csv {
        /// The file named by the scenario.
        file: String,
        /// The CSV reader's error, with the row.
        source: csv::Error,
    },
    /// A recorded row holds NaN or infinity.
    #[error("{file}: data row {row} is not finite; remove it or fill it in")]
    RowNotFinite {
        /// The file named by the scenario.
        file: String,
        /// The row, counted from 1 after the header.
        row: usize,
    },
    /// Time stands still or runs back in a recorded file.
    #[error(
        "{file}: data row {row} is not later than the one before it; sort by t_s, drop repeats"
    )]
    TimeNotIncreasing {
        /// The file named by the scenario.
        file: String,
        /// The row, counted from 1 after the header.
        row: usize,
    },
    /// A recorded file of fewer than two rows.
    #[error("{file} has {rows} data row(s); give at least 2")]
    TooFewRows {
        /// The file named by the scenario.
        file: String,
        /// Rows found.
        rows: usize,
    },
}

/// One stretch of a path, cubic in time.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// Start [s].
    t_s: f64,
    r_enu_m: DVec3,
    v_enu_mps: DVec3,
    a_enu_mps2: DVec3,
    jerk_enu_mps3: DVec3,
    /// Heading where the velocity gives none [rad].
    yaw_rad: f64,
}

impl Piece {
    /// Position, velocity and acceleration `u_s` [s] into the piece.
    fn motion(&self, u_s: f64) -> (DVec3, DVec3, DVec3) {
        let j = self.jerk_enu_mps3;
        (
            self.r_enu_m + u_s * (self.v_enu_mps + u_s * (self.a_enu_mps2 / 2.0 + u_s / 6.0 * j)),
            self.v_enu_mps + u_s * (self.a_enu_mps2 + u_s / 2.0 * j),
            self.a_enu_mps2 + u_s * j,
        )
    }
}

/// A checked path, ready to sample.
#[derive(Clone, Debug)]
pub struct CompiledTrajectory {
    path: CompiledPath,
    /// Displacement of the whole path [m, enu].
    offset_enu_m: DVec3,
    /// How far along the path it is at time 0 [s].
    lead_s: f64,
}

#[derive(Clone, Debug)]
enum CompiledPath {
    /// Pieces in order of time; the last one goes on for ever, or all repeat with a period [s].
    Pieces(Vec<Piece>, Option<f64>),
    /// A circle; the rate [rad/s] is positive clockwise.
    Circle {
        centre_enu_m: DVec3,
        radius_m: f64,
        bearing_rad: f64,
        rate_radps: f64,
    },
    /// A line with a sinusoidal offset of amplitude `side_enu_m`.
    Sine {
        start_enu_m: DVec3,
        velocity_enu_mps: DVec3,
        side_enu_m: DVec3,
        rate_radps: f64,
    },
}

impl Trajectory {
    /// Checks the path and prepares it for sampling; `load` gives the text of a recorded file.
    pub fn compile(
        &self,
        load: impl FnOnce(&str) -> std::io::Result<String>,
    ) -> Result<CompiledTrajectory, TrajectoryError> {
        let path = match *self {
            Self::Straight {
                start_enu_m,
                velocity_enu_mps,
            } => straight(start_enu_m, velocity_enu_mps)?,
            Self::Waypoints {
                ref points_enu_m,
                speed_mps,
                closed,
                corner_acceleration_mps2,
            } => waypoints(
                points_enu_m,
                positive("speed_mps", speed_mps)?,
                closed,
                positive("corner_acceleration_mps2", corner_acceleration_mps2)?,
            )?,
            Self::Orbit {
                centre_enu_m,
                radius_m,
                speed_mps,
                clockwise,
                start_bearing_deg,
            } => {
                let radius_m = positive("radius_m", radius_m)?;
                let rate_radps = positive("speed_mps", speed_mps)? / radius_m;
                CompiledPath::Circle {
                    centre_enu_m: vector("centre_enu_m", centre_enu_m)?,
                    radius_m,
                    bearing_rad: finite("start_bearing_deg", start_bearing_deg)?.to_radians(),
                    rate_radps: if clockwise { rate_radps } else { -rate_radps },
                }
            }
            Self::Weave {
                start_enu_m,
                velocity_enu_mps,
                lateral_acceleration_mps2,
                period_s,
            } => weave(
                start_enu_m,
                velocity_enu_mps,
                lateral_acceleration_mps2,
                period_s,
            )?,
            Self::PopUp {
                position_enu_m,
                hide_height_m,
                pop_time_s,
                rise_speed_mps,
                heading_deg,
            } => pop_up(
                vector("position_enu_m", position_enu_m)?,
                finite("hide_height_m", hide_height_m)?,
                finite("pop_time_s", pop_time_s)?,
                positive("rise_speed_mps", rise_speed_mps)?,
                finite("heading_deg", heading_deg)?.to_radians(),
            )?,
            Self::Hover {
                position_enu_m,
                heading_deg,
            } => hover(position_enu_m, heading_deg)?,
            Self::Recorded { ref file } => {
                let text = load(file).map_err(|source| TrajectoryError::Unreadable {
                    file: file.clone(),
                    source,
                })?;
                recorded(file, &text)?
            }
        };
        Ok(CompiledTrajectory {
            path,
            offset_enu_m: DVec3::ZERO,
            lead_s: 0.0,
        })
    }
}

/// A straight flight at constant velocity.
fn straight(
    start_enu_m: [f64; 3],
    velocity_enu_mps: [f64; 3],
) -> Result<CompiledPath, TrajectoryError> {
    let mut pieces = Pieces::new(vector("start_enu_m", start_enu_m)?, 0.0);
    pieces.v_enu_mps = vector("velocity_enu_mps", velocity_enu_mps)?;
    pieces.push(f64::INFINITY, DVec3::ZERO, DVec3::ZERO);
    Ok(CompiledPath::Pieces(pieces.done, None))
}

/// A stand at one place.
fn hover(position_enu_m: [f64; 3], heading_deg: f64) -> Result<CompiledPath, TrajectoryError> {
    let r_enu_m = vector("position_enu_m", position_enu_m)?;
    let yaw_rad = finite("heading_deg", heading_deg)?.to_radians();
    let mut pieces = Pieces::new(r_enu_m, yaw_rad);
    pieces.push(f64::INFINITY, DVec3::ZERO, DVec3::ZERO);
    Ok(CompiledPath::Pieces(pieces.done, None))
}

/// A straight flight that swings sideways with a peak acceleration.
fn weave(
    start_enu_m: [f64; 3],
    velocity_enu_mps: [f64; 3],
    lateral_acceleration_mps2: f64,
    period_s: f64,
) -> Result<CompiledPath, TrajectoryError> {
    let velocity_enu_mps = vector("velocity_enu_mps", velocity_enu_mps)?;
    let right = velocity_enu_mps
        .cross(DVec3::Z)
        .try_normalize()
        .ok_or(TrajectoryError::NoSideways)?;
    let rate_radps = TAU / positive("period_s", period_s)?;
    let peak_mps2 = positive("lateral_acceleration_mps2", lateral_acceleration_mps2)?;
    Ok(CompiledPath::Sine {
        start_enu_m: vector("start_enu_m", start_enu_m)?,
        velocity_enu_mps,
        side_enu_m: peak_mps2 / rate_radps.powi(2) * right,
        rate_radps,
    })
}

impl CompiledTrajectory {
    /// The path displaced by `offset_enu_m` [m, enu].
    pub fn shifted(self, offset_enu_m: DVec3) -> Self {
        Self {
            offset_enu_m: self.offset_enu_m + offset_enu_m,
            ..self
        }
    }

    /// The path begun `lead_s` [s] earlier: at time 0 it is that far along.
    pub fn begun_earlier(self, lead_s: f64) -> Self {
        Self {
            lead_s: self.lead_s + lead_s,
            ..self
        }
    }

    /// One draw of where and when the path is flown: displaced by normal offsets of standard
    /// deviation `spread_m` (east and north, up) [m], begun up to `spread_s` [s] earlier.
    pub fn spread(self, spread_m: [f64; 2], spread_s: f64, rng: &mut Stream) -> Self {
        let [across_m, up_m] = spread_m;
        let normal = rng.normal3();
        self.shifted(DVec3::new(across_m, across_m, up_m) * normal)
            .begun_earlier(spread_s * rng.uniform())
    }

    /// The setpoint at `t_s` [s] after the start (the start itself before it).
    pub fn sample(&self, t_s: f64) -> Setpoint {
        let t_s = t_s.max(0.0) + self.lead_s;
        let ((r_enu_m, v_enu_mps, a_enu_mps2), yaw_rad) = match self.path {
            CompiledPath::Pieces(ref pieces, period_s) => {
                let t_s = period_s.map_or(t_s, |period_s| t_s % period_s);
                let after = pieces.partition_point(|piece| piece.t_s <= t_s);
                let piece = &pieces[after.max(1) - 1];
                (piece.motion(t_s - piece.t_s), piece.yaw_rad)
            }
            CompiledPath::Circle {
                centre_enu_m,
                radius_m,
                bearing_rad,
                rate_radps,
            } => {
                let (sin, cos) = (bearing_rad + rate_radps * t_s).sin_cos();
                let out = DVec3::new(sin, cos, 0.0);
                let motion = (
                    centre_enu_m + radius_m * out,
                    radius_m * rate_radps * DVec3::new(cos, -sin, 0.0),
                    -radius_m * rate_radps * rate_radps * out,
                );
                (motion, 0.0)
            }
            CompiledPath::Sine {
                start_enu_m,
                velocity_enu_mps,
                side_enu_m,
                rate_radps,
            } => {
                let (sin, cos) = (rate_radps * t_s).sin_cos();
                let motion = (
                    start_enu_m + velocity_enu_mps * t_s + sin * side_enu_m,
                    velocity_enu_mps + rate_radps * cos * side_enu_m,
                    -rate_radps * rate_radps * sin * side_enu_m,
                );
                (motion, 0.0)
            }
        };
        Setpoint {
            r_enu_m: r_enu_m + self.offset_enu_m,
            v_enu_mps,
            a_enu_mps2,
            yaw_rad: course_rad(v_enu_mps).unwrap_or(yaw_rad),
        }
    }

    /// The state of `airframe` trimmed on the path at time 0, in wind `wind_enu_mps` [m/s, enu] and
    /// air of density `air_density_kgpm3` [kg/m^3].
    pub fn initial_state(
        &self,
        airframe: &Airframe,
        wind_enu_mps: DVec3,
        air_density_kgpm3: f64,
    ) -> MultirotorState {
        MultirotorState::trimmed(airframe, &self.sample(0.0), wind_enu_mps, air_density_kgpm3)
    }
}

/// Compass course [rad] of a velocity fast enough to have one.
fn course_rad(v_enu_mps: DVec3) -> Option<f64> {
    (v_enu_mps.truncate().length_squared() >= HEADING_SPEED_MPS * HEADING_SPEED_MPS)
        .then(|| v_enu_mps.x.atan2(v_enu_mps.y))
}

fn finite(field: &'static str, value: f64) -> Result<f64, TrajectoryError> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(TrajectoryError::NotFinite(field))
    }
}

fn positive(field: &'static str, value: f64) -> Result<f64, TrajectoryError> {
    if finite(field, value)? > 0.0 {
        Ok(value)
    } else {
        Err(TrajectoryError::NotPositive(field, value))
    }
}

fn vector(field: &'static str, value: [f64; 3]) -> Result<DVec3, TrajectoryError> {
    let value = DVec3::from_array(value);
    if value.is_finite() {
        Ok(value)
    } else {
        Err(TrajectoryError::NotFinite(field))
    }
}

/// Pieces laid end to end: where the last ended, the next begins.
struct Pieces {
    done: Vec<Piece>,
    t_s: f64,
    r_enu_m: DVec3,
    v_enu_mps: DVec3,
    yaw_rad: f64,
}

impl Pieces {
    /// Starts at rest at `r_enu_m` [m, enu], facing `yaw_rad` [rad].
    fn new(r_enu_m: DVec3, yaw_rad: f64) -> Self {
        Self {
            done: Vec::new(),
            t_s: 0.0,
            r_enu_m,
            v_enu_mps: DVec3::ZERO,
            yaw_rad,
        }
    }

    /// Adds a piece of `duration_s` [s]; nothing follows an infinite one.
    fn push(&mut self, duration_s: f64, a_enu_mps2: DVec3, jerk_enu_mps3: DVec3) {
        self.yaw_rad = course_rad(self.v_enu_mps).unwrap_or(self.yaw_rad);
        let piece = Piece {
            t_s: self.t_s,
            r_enu_m: self.r_enu_m,
            v_enu_mps: self.v_enu_mps,
            a_enu_mps2,
            jerk_enu_mps3,
            yaw_rad: self.yaw_rad,
        };
        self.done.push(piece);
        if duration_s.is_finite() {
            self.t_s += duration_s;
            (self.r_enu_m, self.v_enu_mps, _) = piece.motion(duration_s);
        }
    }

    /// Stops at the given deceleration [m/s^2] and stays.
    fn stop(&mut self, deceleration_mps2: f64) {
        let duration_s = self.v_enu_mps.length() / deceleration_mps2;
        if duration_s > 0.0 {
            self.push(duration_s, -self.v_enu_mps / duration_s, DVec3::ZERO);
        }
        self.v_enu_mps = DVec3::ZERO;
        self.push(f64::INFINITY, DVec3::ZERO, DVec3::ZERO);
    }
}

fn waypoints(
    points_enu_m: &[[f64; 3]],
    speed_mps: f64,
    closed: bool,
    acceleration_mps2: f64,
) -> Result<CompiledPath, TrajectoryError> {
    let count = points_enu_m.len();
    if count < 2 {
        return Err(TrajectoryError::TooFewWaypoints(count));
    }
    let points = points_enu_m
        .iter()
        .map(|&point| vector("points_enu_m", point))
        .collect::<Result<Vec<_>, _>>()?;
    // Leg k leads to waypoint (k + 1) mod count.
    let legs = (0..if closed { count } else { count - 1 })
        .map(|k| {
            let leg_m = points[(k + 1) % count] - points[k];
            let direction = leg_m.try_normalize();
            direction
                .map(|direction| (direction, leg_m.length()))
                .ok_or(TrajectoryError::RepeatedWaypoint((k + 1) % count + 1))
        })
        .collect::<Result<Vec<_>, _>>()?;
    // The corner after leg k changes the velocity from its direction to the next one's (to rest
    // after the last leg of an open path). It begins and ends `reach` from the waypoint, half its
    // duration at full speed.
    let turn = |k: usize| {
        let next = if k + 1 < legs.len() || closed {
            legs[(k + 1) % legs.len()].0
        } else {
            DVec3::ZERO
        };
        speed_mps * (next - legs[k].0)
    };
    let duration_s = |k: usize| turn(k).length() / acceleration_mps2;
    let reach_m = |k: usize| speed_mps * duration_s(k) / 2.0;
    let reach_before_m = |k: usize| match k {
        0 if closed => reach_m(legs.len() - 1),
        0 => 0.0,
        _ => reach_m(k - 1),
    };
    for (k, &(_, length_m)) in legs.iter().enumerate() {
        let need = (reach_before_m(k) + reach_m(k)) / length_m;
        if need > 1.0 {
            return Err(TrajectoryError::LegTooShort {
                waypoint: (k + 1) % count + 1,
                // Rounded to the safe side of the two printed decimals.
                speed_mps: (speed_mps / need.sqrt() * 100.0).floor() / 100.0,
                acceleration_mps2: (acceleration_mps2 * need * 100.0).ceil() / 100.0,
            });
        }
    }
    // A looped path begins where the corner about its first point ends.
    let mut pieces = Pieces::new(points[0] + reach_before_m(0) * legs[0].0, 0.0);
    for (k, &(direction, length_m)) in legs.iter().enumerate() {
        pieces.v_enu_mps = speed_mps * direction;
        let cruise_m = length_m - reach_before_m(k) - reach_m(k);
        pieces.push(cruise_m / speed_mps, DVec3::ZERO, DVec3::ZERO);
        if duration_s(k) > 0.0 {
            pieces.push(duration_s(k), turn(k) / duration_s(k), DVec3::ZERO);
        }
    }
    if closed {
        return Ok(CompiledPath::Pieces(pieces.done, Some(pieces.t_s)));
    }
    pieces.v_enu_mps = DVec3::ZERO;
    pieces.push(f64::INFINITY, DVec3::ZERO, DVec3::ZERO);
    Ok(CompiledPath::Pieces(pieces.done, None))
}

fn pop_up(
    position_enu_m: DVec3,
    hide_height_m: f64,
    pop_time_s: f64,
    rise_speed_mps: f64,
    yaw_rad: f64,
) -> Result<CompiledPath, TrajectoryError> {
    let rise_m = position_enu_m.z - hide_height_m;
    if rise_m <= 0.0 {
        return Err(TrajectoryError::NoRise {
            hide_m: hide_height_m,
            hover_m: position_enu_m.z,
        });
    }
    let mut pieces = Pieces::new(position_enu_m.with_z(hide_height_m), yaw_rad);
    let a_enu_mps2 = GENTLE_ACCELERATION_MPS2 * DVec3::Z;
    // A short rise never reaches its top speed.
    let top_mps = rise_speed_mps.min((rise_m * GENTLE_ACCELERATION_MPS2).sqrt());
    let ramp_s = top_mps / GENTLE_ACCELERATION_MPS2;
    pieces.push(pop_time_s.max(0.0), DVec3::ZERO, DVec3::ZERO);
    pieces.push(ramp_s, a_enu_mps2, DVec3::ZERO);
    pieces.push(
        (rise_m / top_mps - ramp_s).max(0.0),
        DVec3::ZERO,
        DVec3::ZERO,
    );
    pieces.stop(GENTLE_ACCELERATION_MPS2);
    Ok(CompiledPath::Pieces(pieces.done, None))
}

/// A row of a recorded flight.
#[derive(Deserialize)]
struct Row {
    t_s: f64,
    east_m: f64,
    north_m: f64,
    up_m: f64,
}

fn recorded(file: &str, text: &str) -> Result<CompiledPath, TrajectoryError> {
    let file = || file.to_owned();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut rows: Vec<(f64, DVec3)> = Vec::new();
    for row in reader.deserialize() {
        let row: Row = row.map_err(|source| TrajectoryError::Csv {
            file: file(),
            source,
        })?;
        let r_enu_m = DVec3::new(row.east_m, row.north_m, row.up_m);
        let number = rows.len() + 1;
        if !(row.t_s.is_finite() && r_enu_m.is_finite()) {
            return Err(TrajectoryError::RowNotFinite {
                file: file(),
                row: number,
            });
        }
        if rows.last().is_some_and(|&(t_s, _)| row.t_s <= t_s) {
            return Err(TrajectoryError::TimeNotIncreasing {
                file: file(),
                row: number,
            });
        }
        rows.push((row.t_s, r_enu_m));
    }
    if rows.len() < 2 {
        return Err(TrajectoryError::TooFewRows {
            file: file(),
            rows: rows.len(),
        });
    }
    // Velocity at a row: that of the parabola through it and its neighbours; at the ends, that of
    // the first and last stretch. The cubics then join with continuous velocity.
    let slope = |k: usize| {
        let ((t0, r0), (t1, r1)) = (rows[k], rows[k + 1]);
        (r1 - r0) / (t1 - t0)
    };
    let velocity = |k: usize| {
        if k == 0 {
            return slope(0);
        }
        if k == rows.len() - 1 {
            return slope(k - 1);
        }
        let (before_s, after_s) = (rows[k].0 - rows[k - 1].0, rows[k + 1].0 - rows[k].0);
        (after_s * slope(k - 1) + before_s * slope(k)) / (before_s + after_s)
    };
    let mut pieces = Pieces::new(rows[0].1, 0.0);
    // The first heading known holds from the start.
    pieces.yaw_rad = (0..rows.len())
        .find_map(|k| course_rad(velocity(k)))
        .unwrap_or(0.0);
    for k in 0..rows.len() - 1 {
        let h_s = rows[k + 1].0 - rows[k].0;
        let (v0, v1, mean) = (velocity(k), velocity(k + 1), slope(k));
        // Start each stretch on its own row, so that rounding does not add up.
        (pieces.t_s, pieces.r_enu_m, pieces.v_enu_mps) = (rows[k].0 - rows[0].0, rows[k].1, v0);
        pieces.push(
            h_s,
            (6.0 * mean - 4.0 * v0 - 2.0 * v1) / h_s,
            6.0 * (v0 + v1 - 2.0 * mean) / (h_s * h_s),
        );
    }
    pieces.stop(GENTLE_ACCELERATION_MPS2);
    Ok(CompiledPath::Pieces(pieces.done, None))
}

#[cfg(test)]
mod tests;
