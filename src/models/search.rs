//! Search patterns: the gazes of a step-and-stare scan over a sector.

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

/// The gazes (azimuth, elevation) [rad] that cover `sector` with a field of view of
/// `fov_rad` (horizontal, vertical): rows from bottom to top, alternately swept right and left,
/// neighbours overlapping by at least `overlap` (0 to 1) of the field.
///
/// Gazes are spread evenly, so that the outermost fields end at the sector's border.
pub fn raster(sector: &Sector, fov_rad: [f64; 2], overlap: f64) -> Vec<[f64; 2]> {
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

    const SECTOR: Sector = Sector {
        centre_azimuth_rad: 1.0,
        centre_elevation_rad: 0.1,
        width_rad: 0.5,
        height_rad: 0.2,
    };

    #[test]
    fn every_direction_of_the_sector_is_seen() {
        let fov = [0.1, 0.08];
        let gazes = raster(&SECTOR, fov, 0.1);
        for i in 0..=50 {
            for j in 0..=20 {
                let azimuth = 0.75 + 0.5 * f64::from(i) / 50.0;
                let elevation = 0.2 * f64::from(j) / 20.0;
                let seen = gazes.iter().any(|[a, e]| {
                    ((azimuth - a) * e.cos()).abs() <= fov[0] / 2.0 + 1e-9
                        && (elevation - e).abs() <= fov[1] / 2.0 + 1e-9
                });
                assert!(seen, "{azimuth} {elevation}");
            }
        }
    }

    #[test]
    fn a_field_wider_than_the_sector_needs_one_gaze() {
        assert_eq!(raster(&SECTOR, [1.0, 1.0], 0.1), vec![[1.0, 0.1]]);
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
}
