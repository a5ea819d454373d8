//! The operator: who may choose the target, hold fire, turn the station by hand, change laws and weather.

use crate::components::mount::Station;
use crate::scenario::{CameraOrder, DriveOrder, FlyOrder, GainsOrder, OrderConfig, WeatherOrder};
use bevy::prelude::*;
use glam::DVec2;

/// What an operator wants for a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Designation {
    /// The UAV that is pointed at, by its scenario index.
    Uav(usize),
    /// The track with this identity.
    Track(u32),
    /// Whatever the tracker chooses.
    Release,
}

/// What an operator may want.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// A target.
    Target(Designation),
    /// Whether the laser may fire.
    Fire(bool),
    /// Azimuth and elevation about which the station searches [deg], as given: so they are saved unrounded.
    Slew([f64; 2]),
    /// The pointing law of this name.
    Law(String),
    /// Other gains of the law in force.
    Gains(GainsOrder),
    /// Other weather.
    Weather(WeatherOrder),
    /// Gimbal and mirror driven from outside, in place of the law's commands.
    Drive(DriveOrder),
    /// How a camera exposes.
    Camera(CameraOrder),
    /// Where a UAV flies, in place of its plan.
    Fly(FlyOrder),
}

impl Command {
    /// Whether it is of no station, such as the weather: one is enough to carry it out.
    pub fn of_no_station(&self) -> bool {
        matches!(self, Self::Weather(_) | Self::Fly(_))
    }

    /// What it is, in a word.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Target(Designation::Uav(_)) => "designate",
            Self::Target(Designation::Track(_)) => "track",
            Self::Target(Designation::Release) => "release",
            Self::Fire(_) => "fire",
            Self::Slew(_) => "slew",
            Self::Law(_) => "law",
            Self::Gains(_) => "gains",
            Self::Weather(_) => "weather",
            Self::Drive(_) => "drive",
            Self::Camera(_) => "camera",
            Self::Fly(_) => "fly",
        }
    }

    /// Whether it drives gimbal or mirror from outside.
    pub fn drives(&self) -> bool {
        matches!(self, Self::Drive(drive) if *drive != DriveOrder::default())
    }
}

impl Station {
    /// Whether this station carries out such an order: of one that is of no station the first takes care.
    pub fn obeys(&self, order: &OrderConfig, command: &Command) -> bool {
        match command.of_no_station() {
            true => self.index == 0,
            false => order.is_for(&self.name),
        }
    }
}

/// What an operator orders, whether a scenario or a window says so.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    /// Tick from which on it counts.
    pub tick: u64,
    /// What is wanted.
    pub command: Command,
}

/// What has come of an order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// It has come due, and waits for its target's track.
    Waits,
    /// It was carried out.
    Obeyed,
    /// It cannot be carried out, for this reason.
    Refused(String),
}

impl Answer {
    /// What it is, in a word, and why an order is refused; empty for others.
    pub fn words(&self) -> (&'static str, &str) {
        match self {
            Self::Waits => ("waits", ""),
            Self::Obeyed => ("obeyed", ""),
            Self::Refused(why) => ("refused", why),
        }
    }
}

/// The operator's orders, in order of time, and what has come of them.
#[derive(Component, Clone, Debug, Default)]
pub struct Operator {
    /// Orders sorted by tick, those carried out included.
    pub orders: Vec<Order>,
    /// What has come of those that have come due, one each.
    pub answers: Vec<Answer>,
    /// The first that has not come due.
    pub next: usize,
    /// A target that is wanted and has no track yet.
    pub waiting: Option<Designation>,
    /// What came due in this tick and is no target, for the parts of the station that it concerns; air and
    /// cameras change in the next tick.
    pub due: Vec<Command>,
    /// Azimuth (x) and elevation (y) to which the station was slewed by hand [rad].
    pub slew_rad: Option<DVec2>,
    /// What drives gimbal and mirror from outside; what is absent the law in force commands.
    pub drive: DriveOrder,
}

impl Operator {
    /// Queues an order after those of the same tick and before later ones.
    pub fn give(&mut self, order: Order) {
        let at = self.orders.partition_point(|o| o.tick <= order.tick);
        self.orders.insert(at.max(self.next), order);
    }

    /// Answers the order that waits for its track, if one does.
    pub fn answer_waiting(&mut self, answer: Answer) {
        let mut latest_first = self.answers.iter_mut().rev();
        if let Some(last) = latest_first.find(|last| **last == Answer::Waits) {
            *last = answer;
        }
    }

    /// Answers the last order of this kind that came due with a refusal.
    pub fn refuse(&mut self, command: &Command, why: String) {
        let mut latest_first = self.orders.iter().zip(&mut self.answers).rev();
        if let Some((_, answer)) = latest_first.find(|(order, _)| order.command == *command) {
            *answer = Answer::Refused(why);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_stand_in_order_of_time_behind_those_carried_out() {
        let order = |tick, id| Order {
            tick,
            command: Command::Target(Designation::Track(id)),
        };
        let mut operator = Operator::default();
        for given in [order(50, 1), order(10, 2), order(50, 3)] {
            operator.give(given);
        }
        operator.next = 2;
        operator.give(order(20, 4));
        assert_eq!(
            operator.orders,
            [order(10, 2), order(50, 1), order(20, 4), order(50, 3)]
        );
    }
}
