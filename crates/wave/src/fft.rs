//! Transforms of a square, a row at a time, over threads.
//!
//! Every row is worked out by itself, so that the number of threads changes no bit.

use crate::Complex64;
use rustfft::{Fft, FftPlanner};
use std::fmt;
use std::sync::Arc;

/// Side of the blocks in which a square is transposed: two of them fit the first cache.
const BLOCK: usize = 16;

/// Transforms of `n` × `n` samples.
#[derive(Clone)]
pub struct Transform {
    n: usize,
    threads: usize,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
    /// The square, transposed.
    across: Vec<Complex64>,
}

impl fmt::Debug for Transform {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Transform of {} samples", self.n)
    }
}

impl Transform {
    /// Transforms of squares of `n` samples a side, by at most so many threads.
    pub fn new(n: usize, threads: usize) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            n,
            threads: threads.max(1),
            forward: planner.plan_fft_forward(n),
            inverse: planner.plan_fft_inverse(n),
            across: vec![Complex64::default(); n * n],
        }
    }

    /// Multiplies the transform of a field by `transfer[x]` · `transfer[y]`, and transforms it back. `before` may change
    /// each row first.
    pub fn filter(
        &mut self,
        field: &mut [Complex64],
        transfer: &[Complex64],
        before: impl Fn(usize, &mut [Complex64]) + Sync,
    ) {
        let Self {
            n,
            threads,
            forward,
            inverse,
            across,
        } = self;
        let (n, threads) = (*n, *threads);
        rows(
            field,
            n,
            threads,
            |y, row, scratch| {
                before(y, row);
                forward.process_with_scratch(row, scratch);
            },
            forward.get_inplace_scratch_len(),
        );
        transpose(field, across, n, threads);
        let scale = 1.0 / (n * n) as f64;
        let scratch = forward
            .get_inplace_scratch_len()
            .max(inverse.get_inplace_scratch_len());
        rows(
            across,
            n,
            threads,
            |x, row, scratch| {
                forward.process_with_scratch(row, scratch);
                let own = transfer[x] * scale;
                for (value, other) in row.iter_mut().zip(transfer) {
                    *value *= own * other;
                }
                inverse.process_with_scratch(row, scratch);
            },
            scratch,
        );
        transpose(across, field, n, threads);
        rows(
            field,
            n,
            threads,
            |_, row, scratch| inverse.process_with_scratch(row, scratch),
            scratch,
        );
    }

    /// The inverse transform, unscaled, of a spectrum whose rows are frequencies across; it is given back in rows of places.
    pub fn inverse(&mut self, spectrum: &mut [Complex64]) {
        let Self {
            n,
            threads,
            inverse,
            across,
            ..
        } = self;
        let (n, threads) = (*n, *threads);
        let scratch = inverse.get_inplace_scratch_len();
        rows(
            spectrum,
            n,
            threads,
            |_, row, scratch| inverse.process_with_scratch(row, scratch),
            scratch,
        );
        transpose(spectrum, across, n, threads);
        rows(
            across,
            n,
            threads,
            |_, row, scratch| inverse.process_with_scratch(row, scratch),
            scratch,
        );
        transpose(across, spectrum, n, threads);
    }
}

/// Works on each row of a square with scratch space of a length, over threads.
pub fn rows<T: Send>(
    square: &mut [T],
    n: usize,
    threads: usize,
    work: impl Fn(usize, &mut [T], &mut [Complex64]) + Sync,
    scratch: usize,
) {
    let of_each = n.div_ceil(threads);
    bands(square, n, of_each, |first, rows| {
        let mut scratch = vec![Complex64::default(); scratch];
        for (at, row) in rows.chunks_exact_mut(n).enumerate() {
            work(first + at, row, &mut scratch);
        }
    });
}

/// The transpose of a square.
fn transpose(from: &[Complex64], to: &mut [Complex64], n: usize, threads: usize) {
    let of_each = n.div_ceil(BLOCK).div_ceil(threads) * BLOCK;
    bands(to, n, of_each, |first, rows| {
        for (block, rows) in rows.chunks_mut(BLOCK * n).enumerate() {
            let y0 = first + block * BLOCK;
            for x0 in (0..n).step_by(BLOCK) {
                for (dy, row) in rows.chunks_exact_mut(n).enumerate() {
                    for x in x0..(x0 + BLOCK).min(n) {
                        row[x] = from[x * n + y0 + dy];
                    }
                }
            }
        }
    });
}

/// Works on bands of so many rows, each by its first row's number, a thread each; the first by this one.
fn bands<T: Send>(
    square: &mut [T],
    n: usize,
    of_each: usize,
    work: impl Fn(usize, &mut [T]) + Sync,
) {
    std::thread::scope(|scope| {
        let mut bands = square.chunks_mut(of_each * n).enumerate();
        let own = bands.next();
        for (at, rows) in bands {
            let work = &work;
            scope.spawn(move || work(at * of_each, rows));
        }
        if let Some((_, rows)) = own {
            work(0, rows);
        }
    });
}

/// e^(i x). Its own polynomials are many times faster than the library's over rows, and the same on every machine; absolute
/// error below 1e-11 for |x| below 1e5 [rad].
#[inline(always)]
pub fn cis(x: f64) -> Complex64 {
    // Adding and taking away rounds to a whole number, as no instruction of every processor does.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let turns = x * std::f64::consts::TAU.recip();
    let rest = turns - ((turns + ROUND) - ROUND);
    // A quarter of the angle, at most pi/4, by Taylor's series; then doubled twice.
    let a = rest * std::f64::consts::FRAC_PI_2;
    let a2 = a * a;
    let sin = a
        * (1.0
            + a2 * (-1.0 / 6.0
                + a2 * (1.0 / 120.0
                    + a2 * (-1.0 / 5040.0
                        + a2 * (1.0 / 362_880.0
                            + a2 * (-1.0 / 39_916_800.0 + a2 * (1.0 / 6_227_020_800.0)))))));
    let cos = 1.0
        + a2 * (-0.5
            + a2 * (1.0 / 24.0
                + a2 * (-1.0 / 720.0
                    + a2 * (1.0 / 40_320.0
                        + a2 * (-1.0 / 3_628_800.0
                            + a2 * (1.0 / 479_001_600.0 + a2 * (-1.0 / 87_178_291_200.0)))))));
    let (s2, c2) = (2.0 * sin * cos, cos * cos - sin * sin);
    Complex64::new(c2 * c2 - s2 * s2, 2.0 * s2 * c2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_circle_is_the_librarys() {
        for i in -100_000..100_000 {
            let x = f64::from(i) * 0.037;
            let (sin, cos) = x.sin_cos();
            assert!((cis(x) - Complex64::new(cos, sin)).norm() < 1e-11, "{x}");
        }
    }

    #[test]
    fn a_filter_of_ones_changes_nothing_for_any_number_of_threads() {
        let n = 48;
        let field: Vec<_> = (0..n * n).map(|i| cis((i * i) as f64 * 0.37)).collect();
        let filtered = |threads| {
            let mut own = field.clone();
            Transform::new(n, threads).filter(&mut own, &vec![Complex64::ONE; n], |_, _| ());
            own
        };
        let one = filtered(1);
        assert!(one.iter().zip(&field).all(|(a, b)| (a - b).norm() < 1e-13));
        assert_eq!(one, filtered(2));
        assert_eq!(one, filtered(5));
    }
}
