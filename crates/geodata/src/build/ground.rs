//! The bare ground of layers as a height raster: what is written beside tiles for the physics.

use crate::sources::{Layer, LayerKind};
use boresight_models::ground::dsm::HeightGrid;
use boresight_models::ground::raster::{self, RasterFrame};
use boresight_models::maths::geodesy::SiteFrame;
use glam::{DAffine3, DMat3, DVec2, DVec3};

/// Cell of the raster of the bare ground [m].
const TERRAIN_CELL_M: f64 = 2.0;

/// From the frame of a layer to that of a site.
fn into_site(layer: &Layer, site: &SiteFrame) -> DAffine3 {
    let to_ecef =
        DAffine3::from_rotation_translation(layer.site.q_ecef_enu(), layer.site.origin().to_ecef());
    let turned = DMat3::from_quat(site.q_ecef_enu().inverse());
    DAffine3::from_mat3_translation(turned, -(turned * site.origin().to_ecef())) * to_ecef
}

/// The triangles of a layer in a site's frame [m].
pub fn triangles(layer: &Layer, site: &SiteFrame) -> Vec<[DVec3; 3]> {
    let to_enu = into_site(layer, site);
    let mut found = Vec::new();
    for mesh in &layer.meshes {
        let sound = |triangle: &&[u32; 3]| {
            triangle
                .iter()
                .all(|i| (*i as usize) < mesh.positions.len())
        };
        let all = mesh.indices.as_chunks::<3>().0.iter().filter(sound);
        found.extend(
            all.map(|triangle| triangle.map(|i| to_enu.transform_point3(mesh.vertex_m(i)))),
        );
    }
    found
}

/// The bare ground that the layers hold; `None` where none says that it is.
pub fn terrain(layers: &[Layer], site: &SiteFrame) -> Option<HeightGrid> {
    /// Beyond this no raster is surveyed [m].
    const MOST_M: f64 = 10_000.0;
    /// Cells at most.
    const MOST_CELLS: f64 = 8e6;
    let ground = layers
        .iter()
        .filter(|layer| layer.kind == LayerKind::Terrain);
    let ground: Vec<[DVec3; 3]> = ground.flat_map(|layer| triangles(layer, site)).collect();
    let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let (low, high) = (ground.iter().flatten()).fold(none, |(low, high), r| {
        (low.min(r.truncate()), high.max(r.truncate()))
    });
    let reach = DVec2::splat(MOST_M);
    let (low, high) = (low.max(-reach), high.min(reach));
    if !low.cmplt(high).all() {
        return None;
    }
    let size = high - low;
    let cell_m = TERRAIN_CELL_M.max((size.x * size.y / MOST_CELLS).sqrt());
    let frame = RasterFrame::covering(low, high, cell_m);
    let (mut grid, _) = raster::hits(&frame, ground);
    if !grid.heights_m.iter().any(|height_m| height_m.is_finite()) {
        return None;
    }
    raster::fill(&mut grid);
    Some(grid)
}
