//! Who is seen when, from where and how large, as a table.

use super::{Flown, Scene, Seeing, View};

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
    let mut rows = vec![head(&stations, several)];
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
            rows.push(row(scene, seeing, uav, &times_s, several));
        }
    }
    let mut text = aligned(&rows);
    if left_out > 0 {
        text +=
            &format!("and {left_out} more members of swarms, which are taken to fly straight on\n");
    }
    text
}

fn head(stations: &[Seeing<'_>], several: bool) -> Vec<String> {
    let mut head = vec!["UAV".to_owned()];
    if several {
        head.push("station".to_owned());
    }
    head.extend(["range m", "azimuth °", "elevation °"].map(String::from));
    let cameras = stations
        .first()
        .map(|seeing| seeing.station.config.cameras.all());
    let cameras = cameras.into_iter().flatten();
    head.extend(cameras.map(|camera| format!("{} px", word(&camera.place, &camera.name))));
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
    several: bool,
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
    for camera in seeing.station.config.cameras.all() {
        let size_px = sight.start.size_px(uav.size_m(), &camera.config);
        row.push(format!("{size_px:.1}"));
    }
    match sight.first {
        Some((t_s, view)) => row.extend([format!("{t_s:.1}"), format!("{:.0}", view.range_m)]),
        None => row.extend(["never".to_owned(), "-".to_owned()]),
    }
    row
}

/// Rows as columns: the first flush left, the others flush right under their heads. Rows may be of several lengths, as
/// stations have several cameras: the last two columns stay the last.
fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let filled: Vec<Vec<String>> = (rows.iter())
        .map(|row| {
            let mut row = row.clone();
            let last = row.len().saturating_sub(2);
            let blanks = std::iter::repeat_n(String::new(), columns - row.len());
            row.splice(last..last, blanks);
            row
        })
        .collect();
    let width = |column: usize| {
        let cells = filled.iter().map(|row| row[column].chars().count());
        cells.max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in &filled {
        let cells = row.iter().zip(&widths).enumerate();
        let cells = cells.map(|(column, (cell, width))| match column {
            0 => format!("{cell:<width$}"),
            _ => format!("{cell:>width$}"),
        });
        text += cells.collect::<Vec<_>>().join("  ").trim_end();
        text.push('\n');
    }
    text
}
