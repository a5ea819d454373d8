//! Air that the beam heats, and that the wind carries out of it.

use crate::Grid;

/// Gas constant of dry air \[J/(kg K)\] (ICAO standard atmosphere).
const R_DRY: f64 = 287.053;
/// Specific heat of air at constant pressure \[J/(kg K)\] (Incropera et al., 7th ed., table A.4, 300 K).
const CP_AIR: f64 = 1007.0;

/// Warm air across a layer. Pressure evens out at the speed of sound, far faster than the wind carries: the heating is isobaric
/// (Gebhardt, Proc. SPIE 1221, 1990).
#[derive(Clone, Debug)]
pub struct HeatedAir {
    grid: Grid,
    /// Temperature above that of the air around \[K\].
    rise_k: Vec<f64>,
    scratch: Vec<f64>,
}

/// What air does with light that it absorbs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Absorbing {
    /// Share absorbed a metre \[1/m\].
    pub absorption_pm: f64,
    /// Temperature \[K\].
    pub temperature_k: f64,
    /// Pressure \[Pa\].
    pub pressure_pa: f64,
    /// Refractivity n - 1 \[1\].
    pub refractivity: f64,
}

impl HeatedAir {
    /// Air that nothing has warmed.
    pub fn new(grid: Grid) -> Self {
        Self {
            grid,
            rise_k: vec![0.0; grid.samples()],
            scratch: vec![0.0; grid.samples()],
        }
    }

    /// Carries the air by a shift \[m\] along rows and columns, in a time \[s\] in which light of an irradiance \[W/m²\] falls on it.
    /// What comes in over the border is cool.
    pub fn step(
        &mut self,
        dt_s: f64,
        shift_m: [f64; 2],
        air: &Absorbing,
        irradiance_wpm2: impl Fn(usize) -> f64,
    ) {
        let density = air.pressure_pa / (R_DRY * air.temperature_k);
        let half = 0.5 * dt_s * air.absorption_pm / (density * CP_AIR);
        // Half of the light before the way, half after it: the trapezium rule along the air's own path.
        let warm = |rise: &mut [f64]| {
            for (at, rise) in rise.iter_mut().enumerate() {
                *rise += half * irradiance_wpm2(at);
            }
        };
        warm(&mut self.rise_k);
        let n = self.grid.n;
        let [across, up] = shift_m.map(|shift| Moved::by(shift / self.grid.spacing_m));
        for (from, to) in self
            .rise_k
            .chunks_exact(n)
            .zip(self.scratch.chunks_exact_mut(n))
        {
            for (x, value) in to.iter_mut().enumerate() {
                *value = across.of(x, |i| from.get(i).copied());
            }
        }
        for y in 0..n {
            for x in 0..n {
                self.rise_k[y * n + x] = up.of(y, |j| {
                    self.scratch.get(j * n + x).copied().filter(|_| j < n)
                });
            }
        }
        warm(&mut self.rise_k);
    }

    /// Temperature above that of the air around \[K\].
    pub fn rise_k(&self) -> &[f64] {
        &self.rise_k
    }

    /// Optical path that a metre of air of a temperature rise adds \[m/K/m\]: n - 1 goes as 1/T at constant pressure.
    pub fn path_per_k(air: &Absorbing) -> f64 {
        -air.refractivity / air.temperature_k
    }
}

/// A move by some samples: four neighbours of where a value comes from, by Catmull and Rom's cubic.
#[derive(Clone, Copy)]
struct Moved {
    whole: isize,
    weights: [f64; 4],
}

impl Moved {
    fn by(samples: f64) -> Self {
        let back = -samples;
        let whole = back.floor();
        let t = back - whole;
        let (t2, t3) = (t * t, t * t * t);
        Self {
            whole: whole as isize,
            weights: [
                0.5 * (-t + 2.0 * t2 - t3),
                0.5 * (2.0 - 5.0 * t2 + 3.0 * t3),
                0.5 * (t + 4.0 * t2 - 3.0 * t3),
                0.5 * (t3 - t2),
            ],
        }
    }

    fn of(&self, at: usize, value: impl Fn(usize) -> Option<f64>) -> f64 {
        let first = at as isize + self.whole - 1;
        let mut sum = 0.0;
        for (k, weight) in self.weights.iter().enumerate() {
            let i = first + k as isize;
            if i >= 0 {
                sum += weight * value(i as usize).unwrap_or(0.0);
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_a_steady_wind_the_rise_is_the_light_that_the_air_has_crossed() {
        // ρ cp v dT/dx = α I: behind a Gaussian of peak I0 and radius W the rise is α I0 W sqrt(π/2) / (ρ cp v).
        let grid = Grid {
            n: 128,
            spacing_m: 2e-3,
        };
        let air = Absorbing {
            absorption_pm: 1e-5,
            temperature_k: 293.15,
            pressure_pa: 101_325.0,
            refractivity: 2.7e-4,
        };
        let (peak, w, speed, dt) = (1e6, 0.03, 3.0, 1e-3);
        let light = |at: usize| {
            let (x, y) = (grid.place_m(at % grid.n), grid.place_m(at / grid.n));
            peak * (-2.0 * (x * x + y * y) / (w * w)).exp()
        };
        let mut heated = HeatedAir::new(grid);
        for _ in 0..200 {
            heated.step(dt, [speed * dt, 0.0], &air, light);
        }
        let density = air.pressure_pa / (R_DRY * air.temperature_k);
        let whole = air.absorption_pm * peak * w * (std::f64::consts::PI / 2.0).sqrt()
            / (density * CP_AIR * speed);
        let middle = grid.n / 2 * grid.n + grid.n / 2;
        let behind = heated.rise_k()[grid.n / 2 * grid.n + grid.n - 2];
        assert!((heated.rise_k()[middle] / (0.5 * whole) - 1.0).abs() < 0.01);
        assert!((behind / whole - 1.0).abs() < 0.01, "{behind} {whole}");
    }
}
