//! `boresight video`: a film of a recording, its cameras side by side over a map and the states.

mod canvas;
mod cell;
mod error;
mod map;

pub use cell::Size;
pub use error::FilmError;

use super::read::Recorded;
use super::timeline::{CameraTrack, Mark, Timeline};
use crate::media::image as pictures;
use crate::media::video::Writer;
use boresight_common::palette::{BAD, GOOD, INK, PAPER, SOFT};
use canvas::Canvas;
use cell::{Cell, Grid};
use clap::{Args, ValueEnum};
use image::imageops::{self, FilterType};
use map::Map;
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
    /// Width and height of the film [px], even, from 320x240 to 4096x2160; letters and lines grow with it. By default each
    /// camera and the map has 480x360.
    #[arg(long, value_name = "WIDTHxHEIGHT")]
    pub size: Option<Size>,
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

/// Letters of names and states [px].
const LARGE_PX: f32 = 17.0;

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
    let grid = Grid::of(cells, arguments.size);
    let size_px = grid.size_px;
    let map = Map::of(&timeline, grid.cell)?;
    let mut writer = Writer::create(&arguments.film, size_px, arguments.rate_hz.into())?;
    let end_s = timeline.t_s(timeline.last_tick);
    let count = (end_s / arguments.speed * f64::from(arguments.rate_hz)) as usize + 1;
    for number in 0..count {
        let t_s = number as f64 / f64::from(arguments.rate_hz) * arguments.speed;
        let tick = timeline.tick_at(t_s);
        let mut picture = Canvas::new(size_px, PAPER)?;
        for (cell, camera) in cameras.iter().enumerate() {
            if let Some(drawn) = camera_cell(camera, tick, grid.cell, arguments)? {
                picture.lay(grid.corner(cell), &drawn.picture());
            }
        }
        if shows(Layout::Map) {
            let drawn = map.draw(&timeline, tick).picture();
            picture.lay(grid.corner(cameras.len()), &drawn);
        }
        strip(&mut picture, &grid, &timeline, t_s);
        writer.push(&picture.picture())?;
    }
    writer.finish(arguments.rate_hz.into())?;
    Ok(count)
}

/// A camera's last picture, with what is drawn on it, as large as a cell takes.
fn camera_cell(
    camera: &CameraTrack,
    tick: u64,
    cell: Cell,
    arguments: &Arguments,
) -> Result<Option<Canvas>, FilmError> {
    let Some(jpeg) = camera.pictures.at(tick) else {
        return Ok(None);
    };
    let picture = pictures::decode(jpeg).map_err(|source| FilmError::Picture {
        path: arguments.recording.clone(),
        source,
    })?;
    let Cell { size_px, .. } = cell;
    let [width, height] = size_px.map(f64::from);
    let scale = (width / f64::from(picture.width())).min(height / f64::from(picture.height()));
    let [w, h] = [picture.width(), picture.height()].map(|side| (f64::from(side) * scale) as u32);
    let large = imageops::resize(&picture, w.max(1), h.max(1), FilterType::Triangle);
    let mut drawn = Canvas::new(size_px, PAPER)?;
    let [left, top] = [(size_px[0] - w) / 2, (size_px[1] - h) / 2];
    drawn.lay([left, top], &large);
    let at = |[x, y]: [f64; 2]| [x * scale + f64::from(left), y * scale + f64::from(top)];
    if let Some(marks) = camera.marks_at(tick) {
        let shown: Vec<&Mark> = (marks.boxes.iter().rev())
            .filter(|mark| arguments.weak || !mark.weak)
            .collect();
        mark(&mut drawn, cell, &shown, at);
        if let Some([x, y]) = marks.reticle_px.map(at) {
            for [dx, dy] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
                let arm = |px: f64| [x + cell.px(px) * dx, y + cell.px(px) * dy];
                drawn.line(&[arm(5.0), arm(14.0)], cell.pen(1.5), INK);
            }
        }
    }
    let corner = [8.0, 5.0].map(|px| cell.px(px));
    drawn.words(corner, cell.pen(LARGE_PX), &camera.name, INK);
    Ok(Some(drawn))
}

/// Draws boxes, the strongest first, with their labels; what is stronger lies on what is weaker.
fn mark(canvas: &mut Canvas, cell: Cell, marks: &[&Mark], at: impl Fn([f64; 2]) -> [f64; 2]) {
    let boxes: Vec<[f64; 4]> = (marks.iter())
        .map(|mark| {
            let [x0, y0, x1, y1] = mark.rect_px;
            let ([x0, y0], [x1, y1]) = (at([x0, y0]), at([x1, y1]));
            [x0, y0, x1, y1]
        })
        .collect();
    let texts = marks.iter().map(|mark| &*mark.label);
    let places = cell.labels_of(canvas, texts, &boxes, cell.px(2.0), &[]);
    for ((mark, [x0, y0, x1, y1]), place) in marks.iter().zip(&boxes).zip(places).rev() {
        let colour = if mark.weak { SOFT } else { GOOD };
        let corners = [[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]];
        canvas.outline(&corners, cell.pen(1.5), colour);
        if let Some(place) = place {
            canvas.words(place, cell.small_px(), &mark.label, colour);
        }
    }
}

/// The strip below: time, the state of every station, and how many UAVs fly.
fn strip(picture: &mut Canvas, grid: &Grid, timeline: &Timeline, t_s: f64) {
    let (tick, cell) = (timeline.tick_at(t_s), grid.cell);
    let (top, large) = (grid.strip_top() + cell.px(6.0), cell.pen(LARGE_PX));
    let left = cell.px(8.0);
    picture.words([left, top], large, &format!("{t_s:.2} s"), INK);
    let mut x = cell.px(120.0);
    for station in &timeline.stations {
        let fires = station.fires(tick);
        let state = station.track.at(tick).map_or("", |track| &track.state);
        let word = if fires { "fires" } else { state };
        let shown = match timeline.stations.len() {
            1 => word.to_owned(),
            _ => format!("{} {word}", station.name),
        };
        picture.words([x, top], large, &shown, if fires { BAD } else { INK });
        x += picture.words_px(large, &shown)[0] + cell.px(24.0);
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
    let below = top + cell.px(24.0);
    picture.words([left, below], cell.pen(14.0), &uavs, SOFT);
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_common::palette::Colour;

    #[test]
    fn weak_boxes_are_drawn_below_strong_ones_and_only_where_asked() {
        let mark_of = |x: f64, weak: bool| Mark {
            rect_px: [x, 100.0, x + 20.0, 120.0],
            label: "uav 0.50".into(),
            weak,
        };
        let (strong, weak) = (mark_of(100.0, false), mark_of(108.0, true));
        let draw = |marks: &[&Mark]| {
            let Grid { cell, .. } = Grid::of(1, None);
            let mut canvas = Canvas::new(cell.size_px, PAPER).unwrap();
            mark(&mut canvas, cell, marks, |at| at);
            canvas.picture()
        };
        // Edges are mixed with what lies below them.
        let near = |pixel: &image::Rgb<u8>, colour: Colour| {
            (0..3).all(|i| pixel.0[i].abs_diff(colour[i]) < 48)
        };
        let count = |picture: &image::RgbImage, colour: Colour| {
            picture.pixels().filter(|pixel| near(pixel, colour)).count()
        };
        let (both, alone) = (draw(&[&strong, &weak]), draw(&[&strong]));
        // Nothing of the strong one is covered.
        assert!(count(&both, GOOD) >= count(&alone, GOOD));
        assert!(count(&both, SOFT) > count(&alone, SOFT) + 60);
    }
}
