//! UAVs fly their plans, crash, and fall; distractors pass.
//!
//! Flight is integrated in f64 by [`crate::models::flight::multirotor`]. A UAV whose rotors have died is
//! handed to Rapier, which lets it tumble on to a patch of the city around it, in f32 relative
//! to the patch, and hands the motion back.

use crate::components::environment::Environment;
use crate::components::flight::{
    Air, Distractor, Flight, Guidance, HasWreck, HeatedSkin, Plan, Swarms, Uav, UavStatus, Wreck,
};
use crate::components::run::SimClock;
use crate::models::flight::multirotor::{self, MultirotorState};
use crate::models::flight::swarm::Mate;
use crate::models::ground::dsm::{Dsm, Solids};
use crate::models::maths::kinematics::exp_so3;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::prelude::*;
use bevy_rapier3d::prelude::*;
use glam::{DQuat, DVec2, DVec3};
use rstar::RTree;
use rstar::primitives::GeomWithData;

/// The schedule Rapier steps in, run from the Flight set while something falls.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Fall;

/// How often members of swarms choose their way, and UAVs in the air are looked at for collisions [Hz].
const STEER_HZ: u32 = 20;
const COLLIDE_HZ: u32 = 120;

/// A place in the air that knows whose it is.
type Placed = GeomWithData<[f64; 3], usize>;

/// Members of swarms choose their accelerations, and their points move on.
pub fn steer(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    swarms: Res<Swarms>,
    mut uavs: Query<(&Flight, &mut Guidance, &HeatedSkin, &UavStatus)>,
) {
    if swarms.0.is_empty() {
        return;
    }
    let t_s = clock.t_s();
    if clock.due(STEER_HZ) {
        let mut mates: Vec<(usize, Mate)> = Vec::new();
        let mut places: Vec<Placed> = Vec::new();
        for (flight, guidance, _, status) in &uavs {
            let steering = match &guidance.plan {
                Plan::Swarm(steering) if *status == UavStatus::Flying => steering,
                _ => continue,
            };
            places.push(Placed::new(flight.state.r_enu_m.to_array(), mates.len()));
            let mate = Mate {
                group: steering.group(),
                r_enu_m: flight.state.r_enu_m,
                v_enu_mps: flight.state.v_enu_mps,
            };
            mates.push((steering.member.swarm, mate));
        }
        let tree = RTree::bulk_load(places);
        let mut own = 0;
        for (flight, mut guidance, skin, status) in &mut uavs {
            let steering = match &mut guidance.plan {
                Plan::Swarm(steering) if *status == UavStatus::Flying => steering,
                _ => continue,
            };
            let swarm = steering.member.swarm;
            let behaviour = &swarms.0[swarm];
            let reach_m = behaviour.reach_m();
            let around = flight.state.r_enu_m.to_array();
            let mut near: Vec<usize> = (tree.locate_within_distance(around, reach_m * reach_m))
                .map(|place| place.data)
                .filter(|other| *other != own && mates[*other].0 == swarm)
                .collect();
            // The order of sums must not depend on the tree.
            near.sort_unstable();
            let near: Vec<Mate> = near.into_iter().map(|other| mates[other].1).collect();
            let surface_m = |at: DVec2| environment.city.dsm.surface_m(at.x, at.y);
            let irradiance_wpm2 = skin.irradiance_wpm2;
            let own_mate = &mates[own].1;
            steering.steer(behaviour, t_s, own_mate, &near, surface_m, irradiance_wpm2);
            own += 1;
        }
    }
    for (_, mut guidance, _, status) in &mut uavs {
        if let Plan::Swarm(steering) = &mut guidance.plan
            && *status == UavStatus::Flying
        {
            steering.advance(clock.dt_s());
        }
    }
}

/// UAVs that touch each other fall, both.
pub fn collide(
    clock: Res<SimClock>,
    mut uavs: Query<(&Uav, &Flight, &mut UavStatus), Without<Distractor>>,
) {
    if !clock.due(COLLIDE_HZ) {
        return;
    }
    // Half the longer side of the airframe, rotors included.
    let radius_m = |uav: &Uav| 0.5 * uav.size_m[0].max(uav.size_m[1]);
    let mut widest_m: f64 = 0.0;
    let mut places: Vec<Placed> = Vec::new();
    for (index, (uav, flight, status)) in uavs.iter().enumerate() {
        if *status == UavStatus::Flying {
            places.push(Placed::new(flight.state.r_enu_m.to_array(), index));
            widest_m = widest_m.max(radius_m(uav));
        }
    }
    if places.len() < 2 {
        return;
    }
    let radii_m: Vec<f64> = uavs.iter().map(|(uav, ..)| radius_m(uav)).collect();
    let tree = RTree::bulk_load(places.clone());
    let mut struck = vec![false; radii_m.len()];
    for place in &places {
        let reach_m = radii_m[place.data] + widest_m;
        for other in tree.locate_within_distance(*place.geom(), reach_m * reach_m) {
            let touch_m = radii_m[place.data] + radii_m[other.data];
            let between_m = DVec3::from(*place.geom()).distance(DVec3::from(*other.geom()));
            if other.data != place.data && between_m < touch_m {
                struck[place.data] = true;
            }
        }
    }
    for ((.., mut status), struck) in uavs.iter_mut().zip(struck) {
        if struck {
            *status = UavStatus::Struck;
        }
    }
}

/// Steps every flying UAV; one that meets the city is struck, unless it takes off or lands there.
pub fn fly(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut uavs: Query<(&Uav, &mut Flight, &mut Guidance, &Air, &mut UavStatus)>,
) {
    let (t_s, dt_s) = (clock.t_s(), clock.dt_s());
    let density = environment.air_density_kgpm3;
    let dsm = &environment.city.dsm;
    for (uav, mut flight, mut guidance, air, mut status) in &mut uavs {
        let Guidance { plan, airframe, .. } = &mut *guidance;
        let (state, wind_enu_mps) = (&mut flight.state, air.wind_enu_mps);
        if *status == UavStatus::Landed
            && let Plan::Swarm(steering) = plan
            && steering.takes_off(t_s)
        {
            // Spinning up is not modelled.
            *state = MultirotorState::trimmed(airframe, &steering.reference, wind_enu_mps, density);
            *status = UavStatus::Flying;
        }
        if *status != UavStatus::Flying {
            continue;
        }
        let setpoint = match plan {
            Plan::Path(path) => path.sample(t_s),
            Plan::Swarm(steering) => steering.reference,
        };
        let before = state.r_enu_m;
        multirotor::step(airframe, state, &setpoint, wind_enu_mps, density, dt_s);
        let r = state.r_enu_m;
        let surface_m = dsm.surface_m(r.x, r.y);
        let [length_m, width_m, height_m] = uav.size_m;
        if let Plan::Swarm(steering) = plan
            && steering.over_pad()
        {
            // On its legs; beside a wall it is struck all the same.
            let under_m = surface_m + 0.5 * height_m - r.z;
            if (0.0..1.0).contains(&under_m) {
                state.r_enu_m.z += under_m;
                state.v_enu_mps.z = state.v_enu_mps.z.max(0.0);
                if steering.lands() {
                    *status = UavStatus::Landed;
                    stand(state);
                }
                continue;
            }
        }
        if dsm.meets(before, r) {
            *status = UavStatus::Struck;
            // Rapier's surface is thin: what begins within it would fall on for ever.
            let radius_m = 0.5 * length_m.max(width_m) + CLOSE_STEP_M;
            state.r_enu_m = dsm.nearest_clear([before, r], radius_m, 0.5 * height_m);
        }
    }
}

/// Rotors and motion come to rest.
pub fn stand(state: &mut MultirotorState) {
    state.v_enu_mps = DVec3::ZERO;
    state.omega_body_radps = DVec3::ZERO;
    state.rotor_speed_radps = Default::default();
}

/// Moves birds and aircraft along their paths, and balloons and leaves with the air around them.
/// They pass through the city: nothing looks at them there.
pub fn drift(clock: Res<SimClock>, mut distractors: Query<(&mut Flight, &Distractor, &Air)>) {
    let (t_s, dt_s) = (clock.t_s(), clock.dt_s());
    for (mut flight, distractor, air) in &mut distractors {
        let state = &mut flight.state;
        let setpoint = distractor.plan.sample(t_s);
        let kind = distractor.kind;
        let pose = kind.pose(&setpoint, t_s, distractor.phase_rad);
        state.q_enu_body = pose.q_enu_body;
        state.rotor_phase_rad = kind.phases_rad(t_s, distractor.phase_rad);
        if kind.drifts() {
            state.v_enu_mps = air.wind_enu_mps + setpoint.v_enu_mps;
            state.r_enu_m += state.v_enu_mps * dt_s;
        } else {
            state.r_enu_m = pose.r_enu_m;
            state.v_enu_mps = pose.v_enu_mps;
        }
    }
}

/// Half the side of the patch of city under a fall [m]: 30 m/s of speed and 100 m of height
/// carry a wreck less far.
const PATCH_HALF_M: f64 = 160.0;
/// Spacing of the patch's heights [m], that of the city's surface raster.
const PATCH_STEP_M: f64 = 2.0;
/// The same of the patch for what is struck close to walls: its heights rise from one place to the next, and so do walls.
const CLOSE_HALF_M: f64 = 40.0;
const CLOSE_STEP_M: f64 = 0.25;
/// How close that is [m].
const CLOSE_M: f64 = 3.0;
/// Ticks to a step of Rapier: a tumbling wreck needs no more than its usual hundred or so steps a
/// second.
pub const FALL_PERIOD_TICKS: u64 = 8;
/// Below this speed [m/s] for this long [s] a wreck rests: at the top of a bounce it is slow for a moment.
const REST_MPS: f32 = 0.15;
const REST_S: f64 = 0.1;

/// Gives every UAV that began to fall its body and the ground below it.
pub fn drop_wrecks(
    mut commands: Commands,
    environment: Res<Environment>,
    uavs: Query<(Entity, &Uav, &Flight, &Guidance, &UavStatus), Without<HasWreck>>,
) {
    for (entity, uav, flight, guidance, status) in &uavs {
        if !matches!(status, UavStatus::Falling | UavStatus::Struck) {
            continue;
        }
        let state = &flight.state;
        let origin_enu_m = state.r_enu_m;
        let [length, width, height] = uav.size_m.map(|side| side as f32 / 2.0);
        let omega_enu = state.q_enu_body * state.omega_body_radps;
        let dsm = &environment.city.dsm;
        let at_wall = *status == UavStatus::Struck && !dsm.clear(origin_enu_m, CLOSE_M);
        let (half_m, step_m) = match at_wall {
            true => (CLOSE_HALF_M, CLOSE_STEP_M),
            false => (PATCH_HALF_M, PATCH_STEP_M),
        };
        let (ground, turn) = match dsm.solids() {
            Some(solids) => (triangle_patch(solids, origin_enu_m, half_m), Quat::IDENTITY),
            // Seen from east-north-up, turned by a quarter about east, so that its z runs to the south.
            None => (
                column_patch(dsm, origin_enu_m, half_m, step_m),
                Quat::from_rotation_x(std::f32::consts::FRAC_PI_2),
            ),
        };
        // Every wreck has a world of its own: all of them are centred on the same origin.
        let group = Group::from_bits_truncate(1 << (uav.index % 32));
        let alone = CollisionGroups::new(group, group);
        let patch = commands
            .spawn((
                RigidBody::Fixed,
                ground,
                Friction::coefficient(0.8),
                alone,
                Transform::from_rotation(turn),
            ))
            .id();
        commands.spawn((
            Wreck {
                uav: entity,
                origin_enu_m,
                patch,
                half_m,
                still_s: 0.0,
            },
            RigidBody::Dynamic,
            Collider::cuboid(length, width, height),
            ColliderMassProperties::Mass(guidance.mass_kg as f32),
            Friction::coefficient(0.6),
            Restitution::coefficient(0.2),
            alone,
            Velocity {
                linear: state.v_enu_mps.as_vec3(),
                angular: omega_enu.as_vec3(),
            },
            ExternalForce::default(),
            Ccd::enabled(),
            Transform::from_rotation(state.q_enu_body.as_quat()),
        ));
        commands.entity(entity).insert(HasWreck);
    }
}

/// The columns within `half_m` [m] of a place, as heights `step_m` [m] apart. Rapier's height field spans x (columns) and
/// z (rows) and rises along y.
fn column_patch(dsm: &Dsm, origin_enu_m: DVec3, half_m: f64, step_m: f64) -> Collider {
    let n = (2.0 * half_m / step_m) as usize + 1;
    let mut heights = vec![0.0; n * n];
    for column in 0..n {
        for row in 0..n {
            let e = origin_enu_m.x - half_m + column as f64 * step_m;
            let north = origin_enu_m.y + half_m - row as f64 * step_m;
            heights[column * n + row] = (dsm.surface_m(e, north) - origin_enu_m.z) as f32;
        }
    }
    let side = 2.0 * half_m as f32;
    Collider::heightfield(heights, n, n, Vec3::new(side, 1.0, side))
}

/// The triangles within `half_m` [m] of a place on the map.
fn triangle_patch(solids: &Solids, origin_enu_m: DVec3, half_m: f64) -> Collider {
    let half = DVec3::new(half_m, half_m, f64::INFINITY);
    let found = solids
        .triangles
        .in_box(origin_enu_m - half, origin_enu_m + half);
    let corners = found.iter().flat_map(|triangle| {
        let corners = solids.triangles.corners_m(*triangle);
        corners.map(|corner| (corner - origin_enu_m).as_vec3())
    });
    let corners: Vec<Vec3> = corners.collect();
    let indices = (0..corners.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]);
    let indices: Vec<[u32; 3]> = indices.collect();
    // No triangle, no ground: what falls there is lost below it.
    Collider::trimesh(corners, indices).unwrap_or_else(|_| Collider::ball(0.01))
}

/// Steps Rapier while anything falls, and once more to let go of what has come down.
pub fn fall(world: &mut World, wrecks: &mut QueryState<(), With<Wreck>>, mut falling: Local<bool>) {
    if !world
        .resource::<SimClock>()
        .tick
        .is_multiple_of(FALL_PERIOD_TICKS)
    {
        return;
    }
    let before = std::mem::replace(&mut *falling, wrecks.iter(world).next().is_some());
    if before || *falling {
        world.run_schedule(Fall);
    }
}

/// The air's drag on a wreck (eq. 6), before Rapier's step.
pub fn drag_wrecks(
    environment: Res<Environment>,
    uavs: Query<(&Guidance, &Air)>,
    mut wrecks: Query<(&Wreck, &Velocity, &mut ExternalForce)>,
) {
    for (wreck, velocity, mut force) in &mut wrecks {
        if let Ok((guidance, air)) = uavs.get(wreck.uav) {
            let v_enu_mps = velocity.linear.as_dvec3();
            let density = environment.air_density_kgpm3;
            force.force = guidance
                .airframe
                .drag_enu_n(v_enu_mps, air.wind_enu_mps, density)
                .as_vec3();
        }
    }
}

/// Hands Rapier's motion back to the truth; a wreck at rest, or off its patch, is down.
pub fn follow_wrecks(
    mut commands: Commands,
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut wrecks: Query<(Entity, &mut Wreck, &Transform, &Velocity)>,
    mut uavs: Query<(&mut Flight, &mut UavStatus)>,
) {
    for (entity, mut wreck, transform, velocity) in &mut wrecks {
        let Ok((mut flight, mut status)) = uavs.get_mut(wreck.uav) else {
            continue;
        };
        let state = &mut flight.state;
        if !clock.tick.is_multiple_of(FALL_PERIOD_TICKS) {
            state.r_enu_m += state.v_enu_mps * clock.dt_s();
            state.q_enu_body =
                (state.q_enu_body * exp_so3(state.omega_body_radps * clock.dt_s())).normalize();
            continue;
        }
        state.r_enu_m = wreck.origin_enu_m + transform.translation.as_dvec3();
        state.q_enu_body =
            DQuat::from_array(transform.rotation.to_array().map(f64::from)).normalize();
        state.v_enu_mps = velocity.linear.as_dvec3();
        state.omega_body_radps = state.q_enu_body.inverse() * velocity.angular.as_dvec3();
        // Dead rotors windmill to a stop within a second.
        let step_s = clock.at_s(FALL_PERIOD_TICKS);
        let decay = (-step_s / 0.5).exp();
        for (speed, phase) in state
            .rotor_speed_radps
            .iter_mut()
            .zip(&mut state.rotor_phase_rad)
        {
            *speed *= decay;
            *phase = (*phase + *speed * step_s).rem_euclid(std::f64::consts::TAU);
        }
        let r = state.r_enu_m;
        let dsm = &environment.city.dsm;
        let surface_m = dsm.surface_m(r.x, r.y);
        let near = r.z - surface_m < 1.0;
        let off_m = (r - wreck.origin_enu_m).truncate().abs().max_element();
        // A thin surface may let it through.
        let through = r.z < dsm.terrain_m(r.x, r.y) - 2.0;
        let lost = off_m > wreck.half_m || through;
        if through {
            state.r_enu_m.z = surface_m;
        }
        let slow = near && velocity.linear.length() < REST_MPS;
        wreck.still_s = if slow { wreck.still_s + step_s } else { 0.0 };
        if lost && *status == UavStatus::Struck && !near {
            // It falls on over the next patch.
            commands.entity(wreck.uav).remove::<HasWreck>();
            commands.entity(entity).despawn();
            commands.entity(wreck.patch).despawn();
        } else if wreck.still_s > REST_S || lost {
            *status = match *status {
                UavStatus::Struck => UavStatus::Crashed,
                _ => UavStatus::Down,
            };
            state.v_enu_mps = DVec3::ZERO;
            state.omega_body_radps = DVec3::ZERO;
            commands.entity(entity).despawn();
            commands.entity(wreck.patch).despawn();
        }
    }
}
