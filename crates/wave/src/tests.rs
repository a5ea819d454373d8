//! The propagation against theory.

use super::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::{PI, TAU};

const LAMBDA: f64 = 1.064e-6;
const LENGTH: f64 = 1000.0;

fn normals(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    move || StandardNormal.sample(&mut rng)
}

fn laser() -> Aperture {
    Aperture {
        power_w: 1000.0,
        radius_m: 0.05,
        clear_radius_m: f64::INFINITY,
        wavelength_m: LAMBDA,
        m2: 1.0,
        focus_m: LENGTH,
    }
}

const KOLMOGOROV: VonKarman = VonKarman {
    outer_m: 100.0,
    inner_m: 0.0,
};

fn uniform(cn2: f64, count: usize) -> Vec<Layer> {
    even_layers(LENGTH, count, |_| (cn2, [3.0, 1.0]))
}

fn close(is: f64, wanted: f64, relative: f64) {
    assert!(
        (is / wanted - 1.0).abs() < relative,
        "{is} against {wanted}: {:+.3}",
        is / wanted - 1.0
    );
}

#[test]
fn a_gaussian_in_still_air_is_the_closed_form() {
    let grid = Grid {
        n: 256,
        spacing_m: 1.5e-3,
    };
    let mut wave = Wave::new(
        grid,
        &KOLMOGOROV,
        uniform(0.0, 4),
        LENGTH,
        1,
        &mut normals(1),
    );
    for m2 in [1.0, 1.5] {
        let spot = wave.send(&Aperture { m2, ..laser() }, 0.0);
        let w = m2 * LAMBDA * LENGTH / (PI * 0.05);
        close(spot.peak_wpm2(), 2.0 * 1000.0 / (PI * w * w), 1e-3);
        close(spot.radius_m(), w, 1e-3);
        let powers = spot.power_in_buckets_w([0.0; 2], &[0.005, 0.01, 0.02]);
        for (power, radius) in powers.iter().zip([0.005, 0.01, 0.02f64]) {
            close(
                *power,
                1000.0 * (1.0 - (-2.0 * (radius / w).powi(2)).exp()),
                5e-3,
            );
        }
    }
}

#[test]
fn air_without_a_border_keeps_the_energy_and_loses_what_it_absorbs() {
    let grid = Grid {
        n: 256,
        spacing_m: 2e-3,
    };
    let mut wave = Wave::new(
        grid,
        &KOLMOGOROV,
        uniform(1e-14, 10),
        LENGTH,
        1,
        &mut normals(2),
    );
    wave.periodic();
    let spot = wave.send(&laser(), 0.0);
    close(spot.power_w(), wave.sent_w(), 1e-8);
    let spot = wave.send(&laser(), 1e-4);
    close(spot.power_w(), wave.sent_w() * (-0.1f64).exp(), 1e-8);
}

#[test]
fn many_short_ways_are_one_long_one() {
    let grid = Grid {
        n: 256,
        spacing_m: 2e-3,
    };
    let spot = |count| {
        Wave::new(
            grid,
            &KOLMOGOROV,
            uniform(0.0, count),
            LENGTH,
            1,
            &mut normals(1),
        )
        .send(&laser(), 0.0)
    };
    let (one, many) = (spot(1), spot(16));
    let peak = one.peak_wpm2();
    for (a, b) in one.irradiance_wpm2.iter().zip(&many.irradiance_wpm2) {
        assert!((a - b).abs() < 1e-6 * peak);
    }
}

#[test]
fn air_may_fall_still_and_rise_again() {
    let grid = Grid {
        n: 128,
        spacing_m: 3e-3,
    };
    let mut wave = Wave::new(
        grid,
        &KOLMOGOROV,
        uniform(1e-14, 4),
        LENGTH,
        1,
        &mut normals(1),
    );
    let before = wave.send(&laser(), 0.0).peak_wpm2();
    wave.retune(uniform(0.0, 4), LENGTH);
    let w = LAMBDA * LENGTH / (PI * 0.05);
    close(
        wave.send(&laser(), 0.0).peak_wpm2(),
        2.0 * 1000.0 / (PI * w * w),
        1e-2,
    );
    wave.retune(uniform(1e-14, 4), LENGTH);
    assert_eq!(wave.send(&laser(), 0.0).peak_wpm2(), before);
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let grid = Grid {
        n: 128,
        spacing_m: 3e-3,
    };
    let spot = |threads| {
        let mut normal = normals(3);
        let mut wave = Wave::new(
            grid,
            &KOLMOGOROV,
            uniform(1e-14, 5),
            LENGTH,
            threads,
            &mut normal,
        );
        wave.carry(1e-3, &mut normal);
        wave.send(&laser(), 1e-4).irradiance_wpm2
    };
    assert_eq!(spot(1), spot(3));
}

#[test]
fn screens_have_von_karmans_structure_function() {
    // Over four octaves of distance; the mean of 1000 screens.
    let grid = Grid {
        n: 128,
        spacing_m: 4e-3,
    };
    let layer = Layer {
        middle_m: 0.0,
        thickness_m: 100.0,
        cn2: 1e-14,
        across_mps: [0.0; 2],
    };
    let apart = [4usize, 8, 16, 32, 64];
    let mut sums = [0.0; 5];
    let mut normal = normals(4);
    let count = 1000;
    for _ in 0..count {
        let mut screens = Screens::new(grid, &KOLMOGOROV, &[layer], &mut normal);
        let path = screens.path_m(0, 1);
        for (sum, apart) in sums.iter_mut().zip(apart) {
            let rows = 0..grid.n;
            let places = rows.flat_map(|y| (0..grid.n - apart).map(move |x| (x, y)));
            let (mut square, mut number) = (0.0, 0.0);
            for (x, y) in places {
                let across = path[y * grid.n + x + apart] - path[y * grid.n + x];
                let up = path[(x + apart) * grid.n + y] - path[x * grid.n + y];
                square += across * across + up * up;
                number += 2.0;
            }
            *sum += square / number / f64::from(count);
        }
    }
    for (sum, apart) in sums.iter().zip(apart) {
        close(
            *sum,
            KOLMOGOROV.structure_m2(layer.strength(), apart as f64 * grid.spacing_m),
            0.05,
        );
    }
}

#[test]
fn a_carried_screen_is_the_same_further_on() {
    let grid = Grid {
        n: 128,
        spacing_m: 4e-3,
    };
    let layer = Layer {
        middle_m: 0.0,
        thickness_m: 100.0,
        cn2: 1e-14,
        across_mps: [0.0; 2],
    };
    let mut normal = normals(5);
    let mut screens = Screens::new(grid, &KOLMOGOROV, &[layer], &mut normal);
    let before = screens.path_m(0, 1);
    // Three samples to the right, one down.
    screens.carry(&[[3.0 * grid.spacing_m, -grid.spacing_m]], &mut normal);
    let after = screens.path_m(0, 1);
    let (mut moved, mut still) = (0.0, 0.0);
    for y in 8..120 {
        for x in 8..120 {
            let now = after[y * grid.n + x];
            moved += (now - before[(y + 1) * grid.n + x - 3]).powi(2);
            still += (now - before[y * grid.n + x]).powi(2);
        }
    }
    assert!(moved < 0.15 * still, "{moved} {still}");
}

/// Scintillation index of a plane wave at the end of a uniform path of a Rytov variance.
fn plane_index(rytov: f64, grid: Grid, layers: usize, draws: u64) -> f64 {
    let k = TAU / LAMBDA;
    let cn2 = rytov / (1.23 * k.powf(7.0 / 6.0) * LENGTH.powf(11.0 / 6.0));
    let flat = Aperture {
        radius_m: 1e6,
        focus_m: f64::INFINITY,
        power_w: PI / 2.0 * 1e12,
        ..laser()
    };
    let (mut mean, mut square, mut number) = (0.0, 0.0, 0.0);
    for seed in 0..draws {
        let mut wave = Wave::new(
            grid,
            &KOLMOGOROV,
            uniform(cn2, layers),
            LENGTH,
            1,
            &mut normals(100 + seed),
        );
        wave.periodic();
        for value in wave.send(&flat, 0.0).irradiance_wpm2 {
            mean += value;
            square += value * value;
            number += 1.0;
        }
    }
    let mean: f64 = mean / number;
    square / number / (mean * mean) - 1.0
}

#[test]
fn a_plane_wave_scintillates_as_rytov_says_and_saturates_beyond() {
    let grid = Grid {
        n: 256,
        spacing_m: 3e-3,
    };
    // Weak: 0.0496 and 0.0999 by the theory of weak fluctuations to second order.
    close(plane_index(0.05, grid, 10, 12), 0.0496, 0.10);
    close(plane_index(0.1, grid, 10, 12), 0.0999, 0.10);
    // Strong: the index has its greatest values, and falls to 1 + 0.86 σ_R^(-4/5) (Andrews & Phillips, ch. 9).
    let peak = plane_index(
        10.0,
        Grid {
            n: 512,
            spacing_m: 1e-3,
        },
        20,
        2,
    );
    let strong = plane_index(
        40.0,
        Grid {
            n: 512,
            spacing_m: 7e-4,
        },
        40,
        2,
    );
    assert!(strong < peak && peak < 2.0, "{peak} {strong}");
    close(strong, 1.0 + 0.86 * 40f64.powf(-0.4), 0.15);
}

/// 1/e² radius from the mean irradiance on the axis of a focused beam through Kolmogorov's turbulence by the extended
/// Huygens–Fresnel integral: of 1/e² radius `w_m` in still air and `w0_m` at the aperture.
fn exact_long_term_m(w_m: f64, w0_m: f64, fried_m: f64) -> f64 {
    let x = (2.0 * w0_m * w0_m).powf(5.0 / 6.0) * (fried_m / 2.1).powf(-5.0 / 3.0);
    let n = 40_000;
    let dq = 40.0 / f64::from(n);
    let left: f64 = (0..n)
        .map(|i| (f64::from(i) + 0.5) * dq)
        .map(|q| (-q - x * q.powf(5.0 / 6.0)).exp() * dq)
        .sum();
    w_m / left.sqrt()
}

#[test]
fn a_focused_beam_spreads_and_wanders_as_theory_says() {
    let k = TAU / LAMBDA;
    let w = LAMBDA * LENGTH / (PI * 0.05);
    for (cn2, tolerance) in [(1e-15, 0.03), (1e-14, 0.05), (5e-14, 0.08)] {
        // A large outer scale: theory has none.
        let spectrum = VonKarman {
            outer_m: 300.0,
            inner_m: 0.0,
        };
        let grid = Grid {
            n: 256,
            spacing_m: 2.2e-3,
        };
        let mut long = Exposures::new(grid);
        for seed in 0..150 {
            let mut wave = Wave::new(
                grid,
                &spectrum,
                uniform(cn2, 10),
                LENGTH,
                1,
                &mut normals(1000 + seed),
            );
            long.add(&wave.send(&laser(), 0.0));
        }
        let fried = (0.423 * k * k * cn2 * LENGTH * 3.0 / 8.0).powf(-0.6);
        let wanted = exact_long_term_m(w, 0.05, fried);
        let axis = long.long().at_wpm2(0.0, 0.0);
        let is = (2.0 * 1000.0 / (PI * axis)).sqrt();
        close(is, wanted, tolerance);
    }
}

/// Gebhardt's distortion number of a focused beam in a steady wind across, and the share of the peak that his fit leaves
/// (Appl. Opt. 15, 1479, 1976; Proc. SPIE 1221, 1990): a = W0/sqrt 2,
/// N = (-n_T) α P L² / (π n0 ρ cp v a³) · (2/L²) ∫ (a/a(z')) ∫ (a/a(z''))² dz'' dz'.
fn gebhardt(laser: &Aperture, air: &Absorbing, speed_mps: f64) -> (f64, f64) {
    let n = 4000;
    let (mut inner, mut outer) = (0.0, 0.0);
    for i in 0..n {
        let dz = LENGTH / f64::from(n);
        let z = (f64::from(i) + 0.5) * dz;
        let w =
            (laser.radius_m * (1.0 - z / laser.focus_m)).hypot(LAMBDA * z / (PI * laser.radius_m));
        let narrowing = laser.radius_m / w;
        let heat = narrowing * narrowing * dz;
        outer += narrowing * (inner + 0.5 * heat) * dz;
        inner += heat;
    }
    let a = laser.radius_m / 2f64.sqrt();
    let density = air.pressure_pa / (287.053 * air.temperature_k);
    let bend = air.refractivity / air.temperature_k;
    let number = 2.0 * bend * air.absorption_pm * laser.power_w * outer
        / (PI * density * 1007.0 * speed_mps * a.powi(3));
    (number, 1.0 / (1.0 + 0.0625 * number * number))
}

#[test]
fn a_beam_that_warms_the_wind_blooms_as_gebhardt_found() {
    let air = Absorbing {
        absorption_pm: 1e-5,
        temperature_k: 288.15,
        pressure_pa: 101_325.0,
        refractivity: 2.74e-4,
    };
    let grid = Grid {
        n: 128,
        spacing_m: 1.9e-3,
    };
    for (power_w, wanted) in [(3000.0, 0.94), (12_000.0, 3.75), (20_000.0, 6.24)] {
        let laser = Aperture { power_w, ..laser() };
        let layers = even_layers(LENGTH, 24, |_| (0.0, [4.0, 0.0]));
        let mut wave = Wave::new(grid, &KOLMOGOROV, layers, LENGTH, 1, &mut normals(1));
        let cold = wave.send(&laser, 0.0).peak_wpm2();
        let mut spot = wave.send(&laser, 0.0);
        for _ in 0..60 {
            spot = wave.heat(&laser, 0.0, &air, 1e-3);
        }
        let (number, left) = gebhardt(&laser, &air, 4.0);
        close(number, wanted, 0.01);
        // His fit goes through calculations that scatter as much; here the wind is steady and the air turns no more.
        close(spot.peak_wpm2() / cold, left, 0.15);
        // The spot bends into the wind.
        assert!(spot.centroid_m()[0] < -1e-3 && spot.centroid_m()[1].abs() < 1e-6);
    }
}

/// Bessel's function of a whole order.
fn bessel(order: i32, x: f64) -> f64 {
    let n = 40 + (1.5 * x.abs()) as usize;
    let at = |i: usize| PI * (i as f64 + 0.5) / n as f64;
    (0..n)
        .map(|i| (f64::from(order) * at(i) - x * at(i).sin()).cos())
        .sum::<f64>()
        / n as f64
}

/// Radial and azimuthal order of Zernike's polynomials 2 to 15 in Noll's order, and whether it goes with the sine (J. Opt.
/// Soc. Am. 66, 207, 1976).
const NOLL: [(i32, i32, bool); 14] = [
    (1, 1, false),
    (1, 1, true),
    (2, 0, false),
    (2, 2, true),
    (2, 2, false),
    (3, 1, true),
    (3, 1, false),
    (3, 3, true),
    (3, 3, false),
    (4, 0, false),
    (4, 2, false),
    (4, 2, true),
    (4, 4, false),
    (4, 4, true),
];

fn zernike((n, m, sine): (i32, i32, bool), x: f64, y: f64) -> f64 {
    let factorial = |k: i32| (1..=k).map(f64::from).product::<f64>();
    let (r, angle) = (x.hypot(y), y.atan2(x) * f64::from(m));
    let radial: f64 = (0..=(n - m) / 2)
        .map(|k| {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let below = factorial(k) * factorial((n + m) / 2 - k) * factorial((n - m) / 2 - k);
            sign * factorial(n - k) / below * r.powi(n - 2 * k)
        })
        .sum();
    let turn = if m == 0 {
        1.0
    } else {
        2f64.sqrt() * if sine { angle.sin() } else { angle.cos() }
    };
    f64::from(n + 1).sqrt() * radial * turn
}

/// Mean square of a polynomial of radial order n over an aperture (Noll's equation 24, with an outer scale) \[m²\].
fn zernike_variance_m2(spectrum: &VonKarman, strength: f64, n: i32, diameter_m: f64) -> f64 {
    let (low, high, parts) = (1e-6f64, 60.0 / diameter_m, 3000);
    let step = (high / low).ln() / f64::from(parts);
    let sum: f64 = (0..parts)
        .map(|i| {
            let f = low * ((f64::from(i) + 0.5) * step).exp();
            let x = PI * f * diameter_m;
            f * f
                * spectrum.density(strength, f)
                * f64::from(n + 1)
                * (2.0 * bessel(n + 1, x) / x).powi(2)
        })
        .sum();
    TAU * sum * step
}

#[test]
fn the_integral_of_zernikes_variances_is_nolls_table() {
    // Differences of Noll's residuals, over (D/r0)^(5/3): 1.0299, 0.582, 0.134, 0.111, 0.0880, 0.0648.
    let spectrum = VonKarman {
        outer_m: f64::INFINITY,
        inner_m: 0.0,
    };
    let strength = 1.0 / 0.423; // r0 = 1 m at k = 1.
    for (n, wanted) in [(1, 0.448), (2, 0.0232), (3, 0.00619), (4, 0.00245)] {
        close(
            zernike_variance_m2(&spectrum, strength, n, 1.0),
            wanted,
            0.015,
        );
    }
}

#[test]
fn screens_have_zernikes_variances() {
    let grid = Grid {
        n: 64,
        spacing_m: 5e-3,
    };
    let radius_m = 0.1;
    let layer = Layer {
        middle_m: 0.0,
        thickness_m: 100.0,
        cn2: 1e-14,
        across_mps: [0.0; 2],
    };
    let inside: Vec<_> = (0..grid.samples())
        .map(|at| {
            (
                at,
                grid.place_m(at % grid.n) / radius_m,
                grid.place_m(at / grid.n) / radius_m,
            )
        })
        .filter(|(_, x, y)| x.hypot(*y) < 1.0)
        .collect();
    let shapes = NOLL.map(|noll| {
        inside
            .iter()
            .map(|(_, x, y)| zernike(noll, *x, *y))
            .collect::<Vec<_>>()
    });
    let mut normal = normals(7);
    let draws = 4000;
    let mut squares = [0.0; 14];
    for _ in 0..draws {
        let path = Screens::new(grid, &KOLMOGOROV, &[layer], &mut normal).path_m(0, 1);
        // On samples shapes are not quite at right angles: the strong ones are taken away first.
        let mean = inside.iter().map(|(at, ..)| path[*at]).sum::<f64>() / inside.len() as f64;
        let mut rest: Vec<f64> = inside.iter().map(|(at, ..)| path[*at] - mean).collect();
        for (square, shape) in squares.iter_mut().zip(&shapes) {
            let dot = |a: &[f64]| -> f64 { a.iter().zip(shape).map(|(a, z)| a * z).sum() };
            let share = dot(&rest) / dot(shape);
            rest.iter_mut()
                .zip(shape)
                .for_each(|(rest, z)| *rest -= share * z);
            *square += share * share / f64::from(draws);
        }
    }
    for (square, (n, ..)) in squares.iter().zip(NOLL) {
        let wanted = zernike_variance_m2(&KOLMOGOROV, layer.strength(), n, 2.0 * radius_m);
        close(*square, wanted, 0.10);
    }
}

#[test]
fn what_a_grid_cannot_sample_is_refused_with_the_mend() {
    let layers = uniform(1e-14, 10);
    let coarse = Sampling::of(
        Grid {
            n: 64,
            spacing_m: 1e-2,
        },
        &laser(),
        &layers,
        LENGTH,
    );
    let said = coarse.check().unwrap_err().to_string();
    assert!(said.contains("give more"), "{said}");
    let grid = Sampling::grid(&laser(), &layers, LENGTH).unwrap();
    Sampling::of(grid, &laser(), &layers, LENGTH)
        .check()
        .unwrap();
    // Nothing of a power of two is enough.
    let beam = Aperture {
        radius_m: 0.5,
        ..laser()
    };
    assert!(Sampling::grid(&beam, &uniform(1e-11, 2), LENGTH).is_err());
}
