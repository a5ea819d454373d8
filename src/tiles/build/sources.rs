//! Files of raw geodata as layers, by what their names end with.

use crate::sources::error::{Fault, SourceError, read_bytes};
use crate::sources::options::Options;
use crate::sources::{Layer, cityjson, footprints, geotiff, gltf, ifc, obj, ply};
use std::path::{Path, PathBuf};

/// What names of files with outlines of buildings end with; the last four are refused by name.
const OUTLINES: [&str; 10] = [
    ".geojson",
    ".geojsonl",
    ".geojsons",
    ".geojsonseq",
    ".ndjson",
    ".pbf",
    ".osm",
    ".osm.gz",
    ".osm.bz2",
    ".o5m",
];

/// The layers of a file, by its name's end; of a folder: the height raster that its files are parts of.
pub fn read(path: &Path, options: &Options) -> Result<Vec<Layer>, SourceError> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let ends = |ends: &[&str]| ends.iter().any(|end| name.ends_with(end));
    let one = |layer: Result<Layer, SourceError>| layer.map(|layer| vec![layer]);
    if path.is_dir() || ends(&[".tif", ".tiff"]) {
        one(geotiff::read(path, options))
    } else if ends(&[".city.json", ".city.jsonl", ".cityjson"]) {
        cityjson::read_all(path, options)
    } else if ends(&OUTLINES) {
        one(footprints::read(path, options))
    } else if ends(&[".json", ".jsonl"]) {
        // Either of two.
        match footprints::is_geojson(&read_bytes(path)?) {
            true => one(footprints::read(path, options)),
            false => cityjson::read_all(path, options),
        }
    } else if ends(&[".ifc", ".ifczip", ".ifcxml"]) {
        one(ifc::read(path, options))
    } else if ends(&[".obj"]) {
        one(obj::read(path, options))
    } else if ends(&[".gltf", ".glb"]) {
        one(gltf::read(path, options))
    } else if ends(&[".ply"]) {
        one(ply::read(path, options))
    } else {
        let what = "its name does not say what it is";
        let mend = "name CityJSON (.city.json), GeoTIFF (.tif, or a folder of them), GeoJSON (.geojson, .geojsonl), \
                    OpenStreetMap (.osm.pbf), .ifc, .obj, .gltf, .glb or .ply";
        Err(Fault::new("name", what, mend).of(path))
    }
}

/// All layers of some files, in one frame: that of the options, or the first file's.
///
/// A mesh without a system of its own is taken to stand about a site that the options name, never about another file's.
pub fn read_all(paths: &[PathBuf], options: &Options) -> Result<Vec<Layer>, SourceError> {
    let mut layers: Vec<Layer> = Vec::new();
    for path in paths {
        let placed = options.crs.is_some() || options.georef.is_some();
        let end = path
            .extension()
            .unwrap_or_default()
            .to_string_lossy()
            .to_lowercase();
        let mesh = ["obj", "ply", "gltf", "glb"].contains(&end.as_str());
        let first = layers.first().map(|layer| layer.site);
        let framed = Options {
            site: options.site.or(first.filter(|_| placed || !mesh)),
            ..options.clone()
        };
        layers.extend(read(path, &framed)?);
    }
    Ok(layers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_and_footprints_of_several_files_come_into_one_frame() {
        let folder = tempfile::tempdir().unwrap();
        let obj = folder.path().join("wall.obj");
        let text = "mtllib wall.mtl\nv 500000.5 0 0\nv 500010.5 0 0\nv 500000.5 0 5\nvt 0 0\nvt 1 0\nvt 0 1\n\
                    usemtl wall\nf 1/1 2/2 3/3\n";
        std::fs::write(&obj, text).unwrap();
        std::fs::write(
            folder.path().join("wall.mtl"),
            "newmtl wall\nmap_Kd wall.png\n",
        )
        .unwrap();
        let options = Options {
            crs: Some("EPSG:32632".into()),
            ..Options::default()
        };
        let missing = read(&obj, &options).unwrap().remove(0);
        assert!(missing.meshes[0].look.texture.is_none());
        assert!(
            missing
                .warnings
                .iter()
                .any(|warning| warning.what.contains("wall.png")),
            "{:?}",
            missing.warnings
        );
        let picture = image::RgbImage::from_fn(4, 4, |x, _| image::Rgb([60 * x as u8, 0, 0]));
        picture.save(folder.path().join("wall.png")).unwrap();
        let ply = folder.path().join("roof.ply");
        let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
                    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                    property list uchar int vertex_indices\nend_header\n500000.5 0 5 255 0 0\n500010.5 0 5 255 0 0\n\
                    500000.5 10 5 0 0 255\n3 0 1 2\n";
        std::fs::write(&ply, text).unwrap();
        let layers = read_all(&[obj.clone(), ply.clone()], &options).unwrap();
        // On the equator and the central meridian the projection shrinks by 0.9996.
        let [wall, roof] = [0, 1].map(|k| &layers[k].meshes[0]);
        let length_m = wall.vertex_m(0).distance(wall.vertex_m(1));
        assert!((length_m - 10.0 / 0.9996).abs() < 1e-3, "{length_m}");
        assert!(wall.look.unlit && wall.look.texture.is_some() && wall.uv[0] == [0.0, 1.0]);
        assert!(roof.look.unlit && roof.colors[0][0] == 1.0 && roof.colors[2][2] == 1.0);
        // The corner that they share, in the frame of both.
        assert!(roof.vertex_m(0).distance(wall.vertex_m(2)) < 1e-3);
        let lost = read(&ply, &Options::default()).unwrap_err().to_string();
        assert!(
            lost.contains("--crs") && lost.contains("roof.ply"),
            "{lost}"
        );
        for (name, text) in [
            ("a.obj", "f 1 2 9\n"),
            ("a.ply", "ply\n"),
            ("a.glb", "glTF"),
            ("a.xyz", ""),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            assert!(
                read(&path, &options)
                    .unwrap_err()
                    .to_string()
                    .contains(name)
            );
        }
    }
}
