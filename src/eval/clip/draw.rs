//! What is drawn into the frames of a clip.

use super::follow::Followed;
use super::truth::FrameTruth;
use crate::models::optics::detection::Detection;
use glam::DVec2;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

const GREEN: [u8; 3] = [47, 230, 160];
const WHITE: [u8; 3] = [255, 255, 255];
const ORANGE: [u8; 3] = [255, 140, 30];
const BLUE: [u8; 3] = [60, 160, 255];
const PINK: [u8; 3] = [255, 70, 200];
/// What the colours mean.
pub(super) const COLOURS: &str = "Green: boxes of UAVs; white: boxes of other things; orange: detections; blue: confirmed \
     tracks; pink: the target that is held, with its way of the last two seconds and a cross where the \
     filter has it. Pictures here show its surroundings enlarged in a corner.";

/// Lines on a picture.
struct Pen<'a> {
    picture: &'a mut RgbImage,
    /// Width of a line [px].
    width: i64,
}

impl Pen<'_> {
    /// Fills a rectangle, both corners included [px].
    fn fill(&mut self, [x0, y0, x1, y1]: [i64; 4], colour: [u8; 3]) {
        let [width, height] = [self.picture.width(), self.picture.height()].map(i64::from);
        for y in y0.max(0)..=y1.min(height - 1) {
            for x in x0.max(0)..=x1.min(width - 1) {
                self.picture.put_pixel(x as u32, y as u32, Rgb(colour));
            }
        }
    }

    /// The outline of a box, kept off it by `pad` pixels.
    fn outline(&mut self, box_px: [f64; 4], pad: i64, colour: [u8; 3]) {
        // A box far outside is drawn at the border.
        let limit = |x: f64| x.clamp(-1e6, 1e6);
        let [x0, y0] = [box_px[0], box_px[1]].map(|x| limit(x).floor() as i64 - pad);
        let [x1, y1] = [box_px[2], box_px[3]].map(|x| limit(x).ceil() as i64 - 1 + pad);
        let w = self.width - 1;
        self.fill([x0 - w, y0 - w, x1 + w, y0], colour);
        self.fill([x0 - w, y1, x1 + w, y1 + w], colour);
        self.fill([x0 - w, y0 - w, x0, y1 + w], colour);
        self.fill([x1, y0 - w, x1 + w, y1 + w], colour);
    }

    /// A straight line.
    fn line(&mut self, from: DVec2, to: DVec2, colour: [u8; 3]) {
        let steps = from.distance(to).ceil().clamp(1.0, 1e4) as usize;
        for i in 0..=steps {
            let at = from.lerp(to, i as f64 / steps as f64);
            let (x, y) = (at.x as i64, at.y as i64);
            let w = self.width - 1;
            self.fill([x, y, x + w, y + w], colour);
        }
    }
}

/// Draws boxes, detections and tracks into a picture.
pub(super) fn draw(
    picture: &mut RgbImage,
    boxes: &FrameTruth,
    found: &[Detection],
    followed: &[Followed],
    held: Option<u32>,
    trail: &[DVec2],
) {
    let width = i64::from(picture.width().div_ceil(960));
    let mut pen = Pen { picture, width };
    for box_px in &boxes.others {
        pen.outline(*box_px, 0, WHITE);
    }
    for truth in &boxes.uavs {
        pen.outline(truth.box_px, 0, GREEN);
    }
    for detection in found {
        pen.outline(detection.box_px, width, ORANGE);
    }
    for track in followed {
        let half = 0.5 * track.side_px;
        let DVec2 { x, y } = track.px;
        let square = [x - half, y - half, x + half, y + half];
        if Some(track.id) != held {
            pen.outline(track.seen_px.unwrap_or(square), 3 * width, BLUE);
            continue;
        }
        pen.outline(track.seen_px.unwrap_or(square), 4 * width, PINK);
        for d in [DVec2::X, DVec2::Y] {
            let (near, far) = (half + 6.0, half + 16.0);
            for side in [-1.0, 1.0] {
                let arm = side * width as f64 * d;
                pen.line(track.px + near * arm, track.px + far * arm, PINK);
            }
        }
    }
    for pair in trail.windows(2) {
        pen.line(pair[0], pair[1], PINK);
    }
}

/// Shows the surroundings of `px` enlarged in the corner that is furthest from it.
pub(super) fn inset(picture: &mut RgbImage, px: DVec2) {
    const ZOOM: u32 = 3;
    let (width, height) = picture.dimensions();
    let side = (width / 10).min(height / ZOOM);
    if side == 0 {
        return;
    }
    let from = |x: f64, size: u32| {
        let first = x as i64 - i64::from(side / 2);
        first.clamp(0, i64::from(size - side)) as u32
    };
    let (left, top) = (from(px.x, width), from(px.y, height));
    let corner = |x: f64, size: u32| {
        if x < 0.5 * f64::from(size) {
            i64::from(size - ZOOM * side)
        } else {
            0
        }
    };
    let (x0, y0) = (corner(px.x, width), corner(px.y, height));
    let piece = imageops::crop_imm(picture, left, top, side, side).to_image();
    let size = ZOOM * side;
    let enlarged = imageops::resize(&piece, size, size, FilterType::Nearest);
    imageops::replace(picture, &enlarged, x0, y0);
    let (x0, y0, size) = (x0 as f64, y0 as f64, f64::from(size));
    let mut pen = Pen { picture, width: 1 };
    pen.outline([x0, y0, x0 + size, y0 + size], 0, WHITE);
}
