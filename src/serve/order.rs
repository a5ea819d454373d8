//! Orders as clients give them, and as a scenario has them.

use crate::scenario::{
    AutoWord, CameraOrder, DriveOrder, Exposure, FlyOrder, Gains, GainsOrder, OrderConfig,
    WeatherOrder,
};
use boresight_lockstep::proto::{self, camera_setting::Exposure as Timing, order::What};

/// The order that a message holds, or why none.
pub(super) fn config(order: proto::Order) -> Result<OrderConfig, String> {
    let mut config = OrderConfig {
        t_s: order.t_s,
        station: order.station,
        ..OrderConfig::default()
    };
    let what = order.what.ok_or(
        "order: holds nothing that this server knows: give designate, track, release, fire, slew, law, gains, weather, \
         drive, goal or camera",
    )?;
    match what {
        What::Designate(name) => config.designate = Some(name),
        What::Track(id) => config.track = Some(id),
        What::Release(proto::Release {}) => {}
        What::Fire(may) => config.fire = Some(may),
        What::Slew(slew) => config.slew_deg = Some([slew.azimuth_deg, slew.elevation_deg]),
        What::Law(name) => config.law = Some(name),
        What::Gains(gains) => {
            config.gains = Some(GainsOrder {
                coarse: gains.coarse.map(pid),
                precise: gains.precise.map(pid),
                gimbal_per_s: gains.gimbal_per_s,
            });
        }
        What::Weather(weather) => {
            config.weather = Some(WeatherOrder {
                wind_speed_mps: weather.wind_speed_mps,
                wind_from_deg: weather.wind_from_deg,
                visibility_m: weather.visibility_m,
            });
        }
        What::Drive(drive) => {
            config.drive = Some(DriveOrder {
                rates_degps: drive.rates.map(|of| [of.azimuth_degps, of.elevation_degps]),
                mirror_urad: drive.mirror.map(|of| [of.right_urad, of.up_urad]),
            });
        }
        What::Goal(goal) => config.fly = Some(fly(goal)?),
        What::Camera(setting) => {
            config.camera = Some(CameraOrder {
                name: setting.camera,
                exposure_s: match setting.exposure {
                    Some(Timing::ExposureS(time_s)) => Some(Exposure::Seconds(time_s)),
                    Some(Timing::Automatic(true)) => Some(Exposure::Auto(AutoWord::Auto)),
                    Some(Timing::Automatic(false)) | None => None,
                },
                exposure_level: setting.exposure_level,
            });
        }
    }
    Ok(config)
}

fn fly(goal: proto::Goal) -> Result<FlyOrder, String> {
    let (path_enu_m, rest) = goal.path_enu_m.as_chunks::<3>();
    if !rest.is_empty() {
        let count = goal.path_enu_m.len();
        return Err(format!(
            "order: goal.path_enu_m: found {count} numbers, expected three for each place: east, north, up"
        ));
    }
    let velocity_enu_mps = match goal.velocity_enu_mps[..] {
        [] => None,
        [east, north, up] => Some([east, north, up]),
        _ => {
            let count = goal.velocity_enu_mps.len();
            return Err(format!(
                "order: goal.velocity_enu_mps: found {count} numbers, expected three: east, north, up"
            ));
        }
    };
    Ok(FlyOrder {
        uav: goal.uav,
        path_enu_m: path_enu_m.to_vec(),
        speed_mps: goal.speed_mps,
        velocity_enu_mps,
        land: goal.land,
        rotors: (!goal.rotors.is_empty()).then_some(goal.rotors),
        heading_deg: goal.heading_deg,
    })
}

fn pid(gains: proto::Pid) -> Gains {
    Gains {
        kp: gains.kp,
        ki_per_s: gains.ki_per_s,
        kd_s: gains.kd_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(what: Option<What>) -> proto::Order {
        proto::Order {
            t_s: 1.5,
            station: Some("north".into()),
            what,
        }
    }

    #[test]
    fn every_order_of_a_scenario_can_be_given() {
        let release = config(order(Some(What::Release(proto::Release {})))).unwrap();
        let bare = OrderConfig {
            t_s: 1.5,
            station: Some("north".into()),
            ..OrderConfig::default()
        };
        assert_eq!(release, bare);
        let drive = proto::Drive {
            rates: Some(proto::AzElRates {
                azimuth_degps: 1.0,
                elevation_degps: -2.0,
            }),
            mirror: None,
        };
        let drive = config(order(Some(What::Drive(drive)))).unwrap();
        let wanted = DriveOrder {
            rates_degps: Some([1.0, -2.0]),
            mirror_urad: None,
        };
        assert_eq!(drive.drive, Some(wanted));
        let goal = proto::Goal {
            uav: "red".into(),
            path_enu_m: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            ..proto::Goal::default()
        };
        let flown = config(order(Some(What::Goal(goal.clone()))))
            .unwrap()
            .fly
            .unwrap();
        assert_eq!(flown.path_enu_m, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let setting = proto::CameraSetting {
            camera: "CTV".into(),
            exposure: Some(Timing::Automatic(true)),
            exposure_level: None,
        };
        let camera = config(order(Some(What::Camera(setting))))
            .unwrap()
            .camera
            .unwrap();
        assert_eq!(camera.exposure_s, Some(Exposure::Auto(AutoWord::Auto)));

        let error = config(order(None)).unwrap_err();
        assert!(error.contains("holds nothing"), "{error}");
        let two = proto::Goal {
            path_enu_m: vec![1.0, 2.0],
            ..goal
        };
        let error = config(order(Some(What::Goal(two)))).unwrap_err();
        assert!(error.contains("found 2 numbers, expected three"), "{error}");
    }
}
