//! What drives through a radar's field: vehicles on the ground, which a radar sees and no camera shows.
//!
//! A vehicle is a point a metre above the ground that goes straight on for some time and then starts elsewhere: what counts is
//! that a plot comes from there now and then, not where the streets lie.

use super::sensing::Echo;
use crate::maths::rng::Stream;
use crate::tracking::search::Sector;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Speeds [m/s] and mean RCS [m²], even over its logarithm: from a bicycle (2) to a car (100; Skolnik 2001, table 2.1).
const SPEED_MPS: [f64; 2] = [3.0, 14.0];
const RCS_M2: [f64; 2] = [2.0, 100.0];
/// Nearest [m]; height over the ground [m]; time on one street [s]. Chosen.
const NEAREST_M: f64 = 100.0;
const HEIGHT_M: f64 = 1.0;
const STREET_S: f64 = 20.0;

/// The vehicles of a radar's field.
#[derive(Clone, Debug)]
pub struct Traffic {
    vehicles: Vec<Vehicle>,
    rng: Stream,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Vehicle {
    /// Where it was at `since_s`, relative to the radar [m, enu], and its velocity [m/s].
    from_en_m: DVec2,
    v_en_mps: DVec2,
    since_s: f64,
    rcs_m2: f64,
}

impl Vehicle {
    fn somewhere(field: &Sector, farthest_m: f64, t_s: f64, rng: &mut Stream) -> Self {
        let azimuth_rad = field.centre_azimuth_rad + (rng.uniform() - 0.5) * field.width_rad;
        // Even over the area.
        let range_m = rng.range(NEAREST_M.powi(2), farthest_m.powi(2)).sqrt();
        let speed_mps = rng.range(SPEED_MPS[0], SPEED_MPS[1]);
        let heading_rad = rng.range(0.0, TAU);
        let [low, high] = RCS_M2.map(f64::ln);
        let at = |angle_rad: f64| DVec2::new(angle_rad.sin(), angle_rad.cos());
        Self {
            from_en_m: range_m * at(azimuth_rad),
            v_en_mps: speed_mps * at(heading_rad),
            since_s: t_s,
            rcs_m2: rng.range(low, high).exp(),
        }
    }
}

impl Traffic {
    /// So many vehicles in a field, up to so far [m].
    pub fn new(count: u32, field: &Sector, farthest_m: f64, mut rng: Stream) -> Self {
        let one = |_| Vehicle::somewhere(field, farthest_m, 0.0, &mut rng);
        let vehicles = (0..count).map(one).collect();
        Self { vehicles, rng }
    }

    /// Where they are at `t_s` [s], relative to a radar at `r_radar_enu_m` [m], over the ground of that height [m].
    pub fn echoes(
        &mut self,
        t_s: f64,
        (field, farthest_m): (&Sector, f64),
        r_radar_enu_m: DVec3,
        ground_m: impl Fn(f64, f64) -> f64,
    ) -> Vec<Echo> {
        let rng = &mut self.rng;
        (self.vehicles.iter_mut())
            .map(|vehicle| {
                if t_s - vehicle.since_s > STREET_S {
                    *vehicle = Vehicle::somewhere(field, farthest_m, t_s, rng);
                }
                let en_m = vehicle.from_en_m + vehicle.v_en_mps * (t_s - vehicle.since_s);
                let place_en_m = r_radar_enu_m.truncate() + en_m;
                let up_m = ground_m(place_en_m.x, place_en_m.y) + HEIGHT_M - r_radar_enu_m.z;
                Echo {
                    r_enu_m: en_m.extend(up_m),
                    v_enu_mps: vehicle.v_en_mps.extend(0.0),
                    rcs_m2: vehicle.rcs_m2,
                    modulated: false,
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vehicles_stay_on_the_ground_and_in_reach() {
        let field = Sector {
            centre_azimuth_rad: 1.0,
            centre_elevation_rad: 0.0,
            width_rad: 2.0,
            height_rad: 0.5,
        };
        let mut traffic = Traffic::new(5, &field, 1500.0, Stream::new(1, 0, "test"));
        let radar = DVec3::new(10.0, 20.0, 40.0);
        for k in 0..100 {
            let echoes = traffic.echoes(f64::from(k), (&field, 1500.0), radar, |_, _| 3.0);
            assert_eq!(echoes.len(), 5);
            for echo in echoes {
                assert!((echo.r_enu_m.z - (3.0 + HEIGHT_M - 40.0)).abs() < 1e-9);
                let reach_m = 1500.0 + SPEED_MPS[1] * (STREET_S + 1.0);
                assert!(echo.r_enu_m.truncate().length() < reach_m);
            }
        }
    }
}
