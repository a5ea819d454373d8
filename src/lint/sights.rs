//! Who is seen when, from where and how large, as a table.

use super::{Flown, Scene, Seeing, View};
use crate::output::columns;

/// Members of a swarm that the table shows; the others are much the same.
const SHOWN_OF_SWARM: usize = 3;

/// What a station sees of a UAV.
pub(super) struct Sight {
    /// At the start.
    pub(super) start: View,
    /// First clear sight: when [s], and how it lies there then.
    pub(super) first: Option<(f64, View)>,
}

impl Scene<'_> {
    /// What a station sees of a flying thing, at the given times [s].
    pub(super) fn sight(&self, seeing: &Seeing<'_>, flown: &Flown, times_s: &[f64]) -> Sight {
        let first = times_s.iter().find_map(|t_s| {
            let r_enu_m = flown.at(*t_s);
            let clear = self.clear(seeing.r_enu_m, r_enu_m);
            clear.then(|| (*t_s, seeing.view(r_enu_m)))
        });
        Sight {
            start: seeing.view(flown.at(0.0)),
            first,
        }
    }
}

/// A row for each UAV and station: range, direction and size in each camera at the start, and the first clear sight
/// against the city along its planned path. Empty where nothing flies.
pub fn table(scene: &Scene<'_>) -> String {
    let (stations, uavs, times_s) = (scene.stations(), scene.uavs(), scene.times_s());
    if uavs.is_empty() {
        return String::new();
    }
    let several = stations.len() > 1;
    let cameras = cameras(&stations);
    let mut rows = Vec::new();
    let mut shown_of_swarm = std::collections::BTreeMap::new();
    let mut left_out = 0;
    for uav in &uavs {
        if let Some(swarm) = uav.swarm() {
            let shown = shown_of_swarm.entry(swarm).or_insert(0);
            *shown += 1;
            if *shown > SHOWN_OF_SWARM {
                left_out += 1;
                continue;
            }
        }
        for seeing in &stations {
            rows.push(row(scene, seeing, uav, &times_s, (&cameras, several)));
        }
    }
    let head = head(&cameras, several);
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let mut text = columns(&head, &rows, 1);
    if left_out > 0 {
        text +=
            &format!("and {left_out} more members of swarms, which are taken to fly straight on\n");
    }
    text
}

/// The cameras of all stations, each once, in their order.
fn cameras(stations: &[Seeing<'_>]) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for camera in stations
        .iter()
        .flat_map(|seeing| seeing.station.config.cameras.all())
    {
        let word = word(&camera.place, &camera.name);
        if words.iter().all(|known| known != word) {
            words.push(word.to_owned());
        }
    }
    words
}

fn head(cameras: &[String], several: bool) -> Vec<String> {
    let mut head = vec!["UAV".to_owned()];
    if several {
        head.push("station".to_owned());
    }
    head.extend(["range m", "azimuth °", "elevation °"].map(String::from));
    head.extend(cameras.iter().map(|camera| format!("{camera} px")));
    head.extend(["first seen s", "at m"].map(String::from));
    head
}

/// A camera's plain name.
fn word<'n>(place: &'n str, name: &'n str) -> &'n str {
    if place.starts_with("more") {
        name
    } else {
        place
    }
}

fn row(
    scene: &Scene<'_>,
    seeing: &Seeing<'_>,
    uav: &Flown,
    times_s: &[f64],
    (cameras, several): (&[String], bool),
) -> Vec<String> {
    let sight = scene.sight(seeing, uav, times_s);
    let mut row = vec![uav.name.clone()];
    if several {
        row.push(seeing.station.name.clone());
    }
    let [az_deg, el_deg] = sight.start.az_el_deg();
    row.push(format!("{:.0}", sight.start.range_m));
    row.push(format!("{az_deg:.1}"));
    row.push(format!("{el_deg:.1}"));
    for wanted in cameras {
        let mut own = seeing.station.config.cameras.all().into_iter();
        let camera = own.find(|camera| word(&camera.place, &camera.name) == wanted);
        row.push(camera.map_or("-".to_owned(), |camera| {
            format!("{:.1}", sight.start.size_px(uav.size_m(), &camera.config))
        }));
    }
    match sight.first {
        Some((t_s, view)) => row.extend([format!("{t_s:.1}"), format!("{:.0}", view.range_m)]),
        None => row.extend(["never".to_owned(), "-".to_owned()]),
    }
    row
}
