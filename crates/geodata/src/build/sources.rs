//! Files of raw geodata as layers, by what their names end with.

use super::mesh::FARTHEST_M;
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
///
/// Fails where the file cannot be read, or an option says what its kind states itself.
pub fn read(path: &Path, options: &Options) -> Result<Vec<Layer>, SourceError> {
    refuse_idle(std::slice::from_ref(&path), options)?;
    read_near(path, options)
}

/// The layers of a file, none of which lies farther from its site than tiles reach.
fn read_near(path: &Path, options: &Options) -> Result<Vec<Layer>, SourceError> {
    let layers = read_one(path, options)?;
    let meshes = layers.iter().flat_map(|layer| &layer.meshes);
    let far_m = (meshes.flat_map(|mesh| mesh.indices.iter().map(|k| mesh.vertex_m(*k).length())))
        .fold(0.0, f64::max);
    if far_m > FARTHEST_M {
        let what = format!(
            "they reach {:.0} km from the site, where {:.0} km is the most",
            1e-3 * far_m,
            1e-3 * FARTHEST_M
        );
        let mend = "check their system (--crs), their placement (--georef) and the site";
        return Err(Fault::new("coordinates", what, mend).of(path));
    }
    Ok(layers)
}

/// Refuses a unit or an axis for meshes where none of the files is one that states neither.
fn refuse_idle(paths: &[impl AsRef<Path>], options: &Options) -> Result<(), SourceError> {
    let takes = |path: &Path| {
        let end = path.extension().unwrap_or_default().to_ascii_lowercase();
        end == "obj" || end == "ply"
    };
    let said = [
        (options.mesh_unit.is_some(), "mesh_unit"),
        (options.mesh_up.is_some(), "mesh_up"),
    ];
    let idle = said.iter().find(|(said, _)| *said);
    match (idle, paths.first()) {
        (Some((_, key)), Some(path)) if !paths.iter().any(|path| takes(path.as_ref())) => {
            let what = "only OBJ and PLY leave their unit and axes open";
            Err(Fault::new(key, what, "leave it out").of(path.as_ref()))
        }
        _ => Ok(()),
    }
}

fn read_one(path: &Path, options: &Options) -> Result<Vec<Layer>, SourceError> {
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
    refuse_idle(paths, options)?;
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
        layers.extend(read_near(path, &framed)?);
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
        let unit = Options {
            mesh_unit: Some("mm".into()),
            ..Options::default()
        };
        let idle = read(Path::new("a.glb"), &unit).unwrap_err().to_string();
        assert!(
            idle.starts_with("a.glb: mesh_unit: only OBJ and PLY"),
            "{idle}"
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
