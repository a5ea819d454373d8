//! Swarms: formations, and the velocities by which their members keep together, apart and on their way.
//!
//! Each member steers by what it wants to fly (Reynolds, *Flocks, herds and schools*, SIGGRAPH 1987, and *Steering
//! behaviors for autonomous characters*, 1999): the way to the goal, its slot or its mates' centre and course, distance
//! from its mates, the height over the ground, and away from a beam.

use crate::flight::multirotor::Setpoint;
use crate::maths::rng::Stream;
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the members of a swarm stand to each other at the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Formation {
    /// Side by side.
    Line,
    /// A V, its point ahead.
    Wedge,
    /// Rows and columns.
    Grid,
    /// A circle.
    Ring,
    /// At random in a ball, no two nearer than half the spacing where there is room.
    #[default]
    Cloud,
    /// One behind the other.
    Stream,
}

impl Formation {
    /// The places of so many members (forward, left, up) [m], about their middle.
    pub fn slots_m(self, count: usize, spacing_m: f64, rng: &mut Stream) -> Vec<DVec3> {
        let side = (count as f64).sqrt().ceil().max(1.0) as usize;
        let mut slots: Vec<DVec3> = Vec::with_capacity(count);
        for index in 0..count {
            let n = index as f64;
            slots.push(match self {
                Self::Line => DVec3::Y * n,
                Self::Stream => DVec3::NEG_X * n,
                Self::Wedge => {
                    let (arm, left) = (index.div_ceil(2) as f64, index % 2 == 0);
                    DVec3::new(-arm, if left { arm } else { -arm }, 0.0)
                }
                Self::Grid => DVec3::new(-((index / side) as f64), (index % side) as f64, 0.0),
                Self::Ring => {
                    let angle = n / count as f64 * std::f64::consts::TAU;
                    // Neighbours on the circle are one spacing apart.
                    let radius = 0.5 / (std::f64::consts::PI / count.max(2) as f64).sin();
                    radius * DVec3::new(angle.cos(), angle.sin(), 0.0)
                }
                Self::Cloud => in_ball(&slots, count, rng),
            });
        }
        let middle = slots.iter().sum::<DVec3>() / count.max(1) as f64;
        slots
            .iter()
            .map(|slot| spacing_m * (slot - middle))
            .collect()
    }
}

/// A place in a ball that has room for `count` members one spacing apart, in spacings.
fn in_ball(taken: &[DVec3], count: usize, rng: &mut Stream) -> DVec3 {
    const TRIES: usize = 30;
    let radius = 0.7 * (count as f64).cbrt();
    let mut at = DVec3::ZERO;
    for _ in 0..TRIES {
        let direction = rng.normal3().normalize_or(DVec3::X);
        at = radius * rng.uniform().cbrt() * direction;
        if taken.iter().all(|other| other.distance(at) > 0.5) {
            break;
        }
    }
    at
}

/// What a UAV does while a beam heats it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Evasion {
    /// Pulls to one side and the other.
    Jink,
    /// Goes down to a tenth of its height, 10 m at least.
    Dive,
    /// Goes away from its mates, to four times the distance.
    Spread,
}

/// A low approach behind buildings, and the rise at its end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PopUp {
    /// Distance from the goal, on the map, at which a member rises [m].
    pub at_m: f64,
    /// Height over what is below until then [m]. A flock also goes where it is lowest, around high buildings.
    #[serde(default = "default_low_m")]
    pub low_m: f64,
}

fn default_low_m() -> f64 {
    6.0 // [m]
}

/// How the members of a swarm fly.
#[derive(Clone, Debug, PartialEq)]
pub struct Behaviour {
    /// Where it flies to [m].
    pub goal_enu_m: DVec3,
    /// Its speed [m/s].
    pub speed_mps: f64,
    /// Distance that members keep from each other [m].
    pub separation_m: f64,
    /// Whether they keep their slots; otherwise they flock.
    pub keeps_formation: bool,
    /// Height over what is below and ahead [m]; `None` keeps to the straight way.
    pub above_ground_m: Option<f64>,
    /// How it approaches low; `None` does not.
    pub pop_up: Option<PopUp>,
    /// What they do in a beam.
    pub evasion: Vec<Evasion>,
}

/// Most acceleration of a member [m/s²]: a multirotor leans by 30° for it.
pub const MOST_MPS2: f64 = 5.5;
/// Acceleration of a jink [m/s²], and the longest time to one side [s].
const JINK_MPS2: f64 = 5.0;
const JINK_S: f64 = 1.2;
/// How long a member goes on evading after the beam has left it [s].
const EVADING_S: f64 = 2.0;
/// Irradiance that a UAV notices [W/m²]: ten suns.
const NOTICED_WPM2: f64 = 1e4;
/// Time in which a member turns to the velocity that it wants [s], and makes up for an error of its place [s].
const TURN_S: f64 = 0.6;
const PLACE_S: f64 = 2.0;
/// Share of the speed that mates' centre and course are worth in a flock.
const COHESION: f64 = 0.25;
const ALIGNMENT: f64 = 0.5;

/// How far ahead ground and buildings are looked at [s], and in how many places.
const AHEAD_S: f64 = 4.0;
const AHEAD_PLACES: usize = 8;
/// On a low approach: how far ahead [s], in steps of at most [s] and [m], and how far to each side [m].
const LOW_AHEAD_S: f64 = 10.0;
const LOW_STEP_S: f64 = 0.4;
const LOW_STEP_M: f64 = 5.0;
const LOW_ASIDE_M: f64 = 3.0;
/// The climb that it counts on [m/s], the time until it has begun [s], and that in which it makes up for an error of height [s].
const LOW_CLIMB_MPS: f64 = 4.0;
const LOW_LEAD_S: f64 = 1.5;
const LOW_PLACE_S: f64 = 0.8;
/// How far below the floor it stops [m].
const LOW_STOP_M: f64 = 8.0;
/// Courses that it compares, off its way [deg], and how much lower the ground must be for each degree [m].
const LOW_COURSES_DEG: [f64; 7] = [0.0, -15.0, 15.0, -30.0, 30.0, -45.0, 45.0];
const LOW_COURSE_MPDEG: f64 = 0.2;
/// Distance between those that share a pad [m], and that which they keep while they rise and come down.
pub const PAD_SPACING_M: f64 = 3.0;
const PAD_SEPARATION_M: f64 = 2.0;
/// Speed of the rise from a pad, and most speed of the way down to it [m/s]; the speed of touching it.
pub const RISE_MPS: f64 = 3.0;
const SINK_MPS: f64 = 3.0;
const TOUCH_MPS: f64 = 0.4;
/// Height above pad and ground at which a member comes to its pad [m], and how near the pad's vertical it goes down [m].
const APPROACH_M: f64 = 12.0;
const OVER_PAD_M: f64 = 0.7;

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
    fn along_m(&self, flown_m: f64) -> f64 {
        let slow_m = (self.ends_m - self.begins_m) / self.pace;
        match flown_m - self.begins_m {
            before if before <= 0.0 => flown_m,
            within if within < slow_m => self.begins_m + self.pace * within,
            after => self.ends_m + after - slow_m,
        }
    }

    /// Distance to the right of the straight way [m], and its slope, so far along it [m]; `None` before and after.
    fn aside(&self, along_m: f64) -> Option<(f64, f64)> {
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
    evades_until_s: f64,
    /// Sideways acceleration of the present jink [m/s²], and until when [s].
    jink: (f64, f64),
    /// What it has to do with a pad.
    pad: Pad,
}

/// What a member has to do with a pad.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pad {
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
        if irradiance_wpm2 > NOTICED_WPM2 && !behaviour.evasion.is_empty() {
            self.evades_until_s = t_s + EVADING_S;
        }
        let evading = t_s < self.evades_until_s;
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
            if t_s >= self.jink.1 {
                let side = if self.rng.uniform() < 0.5 { -1.0 } else { 1.0 };
                self.jink = (side * JINK_MPS2, t_s + self.rng.range(0.4, JINK_S));
            }
            let left = v_enu_mps.truncate().normalize_or(DVec2::Y).perp();
            a_enu_mps2 += self.jink.0 * left.extend(0.0);
        }
        self.reference.a_enu_mps2 = a_enu_mps2.clamp_length_max(MOST_MPS2);
    }

    /// The velocity [m/s] to the goal, by its slot or its mates.
    fn way(&self, behaviour: &Behaviour, t_s: f64, mates: &[Mate]) -> DVec3 {
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

    /// The velocity [m/s] from or to its pad; `None` on its way.
    fn pad_way(
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
    fn near_pad(&self) -> bool {
        let near = |landing: Landing| {
            let off_m = (landing.pad_enu_m - self.reference.r_enu_m).truncate();
            off_m.length() < 2.0 * APPROACH_M
        };
        self.pad == Pad::Approaches && self.member.landing.is_some_and(near)
    }
}

/// Velocity [m/s] and floor [m] of a low approach that would fly at `wanted_mps` [m/s]: the floor is what the ground asks for
/// now, so that a climb clears all of it on the way there. Of some courses beside the wanted one, each with the turn to it,
/// a flock takes that of the least floor (Fox, Burgard and Thrun, *The dynamic window approach to collision avoidance*,
/// 1997); a formation keeps its own.
pub fn low_course(
    own: &Mate,
    wanted_mps: DVec2,
    behaviour: &Behaviour,
    surface_m: impl Fn(DVec2) -> f64,
) -> (DVec2, f64) {
    let fastest_mps = wanted_mps.length().max(own.v_enu_mps.truncate().length());
    let step_s = LOW_STEP_M / fastest_mps.max(LOW_STEP_M / LOW_STEP_S);
    let floor_m = |course_mps: DVec2| {
        let (mut r_m, mut v_mps) = (own.r_enu_m.truncate(), own.v_enu_mps.truncate());
        let mut floor_m = f64::NEG_INFINITY;
        for step in 0..=(LOW_AHEAD_S / step_s) as usize {
            let aside_m = LOW_ASIDE_M * v_mps.perp().normalize_or_zero();
            let highest_m = [r_m, r_m - aside_m, r_m + aside_m].map(&surface_m);
            let highest_m = highest_m.into_iter().fold(f64::NEG_INFINITY, f64::max);
            let climb_m = LOW_CLIMB_MPS * (step_s * step as f64 - LOW_LEAD_S).max(0.0);
            floor_m = floor_m.max(highest_m - climb_m);
            let a_mps2 = ((course_mps - v_mps) / TURN_S).clamp_length_max(MOST_MPS2);
            v_mps += (a_mps2 * step_s).clamp_length_max((course_mps - v_mps).length());
            r_m += v_mps * step_s;
        }
        floor_m
    };
    let courses = match behaviour.keeps_formation {
        true => &LOW_COURSES_DEG[..1],
        false => &LOW_COURSES_DEG,
    };
    let (mut least_m, mut best) = (f64::INFINITY, (wanted_mps, f64::NEG_INFINITY));
    for bearing_deg in courses {
        let course_mps = DVec2::from_angle(-bearing_deg.to_radians()).rotate(wanted_mps);
        let floor_m = floor_m(course_mps);
        let cost_m = floor_m + LOW_COURSE_MPDEG * bearing_deg.abs();
        if cost_m < least_m {
            (least_m, best) = (cost_m, (course_mps, floor_m));
        }
    }
    // What is too low for what comes slows down.
    let (course_mps, floor_m) = best;
    let slow = (1.0 - (floor_m - own.r_enu_m.z) / LOW_STOP_M).clamp(0.05, 1.0);
    (slow * course_mps, floor_m)
}

impl Behaviour {
    /// How far a member looks for mates [m].
    pub fn reach_m(&self) -> f64 {
        4.0 * self.separation_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Formation; 6] = [
        Formation::Line,
        Formation::Wedge,
        Formation::Grid,
        Formation::Ring,
        Formation::Cloud,
        Formation::Stream,
    ];

    fn nearest_m(places: &[DVec3]) -> f64 {
        let mut least = f64::INFINITY;
        for (index, a) in places.iter().enumerate() {
            for b in &places[index + 1..] {
                least = least.min(a.distance(*b));
            }
        }
        least
    }

    #[test]
    fn formations_have_their_spacing() {
        for formation in ALL {
            let mut rng = Stream::new(1, 0, "formation");
            let slots = formation.slots_m(40, 8.0, &mut rng);
            assert_eq!(slots.len(), 40);
            let middle = slots.iter().sum::<DVec3>() / 40.0;
            assert!(middle.length() < 1e-9, "{formation:?}");
            let least = if formation == Formation::Cloud {
                4.0
            } else {
                8.0
            };
            let nearest_m = nearest_m(&slots);
            assert!(nearest_m > least - 0.02, "{formation:?}: {nearest_m} m");
        }
        let one = Formation::Wedge.slots_m(1, 8.0, &mut Stream::new(1, 0, "formation"));
        assert_eq!(one, [DVec3::ZERO]);
    }

    fn member(middle_enu_m: DVec3) -> Member {
        Member {
            swarm: 0,
            slot_m: DVec3::ZERO,
            middle_enu_m,
            begins_s: 0.0,
            detour: None,
            take_off: None,
            landing: None,
        }
    }

    /// Members in their slots 400 m south of the goal; forward is north, left is west.
    fn swarm(behaviour: &Behaviour, slots: &[DVec3]) -> Vec<Steering> {
        let start = DVec3::new(0.0, -400.0, 80.0);
        let begin = |(index, slot): (usize, &DVec3)| {
            let reference = Setpoint {
                r_enu_m: start + DVec3::new(-slot.y, slot.x, slot.z),
                v_enu_mps: DVec3::Y * behaviour.speed_mps,
                a_enu_mps2: DVec3::ZERO,
                yaw_rad: 0.0,
            };
            let member = Member {
                slot_m: *slot,
                ..member(start)
            };
            Steering::new(member, reference, Stream::new(1, index as u64, "steering"))
        };
        slots.iter().enumerate().map(begin).collect()
    }

    const STEP_S: f64 = 0.05; // [s]

    /// Flies members by their reference points alone between two times [s].
    fn fly(
        members: &mut [Steering],
        behaviour: &Behaviour,
        [from_s, end_s]: [f64; 2],
        surface_m: impl Fn(DVec2) -> f64,
        irradiance_wpm2: f64,
        mut look: impl FnMut(&[Steering]),
    ) {
        let steps = |t_s: f64| (t_s / STEP_S).round() as usize;
        for step in steps(from_s)..steps(end_s) {
            let t_s = step as f64 * STEP_S;
            let all: Vec<Mate> = (members.iter())
                .map(|member| Mate {
                    group: member.group(),
                    r_enu_m: member.reference.r_enu_m,
                    v_enu_mps: member.reference.v_enu_mps,
                })
                .collect();
            for (index, member) in members.iter_mut().enumerate() {
                let own = all[index];
                let near = |mate: &Mate| mate.r_enu_m.distance(own.r_enu_m) < behaviour.reach_m();
                let others = all.iter().enumerate().filter(|(other, _)| *other != index);
                let mates: Vec<Mate> = others.map(|(_, mate)| *mate).filter(near).collect();
                member.takes_off(t_s);
                member.steer(behaviour, t_s, &own, &mates, &surface_m, irradiance_wpm2);
                member.advance(STEP_S);
            }
            look(members);
        }
    }

    /// Where members are after so long [s], and how near they came [m].
    fn flown(
        behaviour: &Behaviour,
        slots: &[DVec3],
        end_s: f64,
        heated: bool,
    ) -> (Vec<DVec3>, f64) {
        let mut members = swarm(behaviour, slots);
        let irradiance_wpm2 = if heated { 1e6 } else { 0.0 };
        let mut least_m = f64::INFINITY;
        let look = |members: &[Steering]| least_m = least_m.min(nearest_m(&places(members)));
        fly(
            &mut members,
            behaviour,
            [0.0, end_s],
            |_| 0.0,
            irradiance_wpm2,
            look,
        );
        (places(&members), least_m)
    }

    fn places(members: &[Steering]) -> Vec<DVec3> {
        members
            .iter()
            .map(|member| member.reference.r_enu_m)
            .collect()
    }

    fn behaviour() -> Behaviour {
        Behaviour {
            goal_enu_m: DVec3::new(0.0, 0.0, 80.0),
            speed_mps: 12.0,
            separation_m: 6.0,
            keeps_formation: true,
            above_ground_m: None,
            pop_up: None,
            evasion: Vec::new(),
        }
    }

    #[test]
    fn a_formation_arrives_as_it_left() {
        let behaviour = behaviour();
        let slots = Formation::Wedge.slots_m(15, 10.0, &mut Stream::new(1, 0, "formation"));
        let (places, least_m) = flown(&behaviour, &slots, 60.0, false);
        assert!(least_m > 9.0, "{least_m} m");
        let centre = places.iter().sum::<DVec3>() / 15.0;
        assert!((centre - behaviour.goal_enu_m).length() < 2.0, "{centre}");
    }

    #[test]
    fn a_flock_keeps_apart_and_arrives() {
        let flock = Behaviour {
            keeps_formation: false,
            ..behaviour()
        };
        let slots = Formation::Cloud.slots_m(30, 8.0, &mut Stream::new(1, 0, "formation"));
        let (places, least_m) = flown(&flock, &slots, 60.0, false);
        assert!(least_m > 1.5, "{least_m} m");
        let centre = places.iter().sum::<DVec3>() / 30.0;
        assert!((centre - flock.goal_enu_m).length() < 10.0, "{centre}");
    }

    #[test]
    fn heights_follow_the_ground_and_a_beam_is_evaded() {
        let low = Behaviour {
            above_ground_m: Some(30.0),
            ..behaviour()
        };
        let slots = Formation::Line.slots_m(3, 10.0, &mut Stream::new(1, 0, "formation"));
        let (places, _) = flown(&low, &slots, 20.0, false);
        assert!(
            places.iter().all(|place| (place.z - 30.0).abs() < 1.0),
            "{places:?}"
        );
        let straight = flown(&behaviour(), &slots, 8.0, true).0;
        for evasion in [Evasion::Jink, Evasion::Dive, Evasion::Spread] {
            let evading = Behaviour {
                evasion: vec![evasion],
                ..behaviour()
            };
            let (places, _) = flown(&evading, &slots, 8.0, true);
            let most_m = places.iter().zip(&straight).map(|(a, b)| a.distance(*b));
            let most_m = most_m.fold(0.0, f64::max);
            assert!(most_m > 1.0, "{evasion:?}: {most_m} m");
        }
    }

    #[test]
    fn groups_part_and_meet_again() {
        let slots = Formation::Line.slots_m(9, 8.0, &mut Stream::new(1, 0, "formation"));
        for keeps_formation in [true, false] {
            let behaviour = Behaviour {
                keeps_formation,
                ..behaviour()
            };
            let mut members = swarm(&behaviour, &slots);
            for (index, member) in members.iter_mut().enumerate() {
                // The line's first is its rightmost.
                let group = 2 - index / 3;
                member.member.detour = Some(Detour {
                    group,
                    bearing_rad: [-40.0, 0.0, 40.0_f64][group].to_radians(),
                    begins_m: 50.0,
                    ends_m: 300.0,
                    pace: 40.0_f64.to_radians().cos(),
                });
            }
            let centres = |members: &[Steering]| {
                [0, 1, 2].map(|group| {
                    let of = (members.iter()).filter(|member| member.group() == group);
                    of.map(|member| member.reference.r_enu_m).sum::<DVec3>() / 3.0
                })
            };
            // Halfway of the detour: 50 m at 12 m/s, 125 m at 9.2 m/s.
            fly(&mut members, &behaviour, [0.0, 17.8], |_| 0.0, 0.0, |_| ());
            let [left, middle, right] = centres(&members);
            let aside_m = 125.0 * 40.0_f64.to_radians().tan();
            for (centre, wanted_m) in [(left, -aside_m), (middle, 0.0), (right, aside_m)] {
                let line_m = if wanted_m == 0.0 {
                    0.0
                } else {
                    24.0 * wanted_m.signum()
                };
                let off_m = centre.x - wanted_m - line_m;
                assert!(
                    off_m.abs() < 15.0,
                    "{keeps_formation}: {centre}, {wanted_m} m"
                );
                assert!((centre.y - middle.y).abs() < 10.0, "{centre} {middle}");
            }
            // 300 m after 31 s, the goal 100 m on.
            fly(&mut members, &behaviour, [17.8, 34.0], |_| 0.0, 0.0, |_| ());
            let [left, middle, right] = centres(&members);
            for centre in [left, right] {
                let off_m = (centre - middle).length();
                assert!(off_m < 35.0, "{keeps_formation}: {centre} {middle}");
            }
            fly(&mut members, &behaviour, [34.0, 60.0], |_| 0.0, 0.0, |_| ());
            let centre = places(&members).iter().sum::<DVec3>() / 9.0;
            assert!((centre - behaviour.goal_enu_m).length() < 6.0, "{centre}");
        }
    }

    #[test]
    fn a_low_approach_goes_around_towers_and_over_rows_and_then_up() {
        let low = Behaviour {
            keeps_formation: false,
            pop_up: Some(PopUp {
                at_m: 100.0,
                low_m: 6.0,
            }),
            ..behaviour()
        };
        // A tower in the way, then a row of houses across it.
        let surface_m = |at: DVec2| match (at.x.abs(), at.y) {
            (east_m, north_m) if east_m < 15.0 && (-300.0..-270.0).contains(&north_m) => 70.0,
            (_, north_m) if (-200.0..-185.0).contains(&north_m) => 20.0,
            _ => 0.0,
        };
        let mut members = swarm(&low, &[DVec3::ZERO]);
        members[0].reference.r_enu_m.z = 6.0;
        let (mut highest_m, mut least_m) = (0.0_f64, f64::INFINITY);
        let look = |members: &[Steering]| {
            let r_m = members[0].reference.r_enu_m;
            least_m = least_m.min(r_m.z - surface_m(r_m.truncate()));
            if r_m.truncate().length() > 105.0 {
                highest_m = highest_m.max(r_m.z);
            }
        };
        fly(&mut members, &low, [0.0, 60.0], surface_m, 0.0, look);
        assert!(least_m > 2.0, "{least_m} m over the ground");
        assert!((22.0..32.0).contains(&highest_m), "{highest_m} m");
        let place = members[0].reference.r_enu_m;
        assert!((place - low.goal_enu_m).length() < 4.0, "{place}");
    }

    #[test]
    fn members_rise_from_their_pads_and_come_down_on_them() {
        let behaviour = Behaviour {
            above_ground_m: Some(30.0),
            ..behaviour()
        };
        let slots = Formation::Line.slots_m(3, 10.0, &mut Stream::new(1, 0, "formation"));
        let mut members = swarm(&behaviour, &slots);
        for (index, member) in members.iter_mut().enumerate() {
            member.reference.r_enu_m = DVec3::new(3.0 * index as f64, -400.0, 0.1);
            member.reference.v_enu_mps = DVec3::ZERO;
            member.pad = Pad::Waits;
            member.member.begins_s = 10.0;
            member.member.take_off = Some(TakeOff {
                at_s: 0.0,
                to_enu_m: 20.0,
            });
            member.member.landing = Some(Landing {
                at_s: 60.0,
                pad_enu_m: DVec3::new(3.0 * index as f64, 0.0, 0.1),
            });
        }
        let over_pads = |members: &[Steering]| members.iter().all(Steering::over_pad);
        fly(
            &mut members,
            &behaviour,
            [0.0, 5.0],
            |_| 0.0,
            0.0,
            |members| {
                assert!(over_pads(members));
            },
        );
        assert!(places(&members).iter().all(|place| place.z > 8.0));
        fly(&mut members, &behaviour, [5.0, 60.0], |_| 0.0, 0.0, |_| ());
        for (place, slot) in places(&members).iter().zip(&slots) {
            assert!(
                (place.x + slot.y).abs() < 2.0 && place.y.abs() < 2.0,
                "{place}"
            );
            assert!((place.z - 30.0).abs() < 1.0, "{place}");
        }
        // The ground would carry them once they touch it.
        let mut touched = [false; 3];
        fly(
            &mut members,
            &behaviour,
            [60.0, 90.0],
            |_| 0.0,
            0.0,
            |members| {
                for (touched, member) in touched.iter_mut().zip(members) {
                    let (r_m, pad) = (
                        member.reference.r_enu_m,
                        member.member.landing.unwrap().pad_enu_m,
                    );
                    if r_m.z < pad.z && !*touched {
                        assert!(
                            member.lands() && (r_m - pad).truncate().length() < 0.7,
                            "{r_m}"
                        );
                        let sink_mps = -member.reference.v_enu_mps.z;
                        assert!((0.2..0.7).contains(&sink_mps), "{sink_mps} m/s");
                        *touched = true;
                    }
                }
            },
        );
        assert_eq!(touched, [true; 3]);
    }
}
