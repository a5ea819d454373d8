//! The window's panel: pace, tracking, orders, engagement, weather.

use super::style::{
    AMBER, GREEN, GREY, RED, heading, left_panel, row, state_colour, status_colour,
};
use crate::components::beam::BeamState;
use crate::components::capture::SensorCamera;
use crate::components::control::{Controller, PointingLaws};
use crate::components::detect::DetectorInUse;
use crate::components::engage::{Interlocks, Rules};
use crate::components::environment::Environment;
use crate::components::flight::{Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Mount, Station};
use crate::components::network::Tasking;
use crate::components::run::SimClock;
use crate::components::tiles::{Tiles, TilesCount, TilesMode};
use crate::components::track::{Command, Designation, Operator, Order, Tracker};
use crate::components::view::{FreeCamera, Pacing, Sight, StepSize};
use crate::models::air::weather::Weather;
use crate::models::control::paper::PaperLaw;
use crate::models::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::models::tracking::picture::Follower;
use crate::models::tracking::table::separation_rad;
use crate::scenario::{Gains, GainsOrder, WeatherOrder};
use bevy::prelude::*;
use bevy_egui::EguiContexts;
use bevy_egui::egui::{self, Color32};
use glam::DVec2;
use std::ops::RangeInclusive;

/// A station with its operator.
type Manned = (
    &'static Station,
    &'static Mount,
    &'static BeamState,
    &'static Tracker,
    &'static Interlocks,
    &'static Tasking,
    (&'static Rules, &'static mut Controller),
    &'static mut Operator,
);

/// The panel: pace, tracking, orders, engagement, weather.
pub fn draw_panel(
    mut contexts: EguiContexts,
    clock: Res<SimClock>,
    environment: Res<Environment>,
    detector: Res<DetectorInUse>,
    mut pacing: ResMut<Pacing>,
    mut sight: ResMut<Sight>,
    (laws, camera): (Res<PointingLaws>, Res<FreeCamera>),
    cameras: Query<&SensorCamera>,
    mut stations: Query<Manned>,
    uavs: Query<(&Uav, &Flight, &UavStatus, &HeatedSkin)>,
    tilesets: Query<(&Tiles, &TilesCount)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let names: Vec<String> = stations
        .iter()
        .map(|(station, ..)| station.name.clone())
        .collect();
    let many = names.len() > 1;
    left_panel(ctx, |ui| {
        pace(ui, &clock, &mut pacing);
        let flying = uavs.iter().map(|(uav, ..)| uav);
        choose_sight(ui, &mut sight, flying, cameras.iter());
        let tick = clock.tick + 1;
        for (station, mount, _, tracker, _, tasking, ordered, mut operator) in &mut stations {
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
            let target = targets(ui, &clock, (tracker, &operator), &detector, &known);
            let (rules, mut controller) = ordered;
            ui.push_id(station.index, |ui| {
                let fire = fire(ui, rules);
                let slew = slew(ui, mount, &camera);
                // What is only read must not count as changed.
                let law = law(ui, &laws, controller.bypass_change_detection());
                let given = [target.map(Command::Target), fire, slew, law];
                for command in given.into_iter().flatten() {
                    operator.give(Order { tick, command });
                }
            });
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
        tiles(ui, &tilesets);
        conditions(ui, &environment.weather);
        let weather = change_weather(ui, &environment.weather);
        if let (Some(command), Some((.., mut operator))) = (weather, stations.iter_mut().next()) {
            operator.give(Order { tick, command });
        }
        ui.small(
            "Orders count from the next tick and are recorded; --save-orders keeps them as a \
                 scenario.",
        );
        ui.add_space(8.0);
        ui.small(FLY_KEYS);
        ui.small("Space: pause. Full stop: one tick. Slash: one frame.");
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
    row(ui, "window", format!("{:.1} frames/s", pacing.frames_hz));
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
    (tracker, operator): (&Tracker, &Operator),
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
    let in_hand = tracker.designated || operator.slew_rad.is_some() || operator.waiting.is_some();
    if ui.add_enabled(in_hand, hand_back).clicked() {
        chosen = Some(Designation::Release);
    }
    ui.small("A click pins a track.");
    chosen
}

/// Whether the laser may fire, as the operator says.
fn fire(ui: &mut egui::Ui, rules: &Rules) -> Option<Command> {
    let mut may = rules.authorised;
    let clicked = ui.checkbox(&mut may, "fire authority").changed();
    clicked.then_some(Command::Fire(may))
}

/// Turns the station by hand: to a direction, or to what the window looks at.
fn slew(ui: &mut egui::Ui, mount: &Mount, camera: &FreeCamera) -> Option<Command> {
    /// How far away that is taken to be [m].
    const SEEN_M: f64 = 1_000.0;
    // Angles that read well.
    let rounded_deg = |az_el_rad: DVec2| {
        let [azimuth, elevation] = az_el_rad.to_array().map(f64::to_degrees);
        [azimuth.rem_euclid(360.0), elevation].map(|deg| (10.0 * deg).round() / 10.0)
    };
    let id = ui.id().with("slew");
    let kept = ui.data(|data| data.get_temp(id));
    let mut az_el_deg: [f64; 2] = kept.unwrap_or(rounded_deg(mount.measured_az_el_rad()));
    let mut ordered = false;
    ui.horizontal(|ui| {
        for (deg, range) in az_el_deg.iter_mut().zip([0.0..=360.0, -90.0..=90.0]) {
            ui.add(
                egui::DragValue::new(deg)
                    .range(range)
                    .speed(0.2)
                    .suffix("°"),
            );
        }
        ordered = ui.button("Slew").clicked();
        if ui.button("to my view").clicked() {
            let ahead = az_el_to_los(DVec2::new(camera.azimuth_rad, camera.elevation_rad));
            let seen_enu_m = camera.r_enu_m + SEEN_M * ahead;
            az_el_deg = rounded_deg(los_to_az_el(seen_enu_m - mount.r_enu_m));
            ordered = true;
        }
    });
    ui.data_mut(|data| data.insert_temp(id, az_el_deg));
    ordered.then_some(Command::Slew(az_el_deg))
}

/// The pointing law and its gains.
fn law(ui: &mut egui::Ui, laws: &PointingLaws, controller: &mut Controller) -> Option<Command> {
    /// What a proportional, integral or derivative gain and the gimbal's may be [1], [1/s], [s], [1/s].
    const GAIN: RangeInclusive<f64> = 0.0..=1000.0;
    let gains = |gains| Some(Command::Gains(gains));
    match controller {
        Controller::Pointing(pointing) => {
            let mut name = pointing.name.clone();
            egui::ComboBox::from_label("law")
                .selected_text(&name)
                .show_ui(ui, |ui| {
                    for known in laws.names() {
                        ui.selectable_value(&mut name, known.to_owned(), known);
                    }
                });
            if name != pointing.name {
                return Some(Command::Law(name));
            }
            let gain_per_s = *pointing.law.gimbal_gain_per_s()?;
            let gimbal_per_s = figure(ui, "gimbal gain", gain_per_s, (GAIN, 0.1, " /s"))?;
            gains(GainsOrder {
                gimbal_per_s: Some(gimbal_per_s),
                ..default()
            })
        }
        Controller::Paper(paper) => {
            let mut of = |name: &str, law: &PaperLaw| {
                let mut one = |key: &str, value: f64, unit: &str| {
                    figure(ui, &format!("{name} {key}"), value, (GAIN, 1e-4, unit))
                };
                let kp = one("kp", law.kp, "");
                let ki_per_s = one("ki", law.ki_per_s, " /s");
                let kd_s = one("kd", law.kd_s, " s");
                (kp.or(ki_per_s).or(kd_s)).map(|_| Gains {
                    kp: kp.unwrap_or(law.kp),
                    ki_per_s: ki_per_s.unwrap_or(law.ki_per_s),
                    kd_s: kd_s.unwrap_or(law.kd_s),
                })
            };
            let coarse = of("coarse", &paper.coarse_law);
            let precise = of("precise", &paper.precise_law);
            coarse.or(precise)?;
            gains(GainsOrder {
                coarse,
                precise,
                gimbal_per_s: None,
            })
        }
    }
}

/// Wind and visibility as the operator wants them.
fn change_weather(ui: &mut egui::Ui, weather: &Weather) -> Option<Command> {
    let wind_deg = (10.0 * weather.wind_from_rad.to_degrees()).round() / 10.0;
    let order = WeatherOrder {
        wind_speed_mps: figure(
            ui,
            "wind",
            weather.wind_speed_mps,
            (0.0..=60.0, 0.1, " m/s"),
        ),
        wind_from_deg: figure(ui, "wind from", wind_deg, (0.0..=360.0, 1.0, "°")),
        visibility_m: figure(
            ui,
            "visibility",
            weather.visibility_m,
            (10.0..=400_000.0, 100.0, " m"),
        ),
    };
    (order != WeatherOrder::default()).then_some(Command::Weather(order))
}

/// A figure to be changed, within a range, by so much a point of the mouse, with its unit; the new one once the
/// user lets go of it.
fn figure(
    ui: &mut egui::Ui,
    name: &str,
    value: f64,
    (range, speed, unit): (RangeInclusive<f64>, f64, &str),
) -> Option<f64> {
    let id = ui.id().with(name);
    let kept = ui.data(|data| data.get_temp(id));
    let mut draft: f64 = kept.unwrap_or(value);
    let mut ended = false;
    ui.horizontal(|ui| {
        let drag = egui::DragValue::new(&mut draft).range(range).speed(speed);
        let drag = ui.add(drag.suffix(unit));
        ended = drag.drag_stopped() || drag.lost_focus();
        if drag.changed() {
            ui.data_mut(|data| data.insert_temp(id, draft));
        }
        ui.small(name);
    });
    if !ended {
        return None;
    }
    ui.data_mut(|data| data.remove::<f64>(id));
    (draft != value).then_some(draft)
}
