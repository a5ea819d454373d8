//! A station's own frame and clock: what it says to others is said in them.
//!
//! No station stands quite where its survey puts it, none is levelled and turned to north without error, and no clock goes quite
//! right. Alone, it does not notice: its cameras, its mount and its range finder err alike. Where two stations put their
//! measurements together, the errors stay, fix after fix: each counts its own as noise of its measurements, so that it fits what
//! others say. Estimating the errors from what both see (Bar-Shalom, Li, Kirubarajan, 2001, has registration as a state) is left.

use super::fix::{Fix, Measured};
use crate::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::maths::rng::Stream;
use crate::tracking::cartesian::{Bearing, CartesianTrack};
use glam::{DQuat, DVec3};
use nalgebra::{Matrix3, Vector3};

/// How well stations are surveyed: standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurveyErrors {
    /// Of a station's place, each axis [m].
    pub position_m: f64,
    /// Of how it is turned, about each axis [rad].
    pub turn_rad: f64,
    /// Of its clock [s].
    pub clock_s: f64,
}

/// A station's own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnFrame {
    /// Where the station stands [m].
    r_enu_m: DVec3,
    /// How far off it believes to stand [m].
    off_enu_m: DVec3,
    /// From true directions to those that it says.
    q_said_enu: DQuat,
    /// How far its clock is ahead [s].
    ahead_s: f64,
    /// How well it is surveyed.
    errors: SurveyErrors,
}

impl OwnFrame {
    /// That of a station that stands there [m].
    pub fn drawn(errors: SurveyErrors, r_enu_m: DVec3, rng: &mut Stream) -> Self {
        Self {
            r_enu_m,
            off_enu_m: errors.position_m * rng.normal3(),
            q_said_enu: DQuat::from_scaled_axis(errors.turn_rad * rng.normal3()),
            ahead_s: errors.clock_s * rng.normal(),
            errors,
        }
    }

    /// A place [m] as the station says it.
    fn place(&self, r_enu_m: DVec3) -> DVec3 {
        self.r_enu_m + self.off_enu_m + self.q_said_enu * (r_enu_m - self.r_enu_m)
    }

    /// A time as its clock has it [s].
    pub fn clock_s(&self, t_s: f64) -> f64 {
        t_s + self.ahead_s
    }

    /// A fix as the station says it: in its own frame, and no surer than its survey.
    pub fn said(&self, fix: Fix) -> Fix {
        let errors = &self.errors;
        let measured = match fix.measured {
            Measured::Bearing(bearing) => {
                let los = self.q_said_enu * az_el_to_los(bearing.az_el_rad);
                Measured::Bearing(Bearing {
                    r_from_enu_m: self.place(bearing.r_from_enu_m),
                    az_el_rad: los_to_az_el(los),
                    sigma_rad: bearing.sigma_rad.hypot(errors.turn_rad),
                })
            }
            Measured::Position(r_enu_m, covariance) => {
                let across_m = errors.turn_rad * r_enu_m.distance(self.r_enu_m);
                let variance_m2 = errors.position_m.powi(2) + across_m.powi(2);
                let covariance = covariance + Matrix3::identity() * variance_m2;
                Measured::Position(self.place(r_enu_m), covariance)
            }
            Measured::Range(from_enu_m, range_m, sigma_m) => Measured::Range(
                self.place(from_enu_m),
                range_m,
                sigma_m.hypot(errors.position_m),
            ),
        };
        Fix {
            t_s: self.clock_s(fix.t_s),
            measured,
            ..fix
        }
    }

    /// Where the station looks for an object that all have a track of: true places, as far as its own errors go.
    pub fn own(&self, track: &CartesianTrack) -> CartesianTrack {
        let q_enu_said = self.q_said_enu.inverse();
        let shift_m = self.r_enu_m - q_enu_said * (self.r_enu_m + self.off_enu_m);
        let turn = |axis: DVec3| {
            let axis = q_enu_said * axis;
            Vector3::new(axis.x, axis.y, axis.z)
        };
        let turned = Matrix3::from_columns(&[turn(DVec3::X), turn(DVec3::Y), turn(DVec3::Z)]);
        let shift_m = Vector3::new(shift_m.x, shift_m.y, shift_m.z);
        track.in_frame(&turned, shift_m, -self.ahead_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fix::{Follower, Sensor};
    use super::*;

    const R_ENU_M: DVec3 = DVec3::new(120.0, -40.0, 35.0);
    const ERRORS: SurveyErrors = SurveyErrors {
        position_m: 0.5,
        turn_rad: 2e-3,
        clock_s: 0.01,
    };

    fn frame() -> OwnFrame {
        OwnFrame::drawn(ERRORS, R_ENU_M, &mut Stream::new(5, 0, "survey"))
    }

    #[test]
    fn what_a_station_says_of_an_object_is_where_it_looks_for_it() {
        let (frame, at) = (frame(), DVec3::new(-300.0, 500.0, 90.0));
        let fix = Fix {
            follower: Follower {
                station: 0,
                sensor: Sensor::Radar,
                number: 0,
            },
            t_s: 7.0,
            measured: Measured::Position(at, Matrix3::identity()),
        };
        let said = frame.said(fix);
        let Measured::Position(said_enu_m, covariance) = said.measured else {
            panic!("another kind");
        };
        // Half a metre, and 2 mrad at 690 m.
        assert!((0.1..5.0).contains(&said_enu_m.distance(at)));
        assert!(covariance[(0, 0)] > 1.0 + 0.25 + 1.3f64.powi(2));
        assert!((said.t_s - 7.0).abs() > 1e-5);
        let own = frame.own(&CartesianTrack::start(said.t_s, said_enu_m, &covariance));
        assert!(own.motion_enu().0.distance(at) < 1e-9);
        assert!((own.t_s() - 7.0).abs() < 1e-12);
    }

    #[test]
    fn errors_are_as_large_as_they_are_stated() {
        let mut rng = Stream::new(6, 0, "survey");
        let n = 4000;
        let mean2 = |of: &dyn Fn(&OwnFrame) -> f64, rng: &mut Stream| {
            let sum: f64 = (0..n)
                .map(|_| of(&OwnFrame::drawn(ERRORS, R_ENU_M, rng)).powi(2))
                .sum();
            (sum / f64::from(n)).sqrt()
        };
        // A standard deviation of 4,000 draws is good to 1.1 %: four of those.
        let place_m = mean2(&|frame| frame.off_enu_m.x, &mut rng);
        assert!((place_m / 0.5 - 1.0).abs() < 0.045, "{place_m}");
        let turn = mean2(&|frame| frame.q_said_enu.to_scaled_axis().z, &mut rng);
        assert!((turn / 2e-3 - 1.0).abs() < 0.045, "{turn}");
        let clock_s = mean2(&|frame| frame.ahead_s, &mut rng);
        assert!((clock_s / 0.01 - 1.0).abs() < 0.045, "{clock_s}");
    }

    #[test]
    fn a_bearing_is_turned_and_no_surer_than_the_survey() {
        let frame = frame();
        let bearing = Bearing {
            r_from_enu_m: R_ENU_M,
            az_el_rad: glam::DVec2::new(0.4, 0.1),
            sigma_rad: 4e-5,
        };
        let fix = Fix {
            follower: Follower {
                station: 0,
                sensor: Sensor::Cameras,
                number: 3,
            },
            t_s: 1.0,
            measured: Measured::Bearing(bearing),
        };
        let Measured::Bearing(said) = frame.said(fix).measured else {
            panic!("another kind");
        };
        let apart = az_el_to_los(said.az_el_rad).distance(az_el_to_los(bearing.az_el_rad));
        assert!((1e-4..8e-3).contains(&apart), "{apart}");
        assert!(said.sigma_rad > 2e-3);
    }
}
