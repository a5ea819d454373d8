//! UAVs and distractors: flight, and what falls.

use crate::components::beam::Dose;
use crate::components::environment::Environment;
use crate::components::flight::{
    Air, Distractor, Flight, Guidance, HeatedSkin, Plan, Swarms, Uav, UavShape, UavStatus, Wreck,
};
use crate::components::run::{PartError, RunScenario, Seed, SetUp, Tick, TickSet};
use crate::components::track::TrackStage;
use crate::models::air::shared_gusts::SharedNoise;
use crate::models::air::wind::DrydenGust;
use crate::models::bodies::{UavMesh, distractor_mesh, drawn_distractor_mesh, uav_mesh};
use crate::models::flight::multirotor::{Airframe, MAX_ROTORS, MultirotorState, Setpoint};
use crate::models::flight::navigation::Navigation;
use crate::models::flight::swarm::{Behaviour, Mate, Member, Steering, low_course};
use crate::models::flight::trajectory::{CompiledTrajectory, Trajectory};
use crate::models::ground::dsm::Dsm;
use crate::models::maths::rng::Stream;
use crate::plugins::run::fallible;
use crate::scenario::{self, DistractorConfig, InputError, Loaded, SwarmTakeOff, catalogue};
use crate::systems::flight as systems;
use crate::systems::operator::obey;
use bevy::prelude::*;
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

/// Adds the domain to both schedules, in [`TickSet::Flight`].
pub struct FlightPlugin;

impl Plugin for FlightPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            SetUp,
            (fallible(spawn_uavs), fallible(spawn_distractors))
                .chain()
                .in_set(TickSet::Flight),
        )
        .add_systems(
            Tick,
            (
                systems::steer,
                systems::fly,
                systems::collide,
                systems::drift,
                systems::drop_wrecks,
                systems::fall,
            )
                .chain()
                .in_set(TickSet::Flight),
        )
        // What an operator orders in this tick is flown from the next on.
        .add_systems(Tick, systems::guide.in_set(TrackStage::Obey).after(obey));
    }
}

fn spawn_uavs(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    environment: Res<Environment>,
) -> Result<(), PartError> {
    let part = loaded.scenario.engage.aim;
    let asset_enu_m = (loaded.scenario.tracker.asset_enu_m)
        .unwrap_or_default()
        .into();
    let swarms = loaded.scenario.swarms.iter();
    let behaviours: Vec<Behaviour> = (swarms).map(|swarm| swarm.behaviour(asset_enu_m)).collect();
    let noise = noise_at_start(&loaded, *seed);
    for (index, uav) in loaded.scenario.uavs.iter().enumerate() {
        let place = format!("uavs[{index}]");
        let catalogued = catalogue::load(&uav.model)
            .map_err(|error| loaded.refuse(&format!("{place}.model"), error))?;
        let plan = flight_plan(&loaded, &place, &uav.trajectory)?.spread(
            uav.spread_m,
            uav.spread_s,
            &mut seed.stream(index as u64, "spread"),
        );
        let airframe = Airframe::new(&catalogued);
        let mut start = plan.sample(0.0);
        let mut member = uav.member.clone();
        if let Some(member) = &mut member {
            let take_off = loaded.scenario.swarms[member.swarm].take_off.as_ref();
            let behaviour = &behaviours[member.swarm];
            let half_m = 0.5 * catalogued.size_m[2];
            let dsm = &environment.city.dsm;
            put_down(dsm, (behaviour, take_off), half_m, member, &mut start);
        }
        let shared = noise.as_ref().filter(|_| member.is_some());
        let air = air_at(&environment, *seed, index, start.r_enu_m, shared);
        let density = environment.air_density_kgpm3;
        let mut state = plan.initial_state(&airframe, air.wind_enu_mps, density);
        state.r_enu_m = start.r_enu_m;
        let rng = seed.stream(index as u64, "gnss");
        let navigation = Navigation::new(uav.gnss_sigma_m, rng);
        if member.is_none() {
            // It has been there for a while.
            state.r_enu_m -= navigation.error_enu_m();
        }
        let waits = member
            .as_ref()
            .is_some_and(|member| member.take_off.is_some());
        if waits {
            systems::stand(&mut state);
        }
        let mesh = Arc::new(uav_mesh(&catalogued));
        let own_skin = uav.skin.map(scenario::SkinKind::skin);
        commands.spawn((
            Uav {
                index,
                name: uav.name.clone(),
                size_m: catalogued.size_m,
            },
            Flight {
                state,
                aim_body_m: mesh.part_body_m(&catalogued, part),
            },
            Guidance {
                plan: match member {
                    None => Plan::Path(plan),
                    Some(member) => {
                        let rng = seed.stream(index as u64, "steering");
                        Plan::Swarm(Box::new(Steering::new(member, start, rng)))
                    }
                },
                airframe,
                mass_kg: catalogued.mass_kg,
                navigation,
            },
            air,
            HeatedSkin::new(
                match own_skin {
                    Some(skin) => mesh.parts(&catalogued).all_of(skin),
                    None => mesh.parts(&catalogued),
                },
                own_skin.unwrap_or(catalogued.part_skin(part)).limit_k,
                // A wall's chord in the stream is about the airframe's height.
                catalogued.size_m[2],
                environment.weather.temperature_k,
            ),
            match waits {
                true => UavStatus::Landed,
                false => UavStatus::Flying,
            },
            Dose::default(),
            UavShape::new(mesh),
            Wreck::default(),
        ));
    }
    commands.insert_resource(Swarms(behaviours));
    Ok(())
}

/// The noise by which the gusts of a swarm's members start; `None` where no two share any.
fn noise_at_start(loaded: &Loaded, seed: Seed) -> Option<SharedNoise> {
    /// Leaves a correlation of a thirtieth between places that should share nothing.
    const WAVES: usize = 500;
    let uavs = loaded.scenario.uavs.iter();
    let members = uavs.filter(|uav| uav.member.is_some()).count();
    (members > 1)
        .then(|| SharedNoise::draw(WAVES, &mut seed.stream(0, "shared gusts at the start")))
}

/// Stands a member, `half_m` [m] high over its legs, on its pads; a low approach begins low.
fn put_down(
    dsm: &Dsm,
    (behaviour, pads): (&Behaviour, Option<&SwarmTakeOff>),
    half_m: f64,
    member: &mut Member,
    start: &mut Setpoint,
) {
    let surface_m = |at: DVec3| dsm.surface_m(at.x, at.y);
    if let Some(landing) = &mut member.landing {
        landing.pad_enu_m.z = surface_m(landing.pad_enu_m) + half_m;
    }
    if let (Some(take_off), Some(pads)) = (&mut member.take_off, pads) {
        start.r_enu_m.z = surface_m(start.r_enu_m) + half_m;
        take_off.to_enu_m = start.r_enu_m.z + pads.climb_m;
        let heights_m = pads.pads_en_m.iter().map(|[e, n]| dsm.surface_m(*e, *n));
        member.middle_enu_m.z = heights_m.fold(f64::NEG_INFINITY, f64::max) + pads.climb_m;
    } else if let Some(low) = behaviour.pop_up {
        let own = Mate {
            group: 0,
            r_enu_m: start.r_enu_m,
            v_enu_mps: start.v_enu_mps,
        };
        let way_mps = start.v_enu_mps.truncate();
        let surface_m = |at: DVec2| dsm.surface_m(at.x, at.y);
        start.r_enu_m.z = low_course(&own, way_mps, behaviour, surface_m).1 + low.low_m;
    }
}

/// A distractor's body, and its length, width and height [m]. An individual is the same in every run.
fn body_of(distractor: &DistractorConfig) -> (Arc<UavMesh>, [f64; 3]) {
    let kind = distractor.kind;
    let Some(variant) = distractor.variant else {
        return (Arc::new(distractor_mesh(kind)), kind.size_m());
    };
    let mut drawn = Stream::new(0, u64::from(variant), kind.name());
    let mesh = drawn_distractor_mesh(kind, &mut drawn);
    let size_m = mesh.size_m();
    (Arc::new(mesh), size_m)
}

/// Birds, balloons, aircraft and leaves: their indices come after the UAVs'.
fn spawn_distractors(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    environment: Res<Environment>,
) -> Result<(), PartError> {
    let uavs = loaded.scenario.uavs.len();
    let noise = noise_at_start(&loaded, *seed);
    for (number, distractor) in loaded.scenario.distractors.iter().enumerate() {
        let index = uavs + number;
        let place = format!("distractors[{number}]");
        let plan = flight_plan(&loaded, &place, &distractor.trajectory)?.spread(
            distractor.spread_m,
            distractor.spread_s,
            &mut seed.stream(index as u64, "spread"),
        );
        let start = plan.sample(0.0);
        let (mesh, size_m) = body_of(distractor);
        commands.spawn((
            Uav {
                index,
                name: distractor.name.clone(),
                size_m,
            },
            Flight {
                state: MultirotorState {
                    r_enu_m: start.r_enu_m,
                    v_enu_mps: start.v_enu_mps,
                    q_enu_body: DQuat::IDENTITY,
                    omega_body_radps: DVec3::ZERO,
                    rotor_speed_radps: distractor.kind.rotor_speeds_radps(),
                    rotor_phase_rad: [0.0; MAX_ROTORS],
                    drag_estimate_enu_mps2: DVec3::ZERO,
                },
                aim_body_m: mesh.centroid_body_m(),
            },
            Distractor {
                kind: distractor.kind,
                plan,
                phase_rad: seed.stream(index as u64, "wingbeat").range(0.0, TAU),
            },
            air_at(
                &environment,
                *seed,
                index,
                start.r_enu_m,
                noise.as_ref().filter(|_| distractor.decoy),
            ),
            UavStatus::Flying,
            UavShape::new(mesh),
        ));
    }
    Ok(())
}

/// The compiled trajectory of the entry at `place` of the scenario.
fn flight_plan(
    loaded: &Loaded,
    place: &str,
    trajectory: &Trajectory,
) -> Result<CompiledTrajectory, InputError> {
    let folder = loaded.path.parent().unwrap_or(Path::new("."));
    trajectory
        .compile(|name: &str| std::fs::read_to_string(folder.join(name)))
        .map_err(|error| loaded.refuse(&format!("{place}.trajectory"), error))
}

/// The air at the start of a flight, of what shares its gusts with its neighbours by `noise` or has its own.
fn air_at(
    environment: &Environment,
    seed: Seed,
    index: usize,
    r_enu_m: DVec3,
    noise: Option<&SharedNoise>,
) -> Air {
    let mut rng = seed.stream(index as u64, "gusts");
    let ground_m = environment.city.dsm.terrain_m(r_enu_m.x, r_enu_m.y);
    let height_m = r_enu_m.z - ground_m;
    let mut gusts =
        DrydenGust::new(&environment.mean_wind, &mut rng).reaching(environment.weather.gust_mps);
    if let Some(noise) = noise {
        gusts = gusts.started_together(r_enu_m, height_m, noise);
    }
    Air {
        gusts,
        rng: noise.is_none().then_some(rng),
        wind_enu_mps: environment.mean_wind.mean_wind_enu_mps(height_m),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::flight::distractor::DistractorKind;

    #[test]
    fn an_individual_is_the_same_in_every_run_and_unlike_the_next() {
        let of = |kind, variant| {
            body_of(&DistractorConfig {
                name: "it".into(),
                kind,
                variant,
                trajectory: Trajectory::Hover {
                    position_enu_m: [0.0, 100.0, 50.0],
                    heading_deg: 0.0,
                },
                spread_m: [0.0; 2],
                spread_s: 0.0,
                decoy: false,
            })
        };
        for kind in DistractorKind::ALL {
            let (standard, size_m) = of(kind, None);
            assert_eq!(size_m, kind.size_m());
            let [first, again, next] = [1, 1, 2].map(|number| of(kind, Some(number)));
            assert_eq!(first.0.body.positions, again.0.body.positions, "{kind:?}");
            for other in [&standard, &next.0] {
                assert_ne!(first.0.body.positions, other.body.positions, "{kind:?}");
            }
            let ratio = first.1[0] / size_m[0];
            assert!(
                (0.2..3.0).contains(&ratio),
                "{kind:?}: {ratio} times as long"
            );
        }
    }
}
