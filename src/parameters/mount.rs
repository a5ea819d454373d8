//! A station's mount from its scenario.

use crate::components::environment::Environment;
use crate::components::mount::{Gimbal, Gyro, Mount, StationWind};
use crate::components::run::{Seed, SimClock};
use crate::models::air::wind::DrydenGust;
use crate::models::maths::rng::Stream;
use crate::models::mount::gimbal::{AxisParams, GimbalParams, Structure, WindLoad};
use crate::models::mount::mirror::{Mirror, MirrorParams};
use crate::scenario::{self, InputError, Loaded, ResolvedStation};
use glam::DVec3;
use std::f64::consts::TAU;

/// Angle random walk of the base gyro, 0.01 deg/sqrt(h) [rad/sqrt(s)]: a small fibre gyro.
pub const GYRO_WALK: f64 = 0.01 * std::f64::consts::PI / 180.0 / 60.0;

/// The mount of a station, whose streams have the key `key`.
pub fn mount(
    loaded: &Loaded,
    station: &ResolvedStation,
    seed: Seed,
    key: u64,
    clock: SimClock,
    environment: &Environment,
) -> Result<Mount, InputError> {
    let config = &station.config.mount;
    let r_enu_m = (station.config.position_enu_m)
        .map_or_else(|| environment.city.station_enu_m(), DVec3::from_array);
    let [x, y, z] = r_enu_m.to_array();
    let solid_m = environment.city.dsm.surface_m(x, y);
    if environment.city.dsm.inside(r_enu_m) {
        let what =
            format!("{z} m up, inside what reaches up to {solid_m:.1} m there; put it above");
        return Err(loaded.refuse(&format!("{}.position_enu_m", station.place), what));
    }
    let place = format!("{}.mount", station.place);
    let refuse = |error: String| loaded.refuse(&place, error);
    let params = gimbal_params(config, clock.dt_s());
    params
        .validate()
        .map_err(|error| refuse(error.to_string()))?;
    let mirror_params = mirror_params(config);
    let mirror =
        Mirror::new(&mirror_params, clock.dt_s()).map_err(|error| refuse(error.to_string()))?;
    let mut rng = seed.stream(key, "base motion");
    let mut base = (config.base_motion)
        .model(clock.dt_s(), &mut rng)
        .map_err(|error| loaded.refuse(&format!("{place}.base_motion"), error))?;
    base.step(&mut rng);
    Ok(Mount {
        r_enu_m,
        gimbal: Gimbal::new(params, seed.stream(key, "axis gyros")),
        mirror_params,
        mirror,
        rng,
        gyro: Gyro {
            angle_random_walk: GYRO_WALK,
            rng: seed.stream(key, "gyro"),
            rate_enu_radps: DVec3::ZERO,
            tilt_enu_rad: base.tilt_rad(),
        },
        base,
        wind: (config.wind_load)
            .then(|| station_wind(environment, seed.stream(key, "station wind"), r_enu_m)),
    })
}

/// The mirror of a scenario's mount.
pub fn mirror_params(mount: &scenario::MountConfig) -> MirrorParams {
    MirrorParams {
        natural_frequency_hz: mount.mirror_bandwidth_hz,
        stroke_rad: mount.mirror_range_mrad * 1e-3,
        ..Default::default()
    }
}

/// The gimbal of a scenario's mount, commanded every `dt_s`.
pub fn gimbal_params(mount: &scenario::MountConfig, dt_s: f64) -> GimbalParams {
    let default = GimbalParams::default();
    let axis = |axis: AxisParams, travel_deg: Option<[f64; 2]>| {
        let structure = axis
            .structure
            .filter(|_| mount.structural_mode_hz > 0.0)
            .map(|structure| Structure {
                locked_rotor_hz: mount.structural_mode_hz,
                backlash_rad: mount.backlash_urad * 1e-6,
                ..structure
            });
        let rotor_share = structure.map_or(1.0, |structure| structure.rotor_share);
        // A coarse tick cannot carry the whole bandwidth: see models/mount/gimbal.rs.
        let sampled_hz = 0.75 * rotor_share / (2.0 * axis.damping * TAU * dt_s);
        let axis = AxisParams {
            torque_limit_nm: axis.inertia_kg_m2 * mount.max_acceleration_degps2.to_radians(),
            rate_limit_radps: mount.max_rate_degps.to_radians(),
            travel_rad: travel_deg.map(|limits| limits.map(f64::to_radians)),
            structure,
            encoder_bits: Some(mount.encoder_bits),
            bandwidth_hz: axis.bandwidth_hz.min(sampled_hz),
            ..axis
        };
        if mount.friction { axis } else { axis.ideal() }
    };
    GimbalParams {
        azimuth: axis(default.azimuth, mount.azimuth_limits_deg),
        elevation: axis(default.elevation, Some(mount.elevation_limits_deg)),
    }
}

/// The wind at the station.
pub fn station_wind(
    environment: &Environment,
    mut rng: Stream,
    r_station_enu_m: DVec3,
) -> StationWind {
    let [x, y, z] = r_station_enu_m.to_array();
    let height_agl_m = z - environment.city.dsm.terrain_m(x, y);
    StationWind {
        load: WindLoad::default(),
        mean_enu_mps: environment.mean_wind.mean_wind_enu_mps(height_agl_m),
        height_agl_m,
        air_density_kgpm3: environment.air_density_kgpm3,
        gusts: DrydenGust::new(&environment.mean_wind, &mut rng)
            .reaching(environment.weather.gust_mps),
        rng,
        torque_nm: [0.0; 2],
    }
}
