//! The bar at the top of a window that simulates: pace and sight above, the operator's orders below.
//!
//! Every control has a place of its own that nothing moves: neither a list, nor a number that grows, nor another station.

use super::style::{AMBER, GREY, keep_above, keep_below, panel_frame, screen_ui};
use crate::components::capture::SensorCamera;
use crate::components::control::{Controller, PointingLaws};
use crate::components::engage::Rules;
use crate::components::environment::Environment;
use crate::components::flight::{HeatedSkin, Uav};
use crate::components::mount::{Mount, Station};
use crate::components::operator::{Command, Designation, Operator, Order};
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::components::view::{ChosenStation, FreeCamera, Pacing, Sight, StepSize};
use crate::models::air::weather::Weather;
use crate::models::control::paper::PaperLaw;
use crate::models::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::scenario::{Gains, GainsOrder, WeatherOrder};
use bevy::prelude::*;
use bevy_egui::EguiContexts;
use bevy_egui::egui::containers::menu::{MenuButton, MenuConfig};
use bevy_egui::egui::{
    self, Align, Button, Color32, Layout, PopupCloseBehavior, Pos2, Rect, RichText, UiBuilder,
    pos2, vec2,
};
use glam::DVec2;
use std::ops::RangeInclusive;

/// Height of a row of the bar, and the gap between rows and between controls [points].
const ROW: f32 = 24.0;
const GAP: f32 = 8.0;
const MARGIN: f32 = 8.0;

/// A row of the bar: slots of set widths from left to right.
struct Row<'a> {
    ui: &'a mut egui::Ui,
    left: f32,
    top: f32,
}

impl<'a> Row<'a> {
    /// Row `number` of a bar from this corner on.
    fn new(ui: &'a mut egui::Ui, corner: Pos2, number: u8) -> Self {
        Self {
            left: corner.x,
            top: corner.y + f32::from(number) * (ROW + GAP),
            ui,
        }
    }

    /// Puts controls into the next slot, of this width [points].
    fn slot<R>(&mut self, width: f32, add: impl FnOnce(&mut egui::Ui) -> R) -> R {
        let corner = pos2(self.left, self.top);
        self.left += width + GAP;
        let builder = UiBuilder::new()
            .max_rect(Rect::from_min_size(corner, vec2(width, ROW)))
            .layout(Layout::left_to_right(Align::Center));
        self.ui.scope_builder(builder, add).inner
    }

    /// A button that fills the next slot; whether it was clicked.
    fn button(&mut self, width: f32, word: &str, enabled: bool) -> bool {
        let add = |ui: &mut egui::Ui| {
            let button = Button::new(word).min_size(vec2(width, ROW));
            ui.add_enabled(enabled, button).clicked()
        };
        self.slot(width, add)
    }
}

/// A station as its operator has it in hand.
type InHand = (
    &'static Station,
    &'static Mount,
    &'static Tracker,
    &'static Rules,
    &'static mut Controller,
    &'static mut Operator,
);

/// The bar.
pub fn draw_controls(
    mut contexts: EguiContexts,
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut pacing: ResMut<Pacing>,
    mut sight: ResMut<Sight>,
    mut chosen: ResMut<ChosenStation>,
    (laws, camera): (Res<PointingLaws>, Res<FreeCamera>),
    cameras: Query<&SensorCamera>,
    mut stations: Query<InHand>,
    uavs: Query<&Uav, With<HeatedSkin>>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    // It takes the whole width, whatever the panels left it before.
    keep_above(ctx, ctx.viewport_rect().bottom());
    let panel = egui::Panel::top("controls")
        .exact_size(2.0 * ROW + GAP + 2.0 * MARGIN)
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame().inner_margin(MARGIN));
    let shown = panel.show(&mut screen_ui(ctx), |ui| {
        ui.visuals_mut().override_text_color = Some(Color32::from_gray(200));
        let corner = ui.max_rect().left_top();
        pace(&mut Row::new(ui, corner, 0), &clock, &mut pacing, |ui| {
            choose_sight(ui, &mut sight, uavs.iter(), cameras.iter());
        });
        let names: Vec<String> = (stations.iter())
            .map(|(station, ..)| station.name.clone())
            .collect();
        let mut given = Vec::new();
        ui.push_id(chosen.0, |ui| {
            let mut row = Row::new(ui, corner, 1);
            row.slot(104.0, |ui| choose_station(ui, &mut chosen, &names));
            if pacing.over {
                // No tick would carry an order out.
                row.ui.disable();
            }
            let in_hand = (stations.iter_mut()).find(|(station, ..)| station.index == chosen.0);
            if let Some((_, mount, tracker, rules, mut controller, operator)) = in_hand {
                given.extend(fire(&mut row, rules));
                given.extend(hand_back(&mut row, tracker, &operator));
                given.extend(row.slot(262.0, |ui| slew(ui, mount, &camera)));
                // What is only read must not count as changed.
                given.extend(law(&mut row, &laws, controller.bypass_change_detection()));
            }
            given.extend(change_weather(&mut row, &environment.weather));
        });
        let tick = clock.tick + 1;
        for command in given {
            // There is one air for all: its orders are the first station's.
            let index = match command {
                _ if command.of_no_station() => 0,
                _ => chosen.0,
            };
            let operator = (stations.iter_mut()).find(|(station, ..)| station.index == index);
            if let Some((.., mut operator)) = operator {
                operator.give(Order { tick, command });
            }
        }
    });
    keep_below(ctx, shown.response.rect.bottom());
    Ok(())
}

fn pace(
    row: &mut Row,
    clock: &SimClock,
    pacing: &mut Pacing,
    choose_sight: impl FnOnce(&mut egui::Ui),
) {
    row.slot(112.0, |ui| {
        let time = RichText::new(format!("{:.3} s", clock.t_s())).size(20.0);
        ui.label(time.monospace().color(Color32::WHITE));
    });
    let word = if pacing.paused { "Play" } else { "Pause" };
    if row.button(58.0, word, !pacing.over) {
        pacing.paused = !pacing.paused;
    }
    for (width, word, step) in [
        (60.0, "+1 tick", StepSize::Tick),
        (66.0, "+1 frame", StepSize::Frame),
    ] {
        if row.button(width, word, !pacing.over) {
            pacing.paused = true;
            pacing.step = Some(step);
        }
    }
    let mut unbound = pacing.speed.is_infinite();
    let toggled = row.slot(148.0, |ui| {
        ui.checkbox(&mut unbound, "as fast as possible").changed()
    });
    if toggled {
        pacing.speed = if unbound { f64::INFINITY } else { 1.0 };
    }
    row.slot(180.0, |ui| {
        let mut speed = if unbound { 1.0 } else { pacing.speed };
        let slider = egui::Slider::new(&mut speed, 0.1..=10.0)
            .logarithmic(true)
            .suffix("×");
        if ui.add_enabled(!unbound, slider).changed() {
            pacing.speed = speed;
        }
    });
    row.slot(220.0, choose_sight);
    row.slot(250.0, |ui| {
        let reached = format!(
            "{:.2}× real time, {:.1} frames/s",
            pacing.reached, pacing.frames_hz
        );
        if pacing.over {
            ui.colored_label(AMBER, "over");
        } else {
            ui.colored_label(GREY, reached);
        }
    });
}

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
        .width(200.0)
        .truncate()
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

/// Of several stations, the one whose orders and panel are shown.
fn choose_station(ui: &mut egui::Ui, chosen: &mut ChosenStation, names: &[String]) {
    let name = names.get(chosen.0).map_or("", String::as_str);
    if names.len() < 2 {
        ui.colored_label(AMBER, name);
        return;
    }
    egui::ComboBox::from_id_salt("station")
        .width(96.0)
        .truncate()
        .selected_text(RichText::new(name).color(AMBER))
        .show_ui(ui, |ui| {
            for (index, name) in names.iter().enumerate() {
                ui.selectable_value(&mut chosen.0, index, name);
            }
        });
}

/// Whether the laser may fire, as the operator says.
fn fire(row: &mut Row, rules: &Rules) -> Option<Command> {
    let mut may = rules.authorised;
    let clicked = row.slot(112.0, |ui| {
        ui.checkbox(&mut may, "fire authority").changed()
    });
    clicked.then_some(Command::Fire(may))
}

/// Leaves the choice of the target to the tracker.
fn hand_back(row: &mut Row, tracker: &Tracker, operator: &Operator) -> Option<Command> {
    let in_hand = tracker.designated || operator.slew_rad.is_some() || operator.waiting.is_some();
    row.button(150.0, "Let the tracker choose", in_hand)
        .then_some(Command::Target(Designation::Release))
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
    for (deg, range) in az_el_deg.iter_mut().zip([0.0..=360.0, -90.0..=90.0]) {
        let drag = egui::DragValue::new(deg).range(range).speed(0.2);
        ui.add_sized([58.0, ROW], drag.suffix("°"));
    }
    let mut ordered = ui.add_sized([42.0, ROW], Button::new("Slew")).clicked();
    if ui
        .add_sized([80.0, ROW], Button::new("to my view"))
        .clicked()
    {
        let ahead = az_el_to_los(DVec2::new(camera.azimuth_rad, camera.elevation_rad));
        let seen_enu_m = camera.r_enu_m + SEEN_M * ahead;
        az_el_deg = rounded_deg(los_to_az_el(seen_enu_m - mount.r_enu_m));
        ordered = true;
    }
    ui.data_mut(|data| data.insert_temp(id, az_el_deg));
    ordered.then_some(Command::Slew(az_el_deg))
}

/// What a gain may be [1], [1/s] or [s].
const GAIN: RangeInclusive<f64> = 0.0..=1000.0;

/// The pointing law, and its gains in a menu.
fn law(row: &mut Row, laws: &PointingLaws, controller: &mut Controller) -> Option<Command> {
    let mut ordered = None;
    row.slot(96.0, |ui| match controller {
        Controller::Pointing(pointing) => {
            let mut name = pointing.name.clone();
            egui::ComboBox::from_id_salt("law")
                .width(88.0)
                .truncate()
                .selected_text(format!("law {name}"))
                .show_ui(ui, |ui| {
                    for known in laws.names() {
                        ui.selectable_value(&mut name, known.to_owned(), known);
                    }
                });
            if name != pointing.name {
                ordered = Some(Command::Law(name));
            }
        }
        Controller::Paper(_) => {
            ui.label("the paper's");
        }
    });
    let stays = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    let gains = row.slot(56.0, |ui| {
        let (_, shown) =
            (MenuButton::new("gains").config(stays)).ui(ui, |ui| gains(ui, controller));
        shown.and_then(|shown| shown.inner)
    });
    ordered.or(gains.map(Command::Gains))
}

/// The gains of the law in force; others, once the user lets go of one.
fn gains(ui: &mut egui::Ui, controller: &mut Controller) -> Option<GainsOrder> {
    match controller {
        Controller::Pointing(pointing) => {
            let Some(gain_per_s) = pointing.law.gimbal_gain_per_s() else {
                ui.label("this law has no gains to set");
                return None;
            };
            let gimbal_per_s = figure(ui, "gimbal", *gain_per_s, (GAIN, 0.1, " /s"))?;
            Some(GainsOrder {
                gimbal_per_s: Some(gimbal_per_s),
                ..default()
            })
        }
        Controller::Paper(paper) => {
            let mut of = |name: &str, law: &PaperLaw| {
                let mut one = |key: &str, value: f64, unit: &str| {
                    let name = format!("{name} {key}");
                    ui.horizontal(|ui| figure(ui, &name, value, (GAIN, 1e-4, unit)))
                        .inner
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
            Some(GainsOrder {
                coarse,
                precise,
                gimbal_per_s: None,
            })
        }
    }
}

/// Wind and visibility as the operator wants them.
fn change_weather(row: &mut Row, weather: &Weather) -> Option<Command> {
    let wind_deg = (10.0 * weather.wind_from_rad.to_degrees()).round() / 10.0;
    let mut slot = |width, name, value, how| row.slot(width, |ui| figure(ui, name, value, how));
    let order = WeatherOrder {
        wind_speed_mps: slot(
            106.0,
            "wind",
            weather.wind_speed_mps,
            (0.0..=60.0, 0.1, " m/s"),
        ),
        wind_from_deg: slot(90.0, "from", wind_deg, (0.0..=360.0, 1.0, "°")),
        visibility_m: slot(
            140.0,
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
    ui.small(name);
    let drag = egui::DragValue::new(&mut draft).range(range).speed(speed);
    let size = [ui.available_width().min(76.0), ROW];
    let drag = ui.add_sized(size, drag.suffix(unit).max_decimals(DECIMALS));
    if drag.changed() {
        ui.data_mut(|data| data.insert_temp(id, draft));
    }
    if !(drag.drag_stopped() || drag.lost_focus()) {
        return None;
    }
    ui.data_mut(|data| data.remove::<f64>(id));
    is_another(draft, value).then_some(draft)
}

/// Decimals to which a figure is shown.
const DECIMALS: usize = 4;

/// Whether two figures read differently: a field that is left as it was gives back its rounded text.
fn is_another(draft: f64, value: f64) -> bool {
    let text = |figure: f64| format!("{figure:.DECIMALS$}");
    text(draft) != text(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_that_is_left_as_it_was_orders_nothing() {
        assert!(!is_another(1.1481, 1.148_084_3));
        assert!(!is_another(18_000.0, 18_000.0));
        assert!(is_another(1.15, 1.148_084_3));
        assert!(is_another(7.0, 1.148_084_3));
    }
}
