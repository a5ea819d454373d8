//! A coarse horizon about a point: what lies behind it need not be loaded for a view from there.

use crate::tiles::selection::{Occluder, View};
use crate::tiles::volume::Bounds;
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// The horizon about an eye, by azimuth and distance: of all that stands nearer than a distance the steepest. It
/// is as coarse as its steps: what shows only through a gap between two azimuths counts as hidden.
#[derive(Clone, Debug)]
pub struct Horizon {
    eye_root_m: DVec3,
    axes: DMat3,
    azimuths: usize,
    step_m: f64,
    /// Steepest slope (height over distance) within so many steps, azimuth by azimuth.
    slopes: Vec<f64>,
    steps: usize,
}

impl Horizon {
    /// The horizon about an eye. `axes` are east, north and up in the tree's frame, as columns; `height_m` says how
    /// high something solid stands at an offset east and north of the eye, above the eye [m].
    pub fn new(
        eye_root_m: DVec3,
        axes: DMat3,
        azimuths: usize,
        step_m: f64,
        steps: usize,
        height_m: &dyn Fn(f64, f64) -> f64,
    ) -> Self {
        let mut slopes = Vec::with_capacity(azimuths * steps);
        for azimuth in 0..azimuths {
            let (sin, cos) = (TAU * azimuth as f64 / azimuths as f64).sin_cos();
            let mut steepest = f64::NEG_INFINITY;
            for step in 1..=steps {
                let distance_m = step as f64 * step_m;
                steepest = steepest.max(height_m(distance_m * sin, distance_m * cos) / distance_m);
                slopes.push(steepest);
            }
        }
        Self {
            eye_root_m,
            axes,
            azimuths,
            step_m,
            slopes,
            steps,
        }
    }

    /// Whether it is that of an eye here: within half a step of its own.
    pub fn holds(&self, r_root_m: DVec3) -> bool {
        r_root_m.distance(self.eye_root_m) <= 0.5 * self.step_m
    }
}

impl Occluder for Horizon {
    fn hides(&self, view: &View, bounds: &Bounds) -> bool {
        if !self.holds(view.r_root_m) || self.azimuths == 0 {
            return false;
        }
        let center = self.axes.transpose() * (bounds.center_m - self.eye_root_m);
        let (distance_m, radius_m) = (center.truncate().length(), bounds.radius_m());
        let nearest_m = distance_m - radius_m;
        let before = ((nearest_m / self.step_m).floor().max(0.0) as usize).min(self.steps);
        if before == 0 {
            return false;
        }
        let top_m = center.z + bounds.reach_m(self.axes.z_axis);
        let top = top_m
            / if top_m > 0.0 {
                nearest_m
            } else {
                distance_m + radius_m
            };
        let bin = TAU / self.azimuths as f64;
        let middle = center.x.atan2(center.y);
        let spread = (radius_m / distance_m).asin();
        let first = ((middle - spread) / bin).floor() as i64;
        let last = ((middle + spread) / bin).ceil() as i64;
        (first..=last).all(|i| {
            let azimuth = i.rem_euclid(self.azimuths as i64) as usize;
            self.slopes[azimuth * self.steps + before - 1] > top
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tiles::volume::BoundingVolume;
    use glam::DAffine3;

    /// A wall 20 m above the eye, 100 m north of it, 200 m long.
    fn wall() -> Horizon {
        let height = |east: f64, north: f64| {
            let on = (95.0..105.0).contains(&north) && east.abs() < 100.0;
            if on { 20.0 } else { -10.0 }
        };
        Horizon::new(DVec3::ZERO, DMat3::IDENTITY, 720, 5.0, 400, &height)
    }

    fn hides(east: f64, north: f64, up: f64) -> bool {
        let view = View {
            r_root_m: DVec3::ZERO,
            forward: DVec3::Y,
            up: DVec3::Z,
            fovy_rad: 1.0,
            size_px: [640, 480],
        };
        let ball = BoundingVolume::Sphere {
            center_m: DVec3::new(east, north, up),
            radius_m: 10.0,
        };
        wall().hides(&view, &Bounds::of(&ball, &DAffine3::IDENTITY))
    }

    #[test]
    fn a_wall_hides_what_is_behind_and_below_its_edge() {
        assert!(hides(0.0, 500.0, 0.0));
        // Its edge is seen 20 m up at 100 m: 98 m up at 490 m.
        assert!(hides(0.0, 500.0, 80.0) && !hides(0.0, 500.0, 95.0));
        assert!(!hides(0.0, 50.0, 0.0) && !hides(0.0, 105.0, 0.0));
        assert!(!hides(0.0, -500.0, 0.0) && !hides(600.0, 500.0, 0.0));
        // Half of it beside the wall.
        assert!(!hides(500.0, 500.0, 0.0));
    }
}
