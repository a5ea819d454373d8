//! UAVs fly their plans, crash, and fall; distractors pass.
//!
//! Flight is integrated in f64 by [`crate::models::flight::multirotor`]. A UAV whose rotors have died is
//! handed to [`crate::models::flight::fall`], which lets it tumble on to a patch of the city below it.

use crate::components::environment::Environment;
use crate::components::flight::{
    Air, Distractor, Flight, Guidance, HeatedSkin, Plan, Swarms, Uav, UavStatus, Wreck, WreckFall,
};
use crate::components::operator::{Command, Operator};
use crate::components::run::SimClock;
use crate::models::flight::fall::{self, Fall, Falling};
use crate::models::flight::guided::{Goal, Guided};
use crate::models::flight::multirotor::{self, MultirotorState, Setpoint};
use crate::models::flight::swarm::Mate;
use crate::models::maths::kinematics::exp_so3;
use crate::parameters::operator::goal;
use crate::scenario::FlyOrder;
use bevy::prelude::*;
use glam::{DVec2, DVec3};
use rstar::RTree;
use rstar::primitives::GeomWithData;

/// How often members of swarms choose their way, and UAVs in the air are looked at for collisions [Hz].
const STEER_HZ: u32 = 20;
const COLLIDE_HZ: u32 = 120;

/// A place in the air that knows whose it is.
type Placed = GeomWithData<[f64; 3], usize>;

/// UAVs that operators send somewhere in this tick leave their plans; one that cannot fly refuses.
pub fn guide(
    mut operators: Query<&mut Operator>,
    mut uavs: Query<(&Uav, &Flight, &mut Guidance, &UavStatus)>,
) {
    for mut operator in &mut operators {
        let mut refused = Vec::new();
        for command in &operator.due {
            let Command::Fly(order) = command else {
                continue;
            };
            let named = uavs.iter_mut().find(|(uav, ..)| uav.name == order.uav);
            let obeyed = match named {
                None => Err("there is no such UAV".to_owned()),
                Some((_, flight, mut guidance, status)) => {
                    take_over(order, &flight.state, &mut guidance, *status)
                }
            };
            refused.extend(obeyed.err().map(|why| (command.clone(), why)));
        }
        for (command, why) in refused {
            operator.refuse(&command, why);
        }
    }
}

/// Gives a UAV the goal of an order in place of its plan, or says why it cannot have it.
fn take_over(
    order: &FlyOrder,
    state: &MultirotorState,
    guidance: &mut Guidance,
    status: UavStatus,
) -> Result<(), String> {
    let goal = goal(order, guidance.airframe.rotor_count)?;
    let mut guided = Guided::new(goal, state, order.heading_deg.map(f64::to_radians));
    match status {
        UavStatus::Flying => {}
        UavStatus::Landed if guided.rises() => guided.leaves_ground = true,
        UavStatus::Landed => {
            return Err("it stands on the ground: give it a path, or a velocity that rises".into());
        }
        other => return Err(format!("it is {}", other.name())),
    }
    guidance.plan = Plan::Guided(Box::new(guided));
    Ok(())
}

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
        let Guidance {
            plan,
            airframe,
            navigation,
            ..
        } = &mut *guidance;
        let (state, wind_enu_mps) = (&mut flight.state, air.wind_enu_mps);
        if *status == UavStatus::Landed
            && let Some(reference) = takes_off(plan, t_s)
        {
            // Spinning up is not modelled.
            *state = MultirotorState::trimmed(airframe, &reference, wind_enu_mps, density);
            *status = UavStatus::Flying;
        }
        if *status != UavStatus::Flying {
            continue;
        }
        let before = state.r_enu_m;
        let setpoint = match plan {
            Plan::Path(path) => Ok(path.sample(t_s)),
            Plan::Swarm(steering) => Ok(steering.reference),
            Plan::Guided(guided) => {
                guided.advance(dsm.surface_m(before.x, before.y), dt_s);
                match &guided.goal {
                    Goal::Rotors(throttle) => Err(*throttle),
                    _ => Ok(guided.reference),
                }
            }
        };
        navigation.advance(dt_s);
        match setpoint {
            Ok(mut setpoint) => {
                setpoint.r_enu_m -= navigation.error_enu_m();
                multirotor::step(airframe, state, &setpoint, wind_enu_mps, density, dt_s);
            }
            Err(throttle) => {
                multirotor::step_rotors(airframe, state, &throttle, wind_enu_mps, density, dt_s);
            }
        }
        // Upside down without a rotor it does not come back.
        let is_upright = (state.q_enu_body * DVec3::Z).z > 0.0;
        if !is_upright && airframe.rotor_works.contains(&false) {
            *status = UavStatus::Falling;
            continue;
        }
        let r = state.r_enu_m;
        let surface_m = dsm.surface_m(r.x, r.y);
        let [length_m, width_m, height_m] = uav.size_m;
        let (may_touch, lands) = match plan {
            Plan::Path(_) => (false, false),
            Plan::Swarm(steering) => (steering.over_pad(), steering.lands()),
            Plan::Guided(guided) => (guided.lands() || guided.leaves_ground, guided.lands()),
        };
        if may_touch {
            // On its legs; beside a wall it is struck all the same.
            let under_m = surface_m + 0.5 * height_m - r.z;
            if under_m < -CLEAR_OF_GROUND_M
                && let Plan::Guided(guided) = plan
            {
                guided.leaves_ground = false;
            }
            if (0.0..1.0).contains(&under_m) {
                state.r_enu_m.z += under_m;
                state.v_enu_mps.z = state.v_enu_mps.z.max(0.0);
                if lands {
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

/// Height over the ground [m] above which a UAV that has risen is struck by what it touches.
const CLEAR_OF_GROUND_M: f64 = 1.0;

/// The state from which a UAV that stands takes off at `t_s` [s], if its plan says so.
fn takes_off(plan: &mut Plan, t_s: f64) -> Option<Setpoint> {
    match plan {
        Plan::Path(_) => None,
        Plan::Swarm(steering) => steering.takes_off(t_s).then_some(steering.reference),
        Plan::Guided(guided) => guided.leaves_ground.then_some(guided.reference),
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
const FALL_PERIOD_TICKS: u64 = 8;
/// Below this speed [m/s] for this long [s] a wreck rests: at the top of a bounce it is slow for a moment.
const REST_MPS: f64 = 0.15;
const REST_S: f64 = 0.1;

/// Lets every UAV go that began to fall.
pub fn drop_wrecks(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut uavs: Query<(&Uav, &Flight, &Guidance, &UavStatus, &mut Wreck)>,
) {
    for (uav, flight, guidance, status, mut wreck) in &mut uavs {
        let falls = matches!(status, UavStatus::Falling | UavStatus::Struck);
        if !falls || wreck.0.is_some() {
            continue;
        }
        let state = &flight.state;
        let origin_enu_m = state.r_enu_m;
        let dsm = &environment.city.dsm;
        let at_wall = *status == UavStatus::Struck && !dsm.clear(origin_enu_m, CLOSE_M);
        let (half_m, step_m) = match at_wall {
            true => (CLOSE_HALF_M, CLOSE_STEP_M),
            false => (PATCH_HALF_M, PATCH_STEP_M),
        };
        let city = match dsm.solids() {
            Some(solids) => fall::triangles(solids, origin_enu_m, half_m),
            None => Some(fall::columns(dsm, origin_enu_m, half_m, step_m)),
        };
        let falling = Falling {
            size_m: uav.size_m,
            mass_kg: guidance.mass_kg,
            q_enu_body: state.q_enu_body,
            v_enu_mps: state.v_enu_mps,
            omega_body_radps: state.omega_body_radps,
        };
        wreck.0 = Some(Box::new(WreckFall {
            fall: Fall::new(&falling, city, clock.at_s(FALL_PERIOD_TICKS)),
            origin_enu_m,
            half_m,
            still_s: 0.0,
        }));
    }
}

/// Moves what falls: by Rapier and the air's drag (eq. 6) in the ticks that it steps in, and on as
/// it was in those between. A wreck at rest, or off its patch, is down.
pub fn fall(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut uavs: Query<(&Guidance, &Air, &mut Flight, &mut UavStatus, &mut Wreck)>,
) {
    let (density, dsm) = (environment.air_density_kgpm3, &environment.city.dsm);
    for (guidance, air, mut flight, mut status, mut wreck) in &mut uavs {
        let state = &mut flight.state;
        let Some(WreckFall {
            fall,
            origin_enu_m,
            half_m,
            still_s,
        }) = wreck.0.as_deref_mut()
        else {
            continue;
        };
        if !clock.tick.is_multiple_of(FALL_PERIOD_TICKS) {
            state.r_enu_m += state.v_enu_mps * clock.dt_s();
            state.q_enu_body =
                (state.q_enu_body * exp_so3(state.omega_body_radps * clock.dt_s())).normalize();
            continue;
        }
        let airframe = &guidance.airframe;
        fall.step(airframe.drag_enu_n(fall.v_enu_mps(), air.wind_enu_mps, density));
        state.r_enu_m = *origin_enu_m + fall.moved_enu_m();
        state.q_enu_body = fall.q_enu_body();
        state.v_enu_mps = fall.v_enu_mps();
        state.omega_body_radps = fall.omega_body_radps();
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
        let surface_m = dsm.surface_m(r.x, r.y);
        let near = r.z - surface_m < 1.0;
        let off_m = (r - *origin_enu_m).truncate().abs().max_element();
        // A thin surface may let it through.
        let through = r.z < dsm.terrain_m(r.x, r.y) - 2.0;
        let lost = off_m > *half_m || through;
        if through {
            state.r_enu_m.z = surface_m;
        }
        let slow = near && state.v_enu_mps.length() < REST_MPS;
        *still_s = if slow { *still_s + step_s } else { 0.0 };
        if lost && *status == UavStatus::Struck && !near {
            // It falls on over the next patch.
            wreck.0 = None;
        } else if *still_s > REST_S || lost {
            *status = match *status {
                UavStatus::Struck => UavStatus::Crashed,
                _ => UavStatus::Down,
            };
            state.v_enu_mps = DVec3::ZERO;
            state.omega_body_radps = DVec3::ZERO;
            wreck.0 = None;
        }
    }
}
