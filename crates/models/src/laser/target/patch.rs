//! A grid of heat, laid on the place of a UAV that the beam met.

use super::cooling::Film;
use super::grid::HeatGrid;
use super::hull::{Hull, Meets};
use super::parts::Struck;
use crate::laser::beam::peak_irradiance_wpm2;
use crate::laser::propagation::{Across, Shape};
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Columns along each side.
const SIDE: usize = 16;
/// Columns to a beam's 1/e² radius, and how far apart they may lie [m].
const PER_RADIUS: f64 = 3.0;
const CELL_M: [f64; 2] = [2e-3, 7e-3];
/// What lies this far before or behind the middle belongs to something else [m].
const SAME_M: f64 = 0.03;
/// Surfaces seen more edge-on than this share the light as if they were turned so far.
const LEAST_COSINE: f64 = 0.2;
/// A beam turned further than this from where it first came meets another side [cosine]: 50°.
const TURNED: f64 = 0.64;
/// A grid without light goes on in steps of this [s]: cooling is slow.
const UNLIT_S: f64 = 0.2;
/// Beyond so many 1/e² radii nothing falls: 4e-5 of the power.
const BEAM_ENDS: f64 = 2.25;
/// Radius of the area over which what counts must be beyond its limit for the function to be lost [m]: half a square
/// centimetre, a chip, a strip across an arm, a few windings; an assumption good to a factor of two in the area.
pub const FAILS_RADIUS_M: f64 = 4e-3;
const FAILS_M2: f64 = PI * FAILS_RADIUS_M * FAILS_RADIUS_M;

/// A grid on a plane that faced the beam when the beam first met it; it keeps its place on the body.
#[derive(Clone, Debug)]
pub struct Patch {
    /// What it lies on.
    pub struck: Struck,
    /// Its heat.
    pub grid: HeatGrid,
    /// Middle of the grid [m, body].
    pub middle_body_m: DVec3,
    /// Its axes: of columns, of rows, and the way of the light [body].
    axes_body: [DVec3; 3],
    /// Cosine between light and normal in each column.
    cosine: Vec<f64>,
    /// Whether what counts has failed.
    pub has_failed: bool,
    /// Whether light has fallen on it since its last step, and how long ago that was [s].
    is_lit: bool,
    waits_s: f64,
}

/// A beam of one tick, in a body's axes.
#[derive(Clone, Copy, Debug)]
pub struct Falls<'a> {
    /// What lies across it at the body's range.
    pub across: &'a Across,
    /// Where the body's origin lies across the beam's axis, jitter included [m], right and down.
    pub origin_m: DVec2,
    /// The beam's right, down and onward [body].
    pub axes_body: [DVec3; 3],
    /// Length of the tick [s].
    pub dt_s: f64,
}

impl Falls<'_> {
    /// Where a place [m, body] lies across the beam [m].
    fn across_m(&self, place_body_m: DVec3) -> DVec2 {
        let [right, down, _] = self.axes_body;
        self.origin_m + DVec2::new(right.dot(place_body_m), down.dot(place_body_m))
    }

    /// The ray through the spot's middle, moved by some of its radii: where it leaves from [m, body].
    fn ray_body_m(&self, moved: DVec2) -> DVec3 {
        /// Far enough to be before any UAV [m].
        const BEFORE_M: f64 = 20.0;
        let at_m = self.across.centre_m + self.across.radius_m() * moved - self.origin_m;
        let [right, down, onward] = self.axes_body;
        right * at_m.x + down * at_m.y - BEFORE_M * onward
    }

    /// Where the beam meets a shape: in its middle, else beside it.
    pub fn meets(&self, hull: &Hull) -> Option<Meets> {
        const MOVED: [DVec2; 5] = [
            DVec2::ZERO,
            DVec2::new(0.7, 0.0),
            DVec2::new(-0.7, 0.0),
            DVec2::new(0.0, 0.7),
            DVec2::new(0.0, -0.7),
        ];
        let onward = self.axes_body[2];
        (MOVED.iter()).find_map(|moved| hull.meets(self.ray_body_m(*moved), onward))
    }
}

impl Patch {
    /// A grid about a place that the beam meets, cold.
    pub fn new(
        falls: &Falls,
        meets: &Meets,
        hull: &Hull,
        struck: Struck,
        wavelength_m: f64,
        temperature_k: f64,
    ) -> Self {
        let [fine_m, coarse_m] = CELL_M;
        let cell_m = (falls.across.radius_m() / PER_RADIUS).clamp(fine_m, coarse_m);
        let [right, down, onward] = falls.axes_body;
        let middle_body_m = meets.r_body_m;
        let mut cosine = vec![0.0; SIDE * SIDE];
        let mut there = vec![false; SIDE * SIDE];
        let (mut albedo, mut count) = (0.0, 0.0);
        for column in 0..SIDE * SIDE {
            let place_m = middle_body_m + placed(column, cell_m, [right, down]);
            // From well before the plane, but not from beyond what stands in front of it.
            let from_m = place_m - 10.0 * SAME_M * onward;
            let Some(found) = hull.meets(from_m, onward) else {
                continue;
            };
            if (found.along_m - 10.0 * SAME_M).abs() < SAME_M {
                there[column] = true;
                // What turns takes by its shadow.
                let own = if struck.turns { 1.0 } else { found.cosine };
                cosine[column] = own.max(LEAST_COSINE);
                (albedo, count) = (albedo + found.albedo, count + 1.0);
            }
        }
        let albedo = if count > 0.0 {
            albedo / count
        } else {
            meets.albedo
        };
        let absorptivity = struck.skin.absorptivity(albedo, wavelength_m);
        Self {
            grid: HeatGrid::new(&struck.skin, absorptivity, cell_m, there, temperature_k),
            struck,
            middle_body_m,
            axes_body: [right, down, onward],
            cosine,
            has_failed: false,
            is_lit: false,
            waits_s: 0.0,
        }
    }

    /// Whether the middle of a beam lies on it, and the beam comes from the side that it faces.
    pub fn holds(&self, falls: &Falls) -> bool {
        let [right, down, onward] = self.axes_body;
        let [.., comes] = falls.axes_body;
        if comes.dot(onward) < TURNED {
            return false;
        }
        // The plane's place that the beam's middle passes.
        let from_m = falls.ray_body_m(DVec2::ZERO);
        let way_m = (self.middle_body_m - from_m).dot(onward) / comes.dot(onward);
        let on_m = from_m + way_m * comes - self.middle_body_m;
        let half_m = (0.5 * SIDE as f64 - 1.0) * self.grid.cell_m;
        on_m.dot(right).abs() < half_m && on_m.dot(down).abs() < half_m
    }

    /// Adds what falls on it in a tick.
    pub fn light(&mut self, falls: &Falls) {
        self.is_lit = true;
        if !self.struck.turns {
            return self.add(falls);
        }
        let before = self.grid.dose_jpm2().to_vec();
        self.grid.dose_jpm2().fill(0.0);
        self.add(falls);
        // What a row catches goes round: over pi times the width that it is seen by.
        let columns_there: Vec<bool> = (0..SIDE * SIDE).map(|at| self.grid.is_there(at)).collect();
        let dose = self.grid.dose_jpm2();
        for row in 0..SIDE {
            let columns = row * SIDE..(row + 1) * SIDE;
            let there = columns_there[columns.clone()].iter();
            let width = there.filter(|is_there| **is_there).count() as f64;
            let mean = dose[columns.clone()].iter().sum::<f64>() / (PI * width.max(1.0));
            for column in columns {
                let own = if columns_there[column] { mean } else { 0.0 };
                dose[column] = before[column] + own;
            }
        }
    }

    /// Adds what falls on each column in a tick.
    fn add(&mut self, falls: &Falls) {
        let cell_m = self.grid.cell_m;
        let [right, down, _] = self.axes_body;
        let corner = self.middle_body_m + placed(0, cell_m, [right, down]);
        let at_m = |place: DVec3| falls.across_m(place) - falls.across.centre_m;
        let from_m = at_m(corner);
        let along_m = at_m(corner + cell_m * right) - from_m;
        let over_m = at_m(corner + cell_m * down) - from_m;
        // Light on a square metre of the plane.
        let turned = along_m.perp_dot(over_m).abs() / (cell_m * cell_m);
        let scale_s = falls.dt_s * turned;
        match &falls.across.shape {
            Shape::Gaussian { radius_m } => {
                let per_m2 = 2.0 / (radius_m * radius_m);
                let peak = scale_s * peak_irradiance_wpm2(falls.across.power_w, *radius_m);
                let ends_m2 = (BEAM_ENDS * radius_m).powi(2);
                // Along a row the exponent is a square of the column: two products a column instead of a power.
                let grows = (-2.0 * per_m2 * along_m.length_squared()).exp();
                let step_m2 = along_m.length_squared();
                for row in 0..SIDE {
                    let row_m = from_m + row as f64 * over_m;
                    let least_m2 = row_m.perp_dot(along_m).powi(2) / step_m2;
                    if least_m2 > ends_m2 {
                        continue;
                    }
                    // The columns within the beam.
                    let middle = -row_m.dot(along_m) / step_m2;
                    let half = ((ends_m2 - least_m2) / step_m2).sqrt();
                    let first = (middle - half).ceil().clamp(0.0, SIDE as f64);
                    let last = (middle + half).floor().clamp(-1.0, SIDE as f64 - 1.0);
                    let start_m = row_m + first * along_m;
                    let mut value = peak * (-per_m2 * start_m.length_squared()).exp();
                    let mut ratio = (-per_m2 * (2.0 * start_m.dot(along_m) + step_m2)).exp();
                    let (first, end) = (first as usize, (last + 1.0) as usize);
                    if first >= end {
                        continue;
                    }
                    let columns = row * SIDE + first..row * SIDE + end;
                    let dose = &mut self.grid.dose_jpm2()[columns.clone()];
                    for (dose, cosine) in dose.iter_mut().zip(&self.cosine[columns]) {
                        *dose += cosine * value;
                        value *= ratio;
                        ratio *= grows;
                    }
                }
            }
            Shape::Map(spot) => {
                for column in 0..SIDE * SIDE {
                    if self.cosine[column] == 0.0 {
                        continue;
                    }
                    let (row, x) = (column / SIDE, column % SIDE);
                    let centre_m = falls.across.centre_m;
                    let place_m = centre_m + from_m + x as f64 * along_m + row as f64 * over_m;
                    let value = spot.at_wpm2(place_m.x, place_m.y);
                    self.grid.dose_jpm2()[column] += scale_s * self.cosine[column] * value;
                }
            }
        }
    }

    /// Goes on by a time [s]; whether what counts has failed in it.
    pub fn step(&mut self, dt_s: f64, film: &Film) -> bool {
        self.waits_s += dt_s;
        if !self.is_lit && self.waits_s < UNLIT_S {
            return false;
        }
        self.grid.step(self.waits_s, film);
        (self.is_lit, self.waits_s) = (false, 0.0);
        let fails = !self.has_failed && self.grid.failed_m2() >= FAILS_M2;
        self.has_failed |= fails;
        fails
    }
}

/// Where a column lies from the middle of a grid [m].
fn placed(column: usize, cell_m: f64, [right, down]: [DVec3; 2]) -> DVec3 {
    let off = |at: usize| cell_m * (at as f64 + 0.5 - 0.5 * SIDE as f64);
    off(column % SIDE) * right + off(column / SIDE) * down
}
