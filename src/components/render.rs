//! What the renderer sees: the lean material, the sensor projection, links from truth to scene.

use crate::models::ground::skyline::Skyline;
use crate::models::optics::camera::PixelRect;
use crate::models::shape::mesh::Surface;
use bevy::camera::{CameraProjection, SubCameraView};
use bevy::math::{Mat4, Vec3A, Vec4};
use bevy::mesh::{MeshVertexAttribute, MeshVertexBufferLayoutRef, VertexFormat};
use bevy::pbr::{MaterialPipeline, MaterialPipelineKey};
use bevy::prelude::*;
use bevy::render::render_resource::{
    AsBindGroup, Face, RenderPipelineDescriptor, ShaderType, SpecializedMeshPipelineError,
};
use bevy::shader::{ShaderDefVal, ShaderRef};
use boresight_tiles::TileSurface;

/// Surface kind of a vertex, and its building's variant or its blade's spacing; see [`crate::models::shape::mesh::Surface`].
pub const ATTRIBUTE_SURFACE: MeshVertexAttribute =
    MeshVertexAttribute::new("Surface", 7_310_001, VertexFormat::Float32x2);

/// The shader of [`LeanMaterial`], compiled in so that a binary needs no asset folder to render.
pub const LEAN_SHADER: Handle<Shader> =
    bevy::asset::uuid_handle!("5f0f2f3a-6f44-4e0c-9a39-0c0f5e3bd1a7");

/// The light of the scene as the shader takes it; illuminances in klx per linear sRGB channel.
#[derive(ShaderType, Clone, Copy, Debug, Default)]
pub struct LightUniform {
    /// Unit vector to the sun, ENU.
    pub sun_dir_enu: Vec4,
    /// Direct normal illuminance [klx].
    pub sun_klx: Vec4,
    /// Illuminance of a face that looks up [klx].
    pub ambient_sky_klx: Vec4,
    /// Illuminance of a face that looks down [klx].
    pub ambient_ground_klx: Vec4,
    /// Extinction of the air [1/m].
    pub extinction_per_m: Vec4,
    /// x: luminance of a lit window [kcd/m^2].
    pub night: Vec4,
    /// Air-light [kcd/m^2]: coefficients of a polynomial in the cosine of the azimuth from the sun.
    pub airlight_kcd_m2: [Vec4; 4],
}

/// The one material of sensor cameras and window (`assets/shaders/lean.wgsl`).
///
/// Bevy's `StandardMaterial` costs twelve times as much per frame on a software rasteriser.
#[derive(Asset, TypePath, AsBindGroup, Clone, Debug)]
#[bind_group_data(Shading)]
pub struct LeanMaterial {
    /// Sun, sky and air.
    #[uniform(0)]
    pub light: LightUniform,
    /// Albedo of the ground over the city's extent, or the picture on a tile.
    #[texture(1)]
    #[sampler(2)]
    pub picture: Handle<Image>,
    /// The sky's luminance on an octahedral square.
    #[texture(3)]
    #[sampler(4)]
    pub sky_table: Handle<Image>,
    /// What it draws.
    pub shading: Shading,
}

/// What a [`LeanMaterial`] draws, and which variant of the shader draws it: a software rasteriser pays for
/// both sides of every branch, so that each kind of surface has a pipeline of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Shading {
    /// A kind of solid surface of the generated city, or of what flies.
    Solid(Surface),
    /// A surface of a real city, as it was photographed or modelled.
    Tile(TileSurface),
    /// The sky of the window: drawn after everything solid, so that only uncovered pixels pay for it. A
    /// sensor's sky is added to its frames, see [`crate::models::optics::background`].
    Sky,
}

impl Shading {
    /// The definitions that select the shader's variant.
    fn definitions(self) -> Vec<ShaderDefVal> {
        let names: &[&str] = match self {
            // Rotors are of it.
            Self::Solid(Surface::Plain) => &["TURNS"],
            Self::Solid(Surface::FacadeResidential | Surface::FacadeOffice) => {
                &["MIRRORS", "FACADE"]
            }
            Self::Solid(Surface::Ground) => &["PICTURE"],
            Self::Solid(Surface::Foliage) => &["FOLIAGE"],
            Self::Solid(Surface::Water) => &["MIRRORS"],
            Self::Tile(tile) => return definitions_of(tile),
            Self::Sky => &["SKY"],
        };
        names.iter().map(|name| (*name).into()).collect()
    }
}

/// The definitions that select the variant of a tile's surface.
fn definitions_of(tile: TileSurface) -> Vec<ShaderDefVal> {
    let chosen = [
        (true, "TILE"),
        (tile.baked, "BAKED"),
        (tile.picture, "PICTURE"),
        (tile.two_sided, "TWO_SIDED"),
    ];
    let cutoff = tile.cutoff.map(|alpha| ("CUTOFF", u32::from(alpha)));
    let names = chosen.into_iter().filter(|(is, _)| *is);
    names
        .map(|(_, name)| name.into())
        .chain(cutoff.map(|(name, value)| ShaderDefVal::UInt(name.into(), value)))
        .collect()
}

impl From<&LeanMaterial> for Shading {
    fn from(material: &LeanMaterial) -> Self {
        material.shading
    }
}

impl Material for LeanMaterial {
    fn vertex_shader() -> ShaderRef {
        LEAN_SHADER.into()
    }

    fn fragment_shader() -> ShaderRef {
        LEAN_SHADER.into()
    }

    fn alpha_mode(&self) -> AlphaMode {
        // Bevy draws masked surfaces after opaque ones: what has holes last, for a rasteriser pays for what
        // may be one. Of the sky the shader discards nothing.
        match self.shading {
            Shading::Tile(TileSurface {
                cutoff: Some(_), ..
            })
            | Shading::Sky => AlphaMode::Mask(0.0),
            Shading::Solid(_) | Shading::Tile(_) => AlphaMode::Opaque,
        }
    }

    fn enable_prepass() -> bool {
        false
    }

    fn enable_shadows() -> bool {
        false
    }

    fn specialize(
        _: &MaterialPipeline,
        descriptor: &mut RenderPipelineDescriptor,
        layout: &MeshVertexBufferLayoutRef,
        key: MaterialPipelineKey<Self>,
    ) -> Result<(), SpecializedMeshPipelineError> {
        for definition in key.bind_group_data.definitions() {
            descriptor.vertex.shader_defs.push(definition.clone());
            if let Some(fragment) = &mut descriptor.fragment {
                fragment.shader_defs.push(definition);
            }
        }
        if let Shading::Tile(TileSurface { two_sided, .. }) = key.bind_group_data {
            descriptor.primitive.cull_mode = (!two_sided).then_some(Face::Back);
        }
        // Tiles have what their files have; Bevy tells the shader which of the first four that is.
        let attributes = [
            Mesh::ATTRIBUTE_POSITION,
            Mesh::ATTRIBUTE_NORMAL,
            Mesh::ATTRIBUTE_COLOR,
            Mesh::ATTRIBUTE_UV_0,
            ATTRIBUTE_SURFACE,
        ];
        let attributes: Vec<_> = (0..)
            .zip(attributes)
            .filter(|(_, attribute)| layout.0.contains(attribute.id))
            .map(|(location, attribute)| attribute.at_shader_location(location))
            .collect();
        descriptor.vertex.buffers = vec![layout.0.get_layout(&attributes)?];
        Ok(())
    }
}

/// Marks the grid whose axes are the site's east, north, up.
#[derive(Component)]
pub struct SiteGrid;

/// Marks the point the sensors are rendered from.
#[derive(Component)]
pub struct StationOrigin;

/// Marks the body of a UAV by its scenario index.
#[derive(Component, Clone, Copy, Debug)]
pub struct UavBody(pub usize);

/// A rotor or wing in the scene.
#[derive(Component, Clone, Copy, Debug)]
pub struct UavRotor {
    /// Scenario index of its UAV or distractor.
    pub uav: usize,
    /// Its number on the airframe.
    pub number: usize,
    /// Attitude on the airframe at phase 0.
    pub q_body_hub: Quat,
}

/// The bits of a mesh's tag that hold its digit among the identities of a frame.
pub const DIGIT_OF_TAG: u32 = 0b111;

/// The bits above, by which the shader smears a rotor: its speed in sixteenths of a radian a second.
pub fn speed_tag(speed_radps: f64) -> u32 {
    ((16.0 * speed_radps.abs()).round() as u32) << 3
}

/// The materials and meshes of the scene that later systems change.
#[derive(Resource)]
pub struct SceneHandles {
    /// Entity of the site's grid.
    pub site_grid: Entity,
    /// Material of each kind of solid surface, by its number.
    pub solid: [Handle<LeanMaterial>; Surface::ALL.len()],
}

/// The layer that only the window's camera sees: the sky, and the tiles that are streamed for it.
pub const WINDOW_LAYER: usize = 1;
/// The layer that only sensors see: the tiles that are settled for them.
pub const SENSOR_LAYER: usize = 2;

/// The tilesets of a real city.
#[derive(Resource, Clone, Copy, Debug)]
pub struct CityTilesets {
    /// Settled for the sensors.
    pub sensors: Entity,
    /// Streamed for the window, where there is one.
    pub window: Option<Entity>,
}

/// Paints tiles in the light of the scene: the material that theirs are made of.
#[derive(Resource, Clone, Debug)]
pub struct LeanPaint(pub LeanMaterial);

/// The render cameras of a sensor.
#[derive(Component, Clone, Debug)]
pub struct SensorViews {
    /// Size [px] and camera of the rectangles that can be rendered, the smallest first; the last is the
    /// whole sensor.
    pub sizes: Vec<([u32; 2], Entity)>,
    /// Each renders the surroundings of something small enlarged; see [`crate::systems::capture`].
    pub magnifiers: Vec<Entity>,
}

impl SensorViews {
    /// The smallest view that holds a rectangle, and where in the frame `frame` its own is put.
    pub fn around(&self, wanted: PixelRect, frame: PixelRect) -> Option<(Entity, PixelRect)> {
        let [wide, high] = wanted.size_px;
        let fits = |size: &[u32; 2]| {
            size[0] >= wide && size[1] >= high && (0..2).all(|i| size[i] <= frame.size_px[i])
        };
        let (size_px, view) = self.sizes.iter().find(|(size, _)| fits(size))?;
        let offset_px = [0, 1].map(|i| {
            let last = frame.offset_px[i] + frame.size_px[i] - size_px[i];
            wanted.offset_px[i].min(last)
        });
        let rect = PixelRect {
            offset_px,
            size_px: *size_px,
        };
        Some((*view, rect))
    }
}

/// What of the scene stands before the sky, seen from a station.
#[derive(Component)]
pub struct Solids(pub Skyline);

/// A pinhole that renders one rectangle of a sensor: the full frame or the window read out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorProjection {
    /// Focal length [px].
    pub focal_px: f64,
    /// Full sensor size [px].
    pub sensor_px: [u32; 2],
    /// Upper left corner of the rectangle [px].
    pub offset_px: [u32; 2],
    /// Size of the rectangle [px].
    pub size_px: [u32; 2],
}

/// Nearest rendered distance [m]: nothing stands closer to the optics, and a reversed infinite
/// depth buffer keeps its resolution beyond.
const NEAR_M: f32 = 0.5;
/// Distance ahead [m] of what a depth buffer holds; infinite where it holds nothing.
pub fn distance_m(depth: f32) -> f32 {
    NEAR_M / depth.max(0.0)
}
/// Frustum culling's far limit [m]; the sky dome lies inside it.
const FAR_M: f32 = 100_000.0;

impl CameraProjection for SensorProjection {
    fn get_clip_from_view(&self) -> Mat4 {
        let focal = self.focal_px;
        let [width, height] = self.size_px.map(f64::from);
        // Principal point (sensor centre) in the rectangle's normalised coordinates.
        let centre_x = f64::from(self.sensor_px[0]) / 2.0 - f64::from(self.offset_px[0]);
        let centre_y = f64::from(self.sensor_px[1]) / 2.0 - f64::from(self.offset_px[1]);
        let shift_x = 2.0 * centre_x / width - 1.0;
        let shift_y = 1.0 - 2.0 * centre_y / height;
        Mat4::from_cols(
            Vec4::new((2.0 * focal / width) as f32, 0.0, 0.0, 0.0),
            Vec4::new(0.0, (2.0 * focal / height) as f32, 0.0, 0.0),
            Vec4::new(-shift_x as f32, -shift_y as f32, 0.0, -1.0),
            Vec4::new(0.0, 0.0, NEAR_M, 0.0),
        )
    }

    fn get_clip_from_view_for_sub(&self, _: &SubCameraView) -> Mat4 {
        self.get_clip_from_view()
    }

    fn update(&mut self, _: f32, _: f32) {}

    fn far(&self) -> f32 {
        FAR_M
    }

    fn get_frustum_corners(&self, z_near: f32, z_far: f32) -> [Vec3A; 8] {
        let inverse = self.get_clip_from_view().inverse();
        let corner = |x: f32, y: f32, z: f32| {
            let ray = inverse.project_point3(Vec3::new(x, y, 0.5));
            Vec3A::from(ray * (z / ray.z))
        };
        [
            corner(1.0, -1.0, z_near),
            corner(1.0, 1.0, z_near),
            corner(-1.0, 1.0, z_near),
            corner(-1.0, -1.0, z_near),
            corner(1.0, -1.0, z_far),
            corner(1.0, 1.0, z_far),
            corner(-1.0, 1.0, z_far),
            corner(-1.0, -1.0, z_far),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::optics::camera::Pinhole;
    use glam::DVec3;

    #[test]
    fn window_and_full_frame_agree_with_the_pinhole() {
        let Ok(pinhole) = Pinhole::from_hfov(640, 480, 0.2) else {
            panic!("a usual field")
        };
        let r_cam_m = DVec3::new(3.0, -2.0, 100.0);
        let Some(px) = pinhole.project(r_cam_m) else {
            panic!("the point lies in front of the camera")
        };
        for (offset_px, size_px) in [([0, 0], [640, 480]), ([300, 100], [256, 256])] {
            let projection = SensorProjection {
                focal_px: pinhole.focal_px,
                sensor_px: [640, 480],
                offset_px,
                size_px,
            };
            // Bevy's view looks along -z with y up.
            let view = Vec3::new(r_cam_m.x as f32, -r_cam_m.y as f32, -r_cam_m.z as f32);
            let ndc = projection.get_clip_from_view().project_point3(view);
            let x = offset_px[0] as f32 + (ndc.x + 1.0) / 2.0 * size_px[0] as f32;
            let y = offset_px[1] as f32 + (1.0 - ndc.y) / 2.0 * size_px[1] as f32;
            assert!((x - px.x as f32).abs() < 1e-3, "{x} {}", px.x);
            assert!((y - px.y as f32).abs() < 1e-3, "{y} {}", px.y);
        }
    }
}
