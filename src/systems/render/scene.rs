//! The rendered mirror of the truth: city, sky and UAVs in a big_space of WGS-84.
//!
//! The root grid is earth-centred; the city lives in a sub-grid whose axes are the site's
//! east, north and up. The floating origin sits on that sub-grid, so what the GPU sees in f32 is
//! always relative to the station's cell, wherever on Earth the site is.

use crate::components::environment::Environment;
use crate::components::flight::{Flight, Uav};
use crate::components::render::{
    ATTRIBUTE_SURFACE, DIGIT_OF_TAG, LeanMaterial, LeanPaint, LightUniform, SceneHandles, Shading,
    SiteGrid, StationOrigin, UavBody, UavRotor, WINDOW_LAYER, speed_tag,
};
use crate::components::run::{Kept, Options};
use crate::models::air::sky::{CHANNELS_M, Sky};
use crate::models::bodies::UavMesh;
use crate::models::ground::visible::keep_visible;
use crate::models::shape::mesh::{MeshData, Surface};
use crate::systems::render::renderer::{Renderer, settle};
use crate::systems::render::texture::{ground_texture, sky_texture};
use bevy::asset::RenderAssetUsages;
use bevy::camera::visibility::{NoFrustumCulling, RenderLayers};
use bevy::mesh::{Indices, MeshTag, PrimitiveTopology};
use bevy::prelude::*;
use big_space::prelude::*;
use glam::{DQuat, DVec2, DVec3, Vec4};

/// Edge of a grid cell [m]: f32 positions inside it are right to 0.1 mm.
const CELL_M: f32 = 2_000.0;
/// Side of the squares of the city that are culled one by one [m].
const CULLED_M: f64 = 100.0; // [m]
/// Radius of the sky dome [m]: beyond the far apron of the city, inside the culling limit.
const DOME_M: f32 = 60_000.0;

/// The transform of a big_space grid in another: cell and f32 rest.
pub fn place(grid: &Grid, r_m: DVec3, q: DQuat) -> (CellCoord, Transform) {
    let (cell, rest) = grid.translation_to_grid(r_m);
    (
        cell,
        Transform {
            translation: rest,
            rotation: q.as_quat(),
            scale: Vec3::ONE,
        },
    )
}

/// A grid as this scene uses it, for the earth-centred root and for the site.
pub fn grid() -> Grid {
    Grid::new(CELL_M, 100.0)
}

/// A Bevy mesh with the attributes of [`LeanMaterial`].
pub fn mesh(data: &MeshData) -> Mesh {
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::RENDER_WORLD,
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, data.positions.clone())
    .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, data.normals.clone())
    .with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, data.colors.clone())
    .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, data.uv.clone())
    .with_inserted_attribute(ATTRIBUTE_SURFACE, data.surface.clone())
    .with_inserted_indices(Indices::U32(data.indices.clone()))
}

/// The dome: an inward box is enough, since the shader colours by direction alone.
fn dome() -> Mesh {
    let r = DOME_M;
    let corners: Vec<[f32; 3]> = (0..8)
        .map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { r } else { -r }))
        .collect();
    let faces: [[u32; 4]; 6] = [
        [0, 2, 6, 4],
        [1, 5, 7, 3],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 1, 3, 2],
        [4, 6, 7, 5],
    ];
    let indices = faces
        .iter()
        .flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d])
        .collect();
    mesh(&MeshData {
        normals: vec![[0.0, 0.0, 1.0]; 8],
        colors: vec![[0.0, 0.0, 0.0, 1.0]; 8],
        uv: vec![[0.0; 2]; 8],
        surface: vec![[0.0; 2]; 8],
        positions: corners,
        indices,
        origin_enu_m: DVec3::ZERO,
    })
}

/// Texels along a side of the sky table: 0.4 deg at the horizon, enough for panes and water, and 0.1 deg
/// for the sky itself, which a window shows.
const SKY_SIDE: u32 = 256;
const WINDOW_SKY_SIDE: u32 = 1024;

/// Coefficients of the air-light over the cosine of the azimuth from the sun: the cubic through
/// the sky's values at the Chebyshev nodes of that cosine.
fn airlight_polynomial(sky: &Sky, sun_dir_enu: DVec3) -> [Vec4; 4] {
    let towards = sun_dir_enu.truncate().normalize_or(DVec2::Y);
    let nodes = [0, 1, 2, 3].map(|k| (std::f64::consts::PI * (f64::from(k) + 0.5) / 4.0).cos());
    let values = nodes.map(|c| {
        let dir = towards * c + towards.perp() * (1.0 - c * c).sqrt();
        DVec3::from_array(sky.airlight(dir.extend(0.0)))
    });
    // Newton's divided differences, multiplied out.
    let mut divided = values;
    for order in 1..4 {
        for k in (order..4).rev() {
            divided[k] = (divided[k] - divided[k - 1]) / (nodes[k] - nodes[k - order]);
        }
    }
    let mut coefficients = [DVec3::ZERO; 4];
    for k in (0..4).rev() {
        for power in (1..4).rev() {
            coefficients[power] = coefficients[power - 1] - nodes[k] * coefficients[power];
        }
        coefficients[0] = divided[k] - nodes[k] * coefficients[0];
    }
    coefficients.map(|c| c.as_vec3().extend(0.0))
}

/// Adds a structure to the spawned scene, if anything is rendered: its mesh at its origin, unturned.
pub fn add_structure(world: &mut World, data: &MeshData) {
    add_to(world, data, RenderLayers::default());
}

/// The same, for the cameras that see the `layers`.
fn add_to(world: &mut World, data: &MeshData, layers: RenderLayers) {
    let Some(handles) = world.get_resource::<SceneHandles>() else {
        return;
    };
    let (site_grid, solid) = (handles.site_grid, handles.solid.clone());
    let at = place(&grid(), data.origin_enu_m, DQuat::IDENTITY);
    for (surface, part) in data.by_surface() {
        let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh(&part));
        let material = MeshMaterial3d(solid[surface as usize].clone());
        world.spawn((
            Mesh3d(mesh),
            material,
            at,
            layers.clone(),
            ChildOf(site_grid),
        ));
    }
}

/// The light of an environment as the shader takes it.
fn light(environment: &Environment) -> LightUniform {
    let rgb = |[r, g, b]: [f64; 3]| Vec4::new(r as f32, g as f32, b as f32, 0.0);
    let sky = &environment.backdrop.sky;
    let extinction = CHANNELS_M.map(|m| environment.weather.extinction_per_m(m));
    LightUniform {
        sun_dir_enu: environment.backdrop.sun_dir_enu.as_vec3().extend(0.0),
        sun_klx: rgb(sky.sun_illuminance()),
        ambient_sky_klx: rgb(sky.ambient_down()),
        ambient_ground_klx: rgb(sky.ambient_up()),
        extinction_per_m: rgb(extinction),
        // A lit window seen from outside: some 80 cd/m^2.
        night: Vec4::new(0.08, 0.0, 0.0, 0.0),
        airlight_kcd_m2: airlight_polynomial(sky, environment.backdrop.sun_dir_enu),
    }
}

/// Builds the grids and the city from its `tiles`. The sensors stand at `eyes_enu_m` [m], for the first of which it is drawn
/// fastest; what they cannot see is left out and given back.
pub fn spawn(
    world: &mut World,
    environment: &Environment,
    mut tiles: Vec<MeshData>,
    eyes_enu_m: &[DVec3],
) -> Vec<MeshData> {
    let r_station_enu_m = eyes_enu_m.first().copied().unwrap_or_default();
    let city = &environment.city;
    let mut images = world.resource_mut::<Assets<Image>>();
    let sky = LeanMaterial {
        light: light(environment),
        picture: images.add(ground_texture(&city.ground_map)),
        sky_table: images.add(sky_texture(&environment.backdrop, SKY_SIDE)),
        shading: Shading::Sky,
    };
    let mut materials = world.resource_mut::<Assets<LeanMaterial>>();
    let paint = LeanPaint(sky.clone());
    let solid = Surface::ALL.map(|surface| {
        materials.add(LeanMaterial {
            shading: Shading::Solid(surface),
            ..sky.clone()
        })
    });

    let site = &environment.site;
    let (cell, transform) = place(&grid(), site.origin().to_ecef(), site.q_ecef_enu());
    let root = world
        .spawn((
            BigSpaceRootBundle {
                grid: grid(),
                ..default()
            },
            Visibility::default(),
        ))
        .id();
    let site_grid = world
        .spawn((
            SiteGrid,
            grid(),
            cell,
            transform,
            Visibility::default(),
            ChildOf(root),
        ))
        .id();
    let at = place(&grid(), r_station_enu_m, DQuat::IDENTITY);
    world.spawn((
        StationOrigin,
        FloatingOrigin,
        at,
        Visibility::default(),
        ChildOf(site_grid),
    ));
    world.insert_resource(paint);
    world.insert_resource(SceneHandles { site_grid, solid });
    let hidden = keep_visible(&mut tiles, eyes_enu_m);
    for part in near_first(&tiles, r_station_enu_m) {
        add_structure(world, &part);
    }
    let rest = tiles.into_iter().zip(hidden);
    rest.map(|(tile, indices)| MeshData { indices, ..tile })
        .collect()
}

/// Adds what a window alone shows: the sky, and what the sensors cannot see. It comes after all that they see and on a
/// layer of its own, so that their pictures are the same with a window and without.
pub fn spawn_for_window(
    world: &mut World,
    environment: &Environment,
    hidden: &[MeshData],
    r_station_enu_m: DVec3,
) {
    let (Some(site_grid), Some(paint)) = (
        (world.get_resource::<SceneHandles>()).map(|handles| handles.site_grid),
        world.get_resource::<LeanPaint>().cloned(),
    ) else {
        return;
    };
    let table = sky_texture(&environment.backdrop, WINDOW_SKY_SIDE);
    let sky = LeanMaterial {
        sky_table: world.resource_mut::<Assets<Image>>().add(table),
        ..paint.0
    };
    let sky = world.resource_mut::<Assets<LeanMaterial>>().add(sky);
    let dome = world.resource_mut::<Assets<Mesh>>().add(dome());
    world.spawn((
        Mesh3d(dome),
        MeshMaterial3d(sky),
        RenderLayers::layer(WINDOW_LAYER),
        NoFrustumCulling,
        place(&grid(), r_station_enu_m, DQuat::IDENTITY),
        ChildOf(site_grid),
    ));
    for part in near_first(hidden, r_station_enu_m) {
        add_to(world, &part, RenderLayers::layer(WINDOW_LAYER));
    }
}

/// Meshes cut into the squares that are culled one by one, near ones first. A narrow field pays for the corners of every mesh
/// that it touches; of one material, meshes are drawn in the order they were added in, and what is hidden by then is not
/// shaded.
fn near_first(tiles: &[MeshData], r_station_enu_m: DVec3) -> Vec<MeshData> {
    let mut parts: Vec<(f64, MeshData)> = tiles
        .iter()
        .flat_map(|tile| tile.cut(CULLED_M))
        .filter_map(|part| {
            let (low_m, high_m) = part.bounds_m()?;
            let middle_m = part.origin_enu_m + 0.5 * (low_m + high_m);
            Some((middle_m.distance(r_station_enu_m), part))
        })
        .collect();
    parts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let parts = parts.into_iter().map(|(_, mut part)| {
        part.sort_from(r_station_enu_m);
        part
    });
    parts.collect()
}

/// Gives the scene the light of the environment as it is now: orders change the weather.
pub fn relight(world: &mut World) {
    let windowed = (world.get_resource::<Options>()).is_some_and(|options| options.window);
    let environment = world.resource::<Environment>();
    let light = light(environment);
    let mirrored = sky_texture(&environment.backdrop, SKY_SIDE);
    let shown = windowed.then(|| sky_texture(&environment.backdrop, WINDOW_SKY_SIDE));
    let mut images = world.resource_mut::<Assets<Image>>();
    let mirrored = images.add(mirrored);
    let shown = shown.map(|shown| images.add(shown));
    let mut materials = world.resource_mut::<Assets<LeanMaterial>>();
    for (_, material) in materials.iter_mut() {
        material.light = light;
        material.sky_table = match (material.shading, &shown) {
            (Shading::Sky, Some(shown)) => shown.clone(),
            _ => mirrored.clone(),
        };
    }
    if let Some(mut paint) = world.get_resource_mut::<LeanPaint>() {
        (paint.0.light, paint.0.sky_table) = (light, mirrored);
    }
    // The next frames must not show the light of before.
    if let Some(mut renderer) = Kept::<Renderer>::take(world) {
        settle(world, &mut renderer);
        Kept::put(world, renderer);
    }
}

/// A big_space place in the site's grid.
pub fn place_in_site(r_enu_m: DVec3, q: DQuat) -> (CellCoord, Transform) {
    place(&grid(), r_enu_m, q)
}

/// Moves the scene's UAVs and distractors to the truth, and hides those that closed cloud hides.
pub fn sync_scene(world: &mut World) {
    let mut states = world.query::<(&Uav, &Flight)>();
    let environment = world.resource::<Environment>();
    let poses: Vec<_> = states
        .iter(world)
        .map(|(uav, flight)| {
            let hidden = environment.in_cloud(flight.state.r_enu_m);
            (uav.index, (flight.state, hidden))
        })
        .collect();
    let of = |index: usize| {
        poses
            .iter()
            .find(|(i, _)| *i == index)
            .map(|(_, state)| state)
    };
    let mut bodies = world.query::<(&UavBody, &mut CellCoord, &mut Transform, &mut Visibility)>();
    for (body, mut cell, mut transform, mut visibility) in bodies.iter_mut(world) {
        if let Some((state, hidden)) = of(body.0) {
            (*cell, *transform) = place_in_site(state.r_enu_m, state.q_enu_body);
            visibility.set_if_neq(if *hidden {
                Visibility::Hidden
            } else {
                Visibility::Inherited
            });
        }
    }
    let mut rotors = world.query::<(&UavRotor, &mut Transform, &mut MeshTag)>();
    for (rotor, mut transform, mut tag) in rotors.iter_mut(world) {
        if let Some((state, _)) = of(rotor.uav) {
            let speed = speed_tag(state.rotor_speed_radps[rotor.number]);
            let tagged = MeshTag(speed | tag.0 & DIGIT_OF_TAG);
            tag.set_if_neq(tagged);
            let phase_rad = state.rotor_phase_rad[rotor.number] as f32;
            transform.rotation = rotor.q_body_hub * Quat::from_rotation_z(phase_rad);
        }
    }
}

/// Bevy's camera looks along -z with y up; the optical frame has z forward and y down.
pub fn bevy_attitude(q_enu_cam: DQuat) -> DQuat {
    q_enu_cam * DQuat::from_rotation_x(std::f64::consts::PI)
}

/// Spawns the rendered meshes of a UAV or distractor.
pub fn spawn_uav(world: &mut World, index: usize, shape: &UavMesh, at: (DVec3, DQuat)) {
    let (site_grid, material) = {
        let handles = world.resource::<SceneHandles>();
        // What flies is painted plainly.
        let plain = &handles.solid[Surface::Plain as usize];
        (handles.site_grid, plain.clone())
    };
    let mut add = |data: &MeshData| world.resource_mut::<Assets<Mesh>>().add(mesh(data));
    let body = add(&shape.body);
    let blades: Vec<_> = shape.blades.iter().map(&mut add).collect();
    let body = world
        .spawn((
            UavBody(index),
            Mesh3d(body),
            MeshMaterial3d(material.clone()),
            MeshTag(0),
            place_in_site(at.0, at.1),
            ChildOf(site_grid),
        ))
        .id();
    let mut rotors: Vec<Entity> = Vec::new();
    for (number, mount) in shape.rotors.iter().enumerate() {
        let rotor = world.spawn((
            UavRotor {
                uav: index,
                number,
                q_body_hub: mount.q_body_hub.as_quat(),
            },
            Mesh3d(blades[mount.blade].clone()),
            MeshMaterial3d(material.clone()),
            MeshTag(0),
            Transform::from_translation(mount.hub_body_m.as_vec3()),
            ChildOf(mount.parent.map_or(body, |parent| rotors[parent])),
        ));
        rotors.push(rotor.id());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::geodesy::{Geodetic, SiteFrame};
    use big_space::plugin::BigSpaceMinimalPlugins;

    /// A place 50 km from the site's origin [m, ENU].
    const FAR_ENU_M: DVec3 = DVec3::new(30_000.123, -40_000.456, 117.789);

    fn site() -> SiteFrame {
        SiteFrame::new(Geodetic {
            latitude_rad: 47.3769f64.to_radians(),
            longitude_rad: 8.5417f64.to_radians(),
            height_m: 455.0, // [m]
        })
    }

    #[test]
    fn airlight_follows_the_horizon_all_around() {
        let sun_dir_enu = DVec3::new(0.5, -0.6, 0.62).normalize();
        let sky = Sky::new(sun_dir_enu, 18_000.0, 0.2, 0.18);
        let fit = airlight_polynomial(&sky, sun_dir_enu);
        for degrees in (0..360).step_by(5) {
            let dir = DVec2::from_angle(f64::from(degrees).to_radians());
            let c = dir.dot(sun_dir_enu.truncate().normalize()) as f32;
            let fitted = fit[0] + c * (fit[1] + c * (fit[2] + c * fit[3]));
            for (channel, exact) in sky.airlight(dir.extend(0.0)).into_iter().enumerate() {
                let error = f64::from(fitted[channel]) / exact - 1.0;
                assert!(error.abs() < 0.05, "{degrees} deg: {error}");
            }
        }
    }

    #[test]
    fn truth_is_sub_millimetre_50_km_from_the_origin() {
        let site = site();
        let (mut worst_m, mut plain_m): (f64, f64) = (0.0, 0.0);
        for step in 0..360 {
            let turn = DQuat::from_rotation_z(f64::from(step).to_radians());
            let r_enu_m = turn * FAR_ENU_M;
            let back = |r_m: DVec3| {
                let (cell, rest) = place(&grid(), r_m, DQuat::IDENTITY);
                grid().grid_position_double(&cell, &rest)
            };
            worst_m = worst_m.max(back(r_enu_m).distance(r_enu_m));
            let r_ecef_m = site.enu_to_ecef(r_enu_m);
            worst_m = worst_m.max(site.ecef_to_enu(back(r_ecef_m)).distance(r_enu_m));
            plain_m = plain_m.max(r_ecef_m.as_vec3().as_dvec3().distance(r_ecef_m));
        }
        assert!(worst_m < 1e-4, "{worst_m}");
        // What plain f32 coordinates of the Earth would make of it.
        assert!(plain_m > 0.1, "{plain_m}");
    }

    #[test]
    fn nothing_jitters_50_km_from_the_origin() {
        let site = site();
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, BigSpaceMinimalPlugins));
        let world = app.world_mut();
        let root = world
            .spawn(BigSpaceRootBundle {
                grid: grid(),
                ..default()
            })
            .id();
        let r_site_ecef_m = site.origin().to_ecef();
        let (cell, transform) = place(&grid(), r_site_ecef_m, site.q_ecef_enu());
        let site_grid = world
            .spawn((SiteGrid, grid(), cell, transform, ChildOf(root)))
            .id();
        let mut spawn = |r_enu_m: DVec3| {
            world
                .spawn((place(&grid(), r_enu_m, DQuat::IDENTITY), ChildOf(site_grid)))
                .id()
        };
        let moving = spawn(FAR_ENU_M);
        let still = spawn(FAR_ENU_M + DVec3::X);
        let camera = spawn(FAR_ENU_M - DVec3::new(20.0, 30.0, 5.0));
        world.entity_mut(camera).insert(FloatingOrigin);

        let direction = DVec3::new(0.6, 0.48, 0.64);
        let (mut worst_m, mut plain_m): (f64, f64) = (0.0, 0.0);
        for millimetres in 0..300 {
            let moved_m = 1e-3 * f64::from(millimetres) * direction;
            let r_enu_m = FAR_ENU_M + moved_m;
            let at = place(&grid(), r_enu_m, DQuat::IDENTITY);
            app.world_mut().entity_mut(moving).insert(at);
            app.update();
            let seen = |entity: Entity| {
                let transform = app.world().get::<GlobalTransform>(entity);
                transform.map(GlobalTransform::translation).unwrap()
            };
            let truth_m = DVec3::X - moved_m;
            let apart_m = (seen(still) - seen(moving)).as_dvec3();
            worst_m = worst_m.max(apart_m.distance(truth_m));
            let plain = (FAR_ENU_M + DVec3::X).as_vec3() - r_enu_m.as_vec3();
            plain_m = plain_m.max(plain.as_dvec3().distance(truth_m));
        }
        assert!(worst_m < 1e-4, "{worst_m}");
        // Plain f32 coordinates jump by more than a step.
        assert!(plain_m > 1e-3, "{plain_m}");
    }
}
