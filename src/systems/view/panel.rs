//! The window's panel: pace, tracking, target choice, engagement, weather.

use super::style::{
    AMBER, GREEN, GREY, RED, heading, panel_frame, row, screen_ui, state_colour, status_colour,
};
use crate::components::beam::BeamState;
use crate::components::capture::SensorCamera;
use crate::components::detect::DetectorInUse;
use crate::components::engage::Interlocks;
use crate::components::environment::Environment;
use crate::components::flight::{Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Mount, Station};
use crate::components::network::Tasking;
use crate::components::run::SimClock;
use crate::components::track::{Designation, Operator, Order, Tracker};
use crate::components::view::{Pacing, Sight, StepSize};
use crate::models::air::weather::Weather;
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::tracking::picture::Follower;
use crate::models::tracking::table::separation_rad;
use bevy::prelude::*;
use bevy_egui::EguiContexts;
use bevy_egui::egui::{self, Color32};
use glam::DVec2;

pub const PANEL_WIDTH: f32 = 250.0;

/// The panel: pace, tracking, target choice, engagement, weather.
pub fn draw_panel(
    mut contexts: EguiContexts,
    clock: Res<SimClock>,
    environment: Res<Environment>,
    detector: Res<DetectorInUse>,
    mut pacing: ResMut<Pacing>,
    mut sight: ResMut<Sight>,
    cameras: Query<&SensorCamera>,
    mut stations: Query<(
        &Station,
        &Mount,
        &BeamState,
        &Tracker,
        &Interlocks,
        &Tasking,
        &mut Operator,
    )>,
    uavs: Query<(&Uav, &Flight, &UavStatus, &HeatedSkin)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let names: Vec<String> = stations
        .iter()
        .map(|(station, ..)| station.name.clone())
        .collect();
    let many = names.len() > 1;
    let panel = egui::Panel::left("panel")
        .exact_size(PANEL_WIDTH)
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame());
    panel.show(&mut screen_ui(ctx), |ui| {
        egui::ScrollArea::vertical().show(ui, |ui| {
            ui.spacing_mut().item_spacing.y = 3.0;
            ui.visuals_mut().override_text_color = Some(Color32::from_gray(200));
            pace(ui, &clock, &mut pacing);
            let flying = uavs.iter().map(|(uav, ..)| uav);
            choose_sight(ui, &mut sight, flying, cameras.iter());
            for (station, mount, _, tracker, _, tasking, mut operator) in &mut stations {
                if many {
                    heading(ui, &station.name);
                }
                tracking(ui, &clock, tracker);
                waiting(ui, tracker, tasking, &names);
                let known: Vec<_> = uavs
                    .iter()
                    .map(|(uav, flight, ..)| {
                        (
                            uav.name.as_str(),
                            los_to_az_el(flight.state.r_enu_m - mount.r_enu_m),
                        )
                    })
                    .collect();
                if let Some(target) = targets(ui, &clock, tracker, &detector, &known) {
                    operator.give(Order {
                        tick: clock.tick + 1,
                        target,
                    });
                }
            }
            heading(ui, "UAVs");
            for (uav, _, status, skin) in &uavs {
                ui.colored_label(
                    status_colour(*status),
                    format!("{}: {}", uav.name, status.name()),
                );
                row(
                    ui,
                    "skin",
                    format!("{:.0} °C", skin.skin.temperature_k - 273.15),
                );
            }
            for (station, _, beam, _, interlocks, ..) in &stations {
                let name = if many { station.name.as_str() } else { "" };
                let reasons = interlocks.reasons.iter().map(ToString::to_string);
                engagement(ui, name, beam, reasons);
                row(ui, "dwell", format!("{:.2} s", beam.dwell_s));
                row(
                    ui,
                    "energy emitted",
                    format!("{:.1} kJ", 1e-3 * beam.energy_j),
                );
            }
            conditions(ui, &environment.weather);
            ui.add_space(8.0);
            ui.small(FLY_KEYS);
            ui.small("Space: pause. Full stop: one tick. Slash: one frame.");
        });
    });
    Ok(())
}

/// How the window's camera is moved.
pub const FLY_KEYS: &str = "Fly: W A S D Q E, shift for haste. Look: right mouse button.";

/// Lets the user choose from where the window looks.
pub fn choose_sight<'a>(
    ui: &mut egui::Ui,
    sight: &mut Sight,
    flying: impl Iterator<Item = &'a Uav> + Clone,
    cameras: impl Iterator<Item = &'a SensorCamera> + Clone,
) {
    const DISTANCE_M: f64 = 25.0;
    let chase = |uav: &Uav| format!("look at {}", uav.name);
    let look = |camera: &SensorCamera| format!("look with camera {}", camera.name);
    let shown = match *sight {
        Sight::Free => None,
        Sight::Chase { uav, .. } => flying.clone().find(|own| own.index == uav).map(chase),
        Sight::Camera(index) => cameras.clone().find(|own| own.index == index).map(look),
    };
    let free = "look from anywhere".to_owned();
    egui::ComboBox::from_id_salt("sight")
        .selected_text(shown.unwrap_or_else(|| free.clone()))
        .show_ui(ui, |ui| {
            ui.selectable_value(sight, Sight::Free, free);
            for uav in flying {
                let chosen = matches!(*sight, Sight::Chase { uav: own, .. } if own == uav.index);
                if ui.selectable_label(chosen, chase(uav)).clicked() {
                    *sight = Sight::Chase {
                        uav: uav.index,
                        distance_m: DISTANCE_M,
                    };
                }
            }
            for camera in cameras {
                ui.selectable_value(sight, Sight::Camera(camera.index), look(camera));
            }
        });
}

/// What a laser does, and what keeps it from firing.
pub fn engagement(
    ui: &mut egui::Ui,
    station: &str,
    beam: &BeamState,
    interlocks: impl Iterator<Item = String>,
) {
    let title = if station.is_empty() {
        "Engagement".into()
    } else {
        format!("Engagement, {station}")
    };
    heading(ui, &title);
    let (word, colour) = if beam.firing {
        ("FIRING", RED)
    } else {
        ("safe", GREEN)
    };
    ui.colored_label(colour, format!("laser: {word}"));
    for interlock in interlocks {
        ui.colored_label(GREY, format!("interlock: {interlock}"));
    }
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

fn pace(ui: &mut egui::Ui, clock: &SimClock, pacing: &mut Pacing) {
    ui.label(
        egui::RichText::new(format!("{:.3} s", clock.t_s()))
            .size(26.0)
            .monospace()
            .color(Color32::WHITE),
    );
    ui.horizontal(|ui| {
        let word = if pacing.paused { "Play" } else { "Pause" };
        if ui
            .add_enabled(!pacing.over, egui::Button::new(word))
            .clicked()
        {
            pacing.paused = !pacing.paused;
        }
        for (word, step) in [("+1 tick", StepSize::Tick), ("+1 frame", StepSize::Frame)] {
            if ui
                .add_enabled(!pacing.over, egui::Button::new(word))
                .clicked()
            {
                pacing.paused = true;
                pacing.step = Some(step);
            }
        }
        if pacing.over {
            ui.colored_label(AMBER, "over");
        }
    });
    let mut unbound = pacing.speed.is_infinite();
    if ui.checkbox(&mut unbound, "as fast as possible").changed() {
        pacing.speed = if unbound { f64::INFINITY } else { 1.0 };
    }
    if !unbound {
        let range = 0.1..=10.0;
        ui.add(
            egui::Slider::new(&mut pacing.speed, range)
                .logarithmic(true)
                .suffix("×"),
        );
    }
    row(ui, "reached", format!("{:.2}× real time", pacing.reached));
}

/// A tracking state, large.
pub fn tracking_state(ui: &mut egui::Ui, state: &str) {
    let text = egui::RichText::new(state.to_uppercase()).size(18.0);
    ui.label(text.color(state_colour(state)));
}

fn tracking(ui: &mut egui::Ui, clock: &SimClock, tracker: &Tracker) {
    const SHOWN: usize = 4;
    heading(ui, "Tracking");
    tracking_state(ui, tracker.state.name());
    let since_s = clock.at_s(clock.tick - tracker.since_tick);
    row(ui, "for", format!("{since_s:.2} s"));
    row(
        ui,
        "range finder",
        tracker
            .range_m
            .map_or("none".into(), |range_m| format!("{range_m:.0} m")),
    );
    for change in tracker.changes.iter().rev().take(SHOWN) {
        let at_s = clock.at_s(change.tick);
        ui.small(format!(
            "{at_s:.2} s {}: {}",
            change.to.name(),
            change.reason
        ));
    }
}

/// The station's task, and what comes next: by the defence, or by its own tracks.
fn waiting(ui: &mut egui::Ui, tracker: &Tracker, tasking: &Tasking, stations: &[String]) {
    const SHOWN: usize = 5;
    let name = |identity: &Follower| {
        let station = stations.get(identity.station);
        identity.named(station.map_or("", String::as_str))
    };
    let queue: Vec<String> = match &tasking.task {
        Some(task) => {
            let word = if task.engages { "engages" } else { "watches" };
            row(ui, word, name(&task.identity));
            tasking.queue.iter().take(SHOWN).map(name).collect()
        }
        None => (tracker.queue.iter().take(SHOWN))
            .map(ToString::to_string)
            .collect(),
    };
    if !queue.is_empty() {
        // Several names are wider than a row.
        ui.small(format!("next: {}", queue.join(", ")));
    }
}

/// Lists the tracks; returns what the operator has clicked.
fn targets(
    ui: &mut egui::Ui,
    clock: &SimClock,
    tracker: &Tracker,
    detector: &DetectorInUse,
    known: &[(&str, DVec2)],
) -> Option<Designation> {
    /// A track this near to a UAV is listed under its name [rad].
    const SAME_RAD: f64 = 5e-3;
    heading(ui, "Target");
    if tracker.table.tracks.is_empty() {
        ui.colored_label(GREY, "no tracks");
    }
    let mut chosen = None;
    for track in &tracker.table.tracks {
        let az_el_rad = track.filter.predicted(clock.t_s()).az_el_rad();
        let name = known
            .iter()
            .map(|(name, at_rad)| (separation_rad(*at_rad, az_el_rad), *name))
            .filter(|(apart_rad, _)| *apart_rad < SAME_RAD)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or("unknown", |(_, name)| name);
        let [az_deg, el_deg] = az_el_rad.to_array().map(f64::to_degrees);
        let az_deg = az_deg.rem_euclid(360.0);
        let class = detector.class(track.label());
        let target = tracker.target == Some(track.id);
        let pinned = if target && tracker.designated {
            ", pinned"
        } else {
            ""
        };
        let text = format!(
            "#{} {name}, {class} {az_deg:.0}° {el_deg:.1}°{pinned}",
            track.id
        );
        if ui.radio(target, text).clicked() {
            chosen = Some(Designation::Track(track.id));
        }
    }
    let hand_back = egui::Button::new("Let the tracker choose");
    if ui.add_enabled(tracker.designated, hand_back).clicked() {
        chosen = Some(Designation::Release);
    }
    ui.small("A click pins a track. Orders are recorded; --save-orders keeps them as a scenario.");
    chosen
}
