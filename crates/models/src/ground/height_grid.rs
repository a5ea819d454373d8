//! Rasters of heights.

use glam::{DVec2, DVec3};

/// A raster of at least one height; a cell's value belongs to its centre, row 0 lies south.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightGrid {
    /// East coordinate of the raster's west edge [m].
    pub origin_e_m: f64,
    /// North coordinate of the raster's south edge [m].
    pub origin_n_m: f64,
    /// Cell size [m].
    pub cell_m: f64,
    /// Columns (east).
    pub nx: usize,
    /// Rows (north).
    pub ny: usize,
    /// Heights [m], row by row.
    pub heights_m: Vec<f32>,
}

impl HeightGrid {
    /// A raster whose cells hold `height_m(e, n)` at their centres.
    pub fn from_fn(
        origin_m: DVec2,
        cell_m: f64,
        [nx, ny]: [usize; 2],
        height_m: impl Fn(f64, f64) -> f64,
    ) -> Self {
        let center = |i: usize, origin: f64| origin + (i as f64 + 0.5) * cell_m;
        let heights_m = (0..nx * ny)
            .map(|k| height_m(center(k % nx, origin_m.x), center(k / nx, origin_m.y)) as f32)
            .collect();
        Self {
            origin_e_m: origin_m.x,
            origin_n_m: origin_m.y,
            cell_m,
            nx,
            ny,
            heights_m,
        }
    }

    /// Height [m] interpolated bilinearly between cell centres; beyond the border its values continue.
    pub fn bilinear_m(&self, e_m: f64, n_m: f64) -> f64 {
        let x = ((e_m - self.origin_e_m) / self.cell_m - 0.5).clamp(0.0, (self.nx - 1) as f64);
        let y = ((n_m - self.origin_n_m) / self.cell_m - 0.5).clamp(0.0, (self.ny - 1) as f64);
        let (i, j) = (x as usize, y as usize);
        let (i1, j1) = ((i + 1).min(self.nx - 1), (j + 1).min(self.ny - 1));
        let at = |i: usize, j: usize| f64::from(self.heights_m[j * self.nx + i]);
        let (fx, fy) = (x - i as f64, y - j as f64);
        let south = at(i, j) + (at(i1, j) - at(i, j)) * fx;
        let north = at(i, j1) + (at(i1, j1) - at(i, j1)) * fx;
        south + (north - south) * fy
    }

    /// Index of the cell that holds a point; None outside.
    pub fn cell_index(&self, e_m: f64, n_m: f64) -> Option<usize> {
        let x = (e_m - self.origin_e_m) / self.cell_m;
        let y = (n_m - self.origin_n_m) / self.cell_m;
        let inside = x >= 0.0 && y >= 0.0 && x < self.nx as f64 && y < self.ny as f64;
        inside.then(|| y as usize * self.nx + x as usize)
    }

    /// The raster of maxima over blocks of `factor` × `factor` cells.
    pub(super) fn block_maxima(&self, factor: usize) -> Self {
        let (nx, ny) = (self.nx.div_ceil(factor), self.ny.div_ceil(factor));
        let mut heights_m = vec![f32::NEG_INFINITY; nx * ny];
        for (k, &h) in self.heights_m.iter().enumerate() {
            let block = &mut heights_m[k / self.nx / factor * nx + k % self.nx / factor];
            *block = block.max(h);
        }
        Self {
            nx,
            ny,
            heights_m,
            cell_m: self.cell_m * factor as f64,
            ..*self
        }
    }

    /// Walks the cells under the segment a + t·d for t from t0 to t1, calling
    /// `visit(cell, t_in, t_out)` until it returns something.
    pub(super) fn walk<T>(
        &self,
        a: DVec3,
        d: DVec3,
        [t0, t1]: [f64; 2],
        mut visit: impl FnMut(usize, f64, f64) -> Option<T>,
    ) -> Option<T> {
        let x0 = (a.x + d.x * t0 - self.origin_e_m) / self.cell_m;
        let y0 = (a.y + d.y * t0 - self.origin_n_m) / self.cell_m;
        let mut i = (x0.floor() as isize).clamp(0, self.nx as isize - 1);
        let mut j = (y0.floor() as isize).clamp(0, self.ny as isize - 1);
        // Parameter of the next border along an axis, and its increment per cell.
        let axis = |index: isize, origin: f64, a: f64, d: f64| {
            let step = if d > 0.0 { 1 } else { -1 };
            let border = origin + (index + isize::from(d > 0.0)) as f64 * self.cell_m;
            if d == 0.0 {
                (0, f64::INFINITY, f64::INFINITY)
            } else {
                (step, (border - a) / d, self.cell_m / d.abs())
            }
        };
        let (step_i, mut t_i, dt_i) = axis(i, self.origin_e_m, a.x, d.x);
        let (step_j, mut t_j, dt_j) = axis(j, self.origin_n_m, a.y, d.y);
        let mut t = t0;
        loop {
            let out = t_i.min(t_j).clamp(t, t1);
            if let Some(found) = visit(j as usize * self.nx + i as usize, t, out) {
                return Some(found);
            }
            if out >= t1 {
                return None;
            }
            t = out;
            if t_i <= t_j {
                i += step_i;
                t_i += dt_i;
            } else {
                j += step_j;
                t_j += dt_j;
            }
            if i < 0 || j < 0 || i >= self.nx as isize || j >= self.ny as isize {
                return None;
            }
        }
    }

    /// The part of t in 0..1 for which a + t·d lies over the raster.
    pub(super) fn clip(&self, a: DVec3, d: DVec3) -> Option<[f64; 2]> {
        let mut span = [0.0_f64, 1.0];
        let sides = [
            (a.x - self.origin_e_m, d.x, self.nx as f64 * self.cell_m),
            (a.y - self.origin_n_m, d.y, self.ny as f64 * self.cell_m),
        ];
        for (p, v, size) in sides {
            if v == 0.0 {
                if !(0.0..size).contains(&p) {
                    return None;
                }
                continue;
            }
            let (t, u) = (-p / v, (size - p) / v);
            span = [span[0].max(t.min(u)), span[1].min(t.max(u))];
        }
        (span[0] < span[1]).then_some(span)
    }
}
