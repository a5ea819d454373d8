//! What is truly held: the one test of evaluations and summaries.

/// What passes a line of sight within this is on it, however small it is [rad]: three widths of a UAV at 1 km, some tens
/// of standard deviations of a track.
pub const ON_RAD: f64 = 1e-3;

/// How far from a line of sight an object may be that counts as on it [rad]: [`ON_RAD`], or its own radius [m] at its
/// range [m] where that is more.
pub fn reach_rad(radius_m: f64, range_m: f64) -> f64 {
    ON_RAD.max(radius_m / range_m.max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_and_large_objects_reach_further() {
        assert_eq!(reach_rad(0.2, 1_000.0), ON_RAD);
        assert_eq!(reach_rad(5.0, 1_000.0), 5e-3);
        // Closer than a metre there is no angle to speak of.
        assert_eq!(reach_rad(0.2, 0.0), 0.2);
    }
}
