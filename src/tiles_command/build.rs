//! `boresight tiles build`.

use crate::models::ground::city::City;
use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use crate::models::shape::textured::UpAxis;
use crate::output::{columns, counted};
use crate::scenario::{InputError, Scenario};
use crate::sources::Layer;
use crate::sources::error::SourceError;
use crate::sources::options::Options;
use crate::tiles::heights::{Heights, HeightsError};
use crate::warning::{self, StrictError, Warning};
use boresight_geodata::build::options::{BuildOptions, Division, Pictures};
use boresight_geodata::build::report::{BuildError, BuildReport, LevelReport};
use boresight_geodata::build::{build_with, city, ground::terrain, sources};
use std::fmt::Write as _;
use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What is built, and how.
#[derive(clap::Args, Clone, Debug)]
pub struct Arguments {
    /// Files: OBJ, PLY, glTF or GLB meshes, CityJSON, GeoTIFF height rasters, footprints (GeoJSON, OSM), IFC; or one scenario (TOML) for its generated
    /// city. Several become one tileset.
    #[arg(required = true)]
    sources: Vec<PathBuf>,
    /// Folder for tileset.json and its contents.
    #[arg(long)]
    out: PathBuf,
    /// Cells are cut into four on the map, or into eight.
    #[arg(long = "tree", value_enum, default_value_t)]
    division: Division,
    /// The most triangles of a tile that is cut no further.
    #[arg(long, default_value_t = BuildOptions::default().max_triangles)]
    max_triangles: usize,
    /// The widest texture of a tile [px].
    #[arg(long, default_value_t = BuildOptions::default().max_texture_px)]
    texture_px: u32,
    /// Share of its children's triangles that a tile keeps.
    #[arg(long, default_value_t = BuildOptions::default().keep)]
    keep: f64,
    /// Write a rule and subtrees (implicit tiling) instead of every tile.
    #[arg(long)]
    implicit: bool,
    /// Compress vertices and indices (EXT_meshopt_compression).
    #[arg(long)]
    meshopt: bool,
    /// How textures are stored.
    #[arg(long, value_enum, default_value_t)]
    pictures: Pictures,
    /// Worker threads (default: all cores); changes no result.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    /// The sources' coordinate reference system, such as EPSG:2056, where they name none or a wrong one.
    #[arg(long)]
    crs: Option<String>,
    /// File of parameters that place a local model, as `boresight georef` writes it.
    #[arg(long)]
    georef: Option<PathBuf>,
    /// Origin of the tiles' east, north and up: latitude and longitude [deg] and height above the ellipsoid [m]. A mesh
    /// without --crs and --georef is taken to be east, north and up of it.
    #[arg(long, value_name = "LAT,LON,HEIGHT", value_parser = site, allow_hyphen_values = true)]
    site: Option<SiteFrame>,
    /// Height of the geoid over the ellipsoid [m], in place of EGM96's.
    #[arg(long, allow_hyphen_values = true)]
    geoid_height: Option<f64>,
    /// A picture from above for height rasters: a GeoTIFF, or a JPEG or PNG with a world file.
    #[arg(long)]
    orthophoto: Option<PathBuf>,
    /// A height raster that footprints stand on.
    #[arg(long)]
    terrain: Option<PathBuf>,
    /// The terrain's coordinate reference system, where its file names none or a wrong one.
    #[arg(long)]
    terrain_crs: Option<String>,
    /// Height of the ground under footprints without terrain [m].
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    base_height: f64,
    /// Height of a building whose source gives none [m].
    #[arg(long)]
    building_height: Option<f64>,
    /// Level of detail of a city model, such as 2.2 (default: the finest of each object).
    #[arg(long)]
    lod: Option<String>,
    /// Unit of an OBJ's or PLY's coordinates, such as mm or ft (default: metres, or that of --crs).
    #[arg(long, value_name = "UNIT")]
    mesh_unit: Option<String>,
    /// Axis of an OBJ or PLY that points up: x, y or z (default: z).
    #[arg(long, value_name = "AXIS")]
    mesh_up: Option<UpAxis>,
}

/// Why the command cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// A source.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The tiles.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// A scenario.
    #[error(transparent)]
    Scenario(#[from] InputError),
    /// The heights beside the tiles.
    #[error(transparent)]
    Heights(#[from] HeightsError),
    /// Warnings where they are errors.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// A scenario whose city is there already.
    #[error("{}: its city is a real one, which a run builds by itself; give a scenario with a generated city", .0.display())]
    Real(PathBuf),
    /// A scenario among other sources.
    #[error("{}: a scenario's city is built alone; give one source", .0.display())]
    Together(PathBuf),
}

/// A site from three numbers.
fn site(text: &str) -> Result<SiteFrame, String> {
    let wanted = "expected latitude, longitude [deg] and height [m], such as 47.37,8.54,450";
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|x| x.trim().parse()).collect();
    let numbers = numbers.map_err(|_| wanted.to_owned())?;
    let &[latitude_deg, longitude_deg, height_m] = numbers.as_slice() else {
        return Err(wanted.into());
    };
    let on_earth = latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 360.0;
    if !(on_earth && height_m.abs() < 1e5) {
        return Err(wanted.into());
    }
    Ok(SiteFrame::new(Geodetic {
        latitude_rad: latitude_deg.to_radians(),
        longitude_rad: longitude_deg.to_radians(),
        height_m,
    }))
}

impl Arguments {
    fn build_options(&self) -> BuildOptions {
        BuildOptions {
            division: self.division,
            max_triangles: self.max_triangles,
            max_texture_px: self.texture_px,
            keep: self.keep,
            implicit: self.implicit,
            meshopt: self.meshopt,
            pictures: self.pictures,
            threads: self.threads,
        }
    }

    fn source_options(&self) -> Options {
        Options {
            crs: self.crs.clone(),
            geoid_height_m: self.geoid_height,
            georef: self.georef.clone(),
            site: self.site,
            orthophoto: self.orthophoto.clone(),
            terrain: self.terrain.clone(),
            terrain_crs: self.terrain_crs.clone(),
            base_height_m: self.base_height,
            building_height_m: self.building_height,
            lod: self.lod.clone(),
            mesh_unit: self.mesh_unit.clone(),
            mesh_up: self.mesh_up,
        }
    }
}

/// Carries the command out: what it says.
pub fn run(arguments: &Arguments) -> Result<String, CommandError> {
    let say = |text: &str| {
        let _ = writeln!(std::io::stderr(), "{text}");
    };
    let begun = Instant::now();
    let scenario = |path: &&PathBuf| path.extension().is_some_and(|end| end == "toml");
    let (layers, heights) = match arguments.sources.iter().find(scenario) {
        Some(path) if arguments.sources.len() > 1 => {
            return Err(CommandError::Together(path.clone()));
        }
        Some(path) => generated(path)?,
        None => {
            let layers = sources::read_all(&arguments.sources, &arguments.source_options())?;
            let site = layers.first().map(|layer| layer.site);
            let heights = site.map(|site| Heights::of_terrain(terrain(&layers, &site), &site));
            (layers, heights)
        }
    };
    let warnings: Vec<Warning> = (layers.iter())
        .flat_map(|layer| layer.warnings.clone())
        .collect();
    warning::tell(&warnings)?;
    let read_s = begun.elapsed().as_secs_f64();
    say(&format!(
        "{} read in {read_s:.1} s",
        counted(layers.len(), "layer")
    ));
    let report = build_with(&layers, &arguments.build_options(), &arguments.out, say)?;
    if let Some(heights) = heights {
        heights.write(&arguments.out)?;
    }
    let seconds = begun.elapsed().as_secs_f64();
    Ok(words(&report, &arguments.out, seconds))
}

/// The layers of a scenario's generated city, its ground in the shadows of the scenario's sun.
fn generated(path: &Path) -> Result<(Vec<Layer>, Option<Heights>), CommandError> {
    let loaded = Scenario::load(path, &[])?;
    let scenario = &loaded.scenario;
    if scenario.city.is_real() {
        return Err(CommandError::Real(path.into()));
    }
    let site = scenario.site.frame();
    let (_, _, sun) = loaded.weather_and_sun()?;
    let mut city = City::generate(&scenario.city).map_err(|error| loaded.refuse("city", error))?;
    city.bake_shadows(sun.sun_dir_enu());
    Ok((
        city::layers(&city, &site),
        Some(Heights::of_city(&city, &site)),
    ))
}

/// The report in words.
fn words(report: &BuildReport, out: &Path, seconds: f64) -> String {
    let mut text = String::new();
    let mega = |bytes: u64| bytes as f64 / 1e6;
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "{}: {} tiles on {} levels, {} triangles of {}, {:.1} MB, {} features, {seconds:.1} s",
        out.join("tileset.json").display(),
        report.tiles(),
        report.levels.len(),
        report.triangles_out,
        report.triangles_in,
        mega(report.bytes),
        report.features,
    );
    const HEAD: [&str; 6] = [
        "level",
        "tiles",
        "triangles",
        "kept of children",
        "error [m]",
        "MB",
    ];
    let row = |(level, state): (usize, &LevelReport)| {
        let kept = match state.share {
            share if share > 0.0 => format!("{:.1} %", 100.0 * share),
            _ => "-".into(),
        };
        vec![
            level.to_string(),
            state.tiles.to_string(),
            state.triangles.to_string(),
            kept,
            format!("{:.3}", state.error_m),
            format!("{:.1}", mega(state.bytes)),
        ]
    };
    let rows: Vec<_> = report.levels.iter().enumerate().map(row).collect();
    text += &columns(&HEAD, &rows, 0);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_site_is_three_numbers() {
        let origin = site("47.5, -8.25,400").unwrap().origin();
        assert!((origin.latitude_rad.to_degrees() - 47.5).abs() < 1e-12);
        assert!((origin.longitude_rad.to_degrees() + 8.25).abs() < 1e-12);
        assert!((origin.height_m - 400.0).abs() < 1e-12);
        for wrong in ["", "1,2", "1,2,3,4", "95,0,0", "a,b,c", "nan,0,0"] {
            assert!(site(wrong).unwrap_err().contains("47.37"), "{wrong}");
        }
    }
}
