//! How threatening an object is: the time in which it could reach the protected asset.

use glam::DVec3;

/// Least speed assumed of any object [m/s]: one that hovers may set off at any time.
const LEAST_MPS: f64 = 2.0;
/// Share of its speed that any object is assumed to have towards the asset: it may turn.
const TURN_SHARE: f64 = 0.3;

/// Time [s] until an object at `r_enu_m` with `v_enu_mps` is at the asset: distance over the speed
/// of approach, which is taken as at least [`TURN_SHARE`] of its speed and [`LEAST_MPS`]. Shorter
/// is more threatening.
pub fn time_to_asset_s(r_enu_m: DVec3, v_enu_mps: DVec3, r_asset_enu_m: DVec3) -> f64 {
    let to_asset_m = r_asset_enu_m - r_enu_m;
    let distance_m = to_asset_m.length();
    let approach_mps = v_enu_mps.dot(to_asset_m) / distance_m.max(1e-9);
    distance_m
        / approach_mps
            .max(TURN_SHARE * v_enu_mps.length())
            .max(LEAST_MPS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_comes_straight_at_the_asset_goes_first() {
        let asset = DVec3::new(0.0, 0.0, 20.0);
        let at = |r: DVec3, v: DVec3| time_to_asset_s(r, v, asset);
        let r = DVec3::new(0.0, 800.0, 20.0);
        // Head-on at 10 m/s: exactly distance over speed.
        assert!((at(r, DVec3::new(0.0, -10.0, 0.0)) - 80.0).abs() < 1e-12);
        // Crossing or leaving counts as three tenths of the speed, a hover as 2 m/s.
        assert!((at(r, DVec3::new(10.0, 0.0, 0.0)) - 800.0 / 3.0).abs() < 1e-9);
        assert!((at(r, DVec3::new(0.0, 10.0, 0.0)) - 800.0 / 3.0).abs() < 1e-9);
        assert!((at(r, DVec3::ZERO) - 400.0).abs() < 1e-9);
    }
}
