//! A procedural city: terrain, streets, blocks, buildings, trees, a river, and the meshes, ground
//! map and surface model made from them.
//!
//! Streets are the seams of a smoothly warped grid cut by one diagonal avenue; each convex block
//! between them is built over by its district's habit: towers, perimeter rows, free-standing
//! slabs, houses in gardens, halls. The same `Part`s make the meshes and the surface raster, so
//! that what is seen and what blocks a sight line agree.

mod apron;
mod blocks;
mod build;
mod buildings;
mod country;
mod ground_map;
mod meshes;
mod met;
mod params;
mod parts;
mod plan;
mod river;
mod streets;
mod trees;

use glam::{DVec2, DVec3};

use crate::ground::dsm::{Dsm, HeightGrid};
use crate::ground::roughness::Roughness;
use crate::maths::polygon::{rectangle, span};
use crate::shape::mesh::MeshData;
pub use ground_map::GroundMap;
pub use met::{Met, Standing};
pub use params::{CityError, CityParams, CitySource, JUDGED_SEEDS, SourceParams, learned_seed};
pub use parts::{Building, BuildingKind, Finish, Part, Roof, Tree, TreeKind};
use plan::Draft;
use river::River;

/// Height of the sensors above the station's roof [m].
pub const STATION_MAST_M: f64 = 3.0;
/// Spacing of the terrain raster [m].
const TERRAIN_CELL_M: f64 = 8.0;

/// A city, generated or real: its heights for sight lines, and what is seen of it or, where tiles show it, around it.
#[derive(Clone, Debug)]
pub struct City {
    /// Heights and sight lines.
    pub dsm: Dsm,
    /// All buildings and bridges.
    pub buildings: Vec<Building>,
    /// All trees.
    pub trees: Vec<Tree>,
    /// Ground albedo over the built square, with the shadows last baked.
    pub ground_map: GroundMap,
    /// The map without shadows.
    unshaded: GroundMap,
    /// What it was generated from.
    pub params: CityParams,
    /// How its buildings slow the wind.
    pub roughness: Roughness,
    /// Where a station stands whose place is not given [m, ENU].
    station_enu_m: DVec3,
    river: Option<River>,
    /// What is seen around a real city, whose tiles show the city itself; `None` for a generated one.
    around: Option<Vec<MeshData>>,
}

/// What is known of a real city.
#[derive(Clone, Debug)]
pub struct RealCity {
    /// Heights and sight lines.
    pub dsm: Dsm,
    /// Footprints of its buildings with base and top.
    pub buildings: Vec<Building>,
    /// How its buildings slow the wind.
    pub roughness: Roughness,
    /// Where a station stands whose place is not given [m, ENU].
    pub station_enu_m: DVec3,
    /// Ground albedo of what is seen around it.
    pub ground_map: GroundMap,
    /// The meshes of what is seen around it, out to the edge of sight, and of ground that its tiles lack.
    pub around: Vec<MeshData>,
    /// What it was made from.
    pub params: CityParams,
}

impl City {
    /// Generates the city of some parameters; the same parameters give the same city.
    pub fn generate(params: &CityParams) -> Result<City, CityError> {
        params.validate()?;
        let mut draft = Draft::new(params);
        if params.is_country() {
            draft.countryside();
        } else {
            draft.layout();
            thin(&mut draft.trees, params.max_trees as usize);
        }
        let (terrain, surface) = height_grids(&draft);
        draft
            .map
            .finish(&terrain, &surface, &draft.noise, &mut draft.rng);
        let around = apron::meshes(params, draft.river.as_ref());
        let dsm = Dsm::new(terrain, surface, 0.0)
            .with_beyond(around.iter().flat_map(MeshData::corners_m).collect());
        Ok(City {
            station_enu_m: DVec3::Z * (dsm.surface_m(0.0, 0.0) + STATION_MAST_M),
            roughness: Roughness::of_heights(draft.buildings.iter().map(Building::height_m)),
            dsm,
            buildings: draft.buildings,
            trees: draft.trees,
            unshaded: draft.map.clone(),
            ground_map: draft.map,
            params: params.clone(),
            river: draft.river,
            around: None,
        })
    }

    /// A city that tiles show.
    pub fn real(real: RealCity) -> City {
        City {
            dsm: real.dsm,
            buildings: real.buildings,
            trees: Vec::new(),
            unshaded: real.ground_map.clone(),
            ground_map: real.ground_map,
            params: real.params,
            roughness: real.roughness,
            station_enu_m: real.station_enu_m,
            river: None,
            around: Some(real.around),
        }
    }

    /// Whether tiles show it.
    pub fn is_real(&self) -> bool {
        self.around.is_some()
    }

    /// Where the sensors of a station stand whose place is not given: above the roof of the tower at the site
    /// point [m, ENU].
    pub fn station_enu_m(&self) -> DVec3 {
        self.station_enu_m
    }

    /// Bakes the sun's shadows into [`City::ground_map`], replacing those baked before.
    ///
    /// `sun_dir_enu` points to the sun. The surface is swept along lines away from it, carrying the
    /// height of the shadow. A full shadow keeps the skylight's share of the light. Around a real city nothing
    /// throws one.
    pub fn bake_shadows(&mut self, sun_dir_enu: DVec3) {
        if self.is_real() {
            return;
        }
        let flat = sun_dir_enu.truncate().length();
        if sun_dir_enu.z <= 0.02 * flat || !sun_dir_enu.is_finite() {
            self.ground_map = self.unshaded.all_shaded();
            return;
        }
        let half = self.params.extent_m / 2.0;
        let away = -sun_dir_enu.truncate().normalize_or(DVec2::X);
        let step = self.unshaded.pixel_m() / 2.0;
        let n = (2.0 * half * std::f64::consts::SQRT_2 / step) as usize + 2;
        let reach = n as f64 * step / 2.0;
        let drop = step * sun_dir_enu.z / flat.max(1e-6);
        let mut lit = vec![true; n * n];
        for line in 0..n {
            let start = away.perp() * (line as f64 * step - reach) - away * reach;
            let mut shadow_m = f64::NEG_INFINITY;
            let mut ground_m = 0.0;
            for k in 0..n {
                let p = start + away * (k as f64 * step);
                if let Some(cell) = self.dsm.surface().cell_index(p.x, p.y) {
                    if k % 8 == 0 {
                        ground_m = self.dsm.terrain_m(p.x, p.y);
                    }
                    shadow_m -= drop;
                    lit[line * n + k] = shadow_m < ground_m + 0.4;
                    shadow_m = shadow_m.max(f64::from(self.dsm.surface().heights_m[cell]));
                }
            }
        }
        self.ground_map = self.unshaded.with_shadows(|p| {
            let line = ((p.dot(away.perp()) + reach) / step + 0.5) as usize;
            let k = ((p.dot(away) + reach) / step + 0.5) as usize;
            lit[line.min(n - 1) * n + k.min(n - 1)]
        });
    }
}

/// Terrain, and the surface with buildings and crowns on it.
fn height_grids(draft: &Draft) -> (HeightGrid, HeightGrid) {
    let extent = draft.params.extent_m;
    let corner = DVec2::splat(-extent / 2.0);
    let cells = |cell: f64| [(extent / cell).ceil() as usize; 2];
    let terrain = HeightGrid::from_fn(corner, TERRAIN_CELL_M, cells(TERRAIN_CELL_M), |e, n| {
        draft.ground_m(DVec2::new(e, n))
    });
    let cell = if extent > 3000.0 { 2.0 } else { 1.0 };
    let mut surface =
        HeightGrid::from_fn(corner, cell, cells(cell), |e, n| terrain.bilinear_m(e, n));
    for part in draft.buildings.iter().flat_map(|b| &b.parts) {
        raise(&mut surface, &part.outline_enu_m, |p| part.roof_m(p));
    }
    for tree in &draft.trees {
        let at = tree.base_enu_m.truncate();
        let crown = rectangle(at, DVec2::X, DVec2::splat(tree.crown_radius_m));
        raise(&mut surface, &crown, |p| {
            let r = p.distance(at) / tree.crown_radius_m;
            let z = tree.base_enu_m.z + tree.height_m * (1.0 - 0.3 * r * r);
            if r < 1.0 { z } else { f64::NEG_INFINITY }
        });
    }
    (terrain, surface)
}

/// Raises the cells whose centre lies inside a simple outline.
fn raise(grid: &mut HeightGrid, outline: &[DVec2], height_m: impl Fn(DVec2) -> f64) {
    let clamp = |x: f64, n: usize| x.clamp(0.0, n as f64) as usize;
    let [n0, n1] = span(outline, DVec2::Y);
    let rows = clamp((n0 - grid.origin_n_m) / grid.cell_m, grid.ny)
        ..clamp((n1 - grid.origin_n_m) / grid.cell_m + 1.0, grid.ny);
    let mut crossings = Vec::new();
    for row in rows {
        let n = grid.origin_n_m + (row as f64 + 0.5) * grid.cell_m;
        crossings.clear();
        for (k, a) in outline.iter().enumerate() {
            let b = outline[(k + 1) % outline.len()];
            if (a.y > n) != (b.y > n) {
                crossings.push(a.x + (b.x - a.x) * (n - a.y) / (b.y - a.y));
            }
        }
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let column = |e: f64| clamp((e - grid.origin_e_m) / grid.cell_m + 0.5, grid.nx);
            for i in column(pair[0])..column(pair[1]) {
                let e = grid.origin_e_m + (i as f64 + 0.5) * grid.cell_m;
                let cell = &mut grid.heights_m[row * grid.nx + i];
                *cell = cell.max(height_m(DVec2::new(e, n)) as f32);
            }
        }
    }
}

/// Keeps `most` trees, evenly spread over the order they were planted in.
fn thin(trees: &mut Vec<Tree>, most: usize) {
    let count = trees.len();
    if count > most {
        let mut k = 0;
        trees.retain(|_| {
            k += 1;
            k * most / count != (k - 1) * most / count
        });
    }
}

#[cfg(test)]
mod tests;
