//! Land on a lattice whose lines lie close together within and ever farther apart without: the ground around a real city
//! out to the edge of sight, and under it where its tiles show none.

use crate::ground::height_grid::HeightGrid;
use crate::maths::curve::smoothstep;
use crate::shape::mesh::{MeshData, Paint};
use glam::{DVec2, DVec3};

/// How far the land reaches [m].
pub const REACH_M: f64 = 20_000.0;
/// Growth of the lines' distance outside the raster.
const GROWTH: f64 = 1.3;
/// Mean radius of the Earth [m] (IUGG).
const EARTH_M: f64 = 6_371_008.8;
/// Quads along a side of a mesh.
const MESH_QUADS: usize = 24;
/// How deep the land lies below what tiles show [m].
const SUNK_M: f64 = 0.3;

/// Heights on a lattice; between its lines two triangles a quad, parted from its south-western to its north-eastern
/// corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// East of each line [m], ascending.
    e_m: Vec<f64>,
    /// North of each line [m], ascending.
    n_m: Vec<f64>,
    /// Row by row.
    heights_m: Vec<f64>,
}

impl Lattice {
    /// Land that goes on from a raster: its lines `step_m` apart within, and its heights there; outside the border's, ever
    /// smoother, that turn into `far_m(p)` [m], or where that is `None` into the border's mean, which follows the
    /// Earth's curvature where the place is `curved`.
    pub fn around(
        terrain: &HeightGrid,
        step_m: f64,
        curved: bool,
        far_m: impl Fn(DVec2) -> Option<f64>,
    ) -> Self {
        let low = DVec2::new(terrain.origin_e_m, terrain.origin_n_m);
        let size = DVec2::new(terrain.nx as f64, terrain.ny as f64) * terrain.cell_m;
        let [e_m, n_m] = [0, 1].map(|axis| lines(low[axis], size[axis], step_m));
        let coarse = smoothed(terrain);
        let inset = DVec2::splat(0.5 * terrain.cell_m).min(0.5 * size);
        let border = border_mean(terrain);
        let drop_m = |p: DVec2| {
            if curved {
                p.length_squared() / (2.0 * EARTH_M)
            } else {
                0.0
            }
        };
        let height_m = |p: DVec2| {
            let at = p.clamp(low + inset, low + size - inset);
            let away_m = p.distance(at);
            let own_m = terrain.bilinear_m(at.x, at.y);
            if away_m <= inset.max_element() * std::f64::consts::SQRT_2 {
                return own_m;
            }
            // Within a few hundred metres the border's bumps are gone, within a few kilometres its hills.
            let smooth_m = coarse.bilinear_m(at.x, at.y);
            let near_m = own_m + (smooth_m - own_m) * smoothstep(0.0, 400.0, away_m);
            let near_m = near_m + drop_m(at) - drop_m(p);
            let (goal_m, over_m) = match far_m(p) {
                Some(far_m) => (far_m, 600.0),
                None => (border - drop_m(p), 3_000.0),
            };
            near_m + (goal_m - near_m) * smoothstep(0.0, over_m, away_m)
        };
        let heights_m = (n_m.iter())
            .flat_map(|n| e_m.iter().map(|e| height_m(DVec2::new(*e, *n))))
            .collect();
        Self {
            e_m,
            n_m,
            heights_m,
        }
    }

    /// Corner of the lattice at a column and a row [m].
    fn corner(&self, [i, j]: [usize; 2]) -> DVec3 {
        let height_m = self.heights_m[j * self.e_m.len() + i];
        DVec3::new(self.e_m[i], self.n_m[j], height_m)
    }

    /// Height of its triangles at a point [m]; beyond the last line that line's goes on.
    pub fn height_m(&self, e_m: f64, n_m: f64) -> f64 {
        let place = |lines: &[f64], x: f64| {
            let k = lines
                .partition_point(|line| *line <= x)
                .clamp(1, lines.len() - 1)
                - 1;
            let share = (x - lines[k]) / (lines[k + 1] - lines[k]);
            (k, share.clamp(0.0, 1.0))
        };
        let ((i, u), (j, v)) = (place(&self.e_m, e_m), place(&self.n_m, n_m));
        let z = |i: usize, j: usize| self.corner([i, j]).z;
        let (a, c) = (z(i, j), z(i + 1, j + 1));
        if u >= v {
            let b = z(i + 1, j);
            a + u * (b - a) + v * (c - b)
        } else {
            let d = z(i, j + 1);
            a + v * (d - a) + u * (c - d)
        }
    }

    /// Its meshes, coloured by `albedo(p)`, without the quads that tiles show: `shown(p)` says where they do. Where the
    /// border between the two runs, the land goes on a little below them, so that there is no gap.
    pub fn meshes(
        &self,
        cell_m: f64,
        shown: impl Fn(DVec2) -> bool,
        albedo: impl Fn(DVec2) -> [f32; 3],
    ) -> Vec<MeshData> {
        let [columns, rows] = [self.e_m.len() - 1, self.n_m.len() - 1];
        // Whether all of a rectangle is shown: no cell of it is not.
        let all_shown = |low: DVec2, high: DVec2| {
            // Half a quad more to each side: the land goes that far under what is shown.
            let more = 0.5 * (high - low);
            let (low, high) = (low - more, high + more);
            let steps = ((high - low) / cell_m).ceil().max(DVec2::ONE);
            let [nx, ny] = steps
                .min(DVec2::splat(400.0))
                .to_array()
                .map(|n| n as usize);
            let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
            (0..nx * ny)
                .all(|k| shown(low + (high - low) * DVec2::new(at(k % nx, nx), at(k / nx, ny))))
        };
        let lowered = |corner: [usize; 2]| {
            let r = self.corner(corner);
            if !shown(r.truncate()) {
                return r;
            }
            // The lowest nearby: the tiles' ground may sag between the lines.
            let [i, j] = corner;
            let around = [i.saturating_sub(1), i, (i + 1).min(columns)].map(|i| {
                [j.saturating_sub(1), j, (j + 1).min(rows)].map(|j| {
                    let other = self.corner([i, j]);
                    0.5 * (r.z + other.z)
                })
            });
            let lowest = around.into_iter().flatten().fold(r.z, f64::min);
            r.with_z(lowest - SUNK_M)
        };
        let normal = |[i, j]: [usize; 2]| {
            let at = |i: usize, j: usize| self.corner([i.min(columns), j.min(rows)]);
            let along = at(i + 1, j) - at(i.saturating_sub(1), j);
            let across = at(i, j + 1) - at(i, j.saturating_sub(1));
            along.cross(across).normalize_or(DVec3::Z)
        };
        let mut meshes = Vec::new();
        for j0 in (0..rows).step_by(MESH_QUADS) {
            for i0 in (0..columns).step_by(MESH_QUADS) {
                let [i1, j1] = [(i0 + MESH_QUADS).min(columns), (j0 + MESH_QUADS).min(rows)];
                let middle = 0.5 * (self.corner([i0, j0]) + self.corner([i1, j1]));
                let mut mesh = MeshData::new(middle);
                let mut numbers = vec![u32::MAX; (i1 - i0 + 1) * (j1 - j0 + 1)];
                for j in j0..j1 {
                    for i in i0..i1 {
                        let [low, high] = [self.corner([i, j]), self.corner([i + 1, j + 1])];
                        if all_shown(low.truncate(), high.truncate()) {
                            continue;
                        }
                        let quad = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|at| {
                            let number = &mut numbers[(at[1] - j0) * (i1 - i0 + 1) + at[0] - i0];
                            if *number == u32::MAX {
                                *number = mesh.positions.len() as u32;
                                let r = lowered(at);
                                let paint = Paint::plain(albedo(r.truncate()));
                                mesh.vertex(r, normal(at), [0.0; 2], 1.0, paint);
                            }
                            *number
                        });
                        let [a, b, c, d] = quad;
                        mesh.indices.extend([a, b, c, a, c, d]);
                    }
                }
                if !mesh.indices.is_empty() {
                    meshes.push(mesh);
                }
            }
        }
        meshes
    }
}

/// Lines `step_m` apart, or a little less, over a stretch [m], and ever farther apart beyond both its ends.
fn lines(low_m: f64, size_m: f64, step_m: f64) -> Vec<f64> {
    let count = (size_m / step_m).ceil().clamp(1.0, 2_000.0);
    let step_m = size_m / count;
    let mut beyond = Vec::new();
    let (mut off_m, mut wide_m) = (0.0, step_m);
    while off_m < REACH_M {
        off_m += wide_m;
        wide_m *= GROWTH;
        beyond.push(off_m);
    }
    let before = beyond.iter().rev().map(|off_m| low_m - off_m);
    let within = (0..=count as usize).map(|k| low_m + k as f64 * step_m);
    let after = beyond.iter().map(|off_m| low_m + size_m + off_m);
    before.chain(within).chain(after).collect()
}

/// Means over blocks of a sixteenth of the raster's longer side.
fn smoothed(grid: &HeightGrid) -> HeightGrid {
    let factor = grid.nx.max(grid.ny).div_ceil(16);
    let [nx, ny] = [grid.nx.div_ceil(factor), grid.ny.div_ceil(factor)];
    let mut sums = vec![(0.0, 0.0); nx * ny];
    for (k, height_m) in grid.heights_m.iter().enumerate() {
        let sum = &mut sums[k / grid.nx / factor * nx + k % grid.nx / factor];
        *sum = (sum.0 + f64::from(*height_m), sum.1 + 1.0);
    }
    HeightGrid {
        cell_m: grid.cell_m * factor as f64,
        nx,
        ny,
        heights_m: sums
            .iter()
            .map(|(sum, count)| (sum / count) as f32)
            .collect(),
        ..*grid
    }
}

/// Mean height of the outermost cells [m].
fn border_mean(grid: &HeightGrid) -> f64 {
    let border = (grid.heights_m.iter().enumerate()).filter(|(k, _)| {
        let (i, j) = (k % grid.nx, k / grid.nx);
        i == 0 || j == 0 || i + 1 == grid.nx || j + 1 == grid.ny
    });
    let (sum, count) = border.fold((0.0, 0.0), |(sum, count), (_, height_m)| {
        (sum + f64::from(*height_m), count + 1.0)
    });
    sum / f64::max(count, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn terrain() -> HeightGrid {
        let hill = |e: f64, n: f64| 20.0 + 0.02 * e + 5.0 * (n / 150.0).sin();
        HeightGrid::from_fn(DVec2::splat(-500.0), 4.0, [250, 250], hill)
    }

    #[test]
    fn it_goes_on_from_the_border_without_a_step() {
        let terrain = terrain();
        let land = Lattice::around(&terrain, 20.0, true, |_| None);
        for k in 0..200 {
            let n = f64::from(k) * 5.0 - 500.0;
            // Between the lines triangles cut a corner of the hills.
            let inside = terrain.bilinear_m(497.0, n);
            assert!((land.height_m(497.0, n) - inside).abs() < 0.1);
            let [in_m, out_m] = [499.0, 501.0].map(|e| land.height_m(e, n));
            assert!((in_m - out_m).abs() < 0.2, "{in_m} {out_m}");
        }
        // Far away the mean of the border, and the Earth's curvature: 15² km² / 2R = 17.66 m.
        let far = land.height_m(15_000.0, 0.0);
        assert!((far - (20.0 - 17.66)).abs() < 1.0, "{far}");
        let wide = Lattice::around(&terrain, 20.0, true, |p| Some(300.0 + 0.001 * p.x));
        assert!((wide.height_m(9_000.0, 50.0) - 309.0).abs() < 1e-6);
        // Its reach.
        assert!(*land.e_m.last().unwrap() >= REACH_M && land.e_m[0] <= -REACH_M);
    }

    #[test]
    fn meshes_and_heights_agree_and_leave_out_what_is_shown() {
        let terrain = terrain();
        let land = Lattice::around(&terrain, 20.0, false, |_| None);
        let shown = |p: DVec2| p.abs().max_element() < 300.0;
        let grey = |_: DVec2| [0.1; 3];
        let meshes = land.meshes(4.0, shown, grey);
        let (mut inside, mut lowest) = (0, f64::INFINITY);
        for mesh in &meshes {
            for triangle in mesh.indices.as_chunks::<3>().0 {
                let corners = triangle.map(|i| {
                    mesh.origin_enu_m + DVec3::from(mesh.positions[i as usize].map(f64::from))
                });
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                assert!((corners[1] - corners[0]).cross(corners[2] - corners[0]).z > 0.0);
                let off_m = middle.z - land.height_m(middle.x, middle.y);
                if corners.iter().any(|r| shown(r.truncate())) {
                    inside += 1;
                    assert!(off_m < 0.01 && off_m > -2.0, "{off_m}");
                } else {
                    assert!(off_m.abs() < 0.01, "{off_m}");
                }
                assert!(middle.truncate().abs().max_element() > 260.0);
                lowest = lowest.min(middle.truncate().abs().max_element());
            }
        }
        // A closed ring of quads under the border.
        assert!(inside > 100 && lowest < 295.0, "{inside} {lowest}");
        let area: f64 = (meshes.iter())
            .flat_map(|mesh| {
                mesh.indices.as_chunks::<3>().0.iter().map(|triangle| {
                    let [a, b, c] = triangle
                        .map(|i| DVec3::from(mesh.positions[i as usize].map(f64::from)).truncate());
                    0.5 * (b - a).perp_dot(c - a)
                })
            })
            .sum();
        let whole = (land.e_m.last().unwrap() - land.e_m[0]).powi(2);
        assert!(
            (area - (whole - 560.0 * 560.0)).abs() < 60.0 * 600.0 * 4.0,
            "{area} {whole}"
        );
    }
}
