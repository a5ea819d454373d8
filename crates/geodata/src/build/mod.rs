//! Layers of raw geodata → 3D Tiles 1.1 on disk.
//!
//! From the smallest cells up: children are merged, welded and made simpler (eq. 1) until one tile shows everything.

mod atlas;
pub mod city;
mod glb;
pub mod ground;
mod measure;
mod mesh;
pub mod options;
mod pictures;
pub mod report;
mod simplify;
pub mod sources;
mod split;
mod table;
mod tile;
mod tileset;

#[cfg(test)]
mod tests;

use crate::sources::Layer;
use boresight_common::output::{create_dir, put};
use boresight_common::parallel::{in_parallel, threads};
pub use options::{BuildOptions, Division, Pictures};
pub use report::{BuildError, BuildReport, LevelReport};
use split::{Budget, Cell};
use std::path::Path;
use tile::{Tile, make};
use tileset::Entry;

/// Writes the tiles of some layers: `folder/tileset.json` and its contents. All layers are put into the frame of the
/// first one's site. The same layers give the same bytes, on any number of threads.
pub fn build(
    layers: &[Layer],
    options: &BuildOptions,
    folder: &Path,
) -> Result<BuildReport, BuildError> {
    build_with(layers, options, folder, |_| {})
}

/// As [`build`], and says in words how far it has come.
pub fn build_with(
    layers: &[Layer],
    options: &BuildOptions,
    folder: &Path,
    say: impl Fn(&str),
) -> Result<BuildReport, BuildError> {
    options.check()?;
    create_dir(folder)?;
    tileset::clear(folder)?;
    let octree = options.division == Division::Octree;
    let mut scene = mesh::gather(layers, octree)?;
    let side_px = f64::from(options.max_texture_px);
    let budget = Budget {
        triangles: options.max_triangles,
        // Charts leave gaps between them.
        texels: 0.7 * side_px * side_px,
        octree,
        exact: options.implicit,
    };
    let cells = split::split(&mut scene, &budget);
    let depth = cells
        .iter()
        .map(|cell| cell.level)
        .max()
        .unwrap_or_default();
    say(&format!(
        "{} triangles in {} cells on {} levels",
        scene.triangles_in,
        cells.len(),
        depth + 1
    ));
    let mut report = BuildReport {
        triangles_in: scene.triangles_in,
        features: scene.features.len(),
        lattice_m: scene.step_m,
        levels: vec![LevelReport::default(); depth as usize + 1],
        ..BuildReport::default()
    };
    let mut entries = vec![
        Entry {
            bounds: [[0; 3]; 2],
            error_m: 0.0,
        };
        cells.len()
    ];
    let mut tiles: Vec<Option<Tile>> = cells.iter().map(|_| None).collect();
    for level in (0..=depth).rev() {
        let of_level = |&i: &usize| cells[i].level == level;
        let jobs: Vec<usize> = (0..cells.len()).filter(of_level).collect();
        let done = in_parallel(&jobs, threads(options.threads), |&i| {
            let children: Vec<&Tile> = cells[i]
                .children
                .iter()
                .filter_map(|&c| tiles[c].as_ref())
                .collect();
            write_tile(&scene, &cells[i], &children, options, folder)
        })?;
        let state = &mut report.levels[level as usize];
        let (mut below, mut kept) = (0, 0);
        for (&i, (tile, bytes)) in jobs.iter().zip(done) {
            let count = tile.mesh.triangle_count();
            state.tiles += 1;
            state.triangles += count;
            state.bytes += bytes;
            if tile.below > 0 {
                below += tile.below;
                kept += count;
            }
            let error_m = tile.geometric_error * scene.step_m;
            state.error_m = state.error_m.max(error_m);
            entries[i] = Entry {
                bounds: tile.bounds,
                error_m,
            };
            for &child in &cells[i].children {
                tiles[child] = None;
            }
            tiles[i] = Some(tile);
        }
        state.share = kept as f64 / below.max(1) as f64;
        report.triangles_out += state.triangles;
        report.bytes += state.bytes;
        say(&format!(
            "level {level}: {} tiles, {} triangles, error {:.3} m",
            state.tiles, state.triangles, state.error_m
        ));
    }
    tileset::write(&scene, &cells, &entries, options, folder)?;
    Ok(report)
}

/// Makes a tile and writes its content; how many bytes that has.
fn write_tile(
    scene: &mesh::Scene,
    cell: &Cell,
    children: &[&Tile],
    options: &BuildOptions,
    folder: &Path,
) -> Result<(Tile, u64), BuildError> {
    let made = make(scene, cell, children, options);
    let path = folder.join(tileset::content_name(cell, options.division));
    let bytes = glb::encoded(
        scene,
        &made.shown,
        made.atlas.as_ref(),
        made.tile.halvings,
        options,
        &path,
    )?;
    put(&path, &bytes)?;
    Ok((made.tile, bytes.len() as u64))
}
