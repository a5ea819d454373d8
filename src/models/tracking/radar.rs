//! An external radar that cues the search: noisy plots of one target and the track made of them.
//!
//! A plot is azimuth, elevation and slant range with independent Gaussian errors. The track is a
//! Kalman filter of position and velocity in `enu` driven by white acceleration, fed by plots
//! converted to Cartesian coordinates with the linearised covariance (Bar-Shalom, Li and
//! Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, secs. 6.2.2 and
//! 10.4.1). The conversion shortens a range by r σ²/2 (0.1 % at 2.5°), which is left in.

use glam::{DVec2, DVec3};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};

use crate::models::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::models::maths::rng::Stream;

/// Spectral density of the target's white acceleration [m²/s³]: a small multirotor that turns at
/// some 2 m/s² and holds the turn for about a second.
const ACCELERATION_PSD: f64 = 2.0;
/// Standard deviation of the velocity of a target just found, east, north, up [m/s].
const FIRST_VELOCITY_SIGMA_MPS: [f64; 3] = [12.0, 12.0, 3.0];
/// Least standard deviations assumed of a plot [rad], [m]: they keep the covariance regular.
const LEAST_SIGMA_RAD: f64 = 1e-6;
const LEAST_RANGE_SIGMA_M: f64 = 1e-3;
/// Nearest a target can be [m].
const LEAST_RANGE_M: f64 = 1.0;

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
        }
    }

    /// A plot in Cartesian coordinates [m] and its covariance [m²].
    fn converted(&self, plot: &Plot) -> (Vector3<f64>, Matrix3<f64>) {
        let along = az_el_to_los(plot.az_el_rad);
        let r_m = along * plot.range_m;
        let across_m = plot.range_m * self.sigma_rad.max(LEAST_SIGMA_RAD);
        let along_m = self.range_sigma_m.max(LEAST_RANGE_SIGMA_M);
        let u = Vector3::new(along.x, along.y, along.z);
        let line = u * u.transpose();
        let covariance =
            line * (along_m * along_m) + (Matrix3::identity() - line) * (across_m * across_m);
        (Vector3::new(r_m.x, r_m.y, r_m.z), covariance)
    }
}

/// Where a track says the target is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarCue {
    /// Azimuth (x) and elevation (y) [rad].
    pub az_el_rad: DVec2,
    /// Standard deviations on the sky, cross-elevation (x) and elevation (y) [rad].
    pub sigma_rad: DVec2,
    /// Slant range [m].
    pub range_m: f64,
    /// Its standard deviation [m].
    pub range_sigma_m: f64,
    /// Rates on the sky, cross-elevation (x) and elevation (y) [rad/s], and their standard deviations.
    pub rate_radps: DVec2,
    pub rate_sigma_radps: DVec2,
}

/// A radar's track of one target: position and velocity relative to the radar, in `enu`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarTrack {
    errors: RadarErrors,
    t_s: f64,
    /// East, north, up [m], then their rates [m/s].
    x: Vector6<f64>,
    p: Matrix6<f64>,
}

impl RadarTrack {
    /// Starts a track on a target's first plot.
    pub fn start(errors: RadarErrors, plot: &Plot) -> Self {
        let (r, covariance) = errors.converted(plot);
        let mut x = Vector6::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&r);
        let mut p = Matrix6::zeros();
        p.fixed_view_mut::<3, 3>(0, 0).copy_from(&covariance);
        for (axis, sigma) in FIRST_VELOCITY_SIGMA_MPS.into_iter().enumerate() {
            p[(3 + axis, 3 + axis)] = sigma * sigma;
        }
        Self {
            errors,
            t_s: plot.t_s,
            x,
            p,
        }
    }

    /// State and covariance at `t_s` [s], not before the last plot.
    fn advanced(&self, t_s: f64) -> (Vector6<f64>, Matrix6<f64>) {
        let dt = (t_s - self.t_s).max(0.0);
        let mut f = Matrix6::identity();
        let mut q = Matrix6::zeros();
        for axis in 0..3 {
            f[(axis, axis + 3)] = dt;
            // Eq. 6.2.2-12 of the book.
            q[(axis, axis)] = dt.powi(3) / 3.0;
            q[(axis, axis + 3)] = dt * dt / 2.0;
            q[(axis + 3, axis)] = dt * dt / 2.0;
            q[(axis + 3, axis + 3)] = dt;
        }
        let p = f * self.p * f.transpose() + q * ACCELERATION_PSD;
        (f * self.x, p)
    }

    /// Takes in the target's next plot.
    pub fn update(&mut self, plot: &Plot) {
        let (x, p) = self.advanced(plot.t_s);
        let (z, r) = self.errors.converted(plot);
        let gain_rows: SMatrix<f64, 6, 3> = p.fixed_view::<6, 3>(0, 0).into_owned();
        let innovation = z - x.fixed_rows::<3>(0);
        // The plot's covariance is positive definite, and so is the sum.
        let Some(inverse) = (gain_rows.fixed_view::<3, 3>(0, 0) + r).try_inverse() else {
            return;
        };
        let gain = gain_rows * inverse;
        let p = p - gain * gain_rows.transpose();
        self.t_s = self.t_s.max(plot.t_s);
        self.x = x + gain * innovation;
        self.p = (p + p.transpose()) * 0.5;
    }

    /// Where the target is at `t_s` [s] (an earlier time than the last plot's gives that one).
    pub fn cue(&self, t_s: f64) -> RadarCue {
        let (x, p) = self.advanced(t_s);
        let r_m = DVec3::new(x[0], x[1], x[2]);
        let range_m = r_m.length().max(LEAST_RANGE_M);
        let az_el_rad = los_to_az_el(r_m);
        let ((sin_az, cos_az), (sin_el, cos_el)) = (az_el_rad.x.sin_cos(), az_el_rad.y.sin_cos());
        let (right, up, along) = (
            Vector3::new(cos_az, -sin_az, 0.0),
            Vector3::new(-sin_az * sin_el, -cos_az * sin_el, cos_el),
            Vector3::new(sin_az * cos_el, cos_az * cos_el, sin_el),
        );
        let (position, velocity) = (p.fixed_view::<3, 3>(0, 0), p.fixed_view::<3, 3>(3, 3));
        let sigma = |of: Matrix3<f64>, axis: Vector3<f64>| axis.dot(&(of * axis)).max(0.0).sqrt();
        let sky = |of: Matrix3<f64>| DVec2::new(sigma(of, right), sigma(of, up)) / range_m;
        let v_mps: Vector3<f64> = x.fixed_rows::<3>(3).into();
        RadarCue {
            az_el_rad,
            sigma_rad: sky(position.into()),
            range_m,
            range_sigma_m: sigma(position.into(), along),
            rate_radps: DVec2::new(v_mps.dot(&right), v_mps.dot(&up)) / range_m,
            rate_sigma_radps: sky(velocity.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let mut track = RadarTrack::start(ERRORS, &ERRORS.plot(r, 0.0, &mut rng));
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
        let (x, p) = track.advanced(t);
        let error = Vector6::new(r.x, r.y, r.z, v.x, v.y, v.z) - x;
        let state = (error.transpose() * p.try_inverse().unwrap() * error)[0];
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
        let mut track = RadarTrack::start(exact, &exact.plot(r0, 0.0, &mut rng));
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
