//! `boresight video`: a film of a recording, its cameras side by side over a map and the states.

use super::read::{Decoder, ReadError, Recorded};
use crate::media::image::{self as pictures, ImageError};
use crate::media::video::{VideoError, Writer};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use clap::{Args, ValueEnum};
use font8x8::legacy::BASIC_LEGACY;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use serde_json::Value;
use std::collections::BTreeMap;
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
    #[error("{}: a picture cannot be read: {source}", path.display())]
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

/// What was recorded at a time, in the order of time.
struct Track<T>(Vec<(u64, T)>);

impl<T> Default for Track<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Track<T> {
    /// The last one up to a tick.
    fn at(&self, tick: u64) -> Option<&T> {
        let after = self.0.partition_point(|(of, _)| *of <= tick);
        Some(&self.0.get(after.checked_sub(1)?)?.1)
    }
}

/// All that a film shows.
#[derive(Default)]
struct Scenes {
    /// The cameras with pictures, in the order of their channels.
    cameras: BTreeMap<u16, String>,
    /// JPEG files by camera.
    pictures: BTreeMap<String, Track<Vec<u8>>>,
    /// Lines on a camera's pictures by the time stamp of the picture: colour and ends [px].
    lines: BTreeMap<(String, String), Vec<Stroke>>,
    /// Time stamps of a camera's pictures.
    stamps: BTreeMap<String, Track<String>>,
    /// Place and status by UAV.
    uavs: BTreeMap<String, Track<([f64; 2], String)>>,
    /// Tracking state by station.
    states: BTreeMap<String, Track<String>>,
    /// Whether the laser fires, by station.
    firing: BTreeMap<String, Track<bool>>,
    /// Azimuth by station [rad].
    azimuths: BTreeMap<String, Track<f64>>,
    last_tick: u64,
}

type Stroke = (Rgb<u8>, [[f64; 2]; 2]);

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
    let recorded = Recorded::open(&arguments.recording)?;
    let scenes = Scenes::of(&recorded);
    let nothing = |what| FilmError::Nothing {
        path: arguments.recording.clone(),
        what,
    };
    let shows = |layout| [Layout::All, layout].contains(&arguments.layout);
    let cameras: Vec<&String> = match shows(Layout::Cameras) {
        true => scenes.cameras.values().collect(),
        false => Vec::new(),
    };
    if arguments.layout == Layout::Cameras && cameras.is_empty() {
        return Err(nothing(
            "pictures: take --layout map, or record a run that renders",
        ));
    }
    if scenes.last_tick == 0 {
        return Err(nothing("states: its run was stopped before the first"));
    }
    let cells = cameras.len() + usize::from(shows(Layout::Map));
    let columns = cells.min(2);
    let rows = cells.div_ceil(2);
    let size_px = [
        CELL_PX[0] * columns as u32,
        CELL_PX[1] * rows as u32 + STRIP_PX,
    ];
    let map = Map::of(&scenes, &recorded);
    let mut writer = Writer::create(&arguments.film, size_px, arguments.rate_hz.into())?;
    let end_s = recorded.t_s(scenes.last_tick);
    let count = (end_s / arguments.speed * f64::from(arguments.rate_hz)) as usize + 1;
    for number in 0..count {
        let t_s = number as f64 / f64::from(arguments.rate_hz) * arguments.speed;
        let tick = (t_s * f64::from(recorded.tick_hz)).round() as u64;
        let mut picture = RgbImage::from_pixel(size_px[0], size_px[1], DARK);
        let corner = |cell: usize| {
            [
                i64::from(CELL_PX[0]) * (cell % 2) as i64,
                i64::from(CELL_PX[1]) * (cell / 2) as i64,
            ]
        };
        for (cell, camera) in cameras.iter().enumerate() {
            let shown = scenes
                .camera(camera, tick)
                .map_err(|source| FilmError::Picture {
                    path: arguments.recording.clone(),
                    source,
                })?;
            if let Some(shown) = shown {
                let [x, y] = corner(cell);
                imageops::overlay(&mut picture, &shown, x, y);
            }
        }
        if shows(Layout::Map) {
            let [x, y] = corner(cameras.len());
            imageops::overlay(&mut picture, &map.draw(&scenes, tick), x, y);
        }
        scenes.strip(&mut picture, t_s, tick);
        writer.push(&picture)?;
    }
    writer.finish(arguments.rate_hz.into())?;
    Ok(count)
}

impl Scenes {
    fn of(recorded: &Recorded) -> Self {
        let mut scenes = Self::default();
        let mut decoder = Decoder::default();
        for message in recorded.messages() {
            let tick = recorded.tick(&message);
            let topic = message.channel.topic.clone();
            let station = |kind: &str| {
                let rest = topic.strip_prefix("/boresight/")?.strip_suffix(kind)?;
                Some(rest.trim_end_matches('/').to_owned())
            };
            let camera = |kind: &str| Some(topic.strip_prefix('/')?.strip_suffix(kind)?.to_owned());
            let wanted = ["/image", "/annotations", "_state"]
                .iter()
                .any(|end| topic.ends_with(end));
            let Some(fields) = wanted.then(|| decoder.decode(&message)).flatten() else {
                continue;
            };
            let stamp = fields["timestamp"].to_string();
            if let Some(camera) = camera("/image") {
                let data = fields["data"].as_str().unwrap_or_default();
                if let Ok(jpeg) = BASE64_STANDARD.decode(data) {
                    scenes.cameras.insert(message.channel.id, camera.clone());
                    scenes
                        .pictures
                        .entry(camera.clone())
                        .or_default()
                        .0
                        .push((tick, jpeg));
                    scenes
                        .stamps
                        .entry(camera)
                        .or_default()
                        .0
                        .push((tick, stamp));
                }
            } else if let Some(camera) = camera("/annotations") {
                scenes.lines.insert((camera, stamp), strokes(&fields));
            } else if topic == "/boresight/uav_state" {
                let r = &fields["r_enu_m"];
                let at = [&r["x"], &r["y"]].map(|value| value.as_f64().unwrap_or(0.0));
                let text = |key: &str| fields[key].as_str().unwrap_or_default().to_owned();
                scenes
                    .uavs
                    .entry(text("name"))
                    .or_default()
                    .0
                    .push((tick, (at, text("status"))));
                scenes.last_tick = tick;
            } else if let Some(station) = station("track_state") {
                let state = fields["state"].as_str().unwrap_or_default().to_owned();
                scenes
                    .states
                    .entry(station)
                    .or_default()
                    .0
                    .push((tick, state));
                scenes.last_tick = tick;
            } else if let Some(station) = station("beam_state") {
                let firing = fields["firing"].as_bool().unwrap_or(false);
                scenes
                    .firing
                    .entry(station)
                    .or_default()
                    .0
                    .push((tick, firing));
            } else if let Some(station) = station("mount_state") {
                let azimuth_rad = fields["azimuth_rad"].as_f64().unwrap_or(0.0);
                scenes
                    .azimuths
                    .entry(station)
                    .or_default()
                    .0
                    .push((tick, azimuth_rad));
            }
        }
        scenes
    }

    /// A camera's last picture, with what is drawn on it, as large as a cell takes.
    fn camera(&self, camera: &str, tick: u64) -> Result<Option<RgbImage>, ImageError> {
        let Some(jpeg) = self.pictures.get(camera).and_then(|track| track.at(tick)) else {
            return Ok(None);
        };
        let picture = pictures::decode(jpeg)?;
        let [width, height] = [0, 1].map(|i| f64::from(CELL_PX[i]));
        let scale = (width / f64::from(picture.width())).min(height / f64::from(picture.height()));
        let [w, h] =
            [picture.width(), picture.height()].map(|side| (f64::from(side) * scale) as u32);
        let large = imageops::resize(&picture, w.max(1), h.max(1), FilterType::Triangle);
        let mut cell = RgbImage::from_pixel(CELL_PX[0], CELL_PX[1], DARK);
        let [left, top] = [(CELL_PX[0] - w) / 2, (CELL_PX[1] - h) / 2];
        imageops::overlay(&mut cell, &large, left.into(), top.into());
        let stamp = self.stamps.get(camera).and_then(|track| track.at(tick));
        let lines = stamp.and_then(|stamp| self.lines.get(&(camera.to_owned(), stamp.clone())));
        for (colour, ends) in lines.into_iter().flatten() {
            let at = |[x, y]: [f64; 2]| [x * scale + f64::from(left), y * scale + f64::from(top)];
            line(&mut cell, ends.map(at), *colour);
        }
        text(&mut cell, [8, 8], camera, WHITE);
        Ok(Some(cell))
    }

    /// The strip below: time, and the state of every station.
    fn strip(&self, picture: &mut RgbImage, t_s: f64, tick: u64) {
        let top = picture.height() - STRIP_PX + 8;
        text(picture, [8, top], &format!("{t_s:7.2} s"), WHITE);
        let mut x = 180;
        for (station, states) in &self.states {
            let state = states.at(tick).map_or("", String::as_str);
            let fires = self.firing.get(station).and_then(|track| track.at(tick)) == Some(&true);
            let word = if fires { "fires" } else { state };
            let shown = format!("{station} {word}");
            text(
                picture,
                [x, top],
                shown.trim(),
                if fires { RED } else { WHITE },
            );
            x += 16 * (shown.len() as u32 + 2);
        }
        let count = |wanted: &[&str]| {
            let states = self.uavs.values().filter_map(|track| track.at(tick));
            states
                .filter(|(_, status)| wanted.contains(&status.as_str()))
                .count()
        };
        let uavs = format!(
            "{} flying, {} neutralised, {} crashed",
            count(&["flying"]),
            count(&["falling", "down"]),
            count(&["struck", "crashed"])
        );
        text(picture, [8, top + 24], &uavs, GREY);
    }
}

/// The lines of an annotation message.
fn strokes(fields: &Value) -> Vec<Stroke> {
    let mut strokes = Vec::new();
    let empty = Vec::new();
    for shape in fields["points"].as_array().unwrap_or(&empty) {
        let colour = &shape["outline_color"];
        let part = |key: &str| (255.0 * colour[key].as_f64().unwrap_or(1.0)) as u8;
        let colour = Rgb([part("r"), part("g"), part("b")]);
        let points: Vec<[f64; 2]> = (shape["points"].as_array().unwrap_or(&empty).iter())
            .map(|point| ["x", "y"].map(|key| point[key].as_f64().unwrap_or(0.0)))
            .collect();
        match shape["type"].as_str() {
            Some("LINE_LIST") => {
                strokes.extend((points.chunks_exact(2)).map(|pair| (colour, [pair[0], pair[1]])))
            }
            _ => {
                let next = points.iter().cycle().skip(1);
                strokes.extend(points.iter().zip(next).map(|(a, b)| (colour, [*a, *b])));
            }
        }
    }
    strokes
}

/// A map from above.
struct Map {
    /// Middle [m, east and north], and pixels to a metre.
    middle_m: [f64; 2],
    scale: f64,
    /// Stations by their name in topics [m, east and north].
    stations: BTreeMap<String, [f64; 2]>,
}

impl Map {
    /// One that holds all that flies, and the stations.
    fn of(scenes: &Scenes, recorded: &Recorded) -> Self {
        let scenario = recorded.scenario(&[]).ok();
        let mut stations = BTreeMap::new();
        if let Some(loaded) = scenario {
            for (index, station) in loaded.scenario.stations().into_iter().enumerate() {
                let r = station.config.position_enu_m.unwrap_or_default();
                let name = if index == 0 {
                    String::new()
                } else {
                    station.name
                };
                stations.insert(name, [r[0], r[1]]);
            }
        }
        let flown = scenes
            .uavs
            .values()
            .flat_map(|track| track.0.iter().map(|(_, (at, _))| *at));
        let all: Vec<[f64; 2]> = flown.chain(stations.values().copied()).collect();
        let span = |axis: usize| {
            let values = all.iter().map(|at| at[axis]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
            if low <= high { (low, high) } else { (0.0, 0.0) }
        };
        let (east, north) = (span(0), span(1));
        let fits = |(low, high): (f64, f64), px: u32| 0.85 * f64::from(px) / (high - low).max(50.0);
        Self {
            middle_m: [0.5 * (east.0 + east.1), 0.5 * (north.0 + north.1)],
            scale: fits(east, CELL_PX[0]).min(fits(north, CELL_PX[1])),
            stations,
        }
    }

    fn px(&self, [east_m, north_m]: [f64; 2]) -> [f64; 2] {
        [
            0.5 * f64::from(CELL_PX[0]) + self.scale * (east_m - self.middle_m[0]),
            0.5 * f64::from(CELL_PX[1]) - self.scale * (north_m - self.middle_m[1]),
        ]
    }

    fn draw(&self, scenes: &Scenes, tick: u64) -> RgbImage {
        let mut cell = RgbImage::from_pixel(CELL_PX[0], CELL_PX[1], Rgb([26, 30, 37]));
        for track in scenes.uavs.values() {
            let Some((at, status)) = track.at(tick) else {
                continue;
            };
            let colour = match status.as_str() {
                "flying" => AMBER,
                "falling" | "down" => GREEN,
                _ => GREY,
            };
            dot(&mut cell, self.px(*at), 3, colour);
        }
        for (station, at) in &self.stations {
            let px = self.px(*at);
            dot(&mut cell, px, 4, WHITE);
            if let Some(azimuth_rad) = scenes.azimuths.get(station).and_then(|t| t.at(tick)) {
                let fires = scenes.firing.get(station).and_then(|t| t.at(tick)) == Some(&true);
                let far = f64::from(CELL_PX[0]);
                let end = [
                    px[0] + far * azimuth_rad.sin(),
                    px[1] - far * azimuth_rad.cos(),
                ];
                line(&mut cell, [px, end], if fires { RED } else { GREY });
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
        cell
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
fn text(picture: &mut RgbImage, [x, y]: [u32; 2], words: &str, colour: Rgb<u8>) {
    for (place, byte) in words.bytes().enumerate() {
        let glyph = BASIC_LEGACY[usize::from(byte & 0x7f)];
        for (row, bits) in glyph.iter().enumerate() {
            for column in (0..8).filter(|column| bits >> column & 1 == 1) {
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let at_x = i64::from(x) + 16 * place as i64 + 2 * column + dx;
                    put(picture, at_x, i64::from(y) + 2 * row as i64 + dy, colour);
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
