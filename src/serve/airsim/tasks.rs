//! What vehicles are doing for clients that wait for it.

use super::answers::say_to;
use crate::components::flight::UavStatus;
use crate::scenario::FlyOrder;
use crate::serve::inbox::Client;
use crate::simulation::UavView;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// A place is reached this close \[m\] and this slow \[m/s\].
const REACHED_M: f64 = 0.5;
const REACHED_MPS: f64 = 0.6;
/// What hovers is slower \[m/s\].
const STILL_MPS: f64 = 0.4;
/// A height is held by a vertical velocity anew so often \[s\]: the way that is left a second \[1/s\], and at most so fast
/// \[m/s\].
const HELD_EVERY_S: f64 = 0.2;
const HELD_PER_S: f64 = 1.0;
const HELD_MPS: f64 = 3.0;

/// When a task is done.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Until {
    /// The vehicle is there, at rest.
    There(DVec3),
    /// It is at this height \[m\], no longer rising or falling.
    Height(f64),
    /// It stands still.
    Still,
    /// It stands on the ground.
    Landed,
    /// Its nose looks so \[rad, clockwise from north\], so exactly \[rad\].
    Heading(f64, f64),
    /// This time has come \[s\]; then it stops.
    Time(f64),
    /// The same, while it holds a height \[m\] at a velocity over the ground \[m/s\] by orders, the next of them at a time
    /// \[s\].
    HeldTime {
        end_s: f64,
        v_enu_mps: DVec2,
        up_m: f64,
        heading_deg: Option<f64>,
        next_s: f64,
    },
}

/// Something that a vehicle does, and who waits for it.
pub(super) struct Task {
    pub client: Client,
    pub id: Option<u32>,
    pub vehicle: String,
    pub until: Until,
    /// When it is given up \[s\].
    pub deadline_s: f64,
}

impl Task {
    /// Says whether it was done.
    pub(super) fn end(self, done: bool) {
        say_to(&self.client, self.id, done.into());
    }
}

/// One task at most of each vehicle.
#[derive(Default)]
pub(super) struct Tasks(BTreeMap<String, Task>);

impl Tasks {
    /// Takes a task in, and gives out the one that it takes the place of.
    pub(super) fn begin(&mut self, task: Task) -> Option<Task> {
        self.0.insert(task.vehicle.clone(), task)
    }

    /// The task of a vehicle, which it no longer has.
    pub(super) fn take(&mut self, vehicle: &str) -> Option<Task> {
        self.0.remove(vehicle)
    }

    /// The tasks, vehicle by vehicle.
    pub(super) fn each(&mut self) -> impl Iterator<Item = &mut Task> {
        self.0.values_mut()
    }

    /// All tasks.
    pub(super) fn take_all(&mut self) -> impl Iterator<Item = Task> + use<> {
        std::mem::take(&mut self.0).into_values()
    }
}

/// How a task stands.
pub(super) enum Stands {
    Goes,
    /// It is at its end, and whether it was done; the vehicle is to stop.
    Ends {
        done: bool,
        stops: bool,
    },
    /// The vehicle is to fly so meanwhile.
    Wants(FlyOrder),
}

/// To stop and stay.
pub(super) fn stop(vehicle: &str) -> FlyOrder {
    FlyOrder {
        uav: vehicle.to_owned(),
        ..FlyOrder::default()
    }
}

/// Heading of a nose \[rad\], clockwise from north.
pub(super) fn heading_rad(uav: &UavView) -> f64 {
    let nose = uav.q_enu_body() * DVec3::X;
    nose.x.atan2(nose.y)
}

/// How a task stands at a time \[s\].
pub(super) fn stands(task: &mut Task, uav: &UavView, t_s: f64) -> Stands {
    let status = uav.status();
    let flies = matches!(status, UavStatus::Flying | UavStatus::Landed);
    let ends = |done: bool, stops: bool| Stands::Ends { done, stops };
    if !flies {
        return ends(false, false);
    }
    let (r_enu_m, v_enu_mps) = (uav.r_enu_m(), uav.v_enu_mps());
    let slow = v_enu_mps.length() < REACHED_MPS;
    let (done, stops) = match &mut task.until {
        Until::There(at_m) => (r_enu_m.distance(*at_m) < REACHED_M && slow, false),
        Until::Height(up_m) => ((r_enu_m.z - *up_m).abs() < REACHED_M && slow, false),
        Until::Still => (v_enu_mps.length() < STILL_MPS, false),
        Until::Landed => (status == UavStatus::Landed, false),
        Until::Heading(wanted_rad, margin_rad) => {
            let off_rad = (heading_rad(uav) - *wanted_rad + PI).rem_euclid(2.0 * PI) - PI;
            (off_rad.abs() < *margin_rad, false)
        }
        Until::Time(end_s) => (t_s >= *end_s, true),
        Until::HeldTime {
            end_s,
            v_enu_mps,
            up_m,
            heading_deg,
            next_s,
        } => {
            if t_s < *end_s && t_s >= *next_s {
                *next_s = t_s + HELD_EVERY_S;
                let order = held(&task.vehicle, *v_enu_mps, *up_m - r_enu_m.z, *heading_deg);
                return Stands::Wants(order);
            }
            (t_s >= *end_s, true)
        }
    };
    match done {
        true => ends(true, stops),
        false if t_s >= task.deadline_s => ends(false, true),
        false => Stands::Goes,
    }
}

/// To fly over the ground, and to make up for what is left of the way up \[m\].
fn held(vehicle: &str, v_enu_mps: DVec2, left_m: f64, heading_deg: Option<f64>) -> FlyOrder {
    let up_mps = (HELD_PER_S * left_m).clamp(-HELD_MPS, HELD_MPS);
    FlyOrder {
        uav: vehicle.to_owned(),
        velocity_enu_mps: Some(v_enu_mps.extend(up_mps).to_array()),
        heading_deg,
        ..FlyOrder::default()
    }
}
