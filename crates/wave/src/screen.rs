//! Screens of turbulence that the wind carries along.
//!
//! A screen is a sum of plane waves. Those on the grid's frequencies are summed by a transform, and would come again after
//! the grid's width: over that way they give place to others, smoothly, so that over short ways the flow is frozen. Longer
//! ones are summed by themselves (subharmonics; Lane, Glindemann & Dainty, Waves in Random Media 2, 209, 1992); they never
//! come again. Every wave turns its phase as frozen flow says, by any part of a sample.
//!
//! Rejected: a little noise on every wave in every step (autoregression), since the difference over a short time then grows
//! with the time, where frozen flow's grows with its power of 5/3; new rows at one side (Assémat & Wilson, Opt. Express 14,
//! 988, 2006), since winds and slews of layers turn, and a part of a sample would be interpolated.

use crate::fft::{Transform, cis};
use crate::{Complex64, Grid, Layer, VonKarman};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Waves on the grid's frequencies up to this one give place to a lattice three times as fine: apertures fill half of the
/// square, so that a few waves across it make more of one shape than of another.
const COARSE: usize = 1;
/// Half of the sides, in waves, of the lattices of subharmonics; each is three times as fine as the one before it, and fills
/// the middle of that one.
const LATTICES: [i32; 5] = [4, 1, 1, 1, 1];

/// How far the air has gone \[m\] along rows and along columns, against the axis.
pub type Shift = [f64; 2];

/// A screen for each of several layers.
#[derive(Clone, Debug)]
pub struct Screens {
    grid: Grid,
    layers: Vec<Screen>,
    /// Root of the mean square of each wave of the upper half of the frequencies, of a layer of strength one.
    rms: Vec<f64>,
    /// Two screens as one transform: the real and the imaginary part.
    pair: Vec<Complex64>,
}

#[derive(Clone, Debug)]
struct Screen {
    /// Root of the layer's strength; all amplitudes here are those of strength one.
    root: f64,
    /// Amplitude of each wave of the upper half of the frequencies, rows of equal frequency; the rest follows from a screen
    /// being real.
    waves: Vec<Complex64>,
    /// Those that come in their place; empty before the first way.
    next: Vec<Complex64>,
    /// Way since they began to \[grid's widths\], below 1.
    gone: f64,
    /// Subharmonics.
    long: Vec<LongWave>,
    shift_m: Shift,
}

/// A wave longer than the square, and its mirrored one.
#[derive(Clone, Copy, Debug)]
struct LongWave {
    /// Frequency of its lattice \[cycles/m\], and how many times that it has along rows and along columns.
    side_pm: f64,
    right: i32,
    up: i32,
    amplitude: Complex64,
}

impl Screens {
    /// Screens of layers, drawn from normal numbers.
    pub fn new(
        grid: Grid,
        spectrum: &VonKarman,
        layers: &[Layer],
        normal: &mut impl FnMut() -> f64,
    ) -> Self {
        let rms = roots(grid, spectrum);
        let long: Vec<_> = lattice(grid)
            .map(|(side_pm, right, up)| {
                let middle = [right, up].map(|n| f64::from(n) * side_pm);
                let power = spectrum.of_cell(1.0, middle, side_pm, apart_m(grid));
                (side_pm, right, up, power.sqrt())
            })
            .collect();
        let layers = layers.iter().map(|layer| Screen {
            root: layer.strength().sqrt(),
            waves: fresh(&rms, normal),
            next: Vec::new(),
            gone: 0.0,
            long: (long.iter())
                .map(|(side_pm, right, up, rms)| LongWave {
                    side_pm: *side_pm,
                    right: *right,
                    up: *up,
                    amplitude: draw(normal) * *rms,
                })
                .collect(),
            shift_m: [0.0; 2],
        });
        Self {
            grid,
            layers: layers.collect(),
            rms,
            pair: vec![Complex64::ZERO; grid.samples()],
        }
    }

    /// Changes the layers' strengths, not their patterns.
    pub fn retune(&mut self, layers: &[Layer]) {
        for (screen, layer) in self.layers.iter_mut().zip(layers) {
            screen.root = layer.strength().sqrt();
        }
    }

    /// Carries each layer on by a shift.
    pub fn carry(&mut self, shifts_m: &[Shift], normal: &mut impl FnMut() -> f64) {
        for (screen, [x, y]) in self.layers.iter_mut().zip(shifts_m) {
            screen.shift_m[0] += x;
            screen.shift_m[1] += y;
            screen.gone += x.hypot(*y) / self.grid.width_m();
            if screen.next.is_empty() && screen.gone > 0.0 {
                screen.next = fresh(&self.rms, normal);
            }
            if screen.gone >= 1.0 {
                // More than a width in one step is as good as one.
                screen.gone = screen.gone.fract();
                screen.waves = std::mem::replace(&mut screen.next, fresh(&self.rms, normal));
            }
        }
    }

    /// The optical path through two layers \[m\], as the real and the imaginary part of each sample; that of the last layer
    /// alone where their number is odd.
    pub(crate) fn paths(&mut self, first: usize, transform: &mut Transform) -> &mut [Complex64] {
        let (grid, n) = (self.grid, self.grid.n);
        let here = &self.layers[first];
        let next = self.layers.get(first + 1);
        let here_carried = here.carried(grid);
        let next_carried = next.map(|next| (next, next.carried(grid)));
        self.pair.fill(Complex64::ZERO);
        for j in 0..n / 2 {
            let columns = if j == 0 { 1..n / 2 } else { 0..n };
            for i in columns {
                let at = j * n + i;
                let a = here_carried.wave(here, i, j, at);
                let b = next_carried
                    .as_ref()
                    .map_or(Complex64::ZERO, |(next, carried)| {
                        carried.wave(next, i, j, at)
                    });
                // i b, and the mirrored wave of both.
                let ib = Complex64::new(-b.im, b.re);
                self.pair[at] = a + ib;
                self.pair[(n - j) % n * n + (n - i) % n] = (a - ib).conj();
            }
        }
        transform.inverse(&mut self.pair);
        add_long(grid, here, &mut self.pair, |value, path| value.re += path);
        if let Some(next) = next {
            add_long(grid, next, &mut self.pair, |value, path| value.im += path);
        }
        &mut self.pair
    }

    /// Screens of the grid's own waves alone.
    pub(crate) fn without_long(&mut self) {
        self.layers
            .iter_mut()
            .for_each(|screen| screen.long.clear());
    }

    /// The optical path through one layer \[m\].
    pub fn path_m(&mut self, layer: usize, threads: usize) -> Vec<f64> {
        let mut transform = Transform::new(self.grid.n, threads);
        let pair = self.paths(layer, &mut transform);
        pair.iter().map(|value| value.re).collect()
    }
}

/// What the way that a screen has gone makes of its waves.
struct Carried {
    /// Turn of the phase of each column of frequencies, and of each row.
    columns: Vec<Complex64>,
    rows: Vec<Complex64>,
    /// Shares of the waves that go and of those that come, over strength one.
    shares: [f64; 2],
}

impl Screen {
    fn carried(&self, grid: Grid) -> Carried {
        let turns = |axis: usize| -> Vec<Complex64> {
            (0..grid.n)
                .map(|i| cis(-TAU * grid.frequency_pm(i) * self.shift_m[axis]))
                .collect()
        };
        let mixed = cis(self.gone * FRAC_PI_2);
        Carried {
            columns: turns(0),
            rows: turns(1),
            shares: [mixed.re * self.root, mixed.im * self.root],
        }
    }
}

impl Carried {
    #[inline(always)]
    fn wave(&self, of: &Screen, column: usize, row: usize, at: usize) -> Complex64 {
        let comes = of.next.get(at).copied().unwrap_or_default();
        (of.waves[at] * self.shares[0] + comes * self.shares[1])
            * (self.columns[column] * self.rows[row])
    }
}

/// Places of the subharmonics: frequency of the lattice \[cycles/m\], and how many times that, right and up. Of two that mirror
/// each other the upper one, or the right one.
fn lattice(grid: Grid) -> impl Iterator<Item = (f64, i32, i32)> {
    let mut side_pm = 1.0 / grid.width_m();
    LATTICES.into_iter().flat_map(move |half| {
        side_pm /= 3.0;
        let side_pm = side_pm;
        let all =
            (0..=half).flat_map(move |up| (-half..=half).map(move |right| (side_pm, right, up)));
        // The middle is the next lattice's.
        all.filter(|(_, right, up)| *up > 0 || *right > 0)
    })
}

/// Adds the subharmonics to a screen.
fn add_long(
    grid: Grid,
    Screen {
        long,
        shift_m,
        root,
        ..
    }: &Screen,
    to: &mut [Complex64],
    add: impl Fn(&mut Complex64, f64),
) {
    let n = grid.n;
    // Waves of one frequency upwards are one complex number for each column, which turns from row to row.
    let mut together: Vec<(f64, Vec<Complex64>)> = Vec::new();
    for waves in long.chunk_by(|a, b| (a.side_pm, a.up) == (b.side_pm, b.up)) {
        let mut columns = vec![Complex64::ZERO; n];
        for wave in waves {
            let turn = TAU * wave.side_pm * f64::from(wave.right);
            for (x, column) in columns.iter_mut().enumerate() {
                *column +=
                    cis(turn * (grid.place_m(x) - shift_m[0])) * wave.amplitude * (2.0 * root);
            }
        }
        together.push((waves[0].side_pm * f64::from(waves[0].up), columns));
    }
    let mut sums = vec![0.0; n];
    for (y, row) in to.chunks_exact_mut(n).enumerate() {
        sums.fill(0.0);
        for (up_pm, columns) in &together {
            let up = cis(TAU * up_pm * (grid.place_m(y) - shift_m[1]));
            for (sum, column) in sums.iter_mut().zip(columns) {
                *sum += column.re * up.re - column.im * up.im;
            }
        }
        for (value, sum) in row.iter_mut().zip(&sums) {
            add(value, *sum);
        }
    }
}

/// The distance at which waves make just the difference that they should \[m\]: an aperture's, of half the square.
fn apart_m(grid: Grid) -> f64 {
    0.4 * grid.width_m()
}

/// Root of the mean square of each wave of the upper half, for a layer of strength one.
fn roots(grid: Grid, spectrum: &VonKarman) -> Vec<f64> {
    let (n, side) = (grid.n, 1.0 / grid.width_m());
    let mut roots = vec![0.0; n / 2 * n];
    for j in 0..n / 2 {
        for i in 0..n {
            // What the subharmonics make, what row 0 mirrors, and what has no mirror image.
            let is_coarse = j <= COARSE && i.min(n - i) <= COARSE;
            if is_coarse || i == n / 2 || (j == 0 && i > n / 2) {
                continue;
            }
            let (x, y) = (grid.frequency_pm(i), grid.frequency_pm(j));
            let power = spectrum.density(1.0, x.hypot(y)) * side * side;
            roots[j * n + i] = power.sqrt();
        }
    }
    roots
}

/// Waves of given roots of their mean squares.
fn fresh(rms: &[f64], normal: &mut impl FnMut() -> f64) -> Vec<Complex64> {
    let wave = |rms: &f64| {
        if *rms > 0.0 {
            draw(normal) * *rms
        } else {
            Complex64::ZERO
        }
    };
    rms.iter().map(wave).collect()
}

/// A complex number of mean square one.
fn draw(normal: &mut impl FnMut() -> f64) -> Complex64 {
    Complex64::new(normal(), normal()) * std::f64::consts::FRAC_1_SQRT_2
}
