//! Rendering inside a tick: the render sub-app, driven by hand, and the synchronous readback.
//!
//! Bevy renders once per `App::update`, after the main world ran. A sensor frame must show the
//! very tick that asked for it, so the sub-app is taken out of the [`App`] and run from the
//! Capture set instead: main schedule (transforms, culling, assets), extraction, rendering,
//! copy, wait. Rejected: reading frames one update late (pose and picture of different ticks)
//! and an own wgpu renderer (a second set of meshes, cameras and shaders to keep in step).

use crate::components::render::{SENSOR_LAYER, SensorProjection, SensorViews};
use bevy::app::Main;
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{
    CameraOutputMode, Exposure, MsaaWriteback, NormalizedRenderTarget, RenderTarget,
};
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::ecs::schedule::{Schedules, SingleThreadedExecutor};
use bevy::light::cluster::ClusterConfig;
use bevy::prelude::*;
use bevy::render::camera::{ExtractedCamera, MipBias};
use bevy::render::render_asset::RenderAssets;
use bevy::render::render_resource::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor, Extent3d, MapMode, Origin3d,
    PollType, TexelCopyBufferInfo, TexelCopyBufferLayout, TexelCopyTextureInfo, Texture,
    TextureAspect, TextureFormat, TextureUsages,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::sync_world::MainEntity;
use bevy::render::texture::{GpuImage, OutputColorAttachment};
use bevy::render::view::{
    Msaa, NoIndirectDrawing, ViewDepthTexture, ViewTarget, ViewTargetAttachments,
};
use std::collections::BTreeMap;

/// The render sub-app, out of Bevy's own update loop.
pub struct Renderer {
    app: SubApp,
    /// One staging buffer a rectangle size and pixel [byte].
    staging: BTreeMap<([u32; 2], u32), Buffer>,
}

/// Why a frame could not be read back.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The camera has no rendered target.
    #[error(
        "the renderer delivered no picture: {0}; run again, or with --no-capture --set detector.kind=truth"
    )]
    NoPicture(&'static str),
    /// The GPU device failed.
    #[error(
        "the GPU device failed while a frame was read back: {0}; see its driver and its memory, or run with --no-capture --set detector.kind=truth"
    )]
    Device(String),
}

/// Bytes of a half-float RGBA pixel.
const PIXEL_BYTES: u32 = 8;
/// Bytes of a pixel of a depth buffer.
const DEPTH_BYTES: u32 = 4;

impl Renderer {
    /// Takes rendering over from `app`; `None` if the app was built without a renderer.
    pub fn take(app: &mut App) -> Option<Self> {
        let mut renderer = app.remove_sub_app(bevy::render::RenderApp)?;
        for world in [app.world_mut(), renderer.world_mut()] {
            run_on_one_thread(world);
        }
        Some(Self {
            app: renderer,
            staging: BTreeMap::new(),
        })
    }

    /// Runs Bevy's main schedule and renders every active camera.
    pub fn render(&mut self, world: &mut World) {
        world.run_schedule(Main);
        self.app.extract(world);
        self.app.update();
        world.clear_trackers();
    }

    /// The half-float RGBA pixels that the camera entity `camera` rendered: little-endian rows
    /// without padding.
    pub fn read(
        &mut self,
        camera: Entity,
        size_px: [u32; 2],
        out: &mut Vec<u8>,
    ) -> Result<(), RenderError> {
        out.clear();
        let world = self.app.world_mut();
        let mut views = world.query::<(&MainEntity, &ViewTarget)>();
        let texture = views
            .iter(world)
            .find(|(main, _)| main.id() == camera)
            .map(|(_, target)| target.main_texture().clone())
            .ok_or(RenderError::NoPicture("the camera was not rendered"))?;
        let aspect = TextureAspect::All;
        self.copy(&texture, (size_px, PIXEL_BYTES, aspect), |row| {
            out.extend_from_slice(row);
        })
    }

    /// What the depth buffer of the camera entity `camera` holds, row by row; of one that was made with
    /// [`keep_depth`], and has a sample a pixel.
    pub fn read_depth(
        &mut self,
        camera: Entity,
        size_px: [u32; 2],
    ) -> Result<Vec<f32>, RenderError> {
        let world = self.app.world_mut();
        let mut views = world.query::<(&MainEntity, &ViewDepthTexture)>();
        let texture = views
            .iter(world)
            .find(|(main, _)| main.id() == camera)
            .map(|(_, depth)| depth.texture.clone())
            .ok_or(RenderError::NoPicture("the camera has no depths"))?;
        let mut depths = Vec::new();
        let aspect = TextureAspect::DepthOnly;
        self.copy(&texture, (size_px, DEPTH_BYTES, aspect), |row| {
            let values = row.as_chunks().0.iter();
            depths.extend(values.map(|bytes| f32::from_le_bytes(*bytes)));
        })?;
        Ok(depths)
    }

    /// Copies a texture of so many pixels, of so many bytes each, to this side, and gives out its rows.
    fn copy(
        &mut self,
        texture: &Texture,
        ([width, height], pixel_bytes, aspect): ([u32; 2], u32, TextureAspect),
        mut each_row: impl FnMut(&[u8]),
    ) -> Result<(), RenderError> {
        let world = self.app.world();
        let device = world.resource::<RenderDevice>();
        let queue = world.resource::<RenderQueue>();
        let row = RenderDevice::align_copy_bytes_per_row((width * pixel_bytes) as usize) as u32;
        let kind = ([width, height], pixel_bytes);
        let staging = self.staging.entry(kind).or_insert_with(|| {
            device.create_buffer(&BufferDescriptor {
                label: Some("sensor readback"),
                size: u64::from(row * height),
                usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
        encoder.copy_texture_to_buffer(
            TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: Origin3d::ZERO,
                aspect,
            },
            TexelCopyBufferInfo {
                buffer: staging,
                layout: TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
        );
        queue.submit([encoder.finish()]);
        let slice = staging.slice(..);
        let (sender, receiver) = std::sync::mpsc::channel();
        slice.map_async(MapMode::Read, move |result| {
            // The receiver outlives the poll below.
            let _ = sender.send(result);
        });
        device
            .poll(PollType::wait_indefinitely())
            .map_err(|error| RenderError::Device(error.to_string()))?;
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(RenderError::Device(error.to_string())),
            Err(error) => return Err(RenderError::Device(error.to_string())),
        }
        let bytes = slice.get_mapped_range();
        for line in bytes.chunks_exact(row as usize) {
            each_row(&line[..(width * pixel_bytes) as usize]);
        }
        drop(bytes);
        staging.unmap();
        Ok(())
    }
}

/// Makes the depth buffer of a view readable; before its first picture.
pub fn keep_depth(world: &mut World, view: Entity) {
    if let Some(mut camera) = world.get_mut::<Camera3d>(view) {
        let usages = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
        camera.depth_texture_usages = usages.into();
    }
}

/// Takes the schedules of a world off the task pool: their systems take microseconds, handing one out
/// takes longer.
fn run_on_one_thread(world: &mut World) {
    if let Some(mut schedules) = world.get_resource_mut::<Schedules>() {
        for (_, schedule) in schedules.iter_mut() {
            schedule.set_executor(SingleThreadedExecutor::new());
        }
    }
}

/// Names an output for the cameras that write none: Bevy clears the main texture only of a camera that has
/// one.
pub fn attach_unwritten(
    images: Res<RenderAssets<GpuImage>>,
    cameras: Query<&ExtractedCamera>,
    mut attachments: ResMut<ViewTargetAttachments>,
) {
    for target in cameras.iter().filter_map(|camera| camera.target.as_ref()) {
        if let NormalizedRenderTarget::Image(image) = target
            && let Some(image) = images.get(&image.handle)
            && !attachments.contains_key(target)
        {
            let format = image.texture_descriptor.format;
            let output = OutputColorAttachment::new(image.texture_view.clone(), format);
            attachments.insert(target.clone(), output);
        }
    }
}

/// Renders with every sensor view until meshes, textures and pipelines have reached the GPU, so
/// that the first frame of a run is whole.
pub fn settle(world: &mut World, renderer: &mut Renderer) {
    // One pass creates the assets, one uploads them, one draws with them.
    const PASSES: usize = 3;
    let mut views = world.query::<&SensorViews>();
    let views: Vec<Entity> = views
        .iter(world)
        .flat_map(|views| {
            let whole = views.sizes.last().map(|(_, view)| *view);
            whole.into_iter().chain(views.magnifiers.iter().copied())
        })
        .collect();
    let activate = |world: &mut World, active: bool| {
        for view in &views {
            if let Some(mut camera) = world.get_mut::<Camera>(*view) {
                camera.is_active = active;
            }
        }
    };
    activate(world, true);
    for _ in 0..PASSES {
        renderer.render(world);
    }
    activate(world, false);
}

/// Spawns a camera that renders rectangles of one size off screen; inactive until asked.
pub fn spawn_sensor_view(
    world: &mut World,
    site_grid: Entity,
    [width, height]: [u32; 2],
    antialias: u32,
) -> Entity {
    let mut target = Image::new_target_texture(width, height, TextureFormat::Rgba16Float, None);
    target.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    let target = world.resource_mut::<Assets<Image>>().add(target);
    world
        .spawn((
            Camera3d::default(),
            Camera {
                is_active: false,
                // Black and nobody's: the sky is added afterwards. The picture is read from the main
                // texture: no copy to the target is paid for.
                clear_color: ClearColorConfig::Custom(Color::NONE),
                output_mode: CameraOutputMode::Skip,
                msaa_writeback: MsaaWriteback::Off,
                ..default()
            },
            RenderTarget::Image(target.into()),
            // Set anew at every exposure.
            Projection::custom(SensorProjection {
                focal_px: f64::from(width),
                sensor_px: [width, height],
                offset_px: [0, 0],
                size_px: [width, height],
            }),
            if antialias > 1 {
                Msaa::Sample4
            } else {
                Msaa::Off
            },
            // Luminance reaches the texture unscaled: exposure is the sensor model's.
            Exposure {
                ev100: -(1.2f32.log2()),
            },
            Tonemapping::None,
            NoIndirectDrawing,
            ClusterConfig::Single,
            RenderLayers::from_layers(&[0, SENSOR_LAYER]),
            Transform::default(),
            Visibility::default(),
            ChildOf(site_grid),
        ))
        .id()
}

/// Points a sensor view at a rectangle of its sensor, whose exposure smears what turns for `smeared_s` [s].
pub fn aim_sensor_view(
    world: &mut World,
    view: Entity,
    projection: SensorProjection,
    at: impl Bundle,
    smeared_s: f64,
) {
    let mut entity = world.entity_mut(view);
    // No texture is chosen by a bias here: its place in the view's uniform carries the exposure.
    let exposure = MipBias(smeared_s as f32);
    entity.insert((Projection::custom(projection), at, exposure));
    if let Some(mut camera) = entity.get_mut::<Camera>() {
        camera.is_active = true;
    }
}
