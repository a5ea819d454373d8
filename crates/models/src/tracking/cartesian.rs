//! A track in Cartesian coordinates: position and velocity in `enu`, driven by white acceleration.
//!
//! An extended Kalman filter (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to
//! Tracking and Navigation*, 2001, secs. 6.2.2 and 10.3). It takes positions, as a radar's plots are; directions
//! seen from any place, as cameras see them; and ranges. Directions from two places fix the position without any
//! range ([`crossing`]).
//!
//! It is given measurements, never another filter's estimates: the errors of measurements are independent of each
//! other, whoever made them, so that nothing needs to be known of correlations. Fusing the stations' own tracks
//! was rejected: they share the target's unknown acceleration, and covariance intersection, which is right for any
//! correlation, gives away what the second station adds.

use glam::{DVec2, DVec3};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

use crate::maths::kinematics::{az_el_to_los, los_to_az_el};

/// Spectral density of the target's white acceleration [m²/s³]: a small multirotor that turns at
/// some 2 m/s² and holds the turn for about a second.
pub const ACCELERATION_PSD: f64 = 2.0;
/// The same of one that falls: within a second it is as fast as gravity makes it [m²/s³].
const FALLING_PSD: f64 = 100.0;
/// Standard deviation of the velocity of a target just found, east, north, up [m/s].
pub const FIRST_VELOCITY_SIGMA_MPS: [f64; 3] = [12.0, 12.0, 3.0];
/// Nearest a target can be [m].
pub const LEAST_RANGE_M: f64 = 1.0;

/// Where a track says the target is, as seen from some place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetCue {
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

/// A direction in which a target was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bearing {
    /// From where [m].
    pub r_from_enu_m: DVec3,
    /// Azimuth (x) and elevation (y) [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation on the sky, each axis [rad].
    pub sigma_rad: f64,
}

impl Bearing {
    /// Its position at a range, which has a standard deviation [m], and the position's covariance [m²].
    pub fn at_range(&self, range_m: f64, range_sigma_m: f64) -> (DVec3, Matrix3<f64>) {
        let along = az_el_to_los(self.az_el_rad);
        let (u, across_m) = (to_vector(along), range_m * self.sigma_rad);
        let line = u * u.transpose();
        let covariance = line * (range_sigma_m * range_sigma_m)
            + (Matrix3::identity() - line) * (across_m * across_m);
        (self.r_from_enu_m + along * range_m, covariance)
    }
}

/// Position and velocity of one target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CartesianTrack {
    t_s: f64,
    /// East, north, up [m], then their rates [m/s].
    x: Vector6<f64>,
    p: Matrix6<f64>,
    /// Spectral density of its acceleration [m²/s³].
    acceleration_psd: f64,
}

fn to_vector(v: DVec3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// Right and up on the sky, and along the line of sight.
fn sky_axes(az_el_rad: DVec2) -> [Vector3<f64>; 3] {
    let ((sin_az, cos_az), (sin_el, cos_el)) = (az_el_rad.x.sin_cos(), az_el_rad.y.sin_cos());
    [
        Vector3::new(cos_az, -sin_az, 0.0),
        Vector3::new(-sin_az * sin_el, -cos_az * sin_el, cos_el),
        Vector3::new(sin_az * cos_el, cos_az * cos_el, sin_el),
    ]
}

/// A direction's residual on the sky against a position [rad], and how it depends on that position [rad/m].
fn against(bearing: &Bearing, r_enu_m: Vector3<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
    let to_m = r_enu_m - to_vector(bearing.r_from_enu_m);
    let range_m = to_m.norm().max(LEAST_RANGE_M);
    let [right, up, _] = sky_axes(los_to_az_el(DVec3::new(to_m.x, to_m.y, to_m.z)));
    let seen = to_vector(az_el_to_los(bearing.az_el_rad));
    let jacobian = Matrix2x3::from_rows(&[right.transpose(), up.transpose()]) / range_m;
    (Vector2::new(right.dot(&seen), up.dot(&seen)), jacobian)
}

/// Where two directions meet [m], with the covariance [m²], if they meet: within four deviations of each other and
/// not so nearly parallel that the range along the first stays open by more than a quarter. The target
/// may have moved so far [m] from the one exposure to the other, as a standard deviation.
pub fn crossing(a: &Bearing, b: &Bearing, moved_m: f64) -> Option<(DVec3, Matrix3<f64>)> {
    const STEPS: usize = 4;
    const MEETS2: f64 = 16.0;
    const SHARPEST_REL: f64 = 0.25;
    let ([u, v], base_m) = (
        [a, b].map(|bearing| az_el_to_los(bearing.az_el_rad)),
        b.r_from_enu_m - a.r_from_enu_m,
    );
    // The nearest points of the two lines.
    let (uv, sin2) = (u.dot(v), u.cross(v).length_squared());
    if sin2 < 1e-8 {
        return None;
    }
    let along_u_m = (base_m.dot(u) - uv * base_m.dot(v)) / sin2;
    let along_v_m = (uv * base_m.dot(u) - base_m.dot(v)) / sin2;
    if along_u_m < LEAST_RANGE_M || along_v_m < LEAST_RANGE_M {
        return None;
    }
    let mut r_enu_m =
        to_vector(0.5 * (a.r_from_enu_m + along_u_m * u + b.r_from_enu_m + along_v_m * v));
    let (mut covariance, mut misfit) = (Matrix3::zeros(), 0.0);
    for _ in 0..STEPS {
        let (mut information, mut gradient) = (Matrix3::<f64>::zeros(), Vector3::zeros());
        misfit = 0.0;
        for bearing in [a, b] {
            let (residual, h) = against(bearing, r_enu_m);
            let range_m = (r_enu_m - to_vector(bearing.r_from_enu_m)).norm();
            let variance = bearing.sigma_rad.powi(2) + 0.5 * (moved_m / range_m).powi(2);
            information += h.transpose() * h / variance;
            gradient += h.transpose() * residual / variance;
            misfit += residual.norm_squared() / variance;
        }
        covariance = information.try_inverse()?;
        r_enu_m += covariance * gradient;
    }
    let r_enu_m = DVec3::new(r_enu_m.x, r_enu_m.y, r_enu_m.z);
    let along = to_vector((r_enu_m - a.r_from_enu_m).normalize());
    let range_sigma_m = along.dot(&(covariance * along)).max(0.0).sqrt();
    let sharp = range_sigma_m < SHARPEST_REL * r_enu_m.distance(a.r_from_enu_m);
    (misfit < MEETS2 && sharp).then_some((r_enu_m, covariance))
}

impl CartesianTrack {
    /// Starts a track at a position [m] with a covariance [m²].
    pub fn start(t_s: f64, r_enu_m: DVec3, covariance_m2: &Matrix3<f64>) -> Self {
        let mut x = Vector6::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&to_vector(r_enu_m));
        let mut p = Matrix6::zeros();
        p.fixed_view_mut::<3, 3>(0, 0).copy_from(covariance_m2);
        for (axis, sigma) in FIRST_VELOCITY_SIGMA_MPS.into_iter().enumerate() {
            p[(3 + axis, 3 + axis)] = sigma * sigma;
        }
        Self {
            t_s,
            x,
            p,
            acceleration_psd: ACCELERATION_PSD,
        }
    }

    /// From now on its target falls.
    pub fn falls(&mut self) {
        self.acceleration_psd = FALLING_PSD;
    }

    /// The track at `t_s` [s], not before its last measurement.
    pub fn advanced(&self, t_s: f64) -> Self {
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
        Self {
            t_s: self.t_s.max(t_s),
            x: f * self.x,
            p: f * self.p * f.transpose() + q * self.acceleration_psd,
            ..*self
        }
    }

    /// The same in a frame whose axes are turned and then shifted by so much [m], by a clock that is so far ahead [s].
    pub fn in_frame(&self, turned: &Matrix3<f64>, shift_m: Vector3<f64>, ahead_s: f64) -> Self {
        let mut both = Matrix6::zeros();
        both.fixed_view_mut::<3, 3>(0, 0).copy_from(turned);
        both.fixed_view_mut::<3, 3>(3, 3).copy_from(turned);
        let mut x = both * self.x;
        let r_m = x.fixed_rows::<3>(0) + shift_m;
        x.fixed_rows_mut::<3>(0).copy_from(&r_m);
        Self {
            t_s: self.t_s + ahead_s,
            x,
            p: both * self.p * both.transpose(),
            ..*self
        }
    }

    /// Time of its last measurement [s].
    pub fn t_s(&self) -> f64 {
        self.t_s
    }

    /// Position [m] and velocity [m/s].
    pub fn motion_enu(&self) -> (DVec3, DVec3) {
        let x = &self.x;
        (DVec3::new(x[0], x[1], x[2]), DVec3::new(x[3], x[4], x[5]))
    }

    /// Standard deviation of the position, root of the sum over the axes [m].
    pub fn sigma_m(&self) -> f64 {
        (0..3).map(|axis| self.p[(axis, axis)]).sum::<f64>().sqrt()
    }

    /// Squared distance of the state from a true position [m] and velocity [m/s] in units of its covariance: six
    /// degrees of freedom.
    pub fn distance2(&self, r_enu_m: DVec3, v_enu_mps: DVec3) -> f64 {
        let truth = [to_vector(r_enu_m), to_vector(v_enu_mps)];
        let off = Vector6::from_iterator(truth.iter().flatten().copied()) - self.x;
        distance2(&off, &self.p)
    }

    /// Squared distance from another track of the same time in units of both covariances: six degrees of freedom.
    pub fn apart2(&self, other: &Self) -> f64 {
        distance2(&(self.x - other.x), &(self.p + other.p))
    }

    /// Takes in a position [m] with its covariance [m²], measured at `t_s` [s].
    pub fn take_position(&mut self, t_s: f64, r_enu_m: DVec3, covariance_m2: &Matrix3<f64>) {
        let position = SMatrix::<f64, 3, 6>::from_fn(|i, j| f64::from(u8::from(i == j)));
        let track = self.advanced(t_s);
        let innovation = to_vector(r_enu_m) - track.x.fixed_rows::<3>(0);
        *self = track.corrected(&innovation, &position, covariance_m2);
    }

    /// Takes in a direction seen at `t_s` [s].
    pub fn take_bearing(&mut self, t_s: f64, bearing: &Bearing) {
        let track = self.advanced(t_s);
        let (residual, h, noise) = track.seen_as(bearing);
        *self = track.corrected(&residual, &h, &noise);
    }

    /// Takes in a range [m] with its standard deviation [m], measured from a place at `t_s` [s].
    pub fn take_range(&mut self, t_s: f64, r_from_enu_m: DVec3, range_m: f64, sigma_m: f64) {
        let track = self.advanced(t_s);
        let to_m = track.x.fixed_rows::<3>(0) - to_vector(r_from_enu_m);
        let expected_m = to_m.norm().max(LEAST_RANGE_M);
        let mut h = SMatrix::<f64, 1, 6>::zeros();
        h.fixed_view_mut::<1, 3>(0, 0)
            .copy_from(&(to_m.transpose() / expected_m));
        let innovation = SMatrix::<f64, 1, 1>::new(range_m - expected_m);
        *self = track.corrected(
            &innovation,
            &h,
            &SMatrix::<f64, 1, 1>::new(sigma_m * sigma_m),
        );
    }

    /// Squared distance of a direction seen at `t_s` [s] from where the track expects it: two degrees of freedom.
    pub fn bearing_distance2(&self, t_s: f64, bearing: &Bearing) -> f64 {
        let track = self.advanced(t_s);
        let (residual, h, noise) = track.seen_as(bearing);
        distance2(&residual, &(h * track.p * h.transpose() + noise))
    }

    /// Squared distance of a position measured at `t_s` [s] from where the track expects it: three degrees of freedom.
    pub fn position_distance2(
        &self,
        t_s: f64,
        r_enu_m: DVec3,
        covariance_m2: &Matrix3<f64>,
    ) -> f64 {
        let track = self.advanced(t_s);
        let off = to_vector(r_enu_m) - track.x.fixed_rows::<3>(0);
        distance2(&off, &(track.p.fixed_view::<3, 3>(0, 0) + covariance_m2))
    }

    /// A direction's residual, how it depends on the state, and its noise.
    fn seen_as(&self, bearing: &Bearing) -> (Vector2<f64>, SMatrix<f64, 2, 6>, Matrix2<f64>) {
        let (residual, of_position) = against(bearing, self.x.fixed_rows::<3>(0).into());
        let mut h = SMatrix::<f64, 2, 6>::zeros();
        h.fixed_view_mut::<2, 3>(0, 0).copy_from(&of_position);
        (residual, h, Matrix2::identity() * bearing.sigma_rad.powi(2))
    }

    /// The state after a measurement with this innovation, dependence on the state and noise.
    fn corrected<const N: usize>(
        &self,
        innovation: &SMatrix<f64, N, 1>,
        h: &SMatrix<f64, N, 6>,
        noise: &SMatrix<f64, N, N>,
    ) -> Self {
        let cross = self.p * h.transpose();
        // The noise is positive definite, and so is the sum.
        let Some(inverse) = (h * cross + noise).try_inverse() else {
            return *self;
        };
        let gain = cross * inverse;
        let p = self.p - gain * cross.transpose();
        Self {
            x: self.x + gain * innovation,
            p: (p + p.transpose()) * 0.5,
            ..*self
        }
    }

    /// Where the target is at `t_s` [s] as seen from a place [m] (an earlier time than the last measurement's gives
    /// that one).
    pub fn cue(&self, r_from_enu_m: DVec3, t_s: f64) -> TargetCue {
        let Self { x, p, .. } = self.advanced(t_s);
        let r_m = DVec3::new(x[0], x[1], x[2]) - r_from_enu_m;
        let range_m = r_m.length().max(LEAST_RANGE_M);
        let az_el_rad = los_to_az_el(r_m);
        let [right, up, along] = sky_axes(az_el_rad);
        let (position, velocity) = (p.fixed_view::<3, 3>(0, 0), p.fixed_view::<3, 3>(3, 3));
        let sigma = |of: Matrix3<f64>, axis: Vector3<f64>| axis.dot(&(of * axis)).max(0.0).sqrt();
        let sky = |of: Matrix3<f64>| DVec2::new(sigma(of, right), sigma(of, up)) / range_m;
        let v_mps: Vector3<f64> = x.fixed_rows::<3>(3).into();
        TargetCue {
            az_el_rad,
            sigma_rad: sky(position.into()),
            range_m,
            range_sigma_m: sigma(position.into(), along),
            rate_radps: DVec2::new(v_mps.dot(&right), v_mps.dot(&up)) / range_m,
            rate_sigma_radps: sky(velocity.into()),
        }
    }
}

/// Squared length in units of a covariance; infinite for one that is singular.
fn distance2<const N: usize>(off: &SMatrix<f64, N, 1>, covariance: &SMatrix<f64, N, N>) -> f64 {
    covariance
        .try_inverse()
        .map_or(f64::INFINITY, |inverse| off.dot(&(inverse * off)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;
    use std::f64::consts::PI;

    const STATIONS: [DVec3; 2] = [DVec3::ZERO, DVec3::new(320.0, -60.0, 10.0)];
    /// Half a pixel of a coarse camera [rad].
    const SIGMA_RAD: f64 = 4e-5;
    /// From one report to the next [s].
    const REPORT_S: f64 = 0.05;

    fn bearing(from: usize, r_enu_m: DVec3, rng: &mut Stream) -> Bearing {
        let noise = rng.normal3() * SIGMA_RAD;
        let at = los_to_az_el(r_enu_m - STATIONS[from]);
        Bearing {
            r_from_enu_m: STATIONS[from],
            az_el_rad: at + DVec2::new(noise.x / at.y.cos(), noise.y),
            sigma_rad: SIGMA_RAD,
        }
    }

    /// What a run showed at its end.
    struct Ended {
        /// Squared error of the state in units of its covariance.
        nees: f64,
        /// Error of the range from the first station, and its Cramér–Rao bound [m].
        range_error_m: f64,
        bound_m: f64,
    }

    /// A target that flies as the filter assumes, seen for 3 s by two stations whose measurements are lost as often
    /// as this.
    fn run(seed: u64, loss: f64) -> Ended {
        let mut rng = Stream::new(seed, 0, "cartesian");
        let mut r = DVec3::new(-250.0, 680.0, 90.0);
        let mut v = DVec3::from(FIRST_VELOCITY_SIGMA_MPS) * rng.normal3();
        let (a, b) = (bearing(0, r, &mut rng), bearing(1, r, &mut rng));
        let (at, covariance) = crossing(&a, &b, 0.0).unwrap();
        let mut track = CartesianTrack::start(0.0, at, &covariance);
        // The bound of posterior estimates (P. Tichavský et al., 1998, eq. 21): for a linear motion it is the
        // filter's own recursion with the measurements linearised at the truth.
        let (_, truth) = crossing_bound(r);
        let mut bound = CartesianTrack::start(0.0, r, &truth);
        let steps = 12; // between reports
        let dt = REPORT_S / f64::from(steps);
        for k in 1..=60 {
            for _ in 0..steps {
                // White acceleration over dt: velocity and position are correlated.
                let (kick, push) = (rng.normal3(), rng.normal3());
                let root = (ACCELERATION_PSD * dt).sqrt();
                r += v * dt + root * dt * (0.5 * kick + push / 12f64.sqrt());
                v += root * kick;
            }
            let t = f64::from(k) * REPORT_S;
            for (from, station) in STATIONS.into_iter().enumerate() {
                let seen = bearing(from, r, &mut rng);
                if rng.uniform() < loss {
                    continue;
                }
                track.take_bearing(t, &seen);
                let mut exact = bound.advanced(t);
                (exact.x[0], exact.x[1], exact.x[2]) = (r.x, r.y, r.z);
                bound = exact;
                let az_el_rad = los_to_az_el(r - station);
                bound.take_bearing(t, &Bearing { az_el_rad, ..seen });
            }
        }
        let t = 60.0 * REPORT_S;
        let along = |cue: TargetCue| cue.range_sigma_m;
        Ended {
            nees: track.advanced(t).distance2(r, v),
            range_error_m: track.cue(STATIONS[0], t).range_m - (r - STATIONS[0]).length(),
            bound_m: along(bound.cue(STATIONS[0], t)),
        }
    }

    /// Where the exact directions to a target meet, and the covariance of that.
    fn crossing_bound(r_enu_m: DVec3) -> (DVec3, Matrix3<f64>) {
        let exact = |from: usize| Bearing {
            r_from_enu_m: STATIONS[from],
            az_el_rad: los_to_az_el(r_enu_m - STATIONS[from]),
            sigma_rad: SIGMA_RAD,
        };
        crossing(&exact(0), &exact(1), 0.0).unwrap()
    }

    #[test]
    fn two_stations_know_their_error_and_reach_the_bound() {
        for loss in [0.0, 0.3] {
            let n = 200;
            let runs: Vec<Ended> = (0..n).map(|seed| run(seed, loss)).collect();
            let nees = runs.iter().map(|run| run.nees).sum::<f64>() / n as f64;
            // χ² of six degrees of freedom: the mean of 200 lies 95 times in 100 within 6 ± 1.96·√(12/200).
            assert!((nees - 6.0).abs() < 0.48, "{loss}: {nees}");
            let mean2 = |of: fn(&Ended) -> f64| {
                (runs.iter().map(|run| of(run).powi(2)).sum::<f64>() / n as f64).sqrt()
            };
            let (rms_m, bound_m) = (mean2(|run| run.range_error_m), mean2(|run| run.bound_m));
            println!("loss {loss}: NEES {nees:.2}, range {rms_m:.3} m, bound {bound_m:.3} m");
            // A standard deviation from 200 runs is good to 5 %: two of those to either side.
            assert!(
                (rms_m / bound_m - 1.0).abs() < 0.1,
                "{loss}: {rms_m} {bound_m}"
            );
        }
    }

    #[test]
    fn directions_cross_where_the_target_is() {
        let r = DVec3::new(-250.0, 680.0, 90.0);
        let (at, covariance) = crossing_bound(r);
        assert!(at.distance(r) < 1e-6);
        // Across the base of 326 m, at some 720 m: σ R/(B sin) of either direction.
        let sigma_m = covariance.trace().sqrt();
        assert!((0.03..0.2).contains(&sigma_m), "{sigma_m}");
        let mut rng = Stream::new(3, 0, "crossing");
        let missed = |off_m: f64, rng: &mut Stream| {
            let (a, b) = (bearing(0, r, rng), bearing(1, r + DVec3::Z * off_m, rng));
            crossing(&a, &b, 0.0).is_none()
        };
        assert!((0..50).all(|_| missed(1.0, &mut rng)));
        assert!((0..200).filter(|_| missed(0.0, &mut rng)).count() < 5);
        // A metre of flight between the exposures explains it.
        let (a, b) = (bearing(0, r, &mut rng), bearing(1, r + DVec3::Z, &mut rng));
        assert!(crossing(&a, &b, 1.0).is_some());
        // Along the base the range stays open, and behind a station nothing is seen.
        let along = STATIONS[1] * 3.0;
        let (a, b) = (bearing(0, along, &mut rng), bearing(1, along, &mut rng));
        assert!(crossing(&a, &b, 0.0).is_none());
        let behind = Bearing {
            az_el_rad: a.az_el_rad + DVec2::new(PI, 0.0),
            ..bearing(0, r, &mut rng)
        };
        assert!(crossing(&behind, &bearing(1, r, &mut rng), 0.0).is_none());
    }

    #[test]
    fn a_range_is_taken_in_along_the_line_of_sight() {
        let r = DVec3::new(0.0, 800.0, 0.0);
        let covariance = Matrix3::identity() * 100.0;
        let mut track = CartesianTrack::start(0.0, r, &covariance);
        track.take_range(0.0, DVec3::ZERO, 810.0, 0.1);
        let cue = track.cue(DVec3::ZERO, 0.0);
        assert!((cue.range_m - 810.0).abs() < 0.01 && (cue.range_sigma_m - 0.1).abs() < 1e-3);
        assert!((cue.sigma_rad * cue.range_m - 10.0).abs().max_element() < 0.01);
    }
}
