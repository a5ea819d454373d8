//! Orders as clients give them, and as a scenario has them.

use crate::scenario::{DriveOrder, Gains, GainsOrder, OrderConfig, WeatherOrder};
use boresight_lockstep::proto::{self, order::What};

/// The order that a message holds, or why none.
pub(super) fn config(order: proto::Order) -> Result<OrderConfig, String> {
    let mut config = OrderConfig {
        t_s: order.t_s,
        station: order.station,
        ..OrderConfig::default()
    };
    let what = order.what.ok_or(
        "order: holds nothing that this server knows: give designate, track, release, fire, slew, law, gains, weather \
         or drive",
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
        What::Goal(_) => {
            return Err(
                "order: goal: is not offered yet: a UAV flies the plan of the scenario".into(),
            );
        }
        What::Camera(_) => {
            return Err(
                "order: camera: is not offered yet: a camera is set by the scenario".into(),
            );
        }
    }
    Ok(config)
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
        for (what, named) in [
            (None, "holds nothing"),
            (
                Some(What::Goal(proto::Goal::default())),
                "goal: is not offered",
            ),
            (
                Some(What::Camera(proto::CameraSetting::default())),
                "camera: is not offered",
            ),
        ] {
            let error = config(order(what)).unwrap_err();
            assert!(error.contains(named), "{error}");
        }
    }
}
