//! The panel of a playback: what the recordings say at their time.

use super::controls::choose_sight;
use super::panel::{FLY_KEYS, conditions, held_by, laser, tiles, tracking_state};
use super::style::{AMBER, heading, left_panel, row, source_colour, status_colour};
use crate::components::beam::BeamState;
use crate::components::capture::SensorCamera;
use crate::components::environment::Environment;
use crate::components::flight::{Uav, UavStatus};
use crate::components::view::{Playback, Sight};
use crate::recording::proto;
use crate::recording::timeline::{StationTrack, Timeline};
use bevy::prelude::*;
use bevy_egui::EguiContexts;
use bevy_egui::egui::{self, Color32};
use boresight_tiles::{Tiles, TilesCount};

/// Lines of the log, and UAVs, that are shown.
const LOG_SHOWN: usize = 6;
const UAVS_SHOWN: usize = 12;

/// Stations, UAVs, log and weather of each recording.
pub fn draw_recorded(
    mut contexts: EguiContexts,
    environment: Res<Environment>,
    playback: Res<Playback>,
    mut sight: ResMut<Sight>,
    uavs: Query<&Uav>,
    cameras: Query<&SensorCamera>,
    tilesets: Query<(&Tiles, &TilesCount)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    left_panel(ctx, |ui| {
        let time = egui::RichText::new(format!("{:.3} s", playback.t_s));
        ui.label(time.size(26.0).monospace().color(Color32::WHITE));
        choose_sight(ui, &mut sight, uavs.iter(), cameras.iter());
        for (source, timeline) in playback.timelines.iter().enumerate() {
            ui.add_space(8.0);
            let file = timeline.path.display().to_string();
            ui.colored_label(source_colour(source), file);
            if timeline.version != crate::VERSION {
                let version = &timeline.version;
                ui.colored_label(AMBER, format!("recorded by version {version}"));
            }
            if !timeline.whole {
                ui.colored_label(AMBER, "cut short: the run was stopped");
            }
            recording(ui, timeline, timeline.tick_at(playback.t_s));
        }
        tiles(ui, &tilesets);
        conditions(ui, &environment.weather);
        ui.add_space(8.0);
        ui.small(FLY_KEYS);
        ui.small("Space: play. R: backwards. [ and ]: speed. Comma, full stop: one tick.");
        ui.small("Arrows: one picture. Page up, page down: one event. Home, End.");
        ui.small("Drag on the time line to seek; its wheel zooms, a double click shows all.");
    });
    Ok(())
}

fn recording(ui: &mut egui::Ui, timeline: &Timeline, tick: u64) {
    for station in &timeline.stations {
        heading(ui, &station.name);
        if let Some(track) = station.track.at(tick) {
            tracking(ui, timeline, station, track, tick);
        }
        if let Some(beam) = station.beam.at(tick) {
            heading(ui, "Laser");
            laser(ui, &beam_state(beam));
            held_by(ui, beam.interlocks.iter().cloned());
        }
    }
    heading(ui, "UAVs");
    for (name, series) in timeline.uavs.iter().take(UAVS_SHOWN) {
        if let Some(uav) = series.at(tick) {
            let colour = UavStatus::named(&uav.status).map_or(Color32::GRAY, status_colour);
            ui.colored_label(colour, format!("{name}: {}", uav.status));
            if uav.skin_k.is_finite() {
                row(ui, "skin", format!("{:.0} °C", uav.skin_k - 273.15));
            }
        }
    }
    if timeline.uavs.len() > UAVS_SHOWN {
        let now = timeline
            .uavs
            .iter()
            .filter_map(|(_, series)| series.at(tick));
        let flying = now.filter(|uav| &*uav.status == "flying").count();
        ui.small(format!("{flying} of {} are flying", timeline.uavs.len()));
    }
    heading(ui, "Log");
    let before = timeline.events.partition_point(|event| event.tick <= tick);
    for event in timeline.events[..before].iter().rev().take(LOG_SHOWN) {
        let at_s = timeline.t_s(event.tick);
        ui.small(format!("{at_s:.2} s {}: {}", event.part, event.text));
    }
}

fn tracking(
    ui: &mut egui::Ui,
    timeline: &Timeline,
    station: &StationTrack,
    track: &proto::TrackState,
    tick: u64,
) {
    tracking_state(ui, &track.state);
    let changed = station.track.entries();
    let now = changed.partition_point(|(of, _)| *of <= tick);
    let since = (changed[..now].iter().rev())
        .take_while(|(_, earlier)| earlier.state == track.state)
        .last();
    if let Some((since, _)) = since {
        let for_s = timeline.t_s(tick) - timeline.t_s(*since);
        row(ui, "for", format!("{for_s:.2} s"));
    }
    if !track.target.is_empty() {
        row(ui, "target", track.target.clone());
        row(ui, "taken for", track.class.clone());
        row(ui, "quality", format!("{:.2}", track.quality));
    }
    if track.range_m.is_finite() {
        row(ui, "range", format!("{:.0} m", track.range_m));
    }
}

/// What the panel shows of a beam.
fn beam_state(beam: &proto::BeamState) -> BeamState {
    BeamState {
        firing: beam.firing,
        power_at_target_w: beam.power_at_target_w,
        power_in_bucket_w: beam.power_in_bucket_w,
        irradiance_wpm2: beam.irradiance_wpm2,
        spot_radius_m: beam.spot_radius_m,
        offset_m: beam.offset_m,
        transmittance: beam.transmittance,
        scintillation: beam.scintillation,
        ..BeamState::default()
    }
}
