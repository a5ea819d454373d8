//! Bounding volumes of tiles: how far a viewer is from them and whether it sees them.

use crate::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

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

/// A bounding volume in the tree's frame: a ball, or a box with perpendicular edges around what is not quite one
/// (a sheared box, a region).
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
    /// A volume, given in a frame that `to_root_m` leads out of. Radii scale with the transform's largest scale;
    /// regions are not transformed.
    pub fn of(volume: &BoundingVolume, to_root_m: &DAffine3) -> Self {
        match *volume {
            BoundingVolume::Box {
                center_m,
                half_axes_m,
            } => Self::around(
                to_root_m.transform_point3(center_m),
                to_root_m.matrix3 * half_axes_m,
            ),
            BoundingVolume::Sphere { center_m, radius_m } => Self {
                center_m: to_root_m.transform_point3(center_m),
                axes: DMat3::IDENTITY,
                half_m: DVec3::splat(radius_m * largest_scale(to_root_m)),
                ball: true,
            },
            BoundingVolume::Region {
                west_south_east_north_rad,
                height_m,
            } => region_box(west_south_east_north_rad, height_m),
        }
    }

    /// The box with perpendicular edges around a parallelepiped: along its longest half-axis, and in the plane of
    /// its two longest. A box stays what it is.
    fn around(center_m: DVec3, half_axes_m: DMat3) -> Self {
        let mut half = [half_axes_m.x_axis, half_axes_m.y_axis, half_axes_m.z_axis];
        half.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
        let first = half[0].try_normalize().unwrap_or(DVec3::X);
        let across = half[1].reject_from_normalized(first);
        // What is left of a parallel axis is rounding.
        let second = if across.length() > 1e-12 * half[1].length() {
            across.try_normalize()
        } else {
            None
        };
        let second = second.unwrap_or_else(|| first.any_orthonormal_vector());
        let axes = DMat3::from_cols(first, second, first.cross(second));
        let local = axes.transpose();
        let half_m = half.iter().map(|axis| (local * *axis).abs()).sum();
        Self {
            center_m,
            axes,
            half_m,
            ball: false,
        }
    }

    /// Distance from a point to the nearest point of the volume [m]; nought inside.
    pub fn distance_m(&self, point_m: DVec3) -> f64 {
        let from = point_m - self.center_m;
        if self.ball {
            return (from.length() - self.half_m.x).max(0.0);
        }
        let local = DVec3::new(
            self.axes.x_axis.dot(from),
            self.axes.y_axis.dot(from),
            self.axes.z_axis.dot(from),
        );
        (local.abs() - self.half_m).max(DVec3::ZERO).length()
    }

    /// Half its extent along a unit vector [m].
    pub fn reach_m(&self, along: DVec3) -> f64 {
        if self.ball {
            return self.half_m.x;
        }
        let local = DVec3::new(
            self.axes.x_axis.dot(along),
            self.axes.y_axis.dot(along),
            self.axes.z_axis.dot(along),
        );
        local.abs().dot(self.half_m)
    }

    /// Radius of the ball around it [m].
    pub fn radius_m(&self) -> f64 {
        if self.ball {
            self.half_m.x
        } else {
            self.half_m.length()
        }
    }
}

/// The largest factor by which a transform stretches one of the axes.
pub fn largest_scale(transform: &DAffine3) -> f64 {
    let m = transform.matrix3;
    (m.x_axis.length())
        .max(m.y_axis.length())
        .max(m.z_axis.length())
}

/// Width of a region from west to east [rad]; one that crosses the date line has its east below its west.
pub fn width_rad(west_rad: f64, east_rad: f64) -> f64 {
    if east_rad < west_rad {
        east_rad + TAU - west_rad
    } else {
        east_rad - west_rad
    }
}

/// The box around a region: level at the region's middle. Exact for what spans less than a right angle both ways;
/// larger ones are sampled and padded by what may lie between two samples.
fn region_box([west, south, east, north]: [f64; 4], height_m: [f64; 2]) -> Bounds {
    let width = width_rad(west, east).min(TAU);
    let (low_m, high_m) = (height_m[0].min(height_m[1]), height_m[0].max(height_m[1]));
    let (south, north) = (
        south.min(north).clamp(-FRAC_PI_2, FRAC_PI_2),
        north.max(south).clamp(-FRAC_PI_2, FRAC_PI_2),
    );
    let middle = Geodetic {
        latitude_rad: 0.5 * (south + north),
        longitude_rad: west + 0.5 * width,
        height_m: low_m,
    };
    let frame = SiteFrame::new(middle);
    let axes = DMat3::from_quat(frame.q_ecef_enu());
    let small = width < FRAC_PI_2 && north - south < FRAC_PI_2;
    // Extremes of a small one lie at its corners, at the middles of its edges and on the equator.
    let steps = if small { 2 } else { 64 };
    let along = |from: f64, span: f64| {
        (0..=steps).map(move |i| from + span * f64::from(i) / f64::from(steps))
    };
    let mut latitudes: Vec<f64> = along(south, north - south).collect();
    if south < 0.0 && north > 0.0 {
        latitudes.push(0.0);
    }
    let mut lowest = DVec3::INFINITY;
    let mut highest = DVec3::NEG_INFINITY;
    for latitude_rad in latitudes {
        for longitude_rad in along(west, width) {
            for height_m in [low_m, high_m] {
                let point = Geodetic {
                    latitude_rad,
                    longitude_rad,
                    height_m,
                };
                let local = axes.transpose() * point.to_ecef();
                lowest = lowest.min(local);
                highest = highest.max(local);
            }
        }
    }
    let mut half_m = 0.5 * (highest - lowest);
    if !small {
        // Sagitta of half a step either way, of the largest radius.
        let step = width.max(north - south).min(PI * 2.0) / f64::from(steps);
        let radius_m = 6_378_137.0 + high_m.max(0.0); // [m] equatorial radius of WGS 84
        half_m += DVec3::splat(2.0 * radius_m * (1.0 - (0.5 * step).cos()));
    }
    Bounds {
        center_m: axes * (0.5 * (lowest + highest)),
        axes,
        half_m,
        ball: false,
    }
}

/// What a camera sees: the wedge between the four planes of its picture's edges, ahead of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    eye_m: DVec3,
    /// Unit normals, inwards; the planes run through the eye.
    inward: [DVec3; 5],
}

impl Frustum {
    /// A pinhole's: tangents of half its fields of view, across and up.
    pub fn new(eye_m: DVec3, forward: DVec3, up: DVec3, tan_across: f64, tan_up: f64) -> Self {
        let forward = forward.try_normalize().unwrap_or(DVec3::X);
        let right = forward.cross(up).try_normalize();
        let right = right.unwrap_or_else(|| forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let inward = [
            forward * tan_across - right,
            forward * tan_across + right,
            forward * tan_up - up,
            forward * tan_up + up,
            forward,
        ];
        Self {
            eye_m,
            inward: inward.map(DVec3::normalize),
        }
    }

    /// Whether a volume may be seen: no plane has all of it outside. The middle and the radius [m] of the ball around it
    /// mostly tell; the volume itself is only then looked up.
    pub fn sees<'a>(
        &self,
        center_m: DVec3,
        radius_m: f64,
        volume: impl Fn() -> &'a Bounds,
    ) -> bool {
        let from = center_m - self.eye_m;
        self.inward.iter().all(|inward| {
            let depth_m = inward.dot(from);
            depth_m >= 0.0 || (depth_m >= -radius_m && depth_m >= -volume().reach_m(*inward))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec2};
    use proptest::prelude::*;

    fn unit_box() -> BoundingVolume {
        BoundingVolume::Box {
            center_m: DVec3::new(1.0, 2.0, 3.0),
            half_axes_m: DMat3::from_diagonal(DVec3::new(1.0, 4.0, 2.0)),
        }
    }

    #[test]
    fn distances_to_a_box_by_hand() {
        let bounds = Bounds::of(&unit_box(), &DAffine3::IDENTITY);
        let far = |x: f64, y: f64, z: f64| bounds.distance_m(DVec3::new(x, y, z));
        assert!(far(1.5, 5.9, 1.1) == 0.0);
        assert!((far(5.0, 2.0, 3.0) - 3.0).abs() < 1e-12);
        assert!((far(5.0, 10.0, 3.0) - 5.0).abs() < 1e-12);
        assert!((far(4.0, 8.0, 11.0) - 44f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn radii_scale_with_the_largest_scale_and_regions_not_at_all() {
        let stretch = DAffine3::from_scale(DVec3::new(2.0, 3.0, 0.5));
        let ball = BoundingVolume::Sphere {
            center_m: DVec3::ONE,
            radius_m: 2.0,
        };
        let bounds = Bounds::of(&ball, &stretch);
        assert_eq!(bounds.center_m, DVec3::new(2.0, 3.0, 0.5));
        assert!((bounds.radius_m() - 6.0).abs() < 1e-12);
        assert!((bounds.distance_m(DVec3::new(12.0, 3.0, 0.5)) - 4.0).abs() < 1e-12);
        let region = BoundingVolume::Region {
            west_south_east_north_rad: [0.1, 0.2, 0.11, 0.21],
            height_m: [0.0, 100.0],
        };
        assert_eq!(
            Bounds::of(&region, &stretch),
            Bounds::of(&region, &DAffine3::IDENTITY)
        );
    }

    #[test]
    fn flat_and_empty_boxes_are_boxes() {
        for half_axes_m in [
            DMat3::ZERO,
            DMat3::from_cols(DVec3::X, DVec3::ZERO, DVec3::ZERO),
            DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Y * 0.5),
        ] {
            let bounds = Bounds::around(DVec3::ZERO, half_axes_m);
            assert!(bounds.axes.is_finite() && (bounds.axes.determinant() - 1.0).abs() < 1e-9);
            assert!(bounds.distance_m(DVec3::new(0.0, 0.0, 5.0)) > 4.0);
        }
    }

    #[test]
    fn a_region_of_100_m_is_as_tight_as_the_ground_is_curved() {
        // Half a degree's thousandth, about 111 m and 75 m at Zürich's latitude.
        let (latitude, longitude) = (47.37f64.to_radians(), 8.54f64.to_radians());
        let step = 0.001f64.to_radians();
        let bounds = region_box(
            [longitude, latitude, longitude + step, latitude + step],
            [400.0, 450.0],
        );
        let half = bounds.half_m;
        assert!((2.0 * half.z - 50.0).abs() < 0.01, "{half}");
        assert!((2.0 * half.y - 111.2).abs() < 0.2, "{half}");
        assert!((2.0 * half.x - 75.6).abs() < 0.2, "{half}");
    }

    fn region() -> impl Strategy<Value = ([f64; 4], [f64; 2])> {
        (
            -PI..PI,
            -1.57..1.5f64,
            1e-6..6.25f64,
            1e-6..3.0f64,
            -100.0..9e3f64,
            0.0..9e3f64,
        )
            .prop_map(|(west, south, width, height, low_m, deep_m)| {
                let east = west + width;
                let east = if east > PI { east - TAU } else { east };
                let north = (south + height).min(FRAC_PI_2);
                ([west, south, east, north], [low_m, low_m + deep_m])
            })
    }

    proptest! {
        #[test]
        fn a_regions_box_holds_every_point_of_it(
            (edges, height_m) in region(), u in 0.0..1.0f64, v in 0.0..1.0f64, w in 0.0..1.0f64
        ) {
            let bounds = region_box(edges, height_m);
            let point = Geodetic {
                longitude_rad: edges[0] + u * width_rad(edges[0], edges[2]),
                latitude_rad: edges[1] + v * (edges[3] - edges[1]),
                height_m: height_m[0] + w * (height_m[1] - height_m[0]),
            };
            prop_assert!(bounds.distance_m(point.to_ecef()) < 1e-3, "{bounds:?}");
        }

        #[test]
        fn a_sheared_box_lies_in_its_bounds(
            cols in prop::array::uniform9(-5.0..5.0f64), at in prop::array::uniform3(-1.0..1.0f64)
        ) {
            let half_axes_m = DMat3::from_cols_array(&cols);
            let bounds = Bounds::around(DVec3::ONE, half_axes_m);
            let point = DVec3::ONE + half_axes_m * DVec3::from_array(at);
            prop_assert!(bounds.distance_m(point) < 1e-9);
        }

        /// Against brute force: the nearest of a lattice on a turned box is no nearer and hardly farther.
        #[test]
        fn distance_to_a_turned_box_is_that_of_its_nearest_point(
            turn in prop::array::uniform3(-3.0..3.0f64), eye in prop::array::uniform3(-20.0..20.0f64)
        ) {
            let q = DQuat::from_scaled_axis(DVec3::from_array(turn));
            let to_root = DAffine3::from_rotation_translation(q, DVec3::new(3.0, -2.0, 1.0));
            let bounds = Bounds::of(&unit_box(), &to_root);
            let eye = DVec3::from_array(eye);
            let BoundingVolume::Box { center_m, half_axes_m } = unit_box() else { unreachable!() };
            let mut nearest = f64::INFINITY;
            for i in 0..9 * 9 * 9 {
                let at = DVec3::new(f64::from(i % 9), f64::from(i / 9 % 9), f64::from(i / 81)) / 4.0 - 1.0;
                let point = to_root.transform_point3(center_m + half_axes_m * at);
                nearest = nearest.min(point.distance(eye));
            }
            let distance = bounds.distance_m(eye);
            prop_assert!(distance <= nearest + 1e-9 && nearest <= distance + 0.9);
        }

        /// Whatever lies in the picture is seen.
        #[test]
        fn a_ball_that_reaches_into_the_picture_is_seen(
            x in -1.0..1.0f64, y in -1.0..1.0f64, depth in 1.0..100.0f64, off in prop::array::uniform3(-1.0..1.0f64)
        ) {
            let tan = DVec2::new(0.4, 0.3);
            let frustum = Frustum::new(DVec3::ONE, DVec3::Y, DVec3::Z, tan.x, tan.y);
            let point = DVec3::ONE + depth * DVec3::new(x * tan.x, 1.0, y * tan.y);
            let off = DVec3::from_array(off);
            let ball = BoundingVolume::Sphere { center_m: point + off, radius_m: off.length() + 1e-9 };
            prop_assert!(sees(&frustum, &Bounds::of(&ball, &DAffine3::IDENTITY)));
        }
    }

    fn sees(frustum: &Frustum, bounds: &Bounds) -> bool {
        frustum.sees(bounds.center_m, bounds.radius_m(), || bounds)
    }

    #[test]
    fn what_is_beside_or_behind_is_not_seen() {
        let frustum = Frustum::new(DVec3::ZERO, DVec3::Y, DVec3::Z, 0.4, 0.3);
        let seen = |x: f64, y: f64, z: f64| {
            let ball = BoundingVolume::Sphere {
                center_m: DVec3::new(x, y, z),
                radius_m: 1.0,
            };
            sees(&frustum, &Bounds::of(&ball, &DAffine3::IDENTITY))
        };
        assert!(seen(0.0, 10.0, 0.0) && seen(5.0, 10.0, 0.0) && seen(0.0, -0.9, 0.0));
        assert!(!seen(5.1, 10.0, 0.0) && !seen(0.0, 10.0, 4.1) && !seen(0.0, -1.1, 0.0));
    }
}
