//! Pictures and depths between two ticks, of any camera at any time. Nothing of the run changes.

use super::digits::{alpha_at, digit_of};
use super::expose::would_expose;
use super::image::{CaptureError, ImageScratch};
use super::render_each;
use super::shot::{Shot, draw};
use crate::components::capture::{Depth, DepthViews, ExposedFrame, Seen, SensorCamera, UavInFrame};
use crate::components::environment::Environment;
use crate::components::render::{SceneHandles, distance_m};
use crate::components::run::Kept;
use crate::models::ground::city::{Met, Standing};
use crate::systems::render::city_tiles::settle_city;
use crate::systems::render::renderer::{Renderer, keep_depth, spawn_sensor_view};
use bevy::prelude::*;
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Passes of the renderer until a view that has just been made shows something: one makes its target, one uploads it, one
/// draws into it.
const FIRST_PASSES: usize = 3;

/// What a camera would expose now, with its picture; none in a run that renders nothing.
pub fn photograph(
    world: &mut World,
    camera: Entity,
) -> Result<Option<Arc<ExposedFrame>>, CaptureError> {
    with_renderer(world, |world, renderer, scratch| {
        let Some(frame) = would_expose(world, camera) else {
            return Ok(None);
        };
        let mut frames = [Arc::new(frame)];
        render_each(world, renderer, scratch, &mut frames)?;
        let [frame] = frames;
        Ok(Some(frame))
    })
}

/// How far a camera sees in each pixel now, and what; none in a run that renders nothing.
pub fn measure_depth(world: &mut World, camera: Entity) -> Result<Option<Depth>, CaptureError> {
    with_renderer(world, |world, renderer, scratch| {
        let Some(frame) = would_expose(world, camera) else {
            return Ok(None);
        };
        let Some(sensor) = world.get::<SensorCamera>(camera).cloned() else {
            return Ok(None);
        };
        let (view, is_new) = view_of(world, &sensor);
        let shot = Shot::bare(sensor, view, frame.rect);
        settle_city(world);
        let mut digits = Vec::new();
        for _ in 0..if is_new { FIRST_PASSES } else { 1 } {
            digits = draw(world, renderer, &[&frame], std::slice::from_ref(&shot));
        }
        renderer.read(view, frame.rect.size_px, &mut scratch.pixels)?;
        let near = renderer.read_depth(view, frame.rect.size_px)?;
        let mut depth = Depth {
            tick: frame.tick,
            pinhole: frame.pinhole,
            pose: frame.pose,
            planar_m: near.iter().map(|near| distance_m(*near)).collect(),
            normals_enu: normals(&frame, &near),
            seen: Vec::new(),
        };
        depth.seen = name_all(world, &frame, &digits, &scratch.pixels, &depth);
        Ok(Some(depth))
    })
}

/// Does something with the renderer of a run that has one.
fn with_renderer<T>(
    world: &mut World,
    work: impl FnOnce(&mut World, &mut Renderer, &mut ImageScratch) -> Result<Option<T>, CaptureError>,
) -> Result<Option<T>, CaptureError> {
    let Some(mut renderer) = Kept::<Renderer>::take(world) else {
        return Ok(None);
    };
    let mut scratch = Kept::<ImageScratch>::take(world).unwrap_or_default();
    let worked = work(world, &mut renderer, &mut scratch);
    Kept::put(world, scratch);
    Kept::put(world, renderer);
    worked
}

/// The view that shows a camera's whole sensor with a sample a pixel, and whether it has just been made.
fn view_of(world: &mut World, camera: &SensorCamera) -> (Entity, bool) {
    let views = world.get_resource_or_init::<DepthViews>();
    if let Some(view) = views.views.get(&camera.index) {
        return (*view, false);
    }
    let site_grid = world.resource::<SceneHandles>().site_grid;
    let size_px = [camera.pinhole.width_px, camera.pinhole.height_px];
    let view = spawn_sensor_view(world, site_grid, size_px, 1);
    keep_depth(world, view);
    let mut views = world.resource_mut::<DepthViews>();
    views.views.insert(camera.index, view);
    (view, true)
}

/// The normal of the surface in each pixel, towards the camera, east, north, up; none of the sky's. On a plane the inverse of
/// the distance ahead is linear in the picture: of two neighbours, that counts behind which it goes on so.
fn normals(frame: &ExposedFrame, near: &[f32]) -> Vec<[f32; 3]> {
    let [width, height] = frame.rect.size_px.map(|n| n as usize);
    let at = |x: isize, y: isize| {
        let inside = (0..width as isize).contains(&x) && (0..height as isize).contains(&y);
        let near = inside.then(|| f64::from(near[y as usize * width + x as usize]));
        near.filter(|near| *near > 0.0)
    };
    // Change a pixel along an axis.
    let slope = |x: usize, y: usize, (dx, dy): (isize, isize)| {
        let (x, y) = (x as isize, y as isize);
        let here = at(x, y)?;
        let side = |sign: isize| {
            let next = at(x + sign * dx, y + sign * dy)?;
            let beyond = at(x + 2 * sign * dx, y + 2 * sign * dy);
            let bend = beyond.map_or(f64::MAX, |beyond| (beyond - 2.0 * next + here).abs());
            Some((bend, sign as f64 * (next - here)))
        };
        let sides = side(1).into_iter().chain(side(-1));
        let best = sides.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, slope)| slope)
    };
    let pinhole = &frame.pinhole;
    let mut normals = Vec::with_capacity(near.len());
    for y in 0..height {
        for x in 0..width {
            let here = f64::from(near[y * width + x]);
            let along = [slope(x, y, (1, 0)), slope(x, y, (0, 1))];
            let normal = if let [Some(right), Some(down)] = along {
                let ray = Depth::ray(pinhole, x, y);
                let slopes = DVec2::new(right, down) * pinhole.focal_px;
                let towards = -slopes.extend(here - slopes.dot(ray));
                (frame.pose.q_enu_cam * towards).normalize_or_zero()
            } else {
                DVec3::ZERO
            };
            normals.push(normal.as_vec3().to_array());
        }
    }
    normals
}

/// What is seen in each pixel.
fn name_all(
    world: &mut World,
    frame: &ExposedFrame,
    digits: &[u32],
    pixels: &[u8],
    depth: &Depth,
) -> Vec<Seen> {
    let city = world.resource::<Environment>().city.clone();
    let standing = &mut world.get_resource_or_init::<DepthViews>().standing;
    let standing = standing.get_or_insert_with(|| Arc::new(Standing::of(&city)));
    let beyond = |r: DVec3| city.dsm.surface().cell_index(r.x, r.y).is_none();
    let width = frame.rect.size_px[0] as usize;
    let named = (0..depth.planar_m.len()).map(|index| {
        let (x, y) = (index % width, index / width);
        let Some(r_enu_m) = depth.place_enu_m(x, y) else {
            return Seen::Sky;
        };
        let alpha = alpha_at(pixels, index).round() as u32;
        let range_m = r_enu_m.distance(frame.pose.r_enu_m);
        let apart_m = |seen: &UavInFrame| (seen.range_m - range_m).abs();
        // Four digits tell more than four objects apart where their boxes do not touch.
        let in_box = |seen: &&UavInFrame| {
            const MARGIN_PX: f64 = 1.0;
            let [x0, y0, x1, y1] = seen.box_px;
            let [x, y] = [x as f64, y as f64];
            let in_x = x >= x0.floor() - MARGIN_PX && x <= x1.ceil() + MARGIN_PX;
            let in_y = y >= y0.floor() - MARGIN_PX && y <= y1.ceil() + MARGIN_PX;
            in_x && in_y && digit_of(alpha, digits.get(seen.uav).copied().unwrap_or(0)) > 0
        };
        let flying = frame.truth.iter().filter(in_box);
        let nearest = flying.min_by(|a, b| apart_m(a).total_cmp(&apart_m(b)));
        match nearest {
            Some(seen) => Seen::Flying(seen.uav),
            None => match standing.met(&city, r_enu_m, REACH_M) {
                // The heights of the land around the city are not known there: what is level is land.
                Met::Solid(_) if beyond(r_enu_m) && depth.normals_enu[index][2] > LEVEL => {
                    Seen::City(Met::Ground)
                }
                met => Seen::City(met),
            },
        }
    });
    named.collect()
}

/// So far may the mesh of the ground, and of what stands on it, lie from what is known of them \[m\].
const REACH_M: f64 = 1.0;
/// Upward part of the normal of land \[1\]: hills are no steeper.
const LEVEL: f32 = 0.8;
