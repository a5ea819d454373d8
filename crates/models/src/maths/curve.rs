//! Smooth functions of one number.

/// Rises smoothly from 0 at `low` to 1 at `high`; flat outside. `low` may be the greater one.
pub fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_runs_from_0_to_1_either_way_and_is_flat_at_its_ends() {
        for [low, high] in [[2.0, 5.0], [5.0, 2.0]] {
            assert_eq!(smoothstep(low, high, low), 0.0);
            assert_eq!(smoothstep(low, high, high), 1.0);
            assert_eq!(smoothstep(low, high, 2.0 * low - high), 0.0);
            assert!((smoothstep(low, high, 3.5) - 0.5).abs() < 1e-15);
            // Near an end it grows as 3 t²: 3e-6 at a thousandth of the way.
            let near = smoothstep(low, high, low + 1e-3 * (high - low));
            assert!((near - 3e-6).abs() < 1e-8, "{near}");
        }
    }
}
