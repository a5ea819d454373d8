//! Height rasters (GeoTIFF) as terrain, with or without a picture from above.

mod grid;
mod keys;
mod metadata;
mod own;
pub mod raster;
mod tiff;

use super::error::{Fault, SourceError};
use super::options::Options;
use super::{Layer, LayerKind};
use crate::projection::CrsError;
use boresight_common::warning::{Notes, Warning};
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::shape::textured::{Look, Texture, TexturedMesh};
use glam::{DVec2, DVec3};
use raster::{Heights, Orthophoto};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most cells along an edge of a mesh.
const MOST_CELLS: usize = 256;
/// Most pixels along an edge of a texture page.
const MOST_PAGE: f64 = 2048.0; // [px]
/// Linear albedo of ground without a picture: dry grass.
const GROUND: [f32; 4] = [0.16, 0.18, 0.10, 1.0];

/// The files that a path names: itself, or all GeoTIFFs of a folder by name.
fn files(path: &Path) -> Result<Vec<PathBuf>, SourceError> {
    if !path.is_dir() {
        return Ok(vec![path.into()]);
    }
    let failed = |source| SourceError::Read {
        path: path.into(),
        source,
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(failed)? {
        let file = entry.map_err(failed)?.path();
        let extension = file
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or("")
            .to_lowercase();
        if ["tif", "tiff"].contains(&extension.as_str()) {
            found.push(file);
        }
    }
    found.sort();
    let none = || {
        Fault::new(
            "folder",
            "no GeoTIFF in it (.tif)",
            "name a folder that has some",
        )
        .of(path)
    };
    if found.is_empty() {
        Err(none())
    } else {
        Ok(found)
    }
}

/// A height raster, or all those of a folder, as terrain: a regular grid of vertices at the pixels' centres, with holes where heights are
/// missing, under the options' orthophoto.
///
/// Fails where a file is damaged, has no place on the map or names no system that is known.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let mut warnings = Vec::new();
    let photo = match &options.orthophoto {
        Some(path) => {
            let mut notes = Notes::default();
            let photo = Orthophoto::read(path, &mut notes)?;
            warnings.extend(notes.warnings(path));
            Some(photo)
        }
        None => None,
    };
    let mut site = options.site;
    let mut meshes = Vec::new();
    for file in files(path)? {
        let mut notes = Notes::default();
        let heights = Heights::read(&file, options, &mut notes)?;
        warnings.extend(notes.warnings(&file));
        let done = (|| {
            let site = *site.insert(match site {
                Some(site) => site,
                None => middle(&heights)?,
            });
            terrain(&heights, &site, photo.as_ref(), &mut meshes)
        })();
        done.map_err(|error: CrsError| Fault::from(error).of(&file))?;
    }
    let none = || {
        Fault::new(
            "heights",
            "no four heights beside each other",
            "name a raster of more heights",
        )
        .of(path)
    };
    let site = site.filter(|_| !meshes.is_empty()).ok_or_else(none)?;
    if let Some(path) = &options.orthophoto
        && meshes.iter().all(|mesh| mesh.look.texture.is_none())
    {
        let mut notes = Notes::default();
        let what = "it covers none of the heights: they keep the colour of ground";
        notes.assume(
            "place",
            what,
            "check its georeferencing and its system, or leave it out",
        );
        warnings.extend(notes.warnings(path));
    }
    Ok(Layer {
        kind: LayerKind::Terrain,
        site,
        meshes,
        features: Vec::new(),
        warnings,
    })
}

/// The frame in the middle of a raster, at its lowest height.
fn middle(heights: &Heights) -> Result<SiteFrame, CrsError> {
    let [width, height] = heights.size;
    let all = (0..width * height).filter_map(|k| heights.at(k % width, k / width));
    let low = all.fold(f64::INFINITY, f64::min);
    let r = (heights.center(0, 0) + heights.center(width - 1, height - 1)) / 2.0;
    Ok(SiteFrame::new(heights.crs.to_geodetic(r.extend(low))?))
}

/// Adds a raster's meshes.
fn terrain(
    heights: &Heights,
    site: &SiteFrame,
    photo: Option<&Orthophoto>,
    meshes: &mut Vec<TexturedMesh>,
) -> Result<(), CrsError> {
    let [width, height] = heights.size;
    // Pages of the picture bound the meshes where its pixels are small.
    let cells = match photo {
        None => MOST_CELLS,
        Some(photo) => {
            let to = |column, row| {
                Block {
                    heights,
                    photo: Some(photo),
                }
                .pixel(heights.center(column, row))
            };
            let (i, j) = (width / 2, height / 2);
            let here = to(i, j)?;
            let next = to((i + 1).min(width - 1), (j + 1).min(height - 1))?;
            let cell_px = (next - here).abs().max_element().max(1e-3);
            ((MOST_PAGE - 16.0) / cell_px).clamp(1.0, MOST_CELLS as f64) as usize
        }
    };
    let block = Block { heights, photo };
    for j in (0..height.saturating_sub(1)).step_by(cells) {
        for i in (0..width.saturating_sub(1)).step_by(cells) {
            let to = [(i + cells).min(width - 1), (j + cells).min(height - 1)];
            meshes.extend(block.mesh(site, [i, j], to)?);
        }
    }
    Ok(())
}

/// What a mesh of terrain is cut from.
struct Block<'a> {
    heights: &'a Heights,
    photo: Option<&'a Orthophoto>,
}

impl Block<'_> {
    /// Place in the picture [px] of a place on the raster's map.
    fn pixel(&self, r: DVec2) -> Result<DVec2, CrsError> {
        let Some(photo) = self.photo else {
            return Ok(DVec2::ZERO);
        };
        let found = photo.pixel(r, &self.heights.crs)?;
        Ok(found.unwrap_or(DVec2::NAN))
    }

    /// The mesh between two pixels' centres, both included; `None` where no height is.
    fn mesh(
        &self,
        site: &SiteFrame,
        from: [usize; 2],
        to: [usize; 2],
    ) -> Result<Option<TexturedMesh>, CrsError> {
        let heights = self.heights;
        // With a row and a column more on each side, so that normals agree with those of the neighbours.
        let low = from.map(|k| k.saturating_sub(1));
        let high = [0, 1].map(|k| (to[k] + 1).min(heights.size[k] - 1));
        let columns = high[0] - low[0] + 1;
        let mut places = Vec::with_capacity(columns * (high[1] - low[1] + 1));
        for row in low[1]..=high[1] {
            for column in low[0]..=high[0] {
                let r = |h: f64| heights.crs.to_ecef(heights.center(column, row).extend(h));
                let r = heights.at(column, row).map(r).transpose()?;
                places.push(r.map(|r| site.ecef_to_enu(r)));
            }
        }
        let at = |column: usize, row: usize| places[(row - low[1]) * columns + column - low[0]];
        let near = |column: usize, row: usize, dx: isize, dy: isize| {
            let (x, y) = (column.checked_add_signed(dx)?, row.checked_add_signed(dy)?);
            if x < low[0] || y < low[1] || x > high[0] || y > high[1] {
                None
            } else {
                at(x, y)
            }
        };
        let mut mesh = TexturedMesh {
            look: Look {
                base_color: GROUND,
                ..Look::default()
            },
            ..TexturedMesh::default()
        };
        let Some(origin_m) = places.iter().flatten().next().map(|r| r.round()) else {
            return Ok(None);
        };
        mesh.origin_m = origin_m;
        let mut numbers = vec![u32::MAX; (to[0] - from[0] + 1) * (to[1] - from[1] + 1)];
        let number =
            |column: usize, row: usize| (row - from[1]) * (to[0] - from[0] + 1) + column - from[0];
        let mut pixels = Vec::new();
        for row in from[1]..=to[1] {
            for column in from[0]..=to[0] {
                let Some(r) = at(column, row) else { continue };
                let side = |dx, dy| near(column, row, dx, dy).unwrap_or(r);
                let normal = (side(1, 0) - side(-1, 0)).cross(side(0, -1) - side(0, 1));
                let normal = if normal.z < 0.0 { -normal } else { normal }.normalize_or(DVec3::Z);
                numbers[number(column, row)] = mesh.positions.len() as u32;
                mesh.positions.push((r - origin_m).as_vec3().into());
                mesh.normals.push(normal.as_vec3().into());
                if self.photo.is_some() {
                    pixels.push(self.pixel(heights.center(column, row))?);
                }
            }
        }
        for row in from[1]..to[1] {
            for column in from[0]..to[0] {
                let corner = |dx: usize, dy: usize| numbers[number(column + dx, row + dy)];
                let [a, b, c, d] = [corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)];
                // Each half of a cell with its three heights; the diagonal goes where a corner is missing.
                let halves = if a == u32::MAX || c == u32::MAX {
                    [[a, b, d], [b, c, d]]
                } else {
                    [[a, b, c], [a, c, d]]
                };
                for half in halves.into_iter().filter(|half| !half.contains(&u32::MAX)) {
                    mesh.indices.extend(half);
                }
            }
        }
        if mesh.indices.is_empty() {
            return Ok(None);
        }
        upward(&mut mesh);
        if let Some(photo) = self.photo {
            drape(&mut mesh, photo, &pixels);
        }
        Ok(Some(mesh))
    }
}

/// Turns triangles that are seen from below: a map whose rows run north or columns west.
fn upward(mesh: &mut TexturedMesh) {
    for t in 0..mesh.triangle_count() {
        let [a, b, c] = [0, 1, 2].map(|k| mesh.vertex_m(mesh.indices[3 * t + k]));
        if (b - a).cross(c - a).z < 0.0 {
            mesh.indices.swap(3 * t + 1, 3 * t + 2);
        }
    }
}

/// Lays the part of a picture that a mesh shows over it; outside the picture the ground keeps its own colour.
fn drape(mesh: &mut TexturedMesh, photo: &Orthophoto, pixels: &[DVec2]) {
    let finite = || pixels.iter().filter(|p| p.is_finite());
    let low = finite().fold(DVec2::INFINITY, |a, b| a.min(*b)).floor() - 2.0;
    let high = finite().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b)).ceil() + 2.0;
    let [width, height] = photo.size.map(|n| n as f64);
    let outside = high.x <= 0.0 || high.y <= 0.0 || low.x >= width || low.y >= height;
    if outside || !(high - low).is_finite() {
        return;
    }
    // A cell larger than a page is shown coarser.
    let step = ((high - low).max_element() / MOST_PAGE).ceil().max(1.0);
    let size = ((high - low) / step)
        .ceil()
        .as_uvec2()
        .max(glam::UVec2::ONE);
    let plain = GROUND.map(|v| (255.0 * v.powf(1.0 / 2.2)) as u8);
    let mut rgba = Vec::with_capacity(4 * (size.x * size.y) as usize);
    for y in 0..size.y {
        for x in 0..size.x {
            let place = low + (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * step;
            let found = photo.at(place.x.floor() as i64, place.y.floor() as i64);
            rgba.extend(found.filter(|p| p[3] > 0).unwrap_or(plain));
        }
    }
    let extent = size.as_dvec2() * step;
    mesh.uv = pixels
        .iter()
        .map(|p| ((*p - low) / extent).as_vec2().into())
        .collect();
    mesh.look.texture = Some(Arc::new(Texture {
        size_px: size.into(),
        rgba,
    }));
    mesh.look.base_color = [1.0; 4];
    mesh.look.repeats = false;
}

/// Heights of the ground from rasters: what footprints stand on.
pub struct Ground {
    rasters: Vec<Heights>,
    /// What their reader took for granted.
    pub warnings: Vec<Warning>,
}

/// The words of an option that names the terrain's system, in place of the source's own.
fn of_terrain(text: &str) -> String {
    text.replace("--crs", "--terrain-crs")
        .replace("(crs of", "(terrain_crs of")
}

impl Ground {
    /// Reads a raster, or all of a folder.
    pub fn read(path: &Path, options: &Options) -> Result<Self, SourceError> {
        let (mut rasters, mut warnings) = (Vec::new(), Vec::new());
        for file in files(path)? {
            let mut notes = Notes::default();
            let raster = Heights::read(&file, options, &mut notes);
            rasters.push(raster.map_err(|error| {
                match error {
                    SourceError::Content { path, fault } => Fault {
                        what: of_terrain(&fault.what),
                        mend: of_terrain(&fault.mend),
                        ..fault
                    }
                    .of(&path),
                    other => other,
                }
            })?);
            warnings.extend(notes.warnings(&file).into_iter().map(|warning| Warning {
                mend: of_terrain(&warning.mend),
                ..warning
            }));
        }
        Ok(Self { rasters, warnings })
    }

    /// Height of the ground over the ellipsoid [m] at a place; `None` where no raster has one.
    pub fn height_m(&self, place: Geodetic) -> Option<f64> {
        let one = |raster: &Heights| {
            let at = |height_m: f64| {
                let r = raster.crs.horizontal(Geodetic { height_m, ..place }).ok()?;
                let h = raster.sample(r)?;
                Some(raster.crs.to_geodetic(r.extend(h)).ok()?.height_m)
            };
            // The verticals of two ellipsoids differ: the place on the map depends a little on the height.
            at(at(place.height_m)?)
        };
        self.rasters.iter().find_map(one)
    }
}

#[cfg(test)]
mod tests;
