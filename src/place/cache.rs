//! Raw data built into tiles once: a folder named after what they were built from.

use super::error::PlaceError;
use super::location::located;
use crate::models::ground::city::{CityParams, CitySource};
use crate::models::maths::geodesy::SiteFrame;
use crate::sources::error::SourceError;
use crate::sources::geotiff;
use crate::sources::options::Options;
use crate::tiles::build::ground::{terrain, triangles};
use crate::tiles::build::sources::read;
use crate::tiles::build::{BuildOptions, build};
use crate::tiles::heights::Heights;
use glam::DVec3;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// Raised when the same sources make other tiles than before.
const FORMAT: &str = "boresight city 2";
/// Most triangles that all sources together may have.
const MOST_TRIANGLES: usize = 30_000_000;

/// The folder with the tiles of a scenario's sources, built where it is not there yet.
pub(super) fn tiles(
    params: &CityParams,
    site: &SiteFrame,
    folder: &Path,
) -> Result<PathBuf, PlaceError> {
    let sources: Vec<(PathBuf, Options)> = (params.sources.iter())
        .map(|source| with_options(source, site, folder))
        .collect();
    let place = cities_folder().join(format!("{:032x}", key(&sources, site)?));
    if place.join("tileset.json").is_file() {
        return Ok(place);
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
    if let Err(error) = std::fs::rename(&aside, &place) {
        // Another run may have been first.
        let _ = std::fs::remove_dir_all(&aside);
        if !place.join("tileset.json").is_file() {
            return Err(failed(error));
        }
    }
    Ok(place)
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
    };
    (at(params.file), options)
}

/// What the tiles depend on, as a number: the contents of all files, and all that is said beside them.
fn key(sources: &[(PathBuf, Options)], site: &SiteFrame) -> Result<u128, PlaceError> {
    let mut hash = Xxh3::new();
    hash.update(FORMAT.as_bytes());
    hash.update(crate::VERSION.as_bytes());
    let origin = site.origin();
    for value in [origin.latitude_rad, origin.longitude_rad, origin.height_m] {
        hash.update(&value.to_bits().to_le_bytes());
    }
    for (path, options) in sources {
        let words = [
            options.crs.as_deref().unwrap_or_default(),
            options.lod.as_deref().unwrap_or_default(),
            options.terrain_crs.as_deref().unwrap_or_default(),
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
        let beside = [&options.georef, &options.orthophoto, &options.terrain];
        for path in std::iter::once(path).chain(beside.into_iter().flatten()) {
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

/// The triangles of a height raster of the land around [m, ENU].
pub(super) fn horizon(
    source: &CitySource,
    site: &SiteFrame,
    folder: &Path,
) -> Result<Vec<[DVec3; 3]>, PlaceError> {
    let (path, options) = with_options(source, site, folder);
    let layer = geotiff::read(&path, &options).map_err(PlaceError::Horizon)?;
    Ok(triangles(&layer, site))
}
