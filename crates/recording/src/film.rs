//! `boresight video`: a film of a recording, its cameras side by side over a map and the states.

use super::read::{ReadError, Recorded};
use super::timeline::{CameraTrack, Mark, Timeline};
use crate::media::image::{self as pictures, ImageError};
use crate::media::labels;
use crate::media::video::{VideoError, Writer};
use clap::{Args, ValueEnum};
use font8x8::legacy::BASIC_LEGACY;
use glam::DVec3;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use std::path::PathBuf;

/// What `boresight video` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// The recording.
    pub recording: PathBuf,
    /// The film (MP4).
    pub film: PathBuf,
    /// What it shows.
    #[arg(long, value_enum, default_value = "all")]
    pub layout: Layout,
    /// Pictures a second of the film.
    #[arg(long, default_value_t = 30)]
    pub rate_hz: u32,
    /// Simulated seconds to a second of the film.
    #[arg(long, default_value_t = 1.0)]
    pub speed: f64,
    /// Draw the boxes of detections below the threshold too, in grey.
    #[arg(long)]
    pub weak: bool,
}

/// What a film shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Layout {
    /// Cameras and map.
    All,
    /// The cameras alone.
    Cameras,
    /// The map alone.
    Map,
}

/// Why there is no film. Each prints as one line.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A picture of it.
    #[error("{}: a picture cannot be read: {source}; make the run again", path.display())]
    Picture {
        /// The recording.
        path: PathBuf,
        /// What is wrong with it.
        source: ImageError,
    },
    /// It has nothing to show.
    #[error("{}: has no {what}", path.display())]
    Nothing {
        /// The recording.
        path: PathBuf,
        /// What is missing, and the mend.
        what: &'static str,
    },
    /// The film cannot be written.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// An argument.
    #[error("{0}")]
    Argument(String),
}

/// A cell of the film, and the strip below all [px].
const CELL_PX: [u32; 2] = [480, 360];
const STRIP_PX: u32 = 56;
const WHITE: Rgb<u8> = Rgb([235, 235, 235]);
const GREY: Rgb<u8> = Rgb([120, 128, 140]);
const DARK: Rgb<u8> = Rgb([16, 19, 24]);
const RED: Rgb<u8> = Rgb([255, 80, 60]);
const AMBER: Rgb<u8> = Rgb([255, 190, 70]);
const GREEN: Rgb<u8> = Rgb([60, 220, 150]);

/// Makes the film; the number of its pictures.
pub fn film(arguments: &Arguments) -> Result<usize, FilmError> {
    if arguments.rate_hz == 0 || arguments.rate_hz > 240 {
        let what = format!(
            "--rate-hz: found {}, must be from 1 to 240",
            arguments.rate_hz
        );
        return Err(FilmError::Argument(what));
    }
    if !(1e-3..=1e3).contains(&arguments.speed) {
        let what = format!(
            "--speed: found {}, must be from 0.001 to 1000",
            arguments.speed
        );
        return Err(FilmError::Argument(what));
    }
    let timeline = Timeline::of(&Recorded::open(&arguments.recording)?);
    let nothing = |what| FilmError::Nothing {
        path: arguments.recording.clone(),
        what,
    };
    let shows = |layout| [Layout::All, layout].contains(&arguments.layout);
    let pictured = |camera: &&CameraTrack| !camera.pictures.entries().is_empty();
    let cameras: Vec<&CameraTrack> = match shows(Layout::Cameras) {
        true => timeline.cameras.iter().filter(pictured).collect(),
        false => Vec::new(),
    };
    if arguments.layout == Layout::Cameras && cameras.is_empty() {
        return Err(nothing(
            "pictures: take --layout map, or record a run that renders",
        ));
    }
    if timeline.last_tick == 0 {
        return Err(nothing("states: its run was stopped before the first"));
    }
    let cells = cameras.len() + usize::from(shows(Layout::Map));
    let columns = cells.min(2);
    let rows = cells.div_ceil(2);
    let size_px = [
        CELL_PX[0] * columns as u32,
        CELL_PX[1] * rows as u32 + STRIP_PX,
    ];
    let map = Map::of(&timeline);
    let mut writer = Writer::create(&arguments.film, size_px, arguments.rate_hz.into())?;
    let end_s = timeline.t_s(timeline.last_tick);
    let count = (end_s / arguments.speed * f64::from(arguments.rate_hz)) as usize + 1;
    for number in 0..count {
        let t_s = number as f64 / f64::from(arguments.rate_hz) * arguments.speed;
        let tick = timeline.tick_at(t_s);
        let mut picture = RgbImage::from_pixel(size_px[0], size_px[1], DARK);
        let corner = |cell: usize| {
            [
                i64::from(CELL_PX[0]) * (cell % 2) as i64,
                i64::from(CELL_PX[1]) * (cell / 2) as i64,
            ]
        };
        for (cell, camera) in cameras.iter().enumerate() {
            let drawn =
                camera_cell(camera, tick, arguments.weak).map_err(|source| FilmError::Picture {
                    path: arguments.recording.clone(),
                    source,
                })?;
            if let Some(drawn) = drawn {
                let [x, y] = corner(cell);
                imageops::overlay(&mut picture, &drawn, x, y);
            }
        }
        if shows(Layout::Map) {
            let [x, y] = corner(cameras.len());
            imageops::overlay(&mut picture, &map.draw(&timeline, tick), x, y);
        }
        strip(&mut picture, &timeline, t_s);
        writer.push(&picture)?;
    }
    writer.finish(arguments.rate_hz.into())?;
    Ok(count)
}

/// A camera's last picture, with what is drawn on it, as large as a cell takes.
fn camera_cell(
    camera: &CameraTrack,
    tick: u64,
    weak: bool,
) -> Result<Option<RgbImage>, ImageError> {
    let Some(jpeg) = camera.pictures.at(tick) else {
        return Ok(None);
    };
    let picture = pictures::decode(jpeg)?;
    let [width, height] = [0, 1].map(|i| f64::from(CELL_PX[i]));
    let scale = (width / f64::from(picture.width())).min(height / f64::from(picture.height()));
    let [w, h] = [picture.width(), picture.height()].map(|side| (f64::from(side) * scale) as u32);
    let large = imageops::resize(&picture, w.max(1), h.max(1), FilterType::Triangle);
    let mut cell = RgbImage::from_pixel(CELL_PX[0], CELL_PX[1], DARK);
    let [left, top] = [(CELL_PX[0] - w) / 2, (CELL_PX[1] - h) / 2];
    imageops::overlay(&mut cell, &large, left.into(), top.into());
    let at = |[x, y]: [f64; 2]| [x * scale + f64::from(left), y * scale + f64::from(top)];
    if let Some(marks) = camera.marks_at(tick) {
        let drawn: Vec<&Mark> = (marks.boxes.iter().rev())
            .filter(|mark| weak || !mark.weak)
            .collect();
        mark(&mut cell, &drawn, at);
        if let Some([x, y]) = marks.reticle_px.map(at) {
            for [dx, dy] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
                let arm = |px: f64| [x + px * dx, y + px * dy];
                line(&mut cell, [arm(5.0), arm(14.0)], WHITE);
            }
        }
    }
    text(&mut cell, [8, 8], &camera.name, WHITE);
    Ok(Some(cell))
}

/// Draws boxes, the strongest first, with their labels; what is stronger lies on what is weaker.
fn mark(cell: &mut RgbImage, marks: &[&Mark], at: impl Fn([f64; 2]) -> [f64; 2]) {
    let boxes: Vec<[f64; 4]> = (marks.iter())
        .map(|mark| {
            let [x0, y0, x1, y1] = mark.rect_px;
            let ([x0, y0], [x1, y1]) = (at([x0, y0]), at([x1, y1]));
            [x0, y0, x1, y1]
        })
        .collect();
    let places = labels_of(marks.iter().map(|mark| &*mark.label), &boxes, 2.0);
    for ((mark, [x0, y0, x1, y1]), place) in marks.iter().zip(&boxes).zip(places).rev() {
        let colour = if mark.weak { GREY } else { GREEN };
        let corners = [[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]];
        for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            line(cell, [*from, *to], colour);
        }
        if let Some(place) = place {
            small_text(cell, place, &mark.label, colour);
        }
    }
}

/// Where small texts go at boxes of a cell, the most important first.
fn labels_of<'a>(
    texts: impl Iterator<Item = &'a str>,
    boxes: &[[f64; 4]],
    gap_px: f64,
) -> Vec<Option<[f64; 2]>> {
    let labels_px: Vec<[f64; 2]> = texts
        .map(|text| [8.0 * text.chars().count() as f64, 8.0])
        .collect();
    labels::place(boxes, &labels_px, CELL_PX.map(f64::from), gap_px)
}

/// The strip below: time, the state of every station, and how many UAVs fly.
fn strip(picture: &mut RgbImage, timeline: &Timeline, t_s: f64) {
    let tick = timeline.tick_at(t_s);
    let top = picture.height() - STRIP_PX + 8;
    text(picture, [8, top], &format!("{t_s:7.2} s"), WHITE);
    let mut x = 180;
    for station in &timeline.stations {
        let fires = station.fires(tick);
        let state = station.track.at(tick).map_or("", |track| &track.state);
        let word = if fires { "fires" } else { state };
        let shown = match timeline.stations.len() {
            1 => word.to_owned(),
            _ => format!("{} {word}", station.name),
        };
        text(picture, [x, top], &shown, if fires { RED } else { WHITE });
        x += 16 * (shown.len() as u32 + 2);
    }
    let count = |wanted: &[&str]| {
        let now = timeline
            .uavs
            .iter()
            .filter_map(|(_, series)| series.at(tick));
        now.filter(|uav| wanted.contains(&&*uav.status)).count()
    };
    let uavs = format!(
        "{} flying, {} neutralised, {} crashed",
        count(&["flying"]),
        count(&["falling", "down"]),
        count(&["struck", "crashed"])
    );
    text(picture, [8, top + 24], &uavs, GREY);
}

/// A map from above, north up.
struct Map {
    /// Middle [m, east and north], and pixels to a metre.
    middle_m: [f64; 2],
    scale: f64,
    /// What does not move.
    ground: RgbImage,
}

/// Colours of the map.
const GROUND: Rgb<u8> = Rgb([26, 30, 37]);
const ROOF: Rgb<u8> = Rgb([50, 57, 68]);
const WALL: Rgb<u8> = Rgb([72, 82, 97]);

impl Map {
    /// One that holds all that flies, and the stations.
    fn of(timeline: &Timeline) -> Self {
        let series = timeline.uavs.iter().map(|(_, series)| series.entries());
        let flown = series.flat_map(|entries| entries.iter().map(|(_, uav)| uav.r_enu_m));
        let stations = timeline.stations.iter();
        let stations = stations.filter_map(|station| timeline.r_enu_m(station));
        let all: Vec<DVec3> = flown.chain(stations).collect();
        let span = |axis: usize| {
            let values = all.iter().map(|at| at[axis]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
            if low <= high { (low, high) } else { (0.0, 0.0) }
        };
        let (east, north) = (span(0), span(1));
        let fits = |(low, high): (f64, f64), px: u32| 0.85 * f64::from(px) / (high - low).max(50.0);
        let mut map = Self {
            middle_m: [0.5 * (east.0 + east.1), 0.5 * (north.0 + north.1)],
            scale: fits(east, CELL_PX[0]).min(fits(north, CELL_PX[1])),
            ground: RgbImage::from_pixel(CELL_PX[0], CELL_PX[1], GROUND),
        };
        map.build(timeline);
        map
    }

    /// Draws the buildings, the scale and where north is.
    fn build(&mut self, timeline: &Timeline) {
        let mut cell = std::mem::take(&mut self.ground);
        for corners_m in &timeline.buildings {
            let corners = corners_m.map(|corner| self.px(corner.to_array()));
            fill(&mut cell, &corners, ROOF);
            for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
                line(&mut cell, [*from, *to], WALL);
            }
        }
        let metres = 10f64.powf((0.3 * f64::from(CELL_PX[0]) / self.scale).log10().floor());
        let [y, x] = [CELL_PX[1] - 14, 12].map(f64::from);
        line(&mut cell, [[x, y], [x + metres * self.scale, y]], WHITE);
        text(
            &mut cell,
            [12, CELL_PX[1] - 36],
            &format!("{metres:.0} m"),
            GREY,
        );
        let [x, top, foot] = [f64::from(CELL_PX[0]) - 20.0, 12.0, 44.0];
        for [from, to] in [
            [[x, foot], [x, top]],
            [[x - 5.0, top + 9.0], [x, top]],
            [[x + 5.0, top + 9.0], [x, top]],
        ] {
            line(&mut cell, [from, to], WHITE);
        }
        text(&mut cell, [CELL_PX[0] - 28, 50], "N", WHITE);
        self.ground = cell;
    }

    fn px(&self, [east_m, north_m]: [f64; 2]) -> [f64; 2] {
        [
            0.5 * f64::from(CELL_PX[0]) + self.scale * (east_m - self.middle_m[0]),
            0.5 * f64::from(CELL_PX[1]) - self.scale * (north_m - self.middle_m[1]),
        ]
    }

    fn draw(&self, timeline: &Timeline, tick: u64) -> RgbImage {
        let mut cell = self.ground.clone();
        let mut named: Vec<(&str, [f64; 2], Rgb<u8>)> = Vec::new();
        for station in &timeline.stations {
            let Some(r_enu_m) = timeline.r_enu_m(station) else {
                continue;
            };
            let px = self.px([r_enu_m.x, r_enu_m.y]);
            dot(&mut cell, px, 4, WHITE);
            named.push((&station.name, px, WHITE));
            if let Some(mount) = station.mount.at(tick) {
                let far = f64::from(CELL_PX[0]);
                let end = [
                    px[0] + far * mount.azimuth_rad.sin(),
                    px[1] - far * mount.azimuth_rad.cos(),
                ];
                let colour = if station.fires(tick) { RED } else { GREY };
                line(&mut cell, [px, end], colour);
            }
        }
        for (name, series) in &timeline.uavs {
            let Some(uav) = series.at(tick) else {
                continue;
            };
            let colour = match &*uav.status {
                "flying" => AMBER,
                "falling" | "down" => GREEN,
                _ => GREY,
            };
            let px = self.px([uav.r_enu_m.x, uav.r_enu_m.y]);
            dot(&mut cell, px, 3, colour);
            named.push((name, px, colour));
        }
        let around = |[x, y]: [f64; 2]| [x - 5.0, y - 5.0, x + 5.0, y + 5.0];
        let boxes: Vec<[f64; 4]> = named.iter().map(|(_, px, _)| around(*px)).collect();
        let places = labels_of(named.iter().map(|(name, ..)| *name), &boxes, 1.0);
        for ((name, _, colour), place) in named.iter().zip(places) {
            if let Some(place) = place {
                small_text(&mut cell, place, name, *colour);
            }
        }
        cell
    }
}

/// Fills a convex outline.
fn fill(picture: &mut RgbImage, corners: &[[f64; 2]; 4], colour: Rgb<u8>) {
    let [low, high] = [f64::min as fn(f64, f64) -> f64, f64::max].map(|of| {
        let all = corners.iter().copied();
        all.reduce(|a, b| [of(a[0], b[0]), of(a[1], b[1])])
            .unwrap_or_default()
    });
    let clip = |x: f64, side: u32| x.clamp(0.0, f64::from(side)) as i64;
    let [width, height] = [picture.width(), picture.height()];
    for y in clip(low[1].floor(), height)..clip(high[1].ceil(), height) {
        for x in clip(low[0].floor(), width)..clip(high[0].ceil(), width) {
            let p = [x as f64 + 0.5, y as f64 + 0.5];
            let ends = corners.iter().zip(corners.iter().cycle().skip(1));
            let mut sides =
                ends.map(|(a, b)| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]));
            // Mirrored, as rows run down: the corners run clockwise.
            if sides.all(|side| side <= 0.0) {
                put(picture, x, y, colour);
            }
        }
    }
}

fn dot(picture: &mut RgbImage, [x, y]: [f64; 2], half: i64, colour: Rgb<u8>) {
    for dy in -half..=half {
        for dx in -half..=half {
            put(picture, x as i64 + dx, y as i64 + dy, colour);
        }
    }
}

fn line(picture: &mut RgbImage, [from, to]: [[f64; 2]; 2], colour: Rgb<u8>) {
    let reach = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
    let steps = reach.ceil().clamp(1.0, 4_096.0) as usize;
    for step in 0..=steps {
        let u = step as f64 / steps as f64;
        let at = [0, 1].map(|i| (from[i] + u * (to[i] - from[i])) as i64);
        put(picture, at[0], at[1], colour);
    }
}

/// Writes a line of ASCII, 16 px high.
fn text(picture: &mut RgbImage, at: [u32; 2], words: &str, colour: Rgb<u8>) {
    write(picture, at.map(i64::from), words, 2, colour);
}

/// Writes a line of ASCII, 8 px high.
fn small_text(picture: &mut RgbImage, at: [f64; 2], words: &str, colour: Rgb<u8>) {
    write(picture, at.map(|x| x.round() as i64), words, 1, colour);
}

/// Writes a line of ASCII in letters of 8 by 8 dots of `dot_px` [px]; what is no ASCII is a question mark.
fn write(picture: &mut RgbImage, [x, y]: [i64; 2], words: &str, dot_px: i64, colour: Rgb<u8>) {
    for (place, letter) in words.chars().enumerate() {
        let code = if letter.is_ascii() {
            letter as usize
        } else {
            usize::from(b'?')
        };
        for (row, bits) in BASIC_LEGACY[code].iter().enumerate() {
            for column in (0..8).filter(|column| bits >> column & 1 == 1) {
                for dot in 0..dot_px * dot_px {
                    let at_x = x + dot_px * (8 * place as i64 + column) + dot % dot_px;
                    put(
                        picture,
                        at_x,
                        y + dot_px * row as i64 + dot / dot_px,
                        colour,
                    );
                }
            }
        }
    }
}

fn put(picture: &mut RgbImage, x: i64, y: i64, colour: Rgb<u8>) {
    let inside = (0..i64::from(picture.width())).contains(&x)
        && (0..i64::from(picture.height())).contains(&y);
    if inside {
        picture.put_pixel(x as u32, y as u32, colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timeline::{Series, UavAt};
    use glam::{DQuat, DVec2};

    fn count(picture: &RgbImage, colour: Rgb<u8>) -> usize {
        picture.pixels().filter(|pixel| **pixel == colour).count()
    }

    #[test]
    fn a_map_has_buildings_names_and_north() {
        let at = |x: f64, y: f64| UavAt {
            r_enu_m: DVec3::new(x, y, 50.0),
            q_enu_body: DQuat::IDENTITY,
            skin_k: 280.0,
            status: "flying".into(),
        };
        let flown = |x: f64, y: f64| Series::from_iter([(0, at(x, y))]);
        let bare = Timeline {
            tick_hz: 960,
            last_tick: 1,
            uavs: vec![
                (String::new(), flown(-100.0, -75.0)),
                (String::new(), flown(100.0, 75.0)),
            ],
            ..Timeline::default()
        };
        // 2.04 px to a metre: a building of 20 m by 10 m in the middle, askew, covers some 830 px with its walls.
        let corners = [[-10.0, -5.0], [10.0, -5.0], [10.0, 5.0], [-10.0, 5.0]].map(DVec2::from);
        let turned = corners.map(|corner| DVec2::from_angle(0.4).rotate(corner));
        let full = Timeline {
            buildings: vec![turned],
            uavs: vec![
                ("one".into(), flown(-100.0, -75.0)),
                ("two".into(), flown(100.0, 75.0)),
            ],
            ..bare.clone()
        };
        let [bare, full] = [bare, full].map(|timeline| Map::of(&timeline).draw(&timeline, 0));
        let covered = count(&full, ROOF) + count(&full, WALL);
        assert!((760..960).contains(&covered), "{covered}");
        assert_eq!(count(&bare, ROOF) + count(&bare, WALL), 0);
        // Two dots of 7 by 7, and letters beside them.
        assert_eq!(count(&bare, AMBER), 2 * 49);
        assert!(count(&full, AMBER) > 2 * 49 + 60, "{}", count(&full, AMBER));
        // The arrow stands in the upper right corner.
        let corner = imageops::crop_imm(&bare, CELL_PX[0] - 40, 0, 40, 70).to_image();
        assert!(count(&corner, WHITE) > 60, "{}", count(&corner, WHITE));
    }

    #[test]
    fn weak_boxes_are_drawn_below_strong_ones_and_only_where_asked() {
        let mark_of = |x: f64, weak: bool| Mark {
            rect_px: [x, 100.0, x + 20.0, 120.0],
            label: "uav 0.50".into(),
            weak,
        };
        let (strong, weak) = (mark_of(100.0, false), mark_of(108.0, true));
        let draw = |marks: &[&Mark]| {
            let mut cell = RgbImage::from_pixel(CELL_PX[0], CELL_PX[1], DARK);
            mark(&mut cell, marks, |at| at);
            cell
        };
        let (both, alone) = (draw(&[&strong, &weak]), draw(&[&strong]));
        assert_eq!(count(&both, GREEN), count(&alone, GREEN));
        assert!(count(&both, GREY) > 60);
    }
}
