//! A film's map from above, north up: buildings, stations with their beams, UAVs with the way they came.

use super::canvas::{Canvas, Ink};
use super::cell::Cell;
use super::error::FilmError;
use crate::media::labels::Rect;
use crate::timeline::Timeline;
use boresight_common::palette::{BAD, CARD, Colour, FLYING, GOOD, INK, LINE, SOFT};
use glam::DVec3;

/// Colour of roofs.
const ROOF: Colour = [43, 50, 60];
/// How long a UAV's way stays on the map [s], and how often it is taken [Hz].
const TRAIL_S: f64 = 10.0;
const TRAIL_HZ: f64 = 5.0;

/// The map of a recording.
pub struct Map {
    /// Middle [m, east and north], and pixels to a metre.
    middle_m: [f64; 2],
    scale: f64,
    /// Where it is drawn.
    cell: Cell,
    /// What does not move.
    ground: Canvas,
    /// Where the scale and the arrow to north stand: no name covers them.
    furniture: Vec<Rect>,
}

impl Map {
    /// One that holds all that flies, and the stations.
    pub fn of(timeline: &Timeline, cell: Cell) -> Result<Self, FilmError> {
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
            scale: fits(east, cell.size_px[0]).min(fits(north, cell.size_px[1])),
            cell,
            ground: Canvas::new(cell.size_px, CARD)?,
            furniture: Vec::new(),
        };
        map.build(timeline);
        Ok(map)
    }

    /// Draws the buildings, circles of range about the stations, the scale and where north is.
    fn build(&mut self, timeline: &Timeline) {
        let cell = self.cell;
        let [width, height] = cell.size_px.map(f64::from);
        for corners_m in &timeline.buildings {
            let corners = corners_m.map(|corner| self.px(corner.to_array()));
            self.ground.fill(&corners, ROOF);
            self.ground.outline(&corners, cell.pen(1.0), LINE);
        }
        let metres = 10f64.powf((0.3 * width / self.scale).log10().floor());
        for station in &timeline.stations {
            if let Some(r_enu_m) = timeline.r_enu_m(station) {
                let px = self.px([r_enu_m.x, r_enu_m.y]);
                for ring in 1..=4 {
                    let radius_px = f64::from(ring) * metres * self.scale;
                    let at = |step: u32| {
                        let (sine, cosine) = (f64::from(step) * 0.1).sin_cos();
                        [px[0] + radius_px * cosine, px[1] + radius_px * sine]
                    };
                    let circle: Vec<[f64; 2]> = (0..63).map(at).collect();
                    self.ground.outline(&circle, cell.pen(1.0), Ink(SOFT, 0.25));
                }
            }
        }
        let [x, y] = [cell.px(12.0), height - cell.px(14.0)];
        let end = x + metres * self.scale;
        self.ground.line(&[[x, y], [end, y]], cell.pen(2.0), INK);
        let place = [x, y - cell.px(20.0)];
        let text = format!("{metres:.0} m");
        let [text_px, _] = self.ground.words_px(cell.small_px(), &text);
        self.ground.words(place, cell.small_px(), &text, SOFT);
        let edge = cell.px(2.0);
        let right = end.max(x + text_px) + edge;
        self.furniture.push([x - edge, place[1], right, y + edge]);
        let [x, top, foot] = [width - cell.px(20.0), cell.px(12.0), cell.px(44.0)];
        self.ground.line(&[[x, foot], [x, top]], cell.pen(2.0), INK);
        let [aside, down] = [cell.px(5.0), cell.px(9.0)];
        let head = [[x - aside, top + down], [x, top], [x + aside, top + down]];
        self.ground.line(&head, cell.pen(2.0), INK);
        let north = [x - aside, cell.px(48.0)];
        self.ground.words(north, cell.small_px(), "N", INK);
        let below = north[1] + cell.px(12.0);
        self.furniture
            .push([x - aside - edge, top - edge, x + aside + edge, below]);
    }

    fn px(&self, [east_m, north_m]: [f64; 2]) -> [f64; 2] {
        [
            0.5 * f64::from(self.cell.size_px[0]) + self.scale * (east_m - self.middle_m[0]),
            0.5 * f64::from(self.cell.size_px[1]) - self.scale * (north_m - self.middle_m[1]),
        ]
    }

    /// The map at a tick.
    pub fn draw(&self, timeline: &Timeline, tick: u64) -> Canvas {
        let Cell { size_px, .. } = self.cell;
        let (px_of, pen) = (|px| self.cell.px(px), |px| self.cell.pen(px));
        let mut cell = self.ground.clone();
        let mut named: Vec<(&str, [f64; 2], Colour)> = Vec::new();
        for station in &timeline.stations {
            let Some(r_enu_m) = timeline.r_enu_m(station) else {
                continue;
            };
            let px = self.px([r_enu_m.x, r_enu_m.y]);
            if let Some(mount) = station.mount.at(tick) {
                let far = f64::from(size_px[0] + size_px[1]);
                let end = [
                    px[0] + far * mount.azimuth_rad.sin(),
                    px[1] - far * mount.azimuth_rad.cos(),
                ];
                match station.fires(tick) {
                    true => cell.line(&[px, end], pen(2.0), BAD),
                    false => cell.line(&[px, end], pen(1.0), Ink(SOFT, 0.6)),
                }
            }
            cell.dot(px, pen(5.0), INK);
            named.push((&station.name, px, INK));
        }
        let t_s = timeline.t_s(tick);
        let steps = (TRAIL_S * TRAIL_HZ) as u32;
        let back = |step: u32| t_s - f64::from(step) / TRAIL_HZ;
        let times: Vec<f64> = (0..=steps)
            .map(back)
            .take_while(|t_s| *t_s >= 0.0)
            .collect();
        for (name, series) in &timeline.uavs {
            let Some(uav) = series.at(tick) else {
                continue;
            };
            let colour = match &*uav.status {
                "flying" => FLYING,
                "falling" | "down" => GOOD,
                _ => SOFT,
            };
            let way: Vec<[f64; 2]> = (times.iter())
                .filter_map(|t_s| series.at(timeline.tick_at(*t_s)))
                .map(|uav| self.px([uav.r_enu_m.x, uav.r_enu_m.y]))
                .collect();
            cell.line(&way, pen(1.5), Ink(colour, 0.45));
            let px = self.px([uav.r_enu_m.x, uav.r_enu_m.y]);
            cell.dot(px, pen(4.0), colour);
            named.push((name, px, colour));
        }
        // Names keep off each other, off the dots of others and off the scale: one without room is left out.
        let around = |[x, y]: [f64; 2], px: f64| [x - px, y - px, x + px, y + px];
        let boxes: Vec<Rect> = (named.iter())
            .map(|(_, px, _)| around(*px, px_of(6.0)))
            .collect();
        let dots = named.iter().map(|(_, px, _)| around(*px, px_of(4.0)));
        let clear: Vec<Rect> = dots.chain(self.furniture.iter().copied()).collect();
        let names = named.iter().map(|(name, ..)| *name);
        let places = (self.cell).labels_of(&cell, names, &boxes, px_of(1.0), &clear);
        for ((name, _, colour), place) in named.iter().zip(places) {
            if let Some(place) = place {
                cell.words(place, self.cell.small_px(), name, *colour);
            }
        }
        cell
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::cell::{Grid, Size};
    use crate::timeline::{Series, UavAt};
    use glam::{DQuat, DVec2};
    use image::{RgbImage, imageops};

    fn count(picture: &RgbImage, colour: Colour) -> usize {
        picture.pixels().filter(|pixel| pixel.0 == colour).count()
    }

    fn flown(x: f64, y: f64) -> Series<UavAt> {
        let at = UavAt {
            r_enu_m: DVec3::new(x, y, 50.0),
            q_enu_body: DQuat::IDENTITY,
            skin_k: 280.0,
            status: "flying".into(),
        };
        Series::from_iter([(0, at)])
    }

    /// Two crowds in opposite corners, so close that most names find no room.
    #[test]
    fn names_hide_no_dot_and_not_the_scale() {
        let crowd = |name: &str| {
            let places = (0..30).map(|n| {
                let side = if n % 2 == 0 { -100.0 } else { 100.0 };
                let (row, column) = (f64::from(n / 2 % 4), f64::from(n / 8));
                flown(side + 9.0 * column, 0.75 * side + 8.0 * row)
            });
            Timeline {
                tick_hz: 960,
                last_tick: 1,
                uavs: places.map(|series| (name.to_owned(), series)).collect(),
                ..Timeline::default()
            }
        };
        let sizes = [None, Some(Size([1280, 720])), Some(Size([400, 300]))];
        for size in sizes {
            let Grid { cell, .. } = Grid::of(1, size);
            let [bare, named] = ["", "wave_17"].map(|name| {
                let timeline = crowd(name);
                let map = Map::of(&timeline, cell).unwrap();
                map.draw(&timeline, 0).picture()
            });
            assert_eq!([bare.width(), bare.height()], cell.size_px);
            let solid = |pixel: &image::Rgb<u8>| [FLYING, INK].contains(&pixel.0);
            let pairs = || bare.pixels().zip(named.pixels());
            let hidden = pairs().filter(|(bare, named)| solid(bare) && bare != named);
            assert_eq!(hidden.count(), 0, "{size:?}");
            // Letters are thin: their edges are mixed with the plate below them.
            let bright = |pixel: &image::Rgb<u8>| pixel.0[0] > 150 && pixel.0[2] < 90;
            let written = pairs().filter(|(bare, named)| !bright(bare) && bright(named));
            assert!(written.count() > 20, "{size:?}: no names");
        }
    }

    #[test]
    fn a_map_has_buildings_names_and_north() {
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
        let named = Timeline {
            uavs: vec![
                ("one".into(), flown(-100.0, -75.0)),
                ("two".into(), flown(100.0, 75.0)),
            ],
            ..bare.clone()
        };
        let full = Timeline {
            buildings: vec![turned],
            ..named.clone()
        };
        let [bare, named, full] = [bare, named, full].map(|timeline| {
            let map = Map::of(&timeline, Grid::of(1, None).cell).unwrap();
            map.draw(&timeline, 0).picture()
        });
        let covered = count(&named, CARD) - count(&full, CARD);
        assert!((760..1_000).contains(&covered), "{covered}");
        assert!(count(&full, ROOF) > 600 && count(&bare, ROOF) == 0);
        // Two discs of 4 px, their edges mixed with the ground; and letters beside them.
        let discs = count(&bare, FLYING);
        assert!((60..=100).contains(&discs), "{discs}");
        let written = |picture: &RgbImage| {
            let pixels = picture.pixels();
            pixels.filter(|p| p.0[0] > 150 && p.0[2] < 90).count()
        };
        assert!(written(&named) > written(&bare) + 20, "{}", written(&named));
        // The arrow stands in the upper right corner.
        let corner = imageops::crop_imm(&bare, 480 - 40, 0, 40, 70).to_image();
        assert!(count(&corner, INK) > 40, "{}", count(&corner, INK));
    }
}
