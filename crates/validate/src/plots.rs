//! What single checks are points of: curves over what they depend on, as data.

use crate::checks::screens::structure_ratios;
use crate::checks::wave::{FAR_M, exposures, long_term_m, plane_index};
use crate::theory;
use boresight_common::parallel::in_parallel;
use boresight_models::air::atmosphere::Cn2Profile;
use boresight_models::air::turbulence::{AirPath, PathTurbulence};
use boresight_wave::Grid;
use serde::Serialize;
use std::convert::Infallible;
use std::f64::consts::PI;

/// How values are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Evenly.
    Linear,
    /// By their logarithms.
    Log,
}

/// One curve.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// Its name.
    pub name: &'static str,
    /// Places across, and values.
    pub points: Vec<(f64, f64)>,
}

/// Curves over one another.
#[derive(Clone, Debug, Serialize)]
pub struct Plot {
    /// Name of its file.
    pub file: &'static str,
    /// What is drawn.
    pub title: &'static str,
    /// Unit of the values; empty for pure numbers.
    pub unit: &'static str,
    /// What it is drawn over, with its unit.
    pub across: &'static str,
    /// How the values are drawn.
    pub axis: Axis,
    /// The model, by its page's name.
    pub model: &'static str,
    /// The curves.
    pub lines: Vec<Line>,
}

const LAMBDA_M: f64 = 1.064e-6; // [m]
const LENGTH_M: f64 = 1000.0; // [m]
const W0_M: f64 = 0.05; // [m]
/// Radius of the focus in still air [m].
const FOCUS_M: f64 = LAMBDA_M * LENGTH_M / (PI * W0_M);

/// One curve's worth of work: a number for each place across, on so many threads.
fn curve(at: &[f64], threads: usize, of: impl Fn(f64) -> f64 + Sync) -> Vec<(f64, f64)> {
    let values = in_parallel(at, threads, |x| Ok::<_, Infallible>(of(*x)));
    let values = values.unwrap_or_else(|never| match never {});
    at.iter().copied().zip(values).collect()
}

/// The plots of the models named, of all where none is; `thorough` ones have more draws and reach into strong turbulence.
pub fn plots(models: &[String], thorough: bool, threads: usize) -> Vec<Plot> {
    let wanted = |name: &str| models.is_empty() || models.iter().any(|model| model == name);
    let mut all = Vec::new();
    if wanted("propagation") {
        all.push(structure(thorough));
        all.push(scintillation(thorough, threads));
    }
    if wanted("propagation") || wanted("turbulence") {
        all.push(long_term(thorough, threads));
    }
    all
}

/// Screens' structure function beside von Kármán's.
fn structure(thorough: bool) -> Plot {
    const APART: [usize; 11] = [2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64];
    const SPACING_M: f64 = 4e-3; // [m]
    let ratios = structure_ratios(1e-14, &APART, if thorough { 2000 } else { 300 });
    let at = |apart: usize| 1e3 * SPACING_M * apart as f64;
    let wanted = |apart: usize| {
        let k = 2.0 * PI / LAMBDA_M;
        let spectrum = boresight_wave::VonKarman {
            outer_m: 100.0,
            inner_m: 0.0,
        };
        k * k * spectrum.structure_m2(1e-12, SPACING_M * apart as f64)
    };
    let theory = APART.iter().map(|apart| (at(*apart), wanted(*apart)));
    let pairs = APART.iter().zip(&ratios);
    let ours = pairs.map(|(apart, ratio)| (at(*apart), ratio * wanted(*apart)));
    Plot {
        file: "structure",
        title: "Structure function of a screen, 100 m of Cn² 1e-14",
        unit: "rad²",
        across: "distance [mm]",
        axis: Axis::Log,
        model: "propagation",
        lines: vec![
            Line {
                name: "von Kármán",
                points: theory.collect(),
            },
            Line {
                name: "screens",
                points: ours.collect(),
            },
        ],
    }
}

/// A plane wave's scintillation index over its Rytov variance.
fn scintillation(thorough: bool, threads: usize) -> Plot {
    const WEAK: [f64; 6] = [0.01, 0.03, 0.1, 0.3, 0.6, 1.0];
    const STRONG: [f64; 4] = [2.0, 5.0, 10.0, 40.0];
    let finer = Grid {
        n: 512,
        spacing_m: 1e-3,
    };
    let coarser = Grid {
        n: 256,
        spacing_m: 3e-3,
    };
    let draws = if thorough { 12 } else { 4 };
    let mut ours = curve(&WEAK, threads, |rytov| {
        plane_index(rytov, coarser, 10, draws)
    });
    if thorough {
        ours.extend(curve(&STRONG, threads, |rytov| {
            plane_index(rytov, finer, 30, 3)
        }));
    }
    let last = ours.last().map_or(1.0, |point| point.0);
    let grid: Vec<f64> = (0..=60)
        .map(|i| 0.01 * (last / 0.01).powf(f64::from(i) / 60.0))
        .collect();
    let of = |f: fn(f64) -> f64| grid.iter().map(|rytov| (*rytov, f(*rytov))).collect();
    Plot {
        file: "scintillation",
        title: "Scintillation index of a plane wave",
        unit: "",
        across: "Rytov variance",
        axis: Axis::Log,
        model: "propagation",
        lines: vec![
            Line {
                name: "Andrews & Phillips",
                points: of(theory::plane_scintillation),
            },
            Line {
                name: "wave",
                points: ours,
            },
            Line {
                name: "Rytov",
                points: of(|rytov| rytov),
            },
        ],
    }
}

/// Long-term radius of a focused beam over Cn²: the weak formula, the model of theory, the wave.
fn long_term(thorough: bool, threads: usize) -> Plot {
    const CN2: [f64; 5] = [1e-15, 3e-15, 1e-14, 3e-14, 5e-14];
    let path = AirPath {
        length_m: LENGTH_M,
        h0_m: 10.0,
        h1_m: 10.0,
    };
    let uniform = |cn2| PathTurbulence::new(&Cn2Profile::Constant(cn2), &path, LAMBDA_M, FAR_M);
    let weak = |cn2| {
        let rytov = uniform(cn2).rytov_plane;
        1e3 * theory::weak_long_term_m(FOCUS_M, rytov, LENGTH_M, LAMBDA_M)
    };
    let exact = |cn2| 1e3 * uniform(cn2).long_term_radius_m(FOCUS_M);
    let grid: Vec<f64> = (0..=40)
        .map(|i| 1e-16 * 1e3f64.powf(f64::from(i) / 40.0))
        .collect();
    let draws = if thorough { 200 } else { 30 };
    Plot {
        file: "long-term",
        title: "Long-term 1/e² radius of W0 5 cm focused at 1 km, L0 300 m",
        unit: "mm",
        across: "Cn² [m^-2/3]",
        axis: Axis::Log,
        model: "turbulence",
        lines: vec![
            Line {
                name: "model, exact integral",
                points: curve(&grid, threads, exact),
            },
            Line {
                name: "wave",
                points: curve(&CN2, threads, |cn2| {
                    1e3 * long_term_m(&exposures(cn2, draws))
                }),
            },
            Line {
                name: "weak formula",
                points: curve(&grid, threads, weak),
            },
        ],
    }
}
