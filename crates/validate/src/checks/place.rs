//! Where things are: geodesy, the sun, georeferenced models, tiles.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use boresight_models::air::sun::Sun;
use boresight_models::ground::georeference::{ControlPoint, Mode, Placement, fit};
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::tiles::selection::screen_space_error_px;
use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_PI_3, FRAC_PI_6};

pub fn checks() -> Vec<Check> {
    [geodesy(), sun(), real_cities()].concat()
}

const EPSG_9602: &str = "EPSG Guidance Note 7-2, method 9602, example";
const EPSG_9836: &str = "EPSG Guidance Note 7-2, method 9836, example";
/// Where EPSG's example point lies, earth-centred [m].
const EPSG_ECEF_M: DVec3 = DVec3::new(3_771_793.968, 140_253.342, 5_124_304.349);

/// EPSG's example point, its latitude times a factor.
fn epsg_point(latitude_rad: f64) -> Geodetic {
    Geodetic {
        latitude_rad,
        longitude_rad: (2.0f64 + 7.0 / 60.0 + 46.380 / 3600.0).to_radians(),
        height_m: 73.0,
    }
}

fn epsg_latitude_rad() -> f64 {
    (53.0f64 + 48.0 / 60.0 + 33.820 / 3600.0).to_radians()
}

/// EPSG's example point in the frame of its example site, whose latitude is times a factor [m].
fn epsg_enu_m(factor: f64) -> DVec3 {
    let origin = Geodetic::from_ecef(DVec3::new(3652755.3058, 319574.6799, 5201547.3536));
    let site = SiteFrame::new(Geodetic {
        latitude_rad: factor * origin.latitude_rad,
        ..origin
    });
    site.ecef_to_enu(EPSG_ECEF_M)
}

fn geodesy() -> Vec<Check> {
    let within = Tolerance::Absolute(6e-4);
    let mutation = a_fifth_more("latitude of the point");
    let of_site = a_fifth_more("latitude of the site");
    vec![
        Check {
            model: "geodesy",
            name: "latitude, longitude and height to ECEF: X",
            reference: EPSG_9602,
            value: EPSG_ECEF_M.x,
            unit: "m",
            tolerance: within,
            mutation,
            run: |scale| Ok(epsg_point(scale.of(epsg_latitude_rad())).to_ecef().x),
        },
        Check {
            model: "geodesy",
            name: "latitude, longitude and height to ECEF: Z",
            reference: EPSG_9602,
            value: EPSG_ECEF_M.z,
            unit: "m",
            tolerance: within,
            mutation,
            run: |scale| Ok(epsg_point(scale.of(epsg_latitude_rad())).to_ecef().z),
        },
        Check {
            model: "geodesy",
            name: "ECEF to a site's frame: north",
            reference: EPSG_9836,
            value: -128_642.040,
            unit: "m",
            tolerance: Tolerance::Absolute(2e-3),
            mutation: of_site,
            run: |scale| Ok(epsg_enu_m(scale.of(1.0)).y),
        },
        Check {
            model: "geodesy",
            name: "ECEF to a site's frame: up",
            reference: EPSG_9836,
            value: -4_220.171,
            unit: "m",
            tolerance: Tolerance::Absolute(2e-3),
            mutation: of_site,
            run: |scale| Ok(epsg_enu_m(scale.of(1.0)).z),
        },
    ]
}

/// The sun of NREL's example, the site's latitude times a factor.
fn nrel_sun(factor: f64) -> Result<Sun, Fault> {
    let utc = "2003-10-17T19:30:30Z".parse().map_err(Fault::of)?;
    let golden = Geodetic {
        latitude_rad: factor * 39.742476_f64.to_radians(),
        longitude_rad: (-105.1786_f64).to_radians(),
        height_m: 1830.14,
    };
    Sun::new(&utc, golden, 82_000.0, 284.15).map_err(Fault::of)
}

fn sun() -> Vec<Check> {
    const NREL: &str = "Reda & Andreas, NREL/TP-560-34302, example of Golden, 2003-10-17";
    vec![
        Check {
            model: "sun",
            name: "zenith angle",
            reference: NREL,
            value: 50.11162,
            unit: "deg",
            tolerance: Tolerance::Absolute(1e-4),
            mutation: a_fifth_more("latitude of the site"),
            run: |scale| Ok(90.0 - nrel_sun(scale.of(1.0))?.elevation_rad.to_degrees()),
        },
        Check {
            model: "sun",
            name: "azimuth",
            reference: NREL,
            value: 194.34024,
            unit: "deg",
            tolerance: Tolerance::Absolute(1e-4),
            mutation: a_fifth_more("latitude of the site"),
            run: |scale| Ok(nrel_sun(scale.of(1.0))?.azimuth_rad.to_degrees()),
        },
    ]
}

/// Metres in a unit of a model that is fitted to eight control points of a placement with so many.
fn fitted_scale(scale: f64) -> Result<f64, Fault> {
    const LOCAL: [[f64; 3]; 8] = [
        [-330.0, -180.0, 1.2],
        [-120.0, 210.0, 24.0],
        [350.0, 160.0, 3.4],
        [290.0, -230.0, 41.0],
        [20.0, -15.0, 2.0],
        [-280.0, 140.0, 12.5],
        [140.0, 60.0, 33.0],
        [60.0, -200.0, 1.0],
    ];
    let home = SiteFrame::new(epsg_point(epsg_latitude_rad()));
    let truth = Placement {
        center_local: DVec3::new(120.0, -40.0, 8.0),
        r_ecef_m: home.enu_to_ecef(DVec3::new(30.0, 20.0, 5.0)),
        q_ecef_local: home.q_ecef_enu() * DQuat::from_euler(glam::EulerRot::ZYX, 2.1, 0.02, -0.01),
        scale,
    };
    let points: Vec<ControlPoint> = (1..)
        .zip(LOCAL)
        .map(|(k, r): (usize, _)| ControlPoint {
            name: k.to_string(),
            r_local: DVec3::from(r),
            r_ecef_m: truth.to_ecef(DVec3::from(r)),
            sigma_m: [0.01; 2],
        })
        .collect();
    let found = fit(&points, Mode::Seven).map_err(Fault::of)?;
    Ok(found.placement.scale)
}

fn real_cities() -> Vec<Check> {
    const FORMULA: &str = "cesium-native, selection algorithm: error H/(2 d tan(fovy/2)), by hand";
    vec![
        Check {
            model: "real-cities",
            name: "scale of a model from eight control points without error",
            reference: "the placement that the points are from",
            value: 1.000_12,
            unit: "",
            tolerance: Tolerance::Relative(1e-11),
            mutation: a_fifth_more("scale of the placement"),
            run: |scale| fitted_scale(scale.of(1.000_12)),
        },
        Check {
            model: "real-cities",
            name: "error on the screen of 16 m at 1 km, 1080 px, 60°",
            reference: FORMULA,
            value: 14.9649,
            unit: "px",
            tolerance: Tolerance::Absolute(5e-5),
            mutation: a_fifth_more("field of view"),
            run: |scale| {
                let fovy_rad = scale.of(FRAC_PI_3);
                Ok(screen_space_error_px(16.0, 1000.0, 1080.0, fovy_rad))
            },
        },
        Check {
            model: "real-cities",
            name: "error on the screen of 1 m at 100 m, 480 px, 30°",
            reference: FORMULA,
            value: 8.95692,
            unit: "px",
            tolerance: Tolerance::Absolute(5e-6),
            mutation: times("distance", 1.2),
            run: |scale| {
                let distance_m = scale.of(100.0);
                Ok(screen_space_error_px(1.0, distance_m, 480.0, FRAC_PI_6))
            },
        },
    ]
}
