//! `tileset.json` (OGC 22-025r4), with every tile in it or with the rule that implicit tiles follow.

use super::mesh::{MOST_LEVELS, Scene};
use super::options::{BuildOptions, Division};
use super::report::BuildError;
use super::split::Cell;
use crate::tiles::heights;
use boresight_common::output::{OutputError, put, put_json};
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// Levels of a subtree file: at most 1 + 4 + … + 4⁴ or 8⁴ tiles.
const SUBTREE_LEVELS: u32 = 5;
/// Half a box's side is at least this [m]: flat ones are no volumes.
const THIN_M: f64 = 0.01;

/// What the tileset says of a tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    /// Bounds of all in it and below [lattice].
    pub bounds: [[i32; 3]; 2],
    /// [m]
    pub error_m: f64,
}

/// The path of a cell's content below the tileset.
pub(super) fn content_name(cell: &Cell, division: Division) -> String {
    let [x, y, z] = cell.index;
    match division {
        Division::Quadtree => format!("content/{}/{x}/{y}.glb", cell.level),
        Division::Octree => format!("content/{}/{x}/{y}/{z}.glb", cell.level),
    }
}

/// A box along the axes (3D Tiles 1.1, 7.1.1): centre and half axes [m].
fn volume(low: DVec3, high: DVec3) -> Value {
    let middle = (low + high) / 2.0;
    let half = ((high - low) / 2.0).max(DVec3::splat(THIN_M));
    json!({ "box": [
        middle.x, middle.y, middle.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z,
    ] })
}

/// From the site's frame to the Earth's, column by column.
fn transform(scene: &Scene) -> Vec<f64> {
    let origin = scene.site.enu_to_ecef(DVec3::ZERO);
    let turn = scene.site.q_ecef_enu();
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| turn * axis);
    (axes.iter().map(|axis| axis.extend(0.0)))
        .chain([origin.extend(1.0)])
        .flat_map(|column| column.to_array())
        .collect()
}

/// The file's name.
const FILE: &str = "tileset.json";
/// What it says of who wrote it.
const GENERATOR: &str = "boresight tiles build";

/// Takes away what an earlier build left in a folder; what others wrote stays.
pub(super) fn clear(folder: &Path) -> Result<(), BuildError> {
    let own = || -> Option<bool> {
        let text = std::fs::read(folder.join(FILE)).ok()?;
        let json: Value = serde_json::from_slice(&text).ok()?;
        Some(json["asset"]["extras"]["generator"] == GENERATOR)
    };
    if own() != Some(true) {
        return Ok(());
    }
    for name in ["content", "subtrees", heights::FILE, FILE] {
        let path = folder.join(name);
        let gone = match path.is_dir() {
            true => std::fs::remove_dir_all(&path),
            false => std::fs::remove_file(&path),
        };
        match gone {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                return Err(OutputError::File { path, source }.into());
            }
            _ => {}
        }
    }
    Ok(())
}

/// Writes `tileset.json` and, for an implicit tree, its subtrees.
pub(super) fn write(
    scene: &Scene,
    cells: &[Cell],
    entries: &[Entry],
    options: &BuildOptions,
    folder: &Path,
) -> Result<(), BuildError> {
    let mut root = if options.implicit {
        implicit(scene, cells, entries, options, folder)?
    } else {
        explicit(scene, cells, entries, options, 0)
    };
    root["transform"] = json!(transform(scene));
    let [low, high] = entries[0].bounds.map(|at| scene.place_m(at));
    let size_m = (high - low).length();
    let whole_m = root["geometricError"]
        .as_f64()
        .unwrap_or_default()
        .max(size_m);
    let tileset = json!({
        "asset": { "version": "1.1", "tilesetVersion": "1", "extras": { "generator": GENERATOR } },
        "geometricError": whole_m,
        "root": root,
    });
    Ok(put_json(&folder.join(FILE), &tileset)?)
}

/// A tile and all below it.
fn explicit(
    scene: &Scene,
    cells: &[Cell],
    entries: &[Entry],
    options: &BuildOptions,
    index: usize,
) -> Value {
    let (cell, entry) = (&cells[index], entries[index]);
    let [low, high] = entry.bounds.map(|at| scene.place_m(at));
    let mut tile = json!({
        "boundingVolume": volume(low, high),
        "geometricError": entry.error_m,
        "content": { "uri": content_name(cell, options.division) },
    });
    if cell.level == 0 {
        tile["refine"] = json!("REPLACE");
    }
    if !cell.children.is_empty() {
        let children = cell
            .children
            .iter()
            .map(|&c| explicit(scene, cells, entries, options, c));
        tile["children"] = children.collect();
    }
    tile
}

/// The root of an implicit tree; writes the subtrees.
fn implicit(
    scene: &Scene,
    cells: &[Cell],
    entries: &[Entry],
    options: &BuildOptions,
    folder: &Path,
) -> Result<Value, BuildError> {
    let axes = options.division.axes();
    let mut low = scene.place_m([0; 3]);
    let mut high = scene.place_m([scene.side; 3]);
    if axes == 2 {
        let [below, above] = entries[0].bounds.map(|at| scene.place_m(at));
        (low.z, high.z) = (below.z, above.z.max(below.z + 2.0 * THIN_M));
    }
    let levels = cells
        .iter()
        .map(|cell| cell.level)
        .max()
        .unwrap_or_default()
        + 1;
    // A tile's error is the root's, halved as often as the tile is deep: the root's is such that none is too small.
    let root_m = (cells.iter().zip(entries))
        .map(|(cell, entry)| entry.error_m * f64::from(1_u32 << cell.level))
        .fold(0.0, f64::max);
    let there: BTreeSet<(u32, [u32; 3])> =
        cells.iter().map(|cell| (cell.level, cell.index)).collect();
    let place = match options.division {
        Division::Quadtree => "{level}/{x}/{y}",
        Division::Octree => "{level}/{x}/{y}/{z}",
    };
    for level in (0..levels.min(MOST_LEVELS + 1)).step_by(SUBTREE_LEVELS as usize) {
        for &(_, index) in there.range((level, [0; 3])..(level + 1, [0; 3])) {
            let bytes = subtree(&there, level, index, axes);
            let [x, y, z] = index;
            let name = match options.division {
                Division::Quadtree => format!("subtrees/{level}/{x}/{y}.subtree"),
                Division::Octree => format!("subtrees/{level}/{x}/{y}/{z}.subtree"),
            };
            put(&folder.join(name), bytes)?;
        }
    }
    Ok(json!({
        "boundingVolume": volume(low, high),
        "geometricError": root_m,
        "refine": "REPLACE",
        "content": { "uri": format!("content/{place}.glb") },
        "implicitTiling": {
            "subdivisionScheme": if axes == 2 { "QUADTREE" } else { "OCTREE" },
            "subtreeLevels": SUBTREE_LEVELS,
            "availableLevels": levels,
            "subtrees": { "uri": format!("subtrees/{place}.subtree") },
        },
    }))
}

/// A cell's number among those of its level below a subtree's root: bits of its coordinates by turns (Morton order).
fn morton(index: [u32; 3], axes: usize) -> usize {
    let bit = |b: usize, k: usize| (index[k] as usize >> b & 1) << (b * axes + k);
    (0..10)
        .flat_map(|b| (0..axes).map(move |k| (b, k)))
        .map(|(b, k)| bit(b, k))
        .sum()
}

/// Availability of one kind: a constant where all or none are there, else bits.
fn availability(there: &[bool], binary: &mut Vec<u8>, views: &mut Vec<Value>) -> Value {
    let count = there.iter().filter(|&&t| t).count();
    if count == there.len() || count == 0 {
        return json!({ "constant": u8::from(count > 0) });
    }
    binary.resize(binary.len().next_multiple_of(8), 0);
    let start = binary.len();
    binary.resize(start + there.len().div_ceil(8), 0);
    for (k, _) in there.iter().enumerate().filter(|&(_, &t)| t) {
        binary[start + k / 8] |= 1 << (k % 8);
    }
    views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": binary.len() - start }));
    json!({ "bitstream": views.len() - 1, "availableCount": count })
}

/// A binary subtree (OGC 22-025r4, 9.4): which tiles of the next levels are there. Every tile has content.
fn subtree(there: &BTreeSet<(u32, [u32; 3])>, level: u32, root: [u32; 3], axes: usize) -> Vec<u8> {
    let of_level = |below: u32| {
        let mut bits = vec![false; 1 << (axes as u32 * below)];
        let first = root.map(|i| i << below);
        let last = root.map(|i| (i + 1) << below);
        let row = (level + below, [first[0], 0, 0])..(level + below, [last[0], 0, 0]);
        for &(_, index) in there.range(row) {
            if (0..axes).all(|k| (first[k]..last[k]).contains(&index[k])) {
                let own = std::array::from_fn(|k| index[k] - first[k].min(index[k]));
                bits[morton(own, axes)] = true;
            }
        }
        bits
    };
    let tiles: Vec<bool> = (0..SUBTREE_LEVELS).flat_map(of_level).collect();
    let mut binary = Vec::new();
    let mut views = Vec::new();
    let tile_availability = availability(&tiles, &mut binary, &mut views);
    let children = of_level(SUBTREE_LEVELS);
    let child_availability = availability(&children, &mut binary, &mut views);
    let mut value = json!({
        "tileAvailability": tile_availability,
        "contentAvailability": [tile_availability],
        "childSubtreeAvailability": child_availability,
    });
    binary.resize(binary.len().next_multiple_of(8), 0);
    if !views.is_empty() {
        value["buffers"] = json!([{ "byteLength": binary.len() }]);
        value["bufferViews"] = Value::Array(views);
    }
    let mut text = value.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(8), b' ');
    let mut out = Vec::from(b"subt");
    out.extend(1_u32.to_le_bytes());
    out.extend((text.len() as u64).to_le_bytes());
    out.extend((binary.len() as u64).to_le_bytes());
    out.extend(text);
    out.extend(binary);
    out
}
