//! Quantities as MAVLink has them: north-east-down and forward-right-down, whole numbers of small units.

use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DQuat, DVec3};
use std::f64::consts::FRAC_1_SQRT_2;

/// East-north-up as north-east-down.
pub(super) fn ned(enu: DVec3) -> DVec3 {
    DVec3::new(enu.y, enu.x, -enu.z)
}

/// Forward-left-up as forward-right-down.
pub(super) fn frd(flu: DVec3) -> DVec3 {
    DVec3::new(flu.x, -flu.y, -flu.z)
}

/// The attitude that takes forward-right-down to north-east-down, w first and not negative, of one that takes
/// forward-left-up to east-north-up.
pub(super) fn attitude(q_enu_flu: DQuat) -> [f32; 4] {
    // Both changes of axes are half turns, and their own inverses.
    let ned_enu = DQuat::from_xyzw(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0, 0.0);
    let flu_frd = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    wxyz(ned_enu * q_enu_flu * flu_frd)
}

/// Where a mount looks, as the attitude of its forward axis: azimuth clockwise from north and elevation up \[rad\], no roll.
pub(super) fn looking(azimuth_rad: f64, elevation_rad: f64) -> [f32; 4] {
    wxyz(DQuat::from_rotation_z(azimuth_rad) * DQuat::from_rotation_y(elevation_rad))
}

fn wxyz(q: DQuat) -> [f32; 4] {
    // q and -q are the same attitude; one of them is enough.
    let q = if q.w < 0.0 { -q } else { q };
    [q.w, q.x, q.y, q.z].map(|part| part as f32)
}

/// Where something is on the Earth, in the whole numbers of MAVLink.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Global {
    /// Latitude and longitude [1e-7 deg].
    pub lat: i32,
    pub lon: i32,
    /// Height above mean sea level [mm].
    pub alt: i32,
}

/// Mean sea level and the site's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Earth {
    site: SiteFrame,
    /// Height of the geoid (EGM96) over the ellipsoid at the site [m].
    geoid_m: f64,
}

impl Earth {
    /// About a site. The geoid is level for as far as a scenario reaches.
    pub(super) fn about(site: Geodetic) -> Self {
        let (lat, lon) = (site.latitude_rad, site.longitude_rad);
        let geoid_m = egm96::egm96_compute_altitude_offset(lat.to_degrees(), lon.to_degrees());
        Self {
            site: SiteFrame::new(site),
            geoid_m,
        }
    }

    /// The frame of the site.
    pub(super) fn site(&self) -> &SiteFrame {
        &self.site
    }

    /// Height of a place above mean sea level [m].
    pub(super) fn height_m(&self, r_enu_m: DVec3) -> f64 {
        self.site.enu_to_geodetic(r_enu_m).height_m - self.geoid_m
    }

    /// A place of the site on the Earth.
    pub(super) fn global(&self, r_enu_m: DVec3) -> Global {
        let at = self.site.enu_to_geodetic(r_enu_m);
        let e7 = |rad: f64| (1e7 * rad.to_degrees()).round() as i32;
        Global {
            lat: e7(at.latitude_rad),
            lon: e7(at.longitude_rad),
            alt: milli(at.height_m - self.geoid_m),
        }
    }
}

/// In thousandths.
pub(super) fn milli(x: f64) -> i32 {
    (1e3 * x).round() as i32
}

/// In hundredths, as far as they go.
pub(super) fn centi(x: f64) -> i16 {
    (1e2 * x).round() as i16
}

/// A compass direction \[rad\] in hundredths of a degree, 0 to 35,999.
pub(super) fn compass(azimuth_rad: f64) -> u16 {
    (1e2 * azimuth_rad.to_degrees())
        .round()
        .rem_euclid(36_000.0) as u16
}

/// Where the nose points, clockwise from north [rad].
pub(super) fn heading_rad(q_enu_flu: DQuat) -> f64 {
    let nose = q_enu_flu * DVec3::X;
    nose.x.atan2(nose.y)
}

/// Simulated time in whole milliseconds.
pub(super) fn boot_ms(t_s: f64) -> u32 {
    (1e3 * t_s).round() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use std::f64::consts::FRAC_PI_2;

    /// The rotation of a quaternion with w first.
    fn turned(q: [f32; 4], v: DVec3) -> DVec3 {
        let [w, x, y, z] = q.map(f64::from);
        DQuat::from_xyzw(x, y, z, w) * v
    }

    #[test]
    fn axes_change_as_vectors_do() {
        assert_eq!(ned(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(2.0, 1.0, -3.0));
        assert_eq!(frd(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(1.0, -2.0, -3.0));
        // A vector turned here is the vector turned there, whatever the attitude.
        let q = DQuat::from_euler(glam::EulerRot::ZYX, 2.1, -0.4, 0.7);
        let v = DVec3::new(0.3, -1.2, 0.8);
        let there = turned(attitude(q), frd(v));
        assert!(there.distance(ned(q * v)) < 1e-6, "{there}");
    }

    #[test]
    fn level_and_north_is_no_rotation_and_east_a_quarter_turn() {
        let north = DQuat::from_mat3(&DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z));
        let q = attitude(north);
        assert!((q[0] - 1.0).abs() < 1e-6, "{q:?}");
        assert!((heading_rad(DQuat::IDENTITY) - FRAC_PI_2).abs() < 1e-12);
        assert_eq!(compass(heading_rad(DQuat::IDENTITY)), 9_000);
        assert_eq!(compass(-1e-9), 0);
        // The nose of a body that faces east and is level looks east.
        let east = turned(attitude(DQuat::IDENTITY), DVec3::X);
        assert!(east.distance(DVec3::Y) < 1e-6, "{east}");
    }

    #[test]
    fn a_mount_looks_along_its_azimuth_and_elevation() {
        let (azimuth, elevation) = (1.2_f64, 0.4_f64);
        let ahead = turned(looking(azimuth, elevation), DVec3::X);
        let wanted = DVec3::new(
            elevation.cos() * azimuth.cos(),
            elevation.cos() * azimuth.sin(),
            -elevation.sin(),
        );
        assert!(ahead.distance(wanted) < 1e-6, "{ahead}");
    }

    #[test]
    fn places_are_on_the_earth_above_the_sea() {
        let site = Geodetic {
            latitude_rad: 47.3769_f64.to_radians(),
            longitude_rad: 8.5417_f64.to_radians(),
            height_m: 455.0,
        };
        let earth = Earth::about(site);
        let origin = earth.global(DVec3::ZERO);
        assert_eq!((origin.lat, origin.lon), (473_769_000, 85_417_000));
        // EGM96 lies some 47 m above the ellipsoid at Zürich.
        let geoid_m = 455.0 - 1e-3 * f64::from(origin.alt);
        assert!((46.0..49.0).contains(&geoid_m), "{geoid_m}");
        // One minute of arc of the meridian there is 1,853 m within 1 m.
        let north = earth.global(DVec3::new(0.0, 1_853.0, 0.0));
        let minutes = 60e-7 * f64::from(north.lat - origin.lat);
        assert!((minutes - 1.0).abs() < 1e-3, "{minutes}");
        assert_eq!(
            earth.global(DVec3::new(0.0, 0.0, 100.0)).alt - origin.alt,
            100_000
        );
    }
}
