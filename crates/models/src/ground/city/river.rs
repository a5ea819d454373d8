//! The course of the river.

use glam::DVec2;

use crate::maths::rng::Stream;

/// Level of the river above the plain [m]; it runs between low walls.
pub(super) const WATER_M: f64 = 0.25;

/// A river whose course is a sine about a line of equal north coordinate.
#[derive(Clone, Debug)]
pub(super) struct River {
    /// North coordinate of the middle of its course [m].
    center_n_m: f64,
    /// How far it swings to either side [m].
    swing_m: f64,
    /// Where in its swing it meets e = 0 [rad].
    phase: f64,
    /// Half the width of the water [m].
    pub half_width_m: f64,
}

impl River {
    /// Length over which its swing turns by a radian [m].
    const WAVE_M: f64 = 420.0;

    /// A river across a built square of side `extent_m` [m], drawn from `rng`.
    pub fn drawn(extent_m: f64, rng: &mut Stream) -> Self {
        Self {
            center_n_m: 0.2 * extent_m,
            swing_m: 0.03 * extent_m,
            phase: rng.range(0.0, std::f64::consts::TAU),
            half_width_m: rng.range(30.0, 38.0),
        }
    }

    /// North coordinate of the centre line [m] at an east coordinate [m].
    pub fn north_m(&self, e: f64) -> f64 {
        self.center_n_m + self.swing_m * (e / Self::WAVE_M + self.phase).sin()
    }

    /// Slope dn/de of the course.
    fn slope(&self, e: f64) -> f64 {
        self.swing_m / Self::WAVE_M * (e / Self::WAVE_M + self.phase).cos()
    }

    /// Unit normal of the river's course, pointing north.
    pub fn normal(&self, e: f64) -> DVec2 {
        DVec2::new(-self.slope(e), 1.0).normalize()
    }

    /// A point `off_m` [m] north of the centre line, square to the course.
    pub fn beside(&self, e: f64, off_m: f64) -> DVec2 {
        DVec2::new(e, self.north_m(e)) + self.normal(e) * off_m
    }

    /// Distance to the centre line [m], positive north of it.
    pub fn offset_m(&self, p: DVec2) -> f64 {
        (p.y - self.north_m(p.x)) * self.normal(p.x).y
    }
}
