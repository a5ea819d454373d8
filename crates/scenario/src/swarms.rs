//! Swarms: many UAVs from a few lines.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::catalogue;
use super::check::{AT_LEAST_ZERO, Check, TURN};
use super::targets::{DistractorConfig, GNSS_M, UavConfig};
use boresight_models::flight::distractor::DistractorKind;
use boresight_models::flight::swarm::{
    Behaviour, Detour, Evasion, Formation, Landing, Member, PAD_SPACING_M, PopUp, RISE_MPS, TakeOff,
};
use boresight_models::flight::trajectory::Trajectory;
use boresight_models::maths::rng::Stream;
use glam::{DVec2, DVec3};

/// A swarm. Its members are UAVs like those of `[[uavs]]`, after them, named after the swarm and numbered from 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Swarm")]
pub struct SwarmConfig {
    /// Its name.
    pub name: String,
    /// Number of its members.
    pub count: usize,
    /// Their models, taken in turn: one that is named twice is twice as frequent.
    pub models: Vec<String>,
    /// How they stand to each other at the start.
    #[serde(default)]
    pub formation: Formation,
    /// Distance between neighbours at the start, which they also keep from each other.
    #[serde(default = "default_spacing_m")]
    pub spacing_m: f64,
    /// Where they come from: members are shared out among these sectors, each with a formation of its own. Left out
    /// with `take_off`.
    #[serde(default)]
    pub from: Vec<SwarmOrigin>,
    /// Waves one behind the other.
    #[serde(default = "default_waves")]
    pub waves: usize,
    /// Time between them.
    #[serde(default = "default_wave_s")]
    pub wave_s: f64,
    /// Where they fly to; absent: `tracker.asset_enu_m`.
    pub to_enu_m: Option<[f64; 3]>,
    /// Their speed.
    #[serde(default = "default_speed_mps")]
    pub speed_mps: f64,
    /// Standard deviation of what each member's navigation is off, east and north, up [m]. Chosen: members of a swarm correct
    /// theirs by a common reference.
    #[serde(default = "default_gnss_sigma_m")]
    pub gnss_sigma_m: [f64; 2],
    /// Whether they keep their formation; otherwise they flock: to their mates' centre and course.
    #[serde(default = "default_keep")]
    pub keep_formation: bool,
    /// Height over the city and terrain below and ahead of them; absent: the straight way.
    pub above_ground_m: Option<f64>,
    /// A low approach that ends with a rise; absent: none. After it they fly as without it: at `above_ground_m`, or on the straight way.
    pub pop_up: Option<PopUp>,
    /// How they part into groups and come together again; absent: they stay together.
    pub split: Option<SwarmSplit>,
    /// Pads that they take off from, one after the other; absent: they begin in the air.
    pub take_off: Option<SwarmTakeOff>,
    /// Pads that they land on in the end; absent: they hover at the goal.
    pub land: Option<SwarmLanding>,
    /// What they do while a beam heats them: several things at once, or nothing.
    #[serde(default)]
    pub evasion: Vec<Evasion>,
    /// Things among them that are no UAVs and fly straight.
    #[serde(default)]
    pub decoys: Vec<DistractorKind>,
}

/// Where a swarm comes from, seen from where it goes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SwarmOrigin {
    /// Azimuth, clockwise from north.
    pub azimuth_deg: f64,
    /// Distance on the map.
    pub distance_m: f64,
    /// Height above the goal.
    #[serde(default)]
    pub above_m: f64,
}

/// How a swarm parts into groups, shared out from left to right, which fly apart and meet again on the straight way: between two
/// distances from the goal, or between two times.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SwarmSplit {
    /// Bearing of each group off the straight way, to the right positive.
    pub bearings_deg: Vec<f64>,
    /// Distance from the goal at which they part.
    pub at_m: Option<f64>,
    /// Distance from the goal at which they are together again; absent: only there.
    pub rejoin_m: Option<f64>,
    /// When they part, in place of `at_m`.
    pub at_s: Option<f64>,
    /// When they are together again, in place of `rejoin_m`.
    pub rejoin_s: Option<f64>,
}

/// How a swarm takes off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SwarmTakeOff {
    /// The pads: east and north, on the ground or on a roof. Members take them in turn; those that share one stand 3 m apart.
    pub pads_en_m: Vec<[f64; 2]>,
    /// Time from one take-off to the next on the same pad.
    #[serde(default = "default_every_s")]
    pub every_s: f64,
    /// Height above the pad to which a member rises straight up.
    #[serde(default = "default_climb_m")]
    pub climb_m: f64,
}

/// How a swarm lands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SwarmLanding {
    /// The pads, as those of `take_off`.
    pub pads_en_m: Vec<[f64; 2]>,
    /// When members leave for them; until then they fly to the goal.
    #[serde(default)]
    pub at_s: f64,
}

fn default_every_s() -> f64 {
    2.0 // [s]
}

fn default_climb_m() -> f64 {
    20.0 // [m]
}

fn default_gnss_sigma_m() -> [f64; 2] {
    [0.1, 0.1]
}

fn default_spacing_m() -> f64 {
    10.0 // [m]
}

fn default_speed_mps() -> f64 {
    12.0 // [m/s]
}

fn default_waves() -> usize {
    1
}

fn default_wave_s() -> f64 {
    10.0 // [s]
}

fn default_keep() -> bool {
    true
}

/// Standard deviation of a member's place at the start, in spacings, drawn from the run's seed.
const JITTER: f64 = 0.05;
/// Most members of a swarm.
const MOST: usize = 5_000;
/// Most groups that one splits into, and the farthest that they go aside [deg].
const MOST_GROUPS: usize = 20;
const MOST_ASIDE_DEG: f64 = 75.0;

/// Where on the pads a number of members stand [m, enu], at height 0.
fn on_pads(pads_en_m: &[[f64; 2]], count: usize, rng: &mut Stream) -> Vec<DVec3> {
    let each = count.div_ceil(pads_en_m.len().max(1));
    let around = Formation::Grid.slots_m(each, PAD_SPACING_M, rng);
    let place = |index: usize| {
        let [e_m, n_m] = pads_en_m[index % pads_en_m.len()];
        around[index / pads_en_m.len()] + DVec3::new(e_m, n_m, 0.0)
    };
    (0..count).map(place).collect()
}

impl SwarmSplit {
    /// The way aside of the member that is `rank`th of `count` from the left, on a straight way of `whole_m` [m].
    fn detour(&self, [rank, count]: [usize; 2], whole_m: f64, speed_mps: f64) -> Detour {
        let mut bearings_rad: Vec<f64> = self.bearings_deg.iter().map(|b| b.to_radians()).collect();
        bearings_rad.sort_by(f64::total_cmp);
        let group = rank * bearings_rad.len() / count.max(1);
        let paces = bearings_rad.iter().map(|bearing_rad| bearing_rad.cos());
        let pace = paces.fold(1.0, f64::min);
        let [begins_m, ends_m] = match self.at_s {
            Some(at_s) => {
                let begins_m = speed_mps * at_s;
                let lasts_s = self.rejoin_s.map(|rejoin_s| rejoin_s - at_s);
                let ends_m = lasts_s.map(|lasts_s| begins_m + pace * speed_mps * lasts_s);
                [begins_m, ends_m.unwrap_or(whole_m)]
            }
            None => [self.at_m, self.rejoin_m].map(|left_m| whole_m - left_m.unwrap_or(0.0)),
        };
        Detour {
            group,
            bearing_rad: bearings_rad.get(group).copied().unwrap_or(0.0),
            begins_m: begins_m.max(0.0).min(whole_m),
            ends_m: ends_m.max(0.0).min(whole_m),
            pace,
        }
    }

    fn check(&self, check: &mut Check) {
        let groups = self.bearings_deg.len();
        check.that((2..=MOST_GROUPS).contains(&groups), "bearings_deg", || {
            format!("found {groups}, give from 2 to {MOST_GROUPS}, one for each group")
        });
        for (index, bearing_deg) in self.bearings_deg.iter().enumerate() {
            let aside = -MOST_ASIDE_DEG..=MOST_ASIDE_DEG;
            check.within(&format!("bearings_deg[{index}]"), *bearing_deg, aside);
        }
        let by_distance = self.at_m.is_some() && self.at_s.is_none() && self.rejoin_s.is_none();
        let by_time = self.at_s.is_some() && self.at_m.is_none() && self.rejoin_m.is_none();
        check.that(by_distance || by_time, "", || {
            "give at_m, with or without rejoin_m, or at_s, with or without rejoin_s".into()
        });
        for (key, value) in [
            ("at_m", self.at_m),
            ("rejoin_m", self.rejoin_m),
            ("at_s", self.at_s),
            ("rejoin_s", self.rejoin_s),
        ] {
            check.maybe_within(key, value, AT_LEAST_ZERO);
        }
        if let (Some(at_m), Some(rejoin_m)) = (self.at_m, self.rejoin_m) {
            check.that(rejoin_m < at_m, "rejoin_m", || {
                format!("found {rejoin_m}, must be below at_m = {at_m}")
            });
        }
        if let (Some(at_s), Some(rejoin_s)) = (self.at_s, self.rejoin_s) {
            check.that(rejoin_s > at_s, "rejoin_s", || {
                format!("found {rejoin_s}, must be above at_s = {at_s}")
            });
        }
    }
}

fn check_pads(pads_en_m: &[[f64; 2]], check: &mut Check) {
    check.that(!pads_en_m.is_empty(), "pads_en_m", || {
        "names no pad: give at least one [east, north]".into()
    });
    for (index, pad) in pads_en_m.iter().enumerate() {
        for (axis, value) in pad.iter().enumerate() {
            let key = format!("pads_en_m[{index}][{axis}]");
            check.within(&key, *value, -20_000.0..=20_000.0);
        }
    }
}

impl SwarmConfig {
    /// How its members fly; `asset_enu_m` [m] is where to, unless it says so itself.
    pub fn behaviour(&self, asset_enu_m: DVec3) -> Behaviour {
        Behaviour {
            goal_enu_m: self.to_enu_m.map_or(asset_enu_m, DVec3::from_array),
            speed_mps: self.speed_mps,
            separation_m: 0.7 * self.spacing_m,
            keeps_formation: self.keep_formation,
            above_ground_m: self.above_ground_m,
            pop_up: self.pop_up,
            evasion: self.evasion.clone(),
        }
    }

    /// Its UAVs and decoys; the formation's chances come from `seed`.
    pub(super) fn members(
        &self,
        number: usize,
        asset_enu_m: Option<[f64; 3]>,
        seed: u64,
    ) -> (Vec<UavConfig>, Vec<DistractorConfig>) {
        // What the check refuses makes no members.
        let no_pad = self
            .take_off
            .as_ref()
            .is_some_and(|off| off.pads_en_m.is_empty())
            || self
                .land
                .as_ref()
                .is_some_and(|land| land.pads_en_m.is_empty());
        if self.count > MOST || self.models.is_empty() || self.waves > MOST || no_pad {
            return (Vec::new(), Vec::new());
        }
        let goal = DVec3::from_array(self.to_enu_m.or(asset_enu_m).unwrap_or_default());
        let origins = self.origins(goal);
        let groups = origins.len();
        let all = self.count + self.decoys.len();
        let mut rng = Stream::new(seed, number as u64, "formation");
        let (mut uavs, mut decoys) = (Vec::new(), Vec::new());
        let pads = |pads_en_m: &[[f64; 2]]| {
            on_pads(
                pads_en_m,
                self.count,
                &mut Stream::new(seed, number as u64, "pads"),
            )
        };
        let from = self
            .take_off
            .as_ref()
            .map(|off| (off, pads(&off.pads_en_m)));
        let to = self.land.as_ref().map(|land| (land, pads(&land.pads_en_m)));
        for (group, (middle, out)) in origins.into_iter().enumerate() {
            let velocity = (goal - middle).normalize_or(-out) * self.speed_mps;
            let (forward, left) = (-out, (-out).truncate().perp().extend(0.0));
            // Shared out evenly, the first groups taking what is left over.
            let count = all / groups + usize::from(group < all % groups);
            let slots = self.formation.slots_m(count, self.spacing_m, &mut rng);
            let mut leftmost: Vec<usize> = (0..count).collect();
            leftmost.sort_by(|a, b| slots[*b].y.total_cmp(&slots[*a].y));
            let mut ranks = vec![0; count];
            for (rank, slot) in leftmost.into_iter().enumerate() {
                ranks[slot] = rank;
            }
            for (slot, rank) in slots.into_iter().zip(ranks) {
                let start = middle + slot.x * forward + slot.y * left + slot.z * DVec3::Z;
                let trajectory = Trajectory::Straight {
                    start_enu_m: start.to_array(),
                    velocity_enu_mps: velocity.to_array(),
                };
                let index = uavs.len();
                if index < self.count {
                    let whole_m = (goal - middle).length();
                    let mut uav = UavConfig {
                        name: format!("{}_{}", self.name, index + 1),
                        model: self.models[index % self.models.len().max(1)].clone(),
                        trajectory,
                        skin: None,
                        spread_m: [JITTER * self.spacing_m; 2],
                        spread_s: 0.0,
                        gnss_sigma_m: self.gnss_sigma_m,
                        member: None,
                    };
                    let mut member = Member {
                        swarm: number,
                        slot_m: slot,
                        middle_enu_m: middle,
                        begins_s: 0.0,
                        detour: (self.split.as_ref())
                            .map(|split| split.detour([rank, count], whole_m, self.speed_mps)),
                        take_off: None,
                        // The heights of pads come with the city.
                        landing: to.as_ref().map(|(land, places)| Landing {
                            at_s: land.at_s,
                            pad_enu_m: places[index],
                        }),
                    };
                    if let Some((off, places)) = &from {
                        let at_s =
                            |index: usize| (index / off.pads_en_m.len()) as f64 * off.every_s;
                        member.take_off = Some(TakeOff {
                            at_s: at_s(index),
                            to_enu_m: 0.0,
                        });
                        // The formation waits for the last.
                        member.begins_s = at_s(self.count - 1) + off.climb_m / RISE_MPS;
                        uav.trajectory = Trajectory::Straight {
                            start_enu_m: places[index].to_array(),
                            velocity_enu_mps: [0.0; 3],
                        };
                        uav.spread_m = [0.0; 2];
                    }
                    uav.member = Some(member);
                    uavs.push(uav);
                } else if let Some(kind) = self.decoys.get(decoys.len()) {
                    decoys.push(DistractorConfig {
                        name: format!("{}_decoy_{}", self.name, decoys.len() + 1),
                        kind: *kind,
                        variant: None,
                        trajectory,
                        spread_m: [0.0; 2],
                        spread_s: 0.0,
                        decoy: true,
                    });
                }
            }
        }
        (uavs, decoys)
    }

    /// Middle of each formation at the start [m], and the direction from the goal to it on the map: of each wave from each sector, or
    /// of the one over the pads.
    fn origins(&self, goal: DVec3) -> Vec<(DVec3, DVec3)> {
        if let Some(off) = &self.take_off {
            let sum: DVec2 = off
                .pads_en_m
                .iter()
                .map(|pad| DVec2::from_array(*pad))
                .sum();
            let middle = (sum / off.pads_en_m.len().max(1) as f64).extend(goal.z);
            return vec![(middle, (middle - goal).normalize_or(DVec3::NEG_Y))];
        }
        let waves =
            (0..self.waves.max(1)).flat_map(|wave| self.from.iter().map(move |from| (wave, from)));
        let origin = |(wave, from): (usize, &SwarmOrigin)| {
            let azimuth_rad = from.azimuth_deg.to_radians();
            let out = DVec3::new(azimuth_rad.sin(), azimuth_rad.cos(), 0.0);
            let distance_m = from.distance_m + wave as f64 * self.wave_s * self.speed_mps;
            (goal + distance_m * out + from.above_m * DVec3::Z, out)
        };
        waves.map(origin).collect()
    }

    pub(super) fn check(&self, check: &mut Check, asset: bool) {
        check.that((1..=MOST).contains(&self.count), "count", || {
            format!("found {}, must be from 1 to {MOST}", self.count)
        });
        check.that(!self.models.is_empty(), "models", || {
            "names no model: give at least one".into()
        });
        for (index, model) in self.models.iter().enumerate() {
            catalogue::check(check, &format!("models[{index}]"), model);
        }
        check.within("spacing_m", self.spacing_m, 0.5..=1_000.0);
        check.within("gnss_sigma_m[0]", self.gnss_sigma_m[0], GNSS_M);
        check.within("gnss_sigma_m[1]", self.gnss_sigma_m[1], GNSS_M);
        check.that(
            !self.from.is_empty() || self.take_off.is_some(),
            "from",
            || {
                "comes from nowhere: give at least one { azimuth_deg, distance_m }, or take_off"
                    .into()
            },
        );
        if let Some(off) = &self.take_off {
            check.table("take_off", |check| {
                check_pads(&off.pads_en_m, check);
                check.within("every_s", off.every_s, AT_LEAST_ZERO);
                check.within("climb_m", off.climb_m, 2.0..=500.0);
            });
            let once = self.from.is_empty() && self.waves == 1 && self.decoys.is_empty();
            check.that(once, "take_off", || {
                "takes off from its pads: leave from, waves and decoys out".into()
            });
        }
        if let Some(land) = &self.land {
            check.table("land", |check| {
                check_pads(&land.pads_en_m, check);
                check.within("at_s", land.at_s, AT_LEAST_ZERO);
            });
        }
        if let Some(split) = &self.split {
            check.table("split", |check| split.check(check));
        }
        if let Some(low) = &self.pop_up {
            check.table("pop_up", |check| {
                check.within("at_m", low.at_m, AT_LEAST_ZERO);
                check.within("low_m", low.low_m, 3.0..=200.0);
            });
        }
        for (index, from) in self.from.iter().enumerate() {
            check.table(&format!("from[{index}]"), |check| {
                check.within("azimuth_deg", from.azimuth_deg, TURN);
                check.within("distance_m", from.distance_m, 1.0..=20_000.0);
                check.within("above_m", from.above_m, -1_000.0..=5_000.0);
            });
        }
        check.that((1..=100).contains(&self.waves), "waves", || {
            format!("found {}, must be from 1 to 100", self.waves)
        });
        check.within("wave_s", self.wave_s, AT_LEAST_ZERO);
        check.within("speed_mps", self.speed_mps, 0.5..=60.0);
        if let Some(above_m) = self.above_ground_m {
            check.within("above_ground_m", above_m, 2.0..=2_000.0);
        }
        check.that(asset || self.to_enu_m.is_some(), "to_enu_m", || {
            "flies nowhere: give it, or tracker.asset_enu_m".into()
        });
    }
}
