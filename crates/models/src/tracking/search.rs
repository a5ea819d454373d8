//! Search patterns: the gazes of a step-and-stare scan over a sector, and how long they take.

use crate::maths::kinematics::wrap_pi;
use crate::mount::gimbal::AxisParams;
use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the search sector is covered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SearchPattern {
    /// To and fro across the sector, from bottom to top.
    #[default]
    Raster,
    /// A square spiral from the middle outward: what a cue makes likely comes first.
    Spiral,
    /// Stays on the middle, or on the cue.
    Stare,
}

impl SearchPattern {
    /// The pattern as scenarios and logs name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Raster => "raster",
            Self::Spiral => "spiral",
            Self::Stare => "stare",
        }
    }

    /// The gazes (azimuth, elevation) [rad] over `sector` with a field of view of `fov_rad`
    /// (horizontal, vertical), neighbours overlapping by at least `overlap` (0 to 1) of the field;
    /// at least one.
    pub fn gazes(self, sector: &Sector, fov_rad: [f64; 2], overlap: f64) -> Vec<[f64; 2]> {
        match self {
            Self::Raster => raster(sector, fov_rad, overlap),
            Self::Spiral => spiral(sector, fov_rad, overlap),
            Self::Stare => vec![[sector.centre_azimuth_rad, sector.centre_elevation_rad]],
        }
    }
}

/// Where the mount is to look, and how that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaze {
    /// Azimuth (x) and elevation (y) [rad].
    pub az_el_rad: DVec2,
    /// Their rates [rad/s].
    pub rates_radps: DVec2,
}

impl Gaze {
    /// A gaze that rests at an azimuth (x) and elevation (y) [rad].
    pub fn still(az_el_rad: DVec2) -> Self {
        Self {
            az_el_rad,
            rates_radps: DVec2::ZERO,
        }
    }
}

/// A sector of the sky to be searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sector {
    /// Azimuth of its centre, clockwise from north [rad].
    pub centre_azimuth_rad: f64,
    /// Elevation of its centre [rad].
    pub centre_elevation_rad: f64,
    /// Extent in azimuth [rad].
    pub width_rad: f64,
    /// Extent in elevation [rad].
    pub height_rad: f64,
}

impl Sector {
    /// The sector of two standard deviations to either side of a direction (azimuth, elevation);
    /// `sigma_rad` is on the sky, cross-elevation and elevation. It holds a target of Gaussian
    /// direction nine times in ten (0.9545²).
    pub fn about(az_el_rad: DVec2, sigma_rad: DVec2) -> Self {
        Self {
            centre_azimuth_rad: az_el_rad.x,
            centre_elevation_rad: az_el_rad.y,
            width_rad: 4.0 * sigma_rad.x / az_el_rad.y.cos().max(0.1),
            height_rad: 4.0 * sigma_rad.y,
        }
    }

    /// Whether a direction (azimuth, elevation) [rad] lies in it.
    pub fn contains(&self, az_el_rad: DVec2) -> bool {
        wrap_pi(az_el_rad.x - self.centre_azimuth_rad).abs() <= 0.5 * self.width_rad
            && (az_el_rad.y - self.centre_elevation_rad).abs() <= 0.5 * self.height_rad
    }
}

/// Rows from bottom to top, alternately swept right and left. Gazes are spread evenly, so that the
/// outermost fields end at the sector's border.
fn raster(sector: &Sector, fov_rad: [f64; 2], overlap: f64) -> Vec<[f64; 2]> {
    let elevations = spread(
        sector.centre_elevation_rad,
        sector.height_rad,
        fov_rad[1],
        overlap,
    );
    elevations
        .iter()
        .enumerate()
        .flat_map(|(row, &elevation)| {
            // Meridians converge: a field spans more azimuth the higher it looks.
            let span = fov_rad[0] / elevation.cos().max(0.1);
            let mut row_gazes: Vec<_> =
                spread(sector.centre_azimuth_rad, sector.width_rad, span, overlap)
                    .into_iter()
                    .map(|azimuth| [azimuth, elevation])
                    .collect();
            if row % 2 == 1 {
                row_gazes.reverse();
            }
            row_gazes
        })
        .collect()
}

/// A grid walked in square rings about its middle, each ring a turn of the spiral; what of a ring
/// lies outside the sector is skipped.
fn spiral(sector: &Sector, fov_rad: [f64; 2], overlap: f64) -> Vec<[f64; 2]> {
    let elevations = spread(
        sector.centre_elevation_rad,
        sector.height_rad,
        fov_rad[1],
        overlap,
    );
    // One spacing for all rows: that of the row where a field spans least azimuth.
    let widest = elevations.iter().map(|e| e.cos()).fold(0.1, f64::max);
    let span = fov_rad[0] / widest;
    let azimuths = spread(sector.centre_azimuth_rad, sector.width_rad, span, overlap);
    let middle = [azimuths.len(), elevations.len()].map(|n| ((n - 1) / 2) as isize);
    let reach = azimuths.len().max(elevations.len()) as isize;
    let mut gazes = Vec::with_capacity(azimuths.len() * elevations.len());
    let mut visit = |x: isize, y: isize| {
        let at =
            |list: &[f64], i: isize| usize::try_from(i).ok().and_then(|i| list.get(i).copied());
        if let (Some(azimuth), Some(elevation)) =
            (at(&azimuths, middle[0] + x), at(&elevations, middle[1] + y))
        {
            gazes.push([azimuth, elevation]);
        }
    };
    visit(0, 0);
    for ring in 1..=reach {
        // Up the right side, left along the top, down the left side, right along the bottom.
        (1 - ring..=ring).for_each(|y| visit(ring, y));
        (1 - ring..=ring).for_each(|x| visit(-x, ring));
        (1 - ring..=ring).for_each(|y| visit(-ring, -y));
        (1 - ring..=ring).for_each(|x| visit(x, -ring));
    }
    gazes
}

/// What settling adds to a slew of the mount at its limits [s], as the servo of
/// [`crate::mount::gimbal`] is measured to need (test below).
pub const SETTLE_S: f64 = 0.09;

/// What the mount needs to step from gaze to gaze.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlewLimits {
    /// Largest rate of an axis [rad/s].
    pub rate_radps: f64,
    /// Its acceleration, and deceleration, in a slew [rad/s²].
    pub acceleration_radps2: f64,
    /// What settling adds to a slew at these limits [s].
    pub settle_s: f64,
}

impl SlewLimits {
    /// Those of an axis of the mount.
    pub fn of(axis: &AxisParams) -> Self {
        Self {
            rate_radps: axis.rate_limit_radps,
            acceleration_radps2: axis.torque_limit_nm / axis.inertia_kg_m2,
            settle_s: SETTLE_S,
        }
    }

    /// Time from rest to rest over `angle_rad` [s]: a trapezoid of rate, or a triangle if the limit
    /// is not reached, and settling.
    pub fn slew_s(&self, angle_rad: f64) -> f64 {
        let (angle, v, a) = (angle_rad.abs(), self.rate_radps, self.acceleration_radps2);
        let moving_s = if angle * a >= v * v {
            angle / v + v / a
        } else {
            2.0 * (angle / a).sqrt()
        };
        moving_s + self.settle_s
    }
}

/// Time from rest at the first of `gazes` to the end of the last [s], each lasting `gaze_s` [s]; both
/// axes turn at once.
pub fn coverage_time_s(gazes: &[[f64; 2]], gaze_s: f64, slew: &SlewLimits) -> f64 {
    let slews_s: f64 = gazes
        .windows(2)
        .map(|pair| {
            let angle = wrap_pi(pair[1][0] - pair[0][0]).abs();
            slew.slew_s(angle.max((pair[1][1] - pair[0][1]).abs()))
        })
        .sum();
    gaze_s * gazes.len() as f64 + slews_s
}

fn spread(centre: f64, extent: f64, field: f64, overlap: f64) -> Vec<f64> {
    let travel = (extent - field).max(0.0);
    let steps = (travel / (field * (1.0 - overlap)) - 1e-9).ceil().max(0.0) as usize;
    (0..=steps)
        .map(|i| match steps {
            0 => centre,
            _ => centre - travel / 2.0 + travel * i as f64 / steps as f64,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mount::gimbal::{self, GimbalParams, GimbalState};

    const SECTOR: Sector = Sector {
        centre_azimuth_rad: 1.0,
        centre_elevation_rad: 0.1,
        width_rad: 0.5,
        height_rad: 0.2,
    };

    /// Whether a direction lies in the field of a gaze, both (azimuth, elevation) [rad].
    fn in_field(gaze: [f64; 2], fov_rad: [f64; 2], [azimuth, elevation]: [f64; 2]) -> bool {
        let off = wrap_pi(azimuth - gaze[0]) * gaze[1].cos();
        off.abs() <= 0.5 * fov_rad[0] + 1e-9
            && (elevation - gaze[1]).abs() <= 0.5 * fov_rad[1] + 1e-9
    }

    #[test]
    fn every_direction_of_the_sector_is_seen() {
        let fov = [0.1, 0.08];
        for pattern in [SearchPattern::Raster, SearchPattern::Spiral] {
            for centre_elevation_rad in [0.1, 0.9] {
                let sector = Sector {
                    centre_elevation_rad,
                    ..SECTOR
                };
                let gazes = pattern.gazes(&sector, fov, 0.1);
                for i in 0..=50 {
                    for j in 0..=20 {
                        let azimuth = 0.75 + 0.5 * f64::from(i) / 50.0;
                        let elevation = centre_elevation_rad - 0.1 + 0.2 * f64::from(j) / 20.0;
                        let seen = gazes
                            .iter()
                            .any(|gaze| in_field(*gaze, fov, [azimuth, elevation]));
                        assert!(seen, "{pattern:?} {azimuth} {elevation}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_field_wider_than_the_sector_needs_one_gaze() {
        for pattern in [
            SearchPattern::Raster,
            SearchPattern::Spiral,
            SearchPattern::Stare,
        ] {
            assert_eq!(pattern.gazes(&SECTOR, [1.0, 1.0], 0.1), vec![[1.0, 0.1]]);
        }
    }

    #[test]
    fn rows_alternate() {
        let gazes = raster(&SECTOR, [0.2, 0.12], 0.0);
        let jump = gazes
            .windows(2)
            .map(|w| (w[1][0] - w[0][0]).abs())
            .fold(0.0, f64::max);
        assert!(jump < 0.25, "no gaze jumps across the sector: {jump}");
    }

    #[test]
    fn the_spiral_goes_outward_and_sees_each_field_once() {
        // 5 by 5 fields that just fill the sector: rings of 1, 8 and 16.
        let square = Sector {
            centre_elevation_rad: 0.0,
            height_rad: 0.5,
            ..SECTOR
        };
        let gazes = spiral(&square, [0.1, 0.1], 0.0);
        assert_eq!(gazes.len(), 25);
        let ring = |g: &[f64; 2]| (g[0] - 1.0).abs().max(g[1].abs());
        assert!(ring(&gazes[0]) < 1e-9);
        for pair in gazes.windows(2) {
            assert!(ring(&pair[1]) > ring(&pair[0]) - 1e-9, "{pair:?}");
            let step = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
            assert!((step - 0.1).abs() < 1e-9, "a spiral never jumps: {pair:?}");
        }
    }

    #[test]
    fn coverage_time_agrees_with_the_mount() {
        let gazes = SearchPattern::Raster.gazes(
            &Sector {
                width_rad: 0.6,
                height_rad: 0.15,
                ..SECTOR
            },
            [0.105, 0.079],
            0.1,
        );
        let params = GimbalParams::default();
        let (gaze_s, dt_s) = (0.5, 1.0 / 960.0);
        let mut gimbal = GimbalState::at_rest(gazes[0].into());
        let (mut index, mut since, mut t) = (0, None, 0.0);
        while index < gazes.len() && t < 60.0 {
            let gaze = DVec2::from(gazes[index]);
            let near = params.error_rad(gaze, gimbal.az_el_rad()).length() < 2e-3;
            if since.is_none() && near && gimbal.rates_radps().length() < 5e-3 {
                since = Some(t);
            }
            if since.is_some_and(|since| t - since >= gaze_s) {
                (index, since) = (index + 1, None);
                continue;
            }
            let command = params.position_command(&gimbal, gaze);
            gimbal::step(&mut gimbal, &params, &command, [0.0; 2], dt_s);
            t += dt_s;
        }
        let axis = params.azimuth;
        let limits = SlewLimits {
            rate_radps: axis.rate_limit_radps,
            acceleration_radps2: axis.torque_limit_nm / axis.inertia_kg_m2,
            settle_s: SETTLE_S,
        };
        let expected = coverage_time_s(&gazes, gaze_s, &limits);
        println!("{} gazes: {t:.2} s, {expected:.2} s expected", gazes.len());
        assert!((t / expected - 1.0).abs() < 0.1, "{t} {expected}");
    }
}
