//! A radar that cues the search: noisy plots, and the tracks made of them.
//!
//! A plot is azimuth, elevation and slant range with independent Gaussian errors. A track
//! ([`CartesianTrack`]) is fed with plots converted to Cartesian coordinates with the linearised covariance
//! (Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, sec.
//! 10.4.1). The conversion shortens a range by r σ²/2 (0.1 % at 2.5°), which is left in.
//!
//! [`sensing`] says which plots there are, [`rcs`] how much a thing sends back, [`tracks`] which plots are one
//! thing's, [`choice`] which track the search is pointed at, [`traffic`] what drives on the ground.

pub mod choice;
pub mod rcs;
pub mod sensing;
pub mod tracks;
pub mod traffic;

use glam::{DVec2, DVec3};
use nalgebra::Matrix3;

use crate::maths::kinematics::los_to_az_el;
use crate::maths::rng::Stream;
use crate::tracking::cartesian::{Bearing, CartesianTrack, LEAST_RANGE_M, TargetCue};

/// Least standard deviations assumed of a plot [rad], [m]: they keep the covariance regular.
const LEAST_SIGMA_RAD: f64 = 1e-6;
const LEAST_RANGE_SIGMA_M: f64 = 1e-3;

/// Errors of a radar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarErrors {
    /// Standard deviation of the direction on the sky, cross-elevation and elevation [rad].
    pub sigma_rad: f64,
    /// Standard deviation of the slant range [m].
    pub range_sigma_m: f64,
}

/// One measurement of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plot {
    /// Time of the measurement [s].
    pub t_s: f64,
    /// Azimuth (x) and elevation (y) [rad].
    pub az_el_rad: DVec2,
    /// Slant range [m].
    pub range_m: f64,
    /// Its standard deviations, as the radar states them.
    pub errors: RadarErrors,
}

impl Plot {
    /// Its position relative to `r_radar_enu_m` [m], and its covariance [m²].
    pub fn converted(&self, r_radar_enu_m: DVec3) -> (DVec3, Matrix3<f64>) {
        let bearing = Bearing {
            r_from_enu_m: r_radar_enu_m,
            az_el_rad: self.az_el_rad,
            sigma_rad: self.errors.sigma_rad.max(LEAST_SIGMA_RAD),
        };
        bearing.at_range(
            self.range_m,
            self.errors.range_sigma_m.max(LEAST_RANGE_SIGMA_M),
        )
    }
}

impl RadarErrors {
    /// The plot of a target at `r_enu_m` [m] from the radar at `t_s` [s], with three standard
    /// normal numbers of `rng` as its errors.
    pub fn plot(&self, r_enu_m: DVec3, t_s: f64, rng: &mut Stream) -> Plot {
        let noise = rng.normal3();
        let at = los_to_az_el(r_enu_m);
        let stretch = 1.0 / at.y.cos().max(0.05);
        Plot {
            t_s,
            az_el_rad: at + self.sigma_rad * DVec2::new(noise.x * stretch, noise.y),
            range_m: (r_enu_m.length() + self.range_sigma_m * noise.z).max(LEAST_RANGE_M),
            errors: *self,
        }
    }
}

/// A radar's track of one target, relative to the radar, in `enu`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarTrack {
    track: CartesianTrack,
    newest: Plot,
}

impl RadarTrack {
    /// Starts a track on a target's first plot.
    pub fn start(plot: &Plot) -> Self {
        let (r_m, covariance) = plot.converted(DVec3::ZERO);
        let track = CartesianTrack::start(plot.t_s, r_m, &covariance);
        Self {
            track,
            newest: *plot,
        }
    }

    /// Takes in the target's next plot.
    pub fn update(&mut self, plot: &Plot) {
        let (r_m, covariance) = plot.converted(DVec3::ZERO);
        self.track.take_position(plot.t_s, r_m, &covariance);
        self.newest = *plot;
    }

    /// The newest plot of the target.
    pub fn newest(&self) -> &Plot {
        &self.newest
    }

    /// Squared distance of a plot from where the target should be, in deviations of both: three degrees of freedom.
    pub fn distance2(&self, plot: &Plot) -> f64 {
        let (r_m, covariance) = plot.converted(DVec3::ZERO);
        self.track.position_distance2(plot.t_s, r_m, &covariance)
    }

    /// Position relative to the radar [m] and velocity [m/s] at `t_s` [s], `enu`.
    pub fn motion_enu(&self, t_s: f64) -> (DVec3, DVec3) {
        self.track.advanced(t_s).motion_enu()
    }

    /// Where the target is at `t_s` [s] (an earlier time than the last plot's gives that one).
    pub fn cue(&self, t_s: f64) -> TargetCue {
        self.track.cue(DVec3::ZERO, t_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::cartesian::{ACCELERATION_PSD, FIRST_VELOCITY_SIGMA_MPS};

    const ERRORS: RadarErrors = RadarErrors {
        sigma_rad: 0.012, // 0.7 deg
        range_sigma_m: 15.0,
    };

    #[test]
    fn plots_have_the_stated_errors() {
        let mut rng = Stream::new(1, 0, "test");
        let r = DVec3::new(-600.0, 700.0, 500.0);
        let (at, n) = (los_to_az_el(r), 20_000);
        let mut sums = DVec3::ZERO;
        for _ in 0..n {
            let plot = ERRORS.plot(r, 0.0, &mut rng);
            let off = plot.az_el_rad - at;
            let error = DVec3::new(
                off.x * at.y.cos() / ERRORS.sigma_rad,
                off.y / ERRORS.sigma_rad,
                (plot.range_m - r.length()) / ERRORS.range_sigma_m,
            );
            sums += error * error;
        }
        // Five standard errors of a variance.
        let bound = 5.0 * (2.0 / f64::from(n)).sqrt();
        assert!(
            (sums / f64::from(n) - 1.0).abs().max_element() < bound,
            "{sums}"
        );
    }

    /// Flies a target under the track's own assumptions; squared errors in units of the covariance
    /// of the state (6 degrees of freedom), of direction and range (3) and of the rates on the sky (2).
    fn normalised_errors(seed: u64) -> [f64; 3] {
        let mut rng = Stream::new(seed, 0, "test");
        let mut r = DVec3::new(-700.0, 650.0, 90.0);
        let mut v = DVec3::from(FIRST_VELOCITY_SIGMA_MPS) * rng.normal3();
        let mut track = RadarTrack::start(&ERRORS.plot(r, 0.0, &mut rng));
        let dt = 0.02; // [s]
        for i in 1..=375 {
            let t = f64::from(i) * dt;
            r += v * dt;
            let kick = rng.normal3();
            v += kick * (ACCELERATION_PSD * dt).sqrt();
            if i % 50 == 0 {
                track.update(&ERRORS.plot(r, t, &mut rng));
            }
        }
        let t = 375.0 * dt;
        let state = track.track.advanced(t).distance2(r, v);
        let (cue, at) = (track.cue(t), los_to_az_el(r));
        let off = (at - cue.az_el_rad) * DVec2::new(at.y.cos(), 1.0) / cue.sigma_rad;
        let range = (r.length() - cue.range_m) / cue.range_sigma_m;
        let step = 1e-3; // [s]
        let rates = (los_to_az_el(r + v * step) - at) * DVec2::new(at.y.cos(), 1.0) / step;
        let rates_off = (rates - cue.rate_radps) / cue.rate_sigma_radps;
        [
            state,
            off.length_squared() + range * range,
            rates_off.length_squared(),
        ]
    }

    #[test]
    fn the_track_knows_its_own_error() {
        let n = 400;
        let errors: Vec<_> = (0..n).map(normalised_errors).collect();
        for (k, degrees) in [6.0_f64, 3.0, 2.0].into_iter().enumerate() {
            let mean = errors.iter().map(|error| error[k]).sum::<f64>() / n as f64;
            // Five standard errors of a chi-squared mean.
            let bound = 5.0 * (2.0 * degrees / n as f64).sqrt();
            assert!((mean - degrees).abs() < bound, "{k}: {mean}");
        }
    }

    #[test]
    fn a_straight_flight_is_predicted_through_the_latency() {
        let exact = RadarErrors {
            sigma_rad: 0.0,
            range_sigma_m: 0.0,
        };
        let mut rng = Stream::new(1, 0, "test");
        let (r0, v) = (DVec3::new(-776.0, 635.0, 80.0), DVec3::new(5.7, 5.7, 0.0));
        let mut track = RadarTrack::start(&exact.plot(r0, 0.0, &mut rng));
        for t in 1..=5 {
            let t = f64::from(t);
            track.update(&exact.plot(r0 + v * t, t, &mut rng));
        }
        let truth = r0 + v * 6.3;
        let cue = track.cue(6.3);
        assert!(cue.az_el_rad.distance(los_to_az_el(truth)) < 1e-4);
        assert!((cue.range_m - truth.length()).abs() < 0.1);
    }
}
