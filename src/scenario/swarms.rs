//! Swarms: many UAVs from a few lines.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::catalogue;
use super::check::{AT_LEAST_ZERO, Check, TURN};
use super::targets::{DistractorConfig, UavConfig};
use crate::models::flight::distractor::DistractorKind;
use crate::models::flight::swarm::{Behaviour, Evasion, Formation, Member};
use crate::models::flight::trajectory::Trajectory;
use crate::models::maths::rng::Stream;
use glam::DVec3;

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
    /// Where they come from: members are shared out among these sectors, each with a formation of its own.
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
    /// Whether they keep their formation; otherwise they flock: to their mates' centre and course.
    #[serde(default = "default_keep")]
    pub keep_formation: bool,
    /// Height over the city and terrain below and ahead of them; absent: the straight way.
    pub above_ground_m: Option<f64>,
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

impl SwarmConfig {
    /// How its members fly; `asset_enu_m` [m] is where to, unless it says so itself.
    pub fn behaviour(&self, asset_enu_m: DVec3) -> Behaviour {
        Behaviour {
            goal_enu_m: self.to_enu_m.map_or(asset_enu_m, DVec3::from_array),
            speed_mps: self.speed_mps,
            separation_m: 0.7 * self.spacing_m,
            keeps_formation: self.keep_formation,
            above_ground_m: self.above_ground_m,
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
        if self.count > MOST || self.models.is_empty() || self.waves > MOST {
            return (Vec::new(), Vec::new());
        }
        let goal = DVec3::from_array(self.to_enu_m.or(asset_enu_m).unwrap_or_default());
        let groups = (self.from.len() * self.waves.max(1)).max(1);
        let all = self.count + self.decoys.len();
        let mut rng = Stream::new(seed, number as u64, "formation");
        let (mut uavs, mut decoys) = (Vec::new(), Vec::new());
        for group in 0..groups {
            let Some(from) = self.from.get(group % self.from.len().max(1)) else {
                break;
            };
            let wave = group / self.from.len();
            let azimuth_rad = from.azimuth_deg.to_radians();
            let out = DVec3::new(azimuth_rad.sin(), azimuth_rad.cos(), 0.0);
            let distance_m = from.distance_m + wave as f64 * self.wave_s * self.speed_mps;
            let middle = goal + distance_m * out + from.above_m * DVec3::Z;
            let velocity = (goal - middle).normalize_or(-out) * self.speed_mps;
            let (forward, left) = (-out, (-out).truncate().perp().extend(0.0));
            // Shared out evenly, the first groups taking what is left over.
            let count = all / groups + usize::from(group < all % groups);
            for slot in self.formation.slots_m(count, self.spacing_m, &mut rng) {
                let start = middle + slot.x * forward + slot.y * left + slot.z * DVec3::Z;
                let trajectory = Trajectory::Straight {
                    start_enu_m: start.to_array(),
                    velocity_enu_mps: velocity.to_array(),
                };
                if uavs.len() < self.count {
                    uavs.push(UavConfig {
                        name: format!("{}_{}", self.name, uavs.len() + 1),
                        model: self.models[uavs.len() % self.models.len().max(1)].clone(),
                        trajectory,
                        skin: None,
                        spread_m: [JITTER * self.spacing_m; 2],
                        spread_s: 0.0,
                        member: Some(Member {
                            swarm: number,
                            slot_m: slot,
                            middle_enu_m: middle,
                        }),
                    });
                } else if let Some(kind) = self.decoys.get(decoys.len()) {
                    decoys.push(DistractorConfig {
                        name: format!("{}_decoy_{}", self.name, decoys.len() + 1),
                        kind: *kind,
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
        check.that(!self.from.is_empty(), "from", || {
            "comes from nowhere: give at least one { azimuth_deg, distance_m }".into()
        });
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
