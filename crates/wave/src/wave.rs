//! The beam's way through the layers: free space, a screen, free space, and so on.

use crate::fft::{Transform, cis, rows};
use crate::{Absorbing, Complex64, Grid, HeatedAir, Layer, Screens, Spot, VonKarman};
use std::f64::consts::{PI, TAU};
use std::fmt;

/// Share of the square's half that stays clear of the absorbing border.
const CLEAR: f64 = 0.84;

/// A beam where it leaves: a Gaussian cut off by a round aperture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aperture {
    /// Power of the whole Gaussian \[W\].
    pub power_w: f64,
    /// Radius at 1/e² of the irradiance \[m\].
    pub radius_m: f64,
    /// Radius of the clear aperture \[m\]; infinite for none.
    pub clear_radius_m: f64,
    /// Wavelength \[m\].
    pub wavelength_m: f64,
    /// Beam propagation ratio M² \[1\], 1 or more. Such a beam spreads as one of M² times the wavelength and is bent as any
    /// other: it is propagated as that (Siegman, Proc. SPIE 1224, 1990).
    pub m2: f64,
    /// Distance at which it is focused \[m\]; infinite: collimated.
    pub focus_m: f64,
}

impl Aperture {
    /// Wavelength of the propagation \[m\].
    fn spreading_m(&self) -> f64 {
        self.m2 * self.wavelength_m
    }

    /// Where the aperture or the Gaussian (at 1e-4 of its peak) ends \[m\].
    fn end_m(&self) -> f64 {
        self.clear_radius_m.min(2.15 * self.radius_m)
    }

    /// Radius at 1/e² without air at a distance \[m\].
    fn radius_at_m(&self, distance_m: f64) -> f64 {
        let geometric = self.radius_m * (1.0 - distance_m / self.focus_m);
        geometric.hypot(self.spreading_m() * distance_m / (PI * self.radius_m))
    }
}

/// Why a path cannot be propagated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WaveError {
    /// The grid is too coarse or too small for it.
    #[error("{what}: {is:.3e} is more than {limit:.3e}; {mend}")]
    Sampled {
        /// Which quantity.
        what: &'static str,
        /// Its value.
        is: f64,
        /// What it may be at most.
        limit: f64,
        /// What helps.
        mend: &'static str,
    },
}

/// How well a grid samples a beam and its path: each quantity with what it may be at most.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampling {
    /// Quantity, value, greatest value allowed, mend.
    pub limits: Vec<(&'static str, f64, f64, &'static str)>,
}

impl Sampling {
    /// That of a beam over layers, to a target so far away \[m\] (Schmidt, Numerical Simulation of Optical Wave Propagation,
    /// SPIE 2010, ch. 7 to 9).
    pub fn of(grid: Grid, aperture: &Aperture, layers: &[Layer], length_m: f64) -> Self {
        const FINER: &str = "give more samples at a smaller spacing";
        const WIDER: &str = "give more samples";
        const LAYERS: &str = "give more layers";
        let (lambda, d, width) = (aperture.spreading_m(), grid.spacing_m, grid.width_m());
        let k = TAU / aperture.wavelength_m;
        // Fried's parameter for a point at the target, and Rytov's variance of each layer by the weight of a plane wave.
        let left = |layer: &Layer| (1.0 - layer.middle_m / length_m).max(0.0);
        let seen: f64 = layers
            .iter()
            .map(|layer| layer.strength() * left(layer).powf(5.0 / 3.0))
            .sum();
        let fried_m = (0.423 * k * k * seen).powf(-0.6);
        let rytov = |layer: &Layer| {
            2.25 * k.powf(7.0 / 6.0) * layer.strength() * (left(layer) * length_m).powf(5.0 / 6.0)
        };
        let worst = layers.iter().map(rytov).fold(0.0, f64::max);
        let spot_m = aperture.radius_at_m(length_m);
        let spread_m = spot_m.hypot(2.0 * lambda * length_m / (PI * fried_m));
        let apart_m = layers
            .iter()
            .map(|layer| layer.thickness_m)
            .fold(0.0, f64::max);
        let curved = if aperture.focus_m.is_finite() {
            aperture.end_m() / aperture.focus_m
        } else {
            0.0
        };
        Self {
            limits: vec![
                (
                    "aperture against the clear square [m]",
                    2.0 * aperture.end_m(),
                    CLEAR * width,
                    WIDER,
                ),
                (
                    "spread spot against the clear square [m]",
                    4.0 * spread_m,
                    CLEAR * width,
                    WIDER,
                ),
                ("spacing against the spot [m]", d, spot_m / 2.5, FINER),
                (
                    "spacing against the focus's and the air's bend [m]",
                    d,
                    lambda / (2.0 * (curved + 2.0 * lambda / fried_m)),
                    FINER,
                ),
                (
                    "spacing against Fried's parameter [m]",
                    d,
                    fried_m / 2.0,
                    FINER,
                ),
                (
                    "way between layers against the square [m]",
                    apart_m,
                    width * d / lambda,
                    LAYERS,
                ),
                ("Rytov's variance of a layer [1]", worst, 0.3, LAYERS),
            ],
        }
    }

    /// The smallest grid of a power of two, 64 to 2048 samples, that samples a beam well.
    ///
    /// # Errors
    /// None does: what the largest one lacks.
    pub fn grid(aperture: &Aperture, layers: &[Layer], length_m: f64) -> Result<Grid, WaveError> {
        let spot_m = aperture.radius_at_m(length_m);
        // From the finest spacing whose square holds the aperture, to that which still resolves the spot.
        let of = |n: usize, finer: f64| Grid {
            n,
            spacing_m: (spot_m / finer).min(12.0 * aperture.radius_m / n as f64),
        };
        let check = |grid: Grid| {
            let sampled = Self::of(grid, aperture, layers, length_m);
            sampled.check().map(|()| grid)
        };
        let sides = [64, 128, 256, 512, 1024, 2048];
        let grids = sides
            .iter()
            .flat_map(|n| [4.0, 3.0, 2.5].map(|finer| of(*n, finer)));
        let mut refused = check(of(64, 4.0));
        for grid in grids {
            refused = check(grid);
            if refused.is_ok() {
                break;
            }
        }
        refused
    }

    /// Whether each quantity is within its limit.
    ///
    /// # Errors
    /// The first that is not.
    pub fn check(&self) -> Result<(), WaveError> {
        for &(what, is, limit, mend) in &self.limits {
            if is.is_nan() || is > limit {
                return Err(WaveError::Sampled {
                    what,
                    is,
                    limit,
                    mend,
                });
            }
        }
        Ok(())
    }
}

impl fmt::Display for Sampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (what, is, limit, _) in &self.limits {
            writeln!(f, "{what:52} {is:10.3e} of {limit:10.3e}")?;
        }
        Ok(())
    }
}

/// A path that beams are sent along: its screens, and the air that they have warmed.
#[derive(Clone, Debug)]
pub struct Wave {
    grid: Grid,
    length_m: f64,
    threads: usize,
    layers: Vec<Layer>,
    screens: Screens,
    heated: Vec<HeatedAir>,
    transform: Transform,
    of_screens: Transform,
    border: Vec<f64>,
    field: Vec<Complex64>,
    sent_w: f64,
}

impl Wave {
    /// A path of a length \[m\] over layers, its screens drawn from normal numbers.
    pub fn new(
        grid: Grid,
        spectrum: &VonKarman,
        layers: Vec<Layer>,
        length_m: f64,
        threads: usize,
        normal: &mut impl FnMut() -> f64,
    ) -> Self {
        Self {
            grid,
            length_m,
            threads: threads.max(1),
            screens: Screens::new(grid, spectrum, &layers, normal),
            layers,
            heated: Vec::new(),
            transform: Transform::new(grid.n, threads),
            of_screens: Transform::new(grid.n, threads),
            border: (0..grid.n).map(|i| clear(grid, i)).collect(),
            field: vec![Complex64::ZERO; grid.samples()],
            sent_w: 0.0,
        }
    }

    /// Where its samples lie.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// The layers.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Other layers for the same screens: as many, of other strength, place or wind.
    pub fn retune(&mut self, layers: Vec<Layer>, length_m: f64) {
        self.screens.retune(&layers);
        self.layers = layers;
        self.length_m = length_m;
    }

    /// Carries the air on by a time \[s\].
    pub fn carry(&mut self, dt_s: f64, normal: &mut impl FnMut() -> f64) {
        let shifts: Vec<_> = self
            .layers
            .iter()
            .map(|layer| layer.across_mps.map(|v| v * dt_s))
            .collect();
        self.screens.carry(&shifts, normal);
    }

    /// Sends a beam along the path: what arrives. Of its light, air absorbs or scatters `extinction_pm` a metre.
    pub fn send(&mut self, aperture: &Aperture, extinction_pm: f64) -> Spot {
        self.start(aperture);
        self.cross(aperture, extinction_pm, None)
    }

    /// The same of a beam that warms the air for a time \[s\]; it meets what it has warmed before.
    pub fn heat(
        &mut self,
        aperture: &Aperture,
        extinction_pm: f64,
        air: &Absorbing,
        dt_s: f64,
    ) -> Spot {
        if self.heated.is_empty() {
            self.heated = vec![HeatedAir::new(self.grid); self.layers.len()];
        }
        self.start(aperture);
        self.cross(aperture, extinction_pm, Some((air, dt_s)))
    }

    /// A square that goes on behind its border as before it, for waves that fill it.
    pub fn periodic(&mut self) {
        self.border.fill(1.0);
        self.screens.without_long();
    }

    /// A time \[s\] in which no beam is sent: the wind carries the air that was warmed.
    pub fn rest(&mut self, air: &Absorbing, dt_s: f64) {
        for (warm, layer) in self.heated.iter_mut().zip(&self.layers) {
            warm.step(dt_s, layer.across_mps.map(|v| v * dt_s), air, |_| 0.0);
        }
    }

    /// Power that left the aperture last time \[W\].
    pub fn sent_w(&self) -> f64 {
        self.sent_w
    }

    /// The field where the beam leaves \[sqrt(W)/m\].
    fn start(&mut self, aperture: &Aperture) {
        let (grid, k) = (self.grid, TAU / aperture.spreading_m());
        let peak = (2.0 * aperture.power_w / (PI * aperture.radius_m.powi(2))).sqrt();
        rows(
            &mut self.field,
            grid.n,
            self.threads,
            |j, row, _| {
                let y = grid.place_m(j);
                for (i, value) in row.iter_mut().enumerate() {
                    let x = grid.place_m(i);
                    let r2 = x * x + y * y;
                    // The rim is a sample wide, so that the clear area is right on the average.
                    let open = ((aperture.clear_radius_m - r2.sqrt()) / grid.spacing_m + 0.5)
                        .clamp(0.0, 1.0);
                    let amplitude = peak * (-r2 / aperture.radius_m.powi(2)).exp() * open.sqrt();
                    *value = cis(-0.5 * k * r2 / aperture.focus_m) * amplitude;
                }
            },
            0,
        );
        self.sent_w = self.power_w();
    }

    fn power_w(&self) -> f64 {
        self.field.iter().map(|value| value.norm_sqr()).sum::<f64>() * self.grid.spacing_m.powi(2)
    }

    /// Takes the field through all layers.
    fn cross(
        &mut self,
        aperture: &Aperture,
        extinction_pm: f64,
        warming: Option<(&Absorbing, f64)>,
    ) -> Spot {
        let lambda = aperture.spreading_m();
        let k = TAU / lambda;
        let (grid, n, threads) = (self.grid, self.grid.n, self.threads);
        let mut at_m = 0.0;
        for first in (0..self.layers.len()).step_by(2) {
            let paths = self.screens.paths(first, &mut self.of_screens);
            for second in [false, true] {
                let Some(layer) = self.layers.get(first + usize::from(second)) else {
                    break;
                };
                travel(
                    grid,
                    &mut self.transform,
                    &mut self.field,
                    &self.border,
                    lambda,
                    layer.middle_m - at_m,
                    extinction_pm,
                );
                at_m = layer.middle_m;
                let warm = self.heated.get(first + usize::from(second));
                let per_k = warming.map_or(0.0, |(air, _)| {
                    HeatedAir::path_per_k(air) * layer.thickness_m
                });
                let paths = &*paths;
                rows(
                    &mut self.field,
                    n,
                    threads,
                    |y, row, _| {
                        let paths = &paths[y * n..][..n];
                        for (x, (value, path)) in row.iter_mut().zip(paths).enumerate() {
                            let mut path = if second { path.im } else { path.re };
                            if let Some(warm) = warm {
                                path += per_k * warm.rise_k()[y * n + x];
                            }
                            *value *= cis(k * path);
                        }
                    },
                    0,
                );
                if let Some((air, dt_s)) = warming {
                    let field = &self.field;
                    let shift_m = layer.across_mps.map(|v| v * dt_s);
                    let warm = &mut self.heated[first + usize::from(second)];
                    warm.step(dt_s, shift_m, air, |at| field[at].norm_sqr());
                }
            }
        }
        travel(
            grid,
            &mut self.transform,
            &mut self.field,
            &self.border,
            lambda,
            self.length_m - at_m,
            extinction_pm,
        );
        Spot {
            grid,
            irradiance_wpm2: self.field.iter().map(|value| value.norm_sqr()).collect(),
        }
    }
}

/// Free space over a distance \[m\]: Fresnel's transfer function.
fn travel(
    grid: Grid,
    transform: &mut Transform,
    field: &mut [Complex64],
    border: &[f64],
    lambda_m: f64,
    distance_m: f64,
    extinction_pm: f64,
) {
    let left = (-0.25 * extinction_pm * distance_m).exp();
    let transfer: Vec<_> = (0..grid.n)
        .map(|i| cis(-PI * lambda_m * distance_m * grid.frequency_pm(i).powi(2)) * left)
        .collect();
    transform.filter(field, &transfer, |y, row| {
        for (value, clear) in row.iter_mut().zip(border) {
            *value *= clear * border[y];
        }
    });
}

/// What the border lets through of the field at a column or row: all within, falling smoothly to nothing.
fn clear(grid: Grid, i: usize) -> f64 {
    let out = (grid.place_m(i).abs() / (0.5 * grid.width_m()) - CLEAR) / (1.0 - CLEAR);
    if out <= 0.0 {
        1.0
    } else {
        (0.5 * PI * out.min(1.0)).cos().powi(2).sqrt()
    }
}
