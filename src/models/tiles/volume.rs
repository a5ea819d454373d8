//! Bounding volumes of tiles.

use glam::{DMat3, DVec3};

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
