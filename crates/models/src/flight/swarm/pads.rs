//! Pads: how a member rises from one, and comes down on one.

use super::behaviour::{Behaviour, PLACE_S};
use super::member::{Landing, Pad, Steering};
use glam::DVec3;

/// Distance between those that share a pad [m], and that which they keep while they rise and come down.
pub const PAD_SPACING_M: f64 = 3.0;
pub(super) const PAD_SEPARATION_M: f64 = 2.0;
/// Speed of the rise from a pad, and most speed of the way down to it [m/s]; the speed of touching it.
pub const RISE_MPS: f64 = 3.0;
const SINK_MPS: f64 = 3.0;
const TOUCH_MPS: f64 = 0.4;
/// Height above pad and ground at which a member comes to its pad [m], and how near the pad's vertical it goes down [m].
const APPROACH_M: f64 = 12.0;
const OVER_PAD_M: f64 = 0.7;

impl Steering {
    /// Takes a member that waits on its pad into the air when its time has come; whether it did.
    pub fn takes_off(&mut self, t_s: f64) -> bool {
        let takes_off =
            self.pad == Pad::Waits && self.member.take_off.is_some_and(|off| t_s >= off.at_s);
        if takes_off {
            self.pad = Pad::Rises;
        }
        takes_off
    }

    /// Whether it rises from a pad or goes down to one: what it touches there carries it.
    pub fn over_pad(&self) -> bool {
        matches!(self.pad, Pad::Rises | Pad::Sinks)
    }

    /// Whether it goes down to its pad.
    pub fn lands(&self) -> bool {
        self.pad == Pad::Sinks
    }

    /// The velocity [m/s] from or to its pad; `None` on its way.
    pub(super) fn pad_way(
        &mut self,
        t_s: f64,
        behaviour: &Behaviour,
        floor_m: impl Fn() -> f64,
    ) -> Option<DVec3> {
        let r_enu_m = self.reference.r_enu_m;
        if let (Pad::Rises, Some(take_off)) = (self.pad, self.member.take_off) {
            if r_enu_m.z < take_off.to_enu_m {
                return Some(RISE_MPS * DVec3::Z);
            }
            self.pad = Pad::Free;
        }
        let landing = self.member.landing.filter(|landing| t_s >= landing.at_s)?;
        let to_pad_m = landing.pad_enu_m - r_enu_m;
        let (aside_m, off_m) = (to_pad_m.truncate(), to_pad_m.truncate().length());
        if self.pad == Pad::Free {
            self.pad = Pad::Approaches;
        }
        if self.pad == Pad::Approaches && off_m < OVER_PAD_M {
            self.pad = Pad::Sinks;
        }
        if self.pad == Pad::Sinks {
            let sink_mps = (-0.5 * to_pad_m.z).clamp(TOUCH_MPS, SINK_MPS);
            return Some(aside_m.clamp_length_max(1.5).extend(-sink_mps));
        }
        let way = aside_m.clamp_length_max(PLACE_S * behaviour.speed_mps) / PLACE_S;
        let height_m = floor_m().max(landing.pad_enu_m.z) + APPROACH_M;
        Some(way.extend((height_m - r_enu_m.z) / PLACE_S))
    }

    /// Whether it comes to its pad, where others do.
    pub(super) fn near_pad(&self) -> bool {
        let near = |landing: Landing| {
            let off_m = (landing.pad_enu_m - self.reference.r_enu_m).truncate();
            off_m.length() < 2.0 * APPROACH_M
        };
        self.pad == Pad::Approaches && self.member.landing.is_some_and(near)
    }
}
