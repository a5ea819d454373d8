//! A laser beam in scattering air as a camera sees it: a veil where the camera looks along it, a streak from aside.
//!
//! An element dt of the beam at the distance D from the camera sends P T(t) β(θ) T(D) dt / D² [W/m²] to the lens, the
//! lidar equation without its range gate. Its image is a Gaussian of the angular variance s²/D², with
//! s² = W²/4 + d²/16 + (b D)²: the beam of the 1/e² radius W, a lens of the diameter d that is focused at infinity (a disc
//! has the variance d²/16 along each axis), and the blur b [rad]. The radiance along a ray that passes the element at the
//! distance m is therefore
//!
//! L = ∫ P T(t) T(D) β(θ) exp(-m(t)²/(2 s²)) / (2π s²) dt,
//!
//! without D: near elements are bright and wide. m² is a quadratic in t. On pieces of the beam, s is taken as at
//! the nearest point and the rest is linear; the integral of such a piece is exact.
//!
//! For a beam of constant width whose camera looks along its axis, L = P β/(2π s²) (1 - e^(-2αR))/(2α).

use super::scatter::ScatteringAir;
use crate::laser::beam::Laser;
use glam::DVec3;
use libm::erf;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Pieces of a beam; the longest of one of 5 km is a tenth of its distance from the laser.
const PIECES: usize = 96;
/// Length of the first pieces [m].
const FIRST_M: f64 = 0.5;
/// Exponent beyond which a piece is not seen: 1e-7 of its peak.
const UNSEEN: f64 = 16.0;
/// Change of the exponent on a piece below which Simpson's rule serves, to 1.5e-2 of its light.
const SMOOTH: f64 = 0.5;

/// A beam and how a camera stands to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamSight {
    /// The laser.
    pub laser: Laser,
    /// Range that it is focused at [m]; infinite: collimated.
    pub focus_m: f64,
    /// Range at which the beam ends [m].
    pub end_m: f64,
    /// The air.
    pub air: ScatteringAir,
    /// Where it leaves its aperture, in the camera's axes [m].
    pub exit_cam_m: DVec3,
    /// Its direction, in the camera's axes, unit.
    pub axis_cam: DVec3,
    /// Diameter of the camera's lens [m].
    pub lens_m: f64,
    /// Standard deviation of the camera's blur [rad].
    pub blur_rad: f64,
}

impl BeamSight {
    /// What the radiance along no ray exceeds [W/(m² sr)]: all of the beam in one place, at its narrowest, without losses.
    /// `is_beside`: the camera stands beside the laser, so that light is turned back to it.
    pub fn most_wpm2sr(&self, is_beside: bool) -> f64 {
        let turned = if is_beside { [-1.0, 0.0] } else { [-1.0, 1.0] };
        let per_m_sr = turned.map(|cos| self.air.per_m_sr(cos));
        let narrowest_m = self.focus_m.min(self.end_m);
        let radius_m =
            (self.laser.spot_radius_m(narrowest_m, self.focus_m)).min(self.laser.aperture_radius_m);
        let variance_m2 = 0.25 * radius_m.powi(2) + self.lens_m.powi(2) / 16.0;
        let along_wpsr = self.laser.power_w * per_m_sr[0].max(per_m_sr[1]) * self.end_m;
        along_wpsr / (2.0 * PI * variance_m2)
    }

    /// The same as the camera beside the laser shows it once the station has taken their parallax out at `range_m` [m]: a
    /// place of the beam there is seen where a camera at the exit would see it.
    pub fn converged(self, range_m: f64) -> Self {
        let there_m = self.exit_cam_m + range_m * self.axis_cam;
        if !range_m.is_finite() || there_m.length() <= 0.0 {
            return self;
        }
        let turn = glam::DQuat::from_rotation_arc(there_m.normalize(), self.axis_cam);
        Self {
            exit_cam_m: turn * self.exit_cam_m,
            axis_cam: turn * self.axis_cam,
            ..self
        }
    }
}

/// A point of the beam, and the piece of it that begins there.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    /// Distance from the exit [m].
    along_m: f64,
    /// Radiant intensity of a metre towards the camera, less the losses to it: P T β T [W/(m sr)].
    weight_wpmsr: f64,
    /// Variance s² [m²], and that in the middle of the piece.
    variance_m2: f64,
    middle_m2: f64,
    /// Whether the piece is seen.
    seen: bool,
}

/// A beam as a camera sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamLight {
    exit_cam_m: DVec3,
    axis_cam: DVec3,
    nodes: Vec<Node>,
}

impl BeamLight {
    /// The beam; `visible` says whether a place in the camera's axes [m] is hidden by nothing.
    pub fn new(sight: &BeamSight, visible: impl Fn(DVec3) -> bool) -> Self {
        let BeamSight {
            laser, air, end_m, ..
        } = sight;
        let growth = (end_m / FIRST_M).ln_1p() / PIECES as f64;
        let place = |k: usize| {
            let along_m = FIRST_M * (growth * k as f64).exp_m1();
            let r_cam_m = sight.exit_cam_m + along_m * sight.axis_cam;
            (along_m, r_cam_m)
        };
        let seen: Vec<bool> = (0..=PIECES)
            .map(|k| {
                let (_, r_cam_m) = place(k);
                // The exit of a laser beside the lens is in its plane.
                r_cam_m.z >= 0.0 && visible(r_cam_m)
            })
            .collect();
        let variance_m2 = |along_m: f64| {
            let range_m = (sight.exit_cam_m + along_m * sight.axis_cam).length();
            let radius_m = laser.spot_radius_m(along_m, sight.focus_m);
            let blur_m = sight.blur_rad * range_m;
            0.25 * radius_m.powi(2) + sight.lens_m.powi(2) / 16.0 + blur_m * blur_m
        };
        let nodes = (0..=PIECES).map(|k| {
            let (along_m, r_cam_m) = place(k);
            let range_m = r_cam_m.length();
            // The light goes on along the axis and is turned to the camera.
            let cos_turned = if range_m > 0.0 {
                -r_cam_m.dot(sight.axis_cam) / range_m
            } else {
                -1.0
            };
            let lost = (-air.extinction_per_m * (along_m + range_m)).exp();
            let next = (k + 1).min(PIECES);
            Node {
                along_m,
                weight_wpmsr: laser.power_w * lost * air.per_m_sr(cos_turned),
                variance_m2: variance_m2(along_m),
                middle_m2: variance_m2(0.5 * (along_m + place(next).0)),
                seen: seen[k] && seen[next],
            }
        });
        Self {
            exit_cam_m: sight.exit_cam_m,
            axis_cam: sight.axis_cam,
            nodes: nodes.collect(),
        }
    }

    /// Radiance [W/(m² sr)] along a unit direction in the camera's axes.
    pub fn radiance(&self, dir_cam: DVec3) -> f64 {
        // m² = a t² + 2 b t + c, the square of the distance from the ray: by cross products, exact at small angles.
        let axis = self.axis_cam.cross(dir_cam);
        let exit_m = self.exit_cam_m.cross(dir_cam);
        let ray = Ray {
            a: axis.length_squared(),
            b: axis.dot(exit_m),
            c: exit_m.length_squared(),
        };
        self.nodes
            .windows(2)
            .filter(|ends| ends[0].seen)
            .map(|ends| ray.piece(&ends[0], &ends[1]))
            .sum()
    }

    /// The greatest radiance [W/(m² sr)] that any ray can have: that of one along which nothing is missed.
    pub fn most_radiance(&self) -> f64 {
        let pieces = self.nodes.windows(2).filter(|ends| ends[0].seen);
        pieces
            .map(|ends| {
                let length_m = ends[1].along_m - ends[0].along_m;
                let weight = ends[0].weight_wpmsr.max(ends[1].weight_wpmsr);
                let variance_m2 = ends[0]
                    .variance_m2
                    .min(ends[1].variance_m2.min(ends[0].middle_m2));
                weight * length_m / (2.0 * PI * variance_m2)
            })
            .sum()
    }
}

/// The square of a ray's distance from the beam, a t² + 2 b t + c.
struct Ray {
    a: f64,
    b: f64,
    c: f64,
}

impl Ray {
    /// What a piece of the beam adds to the radiance.
    fn piece(&self, from: &Node, to: &Node) -> f64 {
        let Self { a, b, c } = *self;
        let (t0, t1) = (from.along_m, to.along_m);
        let slope = (to.weight_wpmsr - from.weight_wpmsr) / (t1 - t0);
        let weight = |t: f64| from.weight_wpmsr + slope * (t - t0);
        // A beam's width squared is a quadratic: three points hold it.
        let variance_m2 = |t: f64| {
            let u = (t - t0) / (t1 - t0);
            let v = 1.0 - u;
            from.variance_m2 * v * (v - u)
                + from.middle_m2 * 4.0 * u * v
                + to.variance_m2 * u * (u - v)
        };
        let square_m2 = |t: f64| (a * t * t + 2.0 * b * t + c).max(0.0);
        let centre = if a > 0.0 { -b / a } else { t0 };
        let nearest = centre.clamp(t0, t1);
        let widest_m2 = from.variance_m2.max(to.variance_m2);
        if 0.5 * square_m2(nearest) > UNSEEN * widest_m2 {
            return 0.0;
        }
        let middle = 0.5 * (t0 + t1);
        let [e0, em, e1] = [t0, middle, t1].map(|t| 0.5 * square_m2(t) / variance_m2(t));
        let change = (e0 - e1).abs().max((e0 - em).abs());
        if change < SMOOTH {
            let at = |t: f64, e: f64| weight(t) * (-e).exp() / variance_m2(t);
            let sum = at(t0, e0) + 4.0 * at(middle, em) + at(t1, e1);
            return sum * (t1 - t0) / (12.0 * PI);
        }
        // A Gaussian of the standard deviation tau around the nearest point, as wide as the beam is there.
        let variance_m2 = variance_m2(nearest);
        let tau = (variance_m2 / a).sqrt();
        let [x0, x1] = [t0, t1].map(|t| (t - centre) / tau);
        let least = (-0.5 * (c - b * b / a).max(0.0) / variance_m2).exp();
        let area = tau * (0.5 * PI).sqrt() * (erf(x1 * FRAC_1_SQRT_2) - erf(x0 * FRAC_1_SQRT_2));
        let [g0, g1] = [x0, x1].map(|x| (-0.5 * x * x).exp());
        let integral = weight(centre) * area + slope * tau * tau * (g0 - g1);
        (least * integral).max(0.0) / (2.0 * PI * variance_m2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AIR: ScatteringAir = ScatteringAir {
        extinction_per_m: 4e-4, // [1/m]
        particles_per_m: 3.9e-4,
        particles: super::super::scatter::URBAN,
        falling_per_m: 0.0,
        molecules_per_m: 1e-5,
    };

    fn sight(end_m: f64) -> BeamSight {
        BeamSight {
            laser: Laser {
                power_w: 800.0,
                wavelength_m: 1e-9,
                aperture_radius_m: 0.05,
                m2: 1.0,
            },
            focus_m: f64::INFINITY,
            end_m,
            air: AIR,
            exit_cam_m: DVec3::ZERO,
            axis_cam: DVec3::Z,
            lens_m: 0.045,
            blur_rad: 0.0,
        }
    }

    #[test]
    fn along_the_beam_the_veil_is_the_lidar_equations() {
        for end_m in [50.0, 1_000.0, 5_000.0] {
            let found = BeamLight::new(&sight(end_m), |_| true).radiance(DVec3::Z);
            let variance_m2 = 0.05 * 0.05 / 4.0 + 0.045 * 0.045 / 16.0;
            let back = AIR.per_m_sr(-1.0);
            let twice = 2.0 * AIR.extinction_per_m;
            let expected =
                800.0 * back / (2.0 * PI * variance_m2) * (1.0 - (-twice * end_m).exp()) / twice;
            assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        }
    }

    /// All of the image together is the lidar equation's power: P β A T² dz / z², from where the lens sees the beam whole.
    #[test]
    fn the_picture_holds_the_power_that_comes_back() {
        let whole = BeamLight::new(&sight(1_000.0), |_| true);
        // Less what is nearer than 200 m, which fills the sky.
        let near = BeamLight::new(&sight(200.0), |_| true);
        let (mut sum, rings) = (0.0, 4_000);
        let most_rad = 2e-3;
        for i in 0..rings {
            let theta = most_rad * (f64::from(i) + 0.5) / f64::from(rings);
            let dir = DVec3::new(theta.sin(), 0.0, theta.cos());
            let ring_sr = 2.0 * PI * theta * most_rad / f64::from(rings);
            sum += ring_sr * (whole.radiance(dir) - near.radiance(dir));
        }
        let expected: f64 = (0..8_000)
            .map(|i| {
                let z = 200.0 + 0.1 * (f64::from(i) + 0.5);
                800.0 * AIR.per_m_sr(-1.0) * (-2.0 * AIR.extinction_per_m * z).exp() / (z * z) * 0.1
            })
            .sum();
        assert!((sum / expected - 1.0).abs() < 0.01, "{sum} {expected}");
    }

    /// Direct summation over 200,000 elements of the beam, each a blob of its own width, weight and distance.
    fn summed(sight: &BeamSight, dir: DVec3) -> f64 {
        let count = 200_000;
        let step = sight.end_m / f64::from(count);
        (0..count)
            .map(|i| {
                let t = (f64::from(i) + 0.5) * step;
                let r = sight.exit_cam_m + t * sight.axis_cam;
                let range = r.length();
                let miss = (r - r.dot(dir) * dir).length();
                let radius = sight.laser.spot_radius_m(t, sight.focus_m);
                let s2 = 0.25 * radius * radius
                    + sight.lens_m.powi(2) / 16.0
                    + (sight.blur_rad * range).powi(2);
                let cos = -r.dot(sight.axis_cam) / range;
                800.0
                    * AIR.per_m_sr(cos)
                    * (-AIR.extinction_per_m * (t + range)).exp()
                    * (-0.5 * miss * miss / s2).exp()
                    / (2.0 * PI * s2)
                    * step
            })
            .sum()
    }

    #[test]
    fn streaks_from_beside_and_from_afar_are_those_of_direct_summation() {
        let laser = Laser {
            wavelength_m: 1064e-9,
            m2: 1.3,
            ..sight(1.0).laser
        };
        // Beside the lens and converged at the focus; and another station's, 150 m away, that crosses the field.
        let beside = BeamSight {
            laser,
            focus_m: 900.0,
            exit_cam_m: DVec3::new(-0.3, 0.0, 0.0),
            blur_rad: 3e-5,
            ..sight(900.0)
        }
        .converged(900.0);
        let afar = BeamSight {
            laser,
            focus_m: 700.0,
            exit_cam_m: DVec3::new(-150.0, 20.0, 30.0),
            axis_cam: DVec3::new(0.35, -0.02, 0.9).normalize(),
            blur_rad: 3e-5,
            ..sight(1_200.0)
        };
        for (sight, at_m, is_beside) in [
            (beside, [5.0, 40.0, 300.0, 850.0], true),
            (afar, [150.0, 400.0, 428.0, 900.0], false),
        ] {
            let light = BeamLight::new(&sight, |_| true);
            assert!(light.most_radiance() < sight.most_wpm2sr(is_beside));
            for along_m in at_m {
                for off_m in [0.0, 0.02, 0.05] {
                    let r = sight.exit_cam_m + along_m * sight.axis_cam;
                    let dir = (r + off_m * sight.axis_cam.cross(DVec3::X)).normalize();
                    let (found, expected) = (light.radiance(dir), summed(&sight, dir));
                    assert!(
                        (found / expected - 1.0).abs() < 0.04,
                        "{along_m} m, {off_m} m aside: {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_camera_aside_looks_past_the_near_beam_at_its_target() {
        let beside = |offset_m: f64| {
            let sight = BeamSight {
                exit_cam_m: DVec3::new(-offset_m, 0.0, 0.0),
                ..sight(1_000.0)
            };
            BeamLight::new(&sight.converged(1_000.0), |_| true).radiance(DVec3::Z)
        };
        // Only the last 2 s/d of the way is within the beam's width of the ray: half a Gaussian, sqrt(pi/2) s R/d.
        let s = (0.05f64 * 0.05 / 4.0 + 0.045 * 0.045 / 16.0).sqrt();
        let weight = 800.0 * AIR.per_m_sr(-1.0) * (-2.0 * AIR.extinction_per_m * 1_000.0).exp();
        let expected = weight / (2.0 * PI * s * s) * (0.5 * PI).sqrt() * s * 1_000.0;
        assert!(
            (beside(1.0) / expected - 1.0).abs() < 0.05,
            "{}",
            beside(1.0)
        );
        assert!(beside(0.0) > 20.0 * beside(1.0));
    }

    #[test]
    fn what_is_hidden_or_without_power_adds_nothing() {
        assert_eq!(
            BeamLight::new(&sight(1_000.0), |_| false).radiance(DVec3::Z),
            0.0
        );
        let mut dark = sight(1_000.0);
        dark.laser.power_w = 0.0;
        assert_eq!(BeamLight::new(&dark, |_| true).radiance(DVec3::Z), 0.0);
        let light = BeamLight::new(&sight(1_000.0), |_| true);
        assert!(light.most_radiance() >= light.radiance(DVec3::Z));
    }
}
