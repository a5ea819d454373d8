//! What stands on the ground, found in height rasters: outlines of buildings, and how much they slow the wind.

use crate::ground::city::{Building, BuildingKind, Finish, Part, Roof};
use crate::ground::dsm::HeightGrid;
use crate::ground::roughness::{AreaShares, Roughness};
use crate::shape::mesh::Surface;
use glam::{DVec2, IVec2};

/// What stands up less than this is no building [m].
pub const LEAST_HEIGHT_M: f64 = 2.5;
/// What covers less than this is no building [m^2].
pub const LEAST_AREA_M2: f64 = 20.0;
/// An outline leaves out corners that are off by less than this many cells.
const CORNER_CELLS: f64 = 1.5;

/// What stands on `terrain` in `surface`: connected cells (by their sides) that rise above it, each as one building
/// with its outline, its lowest ground and its highest point.
pub fn buildings(surface: &HeightGrid, terrain: impl Fn(f64, f64) -> f64) -> Vec<Building> {
    let rise_m = rises_m(surface, terrain);
    let stands: Vec<bool> = rise_m
        .iter()
        .map(|rise_m| *rise_m > LEAST_HEIGHT_M)
        .collect();
    let (nx, ny) = (surface.nx, surface.ny);
    let mut group = vec![u32::MAX; nx * ny];
    let mut found = Vec::new();
    for seed in 0..nx * ny {
        if !stands[seed] || group[seed] != u32::MAX {
            continue;
        }
        let number = found.len() as u32;
        let mut cells = vec![seed];
        group[seed] = number;
        let mut next = 0;
        while next < cells.len() {
            let k = cells[next];
            next += 1;
            let (i, j) = (k % nx, k / nx);
            let beside = [
                (i > 0).then(|| k - 1),
                (i + 1 < nx).then_some(k + 1),
                (j > 0).then(|| k - nx),
                (j + 1 < ny).then_some(k + nx),
            ];
            for other in beside.into_iter().flatten() {
                if stands[other] && group[other] == u32::MAX {
                    group[other] = number;
                    cells.push(other);
                }
            }
        }
        found.push((seed, cells));
    }
    let area_m2 = surface.cell_m * surface.cell_m;
    (found.into_iter())
        .filter(|(_, cells)| cells.len() as f64 * area_m2 >= LEAST_AREA_M2)
        .map(|(seed, cells)| {
            let number = group[seed];
            let inside = |at: IVec2| {
                let within =
                    at.cmpge(IVec2::ZERO).all() && at.cmplt(IVec2::new(nx as i32, ny as i32)).all();
                within && group[at.y as usize * nx + at.x as usize] == number
            };
            let corners = outline(IVec2::new((seed % nx) as i32, (seed / nx) as i32), inside);
            let height_m = |k: usize| f64::from(surface.heights_m[k]);
            let base_m = (cells.iter()).map(|k| height_m(*k) - rise_m[*k]);
            let base_m = base_m.fold(f64::INFINITY, f64::min);
            let top_m = cells.iter().map(|k| height_m(*k));
            let top_m = top_m.fold(f64::NEG_INFINITY, f64::max);
            let at = |p: &IVec2| {
                let origin = DVec2::new(surface.origin_e_m, surface.origin_n_m);
                origin + p.as_dvec2() * surface.cell_m
            };
            surveyed(simplified(&corners).iter().map(at).collect(), base_m, top_m)
        })
        .collect()
}

/// A building of which outline (counter-clockwise), base and top are known, and nothing else [m].
pub fn surveyed(outline_enu_m: Vec<DVec2>, base_m: f64, top_m: f64) -> Building {
    let grey = [0.3; 3];
    Building {
        kind: BuildingKind::Surveyed,
        base_m,
        variant: 0.0,
        parts: vec![Part {
            outline_enu_m,
            bottom_m: base_m,
            eaves_m: top_m,
            roof: Roof::Flat(0.0),
            finish: Finish {
                surface: Surface::Plain,
                albedo: grey,
                roof_albedo: grey,
                blind_ends: true,
            },
        }],
    }
}

/// How what stands in `surface` slows the wind over the cells that are `known`: mean height by plan area, and the
/// shares of plan area and of frontal area, the mean for winds along both axes.
pub fn roughness(
    surface: &HeightGrid,
    terrain: impl Fn(f64, f64) -> f64,
    known: impl Fn(usize) -> bool,
) -> Roughness {
    let rise_m: Vec<f64> = (rises_m(surface, terrain).into_iter())
        .map(|rise_m| if rise_m > LEAST_HEIGHT_M { rise_m } else { 0.0 })
        .collect();
    let (mut cells, mut built, mut sum_m, mut faces_m) = (0_usize, 0_usize, 0.0, 0.0);
    for (k, own_m) in rise_m.iter().enumerate() {
        if !known(k) {
            continue;
        }
        cells += 1;
        if *own_m > 0.0 {
            built += 1;
            sum_m += own_m;
        }
        // The face towards each side's neighbour; half of a pair of winds sees each.
        let (i, j) = (k % surface.nx, k / surface.nx);
        let beside = [
            (i > 0).then(|| k - 1),
            (i + 1 < surface.nx).then_some(k + 1),
            (j > 0).then(|| k - surface.nx),
            (j + 1 < surface.ny).then_some(k + surface.nx),
        ];
        for other in beside.into_iter().flatten() {
            faces_m += (own_m - rise_m[other]).max(0.0);
        }
    }
    if built == 0 {
        return Roughness::default();
    }
    Roughness {
        mean_height_m: sum_m / built as f64,
        shares: Some(AreaShares {
            plan: built as f64 / cells as f64,
            // Four winds in turn see the faces; each cell is cell_m² of ground and each face cell_m wide.
            frontal: faces_m / 4.0 / (cells as f64 * surface.cell_m),
        }),
    }
}

/// How far each cell stands above the ground [m].
fn rises_m(surface: &HeightGrid, terrain: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    (surface.heights_m.iter().enumerate())
        .map(|(k, height_m)| {
            let middle = |k: usize, origin: f64| origin + (k as f64 + 0.5) * surface.cell_m;
            let e_m = middle(k % surface.nx, surface.origin_e_m);
            let n_m = middle(k / surface.nx, surface.origin_n_m);
            f64::from(*height_m) - terrain(e_m, n_m)
        })
        .collect()
}

/// The outer border of the cells that are `inside`, counter-clockwise from the south-western corner of `seed`, the
/// first of them row by row: their corners, where it turns.
fn outline(seed: IVec2, inside: impl Fn(IVec2) -> bool) -> Vec<IVec2> {
    let mut corners = vec![seed];
    let (mut at, mut ahead) = (seed, IVec2::X);
    loop {
        at += ahead;
        // The cells ahead of a corner to the left and to the right of the way.
        let left = ahead.perp();
        let cell = |side: IVec2| {
            let middle = (2 * at + ahead + side - IVec2::ONE) / 2;
            inside(middle)
        };
        let turned = match (cell(left), cell(-left)) {
            (true, false) => ahead,
            (true, true) => -left,
            // Where only corners touch, the border stays with its own cell.
            (false, _) => left,
        };
        if at == seed && turned == IVec2::X {
            return corners;
        }
        if turned != ahead {
            corners.push(at);
        }
        ahead = turned;
    }
}

/// The corners that matter (Douglas and Peucker, 1973), for a ring.
fn simplified(ring: &[IVec2]) -> Vec<IVec2> {
    let far = |from: IVec2| {
        let apart = |k: &usize| (ring[*k] - from).length_squared();
        (0..ring.len()).max_by_key(apart).unwrap_or(0)
    };
    let (a, b) = (0, far(ring[0]));
    let mut kept = vec![false; ring.len()];
    let mut waiting = vec![(a, b), (b, ring.len())];
    while let Some((from, to)) = waiting.pop() {
        kept[from] = true;
        let (p, q) = (ring[from].as_dvec2(), ring[to % ring.len()].as_dvec2());
        let along = (q - p).normalize_or_zero();
        let off = |k: usize| {
            let r = ring[k].as_dvec2() - p;
            if along == DVec2::ZERO {
                r.length()
            } else {
                along.perp_dot(r).abs()
            }
        };
        let farthest = (from + 1..to).map(|k| (off(k), k));
        let farthest = farthest.fold((CORNER_CELLS, 0), |a, b| if b.0 > a.0 { b } else { a });
        if farthest.1 > 0 {
            waiting.extend([(from, farthest.1), (farthest.1, to)]);
        }
    }
    (ring.iter().zip(kept))
        .filter_map(|(corner, kept)| kept.then_some(*corner))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::polygon::area_m2;

    fn grid(height_m: impl Fn(f64, f64) -> f64) -> HeightGrid {
        HeightGrid::from_fn(DVec2::splat(-100.0), 1.0, [200, 200], height_m)
    }

    fn within(value: f64, [from, to]: [f64; 2]) -> bool {
        (from..to).contains(&value)
    }

    #[test]
    fn boxes_come_back_with_outline_base_and_top() {
        let surface = grid(|e, n| {
            let slope = 0.05 * e;
            if within(e, [-40.0, -20.0]) && within(n, [10.0, 22.0]) {
                15.0
            } else if within(e, [30.0, 33.0]) && within(n, [0.0, 3.0]) {
                slope + 9.0
            } else {
                slope
            }
        });
        let found = buildings(&surface, |e, _| 0.05 * e);
        // What is 3 m by 3 m is no building.
        assert_eq!(found.len(), 1);
        let outline = found[0].footprint_enu_m();
        assert_eq!(outline.len(), 4, "{outline:?}");
        assert!((area_m2(outline) - 240.0).abs() < 1e-9);
        assert!((found[0].base_m + 0.05 * 39.5).abs() < 1e-5);
        assert!((found[0].height_m() - 15.0 - 0.05 * 39.5).abs() < 1e-5);
    }

    #[test]
    fn an_l_shape_a_court_and_a_turned_house_keep_their_areas() {
        let corner = grid(|e, n| {
            let l = (within(e, [0.0, 30.0]) && within(n, [0.0, 10.0]))
                || (within(e, [0.0, 10.0]) && within(n, [0.0, 40.0]));
            if l { 10.0 } else { 0.0 }
        });
        let found = buildings(&corner, |_, _| 0.0);
        assert_eq!(found[0].footprint_enu_m().len(), 6);
        assert!((area_m2(found[0].footprint_enu_m()) - 600.0).abs() < 1e-9);
        let court = grid(|e, n| {
            let (e, n) = (e.abs(), n.abs());
            let ring = e.max(n) < 20.0 && e.max(n) > 10.0;
            if ring { 10.0 } else { 0.0 }
        });
        // The outer border alone.
        let found = buildings(&court, |_, _| 0.0);
        assert_eq!(found.len(), 1);
        assert!((area_m2(found[0].footprint_enu_m()) - 1600.0).abs() < 1e-9);
        let axis = DVec2::from_angle(0.6);
        let turned = grid(|e, n| {
            let p = DVec2::new(e, n);
            let (along, across) = (p.dot(axis), axis.perp_dot(p));
            if along.abs() < 25.0 && across.abs() < 8.0 {
                7.0
            } else {
                0.0
            }
        });
        let found = buildings(&turned, |_, _| 0.0);
        let outline = found[0].footprint_enu_m();
        assert!(outline.len() < 16, "{outline:?}");
        assert!(
            (area_m2(outline) - 800.0).abs() < 60.0,
            "{}",
            area_m2(outline)
        );
    }

    /// Cubes of 10 m in a lattice of 25 m: both shares are 10²/25².
    #[test]
    fn the_shares_of_cubes_in_a_lattice() {
        let surface = grid(|e, n| {
            let [e, n] = [e, n].map(|x| (x + 100.0).rem_euclid(25.0));
            if within(e, [8.0, 18.0]) && within(n, [8.0, 18.0]) {
                10.0
            } else {
                0.0
            }
        });
        let found = roughness(&surface, |_, _| 0.0, |_| true);
        assert!((found.mean_height_m - 10.0).abs() < 1e-6);
        let shares = found.shares.unwrap();
        assert!((shares.plan - 0.16).abs() < 1e-9, "{}", shares.plan);
        assert!((shares.frontal - 0.16).abs() < 1e-9, "{}", shares.frontal);
        assert_eq!(
            roughness(&surface, |_, _| 50.0, |_| true),
            Roughness::default()
        );
    }
}
