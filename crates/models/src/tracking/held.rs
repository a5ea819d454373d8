//! What is truly held: the one test of evaluations and summaries.

use glam::DVec3;

/// What passes a line of sight within this is on it, however small it is [rad]: three widths of a UAV at 1 km, some tens
/// of standard deviations of a track.
pub const ON_RAD: f64 = 1e-3;

/// How far from a line of sight an object may be that counts as on it [rad]: [`ON_RAD`], or its own radius [m] at its
/// range [m] where that is more.
pub fn reach_rad(radius_m: f64, range_m: f64) -> f64 {
    ON_RAD.max(radius_m / range_m.max(1.0))
}

/// Of things with places from a station [m] and radii [m], that which is on a line of sight, a unit vector; of several the
/// nearest to it.
pub fn on_sight<T>(things: impl IntoIterator<Item = (T, DVec3, f64)>, sight: DVec3) -> Option<T> {
    let apart = things.into_iter().filter_map(|(thing, to_m, radius_m)| {
        let apart_rad = to_m.angle_between(sight);
        (apart_rad < reach_rad(radius_m, to_m.length())).then_some((apart_rad, thing))
    });
    let nearest = apart.min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map(|(_, thing)| thing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_to_the_sight_is_on_it() {
        let at = |right_m: f64| DVec3::new(right_m, 1_000.0, 0.0);
        let on = |things: &[(u8, DVec3, f64)]| on_sight(things.iter().copied(), DVec3::Y);
        assert_eq!(on(&[(1, at(0.9), 0.2), (2, at(-0.5), 0.2)]), Some(2));
        assert_eq!(on(&[(1, at(1.1), 0.2)]), None);
        assert_eq!(on(&[(1, at(1.1), 2.0)]), Some(1));
    }

    #[test]
    fn near_and_large_objects_reach_further() {
        assert_eq!(reach_rad(0.2, 1_000.0), ON_RAD);
        assert_eq!(reach_rad(5.0, 1_000.0), 5e-3);
        // Closer than a metre there is no angle to speak of.
        assert_eq!(reach_rad(0.2, 0.0), 0.2);
    }
}
