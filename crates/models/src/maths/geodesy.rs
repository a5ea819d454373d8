//! WGS-84 geodetic, Earth-centred Earth-fixed (ECEF) and site-local east-north-up (ENU)
//! coordinates. The ellipsoidal conversions are those of the `geodesy` crate (Bowring 1976, 1985).

use geodesy::prelude::{Coor3D, CoordinateTuple, Ellipsoid, GeoCart};
use glam::{DMat3, DQuat, DVec3};

/// The WGS-84 ellipsoid: semi-major axis [m] and flattening (NGA.STND.0036).
fn wgs84() -> Ellipsoid {
    Ellipsoid::new(6_378_137.0, 1.0 / 298.257_223_563)
}

/// A point in WGS-84 geodetic coordinates (EPSG:4979, in radians).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// Geodetic latitude, positive north [rad].
    pub latitude_rad: f64,
    /// Longitude, positive east [rad].
    pub longitude_rad: f64,
    /// Height above the ellipsoid (not above sea level) [m].
    pub height_m: f64,
}

impl Geodetic {
    /// The point in ECEF coordinates [m] (EPSG method 9602).
    pub fn to_ecef(self) -> DVec3 {
        let point = Coor3D::raw(self.longitude_rad, self.latitude_rad, self.height_m);
        let (x, y, z) = wgs84().cartesian(&point).xyz();
        DVec3::new(x, y, z)
    }

    /// The point whose ECEF coordinates are `r_ecef_m` [m] (EPSG method 9602, reversed).
    pub fn from_ecef(r_ecef_m: DVec3) -> Self {
        let point = Coor3D::raw(r_ecef_m.x, r_ecef_m.y, r_ecef_m.z);
        let (longitude_rad, latitude_rad, height_m) = wgs84().geographic(&point).xyz();
        Self {
            latitude_rad,
            longitude_rad,
            height_m,
        }
    }
}

/// The same meridian, at most half a turn from `near_deg` [deg].
pub fn longitude_near_deg(longitude_deg: f64, near_deg: f64) -> f64 {
    longitude_deg + 360.0 * ((near_deg - longitude_deg) / 360.0).round()
}

/// West and east end of the arc that holds all longitudes [deg]: as they are written where they span half a turn or less, otherwise
/// the shortest arc, which may cross ±180° (its east end is then above 180°). `None` without longitudes, or where one is no number.
pub fn longitude_arc_deg(longitudes_deg: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    let mut all: Vec<f64> = longitudes_deg.into_iter().collect();
    if !all.iter().all(|x| x.is_finite()) {
        return None;
    }
    all.sort_by(f64::total_cmp);
    let [west, east] = [*all.first()?, *all.last()?];
    if east - west <= 180.0 {
        return Some([west, east]);
    }
    for x in &mut all {
        *x = x.rem_euclid(360.0);
    }
    all.sort_by(f64::total_cmp);
    // The arc begins behind the widest gap.
    let around = all.last()? - 360.0;
    let before = std::iter::once(&around).chain(&all);
    let gaps = before.zip(&all).map(|(before, x)| x - before).enumerate();
    let (widest, gap) = gaps.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let west = longitude_near_deg(all[widest], 0.0);
    Some([west, west + 360.0 - gap])
}

/// The ENU frame tangent to the ellipsoid's normal at a site (EPSG method 9836).
#[derive(Clone, Copy, Debug)]
pub struct SiteFrame {
    origin: Geodetic,
    r_origin_ecef_m: DVec3,
    /// Rotates an ENU vector into ECEF: its columns are east, north and up.
    m_ecef_enu: DMat3,
}

impl SiteFrame {
    /// The frame whose origin is `origin`.
    pub fn new(origin: Geodetic) -> Self {
        let (sin_lat, cos_lat) = origin.latitude_rad.sin_cos();
        let (sin_lon, cos_lon) = origin.longitude_rad.sin_cos();
        Self {
            origin,
            r_origin_ecef_m: origin.to_ecef(),
            m_ecef_enu: DMat3::from_cols(
                DVec3::new(-sin_lon, cos_lon, 0.0),
                DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
                DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat),
            ),
        }
    }

    /// The geodetic point at the frame's origin.
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// The ECEF position [m] of an ENU position [m].
    pub fn enu_to_ecef(&self, r_enu_m: DVec3) -> DVec3 {
        self.r_origin_ecef_m + self.m_ecef_enu * r_enu_m
    }

    /// The ENU position [m] of an ECEF position [m].
    pub fn ecef_to_enu(&self, r_ecef_m: DVec3) -> DVec3 {
        self.m_ecef_enu.transpose() * (r_ecef_m - self.r_origin_ecef_m)
    }

    /// The geodetic coordinates of an ENU position [m].
    pub fn enu_to_geodetic(&self, r_enu_m: DVec3) -> Geodetic {
        Geodetic::from_ecef(self.enu_to_ecef(r_enu_m))
    }

    /// The rotation that takes an ENU vector into ECEF.
    pub fn q_ecef_enu(&self) -> DQuat {
        DQuat::from_mat3(&self.m_ecef_enu)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Degrees, minutes and seconds in radians.
    fn dms(degrees: f64, minutes: f64, seconds: f64) -> f64 {
        (degrees + minutes / 60.0 + seconds / 3600.0).to_radians()
    }

    fn epsg_point() -> Geodetic {
        Geodetic {
            latitude_rad: dms(53.0, 48.0, 33.820),
            longitude_rad: dms(2.0, 7.0, 46.380),
            height_m: 73.0,
        }
    }

    #[test]
    fn epsg_9602_check_value() {
        let published = DVec3::new(3_771_793.968, 140_253.342, 5_124_304.349);
        // The published values are rounded to the millimetre.
        assert!((epsg_point().to_ecef() - published).abs().max_element() < 6e-4);
        let back = Geodetic::from_ecef(published);
        assert!((back.latitude_rad - epsg_point().latitude_rad).abs() < 1e-10);
        assert!((back.longitude_rad - epsg_point().longitude_rad).abs() < 2e-10);
        assert!((back.height_m - 73.0).abs() < 1e-3);
    }

    #[test]
    fn epsg_9836_check_value() {
        let origin = DVec3::new(3652755.3058, 319574.6799, 5201547.3536);
        let site = SiteFrame::new(Geodetic::from_ecef(origin));
        let enu = site.ecef_to_enu(DVec3::new(3_771_793.968, 140_253.342, 5_124_304.349));
        let published = DVec3::new(-189_013.869, -128_642.040, -4_220.171);
        assert!(
            (enu - published).abs().max_element() < 2e-3,
            "{enu} against {published}"
        );
    }

    #[test]
    fn round_trips_at_50_km() {
        for (lat, lon) in [(0.0, 0.0), (47.4, 8.5), (-33.9, 151.2), (78.2, -15.6)] {
            let site = SiteFrame::new(Geodetic {
                latitude_rad: f64::to_radians(lat),
                longitude_rad: f64::to_radians(lon),
                height_m: 400.0,
            });
            for azimuth_deg in (0..360).step_by(15) {
                let (sin, cos) = f64::from(azimuth_deg).to_radians().sin_cos();
                let enu = DVec3::new(50e3 * sin, 50e3 * cos, 1500.0);
                let ecef = site.enu_to_ecef(enu);
                // Half a unit in the last place of an ECEF coordinate is 4.7e-10 m.
                assert!((site.ecef_to_enu(ecef) - enu).abs().max_element() < 1e-9);
                // Through the angles: Bowring's single step is good to 4e-8 m near the ground.
                let again = site.ecef_to_enu(site.enu_to_geodetic(enu).to_ecef());
                let error_m = (again - enu).abs().max_element();
                assert!(error_m < 1e-7, "{error_m} m");
                let turned = site.q_ecef_enu() * enu + site.origin().to_ecef();
                assert!((turned - ecef).abs().max_element() < 3e-9);
            }
        }
    }

    #[test]
    fn an_arc_of_longitudes_crosses_the_antimeridian() {
        let arc = |all: &[f64]| longitude_arc_deg(all.iter().copied());
        assert_eq!(arc(&[8.0, 7.5, 9.0]), Some([7.5, 9.0]));
        assert_eq!(arc(&[359.0, 358.0]), Some([358.0, 359.0]));
        assert_eq!(arc(&[179.5, -179.0, 178.0]), Some([178.0, 181.0]));
        assert_eq!(arc(&[359.5, 0.25]), Some([-0.5, 0.25]));
        assert_eq!(arc(&[-170.0, -180.0, 180.0]), Some([-180.0, -170.0]));
        assert_eq!(arc(&[5.0]), Some([5.0, 5.0]));
        assert_eq!((arc(&[]), arc(&[f64::NAN])), (None, None));
        assert_eq!(longitude_near_deg(-179.0, 178.0), 181.0);
        assert_eq!(longitude_near_deg(359.0, 8.0), -1.0);
    }

    #[test]
    fn axes_point_east_north_and_up() {
        let origin = Geodetic {
            latitude_rad: 0.8,
            longitude_rad: 0.2,
            height_m: 100.0,
        };
        let site = SiteFrame::new(origin);
        assert!(site.enu_to_geodetic(DVec3::X * 100.0).longitude_rad > origin.longitude_rad);
        assert!(site.enu_to_geodetic(DVec3::Y * 100.0).latitude_rad > origin.latitude_rad);
        assert!((site.enu_to_geodetic(DVec3::Z * 100.0).height_m - 200.0).abs() < 1e-8);
    }
}
