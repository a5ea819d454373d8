//! Smooth random fields over the plane.

use glam::DVec2;

use super::rng::Stream;

/// Nodes of the lattice along each axis, after which the field repeats.
const PERIOD: usize = 64;

/// Value noise: uniform numbers in -1..1 on a unit lattice, joined smoothly.
#[derive(Clone, Debug)]
pub struct ValueNoise(Vec<f64>);

impl ValueNoise {
    /// A field with the numbers of its nodes drawn from `rng`.
    pub fn new(rng: &mut Stream) -> Self {
        Self((0..PERIOD * PERIOD).map(|_| rng.range(-1.0, 1.0)).collect())
    }

    /// The field at a point in lattice units, -1..1.
    pub fn at(&self, p: DVec2) -> f64 {
        let cell = p.floor();
        let f = p - cell;
        let f = f * f * (DVec2::splat(3.0) - 2.0 * f);
        let value = |di: i64, dj: i64| {
            // The period is a power of two: its mask is the remainder.
            let [i, j] = [cell.x as i64 + di, cell.y as i64 + dj].map(|k| k as usize % PERIOD);
            self.0[j * PERIOD + i]
        };
        let south = value(0, 0) + (value(1, 0) - value(0, 0)) * f.x;
        let north = value(0, 1) + (value(1, 1) - value(0, 1)) * f.x;
        south + (north - south) * f.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_is_continuous_bounded_and_periodic() {
        let noise = ValueNoise::new(&mut Stream::new(3, 0, "noise-test"));
        for k in 0..2000 {
            let p = DVec2::new(0.37 * f64::from(k) - 300.0, 0.11 * f64::from(k));
            let here = noise.at(p);
            assert!((-1.0..=1.0).contains(&here));
            // The steepest slope is 2 (from -1 to 1) times 1.5 (of the smooth step) along each axis.
            let near = noise.at(p + DVec2::splat(1e-4));
            assert!((near - here).abs() < 6.1e-4, "{here} {near}");
            let far = noise.at(p + DVec2::splat(PERIOD as f64));
            assert!((far - here).abs() < 1e-9);
        }
    }
}
