//! Moving-target indication: dots too faint for one frame, found by how they move against the scenery.
//!
//! Frames of a camera that hardly turns are laid on one another by where the station believes it to have looked. What the
//! scenery shows is their mean; what is left of each frame is noise, and what flies. A dot leaves a row of such remainders
//! along a straight line over the frames: the sum over the line that fits best tells it from noise (track before detect: I. S.
//! Reed, R. M. Gagliardi, H. M. Shao, "Application of Three-Dimensional Filtering to Moving Target Detection", IEEE
//! Trans. Aerosp. Electron. Syst. 19, 1983), here over lines that end in what stands out of the newest frame.

use crate::optics::camera::Pinhole;
use crate::optics::detection::Detection;
use glam::{DQuat, DVec2};
use std::collections::VecDeque;
use std::ops::Range;

/// Frames that a line runs over at least and at most: of fewer the noise of a pixel is not known, and an empty gaze must show
/// some more (`systems::control::search`).
const LEAST_FRAMES: usize = 6;
const MOST_FRAMES: usize = 12;
/// So many of the newest frames, and as many from one on a line to either side, show a dot still where it is now: they are no
/// scenery.
const RECENT: usize = 2;
/// Most by which the picture may move from one frame to the next, and from the first to the newest [px]; and most of the
/// former within an exposure.
const MOST_STEP_PX: f64 = 8.0;
const MOST_SHIFT_PX: f64 = 24.0;
const MOST_SMEAR_PX: f64 = 0.5;
/// Most by which a corner may move otherwise than the middle [px]: the picture rolls with the azimuth, and in a wide field bends.
const MOST_BENT_PX: f64 = 0.2;
/// Share by which the exposure may differ from the first's: by one factor for all pixels, the scenery's brightness goes with
/// it about so far.
const SAME_EXPOSURE: f64 = 0.25;
/// One row in so many says which factor.
const GAIN_ROWS: usize = 4;
/// Share by which the time from frame to frame may differ on a line.
const STEADY_SHARE: f64 = 0.05;
/// Frames are laid on one another about so exactly [px]: what an edge shows of that counts as noise.
const LAID_PX: f32 = 0.1;
/// Share of the noise close by that counts at least: what shimmers has more than what is around it.
const NEAR_SHARE: f32 = 0.7;
/// Pixels over which noise is measured to either side.
const NOISE_REACH: usize = 4;
/// Pixels at the edges that the filters do not reach, and most in which nothing is found: a shift leaves some bare.
const EDGE: usize = 3;
const WIDEST_MARGIN: usize = EDGE + MOST_SHIFT_PX as usize + NOISE_REACH;
/// Remainder of a pixel and its eight neighbours, in deviations, from which on a line may end in it; most of them a frame.
const STANDS_OUT: f32 = 1.7;
const MOST_ENDS: usize = 64;
/// Sum over a line, in deviations of such a sum, from which on it is a dot; and what one frame may say at most.
const DOT: f32 = 5.0;
const MOST_OF_FRAME: f32 = 3.0;
/// Most dots a frame: where there are more, the scenery itself moves, and nothing is said.
const MOST_DOTS: usize = 8;
/// Fastest along and across the picture, slowest, and the step of the lines' slopes [px a frame].
const FASTEST: [i32; 2] = [6, 3];
const SLOWEST: f32 = 0.7;
const PER_STEP: i32 = 2;
/// Added to the noise of the sum of a pixel's three bytes: rounding may hide it.
const ROUNDING: f32 = 0.3;
/// The corners of a picture, over its sides.
const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
/// Dots are further apart than this [px]: a bright one draws lines beside its own.
const APART_PX: f64 = 10.0;

/// A detection whose box reaches within this of a dot is the same thing, and its score is lifted up to this size [px].
const SAME_PX: f64 = 4.0;
const LARGEST_SAME_PX: f64 = 12.0;

/// A frame of a camera.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// When [s].
    pub t_s: f64,
    /// For how long it was exposed [s].
    pub exposure_s: f64,
    /// How the station believes the camera to be turned.
    pub q_enu_cam: DQuat,
    /// 8-bit RGB pixels of the whole sensor, row by row.
    pub rgb8: &'a [u8],
}

/// Something that moves against the scenery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    /// Its middle in the newest frame [px].
    pub at_px: DVec2,
    /// About its size [px].
    pub side_px: f64,
    /// How it moves over the scenery [px a frame].
    pub velocity_px: DVec2,
    /// Sum over its line, in deviations of one of noise.
    pub sigmas: f64,
}

impl Dot {
    /// Counts it among a frame's detections: a small one there scores as much at least, and what a larger one shows as surely
    /// is the same thing.
    pub fn count_in(&self, detections: &mut Vec<Detection>, moving: &MovingAs) {
        let [x, y] = self.at_px.to_array();
        let holds = |detection: &Detection| {
            let [x0, y0, x1, y1] = detection.box_px;
            (x0 - SAME_PX..x1 + SAME_PX).contains(&x) && (y0 - SAME_PX..y1 + SAME_PX).contains(&y)
        };
        let small = |detection: &Detection| {
            let [x0, y0, x1, y1] = detection.box_px;
            (x1 - x0).max(y1 - y0) <= LARGEST_SAME_PX
        };
        let shown = (detections.iter()).any(|other| holds(other) && other.score >= moving.score);
        let same = (detections.iter_mut()).find(|other| holds(other) && small(other));
        match same {
            Some(same) => same.score = same.score.max(moving.score),
            None if shown => {}
            None => {
                let half_px = 0.5 * self.side_px;
                let box_px = [x - half_px, y - half_px, x + half_px, y + half_px];
                detections.push(Detection::new(box_px, moving.score, moving.label));
            }
        }
    }
}

/// How what moves counts as a detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingAs {
    /// Its label.
    pub label: u32,
    /// Its score.
    pub score: f64,
}

impl MovingAs {
    /// Least score: about as likely of a UAV as of anything else that flies.
    pub const NEUTRAL: f64 = 0.3;
}

/// The frames of one camera since it last turned.
#[derive(Clone, Debug, Default)]
pub struct MovingDots {
    width: usize,
    height: usize,
    /// How the camera was turned and exposed in the first [s], and the time and turn of the newest.
    first: Option<(DQuat, f64)>,
    newest: Option<(f64, DQuat)>,
    /// From one to the next [s].
    step_s: Option<f64>,
    /// The first, and what the others differ by from it: sums of three bytes, means of three by three pixels, as the first lies.
    base: Vec<f32>,
    /// By how much the first changes from pixel to pixel.
    slope: Vec<f32>,
    planes: VecDeque<Plane>,
    /// Sum and sum of squares of all that are not recent.
    sum: Vec<f32>,
    squares: Vec<f32>,
}

/// A frame laid on the first.
#[derive(Clone, Debug)]
struct Plane {
    values: Vec<f32>,
    /// Pixels at the edges that it leaves bare.
    bare: usize,
}

/// A line over the frames that ends in a pixel.
#[derive(Clone, Copy)]
struct Line {
    pixel: usize,
    velocity: [f32; 2],
    sigmas: f32,
}

impl MovingDots {
    /// Takes in a frame, and finds what moves in it.
    pub fn look(&mut self, pinhole: &Pinhole, picture: &Picture) -> Vec<Dot> {
        if pinhole.width_px.min(pinhole.height_px) as usize <= 2 * WIDEST_MARGIN {
            return Vec::new();
        }
        let Some(shift_px) = self.follow(pinhole, picture) else {
            return Vec::new();
        };
        if self.planes.is_empty() {
            self.begin(pinhole, picture);
        }
        self.lay(picture, shift_px);
        if self.planes.len() < LEAST_FRAMES {
            return Vec::new();
        }
        let per_noise = self.per_noise();
        let ends = self.ends(&per_noise);
        let mut lines: Vec<Line> = (ends.into_iter())
            .filter_map(|pixel| self.best_line(&per_noise, pixel))
            .collect();
        lines.sort_by(|a, b| {
            let order = b.sigmas.total_cmp(&a.sigmas);
            order.then(a.pixel.cmp(&b.pixel))
        });
        let mut dots: Vec<Dot> = Vec::new();
        for line in lines {
            let dot = self.dot(&line, shift_px);
            if dots
                .iter()
                .all(|other| other.at_px.distance(dot.at_px) > APART_PX)
            {
                dots.push(dot);
            }
        }
        if dots.len() > MOST_DOTS {
            dots.clear();
        }
        dots
    }

    /// Where the first frame's middle lies in this one, from its middle [px]; `None` of one that is smeared. Forgets all frames
    /// where the camera has turned too fast or too far, has paused, or exposes otherwise.
    fn follow(&mut self, pinhole: &Pinhole, picture: &Picture) -> Option<DVec2> {
        // How far a pixel's scenery in a frame turned so has moved since.
        let moved_px = |q_enu_cam: DQuat, px: DVec2| {
            let ray_cam = picture.q_enu_cam.inverse() * (q_enu_cam * pinhole.ray(px));
            (pinhole.project(ray_cam)).map_or(DVec2::INFINITY, |now_px| now_px - px)
        };
        let middle_px = pinhole.centre_px();
        let before = self.newest.replace((picture.t_s, picture.q_enu_cam));
        let (step_s, step_px) = before.map_or((0.0, 0.0), |(t_s, q_enu_cam)| {
            let step_px = moved_px(q_enu_cam, middle_px).length();
            (picture.t_s - t_s, step_px)
        });
        let due = (self.step_s).is_none_or(|due_s| (step_s - due_s).abs() < STEADY_SHARE * due_s);
        self.step_s = before.map(|_| step_s);
        let (q_first, exposure_s) = self.first.unwrap_or((picture.q_enu_cam, 0.0));
        let shift_px = moved_px(q_first, middle_px);
        let bent_px = CORNERS.map(|corner| {
            let corner_px = 2.0 * middle_px * DVec2::from(corner);
            (moved_px(q_first, corner_px) - shift_px).length()
        });
        let steady = due
            && step_px < MOST_STEP_PX
            && shift_px.length() < MOST_SHIFT_PX
            && bent_px.into_iter().all(|bent_px| bent_px < MOST_BENT_PX)
            && (picture.exposure_s - exposure_s).abs() < SAME_EXPOSURE * exposure_s;
        if !steady {
            self.planes.clear();
        }
        let smeared = step_px * picture.exposure_s > MOST_SMEAR_PX * step_s;
        if smeared {
            self.planes.clear();
            return None;
        }
        Some(if steady { shift_px } else { DVec2::ZERO })
    }

    /// Begins anew with this frame.
    fn begin(&mut self, pinhole: &Pinhole, picture: &Picture) {
        (self.width, self.height) = (pinhole.width_px as usize, pinhole.height_px as usize);
        self.first = Some((picture.q_enu_cam, picture.exposure_s));
        self.base = smoothed(picture.rgb8, self.width, self.height);
        self.slope = slope(&self.base, self.width);
        for plane in [&mut self.sum, &mut self.squares] {
            plane.clear();
            plane.resize(self.base.len(), 0.0);
        }
    }

    /// Lays a frame, in which the first's middle is off by `shift_px`, on the others.
    fn lay(&mut self, picture: &Picture, shift_px: DVec2) {
        let smooth = smoothed(picture.rgb8, self.width, self.height);
        let bare = EDGE + shift_px.abs().max_element().ceil() as usize;
        let mut values = if self.planes.len() == MOST_FRAMES {
            let oldest = (self.planes.pop_front()).map_or_else(Vec::new, |plane| plane.values);
            add(&mut self.sum, &mut self.squares, &oldest, -1.0);
            oldest
        } else {
            vec![0.0; smooth.len()]
        };
        if let Some(settled) = self.planes.len().checked_sub(RECENT) {
            let values = &self.planes[settled].values;
            add(&mut self.sum, &mut self.squares, values, 1.0);
        }
        let whole = shift_px.floor();
        let [across, down] = (shift_px - whole).to_array().map(cubic);
        let width = self.width;
        let length = width - 2 * bare;
        let rows = bare..self.height - bare;
        // The first pixel of a row of the first frame, and of those of this one that are laid on it.
        let at = |row: usize| row * width + bare;
        let shifted = |row: usize, tap: usize| {
            ((row + tap) as i64 + whole.y as i64 - 1) as usize * width
                + (bare as i64 + whole.x as i64 - 1) as usize
        };
        let total = |plane: &[f32], at: usize| plane[at..][..length].iter().sum::<f32>();
        let (mut first, mut now) = (0.0, 0.0);
        for row in rows.clone().step_by(GAIN_ROWS) {
            first += total(&self.base, at(row));
            now += total(&smooth, shifted(row, 1) + 1);
        }
        let gain = if now > 0.0 { first / now } else { 1.0 };
        let mut between = vec![0.0; length + 3];
        for row in rows {
            let taps = [0, 1, 2, 3].map(|tap| &smooth[shifted(row, tap)..][..length + 3]);
            for (i, out) in between.iter_mut().enumerate() {
                *out = gain * weighed(down, taps.map(|row| row[i]));
            }
            let (out, base) = (&mut values[at(row)..][..length], &self.base[at(row)..]);
            let taps = [0, 1, 2, 3].map(|tap| &between[tap..][..length]);
            for (i, (out, base)) in out.iter_mut().zip(base).enumerate() {
                *out = weighed(across, taps.map(|row| row[i])) - base;
            }
        }
        self.planes.push_back(Plane { values, bare });
    }

    /// Pixels at the edges in which nothing is found.
    fn margin(&self) -> usize {
        let bare = self.planes.iter().map(|plane| plane.bare).max();
        NOISE_REACH + bare.unwrap_or_default()
    }

    /// One over the noise of each pixel, by all frames that are not recent.
    fn per_noise(&self) -> Vec<f32> {
        let count = (self.planes.len() - RECENT) as f32;
        let variance: Vec<f32> = (self.squares.iter().zip(&self.sum))
            .map(|(squares, sum)| ((squares - sum * sum / count) / (count - 1.0)).max(0.0))
            .collect();
        let mut noise = box_mean(&variance, self.width, self.height, NOISE_REACH);
        let near = box_mean(&variance, self.width, self.height, 1);
        for ((noise, near), slope) in noise.iter_mut().zip(near).zip(&self.slope) {
            // Rounding may leave less than nothing.
            let variance = noise.max(NEAR_SHARE * near).max(0.0) + (LAID_PX * slope).powi(2);
            *noise = 1.0 / (variance.sqrt() + ROUNDING);
        }
        noise
    }

    /// The pixels that stand out of the newest frame, those that do so most.
    fn ends(&self, per_noise: &[f32]) -> Vec<usize> {
        let newest = self.planes.len() - 1;
        let stands = |at: usize| (self.remainder(newest, at) * per_noise[at]).abs();
        let (width, margin) = (self.width, self.margin());
        let mut ends: Vec<(f32, usize)> = Vec::new();
        for row in margin..self.height - margin {
            for at in row * width + margin..(row + 1) * width - margin {
                let out = stands(at);
                let highest = || {
                    let around = [at - width - 1, at - 1, at + width - 1];
                    (around.into_iter().flat_map(|left| left..left + 3)).all(|by| stands(by) <= out)
                };
                if out > STANDS_OUT && highest() {
                    ends.push((out, at));
                }
            }
        }
        ends.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        ends.into_iter().take(MOST_ENDS).map(|(_, at)| at).collect()
    }

    /// The line that ends in a pixel and says most, if that is enough.
    fn best_line(&self, per_noise: &[f32], pixel: usize) -> Option<Line> {
        let root = (self.planes.len() as f32).sqrt();
        let sign = self.remainder(self.planes.len() - 1, pixel).signum();
        let mut best: Option<Line> = None;
        for down in -PER_STEP * FASTEST[1]..=PER_STEP * FASTEST[1] {
            for right in -PER_STEP * FASTEST[0]..=PER_STEP * FASTEST[0] {
                let velocity = [right, down].map(|steps| steps as f32 / PER_STEP as f32);
                if velocity[0].hypot(velocity[1]) < SLOWEST {
                    continue;
                }
                let Some(line) = self.line(pixel, velocity) else {
                    continue;
                };
                let says = |(frame, at): (usize, usize)| {
                    let off = sign * self.remainder(frame, at);
                    (off * per_noise[at]).min(MOST_OF_FRAME)
                };
                let sigmas = line.map(says).sum::<f32>() / root;
                if sigmas >= DOT && best.is_none_or(|best| sigmas > best.sigmas) {
                    best = Some(Line {
                        pixel,
                        velocity,
                        sigmas,
                    });
                }
            }
        }
        best
    }

    /// Frame and pixel along a line that ends in a pixel of the newest frame, the oldest first; `None` where it comes in from the
    /// edge.
    fn line(
        &self,
        pixel: usize,
        velocity: [f32; 2],
    ) -> Option<impl Iterator<Item = (usize, usize)>> {
        let (width, margin, last) = (self.width, self.margin(), self.planes.len() - 1);
        let ends = [pixel % width, pixel / width].map(|at| at as f32);
        let back = move |frame: usize| {
            let ago = (last - frame) as f32;
            [0, 1].map(|axis| (ends[axis] - velocity[axis] * ago).round())
        };
        let sizes = [self.width, self.height];
        let first = back(0);
        let inside = (0..2).all(|axis| {
            first[axis] >= margin as f32 && first[axis] < (sizes[axis] - margin) as f32
        });
        inside.then(|| {
            (0..=last).map(move |frame| {
                let [x, y] = back(frame);
                (frame, y as usize * width + x as usize)
            })
        })
    }

    /// What a frame shows in a pixel beyond the mean of those that are not next to it.
    fn remainder(&self, frame: usize, at: usize) -> f32 {
        let count = self.planes.len();
        let close = (frame + 1).saturating_sub(RECENT)..(frame + RECENT).min(count);
        let shown = |frames: Range<usize>| frames.map(|frame| self.planes[frame].values[at]);
        let far = self.sum[at] + shown(count - RECENT..count).sum::<f32>()
            - shown(close.clone()).sum::<f32>();
        self.planes[frame].values[at] - far / (count - close.len()) as f32
    }

    /// What a line ends in.
    fn dot(&self, line: &Line, shift_px: DVec2) -> Dot {
        let off = |at: usize| self.remainder(self.planes.len() - 1, at);
        let peak = off(line.pixel);
        let (mut count, mut moment) = (0.0, DVec2::ZERO);
        for down in -3..=3_i64 {
            for right in -3..=3_i64 {
                let at = line.pixel as i64 + down * self.width as i64 + right;
                // Its part above half the peak, by its brightness.
                let share = off(at as usize) / peak;
                if share > 0.5 {
                    count += 1.0;
                    moment += f64::from(share) * DVec2::new(right as f64, down as f64);
                }
            }
        }
        let [x, y] = [line.pixel % self.width, line.pixel / self.width].map(|at| at as f64 + 0.5);
        Dot {
            at_px: DVec2::new(x, y) + moment / f64::max(count, 1.0) + shift_px,
            side_px: f64::max(count, 9.0).sqrt(),
            velocity_px: DVec2::from(line.velocity.map(f64::from)),
            sigmas: f64::from(line.sigmas),
        }
    }
}

/// Weights of the four pixels about a place, the second of which lies before it by this share of a pixel (R. Keys, "Cubic
/// Convolution Interpolation for Digital Image Processing", IEEE Trans. ASSP 29, 1981): a line between two would leave
/// of sharp edges more than the noise.
fn cubic(share: f64) -> [f32; 4] {
    let [t, t2, t3] = [share, share * share, share * share * share];
    [
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        -0.5 * t2 + 0.5 * t3,
    ]
    .map(|weight| weight as f32)
}

fn weighed(weights: [f32; 4], values: [f32; 4]) -> f32 {
    weights[0] * values[0]
        + weights[1] * values[1]
        + weights[2] * values[2]
        + weights[3] * values[3]
}

/// Adds a plane to a sum and a sum of squares, or takes it away.
fn add(sum: &mut [f32], squares: &mut [f32], plane: &[f32], sign: f32) {
    for ((sum, squares), value) in sum.iter_mut().zip(squares).zip(plane) {
        *sum += sign * value;
        *squares += sign * value * value;
    }
}

/// The sum of each pixel's three bytes, as the mean of it and its eight neighbours.
fn smoothed(rgb8: &[u8], width: usize, height: usize) -> Vec<f32> {
    let mut bytes: Vec<f32> = (rgb8.chunks_exact(3))
        .map(|pixel| f32::from(u16::from(pixel[0]) + u16::from(pixel[1]) + u16::from(pixel[2])))
        .collect();
    bytes.resize(width * height, 0.0);
    box_mean(&bytes, width, height, 1)
}

/// By how much a plane changes from pixel to pixel, 0 in its first and last rows.
fn slope(plane: &[f32], width: usize) -> Vec<f32> {
    let mut out = vec![0.0; plane.len()];
    for at in width..plane.len().saturating_sub(width) {
        let [across, down] = [1, width].map(|step| plane[at + step] - plane[at - step]);
        out[at] = 0.5 * across.hypot(down);
    }
    out
}

/// The mean of the pixels up to `reach` away along both axes; that many at the edges are 0.
fn box_mean(plane: &[f32], width: usize, height: usize, reach: usize) -> Vec<f32> {
    let side = 2 * reach + 1;
    let mut out = vec![0.0; plane.len()];
    if width < side || height < side {
        return out;
    }
    // Down first: whole rows are added to, and taken from, one.
    let mut column = vec![0.0; width];
    for row in plane.chunks_exact(width).take(side - 1) {
        column
            .iter_mut()
            .zip(row)
            .for_each(|(sum, value)| *sum += value);
    }
    let share = 1.0 / (side * side) as f32;
    for row in reach..height - reach {
        let newest = &plane[(row + reach) * width..][..width];
        column
            .iter_mut()
            .zip(newest)
            .for_each(|(sum, value)| *sum += value);
        let out = &mut out[row * width + reach..][..width - 2 * reach];
        let mut sum: f32 = column[..side].iter().sum();
        out[0] = share * sum;
        let steps = column[side..].iter().zip(&column);
        for (out, (enters, leaves)) in out[1..].iter_mut().zip(steps) {
            sum += enters - leaves;
            *out = share * sum;
        }
        let oldest = &plane[(row - reach) * width..][..width];
        column
            .iter_mut()
            .zip(oldest)
            .for_each(|(sum, value)| *sum -= value);
    }
    out
}

#[cfg(test)]
mod tests;
