//! What the readers of meshes share: pictures beside the file, and the place of a mesh on the Earth.

use super::error::{Fault, SourceError, read_bytes};
use super::options::Options;
use super::place::{Place, site};
use super::surfaces::{Corner, triangulate};
use super::unit;
use super::{Layer, LayerKind};
use boresight_common::jpeg::is_cut_off;
use boresight_common::warning::Notes;
use boresight_models::shape::textured::{Texture, TexturedMesh, UpAxis};
use earcut::Earcut;
use glam::{DMat3, DVec3, Vec3};
use std::path::Path;
use std::sync::Arc;

/// Longest side of a picture [px].
const MAX_SIDE_PX: u32 = 32_768;
/// Most memory that a picture may take [B].
const MAX_PICTURE_BYTES: u64 = 4 << 30;
/// Half the distance over which the axes of a source's frame are compared with the site's [m].
const REACH_M: f64 = 1.0;

/// A picture file beside a mesh.
pub(super) fn picture(path: &Path) -> Result<Arc<Texture>, SourceError> {
    let bytes = read_bytes(path)?;
    let mend = "give it as PNG, JPEG or WebP";
    let fault = |what: String| Fault::new("picture", what, mend).of(path);
    if is_cut_off(&bytes) {
        return Err(fault("the JPEG is cut off".into()));
    }
    let mut reader = image::ImageReader::new(std::io::Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(|error| fault(error.to_string()))?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE_PX);
    limits.max_image_height = Some(MAX_SIDE_PX);
    limits.max_alloc = Some(MAX_PICTURE_BYTES);
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| fault(error.to_string()))?;
    let picture = picture.into_rgba8();
    Ok(Arc::new(Texture {
        size_px: [picture.width(), picture.height()],
        rgba: picture.into_raw(),
    }))
}

/// The triangles of a face, by the numbers of its corners; none where it has no area. Three corners are taken as they are.
pub(super) fn triangles(face: &[DVec3], scratch: &mut Earcut<f64>) -> Vec<[usize; 3]> {
    match face.len() {
        3 => vec![[0, 1, 2]],
        _ => triangulate(&[face.iter().copied().map(Corner::from).collect()], scratch),
    }
}

/// Linear light of an sRGB value of 0..1 (IEC 61966-2-1).
pub(super) fn linear(srgb: f32) -> f32 {
    if srgb <= 0.04045 {
        srgb / 12.92
    } else {
        ((srgb + 0.055) / 1.055).powf(2.4)
    }
}

/// Meshes of a source, in its own coordinates, as a layer on the Earth: through the system or the parameters that the
/// options name; with only a site named they are east, north and up of it. The notes become the layer's warnings.
pub(super) fn placed(
    meshes: Vec<TexturedMesh>,
    options: &Options,
    path: &Path,
    mut notes: Notes,
) -> Result<Layer, SourceError> {
    let used =
        || (meshes.iter()).flat_map(|mesh| mesh.indices.iter().map(move |&i| mesh.vertex_m(i)));
    if used().next().is_none() || !used().all(|r| r.is_finite()) {
        let what = match used().next() {
            None => "no triangles",
            Some(_) => "a coordinate that is no number",
        };
        return Err(Fault::new("mesh", what, "export the surface again").of(path));
    }
    let local = options.crs.is_none() && options.georef.is_none();
    let (site, meshes) = match options.site.filter(|_| local) {
        Some(site) => (site, meshes),
        None => {
            let place = Place::of(options, None, path)?;
            place.note(&mut notes);
            let bounds = place.bounds(used());
            let site = site(options, &place, bounds).map_err(|fault| fault.of(path))?;
            let enu_m = |r: DVec3| Ok(site.ecef_to_enu(place.ecef_m(r)?));
            let moved: Result<Vec<_>, Fault> =
                meshes.into_iter().map(|mesh| moved(mesh, enu_m)).collect();
            (site, moved.map_err(|fault| fault.of(path))?)
        }
    };
    Ok(Layer {
        kind: LayerKind::Surface,
        site,
        meshes,
        features: Vec::new(),
        warnings: notes.warnings(path),
    })
}

/// Meshes of a format that states neither unit nor axes, in metres (or in the unit of their system) with z up, as the
/// options say; what they do not say is noted where nothing else tells it.
pub(super) fn upright(
    meshes: &mut [TexturedMesh],
    options: &Options,
    path: &Path,
    notes: &mut Notes,
) -> Result<(), SourceError> {
    let local = options.crs.is_none() && options.georef.is_none();
    let fault = |what: String, mend: &str| Fault::new("mesh_unit", what, mend).of(path);
    let unit_m = match &options.mesh_unit {
        Some(word) if local => unit::by_word(word).ok_or_else(|| {
            fault(
                format!("'{word}' is no unit of length that is known"),
                "write m, cm, mm, ft, us-ft or in",
            )
        })?,
        Some(_) => {
            return Err(fault(
                "its coordinates are already those of a system (crs) or of parameters (georef)"
                    .into(),
                "leave mesh_unit out, or give the site alone",
            ));
        }
        None => 1.0,
    };
    if local {
        let unstated = [
            (
                options.mesh_unit.is_none(),
                "unit",
                "metres are",
                "mesh_unit",
            ),
            (options.mesh_up.is_none(), "axes", "z up is", "mesh_up"),
        ];
        for (_, place, taken, key) in unstated.iter().filter(|row| row.0) {
            notes.assume(
                place,
                format!("the file states none; {taken} taken"),
                format!(
                    "state it with --{} ({key} of a scenario's source)",
                    key.replace('_', "-")
                ),
            );
        }
    }
    let turn = options.mesh_up.unwrap_or(UpAxis::Z).to_z();
    let change = turn * unit_m;
    for mesh in meshes.iter_mut().filter(|_| change != DMat3::IDENTITY) {
        mesh.origin_m = change * mesh.origin_m;
        for place in &mut mesh.positions {
            *place = (change * Vec3::from(*place).as_dvec3())
                .as_vec3()
                .to_array();
        }
        for normal in &mut mesh.normals {
            *normal = (turn * Vec3::from(*normal).as_dvec3()).as_vec3().to_array();
        }
    }
    Ok(())
}

/// A mesh whose vertices are put where a function says.
fn moved(
    mut mesh: TexturedMesh,
    place: impl Fn(DVec3) -> Result<DVec3, Fault>,
) -> Result<TexturedMesh, Fault> {
    let Some(&first) = mesh.indices.first() else {
        return Ok(mesh);
    };
    let at = mesh.vertex_m(first);
    let origin_m = place(at)?.round();
    let mut positions = vec![[0.0; 3]; mesh.positions.len()];
    let mut known = vec![false; positions.len()];
    for &i in &mesh.indices {
        if !std::mem::replace(&mut known[i as usize], true) {
            let r_m = place(mesh.vertex_m(i))? - origin_m;
            positions[i as usize] = r_m.as_vec3().to_array();
        }
    }
    if !mesh.normals.is_empty() {
        let along = |axis: DVec3| -> Result<DVec3, Fault> {
            Ok(place(at + axis * REACH_M)? - place(at - axis * REACH_M)?)
        };
        let turn = DMat3::from_cols(along(DVec3::X)?, along(DVec3::Y)?, along(DVec3::Z)?);
        let turn = turn.inverse().transpose();
        for normal in &mut mesh.normals {
            let turned = turn * Vec3::from(*normal).as_dvec3();
            *normal = turned.normalize_or(DVec3::Z).as_vec3().to_array();
        }
    }
    mesh.positions = positions;
    mesh.origin_m = origin_m;
    Ok(mesh)
}
