//! Geometry of the interlocks: what a beam along a line of sight would meet or come near.

use glam::{DVec2, DVec3};

use crate::maths::kinematics::az_el_to_los;
use crate::tracking::estimation::LosState;
use crate::tracking::table::separation_rad;

/// How far a beam that misses is followed [m].
pub const FAR_M: f64 = 20_000.0;

/// A region that the beam never enters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Zone {
    /// A block of directions from the station.
    Sector {
        /// Azimuths from, to, clockwise [rad]; from > to passes through north.
        azimuth_rad: [f64; 2],
        /// Elevations from, to [rad].
        elevation_rad: [f64; 2],
    },
    /// Everything near a straight route, such as an aircraft corridor: a capsule.
    Route {
        /// One end of the route [m].
        from_enu_m: DVec3,
        /// Its other end [m].
        to_enu_m: DVec3,
        /// Protected distance around it [m].
        radius_m: f64,
    },
}

impl Zone {
    /// Whether a beam from `r_enu_m` [m] along a direction (azimuth, elevation), followed for
    /// `far_m` [m], comes into the zone.
    pub fn meets(&self, r_enu_m: DVec3, az_el_rad: DVec2, far_m: f64) -> bool {
        use std::f64::consts::TAU;
        match *self {
            Self::Sector {
                azimuth_rad: [from, to],
                elevation_rad: [low, high],
            } => {
                let span = (to - from).rem_euclid(TAU);
                // A zone from 0 to 360 degrees is the whole circle.
                let whole = span == 0.0 && from != to;
                let inside = whole || (az_el_rad.x - from).rem_euclid(TAU) <= span;
                inside && (low..=high).contains(&az_el_rad.y)
            }
            Self::Route {
                from_enu_m,
                to_enu_m,
                radius_m,
            } => {
                let end_enu_m = r_enu_m + far_m * az_el_to_los(az_el_rad);
                segment_distance_m([r_enu_m, end_enu_m], [from_enu_m, to_enu_m]) < radius_m
            }
        }
    }
}

/// Least distance of two segments [m], each given by its ends [m] (Ericson, "Real-Time Collision
/// Detection", 2005, sec. 5.1.9); a segment may be a point.
pub fn segment_distance_m([a0, a1]: [DVec3; 2], [b0, b1]: [DVec3; 2]) -> f64 {
    let (along_a, along_b, apart) = (a1 - a0, b1 - b0, a0 - b0);
    let (aa, bb) = (along_a.length_squared(), along_b.length_squared());
    let (ab, ac, bc) = (along_a.dot(along_b), along_a.dot(apart), along_b.dot(apart));
    // The point of a segment nearest to another point, as a share of its length.
    let share = |dot: f64, square: f64| {
        if square > 0.0 {
            (dot / square).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    // Nearest points of the two lines; parallel ones are near everywhere: start anywhere.
    let s = share(ab * bc - ac * bb, aa * bb - ab * ab);
    let t = share(ab * s + bc, bb);
    // Where t was cut off, the nearest point of the first segment is another one.
    let s = share(ab * t - ac, aa);
    (apart + along_a * s - along_b * t).length()
}

/// The narrow bundle of rays that stands for a beam, unit vectors [enu]: a direction (azimuth,
/// elevation) and three `half_angle_rad` to the sides of and below it.
pub fn bundle(az_el_rad: DVec2, half_angle_rad: f64) -> [DVec3; 4] {
    let h = half_angle_rad;
    [(0.0, 0.0), (h, 0.0), (-h, 0.0), (0.0, -h)]
        .map(|(x, y)| az_el_to_los(az_el_rad + DVec2::new(x, y)))
}

/// Least angle [rad] between a unit direction and the points of a segment as they are seen from a place, all in
/// `enu` [m]: on the unit sphere the segment is an arc of a great circle.
pub fn arc_distance_rad(from_enu_m: DVec3, direction_enu: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let [a, b] = [a, b].map(|end_enu_m| (end_enu_m - from_enu_m).normalize_or_zero());
    let pole = a.cross(b);
    // The nearest point of the circle is on the arc where the direction lies past one end and before the other.
    let beside = pole.cross(a).dot(direction_enu) >= 0.0 && b.cross(pole).dot(direction_enu) >= 0.0;
    match pole.try_normalize() {
        Some(pole) if beside => pole.dot(direction_enu).abs().asin(),
        _ => {
            let ends = [a, b].map(|end| end.angle_between(direction_enu));
            ends[0].min(ends[1])
        }
    }
}

/// Whether a unit direction lies within `exclusion_rad` of a sun that has risen; both in `enu`.
pub fn faces_sun(direction_enu: DVec3, sun_dir_enu: DVec3, exclusion_rad: f64) -> bool {
    sun_dir_enu.z > 0.0 && direction_enu.angle_between(sun_dir_enu) < exclusion_rad
}

/// Half angle [rad] of a beam of radius `beam_radius_m` [m] where an object stands that may be as near
/// as `nearest_m`, the beam being aimed at `range_m` [m]: in front of the target it is as wide as at
/// its exit and fills a larger angle, beyond the target it is taken to be no wider.
pub fn beam_half_angle_rad(beam_radius_m: f64, range_m: f64, nearest_m: f64) -> f64 {
    beam_radius_m / nearest_m.min(range_m)
}

/// Whether an object of angular size `size_rad`, known by its track's line of sight, may stand in a
/// beam of half angle `beam_rad` along the target's: closer than three times the beam and both
/// tracks' standard deviation, beyond its own half size.
pub fn in_beam(target: &LosState, other: &LosState, size_rad: f64, beam_rad: f64) -> bool {
    let sigma_rad = target
        .sigma_rad()
        .max_element()
        .hypot(other.sigma_rad().max_element());
    let margin_rad = 3.0 * (beam_rad + sigma_rad) + 0.5 * size_rad;
    separation_rad(target.az_el_rad(), other.az_el_rad()) < margin_rad
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::dsm::{Dsm, HeightGrid};
    use crate::maths::kinematics::los_to_az_el;
    use crate::maths::rng::Stream;
    use crate::tracking::estimation::{LosFilter, LosFilterParams};

    #[test]
    fn a_zone_may_pass_through_north() {
        let zone = Zone::Sector {
            azimuth_rad: [6.0, 0.5],
            elevation_rad: [0.0, 1.0],
        };
        let contains = |az, el| zone.meets(DVec3::ZERO, DVec2::new(az, el), 1.0);
        assert!(contains(-0.1, 0.5) && contains(0.3, 0.5));
        assert!(!contains(1.0, 0.5) && !contains(0.3, -0.1));
    }

    #[test]
    fn segment_distances_have_their_closed_forms() {
        let v = DVec3::new;
        let x = [v(-1.0, 0.0, 0.0), v(1.0, 0.0, 0.0)];
        for (b, expected) in [
            // Skew lines, crossing lines.
            ([v(0.3, -1.0, 2.0), v(0.3, 1.0, 2.0)], 2.0),
            ([v(0.3, -1.0, 0.0), v(0.3, 1.0, 0.0)], 0.0),
            // Parallel, side by side and one beyond the other.
            ([v(0.0, 3.0, 0.0), v(5.0, 3.0, 0.0)], 3.0),
            ([v(4.0, 4.0, 0.0), v(9.0, 4.0, 0.0)], 5.0),
            // Nearest at ends: of one, of both.
            ([v(0.5, 1.0, 0.0), v(0.5, 7.0, 0.0)], 1.0),
            ([v(4.0, 4.0, 0.0), v(9.0, 5.0, 0.0)], 5.0),
            // A point.
            ([v(4.0, 4.0, 0.0); 2], 5.0),
        ] {
            for (a, b) in [(x, b), (b, x), ([x[1], x[0]], b)] {
                let found = segment_distance_m(a, b);
                assert!((found - expected).abs() < 1e-12, "{a:?} {b:?}: {found}");
            }
        }
    }

    #[test]
    fn no_pair_of_points_is_nearer_than_the_distance() {
        let mut rng = Stream::new(1, 0, "test");
        for _ in 0..200 {
            let mut point = || DVec3::from_array([(); 3].map(|()| rng.range(-1.0, 1.0)));
            let (a, b) = ([point(), point()], [point(), point()]);
            let found = segment_distance_m(a, b);
            let least = (0..=100)
                .flat_map(|i| (0..=100).map(move |j| (i, j)))
                .map(|(i, j)| {
                    let a = a[0].lerp(a[1], f64::from(i) / 100.0);
                    a.distance(b[0].lerp(b[1], f64::from(j) / 100.0))
                })
                .fold(f64::INFINITY, f64::min);
            // Half a step of each segment is at most 0.018 long.
            assert!(
                (-1e-12..0.036).contains(&(least - found)),
                "{least} {found}"
            );
        }
    }

    #[test]
    fn a_beam_may_pass_below_an_air_route() {
        let route = Zone::Route {
            from_enu_m: DVec3::new(-5_000.0, 3_000.0, 600.0),
            to_enu_m: DVec3::new(5_000.0, 3_000.0, 600.0),
            radius_m: 150.0,
        };
        let station = DVec3::new(0.0, 0.0, 50.0);
        let meets = |up_m: f64, far_m: f64| {
            let direction = DVec3::new(0.0, 3_000.0, up_m - 50.0);
            route.meets(station, los_to_az_el(direction), far_m)
        };
        // The beam climbs at 10.4 degrees: the axis passes cos(10.4°) of the vertical offset away.
        assert!(meets(600.0, 20_000.0) && meets(460.0, 20_000.0));
        assert!(!meets(440.0, 20_000.0) && !meets(600.0, 2_000.0));
        // Behind the station there is no beam.
        assert!(!route.meets(station, DVec2::new(std::f64::consts::PI, 0.18), 20_000.0));
    }

    #[test]
    fn a_beam_fills_a_larger_angle_nearby() {
        let half_angle_rad = |nearest_m| beam_half_angle_rad(0.05, 1_000.0, nearest_m);
        assert_eq!(
            [200.0, 1_000.0, 3_000.0].map(half_angle_rad),
            [2.5e-4, 5e-5, 5e-5]
        );
    }

    #[test]
    fn a_wall_is_met_by_the_bundle_before_its_axis() {
        let flat = |height: fn(f64, f64) -> f64| {
            HeightGrid::from_fn(DVec2::new(-50.0, 0.0), 1.0, [100, 1_000], height)
        };
        // A wall 300 m to the north whose edge stands 1 m east of the axis.
        let wall = |e: f64, n: f64| {
            if e > 1.0 && n > 300.0 { 100.0 } else { 0.0 }
        };
        let dsm = Dsm::new(flat(|_, _| 0.0), flat(wall), 0.0);
        let r = DVec3::new(0.0, 0.0, 50.0);
        let hit = |half_angle| {
            let rays = bundle(DVec2::ZERO, half_angle).into_iter();
            let hits = rays.filter_map(|ray| dsm.first_hit(r, ray, 600.0));
            hits.min_by(f64::total_cmp)
        };
        assert_eq!(hit(1e-3), None);
        let range = hit(5e-3).unwrap();
        assert!((300.0..302.0).contains(&range), "{range}");
    }

    #[test]
    fn the_angle_to_a_beam_is_that_to_its_nearest_point() {
        let mut stream = crate::maths::rng::Stream::new(3, 0, "arcs");
        let mut point = || DVec3::from_array([0; 3].map(|_| 200.0 * stream.uniform() - 100.0));
        for _ in 0..300 {
            let (from_m, ends_m, to_m) = (point(), [point(), point()], point());
            let direction = (to_m - from_m).normalize();
            let sampled = (0..=20_000).map(|k| {
                let at_m = ends_m[0].lerp(ends_m[1], f64::from(k) / 20_000.0);
                (at_m - from_m).angle_between(direction)
            });
            let least_rad = sampled.fold(f64::INFINITY, f64::min);
            let found_rad = arc_distance_rad(from_m, direction, ends_m);
            assert!(
                (found_rad - least_rad).abs() < 2e-3,
                "{found_rad} {least_rad}"
            );
        }
    }

    #[test]
    fn only_a_risen_sun_dazzles() {
        let sun = az_el_to_los(DVec2::new(2.0, 0.3));
        let at = |el: f64| az_el_to_los(DVec2::new(2.0, el));
        assert!(faces_sun(at(0.3), sun, 0.08) && faces_sun(at(0.23), sun, 0.08));
        assert!(!faces_sun(at(0.21), sun, 0.08));
        let set = az_el_to_los(DVec2::new(2.0, -0.02));
        assert!(!faces_sun(at(0.0), set, 0.08));
    }

    #[test]
    fn a_track_beside_the_beam_counts_with_its_doubt() {
        let los = |az: f64, coast_s: f64| {
            let sigma = 3e-5;
            LosFilter::start(LosFilterParams::default(), DVec2::new(az, 0.1), sigma, 0.0)
                .unwrap()
                .predicted(coast_s)
        };
        let target = los(0.0, 0.0);
        // 3 (5e-5 + 4.2e-5) + 1.75e-4 = 4.5e-4, on the sky.
        let near = |other| in_beam(&target, &other, 3.5e-4, 5e-5);
        assert!(near(los(4.3e-4, 0.0)));
        assert!(!near(los(4.8e-4, 0.0)));
        // A rate known to 0.02 rad/s is 4 mrad of doubt after 0.2 s.
        assert!(near(los(8e-3, 0.2)) && !near(los(1.4e-2, 0.2)));
    }
}
