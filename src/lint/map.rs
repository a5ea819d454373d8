//! A scenario as a map: buildings, stations, sectors, paths, a scale and north.

use std::fmt::Write as _;

use glam::{DVec2, DVec3};

use super::{Flown, Scene, Seeing};

/// Longer side of the picture [px].
const SIDE_PX: f64 = 1_000.0;
/// Border around what is shown, as a share of it.
const BORDER: f64 = 0.08;
/// What is shown at least, from the middle of the stations [m].
const LEAST_REACH_M: f64 = 150.0;
/// Members of a swarm that are named on the map; all are drawn.
const NAMED_OF_SWARM: usize = 1;

/// Where metres of east and north lie in the picture.
struct Frame {
    low_m: DVec2,
    high_m: DVec2,
    px_per_m: f64,
}

impl Frame {
    fn around(points: impl Iterator<Item = DVec2>) -> Self {
        let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (low_m, high_m) =
            points.fold(none, |(low, high), point| (low.min(point), high.max(point)));
        let border_m = BORDER * (high_m - low_m).max_element();
        let (low_m, high_m) = (low_m - border_m, high_m + border_m);
        Self {
            low_m,
            high_m,
            px_per_m: SIDE_PX / (high_m - low_m).max_element(),
        }
    }

    fn size_px(&self) -> DVec2 {
        (self.high_m - self.low_m) * self.px_per_m
    }

    fn px(&self, at_m: DVec2) -> DVec2 {
        let off = (at_m - self.low_m) * self.px_per_m;
        DVec2::new(off.x, self.size_px().y - off.y)
    }

    /// Points as SVG has them.
    fn points(&self, points_m: impl IntoIterator<Item = DVec2>) -> String {
        let mut text = String::new();
        for point_m in points_m {
            let p = self.px(point_m);
            let _ = write!(text, "{:.1},{:.1} ", p.x, p.y);
        }
        text.trim_end().to_owned()
    }
}

/// The map of a scenario, as SVG. East is to the right, north is up.
pub fn svg(scene: &Scene<'_>) -> String {
    let (stations, uavs, distractors) = (scene.stations(), scene.uavs(), scene.distractors());
    let times_s = scene.times_s();
    let path = |flown: &Flown| -> Vec<DVec2> {
        (times_s.iter().map(|t_s| flown.at(*t_s).truncate())).collect()
    };
    let paths: Vec<(&Flown, Vec<DVec2>)> = (uavs.iter().chain(&distractors))
        .map(|flown| (flown, path(flown)))
        .collect();
    let asset = scene
        .loaded
        .scenario
        .tracker
        .asset_enu_m
        .map(DVec3::from_array);
    let around = |r: DVec2| [-1.0, 1.0].map(|side| r + DVec2::splat(side * LEAST_REACH_M));
    let places = stations.iter().map(|seeing| seeing.r_enu_m).chain(asset);
    let shown = places.flat_map(|r| around(r.truncate()));
    // An airliner far away would leave the city a dot.
    let uav_paths = paths
        .iter()
        .take(uavs.len())
        .flat_map(|(_, path)| path.iter().copied());
    let frame = Frame::around(shown.chain(uav_paths));

    let size = frame.size_px();
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0}\" height=\"{1:.0}\" viewBox=\"0 0 {0:.0} {1:.0}\" font-family=\"sans-serif\" font-size=\"14\">\n\
         <title>{2}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#f4f2ec\"/>\n",
        size.x,
        size.y,
        escaped(&scene.loaded.scenario.name),
    );
    text += &buildings(scene, &frame);
    for seeing in &stations {
        text += &sector(seeing, &frame);
    }
    if let Some(asset) = asset {
        let radius_px = scene.loaded.scenario.tracker.asset_radius_m * frame.px_per_m;
        text += &circle(frame.px(asset.truncate()), radius_px, "#2a7", "asset");
    }
    let mut of_swarm = std::collections::BTreeMap::new();
    for (index, (flown, path)) in paths.iter().enumerate() {
        let is_uav = index < uavs.len();
        let named = flown.swarm().is_none_or(|swarm| {
            let count = of_swarm.entry(swarm).or_insert(0);
            *count += 1;
            *count <= NAMED_OF_SWARM
        });
        text += &flight(flown, path, is_uav, named, &frame);
    }
    for seeing in &stations {
        let p = frame.px(seeing.r_enu_m.truncate());
        let _ = writeln!(
            text,
            "<path d=\"M {:.1} {:.1} l 7 12 l -14 0 z\" fill=\"#124\"/>{}",
            p.x,
            p.y - 7.0,
            label(p + DVec2::new(10.0, 5.0), &seeing.station.name, "#124")
        );
    }
    text += &scale_bar(&frame);
    text += &north(&frame);
    text + "</svg>\n"
}

/// The outlines of the buildings that the map shows.
fn buildings(scene: &Scene<'_>, frame: &Frame) -> String {
    let mut text = "<g fill=\"#c9c4b8\" stroke=\"#a39d8f\" stroke-width=\"0.5\">\n".to_owned();
    for building in &scene.city.buildings {
        let outline = building.footprint_enu_m();
        let inside = |p: &DVec2| p.cmpge(frame.low_m).all() && p.cmple(frame.high_m).all();
        if outline.iter().any(inside) {
            let points = frame.points(outline.iter().copied());
            let _ = writeln!(text, "<polygon points=\"{points}\"/>");
        }
    }
    text + "</g>\n"
}

/// A station's search sector, out to the border of the map.
fn sector(seeing: &Seeing<'_>, frame: &Frame) -> String {
    let search = seeing.station.search;
    let middle = seeing.r_enu_m.truncate();
    let reach_m = (frame.high_m - frame.low_m).length();
    if search.width_deg >= 360.0 {
        return circle(frame.px(middle), reach_m * frame.px_per_m, "#36c", "");
    }
    let steps = (search.width_deg / 2.0).ceil().max(2.0) as usize;
    let arc = (0..=steps).map(|k| {
        let share = k as f64 / steps as f64 - 0.5;
        let azimuth_rad = (search.centre_azimuth_deg + share * search.width_deg).to_radians();
        middle + reach_m * DVec2::new(azimuth_rad.sin(), azimuth_rad.cos())
    });
    let points = frame.points(std::iter::once(middle).chain(arc));
    format!(
        "<polygon class=\"sector\" points=\"{points}\" fill=\"#36c\" fill-opacity=\"0.08\" stroke=\"#36c\" stroke-dasharray=\"6 4\"/>\n"
    )
}

/// A path, its start and its name.
fn flight(flown: &Flown, path: &[DVec2], is_uav: bool, named: bool, frame: &Frame) -> String {
    let colour = if is_uav { "#c22" } else { "#777" };
    let points = frame.points(path.iter().copied());
    let mut text = format!(
        "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>\n"
    );
    if let Some(start) = path.first() {
        let p = frame.px(*start);
        let _ = writeln!(
            text,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{colour}\"/>",
            p.x, p.y
        );
        if named {
            text += &label(p + DVec2::new(7.0, -6.0), &flown.name, colour);
        }
    }
    text
}

fn circle(middle: DVec2, radius_px: f64, colour: &str, name: &str) -> String {
    let mut text = format!(
        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius_px:.1}\" fill=\"{colour}\" fill-opacity=\"0.08\" stroke=\"{colour}\" stroke-dasharray=\"6 4\"/>\n",
        middle.x, middle.y
    );
    if !name.is_empty() {
        text += &label(middle + DVec2::new(6.0, -6.0), name, colour);
    }
    text
}

fn label(at: DVec2, name: &str, colour: &str) -> String {
    format!(
        "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\" stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\">{}</text>\n",
        at.x,
        at.y,
        escaped(name)
    )
}

/// A bar of a round length, about a fifth of the picture.
fn scale_bar(frame: &Frame) -> String {
    let wanted_m = 0.2 * (frame.high_m - frame.low_m).x;
    let power = 10.0_f64.powf(wanted_m.log10().floor());
    let steps = [5.0, 2.0, 1.0].map(|step| step * power);
    let length_m = steps
        .into_iter()
        .find(|step| *step <= wanted_m)
        .unwrap_or(power);
    let length_px = length_m * frame.px_per_m;
    let y = frame.size_px().y - 24.0;
    let words = match length_m >= 1_000.0 {
        true => format!("{} km", length_m / 1_000.0),
        false => format!("{length_m} m"),
    };
    format!(
        "<path class=\"scale\" d=\"M 20 {:.1} v 8 h {length_px:.1} v -8\" fill=\"none\" stroke=\"#000\" stroke-width=\"2\"/>\n{}",
        y,
        label(DVec2::new(24.0, y + 2.0), &words, "#000")
    )
}

/// An arrow to the north.
fn north(frame: &Frame) -> String {
    let x = frame.size_px().x - 30.0;
    format!(
        "<path class=\"north\" d=\"M {x:.1} 18 l 8 26 l -8 -6 l -8 6 z\" fill=\"#000\"/>\n{}",
        label(DVec2::new(x - 5.0, 60.0), "N", "#000")
    )
}

/// A text as XML has it.
fn escaped(text: &str) -> String {
    let text = text
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    let printable = |c: &char| !c.is_control();
    text.replace('"', "&quot;")
        .chars()
        .filter(printable)
        .collect()
}
