//! The screens of `wave`.

use super::wave::{KOLMOGOROV, grid, normals};
use crate::check::{Check, Tolerance, a_fifth_more};
use crate::theory::{NOLL, zernike, zernike_variance_m2};
use boresight_wave::{Grid, Layer, Screens};

fn layer(cn2: f64) -> Layer {
    Layer {
        middle_m: 0.0,
        thickness_m: 100.0,
        cn2,
        across_mps: [0.0; 2],
    }
}

/// Works on so many screens of Cn² `cn2`, one after the other \[m\].
fn each_screen(grid: Grid, cn2: f64, count: usize, seed: u64, mut work: impl FnMut(&[f64])) {
    // What a set of screens has in common is worked out once for all of it.
    const SET: usize = 50;
    let mut normal = normals(seed);
    for first in (0..count).step_by(SET) {
        let layers = vec![layer(cn2); SET.min(count - first)];
        let mut screens = Screens::new(grid, &KOLMOGOROV, &layers, &mut normal);
        (0..layers.len()).for_each(|k| work(&screens.path_m(k, 1)));
    }
}

/// Structure function of screens of Cn² `cn2` over von Kármán's of 1e-14, at each of some distances in samples of 4 mm.
pub fn structure_ratios(cn2: f64, apart: &[usize], count: usize) -> Vec<f64> {
    let grid = grid(128, 4e-3);
    let mut sums = vec![0.0; apart.len()];
    each_screen(grid, cn2, count, 4, |path| {
        for (sum, apart) in sums.iter_mut().zip(apart) {
            let (mut square, mut number) = (0.0, 0.0);
            for y in 0..grid.n {
                for x in 0..grid.n - apart {
                    let across = path[y * grid.n + x + apart] - path[y * grid.n + x];
                    let up = path[(x + apart) * grid.n + y] - path[x * grid.n + y];
                    square += across * across + up * up;
                    number += 2.0;
                }
            }
            *sum += square / number / count as f64;
        }
    });
    let expected = |apart: &usize| {
        KOLMOGOROV.structure_m2(layer(1e-14).strength(), *apart as f64 * grid.spacing_m)
    };
    let pairs = sums.iter().zip(apart);
    pairs.map(|(sum, apart)| sum / expected(apart)).collect()
}

/// The one that is farthest from 1.
fn worst(ratios: impl IntoIterator<Item = f64>) -> f64 {
    ratios.into_iter().fold(1.0, |worst: f64, ratio| {
        match (ratio - 1.0).abs() > (worst - 1.0).abs() {
            true => ratio,
            false => worst,
        }
    })
}

/// Variances of Zernike's polynomials 2 to 15 of screens of Cn² `cn2`, over Noll's of 1e-14 with the outer scale.
fn zernike_ratios(cn2: f64) -> Vec<f64> {
    const DRAWS: usize = 4000;
    let (grid, radius_m) = (grid(64, 5e-3), 0.1);
    let places = (0..grid.samples()).map(|at| {
        let [x, y] = [at % grid.n, at / grid.n].map(|i| grid.place_m(i) / radius_m);
        (at, x, y)
    });
    let inside: Vec<_> = places.filter(|(_, x, y)| x.hypot(*y) < 1.0).collect();
    let shape = |noll| inside.iter().map(move |(_, x, y)| zernike(noll, *x, *y));
    let shapes = NOLL.map(|noll| shape(noll).collect::<Vec<_>>());
    let mut squares = [0.0; 14];
    each_screen(grid, cn2, DRAWS, 7, |path| {
        // On samples shapes are not quite at right angles: the strong ones are taken away first.
        let mean = inside.iter().map(|(at, ..)| path[*at]).sum::<f64>() / inside.len() as f64;
        let mut rest: Vec<f64> = inside.iter().map(|(at, ..)| path[*at] - mean).collect();
        for (square, shape) in squares.iter_mut().zip(&shapes) {
            let dot = |a: &[f64]| -> f64 { a.iter().zip(shape).map(|(a, z)| a * z).sum() };
            let share = dot(&rest) / dot(shape);
            let pairs = rest.iter_mut().zip(shape);
            pairs.for_each(|(rest, z)| *rest -= share * z);
            *square += share * share / DRAWS as f64;
        }
    });
    let wanted = |n| zernike_variance_m2(&KOLMOGOROV, layer(1e-14).strength(), n, 2.0 * radius_m);
    let of_order: Vec<f64> = (1..=4).map(wanted).collect();
    let pairs = squares.iter().zip(NOLL);
    pairs
        .map(|(square, (n, ..))| square / of_order[n as usize - 1])
        .collect()
}

pub fn checks() -> Vec<Check> {
    const VON_KARMAN: &str = "von Kármán's structure function in closed form, r0 0.1 m, L0 100 m";
    let structure = |name, value, run| Check {
        model: "propagation",
        name,
        reference: VON_KARMAN,
        value,
        unit: "rad²",
        tolerance: Tolerance::Relative(5e-3),
        mutation: a_fifth_more("strength of the layer"),
        run,
    };
    // 0.423 k² ∫Cn² = r0^(-5/3); with k = 1 the path is the phase.
    fn strength() -> f64 {
        0.1f64.powf(-5.0 / 3.0) / 0.423
    }
    vec![
        structure("spectrum's structure function at 0.125 m", 8.394, |scale| {
            Ok(KOLMOGOROV.structure_m2(scale.of(strength()), 0.125))
        }),
        structure("spectrum's structure function at 0.5 m", 75.15, |scale| {
            Ok(KOLMOGOROV.structure_m2(scale.of(strength()), 0.5))
        }),
        Check {
            model: "propagation",
            name: "screens' structure function over four octaves, the worst ratio",
            reference: "von Kármán's structure function",
            value: 1.0,
            unit: "",
            tolerance: Tolerance::Absolute(0.05),
            mutation: a_fifth_more("Cn²"),
            run: |scale| {
                Ok(worst(structure_ratios(
                    scale.of(1e-14),
                    &[4, 8, 16, 32, 64],
                    1000,
                )))
            },
        },
        Check {
            model: "propagation",
            name: "screens' Zernike variances 2 to 15, the worst ratio",
            reference: "Noll, J. Opt. Soc. Am. 66, 207, 1976, eq. 24, with the outer scale",
            value: 1.0,
            unit: "",
            tolerance: Tolerance::Absolute(0.10),
            mutation: a_fifth_more("Cn²"),
            run: |scale| Ok(worst(zernike_ratios(scale.of(1e-14)))),
        },
    ]
}
