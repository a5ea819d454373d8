//! How well a UAV knows its place: the error of satellite navigation.
//!
//! The error is a first-order Gauss–Markov process, as slow as the satellites' geometry and multipath change (P. D. Groves,
//! "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed. 2013, sec. 9.4), smoothed as the
//! autopilot's filter smooths it. The autopilot flies to where it believes the set point to be.

use crate::maths::rng::Stream;
use glam::DVec3;

/// Time in which the error changes [s]: multipath takes a minute or so to decorrelate at a slow vehicle. Chosen.
const CHANGES_S: f64 = 60.0;
/// Time over which the autopilot's filter, with its inertial sensors, follows it [s]. Chosen.
const FOLLOWED_S: f64 = 1.0;

/// A UAV's satellite navigation.
#[derive(Clone, Debug)]
pub struct Navigation {
    /// Standard deviations, east, north and up [m].
    sigma_m: DVec3,
    /// What the receiver is off [m, enu], and what the autopilot believes of it.
    received_enu_m: DVec3,
    error_enu_m: DVec3,
    rng: Stream,
}

impl Navigation {
    /// With standard deviations horizontally, each axis, and vertically [m].
    pub fn new([level_m, up_m]: [f64; 2], mut rng: Stream) -> Self {
        let sigma_m = DVec3::new(level_m, level_m, up_m);
        let error_enu_m = sigma_m * rng.normal3();
        Self {
            sigma_m,
            received_enu_m: error_enu_m,
            error_enu_m,
            rng,
        }
    }

    /// Believed less true place [m, enu].
    pub fn error_enu_m(&self) -> DVec3 {
        self.error_enu_m
    }

    /// Goes on by a tick of `dt_s` [s].
    pub fn advance(&mut self, dt_s: f64) {
        let kept = (-dt_s / CHANGES_S).exp();
        let fresh = (1.0 - kept * kept).sqrt();
        self.received_enu_m =
            kept * self.received_enu_m + fresh * self.sigma_m * self.rng.normal3();
        let followed = 1.0 - (-dt_s / FOLLOWED_S).exp();
        self.error_enu_m += followed * (self.received_enu_m - self.error_enu_m);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_keeps_its_deviation_and_changes_slowly() {
        let (dt_s, n) = (0.1, 400);
        let (mut early, mut late, mut moved) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for seed in 0..n {
            let mut navigation = Navigation::new([0.8, 0.3], Stream::new(seed, 0, "test"));
            let first = navigation.error_enu_m();
            early += first * first;
            for step in 0..2400 {
                let before = navigation.error_enu_m();
                navigation.advance(dt_s);
                if step == 0 {
                    moved += before.distance(navigation.error_enu_m()) / n as f64;
                }
            }
            late += navigation.error_enu_m() * navigation.error_enu_m();
        }
        let variance = DVec3::new(0.64, 0.64, 0.09);
        // The filter takes 2 % of the variance; five standard errors of a variance.
        let bound = 5.0 * (2.0 / n as f64).sqrt();
        for sum in [early, late] {
            let off = (sum / n as f64 / variance - 1.0).abs().max_element();
            assert!(off < bound, "{off}");
        }
        assert!(moved < 0.02, "{moved} m in a tick of 0.1 s");
    }
}
