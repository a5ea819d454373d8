//! A member of a swarm: its place there, and the point that its autopilot follows.

use crate::flight::multirotor::Setpoint;
use crate::maths::rng::Stream;
use glam::DVec3;

/// A way aside of one group of a swarm that splits, and back again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detour {
    /// Number of the group.
    pub group: usize,
    /// Bearing off the straight way, to the right positive [rad].
    pub bearing_rad: f64,
    /// How far along the straight way it begins and ends [m].
    pub begins_m: f64,
    /// See above.
    pub ends_m: f64,
    /// Speed along the straight way meanwhile, over the swarm's [-]: that of the group that goes farthest aside.
    pub pace: f64,
}

impl Detour {
    /// How far along the straight way it is when without a detour it would be `flown_m` [m] along.
    pub(super) fn along_m(&self, flown_m: f64) -> f64 {
        let slow_m = (self.ends_m - self.begins_m) / self.pace;
        match flown_m - self.begins_m {
            before if before <= 0.0 => flown_m,
            within if within < slow_m => self.begins_m + self.pace * within,
            after => self.ends_m + after - slow_m,
        }
    }

    /// Distance to the right of the straight way [m], and its slope, so far along it [m]; `None` before and after.
    pub(super) fn aside(&self, along_m: f64) -> Option<(f64, f64)> {
        let slope = self.bearing_rad.tan();
        let (out_m, back_m) = (along_m - self.begins_m, self.ends_m - along_m);
        if out_m <= 0.0 || back_m <= 0.0 {
            return None;
        }
        Some(match out_m < back_m {
            true => (slope * out_m, slope),
            false => (slope * back_m, -slope),
        })
    }
}

/// When a member takes off from its pad, and how high it rises before it goes its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakeOff {
    /// When [s].
    pub at_s: f64,
    /// To which height [m].
    pub to_enu_m: f64,
}

/// When a member leaves for its pad, and where it lands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    /// When [s].
    pub at_s: f64,
    /// Where it stands then [m].
    pub pad_enu_m: DVec3,
}

/// A UAV's place in a swarm.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// The swarm's number in the scenario.
    pub swarm: usize,
    /// Its slot in the formation (forward, left, up) [m].
    pub slot_m: DVec3,
    /// Where the middle of the formation begins [m].
    pub middle_enu_m: DVec3,
    /// When it begins [s].
    pub begins_s: f64,
    /// Its group's way aside.
    pub detour: Option<Detour>,
    /// Its take-off, where it begins on a pad.
    pub take_off: Option<TakeOff>,
    /// Its landing.
    pub landing: Option<Landing>,
}

/// Another member, or the member itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mate {
    /// Its group.
    pub group: usize,
    /// Place [m].
    pub r_enu_m: DVec3,
    /// Velocity [m/s].
    pub v_enu_mps: DVec3,
}

/// How a member is steered: a point with limited acceleration that its autopilot follows.
#[derive(Clone, Debug)]
pub struct Steering {
    /// Its place in the swarm.
    pub member: Member,
    /// The point.
    pub reference: Setpoint,
    /// Stream of its evasions.
    pub rng: Stream,
    /// Until when it evades [s].
    pub(super) evades_until_s: f64,
    /// Sideways acceleration of the present jink [m/s²], and until when [s].
    pub(super) jink: (f64, f64),
    /// What it has to do with a pad.
    pub(super) pad: Pad,
}

/// What a member has to do with a pad.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pad {
    /// It stands there until it takes off.
    Waits,
    /// It rises.
    Rises,
    /// Nothing.
    Free,
    /// It flies to its pad.
    Approaches,
    /// It goes down to it.
    Sinks,
}

impl Steering {
    /// A member at the start.
    pub fn new(member: Member, reference: Setpoint, rng: Stream) -> Self {
        let pad = match member.take_off {
            Some(_) => Pad::Waits,
            None => Pad::Free,
        };
        Self {
            member,
            reference,
            rng,
            evades_until_s: f64::NEG_INFINITY,
            jink: (0.0, f64::NEG_INFINITY),
            pad,
        }
    }

    /// Number of its group among its swarm's.
    pub fn group(&self) -> usize {
        self.member.detour.map_or(0, |detour| detour.group)
    }

    /// Moves the point on by a tick [s].
    pub fn advance(&mut self, dt_s: f64) {
        let Setpoint {
            r_enu_m,
            v_enu_mps,
            a_enu_mps2,
            yaw_rad,
        } = &mut self.reference;
        *r_enu_m += (*v_enu_mps + 0.5 * dt_s * *a_enu_mps2) * dt_s;
        *v_enu_mps += *a_enu_mps2 * dt_s;
        if v_enu_mps.truncate().length() > 1.0 {
            *yaw_rad = v_enu_mps.x.atan2(v_enu_mps.y);
        }
    }
}
