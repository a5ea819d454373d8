//! Height rasters of triangles: the highest and the lowest hit of each cell's vertical, and what fills the gaps.

use crate::ground::dsm::HeightGrid;
use glam::{DVec2, DVec3};

/// Where a raster lies, and its cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RasterFrame {
    /// South-western corner [m].
    pub origin_m: DVec2,
    /// Cell size [m].
    pub cell_m: f64,
    /// Columns and rows.
    pub size: [usize; 2],
}

impl RasterFrame {
    /// The frame of whole cells that covers a rectangle [m]; at least one cell.
    pub fn covering(low_m: DVec2, high_m: DVec2, cell_m: f64) -> Self {
        let origin_m = (low_m / cell_m).floor() * cell_m;
        let cells = |span: f64| ((span / cell_m).ceil()).clamp(1.0, 1e6) as usize;
        Self {
            origin_m,
            cell_m,
            size: [cells(high_m.x - origin_m.x), cells(high_m.y - origin_m.y)],
        }
    }

    /// Middle of a cell [m].
    pub fn middle_m(&self, column: usize, row: usize) -> DVec2 {
        self.origin_m + DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_m
    }

    fn grid(&self, heights_m: Vec<f32>) -> HeightGrid {
        HeightGrid {
            origin_e_m: self.origin_m.x,
            origin_n_m: self.origin_m.y,
            cell_m: self.cell_m,
            nx: self.size[0],
            ny: self.size[1],
            heights_m,
        }
    }
}

/// The highest and the lowest hit of each cell's vertical: −∞ and +∞ where triangles leave a cell's middle free.
///
/// Exact at the middles: a triangle holds those between the crossings of its edges with their row, its western border
/// included, so that of two neighbours exactly one holds a middle on the edge between them.
pub fn hits(
    frame: &RasterFrame,
    triangles: impl IntoIterator<Item = [DVec3; 3]>,
) -> (HeightGrid, HeightGrid) {
    let [nx, ny] = frame.size;
    let mut top = vec![f32::NEG_INFINITY; nx * ny];
    let mut low = vec![f32::INFINITY; nx * ny];
    for triangle in triangles {
        // In cells, middles at whole numbers.
        let corners = triangle.map(|r| {
            let p = (r.truncate() - frame.origin_m) / frame.cell_m - 0.5;
            p.extend(r.z)
        });
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if normal.z == 0.0 || !normal.is_finite() {
            continue;
        }
        let slope = -normal.truncate() / normal.z;
        let [south, north] = [
            corners.iter().map(|p| p.y).fold(f64::INFINITY, f64::min),
            (corners.iter())
                .map(|p| p.y)
                .fold(f64::NEG_INFINITY, f64::max),
        ];
        let [lowest, highest] = [
            corners.iter().map(|p| p.z).fold(f64::INFINITY, f64::min),
            (corners.iter())
                .map(|p| p.z)
                .fold(f64::NEG_INFINITY, f64::max),
        ];
        let whole = |x: f64, most: usize| x.ceil().clamp(0.0, most as f64) as usize;
        for row in whole(south, ny)..whole(north + 1.0, ny) {
            let y = row as f64;
            let mut crossed = [f64::INFINITY, f64::NEG_INFINITY];
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if (a.y > y) != (b.y > y) {
                    // One direction of an edge, so that both its triangles round alike.
                    let (a, b) = if (a.x, a.y) <= (b.x, b.y) {
                        (a, b)
                    } else {
                        (b, a)
                    };
                    let x = a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y));
                    crossed = [crossed[0].min(x), crossed[1].max(x)];
                }
            }
            for column in whole(crossed[0], nx)..whole(crossed[1], nx) {
                let off = DVec2::new(column as f64, y) - corners[0].truncate();
                let z = (corners[0].z + slope.dot(off)).clamp(lowest, highest) as f32;
                let k = row * nx + column;
                top[k] = top[k].max(z);
                low[k] = low[k].min(z);
            }
        }
    }
    (frame.grid(top), frame.grid(low))
}

/// Gives cells that hold no finite number heights from around: means over ever larger blocks, interpolated
/// (pull and push; Gortler et al., "The lumigraph", 1996). Nothing finite at all becomes 0.
pub fn fill(grid: &mut HeightGrid) {
    let mut levels = vec![(
        [grid.nx, grid.ny],
        (grid.heights_m.iter())
            .map(|h| h.is_finite().then_some(f64::from(*h)))
            .collect::<Vec<Option<f64>>>(),
    )];
    while let Some((size, values)) = levels.last()
        && size[0] * size[1] > 1
        && values.iter().any(Option::is_none)
    {
        let [nx, ny] = *size;
        let half = size.map(|n| n.div_ceil(2));
        let mut sums = vec![(0.0, 0_u32); half[0] * half[1]];
        for (k, value) in values.iter().enumerate() {
            if let Some(value) = value {
                let sum = &mut sums[k / nx / 2 * half[0] + k % nx / 2];
                *sum = (sum.0 + value, sum.1 + 1);
            }
        }
        debug_assert!(values.len() == nx * ny);
        let mean = |(sum, count): (f64, u32)| (count > 0).then(|| sum / f64::from(count));
        levels.push((half, sums.into_iter().map(mean).collect()));
    }
    while levels.len() > 1 {
        let Some((size, coarse)) = levels.pop() else {
            break;
        };
        let Some(([nx, _], fine)) = levels.last_mut() else {
            break;
        };
        let at = |i: isize, j: isize| {
            let clamp = |k: isize, n: usize| k.clamp(0, n as isize - 1) as usize;
            coarse[clamp(j, size[1]) * size[0] + clamp(i, size[0])].unwrap_or(0.0)
        };
        for (k, value) in fine.iter_mut().enumerate() {
            value.get_or_insert_with(|| {
                let place = |k: usize| (k as f64 + 0.5) / 2.0 - 0.5;
                let (x, y) = (place(k % *nx), place(k / *nx));
                let (i, j) = (x.floor() as isize, y.floor() as isize);
                let (fx, fy) = (x - x.floor(), y - y.floor());
                let south = at(i, j) + (at(i + 1, j) - at(i, j)) * fx;
                let north = at(i, j + 1) + (at(i + 1, j + 1) - at(i, j + 1)) * fx;
                south + (north - south) * fy
            });
        }
    }
    if let Some((_, values)) = levels.pop() {
        for (height_m, value) in grid.heights_m.iter_mut().zip(values) {
            *height_m = value.unwrap_or(0.0) as f32;
        }
    }
}

/// How a [`ground`] is told from what stands on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundFilter {
    /// Slope that open ground may have.
    pub slope: f64,
    /// What stands up less than this on level ground is part of it [m].
    pub least_m: f64,
    /// Width of the widest thing that stands on the ground [m].
    pub widest_m: f64,
}

impl Default for GroundFilter {
    fn default() -> Self {
        Self {
            slope: 0.3,
            least_m: 0.6,    // [m]
            widest_m: 100.0, // [m]
        }
    }
}

/// The bare ground under a raster of lowest hits, gaps filled: what a window's opening lowers by more than the slope of
/// ground explains stands on it; windows grow to the widest building (the progressive morphological filter of
/// Zhang et al., IEEE Trans. Geosci. Remote Sens. 41, 2003, with linearly growing windows).
pub fn ground(lowest: &HeightGrid, filter: &GroundFilter) -> HeightGrid {
    let mut filled = lowest.clone();
    fill(&mut filled);
    let mut bare = lowest.clone();
    let mut before = filled.clone();
    let threshold_m = (filter.least_m + 2.0 * filter.slope * lowest.cell_m) as f32;
    let widest = (filter.widest_m / 2.0 / lowest.cell_m).ceil() as usize;
    for half in 1..=widest.max(1) {
        let opened = opening(&before, half);
        let heights = (before.heights_m.iter()).zip(&opened.heights_m);
        for (kept, (before, opened)) in bare.heights_m.iter_mut().zip(heights) {
            if before - opened > threshold_m {
                *kept = f32::NAN;
            }
        }
        before = opened;
    }
    fill(&mut bare);
    bare
}

/// The highest of the lowest over squares of 2·`half` + 1 cells.
fn opening(grid: &HeightGrid, half: usize) -> HeightGrid {
    let [nx, ny] = [grid.nx, grid.ny];
    let mut heights_m = grid.heights_m.clone();
    for pick in [f32::min as fn(f32, f32) -> f32, f32::max] {
        for (lines, length, [step, stride]) in [(ny, nx, [1, nx]), (nx, ny, [nx, 1])] {
            let mut line = vec![0.0; length];
            for number in 0..lines {
                for (k, value) in line.iter_mut().enumerate() {
                    *value = heights_m[number * stride + k * step];
                }
                for (k, value) in running(&line, half, pick).into_iter().enumerate() {
                    heights_m[number * stride + k * step] = value;
                }
            }
        }
    }
    HeightGrid {
        heights_m,
        ..grid.clone()
    }
}

/// The extreme within `half` places to both sides of each, in time that does not grow with `half` (van Herk, 1992).
fn running(line: &[f32], half: usize, pick: fn(f32, f32) -> f32) -> Vec<f32> {
    let (n, window) = (line.len(), 2 * half + 1);
    let mut ahead = line.to_vec();
    let mut behind = line.to_vec();
    for k in 1..n {
        if k % window != 0 {
            ahead[k] = pick(ahead[k], ahead[k - 1]);
        }
    }
    for k in (0..n.saturating_sub(1)).rev() {
        if (k + 1) % window != 0 {
            behind[k] = pick(behind[k], behind[k + 1]);
        }
    }
    (0..n)
        .map(|k| match (k.checked_sub(half), (k + half).min(n - 1)) {
            // Cut off by the end, all in the last block; else in two of them, or a whole one.
            (Some(from), to) if from / window == to / window => behind[from],
            (Some(from), to) => pick(behind[from], ahead[to]),
            // Cut off by the start, it is shorter than the first block.
            (None, to) => ahead[to],
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    fn frame(cell_m: f64) -> RasterFrame {
        RasterFrame::covering(DVec2::splat(-50.0), DVec2::splat(50.0), cell_m)
    }

    /// The two triangles of a level rectangle.
    fn level([e0, e1, n0, n1]: [f64; 4], z: impl Fn(f64, f64) -> f64) -> [[DVec3; 3]; 2] {
        let at = |e: f64, n: f64| DVec3::new(e, n, z(e, n));
        let [a, b, c, d] = [at(e0, n0), at(e1, n0), at(e1, n1), at(e0, n1)];
        [[a, b, c], [a, c, d]]
    }

    #[test]
    fn a_slope_is_exact_and_covered_once() {
        let plane = |e: f64, n: f64| 0.25 * e - 0.4 * n + 3.0;
        let (top, low) = hits(&frame(1.0), level([-50.0, 50.0, -50.0, 50.0], plane));
        assert_eq!([top.nx, top.ny], [100, 100]);
        for (k, height_m) in top.heights_m.iter().enumerate() {
            let p = frame(1.0).middle_m(k % 100, k / 100);
            assert!((f64::from(*height_m) - plane(p.x, p.y)).abs() < 1e-5);
            assert_eq!(*height_m, low.heights_m[k]);
        }
    }

    #[test]
    fn neighbours_share_a_middle_on_their_edge_and_leave_none_out() {
        // A fan about the middle of a cell whose rim runs through middles: every cell within exactly one of ten.
        let hub = DVec2::new(0.5, 0.5);
        let rim = |k: usize| {
            let angle = k as f64 * std::f64::consts::TAU / 10.0;
            hub + 30.0 * DVec2::from_angle(angle)
        };
        let mut count = vec![0; 10_000];
        for k in 0..10 {
            let triangle = [hub, rim(k), rim((k + 1) % 10)].map(|p| p.extend(1.0));
            let (top, _) = hits(&frame(1.0), [triangle]);
            for (count, height_m) in count.iter_mut().zip(top.heights_m) {
                *count += i32::from(height_m.is_finite());
            }
        }
        assert!(count.iter().all(|count| *count <= 1));
        for (k, count) in count.iter().enumerate() {
            let apart = frame(1.0).middle_m(k % 100, k / 100).distance(hub);
            assert!(*count == 1 || apart > 30.0 * 0.95, "{apart}");
        }
    }

    #[test]
    fn top_and_bottom_of_a_bridge() {
        let ground = level([-50.0, 50.0, -50.0, 50.0], |_, _| 0.0);
        let deck = level([-50.0, 50.0, -4.0, 4.0], |_, _| 9.0);
        let (top, low) = hits(&frame(2.0), ground.into_iter().chain(deck));
        let at = |grid: &HeightGrid, n: f64| grid.heights_m[grid.cell_index(0.0, n).unwrap()];
        assert_eq!([at(&top, 0.0), at(&low, 0.0)], [9.0, 0.0]);
        assert_eq!([at(&top, 20.0), at(&low, 20.0)], [0.0, 0.0]);
    }

    #[test]
    fn gaps_are_filled_smoothly() {
        let plane = |e: f64, n: f64| 0.1 * e + 0.05 * n;
        let mut grid = HeightGrid::from_fn(DVec2::splat(-50.0), 1.0, [100, 100], plane);
        let whole = grid.clone();
        for (k, height_m) in grid.heights_m.iter_mut().enumerate() {
            let p = frame(1.0).middle_m(k % 100, k / 100);
            if p.length() < 20.0 {
                *height_m = f32::NAN;
            }
        }
        fill(&mut grid);
        for (found, want) in grid.heights_m.iter().zip(&whole.heights_m) {
            assert!((found - want).abs() < 1.2, "{found} {want}");
        }
        let mut nothing = HeightGrid {
            heights_m: vec![f32::INFINITY; 10_000],
            ..whole
        };
        fill(&mut nothing);
        assert!(nothing.heights_m.iter().all(|h| *h == 0.0));
    }

    #[test]
    fn running_extremes_are_those_of_each_window() {
        let mut rng = Stream::new(3, 0, "running");
        for length in [1, 2, 5, 17, 40] {
            let line: Vec<f32> = (0..length).map(|_| rng.normal() as f32).collect();
            for half in [1, 2, 3, 8, 50] {
                for pick in [f32::min as fn(f32, f32) -> f32, f32::max] {
                    let got = running(&line, half, pick);
                    for (k, got) in got.into_iter().enumerate() {
                        let window = k.saturating_sub(half)..(k + half + 1).min(length);
                        let want = line[window].iter().copied().reduce(pick).unwrap();
                        assert_eq!(got, want, "{length} {half} {k}");
                    }
                }
            }
        }
    }

    #[test]
    fn houses_go_and_hills_stay() {
        // A tenth of slope, a hill of 12 m over 200 m, and houses on them.
        let hill =
            |e: f64, n: f64| 0.1 * e + 12.0 * (-(e * e + n * n) / (2.0 * 60.0_f64.powi(2))).exp();
        let houses = [
            [-40.0, -20.0, -10.0, 10.0],
            [5.0, 45.0, 20.0, 40.0],
            [60.0, 64.0, 60.0, 90.0],
        ];
        let inside = |e: f64, n: f64| {
            houses
                .iter()
                .any(|[e0, e1, n0, n1]| (*e0..*e1).contains(&e) && (*n0..*n1).contains(&n))
        };
        let seen = |e: f64, n: f64| hill(e, n) + if inside(e, n) { 8.0 } else { 0.0 };
        let cells = [150, 150];
        let lowest = HeightGrid::from_fn(DVec2::splat(-150.0), 2.0, cells, seen);
        let bare = ground(&lowest, &GroundFilter::default());
        let mut worst: f64 = 0.0;
        for e in (-140..140).step_by(7) {
            for n in (-140..140).step_by(7) {
                let (e, n) = (f64::from(e), f64::from(n));
                worst = worst.max((bare.bilinear_m(e, n) - hill(e, n)).abs());
            }
        }
        assert!(worst < 1.5, "{worst} m");
    }
}
