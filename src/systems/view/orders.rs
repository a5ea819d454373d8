//! The operator's orders in the window: pending, obeyed or refused.

use super::style::{AMBER, GREEN, GREY, RED};
use crate::components::operator::{Answer, Command, Designation, Operator, Order};
use crate::scenario::{DriveOrder, GainsOrder, WeatherOrder};
use bevy_egui::egui::{self, Color32};

/// Orders that are shown, the latest first.
const SHOWN: usize = 20;

/// A line of the list.
#[derive(Debug, PartialEq)]
struct Line {
    /// What was ordered, and when it counts from.
    text: String,
    /// What has come of it.
    state: String,
    colour: Color32,
}

/// The list of a station's orders; `at_s` gives the time of a tick [s], `name_of` that of a UAV by its index.
pub fn list(
    ui: &mut egui::Ui,
    operator: &Operator,
    at_s: impl Fn(u64) -> f64,
    name_of: impl Fn(usize) -> Option<String>,
) {
    let lines = lines(operator, at_s, name_of);
    if lines.is_empty() {
        ui.colored_label(GREY, "none");
    }
    for line in lines {
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            ui.label(egui::RichText::new(line.text).size(12.0));
            let state = egui::RichText::new(line.state).size(12.0);
            ui.label(state.color(line.colour));
        });
    }
}

fn lines(
    operator: &Operator,
    at_s: impl Fn(u64) -> f64,
    name_of: impl Fn(usize) -> Option<String>,
) -> Vec<Line> {
    let orders = operator.orders.iter().enumerate().rev().take(SHOWN);
    let line = |(number, order): (usize, &Order)| {
        let (state, colour) = state(operator.answers.get(number));
        let what = words(&order.command, &name_of);
        Line {
            text: format!("{:.2} s {what}:", at_s(order.tick)),
            state,
            colour,
        }
    };
    orders.map(line).collect()
}

/// What has come of an order, in words; none: it has not come due.
fn state(answer: Option<&Answer>) -> (String, Color32) {
    match answer {
        None => ("pending".into(), AMBER),
        Some(Answer::Waits) => ("pending, waits for its track".into(), AMBER),
        Some(Answer::Obeyed) => ("obeyed".into(), GREEN),
        Some(Answer::Refused(why)) => (format!("refused: {why}"), RED),
    }
}

/// An order in a few words.
fn words(command: &Command, name_of: &impl Fn(usize) -> Option<String>) -> String {
    match command {
        Command::Target(Designation::Uav(index)) => {
            format!("at {}", name_of(*index).unwrap_or_default())
        }
        Command::Target(Designation::Track(id)) => format!("track {id}"),
        Command::Target(Designation::Release) => "tracker chooses".into(),
        Command::Fire(true) => "fire authority".into(),
        Command::Fire(false) => "hold fire".into(),
        Command::Slew([azimuth_deg, elevation_deg]) => {
            format!("slew {azimuth_deg:.1}°, {elevation_deg:.1}°")
        }
        Command::Law(name) => format!("law {name}"),
        Command::Gains(GainsOrder {
            gimbal_per_s: Some(per_s),
            ..
        }) => format!("gimbal gain {per_s:.2} /s"),
        Command::Gains(_) => "gains".into(),
        Command::Drive(drive) if *drive == DriveOrder::default() => "law drives".into(),
        Command::Drive(_) => "driven from outside".into(),
        Command::Camera(camera) => format!("exposure of {}", camera.name),
        Command::Fly(fly) => format!("{} is flown from outside", fly.uav),
        Command::Weather(weather) => {
            let WeatherOrder {
                wind_speed_mps,
                wind_from_deg,
                visibility_m,
            } = weather;
            let parts = [
                wind_speed_mps.map(|mps| format!("wind {mps:.1} m/s")),
                wind_from_deg.map(|deg| format!("wind from {deg:.0}°")),
                visibility_m.map(|m| format!("visibility {m:.0} m")),
            ];
            parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_tells_what_has_come_of_it() {
        let commands = [
            Command::Fire(false),
            Command::Target(Designation::Track(12)),
            Command::Target(Designation::Uav(1)),
            Command::Law("lqg".into()),
        ];
        let orders = (0..).zip(commands);
        let operator = Operator {
            orders: (orders.map(|(tick, command)| Order { tick, command })).collect(),
            answers: vec![
                Answer::Obeyed,
                Answer::Refused("there is no track 12".into()),
                Answer::Waits,
            ],
            next: 3,
            ..Operator::default()
        };
        let name_of = |index| (index == 1).then(|| "second".to_owned());
        let lines = lines(&operator, |tick| 0.5 * tick as f64, name_of);
        let shown: Vec<(&str, &str)> = (lines.iter())
            .map(|line| (line.text.as_str(), line.state.as_str()))
            .collect();
        assert_eq!(
            shown,
            [
                ("1.50 s law lqg:", "pending"),
                ("1.00 s at second:", "pending, waits for its track"),
                ("0.50 s track 12:", "refused: there is no track 12"),
                ("0.00 s hold fire:", "obeyed"),
            ]
        );
        let colours: Vec<Color32> = lines.iter().map(|line| line.colour).collect();
        assert_eq!(colours, [AMBER, AMBER, RED, GREEN]);
    }
}
