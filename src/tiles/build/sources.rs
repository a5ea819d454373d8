//! Files of raw geodata as layers, by what their names end with.

use crate::sources::error::read_bytes;
use crate::sources::error::{Fault, SourceError};
use crate::sources::options::Options;
use crate::sources::{Layer, cityjson, footprints, geotiff, gltf, ifc, obj, ply};
use std::path::{Path, PathBuf};

/// What a file is, by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    CityJson,
    Footprints,
    Ifc,
    Raster,
    Gltf,
    Obj,
    Ply,
}

/// What a file is, by its name.
fn format(path: &Path) -> Result<Format, SourceError> {
    let name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let ends = |ends: &[&str]| ends.iter().any(|end| name.ends_with(end));
    let known = [
        (Format::Raster, &[".tif", ".tiff"][..]),
        (Format::Gltf, &[".glb", ".gltf"]),
        (Format::Obj, &[".obj"]),
        (Format::Ply, &[".ply"]),
        (Format::Ifc, &[".ifc"]),
        (Format::Footprints, &[".geojson", ".pbf"]),
        (Format::CityJson, &[".city.json", ".jsonl"]),
    ];
    if ends(&[".json"]) && !ends(&[".city.json"]) {
        // Either of two: a CityJSON says so near its beginning.
        let bytes = read_bytes(path)?;
        let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]);
        let city = head.contains("\"CityJSON");
        return Ok(if city {
            Format::CityJson
        } else {
            Format::Footprints
        });
    }
    let found = known.iter().find(|(_, names)| ends(names));
    found.map(|(format, _)| *format).ok_or_else(|| {
        let mend = "give .obj, .ply, .gltf, .glb, .city.json, .tif, .geojson, .osm.pbf, .ifc, or a scenario (.toml)";
        Fault::new("name", "it does not say what the file is", mend).of(path)
    })
}

/// All layers of some files, in one frame: that of the options, or the first file's.
///
/// A model without a system of its own is taken to stand about a site that the options name, never about another file's.
pub fn read(paths: &[PathBuf], options: &Options) -> Result<Vec<Layer>, SourceError> {
    let mut layers: Vec<Layer> = Vec::new();
    for path in paths {
        let format = format(path)?;
        let framed = Options {
            site: options.site.or(layers.first().map(|layer| layer.site)),
            ..options.clone()
        };
        match format {
            Format::CityJson => layers.extend(cityjson::read_all(path, &framed)?),
            Format::Footprints => layers.push(footprints::read(path, &framed)?),
            Format::Ifc => layers.push(ifc::read(path, &framed)?),
            Format::Raster => layers.push(geotiff::read(path, &framed)?),
            Format::Gltf => layers.push(gltf::read(path, options)?),
            Format::Obj => layers.push(obj::read(path, options)?),
            Format::Ply => layers.push(ply::read(path, options)?),
        }
    }
    Ok(layers)
}
