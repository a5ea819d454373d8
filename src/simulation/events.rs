//! What happened in a run: changes worth a line of a log.

use super::view::View;
use crate::components::flight::UavStatus;
use crate::components::operator::{Answer, Command};
use crate::components::track::TrackingState;

/// Something that happened in a tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// The tick.
    pub tick: u64,
    /// Simulated time [s].
    pub t_s: f64,
    /// What happened.
    pub what: What,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// A station's engagement entered a state.
    State {
        /// Name of the station.
        station: String,
        /// The state.
        to: TrackingState,
        /// The tracker's reason.
        reason: String,
    },
    /// An order came due, or what comes of it changed.
    Order {
        /// Name of the station.
        station: String,
        /// What was ordered.
        command: Command,
        /// What came of it.
        answer: Answer,
    },
    /// A laser began to emit.
    Fire {
        /// Name of the station.
        station: String,
        /// Scenario index of the UAV nearest to its axis, if one is near.
        at: Option<usize>,
    },
    /// A laser stopped.
    CeaseFire {
        /// Name of the station.
        station: String,
    },
    /// A UAV's status changed.
    Uav {
        /// Scenario index.
        index: usize,
        /// Its name.
        name: String,
        /// What has become of it.
        status: UavStatus,
    },
    /// A UAV came within the asset's radius unharmed.
    AtAsset {
        /// Scenario index.
        index: usize,
        /// Its name.
        name: String,
    },
}

/// What was seen of the run before, and what has happened since it was last asked.
#[derive(Clone, Default)]
pub(super) struct Watch {
    stations: Vec<Known>,
    uavs: Vec<(UavStatus, bool)>,
    events: Vec<Event>,
}

/// What is known of a station.
#[derive(Clone, Default)]
struct Known {
    changes: usize,
    /// Orders that have come due, and those among them that wait.
    due: usize,
    waiting: Vec<usize>,
    firing: bool,
}

impl Watch {
    /// Begins with a run that has not ticked yet: its start is no event.
    pub(super) fn of(view: View) -> Self {
        let mut watch = Self::default();
        watch.look(view);
        watch.events.clear();
        watch
    }

    /// What has happened since [`Self::clear`], in order of time.
    pub(super) fn events(&self) -> &[Event] {
        &self.events
    }

    /// Forgets the events so far.
    pub(super) fn clear(&mut self) {
        self.events.clear();
    }

    /// Takes in a tick.
    pub(super) fn look(&mut self, view: View) {
        let (tick, t_s) = (view.tick(), view.t_s());
        let Self {
            stations,
            uavs,
            events,
        } = self;
        let mut note = |what| events.push(Event { tick, t_s, what });
        for (number, station) in view.stations().enumerate() {
            if stations.len() <= number {
                stations.push(Known::default());
            }
            let known = &mut stations[number];
            let name = || station.name().to_owned();
            let changes = &station.tracker().changes;
            for change in changes.iter().skip(known.changes) {
                note(What::State {
                    station: name(),
                    to: change.to,
                    reason: change.reason.clone(),
                });
            }
            known.changes = changes.len();
            let due = station.orders_due();
            let waited = std::mem::take(&mut known.waiting);
            let fresh = known.due..due;
            for (at, is_fresh) in
                (waited.into_iter().map(|at| (at, false))).chain(fresh.map(|at| (at, true)))
            {
                let Some((order, answer)) = station.order(at) else {
                    continue;
                };
                let waits = *answer == Answer::Waits;
                if waits {
                    known.waiting.push(at);
                }
                if is_fresh || !waits {
                    note(What::Order {
                        station: name(),
                        command: order.command.clone(),
                        answer: answer.clone(),
                    });
                }
            }
            known.due = due;
            let beam = station.beam();
            if beam.firing != known.firing {
                known.firing = beam.firing;
                note(match beam.firing {
                    true => What::Fire {
                        station: name(),
                        at: beam.aimed,
                    },
                    false => What::CeaseFire { station: name() },
                });
            }
        }
        for (number, uav) in view.uavs().enumerate() {
            let at_asset = uav.fate().is_some_and(|fate| fate.at_asset_s.is_some());
            let now = (uav.status(), at_asset);
            let Some(before) = uavs.get_mut(number) else {
                uavs.push(now);
                continue;
            };
            let (index, name) = (uav.index(), || uav.name().to_owned());
            if now.0 != before.0 {
                note(What::Uav {
                    index,
                    name: name(),
                    status: now.0,
                });
            }
            if now.1 && !before.1 {
                note(What::AtAsset {
                    index,
                    name: name(),
                });
            }
            *before = now;
        }
    }
}
