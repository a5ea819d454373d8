//! A station's mount from its scenario.

use crate::components::environment::Environment;
use crate::components::mount::{Gimbal, Mount, StationWind};
use crate::components::run::{Seed, SimClock};
use crate::models::air::wind::DrydenGust;
use crate::models::maths::rng::Stream;
use crate::models::mount::drive::{Cogging, Friction};
use crate::models::mount::gimbal::{AxisParams, GimbalParams, Structure, WindLoad};
use crate::models::mount::gyro::{Gyro, TiltGyro};
use crate::models::mount::mirror::{Mirror, MirrorParams};
use crate::scenario::{self, InputError, Loaded, ResolvedStation};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

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
    let gyro_params = config.gyro.params();
    gyro_params
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
        gimbal: Gimbal::new(
            params,
            Gyro::new(gyro_params, seed.stream(key, "axis gyros")),
        ),
        mirror_params,
        mirror,
        mirror_rng: seed.stream(key, "mirror"),
        rng,
        gyro: TiltGyro::new(gyro_params, seed.stream(key, "gyro"), base.tilt_rad()),
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
        noise_rad: mount.mirror_noise_urad * 1e-6,
        ..Default::default()
    }
}

/// The gimbal of a scenario's mount, commanded every `dt_s`.
pub fn gimbal_params(mount: &scenario::MountConfig, dt_s: f64) -> GimbalParams {
    let default = GimbalParams::default();
    let lag_s = mount.gyro.params().lag_s();
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
        // A coarse tick cannot carry the whole bandwidth: see models/mount/gimbal.rs. Nor can late gyros: under a
        // delay of n ticks an integrator's gain is limited by 2 sin(π/(4n + 2)), so that a delay counts 4/π of
        // itself.
        let most_hz =
            |share: f64, late_s: f64| share * rotor_share / (2.0 * axis.damping * TAU * late_s);
        let sampled_hz = most_hz(0.75, dt_s);
        let late_hz = most_hz(0.95, dt_s + 4.0 / PI * lag_s);
        let torque_limit_nm = axis.inertia_kg_m2 * mount.max_acceleration_degps2.to_radians();
        AxisParams {
            rate_limit_radps: mount.max_rate_degps.to_radians(),
            travel_rad: travel_deg.map(|limits| limits.map(f64::to_radians)),
            structure,
            friction: (axis.friction.filter(|_| mount.friction)).map(|friction| Friction {
                presliding_rad: mount.presliding_urad * 1e-6,
                ..friction
            }),
            cogging: axis.cogging.map(|cogging| Cogging {
                torque_nm: mount.cogging_share * torque_limit_nm,
                ..cogging
            }),
            torque_limit_nm,
            encoder_bits: Some(mount.encoder_bits),
            bandwidth_hz: axis.bandwidth_hz.min(sampled_hz).min(late_hz),
            ..axis
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::control::tuning::{Derived, MountPlant, TuningError, derive};
    use crate::scenario::{GyroConfig, GyroPreset, GyroValues, MountConfig};

    fn gains(gyro: GyroConfig) -> Result<Derived, TuningError> {
        let mount = MountConfig {
            gyro,
            ..MountConfig::default()
        };
        let dt_s = 1.0 / 960.0; // [s]
        derive(&MountPlant {
            gimbal: gimbal_params(&mount, dt_s),
            mirror: mirror_params(&mount),
            gyro: mount.gyro.params(),
            dt_s,
        })
    }

    fn late_by(delay_s: f64) -> GyroConfig {
        GyroConfig::Values(GyroValues {
            delay_s,
            ..GyroValues::default()
        })
    }

    #[test]
    fn every_gyro_has_a_rate_loop_and_a_gain_until_its_delay_swings_the_structure() {
        let presets = [GyroPreset::Ideal, GyroPreset::Fibre, GyroPreset::Mems];
        let gyros = presets.map(GyroConfig::Preset).into_iter();
        for gyro in gyros.chain([late_by(2e-3)]) {
            let derived = gains(gyro.clone());
            assert!(derived.is_ok(), "{gyro:?}: {derived:?}");
        }
        assert_eq!(gains(late_by(5e-3)), Err(TuningError::NoGain));
    }
}
