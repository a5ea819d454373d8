//! Ground stations and autopilots of a run, as one.

use super::ground::Ground;
use super::hil::{Pilot, PilotError};
use crate::scenario::OrderConfig;
use crate::simulation::View;

/// Ground stations and autopilots of a run; none by default.
#[derive(Default)]
pub struct Doors {
    pub(super) ground: Option<Ground>,
    pub(super) pilots: Vec<Pilot>,
}

impl Doors {
    /// Where MAVLink is spoken, a line each.
    pub fn said(&self) -> Vec<String> {
        let ground = self.ground.iter();
        let ground = ground.map(|ground| format!("mavlink  {}", ground.address()));
        let pilots = self.pilots.iter();
        let pilots = pilots.map(|pilot| format!("hil  {}={}", pilot.uav(), pilot.address()));
        ground.chain(pilots).collect()
    }

    /// Whether there are any: a run with such ends by itself, and its clock begins without a client.
    pub fn any(&self) -> bool {
        self.ground.is_some() || !self.pilots.is_empty()
    }

    /// Whether somebody who is waited for has come.
    pub fn had_any(&self) -> bool {
        self.ground.as_ref().is_some_and(Ground::had_any) || self.flown().is_some()
    }

    /// A UAV that an autopilot flies: time goes on for it alone, never back.
    pub fn flown(&self) -> Option<&str> {
        self.pilots.first().map(Pilot::uav)
    }

    /// Lets autopilots in; whether all are there.
    pub fn ready(&mut self) -> bool {
        // Each is let in, whether those before it are there or not.
        let there: Vec<bool> = self.pilots.iter_mut().map(Pilot::join).collect();
        there.into_iter().all(|is_there| is_there)
    }

    /// What the autopilots order before a tick. Those that follow one that is stopped are not asked.
    pub fn before(
        &mut self,
        view: View,
        stopped: impl Fn() -> bool + Copy,
    ) -> Result<Vec<OrderConfig>, PilotError> {
        let mut orders = Vec::new();
        for pilot in &mut self.pilots {
            orders.extend(pilot.exchange(view, stopped)?);
        }
        Ok(orders)
    }

    /// Notes and tells what a tick has brought.
    pub fn after(&mut self, view: View) {
        for pilot in &mut self.pilots {
            pilot.note(view);
        }
        if let Some(ground) = &mut self.ground {
            ground.tell(view);
        }
    }

    /// The ground stations.
    pub fn ground(&mut self) -> Option<&mut Ground> {
        self.ground.as_mut()
    }
}
