//! What flies in a scenario.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};
use std::ops::RangeInclusive;

use super::catalogue;
use super::check::{AT_LEAST_ZERO, Check};
use super::skin::SkinKind;
use boresight_models::flight::distractor::DistractorKind;
use boresight_models::flight::swarm::Member;
use boresight_models::flight::trajectory::{Trajectory, TrajectoryError};

/// One UAV.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Uav")]
pub struct UavConfig {
    /// Name, unique in the scenario.
    pub name: String,
    /// Its name in the catalogue (`boresight models`), or the path of a file like the catalogue's, which ends
    /// in `.toml`, relative to the working directory or the program's data.
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
    /// Standard deviation of what its satellite navigation is off, east and north, up [m]: its autopilot flies to where it believes
    /// its path to be. Makers of small UAVs state ±1.5 m and ±0.5 m, taken for two deviations.
    #[serde(default = "gnss_sigma_m")]
    pub gnss_sigma_m: [f64; 2],
    /// Its place in the swarm that it belongs to.
    #[serde(skip)]
    pub member: Option<Member>,
}

/// What satellite navigation is off where nothing else is said [m].
pub fn gnss_sigma_m() -> [f64; 2] {
    [0.75, 0.25]
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
            let most_mps = uav_speed_mps(&uav.model, &uav.trajectory);
            check_flight(
                (&uav.trajectory, most_mps),
                uav.spread_m,
                uav.spread_s,
                check,
            );
            check.within("gnss_sigma_m[0]", uav.gnss_sigma_m[0], GNSS_M);
            check.within("gnss_sigma_m[1]", uav.gnss_sigma_m[1], GNSS_M);
        });
        names.push(&uav.name);
    }
    for (index, other) in distractors.iter().enumerate() {
        check.table(&format!("distractors[{index}]"), |check| {
            check.name("name", &other.name, &names);
            let flight = (&other.trajectory, Some(other.kind.v_max_mps()));
            check_flight(flight, other.spread_m, other.spread_s, check);
        });
        names.push(&other.name);
    }
}

/// More than this is no navigation [m].
pub(super) const GNSS_M: RangeInclusive<f64> = 0.0..=100.0;

/// The greatest speed of a UAV [m/s], where its path is checked against it.
fn uav_speed_mps(model: &str, trajectory: &Trajectory) -> Option<f64> {
    // A file of one's own has errors of its own, which the set-up tells.
    let waypoints = matches!(trajectory, Trajectory::Waypoints { .. });
    let uav = waypoints.then(|| catalogue::load(model).ok())??;
    Some(uav.v_max_mps)
}

fn check_flight(
    (trajectory, most_mps): (&Trajectory, Option<f64>),
    [across_m, up_m]: [f64; 2],
    spread_s: f64,
    check: &mut Check,
) {
    // A recorded flight's file is read, and checked, when the run starts.
    if !matches!(trajectory, Trajectory::Recorded { .. })
        && let Err(error) = trajectory.compile(|_| Ok(String::new()))
    {
        check.that(false, "trajectory", || match (trajectory, most_mps) {
            // To what cannot fly so fast the corners are no matter.
            (Trajectory::Waypoints { speed_mps, .. }, Some(most_mps)) if *speed_mps > most_mps => {
                too_fast(&error, *speed_mps, most_mps)
            }
            _ => error.to_string(),
        });
    }
    check.within("spread_m[0]", across_m, AT_LEAST_ZERO);
    check.within("spread_m[1]", up_m, AT_LEAST_ZERO);
    check.within("spread_s", spread_s, AT_LEAST_ZERO);
}

/// What is wrong with a path that is flown faster than what flies it can.
fn too_fast(error: &TrajectoryError, speed_mps: f64, most_mps: f64) -> String {
    let allowed_mps = match error {
        TrajectoryError::LegTooShort {
            speed_mps: allowed_mps,
            ..
        } => allowed_mps.min(most_mps),
        _ => return error.to_string(),
    };
    format!(
        "speed_mps is {speed_mps}, and this flies {most_mps:.0} m/s at most: lower it to {allowed_mps:.2}, at which the corners of \
         the path can be flown too"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_too_fast_for_its_uav_is_not_to_be_mended_by_its_corners() {
        let said = |model: &str, speed_mps: f64| {
            let trajectory = Trajectory::Waypoints {
                points_enu_m: vec![
                    [0.0, 300.0, 90.0],
                    [200.0, 300.0, 90.0],
                    [200.0, 500.0, 90.0],
                ],
                speed_mps,
                closed: false,
                corner_acceleration_mps2: 4.0,
            };
            let most_mps = uav_speed_mps(model, &trajectory);
            let mut check = Check::default();
            check_flight((&trajectory, most_mps), [0.0; 2], 0.0, &mut check);
            let problems = check.into_problems();
            problems.first().map(|problem| problem.message.clone())
        };
        let uav = catalogue::load("matrice200").unwrap();
        let fast = said("matrice200", 200.0).unwrap();
        let begins = format!(
            "speed_mps is 200, and this flies {:.0} m/s at most: lower it to ",
            uav.v_max_mps
        );
        assert!(
            fast.starts_with(&begins) && !fast.contains("acceleration"),
            "{fast}"
        );
        // The speed that is named can be flown.
        let named: f64 = (fast[begins.len()..].split(',').next())
            .unwrap()
            .parse()
            .unwrap();
        assert!(named <= uav.v_max_mps && said("matrice200", named - 0.01).is_none());
        assert!(said("matrice200", 10.0).is_none());
    }
}
