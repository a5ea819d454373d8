//! A UAV that is told where to fly while the run goes on: by a path, by a velocity, or rotor by rotor.
//!
//! Path and velocity move a point of limited acceleration that the autopilot follows, as the members of a swarm have
//! one. Rotor by rotor there is no autopilot here: one outside closes the loop.

use super::multirotor::{MAX_ROTORS, MultirotorState, Setpoint};
use super::swarm::MOST_MPS2;
use glam::{DVec2, DVec3};

/// Time in which the point turns to the velocity that is wanted [s], as a swarm's members do.
const TURN_S: f64 = 0.6;
/// Deceleration [m/s²] with which the point stops at the end of its path: less than it can, so that it does not overshoot.
const STOP_MPS2: f64 = 1.5;
/// Distance over speed [s] in which the point comes to rest near the end, as a swarm's members make up for their place.
const PLACE_S: f64 = 2.0;
/// Speed on the way down to the ground, and height over it below which it is touched at [`TOUCH_MPS`] [m/s], [m].
const SINK_MPS: f64 = 2.0;
const TOUCH_M: f64 = 3.0;
const TOUCH_MPS: f64 = 0.4;

/// What a UAV is told.
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// To fly to these places [m], one after the other, and to stay at the last, at a speed [m/s]. None: to stay.
    Path(Vec<DVec3>, f64),
    /// To fly at this velocity over ground [m/s] until it is told something else.
    Velocity(DVec3),
    /// To go down where it is and stand on what is there.
    Land,
    /// To drive its rotors: throttle of each, 0 to 1, the share of its fastest speed.
    Rotors([f64; MAX_ROTORS]),
}

/// A UAV that does what it is told.
#[derive(Clone, Debug, PartialEq)]
pub struct Guided {
    /// What it is told.
    pub goal: Goal,
    /// The point that its autopilot follows.
    pub reference: Setpoint,
    /// Whether it rises from where it stood: what it touches there carries it.
    pub leaves_ground: bool,
    /// How many places of its path it has passed.
    passed: usize,
}

impl Guided {
    /// A UAV that is told `goal` while it flies in `state`. It turns its nose to `heading_rad`, clockwise from north,
    /// and leaves it where it is without one.
    pub fn new(goal: Goal, state: &MultirotorState, heading_rad: Option<f64>) -> Self {
        let mut guided = Self {
            goal,
            reference: Setpoint {
                r_enu_m: state.r_enu_m,
                v_enu_mps: state.v_enu_mps,
                a_enu_mps2: DVec3::ZERO,
                yaw_rad: heading_rad.unwrap_or_else(|| state.yaw_rad()),
            },
            leaves_ground: false,
            passed: 0,
        };
        // It stays where it can stop.
        if let Goal::Path(places, speed_mps) = &mut guided.goal
            && places.is_empty()
        {
            let v_mps = state.v_enu_mps;
            *speed_mps = speed_mps.max(v_mps.length());
            places.push(state.r_enu_m + v_mps * (TURN_S + 0.5 * v_mps.length() / STOP_MPS2));
        }
        guided
    }

    /// Moves the point on by `dt_s` [s]; `surface_m` is the height [m] of what is below it.
    pub fn advance(&mut self, surface_m: f64, dt_s: f64) {
        let Setpoint {
            r_enu_m,
            v_enu_mps,
            a_enu_mps2,
            ..
        } = &mut self.reference;
        let wanted_mps = match &self.goal {
            Goal::Rotors(_) => return,
            Goal::Velocity(v_enu_mps) => *v_enu_mps,
            Goal::Land => {
                let height_m = r_enu_m.z - surface_m;
                let sink_mps = match height_m < TOUCH_M {
                    true => TOUCH_MPS,
                    false => SINK_MPS,
                };
                DVec2::ZERO.extend(-sink_mps)
            }
            Goal::Path(places, speed_mps) => {
                while self.passed + 1 < places.len()
                    && places[self.passed].distance(*r_enu_m) < speed_mps * TURN_S
                {
                    self.passed += 1;
                }
                let ahead = places.get(self.passed).copied().unwrap_or(*r_enu_m);
                let to_m = ahead - *r_enu_m;
                // What is left of the way, around its corners, is what there is to stop in.
                let corners = places.iter().skip(self.passed);
                let left_m = to_m.length()
                    + (corners.clone().zip(corners.skip(1)))
                        .map(|(from, to)| from.distance(*to))
                        .sum::<f64>();
                let stop_mps = (2.0 * STOP_MPS2 * left_m).sqrt().min(left_m / PLACE_S);
                to_m.normalize_or_zero() * speed_mps.min(stop_mps)
            }
        };
        *a_enu_mps2 = ((wanted_mps - *v_enu_mps) / TURN_S).clamp_length_max(MOST_MPS2);
        *r_enu_m += (*v_enu_mps + 0.5 * dt_s * *a_enu_mps2) * dt_s;
        *v_enu_mps += *a_enu_mps2 * dt_s;
    }

    /// Whether it is told to go down and stand.
    pub fn lands(&self) -> bool {
        self.goal == Goal::Land
    }

    /// Whether one that stands rises by what it is told.
    pub fn rises(&self) -> bool {
        match &self.goal {
            Goal::Path(..) => true,
            Goal::Velocity(v_enu_mps) => v_enu_mps.z > 0.0,
            Goal::Land | Goal::Rotors(_) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::multirotor::{Airframe, step};
    use crate::flight::uav::UavModel;

    const DT_S: f64 = 1.0 / 960.0;
    const AIR_KGPM3: f64 = 1.225;

    fn flown(goal: Goal, seconds: f64, look: impl FnMut(&MultirotorState)) -> MultirotorState {
        let airframe = Airframe::new(&UavModel::sample());
        let start = Setpoint {
            r_enu_m: DVec3::new(0.0, 0.0, 50.0),
            v_enu_mps: DVec3::ZERO,
            a_enu_mps2: DVec3::ZERO,
            yaw_rad: 0.3,
        };
        let mut look = look;
        let mut state = MultirotorState::trimmed(&airframe, &start, DVec3::ZERO, AIR_KGPM3);
        let mut guided = Guided::new(goal, &state, None);
        for _ in 0..(seconds / DT_S) as usize {
            guided.advance(0.0, DT_S);
            step(
                &airframe,
                &mut state,
                &guided.reference,
                DVec3::ZERO,
                AIR_KGPM3,
                DT_S,
            );
            look(&state);
        }
        state
    }

    #[test]
    fn a_path_is_flown_in_order_at_its_speed_and_held_at_its_end() {
        let corner = DVec3::new(40.0, 0.0, 50.0);
        let end = DVec3::new(40.0, 30.0, 60.0);
        let (mut nearest_m, mut fastest_mps) = (f64::INFINITY, 0.0_f64);
        let state = flown(Goal::Path(vec![corner, end], 8.0), 20.0, |state| {
            nearest_m = nearest_m.min(state.r_enu_m.distance(corner));
            fastest_mps = fastest_mps.max(state.v_enu_mps.length());
        });
        assert!(nearest_m < 8.0 * TURN_S, "{nearest_m} m from the corner");
        assert!((7.5..8.8).contains(&fastest_mps), "{fastest_mps} m/s");
        assert!(state.r_enu_m.distance(end) < 0.1, "{}", state.r_enu_m);
        assert!(state.v_enu_mps.length() < 0.05, "{}", state.v_enu_mps);
    }

    #[test]
    fn a_velocity_is_held_and_the_nose_stays() {
        let v_mps = DVec3::new(-3.0, 4.0, 1.0);
        let state = flown(Goal::Velocity(v_mps), 8.0, |_| {});
        assert!(state.v_enu_mps.distance(v_mps) < 0.1, "{}", state.v_enu_mps);
        assert!((state.yaw_rad() - 0.3).abs() < 0.02);
    }

    #[test]
    fn without_places_it_stays_and_to_land_it_goes_down() {
        let start = DVec3::new(0.0, 0.0, 50.0);
        let state = flown(Goal::Path(vec![], 5.0), 5.0, |_| {});
        assert!(state.r_enu_m.distance(start) < 0.1);
        let state = flown(Goal::Land, 10.0, |_| {});
        let down_m = 50.0 - state.r_enu_m.z;
        assert!((15.0..20.0).contains(&down_m), "{down_m} m down in 10 s");
    }
}
