//! What arrives: a map of irradiance and what is read from it.

use crate::Grid;
use std::f64::consts::PI;

/// Irradiance across the beam at the target.
#[derive(Clone, Debug)]
pub struct Spot {
    /// Where the samples lie.
    pub grid: Grid,
    /// Irradiance \[W/m²\].
    pub irradiance_wpm2: Vec<f64>,
}

impl Spot {
    /// Power of all of it \[W\].
    pub fn power_w(&self) -> f64 {
        self.irradiance_wpm2.iter().sum::<f64>() * self.grid.spacing_m.powi(2)
    }

    /// Greatest irradiance \[W/m²\], between samples by a parabola on each axis.
    pub fn peak_wpm2(&self) -> f64 {
        let (n, map) = (self.grid.n, &self.irradiance_wpm2);
        let greatest = (0..map.len()).max_by(|a, b| map[*a].total_cmp(&map[*b]));
        let Some(at) = greatest else { return 0.0 };
        let (x, y) = (at % n, at / n);
        if x == 0 || y == 0 || x == n - 1 || y == n - 1 {
            return map[at];
        }
        let above = |before: f64, after: f64| {
            let bend = 2.0 * map[at] - before - after;
            if bend > 0.0 {
                (after - before).powi(2) / (8.0 * bend)
            } else {
                0.0
            }
        };
        map[at] + above(map[at - 1], map[at + 1]) + above(map[at - n], map[at + n])
    }

    /// Its centroid \[m\], along rows and along columns.
    pub fn centroid_m(&self) -> [f64; 2] {
        let n = self.grid.n;
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for (at, value) in self.irradiance_wpm2.iter().enumerate() {
            sum += value;
            x += value * self.grid.place_m(at % n);
            y += value * self.grid.place_m(at / n);
        }
        if sum > 0.0 {
            [x / sum, y / sum]
        } else {
            [0.0; 2]
        }
    }

    /// Irradiance at a place \[W/m²\], between samples by a line; none beyond them.
    pub fn at_wpm2(&self, x_m: f64, y_m: f64) -> f64 {
        let n = self.grid.n;
        let [x, y] = [x_m, y_m].map(|at| at / self.grid.spacing_m + (n / 2) as f64);
        if !(x >= 0.0 && y >= 0.0 && x < (n - 1) as f64 && y < (n - 1) as f64) {
            return 0.0;
        }
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f64, y - j as f64);
        let value = |i: usize, j: usize| self.irradiance_wpm2[j * n + i];
        (1.0 - v) * ((1.0 - u) * value(i, j) + u * value(i + 1, j))
            + v * ((1.0 - u) * value(i, j + 1) + u * value(i + 1, j + 1))
    }

    /// Power within each of some radii \[m\] about a place \[W\]. A sample at the rim counts by the part of its square inside.
    pub fn power_in_buckets_w(&self, centre_m: [f64; 2], radii_m: &[f64]) -> Vec<f64> {
        const PARTS: usize = 5;
        let (n, d) = (self.grid.n, self.grid.spacing_m);
        let mut powers = vec![0.0; radii_m.len()];
        for at in 0..self.irradiance_wpm2.len() {
            let value = self.square_wpm2(at);
            let (x, y) = (
                self.grid.place_m(at % n) - centre_m[0],
                self.grid.place_m(at / n) - centre_m[1],
            );
            let far = x.hypot(y);
            for (power, radius) in powers.iter_mut().zip(radii_m) {
                let inside = if far + d < *radius {
                    1.0
                } else if far - d > *radius {
                    0.0
                } else {
                    let part = |i: usize| ((i as f64 + 0.5) / PARTS as f64 - 0.5) * d;
                    let parts = (0..PARTS).flat_map(|i| (0..PARTS).map(move |j| (i, j)));
                    let within =
                        parts.filter(|(i, j)| (x + part(*i)).hypot(y + part(*j)) < *radius);
                    within.count() as f64 / (PARTS * PARTS) as f64
                };
                *power += value * d * d * inside;
            }
        }
        powers
    }

    /// Irradiance of a sample's square, so that squares have the spread of the spot itself: a square's own spread of d²/12 on
    /// each axis is taken away by the second differences.
    fn square_wpm2(&self, at: usize) -> f64 {
        let (n, map) = (self.grid.n, &self.irradiance_wpm2);
        let (x, y) = (at % n, at / n);
        if x == 0 || y == 0 || x == n - 1 || y == n - 1 {
            return map[at];
        }
        map[at] - (map[at - 1] + map[at + 1] + map[at - n] + map[at + n] - 4.0 * map[at]) / 24.0
    }

    /// Radius at 1/e² of the Gaussian that has the same power and peak \[m\].
    pub fn radius_m(&self) -> f64 {
        (2.0 * self.power_w() / (PI * self.peak_wpm2())).sqrt()
    }
}

/// Mean spots of many moments: as they lie, and each moved to its centroid first.
#[derive(Clone, Debug)]
pub struct Exposures {
    grid: Grid,
    count: usize,
    long: Vec<f64>,
    short: Vec<f64>,
    /// Sum of squares of the centroid's distance from the axis \[m²\].
    wander2_m2: f64,
}

impl Exposures {
    /// None so far.
    pub fn new(grid: Grid) -> Self {
        Self {
            grid,
            count: 0,
            long: vec![0.0; grid.samples()],
            short: vec![0.0; grid.samples()],
            wander2_m2: 0.0,
        }
    }

    /// Adds a moment.
    pub fn add(&mut self, spot: &Spot) {
        let [cx, cy] = spot.centroid_m();
        let n = self.grid.n;
        self.count += 1;
        self.wander2_m2 += cx * cx + cy * cy;
        for at in 0..self.long.len() {
            self.long[at] += spot.irradiance_wpm2[at];
            self.short[at] += spot.at_wpm2(
                self.grid.place_m(at % n) + cx,
                self.grid.place_m(at / n) + cy,
            );
        }
    }

    /// The mean as they lie: a long exposure.
    pub fn long(&self) -> Spot {
        self.mean(&self.long)
    }

    /// The mean about the centroid: a short exposure.
    pub fn short(&self) -> Spot {
        self.mean(&self.short)
    }

    /// Root of the mean square of the centroid's distance from the axis \[m\].
    pub fn wander_rms_m(&self) -> f64 {
        (self.wander2_m2 / self.count.max(1) as f64).sqrt()
    }

    fn mean(&self, of: &[f64]) -> Spot {
        let count = self.count.max(1) as f64;
        Spot {
            grid: self.grid,
            irradiance_wpm2: of.iter().map(|sum| sum / count).collect(),
        }
    }
}
