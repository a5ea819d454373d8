//! Cameras that are due expose: truth, picture and pose of one tick.

use crate::components::capture::{
    AutoExposure, CameraOf, ExposedFrame, Exposures, Frames, PixelRect, Readout, RenderedTruth,
    SensorCamera, UavInFrame,
};
use crate::components::detect::region_px;
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, Uav, UavShape};
use crate::components::mount::{Boresight, CameraView};
use crate::components::render::{
    DIGIT_OF_TAG, SensorProjection, SensorViews, Solids, UavBody, UavRotor,
};
use crate::components::run::{Failure, Seed, SimClock, Stopwatch};
use crate::models::bodies::Rotors;
use crate::models::bodies::raster::{self, Coverage};
use crate::models::ground::dsm::LineOfSight;
use crate::models::ground::skyline::Skyline;
use crate::models::maths::kinematics::Pose;
use crate::models::optics::background::{Background, open_share};
use crate::models::optics::camera::Pinhole;
use crate::models::optics::sensor::{self, Scratch};
use crate::systems::render::city_tiles::settle_city;
use crate::systems::render::renderer::{RenderError, Renderer, aim_sensor_view, spawn_sensor_view};
use crate::systems::render::scene::{bevy_attitude, place_in_site, sync_scene};
use bevy::ecs::query::QueryData;
use bevy::mesh::MeshTag;
use bevy::prelude::*;
use bevy::tasks::ComputeTaskPool;
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::borrow::Borrow;
use std::sync::Arc;
use std::time::Instant;

pub mod conditions;
pub mod metering;

/// Why an exposed frame has no picture.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The frame could not be read back.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The sensor model refused the frame.
    #[error(transparent)]
    Sensor(#[from] sensor::SensorError),
}

/// The surroundings of something that flies and is too small for four samples a pixel: an airframe of three pixels is
/// all thin arms and legs, and its centroid would be off by a third of a pixel. They are rendered
/// [`MAGNIFY`] times enlarged and, where they show it, averaged into the frame. Birds as well as UAVs: no sort of thing must
/// be told by the renderer's samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    /// Scenario index of what is small.
    pub(crate) uav: usize,
    /// Where the patch lies on the sensor.
    pub(crate) rect: PixelRect,
}

/// Enlargement of a patch.
pub const MAGNIFY: u32 = 8;
/// Samples of an enlarged pixel.
pub const MAGNIFIED_SAMPLES: u32 = 4;
/// Side of a patch [px].
pub const PATCH_PX: u32 = 16;
/// Most patches of a frame: what is small beyond them has four samples a pixel.
pub const PATCHES: usize = 7;
/// What has a box smaller than this gets a patch [px]: the patch holds the box with a margin.
const SMALL_PX: f64 = 8.0;

/// A patch's camera: the same sensor with [`MAGNIFY`] times the pixels.
pub fn magnified(pinhole: &Pinhole) -> Pinhole {
    Pinhole {
        width_px: MAGNIFY * pinhole.width_px,
        height_px: MAGNIFY * pinhole.height_px,
        focal_px: f64::from(MAGNIFY) * pinhole.focal_px,
    }
}

impl Patch {
    /// A patch about everything that is small in a frame, UAVs first, the nearest before others.
    fn all(frame: &ExposedFrame) -> Vec<Self> {
        let small = |seen: &&UavInFrame| {
            let [x0, y0, x1, y1] = seen.box_px;
            (x1 - x0).max(y1 - y0) < SMALL_PX
        };
        let mut small: Vec<_> = frame.truth.iter().filter(small).collect();
        small.sort_by(|a, b| {
            let order = a.distractor.cmp(&b.distractor);
            order.then(a.range_m.total_cmp(&b.range_m))
        });
        (small.into_iter())
            .filter_map(|seen| Self::about(frame, seen))
            .collect()
    }

    fn about(frame: &ExposedFrame, nearest: &UavInFrame) -> Option<Self> {
        let [x0, y0, x1, y1] = nearest.box_px;
        let centre = [0.5 * (x0 + x1), 0.5 * (y0 + y1)];
        let mut offset_px = [0; 2];
        for i in 0..2 {
            let low = f64::from(frame.rect.offset_px[i]);
            let high = low + f64::from(frame.rect.size_px[i]) - f64::from(PATCH_PX);
            let at = (centre[i] - 0.5 * f64::from(PATCH_PX)).round();
            if high < low || at < low || at > high {
                return None;
            }
            offset_px[i] = at as u32;
        }
        Some(Self {
            uav: nearest.uav,
            rect: PixelRect {
                offset_px,
                size_px: [PATCH_PX; 2],
            },
        })
    }

    /// The patch on the magnified sensor.
    fn magnified_rect(&self) -> PixelRect {
        PixelRect {
            offset_px: self.rect.offset_px.map(|x| MAGNIFY * x),
            size_px: [MAGNIFY * PATCH_PX; 2],
        }
    }

    /// Averages the enlarged pixels into those of the frame that show the UAV of identity `digit`, and adds the `sky` that the
    /// frame has there; identities stay as they are, and so does all around it: scenery sampled more finely than the rest
    /// would tell where the UAV is.
    fn blend(
        &self,
        enlarged: &[u8],
        sky: &[u8],
        digit: u32,
        into: (PixelRect, u32),
        out: &mut [u8],
    ) {
        let (frame, samples) = into;
        let side = (MAGNIFY * PATCH_PX) as usize;
        let value = |bytes: &[u8]| half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
        let [column, row] = [0, 1].map(|i| (self.rect.offset_px[i] - frame.offset_px[i]) as usize);
        let width = frame.size_px[0] as usize;
        for y in 0..PATCH_PX as usize {
            for x in 0..PATCH_PX as usize {
                let (mut rgb, mut open) = ([0.0; 3], 0.0);
                let at = (row + y) * width + column + x;
                let mut shown = shows(alpha_at(out, at), samples, digit);
                for row in y * MAGNIFY as usize..(y + 1) * MAGNIFY as usize {
                    let first = 8 * (row * side + x * MAGNIFY as usize);
                    for pixel in enlarged[first..first + 8 * MAGNIFY as usize].chunks_exact(8) {
                        for (channel, sum) in rgb.iter_mut().enumerate() {
                            *sum += value(&pixel[2 * channel..]);
                        }
                        let alpha = value(&pixel[6..]);
                        open += open_share(alpha, MAGNIFIED_SAMPLES);
                        shown |= shows(alpha.into(), MAGNIFIED_SAMPLES, digit);
                    }
                }
                if !shown {
                    continue;
                }
                let sky = &sky[8 * (y * PATCH_PX as usize + x)..];
                for (channel, sum) in rgb.iter().enumerate() {
                    let sum = sum + open * value(&sky[2 * channel..]);
                    let mean = half::f16::from_f32(sum / (MAGNIFY * MAGNIFY) as f32);
                    let at = 8 * at + 2 * channel;
                    out[at..at + 2].copy_from_slice(&mean.to_le_bytes());
                }
            }
        }
    }
}

/// A camera as it exposes.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Exposing {
    entity: Entity,
    of: &'static CameraOf,
    camera: &'static SensorCamera,
    readout: &'static Readout,
    view: &'static CameraView,
    boresight: &'static Boresight,
    exposures: &'static mut Exposures,
    auto: &'static mut AutoExposure,
}

/// Opens the shutter of every camera that is due: pose, rectangle and geometric truth.
pub fn expose(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut cameras: Query<Exposing>,
    uavs: Query<(&Uav, &Flight, &UavShape, Has<Distractor>)>,
    mut frames: ResMut<Frames>,
) {
    frames.0.clear();
    for camera in &mut cameras {
        let ExposingItem {
            entity,
            of,
            camera,
            readout,
            view,
            boresight,
            mut exposures,
            mut auto,
        } = camera;
        let Some(rect) = read_out(camera, readout) else {
            continue;
        };
        if !clock.tick.is_multiple_of(camera.period_ticks) {
            continue;
        }
        let pose = view.pose;
        let mut truth: Vec<_> = uavs
            .iter()
            .filter_map(|(uav, flight, shape, distractor)| {
                let mut seen = projected(&camera.pinhole, &pose, flight, shape)?;
                let sight = environment.line_of_sight(pose.r_enu_m, flight.aim_enu_m());
                seen.uav = uav.index;
                seen.distractor = distractor;
                seen.clear = sight == LineOfSight::Clear;
                Some(seen)
            })
            .collect();
        truth.sort_by_key(|seen| seen.uav);
        let now = (clock.tick, clock.dt_s());
        let motion = conditions::image_motion(
            &camera.pinhole,
            &pose,
            view.q_before_enu_cam,
            now.1,
            &truth,
            |index| {
                let (_, flight, ..) = uavs.iter().find(|(uav, ..)| uav.index == index)?;
                Some((flight.aim_enu_m(), flight.state.v_enu_mps))
            },
        );
        let conditions =
            conditions::conditions(&mut auto, camera, &environment, &pose, now, motion);
        frames.0.push(Arc::new(ExposedFrame {
            camera: entity,
            station: of.0,
            index: camera.index,
            name: camera.name.clone(),
            tier: camera.tier,
            pinhole: camera.pinhole,
            tick: clock.tick,
            number: exposures.0,
            pose: view.pose,
            believed: view.believed,
            boresight: *boresight,
            rect,
            conditions,
            truth,
            rgb8: None,
        }));
        exposures.0 += 1;
    }
    // A plugin's own components may change the order in which queries meet the cameras.
    frames.0.sort_by_key(|frame| frame.index);
}

/// The pixels that a camera reads out; none while it idles.
fn read_out(camera: &SensorCamera, readout: &Readout) -> Option<PixelRect> {
    let sensor_px = [camera.pinhole.width_px, camera.pinhole.height_px];
    match (readout, camera.window_px) {
        (Readout::Off, _) => None,
        // What is too large for the window is read in full.
        (
            Readout::Around {
                centre_px,
                target_px,
            },
            Some(side),
        ) if region_px(*target_px, side) == side => {
            Some(PixelRect::window(sensor_px, *centre_px, side))
        }
        _ => Some(PixelRect {
            offset_px: [0, 0],
            size_px: sensor_px,
        }),
    }
}

/// What a camera would see of a UAV if nothing stood before it; without its identity.
pub fn projected(
    pinhole: &Pinhole,
    pose: &Pose,
    flight: &Flight,
    shape: &UavShape,
) -> Option<UavInFrame> {
    let body = (flight.state.r_enu_m, flight.state.q_enu_body);
    let box_px = projected_box(pinhole, pose, body, shape)?;
    let to_target_m = flight.aim_enu_m() - pose.r_enu_m;
    let aim_px = pinhole.project(pose.q_enu_cam.inverse() * to_target_m)?;
    Some(UavInFrame {
        uav: 0,
        distractor: false,
        box_px,
        aim_px: aim_px.to_array(),
        range_m: to_target_m.length(),
        clear: true,
        rendered: None,
    })
}

/// The box around the projection of a UAV's airframe and rotor discs [px]; `None` if it is not
/// wholly in front of the camera or misses the sensor.
fn projected_box(
    pinhole: &Pinhole,
    pose: &Pose,
    (r_enu_m, q_enu_body): (DVec3, DQuat),
    shape: &UavShape,
) -> Option<[f64; 4]> {
    let q_cam_enu = pose.q_enu_cam.inverse();
    let r_cam_m = q_cam_enu * (r_enu_m - pose.r_enu_m);
    let radius_m = shape.radius_m;
    if r_cam_m.z <= radius_m {
        return None;
    }
    // Off the sensor by more than its own size: no vertex needs projecting.
    let centre = pinhole.project(r_cam_m)?;
    let reach_px = 2.0 * pinhole.focal_px * radius_m / (r_cam_m.z - radius_m);
    let (width, height) = (f64::from(pinhole.width_px), f64::from(pinhole.height_px));
    let outside = |x: f64, side: f64| x < -reach_px || x > side + reach_px;
    if outside(centre.x, width) || outside(centre.y, height) {
        return None;
    }
    let to_cam = DMat3::from_quat(q_cam_enu * q_enu_body);
    let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
    for corner_body_m in &shape.outline_body_m {
        let px = pinhole.project(r_cam_m + to_cam * *corner_body_m)?;
        low = low.min(px);
        high = high.max(px);
    }
    (high.x > 0.0 && high.y > 0.0 && low.x < width && low.y < height)
        .then_some([low.x, low.y, high.x, high.y])
}

/// Spawns the cameras that enlarge what is small in a sensor's frames.
pub fn spawn_magnifiers(world: &mut World, site_grid: Entity) -> Vec<Entity> {
    let size_px = [MAGNIFY * PATCH_PX; 2];
    let view = |_| spawn_sensor_view(world, site_grid, size_px, MAGNIFIED_SAMPLES);
    (0..PATCHES).map(view).collect()
}

/// What image formation keeps between frames.
#[derive(Default)]
pub struct ImageScratch {
    /// The frame: rows of half-float RGBA.
    pub(crate) pixels: Vec<u8>,
    /// The part of it that was rendered.
    part: Vec<u8>,
    /// Its enlarged patches.
    pub(crate) enlarged: [Vec<u8>; PATCHES],
    /// Scratch of each strip of rows.
    strips: [Scratch; STRIPS],
}

/// Strips of rows that are exposed side by side; the noise does not depend on their number.
const STRIPS: usize = 4;

/// Renders the exposed frames, if this run renders at all.
pub fn render_frames(world: &mut World) {
    if world.resource::<Frames>().0.is_empty() || !world.contains_non_send::<Renderer>() {
        return;
    }
    let started = Instant::now();
    if let Some(mut renderer) = world.remove_non_send::<Renderer>() {
        let mut scratch = world.remove_non_send::<ImageScratch>().unwrap_or_default();
        let result = render_with(world, &mut renderer, &mut scratch);
        world.insert_non_send(scratch);
        world.insert_non_send(renderer);
        if let Err(error) = result {
            world.resource_mut::<Failure>().set(error);
        }
    }
    world.resource_mut::<Stopwatch>().render += started.elapsed();
}

fn render_with(
    world: &mut World,
    renderer: &mut Renderer,
    scratch: &mut ImageScratch,
) -> Result<(), CaptureError> {
    settle_city(world);
    let mut frames = std::mem::take(&mut world.resource_mut::<Frames>().0);
    let mut cameras = world.query::<(&SensorCamera, &SensorViews)>();
    let shots: Vec<_> = frames
        .iter()
        .filter_map(|frame| {
            let (camera, views) = cameras.get(world, frame.camera).ok()?;
            let solids = world.get(frame.station);
            Some(Shot::new(frame, camera.clone(), views, solids))
        })
        .collect();
    let digits = draw(world, renderer, &frames, &shots);
    let seed = *world.resource::<Seed>();
    for (frame, shot) in frames.iter_mut().zip(&shots) {
        // Nobody else holds a frame before the tick goes on: nothing is copied.
        let frame = Arc::make_mut(frame);
        read(world, renderer, frame, shot, &digits, scratch)?;
        let key = seed.stream(frame.tick, &frame.name).bits();
        let rgb8 = form_image(frame, &shot.camera.sensor, key, scratch)?;
        frame.rgb8 = Some(Arc::new(rgb8));
    }
    world.resource_mut::<Frames>().0 = frames;
    Ok(())
}

/// What renders one frame.
pub(crate) struct Shot {
    pub(crate) camera: SensorCamera,
    /// The view that renders the part with something solid in it, and that part; `None`: all is sky.
    view: Option<(Entity, PixelRect)>,
    /// What is small in the frame, and the views that enlarge it.
    pub(crate) patches: Vec<(Patch, Entity)>,
}

impl Shot {
    /// The view of `views` that shows what is solid of `frame`, and what is to be enlarged in it.
    pub(crate) fn new(
        frame: &ExposedFrame,
        camera: SensorCamera,
        views: &SensorViews,
        solids: Option<&Solids>,
    ) -> Self {
        let solid = match solids {
            Some(Solids(skyline)) => solid_part(frame, &camera.pinhole, skyline),
            None => Some(frame.rect),
        };
        Self {
            view: solid.and_then(|solid| views.around(solid, frame.rect)),
            patches: (Patch::all(frame).into_iter())
                .zip(views.magnifiers.iter().copied())
                .collect(),
            camera,
        }
    }
}

/// The part of a frame outside of which there is only sky: what lies below the skyline, and the boxes of
/// all that flies.
fn solid_part(frame: &ExposedFrame, pinhole: &Pinhole, skyline: &Skyline) -> Option<PixelRect> {
    const MARGIN_PX: f64 = 2.0;
    let PixelRect { offset_px, size_px } = frame.rect;
    let pose = (frame.pose.r_enu_m, frame.pose.q_enu_cam);
    let row = skyline.first_row(pinhole, pose, frame.rect);
    // Corners in the rectangle: lower and upper end.
    let ground = (row < size_px[1]).then_some([[0, row], size_px]);
    let flying = frame.truth.iter().filter_map(|seen| {
        let [x0, y0, x1, y1] = seen.box_px;
        let part = |i: usize, low: f64, high: f64| {
            let local = |x: f64| (x - f64::from(offset_px[i])).clamp(0.0, f64::from(size_px[i]));
            let [low, high] = [
                local(low - MARGIN_PX).floor(),
                local(high + MARGIN_PX).ceil(),
            ];
            (low < high).then_some([low as u32, high as u32])
        };
        let ([left, right], [top, bottom]) = (part(0, x0, x1)?, part(1, y0, y1)?);
        Some([[left, top], [right, bottom]])
    });
    let union = flying.chain(ground).reduce(|a, b| {
        let pick = |k: usize, of: fn(u32, u32) -> u32| [0, 1].map(|i| of(a[k][i], b[k][i]));
        [pick(0, u32::min), pick(1, u32::max)]
    });
    union.map(|[low, high]| PixelRect {
        offset_px: [0, 1].map(|i| offset_px[i] + low[i]),
        size_px: [0, 1].map(|i| high[i] - low[i]),
    })
}

/// Renders `frames` as `shots` say; the digits by which the UAVs are told apart, by their index.
pub(crate) fn draw(
    world: &mut World,
    renderer: &mut Renderer,
    frames: &[impl Borrow<ExposedFrame>],
    shots: &[Shot],
) -> Vec<u32> {
    sync_scene(world);
    let digits = assign_digits(frames);
    let mut tagged = world.query::<(AnyOf<(&UavBody, &UavRotor)>, &mut MeshTag)>();
    for ((body, rotor), mut tag) in tagged.iter_mut(world) {
        let uav = body.map(|b| b.0).or(rotor.map(|r| r.uav));
        let digit = uav.and_then(|uav| digits.get(uav)).copied().unwrap_or(0);
        let digit = tag.0 & !DIGIT_OF_TAG | digit;
        tag.set_if_neq(MeshTag(digit));
    }
    for (frame, shot) in frames.iter().map(Borrow::borrow).zip(shots) {
        let pinhole = &shot.camera.pinhole;
        let smeared_s = shot.camera.sensor.smeared_s(&frame.conditions.exposure);
        let at = place_in_site(frame.pose.r_enu_m, bevy_attitude(frame.pose.q_enu_cam));
        if let Some((view, rect)) = shot.view {
            aim_sensor_view(world, view, projection(pinhole, rect), at, smeared_s);
        }
        for (patch, magnifier) in &shot.patches {
            let projection = projection(&magnified(pinhole), patch.magnified_rect());
            aim_sensor_view(world, *magnifier, projection, at, smeared_s);
        }
    }
    let active = |shot: &Shot| {
        let magnifiers = shot.patches.iter().map(|(_, view)| *view);
        let view = shot.view.map(|(view, _)| view);
        view.into_iter().chain(magnifiers).collect::<Vec<_>>()
    };
    if shots.iter().flat_map(active).next().is_some() {
        renderer.render(world);
    }
    for view in shots.iter().flat_map(active) {
        if let Some(mut view) = world.get_mut::<Camera>(view) {
            view.is_active = false;
        }
    }
    digits
}

/// Reads a frame that [`draw`] rendered: its truth, and its pixels into `scratch`.
pub(crate) fn read(
    world: &mut World,
    renderer: &mut Renderer,
    frame: &mut ExposedFrame,
    shot: &Shot,
    digits: &[u32],
    scratch: &mut ImageScratch,
) -> Result<(), CaptureError> {
    let camera = &shot.camera;
    let (pinhole, rect) = (camera.pinhole, frame.rect);
    scratch.pixels.clear();
    scratch
        .pixels
        .resize(8 * (rect.size_px[0] * rect.size_px[1]) as usize, 0);
    if let Some((view, part)) = shot.view {
        renderer.read(view, part.size_px, &mut scratch.part)?;
        paste(&scratch.part, part, rect, &mut scratch.pixels);
    }
    let samples = camera.antialias;
    add_sky(world, frame, (pinhole, rect, samples), &mut scratch.pixels);
    count_identities(world, frame, camera, digits, &scratch.pixels, None);
    let patches = shot.patches.iter().zip(&mut scratch.enlarged);
    for ((patch, magnifier), enlarged) in patches {
        renderer.read(*magnifier, patch.magnified_rect().size_px, enlarged)?;
        count_identities(world, frame, camera, digits, enlarged, Some(patch));
        let mut sky = vec![0; 8 * (PATCH_PX * PATCH_PX) as usize];
        background(world, frame, (pinhole, patch.rect, samples)).fill(0, &mut sky);
        let (digit, into) = (digits[patch.uav], (rect, samples));
        patch.blend(enlarged, &sky, digit, into, &mut scratch.pixels);
    }
    Ok(())
}

/// Puts the pixels of a part of a frame at their place.
fn paste(pixels: &[u8], part: PixelRect, frame: PixelRect, out: &mut [u8]) {
    let [left, top] = [0, 1].map(|i| (part.offset_px[i] - frame.offset_px[i]) as usize);
    let length = 8 * part.size_px[0] as usize;
    let rows = out
        .chunks_exact_mut(8 * frame.size_px[0] as usize)
        .skip(top);
    for (row, line) in rows.zip(pixels.chunks_exact(length)) {
        row[8 * left..8 * left + length].copy_from_slice(line);
    }
}

/// The sky behind a rectangle of a sensor, seen with so many samples a pixel.
fn background<'a>(
    world: &'a World,
    frame: &ExposedFrame,
    (pinhole, rect, samples): (Pinhole, PixelRect, u32),
) -> Background<'a> {
    Background {
        backdrop: &world.resource::<Environment>().backdrop,
        pinhole,
        q_enu_cam: frame.pose.q_enu_cam,
        rect,
        samples,
    }
}

/// Adds the sky to the rendered rectangle of a sensor.
fn add_sky(
    world: &World,
    frame: &ExposedFrame,
    view: (Pinhole, PixelRect, u32),
    pixels: &mut [u8],
) {
    let background = background(world, frame, view);
    let [width, height] = view.1.size_px.map(|n| n as usize);
    let strip = height.div_ceil(STRIPS);
    ComputeTaskPool::get().scope(|scope| {
        for (i, rows) in pixels.chunks_mut(8 * width * strip).enumerate() {
            scope.spawn(async move { background.fill(i * strip, rows) });
        }
    });
}

/// The projection that renders a rectangle of a sensor.
fn projection(pinhole: &Pinhole, rect: PixelRect) -> SensorProjection {
    SensorProjection {
        focal_px: pinhole.focal_px,
        sensor_px: [pinhole.width_px, pinhole.height_px],
        offset_px: rect.offset_px,
        size_px: rect.size_px,
    }
}

/// The sensor's 8-bit picture of a rendered frame.
pub(crate) fn form_image(
    frame: &ExposedFrame,
    sensor: &sensor::Sensor,
    key: u64,
    scratch: &mut ImageScratch,
) -> Result<Vec<u8>, sensor::SensorError> {
    let [width, height] = frame.rect.size_px.map(|n| n as usize);
    let mut rgb8 = vec![0; 3 * width * height];
    let rendered = sensor::RenderedFrame {
        rgba16f: &scratch.pixels,
        width,
        height,
        origin_px: frame.rect.offset_px,
        conditions: &frame.conditions,
    };
    let strip = height.div_ceil(STRIPS);
    let results = ComputeTaskPool::get().scope(|scope| {
        let parts = rgb8.chunks_mut(3 * width * strip).zip(&mut scratch.strips);
        for (i, (part, scratch)) in parts.enumerate() {
            let rows = i * strip..height.min((i + 1) * strip);
            scope.spawn(async move { sensor.expose(&rendered, rows, key, scratch, part) });
        }
    });
    results.into_iter().collect::<Result<(), _>>()?;
    Ok(rgb8)
}

/// Alpha of a pixel of half-float RGBA rows.
pub(crate) fn alpha_at(pixels: &[u8], index: usize) -> f64 {
    half::f16::from_le_bytes([pixels[8 * index + 6], pixels[8 * index + 7]]).to_f64()
}

/// Identities a pixel can hold apart: base-5 digits of an integer, above the one that counts the covered
/// samples, that a half float keeps exact after the average over four samples: quarters up to 512, and
/// beyond that only the whole number of four samples of the last identity.
pub const DIGITS: u32 = 4;

/// A digit (1 to [`DIGITS`]) for every UAV, so that UAVs whose boxes touch in any frame differ
/// where four digits allow it; the closer one is served first.
fn assign_digits(frames: &[impl Borrow<ExposedFrame>]) -> Vec<u32> {
    let frames: Vec<&ExposedFrame> = frames.iter().map(Borrow::borrow).collect();
    let count = frames
        .iter()
        .flat_map(|f| &f.truth)
        .map(|s| s.uav + 1)
        .max()
        .unwrap_or(0);
    let mut digits = vec![0; count];
    let mut order: Vec<_> = frames
        .iter()
        .flat_map(|f| &f.truth)
        .map(|s| (s.range_m, s.uav))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (_, uav) in order {
        if digits[uav] != 0 {
            continue;
        }
        let taken: Vec<u32> = frames
            .iter()
            .flat_map(|frame| {
                let own = frame.truth.iter().find(|s| s.uav == uav);
                frame
                    .truth
                    .iter()
                    .filter(move |s| own.is_some_and(|own| touch(&own.box_px, &s.box_px)))
            })
            .map(|s| digits[s.uav])
            .collect();
        digits[uav] = (1..=DIGITS)
            .find(|digit| !taken.contains(digit))
            .unwrap_or(1 + uav as u32 % DIGITS);
    }
    digits
}

/// Whether two boxes touch, with a margin for the pixels at their edges.
fn touch(a: &[f64; 4], b: &[f64; 4]) -> bool {
    const MARGIN_PX: f64 = 2.0;
    a[0] <= b[2] + MARGIN_PX
        && b[0] <= a[2] + MARGIN_PX
        && a[1] <= b[3] + MARGIN_PX
        && b[1] <= a[3] + MARGIN_PX
}

/// Fills in the truth that the identity samples of a rendered frame, or of a patch of it, tell.
fn count_identities(
    world: &mut World,
    frame: &mut ExposedFrame,
    camera: &SensorCamera,
    digits: &[u32],
    pixels: &[u8],
    patch: Option<&Patch>,
) {
    let (pinhole, rect, scale, antialias) = match patch {
        None => (camera.pinhole, frame.rect, 1.0, camera.antialias),
        Some(patch) => {
            let (pinhole, rect) = (magnified(&camera.pinhole), patch.magnified_rect());
            (pinhole, rect, f64::from(MAGNIFY), MAGNIFIED_SAMPLES)
        }
    };
    let mut uavs = world.query::<(&Uav, &Flight, &UavShape)>();
    let samples = f64::from(antialias);
    let [width, height] = rect.size_px;
    let [left, top] = rect.offset_px;
    for seen in &mut frame.truth {
        if patch.is_some_and(|patch| patch.uav != seen.uav) {
            continue;
        }
        let Some((_, flight, shape)) = uavs.iter(world).find(|(uav, ..)| uav.index == seen.uav)
        else {
            continue;
        };
        let mut visible = Coverage::default();
        // Every sample of the UAV lies in the box of its projection, a pixel more for rounding.
        let [x0, y0, x1, y1] = seen.box_px.map(|px| scale * px);
        let clip = |low: f64, high: f64, offset: u32, size: u32| {
            let local = |x: f64| (x - f64::from(offset)).clamp(0.0, f64::from(size)) as u32;
            local(low.floor() - 1.0)..local(high.ceil() + 1.0)
        };
        for y in clip(y0, y1, top, height) {
            for x in clip(x0, x1, left, width) {
                let alpha = alpha_at(pixels, (y * width + x) as usize);
                let count = digit_of((alpha * samples).round() as u32, digits[seen.uav]);
                visible.add(left + x, top + y, f64::from(count));
            }
        }
        let state = &flight.state;
        let whole = raster::sampled_silhouette(
            &pinhole,
            &frame.pose,
            (state.r_enu_m, state.q_enu_body),
            Rotors::of(state, camera.sensor.smeared_s(&frame.conditions.exposure)),
            &shape.mesh,
            rect,
            antialias,
        )
        .coverage();
        seen.rendered = Some(RenderedTruth {
            box_px: visible.box_px().map(|px| px.map(|x| x / scale)),
            centroid_px: visible.centroid_px().map(|px| px.map(|x| x / scale)),
            visible_fraction: if whole.samples > 0.0 {
                (visible.samples / whole.samples).min(1.0)
            } else {
                0.0
            },
        });
    }
}

/// Whether a pixel with a mean alpha over so many samples shows the UAV of a digit.
fn shows(alpha: f64, samples: u32, digit: u32) -> bool {
    digit_of((alpha * f64::from(samples)).round() as u32, digit) > 0
}

/// How many samples of a pixel belong to a digit, given their base-5 sum.
pub(crate) fn digit_of(sum: u32, digit: u32) -> u32 {
    if digit == 0 {
        0
    } else {
        sum / 5u32.pow(digit) % 5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_survive_the_resolve() {
        // Every way in which four samples meet sky, scenery and four identities, averaged and stored as
        // a half float.
        let alpha = [0, 1, 6, 26, 126, 626];
        for code in 0..6_usize.pow(4) {
            let samples = [1, 6, 36, 216].map(|place| code / place % 6);
            let sum: u32 = samples.iter().map(|kind| alpha[*kind]).sum();
            let stored = half::f16::from_f64(f64::from(sum) / 4.0).to_f64() * 4.0;
            let count = |kind: usize| samples.iter().filter(|k| **k == kind).count() as u32;
            for digit in 1..=DIGITS {
                let counted = digit_of(stored.round() as u32, digit);
                assert_eq!(counted, count(digit as usize + 1), "{samples:?}");
            }
            assert_eq!(stored.round() as u32 % 5, (4 - count(0)) % 5);
        }
    }

    #[test]
    fn what_lies_around_an_enlarged_uav_stays_as_it_is() {
        let rgba = |rgb: f32, alpha: f32| {
            [rgb, rgb, rgb, alpha].map(|value| half::f16::from_f32(value).to_le_bytes())
        };
        let rect = |offset_px, size_px| PixelRect { offset_px, size_px };
        let frame = rect([8, 4], [32, 24]);
        let patch = Patch {
            uav: 0,
            rect: rect([16, 9], [PATCH_PX; 2]),
        };
        let mut pixels = rgba(0.625, 0.0).as_flattened().repeat(32 * 24);
        let sky = rgba(0.75, 0.0).as_flattened().repeat(256);
        // Scenery everywhere but in one pixel: there the UAV fills the left half, and the right is open.
        let [column, row] = [3, 5];
        let side = MAGNIFY * PATCH_PX;
        let mut enlarged = Vec::new();
        for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
            let pixel = match (x / MAGNIFY == column && y / MAGNIFY == row, x % MAGNIFY < 4) {
                (false, _) => rgba(0.125, 1.0),
                (true, true) => rgba(0.25, 26.0),
                (true, false) => rgba(0.0, 0.0),
            };
            enlarged.extend(pixel.as_flattened());
        }
        patch.blend(&enlarged, &sky, 2, (frame, 4), &mut pixels);
        let at = ((9 - 4 + row) * 32 + 16 - 8 + column) as usize;
        for (index, pixel) in pixels.chunks_exact(8).enumerate() {
            let expected = rgba(
                if index == at {
                    0.5 * (0.25 + 0.75)
                } else {
                    0.625
                },
                0.0,
            );
            assert_eq!(pixel, expected.as_flattened(), "{index}");
        }
    }
}
