//! The way to the goal: by a member's slot in the formation, or by its mates in the flock.

use super::behaviour::{Behaviour, PLACE_S};
use super::member::{Mate, Steering};
use glam::{DVec2, DVec3};

/// Share of the speed that mates' centre and course are worth in a flock.
const COHESION: f64 = 0.25;
const ALIGNMENT: f64 = 0.5;

impl Steering {
    /// The velocity [m/s] to the goal, by its slot or its mates.
    pub(super) fn way(&self, behaviour: &Behaviour, t_s: f64, mates: &[Mate]) -> DVec3 {
        let (r_enu_m, v_enu_mps) = (self.reference.r_enu_m, self.reference.v_enu_mps);
        let speed_mps = behaviour.speed_mps;
        let to_goal_m = behaviour.goal_enu_m - r_enu_m;
        // Slows down to a hover over the goal.
        let mut way = to_goal_m.normalize_or_zero() * speed_mps.min(to_goal_m.length() / PLACE_S);
        let whole_m = behaviour.goal_enu_m - self.member.middle_enu_m;
        let ahead = whole_m.truncate().normalize_or(DVec2::Y);
        let (forward, left) = (ahead.extend(0.0), ahead.perp().extend(0.0));
        if behaviour.keeps_formation {
            // The middle of the formation goes its way whatever becomes of the members.
            let flown_m = speed_mps * (t_s - self.member.begins_s).max(0.0);
            let gone_m = self
                .member
                .detour
                .map_or(flown_m, |detour| detour.along_m(flown_m));
            let gone_m = gone_m.min(whole_m.length());
            let middle_enu_m = self.member.middle_enu_m + gone_m * whole_m.normalize_or_zero();
            let slot_enu_m = self.member.slot_m.x * forward
                + self.member.slot_m.y * left
                + self.member.slot_m.z * DVec3::Z;
            let mut off_m = middle_enu_m + slot_enu_m - r_enu_m;
            let stands = flown_m == 0.0 && self.member.begins_s > 0.0;
            let arrives = (middle_enu_m - behaviour.goal_enu_m).length() < 1.0;
            let mut along = if arrives || stands {
                DVec3::ZERO
            } else {
                way.length() * forward
            };
            if let Some(detour) = self.member.detour
                && let Some((aside_m, slope)) = detour.aside(gone_m)
            {
                off_m -= aside_m * left;
                along = speed_mps * detour.pace * (forward - slope * left);
            }
            return along.with_z(0.0) + off_m / PLACE_S;
        }
        let detour = self.member.detour.and_then(|detour| {
            let along_m = whole_m.length() - to_goal_m.dot(whole_m.normalize_or_zero());
            let (_, slope) = detour.aside(along_m)?;
            Some((detour, slope))
        });
        if let Some((detour, slope)) = detour {
            let back_enu_m = self.member.middle_enu_m + detour.ends_m * whole_m.normalize_or_zero();
            let course = match slope * detour.bearing_rad >= 0.0 {
                true => forward - slope * left,
                false => (back_enu_m - r_enu_m).with_z(0.0),
            };
            // As far forward in a time as every other group.
            let speed_mps = speed_mps * detour.pace / detour.bearing_rad.cos();
            way = (speed_mps * course.normalize_or(forward)).with_z(way.z);
        }
        // While the groups are apart, each is a flock of its own.
        let flock =
            || (mates.iter()).filter(|mate| detour.is_none_or(|(of, _)| of.group == mate.group));
        let n = flock().count() as f64;
        if n > 0.0 {
            let centre = flock().map(|mate| mate.r_enu_m).sum::<DVec3>() / n;
            let course = flock().map(|mate| mate.v_enu_mps).sum::<DVec3>() / n;
            way += COHESION * speed_mps * (centre - r_enu_m) / behaviour.reach_m();
            way += ALIGNMENT * (course - v_enu_mps);
        }
        way
    }
}
