//! Reads a `tileset.json` (OGC 22-025r4, section 7; 1.0: OGC 18-053r2).

use crate::tiles::content::UpAxis;
use crate::tiles::error::TilesError;
use crate::tiles::expansion::{Expansion, Loose, TilesetFile, Tiling, Wait};
use crate::tiles::fetch::{Fetcher, resolve};
use crate::tiles::json::{At, parse};
use boresight_models::tiles::implicit::{Coordinates, Scheme};
use boresight_models::tiles::tree::{Refine, Tile};
use boresight_models::tiles::volume::BoundingVolume;
use glam::{DAffine3, DMat3, DMat4, DVec3};
use serde_json::Value;
use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

/// How deep tiles may stand in each other.
pub(super) const MOST_LEVELS: usize = 512;

/// Extensions that a tileset may require: read here, or without a bearing on what is drawn.
const KNOWN: [&str; 10] = [
    "3DTILES_batch_table_hierarchy",
    "3DTILES_content_gltf",
    "3DTILES_implicit_tiling",
    "3DTILES_metadata",
    "3DTILES_multiple_contents",
    "MAXAR_content_3tz",
    "MAXAR_extent",
    "MAXAR_grid",
    "VRICON_class",
    "VRICON_grid",
];

/// What the tiles of a file inherit from the tile that refers to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Above {
    pub to_root_m: DAffine3,
    pub refine: Refine,
    pub depth: usize,
    pub up_axis: UpAxis,
}

/// The tileset in the bytes of a file.
pub(super) fn tileset(
    fetcher: &Fetcher,
    location: &str,
    bytes: &[u8],
    above: Above,
) -> Result<Expansion, TilesError> {
    let value = parse(location, bytes)?;
    let root = At::root(location, &value);
    let file = file(fetcher, &root, above)?;
    let mut tiles: Vec<Loose> = Vec::new();
    let mut waiting = VecDeque::new();
    let first = root.need("root")?;
    tiles.push(tile(&first, above, &file)?);
    waiting.push_back((0, first, above.depth));
    while let Some((i, at, depth)) = waiting.pop_front() {
        let children = match at.get("children") {
            Some(children) => children.items()?.collect(),
            None => Vec::new(),
        };
        if !children.is_empty() && depth >= MOST_LEVELS {
            return Err(at.fault(format!(
                "stands {MOST_LEVELS} levels deep; make the tree flatter"
            )));
        }
        let contents = contents(&at)?;
        tiles[i].facts.groups = contents
            .iter()
            .filter_map(|content| content.group)
            .collect();
        let first = tiles.len();
        if tiles[i].wait.is_none() {
            let uris = contents
                .into_iter()
                .map(|content| resolve(location, &content.uri));
            let uris = uris.collect::<Result<_, _>>()?;
            let external = tiles[i].take_contents(uris, !children.is_empty());
            for external in external {
                let leading = tiles[i].leading_to(external);
                tiles.push(leading);
            }
        }
        let own = Above {
            to_root_m: tiles[i].tile.to_root_m,
            refine: tiles[i].tile.refine,
            ..above
        };
        for child in children {
            waiting.push_back((tiles.len(), child.clone(), depth + 1));
            tiles.push(tile(&child, own, &file)?);
        }
        tiles[i].children = first..tiles.len();
    }
    Ok(Expansion {
        tiles,
        roots: 0..1,
        file: Some(file),
        ..Expansion::default()
    })
}

fn file(fetcher: &Fetcher, root: &At, above: Above) -> Result<TilesetFile, TilesError> {
    let asset = root.need("asset")?;
    let version = asset.need("version")?;
    let known = ["1.0", "1.1", "0.0"];
    if !known.contains(&version.text()?) {
        return Err(TilesError::Unsupported {
            location: root.location.into(),
            what: format!("version '{}' of 3D Tiles", version.text()?),
            mend: "write it as 1.0 or 1.1".into(),
        });
    }
    let up_axis = match asset.get("gltfUpAxis") {
        None => above.up_axis,
        Some(axis) => match &axis.text()?.to_ascii_uppercase()[..] {
            "X" => UpAxis::X,
            "Y" => UpAxis::Y,
            "Z" => UpAxis::Z,
            _ => return Err(axis.fault("must be X, Y or Z")),
        },
    };
    let texts = |key: &str| -> Result<Vec<String>, TilesError> {
        let Some(list) = root.get(key) else {
            return Ok(Vec::new());
        };
        list.items()?.map(|item| Ok(item.text()?.into())).collect()
    };
    for required in texts("extensionsRequired")? {
        if !KNOWN.contains(&&required[..]) && required != "3DTILES_bounding_volume_S2" {
            return Err(TilesError::Unsupported {
                location: root.location.into(),
                what: format!("the extension {required}, which the tileset requires,"),
                mend: "write the tileset without it".into(),
            });
        }
    }
    let groups = match root.get("groups") {
        Some(groups) => groups.items()?.map(|group| group.value.clone()).collect(),
        None => Vec::new(),
    };
    Ok(TilesetFile {
        location: root.location.into(),
        parent: None,
        version: version.text()?.into(),
        up_axis,
        metadata: root.get("metadata").map(|metadata| metadata.value.clone()),
        groups,
        schema: schema(fetcher, root),
        extensions: texts("extensionsUsed")?,
    })
}

/// The schema of a file's metadata. One that cannot be read takes no tile away: `tiles validate` tells of it.
fn schema(fetcher: &Fetcher, root: &At) -> Option<Arc<Value>> {
    if let Some(schema) = root.get("schema") {
        return Some(Arc::new(schema.value.clone()));
    }
    let location = resolve(root.location, root.get("schemaUri")?.text().ok()?).ok()?;
    let bytes = fetcher.read(&location).ok()?;
    parse(&location, &bytes).ok().map(Arc::new)
}

fn tile(at: &At, above: Above, file: &TilesetFile) -> Result<Loose, TilesError> {
    let volume = volume(&at.need("boundingVolume")?)?;
    let request = at.get("viewerRequestVolume");
    let viewer_request_volume = request.map(|request| self::volume(&request)).transpose()?;
    let error = at.need("geometricError")?;
    let geometric_error_m = error.number()?;
    if geometric_error_m < 0.0 {
        return Err(error.fault("must not be negative"));
    }
    let refine = match at.get("refine") {
        None => above.refine,
        Some(refine) => match &refine.text()?.to_ascii_uppercase()[..] {
            "ADD" => Refine::Add,
            "REPLACE" => Refine::Replace,
            _ => return Err(refine.fault("must be ADD or REPLACE")),
        },
    };
    let mut to_root_m = above.to_root_m;
    if let Some(transform) = at.get("transform") {
        to_root_m *= affine(&transform)?;
        if !to_root_m.is_finite() {
            return Err(transform.fault("leads to places that are no numbers; check it"));
        }
    }
    let mut loose = Loose::new(Tile {
        volume,
        viewer_request_volume,
        geometric_error_m,
        refine,
        to_root_m,
        contents: Vec::new(),
        unread: None,
    });
    loose.facts.metadata = at.get("metadata").map(|metadata| metadata.value.clone());
    if let Some(implicit) = at
        .get("implicitTiling")
        .or_else(|| extension(at, "3DTILES_implicit_tiling"))
    {
        let tiling = tiling(at, &implicit, &loose.tile, file)?;
        let root = Coordinates::default();
        loose.tile.unread = Some(resolve(at.location, &root.fill(&tiling.subtrees))?);
        loose.wait = Some(Wait::Subtree(Arc::new(tiling), root));
    }
    Ok(loose)
}

fn extension<'a>(at: &At<'a>, name: &str) -> Option<At<'a>> {
    at.get("extensions")?.get(name)
}

struct ContentAt {
    uri: String,
    group: Option<u64>,
}

/// The contents of a tile: one, several, or several as an extension of 1.0.
fn contents(at: &At) -> Result<Vec<ContentAt>, TilesError> {
    let mut all = Vec::new();
    let several = at.get("contents").or_else(|| {
        let several = extension(at, "3DTILES_multiple_contents")?;
        several.get("contents").or_else(|| several.get("content"))
    });
    if let Some(content) = at.get("content") {
        all.push(content);
    }
    if let Some(several) = several {
        all.extend(several.items()?);
    }
    let read = |content: At| {
        content.object()?;
        // 1.0 drafts call it url.
        let uri = content.get("uri").or_else(|| content.get("url"));
        let uri = uri.ok_or_else(|| content.fault("has no 'uri'; add it"))?;
        let group = content.get("group");
        Ok(ContentAt {
            uri: uri.text()?.into(),
            group: group
                .map(|group| group.whole(0, u32::MAX.into()))
                .transpose()?,
        })
    };
    all.into_iter().map(read).collect()
}

fn tiling(at: &At, implicit: &At, tile: &Tile, file: &TilesetFile) -> Result<Tiling, TilesError> {
    implicit.object()?;
    if at.get("children").is_some() {
        return Err(at.fault("has children and implicitTiling; leave one out"));
    }
    if matches!(tile.volume, BoundingVolume::Sphere { .. }) {
        return Err(at.fault(
            "has implicitTiling and a sphere, which cannot be halved; give it a box or a region",
        ));
    }
    let scheme = implicit.need("subdivisionScheme")?;
    let scheme = match scheme.text()? {
        "QUADTREE" => Scheme::Quadtree,
        "OCTREE" => Scheme::Octree,
        _ => return Err(scheme.fault("must be QUADTREE or OCTREE")),
    };
    // Coordinates fit 2^62 either way.
    let levels = |at: At, least| at.whole(least, 60).map(|n| n as u32);
    let available_levels = match (
        implicit.get("availableLevels"),
        implicit.get("maximumLevel"),
    ) {
        (None, Some(deepest)) => levels(deepest, 0)? + 1,
        _ => levels(implicit.need("availableLevels")?, 1)?,
    };
    let subtrees = implicit.need("subtrees")?.need("uri")?;
    let contents = contents(at)?
        .into_iter()
        .map(|content| content.uri)
        .collect();
    Ok(Tiling {
        scheme,
        subtree_levels: levels(implicit.need("subtreeLevels")?, 1)?,
        available_levels,
        base: at.location.into(),
        subtrees: subtrees.text()?.into(),
        contents,
        volume: tile.volume,
        error_m: tile.geometric_error_m,
        refine: tile.refine,
        to_root_m: tile.to_root_m,
        schema: file.schema.clone(),
    })
}

/// A transform, its columns one after the other.
fn affine(at: &At) -> Result<DAffine3, TilesError> {
    let m = DMat4::from_cols_array(&at.numbers::<16>()?);
    let last = m.row(3);
    if (last - glam::DVec4::W).abs().max_element() > 1e-9 {
        return Err(at.fault(
            "is not affine: its last row must be 0, 0, 0, 1 (columns stand one after the other)",
        ));
    }
    Ok(DAffine3::from_mat4(m))
}

/// A bounding volume.
pub(super) fn volume(at: &At) -> Result<BoundingVolume, TilesError> {
    at.object()?;
    if let Some(numbers) = at.get("box") {
        let n = numbers.numbers::<12>()?;
        return Ok(box_of(&n));
    }
    if let Some(region) = at.get("region") {
        let n = region.numbers::<6>()?;
        return region_of(&n).map_err(|fault| region.fault(fault));
    }
    if let Some(sphere) = at.get("sphere") {
        let n = sphere.numbers::<4>()?;
        return sphere_of(&n).map_err(|fault| sphere.fault(fault));
    }
    if extension(at, "3DTILES_bounding_volume_S2").is_some() {
        return Err(TilesError::Unsupported {
            location: at.location.into(),
            what: format!("the S2 cell of {}", at.path),
            mend: "add a box or a region beside it".into(),
        });
    }
    Err(at.fault("has no box, region or sphere; add one"))
}

pub(super) fn box_of(n: &[f64; 12]) -> BoundingVolume {
    BoundingVolume::Box {
        center_m: DVec3::from_slice(&n[..3]),
        half_axes_m: DMat3::from_cols_slice(&n[3..]),
    }
}

pub(super) fn sphere_of(n: &[f64; 4]) -> Result<BoundingVolume, &'static str> {
    if n[3] < 0.0 {
        return Err("has a negative radius");
    }
    Ok(BoundingVolume::Sphere {
        center_m: DVec3::from_slice(&n[..3]),
        radius_m: n[3],
    })
}

pub(super) fn region_of(n: &[f64; 6]) -> Result<BoundingVolume, &'static str> {
    let [west, south, east, north, low_m, high_m] = *n;
    let slack = 1e-6; // [rad] rounding of what was written in single precision
    if south.abs() > FRAC_PI_2 + slack || north.abs() > FRAC_PI_2 + slack {
        return Err(
            "has a latitude beyond 90°; the order is west, south, east, north [rad], lowest, highest [m]",
        );
    }
    if west.abs() > TAU || east.abs() > TAU {
        return Err(
            "has a longitude beyond 360°; the order is west, south, east, north [rad], lowest, highest [m]",
        );
    }
    if south > north || low_m > high_m {
        return Err("has its south above its north or its lowest above its highest; exchange them");
    }
    Ok(BoundingVolume::Region {
        west_south_east_north_rad: [west, south, east, north],
        height_m: [low_m, high_m],
    })
}
