//! The generated city as layers of triangles: ground under its map, walls with windows, roofs, trees, water.

use crate::sources::{Layer, LayerKind};
use boresight_models::ground::city::City;
use boresight_models::maths::geodesy::SiteFrame;
use boresight_models::maths::polygon::encloses;
use boresight_models::shape::mesh::{MeshData, Surface};
use boresight_models::shape::textured::{Look, NO_FEATURE, Texture, TexturedMesh};
use glam::DVec2;
use rstar::{AABB, RTree, RTreeObject};
use serde_json::{Map, json};
use std::sync::Arc;

/// Windows along either side of a facade's texture before it repeats.
const WINDOWS: u32 = 8;
/// Pixels along either side of a window's place.
const WINDOW_PX: u32 = 16;
/// Width of a bay and height of a residential and of an office storey [m]: those of the generator's walls.
const BAY_M: f32 = 3.0;
const STOREY_M: f32 = 3.0;
const OFFICE_STOREY_M: f32 = 3.6;
/// What of the ambient light's occlusion stays where the sun shines: the city's own shader dims sun and sky apart.
const OPEN: f32 = 0.3;

/// The city inside its square: what lies around it belongs to the place, not to the tiles.
pub fn layers(city: &City, site: &SiteFrame) -> Vec<Layer> {
    let half_m = city.params.extent_m / 2.0;
    let ground = Arc::new(ground_map(city));
    let facades = [facade(false), facade(true)].map(Arc::new);
    let mut terrain = empty(LayerKind::Terrain, site);
    let mut built = empty(LayerKind::Surface, site);
    for chunk in city.chunks() {
        for (surface, part) in chunk.by_surface() {
            let part = inside(&part, half_m);
            if part.indices.is_empty() {
                continue;
            }
            match surface {
                Surface::Ground => terrain.meshes.push(textured(&part, &ground, |uv| uv)),
                Surface::FacadeResidential => {
                    let pitch = [BAY_M, STOREY_M];
                    built
                        .meshes
                        .push(textured(&part, &facades[0], |uv| windows(uv, pitch)));
                }
                Surface::FacadeOffice => {
                    let pitch = [BAY_M, OFFICE_STOREY_M];
                    built
                        .meshes
                        .push(textured(&part, &facades[1], |uv| windows(uv, pitch)));
                }
                Surface::Plain | Surface::Foliage | Surface::Water => {
                    built.meshes.push(plain(&part));
                }
            }
        }
    }
    name_buildings(city, &mut built);
    vec![terrain, built]
}

fn empty(kind: LayerKind, site: &SiteFrame) -> Layer {
    Layer {
        kind,
        site: *site,
        meshes: Vec::new(),
        features: Vec::new(),
        warnings: Vec::new(),
    }
}

/// The triangles whose middle lies in the city's square.
fn inside(mesh: &MeshData, half_m: f64) -> MeshData {
    let in_square = |triangle: &&[u32; 3]| {
        let sum = |k: usize| {
            triangle
                .iter()
                .map(|&i| f64::from(mesh.positions[i as usize][k]))
                .sum()
        };
        let middle = [0, 1].map(|k: usize| -> f64 {
            let sum: f64 = sum(k);
            mesh.origin_enu_m[k] + sum / 3.0
        });
        middle.iter().all(|x| x.abs() <= half_m)
    };
    let (triangles, _) = mesh.indices.as_chunks::<3>();
    let kept: Vec<u32> = triangles
        .iter()
        .filter(in_square)
        .flatten()
        .copied()
        .collect();
    MeshData {
        indices: kept,
        ..mesh.clone()
    }
}

/// A mesh in the colours of its vertices.
fn plain(mesh: &MeshData) -> TexturedMesh {
    TexturedMesh {
        origin_m: mesh.origin_enu_m,
        positions: mesh.positions.clone(),
        normals: mesh.normals.clone(),
        colors: (mesh.colors.iter())
            .map(|&[r, g, b, open]| {
                let share = OPEN + (1.0 - OPEN) * open;
                [r * share, g * share, b * share, 1.0]
            })
            .collect(),
        indices: mesh.indices.clone(),
        ..TexturedMesh::default()
    }
}

/// A mesh under a picture.
fn textured(
    mesh: &MeshData,
    texture: &Arc<Texture>,
    place: impl Fn([f32; 2]) -> [f32; 2],
) -> TexturedMesh {
    TexturedMesh {
        uv: mesh.uv.iter().map(|&uv| place(uv)).collect(),
        look: Look {
            texture: Some(Arc::clone(texture)),
            ..Look::default()
        },
        ..plain(mesh)
    }
}

/// From metres along a wall and above the ground to places in a facade's texture, whose rows run down.
fn windows(uv: [f32; 2], [bay_m, storey_m]: [f32; 2]) -> [f32; 2] {
    let repeats = WINDOWS as f32;
    [uv[0] / bay_m / repeats, -uv[1] / storey_m / repeats]
}

/// The ground map as a texture.
fn ground_map(city: &City) -> Texture {
    let map = &city.ground_map;
    Texture {
        size_px: [map.size_px as u32; 2],
        rgba: map
            .rgb
            .iter()
            .flat_map(|&[r, g, b]| [r, g, b, 255])
            .collect(),
    }
}

/// Windows in a white wall, after the city's own shader: glass that mirrors more or less of the sky.
fn facade(office: bool) -> Texture {
    let side = WINDOWS * WINDOW_PX;
    let (edge, sill, lintel) = if office {
        (0.06, 0.22, 0.86)
    } else {
        (0.26, 0.30, 0.86)
    };
    let mut rgba = Vec::new();
    for row in 0..side {
        for column in 0..side {
            let x = (f64::from(column % WINDOW_PX) + 0.5) / f64::from(WINDOW_PX);
            let y = 1.0 - (f64::from(row % WINDOW_PX) + 0.5) / f64::from(WINDOW_PX);
            let glass = (edge..1.0 - edge).contains(&x) && (sill..lintel).contains(&y);
            // Panes differ, by a fixed hash of their place.
            let pane = (row / WINDOW_PX * 31 + column / WINDOW_PX * 17) % 7;
            let dark = 70 + 9 * pane as u8;
            let [r, g, b] = if glass {
                [dark, dark + 8, dark + 18]
            } else {
                [255; 3]
            };
            rgba.extend([r, g, b, 255]);
        }
    }
    Texture {
        size_px: [side; 2],
        rgba,
    }
}

/// Says of every triangle of a building which one it is of, and what is known of that.
fn name_buildings(city: &City, layer: &mut Layer) {
    let outlines = (city.buildings.iter().enumerate()).flat_map(|(number, building)| {
        let parts = building.parts.iter();
        parts.map(move |part| Outline::new(number as u32, &part.outline_enu_m))
    });
    let tree = RTree::bulk_load(outlines.collect());
    for mesh in &mut layer.meshes {
        let before = mesh.clone();
        let (triangles, _) = before.indices.as_chunks::<3>();
        let mut wanted = vec![None; before.positions.len()];
        mesh.features = vec![NO_FEATURE; before.positions.len()];
        for (t, triangle) in triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(|i| before.vertex_m(i));
            let inward = -(b - a).cross(c - a).normalize_or_zero() * JUST_M;
            let middle = (a + b + c) / 3.0;
            let found = [middle + inward, middle - inward]
                .iter()
                .find_map(|p| Outline::around(&tree, p.truncate()));
            let feature = found.unwrap_or(NO_FEATURE);
            for (k, &i) in triangle.iter().enumerate() {
                match wanted[i as usize] {
                    None => {
                        wanted[i as usize] = Some(feature);
                        mesh.features[i as usize] = feature;
                    }
                    Some(known) if known == feature => {}
                    // A corner that two buildings share.
                    Some(_) => {
                        mesh.indices[3 * t + k] = mesh.positions.len() as u32;
                        mesh.positions.push(before.positions[i as usize]);
                        mesh.normals.push(before.normals[i as usize]);
                        mesh.colors.push(before.colors[i as usize]);
                        mesh.uv.extend(before.uv.get(i as usize));
                        mesh.features.push(feature);
                    }
                }
            }
        }
    }
    layer.features = (city.buildings.iter())
        .map(|building| {
            let rows = [
                ("kind", json!(format!("{:?}", building.kind).to_lowercase())),
                ("height_m", json!(building.height_m())),
                ("base_m", json!(building.base_m)),
            ];
            Map::from_iter(rows.map(|(name, value)| (name.to_owned(), value)))
        })
        .collect();
}

/// How far inside a wall its building is looked for [m].
const JUST_M: f64 = 0.05;

/// The outline of a building's part.
struct Outline {
    building: u32,
    corners_m: Vec<DVec2>,
}

impl Outline {
    fn new(building: u32, corners_m: &[DVec2]) -> Self {
        Self {
            building,
            corners_m: corners_m.to_vec(),
        }
    }

    /// The first building that stands over a point of the map.
    fn around(tree: &RTree<Self>, p: DVec2) -> Option<u32> {
        let near = tree.locate_in_envelope_intersecting(AABB::from_point(p.to_array()));
        let over = near.filter(|outline| encloses(&outline.corners_m, p));
        over.map(|outline| outline.building).min()
    }
}

impl RTreeObject for Outline {
    type Envelope = AABB<[f64; 2]>;

    fn envelope(&self) -> Self::Envelope {
        let points: Vec<[f64; 2]> = self.corners_m.iter().map(|p| p.to_array()).collect();
        AABB::from_points(&points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_models::ground::city::CityParams;
    use boresight_models::maths::geodesy::Geodetic;

    #[test]
    fn the_city_keeps_its_triangles_and_knows_its_buildings() {
        let params = CityParams {
            extent_m: 800.0,
            ..CityParams::default()
        };
        let city = City::generate(&params).unwrap();
        let site = SiteFrame::new(Geodetic {
            latitude_rad: 0.8,
            longitude_rad: 0.1,
            height_m: 100.0,
        });
        let layers = layers(&city, &site);
        let half_m = params.extent_m / 2.0;
        let triangles: usize = (layers.iter().flat_map(|l| &l.meshes))
            .map(TexturedMesh::triangle_count)
            .sum();
        let wanted: usize = (city.chunks().iter())
            .map(|chunk| inside(chunk, half_m).triangle_count())
            .sum();
        assert_eq!(triangles, wanted);
        let built = &layers[1];
        assert_eq!(built.features.len(), city.buildings.len());
        // Every building's walls and roof are named, and reach up to its height.
        let mut top_m = vec![f64::MIN; city.buildings.len()];
        for mesh in &built.meshes {
            for &i in &mesh.indices {
                if mesh.features[i as usize] != NO_FEATURE {
                    let top = &mut top_m[mesh.features[i as usize] as usize];
                    *top = top.max(mesh.vertex_m(i).z);
                }
            }
        }
        let right = (city.buildings.iter().zip(&top_m))
            .filter(|(b, top)| (b.base_m + b.height_m() - **top).abs() < 0.2)
            .count();
        // Some stand outside the square, or under a tree.
        assert!(
            right as f64 > 0.9 * top_m.len() as f64,
            "{right} of {}",
            top_m.len()
        );
    }
}
