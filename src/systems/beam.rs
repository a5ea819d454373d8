//! The laser beam crosses the air and heats what it meets.

use crate::components::beam::{BeamPath, BeamState, Dose, FireCommand, LaserSource};
use crate::components::environment::Environment;
use crate::components::flight::{Air, Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::Optics;
use crate::components::run::{Failure, PartError, SimClock};
use crate::models::air::atmosphere::transmittance;
use crate::models::air::turbulence::{AirPath, PathTurbulence};
use crate::models::ground::dsm::LineOfSight;
use crate::models::laser::beam::{BUCKET_RADIUS_M, BloomingAir, power_in_bucket_w};
use crate::models::laser::propagation::{Across, BeamAir, Sent};
use crate::models::maths::kinematics::Pose;
use bevy::prelude::*;
use boresight_wave::even_layers;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// A UAV further off the beam's axis than this takes no part in it [rad].
const AIM_CONE_RAD: f64 = 5e-3;
/// How often the path's turbulence is integrated anew [Hz]: within a tenth of a second a UAV moves by
/// metres, a hundredth of the path.
const PATH_HZ: u32 = 10;
/// Share of the aerosol's extinction that heats the air: urban aerosol of single-scattering albedo 0.9.
const ABSORBED_SHARE: f64 = 0.1;
/// Layers of a path: each of them scintillates weakly over a kilometre of an ordinary day.
const LAYERS: usize = 10;
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
                    source.laser.power_w * dt_s,
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
    for (uav, flight, air, status, ..) in uavs {
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
    let LaserSource {
        laser: constants,
        propagation,
        path: Some(path),
        focus_m,
        jitter_rng,
        jitter_rad,
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

/// Lights the skins near the beam's axis; the aimed UAV is charged with the energy emitted.
fn light(
    clock: &SimClock,
    environment: &Environment,
    laser: &Pose,
    energy_j: f64,
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
    for (uav, flight, _, status, mut skin, mut dose) in uavs {
        let is_aimed = uav.index == aimed.index;
        if is_aimed {
            dose.energy_j += energy_j;
        }
        let r_cam_m = q_cam_enu * (flight.aim_enu_m() - laser.r_enu_m);
        // The spot hardly changes over a few metres of depth: one serves all in the cone.
        let place_m = r_cam_m.truncate() * (range_m / r_cam_m.z) - jitter_m;
        let offset_m = (place_m - across.centre_m).length();
        let lit = r_cam_m.z > 0.0 && offset_m < 4.0 * spot_radius_m + BUCKET_RADIUS_M;
        if !lit || matches!(status, UavStatus::Down | UavStatus::Crashed) {
            continue;
        }
        let sight = environment.line_of_sight(laser.r_enu_m, flight.aim_enu_m());
        if sight != LineOfSight::Clear {
            continue;
        }
        // Wander and jitter sweep the spot over the component within its thermal time: the lumped
        // skin takes the mean over the bucket.
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
    let height_m = |r: DVec3| above_ground_m(environment, r);
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

/// Mean irradiance on a component so far from a station [m] that its laser is focused on [W/m²]: the long-term spot in
/// the bucket, without blooming.
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
    power_in_bucket_w(power_w, swept_m, 0.0, BUCKET_RADIUS_M) / (PI * BUCKET_RADIUS_M.powi(2))
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
        let height_m = above_ground_m(environment, r_enu_m);
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

/// Height of a place above the ground [m], one metre at least.
fn above_ground_m(environment: &Environment, r_enu_m: DVec3) -> f64 {
    let ground_m = environment.city.dsm.terrain_m(r_enu_m.x, r_enu_m.y);
    (r_enu_m.z - ground_m).max(1.0)
}

/// Heats and cools the skins; one that reaches its failure temperature brings its UAV down.
pub fn heat(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut uavs: Query<(&Flight, &Air, &mut HeatedSkin, &mut UavStatus)>,
) {
    let air_k = environment.weather.temperature_k;
    for (flight, air, mut heated, mut status) in &mut uavs {
        let HeatedSkin {
            skin,
            material,
            irradiance_wpm2,
        } = &mut *heated;
        // A skin at rest with the air has nothing to exchange.
        if *irradiance_wpm2 == 0.0 && (skin.temperature_k - air_k).abs() < 1e-3 {
            continue;
        }
        let wind_mps = (flight.state.v_enu_mps - air.wind_enu_mps).length();
        skin.step(clock.dt_s(), *irradiance_wpm2, air_k, wind_mps, material);
        if *status == UavStatus::Flying && skin.failed(material) {
            *status = UavStatus::Falling;
        }
    }
}
