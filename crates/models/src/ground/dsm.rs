//! Digital surface model: terrain and what stands on it as height rasters, with sight lines.
//!
//! The surface is piecewise constant: a cell is a column up to its height. A ray is walked cell by
//! cell (Amanatides & Woo, "A fast voxel traversal algorithm", 1987), exactly for that surface;
//! a coarse raster of maxima lets it skip blocks it passes above.
//!
//! A real city has triangles besides ([`Solids`]): sight lines and wrecks then meet these, go under bridges and
//! overhangs, and the rasters say only how high ground and roofs are.

pub use crate::ground::height_grid::HeightGrid;
use crate::ground::lattice::Lattice;
use crate::ground::triangles::TriangleTree;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Whether one point sees another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LineOfSight {
    /// Nothing in between.
    Clear,
    /// The first obstacle lies at this range from the first point [m].
    BlockedAt(f64),
}

impl LineOfSight {
    /// The same sight line under a closed layer of cloud, flat at height `base_m` [m] and without
    /// end above.
    pub fn below(self, base_m: f64, from_enu_m: DVec3, to_enu_m: DVec3) -> Self {
        let cloud_m = if from_enu_m.z > base_m {
            0.0
        } else if to_enu_m.z > base_m {
            let share = (base_m - from_enu_m.z) / (to_enu_m.z - from_enu_m.z);
            share * from_enu_m.distance(to_enu_m)
        } else {
            return self;
        };
        match self {
            Self::BlockedAt(range_m) if range_m <= cloud_m => self,
            _ => Self::BlockedAt(cloud_m),
        }
    }
}

/// What a ray hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HitKind {
    /// Terrain, street or water.
    Ground,
    /// A building, or anything else that stands more than 2 m above the terrain: trees, bridges.
    Building,
}

/// All that is solid at a real place.
#[derive(Clone, Debug)]
pub struct Solids {
    /// The triangles of the city and of the land around it, the latter's among them [m, ENU].
    pub triangles: TriangleTree,
    /// Heights of the land around it.
    pub land: Lattice,
}

/// Terrain and surface heights of a site; beyond the rasters the ground is flat, with what stands on it for sight lines
/// alone, or the land of [`Solids`].
#[derive(Clone, Debug)]
pub struct Dsm {
    terrain: HeightGrid,
    surface: HeightGrid,
    blocks: HeightGrid,
    outside_m: f64,
    beyond: Option<Arc<TriangleTree>>,
    solids: Option<Arc<Solids>>,
}

/// What stops a sight line.
enum Obstacle {
    /// The flat ground outside the rasters.
    Outside,
    /// A column.
    Cell(usize),
    /// A triangle of what stands outside the rasters.
    Beyond(usize),
    /// A triangle.
    Triangle(usize),
}

/// A surface cell higher than this above the terrain counts as a building [m].
const BUILDING_MIN_M: f64 = 2.0;
/// What is steeper than this upward part of a normal is a wall.
const WALL: f64 = 0.5;
/// Cells per side of a block of the coarse raster.
const BLOCK: usize = 16;

impl Dsm {
    /// Joins bare terrain, the surface (highest point per cell) and the ground level outside [m].
    pub fn new(terrain: HeightGrid, surface: HeightGrid, outside_m: f64) -> Self {
        let blocks = surface.block_maxima(BLOCK);
        Self {
            terrain,
            surface,
            blocks,
            outside_m,
            beyond: None,
            solids: None,
        }
    }

    /// The same heights, with triangles of hills, houses and trees that sight lines meet outside the rasters [m, ENU].
    pub fn with_beyond(self, triangles: Vec<[DVec3; 3]>) -> Self {
        Self {
            beyond: Some(Arc::new(TriangleTree::new(triangles))),
            ..self
        }
    }

    /// These triangles.
    pub fn beyond(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let trees = self.beyond.iter();
        trees.flat_map(|tree| (0..tree.len()).map(|triangle| tree.corners_m(triangle)))
    }

    /// The same heights, with triangles that sight lines and wrecks meet in place of the columns.
    pub fn with_solids(self, solids: Solids) -> Self {
        Self {
            solids: Some(Arc::new(solids)),
            ..self
        }
    }

    /// The triangles that sight lines and wrecks meet; `None` where they meet the columns.
    pub fn solids(&self) -> Option<&Solids> {
        self.solids.as_deref()
    }

    /// Height of the ground [m] at (e, n) [m] outside the rasters.
    fn outside_m(&self, e_m: f64, n_m: f64) -> f64 {
        let land = self.solids.as_ref().map(|solids| &solids.land);
        land.map_or(self.outside_m, |land| land.height_m(e_m, n_m))
    }

    /// Height of the bare ground [m] at (e, n) [m].
    pub fn terrain_m(&self, e_m: f64, n_m: f64) -> f64 {
        match self.terrain.cell_index(e_m, n_m) {
            Some(_) => self.terrain.bilinear_m(e_m, n_m),
            None => self.outside_m(e_m, n_m),
        }
    }

    /// Height of the surface, buildings and trees included [m], at (e, n) [m].
    pub fn surface_m(&self, e_m: f64, n_m: f64) -> f64 {
        match self.surface.cell_index(e_m, n_m) {
            Some(k) => f64::from(self.surface.heights_m[k]),
            None => self.outside_m(e_m, n_m),
        }
    }

    /// The top of the highest column around a point [m]: above it nothing stands there.
    fn block_top_m(&self, r_enu_m: DVec3) -> f64 {
        match self.blocks.cell_index(r_enu_m.x, r_enu_m.y) {
            Some(k) => f64::from(self.blocks.heights_m[k]),
            None => self.outside_m(r_enu_m.x, r_enu_m.y),
        }
    }

    /// Whether a point [m] lies in something solid: below the surface or, where there are triangles, below one that
    /// faces up.
    pub fn inside(&self, r_enu_m: DVec3) -> bool {
        let Some(solids) = &self.solids else {
            return r_enu_m.z < self.surface_m(r_enu_m.x, r_enu_m.y);
        };
        // The columns hold middles of cells only: a roof may rise on to the border.
        let up_m = self.block_top_m(r_enu_m) + 2.0 - r_enu_m.z;
        let above = (up_m > 0.0)
            .then(|| solids.triangles.first_hit(r_enu_m, up_m * DVec3::Z))
            .flatten();
        above.is_some_and(|hit| solids.triangles.normal(hit.triangle).z > 0.0)
    }

    /// Whether what moves from one point to another [m] within a tick has met something solid.
    pub fn meets(&self, from_enu_m: DVec3, to_enu_m: DVec3) -> bool {
        let Some(solids) = &self.solids else {
            return to_enu_m.z < self.surface_m(to_enu_m.x, to_enu_m.y);
        };
        let near = to_enu_m.z.min(from_enu_m.z) < self.block_top_m(to_enu_m) + 2.0;
        near && ((solids.triangles)
            .first_hit(from_enu_m, to_enu_m - from_enu_m)
            .is_some()
            || self.inside(to_enu_m))
    }

    /// Whether nothing within `radius_m` [m] on the map reaches up to a point [m].
    pub fn clear(&self, r_enu_m: DVec3, radius_m: f64) -> bool {
        if let Some(solids) = &self.solids {
            let mut around = (0..16).map(|k| {
                let out_m = radius_m * DVec2::from_angle(f64::from(k) * TAU / 16.0);
                out_m.extend(0.0)
            });
            let free = |off_m: DVec3| solids.triangles.first_hit(r_enu_m, off_m).is_none();
            return around.all(free) && !self.inside(r_enu_m);
        }
        let around = (0..16).flat_map(|k| {
            let out_m = radius_m * DVec2::from_angle(f64::from(k) * TAU / 16.0);
            [out_m, 0.5 * out_m]
        });
        (around.chain([DVec2::ZERO])).all(|off_m| {
            let at_m = r_enu_m.truncate() + off_m;
            self.surface_m(at_m.x, at_m.y) < r_enu_m.z
        })
    }

    /// The place nearest to a point [m] just inside the surface that is [`Self::clear`] within `radius_m` [m]: beside a
    /// wall, or `up_m` [m] above what it sank into from above. Among triangles it goes out from where it was `before`.
    pub fn nearest_clear(&self, [before, r_enu_m]: [DVec3; 2], radius_m: f64, up_m: f64) -> DVec3 {
        if let Some(solids) = &self.solids {
            // Off what is nearest, and so on in corners.
            let mut free = before;
            for _ in 0..8 {
                let Some((touched, _)) = solids.triangles.nearest(free, radius_m) else {
                    break;
                };
                let away = (free - touched).normalize_or(DVec3::Z);
                // What is level below needs no more than its legs.
                let apart_m = if away.z > 0.9 {
                    up_m.min(radius_m)
                } else {
                    radius_m
                };
                if free.distance(touched) >= apart_m {
                    break;
                }
                free = touched + 1.01 * apart_m * away;
            }
            return free;
        }
        /// What is deeper below the surface than this came in from the side [m].
        const DEEP_M: f64 = 0.5;
        const STEP_M: f64 = 0.1;
        let above = r_enu_m.with_z(self.surface_m(r_enu_m.x, r_enu_m.y) + up_m);
        if above.z - up_m - r_enu_m.z < DEEP_M {
            return above;
        }
        let beside = (1..40).flat_map(|ring| {
            (0..16).map(move |k| {
                let off_m = STEP_M * f64::from(ring) * DVec2::from_angle(f64::from(k) * TAU / 16.0);
                r_enu_m + off_m.extend(0.0)
            })
        });
        let mut beside = beside.filter(|place| self.clear(*place, radius_m));
        beside.next().unwrap_or(above)
    }

    /// The raster of the bare ground.
    pub fn terrain(&self) -> &HeightGrid {
        &self.terrain
    }

    /// The surface raster.
    pub fn surface(&self) -> &HeightGrid {
        &self.surface
    }

    /// Whether two points [m, ENU] see each other.
    pub fn line_of_sight(&self, from_enu_m: DVec3, to_enu_m: DVec3) -> LineOfSight {
        match self.first_obstacle(from_enu_m, to_enu_m - from_enu_m) {
            Some((t, _)) => LineOfSight::BlockedAt(t * from_enu_m.distance(to_enu_m)),
            None => LineOfSight::Clear,
        }
    }

    /// Range [m] to the surface along a unit direction; None is sky (or beyond `max_range_m`).
    pub fn first_hit(&self, from_enu_m: DVec3, dir_enu: DVec3, max_range_m: f64) -> Option<f64> {
        self.first_hit_kind(from_enu_m, dir_enu, max_range_m)
            .map(|(range_m, _)| range_m)
    }

    /// Range [m] to the surface along a unit direction and what is hit there; None is sky (or
    /// beyond `max_range_m`).
    pub fn first_hit_kind(
        &self,
        from_enu_m: DVec3,
        dir_enu: DVec3,
        max_range_m: f64,
    ) -> Option<(f64, HitKind)> {
        let (t, obstacle) = self.first_obstacle(from_enu_m, dir_enu * max_range_m)?;
        let range_m = t * max_range_m;
        let r = from_enu_m + dir_enu * range_m;
        let stands = match obstacle {
            Obstacle::Outside => false,
            // The cell itself, not the point: a wall is hit on the border to the cell before it.
            Obstacle::Cell(cell) => {
                f64::from(self.surface.heights_m[cell]) - self.terrain_m(r.x, r.y) > BUILDING_MIN_M
            }
            Obstacle::Beyond(triangle) => self.beyond_stands(triangle, r),
            Obstacle::Triangle(triangle) => self.triangle_stands(triangle, r, dir_enu),
        };
        let kind = if stands {
            HitKind::Building
        } else {
            HitKind::Ground
        };
        Some((range_m, kind))
    }

    /// Whether a triangle outside the rasters, hit at `r`, is part of something that stands on the ground: it is steep, or
    /// there is ground below it.
    fn beyond_stands(&self, triangle: usize, r: DVec3) -> bool {
        /// Higher than anything that stands there [m].
        const TALL_M: f64 = 100.0;
        self.beyond.as_ref().is_some_and(|tree| {
            let below = tree.first_hit(r - BUILDING_MIN_M * DVec3::Z, -TALL_M * DVec3::Z);
            tree.normal(triangle).z.abs() < WALL || below.is_some()
        })
    }

    /// Whether a triangle that is hit at `r` along a direction is part of something that stands on the ground: it
    /// reaches up from it, or is a wall before something that does.
    fn triangle_stands(&self, triangle: usize, r: DVec3, dir_enu: DVec3) -> bool {
        let Some(solids) = &self.solids else {
            return false;
        };
        let rises = |r: DVec3| r.z - self.terrain_m(r.x, r.y) > BUILDING_MIN_M;
        let corners = solids.triangles.corners_m(triangle);
        let steep = solids.triangles.normal(triangle).z.abs() < WALL;
        let behind = || {
            let level = dir_enu.truncate().normalize_or_zero();
            let at = r.truncate() + level * self.surface.cell_m;
            rises(at.extend(self.surface_m(at.x, at.y)))
        };
        rises(r) || (steep && (corners.into_iter().any(rises) || behind()))
    }

    /// Smallest t in 0..1 at which a + t·d is below the surface, and what is there.
    fn first_obstacle(&self, a: DVec3, d: DVec3) -> Option<(f64, Obstacle)> {
        if let Some(solids) = &self.solids {
            let hit = solids.triangles.first_hit(a, d)?;
            return Some((hit.t, Obstacle::Triangle(hit.triangle)));
        }
        let column = self
            .first_column(a, d)
            .map(|(t, cell)| (t, cell.map_or(Obstacle::Outside, Obstacle::Cell)));
        let within = |r: DVec3| self.surface.cell_index(r.x, r.y).is_some();
        let beyond = match &self.beyond {
            Some(tree) if !(within(a) && within(a + d)) => tree.first_hit(a, d),
            _ => None,
        };
        let beyond = beyond.map(|hit| (hit.t, Obstacle::Beyond(hit.triangle)));
        match (column, beyond) {
            (Some(column), Some(beyond)) if beyond.0 < column.0 => Some(beyond),
            (column, beyond) => column.or(beyond),
        }
    }

    /// Smallest t in 0..1 at which a + t·d is below a column, and its cell; no cell outside the raster.
    fn first_column(&self, a: DVec3, d: DVec3) -> Option<(f64, Option<usize>)> {
        // Where z = h along the ray, entered from above; `t` itself when already below.
        let below = |h: f64, t: f64, out: f64| {
            let (z, z_out) = (a.z + d.z * t, a.z + d.z * out);
            match (z < h, z_out < h) {
                (true, _) => Some(t),
                (false, true) => Some(((h - a.z) / d.z).clamp(t, out)),
                _ => None,
            }
        };
        if !(a.is_finite() && d.is_finite()) {
            return None;
        }
        let Some([t0, t1]) = self.surface.clip(a, d) else {
            return below(self.outside_m, 0.0, 1.0).map(|t| (t, None));
        };
        let before = if t0 > 0.0 {
            below(self.outside_m, 0.0, t0)
        } else {
            None
        };
        before
            .map(|t| (t, None))
            .or_else(|| {
                self.blocks.walk(a, d, [t0, t1], |block, t, out| {
                    let top = f64::from(self.blocks.heights_m[block]);
                    if (a.z + d.z * t).min(a.z + d.z * out) >= top {
                        return None;
                    }
                    self.surface.walk(a, d, [t, out], |cell, t, out| {
                        below(f64::from(self.surface.heights_m[cell]), t, out)
                            .map(|t| (t, Some(cell)))
                    })
                })
            })
            .or_else(|| {
                if t1 < 1.0 {
                    below(self.outside_m, t1, 1.0).map(|t| (t, None))
                } else {
                    None
                }
            })
    }
}

#[cfg(test)]
#[path = "dsm/tests/solids.rs"]
mod solids;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    #[test]
    fn sight_lines_meet_what_stands_outside_the_rasters() {
        // A slope of 50 m over 500 m of map, and a house of 8 m before it.
        let at = |e: f64, n: f64, z: f64| DVec3::new(e, n, z);
        let slope = [
            at(2_000.0, -900.0, 0.0),
            at(2_500.0, 0.0, 50.0),
            at(2_000.0, 900.0, 0.0),
        ];
        let wall = [
            at(1_500.0, -9.0, 0.0),
            at(1_500.0, 9.0, 0.0),
            at(1_500.0, 0.0, 8.0),
        ];
        let floor = [
            at(1_400.0, -90.0, 0.0),
            at(1_700.0, 0.0, 0.0),
            at(1_400.0, 90.0, 0.0),
        ];
        let roof = floor.map(|r| r + 8.0 * DVec3::Z);
        let dsm = site(&[]).with_beyond(vec![slope, wall, floor, roof]);
        let eye = at(0.0, 0.0, 5.0);
        let hit = |dir: DVec3| dsm.first_hit_kind(eye, dir.normalize(), 20_000.0);
        let (range_m, kind) = hit(DVec3::X).unwrap();
        assert!(
            (range_m - 1_500.0).abs() < 1e-6 && kind == HitKind::Building,
            "{range_m}"
        );
        // Over the house to the slope: z = 5 + 0.01 e meets (e - 2000) / 10 at e = 2277.8.
        let (range_m, kind) = hit(at(1.0, 0.0, 0.01)).unwrap();
        let wanted_m = 205.0 / 0.09 * 1.0001_f64.sqrt();
        assert!(
            (range_m - wanted_m).abs() < 0.01 && kind == HitKind::Ground,
            "{range_m}"
        );
        // Down on to the roof, and past it on to the ground.
        let (_, kind) = dsm
            .first_hit_kind(at(1_500.0, 0.0, 60.0), DVec3::NEG_Z, 99.0)
            .unwrap();
        assert_eq!(kind, HitKind::Building);
        let (_, kind) = dsm
            .first_hit_kind(at(1_800.0, 0.0, 60.0), DVec3::NEG_Z, 99.0)
            .unwrap();
        assert_eq!(kind, HitKind::Ground);
        assert_eq!(hit(at(1.0, 0.0, 0.1)), None);
        // Within the rasters nothing outside counts.
        assert_eq!(
            dsm.line_of_sight(eye, at(400.0, 0.0, 5.0)),
            LineOfSight::Clear
        );
        assert_eq!(dsm.beyond().count(), 4);
    }

    /// Flat ground at 0 with boxes [e0, e1, n0, n1, top].
    fn site(boxes: &[[f64; 5]]) -> Dsm {
        let origin = DVec2::splat(-500.0);
        let terrain = HeightGrid::from_fn(origin, 10.0, [100, 100], |_, _| 0.0);
        let surface = HeightGrid::from_fn(origin, 1.0, [1000, 1000], |e, n| {
            boxes
                .iter()
                .filter(|b| e > b[0] && e < b[1] && n > b[2] && n < b[3])
                .fold(0.0, |top, b| b[4].max(top))
        });
        Dsm::new(terrain, surface, 0.0)
    }

    #[test]
    fn what_sank_into_a_wall_comes_out_beside_it() {
        let dsm = site(&[[10.0, 30.0, -20.0, 20.0, 25.0]]);
        // From the west, 2 cm deep.
        let r_enu_m = DVec3::new(10.02, 3.0, 12.0);
        let out = dsm.nearest_clear([r_enu_m; 2], 0.5, 0.1);
        assert!(dsm.clear(out, 0.5), "{out}");
        assert!((0.5..0.75).contains(&(out - r_enu_m).length()), "{out}");
        assert!(out.x < 9.5 && out.z == 12.0, "{out}");
        // On to the roof and the ground.
        let roof = dsm.nearest_clear([DVec3::new(20.0, 3.0, 24.97); 2], 0.5, 0.1);
        assert!(
            (roof - DVec3::new(20.0, 3.0, 25.1)).length() < 1e-9,
            "{roof}"
        );
        let ground = dsm.nearest_clear([DVec3::new(-50.0, 3.0, -0.03); 2], 0.5, 0.1);
        assert!((ground.z - 0.1).abs() < 1e-9, "{ground}");
    }

    /// Entry range into boxes and the ground plane by slabs.
    fn analytic(boxes: &[[f64; 5]], a: DVec3, dir: DVec3, max: f64) -> Option<f64> {
        let mut best = if dir.z < 0.0 {
            -a.z / dir.z
        } else {
            f64::INFINITY
        };
        for b in boxes {
            let low = (DVec3::new(b[0], b[2], -1e3) - a) / dir;
            let high = (DVec3::new(b[1], b[3], b[4]) - a) / dir;
            let enter = low.min(high).max_element().max(0.0);
            if enter < low.max(high).min_element() {
                best = best.min(enter);
            }
        }
        (best <= max).then_some(best)
    }

    #[test]
    fn agrees_with_analytic_boxes() {
        let mut rng = Stream::new(3, 0, "dsm-test");
        let boxes: Vec<[f64; 5]> = (0..40)
            .map(|_| {
                let (e, n) = (
                    rng.range(-450.0, 400.0).floor(),
                    rng.range(-450.0, 400.0).floor(),
                );
                let (w, l) = (rng.range(5.0, 40.0).floor(), rng.range(5.0, 40.0).floor());
                [e, e + w, n, n + l, rng.range(5.0, 60.0).floor()]
            })
            .collect();
        let dsm = site(&boxes);
        let (mut hits, mut misses) = (0, 0);
        for _ in 0..20_000 {
            // Some rays start outside the raster.
            let a = DVec3::new(
                rng.range(-700.0, 700.0),
                rng.range(-700.0, 700.0),
                rng.range(1.0, 90.0),
            );
            let dir = DVec3::new(rng.normal(), rng.normal(), 0.2 * rng.normal()).normalize();
            let range = rng.range(50.0, 1500.0);
            match (
                dsm.first_hit(a, dir, range),
                analytic(&boxes, a, dir, range),
            ) {
                (Some(got), Some(want)) => {
                    hits += 1;
                    assert!(
                        (got - want).abs() < 1e-6,
                        "{got} against {want} from {a} along {dir}"
                    );
                    let sight = dsm.line_of_sight(a, a + dir * range);
                    assert!(matches!(sight, LineOfSight::BlockedAt(r) if (r - want).abs() < 1e-6));
                }
                (None, None) => {
                    misses += 1;
                    assert_eq!(dsm.line_of_sight(a, a + dir * range), LineOfSight::Clear);
                }
                (got, want) => panic!("{got:?} against {want:?} from {a} along {dir}"),
            }
        }
        assert!(hits > 3000 && misses > 3000, "{hits} {misses}");
    }

    #[test]
    fn axis_rays_and_verticals() {
        let dsm = site(&[[10.0, 20.0, -5.0, 5.0, 30.0]]);
        let eye = DVec3::new(0.0, 0.5, 10.0);
        assert_eq!(dsm.first_hit(eye, DVec3::X, 100.0), Some(10.0));
        assert_eq!(dsm.first_hit(eye, DVec3::NEG_X, 5000.0), None);
        assert_eq!(dsm.first_hit(eye, DVec3::NEG_Z, 100.0), Some(10.0));
        assert_eq!(
            dsm.first_hit(DVec3::new(15.0, 0.0, 50.0), DVec3::NEG_Z, 100.0),
            Some(20.0)
        );
        assert_eq!(
            dsm.first_hit(DVec3::new(2000.0, 0.0, 50.0), DVec3::NEG_Z, 100.0),
            Some(50.0)
        );
        assert_eq!(
            dsm.line_of_sight(eye, DVec3::new(30.0, 0.5, 80.0)),
            LineOfSight::Clear
        );
    }

    #[test]
    fn a_hit_tells_ground_from_building() {
        use HitKind::{Building, Ground};
        // A house and a kerb.
        let dsm = site(&[
            [10.0, 20.0, -5.0, 5.0, 30.0],
            [-20.0, -10.0, -5.0, 5.0, 1.5],
        ]);
        let eye = DVec3::new(0.0, 0.5, 10.0);
        let to = |target: DVec3| dsm.first_hit_kind(eye, (target - eye).normalize(), 5000.0);
        let (wall_m, kind) = to(DVec3::new(15.0, 0.5, 10.0)).unwrap();
        assert!((wall_m - 10.0).abs() < 1e-9 && kind == Building);
        for (target, kind) in [
            (DVec3::new(9.9, 0.5, 0.0), Some(Ground)), // at the foot of the wall
            (DVec3::new(-15.0, 0.5, 1.5), Some(Ground)), // on the kerb
            (DVec3::new(-10.0, 0.5, 0.5), Some(Ground)), // its side
            (DVec3::new(-3000.0, 0.5, 0.0), Some(Ground)), // beyond the raster
            (DVec3::new(0.0, 900.0, 10.0), None),
        ] {
            assert_eq!(to(target).map(|(_, kind)| kind), kind, "{target}");
        }
        let roof = dsm.first_hit_kind(DVec3::new(15.0, 0.0, 50.0), DVec3::NEG_Z, 100.0);
        assert_eq!(roof, Some((20.0, Building)));
    }

    #[test]
    fn cloud_blocks_what_is_above_its_base() {
        let (eye, uav) = (DVec3::new(0.0, 0.0, 50.0), DVec3::new(300.0, 0.0, 450.0));
        let below = |sight: LineOfSight, base_m, from, to| sight.below(base_m, from, to);
        let clear = LineOfSight::Clear;
        assert_eq!(below(clear, 450.0, eye, uav), clear);
        // Half the height, half of the 500 m.
        assert_eq!(below(clear, 250.0, eye, uav), LineOfSight::BlockedAt(250.0));
        assert_eq!(below(clear, 250.0, uav, eye), LineOfSight::BlockedAt(0.0));
        let house = LineOfSight::BlockedAt(100.0);
        assert_eq!(below(house, 250.0, eye, uav), house);
        assert_eq!(
            below(LineOfSight::BlockedAt(400.0), 250.0, eye, uav),
            LineOfSight::BlockedAt(250.0)
        );
    }

    #[test]
    fn bilinear_is_exact_on_planes() {
        let plane = |e: f64, n: f64| 0.25 * e - 0.5 * n + 3.0;
        let grid = HeightGrid::from_fn(DVec2::new(-8.0, 4.0), 2.0, [16, 8], plane);
        for (e, n) in [(-7.0, 5.0), (0.3, 11.7), (22.9, 18.9)] {
            assert!((grid.bilinear_m(e, n) - plane(e, n)).abs() < 1e-5);
        }
        // Beyond the centres of the border cells the border value goes on.
        assert_eq!(grid.bilinear_m(-100.0, 5.0), grid.bilinear_m(-7.0, 5.0));
    }
}
