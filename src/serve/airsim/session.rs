//! The run that is served, and what AirSim's clients have set in it.

use super::answers::{Answer, Fault, say_to, time_ns};
use super::names;
use super::objects::Objects;
use super::tasks::{self, Stands, Task, Tasks, stop};
use super::weather::Sky;
use crate::report::summary::Finished;
use crate::scenario::OrderConfig;
use crate::serve::entrance::say;
use crate::serve::error::ServeError;
use crate::serve::inbox::Client;
use crate::serve::session::{Opening, Session as Held};
use crate::simulation::{Depth, Frame, Simulation, View};
use boresight_airsim::Value;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

/// Time that passes while the run is paused, and who waits for its end.
struct Going {
    last_tick: u64,
    client: Client,
    id: Option<u32>,
}

/// What has been looked at since the last tick, by camera: so that asking twice costs once.
#[derive(Default)]
pub(super) struct Looked {
    pub frames: BTreeMap<usize, Option<Frame>>,
    pub depths: BTreeMap<usize, Option<Arc<Depth>>>,
}

/// A run between two calls.
pub(super) struct Session {
    pub held: Held,
    /// Where each vehicle stood at the start: the origin of its own frame \[m\].
    homes_enu_m: BTreeMap<String, DVec3>,
    /// Velocities \[m/s\] and rates \[rad/s\] of each vehicle before the last tick.
    before: Vec<(DVec3, DVec3)>,
    /// Vehicles that clients fly.
    controlled: BTreeSet<String>,
    pub tasks: Tasks,
    going: Option<Going>,
    pub looked: Looked,
    pub objects: Objects,
    pub sky: Sky,
    pub recording: bool,
}

impl Session {
    /// Opens the run.
    pub(super) fn open(opening: Opening) -> Result<Self, ServeError> {
        Ok(Self::of(Held::open(opening)?))
    }

    fn of(held: Held) -> Self {
        let view = held.run().view();
        let homes_enu_m = names::vehicles(view)
            .map(|uav| (uav.name().to_owned(), uav.r_enu_m()))
            .collect();
        let sky = Sky::new(view);
        Self {
            homes_enu_m,
            before: Vec::new(),
            controlled: BTreeSet::new(),
            tasks: Tasks::default(),
            going: None,
            looked: Looked::default(),
            objects: Objects::default(),
            sky,
            recording: false,
            held,
        }
    }

    /// The run.
    pub(super) fn run(&self) -> &Simulation {
        self.held.run()
    }

    /// The run as its last tick left it.
    pub(super) fn view(&self) -> View<'_> {
        self.run().view()
    }

    /// Time of the simulation \[ns\].
    pub(super) fn now_ns(&self) -> u64 {
        time_ns(self.view().t_s())
    }

    /// Whether the run is over.
    pub(super) fn over(&self) -> bool {
        self.held.over()
    }

    /// Does what ground stations that speak MAVLink want.
    pub(super) fn hear(&mut self) -> Result<(), ServeError> {
        self.held.hear()?.iter().for_each(say);
        Ok(())
    }

    /// When the next tick begins; none while the run stands still.
    pub(super) fn due(&mut self) -> Option<Instant> {
        match self.going {
            Some(_) => Some(Instant::now()),
            None => self.held.due(),
        }
    }

    /// Lets a tick pass, and answers those who have waited for it.
    pub(super) fn tick(&mut self) -> Result<(), ServeError> {
        self.before = names::vehicles(self.view())
            .map(|uav| (uav.v_enu_mps(), uav.rates_body_radps()))
            .collect();
        match self.going {
            Some(_) => self.held.pass()?,
            None => self.held.tick()?,
        }
        self.looked = Looked::default();
        self.look_after_tasks()?;
        let (tick, over) = (self.view().tick(), self.over());
        if let Some(Going { client, id, .. }) =
            self.going.take_if(|going| over || tick >= going.last_tick)
        {
            say_to(&client, id, Value::Nil);
        }
        if over {
            for task in self.tasks.take_all() {
                task.end(false);
            }
        }
        Ok(())
    }

    /// Ends the tasks that are done, late or lost.
    fn look_after_tasks(&mut self) -> Result<(), ServeError> {
        let mut tasks = std::mem::take(&mut self.tasks);
        let mut ended = Vec::new();
        for task in tasks.each() {
            let t_s = self.view().t_s();
            let Ok(uav) = names::vehicle(self.view(), &task.vehicle) else {
                continue;
            };
            let order = match tasks::stands(task, &uav, t_s) {
                Stands::Goes => continue,
                Stands::Wants(order) => order,
                Stands::Ends { done, stops } => {
                    ended.push((task.vehicle.clone(), done));
                    if !stops {
                        continue;
                    }
                    stop(&task.vehicle)
                }
            };
            let order = OrderConfig {
                fly: Some(order),
                ..OrderConfig::default()
            };
            match self.give("fly", order) {
                // It was taken once; what ends with the run is told there.
                Ok(()) | Err(Fault::Refused(_)) => {}
                Err(Fault::Fatal(error)) => return Err(error),
            }
        }
        for (vehicle, done) in ended {
            if let Some(task) = tasks.take(&vehicle) {
                task.end(done);
            }
        }
        self.tasks = tasks;
        Ok(())
    }

    /// Lets so many ticks pass while the run is paused; the client that wants it is answered after them.
    pub(super) fn go_on(&mut self, ticks: u64, client: &Client, id: Option<u32>) -> Answer {
        self.held.set_paused(true);
        if ticks == 0 || self.over() {
            return Answer::Now(Value::Nil);
        }
        let last_tick = self.view().tick().saturating_add(ticks);
        let going = Going {
            last_tick,
            client: client.clone(),
            id,
        };
        if let Some(Going { client, id, .. }) = self.going.replace(going) {
            say_to(&client, id, Value::Nil);
        }
        Answer::Later
    }

    /// Holds the run, or lets it go on by the clock.
    pub(super) fn pause(&mut self, paused: bool) {
        self.held.set_paused(paused);
        if let Some(Going { client, id, .. }) = self.going.take() {
            say_to(&client, id, Value::Nil);
        }
    }

    /// Whether time stands still.
    pub(super) fn paused(&self) -> bool {
        self.held.paused() && self.going.is_none()
    }

    /// The run begins anew, without the orders that were given.
    pub(super) fn reset(mut self) -> Result<Self, ServeError> {
        for task in self.tasks.take_all() {
            task.end(false);
        }
        if let Some(Going { client, id, .. }) = self.going.take() {
            say_to(&client, id, Value::Nil);
        }
        let objects = std::mem::take(&mut self.objects);
        let mut again = Self::of(self.held.begin_anew()?);
        again.objects = objects;
        Ok(again)
    }

    /// Gives an order, which is recorded.
    pub(super) fn give(&mut self, method: &str, order: OrderConfig) -> Result<(), Fault> {
        match self.held.obey(order).map_err(Fault::Fatal)? {
            Ok(()) => Ok(()),
            Err(why) => Err(Fault::Refused(format!("{method}: {why}"))),
        }
    }

    /// Where a vehicle stood at the start \[m\].
    pub(super) fn home_enu_m(&self, vehicle: &str) -> DVec3 {
        self.homes_enu_m.get(vehicle).copied().unwrap_or_default()
    }

    /// Acceleration \[m/s², enu\] and angular acceleration \[rad/s², body\] of a vehicle in the last tick, by its number.
    pub(super) fn accelerations(&self, number: usize) -> (DVec3, DVec3) {
        let view = self.view();
        let now = names::vehicles(view).nth(number);
        let tick_hz = f64::from(view.tick_hz());
        match (now, self.before.get(number)) {
            (Some(uav), Some((v_enu_mps, rates_radps))) => (
                (uav.v_enu_mps() - v_enu_mps) * tick_hz,
                (uav.rates_body_radps() - rates_radps) * tick_hz,
            ),
            _ => (DVec3::ZERO, DVec3::ZERO),
        }
    }

    /// Whether clients fly a vehicle.
    pub(super) fn controls(&self, vehicle: &str) -> bool {
        self.controlled.contains(vehicle)
    }

    /// Gives a vehicle into the clients' hands, or out of them.
    pub(super) fn control(&mut self, vehicle: &str, controlled: bool) {
        match controlled {
            true => self.controlled.insert(vehicle.to_owned()),
            false => self.controlled.remove(vehicle),
        };
    }

    /// A vehicle does something else from now on: whoever waits for what it did is told that it was not done.
    pub(super) fn begin_task(&mut self, task: Task) {
        if let Some(before) = self.tasks.begin(task) {
            before.end(false);
        }
    }

    /// Ends the run where it is, and writes what it leaves.
    pub(super) fn finish(mut self) -> Result<Finished, ServeError> {
        for task in self.tasks.take_all() {
            task.end(false);
        }
        if let Some(pace) = self.held.pace() {
            say(pace.told());
        }
        Ok(self.held.finish()?.1)
    }
}
