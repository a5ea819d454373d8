//! What flies in a scenario.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};

use super::catalogue;
use super::check::{AT_LEAST_ZERO, Check};
use super::skin::SkinKind;
use crate::models::flight::distractor::DistractorKind;
use crate::models::flight::swarm::Member;
use crate::models::flight::trajectory::Trajectory;

/// One UAV.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Uav")]
pub struct UavConfig {
    /// Name, unique in the scenario.
    pub name: String,
    /// Its name in the catalogue (`boresight models`), or the path of a file like the catalogue's, which ends
    /// in `.toml`, relative to the working directory.
    pub model: String,
    /// Where it flies.
    pub trajectory: Trajectory,
    /// Material of the part the laser heats; absent: the catalogue's.
    pub skin: Option<SkinKind>,
    /// Standard deviation of a displacement of the whole trajectory, drawn from the seed: east and
    /// north, up [m].
    #[serde(default)]
    pub spread_m: [f64; 2],
    /// The flight starts up to this much earlier, drawn from the seed.
    #[serde(default)]
    pub spread_s: f64,
    /// Its place in the swarm that it belongs to.
    #[serde(skip)]
    pub member: Option<Member>,
}

/// A bird, balloon, aircraft or leaf: every camera sees it, and it counts for no success.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Distractor")]
pub struct DistractorConfig {
    /// Name, unique among UAVs and distractors.
    pub name: String,
    /// What it is.
    pub kind: DistractorKind,
    /// Number of an individual, by which its size, shape and colours are drawn; without one they are the kind's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variant: Option<u32>,
    /// Where it flies; a balloon's or leaf's is relative to the air, so that one that hovers drifts
    /// with the wind.
    pub trajectory: Trajectory,
    /// Standard deviation of a displacement of the whole trajectory, drawn from the seed: east and
    /// north, up [m].
    #[serde(default)]
    pub spread_m: [f64; 2],
    /// The flight starts up to this much earlier, drawn from the seed.
    #[serde(default)]
    pub spread_s: f64,
    /// Whether it belongs to a swarm.
    #[serde(skip)]
    pub decoy: bool,
}

/// The UAVs that the file itself names: a swarm's follow from the swarm.
pub(super) fn named_uavs<S: Serializer>(all: &[UavConfig], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(all.iter().filter(|uav| uav.member.is_none()))
}

/// The distractors that the file itself names.
pub(super) fn named_distractors<S: Serializer>(
    all: &[DistractorConfig],
    to: S,
) -> Result<S::Ok, S::Error> {
    to.collect_seq(all.iter().filter(|other| !other.decoy))
}

/// UAVs and distractors together: names are unique among both.
pub(super) fn check(uavs: &[UavConfig], distractors: &[DistractorConfig], check: &mut Check) {
    let mut names = Vec::new();
    for (index, uav) in uavs.iter().enumerate() {
        check.table(&format!("uavs[{index}]"), |check| {
            check.name("name", &uav.name, &names);
            catalogue::check(check, "model", &uav.model);
            check_flight(&uav.trajectory, uav.spread_m, uav.spread_s, check);
        });
        names.push(&uav.name);
    }
    for (index, other) in distractors.iter().enumerate() {
        check.table(&format!("distractors[{index}]"), |check| {
            check.name("name", &other.name, &names);
            check_flight(&other.trajectory, other.spread_m, other.spread_s, check);
        });
        names.push(&other.name);
    }
}

fn check_flight(
    trajectory: &Trajectory,
    [across_m, up_m]: [f64; 2],
    spread_s: f64,
    check: &mut Check,
) {
    // A recorded flight's file is read, and checked, when the run starts.
    if !matches!(trajectory, Trajectory::Recorded { .. })
        && let Err(error) = trajectory.compile(|_| Ok(String::new()))
    {
        check.that(false, "trajectory", || error.to_string());
    }
    check.within("spread_m[0]", across_m, AT_LEAST_ZERO);
    check.within("spread_m[1]", up_m, AT_LEAST_ZERO);
    check.within("spread_s", spread_s, AT_LEAST_ZERO);
}
