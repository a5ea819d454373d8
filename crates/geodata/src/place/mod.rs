//! A real city from its files: a tileset opened, or raw data built into one, and surveyed for the physics.

mod cache;
mod dropped;
mod error;
mod location;

pub use error::PlaceError;

use self::dropped::Features;
use crate::tiles::content::Content;
use crate::tiles::fetch::resolve;
use crate::tiles::heights::{self, Heights};
use crate::tiles::settled;
use crate::tiles::tileset::Tileset;
use boresight_common::warning::Warning;
use boresight_models::ground::city::{City, CityParams, CitySource, GroundMap, RealCity};
use boresight_models::ground::lattice::REACH_M;
use boresight_models::ground::raster::GroundFilter;
use boresight_models::ground::survey::{Evidence, SurveyOptions, survey};
use boresight_models::maths::geodesy::SiteFrame;
use boresight_models::tiles::selection::fixed_cut;
use boresight_models::tiles::tree::TileId;
use glam::{DAffine3, DMat3, DVec3};
pub use location::located;
use std::path::Path;

/// Triangles that the physics of a place may have.
const MOST_TRIANGLES: usize = 12_000_000;
/// Error of the land around, in errors of the near part, and at least [m].
const FAR_FACTOR: f64 = 30.0;
const FAR_ERROR_M: f64 = 30.0;
/// [`Evidence::facing`] of a place that lies upside down.
const UPSIDE_DOWN: f64 = -0.3;
/// What is nearer to the Earth's middle than this stands in a frame of its own [m].
const EARTHLY_M: f64 = 6.0e6;

/// A real city, ready for a run.
#[derive(Clone, Debug)]
pub struct RealPlace {
    /// The city as physics sees it.
    pub city: City,
    /// Its tiles, as far as they were read.
    pub tileset: Tileset,
    /// Where they are.
    pub location: String,
    /// From the root frame of the tiles [m] to the site's east, north, up [m].
    pub enu_from_root: DAffine3,
    /// What it is, in words.
    pub summary: String,
    /// What the readers of its files took for granted or left out.
    pub warnings: Vec<Warning>,
}

/// What tells one real city from another: its parameters with paths seen from the working directory.
pub fn made_from(params: &CityParams, folder: &Path) -> CityParams {
    let mut own = params.clone();
    own.tileset = own.tileset.map(|path| located(folder, &path));
    own.georef = own.georef.map(|path| located(folder, &path));
    for source in own.sources.iter_mut().chain(&mut own.horizon) {
        let mut with = source.params();
        with.file = located(folder, &with.file);
        *source = CitySource::With(Box::new(with));
    }
    own
}

/// Overrides by which the scenario finds its real city wherever its text is read: a recording carries them.
pub fn found_anywhere(params: &CityParams, folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut add = |key: String, path: Option<&String>| {
        if let Some(path) = path {
            let at = located(folder, path);
            let whole = match at.contains("://") {
                true => at,
                false => std::path::absolute(&at)
                    .map_or(at, |whole| whole.to_string_lossy().into_owned()),
            };
            found.push(format!("{key}={}", toml::Value::String(whole)));
        }
    };
    add("city.tileset".into(), params.tileset.as_ref());
    add("city.georef".into(), params.georef.as_ref());
    let sources = params.sources.iter().enumerate();
    let sources = sources.map(|(index, source)| (format!("city.sources.{index}"), source));
    let horizon = params
        .horizon
        .iter()
        .map(|source| ("city.horizon".to_owned(), source));
    for (key, source) in sources.chain(horizon) {
        match source {
            CitySource::File(file) => add(key, Some(file)),
            CitySource::With(with) => {
                add(format!("{key}.file"), Some(&with.file));
                add(format!("{key}.georef"), with.georef.as_ref());
                add(format!("{key}.orthophoto"), with.orthophoto.as_ref());
                add(format!("{key}.terrain"), with.terrain.as_ref());
            }
        }
    }
    found
}

/// Reads the real city of some parameters, whose paths are relative to `folder`, about a site.
pub fn load(params: &CityParams, site: &SiteFrame, folder: &Path) -> Result<RealPlace, PlaceError> {
    let mut warnings = Vec::new();
    let location = match &params.tileset {
        Some(tileset) => located(folder, tileset),
        None => {
            let built = cache::tiles(params, site, folder)?;
            warnings.extend(built.warnings);
            built.folder.to_string_lossy().into_owned()
        }
    };
    let mut tileset = Tileset::open(&location).map_err(PlaceError::Tileset)?;
    let enu_from_root = placed(&tileset, params, site, folder)?;
    let heights = heights_beside(&location, &tileset, site)?;
    let mut terrain = None;
    if let Some(heights) = heights {
        let ground = heights.terrain.clone();
        if let Some(columns) = heights.columns() {
            let buildings = columns.buildings.len();
            let city = City::real(RealCity {
                dsm: columns.dsm,
                buildings: columns.buildings,
                roughness: columns.roughness,
                station_enu_m: columns.station_enu_m,
                ground_map: GroundMap {
                    size_px: 1,
                    extent_m: 1.0, // [m]
                    rgb: vec![[128; 3]],
                },
                around: Vec::new(),
                params: made_from(params, folder),
            });
            let summary =
                format!("{location}: {buildings} buildings, heights as it was built with");
            return Ok(RealPlace {
                city,
                tileset,
                location,
                enu_from_root,
                summary,
                warnings,
            });
        }
        terrain = ground;
    }
    let mut evidence = Evidence {
        terrain,
        ..Evidence::default()
    };
    let center_root_m = enu_from_root.inverse().transform_point3(DVec3::ZERO);
    let (radius_m, detail_m) = (params.radius_m(), params.detail_m());
    // A ball around the square, and what the site's height is off by.
    let reach_m = 1.6 * radius_m + 500.0; // [m]
    let near = settled::load(&mut tileset, &|tree| {
        fixed_cut(tree, center_root_m, reach_m, detail_m)
    });
    let near = near.map_err(PlaceError::Tileset)?;
    let tiles = near.len();
    let mut features = Features::default();
    for (number, (tile, content)) in near.iter().enumerate() {
        let to_enu = enu_from_root * tileset.tree.tile(*tile).to_root_m;
        add(content, to_enu, |mesh, placement| {
            evidence.add(mesh, |r| placement.transform_point3(r));
            features.add(number, (mesh, &content.features), |r| {
                placement.transform_point3(r)
            });
        });
        if evidence.triangles.len() > MOST_TRIANGLES {
            return Err(PlaceError::TooMany {
                most: MOST_TRIANGLES,
                detail_m,
                radius_m,
            });
        }
    }
    drop(near);
    evidence.far = far(
        &mut tileset,
        center_root_m,
        enu_from_root,
        [detail_m, reach_m],
    )?;
    if let Some(horizon) = &params.horizon {
        let (triangles, noted) = cache::horizon(horizon, site, folder)?;
        evidence.horizon = triangles;
        warnings.extend(noted);
    }
    let triangles = evidence.triangles.len();
    let upside_down = evidence.facing() < UPSIDE_DOWN;
    let options = SurveyOptions {
        radius_m,
        curved: is_earthly(&tileset) || params.georef.is_some(),
        filter: GroundFilter::default(),
    };
    let real = survey(evidence, made_from(params, folder), &options);
    let city = City::real(real.map_err(PlaceError::Survey)?);
    // Tiles that were built here lie where nobody looks: the first source names them.
    let named = match (params.sources.first(), &params.tileset) {
        (Some(source), None) => located(folder, &source.params().file),
        _ => location.clone(),
    };
    warnings.extend(features.dropped(&city, radius_m, Path::new(&named)));
    let surface = city.dsm.surface();
    let mut summary = format!(
        "{location}: {} tiles known, {tiles} surveyed at {detail_m} m ({triangles} triangles), {} m by {} m in cells \
         of {} m, {} buildings of {:.1} m on average",
        tileset.tree.tiles().len(),
        (surface.nx as f64 * surface.cell_m).round(),
        (surface.ny as f64 * surface.cell_m).round(),
        surface.cell_m,
        city.buildings.len(),
        city.roughness.mean_height_m,
    );
    if upside_down {
        summary += "; most of its triangles face down: is its up axis right (asset.gltfUpAxis, the root's transform)?";
    }
    Ok(RealPlace {
        city,
        tileset,
        location,
        enu_from_root,
        summary,
        warnings,
    })
}

/// Whether the tiles stand on the Earth.
fn is_earthly(tileset: &Tileset) -> bool {
    let root = tileset.tree.root();
    root.is_some_and(|root| tileset.tree.bounds(root).center_m.length() > EARTHLY_M)
}

/// From the tiles' root frame to the site's east, north, up.
fn placed(
    tileset: &Tileset,
    params: &CityParams,
    site: &SiteFrame,
    folder: &Path,
) -> Result<DAffine3, PlaceError> {
    let turned = DMat3::from_quat(site.q_ecef_enu().inverse());
    let enu_from_ecef =
        DAffine3::from_mat3_translation(turned, -(turned * site.origin().to_ecef()));
    if is_earthly(tileset) {
        return match (&params.georef, params.origin_enu_m) {
            (None, None) => Ok(enu_from_ecef),
            (Some(_), _) => Err(PlaceError::Placed("georef")),
            (None, Some(_)) => Err(PlaceError::Placed("origin_enu_m")),
        };
    }
    if let Some(georef) = &params.georef {
        let path = located(folder, georef);
        let placement = crate::sources::place::placement(Path::new(&path));
        return Ok(enu_from_ecef * placement.map_err(PlaceError::Georef)?.affine());
    }
    let origin = params.origin_enu_m.map_or(DVec3::ZERO, DVec3::from);
    Ok(DAffine3::from_translation(origin))
}

/// The heights that lie beside a tileset, if any do and they are the site's.
fn heights_beside(
    location: &str,
    tileset: &Tileset,
    site: &SiteFrame,
) -> Result<Option<Heights>, PlaceError> {
    let Some(file) = tileset.files().first() else {
        return Ok(None);
    };
    let Ok(beside) = resolve(&file.location, heights::FILE) else {
        return Ok(None);
    };
    // Most tilesets have none: that is no error.
    let Ok(bytes) = tileset.fetcher().read(&beside) else {
        return Ok(None);
    };
    match Heights::from_bytes(&bytes) {
        Ok(heights) => Ok(heights.is_of(site).then_some(heights)),
        Err(error) => Err(PlaceError::Heights(location.to_owned(), error)),
    }
}

/// Hands out the meshes of a content with the way of each into the site's frame.
fn add(
    content: &Content,
    to_enu: DAffine3,
    mut take: impl FnMut(&boresight_models::shape::textured::TexturedMesh, DAffine3),
) {
    for placed in &content.meshes {
        for placement in &placed.placements {
            take(&placed.mesh, to_enu * *placement);
        }
    }
}

/// Coarse triangles of the tiles beyond the surveyed square [m, ENU].
fn far(
    tileset: &mut Tileset,
    center_root_m: DVec3,
    enu_from_root: DAffine3,
    [detail_m, reach_m]: [f64; 2],
) -> Result<Vec<[DVec3; 3]>, PlaceError> {
    let Some(root) = tileset.tree.root() else {
        return Ok(Vec::new());
    };
    let bounds = tileset.tree.bounds(root);
    let farthest_m = bounds.center_m.distance(center_root_m) + bounds.half_m.length();
    if farthest_m <= reach_m {
        return Ok(Vec::new());
    }
    let error_m = (FAR_FACTOR * detail_m).max(FAR_ERROR_M);
    let coarse: Vec<(TileId, Content)> = settled::load(tileset, &|tree| {
        fixed_cut(tree, center_root_m, 1.5 * REACH_M, error_m)
    })
    .map_err(PlaceError::Tileset)?;
    let mut found = Vec::new();
    for (tile, content) in &coarse {
        let to_enu = enu_from_root * tileset.tree.tile(*tile).to_root_m;
        add(content, to_enu, |mesh, placement| {
            let sound = |triangle: &&[u32; 3]| {
                triangle
                    .iter()
                    .all(|i| (*i as usize) < mesh.positions.len())
            };
            let triangles = mesh.indices.as_chunks::<3>().0.iter().filter(sound);
            found
                .extend(triangles.map(|triangle| {
                    triangle.map(|i| placement.transform_point3(mesh.vertex_m(i)))
                }));
        });
        if found.len() > MOST_TRIANGLES {
            break;
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_models::ground::city::SourceParams;

    #[test]
    fn a_recording_finds_the_city_again() {
        let folder = Path::new("/data/town");
        let mut params = CityParams {
            tileset: Some("tiles/tileset.json".into()),
            ..CityParams::default()
        };
        let said = found_anywhere(&params, folder);
        assert_eq!(said, ["city.tileset=\"/data/town/tiles/tileset.json\""]);
        params.tileset = Some("https://example.org/tileset.json".into());
        let said = found_anywhere(&params, folder);
        assert_eq!(said, ["city.tileset=\"https://example.org/tileset.json\""]);
        let plain = CitySource::File("a.tif".into());
        let with = SourceParams {
            orthophoto: Some("/photos/b.tif".into()),
            ..plain.params()
        };
        let params = CityParams {
            sources: vec![plain, CitySource::With(Box::new(with))],
            ..CityParams::default()
        };
        let want = [
            "city.sources.0=\"/data/town/a.tif\"",
            "city.sources.1.file=\"/data/town/a.tif\"",
            "city.sources.1.orthophoto=\"/photos/b.tif\"",
        ];
        assert_eq!(found_anywhere(&params, folder), want);
        assert!(found_anywhere(&CityParams::default(), folder).is_empty());
    }
}
