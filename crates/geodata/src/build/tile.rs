//! One tile: its triangles, its picture, its errors.

use super::atlas::{Atlas, detail, pack, painted};
use super::mesh::{Mesh, Scene, Vertex};
use super::options::BuildOptions;
use super::simplify::simplify;
use super::split::Cell;
use glam::DVec3;
use std::borrow::Cow;

/// Pixels on the screen that a pixel of a texture may cover before the children's finer ones are drawn, so that the
/// usual limit of 16 px for the error of shapes (Cesium's default) holds textures to one.
const PIXELS_PER_TEXEL: f64 = 16.0;
/// A vertex lies no farther from where it was than this, by rounding to the lattice [steps].
const ROUNDING: f64 = 0.87;
/// Tiles with fewer triangles are as good as none: they are not made simpler.
const FEW: usize = 48;

/// So many times the wanted triangles are too many to keep textures for.
const SHORT: f64 = 1.5;
/// Pixels on the screen that the distance of two vertices with colours may cover.
const PIXELS_PER_COLOR: f64 = 4.0;

/// Whether a vertex is under a texture.
fn is_textured(scene: &Scene, vertex: &Vertex) -> bool {
    scene.materials[vertex.material as usize].texture.is_some()
}

/// Mean distance of neighbouring vertices [steps of the lattice].
fn spacing(mesh: &Mesh) -> f64 {
    let edge = |t: &[u32; 3]| {
        let [a, b] = [t[0], t[1]].map(|i| DVec3::from(mesh.vertices[i as usize].at.map(f64::from)));
        a.distance(b)
    };
    let sum: f64 = mesh.triangles().iter().map(edge).sum();
    sum / mesh.triangle_count().max(1) as f64
}

/// A tile, made.
#[derive(Debug)]
pub(super) struct Tile {
    /// With the places of vertices in the sources' textures.
    pub mesh: Mesh,
    /// How often the sources' textures are halved.
    pub halvings: u32,
    /// Farthest that its surface lies from the sources' [steps of the lattice].
    pub shape_error: f64,
    /// What the tileset says: the least distance at which finer tiles are worth drawing follows from it [steps].
    pub geometric_error: f64,
    /// Bounds of its triangles and of all below it [lattice].
    pub bounds: [[i32; 3]; 2],
    /// Triangles of its children together.
    pub below: usize,
}

/// What is written of a tile beside its mesh.
pub(super) struct Made {
    pub tile: Tile,
    pub atlas: Option<Atlas>,
    /// The mesh as it is written.
    pub shown: Mesh,
}

/// Makes the tile of a cell, from its own triangles or from its children's tiles.
pub(super) fn make(scene: &Scene, cell: &Cell, children: &[&Tile], options: &BuildOptions) -> Made {
    let tile = match &cell.mesh {
        Some(mesh) => Tile {
            mesh: mesh.clone(),
            halvings: 0,
            shape_error: ROUNDING,
            geometric_error: 0.0,
            bounds: mesh.bounds().unwrap_or_default(),
            below: 0,
        },
        None => merged(scene, cell, children, options),
    };
    let picture = |halvings| pack(scene, &tile.mesh, halvings, options.max_texture_px);
    let mut atlas = picture(tile.halvings);
    let textured = |material: &super::mesh::Material| material.texture.is_some() && !material.tiled;
    let any = tile
        .mesh
        .vertices
        .iter()
        .any(|v| textured(&scene.materials[v.material as usize]));
    // Too many charts for any atlas: their colours at the vertices.
    let shown = if atlas.is_none() && any {
        Cow::Owned(painted(scene, &tile.mesh, tile.halvings, textured))
    } else {
        Cow::Borrowed(&tile.mesh)
    };
    let shown = shown.into_owned();
    let mut tile = tile;
    if let Some(atlas) = &mut atlas {
        tile.halvings = tile.halvings.max(atlas.halvings);
        if !children.is_empty() {
            tile.geometric_error = tile.geometric_error.max(atlas.texel * PIXELS_PER_TEXEL);
        }
    }
    Made { tile, atlas, shown }
}

/// A cell's children as one tile of fewer triangles.
fn merged(scene: &Scene, cell: &Cell, children: &[&Tile], options: &BuildOptions) -> Tile {
    let mut mesh = Mesh::default();
    let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
    let (mut shape, mut geometric, mut halvings) = (0.0_f64, 0.0_f64, 0);
    for child in children {
        mesh.append(&child.mesh);
        shape = shape.max(child.shape_error);
        geometric = geometric.max(child.geometric_error);
        halvings = halvings.max(child.halvings + 1);
        let [low, high] = &mut bounds;
        for (low, own) in low.iter_mut().zip(child.bounds[0]) {
            *low = own.min(*low);
        }
        for (high, own) in high.iter_mut().zip(child.bounds[1]) {
            *high = own.max(*high);
        }
    }
    let below = mesh.triangle_count();
    // Windows and the like are too small to be seen from where this tile is drawn.
    geometric = geometric.max(detail(scene, &mesh) * PIXELS_PER_TEXEL);
    let mesh = painted(scene, &mesh, u32::MAX, |material| material.tiled).welded();
    let axes = options.division.axes();
    let planes: Vec<(usize, i32)> = (cell.planes(scene.side, axes))
        .flat_map(|(axis, planes)| planes.map(|plane| (axis, plane)))
        .filter(|&(_, plane)| plane > 0 && plane < scene.side)
        .collect();
    let on_border = |at: [i32; 3]| planes.iter().any(|&(axis, plane)| at[axis] == plane);
    let (mesh, error) = if mesh.triangle_count() <= FEW {
        (mesh, 0.0)
    } else {
        let first = simplify(&mesh, &scene.materials, options.keep, on_border);
        let wanted = mesh.triangle_count() as f64 * options.keep;
        let textured = |mesh: &Mesh| mesh.vertices.iter().any(|v| is_textured(scene, v));
        if first.mesh.triangle_count() as f64 > SHORT * wanted && textured(&first.mesh) {
            // Charts too small to be made simpler: their colours at the vertices.
            let bare = painted(scene, &mesh, halvings, |_| true);
            let second = simplify(&bare, &scene.materials, options.keep, on_border);
            geometric = geometric.max(spacing(&second.mesh) * PIXELS_PER_COLOR);
            (second.mesh, second.error)
        } else {
            (first.mesh, first.error)
        }
    };
    let shape_error = shape + error;
    Tile {
        mesh,
        halvings,
        shape_error,
        geometric_error: geometric.max(shape_error),
        bounds,
        below,
    }
}
