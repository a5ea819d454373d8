//! Swarms: formations, and the velocities by which their members keep together, apart and on their way.
//!
//! Each member steers by what it wants to fly (Reynolds, *Flocks, herds and schools*, SIGGRAPH 1987, and *Steering
//! behaviors for autonomous characters*, 1999): the way to the goal, its slot or its mates' centre and course, distance
//! from its mates, the height over the ground, and away from a beam.

mod behaviour;
mod evasion;
mod formation;
mod low;
mod member;
mod pads;
mod way;

pub use behaviour::{Behaviour, Evasion, MOST_MPS2, PopUp};
pub use formation::Formation;
pub use low::low_course;
pub use member::{Detour, Landing, Mate, Member, Steering, TakeOff};
pub use pads::{PAD_SPACING_M, RISE_MPS};

use behaviour::{PLACE_S, TURN_S};
use glam::{DVec2, DVec3};
use low::LOW_PLACE_S;
use pads::PAD_SEPARATION_M;

/// How far ahead ground and buildings are looked at [s], and in how many places.
const AHEAD_S: f64 = 4.0;
const AHEAD_PLACES: usize = 8;

impl Steering {
    /// Chooses the acceleration until the next choice. `own` is where the member is, `mates` are those within
    /// [`Behaviour::reach_m`], `surface_m` has the height [m] of ground and roofs at a place on the map, `irradiance_wpm2`
    /// is what its skin senses [W/m²].
    pub fn steer(
        &mut self,
        behaviour: &Behaviour,
        t_s: f64,
        own: &Mate,
        mates: &[Mate],
        surface_m: impl Fn(DVec2) -> f64,
        irradiance_wpm2: f64,
    ) {
        let (r_enu_m, v_enu_mps) = (self.reference.r_enu_m, self.reference.v_enu_mps);
        let evading = self.evading(behaviour, t_s, irradiance_wpm2);
        let evades = |what: Evasion| evading && behaviour.evasion.contains(&what);
        let floor_m = || {
            let ahead = (0..=AHEAD_PLACES).map(|place| {
                let after_s = AHEAD_S * place as f64 / AHEAD_PLACES as f64;
                surface_m((own.r_enu_m + after_s * own.v_enu_mps).truncate())
            });
            ahead.fold(f64::NEG_INFINITY, f64::max)
        };
        let speed_mps = behaviour.speed_mps;
        let mut apart_m = behaviour.separation_m * if evades(Evasion::Spread) { 4.0 } else { 1.0 };
        let to_goal_m = behaviour.goal_enu_m - r_enu_m;
        let by_pad = self.pad_way(t_s, behaviour, floor_m);
        if self.over_pad() || self.near_pad() {
            apart_m = apart_m.min(PAD_SEPARATION_M);
        }
        let mut wanted_mps = by_pad.unwrap_or_else(|| self.way(behaviour, t_s, mates));
        for mate in mates {
            let from_m = r_enu_m - mate.r_enu_m;
            let near = 1.0 - from_m.length() / apart_m;
            if near > 0.0 {
                wanted_mps += speed_mps.max(3.0) * near * from_m.normalize_or(DVec3::X);
            }
        }
        let low = (behaviour.pop_up).filter(|low| to_goal_m.truncate().length() > low.at_m);
        if by_pad.is_some() {
            // It has its height.
        } else if let Some(low) = low {
            let way_mps = wanted_mps.truncate().clamp_length_max(1.2 * speed_mps);
            let (course_mps, floor_m) = low_course(own, way_mps, behaviour, &surface_m);
            wanted_mps = course_mps.extend((floor_m + low.low_m - r_enu_m.z) / LOW_PLACE_S);
        } else if let Some(height_m) = behaviour.above_ground_m {
            let height_m = match evades(Evasion::Dive) {
                true => (0.1 * height_m).max(10.0),
                false => height_m,
            };
            wanted_mps.z = (floor_m() + height_m - r_enu_m.z) / PLACE_S;
        } else if evades(Evasion::Dive) {
            let floor_m = floor_m();
            let low_m = floor_m + (0.1 * (r_enu_m.z - floor_m)).max(10.0);
            wanted_mps.z = (low_m - r_enu_m.z).min(0.0) / PLACE_S;
        } else if behaviour.pop_up.is_some() {
            // Up to the straight way, which it left low.
            let whole_m = behaviour.goal_enu_m - self.member.middle_enu_m;
            let left = to_goal_m.truncate().length() / whole_m.truncate().length().max(1.0);
            let way_m = behaviour.goal_enu_m.z - left.min(1.0) * whole_m.z;
            wanted_mps.z = (way_m + self.member.slot_m.z - r_enu_m.z) / PLACE_S;
        }
        wanted_mps.z = wanted_mps.z.clamp(-6.0, 6.0);
        // Lagging behind it may be faster than the swarm.
        let wanted_mps = wanted_mps.clamp_length_max(1.5 * speed_mps.max(4.0));
        let mut a_enu_mps2 = (wanted_mps - v_enu_mps) / TURN_S;
        if evades(Evasion::Jink) && !self.over_pad() {
            a_enu_mps2 += self.jink_mps2(t_s);
        }
        self.reference.a_enu_mps2 = a_enu_mps2.clamp_length_max(MOST_MPS2);
    }
}

#[cfg(test)]
mod tests;
