//! The meshes of a city: terrain, river, buildings.

use glam::{DVec2, DVec3};

use super::City;
use super::apron::{self, APRON_M};
use super::buildings::add_part;
use super::river::{River, WATER_M};
use super::trees::add_tree;
use crate::maths::polygon::centroid;
use crate::shape::mesh::{MeshData, Paint, Surface};

/// Side of a mesh tile [m].
const TILE_M: f64 = 300.0;
/// Spacing of the terrain mesh [m].
const TERRAIN_STEP_M: f64 = 25.0;

impl City {
    /// The city's meshes: one per tile for the terrain and one for what stands on it, the river,
    /// and the land around; each about its own origin, so that a renderer can cull them. Of a real city, which
    /// its tiles show, only the land around.
    pub fn chunks(&self) -> Vec<MeshData> {
        if let Some(around) = &self.around {
            return around.clone();
        }
        let extent = self.params.extent_m;
        let tiles = (extent / TILE_M).ceil() as usize;
        let tile_m = extent / tiles as f64;
        let middle = |k: usize| (k as f64 + 0.5) * tile_m - extent / 2.0;
        let mut built: Vec<MeshData> = (0..tiles * tiles)
            .map(|k| MeshData::new(DVec3::new(middle(k % tiles), middle(k / tiles), 0.0)))
            .collect();
        let tile_of = |p: DVec2| {
            let index = |x: f64| (((x + extent / 2.0) / tile_m) as usize).min(tiles - 1);
            index(p.y) * tiles + index(p.x)
        };
        for building in &self.buildings {
            let mesh = &mut built[tile_of(centroid(building.footprint_enu_m()))];
            for part in &building.parts {
                add_part(mesh, part, building);
            }
        }
        for tree in &self.trees {
            let mesh = &mut built[tile_of(tree.base_enu_m.truncate())];
            add_tree(mesh, tree, self.params.is_country());
        }
        let mut chunks: Vec<MeshData> = (0..tiles * tiles)
            .map(|k| self.terrain_tile(middle(k % tiles), middle(k / tiles), tile_m))
            .collect();
        chunks.extend(built);
        if let Some(river) = &self.river {
            chunks.extend(river_meshes(river, self.params.extent_m));
        }
        chunks.extend(apron::meshes(&self.params, self.river.as_ref()));
        chunks.retain(|c| !c.indices.is_empty());
        chunks
    }

    /// The ground of one square tile of side `tile_m` about (e, n) [m].
    fn terrain_tile(&self, e: f64, n: f64, tile_m: f64) -> MeshData {
        let extent = self.params.extent_m;
        let mut mesh = MeshData::new(DVec3::new(e, n, 0.0));
        let paint = Paint {
            albedo: [1.0; 3],
            surface: Surface::Ground,
            variant: 0.0,
        };
        let cells = (tile_m / TERRAIN_STEP_M).ceil() as u32;
        let step = tile_m / f64::from(cells);
        for j in 0..=cells {
            for i in 0..=cells {
                let p =
                    DVec2::new(e, n) + DVec2::new(f64::from(i), f64::from(j)) * step - tile_m / 2.0;
                let z = |p: DVec2| self.dsm.terrain_m(p.x, p.y);
                let (dx, dy) = (DVec2::X * 8.0, DVec2::Y * 8.0);
                let normal =
                    DVec3::new(z(p - dx) - z(p + dx), z(p - dy) - z(p + dy), 16.0).normalize();
                let uv = [p.x / extent + 0.5, 0.5 - p.y / extent].map(|x| x as f32);
                mesh.vertex(p.extend(z(p)), normal, uv, 1.0, paint);
                if i < cells && j < cells {
                    let a = j * (cells + 1) + i;
                    let b = a + cells + 1;
                    mesh.indices.extend([a, a + 1, b + 1, a, b + 1, b]);
                }
            }
        }
        mesh
    }
}

/// The water and its walls, out to the end of the land.
fn river_meshes(river: &River, extent_m: f64) -> Vec<MeshData> {
    const STEP_M: f64 = 50.0;
    const STEPS_PER_MESH: usize = 8;
    let water = Paint {
        albedo: [0.02, 0.03, 0.03],
        surface: Surface::Water,
        variant: 0.0,
    };
    let count = (2.0 * APRON_M / STEP_M) as usize / STEPS_PER_MESH;
    (0..count)
        .map(|k| {
            let from = -APRON_M + (k * STEPS_PER_MESH) as f64 * STEP_M;
            let center = from + STEPS_PER_MESH as f64 * STEP_M / 2.0;
            let mut mesh = MeshData::new(DVec3::new(center, river.north_m(center), 0.0));
            for s in 0..STEPS_PER_MESH {
                let (e0, e1) = (from + s as f64 * STEP_M, from + (s + 1) as f64 * STEP_M);
                let at = |e: f64, off: f64| river.beside(e, off).extend(WATER_M);
                let w = river.half_width_m;
                mesh.face(&[at(e0, -w), at(e1, -w), at(e1, w), at(e0, w)], water);
                // Far from the city the walls are too thin to see.
                if e0.abs() <= extent_m {
                    river_wall(&mut mesh, river, [e0, e1], [w, w + 0.8]);
                    river_wall(&mut mesh, river, [e0, e1], [-w - 0.8, -w]);
                }
            }
            mesh
        })
        .collect()
}

/// Top and both faces of a wall along the river between two east coordinates, from its southern to
/// its northern face beside the centre line [m].
fn river_wall(mesh: &mut MeshData, river: &River, [e0, e1]: [f64; 2], [near, far]: [f64; 2]) {
    const TOP_M: f64 = 1.1;
    let stone = Paint::plain([0.36, 0.34, 0.3]);
    let at = |e: f64, off: f64, z: f64| river.beside(e, off).extend(z);
    for corners in [
        [
            (e0, near, TOP_M),
            (e1, near, TOP_M),
            (e1, far, TOP_M),
            (e0, far, TOP_M),
        ],
        [
            (e0, near, 0.0),
            (e1, near, 0.0),
            (e1, near, TOP_M),
            (e0, near, TOP_M),
        ],
        [
            (e1, far, 0.0),
            (e0, far, 0.0),
            (e0, far, TOP_M),
            (e1, far, TOP_M),
        ],
    ] {
        mesh.face(&corners.map(|(e, off, z)| at(e, off, z)), stone);
    }
}
