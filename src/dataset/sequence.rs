//! Rendered sequences: UAVs fly by their autopilots, birds pass, and the camera follows loosely.

use super::draw::{self, Still};
use super::recipe::Recipe;
use super::scene::Scene;
use super::shares::Motion;
use super::stage::Placed;
use crate::models::flight::class::ObjectClass;
use crate::models::flight::distractor::{DistractorKind, tumbling_attitude};
use crate::models::flight::multirotor::{self, Airframe, MultirotorState};
use crate::models::flight::trajectory::{CompiledTrajectory, Trajectory};
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::kinematics::{GRAVITY_MPS2, los_to_az_el, wrap_pi};
use crate::models::maths::rng::Stream;
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::TAU;

/// Steps of the flight between two frames, no longer than those of the loop's clock.
const STEP_S: f64 = 1.0 / 960.0; // [s]
/// Time in which the camera's operator corrects an error [s].
const FOLLOW_S: f64 = 0.7; // [s]

/// A UAV on its way.
struct Pilot {
    plan: CompiledTrajectory,
    airframe: Airframe,
    state: MultirotorState,
    prop: usize,
}

/// A distractor on a straight way, or on a circle where it banks.
struct Drifter {
    /// Where and how it starts.
    start: Placed,
    kind: DistractorKind,
    v_enu_mps: DVec3,
    /// Rate of its turn, counter-clockwise from above [rad/s].
    turn_radps: f64,
    /// Phase of its wings, its rotors or its tumbling at the start [rad].
    phase_rad: f64,
    /// How long it has flown at the start [s].
    since_s: f64,
}

impl Drifter {
    /// One that starts as placed, at a drawn speed.
    fn new(start: Placed, kind: DistractorKind, rng: &mut Stream) -> Self {
        let forward = start.body.1 * DVec3::X;
        let drift = DVec2::from_angle(rng.range(0.0, TAU)).extend(0.0);
        let v_enu_mps = match kind.class() {
            ObjectClass::Balloon => 2.0 * drift,
            ObjectClass::Other => 2.0 * drift - 1.2 * DVec3::Z,
            ObjectClass::Bird => rng.range(7.0, 14.0) * forward,
            ObjectClass::Helicopter => rng.range(10.0, 65.0) * forward,
            _ if kind == DistractorKind::LightAircraft => rng.range(35.0, 70.0) * forward,
            _ => rng.range(70.0, 150.0) * forward,
        };
        // Lift carries weight and turn; the left wing hangs in a turn to the left.
        let sin_bank = (-(start.body.1 * DVec3::Y).z).clamp(-0.9, 0.9);
        let tan_bank = sin_bank / (1.0 - sin_bank * sin_bank).sqrt();
        let turn_radps = if kind.drifts() {
            0.0
        } else {
            GRAVITY_MPS2 * tan_bank / v_enu_mps.length()
        };
        Self {
            start,
            kind,
            v_enu_mps,
            turn_radps,
            phase_rad: rng.range(0.0, TAU),
            since_s: rng.range(0.0, 60.0),
        }
    }

    /// Where and how it is after `t_s`.
    fn at(&self, t_s: f64) -> Placed {
        let (r_enu_m, q_enu_body) = self.start.body;
        let (now_s, v) = (self.since_s + t_s, self.v_enu_mps);
        let angle_rad = self.turn_radps * t_s;
        let moved_m = if self.turn_radps.abs() < 1e-6 {
            v * t_s
        } else {
            let (sin, cos) = angle_rad.sin_cos();
            let level = DVec3::new(v.x, v.y, 0.0);
            let turned = level * sin + DVec3::Z.cross(level) * (1.0 - cos);
            turned / self.turn_radps + v.z * t_s * DVec3::Z
        };
        let q_enu_body = match self.kind {
            DistractorKind::Leaf => tumbling_attitude(now_s, self.phase_rad),
            _ => DQuat::from_rotation_z(angle_rad) * q_enu_body,
        };
        Placed {
            prop: self.start.prop,
            body: (r_enu_m + moved_m, q_enu_body),
            phase_rad: self.kind.phases_rad(now_s, self.phase_rad),
            speed_radps: self.kind.rotor_speeds_radps(),
        }
    }
}

/// A sequence in progress.
pub struct SequenceProgress {
    pilots: Vec<Pilot>,
    others: Vec<Drifter>,
    /// Azimuth and elevation of the boresight [rad].
    gaze_rad: DVec2,
    roll_rad: f64,
    /// Where the first UAV is kept in the picture [px].
    px: DVec2,
    air_density_kgpm3: f64,
    t_s: f64,
}

/// Draws a sequence of `frames` frames; `None` if the scene has no room for what was drawn.
pub fn draw(
    recipe: &Recipe,
    scene: &Scene,
    motion: Motion,
    frames: u32,
    rng: &mut Stream,
) -> Option<SequenceProgress> {
    let count = 1 + (rng.uniform() * rng.uniform() * 3.0) as usize;
    let still = draw::still(recipe, scene, count, motion, rng)?;
    let course = SequenceProgress::from(scene, &still, motion, rng)?;
    // Flown once in advance: no UAV may hit a building, and the first must stay visible.
    let duration_s = f64::from(frames) / recipe.sequences.rate_hz;
    let surface = &scene.environment.city.dsm;
    let free = course.pilots.iter().all(|pilot| {
        (0..=8).all(|k| {
            let r = pilot.plan.sample(duration_s * f64::from(k) / 8.0).r_enu_m;
            r.z > surface.surface_m(r.x, r.y) + 1.0
        })
    });
    let seen = course.pilots.first().is_some_and(|pilot| {
        (0..=4).all(|k| {
            let r = pilot.plan.sample(duration_s * f64::from(k) / 4.0).r_enu_m;
            surface.line_of_sight(scene.camera.r_enu_m, r) == LineOfSight::Clear
        })
    });
    (free && seen).then_some(course)
}

impl SequenceProgress {
    fn from(scene: &Scene, still: &Still, motion: Motion, rng: &mut Stream) -> Option<Self> {
        let pinhole = &scene.camera.pinhole;
        let density = scene.environment.air_density_kgpm3;
        let (mut pilots, mut others) = (Vec::new(), Vec::new());
        for placed in &still.placed {
            let r_enu_m = placed.body.0;
            if let Some(kind) = scene.props[placed.prop].distractor {
                others.push(Drifter::new(*placed, kind, rng));
                continue;
            }
            let uav = &scene.uavs[placed.prop];
            let range_m = r_enu_m.distance(still.pose.r_enu_m);
            // Half a picture's width a second at most.
            let width_m = f64::from(pinhole.width_px) * range_m / pinhole.focal_px;
            let speed_mps = rng.range(0.3, 1.0) * (0.5 * width_m).min(0.8 * uav.v_max_mps);
            let level = DVec2::from_angle(rng.range(0.0, TAU));
            let climb = match motion {
                Motion::ClimbDive => {
                    rng.range(0.4, 1.2) * [1.0, -1.0][(rng.uniform() * 2.0) as usize]
                }
                _ => 0.1 * rng.range(-1.0, 1.0),
            };
            let velocity_enu_mps = (speed_mps * level.extend(climb).normalize()).to_array();
            let start_enu_m = r_enu_m.to_array();
            let plan = match motion {
                Motion::Manoeuvre => Trajectory::Weave {
                    start_enu_m,
                    velocity_enu_mps,
                    lateral_acceleration_mps2: rng.range(2.0, 6.0),
                    period_s: rng.range(1.5, 4.0),
                },
                _ => Trajectory::Straight {
                    start_enu_m,
                    velocity_enu_mps,
                },
            };
            let none = |_: &str| Err(std::io::Error::other("no recorded path"));
            let plan = plan.compile(none).ok()?;
            let airframe = Airframe::new(uav);
            let mut state = plan.initial_state(&airframe, DVec3::ZERO, density);
            state.rotor_phase_rad = placed.phase_rad;
            pilots.push(Pilot {
                plan,
                airframe,
                state,
                prop: placed.prop,
            });
        }
        let gaze_rad = los_to_az_el(still.pose.q_enu_cam * DVec3::Z);
        // The roll that the boresight's own azimuth and elevation leave.
        let flat = draw::looking(scene, gaze_rad.x, gaze_rad.y, 0.0);
        let right = flat.q_enu_cam.inverse() * (still.pose.q_enu_cam * DVec3::X);
        let to_first = pilots.first()?.state.r_enu_m - still.pose.r_enu_m;
        Some(Self {
            px: pinhole.project(still.pose.q_enu_cam.inverse() * to_first)?,
            pilots,
            others,
            gaze_rad,
            roll_rad: right.y.atan2(right.x),
            air_density_kgpm3: density,
            t_s: 0.0,
        })
    }

    /// What the camera sees now.
    pub fn still(&self, scene: &Scene, motion: Motion) -> Still {
        let uavs = self.pilots.iter().map(|pilot| Placed {
            prop: pilot.prop,
            body: (pilot.state.r_enu_m, pilot.state.q_enu_body),
            phase_rad: pilot.state.rotor_phase_rad,
            speed_radps: pilot.state.rotor_speed_radps,
        });
        let others = self.others.iter().map(|other| other.at(self.t_s));
        Still {
            pose: draw::looking(scene, self.gaze_rad.x, self.gaze_rad.y, self.roll_rad),
            motion,
            placed: uavs.chain(others).collect(),
        }
    }

    /// Advances by a frame.
    pub fn advance(&mut self, scene: &Scene, frame_s: f64, rng: &mut Stream) {
        let steps = (frame_s / STEP_S).ceil();
        let dt_s = frame_s / steps;
        for k in 0..steps as u32 {
            let t_s = self.t_s + f64::from(k) * dt_s;
            for pilot in &mut self.pilots {
                let setpoint = pilot.plan.sample(t_s);
                let (airframe, state) = (&pilot.airframe, &mut pilot.state);
                let density = self.air_density_kgpm3;
                multirotor::step(airframe, state, &setpoint, DVec3::ZERO, density, dt_s);
            }
        }
        self.t_s += frame_s;
        if let Some(first) = self.pilots.first() {
            let at = los_to_az_el(first.state.r_enu_m - scene.camera.r_enu_m);
            let wanted = draw::gaze_at(scene, at, self.roll_rad, self.px);
            let share = -(-frame_s / FOLLOW_S).exp_m1();
            let error = DVec2::new(
                wrap_pi(wanted.x - self.gaze_rad.x),
                wanted.y - self.gaze_rad.y,
            );
            // An unsteady hand: a third of a pixel from frame to frame.
            let shake =
                DVec2::new(rng.normal(), rng.normal()) * 0.3 / scene.camera.pinhole.focal_px;
            self.gaze_rad += share * error + shake;
        }
    }
}
