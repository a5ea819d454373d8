//! Swarms: formations, and the velocities by which their members keep together, apart and on their way.
//!
//! Each member steers by what it wants to fly (Reynolds, *Flocks, herds and schools*, SIGGRAPH 1987, and *Steering
//! behaviors for autonomous characters*, 1999): the way to the goal, its slot or its mates' centre and course, distance
//! from its mates, the height over the ground, and away from a beam.

use crate::models::flight::multirotor::Setpoint;
use crate::models::maths::rng::Stream;
use glam::DVec3;
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

/// A UAV's place in a swarm.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// The swarm's number in the scenario.
    pub swarm: usize,
    /// Its slot in the formation (forward, left, up) [m].
    pub slot_m: DVec3,
    /// Where the middle of the formation begins [m].
    pub middle_enu_m: DVec3,
}

/// Another member, or the member itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mate {
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
}

impl Steering {
    /// A member at the start.
    pub fn new(member: Member, reference: Setpoint, rng: Stream) -> Self {
        Self {
            member,
            reference,
            rng,
            evades_until_s: f64::NEG_INFINITY,
            jink: (0.0, f64::NEG_INFINITY),
        }
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

    /// Chooses the acceleration until the next choice. `mates` are those within [`Behaviour::reach_m`], `floor_m` the highest ground ahead [m], `irradiance_wpm2` what the
    /// member's skin senses [W/m²].
    pub fn steer(
        &mut self,
        behaviour: &Behaviour,
        t_s: f64,
        mates: &[Mate],
        floor_m: f64,
        irradiance_wpm2: f64,
    ) {
        let Mate { r_enu_m, v_enu_mps } = Mate {
            r_enu_m: self.reference.r_enu_m,
            v_enu_mps: self.reference.v_enu_mps,
        };
        if irradiance_wpm2 > NOTICED_WPM2 && !behaviour.evasion.is_empty() {
            self.evades_until_s = t_s + EVADING_S;
        }
        let evades = |what: Evasion| t_s < self.evades_until_s && behaviour.evasion.contains(&what);
        let speed_mps = behaviour.speed_mps;
        let to_goal_m = behaviour.goal_enu_m - r_enu_m;
        // Slows down to a hover over the goal.
        let way = to_goal_m.normalize_or_zero() * speed_mps.min(to_goal_m.length() / PLACE_S);
        let mut wanted_mps = way;
        if behaviour.keeps_formation {
            // The middle of the formation goes its way whatever becomes of the members.
            let whole_m = behaviour.goal_enu_m - self.member.middle_enu_m;
            let gone_m = (speed_mps * t_s).min(whole_m.length());
            let middle_enu_m = self.member.middle_enu_m + gone_m * whole_m.normalize_or_zero();
            let ahead = whole_m.truncate().normalize_or(glam::DVec2::Y);
            let (forward, left) = (ahead.extend(0.0), ahead.perp().extend(0.0));
            let slot_enu_m = self.member.slot_m.x * forward
                + self.member.slot_m.y * left
                + self.member.slot_m.z * DVec3::Z;
            let off_m = middle_enu_m + slot_enu_m - r_enu_m;
            let arrives = (middle_enu_m - behaviour.goal_enu_m).length() < 1.0;
            let along = if arrives {
                DVec3::ZERO
            } else {
                way.length() * forward
            };
            wanted_mps = along.with_z(0.0) + off_m / PLACE_S;
        } else if !mates.is_empty() {
            let n = mates.len() as f64;
            let centre = mates.iter().map(|mate| mate.r_enu_m).sum::<DVec3>() / n;
            let course = mates.iter().map(|mate| mate.v_enu_mps).sum::<DVec3>() / n;
            wanted_mps += COHESION * speed_mps * (centre - r_enu_m) / behaviour.reach_m();
            wanted_mps += ALIGNMENT * (course - v_enu_mps);
        }
        let apart_m = behaviour.separation_m * if evades(Evasion::Spread) { 4.0 } else { 1.0 };
        for mate in mates {
            let from_m = r_enu_m - mate.r_enu_m;
            let near = 1.0 - from_m.length() / apart_m;
            if near > 0.0 {
                wanted_mps += speed_mps.max(3.0) * near * from_m.normalize_or(DVec3::X);
            }
        }
        if let Some(height_m) = behaviour.above_ground_m {
            let height_m = match evades(Evasion::Dive) {
                true => (0.1 * height_m).max(10.0),
                false => height_m,
            };
            wanted_mps.z = (floor_m + height_m - r_enu_m.z) / PLACE_S;
        } else if evades(Evasion::Dive) {
            let low_m = floor_m + (0.1 * (r_enu_m.z - floor_m)).max(10.0);
            wanted_mps.z = (low_m - r_enu_m.z).min(0.0) / PLACE_S;
        }
        wanted_mps.z = wanted_mps.z.clamp(-6.0, 6.0);
        // Lagging behind it may be faster than the swarm.
        let wanted_mps = wanted_mps.clamp_length_max(1.5 * speed_mps.max(4.0));
        let mut a_enu_mps2 = (wanted_mps - v_enu_mps) / TURN_S;
        if evades(Evasion::Jink) {
            if t_s >= self.jink.1 {
                let side = if self.rng.uniform() < 0.5 { -1.0 } else { 1.0 };
                self.jink = (side * JINK_MPS2, t_s + self.rng.range(0.4, JINK_S));
            }
            let left = v_enu_mps.truncate().normalize_or(glam::DVec2::Y).perp();
            a_enu_mps2 += self.jink.0 * left.extend(0.0);
        }
        self.reference.a_enu_mps2 = a_enu_mps2.clamp_length_max(MOST_MPS2);
    }
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

    /// Flies members by their reference points alone; where they are after so long [s], and how near they came [m].
    fn flown(
        behaviour: &Behaviour,
        slots: &[DVec3],
        end_s: f64,
        heated: bool,
    ) -> (Vec<DVec3>, f64) {
        let start = DVec3::new(0.0, -400.0, 80.0);
        let mut members: Vec<Steering> = (slots.iter().enumerate())
            .map(|(index, slot)| {
                // Forward is north, left is west.
                let offset = DVec3::new(-slot.y, slot.x, slot.z);
                let reference = Setpoint {
                    r_enu_m: start + offset,
                    v_enu_mps: DVec3::Y * behaviour.speed_mps,
                    a_enu_mps2: DVec3::ZERO,
                    yaw_rad: 0.0,
                };
                let rng = Stream::new(1, index as u64, "steering");
                let member = Member {
                    swarm: 0,
                    slot_m: *slot,
                    middle_enu_m: start,
                };
                Steering::new(member, reference, rng)
            })
            .collect();
        let (dt_s, mut least_m) = (0.05, f64::INFINITY);
        for step in 0..(end_s / dt_s) as usize {
            let t_s = step as f64 * dt_s;
            let all: Vec<Mate> = (members.iter())
                .map(|member| Mate {
                    r_enu_m: member.reference.r_enu_m,
                    v_enu_mps: member.reference.v_enu_mps,
                })
                .collect();
            for (index, member) in members.iter_mut().enumerate() {
                let own = all[index].r_enu_m;
                let near = |mate: &&Mate| mate.r_enu_m.distance(own) < behaviour.reach_m();
                let mates: Vec<Mate> = (all.iter().enumerate())
                    .filter(|(other, _)| *other != index)
                    .map(|(_, mate)| mate)
                    .filter(near)
                    .copied()
                    .collect();
                let irradiance = if heated { 1e6 } else { 0.0 };
                member.steer(behaviour, t_s, &mates, 0.0, irradiance);
                member.advance(dt_s);
            }
            least_m = least_m.min(nearest_m(&places(&members)));
        }
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
}
