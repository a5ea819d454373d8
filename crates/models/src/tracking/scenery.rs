//! Places in which a detector keeps reporting scenery: a map of directions that a fixed mount learns.
//!
//! The sky is divided into cells. A track that has stood still in one is entered there; a track that begins
//! in an entered cell, or beside it, is known to be scenery until it flies.

use glam::DVec2;
use std::collections::BTreeMap;

/// Side of a cell [rad]: a dozen pixels of the default search camera.
const CELL_RAD: f64 = 2e-3;
/// Cells kept; those not confirmed for longest go first.
const MOST_CELLS: usize = 2_048;
/// How long a cell is remembered after it was last confirmed [s]: a few passes of a search.
const KEPT_S: f64 = 90.0;

/// A map of scenery.
#[derive(Clone, Debug, Default)]
pub struct Scenery {
    /// When each cell was last confirmed [s].
    cells: BTreeMap<[i32; 2], f64>,
}

impl Scenery {
    fn cell(az_el_rad: DVec2) -> [i32; 2] {
        // Rows of equal height; columns as wide on the sky as the row is high.
        let row = (az_el_rad.y / CELL_RAD).floor();
        let across = az_el_rad.x * (row * CELL_RAD).cos().max(0.05);
        [(across / CELL_RAD).floor() as i32, row as i32]
    }

    /// Enters a direction (azimuth, elevation) in which something stands still at `t_s` [s].
    pub fn learn(&mut self, az_el_rad: DVec2, t_s: f64) {
        self.cells.insert(Self::cell(az_el_rad), t_s);
        if self.cells.len() > MOST_CELLS {
            let oldest = (self.cells.iter())
                .min_by(|a, b| a.1.total_cmp(b.1).then(a.0.cmp(b.0)))
                .map(|(cell, _)| *cell);
            oldest.map(|cell| self.cells.remove(&cell));
        }
    }

    /// Whether scenery has been seen there, or a cell beside it, by `t_s` [s].
    pub fn holds(&self, az_el_rad: DVec2, t_s: f64) -> bool {
        let [x, y] = Self::cell(az_el_rad);
        (x - 1..=x + 1).any(|x| {
            let column = self.cells.range([x, y - 1]..=[x, y + 1]);
            column.into_iter().any(|(_, seen_s)| t_s - seen_s < KEPT_S)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_still_is_known_again_for_a_while() {
        let mut map = Scenery::default();
        let at = DVec2::new(0.7012, 0.0513);
        map.learn(at, 10.0);
        assert!(map.holds(at, 11.0) && map.holds(at + DVec2::splat(1e-3), 11.0));
        assert!(!map.holds(at + DVec2::new(8e-3, 0.0), 11.0));
        assert!(!map.holds(at, 10.0 + KEPT_S + 1.0));
    }

    #[test]
    fn the_map_stays_bounded() {
        let mut map = Scenery::default();
        for i in 0..3 * MOST_CELLS {
            map.learn(
                DVec2::new(5e-3 * i as f64 % 3.0, 0.0003 * i as f64),
                i as f64,
            );
        }
        assert_eq!(map.cells.len(), MOST_CELLS);
    }
}
