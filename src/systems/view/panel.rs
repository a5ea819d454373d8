//! The window's panel: what a station sees, was ordered and does.

use super::style::{
    AMBER, GREEN, GREY, RED, fixed_panel, heading, list, row, state_colour, status_colour,
};
use super::{orders, tracks};
use crate::components::beam::BeamState;
use crate::components::engage::Interlocks;
use crate::components::environment::Environment;
use crate::components::flight::{HeatedSkin, Uav, UavStatus};
use crate::components::mount::Station;
use crate::components::network::Tasking;
use crate::components::operator::{Command, Operator, Order};
use crate::components::run::{RunScenario, SimClock};
use crate::components::track::Tracker;
use crate::components::view::{ChosenStation, TrackRows};
use crate::models::air::weather::Weather;
use crate::models::tracking::picture::Follower;
use bevy::prelude::*;
use bevy_egui::EguiContexts;
use bevy_egui::egui;
use boresight_tiles::{Tiles, TilesCount, TilesMode};

/// A station as its panel shows it.
type Shown = (
    &'static Station,
    &'static BeamState,
    &'static Tracker,
    &'static Interlocks,
    &'static Tasking,
    &'static mut Operator,
);

/// Heights of the lists, which scroll [points].
const TRACKS_HEIGHT: f32 = 132.0;
const ORDERS_HEIGHT: f32 = 78.0;
const INTERLOCKS_HEIGHT: f32 = 50.0;

/// The panel of the chosen station: its state, tracks, orders and laser at fixed places, and below them, scrolling, what else
/// there is.
pub fn draw_panel(
    mut contexts: EguiContexts,
    clock: Res<SimClock>,
    environment: Res<Environment>,
    chosen: Res<ChosenStation>,
    mut rows: ResMut<TrackRows>,
    mut stations: Query<Shown>,
    uavs: Query<(&Uav, &UavStatus, &HeatedSkin)>,
    named: Query<&Uav>,
    tilesets: Query<(&Tiles, &TilesCount)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let names: Vec<String> = stations
        .iter()
        .map(|(station, ..)| station.name.clone())
        .collect();
    fixed_panel(ctx, |ui| {
        let shown = stations.iter_mut().find(|(own, ..)| own.index == chosen.0);
        if let Some((station, beam, tracker, interlocks, tasking, mut operator)) = shown {
            tracking(ui, &clock, tracker);
            task(ui, tracker, tasking, &names);
            heading(ui, "Tracks");
            let own = rows.lists.get(&station.index);
            let (target, pointed_at) = list(ui, "tracks", TRACKS_HEIGHT, |ui| {
                tracks::list(ui, own, tracker)
            });
            rows.pointed_at = pointed_at;
            heading(ui, "Orders");
            let name_of = |index| {
                let uav = named.iter().find(|uav| uav.index == index);
                uav.map(|uav| uav.name.clone())
            };
            list(ui, "orders", ORDERS_HEIGHT, |ui| {
                orders::list(ui, &operator, |tick| clock.at_s(tick), name_of);
            });
            if let Some(target) = target {
                let command = Command::Target(target);
                let tick = clock.tick + 1;
                operator.give(Order { tick, command });
            }
            heading(ui, "Laser");
            laser(ui, beam);
            row(ui, "dwell", format!("{:.2} s", beam.dwell_s));
            let energy = format!("{:.1} kJ", 1e-3 * beam.energy_j);
            row(ui, "energy emitted", energy);
            list(ui, "interlocks", INTERLOCKS_HEIGHT, |ui| {
                let reasons = interlocks.reasons.iter().map(ToString::to_string);
                held_by(ui, reasons);
            });
        }
        ui.separator();
        let rest = ui.available_height();
        list(ui, "rest", rest, |ui| {
            flying(ui, &uavs);
            for (station, _, tracker, ..) in &stations {
                heading(ui, &format!("States, {}", station.name));
                changes(ui, &clock, tracker);
            }
            tiles(ui, &tilesets);
            conditions(ui, &environment.weather);
            ui.add_space(8.0);
            ui.small(ORDERS_KEPT);
            ui.small(FLY_KEYS);
            ui.small("Space: pause. Full stop: one tick. Slash: one frame.");
        });
    });
    Ok(())
}

const ORDERS_KEPT: &str =
    "Orders count from the next tick and are recorded; --save-orders keeps them as a scenario.";

fn flying(ui: &mut egui::Ui, uavs: &Query<(&Uav, &UavStatus, &HeatedSkin)>) {
    ui.label(egui::RichText::new("UAVs").strong().color(AMBER));
    for (uav, status, skin) in uavs {
        let text = format!("{}: {}", uav.name, status.name());
        ui.colored_label(status_colour(*status), text);
        let skin_c = skin.temperature_k - 273.15;
        row(ui, "skin", format!("{skin_c:.0} °C"));
    }
}

/// Says that the scene is being built.
pub fn draw_waiting(mut contexts: EguiContexts, scenario: Res<RunScenario>) -> Result {
    let ctx = contexts.ctx_mut()?;
    let painter = ctx.layer_painter(egui::LayerId::background());
    let at = ctx.viewport_rect().center();
    let name = &scenario.scenario.name;
    let text = format!("building {name}: city, sky, cameras and detectors …");
    let font = egui::FontId::proportional(20.0);
    painter.text(at, egui::Align2::CENTER_CENTER, text, font, GREY);
    Ok(())
}

/// How the window's camera is moved.
pub const FLY_KEYS: &str = "Fly: W A S D Q E, shift for haste. Look: right mouse button.";

/// What keeps a laser from firing.
pub fn held_by(ui: &mut egui::Ui, interlocks: impl Iterator<Item = String>) {
    for interlock in interlocks {
        ui.colored_label(GREY, format!("interlock: {interlock}"));
    }
}

/// What a laser does.
pub fn laser(ui: &mut egui::Ui, beam: &BeamState) {
    let (word, colour) = if beam.firing {
        ("FIRING", RED)
    } else {
        ("safe", GREEN)
    };
    ui.colored_label(colour, format!("laser: {word}"));
    let shown = |value: f64| if beam.firing { value } else { 0.0 };
    let millimetres = |m: f64| format!("{:.0} mm", 1e3 * shown(m));
    for (name, value) in [
        (
            "power at target",
            format!("{:.0} W", shown(beam.power_at_target_w)),
        ),
        (
            "power in bucket",
            format!("{:.0} W", shown(beam.power_in_bucket_w)),
        ),
        (
            "irradiance",
            format!("{:.1} W/cm²", 1e-4 * shown(beam.irradiance_wpm2)),
        ),
        ("spot radius", millimetres(beam.spot_radius_m)),
        ("spot off aim point", millimetres(beam.offset_m)),
    ] {
        row(ui, name, value);
    }
}

/// What is there of the tiles that are streamed for the window.
pub fn tiles(ui: &mut egui::Ui, tilesets: &Query<(&Tiles, &TilesCount)>) {
    let streamed = (tilesets.iter()).filter(|(tiles, _)| tiles.mode == TilesMode::Streamed);
    for (tiles, count) in streamed {
        heading(ui, "Tiles");
        row(ui, "drawn", count.drawn.to_string());
        row(ui, "triangles", count.triangles.to_string());
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        let kept = (mib(count.bytes), mib(tiles.byte_budget));
        row(
            ui,
            "kept",
            format!("{} ({:.0} of {:.0} MiB)", count.kept, kept.0, kept.1),
        );
        row(ui, "loading", count.missing.to_string());
        if count.failed > 0 {
            ui.colored_label(AMBER, format!("{} cannot be read", count.failed));
        }
    }
}

pub fn conditions(ui: &mut egui::Ui, weather: &Weather) {
    heading(ui, "Weather");
    let wind_deg = weather.wind_from_rad.to_degrees();
    for (name, value) in [
        (
            "wind",
            format!("{:.1} m/s from {wind_deg:03.0}°", weather.wind_speed_mps),
        ),
        (
            "visibility",
            format!("{:.1} km", 1e-3 * weather.visibility_m),
        ),
        (
            "temperature",
            format!("{:.0} °C", weather.temperature_k - 273.15),
        ),
        (
            "cloud cover",
            format!("{:.0} %", 100.0 * weather.cloud_cover),
        ),
        ("rain", format!("{:.1} mm/h", weather.precipitation_mmph)),
    ] {
        row(ui, name, value);
    }
}

/// A tracking state, large.
pub fn tracking_state(ui: &mut egui::Ui, state: &str) {
    let text = egui::RichText::new(state.to_uppercase()).size(18.0);
    ui.label(text.color(state_colour(state)));
}

fn tracking(ui: &mut egui::Ui, clock: &SimClock, tracker: &Tracker) {
    tracking_state(ui, tracker.state.name());
    let since_s = clock.at_s(clock.tick - tracker.since_tick);
    row(ui, "for", format!("{since_s:.2} s"));
    let belief = tracker.target_belief();
    let sure = belief.map_or("no target".into(), |belief| {
        format!("{:.0} %", 100.0 * belief.probability())
    });
    row(ui, "a UAV", sure);
    row(
        ui,
        "range finder",
        tracker
            .range_m
            .map_or("none".into(), |range_m| format!("{range_m:.0} m")),
    );
}

/// The last changes of a station's state, the latest first.
fn changes(ui: &mut egui::Ui, clock: &SimClock, tracker: &Tracker) {
    const SHOWN: usize = 8;
    for change in tracker.changes.iter().rev().take(SHOWN) {
        let at_s = clock.at_s(change.tick);
        ui.small(format!(
            "{at_s:.2} s {}: {}",
            change.to.name(),
            change.reason
        ));
    }
}

/// The station's task and what comes next, by the defence or by its own tracks, in a row each.
fn task(ui: &mut egui::Ui, tracker: &Tracker, tasking: &Tasking, stations: &[String]) {
    const SHOWN: usize = 5;
    let name = |identity: &Follower| {
        let station = stations.get(identity.station);
        identity.named(station.map_or("", String::as_str))
    };
    let (word, what, queue): (_, _, Vec<String>) = match &tasking.task {
        Some(task) => (
            if task.engages { "engages" } else { "watches" },
            name(&task.identity),
            tasking.queue.iter().take(SHOWN).map(name).collect(),
        ),
        None => (
            "target",
            (tracker.target).map_or("none".into(), |id| format!("#{id}")),
            (tracker.queue.iter().take(SHOWN))
                .map(|id| format!("#{id}"))
                .collect(),
        ),
    };
    row(ui, word, what);
    let next = if queue.is_empty() {
        "none".into()
    } else {
        queue.join(", ")
    };
    row(ui, "next", next);
}
