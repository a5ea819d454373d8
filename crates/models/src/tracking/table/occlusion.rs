//! When the city hides a track, as far as its flight can be foreseen.

use super::track::{Occlusion, Track};
use crate::ground::dsm::{Dsm, LineOfSight};
use crate::maths::kinematics::los_to_az_el;
use glam::DVec3;

impl Track {
    /// Foresees when the city will next hide this track from `r_station_enu_m`, up to `horizon_s`
    /// after `t_s`. `None` if it stays in sight, or if its range is known too badly to tell.
    ///
    /// The line of sight is sampled every 0.1 s and the edges are bisected to 1 ms; what hides for
    /// less than the sampling is not seen.
    pub fn foresee_occlusion(
        &self,
        dsm: &Dsm,
        r_station_enu_m: DVec3,
        t_s: f64,
        horizon_s: f64,
    ) -> Option<Occlusion> {
        const STEP_S: f64 = 0.1;
        const LARGEST_SPREAD: f64 = 0.1; // of the range
        let (range_m, sigma_m) = self.range.range_m(t_s)?;
        if sigma_m > LARGEST_SPREAD * range_m {
            return None;
        }
        // Over seconds a straight flight is a better guess than constant rates of the angles.
        let (r_enu_m, v_enu_mps) = self.position_enu(r_station_enu_m, t_s)?;
        let ahead = |at_s: f64| r_enu_m + v_enu_mps * (at_s - t_s);
        let blocked =
            |at_s: f64| dsm.line_of_sight(r_station_enu_m, ahead(at_s)) != LineOfSight::Clear;
        let az_el_rad = |at_s: f64| los_to_az_el(ahead(at_s) - r_station_enu_m);
        // Between `before` (not yet `to`) and `after` (already `to`).
        let edge = |mut before: f64, mut after: f64, to: bool| {
            while after - before > 1e-3 {
                let middle = 0.5 * (before + after);
                if blocked(middle) == to {
                    after = middle;
                } else {
                    before = middle;
                }
            }
            after
        };
        let steps = (horizon_s / STEP_S).ceil() as usize;
        let times = (0..=steps).map(|i| t_s + STEP_S * i as f64);
        let mut enter_s = None;
        for at in times {
            match (enter_s, blocked(at)) {
                (None, true) if at == t_s => enter_s = Some(t_s),
                (None, true) => enter_s = Some(edge(at - STEP_S, at, true)),
                (Some(enter_s), false) => {
                    let exit_s = edge(at - STEP_S, at, false);
                    return Some(Occlusion {
                        enter_s,
                        exit_s: Some(exit_s),
                        exit_az_el_rad: az_el_rad(exit_s),
                    });
                }
                _ => {}
            }
        }
        enter_s.map(|enter_s| Occlusion {
            enter_s,
            exit_s: None,
            exit_az_el_rad: az_el_rad(t_s + horizon_s),
        })
    }
}
