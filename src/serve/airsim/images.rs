//! Pictures of the stations' cameras, as they would expose now, and what belongs to them.

use super::answers::{Answer, Fault, time_ns};
use super::names;
use super::session::Session;
use crate::models::optics::camera::Pinhole;
use crate::simulation::{Depth, Frame, FrameView, Seen, View};
use boresight_airsim::arguments::{flag, of_map, text, whole};
use boresight_airsim::frames::{camera_attitude, swapped};
use boresight_airsim::messages::{self, Image, Pixels};
use boresight_airsim::{Arguments, Value};
use glam::DVec3;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::sync::Arc;

/// Pictures of one call.
const MOST_PICTURES: usize = 64;
/// What stands for the distance of the sky \[m\]: the largest that a half float holds, for a client cannot calculate with an
/// infinite one.
const SKY_M: f32 = 65_504.0;
/// The distance that is white in `DepthVis` \[m\].
const WHITE_M: f32 = 100.0;

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scene,
    DepthPlanar,
    DepthPerspective,
    DepthVis,
    Segmentation,
    SurfaceNormals,
}

impl Kind {
    /// The kind of AirSim's number.
    pub(super) fn of(number: u64) -> Result<Self, String> {
        match number {
            0 => Ok(Self::Scene),
            1 => Ok(Self::DepthPlanar),
            2 => Ok(Self::DepthPerspective),
            3 => Ok(Self::DepthVis),
            5 => Ok(Self::Segmentation),
            6 => Ok(Self::SurfaceNormals),
            _ => Err(format!(
                "image type {number} is not offered: there are Scene, DepthPlanar, DepthPerspective, DepthVis, Segmentation and SurfaceNormals"
            )),
        }
    }
}

/// A picture that is wanted.
struct Request {
    camera: String,
    number: u64,
    as_float: bool,
    compress: bool,
}

/// `simGetImage`: a PNG.
pub(super) fn one(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let request = Request {
        camera: of.text("camera_name")?,
        number: of.whole("image_type")?,
        as_float: false,
        compress: true,
    };
    match take(session, of, request)?.pixels {
        Pixels::Bytes(png) => Ok(Value::Binary(png).into()),
        Pixels::Floats(_) => Ok(Value::Nil.into()),
    }
}

/// `simGetImages`: all of them of the same instant.
pub(super) fn several(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let requests = of.list("requests", "a list of ImageRequest", |request| {
        Some(Request {
            camera: of_map(request, "camera_name").and_then(text)?,
            number: of_map(request, "image_type").and_then(whole)?,
            as_float: of_map(request, "pixels_as_float").and_then(flag)?,
            compress: of_map(request, "compress").and_then(flag)?,
        })
    })?;
    if requests.len() > MOST_PICTURES {
        return Err(of
            .wrong(format!("give {MOST_PICTURES} requests at most"))
            .into());
    }
    let taken = (requests.into_iter())
        .map(|request| Ok(take(session, of, request)?.value()))
        .collect::<Result<_, Fault>>()?;
    Ok(Value::Array(taken).into())
}

impl Session {
    /// What a camera would expose now; none without pictures. Asked again in the same tick, it is not rendered again.
    pub(super) fn frame(&mut self, camera: usize) -> Result<Option<Frame>, Fault> {
        if let Some(frame) = self.looked.frames.get(&camera) {
            return Ok(frame.clone());
        }
        let tick = self.view().tick();
        // The camera's own exposure, if it has just made one of its whole sensor.
        let own = self.held.newest(camera).filter(|frame| {
            let frame = frame.view();
            frame.tick() == tick && is_whole(frame) && frame.rgb8().is_some()
        });
        let frame = match own {
            Some(frame) => Some(frame.clone()),
            None => (self.held.run_mut().picture(camera)).map_err(fatal)?,
        };
        self.looked.frames.insert(camera, frame.clone());
        Ok(frame)
    }

    /// How far a camera sees now; none without pictures.
    fn depth(&mut self, camera: usize) -> Result<Option<Arc<Depth>>, Fault> {
        if let Some(depth) = self.looked.depths.get(&camera) {
            return Ok(depth.clone());
        }
        let depth = self.held.run_mut().depth(camera).map_err(fatal)?;
        let depth = depth.map(Arc::new);
        self.looked.depths.insert(camera, depth.clone());
        Ok(depth)
    }
}

fn fatal(error: crate::simulation::SimulationError) -> Fault {
    Fault::Fatal(error.into())
}

fn is_whole(frame: FrameView) -> bool {
    let pinhole = frame.pinhole();
    frame.rect().size_px == [pinhole.width_px, pinhole.height_px]
}

/// Takes a picture.
fn take(session: &mut Session, of: &Arguments, request: Request) -> Result<Image, Fault> {
    let Request {
        camera,
        number,
        as_float,
        compress,
    } = request;
    let kind = Kind::of(number).map_err(|why| of.wrong(why))?;
    let (index, name) = {
        let camera = names::camera(session.view(), &camera).map_err(|why| of.wrong(why))?;
        (camera.index(), camera.name().to_owned())
    };
    let floats_alone = matches!(kind, Kind::DepthPlanar | Kind::DepthPerspective);
    if floats_alone && !as_float {
        return Err(of
            .wrong("distances are numbers: ask with pixels_as_float=True, or for DepthVis")
            .into());
    }
    if as_float && matches!(kind, Kind::Scene | Kind::SurfaceNormals) {
        return Err(of
            .wrong("Scene and SurfaceNormals have three channels: ask with pixels_as_float=False")
            .into());
    }
    let dark = || {
        Fault::from(of.wrong(
            "this run renders no pictures: serve it without --no-capture, and with --pictures where its detector is the truth",
        ))
    };
    let (pose, tick, size_px, rgb8) = match kind {
        Kind::Scene => {
            let frame = session.frame(index)?.ok_or_else(dark)?;
            let view = frame.view();
            let rgb8 = view.rgb8().ok_or_else(dark)?.to_vec();
            (view.pose(), view.tick(), view.rect().size_px, Some(rgb8))
        }
        _ => {
            let depth = session.depth(index)?.ok_or_else(dark)?;
            let Pinhole {
                width_px,
                height_px,
                ..
            } = depth.pinhole;
            (depth.pose, depth.tick, [width_px, height_px], None)
        }
    };
    let pixels = match (kind, rgb8) {
        (Kind::Scene, Some(rgb8)) => bytes(rgb8, size_px, compress)?,
        _ => {
            let depth = session.depth(index)?.ok_or_else(dark)?;
            of_depth(session, &depth, kind, as_float, compress)?
        }
    };
    Ok(Image {
        camera: name,
        pixels,
        camera_position: swapped(pose.r_enu_m),
        camera_orientation: camera_attitude(pose.q_enu_cam),
        time_stamp_ns: time_ns(tick as f64 / f64::from(session.view().tick_hz())),
        compress: compress && !as_float,
        size_px,
        kind: number,
    })
}

/// A picture that is made of distances.
fn of_depth(
    session: &Session,
    depth: &Depth,
    kind: Kind,
    as_float: bool,
    compress: bool,
) -> Result<Pixels, Fault> {
    let finite = |far_m: &f32| far_m.min(SKY_M);
    let grey = |level: u8| [level; 3];
    let rgb8: Vec<[u8; 3]> = match kind {
        Kind::DepthPlanar => {
            return Ok(Pixels::Floats(depth.planar_m.iter().map(finite).collect()));
        }
        Kind::DepthPerspective => {
            return Ok(Pixels::Floats(
                depth.ranges_m().iter().map(finite).collect(),
            ));
        }
        Kind::DepthVis => {
            let share = |far_m: &f32| (far_m / WHITE_M).min(1.0);
            let shares = depth.planar_m.iter().map(share);
            if as_float {
                return Ok(Pixels::Floats(shares.collect()));
            }
            shares
                .map(|share| grey((255.0 * share).round() as u8))
                .collect()
        }
        Kind::Segmentation => {
            let ids = session.objects.ids(session.view());
            let of = |seen: &Seen| ids.of(*seen);
            if as_float {
                let ids = depth.seen.iter().map(|seen| f32::from(of(seen)));
                return Ok(Pixels::Floats(ids.collect()));
            }
            depth.seen.iter().map(|seen| colour(of(seen))).collect()
        }
        Kind::Scene | Kind::SurfaceNormals => {
            let level = |x: f64| (127.5 * (1.0 + x)).round() as u8;
            let normals = depth.normals_enu.iter();
            let of = |normal: &[f32; 3]| {
                let normal = DVec3::from(normal.map(f64::from));
                swapped(normal).to_array().map(level)
            };
            normals.map(of).collect()
        }
    };
    let size_px = [depth.pinhole.width_px, depth.pinhole.height_px];
    bytes(rgb8.into_flattened(), size_px, compress)
}

/// The colour of a segmentation's number: its bits are dealt to red, green and blue in turn, the lowest to their highest
/// bits, so that no two are alike.
pub(super) fn colour(id: u8) -> [u8; 3] {
    let mut colour = [0; 3];
    for bit in 0..8 {
        colour[bit % 3] |= (id >> bit & 1) << (7 - bit / 3);
    }
    colour
}

/// A PNG of red, green and blue, or the pixels themselves as blue, green and red.
fn bytes(mut rgb8: Vec<u8>, [width, height]: [u32; 2], compress: bool) -> Result<Pixels, Fault> {
    if !compress {
        for pixel in rgb8.chunks_exact_mut(3) {
            pixel.swap(0, 2);
        }
        return Ok(Pixels::Bytes(rgb8));
    }
    let mut png = Vec::new();
    // Time counts for more than the last byte.
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Up)
        .write_image(&rgb8, width, height, ExtendedColorType::Rgb8)
        .map_err(|error| Fault::Refused(format!("the picture cannot be made a PNG: {error}")))?;
    Ok(Pixels::Bytes(png))
}

/// Ticks in which the camera of number 0 is due so many times.
pub(super) fn ticks_of_frames(view: View, frames: u64) -> u64 {
    let first = view.stations().flat_map(|station| station.cameras()).next();
    let period = first.map_or(1, |camera| {
        (camera.period_s() * f64::from(view.tick_hz()))
            .round()
            .max(1.0) as u64
    });
    let tick = view.tick();
    let last = (tick / period)
        .saturating_add(frames)
        .saturating_mul(period);
    last.saturating_sub(tick)
}

/// `simGetCameraInfo`.
pub(super) fn camera_info(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let name = of.text("camera_name")?;
    let camera = names::camera(session.view(), &name).map_err(|why| of.wrong(why))?;
    let pose = camera.pose();
    let pose = messages::pose(swapped(pose.r_enu_m), camera_attitude(pose.q_enu_cam));
    let pinhole = camera.pinhole();
    let fov_deg = pinhole.hfov_rad().to_degrees();
    Ok(messages::camera_info(pose, fov_deg, projection(&pinhole)).into())
}

/// From forward, right, down, 1 to right, up, inverse distance and distance: divided by the last, the first two are -1 to 1 in
/// the picture.
fn projection(pinhole: &Pinhole) -> [[f64; 4]; 4] {
    let across = 2.0 * pinhole.focal_px / f64::from(pinhole.width_px);
    let up = 2.0 * pinhole.focal_px / f64::from(pinhole.height_px);
    [
        [0.0, across, 0.0, 0.0],
        [0.0, 0.0, -up, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0, 0.0],
    ]
}

/// `simGetCurrentFieldOfView`, as text.
pub(super) fn field(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let name = of.text("camera_name")?;
    let camera = names::camera(session.view(), &name).map_err(|why| of.wrong(why))?;
    let fov_deg = camera.pinhole().hfov_rad().to_degrees();
    Ok(Value::from(fov_deg.to_string()).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn no_two_numbers_have_a_colour() {
        let colours: BTreeSet<_> = (0..=255).map(colour).collect();
        assert_eq!(colours.len(), 256);
        assert_eq!(colour(0), [0; 3]);
        assert_eq!(
            [colour(1), colour(2), colour(8)],
            [[128, 0, 0], [0, 128, 0], [64, 0, 0]]
        );
    }

    #[test]
    fn pixels_go_as_blue_green_red_and_pngs_are_right_way_round() {
        let rgb8 = vec![1, 2, 3, 4, 5, 6];
        let Ok(Pixels::Bytes(raw)) = bytes(rgb8.clone(), [2, 1], false) else {
            panic!()
        };
        assert_eq!(raw, [3, 2, 1, 6, 5, 4]);
        let Ok(Pixels::Bytes(png)) = bytes(rgb8.clone(), [2, 1], true) else {
            panic!()
        };
        assert_eq!(
            image::load_from_memory(&png)
                .unwrap()
                .into_rgb8()
                .into_raw(),
            rgb8
        );
    }

    #[test]
    fn a_projection_is_that_of_the_pinhole() {
        let pinhole = Pinhole::from_hfov(640, 480, 0.6).unwrap();
        let r_cam_m = DVec3::new(3.0, -5.0, 40.0);
        let [x, y, z, w] = [r_cam_m.z, r_cam_m.x, r_cam_m.y, 1.0];
        let row = |row: [f64; 4]| row[0] * x + row[1] * y + row[2] * z + row[3] * w;
        let [right, up, _, ahead] = projection(&pinhole).map(row);
        let px = pinhole.project(r_cam_m).unwrap();
        assert!((0.5 * (1.0 + right / ahead) * 640.0 - px.x).abs() < 1e-9);
        assert!((0.5 * (1.0 - up / ahead) * 480.0 - px.y).abs() < 1e-9);
    }
}
