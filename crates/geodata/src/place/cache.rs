//! Raw data built into tiles once: a folder named after what they were built from.

use super::error::PlaceError;
use super::location::located;
use crate::build::ground::{terrain, triangles};
use crate::build::sources::read;
use crate::build::{BuildOptions, build};
use crate::sources::error::SourceError;
use crate::sources::geotiff;
use crate::sources::options::Options;
use crate::tiles::heights::Heights;
use boresight_common::warning::Warning;
use boresight_models::ground::city::{CityParams, CitySource};
use boresight_models::maths::geodesy::SiteFrame;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// Raised when the same sources make other tiles than before.
const FORMAT: &str = "boresight city 3";
/// Most triangles that all sources together may have.
const MOST_TRIANGLES: usize = 30_000_000;

/// Name of the file beside the tiles with what the readers warned of.
const WARNINGS: &str = "warnings.json";

/// Sources built into tiles.
pub(super) struct Built {
    /// The folder with the tiles.
    pub(super) folder: PathBuf,
    /// What the readers took for granted or left out.
    pub(super) warnings: Vec<Warning>,
}

/// The tiles of a scenario's sources, built where they are not there yet; what was built before warns again.
pub(super) fn tiles(
    params: &CityParams,
    site: &SiteFrame,
    folder: &Path,
) -> Result<Built, PlaceError> {
    let sources: Vec<(PathBuf, Options)> = (params.sources.iter())
        .map(|source| with_options(source, site, folder))
        .collect();
    let place = cities_folder().join(format!("{:032x}", key(&sources, site)?));
    if place.join("tileset.json").is_file() {
        return Ok(Built {
            warnings: kept_warnings(&place, &sources),
            folder: place,
        });
    }
    let mut layers = Vec::new();
    for (path, options) in &sources {
        layers.extend(read(path, options).map_err(PlaceError::Source)?);
    }
    let triangles: usize = (layers.iter().flat_map(|layer| &layer.meshes))
        .map(|mesh| mesh.triangle_count())
        .sum();
    if triangles > MOST_TRIANGLES {
        return Err(PlaceError::TooLarge {
            triangles,
            most: MOST_TRIANGLES,
        });
    }
    // Built aside, so that a build that was broken off is never taken for a whole one.
    let aside = place.with_extension(format!("part{}", std::process::id()));
    let failed = |source| PlaceError::Cache {
        folder: place.clone(),
        source,
    };
    std::fs::create_dir_all(&aside).map_err(failed)?;
    build(&layers, &BuildOptions::default(), &aside).map_err(PlaceError::Build)?;
    let terrain = terrain(&layers, site);
    let heights = Heights::of_terrain(terrain, site).write(&aside);
    heights.map_err(|error| PlaceError::Heights(aside.display().to_string(), error))?;
    let warnings: Vec<Warning> = (layers.into_iter())
        .flat_map(|layer| layer.warnings)
        .collect();
    keep_warnings(&aside, &sources, &warnings).map_err(failed)?;
    if let Err(error) = std::fs::rename(&aside, &place) {
        // Another run may have been first.
        let _ = std::fs::remove_dir_all(&aside);
        if !place.join("tileset.json").is_file() {
            return Err(failed(error));
        }
    }
    Ok(Built {
        folder: place,
        warnings,
    })
}

/// The files of some sources, each with those that it names beside it, in order.
fn files(sources: &[(PathBuf, Options)]) -> impl Iterator<Item = &Path> {
    sources.iter().flat_map(|(path, options)| {
        let beside = [&options.georef, &options.orthophoto, &options.terrain];
        std::iter::once(path.as_path()).chain(beside.into_iter().flatten().map(PathBuf::as_path))
    })
}

/// A warning beside tiles: the number of the file that it is about stands for the file, which may lie elsewhere the next time.
#[derive(Serialize, Deserialize)]
struct Kept {
    number: Option<usize>,
    warning: Warning,
}

/// Writes what the readers warned of beside the tiles.
fn keep_warnings(
    place: &Path,
    sources: &[(PathBuf, Options)],
    warnings: &[Warning],
) -> std::io::Result<()> {
    let kept = warnings.iter().map(|warning| {
        let mut warning = warning.clone();
        // Of a raster in a folder, what follows the folder's name.
        let number = files(sources).position(|file| warning.file.starts_with(file));
        let inside = (number.and_then(|number| files(sources).nth(number)))
            .and_then(|file| Some(warning.file.strip_prefix(file).ok()?.to_path_buf()));
        if let Some(inside) = inside {
            warning.file = inside;
        }
        Kept { number, warning }
    });
    let kept: Vec<Kept> = kept.collect();
    std::fs::write(place.join(WARNINGS), serde_json::to_string_pretty(&kept)?)
}

/// What the readers warned of when the tiles were built, of the files where they lie now.
fn kept_warnings(place: &Path, sources: &[(PathBuf, Options)]) -> Vec<Warning> {
    let text = std::fs::read(place.join(WARNINGS)).unwrap_or_default();
    let kept: Vec<Kept> = serde_json::from_slice(&text).unwrap_or_default();
    let again = |Kept { number, warning }| {
        let file = number.and_then(|number| files(sources).nth(number));
        let file = match file {
            // Joined to nothing, a path would end with a slash.
            Some(file) if warning.file.as_os_str().is_empty() => file.to_path_buf(),
            Some(file) => file.join(&warning.file),
            None => warning.file.clone(),
        };
        Warning { file, ..warning }
    };
    kept.into_iter().map(again).collect()
}

/// Where built cities are kept: `BORESIGHT_CACHE`, or the user's cache folder.
fn cities_folder() -> PathBuf {
    let named = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let home = || named("HOME").map(|home| Path::new(&home).join(".cache"));
    let own = named("BORESIGHT_CACHE").map(PathBuf::from);
    let user = || named("XDG_CACHE_HOME").map(PathBuf::from).or_else(home);
    own.or_else(|| user().map(|cache| cache.join("boresight")))
        .unwrap_or_else(|| std::env::temp_dir().join("boresight"))
        .join("cities")
}

/// A source with what its reader is told beside it.
pub(super) fn with_options(
    source: &CitySource,
    site: &SiteFrame,
    folder: &Path,
) -> (PathBuf, Options) {
    let params = source.params();
    let at = |path: String| PathBuf::from(located(folder, &path));
    let options = Options {
        crs: params.crs,
        geoid_height_m: params.geoid_height_m,
        georef: params.georef.map(at),
        site: Some(*site),
        orthophoto: params.orthophoto.map(at),
        terrain: params.terrain.map(at),
        terrain_crs: params.terrain_crs,
        base_height_m: params.base_height_m.unwrap_or_default(),
        building_height_m: params.building_height_m,
        lod: params.lod,
        mesh_unit: params.mesh_unit,
        mesh_up: params.mesh_up,
    };
    (at(params.file), options)
}

/// What the tiles depend on, as a number: the contents of all files, and all that is said beside them.
fn key(sources: &[(PathBuf, Options)], site: &SiteFrame) -> Result<u128, PlaceError> {
    let mut hash = Xxh3::new();
    hash.update(FORMAT.as_bytes());
    hash.update(boresight_common::VERSION.as_bytes());
    let origin = site.origin();
    for value in [origin.latitude_rad, origin.longitude_rad, origin.height_m] {
        hash.update(&value.to_bits().to_le_bytes());
    }
    for source in sources {
        let (_, options) = source;
        let words = [
            options.crs.as_deref().unwrap_or_default(),
            options.lod.as_deref().unwrap_or_default(),
            options.terrain_crs.as_deref().unwrap_or_default(),
            options.mesh_unit.as_deref().unwrap_or_default(),
            options.mesh_up.map_or("", |axis| axis.letter()),
        ];
        for word in words {
            hash.update(word.as_bytes());
            hash.update(&[0]);
        }
        let numbers = [
            options.geoid_height_m.unwrap_or(f64::NAN),
            options.base_height_m,
            options.building_height_m.unwrap_or(f64::NAN),
        ];
        for number in numbers {
            hash.update(&number.to_bits().to_le_bytes());
        }
        for path in files(std::slice::from_ref(source)) {
            add_file(&mut hash, path)?;
        }
    }
    Ok(hash.digest128())
}

/// Adds a file, or the files of a folder, to a hash.
fn add_file(hash: &mut Xxh3, path: &Path) -> Result<(), PlaceError> {
    let failed = |source| {
        PlaceError::Source(SourceError::Read {
            path: path.into(),
            source,
        })
    };
    let name = path.file_name().unwrap_or_default();
    hash.update(name.as_encoded_bytes());
    if path.is_dir() {
        let entries = std::fs::read_dir(path).map_err(failed)?;
        let mut inside: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .collect();
        inside.sort();
        for file in inside.iter().filter(|file| file.is_file()) {
            add_file(hash, file)?;
        }
        return Ok(());
    }
    let mut file = std::fs::File::open(path).map_err(failed)?;
    let mut block = vec![0; 1 << 20];
    loop {
        let count = std::io::Read::read(&mut file, &mut block).map_err(failed)?;
        if count == 0 {
            return Ok(());
        }
        hash.update(&block[..count]);
    }
}

/// The triangles of a height raster of the land around [m, ENU], and what its reader warns of.
pub(super) fn horizon(
    source: &CitySource,
    site: &SiteFrame,
    folder: &Path,
) -> Result<(Vec<[DVec3; 3]>, Vec<Warning>), PlaceError> {
    let (path, options) = with_options(source, site, folder);
    let layer = geotiff::read(&path, &options).map_err(PlaceError::Horizon)?;
    Ok((triangles(&layer, site), layer.warnings))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_built_before_warns_again_of_the_files_where_they_lie_now() {
        let place = tempfile::tempdir().unwrap();
        let options = |terrain: &str| Options {
            terrain: Some(terrain.into()),
            ..Options::default()
        };
        let before = [("/a/town.geojson".into(), options("/a/heights"))];
        let now = [("/b/town.geojson".into(), options("/b/heights"))];
        let warning = |file: &str| Warning {
            file: file.into(),
            place: "heights".into(),
            what: "over the geoid".into(),
            mend: "say it".into(),
        };
        let files = |at: &str| {
            ["town.geojson", "heights/1.tif", "heights"]
                .map(|name| warning(&format!("/{at}/{name}")))
        };
        let mut noted = files("a").to_vec();
        noted.push(warning("elsewhere"));
        keep_warnings(place.path(), &before, &noted).unwrap();
        let mut want = files("b").to_vec();
        want.push(warning("elsewhere"));
        assert_eq!(kept_warnings(place.path(), &now), want);
        let none = tempfile::tempdir().unwrap();
        assert!(kept_warnings(none.path(), &now).is_empty());
    }
}
