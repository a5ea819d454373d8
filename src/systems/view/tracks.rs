//! The list of tracks: in the order of their identities, and no row moves under the pointer.

use super::style::{AMBER, GREY};
use crate::components::detect::DetectorInUse;
use crate::components::flight::{Flight, Uav};
use crate::components::mount::{Mount, Station};
use crate::components::operator::Designation;
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::components::view::{Pacing, TrackRow, TrackRows, WindowFrame};
use crate::models::decision::belief::Belief;
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::tracking::table::separation_rad;
use bevy::prelude::*;
use bevy_egui::egui;
use glam::DVec2;
use std::collections::BTreeMap;

/// How long a row stays after its track has ended [s of the wall clock].
const KEPT_S: f64 = 5.0;
/// A track this near to a UAV is listed under its name [rad].
const SAME_RAD: f64 = 5e-3;

/// Takes the rows of all stations over from their tracks.
pub fn follow_tracks(
    frame: Res<WindowFrame>,
    clock: Res<SimClock>,
    pacing: Res<Pacing>,
    detector: Res<DetectorInUse>,
    stations: Query<(&Station, &Mount, &Tracker)>,
    uavs: Query<(&Uav, &Flight)>,
    mut rows: ResMut<TrackRows>,
) {
    // While time stands still no row leaves, nor while the pointer is over the list.
    let still = pacing.paused || pacing.over || rows.pointed_at;
    let passed_s = if still { 0.0 } else { frame.wall_s };
    for (station, mount, tracker) in &stations {
        let known: Vec<(&str, DVec2)> = (uavs.iter())
            .map(|(uav, flight)| {
                let at_rad = los_to_az_el(flight.state.r_enu_m - mount.r_enu_m);
                (uav.name.as_str(), at_rad)
            })
            .collect();
        let tracks = tracker.table.tracks.iter().map(|track| {
            let az_el_rad = track.filter.predicted(clock.t_s()).az_el_rad();
            let name = (known.iter())
                .map(|(name, at_rad)| (separation_rad(*at_rad, az_el_rad), *name))
                .filter(|(apart_rad, _)| *apart_rad < SAME_RAD)
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map_or("unknown", |(_, name)| name);
            let [az_deg, el_deg] = az_el_rad.to_array().map(f64::to_degrees);
            let (az_deg, class) = (az_deg.rem_euclid(360.0), detector.class(track.label()));
            (
                track.id,
                format!("{name}, {class} {az_deg:.0}° {el_deg:.1}°"),
            )
        });
        follow(
            rows.lists.entry(station.index).or_default(),
            tracks.collect(),
            passed_s,
        );
    }
}

/// The rows after `passed_s` more seconds [s], of the `tracks` that there are by then.
fn follow(rows: &mut BTreeMap<u32, TrackRow>, tracks: BTreeMap<u32, String>, passed_s: f64) {
    for (id, row) in rows.iter_mut() {
        if !tracks.contains_key(id) {
            row.ended_s = Some(row.ended_s.map_or(0.0, |ended_s| ended_s + passed_s));
        }
    }
    rows.retain(|_, row| row.ended_s.is_none_or(|ended_s| ended_s < KEPT_S));
    for (id, text) in tracks {
        let ended_s = None;
        rows.insert(id, TrackRow { text, ended_s });
    }
}

/// The list; what the operator has clicked.
pub fn list(
    ui: &mut egui::Ui,
    rows: Option<&BTreeMap<u32, TrackRow>>,
    tracker: &Tracker,
) -> Option<Designation> {
    let rows = rows.filter(|rows| !rows.is_empty());
    let Some(rows) = rows else {
        ui.colored_label(GREY, "no tracks");
        return None;
    };
    // A row of two lines would move those below it.
    ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Truncate);
    let mut chosen = None;
    for (id, row) in rows {
        let target = tracker.target == Some(*id);
        let pinned = row.ended_s.is_none() && target && tracker.designated;
        let note = if pinned { ", pinned" } else { "" };
        let mut text = egui::RichText::new(format!("#{id} {}{note}", row.text));
        if row.ended_s.is_some() {
            text = text.color(GREY).strikethrough();
        } else if target {
            text = text.color(AMBER);
        }
        let button = egui::RadioButton::new(target, text);
        let button = ui.add_enabled(row.ended_s.is_none(), button);
        let belief = tracker.beliefs.get(id).map(Belief::in_words);
        let belief = belief.map_or(String::new(), |belief| format!("a UAV at {belief}; "));
        if button
            .on_hover_text(format!("{belief}a click pins the track"))
            .clicked()
        {
            chosen = Some(Designation::Track(*id));
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tracks(ids: &[u32]) -> BTreeMap<u32, String> {
        ids.iter().map(|id| (*id, format!("track {id}"))).collect()
    }

    #[test]
    fn a_row_keeps_its_place_for_some_seconds_after_its_track() {
        let mut rows = BTreeMap::new();
        let ids = |rows: &BTreeMap<u32, TrackRow>| rows.keys().copied().collect::<Vec<_>>();
        follow(&mut rows, tracks(&[7, 2, 4]), 0.1);
        assert_eq!(ids(&rows), [2, 4, 7]);
        // The second ends; a new one comes after the last.
        follow(&mut rows, tracks(&[2, 7, 9]), 0.1);
        assert_eq!(ids(&rows), [2, 4, 7, 9]);
        assert!(rows[&4].ended_s.is_some() && rows[&7].ended_s.is_none());
        follow(&mut rows, tracks(&[2, 7, 9]), KEPT_S - 0.1);
        assert_eq!(ids(&rows), [2, 4, 7, 9]);
        // While nothing passes, as under the pointer, it stays for good.
        for _ in 0..1_000 {
            follow(&mut rows, tracks(&[2, 7, 9]), 0.0);
        }
        assert_eq!(ids(&rows), [2, 4, 7, 9]);
        follow(&mut rows, tracks(&[2, 7, 9]), 0.2);
        assert_eq!(ids(&rows), [2, 7, 9]);
    }

    #[test]
    fn a_track_that_comes_back_is_no_longer_ended() {
        let mut rows = BTreeMap::new();
        follow(&mut rows, tracks(&[3]), 0.1);
        follow(&mut rows, tracks(&[]), 1.0);
        assert!(rows[&3].ended_s.is_some());
        follow(&mut rows, tracks(&[3]), 1.0);
        assert_eq!(rows[&3].ended_s, None);
        assert_eq!(rows[&3].text, "track 3");
    }
}
