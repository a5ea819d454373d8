//! The laser beam crosses the air, heats what it meets, and what is lost by that has its effect.

use crate::components::beam::{BeamPath, BeamSeeing, BeamState, Dose, FireCommand, LaserSource};
use crate::components::environment::Environment;
use crate::components::flight::{
    Air, Distractor, Flight, Guidance, HeatedSkin, Uav, UavShape, UavStatus,
};
use crate::components::mount::Optics;
use crate::components::run::{Failure, PartError, SimClock};
use crate::models::air::atmosphere::transmittance;
use crate::models::air::turbulence::{AirPath, PathTurbulence};
use crate::models::ground::dsm::LineOfSight;
use crate::models::laser::beam::{BUCKET_RADIUS_M, BloomingAir, Laser, irradiance_wpm2};
use crate::models::laser::propagation::{Across, BeamAir, Sent};
use crate::models::laser::target::{Effect, FAILS_RADIUS_M, Falls, Film, Patch};
use crate::models::maths::kinematics::Pose;
use crate::models::optics::seeing::{Lens, Look, Ripples};
use bevy::prelude::*;
use boresight_wave::even_layers;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// A UAV further off the beam's axis than this takes no part in it [rad].
const AIM_CONE_RAD: f64 = 5e-3;
/// How often the path's turbulence is integrated anew [Hz]: within a tenth of a second a UAV moves by
/// metres, a hundredth of the path.
const PATH_HZ: u32 = 10;
/// How often the turbulence's turn of the beam is worked out [Hz]: in between a wind of 10 m/s takes the air by centimetres.
const WANDER_HZ: u32 = 240;
/// Share of the aerosol's extinction that heats the air: urban aerosol of single-scattering albedo 0.9.
const ABSORBED_SHARE: f64 = 0.1;
/// Layers of a path: each of them scintillates weakly over a kilometre of an ordinary day.
const LAYERS: usize = 10;
/// How often heat is conducted, and a beam that has left its grid is followed to another place [Hz]: between two steps
/// heat spreads by less than a tenth of a millimetre through plastics.
const HEAT_HZ: u32 = 30;
/// Beyond so many 1/e² radii a beam warms nothing.
const SPOT_ENDS: f64 = 2.25;
/// Grids on a UAV at most; the coldest gives way.
const MOST_PATCHES: usize = 6;
/// An unmarked grid this close to the air's temperature is let go [K].
const COLD_K: f64 = 0.5;
/// Least transverse air speed on the path [m/s]: natural convection stirs still air.
const LEAST_CROSSWIND_MPS: f64 = 0.3;

/// The UAV that the beam is followed to.
struct Aimed {
    /// Its scenario index.
    index: usize,
    /// Angle between its aim point and the beam's axis [rad].
    angle_rad: f64,
    /// Its aim point in the laser's axes [m].
    r_cam_m: DVec3,
    /// Wind there [m/s].
    wind_enu_mps: DVec3,
    /// Its own velocity [m/s].
    v_enu_mps: DVec3,
}

impl Aimed {
    /// Velocity of the air over the beam at a share of the way [m/s], right and down of it: there the beam moves sideways with
    /// that share of its target's velocity.
    fn v_air_mps(&self, laser: &Pose, share: f64) -> DVec2 {
        let v_enu_mps = self.wind_enu_mps - share * self.v_enu_mps;
        (laser.q_enu_cam.inverse() * v_enu_mps).truncate()
    }
}

/// What arrives at the aimed UAV's range.
struct Arriving {
    /// What lies across the beam.
    across: Across,
    /// Where the beam's axis passes there by jitter [m], right and down of the optics'.
    jitter_m: DVec2,
    /// Range [m].
    range_m: f64,
}

/// UAVs as the beam meets them.
type Targets = (
    &'static Uav,
    &'static Flight,
    &'static UavShape,
    &'static Air,
    &'static UavStatus,
    &'static mut HeatedSkin,
    &'static mut Dose,
);

/// Propagates the beam along the optics' axis and finds what it does to each UAV.
pub fn propagate(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut stations: Query<(&Optics, &mut LaserSource, &FireCommand, &mut BeamState)>,
    mut uavs: Query<Targets>,
    mut failure: ResMut<Failure>,
) {
    for (.., mut skin, _) in &mut uavs {
        skin.irradiance_wpm2 = 0.0;
    }
    for (optics, mut source, command, mut beam) in &mut stations {
        let dt_s = clock.dt_s();
        *beam = BeamState {
            firing: command.fire,
            energy_j: beam.energy_j,
            dwell_s: beam.dwell_s,
            distractor_s: beam.distractor_s,
            ..default()
        };
        let aimed = aimed(&optics.laser, &uavs);
        if let Some(aimed) = &aimed {
            let laser = &optics.laser;
            let crossed = cross_air(
                &clock,
                &environment,
                laser,
                &mut source,
                command,
                aimed,
                &mut beam,
            );
            let arriving = match crossed {
                Ok(arriving) => arriving,
                Err(error) => return failure.set(error),
            };
            if command.fire {
                light(
                    &clock,
                    &environment,
                    laser,
                    &source.laser,
                    (aimed, &arriving),
                    &mut beam,
                    &mut uavs,
                );
            }
        }
        if command.fire {
            beam.energy_j += source.laser.power_w * dt_s;
        }
    }
}

/// The UAV whose aim point lies closest to the axis, if any lies near it.
fn aimed(laser: &Pose, uavs: &Query<Targets>) -> Option<Aimed> {
    let q_cam_enu = laser.q_enu_cam.inverse();
    let mut aimed: Option<Aimed> = None;
    for (uav, flight, _, air, status, ..) in uavs {
        let r_cam_m = q_cam_enu * (flight.aim_enu_m() - laser.r_enu_m);
        let angle_rad = r_cam_m.truncate().length() / r_cam_m.z;
        let best = aimed
            .as_ref()
            .is_none_or(|least| angle_rad < least.angle_rad);
        if *status == UavStatus::Flying && r_cam_m.z > 0.0 && angle_rad < AIM_CONE_RAD && best {
            aimed = Some(Aimed {
                index: uav.index,
                angle_rad,
                r_cam_m,
                wind_enu_mps: air.wind_enu_mps,
                v_enu_mps: flight.state.v_enu_mps,
            });
        }
    }
    aimed
}

/// Takes the beam through the air to the aimed UAV's range.
fn cross_air(
    clock: &SimClock,
    environment: &Environment,
    laser: &Pose,
    source: &mut LaserSource,
    command: &FireCommand,
    aimed: &Aimed,
    beam: &mut BeamState,
) -> Result<Arriving, PartError> {
    let range_m = aimed.r_cam_m.length();
    let is_kept =
        matches!(&source.path, Some(path) if path.index == aimed.index) && !clock.due(PATH_HZ);
    if !is_kept {
        source.path = Some(path_to(source, environment, laser, aimed));
    }
    if let Some(seeing) = &mut source.seeing {
        turn(seeing, clock, environment, laser, range_m, !is_kept);
    }
    let LaserSource {
        laser: constants,
        propagation,
        path: Some(path),
        focus_m,
        jitter_rng,
        jitter_rad,
        seeing,
        ..
    } = source
    else {
        return Err("the beam has no path".into());
    };
    let followed_m = (command.focus_range_m > 0.0).then_some(command.focus_range_m);
    let sent = Sent {
        laser: constants,
        fires: command.fire,
        range_m,
        focus_m: focus_m.or(followed_m).unwrap_or(f64::INFINITY),
        air: &path.air,
        is_new: !is_kept,
        dt_s: clock.dt_s(),
        turned: seeing.as_ref().map(|seeing| seeing.turned),
    };
    let across = propagation.cross(&sent)?;
    let jitter_m = range_m * *jitter_rad * DVec2::new(jitter_rng.normal(), jitter_rng.normal());
    beam.aimed = Some(aimed.index);
    beam.transmittance = transmittance(path.air.warmed.extinction_per_m, range_m);
    beam.scintillation = across.relative;
    beam.spot_radius_m = across.radius_m();
    beam.offset_m = (aimed.r_cam_m.truncate() - across.centre_m - jitter_m).length();
    Ok(Arriving {
        across,
        jitter_m,
        range_m,
    })
}

/// Finds where the turbulence that the cameras look through turns the beam. By reciprocity that is against the shift of the
/// image: light sent towards where a point seems to be meets it.
fn turn(
    seeing: &mut BeamSeeing,
    clock: &SimClock,
    environment: &Environment,
    laser: &Pose,
    range_m: f64,
    is_new: bool,
) {
    if !is_new && !clock.due(WANDER_HZ) {
        return;
    }
    let ahead_enu = laser.q_enu_cam * DVec3::Z;
    if is_new || seeing.ripples.is_none() {
        let axes_enu = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| laser.q_enu_cam * axis);
        let look = Look {
            axes_enu,
            t_s: clock.t_s(),
            exposure_s: 0.0,
            winds_enu_mps: environment.winds(laser.r_enu_m, &seeing.air),
            seen_enu_mps: DVec3::ZERO,
        };
        let sight = environment.sight(laser.r_enu_m, ahead_enu, range_m);
        let ripples = Ripples::new(&seeing.air, &sight, &seeing.pupil, &look, &Lens::ANGLES);
        seeing.ripples = Some((ripples, look));
    }
    let Some((ripples, look)) = &seeing.ripples else {
        return;
    };
    let [right, down, ahead] = look.axes_enu.map(|axis| axis.dot(ahead_enu));
    let shift_rad = ripples.later(DVec2::new(right, down) / ahead, clock.t_s() - look.t_s);
    let variance_rad2 = ripples.variance_px2();
    // No turbulence, no wander.
    seeing.turned = -shift_rad
        / variance_rad2
            .max(DVec2::splat(f64::MIN_POSITIVE))
            .map(f64::sqrt);
}

/// Lights the skins near the beam's axis; the aimed UAV is charged with the energy emitted.
fn light(
    clock: &SimClock,
    environment: &Environment,
    laser: &Pose,
    constants: &Laser,
    (aimed, arriving): (&Aimed, &Arriving),
    beam: &mut BeamState,
    uavs: &mut Query<Targets>,
) {
    let q_cam_enu = laser.q_enu_cam.inverse();
    let Arriving {
        across,
        jitter_m,
        range_m,
    } = arriving;
    let spot_radius_m = across.radius_m();
    for (uav, flight, shape, _, status, mut skin, mut dose) in uavs {
        let is_aimed = uav.index == aimed.index;
        if is_aimed {
            dose.energy_j += constants.power_w * clock.dt_s();
        }
        let r_cam_m = q_cam_enu * (flight.aim_enu_m() - laser.r_enu_m);
        // The spot hardly changes over a few metres of depth: one serves all in the cone.
        let place_m = r_cam_m.truncate() * (range_m / r_cam_m.z) - jitter_m;
        let offset_m = (place_m - across.centre_m).length();
        let reach_m = shape.radius_m + flight.aim_body_m.length();
        let lit = r_cam_m.z > 0.0 && offset_m < SPOT_ENDS * spot_radius_m + reach_m;
        if !lit || matches!(status, UavStatus::Down | UavStatus::Crashed) {
            continue;
        }
        let sight = environment.line_of_sight(laser.r_enu_m, flight.aim_enu_m());
        if sight != LineOfSight::Clear {
            continue;
        }
        let falls = Falls {
            across,
            origin_m: {
                let origin_m = q_cam_enu * (flight.state.r_enu_m - laser.r_enu_m);
                origin_m.truncate() * (range_m / r_cam_m.z) - jitter_m
            },
            axes_body: {
                let q_body_cam = flight.state.q_enu_body.inverse() * laser.q_enu_cam;
                DVec3::AXES.map(|axis| q_body_cam * axis)
            },
            dt_s: clock.dt_s(),
        };
        let meets_anew = clock.due(HEAT_HZ);
        let air_k = environment.weather.temperature_k;
        fall_on(
            &mut skin,
            shape,
            &falls,
            meets_anew.then_some((constants.wavelength_m, air_k)),
        );
        let bucket_w = across.power_in_bucket_w(place_m, BUCKET_RADIUS_M);
        // Several lasers add up.
        let irradiance_wpm2 = bucket_w / (PI * BUCKET_RADIUS_M * BUCKET_RADIUS_M);
        skin.irradiance_wpm2 += irradiance_wpm2;
        if is_aimed {
            beam.power_at_target_w = across.power_w;
            beam.peak_wpm2 = across.peak_wpm2();
            beam.irradiance_wpm2 = irradiance_wpm2;
            beam.power_in_bucket_w = bucket_w;
            if offset_m < BUCKET_RADIUS_M {
                dose.dwell_s += clock.dt_s();
                beam.on_aim_point = true;
            }
        }
    }
}

/// Counts the time for which the beam burns on something that is no UAV.
pub fn count_distractors(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut stations: Query<(&Optics, &FireCommand, &mut BeamState)>,
    distractors: Query<(&Uav, &Flight), With<Distractor>>,
) {
    for (optics, command, mut beam) in &mut stations {
        if !command.fire {
            continue;
        }
        let pose = optics.laser;
        let hit = distractors.iter().any(|(uav, flight)| {
            let r_enu_m = flight.aim_enu_m();
            let r_cam_m = pose.q_enu_cam.inverse() * (r_enu_m - pose.r_enu_m);
            // A disc as large as the mean silhouette of its bounding box seen from the side.
            let [_, width_m, height_m] = uav.size_m;
            let radius_m = (width_m * height_m / PI).sqrt();
            r_cam_m.z > 0.0
                && r_cam_m.truncate().length() < radius_m
                && environment.line_of_sight(pose.r_enu_m, r_enu_m) == LineOfSight::Clear
        });
        if hit {
            beam.distractor_s += clock.dt_s();
        }
    }
}

/// Turbulence on the way from a station to a place so far from it [m].
fn turbulence_to(
    source: &LaserSource,
    environment: &Environment,
    r_station_enu_m: DVec3,
    to_enu_m: DVec3,
) -> PathTurbulence {
    let height_m = |r: DVec3| environment.above_ground_m(r);
    PathTurbulence::new(
        &environment.cn2,
        &AirPath {
            length_m: to_enu_m.length(),
            h0_m: height_m(r_station_enu_m),
            h1_m: height_m(r_station_enu_m + to_enu_m),
        },
        source.laser.wavelength_m,
        source.outer_m,
    )
}

/// Mean irradiance at the rim of what must fail, so far from a station [m] that its laser is focused on [W/m²]: of the
/// long-term spot in its middle, without blooming.
pub(crate) fn expected_irradiance_wpm2(
    source: &LaserSource,
    environment: &Environment,
    r_station_enu_m: DVec3,
    to_enu_m: DVec3,
) -> f64 {
    let range_m = to_enu_m.length();
    let turbulence = turbulence_to(source, environment, r_station_enu_m, to_enu_m);
    let focus_m = source.focus_m.unwrap_or(range_m);
    let spot_m = source
        .laser
        .long_term_radius_m(range_m, focus_m, &turbulence);
    let extinction_per_m = environment
        .weather
        .extinction_per_m(source.laser.wavelength_m);
    let power_w = source.laser.power_w * transmittance(extinction_per_m, range_m);
    let swept_m = spot_m.hypot(2.0 * source.jitter_rad * range_m);
    irradiance_wpm2(power_w, swept_m, FAILS_RADIUS_M)
}

/// Works out the air on the path to the aimed UAV.
fn path_to(
    source: &LaserSource,
    environment: &Environment,
    laser: &Pose,
    aimed: &Aimed,
) -> BeamPath {
    let range_m = aimed.r_cam_m.length();
    let to_enu_m = laser.q_enu_cam * aimed.r_cam_m;
    let across_mps = aimed.v_air_mps(laser, 0.5);
    // What drops and flakes absorb heats them, not the air.
    let wavelength_m = source.laser.wavelength_m;
    let weather = &environment.weather;
    let warmed = BloomingAir {
        absorption_per_m: ABSORBED_SHARE * weather.aerosol_extinction_per_m(wavelength_m),
        extinction_per_m: weather.extinction_per_m(wavelength_m),
        temperature_k: weather.temperature_k,
        crosswind_mps: across_mps.length().max(LEAST_CROSSWIND_MPS),
        slew_radps: 0.0,
    };
    let layers = even_layers(range_m, LAYERS, |along_m| {
        let r_enu_m = laser.r_enu_m + to_enu_m * (along_m / range_m);
        let height_m = environment.above_ground_m(r_enu_m);
        let across_mps = aimed.v_air_mps(laser, along_m / range_m);
        (environment.cn2.cn2(height_m), across_mps.to_array())
    });
    BeamPath {
        index: aimed.index,
        air: BeamAir {
            turbulence: turbulence_to(source, environment, laser.r_enu_m, to_enu_m),
            layers,
            warmed,
        },
    }
}

/// Lays what falls in this tick on the grid under the beam's middle, or, where `anew` gives wavelength [m] and temperature [K],
/// on a new one where the beam meets the shape.
fn fall_on(skin: &mut HeatedSkin, shape: &UavShape, falls: &Falls, anew: Option<(f64, f64)>) {
    let HeatedSkin {
        parts,
        patches,
        lost,
        ..
    } = skin;
    // Of what is gone without bringing the UAV down, the beam meets what lies behind.
    let is_lost = |effect: Effect| {
        effect != Effect::PowerLost && lost.iter().any(|(known, _)| *known == effect)
    };
    let lit = |patch: &&mut Patch| patch.holds(falls) && !is_lost(patch.struck.effect);
    if let Some(patch) = patches.iter_mut().find(lit) {
        return patch.light(falls);
    }
    let Some((wavelength_m, air_k)) = anew else {
        return;
    };
    let Some((hull, meets)) = shape
        .hull()
        .and_then(|hull| Some((hull, falls.meets(hull)?)))
    else {
        return;
    };
    let onward = falls.axes_body[2];
    let first = parts.struck(&meets, onward, |_| false).effect;
    let past_m = meets.r_body_m + parts.depth_m(first) * onward;
    if is_lost(first) && hull.meets(past_m, onward).is_none() {
        return;
    }
    let struck = parts.struck(&meets, onward, is_lost);
    let mut patch = Patch::new(falls, &meets, hull, struck, wavelength_m, air_k);
    patch.light(falls);
    if patches.len() == MOST_PATCHES {
        let coldest = (0..MOST_PATCHES).min_by(|a, b| {
            let face_k = |at: &usize| patches[*at].grid.hottest_k();
            face_k(a).total_cmp(&face_k(b))
        });
        patches.remove(coldest.unwrap_or(0));
    }
    patches.push(patch);
}

/// UAVs as heat meets them.
type Heated = (
    &'static Flight,
    &'static Air,
    &'static mut Guidance,
    &'static mut HeatedSkin,
    &'static mut UavStatus,
);

/// Conducts heat, cools the walls, takes away what burns; what is lost by that has its effect on the flight.
pub fn heat(clock: Res<SimClock>, environment: Res<Environment>, mut uavs: Query<Heated>) {
    if !clock.due(HEAT_HZ) {
        return;
    }
    let dt_s = clock.at_s(u64::from((clock.tick_hz / HEAT_HZ).max(1)));
    let air_k = environment.weather.temperature_k;
    for (flight, air, mut guidance, mut skin, mut status) in &mut uavs {
        // What has been brought down is left as it fell.
        if skin.patches.is_empty() || *status != UavStatus::Flying {
            continue;
        }
        let film = Film {
            air_k,
            wind_mps: (flight.state.v_enu_mps - air.wind_enu_mps).length(),
            length_m: skin.length_m,
        };
        let HeatedSkin { patches, lost, .. } = &mut *skin;
        for patch in patches.iter_mut() {
            let struck = patch.struck;
            let known = lost.iter().any(|(effect, _)| *effect == struck.effect);
            if patch.step(dt_s, &film) && !known {
                lost.push((struck.effect, struck.part));
                lose(struck.effect, &mut guidance, &mut status);
            }
        }
        patches.retain(|patch| patch.grid.is_marked() || patch.grid.hottest_k() - air_k > COLD_K);
        let hottest = |of: fn(&Patch) -> f64| skin.patches.iter().map(of).fold(air_k, f64::max);
        let critical_k = hottest(|patch| patch.grid.critical_k());
        let face_k = hottest(|patch| patch.grid.hottest_k());
        (skin.temperature_k, skin.face_k) = (critical_k, face_k);
        skin.hole_m2 = skin.patches.iter().map(|patch| patch.grid.hole_m2()).sum();
    }
}

/// What the loss of a part does to a flying UAV.
fn lose(effect: Effect, guidance: &mut Guidance, status: &mut UavStatus) {
    match effect {
        Effect::PowerLost if *status == UavStatus::Flying => *status = UavStatus::Falling,
        Effect::RotorOut(rotor) => guidance.airframe.rotor_works[rotor] = false,
        Effect::PowerLost | Effect::CameraBlind => {}
    }
}
